"""Events along a branch: located, with their uncertainty, and told apart from their neighbours."""

from __future__ import annotations

import bisect
import functools
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from ..arrays import Array
from .branch import (
    Evaluation,
    Event,
    MissedEvent,
    Point,
    Points,
    Problem,
    TestFunction,
    order_events,
    same_place,
)
from .corrector import EPSILON, Arc, orientation
from .settings import Settings
from .sign_changes import DIPS, OFF_THE_ENDS, THRICE, Sample, Stretch, crosses, crossings

# How well an event found by bracketing is known: a bound of its parameter's error.

NEARBY = 1e-7
"""Relative distance at which the gradient of a test function is read from differences."""

LEVEL, SPACING = 3, 1e-9
"""Order of the differences that tell a function's noise, and relative distance of its values."""

FIRST_ORDER = 2.0
"""Factor for what the linear estimate leaves out."""

MARGIN = 8.0
"""A value is off by less than so many standard deviations of its noise."""


def error_of_zero(
    problem: Problem, here: Evaluation, function: Callable[[Evaluation], float], scale: Array
) -> float:
    """Bound the error of the parameter where a function of the points vanishes.

    The point solves F = 0 and f = 0 up to its residual and the rounding of both; what these move
    the parameter by, at most, is the last row of the inverse of [F'; f'] against them. The gradient
    of f comes from differences, its rounding from the scatter of values beside the zero. The
    bracket itself, in which f changes its sign, is not part of it. NaN where f has no value around
    the point.
    """

    def value(unknowns: Array) -> float:
        try:
            return function(problem.evaluate(unknowns))
        except (ArithmeticError, ValueError):
            return math.nan

    at = function(here)
    steps = NEARBY * scale
    with np.errstate(all="ignore"):
        gradient = np.array([value(here.unknowns + row) - at for row in np.diag(steps)]) / steps
        own = EPSILON * float(np.abs(gradient) @ np.abs(here.unknowns))
        own += MARGIN * noise(value, here.unknowns + steps, SPACING * scale)
        off = np.append(np.abs(here.residual) + rounding_of(problem, here), own)
        matrix = np.vstack([here.jacobian, gradient])
        try:
            row = np.linalg.solve(matrix.T, np.eye(len(matrix))[-1])
        except np.linalg.LinAlgError:
            return math.nan
        return FIRST_ORDER * float(np.abs(row) @ off)


def rounding_of(problem: Problem, here: Evaluation) -> Array:
    """Bound the rounding of the residuals: as the problem does, or by that of the unknowns."""
    own: Callable[[Evaluation], Array] | None = getattr(problem, "rounding", None)
    if own is not None:
        return own(here)
    return np.asarray(EPSILON * (np.abs(here.jacobian) @ np.abs(here.unknowns)))


def noise(value: Callable[[Array], float], unknowns: Array, step: Array) -> float:
    """Return the standard deviation of a function's rounding, from differences of high order.

    Neighbouring values differ by a smooth function, of which the differences vanish, and by their
    rounding, of which they do not (Hamming; More and Wild, SIAM J. Sci. Comput. 33, 2011).
    """
    places = range(-LEVEL, LEVEL + 1)
    differences = np.diff([value(unknowns + place * step) for place in places], LEVEL)
    growth = math.comb(2 * LEVEL, LEVEL)
    return math.hypot(*differences) / math.sqrt(len(differences) * growth)


# Points between adjacent events, so that every stretch of a branch has one that tells its status.
#
# At an event a solution has the status of neither side. Where two events lie between neighbouring
# points of a walk, no point tells what lies between them, and one more is solved there.

FRACTIONS = (0.5, 0.3, 0.7)
"""Fractions of the way between two events at which a point is tried."""


