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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import __version__
from ..diagrams.explore import follow
from ..errors import InputError
from ..progress import Progress, ignore_progress
from ..results.branch import Branch, Entry
from ..results.diagram import Diagram
from ..results.diagram_reading import Interval, Reading, read
from ..results.scene import Scene, read_scene
from ..segments.compiling import expect_plain_time
from .store import Outcome, compress_text, row_of

if TYPE_CHECKING:
    from ..diagrams.scene_simulation import Simulation
    from ..systems.membrane import Membrane

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


# What is kept of a scene: rows of the store's tables, as plain data.

Rows = dict[str, list[dict[str, Any]]]


def diagram_rows(diagram: Diagram, keep: Sequence[str], derived: str | None) -> Rows:
    """Return the rows of a diagram."""
    rows: Rows = {
        "branches": [_branch(branch, "tables" in keep) for branch in diagram.branches],
        "events": [_event(entry, derived) for entry in diagram.entries],
        "limits": [
            row_of("limits", limit, number=number, left_out=sum(n for _, n in limit.left_out))
            for number, limit in enumerate(diagram.limits)
        ],
    }
    if "readings" in keep:
        rows |= _readings(diagram, read(diagram), derived)
    if "curves" in keep:
        rows["curves"] = _curves(diagram)
        rows["codimension_two"] = _codimension_two(diagram, derived)
    if "catalogue" in keep:
        from ..results.catalogue import catalogue_text

        rows["catalogues"] = [{"content": compress_text(catalogue_text(diagram))}]
    return rows


def _branch(branch: Branch, whole: bool) -> dict[str, Any]:
    from ..results.catalogue import branch_text

    values = branch[branch.parameter]
    first, last = (end.kind.name.lower() for end in branch.ends)
    return row_of(
        "branches",
        branch,
        branch=branch.id,
        points=len(branch),
        low=float(values.min()),
        high=float(values.max()),
        first_end=first,
        last_end=last,
        missed=len(branch.missed),
        content=compress_text(branch_text(branch)) if whole else None,
    )


def _event(entry: Entry, derived: str | None) -> dict[str, Any]:
    value = entry.parameters[derived] if derived else None
    return row_of("events", entry, event=entry.id, derived=value)


def _readings(diagram: Diagram, reading: Reading, derived: str | None) -> Rows:
    branches = {branch.id: branch for branch in diagram.branches}
    intervals = [
        _interval(number, interval, branches[interval.branch], derived)
        for number, interval in enumerate(reading.stable)
    ]
    transitions = [
        row_of("transitions", transition, number=number, grazing=transition.entry)
        for number, transition in enumerate(reading.transitions)
    ]
    return {"intervals": intervals, "transitions": transitions}


def _interval(
    number: int, interval: Interval, branch: Branch, derived: str | None
) -> dict[str, Any]:
    values = branch[branch.parameter]
    ends = interval.low, interval.high
    of_ends: list[float | None] = [None, None]
    if derived:
        of_ends = [float(branch[derived][abs(values - end).argmin()]) for end in ends]
    (low_end, high_end), (low_derived, high_derived) = interval.bounds, of_ends
    more = {"low_derived": low_derived, "high_derived": high_derived}
    return row_of("intervals", interval, number=number, low_end=low_end, high_end=high_end, **more)


def _curves(diagram: Diagram) -> list[dict[str, Any]]:
    from ..results.catalogue import curve_text

    return [
        row_of(
            "curves",
            curve,
            curve=curve.id,
            first=curve.parameters[0],
            second=curve.parameters[1],
            points=len(curve),
            content=compress_text(curve_text(curve)),
        )
        for curve in diagram.curves
    ]


def _codimension_two(diagram: Diagram, derived: str | None) -> list[dict[str, Any]]:
    pairs = [(curve, point) for curve in diagram.curves for point in curve.points]
    return [
        row_of(
            "codimension_two",
            point,
            number=number,
            notation=curve.notation,
            first=curve.parameters[0],
            second=curve.parameters[1],
            first_value=point.parameters[curve.parameters[0]],
            second_value=point.parameters[curve.parameters[1]],
            derived=point.parameters[derived] if derived else None,
        )
        for number, (curve, point) in enumerate(pairs)
    ]


def simulation_rows(simulation: Simulation, keep: Sequence[str], membrane: Membrane | None) -> Rows:
    """Return the rows of a simulation."""
    found: Rows = {"attractors": [], "energies": []}
    for number, row in enumerate(simulation.sweep.rows):
        a = row.attractor
        own = {"number": number, "direction": row.direction, "value": row.value}
        own |= {"kind": a.kind.value, "exponent": a.exponents[0], "gap": a.smallest_gap}
        found["attractors"].append(row_of("attractors", a, **own))
        if "energies" in keep and membrane is not None:
            from ..simulation.energy import attractor_voltages

            energy = attractor_voltages(membrane, a)
            found["energies"].append(row_of("energies", energy, number=number))
    return found
