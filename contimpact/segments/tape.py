"""Formulas as straight-line code, differentiated step by step.

A derivative of high order grows with its order when it is written out. Each step of a computation
has a short derivative, in the steps before it; this is the forward mode of algorithmic
differentiation. Importing this module imports SymPy.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import sympy
from sympy import Add, Mul, Pow, S

from ..models.symbols import HarmonicSum


class Tape:
    """Steps of a computation: sums, products, powers and functions of earlier steps.

    A *value* on the tape is a number, a symbol, or a multiple of a symbol.

    Attributes
    ----------
    steps : dict of sympy.Symbol to sympy.Expr
        What each step's symbol stands for. Equal steps have one symbol.
    """

    def __init__(self) -> None:
        self.steps: dict[Any, Any] = {}
        self._values: dict[Any, Any] = {}

    def put(self, e: Any) -> Any:
        """Add the steps that compute an expression; return its value."""
        if e.is_Atom:
            return e
        if isinstance(e, HarmonicSum):
            return self._step(e)
        if e not in self._values:
            factor, rest = _factored(e)
            self._values[e] = factor * self.put(rest) if factor != 1 else self._put(e)
        return self._values[e]

    def _put(self, e: Any) -> Any:
        argument = self._symbol if isinstance(e, sympy.Function) else self.put
        short = e.func(*(argument(a) for a in e.args))
        return self._step(e) if short == e else self.put(short)

    def _symbol(self, e: Any) -> Any:
        """The value of a function's argument, which often has several functions."""
        value = self.put(e)
        return value if value.is_Atom else self._step(value)

    def _step(self, e: Any) -> Any:
        symbol = self._values.get(("step", e))
        if symbol is None:
            symbol = self._values["step", e] = sympy.Symbol(f"w{len(self.steps)}'")
            self.steps[symbol] = e
        return symbol

    def along(self, values: Iterable[Any], rates: Mapping[Any, Any]) -> list[Any]:
        """Return the derivatives of values where symbols change at the given rates."""
        slopes = dict(rates)
        return [self._slope(value, slopes) for value in values]

    def _slope(self, e: Any, slopes: dict[Any, Any]) -> Any:
        if e not in slopes:
            inside = self.steps.get(e, e)
            if isinstance(inside, HarmonicSum):
                moved = (slopes.get(x, S.Zero) * sympy.diff(inside, x) for x in inside.free_symbols)
                slopes[e] = self.put(Add(*moved))
                return slopes[e]
            inner = [self._slope(a, slopes) for a in inside.args]
            moving = [(i, slope) for i, slope in enumerate(inner) if slope != 0]
            slopes[e] = self.put(Add(*(slope * _partial(inside, i) for i, slope in moving)))
        return slopes[e]

    def listing(self, values: Sequence[Any]) -> tuple[list[tuple[Any, Any]], list[Any]]:
        """Return the steps that values need, numbered in order, and the values in these.

        A step that is used once stands where it is used.
        """
        uses: Counter[Any] = Counter()
        for value in values:
            self._count(value, uses)
        lines: list[tuple[Any, Any]] = []
        done: dict[Any, Any] = {}
        return lines, [self._listed(value, uses, lines, done) for value in values]

    def _count(self, e: Any, uses: Counter[Any]) -> None:
        if e in self.steps:
            uses[e] += 1
            if uses[e] > 1:
                return
            e = self.steps[e]
        for a in e.args:
            self._count(a, uses)

    def _listed(
        self, e: Any, uses: Counter[Any], lines: list[tuple[Any, Any]], done: dict[Any, Any]
    ) -> Any:
        if e not in done:
            inside = self.steps.get(e, e)
            listed = inside
            if inside.args:
                listed = inside.func(*(self._listed(a, uses, lines, done) for a in inside.args))
            if uses[e] > 1:
                lines.append((sympy.Symbol(f"w{len(lines)}'"), listed))
                listed = lines[-1][0]
            done[e] = listed
        return done[e]


def _factored(e: Any) -> tuple[Any, Any]:
    """A number and the rest; a sum and its negative have the same rest."""
    if e.is_Mul:
        return e.as_coeff_Mul()
    if not e.is_Add:
        return S.One, e
    factor, rest = e.primitive()
    turned = -rest
    if rest.could_extract_minus_sign() and not turned.could_extract_minus_sign():
        return -factor, turned
    return factor, rest  # SymPy may say of both that a sign can be extracted


def _partial(e: Any, i: int) -> Any:
    """The derivative of one step with respect to its argument number i."""
    if e.is_Add:
        return S.One
    if e.is_Mul:
        return Mul(*e.args[:i], *e.args[i + 1 :])
    if e.is_Pow:
        base, exponent = e.args
        return exponent * Pow(base, exponent - 1) if i == 0 else e * sympy.log(base)
    return e.fdiff(i + 1)
