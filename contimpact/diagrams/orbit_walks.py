"""Walks along branches of orbits: the backend, what ends a walk, and the runs of two walks."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from ..arrays import Array
from ..bifurcations.branch_point import BranchPoint
from ..bifurcations.extended_system import OrbitTest, crossing_near
from ..bifurcations.kind import ON_CIRCLE, Change, Start, explain_changes, kind_of
from ..continuation.branch import (
    AT_BRANCH_POINTS,
    End,
    EndKind,
    Evaluation,
    Event,
    MissedEvent,
    Point,
    Points,
    Problem,
    TestFunction,
    Walk,
    join_walks,
    missed_texts,
)
from ..continuation.corrector import EPSILON, correct
from ..continuation.crossing_branches import Meeting
from ..continuation.events import separate_events, snap_to_points
from ..continuation.settings import Settings
from ..continuation.step import Backend, Batch, DenseBackend, Position
from ..continuation.walk import SAME_SOLUTION, Options, Policy, both_ways, keep_interrupted, walk
from ..errors import InputError
from ..models.guards import Word
from ..models.model import Symmetry
from ..orbits.problem import Linearisation, OrbitProblem
from ..orbits.quiet import FreeQuietProblem, problem_of
from ..orbits.search import mirror_orbit, reduce_period, rotate_to_word, solve_near
from ..results.branch import Branch
from ..results.diagram import entry_of, in_own_clock, tabulate
from ..segments.compiling import note_uncompiled
from ..segments.kernel import SECTION
from ..segments.kernels import Kernels
from .orbit_backend import CycleBackend

if TYPE_CHECKING:
    from .chain_backend import ChainBackend

# Where the forcing's period goes to infinity within a range, as where a frequency goes to zero.
#
# Along such a branch there is no end: orbits wind ever more often within a period, and each step is
# shorter than the one before. It ends where the period is many times what it was at the start.

LONGEST = 1e3
"""How many times the period at its start a branch is followed to, where that has no bound."""

HALVINGS = 200


class LongestPeriod(Policy):
    """Keeps a walk where the period is bounded, and says so where it ended for the period's
    sake."""

    def __init__(self, problem: OrbitProblem, start: Array) -> None:
        self.problem, self.start = problem, start

    def limits(self, limits: tuple[float, float]) -> tuple[float, float]:
        self.asked = limits
        low, high = (_nearest_limit(self.problem, self.start, limit) for limit in limits)
        return low, high

    def ended(self, walk: Walk[Linearisation]) -> Walk[Linearisation]:
        end = walk.end
        if end.kind is not EndKind.RANGE or end.value in self.asked:
            return walk
        times, name = f"{LONGEST:g}", self.problem.parameter
        return replace(walk, end=End.of(EndKind.PERIOD, name, end.value, times=times))


def _nearest_limit(problem: OrbitProblem, start: Array, limit: float) -> float:
    """The limit, or where the period is `LONGEST` times that at the start if it has none there."""
    inside, outside = float(start[-1]), limit
    if problem.free != 1 or math.isfinite(_times(problem, start, limit)):
        return limit
    for _ in range(HALVINGS):
        middle = 0.5 * (inside + outside)
        if _times(problem, start, middle) <= LONGEST:
            inside = middle
        else:
            outside = middle
    return inside if _times(problem, start, inside) > 0.5 * LONGEST else limit


def _times(problem: OrbitProblem, start: Array, value: float) -> float:
    """How many times the period at the start that at a value is; infinite where there is none."""
    there = start.copy()
    there[-1] = value
    try:
        ratio = float(problem.period(there) / problem.period(start))
    except (ArithmeticError, ValueError):
        return math.inf
    return ratio if ratio > 0.0 else math.inf


class PhysicalityEnd(Policy):
    """Ends a walk a step behind the event that makes its orbits unphysical."""

    def accepted(self, point: Point, events: Sequence[Event]) -> tuple[End, Point] | None:
        here = point.evaluation
        if here.verdict.physical:
            return None
        about = here.problem.parameter, point.parameter
        return End.of(EndKind.UNPHYSICAL, *about, why=here.verdict.reason), point


@dataclass(frozen=True)
class StatusChanges(Policy):
    """Explains by events what changes along a walk; see `explain_changes`."""

    problem: OrbitProblem
    tests: Sequence[TestFunction[Linearisation]]
    settings: Settings
    switched: bool

    def ended(self, walk: Walk[Linearisation]) -> Walk[Linearisation]:
        return explain_changes(self.problem, walk, self.tests, self.settings, self.switched)


# Walks on which flights that are integrated may become too long to be computed as a whole.


class SwitchingBackend(Backend):
    """A backend of whole flights until one of them is long, and dense linear algebra from there.

    Of its problem long flights are computed in pieces; the kernels notice which are long.
    """

    def __init__(self, whole: Backend, problem: Problem, kernels: Kernels) -> None:
        self.whole, self.kernels = whole, kernels
        self.pieces = DenseBackend(problem)
        self.long = False

    def advance(self, position: Position, most: int) -> Batch:
        """Take steps until one is proposed or refused, but `most` of them, or fewer."""
        if not self.long:
            self.kernels.long = False
            made = self.whole.advance(position, most)
            if not self.kernels.long:
                return made
            self.long = True
        return self.pieces.advance(position, most)


def walk_orbits(
    problem: OrbitProblem,
    start: Array,
    direction: int,
    *,
    tests: Sequence[TestFunction[Linearisation]] = (),
    gaps: bool = True,
    unphysical: bool = True,
    policies: Sequence[Policy] = (),
    **options: Unpack[Options],
) -> Walk[Linearisation]:
    """As `contimpact.continuation.walk.walk`, for orbits: on a backend of their own.

    With `gaps` it is decided at every point if the orbit is physical, and changes of that or of the
    number of unstable multipliers are explained by events; see `explain_changes`.
    Without `unphysical` the walk ends where its orbits are unphysical.
    """
    backend = backend_of(problem, tests, gaps)
    policies = [*policies, *([] if unphysical else [PhysicalityEnd()])]
    policies += [FreePeriodEnds(problem)] if problem.autonomous else [LongestPeriod(problem, start)]
    if gaps:
        settings, switched = options.get("settings"), options.get("tangent") is not None
        policies.append(StatusChanges(problem, tests, settings or Settings(), switched))
    return walk(
        problem,
        start,
        direction,
        tests=tests,
        policies=policies,
        parameter=problem.parameter,
        backend=backend,
        meeting=meeting_near,
        **options,
    )


def backend_of(
    problem: OrbitProblem, tests: Sequence[TestFunction[Linearisation]], gaps: bool = True
) -> CycleBackend | ChainBackend | SwitchingBackend | None:
    """Return a problem on block-cyclic elimination.

    None where there is none: for more than four coordinates, for two free parameters, and for
    orbits without impacts whose flight has a closed form.
    """
    kernels, walls = problem.kernels, problem.word.walls
    flights = problem.kinds or [(SECTION, str(problem.word.period))]
    flown = any(kernels.flown(*ends) for ends in flights)
    if problem.free != 1 or not (walls or flown):
        return None
    needs = {need for test in tests if isinstance(test, OrbitTest) for need in test.needs}
    wanted = gaps or "gaps" in needs, "doubling" in needs
    kind: Any = CycleBackend
    one = walls and problem.paired and not problem.lost and kernels.passages.anchored
    if not one or kernels.may_leave_at_once(walls):
        from .chain_backend import MOST_COORDINATES, ChainBackend, SectionBackend

        kind = ChainBackend if walls else SectionBackend
        if problem.model.DEGREES_OF_FREEDOM > MOST_COORDINATES:
            note_uncompiled("more than four coordinates")
            return None
    backend = problem.solvers.get(f"steps{wanted}") or kind(problem, *wanted)
    problem.solvers[f"steps{wanted}"] = backend
    if flown:
        return SwitchingBackend(backend, problem, kernels)
    return backend


def meeting_near(
    problem: Problem[Linearisation], guess: Point[Linearisation], scale: Array
) -> Meeting | None:
    """Return where branches meet next to a point; among equilibria, of any period, none does."""
    found = crossing_near(problem, guess, scale)
    if found is not None and isinstance(problem, FreeQuietProblem):
        units = problem.residual_sizes(scale)[: problem.m]
        return None if problem.rests(found.unknowns, units) else found
    return found


# Where branches of free period end: at equilibria, and where periods or rounding errors grow.

LOST = 1e-9
"""A part of the orbit's size to which flights have amplified the rounding of their unknowns."""

