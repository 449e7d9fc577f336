"""Test functions, and the search for their zeros between two points of a branch."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .arclength import (
    EPSILON,
    angle,
    bordered,
    correct,
    cubic,
    inner,
    length,
    point_after,
    scaled_determinant,
)
from .branch import Event, Missed, Point
from .problem import Array, Problem
from .settings import Settings
from .sign_changes import DIPS, OFF_THE_ENDS, Sample, Stretch, crosses, crossings
from .uncertainty import error_of_zero

CLOSEST_BRANCHES = 1e-4
"""Branches closer to each other than this part of a step are taken to cross."""

GUIDED = 4
"""Beside what `suspects` finds: a guide tells that a value may begin and end between two points."""

DEEPEST = np.array([0, 6, 20, 48, 6])
"""How often a segment is cut, by what is suspected there."""

SHRUNK = 1e-2
"""A function that has not fallen below this part of its values at the ends jumps; a fifth root
falls to a thousandth before its argument is rounding."""

CLOSED_IN = 1e-6
"""A function that has no value in a bracket this narrow jumps there."""

MOST_CUTS = 200
"""How often a segment is cut in all."""

NO_VALUE = "the test function has no value inside the bracket"
UNRESOLVED = "two zeros close to each other are not excluded; a smaller max_step may tell"

BESIDE = 0.999
"""Where no point is reached or a function has no value, this part of the way is tried instead."""

ACCEPTED_ERROR = 1e-7
"""Newton on an extended system counts if its error is below this part of the parameter's scale."""


@dataclass(frozen=True, eq=False)
class Segment:
    """Two neighbouring points of a walk, and what is needed to go between them."""

    problem: Problem
    left: Point
    right: Point
    scale: Array
    settings: Settings

    def at(self, fraction: float) -> Point | None:
        """Return the point of the branch at a fraction of the way, or None if it is not reached."""
        chord = self.right.unknowns - self.left.unknowns
        span = self.right.arclength - self.left.arclength
        guess = hermite(self.left, self.right, span, fraction)
        result = correct(self.problem, guess, chord / self.scale**2, self.scale, self.settings)
        if result.evaluation is None:
            return None
        return self.point(result.evaluation, result.iterations)

    def near(self, fraction: float) -> Point | None:
        """Return a guess of that point, not corrected; None where the equations have no value."""
        span = self.right.arclength - self.left.arclength
        try:
            here = self.problem.evaluate(hermite(self.left, self.right, span, fraction))
        except (ArithmeticError, ValueError):
            return None
        return Point(here, self.left.tangent, np.nan, self.left.arclength + fraction * span, 0)

    def point(self, evaluation: Any, iterations: int) -> Point | None:
        """Return an evaluation as a point of this segment, None where it has no tangent."""
        span = self.right.arclength - self.left.arclength
        travelled = self.fraction(evaluation.unknowns) * span
        return point_after(self.left, evaluation, iterations, self.scale, travelled)

    def event_point(self, evaluation: Any, iterations: int) -> Point:
        """As `point`; at a branch point, where no tangent is defined, with the left end's."""
        point = self.point(evaluation, iterations)
        if point is not None:
            turned = angle(point.tangent, self.left.tangent, self.scale)
            if turned <= 2.0 * self.settings.max_angle:
                return point
        span = self.right.arclength - self.left.arclength
        there = self.left.arclength + self.fraction(evaluation.unknowns) * span
        return Point(evaluation, self.left.tangent, 0.0, there, iterations)

    def fraction(self, unknowns: Array) -> float:
        """Return how far along the chord a point lies: 0 at the left end, 1 at the right end."""
        chord = self.right.unknowns - self.left.unknowns
        return inner(unknowns - self.left.unknowns, chord, self.scale) / inner(
            chord, chord, self.scale
        )

    def halves(self, middle: Point) -> tuple[Segment, Segment]:
        """Return the segments on both sides of a point between."""
        return replace(self, right=middle), replace(self, left=middle)

    def connected(self) -> bool:
        """Whether both ends lie on one branch, where their orientations differ.

        Bisection on the orientation closes on a branch point if there is one; if the right end lies
        on another branch, the two sides stay apart or no point is reached between them.
        """
        left, right, a, b = self.left, self.right, 0.0, 1.0
        chord = length(right.unknowns - left.unknowns, self.scale)
        while b - a > CLOSEST_BRANCHES:
            middle = self.at(0.5 * (a + b))
            if middle is None:
                return False
            if (middle.orientation >= 0.0) == (self.left.orientation >= 0.0):
                left, a = middle, 0.5 * (a + b)
            else:
                right, b = middle, 0.5 * (a + b)
            if length(right.unknowns - left.unknowns, self.scale) > 4.0 * (b - a) * chord:
                return False
        return True

    def holds(self, unknowns: Array) -> bool:
        """Whether a point lies on the branch between both ends, within a step of the chord."""
        chord = self.right.unknowns - self.left.unknowns
        fraction = self.fraction(unknowns)
        off = unknowns - self.left.unknowns - fraction * chord
        slack = 1e-9
        near = length(off, self.scale) <= 0.5 * length(chord, self.scale) + slack
        return near and -slack <= fraction <= 1.0 + slack


