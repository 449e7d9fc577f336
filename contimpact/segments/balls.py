r"""Kernels in ball arithmetic: elementary functions and transients.

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
from collections.abc import Callable, Sequence
from typing import Any

from flint import arb, arb_poly, arb_series, ctx, fmpq

from ..arrays import Vector
from .ball_flow import Number, ball_around_zero, compose, constant, flow, number, power
from .layout import Family
from .segment import PLAIN, Arithmetic, Kernel
from .transients import HIGHEST, MOTIONS, TABLES, TOGETHER

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
    with ctx.workprec(_round_up(bits + 20 + math.ceil(3 * float(size * reach)), 32)):
        terms = _round_up(_terms(n, b, float(size * reach), bits, length), 16)
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
