"""The walk along a branch, both ways, to where it ends, closes or is interrupted."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Required, TypedDict, TypeVar, cast

import numpy as np

from ..arrays import Array
from ..errors import InputError
from .branch import (
    Block,
    End,
    EndKind,
    Evaluation,
    Event,
    MissedEvent,
    Point,
    Points,
    Problem,
    Refusal,
    RefusalDetails,
    TestFunction,
    Walk,
)
from .corrector import (
    EPSILON,
    TWO_DIRECTIONS,
    Arc,
    angle,
    correct,
    first_point,
    first_tangent,
    hermite,
    inner_product,
    length,
    point_after,
    residual_sizes,
    signs_on_leaving,
    test_values_at_start,
)
from .crossing_branches import Find, Meeting, MeetingRecord
from .events import find_events
from .settings import Settings, require_width
from .sign_changes import Samples, Stretch
from .step import (
    FEWEST_ROUND,
    FIRST_POINT,
    LAST_POINT,
    Backend,
    Batch,
    DenseBackend,
    Notice,
    Position,
    Proposal,
    shorten_step,
)

# Interruptions from the keyboard: what was walked until then is kept.
#
# A walk that is interrupted raises `WalkInterrupt`, a `KeyboardInterrupt` with what was walked.
# Whoever does not know it leaves as at any interruption; whoever makes a branch of walks catches it
# with `keep_interrupted`.

T = TypeVar("T")


class WalkInterrupt(KeyboardInterrupt):
    """An interruption from the keyboard, with the `walk` until then."""

    def __init__(self, walk: Walk) -> None:
        super().__init__()
        self.walk = walk


def keep_interrupted(walk: Callable[[], Walk]) -> Walk:
    """Return a walk; one that is interrupted, as far as it has come."""
    try:
        return walk()
    except WalkInterrupt as interruption:
        return interruption.walk


def both_ways(
    first: Walk, parameter: str, walk: Callable[[Point | None], Walk]
) -> tuple[Walk, Walk]:
    """Return the walk in the other direction, and the first one.

    There is none on a loop, and none after an interruption. Where the first one ended with its
    points, or on request, the other one may come round to this place, given to it as its goal: then
    both have closed.
    """
    start = first.points[:1]
    if first.end.kind is EndKind.CLOSED:
        return Walk(start, (), first.end), first
    if first.end.kind is EndKind.INTERRUPTED:
        end = End.of(EndKind.INTERRUPTED, parameter, start[0].parameter)
        return Walk(start, (), end), first
    cut = first.end.kind in (EndKind.POINTS, EndKind.STOPPED) and len(first.points) > 1
    goal = Points([first.points[-1]]).moved(-1.0, 0.0)[0] if cut else None
    other = keep_interrupted(lambda: walk(goal))
    closed = other.end.kind is EndKind.CLOSED and goal is not None
    return other, replace(first, end=other.end) if closed else first


def is_interrupted(ends: Iterable[End]) -> bool:
    """Whether one of the ends of a branch is an interruption."""
    return any(end.kind is EndKind.INTERRUPTED for end in ends)


def reraise_interruption(ends: Iterable[End]) -> None:
    """Let an interruption go on that has ended a branch or a curve, now that this is kept or not
    wanted."""
    if is_interrupted(ends):
        raise KeyboardInterrupt


def retry_interrupted(make: Callable[[], T]) -> T:
    """Return what is made, begun again if it is interrupted.

    For what takes a moment and without which long work would be lost; a second interruption leaves.
    """
    try:
        return make()
    except KeyboardInterrupt:
        return make()


# The range of the free parameter, and the points on its limits.

NEAR_LIMIT = 1e-9
"""A test function smaller than this part of its value one step before may vanish on a limit."""


ON_LIMIT = 1e-9
"""Part of the range by which a start beyond a limit, as an event found there, lies on it."""


def checked(start: Array, direction: int, limits: tuple[float, float]) -> Array:
    """Return the start within the range; `InputError` if this is none or does not hold it."""
    low, high = limits
    if direction not in (1, -1):
        raise InputError("direction", f"found {direction!r}", "give +1 or -1")
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise InputError("limits", f"found ({low}, {high})", "give two finite numbers, low < high")
    require_width(low, high, "limits")
    slack = ON_LIMIT * (high - low)
    if not low - slack <= start[-1] <= high + slack:
        found = f"they do not hold the start, {start[-1]:.12g}"
        raise InputError("limits", found, "start within the limits")
    return np.append(start[:-1], np.clip(start[-1], low, high))


def guess_on_limit(step: Arc, limits: tuple[float, float]) -> Array:
    """Return where a step passed a limit, along its chord."""
    here, beyond = step.left, step.right
    low, high = limits
    limit = low if beyond.parameter < low else high
    fraction = (limit - here.parameter) / (beyond.parameter - here.parameter)
    guess = here.unknowns + fraction * (beyond.unknowns - here.unknowns)
    guess[-1] = limit
    return np.asarray(guess)


def lies_on_step(new: Point, step: Arc) -> bool:
    """Whether a point on a limit lies on the step that passed it."""
    turned = angle(step.left.tangent, new.tangent, step.scale)
    return new.arclength <= step.right.arclength and turned <= step.settings.max_angle


def is_at(event: Event, limit: float) -> bool:
    """Whether an event lies on a limit, within its error."""
    slack = event.error + 4.0 * EPSILON * abs(event.parameter)
    return abs(event.parameter - limit) <= slack


@dataclass(frozen=True)
class Unsolved:
    """A guess, in the place of an evaluation."""

    unknowns: Array


def separate_signs(zeros: Array, others: Array) -> Array:
    """Give what may vanish on a limit the sign the other values do not have."""
    tiny = np.finfo(float).tiny
    near = (np.abs(zeros) <= NEAR_LIMIT * np.abs(others)) & (others != 0.0)
    return np.where(near, np.where(others >= 0.0, -tiny, tiny), zeros)


# When a branch is closed: a walk passes its start again, in the direction it was left in.
#
# A problem may have images of its solutions that stand for the same one (an orbit's shifts by whole
# periods). A walk that comes to an image of its start has come round if it goes on along the image
# of its own way; if it comes from the other side, it has turned back on its way, and has not.

RETURNED = 1e-6
"""How near the values of test functions are that stand for the same one."""

PART = 1e-6
"""The part of a tangent that is followed to an image."""


def closing_start(arc: Arc, first: Point, same: float) -> Point | None:
    """Return the start of a walk, solved for afresh from a step that passes it; None otherwise.

    Points nearer than `same` are the same solution.
    """
    here, new, problem, scale = arc.left, arc.right, arc.problem, arc.scale
    for near in (here, new):
        start = near.unknowns - problem.difference(near.unknowns, first.unknowns)
        leaving = image_of_tangent(problem, start, first)
        if not passes_point(arc, start, leaving):
            continue
        guess = where_passing(arc, start, leaving)
        found = correct(problem, guess, leaving / scale**2, scale, arc.settings)
        if found.evaluation is not None:
            apart = problem.difference(found.evaluation.unknowns, first.unknowns)
            if length(apart, scale) <= same:
                return point_after(here, found.evaluation, found.iterations, scale)
    return None


def points_before_start(problem: Problem, points: Points, again: Array, scale: Array) -> Points:
    """Return the points of a walk before it passed its start, and the start at their end.

    `again` is the second point of the walk, reached once more. Where the start is a branch point,
    no point is solved for there.
    """
    first = points[0]
    start = again - problem.difference(again, first.unknowns)
    leaving = image_of_tangent(problem, start, first)
    last = len(points) - 1
    while last > 1 and inner_product(points[last].unknowns - start, leaving, scale) >= 0.0:
        last -= 1
    here, tangent = points[last], leaving / length(leaving, scale)
    place = here.arclength + length(start - here.unknowns, scale)
    point = Point(problem.evaluate(start), tangent, here.orientation, place, 0)
    return Points([*points[: last + 1].pieces, point])


def closed_test_values(values: Sequence[Array], start: Sequence[Array]) -> Array:
    """Return the test functions where a walk has come round, as they were at its start.

    Rounding must not decide whether an event at the start is found as the walk leaves or as it
    returns. At an image of the start the values of a function stand in another order: each becomes
    the nearest one.
    """
    found = []
    for here, first in zip(values, start, strict=True):
        same = np.abs(here - first) <= RETURNED
        apart = np.abs(here[:, None] - np.where(np.isnan(first), np.inf, first))
        nearest = first[np.argmin(apart, axis=1)] if len(here) else first
        aligned = np.where(np.abs(here - nearest) <= RETURNED, nearest, here)
        found.append(np.where(same, first, aligned))
    return np.concatenate([*found, np.zeros(0)])


def image_of_tangent(problem: Problem, start: Array, first: Point) -> Array:
    """Return the tangent of the first point as it is at an image of it."""
    moved = problem.difference(start, first.unknowns + PART * first.tangent)
    return -moved / PART


def where_passing(arc: Arc, start: Array, leaving: Array) -> Array:
    """Return where the cubic between both ends of a step passes beside a point.

    From there Newton leads back to the walk's own branch, and to the point only if it is on it.
    """
    here, new, scale = arc.left, arc.right, arc.scale
    behind, beyond = (inner_product(end.unknowns - start, leaving, scale) for end in (here, new))
    span = new.arclength - here.arclength
    beside = hermite(here, new, span, behind / (behind - beyond))
    along = inner_product(beside - start, leaving, scale) / inner_product(leaving, leaving, scale)
    return beside - along * leaving


def passes_point(arc: Arc, start: Array, leaving: Array) -> bool:
    """Whether a step passes a point in a direction."""
    here, new, scale = arc.left, arc.right, arc.scale
    after = new.unknowns - start
    stepped = length(new.unknowns - here.unknowns, scale)
    return (
        inner_product(here.unknowns - start, leaving, scale) < 0.0
        and inner_product(after, leaving, scale) >= 0.0
        and inner_product(new.tangent, leaving, scale) > 0.0
        and length(after, scale) <= 1.5 * stepped
    )


FINER, WIDER = "a smaller min_step or another free parameter", "a larger max_angle"
LOOSER = "a tolerance above {rounding:.1g}, the rounding of the equations there,"
"""What may carry on where no step is accepted."""

STRAIGHT = 1e-3
"""Where the smallest step turns by less, nothing but a `max_angle` below that refuses it."""

SAME_SOLUTION = 1e-7
WIDEST_SPAN = 1e3
"""The natural size of the parameter is that of its range, at most this many times its start."""

OUTGROWN = 8.0
"""Lengths are measured anew where a natural size has grown by this factor."""

UNBOUNDED, STILL = 1e6, 1e-9
"""How many times its size at the start a solution has that grows without bound, and the part of the
parameter's size by which this changes while the solution outgrows itself once more."""

