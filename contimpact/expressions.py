"""Text to number or to SymPy expression, without ``eval``.

The text is parsed to Python's syntax tree and only arithmetic, named constants, the elementary
functions below and the names the caller declares are walked; everything else is refused by name.
Plain numbers never import SymPy.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from .errors import InputError, shortened

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
            where, f"{shortened(text)!r} has no real value ({error})", "give a finite number"
        ) from None
    if not math.isfinite(value):
        raise InputError(where, f"{shortened(text)!r} is {value}", "give a finite number")
    return value


def check_expression(text: str, where: str, variables: Sequence[str]) -> None:
    """Check what can be checked of an expression without SymPy: syntax, names, finite constants.

    Parameters
    ----------
    text : str
        The expression, in the names of `variables`, `FUNCTIONS` and `CONSTANTS`.
    where : str
        The place named in an error.
    variables : sequence of str

    Raises
    ------
    InputError
        If anything else stands in it, or a part without variables has no finite real value.
    """
    functions = {name: _of_any(getattr(math, name)) for name in FUNCTIONS}
    constants = {name: getattr(math, name) for name in CONSTANTS}
    names = functions | constants | dict.fromkeys(variables, _Anything())
    try:
        _Checker(text, where, names, float).value()
    except InputError:
        raise
    except (ArithmeticError, ValueError, TypeError) as error:
        raise InputError(
            where, f"{shortened(text)!r} has no finite real value ({error})",
            "use numbers and functions where they are finite and real",
        ) from None  # fmt: skip


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
        unreadable = f"{shortened(self.text)!r} cannot be read as an expression"
        try:
            tree = ast.parse(self.text.strip(), mode="eval")
        except (SyntaxError, RecursionError, MemoryError, ValueError) as error:
            raise self.refuse(unreadable) from error
        try:
            return self.walk(tree.body)
        except RecursionError as error:
            raise self.refuse(unreadable) from error

    def walk(self, node: ast.expr) -> Any:
        match node:
            case ast.Constant(value=bool() | str() | bytes() | complex() | None):
                pass
            case ast.Constant(value=int() | float() as value):
                return self.constant(value)
            case ast.Name(id=name) if name in self.names and name not in FUNCTIONS:
                return self.names[name]
            case ast.Name(id=name) if name not in self.names:
                raise self.refuse(f"unknown name {name!r} in {shortened(self.text)!r}")
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
        raise self.refuse(f"{shortened(ast.unparse(node))!r} in {shortened(self.text)!r}")

    def power(self, base: Any, exponent: Any) -> Any:
        plain = not getattr(exponent, "free_symbols", None)
        if plain and abs(float(exponent)) > LARGEST_EXPONENT:
            raise self.refuse(f"an exponent of {float(exponent):.6g}")
        return base**exponent


class _Checker(_Walker):
    """Walks over `_Anything`: parts without variables are numbers, and have to be finite."""

    def walk(self, node: ast.expr) -> Any:
        value = super().walk(node)
        if isinstance(value, complex):
            raise ValueError("a complex number")
        if isinstance(value, float) and not math.isfinite(value):
            raise OverflowError("a number that is not finite")
        return value


class _Anything:
    """Stands for the value of a variable, and of all that is computed from one."""

    free_symbols = ("t",)

    def absorb(self, other: Any = None) -> _Anything:
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = __mul__ = __rmul__ = absorb
    __truediv__ = __rtruediv__ = __pow__ = __rpow__ = __pos__ = __neg__ = absorb


def _of_any(function: Callable[[float], float]) -> Callable[[Any], Any]:
    return lambda value: value if isinstance(value, _Anything) else function(value)
