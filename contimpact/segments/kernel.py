"""What kernels are, and what they return: the one place that knows how results are laid out.

=================  ============================================================================
kernel             returns
=================  ============================================================================
``flight_<a>_<b>`` `Blocks`, as a plain tuple: residual, start, end, by_parameter
``setup``          `Setup`
``motion_<a>``     displacement from the wall, velocity and acceleration of the gap coordinate
``flight_0_<a>``   `Blocks` of the flight from the state on the section t = 0 to a wall
``flight_0_<p>``   the same for the flight of p periods, back to the section
``flight_0_0``     the same for the flight of a time that stands in the place of v_0, which is zero
``since_<a>``      position, velocity and acceleration of a wall's gap coordinate since the section
``passing_<a>``    the same since any state at any time, in the first mode
``surfaces``       for each pair of guards, 1 if a flight ends on the surface it leaves, or else 0
``gap_<a>_<b>``    position, velocity and acceleration of the gap coordinate of wall b, after wall a
``law_<a>``        of a linear flight: degrees of freedom, harmonics, their numbers, start state
``rates_<a>``      how velocities of coordinates of first order change with the state
``field_<a>``      of a flight that is integrated: the text of its field, and what it leaves with
``harmonics``      the mean, then k, a_k, b_k for each harmonic; NaN alone where there are none
=================  ============================================================================
"""

from __future__ import annotations

import math
import re
import types
from collections.abc import Callable, Iterable, Iterator
from enum import StrEnum
from typing import Any, NamedTuple, Protocol, TypeAlias

from ..arrays import Number, Vector
from ..models.expressions import FUNCTIONS as EXPRESSED
from .integration import require

SECTION = "0"
"""Place at which flights of orbits without impacts start, in the names of kernels: t = 0. They end
there again after a number of periods, which takes the place of a letter, or at a guard."""

Row: TypeAlias = tuple[Number, ...]
"""Numbers of the arithmetic a kernel is evaluated in; of a matrix, row by row."""

Blocks: TypeAlias = tuple[Row, Row, Row, Row]
"""A segment's residual (m), and its derivatives: with respect to the unknowns of the impact it
leaves (m x m), to those of the impact it reaches (m x m), and to the free parameters (m x free)."""


class Family(StrEnum):
    """How a kernel's flights are computed."""

    CLOSED = "closed form"
    """A fixed number of elementary functions."""
    HARMONICS = "harmonics"
    """A closed form with a loop over the forcing's harmonics."""
    LINEAR = "linear"
    """The exponential of a matrix, in steps that depend on the arguments."""
    INTEGRATED = "integrated"
    """Taylor steps of a differential equation."""
    SERIES = "series"
    """The text of such steps, whose derivatives by several directions are computed side by side."""
    UNKNOWN = "unknown"
    """The formulas do not say, and the result is NaN."""

    @property
    def stepped(self) -> bool:
        """Whether the number of steps depends on the arguments."""
        return self in (Family.LINEAR, Family.INTEGRATED)


def declaration(family: Family, parameters: Iterable[str]) -> str:
    """Return the comment in which a kernel's text says what it is."""
    return f"# family: {family}; parameters: {', '.join(parameters)}\n"


_DECLARED = re.compile(r"^# family: (.*); parameters: (.*)$", re.MULTILINE)


def declaration_of(text: str) -> tuple[Family, frozenset[str]]:
    """Return the family of a kernel and the parameters its results depend on, as its text says."""
    found = _DECLARED.search(text)
    if found is None:
        return Family.CLOSED, frozenset()
    return Family(found[1]), frozenset(found[2].split(", ")) - {""}


class CombinedBlocks(NamedTuple):
    """`Blocks` whose rows are combinations of a segment's equations, by a regular matrix that keeps
    their orientation: those of a flight that is too long to be computed as a whole."""

    residual: Row
    start: Row
    end: Row
    by_parameter: Row


class Setup(NamedTuple):
    """What depends on the parameters alone."""

    period: Number
    """The forcing period."""
    slopes: Row
    """Its derivatives with respect to the free parameters, shape (free,)."""
    curvatures: Row
    """Its second derivatives, row by row, shape (free * free,)."""
    walls: Row
    """Positions of the walls, in the model's order, shape (w,)."""
    derived: Row
    """Derived parameters, in the model's order, shape (d,)."""
    derived_slopes: Row
    """Their derivatives with respect to the free parameters, row by row, shape (d * free,)."""


NAMES: dict[str, Any] = {"Setup": Setup}
"""Functions that a kernel calls in order to return its results."""


def result_text(result: tuple[Any, ...]) -> str:
    """Return what stands behind ``return`` in a kernel, from the texts of its numbers."""
    parts = [
        f"({' '.join(f'{e},' for e in part)})" if isinstance(part, tuple) else part
        for part in result
    ]
    lines = "".join(f"        {part},\n" for part in parts)
    return f"{'Setup' if isinstance(result, Setup) else ''}(\n{lines}    )"


def flat(result: Any) -> list[Any]:
    """Return all numbers of a kernel's result, in order."""
    return [e for part in result for e in flat(part)] if isinstance(result, tuple) else [result]


def refill(result: Any, values: Iterable[Any]) -> Any:
    """Return a result laid out as another one, with other values in order."""
    return _refill(result, iter(values))


def _refill(result: Any, values: Iterator[Any]) -> Any:
    if not isinstance(result, tuple):
        return next(values)
    parts = (_refill(part, values) for part in result)
    return Setup(*parts) if isinstance(result, Setup) else tuple(parts)


LONG = 1e3
"""Growth of a flight from which on it is computed in pieces."""


def differences_grow(leaving: Vector, arriving: Vector, m: int, timed: bool) -> bool:
    """Whether differences grow too much along a flight, from the derivatives in its `Blocks`.

    Those by an unknown of the start are compared with those by the same one of the end, in any
    units: of positions and velocities, which take turns, positions by positions alone, and
    velocities by velocities. Where flights are `timed`, the first unknown is a time, and the first
    equation may be divided by one. The function is in the plain subset of Python.
    """
    for i in range(m):
        one, other, of_time = 0.0, 0.0, timed and i == 0
        for k in range(m):
            if of_time or (k % 2 == i % 2 and not (timed and k == 0)):
                one, other = max(one, abs(leaving[m * k + i])), max(other, abs(arriving[m * k + i]))
        if one > LONG and one > LONG * other:
            return True
    return False


# A kernel as a function, made from its text.


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


FUNCTIONS = (*EXPRESSED, "floor")
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
