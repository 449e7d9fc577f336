r"""Kernels in ball arithmetic: elementary functions, transients and linear flights.

Numbers are Arb's, of python-flint: midpoint and radius, every operation rounded outwards. A kernel
evaluated on them encloses its values at all arguments within the balls given; on truncated power
series (``arb_series``) it encloses their Taylor coefficients as well.

Elementary functions are Arb's own. The Stumpff functions have proven bounds: with
:math:`c_k(x^2) = \int_0^1 \frac{(1-u)^{k-1}}{(k-1)!} \cos(ux)\,du` for k > 0, and cos x for k = 0,

.. math:: \frac{|c_k^{(n)}(q)|}{n!} \le \frac{1}{(2n+k)!} \cosh\sqrt{\max(0, -q)} ,

because a derivative of :math:`\cos\sqrt y` is an average of cosines, times its value at zero. So
Taylor coefficients on a wide ball are enclosed by those at its midpoint and these slopes. A
midpoint's value is a closed form away from zero, and a series with its remainder near zero.

What a ball does not decide is refused: a `floor` that may be either of two numbers, an absolute
value of both signs. A time reduced to its period is the exception: which whole number of periods is
taken off does not matter, because a model's formulas have the period that it states.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np
from flint import arb, arb_mat, arb_poly, arb_series, ctx, fmpq

from ..arrays import Array, Vector
from .kernel import Family
from .linear_flow import Shape, generators, scales_of
from .segment import PLAIN, Arithmetic, Kernel
from .transients import HIGHEST, MOTIONS, TABLES, TOGETHER

# Balls and power series of them: what python-flint does not have.

Number: TypeAlias = Any
"""An ``arb``, or an ``arb_series`` of them."""


def number(x: Number) -> Number:
    """Return a number of a kernel as one of this arithmetic."""
    return x if isinstance(x, arb | arb_series) else arb(x)


def constant(x: Number) -> Number:
    """Return a number without its higher coefficients."""
    return x[0] if isinstance(x, arb_series) else number(x)


def ball_around_zero(radius: Number) -> Number:
    """Return the ball around zero that holds a radius, itself a ball."""
    return arb(0, 1) * radius


def power(x: Number, exponent: int) -> Number:
    """Return a whole power, not negative; python-flint has none of a ball around zero."""
    found = number(1)
    for _ in range(exponent):
        found = found * x
    return found


def compose(series: Number, x: Number) -> Number:
    """Return a function of a series, from its Taylor series at the constant term of this."""
    change = arb_series([0, *x.coeffs()[1:]], prec=x.prec)
    if change.length() == 0:  # python-flint takes the empty series for one with a constant term
        return arb_series([series[0]], prec=x.prec)
    return series(change)


# Matrices of truncated power series with derivatives, block by block, in ball arithmetic.
#
# A `Blocks` is :math:`\sum_k A_{k,0} u^k + \sum_{k,i} A_{k,i} u^k \delta_i`, with :math:`u^k = 0`
# from some order on and :math:`\delta_i\delta_j = 0`: the power series of a matrix in u, and those
# of its derivatives by some parameters. As one large matrix it would be block triangular, with
# every block in it many times (see `linear_flow.triangular`); a product takes each block once.

Matrix: TypeAlias = Any
"""An ``arb_mat``, or None for one that is zero."""

Blocks: TypeAlias = list[list[Matrix]]
"""``blocks[k][i]`` is A_{k,i}."""

SMALL = 6
"""The exponential's series is summed for a norm of 2 to minus this."""


def identity(size: int, like: Blocks) -> Blocks:
    """Return the identity, with as many blocks."""
    found: Blocks = [[None for _ in row] for row in like]
    found[0][0] = arb_mat([[int(i == j) for j in range(size)] for i in range(size)])
    return found


def product(a: Blocks, b: Blocks) -> Blocks:
    """Return a product; the first one may have fewer rows than columns."""
    found: Blocks = [[None for _ in row] for row in b]
    for j, row in enumerate(a):
        for k, column in enumerate(b[: len(b) - j]):
            into = found[j + k]
            for i, right in enumerate(column):
                _add(into, i, row[0], right)
            for i, left in enumerate(row[1:], start=1):
                _add(into, i, left, column[0])
    return found


def _add(into: list[Matrix], i: int, left: Matrix, right: Matrix) -> None:
    if left is None or right is None:
        return
    more = left * right
    into[i] = more if into[i] is None else into[i] + more


