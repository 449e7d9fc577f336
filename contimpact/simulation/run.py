"""The loops from impact to impact, and what a simulation returns."""

from __future__ import annotations

import collections
import enum
import functools
import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, TypeAlias

import numpy as np

from ..arrays import INTEGERS, VECTOR, Array, Vector
from ..display import NotebookResult, ParameterItems, Summary, frame, limit_lines
from ..errors import InputError, count_text
from ..models.guards import pivot, slides_at
from ..models.model import Guard, Model
from ..segments.compiling import CompiledProgram, load, mode, timed_plainly
from ..segments.kernels import Kernels
from ..segments.segment import ELSEWHERE, Kernel, Passages
from ..segments.touches import margin

if TYPE_CHECKING:
    from ..segments.machine_code import Program

Call: TypeAlias = Callable[[Array, Array, Array], int]
"""Compiled code for a batch: guards, turns and outcomes; phases, section coordinates and the speeds
beyond which motions run away; and limits, as of `make_flights`, motion after motion."""


class OutsideError(InputError):
    """A start lies beyond a wall."""


class Outcome(enum.Enum):
    """Why a run ended; the value is a sentence."""

    DONE = "made as many impacts, or ran as many periods, as it was asked to"
    RESTING = "the body rests on a wall, which the acceleration never leaves"
    NO_IMPACT = "the body flew on without an impact for as long as a flight may last"
    RUNAWAY = "the motion runs away: it is a million times faster than its start and its forcing"
    ACCUMULATING = "impacts accumulate where no wall can be held: see the docs on sticking"
    BEYOND = (
        "a jump led behind a guard of the next mode, where the system does not say how to go on"
    )
    UNDEFINED = "the law of motion is no finite number where the motion leads"


OUTCOMES = tuple(Outcome)
"""Outcomes by their numbers in `contimpact.simulation.run`."""


@dataclass(frozen=True)
class State:
    """The body at a wall just before an impact, or at rest there if the velocity is zero."""

    wall: int
    """Number of the wall, in the model's order."""
    phase: float
    """Time in [0, T)."""
    velocity: float
    """Before the impact, towards the wall."""
    turns: int = 0
    """Whole periods passed."""
    others: tuple[float, ...] = ()
    """The other section coordinates, in systems of several degrees of freedom: position and
    velocity of each coordinate but the one that the wall gives."""
    held: int = 0
    """The walls against which the system rests until then, a bit 2^k for wall number k; of several
    degrees of freedom only."""
    released: bool = False
    """Whether it is released here and does not hit; likewise."""

    @property
    def section(self) -> tuple[float, ...]:
        """All section coordinates."""
        return (self.velocity, *self.others)

    @property
    def speed(self) -> float:
        """The largest of its velocities."""
        return float(np.max(np.abs(self.section[::2])))

    def since(self, earlier: State, period: float) -> float:
        """Return the time from an earlier state to this one."""
        return (self.turns - earlier.turns) * period + self.phase - earlier.phase

    def flight_to(self, later: State, period: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return the unknowns of the flight to a later state, from the start of this one's period:
        those where it leaves, and those where it arrives."""
        end = self.phase + later.since(self, period)
        return (self.phase, *self.section), (end, *later.section)

    def within(self, period: float) -> State:
        """Return the same with a phase in [0, T) and as many more turns as it had."""
        phase, passed = wrap_time(self.phase, period)
        return replace(self, phase=phase, turns=self.turns + passed)


@dataclass(frozen=True, eq=False)
class Run(ParameterItems, NotebookResult):
    """The result of a simulation, a row per impact or release."""

    letters: tuple[str, ...]
    """Names of the walls."""
    period: float
    """Forcing period T; without forcing the natural time in which turns are counted."""
    walls: Array
    """Number of the wall hit, shape (N,)."""
    turns: Array
    """Shape (N,)."""
    phases: Array
    """Time of each row is turns*T + phase, shape (N,)."""
    velocities: Array
    """Before impact; zero for a release, shape (N,)."""
    released: Array
    """Whether the row is a release: the body, at rest on the wall since shortly after the row
    before, is left by it, shape (N,)."""
    outcome: Outcome
    end: State | None
    """State from which a further run can start; None if there is none."""
    others: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """The other section coordinates of each row; n is zero for one degree of freedom, shape (N,
    n)."""
    held: Array = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """The walls held before each row, as `State.held` says; of several degrees of freedom only,
    shape (N,)."""
    left: State | None = None
    """The impact, or release, that the last flight leaves, where that meets no guard."""

    model: Model | None = None
    """The system simulated; None if the run was read from a file."""

    def __len__(self) -> int:
        return len(self.walls)

    def __bool__(self) -> bool:
        return True

    @property
    def free(self) -> bool:
        """Whether the system is known to have no forcing, whose phase would matter."""
        return self.model is not None and self.model.autonomous

    @property
    def parameters(self) -> Mapping[str, float]:
        """All parameters and derived parameters; none if the run was read from a file."""
        return self.model.parameters if self.model else {}

    def to_dataframe(self) -> Any:
        """Return the rows as a pandas DataFrame; pandas must be installed."""
        return frame(self._rows(slice(None)))

    def _rows(self, part: slice) -> dict[str, Any]:
        return {
            "wall": [self.letters[wall] for wall in self.walls[part]],
            "time": self.times[part],
            "velocity": self.velocities[part],
            "released": self.released[part],
        }

    def summary(self) -> Summary:
        """Return the last impacts, and why the run ended."""
        last = self._rows(slice(-20, None))
        return Summary(self._head(), list(last), list(zip(*last.values(), strict=True)))

    def _head(self) -> str:
        count = int(np.count_nonzero(~self.released))
        spans = float(self.turns[-1] - self.turns[0]) + 1 if len(self) else 0
        unit = "natural times" if self.free else "periods"
        return f"Run of {count_text(count, 'impact')} in {spans:.0f} {unit}: {self.outcome.value}"

    def __repr__(self) -> str:
        last = self._rows(slice(-5, None))
        rows = [
            f"  {wall}{'*' if released else ' '} t = {time:.12g}  v = {velocity:.12g}"
            for wall, time, velocity, released in zip(*last.values(), strict=True)
        ]
        more = [f"  ... {len(self) - len(rows)} before"] if len(self) > len(rows) else []
        return limit_lines(self._head(), rows, ahead=more)

    @property
    def times(self) -> Array:
        """Times of the rows, from the start of the first one's period."""
        first = self.turns[0] if len(self) else 0
        return (self.turns - first) * self.period + self.phases

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Run):
            return NotImplemented
        names = [f.name for f in fields(self) if f.name != "model"]
        return all(np.array_equal(getattr(self, n), getattr(other, n)) for n in names)

    __hash__ = object.__hash__

    def states(self) -> list[State]:
        """Return the rows as states."""
        others, held, n = self.others, self.held, len(self.walls)
        if not held.size:
            others, held = np.empty((n, 0)), np.zeros(n, dtype=np.int64)
        own = [self.walls, self.phases, self.velocities, self.turns]
        return states_of([*own, others, held, self.released])

    @property
    def word(self) -> str:
        """The walls met; a release is written ``*``."""
        names = [*self.letters, "*"]
        marked = np.where(self.released, len(self.letters), self.walls)
        return "".join(names[i] for i in marked)


