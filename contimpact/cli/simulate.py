"""``contimpact simulate``: simulate a scene's attractors."""

from __future__ import annotations

import argparse
import time
from functools import partial
from pathlib import Path

from ..diagrams.scene_simulation import Simulation, simulate, write_simulation
from ..errors import InputError
from ..progress import Progress, telling
from ..results.diagram import Diagram
from ..results.result_folder import ROWS, TABLES, Files, hold_folder, renew_folder
from ..results.scene import load_scene, systems_of
from ..segments.compiling import mode
from . import complain, say
from .console import (
    Interruption,
    add_page,
    defer_interruptions,
    draw_pictures,
    page_wanted,
    write_manifest,
)


def command(options: argparse.Namespace) -> int:
    """Simulate a scene; returns the exit status."""
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
                _write(result, folder, options, began, tell, interruption)
            if interruption.happened and not ended:
                raise KeyboardInterrupt

        ended = False
        result = simulate(scene, folder, resume=options.resume, progress=tell, show=write)
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


def _write(
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
            draw = partial(_save_pictures, result, files)
            if not draw_pictures(interruption, files, tell, draw, "..plots.attractors"):
                result.interrupted = result.interrupted or "pictures"
                left_out.append("pictures: the run was interrupted")
            result.seconds["plot"] = time.perf_counter() - drawing
        result.seconds["total"] = time.perf_counter() - began
        names = ("seconds", "counts", "notes", "interrupted", "stopped", "resumed")
        statistics = {name: getattr(result, name) for name in names}
        write_manifest(scene, files, left_out, statistics)


def _save_pictures(result: Simulation, files: Files) -> None:
    from ..plots.attractors import save_simulation

    files.add(lambda: save_simulation(result, files.folder, result.scene.plot))


def _report_simulation(result: Simulation, folder: Path) -> None:
    """Say what was found."""
    say(repr(result.sweep))
    for transition in result.transitions:
        for line in transition.lines(result.scene.parameter):
            say(line)
    if wide := sum(t.wide is not None for t in result.transitions):
        say(f"{wide} of {len(result.transitions)} brackets are wider than simulate.width")
    for crisis in result.crises:
        say(f"  {crisis}")
    if result.coverage is not None:
        say(f"{len(result.coverage.matches)} attractors lie on branches")
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
