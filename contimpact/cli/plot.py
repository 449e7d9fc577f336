"""``contimpact plot``: draw the diagram of a folder written by run."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..errors import InputError, shown
from ..records.catalogue import load_diagram
from ..records.diagram import Diagram
from ..records.recovery import model_at
from ..records.result_folder import MANIFEST, kept_still, read_json
from ..scenes.scene import FORMATS, PlotOptions, Scene, read_scene
from .terminal import say


def command(options: argparse.Namespace) -> int:
    """Draw a diagram again; returns the exit status."""
    if options.output == "":
        raise InputError("-o", "empty", "give a file such as diagram.svg")
    folder = Path(options.folder)
    target = Path(options.output) if options.output else folder / "diagram.png"
    with kept_still(target.parent):
        _draw(folder, target, options)
    say(f"written to {target}")
    return 0


def _draw(folder: Path, target: Path, options: argparse.Namespace) -> None:
    """Draw the diagram in a folder to a file."""
    diagram = load_diagram(folder)
    plot, unit = _shown_as(folder, diagram)
    chosen: dict[str, Any] = {
        "x": options.x or plot.x,
        "xlim": options.xlim or (plot.xlim if not options.x else None),
        "ylim": options.ylim or plot.ylim,
        "unphysical": plot.unphysical,
        "labels": plot.labels,
    }
    numbers = ["arclength", *diagram.branches[0].parameters] if diagram.branches else []
    if chosen["x"] not in numbers:
        raise InputError("-x", f"no column {chosen['x']!r}", f"accepted are {', '.join(numbers)}")
    kind = target.suffix.removeprefix(".").lower()
    if kind not in FORMATS:
        raise InputError(str(target), f"format {kind!r}", f"accepted are {', '.join(FORMATS)}")
    from ..plots.diagram import plot_diagram, write_figure

    ax = plot_diagram(diagram, unit=unit(chosen["x"]), **chosen)
    write_figure(ax.figure, target, kind, diagram.name)


def _shown_as(folder: Path, diagram: Diagram) -> tuple[PlotOptions, Callable[[str], str]]:
    """How a diagram is drawn, and the units of its parameters.

    They are those of the scene, or, in a folder that was written from Python, those of the system.
    """
    if (folder / "manifest.json").exists() or not diagram.branches:
        scene = _scene_of(folder)
        _require_walls(diagram, scene)
        return scene.plot, scene.model.unit
    branch = diagram.branches[0]
    try:
        unit = model_at(branch, 0).unit
    except InputError:  # a system of one's own: its units are not known here

        def unit(name: str) -> str:
            return ""

    return PlotOptions(branch.parameter), unit


def _require_walls(diagram: Diagram, scene: Scene) -> None:
    """Raise `InputError` if orbits have walls that the scene's system has not."""
    walls = {wall.name for wall in scene.model.WALLS}
    for branch in diagram.branches:
        if not set(branch.word) <= walls:
            accepted = f"{scene.model.SYSTEM} has the walls {', '.join(sorted(walls))}"
            raise InputError(f"branch {branch.id}", f"the word {shown(branch.word)}", accepted)


def _scene_of(folder: Path) -> Scene:
    """The scene in a folder's manifest."""
    path, wanted = folder / "manifest.json", "a folder made by contimpact run"
    manifest = read_json(path, MANIFEST, wanted)
    try:
        return read_scene(manifest["scene"]["resolved"])
    except InputError as error:
        raise InputError(
            str(path), f"its scene cannot be read: {error}", f"give {wanted}"
        ) from None
    except (KeyError, TypeError):
        raise InputError(str(path), "damaged: it holds no scene", f"give {wanted}") from None
