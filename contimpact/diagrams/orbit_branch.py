"""Branches of periodic orbits, continued from an orbit or from the event at which they are born."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Unpack

import numpy as np

from ..arrays import Array
from ..bifurcations.branch_point import BranchPoint
from ..bifurcations.declarations import KINDS, SWITCHES, usual_events, wanted_kinds
from ..bifurcations.kind import Change, Start, kind_of, primitive_start, switch, test_functions
from ..bifurcations.requested import PERIOD
from ..continuation.branch import (
    AT_BRANCH_POINTS,
    End,
    EndKind,
    Evaluation,
    Event,
    MissedEvent,
    Point,
    Points,
    TestFunction,
    UserFunction,
    Walk,
    join_walks,
    missed_texts,
)
from ..continuation.corrector import correct
from ..continuation.events import separate_events, snap_to_points
from ..continuation.settings import Settings, require_width
from ..continuation.walk import (
    SAME_SOLUTION,
    Options,
    Policy,
    keep_interrupted,
    other_way,
    retry_interrupted,
)
from ..errors import InputError, each_once, explain_arguments, short_repr
from ..models.model import Model, Symmetry
from ..models.word import Word
from ..orbits.orbit import Orbit
from ..orbits.problem import OrbitProblem, Summary
from ..orbits.quiet import problem_in
from ..orbits.search import mirror_orbit, reduce_period, repeats, rotate_to_word, solve_near
from ..orbits.status import PHYSICAL, count_unstable, reason_of
from ..progress import Asked, chain_callbacks, counting_callback, progress_lines
from ..results.branch import Branch, Entry, columns_of
from ..results.diagram import Diagram
from ..results.entry_conversion import entry_by_name, entry_first, entry_of, event_of, to_orbit
from .orbit_walks import ON_CIRCLE, walk_orbits

# From the points of a branch and its entries to the columns of its table.


def tabulate(
    points: Points, entries: Sequence[tuple[Point, Entry]], borrowed: Sequence[float] = ()
) -> dict[str, Array]:
    """Return the columns of a branch: a row per point, and one for each event between points.

    `entries` are in order of arclength. The rows of events, or of the points they lie on, have the
    verdicts of the first entry there, which leave the event itself out. `borrowed` has the
    arclengths of points at which rounding would decide: their rows have the verdicts of the next
    one, the last of the one before.
    """
    places = points.arclengths
    between: list[Point] = []
    on_events = np.nonzero(np.isin(places, [point.arclength for point, _ in entries]))[0]
    rows = dict(zip(places[on_events].tolist(), on_events.tolist(), strict=True))
    marked: dict[int, Entry] = {}
    for point, entry in entries:
        if point.arclength not in rows:
            rows[point.arclength] = len(points) + len(between)
            between.append(point)
        marked.setdefault(rows[point.arclength], entry)
    columns = _columns(Points([*points.pieces, *between]))
    columns["event"] = np.full(len(columns["arclength"]), "", dtype=object)
    for row, entry in marked.items():
        columns["n_unstable"][row] = entry.n_unstable
        columns["physical"][row] = int(entry.physical)
        columns["reason"][row] = entry.reason or ""
        columns["event"][row] = entry.id
        if entry.impact in points[0].evaluation.problem.excursions and entry.flight is None:
            _set_multipliers(columns, row, entry)
    order = np.argsort(columns["arclength"], kind="stable")
    for name in columns:  # one after the other: a long branch is not held twice
        columns[name] = columns[name][order]
    rounding = np.isin(columns["arclength"], borrowed) & (columns["event"] == "")
    for place in np.nonzero(rounding)[0].tolist():
        beside = place + 1 if place + 1 < len(order) else place - 1
        for name in ("n_unstable", "physical", "reason"):
            columns[name][place] = columns[name][beside]
    return columns


def _set_multipliers(columns: dict[str, Array], row: int, entry: Entry) -> None:
    """Those of the orbit without the excursion that vanishes: with it they have no digits there."""
    for k, pair in enumerate(entry.multipliers, start=1):
        columns[f"multiplier{k}_re"][row], columns[f"multiplier{k}_im"][row] = pair or (np.inf, 0.0)


def _columns(points: Points) -> dict[str, Array]:
    """A row per point, in the points' order."""
    problem = points[0].evaluation.problem
    unknowns = points.unknowns
    columns = {"arclength": points.arclengths, **_parameters(problem, unknowns[:, -1])}
    for name, column in zip(columns_of(problem.word.walls, problem.m), unknowns.T, strict=False):
        columns[name] = column.copy()
    if problem.autonomous:
        columns |= _clock_columns(problem, columns, unknowns)
    summary = Summary.of(points.numbers)
    factors, findings = summary.multipliers, summary.findings
    for k, factor in enumerate(factors.T, start=1):
        columns |= {f"multiplier{k}_re": factor.real, f"multiplier{k}_im": factor.imag}
    columns["n_unstable"] = count_unstable(factors)
    physical = findings[:, 0] == PHYSICAL
    columns["physical"] = physical.astype(np.int64)
    word, named = problem.word.walls, problem.model.WALLS
    reasons = columns["reason"] = np.full(len(findings), "", dtype=object)
    for row in np.nonzero(~physical)[0]:
        reasons[row] = reason_of(findings[row].tolist(), word, named) or ""
    columns["smallest_gap"] = findings[:, -1].copy()
    columns["residual"] = summary.largest_residual.copy()
    columns["iterations"] = points.iterations
    return columns


