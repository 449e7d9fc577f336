"""One zero of a test function between two points, located: by Newton's method or by bracketing."""

from __future__ import annotations

import numpy as np

from .arc import Arc
from .bordered import orientation
from .branch import Event, Missed, Point
from .metric import EPSILON
from .problem import Evaluation
from .test_function import TestFunction
from .uncertainty import error_of_zero

SHRUNK = 1e-2
"""A function that has not fallen below this part of its values at the ends jumps; a fifth root
falls to a thousandth before its argument is rounding."""

CLOSED_IN = 1e-6
"""A function that has no value in a bracket this narrow jumps there."""

BESIDE = 0.999
"""Where no point is reached or a function has no value, this part of the way is tried instead."""

ACCEPTED_ERROR = 1e-7
"""Newton on an extended system counts if its error is below this part of the parameter's scale."""

NO_VALUE = "the test function has no value inside the bracket"


def locate(
    test: TestFunction, arc: Arc, index: int, left: float, right: float
) -> Event | Missed | None:
    """Locate one crossing: Newton on the extended system, from ever closer points.

    The first guess is linear interpolation along the cubic between both points. If Newton fails or
    leaves the arc, the bracket is narrowed along the branch and Newton tried again; a bracket
    narrowed to rounding is itself the answer. None where it is no crossing.
    """
    a, b, fa, fb = 0.0, 1.0, left, right
    guess = arc.near(_next_fraction(a, b, fa, fb, 0))
    event = _by_newton(test, arc, guess, index) if guess is not None else None
    if event is not None:
        return event
    for attempt in range(60):
        fraction = _next_fraction(a, b, fa, fb, attempt)
        guess = arc.at(fraction) or arc.at(a + BESIDE * (fraction - a))
        if guess is None:  # beside a branch point as well as on it
            return missed(test.kind, arc, "no point of the branch was reached inside the bracket")
        if attempt % 8 == 0:
            event = _by_newton(test, arc, guess, index)
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
                return missed(test.kind, arc, NO_VALUE)
            width = min(1.0, test.vanishing / abs(fb - fa)) * (b - a)
            return _by_bracket(test, arc, guess, index, width)
        if (value >= 0.0) == (fa >= 0.0):
            a, fa = fraction, value
        else:
            b, fb = fraction, value
        if b - a <= 8.0 * EPSILON or value == 0.0:
            break
    assert guess is not None
    shrunk = min(abs(fa), abs(fb)) <= SHRUNK * max(abs(left), abs(right))
    if not shrunk:
        sides = arc.left if a == 0.0 else arc.at(a), arc.right if b == 1.0 else arc.at(b)
        if any(side is not None and test.enters(side, index) for side in sides):
            return None
        return missed(test.kind, arc, "the test function jumps without passing through zero")
    return _by_bracket(test, arc, guess, index, 0.0 if value == 0.0 else b - a)


def _next_fraction(a: float, b: float, fa: float, fb: float, attempt: int) -> float:
    """Secant point kept off the ends of the bracket; a bisection every third time."""
    if attempt % 3 == 2 or fa == fb:
        return 0.5 * (a + b)
    margin = 0.01 * (b - a)
    return min(max(a + (b - a) * fa / (fa - fb), a + margin), b - margin)


def _by_newton(test: TestFunction, arc: Arc, guess: Point, index: int) -> Event | None:
    located = test.locate(arc.problem, guess, index)
    if located is None or not arc.holds(located.unknowns):
        return None
    if not located.error <= ACCEPTED_ERROR * arc.scale[-1]:
        return None
    here = located.evaluation or arc.problem.evaluate(located.unknowns)
    point = arc.event_point(here, guess.iterations)
    details = {"index": index, **located.details}
    return Event(test.kind, point, located.residual, located.error, "newton", details)


def _by_bracket(test: TestFunction, arc: Arc, point: Point, index: int, width: float) -> Event:
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


def missed(kind: str, arc: Arc, reason: str) -> Missed:
    """Return what could not be located on an arc."""
    return Missed(kind, (arc.left.parameter, arc.right.parameter), reason)
