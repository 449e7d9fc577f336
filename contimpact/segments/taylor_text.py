"""The text of an integrated flight by Taylor's method, in the plain subset of Python.

A quantity is a truncated series in the time s. The coefficients of one order of all quantities
stand side by side in a vector, one order after the other. Sums, products, quotients and roots are
those of series. Another elementary function y = f(a) follows from y' = f'(a) a', by the series of
f'(a), which y itself, its companion (of sin, cos) or a product leads to. Quantities that do not
change along a flight, or change linearly with the time, have no series.

Derivatives are quantities like others. Those of the state by the directions solve the variational
equations: the derivatives of the forces by the state multiply them, all directions side by side.
"""

from __future__ import annotations

import ast
import functools
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

from ..models.expressions import FUNCTIONS
from ..syntax import parse_expression
from .integration import may_hide, statement


class Quantity(NamedTuple):
    """A series: what it changes with, and where it is found."""

    degree: int
    """0 of a constant, 1 of what is linear in the time, 2 of all others."""
    place: str
    """Where its coefficient is; of others the number that names them."""


CONSTANT, LINEAR, GENERAL = range(3)

ALONG = "*"
"""The direction of second derivatives."""

SUMS_AT_ONCE = 16
"""Sums that a loop over orders makes, about as many as there are registers for numbers."""


