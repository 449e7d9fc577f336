r"""Linear flights in ball arithmetic: the flow of :math:`\dot X = GX`, with its remainders.

`linear_flow` says what G is. The positions at the time t are :math:`P(t) = E e^{Gt}`, E being the
first rows of the identity, and mean velocities are :math:`Q(t) = (P(t) - E)/t`. Their Taylor
coefficients of order j around any time are

.. math:: P_j = P\,\frac{G^j}{j!}, \qquad Q_j = \int_0^1 s^j\,E e^{Gts}\,\frac{G^{j+1}}{j!}\,ds,

so that, with the largest sum g of a row of absolute values of G,

.. math:: |P_j| \le e^{g|t|}\,\frac{g^j}{j!}, \qquad |Q_j| \le e^{g|t|}\,\frac{g^{j+1}}{(j+1)!} .

On a ball of times all are summed from the coefficients at its midpoint, where the exponential is
Arb's, and from these bounds for what is left out (Lagrange's remainder). Short flights are summed
from the time zero, where nothing is divided by the time.

Derivatives by parameters and power series are blocks of a larger matrix, as in `linear_flow`.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from flint import arb, arb_mat, arb_poly, arb_series, ctx

from .ball_series import Number, around_zero, composed, constant, number
from .linear_flow import Shape, generators, scales_of, toeplitz, triangular

SHORT = 1.0
"""Largest g|t| of flights summed from the time zero."""
MOST_TERMS = 4000
TABLES = ((True, 0), (False, 1), (True, 1), (False, 2))
"""What `linear_flow.flow` returns: Q or P, and how often it is differentiated by the time."""


def flow(d: int, h: int, directions: int, dt: Any, *numbers: Any) -> list[Number]:
    """Return what `linear_flow.flow` returns, as enclosures: of balls, or of power series."""
    shape = Shape(d, h, directions)
    time, given = number(dt), [number(x) for x in numbers]
    length = max([x.prec for x in (time, *given) if isinstance(x, arb_series)], default=1)
    varying = length if any(_varies(x) for x in given) else 1
    orders = [[_coefficient(x, j) for x in given] for j in range(varying)]
    motion = _Motion(shape, orders, constant(time), length + 2)
    found = []
    for direction in range(directions + 1):
        for table in TABLES[: 4 if direction == 0 else 2]:
            for i, j in itertools.product(range(d), range(shape.size)):
                parts = [
                    motion.taylor(*table, i, j, direction, order) for order in range(len(orders))
                ]
                found.append(_along(time, parts))
    return [+x if isinstance(x, arb) else x for x in found]


def _varies(x: Any) -> bool:
    """Whether a number has higher coefficients: its powers then have all of them."""
    return isinstance(x, arb_series) and x.length() > 1


def _coefficient(x: Any, j: int) -> Any:
    if isinstance(x, arb_series):
        return x[j]
    return x if j == 0 else arb(0)


def _along(time: Any, orders: Sequence[list[Any]]) -> Number:
    """A function of the time as a power series, from its Taylor coefficients for each order of the
    parameters' series."""
    length = max(time.prec if isinstance(time, arb_series) else 1, len(orders))
    total = [arb(0)] * length
    for j, taylor in enumerate(orders):
        part = taylor[:1]
        if isinstance(time, arb_series):
            part = composed(arb_series(taylor[: length - j], prec=length - j), time).coeffs()
        for i, c in enumerate(part[: length - j]):
            total[j + i] += c
    return total[0] if length == 1 else arb_series(total, prec=length)


