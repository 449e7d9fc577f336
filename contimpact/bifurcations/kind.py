"""What a kind of event must provide, and the start of a branch that is born at one.

A kind has no state; what belongs to one branch is kept by its test function. To be given: `name`,
and `test`. Everything else has a default, that of an event which is only recorded: it is located
by bracketing, nothing changes and nothing is born there, and no multiplier or touch is set aside
when its orbit is judged.
"""

from __future__ import annotations

import enum
import functools
import importlib
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ..arrays import Array
from ..continuation.branch import (
    Details,
    EndKind,
    Evaluation,
    MissedEvent,
    Point,
    Points,
    TestFunction,
    Walk,
)
from ..continuation.corrector import Arc, border_jacobian, first_tangent, orient_vector
from ..continuation.events import find_events
from ..continuation.settings import Settings
from ..continuation.sign_changes import Sample, Stretch
from ..continuation.walk import SAME_SOLUTION
from ..models.guards import Word, repetitions
from ..orbits.problem import Linearisation, OrbitProblem, rounding
from ..orbits.search import first_lap, reduce_period
from ..orbits.status import PHYSICAL, UNIT_CIRCLE_ROUNDING, Verdict, count_unstable
from .declarations import FILES, KINDS, unknown_kind
from .equations import Equations as Equations
from .equations import System as System
from .extended_system import (
    FIRST_ORDER,
    ExtendedSystem,
    OrbitEvent,
    OrbitPoint,
    is_near,
    rounding_of_product,
)

# Where a branch begins that is born at an event of another one.

ALONG, REPEATS = 1e-3, 1e-7
"""How far along a branch it is seen whether its orbits repeat shorter ones, and how nearly."""


@dataclass(frozen=True)
class Start:
    """Where a branch begins, on the problem of the new word, and which way it leaves.

    The tangent is not normalised; at a G it points to where the touch is a physical impact.
    `branching` says whether the start is a branch point of the new problem, `both_ways` whether
    both directions lead to different orbits, and `note` what a reader should know of the branch.
    """

    problem: OrbitProblem
    unknowns: Array
    tangent: Array
    branching: bool
    both_ways: bool
    note: str = ""

    def reversed(self) -> Start:
        """Return the start the other way."""
        return replace(self, tangent=-self.tangent)


def null_vector_start(problem: OrbitProblem, unknowns: Array) -> Start | None:
    """Return the start along the null vector of the Jacobian; None where it is not regular."""
    here = problem.evaluate(unknowns)
    tangent = first_tangent(problem, here.jacobian, here.sizes[1])
    return (
        None if tangent is None else Start(problem, unknowns, orient_vector(tangent), False, True)
    )


BESIDE, ATTEMPTS = 1e-4, 5
"""How far from an event the orbits beside it are, in natural sizes, far beyond rounding, and in how
many steps of Newton's they are reached."""


def orbits_beside(
    here: Linearisation, sides: Iterable[float] = (1.0, -1.0), known: Sequence[Linearisation] = ()
) -> Iterator[Linearisation]:
    """Yield the orbits of the branch in the first parameter on both sides of a point, those that
    are reached: where the parameter is larger first, or smaller.

    Depths of touches go with the square of the distance, so that they are corrected far below that.
    Where branches cross, or nearly, orbits `known` on both sides tell which one is followed.
    """
    problem, last = here.problem, here.problem.n + 1
    units, columns = here.sizes[0], here.sizes[1][:last]
    _, sizes, right = np.linalg.svd(here.jacobian[:, :last] * columns / units[:, None])
    kernel, along = right[np.count_nonzero(sizes > BESIDE * sizes[0]) :], right[-1]
    chord = (known[-1].unknowns - known[0].unknowns)[:last] / columns if known else np.zeros(last)
    if len(kernel) > 1 and np.any(chord):  # other branches may be as near as what is looked for
        along = kernel.T @ (kernel @ chord)
        along = along / np.linalg.norm(along)
    elif not sizes[-1] > 1e-10 * sizes[0]:
        return
    along = math.copysign(1.0, along[-1]) * along
    for side in sides:
        unknowns = here.unknowns.copy()
        unknowns[:last] += side * BESIDE * columns * along
        try:
            for _ in range(ATTEMPTS):
                there = problem.evaluate(unknowns)
                off = there.residual / units
                if np.max(np.abs(off)) < BESIDE**3:
                    break
                matrix = there.jacobian[:, :last] * columns / units[:, None]
                step = np.linalg.solve(border_jacobian(matrix, along), np.append(off, 0.0))
                unknowns = unknowns.copy()
                unknowns[:last] -= columns * step
            if np.max(np.abs(off)) < BESIDE**2:
                yield there
        except (ArithmeticError, ValueError):
            continue