SHORT_OF = (0.99, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4)
"""Parts of the way to an end up to which it is seen whether an event is missed before it; nearer to
an end where branches cross, no point may be reached."""
SURE = 0.9
"""Part of the way at which a value that has its sign tells that there is no zero before the end."""
NEARLY = 0.999
"""Part of such a part at which a value is about the same, but for rounding."""
VANISHED = 1e-4
"""Part of a value before it of which the sign is that of rounding: a cubic zero has less at .99."""
SAME_POWER = 0.25
"""How far powers may differ that are one: between two zeros and the end values are smaller."""

AT_START = 1e-9
"""An event this near to a branch point a walk starts from is one of the branch it comes from."""

FEWEST, UNWATCHED, GROWTH, LARGEST = 2, 64, 4, 1024
"""Steps asked for at a time: at first where somebody watches and where nobody does, how the number
grows, and its ceiling. Points beyond an end by a policy or `callback` are discarded."""


class Policy:
    """What a walk is subject to besides its problem; each hook may be overridden."""

    at_events_only: ClassVar[bool] = False
    """Whether `accepted` has only to be called with the first point and those behind events."""

    def limits(self, limits: tuple[float, float]) -> tuple[float, float]:
        """Return the part of the range in which the walk stays."""
        return limits

    def accepted(self, point: Point, events: Sequence[Event]) -> tuple[End, Point] | None:
        """Return the end of the walk, and the point at which it ends, if it has come; called with
        every accepted point and the events just before it."""
        return None

    def ended(self, walk: Walk) -> Walk:
        """Return the walk as it is kept."""
        return walk


