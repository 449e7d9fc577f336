"""Kernels are written here: from a model's equations to straight-line Python, by SymPy.

Importing this module imports SymPy; `contimpact.segments.kernels` does so only when a kernel is
not in its cache. A kernel is straight-line arithmetic on floats, with a loop over a forcing's
harmonics where these are many, so it runs as it stands, on NumPy arrays, and under a compiler for
the plain subset of Python.
"""

from __future__ import annotations

import functools
import itertools
import re
import textwrap
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy
from sympy import Add, Mul, Pow, S
from sympy.printing.pycode import PythonCodePrinter

from ..errors import InputError
from ..models.equations import Departure, combine_rows, equations_of, state_symbols
from ..models.guards import orders_of
from ..models.linear import EndFlow, MeanFlow, law_of, rows_of
from ..models.model import Model
from ..models.nonlinear import Flown
from ..models.symbolic import MeanTransient, Stumpff, Transient
from ..models.symbols import (
    DT,
    LARGEST_WHOLE,
    PHASE,
    T0,
    T1,
    TURN,
    HarmonicSum,
    over_harmonics,
    primed_symbol,
)
from . import transients
from .integration import Statement, text_of
from .kernel import SECTION, Family, Setup, declaration, flat, refill, result_text
from .linear_flow import Shape

# Formulas as straight-line code, differentiated step by step.
#
# A derivative of high order grows with its order when it is written out. Each step of a computation
# has a short derivative, in the steps before it; this is the forward mode of algorithmic
# differentiation. Importing this module imports SymPy.


class Tape:
    """Steps of a computation: sums, products, powers and functions of earlier steps.

    A *value* on the tape is a number, a symbol, or a multiple of a symbol. `steps` has what each
    step's symbol is short for; equal steps have one symbol.
    """

    def __init__(self) -> None:
        self.steps: dict[Any, Any] = {}
        self._values: dict[Any, Any] = {}

    def put(self, e: Any) -> Any:
        """Add the steps that compute an expression; return its value."""
        if e.is_Atom:
            return e
        if isinstance(e, HarmonicSum):
            return self._step(e)
        if e not in self._values:
            factor, rest = _factor_number(e)
            self._values[e] = factor * self.put(rest) if factor != 1 else self._put(e)
        return self._values[e]

    def _put(self, e: Any) -> Any:
        argument = self._symbol if isinstance(e, sympy.Function) else self.put
        short = e.func(*(argument(a) for a in e.args))
        return self._step(e) if short == e else self.put(short)

    def _symbol(self, e: Any) -> Any:
        """The value of a function's argument, which often has several functions."""
        value = self.put(e)
        return value if value.is_Atom else self._step(value)

    def _step(self, e: Any) -> Any:
        symbol = self._values.get(("step", e))
        if symbol is None:
            symbol = self._values["step", e] = sympy.Symbol(f"w{len(self.steps)}'")
            self.steps[symbol] = e
        return symbol

    def along(self, values: Iterable[Any], rates: Mapping[Any, Any]) -> list[Any]:
        """Return the derivatives of values where symbols change at the given rates."""
        slopes = dict(rates)
        return [self._slope(value, slopes) for value in values]

    def _slope(self, e: Any, slopes: dict[Any, Any]) -> Any:
        if e not in slopes:
            inside = self.steps.get(e, e)
            if isinstance(inside, HarmonicSum):
                moved = (slopes.get(x, S.Zero) * sympy.diff(inside, x) for x in inside.free_symbols)
                slopes[e] = self.put(Add(*moved))
                return slopes[e]
            inner = [self._slope(a, slopes) for a in inside.args]
            moving = [(i, slope) for i, slope in enumerate(inner) if slope != 0]
            slopes[e] = self.put(Add(*(slope * _partial(inside, i) for i, slope in moving)))
        return slopes[e]

    def listing(self, values: Sequence[Any]) -> tuple[list[tuple[Any, Any]], list[Any]]:
        """Return the steps that values need, numbered in order, and the values in these.

        A step that is used once stands where it is used.
        """
        uses: Counter[Any] = Counter()
        for value in values:
            self._count(value, uses)
        lines: list[tuple[Any, Any]] = []
        done: dict[Any, Any] = {}
        return lines, [self._listed(value, uses, lines, done) for value in values]

    def _count(self, e: Any, uses: Counter[Any]) -> None:
        if e in self.steps:
            uses[e] += 1
            if uses[e] > 1:
                return
            e = self.steps[e]
        for a in e.args:
            self._count(a, uses)

    def _listed(
        self, e: Any, uses: Counter[Any], lines: list[tuple[Any, Any]], done: dict[Any, Any]
    ) -> Any:
        if e not in done:
            inside = self.steps.get(e, e)
            listed = inside
            if inside.args:
                listed = inside.func(*(self._listed(a, uses, lines, done) for a in inside.args))
            if uses[e] > 1:
                lines.append((sympy.Symbol(f"w{len(lines)}'"), listed))
                listed = lines[-1][0]
            done[e] = listed
        return done[e]