def snap_to_points(points: Points, events: Iterable[Event]) -> list[Event]:
    """Return events, each on the point of the branch from which its error does not tell it apart,
    if there is one."""
    lengths, values = points.arclengths, points.unknowns[:, -1]
    found = []
    for event in events:
        place = event.point.arclength
        after = int(np.searchsorted(lengths, place))
        for i in range(max(after - 1, 0), min(after + 1, len(lengths))):
            if same_place(lengths[i] - place, values[i] - event.parameter, event.error):
                event = event.moved_to(float(lengths[i]))
        found.append(event)
    return found


def separate_events(
    problem: Problem, points: Points, events: Iterable[Event], others: Iterable[Point] = ()
) -> Points:
    """Return the points of a branch, and one more between any two events that had none between.

    `others` are further points without a status of their own: a birth, an end at an event.
    """
    marks = [*((event.point, event.error) for event in events), *((p, 0.0) for p in others)]
    marks.sort(key=lambda mark: mark[0].arclength)
    lengths, span = points.arclengths, float(np.ptp(points.unknowns[:, -1])) or 1.0
    free = lengths[~np.isin(lengths, [mark.arclength for mark, _ in marks])]
    found = []
    for (left, error), (right, other) in pairwise(marks):
        first, beyond = np.searchsorted(free, (left.arclength, right.arclength))
        apart = right.arclength - left.arclength, right.parameter - left.parameter
        if first == beyond and not same_place(*apart, error + other):
            scale = problem.scale(left.unknowns, span)
            point = _point_between(Arc(problem, left, right, scale, Settings()))
            found += [] if point is None else [point]
    return points.with_more(found)


def _point_between(arc: Arc) -> Point | None:
    """A point of the branch between the ends of an arc; None where none is reached."""
    for fraction in FRACTIONS:
        point = arc.at(fraction)
        if point is None or not arc.holds(point.unknowns):
            continue
        if arc.left.arclength < point.arclength < arc.right.arclength:
            return point
    return None


# One zero of a test function between two points, located: by Newton's method or by bracketing.

SHRUNK = 1e-2
"""A function that has not fallen below this part of its values at the ends jumps; a fifth root
falls to a thousandth before its argument is rounding."""

JUMPED = 0.5
"""A function that keeps this part of its values at the ends on one side jumps, too, however small
it is on the other."""

CLOSED_IN = 1e-6
"""A function that has no value in a bracket this narrow jumps there."""

BESIDE = 0.999
"""Part of the way that is tried instead where no point is reached or a function has no value."""

ACCEPTED_ERROR = 1e-7
"""Newton on an extended system counts if its error is below this part of the parameter's scale."""

NO_POINT = "no point of the branch was reached inside the bracket"
NO_VALUE = "the test function has no value inside the bracket"
JUMPS = "the test function jumps without passing through zero"


