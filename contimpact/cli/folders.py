"""Commands of folders of results: ``plot``, ``view``, ``range``, ``catalogue`` and ``certify``."""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import math
import webbrowser
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError, count_text, require_known, short_repr
from ..models.model import Model
from ..progress import Progress, telling
from ..results.branch import model_at, require_axis
from ..results.catalogue import Results, open_results, read_fractions, simulation_remarks
from ..results.diagram import Diagram
from ..results.diagram_reading import sentence_of
from ..results.options import FORMATS, CertifyOptions, PlotOptions
from ..results.result_folder import (
    MANIFEST,
    WANTED,
    hold_folder,
    kept_still,
    prepare_folder,
    reading,
)
from ..results.scene import Scene, load_scene, read_scene, systems_of
from ..segments.kernels import Kernels
from ..storage import is_there, read_json, write, write_text
from . import complain, say
from .console import motions_in

if TYPE_CHECKING:
    from ..systems.membrane import Membrane


VELOCITY = "velocity"
"""The quantity that attractors are drawn with."""


def plot(options: argparse.Namespace) -> int:
    """Draw the diagram of a folder again, as a picture or as the page; returns the exit status."""
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


def view(options: argparse.Namespace) -> int:
    """Write the page of a folder anew and open it; returns the exit status.

    A page that is there already is not opened: in a folder of somebody else it may be anything.
    """
    target = Path(options.folder) / "diagram.html"
    with kept_still(target.parent), telling(target.parent.name, patient=True) as tell:
        tell("reading")
        draw_page(target.parent, target, None, tell)
    say(f"written to {target}")
    if webbrowser.open(target.resolve().as_uri()):
        return 0
    complain(f"no browser could be started; open {target} in one")
    return 1


def ranges(options: argparse.Namespace) -> int:
    """Print the attractors along the parameter, or at some values; returns the exit status."""
    from ..diagrams.ranges import load_ranges, ranges_text

    folder, systems = Path(options.folder), systems_of(options.system)
    target = Path(options.output or "")
    if options.output:
        prepare_folder(target.parent, [target.name])
    with (
        kept_still(folder, only_read=True),
        telling(folder.name, options.quiet, patient=True) as tell,
    ):
        tell("reading")
        swept = any(is_there(place / "sweep.csv") for place in (folder, folder / "simulation"))
        alone = swept and not is_there(folder / "catalogue.json")
        found = load_ranges(folder, scene_in(folder, systems).model if alone else None)
    try:
        texts = [*map(found.describe, options.at), *found.notes] if options.at else [repr(found)]
    except InputError as error:
        raise InputError("--at", f"{error.found} for {error.where}", error.accepted) from None
    if options.output:
        write_text(target, ranges_text(found))
        texts.append(f"written to {target}")
    for text in texts if not options.quiet else ():
        say(text)
    return 0


def catalogue(options: argparse.Namespace) -> int:
    """Merge the catalogues of several folders; returns the exit status."""
    from ..results.formats import FILES, merge, write_merged

    with telling("catalogue", patient=True) as tell:
        tell("reading")
        merged = merge(options.folders)
    with hold_folder(options.output, FILES) as folder:
        files = write_merged(merged, folder)
    for source in merged["sources"]:
        _complain_of_end(source["folder"], source.get("interrupted"))
    entries = count_text(len(merged["entries"]), "entry", "entries")
    scenes = count_text(len(merged["sources"]), "scene")
    say(f"{entries} of {scenes} written to {folder}: {', '.join(files)}")
    return 0