class Options(TypedDict, total=False):
    """What `walk` is asked besides, for those who hand it on."""

    limits: Required[tuple[float, float]]
    settings: Settings | None
    tangent: Array | None
    branching: bool
    callback: Callable[[Point], bool | None] | None
    progress: Callable[[int, float], None] | None
    goal: Point | None


def walk(
    problem: Problem,
    start: Array,
    direction: int,
    *,
    parameter: str,
    limits: tuple[float, float],
    tests: Sequence[TestFunction] = (),
    settings: Settings | None = None,
    tangent: Array | None = None,
    branching: bool = False,
    callback: Callable[[Point], bool | None] | None = None,
    progress: Callable[[int, float], None] | None = None,
    goal: Point | None = None,
    policies: Sequence[Policy] = (),
    backend: Backend | None = None,
    meeting: Find | None = None,
) -> Walk:
    """Follow a branch from a point in one direction until it ends.

    Parameters
    ----------
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
    tangent : ndarray of shape (n + 1,), optional
        Direction to leave in.
    branching : bool
        Whether `start` is a branch point, where `tangent` is one direction of several and test
        functions that vanish are not crossings.
    callback : callable, optional
        Called with every accepted point, before events are looked for; a true value stops the
        walk.
    progress : callable, optional
        Called with the number of points just recorded, and where the last of them is.
    goal : Point, optional
        Another point than the start at which the branch is closed, its tangent in the direction in
        which it is passed.
    policies : sequence of Policy
        Asked in turn: the first that ends the walk does so.
    backend : Backend, optional
        The problem as steps ask for it; by default on dense linear algebra.
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
    WalkInterrupt
        A `KeyboardInterrupt` that holds what was walked until then.
    """
    settings = settings or Settings()
    for policy in policies:
        limits = policy.limits(limits)
    start = checked(np.asarray(start, dtype=float), direction, limits)
    ending = [p for p in policies if type(p).accepted is not Policy.accepted]
    backend, watching = backend or DenseBackend(problem), (callback, progress, ending)
    walker = _Walker(
        problem, backend, parameter, limits, list(tests), settings, *watching, branching, goal
    )
    walker.passes.find = meeting
    try:
        found = walker.run(start, direction, tangent)
    except KeyboardInterrupt:
        if not walker.points:
            raise
        raise WalkInterrupt(walker.interrupted()) from None
    for policy in policies:
        found = policy.ended(found)
    return found


