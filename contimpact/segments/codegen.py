"""SymPy formulas of a model -> the Python source of one kernel.

Importing this module imports SymPy; `contimpact.segments.kernels` does so only when a kernel is
not in its cache. A kernel is straight-line arithmetic on floats, with a loop over a forcing's
harmonics where these are many, so it runs as it stands, on NumPy arrays, and under a compiler for
the plain subset of Python.
"""

from __future__ import annotations

import functools
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

import sympy

from ..models.equations import Departure, along, equations_of, state_symbols
from ..models.linear import MeanFlow, law_of, rows_of
from ..models.model import Model
from ..models.nonlinear import Flown
from ..models.symbols import DT, PHASE, T0, T1, TURN, over_harmonics
from .layout import SECTION, Setup, flat, refilled, result_text
from .printing import Printer, as_float, common, looped, printed_steps
from .tape import Tape

LARGE = 300
"""Operations of a flight up to which its derivatives are written out and searched for common
factors: that takes more than twice as long for twice as many, and saves a fifth of them. Of linear
flights, which spend their time in `flow`, none are."""


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
        """Return the source of the kernel `name`: ``setup``, ``harmonics``, ``surfaces``,
        ``flight_<a>_<b>``, ``motion_<a>``, ``states_<a>``, ``since_<a>``, ``gap_<a>_<b>``,
        ``law_<a>``, ``field_<a>``, ``loss_<a>`` or ``agreement_<a>_<coordinate>``."""
        kind, *walls = name.split("_")
        writers: dict[str, Callable[..., str]] = {
            "setup": self.setup,
            "surfaces": self.surfaces,
            "harmonics": self.harmonics,
            "flight": self.flight,
            "motion": self.motion,
            "states": self.states,
            "since": self.since,
            "gap": self.gap,
            "law": self.law,
            "field": self.field,
            "loss": self.loss,
            "agreement": self.agreement,
        }
        return writers[kind](name, *walls)

    def residual(self, a: str, b: str) -> list[Any]:
        """Arrival minus embedding, gap coordinate first.

        Between two impacts on one surface the gap equation is divided by the flight's duration: the
        flight of zero duration would solve it whatever the state.
        """
        rows = self.arrivals(self.leave(a), b)
        if self.equations.returns(a, b):
            rows[0] = along(self.equations.pivot(b)[1], self.leave(a).mean)
        return rows

    def arrivals(self, leave: Departure, b: str) -> list[Any]:
        """The same without a division."""
        place, row = self.equations.pivot(b)
        gap = along(row, leave.now) - self.equations.walls[b]
        rows = [gap, along(row, leave.end) - self.end[0]]
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
        speed, force = along(row, leave.end), along(row, leave.acceleration)
        away = sympy.S.Zero
        if not self.equations.returns(a, a):
            away = along(row, leave.position) - self.equations.walls[a]
        outputs = (away + DT * along(row, leave.mean), speed, force)
        about = f"""Flight after wall {a}: the gap coordinate at the time dt after leaving.

        Returns its displacement from the wall, its velocity and its acceleration."""
        return self._shared(name, [T0, *self.start, DT], about, outputs, reduce=True)

    def states(self, name: str, a: str) -> str:
        leave = self.leave(a)
        outputs = tuple(e for pair in zip(leave.now, leave.end, strict=True) for e in pair)
        about = f"""Flight after wall {a}: position and velocity of each coordinate at the time dt
        after leaving."""
        return self._shared(name, [T0, *self.start, DT], about, outputs, reduce=True)

    def since(self, name: str, b: str) -> str:
        leave, (_, row) = self.equations.quiet, self.equations.pivot(b)
        states = leave.now, leave.end, leave.acceleration
        outputs = tuple(
            sympy.sympify(along(row, state)).xreplace({PHASE: sympy.S.Zero}) for state in states
        )
        about = f"""The gap coordinate of wall {b} at the time dt since the section t = 0.

        Returns its position, its velocity and its acceleration."""
        return self._shared(name, [*self.equations.state, DT], about, outputs)

    def gap(self, name: str, a: str, b: str) -> str:
        leave, (_, row) = self.leave(a), self.equations.pivot(b)
        outputs = tuple(along(row, e) for e in (leave.now, leave.end, leave.acceleration))
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
                lost = sum(d * along(row, total) for d, row in zip(change, one, strict=True)) / 2
            else:
                energies = (
                    sum(v * along(row, ends) for v, row in zip(ends, matrix, strict=True)) / 2
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
        begins = self.equations.begins
        found = tuple(
            sympy.Integer((1 if back(a, b) else 2 * lands(a, b)) + 4 * begins(a, b))
            for a in letters
            for b in letters
        )
        about = f"""Which flights end on the surface that they leave: 1; or 2 where that is so of
        those that a touch starts, or else 0. And 4 more where the flight begins on the surface with
        a rate of either sign, or 8 where without any.

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
        outputs, loops = looped((self.equations.period, *velocities, acceleration, summed))
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
        outputs, loops = looped(outputs)
        shared, reduced = common([sympy.sympify(e) for e in flat(outputs)], "w")
        return self._text(name, arguments, about, shared, refilled(outputs, reduced), reduce, loops)

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
        found, loops = looped((*(e for _, e in steps), *values))
        steps = [(symbol, e) for (symbol, _), e in zip(steps, found, strict=False)]
        outputs = refilled(outputs, found[len(steps) :])
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
        used = set().union(*(e.free_symbols for e in (*values, *(e for _, e in steps))))
        lines = self._reduction(T1 in arguments, TURN in used) if reduce else []
        found, printed = printed_steps(steps, values)
        lines += [*loops, *found]
        printed = [as_float(text) for text in printed]
        doc = textwrap.indent(textwrap.dedent("        " + about), "    ").strip()
        body = "\n".join(f"    {line}" for line in lines)
        return (
            f'def {name}({signature}):\n    """{doc}\n    """\n{body}\n'
            f"    return {result_text(refilled(outputs, printed))}\n"
        )

    def _reduction(self, to_an_end: bool, turning: bool) -> list[str]:
        """The lines that take whole periods off the time."""
        period = Printer().doprint(self.equations.period)
        lines = [f"phase = t0 % ({as_float(period)})"]
        if turning:
            lines = [f"turn = floor(t0/({period}))", f"phase = t0 - turn*({period})"]
        return [*lines, "dt = t1 - t0"] if to_an_end else lines