def _clock_columns(
    problem: OrbitProblem, columns: Mapping[str, Array], unknowns: Array
) -> dict[str, Array]:
    """The columns of free periods, and of times since the first passage."""
    if not problem.word.walls:
        return {"v0_0": np.zeros(len(unknowns)), PERIOD: columns["v0_0"]}
    times = [f"t{k}" for k in range(1, len(problem.word) + 1)]
    moved = {name: columns[name] - columns["t1"] for name in times}
    return {**moved, PERIOD: -columns["t1"]}


def _parameters(problem: OrbitProblem, free: Array) -> dict[str, Array]:
    """The columns of the parameters and derived parameters, given the followed one's."""
    values = {name: np.full(len(free), value) for name, value in problem.model.values.items()}
    values[problem.parameter] = free.copy()
    derived = np.empty((len(problem.model.DERIVED), len(free)))
    for row in range(len(free)):
        derived[:, row] = problem.derived_at(problem.values(free[row : row + 1]))
    return values | dict(zip(problem.model.DERIVED, derived, strict=True))


# Symmetry: where a branch runs into its own image, and ends, for beyond all of it comes again.
#
# The images of an orbit are its shifts by whole forcing periods and, where the model has one, its
# mirror image. An orbit that is one of its own images is one of a shorter period, or a symmetric
# one. A branch of other orbits meets it at a branch point and goes on along its own image.

Known = Callable[[OrbitProblem, Array], "str | None"]

AT_IMAGE, OFF_IMAGE = 1e-6, 1e-9
"""How near its image an orbit at a branch point is, and how far from it an ordinary one is."""


def symmetry_of(problem: OrbitProblem) -> Symmetry | None:
    """Return the symmetry the model has along a branch in the followed parameter."""
    model, kernels = problem.model, problem.kernels
    return model.symmetry(problem.parameter, kernels.harmonics(*model.values.values()))


def symmetric(
    problem: OrbitProblem, unknowns: Array, symmetry: Symmetry | None, tolerance: float
) -> bool:
    """Whether an orbit is its own mirror image."""
    if symmetry is None or not problem.word.walls:
        return False
    image = rotate_to_word(*mirror_orbit(problem, unknowns, symmetry), problem.word)
    if image is None:
        return False
    return problem.apart(image, unknowns) < tolerance


def mirrors_back(
    problem: OrbitProblem, unknowns: Array, tangent: Array, symmetry: Symmetry | None
) -> bool:
    """Whether the mirror image of a branch leaves its start as the branch itself, backwards."""
    if symmetry is None or not problem.word.walls:
        return False
    along = 1e-4 * tangent / np.max(np.abs(tangent / problem.natural_units(unknowns)))
    image = rotate_to_word(*mirror_orbit(problem, unknowns + along, symmetry), problem.word)
    if image is None:
        return False
    return problem.apart(image, unknowns - along) < 1e-8


