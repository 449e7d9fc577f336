"""How likely each motion is: basin fractions along a parameter, from random starts in a box.

Attractors at neighbouring values are one motion if the orbit of one, followed to the next value, is
the other. Where it has ended or become unstable on the way they are if their counts of impacts are:
1:1, 1:1/2T and 1:1/C, which follow each other where a period doubles, are one band; of several with
the same counts the nearest in phase and velocity. Intervals are those of Clopper and Pearson.
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
from ..errors import InputError, explain_arguments, short_repr
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..orbits.search import solve_near
from ..progress import Asked, progress_lines
from ..results.options import MOST_FRACTION_STARTS, MOST_ROUNDS, SETTLING, Settling, check_pairs
from ..results.ranges import FRACTIONS, Share, shorten_names
from ..segments.kernels import Kernels
from ..storage.files import csv_text
from .attractor import OTHER, Attractor, Kind, distances_between
from .basins import attractor_numbers, is_orbit, parts_of
from .run import OutsideError, State
from .settle import settle
from .simulator import Simulator
from .sweep import Simulators

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
    given, count = dict(box or {}), simulator.model.DEGREES_OF_FREEDOM
    if others := sorted(given.keys() - {"time", "position", "velocity"}):
        raise InputError("box", f"the key {others[0]!r}", "give time, position, velocity")
    time = check_pairs("box.time", given.get("time", (0.0, simulator.period)), 1)[0]
    positions = given.get("position")
    two = count == 1 and len({*simulator.sides}) == 2
    if positions is None and not two:
        accepted = f"give box.position, {count} pairs of numbers"
        raise InputError("box.position", "no two walls that bound all positions", accepted)
    fastest = simulator.fastest
    velocities = given.get("velocity", [(-fastest, fastest)] * count)
    return StartBox(
        time,
        None if positions is None else check_pairs("box.position", positions, count),
        check_pairs("box.velocity", velocities, count),
    )


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
        return Summary(f"Basin fractions, {self.starts} starts at each value", columns, rows, [])

    def __repr__(self) -> str:
        count = len(self.values)
        head = f"Basin fractions of {self.starts} starts at {count} values of {self.parameter}"
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
        if type(number) is not int or not least <= number <= most:
            accepted = f"give a whole number from {least} to {most}"
            raise InputError(name, f"found {short_repr(number)}", accepted)
    if not 0.0 < confidence < 1.0:
        raise InputError("confidence", f"found {confidence}", "give a number between 0 and 1")
    simulators = Simulators(model, parameter, Kernels(model, parameter))
    counted: dict[float, tuple[list[Attractor], Array]] = {}
    join = partial(join_values, simulators, counted, starts, confidence)
    try:
        with progress_lines(progress, "basin_fractions") as report:
            for depth in range(refine + 1):
                for value in given:
                    report(f"{parameter} = {value:.9g}: {starts} starts")
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
    area, generator = start_box(simulator, box), np.random.default_rng(rng)
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


def require_starts(simulator: Simulator, box: Mapping[str, Any] | None, where: str) -> None:
    """Raise `InputError` where no motion can start in a box."""
    try:
        _start(start_box(simulator, box), simulator, np.random.default_rng(0))
    except InputError as error:
        raise error.within(where) from None


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
