"""The command line: ``contimpact new``, ``check``, ``run``, ``simulate``, ``plot`` and the rest.

Exit status: 0 on success, 2 on input that cannot be used (one message on standard error), 1 on a
computation that failed; what was computed is written all the same. A command is a function of a
module, which is imported when the command is given.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import importlib
import os
import re
import signal
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NoReturn, TextIO

from .. import __version__
from ..errors import InputError, NotWrittenError, each_once
from ..storage import terminal_text

# A request to end (SIGTERM), as schedulers send it, and the end of a terminal (SIGHUP) are taken as
# Ctrl-C.
#
# What was computed is written.

ENDING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""Signals that ask a command to end."""


@contextlib.contextmanager
def raise_on_termination() -> Iterator[None]:
    """Raise `KeyboardInterrupt` where the process is asked to end, if nobody else has a handler."""
    main = threading.current_thread() is threading.main_thread()
    asked = [n for n in ENDING if signal.getsignal(n) is signal.SIG_DFL] if main else []
    for number in asked:
        signal.signal(number, signal.default_int_handler)
    try:
        yield
    finally:
        for number in asked:
            signal.signal(number, signal.SIG_DFL)


def say(text: str, stream: TextIO | None = None) -> None:
    """Print lines of text, to standard output if nothing else is said."""
    stream = stream or sys.stdout
    print(terminal_text(text, getattr(stream, "encoding", None)), file=stream, flush=True)


def complain(message: object) -> None:
    """Write a message to standard error."""
    say(f"contimpact: {message}", sys.stderr)


EXAMPLES = {
    "check": "contimpact check branches/fig7/scene.toml",
    "new": "contimpact new impact-pair",
    "systems": "contimpact systems",
    "run": "contimpact run branches/fig7/scene.toml -o out/fig7",
    "simulate": "contimpact simulate branches/fig7/scene.toml -o out/fig7/simulation --resume",
    "report": "contimpact report branches/fig7/scene.toml -o out/fig7/report -n 3",
    "certify": "contimpact certify out/fig7",
    "catalogue": "contimpact catalogue out/fig7 out/fig8 -o out/both",
    "study": "contimpact study branches/atlas/A5.toml -o competition.sqlite --workers 2",
    "export": "contimpact export competition.sqlite -o out/tables --format csv.gz --table events",
    "atlas": "contimpact atlas competition.sqlite -o out/maps --quantity mechanism --axes beta r",
    "plot": "contimpact plot out/fig7 -x d -y multipliers --xlim 0.13 0.25 -o multipliers.svg",
    "view": "contimpact view out/fig7",
    "range": "contimpact range out/fig7 --at 0.3 --at 0.356",
    "fit": "contimpact fit branches/fig8/scene.toml impacts.csv --parameter r -o residuals.png",
    "design": "contimpact design examples/harvester.toml -o design.csv",
    "completion": 'eval "$(contimpact completion bash)"',
}
"""An example for every command, as its help and the manual show it."""

THREADS = "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"
"""Environment variables that set the number of threads of linear algebra. Matrices are so small
that several threads take longer than one, up to ten times where other processes run."""


NEGATIVE = re.compile(r"-\.?\d")
"""How a value begins that is no option."""

UNSEARCHED = 20_000, 10, 10
"""How many objects are made between two of Python's searches for unreachable ones: most of what a
command makes it keeps."""


def program() -> NoReturn:
    """Run the command line as a program; ``python -m contimpact`` does the same.

    A signal that comes when all is done changes its status no more. At the end nothing is searched
    for unreachable objects, which took a tenth of a short command.
    """
    gc.set_threshold(*UNSEARCHED)
    status = main()
    # After an interruption inside ``exec`` of a text, CPython ends ``python -m`` as by SIGINT, even
    # where the exception was handled. It forgets that when it runs another text.
    exec("")
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)
    gc.freeze()
    sys.exit(status)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    try:
        try:
            return _status(arguments)
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except OSError as error:  # what is printed reaches nobody: a closed pipe, a full disk
        with contextlib.suppress(OSError, ValueError):  # what is buffered is discarded
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            with contextlib.suppress(OSError):
                say(f"contimpact: {error.strerror or error}", sys.stderr)
        return 1


