"""Expressions that users write, read without SymPy and with bounds on their size.

The text is parsed to Python's syntax tree and only arithmetic, named constants, the elementary
functions below and the names the caller declares are walked; everything else is refused by name.
Plain numbers never import SymPy.
"""

from __future__ import annotations

import ast
import keyword
import math
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..errors import InputError, did_you_mean, short_repr, shorten
from ..syntax import parse_expression

# Bounds of an expression's values and of the work of expanding it, before any of it is done.
#
# An `Extent` stands for all that is computed from a variable. It has the operators of a number, so
# that walking over an expression's syntax tree with an `Extent` for each variable bounds it.

LARGEST_EXPONENT = 64
"""Largest exponent of a power, and of powers of powers together."""
DEEPEST = 10
"""Functions of functions."""
NOT_SMOOTH = frozenset({"abs", "sign", "sgn", "signum", "max", "min", "heaviside", "step", "mod"})
"""Names of functions that users try, in small letters."""
LARGEST_ARGUMENT = 700.0
"""Largest argument of functions that grow as exp does: e^700 is about the largest double."""
MOST_WORK = 1e12


class UnboundedError(Exception):
    """An expression is beyond what is evaluated; the message says why."""


@dataclass(frozen=True)
class Extent:
    """Bounds of a part of an expression."""

    low: float = -math.inf
    high: float = math.inf
    """`low`, `high`: its values lie between these."""
    terms: float = 1.0
    """Terms of the sum that it becomes when it is expanded, sines and cosines as exponentials."""
    work: float = 1.0
    """Terms of all its parts that are expanded on the way; `MOST_WORK` where functions are in it
    that do not become sums."""
    exponent: float = 1.0
    """The product of the exponents of powers of powers in it."""
    depth: int = 0
    """How deep functions of functions go."""

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
        other = _as_extent(other)
        return self._with(
            other, self.terms + other.terms, [self.low + other.low, self.high + other.high]
        )

    def __mul__(self, other: Extent | float) -> Extent:
        other = _as_extent(other)
        ends = [a * b for a in (self.low, self.high) for b in (other.low, other.high)]
        terms = self.terms * other.terms
        return self._with(other, terms, ends, expanded=terms)

    def __truediv__(self, other: Extent | float) -> Extent:
        other = _as_extent(other)
        if other.size == 0.0:
            raise ZeroDivisionError("division by zero")
        most = 1 / other.smallest if other.smallest > 0 else math.inf
        return self * Extent(-most, most, other.terms, other.work, other.exponent, other.depth)

    def __pow__(self, other: Extent | float) -> Extent:
        other = _as_extent(other)
        together = self.exponent * max(1.0, other.size)
        if other.size > LARGEST_EXPONENT:
            raise UnboundedError(f"an exponent that can be beyond {LARGEST_EXPONENT}")
        if together > LARGEST_EXPONENT:
            raise UnboundedError(f"powers of powers with exponents of {together:.6g} together")
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
        return self + _as_extent(other) * -1.0

    def __rsub__(self, other: float) -> Extent:
        return _as_extent(other) - self

    def __rtruediv__(self, other: float) -> Extent:
        return _as_extent(other) / self

    def __rpow__(self, other: float) -> Extent:
        return _as_extent(other) ** self

    def __pos__(self) -> Extent:
        return self

    __radd__, __rmul__ = __add__, __mul__

    def of(self, function: str, growing: bool = False) -> Extent:
        """Return the extent of an elementary function of it, which may be growing beyond all
        doubles."""
        if self.depth >= DEEPEST:
            raise UnboundedError(f"functions of functions more than {DEEPEST} deep")
        most = self.high if function == "exp" else self.size
        if function in ("exp", "sinh", "cosh") and most > LARGEST_ARGUMENT and not growing:
            raise UnboundedError(f"{function}() of what can be beyond {LARGEST_ARGUMENT:g}")
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
    "exp": lambda x: (0.0, _exponential(math.exp, x.high)),
    "sinh": lambda x: (_exponential(math.sinh, x.low), _exponential(math.sinh, x.high)),
    "cosh": lambda x: (1.0, _exponential(math.cosh, x.size)),
    "log": lambda x: tuple(math.log(end) if end > 0 else -math.inf for end in (x.low, x.high)),
}
"""Values of the functions that are bounded, or are where their argument is."""


def _as_extent(value: Extent | float) -> Extent:
    return value if isinstance(value, Extent) else Extent(float(value), float(value), work=0.0)


def _exponential(function: Callable[[float], float], argument: float) -> float:
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


FUNCTIONS = tuple("""sin cos tan asin acos atan sinh cosh tanh exp log sqrt""".split())
CONSTANTS = ("pi",)
NUMPY_SPELLING = {"asin": "arcsin", "acos": "arccos", "atan": "arctan"}
_IN_FLOATS = {name: getattr(math, name) for name in (*FUNCTIONS, *CONSTANTS)}
LONGEST_TEXT = 2000

