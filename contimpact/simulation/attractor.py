"""Attractors, and the cycles of impacts by which periodic ones are recognised."""

from __future__ import annotations

import enum
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..display import NotebookResult, ParameterItems, Summary, frame
from ..errors import InputError
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..orbits.status import multipliers
from ..results.branch import same_data
from ..schema import build_record
from ..segments.bounded import UNIT
from .run import Outcome, Run, State
from .simulator import Simulator


class Kind(enum.Enum):
    """What a motion is; the value is how files and pictures call it."""

    PERIODIC = "periodic"
    STICKING = "sticking"
    COMPLEX = "complex"
    NOT_SETTLED = "not settled"
    RESTING = "resting"
    NO_IMPACT = "no impact"
    RUNAWAY = "runaway"


IMPACT_COLUMNS: Mapping[str, Any] = {
    "walls": np.int8,
    "times": float,
    "velocities": float,
    "released": bool,
    "others": float,
    "held": np.int64,
}
"""Kinds of the columns of impacts that attractors and cycles have."""


@dataclass(frozen=True, eq=False)
class Attractor(ParameterItems, NotebookResult):
    """What was found at one set of parameter values."""

    kind: Kind
    parameters: Mapping[str, float]
    """All parameters and derived parameters."""
    notation: str
    """``2:1``, ``1:1/2T``, ``1:1/C`` for complex motion, or the kind."""
    forcing_period: float
    """T, in the unit of `times`."""
    word: str | None = None
    """Walls of one period, its first rotation in the order of the walls, as ``BBT``; a sojourn on a
    wall, with the accumulation of impacts that leads to it, is written ``B*``."""
    period: int | None = None
    """In forcing periods; 0 without forcing, where `span` is the time it takes."""
    walls: Array = field(default_factory=lambda: np.zeros(0, dtype=np.int8))
    times: Array = field(default_factory=lambda: np.zeros(0))
    velocities: Array = field(default_factory=lambda: np.zeros(0))
    released: Array = field(default_factory=lambda: np.zeros(0, dtype=bool))
    """`walls` to `released`, of shape (N,): impacts of one period from the word's first one on,
    whose time is in [0, T); for motions that are not periodic, of the last part of the run."""
    others: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """The other section coordinates (N, n), position and velocity of each coordinate but the one
    that the wall gives; n is zero for one degree of freedom."""
    held: Array = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """The walls against which the system rests before each impact, a bit for each, of shape (N,);
    of several degrees of freedom only."""
    multipliers: tuple[complex, ...] | None = None
    """The largest first."""
    exponents: tuple[float, ...] = (math.nan, math.nan)
    error: float = math.nan
    """`exponents`, `error`: Lyapunov exponents per impact, the largest first, and its standard
    error; of periodic motion NaN where rounding leaves nothing of the multiplier, which is then
    zero."""
    restitution: float = math.nan
    """Mean of ln r^2 over the impacts."""
    per_period: float = math.nan
    """The largest exponent per forcing period; without forcing per unit of time."""
    rate: float = math.nan
    """Impacts per forcing period; without forcing per unit of time."""
    smallest_gap: float = math.nan
    """Nearest to a wall that a flight comes without touching it; of periodic motions, and of those
    without impacts that are known."""
    closing: float = math.nan
    """By how much the period closes."""
    distance: float = math.nan
    """Of the motion from the periodic orbit when that was recognised."""
    periods: int = 0
    """Simulated until then."""
    state: State | None = None
    """From which a neighbour can start."""
    mode: str = ""
    """Of a motion without impacts, the mode in which it continues; empty in systems of one mode."""
    motion: tuple[float, ...] | None = None
    """Of such a motion, if it settles on one of the forcing's period, position and velocity of each
    coordinate at t = 0: the unknowns x0, v0, x1, v1, ... of an orbit of the word ``0``; without
    forcing where x0 is largest, or where it rests."""
    exponent_sum: float | None = None
    """Of periodic motion the sum of all exponents, from determinants, also where they are not known
    one by one; None where it is that of `exponents`."""
    span: float = math.nan
    """Without forcing, the time that one period takes; 0 at rest."""
    free: bool = False
    """Whether there is no forcing, so that phases do not tell motions apart."""
    model: Model | None = field(default=None, compare=False)
    """Its system at these values; None if it was read from a file."""

    @property
    def fastest(self) -> float:
        """The largest speed before an impact; zero without any."""
        return float(np.max(np.abs(self.velocities), initial=0.0))

    @property
    def stable(self) -> bool:
        """Whether it is a periodic motion all of whose multipliers are within the unit circle."""
        return self.multipliers is not None and max(map(abs, self.multipliers)) < 1.0

    @property
    def duration(self) -> float:
        """The time that one period takes."""
        return self.period * self.forcing_period if self.period else self.span

    @property
    def rests(self) -> bool:
        """Whether it is at an equilibrium of a system without forcing."""
        return self.free and self.span == 0.0

    @property
    def unknowns(self) -> Array:
        """Of a motion without impacts the unknowns of an orbit of the word ``0``: without forcing
        the period takes the place of v0."""
        found = np.array(self.motion, dtype=float)
        found[1] = self.span if self.free else found[1]
        return found

    @property
    def label(self) -> str:
        """What tells one kind of motion from another along a sweep."""
        if self.kind is Kind.NO_IMPACT:
            return self.notation
        if self.free:
            return self.word or self.kind.value
        return f"{self.word}/{self.period}T" if self.word else self.kind.value

    @property
    def settled(self) -> bool:
        """Whether it is known what the motion is."""
        return self.kind is not Kind.NOT_SETTLED

    @property
    def broken_off(self) -> str:
        """Where and why the simulation of one that has not settled ended by itself, if it did."""
        name, _, letter = self.notation.partition(" (")[2].rstrip(")").partition(" at ")
        known = not self.settled and name in Outcome.__members__
        return f"at {letter} {Outcome[name].value}" if known else ""

    def __eq__(self, other: object) -> bool:
        return same_data(self, other) if isinstance(other, Attractor) else NotImplemented

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        word = f" ({self.word})" if self.word else ""
        return f"<{self.notation}{word}, velocities {np.array2string(self.velocities[:8])}>"

    def summary(self) -> Summary:
        """Return its kind and its impacts in short."""
        rows = [(row["wall"], row["time"], row["velocity"]) for row in self._impacts()]
        title = f"Attractor {self.notation}: {self.kind.value}"
        title += f", period {self.span:.9g}" if self.span > 0.0 else ""
        notes = [", ".join(f"{name} = {value:.9g}" for name, value in self.parameters.items())]
        return Summary(title, ("wall", "time", "velocity before impact"), rows, notes)

    def to_dataframe(self) -> Any:
        """Return the impacts as a pandas DataFrame, a row for each; pandas must be installed."""
        return frame(self._impacts())

    def _impacts(self) -> list[dict[str, Any]]:
        letters = self.model.letters if self.model else ()
        return [
            {"wall": letters[wall] if letters else wall, "time": time, "velocity": velocity}
            for wall, time, velocity in zip(
                self.walls.tolist(), self.times.tolist(), self.velocities.tolist(), strict=True
            )
        ]

    def require_model(self, model: Model | None = None) -> Model:
        """Return a model at the attractor's values: one that is given, or its own.

        Raises InputError if there is none, or it has other parameters.
        """
        model = model or self.model
        if model is None:
            found = "missing: an attractor in a file does not name its system"
            raise InputError("model", found, "give the model it was simulated with as model=")
        if lacking := [name for name in model.values if name not in self.parameters]:
            found = f"an attractor without {', '.join(lacking)}"
            raise InputError("model", found, "give the model it was simulated with")
        return model.replace(**{name: self.parameters[name] for name in model.values})

    @property
    def accumulates(self) -> bool:
        """Whether there are infinitely many impacts, so that the last before a sojourn vanish;
        without restitution a wall is held from the first impact on."""
        if not (self.released.any() or self.held.any()):
            return False
        speeds = np.abs(self.velocities[~self.released])
        return bool(np.any(speeds < VANISHING * np.max(speeds, initial=0.0)))

    def orbit(self, model: Model | None = None, parameter: str | None = None) -> Orbit:
        """Return a periodic motion as an orbit, which can be followed.

        Raises InputError if the motion is no orbit of impacts, or the system another one.

        Parameters
        ----------
        model : Model, optional
            Its system, where it was read from a file; parameter values are the attractor's.
        parameter : str, optional
            That may be followed; the model's first one by default.
        """
        from ..results.branch import orbit_with

        if self.kind is not Kind.PERIODIC or self.word is None or self.period is None:
            accepted = "give one that is periodic; plot_sweep and portraits show any motion"
            raise InputError("attractor", f"found {self.label}", accepted)
        at = self.require_model(model)
        followed = parameter or next(iter(at.values))
        times = self.times - self.span if self.free else self.times
        unknowns = np.append(impact_table(times, self), at.values[followed])
        return orbit_with(at, (self.word, self.period), followed, unknowns)

    def as_record(self) -> dict[str, Any]:
        """Return plain data from which `from_record` makes the same attractor."""
        record = {f.name: getattr(self, f.name) for f in fields(self) if f.compare}
        record |= {"kind": self.kind.name, "parameters": dict(self.parameters)}
        record["state"] = asdict(self.state) if self.state else None
        record |= {name: getattr(self, name).tolist() for name in IMPACT_COLUMNS}
        if not self.held.size:
            del record["others"], record["held"]
        if self.multipliers is not None:
            record["multipliers"] = [[mu.real, mu.imag] for mu in map(complex, self.multipliers)]
        return record

    @staticmethod
    def from_record(record: Mapping[str, Any]) -> Attractor:
        """Return the attractor a record was made of."""
        given = dict(record)
        for name in IMPACT_COLUMNS.keys() & record.keys():
            given[name] = np.array(given[name], dtype=IMPACT_COLUMNS[name])
        if given["multipliers"] is not None:
            given["multipliers"] = tuple(complex(*mu) for mu in given["multipliers"])
        return build_record(Attractor, given)

    def require(self, model: Model) -> None:
        """Raise `ValueError` if this cannot be an attractor of a model."""
        impacts = (self.walls, self.times, self.velocities, self.released)
        if {column.shape for column in impacts} != {(len(self.walls),)}:
            raise ValueError("impacts that are no table")
        if lacking := [n for n in (*model.values, *model.DERIVED) if n not in self.parameters]:
            raise ValueError(f"an attractor without {', '.join(lacking)}")
        walls, state = self.walls.tolist(), self.state
        width = model.unknowns_per_impact - 2
        if len(self.exponents) not in (2, 2 + width - int(self.free)):
            raise ValueError("another number of exponents")
        whole = (len(walls), width), (len(walls),)
        if width and walls and (self.others.shape, self.held.shape) != whole:
            raise ValueError("impacts without all coordinates")
        if self.motion is not None and len(self.motion) != width + 2:
            raise ValueError("a motion without all coordinates")
        numbers = [*self.times, *self.velocities, *self.others.ravel(), self.forcing_period]
        numbers += self.motion or ()
        if state is not None:
            walls.append(state.wall)
            numbers += [state.phase, *state.section]
            if len(state.others) != width:
                raise ValueError("a state without all coordinates")
            if not 0.0 <= state.phase <= self.forcing_period:
                raise ValueError(f"a phase of {state.phase:.6g}")
        if not all(0 <= wall < len(model.WALLS) for wall in walls):
            raise ValueError("an impact on a wall that is not there")
        if not np.isfinite(numbers).all():
            raise ValueError("impacts that are not finite")


