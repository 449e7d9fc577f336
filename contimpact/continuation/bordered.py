"""Dense linear algebra of the Jacobian bordered by a row: tangents, determinants, Newton steps."""

from __future__ import annotations

import math

import numpy as np

from . import linear
from .branch import Point
from .metric import length
from .problem import Array, Evaluation, Problem

LARGEST = 0.999
"""Part of the largest component from which on others are as large."""


def bordered(jacobian: Array, row: Array) -> Array:
    """Return the Jacobian with one more row."""
    matrix = np.empty((len(row), len(row)))
    matrix[:-1] = jacobian
    matrix[-1] = row
    return matrix


def oriented(vector: Array) -> Array:
    """Return a vector or its negative, always the same one of both.

    That in which the first of its largest components is positive: of a null vector, rounding
    decides on the sign, and where components are equal by symmetry also on which is the largest.
    """
    sizes = np.abs(vector)
    leading = vector[np.argmax(sizes >= LARGEST * np.max(sizes))]
    return -vector if leading < 0.0 else vector


def first_tangent(jacobian: Array, scale: Array) -> Array | None:
    """Return a unit null vector of the Jacobian, `oriented`, or None where there are two."""
    _, sizes, vectors = np.linalg.svd(jacobian * scale)
    if sizes[-1] <= 1e-10 * sizes[0]:
        return None
    return scale * oriented(vectors[-1])


def next_tangent(jacobian: Array, row: Array, scale: Array) -> Array | None:
    """Return the unit null vector that has a positive product with a row."""
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


def orientation(jacobian: Array, tangent: Array, scale: Array) -> float:
    """Return the scaled determinant of the Jacobian bordered by the tangent."""
    return scaled_determinant(bordered(jacobian * scale, tangent / scale))


def point_after(
    previous: Point,
    evaluation: Evaluation,
    iterations: int,
    scale: Array,
    travelled: float | None = None,
) -> Point | None:
    """Return an evaluation as the point that follows another, or None where it has no tangent."""
    jacobian = evaluation.jacobian
    tangent = next_tangent(jacobian, previous.tangent / scale**2, scale)
    if tangent is None:
        return None
    if travelled is None:
        travelled = length(evaluation.unknowns - previous.unknowns, scale)
    sign = orientation(jacobian, tangent, scale)
    return Point(evaluation, tangent, sign, previous.arclength + travelled, iterations)


class DenseSystem:
    """Any problem in the form in which `newton` and `take_steps` ask for it."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.here: Evaluation | None = None

    def evaluate(self, z: list[float]) -> float:
        """Evaluate; returns the largest residual, NaN where F has no value."""
        try:
            self.here = self.problem.evaluate(np.array(z))
        except (ArithmeticError, ValueError):
            return math.nan
        return float(np.max(np.abs(self.here.residual)))

    def solve(self, row: list[float], g: float, out: list[float]) -> bool:
        """Fill `out` with the solution of the bordered system; whether there is one."""
        assert self.here is not None
        matrix = bordered(self.here.jacobian, np.array(row))
        try:
            out[:] = linear.solve(matrix, np.append(-self.here.residual, g)).tolist()
        except np.linalg.LinAlgError:
            return False
        return True

    def tangent_at(
        self, z: list[float], row: list[float], scale: list[float], out: list[float]
    ) -> float:
        """Fill `out` with the unit tangent along `row`; returns the orientation, NaN without."""
        assert self.here is not None
        sizes = np.array(scale)
        tangent = next_tangent(self.here.jacobian, np.array(row), sizes)
        if tangent is None:
            return math.nan
        out[:] = tangent.tolist()
        return orientation(self.here.jacobian, tangent, sizes)

    def observe(
        self, z: list[float], tangent: list[float], sign: float, rows: list[float], at: int
    ) -> None:
        """Put nothing into a row: test functions are asked of the evaluation."""
