"""``contimpact run`` and ``simulate``: follow branches and simulate attractors, and write both."""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..bifurcations.declarations import EVENTS
from ..errors import InputError, NotWrittenError, count_text
from ..progress import Progress, telling
from ..results.branch import Branch
from ..results.catalogue import diagram_files
from ..results.curve import fixed_text, regions
from ..results.diagram import INTERRUPTED, Diagram
from ..results.diagram_reading import read
from ..results.result_folder import ROWS, TABLES, Files, hold_folder, renew_folder
from ..results.scene import Scene, folder_of, load_scene, require_own_folders, systems_of
from ..segments.compiling import mode
from ..storage import write_all
from . import complain, say
from .console import (
    Interruption,
    add_page,
    defer_interruptions,
    draw_pictures,
    page_wanted,
    write_manifest,
)

if TYPE_CHECKING:
    from ..diagrams.scene_simulation import Simulation


def command(options: argparse.Namespace) -> int:
    """Follow the branches of scenes; returns the exit status, the highest of theirs."""
    mode()  # refused before anything is computed
    jobs, status = _validate_scenes(options)
    for number, job in enumerate(jobs, start=1):
        own, interrupted = _attempt(job, options)
        status = max(status, own)
        if interrupted:
            if left := [each.scene.name for each in jobs[number:]]:
                complain(f"not run: {', '.join(left)}")
            break
    return status


@dataclass(frozen=True)
class _Job:
    """A scene to be run: where it is written to, and what messages about it begin with."""

    scene: Scene
    target: Path
    title: str
    prefix: str = ""

    def complain(self, message: object) -> None:
        complain(f"{self.prefix}{message}")


def _validate_scenes(options: argparse.Namespace) -> tuple[list[_Job], int]:
    """The scenes that can be run, and the exit status of the others; one alone is raised."""
    paths, status = options.scenes, 0
    systems = systems_of(options.system)
    scenes: list[tuple[str, Scene]] = []
    for path in paths:
        try:
            scenes.append((path, load_scene(path, systems)))
        except InputError as error:
            if len(paths) == 1:
                raise
            complain(error if error.where == path else f"{path}: {error}")
            status = 2
    require_own_folders([scene.name for _, scene in scenes])
    if len(paths) == 1:
        return [_Job(scene, Path(options.output), scene.name) for _, scene in scenes], status
    jobs = []
    for number, (path, scene) in enumerate(scenes, start=1):
        title = f"{scene.name} ({number} of {len(scenes)})"
        jobs.append(_Job(scene, Path(options.output) / folder_of(scene.name), title, f"{path}: "))
    return jobs, status


def _attempt(job: _Job, options: argparse.Namespace) -> tuple[int, bool]:
    """Run one scene; returns its exit status, and whether the keyboard has interrupted."""
    interruption = Interruption()
    try:
        failure = _run_one(job, options, interruption)
    except _NothingComputedError as error:
        job.complain(f"{error}; nothing was computed or written")
        failure = str(error)
    except NotWrittenError as error:
        job.complain(error)
        failure = str(error)
    except InputError as error:
        job.complain(error)
        return 2, interruption.happened
    except KeyboardInterrupt:
        interruption.happened, failure = True, INTERRUPTED
        job.complain(failure)
    return (1 if failure else 0), interruption.happened


class _NothingComputedError(Exception):
    """A run ended before it had a branch."""


def _run_one(job: _Job, options: argparse.Namespace, interruption: Interruption) -> str | None:
    """Compute and write one scene; returns what ended it early, if something did."""
    from ..diagrams import explore

    began = time.perf_counter()
    scene = job.scene
    with (
        telling(job.title, options.quiet) as tell,
        hold_folder(job.target, *_written_files(scene, options)) as folder,
    ):
        diagram = explore.follow(scene, tell)
        failure: str | None = diagram.statistics["failure"]
        interruption.happened = failure == INTERRUPTED
        if failure and not diagram.branches:
            raise _NothingComputedError(failure)
        with defer_interruptions(interruption):
            _write_run(scene, diagram, folder, options, began, tell, interruption)
    failure = INTERRUPTED if interruption.happened else failure
    if not options.quiet:
        _summary(scene, diagram, options.ghosts)
        say(f"written to {folder} in {time.perf_counter() - began:.2f} s")
    if failure:
        stopped = diagram.statistics.get("stopped") if failure == INTERRUPTED else None
        at = f" ({stopped})" if stopped else ""
        job.complain(f"{failure}{at}; what was computed is in {folder}")
    return failure