# Cycles of the simulated map: where a motion repeats itself, and Newton's iteration for it.

VANISHING = 1e-6
"""Part of the fastest impact's speed below which impacts accumulate where a motion sticks."""
CLOSED = 1e-15
"""A cycle that misses itself by less, in parts of its size, is closed; one that misses it by no
more than `ROUNDED` is where Newton's iteration gains nothing."""
ROUNDED = 1e-11

STRETCHES = 2.0
"""A multiplier of the map from a state that is near no attracting cycle."""
NEAR = 1e-4
"""A motion this close to an earlier impact may be periodic; in periods and largest velocities."""
SLIGHT = 1e-3
"""Section coordinates that are less than this part of their natural size are not told apart by
their own: units may differ, and velocities at a turning point are rounding."""


@dataclass(frozen=True, eq=False)
class Cycle:
    """One period of a motion that repeats itself.

    The N times are from the start of the first impact's period, which is in forcing periods. The
    multipliers, the largest first, are those of the map over the period; of one degree of freedom
    both are zero if the body sticks. `closing` is by how much the last impact misses the first,
    `others` (N, n) the other section coordinates (n is zero for one degree of freedom), `held` the
    walls held before each row, of several degrees of freedom. Without forcing the period is 0, and
    takes the time `span`.
    """

    walls: Array
    times: Array
    velocities: Array
    released: Array
    period: int
    multipliers: tuple[complex, ...]
    closing: float
    others: Array = field(default_factory=lambda: np.zeros((0, 0)))
    held: Array = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    span: float = math.nan

    def duration(self, forcing_period: float) -> float:
        """Return the time that its period takes."""
        return self.period * forcing_period if self.period else self.span

    def state(self, forcing_period: float) -> State:
        """Return a state on the cycle: its fastest impact."""
        k = int(np.argmax(np.abs(self.velocities)))
        state = State(int(self.walls[k]), float(self.times[k]), float(self.velocities[k]))
        if self.held.size:
            others = tuple(self.others[k].tolist())
            state = replace(state, others=others, held=int(self.held[k]))
        return replace(state.within(forcing_period), turns=0)

    def rows(self, forcing_period: float) -> list[State]:
        """Return its impacts, the first one once more at the end."""
        others = [tuple(row) for row in self.others.tolist()] or [()] * len(self.walls)
        columns = self.walls.tolist(), self.times.tolist(), self.velocities.tolist(), others
        found = [
            State(wall, time, velocity, others=more).within(forcing_period)
            for wall, time, velocity, more in zip(*columns, strict=True)
        ]
        if self.period:
            return [*found, replace(found[0], turns=found[0].turns + self.period)]
        end = replace(found[0], phase=found[0].phase + self.span)
        return [*found, end.within(forcing_period)]