def rate_error(start: Start) -> float:
    """Bound the error of the parameter's rate along the tangent of a regular start.

    The tangent is what the Jacobian maps to zero, up to the rounding of both and to where the start
    is: what these move the parameter's component by, at most, is its row of the inverse of the
    Jacobian, bordered by the tangent, against them.
    """
    problem, along = start.problem, start.tangent
    here = problem.evaluate(start.unknowns)
    bounds = rounding(here)
    off = np.abs(here.residual) + bounds.residual
    try:
        inverse = np.abs(np.linalg.inv(border_jacobian(here.jacobian, along)))[:, :-1]
    except np.linalg.LinAlgError:
        return float("inf")
    bent = np.abs(problem.second_along(start.unknowns, along)) @ (inverse @ off)
    product = rounding_of_product(here.jacobian, bounds.jacobian, along)
    return FIRST_ORDER * float(inverse[-1] @ (product + bent))


def primitive_start(start: Start) -> Start:
    """Return a start whose branch is one of shorter orbits run several times as one of these.

    So it is where an orbit of several periods touches in each of them, and where one becomes an
    orbit of a shorter period.
    """
    problem, unknowns, tangent = start.problem, start.unknowns, start.tangent
    # at touches impacts are at rest, and tell no unit of velocities
    sizes = problem.scale(unknowns, problem.natural_units(unknowns)[problem.n :])
    ahead = unknowns + ALONG * tangent / np.max(np.abs(tangent / sizes))
    shorter, _ = reduce_period(problem, ahead, REPEATS)
    if shorter is problem:
        return start
    longer, repeated = (p.word.notation(p.model.letters) for p in (problem, shorter))
    note = f"the {longer} orbits born there are {repetitions([repeated])}, and followed as such"
    impacts = len(shorter.word)
    unknowns, tangent = (first_lap(problem, z, impacts) for z in (unknowns, tangent))
    return Start(shorter, unknowns, tangent, False, True, note)


"""Where on its orbit an event happens: ``flight``, ``wall``, ``touch_time``, ``impact``,
``requested``, as far as they apply."""

Values = Mapping[str, Sequence[float]]
"""Values to hit, by the name of a parameter."""

SUPER, SUB = "supercritical", "subcritical"


class Change(enum.Enum):
    """What changes along a branch at an event."""

    STABILITY = "the number of unstable multipliers"
    PHYSICALITY = "whether the orbit is physical"


@dataclass(frozen=True)
class Look:
    """How pictures show a kind: the marker of its events, and colour, width and hatch of its
    curves."""

    marker: str = "P"
    colour: str = "0.3"
    width: float = 1.2
    hatch: str | None = None


class CurvePoint(Evaluation, Protocol):
    """A point of a curve: its orbit, what its equations add, and where on the orbit it happens."""

    @property
    def orbit(self) -> Linearisation: ...
    @property
    def own(self) -> Array: ...
    @property
    def details(self) -> Details: ...


# What is seen beyond an event.


@dataclass(frozen=True)
class Window:
    """Where an orbit with one impact at the touch in several cycles is stable."""

    cycles: int
    notation: str
    low: float | None = None
    high: float | None = None
    """`low`, `high`: range of the parameter, to leading order; None where it has no end that the
    model admits."""


@dataclass(frozen=True)
class Scenario:
    """What is seen beyond a grazing, to leading order in the distance from it."""

    name: str
    reason: str | None = None
    """Why it is not decided."""
    trace: float | None = None
    determinant: float | None = None
    """`trace`, `determinant`: of the cycle, the touch left out."""
    coefficient: float | None = None
    """kappa: a gap y < 0 becomes kappa sqrt(-y) a cycle later."""
    rate: float | None = None
    """Derivative of the orbit's gap by the parameter."""
    windows: tuple[Window, ...] = ()
    """The first ones beyond the grazing, that of the fewest cycles first; of a jump, the orbits on
    which it may end, stable on both sides of the grazing."""


