"""Crises along sweeps and in the diagrams of scenes, their curves, and how far they are."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, pairwise
from typing import Any

import numpy as np

from ..arrays import Array
from ..bifurcations.crisis import Connected, Connection, error_of, solve
from ..bifurcations.extended_system import EPSILON
from ..continuation.branch import End, EndKind, Event, Point, Points
from ..continuation.settings import Settings
from ..continuation.walk import reraise_interruption, walk
from ..errors import InputError, count_text, explain_arguments
from ..models.guards import Word
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..orbits.quiet import problem_of
from ..orbits.search import find_orbits, solve_near
from ..progress import Asked
from ..results.branch import Branch, Entry, columns_of, orbit_with
from ..results.diagram import Diagram, entry_of, pairs_of, tabulate, with_statistics
from ..results.options import CURVE_SETTINGS, SimulateOptions, tolerance_sizes
from ..results.scene import Scene
from ..segments.kernels import Kernels
from ..simulation.attractor import Attractor, Kind
from ..simulation.simulator import Simulator
from ..simulation.sweep import Row, Simulators, Sweep, orbits_on, sweep
from ..simulation.transitions import locate, neighbours
from ..storage import Json, json_text
from .connection_paths import is_physical
from .crisis_location import (
    CR,
    PATIENT,
    Crisis,
    NoCrisis,
    approach_crisis,
    are_same_orbit,
    is_saddle,
    locate_either,
)
from .orbit_branch import continue_orbit

ENDS = ("FB", "PD", "G")
"""Kinds of events at which the motion that takes over may begin to be stable."""
AWAY = 1e-4
"""Arclength from a period doubling within which that is not another event."""
TAKEOVER = ("label", "notation", "value", "error")
"""What ``crises.json`` has of such an event."""
CRISES = "contimpact.crises/1"
"""Schema of ``crises.json``."""
BANDS, FULL = 64, 10
"""Bands that complex motion may have, and in each as many impacts at least."""
WIDER = 3.0
"""By how much wider bands are beyond a widening."""
WINDOW = 16
"""Steps of a sweep, from a widening on, in which the fold is looked for with which the window with
narrow bands begins, beyond the sweep's values if need be."""
FURTHER = 0.0, 1 / 64, 1 / 8, 1 / 2
"""Parts of the way from an end to the next row at which motion is followed beyond it."""
FOLLOWED, LAST = range(3, 9), 30
"""Impacts of an orbit that it may follow last, and how many before it repeats itself are looked
at."""
FAILING = ArithmeticError, np.linalg.LinAlgError
"""What ends the search at one change of motion; the others are looked at."""
FINER = 1 / 256
"""Part of a step of a sweep to which an end is bisected before crises without a grazing are looked
for."""


@explain_arguments
def find_crises(
    sweep: Sweep, diagram: Diagram, *, impacts: int = 40_000
) -> list[Crisis | NoCrisis]:
    """Find the crises at which complex motion ends along a sweep, or its bands become fewer.

    Parameters
    ----------
    sweep : Sweep
    diagram : Diagram
        Branches of the same system: their orbits that are physical and unstable in one direction
        are those of which a crisis is looked for, and orbits of the word that takes over.
    impacts : int
        Simulated on each attractor.

    Returns
    -------
    list of Crisis or NoCrisis
        One for each pair of neighbouring values between which complex motion gives way to another
        one: the crisis between them that is met first; or else the event from which on the motion
        that takes over is stable, or why neither was found. Then one for each pair between which
        complex motion gets fewer and wider bands. After an interruption by the keyboard, what was
        found until then, and last that it was interrupted.
    """
    found: list[Crisis | NoCrisis] = []
    try:
        collect_crises(sweep, diagram, found, impacts)
    except KeyboardInterrupt:
        if len(found) == 1:
            raise
    return found