# Motion that rests on a wall for a part of its period keeps its other coordinates, so that it need
# not repeat itself at once: it has a cycle when its sojourns agree. With one coordinate it keeps
# nothing, and repeats itself exactly.

NOTHING = 1e-14
"""Multipliers below this are zero where a wall is held: what it held is forgotten."""


def map_derivatives(simulator: Simulator, states: Sequence[State], along: bool = False) -> Array:
    """Return the derivatives of the map from each of some states to the next; without forcing of
    the return map of sections, which no time enters."""
    free = int(simulator.model.autonomous)
    return np.asarray(simulator.derivatives(states, along))[:, free:, free:]


def solve_cycle(
    simulator: Simulator,
    state: State,
    impacts: int,
    period: int,
    *,
    direct: bool = False,
    attracting: bool = False,
) -> Cycle | None:
    """Solve for the cycle near a state by Newton's iteration on the simulated map.

    The state is at an impact; the period is in forcing periods, 0 without forcing. None if the
    iteration leaves the word or does not converge, or is not `direct` where it has to be: its
    second step is then at most half of the first, as where the state's own cycle has moved to, and
    it crosses no singular derivative, beyond which it would lead to another cycle of a pitchfork.
    Nor is it begun where the state would have to be near an `attracting` cycle, and the map around
    stretches.
    """
    best, word, first, side = math.inf, None, math.inf, 0.0
    for count in range(12):
        run = simulator.run(state, impacts=impacts)
        walls, end = run.walls.tolist(), run.end
        left = len(run) < impacts or _rests(run) or word not in (None, walls)
        if left or end is None or end.wall != state.wall:
            return None
        word = walls
        late = (end.turns - state.turns - period) * simulator.period + end.phase - state.phase
        miss = np.array([late, *np.subtract(end.section, state.section)])
        sizes = natural_sizes([state.section], simulator.period, run.free)
        size = float(np.max(np.abs(miss) / sizes))
        rows = [state, *run.states()]
        if size < CLOSED or (size >= 0.5 * best and size < ROUNDED):
            mus = _multipliers(simulator, rows)
            return _cycle_of_states(run, rows, period, mus, size)
        around = _derivative_around(map_derivatives(simulator, rows, along=True))
        if attracting and count == 0 and _stretches(around):
            return None
        newton = _newton_step(around, miss)
        if size > 10.0 * best or newton is None:
            return None
        step, sign = newton
        if direct and sign * side < 0.0:
            return None
        if direct and count < 2:
            length = float(np.max(np.abs(step) / sizes))
            if length > 0.5 * first:
                return None
            first, side = length, sign
        best = min(best, size)
        state = _moved(state, step, simulator.period)
        if state.velocity * simulator.sides[state.wall] <= 0.0:
            return None
    return None


