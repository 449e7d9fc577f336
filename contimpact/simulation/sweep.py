"""Sweeps of a parameter, the attractors at each value, and basins of attraction.

A sweep starts each value from the attractor at the value before, as the paper does, so that
falling and rising values show hysteresis. Random starts find attractors that no sweep meets, and a
grid of starts shows which of them each leads to.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, overload

import numpy as np

from ..arrays import Array
from ..display import NotebookResult, ParameterItems, Summary, frame, limit_lines
from ..errors import (
    InputError,
    count_text,
    did_you_mean,
    explain_arguments,
    random_generator,
    short_repr,
)
from ..models.guards import Word, is_rotation
from ..models.model import Model, Symmetry, require_forcing
from ..orbits.orbit import Orbit
from ..orbits.problem import OrbitProblem
from ..orbits.quiet import problem_of
from ..orbits.search import mirror_orbit, solve_near
from ..progress import Asked, progress_lines
from ..results.branch import Branch, coordinates, impacts_at, same_data
from ..results.diagram import Diagram
from ..results.options import SETTLING, Settling
from ..schema import build_record
from ..segments.kernels import Kernels
from .attractor import (
    OTHER,
    Attractor,
    Kind,
    distances_between,
    impact_table,
    natural_sizes,
    spacing,
    states_apart,
)
from .run import Outcome, Run, State
from .settle import settle, settle_again, sojourns
from .simulator import Batch, Simulator, as_simulator, natural_places

SAME = 1e-6
"""Periodic attractors whose phases differ by less, and velocities by less than this part of the
largest, are one."""
APART, SPACED = 0.03, 1.5
"""Complex motions whose impacts are on average further from each other's, both ways, than this, and
than so many times from their own, are two: distances of phases in periods, of velocities in parts
of the largest. Those of two runs of one attractor are as near as its own, up to a fifth."""

SHOWN = 12
"""Notations of one direction that are shown."""


@dataclass(frozen=True)
class Row(ParameterItems):
    """An attractor of a sweep: the way it was found, the parameter value and what it is.

    `direction` is ``down`` or ``up`` for falling or rising values of the parameter, and ``random``
    for an attractor that random starts at this value found in addition.
    """

    direction: str
    value: float
    attractor: Attractor

    @property
    def parameters(self) -> Mapping[str, float]:
        """All parameters and derived parameters."""
        return self.attractor.parameters

    def as_record(self) -> dict[str, Any]:
        """Return plain data from which `from_record` makes the same row."""
        record = self.attractor.as_record()
        return {"direction": self.direction, "value": self.value, "attractor": record}

    @staticmethod
    def from_record(record: Mapping[str, Any]) -> Row:
        """Return the row a record was made of."""
        attractor = Attractor.from_record(record["attractor"])
        return build_record(Row, {**record, "attractor": attractor})


@dataclass(frozen=True, eq=False)
class Sweep(NotebookResult):
    """Attractors along a parameter."""

    model: Model
    """Gives the values of all other parameters."""
    parameter: str
    rows: list[Row]
    """Rows of all directions, each in the order it was computed."""
    interrupted: bool = field(default=False, compare=False)
    """Whether it was interrupted before all values were visited."""

    @property
    def values(self) -> Array:
        """The parameter's values, one for each row."""
        return np.array([row.value for row in self.rows])

    @property
    def attractors(self) -> list[Attractor]:
        """The attractors, one for each row."""
        return [row.attractor for row in self.rows]

    def __len__(self) -> int:
        return len(self.rows)

    def __bool__(self) -> bool:
        return True

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows)

    @overload
    def __getitem__(self, name: str) -> Array: ...
    @overload
    def __getitem__(self, name: int) -> Row: ...
    @overload
    def __getitem__(self, name: slice) -> list[Row]: ...

    def __getitem__(self, name: str | int | slice) -> Array | Row | list[Row]:
        """Return a row by its number, or the values of a parameter, one for each row."""
        if not isinstance(name, str):
            return self.rows[name]
        known = [*self.model.values, *self.model.DERIVED]
        if name not in known:
            text = f"sweep has no parameter {short_repr(name)}{did_you_mean(name, known)}"
            raise KeyError(f"{text}; it has {', '.join(known)}; columns are in to_dataframe()")
        return np.array([row[name] for row in self.rows])

    def _ipython_key_completions_(self) -> list[str]:
        return [*self.model.values, *self.model.DERIVED]

    def of(self, direction: str) -> list[Row]:
        """Return the rows of one direction."""
        return [row for row in self.rows if row.direction == direction]

    @property
    def directions(self) -> list[str]:
        """The directions that occur, in order."""
        return list(dict.fromkeys(row.direction for row in self.rows))

    def sequence(self, direction: str) -> list[str]:
        """Return the notations met one after another in one direction."""
        met: list[str] = []
        for row in self.of(direction):
            if not met or met[-1] != row.attractor.notation:
                met.append(row.attractor.notation)
        return met

    def to_dataframe(self) -> Any:
        """Return the attractors as a pandas DataFrame, a row for each; pandas must be installed."""

        columns, rows = table_of(self)
        return frame([dict(zip(columns, row, strict=True)) for row in rows])

    def summary(self) -> Summary:
        """Return the changes along the sweep in short."""
        rows = []
        for way in self.directions:
            met = self.of(way)
            for before, row in zip([None, *met], met, strict=False):
                if before is None or before.attractor.notation != row.attractor.notation:
                    velocities = ", ".join(f"{v:.6g}" for v in row.attractor.velocities[:8])
                    rows.append((way, row.value, row.attractor.notation, velocities))
        return Summary(
            self._head(), ("direction", self.parameter, "from there on", "velocities"), rows
        )

    def __eq__(self, other: object) -> bool:
        return same_data(self, other) if isinstance(other, Sweep) else NotImplemented

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        met = {way: self.sequence(way) for way in self.directions}
        lines = [
            f"{way}: {', '.join(found[:SHOWN])}"
            + (f", ... and {len(found) - SHOWN} more" if len(found) > SHOWN else "")
            for way, found in met.items()
        ]
        return limit_lines(self._head(), lines)

    def _head(self) -> str:
        cut = "; interrupted" if self.interrupted else ""
        return f"Sweep in {self.parameter}, {count_text(len(self.rows), 'attractor')}{cut}"


