"""Integrity: how likely each motion is, and how far it may be moved before it leads elsewhere.

Basin fractions along a parameter are counted from random starts in a box. Attractors at
neighbouring values are one motion if the orbit of one, followed to the next value, is the other.
Where it has ended or become unstable on the way they are if their counts of impacts are: 1:1,
1:1/2T and 1:1/C, which follow each other where a period doubles, are one band; of several with the
same counts the nearest in phase and velocity. Intervals are those of Clopper and Pearson.

Local integrity is the distance from an orbit to the nearest boundary of its basin, a measure of how
large a disturbance it survives (Soliman and Thompson, 1989). It is measured among the states before
impacts: phase in periods, every other coordinate in the largest value that the orbit has of it.
Rings of starts around each impact are simulated, the smallest first; in the first one from which
motion leads elsewhere the boundary is found by bisection, and then the nearest part of it by
turning the direction.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..display import NotebookResult, Summary, frame
from ..errors import (
    InputError,
    count_text,
    explain_arguments,
    random_generator,
    require_whole,
    short_repr,
)
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..orbits.search import solve_near
from ..progress import Asked, progress_lines
from ..results.catalogue import FRACTIONS, Share, shorten_names
from ..results.options import MOST_FRACTION_STARTS, MOST_ROUNDS, SETTLING, Settling, check_box
from ..segments.kernels import Kernels
from ..storage import csv_text
from .attractor import OTHER, Attractor, Kind, distances_between, own_sizes
from .run import Outcome, OutsideError, State
from .settle import settle
from .simulator import Simulator
from .sweep import Simulators, attractor_numbers, is_orbit, parts_of, require_basins

if TYPE_CHECKING:
    from pandas import DataFrame


STEPS = 100
"""Solutions tried at most on the way of an orbit from one value to the next."""
OFF = 0.1
"""Part of a step along the tangent by which the orbit may be beside it."""
DRAWS = 1000
"""How often a start beyond a wall is drawn again."""


@dataclass(frozen=True)
class StartBox:
    """Where motions start: uniformly at random in a box of times, positions and velocities, as far
    as it lies within the walls."""

    time: tuple[float, float]
    """In the model's clock."""
    positions: tuple[tuple[float, float], ...] | None
    """A pair for each coordinate; None for one coordinate from wall to wall, wherever they are."""
    velocities: tuple[tuple[float, float], ...]

    def draw(
        self, simulator: Simulator, rng: np.random.Generator
    ) -> tuple[float, list[float], list[float]]:
        """Return time, positions and velocities of a start."""
        walls = (min(simulator.positions), max(simulator.positions))
        pairs = (walls,) if self.positions is None else self.positions
        sides = np.array([self.time, *pairs, *self.velocities])
        time, *rest = rng.uniform(*sides.T).tolist()
        return time, rest[: len(pairs)], rest[len(pairs) :]


def start_box(simulator: Simulator, box: Mapping[str, Any] | None = None) -> StartBox:
    """Return the box of starts that a mapping states, with defaults for what it leaves out.

    It has ``time`` (low, high), a forcing period by default; ``position`` and ``velocity``, a pair
    for one coordinate or a list of pairs for several. By default one coordinate starts between its
    walls, and velocities are up to what half a period of the largest acceleration gives.

    Raises InputError for another key, a pair that is none, or a position that has to be given.
    """
    if box is not None and not isinstance(box, Mapping):
        raise InputError("box", f"found {short_repr(box)}", "give time, position, velocity")
    require_basins(simulator.model)
    count, fastest = simulator.model.DEGREES_OF_FREEDOM, simulator.fastest
    given = check_box(box or {}, "box", count)
    two = count == 1 and len({*simulator.sides}) == 2
    if "position" not in given and not two:
        accepted = f"give box.position, {count} pairs of numbers"
        raise InputError("box.position", "no two walls that bound all positions", accepted)
    (time,) = given.get("time", ((0.0, simulator.period),))
    velocities = given.get("velocity", ((-fastest, fastest),) * count)
    return StartBox(time, given.get("position"), velocities)


@dataclass(frozen=True)
class Tipping:
    """Where a motion vanishes, or appears, between two neighbouring values."""

    motion: str
    vanishes: bool
    """With rising values of the parameter; otherwise it appears."""
    low: float
    high: float

    def __str__(self) -> str:
        what = "vanishes" if self.vanishes else "appears"
        return f"{self.motion} {what} between {self.low:.9g} and {self.high:.9g}"