def _stretches(around: Array) -> bool:
    """Whether the map around is that of no attracting cycle near."""
    known = np.all(np.isfinite(around))
    return bool(known and np.max(np.abs(np.linalg.eigvals(around))) > STRETCHES)


def _moved(state: State, step: Sequence[float], period: float) -> State:
    """A state with another time and section."""
    section = np.add(state.section, step[1:]).tolist()
    moved = State(state.wall, state.phase + step[0], section[0], others=tuple(section[1:]))
    return replace(moved.within(period), turns=0)


def stable_cycle_beside(simulator: Simulator, cycle: Cycle) -> Cycle | None:
    """Return the stable cycle near one that a real multiplier makes unstable, of twice its period
    if that is negative; None if there is none. Newton's iteration begins in the direction of the
    multiplier, nearer and nearer."""
    mu, m = complex(cycle.multipliers[0]), len(cycle.multipliers)
    if mu.imag or abs(mu) <= 1.0:
        return None
    rows = cycle.rows(simulator.period)
    around = _derivative_around(map_derivatives(simulator, rows, along=True))
    if not np.all(np.isfinite(around)):
        return None
    found, vectors = np.linalg.eig(around)
    way = np.zeros(simulator.model.unknowns_per_impact)
    way[len(way) - m :] = vectors[:, np.argmin(np.abs(found - mu))].real
    sizes = natural_sizes([rows[0].section], simulator.period, simulator.model.autonomous)
    way /= np.max(np.abs(way) / sizes)
    times = 2 if mu.real < 0.0 else 1
    about = times * len(cycle.walls), times * cycle.period
    for size in AMPLITUDES:
        start = _moved(rows[0], size * way, simulator.period)
        beside = solve_cycle(simulator, start, *about, direct=True)
        if beside is not None:
            new = repetitions_of(beside, simulator.period) == 1
            return beside if new and abs(beside.multipliers[0]) < 1.0 else None
    return None


