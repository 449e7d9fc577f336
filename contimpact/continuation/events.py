"""Test functions: the protocol, the crossing rule, and location with a bracketed fallback."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .arclength import (
    EPSILON,
    Settings,
    angle,
    bordered,
    correct,
    cubic,
    inner,
    length,
    point_after,
)
from .branch import Event, Missed, Point
from .problem import Array, Problem

CLOSEST_BRANCHES = 1e-4
"""Branches closer to each other than this part of a step are taken to cross."""

SUSPICIOUS = 0.25
"""A step is cut where a test function's extremum inside may be below this part of its ends."""

DEEPEST = 6
"""How often a suspicious step is halved."""

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

    evaluations = 0

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
        return np.atleast_1d(np.asarray(self.function(point), dtype=float))


def crosses(left: Array, right: Array) -> Array:
    """Return which values change sign between two points.

    Zero counts as positive: a zero exactly on a point is found from one side only, once.
    """
    both = ~(np.isnan(left) | np.isnan(right))
    return both & ((left >= 0.0) != (right >= 0.0))


def crossings(left: Array, right: Array) -> list[int]:
    """Return the indices that change sign between two points."""
    return np.nonzero(crosses(left, right))[0].tolist()


@dataclass(frozen=True, eq=False)
class Before:
    """The test functions one point before a segment, to see how they bend."""

    arclength: float
    values: list[Array]


def find_events(
    tests: list[TestFunction], segment: Segment, left: list[Array], right: list[Array],
    before: Before | None = None, depth: int = DEEPEST,
) -> tuple[list[Event], list[Missed]]:  # fmt: skip
    """Locate every crossing on a segment, in order along it.

    Two crossings of one function leave its sign as it was. Where the parabola through three points
    does not exclude them, or a value appears or vanishes beyond zero, the segment is halved and
    both halves searched.
    """
    if depth and _may_hide(segment, before, left, right):
        middle = segment.at(0.5)
        if middle is not None and segment.left.arclength < middle.arclength:
            between = [test.at(middle) for test in tests]
            first, second = segment.halves(middle)
            here = Before(segment.left.arclength, left)
            found = find_events(tests, first, left, between, before, depth - 1)
            more = find_events(tests, second, between, right, here, depth - 1)
            return found[0] + more[0], found[1] + more[1]
    events: list[Event] = []
    missed: list[Missed] = []
    for test, a, b in zip(tests, left, right, strict=True):
        for index in crossings(a, b):
            if max(abs(a[index]), abs(b[index])) <= test.noise:
                continue
            event = locate(test, segment, index, float(a[index]), float(b[index]))
            if isinstance(event, Missed):
                missed.append(event)
            elif test.accept(event):
                events.append(event)
    return sorted(events, key=lambda e: e.point.arclength), missed


def _may_hide(
    segment: Segment, before: Before | None, left: list[Array], right: list[Array]
) -> bool:
    """Whether some test function may cross zero on a segment without changing its sign."""
    ahead = segment.right.arclength - segment.left.arclength
    behind = 0.0 if before is None else segment.left.arclength - before.arclength
    if before is not None and not (behind > 0.0 and ahead > 0.0):
        return False
    if not left:
        return False
    lists = (left if before is None else before.values, left, right)
    a, b, c = (np.concatenate(values) for values in lists)
    return bool(np.any(hides(a, b, c, behind, ahead)))


def hides(a: Array, b: Array, c: Array, behind: Any, ahead: Any) -> Array:
    """Return which values may cross zero between two points without changing their sign.

    The parabola through three values comes close to zero between the last two, or a value appears
    already beyond zero, or vanishes on its way there.

    Parameters
    ----------
    a, b, c : ndarray
        The values at three points.
    behind, ahead : float or ndarray
        Arclength between them; `behind` is zero where there is no first point.
    """
    with np.errstate(all="ignore"):
        alone = behind == 0.0
        rate, next_rate = (b - a) / behind, (c - b) / ahead
        bend = (next_rate - rate) / (behind + ahead)
        slope = rate + bend * behind
        vertex = -slope / (2.0 * bend)
        lowest = b + 0.5 * slope * vertex
        inside = (vertex > -0.25 * ahead) & (vertex < 1.25 * ahead) & (bend * b > 0.0)
        near = np.sign(b) * lowest < SUSPICIOUS * np.minimum(np.abs(b), np.abs(c))
        on_its_way = (b < 0.0) | (~alone & (b + (b - a) * ahead / behind < 0.0))
    dips = inside & near & ((b >= 0.0) == (c >= 0.0)) & ~alone
    return dips | (np.isnan(b) & (c < 0.0)) | (np.isnan(c) & on_its_way)


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
        guess = segment.at(fraction) or segment.at(a + 0.999 * (fraction - a))
        if guess is None:  # beside a branch point as well as on it
            return _missed(test, segment, "no point of the branch was reached inside the bracket")
        if attempt % 8 == 0:
            event = _by_newton(test, segment, guess, index)
            if event is not None:
                return event
        value = float(test.at(guess)[index])
        if np.isnan(value):
            return _missed(test, segment, "the test function has no value inside the bracket")
        if (value >= 0.0) == (fa >= 0.0):
            a, fa = fraction, value
        else:
            b, fb = fraction, value
        if b - a <= 8.0 * EPSILON or value == 0.0:
            break
    assert guess is not None
    shrunk = min(abs(fa), abs(fb)) <= 1e-3 * max(abs(left), abs(right))
    if not shrunk:
        return _missed(test, segment, "the test function jumps without passing through zero")
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

    Its place along the branch is known to the width. The point itself is known to its residual and
    the rounding of its unknowns, through the inverse bordered Jacobian; as the test function
    depends on all of it, it counts along the branch as well.
    """
    here = point.evaluation
    travelled = abs(segment.right.parameter - segment.left.parameter)
    chord = length(segment.right.unknowns - segment.left.unknowns, segment.scale)
    matrix = bordered(here.jacobian, point.tangent / segment.scale**2)
    rounding = np.abs(matrix[:-1]) @ np.abs(here.unknowns) * EPSILON
    try:
        inverse = np.abs(np.linalg.inv(matrix))[:, :-1]
        off = inverse @ (np.abs(here.residual) + rounding)
    except np.linalg.LinAlgError:  # at a branch point: no better than the bracket's own points
        off = np.sqrt(EPSILON) * segment.scale
    along = width + length(off, segment.scale) / chord
    error = float(off[-1]) + along * travelled + 8.0 * EPSILON * abs(point.parameter)
    residual = float(np.max(np.abs(here.residual)))
    return Event(test.kind, point, residual, error, "bracket", test.details(point, index))


def _missed(test: TestFunction, segment: Segment, reason: str) -> Missed:
    return Missed(test.kind, (segment.left.parameter, segment.right.parameter), reason)


def hermite(left: Point, right: Point, span: float, fraction: float) -> Array:
    """Return a value of the cubic through two points with their tangents."""
    return cubic(left.unknowns, right.unknowns, left.tangent, right.tangent, span, fraction)
