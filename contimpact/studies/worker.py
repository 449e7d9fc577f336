"""What a worker computes of a scene, within its budget of time.

Nothing here knows the store or the executor; a `Task` goes to a worker, an `Outcome` comes back,
both of them plain data.
"""

from __future__ import annotations

import contextlib
import functools
import json
import platform
import signal
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import __version__
from ..diagrams.explore import follow
from ..errors import InputError
from ..progress import Progress, ignore_progress
from ..results.scene import Scene, read_scene
from ..segments.compiling import expect_plain_time
from .outcome import Rows, diagram_rows, simulation_rows
from .store import Outcome

# A scene's budget of time: what ends a scene that hangs.

LATE = 2.0
GRACE = 10.0
"""A process of our own is ended after so many budgets and, besides, so many seconds."""
AGAIN = 1.0
"""Seconds after which the timer rings again: what it raises is lost within callbacks of C."""


class BudgetError(BaseException):
    """A scene has used up its budget; nothing on the way takes it for a numerical error."""


@contextlib.contextmanager
def limit_time(seconds: float | None, fatal: bool = False) -> Iterator[Progress]:
    """End what is done within the block by BudgetError when it takes too long; None for no limit.

    In a process's main thread a timer interrupts Python wherever it is. Elsewhere the function that
    is yielded looks at the clock whenever progress is told to it. Where it is `fatal`, the process
    is ended if it does not return to Python even then.
    """
    if seconds is None:
        yield ignore_progress
        return
    deadline = time.monotonic() + seconds

    def tell(text: str) -> None:
        if time.monotonic() > deadline:
            raise BudgetError

    with _watch_time(LATE * seconds + GRACE if fatal else None), _alarm(seconds):
        yield tell


@contextlib.contextmanager
def _alarm(seconds: float) -> Iterator[None]:
    main = threading.current_thread() is threading.main_thread()
    if not (main and hasattr(signal, "setitimer")):
        yield
        return

    def ring(*signalled: Any) -> None:
        raise BudgetError

    before = signal.signal(signal.SIGALRM, ring)
    try:
        signal.setitimer(signal.ITIMER_REAL, seconds, AGAIN)
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextlib.contextmanager
def _watch_time(seconds: float | None) -> Iterator[None]:
    """End the process after a time, by a thread that needs no Python."""
    if seconds is None:
        yield
        return
    import faulthandler
    import os

    with open(os.devnull, "w") as nowhere:
        faulthandler.dump_traceback_later(seconds, exit=True, file=nowhere)
        try:
            yield
        finally:
            faulthandler.cancel_dump_traceback_later()


@dataclass(frozen=True)
class Task:
    """A scene to compute."""

    scene: Mapping[str, Any]
    """Scene as a scene file has it."""
    keep: tuple[str, ...]
    derived: str | None
    """The derived parameter whose values are kept."""
    budget: float | None = None
    """Seconds."""
    fatal: bool = False
    """Whether the process may be ended if the scene hangs outside Python."""
    expected: float = 0.0
    """Seconds that the study would take plainly, by which it is decided whether compiling pays."""


def compute(task: Task) -> Outcome:
    """Compute a scene; whatever fails is part of the outcome."""
    began = time.perf_counter()
    expect_plain_time(task.expected)

    def ended(status: str, rows: Rows, **counts: int) -> Outcome:
        return Outcome(status, time.perf_counter() - began, versions(), rows, **counts)

    def failed(kind: str, reason: str) -> Outcome:
        return ended("failed", {"failures": [{"kind": kind, "reason": reason}]})

    try:
        with limit_time(task.budget, task.fatal) as tell:
            return _compute_scene(task, tell, ended)
    except BudgetError:
        return failed("budget", f"not finished within its {task.budget:g} s")
    except InputError as error:
        return failed("refused", str(error))
    except Exception as error:
        return failed("error", f"{type(error).__name__}: {error}")


def _compute_scene(task: Task, tell: Any, ended: Any) -> Outcome:
    scene = read_scene(task.scene)
    diagram = follow(scene, tell)
    rows = diagram_rows(diagram, task.keep, task.derived)
    if {"attractors", "energies"} & {*task.keep}:
        rows |= _simulate_scene(scene, task, tell)
    if reason := diagram.statistics["failure"]:
        rows["failures"] = [{"kind": "numerical", "reason": reason}]
    counts = diagram.statistics["counts"]
    return ended(
        "incomplete" if reason else "done",
        rows,
        points=counts["points"],
        evaluations=counts["kernel_evaluations"],
    )


def _simulate_scene(scene: Scene, task: Task, tell: Any) -> Rows:
    from ..diagrams.scene_simulation import simulate

    with tempfile.TemporaryDirectory() as folder:
        simulation = simulate(scene, Path(folder), progress=tell)
    return simulation_rows(simulation, task.keep, scene.energy)


@functools.cache
def versions() -> str:
    """Return the versions of what computes, as JSON."""
    from importlib import metadata

    known = {"contimpact": __version__, "python": platform.python_version()}
    for name in ("numpy", "scipy", "sympy", "llvmlite"):
        with contextlib.suppress(metadata.PackageNotFoundError):
            known[name] = metadata.version(name)
    return json.dumps(known | {"machine": platform.machine()}, sort_keys=True)