def wall_into(model: Model, mode: str) -> int:
    """Return a guard that leads into a mode, the first one unless it has a name.

    Raises InputError if there is no such mode.
    """
    modes = [guard.next_mode for guard in model.WALLS]
    mode = mode or model.first_mode
    if mode not in modes:
        raise InputError("mode", f"no mode {mode!r}", f"the modes are {', '.join(modes)}")
    return modes.index(mode)


def _rows(columns: Sequence[Array]) -> list[tuple[Any, ...]]:
    return list(zip(*(column.tolist() for column in columns), strict=True))


def states_of(columns: Sequence[Array]) -> list[State]:
    """Return states from columns in the order of a state's fields."""
    return [
        State(wall, phase, velocity, turns, tuple(others), held, released)
        for wall, phase, velocity, turns, others, held, released in _rows(columns)
    ]


RUN_COLUMNS: Mapping[str, Any] = {
    "walls": np.int8,
    "turns": np.int64,
    "phases": float,
    "velocities": float,
    "released": bool,
    "others": float,
    "held": np.int64,
}
"""Kinds of the columns of a run, in the order in which its parts have them."""
WIDER = ("others", "held")
"""Columns of several coordinates, empty for one."""


def join_parts(parts: Sequence[Sequence[Any]], width: int | None = None) -> dict[str, Array]:
    """Return the columns of a run from those of its parts; `width` is the number of the other
    section coordinates, None for one coordinate."""
    found = {}
    for place, (name, kind) in enumerate(RUN_COLUMNS.items()):
        if width is not None or name not in WIDER:
            row = (width or 0,) if name == "others" else ()
            each = [part[place] for part in parts]
            pieces = [np.array(one, kind).reshape(len(one), *row) for one in each]
            found[name] = np.concatenate([np.zeros((0, *row), kind), *pieces])
    return found


def columns_of(rows: Sequence[State]) -> list[Any]:
    """Return the columns of rows that are states, as `join_parts` takes them."""
    names = ("wall", "turns", "phase", "velocity", "released", "others", "held")
    return [[getattr(state, name) for state in rows] for name in names]


# Arrivals at a switching surface: where the motion slides, and where it goes through.


