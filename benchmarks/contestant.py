"""What is measured, in rounds of all contestants, and the processes in which it is measured."""

from __future__ import annotations

import importlib.util
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

HERE = Path(__file__).resolve().parent
COMPILED = importlib.util.find_spec("llvmlite") is not None
MODES = {"plain": "never"} | ({"compiled": "always"} if COMPILED else {})
"""Values of CONTIMPACT_COMPILED; compiling needs llvmlite."""

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Sample(NamedTuple):
    """One measurement: the seconds that so many points, impacts or scenes took."""

    table: str
    row: str
    seconds: float
    count: int


@dataclass(frozen=True)
class Contestant:
    """Measures some rows once in every round.

    Attributes
    ----------
    name : str
        For messages.
    measure : callable
        Returns a list of `Sample`.
    rounds : int, optional
        Rounds it takes part in, at most.
    """

    name: str
    measure: Callable[[], list[Sample]]
    rounds: int | None = None


Measured = dict[str, dict[str, list[Sample]]]
"""By table and row, a sample for each round."""


def interleaved(contestants: Sequence[Contestant], runs: int) -> Measured:
    """Let all contestants measure in turn, round after round, after one that is not counted."""
    measured: Measured = {}
    for turn in range(runs + 1):
        for contestant in contestants:
            if turn > (contestant.rounds or runs):
                continue
            say(
                f"round {turn} of {runs}: {contestant.name}" if turn else f"warm: {contestant.name}"
            )
            for sample in contestant.measure():
                if turn:
                    rows = measured.setdefault(sample.table, {})
                    rows.setdefault(sample.row, []).append(sample)
    return measured


def say(text: str) -> None:
    """Tell how far things are."""
    print(text, file=sys.stderr, flush=True)


@dataclass(frozen=True)
class Workspace:
    """A temporary folder in which everything is run and cached."""

    folder: Path

    def environment(self, mode: str) -> dict[str, str]:
        """Return the environment of a child: one thread, compiled or not, a cache of its own."""
        cache = self.folder / f"cache-{mode}"
        return (
            os.environ
            | dict.fromkeys(THREADS, "1")
            | {"CONTIMPACT_COMPILED": MODES[mode], "CONTIMPACT_CACHE": str(cache)}
        )

    def timed(self, script: str, *arguments: str, mode: str) -> float:
        """Run a script of this folder in a process of its own; returns its processor time."""
        command = [sys.executable, str(HERE / script), *arguments]
        return timed(command, env=self.environment(mode), cwd=self.folder)

    def call(self, function: str, *arguments: Any, mode: str = "plain") -> Any:
        """Call ``module.function`` in a process of its own and return what it returns."""
        command = [sys.executable, str(HERE / "child.py"), *function.split(".")]
        done = subprocess.run(
            [*command, json.dumps(arguments)],
            env=self.environment(mode),
            cwd=self.folder,
            check=True,
            stdout=subprocess.PIPE,
            text=True,
        )
        return json.loads(done.stdout)


def timed(command: Sequence[str], **options: Any) -> float:
    """Run a command without showing its output; returns the processor time of its processes.

    Raises
    ------
    RuntimeError
        If it fails; the message is what it printed.
    """
    began = _seconds_of_children()
    done = subprocess.run(
        command, check=False, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, **options
    )
    seconds = _seconds_of_children() - began
    if done.returncode:
        raise RuntimeError(f"{command[0]} failed:\n{done.stderr.decode()}")
    return seconds


def _seconds_of_children() -> float:
    """The processor time of all processes that have been run."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def seconds_of(work: Callable[[], Any]) -> tuple[float, Any]:
    """Return the processor time a function takes, and its result."""
    began = time.process_time()
    result = work()
    return time.process_time() - began, result
