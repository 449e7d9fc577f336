"""The arithmetics in which a kernel can be evaluated.

A kernel is one straight-line text: sums, products, quotients, powers and functions, all by name;
where a forcing has many harmonics it holds a loop over these.
What the names stand for makes the arithmetic: floats, arrays, numbers with bounds of their rounding
errors (`bounded`), many digits (`bounded`), truncated Taylor series (`derivatives`). Two constants
are not whole numbers: ``pi``, and ``ratio(p, q)`` for the quotient of two of these. Floats and
arrays see them as numbers; an exact arithmetic makes them itself.
"""

from __future__ import annotations

import functools
import math
import types
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Number
from . import integrated_flight, layout, linear_flow, transients
from . import transients as array_transients
from . import transients as stumpff
from .kernel import ELEMENTARY, cube, function_of, power, square
from .kernel import FUNCTIONS as FUNCTIONS
from .kernel import Kernel as Kernel


def _same(number: Number) -> Number:
    return number


@dataclass(frozen=True)
class Arithmetic:
    """What the names in a kernel stand for."""

    names: dict[str, Any]
    """Functions, ``nan``, and what lays results out. An exact arithmetic has ``pi`` and ``ratio``
    besides."""
    exact: bool = False
    """Whether constants are looked up among the names, rather than taken as floats."""
    number: Callable[[Number], Number] = _same
    """Makes a number of it of a double, or of a number that it is already."""
    time: Callable[[Number], Number] = _same
    """Makes what a kernel may reduce to the forcing's period of the time of an impact."""


def evaluate_in(kernel: Kernel, arithmetic: Arithmetic) -> Callable[..., Any]:
    """Return a kernel as a function of the numbers of an arithmetic."""
    code = _exact_code(kernel.text) if arithmetic.exact else kernel.__code__
    names = arithmetic.names | kernel.functions if kernel.functions else arithmetic.names
    return types.FunctionType(code, names, kernel.__name__)


def kernel_of(
    name: str, text: str, file: str, functions: dict[str, Callable[..., Any]] | None = None
) -> Kernel:
    """Return a kernel, as a function of floats, from its text.

    `functions` are those that it calls and arithmetics do not have, in plain sums and products.
    """
    return function_of(name, text, file, FLOATS.names, functions)


@functools.cache
def _exact_code(text: str) -> types.CodeType:
    module = compile(text, "<kernel>", "exec")
    return next(c for c in module.co_consts if isinstance(c, types.CodeType))


def waves(rows: Any, phase: Any, dt: Any) -> Any:
    """Return the rows (k, a_k, b_k) of a sum over harmonics, in each of which stands its term."""
    return rows


def total(x: Any) -> Any:
    """Return the sum of the terms of a row of `waves`."""
    return x


PLAIN: dict[str, Any] = {
    "square": square,
    "cube": cube,
    "power": power,
    "waves": waves,
    "total": total,
    **layout.NAMES,
}
"""Names that stand for the same in every arithmetic."""

FLOATS = Arithmetic(
    {**PLAIN, **ELEMENTARY, **linear_flow.SCALAR, **integrated_flight.SCALAR}
    | stumpff.STUMPFF_SCALAR
    | transients.SCALAR
)

AT_ONCE = 8192
"""Numbers in the arrays that a sum over harmonics makes: as many as a processor holds nearby."""


def _array_waves(rows: Any, phase: Any, dt: Any) -> Iterator[Any]:
    """Several rows at once, along a first axis of their own."""
    shape = np.broadcast_shapes(np.shape(phase), np.shape(dt))
    count = max(1, AT_ONCE // max(1, math.prod(shape)))
    columns = np.array(rows, dtype=float).T
    for first in range(0, len(rows), count):
        part = columns[:, first : first + count]
        yield part.reshape(*part.shape, *(1 for _ in shape))


_NUMPY_SPELLING = {"asin": "arcsin", "acos": "arccos", "atan": "arctan"}
ARRAYS = Arithmetic(
    {name: getattr(np, _NUMPY_SPELLING.get(name, name)) for name in FUNCTIONS}
    | {"nan": math.nan, **linear_flow.ARRAY, **integrated_flight.ARRAY, **PLAIN}
    | {"waves": _array_waves, "total": lambda x: np.sum(x, axis=0)}
    | stumpff.STUMPFF_ARRAY
    | array_transients.ARRAY
)

STATES = Arithmetic({**ARRAYS.names, **linear_flow.STATES, **integrated_flight.STATES})
"""Arrays, where derivatives of linear and of integrated flights by parameters are not asked for."""