def mirror_end(name: str, point: Point) -> End:
    """Return the end of a branch at a start beyond which its mirror image follows."""
    parameter = point.evaluation.problem.parameter
    known = f"{name} again, as its own mirror image"
    return End.of(EndKind.KNOWN, parameter, point.parameter, known=known)


def symmetric_end(problem: OrbitProblem, known: Known | None = None) -> Policy | None:
    """Return what ends a walk at the branch point where its orbits become images of themselves.

    It is for a walk that looks for BP; None where no orbit of the problem can be an image
    of itself. `known` returns the name of the branch that an orbit of shorter period lies on.
    """
    if len(problem.word.rotations()) == 1 and symmetry_of(problem) is None:
        return None
    return _SymmetricEnd(problem, known)


def add_stop_test(tests: Sequence[TestFunction], stop: Policy | None) -> list[TestFunction]:
    """Return the test functions of a walk: those asked for, and that which `stop` goes by."""
    asked = stop is None or any(isinstance(test, BranchPoint) for test in tests)
    return [*tests, *([] if asked else [BranchPoint()])]


class _SymmetricEnd(Policy):
    """Ends no walk whose orbits are their own images from the first point on."""

    at_events_only = True

    def __init__(self, problem: OrbitProblem, known: Known | None) -> None:
        self.problem, self.known = problem, known
        self.symmetry = symmetry_of(problem)
        self.kinds: list[EndKind] | None = None

    def accepted(self, point: Point, events: Sequence[Event]) -> tuple[End, Point] | None:
        if self.kinds is None:
            own = self.images(point.unknowns, OFF_IMAGE)
            self.kinds = [k for k in (EndKind.SHORTER, EndKind.SYMMETRIC) if k not in own]
        for event in events:
            if event.kind == BranchPoint.kind:
                for kind in self.images(event.point.unknowns, AT_IMAGE):
                    if kind in self.kinds:
                        return self.end(kind, event.point), event.point
        return None

    def images(self, unknowns: Array, tolerance: float) -> list[EndKind]:
        """In which ways an orbit is an image of itself."""
        found = []
        if repeats(self.problem, unknowns, tolerance):
            found.append(EndKind.SHORTER)
        if symmetric(self.problem, unknowns, self.symmetry, tolerance):
            found.append(EndKind.SYMMETRIC)
        return found

    def end(self, kind: EndKind, point: Point) -> End:
        """The end at a branch point."""
        name, value = self.problem.parameter, point.parameter
        if kind is EndKind.SYMMETRIC:
            return End.of(kind, name, value)
        shorter, moved = reduce_period(self.problem, point.unknowns, AT_IMAGE)
        if self.known is not None and (branch := self.known(shorter, moved)):
            return End.of(EndKind.KNOWN, name, value, known=branch)
        letters, word = self.problem.model.letters, self.problem.word
        laps = len(word) // len(shorter.word) if word.walls else word.period // shorter.word.period
        return End.of(kind, name, value, word=shorter.word.notation(letters), times=laps)


WITHOUT_MULTIPLIERS = ("V", "T")
"""Events at which a multiplier is infinite, or jumps."""

BEYOND = 0.1
"""Part of its way by which an orbit between two points of a branch may lie before or beyond
them."""

ASIDE = 4.0
"""How far a branch may lie beside the straight way between two of its points, in lengths of it."""

UserEvent = tuple[str, Callable[[Orbit], float]]
Callback = Callable[[Point], bool | None]


