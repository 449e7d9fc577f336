"""The command line: ``contimpact new``, ``check``, ``run``, ``simulate``, ``plot`` and the rest.

Exit status: 0 on success, 2 on input that cannot be used (one message on standard error), 1 on a
computation that failed; what was computed is written all the same. A command is a function of a
module, which is imported when the command is given.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import os
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from .. import __version__
from ..errors import InputError, NotWrittenError, each_once
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
            module, _, name = options.function.partition(".")
            found = getattr(importlib.import_module(f"{__name__}.{module}"), name)
            return int(found(options))
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

    def add(name: str, function: str, help: str, example: str) -> argparse.ArgumentParser:
        """A command, the function that it calls, and an example that ends its help."""
        raw = argparse.RawDescriptionHelpFormatter
        found = commands.add_parser(
            name, help=help, epilog=f"example:\n  {example}", formatter_class=raw
        )
        found.set_defaults(function=function)
        return found

    check = add(
        "check",
        "check.command",
        "validate a scene and say what would run",
        "contimpact check branches/fig7/scene.toml",
    )
    check.add_argument("scene", metavar="SCENE", help="a scene file (TOML)")

    new = add(
        "new",
        "scenes.new",
        "print a commented scene of a system to start from",
        "contimpact new impact-pair",
    )
    new.add_argument("kind", metavar="SYSTEM", help="its name, as contimpact systems lists them")

    systems = add(
        "systems",
        "scenes.new",
        "list the systems that scenes can name",
        "contimpact systems",
    )
    systems.set_defaults(kind=None)

    run = add(
        "run",
        "run.command",
        "follow the branches of scenes and write the results",
        "contimpact run branches/fig7/scene.toml -o out/fig7",
    )
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

    simulate = add(
        "simulate",
        "simulate.command",
        "simulate a scene's attractors",
        "contimpact simulate branches/fig7/scene.toml -o out/fig7/simulation --resume",
    )
    simulate.add_argument("scene", metavar="SCENE", help="a scene file (TOML) with [simulate]")
    simulate.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write to")
    simulate.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    simulate.add_argument("--no-plot", action="store_true", help="leave pictures out")
    simulate.add_argument("--html", action="store_true", help="also write the page diagram.html")
    simulate.add_argument(
        "--resume", action="store_true", help="continue what an interrupted run has left in DIR"
    )

    report = add(
        "report",
        "scenes.report",
        "measure error against run time for a scene",
        "contimpact report branches/fig7/scene.toml -o out/fig7/report -n 3",
    )
    report.add_argument("scene", metavar="SCENE", help="a scene file (TOML)")
    report.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write to")
    report.add_argument(
        "-n", "--repetitions", metavar="N", type=int, default=5, help="of each timing (default 5)"
    )
    report.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    report.add_argument("--no-plot", action="store_true", help="leave the plots out")

    certify = add(
        "certify",
        "certify.command",
        "prove what a catalogue says",
        "contimpact certify out/fig7",
    )
    certify.add_argument(
        "target", metavar="SCENE|DIR", help="a scene file (TOML) to run first, or a folder"
    )
    certify.add_argument("-o", "--output", metavar="DIR", help="folder to write to, with a scene")
    certify.add_argument(
        "--verify", action="store_true", help="repeat the proofs that are stored in DIR"
    )
    certify.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")
    certify.add_argument("--no-plot", action="store_true", help="leave the diagram out")

    merge = add(
        "catalogue",
        "folders.catalogue",
        "merge the catalogues of several folders",
        "contimpact catalogue out/fig7 out/fig8 -o out/both",
    )
    merge.add_argument("folders", metavar="DIR", nargs="+", help="folders written by run")
    merge.add_argument("-o", "--output", metavar="DIR", required=True, help="folder to write to")

    study = add(
        "study",
        "study.study",
        "compute the scenes of a study into a store",
        "contimpact study branches/atlas/A5.toml -o competition.sqlite --workers 2",
    )
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

    export = add(
        "export",
        "study.export",
        "write the tables of a store as files",
        "contimpact export competition.sqlite -o out/tables --format csv.gz --table events",
    )
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

    atlas = add(
        "atlas",
        "study.atlas",
        "draw maps of studies over two of their axes",
        "contimpact atlas competition.sqlite -o out/maps --quantity mechanism --axes beta r",
    )
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

    plot = add(
        "plot",
        "folders.plot",
        "draw a folder's diagram, with its attractors",
        "contimpact plot out/fig7 -x d -y multipliers --xlim 0.13 0.25 -o multipliers.svg",
    )
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

    view = add(
        "view",
        "folders.view",
        "open the page of a folder in the browser",
        "contimpact view out/fig7",
    )
    view.add_argument("folder", metavar="DIR", help="folder written by run or simulate")

    range_ = add(
        "range",
        "folders.ranges",
        "say which attractors there are, and where they end",
        "contimpact range out/fig7 --at 0.3 --at 0.356",
    )
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

    fit = add(
        "fit",
        "scenes.fit",
        "estimate parameters from measured impacts",
        "contimpact fit branches/fig8/scene.toml impacts.csv --parameter r -o residuals.png",
    )
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

    design = add(
        "design",
        "scenes.design",
        "maximise an output at a margin from bifurcations",
        "contimpact design examples/harvester.toml -o design.csv",
    )
    design.add_argument("scene", metavar="SCENE", help="a scene file (TOML) with [design]")
    design.add_argument("-o", "--output", metavar="FILE", help="file to write as a table (csv)")

    completion = add(
        "completion",
        "manual.completion",
        "print the completion of a shell",
        'eval "$(contimpact completion bash)"',
    )
    completion.add_argument("shell", choices=["bash", "zsh", "fish"], help="the shell")
    for command in (check, run, simulate, report, plot, range_, fit, design):
        command.add_argument(
            "--system",
            metavar="FILE",
            action="append",
            default=[],
            help="Python file that defines a system of your own; may be given several times",
        )
    return parser


def commands_of(parser: argparse.ArgumentParser) -> Mapping[str, argparse.ArgumentParser]:
    """Return the parsers of the commands, by name."""
    kind = argparse._SubParsersAction
    (found,) = (action for action in parser._actions if isinstance(action, kind))
    return found.choices
