r"""Stumpff functions: cosines, sines and what is left of them, without cancellation.

.. math:: c_k(q) = \sum_{j \ge 0} \frac{(-q)^j}{(2j + k)!}

so that :math:`c_0(x^2) = \cos x`, :math:`c_1(x^2) = \sin x / x`,
:math:`c_3(x^2) = (x - \sin x)/x^3`, and for negative arguments the hyperbolic functions. They are
entire, which makes one formula serve a linear flight below, at and above critical damping, and
short flights as well as long ones.
Identities used: :math:`c_k = 1/k! - q\,c_{k+2}`, :math:`c_2(q) = c_1(q/4)^2/2` and
:math:`c_k' = (k\,c_{k+2} - c_{k+1})/2` (Stiefel and Scheifele, Linear and Regular Celestial
Mechanics, 1971, sec. 11).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ..arrays import Array

HIGHEST = 11
_SERIES_BELOW = 4.0
_LONGER_SERIES_BELOW = 20.0
"""For orders above 9, which the recurrence reaches in more steps."""
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


SCALAR = {f"stumpff{k}": globals()[f"stumpff{k}"] for k in range(HIGHEST + 1)}
SCALAR |= {"stumpffs3": stumpffs3, "stumpffs5": stumpffs5}


def _array_stumpff(k: int) -> Callable[[Array], Array]:
    """The same function for arrays of any shape."""

    def function(q: Array) -> Array:
        q = np.asarray(q, dtype=float)
        x = np.sqrt(np.abs(q))
        if k == 0:
            return np.where(q >= 0, np.cos(x), np.cosh(np.where(q < 0, x, 0.0)))
        if k == 1:
            divisor = np.where(x == 0, 1.0, x)
            hyperbolic = np.sinh(np.where(q < 0, x, 0.0))
            return np.where(x == 0, 1.0, np.where(q >= 0, np.sin(x), hyperbolic) / divisor)
        if k == 2:
            return 0.5 * ARRAY["stumpff1"](0.25 * q) ** 2
        below = _near_zero(k)
        near = np.where(np.abs(q) < below, q, 0.0)
        total = np.zeros_like(near)
        for coefficient in _SERIES[k]:
            total = coefficient - near * total
        far = np.where(np.abs(q) < below, 1.0, q)
        recurrence = (_INVERSE_FACTORIAL[k - 2] - ARRAY[f"stumpff{k - 2}"](q)) / far
        return np.where(np.abs(q) < below, total, recurrence)

    return function


ARRAY: dict[str, Callable[..., Any]] = {
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


ARRAY |= {f"stumpffs{n}": _array_stumpffs(n) for n in TOGETHER}
