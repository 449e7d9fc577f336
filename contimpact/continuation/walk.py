"""The loop: predict, correct, accept or shrink, locate events, until the branch ends."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import InputError
from . import arclength, crossing, loops
from .branch import End, EndKind, Event, Missed, Point, Points, Walk
from .crossing import Find, Meeting, Passes
from .events import Segment, TestFunction, find_events
from .interruption import Interrupted
from .march import Footing, Made, System, leaves
from .problem import Array, Evaluation, Problem
from .refusal import Refusal, Refused
from .settings import Settings
from .sign_changes import Sample, Stretch

SAME_SOLUTION = 1e-7
WIDEST_SPAN = 1e3
"""The natural size of the parameter is that of its range, at most this many times its start."""

OUTGROWN = 8.0
"""Lengths are measured anew where a natural size has grown by this factor."""

FEWEST, UNWATCHED, GROWTH, MARCHED = 2, 64, 4, 1024
"""Routine steps made at a time: at first where somebody watches and where nobody does, how the
number grows, and its ceiling."""

NARROWEST = 1e-12
"""A range narrower than this part of its limits cannot be walked in doubles."""

NEAR_LIMIT = 1e-9
"""A test function smaller than this part of its value one step before may vanish on a limit."""

AT_START = 1e-9
"""An event this near to a branch point a walk starts from is one of the branch it comes from."""

NO_CROSSING = 1e-9
"""A test function below this at a branch point a walk starts from vanishes because of it."""

Stop = Callable[[Point, Sequence[Event]], "tuple[End, Point] | None"]


def walk(
    problem: Problem, start: Array, direction: int, *, parameter: str,
    limits: tuple[float, float], tests: Sequence[TestFunction] = (),
    settings: Settings | None = None, tangent: Array | None = None, branching: bool = False,
    callback: Callable[[Point], bool | None] | None = None, stop: Stop | None = None,
    system: System | None = None, meeting: Find | None = None,
) -> Walk:  # fmt: skip
    """Follow a branch from a point in one direction until it ends.

    Parameters
    ----------
    problem : Problem
    start : ndarray of shape (n + 1,)
        A point near the branch; it is corrected at its own parameter value.
    direction : {+1, -1}
        The way the parameter first changes, or, where `tangent` is given, its sign.
    parameter : str
        Name of the free parameter, for messages.
    limits : (low, high)
        Range of the parameter; the branch ends exactly on a limit it reaches.
    tests : sequence of TestFunction
        Events to locate; what is not named is not evaluated.
    settings : Settings, optional
    tangent : ndarray of shape (n + 1,), optional
        Direction to leave in.
    branching : bool
        Whether `start` is a branch point, where `tangent` is one direction of several and test
        functions that vanish are not crossings.
    callback : callable, optional
        Called with every accepted point, before events are looked for; a true value stops the
        walk.
    stop : callable ``stop(point, events) -> (End, Point) or None``, optional
        Called with every accepted point and the events just before it; may end the walk, at the
        point it returns.
    system : System, optional
        The problem and its test functions in the plain form in which routine steps are made many
        at a time.
    meeting : callable ``meeting(problem, guess, scale) -> Meeting or None``, optional
        Solves for the place next to a point where two branches cross or pass each other; without
        it bisection decides.

    Returns
    -------
    Walk
        All points and events found, however it ended.

    Raises
    ------
    InputError
        For a start outside the limits, limits that are none, or another direction.
    Interrupted
        A `KeyboardInterrupt` that holds what was walked until then.
    """
    settings = settings or Settings()
    start = np.asarray(start, dtype=float)
    _check(start, direction, limits)
    walker = _Walker(
        problem, parameter, limits, list(tests), settings, callback, stop, branching, system
    )
    walker.passes.find = meeting
    try:
        return walker.run(start, direction, tangent)
    except KeyboardInterrupt:
        if not walker.points:
            raise
        raise Interrupted(walker.interrupted()) from None


def _check(start: Array, direction: int, limits: tuple[float, float]) -> None:
    low, high = limits
    if direction not in (1, -1):
        raise InputError("direction", f"found {direction!r}", "give +1 or -1")
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise InputError("limits", f"found ({low}, {high})", "give two finite numbers, low < high")
    if high - low < max(NARROWEST * max(abs(low), abs(high)), 1e-100):
        found = f"({low}, {high}) is as narrow as rounding"
        raise InputError("limits", found, "give a wider range")
    if not low <= start[-1] <= high:
        found = f"they do not hold the start, {start[-1]:.12g}"
        raise InputError("limits", found, "start within the limits")


@dataclass(eq=False)
class _Step:
    """What one attempt at a step gave: a point, perhaps the last one, or why it was refused."""

    point: Point | None
    refused: Refused | None = None
    ending: EndKind | None = None
    turned: float = 0.0
    first_correction: float = 0.0
    defect: float = 0.0


@dataclass(eq=False)
class _Walker:
    """One walk under way."""

    problem: Problem
    parameter: str
    limits: tuple[float, float]
    tests: list[TestFunction]
    settings: Settings
    callback: Callable[[Point], bool | None] | None
    stop: Stop | None
    branching: bool
    system: System | None
    points: Points = field(default_factory=Points)
    events: list[Event] = field(default_factory=list)
    missed: list[Missed] = field(default_factory=list)
    iterations: int = 0
    rejected: int = 0
    seconds_in_events: float = 0.0
    scale: Array = field(default_factory=lambda: np.ones(1))
    values: list[Array] = field(default_factory=list)
    before: Sample | None = None
    passes: Passes = field(default_factory=Passes)

    def run(self, start: Array, direction: int, tangent: Array | None) -> Walk:
        self.scale = self.sizes(start)
        reason = self.begin(start, direction, tangent)
        if reason:
            kind = EndKind.SINGULAR if self.points else EndKind.START
            return self.finished(self.end(kind, start[-1], why=reason))
        step = self.settings.step
        while len(self.points) < self.settings.max_points:
            narrow = self.near(self.points[-1]) is not None
            if self.system is not None and len(self.points) > 1 and not narrow:
                step, end = self.march(self.system, step)
                if end is not None:
                    return self.finished(end)
                if len(self.points) >= self.settings.max_points:
                    break
            self.grow()
            attempt, step = self.advance(step)
            here = self.points[-1]
            if attempt.point is None:
                return self.finished(self.refusal(here, attempt.refused))
            stop = self.callback is not None and self.callback(attempt.point)
            found = self.accept(here, attempt.point, attempt.ending)
            if self.stop is not None and (stopped := self.stop(attempt.point, found)):
                return self.finished(self.stopped(*stopped))
            if ending := attempt.ending or (EndKind.STOPPED if stop else None):
                return self.finished(self.end(ending))
            step = arclength.step_after(
                step, attempt.turned, attempt.first_correction, attempt.defect,
                self.settings.max_angle, self.settings.max_step,
            )  # fmt: skip
        return self.finished(self.end(EndKind.POINTS, limit=self.settings.max_points))

    def march(self, system: System, step: float) -> tuple[float, End | None]:
        """Make routine steps until one is not; returns the next step, and the end if it was met.

        A few are made first and then ever more at a time: those made beyond an end that `stop` or
        `callback` decide on are lost.
        """
        chunk = FEWEST if self.watched else UNWATCHED
        while (left := self.settings.max_points - len(self.points)) > 0:
            made = system.march(self.footing(step), self.settings, min(chunk, left))
            made = self.until_dip(made)
            self.iterations += made.iterations
            self.rejected += made.rejected
            end = self.put_down(made)
            if end is not None or made.unusual:
                return made.step, end
            step = made.step
            chunk = min(GROWTH * chunk, MARCHED)
            if self.grow():
                chunk = FEWEST if self.watched else UNWATCHED
        return step, None

    def sizes(self, unknowns: Array) -> Array:
        """The natural sizes of the unknowns at a point."""
        span = self.limits[1] - self.limits[0]
        if unknowns[-1] != 0.0:  # a range of many decades says nothing of the parameter's size
            span = min(span, WIDEST_SPAN * abs(float(unknowns[-1])))
        return self.problem.scale(unknowns, span)

    def grow(self) -> bool:
        """Measure lengths by larger sizes where the solution has outgrown those it started with."""
        here = self.points[-1]
        sizes = self.sizes(here.unknowns)
        if not np.any(sizes > OUTGROWN * self.scale):
            return False
        self.scale = np.maximum(self.scale, sizes)
        tangent = here.tangent / arclength.length(here.tangent, self.scale)
        self.points.end_with(replace(here, tangent=tangent))
        self.before = None
        return True

    def until_dip(self, made: Made) -> Made:
        """Routine steps up to one that may have led to another branch; see `Passes.refuse`."""
        behind = np.nan if self.before is None else self.points[-2].orientation
        values = np.concatenate([[behind, self.points[-1].orientation], made.block.orientations])
        lengths = np.diff(made.arclengths)
        found = crossing.dips(values[:-2], values[1:-1], lengths[:-1], lengths[1:])
        found &= (values[1:-1] >= 0.0) == (values[2:] >= 0.0)
        if self.passes.find is None or not np.any(found):
            return made
        return made.until(int(np.argmax(found)))

    @property
    def watched(self) -> bool:
        return self.callback is not None or self.stop is not None

    def footing(self, step: float) -> Footing:
        """Where the walk is, for routine steps to go on from."""
        behind = None if self.before is None else self.points[-2]
        return Footing(
            self.points[-1], behind, self.points[0].parameter, len(self.points), step, self.scale,
            self.limits, SAME_SOLUTION, _flat(self.values),
            _flat(self.values if self.before is None else self.before.values),
        )  # fmt: skip

    def put_down(self, made: Made) -> End | None:
        """Put points of routine steps down, with the events between them.

        Returns the end that `stop` or `callback` decide on.
        """
        for test in self.tests:
            test.evaluations += len(made)
        done, block, marked = 0, made.block.kept(), set(made.marked)
        for i in range(len(made)) if self.watched else made.marked:
            self.points.extend(block, done, i)
            point = block.point(i)
            asked = self.callback is not None and self.callback(point)
            found = self.events_on(made, i, point) if i in marked else []
            self.points.extend(block, i, i + 1)
            done = i + 1
            if self.stop is not None and (stopped := self.stop(point, found)):
                return self.stopped(*stopped)
            if asked:
                return self.end(EndKind.STOPPED)
        self.points.extend(block, done, len(made))
        if len(made):
            last = len(made) - 1
            self.values, self.before = self.seen(made, last).values, self.seen(made, last - 1)
        return None

    def stopped(self, end: End, last: Point) -> End:
        """Let the walk end at a point before the last one."""
        self.points.end_with(last)
        self.events = [e for e in self.events if e.point.arclength <= last.arclength]
        return end

    def seen(self, made: Made, i: int) -> Sample:
        """The test functions at the point of a routine step, from -2 for one before the footing."""
        return Sample(float(made.arclengths[i + 2]), _like(self.values, made.values[i + 2]))

    def events_on(self, made: Made, i: int, point: Point) -> list[Event]:
        """Locate the events on a routine step."""
        began = time.perf_counter()
        segment = self.segment(self.points[-1], point)
        earlier = self.seen(made, i - 2) if i > 0 else self.before
        later = self.seen(made, i + 1) if i + 1 < len(made) else None
        stretch = Stretch(self.seen(made, i - 1), self.seen(made, i), earlier, later)
        found, missed = find_events(self.tests, segment, stretch)
        self.events += found
        self.missed += missed
        self.seconds_in_events += time.perf_counter() - began
        return found

    def accept(self, here: Point, new: Point, ending: EndKind | None) -> list[Event]:
        """Put a point down, and the events between it and the one before; returns these.

        No walk comes from beyond a limit of the range: a zero on it, within its error, is found
        from inside.
        """
        before = time.perf_counter()
        values = [test.at(new) for test in self.tests]
        if here is self.points[0] and self.branching:
            self.values = _leaving(self.values, values)
        elif here is self.points[0] and here.parameter in self.limits:
            self.values = _apart(self.values, values)
        if ending is EndKind.RANGE:
            values = _apart(values, self.values)
        segment = self.segment(here, new)
        left, right = Sample(here.arclength, self.values), Sample(new.arclength, values)
        found, missed = find_events(self.tests, segment, Stretch(left, right, self.before))
        self.before = left
        found = [e for e in found if self.in_range(e) and not self.at_start(e)]
        self.events += found
        self.missed += missed
        self.values = values
        if new.arclength > here.arclength:
            self.points.append(new)
        self.seconds_in_events += time.perf_counter() - before
        return found

    def in_range(self, event: Event) -> bool:
        """Whether an event lies within the limits, or within its error of one."""
        low, high = self.limits
        slack = event.error + 4.0 * arclength.EPSILON * abs(event.parameter)
        return low - slack <= event.parameter <= high + slack

    def at_start(self, event: Event) -> bool:
        """Whether an event is at the branch point the walk left: rounding finds that again."""
        return self.branching and event.point.arclength < AT_START

    def begin(self, start: Array, direction: int, tangent: Array | None) -> str:
        """Put the first point down; returns why it could not be, or nothing."""
        switched = tangent is not None
        fixed = np.zeros(len(start))
        fixed[-1] = 1.0
        row = fixed if tangent is None else tangent / self.scale**2
        result = arclength.correct(self.problem, start, row, self.scale, self.settings)
        self.iterations += result.iterations
        if result.evaluation is None:
            return result.reason
        if tangent is None:
            tangent = arclength.first_tangent(result.evaluation.jacobian, self.scale)
            if tangent is None:
                self.points.append(Point(result.evaluation, fixed, 0.0, 0.0, result.iterations))
                return "two directions leave the first point"
            direction = direction if tangent[-1] >= 0.0 else -direction
        else:
            tangent = tangent / arclength.length(tangent, self.scale)
        first = Point(result.evaluation, direction * tangent, np.nan, 0.0, result.iterations)
        if not self.branching:
            regular = self.after(first, result.evaluation, result.iterations)
            if regular is None:
                return "the tangent is not defined"
            first = regular
        self.points.append(first)
        self.values = [test.at(first) for test in self.tests]
        if switched and not self.branching:  # on a zero, within rounding: exactly on it
            self.values = [np.where(np.abs(v) < 1e-12, 0.0, v) for v in self.values]
        if self.branching:
            self.values = [np.where(np.abs(v) < NO_CROSSING, 0.0, v) for v in self.values]
        return ""

    def advance(self, step: float) -> tuple[_Step, float]:
        """Try steps of decreasing length until one is accepted or the floor is reached."""
        while True:
            here = self.sharpened()
            attempt = self.attempt(here, step)
            if attempt.point is not None:
                return attempt, step
            self.rejected += 1
            floor = self.numerics(here).min_step
            if step > floor:
                step = max(0.5 * step, floor)
                continue
            other = self.passes.look(self.problem, here, self.scale, self.settings)
            if other <= floor:
                return attempt, step
            step = other

    def attempt(self, here: Point, step: float) -> _Step:
        """Predict, correct, and accept if the branch was not left."""
        guess = here.unknowns + step * self.direction(here)
        row = here.tangent / self.scale**2
        result = arclength.correct(self.problem, guess, row, self.scale, self.numerics(here))
        self.iterations += result.iterations
        if result.evaluation is None:
            return _Step(None, result.refused)
        new = self.after(here, result.evaluation, result.iterations)
        if new is None:
            return _Step(None, Refused(Refusal.NO_TANGENT))
        turned = arclength.angle(here.tangent, new.tangent, self.scale)
        if turned > self.settings.max_angle:
            return _Step(None, Refused(Refusal.TURNS, turned))
        tangents = here.tangent, new.tangent
        off = 0.0
        if self.numerics(here) is self.settings:  # else steps are as short as points are exact
            off = arclength.defect(here.unknowns, new.unknowns, *tangents, self.scale)
        if off > arclength.LARGEST_DEFECT * self.settings.max_angle:
            return _Step(None, Refused(Refusal.BENDS, off))
        if leaves(here.unknowns, new.unknowns, *tangents, self.scale, *self.limits):
            return _Step(None, Refused(Refusal.LEAVES))
        before = self.points[-2] if self.before is not None else None
        if refused := self.passes.refuse(self.segment(here, new), before):
            return _Step(None, refused)
        ending = None
        if not self.limits[0] <= new.parameter <= self.limits[1]:
            new, ending = self.on_limit(here, new), EndKind.RANGE
        elif closing := self.closing(here, new):
            new, ending = closing, EndKind.CLOSED
        refused = None if new else Refused(Refusal.NO_LIMIT)
        return _Step(new, refused, ending, turned, result.first_step, off)

    def near(self, here: Point) -> Meeting | None:
        """Where branches meet near a point, if the walk had to be careful there."""
        return self.passes.near(here, self.scale)

    def numerics(self, here: Point) -> Settings:
        """The settings at a point: sharper where branches meet."""
        return self.passes.numerics(here, self.scale, self.settings)

    def sharpened(self) -> Point:
        """The last point, made as exact as the next one is to be."""
        here = self.points[-1]
        wanted = self.numerics(here)
        if wanted is self.settings or len(self.points) < 2:
            return here
        if np.max(np.abs(here.evaluation.residual)) <= wanted.tolerance:
            return here
        row = here.tangent / self.scale**2
        result = arclength.correct(self.problem, here.unknowns, row, self.scale, wanted)
        new = result.evaluation and self.after(here, result.evaluation, here.iterations)
        if new:
            self.points.end_with(replace(new, arclength=here.arclength))
        return self.points[-1]

    def direction(self, here: Point) -> Array:
        """The unit vector along which the next point is guessed."""
        if self.settings.predictor == "tangent" or len(self.points) < 2:
            return here.tangent
        chord = here.unknowns - self.points[-2].unknowns
        return chord / arclength.length(chord, self.scale)

    def on_limit(self, here: Point, beyond: Point) -> Point | None:
        """The point of the branch on the limit that was passed."""
        low, high = self.limits
        limit = low if beyond.parameter < low else high
        fraction = (limit - here.parameter) / (beyond.parameter - here.parameter)
        guess = here.unknowns + fraction * (beyond.unknowns - here.unknowns)
        guess[-1] = limit
        fixed = np.zeros(len(guess))
        fixed[-1] = 1.0
        result = arclength.correct(self.problem, guess, fixed, self.scale, self.settings)
        self.iterations += result.iterations
        if result.evaluation is None:
            return None
        new = self.after(here, result.evaluation, result.iterations)
        if new is None or new.arclength - here.arclength > beyond.arclength - here.arclength:
            return None
        turned = arclength.angle(here.tangent, new.tangent, self.scale)
        return new if turned <= self.settings.max_angle else None

    def closing(self, here: Point, new: Point) -> Point | None:
        """The start again, if this step passed it in the direction it was left in."""
        if len(self.points) < 4:
            return None
        return loops.closing(self.segment(here, new), self.points[0], SAME_SOLUTION)

    def after(self, here: Point, evaluation: Evaluation, iterations: int) -> Point | None:
        return arclength.point_after(here, evaluation, iterations, self.scale)

    def segment(self, left: Point, right: Point) -> Segment:
        return Segment(self.problem, left, right, self.scale, self.settings)

    def refusal(self, here: Point, refused: Refused | None) -> End:
        """The end of a branch on which no further step was accepted."""
        assert refused is not None
        near, floor = self.near(here), self.numerics(here).min_step
        if near is None or near.crosses or refused.kind is not EndKind.STEP:
            return self.end(refused.kind, why=str(refused), floor=floor)
        place = near.parameter
        return self.end(EndKind.NEAR_MISS, why=str(refused), near=str(near), place=place)

    def end(self, kind: EndKind, value: float | None = None, **details: object) -> End:
        value = self.points[-1].parameter if value is None else float(value)
        return End.of(kind, self.parameter, value, **details)

    def interrupted(self) -> Walk:
        """The walk as far as it has come, without events of a step that was not yet made."""
        reached = self.points[-1].arclength
        self.events = [event for event in self.events if event.point.arclength <= reached]
        return self.finished(self.end(EndKind.INTERRUPTED))

    def finished(self, end: End) -> Walk:
        return Walk(
            self.points, self.events, end, self.missed, self.iterations, self.rejected,
            self.seconds_in_events, self.passes.notes(self.parameter),
        )  # fmt: skip


def _like(lists: list[Array], flat: Array) -> list[Array]:
    """A vector cut into pieces as long as the lists."""
    pieces, first = [], 0
    for values in lists:
        pieces.append(flat[first : first + len(values)])
        first += len(values)
    return pieces


def _flat(values: list[Array]) -> Array:
    return np.concatenate(values) if values else np.zeros(0)


def _leaving(starts: list[Array], others: list[Array]) -> list[Array]:
    """Give what vanishes or has no value at a branch point the sign it leaves with."""
    tiny = np.finfo(float).tiny
    return [
        np.where((start == 0.0) | np.isnan(start), np.sign(other) * tiny, start)
        for start, other in zip(starts, others, strict=True)
    ]


def _apart(zeros: list[Array], others: list[Array]) -> list[Array]:
    """Give what may vanish on a limit the sign the other values do not have."""
    tiny = np.finfo(float).tiny
    return [
        np.where(
            (np.abs(z) <= NEAR_LIMIT * np.abs(other)) & (other != 0.0),
            np.where(other >= 0.0, -tiny, tiny),
            z,
        )
        for z, other in zip(zeros, others, strict=True)
    ]