def natural_sizes(sections: Any, period: float, free: bool = False) -> Array:
    """Of times and section coordinates, shape (N, m): the period, the largest velocity, and for
    positions what it is in a wave of the forcing. Times that are free are infinitely large, so that
    motions that differ in them alone do not differ."""
    sections = np.asarray(sections)
    sizes = np.full(1 + sections.shape[1], np.max(np.abs(sections[:, ::2]), initial=0.0) or 1.0)
    sizes[::2] *= period / (2.0 * math.pi)
    sizes[0] = math.inf if free else period
    return sizes


def _derivative_around(derivatives: Array) -> Array:
    """The product of derivatives from impact to impact, which may not be finite."""
    product = np.eye(derivatives.shape[1])
    with np.errstate(over="ignore", invalid="ignore"):
        for derivative in derivatives:
            product = derivative @ product
    return product


def _newton_step(around: Array, miss: Array) -> tuple[list[float], float] | None:
    """Solve (M - I) step = -miss, with the derivative M of the map around; times that it leaves out
    stay as they are. Returns the step, and the sign of det(M - I)."""
    unit = np.eye(len(around))
    free = len(miss) - len(unit)
    if not np.all(np.isfinite(around)):
        return None
    try:
        step = np.linalg.solve(around - unit, -miss[free:])
    except np.linalg.LinAlgError:
        return None
    if not np.all(np.isfinite(step)):
        return None
    return [0.0] * free + step.tolist(), float(np.linalg.slogdet(around - unit)[0])


