r"""Kernels in numbers with bounds of their rounding errors, and in many digits.

Running error analysis (Higham, Accuracy and Stability of Numerical Algorithms, sec. 3.3): every
operation adds its own rounding to what the errors of its operands become,

.. math:: |e_{xy}| \le |x|\,e_y + |y|\,e_x + e_x e_y + u\,|xy|,

and likewise for sums, quotients and functions. Unknowns and parameters are taken as exact, as the
doubles they are; cancellation inside a formula, which derivatives by its arguments do not show,
counts.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ..arrays import Array, Number, Vector
from . import integration, linear_flow
from .arithmetic import FLOATS, FUNCTIONS, PLAIN, Arithmetic, Kernel, evaluate_in
from .bounded_code import NEARBY, ROUGHER, UNIT, bounded_kernel
from .layout import Family, Setup
from .segment import ClosedForm, Numbers, Segment
from .transients import HIGHEST, TABLES, TOGETHER, transients

# Kernels in many digits: mpmath's functions, and constants to the digits asked for.


def many_digits(ctx: Any) -> Arithmetic:
    """Return the arithmetic of an mpmath context, with the digits that it has now."""
    names = {name: getattr(ctx, name) for name in (*FUNCTIONS, "nan")} | PLAIN
    names |= {f"stumpff{k}": _stumpff(ctx, k) for k in range(HIGHEST + 1)}
    names |= {f"stumpffs{n}": _stumpffs(ctx, n) for n in TOGETHER}
    names |= {f"transients{order}": transients(ctx, order) for order in TABLES}
    names |= linear_flow.multiprecision_functions(ctx) | integration.multiprecision_functions(ctx)
    constants = {"pi": +ctx.pi, "ratio": lambda above, below: ctx.mpf(above) / below}
    return Arithmetic(names | constants, exact=True, number=ctx.convert)


def _stumpff(ctx: Any, k: int) -> Callable[[Number], Number]:
    """c_k by its series near zero, by the recurrence from c_0 and c_1 away from it."""

    def function(q: Number) -> Number:
        q = ctx.mpf(q)
        if k > 1 and abs(q) < 30:
            return _series(ctx, k, q)
        if k == 0:
            return ctx.cos(ctx.sqrt(q)) if q >= 0 else ctx.cosh(ctx.sqrt(-q))
        if k == 1:
            x = ctx.sqrt(abs(q))
            return ctx.one if x == 0 else (ctx.sin(x) if q > 0 else ctx.sinh(x)) / x
        return (1 / ctx.factorial(k - 2) - _stumpff(ctx, k - 2)(q)) / q

    return function


def _stumpffs(ctx: Any, highest: int) -> Callable[[Number], Vector]:
    """All c_k from the first on."""
    functions = [_stumpff(ctx, k) for k in range(1, highest + 1)]
    return lambda q: tuple(function(q) for function in functions)


def _series(ctx: Any, k: int, q: Number) -> Number:
    with ctx.extradps(6):
        term = total = 1 / ctx.factorial(k)
        j = 0
        while term and abs(term) > ctx.eps * abs(total) * 1e-3:
            term *= -q / ((2 * j + k + 1) * (2 * j + k + 2))
            total += term
            j += 1
    return +total


class BoundedNumber:
    """A double and a bound of its error; the operations of kernels, each with its own rounding."""

    __slots__ = ("error", "value")

    def __init__(self, value: float, error: float = 0.0) -> None:
        self.value, self.error = value, error

    @classmethod
    def of(cls, number: Number) -> BoundedNumber:
        """Return a number of a formula: whole ones are exact, others have been rounded."""
        if isinstance(number, cls):
            return number
        value = float(number)
        return cls(value, 0.0 if value.is_integer() else 2.0 * UNIT * abs(value))

    def __add__(self, other: Number) -> BoundedNumber:
        other = other if type(other) is BoundedNumber else self.of(other)
        value = self.value + other.value
        return BoundedNumber(value, self.error + other.error + UNIT * abs(value))

    def __mul__(self, other: Number) -> BoundedNumber:
        if type(other) is int:  # without an error of its own
            value = self.value * other
            return BoundedNumber(value, abs(other) * self.error + UNIT * abs(value))
        other = other if type(other) is BoundedNumber else self.of(other)
        value = self.value * other.value
        spread = abs(self.value) * other.error + abs(other.value) * self.error
        return BoundedNumber(value, spread + self.error * other.error + UNIT * abs(value))

    def __truediv__(self, other: Number) -> BoundedNumber:
        other = other if type(other) is BoundedNumber else self.of(other)
        value = self.value / other.value
        least = abs(other.value) - other.error
        spread = (self.error + abs(value) * other.error) / least if least > 0.0 else math.inf
        return BoundedNumber(value, spread + UNIT * abs(value))

    def __mod__(self, other: Number) -> BoundedNumber:
        other = other if type(other) is BoundedNumber else self.of(other)
        value = self.value % other.value
        turns = abs(round((self.value - value) / other.value))
        return BoundedNumber(value, self.error + turns * other.error + UNIT * abs(value))

    def __pow__(self, exponent: Number) -> BoundedNumber:
        return _power(self, self.of(exponent))

    def __neg__(self) -> BoundedNumber:
        return BoundedNumber(-self.value, self.error)

    def __abs__(self) -> BoundedNumber:
        return BoundedNumber(abs(self.value), self.error)

    def __sub__(self, other: Number) -> BoundedNumber:
        other = other if type(other) is BoundedNumber else self.of(other)
        value = self.value - other.value
        return BoundedNumber(value, self.error + other.error + UNIT * abs(value))

    def __rsub__(self, other: Number) -> BoundedNumber:
        return self.of(other) - self

    def __rtruediv__(self, other: Number) -> BoundedNumber:
        return self.of(other) / self

    def __rmod__(self, other: Number) -> BoundedNumber:
        return self.of(other) % self

    def __rpow__(self, base: Number) -> BoundedNumber:
        return _power(self.of(base), self)

    __radd__, __rmul__, __pos__ = __add__, __mul__, lambda self: self

    def __float__(self) -> float:
        return self.value

    def __lt__(self, other: Number) -> bool:
        return self.value < float(other)

    def __le__(self, other: Number) -> bool:
        return self.value <= float(other)

    def __gt__(self, other: Number) -> bool:
        return self.value > float(other)

    def __ge__(self, other: Number) -> bool:
        return self.value >= float(other)


def _bounded_function(
    function: Callable[..., Any],
    rougher: float = 1.0,
    sizes: Callable[[Array], Array] | None = None,
) -> Callable[..., Any]:
    """A function of floats as one of numbers with bounds.

    A function's own result is good to two units of its last place and to the rounding of its
    arguments, by which its inner steps are no better than the argument they reduce; if it is
    rougher, to a multiple of these. `sizes` are what its results are rounded beside, if not
    themselves.
    """

    def on_bounded(*arguments: Number) -> Number | Vector:
        given = [BoundedNumber.of(a) for a in arguments]
        values = [a.value for a in given]
        found = function(*values)
        several = isinstance(found, tuple | list)
        results = [float(number) for number in found] if several else [float(found)]
        beside = map(abs, results) if sizes is None else sizes(np.array(results)).tolist()
        errors = [rougher * 4.0 * UNIT * size for size in beside]
        for i, argument in enumerate(given):
            off = argument.error + rougher * 2.0 * UNIT * abs(argument.value)
            if off > 0.0:
                slopes = _slopes(function, values, i, results)
                errors = [e + slope * off for e, slope in zip(errors, slopes, strict=True)]
        bounds = tuple(map(BoundedNumber, results, errors))
        return bounds if several else bounds[0]

    return on_bounded


def _slopes(
    function: Callable[..., Any], values: list[float], i: int, here: list[float]
) -> list[float]:
    """The size of a function's derivatives by one argument, from both sides, the larger one."""
    step = NEARBY * (abs(values[i]) or 1.0)
    largest = [0.0] * len(here)
    for side in (-step, step):
        moved = [*values[:i], values[i] + side, *values[i + 1 :]]
        try:
            there = function(*moved)
        except (ValueError, ArithmeticError):  # beyond the end of its domain
            continue
        numbers = there if isinstance(there, tuple | list) else (there,)
        slopes = [abs(n - h) / step for n, h in zip(numbers, here, strict=True)]
        largest = [
            size if size != size or slope <= size else slope
            for slope, size in zip(slopes, largest, strict=True)
        ]  # not a number where one is none
    return largest


