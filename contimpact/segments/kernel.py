"""A kernel as a function: what it is, and how it is made from its text."""

from __future__ import annotations

import math
import re
import types
from collections.abc import Callable
from typing import Any, Protocol

from ..arrays import Number
from .integration import require
from .layout import Family, declaration_of


class Kernel(Protocol):
    """A kernel as a function of floats."""

    family: Family
    """How its flights are computed, as its writer says."""
    parameters: frozenset[str]
    """Parameters that its results depend on."""

    functions: dict[str, Callable[..., Any]]
    """Functions of its own, which take the numbers of any arithmetic."""
    text: str
    """Text as it was written, its constants by name."""
    source: str
    """Text that runs, with constants as numbers."""
    __name__: str
    __code__: types.CodeType
    __globals__: dict[str, Any]

    def __call__(self, *arguments: Number) -> Any: ...

    def __hash__(self) -> int: ...


def function_of(
    name: str,
    text: str,
    file: str,
    names: dict[str, Any],
    functions: dict[str, Callable[..., Any]] | None = None,
) -> Kernel:
    """Return a function of floats from its text, as a kernel.

    `names` are those it uses, `functions` those among them that arithmetics do not have, in plain
    sums and products.
    """
    namespace = names | (functions or {})
    source = _CONSTANT.sub(_fold_name, text)
    exec(compile(source, file, "exec"), namespace)
    kernel: Kernel = namespace[name]
    kernel.family, kernel.parameters = declaration_of(text)
    if kernel.family is Family.INTEGRATED:
        require()
    kernel.text, kernel.source, kernel.functions = text, source, functions or {}
    return kernel


_CONSTANT = re.compile(r"\bpi\b|\bratio\((-?\d+), (\d+)\)")
MANY_DIGITS = 2**31
"""Number of digits from which on a quotient is written as the double nearest to it."""


def _fold_name(constant: re.Match[str]) -> str:
    """A number instead of a name, so that compilers can fold constants."""
    above, below = constant.groups()
    if above is None:
        return repr(math.pi)
    above, below = int(above), int(below)
    if max(abs(above), below) < MANY_DIGITS:
        return f"({above}/{below})"
    try:
        return repr(above / below)
    except OverflowError:
        return "1e999"


FUNCTIONS = tuple("sin cos tan asin acos atan sinh cosh tanh exp log sqrt floor".split())
"""Elementary functions; Stumpff functions and free motions come besides."""


def square(x: Number) -> Number:
    """Return x x."""
    return x * x


def cube(x: Number) -> Number:
    """Return x x x."""
    return x * x * x


def power(x: Number, y: Number) -> Number:
    """Return x to the power of y."""
    return x**y


ELEMENTARY: dict[str, Any] = {
    **{name: getattr(math, name) for name in FUNCTIONS},
    "nan": math.nan,
    "square": square,
    "cube": cube,
    "power": math.pow,  # without complex numbers
}
"""What names that every arithmetic has stand for in floats."""
