r"""Test functions along a tube: functions of the flights that vanish at folds and period doublings.

With two multipliers they are the polynomial :math:`b\mu^2 - c\mu + a` at 1 and -1. With more, the
cyclic matrix C(mu) is singular: its determinant is the test function, in orthogonal coordinates U
and V in which it is diagonal in the middle of the tube, its smallest singular value last.
Elimination gives it as a product of pivots, and divides by none but the last one; where another one
may be zero, it is expanded by minors, without a division.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from flint import arb, arb_mat, arb_series

from .equations import Flight
from .orbit import characteristic
from .tube import Segment, coefficient

Test: TypeAlias = Callable[[list[Flight]], Any]


def doubling(flights: list[Flight]) -> Any:
    """The multipliers' polynomial at -1: with the product of impact speeds, so without poles."""
    b, c, a = characteristic(flights)
    return b + c + a


def turning(flights: list[Flight]) -> Any:
    """The same at 1: zero where the parameter turns along a branch."""
    b, c, a = characteristic(flights)
    return b - c + a


OF_TWO: dict[float, Test] = {1.0: turning, -1.0: doubling}
"""By the multiplier that passes the unit circle."""


def test_at(segment: Segment, mu: float) -> Test:
    """Return the test function of a multiplier, the same function for all of a segment."""
    return OF_TWO[mu] if segment.space.problem.m == 2 else _Determinant(segment, mu)


LARGEST = 8
"""Rows of matrices that are expanded by minors: it takes n 2^(n - 1) products."""

ELSEWHERE = (0.5, -0.5)
"""Where the multipliers' polynomial is evaluated besides: it is zero everywhere where flights
vanish, and that is no event."""


def regular(segment: Segment, flights: list[Flight]) -> bool:
    """Return whether the multipliers' polynomial is proven not to be zero everywhere."""
    if segment.space.problem.m == 2:
        b, c, a = characteristic(flights)
        return any(not (b * mu * mu - c * mu + a).contains(0) for mu in ELSEWHERE)
    return any(not _Determinant(segment, mu)(flights).contains(0) for mu in ELSEWHERE)


class _Determinant:
    """The determinant of C(mu), in coordinates in which it is diagonal in the middle."""

    def __init__(self, segment: Segment, mu: float) -> None:
        problem = segment.space.problem
        self.m, self.n, self.mu = problem.m, problem.n, mu
        here = problem.evaluate(segment.doubles(0.0))
        left, _, right = np.linalg.svd(here.cyclic(mu)[:, : self.n])
        self.left, self.right = arb_mat(left.T.tolist()), arb_mat(right.T.tolist())
        if any(matrix.det().contains(0) for matrix in (self.left, self.right)):
            raise ArithmeticError("the cyclic matrix has no singular vectors")

    def __call__(self, flights: list[Flight]) -> Any:
        rows = self._turned(self._cyclic(flights))
        found = _eliminated([list(row) for row in rows])
        if found is None and self.n > LARGEST:
            raise ArithmeticError("a pivot of the cyclic matrix may be zero")
        return _by_minors(rows) if found is None else found

    def _cyclic(self, flights: list[Flight]) -> list[list[Any]]:
        """C(mu)."""
        m, found = self.m, []
        for k, (_, start, end, _) in enumerate(flights):
            factor = self.mu if k == len(flights) - 1 else 1
            for r in range(m):
                row: list[Any] = [arb(0)] * self.n
                for c in range(m):
                    row[m * k + c] += start[m * r + c]
                    row[(m * k + m + c) % self.n] += factor * end[m * r + c]
                found.append(row)
        return found

    def _turned(self, rows: list[list[Any]]) -> list[list[Any]]:
        """U^T C V, of numbers or of power series."""
        length = max((x.prec for row in rows for x in row if isinstance(x, arb_series)), default=1)
        parts = [
            (self.left * arb_mat([[coefficient(x, j) for x in row] for row in rows]) * self.right)
            for j in range(length)
        ]
        tables = [part.tolist() for part in parts]
        if length == 1:
            return [list(row) for row in tables[0]]
        size = range(self.n)
        return [
            [arb_series([table[i][j] for table in tables], prec=length) for j in size] for i in size
        ]


def _eliminated(rows: list[list[Any]]) -> Any:
    """A determinant as the product of its pivots; None if one but the last may be zero."""
    total: Any = arb(1)
    for i, row in enumerate(rows[:-1]):
        if coefficient(row[i], 0).contains(0):
            return None
        total = total * row[i]
        for later in rows[i + 1 :]:
            factor = later[i] / row[i]
            for j in range(i + 1, len(rows)):
                later[j] = later[j] - factor * row[j]
    return total * rows[-1][-1]


def _by_minors(rows: list[list[Any]]) -> Any:
    """A determinant from the minors of its first rows, by the columns that these take."""
    size, minors = len(rows), {0: arb(1)}
    for row in rows:
        found: dict[int, Any] = {}
        for taken, minor in minors.items():
            for j in (j for j in range(size) if not taken >> j & 1):
                sign = (-1) ** (taken >> j).bit_count()
                more, columns = sign * row[j] * minor, taken | 1 << j
                found[columns] = found[columns] + more if columns in found else more
        minors = found
    return minors[2**size - 1]