@dataclass(frozen=True, eq=False)
class BasinFractions(NotebookResult):
    """What part of random starts leads to each motion, along a parameter."""

    parameter: str
    values: list[float]
    """Rising."""
    starts: int
    """At each value."""
    counts: Array
    """Starts that lead to each motion, shape (values, motions)."""
    attractors: list[dict[int, Attractor]] = field(repr=False)
    """For each value the attractors, by the number of their motion."""
    confidence: float = 0.95
    interrupted: bool = False
    """Whether the keyboard interrupted, so that values are missing."""

    @property
    def fractions(self) -> Array:
        """Parts of the starts, shape (values, motions); rows add up to one."""
        return self.counts / self.starts

    @property
    def intervals(self) -> tuple[Array, Array]:
        """Lowest and largest probabilities, each shape (values, motions), that agree with the
        counts at the confidence, each by itself (Clopper and Pearson, 1934)."""
        from scipy.stats import beta

        k, n, tail = self.counts, self.starts, (1.0 - self.confidence) / 2.0
        low = np.where(k > 0, beta.ppf(tail, np.maximum(k, 1), n - k + 1), 0.0)
        high = np.where(k < n, beta.ppf(1.0 - tail, k + 1, np.maximum(n - k, 1)), 1.0)
        return low, high

    @property
    def motions(self) -> list[str]:
        """What each motion is called along the values: ``1:1, 1:1/2T, 1:1/C``."""
        return [
            shorten_names([there[number].notation for there in self.attractors if number in there])
            for number in range(self.counts.shape[1])
        ]

    @property
    def shares(self) -> list[Share]:
        """The fraction of each motion at each value."""
        return [Share.of(row) for row in self.rows()]

    @property
    def tippings(self) -> list[Tipping]:
        """Where motions appear and vanish."""
        found = list[Tipping]()
        for number, name in enumerate(self.motions):
            there = self.counts[:, number] > 0
            found += [
                Tipping(name, bool(there[k]), self.values[k], self.values[k + 1])
                for k in np.nonzero(there[1:] != there[:-1])[0].tolist()
            ]
        return sorted(found, key=lambda tipping: tipping.low)

    def between(self) -> list[float]:
        """Return values half way between neighbours whose fractions differ by more than both
        intervals."""
        low, high = self.intervals
        apart = np.any((low[1:] > high[:-1]) | (low[:-1] > high[1:]), axis=1)
        ends = zip(self.values, self.values[1:], apart, strict=False)
        return [0.5 * (a + b) for a, b, differ in ends if differ]

    def rows(self) -> list[tuple[Any, ...]]:
        """Return rows of value, number of the motion, notation, starts that lead there, their
        fraction, its interval, and of a periodic motion word, period, and time and velocity of its
        first impact."""
        low, high = self.intervals
        return [
            (
                value,
                k + 1,
                there[k].notation,
                int(self.counts[i, k]),
                float(self.fractions[i, k]),
                float(low[i, k]),
                float(high[i, k]),
                *_first_impact(there[k]),
            )
            for i, (value, there) in enumerate(zip(self.values, self.attractors, strict=True))
            for k in sorted(there)
        ]

    def to_dataframe(self) -> DataFrame:
        """Return the rows as a pandas DataFrame; pandas must be installed."""
        columns = zip(*self.rows(), strict=True)
        return frame(dict(zip(COLUMNS, map(list, columns), strict=True)))

    def summary(self) -> Summary:
        """Return the fractions in short."""
        rows = [
            (f"{value:.9g}", name, f"{part:.4g}", f"{low:.3g} to {high:.3g}")
            for value, _, name, _, part, low, high, *_ in self.rows()
        ]
        columns = (self.parameter, "motion", "fraction", f"{100 * self.confidence:g} %")
        return Summary(
            f"Basin fractions, {count_text(self.starts, 'start')} at each value", columns, rows, []
        )

    def __repr__(self) -> str:
        starts, values = count_text(self.starts, "start"), count_text(len(self.values), "value")
        head = f"Basin fractions of {starts} at {values} of {self.parameter}"
        parts = zip(self.motions, 100.0 * self.fractions.T, strict=True)
        lines = [f"  {name}: {part.min():.3g} to {part.max():.3g} %" for name, part in parts]
        return "\n".join([head, *lines, *(f"  {tipping}" for tipping in self.tippings)])


