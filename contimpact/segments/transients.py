r"""Stumpff functions and transients of linear flights, in floats, arrays and exact arithmetic.

With y = ct/2 and kappa = kt^2 let :math:`D = s^2 + 2ys + \kappa`, and let :math:`G_{n,b}` be the
inverse Laplace transform of :math:`s^n/D^b` at time one, without impulses at time zero:
:math:`G_{0,1}` is the motion from unit velocity, :math:`G_{1,1}` its velocity and
:math:`\kappa\,G_{-1,1}` the fall from unit displacement. A derivative is one function more of the
family, :math:`\partial_y G_{n,b} = -2b\,G_{n+1,b+1}` and
:math:`\partial_\kappa G_{n,b} = -b\,G_{n,b+1}`, so that differentiating does not cancel either.

Where the roots of D are complex, or closer than 4, the functions are made from those of
:math:`\sigma^2 + q` with sigma = s + y and q = kappa - y^2. Further apart they are sums over both
roots, of which the slow one is kappa by the fast one: -y + sqrt(y^2 - kappa) would lose kappa
beside y^2.

With n < 2b, the :math:`G_{n,b}` are means over the motion so far, and have a limit for short
flights. The functions of time are :math:`g_{n,b} = t^{2b-1-n} G_{n,b}`; those with n >= 2b, which
appear as accelerations, are given in this form only. Both forms are given because each is
differentiated in its own: as a product, the rate of :math:`g_{n,b}` would be a small difference.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Number, Vector

# Stumpff functions: cosines, sines and what is left of them, without cancellation.
#
# .. math:: c_k(q) = \sum_{j \ge 0} \frac{(-q)^j}{(2j + k)!}
#
# so that :math:`c_0(x^2) = \cos x`, :math:`c_1(x^2) = \sin x / x`,
# :math:`c_3(x^2) = (x - \sin x)/x^3`, and for negative arguments the hyperbolic functions. They are
# entire, which makes one formula serve a linear flight below, at and above critical damping, and
# short flights as well as long ones.
# Identities used: :math:`c_k = 1/k! - q\,c_{k+2}`, :math:`c_2(q) = c_1(q/4)^2/2` and
# :math:`c_k' = (k\,c_{k+2} - c_{k+1})/2` (Stiefel and Scheifele, Linear and Regular Celestial
# Mechanics, 1971, sec. 11).

HIGHEST = 11
_SERIES_BELOW = 4.0
_LONGER_SERIES_BELOW = 20.0
"""Bound for orders above 9, which the recurrence reaches in more steps."""
_TERMS = 12
_SERIES = tuple(
    tuple(1.0 / math.factorial(2 * j + k) for j in reversed(range(_TERMS)))
    for k in range(HIGHEST + 1)
)
_INVERSE_FACTORIAL = tuple(1.0 / math.factorial(k) for k in range(HIGHEST + 1))


def stumpff0(q: float) -> float:
    return math.cos(math.sqrt(q)) if q >= 0 else math.cosh(math.sqrt(-q))


def stumpff1(q: float) -> float:
    if q == 0:
        return 1.0
    x = math.sqrt(abs(q))
    return math.sin(x) / x if q > 0 else math.sinh(x) / x


def stumpff2(q: float) -> float:
    half = stumpff1(0.25 * q)
    return 0.5 * half * half


def _near_zero(k: int) -> float:
    """The size of arguments up to which the series of c_k is summed."""
    return _SERIES_BELOW if k <= 9 else _LONGER_SERIES_BELOW


def _higher(k: int, lower: Callable[[float], float]) -> Callable[[float], float]:
    """c_k for k > 2: its series near zero, the recurrence from c_{k-2} away from it.

    The series is one expression: a loop over its coefficients takes several times as long.
    """
    c11, c10, c9, c8, c7, c6, c5, c4, c3, c2, c1, c0 = _SERIES[k]
    start, near = _INVERSE_FACTORIAL[k - 2], _near_zero(k)

    def function(q: float) -> float:
        if -near < q < near:
            half = c6 - q * (c7 - q * (c8 - q * (c9 - q * (c10 - q * c11))))
            return c0 - q * (c1 - q * (c2 - q * (c3 - q * (c4 - q * (c5 - q * half)))))
        return (start - lower(q)) / q

    function.__name__ = function.__qualname__ = f"stumpff{k}"
    return function


stumpff3 = _higher(3, stumpff1)
stumpff4 = _higher(4, stumpff2)
stumpff5 = _higher(5, stumpff3)
stumpff6 = _higher(6, stumpff4)
stumpff7 = _higher(7, stumpff5)
stumpff8 = _higher(8, stumpff6)
stumpff9 = _higher(9, stumpff7)
stumpff10 = _higher(10, stumpff8)
stumpff11 = _higher(11, stumpff9)


TOGETHER = (3, 5)
"""Up to which order there is a function for all from the first on."""


def stumpffs3(q: float) -> tuple[float, float, float]:
    """c_1, c_2, c_3."""
    c1, c2 = _first_two(q)
    return c1, c2, stumpff3(q) if -_SERIES_BELOW < q < _SERIES_BELOW else (1.0 - c1) / q


def stumpffs5(q: float) -> tuple[float, float, float, float, float]:
    """c_1, ..., c_5."""
    c1, c2 = _first_two(q)
    if -_SERIES_BELOW < q < _SERIES_BELOW:
        c5 = stumpff5(q)
        return c1, c2, _SIXTH - q * c5, stumpff4(q), c5
    c3 = (1.0 - c1) / q
    return c1, c2, c3, (0.5 - c2) / q, (_SIXTH - c3) / q


_SIXTH = 1.0 / 6.0


def _first_two(q: float) -> tuple[float, float]:
    if q == 0:
        return 1.0, 0.5
    x = math.sqrt(abs(q))
    h = 0.5 * x
    half = math.sin(h) / h if q > 0 else math.sinh(h) / h
    return math.sin(x) / x if q > 0 else math.sinh(x) / x, 0.5 * half * half


STUMPFF_SCALAR = {f"stumpff{k}": globals()[f"stumpff{k}"] for k in range(HIGHEST + 1)}
STUMPFF_SCALAR |= {"stumpffs3": stumpffs3, "stumpffs5": stumpffs5}


def _array_stumpff(k: int) -> Callable[[Array], Array]:
    """The same function for arrays of any shape."""

    def function(q: Array) -> Array:
        q = np.asarray(q, dtype=float)
        x = np.sqrt(np.abs(q))
        if k == 0:
            return np.where(q >= 0, np.cos(x), np.cosh(np.where(q < 0, x, 0.0)))
        if k == 1:
            return _over(x, q)
        if k == 2:
            return 0.5 * STUMPFF_ARRAY["stumpff1"](0.25 * q) ** 2
        below = _near_zero(k)
        total = _series(k, np.where(np.abs(q) < below, q, 0.0))
        far = np.where(np.abs(q) < below, 1.0, q)
        recurrence = (_INVERSE_FACTORIAL[k - 2] - STUMPFF_ARRAY[f"stumpff{k - 2}"](q)) / far
        return np.where(np.abs(q) < below, total, recurrence)

    return function


STUMPFF_ARRAY: dict[str, Callable[..., Any]] = {
    f"stumpff{k}": _array_stumpff(k) for k in range(HIGHEST + 1)
}


def _array_stumpffs(n: int) -> Callable[[Array], tuple[Array, ...]]:
    """The first n functions for arrays, n one of `TOGETHER`, by the steps of the scalar ones."""

    def function(q: Array) -> tuple[Array, ...]:
        q = np.asarray(q, dtype=float)
        x = np.sqrt(np.abs(q))
        c1, half = _over(x, q), _over(0.5 * x, q)
        c2 = 0.5 * half * half
        near = np.abs(q) < _SERIES_BELOW
        by = np.where(near, 1.0, q)
        c3 = (1.0 - c1) / by
        if n == 3:
            return c1, c2, _near(c3, near, _series(3, q[near]))
        c4, c5, close = (0.5 - c2) / by, (_SIXTH - c3) / by, q[near]
        last = _series(5, close)
        c3 = _near(c3, near, _SIXTH - close * last)
        return c1, c2, c3, _near(c4, near, _series(4, close)), _near(c5, near, last)

    return function


def _over(x: Array, q: Array) -> Array:
    """sin x / x, or sinh x / x where q is negative."""
    divisor = np.where(x == 0, 1.0, x)
    found = np.sin(x)
    if np.any(q < 0):
        found = np.where(q < 0, np.sinh(np.where(q < 0, x, 0.0)), found)
    return np.where(x == 0, 1.0, found / divisor)


def _near(far: Array, near: Array, values: Array) -> Array:
    """An array with other values near zero."""
    found = np.array(far)
    found[near] = values
    return found


def _series(k: int, q: Array) -> Array:
    total = np.zeros_like(q)
    for coefficient in _SERIES[k]:
        total = coefficient - q * total
    return total


STUMPFF_ARRAY |= {f"stumpffs{n}": _array_stumpffs(n) for n in TOGETHER}


Values: TypeAlias = tuple[Any, ...]

TABLES = {
    1: ((-1, 1), (0, 1), (1, 1)),
    2: ((-1, 1), (0, 1), (1, 1), (2, 1), (-1, 2), (0, 2), (1, 2), (2, 2)),
    4: (*((n, 1) for n in range(-1, 5)), *((n, b) for b in (2, 3, 4) for n in range(-1, 4))),
}
"""The functions (n, b) that are computed together, by their highest b: means where n < 2b."""

MOTIONS = {
    order: tuple((n, b) for n, b in table if n < 2 * b - 1) for order, table in TABLES.items()
}
"""Those that are given as functions of time besides, behind the others."""

APART = 4.0
"""Least distance of the roots of D, squared and quartered, to be summed over."""
SERIES_BELOW = 4.0
SLOW = 3.0
TERMS = 28
FEW = 20
INVERSE_FACTORIAL = tuple(1.0 / math.factorial(i) for i in range(TERMS + 1))


def _terms(y: Any, kappa: Any) -> int:
    return FEW if y * y < 0.25 and kappa < 1.0 else TERMS


def _apart1(y: Any, kappa: Any, t: Any) -> Values:
    high, low = _roots(y, kappa)
    by = 1.0 / (high - low)
    eh, el = math.exp(high), math.exp(low)
    g0, g1 = by * (eh - el), by * (high * eh - low * el)
    if min(abs(high), abs(low)) < SLOW:
        return by * (_lag(1, high) - _lag(1, low)), g0, g1
    return (1.0 - g1 - 2.0 * y * g0) / kappa, g0, g1


def _roots(y: Any, kappa: Any) -> tuple[float, float]:
    """The roots of D where they are real, the higher one first."""
    x = math.sqrt(y * y - kappa)
    if y > 0:
        low = -(x + y)
        return kappa / low, low
    high = x - y
    return high, kappa / high


def _lag(j: int, root: Any) -> Any:
    """The inverse Laplace transform of 1/(s (s - root)^j) at time one."""
    if abs(root) < 1.0:
        total = 0.0
        for i in range(FEW + j, j - 1, -1):
            total = INVERSE_FACTORIAL[i] - root * total
        return math.exp(root) * total
    grown = math.exp(root)
    lag = (grown - 1.0) / root
    for i in range(1, j):
        lag = (grown * INVERSE_FACTORIAL[i] - lag) / root
    return lag


def _apart2(y: Any, kappa: Any, t: Any) -> Values:
    high, low = _roots(y, kappa)
    by = 1.0 / (high - low)
    by2 = by * by
    eh, el = math.exp(high), math.exp(low)
    h, m = high * eh, low * el
    g01, g11, g21 = by * (eh - el), by * (h - m), by * (high * h - low * m)
    g02 = by2 * (eh + el - 2.0 * g01)
    g12 = by2 * (h + eh + m + el - 2.0 * g11)
    g22 = by2 * ((high + 2.0) * h + (low + 2.0) * m - 2.0 * g21)
    if min(abs(high), abs(low)) < SLOW:
        f1 = by * (_lag(1, high) - _lag(1, low))
        f2 = by2 * (_lag(2, high) + _lag(2, low) - 2.0 * f1)
    else:
        f1 = (1.0 - g11 - 2.0 * y * g01) / kappa
        f2 = (f1 - g12 - 2.0 * y * g02) / kappa
    return f1, g01, g11, g21 / t, f2, g02, g12, g22


def _apart4(y: Any, kappa: Any, t: Any) -> Values:
    high, low = _roots(y, kappa)
    slow = min(abs(high), abs(low)) < SLOW
    f1 = f2 = f3 = f4 = 0.0
    if slow:
        f1, f2 = _sum(-1, 1, high, low), _sum(-1, 2, high, low)
        f3, f4 = _sum(-1, 3, high, low), _sum(-1, 4, high, low)
    p1, p2 = _sum(0, 1, high, low), _sum(0, 2, high, low)
    p3, p4 = _sum(0, 3, high, low), _sum(0, 4, high, low)
    u1, u2 = _sum(1, 1, high, low), _sum(1, 2, high, low)
    u3, u4 = _sum(1, 3, high, low), _sum(1, 4, high, low)
    a1, a2 = _sum(2, 1, high, low), _sum(2, 2, high, low)
    a3, a4 = _sum(2, 3, high, low), _sum(2, 4, high, low)
    j1, j2 = _sum(3, 1, high, low), _sum(3, 2, high, low)
    j3, j4 = _sum(3, 3, high, low), _sum(3, 4, high, low)
    if not slow:
        f1 = (1.0 - u1 - 2.0 * y * p1) / kappa
        f2 = (f1 - u2 - 2.0 * y * p2) / kappa
        f3 = (f2 - u3 - 2.0 * y * p3) / kappa
        f4 = (f3 - u4 - 2.0 * y * p4) / kappa
    return (
        f1, p1, u1, a1 / t, j1 / (t * t), _sum(4, 1, high, low) / (t * t * t),
        f2, p2, u2, a2, j2, f3, p3, u3, a3, j3, f4, p4, u4, a4, j4,
    )  # fmt: skip


def _sum(n: int, b: int, high: Any, low: Any) -> Any:
    """G_{n,b} in partial fractions: the powers 1 to b of 1/(s - high) and of 1/(s - low)."""
    by = 1.0 / (high - low)
    total, factor, sign = 0.0, by**b, 1.0
    for j in range(b, 0, -1):
        mirrored = 1.0 if j % 2 == 0 else -1.0
        total += sign * factor * (_part(n, j, high) + mirrored * _part(n, j, low))
        sign, factor = -sign, factor * by * (2 * b - j) / (b - j + 1)
    return total


def _part(n: int, j: int, root: Any) -> Any:
    """The inverse Laplace transform of s^n/(s - root)^j at time one."""
    if n < 0:
        return _lag(j, root)
    total, factor = 0.0, 1.0
    for i in range(min(n, j - 1) + 1):
        total += factor * root ** (n - i) * INVERSE_FACTORIAL[j - 1 - i]
        factor = factor * (n - i) / (i + 1)
    return math.exp(root) * total


# The families, written from their tables: in `transients<b>` up to the power b of D, G_{n,b} has
# the name of n below and the number b.

NAMES = {-1: "f", 0: "p", 1: "u", 2: "a", 3: "j", 4: "s"}
POWERS = ("1", "t", "t2", "t3", "t4", "t4 * t", "t3 * t3", "t4 * t3", "t4 * t4")
"""Powers of the time in terms of its first ones."""
SWINGS = {
    2: "0.5 * (p1 - v1) / q",
    3: "0.25 * (3.0 * p2 - 0.5 * p1) / q",
    4: "(5.0 * p3 - 0.25 * p2) / (6.0 * q)",
}
"""Motions of (sigma^2 + q)^b from those of lower powers, where the series do not converge fast."""

FAMILY = """
def transients{order}(c, k, t):
    return _timed{order}(t, *_means{order}(c, k, t))