def locate(
    test: TestFunction, arc: Arc, index: int, left: float, right: float
) -> Event | MissedEvent | None:
    """Locate one crossing: Newton on the extended system, from ever closer points.

    The first guess is linear interpolation along the cubic between both points. If Newton fails or
    leaves the arc, the bracket is narrowed along the branch and Newton tried again; a bracket
    narrowed to rounding, or to where no point is reached, is itself the answer. None where it is no
    crossing.
    """
    missed = functools.partial(_missed_between, test, arc, index)
    a, b, fa, fb, most = 0.0, 1.0, left, right, max(abs(left), abs(right))
    first = _next_fraction(a, b, fa, fb, 0)
    event = test.locate_on(arc, first, index)
    if event is not None and event.error <= ACCEPTED_ERROR * arc.scale[-1]:
        return event
    guess = arc.near(first)
    event = _locate_by_newton(test, arc, guess, index) if guess is not None else None
    if event is not None:
        return event
    for attempt in range(60):
        fraction = _next_fraction(a, b, fa, fb, attempt)
        reached = arc.at(fraction) or arc.at(a + BESIDE * (fraction - a))
        if reached is None:  # beside a branch point as well as on it
            if max(abs(fa), abs(fb)) > SHRUNK * most:
                return missed(NO_POINT, a, b)
            break
        guess = reached
        if attempt % 8 == 0:
            event = _locate_by_newton(test, arc, guess, index)
            if event is not None:
                return event
        value = float(test.at(guess)[index])
        beside = arc.at(a + BESIDE * (fraction - a)) if np.isnan(value) else None
        if beside is not None:
            guess, fraction, value = (
                beside,
                a + BESIDE * (fraction - a),
                float(test.at(beside)[index]),
            )
        if np.isnan(value):
            if not test.vanishing:
                if b - a < CLOSED_IN:
                    break
                return None if _enters(test, arc, index, a, b) else missed(NO_VALUE, a, b)
            width = min(1.0, test.vanishing / abs(fb - fa)) * (b - a)
            return _locate_by_bracket(test, arc, guess, index, width)
        if (value >= 0.0) == (fa >= 0.0):
            a, fa = fraction, value
        else:
            b, fb = fraction, value
        if b - a <= 8.0 * EPSILON or value == 0.0:
            break
    assert guess is not None
    if min(abs(fa), abs(fb)) > SHRUNK * most:
        return None if _enters(test, arc, index, a, b) else missed(JUMPS, a, b)
    event = _locate_by_bracket(test, arc, guess, index, 0.0 if value == 0.0 else b - a)
    jumps = max(abs(fa), abs(fb)) > JUMPED * most and value != 0.0
    if jumps and _enters(test, arc, index, a, b):
        return None
    return missed(JUMPS, a, b) if jumps and test.accept(event) else event


def _enters(test: TestFunction, arc: Arc, index: int, a: float, b: float) -> bool:
    """Whether nothing is missed though there is no zero between two fractions of an arc."""
    sides = arc.left if a == 0.0 else arc.at(a), arc.right if b == 1.0 else arc.at(b)
    return any(side is not None and test.enters(side, index) for side in sides)


def _next_fraction(a: float, b: float, fa: float, fb: float, attempt: int) -> float:
    """Secant point kept off the ends of the bracket; a bisection every third time."""
    if attempt % 3 == 2 or fa == fb:
        return 0.5 * (a + b)
    margin = 0.01 * (b - a)
    return min(max(a + (b - a) * fa / (fa - fb), a + margin), b - margin)


def _locate_by_newton(test: TestFunction, arc: Arc, guess: Point, index: int) -> Event | None:
    located = test.locate(arc.problem, guess, index)
    if located is None or not arc.holds(located.unknowns):
        return None
    if not located.error <= ACCEPTED_ERROR * arc.scale[-1]:
        return None
    here = located.evaluation or arc.problem.evaluate(located.unknowns)
    point = arc.event_point(here, guess.iterations)
    details = {"index": index, **located.details}
    return Event(test.kind, point, located.residual, located.error, "newton", details)


def _locate_by_bracket(
    test: TestFunction, arc: Arc, point: Point, index: int, width: float
) -> Event:
    """The event at a point a bracket of relative width `width` has closed on.

    At a branch point, where the error has no bound, it is no better than the bracket's own points.
    """
    here = point.evaluation

    def value(there: Evaluation) -> float:
        sign = orientation(there.jacobian, point.tangent, arc.scale)
        moved = Point(there, point.tangent, sign, point.arclength, 0)
        return float(test.values(moved)[index])

    error = error_of_zero(arc.problem, here, value, arc.scale)
    if not np.isfinite(error):
        error = float(np.sqrt(EPSILON) * arc.scale[-1])
    error += width * abs(arc.right.parameter - arc.left.parameter)
    residual = float(np.max(np.abs(here.residual)))
    return Event(test.kind, point, residual, error, "bracket", test.details(point, index))


