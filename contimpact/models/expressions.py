"""Text to number or to SymPy expression, without ``eval``.

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

from ..errors import InputError, did_you_mean, shortened, shown
from .extent import LARGEST_EXPONENT, Beyond, Extent

FUNCTIONS = tuple("""sin cos tan asin acos atan sinh cosh tanh exp log sqrt""".split())
CONSTANTS = ("pi",)
LONGEST_TEXT = 2000

_BINARY: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_KEYWORDS = re.compile(rf"\b({'|'.join(keyword.kwlist)})\b")
_DECIMAL_COMMA = re.compile(r"\d,\d")
_MARK = "\u02bc"
"""Follows Python's keywords while an expression is read: parameters may be called so."""
_UNARY: dict[type, Callable[[Any], Any]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}


def number(text: str, where: str, values: Mapping[str, float] | None = None) -> float:
    """Evaluate an arithmetic expression such as ``"pi/6"``.

    Parameters
    ----------
    text : str
        The expression; `FUNCTIONS` and `CONSTANTS` may appear in it.
    where : str
        The place named in an error.
    values : mapping of str to float, optional
        Further names that may stand in it.

    Raises
    ------
    InputError
        If the text is not such an expression or its value is not finite.
    """
    names = {name: getattr(math, name) for name in (*FUNCTIONS, *CONSTANTS)} | dict(values or {})
    try:
        value = float(_Walker(text, where, names, float).value())
    except (ArithmeticError, ValueError, TypeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            where, f"{shortened(text)!r} has no real value ({error})", "give a finite number"
        ) from None
    if not math.isfinite(value):
        raise InputError(where, f"{shortened(text)!r} is {value}", "give a finite number")
    return value


def check_expression(
    text: str, where: str, variables: Sequence[str], growing: bool = False
) -> float:
    """Check what can be checked of an expression without SymPy: syntax, names, finite constants.

    Parameters
    ----------
    text : str
        The expression, in the names of `variables`, `FUNCTIONS` and `CONSTANTS`.
    where : str
        The place named in an error.
    variables : sequence of str
    growing : bool
        Whether exp(), sinh() and cosh() may be of anything; else they have to stay finite whatever
        the variables.

    Returns
    -------
    float
        About how many terms arise when it is expanded; see `contimpact.models.extent`.

    Raises
    ------
    InputError
        If anything else stands in it, if a part without variables has no finite real value, or if
        exponents, functions of functions or arguments of exp() have no bound.
    """
    functions = {name: _of_any(name, growing) for name in FUNCTIONS}
    constants = {name: getattr(math, name) for name in CONSTANTS}
    names = functions | constants | dict.fromkeys(variables, Extent())
    try:
        value = _Checker(text, where, names, float).value()
    except InputError:
        raise
    except Beyond as error:
        accepted = "use a simpler expression: sin() and cos() lie between -1 and 1"
        raise InputError(where, f"{error} in {shortened(text)!r}", accepted) from None
    except (ArithmeticError, ValueError, TypeError) as error:
        found = f"{shortened(text)!r} has no finite real value ({error})"
        accepted = "use numbers and functions where they are finite and real"
        raise InputError(where, found, accepted) from None
    return value.work if isinstance(value, Extent) else 1.0


def values_of(text: str, where: str, variables: Mapping[str, Any]) -> Any:
    """Evaluate an expression on arrays, given for its variables; SymPy is not needed.

    Raises
    ------
    InputError
        If anything stands in it that `check_expression` refuses.
    """
    import numpy as np

    check_expression(text, where, tuple(variables))
    numpys = {"asin": "arcsin", "acos": "arccos", "atan": "arctan"}
    names = {name: getattr(np, numpys.get(name, name)) for name in (*FUNCTIONS, *CONSTANTS)}
    return _OnArrays(text, where, names | dict(variables), float).value()


def sympy_expression(text: str, where: str, symbols: Mapping[str, Any]) -> Any:
    """Build the SymPy expression a text stands for; numbers in it are doubles, exactly.

    Parameters
    ----------
    text : str
        The expression, in the names of `symbols`, `FUNCTIONS` and `CONSTANTS`.
    where : str
        The place named in an error.
    symbols : mapping of str to sympy.Symbol
        The names that may stand in it.

    Raises
    ------
    InputError
        If anything else stands in it.
    """
    import sympy

    from .doubles import exact

    names = {name: getattr(sympy, name) for name in (*FUNCTIONS, *CONSTANTS)} | dict(symbols)
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
    functions = {name: getattr(math, name) for name in (*FUNCTIONS, *CONSTANTS)}
    try:
        found = _Walker(text, where, functions | dict(names), float).value()
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
    return ast.parse(_KEYWORDS.sub(rf"\1{_MARK}", text.strip()), mode="eval").body


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
        return InputError(self.where, found, f"accepted are {accepted}")

    def unknown(self, name: str) -> InputError:
        hint = did_you_mean(name, self.known)
        found = f"unknown name {shown(name)} in {shortened(self.text)!r}{hint}"
        accepted = f"names here are {', '.join(self.known)}, and functions such as sin()"
        return InputError(self.where, found, accepted)

    def value(self) -> Any:
        if len(self.text) > LONGEST_TEXT:
            raise self.refuse(f"an expression of {len(self.text)} characters")
        unreadable = f"{shortened(self.text)!r} cannot be read as an expression"
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
        raise self.refuse(f"{shortened(part)!r} in {shortened(self.text)!r}")

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


class _OnArrays(_Walker):
    """Walks over arrays; what it is given has been checked."""

    def power(self, base: Any, exponent: Any) -> Any:
        return base**exponent


def _of_any(name: str, growing: bool) -> Callable[[Any], Any]:
    function = getattr(math, name)
    return lambda value: value.of(name, growing) if isinstance(value, Extent) else function(value)