def _timed{order}(t, {names}):
    {powers} = {times}
    return {names}, {timed}

def _means{order}(c, k, t):
    y, kappa = 0.5 * c * t, k * t * t
    q = kappa - y * y
    if q <= -APART:
        return _apart{order}(y, kappa, t)
    if q < SERIES_BELOW:
        basis = _series{order}(y, q, _terms(y, kappa))
    else:
        x = math.sqrt(q)
        basis = _swing{order}(q, math.sin(x) / x, math.cos(x))
    return _near{order}(c, k, t, math.exp(-y), kappa < SERIES_BELOW, *basis)

def _series{order}(y, q, terms):
    # of each power sums of y^i X(i+1), then X1(0), X1(-1) and X2(0), ...,
    # where X(i) belongs to 1/(sigma^i (sigma^2 + q))
    {zeros} = 0.0
    for i in range(terms, 1, -1):
        {steps}
    return {totals}, 1.0 - q * later1, 1.0 - q * x1, {starts}

def _swing{order}(q, p1, v1):
    {swings}
    return {nothing}, p1, v1, {motions}

def _near{order}(c, k, t, decay, short, {falls}, p1, v1, {motions}):
    # from those of sigma^2 + q; the falls are their sums in short flights only
    y, kappa = 0.5 * c * t, k * t * t
    {rates}
    if short:
        {brief}
    else:
        {long}
    return {names}
