"""A study computed: scene after scene into the store, from where it stopped.

Scenes are computed in an order of their own, the same for the same study: one drawn at random, so
that the first few tell what the rest will cost. The store is written by this process alone: a
`Task` goes to a worker, which computes it within its budget of time and knows neither store nor
executor, and an `Outcome` comes back, both of them plain data.
"""

from __future__ import annotations

import contextlib
import functools
import json
import math
import platform
import signal
import tempfile
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import __version__
from ..diagrams.explore import follow
from ..errors import InputError, count_text, explain_arguments
from ..progress import Progress, ignore_progress
from ..results.branch import Branch
from ..results.diagram import INTERRUPTED, Diagram
from ..results.diagram_reading import Interval, Reading, read
from ..results.scene import Scene, read_scene
from ..segments.compiling import expect_plain_time
from .executors import UNKNOWN, Workshop, processes, refuse_to_start_again
from .store import Outcome, Store, compress_text, row_of
from .study_file import StudyFile, systems_in

if TYPE_CHECKING:
    from ..diagrams.scene_simulation import Simulation
    from ..systems.membrane import Membrane


# A scene's budget of time: what ends a scene that hangs.

LATE = 2.0
GRACE = 10.0
"""A process of our own is ended after so many budgets and, besides, so many seconds."""
AGAIN = 1.0
"""Seconds after which the timer rings again: what it raises is lost within callbacks of C."""


class BudgetError(KeyboardInterrupt):
    """A scene has used up its budget. What is interrupted keeps what it has, as by the keyboard."""


class TimeLimit:
    """A budget of time, as a function of progress that interrupts once it is used up."""

    def __init__(self, seconds: float = math.inf) -> None:
        self.next = time.monotonic() + seconds
        self.spent = False

    def __call__(self, text: str) -> None:
        if time.monotonic() > self.next:
            self.ring()

    def ring(self, *signalled: Any) -> None:
        """Interrupt, and again after a while where that was not heard."""
        self.next, self.spent = time.monotonic() + AGAIN, True
        raise BudgetError


@contextlib.contextmanager
def limit_time(seconds: float | None, fatal: bool = False) -> Iterator[TimeLimit]:
    """End what is done within the block by BudgetError when it takes too long; None for no limit.

    In a process's main thread a timer interrupts Python wherever it is. Elsewhere the limit that
    is yielded looks at the clock whenever progress is told to it. Where it is `fatal`, the process
    is ended if it does not return to Python even then.
    """
    if seconds is None:
        yield TimeLimit()
        return
    limit = TimeLimit(seconds)
    with _watch_time(LATE * seconds + GRACE if fatal else None), _alarm(seconds, limit):
        yield limit


@contextlib.contextmanager
def _alarm(seconds: float, limit: TimeLimit) -> Iterator[None]:
    main = threading.current_thread() is threading.main_thread()
    if not (main and hasattr(signal, "setitimer")):
        yield
        return
    before = signal.signal(signal.SIGALRM, limit.ring)
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
    systems: tuple[str, ...] = ()
    """Files that define systems or kinds of events of one's own."""

    def read(self) -> Scene:
        """Return the scene, read and validated."""
        return read_scene(self.scene, systems_in(self.systems))


def compute(task: Task) -> Outcome:
    """Compute a scene; whatever fails is part of the outcome."""
    began = time.perf_counter()
    expect_plain_time(task.expected)

    def ended(status: str, rows: Rows, **counts: int) -> Outcome:
        return Outcome(status, time.perf_counter() - began, versions(), rows, **counts)

    def failed(kind: str, reason: str) -> Outcome:
        return ended("failed", {"failures": [{"kind": kind, "reason": reason}]})

    found, limit = _Found(), TimeLimit()
    try:
        try:
            with limit_time(task.budget, task.fatal) as limit:
                _compute_scene(task, limit, found)
        except KeyboardInterrupt:
            if not limit.spent:
                raise
        late = f"not finished within its {task.budget or math.inf:g} s"
        if found.diagram is None:
            return failed("budget", late)
        rows, reason = found.rows(task), found.failure
        if reason == INTERRUPTED and not limit.spent:
            raise KeyboardInterrupt
        if reason == INTERRUPTED:
            rows["failures"] = [{"kind": "budget", "reason": late}]
        elif reason:
            rows["failures"] = [{"kind": "numerical", "reason": reason}]
        counts = found.diagram.statistics["counts"]
        return ended(
            "incomplete" if reason else "done",
            rows,
            points=counts["points"],
            evaluations=counts["kernel_evaluations"],
        )
    except InputError as error:
        return failed("refused", str(error))
    except Exception as error:
        return failed("error", f"{type(error).__name__}: {error}")