def collect_crises(
    sweep: Sweep, diagram: Diagram, found: list[Crisis | NoCrisis], impacts: int = 40_000
) -> None:
    """Add crises to a list, as `find_crises`; an interruption adds that it was one, and passes."""
    search = CrisisSearch(sweep, diagram, Kernels(sweep.model, sweep.parameter), impacts)
    try:
        found.extend(search.found_at(chain(search.ends(), search.widenings())))
    except KeyboardInterrupt:
        text = f"the search was interrupted; changes of motion looked at: {len(found)}"
        found.append(NoCrisis(text))
        raise


Unstable = list[tuple[Orbit, str | None]]
"""Orbits, and the branches on which they lie."""

Change = tuple[str, Callable[[], Crisis | NoCrisis]]
"""A change of motion along a sweep, in words, and what finds the crisis there."""


@dataclass(frozen=True)
class CrisisSearch:
    """What crises are looked for with: a sweep, branches, kernels with the sweep's parameter free,
    and how many impacts are simulated on each attractor."""

    sweep: Sweep
    diagram: Diagram
    kernels: Kernels
    impacts: int = 40_000

    @staticmethod
    def found_at(changes: Iterable[Change]) -> Iterator[Crisis | NoCrisis]:
        """Yield what is found at changes of motion; where a search fails, that it does."""
        for what, find in changes:
            try:
                yield find()
            except FAILING as error:
                yield NoCrisis(f"{what}; the search failed ({type(error).__name__}: {error})")

    def ends(self) -> Iterator[Change]:
        """Yield where complex motion ends."""
        for before, after in neighbours(self.sweep):
            if before.attractor.kind is Kind.COMPLEX and after.attractor.kind is not Kind.COMPLEX:
                end = (
                    f"{before.attractor.notation} ends between {self.sweep.parameter} = "
                    f"{before.value:.9g} and {after.value:.9g} ({before.direction})"
                )
                yield end, partial(self.end_between, before, after, end)

    def end_between(self, before: Row, after: Row, end: str) -> Crisis | NoCrisis:
        """What ends complex motion between two rows; `end` says so in words."""
        search = partial(approach_crisis, impacts=self.impacts, smooth=False)
        crisis, tried = _first(self.unstable_at(before.value), before, after, search)
        entry, beyond = (None, "") if crisis else _takeover(self.sweep, before, after)
        if crisis is None and entry is None and after.attractor.kind is Kind.PERIODIC:
            width = FINER * abs(after.value - before.value)
            simulators = Simulators(self.sweep.model, self.sweep.parameter, self.kernels)
            earlier, left, lost, _ = locate(simulators, before, after, width, PATIENT)
            search = partial(locate_either, impacts=self.impacts)
            for row in (left, earlier):
                if crisis is None:
                    orbits = self.unstable_at(row.value, after.attractor)
                    crisis, tried = _first(orbits, row, after, search)
            if crisis is None and (edge := self.followed_last(left, lost or after, after)):
                around = replace(self, diagram=Diagram(edge.id, [edge]))
                orbits = [(orbit, None) for orbit, _ in around.unstable_at(before.value)]
                crisis, why = _first(orbits, before, after, search)
                tried = "; ".join(filter(None, (tried, why)))
        if crisis:
            return crisis
        if entry is None:
            beyond += f"; no crisis was found of the unstable orbits there: {tried or 'none'}"
        return NoCrisis(end + beyond, entry)

    def followed_last(self, left: Row, lost: Row, after: Row) -> Branch | None:
        """The branch of the orbit to which motion beyond an end comes back last before it comes to
        the periodic motion of the next row; None if it does not come there, or has not."""
        lap, state = len(after.attractor.walls), left.attractor.state
        for part in FURTHER if state is not None else ():
            value = lost.value + part * (after.value - lost.value)
            model = self.sweep.model.replace(**{self.sweep.parameter: value})
            run = Simulator(model, self.kernels).run(state, impacts=self.impacts)
            if run.free or run.others.size:
                return None  # crises are located of one forced coordinate
            apart = np.flatnonzero(run.walls[lap:] != run.walls[:-lap])
            if len(apart) and apart[-1] + FULL * lap < len(run):
                last = slice(max(0, int(apart[-1]) - LAST), int(apart[-1]) + 1)
                rows = np.column_stack([run.times, run.velocities])[last]
                met = _nearest_return(rows, run.walls[last], run.period, run.walls[-lap:])
                about = model, self.sweep.parameter, run.period, self.kernels
                orbit = _orbit_near(*about, *met) if met else None
                ends = [row.value for row in self.sweep.rows]
                return _followed(orbit, (min(ends), max(ends)), ("FB",)) if orbit else None
        return None

    def widenings(self) -> Iterator[Change]:
        """Yield where the bands of complex motion become fewer and wider."""
        for way in self.sweep.directions:
            for pair in pairwise(self.sweep.of(way)):
                given = [(*_bands(row.attractor), row) for row in pair]
                (laps, width, before), (fewer, wider, after) = sorted(given, key=lambda g: -g[0])
                if not (fewer and laps > fewer and laps != 2 * fewer and wider > WIDER * width):
                    continue
                place = f"{self.sweep.parameter} = {before.value:.9g} and {after.value:.9g}"
                widens = f"{before.attractor.notation} widens between {place}, from bands met "
                widens += f"after {laps} impacts to such met after {fewer}"
                yield widens, partial(self.widening, before, after, laps, widens)

    def widening(self, before: Row, after: Row, laps: int, widens: str) -> Crisis | NoCrisis:
        """The crisis at which bands widen between two rows, of orbits on branches and of the
        window."""
        orbits = self.unstable_at(before.value)
        if (window := _window(self.sweep, before, after, laps, self.kernels)) is not None:
            around = replace(self, diagram=Diagram(window.id, [window]))
            known = [orbit for orbit, _ in orbits]
            for orbit, _ in around.unstable_at(before.value):
                if not any(are_same_orbit(orbit, other) for other in known):
                    orbits.append((orbit, None))
        crisis, tried = _first(orbits, before, after, partial(locate_either, impacts=self.impacts))
        none = f"no crisis was found of the unstable orbits there: {tried or 'none'}"
        return crisis or NoCrisis(f"{widens}; {none}")

    def unstable_at(self, value: float, beyond: Attractor | None = None) -> Unstable:
        """Return the orbits at a value of which a crisis may be: those on branches, and others of
        the word of what is seen beyond."""
        sweep = self.sweep
        found: Unstable = [
            (orbit, branch.id)
            for branch in self.diagram.branches
            if branch.word
            for orbit in orbits_on(branch, sweep, value, self.kernels)
            if is_saddle(orbit)
        ]
        if beyond is not None and beyond.word is not None:
            word = Word(beyond.word, beyond.period or 1)
            model = sweep.model.replace(**{sweep.parameter: value})
            for orbit in find_orbits(model, word, parameter=sweep.parameter, kernels=self.kernels):
                if is_saddle(orbit) and not any(are_same_orbit(orbit, other) for other, _ in found):
                    found.append((orbit, None))
        return found