class _Motion:
    """Taylor coefficients, on a ball of times, of what a linear flight is made of.

    Parameters
    ----------
    shape : Shape
    orders : list of list of arb
        The numbers that `flow` takes, for each order of their power series.
    time : arb
    count : int
        How many coefficients are wanted.
    """

    def __init__(self, shape: Shape, orders: list[list[Any]], time: Any, count: int) -> None:
        self.shape, self.count = shape, count
        whole = self._balanced(orders)
        self.reach, self.growth = abs(time).upper(), _norm(whole)
        turning = self.growth * self.reach
        short = turning < SHORT or 4 * abs(time.mid()) < self.reach
        self.middle = arb(0) if short else time.mid()
        self.beside = time - self.middle
        self.last = self._last(float(turning))
        with ctx.workprec(ctx.prec + 64 + self.last + math.ceil(1.5 * float(turning))):
            self.positions, self.means = self._around_middle(whole)
        self._known: dict[tuple[bool, int, int], list[Any]] = {}

    def _balanced(self, orders: list[list[Any]]) -> Any:
        """G, its derivatives and its power series as one matrix, in the units of `scales_of`."""
        matrices = [generators(self.shape, row, object) for row in orders]
        for later in matrices[1:]:
            later[0][: self.shape.freedom] *= 0
        middle = _doubles(matrices[0][0])
        scales = scales_of(self.shape, middle)
        self.balance = scales / scales[:, None]
        size = float(np.abs(middle * self.balance).max())
        slopes = (float(np.abs(_doubles(m) * self.balance).max()) for m in matrices[0][1:])
        self.sizes = [1.0, *(2.0 ** round(math.log2(s / size)) if s > 0.0 else 1.0 for s in slopes)]
        blocks = [triangular([m * self.balance for m in row], self.sizes) for row in matrices]
        return arb_mat(toeplitz(blocks).tolist())

    def _last(self, turning: float) -> int:
        """The order up to which Taylor series are summed: the rest is below the precision."""
        step, bits = float(self.growth * abs(self.beside).upper()), ctx.prec + 8
        for more in range(MOST_TERMS):
            left = more * math.log2(max(step, 1e-300)) - math.lgamma(more + 1.0) / math.log(2.0)
            if step == 0.0 or left + 1.5 * turning < -bits:
                return self.count + more
        raise ArithmeticError(f"a linear flight turns by {turning:.3g} radians")

    def _around_middle(self, whole: Any) -> tuple[list[Any], list[Any]]:
        """P_j and Q_j at the middle."""
        d = self.shape.freedom
        first = arb_mat([[int(i == j) for j in range(whole.ncols())] for i in range(d)])
        row = first if self.middle == 0 else first * (whole * self.middle).exp()
        rows = [row]
        for j in range(1, self.last + 2):
            row = row * whole * (1 / arb(j))
            rows.append(row)
        if self.middle == 0:
            return rows, rows[1:]
        by, means = 1 / self.middle, [first]
        for row in rows:
            means.append((row - means[-1]) * by)
        return rows, means[1:]

    @functools.cached_property
    def left_out(self) -> tuple[list[Any], list[Any]]:
        """Balls that hold what the Taylor series of P and of Q leave out."""
        beyond, step = self.last + 1, abs(self.beside).upper()
        grown = (self.growth * self.reach).exp()
        found = []
        for order in (beyond, beyond + 1):
            size = grown * self.growth**order / math.factorial(order)
            ways = ((math.comb(beyond, j), step ** (beyond - j)) for j in range(self.count))
            found.append([around_zero((size * n * power).upper()) for n, power in ways])
        return found[0], found[1]

    def taylor(
        self, means: bool, rates: int, i: int, j: int, direction: int, order: int
    ) -> list[Any]:
        """Return the Taylor coefficients of an entry of P or Q, or of one of its rates.

        Parameters
        ----------
        means : bool
            Whether of Q.
        rates : int
            How often it is differentiated by the time.
        i, j : int
            Its place.
        direction, order : int
            Of the block: the derivative by a parameter, the coefficient of a power series.
        """
        column = self.shape.size * (len(self.sizes) * order + direction) + j
        if (means, i, column) not in self._known:
            unit = self.sizes[direction] / float(self.balance[i, j])
            self._known[means, i, column] = self._summed(means, i, column, unit)
        known = self._known[means, i, column]
        return [c * math.perm(k, rates) for k, c in enumerate(known)][rates:]

    def _summed(self, means: bool, i: int, column: int, unit: float) -> list[Any]:
        """The Taylor coefficients of an entry on the ball of times."""
        rows = self.means if means else self.positions
        around = arb_poly([row[i, column] for row in rows[: self.last + 1]])
        near = around(arb_poly([self.beside, 1]))
        return [(near[k] + left) * unit for k, left in enumerate(self.left_out[means])]


def _doubles(matrix: Any) -> Any:
    """Midpoints of a matrix of balls."""
    return np.array([[float(arb(x).mid()) for x in row] for row in matrix.tolist()])


def _norm(matrix: Any) -> Any:
    """The largest sum of absolute values of a row, rounded upwards."""
    sums = [sum((abs(x) for x in row), arb(0)).upper() for row in matrix.tolist()]
    return max(sums)
