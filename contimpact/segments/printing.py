"""SymPy formulas as lines of Python: the functions that lines share, and loops over harmonics."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy
from sympy.printing.pycode import PythonCodePrinter

from ..errors import InputError
from ..models.linear import EndFlow, MeanFlow
from ..models.nonlinear import Flown
from ..models.symbolic import MeanTransient, Stumpff, Transient
from ..models.symbols import LARGEST_WHOLE, HarmonicSum, own
from . import stumpff, transients
from .layout import flat, refilled
from .linear_flow import Shape
from .taylor import Statement, text_of


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
        return repr(text_of(parameters, [self._print(e) for e in expr.accelerations]))

    def _print_Float(self, expr: Any) -> str:
        return repr(float(expr))

    def _print_Rational(self, expr: Any) -> str:
        return f"ratio({expr.p}, {expr.q})" if expr.q != 1 else self._print_Integer(expr)

    def _print_Integer(self, expr: Any) -> str:
        return f"{expr.p}" if abs(expr.p) <= LARGEST_WHOLE else f"ratio({expr.p}, 1)"

    def _print_Double(self, expr: Any) -> str:
        above, below = expr.value.as_integer_ratio()
        return f"ratio({above}, {below})"


def as_float(printed: str) -> str:
    """A whole number as a float: what a kernel returns is of one type."""
    return f"{printed}.0" if re.fullmatch(r"-?\d+", printed) else printed


@dataclass(frozen=True)
class _Together:
    """Functions that one line computes: what it needs, and what the functions are called there."""

    line: str
    needs: frozenset[Any]
    names: dict[Any, Any]


def _stumpffs(expressions: Sequence[Any]) -> Iterator[_Together]:
    """Stumpff functions of one argument, where there are several."""
    used: dict[Any, set[int]] = {}
    for call in set().union(*(e.atoms(Stumpff) for e in expressions)):
        order, argument = call.args
        if argument.is_Symbol and order >= 1:
            used.setdefault(argument, set()).add(int(order))
    for argument, orders in used.items():
        upto = next((n for n in stumpff.TOGETHER if n >= max(orders)), None)
        if len(orders) < 2 or upto is None:
            continue
        name = argument.name.removesuffix("'")
        found = [f"c{k}_{name}" for k in range(1, upto + 1)]
        names = {Stumpff(k, argument): sympy.Symbol(f"{found[k - 1]}'") for k in orders}
        line = f"{', '.join(found)} = stumpffs{upto}({name})"
        yield _Together(line, frozenset([argument]), names)


def _transients(expressions: Sequence[Any]) -> Iterator[_Together]:
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
        yield _Together(line, frozenset().union(*(a.free_symbols for a in arguments)), names)


def printed_steps(
    steps: Sequence[tuple[Any, Any]], values: Sequence[Any]
) -> tuple[list[str], list[str]]:
    """The lines that make some steps, and the texts of values that follow from these."""
    printer, lines = Printer(), []
    formulas = [*(e for _, e in steps), *values]
    waiting = [*_stumpffs(formulas), *_transients(formulas), *_flows(formulas), *_flown(formulas)]
    names = {call: symbol for group in waiting for call, symbol in group.names.items()}
    missing = {symbol for symbol, _ in steps}
    for symbol, e in (*steps, (None, None)):
        lines += [group.line for group in waiting if not group.needs & missing]
        waiting = [group for group in waiting if group.needs & missing]
        if symbol is not None:
            lines.append(f"{printer.doprint(symbol)} = {printer.doprint(e.xreplace(names))}")
            missing.remove(symbol)
    return lines, [printer.doprint(e.xreplace(names)) for e in values]


def common(expressions: Sequence[Any], letter: str) -> tuple[list[tuple[Any, Any]], list[Any]]:
    """Expressions by the steps that they have in common, named by a letter.

    Factors are taken out first, but not of linear flights: there that takes longer than all the
    rest, and saves nothing beside the exponential of a matrix.
    """
    symbols = (own(f"{letter}{i}") for i in itertools.count())
    linear = any(e.has(MeanFlow, EndFlow) for e in expressions)
    factored = None if linear else "basic"
    found: Any = sympy.cse(expressions, symbols=symbols, optimizations=factored, order="none")
    return found


def looped(outputs: Any) -> tuple[Any, list[str]]:
    """The same with a symbol for each sum over harmonics, and the loops that make these."""
    values = [sympy.sympify(e) for e in flat(outputs)]
    sums = dict.fromkeys(s for e in values for s in sorted(e.atoms(HarmonicSum), key=str))
    names = {s: own(f"s{i}") for i, s in enumerate(sums)}
    lines: list[str] = []
    for rows in dict.fromkeys(s.args[1] for s in sums):
        terms = {names[s].name[:-1]: s.args[0] for s in sums if s.args[1] == rows}
        lines += _loop(rows, terms)
    return refilled(outputs, [e.xreplace(names) for e in values]), lines


def _loop(rows: Any, terms: Mapping[str, Any]) -> list[str]:
    """The lines that sum up terms over the rows of harmonics, all in one loop."""
    steps, values = common(list(terms.values()), "u")
    inside, texts = printed_steps(steps, values)
    printed = (", ".join(as_float(Printer().doprint(e)) for e in row) for row in rows)
    table = "".join(f"        ({row}),\n" for row in printed)
    return [
        f"{' = '.join(terms)} = 0.0",
        f"for k, a, b in waves((\n{table}    ), phase, dt):",
        *(f"    {line}" for line in inside),
        *(f"    {s} = {s} + total({text})" for s, text in zip(terms, texts, strict=True)),
    ]


def _flows(expressions: Sequence[Any]) -> Iterator[_Together]:
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
        printed = [as_float(Printer().doprint(e)) for e in (dt, *numbers)]
        shape = Shape(law.freedom, law.waves, len(directions))
        given = f"{', '.join(map(str, shape))}, {', '.join(printed)}"
        tables = {0: 0, 1: 2, **{by: 4 + 2 * i for i, by in enumerate(wanted)}}
        names = {}
        for call in calls:
            i, j, by = map(int, call.args[1:4])
            place = shape.place(tables[by] + isinstance(call, EndFlow), i, j)
            names[call] = own(f"f{k}[{place}]")
        needs = frozenset().union(*(e.free_symbols for e in (dt, *numbers)))
        yield _Together(f"f{k} = flow({given})", needs, names)


def _flown(expressions: Sequence[Any]) -> Iterator[_Together]:
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
        printed = [as_float(printer.doprint(e)) for e in given]
        tables = {0: 0, **{by: 1 + i for i, by in enumerate(wanted)}}
        named = {}
        for call in calls:
            kind, i, by = map(int, call.args[1:4])
            named[call] = own(f"h{k}[{freedom * (2 * tables[by] + kind) + i}]")
        needs = frozenset().union(*(e.free_symbols for e in given))
        line = f"h{k} = flown({printer.doprint(field)}, {directions!r}, {', '.join(printed)})"
        yield _Together(line, needs, named)
