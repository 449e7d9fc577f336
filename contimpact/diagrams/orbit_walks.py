"""Walks along branches of orbits: the backend, changes of status, long flights, and ends."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from ..arrays import Array
from ..bifurcations.declarations import KINDS
from ..bifurcations.extended_system import OrbitEvent, OrbitPoint, OrbitTest, crossing_near
from ..bifurcations.kind import Change, kind_of
from ..continuation.branch import (
    End,
    EndKind,
    Event,
    MissedEvent,
    Point,
    Points,
    Problem,
    TestFunction,
    Walk,
)
from ..continuation.corrector import EPSILON, Arc
from ..continuation.events import find_events
from ..continuation.settings import Settings
from ..continuation.sign_changes import Sample, Stretch
from ..continuation.step import Backend, Batch, DenseBackend, Position
from ..continuation.walk import Options, Policy, walk
from ..orbits.problem import Linearisation, OrbitProblem
from ..orbits.quiet import FreeQuietProblem
from ..orbits.status import PHYSICAL, UNIT_CIRCLE_ROUNDING, count_unstable
from ..segments.compiling import note_uncompiled
from ..segments.kernels import Kernels
from ..segments.layout import SECTION
from .orbit_backend import CycleBackend

if TYPE_CHECKING:
    from .chain_backend import ChainBackend

# Changes of physicality and of stability along a branch, each of which needs an event.
#
# An orbit turns unphysical at a G, V or T, and the number of its multipliers outside the unit
# circle changes at an FB, BP, PD or NS, or where impacts merge (T): each kind says so itself. Where
# it does so between two points, an event of a kind that was asked for may have caused it, and none
# was found, the arc is searched again, ever closer to the change; what is still not explained is
# recorded as missed. A change that only other kinds cause costs nothing.
#
# A walk that starts on an event has the stability of neither side there: a point next to the start
# tells with which one it leaves. Where the event is the birth of an impact, determinants vanish
# with a flight, and others may crowd beside it: each multiplier that passes the unit circle up to
# the first point needs an event.

SEARCHED = (0, 4, 10, 20, 34)
"""Number of bisections after which an arc is searched for events again."""

BISECTIONS = 44

CLOSED_IN = 1e-12
"""An arc shorter than this part of the way along the branch is no longer than rounding."""

BESIDE = (1e-8, 1e-6, 1e-4, 1e-2)
"""Fractions of the first step at which a point is tried that tells how a walk leaves an event."""

ON_CIRCLE = 1e-6
"""A multiplier nearer to the unit circle than this, so near to an event, tells nothing."""

BLURRED = 10.0
"""How near to a branch point the status of points tells nothing, in roots of the tolerance."""


def explain_changes(
    problem: OrbitProblem,
    walk: Walk[Linearisation],
    tests: Sequence[TestFunction[Linearisation]],
    settings: Settings,
    switched: bool,
) -> Walk[Linearisation]:
    """Return a walk with the events that explain its changes of status, or what is missing.

    `tests` were looked for: a change that only other kinds explain is left alone. A walk that is
    `switched` starts on an event, where a status is that of neither side: its stability is taken
    from next to it.
    """
    asked = {test.kind for test in tests}
    sought = {kind_of(kind).changes for kind in asked} - {None}
    if len(walk.points) < 2 or not sought:
        return walk
    events, missed = list(walk.events), list(walk.missed)
    turn = walk.points[-1].arclength if walk.end.kind is EndKind.CLOSED else np.inf
    places = places_with_status(walk, settings)
    if switched and Change.STABILITY in sought and 1 in places:
        for ends in _ends_of_leaving(problem, walk, settings):
            if not _unexplained(events, *ends, asked, turn):
                continue
            found, lost = _bisect_change(problem, *ends, tests, settings, Change.STABILITY)
            events += [event for event in found if not _is_recorded(event, events)]
            arc, closed_in = _arc(problem, *ends, settings), {event.kind: event for event in lost}
            missed += [
                closed_in.get(kind) or _missed_change(kind, arc, Change.STABILITY)
                for kind in _unexplained(events, *ends, asked, turn)
            ]
    lengths = Points(walk.points).arclengths
    for i, j, change in _changes(walk, sought, places):
        if (i == 0 and switched) or _explains(events, lengths[i], lengths[j], change, turn):
            continue
        left, right = walk.points[i], walk.points[j]
        if asked.isdisjoint(_causes(left, right, change)):
            continue
        found, lost = _bisect_change(problem, left, right, tests, settings, change)
        events += [event for event in found if not _is_recorded(event, events)]
        missed += lost
    events.sort(key=lambda event: event.point.arclength)
    return replace(walk, events=events, missed=missed)


def places_with_status(walk: Walk[Linearisation], settings: Settings) -> Array:
    """Return the places of the points whose status tells of the branch.

    Next to a branch point, where the equations vanish with the square of the distance from two
    branches, a point within the tolerance may be off both.
    """
    crossings = [event.point.arclength for event in walk.events if kind_of(event.kind).crossing]
    if not crossings:
        return np.arange(len(walk.points))
    places = Points(walk.points).arclengths
    near = BLURRED * np.sqrt(settings.tolerance)
    return np.nonzero(np.all([np.abs(places - place) > near for place in crossings], axis=0))[0]


def _changes(
    walk: Walk[Linearisation], sought: Collection[Change | None], told: Array
) -> list[tuple[int, int, Change]]:
    """Points between which a status changes; where both do, stability comes first."""
    points, status = Points(walk.points), dict[Change, Array]()
    if Change.STABILITY in sought:
        multipliers = points.stacked(
            lambda point: point.evaluation.multipliers,
            lambda block: np.ascontiguousarray(block.described[:, 1:-6]).view(complex),
        )
        status[Change.STABILITY] = count_unstable(multipliers[told])
    if Change.PHYSICALITY in sought:
        status[Change.PHYSICALITY] = points.numbers[told, -6] != PHYSICAL
    changes = [
        (int(told[i]), int(told[i + 1]), change)
        for change, values in status.items()
        for i in np.nonzero(values[1:] != values[:-1])[0]
    ]
    return sorted(changes, key=lambda found: found[0])


def _ends_of_leaving(
    problem: OrbitProblem, walk: Walk[Linearisation], settings: Settings
) -> list[tuple[OrbitPoint, OrbitPoint]]:
    """A point next to the event a walk starts on, and the first point, if multipliers pass the unit
    circle between them."""
    first = walk.points[1]
    arc = _arc(problem, walk.points[0], first, settings)
    for fraction in BESIDE:
        beside = arc.at(fraction)
        if beside is None or not arc.left.arclength < beside.arclength < first.arclength:
            continue
        if np.all(np.abs(np.abs(beside.evaluation.multipliers) - 1.0) > ON_CIRCLE):
            return [(beside, first)] if _count_outside(beside) != _count_outside(first) else []
    return []


def _unexplained(
    events: Sequence[OrbitEvent],
    left: OrbitPoint,
    right: OrbitPoint,
    asked: Collection[str],
    turn: float,
) -> list[str]:
    """Kinds that were asked for and are lacking: one for each multiplier that passes the unit
    circle between two points without an event."""
    ends = left.arclength, right.arclength
    between = [event.kind for event in events if _lies_between(event, *ends, turn)]
    if any(all(map(kind_of(kind).explains, Change)) for kind in between):
        return []
    lacking: list[str] = []
    for kinds in _causes_by_multiplier(left, right):
        found = next((kind for kind in between if kind in kinds), None)
        if found is None:
            lacking += [kind for kind in kinds if kind in asked][:1]
        elif not kind_of(found).passed(None):
            between.remove(found)
    return list(dict.fromkeys(lacking))


def _arc(problem: OrbitProblem, left: OrbitPoint, right: OrbitPoint, settings: Settings) -> Arc:
    span = abs(right.parameter - left.parameter) or abs(left.parameter) or 1.0
    return Arc(problem, left, right, problem.scale(left.unknowns, span), settings)


def _explains(
    events: Sequence[OrbitEvent], left: float, right: float, change: Change, turn: float
) -> bool:
    """Whether an event that explains a change lies between two places, or on one of them.

    `turn` is the length of a closed branch: an event at its start is at its end, too.
    """
    return any(
        kind_of(event.kind).explains(change) and _lies_between(event, left, right, turn)
        for event in events
    )


def _lies_between(event: OrbitEvent, left: float, right: float, turn: float) -> bool:
    """Whether an event lies between two places along a branch, or on one of them."""
    slack = 1e-9 * (right - left)
    return any(
        left - slack <= event.point.arclength + way <= right + slack for way in (0.0, turn, -turn)
    )


def _is_recorded(event: OrbitEvent, events: Sequence[OrbitEvent]) -> bool:
    return any(
        event.kind == other.kind
        and event.details.get("index") == other.details.get("index")
        and _is_same(event.point, other.point)
        for other in events
    )


def _is_same(one: OrbitPoint, other: OrbitPoint) -> bool:
    units = other.evaluation.problem.natural_units(other.unknowns)
    return bool(np.max(np.abs((one.unknowns - other.unknowns) / units)) < 1e-8)


def _bisect_change(
    problem: OrbitProblem,
    left: OrbitPoint,
    right: OrbitPoint,
    tests: Sequence[TestFunction[Linearisation]],
    settings: Settings,
    change: Change,
) -> tuple[list[OrbitEvent], list[MissedEvent]]:
    """Bisect the change of status, and look for the event on ever shorter arcs."""
    arc = _arc(problem, left, right, settings)
    state = _state_of(change)
    here = state(left)
    for bisection in range(BISECTIONS):
        if bisection in SEARCHED:
            found = _find(tests, arc)
            if any(kind_of(event.kind).changes is change for event in found):
                return [arc.holding(event) for event in found], []
        middle = arc.at(0.5)
        ends = arc.left.arclength, arc.right.arclength
        if middle is None or not ends[0] < middle.arclength < ends[1]:
            break
        before, after = arc.halves(middle)
        arc = after if state(middle) == here else before
    asked = {test.kind for test in tests}
    lacking = [kind for kind in _causes(arc.left, arc.right, change) if kind in asked]
    return [], [_missed_change(kind, arc, change) for kind in lacking[:1]]


def _state_of(change: Change) -> Callable[[OrbitPoint], int]:
    if change is Change.PHYSICALITY:
        return lambda point: point.evaluation.verdict.physical
    return lambda point: point.evaluation.n_unstable


def _find(tests: Sequence[TestFunction[Linearisation]], arc: Arc) -> list[OrbitEvent]:
    left, right = (
        Sample.of(point.arclength, [test.at(point) for test in tests])
        for point in (arc.left, arc.right)
    )
    return find_events(tests, arc, Stretch(left, right))[0]


def _causes(left: OrbitPoint, right: OrbitPoint, change: Change) -> list[str]:
    """The kinds of events of which one at least lies where a status changes between two points."""
    if change is Change.PHYSICALITY:
        finding = int(_unphysical_point(left, right).evaluation.numbers[-6])
        return [name for name in KINDS if kind_of(name).finding == finding]
    return [kind for kinds in _causes_by_multiplier(left, right) for kind in kinds]


def _causes_by_multiplier(left: OrbitPoint, right: OrbitPoint) -> list[list[str]]:
    """The kinds of events of which one lies between two points, for each multiplier that passes the
    unit circle there; that of a pair passes two.

    Two that meet on the real axis and leave it, or come back, pass nothing there: above 1 and below
    -1 an odd number tells that one has passed, and all together how many more have.
    """
    moved = np.subtract(_count_outside(left), _count_outside(right))
    passed = [value for value, number in zip((1.0, -1.0), moved, strict=False) if number % 2]
    one, other, pairs = (_kinds_at(value) for value in (1.0, -1.0, None))
    more = abs(sum(moved)) - len(passed)
    return [*map(_kinds_at, passed), *[[*pairs, *one, *other]] * more]


def _kinds_at(multiplier: float | None) -> list[str]:
    return [name for name in KINDS if kind_of(name).passed(multiplier)]


def _count_outside(point: OrbitPoint) -> tuple[int, int, int]:
    """How many multipliers lie beyond 1, beyond -1, and off the real axis outside the circle."""
    values = point.evaluation.multipliers
    real, outside = values.imag == 0.0, np.abs(values) > 1.0 + UNIT_CIRCLE_ROUNDING
    sides = real & (values.real > 0.0), real & (values.real < 0.0), ~real
    above, below, pairs = (int(np.count_nonzero(outside & side)) for side in sides)
    return above, below, pairs


def _unphysical_point(left: OrbitPoint, right: OrbitPoint) -> OrbitPoint:
    """The one of two points at which the orbit is unphysical."""
    return left if not left.evaluation.verdict.physical else right


def _missed_change(kind: str, arc: Arc, change: Change) -> MissedEvent:
    left, right = arc.left, arc.right
    if change is Change.PHYSICALITY:
        verdict = _unphysical_point(left, right).evaluation.verdict
        what = f"the orbit turns unphysical there ({verdict.reason})"
    else:
        counts = left.evaluation.n_unstable, right.evaluation.n_unstable
        what = f"the number of unstable multipliers changes from {counts[0]} to {counts[1]} there"
        if counts[0] == counts[1]:
            what = "one multiplier leaves the unit circle there and another one enters it"
    reason = f"{what}, but no event that explains it was located"
    span = right.arclength - left.arclength
    if span <= CLOSED_IN * (1.0 + right.arclength):
        remedy = "its place is closed in to rounding: smaller steps tell no more"
    else:
        remedy = "a smaller max_step may tell"
    ends = left.parameter, right.parameter
    return MissedEvent(kind, ends, f"{reason}; {remedy}", right.arclength)


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
        meeting=crossing_near,
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


# Where branches of free period end: at equilibria, and where periods or rounding errors grow.

LOST = 1e-9
"""A part of the orbit's size to which flights have amplified the rounding of their unknowns."""

GROWTH = 10.0
"""Factor by which these do not grow from a point to the next: by 2.03 at most on some 2,200 points
of three systems, where the period of one grows without bound."""

STILL = 1e-13
"""A change of the parameter within a step, as part of it, with which its value is known."""

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
        longer = here.span > before.evaluation.span
        self.shortest = min(self.shortest, here.span)
        longer = longer and here.span > LONG * self.shortest
        step = point.parameter - before.parameter
        still = before is not point and abs(step) < STILL * abs(point.parameter)
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
            what = f"{problem.parameter} changes no more"
            if lost:
                what = f"the rounding errors of so long a flight to {error:.1g}"
                if isinstance(problem, FreeQuietProblem):
                    what += " (two modes of its law, with guards at v = 0, would divide it)"
            return End.of(EndKind.FOR_EVER, *at, **told, what=what), point
        return (End.of(EndKind.ROUNDING, *at, **told), point) if lost else None