def _floor(x: Number) -> BoundedNumber:
    """A whole number of turns; which one does not matter."""
    return BoundedNumber(float(math.floor(BoundedNumber.of(x).value)))


def _flow(d: int, h: int, directions: int, *arguments: Number) -> Vector:
    """A linear flight."""
    numbers = [BoundedNumber.of(a).value for a in arguments[1:]]
    sizes = partial(linear_flow.rounding_scale, d, h, directions, numbers)
    function = partial(linear_flow.flow, d, h, directions)
    return _bounded_function(function, sizes=sizes)(*arguments)


def _integrated_flight(field: str, directions: str, *arguments: Number) -> Vector:
    """A flight that is integrated."""
    numbers = [BoundedNumber.of(a).value for a in arguments]
    sizes = partial(integration.rounding_scale, field, directions, numbers)
    return _bounded_function(partial(integration.flown, field, directions), sizes=sizes)(*arguments)


_power = _bounded_function(pow)
_OWN = {
    "floor": _floor,
    "flow": _flow,
    "flown": _integrated_flight,
    "nan": BoundedNumber(math.nan),
    **PLAIN,
}
BOUNDED = Arithmetic(
    {
        name: _bounded_function(f, ROUGHER.get(name, 1.0))
        for name, f in FLOATS.names.items()
        if callable(f)
    }
    | _OWN
)