@dataclass(frozen=True, eq=False)
class Located:
    """A solution of a test function's equations: where, and how well."""

    unknowns: Array
    residual: float
    error: float
    details: Mapping[str, Any] = field(default_factory=dict)


class TestFunction(ABC):
    """A function of points whose zeros are events.

    Implementers give `kind`, `values`, and, where they can, `locate`; `accept` may turn a located
    zero down, and `details` describe one found by bracketing.
    """

    __test__ = False  # not a test case
    kind: str
    noise = 0.0
    """Values below this on both sides of a sign change are rounding, not a crossing."""
    rounding = 0.0
    """Two zeros are not looked for among values below this."""

    vanishing = 0.0
    """Values below this do not exist where they cannot be told from zero."""

    evaluations = 0

    guides = 0
    """How many of the values, the last ones, are no test functions themselves but tell where the
    others begin or end."""

    def guided(self, left: Array, right: Array) -> Array:
        """Return which guides are to be followed between two points, shape (guides,)."""
        return np.ones(self.guides, dtype=bool)

    def at(self, point: Point) -> Array:
        """Return `values`, and count the evaluation."""
        self.evaluations += 1
        return self.values(point)

    @abstractmethod
    def values(self, point: Point) -> Array:
        """Return the function's values, shape (q,), the same q along a branch.

        Not-a-number says that a value does not exist here; it never takes part in a crossing.
        """

    def locate(self, problem: Problem, guess: Point, index: int) -> Located | None:
        """Solve the exact extended system from a nearby point; None if that fails."""
        return None

    def accept(self, event: Event) -> bool:
        """Whether a located zero is an event of this kind."""
        return True

    def details(self, point: Point, index: int) -> Mapping[str, Any]:
        """Return what to record of a zero found by bracketing."""
        return {"index": index}


class UserFunction(TestFunction):
    """A user's own function of the point, located by bracketing.

    Parameters
    ----------
    kind : str
        Name of its events.
    function : callable ``function(point) -> float``
    """

    def __init__(self, kind: str, function: Callable[[Point], float]) -> None:
        self.kind, self.function = kind, function

    def values(self, point: Point) -> Array:
        try:
            return np.atleast_1d(np.asarray(self.function(point), dtype=float))
        except ArithmeticError:  # a pole met exactly
            return np.array([np.nan])


def find_events(
    tests: Sequence[TestFunction], segment: Segment, stretch: Stretch
) -> tuple[list[Event], list[Missed]]:
    """Locate every crossing on a segment, in order along it.

    Where more crossings are not excluded (see `suspects`), the segment is cut and both parts are
    searched; what cannot be excluded by cutting either is returned as missed.

    Parameters
    ----------
    tests : sequence of TestFunction
    segment : Segment
    stretch : Stretch
        The test functions at its ends, and at the points before and after it, to see how they
        bend.
    """
    if not stretch.left.flat.size or not stretch.left.arclength < stretch.right.arclength:
        return [], []
    search = _Search(list(tests), [len(values) for values in stretch.left.values])
    search.on(segment, stretch, 0)
    return sorted(search.events, key=lambda e: e.point.arclength), search.missed


