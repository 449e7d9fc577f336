"""From an orbit to its branch: both walks, joined and tabulated."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..bifurcations.declarations import KINDS, usual_events, with_values
from ..bifurcations.registry import test_functions
from ..continuation.branch import Event, Point, Points, TestFunction, UserFunction, Walk, joined
from ..continuation.corrector import correct
from ..continuation.ends import AT_BRANCH_POINTS, EndKind
from ..continuation.events import on_points, with_points_between
from ..continuation.problem import Evaluation
from ..continuation.settings import Settings
from ..continuation.walk import SAME_SOLUTION, Stop, interrupted, kept, other_way, undisturbed
from ..errors import InputError, shown
from ..models.model import Model
from ..models.word import Word
from ..orbits.orbit import Orbit
from ..orbits.problem import OrbitProblem
from ..orbits.quiet import problem_of
from ..orbits.search import solve_near
from ..progress import Asked, asked, both, counted
from ..results.branch import Branch, Entry
from ..results.diagram import Diagram
from ..results.entry_conversion import as_orbit, entry_of, named
from ..segments.kernels import Kernels
from .orbit_walks import walk_orbits
from .symmetry import at_image, watched
from .tables import tabulate

BEYOND = 0.1
"""By how much of its way an orbit between two points of a branch may lie before or beyond them."""

UserEvent = tuple[str, Callable[[Orbit], float]]
Callback = Callable[[Point], bool | None]


def continue_orbit(
    orbit: Orbit | Entry | Event | Point | tuple[Branch | Diagram, int | str],
    parameter: str | None = None,
    range: tuple[float, float] | None = None,
    *,
    events: Sequence[str | UserEvent] | None = None,
    values: Mapping[str, Sequence[float]] | None = None,
    settings: Settings | None = None,
    callback: Callback | None = None,
    name: str = "b1",
    model: Model | None = None,
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
    settings : Settings, optional
    callback : callable, optional
        Called with every accepted point; a true value stops the walk in that direction.
    name : str
        The branch's name.
    model : Model, optional
        The system of an entry or a branch, where its name does not tell; see `Entry.orbit`.
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
    given = named(orbit)
    orbit = as_orbit(given, model)
    problem = orbit.problem
    parameter = parameter or problem.parameter
    unknowns = orbit.unknowns
    if parameter != problem.parameter:
        model = orbit.model
        problem = problem_of(model, orbit.word, Kernels(model, parameter))
        unknowns = np.append(unknowns[:-1], model.values[parameter])
    limits = checked_range(problem, range, float(unknowns[-1]))
    stop, tests = at_image(problem), tests_of_events(problem, events, values)
    settings = settings or Settings()
    if isinstance(given, Entry) and given.tangent is not None and problem is orbit.problem:
        unknowns = _beside(problem, unknowns, np.array(given.tangent), limits, settings)
    with told_of(progress, f"following {name}, {problem.word}", problem, callback) as told:
        run = both_ways(problem, unknowns, limits, watched(tests, stop), settings, told, stop)
    return undisturbed(lambda: run.branch(name, kinds=[test.kind for test in tests]))


@contextlib.contextmanager
def told_of(
    progress: Asked, what: str, problem: OrbitProblem, callback: Callback | None
) -> Iterator[Callback | None]:
    """Yield the callback of a walk, which tells how far it is if that was asked for."""
    with asked(progress, what) as tell:
        yield both(callback, counted("", problem.parameter, tell)) if progress else callback


def _beside(
    problem: OrbitProblem,
    unknowns: Array,
    tangent: Array,
    limits: tuple[float, float],
    settings: Settings,
) -> Array:
    """The orbit one step from a branch point along one of the two branches that cross there."""
    first = dataclasses.replace(settings, max_points=2)
    probe = walk_orbits(
        problem, unknowns, +1, limits=limits, settings=first, tangent=tangent, branching=True
    )
    return probe.points[-1].unknowns if probe.points else unknowns


def tests_of_events(
    problem: OrbitProblem,
    events: Sequence[str | UserEvent] | None,
    values: Mapping[str, Sequence[float]] | None,
) -> list[TestFunction]:
    events = usual_events(problem.model) if events is None else events
    if isinstance(events, str) or not isinstance(events, Sequence):
        raise InputError("events", f"found {events!r}", "give a list, such as ['PD', 'G']")
    texts = [kind for kind in events if isinstance(kind, str)]
    kinds = with_values(texts, values, "events", "give values={name: [...]}")
    tests = test_functions(problem, kinds, values or {})
    return tests + [_user(kind) for kind in events if not isinstance(kind, str)]


def checked_range(
    problem: OrbitProblem, limits: tuple[float, float] | None, start: float
) -> tuple[float, float]:
    """Return the range as floats, or raise `InputError` if it does not fit."""
    declared = problem.model.require(problem.parameter, "parameter")
    if not isinstance(limits, Sequence | np.ndarray) or len(limits) != 2:
        found = "missing" if limits is None else f"found {shown(limits)}"
        raise InputError("range", found, f"give (low, high), values of {problem.parameter}")
    low, high = (declared.check(limit, "range") for limit in limits)
    if not low < high or not low <= start <= high:
        at = f"{problem.parameter} = {start:.12g}"
        found = f"({low:.12g}, {high:.12g}) does not hold the start {at}"
        raise InputError("range", found, "give low < high around the start")
    problem.model.validate_between(problem.parameter, low, high, "range")
    return low, high


def _user(given: UserEvent) -> TestFunction:
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
        points, events = joined(backward, forward)
        events = on_points(points, events)
        places = {event.point.arclength for event in events}
        ends = {0: backward.end, len(points) - 1: forward.end}
        rows = {row for row, end in ends.items() if end.kind in AT_BRANCH_POINTS}
        rows |= {len(backward.points) - 1} if born else set()
        if forward.end.kind is EndKind.CLOSED:  # both ends are one orbit
            at_event = born or any(points[row].arclength in places for row in ends)
            rows |= set(ends) if at_event else set()
        others = [point for row in sorted(rows) if (point := points[row]).arclength not in places]
        points = with_points_between(problem, points, events, others)
        return cls(problem, (backward, forward), points, events, [p.arclength for p in others])

    @property
    def interrupted(self) -> bool:
        """Whether the keyboard has interrupted one of the walks."""
        return interrupted(walk.end for walk in self.walks)

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
        missed = [
            f"{m.kind} between {problem.parameter} = {m.parameters[0]:.12g} and "
            f"{m.parameters[1]:.12g}: {m.reason}"
            for m in (*backward.missed, *forward.missed)
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
            missed=missed,
            origin=origin,
            notes=list(dict.fromkeys([*backward.notes, *forward.notes])),
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
        for i in np.nonzero(passed)[0]:
            left, right = rows[i], rows[i + 1]
            guess = left + (value - left[-1]) / (right[-1] - left[-1]) * (right - left)
            guess[-1] = value
            if self._same(solve_near(self.problem, guess), unknowns):
                return True
        return any(self._passes_at_turn(i, unknowns) for i in self._turning)

    @functools.cached_property
    def _turning(self) -> list[int]:
        """The ways from a row to the next one beside which the parameter turns back.

        Between them it goes beyond both, and at one value there are two orbits next to each other.
        """
        step = np.diff(self.rows[:, -1])
        turns = 1 + np.nonzero(step[:-1] * step[1:] <= 0.0)[0]
        near = {int(i) for turn in turns for i in range(turn - 2, turn + 2)}
        return sorted(i for i in near if 0 <= i < len(step))

    def _passes_at_turn(self, row: int, unknowns: Array) -> bool:
        """Whether the branch from a row to the next one passes an orbit: where it meets the plane
        through the orbit across its way, it is that orbit."""
        problem, left, right = self.problem, self.rows[row], self.rows[row + 1]
        scale = problem.scale(left, float(np.ptp(self.rows[:, -1])) or 1.0)
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
        if here is None:
            return False
        apart = self.problem.difference(here.unknowns, unknowns)
        return bool(np.max(np.abs(apart)) < SAME_SOLUTION)


def both_ways(
    problem: OrbitProblem,
    unknowns: Array,
    limits: tuple[float, float],
    tests: list[TestFunction],
    settings: Settings,
    callback: Callback | None = None,
    stop: Stop | None = None,
) -> Run:
    """Walk from an orbit in both directions; a closed branch is walked once.

    After an interruption from the keyboard, what was walked until then.
    """

    def go(direction: int) -> Walk:
        return walk_orbits(
            problem,
            unknowns,
            direction,
            limits=limits,
            tests=tests,
            settings=settings,
            callback=callback,
            stop=stop,
        )

    forward = kept(lambda: go(+1))
    if not forward.points:
        raise InputError("orbit", forward.end.message, "give an orbit that solves its equations")
    backward = other_way(forward, problem.parameter, lambda: go(-1))
    return Run.of(problem, backward, forward)
