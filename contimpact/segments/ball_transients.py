r"""Free motions of an oscillator in ball arithmetic: power series in time, with their remainders.

The mean :math:`G_{n,b}` of `transients` is :math:`\sum_m h_m t^m/(m + 2b - 1 - n)!` with
:math:`\sum_m h_m z^m = (1 + cz + kz^2)^{-b}`. Both roots of :math:`z^2 + cz + k` have at most the
size :math:`\rho = |c| + \sqrt{|k|}`, so that

.. math:: |h_m| \le \binom{m + 2b - 1}{2b - 1} \rho^m ,

which bounds what is left out. The time may be a power series; damping and stiffness are numbers.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

from flint import arb, arb_poly, arb_series, ctx

from ..arrays import Vector
from .ball_series import Number, around_zero, composed, power
from .transients import MOTIONS, TABLES


def transients(order: int) -> Callable[[Number, Number, Number], Vector]:
    """Return what `transients` of that order returns, as enclosures."""

    def function(c: Number, k: Number, t: Number) -> Vector:
        c, k = _held(c), _held(k)
        means = {(n, b): transient(n, b, c, k, t) for n, b in TABLES[order]}
        timed = (means[n, b] * power(t, 2 * b - 1 - n) for n, b in MOTIONS[order])
        return (*means.values(), *timed)

    return function


def _held(number: Number) -> Number:
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
    with ctx.workprec(_rounded_up(bits + 20 + math.ceil(3 * float(size * reach)), 32)):
        terms = _rounded_up(_terms(n, b, float(size * reach), bits, length), 16)
        near = _polynomial(n, b, c, k, terms)(arb_poly([here.mid(), 1]))
        if here.rad() != 0:
            near = near(arb_poly([here - here.mid(), 1]))
        found = [
            near[i] + around_zero(_left_out(n, b, size, reach, terms, i)) for i in range(length)
        ]
    found = [+x for x in found]
    if not isinstance(t, arb_series):
        return found[0]
    return composed(arb_series(found, prec=length), t)


def _first(n: int, b: int) -> int:
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


def _rounded_up(number: int, step: int) -> int:
    return -(-number // step) * step


def _polynomial(n: int, b: int, c: Number, k: Number, terms: int) -> Number:
    """The sum of the first powers of the time."""
    if c.is_exact() and k.is_exact():
        return _known(n, b, c.man_exp(), k.man_exp(), terms, ctx.prec)
    return arb_poly(_coefficients(n, b, c, k, terms))


@functools.lru_cache(maxsize=256)
def _known(n: int, b: int, c: Number, k: Number, terms: int, bits: int) -> Number:
    """The same for exact numbers, which are the same all along a branch."""
    return arb_poly(_coefficients(n, b, arb(c), arb(k), terms))


def _coefficients(n: int, b: int, c: Number, k: Number, terms: int) -> list[Number]:
    """Those of the powers of the time."""
    degree, first = 2 * b - 1 - n, _first(n, b)
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
    degree, first = 2 * b - 1 - n, _first(n, b)
    power = terms - first
    ways = math.comb(terms + 2 * b - 1, 2 * b - 1) * math.comb(power, i)
    term = ways * size**terms * reach ** (power - i) / math.factorial(terms + degree)
    return (2 * term).upper()
