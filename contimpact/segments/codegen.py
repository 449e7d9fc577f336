"""SymPy formulas of a model -> the Python source of one kernel.

Importing this module imports SymPy; `contimpact.segments.kernels` does so only when a kernel is
not in its cache. A kernel is straight-line arithmetic on floats, so it runs as it stands, on NumPy
arrays, and under a compiler for the plain subset of Python.
"""

from __future__ import annotations

import itertools
import re
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

import sympy
from sympy.printing.pycode import PythonCodePrinter

from ..models.equations import DT, PHASE, T0, T1, TURN, Departure, equations_of, own
from ..models.model import Model
from ..models.symbolic import Stumpff
from . import stumpff
from .tape import Tape

LARGE = 300
"""Operations of a flight up to which its derivatives are written out and searched for common
factors: that takes more than twice as long for twice as many, and saves a fifth of them."""


class _Printer(PythonCodePrinter):
    """Prints bare names: kernels find ``sin`` and ``stumpff3`` in their own namespace.

    Parameters are called p_<name>, so that they can have any name.
    """

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
        return f"ratio({expr.p}, {expr.q})" if expr.q != 1 else f"{expr.p}"


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
        name = argument.name.removesuffix("'")
        found = [f"c{k}_{name}" for k in range(1, upto + 1)]
        lines[argument] = f"{', '.join(found)} = stumpffs{upto}({name})"
        names |= {Stumpff(k, argument): sympy.Symbol(f"{found[k - 1]}'") for k in orders}
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
        self.equations = equations_of(model)
        self.free = [self.equations.parameters[name] for name in self.parameters]
        self.start, self.end = self.equations.start, self.equations.end

    def write(self, name: str) -> str:
        """Return the source of the kernel `name`: ``setup``, ``harmonics``, ``flight_<a>_<b>``,
        ``second_<a>_<b>``, ``third_<a>_<b>``, ``motion_<a>`` or ``agreement_<a>_<coordinate>``."""
        kind, *walls = name.split("_")
        writers: dict[str, Callable[..., str]] = {
            "setup": self.setup,
            "harmonics": self.harmonics,
            "flight": self.flight,
            "second": self.second,
            "third": self.third,
            "motion": self.motion,
            "agreement": self.agreement,
        }
        return writers[kind](name, *walls)

    def residual(self, a: str, b: str) -> list[Any]:
        """Arrival minus embedding, gap coordinate first.

        Between two impacts on one wall the gap equation is divided by the flight's duration: the
        flight of zero duration would solve it whatever the state.
        """
        leave = self.leave(a)
        position, velocity = self.equations.before(b, self.end)
        gaps = [x - xb for x, xb in zip(leave.now, position, strict=True)]
        if a == b:
            gaps[0] = leave.mean[0]
        arrivals = [v - vb for v, vb in zip(leave.end, velocity, strict=True)]
        return [row for pair in zip(gaps, arrivals, strict=True) for row in pair]

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
        rows = self.residual(a, b)
        tape = Tape() if sum(e.count_ops() for e in rows) > LARGE else None
        if tape is None:
            gradients = [self._chained(lambda x, e=e: sympy.diff(e, x)) for e in rows]  # type: ignore[misc]
        else:
            rows = [tape.put(e) for e in rows]
            gradients = self._gradients(tape, rows)
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
        if tape is None:
            return self._shared(name, self._ends(), about, outputs, reduce=True)
        return self._listed(name, self._ends(), about, tape, outputs)

    def second(self, name: str, a: str, b: str) -> str:
        tape = Tape()
        rows = [tape.put(e) for e in self.residual(a, b)]
        m = len(rows)
        size = 2 * m + len(self.free)
        along = [own(f"q{i}") for i in range(size)]
        rates = self._rates(along) | dict(zip(self.free, along[2 * m :], strict=True))
        rates[PHASE] -= sum(
            (q * self.drift(free) for q, free in zip(along[2 * m :], self.free, strict=True)),
            sympy.S.Zero,
        )
        slopes = tape.along(rows, {x: tape.put(rate) for x, rate in rates.items()})
        outputs = [g for gradient in self._gradients(tape, slopes) for g in gradient]
        about = f"""Flight from wall {a} to wall {b}: second derivatives along a direction.

        The direction q is (t0, {self._names(self.start)}, t1, {self._names(self.end)},
        {", ".join(self.parameters)}). Returns, for each of the {m} residuals, the gradient of its
        derivative along q by the same {size} variables."""
        return self._listed(name, [*self._ends(), *along], about, tape, outputs)

    def third(self, name: str, a: str, b: str) -> str:
        tape = Tape()
        rows = [tape.put(e) for e in self.residual(a, b)]
        along = [own(f"q{i}") for i in range(2 * len(rows))]
        rates = {x: tape.put(rate) for x, rate in self._rates(along).items()}
        for _ in range(3):
            rows = tape.along(rows, rates)
        about = f"""Flight from wall {a} to wall {b}: third derivatives along a direction.

        The direction q is (t0, {self._names(self.start)}, t1, {self._names(self.end)}). Returns,
        for each residual, its third derivative along q."""
        return self._listed(name, [*self._ends(), *along], about, tape, rows)

    def _rates(self, along: Sequence[Any]) -> dict[Any, Any]:
        """What changes along a direction in (t0, y0, t1, y1), and how fast."""
        m = 1 + len(self.start)
        return {
            PHASE: along[0],
            DT: along[m] - along[0],
            **dict(zip(self.start, along[1:m], strict=True)),
            **dict(zip(self.end, along[m + 1 : 2 * m], strict=True)),
        }

    def motion(self, name: str, a: str) -> str:
        leave = self.leave(a)
        outputs = [DT * leave.mean[0], leave.end[0], leave.acceleration[0]]
        about = f"""Flight after wall {a}: the gap coordinate at the time dt after leaving.

        Returns its displacement from the wall, its velocity and its acceleration."""
        return self._shared(name, [T0, *self.start, DT], about, outputs, reduce=True)

    def setup(self, name: str) -> str:
        period, derived = self.equations.period, list(self.equations.derived.values())
        first, *further = self.free
        outputs = [
            period,
            sympy.diff(period, first),
            sympy.diff(period, first, 2),
            *self.equations.walls.values(),
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
        return self._shared(name, [], about, outputs)

    def harmonics(self, name: str) -> str:
        about = """Acceleration in flight where it depends on time alone.

        Returns its mean and then k, a_k, b_k for each harmonic a_k cos + b_k sin of 2 pi k t/T;
        a mean that is not a number says that the acceleration depends on the state."""
        return self._shared(name, [], about, self.equations.harmonics)

    def agreement(self, name: str, a: str, i: str) -> str:
        """Not kept in the cache: it is evaluated before any kernel is written."""
        leave, k = self.leave(a), int(i)
        outputs = [
            self.equations.period, leave.velocity[k], leave.mean[k], leave.end[k],
            leave.acceleration[k],
            self._sum_of_harmonics() if k == 0 else leave.acceleration[k],
        ]  # fmt: skip
        about = f"""Flight after wall {a}, coordinate {i}: what has to agree.

        Returns the period, the velocity after impact, mean velocity, end velocity, acceleration,
        and the sum of its harmonics."""
        return self._text(name, [PHASE, *self.start, DT], about, [], outputs, reduce=False)

    def _sum_of_harmonics(self) -> Any:
        """The acceleration by its harmonics, at the end of a flight; NaN where there are none."""
        constant, *rest = self.equations.harmonics
        angle = 2 * sympy.pi * (PHASE + DT) / self.equations.period
        waves = (
            a * sympy.cos(k * angle) + b * sympy.sin(k * angle)
            for k, a, b in zip(rest[::3], rest[1::3], rest[2::3], strict=True)
        )
        return sympy.Add(constant, *waves)

    # Printing.

    def _ends(self) -> list[Any]:
        return [T0, *self.start, T1, *self.end]

    def _names(self, symbols: Sequence[Any]) -> str:
        return ", ".join(_Printer().doprint(s) for s in symbols)

    def _shared(
        self, name: str, arguments: Sequence[Any], about: str, outputs: Sequence[Any],
        reduce: bool = False,
    ) -> str:  # fmt: skip
        """A kernel that computes what its outputs have in common once."""
        outputs = [sympy.sympify(e) for e in outputs]
        shared, reduced = sympy.cse(
            outputs, symbols=(own(f"w{i}") for i in itertools.count()),
            optimizations="basic", order="none",
        )  # fmt: skip
        return self._text(name, arguments, about, shared, reduced, reduce)

    def _listed(
        self, name: str, arguments: Sequence[Any], about: str, tape: Tape, values: Sequence[Any]
    ) -> str:  # fmt: skip
        """A kernel that makes the steps of a tape."""
        return self._text(name, arguments, about, *tape.listing(values), reduce=True)

    def _text(
        self, name: str, arguments: Sequence[Any], about: str, steps: Sequence[tuple[Any, Any]],
        outputs: Sequence[Any], reduce: bool,
    ) -> str:  # fmt: skip
        printer = _Printer()
        signature = self._names([*arguments, *self.equations.parameters.values()])
        used = set().union(*(e.free_symbols for e in (*outputs, *(e for _, e in steps))))
        lines = self._reduction(T1 in arguments, TURN in used) if reduce else []
        together, names = _together([*(e for _, e in steps), *outputs])
        for symbol, e in steps:
            lines.append(f"{printer.doprint(symbol)} = {printer.doprint(e.xreplace(names))}")
            if symbol in together:
                lines.append(together[symbol])
        results = ",\n    ".join(_as_float(printer.doprint(e.xreplace(names))) for e in outputs)
        doc = textwrap.indent(textwrap.dedent("        " + about), "    ").strip()
        body = "\n".join(f"    {line}" for line in lines)
        return (
            f'def {name}({signature}):\n    """{doc}\n    """\n{body}\n'
            f"    return (\n    {results},\n    )\n"
        )

    def _reduction(self, to_an_end: bool, turning: bool) -> list[str]:
        """The lines that take whole periods off the time."""
        period = _Printer().doprint(self.equations.period)
        lines = [f"phase = t0 % ({_as_float(period)})"]
        if turning:
            lines = [f"turn = floor(t0/({period}))", f"phase = t0 - turn*({period})"]
        return [*lines, "dt = t1 - t0"] if to_an_end else lines
