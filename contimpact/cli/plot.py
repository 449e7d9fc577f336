"""``contimpact plot``: draw the diagram of a folder written by run, as a picture or as the page."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError, short_repr
from ..models.model import Model
from ..progress import Progress
from ..results.branch import model_at
from ..results.catalogue import load_diagram
from ..results.diagram import Diagram
from ..results.diagram_reading import sentence_of
from ..results.fractions import read_fractions
from ..results.options import FORMATS, PlotOptions
from ..results.result_folder import MANIFEST, WANTED, kept_still, read_json
from ..results.scene import Scene, load_scene, read_scene, systems_of
from ..storage.files import is_there
from ..telling import telling
from .console import motions_in
from .terminal import say

if TYPE_CHECKING:
    from ..systems.membrane import Membrane

VELOCITY = "velocity"
"""The quantity that attractors are drawn with."""


def command(options: argparse.Namespace) -> int:
    """Draw a diagram again; returns the exit status."""
    if options.output == "":
        raise InputError("-o", "empty", "give a file such as diagram.svg")
    folder = Path(options.folder)
    usual = folder / ("diagram.html" if options.html else "diagram.png")
    target = Path(options.output) if options.output else usual
    kind = target.suffix.removeprefix(".").lower()
    if options.html and kind != "html":
        raise InputError("--html", f"the file {target}", "give one that ends in .html, or none")
    with kept_still(target.parent), telling(folder.name, patient=True) as tell:
        tell("reading")
        if kind == "html":
            draw_page(folder, target, options, tell)
        else:
            _draw(folder, target, kind, options, tell)
    say(f"written to {target}")
    return 0


def _draw(
    folder: Path, target: Path, kind: str, options: argparse.Namespace, tell: Progress
) -> None:
    """Draw the diagram in a folder to a file, of a simulation with its attractors."""
    simulated = is_there(folder / "sweep.csv")
    diagram = _diagram_in(folder, systems_of(options.system))
    plot, model, membrane = _drawing_options(folder, diagram, systems_of(options.system))
    chosen = _plot_choices(plot, diagram, options)
    if kind not in FORMATS:
        accepted = f"accepted are {', '.join(FORMATS)}, html"
        raise InputError(str(target), f"format {kind!r}", accepted)
    from ..plots.diagram import heading, plot_diagram, write_figure, write_heading

    tell("drawing")
    y = options.y or plot.y
    chosen |= {"unit": model.unit(chosen["x"]) if model else "", "labels": plot.labels}
    if simulated and model is not None and y == VELOCITY:
        from ..plots.attractors import plot_sweep
        from ..simulation.files import sweep_of

        if is_there(folder / "fractions.csv"):
            chosen["fractions"] = read_fractions(folder / "fractions.csv")[1]
        ax = plot_sweep(sweep_of(folder / "sweep.csv", model), diagram=diagram, **chosen)
        write_heading(ax.figure, heading(diagram))
    else:
        ax = plot_diagram(diagram, y=y, membrane=membrane, **chosen)
    write_figure(ax.figure, target, kind, diagram.name)
    for unknown in diagram.reading.unknown:
        say(sentence_of(unknown))


def draw_page(
    folder: Path, target: Path, options: argparse.Namespace | None, tell: Progress
) -> None:
    """Draw the page of a folder of results to a file.

    Raises InputError if the folder holds no results, or the file cannot be written.
    """
    from ..page.data import PageView, remarks_in
    from ..page.document import write_page

    systems = systems_of(options.system) if options else {}
    given, diagram = _names_its_scene(folder), _diagram_in(folder, systems)
    plot, model, _ = _drawing_options(folder, diagram, systems)
    chosen = _plot_choices(plot, diagram, options) if options else {}
    shown = PageView(plot.x, plot.xlim, plot.ylim, plot.unphysical)
    if given:
        source, remarks = scene_of(folder, systems).source, []
        if (folder / "manifest.json").exists():
            manifest = read_json(folder / "manifest.json", MANIFEST, WANTED)
            remarks = remarks_in(manifest, diagram.coverage)
        shown = dataclasses.replace(shown, source=source, remarks=remarks)
    shown = dataclasses.replace(shown, **chosen)
    motions = motions_in(folder, diagram, model, tell) if model is not None else []
    write_page(diagram, model, folder, shown, target, tell, motions)


def _diagram_in(folder: Path, systems: Mapping[str, type[Model]]) -> Diagram:
    """The diagram in a folder; one without branches of a simulation that followed none."""
    simulated = is_there(folder / "sweep.csv") and not is_there(folder / "catalogue.json")
    if _names_its_scene(folder) and simulated:
        return Diagram(scene_of(folder, systems).name, [])
    return load_diagram(folder)


def _plot_choices(
    plot: PlotOptions, diagram: Diagram, options: argparse.Namespace
) -> dict[str, Any]:
    """Axis, limits and orbits to draw, as the command line has it or else the scene."""
    x = options.x or plot.x
    numbers = ["arclength", *diagram.branches[0].parameters] if diagram.branches else [plot.x]
    if x not in numbers:
        raise InputError("-x", f"no column {x!r}", f"accepted are {', '.join(numbers)}")
    return {
        "x": x,
        "xlim": options.xlim or (plot.xlim if not options.x else None),
        "ylim": options.ylim or (plot.ylim if not options.y else None),
        "unphysical": plot.unphysical,
    }


def _drawing_options(
    folder: Path, diagram: Diagram, systems: Mapping[str, type[Model]]
) -> tuple[PlotOptions, Model | None, Membrane | None]:
    """How a diagram is drawn, the system, and the membranes that were named.

    They are those of the scene, or, in a folder that was written from Python, those that the
    branches name; None for a system of one's own.
    """
    if _names_its_scene(folder) or not diagram.branches:
        scene = scene_of(folder, systems)
        _require_walls(diagram, scene)
        return scene.plot, scene.model, scene.energy
    branch = diagram.branches[0]
    try:
        return PlotOptions(branch.parameter), model_at(branch, 0), None
    except InputError:  # a system of one's own is not known here
        return PlotOptions(branch.parameter), None, None


def _require_walls(diagram: Diagram, scene: Scene) -> None:
    """Raise `InputError` if orbits have walls that the scene's system has not."""
    walls = set(scene.model.letters)
    for branch in diagram.branches:
        if not set(branch.word) <= walls:
            accepted = f"{scene.model.SYSTEM} has the walls {', '.join(sorted(walls))}"
            raise InputError(f"branch {branch.id}", f"the word {short_repr(branch.word)}", accepted)


def _names_its_scene(folder: Path) -> bool:
    """Whether a folder has a manifest, or the scene file that its results are committed with."""
    return (folder / "manifest.json").exists() or (folder / "scene.toml").exists()


def scene_of(folder: Path, systems: Mapping[str, type[Model]]) -> Scene:
    """Return the scene in a folder's manifest; without one, that of its scene file.

    Raises InputError if there is neither.
    """
    path, wanted = folder / "manifest.json", WANTED
    if not path.exists() and (folder / "scene.toml").exists():
        return load_scene(folder / "scene.toml", systems)
    manifest = read_json(path, MANIFEST, wanted)
    try:
        return read_scene(manifest["scene"]["resolved"], systems)
    except InputError as error:
        if error.where == "model.system":
            raise InputError(str(path), error.found, error.accepted) from None
        raise InputError(
            str(path), f"its scene cannot be read: {error}", f"give {wanted}"
        ) from None
    except (KeyError, TypeError):
        raise InputError(str(path), "damaged: it holds no scene", f"give {wanted}") from None
