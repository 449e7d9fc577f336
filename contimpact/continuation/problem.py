"""What a problem must provide, its metric, and its linear equations."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from ..arrays import Array, Vector

if TYPE_CHECKING:
    from scipy.sparse.linalg import SuperLU


class Evaluation(Protocol):
    """A problem evaluated at one point. A problem may keep more here for its test functions."""

    @property
    def unknowns(self) -> Array:
        """The point, shape (n + 1,); the free parameter is last."""

    @property
    def residual(self) -> Array:
        """F, shape (n,)."""

    @property
    def jacobian(self) -> Array:
        """dF/d(unknowns), shape (n, n + 1)."""


E = TypeVar("E", bound=Evaluation, covariant=True)
"""Evaluation that a problem makes at a point."""


class Problem(Protocol[E]):
    """n equations in n + 1 unknowns, the last of which is the free parameter."""

    def evaluate(self, unknowns: Array) -> E:
        """Evaluate at a point. `ArithmeticError` and `ValueError` say that F has no value there."""

    def scale(self, unknowns: Array, span: float) -> Array:
        """Return natural sizes of the unknowns, shape (n + 1,), given the parameter's."""

    def difference(self, one: Array, other: Array) -> Array:
        """Return one - other, zero where both stand for the same solution."""


# Lengths and angles, measured by natural sizes w of the unknowns: |a|^2 = sum (a_i/w_i)^2.
#
# `inner_product` and `length` take arrays; the others are in the plain subset of Python that
# `contimpact.compiling` compiles, and take lists as well.

EPSILON = float(np.finfo(float).eps)


def inner_product(a: Array, b: Array, scale: Array) -> float:
    """Return the metric's inner product."""
    return float(np.dot(a / scale, b / scale))


def length(a: Array, scale: Array) -> float:
    """Return the metric's norm."""
    return float(np.linalg.norm(a / scale))


def norm(z: Vector, scale: Vector) -> float:
    """Return the length of a vector."""
    size = 0.0
    for i in range(len(z)):
        part = z[i] / scale[i]
        size += part * part
    return math.sqrt(size)


def distance(one: Vector, other: Vector, scale: Vector) -> float:
    """Return the length of the difference of two vectors."""
    size = 0.0
    for i in range(len(one)):
        part = (one[i] - other[i]) / scale[i]
        size += part * part
    return math.sqrt(size)


def angle(one: Vector, other: Vector, scale: Vector) -> float:
    """Return the angle between two unit tangents, accurate also when small."""
    return 2.0 * math.asin(min(1.0, 0.5 * distance(one, other, scale)))


# Square linear systems: dense for short problems, sparse LU with partial pivoting for long ones.
#
# The matrices are cyclic chains of small blocks with a few full columns or rows. An elimination
# along the chain without pivoting would lose all digits where flights expand; SuperLU pivots.

DENSE_UP_TO = 400
"""Rows up to which dense elimination is the faster one, the conversion counted."""


def solve(matrix: Array, right: Array) -> Array:
    """Solve a square system; numpy.linalg.LinAlgError if the matrix is exactly singular."""
    if len(matrix) <= DENSE_UP_TO:
        return np.asarray(np.linalg.solve(matrix, right))
    return np.asarray(_factors(matrix).solve(right))


def log_determinant(matrix: Array) -> tuple[float, float]:
    """Return sign and logarithm of the absolute value of a determinant."""
    if len(matrix) <= DENSE_UP_TO:
        sign, logarithm = np.linalg.slogdet(matrix)
        return float(sign), float(logarithm)
    try:
        factors = _factors(matrix)
    except np.linalg.LinAlgError:
        return 0.0, -np.inf
    diagonal = factors.U.diagonal()
    sign = np.prod(np.sign(diagonal)) * _parity(factors.perm_r) * _parity(factors.perm_c)
    return float(sign), float(np.sum(np.log(np.abs(diagonal))))


def _factors(matrix: Array) -> SuperLU:
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu

    try:
        return splu(csc_matrix(matrix))
    except RuntimeError as error:  # SuperLU's word for exactly singular
        raise np.linalg.LinAlgError(str(error)) from None


def _parity(permutation: Array) -> int:
    """+1 for an even permutation, -1 for an odd one."""
    places, seen, sign = permutation.tolist(), set(), 1
    for first in range(len(places)):
        length, here = 0, first
        while here not in seen:
            seen.add(here)
            here = places[here]
            length += 1
        sign *= -1 if length and length % 2 == 0 else 1
    return sign
