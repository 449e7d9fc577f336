r"""Pseudo-arclength continuation: tangent, predictor, bordered corrector, step control.

Lengths are measured by sizes w of the unknowns, :math:`|a|^2 = \sum (a_i/w_i)^2`. The corrector
solves F(z) = 0 together with one more equation, :math:`c \cdot (z - z_p) = 0`, by Newton's method
on the bordered matrix

    [ dF/dz ]
    [   c   ]

(Keller 1977; Allgower and Georg, Introduction to Numerical Continuation Methods, 1990).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from . import linear
from .branch import Point
from .problem import Array, Evaluation, Problem
from .refusal import Refusal, Refused
from .settings import Settings

EPSILON = float(np.finfo(float).eps)

LARGEST_DEFECT = 0.1
"""Largest defect of a step (see `defect`), as part of the largest angle."""


@dataclass(frozen=True, eq=False)
class Correction:
    """What the corrector reached: an evaluation, or the reason it reached none."""

    evaluation: Evaluation | None
    iterations: int
    refused: Refused | None = None
    first_step: float = 0.0

    @property
    def reason(self) -> str:
        """The reason in words."""
        return str(self.refused or "")


def inner(a: Array, b: Array, scale: Array) -> float:
    """Return the metric's inner product."""
    return float(np.dot(a / scale, b / scale))


def length(a: Array, scale: Array) -> float:
    """Return the metric's norm."""
    return float(np.linalg.norm(a / scale))


def bordered(jacobian: Array, row: Array) -> Array:
    """Return the Jacobian with one more row."""
    matrix = np.empty((len(row), len(row)))
    matrix[:-1] = jacobian
    matrix[-1] = row
    return matrix


CONVERGED, NO_VALUE, NO_SOLUTION, DIVERGES, SLOW = range(5)
"""What `newton` says."""

MAY_BE_ROUNDING = 1e-6
"""Newton steps longer than this are not asked if they are rounding."""


def newton(evaluate, solve, data, z, guess, row, scale, step, tolerance, most):
    """Solve F(z) = 0, row . (z - guess) = 0 by Newton's method, in plain Python.

    Accepts a point whose residual is below the tolerance, or whose Newton step is at the rounding
    of the unknowns. A step that no longer contracts is refused.

    Parameters
    ----------
    evaluate : callable ``evaluate(data, z)``
        The largest residual; not a number where F has no value.
    solve : callable ``solve(data, row, g, out)``
        Fills `out` with the solution of the bordered system at the point last evaluated, with the
        border's right side g; whether there is one.
    data
        Handed on to both.
    z, guess, row, scale, step : vector
        `z` is filled with the point reached, `step` is room for the steps.
    tolerance : float
    most : int
        Iterations at most.

    Returns
    -------
    status, iterations : int
    first : float
        Length of the first step.
    """
    n = len(z)
    before, first = math.inf, 0.0
    for i in range(n):
        z[i] = guess[i]
    for iteration in range(most + 1):
        worst = evaluate(data, z)
        if worst - worst != 0.0:  # infinite or not a number
            return NO_VALUE, iteration, first
        if worst <= tolerance:
            return CONVERGED, iteration, first
        if iteration == most:
            break
        g = 0.0
        if iteration > 0:
            for i in range(n):
                g += row[i] * (guess[i] - z[i])
        if not solve(data, row, g, step):
            return NO_SOLUTION, iteration, first
        moved = norm(step, scale)
        if iteration == 0:
            first = moved
        if not moved < 2.0 * before:
            return DIVERGES, iteration, first
        if moved < MAY_BE_ROUNDING and moved <= 4.0 * EPSILON * norm(z, scale):
            return CONVERGED, iteration, first
        before = moved
        for i in range(n):
            z[i] += step[i]
    return SLOW, most, first


def norm(z, scale):
    """Return the length of a vector."""
    size = 0.0
    for i in range(len(z)):
        part = z[i] / scale[i]
        size += part * part
    return math.sqrt(size)


class _Dense:
    """A problem as `newton` wants it."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.here: Evaluation | None = None
        self.reason = "the residual is not finite"

    def evaluate(self, z: list[float]) -> float:
        try:
            self.here = self.problem.evaluate(np.array(z))
        except (ArithmeticError, ValueError) as error:
            self.reason = f"the equations have no value: {error}"
            return math.nan
        return float(np.max(np.abs(self.here.residual)))

    def solve(self, row: list[float], g: float, out: list[float]) -> bool:
        assert self.here is not None
        matrix = bordered(self.here.jacobian, np.array(row))
        try:
            out[:] = linear.solve(matrix, np.append(-self.here.residual, g)).tolist()
        except np.linalg.LinAlgError:
            return False
        return True


def correct(
    problem: Problem, guess: Array, row: Array, scale: Array, settings: Settings
) -> Correction:
    """Solve F(z) = 0, row . (z - guess) = 0 by Newton's method; see `newton`."""
    row = row / np.linalg.norm(row * scale)
    dense, n = _Dense(problem), len(guess)
    status, iterations, first = newton(
        _Dense.evaluate, _Dense.solve, dense, [0.0] * n, guess.tolist(), row.tolist(),
        scale.tolist(), [0.0] * n, settings.tolerance, settings.max_iterations,
    )  # fmt: skip
    if status == CONVERGED:
        return Correction(dense.here, iterations, first_step=first)
    return Correction(None, iterations, refusal(status, settings, dense.reason))