def _shortest_closed(simulator: Simulator, run: Run, impacts: int) -> Cycle | None:
    """The cycle of so many impacts near the end of a run, or of fewer if that repeats itself."""
    k = len(run) - impacts + int(np.argmax(np.abs(run.velocities[-impacts:])))
    others = tuple(run.others[k].tolist()) if run.others.size else ()
    base = State(int(run.walls[k]), float(run.phases[k]), float(run.velocities[k]), others=others)
    turned = run.times[-1] - run.times[-1 - impacts]
    periods = _periods_in(run, float(turned))
    cycle = solve_cycle(simulator, base, impacts, periods, attracting=True)
    if cycle is None:
        return None
    parts = repetitions_of(cycle, simulator.period)
    if parts == 1:
        return cycle
    state = cycle.state(simulator.period)
    return solve_cycle(simulator, state, impacts // parts, cycle.period // parts)


def _periods_in(run: Run, time: float) -> int:
    """Forcing periods in the time that a cycle takes; 0 without forcing."""
    return 0 if run.free else round(time / run.period)


AMPLITUDES = 0.5 ** np.arange(3, 25)
"""Distances from an unstable cycle, in natural sizes, at which a stable one is looked for."""
LINEAR = 0.1
"""Part of its distance from a cycle by which a motion may miss what the cycle's derivative says, so
that Newton's iteration leads there: beside a fold the other cycle is ten times as far, beside a
doubling the doubled one three times."""


@dataclass(frozen=True, eq=False)
class Unstable:
    """A cycle that was solved for and is not stable, with the derivatives of the map along it."""

    cycle: Cycle
    derivatives: Array

    def leads_here(self, run: Run, first: int) -> bool:
        """Whether Newton's iteration on the last part of a run, from a row on, leads to it: a step
        with its own derivative does, and what is left is not that of another cycle."""
        cycle, last = self.cycle, len(run) - 1
        times, rest = divmod(last - first, len(cycle.walls))
        if rest:
            return False
        table, sizes = _table(run), _sizes(run)
        offs = table[first] - impact_table(cycle.times, cycle)
        k = int(np.argmin(states_apart(offs, sizes)))
        if not np.array_equal(np.tile(np.roll(cycle.walls, -k), times), run.walls[first:last]):
            return False
        off = offs[k]
        off[0] -= run.period * round(off[0] / run.period)
        miss = table[last] - table[first]
        miss[0] = run.times[last] - run.times[first] - times * cycle.period * run.period
        once = _derivative_around(np.roll(self.derivatives, -k, axis=0))
        with np.errstate(over="ignore", invalid="ignore"):
            step = _newton_step(np.linalg.matrix_power(once, times), miss)
        if step is None:
            return False
        before, after = (np.max(np.abs(d) / sizes) for d in (off, off + step[0]))
        return bool(after < LINEAR * before)


def cycle_near(
    simulator: Simulator, run: Run, longest: int, unstable: dict[int, Unstable]
) -> tuple[Cycle, float] | None:
    """Return the stable cycle near the end of a run, and the distance to it.

    Those found that are not stable, the last of each number of impacts, are kept in `unstable`, and
    not solved for again.
    """
    if _rests(run):
        return sticking_cycle(simulator, run)
    if not len(run):
        return None  # the motion has left all guards
    table, last = _table(run), len(run) - 1
    early = np.arange(max(0, last - longest), last)
    apart = states_apart(table[early] - table[last], _sizes(run))
    apart[run.walls[early] != run.walls[last]] = np.inf
    near = early[apart < NEAR][::-1]
    repeating = [back for back in near if repeats(run.walls, int(last - back))]
    for back in (repeating or near)[:3]:
        if any(known.leads_here(run, int(back)) for known in unstable.values()):
            continue
        cycle = _shortest_closed(simulator, run, int(last - back))
        if cycle is None:
            continue
        if abs(cycle.multipliers[0]) < 1.0:
            return cycle, _distance(run, cycle)
        derivatives = map_derivatives(simulator, cycle.rows(simulator.period), along=True)
        unstable[len(cycle.walls)] = Unstable(cycle, derivatives)
    return None


def _rests(run: Run) -> bool:
    return bool((run.held if run.held.size else run.released).any())


def repeats(walls: Array, length: int) -> bool:
    """Whether walls repeat themselves after a length: the later half of them, at least twice."""
    later = walls[-max(2 * length, len(walls) // 2) :]
    return 2 * length <= len(walls) and np.array_equal(later[length:], later[:-length])


def sticking_cycle(simulator: Simulator, run: Run) -> tuple[Cycle, float] | None:
    """Return the cycle of a motion that rests on walls, if it has one, and the distance from it."""
    if not run.held.size:
        return _cycle_of_releases(simulator, run)
    sojourns = np.nonzero(run.held)[0]
    if not len(sojourns):
        return None
    table, last = _table(run), int(sojourns[-1])
    earlier = sojourns[:-1]
    apart = states_apart(table[earlier] - table[last], _sizes(run))
    marks = np.column_stack([run.walls, run.held, run.released])
    apart[np.any(marks[earlier] != marks[last], axis=1)] = np.inf
    for first in earlier[apart < NEAR][::-1][:1].tolist():
        rows = run.states()[first : last + 1]
        mus = tuple(mu if abs(mu) > NOTHING else 0j for mu in _multipliers(simulator, rows))
        if abs(mus[0]) < 1.0 and not rounding_fills(simulator, rows):
            miss = float(states_apart(table[[first]] - table[last], _sizes(run))[0])
            period = _periods_in(run, rows[-1].since(rows[0], run.period))
            return _cycle_of_states(run, rows, period, mus, miss), miss / (1.0 - abs(mus[0]))
    return None


def _cycle_of_releases(simulator: Simulator, run: Run) -> tuple[Cycle, float] | None:
    """The cycle of one coordinate that sticks: released twice at one phase, it repeats itself. If
    rounding makes the motion between, other digits lead to another cycle, and there is none."""
    releases = np.nonzero(run.released)[0]
    for first in releases[:-1][::-1]:
        last = releases[-1]
        if run.walls[first] == run.walls[last] and run.phases[first] == run.phases[last]:
            rows = slice(first, last)
            times = (run.turns[rows] - run.turns[first]) * run.period + run.phases[rows]
            columns = (run.walls[rows], times, run.velocities[rows], run.released[rows])
            if rounding_fills(simulator, run.states()[first : last + 1]):
                return None
            return Cycle(*columns, int(run.turns[last] - run.turns[first]), (0.0, 0.0), 0.0), 0.0
    return None


def rounding_fills(simulator: Simulator, states: Sequence[State]) -> bool:
    """Return whether rounding grows to all of a motion, of one coordinate between two releases,
    which forget it. A flight that alone does so ends with a touch, on which nothing depends."""
    free, sections = int(simulator.model.autonomous), np.array([state.section for state in states])
    sizes = own_sizes(sections, simulator.period)[free:]
    limit, one = NEAR / UNIT, np.eye(len(sizes))[None]
    products = one
    for before, after in itertools.pairwise(states):
        if before.released and len(sizes) == 2:
            products = one
            continue
        with np.errstate(all="ignore"):
            step = np.array(simulator.derivative(before, after))[free:, free:]
            step = step * sizes / sizes[:, None]
            grown = step @ products
        if not np.max(np.abs(step)) < limit:
            products = one
            continue
        if np.max(np.abs(grown)) > limit:
            return True
        products = grown
        if before.released:
            products = np.concatenate([products, one])
    return False


def impact_table(times: Array, rows: Run | Cycle | Attractor) -> Array:
    """Times or phases, and section coordinates."""
    return np.column_stack([times, rows.velocities, *rows.others.T])


def _table(run: Run) -> Array:
    """Phases and section coordinates."""
    return impact_table(run.phases, run)


def own_sizes(sections: Array, period: float, free: bool = False) -> Array:
    """Of times and section coordinates, shape (N, m): the period, and the largest there are. What
    is less than `SLIGHT` of its natural size has that part of it: it may be rounding alone."""
    natural = natural_sizes(sections, period, free)
    largest = np.max(np.abs(sections), axis=0)
    return np.append(natural[0], np.maximum(largest, SLIGHT * natural[1:]))


def _sizes(run: Run) -> Array:
    return own_sizes(_table(run)[:, 1:], run.period, run.free)


def states_apart(difference: Array, sizes: Array) -> Array:
    """Distances of rows of a table, phases on the circle."""
    found = difference / sizes
    found[:, 0] -= np.round(found[:, 0])
    return np.asarray(np.max(np.abs(found), axis=1))


def _distance(run: Run, cycle: Cycle) -> float:
    """Distance from the run's last impact to a cycle."""
    apart = states_apart(impact_table(cycle.times, cycle) - _table(run)[-1], _sizes(run))
    return float(np.min(apart[cycle.walls == run.walls[-1]], initial=math.inf))


def repetitions_of(cycle: Cycle, period: float) -> int:
    """How many times a cycle runs through a shorter one."""
    n, table = len(cycle.walls), impact_table(cycle.times, cycle)
    sizes = own_sizes(table[:, 1:], period, not cycle.period)
    for parts in range(cycle.period or n, 1, -1):
        if n % parts or cycle.period % parts:
            continue
        shift = n // parts
        same_walls = np.array_equal(np.roll(cycle.walls, -shift), cycle.walls)
        if (
            same_walls
            and np.max(states_apart(np.roll(table, -shift, axis=0) - table, sizes)) < 1e-7
        ):
            return parts
    return 1


def _multipliers(simulator: Simulator, rows: Sequence[State]) -> tuple[complex, ...]:
    """Of the map around, the largest first."""
    derivatives = map_derivatives(simulator, rows)
    if not np.all(np.isfinite(derivatives)):
        return (complex(math.inf),) * derivatives.shape[1]
    sizes = natural_sizes([rows[0].section], simulator.period)[-derivatives.shape[1] :]
    sizes = np.exp2(np.round(np.log2(sizes)))
    derivatives = derivatives * sizes / sizes[:, None]
    back = np.broadcast_to(-np.eye(derivatives.shape[1]), derivatives.shape)
    return tuple(complex(mu) for mu in multipliers(derivatives, back))


def _cycle_of_states(
    run: Run, rows: Sequence[State], period: int, mus: tuple[complex, ...], miss: float
) -> Cycle:
    """The cycle of rows, the last of which is the first one again."""
    begun, rows, end = rows[0].turns, rows[:-1], rows[-1]
    more: dict[str, Any] = {"span": end.since(rows[0], run.period)} if run.free else {}
    if run.held.size:
        more["others"] = np.array([row.others for row in rows]).reshape(len(rows), -1)
        more["held"] = np.array([row.held for row in rows], dtype=np.int64)
    return Cycle(
        np.array([row.wall for row in rows], dtype=np.int8),
        np.array([(row.turns - begun) * run.period + row.phase for row in rows]),
        np.array([row.velocity for row in rows]),
        np.array([row.released for row in rows]),
        period,
        mus,
        miss,
        **more,
    )


OTHER = 1e3
"""More than any distance between attractors: that of different motions."""
POINTS = 200
"""Impacts of an attractor that are compared."""


def distances_between(
    one: Attractor, other: Attractor, points: int = POINTS, of: Callable[[Array], Any] = np.mean
) -> tuple[float, float]:
    """The mean distance of the impacts of an attractor from those of another one, and the reverse;
    or the largest one, or another number of the distances.

    An attractor of which only a part was visited is near to all of it, not the reverse.
    """
    from scipy.spatial import cKDTree

    if not len(one.times) or not len(other.times):
        return (OTHER, OTHER) if len(one.times) or len(other.times) else (0.0, 0.0)
    fastest = max(one.fastest, other.fastest) or 1.0
    clouds = [_cloud(a, fastest, points) for a in (one, other)]
    first, second = (float(of(cKDTree(clouds[1 - k]).query(clouds[k])[0])) for k in (0, 1))
    return first, second


def spacing(attractor: Attractor) -> float:
    """The mean distance of the same impacts of an attractor from the nearest others of them."""
    from scipy.spatial import cKDTree

    if len(attractor.times) < 2:
        return 0.0
    cloud = _cloud(attractor, attractor.fastest or 1.0, POINTS)
    return float(np.mean(cKDTree(cloud).query(cloud, k=2)[0][:, 1]))


def _cloud(attractor: Attractor, fastest: float, points: int) -> Array:
    """Impacts as points: the phase on a circle of circumference one, unless it is free, velocity,
    wall."""
    every = max(1, len(attractor.times) // points)
    turns = attractor.times[::every] / attractor.forcing_period
    angle = 0.0 * turns if attractor.free else 2.0 * np.pi * turns
    circle = np.column_stack([np.cos(angle), np.sin(angle)]) / (2.0 * np.pi)
    velocity = attractor.velocities[::every] / fastest
    walls = attractor.walls[: len(attractor.times)][::every].astype(float)
    return np.column_stack([circle, velocity, walls])
