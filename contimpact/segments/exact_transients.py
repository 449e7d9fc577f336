"""Free motions of an oscillator in many digits, by plain formulas: digits are cheap."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from .transients import MOTIONS, TABLES


def transients(ctx: Any, order: int) -> Callable[[Any, Any, Any], Any]:
    """What `transients` of that order returns, in many digits."""

    def function(c: Any, k: Any, t: Any) -> Any:
        means = {(n, b): transient(ctx, n, b, c, k, t) for n, b in TABLES[order]}
        timed = (means[n, b] * ctx.mpf(t) ** (2 * b - 1 - n) for n, b in MOTIONS[order])
        return (*means.values(), *timed)

    return function


FEW = 40
"""Size of the roots up to which free motions are summed from their power series."""


def transient(ctx: Any, n: int, b: int, c: Any, k: Any, t: Any) -> Any:
    """The inverse Laplace transform of s^n/(s^2 + cs + k)^b, by t^(2b-1-n) where n < 2b."""
    c, k, t = map(ctx.mpf, (c, k, t))
    size = abs(c * t) + ctx.sqrt(abs(k)) * abs(t)
    with ctx.extradps(FEW if size < FEW else 4 * ctx.dps):
        if size < FEW:
            found = _power_series(ctx, n, b, c, k, t, size)
        else:
            found = _partial_fractions(ctx, n, b, c, k, t) * t ** -max(2 * b - 1 - n, 0)
    return +found


def _power_series(ctx: Any, n: int, b: int, c: Any, k: Any, t: Any, size: Any) -> Any:
    """By the coefficients of 1/(1 + cz + kz^2)^b; powers below zero are impulses."""
    degree = 2 * b - 1 - n
    here, before, total = ctx.one, ctx.zero, ctx.zero
    m, largest = 0, ctx.one
    while largest > ctx.eps or m < FEW // 2:
        if m + degree >= 0:
            total += here * t ** min(m, m + degree) / ctx.factorial(m + degree)
        here, before = -(c * (m + b) * here + k * (m + 2 * b - 1) * before) / (m + 1), here
        m += 1
        largest *= size / m
    return total


def _partial_fractions(ctx: Any, n: int, b: int, c: Any, k: Any, t: Any) -> Any:
    """By both roots; they cannot coincide, as they are far from zero and may be moved apart."""
    apart = ctx.sqrt(ctx.mpc(c * c - 4 * k)) or ctx.mpf(10) ** (-ctx.dps // 8) / t
    total = ctx.zero
    for distance in (apart, -apart):
        root = (distance - c) / 2
        for j in range(1, b + 1):
            factor = ctx.binomial(-b, b - j) * distance ** (j - 2 * b)
            total += factor * _of_root(ctx, n, j, root, t)
    return ctx.re(total)


def _of_root(ctx: Any, n: int, j: int, root: Any, t: Any) -> Any:
    """The inverse Laplace transform of s^n/(s - root)^j."""
    grown = ctx.exp(root * t)
    if n >= 0:
        return grown * sum(
            ctx.binomial(n, i) * root ** (n - i) * t ** (j - 1 - i) / ctx.factorial(j - 1 - i)
            for i in range(min(n, j - 1) + 1)
        )
    found = (grown - 1) / root
    for i in range(1, j):
        found = (grown * t**i / ctx.factorial(i) - found) / root
    return found