def _factor_number(e: Any) -> tuple[Any, Any]:
    """A number and the rest; a sum and its negative have the same rest."""
    if e.is_Mul:
        return e.as_coeff_Mul()
    if not e.is_Add:
        return S.One, e
    factor, rest = e.primitive()
    turned = -rest
    if rest.could_extract_minus_sign() and not turned.could_extract_minus_sign():
        return -factor, turned
    return factor, rest  # SymPy may say of both that a sign can be extracted


def _partial(e: Any, i: int) -> Any:
    """The derivative of one step with respect to its argument number i."""
    if e.is_Add:
        return S.One
    if e.is_Mul:
        return Mul(*e.args[:i], *e.args[i + 1 :])
    if e.is_Pow:
        base, exponent = e.args
        return exponent * Pow(base, exponent - 1) if i == 0 else e * sympy.log(base)
    return e.fdiff(i + 1)


# SymPy formulas as lines of Python: the functions that lines share, and loops over harmonics.


class Printer(PythonCodePrinter):
    """Prints bare names: kernels find ``sin`` and ``stumpff3`` in their own namespace.

    Parameters are called p_<name>, so that they can have any name.
    """

    printmethod = ""
    """No SymPy object knows how a kernel writes it."""

    def __init__(self) -> None:
        super().__init__({"fully_qualified_modules": False})

    def _print_Symbol(self, expr: Any) -> str:
        name = str(expr.name)
        return name[:-1] if name.endswith("'") else f"p_{name}"

    def _print_Exp1(self, expr: Any) -> str:
        return "exp(1)"

    def _print_Stumpff(self, expr: Any) -> str:
        order, argument = expr.args
        return f"stumpff{order}({self._print(argument)})"

    def _print_Pow(self, expr: Any, rational: bool = False) -> str:
        """Small whole powers as products: a power of floats takes longer, and compilers differ."""
        base, exponent = expr.args
        if not exponent.is_Integer and abs(exponent) != sympy.S.Half:
            return f"power({self._print(base)}, {self._print(exponent)})"
        if not (exponent.is_Integer and 2 <= abs(exponent) <= 4):
            return str(super()._print_Pow(expr, rational=rational))
        factor = self._print(base)
        if base.is_Symbol or base.is_NumberSymbol:
            product = f"({'*'.join([factor] * abs(int(exponent)))})"
        elif abs(exponent) == 3:
            product = f"cube({factor})"
        else:
            product = f"square({factor})" if abs(exponent) == 2 else f"square(square({factor}))"
        return product if exponent > 0 else f"(1/{product})"

    def _print_Field(self, expr: Any) -> str:
        parameters = [self._print(symbol) for symbol in expr.parameters]
        rates = ["" if e is None else self._print(e) for e in expr.rates]
        return repr(text_of(parameters, [self._print(e) for e in expr.accelerations], rates))

    def _print_Float(self, expr: Any) -> str:
        return repr(float(expr))

    def _print_Rational(self, expr: Any) -> str:
        return f"ratio({expr.p}, {expr.q})" if expr.q != 1 else self._print_Integer(expr)

    def _print_Integer(self, expr: Any) -> str:
        return f"{expr.p}" if abs(expr.p) <= LARGEST_WHOLE else f"ratio({expr.p}, 1)"

    def _print_Double(self, expr: Any) -> str:
        above, below = expr.value.as_integer_ratio()
        return f"ratio({above}, {below})"


def to_float(printed: str) -> str:
    """A whole number as a float: what a kernel returns is of one type."""
    return f"{printed}.0" if re.fullmatch(r"-?\d+", printed) else printed


@dataclass(frozen=True)
class _JointFunctions:
    """Functions that one line computes: what it needs, and what the functions are called there."""

    line: str
    needs: frozenset[Any]
    names: dict[Any, Any]


def _stumpffs(expressions: Sequence[Any]) -> Iterator[_JointFunctions]:
    """Stumpff functions of one argument, where there are several."""
    used: dict[Any, set[int]] = {}
    for call in set().union(*(e.atoms(Stumpff) for e in expressions)):
        order, argument = call.args
        if argument.is_Symbol and order >= 1:
            used.setdefault(argument, set()).add(int(order))
    for argument, orders in used.items():
        upto = next((n for n in transients.TOGETHER if n >= max(orders)), None)
        if len(orders) < 2 or upto is None:
            continue
        name = argument.name.removesuffix("'")
        found = [f"c{k}_{name}" for k in range(1, upto + 1)]
        names = {Stumpff(k, argument): sympy.Symbol(f"{found[k - 1]}'") for k in orders}
        line = f"{', '.join(found)} = stumpffs{upto}({name})"
        yield _JointFunctions(line, frozenset([argument]), names)