def _bands(attractor: Attractor) -> tuple[int, float]:
    """After how many impacts complex motion is in the same band again, and the width of its widest
    band in velocity; zeros for other motion, or if it is not known for long enough."""
    walls, velocities = attractor.walls, attractor.velocities
    if attractor.kind is not Kind.COMPLEX or len(walls) < FULL * BANDS:
        return 0, 0.0
    widths = [
        max(float(np.ptp(velocities[k::lap])) for k in range(lap))
        if np.array_equal(walls[lap:], walls[:-lap])
        else np.inf
        for lap in range(1, BANDS + 1)
    ]
    narrow = [width < 2.0 * min(widths) for width in widths]
    if True not in narrow:
        return 1, float(np.ptp(velocities))
    lap = narrow.index(True) + 1
    return lap, widths[lap - 1]


def _window(sweep: Sweep, row: Row, wide: Row, laps: int, kernels: Kernels) -> Branch | None:
    """Return the branch of the orbit in the bands of complex motion, on which is that born beside
    it at the fold of its window; None if no orbit is found."""
    motion = row.attractor
    rows = np.column_stack([motion.times, motion.velocities])
    away, turns = _returns(rows, laps, motion.forcing_period)
    begin = int(np.argmin(away))
    part = slice(begin, begin + laps)
    model = sweep.model.replace(**{sweep.parameter: row.value})
    about = model, sweep.parameter, motion.forcing_period, kernels
    orbit = _orbit_near(*about, rows[part], motion.walls[part], int(turns[begin]))
    if orbit is None:
        return None
    values = [other.value for other in sweep.rows]
    fold = row.value + WINDOW * (row.value - wide.value)
    with suppress(InputError):
        values.append(model.require(sweep.parameter, "range").check(fold, "range"))
    span = min(values), max(values)
    return _followed(orbit, span, ("FB",))