class PassageRule:
    """Decides which guard is met of two on one surface; see `Guard.past`."""

    def __init__(
        self, kernels: Kernels, values: Sequence[float], positions: Sequence[float]
    ) -> None:
        self.kernels, self.values, self.positions = kernels, values, positions
        guards = kernels.model.WALLS
        self.pairs: dict[int, tuple[int, int]] = {}
        for k, guard in enumerate(guards):
            sliding = slides_at(guards, guard) if guard.past else None
            if sliding is not None:
                pair = k, guards.index(sliding)
                self.pairs |= dict.fromkeys(pair, pair)

    def __call__(self, state: State) -> State:
        """Return an arrival at the guard that is met."""
        if state.wall not in self.pairs:
            return state
        through, sliding = self.pairs[state.wall]
        guards = self.kernels.model.WALLS
        given = (state.phase, *state.section), self.values, self.positions
        within = margin(self.kernels, guards[sliding].name, guards[through].past, *given)
        return replace(state, wall=through if within < 0.0 else sliding)


# Impacts, chatter and sticking of one body, plainly and compiled.
#
# Written in the subset of Python that `contimpact.compiling` compiles: vectors are lists in plain
# Python, arrays in compiled code. `contimpact.simulation.simulator` says what it does.


class Body(NamedTuple):
    """A model at fixed parameter values, as vectors."""

    values: Vector
    """Parameter values, shape (p,)."""
    clock: Vector
    """The forcing period, shape (1,)."""
    zeros: Vector
    """Zeros of the acceleration in [0, T), in order, if it depends on time alone."""
    sides: Vector
    leaving: Vector
    """`sides`, `leaving`: of the walls, and of the same on the flights that leave them; see
    `segments.segment`, shape (w,)."""
    below: Vector
    above: Vector
    """`below`, `above`: the walls that flights from each wall can meet below and above; -1 for
    none, shape (w,)."""
    low: Vector
    high: Vector
    """`low`, `high`: their displacements from it, shape (w,)."""
    restitution: Vector
    slow: Vector
    """`restitution`, `slow`: coefficients at low velocity; velocities below which chatter may be
    near its end, shape (w,)."""
    edges: Vector
    """Phases at which the acceleration at a wall changes sign, wall after wall."""
    presses: Vector
    """Whether it presses in the interval after each."""
    first: Vector
    """Index at which the edges of each wall begin, and at which the last ones end, shape (w +
    1,)."""
    longest: Vector
    """Periods after which a flight is given up, shape (1,)."""
    sizes: Vector
    """Coordinates, 1, and the size of X, 0, as of `FLIGHTS`."""


def wrap_time(time: float, period: float) -> tuple[float, int]:
    """Return a time as a phase in [0, T) and whole periods."""
    passed = math.floor(time / period)
    phase = time - passed * period
    if phase >= period:  # rounding at the edge
        return 0.0, passed + 1
    return max(phase, 0.0), passed


def wall_on(body: Body, wall: int, side: int) -> int:
    """Return the number of the wall that a flight from a wall meets on a side; -1 for none."""
    if side == 0:
        return -1
    met: int = body.above[wall] if side > 0 else body.below[wall]
    return met


# Sticking: when the acceleration presses a body at rest against a wall, and when it is released.


class Hold(NamedTuple):
    """The sign of the acceleration of a body at rest on a wall, over a period."""

    edges: tuple[float, ...]
    """Phases at which it changes; (0,) if it never does."""
    presses: tuple[bool, ...]
    """Whether the body is pressed against the wall in the interval after each."""
    largest: float
    """Its largest size, of 65 phases."""

    @property
    def bound(self) -> float:
        """A bound of its size."""
        return 1.1 * self.largest


def hold_of(
    acceleration: Callable[[Any], Any], zeros: Sequence[float], side: int, period: float
) -> Hold:
    """Return when a body at rest on the wall of this side is pressed against it.

    The acceleration at the wall is a function of phases, with these zeros in a period.
    """
    edges = sorted(zeros) or [0.0]
    middles = [0.5 * (a + b) for a, b in zip(edges, [*edges[1:], edges[0] + period], strict=True)]
    pressed = [bool(side * float(acceleration(np.float64(t))) > 0.0) for t in middles]
    changes = [i for i in range(len(edges)) if pressed[i] != pressed[i - 1]] or [0]
    size = float(np.max(np.abs(acceleration(np.linspace(0.0, period, 65)))))
    return Hold(tuple(edges[i] for i in changes), tuple(pressed[i] for i in changes), size)