_BINARY: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_KEYWORDS = re.compile(rf"\b({'|'.join(keyword.kwlist)})\b")
_DECIMAL_COMMA = re.compile(r"\d,\d")
_CALLED = re.compile(r"\b([A-Za-z]\w*)\s*\(")
_MARK = "\u02bc"
"""Follows Python's keywords while an expression is read: parameters may be called so."""
_UNARY: dict[type, Callable[[Any], Any]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}


def number(text: str, where: str, values: Mapping[str, float] | None = None) -> float:
    """Evaluate an arithmetic expression such as ``"pi/6"``, of `FUNCTIONS`, `CONSTANTS` and the
    names that have values; errors name the place `where`.

    Raises InputError if the text is not such an expression or its value is not finite.
    """
    try:
        value = float(_Walker(text, where, _IN_FLOATS | dict(values or {}), float).value())
    except (ArithmeticError, ValueError, TypeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            where, f"{shorten(text)!r} has no real value ({error})", "give a finite number"
        ) from None
    if not math.isfinite(value):
        raise InputError(where, f"{shorten(text)!r} is {value}", "give a finite number")
    return value


def check_expression(
    text: str,
    where: str,
    variables: Sequence[str],
    growing: bool = False,
    values: Mapping[str, float] | None = None,
) -> float:
    """Check what can be checked of an expression of variables, `FUNCTIONS` and `CONSTANTS` without
    SymPy: syntax, names, finite constants. Returns about how many terms arise when it is expanded.

    Where it may be `growing`, exp(), sinh() and cosh() may be of anything; else they have to stay
    finite whatever the variables. Those of the variables that have `values` are numbers.

    Raises InputError, naming `where`, if anything else is in it, if a part without variables has no
    finite real value, or if exponents, functions of functions or arguments of exp() have no bound.
    """
    functions = {name: _extent_function(name, growing) for name in FUNCTIONS}
    names = _IN_FLOATS | functions | dict.fromkeys(variables, Extent()) | dict(values or {})
    try:
        value = _Checker(text, where, names, float).value()
    except InputError:
        raise
    except UnboundedError as error:
        accepted = "use a simpler expression: sin() and cos() lie between -1 and 1"
        raise InputError(where, f"{error} in {shorten(text)!r}", accepted) from None
    except (ArithmeticError, ValueError, TypeError) as error:
        found = f"{shorten(text)!r} has no finite real value ({error})"
        accepted = "use numbers and functions where they are finite and real"
        raise InputError(where, found, accepted) from None
    return value.work if isinstance(value, Extent) else 1.0


def check_at_values(texts: Mapping[str, str], values: Mapping[str, float]) -> None:
    """Refuse values at which one of some expressions, by their places, has none whatever its other
    variables are."""
    for where, text in texts.items():
        names = [name for name in names_in(text) if name not in (*FUNCTIONS, *CONSTANTS)]
        if used := {name: values[name] for name in names if name in values}:
            try:
                check_expression(text, where, names, growing=True, values=used)
            except InputError as error:
                told = ", ".join(f"{name} = {value:.6g}" for name, value in used.items())
                raise InputError(where, f"at {told}, {error.found}", error.accepted) from None


def values_of(
    text: str,
    where: str,
    variables: Mapping[str, Any],
    functions: Mapping[str, Callable[..., Any]] | None = None,
) -> Any:
    """Evaluate an expression on arrays, given for its variables, or on other numbers, whose
    `functions` are given; SymPy is not needed.

    Raises InputError if anything is in it that `check_expression` refuses.
    """
    import numpy as np

    check_expression(text, where, tuple(variables))
    names = {name: getattr(np, NUMPY_SPELLING.get(name, name)) for name in _IN_FLOATS}
    names |= {name: functions[name] for name in FUNCTIONS} if functions else {}
    return _ArrayEvaluator(text, where, names | dict(variables), float).value()


def sympy_expression(text: str, where: str, symbols: Mapping[str, Any]) -> Any:
    """Build the SymPy expression of a text in the names of `symbols`, `FUNCTIONS` and `CONSTANTS`;
    numbers in it are doubles, exactly.

    Raises InputError, naming `where`, if anything else is in it.
    """
    import sympy

    from .symbols import exact

    names = {name: getattr(sympy, name) for name in _IN_FLOATS} | dict(symbols)
    return _Walker(text, where, names, exact).value()


@dataclass(frozen=True)
class Combination:
    """A linear combination of names, by its factors; it has the operations that leave it one."""

    factors: tuple[float, ...]

    def __add__(self, other: Combination) -> Combination:
        if not isinstance(other, Combination):
            return NotImplemented
        return Combination(tuple(map(operator.add, self.factors, other.factors)))

    def __mul__(self, other: float) -> Combination:
        if not isinstance(other, float):
            return NotImplemented
        return Combination(tuple(c * other for c in self.factors))

    def __truediv__(self, other: float) -> Combination:
        if not isinstance(other, float):
            return NotImplemented
        return Combination(tuple(c / other for c in self.factors))

    def __sub__(self, other: Combination) -> Combination:
        return self + -other

    def __neg__(self) -> Combination:
        return self * -1.0

    def __pos__(self) -> Combination:
        return self

    __rmul__ = __mul__


