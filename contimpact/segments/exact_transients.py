"""Free motions of an oscillator in many digits, by plain formulas: digits are cheap."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from ..arrays import Number, Vector
from .transients import MOTIONS, TABLES


def transients(ctx: Any, order: int) -> Callable[[Number, Number, Number], Vector]:
    """What `transients` of that order returns, in many digits."""

    def function(c: Number, k: Number, t: Number) -> Vector:
        means = together(ctx, TABLES[order], c, k, t)
        timed = (means[n, b] * ctx.mpf(t) ** (2 * b - 1 - n) for n, b in MOTIONS[order])
        return (*means.values(), *timed)

    return function


FEW = 40
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
    series = size < FEW and _near(ctx, c, k, t)
    with ctx.extradps(FEW if series else 4 * ctx.dps):
        if series:
            found = {(n, b): _power_series(ctx, n, b, c, k, t, size) for n, b in table}
        else:
            roots = _roots(ctx, c, k, t)
            found = {
                (n, b): _partial_fractions(ctx, n, b, roots, t) * t ** -max(2 * b - 1 - n, 0)
                for n, b in table
            }
    return {of: +value for of, value in found.items()}


def _near(ctx: Any, c: Number, k: Number, t: Number) -> bool:
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
    while largest > ctx.eps or m < FEW // 2:
        if m + degree >= 0:
            total += here * t ** min(m, m + degree) / ctx.factorial(m + degree)
        here, before = -(c * (m + b) * here + k * (m + 2 * b - 1) * before) / (m + 1), here
        m += 1
        largest *= size / m
    return total


def _roots(ctx: Any, c: Number, k: Number, t: Number) -> list[tuple[Number, Number, Number]]:
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