def _returns(rows: Array, laps: int, period: float) -> tuple[Array, Array]:
    """How far times and velocities are from those so many impacts later, and periods between."""
    apart = np.abs(rows[laps:] - rows[:-laps])
    turns = np.round(apart[:, 0] / period)
    away = np.abs(apart[:, 0] / period - turns) + apart[:, 1] / np.max(np.abs(rows[:, 1]))
    return away, turns.astype(int)


def _nearest_return(
    rows: Array, walls: Array, period: float, known: Array
) -> tuple[Array, Array, int] | None:
    """Times and velocities, walls and periods of the nearest return after a few impacts, but for
    those of a shorter word or a known one."""
    found: list[tuple[float, int, int, int]] = []
    for laps in FOLLOWED:
        for begin, (away, turns) in enumerate(zip(*_returns(rows, laps, period), strict=True)):
            word = walls[begin : begin + laps]
            turned = [np.roll(word, k).tolist() for k in range(laps)]
            new = word.tolist() not in turned[1:] and known.tolist() not in turned
            if walls[begin] == walls[begin + laps] and turns and new:
                found.append((float(away), begin, laps, int(turns)))
    if not found:
        return None
    _, begin, laps, turns = min(found)
    part = slice(begin, begin + laps)
    return rows[part], walls[part], turns


def _orbit_near(
    model: Model,
    parameter: str,
    period: float,
    kernels: Kernels,
    rows: Array,
    walls: Array,
    turns: int,
) -> Orbit | None:
    """The orbit near some impacts, if one is found."""
    times = rows[:, :1] - period * np.floor(rows[0, 0] / period)
    word = Word("".join(model.letters[wall] for wall in walls), turns)
    problem = problem_of(model, word, kernels)
    unknowns = np.append(np.hstack([times, rows[:, 1:]]).ravel(), model.values[parameter])
    found = solve_near(problem, unknowns)
    return None if found is None else Orbit(problem, found)


def _followed(orbit: Orbit, span: tuple[float, float], events: Sequence[str]) -> Branch:
    """The branch of an orbit, whole: what an interruption leaves of one decides nothing."""
    branch = continue_orbit(orbit, range=span, events=events, unphysical=False)
    reraise_interruption(branch.ends)
    return branch


def _first(
    orbits: Unstable, before: Row, after: Row, search: Callable[[Orbit, Any], Crisis | NoCrisis]
) -> tuple[Crisis | None, str]:
    """The crisis of orbits that is met first between two rows, or None and why none of each was
    found."""
    low, high = sorted((before.value, after.value))
    met, reasons = list[Crisis](), list[str]()
    for orbit, branch in orbits:
        found = search(orbit, before.attractor)
        if isinstance(found, Crisis) and low <= found.value <= high:
            met.append(replace(found, branch=branch))
        else:
            why = (
                f"its crisis is at {found.value:.9g}" if isinstance(found, Crisis) else found.reason
            )
            reasons.append(f"{orbit.notation} ({why})")
    return min(met, key=lambda c: abs(c.value - before.value), default=None), "; ".join(reasons)