def map_blocks(function: Callable[..., Matrix], *all_blocks: Blocks) -> Blocks:
    """Return what a function makes of each block; those that are zero everywhere stay so."""
    return [
        [
            None if all(block is None for block in blocks) else function(*blocks)
            for blocks in zip(*rows, strict=True)
        ]
        for rows in zip(*all_blocks, strict=True)
    ]


def scale(a: Blocks, factor: Number) -> Blocks:
    """Return a multiple."""
    return map_blocks(lambda block: block * factor, a)


def add(a: Blocks, b: Blocks) -> Blocks:
    """Return a sum."""
    return map_blocks(lambda x, y: x if y is None else y if x is None else x + y, a, b)


def subtract(a: Blocks, b: Blocks) -> Blocks:
    """Return a difference."""
    return map_blocks(lambda x, y: -y if x is None else x if y is None else x - y, a, b)


def norm(a: Blocks) -> Number:
    """Return the largest sum of absolute values of a row, of all blocks, rounded upwards."""
    tables = [block.tolist() for row in a for block in row if block is not None]
    sums = [
        sum((abs(x) for row in rows for x in row), arb(0)).upper()
        for rows in zip(*tables, strict=True)
    ]
    return max(sums)


def exponential(a: Blocks) -> Blocks:
    """Return exp(A), by its series for A/2^r, squared r times."""
    if len(a) == len(a[0]) == 1:
        return [[a[0][0].exp()]]
    size = norm(a)
    doublings = max(0, math.ceil(math.log2(max(float(size), 1e-300))) + SMALL)
    part, size = scale(a, arb(2) ** -doublings), size / 2**doublings
    terms = _terms_of_exponential(float(size))
    found = _left_out_added(
        _exponential_series(part, terms), 2 * size**terms / math.factorial(terms)
    )
    for _ in range(doublings):
        found = product(found, found)
    return found


def _terms_of_exponential(size: float) -> int:
    """How many make the rest small beside the precision."""
    terms = 2
    while terms * math.log2(max(size, 1e-300)) - math.lgamma(terms + 1) / math.log(2) > -ctx.prec:
        terms += 1
    return terms


def _exponential_series(a: Blocks, terms: int) -> Blocks:
    """The first terms of exp(A), by powers of a power of A (Paterson and Stockmeyer)."""
    step = math.isqrt(terms - 1) + 1
    powers = [identity(a[0][0].nrows(), a), a]
    while len(powers) <= step:
        powers.append(product(powers[-1], a))
    total: Blocks | None = None
    for first in reversed(range(0, terms, step)):
        part = _combine(
            powers, [1 / arb(math.factorial(j)) for j in range(first, min(first + step, terms))]
        )
        total = part if total is None else add(part, product(total, powers[step]))
    assert total is not None
    return total


def _combine(powers: Sequence[Blocks], factors: Sequence[Number]) -> Blocks:
    total = scale(powers[0], factors[0])
    for power, factor in zip(powers[1:], factors[1:], strict=False):
        total = add(total, scale(power, factor))
    return total


def _left_out_added(a: Blocks, bound: Number) -> Blocks:
    """The sum with balls in every entry of every block."""
    rows, columns = a[0][0].nrows(), a[0][0].ncols()
    ball = ball_around_zero(bound.upper())
    rest = arb_mat([[ball] * columns for _ in range(rows)])
    return [[rest if block is None else block + rest for block in row] for row in a]


# Linear flights in ball arithmetic: series, blocks of matrices, and flows.
#
# `linear_flow` says what G is. The positions at the time t are :math:`P(t) = E e^{Gt}`, E being the
# first rows of the identity, and mean velocities are :math:`Q(t) = (P(t) - E)/t`. Their Taylor
# coefficients of order j around any time are
#
# .. math:: P_j = P\,\frac{G^j}{j!}, \qquad Q_j = \int_0^1 s^j\,E e^{Gts}\,\frac{G^{j+1}}{j!}\,ds,
#
# so that, with the largest sum g of a row of absolute values of G,
#
# .. math:: |P_j| \le e^{g|t|}\,\frac{g^j}{j!}, \qquad |Q_j| \le e^{g|t|}\,\frac{g^{j+1}}{(j+1)!} .
#
# On a ball of times all are summed from the coefficients at its midpoint, where the exponential is
# Arb's, and from these bounds for what is left out (Lagrange's remainder). Short flights are summed
# from the time zero, where nothing is divided by the time.
#
# Derivatives by parameters and power series are blocks beside G; g is the norm of
# all of them together.