def _missed_between(
    test: TestFunction, arc: Arc, index: int, reason: str, a: float, b: float
) -> MissedEvent:
    """What could not be located between two fractions of an arc; its place is told where they are
    near to each other."""
    missed = missed_event(test.kind, arc, reason, test.place_on_orbit(index))
    start, span = arc.left.arclength, arc.right.arclength - arc.left.arclength
    place = start + b * span if (b - a) * span <= NARROW else math.inf
    return replace(missed, arclength=place, index=index)


NARROW = 1e-8
"""Length of a bracket that tells where on its walk something is missed."""


def missed_event(kind: str, arc: Arc, reason: str, place: str = "") -> MissedEvent:
    """Return what could not be located on an arc."""
    ends = arc.left.parameter, arc.right.parameter
    return MissedEvent(kind, ends, reason, place=place)


GUIDED = 4
"""Beside what `suspects` finds: a guide tells that a value may begin and end between two points."""

DEEPEST = np.array([0, 6, 20, 48, 6])
"""How often an arc is cut, by what is suspected there."""

UNSURE = 1e-4
"""An arc is not cut where the orientation is below this part of that at its ends: so near to a
branch point, what changes along the tangent has the sign of its rounding."""

MOST_CUTS = 200
"""How often an arc is cut in all."""

UNRESOLVED = "two zeros close to each other are not excluded; a smaller max_step may tell"
STEP_TOO_LARGE = (
    "the step is too large: no orbit was found on the way between its points, where two zeros "
    "close to each other are not excluded; try a smaller max_step"
)


def find_events(
    tests: Sequence[TestFunction], arc: Arc, stretch: Stretch
) -> tuple[list[Event], list[MissedEvent]]:
    """Locate every crossing on an arc, in order along it.

    Where more crossings are not excluded (see `suspects`), the arc is cut and both parts are
    searched; what cannot be excluded by cutting either is returned as missed. `stretch` has the
    test functions at its ends, and at the points before and after it, to see how they bend.
    """
    if not stretch.left.flat.size or not stretch.left.arclength < stretch.right.arclength:
        return [], []
    least = UNSURE * float(np.fmax(abs(arc.left.orientation), abs(arc.right.orientation)))
    search = _Search(list(tests), stretch.left.sizes, least)
    search.on(arc, stretch, 0)
    events = search.events
    if search.cuts:
        events = [_place_event(event, arc) for event in events]
    return order_events(events), search.missed


def _place_event(event: Event, arc: Arc) -> Event:
    """An event where it is along an arc, wherever the arc was cut to find it."""
    place = arc.left.arclength + arc.fraction(event.point.unknowns) * arc.span
    return replace(event, point=replace(event.point, arclength=place))