def _write_run(
    scene: Scene,
    diagram: Diagram,
    folder: Path,
    options: argparse.Namespace,
    began: float,
    tell: Progress,
    interruption: Interruption,
) -> None:
    """Write everything a run leaves behind, the catalogue first and the manifest last.

    An interruption leaves pictures out.
    """
    left_out, seconds = scene.left_out(), dict(diagram.statistics["seconds"])
    with renew_folder(folder, ["run"], scene.resolved()) as kept:
        files = Files(folder, kept)
        export = time.perf_counter()
        tell("writing tables")
        files.add(lambda: write_all(folder, diagram_files(diagram)))
        seconds["export"] = time.perf_counter() - export
        if options.no_plot:
            left_out.append("diagram: --no-plot was given, matplotlib is not imported")
        pictures: dict[str, Callable[[], None]] = {}
        if page_wanted(scene, options):
            pictures["page"] = lambda: add_page(scene, diagram, files, tell)
        if scene.plot.formats and not options.no_plot:
            pictures["plot"] = lambda: _save_plots(scene, diagram, files)
        modules = {"plot": "..plots.diagram"}
        for name, draw in pictures.items():
            drawing = time.perf_counter()
            if not draw_pictures(interruption, files, tell, draw, modules.get(name, "")):
                what, how = ("page", "plot --html") if name == "page" else ("diagram", "plot")
                left_out.append(f"{what}: {INTERRUPTED}; contimpact {how} draws it")
            seconds[name] = time.perf_counter() - drawing
        seconds["total"] = time.perf_counter() - began
        failure = INTERRUPTED if interruption.happened else diagram.statistics["failure"]
        statistics = {**diagram.statistics, "seconds": seconds, "failure": failure}
        write_manifest(scene, files, left_out, statistics)


def _written_files(scene: Scene, options: argparse.Namespace) -> tuple[list[str], list[str]]:
    """The files and folders a run writes, branches and curves left out."""
    files = ["manifest.json", "catalogue.json", "events.csv"]
    folders = ["branches"]
    formats = () if options.no_plot else scene.plot.formats
    files += [f"diagram.{kind}" for kind in formats]
    files += ["diagram.html"] if page_wanted(scene, options) else []
    if scene.curves is not None:
        folders.append("curves")
        files += [f"curves.{kind}" for kind in formats]
        if scene.curves.third is not None:
            files += [f"codim2.{kind}" for kind in formats]
    return files, folders


def _save_plots(scene: Scene, diagram: Diagram, files: Files) -> None:
    from ..plots.diagram import save_diagram

    plot = scene.plot
    names = (*scene.model.values, *scene.model.DERIVED)
    units = {name: scene.model.unit(name) for name in names}
    if points := diagram.codim2_curves:
        from ..plots.curves import save_codim2

        files.add(lambda: save_codim2(points, files.folder, plot.formats, units))
    if diagram.curves:
        from ..plots.curves import save_curves

        files.add(
            lambda: save_curves(
                diagram.curves, files.folder, plot.formats, diagram.checks, units, diagram.areas
            )
        )
    own = diagram.at(scene.model.values)
    look: dict[str, Any] = dataclasses.asdict(plot)
    formats, unit = look.pop("formats"), scene.model.unit(plot.x)
    del look["html"]
    look |= {"unit": unit, "membrane": scene.energy}
    files.add(lambda: save_diagram(own, files.folder, formats, **look))


def _summary(scene: Scene, diagram: Diagram, ghosts: bool) -> None:
    """Print what can be observed where, then the branches, then what two parameters say."""
    reading = read(diagram)
    say(str(reading))
    unasked = [kind for kind in EVENTS if kind not in scene.events]
    if unasked and any(None in interval.bounds for interval in reading.stable):
        say(f"where a status changes at no event: detect.events without {', '.join(unasked)}")
    for branch in diagram.branches:
        say_branch(branch, scene.model.DERIVED[:1], ghosts, reading.places.get(branch.id, ""))
    if not ghosts and any(entry.ghost for entry in diagram.entries):
        say("ghosts are events of orbits that are not observable there; --ghosts lists them, too")
    for curve in (*diagram.curves, *diagram.codim2_curves):
        say(fixed_text(curve.fixed) + repr(curve))
    if diagram.curves and not diagram.areas:
        for region in regions(diagram.curves, checks=diagram.checks):
            say(
                f"first as {region.along} falls: {fixed_text(region.fixed)}{region.notation}"
                + (f" ({region.branch})" if region.branch else "")
                + f": {region.first} for "
                f"{region.second} from {region.low:.9g} to {region.high:.9g}"
                + (f"  ({region.said})" if region.said else "")
            )
    for covered in diagram.coverage:
        say(f"covered: {covered.place}{covered}")
    for area in diagram.areas:
        say(f"area: {area}")
    for note in diagram.statistics["notes"]:
        say(note)


def say_branch(branch: Branch, derived: Sequence[str], ghosts: bool, place: str = "") -> None:
    """Print a branch with its ends and events, of which ghosts may be only counted; `place` says
    where it is."""
    values = branch[branch.parameter]
    say(
        f"{branch.id}  {branch.notation:8} {count_text(len(branch), 'point')}, "
        f"{branch.parameter} from {values.min():.6g} to {values.max():.6g}{place}"
    )
    for end in dict.fromkeys(end.message for end in branch.ends):
        say(f"      {end}")
    hidden = Counter[str]()
    for entry in branch.events:
        if entry.ghost and not ghosts:
            hidden[entry.kind] += 1
            continue
        others = "".join(f", {name} = {entry.parameters[name]:.12g}" for name in derived)
        say(
            f"  {entry.id:4} {entry.label:16} {entry.parameter} = {entry.value:.12g}{others}"
            f"  (error {entry.error:.0e})"
        )
    if hidden:
        say(f"      ghosts: {', '.join(f'{count} {kind}' for kind, count in hidden.items())}")
    for text in branch.missed:
        say(f"  not located: {text}")
    for text in branch.notes:
        say(f"  note: {text}")