def fractions_text(found: BasinFractions) -> str:
    """Return ``fractions.csv``."""
    head = {"schema": FRACTIONS, "parameter": found.parameter, "starts": found.starts}
    comment = json.dumps({**head, "confidence": found.confidence})
    return f"# {comment}\n" + csv_text([found.parameter, *COLUMNS[1:]], found.rows())


COLUMNS = (
    *("value", "motion", "notation", "count", "fraction", "low", "high"),
    *("word", "period", "time", "velocity"),
)


def _first_impact(attractor: Attractor) -> tuple[Any, ...]:
    """By what an orbit is known again: word, period, and time and velocity of its first impact."""
    if attractor.kind is not Kind.PERIODIC:
        return (None,) * 4
    first = float(attractor.times[0]), float(attractor.velocities[0])
    return attractor.word, attractor.period, *first


@explain_arguments
def basin_fractions(
    model: Model,
    parameter: str,
    values: Iterable[float],
    *,
    starts: int = 1000,
    box: Mapping[str, Any] | None = None,
    refine: int = 0,
    settling: Settling = SETTLING,
    rng: int = 0,
    confidence: float = 0.95,
    progress: Asked = False,
) -> BasinFractions:
    """Count to which motion random starts lead, at values of a parameter.

    Parameters
    ----------
    model : Model
    parameter : str
    values : iterable of float
    starts : int
        At each value; the same for the same `rng`, whatever other values there are.
    box : mapping, optional
        Where they start; see `start_box`.
    refine : int
        How often values are put half way between neighbours whose fractions differ by more than
        both intervals.
    settling : Settling
        Where motion is complex, a start that has not settled after a tenth of its periods is taken
        for complex.
    rng : int
        Seed.
    confidence : float
        Of the intervals.
    progress : bool or callable
        Whether to report on standard error, or a function to call with lines of text.

    Returns
    -------
    BasinFractions
        After Ctrl-C with the values counted until then, if there are any.

    Raises
    ------
    InputError
        For values, starts or a box that cannot be.
    """
    try:
        given = sorted({float(value) for value in values})
    except (TypeError, ValueError):
        accepted = "give values of the parameter, such as [0.3, 0.35]"
        raise InputError("values", f"found {short_repr(values)}", accepted) from None
    if not given:
        raise InputError("values", "no values", "give at least one value of the parameter")
    whole = (("starts", starts, 1, MOST_FRACTION_STARTS), ("refine", refine, 0, MOST_ROUNDS))
    for name, number, least, most in whole:
        require_whole(number, name, least, most)
    if not 0.0 < confidence < 1.0:
        raise InputError("confidence", f"found {confidence}", "give a number between 0 and 1")
    simulators = Simulators(model, parameter, Kernels(model, parameter))
    counted: dict[float, tuple[list[Attractor], Array]] = {}
    join = partial(join_values, simulators, counted, starts, confidence)
    try:
        with progress_lines(progress, "basin_fractions") as report:
            for depth in range(refine + 1):
                for value in given:
                    report(f"{parameter} = {value:.9g}: {count_text(starts, 'start')}")
                    counted[value] = _count(simulators.at(value), starts, box, settling, rng)
                given = join().between() if depth < refine else []
    except KeyboardInterrupt:
        if not counted:
            raise
        return replace(join(), interrupted=True)
    return join()


def _count(
    simulator: Simulator, starts: int, box: Mapping[str, Any] | None, settling: Settling, rng: int
) -> tuple[list[Attractor], Array]:
    """The attractors that starts lead to, and how many lead to each."""
    area, generator = start_box(simulator, box), random_generator(rng)
    drawn = [_start(area, simulator, generator) for _ in range(starts)]
    states = [state for state in drawn if state is not None]
    known: list[Attractor] = []
    numbers = list[int]()
    for part in parts_of(len(states)):
        numbers += attractor_numbers(simulator, states[part], known, settling)
    if len(states) < starts:  # some meet no wall
        motion = settle(simulator, None, settling)
        labels = [one.label for one in known]
        known += [motion] * (motion.label not in labels)
        numbers += [[*labels, motion.label].index(motion.label)] * (starts - len(states))
    return known, np.bincount(numbers, minlength=len(known))