@explain_arguments
def continue_orbit(
    orbit: Orbit | Entry | Event | Point | tuple[Branch | Diagram, int | str],
    parameter: str | None = None,
    range: tuple[float, float] | None = None,
    *,
    events: Sequence[str | UserEvent] | None = None,
    values: Mapping[str, Sequence[float]] | None = None,
    settings: Settings | Mapping[str, Any] | None = None,
    callback: Callback | None = None,
    name: str = "b1",
    model: Model | None = None,
    unphysical: bool | None = None,
    progress: Asked = False,
) -> Branch:
    """Follow a periodic orbit in one parameter, in both directions.

    Parameters
    ----------
    orbit : Orbit, Entry or (Branch, row)
        From `find_orbits`; an event of a branch or a catalogue; a branch and the number of a row
        or the name of an event on it; a diagram and the name of an event.
    parameter : str, optional
        The parameter to follow; by default the one the orbit was found with.
    range : (low, high)
        Its range, which holds the orbit's value.
    events : sequence, optional
        Kinds of events (FB, BP, PD, NS, G, V, T, UZ, or one's own), and pairs of a name and a
        function of the `Orbit` whose zeros are to be located; by default FB, BP, PD, G, V and T,
        and NS where tori can be born.
    values : mapping of str to sequence of float, optional
        Values of the parameter, or of a derived one, to hit exactly (as UZ).
    settings : Settings or mapping, optional
    callback : callable, optional
        Called with every accepted point; a true value stops the walk in that direction.
    name : str
        The branch's name.
    model : Model, optional
        The system of an entry or a branch, where its name does not tell; see `Entry.orbit`.
    unphysical : bool, optional
        Whether to go on where the orbits turn unphysical, or to end a step behind. By default it
        is so in systems of at most two guards, and from an orbit that is unphysical itself.
    progress : bool or callable
        Whether to tell on standard error how far the walk is, or a function to call with lines of
        text.

    Returns
    -------
    Branch
        After an interruption from the keyboard, what was followed until then; its ends say so.

    Raises
    ------
    InputError
        For what is no orbit, a parameter the model does not have, or a range it does not admit.
    """
    given = entry_by_name(orbit)
    orbit = to_orbit(given, model)
    problem = orbit.problem
    parameter = parameter or problem.parameter
    unknowns = orbit.unknowns
    if parameter != problem.parameter:
        problem, unknowns = problem_in(parameter, orbit.model, orbit.linearisation)
    limits = check_range(problem, range, float(unknowns[-1]))
    stop, tests = symmetric_end(problem), tests_of_events(problem, events, values)
    settings = _numerics(settings)
    if isinstance(given, Entry) and given.tangent is not None and problem is orbit.problem:
        unknowns = _orbit_beside(problem, unknowns, np.array(given.tangent), limits, settings)
    if unphysical is None:
        unphysical = problem.model.few_guards or not orbit.physical
    with progress_callback(
        progress, f"following {name}, {problem.word}", problem, callback
    ) as told:
        run = walk_both_ways(problem, unknowns, limits, tests, settings, told, stop, unphysical)
    return retry_interrupted(lambda: run.branch(name, kinds=[test.kind for test in tests]))


def _numerics(given: Settings | Mapping[str, Any] | None) -> Settings:
    return given if isinstance(given, Settings) else Settings(**(given or {}))


@contextlib.contextmanager
def progress_callback(
    progress: Asked, what: str, problem: OrbitProblem, callback: Callback | None
) -> Iterator[Callback | None]:
    """Yield the callback of a walk, which tells how far it is if that was asked for."""
    with progress_lines(progress, what) as tell:
        yield (
            chain_callbacks(callback, counting_callback("", problem.parameter, tell))
            if progress
            else callback
        )


def _orbit_beside(
    problem: OrbitProblem,
    unknowns: Array,
    tangent: Array,
    limits: tuple[float, float],
    settings: Settings,
) -> Array:
    """The orbit one step from a branch point along one of the two branches that cross there.

    On a limit of the range only one direction leads to it.
    """
    first = dataclasses.replace(settings, max_points=2)
    for direction in (+1, -1):
        probe = walk_orbits(
            problem,
            unknowns,
            direction,
            limits=limits,
            settings=first,
            tangent=tangent,
            branching=True,
        )
        if len(probe.points) > 1:
            return probe.points[-1].unknowns
    return unknowns