@dataclass(eq=False)
class _Search:
    """The search of an arc for events.

    `sizes` are the numbers of values of each test function. Below the orientation `least` a point
    says nothing: rounding decides on its tangent.
    """

    tests: list[TestFunction]
    sizes: Sequence[int]
    least: float
    events: list[Event] = field(default_factory=list)
    missed: list[MissedEvent] = field(default_factory=list)
    cuts: int = 0

    @functools.cached_property
    def ends(self) -> list[int]:
        """Where the values of each test function end in the row of all."""
        return [*itertools.accumulate(self.sizes)]

    def on(self, arc: Arc, stretch: Stretch, depth: int) -> None:
        """Cut an arc where more crossings are not excluded, else locate those there are."""
        found, places = self.suspected(stretch)
        if not found.any():
            self.locate_on(arc, stretch)
            return
        reason, worth = UNRESOLVED, np.where(depth < DEEPEST[found], found, 0)
        if np.any(worth) and self.cuts < MOST_CUTS:
            middle = arc.at(float(places[np.argmax(worth)]))
            ends = stretch.left.arclength, stretch.right.arclength
            inside = middle is not None and ends[0] < middle.arclength < ends[1]
            if middle is not None and inside and not abs(middle.orientation) < self.least:
                self.cut(arc, stretch, middle, depth + 1)
                return
            reason = STEP_TOO_LARGE if middle is None else UNRESOLVED
        self.locate_on(arc, stretch)
        if np.any(found == DIPS):
            self.give_up(arc, stretch, reason)

    def suspected(self, stretch: Stretch) -> tuple[Array, Array]:
        """Where more crossings are not excluded, and not within rounding."""
        found, places = stretch.suspects()
        b, c = stretch.left.flat, stretch.right.flat
        if not found.any():
            return found, places
        larger = np.fmax(np.abs(b), np.abs(c))
        noise = [test.noise for test in self.tests]
        floor = [max(test.noise, test.rounding) for test in self.tests]
        found[(found == THRICE) & (larger <= np.repeat(noise, self.sizes))] = 0
        found[(found == DIPS) & (larger <= np.repeat(floor, self.sizes))] = 0
        if not any(test.guides for test in self.tests):
            return found, places
        passed = crosses(b, c)
        last = 0
        for test, left, right in zip(
            self.tests, stretch.left.values, stretch.right.values, strict=True
        ):
            last += len(left)
            if not test.guides:
                continue
            guides = slice(last - test.guides, last)
            turns = stretch.vanishing(guides)
            found[guides] = np.where(turns & test.guided(left, right), GUIDED, 0)
        aimed = passed & (found == GUIDED)
        places[aimed] = np.clip(b[aimed] / (b[aimed] - c[aimed]), OFF_THE_ENDS, 1.0 - OFF_THE_ENDS)
        return found, places

    def cut(self, arc: Arc, stretch: Stretch, middle: Point, depth: int) -> None:
        """Search both parts of an arc."""
        self.cuts += 1
        known = len(self.events)
        between = Sample.of(middle.arclength, [test.at(middle) for test in self.tests])
        for part, side in zip(arc.halves(middle), stretch.cut(between), strict=True):
            self.on(part, side, depth)
        found = {(event.kind, event.details.get("index")) for event in self.events[known:]}
        values = stretch.left.values, between.values, stretch.right.values
        for test, a, b, c in zip(self.tests, *values, strict=True):
            for index in crossings(a[: len(a) - test.guides], c[: len(a) - test.guides]):
                if np.isnan(b[index]) and (test.kind, index) not in found:
                    self.locate_one(test, arc, index, float(a[index]), float(c[index]))

    def locate_on(self, arc: Arc, stretch: Stretch) -> None:
        """Locate what changes sign between both ends."""
        a, b = stretch.left.flat, stretch.right.flat
        for place in crossings(a, b):
            number = bisect.bisect_right(self.ends, place)
            test, index = self.tests[number], place - self.ends[number] + self.sizes[number]
            own = index < self.sizes[number] - test.guides
            if own and max(abs(a[place]), abs(b[place])) > test.noise:
                self.locate_one(test, arc, index, float(a[place]), float(b[place]))

    def locate_one(
        self, test: TestFunction, arc: Arc, index: int, left: float, right: float
    ) -> None:
        """Locate one value that changes sign."""
        event = locate(test, arc, index, left, right)
        if isinstance(event, MissedEvent):
            self.missed.append(event)
        elif event is not None and test.accept(event):
            self.events.append(event)

    def give_up(self, arc: Arc, stretch: Stretch, reason: str) -> None:
        """Record where two zeros were not excluded however often the arc was cut, or why it was
        not."""
        # beside a jump of the function, what lies beyond it says nothing
        found = np.minimum(*(self.suspected(side)[0] for side in stretch.one_sided()))
        for place in np.nonzero(found == DIPS)[0].tolist():
            number = bisect.bisect_right(self.ends, place)
            test, index = self.tests[number], place - self.ends[number] + self.sizes[number]
            self.missed.append(missed_event(test.kind, arc, reason, test.place_on_orbit(index)))
