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
from .integration import may_hide, statement


class Quantity(NamedTuple):
    """A series: what it changes with, the directions it depends on, and where it is found."""

    degree: int
    """0 of a constant, 1 of what is linear in the time, 2 of all others."""
    by: frozenset[int]
    """Places in its row of the derivatives that it has."""
    place: str
    """Where its row begins; of others the number that names them."""


CONSTANT, LINEAR, GENERAL = range(3)

NOTHING: frozenset[int] = frozenset()


ALONG = "*"
"""The direction of second derivatives."""


class Writer:
    """Writes the text of a flight.

    Constants are numbers ``c7_0``, with derivatives ``c7_2`` at their places in a row. What is
    linear in the time has them at the start of each step, ``c7_0``, and as rates, ``r7_0``. For
    derivatives `along` a direction of all that a flight depends on, each row has those of the
    quantity and of its derivatives behind these.

    Derivatives by the duration are not integrated: where v' = D f, that of the velocity is s f.
    Nor are those by what no acceleration mentions, which are zero.
    """

    def __init__(self, field: str, asked: tuple[str, ...], along: bool = False) -> None:
        self.field, self.stated, self.asked = field, statement(field), asked
        self.hides = may_hide(field)
        self.freedom = d = self.stated.freedom
        trees = map(parse_expression, self.stated.accelerations)
        matter = {
            node.id for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Name)
        }
        matter |= {f"v{i}" for i in range(d)}
        self.directions = directions = tuple(name for name in asked if name in matter)
        singles = [frozenset[str](), *(frozenset({name}) for name in directions)]
        self.parts = singles + [part | {ALONG} for part in singles] if along else singles
        self.along = frozenset({len(singles)}) if along else NOTHING
        self.width = len(self.parts)
        self.once: list[str] = []
        """Lines for a flight, a step, and an order of the series."""
        self.each_step: list[str] = []
        self.each_order: list[str] = []
        self.known: dict[tuple[object, ...], Quantity] = {}
        self.count = 0
        self.stride = 0
        """Numbers of a vector: those of the state, and of all other rows."""
        self.helpers: dict[str, str] = {}
        every = frozenset(range(1, self.width))
        rows = [self.new_row(every) for _ in range(2 * d)]
        self.means, self.speeds = rows[:d], rows[d:]
        sides = (0, *self.along) if "dt" in asked else ()
        self.by_duration = {
            (i, j): self.stride + 2 * d * n + i for n, j in enumerate(sides) for i in range(2 * d)
        }
        """Places of the derivatives of the state by the duration."""
        self.stride += len(self.by_duration)
        self.state = [f"s{i}" for i in range(self.stride)]
        """Names of the numbers of the state at the end of a step."""
        names = self.stated.names
        self.given = {name: f"g{i}" for i, name in enumerate(names)}
        self.variables = {name: self.number(self.given[name], name) for name in names}
        self.start = dict(self.variables)
        self.variables["t"] = self.time()
        for i in range(d):
            self.variables[f"x{i}"] = self.position(i)
            self.variables[f"v{i}"] = self.speeds[i]

    # Names and places.

    def new(self) -> str:
        self.count += 1
        return str(self.count)

    def new_row(self, by: frozenset[int]) -> Quantity:
        self.stride += self.width
        return Quantity(GENERAL, by, str(self.stride - self.width))

    def new_quantity(self, degree: int, by: frozenset[int]) -> Quantity:
        return self.new_row(by) if degree == GENERAL else Quantity(degree, by, self.new())

    def lines_of(self, a: Quantity) -> list[str]:
        """Where a quantity is computed."""
        return (self.once, self.each_step, self.each_order)[a.degree]

    def at(self, a: Quantity, j: int = 0) -> str:
        """Its coefficient of the order under way, or a derivative of that."""
        if j != 0 and j not in a.by:
            return "0.0"
        return f"c{a.place}_{j}" if a.degree < GENERAL else f"r[{int(a.place) + j}]"

    def rate(self, a: Quantity, j: int = 0) -> str:
        """The rate of what is linear in the time."""
        return f"r{a.place}_{j}" if j in a.by or j == 0 else "0.0"

    def splits(self, a: Quantity, b: Quantity, j: int) -> list[tuple[int, int]]:
        """The places of the factors in the derivative of a product."""
        return [
            (k, other)
            for k in (0, *sorted(a.by))
            if self.parts[k] <= self.parts[j]
            if (other := self.parts.index(self.parts[j] - self.parts[k])) in b.by or other == 0
        ]

    # What a flight is given.

    def number(self, text: str, name: str = "") -> Quantity:
        """A constant that is given, or known."""
        key = "number", text
        if key not in self.known:
            own = {self.directions.index(name) + 1} if name in self.directions else set[int]()
            by = frozenset(own) | (self.along if name else NOTHING)
            made = self.known[key] = Quantity(CONSTANT, by, self.new())
            self.once.append(f"{self.at(made)} = {text}")
            self.once += [f"{self.at(made, j)} = 1.0" for j in own]
            self.once += [f"{self.at(made, j)} = {text.replace('g', 'e')}" for j in by - own]
        return self.known[key]

    def time(self) -> Quantity:
        """The time, linear in the part of the flight."""
        length, begun = self.start["dt"], self.start["t"]
        made = Quantity(LINEAR, length.by | begun.by, self.new())
        for j in (0, *made.by):
            self.once.append(f"{self.rate(made, j)} = {self.at(length, j)}")
            text = f"{self.at(begun, j)} + at * {self.at(length, j)}"
            self.each_step.append(f"{self.at(made, j)} = {text}")
        return made

    def position(self, i: int) -> Quantity:
        """A position, from the mean velocity."""
        mean, length, begun = self.means[i], self.start["dt"], self.start[f"x{i}"]
        made = self.new_row(mean.by)
        for j in range(self.width):
            self.each_order.append(f"{self.at(made, j)} = {self.scaled(length, mean, j, self.at)}")
        self.each_order.append("if k == 0:")
        for j in (0, *begun.by):
            self.each_order.append(f"    {self.at(made, j)} += {self.at(begun, j)}")
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
                text = f"{self.at(a, j)} {sign} {self.at(b, j)}"
            else:
                text = f"{minus if both[0] is b else ''}{self.at(both[0], j)}"
            self.each_order.append(f"{self.at(made, j)} = {text}")
        if len(both) == 1:
            rest = a if both[0] is b else b
            how = f"{minus}=" if minus and rest is b else "+="
            self.each_order.append("if k == 0:")
            for j in (0, *rest.by):
                self.each_order.append(f"    {self.at(made, j)} {how} {self.at(rest, j)}")
        return made

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
        by = frozenset(j for j in range(1, self.width) if self.splits(a, b, j))
        if a.degree == CONSTANT:
            made = self.new_quantity(b.degree, by)
            for j in (0, *by):
                text = self.scaled(a, b, j, self.at)
                self.lines_of(made).append(f"{self.at(made, j)} = {text}")
                if b.degree == LINEAR:
                    text = self.scaled(a, b, j, self.rate)
                    self.once.append(f"{self.rate(made, j)} = {text}")
            return made
        a, b = self.general(a), self.general(b)
        made = self.new_row(by)
        found = ", ".join(self.at(made, j) for j in (0, *sorted(by)))
        self.each_order.append(f"{found}, = {self.convolution(a, b)}")
        return made

    def scaled(self, a: Quantity, b: Quantity, j: int, part: Callable[[Quantity, int], str]) -> str:
        """The product of a constant and a part of a quantity, or its derivative."""
        pairs = self.splits(a, b, j)
        return " + ".join(f"{self.at(a, k)} * {part(b, other)}" for k, other in pairs)

    def convolution(self, a: Quantity, b: Quantity) -> str:
        """The call of a function that returns the coefficients of a product."""
        square = a == b
        by = [j for j in range(1, self.width) if self.splits(a, b, j)]
        name = f"product_{_letters(a.by)}_by_{_letters(b.by)}{'_squared' if square else ''}"
        lines = ["s0 += p[0] * q[0]"]
        for j in by:
            pairs = [(k, i) for k, i in self.splits(a, b, j) if k > i or not square]
            lines.append(f"s{j} += {' + '.join(f'p[{k}] * q[{i}]' for k, i in pairs)}")
        twice = "2.0 * " if square else ""
        sums = ["s0", *(f"{twice}s{j}" for j in by)]
        self.helper(name, lines, ["s0", *(f"s{j}" for j in by)], sums)
        return f"{name}(w, {a.place}, {b.place}, k)"

    def helper(
        self,
        name: str,
        lines: Sequence[str],
        sums: Sequence[str],
        result: Sequence[str],
        first: int = 0,
    ) -> None:
        """Add a function that sums over orders, from the first, of two series with rows p and q."""
        if name in self.helpers:
            return
        text = f"def {name}(w, a, b, k):\n"
        text += "".join(f"    {one} = 0.0\n" for one in sums)
        text += f"    for i in range({first}, k + 1):\n"
        text += "        p, q = tail(w, STRIDE * i + a), tail(w, STRIDE * (k - i) + b)\n"
        text += "".join(f"        {line}\n" for line in lines)
        text += f"    return ({', '.join(result)},)\n"
        self.helpers[name] = text

    # Elementary functions.

    def function(self, name: str, a: Quantity) -> Quantity:
        for more in (a.by, a.by | self.along, frozenset(range(1, self.width))):
            found = self.known.get((name, a._replace(by=more)))
            if found is not None:
                return found if more == a.by else _with(found, a.by)
        made = self.known[name, a] = self._function(name, a)
        return made

    def _function(self, name: str, a: Quantity) -> Quantity:
        degree = GENERAL if a.degree > CONSTANT else CONSTANT
        by = frozenset(j for j in range(1, self.width) if self.splits(a, a, j))
        made, plain = self.new_quantity(degree, by), self.along & by
        if name in PAIRS:
            partner, sign, other_sign = PAIRS[name]
            other = self.known[partner, a] = self.new_quantity(degree, by)
            both = (name, made, other, sign), (partner, other, made, other_sign)
            for function, y, slope, negative in both:
                self.lines_of(y).extend(self.value(function, a, y, slope, negative))
            for some in (plain, by - plain):
                for _, y, slope, negative in both:
                    self.differentiate(a, y, slope, some, negative)
            return made
        lines = self.lines_of(made)
        place, slope = len(lines), a
        if degree == GENERAL or by:
            slope = self.slope(name, _with(a, NOTHING), _with(made, NOTHING))
        lines[place:place] = self.value(name, a, made, slope)
        self.differentiate(a, made, slope, plain)
        if by - plain:
            slope = self.slope(name, _with(a, plain), _with(made, plain))
            self.differentiate(a, made, slope, by - plain)
        return made

    def slope(self, name: str, a: Quantity, y: Quantity) -> Quantity:
        """The derivative of a function, from its argument and its value."""
        one = self.number("1.0")
        match name:
            case "exp":
                return y
            case "tan" | "tanh":
                return self.sum(one, self.product(y, y), "+" if name == "tan" else "-")
            case "recip":
                return self.product(self.number("-1.0"), self.product(y, y))
            case "sqrt":
                return self.product(self.number("0.5"), self.function("recip", y))
            case "log":
                return self.function("recip", a)
        square = self.product(a, a)
        if name == "atan":
            return self.function("recip", self.sum(one, square))
        root = self.function("recip", self.function("sqrt", self.sum(one, square, "-")))
        return root if name == "asin" else self.product(self.number("-1.0"), root)

    def value(
        self, name: str, a: Quantity, y: Quantity, slope: Quantity, sign: str = ""
    ) -> list[str]:
        """Lines for the coefficients of y = f(a), from those of lower order of f'(a)."""
        start = f"1.0 / {self.at(a)}" if name == "recip" else f"math.{name}({self.at(a)})"
        if a.degree == CONSTANT:
            return [f"{self.at(y)} = {start}"]
        slope = self.general(slope)
        if a.degree == LINEAR:
            later = f"{self.rate(a)} * w[STRIDE * (k - 1) + {slope.place}] / k"
        else:
            self.helper("chained", ["s0 += i * (p[0] * q[0])"], ["s0"], ["s0"], first=1)
            later = f"chained(w, {a.place}, {slope.place}, k)[0] / k"
        either = "if k == 0:", f"    {self.at(y)} = {start}", "else:"
        return [*either, f"    {self.at(y)} = {sign}{later}"]

    def differentiate(
        self, a: Quantity, y: Quantity, slope: Quantity, by: frozenset[int], sign: str = ""
    ) -> None:
        """Write some derivatives of y = f(a): those of a times f'(a), whose own derivative is
        that along the direction of second ones."""
        if not by:
            return
        pairs = {
            j: [(k, i) for k, i in self.splits(slope, a, j) if k in (0, *self.along) and i != 0]
            for j in sorted(by)
        }
        lines = self.lines_of(y)
        if a.degree < GENERAL:
            for j, terms in pairs.items():
                text = " + ".join(f"{self.at(slope, k)} * {self.at(a, i)}" for k, i in terms)
                lines.append(f"{self.at(y, j)} = {sign}({text})")
            if a.degree == LINEAR:
                how = "-=" if sign else "+="
                lines += ["if k > 0:", f"    q = tail(w, STRIDE * (k - 1) + {slope.place})"]
                for j, terms in pairs.items():
                    text = " + ".join(f"q[{k}] * {self.rate(a, i)}" for k, i in terms)
                    lines.append(f"    {self.at(y, j)} {how} {text}")
            return
        name = f"slopes_{_letters(by)}"
        each = [
            f"s{j} += {' + '.join(f'p[{i}] * q[{k}]' for k, i in terms)}"
            for j, terms in pairs.items()
        ]
        sums = [f"s{j}" for j in pairs]
        self.helper(name, each, sums, sums)
        found = ", ".join(f"d{j}" for j in pairs)
        lines.append(f"{found}, = {name}(w, {a.place}, {slope.place}, k)")
        lines += [f"{self.at(y, j)} = {sign}d{j}" for j in pairs]

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
        length = self.start["dt"]
        for i, text in enumerate(self.stated.accelerations):
            mean, speed = self.means[i], self.speeds[i]
            force = self.general(self.expression(parse_expression(text)))
            for j in range(self.width):
                self.each_order.append(f"n[{int(mean.place) + j}] = {self.at(speed, j)} / (k + 1)")
                text = self.scaled(length, force, j, self.at) or "0.0"
                self.each_order.append(f"n[{int(speed.place) + j}] = ({text}) / (k + 1)")
            for j in (j for k, j in self.by_duration if k == i):
                u, v = self.by_duration[i, j], self.by_duration[self.freedom + i, j]
                pushed = self.at(force, j)
                self.each_order += [
                    f"r[{v}] = (r[{v}] if k > 0 else 0.0) + at * {pushed}",
                    f"n[{v}] = {pushed}",
                    f"n[{u}] = r[{v}] / (k + 1)",
                ]

    def flight(self, name: str) -> str:
        """Return the text of a function that returns what `integration.flown` does; where there
        are second derivatives, the same of these behind it."""
        self.push()
        wanted = [
            self.found(i, name, side)
            for side in (0, *self.along)
            for name in ("", *self.asked)
            for i in range(2 * self.freedom)
        ]
        found, none = (f"return ({', '.join(one)})" for one in (wanted, ["nan"] * len(wanted)))
        slopes = [given.replace("g", "e") for given in self.given.values()] if self.along else []
        return self.loop(name, ", ".join([*slopes, "w"]), [], found, none)

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

    def force(self) -> str:
        """Return the text of a function that returns the accelerations at a time and a state."""
        d = range(self.freedom)
        names = "t", *(f"x{i}" for i in d), *(f"v{i}" for i in d), *self.stated.parameters
        found = ", ".join(self.stated.accelerations)
        return f"def force({', '.join(names)}):\n    return ({found},)\n"

    def misses(self) -> str:
        """Return the text of a function that returns whether a step from `at` over h misses a part
        of the force; see `integration.Integrator`."""
        d, dt, t = range(self.freedom), self.given["dt"], self.given["t"]
        means, speeds = ([int(row.place) for row in rows] for rows in (self.means, self.speeds))
        parameters = [self.given[name] for name in self.stated.parameters]

        def force(more: str, less: str, moved: str) -> str:
            time = f"{t}{moved} + (at + s) * {dt}{more}"
            x = [f"{self.given[f'x{i}']}{moved} + u{i} * {dt}{more}" for i in d]
            v = [f"v{i}{less}" for i in d]
            return f"force({', '.join([time, *x, *v, *parameters])})"

        one, other = force(" * MORE", " * LESS", ""), force("", "", " * MORE")
        largest = ", ".join(f"abs(u{i}), abs(v{i}), abs(h * a{i})" for i in d)
        off = [f"abs(h * (a{i} - {dt} * f[{i}]))" for i in d]
        noise = [f"abs(h * {dt}) * (abs(p[{i}] - f[{i}]) + abs(q[{i}] - f[{i}]))" for i in d]
        far = [f"{a} <= CLOSE * largest + NOISE * ({b})" for a, b in zip(off, noise, strict=True)]
        lines = [
            f"def misses({', '.join(self.given.values())}, at, h, size, w):",
            "    for look in range(1, LOOKS + 1):",
            "        s = h * (look / LOOKS)",
            *_indented(2, [f"u{i} = v{i} = a{i} = 0.0" for i in d]),
            "        for k in range(ORDER, -1, -1):",
            "            r = tail(w, STRIDE * k)",
            *_indented(3, [f"a{i} = a{i} * s + v{i}" for i in d]),
            *_indented(3, [f"v{i} = v{i} * s + r[{speeds[i]}]" for i in d]),
            *_indented(3, [f"u{i} = u{i} * s + r[{means[i]}]" for i in d]),
            f"        f, largest = {force('', '', '')}, max(size, {largest})",
            f"        if not ({' and '.join(f'{a} <= CLOSE * largest' for a in off)}):",
            f"            p, q = {one}, {other}",
            f"            if not ({' and '.join(far)}):",
            "                return True",
            "    return False",
        ]
        return "\n".join(lines) + "\n"

    def found(self, i: int, name: str, side: int) -> str:
        """A number of the state at the end of a step, or its derivative by a direction, and that
        along the direction of second derivatives."""
        if name == "dt":
            return self.state[self.by_duration[i, side]]
        if name and name not in self.directions:
            return "0.0"
        j = self.directions.index(name) + 1 if name else 0
        return self.state[self.width * i + j + side]

    def loop(self, name: str, more: str, each: list[str], arrived: str, failed: str) -> str:
        """The text of a function that takes steps, with lines for each of them, and for when the
        flight has arrived, or does not."""
        sums, state = self.state, range(len(self.state))
        begun = [f"w[{i}] = 0.0" for i in state]
        for i in range(self.freedom):
            speed, at = self.start[f"v{i}"], int(self.speeds[i].place)
            begun += [f"w[{at + j}] = {self.at(speed, j)}" for j in (0, *speed.by)]
        sizes = [f"max({', '.join(f'abs({row}[{i}])' for i in state)})" for row in "rpq"]
        given = ", ".join(self.given.values())
        watch = [f"while h >= SHORTEST_STEP and misses({given}, at, h, size, w):", "    h *= 0.5"]
        watch += ["if h < SHORTEST_STEP and h < left:", f"    {failed}"]
        lines = [
            f"def {name}({given}, {more}):",
            *_indented(1, self.once + begun),
            "    at, lost = 0.0, 0.0",
            "    for _ in range(MOST_STEPS):",
            *_indented(2, self.each_step),
            "        for k in range(ORDER):",
            "            r, n = tail(w, STRIDE * k), tail(w, STRIDE * (k + 1))",
            *_indented(3, self.each_order),
            "        r, p, q = w[:STRIDE], tail(w, STRIDE * ORDER), tail(w, STRIDE * (ORDER - 1))",
            "        left = (1.0 - at) - lost",
            f"        size = {sizes[0]}",
            f"        h = step_length(ORDER, size, {', '.join(sizes[1:])}, left)",
            *_indented(2, watch if self.hides else []),
            *_indented(2, [f"{s} = p[{i}]" for i, s in enumerate(sums)]),
            "        for k in range(ORDER - 1, -1, -1):",
            "            r = tail(w, STRIDE * k)",
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


def _with(a: Quantity, by: frozenset[int]) -> Quantity:
    """The same with some of its derivatives alone."""
    return a._replace(by=a.by & by)


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