def tests_of_events(
    problem: OrbitProblem,
    events: Sequence[str | UserEvent] | None,
    values: Mapping[str, Sequence[float]] | None,
) -> list[TestFunction]:
    events = usual_events(problem.model) if events is None else events
    if isinstance(events, str) or not isinstance(events, Sequence):
        raise InputError("events", f"found {events!r}", "give a list, such as ['PD', 'G']")
    wanted = {}
    for name, asked in (values or {}).items():
        if np.ndim(asked) != 1:
            raise InputError(
                f"values.{name}", f"found {short_repr(asked)}", "give a list of numbers"
            )
        wanted[name] = each_once(asked, f"values.{name}")
    texts = each_once((kind for kind in events if isinstance(kind, str)), "events")
    kinds = wanted_kinds(texts, wanted, "events", "give values={name: [...]}")
    tests = test_functions(problem, kinds, wanted)
    return tests + [_user_test(kind) for kind in events if not isinstance(kind, str)]


def check_range(
    problem: OrbitProblem, limits: tuple[float, float] | None, start: float
) -> tuple[float, float]:
    """Return the range as floats, or raise `InputError` if it does not fit."""
    declared = problem.model.require(problem.parameter, "parameter")
    if not isinstance(limits, Sequence | np.ndarray) or len(limits) != 2:
        found = "missing" if limits is None else f"found {short_repr(limits)}"
        raise InputError("range", found, f"give (low, high), values of {problem.parameter}")
    low, high = (declared.check(limit, "range") for limit in limits)
    if not low < high or not low <= start <= high:
        at = f"{problem.parameter} = {start:.12g}"
        found = f"({low:.12g}, {high:.12g}) does not hold the start {at}"
        raise InputError("range", found, "give low < high around the start")
    require_width(low, high, "range")
    problem.model.validate_between(problem.parameter, low, high, "range")
    return low, high


def _user_test(given: UserEvent) -> TestFunction:
    named = isinstance(given, tuple) and len(given) == 2 and isinstance(given[0], str)
    if not named or not callable(given[1]) or given[0] in KINDS:
        accepted = f"give a pair of a name (none of {', '.join(KINDS)}) and a function"
        raise InputError("events", f"found {given!r}", accepted)
    kind, function = given

    def value(point: Point) -> float:
        found = np.asarray(function(Orbit(point.evaluation.problem, point.evaluation)), dtype=float)
        if found.size != 1:
            raise InputError(
                f"event {kind}", f"its function returned {found!r}", "return one number"
            )
        return float(found.reshape(()))

    return UserFunction(kind, value)


ONE_ZERO = 1e-2
"""Arclength within which one zero is located and missed, if its error in the parameter says so."""