def _transients(expressions: Sequence[Any]) -> Iterator[_JointFunctions]:
    """Free motions of one oscillator at one time."""
    used: dict[Any, set[Any]] = {}
    for call in set().union(*(e.atoms(Transient, MeanTransient) for e in expressions)):
        used.setdefault(call.args[2:], set()).add(call)
    for i, (arguments, calls) in enumerate(sorted(used.items(), key=lambda item: str(item[0]))):
        wanted = {tuple(map(int, call.args[:2])) for call in calls}
        order = next((n for n, known in transients.TABLES.items() if wanted <= set(known)), None)
        if order is None:
            beyond = sorted(wanted.difference(*transients.TABLES.values()))
            found = f"free motions, or derivatives of them, with (n, b) = {beyond}"
            raise InputError("flight", found, "write it with free motions of lower n and b")
        means = {(n, b): f"m{i}_{b}_{n + 1}" for n, b in transients.TABLES[order]}
        motions = {(n, b): f"g{i}_{b}_{n + 1}" for n, b in transients.MOTIONS[order]}
        by_kind = {MeanTransient: means, Transient: means | motions}
        names = {c: sympy.Symbol(f"{by_kind[c.func][c.args[:2]]}'") for c in calls}
        given = ", ".join(map(Printer().doprint, arguments))
        line = f"{', '.join((*means.values(), *motions.values()))} = transients{order}({given})"
        yield _JointFunctions(line, frozenset().union(*(a.free_symbols for a in arguments)), names)


def print_steps(
    steps: Sequence[tuple[Any, Any]], values: Sequence[Any]
) -> tuple[list[str], list[str]]:
    """The lines that make some steps, and the texts of values that follow from these."""
    printer, lines = Printer(), []
    formulas = [*(e for _, e in steps), *values]
    waiting = [
        *_stumpffs(formulas),
        *_transients(formulas),
        *_flows(formulas),
        *_integrated_flights(formulas),
    ]
    names = {call: symbol for group in waiting for call, symbol in group.names.items()}
    missing = {symbol for symbol, _ in steps}
    for symbol, e in (*steps, (None, None)):
        lines += [group.line for group in waiting if not group.needs & missing]
        waiting = [group for group in waiting if group.needs & missing]
        if symbol is not None:
            lines.append(f"{printer.doprint(symbol)} = {printer.doprint(e.xreplace(names))}")
            missing.remove(symbol)
    return lines, [printer.doprint(e.xreplace(names)) for e in values]


def share_steps(expressions: Sequence[Any], letter: str) -> tuple[list[tuple[Any, Any]], list[Any]]:
    """Expressions by the steps that they have in common, named by a letter.

    Factors are taken out first, but not of linear flights: there that takes longer than all the
    rest, and saves nothing beside the exponential of a matrix. What flights are integrated from is
    kept apart: written in two ways, one flight would be integrated twice.
    """
    symbols = (primed_symbol(f"{letter}{i}") for i in itertools.count())
    linear = any(e.has(MeanFlow, EndFlow) for e in expressions)
    factored = None if linear else "basic"
    calls = sorted(set().union(*(e.atoms(Flown) for e in expressions)), key=str)
    given = [e for e in dict.fromkeys(a for call in calls for a in call.args[4:]) if not e.is_Atom]
    held = {e: primed_symbol(f"held{i}") for i, e in enumerate(given)}
    apart = {call: call.func(*(held.get(a, a) for a in call.args)) for call in calls}
    steps, values = sympy.cse(
        [*given, *(e.xreplace(apart) for e in expressions)],
        symbols=symbols,
        optimizations=factored,
        order="none",
    )
    known = dict(zip(held.values(), values, strict=False))
    values = [e.xreplace(known) for e in values[len(given) :]]
    return [(symbol, e.xreplace(known)) for symbol, e in steps], values


def extract_loops(outputs: Any) -> tuple[Any, list[str]]:
    """The same with a symbol for each sum over harmonics, and the loops that make these."""
    values = [sympy.sympify(e) for e in flat(outputs)]
    sums = dict.fromkeys(s for e in values for s in sorted(e.atoms(HarmonicSum), key=str))
    names = {s: primed_symbol(f"s{i}") for i, s in enumerate(sums)}
    lines: list[str] = []
    for rows in dict.fromkeys(s.args[1] for s in sums):
        terms = {names[s].name[:-1]: s.args[0] for s in sums if s.args[1] == rows}
        lines += _loop(rows, terms)
    return refill(outputs, [e.xreplace(names) for e in values]), lines