def _takeover(sweep: Sweep, before: Row, after: Row) -> tuple[Entry | None, str]:
    """Return where the periodic motion after an end begins to be stable, and a text of it.

    The motion is followed back to the value before. A fold there, or a grazing, leaves complex
    motion of its own behind it (intermittency), and a period doubling is the last of a cascade.
    """
    motion, parameter = after.attractor, sweep.parameter
    if motion.kind is Kind.NOT_SETTLED:
        return None, ", where motion has not settled: simulate it longer"
    text = f", where {motion.notation} takes over"
    if motion.kind is not Kind.PERIODIC or not motion.word:
        return None, text
    try:
        orbit: Orbit | None = motion.orbit(sweep.model, parameter)
        while orbit is not None:
            low, high = sorted((before.value, orbit.value))
            branch = _followed(orbit, (low, high), ENDS)
            start = int(np.argmin(np.abs(branch[parameter] - orbit.value)))
            begun = branch["arclength"][start]
            apart = [(abs(e.arclength - begun), e) for e in branch.events if not e.ghost]
            ends = [(away, e) for away, e in apart if away > AWAY]
            if ends:
                entry = min(ends, key=lambda end: end[0])[1]
                place = f"{parameter} = {entry.value:.9g} (+- {entry.error:.1g})"
                return entry, f"{text}, stable from {entry.label} at {place}"
            last = int(np.argmin(np.abs(branch[parameter] - before.value)))
            if branch[parameter][last] == before.value and branch.stable[last]:
                return None, f"{text}, and is stable on both sides"
            orbit = _halved(branch)
            text += f", doubled from {orbit.notation}" if orbit else ""
    except InputError as error:  # the motion does not close as an orbit to the digits of one
        text += f" ({error})"
    return None, text