def refusal(status: int, settings: Settings, reason: str = "") -> Refused:
    """Return what `newton` says as a refusal."""
    return {
        NO_VALUE: Refused(Refusal.NO_VALUE, reason),
        NO_SOLUTION: Refused(Refusal.NO_SOLUTION),
        DIVERGES: Refused(Refusal.DIVERGES),
        SLOW: Refused(Refusal.SLOW, settings.max_iterations),
    }[status]


def first_tangent(jacobian: Array, scale: Array) -> Array | None:
    """Return a unit null vector of the Jacobian, or None where there are two."""
    _, sizes, vectors = np.linalg.svd(jacobian * scale)
    if sizes[-1] <= 1e-10 * sizes[0]:
        return None
    return scale * vectors[-1]


def next_tangent(jacobian: Array, previous: Array, scale: Array) -> Array | None:
    """Return the unit null vector that goes on in the direction of `previous`."""
    row = previous / scale**2
    right = np.zeros(len(row))
    right[-1] = 1.0
    try:
        tangent = linear.solve(bordered(jacobian, row), right)
    except np.linalg.LinAlgError:
        return None
    size = length(tangent, scale)
    return tangent / size if np.isfinite(size) and size > 0.0 else None


def scaled_determinant(matrix: Array) -> float:
    """Return the determinant with every row divided by its norm: between -1 and 1, no pole."""
    norms = np.linalg.norm(matrix, axis=1)
    if not np.all(norms > 0.0):
        return 0.0
    sign, logarithm = linear.log_determinant(matrix / norms[:, None])
    return float(sign * np.exp(max(logarithm, -700.0)))


def point_after(
    previous: Point, evaluation: Evaluation, iterations: int, scale: Array,
    travelled: float | None = None,
) -> Point | None:  # fmt: skip
    """Return an evaluation as the point that follows another, or None where it has no tangent."""
    tangent = next_tangent(evaluation.jacobian, previous.tangent, scale)
    if tangent is None:
        return None
    if travelled is None:
        travelled = length(evaluation.unknowns - previous.unknowns, scale)
    orientation = scaled_determinant(bordered(evaluation.jacobian * scale, tangent / scale))
    return Point(evaluation, tangent, orientation, previous.arclength + travelled, iterations)


def angle(one, other, scale):
    """Return the angle between two unit tangents, accurate also when small."""
    return 2.0 * math.asin(min(1.0, 0.5 * distance(one, other, scale)))


def distance(one, other, scale):
    """Return the length of the difference of two vectors."""
    size = 0.0
    for i in range(len(one)):
        part = (one[i] - other[i]) / scale[i]
        size += part * part
    return math.sqrt(size)


def cubic(left, right, rate, next_rate, span, s):
    """Return a value of the cubic through two values with their rates, at a fraction s."""
    t = 1.0 - s
    return (
        left * t * t * (1.0 + 2.0 * s) + right * s * s * (1.0 + 2.0 * t)
        + span * s * t * (t * rate - s * next_rate)
    )  # fmt: skip


def defect(z, new, tangent, along, scale):
    """Return by how much a step differs from what the tangents at its ends make of it.

    The distance between the chord and the mean of both unit tangents times the chord's length, as
    part of that length: the error of the trapezoidal rule. It falls with the square of the step
    where the branch is resolved, and does not where a step spans a wiggle, however well the
    tangents agree.
    """
    size = distance(new, z, scale)
    if size == 0.0:
        return 0.0
    off = 0.0
    for i in range(len(z)):
        part = (new[i] - z[i] - 0.5 * size * (tangent[i] + along[i])) / scale[i]
        off += part * part
    return math.sqrt(off) / size


def step_after(step, turned, first_correction, off, max_angle, max_step):
    """Return the next step length.

    The angle between tangents grows with the step, the first correction with its square, as part
    of the step, and so does the defect `off`; the largest of them against their targets decides,
    by at most a factor of two. The targets of angle and defect are half the largest ones, that of
    the correction a twentieth of the step.
    """
    by_angle = turned / (0.5 * max_angle)
    by_distance = math.sqrt(first_correction / (0.05 * step))
    by_defect = math.sqrt(off / (0.5 * LARGEST_DEFECT * max_angle))
    factor = 1.0 / max(by_angle, by_distance, by_defect, 0.5)
    return min(step * max(factor, 0.5), max_step)