def _draw(
    folder: Path, target: Path, kind: str, options: argparse.Namespace, tell: Progress
) -> None:
    """Draw the diagram in a folder to a file, of a simulation with its attractors."""
    simulated = is_there(folder / "sweep.csv")
    diagram, scene, _ = _open(folder, systems_of(options.system))
    plot, model, membrane = _drawing_options(diagram, scene)
    chosen = _plot_choices(plot, diagram, options)
    if kind not in FORMATS:
        accepted = f"accepted are {', '.join(FORMATS)}, html"
        raise InputError(str(target), f"format {kind!r}", accepted)
    from ..plots.diagram import heading, plot_diagram, write_figure, write_heading

    tell("drawing")
    y = options.y or plot.y
    chosen |= {"unit": model.unit(chosen["x"]) if model else "", "labels": plot.labels}
    swept = None
    if simulated and model is not None and y == VELOCITY:
        from ..simulation.files import sweep_of

        swept = sweep_of(folder / "sweep.csv", model)
    if swept is not None and (swept.rows or not diagram.branches):
        from ..plots.attractors import plot_sweep

        if is_there(folder / "fractions.csv"):
            chosen["fractions"] = read_fractions(folder / "fractions.csv")[1]
        ax = plot_sweep(swept, diagram=diagram, **chosen)
        write_heading(ax.figure, heading(diagram))
    else:
        ax = plot_diagram(diagram, y=y, membrane=membrane, **chosen)
    drawn = [[row[chosen["x"]] for row in swept.rows]] if swept is not None else []
    _require_points(options, [*drawn, *(branch[chosen["x"]] for branch in diagram.branches)])
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
    from ..page.document import page_of_folder

    diagram, scene, manifest = _open(folder, systems_of(options.system) if options else {})
    plot, model, _ = _drawing_options(diagram, scene)
    chosen = _plot_choices(plot, diagram, options) if options else {}
    shown = PageView(plot.x, plot.xlim, plot.ylim, plot.unphysical, margin=plot.margin)
    if scene is not None:
        remarks = [] if manifest is None else remarks_in(manifest, diagram.coverage)
        remarks += simulation_remarks(folder)
        shown = dataclasses.replace(shown, source=scene.source, remarks=remarks)
    shown = dataclasses.replace(shown, **chosen)
    motions = motions_in(folder, diagram, model, tell) if model is not None else []
    if options and not motions:
        _require_points(options, [branch[chosen["x"]] for branch in diagram.branches])
    with reading(folder):
        text = page_of_folder(folder, diagram, model, shown, tell, motions)
    write(target, text)


def _open(
    folder: Path, systems: Mapping[str, type[Model]]
) -> tuple[Diagram, Scene | None, Mapping[str, Any] | None]:
    """The diagram in a folder, without branches of a simulation that followed none; its scene, and
    its manifest, None in a folder that was written from Python."""
    named = any((folder / name).exists() for name in ("manifest.json", "scene.toml"))
    if named and is_there(folder / "sweep.csv") and not is_there(folder / "catalogue.json"):
        with reading(folder) as manifest:
            scene = scene_in(folder, systems, manifest)
        _complain_of_simulation(folder)
        return Diagram(scene.name, []), scene, manifest
    found = open_results(folder)
    _complain_of_simulation(folder)
    _complain_of_end(folder, found.diagram.statistics.get("stopped"))
    if not named and found.diagram.branches:
        return found.diagram, None, None
    return found.diagram, scene_in(folder, systems, found.manifest), found.manifest


def _complain_of_simulation(folder: Path) -> None:
    """Say so if a simulation in a folder ended early."""
    for remark in simulation_remarks(folder):
        complain(f"{folder}: {remark}")


def _complain_of_end(folder: Path | str, stopped: str | None) -> None:
    """Say so if the run that results are from was stopped early."""
    if stopped:
        complain(f"{folder}: the run ended early ({stopped}): branches and events may be missing")


def _plot_choices(
    plot: PlotOptions, diagram: Diagram, options: argparse.Namespace
) -> dict[str, Any]:
    """Axis, limits and orbits to draw, as the command line has it or else the scene."""
    x = plot.x if options.x is None else options.x
    if diagram.branches:
        require_axis(diagram.branches, x, "-x", f"no column {x!r}")
    else:
        require_known(x, [plot.x], "-x", f"no column {x!r}")
    return {
        "x": x,
        "xlim": options.xlim or (plot.xlim if not options.x else None),
        "ylim": options.ylim or (plot.ylim if not options.y else None),
        "unphysical": plot.unphysical,
    }


def _require_points(options: argparse.Namespace, drawn: Sequence[Sequence[float]]) -> None:
    """Raise `InputError` if the limits asked for leave out all that is to be drawn."""
    spans = [(min(known), max(known)) for given in drawn if (known := [v for v in given if v == v])]
    low, high = options.xlim or (-math.inf, math.inf)
    if spans and not any(first <= high and last >= low for first, last in spans):
        first, last = min(first for first, _ in spans), max(last for _, last in spans)
        accepted = f"all that is to be drawn is from {first:.6g} to {last:.6g}"
        raise InputError("--xlim", f"found {low:g} to {high:g}", accepted)