class Simulators:
    """Simulators of one model along a parameter; kernels are loaded once."""

    def __init__(self, model: Model, parameter: str, kernels: Kernels | None = None) -> None:
        self.model, self.parameter = model, parameter
        self.kernels = kernels or Kernels(model, parameter)

    def at(self, value: float) -> Simulator:
        """Return the simulator at a value of the parameter."""
        return Simulator(self.model.replace(**{self.parameter: value}), self.kernels)

    def lead(self, attractor: Attractor, value: float, settling: Settling) -> Attractor | None:
        """Return what an attractor leads to at a value; None if that cannot be told."""
        return settle_again(self.at(value), attractor, settling)


@explain_arguments
def sweep(
    model: Model,
    parameter: str,
    values: Iterable[float],
    *,
    start: State | Literal["random"] | None = "random",
    settling: Settling = SETTLING,
    kernels: Kernels | None = None,
    rng: Any = 0,
    callback: Callable[[Row], None] | None = None,
    progress: Asked = False,
) -> Sweep:
    """Find the attractor at each value, starting from the one before.

    Parameters
    ----------
    model : Model
    parameter : str
    values : iterable of float
        In the order in which they are visited; falling for a sweep down.
    start : State, optional
        Where the first value starts; a random impact otherwise. None, as `Simulator.start` returns
        it where no wall is met, is refused.
    settling : Settling
    kernels : Kernels, optional
        Kernels of this model, if there are any already.
    rng : None, int or numpy.random.Generator, default 0
        Gives the first start, and a new one where no motion can be started from the attractor
        before.
    callback : callable, optional
        Called with each row.
    progress : bool or callable
        Whether to tell on standard error how far the sweep is, or a function to call with lines of
        text.

    Returns
    -------
    Sweep
        After Ctrl-C with the values visited until then.

    Raises
    ------
    InputError
        If `start` is None.
    """
    if start is None:
        found = "None: the motion meets no wall"
        raise InputError("start", found, "give an impact, or leave it out for one at random")
    if not isinstance(values, Iterable):
        raise InputError("values", f"found {values!r}", "give the values to sweep, in their order")
    first = None if isinstance(start, str) else start
    simulators = Simulators(model, parameter, kernels)
    result = Sweep(model, parameter, [])
    values = list(values)
    try:
        with progress_lines(progress, f"sweep in {parameter}") as tell:
            for number, row in enumerate(sweep_rows(simulators, values, first, settling, rng), 1):
                result.rows.append(row)
                place = f"{number} of {len(values)}, {parameter} = {row.value:.6g}"
                tell(f"{place}: {row.attractor.notation}")
                if callback:
                    callback(row)
    except KeyboardInterrupt:
        return replace(result, interrupted=True)
    return result