def require_starts(simulator: Simulator, box: Mapping[str, Any] | None) -> None:
    """Raise `InputError` where no motion of a scene that counts fractions can start in its box."""
    try:
        _start(start_box(simulator, box), simulator, np.random.default_rng(0))
    except InputError as error:
        stated = "simulate.box" if box else "simulate.fractions"
        raise error.within("simulate" if error.where.startswith("box") else stated) from None


def _start(area: StartBox, simulator: Simulator, generator: np.random.Generator) -> State | None:
    """A start in the box within the walls."""
    for _ in range(DRAWS):
        try:
            return simulator.start(*area.draw(simulator, generator))
        except OutsideError as error:
            beyond = error
    found = f"{DRAWS} starts in a row beyond a wall"
    raise InputError(
        "box.position", found, "give a box that is mostly within the walls"
    ) from beyond


# The same motion at neighbouring values.


def join_values(
    simulators: Simulators,
    found: Mapping[float, tuple[list[Attractor], Array]],
    starts: int,
    confidence: float,
) -> BasinFractions:
    """Number motions along all values: each attractor continues the nearest one before."""
    from scipy.optimize import linear_sum_assignment

    values = sorted(found)
    last: list[Attractor] = []
    rows: list[dict[int, int]] = []
    attractors: list[dict[int, Attractor]] = []
    for value in values:
        known, counts = found[value]
        costs = np.empty((len(known), len(last)))
        for number, other in enumerate(last):
            costs[:, number] = _costs(other, known, simulators, value)
        numbers = {
            int(one): int(number)
            for one, number in zip(*linear_sum_assignment(costs), strict=True)
            if costs[one, number] < OTHER
        }
        for one, attractor in enumerate(known):
            number = numbers.setdefault(one, len(last))
            if number == len(last):
                last.append(attractor)
            last[number] = attractor
        rows.append({numbers[one]: int(count) for one, count in enumerate(counts)})
        attractors.append({numbers[one]: attractor for one, attractor in enumerate(known)})
    table = np.array([[row.get(k, 0) for k in range(len(last))] for row in rows])
    return BasinFractions(simulators.parameter, values, starts, table, attractors, confidence)


def _costs(
    before: Attractor, known: Sequence[Attractor], simulators: Simulators, value: float
) -> list[float]:
    """How far each attractor at a value is from continuing one before: by the orbit itself if it
    can be followed, and else by counts of impacts, phases and velocities."""
    orbit = None
    if before.kind is Kind.PERIODIC and any(before.word == one.word for one in known):
        orbit = _followed(before.orbit(simulators.model, simulators.parameter), value)
    counts = before.notation.partition("/")[0]
    costs = [
        max(distances_between(one, before)) if one.notation.partition("/")[0] == counts else OTHER
        for one in known
    ]
    if orbit is None:
        return costs
    impacts, stable = orbit.problem.impacts(orbit.unknowns), orbit.stable and orbit.physical
    for k, one in enumerate(known):
        if stable or (one.word, one.period) == (before.word, before.period):
            same = is_orbit(one, orbit.word, impacts)
            costs[k] = -1.0 if same else OTHER
    return costs


def _followed(orbit: Orbit, value: float) -> Orbit | None:
    """The orbit at another value of its parameter, followed along tangents in steps that keep
    beside them; None if it ends on the way."""
    part = 1.0
    for _ in range(STEPS):
        problem, here = orbit.problem, orbit.linearisation
        step = part * (value - orbit.value)
        if step == 0.0:
            return orbit
        at = here.jacobian[:, : problem.n], here.jacobian[:, problem.n]
        try:
            along = np.append(-np.linalg.solve(*at), 1.0) * step
        except np.linalg.LinAlgError:
            return None
        there = solve_near(problem, orbit.unknowns + along)
        off = np.inf if there is None else np.max(np.abs(there.unknowns - orbit.unknowns - along))
        if there is None or off > OFF * np.max(np.abs(along)):
            part *= 0.5
        else:
            orbit, part = Orbit(problem, there), min(2.0 * part, 1.0)
    return None


SMALLEST, RATIO = 1e-4, 1.12
"""Radius of the first ring, and of each ring in that of the one before."""
SECTIONS = 16
"""Parts into which a stretch with a boundary is divided at once."""
TURNS = 24
"""Rounds in which directions around the nearest are tried, each within 0.7 of the last angle."""
CHECKS = 4
"""How often a nearer boundary is looked for in sixteen times as many random directions."""
SETTLED = 4
"""Rounds from whose gain it is seen how well the nearest direction is known."""
FINEST = 1e-9
"""Part of the distance to which it is bracketed."""


