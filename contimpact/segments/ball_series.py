"""Balls and power series of them: what python-flint does not have."""

from __future__ import annotations

from typing import Any, TypeAlias

from flint import arb, arb_series

Number: TypeAlias = Any
"""An ``arb``, or an ``arb_series`` of them."""


def number(x: Number) -> Number:
    """Return a number of a kernel as one of this arithmetic."""
    return x if isinstance(x, arb | arb_series) else arb(x)


def constant(x: Number) -> Number:
    """Return a number without its higher coefficients."""
    return x[0] if isinstance(x, arb_series) else number(x)


def around_zero(radius: Number) -> Number:
    """Return the ball around zero that holds a radius, itself a ball."""
    return arb(0, 1) * radius


def power(x: Number, exponent: int) -> Number:
    """Return a whole power, not negative; python-flint has none of a ball around zero."""
    found = number(1)
    for _ in range(exponent):
        found = found * x
    return found


def composed(series: Number, x: Number) -> Number:
    """Return a function of a series, from its Taylor series at the constant term of this."""
    change = arb_series([0, *x.coeffs()[1:]], prec=x.prec)
    if change.length() == 0:  # python-flint takes the empty series for one with a constant term
        return arb_series([series[0]], prec=x.prec)
    return series(change)