def _halved(branch: Branch) -> Orbit | None:
    """The orbit of half the period in which a branch ends; None if it does not."""
    rows = [
        row for row, end in zip((0, -1), branch.ends, strict=True) if end.kind is EndKind.SHORTER
    ]
    half, odd = divmod(branch.period, 2)
    if not rows or odd:
        return None
    orbit = branch.orbit(rows[0] % len(branch))
    count = len(branch.word) // 2 * orbit.problem.m
    unknowns = np.append(orbit.unknowns[:count], orbit.unknowns[-1])
    return orbit_with(
        orbit.model, (branch.word[: len(branch.word) // 2], half), branch.parameter, unknowns
    )


def crises_text(found: Sequence[Crisis | NoCrisis], parameter: str) -> str:
    """Return ``crises.json``."""
    crises = [crisis.as_record() for crisis in found if isinstance(crisis, Crisis)]
    others = [none for none in found if isinstance(none, NoCrisis)]
    takeovers: list[Json] = [
        {**{k: getattr(n.entry, k) for k in TAKEOVER}, "text": n.reason} for n in others if n.entry
    ]
    without = [none.reason for none in others if none.entry is None]
    head: dict[str, Json] = {"schema": CRISES, "parameter": parameter}
    return json_text({**head, "crises": crises, "takeovers": takeovers, "unexplained": without})


# Crises as entries of a diagram.


def locate_in_scene(
    scene: Scene, diagram: Diagram, located: list[Crisis | NoCrisis], progress: Asked = False
) -> None:
    """Add the crises of a scene's diagram to a list, from sweeps as [simulate] has them, or else
    both ways along the whole range; those before an interruption are there."""
    options = scene.simulate or SimulateOptions(scene.range, direction="both")
    given, rows = (scene.model, scene.parameter), list[Row]()
    about: dict[str, Any] = {"settling": options.settling, "rng": options.seed}
    about |= {"kernels": Kernels(*given), "progress": progress}
    for _, values in options.sweeps():
        found = sweep(*given, values, **about)
        if found.interrupted:
            raise KeyboardInterrupt
        rows += found.rows
    collect_crises(Sweep(*given, rows), diagram, located)


def add_crises(diagram: Diagram, found: Sequence[Crisis | NoCrisis]) -> Diagram:
    """Return a diagram with crises as entries on the branches of their orbits, each once, and with
    what was not found in its notes."""
    branches = {branch.id: branch for branch in diagram.branches}
    known = list[Crisis]()
    for one in found:
        if not isinstance(one, Crisis) or one.branch is None:
            continue
        same = (c for c in known if abs(c.value - one.value) <= c.error + one.error)
        if not any(c.branch == one.branch for c in same):
            number = len(diagram.entries) + len(known) + 1
            branches[one.branch] = _with_entry(branches[one.branch], one, f"e{number}")
            known.append(one)
    without = [
        f"{one}, of an orbit on no branch" if isinstance(one, Crisis) else str(one)
        for one in found
        if (one.branch if isinstance(one, Crisis) else one.entry) is None
    ]
    return replace(with_statistics(diagram, without), branches=list(branches.values()))


def _with_entry(branch: Branch, crisis: Crisis, name: str) -> Branch:
    """The branch with a crisis of one of its orbits: an entry, and a row."""
    orbit, path = crisis.orbit, crisis.path
    columns = [*columns_of(branch.word, orbit.problem.m), branch.parameter]
    rows = np.column_stack([branch[column] for column in columns])
    steps, offsets = np.diff(rows, axis=0), orbit.unknowns - rows[:-1]
    parts = np.sum(offsets * steps, axis=1) / np.maximum(np.sum(steps**2, axis=1), EPSILON**2)
    parts = np.clip(parts, 0.0, 1.0)
    row = int(np.argmin(np.sum((offsets - parts[:, None] * steps) ** 2, axis=1)))
    first, second = branch["arclength"][row : row + 2].tolist()
    place = first + float(parts[row]) * (second - first)
    point = Point(orbit.linearisation, np.zeros(len(orbit.unknowns)), 0.0, place, 0)
    residual = float(np.max(np.abs(path.residual)))
    made = entry_of(
        Event(CR, point, residual, crisis.error, "newton"), name, branch.id, *[point] * 2
    )
    beside = [pairs_of(m) for m in branch.multipliers[row : row + 2]]
    entry = replace(
        made,
        label=crisis.label,
        ghost=False,
        why=None,
        multipliers_before=beside[0],
        multipliers_after=beside[1],
        crisis=crisis.connection(),
    )
    new = tabulate(Points([point]), [(point, entry)])
    table = {n: np.insert(values, row + 1, new[n]) for n, values in branch.columns.items()}
    events = sorted([*branch.events, entry], key=lambda e: e.arclength)
    return replace(branch, columns=table, events=events)


@dataclass(frozen=True, eq=False)
class CrisisCurve:
    """A curve of crises in two parameters."""

    names: tuple[str, str]
    """The crisis's own parameter, and the second one."""
    values: Array
    """Both at each point, in the order of the curve, shape (N, 2)."""
    errors: Array
    """Bounds of the errors of the first at the second, shape (N,)."""
    physical: Array
    """Whether simulated flights repeat the connection at each point, shape (N,)."""
    ends: tuple[End, End]
    """Why the curve ends."""
    label: str
    paths: Sequence[Connected] = field(repr=False)
    """The connections, with both parameters as unknowns."""

    def at(self, second: float) -> list[float]:
        """Return the values of the first parameter where the second has a value, solved for."""
        found = []
        offset = self.values[:, 1] - second
        found += self.values[offset == 0.0, 0].tolist()
        for k in np.nonzero(offset[:-1] * offset[1:] < 0.0)[0].tolist():
            part = offset[k] / (offset[k] - offset[k + 1])
            one, other = self.paths[k].unknowns, self.paths[k + 1].unknowns
            guess = (one + part * (other - one))[:-1]
            path = solve(_with_one_parameter(self.paths[k].problem, second), guess)
            if path is not None:
                found.append(float(path.unknowns[-1]))
        return found

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        first, second = self.names
        values = self.values[:, 1]
        head = (
            f"Curve of {self.label} in ({first}, {second}), {count_text(len(self), 'point')}, "
            f"{second} from {values.min():.9g} to {values.max():.9g}"
        )
        ends = [f"  end: {end.message}" for end in self.ends]
        left = int(np.sum(~self.physical))
        known = "  whether an attractor reaches it is known where it was located alone"
        unphysical = [f"  not physical: {count_text(left, 'point')}"] if left else []
        return "\n".join([head, *ends, *unphysical, known])


@explain_arguments
def follow_crisis(
    crisis: Crisis, second: str, limits: tuple[float, float], settings: Settings = CURVE_SETTINGS
) -> CrisisCurve:
    """Follow a crisis in two parameters.

    Parameters
    ----------
    crisis : Crisis
    second : str
        The second parameter; the first is the crisis's own.
    limits : (low, high)
        Range of the second parameter; it holds the crisis.
    settings : Settings
        Numerics of the walk.

    Returns
    -------
    CrisisCurve
        Whether the attractor that touches is still there is not looked at along the curve; locate
        the crisis again where that matters.

    Raises
    ------
    InputError
        For a parameter the model does not have, or limits that do not hold the crisis.
    """
    model = crisis.model
    model.require(second, "second")
    begin = np.append(crisis.path.unknowns, model.values[second])
    connection = _connection(crisis.path.problem, model, crisis.parameter, second)
    problem, start = connection.longer(begin, 1, 1)
    ways = [
        walk(problem, start, way, parameter=second, limits=limits, settings=settings)
        for way in (-1, 1)
    ]
    paths: list[Connected] = [
        point.evaluation for point in [*reversed(ways[0].points), *ways[1].points[1:]]
    ]
    values = np.array([p.unknowns[-2:] for p in paths])
    left = max(_left_by_laps(p) for p in (paths[0], paths[-1]))
    errors = [error_of(_alone(p)) + left for p in paths]
    physical = np.array([is_physical(p) for p in paths])
    ends = ways[0].end, ways[1].end
    names = crisis.parameter, second
    return CrisisCurve(names, values, np.array(errors), physical, ends, crisis.label, paths)


def _with_one_parameter(problem: Connection, second: float) -> Connection:
    """The equations at a value of the second parameter."""
    first, other = problem.kernels.parameters
    return _connection(problem, problem.model.replace(**{other: second}), first)


def _alone(path: Connected) -> Connected:
    """A point of a curve as a crisis at its second parameter."""
    problem = _with_one_parameter(path.problem, float(path.unknowns[-1]))
    return problem.evaluate(path.unknowns[:-1])


def _left_by_laps(path: Connected) -> float:
    """How much one more lap at both ends changes a crisis; infinite if that is not known."""
    here = _alone(path)
    found = solve(*here.problem.longer(here.unknowns, 1, 1))
    return np.inf if found is None else abs(float(found.unknowns[-1] - here.unknowns[-1]))


# How far complex motion is from the crisis that ends it, in tolerances of chosen parameters.


@dataclass(frozen=True, eq=False)
class CrisisMargin:
    """The point of a crisis's surface in parameters that is nearest to a model's."""

    label: str
    distance: float
    """Its distance, in tolerances."""
    direction: Mapping[str, float]
    """From the model to it, in tolerances of each parameter, of length one."""
    parameters: Mapping[str, float]
    """Those that have tolerances, at the crisis."""
    physical: bool
    """Whether simulated flights repeat the connection there."""
    tolerances: Mapping[str, float]
    path: Connected = field(repr=False)

    def sensitivity(self, parameter: str) -> float:
        """Return the exact derivative of the distance by any parameter of the model.

        Raises
        ------
        InputError
            For a parameter the model does not have.
        """
        model, names = self.path.problem.model, tuple(self.tolerances)
        model.require(parameter, "parameter")
        if parameter in self.tolerances:
            return -self.direction[parameter] / self.tolerances[parameter]
        problem = _connection(self.path.problem, model, *names, parameter)
        here = problem.evaluate(np.append(self.path.unknowns, model.values[parameter]))
        psi = np.linalg.svd(here.jacobian[:, : problem.n])[0][:, -1]
        *slopes, by = (psi @ here.jacobian[:, problem.n :]).tolist()
        sizes = zip(slopes, self.tolerances.items(), strict=True)
        return -float(by / sum(slope * size * self.direction[n] for slope, (n, size) in sizes))

    def __repr__(self) -> str:
        place = ", ".join(f"{name} = {value:.9g}" for name, value in self.parameters.items())
        unphysical = "" if self.physical else ", not physical"
        return f"{self.label} at distance {self.distance:.6g}: {place}{unphysical}"


@explain_arguments
def find_crisis_margin(
    crisis: Crisis, model: Model, tolerances: Mapping[str, float | str]
) -> CrisisMargin:
    """Find how far parameters may change until complex motion ends in a crisis.

    Parameters
    ----------
    crisis : Crisis
        Of that motion, located anywhere; see `locate_crisis`.
    model : Model
        At whose parameters the motion is looked at.
    tolerances : mapping
        Of each parameter that may change, the change that is one unit of distance: a number, or a
        part of the value such as ``"5%"``.

    Returns
    -------
    CrisisMargin
        The nearest point of the surface on which the same connection grazes or touches, from exact
        derivatives, as `find_margins` does for events of orbits. Another connection may end the
        motion before: locate the crisis again there where that matters.

    Raises
    ------
    InputError
        For another system, a parameter it does not have, a tolerance that is not positive, or where
        the search does not settle.
    """
    if type(model) is not type(crisis.model) or model.options != crisis.model.options:
        raise InputError("model", model.SYSTEM, f"give the crisis's system, {crisis.model.SYSTEM}")
    units = tolerance_sizes(tolerances, model)
    center, values = np.array([model.values[name] for name in units]), np.array([*units.values()])
    near, begin = crisis.path, [crisis.model.values[name] for name in units]
    known = np.append(near.unknowns[: near.problem.n], begin)
    problem, start = _connection(near.problem, model, *units).longer(known, 1, 1)
    from .margins import nearest_point

    scale = problem.scale(start, np.inf)
    try:
        found = nearest_point(
            problem,
            lambda here, own: here,
            problem.evaluate(start),
            np.zeros(0),
            center,
            values,
            lambda at, here, own: problem.residual_sizes_at(at, scale),
        )
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        found = None
    if found is None:
        accepted = "locate the crisis nearer to the model"
        raise InputError("crisis", "its nearest point is not found from there", accepted)
    path = found[0]
    place = path.unknowns[problem.n :]
    y = (place - center) / values
    distance = float(np.linalg.norm(y))
    direction = y / distance if distance > 0.0 else y
    return CrisisMargin(
        crisis.label,
        distance,
        dict(zip(units, direction.tolist(), strict=True)),
        dict(zip(units, place.tolist(), strict=True)),
        is_physical(path),
        units,
        path,
    )


def _connection(like: Connection, model: Model, *names: str) -> Connection:
    """The equations of a connection of the same walls, with other free parameters."""
    given = like.walls, like.grazing, like.before, like.after
    return Connection(model, Kernels(model, *names), *given)