def _drawing_options(
    diagram: Diagram, scene: Scene | None
) -> tuple[PlotOptions, Model | None, Membrane | None]:
    """How a diagram is drawn, the system, and the membranes that were named.

    They are those of the scene, or, in a folder that was written from Python, those that the
    branches name; None for a system of one's own.
    """
    if scene is not None:
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


def certify(options: argparse.Namespace) -> int:
    """Certify a folder, or a scene after running it; returns the exit status."""
    if importlib.util.find_spec("flint") is None:
        found = "python-flint, which proofs are made with, is not installed"
        raise InputError("certify", found, "pip install contimpact[certify]")
    target = Path(options.target)
    if target.is_dir():
        if options.output is not None:
            raise InputError("-o", "given with a folder", "its certificates are written into it")
        return _certify_or_verify(target, options)
    if options.verify:
        raise InputError(str(target), "no folder", "give the folder whose certificates to verify")
    return _run_scene(options) or _certify_or_verify(Path(options.output), options)


def _run_scene(options: argparse.Namespace) -> int:
    """Run the scene, as ``contimpact run`` does."""
    if options.output is None:
        raise InputError("-o", "missing", "give the folder to write to")
    from ..certificates.certify import enclosing_kernels
    from . import parser, run

    scene = load_scene(options.target)
    enclosing_kernels(Kernels(scene.model, scene.parameter))  # refused before anything is run
    flags = [*(["-q"] if options.quiet else []), *(["--no-plot"] if options.no_plot else [])]
    given = parser().parse_args(["run", *flags, f"-o{options.output}", "--", options.target])
    return run.command(given)


def _certify_or_verify(folder: Path, options: argparse.Namespace) -> int:
    from ..certificates.certify import (
        FILE,
        ROWS,
        certify_results,
        verify_results,
        write_certificates,
    )

    with telling(folder.name, options.quiet) as tell:
        if options.verify:
            results = open_results(folder)
            found = verify_results(results, progress=tell)
        else:
            with hold_folder(folder, (FILE, ROWS)):
                results = open_results(folder)
                try:
                    found = certify_results(results, settings_of(results), progress=tell, keep=True)
                except KeyboardInterrupt:
                    kept = folder / ROWS
                    if kept.exists():
                        complain(f"what was proven is in {kept}; the same command goes on from it")
                    raise
                write_certificates(results, found)
    _complain_of_end(folder, results.diagram.statistics.get("stopped"))
    if not options.quiet:
        for line in found.lines():
            say(line)
        done = "verified" if options.verify else f"written to {folder / FILE}"
        say(f"{done} in {found.seconds:.2f} s")
    if not found.certified:
        complain(f"{folder}: not everything is proven")
    return 0 if found.certified else 1


def settings_of(results: Results) -> CertifyOptions:
    """Return what the scene in a folder's manifest asks for; the defaults where there is none."""
    if results.manifest is None:
        return CertifyOptions()
    scene = scene_in(results.folder, manifest=results.manifest)
    return scene.certify or CertifyOptions(events=scene.events)


def scene_in(
    folder: Path,
    systems: Mapping[str, type[Model]] | None = None,
    manifest: Mapping[str, Any] | None = None,
) -> Scene:
    """Return the scene in a folder's manifest, which may have been read; without one, that of its
    scene file.

    Raises InputError if there is neither, or it is damaged.
    """
    path = folder / "manifest.json"
    if manifest is None:
        if not path.exists() and (folder / "scene.toml").exists():
            return load_scene(folder / "scene.toml", systems)
        manifest = read_json(path, MANIFEST, WANTED)
    try:
        return read_scene(manifest["scene"]["resolved"], systems)
    except InputError as error:
        if error.where == "model.system":
            raise InputError(str(path), error.found, error.accepted) from None
        found = f"its scene cannot be read: {error}"
        raise InputError(str(path), found, f"give {WANTED}") from None
    except (KeyError, TypeError):
        raise InputError(str(path), "damaged: it holds no scene", f"give {WANTED}") from None