@dataclass(frozen=True, eq=False)
class Run:
    """A branch just walked: its points and events in order, not yet tabulated.

    `borrowed` are the arclengths of points that are no event of the branch and have no status of
    their own: where it is born, and where it ends at a branch point.
    """

    problem: OrbitProblem
    walks: tuple[Walk, Walk]
    points: Points
    events: Sequence[Event]
    borrowed: Sequence[float] = ()

    @classmethod
    def of(cls, problem: OrbitProblem, backward: Walk, forward: Walk, born: bool = False) -> Run:
        """Join two walks that left one point; `born` says whether that is an event's."""
        points, events = join_walks(backward, forward)
        events = snap_to_points(points, events)
        places = {event.point.arclength for event in events}
        ends = {0: backward.end, len(points) - 1: forward.end}
        rows = {row for row, end in ends.items() if end.kind in AT_BRANCH_POINTS}
        rows |= {len(backward.points) - 1} if born else set()
        if forward.end.kind is EndKind.CLOSED:  # both ends are one orbit
            at_event = born or any(points[row].arclength in places for row in ends)
            rows |= set(ends) if at_event else set()
        others = [point for row in sorted(rows) if (point := points[row]).arclength not in places]
        points = separate_events(problem, points, events, others)
        return cls(problem, (backward, forward), points, events, [p.arclength for p in others])

    @property
    def ends(self) -> tuple[End, ...]:
        """How the walks have ended."""
        return tuple(walk.end for walk in self.walks)

    def branch(
        self,
        name: str,
        origin: str | None = None,
        first_entry: int = 1,
        kinds: Sequence[str] | None = None,
    ) -> Branch:
        """Tabulate it, with the events of the given kinds."""
        backward, forward = self.walks
        problem = self.problem
        events = [e for e in self.events if kinds is None or e.kind in kinds]
        entries = [
            entry_of(e, f"e{first_entry + i}", name, *self.around(e)) for i, e in enumerate(events)
        ]
        marks = [(event.point, entry) for event, entry in zip(events, entries, strict=True)]
        start = backward.points[-1].arclength
        ways = ((-1.0, backward), (1.0, forward))
        lost = [
            missed
            for sign, walk in ways
            for missed in walk.missed
            if not self._is_explained(missed, start + sign * missed.arclength)
        ]
        return Branch(
            id=name,
            word=problem.word.walls,
            period=problem.word.period,
            notation=problem.word.notation(problem.model.letters),
            system=problem.model.SYSTEM,
            options=problem.model.options,
            parameter=problem.parameter,
            columns=tabulate(self.points, marks, self.borrowed),
            ends=(backward.end, forward.end),
            events=entries,
            missed=missed_texts(problem.parameter, lost),
            origin=origin,
            notes=list(dict.fromkeys([*backward.notes, *forward.notes])),
        )

    def _is_explained(self, missed: MissedEvent, place: float) -> bool:
        """Whether an event explains that one is missed at an arclength: that of the same zero,
        within its error, or at the start of the walks, where one of them has located the event and
        the count of unstable multipliers changes beside it."""
        kinds = [missed.kind]
        if missed.index is None and kind_of(missed.kind).changes is Change.STABILITY:
            kinds += WITHOUT_MULTIPLIERS

        def explains(event: Event) -> bool:
            away = abs(event.point.arclength - place)
            if missed.arclength < ON_CIRCLE and away < ON_CIRCLE:
                return True
            off = min(abs(event.parameter - end) for end in missed.parameters)
            near = ON_CIRCLE if missed.index is None else ONE_ZERO
            return away < near and off <= event.error

        return any(
            event.kind in kinds
            and missed.index in (None, event.details.get("index"))
            and explains(event)
            for event in self.events
        )

    def around(self, event: Event) -> tuple[Point, Point]:
        """The points before and after an event; a closed branch goes on at its other end."""
        lengths, last = self.points.arclengths, len(self.points) - 1
        after = int(np.searchsorted(lengths, event.point.arclength, side="right"))
        before = int(np.searchsorted(lengths, event.point.arclength)) - 1
        if self.walks[1].end.kind is EndKind.CLOSED and last > 1:
            return self.points[before % last], self.points[after if after <= last else 1]
        return self.points[max(before, 0)], self.points[min(after, last)]

    @functools.cached_property
    def rows(self) -> Array:
        """The unknowns of points and events in order: between folds too the parameter runs on."""
        events = [event.point for event in self.events]
        places = [*self.points.arclengths, *(point.arclength for point in events)]
        rows = np.vstack([self.points.unknowns, *(point.unknowns for point in events)])
        return rows[np.argsort(places, kind="stable")]

    def passes(self, word: Word, value: float) -> bool:
        """Whether orbits on this branch have a word, rotated perhaps, at a parameter value."""
        own, values = self.problem.word, self.points.unknowns[:, -1]
        same = (len(own), own.period) == (len(word), word.period) and own.walls in 2 * word.walls
        return same and bool(values.min() <= value <= values.max())

    def holds(self, unknowns: Array) -> bool:
        """Whether an orbit of the same word lies on this branch."""
        value, rows = unknowns[-1], self.rows
        behind, ahead = rows[:-1, -1], rows[1:, -1]
        passed = ((behind - value) * (ahead - value) <= 0.0) & (behind != ahead)
        units = self.problem.natural_units(unknowns)
        for i in np.nonzero(passed)[0]:
            left, right = rows[i], rows[i + 1]
            guess = left + (value - left[-1]) / (right[-1] - left[-1]) * (right - left)
            guess[-1] = value
            near = ASIDE * np.max(np.abs((right - left) / units)) + SAME_SOLUTION
            if np.max(np.abs(self.problem.difference(guess, unknowns) / units)) > near:
                continue
            if self._same(solve_near(self.problem, guess), unknowns):
                return True
        return any(self._passes_at_turn(*turn, unknowns) for turn in self._turning)

    def has(self, problem: OrbitProblem, unknowns: Array) -> bool:
        """Whether an orbit lies on this branch, its word rotated perhaps."""
        turned = rotate_to_word(problem, unknowns, self.problem.word)
        return turned is not None and self.holds(turned)

    @functools.cached_property
    def _turning(self) -> list[tuple[int, Array]]:
        """The ways from a row to the next one beside which the parameter turns back, and sizes.

        Between them it goes beyond both, and at one value there are two orbits next to each other.
        """
        step = np.diff(self.rows[:, -1])
        turns = 1 + np.nonzero(step[:-1] * step[1:] <= 0.0)[0]
        near = {int(i) for turn in turns for i in range(turn - 2, turn + 2)}
        span = float(np.ptp(self.rows[:, -1])) or 1.0
        return [
            (i, self.problem.scale(self.rows[i], span)) for i in sorted(near) if 0 <= i < len(step)
        ]

    def _passes_at_turn(self, row: int, scale: Array, unknowns: Array) -> bool:
        """Whether the branch from a row to the next one passes an orbit: where it meets the plane
        through the orbit across its way, it is that orbit."""
        problem, left, right = self.problem, self.rows[row], self.rows[row + 1]
        way, away = (right - left) / scale, problem.difference(unknowns, left) / scale
        length = float(way @ way)
        if not length:  # where two walks begin, the point stands twice
            return False
        part = float(way @ away) / length
        if not -BEYOND <= part <= 1.0 + BEYOND:
            return False
        guess = left + part * (right - left)
        found = correct(problem, guess, way / scale, scale, Settings())
        return self._same(found.evaluation, unknowns)

    def _same(self, here: Evaluation | None, unknowns: Array) -> bool:
        """Whether a solution, if there is one, is an orbit."""
        return here is not None and self.problem.apart(here.unknowns, unknowns) < SAME_SOLUTION


