r"""Kernels in numbers with bounds of their rounding errors, and in many digits.

Running error analysis (Higham, Accuracy and Stability of Numerical Algorithms, sec. 3.3): every
operation adds its own rounding to what the errors of its operands become,

.. math:: |e_{xy}| \le |x|\,e_y + |y|\,e_x + e_x e_y + u\,|xy|,

and likewise for sums, quotients and functions. Unknowns and parameters are taken as exact, as the
doubles they are; cancellation inside a formula, which derivatives by its arguments do not show,
counts.
"""

from __future__ import annotations

import ast
import functools
import math
import operator
from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from ..arrays import Array, Number, Vector
from ..syntax import parse, parse_expression
from . import integrated_flight, linear_flow
from .kernel import Family, Setup
from .segment import FLOATS, FUNCTIONS, PLAIN, Arithmetic, Kernel, Numbers, Segment, evaluate_in
from .transients import HIGHEST, TABLES, TOGETHER, transients

# Kernels with bounds of their rounding errors as scalar code, for plain runs and for compiling.
#
# Pairs (value, error) are in the place of numbers with bounds. The text of a kernel is rewritten
# once, operation by operation.

UNIT = 0.5 * float(np.finfo(float).eps)
"""The unit roundoff: largest relative error of one operation."""

NEARBY = 1e-7
"""Relative distance at which the slope of a function is read from a difference."""

ROUGHER = {"transients1": 3.0, "transients2": 5.0, "transients4": 80.0}
"""Factor by which functions may be less exact than others; measured are 1.9, 3.4 and 51."""

Pair: TypeAlias = tuple[float, float]
"""A number and a bound of its error."""


def add_pairs(a: Pair, b: Pair) -> Pair:
    """Return a + b."""
    value = a[0] + b[0]
    return value, a[1] + b[1] + UNIT * abs(value)


def subtract_pairs(a: Pair, b: Pair) -> Pair:
    """Return a - b."""
    value = a[0] - b[0]
    return value, a[1] + b[1] + UNIT * abs(value)


def multiply_pairs(a: Pair, b: Pair) -> Pair:
    """Return a b."""
    value = a[0] * b[0]
    spread = abs(a[0]) * b[1] + abs(b[0]) * a[1]
    return value, spread + a[1] * b[1] + UNIT * abs(value)


def divide_pairs(a: Pair, b: Pair) -> Pair:
    """Return a / b."""
    value = a[0] / b[0]
    least = abs(b[0]) - b[1]
    spread = (a[1] + abs(value) * b[1]) / least if least > 0.0 else math.inf
    return value, spread + UNIT * abs(value)


def remainder_of_pairs(a: Pair, b: Pair) -> Pair:
    """Return a modulo b."""
    value = a[0] % b[0]
    turns = abs(math.floor((a[0] - value) / b[0] + 0.5))
    return value, a[1] + turns * b[1] + UNIT * abs(value)


def negate_pair(a: Pair) -> Pair:
    """Return -a."""
    return -a[0], a[1]


def square_pair(a: Pair) -> Pair:
    """Return a a."""
    return multiply_pairs(a, a)


def cube_pair(a: Pair) -> Pair:
    """Return a a a."""
    return multiply_pairs(multiply_pairs(a, a), a)


def floor_pair(a: Pair) -> Pair:
    """Return a whole number of turns; which one does not matter."""
    return float(math.floor(a[0])), 0.0


def steeper(below: float, here: float, above: float, step: float) -> float:
    """Return the larger slope of both sides; not a number where one is none."""
    one, other = abs(below - here) / step, abs(above - here) / step
    return one if one != one or other <= one else other