def pressing_at(body: Body, wall: int, phase: float) -> tuple[bool, float]:
    """Return whether a body at rest on a wall is pressed against it, and for how long.

    The time is infinite if the acceleration never turns away.
    """
    start, end = body.first[wall], body.first[wall + 1]
    if end - start == 1:
        return body.presses[start] != 0, math.inf
    i = end - 1
    if phase >= body.edges[start]:
        while body.edges[i] > phase:
            i -= 1
    left = body.edges[start if i + 1 == end else i + 1] - phase
    return body.presses[i] != 0, left if left > 0.0 else left + body.clock[0]


def release_after(body: Body, wall: int, phase: float) -> tuple[float, int]:
    """Return the phase of the next release from a wall, and the periods passed until then.

    The periods are negative if there is none.
    """
    start, end = body.first[wall], body.first[wall + 1]
    if end - start == 1:
        return phase, -1
    for i in range(start, end):
        if body.presses[i] == 0 and body.edges[i] > phase:
            return body.edges[i], 0
    if body.presses[start] == 0:
        return body.edges[start], 1
    return body.edges[start + 1], 1


# Chatter: impacts that accumulate where the body is pressed against a wall.
#
# With restitution e < 1 and the acceleration a towards the wall nearly constant, an impact of
# velocity v is followed by flights of 2 e v/a, 2 e^2 v/a, ..., which end after 2 e v/(a (1 - e)).
# Impacts are computed one by one until that is so short that the formula is exact to rounding. It
# happens at rigid walls alone: where a guard leads to another mode the coefficient is 1.

SHORT = 1e-9
"""Chatter left to come, in periods, that is completed analytically."""
EARLY = 1e-6
"""... and in units of the time until the acceleration turns away."""
LOW = 1e-6
"""A velocity at which the coefficient of chatter is read off, as part of that to which the
acceleration leads in a period."""


def rest_after(
    motion: Callable[..., Any], body: Body, wall: int, phase: float, velocity: float
) -> float:
    """Return the time until accumulating impacts end; NaN if they do not (yet)."""
    e = body.restitution[wall]
    presses, until = pressing_at(body, wall, phase)
    if not presses or e >= 1.0:
        return math.nan
    if e == 0.0 or velocity == 0.0:
        return 0.0
    force = body.sides[wall] * motion((wall, phase, 0.0), 0.0, body.values)[2]
    if force <= 0.0:
        return math.nan
    rest = 2.0 * e * abs(velocity) / (force * (1.0 - e))
    return rest if rest <= SHORT * body.clock[0] and rest <= EARLY * until else math.nan


def slow_velocity(e: float, acceleration: float, period: float) -> float:
    """Return the velocity below which chatter may be near its end; infinite without restitution."""
    if e == 0.0:
        return math.inf
    return SHORT * period * acceleration * max(1.0 - e, 0.0) / (2.0 * e)


def coefficient(motion: Callable[..., Any], wall: int, fastest: float) -> float:
    """Return the coefficient of restitution at velocities that are low beside the fastest."""
    low = LOW * (fastest if 0.0 < fastest < math.inf else 1.0)
    return abs(float(motion((wall, 0.0, low), 0.0)[1])) / low


DONE, RESTING, NO_IMPACT, RUNAWAY, _, BEYOND, UNDEFINED, LEFT, RELEASED = range(9)
"""Why a run ended: numbers of `contimpact.simulation.run.Outcome`; or the next flight is left to
the `automaton`; or, of a flight, that there was none: the body stuck, and is released."""

CALM = 1e-4
"""A motion whose law ceases to have a value while it is slower than this part of the speed beyond
which it runs away has come to where there is none."""


def fly_or_stick(
    fly: Callable[..., Any],
    motion: Callable[..., Any],
    body: Body,
    wall: int,
    phase: float,
    space: Vector,
) -> tuple[int, int, float, int]:
    """Make one flight, or complete chatter, as the ``fly`` of `make_flights`; the one given is as
    `fly_in_time`. Scratch space has the velocity and the speed beyond which motion runs away."""
    velocity, fastest, rest = space[0], space[1], math.nan
    if abs(velocity) <= body.slow[wall]:
        rest = rest_after(motion, body, wall, phase, velocity)
    if rest == rest:  # chatter has come to its end
        phase, passed = wrap_time(phase + rest, body.clock[0])
        phase, more = release_after(body, wall, phase)
        if more < 0:
            return RESTING, wall, phase, passed
        space[0] = 0.0
        return RELEASED, wall, phase, passed + more
    side, dt, speed = fly(body, wall, phase, velocity)
    if side != 0:
        space[0] = speed
        return DONE, wall_on(body, wall, side), phase + dt, 0
    if dt == dt:
        return NO_IMPACT if abs(speed) <= fastest else RUNAWAY, wall, phase, 0
    return UNDEFINED if abs(speed) <= CALM * fastest else RUNAWAY, wall, phase, 0