def walk_both_ways(
    problem: OrbitProblem,
    unknowns: Array,
    limits: tuple[float, float],
    tests: Sequence[TestFunction],
    settings: Settings,
    callback: Callback | None = None,
    stop: Policy | None = None,
    unphysical: bool = True,
    progress: Callable[[int, float], None] | None = None,
) -> Run:
    """Walk from an orbit in both directions; a closed branch is walked once.

    After an interruption from the keyboard, what was walked until then.
    """
    options: Options = {"limits": limits, "settings": settings}
    options |= {"callback": callback, "progress": progress}
    go = _walks_from(problem, unknowns, tests, stop, unphysical, **options)
    forward = keep_interrupted(partial(go, +1))
    if not forward.points:
        raise InputError("orbit", forward.end.message, "give an orbit that solves its equations")
    backward = other_way(forward, problem.parameter, partial(go, -1))
    return Run.of(problem, backward, forward)


def _walks_from(
    problem: OrbitProblem,
    unknowns: Array,
    tests: Sequence[TestFunction],
    stop: Policy | None,
    unphysical: bool,
    **options: Unpack[Options],
) -> Callable[[int], Walk]:
    """The walk in a direction."""
    policies, tests = [] if stop is None else [stop], add_stop_test(tests, stop)
    given: Any = {"tests": tests, "policies": policies, "unphysical": unphysical, **options}
    return lambda direction: walk_orbits(problem, unknowns, direction, **given)


# From an event to the branch that is born there.


