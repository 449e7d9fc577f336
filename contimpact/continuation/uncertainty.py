"""How well an event found by bracketing is known: a bound of its parameter's error."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .metric import EPSILON
from .problem import Array, Evaluation, Problem

NEARBY = 1e-7
"""Relative distance at which the gradient of a test function is read from differences."""

LEVEL, SPACING = 3, 1e-9
"""Order of the differences that tell a function's noise, and relative distance of its values."""

FIRST_ORDER = 2.0
"""For what the linear estimate leaves out."""

MARGIN = 8.0
"""A value is off by less than so many standard deviations of its noise."""


def error_of_zero(
    problem: Problem, here: Evaluation, function: Callable[[Evaluation], float], scale: Array
) -> float:
    """Bound the error of the parameter where a function of the points vanishes.

    The point solves F = 0 and f = 0 up to its residual and the rounding of both; what these move
    the parameter by, at most, is the last row of the inverse of [F'; f'] against them. The gradient
    of f comes from differences, its rounding from the scatter of values beside the zero. The
    bracket itself, in which f changes its sign, is not part of it.

    Parameters
    ----------
    problem : Problem
    here : Evaluation
    function : callable ``function(evaluation) -> float``
    scale : ndarray of shape (n + 1,)

    Returns
    -------
    float
        Not a number where the function has no value around the point.
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
