"""The text of an integrated flight by Taylor's method, in the plain subset of Python.

A quantity is a truncated series in the time s, with its derivatives by the directions: a row of
1 + D numbers for each order. All rows of one order stand side by side in a vector, one order after
the other. Sums and products are those of series. An elementary function y = f(a) follows from
y' = f'(a) a', by series of f'(a) and a, and its derivatives by the directions are those of a times
f'(a): f'(a) is a series of its own, which y itself, its companion (of sin, cos) or a product leads
to. Quantities that do not change along a flight, or change linearly with the time, have no rows.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..models.expressions import FUNCTIONS
from ..syntax import parse_expression
from .integration import statement


class Quantity(NamedTuple):
    """A series: what it changes with, the directions it depends on, and where it is found."""

    degree: int
    """0 of a constant, 1 of what is linear in the time, 2 of all others."""
    by: frozenset[int]
    place: str
    """Where its row begins; of others the number that names them."""


CONSTANT, LINEAR, GENERAL = range(3)

NOTHING: frozenset[int] = frozenset()


class Writer:
    """Writes the text of a flight.

    Constants are numbers ``c7``, with derivatives ``c7_2`` by the directions. What is linear in the
    time has them at the start of each step, ``c7``, and as rates, ``r7``.
    """

    def __init__(self, field: str, directions: tuple[str, ...]) -> None:
        self.field, self.stated, self.directions = field, statement(field), directions
        self.freedom = self.stated.freedom
        self.width = 1 + len(directions)
        self.once: list[str] = []
        """Lines for a flight, a step, and an order of the series."""
        self.each_step: list[str] = []
        self.each_order: list[str] = []
        self.known: dict[tuple[object, ...], Quantity] = {}
        self.rows = 2 * self.freedom
        self.count = 0
        self.helpers: dict[str, str] = {}
        every = frozenset(range(1, self.width))
        places = range(self.freedom)
        self.means = [Quantity(GENERAL, every, str(self.width * i)) for i in places]
        self.speeds = [
            Quantity(GENERAL, every, str(self.width * (self.freedom + i))) for i in places
        ]
        names = self.stated.names
        self.given = {name: f"g{i}" for i, name in enumerate(names)}
        self.variables: dict[str, Quantity] = {}
        for name in ("dt", *self.stated.parameters):
            self.variables[name] = self.number(self.given[name], name)
        self.variables["t"] = self.time()
        for i in places:
            self.variables[f"x{i}"] = self.position(i)
            self.variables[f"v{i}"] = self.speeds[i]

    # Names and places.

    def unit(self, name: str) -> frozenset[int]:
        """The direction that is a name, if it is one."""
        found = self.directions.index(name) + 1 if name in self.directions else 0
        return frozenset({found} - {0})

    def new(self) -> str:
        self.count += 1
        return str(self.count)

    def new_row(self, by: frozenset[int]) -> Quantity:
        self.rows += 1
        return Quantity(GENERAL, by, str(self.width * (self.rows - 1)))

    def at(self, a: Quantity, j: int = 0) -> str:
        """Its coefficient of the order under way, or the derivative of that."""
        if a.degree < GENERAL:
            return f"c{a.place}_{j}" if j in a.by or j == 0 else "0.0"
        return f"r[{int(a.place) + j}]"

    def rate(self, a: Quantity, j: int = 0) -> str:
        """The rate of what is linear in the time."""
        return f"r{a.place}_{j}" if j in a.by or j == 0 else "0.0"

    # What a flight is given.

    def number(self, text: str, name: str = "") -> Quantity:
        """A constant that is given, or known."""
        key = "number", text
        if key not in self.known:
            made = self.known[key] = Quantity(CONSTANT, self.unit(name), self.new())
            self.once.append(f"{self.at(made)} = {text}")
            self.once += [f"{self.at(made, j)} = 1.0" for j in made.by]
        return self.known[key]

    def time(self) -> Quantity:
        """The time, linear in the part of the flight."""
        length = self.variables["dt"]
        made = Quantity(LINEAR, length.by | self.unit("t"), self.new())
        self.once += [f"{self.rate(made)} = {self.at(length)}"]
        self.each_step.append(f"{self.at(made)} = {self.given['t']} + at * {self.at(length)}")
        for j in made.by:
            self.once.append(f"{self.rate(made, j)} = {'1.0' if j in length.by else '0.0'}")
            self.each_step.append(f"{self.at(made, j)} = {'at' if j in length.by else '1.0'}")
        return made

    def position(self, i: int) -> Quantity:
        """A position, from the mean velocity."""
        mean, length, name = self.means[i], self.variables["dt"], f"x{i}"
        made = self.new_row(mean.by)
        for j in range(self.width):
            text = f"{self.at(length)} * {self.at(mean, j)}"
            self.each_order.append(
                f"{self.at(made, j)} = {text}{f' + {self.at(mean)}' if j in length.by else ''}"
            )
        begun = [f"{self.at(made)} += {self.given[name]}"]
        begun += [f"{self.at(made, j)} += 1.0" for j in self.unit(name)]
        self.each_order += ["if k == 0:", *(f"    {line}" for line in begun)]
        return made

    # Sums and products.

    def combined(self, *key: object, make: Callable[[], Quantity]) -> Quantity:
        if key not in self.known:
            self.known[key] = make()
        return self.known[key]

    def sum(self, a: Quantity, b: Quantity, sign: str = "+") -> Quantity:
        return self.combined("sum", a, b, sign, make=lambda: self._sum(a, b, sign))

    def _sum(self, a: Quantity, b: Quantity, sign: str) -> Quantity:
        by, degree = a.by | b.by, max(a.degree, b.degree)
        if degree < GENERAL:
            made = Quantity(degree, by, self.new())
            lines = self.once if degree == CONSTANT else self.each_step
            for j in (0, *by):
                lines.append(f"{self.at(made, j)} = {self.at(a, j)} {sign} {self.at(b, j)}")
            if degree == LINEAR:
                for j in (0, *by):
                    one, other = (self.rate(x, j) if x.degree == LINEAR else "0.0" for x in (a, b))
                    self.once.append(f"{self.rate(made, j)} = {one} {sign} {other}")
            return made
        made = self.new_row(by)
        a, b = (self.general(x) if x.degree == LINEAR else x for x in (a, b))
        both = [x for x in (a, b) if x.degree == GENERAL]
        minus = "-" if sign == "-" else ""
        for j in (0, *by):
            if len(both) == 2:
                text = f"{self.coefficient(a, j)} {sign} {self.coefficient(b, j)}"
            else:
                text = f"{minus if both[0] is b else ''}{self.coefficient(both[0], j)}"
            self.each_order.append(f"{self.at(made, j)} = {text}")
        if len(both) == 1:
            rest = a if both[0] is b else b
            how = f"{minus}=" if minus and rest is b else "+="
            self.each_order.append("if k == 0:")
            for j in (0, *rest.by):
                self.each_order.append(f"    {self.at(made, j)} {how} {self.at(rest, j)}")
        return made

    def coefficient(self, a: Quantity, j: int) -> str:
        return self.at(a, j) if j == 0 or j in a.by else "0.0"

    def general(self, a: Quantity) -> Quantity:
        """The same with rows."""
        if a.degree == GENERAL:
            return a
        return self.combined("general", a, make=lambda: self._general(a))

    def _general(self, a: Quantity) -> Quantity:
        made = self.new_row(a.by)
        for j in (0, *a.by):
            later = f"({self.rate(a, j)} if k == 1 else 0.0)" if a.degree == LINEAR else "0.0"
            self.each_order.append(f"{self.at(made, j)} = {self.at(a, j)} if k == 0 else {later}")
        return made

    def product(self, a: Quantity, b: Quantity) -> Quantity:
        if b.degree < a.degree:
            a, b = b, a
        return self.combined("product", a, b, make=lambda: self._product(a, b))

    def _product(self, a: Quantity, b: Quantity) -> Quantity:
        by = a.by | b.by
        if a.degree == CONSTANT:
            made = self.new_row(by) if b.degree == GENERAL else Quantity(b.degree, by, self.new())
            lines = (self.once, self.each_step, self.each_order)[b.degree]
            for j in (0, *by):
                lines.append(f"{self.at(made, j)} = {self._scaled(a, b, j, self.at)}")
                if b.degree == LINEAR:
                    scaled = self._scaled(a, b, j, self.rate)
                    self.once.append(f"{self.rate(made, j)} = {scaled}")
            return made
        a, b = self.general(a), self.general(b)
        made = self.new_row(by)
        found = ", ".join(self.at(made, j) for j in (0, *sorted(by)))
        self.each_order.append(f"{found}{'' if by else ','} = {self.convolution(a, b)}")
        return made

    def _scaled(
        self, a: Quantity, b: Quantity, j: int, part: Callable[[Quantity, int], str]
    ) -> str:
        """The product of a constant and a part of a quantity, or its derivative."""
        terms = [f"{self.at(a)} * {part(b, j)}"] if j == 0 or j in b.by else []
        terms += [f"{self.at(a, j)} * {part(b, 0)}"] if j != 0 and j in a.by else []
        return " + ".join(terms)

    def convolution(self, a: Quantity, b: Quantity) -> str:
        """The call of a function that returns the coefficients of a product."""
        square = a.place == b.place and a.by == b.by
        by = sorted(a.by | b.by)
        one, other = (_letters(x.by) for x in (a, b))
        name = f"square_of_{one}" if square else f"product_of_{one}_{other}"
        lines = ["x, y = p[0], q[0]", "s0 += x * y"]
        for j in by:
            terms = [f"x * q[{j}]"] if j in b.by and not square else []
            terms += [f"p[{j}] * y"] if j in a.by else []
            lines.append(f"s{j} += {' + '.join(terms)}")
        twice = "2.0 * " if square else ""
        sums = ["s0", *(f"{twice}s{j}" for j in by)]
        self.helper(name, lines, ["s0", *(f"s{j}" for j in by)], sums)
        return f"{name}(w, {a.place}, {b.place}, k)"

    def helper(
        self, name: str, lines: Sequence[str], sums: Sequence[str], result: Sequence[str]
    ) -> None:
        """Add a function that sums over the orders of two series, whose rows are p and q."""
        if name in self.helpers:
            return
        text = f"def {name}(w, a, b, k):\n"
        text += "".join(f"    {one} = 0.0\n" for one in sums)
        text += "    for i in range(k + 1):\n"
        text += "        p, q = w[STRIDE * i + a:], w[STRIDE * (k - i) + b:]\n"
        text += "".join(f"        {line}\n" for line in lines)
        text += f"    return ({', '.join(result)},)\n"
        self.helpers[name] = text

    # Elementary functions.

    def value(self, a: Quantity) -> Quantity:
        """The same without derivatives."""
        return a._replace(by=NOTHING)

    def function(self, name: str, a: Quantity) -> Quantity:
        return self.combined(name, a, make=lambda: self._function(name, a))

    def _function(self, name: str, a: Quantity) -> Quantity:
        if a.degree == CONSTANT:
            return self._of_constant(name, a)
        if name in PAIRS:
            partner, sign, other_sign = PAIRS[name]
            made, other = self.new_row(a.by), self.new_row(a.by)
            self.known[partner, a] = other
            self.chained(name, a, made, other, sign)
            self.chained(partner, a, other, made, other_sign)
            self.differentiate(a, made, other, sign)
            self.differentiate(a, other, made, other_sign)
            return made
        made, plain = self.new_row(a.by), self.value(a)
        if name == "exp":
            slope = self.value(made)
            self.chained(name, a, made, slope)
        elif name in ("tan", "tanh", "sqrt", "recip"):
            slope = self.new_row(NOTHING)
            self.chained(name, a, made, slope)
            itself = self.value(made)
            one = self.number("1.0")
            if name in ("tan", "tanh"):
                sign = "+" if name == "tan" else "-"
                found = self.sum(one, self.product(itself, itself), sign)
            elif name == "recip":
                found = self.product(self.number("-1.0"), self.product(itself, itself))
            else:
                found = self.product(self.number("0.5"), self.function("recip", itself))
            self.each_order.append(f"{self.at(slope)} = {self.at(found)}")
        else:
            slope = self.general(self.slope(name, plain))
            self.chained(name, a, made, slope)
        self.differentiate(a, made, slope)
        return made

    def slope(self, name: str, a: Quantity) -> Quantity:
        """The derivative of a function that follows from its argument alone."""
        if name == "log":
            return self.function("recip", a)
        one = self.number("1.0")
        square = self.product(a, a)
        if name == "atan":
            return self.function("recip", self.sum(one, square))
        root = self.function("recip", self.function("sqrt", self.sum(one, square, "-")))
        return root if name == "asin" else self.product(self.number("-1.0"), root)

    def _of_constant(self, name: str, a: Quantity) -> Quantity:
        made = Quantity(CONSTANT, a.by, self.new())
        x, y = self.at(a), self.at(made)
        self.once.append(f"{y} = {_start(name, x)}")
        slope = SLOPES[name].format(x=x, y=y)
        self.once += [f"{self.at(made, j)} = {slope} * {self.at(a, j)}" for j in a.by]
        return made

    def chained(
        self, name: str, a: Quantity, made: Quantity, slope: Quantity, sign: str = ""
    ) -> None:
        """Write the coefficients of f(a), whose derivative f'(a) is a series of its own."""
        if a.degree == LINEAR:
            before = f"w[STRIDE * (k - 1) + {slope.place}]"
            later = f"{self.rate(a)} * {before} / k"
        else:
            lines = ["s0 += i * (p[0] * q[0])"]
            self.helper("chained", lines, ["s0"], ["s0"])
            later = f"chained(w, {a.place}, {slope.place}, k)[0] / k"
        self.each_order += [
            "if k == 0:",
            f"    {self.at(made)} = {_start(name, self.at(a))}",
            "else:",
            f"    {self.at(made)} = {sign}{later}",
        ]

    def differentiate(self, a: Quantity, made: Quantity, slope: Quantity, sign: str = "") -> None:
        """Write the derivatives of f(a) by the directions: f'(a) times those of a."""
        by = sorted(a.by)
        if not by:
            return
        if a.degree == LINEAR:
            for j in by:
                now = f"{self.at(a, j)} * {self.at(slope)}"
                self.each_order.append(f"{self.at(made, j)} = {sign}({now})")
            self.each_order += ["if k > 0:", f"    x = w[STRIDE * (k - 1) + {slope.place}]"]
            how = "-=" if sign else "+="
            for j in by:
                self.each_order.append(f"    {self.at(made, j)} {how} {self.rate(a, j)} * x")
            return
        name = f"slopes_of_{_letters(a.by)}"
        lines = ["x = q[0]", *(f"s{j} += p[{j}] * x" for j in by)]
        sums = [f"s{j}" for j in by]
        self.helper(name, lines, sums, sums)
        found = [f"d{j}" for j in by]
        self.each_order.append(f"{', '.join(found)}, = {name}(w, {a.place}, {slope.place}, k)")
        for j, one in zip(by, found, strict=True):
            self.each_order.append(f"{self.at(made, j)} = {sign}{one}")

    def power(self, a: Quantity, b: Quantity, exponent: float | None) -> Quantity:
        """A power; `exponent` is its number if it has one."""
        if exponent is not None and exponent == int(exponent) and abs(exponent) <= 64:
            return self.whole_power(a, int(exponent))
        if exponent is not None and 2.0 * exponent == int(2.0 * exponent) and abs(exponent) <= 64:
            root = self.function("sqrt", a)
            return self.product(root, self.whole_power(a, int(exponent - 0.5)))
        return self.function("exp", self.product(b, self.function("log", a)))

    def whole_power(self, a: Quantity, n: int) -> Quantity:
        if n < 0:
            return self.function("recip", self.whole_power(a, -n))
        if n == 0:
            return self.number("1.0")
        if n == 1:
            return a
        half = self.whole_power(a, n // 2)
        square = self.product(half, half)
        return self.product(a, square) if n % 2 else square

    # Expressions.

    def expression(self, node: ast.expr) -> Quantity:
        """Write an expression; returns what it is."""
        match node:
            case ast.Constant(value=int() | float() as number):
                return self.number(repr(float(number)))
            case ast.Name(id="pi"):
                return self.number(repr(math.pi))
            case ast.Name(id=name) if name in self.variables:
                return self.variables[name]
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return self.product(self.number("-1.0"), self.expression(operand))
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.expression(operand)
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                return self.raised(left, right)
            case ast.BinOp(left=left, op=operation, right=right):
                return self.operation(operation, self.expression(left), self.expression(right))
            case ast.Call(func=ast.Name(id="ratio"), args=[above, below]):
                return self.number(repr(float(_number(above) / _number(below))))
            case ast.Call(func=ast.Name(id="power"), args=[left, right]):
                return self.raised(left, right)
            case ast.Call(func=ast.Name(id="square"), args=[argument]):
                return self.whole_power(self.expression(argument), 2)
            case ast.Call(func=ast.Name(id="cube"), args=[argument]):
                return self.whole_power(self.expression(argument), 3)
            case ast.Call(func=ast.Name(id=name), args=[argument]) if name in FUNCTIONS:
                return self.function(name, self.expression(argument))
        raise NotImplementedError(f"{ast.unparse(node)} in a field")

    def raised(self, left: ast.expr, right: ast.expr) -> Quantity:
        try:
            exponent = _number(right)
        except NotImplementedError:
            exponent = None
        return self.power(self.expression(left), self.expression(right), exponent)

    def operation(self, operation: ast.operator, a: Quantity, b: Quantity) -> Quantity:
        match operation:
            case ast.Add():
                return self.sum(a, b)
            case ast.Sub():
                return self.sum(a, b, "-")
            case ast.Mult():
                return self.product(a, b)
            case ast.Div():
                return self.product(a, self.function("recip", b))
        raise NotImplementedError(f"{type(operation).__name__} in a field")

    # The whole text.

    def forces(self) -> list[list[Quantity]]:
        """Write the accelerations; returns the terms of each."""
        return [self.terms(parse_expression(text)) for text in self.stated.accelerations]

    def terms(self, node: ast.expr) -> list[Quantity]:
        """Write what an expression is a sum of."""
        match node:
            case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right):
                return [*self.terms(left), *self.terms(right)]
        return [self.expression(node)]

    def push(self) -> None:
        """Write the next coefficients of mean velocities and velocities."""
        length, state = self.variables["dt"], (self.means, self.speeds)
        for mean, speed, text in zip(*state, self.stated.accelerations, strict=True):
            force = self.general(self.expression(parse_expression(text)))
            for j in range(self.width):
                self.each_order.append(f"n[{int(mean.place) + j}] = {self.at(speed, j)} / (k + 1)")
                text = f"{self.at(length)} * {self.coefficient(force, j)}"
                text += f" + {self.at(force)}" if j in length.by else ""
                self.each_order.append(f"n[{int(speed.place) + j}] = ({text}) / (k + 1)")

    def flight(self, name: str) -> str:
        """Return the text of a function that returns what `integration.flown` does."""
        self.push()
        sums = self.state
        wanted = [
            sums[int(x.place) + j]
            for j in range(self.width)
            for quantities in (self.means, self.speeds)
            for x in quantities
        ]
        found, none = (f"return ({', '.join(one)})" for one in (wanted, ["nan"] * len(sums)))
        return self.loop(name, "w", [], found, none)

    def path(self, name: str) -> str:
        """Return the text of a function that fills in the pieces of a flight."""
        self.push()
        for i, terms in enumerate(self.forces()):
            size = " + ".join(f"abs({self.at(term)})" for term in terms)
            self.each_order += ["if k == 0:", f"    way.forces[{i}] = {size}"]
        each = (
            f"made = follow_step({self.freedom}, STRIDE, w, g0, at, h, weights, count, made, way)"
        )
        lines = [each, "if made < 0:", "    return -1"]
        self.once += ["made = 0", "begin_path(count, way)"]
        return self.loop(name, "w, weights, count, way", lines, "return made", "return -1")

    @property
    def state(self) -> list[str]:
        """The names of the numbers of the state at the end of a step."""
        return [f"s{i}" for i in range(2 * self.freedom * self.width)]

    def loop(self, name: str, more: str, each: list[str], arrived: str, failed: str) -> str:
        """The text of a function that takes steps, with lines for each of them, and for when the
        flight has arrived, or does not."""
        sums, state = self.state, range(len(self.state))
        begun = [f"w[{i}] = 0.0" for i in state]
        for i in range(self.freedom):
            at = int(self.speeds[i].place)
            begun.append(f"w[{at}] = {self.given[f'v{i}']}")
            begun += [f"w[{at + j}] = 1.0" for j in self.unit(f"v{i}")]
        sizes = [f"max({', '.join(f'abs({row}[{i}])' for i in state)})" for row in "rpq"]
        lines = [
            f"def {name}({', '.join(self.given.values())}, {more}):",
            *_indented(1, self.once + begun),
            "    at, lost = 0.0, 0.0",
            "    for _ in range(MOST_STEPS):",
            *_indented(2, self.each_step),
            "        for k in range(ORDER):",
            "            r, n = w[STRIDE * k:], w[STRIDE * (k + 1):]",
            *_indented(3, self.each_order),
            "        r, p, q = w[:STRIDE], w[STRIDE * ORDER:], w[STRIDE * (ORDER - 1):]",
            "        left = (1.0 - at) - lost",
            f"        h = step_length({', '.join(sizes)}, left)",
            *_indented(2, [f"{s} = p[{i}]" for i, s in enumerate(sums)]),
            "        for k in range(ORDER - 1, -1, -1):",
            "            r = w[STRIDE * k:]",
            *_indented(3, [f"{s} = {s} * h + r[{i}]" for i, s in enumerate(sums)]),
            f"        total = {' + '.join(sums)}",
            "        if not total - total == 0.0:",
            f"            {failed}",
            *_indented(2, each),
            "        if h >= left:",
            f"            {arrived}",
            *_indented(2, [f"w[{i}] = {s}" for i, s in enumerate(sums)]),
            "        h += lost",
            "        after = at + h",
            "        lost, at = h - (after - at), after",
            f"    {failed}",
        ]
        return "\n".join(lines) + "\n"