GROWTH = 10.0
"""Factor by which these do not grow from a point to the next: by 2.03 at most on some 2,200 points
of three systems, where the period of one grows without bound."""

STILL = 1e-13
"""A change of the parameter, as part of it, with which its value is known: within a step, or, of a
short one, while the period grows by the shortest one."""

LONG = 1.5
"""Factor by which a period has grown that grows without bound."""


class FreePeriodEnds(Policy):
    """What ends a walk along orbits of free period."""

    def __init__(self, problem: OrbitProblem) -> None:
        self.problem = problem
        self.before: Point | None = None
        self.shortest = np.inf
        self.sound = 0
        """Points, with this one, before which rounding errors cannot have grown to be `LOST`."""

    def accepted(self, point: Point, events: Sequence[Event]) -> tuple[End, Point] | None:
        before, self.before = self.before or point, point
        return self.comes_to_rest(before, point) or self.for_ever(before, point)

    def comes_to_rest(self, before: Point, point: Point) -> tuple[End, Point] | None:
        """The end before the first coordinate turns the other way: the orbits have shrunk to none.

        They do so with the root of the parameter's distance, by which its value is told.
        """
        problem = self.problem
        if not isinstance(problem, FreeQuietProblem):
            return None
        one, other = (problem.turning(p.unknowns) for p in (before, point))
        if one * other > 0.0 or before is point:
            return None
        value = (before.parameter * other**2 - point.parameter * one**2) / (other**2 - one**2)
        return End.of(EndKind.REST, problem.parameter, value), before

    def for_ever(self, before: Point, point: Point) -> tuple[End, Point] | None:
        """The end where the period grows alone, or rounding errors, with it or without.

        How much of them the equations amplify is smooth along the branch; a residual is not, and
        would end the walk where a processor has it.
        """
        here, problem = point.evaluation, self.problem
        grown = here.span - before.evaluation.span
        self.shortest = min(self.shortest, here.span)
        longer = grown > 0.0 and here.span > LONG * self.shortest
        step = abs(point.parameter - before.parameter) * self.shortest
        still = step < STILL * abs(point.parameter) * min(grown, self.shortest)
        self.sound -= 1
        if self.sound > 0 and not (longer and still):
            return None
        size = max(1.0, float(np.max(np.abs(problem.impacts(here.unknowns)[:, 1:]), initial=0.0)))
        error = EPSILON * float(np.max(np.abs(here.jacobian) @ np.abs(here.unknowns)))
        most = LOST * size
        lost = error > most
        self.sound = int(math.log(most / error, GROWTH)) if 0.0 < error < most else 0
        at, told = (problem.parameter, point.parameter), {"period": here.span, "error": error}
        if longer and (lost or still):
            what, other = f"{problem.parameter} changes no more", ""
            if lost:
                other = ", or follow a slow motion that repels (a canard)"
                what = f"the rounding errors of so long a flight to {error:.1g}"
                if isinstance(problem, FreeQuietProblem):
                    what += " (two modes of its law, with guards at v = 0, would divide it)"
            return End.of(EndKind.FOR_EVER, *at, **told, what=what, other=other), point
        return (End.of(EndKind.ROUNDING, *at, **told), point) if lost else None


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
    images = _mirror_images(problem, unknowns, symmetry)
    return any(problem.apart(image, unknowns) < tolerance for image in images)