@dataclass(frozen=True, eq=False)
class Integrity:
    """Distance of a stable orbit from the nearest boundary of its basin; see `integrity`."""

    distance: float
    """In the units of `sizes`; `largest` if no start led elsewhere."""
    error: float
    """Width of the last bracket, or what the last rounds of directions have gained. A part of the
    basin of another motion that is thinner than the spacing of starts may be nearer."""
    bounded: bool
    """Whether a boundary was met."""
    impact: int
    """The impact, from 1 on, that is moved."""
    wall: str
    change: Array
    """What is added to its time, velocity and other coordinates at the boundary, shape (m,)."""
    leads_to: str
    """What is reached beyond the boundary."""
    sizes: Array
    """Units of the coordinates: the period, the orbit's largest velocity before impact, and the
    largest of each other coordinate, shape (m,)."""
    starts: int
    """Starts simulated."""
    orbit: Orbit = field(repr=False)

    def __repr__(self) -> str:
        name, starts = (
            f"Integrity of {self.orbit.notation}",
            f"; {count_text(self.starts, 'start')}",
        )
        if not self.bounded:
            return f"{name}: {self.distance:.6g} or more{starts}"
        changes = ", ".join(f"{value:+.4g}" for value in self.change)
        moved = f"impact {self.impact} on {self.wall} moved by ({changes})"
        value = f"{self.distance:.9g} (+- {self.error:.1g})"
        return f"{name}: {value}; {moved} leads to {self.leads_to}{starts}"


@explain_arguments
def integrity(
    orbit: Orbit,
    *,
    directions: int = 64,
    largest: float = 0.5,
    settling: Settling = SETTLING,
    rng: int = 0,
) -> Integrity:
    """Return how far a stable orbit is from the nearest boundary of its basin.

    Parameters
    ----------
    orbit : Orbit
        Stable and physical, with impacts.
    directions : int
        Starts on a ring around each impact. With one coordinate they are at equal angles, else at
        random.
    largest : float
        Largest distance looked at, in periods and in the orbit's largest velocity.
    settling : Settling
    rng : int
        Seed.

    Returns
    -------
    Integrity

    Raises
    ------
    InputError
        If the orbit is not stable, not physical, without impacts, or so near a boundary that a
        simulation leaves it; if numbers cannot be.
    """
    if not (orbit.stable and orbit.physical and orbit.word):
        found = "no impacts" if not orbit.word else "an orbit that cannot be observed"
        raise InputError("orbit", found, "give a stable physical orbit with impacts")
    if directions < 3 or not 0.0 < largest <= 10.0:
        found = f"directions {directions}, largest {largest}"
        raise InputError("integrity", found, "give at least 3 directions, and 0 < largest <= 10")
    return _Search(orbit, settling).nearest(directions, largest, random_generator(rng))


def _unit(rays: Array) -> Array:
    return np.asarray(rays / np.linalg.norm(rays, axis=1)[:, None])