def sweep_rows(
    simulators: Simulators,
    values: Sequence[float],
    start: State | Attractor | None = None,
    settling: Settling = SETTLING,
    rng: Any = 0,
    direction: str | None = None,
) -> Iterator[Row]:
    """Yield the rows of one sweep; `start` is where the first value begins, or the attractor before
    it.

    Where no motion can be started from an attractor, an impact at random is. `direction` follows
    from the values if it is not given.
    """
    falling = len(values) < 2 or values[-1] < values[0]
    for value in values:
        simulator, found = simulators.at(value), None
        if isinstance(start, Attractor):
            found, start = settle_again(simulator, start, settling), None
        if found is None:
            begin = simulator.random_state(random_generator(rng)) if start is None else start
            found = settle(simulator, begin, settling)
        start = found
        yield Row(direction or ("down" if falling else "up"), value, found)


def same_attractor(one: Attractor, other: Attractor, tolerance: float = SAME) -> bool:
    """Whether two attractors at the same parameter values are one.

    Complex ones are compared as sets of impacts: runs that each visit another part of one attractor
    count as two. Those that stick are compared where they leave a wall, those that rest by what
    they rest on.
    """
    if one.label != other.label:
        return False
    if one.motion is not None and other.motion is not None:
        places = natural_places([one.motion, other.motion], one.forcing_period)
        return bool(np.max(np.abs(places[0] - places[1])) <= tolerance * np.max(np.abs(places)))
    if one.kind is Kind.COMPLEX:
        return _apart(one, other) < 1.0
    if one.kind is Kind.RESTING:
        ends = [(a.state.held or 1 << a.state.wall) if a.state else 0 for a in (one, other)]
        return ends[0] == ends[1]
    if one.kind not in (Kind.PERIODIC, Kind.STICKING):
        return True
    (walls, mine), (met, theirs) = _marks(one), _marks(other)
    if len(walls) != len(met):
        return False
    sections = np.concatenate([mine, theirs])[:, 1:]
    sizes = natural_sizes(sections, one.forcing_period, one.free)
    for shift in range(len(met)):
        if np.array_equal(np.roll(met, -shift), walls):
            apart = states_apart(np.roll(theirs, -shift, axis=0) - mine, sizes)
            if np.max(apart) < tolerance:
                return True
    return False


def _apart(one: Attractor, other: Attractor) -> float:
    """How far motions are apart, in parts of the distance from which on they are two attractors."""
    limit = max(APART, SPACED * max(spacing(one), spacing(other)))
    return min(distances_between(one, other)) / limit


def _marks(attractor: Attractor) -> tuple[Array, Array]:
    """Walls and states that tell an attractor from others of its word: all impacts, or where
    sojourns end."""
    rows: Any = slice(None)
    if attractor.kind is Kind.STICKING:
        rows = sorted({last for _, _, last in sojourns(attractor)})
    return attractor.walls[rows], impact_table(attractor.times, attractor)[rows]


@explain_arguments
def find_attractors(
    simulator: Simulator | Model,
    starts: int = 20,
    *,
    rng: Any = 0,
    settling: Settling = SETTLING,
    known: Sequence[Attractor] = (),
) -> list[Attractor]:
    """Find attractors from random starts.

    Parameters
    ----------
    simulator : Simulator or Model
    starts : int
        How many.
    rng : None, int or numpy.random.Generator, default 0
    settling : Settling
    known : sequence of Attractor
        Attractors that are not returned again.

    Returns
    -------
    list of Attractor
        Each once.
    """
    simulator = as_simulator(simulator)
    generator = random_generator(rng)
    found: list[Attractor] = []
    for _ in range(starts):
        attractor = settle(simulator, simulator.random_state(generator), settling)
        if not any(same_attractor(attractor, other) for other in (*known, *found)):
            found.append(attractor)
    return found


# Attractors of a sweep as rows of a table, one for each.

WRITTEN = 64
"""Velocities of one motion in its row at most."""


def attractor_columns(m: int) -> list[str]:
    """Return the names of the columns that say what an attractor is, of m multipliers."""
    places = range(1, m + 1)
    return [
        *("direction", "kind", "notation", "word", "period", "rate"),
        *(f"exponent{k}" for k in places),
        *("exponent_error", "exponent_sum", "mean_ln_r2", "exponent_per_period"),
        *(f"multiplier{k}_{part}" for k in places for part in ("re", "im")),
        *("smallest_gap", "closing", "distance", "periods", "impacts"),
    ]