def _loop(rows: Any, terms: Mapping[str, Any]) -> list[str]:
    """The lines that sum up terms over the rows of harmonics, all in one loop."""
    steps, values = share_steps(list(terms.values()), "u")
    inside, texts = print_steps(steps, values)
    printed = (", ".join(to_float(Printer().doprint(e)) for e in row) for row in rows)
    table = "".join(f"        ({row}),\n" for row in printed)
    return [
        f"{' = '.join(terms)} = 0.0",
        f"for k, a, b in waves((\n{table}    ), phase, dt):",
        *(f"    {line}" for line in inside),
        *(f"    {s} = {s} + total({text})" for s, text in zip(terms, texts, strict=True)),
    ]


def _flows(expressions: Sequence[Any]) -> Iterator[_JointFunctions]:
    """Linear flights: the tables that entries of one law are taken from."""
    used: dict[Any, set[Any]] = {}
    for call in set().union(*(e.atoms(MeanFlow, EndFlow) for e in expressions)):
        law, _, _, _, dt, *parameters = call.args
        used.setdefault((law, dt, *parameters), set()).add(call)
    laws = sorted(used.items(), key=lambda item: str(item[0]))
    for k, ((law, dt, *parameters), calls) in enumerate(laws):
        wanted = sorted({int(call.args[3]) for call in calls if call.args[3] > 1})
        directions = [parameters[by - 2] for by in wanted]
        numbers = [*law.numbers, *(e.diff(p) for p in directions for e in law.numbers)]
        printed = [to_float(Printer().doprint(e)) for e in (dt, *numbers)]
        shape = Shape(law.freedom, law.waves, len(directions))
        given = f"{', '.join(map(str, shape))}, {', '.join(printed)}"
        tables = {0: 0, 1: 2, **{by: 4 + 2 * i for i, by in enumerate(wanted)}}
        names = {}
        for call in calls:
            i, j, by = map(int, call.args[1:4])
            place = shape.place(tables[by] + isinstance(call, EndFlow), i, j)
            names[call] = primed_symbol(f"f{k}[{place}]")
        needs = frozenset().union(*(e.free_symbols for e in (dt, *numbers)))
        yield _JointFunctions(f"f{k} = flow({given})", needs, names)


def _integrated_flights(expressions: Sequence[Any]) -> Iterator[_JointFunctions]:
    """Flights that are integrated, each once with all derivatives that are asked for."""
    used: dict[Any, set[Any]] = {}
    for call in set().union(*(e.atoms(Flown) for e in expressions)):
        used.setdefault((call.args[0], *call.args[4:]), set()).add(call)
    printer = Printer()
    for k, ((field, *given), calls) in enumerate(sorted(used.items(), key=lambda i: str(i[0]))):
        freedom = len(field.accelerations)
        names = Statement(tuple(map(printer.doprint, field.parameters)), field.accelerations).names
        wanted = sorted({int(call.args[3]) for call in calls if call.args[3] > 0})
        directions = " ".join(names[by - 1] for by in wanted)
        printed = [to_float(printer.doprint(e)) for e in given]
        tables = {0: 0, **{by: 1 + i for i, by in enumerate(wanted)}}
        named = {}
        for call in calls:
            kind, i, by = map(int, call.args[1:4])
            named[call] = primed_symbol(f"h{k}[{freedom * (2 * tables[by] + kind) + i}]")
        needs = frozenset().union(*(e.free_symbols for e in given))
        line = f"h{k} = flown({printer.doprint(field)}, {directions!r}, {', '.join(printed)})"
        yield _JointFunctions(line, needs, named)


def _family(formulas: Sequence[Any], loops: Sequence[str]) -> Family:
    """How a kernel with some formulas and loops is computed."""
    if any(e.has(Flown) for e in formulas):
        return Family.INTEGRATED
    if any(e.has(MeanFlow, EndFlow) for e in formulas):
        return Family.LINEAR
    if loops:
        return Family.HARMONICS
    return Family.UNKNOWN if sympy.nan in formulas else Family.CLOSED


LARGE = 300
"""Operations of a flight up to which its derivatives are written out and searched for common
factors: that takes more than twice as long for twice as many, and saves a fifth of them. Of linear
flights, which spend their time in `flow`, none are."""