class Kind(ABC):
    """A kind of event on branches of periodic orbits."""

    name: str
    """As scenes and catalogues have it."""
    changes: Change | None = None
    """What changes along a branch there as a rule."""
    finding: int | None = None
    """Why orbits beyond it are unphysical: a finding of `contimpact.orbits.status`."""
    multiplier: float | None = None
    """The value of a multiplier there."""
    crossing: bool = False
    """Whether branches cross there: the catalogue keeps the branch's direction."""
    needed: tuple[str, ...] = ()
    """Keys of its details without which an entry cannot be restored."""
    tilde: bool = True
    """Whether the labels of ghosts are marked."""
    shorter_at: tuple[str, ...] = ()
    """Points of codimension two on the orbit's curve of PD at which curves of this kind of doubled
    orbits may become the orbit itself."""
    auto: int = -4
    """AUTO-07p's code for it; -4 is its code for a value asked for."""
    look: Look = Look()

    # Finding it.

    @abstractmethod
    def test(self, problem: OrbitProblem, values: Values) -> TestFunction[Linearisation]:
        """Return its test function on the branches of a problem."""

    def equations(self, problem: OrbitProblem, details: Details) -> ExtendedSystem | None:
        """Return its exact equations at a place of the orbit, in one free parameter or two."""
        return None

    def places(self, here: Linearisation) -> list[Details]:
        """Return the details of the places at which it may happen on an orbit and those nearby."""
        if self.changes is not Change.PHYSICALITY:
            return [{}]
        test = self.test(here.problem, {})
        point = Point(here, np.full(len(here.unknowns), np.nan), np.nan, 0.0, 0)
        values = test.values(point)
        found = np.nonzero(np.isfinite(values[: len(values) - test.guides]))[0]
        return [test.details(point, place) for place in found.tolist()]

    def in_many_digits(self, orbit: Equations, unknowns: Array, details: Details) -> System | None:
        """Return its equations in many digits; None for a kind that reports do not confirm."""
        return None

    # What happens there.

    def born(self, event: OrbitEvent) -> Start | None:
        """Return the start of the branch born there; None where nothing can start."""
        return None

    def next_word(self, event: OrbitEvent) -> Word | None:
        """Return the word of the branch beyond, if it is another one."""
        return None

    def deeper(self, event: OrbitEvent) -> int | None:
        """Return how many switches deeper the branch is that starts there: 0 where the motion
        itself continues on another word; None where nothing can start."""
        return 1

    def continues(self, event: OrbitEvent) -> bool:
        """Whether the motion itself continues on the branch that starts there."""
        return self.deeper(event) == 0

    def nothing(self, event: OrbitEvent) -> str:
        """Return why nothing starts there."""
        return "nothing starts there"

    def criticality(
        self, event: OrbitEvent, before: OrbitPoint, after: OrbitPoint
    ) -> tuple[str | None, float | None]:
        """Return on which side the new branch lies, and at what slope, as far as it can be
        decided.

        `before` and `after` are the branch's points around the event.
        """
        return None, None

    def explains(self, change: Change) -> bool:
        """Whether such a change beside an event of this kind needs no other."""
        return self.changes is change

    def passed(self, multiplier: float | None) -> bool:
        """Whether an event of this kind is missing where a multiplier has passed the unit circle;
        None stands for pairs of them."""
        if self.multiplier is None or multiplier is None:
            return False
        return (multiplier > 0.0) == (self.multiplier > 0.0)

    def sliding(self, event: OrbitEvent) -> str | None:
        """Return which sliding bifurcation it is, if it is one."""
        return None

    def scenario(self, event: OrbitEvent) -> Scenario | None:
        """Return what is seen beyond, to leading order, if an observable orbit ends there."""
        return None

    # Whether it is a ghost, and what it is called.

    def critical(self, multipliers: Array) -> list[int]:
        """Return the places of the multipliers that the event itself puts on the unit circle."""
        if self.multiplier is None:
            return []
        return [int(np.argmin(np.abs(multipliers - self.multiplier)))]

    def is_on_circle(self, here: Linearisation) -> bool:
        """Whether an orbit has the multiplier that an event of this kind needs, if it needs one:
        its equations are also solved where an impact leaves no trace."""
        return self.multiplier is None or is_near(
            here, here.multipliers, self.multiplier, known=True
        )

    def multipliers(
        self, here: Linearisation, details: Details, beside: Sequence[Linearisation] = ()
    ) -> tuple[Array, int]:
        """Return the orbit's multipliers, and how many outside the unit circle are not the
        event's. `beside` are orbits of its branch on both sides."""
        own = self.critical(here.multipliers)
        others = np.delete(here.multipliers, own)
        if self.multiplier is not None:
            # rounding splits a double multiplier by its root, but leaves the product
            double = np.abs(others - self.multiplier) < math.sqrt(UNIT_CIRCLE_ROUNDING)
            split = here.multipliers[own[0]] / self.multiplier
            others[double] *= split
        return here.multipliers, int(count_unstable(others))

    def verdict(self, here: Linearisation, details: Details) -> Verdict:
        """Return the verdict on the orbit, the event itself not held against it."""
        return here.verdict

    def verdict_on_branch(
        self,
        here: Linearisation,
        details: Details,
        known: Sequence[Linearisation] = (),
        sides: list[float] | None = None,
    ) -> Verdict:
        """As `verdict`, but an orbit counts as unphysical where those of its branch are on both
        sides: what they violate may all vanish at the event. `known` are orbits beside it; `sides`,
        1 and -1 in the order in which to look there, is put in that which would have done here."""
        found = self.verdict(here, details)
        if not found.physical or self.changes is not Change.PHYSICALITY:
            return found
        if any(orbit.verdict.physical for orbit in known):
            return found
        reasons: list[str] = []
        sides = [1.0, -1.0] if sides is None else sides
        for there in orbits_beside(here, tuple(sides), known):
            if there.verdict.physical:
                if reasons:
                    sides.reverse()
                return found
            reasons.append(str(there.verdict.reason))
        if len(reasons) < 2:
            return found
        reasons = reasons[:: int(sides[0])]
        reason = f"orbits beside it are not physical: {' and '.join(reasons)}"
        return replace(found, physical=False, reason=reason)

    def label(self, ghost: bool, word: Word, beyond: Word | None, walls: Sequence[str]) -> str:
        """Return the label of an event: ``~G[2:1->2:2]``."""
        mark = "~" if ghost and self.tilde else ""
        if beyond is None:
            return mark + self.name
        return f"{mark}{self.name}[{word.notation(walls)}->{beyond.notation(walls)}]"

    def symbol(self, period: int) -> str:
        """Return its name in pictures, on orbits of this many forcing periods: ``PD_G``."""
        return self.name

    # Its curves in two parameters.

    def curve_limits(self) -> Mapping[EndKind, TestFunction[CurvePoint]]:
        """Return test functions of a curve's points at whose zeros it ends, by how it ends."""
        return {}

    def curve_end(self, own: Array) -> EndKind | None:
        """Return how a curve ends at a point, by the unknowns its equations add, if it does."""
        return None

    def codimension_two(self, word: Word) -> list[TestFunction[CurvePoint]]:
        """Return test functions of a curve's points for the points of codimension two on it."""
        return []