PAIRS = {
    "sin": ("cos", "", "-"),
    "cos": ("sin", "-", ""),
    "sinh": ("cosh", "", ""),
    "cosh": ("sinh", "", ""),
}
"""Functions whose derivatives are each other: the partner, and the signs of both derivatives."""

SLOPES = {
    "sin": "math.cos({x})",
    "cos": "-math.sin({x})",
    "tan": "(1.0 + {y} * {y})",
    "asin": "1.0 / math.sqrt(1.0 - {x} * {x})",
    "acos": "-1.0 / math.sqrt(1.0 - {x} * {x})",
    "atan": "1.0 / (1.0 + {x} * {x})",
    "sinh": "math.cosh({x})",
    "cosh": "math.sinh({x})",
    "tanh": "(1.0 - {y} * {y})",
    "exp": "{y}",
    "log": "1.0 / {x}",
    "sqrt": "0.5 / {y}",
    "recip": "-{y} * {y}",
}
"""Derivatives y' of the functions y of constants x."""


def _start(name: str, x: str) -> str:
    """The text of a function's value."""
    return f"1.0 / {x}" if name == "recip" else f"math.{name}({x})"


def _letters(by: frozenset[int]) -> str:
    return "_".join(map(str, sorted(by))) or "none"


def _indented(depth: int, lines: Sequence[str]) -> list[str]:
    return [" " * 4 * depth + line for line in lines]


def _number(node: ast.expr) -> float:
    """A number that an expression states without names."""
    match node:
        case ast.Constant(value=int() | float() as number):
            return number
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return -_number(operand)
        case ast.BinOp(left=left, op=ast.Div(), right=right):
            return _number(left) / _number(right)
        case ast.Call(func=ast.Name(id="ratio"), args=[above, below]):
            return _number(above) / _number(below)
    raise NotImplementedError(f"{ast.unparse(node)} is no number")
