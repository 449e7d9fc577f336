"""SymPy formulas of a model -> the Python source of one kernel.

Importing this module imports SymPy; `contimpact.mechanics.kernels` does so only when a kernel is
not in its cache. A kernel is straight-line arithmetic on floats, so it runs as it stands, on NumPy
arrays, and under a compiler for the plain subset of Python.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

import sympy
from sympy.printing.pycode import PythonCodePrinter

from . import stumpff
from .model import Formulas, Model
from .symbolic import Stumpff


class _Printer(PythonCodePrinter):
    """Prints bare names: kernels find ``sin`` and ``stumpff3`` in their own namespace."""

    def __init__(self) -> None:
        super().__init__({"fully_qualified_modules": False})

    def _print_Stumpff(self, expr: Any) -> str:
        order, argument = expr.args
        return f"stumpff{order}({self._print(argument)})"

    def _print_DecayingStumpff(self, expr: Any) -> str:
        order, decay, argument = expr.args
        return f"decaying{order}({self._print(decay)}, {self._print(argument)})"

    def _print_Pow(self, expr: Any, rational: bool = False) -> str:
        """Small whole powers as products: a power of floats takes longer, and compilers differ."""
        base, exponent = expr.args
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

    def _print_Float(self, expr: Any) -> str:
        return repr(float(expr))

    def _print_Rational(self, expr: Any) -> str:
        return f"{expr.p}/{expr.q}" if expr.q != 1 else f"{expr.p}"


def _as_float(printed: str) -> str:
    """A whole number as a float: what a kernel returns is of one type."""
    return f"{printed}.0" if re.fullmatch(r"-?\d+", printed) else printed


def _together(expressions: Sequence[Any]) -> tuple[dict[Any, str], dict[Any, Any]]:
    """Stumpff functions of one argument, to be computed together.

    Returns the line for each argument that several of them share, and the names in which that line
    puts what the functions were.
    """
    used: dict[Any, set[int]] = {}
    for call in set().union(*(e.atoms(Stumpff) for e in expressions)):
        order, argument = call.args
        if argument.is_Symbol and order >= 1:
            used.setdefault(argument, set()).add(int(order))
    lines: dict[Any, str] = {}
    names: dict[Any, Any] = {}
    for argument, orders in used.items():
        upto = next((n for n in stumpff.TOGETHER if n >= max(orders)), None)
        if len(orders) < 2 or upto is None:
            continue
        found = [f"c{k}_{argument}" for k in range(1, upto + 1)]
        lines[argument] = f"{', '.join(found)} = stumpffs{upto}({argument})"
        names |= {Stumpff(k, argument): sympy.Symbol(found[k - 1]) for k in orders}
    return lines, names


class KernelWriter:
    """Writes the kernels of one model, differentiated in its free parameters.

    Parameters
    ----------
    model : Model
    parameters : sequence of str
        Names of the free parameters: one, or two for curves.
    """

    def __init__(self, model: Model, parameters: Sequence[str]) -> None:
        self.model, self.parameters = model, tuple(parameters)
        self.symbols = {name: sympy.Symbol(name, real=True) for name in model.values}
        self.free = [self.symbols[name] for name in self.parameters]
        self.formulas: Formulas = model.formulas(self.symbols)
        size = model.DEGREES_OF_FREEDOM
        self.t0, self.t1, self.turn, self.dt, self.phase = sympy.symbols(
            "t0 t1 turn dt phase", real=True
        )
        section = ["v"] if size == 1 else [n for i in range(size) for n in (f"x{i}_", f"v{i}_")][1:]
        self.start = sympy.symbols([f"{n}0" for n in section], real=True)
        self.end = sympy.symbols([f"{n}1" for n in section], real=True)

    def write(self, name: str) -> str:
        """Return the source of the kernel `name`: ``setup``, ``harmonics``, ``flight_<a>_<b>``,
        ``second_<a>_<b>``, ``third_<a>_<b>`` or ``motion_<a>``."""
        kind, *walls = name.split("_")
        writers: dict[str, Callable[..., str]] = {
            "setup": self.setup,
            "harmonics": self.harmonics,
            "flight": self.flight,
            "second": self.second,
            "third": self.third,
            "motion": self.motion,
        }
        return writers[kind](name, *walls)

    # The state at an impact, and the flight that leaves it.

    def before(self, wall: str, section: Sequence[Any]) -> tuple[list[Any], list[Any]]:
        """Positions and velocities before an impact, from its section coordinates."""
        position = [self.formulas.walls[wall], *section[1::2]]
        velocity = [section[0], *section[2::2]]
        return position, velocity

    def leave(self, wall: str) -> tuple[list[Any], list[Any], list[Any]]:
        """Start positions, mean velocities and end velocities of the flight leaving `wall`."""
        position, velocity = self.before(wall, self.start)
        after = list(self.formulas.reset(wall, position, velocity))
        mean, end = self.formulas.flight(self.phase, position, after, self.dt)
        return position, list(mean), list(end)

    def residual(self, a: str, b: str) -> list[Any]:
        """Arrival minus embedding, gap coordinate first.

        Between two impacts on one wall the gap equation is divided by the flight's duration: the
        flight of zero duration would solve it whatever the state.
        """
        position, mean, velocity = self.leave(a)
        target_position, target_velocity = self.before(b, self.end)
        rows: list[Any] = []
        for i, (x, u, v, xb, vb) in enumerate(
            zip(position, mean, velocity, target_position, target_velocity, strict=True)
        ):
            same_wall = i == 0 and a == b
            rows += [u if same_wall else x + self.dt * u - xb, v - vb]
        return rows

    # Derivatives: phase = t0 - turn*T(lambda) and dt = t1 - t0, with `turn` a whole number.

    def by_start_time(self, e: Any) -> Any:
        return sympy.diff(e, self.phase) - sympy.diff(e, self.dt)

    def by_end_time(self, e: Any) -> Any:
        return sympy.diff(e, self.dt)

    def by_parameter(self, e: Any, free: Any) -> Any:
        drift = self.turn * sympy.diff(self.formulas.period, free)
        return sympy.diff(e, free) - drift * sympy.diff(e, self.phase)

    def derivatives(self, e: Any) -> list[Any]:
        """By (t0, y0, t1, y1, free parameters)."""
        return [
            self.by_start_time(e), *(sympy.diff(e, y) for y in self.start),
            self.by_end_time(e), *(sympy.diff(e, y) for y in self.end),
            *(self.by_parameter(e, free) for free in self.free),
        ]  # fmt: skip

    # The kernels.

    def flight(self, name: str, a: str, b: str) -> str:
        rows = self.residual(a, b)
        gradients = [self.derivatives(e) for e in rows]
        m = len(rows)
        outputs = [
            *rows,
            *(g for gradient in gradients for g in gradient[:m]),
            *(g for gradient in gradients for g in gradient[m : 2 * m]),
            *(g for gradient in gradients for g in gradient[2 * m :]),
        ]
        about = f"""Flight from wall {a} to wall {b}: residual and first derivatives.

        Returns {m} residuals (arrival minus embedding), their {m}x{m} derivatives by the start
        (t0, {self._names(self.start)}), by the end (t1, {self._names(self.end)}), row by row, and
        by {", ".join(self.parameters)}."""
        return self._function(name, self._ends(), about, outputs, reduce=True)

    def second(self, name: str, a: str, b: str) -> str:
        rows = self.residual(a, b)
        m = len(rows)
        size = 2 * m + len(self.free)
        along = sympy.symbols(f"q0:{size}", real=True)
        slopes = [
            sum((q * g for q, g in zip(along, self.derivatives(e), strict=True)), sympy.Integer(0))
            for e in rows
        ]
        outputs = [g for slope in slopes for g in self.derivatives(slope)]
        about = f"""Flight from wall {a} to wall {b}: second derivatives along a direction.

        The direction q is (t0, {self._names(self.start)}, t1, {self._names(self.end)},
        {", ".join(self.parameters)}). Returns, for each of the {m} residuals, the gradient of its
        derivative along q by the same {size} variables."""
        return self._function(name, [*self._ends(), *along], about, outputs, reduce=True)

    def third(self, name: str, a: str, b: str) -> str:
        rows = self.residual(a, b)
        size = 2 * len(rows)
        along = sympy.symbols(f"q0:{size}", real=True)
        m = len(rows)
        duration = sympy.Symbol("duration")  # the rate of dt along q
        rates = [
            (self.phase, along[0]),
            (self.dt, duration),
            *zip(self.start, along[1:m], strict=True),
        ]
        rates += zip(self.end, along[m + 1 :], strict=True)
        for _ in range(3):
            rows = [sum((q * sympy.diff(e, x) for x, q in rates), sympy.S.Zero) for e in rows]
        rows = [e.subs(duration, along[m] - along[0]) for e in rows]
        about = f"""Flight from wall {a} to wall {b}: third derivatives along a direction.

        The direction q is (t0, {self._names(self.start)}, t1, {self._names(self.end)}). Returns,
        for each residual, its third derivative along q."""
        return self._function(name, [*self._ends(), *along], about, rows, reduce=True)

    def motion(self, name: str, a: str) -> str:
        position, mean, velocity = self.leave(a)
        now = [x + self.dt * u for x, u in zip(position, mean, strict=True)]
        acceleration = self.formulas.acceleration(self.phase + self.dt, now, velocity)
        outputs = [self.dt * mean[0], velocity[0], acceleration[0]]
        about = f"""Flight after wall {a}: the gap coordinate at the time dt after leaving.

        Returns its displacement from the wall, its velocity and its acceleration."""
        return self._function(name, [self.t0, *self.start, self.dt], about, outputs, reduce=True)

    def setup(self, name: str) -> str:
        period, derived = (
            self.formulas.period,
            [self.formulas.derived[n] for n in self.model.DERIVED],
        )
        first, *further = self.free
        outputs = [
            period,
            sympy.diff(period, first),
            sympy.diff(period, first, 2),
            *(self.formulas.walls[w.name] for w in self.model.WALLS),
            *derived,
            *(sympy.diff(e, first) for e in derived),
        ]
        for free in further:
            outputs += [sympy.diff(period, free), sympy.diff(period, free, 2)]
            outputs += [sympy.diff(period, first, free), *(sympy.diff(e, free) for e in derived)]
        named = ", ".join(self.model.DERIVED) or "none"
        about = f"""What depends on the parameters alone.

        Returns the forcing period and its first two derivatives by {self.parameters[0]}, the
        positions of the walls {", ".join(w.name for w in self.model.WALLS)}, and the derived
        parameters ({named}) followed by their derivatives by {self.parameters[0]}. With a second
        free parameter mu these follow: the period's derivatives by mu, mu twice, and both, and the
        derived parameters' by mu."""
        return self._function(name, [], about, outputs)

    def harmonics(self, name: str) -> str:
        given = self.formulas.harmonics
        constant, series = given if given is not None else (sympy.nan, [])
        outputs = [constant, *(sympy.sympify(n) for term in series for n in term)]
        about = """Acceleration in flight where it depends on time alone.

        Returns its mean and then k, a_k, b_k for each harmonic a_k cos + b_k sin of 2 pi k t/T;
        a mean that is not a number says that the acceleration depends on the state."""
        return self._function(name, [], about, outputs)

    # Printing.

    def _ends(self) -> list[Any]:
        return [self.t0, *self.start, self.t1, *self.end]

    def _names(self, symbols: Sequence[Any]) -> str:
        return ", ".join(str(s) for s in symbols)

    def _function(
        self, name: str, arguments: Sequence[Any], about: str, outputs: Sequence[Any],
        reduce: bool = False,
    ) -> str:  # fmt: skip
        printer = _Printer()
        signature = self._names([*arguments, *self.symbols.values()])
        lines = []
        if reduce:
            period = printer.doprint(self.formulas.period)
            if any(self.turn in sympy.sympify(e).free_symbols for e in outputs):
                lines += [f"turn = floor(t0/({period}))", f"phase = t0 - turn*({period})"]
            else:
                lines.append(f"phase = t0 % ({_as_float(period)})")
            if self.t1 in arguments:
                lines.append("dt = t1 - t0")
        shared, reduced = sympy.cse(
            [sympy.sympify(e) for e in outputs],
            symbols=sympy.numbered_symbols("w"), optimizations="basic", order="none",
        )  # fmt: skip
        together, names = _together([e for _, e in shared] + reduced)
        for symbol, e in shared:
            lines.append(f"{symbol} = {printer.doprint(e.xreplace(names))}")
            if symbol in together:
                lines.append(together[symbol])
        results = ",\n    ".join(_as_float(printer.doprint(e.xreplace(names))) for e in reduced)
        doc = textwrap.indent(textwrap.dedent("        " + about), "    ").strip()
        body = "\n".join(f"    {line}" for line in lines)
        return (
            f'def {name}({signature}):\n    """{doc}\n    """\n{body}\n'
            f"    return (\n    {results},\n    )\n"
        )
