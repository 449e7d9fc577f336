"""The command line: ``contimpact check``, ``run``, ``simulate``, ``plot`` and ``catalogue``.

Exit status: 0 on success, 2 on input that cannot be used (one message on standard error), 1 on a
computation that failed; what was computed is written all the same.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from . import __version__
from .errors import InputError, NotWrittenError

if TYPE_CHECKING:
    from .attractors.simulation import Simulation
    from .diagram import Diagram
    from .result_folder import Files
    from .scene import CurveOptions, PlotOptions, Scene


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    try:
        try:
            return _status(arguments)
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except OSError as error:  # what is printed reaches nobody: a closed pipe, a full disk
        _close_output()
        if not isinstance(error, BrokenPipeError):
            with contextlib.suppress(OSError):
                print(f"contimpact: {error.strerror or error}", file=sys.stderr)
        return 1


def _status(arguments: Sequence[str] | None) -> int:
    options = _parser().parse_args(arguments)
    try:
        return int(options.command(options))
    except InputError as error:
        print(f"contimpact: {error}", file=sys.stderr)
        return 1 if isinstance(error, NotWrittenError) else 2
    except KeyboardInterrupt:
        print("contimpact: interrupted", file=sys.stderr)
        return 1


def _close_output() -> None:
    """Send what is still buffered nowhere, so that the interpreter does not try it again."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="contimpact",
        description="Continuation of periodic orbits in impacting systems, ghosts included.",
    )
    parser.add_argument("--version", action="version", version=f"contimpact {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    check = commands.add_parser("check", help="validate a scene and say what would run")
    check.add_argument("scene", metavar="SCENE", help="a scene file (TOML)")
    check.set_defaults(command=_check)

    run = commands.add_parser("run", help="follow the branches of scenes and write the results")
    run.add_argument("scenes", metavar="SCENE", nargs="+", help="scene files (TOML)")
    run.add_argument(
        "-o",
        "--output",
        metavar="DIR",
        required=True,
        help="folder to write to; with several scenes, each has a folder of its name in it",
    )
    run.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    run.add_argument("--no-plot", action="store_true", help="leave the diagram out")
    run.set_defaults(command=_run)

    simulate = commands.add_parser("simulate", help="simulate a scene's attractors")
    simulate.add_argument("scene", metavar="SCENE", help="a scene file (TOML) with [simulate]")
    simulate.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write to")
    simulate.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    simulate.add_argument("--no-plot", action="store_true", help="leave pictures out")
    simulate.add_argument(
        "--resume", action="store_true", help="go on from what an interrupted run has left in DIR"
    )
    simulate.set_defaults(command=_simulate)

    report = commands.add_parser("report", help="measure error against run time for a scene")
    report.add_argument("scene", metavar="SCENE", help="a scene file (TOML)")
    report.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write to")
    report.add_argument(
        "-n", "--repetitions", metavar="N", type=int, default=5, help="of each timing (default 5)"
    )
    report.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    report.add_argument("--no-plot", action="store_true", help="leave the plots out")
    report.set_defaults(command=_report)

    merge = commands.add_parser("catalogue", help="merge the catalogues of several folders")
    merge.add_argument("folders", metavar="DIR", nargs="+", help="folders written by run")
    merge.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write to")
    merge.set_defaults(command=_catalogue)

    plot = commands.add_parser("plot", help="draw the diagram of a folder written by run")
    plot.add_argument("folder", metavar="DIR", help="folder written by run")
    plot.add_argument("-o", "--output", metavar="FILE", help="file to write (svg, png or pdf)")
    plot.add_argument("-x", metavar="NAME", help="parameter on the x axis")
    plot.add_argument("--xlim", nargs=2, type=float, metavar=("LOW", "HIGH"))
    plot.add_argument("--ylim", nargs=2, type=float, metavar=("LOW", "HIGH"))
    plot.set_defaults(command=_plot)
    return parser


def _check(options: argparse.Namespace) -> int:
    from .explore import orbits_at_start, placed
    from .mechanics.kernels import Kernels
    from .scene import load_scene

    scene = load_scene(options.scene)
    kernels = Kernels(scene.model, scene.parameter)
    letters = [w.name for w in scene.model.WALLS]
    try:
        derived = kernels.setup(*scene.model.values.values())[3 + len(letters) :]
    except InputError as error:
        raise placed(error, scene) from None
    print(f"scene {scene.name}: {scene.source}" if scene.source else f"scene {scene.name}")
    print(f"  model    {scene.model!r}")
    for name, value in zip(scene.model.DERIVED, derived, strict=False):
        print(f"           {name} = {value:.12g}")
    low, high = scene.range
    print(f"  follow   {scene.parameter} from {scene.start:.12g} within [{low:.12g}, {high:.12g}]")
    for word in scene.orbits:
        found = orbits_at_start(scene, kernels, word)
        unphysical = sum(not orbit.physical for orbit in found)
        print(
            f"  orbits   {word.notation(letters)} (word {word}): {len(found)} at the start"
            + (f", {unphysical} of them unphysical" if unphysical else "")
        )
    print(f"  events   {', '.join(scene.events) or 'none'}")
    for name, values in scene.values.items():
        print(f"           {name} = {', '.join(f'{v:.12g}' for v in values)}")
    if scene.curves is not None:
        print(f"  curves   {_curves_asked(scene.curves)}")
    for text in scene.left_out():
        print(f"  left out {text}")
    return 0


def _curves_asked(curves: CurveOptions) -> str:
    low, high = curves.range
    text = f"{', '.join(curves.kinds)} in {curves.parameter} within [{low:.12g}, {high:.12g}]"
    if curves.family is None:
        return text
    name, values = curves.family
    return f"{text}, for {name} = {', '.join(f'{v:.6g}' for v in values)}"


def _run(options: argparse.Namespace) -> int:
    from .compiled import mode
    from .scene import load_scene

    mode()  # refused before anything is computed
    scenes = [load_scene(path) for path in options.scenes]
    names = [scene.name for scene in scenes]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError("SCENE", f"two scenes are called {twice!r}", "give each its own name")
    _require_output(options)
    status = 0
    for scene in scenes:
        target = Path(options.output) / (scene.name if len(names) > 1 else "")
        try:
            failure = _run_one(scene, target, options)
        except _NothingComputedError as error:
            failure = str(error)
            print(f"contimpact: {error}; nothing was computed or written", file=sys.stderr)
        except NotWrittenError as error:
            failure = str(error)
            print(f"contimpact: {error}", file=sys.stderr)
        status = max(status, 1 if failure else 0)
        if failure == "interrupted":
            break
    return status


class _NothingComputedError(Exception):
    """A run ended before it had a branch."""


def _require_output(options: argparse.Namespace) -> None:
    if not options.output:
        raise InputError("-o", "empty", "give the path of a folder")


def _run_one(scene: Scene, target: Path, options: argparse.Namespace) -> str | None:
    """Compute and write one scene; returns what ended it early, if something did."""
    began = time.perf_counter()
    progress = _progress(options.quiet)
    from .result_folder import held

    with held(target, *_written(scene, options)) as folder:
        from .explore import follow

        try:
            diagram = follow(scene, progress)
        finally:
            progress("")
        failure: str | None = diagram.statistics["failure"]
        if failure and not diagram.branches:
            raise _NothingComputedError(failure)
        with _uninterrupted():
            _write_run(scene, diagram, folder, options, began)
    if failure:
        print(f"contimpact: {failure}; what was computed is in {folder}", file=sys.stderr)
    return failure


def _write_run(
    scene: Scene, diagram: Diagram, folder: Path, options: argparse.Namespace, began: float
) -> None:
    """Write everything a run leaves behind, the catalogue first and the manifest last."""
    from .catalogue import diagram_files
    from .files import write_all
    from .result_folder import Files, renewed

    left_out, seconds = scene.left_out(), dict(diagram.statistics["seconds"])
    statistics = {**diagram.statistics, "seconds": seconds}
    with renewed(folder, ["run"], scene.resolved()) as kept:
        files = Files(folder, kept)
        export = time.perf_counter()
        files.add(lambda: write_all(folder, diagram_files(diagram)))
        seconds["export"] = time.perf_counter() - export
        if options.no_plot:
            left_out.append("diagram: --no-plot was given, matplotlib is not imported")
        elif scene.plot.formats:
            drawing = time.perf_counter()
            _save_plots(scene, diagram, files)
            seconds["plot"] = time.perf_counter() - drawing
        seconds["total"] = time.perf_counter() - began
        _close(scene, files, left_out, statistics)
    if not options.quiet:
        _summary(scene, diagram, folder, seconds["total"])


@contextlib.contextmanager
def _uninterrupted() -> Iterator[None]:
    """Put interruptions off until what was computed is on disk."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before if before is not None else signal.SIG_DFL)


def _simulate(options: argparse.Namespace) -> int:
    from .compiled import mode
    from .scene import load_scene

    mode()  # refused before anything is computed
    began = time.perf_counter()
    scene = load_scene(options.scene)
    if scene.simulate is None:
        raise InputError(options.scene, "no table [simulate]", "add one, see the scene format")
    from .attractors.simulation import simulate
    from .result_folder import TABLES, held

    with held(options.output, folders=TABLES) as folder:
        result = simulate(scene, folder, resume=options.resume, progress=_progress(options.quiet))
        _write_simulation(result, folder, options, began)
    if not options.quiet:
        _simulated(result, folder)
    if result.interrupted:
        print(
            f"contimpact: interrupted ({result.interrupted}); what was done is written to "
            f"{folder}, go on with --resume", file=sys.stderr,
        )  # fmt: skip
        return 1
    return 0


def _write_simulation(
    result: Simulation, folder: Path, options: argparse.Namespace, began: float
) -> None:
    """Write everything a simulation leaves behind, the manifest last."""
    from .attractors.simulation import write_simulation
    from .result_folder import ROWS, Files, renewed

    scene, left_out = result.scene, result.scene.left_out()
    commands = ["simulate"] if result.diagram is None else ["simulate", "run"]
    with renewed(folder, commands, scene.resolved()) as kept:
        files = Files(folder, kept)
        files.add(lambda: write_simulation(result, folder))
        files.note(ROWS, result.lost)
        _draw_simulation(result, files, options, left_out)
        result.seconds["total"] = time.perf_counter() - began
        statistics = {
            "seconds": result.seconds, "counts": result.counts,
            "interrupted": result.interrupted, "resumed": result.resumed,
        }  # fmt: skip
        _close(scene, files, left_out, statistics)


def _draw_simulation(
    result: Simulation, files: Files, options: argparse.Namespace, left_out: list[str]
) -> None:
    plot = result.scene.plot
    if options.no_plot or not plot.formats or result.interrupted:
        why = "the run was interrupted" if result.interrupted else "not asked for"
        left_out.append(f"pictures: {why}, matplotlib is not imported")
        return
    from .plots.attractors import save_simulation

    drawing = time.perf_counter()
    files.add(lambda: save_simulation(result, files.folder, plot))
    result.seconds["plot"] = time.perf_counter() - drawing


def _simulated(result: Simulation, folder: Path) -> None:
    """Say what was found."""
    print(repr(result.sweep))
    for transition in result.transitions:
        low, high = sorted((transition.before.value, transition.after.value))
        print(
            f"  {transition.label:24} {transition.direction:4} {result.scene.parameter} from "
            f"{low:.9g} to {high:.9g}"
        )
        for e in transition.explanations:
            print(f"      {e.role} {e.label} ({e.entry}) at {e.value:.12g}")
    if result.coverage is not None:
        print(f"{len(result.coverage.matches)} attractors lie on branches")
        for u in result.coverage.uncovered:
            print(f"  {u.count} of {u.notation} from {u.low:.6g} to {u.high:.6g}: {u.why}")
    for basin in result.basins:
        shares = zip(basin.attractors, basin.shares, strict=True)
        parts = ", ".join(f"{a.notation} {share:.1%}" for a, share in shares)
        value = basin.parameters[result.scene.parameter]
        print(f"basins at {result.scene.parameter} = {value:.6g}: {parts}")
    print(f"written to {folder} in {result.seconds['total']:.2f} s")


def _written(scene: Scene, options: argparse.Namespace) -> tuple[list[str], list[str]]:
    """The files and folders a run writes, branches and curves left out."""
    files = ["manifest.json", "catalogue.json", "events.csv"]
    folders = ["branches"]
    formats = () if options.no_plot else scene.plot.formats
    files += [f"diagram.{kind}" for kind in formats]
    if scene.curves is not None:
        folders.append("curves")
        files += [f"curves.{kind}" for kind in formats]
    return files, folders


def _save_plots(scene: Scene, diagram: Diagram, files: Files) -> None:
    from .plots.diagram import save_diagram

    plot = scene.plot
    if diagram.curves:
        from .plots.curves import save_curves

        files.add(lambda: save_curves(diagram.curves, files.folder, plot.formats))
    files.add(
        lambda: save_diagram(
            _own_member(scene, diagram), files.folder, plot.formats, x=plot.x, xlim=plot.xlim,
            ylim=plot.ylim, unphysical=plot.unphysical, unit=scene.model.unit(plot.x),
        )
    )  # fmt: skip


def _own_member(scene: Scene, diagram: Diagram) -> Diagram:
    """The diagram without the branches of other members of a family."""
    if scene.curves is None or scene.curves.family is None:
        return diagram
    name, _ = scene.curves.family
    own = [b for b in diagram.branches if b[name][0] == scene.model.values[name]]
    return dataclasses.replace(diagram, branches=own)


def _close(scene: Scene, files: Files, left_out: list[str], statistics: dict[str, Any]) -> None:
    """Write the manifest; what could not be written is said."""
    from .catalogue import manifest_text
    from .result_folder import sha256

    files.close(
        lambda: manifest_text(
            scene.resolved(), scene.given, left_out,
            {**statistics, "not_written": files.not_written()}, files.written,
            sha256(files.folder / "catalogue.json"),
        )
    )  # fmt: skip


def _summary(scene: Scene, diagram: Diagram, folder: Path, total: float) -> None:
    from .reading import read

    for branch in diagram.branches:
        values = branch[branch.parameter]
        print(
            f"{branch.id}  {branch.notation:8} {len(branch)} points, {branch.parameter} from "
            f"{values.min():.6g} to {values.max():.6g}"
        )
        for end in dict.fromkeys(end.message for end in branch.ends):
            print(f"      {end}")
        for entry in branch.events:
            derived = "".join(
                f", {n} = {entry.parameters[n]:.12g}" for n in scene.model.DERIVED[:1]
            )
            print(
                f"  {entry.id:4} {entry.label:16} {entry.parameter} = {entry.value:.12g}{derived}"
                f"  (error {entry.error:.0e})"
            )
        for text in branch.missed:
            print(f"  not located: {text}")
        for text in branch.notes:
            print(f"  note: {text}")
    if text := str(read(diagram)):
        print(text)
    for curve in diagram.curves:
        print("".join(f"{n} = {v:.6g}  " for n, v in curve.fixed.items()) + repr(curve))
    if diagram.curves:
        from .two_parameters.competition import regions

        along = "d" if "d" in diagram.curves[0].columns else diagram.curves[0].parameters[0]
        for region in regions(diagram.curves, along):
            fixed = "".join(f"{n} = {v:.6g}  " for n, v in region.fixed.items())
            print(
                f"first    {fixed}{region.notation}: {region.first} for {region.second} from "
                f"{region.low:.9g} to {region.high:.9g}"
            )
    for note in diagram.statistics["notes"]:
        print(note)
    print(f"written to {folder} in {total:.2f} s")


def _report(options: argparse.Namespace) -> int:
    from .accuracy.output import write_report
    from .accuracy.report import report
    from .result_folder import held
    from .scene import load_scene

    scene = load_scene(options.scene)
    progress = _progress(options.quiet)
    with held(options.output) as folder:
        data = report(scene, options.repetitions, progress)
        progress("")
        formats = () if options.no_plot else scene.plot.formats
        files = write_report(data, folder, formats)
    if not options.quiet:
        fair = data["honesty"]
        print(
            f"{fair['confirmed']} of {fair['events']} events confirmed in {data['digits']} digits, "
            f"{fair['within_estimate']} within their estimated error"
        )
        print(f"written to {folder}: {', '.join(files)}")
    return 0


def _catalogue(options: argparse.Namespace) -> int:
    from .merge import FILES, merge, write_merged
    from .result_folder import held

    _require_output(options)
    merged = merge(options.folders)
    with held(options.output, FILES) as folder:
        files = write_merged(merged, folder)
    count, scenes = len(merged["entries"]), len(merged["sources"])
    print(f"{count} entries of {scenes} scenes written to {folder}: {', '.join(files)}")
    return 0


def _plot(options: argparse.Namespace) -> int:
    from .catalogue import load_diagram
    from .scene import FORMATS

    folder = Path(options.folder)
    diagram = load_diagram(folder)
    plot, unit = _shown_as(folder, diagram)
    chosen: dict[str, Any] = {
        "x": options.x or plot.x,
        "xlim": options.xlim or (plot.xlim if not options.x else None),
        "ylim": options.ylim or plot.ylim,
        "unphysical": plot.unphysical,
    }
    numbers = ["arclength", *diagram.branches[0].parameters] if diagram.branches else []
    if chosen["x"] not in numbers:
        raise InputError("-x", f"no column {chosen['x']!r}", f"accepted are {', '.join(numbers)}")
    if options.output == "":
        raise InputError("-o", "empty", "give a file such as diagram.svg")
    target = Path(options.output) if options.output else folder / "diagram.png"
    kind = target.suffix.removeprefix(".").lower()
    if kind not in FORMATS:
        raise InputError(str(target), f"format {kind!r}", f"accepted are {', '.join(FORMATS)}")
    from .plots.diagram import plot_diagram, write_figure

    ax = plot_diagram(diagram, unit=unit(chosen["x"]), **chosen)
    write_figure(ax.figure, target, kind, diagram.name)
    print(f"written to {target}")
    return 0


def _shown_as(folder: Path, diagram: Diagram) -> tuple[PlotOptions, Callable[[str], str]]:
    """How a diagram is drawn, and the units of its parameters.

    They are those of the scene, or, in a folder that was written from Python, those of the system.
    """
    if (folder / "manifest.json").exists() or not diagram.branches:
        scene = _scene_of(folder)
        return scene.plot, scene.model.unit
    from .recovery import model_at
    from .scene import PlotOptions

    branch = diagram.branches[0]
    try:
        unit = model_at(branch, 0).unit
    except InputError:  # a system of one's own: its units are not known here

        def unit(name: str) -> str:
            return ""

    return PlotOptions(branch.parameter), unit


def _scene_of(folder: Path) -> Scene:
    """The scene in a folder's manifest."""
    from .result_folder import MANIFEST, read_json
    from .scene import read_scene

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


def _progress(quiet: bool) -> Callable[[str], None]:
    """One line on standard error, rewritten in place, if that is a terminal."""
    if quiet or not sys.stderr.isatty():
        return lambda text: None

    def show(text: str) -> None:
        sys.stderr.write(f"\r\x1b[K{text[:100]}")
        sys.stderr.flush()

    return show