@explain_arguments
def continue_born(
    entry: Entry,
    model: Model | None = None,
    range: tuple[float, float] | None = None,
    *,
    events: Sequence[str | UserEvent] | None = None,
    values: Mapping[str, Sequence[float]] | None = None,
    settings: Settings | Mapping[str, Any] | None = None,
    callback: Callback | None = None,
    name: str = "b1",
    unphysical: bool | None = None,
    progress: Asked = False,
) -> Branch | None:
    """Follow the branch born at an event of another one, from a catalogue just made or loaded.

    Parameters
    ----------
    entry : Entry
        A G, V, PD or BP, or a T at which sliding vanishes or impacts exchange their order.
    model : Model, optional
        The system, where its name does not tell; parameter values are taken from the entry. It may
        also stand before the entry.
    range : (low, high)
        Of the entry's parameter.
    events, values, settings, callback, name, unphysical, progress
        As of `continue_orbit`.

    Returns
    -------
    Branch or None
        None where nothing starts: the only impact was dropped, or the event is degenerate. After
        an interruption from the keyboard, what was followed until then; its ends say so.

    Raises
    ------
    InputError
        For an event of another kind, or a range that does not fit.
    """
    if isinstance(model, str) and model == getattr(entry, "parameter", None):
        model = None  # where `continue_orbit` has the parameter, which here is the entry's
    entry, model = entry_first(entry, model)
    if getattr(entry, "kind", None) not in SWITCHES:
        accepted = f"accepted are entries of {', '.join(SWITCHES)}"
        raise InputError("entry", f"nothing is born at {short_repr(entry)}", accepted)
    start = switch(event_of(entry, model))
    if start is None:
        return None
    start = primitive_start(start)
    problem = start.problem
    limits = check_range(problem, range, entry.value)
    tests = tests_of_events(problem, events, values)
    place = {"entry": entry.id, "parent": entry.branch}
    born = End.of(EndKind.BORN, entry.parameter, entry.value, **place)
    with progress_callback(
        progress, f"following {name}, {problem.word}", problem, callback
    ) as told:
        stop, settings = symmetric_end(problem), _numerics(settings)
        if unphysical is None:
            unphysical = problem.model.few_guards or not entry.physical
        run = run_born(start, born, limits, tests, settings, name, stop, told, unphysical)
    if isinstance(run, End):
        return None
    asked = [test.kind for test in tests]
    branch = retry_interrupted(lambda: run.branch(name, entry.id, kinds=asked))
    return dataclasses.replace(branch, notes=[start.note, *branch.notes]) if start.note else branch


def run_born(
    start: Start,
    born: End,
    limits: tuple[float, float],
    tests: Sequence[TestFunction],
    settings: Settings,
    name: str = "b1",
    stop: Policy | None = None,
    callback: Callback | None = None,
    unphysical: bool = True,
    progress: Callable[[int, float], None] | None = None,
) -> Run | End:
    """Walk along a branch from its start, one way or both as `Start` says.

    `born` is the end in the direction not followed; `name`, the branch's, is for the end of one
    that mirrors itself. The other arguments are those of `walk_orbits`. Where there is no first
    point, returns the end that says why.
    """
    problem = start.problem
    options: Options = {"limits": limits, "settings": settings}
    options |= {"callback": callback, "progress": progress}
    leaving: Options = {**options, "tangent": start.tangent, "branching": start.branching}
    go = _walks_from(problem, start.unknowns, tests, stop, unphysical, **leaving)
    forward = keep_interrupted(partial(go, +1))
    if not forward.points:
        return forward.end
    first, closed = forward.points[:1], forward.end.kind is EndKind.CLOSED
    if not closed and mirrors_back(problem, start.unknowns, start.tangent, symmetry_of(problem)):
        backward = Walk(first, (), mirror_end(name, first[0]))
    elif start.both_ways or closed:
        backward = other_way(forward, problem.parameter, partial(go, -1))
        if not backward.points:
            backward = Walk(first, (), backward.end)
    else:
        backward = Walk(first, (), born)
    return Run.of(problem, backward, forward, born=True)


def first_step(start: Start, limits: tuple[float, float], settings: Settings) -> Walk:
    """Return the walk's first step, to see where it leads."""
    return walk_orbits(
        start.problem,
        start.unknowns,
        +1,
        limits=limits,
        tangent=start.tangent,
        branching=start.branching,
        settings=dataclasses.replace(settings, max_points=2),
    )