class KernelWriter:
    """Writes the kernels of one model, differentiated in its free parameters: one, or two for
    curves."""

    def __init__(self, model: Model, parameters: Sequence[str]) -> None:
        self.model, self.parameters = model, tuple(parameters)
        self.equations = equations_of(model)
        self.free = [self.equations.parameters[name] for name in self.parameters]
        self.start, self.end = self.equations.start, self.equations.end

    def write(self, name: str) -> str:
        """Return the source of the kernel `name`: ``setup``, ``harmonics``, ``surfaces``,
        ``flight_<a>_<b>``, ``motion_<a>``, ``states_<a>``, ``since_<a>``, ``passing_<a>``,
        ``gap_<a>_<b>``, ``law_<a>``, ``rates_<a>``, ``field_<a>``, ``loss_<a>`` or
        ``agreement_<a>_<coordinate>``."""
        kind, *walls = name.split("_")
        written: str = getattr(self, kind)(name, *walls)
        return written

    def residual(self, a: str, b: str) -> list[Any]:
        """Arrival minus embedding, gap coordinate first.

        Between two impacts on one surface the gap equation is divided by the flight's duration: the
        flight of zero duration would solve it whatever the state.
        """
        rows = self.arrivals(self.leave(a), b)
        if self.equations.returns(a, b):
            rows[0] = combine_rows(self.equations.pivot(b)[1], self.leave(a).mean)
        return rows

    def arrivals(self, leave: Departure, b: str) -> list[Any]:
        """The same without a division."""
        place, row = self.equations.pivot(b)
        gap = combine_rows(row, leave.now) - self.equations.walls[b]
        rows = [gap, combine_rows(row, leave.end) - self.end[0]]
        others = [i for i in range(len(row)) if i != place]
        for i, x, v in zip(others, self.end[1::2], self.end[2::2], strict=True):
            rows += [leave.now[i] - x, leave.end[i] - v]
        return rows

    def leave(self, wall: str) -> Departure:
        """The flight that leaves a wall."""
        return self.equations.departures[wall]

    # Derivatives: phase = t0 - turn*T(lambda) and dt = t1 - t0, with `turn` a whole number.

    def _gradients(self, tape: Tape, values: Sequence[Any]) -> list[list[Any]]:
        """Derivatives of values on a tape, with respect to (t0, y0, t1, y1, free parameters)."""
        variables = (PHASE, DT, *self.start, *self.end, *self.free)
        by = {x: tape.along(values, {x: sympy.S.One}) for x in variables}
        rows = [self._chained(lambda x, i=i: by[x][i]) for i in range(len(values))]  # type: ignore[misc]
        return [[tape.put(sympy.sympify(e)) for e in row] for row in rows]

    def _chained(self, by: Callable[[Any], Any]) -> list[Any]:
        """The same from those with respect to phase, dt, section coordinates and parameters."""
        return [
            by(PHASE) - by(DT),
            *(by(y) for y in self.start),
            by(DT),
            *(by(y) for y in self.end),
            *(by(free) - self.drift(free) * by(PHASE) for free in self.free),
        ]

    def drift(self, free: Any) -> Any:
        """How fast the phase falls behind where a free parameter grows."""
        return TURN * sympy.diff(self.equations.period, free)

    # The kernels.

    def flight(self, name: str, a: str, b: str) -> str:
        if a == SECTION:
            return self.quiet(name, b)
        rows = self.residual(a, b)
        listed = any(e.has(MeanFlow) for e in rows) or sum(e.count_ops() for e in rows) > LARGE
        tape = Tape() if listed else None
        if tape is None:
            gradients = [self._chained(lambda x, e=e: sympy.diff(e, x)) for e in rows]  # type: ignore[misc]
        else:
            rows = [tape.put(e) for e in rows]
            gradients = self._gradients(tape, rows)
        m = len(rows)
        blocks = (
            tuple(rows),
            tuple(g for gradient in gradients for g in gradient[:m]),
            tuple(g for gradient in gradients for g in gradient[m : 2 * m]),
            tuple(g for gradient in gradients for g in gradient[2 * m :]),
        )
        about = f"""Flight from wall {a} to wall {b}: residual and first derivatives.

        Returns {m} residuals (arrival minus embedding), and their derivatives row by row: with
        respect to the start (t0, {self._names(self.start)}), to the end
        (t1, {self._names(self.end)}), and to {", ".join(self.parameters)}."""
        if tape is None:
            return self._shared(name, self._ends(), about, blocks, reduce=True)
        return self._listed(name, self._ends(), about, tape, blocks)

    def quiet(self, name: str, b: str) -> str:
        """A flight from the section t = 0, to a guard or back after as many periods as `b` says:
        for 0 after a time of its own, which stands in the place of the velocity v_0 = 0."""
        equations, leave = self.equations, self.equations.quiet
        end, rows = (T1, *self.end), []
        if b.isdigit():
            end, states = equations.back, zip(leave.now, leave.end, strict=True)
            back = end if int(b) else (end[0], sympy.S.Zero, *end[2:])
            end = end if int(b) else (end[0], T1, *end[2:])
            pairs = zip(states, zip(back[::2], back[1::2], strict=True), strict=True)
            rows = [
                e - to for arrived, given in pairs for e, to in zip(arrived, given, strict=True)
            ]
        else:
            rows = self.arrivals(leave, b)
        since = int(b) * equations.period if b.isdigit() and int(b) else T1
        rows = [
            sympy.sympify(e).xreplace({PHASE: sympy.S.Zero}).xreplace({DT: since}) for e in rows
        ]
        tape, variables = Tape(), (*equations.state, *end, *self.free)
        rows = [tape.put(e) for e in rows]
        by = [tape.along(rows, {x: sympy.S.One}) for x in variables]
        by = [[tape.put(sympy.sympify(e)) for e in column] for column in by]
        m = len(rows)
        parts = by[:m], by[m : 2 * m], by[2 * m :]
        blocks = (tuple(rows), *(tuple(c[i] for i in range(m) for c in part) for part in parts))
        about = f"""Flight from the section t = 0 to {b}: residual and first derivatives.

        Laid out as that of a flight between two walls."""
        return self._listed(name, [*equations.state, *end], about, tape, blocks, reduce=False)

    def motion(self, name: str, a: str) -> str:
        leave, (_, row) = self.leave(a), self.equations.pivot(a)
        speed, force = combine_rows(row, leave.end), combine_rows(row, leave.acceleration)
        away = sympy.S.Zero
        if not self.equations.returns(a, a):
            away = combine_rows(row, leave.position) - self.equations.walls[a]
        outputs = (away + DT * combine_rows(row, leave.mean), speed, force)
        about = f"""Flight after wall {a}: the gap coordinate at the time dt after leaving.

        Returns its displacement from the wall, its velocity and its acceleration."""
        return self._shared(name, [T0, *self.start, DT], about, outputs, reduce=True)

    def states(self, name: str, a: str) -> str:
        leave = self.leave(a)
        outputs = tuple(e for pair in zip(leave.now, leave.end, strict=True) for e in pair)
        about = f"""Flight after wall {a}: position and velocity of each coordinate at the time dt
        after leaving."""
        return self._shared(name, [T0, *self.start, DT], about, outputs, reduce=True)

    def _gap(self, leave: Departure, b: str) -> tuple[Any, ...]:
        """Position, velocity and acceleration of a gap coordinate at the end of a flight."""
        _, row = self.equations.pivot(b)
        return tuple(combine_rows(row, e) for e in (leave.now, leave.end, leave.acceleration))

    def since(self, name: str, b: str) -> str:
        outputs = tuple(
            sympy.sympify(e).xreplace({PHASE: sympy.S.Zero})
            for e in self._gap(self.equations.quiet, b)
        )
        about = f"""The gap coordinate of wall {b} at the time dt since the section t = 0.

        Returns its position, its velocity and its acceleration."""
        return self._shared(name, [*self.equations.state, DT], about, outputs)

    def passing(self, name: str, b: str) -> str:
        outputs = self._gap(self.equations.quiet, b)
        about = f"""The gap coordinate of wall {b} at the time dt after passing a state.

        Returns its position, its velocity and its acceleration."""
        return self._shared(name, [T0, *self.equations.state, DT], about, outputs, reduce=True)

    def gap(self, name: str, a: str, b: str) -> str:
        outputs = self._gap(self.leave(a), b)
        about = f"""After wall {a}: the gap coordinate of wall {b} at the time dt after leaving.

        Returns its position, its velocity and its acceleration."""
        return self._shared(name, [T0, *self.start, DT], about, outputs, reduce=True)

    def law(self, name: str, a: str) -> str:
        """What a linear flight is computed from; NaN alone where flights are no linear ones."""
        leave = self.leave(a)
        laws = {call.args[0] for e in leave.mean for call in e.atoms(MeanFlow)}
        about = f"""Flight after wall {a}: degrees of freedom and harmonics, the accelerations and
        frequencies, and the state after impact with the harmonics' cosines and sines, and 1."""
        law = laws.pop() if len(laws) == 1 else self._laws.get(a)
        if law is None:
            return self._shared(name, [T0, *self.start], about, (sympy.nan,))
        angles = [frequency * PHASE for frequency in law.numbers[-law.waves :] if law.waves]
        waves = [wave(angle) for angle in angles for wave in (sympy.cos, sympy.sin)]
        state = (*leave.position, *leave.velocity, *waves, sympy.S.One)
        outputs = (sympy.Integer(law.freedom), sympy.Integer(law.waves), law.numbers, state)
        return self._shared(name, [T0, *self.start], about, outputs, reduce=True)

    def rates(self, name: str, a: str) -> str:
        """The velocities of coordinates of first order, and how they change with the state."""
        x, v = state_symbols(self.model.DEGREES_OF_FREEDOM)
        orders = orders_of(self.model.MODES, self.model.guard(a).next_mode, len(v))
        laws = [
            e if k == 1 else sympy.S.Zero for k, e in zip(orders, self.leave(a).rates, strict=True)
        ]
        found = tuple(laws), tuple(sympy.diff(e, s) for e in laws for s in (*x, *v))
        about = f"""Velocities of coordinates of first order after wall {a}, and how they change
        with positions and velocities: the derivatives, row by row."""
        return self._shared(name, [T0, *x, *v], about, found)

    def field(self, name: str, a: str) -> str:
        """What a flight is integrated from; NaN alone where it is not."""
        quiet = a == SECTION
        leave = self.equations.quiet if quiet else self.leave(a)
        arguments = self.equations.state if quiet else [T0, *self.start]
        about = f"""Flight after {a}: its field, and what it leaves with, the time first."""
        calls = {(e.args[0], e.args[5:]) for e in leave.mean if isinstance(e, Flown)}
        if not calls:
            return self._shared(name, arguments, about, (sympy.nan,))
        ((field, given),) = calls
        given = [e.xreplace({PHASE: sympy.S.Zero}) if quiet else e for e in given]
        return self._shared(name, arguments, about, (field, tuple(given)), reduce=not quiet)

    @functools.cached_property
    def _laws(self) -> dict[str, Any]:
        """The laws of flights in closed form, where all are linear, with the same harmonics."""
        equations, (x, v) = self.equations, state_symbols(self.model.DEGREES_OF_FREEDOM)
        found = {
            wall: rows_of(leave.by_state, [*x, *v], T0, equations.period)
            for wall, leave in equations.departures.items()
        }
        known = {wall: rows for wall, rows in found.items() if rows is not None}
        if len(known) < len(found):
            return {}
        orders = sorted({n for _, waves in known.values() for n in waves if n > 0})
        return {wall: law_of(rows, orders, equations.period) for wall, rows in known.items()}

    def loss(self, name: str, a: str) -> str:
        """The kinetic energy that an impact takes; NaN where the masses are not stated."""
        before, after = self.equations.before(a, self.start)[1], self.leave(a).velocity
        lost = sympy.nan
        if self.equations.mass is not None:
            guard = self.equations.guards[a]
            one, other = (self.equations.mass[mode] for mode in (guard.modes[0], guard.next_mode))
            if one == other:  # v.Mv - u.Mu = (v - u).M(v + u), which does not cancel
                ends = list(zip(before, after, strict=True))
                change, total = [v - u for v, u in ends], [v + u for v, u in ends]
                lost = (
                    sum(d * combine_rows(row, total) for d, row in zip(change, one, strict=True))
                    / 2
                )
            else:
                energies = (
                    sum(v * combine_rows(row, ends) for v, row in zip(ends, matrix, strict=True))
                    / 2
                    for ends, matrix in ((before, one), (after, other))
                )
                lost = sympy.Add(next(energies), -next(energies))
        about = f"""The kinetic energy that an impact on wall {a} takes."""
        return self._shared(name, [*self.start], about, (lost,))

    def setup(self, name: str) -> str:
        period, derived = self.equations.period, tuple(self.equations.derived.values())
        found = Setup(
            period,
            tuple(sympy.diff(period, free) for free in self.free),
            tuple(sympy.diff(period, one, other) for one in self.free for other in self.free),
            tuple(self.equations.walls.values()),
            derived,
            tuple(sympy.diff(e, free) for e in derived for free in self.free),
        )
        about = f"""What depends on the parameters alone.

        Walls: {", ".join(self.model.letters)}; derived parameters:
        {", ".join(self.model.DERIVED) or "none"}; free: {", ".join(self.parameters)}."""
        return self._shared(name, [], about, found)

    def surfaces(self, name: str) -> str:
        letters = list(self.equations.guards)
        back, lands = self.equations.returns, self.equations.lands
        begins, bends = self.equations.begins, self.equations.bends
        found = tuple(
            sympy.Integer(
                (1 if back(a, b) else 2 * lands(a, b)) + 4 * begins(a, b) + 16 * bends(a, b)
            )
            for a in letters
            for b in letters
        )
        about = f"""Which flights end on the surface that they leave: 1; or 2 where that is so of
        those that a touch starts, or else 0. And 4 more where the flight begins on the surface with
        a rate of either sign, or 8 where without any; and 16 more where the impact changes the rate
        of that guard's gap coordinate, and the mode before it has the guard, too.

        From {letters[0]} to each of {", ".join(letters)}, then from the next."""
        return self._shared(name, [], about, found)

    def harmonics(self, name: str) -> str:
        about = """Acceleration in flight where it depends on time alone.

        Returns its mean and then k, a_k, b_k for each harmonic a_k cos + b_k sin of 2 pi k t/T;
        a mean that is not a number says that the acceleration depends on the state."""
        return self._shared(name, [], about, self.equations.harmonics)

    def agreement(self, name: str, a: str, i: str) -> str:
        """Not kept in the cache: it is evaluated before any kernel is written."""
        leave, k = self.leave(a), int(i)
        acceleration = leave.acceleration[k]
        summed = self._sum_of_harmonics() if k == 0 else acceleration
        velocities = leave.velocity[k], leave.mean[k], leave.end[k]
        outputs, loops = extract_loops((self.equations.period, *velocities, acceleration, summed))
        about = f"""Flight after wall {a}, coordinate {i}: what has to agree.

        Returns the period, the velocity after impact, mean velocity, end velocity, acceleration,
        and the sum of its harmonics."""
        return self._text(name, [PHASE, *self.start, DT], about, [], outputs, False, loops)

    def _sum_of_harmonics(self) -> Any:
        """The acceleration by its harmonics, at the end of a flight; NaN where there are none."""
        constant, *rest = self.equations.harmonics
        angle = 2 * sympy.pi * (PHASE + DT) / self.equations.period
        waves = list(zip(rest[::3], rest[1::3], rest[2::3], strict=True))
        return constant + over_harmonics(
            waves, lambda k, a, b: a * sympy.cos(k * angle) + b * sympy.sin(k * angle)
        )

    # Printing.

    def _ends(self) -> list[Any]:
        return [T0, *self.start, T1, *self.end]

    def _names(self, symbols: Sequence[Any]) -> str:
        return ", ".join(Printer().doprint(s) for s in symbols)

    def _shared(
        self,
        name: str,
        arguments: Sequence[Any],
        about: str,
        outputs: tuple[Any, ...],
        reduce: bool = False,
    ) -> str:
        """A kernel that computes what its outputs have in common once."""
        outputs, loops = extract_loops(outputs)
        shared, reduced = share_steps([sympy.sympify(e) for e in flat(outputs)], "w")
        return self._text(name, arguments, about, shared, refill(outputs, reduced), reduce, loops)

    def _listed(
        self,
        name: str,
        arguments: Sequence[Any],
        about: str,
        tape: Tape,
        outputs: Any,
        reduce: bool = True,
    ) -> str:
        """A kernel that makes the steps of a tape."""
        steps, values = tape.listing(flat(outputs))
        found, loops = extract_loops((*(e for _, e in steps), *values))
        steps = [(symbol, e) for (symbol, _), e in zip(steps, found, strict=False)]
        outputs = refill(outputs, found[len(steps) :])
        return self._text(name, arguments, about, steps, outputs, reduce, loops)

    def _text(
        self,
        name: str,
        arguments: Sequence[Any],
        about: str,
        steps: Sequence[tuple[Any, Any]],
        outputs: Any,
        reduce: bool,
        loops: Sequence[str] = (),
    ) -> str:
        values = flat(outputs)
        signature = self._names([*arguments, *self.equations.parameters.values()])
        formulas = [*values, *(e for _, e in steps)]
        used = set().union(*(e.free_symbols for e in formulas))
        lines = self._reduction(T1 in arguments, TURN in used) if reduce else []
        found, printed = print_steps(steps, values)
        lines += [*loops, *found]
        printed = [to_float(text) for text in printed]
        doc = textwrap.indent(textwrap.dedent("        " + about), "    ").strip()
        body = "\n".join(f"    {line}" for line in lines)
        result = result_text(refill(outputs, printed))
        words = {*re.findall(r"\w+", f"{body} {result}")}
        own = (p for p in self.model.values if self._names([self.equations.parameters[p]]) in words)
        return (
            f"{declaration(_family(formulas, loops), own)}def {name}({signature}):\n"
            f'    """{doc}\n    """\n{body}\n    return {result}\n'
        )

    def _reduction(self, to_an_end: bool, turning: bool) -> list[str]:
        """The lines that take whole periods off the time."""
        period = Printer().doprint(self.equations.period)
        lines = [f"phase = t0 % ({to_float(period)})"]
        if turning:
            lines = [f"turn = floor(t0/({period}))", f"phase = t0 - turn*({period})"]
        return [*lines, "dt = t1 - t0"] if to_an_end else lines
