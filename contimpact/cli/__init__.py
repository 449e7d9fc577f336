"""The command line: ``contimpact new``, ``check``, ``run``, ``simulate``, ``plot`` and the rest.

Exit status: 0 on success, 2 on input that cannot be used (one message on standard error), 1 on a
computation that failed; what was computed is written all the same. Each command has a module of its
own, imported when the command is given.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import os
import sys
from collections.abc import Sequence
from typing import Any

from .. import __version__
from ..errors import InputError, NotWrittenError, each_once
from .examples import add_examples
from .terminal import complain, raise_on_termination, say


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
                say(f"contimpact: {error.strerror or error}", sys.stderr)
        return 1


def _status(arguments: Sequence[str] | None) -> int:
    options = parser().parse_args(arguments)
    try:
        for name, given in vars(options).items():
            if isinstance(given, list) and name not in ("xlim", "ylim"):
                setattr(options, name, each_once(given, name))
        with raise_on_termination():
            return int(importlib.import_module(f"{__name__}.{options.module}").command(options))
    except InputError as error:
        complain(error)
        return 1 if isinstance(error, NotWrittenError) else 2
    except KeyboardInterrupt:
        complain("interrupted")
        return 1


def _close_output() -> None:
    """Discard what is still buffered, so that the interpreter does not try to write it again."""
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="contimpact",
        description="Continuation of periodic orbits in impacting systems, ghosts included.",
    )
    parser.add_argument("--version", action="version", version=f"contimpact {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    check = commands.add_parser("check", help="validate a scene and say what would run")
    check.add_argument("scene", metavar="SCENE", help="a scene file (TOML)")
    check.set_defaults(module="check")

    new = commands.add_parser("new", help="print a commented scene of a system to start from")
    new.add_argument("kind", metavar="SYSTEM", help="its name, as contimpact systems lists them")
    new.set_defaults(module="new")

    systems = commands.add_parser("systems", help="list the systems that scenes can name")
    systems.set_defaults(module="new", kind=None)

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
    run.add_argument(
        "--ghosts", action="store_true", help="list the events that are ghosts, not only count them"
    )
    run.add_argument("--no-plot", action="store_true", help="leave the diagram out")
    run.add_argument("--html", action="store_true", help="also write the page diagram.html")
    run.set_defaults(module="run")

    simulate = commands.add_parser("simulate", help="simulate a scene's attractors")
    simulate.add_argument("scene", metavar="SCENE", help="a scene file (TOML) with [simulate]")
    simulate.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write to")
    simulate.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    simulate.add_argument("--no-plot", action="store_true", help="leave pictures out")
    simulate.add_argument("--html", action="store_true", help="also write the page diagram.html")
    simulate.add_argument(
        "--resume", action="store_true", help="continue what an interrupted run has left in DIR"
    )
    simulate.set_defaults(module="simulate")

    report = commands.add_parser("report", help="measure error against run time for a scene")
    report.add_argument("scene", metavar="SCENE", help="a scene file (TOML)")
    report.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write to")
    report.add_argument(
        "-n", "--repetitions", metavar="N", type=int, default=5, help="of each timing (default 5)"
    )
    report.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    report.add_argument("--no-plot", action="store_true", help="leave the plots out")
    report.set_defaults(module="report")

    certify = commands.add_parser("certify", help="prove what a catalogue says")
    certify.add_argument(
        "target", metavar="SCENE|DIR", help="a scene file (TOML) to run first, or a folder"
    )
    certify.add_argument("-o", "--output", metavar="DIR", help="folder to write to, with a scene")
    certify.add_argument(
        "--verify", action="store_true", help="repeat the proofs that are stored in DIR"
    )
    certify.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    certify.add_argument("--no-plot", action="store_true", help="leave the diagram out")
    certify.set_defaults(module="certify")

    merge = commands.add_parser("catalogue", help="merge the catalogues of several folders")
    merge.add_argument("folders", metavar="DIR", nargs="+", help="folders written by run")
    merge.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write to")
    merge.set_defaults(module="merge")

    study = commands.add_parser("study", help="compute the scenes of a study into a store")
    study.add_argument("study", metavar="STUDY", help="a study file (TOML)")
    study.add_argument(
        "-o", "--output", metavar="STORE", required=True, help="store to write to, or to continue"
    )
    study.add_argument(
        "-w", "--workers", metavar="N", type=int, help="processes (default all cores)"
    )
    study.add_argument(
        "--scheduler", metavar="ADDRESS", help="compute on a Dask scheduler's workers"
    )
    study.add_argument("--mpi", action="store_true", help="compute on the processes of an MPI run")
    study.add_argument("--again", action="store_true", help="try scenes again that have failed")
    study.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    study.set_defaults(module="study")

    export = commands.add_parser("export", help="write the tables of a store as files")
    export.add_argument("store", metavar="STORE", help="a store written by study")
    export.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write to")
    export.add_argument(
        "--format",
        choices=("csv", "csv.gz", "json", "parquet"),
        default="csv",
        help="of the files (default csv)",
    )
    export.add_argument("--study", metavar="NAME", action="append", help="these studies alone")
    export.add_argument("--table", metavar="NAME", action="append", help="these tables alone")
    columns: dict[str, Any] = {"metavar": "A,B,...", "type": lambda text: text.split(",")}
    export.add_argument("--columns", help="these columns alone", **columns)
    export.add_argument("--digits", metavar="N", type=int, help="significant digits (default all)")
    export.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    export.set_defaults(module="export")

    atlas = commands.add_parser("atlas", help="draw maps of studies over two of their axes")
    atlas.add_argument("store", metavar="STORE", help="a store written by study")
    atlas.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write to")
    atlas.add_argument("--study", metavar="NAME", action="append", help="of these studies alone")
    atlas.add_argument("--quantity", metavar="NAME", action="append", help="these alone")
    atlas.add_argument("--axes", nargs=2, metavar=("X", "Y"), help="default: the study's first two")
    atlas.add_argument("--orbit", metavar="N:M", default="1:1", help="of this orbit (default 1:1)")
    atlas.add_argument(
        "--at", metavar="NAME=VALUE", action="append", default=[], help="value of another axis"
    )
    atlas.add_argument(
        "--format", action="append", choices=("png", "svg", "pdf"), help="of the maps (default png)"
    )
    atlas.add_argument("--no-plot", action="store_true", help="write the tables alone")
    atlas.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    atlas.set_defaults(module="atlas")

    plot = commands.add_parser("plot", help="draw a folder's diagram, with its attractors")
    plot.add_argument("folder", metavar="DIR", help="folder written by run or simulate")
    plot.add_argument(
        "-o", "--output", metavar="FILE", help="file to write (svg, png, pdf or html)"
    )
    plot.add_argument("--html", action="store_true", help="write the page: DIR/diagram.html")
    plot.add_argument(
        "-x", metavar="NAME", help="parameter on the x axis, otherwise the one in the scene"
    )
    plot.add_argument(
        "-y", metavar="NAME", help="quantity on the y axis, such as multipliers, or a column"
    )
    limits: dict[str, Any] = {"nargs": 2, "type": float, "metavar": ("LOW", "HIGH")}
    plot.add_argument("--xlim", help="limits of the x axis", **limits)
    plot.add_argument("--ylim", help="limits of the y axis", **limits)
    plot.set_defaults(module="plot")

    view = commands.add_parser("view", help="open the page of a folder in the browser")
    view.add_argument("folder", metavar="DIR", help="folder written by run or simulate")
    view.set_defaults(module="view")

    range_ = commands.add_parser("range", help="say which attractors there are, and where they end")
    range_.add_argument("folder", metavar="DIR", help="folder written by run or simulate")
    range_.add_argument(
        "--at",
        metavar="VALUE",
        type=float,
        action="append",
        default=[],
        help="of the followed parameter: the attractors there, and how far their ends are",
    )
    range_.add_argument("-o", "--output", metavar="FILE", help="file to write as a table (csv)")
    range_.set_defaults(module="range")

    fit = commands.add_parser("fit", help="estimate parameters from measured impacts")
    fit.add_argument("scene", metavar="SCENE", help="a scene file (TOML) with starting values")
    fit.add_argument("data", metavar="CSV", help="columns time, velocity, wall, or some of them")
    fit.add_argument(
        "--parameter", metavar="NAME", action="append", required=True, help="to estimate"
    )
    fit.add_argument("--orbit", metavar="WORD", action="append", help="default: the scene's")
    fit.add_argument(
        "--deviation",
        metavar="NAME=VALUE",
        action="append",
        default=[],
        help="standard deviation of a time, or of a velocity (default: from the residuals)",
    )
    fit.add_argument("--no-clock", action="store_true", help="times are those of the model's clock")
    fit.add_argument("-o", "--output", metavar="FILE", help="picture of the residuals to write")
    fit.set_defaults(module="fit")

    design = commands.add_parser("design", help="maximise an output at a margin from bifurcations")
    design.add_argument("scene", metavar="SCENE", help="a scene file (TOML) with [design]")
    design.add_argument("-o", "--output", metavar="FILE", help="file to write as a table (csv)")
    design.set_defaults(module="design")

    completion = commands.add_parser("completion", help="print the completion of a shell")
    completion.add_argument("shell", choices=["bash", "zsh", "fish"], help="the shell")
    completion.set_defaults(module="completion")
    for command in (check, run, simulate, report, plot, range_, fit, design):
        command.add_argument(
            "--system",
            metavar="FILE",
            action="append",
            default=[],
            help="Python file that defines a system of your own; may be given several times",
        )
    return add_examples(parser)
