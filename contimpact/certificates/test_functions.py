r"""Test functions along a tube: functions of the flights that vanish at folds and period doublings.

With two multipliers they are the polynomial :math:`b\mu^2 - c\mu + a` at 1 and -1. With more, the
cyclic matrix C(mu) is singular. In orthogonal coordinates U and V in which it is diagonal in the
middle of the tube, its smallest singular value last, elimination gives its determinant as a product
of pivots. If none but the last one can be zero, that one is the test function: it vanishes with the
determinant, and nothing is divided by it.
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
    return OF_TWO[mu] if segment.space.problem.m == 2 else _LastPivot(segment, mu)


ELSEWHERE = (0.5, -0.5)
"""Where the multipliers' polynomial is evaluated besides: it is zero everywhere where flights
vanish, and that is no event."""


def regular(segment: Segment, flights: list[Flight]) -> bool:
    """Return whether the multipliers' polynomial is proven not to be zero everywhere."""
    if segment.space.problem.m == 2:
        b, c, a = characteristic(flights)
        return any(not (b * mu * mu - c * mu + a).contains(0) for mu in ELSEWHERE)
    return any(not _LastPivot(segment, mu)(flights).contains(0) for mu in ELSEWHERE)


class _LastPivot:
    """The last pivot of C(mu), in coordinates in which it is diagonal in the middle."""

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
        for i in range(self.n - 1):
            pivot = rows[i][i]
            if coefficient(pivot, 0).contains(0):
                raise ArithmeticError("a pivot of the cyclic matrix may be zero")
            for later in rows[i + 1 :]:
                factor = later[i] / pivot
                for j in range(i + 1, self.n):
                    later[j] = later[j] - factor * rows[i][j]
        return rows[-1][-1]

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
