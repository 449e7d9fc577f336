"""Sums over the harmonics of a forcing, as one term that stands for all.

Written out, formulas and their derivatives grow with the number of harmonics. Importing this module
imports SymPy.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import sympy
from sympy import Expr

from .symbols import own

WRITTEN_OUT = 8
"""Harmonics up to which a sum is written out: its parts then share more among each other."""

ORDER, COSINE, SINE = INDICES = tuple(own(name) for name in ("k", "a", "b"))
"""What stands for the k, a_k and b_k of each harmonic in the term of a sum."""


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