class _Search:
    """Starts around an orbit, and where they lead."""

    def __init__(self, orbit: Orbit, settling: Settling) -> None:
        require_basins(orbit.model)
        self.orbit, self.settling = orbit, settling
        self.simulator = Simulator(orbit.model)
        self.impacts = np.asarray(orbit.problem.impacts(orbit.unknowns), dtype=float)
        self.sizes = own_sizes(self.impacts[:, 1:], self.simulator.period)
        start = self.state(0, np.zeros(self.impacts.shape[1]))
        self.known: list[Attractor] = [settle(self.simulator, start, settling)]
        if (reached := self.known[0].notation) != orbit.notation:
            found = f"simulated from {orbit.notation}, motion comes to {reached}"
            raise InputError("orbit", found, "give an orbit whose basin a simulation can resolve")
        self.starts = self.directions = 0
        self.moves = np.array([self.moving(k) for k in range(len(self.impacts))])

    def moving(self, impact: int) -> list[bool]:
        """Which coordinates of an impact change the motion: rates of first order do not."""
        unit, still = 1e-3 * np.eye(self.impacts.shape[1]), np.zeros(self.impacts.shape[1])
        here, *moved = (self.state(impact, change) for change in [still, *unit])
        ends = [s and self.simulator.run(s, impacts=1).end for s in (here, *moved)]
        return [end != ends[0] for end in ends[1:]]

    def state(self, impact: int, change: Array) -> State | None:
        """The start with an impact moved; None where it would run away from the wall."""
        time, velocity, *others = (self.impacts[impact] + self.sizes * change).tolist()
        wall = self.orbit.word.walls[impact]
        if velocity * self.simulator.sides[self.simulator.letters.index(wall)] <= 0.0:
            return None
        return self.simulator.state(wall, time % self.simulator.period, velocity, others)

    def reached(self, impacts: Array, changes: Array) -> Array:
        """The number of the attractor that each start leads to; the orbit's is 0."""
        states = [self.state(int(k), change) for k, change in zip(impacts, changes, strict=True)]
        there = [k for k, state in enumerate(states) if state is not None]
        self.starts += len(there)
        numbers = np.zeros(len(states), dtype=int)
        kept = [state for state in states if state is not None]
        numbers[there] = attractor_numbers(self.simulator, kept, self.known, self.settling)
        return numbers

    def bracket(self, impact: int, ray: Array, high: float, width: float) -> tuple[float, float]:
        """A stretch of a ray of at most this part of its length, from whose far end motion leads
        elsewhere, as it does from `high`."""
        low = 0.0
        while high - low > width * high:
            radii = np.linspace(low, high, SECTIONS + 1)[1:-1]
            beyond = self.reached(np.full(len(radii), impact), np.outer(radii, ray))
            first = int(np.argmax(beyond > 0)) if beyond.any() else len(radii)
            low, high = np.array([low, *radii, high])[first : first + 2].tolist()
        return low, high

    def nearest(self, directions: int, largest: float, generator: np.random.Generator) -> Integrity:
        self.directions = directions
        count, size = self.impacts.shape
        angles = 2.0 * np.pi * np.arange(directions) / directions
        rays = np.column_stack([np.cos(angles), np.sin(angles)])
        if size > 2:
            rays = generator.normal(size=(directions, size))
        moved = np.repeat(np.arange(count), directions)
        rays = _unit(np.tile(rays, (count, 1)) * self.moves[moved])
        radius = SMALLEST
        while True:
            beyond = np.flatnonzero(self.reached(moved, radius * rays))
            if beyond.size or radius >= largest:
                break
            radius = min(RATIO * radius, largest)
        if not beyond.size:
            return self.result(largest, 0.0, False, 0, np.zeros(size))
        impact, ray, high, gain = self.narrowed(moved[beyond], rays[beyond], radius, generator)
        moved = np.repeat(np.arange(count), 16 * directions)
        for _ in range(CHECKS if size > 2 else 0):  # random directions may have missed a nearer one
            rays = _unit(generator.normal(size=(len(moved), size)) * self.moves[moved])
            beyond = np.flatnonzero(self.reached(moved, high * rays))
            if not beyond.size:
                break
            again = self.narrowed(moved[beyond], rays[beyond], high, generator)
            impact, ray, high, gain = min((impact, ray, high, gain), again, key=lambda one: one[2])
        inner, high = self.bracket(impact, ray, high, FINEST)
        return self.result(high, max(high - inner, gain), True, impact, high * ray)

    def narrowed(
        self, tried: Array, near: Array, radius: float, generator: np.random.Generator
    ) -> tuple[int, Array, float, float]:
        """The nearest boundary around directions that lead elsewhere at a radius: the impact, the
        direction, the distance, and what the last rounds have gained of it."""
        size, highs = self.impacts.shape[1], list[float]()
        spread, turns = 2.0 * np.pi / self.directions, TURNS
        if size > 2:  # random directions are far apart
            spread, turns = 1.0, 4 * TURNS
        width = min(0.1 * spread**2, 0.1)
        impact, ray, high = int(tried[0]), near[0], radius / (1.0 - width)
        for _ in range(turns):
            before, inside = high, high * (1.0 - width)
            for j in np.flatnonzero(self.reached(tried, inside * near)).tolist():
                k, one = int(tried[j]), near[j]
                inside = high * (1.0 - width)
                if self.reached(np.array([k]), inside * one[None])[0]:
                    impact, ray = k, one
                    high = self.bracket(k, one, inside, width)[1]
            near = ray + spread * generator.uniform(-1.0, 1.0, size=(SECTIONS, size))
            near = _unit(near * self.moves[impact])
            highs.append(high)
            tried = np.full(SECTIONS, impact)
            spread *= 0.7 if size <= 2 or high == before else 1.0
            width = max(0.1 * spread**2, FINEST)
        return impact, ray, high, highs[-SETTLED] - high

    def result(
        self, distance: float, error: float, bounded: bool, impact: int, change: Array
    ) -> Integrity:
        reached = self.reached(np.array([impact]), change[None])[0]
        return Integrity(
            distance,
            error,
            bounded,
            impact + 1,
            self.orbit.word.walls[impact],
            change * self.sizes,
            self.known[reached].notation,
            self.sizes,
            self.starts,
            self.orbit,
        )