# ``contimpact simulate``: simulate a scene's attractors.


def simulate(options: argparse.Namespace) -> int:
    """Simulate a scene; returns the exit status."""
    from ..diagrams.scene_simulation import simulate as compute

    mode()  # refused before anything is computed
    began = time.perf_counter()
    scene = load_scene(options.scene, systems_of(options.system))
    if scene.simulate is None:
        raise InputError(options.scene, "no table [simulate]", "add one, see the scene format")
    interruption = Interruption()
    with (
        telling(scene.name, options.quiet) as tell,
        hold_folder(options.output, folders=TABLES) as folder,
    ):

        def write(result: Simulation) -> None:
            """Write what there is; an interruption ends the drawing, and then what comes after."""
            with defer_interruptions(interruption):
                _write_simulation(result, folder, options, began, tell, interruption)
            if interruption.happened and not ended:
                raise KeyboardInterrupt

        ended = False
        result = compute(scene, folder, resume=options.resume, progress=tell, show=write)
        ended, interruption.happened = True, False
        write(result)
    if not options.quiet:
        _report_simulation(result, folder)
    if result.interrupted:
        place = (result.stopped or "").removeprefix(f"{result.interrupted}: ")
        complain(
            f"interrupted ({result.interrupted}){place and f': {place}'}; what was done is written "
            f"to {folder}; --resume continues"
        )
        return 1
    return 0


def _write_simulation(
    result: Simulation,
    folder: Path,
    options: argparse.Namespace,
    began: float,
    tell: Progress,
    interruption: Interruption,
) -> None:
    """Write everything a simulation leaves behind, the manifest last.

    An interruption meanwhile leaves pictures out.
    """
    from ..diagrams.scene_simulation import write_simulation

    scene, left_out = result.scene, result.scene.left_out(simulated=True)
    if scene.simulate is not None and not scene.simulate.branches:
        left_out.append("branches: simulate.branches is false")
    commands = ["simulate"] if result.diagram is None else ["simulate", "run"]
    with renew_folder(folder, commands, scene.resolved()) as kept:
        files = Files(folder, kept)
        tell("writing tables")
        files.add(lambda: write_simulation(result, folder))
        files.note(ROWS, result.lost)
        if interruption.happened:
            result.interrupted = result.interrupted or "writing"
        if page_wanted(scene, options):
            diagram = result.diagram or Diagram(scene.name, [])
            if not draw_pictures(
                interruption, files, tell, lambda: add_page(scene, diagram, files, tell)
            ):
                result.interrupted = result.interrupted or "pictures"
                left_out.append("page: the run was interrupted; contimpact plot --html draws it")
        if options.no_plot or not scene.plot.formats:
            left_out.append("pictures: not asked for, matplotlib is not imported")
        elif not result.sweep.rows:
            left_out.append("pictures: the run was interrupted before the sweep")
        else:
            drawing = time.perf_counter()

            def draw() -> None:
                from ..plots.attractors import save_simulation

                files.add(lambda: save_simulation(result, folder, scene.plot))

            if not draw_pictures(interruption, files, tell, draw, "..plots.attractors"):
                result.interrupted = result.interrupted or "pictures"
                left_out.append("pictures: the run was interrupted")
            result.seconds["plot"] = time.perf_counter() - drawing
        result.seconds["total"] = time.perf_counter() - began
        names = ("seconds", "counts", "notes", "interrupted", "stopped", "resumed")
        statistics = {name: getattr(result, name) for name in names}
        write_manifest(scene, files, left_out, statistics)


def _report_simulation(result: Simulation, folder: Path) -> None:
    """Say what was found."""
    say(repr(result.sweep))
    for transition in result.transitions:
        for line in transition.lines(result.scene.parameter):
            say(line)
    if wide := sum(t.wide is not None for t in result.transitions):
        brackets = count_text(len(result.transitions), "bracket")
        say(f"{wide} of {brackets} {'is' if wide == 1 else 'are'} wider than simulate.width")
    for crisis in result.crises:
        say(f"  {crisis}")
    if result.coverage is not None:
        lie = count_text(len(result.coverage.matches), "attractor lies", "attractors lie")
        say(f"{lie} on branches")
        for u in result.coverage.uncovered:
            say(f"  {u.count} of {u.notation} from {u.low:.6g} to {u.high:.6g}: {u.why}")
    for basin in result.basins:
        shares = zip(basin.attractors, basin.shares, strict=True)
        parts = ", ".join(f"{a.notation} {share:.1%}" for a, share in shares)
        value = basin.parameters[result.scene.parameter]
        say(f"basins at {result.scene.parameter} = {value:.6g}: {parts}")
    if result.fractions is not None:
        say(repr(result.fractions))
    for note in result.notes:
        say(note)
    say(f"written to {folder} in {result.seconds['total']:.2f} s")