def table_of(sweep: Sweep) -> tuple[list[str], list[list[Any]]]:
    """Return the columns' names and the rows."""
    most = max((min(len(row.attractor.walls), WRITTEN) for row in sweep.rows), default=0)
    letters = sweep.model.letters
    names = [*sweep.model.values, *sweep.model.DERIVED]
    m = sweep.model.unknowns_per_impact
    each, m = ("wall", *coordinates(m)), m - int(sweep.model.autonomous)
    columns = [*names, *attractor_columns(m)]
    columns += [f"{what}{k + 1}" for k in range(most) for what in each]
    width = most * len(each) + len(attractor_columns(m)) + len(names)
    rows = [_cells(row, names, letters, m) for row in sweep.rows]
    return columns, [cells + [None] * (width - len(cells)) for cells in rows]


def _cells(row: Row, names: Sequence[str], letters: Sequence[str], m: int) -> list[Any]:
    a = row.attractor
    parts = [None] * m if a.multipliers is None else [complex(mu) for mu in a.multipliers]
    spread = [x for mu in parts for x in ((mu.real, mu.imag) if mu is not None else (None, None))]
    exponents = a.exponents if len(a.exponents) == m else (math.nan,) * m
    cells: list[Any] = [a.parameters[name] for name in names]
    period = (a.span if math.isfinite(a.span) else None) if a.free else a.period
    cells += [row.direction, a.kind.value, a.notation, a.word, period, a.rate, *exponents]
    total = sum(exponents) if a.exponent_sum is None else a.exponent_sum
    cells += [a.error, total, a.restitution, a.per_period, *spread]
    cells += [a.smallest_gap, a.closing, a.distance, a.periods, len(a.walls)]
    for k in range(min(len(a.walls), WRITTEN)):
        wall = letters[a.walls[k]] + ("*" if a.released[k] else "")
        cells += [wall, float(a.times[k]), float(a.velocities[k])]
        cells += a.others[k].tolist() if a.others.size else []
    return cells


# Basins of attraction, and how much of them a diagram covers.

REACHED = 1e-5
"""A motion this near to a known periodic attractor, round after round, has reached it."""

LARGEST = 4096
"""Starts simulated together at most."""


@dataclass(frozen=True, eq=False)
class Basins(ParameterItems, NotebookResult):
    """Basins of attraction among impacts on one wall, as `basins` finds them."""

    wall: str
    wall_number: int
    parameters: dict[str, float]
    """All parameters and derived parameters."""
    phases: Array
    """Times of the first impact, shape (n,)."""
    velocities: Array
    """Velocities before it, shape (m,)."""
    labels: Array
    """Number of the attractor reached, shape (m, n); -1 where an interruption left a start out."""
    attractors: list[Attractor]
    others: tuple[float, ...] = ()
    """The other section coordinates, the same for all starts: with several degrees of freedom the
    picture is a section through the basins."""
    interrupted: bool = False
    """Whether it was interrupted before all starts were made."""

    @property
    def shares(self) -> list[float]:
        """The part of the starts made that leads to each attractor."""
        made = self.labels[self.labels >= 0]
        counts = np.bincount(made, minlength=len(self.attractors))
        return [float(count / max(made.size, 1)) for count in counts]

    def summary(self) -> Summary:
        """Return the attractors and their shares of the starts."""
        rows = [
            (a.notation, f"{share:.1%}", ", ".join(f"{v:.6g}" for v in a.velocities[:8]))
            for a, share in zip(self.attractors, self.shares, strict=True)
        ]
        return Summary(self._head(), ("attractor", "starts", "velocities before impact"), rows)

    def _head(self) -> str:
        m, n = self.labels.shape
        low, high = float(self.velocities[0]), float(self.velocities[-1])
        place = f"impacts on {self.wall}, velocities {low:.4g} to {high:.4g}"
        made = int(np.count_nonzero(self.labels >= 0))
        cut = f"; interrupted after {made}" if self.interrupted else ""
        named = count_text(len(self.attractors), "attractor")
        return f"Basins of {named}, {n} by {m} {place}{cut}"

    def __repr__(self) -> str:
        named = zip((a.notation for a in self.attractors), self.shares, strict=True)
        rows = [f"  {share:7.1%}  {name}" for name, share in named]
        return limit_lines(self._head(), rows)