# Flights of any number of coordinates from impact to impact: what they have in common.
#
# The functions up to `make_flights` are in the plain subset of Python that `contimpact.compiling`
# compiles. Scratch space holds X, what it becomes, X a period before, and the section coordinates,
# each in the largest size of X, and behind these the arrivals at each gap coordinate (time,
# velocity, side).

TOGETHER, FASTER = 1e-14, 1.0 + 1e-6
"""Arrivals within this part of a period are at one time; the first guard comes first, unless
another arrives faster than by rounding, which is a part of slow velocities, so that a motion that
repeats itself has one word."""

AnyFlights: TypeAlias = Any
"""A system at fixed parameter values, as vectors: `FLIGHTS` and others of its kind."""

FLIGHTS: Mapping[str, str] = {
    "values": VECTOR,
    "clock": VECTOR,
    "sizes": INTEGERS,
    "factors": VECTOR,
    "unit": INTEGERS,
    "below": INTEGERS,
    "above": INTEGERS,
    "law": INTEGERS,
    "row": INTEGERS,
    "pivot": INTEGERS,
    "sides": INTEGERS,
    "positions": VECTOR,
    "leaving": INTEGERS,
    "stays": INTEGERS,
    "entered": INTEGERS,
    "restitution": VECTOR,
    "slow": VECTOR,
}
"""Vectors that flights of all kinds have, and kinds of their numbers: parameter values (p,); the
forcing period; as `sizes` coordinates d, the largest size of X, gap coordinates g, all rows (with
the coordinates themselves) q, and periods after which a flight is given up; the factors of the
coordinates in each row (q d,), and the row of each coordinate (d,). `below` and `above` (l g,) are
the guards of each law's mode on each gap coordinate, -1 for none. Of each guard (w,) the others
are the law after it, its gap coordinate, pivot, side and position; on the flight after it the side
of the surface that is left, and whether it begins there, see `segments.segment`; `entered_guards`;
the restitution at low velocity, 1 where no impacts accumulate; and the velocity of impacts up to
which a flight is left to plain Python."""


def flights_class(name: str, fields: Mapping[str, str]) -> Any:
    """Return the class of a kind of flights: a named tuple of vectors."""
    return collections.namedtuple(name, fields)


def row_value(flights: AnyFlights, row: int, space: Vector) -> float:
    """Return a row's combination of the positions."""
    d, found = flights.sizes[0], 0.0
    for i in range(d):
        found += flights.factors[row * d + i] * space[i]
    return found


def is_beyond(flights: AnyFlights, wall: int, law: int, space: Vector) -> bool:
    """Whether the flight after a guard begins behind one of its mode."""
    gaps, walls, slack = flights.sizes[2], len(flights.sides), 0.0
    for row in range(gaps):
        below, above = flights.below[law * gaps + row], flights.above[law * gaps + row]
        x = row_value(flights, row, space)
        if flights.stays[wall] != 0:
            slack = BESIDE * abs(x)
        low, high = wall * walls + below, wall * walls + above
        if below >= 0 and flights.entered[low] != 0 and x < flights.positions[below] - slack:
            return True
        if above >= 0 and flights.entered[high] != 0 and x > flights.positions[above] + slack:
            return True
    return False


BESIDE = 1e-12
"""Positions that no jump moves are behind a guard if they are by more than this part."""


def entered_guards(guards: Sequence[Guard], passages: Passages) -> list[int]:
    """Return whether the flight after each guard may begin behind each other one, which ends its
    mode, shape (w w,): where a jump has moved its gap coordinate, or the mode before has no such
    guard."""
    found = []
    for k, guard in enumerate(guards):
        stays = passages.arrivals[k][k] != ELSEWHERE
        for j, other in enumerate(guards):
            new = not set(guard.modes) <= set(other.modes) and other.coordinate != guard.coordinate
            found.append(int(passages.watched[k][j] and (new or not stays)))
    return found


def accumulates(flights: AnyFlights, wall: int, velocity: float, acceleration: float) -> bool:
    """Whether impacts on a wall are so near to their end that it may be held; see `run`."""
    e, force = flights.restitution[wall], flights.sides[wall] * acceleration
    if flights.stays[wall] == 0 or e >= 1.0 or not force > 0.0:
        return False
    return 2.0 * e * abs(velocity) <= SHORT * flights.clock[0] * force * (1.0 - e)