SHORT = 1.0
"""Largest g|t| of flights summed from the time zero."""
MOST_TERMS = 4000
FLOW_TABLES = ((True, 0), (False, 1), (True, 1), (False, 2))
"""Matrices that `linear_flow.flow` returns: Q or P, and how often it is differentiated by the
time."""


def flow(d: int, h: int, directions: int, dt: Number, *numbers: Number) -> Entries:
    """Return what `linear_flow.flow` returns, as enclosures: of balls, or of power series."""
    shape = Shape(d, h, directions)
    time, given = number(dt), [number(x) for x in numbers]
    length = max([x.prec for x in (time, *given) if isinstance(x, arb_series)], default=1)
    varying = length if any(isinstance(x, arb_series) and x.length() > 1 for x in given) else 1
    orders = [[_coefficient(x, j) for x in given] for j in range(varying)]
    motion = _Motion(shape, orders, constant(time), length + 2)
    return Entries(motion, time, length)


def _coefficient(x: Number, j: int) -> Number:
    if isinstance(x, arb_series):
        return x[j]
    return x if j == 0 else arb(0)


class Entries:
    """What `flow` returns, each number made when it is asked for: kernels use a part of them. The
    length is that of power series; 1 for balls."""

    def __init__(self, motion: _Motion, time: Number, length: int) -> None:
        self.motion, self.time, self.length = motion, time, length
        self._known: dict[int, Number] = {}
        self._tables: dict[tuple[bool, int], Matrix] = {}

    def __len__(self) -> int:
        shape = self.motion.shape
        return (2 * shape.directions + len(FLOW_TABLES)) * shape.freedom * shape.size

    def __iter__(self) -> Iterator[Number]:
        return (self[place] for place in range(len(self)))

    def __getitem__(self, place: int) -> Number:
        if place not in self._known:
            self._known[place] = self._entry(place)
        return self._known[place]

    def _entry(self, place: int) -> Number:
        shape = self.motion.shape
        number_of_table, within = divmod(place, shape.freedom * shape.size)
        direction = max(0, (number_of_table - len(FLOW_TABLES)) // 2 + 1)
        kind = FLOW_TABLES[number_of_table if direction == 0 else number_of_table % 2]
        if kind not in self._tables:
            self._tables[kind] = self._table(*kind)
        column = direction * shape.freedom * shape.size + within
        unit = self.motion.unit(direction, *divmod(within, shape.size))
        found = [self._tables[kind][i, column] * unit for i in range(self.length)]
        if self.length > 1 or isinstance(self.time, arb_series):
            return arb_series(found, prec=self.length)
        return found[0]

    def _table(self, means: bool, rates: int) -> Matrix:
        """The coefficients of the series of all entries of Q or P, or of their rates by the time.

        With Taylor coefficients c_m by the time for each order of the parameters' series, they are
        sums of c_m (m)_rates times the powers of the time's change, that many orders later.
        """
        taylor = self.motion.taylor(means)
        rows = [[arb(0)] * (len(taylor) * self.motion.count) for _ in range(self.length)]
        for m, power in enumerate(self._powers):
            for order in range(len(taylor)):
                for i in range(self.length - order):
                    column = order * self.motion.count + m + rates
                    rows[order + i][column] = power[i] * math.perm(m + rates, rates)
        return arb_mat(rows) * arb_mat([row for part in taylor for row in part.tolist()])

    @functools.cached_property
    def _powers(self) -> list[Number]:
        """Powers of the time's change, as many as do not vanish."""
        if not isinstance(self.time, arb_series):
            return [[arb(1)] + [arb(0)] * self.length]
        change = arb_series([0, *self.time.coeffs()[1:]], prec=self.length)
        found = [arb_series([1], prec=self.length)]
        while len(found) < self.length:
            found.append(found[-1] * change)
        return found


class _Motion:
    """So many Taylor coefficients, on a ball of times, of what a linear flight is made of, from the
    numbers that `flow` takes, for each order of their power series."""

    def __init__(self, shape: Shape, orders: list[list[Number]], time: Number, count: int) -> None:
        self.shape, self.count = shape, count
        whole = self._balanced(orders)
        self.reach, self.growth = abs(time).upper(), norm(whole)
        turning = self.growth * self.reach
        short = turning < SHORT or 4 * abs(time.mid()) < self.reach
        self.middle = arb(0) if short else time.mid()
        self.beside = time - self.middle
        self.last = self._last(float(turning))
        with ctx.workprec(ctx.prec + 64 + self.last + math.ceil(1.5 * float(turning))):
            self.positions, self.means = self._around_middle(whole)
        self._taylor: dict[bool, list[Matrix]] = {}

    def _balanced(self, orders: list[list[Number]]) -> Blocks:
        """G, its derivatives and its power series, in the units of `scales_of`; a series in a
        variable that changes G fast is in so small a `step` of it that it does not."""
        matrices = [generators(self.shape, row, object) for row in orders]
        for later in matrices[1:]:
            later[0][: self.shape.freedom] *= 0
        middle = _doubles(matrices[0][0])
        scales = scales_of(self.shape, middle)
        self.balance = scales / scales[:, None]
        size = float(np.abs(middle * self.balance).max())
        slopes = (float(np.abs(_doubles(m) * self.balance).max()) for m in matrices[0][1:])
        self.sizes = [1.0, *(2.0 ** round(math.log2(s / size)) if s > 0.0 else 1.0 for s in slopes)]
        changes = [
            (float(np.abs(_doubles(m) * self.balance).max()) / (size * own)) ** (1.0 / k)
            for k, row in enumerate(matrices[1:], start=1)
            for m, own in zip(row, self.sizes, strict=True)
        ]
        self.step = 2.0 ** math.ceil(math.log2(max([1.0, *changes])))
        parts = [
            [
                m * self.balance / size / self.step**k
                for m, size in zip(row, self.sizes, strict=True)
            ]
            for k, row in enumerate(matrices)
        ]
        return [[_block(m.tolist()) for m in row] for row in parts]

    def _last(self, turning: float) -> int:
        """The order up to which Taylor series are summed: the rest is below the precision."""
        step, bits = float(self.growth * abs(self.beside).upper()), ctx.prec + 8
        for more in range(MOST_TERMS):
            left = more * math.log2(max(step, 1e-300)) - math.lgamma(more + 1.0) / math.log(2.0)
            if step == 0.0 or left + 1.5 * turning < -bits:
                return self.count + more
        raise ArithmeticError(f"a linear flight turns by {turning:.3g} radians")

    def _around_middle(self, whole: Blocks) -> tuple[list[Blocks], list[Blocks]]:
        """P_j and Q_j at the middle."""
        size = self.shape.size
        first = identity(size, whole)
        first[0][0] = arb_mat(first[0][0].tolist()[: self.shape.freedom])
        row = first
        if self.middle != 0:
            row = product(first, exponential(scale(whole, self.middle)))
        rows = [row]
        for j in range(1, self.last + 2):
            row = scale(product(row, whole), 1 / arb(j))
            rows.append(row)
        if self.middle == 0:
            return rows, rows[1:]
        by, means = 1 / self.middle, [first]
        for row in rows:
            means.append(scale(subtract(row, means[-1]), by))
        return rows, means[1:]

    @functools.cached_property
    def left_out(self) -> tuple[list[Number], list[Number]]:
        """Balls that hold what the Taylor series of P and of Q leave out."""
        beyond, step = self.last + 1, abs(self.beside).upper()
        grown = (self.growth * self.reach).exp()
        found = []
        for order in (beyond, beyond + 1):
            size = grown * self.growth**order / math.factorial(order)
            ways = ((math.comb(beyond, j), step ** (beyond - j)) for j in range(self.count))
            found.append([ball_around_zero((size * n * power).upper()) for n, power in ways])
        return found[0], found[1]

    def taylor(self, means: bool) -> list[Matrix]:
        """Return the Taylor coefficients of Q, or P, on the ball of times.

        For each order of the parameters' series a matrix: a row for each coefficient, in it the
        entries of the block without derivatives, then those of the other ones, in the units of
        `unit`.
        """
        if means not in self._taylor:
            rows = (self.means if means else self.positions)[: self.last + 1]
            found = [self._moved * self._flat(rows, order) for order in range(len(rows[0]))]
            self._taylor[means] = [
                self._with_left_out(part, means) * arb(self.step) ** k
                for k, part in enumerate(found)
            ]
        return self._taylor[means]

    @functools.cached_property
    def _moved(self) -> Matrix:
        """What makes Taylor coefficients on the ball of times from those at its middle."""
        powers = [arb(1)]
        while len(powers) <= self.last:
            powers.append(powers[-1] * self.beside)
        columns = range(self.last + 1)
        return arb_mat(
            [
                [math.comb(j, k) * powers[j - k] if j >= k else arb(0) for j in columns]
                for k in range(self.count)
            ]
        )

    def _flat(self, rows: Sequence[Blocks], order: int) -> Matrix:
        """The blocks of an order, each matrix as a row."""
        zeros = [arb(0)] * (self.shape.freedom * self.shape.size)
        return arb_mat(
            [
                [x for block in row[order] for x in (zeros if block is None else block.entries())]
                for row in rows
            ]
        )

    def _with_left_out(self, taylor: Matrix, means: bool) -> Matrix:
        width = taylor.ncols()
        return taylor + arb_mat([[left] * width for left in self.left_out[means]])

    def unit(self, direction: int, i: int, j: int) -> float:
        """Return the unit of an entry of a block, a power of two."""
        return float(self.sizes[direction] / self.balance[i, j])


def _block(rows: list[list[Number]]) -> Matrix:
    """A matrix, or None for that of zeros."""
    return None if all(x == 0 for row in rows for x in row) else arb_mat(rows)


def _doubles(matrix: Array) -> Array:
    """Midpoints of a matrix of balls."""
    return np.array([[float(arb(x).mid()) for x in row] for row in matrix.tolist()])


# Free motions of an oscillator in ball arithmetic: power series in time, with their remainders.
#
# The mean :math:`G_{n,b}` of `transients` is :math:`\sum_m h_m t^m/(m + 2b - 1 - n)!` with
# :math:`\sum_m h_m z^m = (1 + cz + kz^2)^{-b}`. Both roots of :math:`z^2 + cz + k` have at most the
# size :math:`\rho = |c| + \sqrt{|k|}`, so that
#
# .. math:: |h_m| \le \binom{m + 2b - 1}{2b - 1} \rho^m ,
#
# which bounds what is left out. The time may be a power series; damping and stiffness are numbers.


def transients(order: int) -> Callable[[Number, Number, Number], Vector]:
    """Return what `transients` of that order returns, as enclosures."""

    def function(c: Number, k: Number, t: Number) -> Vector:
        c, k = _constant_coefficient(c), _constant_coefficient(k)
        means = {(n, b): transient(n, b, c, k, t) for n, b in TABLES[order]}
        timed = (means[n, b] * power(t, 2 * b - 1 - n) for n, b in MOTIONS[order])
        return (*means.values(), *timed)

    return function


def _constant_coefficient(number: Number) -> Number:
    """A coefficient that does not vary."""
    if isinstance(number, arb_series):
        if any(c != 0 for c in number.coeffs()[1:]):
            raise ArithmeticError("free motions have no enclosures where damping or stiffness vary")
        return number[0]
    return arb(number)


def transient(n: int, b: int, c: Number, k: Number, t: Number) -> Number:
    """Return the mean (n, b), or the function of time where n >= 2b, at a time."""
    length = t.prec if isinstance(t, arb_series) else 1
    here = t[0] if isinstance(t, arb_series) else arb(t)
    size = (abs(c) + abs(k).sqrt()).upper()
    reach = abs(here).upper()
    bits = ctx.prec
    long = float(size * reach)
    if float(size * here.rad()) > WIDE:
        found = [arb(0, math.inf)] * length
        return arb_series(found, prec=length) if isinstance(t, arb_series) else found[0]
    if long > LONG and (closed := _from_roots(n, b, c, k, here, length)) is not None:
        return compose(closed, t) if isinstance(t, arb_series) else closed[0]
    with ctx.workprec(_round_up(bits + 20 + math.ceil(3 * long), 32)):
        terms = _round_up(_terms(n, b, long, bits, length), 16)
        near = _polynomial(n, b, c, k, terms)(arb_poly([here.mid(), 1]))
        if here.rad() != 0:
            near = near(arb_poly([here - here.mid(), 1]))
        found = [
            near[i] + ball_around_zero(_left_out(n, b, size, reach, terms, i))
            for i in range(length)
        ]
    found = [+x for x in found]
    if not isinstance(t, arb_series):
        return found[0]
    return compose(arb_series(found, prec=length), t)


def _first_power(n: int, b: int) -> int:
    """The first power of z that is not an impulse."""
    return max(0, n + 1 - 2 * b)


def _terms(n: int, b: int, reach: float, bits: int, length: int) -> int:
    """How many powers of the time to take: as many as make the rest small, and its ratio 1/2."""
    m = max(8, 2 * b + length + abs(n))
    while reach * (m + 2 * b) > 0.4 * (m + 1 - length) * (m + 2 * b - 1 - n):
        m += 4
    size = m * math.log2(max(reach, 1e-300)) - math.lgamma(m) / math.log(2.0)
    while size > -bits - 20:
        m += 4
        size = m * math.log2(max(reach, 1e-300)) - math.lgamma(m) / math.log(2.0) + 6 * b
    return m


def _round_up(number: int, step: int) -> int:
    return -(-number // step) * step


def _polynomial(n: int, b: int, c: Number, k: Number, terms: int) -> Number:
    """The sum of the first powers of the time."""
    if c.is_exact() and k.is_exact():
        return _exact_coefficients(n, b, c.man_exp(), k.man_exp(), terms, ctx.prec)
    return arb_poly(_coefficients(n, b, c, k, terms))


@functools.lru_cache(maxsize=256)
def _exact_coefficients(n: int, b: int, c: Number, k: Number, terms: int, bits: int) -> Number:
    """The same for exact numbers, which are the same all along a branch."""
    return arb_poly(_coefficients(n, b, arb(c), arb(k), terms))


def _coefficients(n: int, b: int, c: Number, k: Number, terms: int) -> list[Number]:
    """Those of the powers of the time."""
    degree, first = 2 * b - 1 - n, _first_power(n, b)
    here, before = arb(1), arb(0)
    found = []
    for m in range(terms):
        if m >= first:
            found.append(here / math.factorial(m + degree))
        here, before = -(c * (m + b) * here + k * (m + 2 * b - 1) * before) / (m + 1), here
    return found


def _left_out(n: int, b: int, size: Number, reach: Number, terms: int, i: int) -> Number:
    """A bound of the i-th Taylor coefficient of the rest: twice that of its first term.

    Terms fall by half at least, see `_terms`.
    """
    degree, first = 2 * b - 1 - n, _first_power(n, b)
    power = terms - first
    ways = math.comb(terms + 2 * b - 1, 2 * b - 1) * math.comb(power, i)
    term = ways * size**terms * reach ** (power - i) / math.factorial(terms + degree)
    return (2 * term).upper()


WIDE = 8.0
"""Radius of a ball of times, times the size of roots, from which on power series enclose next to
nothing: the largest is their number e times that."""
LONG = 30.0
"""Times the size of roots, of a time from which on power series have too many terms."""
APART = 16.0
"""Least product of p = k - c^2/4 and the time squared for closed forms: roots are apart."""
BEYOND = 3
"""Taylor coefficients behind those asked for, the last of them over the whole ball of times."""


def _from_roots(n: int, b: int, c: Number, k: Number, here: Number, length: int) -> Number:
    """The Taylor coefficients of a mean from its closed form; None where that cancels.

    A ball of times is left at its middle: what Taylor's formula leaves out there is the last
    coefficient at all times of the ball.
    """
    p, order = k - c * c / 4, length + BEYOND
    if not (k != 0 and (p > 0 or p < 0) and abs(p) * here * here > APART):
        return None
    with ctx.workprec(ctx.prec + 40):
        middle = _mean(n, b, c, k, p, arb_series([here.mid(), 1], prec=order))
        around = _mean(n, b, c, k, p, arb_series([here, 1], prec=order + 1))
        taylor = arb_poly([*(middle[i] for i in range(order)), around[order]])
        found = taylor(arb_poly([here - here.mid(), 1]))
    return arb_series([+found[i] for i in range(length)], prec=length)


def _mean(n: int, b: int, c: Number, k: Number, p: Number, t: Number) -> Number:
    r"""The mean (n, b), or the function of time, on a power series of times.

    With :math:`D = s^2 + cs + k` the inverse transform of :math:`1/D^b` is
    :math:`e^{-ct/2} h_b(t)`, :math:`h_1 = \sin(\sqrt p\,t)/\sqrt p` or its hyperbolic form. As
    :math:`t\,h_b = 2b\,h_{b+1}'` and :math:`h_{b+1}'' + p\,h_{b+1} = h_b`,

    .. math:: 2bp\,h_{b+1} = (2b - 1)\,h_b - t\,h_b' .

    Other powers of s follow from :math:`s^2/D^b = 1/D^{b-1} - cs/D^b - k/D^b`, without impulses.
    """
    root = abs(p).sqrt()
    sine, cosine = (root * t).sin_cos() if p > 0 else (_sinh(root * t), _cosh(root * t))
    decay, motion, rate = (-c * t / 2).exp(), sine / root, cosine
    row: list[Number] = [arb(1), *[arb(0)] * (n + 1)]  # from n = -1 on, of b = 0
    for power_of_d in range(1, b + 1):
        before, row = row, [None, decay * motion, decay * (rate - c / 2 * motion)]
        row[0] = (before[0] - row[2] - c * row[1]) / k
        for m in range(2, n + 1):
            row.append(before[m - 1] - c * row[-1] - k * row[-2])
        doubled = 2 * power_of_d
        motion, rate = ((doubled - 1) * motion - t * rate) / (doubled * p), t * motion / doubled
    return row[n + 1] / power(t, 2 * b - 1 - n) if n < 2 * b else row[n + 1]


NEAR_ZERO = 0.5
"""Size of arguments below which Stumpff functions are summed as series."""

_INVERSE_FACTORIAL = [fmpq(1, math.factorial(k)) for k in range(HIGHEST + 1)]


class UndecidedError(ArithmeticError):
    """A ball does not decide what a kernel does next."""


class Time:
    """The time of an impact, as a kernel's argument: it may be reduced to the forcing's period."""

    __slots__ = ("value",)

    def __init__(self, value: Number) -> None:
        self.value = value

    def __mod__(self, period: Number) -> Number:
        return self.value - turns(self.value, period) * period

    def __truediv__(self, other: Number) -> _Turns:
        return _Turns(turns(self.value, other))

    def __sub__(self, other: Number) -> Number:
        return self.value - other

    def __rsub__(self, other: Number) -> Number:
        return other - self.value


class _Turns:
    """What `floor` makes a whole number of."""

    def __init__(self, whole: int) -> None:
        self.whole = whole


def turns(time: Number, period: Number) -> int:
    """Return how many whole periods lie before a time, near its midpoint."""
    return math.floor(float(constant(time).mid()) / float(constant(period).mid()))


def balls(bits: int) -> Arithmetic:
    """Return the arithmetic of balls and of power series of them, with constants to `bits` bits."""
    with ctx.workprec(bits):
        names: dict[str, Any] = {"pi": arb.pi(), "nan": arb.nan()}
    names |= {name: _method(name) for name in "sin cos tan asin atan exp log sqrt".split()}
    names |= {"floor": _floor, "abs": _abs, "ratio": lambda p, q: arb(p) / q}
    names["acos"] = lambda x: arb.pi() / 2 - number(x).asin()
    names |= {"sinh": _sinh, "cosh": _cosh, "tanh": lambda x: _sinh(x) / _cosh(x)}
    names |= {f"stumpff{k}": functools.partial(_one, k) for k in range(HIGHEST + 1)}
    names |= {f"stumpffs{n}": functools.partial(_together, n) for n in TOGETHER}
    names |= {f"transients{order}": transients(order) for order in TABLES}
    names["flow"] = flow
    return Arithmetic(names | PLAIN, exact=True, number=number, time=Time)


INTEGRATED = "its flights are integrated"
MANY_WAVES = "its flights are sums over more than eight harmonics"


def without_enclosures(kernel: Kernel) -> str | None:
    """Return why no enclosures of a kernel's values are known, None where they are."""
    return {Family.INTEGRATED: INTEGRATED, Family.HARMONICS: MANY_WAVES}.get(kernel.family)


def _method(name: str) -> Callable[[Number], Number]:
    return lambda x: getattr(number(x), name)()


def _sinh(x: Number) -> Number:
    grown = number(x).exp()
    return (grown - 1 / grown) / 2


def _cosh(x: Number) -> Number:
    grown = number(x).exp()
    return (grown + 1 / grown) / 2


def _floor(x: Number) -> Number:
    if isinstance(x, _Turns):
        return arb(x.whole)
    whole = constant(x).floor().unique_fmpz()
    if whole is None:
        raise UndecidedError(f"floor of {constant(x)}")
    return arb(whole)


def _abs(x: Number) -> Number:
    here = constant(x)
    if isinstance(x, arb_series) and not (here > 0 or here < 0):
        raise UndecidedError(f"the sign of {here}")
    return abs(x) if not isinstance(x, arb_series) else x if here > 0 else -x


# Stumpff functions.


def _one(k: int, q: Number) -> Number:
    return stumpff([k], number(q))[0]


def _together(highest: int, q: Number) -> tuple[Number, ...]:
    return tuple(stumpff(range(1, highest + 1), number(q)))


def stumpff(orders: Sequence[int], q: Number) -> list[Number]:
    """Return enclosures of some c_k, of a ball or of a power series."""
    spread = _spread(constant(q))
    if not isinstance(q, arb_series):
        exact = _coefficients_at(q.mid(), max(orders))
        return [exact[k] + spread * _slopes(k, 1)[0] for k in orders]
    length = q.prec
    exact = _coefficients_at(arb_series([q[0].mid(), 1], prec=length), max(orders))
    return [
        compose(exact[k] + arb_series([spread * c for c in _slopes(k, length)], prec=length), q)
        for k in orders
    ]


def _spread(ball: Number) -> Number:
    """The radius, times what slopes of Stumpff functions grow by at negative numbers."""
    low, radius = ball.lower(), ball.rad()
    return (-low).sqrt().cosh() * radius if low < 0 else radius


@functools.cache
def _slopes(k: int, length: int) -> list[Number]:
    """Balls that hold the slopes of the Taylor coefficients of c_k."""
    return [ball_around_zero(fmpq(n + 1, math.factorial(2 * n + k + 2))) for n in range(length)]


def _coefficients_at(q: Number, highest: int) -> list[Number]:
    """The c_k up to the highest, at an exact number, or around it.

    Near zero the two last are series, from which the others follow.
    """
    middle, highest = constant(q), max(highest, 1)
    if abs(middle) < NEAR_ZERO:
        found = [_series(q, highest), _series(q, highest - 1)]
        for k in reversed(range(highest - 1)):
            found.append(_INVERSE_FACTORIAL[k] - q * found[-2])
        return found[::-1]
    lost = math.log2(math.factorial(highest)) - 0.5 * highest * math.log2(float(abs(middle)))
    with ctx.workprec(ctx.prec + 20 + max(0, math.ceil(lost))):
        x = (q if middle > 0 else -q).sqrt()
        sine, cosine = x.sin_cos() if middle > 0 else (_sinh(x), _cosh(x))
        found, inverse = [cosine, sine / x], 1 / q
        for k in range(highest - 1):
            found.append((_INVERSE_FACTORIAL[k] - found[k]) * inverse)
    return found


def _series(q: Number, k: int) -> Number:
    """The power series of c_k. For |q| < 1/2 its terms fall by half at least, and so do those of
    each Taylor coefficient from twice its order on: the rest is at most twice its first term."""
    length = q.prec if isinstance(q, arb_series) else 1
    middle, terms = constant(q), 2 * length + ctx.prec // 7
    polynomials, rests = _terms_of_series(k, terms, length, ctx.prec)
    size = abs(middle).upper()
    powers = [size ** (terms - length + 1)]
    for _ in range(length - 1):
        powers.append(powers[-1] * size)
    pairs = zip(polynomials, rests, reversed(powers), strict=True)
    found = [p(middle) + rest * power for p, rest, power in pairs]
    return arb_series(found, prec=length) if isinstance(q, arb_series) else found[0]


@functools.cache
def _terms_of_series(
    k: int, terms: int, length: int, bits: int
) -> tuple[list[Number], list[Number]]:
    """The first terms of the Taylor coefficients of c_k as polynomials, and balls for their rests,
    to be multiplied by powers of |q|."""
    signed = [(-1) ** j * fmpq(1, math.factorial(2 * j + k)) for j in range(terms)]
    first = [
        arb_poly([math.comb(j, n) * signed[j] for j in range(n, terms)]) for n in range(length)
    ]
    rests = [fmpq(2 * math.comb(terms, n), math.factorial(2 * terms + k)) for n in range(length)]
    return first, [ball_around_zero(arb(rest)) for rest in rests]
