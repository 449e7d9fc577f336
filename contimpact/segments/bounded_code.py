"""Kernels with bounds of their rounding errors as scalar code, for plain runs and for compiling.

The rules are those of `bounded`, with pairs (value, error) in the place of its numbers. The text of
a kernel is rewritten once, operation by operation.
"""

from __future__ import annotations

import ast
import functools
import math
import operator
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from ..syntax import parse, parse_expression
from .arithmetic import FLOATS, Kernel
from .layout import Setup

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
    return _function_of(ast.unparse(ast.fix_missing_locations(tree)), tree.name, names)


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
            found = function(*[0.5] * arguments)
            results = len(found) if isinstance(found, tuple) else 1
            text = _text_of_function(own, arguments, results, ROUGHER.get(name, 1.0))
            # names of its own: `function` is another one in every text
            names = {"steeper": steeper, "function": function, "UNIT": UNIT, "NEARBY": NEARBY}
            self.names[own] = _function_of(text, own, names)
        function_of_pairs: Callable[..., Any] = self.names[own]
        return function_of_pairs


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