# How often noise takes a motion out of a stable orbit: escapes per period, by simulation.
#
# Beside a grazing the map has no derivative, and fluctuations to first order say nothing. Simulated
# motions begin on the orbit; parameters are drawn anew at each impact, for the restitution there
# and the flight that follows, as for `contimpact.orbits.orbit`. A motion escapes when it meets
# another wall than the orbit's word says. Escapes that are independent of each other are a Poisson
# process, whose rate has the interval of Garwood (1936).

TOLD = 100
"""Motions after which progress is reported."""


@dataclass(frozen=True)
class EscapeRate:
    """Escapes of simulated motions from an orbit."""

    escapes: int
    motions: int
    periods: float
    """Forcing periods simulated of all motions together."""
    interval: tuple[float, float]
    """Of the rate, 95 %."""

    @property
    def rate(self) -> float:
        """Escapes per forcing period."""
        return self.escapes / self.periods

    def __repr__(self) -> str:
        low, high = self.interval
        motions = count_text(self.motions, "motion")
        head = f"{self.escapes} of {motions} escape in {self.periods:.6g} periods"
        return f"{head}: {self.rate:.3g} per period ({low:.3g} to {high:.3g})"


@explain_arguments
def escape_rate(
    orbit: Orbit,
    noise: Mapping[str, float],
    *,
    motions: int = 200,
    periods: int = 100,
    rng: np.random.Generator | int = 0,
    progress: Asked = False,
) -> EscapeRate:
    """Simulate how often noise takes motions out of a stable orbit.

    Parameters
    ----------
    orbit : Orbit
        Stable and physical, with impacts, of a forced system.
    noise : mapping of str to float
        Standard deviations of parameters, each drawn anew at each impact.
    motions, periods : int
        Motions, and forcing periods after which each is given up.
    rng : Generator or int
    progress : bool or callable

    Returns
    -------
    EscapeRate

    Raises
    ------
    InputError
        For an orbit that is not physical and stable, noise in the forcing period, or noise that
        takes a parameter out of its range.
    """
    from scipy.stats import chi2

    orbit.fluctuations(noise)  # refuses what has no fluctuations
    for name, count in (("motions", motions), ("periods", periods)):
        require_whole(count, name)
    generator, model = random_generator(rng), orbit.model
    kernels = Kernels(model, next(iter(model.values)))
    still, word = Simulator(model, kernels), orbit.word
    rows = orbit.problem.impacts(orbit.unknowns)
    begin = still.state(word.walls[0], rows[0, 0], rows[0, 1], rows[0, 2:].tolist())
    turns = word.period or 1
    escapes, lasted = 0, 0.0
    with progress_lines(progress, "escape_rate") as tell:
        for motion in range(motions):
            if motion % TOLD == 0:
                tell(f"motion {motion + 1} of {motions}")
            state, escaped = begin, False
            for impact in range(len(word) * -(-periods // turns)):
                moved = {
                    name: model[name] + deviation * generator.standard_normal()
                    for name, deviation in noise.items()
                }
                simulator = Simulator(model.replace(**moved), kernels)
                if simulator.period != still.period:
                    found = "it changes the forcing period"
                    raise InputError("noise", found, "leave that parameter out")
                run = simulator.run(state, impacts=1)
                expected = word.walls[(impact + 1) % len(word)]
                escaped = (
                    run.outcome is not Outcome.DONE
                    or run.end is None
                    or still.letters[run.end.wall] != expected
                )
                if escaped or run.end is None:
                    break
                state = run.end
            escapes += escaped
            lasted += (impact + 1) / len(word) * turns
    low = chi2.ppf(0.025, 2 * escapes) / 2.0 if escapes else 0.0
    high = chi2.ppf(0.975, 2 * escapes + 2) / 2.0
    return EscapeRate(escapes, motions, lasted, (low / lasted, high / lasted))
