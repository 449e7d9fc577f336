r"""Pseudo-arclength continuation: tangent, predictor, bordered corrector, step control.

Lengths are measured by sizes w of the unknowns, :math:`|a|^2 = \sum (a_i/w_i)^2`. The corrector
solves F(z) = 0 together with one more equation, :math:`c \cdot (z - z_p) = 0`, by Newton's method
on the bordered matrix

    [ dF/dz ]
    [   c   ]

(Keller 1977; Allgower and Georg, Introduction to Numerical Continuation Methods, 1990).
"""

from __future__ import annotations

import numbers
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from . import linear
from .branch import Point
from .problem import Array, Evaluation, Problem

EPSILON = float(np.finfo(float).eps)
PREDICTORS = ("tangent", "secant")


@dataclass(frozen=True)
class Settings:
    """Numerics of a walk; lengths are in the branch's metric.

    Parameters
    ----------
    tolerance : float
        Largest residual a point may have.
    max_iterations : int
        Corrector iterations before a step is refused.
    step, min_step, max_step : float
        First, smallest and largest step.
    max_angle : float
        Largest angle between the tangents of neighbouring points, rad.
    max_points : int
        Points of one walk.
    predictor : {"tangent", "secant"}
        Direction in which the next point is guessed: along the tangent, or along the chord from
        the point before.
    """

    tolerance: float = 1e-12
    max_iterations: int = 8
    step: float = 0.01
    min_step: float = 1e-7
    max_step: float = 0.1
    max_angle: float = 0.2
    max_points: int = 2000
    predictor: str = "tangent"

    def __post_init__(self) -> None:
        for name in ("tolerance", "step", "min_step", "max_step", "max_angle"):
            value = getattr(self, name)
            number = isinstance(value, numbers.Real) and not isinstance(value, bool)
            if not (number and np.isfinite(value) and value > 0.0):
                raise InputError(name, f"found {value!r}", "give a positive number")
        for name in ("max_iterations", "max_points"):
            value = getattr(self, name)
            if isinstance(value, bool) or not (isinstance(value, int) and value >= 1):
                raise InputError(name, f"found {value!r}", "give a whole number >= 1")
        if self.predictor not in PREDICTORS:
            raise InputError(
                "predictor", f"found {self.predictor!r}", f"accepted are {', '.join(PREDICTORS)}"
            )
        if not self.min_step <= self.step <= self.max_step:
            raise InputError(
                "step",
                f"min_step = {self.min_step}, step = {self.step}, max_step = {self.max_step}",
                "keep them in this order",
            )  # fmt: skip


@dataclass(frozen=True)
class Correction:
    """What the corrector reached: an evaluation, or the reason it reached none."""

    evaluation: Evaluation | None
    iterations: int
    reason: str = ""
    first_step: float = 0.0


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


def correct(
    problem: Problem, guess: Array, row: Array, scale: Array, settings: Settings
) -> Correction:
    """Solve F(z) = 0, row . (z - guess) = 0 by Newton's method.

    Accepts a point whose residual is below the tolerance, or whose Newton step is at the rounding
    of the unknowns. A step that no longer contracts is refused.
    """
    z = guess
    before = first = np.inf
    row = row / np.linalg.norm(row * scale)
    for iteration in range(settings.max_iterations + 1):
        try:
            here = problem.evaluate(z)
        except (ArithmeticError, ValueError) as error:
            return Correction(None, iteration, f"the equations have no value: {error}")
        size = float(np.max(np.abs(here.residual)))
        if not np.isfinite(size):
            return Correction(None, iteration, "the residual is not finite")
        if size <= settings.tolerance:
            return Correction(here, iteration, first_step=first if iteration else 0.0)
        if iteration == settings.max_iterations:
            break
        try:
            step = linear.solve(
                bordered(here.jacobian, row), np.append(-here.residual, row @ (guess - z))
            )
        except np.linalg.LinAlgError:
            return Correction(None, iteration, "the bordered matrix is singular")
        moved = length(step, scale)
        first = moved if iteration == 0 else first
        if not moved < 2.0 * before:
            return Correction(None, iteration, "Newton's iteration diverges")
        if moved <= 4.0 * EPSILON * length(z, scale):
            return Correction(here, iteration, first_step=first)
        before = moved
        z = z + step
    return Correction(
        None, settings.max_iterations, f"no convergence in {settings.max_iterations} iterations"
    )


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


def angle(a: Array, b: Array, scale: Array) -> float:
    """Return the angle between two unit tangents, accurate also when small."""
    return 2.0 * float(np.arcsin(min(1.0, 0.5 * length(a - b, scale))))


def next_step(step: float, turned: float, first_correction: float, settings: Settings) -> float:
    """Return the next step length.

    The angle between tangents grows with the step and the first correction with its square; the
    larger of both against their targets decides, by at most a factor of two. The target angle is
    half the largest one, the target correction a twentieth of the step.
    """
    by_angle = turned / (0.5 * settings.max_angle)
    by_distance = np.sqrt(first_correction / (0.05 * step))
    factor = 1.0 / max(by_angle, float(by_distance), 0.5)
    return min(step * max(factor, 0.5), settings.max_step)