def first_reached(
    flights: AnyFlights, law: int, earliest: float, period: float, space: Vector
) -> tuple[int, float, float]:
    """Return guard, time and velocity of the first of the arrivals in scratch space, the fastest of
    those at one time; -1 for none. The period is in their unit of time. The time is that of the
    last of them: the others have then arrived, too, and their guards are reached at once."""
    gaps, hits = flights.sizes[2], 4 * flights.sizes[1]
    if earliest == math.inf:
        return -1, 0.0, 0.0
    chosen, fastest, latest = -1, -1.0, earliest
    for row in range(gaps):
        time, speed = space[hits + 3 * row], abs(space[hits + 3 * row + 1])
        if time <= earliest + TOGETHER * period:
            latest = max(latest, time)
            if speed > FASTER * fastest:
                chosen, fastest = row, speed
    at = law * gaps + chosen
    wall = flights.above[at] if space[hits + 3 * chosen + 2] > 0.0 else flights.below[at]
    return wall, latest, space[hits + 3 * chosen + 1]


def arrivals(
    begin: Callable[..., Any],
    first: Callable[..., Any],
    flights: AnyFlights,
    stretch: Any,
    left: int,
    velocity: float,
    period: float,
    space: Vector,
) -> tuple[int, float, float]:
    """Return guard, time and velocity of the first arrival on a stretch of a flight; -1 for none,
    -2 where the flight is left to the `automaton`.

    ``begin(flights, row, stretch, space)`` returns velocity and acceleration of a gap coordinate
    where the stretch begins; the positions there stand in scratch space. ``first(flights, row,
    stretch, rising, low, high, space)`` returns side, time and velocity of its first arrival, and
    the side 2 where that is not resolved. A stretch has its law first. `left` is the guard left
    where it begins (-1 for none), with this velocity before it. The period is in its unit of time.
    """
    law = stretch[0]
    gaps, hits, earliest = flights.sizes[2], 4 * flights.sizes[1], math.inf
    for row in range(gaps):
        space[hits + 3 * row] = math.inf
        below, above = flights.below[law * gaps + row], flights.above[law * gaps + row]
        if below < 0 and above < 0:
            continue
        origin = row_value(flights, row, space)
        speed, force = begin(flights, row, stretch, space)
        rising = speed > 0.0 or (speed == 0.0 and force > 0.0)
        if left >= 0 and flights.row[left] == row:
            if speed == 0.0 or flights.leaving[left] * speed > 0.0:  # at rest, or passes at once
                return -2, 0.0, 0.0
            if accumulates(flights, left, velocity, force):
                return -2, 0.0, 0.0
            if flights.stays[left] != 0:
                origin = flights.positions[left]
            if flights.leaving[left] != 0:
                rising = flights.leaving[left] < 0
        low = flights.positions[below] - origin if below >= 0 else -math.inf
        high = flights.positions[above] - origin if above >= 0 else math.inf
        side, time, speed = first(flights, row, stretch, rising, low, high, space)
        if side == 2:
            return -2, 0.0, 0.0
        if side != 0:
            space[hits + 3 * row] = time
            space[hits + 3 * row + 1] = speed
            space[hits + 3 * row + 2] = side
            earliest = min(earliest, time)
    return first_reached(flights, law, earliest, period, space)


def section_place(flights: AnyFlights) -> int:
    """Return where the section coordinates before an impact stand in scratch space, and behind them
    the speed beyond which the motion runs away."""
    return int(3 * flights.sizes[1])


def make_flights(
    fly: Callable[..., Any],
    flights: AnyFlights,
    space: Vector,
    state: Any,
    when: Any,
    walls: Any,
    turns: Any,
    phases: Any,
    sections: Any,
    released: Any,
    span: Any,
) -> int:
    """Simulate from impact to impact; returns how many rows there are.

    ``fly(flights, wall, phase, space)`` makes one flight, from the section coordinates before an
    impact to those before the next. It returns `DONE` or another outcome, the guard that ends it,
    the phase, which may be beyond the period, and periods passed besides.

    `state` (wall, turns) and `when` (phase, 2 d - 1 section coordinates) are kept up to date; they
    also have the number of the outcome, filled in, and the speed beyond which the motion runs away.
    The vectors of rows are filled with a number for each impact or release, and each of its section
    coordinates; of shape (0,) if none are kept. `span` has the rows to make at most, and the turns
    at which to stop.
    """
    size = 2 * flights.sizes[0] - 1
    at, period, kept = section_place(flights), flights.clock[0], len(walls) > 0
    wall, turn, phase, fastest = state[0], state[1], when[0], when[size + 1]
    most, last, made, outcome = span[0], span[1], 0, DONE
    for j in range(size):
        space[at + j] = when[1 + j]
    space[at + size] = fastest
    while made < most and turn < last:
        for j in range(size):
            when[1 + j] = space[at + j]
        speed = abs(space[at])
        for j in range(2, size, 2):
            speed = max(speed, abs(space[at + j]))
        if not speed <= fastest:
            outcome = RUNAWAY
            break
        outcome, wall, phase, passed = fly(flights, wall, phase, space)
        turn += passed
        if outcome != DONE and outcome != RELEASED:
            break
        phase, passed = wrap_time(phase, period)
        turn += passed
        if kept:
            walls[made], turns[made], phases[made] = wall, turn, phase
            released[made] = 1 if outcome == RELEASED else 0
            for j in range(size):
                sections[made * size + j] = space[at + j]
        made, outcome = made + 1, DONE
    if outcome == DONE:
        for j in range(size):
            when[1 + j] = space[at + j]
    state[0], state[1], state[2] = wall, turn, outcome
    when[0] = phase
    return made