@dataclass
class _Found:
    """What is computed of a scene, as far as it has come."""

    diagram: Diagram | None = None
    simulation: Simulation | None = None
    failure: str = INTERRUPTED
    """Why something is missing, if it is."""

    def rows(self, task: Task) -> Rows:
        """The rows of what there is."""
        assert self.diagram is not None
        scene = task.read()
        rows = diagram_rows(self.diagram, task.keep, task.derived, scene.model.values)
        if self.simulation is not None:
            rows |= simulation_rows(self.simulation, task.keep, scene.energy)
        return rows


def _compute_scene(task: Task, limit: TimeLimit, found: _Found) -> None:
    scene = task.read()
    found.diagram = follow(scene, limit)
    failure = found.diagram.statistics["failure"] or ""
    if {"attractors", "energies"} & {*task.keep} and failure != INTERRUPTED:
        from ..diagrams.scene_simulation import simulate

        with tempfile.TemporaryDirectory() as folder:
            found.simulation = simulate(scene, Path(folder), progress=limit)
        failure = INTERRUPTED if found.simulation.interrupted else failure
    found.failure = failure


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


def diagram_rows(
    diagram: Diagram, keep: Sequence[str], derived: str | None, values: Mapping[str, float]
) -> Rows:
    """Return the rows of a diagram; it is read at the values of its scene alone."""
    rows: Rows = {
        "branches": [_branch(branch, "tables" in keep) for branch in diagram.branches],
        "events": [
            row_of("events", e, event=e.id, derived=e.parameters[derived] if derived else None)
            for e in diagram.entries
        ],
        "limits": [
            row_of("limits", limit, number=number, left_out=sum(n for _, n in limit.left_out))
            for number, limit in enumerate(diagram.limits)
        ],
    }
    if "readings" in keep:
        rows |= _readings(diagram, read(diagram.at(values)), derived)
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


FEW = 24
"""Scenes, and `FOR_EACH` more for each worker, after which the time that is left is estimated."""
FOR_EACH = 4
AHEAD = 2
"""Scenes given to each worker at once, so that none waits for the store."""
LONG = 10.0
"""Seconds without a finished scene after which it is looked whether there are workers."""
PLAINLY = 0.1
"""Seconds that plain Python takes for the steps of a scene, roughly, by which it is decided whether
compiling pays."""
COMPILING = 60.0
"""Seconds that a first scene may take beyond its budget, on a busy machine."""
FIRST = 5
"""Scenes that are computed alone, at most, until one has left kernels and compiled code."""
ATTEMPTS = 2
"""A scene that ends its worker is tried so often alone."""
REOPENED = 5
"""Executors opened one after another without a scene that was finished in between."""


class WorkersLostError(InputError):
    """No worker is left; what was finished is in the store."""


@dataclass
class Tally:
    """How far a study has come."""

    total: int
    """Scenes of the study."""
    before: int
    """Those that earlier runs have finished."""
    done: int = 0
    failed: int = 0
    limited: int = 0
    """`done`, `failed`, `limited`: scenes of this run; those that have failed, or that a limit has
    cut short, are among those done."""
    seconds: float = 0.0
    """Seconds since this run began."""
    estimate: float | None = None
    """Seconds this run was said to take."""
    statuses: Mapping[str, int] = field(default_factory=dict)
    """Scenes in the store by their status, those of earlier runs among them."""

    @property
    def left(self) -> int:
        """Scenes still to compute."""
        return self.total - self.before - self.done


@dataclass
class _Clock:
    """What scenes take; the first one, which derives and compiles, is left out."""

    began: float = field(default_factory=time.monotonic)
    since: float | None = None
    counted: int = 0

    def tick(self) -> None:
        if self.since is None:
            self.since = time.monotonic()
        else:
            self.counted += 1

    def each(self) -> float | None:
        """Seconds from one scene to the next."""
        if self.since is None or not self.counted:
            return None
        return (time.monotonic() - self.since) / self.counted


