"""Text to number or to SymPy expression, without ``eval``.

The text is parsed to Python's syntax tree and only arithmetic, named constants, the elementary
functions below and the names the caller declares are walked; everything else is refused by name.
Plain numbers never import SymPy.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

from .errors import InputError

FUNCTIONS = (
    "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt",
)  # fmt: skip
CONSTANTS = ("pi",)
LONGEST_TEXT = 2000
LARGEST_EXPONENT = 64

_BINARY: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_UNARY: dict[type, Callable[[Any], Any]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}


def number(text: str, where: str) -> float:
    """Evaluate an arithmetic expression such as ``"pi/6"``.

    Parameters
    ----------
    text : str
        The expression; `FUNCTIONS` and `CONSTANTS` may appear in it.
    where : str
        The place named in an error.

    Returns
    -------
    float

    Raises
    ------
    InputError
        If the text is not such an expression or its value is not finite.
    """
    names = {name: getattr(math, name) for name in (*FUNCTIONS, *CONSTANTS)}
    try:
        value = float(_Walker(text, where, names, float).value())
    except (ArithmeticError, ValueError, TypeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(
            where, f"{text!r} has no real value ({error})", "give a finite number"
        ) from None
    if not math.isfinite(value):
        raise InputError(where, f"{text!r} is {value}", "give a finite number")
    return value


def sympy_expression(text: str, where: str, symbols: Mapping[str, Any]) -> Any:
    """Build the SymPy expression a text stands for.

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

    names = {name: getattr(sympy, name) for name in (*FUNCTIONS, *CONSTANTS)} | dict(symbols)
    return _Walker(text, where, names, lambda value: sympy.sympify(value)).value()


class _Walker:
    """Walks one text's syntax tree over a table of names."""

    def __init__(
        self, text: str, where: str, names: Mapping[str, Any], constant: Callable[[Any], Any]
    ) -> None:
        self.text, self.where, self.names, self.constant = text, where, names, constant

    def refuse(self, found: str) -> InputError:
        variables = sorted(set(self.names) - set(FUNCTIONS) - set(CONSTANTS))
        accepted = f"numbers, + - * / **, {', '.join((*variables, *CONSTANTS))} and " + ", ".join(
            name + "()" for name in FUNCTIONS
        )
        return InputError(self.where, found, f"accepted are {accepted}")

    def value(self) -> Any:
        if len(self.text) > LONGEST_TEXT:
            raise self.refuse(f"an expression of {len(self.text)} characters")
        try:
            return self.walk(ast.parse(self.text.strip(), mode="eval").body)
        except (SyntaxError, RecursionError, MemoryError) as error:
            raise self.refuse(
                f"{_shortened(self.text)!r} cannot be read as an expression"
            ) from error

    def walk(self, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=bool() | str() | bytes() | complex() | None):
                pass
            case ast.Constant(value=int() | float() as value):
                return self.constant(value)
            case ast.Name(id=name) if name in self.names and name not in FUNCTIONS:
                return self.names[name]
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
        raise self.refuse(f"{_shortened(ast.unparse(node))!r} in {_shortened(self.text)!r}")

    def power(self, base: Any, exponent: Any) -> Any:
        plain = not getattr(exponent, "free_symbols", None)
        if plain and abs(float(exponent)) > LARGEST_EXPONENT:
            raise self.refuse(f"an exponent of {float(exponent):.6g}")
        return base**exponent


def _shortened(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."
