"""What a simulated motion settles on: a periodic orbit, complex motion, sticking, rest; or nothing.

A motion counts as periodic only if it closes. Where it comes back near to itself, the orbit nearby
is solved for by Newton's iteration on the simulated map; it has to be stable, and the motion itself
has to have reached it to `Settling.tolerance` or to approach it with its word unchanged. Complex
motion is told by a largest Lyapunov exponent above zero by three standard errors; what is neither
is reported as not settled.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from ..models.model import Model
from ..models.word import Word
from ..orbits.block_cyclic import roots
from ..scenes.simulate_tables import SETTLING, Settling
from ..segments.flight import flight_gaps
from ..simulation.lyapunov import Exponents, exponents_of
from ..simulation.simulator import Outcome, Run, Simulator, State
from ..storage.shapes import made

Array = np.ndarray[Any, Any]

KEPT = 1000
"""Impacts of a motion that is not periodic that are kept."""
FIRST = 64
"""Impacts after which a motion is looked at for the first time."""
NEAR = 1e-4
"""A motion this close to an earlier impact may be periodic; in periods and largest velocities."""


class Kind(enum.Enum):
    """What a motion is; the value is how files and pictures call it."""

    PERIODIC = "periodic"
    STICKING = "sticking"
    COMPLEX = "complex"
    NOT_SETTLED = "not settled"
    RESTING = "resting"
    NO_IMPACT = "no impact"


@dataclass(frozen=True, eq=False)
class Cycle:
    """One period of a motion that closes.

    Attributes
    ----------
    walls, released : ndarray of shape (N,)
    times, velocities : ndarray of shape (N,)
        Times from the start of the first impact's period.
    period : int
        In forcing periods.
    multipliers : (float or complex, float or complex)
        Of the map over the period, the larger one first; both zero where the body sticks.
    closing : float
        By how much the last impact misses the first.
    """

    walls: Array
    times: Array
    velocities: Array
    released: Array
    period: int
    multipliers: tuple[complex, complex]
    closing: float


@dataclass(frozen=True, eq=False)
class Attractor:
    """What was found at one set of parameter values.

    Attributes
    ----------
    kind : Kind
    parameters : mapping of str to float
        All parameters and derived parameters.
    word : str or None
        Walls of one period, its first rotation in the order of the walls, as ``BBT``; a sojourn on
        a wall, with the accumulation of impacts that leads to it, is written ``B*``.
    period : int or None
        In forcing periods.
    forcing_period : float
        T, in the unit of `times`.
    notation : str
        ``2:1``, ``1:1/2T``, ``1:1/C`` for complex motion, or the kind.
    walls, times, velocities, released : ndarray of shape (N,)
        Impacts of one period from the word's first one on, whose time is in [0, T); for motions
        that are not periodic, of the last part of the run.
    multipliers : (complex, complex) or None
    exponents : (float, float)
        Lyapunov exponents per impact, and the standard error of the larger one.
    error : float
    restitution : float
        Mean of ln r^2 over the impacts.
    per_period : float
        The larger exponent per forcing period.
    rate : float
        Impacts per forcing period.
    smallest_gap : float
        Nearest to a wall that a flight comes without touching it; periodic motions only.
    closing : float
        By how much the period closes.
    distance : float
        Of the motion from the periodic orbit when it was told.
    periods : int
        Simulated until then.
    state : State or None
        From which a neighbour can start.
    """

    kind: Kind
    parameters: Mapping[str, float]
    notation: str
    forcing_period: float
    word: str | None = None
    period: int | None = None
    walls: Array = field(default_factory=lambda: np.zeros(0, dtype=np.int8))
    times: Array = field(default_factory=lambda: np.zeros(0))
    velocities: Array = field(default_factory=lambda: np.zeros(0))
    released: Array = field(default_factory=lambda: np.zeros(0, dtype=bool))
    multipliers: tuple[complex, complex] | None = None
    exponents: tuple[float, float] = (math.nan, math.nan)
    error: float = math.nan
    restitution: float = math.nan
    per_period: float = math.nan
    rate: float = math.nan
    smallest_gap: float = math.nan
    closing: float = math.nan
    distance: float = math.nan
    periods: int = 0
    state: State | None = None

    @property
    def label(self) -> str:
        """What tells one kind of motion from another along a sweep."""
        return f"{self.word}/{self.period}T" if self.word else self.kind.value

    @property
    def settled(self) -> bool:
        """Whether it is known what the motion is."""
        return self.kind is not Kind.NOT_SETTLED

    def __repr__(self) -> str:
        word = f" ({self.word})" if self.word else ""
        return f"<{self.notation}{word}, velocities {np.array2string(self.velocities[:8])}>"

    def as_record(self) -> dict[str, Any]:
        """Return plain data from which `from_record` makes the same attractor."""
        record = asdict(self) | {"kind": self.kind.name}
        for name in ("walls", "times", "velocities", "released"):
            record[name] = getattr(self, name).tolist()
        if self.multipliers is not None:
            record["multipliers"] = [[mu.real, mu.imag] for mu in map(complex, self.multipliers)]
        return record

    @staticmethod
    def from_record(record: Mapping[str, Any]) -> Attractor:
        """Return the attractor a record was made of."""
        given = dict(record)
        kinds = {"walls": np.int8, "times": float, "velocities": float, "released": bool}
        for name, kind in kinds.items():
            given[name] = np.array(given[name], dtype=kind)
        if given["multipliers"] is not None:
            large, small = (complex(*mu) for mu in given["multipliers"])
            given["multipliers"] = (large, small)
        return made(Attractor, given)

    def require(self, model: Model) -> None:
        """Raise `ValueError` if this cannot be an attractor of a model."""
        impacts = (self.walls, self.times, self.velocities, self.released)
        if {column.shape for column in impacts} != {(len(self.walls),)}:
            raise ValueError("impacts that are no table")
        if lacking := [n for n in (*model.values, *model.DERIVED) if n not in self.parameters]:
            raise ValueError(f"an attractor without {', '.join(lacking)}")
        walls, state = self.walls.tolist(), self.state
        numbers = [*self.times, *self.velocities, self.forcing_period]
        if state is not None:
            walls.append(state.wall)
            numbers += [state.phase, state.velocity]
            if not 0.0 <= state.phase <= self.forcing_period:
                raise ValueError(f"a phase of {state.phase:.6g}")
        if not all(0 <= wall < len(model.WALLS) for wall in walls):
            raise ValueError("an impact on a wall that is not there")
        if not np.isfinite(numbers).all():
            raise ValueError("impacts that are not finite")


def settle(simulator: Simulator, state: State, settling: Settling = SETTLING) -> Attractor:
    """Simulate until it is clear what the motion is, or the time is up.

    Parameters
    ----------
    simulator : Simulator
    state : State
        Where the motion starts.
    settling : Settling

    Returns
    -------
    Attractor
    """
    begun, made = state.turns, 0
    run = simulator.run(state, impacts=FIRST)
    if run.released.any() and (found := _sticking_cycle(run)):
        return periodic(simulator, *found, periods=int(run.turns[-1]) - begun)
    run = simulator.run(state, periods=settling.transient, record=False)
    earlier: tuple[Cycle, float, int] | None = None
    window = FIRST
    while run.outcome is Outcome.DONE and run.end is not None:
        periods = run.end.turns - begun
        if periods - settling.transient > settling.periods:
            return _unsettled(simulator, run.end, settling, periods)
        run = simulator.run(run.end, impacts=window)
        made += len(run)
        window = min(2 * window, 2 * settling.longest)
        found = _cycle(simulator, run, settling.longest)
        if found is not None:
            cycle, distance = found
            if distance < settling.tolerance or _approached(earlier, cycle, distance, made):
                return periodic(simulator, cycle, distance, periods)
            if earlier is None or not np.array_equal(earlier[0].walls, cycle.walls):
                earlier = (cycle, distance, made)
    return _ended(simulator, run)


def _approached(
    earlier: tuple[Cycle, float, int] | None, cycle: Cycle, distance: float, made: int
) -> bool:
    """Whether a motion has come nearer to its cycle as the multiplier of the cycle says.

    At least half of the logarithm of the decay is asked for.
    """
    if earlier is None or not np.array_equal(earlier[0].walls, cycle.walls):
        return False
    rounds = (made - earlier[2]) / len(cycle.walls)
    return distance < earlier[1] * abs(cycle.multipliers[0]) ** (0.5 * rounds)


def _ended(simulator: Simulator, run: Run) -> Attractor:
    """What a run is that came to an end by itself."""
    kind = Kind.RESTING if run.outcome is Outcome.RESTING else Kind.NO_IMPACT
    return Attractor(kind, parameters(simulator), kind.value, simulator.period, state=run.end)


def parameters(simulator: Simulator) -> dict[str, float]:
    """Return every parameter and derived parameter of a simulated model."""
    return {**simulator.model.values, **simulator.derived}


# Periodic motions.


def _cycle(simulator: Simulator, run: Run, longest: int) -> tuple[Cycle, float] | None:
    """The stable cycle a run is near to, and its distance from it."""
    if run.released.any():
        return _sticking_cycle(run)
    last = len(run) - 1
    first = max(0, last - longest)
    scale = float(np.max(np.abs(run.velocities))) or 1.0
    early = np.arange(first, last)
    apart = _apart(run.phases[early] - run.phases[last], run.period) / run.period
    apart = np.maximum(apart, np.abs(run.velocities[early] - run.velocities[last]) / scale)
    apart[run.walls[early] != run.walls[last]] = np.inf
    for back in early[apart < NEAR][::-1][:3]:
        cycle = _polished(simulator, run, int(last - back))
        if cycle is not None and abs(cycle.multipliers[0]) < 1.0:
            return cycle, _distance(run, cycle, scale)
    return None


def _apart(difference: Any, period: float) -> Any:
    """Distance of two phases on the circle."""
    return np.abs(difference - period * np.round(difference / period))


def _distance(run: Run, cycle: Cycle, scale: float) -> float:
    """Of the run's last impact from a cycle."""
    last = len(run) - 1
    times = _apart(cycle.times - run.phases[last], run.period) / run.period
    apart = np.maximum(times, np.abs(cycle.velocities - run.velocities[last]) / scale)
    return float(np.min(apart[cycle.walls == run.walls[last]], initial=math.inf))