@explain_arguments
def basins(
    simulator: Simulator | Model,
    *,
    wall: str | None = None,
    shape: tuple[int, int] = (40, 40),
    fastest: float | None = None,
    settling: Settling = SETTLING,
    known: Sequence[Attractor] = (),
    callback: Callable[[int, int], None] | None = None,
    threads: int | None = None,
) -> Basins:
    """Find the attractor each of a grid of starts leads to.

    Parameters
    ----------
    simulator : Simulator or Model
    wall : str, optional
        Wall of the first impact; the model's first one by default.
    shape : (m, n)
        Velocities and phases of the grid, each at the middle of its cell.
    fastest : float, optional
        Largest velocity; by default twice the largest of the attractors known, or what a period of
        the largest acceleration gives.
    settling : Settling
    known : sequence of Attractor
        Attractors at these parameter values found before.
    callback : callable, optional
        Called with starts done and their number.
    threads : int, optional
        For compiled simulations; as many as there are cores by default.

    Returns
    -------
    Basins
        After Ctrl-C with the starts made until then.

    Raises
    ------
    InputError
        If there is no such wall, or a shape is no pair of whole numbers above zero.

    Notes
    -----
    With several degrees of freedom all starts have the other coordinates of the fastest impact on
    that wall that the attractors known have, or zero.
    """
    simulator = as_simulator(simulator)
    letter = wall or simulator.letters[0]
    if letter not in simulator.letters:
        accepted = f"the walls are {', '.join(simulator.letters)}"
        raise InputError("wall", f"no wall {short_repr(letter)}", accepted)
    if not isinstance(shape, tuple | list) or [n for n in shape if not n >= 1] or len(shape) != 2:
        accepted = "give numbers of velocities and phases, such as (40, 40)"
        raise InputError("shape", f"found {short_repr(shape)}", accepted)
    side = simulator.sides[simulator.letters.index(letter)]
    known_largest = max((a.fastest for a in known), default=0.0)
    largest = fastest or 2.0 * known_largest or simulator.fastest
    m, n = shape
    velocities = side * largest * (np.arange(m) + 0.5) / m
    phases = simulator.period * (np.arange(n) + 0.5) / n
    found = list(known)
    labels = np.full(shape, -1)
    others = _other_coordinates(simulator, letter, known)
    states = [
        simulator.met(simulator.state(letter, phase, velocity, others))
        for velocity in velocities.tolist()
        for phase in phases.tolist()
    ]
    interrupted = False
    try:
        for part in parts_of(m * n):
            numbers = attractor_numbers(simulator, states[part], found, settling, threads)
            labels.flat[part] = numbers
            if callback:
                callback(part.stop, m * n)
    except KeyboardInterrupt:
        interrupted = True
    number = simulator.letters.index(letter)
    about = (letter, number, simulator.parameters, phases, velocities, labels, found, others)
    return Basins(*about, interrupted)


def _other_coordinates(
    simulator: Simulator, wall: str, known: Sequence[Attractor]
) -> tuple[float, ...]:
    """The other section coordinates of all starts: those of the fastest known impact there."""
    number = simulator.letters.index(wall)
    impacts = [
        (abs(float(speed)), tuple(row))
        for a in known
        for speed, row, k, released in zip(
            a.velocities, a.others.tolist(), a.walls, a.released, strict=False
        )
        if k == number and not released
    ]
    none = (0.0,) * (simulator.model.unknowns_per_impact - 2)
    return max(impacts, default=(0.0, none))[1]


def parts_of(count: int) -> Iterator[slice]:
    """Yield parts of many starts, few at first: they find the attractors that spare others their
    time."""
    done, size = 0, 1
    while done < count:
        yield slice(done, min(done + size, count))
        done, size = done + size, min(8 * size, LARGEST)


def require_basins(model: Model) -> None:
    """Raise `InputError` for a system whose basins are not looked at."""
    accepted = "find_attractors lists what random starts lead to"
    require_forcing(model, "model", "starts of basins have a phase in", accepted)