# Compiled loops, and when they are loaded.

WORTH = 200
"""Impacts, in one run or made so far by plain Python, from which it is worth looking for compiled
code, which takes as long as twenty."""

DTYPES = {INTEGERS: np.int64, VECTOR: np.float64}


def array(numbers: Sequence[float], kind: str) -> Array:
    """Return a vector for compiled code."""
    return np.array(numbers, dtype=DTYPES[kind])


class Engine:
    """Compiled code for all simulators with the same formulas; arguments as of `compiling.load`,
    without `build` there is none."""

    def __init__(
        self, identity: tuple[str, ...], arguments: str, build: Callable[[], Program] | None
    ) -> None:
        self.identity, self.arguments, self.build = identity, arguments, build
        self.found: CompiledProgram | None = None
        self.plain = 0

    @classmethod
    def of(cls, identity: tuple[str, ...], arguments: str, build: Callable[[], Program]) -> Engine:
        """Return the engine of an identity: simulators of the same formulas share it."""
        return _ENGINES.setdefault(identity, cls(identity, arguments, build))

    def program(self, asked: int) -> CompiledProgram | None:
        """Return the compiled program if there is one and so many impacts are worth loading it."""
        chosen = mode()
        if chosen == "never" or self.build is None:
            return None
        if self.found is None and (chosen == "always" or asked + self.plain >= WORTH):
            self.plain = 0
            self.found = load(self.identity, self.arguments, self.build)
        return self.found


_ENGINES: dict[tuple[str, ...], Engine] = {}


def formulas(motions: Sequence[Kernel]) -> tuple[str, ...]:
    """Return the kernels' texts without their heads, which name the free parameters."""
    texts = (motion.source for motion in motions)
    return tuple(text[text.index("def ") :] for text in texts)


FEW = 1024
"""Impacts or periods made at once plainly, or where flights take long."""
LONG = 4096
"""Periods after which a flight is left to plain Python, where an interruption is noticed."""

COLUMNS = INTEGERS * 2 + VECTOR * 2 + INTEGERS
"""Kinds of the columns that `make_flights` fills."""

ENTRY = """
def entry({fields}, space, state, when, walls, turns, phases, sections, released, span):
    flights = {kind}({fields})
    made, size = 0, 2 * sizes[0] + 1
    for k in range(len(state) // 3):
        made += make_flights(
            fly, flights, space, state[3 * k : 3 * k + 3], when[size * k : size * k + size],
            walls, turns, phases, sections, released, span[2 * k : 2 * k + 2]
        )
    return made
"""


def glue_entry(program: Program, kind: type) -> None:
    """Add the entry that makes the runs of one motion or, without rows, of many, one after the
    other, for a kind of flights whose function ``fly`` is there."""
    fields: Sequence[str] = kind._fields  # type: ignore[attr-defined]
    program.constant(kind.__name__, kind)
    text = ENTRY.format(fields=", ".join(fields), kind=kind.__name__)
    program.glue(text, make_flights=make_flights)


