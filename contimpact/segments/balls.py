r"""Kernels in ball arithmetic: every number encloses all values it stands for.

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
import re
from collections.abc import Callable, Sequence
from typing import Any

from flint import arb, arb_poly, arb_series, ctx, fmpq

from .arithmetic import PLAIN, Arithmetic
from .ball_flow import flow
from .ball_series import Number, around_zero, composed, constant, number
from .ball_transients import transients
from .stumpff import HIGHEST, TOGETHER
from .transients import TABLES

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
    names |= {"acos": _acos, "floor": _floor, "abs": _abs, "ratio": lambda p, q: arb(p) / q}
    names |= {"sinh": _sinh, "cosh": _cosh, "tanh": lambda x: _sinh(x) / _cosh(x)}
    names |= {f"stumpff{k}": functools.partial(_one, k) for k in range(HIGHEST + 1)}
    names |= {f"stumpffs{n}": functools.partial(_together, n) for n in TOGETHER}
    names |= {f"transients{order}": transients(order) for order in TABLES}
    names["flow"] = flow
    return Arithmetic(names | PLAIN, exact=True)


INTEGRATED = "its flights are integrated"
MANY_WAVES = "its flights are sums over more than eight harmonics"


def without_enclosures(source: str) -> str | None:
    """Return what a kernel calls that no enclosures are known of, given its source."""
    called = re.search(r"\b(flown|waves)\(", source)
    return None if called is None else {"flown": INTEGRATED, "waves": MANY_WAVES}[called[1]]


def _method(name: str) -> Callable[[Number], Number]:
    return lambda x: getattr(number(x), name)()


def _acos(x: Number) -> Number:
    return arb.pi() / 2 - number(x).asin()


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
        return [c + spread * _slopes(k, 1)[0] for k, c in _at(q.mid(), orders)]
    length = q.prec
    exact = _at(arb_series([q[0].mid(), 1], prec=length), orders)
    return [
        composed(series + arb_series([spread * c for c in _slopes(k, length)], prec=length), q)
        for k, series in exact
    ]


def _spread(ball: Number) -> Number:
    """The radius, times what slopes of Stumpff functions grow by at negative numbers."""
    low, radius = ball.lower(), ball.rad()
    return (-low).sqrt().cosh() * radius if low < 0 else radius


@functools.cache
def _slopes(k: int, length: int) -> list[Number]:
    """Balls that hold the slopes of the Taylor coefficients of c_k."""
    return [around_zero(fmpq(n + 1, math.factorial(2 * n + k + 2))) for n in range(length)]


def _at(q: Number, orders: Sequence[int]) -> list[tuple[int, Number]]:
    """The c_k, each with its k, at an exact number, or around it."""
    middle = constant(q)
    highest = max(*orders, 1)
    if abs(middle) < NEAR_ZERO:
        return [(k, _series(q, k)) for k in orders]
    lost = math.log2(math.factorial(highest)) - 0.5 * highest * math.log2(float(abs(middle)))
    with ctx.workprec(ctx.prec + 20 + max(0, math.ceil(lost))):
        x = (q if middle > 0 else -q).sqrt()
        sine, cosine = x.sin_cos() if middle > 0 else (_sinh(x), _cosh(x))
        found, inverse = [cosine, sine / x], 1 / q
        for k in range(highest - 1):
            found.append((_INVERSE_FACTORIAL[k] - found[k]) * inverse)
    return [(k, found[k]) for k in orders]


def _series(q: Number, k: int) -> Number:
    """The power series of c_k. For |q| < 1/2 its terms fall by half at least, and so do those of
    each Taylor coefficient from twice its order on: the rest is at most twice its first term."""
    length = q.prec if isinstance(q, arb_series) else 1
    terms = 2 * length + ctx.prec // 7
    powers = [(-1) ** j * fmpq(1, math.factorial(2 * j + k)) for j in range(terms)]
    near = arb_poly(powers)(arb_poly([constant(q), 1]))
    size = abs(constant(q)).upper()
    rest = [
        2 * math.comb(terms, n) * size ** (terms - n) / math.factorial(2 * terms + k)
        for n in range(length)
    ]
    found = [near[n] + around_zero(left) for n, left in enumerate(rest)]
    return arb_series(found, prec=length) if isinstance(q, arb_series) else found[0]