@dataclass(eq=False)
class _Walker:
    """One walk under way."""

    problem: Problem
    backend: Backend
    parameter: str
    limits: tuple[float, float]
    tests: list[TestFunction]
    settings: Settings
    callback: Callable[[Point], bool | None] | None
    progress: Callable[[int, float], None] | None
    ending: Sequence[Policy]
    branching: bool
    goal: Point | None
    points: Points = field(default_factory=Points)
    events: list[Event] = field(default_factory=list)
    missed: list[MissedEvent] = field(default_factory=list)
    iterations: int = 0
    rejected: int = 0
    seconds_in_events: float = 0.0
    scale: Array = field(default_factory=lambda: np.ones(1))
    seen: Samples = field(default_factory=lambda: Samples.of(0.0, []))
    passes: MeetingRecord = field(default_factory=MeetingRecord)
    left_with: list[Array] = field(default_factory=list)
    leapt: int = 0
    first: Array = field(default_factory=lambda: np.ones(1))
    outgrown: list[float] = field(default_factory=list)
    """`first`, `outgrown`: the sizes at the start, and where along the parameter they have been
    outgrown."""
    compared: float = np.nan
    """Arclength of the point whose sizes have last been compared with `scale`."""

    def run(self, start: Array, direction: int, tangent: Array | None) -> Walk:
        self.first = self.scale = self.sizes(start)
        reason = self.begin(start, direction, tangent)
        if reason:
            kind = EndKind.SINGULAR if self.points else EndKind.START
            return self.finished(self.end(kind, start[-1], why=reason))
        step, most = self.settings.step, self.fewest
        longest = math.ceil(OUTGROWN / self.settings.max_step)  # until sizes may have grown
        while (left := self.settings.max_points - len(self.points)) > 0:
            if len(self.points) > 1 and self.grow():
                if self.unbounded:
                    times = float(np.max(self.scale[:-1] / self.first[:-1]))
                    return self.finished(self.end(EndKind.UNBOUNDED, times=times))
                most = self.fewest
            leaves = self.branching and len(self.points) == 1
            careful = leaves or self.near(self.points[-1]) is not None
            batch = self.advance(step, 1 if careful else min(most, longest, left))
            if careful and batch.piece is not None:
                reached = Points([batch.piece])[-1]
                other = self.instead(step, self.arc(self.points[-1], reached))
                if other:
                    self.rejected += 1
                    step = other
                    continue
            step, end = self.follow(batch)
            if end is not None:
                return self.finished(end)
            most = min(GROWTH * most, LARGEST) if batch.routine and not careful else self.fewest
        return self.finished(self.end(EndKind.POINTS, limit=self.settings.max_points))

    def begin(self, start: Array, direction: int, tangent: Array | None) -> str:
        """Record the first point; returns why none can follow, or nothing."""
        if tangent is None and not self.branching:
            up = np.zeros(len(start))
            up[-1] = direction * self.scale[-1]
            guess = Point(cast(Evaluation, Unsolved(start)), up, np.nan, 0.0, 0)
            piece = self.solved(guess, start, FIRST_POINT)
            if piece is not None:
                self.points.extend(piece, 0, 1)
                self.seen = Samples.of(0.0, [test.on(piece)[0] for test in self.tests])
                return ""
        first = first_point(
            self.problem, start, direction, tangent, self.branching, self.scale, self.settings
        )
        self.iterations += first.iterations
        if first.point is None:
            return first.reason
        self.points.append(first.point)
        if not first.reason:
            values = [test.at(first.point) for test in self.tests]
            self.seen = Samples.of(
                0.0, test_values_at_start(values, self.branching, tangent is not None)
            )
        return first.reason

    def solved(self, here: Point, guess: Array, task: int) -> Point | Block | None:
        """The point at the parameter value of a guess, where the backend finds it."""
        place = here, (), here.parameter, len(self.points), self.settings.step, self.scale
        position = Position(
            *place, self.limits, SAME_SOLUTION, self.settings, False, False, task, guess
        )
        batch = self.backend.advance(position, 1)
        self.iterations += batch.iterations
        return batch.piece

    @property
    def looking(self) -> bool:
        """Whether every point is shown to somebody."""
        return self.callback is not None or not all(p.at_events_only for p in self.ending)

    @property
    def fewest(self) -> int:
        """How many steps to ask for at first."""
        return FEWEST if self.callback or self.progress or self.ending else UNWATCHED

    def sizes(self, unknowns: Array) -> Array:
        """The natural sizes of the unknowns at a point."""
        span = self.limits[1] - self.limits[0]
        if unknowns[-1] != 0.0:  # a range of many decades says nothing of the parameter's size
            span = min(span, WIDEST_SPAN * abs(float(unknowns[-1])))
        return self.problem.scale(unknowns, span)

    def grow(self) -> bool:
        """Measure lengths by larger sizes where the solution has outgrown those it started with."""
        here = self.points[-1]
        if here.arclength == self.compared:
            return False
        self.compared, sizes = here.arclength, self.sizes(here.unknowns)
        if not np.any(sizes > OUTGROWN * self.scale):
            return False
        self.scale = np.maximum(self.scale, sizes)
        tangent = here.tangent / length(here.tangent, self.scale)
        self.points.end_with(replace(here, tangent=tangent))
        self.seen = self.seen.alone()
        self.outgrown.append(here.parameter)
        return True

    @property
    def unbounded(self) -> bool:
        """Whether the solution grows alone, the parameter changing less and less."""
        if not np.any(self.scale[:-1] > UNBOUNDED * self.first[:-1]):
            return False
        before, last = np.abs(np.diff(self.outgrown[-3:])).tolist()
        return bool(last < 0.5 * before and last < STILL * self.scale[-1])

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
        units = residual_sizes(self.problem, self.scale, here.evaluation)
        if np.max(np.abs(here.evaluation.residual) / units) <= wanted.tolerance:
            return here
        found = correct(
            self.problem, here.unknowns, here.tangent / self.scale**2, self.scale, wanted
        )
        if found.evaluation is not None:
            new = point_after(here, found.evaluation, here.iterations, self.scale)
            if new is not None:
                self.points.end_with(replace(new, arclength=here.arclength))
        return self.points[-1]

    def advance(self, step: float, most: int) -> Batch:
        """Take steps from the last point."""
        here = self.sharpened()
        numerics = self.numerics(here)
        places = range(-min(3, len(self.points)), -1) if self.seen.follows else ()
        before = [self.points[i] for i in places]
        count = len(self.points) + (0 if self.goal is None else int(FEWEST_ROUND))
        place = here, before, self.mark.parameter, count, step, self.scale
        judged = numerics is self.settings, self.passes.find is not None
        position = Position(*place, self.limits, SAME_SOLUTION, numerics, *judged)
        batch = self.backend.advance(position, most)
        self.iterations += batch.iterations
        self.rejected += batch.rejected
        return batch

    def follow(self, batch: Batch) -> tuple[float, End | None]:
        """Record what was made, and judge what was not; returns the next step, or the end."""
        if batch.piece is not None:
            end = self.record(batch.piece)
            if end is not None:
                return batch.step, end
        last = batch.proposal is not None and Notice.BEYOND in batch.proposal.notices
        if batch.routine or (batch.piece is not None and not last and self.grow()):
            return batch.step, None
        if batch.proposal is None:
            return self.look_about(batch.step, batch.refused)
        return self.judge(batch.step, batch.proposal)

    def judge(self, step: float, proposal: Proposal) -> tuple[float, End | None]:
        """Accept a proposed step, perhaps as the last one, or refuse it."""
        here = self.points[-1]
        arc = self.arc(here, proposal.point)
        refused = self.passes.refuse(arc, proposal.notices)
        if refused is None and Notice.BEYOND in proposal.notices:
            piece = self.solved(here, guess_on_limit(arc, self.limits), LAST_POINT)
            last = None if piece is None else Points([piece])[0]
            if piece is not None and last is not None and lies_on_step(last, arc):
                if last.arclength > here.arclength:
                    return step, self.record(piece, EndKind.RANGE)
                return step, self.end(EndKind.RANGE)
            crossing = self.crossing_on_limit(arc, proposal.piece)
            if crossing is not None:
                return step, self.record(crossing, EndKind.RANGE)
            refused = RefusalDetails(Refusal.NO_LIMIT)
        if refused is None:
            start = self.closing(arc) if Notice.NEAR_START in proposal.notices else None
            if start is not None:
                return step, self.record(start, EndKind.CLOSED)
            return proposal.next_step, self.record(proposal.piece)
        self.rejected += 1
        if other := self.instead(step, arc):
            return other, None
        floor = self.numerics(here).min_step
        return (shorten_step(step, floor), None) if step > floor else self.look_about(step, refused)

    def crossing_on_limit(self, arc: Arc, piece: Point | Block) -> Point | None:
        """The point on a limit at which a step passes an event, if there is one: where branches
        cross, none is solved for."""
        seen = self.tested(piece, Points([piece]), None)
        marked = seen.noteworthy(self.backend.look)
        found, _ = find_events(self.tests, arc, seen.stretch(0, marked[0])) if marked else ([], [])
        for event, limit in itertools.product(found, self.limits):
            if is_at(event, limit):
                unknowns = np.append(event.point.unknowns[:-1], limit)
                return arc.event_point(self.problem.evaluate(unknowns), event.point.iterations)
        return None

    def instead(self, step: float, arc: Arc) -> float:
        """The step to try instead of one that ends at a point hidden by a crossing: first one
        that passes the crossing, then shorter ones; zero where the point may be taken."""
        leap, floor = self.passes.leap(arc), self.numerics(arc.left).min_step
        if leap and self.leapt != len(self.points):
            self.leapt = len(self.points)
            return max(leap, floor)
        return shorten_step(step, floor) if leap and step > floor else 0.0

    def look_about(self, step: float, refused: RefusalDetails | None) -> tuple[float, End | None]:
        """Go on towards a meeting of branches next to a point from which no step leads, or end."""
        here = self.points[-1]
        other = self.passes.look(self.problem, here, self.scale, self.settings)
        if other > self.numerics(here).min_step:
            return other, None
        return step, self.refusal(here, refused)

    @property
    def mark(self) -> Point:
        """What is passed where the branch is closed: the goal, the start, or, where that is a
        branch point and no point is solved for there, the point after it."""
        if self.goal is not None:
            return self.goal
        return self.points[1 if self.branching and len(self.points) > 1 else 0]

    def closing(self, step: Arc) -> Point | None:
        """The start again, if this step passed it in the direction it was left in, or the goal.

        Points beyond it are discarded.
        """
        again = closing_start(step, self.mark, SAME_SOLUTION)
        if again is None or not self.branching or self.goal is not None:
            return again
        points = points_before_start(self.problem, self.points, again.unknowns, self.scale)
        start = points[-1]
        if len(points) <= len(self.points):
            self.points = points[:-1]
            here = self.points[-1]
            self.events = [e for e in self.events if e.point.arclength <= here.arclength]
            self.seen = Samples.of(here.arclength, [test.at(here) for test in self.tests])
        return start

    def arc(self, left: Point, right: Point) -> Arc:
        return Arc(self.problem, left, right, self.scale, self.settings)

    def record(self, piece: Point | Block, ending: EndKind | None = None) -> End | None:
        """Record points with the events between them; returns the end if it has come.

        That is the one that was to follow, or one that a policy or `callback` decides on.
        """
        new = Points([piece])
        seen = self.tested(piece, new, ending)
        marked = seen.noteworthy(self.backend.look)
        done, first = 0, {0} if self.ending and len(self.points) == 1 else set[int]()
        for i in range(len(new)) if self.looking else sorted(first | marked.keys()):
            self.points.extend(piece, done, i)
            point = new[i]
            asked = self.callback is not None and self.callback(point)
            around, known = seen.stretch(i, marked[i]) if i in marked else None, len(self.missed)
            found = self.events_before(point, around, ending) if around is not None else []
            self.points.extend(piece, i, i + 1)
            done = i + 1
            for policy in self.ending:
                if stopped := policy.accepted(point, found):
                    if len(self.points) > 1:
                        self.forget_past(known, self.arc(self.points[-2], point), stopped[1])
                    return self.stopped(*stopped)
            if asked:
                return self.end(ending or EndKind.STOPPED)
        self.points.extend(piece, done, len(new))
        self.seen = seen.last()
        if self.progress is not None:
            self.progress(len(new), self.points[-1].parameter)
        return self.end(ending) if ending else None

    def tested(self, piece: Point | Block, new: Points, ending: EndKind | None) -> Samples:
        """The test functions at new points, and at the two before.

        No walk comes from beyond a limit of the range: a zero on it, within its error, is found
        from inside.
        """
        told = [np.zeros((len(new), 0)), *(test.on(piece) for test in self.tests)]
        values = np.concatenate(told, axis=1)
        seen = self.seen.then(new.arclengths, values)
        first, second = seen.values[1], seen.values[2]
        if len(self.points) == 1:
            for test, one, other in zip(
                self.tests, seen.split(first), seen.split(second), strict=True
            ):
                if test.vanishing:  # no value, since it is below what has one: a zero at the start
                    one[np.isnan(one) & ~np.isnan(other)] = 0.0
        if len(self.points) == 1 and self.branching:
            first[:] = signs_on_leaving(first, second)
        elif len(self.points) == 1 and self.points[0].parameter in self.limits:
            first[:] = separate_signs(first, second)
        if len(self.points) == 1:
            self.left_with = seen.split(first.copy())
        if ending is EndKind.RANGE:
            second[:] = separate_signs(second, first)
        elif ending is EndKind.CLOSED and self.goal is None:
            second[:] = closed_test_values(seen.split(second), self.left_with)
        return seen

    def events_before(self, point: Point, stretch: Stretch, ending: EndKind | None) -> list[Event]:
        """Locate the events on the step to a point, within the range."""
        began = time.perf_counter()
        arc = self.arc(self.points[-1], point)
        found, missed = find_events(self.tests, arc, stretch)
        round_once = ending is EndKind.CLOSED and self.goal is None
        again = point.arclength if round_once else np.inf
        found = [arc.holding(e) for e in found if self.in_range(e) and not self.at_start(e, again)]
        self.events += found
        self.missed += missed
        self.seconds_in_events += time.perf_counter() - began
        return found

    def in_range(self, event: Event) -> bool:
        """Whether an event lies within the limits, or within its error of one."""
        low, high = self.limits
        return low <= event.parameter <= high or is_at(event, low) or is_at(event, high)

    def at_start(self, event: Event, again: float) -> bool:
        """Whether an event is at the branch point the walk left: rounding finds that again.

        `again` is the arclength at which the walk comes round.
        """
        place = event.point.arclength
        return self.branching and (place < AT_START or place > again - SAME_SOLUTION)

    def forget_past(self, known: int, arc: Arc, last: Point) -> None:
        """Forget what is missed on the last arc, behind those known before, but not before its
        end."""
        new = self.missed[known:]
        self.missed[known:] = [one for one in new if not self.is_past(one, arc, last)]

    def is_past(self, missed: MissedEvent, arc: Arc, last: Point) -> bool:
        """Whether what is missed on an arc happens at the end that was found there, or beyond.

        Then no value has changed its sign just before it; or, where two zeros close to each other
        are not excluded or values there are rounding, it is one at the end: values fall as a power
        of what is left of the way.
        """
        way = (last.arclength - arc.left.arclength) / (arc.right.arclength - arc.left.arclength)
        place = slice(missed.index, None if missed.index is None else missed.index + 1)
        tests = [test for test in self.tests if test.kind == missed.kind]
        first = np.concatenate([test.at(arc.left)[place] for test in tests])
        powers = []
        for part in SHORT_OF:
            nearby = [arc.at(share * way) for share in (part, NEARLY * part)]
            if None in nearby:
                continue
            with np.errstate(divide="ignore", invalid="ignore"):
                parts, same = (
                    np.concatenate([test.at(before)[place] for test in tests]) / first
                    for before in nearby
                    if before is not None
                )
                told = np.abs(parts - same) < 0.5 * np.abs(same)
            if np.all(told & (np.abs(parts) > VANISHED)):
                signed = missed.index is not None and part >= SURE
                if signed or not np.all(parts > 0.0):
                    return bool(np.all(parts > 0.0))
                powers.append(np.log(parts) / math.log(1.0 - part))
        return len(powers) > 1 and bool(np.all(np.ptp(powers, axis=0) < SAME_POWER))

    def stopped(self, end: End, last: Point) -> End:
        """Let the walk end at a point before the last one."""
        self.points.end_with(last)
        if len(self.points) > 1 and self.points[-2].arclength == last.arclength:
            self.points = self.points[:-1]  # it was the last but one
        self.events = [e for e in self.events if e.point.arclength <= last.arclength]
        return end

    def refusal(self, here: Point, refused: RefusalDetails | None) -> End:
        """The end of a branch on which no further step was accepted."""
        assert refused is not None
        near, floor = self.near(here), self.numerics(here).min_step
        begins = len(self.points) == 1 and not self.branching
        if begins and first_tangent(self.problem, here.evaluation.jacobian, self.scale) is None:
            return self.end(EndKind.SINGULAR, why=TWO_DIRECTIONS)
        turns = refused.cause in (Refusal.TURNS, Refusal.BENDS)
        if turns and cast(float, refused.detail) < STRAIGHT:
            return self.end(refused.kind, why=str(refused), floor=floor, advice=WIDER)
        if near is None or near.crosses or refused.kind is not EndKind.STEP:
            rounding = self.rounding(here)
            rough = rounding > self.numerics(here).tolerance
            advice = LOOSER.format(rounding=rounding) if rough else FINER
            return self.end(refused.kind, why=str(refused), floor=floor, advice=advice)
        place = near.parameter
        return self.end(EndKind.NEAR_MISS, why=str(refused), near=str(near), place=place)

    def rounding(self, here: Point) -> float:
        """What the equations make of the rounding of the unknowns, in natural sizes."""
        units = residual_sizes(self.problem, self.scale, here.evaluation)
        residual = np.abs(here.evaluation.jacobian) @ np.abs(here.unknowns)
        return float(np.finfo(float).eps * np.max(residual / units))

    def end(self, kind: EndKind, value: float | None = None, **details: object) -> End:
        value = self.points[-1].parameter if value is None else float(value)
        return End.of(kind, self.parameter, value, **details)

    def interrupted(self) -> Walk:
        """The walk as far as it has come, without events of a step that was not yet made."""
        reached = self.points[-1].arclength
        self.events = [event for event in self.events if event.point.arclength <= reached]
        return self.finished(self.end(EndKind.INTERRUPTED))

    def finished(self, end: End) -> Walk:
        effort = self.iterations, self.rejected, self.seconds_in_events
        notes = self.passes.notes(self.parameter)
        return Walk(self.points, self.events, end, self.missed, *effort, notes)