def mirrors_back(
    problem: OrbitProblem, unknowns: Array, tangent: Array, symmetry: Symmetry | None
) -> bool:
    """Whether the mirror image of a branch leaves its start as the branch itself, backwards."""
    if not symmetric(problem, unknowns, symmetry, AT_IMAGE):
        return False
    along = 1e-4 * tangent / np.max(np.abs(tangent / problem.natural_units(unknowns)))
    ways = (_mirror_images(problem, unknowns + way, symmetry) for way in (along, -along))
    turned = (unknowns + problem.difference(*images) / 2.0 for images in zip(*ways, strict=True))
    return any(problem.apart(image, unknowns - along) < 1e-8 for image in turned)


def _mirror_images(
    problem: OrbitProblem, unknowns: Array, symmetry: Symmetry | None
) -> list[Array]:
    """The mirror image of an orbit as one of its word, and begun later; none if it is none of
    it."""
    mirrored = None if symmetry is None else mirror_orbit(problem, unknowns, symmetry)
    image = None if mirrored is None else rotate_to_word(*mirrored, problem.word)
    return [] if image is None else [image, *problem.later(image)]


def symmetric_end(problem: OrbitProblem, known: Known | None = None) -> _SymmetricEnd | None:
    """Return what ends a walk at the branch point where its orbits become images of themselves.

    It is for a walk that looks for BP; None where no orbit of the problem can be an image
    of itself. `known` returns the name of the branch that an orbit of shorter period lies on.
    """
    if not problem.word.repeated() and symmetry_of(problem) is None:
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
        self.first = np.zeros(0)

    def accepted(self, point: Point, events: Sequence[Event]) -> tuple[End, Point] | None:
        if self.kinds is None:
            self.first = point.unknowns
            own = self.images(point.unknowns, OFF_IMAGE)
            self.kinds = [k for k in (EndKind.SHORTER, EndKind.SYMMETRIC) if k not in own]
        for event in events:
            for kind in self.images(event.point.unknowns, AT_IMAGE):
                if kind in self.kinds:
                    return self.end(kind, event.point), event.point
        return None

    def images(self, unknowns: Array, tolerance: float) -> list[EndKind]:
        """In which ways an orbit is an image of itself."""
        found = []
        if self.shorter(unknowns, tolerance) is not None:
            found.append(EndKind.SHORTER)
        if symmetric(self.problem, unknowns, self.symmetry, tolerance):
            found.append(EndKind.SYMMETRIC)
        return found

    def shorter(self, unknowns: Array, tolerance: float) -> tuple[OrbitProblem, Array] | None:
        """The orbit of shorter period that an orbit repeats.

        Without impacts it is measured by the branch's first orbit: an equilibrium has no size.
        """
        problem = self.problem
        if problem.word.walls:
            found = reduce_period(problem, unknowns, tolerance)
            return None if found[0] is problem else found
        for word in problem.word.repeated():
            one = problem_of(problem.model, word, problem.kernels)
            sizes = one.residual_sizes(one.scale(self.first, 1.0))
            if np.all(np.abs(one.evaluate(unknowns).residual) < tolerance * sizes):
                return one, unknowns
        return None

    def end(self, kind: EndKind, point: Point) -> End:
        """The end at a branch point."""
        name, value = self.problem.parameter, point.parameter
        once = None if kind is EndKind.SYMMETRIC else self.shorter(point.unknowns, AT_IMAGE)
        if once is None:
            return End.of(kind, name, value)
        shorter, moved = once
        if self.known is not None and (branch := self.known(shorter, moved)):
            return End.of(EndKind.KNOWN, name, value, known=branch)
        letters, word = self.problem.model.letters, self.problem.word
        laps = len(word) // len(shorter.word) if word.walls else word.period // shorter.word.period
        return End.of(kind, name, value, word=shorter.word.notation(letters), times=laps)