def combination_of(text: str, where: str, names: Mapping[str, Combination]) -> Combination | None:
    """Return the linear combination that a checked expression is; None if it is none.

    Factors are evaluated in floats.
    """
    try:
        found = _Walker(text, where, _IN_FLOATS | dict(names), float).value()
    except (TypeError, ArithmeticError):
        return None
    return found if isinstance(found, Combination) else None


def names_in(text: str) -> list[str]:
    """Return all names in an expression; none if it cannot be read, which is told later."""
    try:
        tree = _tree(text)
    except (SyntaxError, RecursionError, MemoryError, ValueError):
        return []
    return [_name(node) for node in ast.walk(tree) if isinstance(node, ast.Name)]


def arguments_in(text: str, functions: Sequence[str]) -> list[str]:
    """Return what some functions in an expression that can be read are of."""
    calls = (node for node in ast.walk(_tree(text)) if isinstance(node, ast.Call))
    return [
        ast.unparse(call.args[0]).replace(_MARK, "")
        for call in calls
        if isinstance(call.func, ast.Name) and call.func.id in functions
    ]


def _tree(text: str) -> ast.expr:
    """Parse an expression, in which Python's keywords are names like others."""
    return parse_expression(_KEYWORDS.sub(rf"\1{_MARK}", text.strip()))


def _name(node: ast.Name) -> str:
    """The name as it stands in the text."""
    return node.id.removesuffix(_MARK)


class _Walker:
    """Walks one text's syntax tree over a table of names."""

    def __init__(
        self, text: str, where: str, names: Mapping[str, Any], constant: Callable[[Any], Any]
    ) -> None:
        self.text, self.where, self.names, self.constant = text, where, names, constant

    @property
    def known(self) -> list[str]:
        """The names that are no functions."""
        return [*sorted(set(self.names) - set(FUNCTIONS) - set(CONSTANTS)), *CONSTANTS]

    def refuse(self, found: str) -> InputError:
        accepted = f"numbers, + - * / **, {', '.join(self.known)} and " + ", ".join(
            name + "()" for name in FUNCTIONS
        )
        if _DECIMAL_COMMA.search(self.text):
            accepted += "; decimals have a point"
        if any(name.lower() in NOT_SMOOTH for name in _CALLED.findall(self.text)):
            accepted += "; what is not smooth is stated by a mode for each side, in a hybrid scene"
        return InputError(self.where, found, f"accepted are {accepted}")

    def unknown(self, name: str) -> InputError:
        hint = did_you_mean(name, self.known)
        found = f"unknown name {short_repr(name)} in {shorten(self.text)!r}{hint}"
        accepted = f"names here are {', '.join(self.known)}, and functions such as sin()"
        return InputError(self.where, found, accepted)

    def value(self) -> Any:
        if len(self.text) > LONGEST_TEXT:
            raise self.refuse(f"an expression of {len(self.text)} characters")
        unreadable = f"{shorten(self.text)!r} cannot be read as an expression"
        try:
            tree = _tree(self.text)
        except (SyntaxError, RecursionError, MemoryError, ValueError) as error:
            raise self.refuse(unreadable) from error
        try:
            return self.walk(tree)
        except RecursionError as error:
            raise self.refuse(unreadable) from error

    def walk(self, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=bool() | str() | bytes() | complex() | None):
                pass
            case ast.Constant(value=int() | float() as value):
                return self.constant(value)
            case ast.Name() if (name := _name(node)) not in FUNCTIONS:
                if name in self.names:
                    return self.names[name]
                raise self.unknown(name)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _UNARY:
                return _UNARY[type(op)](self.walk(operand))
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                return self.power(self.walk(left), self.walk(right))
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _BINARY:
                return _BINARY[type(op)](self.walk(left), self.walk(right))
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if (
                name in FUNCTIONS
            ):
                return self.names[name](self.walk(argument))
        part = ast.unparse(node).replace(_MARK, "")
        raise self.refuse(f"{shorten(part)!r} in {shorten(self.text)!r}")

    def power(self, base: Any, exponent: Any) -> Any:
        known = not isinstance(exponent, Extent) and not getattr(exponent, "free_symbols", None)
        if known and abs(float(exponent)) > LARGEST_EXPONENT:
            raise self.refuse(f"an exponent of {float(exponent):.6g}")
        return base**exponent


class _Checker(_Walker):
    """Walks over an `Extent`; parts without variables are numbers, and have to be finite."""

    def walk(self, node: ast.expr) -> Any:
        value = super().walk(node)
        if isinstance(value, complex):
            raise ValueError("a complex number")
        if isinstance(value, float) and not math.isfinite(value):
            raise OverflowError("a number that is not finite")
        return value


class _ArrayEvaluator(_Walker):
    """Walks over arrays; what it is given has been checked."""

    def power(self, base: Any, exponent: Any) -> Any:
        return base**exponent


def _extent_function(name: str, growing: bool) -> Callable[[Any], Any]:
    function = getattr(math, name)
    return lambda value: value.of(name, growing) if isinstance(value, Extent) else function(value)