def bounds_of(segment: Segment, start: Numbers, end: Numbers, values: Numbers) -> Any:
    """Return the blocks of a segment, and bounds of their errors in the same layout, from the
    arguments of `Segment.blocks`; floats among them are exact."""
    if isinstance(segment, ClosedForm):
        found = _by_pairs(segment.kernel, [*start, *end, *values])
        if found is not None:
            return found
    given = ([_exact_bounded(number) for number in part] for part in (start, end, values))
    return _split_errors(segment.over(BOUNDED)(*given))


def bounds_of_kernel(kernel: Kernel, arguments: Numbers) -> Any:
    """Return a kernel's result, and bounds of its errors in the same layout; floats among the
    arguments are exact."""
    found = _by_pairs(kernel, arguments)
    if found is not None:
        return found
    return _split_errors(evaluate_in(kernel, BOUNDED)(*map(_exact_bounded, arguments)))


def _by_pairs(kernel: Kernel, arguments: Numbers) -> Any:
    """The same by scalar code, which is faster; None for kernels in loops, and at the end of a
    function's domain, where its slope is taken from one side."""
    if kernel.family is not Family.CLOSED:
        return None
    given = [
        (x.value, x.error) if isinstance(x, BoundedNumber) else (float(x), 0.0) for x in arguments
    ]
    try:
        return _split_pairs(bounded_kernel(kernel)(*given))
    except (ArithmeticError, ValueError):
        return None


def _split_pairs(result: Any) -> tuple[Any, Any]:
    """As `_split_errors`, of pairs."""
    if result and isinstance(result[0], float):
        return result
    values, errors = zip(*map(_split_pairs, result), strict=True) if result else ((), ())
    return (Setup(*values), Setup(*errors)) if isinstance(result, Setup) else (values, errors)


def _exact_bounded(number: Number) -> BoundedNumber:
    return number if isinstance(number, BoundedNumber) else BoundedNumber(float(number))


def _split_errors(result: Any) -> tuple[Any, Any]:
    """Values and errors of a result, each laid out as it is."""
    if type(result) is BoundedNumber:
        return result.value, result.error
    if not isinstance(result, tuple):
        bound = BoundedNumber.of(result)
        return bound.value, bound.error
    values, errors = zip(*map(_split_errors, result), strict=True) if result else ((), ())
    return (Setup(*values), Setup(*errors)) if isinstance(result, Setup) else (values, errors)
