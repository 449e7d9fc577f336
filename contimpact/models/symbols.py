"""The symbols of formulas, their numbers as doubles, and sums over harmonics."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Self

import sympy
from sympy import Expr


def primed_symbol(name: str) -> sympy.Symbol:
    """Return a symbol of ours: the prime keeps it apart from any parameter of that name."""
    return sympy.Symbol(f"{name}'", real=True)


T0, T1, TURN, DT, PHASE = map(primed_symbol, ("t0", "t1", "turn", "dt", "phase"))
"""phase = t0 - turn*T and dt = t1 - t0, with `turn` a whole number."""


# Numbers of a statement in SymPy: each is the double that it was written as.
#
# A decimal such as 0.1 is no short ratio, and the double nearest to it is one of 55 bits. As a
# quotient it would be spread over formulas, as common denominators and contents of sums; as a
# `Double` it stays in one piece, and kernels compute with the double itself. Importing this module
# imports SymPy.

LARGEST_WHOLE = 2**53
"""Up to which all whole numbers are doubles."""
LARGEST_PARTS = 2**20, 2**10
"""Numerator and denominator up to which a double is a quotient: 0.5, 1.25."""
ROUNDING = 2.0**-48
"""Relative distance at which a quotient of doubles is a whole number."""


class Double(sympy.AtomicExpr):
    """A positive double, known to SymPy as a constant with a value, such as pi."""

    __slots__ = ("value",)
    is_number = True
    is_commutative = True
    is_extended_positive = True
    is_finite = True
    is_irrational = True
    """Nothing is made of its being a quotient."""
    is_algebraic = False

    def __new__(cls, value: float) -> Self:
        double: Self = super().__new__(cls)
        double.value = float(value)
        return double

    def __getnewargs__(self) -> tuple[Any, ...]:
        return (self.value,)

    _hashable_content = __getnewargs__

    def _eval_evalf(self, prec: int) -> Any:
        return sympy.Float(self.value, precision=prec)

    def _sympystr(self, printer: Any) -> str:
        return repr(self.value)

    def _sympyrepr(self, printer: Any) -> str:
        return f"Double({self.value!r})"

    _pythoncode = _sympystr


def exact(value: float) -> Any:
    """Return the double nearest to a number, exactly."""
    if isinstance(value, int) and abs(value) <= LARGEST_WHOLE:
        return sympy.Integer(value)
    number = float(value)
    if not math.isfinite(number):
        return sympy.sympify(number)
    above, below = abs(number).as_integer_ratio()
    if (below == 1 and above <= LARGEST_WHOLE) or (
        above <= LARGEST_PARTS[0] and below <= LARGEST_PARTS[1]
    ):
        return sympy.Rational(number)
    return Double(number) if number > 0 else -Double(-number)


def whole_quotient(quotient: Any) -> int | None:
    """Return the whole number that a quotient is, or is to the rounding of its doubles; else None.

    Frequencies 0.1 and 0.3 are one and three times a frequency, though the double 0.3 is not three
    times the double 0.1.
    """
    quotient = sympy.simplify(quotient)
    if quotient.is_Integer:
        return int(quotient)
    if quotient.free_symbols or not quotient.is_real:
        return None
    number = quotient.evalf(30)
    nearest = round(number)
    near = abs(number - nearest) <= ROUNDING * abs(number)
    return int(nearest) if near else None


# Sums over the harmonics of a forcing, as one term that stands for all.
#
# Written out, formulas and their derivatives grow with the number of harmonics. Importing this
# module
# imports SymPy.

WRITTEN_OUT = 8
"""Harmonics up to which a sum is written out: its parts then share more among each other."""

ORDER, COSINE, SINE = INDICES = tuple(primed_symbol(name) for name in ("k", "a", "b"))
"""Symbols for the k, a_k and b_k of each harmonic in the term of a sum."""


class HarmonicSum(sympy.Expr):
    """The sum of a term over rows of numbers (k, a_k, b_k), as ``(term, rows)``."""

    is_commutative = True

    @property
    def free_symbols(self) -> set[Expr]:
        return set(self.args[0].free_symbols) - set(INDICES)

    def doit(self, **hints: Any) -> Any:
        """Return the sum written out."""
        term, rows = self.args
        return sympy.Add(*(term.xreplace(dict(zip(INDICES, row, strict=True))) for row in rows))

    def _eval_derivative(self, symbol: Expr) -> Expr:
        term, rows = self.args
        slope = sympy.diff(term, symbol)
        return HarmonicSum(slope, rows) if slope != 0 else slope


def over_harmonics(
    harmonics: Sequence[tuple[Expr, Expr, Expr]], term: Callable[[Expr, Expr, Expr], Expr]
) -> Expr:
    """Return the sum of ``term(k, a, b)`` over harmonics: one term where there are many numbers."""
    rows = sympy.Tuple(*(sympy.Tuple(*map(sympy.sympify, row)) for row in harmonics))
    if len(rows) <= WRITTEN_OUT or rows.free_symbols:
        return sum((term(*row) for row in harmonics), sympy.Integer(0))
    return HarmonicSum(term(*INDICES), rows)
