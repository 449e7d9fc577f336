"""Kernels in many digits: mpmath's functions, and constants to the digits asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..arrays import Number, Vector
from . import integration, linear_flow
from .arithmetic import FUNCTIONS, PLAIN, Arithmetic
from .exact_transients import transients
from .stumpff import HIGHEST, TOGETHER
from .transients import TABLES


def many_digits(ctx: Any) -> Arithmetic:
    """Return the arithmetic of an mpmath context, with the digits that it has now."""
    names = {name: getattr(ctx, name) for name in (*FUNCTIONS, "nan")} | PLAIN
    names |= {f"stumpff{k}": _stumpff(ctx, k) for k in range(HIGHEST + 1)}
    names |= {f"stumpffs{n}": _stumpffs(ctx, n) for n in TOGETHER}
    names |= {f"transients{order}": transients(ctx, order) for order in TABLES}
    names |= linear_flow.in_many_digits(ctx) | integration.in_many_digits(ctx)
    constants = {"pi": +ctx.pi, "ratio": lambda above, below: ctx.mpf(above) / below}
    return Arithmetic(names | constants, exact=True)


def _stumpff(ctx: Any, k: int) -> Callable[[Number], Number]:
    """c_k by its series near zero, by the recurrence from c_0 and c_1 away from it."""

    def function(q: Number) -> Number:
        q = ctx.mpf(q)
        if k > 1 and abs(q) < 30:
            return _series(ctx, k, q)
        if k == 0:
            return ctx.cos(ctx.sqrt(q)) if q >= 0 else ctx.cosh(ctx.sqrt(-q))
        if k == 1:
            x = ctx.sqrt(abs(q))
            return ctx.one if x == 0 else (ctx.sin(x) if q > 0 else ctx.sinh(x)) / x
        return (1 / ctx.factorial(k - 2) - _stumpff(ctx, k - 2)(q)) / q

    return function


def _stumpffs(ctx: Any, highest: int) -> Callable[[Number], Vector]:
    """All c_k from the first on."""
    functions = [_stumpff(ctx, k) for k in range(1, highest + 1)]
    return lambda q: tuple(function(q) for function in functions)


def _series(ctx: Any, k: int, q: Number) -> Number:
    with ctx.extradps(6):
        term = total = 1 / ctx.factorial(k)
        j = 0
        while term and abs(term) > ctx.eps * abs(total) * 1e-3:
            term *= -q / ((2 * j + k + 1) * (2 * j + k + 2))
            total += term
            j += 1
    return +total