@dataclass(eq=False)
class _Search:
    """The search of a segment for events; `sizes` says how many values each test function has."""

    tests: list[TestFunction]
    sizes: list[int]
    events: list[Event] = field(default_factory=list)
    missed: list[Missed] = field(default_factory=list)
    cuts: int = 0

    def on(self, segment: Segment, stretch: Stretch, depth: int) -> None:
        """Cut a segment where more crossings are not excluded, else locate those there are."""
        found, places = self.suspected(stretch)
        worth = np.where(depth < DEEPEST[found], found, 0)
        if np.any(worth) and self.cuts < MOST_CUTS:
            middle = segment.at(float(places[np.argmax(worth)]))
            ends = stretch.left.arclength, stretch.right.arclength
            if middle is not None and ends[0] < middle.arclength < ends[1]:
                self.cut(segment, stretch, middle, depth + 1)
                return
        self.locate_on(segment, stretch)
        if np.any(found == DIPS):
            self.give_up(segment, stretch)

    def suspected(self, stretch: Stretch) -> tuple[Array, Array]:
        """Where more crossings are not excluded, and not within rounding."""
        found, places = stretch.suspects()
        b, c = stretch.left.flat, stretch.right.flat
        floor = [max(test.noise, test.rounding) for test in self.tests]
        found[(found == DIPS) & (np.fmax(np.abs(b), np.abs(c)) <= np.repeat(floor, self.sizes))] = 0
        passed = crosses(b, c)
        last = 0
        for test, left, right in zip(
            self.tests, stretch.left.values, stretch.right.values, strict=True
        ):
            last += len(left)
            if not test.guides:
                continue
            guides = slice(last - test.guides, last)
            turns = (found[guides] == DIPS) | passed[guides]
            found[guides] = np.where(turns & test.guided(left, right), GUIDED, 0)
        aimed = passed & (found == GUIDED)
        places[aimed] = np.clip(b[aimed] / (b[aimed] - c[aimed]), OFF_THE_ENDS, 1.0 - OFF_THE_ENDS)
        return found, places

    def cut(self, segment: Segment, stretch: Stretch, middle: Point, depth: int) -> None:
        """Search both parts of a segment."""
        self.cuts += 1
        known = len(self.events)
        between = Sample(middle.arclength, [test.at(middle) for test in self.tests])
        for part, side in zip(segment.halves(middle), stretch.cut(between), strict=True):
            self.on(part, side, depth)
        found = {(event.kind, event.details.get("index")) for event in self.events[known:]}
        values = stretch.left.values, between.values, stretch.right.values
        for test, a, b, c in zip(self.tests, *values, strict=True):
            for index in crossings(a[: len(a) - test.guides], c[: len(a) - test.guides]):
                if np.isnan(b[index]) and (test.kind, index) not in found:
                    self.locate_one(test, segment, index, float(a[index]), float(c[index]))

    def locate_on(self, segment: Segment, stretch: Stretch) -> None:
        """Locate what changes sign between both ends."""
        values = stretch.left.values, stretch.right.values
        for test, a, b in zip(self.tests, *values, strict=True):
            for index in crossings(a[: len(a) - test.guides], b[: len(a) - test.guides]):
                if max(abs(a[index]), abs(b[index])) > test.noise:
                    self.locate_one(test, segment, index, float(a[index]), float(b[index]))

    def locate_one(
        self, test: TestFunction, segment: Segment, index: int, left: float, right: float
    ) -> None:
        """Locate one value that changes sign."""
        event = locate(test, segment, index, left, right)
        if isinstance(event, Missed):
            self.missed.append(event)
        elif test.accept(event):
            self.events.append(event)

    def give_up(self, segment: Segment, stretch: Stretch) -> None:
        """Record where two zeros were not excluded however often the segment was cut."""
        kinds = np.repeat([test.kind for test in self.tests], self.sizes)
        # beside a jump of the function, what lies beyond it says nothing
        found = np.minimum(*(self.suspected(side)[0] for side in stretch.one_sided()))
        unsure = kinds[found == DIPS]
        self.missed += [_missed(str(kind), segment, UNRESOLVED) for kind in unsure]


