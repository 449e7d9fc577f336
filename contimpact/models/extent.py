"""Bounds of an expression's values and of the work of expanding it, before any of it is done.

An `Extent` stands for all that is computed from a variable. It has the operators of a number, so
that walking over an expression's syntax tree with an `Extent` for each variable bounds it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

LARGEST_EXPONENT = 64
"""Of a power, and of powers of powers together."""
DEEPEST = 10
"""Functions of functions."""
LARGEST_ARGUMENT = 700.0
"""Of functions that grow as exp does: e^700 is about the largest double."""
MOST_WORK = 1e12


class Beyond(Exception):
    """An expression is beyond what is evaluated; the message says why."""


@dataclass(frozen=True)
class Extent:
    """Bounds of a part of an expression.

    Attributes
    ----------
    low, high : float
        Its values lie between these.
    terms : float
        Terms of the sum that it becomes when it is expanded, sines and cosines as exponentials.
    work : float
        Terms of all its parts that are expanded on the way; `MOST_WORK` where functions are in it
        that do not become sums.
    exponent : float
        The product of the exponents of powers of powers in it.
    depth : int
        How deep functions of functions go.
    """

    low: float = -math.inf
    high: float = math.inf
    terms: float = 1.0
    work: float = 1.0
    exponent: float = 1.0
    depth: int = 0

    @property
    def size(self) -> float:
        """The largest absolute value it may have."""
        return max(abs(self.low), abs(self.high))

    @property
    def smallest(self) -> float:
        """The smallest absolute value it may have."""
        return 0.0 if self.low <= 0 <= self.high else min(abs(self.low), abs(self.high))

    def _with(
        self, other: Extent, terms: float, values: list[float], expanded: float = 0.0
    ) -> Extent:
        """The result of an operation on two, with the ends of its values."""
        work = self.work + other.work + (expanded if expanded > 1 else 0.0)
        low, high = (
            (-math.inf, math.inf) if any(map(math.isnan, values)) else (min(values), max(values))
        )
        exponent, depth = max(self.exponent, other.exponent), max(self.depth, other.depth)
        return Extent(low, high, min(terms, MOST_WORK), min(work, MOST_WORK), exponent, depth)

    def __add__(self, other: Extent | float) -> Extent:
        other = _extent(other)
        return self._with(
            other, self.terms + other.terms, [self.low + other.low, self.high + other.high]
        )

    def __mul__(self, other: Extent | float) -> Extent:
        other = _extent(other)
        ends = [a * b for a in (self.low, self.high) for b in (other.low, other.high)]
        terms = self.terms * other.terms
        return self._with(other, terms, ends, expanded=terms)

    def __truediv__(self, other: Extent | float) -> Extent:
        other = _extent(other)
        most = 1 / other.smallest if other.smallest > 0 else math.inf
        return self * Extent(-most, most, other.terms, other.work, other.exponent, other.depth)

    def __pow__(self, other: Extent | float) -> Extent:
        other = _extent(other)
        together = self.exponent * max(1.0, other.size)
        if other.size > LARGEST_EXPONENT:
            raise Beyond(f"an exponent that can be beyond {LARGEST_EXPONENT}")
        if together > LARGEST_EXPONENT:
            raise Beyond(f"powers of powers with exponents of {together:.6g} together")
        most = max(_power(self.size, other.size), _power(self.smallest, -other.size))
        n = math.ceil(other.size)
        terms = float(math.comb(int(self.terms) + n - 1, n)) if self.terms < 1e4 else MOST_WORK
        found = self._with(
            other, max(terms, 1.0), [-most, most], expanded=terms if terms > 1 else 0.0
        )
        return Extent(found.low, found.high, found.terms, found.work, together, found.depth)

    def __neg__(self) -> Extent:
        return self * -1.0

    def __sub__(self, other: Extent | float) -> Extent:
        return self + _extent(other) * -1.0

    def __rsub__(self, other: float) -> Extent:
        return _extent(other) - self

    def __rtruediv__(self, other: float) -> Extent:
        return _extent(other) / self

    def __rpow__(self, other: float) -> Extent:
        return _extent(other) ** self

    def __pos__(self) -> Extent:
        return self

    __radd__, __rmul__ = __add__, __mul__

    def of(self, function: str, growing: bool = False) -> Extent:
        """Return the extent of an elementary function of it.

        Parameters
        ----------
        function : str
        growing : bool
            Whether it may grow beyond all doubles.
        """
        if self.depth >= DEEPEST:
            raise Beyond(f"functions of functions more than {DEEPEST} deep")
        most = self.high if function == "exp" else self.size
        if function in ("exp", "sinh", "cosh") and most > LARGEST_ARGUMENT and not growing:
            raise Beyond(f"{function}() of what can be beyond {LARGEST_ARGUMENT:g}")
        low, high = _RANGES.get(function, lambda extent: (-math.inf, math.inf))(self)
        wave = function in ("sin", "cos") and self.depth == 0
        work = self.work + 2 if wave else MOST_WORK
        return Extent(low, high, 2.0 if wave else 1.0, work, 1.0, self.depth + 1)


_RANGES = {
    "sin": lambda x: (-1.0, 1.0),
    "cos": lambda x: (-1.0, 1.0),
    "tanh": lambda x: (-1.0, 1.0),
    "atan": lambda x: (-math.pi / 2, math.pi / 2),
    "asin": lambda x: (-math.pi / 2, math.pi / 2),
    "acos": lambda x: (0.0, math.pi),
    "sqrt": lambda x: (0.0, math.sqrt(max(x.high, 0.0))),
    "exp": lambda x: (0.0, _grown(math.exp, x.high)),
    "sinh": lambda x: (_grown(math.sinh, x.low), _grown(math.sinh, x.high)),
    "cosh": lambda x: (1.0, _grown(math.cosh, x.size)),
    "log": lambda x: tuple(math.log(end) if end > 0 else -math.inf for end in (x.low, x.high)),
}
"""Values of the functions that are bounded, or are where their argument is."""


def _extent(value: Extent | float) -> Extent:
    return value if isinstance(value, Extent) else Extent(float(value), float(value), work=0.0)


def _grown(function: Callable[[float], float], argument: float) -> float:
    """The value of exp, sinh or cosh, infinite where it is no double."""
    try:
        return function(argument)
    except OverflowError:
        return math.copysign(math.inf, argument)


def _power(base: float, exponent: float) -> float:
    try:
        return max(1.0, math.pow(base, exponent))
    except (OverflowError, ValueError):
        return math.inf