def _status(arguments: Sequence[str] | None) -> int:
    options = parser().parse_args(arguments)
    if "numpy" not in sys.modules:  # which reads them when it is loaded
        for name in THREADS:
            os.environ.setdefault(name, "1")
    try:
        if vars(options).get("output") == "":
            raise InputError("-o", "empty", "give the path of a folder or a file")
        for name, given in vars(options).items():
            if isinstance(given, list) and [] in given:  # argparse takes the value -- for none
                raise InputError(f"--{name}", "no value", "give one")
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


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="contimpact",
        description="Continuation of periodic orbits in impacting systems, ghosts included.",
    )
    parser.add_argument("--version", action="version", version=f"contimpact {__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def add(name: str, function: str, help: str) -> argparse.ArgumentParser:
        """A command, and the function that it calls; an example ends its help."""
        raw, example = argparse.RawDescriptionHelpFormatter, f"example:\n  {EXAMPLES[name]}"
        found = commands.add_parser(name, help=help, epilog=example, formatter_class=raw)
        found.set_defaults(function=function)
        found._negative_number_matcher = NEGATIVE  # argparse's own has no exponents
        return found

    check = add("check", "scenes.check", "validate a scene and say what would run")
    argument(check, "scene SCENE", "a scene file (TOML)")

    new = add("new", "scenes.new", "print a commented scene of a system to start from")
    argument(new, "kind SYSTEM", "its name, as contimpact systems lists them")

    systems = add("systems", "scenes.new", "list the systems that scenes can name")
    systems.set_defaults(kind=None)

    run = add("run", "run.command", "follow the branches of scenes and write the results")
    argument(run, "scenes SCENE", "scene files (TOML)", nargs="+")
    argument(
        run,
        "-o --output DIR",
        "folder to write to; with several scenes, each has a folder of its name in it",
        required=True,
    )
    argument(run, "--ghosts", "list the events that are ghosts, not only count them")
    argument(run, "--no-plot", "leave the diagram out")
    argument(run, "--html", "also write the page diagram.html")

    simulate = add("simulate", "run.simulate", "simulate a scene's attractors")
    argument(simulate, "scene SCENE", "a scene file (TOML) with [simulate]")
    argument(simulate, "-o --output DIR", "folder to write to", required=True)
    argument(simulate, "--no-plot", "leave pictures out")
    argument(simulate, "--html", "also write the page diagram.html")
    argument(simulate, "--resume", "continue what an interrupted run has left in DIR")

    report = add("report", "scenes.report", "measure error against run time for a scene")
    argument(report, "scene SCENE", "a scene file (TOML)")
    argument(report, "-o --output DIR", "folder to write to", required=True)
    argument(report, "-n --repetitions N", "of each timing (default 5)", type=int, default=5)
    argument(report, "--no-plot", "leave the plots out")

    certify = add("certify", "folders.certify", "prove what a catalogue says")
    argument(certify, "target SCENE|DIR", "a scene file (TOML) to run first, or a folder")
    argument(certify, "-o --output DIR", "folder to write to, with a scene")
    argument(certify, "--verify", "repeat the proofs that are stored in DIR")
    argument(certify, "--no-plot", "leave the diagram out")

    merge = add("catalogue", "folders.catalogue", "merge the catalogues of several folders")
    argument(merge, "folders DIR", "folders written by run", nargs="+")
    argument(merge, "-o --output DIR", "folder to write to", required=True)

    study = add("study", "study.study", "compute the scenes of a study into a store")
    argument(study, "study STUDY", "a study file (TOML)")
    argument(study, "-o --output STORE", "store to write to, or to continue", required=True)
    argument(study, "-w --workers N", "processes (default all cores)", type=int)
    argument(study, "--scheduler ADDRESS", "compute on a Dask scheduler's workers")
    argument(study, "--mpi", "compute on the processes of an MPI run")
    argument(study, "--again", "try scenes again that have failed")

    export = add("export", "study.export", "write the tables of a store as files")
    argument(export, "store STORE", "a store written by study")
    argument(export, "-o --output DIR", "folder to write to", required=True)
    argument(
        export,
        "--format",
        "of the files (default csv)",
        choices=("csv", "csv.gz", "json", "parquet"),
        default="csv",
    )
    argument(export, "--study NAME", "these studies alone", action="append")
    argument(export, "--table NAME", "these tables alone", action="append")
    argument(export, "--columns A,B,...", "these columns alone", type=lambda text: text.split(","))
    argument(export, "--digits N", "significant digits (default all)", type=int)

    atlas = add("atlas", "study.atlas", "draw maps of studies over two of their axes")
    argument(atlas, "store STORE", "a store written by study")
    argument(atlas, "-o --output DIR", "folder to write to", required=True)
    argument(atlas, "--study NAME", "of these studies alone", action="append")
    argument(atlas, "--quantity NAME", "these alone", action="append")
    argument(atlas, "--axes X Y", "default: the study's first two")
    argument(atlas, "--orbit N:M", "of this orbit (default 1:1)")
    argument(atlas, "--at NAME=VALUE", "value of another axis", action="append", default=[])
    argument(
        atlas,
        "--format",
        "of the maps (default png)",
        action="append",
        choices=("png", "svg", "pdf"),
    )
    argument(atlas, "--no-plot", "write the tables alone")

    plot = add("plot", "folders.plot", "draw a folder's diagram, with its attractors")
    argument(plot, "folder DIR", "folder written by run or simulate")
    argument(plot, "-o --output FILE", "file to write (svg, png, pdf or html)")
    argument(plot, "--html", "write the page: DIR/diagram.html")
    argument(plot, "-x NAME", "parameter on the x axis, otherwise the one in the scene")
    argument(plot, "-y NAME", "quantity on the y axis, such as multipliers, or a column")
    argument(plot, "--xlim LOW HIGH", "limits of the x axis", type=float)
    argument(plot, "--ylim LOW HIGH", "limits of the y axis", type=float)

    view = add("view", "folders.view", "open the page of a folder in the browser")
    argument(view, "folder DIR", "folder written by run or simulate")

    range_ = add("range", "folders.ranges", "say which attractors there are, and where they end")
    argument(range_, "folder DIR", "folder written by run or simulate")
    argument(
        range_,
        "--at VALUE",
        "of the followed parameter: the attractors there, and how far their ends are",
        type=float,
        action="append",
        default=[],
    )
    argument(range_, "-o --output FILE", "file to write as a table (csv)")

    fit = add("fit", "scenes.fit", "estimate parameters from measured impacts")
    argument(fit, "scene SCENE", "a scene file (TOML) with starting values")
    argument(fit, "data CSV", "columns time, velocity, wall, or some; units are those of tables")
    argument(fit, "--parameter NAME", "to estimate", action="append", required=True)
    argument(fit, "--orbit WORD", "default: the scene's", action="append")
    argument(
        fit,
        "--deviation NAME=VALUE",
        "standard deviation of a time, or of a velocity (default: from the residuals)",
        action="append",
        default=[],
    )
    argument(fit, "--no-clock", "times are those of the model's clock")
    argument(fit, "-o --output FILE", "picture of the residuals to write")

    design = add("design", "scenes.design", "maximise an output at a margin from bifurcations")
    argument(design, "scene SCENE", "a scene file (TOML) with [design]")
    argument(design, "-o --output FILE", "file to write as a table (csv)")

    completion = add("completion", "completion.completion", "print the completion of a shell")
    argument(completion, "shell", "the shell", choices=["bash", "zsh", "fish"])
    for command in (run, simulate, report, certify, study, export, atlas, range_, fit, design):
        argument(command, "-q --quiet", "print nothing but errors")
    for command in (check, run, simulate, report, study, atlas, plot, range_, fit, design):
        argument(
            command,
            "--system FILE",
            "Python file that defines a system or a kind of event of your own; may be repeated",
            action="append",
            default=[],
        )
    return parser


def argument(command: argparse.ArgumentParser, spec: str, help: str, **more: Any) -> None:
    """Add an argument, stated by its names and the names of its values, such as ``-o --output
    DIR``; an option without values is a switch."""
    words = spec.split()
    names = [word for word in words if word.startswith("-")] or words[:1]
    values = words[len(names) :]
    if len(values) > 1:
        more |= {"nargs": len(values), "metavar": tuple(values)}
    elif values:
        more["metavar"] = values[0]
    elif words[0].startswith("-") and "choices" not in more:
        more["action"] = "store_true"
    command.add_argument(*names, help=help, **more)


def commands_of(parser: argparse.ArgumentParser) -> Mapping[str, argparse.ArgumentParser]:
    """Return the parsers of the commands, by name."""
    kind = argparse._SubParsersAction
    (found,) = (action for action in parser._actions if isinstance(action, kind))
    return found.choices