# A branch just walked, and the walks that make one.

WITHOUT_MULTIPLIERS = ("V", "T")
"""Events at which a multiplier is infinite, or jumps."""

BEYOND = 0.1
"""Part of its way by which an orbit between two points of a branch may lie before or beyond
them."""

ASIDE = 4.0
"""How far a branch may lie beside the straight way between two of its points, in lengths of it."""

Callback = Callable[[Point], bool | None]

ONE_ZERO = 1e-2
"""Arclength within which one zero is located and missed, if its error in the parameter says so."""

APART = 1e-6
"""Arc length from an event on from which depths of touches, which go with its square, are beyond
rounding."""


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
            seam = len(backward.points) == 1
            at_event = (born and seam) or any(points[row].arclength in places for row in ends)
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
            events=list(map(in_own_clock, entries, events)),
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
        """The points before and after an event, so far from it that rounding does not decide what
        they are; a closed branch goes on at its other end."""
        lengths, last = self.points.arclengths, len(self.points) - 1
        after = int(np.searchsorted(lengths, event.point.arclength + APART, side="right"))
        before = int(np.searchsorted(lengths, event.point.arclength - APART)) - 1
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
        """Whether an orbit lies on this branch, its word rotated perhaps, or begun a period of the
        forcing later."""
        turned = rotate_to_word(problem, unknowns, self.problem.word)
        if turned is None:
            return False
        return any(self.holds(one) for one in (turned, *problem.later(turned)))

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
    return Run.of(problem, *both_ways(forward, problem.parameter, partial(go, -1)))