def _sticking_cycle(run: Run) -> tuple[Cycle, float] | None:
    """A motion that is released twice at the same phase repeats itself exactly."""
    releases = np.nonzero(run.released)[0]
    last = releases[-1]
    for first in releases[:-1][::-1]:
        same = run.walls[first] == run.walls[last] and run.phases[first] == run.phases[last]
        if same:
            rows = slice(first, last)
            times = (run.turns[rows] - run.turns[first]) * run.period + run.phases[rows]
            cycle = Cycle(
                run.walls[rows], times, run.velocities[rows], run.released[rows],
                int(run.turns[last] - run.turns[first]), (0.0, 0.0), 0.0,
            )  # fmt: skip
            return cycle, 0.0
    return None


def _polished(simulator: Simulator, run: Run, impacts: int) -> Cycle | None:
    """The cycle of so many impacts next to the end of a run, or of fewer if it repeats itself."""
    rows = np.arange(len(run) - impacts, len(run))
    base = int(rows[np.argmax(np.abs(run.velocities[rows]))])
    state = State(int(run.walls[base]), float(run.phases[base]), float(run.velocities[base]))
    turned = run.times[-1] - run.times[-1 - impacts]
    cycle = polish(simulator, state, impacts, round(float(turned) / run.period))
    if cycle is None:
        return None
    parts = _repetitions(cycle, simulator.period)
    if parts == 1:
        return cycle
    return polish(simulator, _state_of(cycle), impacts // parts, cycle.period // parts)


def _repetitions(cycle: Cycle, period: float) -> int:
    """How often a cycle runs through one of fewer periods."""
    n, span = len(cycle.walls), cycle.period * period
    for parts in range(cycle.period, 1, -1):
        if n % parts or cycle.period % parts:
            continue
        shift = n // parts
        late = _apart(np.roll(cycle.times, -shift) - cycle.times - span / parts, span)
        faster = np.abs(np.roll(cycle.velocities, -shift) - cycle.velocities)
        same_walls = np.array_equal(np.roll(cycle.walls, -shift), cycle.walls)
        if same_walls and max(np.max(late), np.max(faster)) < 1e-7:
            return parts
    return 1


def polish(simulator: Simulator, state: State, impacts: int, period: int) -> Cycle | None:
    """Solve for the cycle next to a state by Newton's iteration on the simulated map.

    Parameters
    ----------
    simulator : Simulator
    state : State
        An impact near the cycle.
    impacts, period : int
        Of the cycle; the period in forcing periods.

    Returns
    -------
    Cycle or None
        None where the iteration leaves the word or does not come to rest.
    """
    best, word = math.inf, None
    for _ in range(12):
        closed = simulator.run(state, impacts=impacts)
        walls, end = closed.walls.tolist(), closed.end
        left = len(closed) < impacts or closed.released.any() or word not in (None, walls)
        if left or end is None or end.wall != state.wall:
            return None
        word = walls
        late = (end.turns - period) * simulator.period + end.phase - state.phase
        faster = end.velocity - state.velocity
        miss = max(abs(late) / simulator.period, abs(faster))
        m, det = _product(simulator, state, closed)
        if miss < 1e-15 or (miss >= 0.5 * best and miss < 1e-11):
            return _as_cycle(simulator.period, state, closed, period, _eigenvalues(m, det), miss)
        step = _newton(m, late, faster)
        if miss > 10.0 * best or step is None or not math.isfinite(step[0] + step[1]):
            return None
        best = min(best, miss)
        phase = (state.phase + step[0]) % simulator.period
        state = State(state.wall, phase, state.velocity + step[1])
        if state.velocity * simulator.sides[state.wall] <= 0.0:
            return None
    return None


def _newton(m: Sequence[float], late: float, faster: float) -> tuple[float, float] | None:
    """Solve (M - I) step = -(late, faster)."""
    a, b, c, d = m[0] - 1.0, m[1], m[2], m[3] - 1.0
    det = a * d - b * c
    if det == 0.0:
        return None
    return (b * faster - d * late) / det, (c * late - a * faster) / det


def _product(
    simulator: Simulator, state: State, run: Run
) -> tuple[tuple[float, float, float, float], float]:
    """The derivative of the map over a run, and its determinant."""
    a, b, c, d = 1.0, 0.0, 0.0, 1.0
    det, before = 1.0, state
    columns = (run.walls, run.phases, run.velocities, run.turns)
    for row in zip(*(column.tolist() for column in columns), strict=True):
        after = State(*row)
        tt, tv, vt, vv = simulator.derivative(before, after)
        a, b, c, d = tt * a + tv * c, tt * b + tv * d, vt * a + vv * c, vt * b + vv * d
        det *= tt * vv - tv * vt
        before = after
    return (a, b, c, d), det


def _eigenvalues(m: Sequence[float], det: float) -> tuple[complex, complex]:
    """The larger one first; the smaller one from the determinant."""
    a, b, c, d = roots(1.0, -(m[0] + m[3]), det, det)
    return complex(a, b), complex(c, d)


def _as_cycle(
    period: float, state: State, closed: Run, turns: int, multipliers: tuple[complex, complex],
    miss: float,
) -> Cycle:  # fmt: skip
    """The impacts of a closed run, the first one being its start."""
    times = closed.turns * period + closed.phases
    return Cycle(
        np.concatenate([[state.wall], closed.walls[:-1]]),
        np.concatenate([[state.phase], times[:-1]]),
        np.concatenate([[state.velocity], closed.velocities[:-1]]),
        np.zeros(len(closed), dtype=bool), turns, multipliers, miss,
    )  # fmt: skip


def periodic(
    simulator: Simulator, cycle: Cycle, distance: float = 0.0, periods: int = 0
) -> Attractor:
    """Return the attractor of a stable cycle."""
    cycle = _rotated(cycle, simulator.period)
    sticks = bool(cycle.released.any())
    word = _sticking_word(simulator, cycle) if sticks else _letters(simulator, cycle.walls)
    count, smallest = len(cycle.walls), math.nan
    mean = tuple(math.log(abs(mu)) / count if mu != 0 else -math.inf for mu in cycle.multipliers)
    logs = [2.0 * math.log(e) if e else -math.inf for e in simulator.restitution]
    if sticks:
        notation = _sticking_notation(simulator, cycle)
    else:
        notation = Word(word, cycle.period).notation(simulator.letters)
        smallest = _smallest_gap(simulator, word, cycle)
    return Attractor(
        Kind.STICKING if sticks else Kind.PERIODIC, parameters(simulator), notation,
        simulator.period, word, cycle.period, cycle.walls, cycle.times, cycle.velocities,
        cycle.released, cycle.multipliers, (mean[0], mean[1]), 0.0,
        float(np.mean([logs[wall] for wall in cycle.walls])) if not sticks else math.nan,
        mean[0] * count / cycle.period, math.inf if sticks else count / cycle.period, smallest,
        cycle.closing, distance, periods, _state_of(cycle),
    )  # fmt: skip


def _state_of(cycle: Cycle) -> State:
    """A state on the cycle: its fastest impact."""
    k = int(np.argmax(np.abs(cycle.velocities)))
    return State(int(cycle.walls[k]), float(cycle.times[k]), float(cycle.velocities[k]))


def _letters(simulator: Simulator, walls: Array) -> str:
    return "".join(simulator.letters[k] for k in walls.tolist())


def _rotated(cycle: Cycle, period: float) -> Cycle:
    """The cycle from its first rotation on: walls in order, the faster impact first."""
    n = len(cycle.walls)
    span = cycle.period * period
    walls, fast = cycle.walls.tolist(), np.abs(cycle.velocities).tolist()

    def key(shift: int) -> Any:
        # a rotation begins with an impact, not in the middle of a chatter
        order = [(i + shift) % n for i in range(n)]
        return [walls[i] for i in order], bool(cycle.released[order[0]]), -fast[order[0]]

    shift = min(range(n), key=key)
    times = np.roll(cycle.times, -shift).copy()
    times[n - shift :] += span
    times -= math.floor(times[0] / period) * period
    roll = [np.roll(a, -shift) for a in (cycle.walls, cycle.velocities, cycle.released)]
    return Cycle(roll[0], times, roll[1], roll[2], cycle.period, cycle.multipliers, cycle.closing)


def _sticking_word(simulator: Simulator, cycle: Cycle) -> str:
    """The word with every chatter that ends in a release written as its wall and ``*``."""
    n = len(cycle.walls)
    dropped = set()
    for k in np.nonzero(cycle.released)[0].tolist():
        i = (k - 1) % n
        while i != k and cycle.walls[i] == cycle.walls[k] and not cycle.released[i]:
            dropped.add(i)
            i = (i - 1) % n
    parts = [
        simulator.letters[wall] + ("*" if released else "")
        for i, (wall, released) in enumerate(zip(cycle.walls, cycle.released, strict=True))
        if i not in dropped
    ]
    rotations = [parts[i:] + parts[:i] for i in range(len(parts))]
    return "".join(min(rotations))


def _sticking_notation(simulator: Simulator, cycle: Cycle) -> str:
    """Counts per wall, infinite on walls where impacts accumulate."""
    stuck = set(cycle.walls[cycle.released].tolist())
    totals = [int(np.count_nonzero(cycle.walls == k)) for k in range(len(simulator.letters))]
    p = cycle.period
    finite = [total for k, total in enumerate(totals) if k not in stuck]
    whole = all(total % p == 0 for total in finite)
    each = [total // p if whole else total for total in totals]
    counts = ":".join("inf" if k in stuck else str(n) for k, n in enumerate(each))
    if p == 1:
        return counts
    return f"{counts}/{p}T" if whole else f"({counts})/{p}T"


def _smallest_gap(simulator: Simulator, word: str, cycle: Cycle) -> float:
    impacts = np.column_stack([cycle.times, cycle.velocities])
    span = cycle.period * simulator.period
    flights = flight_gaps(simulator.kernels, word, simulator.values, impacts, span)
    gaps = [t.gap for flight in flights for t in flight.touches if t is not None]
    return min(gaps, default=math.nan)


# Other motions.


def _unsettled(simulator: Simulator, state: State, settling: Settling, periods: int) -> Attractor:
    """Complex motion if the largest exponent says so, otherwise not settled."""
    run = simulator.run(state, impacts=settling.impacts)
    if run.outcome is not Outcome.DONE:
        return _ended(simulator, run)
    if run.released.any() and (sticking := _sticking_cycle(run)):
        return periodic(simulator, *sticking, periods=periods)
    found: Exponents = exponents_of(simulator, state, run)
    is_complex = found.per_impact[0] > 3.0 * found.error
    rate = found.impacts / found.periods
    shares = [np.count_nonzero(run.walls == k) / len(run) for k in range(len(simulator.letters))]
    counts = ":".join(str(round(share * rate)) for share in shares)
    last = slice(-KEPT, None)
    return Attractor(
        Kind.COMPLEX if is_complex else Kind.NOT_SETTLED, parameters(simulator),
        f"{counts}/C" if is_complex else Kind.NOT_SETTLED.value, simulator.period, None, None,
        run.walls[last], run.times[last], run.velocities[last], run.released[last], None,
        found.per_impact, found.error,
        found.restitution, found.per_period, rate, periods=periods, state=run.end,
    )  # fmt: skip