class Setting(NamedTuple):
    """What a system's vectors are made of."""

    kernels: Kernels
    values: Sequence[float]
    positions: Sequence[float]
    restitution: Sequence[float]
    period: float
    longest: int
    slow: Sequence[float] = ()
    """`positions`, `restitution`, `slow`: of each guard. `slow` is as of `FLIGHTS`; without it no
    flight is left to plain Python for its velocity."""
    laws: Sequence[Any] = ()
    """Of the flight after each guard."""

    @property
    def rows(self) -> list[tuple[float, ...]]:
        """The gap coordinate of each guard."""
        model = self.kernels.model
        return [tuple(map(float, g.row(model.DEGREES_OF_FREEDOM))) for g in model.WALLS]

    @property
    def units(self) -> list[tuple[float, ...]]:
        """The rows of the coordinates themselves."""
        size = self.kernels.model.DEGREES_OF_FREEDOM
        return [tuple(float(i == j) for j in range(size)) for i in range(size)]

    @property
    def all_rows(self) -> list[tuple[float, ...]]:
        """Each gap coordinate once, and behind them the coordinates themselves."""
        return list(dict.fromkeys([*self.rows, *self.units]))

    def vectors(self, width: int) -> dict[str, Any]:
        """Return the vectors `FLIGHTS`, by name; X has a width at most."""
        laws, gaps, rows = (list(dict.fromkeys(x)) for x in (self.laws, self.rows, self.all_rows))
        passages, guards, own = self.kernels.passages, self.kernels.model.WALLS, self.rows

        def nearest(side: int) -> list[int]:
            """The nearest guard on a side of each law's gap coordinates, of those that a flight can
            meet; -1 for none."""
            found = []
            for law, row in itertools.product(laws, gaps):
                watched = passages.watched[self.laws.index(law)]
                there = [k for k, guard in enumerate(guards) if watched[k] and guard.side == side]
                there = [k for k in there if own[k] == row]
                found.append(min(there, key=lambda k: (side * self.positions[k], k), default=-1))
            return found

        return {
            "values": list(self.values),
            "clock": [self.period],
            "sizes": [len(self.units), width, len(gaps), len(rows), self.longest],
            "factors": [c for row in rows for c in row],
            "unit": [rows.index(unit) for unit in self.units],
            "below": nearest(-1),
            "above": nearest(+1),
            "law": [laws.index(law) for law in self.laws],
            "row": [rows.index(row) for row in own],
            "pivot": [pivot(row) for row in own],
            "sides": [guard.side for guard in guards],
            "positions": list(self.positions),
            "leaving": [int(side) for side in passages.leaving],
            "stays": [int(passages.arrivals[k][k] != ELSEWHERE) for k in range(len(guards))],
            "entered": entered_guards(guards, passages),
            "restitution": list(self.restitution),
            "slow": list(self.slow) or [-1.0] * len(guards),
        }


class Runs(ABC):
    """Runs from impact to impact, those on which no wall is held."""

    flights: AnyFlights
    fields: ClassVar[str]
    """Kinds of the fields of `flights` that are the same for all runs."""
    engine: Engine
    size: int
    """Section coordinates."""
    dear: ClassVar[bool] = False
    """Whether flights take long: fewer are made at once, so that interruptions come through."""

    @functools.cached_property
    def _arrays(self) -> list[Array]:
        """The vectors as arrays, for compiled code."""
        pairs = zip(self.flights, self.fields, strict=False)
        return [array(numbers, kind) for numbers, kind in pairs]

    @abstractmethod
    def room(self) -> list[Array]:
        """Return what compiled code takes behind these: room for one run at a time."""

    @abstractmethod
    def make_plainly(self, at: Any, when: Any, columns: Sequence[Any], span: Any) -> int:
        """Make impacts as compiled code does; returns how many."""

    def make(
        self, state: State, span: tuple[int, int], asked: int, record: bool, fastest: float
    ) -> tuple[State, Outcome | None, int, list[Any]]:
        """Make impacts as `Automaton.make`; the outcome is None where a flight is left to it."""
        fast = self.engine.program(asked)
        most, last = span
        if self.dear or not fast:
            most, last = min(most, FEW), min(last, state.turns + FEW)
        columns = self.empty(fast is not None, most if record else 0)
        at: Any = [int(state.wall), int(state.turns), 0]
        when: Any = [float(state.phase), *(float(y) for y in state.section), fastest]
        if fast:
            at, when = array(at, INTEGERS), array(when, VECTOR)
            limits = array((most, last), INTEGERS)
            made = fast(*self._arrays, *self.room(), at, when, *columns, limits)
        else:
            with timed_plainly(self.engine.identity):
                made = self.make_plainly(at, when, columns, (most, last))
            self.engine.plain += made
        section = tuple(float(y) for y in when[1:-1])
        end = State(int(at[0]), float(when[0]), section[0], int(at[1]), section[1:])
        outcome = None if at[2] == LEFT else OUTCOMES[at[2]]
        return end, outcome, made, self._columns(columns, made if record else 0)

    def empty(self, fast: bool, rows: int) -> list[Any]:
        """Return columns to be filled, of so many rows."""
        pairs = zip((rows, rows, rows, rows * self.size, rows), COLUMNS, strict=True)
        return [np.empty(size, DTYPES[kind]) if fast else [0] * size for size, kind in pairs]

    def batch(self, asked: int) -> Call | None:
        """Return compiled code for many motions; None where the work is not worth it."""
        fast = self.engine.program(asked)
        if fast is None:
            return None
        none = self.empty(True, 0)
        return lambda at, when, limits: fast(*self._arrays, *self.room(), at, when, *none, limits)

    def _columns(self, columns: Sequence[Any], made: int) -> list[Any]:
        """The columns of so many rows, as `join_parts` takes them."""
        walls, turns, phases, found, released = columns
        sections = np.asarray(found[: made * self.size], float).reshape(made, self.size)
        kept, none = (walls[:made], turns[:made], phases[:made]), np.zeros(made, np.int64)
        return [*kept, sections[:, 0], released[:made], sections[:, 1:], none]