def _walks_from(
    problem: OrbitProblem,
    unknowns: Array,
    tests: Sequence[TestFunction],
    stop: Policy | None,
    unphysical: bool,
    **options: Unpack[Options],
) -> Callable[..., Walk]:
    """The walk in a direction, to a goal if one is given."""
    policies, tests = [] if stop is None else [stop], add_stop_test(tests, stop)
    given: Any = {"tests": tests, "policies": policies, "unphysical": unphysical, **options}
    return lambda direction, goal=None: walk_orbits(
        problem, unknowns, direction, goal=goal, **given
    )


MIRRORED = "; the other way, the mirror images of its orbits follow"


def run_born(
    start: Start,
    born: End,
    limits: tuple[float, float],
    tests: Sequence[TestFunction],
    settings: Settings,
    stop: Policy | None = None,
    callback: Callback | None = None,
    unphysical: bool = True,
    progress: Callable[[int, float], None] | None = None,
) -> Run | End:
    """Walk along a branch from its start, one way or both as `Start` says, and one way where the
    other one has the mirror images.

    `born` is the end in the direction not followed. The other arguments are those of `walk_orbits`.
    Where there is no first point, returns the end that says why.
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
        mirrored = dataclasses.replace(born, message=f"{born.message}{MIRRORED}")
        backward = Walk(first, (), mirrored)
    elif start.both_ways or closed:
        backward, forward = both_ways(forward, problem.parameter, partial(go, -1))
        if not backward.points:
            backward = Walk(first, (), backward.end)
    else:
        backward = Walk(first, (), born)
    return Run.of(problem, backward, forward, born=True)


def first_step(
    start: Start,
    limits: tuple[float, float],
    settings: Settings,
    direction: int = +1,
    gaps: bool = True,
) -> Walk:
    """Return the walk's first step, to see where it leads; `gaps` as of `walk_orbits`."""
    return walk_orbits(
        start.problem,
        start.unknowns,
        direction,
        limits=limits,
        tangent=start.tangent,
        branching=start.branching,
        settings=dataclasses.replace(settings, max_points=2),
        gaps=gaps,
    )


def orbit_beside(
    problem: OrbitProblem,
    unknowns: Array,
    tangent: Array,
    limits: tuple[float, float],
    settings: Settings,
) -> Array:
    """Return the orbit one step from a branch point along one of the two branches that cross there.

    On a limit of the range only one direction leads to it.
    """
    start = Start(problem, unknowns, tangent, branching=True, both_ways=True)
    for direction in (+1, -1):
        probe = first_step(start, limits, settings, direction)
        if len(probe.points) > 1:
            return probe.points[-1].unknowns
    return unknowns