def locate(
    test: TestFunction, segment: Segment, index: int, left: float, right: float
) -> Event | Missed:
    """Locate one crossing: Newton on the extended system, from ever closer points.

    The first guess is linear interpolation along the cubic between both points. If Newton fails or
    leaves the segment, the bracket is narrowed along the branch and Newton tried again; a bracket
    narrowed to rounding is itself the answer.
    """
    a, b, fa, fb = 0.0, 1.0, left, right
    guess = segment.near(_next_fraction(a, b, fa, fb, 0))
    event = _by_newton(test, segment, guess, index) if guess is not None else None
    if event is not None:
        return event
    for attempt in range(60):
        fraction = _next_fraction(a, b, fa, fb, attempt)
        guess = segment.at(fraction) or segment.at(a + BESIDE * (fraction - a))
        if guess is None:  # beside a branch point as well as on it
            return _missed(
                test.kind, segment, "no point of the branch was reached inside the bracket"
            )
        if attempt % 8 == 0:
            event = _by_newton(test, segment, guess, index)
            if event is not None:
                return event
        value = float(test.at(guess)[index])
        beside = segment.at(a + BESIDE * (fraction - a)) if np.isnan(value) else None
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
                return _missed(test.kind, segment, NO_VALUE)
            width = min(1.0, test.vanishing / abs(fb - fa)) * (b - a)
            return _by_bracket(test, segment, guess, index, width)
        if (value >= 0.0) == (fa >= 0.0):
            a, fa = fraction, value
        else:
            b, fb = fraction, value
        if b - a <= 8.0 * EPSILON or value == 0.0:
            break
    assert guess is not None
    shrunk = min(abs(fa), abs(fb)) <= SHRUNK * max(abs(left), abs(right))
    if not shrunk:
        return _missed(test.kind, segment, "the test function jumps without passing through zero")
    return _by_bracket(test, segment, guess, index, 0.0 if value == 0.0 else b - a)


def _next_fraction(a: float, b: float, fa: float, fb: float, attempt: int) -> float:
    """Secant point kept off the ends of the bracket; a bisection every third time."""
    if attempt % 3 == 2 or fa == fb:
        return 0.5 * (a + b)
    margin = 0.01 * (b - a)
    return min(max(a + (b - a) * fa / (fa - fb), a + margin), b - margin)


def _by_newton(test: TestFunction, segment: Segment, guess: Point, index: int) -> Event | None:
    located = test.locate(segment.problem, guess, index)
    if located is None or not segment.holds(located.unknowns):
        return None
    if not located.error <= ACCEPTED_ERROR * segment.scale[-1]:
        return None
    point = segment.event_point(segment.problem.evaluate(located.unknowns), guess.iterations)
    return Event(
        test.kind, point, located.residual, located.error, "newton",
        {"index": index, **located.details},
    )  # fmt: skip


def _by_bracket(
    test: TestFunction, segment: Segment, point: Point, index: int, width: float
) -> Event:
    """The event at a point a bracket of relative width `width` has closed on.

    At a branch point, where the error has no bound, it is no better than the bracket's own points.
    """
    here = point.evaluation

    def value(there: Any) -> float:
        sides = bordered(there.jacobian * segment.scale, point.tangent / segment.scale)
        moved = Point(there, point.tangent, scaled_determinant(sides), point.arclength, 0)
        return float(test.values(moved)[index])

    error = error_of_zero(segment.problem, here, value, segment.scale)
    if not np.isfinite(error):
        error = float(np.sqrt(EPSILON) * segment.scale[-1])
    error += width * abs(segment.right.parameter - segment.left.parameter)
    residual = float(np.max(np.abs(here.residual)))
    return Event(test.kind, point, residual, error, "bracket", test.details(point, index))


def _missed(kind: str, segment: Segment, reason: str) -> Missed:
    return Missed(kind, (segment.left.parameter, segment.right.parameter), reason)


def hermite(left: Point, right: Point, span: float, fraction: float) -> Array:
    """Return a value of the cubic through two points with their tangents."""
    return cubic(left.unknowns, right.unknowns, left.tangent, right.tangent, span, fraction)