OPERATIONS: dict[type, Callable[..., Pair]] = {
    ast.Add: add_pairs,
    ast.Sub: subtract_pairs,
    ast.Mult: multiply_pairs,
    ast.Div: divide_pairs,
    ast.Mod: remainder_of_pairs,
}
PYTHON: dict[type, Callable[..., Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
}
OWN = {"square": square_pair, "cube": cube_pair, "floor": floor_pair}


@functools.lru_cache(maxsize=256)
def bounded_kernel(kernel: Kernel, only: int | None = None) -> Callable[..., Any]:
    """Return a kernel without loops as a function of pairs; of its results all, or `only` one."""
    (tree,) = (node for node in parse(kernel.source).body if isinstance(node, ast.FunctionDef))
    if only is not None:
        tree.body = _statements_of(tree.body, only)
    names: dict[str, Any] = {function.__name__: function for function in OPERATIONS.values()}
    _Rewriter(names, kernel.functions).visit(tree)
    tree.name = f"bounded_{tree.name}"
    function = _function_of(ast.unparse(ast.fix_missing_locations(tree)), tree.name, names)
    function.family = Family.CLOSED  # type: ignore[attr-defined]
    return function


def _function_of(text: str, name: str, names: dict[str, Any]) -> Callable[..., Any]:
    """A function of a text that can be added to programs."""
    exec(compile(text, f"<{name}>", "exec"), names)
    names[name].source = text
    function: Callable[..., Any] = names[name]
    return function


def _statements_of(body: list[ast.stmt], only: int) -> list[ast.stmt]:
    """The statements that one of the results depends on."""
    last = body[-1]
    assert isinstance(last, ast.Return)
    assert isinstance(last.value, ast.Tuple | ast.Call)
    results = last.value.elts if isinstance(last.value, ast.Tuple) else last.value.args
    kept: list[ast.stmt] = [ast.Return(results[only])]
    wanted = _names_in(kept[0])
    for statement in reversed(body[:-1]):
        if isinstance(statement, ast.Assign) and _names_in(statement.targets[0]) & wanted:
            wanted |= _names_in(statement.value)
            kept.append(statement)
    return kept[::-1]


def _names_in(tree: ast.AST) -> set[str]:
    return {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}


class _Rewriter(ast.NodeTransformer):
    """Puts calls in the place of operations, and pairs in that of constants."""

    def __init__(self, names: dict[str, Any], functions: dict[str, Callable[..., Any]]) -> None:
        self.names, self.functions = names, FLOATS.names | functions

    def visit_Expr(self, node: ast.Expr) -> ast.AST | None:
        return None  # the documentation

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        return _pair(_value_of(node))

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return _pair(math.nan) if node.id == "nan" else node

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        if _is_constant(node):
            return _pair(_value_of(node))
        return self._call(negate_pair, [self.visit(node.operand)])

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        if _is_constant(node):  # which Python computes once, as one number
            return _pair(_value_of(node))
        given = [self.visit(node.left), self.visit(node.right)]
        if isinstance(node.op, ast.Pow):
            return self._call(self._of_function("pow", 2), given)
        return self._call(OPERATIONS[type(node.op)], given)

    def visit_Call(self, node: ast.Call) -> ast.AST:
        assert isinstance(node.func, ast.Name)
        name, given = node.func.id, [self.visit(argument) for argument in node.args]
        if name == "Setup":
            return self._call(Setup, given)
        if name in OWN:
            return self._call(OWN[name], given)
        return self._call(self._of_function(name, len(given)), given)

    def _call(self, function: Callable[..., Any], given: list[ast.expr]) -> ast.Call:
        self.names[function.__name__] = function
        return ast.Call(ast.Name(function.__name__, ast.Load()), given, [])

    def _of_function(self, name: str, arguments: int) -> Callable[..., Any]:
        """A function of floats as one of pairs, as `bounded` takes its error."""
        own = f"{name}_of_pairs"
        if own not in self.names:
            function = math.pow if name in ("pow", "power") else self.functions[name]
            self.names[own] = _function_of_pairs(own, function, arguments, ROUGHER.get(name, 1.0))
        function_of_pairs: Callable[..., Any] = self.names[own]
        return function_of_pairs


@functools.lru_cache(maxsize=256)
def _function_of_pairs(
    name: str, function: Callable[..., Any], arguments: int, rougher: float
) -> Callable[..., Any]:
    """A function of floats as one of pairs, which is the same for all kernels."""
    found = function(*[0.5] * arguments)
    results = len(found) if isinstance(found, tuple) else 1
    names = {"steeper": steeper, "function": function, "UNIT": UNIT, "NEARBY": NEARBY}
    return _function_of(_text_of_function(name, arguments, results, rougher), name, names)


def _is_constant(node: ast.expr) -> bool:
    return not any(isinstance(part, ast.Name) for part in ast.walk(node))


def _value_of(node: ast.expr) -> float:
    """The value of a constant."""
    if isinstance(node, ast.BinOp):
        return float(PYTHON[type(node.op)](_value_of(node.left), _value_of(node.right)))
    if isinstance(node, ast.UnaryOp):
        return -_value_of(node.operand)
    return float(ast.literal_eval(node))


def _pair(value: float) -> ast.expr:
    """A number of a formula: whole ones are exact, others have been rounded."""
    if value != value:
        return parse_expression("(nan, 0.0)")
    error = 0.0 if value.is_integer() else 2.0 * UNIT * abs(value)
    return ast.Tuple([ast.Constant(value), ast.Constant(error)], ast.Load())


def _text_of_function(name: str, arguments: int, results: int, rougher: float) -> str:
    """The text of a function of pairs, from a ``function`` of floats."""
    numbers = [f"x{i}" for i in range(arguments)]

    def call(target: str, *given: str) -> str:
        targets = ", ".join(f"{target}{k}" for k in range(results))
        return f"{targets} = function({', '.join(given)})"

    lines = [f"def {name}({', '.join(f'a{i}' for i in range(arguments))}):"]
    lines += [f"    x{i}, e{i} = a{i}" for i in range(arguments)]
    lines += ["    " + call("r", *numbers)]
    lines += [f"    g{k} = {rougher} * 4.0 * UNIT * abs(r{k})" for k in range(results)]
    for i in range(arguments):
        below, above = (
            [*numbers[:i], f"x{i} {sign} step", *numbers[i + 1 :]] for sign in ("-", "+")
        )
        lines += [
            f"    off = e{i} + {rougher} * 2.0 * UNIT * abs(x{i})",
            "    if off > 0.0:",
            f"        step = NEARBY * (abs(x{i}) if x{i} != 0.0 else 1.0)",
            "        " + call("l", *below),
            "        " + call("h", *above),
        ]
        lines += [f"        g{k} += steeper(l{k}, r{k}, h{k}, step) * off" for k in range(results)]
    pairs = [f"(r{k}, g{k})" for k in range(results)]
    return "\n".join([*lines, f"    return {', '.join(pairs)}\n"])


# Kernels in many digits: mpmath's functions, and constants to the digits asked for.


def many_digits(ctx: Any) -> Arithmetic:
    """Return the arithmetic of an mpmath context, with the digits that it has now."""
    names = {name: getattr(ctx, name) for name in (*FUNCTIONS, "nan")} | PLAIN
    names |= {f"stumpff{k}": _stumpff(ctx, k) for k in range(HIGHEST + 1)}
    names |= {f"stumpffs{n}": _stumpffs(ctx, n) for n in TOGETHER}
    names |= {f"transients{order}": transients(ctx, order) for order in TABLES}
    names |= linear_flow.multiprecision_functions(ctx) | integrated_flight.multiprecision_functions(
        ctx
    )
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
    """In whole multiples of 2**-bits of 1/k!: terms of |q| < 30 are at most 120, and their sum is
    over 0.02."""
    bits = ctx.prec + 32
    step = int(ctx.ldexp(q, bits))
    term = total = 1 << bits
    j = 0
    while term:
        term = -(term * step >> bits) // ((2 * j + k + 1) * (2 * j + k + 2))
        total += term
        j += 1
    with ctx.workprec(bits):
        found = ctx.ldexp(total, -bits) / ctx.factorial(k)
    return +found


def _operators(function: Callable[[Pair, Pair], Pair]) -> tuple[Callable[..., Any], ...]:
    """An operation of a number with a bound and another number, and of the other one and it."""

    def operator(one: BoundedNumber, other: Number) -> BoundedNumber:
        other = other if type(other) is BoundedNumber else BoundedNumber.of(other)
        return BoundedNumber(*function((one.value, one.error), (other.value, other.error)))

    def turned(one: BoundedNumber, other: Number) -> BoundedNumber:
        return operator(BoundedNumber.of(other), one)

    return operator, turned


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

    def __mul__(self, other: Number) -> BoundedNumber:
        if type(other) is int:  # without an error of its own
            value = self.value * other
            return BoundedNumber(value, abs(other) * self.error + UNIT * abs(value))
        return self._product(other)

    def __pow__(self, exponent: Number) -> BoundedNumber:
        return _power(self, self.of(exponent))

    def __rpow__(self, base: Number) -> BoundedNumber:
        return _power(self.of(base), self)

    def __neg__(self) -> BoundedNumber:
        return BoundedNumber(-self.value, self.error)

    def __abs__(self) -> BoundedNumber:
        return BoundedNumber(abs(self.value), self.error)

    __add__, __radd__ = _operators(add_pairs)
    __sub__, __rsub__ = _operators(subtract_pairs)
    _product, _ = _operators(multiply_pairs)
    __truediv__, __rtruediv__ = _operators(divide_pairs)
    __mod__, __rmod__ = _operators(remainder_of_pairs)

    __rmul__, __pos__ = __mul__, lambda self: self

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
    sizes = partial(integrated_flight.rounding_scale, field, directions, numbers)
    return _bounded_function(partial(integrated_flight.flown, field, directions), sizes=sizes)(
        *arguments
    )


def _real_power(x: float, y: float) -> float:
    found = pow(x, y)
    if isinstance(found, complex):
        raise ArithmeticError("a power has no real value")
    return float(found)


_power = _bounded_function(_real_power)
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
    if isinstance(segment, Segment):
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