def attractor_numbers(
    simulator: Simulator,
    states: Sequence[State],
    found: list[Attractor],
    settling: Settling,
    threads: int | None = None,
) -> list[int]:
    """Return the number of the attractor of each start; new ones are added to the list."""
    require_basins(simulator.model)
    batch = Batch(simulator, states, threads)
    numbers = np.full(len(states), -1)
    left, known = np.arange(len(states)), len(found)
    for _ in range(max(settling.transient // 10, 1)):
        kept = left.tolist() if any(map(_is_known_by_releases, found)) else ()
        before = {k: batch.state(k) for k in kept}
        outcomes = batch.run(left, 10)
        left = left[[outcome is Outcome.DONE for outcome in outcomes]]
        for number, attractor in enumerate(found):
            numbers[left[_reached(attractor, batch, left, before)]] = number
            left = left[numbers[left] < 0]
    for k in np.flatnonzero(numbers < 0).tolist():
        one, none = np.array([k]), {k: batch.state(k)}
        for number in range(known, len(found)) if k in left else ():
            if numbers[k] < 0 and _reached(found[number], batch, one, none)[0]:
                numbers[k] = number
        if numbers[k] < 0:
            numbers[k] = _settled_number(simulator, batch.state(k), found, settling)
    return numbers.tolist()


def _settled_number(
    simulator: Simulator, state: State, found: list[Attractor], settling: Settling
) -> int:
    """The number of the attractor that a motion settles on.

    Where complex motion is among the attractors, one that has not settled after a tenth of the
    periods of `settling`, and whose impacts are near to it, is taken for it.
    """
    kinds = [attractor.kind for attractor in found]
    if Kind.COMPLEX in kinds:
        quick = replace(settling, transient=0, periods=settling.periods // 10, impacts=200)
        attractor = settle(simulator, state, quick)
        if attractor.kind in (Kind.COMPLEX, Kind.NOT_SETTLED):
            apart = [_apart(attractor, one) if one.kind is Kind.COMPLEX else OTHER for one in found]
            if min(apart) < 1.0:
                return apart.index(min(apart))
            attractor = settle(simulator, state, settling)
    else:
        attractor = settle(simulator, state, settling)
    for number, other in enumerate(found):
        if same_attractor(attractor, other):
            return number
    found.append(attractor)
    return len(found) - 1


def _is_known_by_releases(attractor: Attractor) -> bool:
    """Whether it is a sticking one of one coordinate."""
    return attractor.kind is Kind.STICKING and not attractor.held.size


def _reached(
    attractor: Attractor, batch: Batch, chosen: Array, before: Mapping[int, State]
) -> Array:
    """Whether motions are on a periodic attractor, closely, or are released as a sticking one is.

    `before` has the states from which runs of ten periods led to sticking motion.
    """
    none = np.zeros(len(chosen), dtype=bool)
    if _is_known_by_releases(attractor):
        runs = [batch.simulator.run(before[k], periods=10) for k in chosen.tolist()]
        return np.array([_is_released_as(attractor, run) for run in runs], dtype=bool)
    several = bool(attractor.held.size)
    if attractor.period is None or not (several or attractor.kind is Kind.PERIODIC):
        return none
    mine = impact_table(attractor.times, attractor)
    sizes = natural_sizes(mine[:, 1:], attractor.forcing_period)
    theirs = np.column_stack([batch.phases[chosen], batch.sections[chosen]])
    apart = (mine - theirs[:, None]) / sizes
    apart[:, :, 0] -= np.round(apart[:, :, 0])
    same = attractor.walls == batch.walls[chosen, None]
    if several:
        same &= attractor.held == batch.held[chosen, None]
    return np.any(same & (np.max(np.abs(apart), axis=2) < REACHED), axis=1)


def _is_released_as(attractor: Attractor, run: Run) -> bool:
    """Whether the last release of a run is one of a sticking attractor."""
    mine = attractor.times[attractor.released] % attractor.forcing_period
    walls, near = attractor.walls[attractor.released], REACHED * attractor.forcing_period
    return any(
        bool(np.any((walls == run.walls[row]) & (abs(mine - run.phases[row]) < near)))
        for row in np.nonzero(run.released)[0][-1:]
    )


# Which attractors the branches explain, and what would follow those that none does.
#
# An attractor lies on a branch if the branch has its word and period and, solved for at the
# attractor's parameter value from the neighbouring points, its velocities and phases. The branch
# says what it is; the simulation, which shares no solver with it, says that it is there.

MATCH, STILL = 1e-7, 1e-6
"""An attractor this near to a branch's orbit lies on it: in phase, and in parts of the largest
velocity; a motion without impacts counts as no smaller than this part of the walls' places."""


@dataclass(frozen=True)
class Match:
    """An attractor and the branch it lies on; `distance` is the largest difference."""

    direction: str
    value: float
    notation: str
    word: str
    period: int
    branch: str
    distance: float


@dataclass(frozen=True)
class UncoveredGroup:
    """Attractors of one word, side by side in a sweep, that no branch explains."""

    kind: str
    notation: str
    word: str | None
    period: int | None
    """`kind`, `notation`, `word`, `period`: what they are."""
    low: float
    high: float
    """`low`, `high`: values of the parameter between which they were met."""
    count: int
    why: str
    scene: str | None
    """Tables of a scene that would follow them, in TOML; None for what is no periodic orbit."""


@dataclass(frozen=True)
class Coverage:
    """Attractors on branches, and the others."""

    matches: Sequence[Match]
    uncovered: Sequence[UncoveredGroup]

    def as_record(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


@explain_arguments
def cover(sweep: Sweep, diagram: Diagram, kernels: Kernels | None = None) -> Coverage:
    """Match the attractors of a sweep with the branches of a diagram.

    Parameters
    ----------
    sweep : Sweep
    diagram : Diagram
        Followed in the same parameter, at the same values of the others.
    kernels : Kernels, optional

    Returns
    -------
    Coverage
    """
    kernels = kernels or Kernels(sweep.model, sweep.parameter)
    matches: list[Match] = []
    rest: list[Row] = []
    for row in sweep.rows:
        match = _match(row, sweep, diagram, kernels)
        if match is not None:
            matches.append(match)
        else:
            rest.append(row)
    return Coverage(matches, _uncovered_groups(rest, sweep))


def _match(row: Row, sweep: Sweep, diagram: Diagram, kernels: Kernels) -> Match | None:
    """The nearest orbit on a branch, or mirror image of one; those of a motion without impacts are
    in the first mode."""
    attractor, found = row.attractor, []
    word, period, still = attractor.word, attractor.period, attractor.motion is not None
    if still and _first_mode(attractor, sweep):
        word, period = "", int(not attractor.free)
    elif still or attractor.kind is not Kind.PERIODIC or word is None or period is None:
        return None
    model = sweep.model.replace(**{sweep.parameter: row.value})
    symmetry = model.symmetry(sweep.parameter, kernels.harmonics(*model.values.values()))
    walls = {} if symmetry is None else symmetry.walls
    for branch in diagram.branches:
        image = "".join(walls.get(wall, wall) for wall in branch.word)
        if branch.period != period or not any(is_rotation(w, word) for w in (branch.word, image)):
            continue
        for problem, unknowns in _orbits_and_images(branch, sweep, row.value, kernels, symmetry):
            if still:
                distance = _distance_of_motions(attractor, problem, unknowns)
            else:
                distance = _distance(attractor, problem.word.walls, problem.impacts(unknowns))
            what = attractor.notation, word or "0", period
            found.append(Match(row.direction, row.value, *what, branch.id, distance))
    near = [match for match in found if match.distance < MATCH]
    return min(near, key=lambda match: match.distance, default=None)


def _orbits_and_images(
    branch: Branch, sweep: Sweep, value: float, kernels: Kernels, symmetry: Symmetry | None
) -> Iterator[tuple[OrbitProblem, Array]]:
    """The orbits of a branch at a parameter value, and their mirror images."""
    for orbit in orbits_on(branch, sweep, value, kernels):
        own = orbit.problem, orbit.unknowns
        yield own
        if symmetry is not None and (image := mirror_orbit(*own, symmetry)):
            yield image


def _distance_of_motions(attractor: Attractor, problem: OrbitProblem, unknowns: Array) -> float:
    """How far a motion without impacts is from an orbit, in parts of its size."""
    pair = np.array([unknowns[: problem.m], attractor.unknowns])
    mine, theirs = natural_places(pair, attractor.forcing_period)
    walls = problem.setup(unknowns).walls
    size = max(float(np.max(np.abs(theirs))), STILL * max(map(abs, map(float, walls))))
    return float(np.max(np.abs(mine - theirs))) / (size or 1.0)


def _first_mode(attractor: Attractor, sweep: Sweep) -> bool:
    return attractor.mode in {mode.name for mode in sweep.model.MODES[:1]} | {""}


def orbits_on(branch: Branch, sweep: Sweep, value: float, kernels: Kernels) -> list[Orbit]:
    """Return the orbits of a branch at a parameter value.

    Each is solved for at that value from the line between the neighbouring points.
    """
    parameters = branch[branch.parameter]
    offset = parameters - value
    rows = np.nonzero((offset[:-1] <= 0.0) != (offset[1:] <= 0.0))[0].tolist()
    rows += [k for k in (0, len(parameters) - 1) if offset[k] == 0.0]
    model = sweep.model.replace(**{sweep.parameter: value})
    problem = problem_of(model, Word(branch.word, branch.period), kernels)
    found = []
    for row in rows:
        after = min(row + 1, len(parameters) - 1)
        step = parameters[after] - parameters[row]
        part = (value - parameters[row]) / step if step else 0.0
        points = [impacts_at(branch, k, problem).ravel() for k in (row, after)]
        guess = points[0] + part * (points[1] - points[0])
        here = solve_near(problem, np.append(guess, value))
        if here is not None:
            found.append(Orbit(problem, here))
    return found


def is_orbit(attractor: Attractor, word: Word, impacts: Array) -> bool:
    """Whether an attractor is the orbit of a word with these impacts, shape (N, m)."""
    if attractor.kind is not Kind.PERIODIC or attractor.period != word.period:
        return False
    return _distance(attractor, word.walls, impacts) < MATCH


def begins_with(orbit: Orbit, word: Word, first: tuple[float, float]) -> bool:
    """Whether an orbit's impacts, begun so that they read as a word, begin with this time and
    velocity."""
    walls, period = orbit.word.walls, orbit.period / orbit.word.period
    for k in range(len(walls)):
        if walls[k:] + walls[:k] == word.walls:
            largest = float(np.max(np.abs(orbit.velocities))) or 1.0
            apart = (orbit.times[k] - first[0]) / period, (orbit.velocities[k] - first[1]) / largest
            if max(abs(apart[0] - round(apart[0])), abs(apart[1])) < MATCH:
                return True
    return False


def _distance(attractor: Attractor, word: str, orbit: Array) -> float:
    """Largest difference in natural sizes, the least over the rotations of the word; of long words
    a file has the first impacts alone."""
    letters, table = attractor.word or "", impact_table(attractor.times, attractor)
    sizes = natural_sizes(table[:, 1:], attractor.forcing_period, attractor.free)
    shifts = [k for k in range(len(word)) if word[k:] + word[:k] == letters]
    turned = (np.roll(orbit, -k, axis=0)[: len(table)] for k in shifts)
    apart = [states_apart(each - table, sizes) for each in turned]
    return min((float(np.max(each)) for each in apart), default=math.inf)


def _uncovered_groups(rows: Sequence[Row], sweep: Sweep) -> list[UncoveredGroup]:
    """Group rows by what they are; the middle one of each group starts the scene."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row.attractor.label, []).append(row)
    found = []
    for group in groups.values():
        group = sorted(group, key=lambda row: row.value)
        middle = group[len(group) // 2]
        a = middle.attractor
        moves = a.motion is not None and not a.rests
        periodic = a.kind is Kind.PERIODIC or (moves and _first_mode(a, sweep))
        why = f"{a.kind.value}: no orbit of finite word"
        if periodic:
            why = "no branch has this orbit"
        elif a.motion is not None and not moves:
            why = f"{a.notation}: equilibria are not followed"
        elif a.motion is not None:
            why = f"{a.notation}: the word 0 is that of the first mode"
        elif a.kind is Kind.NO_IMPACT:
            why = f"{a.notation}: its motion, which may be an orbit 0, is not known"
        scene = scene_fragment(middle, sweep) if periodic else None
        what = (a.kind.value, a.notation, a.word, a.period)
        found.append(UncoveredGroup(*what, group[0].value, group[-1].value, len(group), why, scene))
    return found


def scene_fragment(row: Row, sweep: Sweep) -> str:
    """Return the tables [model] and [follow] of a scene that follows an attractor, in TOML."""
    attractor, model = row.attractor, sweep.model
    values: Mapping[str, float] = {**model.values, sweep.parameter: float(row.value)}
    others = [float(other.value) for other in sweep.rows]
    low, high = min(others), max(others)
    word = Word(attractor.word or "", 0 if attractor.free else attractor.period or 1)
    options = [f'{name} = "{text}"' for name, text in model.options.items()]
    lines = ["[model]", f'system = "{model.SYSTEM}"', *options, "", "[model.parameters]"]
    lines += [f"{name} = {value!r}" for name, value in values.items()]
    lines += ["", "[follow]", f'parameter = "{sweep.parameter}"', f"range = [{low!r}, {high!r}]"]
    return "\n".join([*lines, f'orbits = ["{word}"]', ""])
