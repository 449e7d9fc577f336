"""``contimpact simulate``: simulate a scene's attractors."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from ..attractors.simulation import Simulation, simulate, write_simulation
from ..compiled import mode
from ..errors import InputError
from ..result_folder import ROWS, TABLES, Files, held, renewed
from ..scene import load_scene
from .console import progress
from .manifest import write_manifest


def command(options: argparse.Namespace) -> int:
    """Simulate a scene; returns the exit status."""
    mode()  # refused before anything is computed
    began = time.perf_counter()
    scene = load_scene(options.scene)
    if scene.simulate is None:
        raise InputError(options.scene, "no table [simulate]", "add one, see the scene format")
    with held(options.output, folders=TABLES) as folder:
        result = simulate(scene, folder, resume=options.resume, progress=progress(options.quiet))
        _write(result, folder, options, began)
    if not options.quiet:
        _simulated(result, folder)
    if result.interrupted:
        print(
            f"contimpact: interrupted ({result.interrupted}); what was done is written to "
            f"{folder}, go on with --resume", file=sys.stderr,
        )  # fmt: skip
        return 1
    return 0


def _write(result: Simulation, folder: Path, options: argparse.Namespace, began: float) -> None:
    """Write everything a simulation leaves behind, the manifest last."""
    scene, left_out = result.scene, result.scene.left_out(simulated=True)
    if scene.simulate is not None and not scene.simulate.branches:
        left_out.append("branches: simulate.branches is false")
    commands = ["simulate"] if result.diagram is None else ["simulate", "run"]
    with renewed(folder, commands, scene.resolved()) as kept:
        files = Files(folder, kept)
        files.add(lambda: write_simulation(result, folder))
        files.note(ROWS, result.lost)
        _draw(result, files, options, left_out)
        result.seconds["total"] = time.perf_counter() - began
        statistics = {
            "seconds": result.seconds, "counts": result.counts,
            "interrupted": result.interrupted, "resumed": result.resumed,
        }  # fmt: skip
        write_manifest(scene, files, left_out, statistics)


def _draw(
    result: Simulation, files: Files, options: argparse.Namespace, left_out: list[str]
) -> None:
    plot = result.scene.plot
    if options.no_plot or not plot.formats or result.interrupted:
        why = "the run was interrupted" if result.interrupted else "not asked for"
        left_out.append(f"pictures: {why}, matplotlib is not imported")
        return
    from ..plots.attractors import save_simulation

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
