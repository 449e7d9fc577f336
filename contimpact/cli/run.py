"""``contimpact run``: follow the branches of scenes and write the results."""

from __future__ import annotations

import argparse
import dataclasses
import sys
import time
from pathlib import Path

from .. import explore
from ..catalogue import diagram_files
from ..compiled import mode
from ..diagram import Diagram
from ..errors import InputError, NotWrittenError
from ..files import write_all
from ..reading import read
from ..result_folder import Files, held, renewed
from ..scene import Scene, load_scene
from .console import progress, require_output, uninterrupted
from .manifest import write_manifest


def command(options: argparse.Namespace) -> int:
    """Follow the branches of scenes; returns the exit status."""
    mode()  # refused before anything is computed
    scenes = [load_scene(path) for path in options.scenes]
    names = [scene.name for scene in scenes]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError("SCENE", f"two scenes are called {twice!r}", "give each its own name")
    require_output(options)
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


def _run_one(scene: Scene, target: Path, options: argparse.Namespace) -> str | None:
    """Compute and write one scene; returns what ended it early, if something did."""
    began = time.perf_counter()
    tell = progress(options.quiet)
    with held(target, *_written(scene, options)) as folder:
        try:
            diagram = explore.follow(scene, tell)
        finally:
            tell("")
        failure: str | None = diagram.statistics["failure"]
        if failure and not diagram.branches:
            raise _NothingComputedError(failure)
        with uninterrupted():
            _write_run(scene, diagram, folder, options, began)
    if failure:
        print(f"contimpact: {failure}; what was computed is in {folder}", file=sys.stderr)
    return failure


def _write_run(
    scene: Scene, diagram: Diagram, folder: Path, options: argparse.Namespace, began: float
) -> None:
    """Write everything a run leaves behind, the catalogue first and the manifest last."""
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
        write_manifest(scene, files, left_out, statistics)
    if not options.quiet:
        _summary(scene, diagram, folder, seconds["total"])


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
    from ..plots.diagram import save_diagram

    plot = scene.plot
    if diagram.curves:
        from ..plots.curves import save_curves

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


def _summary(scene: Scene, diagram: Diagram, folder: Path, total: float) -> None:
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
        from ..two_parameters.competition import regions

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