def declared(**_said: bool | int) -> Callable[[type], type]:
    """Return the decorator that declares a kind: the fields of `KindDeclaration` from `place` on.

    Declarations are read from the files' texts, and nothing else is done with them. The decorator
    is the line above the class, which has the kind's name.
    """
    return lambda kind: kind


# Kinds by their names: the package's, and those of a user's own.


class UnknownKind(Kind):
    """An event of which only the name is known: that of a user's function."""

    tilde = False

    def __init__(self, name: str) -> None:
        self.name = name

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction[Linearisation]:
        raise unknown_kind(self.name, "events")


def kind_of(name: str) -> Kind:
    """Return a kind by its name.

    A kind that is not declared is found by its class, once that is imported; one defined anew, as
    in a notebook, takes the place of the earlier one.
    """
    if name in FILES:
        return _load_kind(name)
    own = [kind for kind in subclasses_of(Kind) if getattr(kind, "name", None) == name]
    return own[-1]() if own else UnknownKind(name)


def names_of_own_kinds() -> Iterator[str]:
    """Yield the names of the kinds that are not declared."""
    names = (getattr(kind, "name", None) for kind in subclasses_of(Kind))
    return (name for name in names if name and name not in FILES)


@functools.cache
def _load_kind(name: str) -> Kind:
    kind: Kind = getattr(importlib.import_module(f".{FILES[name]}", __package__), name)()
    return kind


def subclasses_of(kind: Any) -> Iterator[Any]:
    """Yield all subclasses, in the order of their definition."""
    for one in kind.__subclasses__():
        yield one
        yield from subclasses_of(one)


def test_functions(
    problem: OrbitProblem, kinds: Sequence[str], values: Values
) -> list[TestFunction[Linearisation]]:
    """Return the test functions of the kinds asked for; nothing else is evaluated.

    Raises InputError for a kind that does not exist, or a requested value of what does not vary.
    """
    return [kind_of(kind).test(problem, values) for kind in dict.fromkeys(kinds)]


test_functions.__test__ = False  # type: ignore[attr-defined]


def switch(event: OrbitEvent) -> Start | None:
    """Return the start of the branch born at an event of a kind in `SWITCHES`; None where nothing
    can start: a dropped impact was the only one, or the tangent is not defined (a degenerate
    event)."""
    return kind_of(event.kind).born(event)


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