@explain_arguments
def run_study(
    study: StudyFile,
    store: Store,
    workshop: Workshop | None = None,
    *,
    again: bool = False,
    progress: Progress | None = None,
    announce: Callable[[str], None] = ignore_progress,
) -> Tally:
    """Compute the scenes of a study that are not in the store.

    Parameters
    ----------
    study : StudyFile
    store : Store
    workshop : Workshop, optional
        Where; by default on processes of this machine, one for each core. A script that calls this
        has to do so below ``if __name__ == "__main__":``, since each process loads it.
    again : bool
        Whether scenes that have failed are tried again.
    progress : callable, optional
        Called with a line of text after every scene.
    announce : callable, optional
        Called with what is to be read even where nobody follows the progress: how many scenes there
        are, how long it will take, what it has taken.

    Returns
    -------
    Tally

    Raises
    ------
    InputError
        If the store holds another study of this name, or cannot be written, or the processes run
        the script again.
    WorkersLostError
        If no worker is left.
    """
    refuse_to_start_again()
    with store.claimed(study.name):
        return _Computation(
            study, store, workshop or processes(), again, progress or ignore_progress, announce
        ).run()


class _Computation:
    def __init__(
        self,
        study: StudyFile,
        store: Store,
        workshop: Workshop,
        again: bool,
        progress: Progress,
        announce: Callable[[str], None],
    ) -> None:
        self.study, self.store, self.workshop = study, store, workshop
        self.progress, self.announce = progress, announce
        self.number = store.enter(study)
        self.numbers, self.values = study.points
        finished = store.finished(self.number, failed=not again)
        order = np.random.default_rng(0).permutation(len(study))
        self.waiting = deque(int(i) for i in order if int(self.numbers[i]) not in finished)
        self.tally = Tally(len(study), len(study) - len(self.waiting))
        self.flying: dict[Future[Outcome], int] = {}
        self.clock, self.ready, self.opened = _Clock(), False, 0
        self.few = 0
        self.derived = next(iter(study.first.model.DERIVED), None)

    def run(self) -> Tally:
        known = f", {self.tally.before} of them in the store" if self.tally.before else ""
        self.announce(f"{count_text(self.tally.total, 'scene')}{known}")
        if self.waiting:
            self.compute_all()
        self.tally.statuses = self.store.statuses(self.number)
        return self.tally

    def compute_all(self) -> None:
        """Compute what is waiting, on one executor after another if they break."""
        self.record_of_run: int | None = None
        while self.waiting or self.flying:
            self.opened += 1
            if self.opened > REOPENED:
                raise self.broken("nothing was finished on the last ones")
            suspects = self.on_an_executor()
            for place in suspects:
                self.alone(place)
        self.tally.seconds = time.monotonic() - self.clock.began
        assert self.record_of_run is not None
        self.store.note_run(self.record_of_run, seconds=self.tally.seconds, done=self.tally.done)

    def on_an_executor(self) -> list[int]:
        """Compute until all is done or the executor is lost; returns the scenes that may have
        ended their worker."""
        with self.workshop.opening(None) as executor:
            workers = self.workshop.workers(executor)
            self.begin(workers)
            try:
                for future in self.finished(executor, AHEAD * workers if workers else UNKNOWN):
                    self.keep(future)
            except BrokenExecutor as error:
                if not self.workshop.reopens:
                    raise self.broken(str(error)) from None
                return self.taken_back()
            except (CancelledError, ConnectionError) as error:  # the scheduler has lost them
                if not self.workshop.reopens:
                    raise self.broken(str(error)) from None
                self.waiting.extendleft(self.taken_back())
        return []

    def begin(self, workers: int | None) -> None:
        if self.record_of_run is None:
            name, count = self.workshop.name, len(self.waiting)
            self.record_of_run = self.store.begin_run(self.number, name, workers, count)
            self.few = FEW + FOR_EACH * (workers or 1)

    def taken_back(self) -> list[int]:
        """The scenes that were given away and are not finished."""
        places = sorted(self.flying.values())
        self.flying.clear()
        return places

    def finished(self, executor: Executor, width: int) -> Iterator[Future[Outcome]]:
        """Give scenes to an executor, `width` at once, and yield what is finished.

        The first goes alone: it leaves kernels and compiled code in the cache for the others, which
        may take longer than its budget.
        """
        while self.waiting or self.flying:
            while self.waiting and len(self.flying) < (width if self.ready else 1):
                place = self.waiting.popleft()
                self.flying[self.submit(executor, place)] = place
            done = wait(self.flying, LONG, FIRST_COMPLETED).done
            if not done and self.workshop.joined and not self.workshop.workers(executor):
                self.progress(f"{self.place()}, waiting for a worker: none has joined, or is left")
            yield from done

    def submit(self, executor: Executor, place: int) -> Future[Outcome]:
        try:
            return executor.submit(compute, self.task(place))
        except BaseException:
            self.waiting.appendleft(place)
            raise

    def task(self, place: int) -> Task:
        scene = self.study.scene_at(self.values[place], int(self.numbers[place]))
        budget, expected = self.study.budget, 0.0
        if not self.ready:
            budget, expected = budget and budget + COMPILING, PLAINLY * len(self.waiting)
        about = scene, self.study.keep, self.derived, budget, self.workshop.own, expected
        return Task(*about, self.study.systems)

    def keep(self, future: Future[Outcome]) -> None:
        """Write what came of a scene."""
        try:
            outcome = future.result()
        except (BrokenExecutor, CancelledError, ConnectionError):
            raise
        except ImportError as error:  # of what every scene needs
            raise self.broken(f"install contimpact where the workers are: {error}") from None
        except Exception as error:
            outcome = lost_outcome(f"{type(error).__name__}: {error}")
        self.record(self.flying.pop(future), outcome)

    def alone(self, place: int) -> None:
        """Compute a scene on an executor of its own, where it can take no other one along."""
        for _ in range(ATTEMPTS):
            with self.workshop.opening(1) as executor:
                try:
                    outcome = executor.submit(compute, self.task(place)).result()
                except BrokenExecutor:
                    continue
            self.record(place, outcome)
            return
        budget = self.study.budget
        hung = f", or hung for more than its {budget:g} s" if budget else ""
        self.record(
            place,
            lost_outcome(
                f"its worker ended each of {ATTEMPTS} times: killed, short of memory{hung}"
            ),
        )

    def record(self, place: int, outcome: Outcome) -> None:
        names = self.study.design.names
        coordinates = dict(zip(names, map(float, self.values[place]), strict=True))
        self.store.record(self.number, int(self.numbers[place]), coordinates, outcome)
        self.opened = 0
        self.tally.done += 1
        self.ready |= outcome.status == "done" or self.tally.done >= FIRST
        self.tally.failed += outcome.status == "failed"
        self.tally.limited += bool(outcome.rows.get("limits"))
        self.clock.tick()
        self.tell()

    def tell(self) -> None:
        tally, each = self.tally, self.clock.each()
        if each is not None and tally.estimate is None and self.clock.counted == self.few:
            self.estimate(each)
        text = self.place()
        if each:
            text += f", {1 / each:.3g}/s, {duration(tally.left * each)} left"
        self.progress(text)

    def place(self) -> str:
        """How far it is."""
        tally = self.tally
        text = f"{tally.before + tally.done} of {count_text(tally.total, 'scene')}"
        return text + (f", {tally.failed} failed" if tally.failed else "")

    def estimate(self, each: float) -> None:
        elapsed = time.monotonic() - self.clock.began
        self.tally.estimate = elapsed + self.tally.left * each
        assert self.record_of_run is not None
        self.store.note_run(self.record_of_run, estimate=self.tally.estimate)
        left = self.tally.left * each
        shown = "%H:%M" if left < 80000 else "%d %b %H:%M"
        until = time.strftime(shown, time.localtime(time.time() + left))
        self.announce(
            f"estimate after {count_text(self.tally.done, 'scene')}: "
            f"{duration(self.tally.estimate)} for "
            f"{self.tally.done + self.tally.left}, until {until}"
        )

    def broken(self, why: str) -> WorkersLostError:
        tally = self.tally
        scenes = count_text(tally.total, "scene")
        found = f"lost, with {tally.before + tally.done} of {scenes} finished ({why})"
        accepted = "mend it and start again: the study goes on where it stopped"
        return WorkersLostError(self.workshop.name, found, accepted)


def lost_outcome(reason: str) -> Outcome:
    """Return the outcome of a scene that gave none."""
    return Outcome("failed", None, versions(), {"failures": [{"kind": "worker", "reason": reason}]})


def duration(seconds: float) -> str:
    """Return a time as people say it."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    if seconds < 6000.0:
        return f"{seconds / 60.0:.0f} min"
    return f"{seconds / 3600.0:.1f} h"