"""


def family_text(order: int) -> str:
    """Return the functions ``transients<order>`` and those that they call."""
    of = {(n, b): f"{NAMES[n]}{b}" for n, b in TABLES[order]}
    each, higher = range(1, order + 1), range(2, order + 1)

    def rate(n: int, b: int) -> str:
        if b == 1:
            times = " * t" if n == 2 else ""
            return "v1 - y * p1" if n == 1 else f"-c * {of[n - 1, 1]} - k{times} * {of[n - 2, 1]}"
        if n == 1:
            return f"p{b - 1} / {2 * b - 2}.0 - y * p{b}"
        return f"{of[n - 2, b - 1]} - 2.0 * y * {of[n - 1, b]} - kappa * {of[n - 2, b]}"

    later = [f"x{b}, later{b} = later{b - 1} - q * later{b}, x{b}" for b in reversed(higher)]
    steps = [*later, "x1, later1 = INVERSE_FACTORIAL[i] - q * later1, x1"]
    steps += [f"total{b} = total{b} * y + x{b}" for b in each]
    rates = [f"{name} = decay * {name}" for name in ("v1", *(f"p{b}" for b in each))]
    rates += [f"{of[n, b]} = {rate(n, b)}" for n, b in sorted(of) if n > 0]
    if order == 1:  # one product less
        rates = ["u1 = decay * (v1 - y * p1)", "p1 = decay * p1"]
    before = {b: "1.0" if b == 1 else f"f{b - 1}" for b in each}
    long = [f"f{b} = ({before[b]} - u{b} - 2.0 * y * p{b}) / kappa" for b in each]
    parts = {
        "names": ", ".join(of.values()),
        "powers": "t2, t3, t4" if order > 1 else "t2",
        "times": "t * t, t * t * t, t * t * (t * t)" if order > 1 else "t * t",
        "timed": ", ".join(f"{POWERS[2 * b - 1 - n]} * {of[n, b]}" for n, b in MOTIONS[order]),
        "zeros": " = ".join(f"{name}{b}" for name in ("total", "x", "later") for b in each),
        "steps": "\n        ".join(steps),
        "totals": ", ".join(f"total{b}" for b in each),
        "starts": ", ".join(f"later{b - 1} - q * later{b}" for b in higher),
        "swings": "\n    ".join(f"p{b} = {SWINGS[b]}" for b in higher) or "pass",
        "nothing": ", ".join("0.0" for _ in each),
        "motions": ", ".join(f"p{b}" for b in higher),
        "falls": ", ".join(f"f{b}" for b in each),
        "brief": "\n        ".join(f"f{b} = decay * f{b}" for b in each),
        "long": "\n        ".join(long),
        "rates": "\n    ".join(rates),
    }
    return FAMILY.format(order=order, **parts)


SCALAR: dict[str, Callable[..., Values]] = {}
for _order in TABLES:
    _family: dict[str, Any] = {}
    _text = family_text(_order)
    exec(_text, globals(), _family)
    for _function in _family.values():
        _function.source = _text  # for `contimpact.segments.machine_code`
    globals().update(_family)
    SCALAR |= {name: f for name, f in _family.items() if not name.startswith("_")}


# Free motions of an oscillator at many times at once, by the formulas of `transients`.


def _apart_each(order: int) -> Callable[..., Array]:
    """The functions where the roots are apart, element by element."""
    apart = globals()[f"_apart{order}"]

    def function(y: Array, kappa: Array, t: Array) -> Array:
        each = zip(y.tolist(), kappa.tolist(), t.tolist(), strict=True)
        return np.array([apart(*one) for one in each]).T

    return function


def _apart_together(y: Array, kappa: Array, t: Array) -> Array:
    """Those of `TABLES[1]`, which searches for zeros evaluate most, all at once."""
    x = np.sqrt(y * y - kappa)
    far = np.where(y > 0, -(x + y), x - y)
    near = kappa / far
    high, low = np.maximum(near, far), np.minimum(near, far)
    by = 1.0 / (high - low)
    eh, el = np.exp(high), np.exp(low)
    g0, g1 = by * (eh - el), by * (high * eh - low * el)
    fall = by * (_lags(high, eh) - _lags(low, el))
    fast = np.abs(near) >= SLOW
    fall[fast] = ((1.0 - g1 - 2.0 * y * g0)[fast]) / kappa[fast]
    return np.array([fall, g0, g1])


def _lags(root: Array, grown: Array) -> Array:
    """What `_lag` gives for j = 1, with the exponentials of the roots."""
    found, small = np.empty_like(root), np.abs(root) < 1.0
    total = np.zeros(np.count_nonzero(small))
    for i in range(FEW + 1, 0, -1):
        total = INVERSE_FACTORIAL[i] - root[small] * total
    found[small] = grown[small] * total
    found[~small] = (grown[~small] - 1.0) / root[~small]
    return found


def _array(order: int) -> Callable[..., Values]:
    """The same functions for arrays."""
    near, series, swing, timed = (
        globals()[f"_{name}{order}"] for name in ("near", "series", "swing", "timed")
    )
    apart = _apart_together if order == 1 else _apart_each(order)
    count = len(TABLES[order])

    def basis(y: Array, q: Array) -> Values:
        if q[0] < SERIES_BELOW:
            return series(y, q, TERMS)
        x = np.sqrt(q)
        return swing(q, np.sin(x) / x, np.cos(x))

    def function(c: ArrayLike, k: ArrayLike, t: ArrayLike) -> Values:
        given = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in (c, k, t)))
        c, k, t = (x.ravel() for x in given)
        found = np.empty((count, t.size))
        y, kappa = 0.5 * c * t, k * t * t
        q = kappa - y * y
        short, low, far = kappa < SERIES_BELOW, q < SERIES_BELOW, q <= -APART
        if np.any(far):
            found[:, far] = apart(y[far], kappa[far], t[far])
        for part in (low & short & ~far, low & ~short & ~far, ~low):
            if np.any(part):
                ch, kh, th, yh, qh = (x[part] for x in (c, k, t, y, q))
                brief = bool(short[part][0])
                found[:, part] = near(ch, kh, th, np.exp(-yh), brief, *basis(yh, qh))
        return timed(given[2], *found.reshape(count, *given[0].shape))

    return function


ARRAY = {f"transients{order}": _array(order) for order in TABLES}


# Free motions of an oscillator in many digits, by plain formulas: digits are cheap.


def transients(ctx: Any, order: int) -> Callable[[Number, Number, Number], Vector]:
    """What `transients` of that order returns, in many digits."""

    def function(c: Number, k: Number, t: Number) -> Vector:
        means = together(ctx, TABLES[order], c, k, t)
        timed = (means[n, b] * ctx.mpf(t) ** (2 * b - 1 - n) for n, b in MOTIONS[order])
        return (*means.values(), *timed)

    return function


EXACT_FEW = 40
"""Size of the roots up to which free motions are summed from their power series, where roots are
near zero or each other."""

NEAR = 1e-3
"""Distance of roots, from zero or from each other, below which that is so."""


def transient(ctx: Any, n: int, b: int, c: Number, k: Number, t: Number) -> Number:
    """The inverse Laplace transform of s^n/(s^2 + cs + k)^b, by t^(2b-1-n) where n < 2b."""
    return together(ctx, [(n, b)], c, k, t)[n, b]


def together(
    ctx: Any, table: Iterable[tuple[int, int]], c: Number, k: Number, t: Number
) -> dict[tuple[int, int], Any]:
    """The same of several n and b, which share their exponentials."""
    c, k, t = map(ctx.mpf, (c, k, t))
    size = abs(c * t) + ctx.sqrt(abs(k)) * abs(t)
    series = size < EXACT_FEW and _exact_near(ctx, c, k, t)
    with ctx.extradps(EXACT_FEW if series else 4 * ctx.dps):
        if series:
            found = {(n, b): _power_series(ctx, n, b, c, k, t, size) for n, b in table}
        else:
            roots = _exact_roots(ctx, c, k, t)
            found = {
                (n, b): _partial_fractions(ctx, n, b, roots, t) * t ** -max(2 * b - 1 - n, 0)
                for n, b in table
            }
    return {of: +value for of, value in found.items()}


def _exact_near(ctx: Any, c: Number, k: Number, t: Number) -> bool:
    """Whether a root is near zero or the other one, so that sums over both lose many digits."""
    apart = ctx.sqrt(ctx.mpc(c * c - 4 * k))
    return bool(min(abs(apart), abs(apart - c) / 2, abs(apart + c) / 2) * abs(t) < NEAR)


def _power_series(
    ctx: Any, n: int, b: int, c: Number, k: Number, t: Number, size: Number
) -> Number:
    """By the coefficients of 1/(1 + cz + kz^2)^b; powers below zero are impulses."""
    degree = 2 * b - 1 - n
    here, before, total = ctx.one, ctx.zero, ctx.zero
    m, largest = 0, ctx.one
    while largest > ctx.eps or m < EXACT_FEW // 2:
        if m + degree >= 0:
            total += here * t ** min(m, m + degree) / ctx.factorial(m + degree)
        here, before = -(c * (m + b) * here + k * (m + 2 * b - 1) * before) / (m + 1), here
        m += 1
        largest *= size / m
    return total


def _exact_roots(ctx: Any, c: Number, k: Number, t: Number) -> list[tuple[Number, Number, Number]]:
    """Both roots: the distance to the other one, the root, and its exponential.

    They cannot coincide, as they are far from zero and may be moved apart.
    """
    apart = ctx.sqrt(ctx.mpc(c * c - 4 * k)) or ctx.mpf(10) ** (-ctx.dps // 8) / t
    roots = [(distance, (distance - c) / 2) for distance in (apart, -apart)]
    return [(distance, root, ctx.exp(root * t)) for distance, root in roots]


def _partial_fractions(ctx: Any, n: int, b: int, roots: Sequence[Number], t: Number) -> Number:
    total = ctx.zero
    for distance, root, grown in roots:
        for j in range(1, b + 1):
            factor = ctx.binomial(-b, b - j) * distance ** (j - 2 * b)
            total += factor * _of_root(ctx, n, j, root, grown, t)
    return ctx.re(total)


def _of_root(ctx: Any, n: int, j: int, root: Number, grown: Number, t: Number) -> Number:
    """The inverse Laplace transform of s^n/(s - root)^j; `grown` is exp(root t)."""
    if n >= 0:
        return grown * sum(
            ctx.binomial(n, i) * root ** (n - i) * t ** (j - 1 - i) / ctx.factorial(j - 1 - i)
            for i in range(min(n, j - 1) + 1)
        )
    found = (grown - 1) / root
    for i in range(1, j):
        found = (grown * t**i / ctx.factorial(i) - found) / root
    return found