LEAVING = (1e-8, 1e-6, 1e-4, 1e-2)
"""Fractions of the first step at which a point is tried that tells how a walk leaves an event."""

ON_CIRCLE = 1e-6
"""A multiplier nearer to the unit circle than this, so near to an event, tells nothing."""

TURNING = 1e5
"""Nor does one so much larger than at the first point: it passes infinity where an impact is at
rest, on a side that the residual of the point may decide."""

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
    turn, around = np.inf, [point.unknowns for point in (walk.points[0], walk.points[-1])]
    if walk.end.kind is EndKind.CLOSED and problem.apart(*around) < SAME_SOLUTION:
        turn = walk.points[-1].arclength
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
    for fraction in LEAVING:
        beside = arc.at(fraction)
        if beside is None or not arc.left.arclength < beside.arclength < first.arclength:
            continue
        sizes = np.abs(beside.evaluation.multipliers)
        told = np.max(sizes) < TURNING * np.max(np.abs(first.evaluation.multipliers))
        if told and np.all(np.abs(sizes - 1.0) > ON_CIRCLE):
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
    inside = [event for event in events if _lies_between(event, *ends, turn)]
    between = [event.kind for event in inside]
    if any(all(map(kind_of(kind).explains, Change)) for kind in between):
        return []
    lacking: list[str] = []
    for kinds in _causes_by_multiplier(left, right, sum(map(_inverts, inside))):
        found = next((kind for kind in between if kind in kinds), None)
        if found is None:
            lacking += [kind for kind in kinds if kind in asked][:1]
        elif not kind_of(found).passed(None):
            between.remove(found)
    return list(dict.fromkeys(lacking))


INFINITE = 1e9
"""Size of a multiplier that passes infinity at an event, to rounding."""


def _inverts(event: OrbitEvent) -> bool:
    """Whether a multiplier passes infinity at an event, and changes its sign: where an impact is at
    rest, unless the contact is soft."""
    return bool(np.any(np.abs(event.point.evaluation.multipliers) > INFINITE))


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
    if change is Change.STABILITY and _is_closed_in(arc):
        lacking = [kind for kind in lacking if kind in _critical_kinds(arc)]
    return [], [_missed_change(kind, arc, change) for kind in lacking[:1]]


def _is_closed_in(arc: Arc) -> bool:
    return arc.right.arclength - arc.left.arclength <= CLOSED_IN * (1.0 + arc.right.arclength)


def _critical_kinds(arc: Arc) -> Collection[str]:
    """The kinds of those multipliers that are on the unit circle at an arc closed in to rounding;
    all where none is, as where they jump."""
    near = [m for m in arc.left.evaluation.multipliers.tolist() if abs(abs(m) - 1.0) < ON_CIRCLE]
    values = {None if abs(m.imag) > ON_CIRCLE else math.copysign(1.0, m.real) for m in near}
    found = {kind for value in values for kind in _kinds_at(value)}
    rates = arc.left.tangent[-1], arc.right.tangent[-1]
    flat = ON_CIRCLE * (abs(arc.right.parameter) or 1.0)
    if rates[0] * rates[1] > 0.0 and min(map(abs, rates)) > flat:  # there is no fold
        found -= {kind for kind in _kinds_at(1.0) if not kind_of(kind).crossing}
    return found if near else KINDS


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


def _causes_by_multiplier(left: OrbitPoint, right: OrbitPoint, turned: int = 0) -> list[list[str]]:
    """The kinds of events of which one lies between two points, for each multiplier that passes the
    unit circle there; that of a pair passes two. So often one is `turned`: it passes infinity and
    changes its sign.

    Two that meet on the real axis and leave it, or come back, pass nothing there: above 1 and below
    -1 an odd number tells that one has passed, and all together how many more have. Where none is
    real outside the circle on one side alone, those are pairs.
    """
    moved = np.subtract(_count_outside(left), _count_outside(right))
    sides = zip((1.0, -1.0), moved, strict=False)
    passed = [value for value, number in sides if (number + turned) % 2]
    one, other, pairs = (_kinds_at(value) for value in (1.0, -1.0, None))
    more = abs(sum(moved)) - len(passed)
    either = [*pairs, *one, *other] if any(moved[:2]) else pairs
    return [*map(_kinds_at, passed), *[either] * more]


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
    if _is_closed_in(arc):
        remedy = "its place is closed in to rounding: smaller steps tell no more"
    else:
        remedy = "a smaller max_step may tell"
    ends = left.parameter, right.parameter
    return MissedEvent(kind, ends, f"{reason}; {remedy}", right.arclength)