class Writer:
    """Writes the text of a flight.

    Constants are numbers ``c7``. What is linear in the time has the number ``c7`` at the start of
    each step, and the rate ``r7``. For so many derivatives `along` a direction of all that a flight
    depends on, those of the state are integrated, too, and the first of its derivatives by the
    directions.

    Derivatives by the duration are not integrated: where v' = D f, that of the velocity is s f.
    Nor are those by what no acceleration mentions, which are zero.
    """

    def __init__(self, field: str, asked: tuple[str, ...], along: int = 0) -> None:
        self.field, self.stated, self.asked = field, statement(field), asked
        self.hides = may_hide(field)
        self.further = int(any(self.stated.rates))
        """Orders beyond the last one, to which means of velocities by rates go."""
        d = self.freedom = self.stated.freedom
        laws = *self.stated.accelerations, *filter(None, self.stated.rates)
        trees = map(parse_expression, laws)
        matter = {
            node.id for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Name)
        }
        matter |= {f"v{i}" for i in range(d)}
        self.directions = tuple(name for name in asked if name in matter)
        self.sides = [ALONG * order for order in range(along + 1)]
        self.once: list[str] = []
        """Lines for a flight, a step, and an order of the series."""
        self.each_step: list[str] = []
        self.each_order: list[str] = []
        self.known: dict[tuple[object, ...], Quantity] = {}
        self.origins: dict[Quantity, tuple[object, ...]] = {}
        """What quantities are made of."""
        self.derived: dict[tuple[Quantity, str], Quantity | None] = {}
        self.count = 0
        self.stride = 0
        """Numbers of a vector: those of the state, and of all other rows."""
        self.helpers: dict[str, str] = {}
        self.sums: list[str] = []
        """Terms of the sums over orders, of two orders that add up to that under way."""
        self.rows = {
            side: [self.new_quantity(GENERAL) for _ in range(2 * d)] for side in self.sides
        }
        """The state, mean velocities and velocities, and what it changes by."""
        self.by_duration = self.new_places(1) if "dt" in asked else {}
        self.varied = self.new_places(len(self.directions))
        """Places of its derivatives by the duration, and by the first direction."""
        self.state = [f"s{i}" for i in range(self.stride)]
        """Names of the numbers of the state at the end of a step."""
        names = self.stated.names
        self.given = {name: f"g{i}" for i, name in enumerate(names)}
        letters = ["g", *("e" * order for order in range(1, along + 1))]
        self.letters = letters
        numbers = [[self.number(n.replace("g", e)) for n in self.given.values()] for e in letters]
        self.start = dict(zip(names, numbers[0], strict=True))
        times = [self.time(letter) for letter in letters]
        self.variables = self.start | {"t": times[0]}
        for i in range(d):
            path = self.product(self.start["dt"], self.rows[""][i])
            self.variables[f"x{i}"] = self.sum(path, self.start[f"x{i}"])
            self.variables[f"v{i}"] = self.rows[""][d + i]
        one = self.number("1.0")
        self.seeds = {name: {number: one} for name, number in self.start.items()}
        """Derivatives of what is made of no other quantities."""
        self.seeds["t"] = {self.variables["t"]: one}
        self.seeds |= {f"x{i}": {self.variables[f"x{i}"]: one} for i in range(d)}
        self.seeds |= {row.place: {row: one} for row in self.rows[""]}
        orders = [
            [*n, *row, t] for n, row, t in zip(numbers, self.rows.values(), times, strict=True)
        ]
        self.seeds[ALONG] = {
            one: other
            for pair in itertools.pairwise(orders)
            for one, other in zip(*pair, strict=True)
        }

    # Names and places.

    def new_quantity(self, degree: int) -> Quantity:
        if degree == GENERAL:
            self.stride += 1
            return Quantity(GENERAL, str(self.stride - 1))
        self.count += 1
        return Quantity(degree, str(self.count))

    def new_places(self, width: int) -> dict[tuple[str, int], int]:
        """Places for what belongs to each number of the state, and for what it changes by."""
        keys = [(side, i) for side in self.sides for i in range(2 * self.freedom)]
        found = {key: self.stride + width * n for n, key in enumerate(keys)}
        self.stride += width * len(keys)
        return found

    def lines_of(self, a: Quantity) -> list[str]:
        """Where a quantity is computed."""
        return (self.once, self.each_step, self.each_order)[a.degree]

    def at(self, a: Quantity) -> str:
        """Its coefficient of the order under way; at the start of a step, if it has no others."""
        return f"r[{a.place}]" if a.degree == GENERAL else f"c{a.place}"

    def rate(self, a: Quantity) -> str:
        """The coefficient of the first order of what has no series."""
        return f"r{a.place}" if a.degree == LINEAR else "0.0"

    def coefficient(self, a: Quantity) -> str:
        """Its coefficient of the order under way, whatever it is."""
        if a.degree == GENERAL:
            return self.at(a)
        later = f"{self.rate(a)} if k == 1 else 0.0" if a.degree == LINEAR else "0.0"
        return f"({self.at(a)} if k == 0 else {later})"

    def combined(self, *key: object, make: Callable[[], Quantity]) -> Quantity:
        if key not in self.known:
            made = self.known[key] = make()
            self.origins.setdefault(made, key)
        return self.known[key]

    # What a flight is given.

    def number(self, text: str) -> Quantity:
        """A constant that is given, or known."""
        return self.combined("number", text, make=lambda: self._number(text))

    def _number(self, text: str) -> Quantity:
        made = self.new_quantity(CONSTANT)
        self.once.append(f"{self.at(made)} = {text}")
        return made

    def time(self, letter: str) -> Quantity:
        """The time, linear in the part of the flight, or how it changes."""
        length, begun = (self.given[name].replace("g", letter) for name in ("dt", "t"))
        made = self.new_quantity(LINEAR)
        self.once.append(f"{self.rate(made)} = {length}")
        self.each_step.append(f"{self.at(made)} = {begun} + at * {length}")
        return made

    # Sums, products and quotients.

    def sum(self, a: Quantity, b: Quantity, sign: str = "+") -> Quantity:
        return self.combined("sum", a, b, sign, make=lambda: self._sum(a, b, sign))

    def _sum(self, a: Quantity, b: Quantity, sign: str) -> Quantity:
        made = self.new_quantity(max(a.degree, b.degree))
        part = self.coefficient if made.degree == GENERAL else self.at
        self.lines_of(made).append(f"{self.at(made)} = {part(a)} {sign} {part(b)}")
        if made.degree == LINEAR:
            self.once.append(f"{self.rate(made)} = {self.rate(a)} {sign} {self.rate(b)}")
        return made

    def series(self, a: Quantity) -> Quantity:
        """The same with coefficients of all orders."""
        if a.degree == GENERAL:
            return a
        return self.combined("series", a, make=lambda: self._series(a))

    def _series(self, a: Quantity) -> Quantity:
        made = self.new_quantity(GENERAL)
        self.each_order.append(f"{self.at(made)} = {self.coefficient(a)}")
        return made

    def product(self, a: Quantity, b: Quantity) -> Quantity:
        """A product, whose constant factors come first."""
        if b.degree < a.degree:
            a, b = b, a
        if a == self.number("1.0"):
            return b
        for one, other in ((a, b), (b, a)):
            match self.origins.get(one):
                case ("product", Quantity(degree=0) as factor, Quantity() as rest) if one.degree:
                    if other.degree == CONSTANT:
                        return self.product(self.product(factor, other), rest)
                    return self.product(factor, self.product(rest, other))
        if ("product", b, a) in self.known:
            return self.known["product", b, a]
        return self.combined("product", a, b, make=lambda: self._product(a, b))

    def _product(self, a: Quantity, b: Quantity) -> Quantity:
        if a.degree == b.degree == LINEAR:
            b = self.series(b)
        made = self.new_quantity(max(a.degree, b.degree))
        if a.degree == GENERAL:
            text = self.summed("product", a, b)
        else:
            text = f"{self.at(a)} * {self.at(b)}"
        if a.degree == LINEAR:
            text += f" + ({self.rate(a)} * {self.before(b)} if k > 0 else 0.0)"
        self.lines_of(made).append(f"{self.at(made)} = {text}")
        if made.degree == LINEAR:
            self.once.append(f"{self.rate(made)} = {self.at(a)} * {self.rate(b)}")
        return made

    def before(self, a: Quantity) -> str:
        """Its coefficient of the order before that under way."""
        return f"w[STRIDE * (k - 1) + {a.place}]"

    def quotient(self, a: Quantity, b: Quantity) -> Quantity:
        return self.product(a, self.function("recip", b))

    def summed(self, name: str, a: Quantity, b: Quantity) -> str:
        """A sum over orders: of a product; the same without the zeroth order of the first series
        (rest); and that with the orders as factors (chained).

        Only the last terms are of the order under way. Those before are summed for all quantities
        at once, so that no sum waits for another; see `write_sums`."""
        factor = "{} * " * (name == "chained")
        self.sums.append(f"{factor.format('i')}(p[{a.place}] * q[{b.place}])")
        last = f"{factor.format('k')}(r[{a.place}] * w[{b.place}])"
        text = f"b{len(self.sums) - 1} + ({last} if k > 0 else 0.0)"
        return f"({text} + w[{a.place}] * r[{b.place}])" if name == "product" else f"({text})"

    def write_sums(self) -> None:
        """Write the sums over the orders before that under way, at the head of each order."""
        for first in range(0, len(self.sums), SUMS_AT_ONCE):
            terms = self.sums[first : first + SUMS_AT_ONCE]
            named = {f"b{first + n}": [term] for n, term in enumerate(terms)}
            call = self.convolution(f"sums_{first}", named, "1, k")
            self.each_order.insert(0, call)

    def convolution(self, name: str, sums: Mapping[str, Sequence[str]], orders: str) -> str:
        """Write a function that sums terms of two orders, p and q, that add up to that under way;
        returns the line that calls it."""
        self.helpers[name] = "\n".join(
            [
                f"def {name}(w, k):",
                *(f"    {s} = 0.0" for s in sums),
                f"    for i in range({orders}):",
                "        p, q = tail(w, STRIDE * i), tail(w, STRIDE * (k - i))",
                *(f"        {s} += {' + '.join(terms)}" for s, terms in sums.items()),
                f"    return ({', '.join(sums)},)\n",
            ]
        )
        return f"{', '.join(sums)}, = {name}(w, k)"

    # Elementary functions.

    def function(self, name: str, a: Quantity) -> Quantity:
        if (name, a) not in self.known:
            made = self.new_quantity(GENERAL if a.degree > CONSTANT else CONSTANT)
            self.known[name, a], self.origins[made] = made, (name, a)
            lines = self.lines_of(made)
            place = len(lines)
            lines[place:place] = self.value(name, a, made)
        return self.known[name, a]

    def value(self, name: str, a: Quantity, y: Quantity) -> list[str]:
        """Lines for the coefficient of y = f(a), from those of lower order of f'(a); what that
        takes is written for behind them."""
        first = f"1.0 / {self.at(a)}" if name == "recip" else f"math.{name}({self.at(a)})"
        if a.degree == CONSTANT:
            return [f"{self.at(y)} = {first}"]
        if name == "recip":
            start = f"w[{a.place}]" if a.degree == GENERAL else self.at(a)
            later = f"-{self.less_first('rest', a, y)} / {start}"
            return [f"{self.at(y)} = {first} if k == 0 else {later}"]
        if name == "sqrt":
            rest = f"{self.coefficient(a)} - {self.summed('rest', y, y)}"
            later = f"({rest}) / (2.0 * w[{y.place}])"
            return [f"{self.at(y)} = 0.0", f"{self.at(y)} = {first} if k == 0 else {later}"]
        later = self.less_first("chained", a, self.slope(name, a, y))
        return [f"{self.at(y)} = {first} if k == 0 else {later} / k"]

    def less_first(self, name: str, a: Quantity, b: Quantity) -> str:
        """A sum over orders without the zeroth of what may be linear in the time."""
        if a.degree == LINEAR:
            return f"{self.rate(a)} * {self.before(b)}"
        return self.summed(name, a, b)

    def slope(self, name: str, a: Quantity, y: Quantity) -> Quantity:
        """The derivative of a function, from its argument and its value."""
        one, less = self.number("1.0"), self.number("-1.0")
        match name:
            case "exp":
                return y
            case "sin" | "sinh" | "cosh":
                return self.function(PARTNERS[name], a)
            case "cos":
                return self.product(less, self.function("sin", a))
            case "tan" | "tanh":
                return self.sum(one, self.product(y, y), "+" if name == "tan" else "-")
            case "recip":
                return self.product(less, self.product(y, y))
            case "sqrt":
                return self.quotient(self.number("0.5"), y)
            case "log":
                return self.quotient(one, a)
        square = self.product(a, a)
        if name == "atan":
            return self.quotient(one, self.sum(one, square))
        root = self.function("sqrt", self.sum(one, square, "-"))
        return self.quotient(one if name == "asin" else less, root)

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

    # Derivatives.

    def derivative(self, a: Quantity, by: str) -> Quantity | None:
        """The derivative of a quantity by one of the `seeds`; None if it is zero."""
        if (a, by) not in self.derived:
            self.derived[a, by] = self.seeds[by].get(a) or self._derivative(a, by)
        return self.derived[a, by]

    def _derivative(self, a: Quantity, by: str) -> Quantity | None:
        match self.origins.get(a):
            case ("sum", Quantity() as x, Quantity() as y, str(sign)):
                return self.added(self.derivative(x, by), self.derivative(y, by), sign)
            case ("product", Quantity() as x, Quantity() as y):
                one, other = self.derivative(x, by), self.derivative(y, by)
                if x == y:
                    return self.times(self.product(self.number("2.0"), x), one)
                return self.added(self.times(y, one), self.times(x, other))
            case ("series", Quantity() as x):
                return self.derivative(x, by)
            case (str(name), Quantity() as x) if (change := self.derivative(x, by)) is not None:
                return self.product(self.slope(name, x, a), change)
        return None

    def times(self, a: Quantity, b: Quantity | None) -> Quantity | None:
        """A product of which one factor may be zero."""
        return None if b is None else self.product(a, b)

    def added(self, a: Quantity | None, b: Quantity | None, sign: str = "+") -> Quantity | None:
        """A sum whose parts may be zero."""
        if b is None:
            return a
        if a is None:
            return b if sign == "+" else self.product(self.number("-1.0"), b)
        return self.sum(a, b, sign)

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
                return self.quotient(a, b)
        raise NotImplementedError(f"{type(operation).__name__} in a field")

    # The whole text.

    def rate_of(self, i: int) -> Quantity | None:
        """Write the rate of a coordinate of first order; None of others."""
        rates = self.stated.rates
        return self.expression(parse_expression(rates[i])) if rates and rates[i] else None

    def force_parts(self, i: int, rate: Quantity) -> list[Quantity]:
        """Write what the acceleration of a coordinate of first order, the derivative of its rate,
        is the sum of."""
        parts = [self.derivative(rate, "t")]
        for m, speed in enumerate(self.rows[""][self.freedom :]):
            parts.append(self.times(speed, self.derivative(rate, f"x{m}")))
            if (slope := self.derivative(rate, speed.place)) is not None:
                parts.append(self.product(slope, self.acceleration(m)))
        return [part for part in parts if part is not None] or [self.number("0.0")]

    def acceleration(self, i: int) -> Quantity:
        """Write an acceleration."""
        if (rate := self.rate_of(i)) is not None:
            return functools.reduce(self.sum, self.force_parts(i, rate))
        return self.expression(parse_expression(self.stated.accelerations[i]))

    def forces(self) -> list[list[Quantity]]:
        """Write the accelerations; returns the terms of each."""
        rates = [self.rate_of(i) for i in range(self.freedom)]
        return [
            self.terms(parse_expression(text)) if rate is None else self.force_parts(i, rate)
            for i, (text, rate) in enumerate(zip(self.stated.accelerations, rates, strict=True))
        ]

    def terms(self, node: ast.expr) -> list[Quantity]:
        """Write what an expression is a sum of."""
        match node:
            case ast.BinOp(left=left, op=ast.Add() | ast.Sub(), right=right):
                return [*self.terms(left), *self.terms(right)]
        return [self.expression(node)]

    def push(self) -> None:
        """Write the next coefficients of the state and of its derivatives.

        Of a coordinate of first order, the series of the velocity is that of the rate but for where
        it starts, and so it is with derivatives."""
        d, places = self.freedom, range(len(self.directions))
        rates = [self.rate_of(i) for i in range(d)]
        for i, rate in enumerate(rates):
            if rate is not None:
                for side, row in self.rows.items():
                    self.follow_rate(int(row[d + i].place), self.on(side, rate))
        for i, rate in enumerate(rates):
            force = self.acceleration(i) if rate is None or self.by_duration else self.number("0.0")
            law = self.product(self.start["dt"], force) if rate is None else rate
            for side, row in self.rows.items():
                own, now = self.on(side, force), self.on(side, law)
                mean, speed = row[i], row[d + i]
                self.each_order.append(f"n[{mean.place}] = {self.at(speed)} / (k + 1)")
                if rate is None:
                    self.each_order.append(f"n[{speed.place}] = {now} / (k + 1)")
                if self.by_duration:
                    u, v = self.by_duration[side, i], self.by_duration[side, d + i]
                    self.each_order += [
                        f"r[{v}] = (r[{v}] if k > 0 else 0.0) + at * {own}",
                        f"n[{v}] = {own}",
                        f"n[{u}] = r[{v}] / (k + 1)",
                    ]
            if self.directions:
                self.vary(i, law, rate is None)
                for side in self.sides:
                    u, v = self.varied[side, i], self.varied[side, d + i]
                    self.each_order += [f"n[{u + j}] = r[{v + j}] / (k + 1)" for j in places]

    def on(self, side: str, a: Quantity) -> str:
        """The coefficient of a quantity, or of what it changes by."""
        found: Quantity | None = a
        for along in side:
            found = found and self.derivative(found, along)
        return "0.0" if found is None else self.coefficient(found)

    def follow_rate(self, place: int, rate: str) -> None:
        """Write a coefficient of what differs from a rate by a constant."""
        self.each_order.append(f"r[{place}] = {rate} if k > 0 else r[{place}]")

    def slopes(self, law: Quantity) -> Iterator[tuple[Quantity, int, str]]:
        """Yield what the state's derivatives are multiplied by in a velocity's law, the place of
        the first of them, and the side on which the product is."""
        for m, row in enumerate(self.rows[""]):
            if m < self.freedom:
                slope = self.times(self.start["dt"], self.derivative(law, f"x{m}"))
            else:
                slope = self.derivative(law, row.place)
            if slope is not None:
                yield from ((slope, self.varied[side, m], side) for side in self.sides)
                bend = self.derivative(slope, ALONG) if ALONG in self.sides else None
                if bend is not None:
                    yield bend, self.varied["", m], ALONG

    def vary(self, i: int, law: Quantity, pushed: bool) -> None:
        """Write the coefficients of the derivatives of a velocity by the directions, the next ones
        where the law pushes it."""
        keys = [(side, j) for side in self.sides for j in range(len(self.directions))]
        sums, terms = {key: list[str]() for key in keys}, {key: list[str]() for key in keys}
        for slope, first, side in self.slopes(law):
            for j in range(len(self.directions)):
                if slope.degree == CONSTANT:
                    terms[side, j].append(f"{self.at(slope)} * r[{first + j}]")
                else:
                    sums[side, j].append(f"p[{self.series(slope).place}] * q[{first + j}]")
        for j, name in enumerate(self.directions):
            own = self.derivative(law, name)
            if own is not None:
                for side in self.sides:
                    terms[side, j].append(self.on(side, own))
        found = {key: f"d{n}" for n, key in enumerate(keys) if sums[key]}
        if found:
            terms_of = {d: sums[key] for key, d in found.items()}
            self.each_order.append(self.convolution(f"varied_{i}", terms_of, "k + 1"))
        for side, j in keys:
            parts = [*([found[side, j]] if sums[side, j] else []), *terms[side, j]]
            place = self.varied[side, self.freedom + i] + j
            text = " + ".join(parts) or "0.0"
            if pushed:
                self.each_order.append(f"n[{place}] = ({text}) / (k + 1)")
            else:
                self.follow_rate(place, text)

    def flight(self, name: str) -> str:
        """Return the text of a function that returns what `integration.flown` does, and behind it
        the same of the derivatives along a direction."""
        self.push()
        wanted = [
            self.found(i, name, side)
            for side in self.sides
            for name in ("", *self.asked)
            for i in range(2 * self.freedom)
        ]
        arrived, failed = (
            ["w[0] = taken + 1.0", f"return ({', '.join(one)})"]
            for one in (wanted, ["nan"] * len(wanted))
        )
        more = [n.replace("g", e) for e in self.letters[1:] for n in self.given.values()]
        return self.loop(name, ", ".join([*more, "w", "most", "longest"]), [], arrived, failed)

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
        self.once += ["made = 0", "most, longest = MOST_STEPS, 1.0", "begin_path(count, way)"]
        return self.loop(name, "w, weights, count, way", lines, ["return made"], ["return -1"])

    def steps(self, name: str) -> str:
        """Return the text of a function that fills in the series of a flight's steps, and returns
        how many there are; where the flight does not arrive, that is below zero."""
        self.push()
        self.once += ["made = 0", "most, longest = MOST_STEPS, 1.0"]
        each = f"made = record_step({self.freedom}, STRIDE, w, at, h, made, found)"
        failed = "return -1 - taken"
        lines = [each, "if made < 0:", f"    {failed}"]
        return self.loop(name, "w, found", lines, ["return made"], [failed])

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
        means, speeds = range(self.freedom), range(self.freedom, 2 * self.freedom)
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

    def found(self, i: int, name: str, side: str) -> str:
        """A number of the state at the end of a step, or its derivative by a direction, or what
        that changes by."""
        if name == "dt":
            return self.state[self.by_duration[side, i]]
        if not name:
            return self.state[int(self.rows[side][i].place)]
        if name not in self.directions:
            return "0.0"
        return self.state[self.varied[side, i] + self.directions.index(name)]

    def loop(
        self, name: str, more: str, each: list[str], arrived: list[str], failed: list[str]
    ) -> str:
        """The text of a function that takes steps, with lines for each of them, and for when the
        flight has arrived, or does not."""
        self.write_sums()
        sums, state = self.state, range(len(self.state))
        begun = [f"w[{i}] = 0.0" for i in state]
        for i in range(self.freedom):
            speed, place = f"v{i}", self.freedom + i
            value = self.start[speed]
            for row in self.rows.values():
                begun.append(f"w[{row[place].place}] = {self.at(value)}")
                value = self.seeds[ALONG].get(value, value)
            if speed in self.directions:
                first = self.varied["", place]
                begun.append(f"w[{first + self.directions.index(speed)}] = 1.0")
        sizes = [f"max({', '.join(f'abs({row}[{i}])' for i in state)})" for row in "rpq"]
        given = ", ".join(self.given.values())
        watch = [f"while h >= SHORTEST_STEP and misses({given}, at, h, size, w):", "    h *= 0.5"]
        lines = [
            f"def {name}({given}, {more}):",
            *_indented(1, self.once + begun),
            "    at, lost = 0.0, 0.0",
            "    for taken in range(most):",
            *_indented(2, self.each_step),
            f"        for k in range(ORDER + {self.further}):",
            "            r, n = tail(w, STRIDE * k), tail(w, STRIDE * (k + 1))",
            *_indented(3, self.each_order),
            "        r, p, q = w[:STRIDE], tail(w, STRIDE * ORDER), tail(w, STRIDE * (ORDER - 1))",
            "        left = (1.0 - at) - lost",
            f"        size = {sizes[0]}",
            f"        h = step_length(ORDER, size, {', '.join(sizes[1:])}, min(left, longest))",
            *_indented(2, watch if self.hides else []),
            "        if h < SHORTEST_STEP and h < left:",
            *_indented(3, failed),
            *_indented(2, [f"{s} = p[{i}]" for i, s in enumerate(sums)]),
            "        for k in range(ORDER - 1, -1, -1):",
            "            r = tail(w, STRIDE * k)",
            *_indented(3, [f"{s} = {s} * h + r[{i}]" for i, s in enumerate(sums)]),
            f"        total = {' + '.join(sums)}",
            "        if not total - total == 0.0:",
            *_indented(3, failed),
            *_indented(2, each),
            "        if h >= left:",
            *_indented(3, arrived),
            *_indented(2, [f"w[{i}] = {s}" for i, s in enumerate(sums)]),
            "        h += lost",
            "        after = at + h",
            "        lost, at = h - (after - at), after",
            *_indented(1, failed),
        ]
        return "\n".join(lines) + "\n"


PARTNERS = {"sin": "cos", "sinh": "cosh", "cosh": "sinh"}
"""Functions that others are the derivatives of."""


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
