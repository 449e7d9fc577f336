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
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..continuation.branch import Details, EndKind, Evaluation, Event, Point, TestFunction
from ..continuation.corrector import border_jacobian, first_tangent, log_determinant, orient_vector
from ..models.word import Word, repetitions
from ..orbits.problem import Linearisation, OrbitProblem, rounding
from ..orbits.quiet import problem_of
from ..orbits.search import first_lap, reduce_period
from ..orbits.status import (
    UNIT_CIRCLE_ROUNDING,
    Verdict,
    count_unstable,
    neimark_sacker,
    pair_on_circle,
    products_of,
)
from ..segments.flight import Touch
from .declarations import FILES, unknown_kind
from .equations import Equations as Equations
from .equations import System as System
from .extended_system import (
    FIRST_ORDER,
    ExtendedSystem,
    OrbitEvent,
    OrbitPoint,
    rounding_of_product,
)

if TYPE_CHECKING:
    from .extended_system import ExtendedSystem

    Leaves: TypeAlias = Callable[[ExtendedSystem, Array], tuple[Array, Array]]


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
many steps with the event's Jacobian they are reached."""


def orbits_beside(
    here: Linearisation, sides: Iterable[float] = (1.0, -1.0)
) -> Iterator[Linearisation]:
    """Yield the orbits of the branch in the first parameter on both sides of a point, those that
    are reached: where the parameter is larger first, or smaller."""
    problem, last = here.problem, here.problem.n + 1
    units, columns = here.sizes[0], here.sizes[1][:last]
    left, sizes, right = np.linalg.svd(here.jacobian[:, :last] * columns / units[:, None])
    if not sizes[-1] > 1e-10 * sizes[0]:
        return
    inverse = columns[:, None] * right[:-1].T / sizes @ (left.T / units)
    along = math.copysign(BESIDE, right[-1, -1]) * columns * right[-1]
    for side in sides:
        unknowns = here.unknowns.copy()
        unknowns[:last] += side * along
        try:
            for _ in range(ATTEMPTS):
                there = problem.evaluate(unknowns)
                if np.max(np.abs(there.residual) / units) < BESIDE**2:
                    yield there
                    break
                unknowns = unknowns.copy()
                unknowns[:last] -= inverse @ there.residual
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


# What is seen beyond an event.


@dataclass(frozen=True)
class Window:
    """Where an orbit with one impact at the touch in several cycles is stable."""

    cycles: int
    notation: str
    low: float | None = None
    high: float | None = None
    """`low`, `high`: range of the parameter, to leading order; None where it has no end."""


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
    shorter_at: tuple[str, str] | None = None
    """Where its curves of doubled orbits become the orbit itself: the kind whose curve they meet,
    and the point of codimension two on it."""
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
        return [{}]

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

    def multipliers(self, here: Linearisation, details: Details) -> tuple[Array, int]:
        """Return the orbit's multipliers, and how many outside the unit circle are not the
        event's."""
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
        known: Iterable[Linearisation] = (),
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
        for there in orbits_beside(here, tuple(sides)):
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
        names = (getattr(kind, "name", None) for kind in _subclasses(Kind))
        raise unknown_kind(self.name, "events", (name for name in names if name))


def kind_of(name: str) -> Kind:
    """Return a kind by its name.

    A kind that is not declared is found by its class, once that is imported; one defined anew, as
    in a notebook, takes the place of the earlier one.
    """
    if name in FILES:
        return _load_kind(name)
    own = [kind for kind in _subclasses(Kind) if getattr(kind, "name", None) == name]
    return own[-1]() if own else UnknownKind(name)


@functools.cache
def _load_kind(name: str) -> Kind:
    kind: Kind = getattr(importlib.import_module(f".{FILES[name]}", __package__), name)()
    return kind


def _subclasses(kind: type) -> Iterator[type[Kind]]:
    """All subclasses, in the order of their definition."""
    subclasses: Sequence[type[Kind]] = kind.__subclasses__()
    for one in subclasses:
        yield one
        yield from _subclasses(one)


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


# Points of codimension two on curves of events, and where curves start.
#
# ====== ============ ======================================================================
# kind   on           test function
# ====== ============ ======================================================================
# FB-G.. FB, BP, PD   smallest interior gap of each flight and wall: the orbit also grazes
# ..-V   FB, BP, PD   velocity of each impact
# G-PD   G, V         determinant of C(-1) of the orbit that grazes
# G-FB   G, V         determinant of C(1) of the orbit that grazes (the old branch folds), and
#                     parameter rate of the branch with one impact more (its fold is born)
# DG     G, V         acceleration at the touch
# R1, R2 FB, PD       product of the critical multiplier and another minus one: two at 1, or at -1,
#                     with one eigenvector
# FB-BP, FB, PD       the same with an eigenvector of its own for each
# PD-PD
# FB-PD, FB, PD, NS   product of the distances of the multipliers not critical from -1 or 1:
# ..-FB, (m > 2)      both happen at once, as in the fold-flip
# NS-PD
# ..-NS  FB, PD, NS   products of two multipliers that are not critical, minus one
# ====== ============ ======================================================================
#
# Those of one kind alone stand with it: CP in `fold`, GPD in `doubling`. They are located by
# bracketing along the curve, whose points solve its equations to rounding.


@dataclass(frozen=True)
class CurveStart:
    """An orbit at a point of codimension two, as one of a curve that begins there or passes."""

    kind: str
    """Kind of the curve."""
    here: Linearisation
    """The orbit, with two free parameters."""
    details: Details = field(default_factory=dict)
    """Place on the orbit at which it happens."""
    leaves: Leaves | None = None
    """``leaves(system, own) -> (orbit, own)``: where other solutions of the curve's equations cross
    it: the direction of the curve, in the orbit's unknowns and in those that the equations add,
    given the equations and the latter. Without it the solutions are one curve."""


def double_orbit(here: Linearisation) -> Linearisation:
    """Return an orbit run twice, as one of the doubled word."""
    problem = here.problem
    rows, span = problem.impacts(here.unknowns), here.span
    later = rows.copy()
    later[:, 0] += span
    word = Word(problem.word.walls * 2, problem.word.period * 2)
    doubled = problem_of(problem.model, word, problem.kernels)
    both = np.vstack([rows, later])
    return doubled.evaluate(doubled.with_impacts(both, 2.0 * span, here.unknowns))


MARKERS = {
    "PD-G": "o",
    "G-FB": "^",
    "CP": "v",
    "GPD": "s",
    "DG": "D",
    "FB-G": "p",
    "FB-V": "X",
    "PD-V": "*",
    "R1": "<",
    "R2": ">",
    "FB-BP": "d",
    "PD-PD": "1",
    "R3": "$3$",
    "R4": "$4$",
    "BP-G": "x",
    "BP-V": "+",
    "FB-PD": "h",
    "FB-NS": "H",
    "PD-NS": "8",
    "BP-PD": "2",
    "BP-NS": "3",
}
"""Markers of the points in pictures."""

OTHER_NAMES = {
    "G-PD": "PD-G",
    "PD-FB": "FB-PD",
    "NS-FB": "FB-NS",
    "NS-BP": "BP-NS",
    "NS-PD": "PD-NS",
}
"""Points that are seen from the curves of both kinds, and their names on the other one."""


class CurvePoint(Evaluation, Protocol):
    """A point of a curve: its orbit, what its equations add, and where on the orbit it happens."""

    @property
    def orbit(self) -> Linearisation: ...
    @property
    def own(self) -> Array: ...
    @property
    def details(self) -> Details: ...


class CurveTest(TestFunction[CurvePoint]):
    """A test function of the points of a curve, with a sentence on what changes at its zeros."""

    changes: str = ""
    pole: str = ""
    """Name of a kind at whose events the function has a pole, or none but for rounding."""

    def values(self, point: Point[CurvePoint]) -> Array:
        try:
            return np.atleast_1d(np.array(self.of(point.evaluation), dtype=float))
        except (ArithmeticError, np.linalg.LinAlgError):
            return np.array([np.nan])

    @abstractmethod
    def of(self, here: CurvePoint) -> ArrayLike:
        """Return the values, as a number or a sequence."""

    def details(self, point: Point[CurvePoint], index: int) -> Details:
        return {"index": index, "changes": self.changes}

    def other(self, here: CurvePoint, index: int) -> tuple[str, Details] | None:
        """Return the kind of event that happens there besides the curve's, and where on the orbit.

        None where it is no event of the same orbit: its value is then all there is to solve.
        """
        return None

    def born(self, here: CurvePoint, index: int) -> list[CurveStart]:
        """Return the curves of other kinds, or of other orbits, that start there or pass."""
        other = self.other(here, index)
        return [] if other is None else [CurveStart(other[0], here.orbit, other[1])]


# On curves of smooth bifurcations.


class GrazingCoincides(CurveTest):
    """The bifurcating orbit touches a wall."""

    def __init__(self, kind: str) -> None:
        self.kind = f"{kind}-G"
        self.changes = (
            f"the {kind} and a grazing happen on the same orbit: beyond, the orbit is unphysical "
            f"at the {kind}, which becomes a ghost"
        )

    def of(self, here: CurvePoint) -> ArrayLike:
        return [np.nan if t is None else t.gap for t in self.touches(here)]

    @staticmethod
    def touches(here: CurvePoint) -> list[Touch | None]:
        return [t for flight in here.orbit.gaps for t in flight.touches]

    def other(self, here: CurvePoint, index: int) -> tuple[str, Details] | None:
        touch = self.touches(here)[index]
        if touch is None:
            return None
        return "G", {"flight": touch.flight, "wall": touch.wall, "touch_time": touch.time}


class StopCoincides(CurveTest):
    """An impact of the bifurcating orbit loses its velocity."""

    def __init__(self, kind: str) -> None:
        self.kind = f"{kind}-V"
        self.changes = (
            f"an impact loses its velocity on the orbit of the {kind}: beyond, it runs the wrong "
            "way"
        )

    def of(self, here: CurvePoint) -> ArrayLike:
        return here.orbit.problem.impacts(here.orbit.unknowns)[:, 1]

    def other(self, here: CurvePoint, index: int) -> tuple[str, Details]:
        return "V", {"impact": index}


ONE_EIGENVECTOR = 1e-6
"""Second smallest singular value of C(mu), beside the largest, above which a double multiplier mu
has one eigenvector."""


class Resonance(CurveTest):
    """A second multiplier joins the critical one, 1 or -1, and has no eigenvector of its own: only
    then do the two leave the real axis as a pair, and a curve of NS begins."""

    noise = 1e-9  # without damping and losses the product is one everywhere, within rounding

    def __init__(self, kind: str, multiplier: float) -> None:
        self.kind, self.multiplier = kind, multiplier
        self.changes = f"two multipliers are {multiplier:.0f}: a curve of NS begins"

    def of(self, here: CurvePoint) -> ArrayLike:
        """Of products with the critical one alone: two others may be a pair of their own."""
        values = here.orbit.multipliers
        critical = int(np.argmin(np.abs(values - self.multiplier)))
        with np.errstate(invalid="ignore"):  # of infinite ones, where an impact is at rest
            return neimark_sacker(values[critical] * np.delete(values, critical))

    def enters(self, point: Point[CurvePoint], index: int) -> bool:
        """Where an impact is at rest, multipliers pass through infinity."""
        return point.evaluation.orbit.unbounded

    def accept(self, event: Event[CurvePoint]) -> bool:
        """Whether there is one eigenvector."""
        orbit = event.point.evaluation.orbit
        matrix = orbit.cyclic(self.multiplier)[:, : orbit.problem.n]
        sizes = np.linalg.svd(matrix, compute_uv=False)
        return bool(sizes[-2] > ONE_EIGENVECTOR * sizes[0])

    def born(self, here: CurvePoint, index: int) -> list[CurveStart]:
        """The curve of NS."""
        return [CurveStart("NS", here.orbit)]


class SecondEigenvector(Resonance):
    """A second multiplier passes the critical one and has its own eigenvector: both stay real."""

    def __init__(self, kind: str, multiplier: float) -> None:
        super().__init__(kind, multiplier)
        self.changes = (
            f"a second multiplier passes {multiplier:.0f} with an eigenvector of its own, as where "
            "a curve of BP passes that of FB: no curve of NS begins"
        )

    def accept(self, event: Event[CurvePoint]) -> bool:
        """Whether there are two eigenvectors."""
        return not super().accept(event)

    def born(self, here: CurvePoint, index: int) -> list[CurveStart]:
        """Of other kinds none."""
        return []


class Coincides(CurveTest):
    """Other multipliers of the bifurcating orbit are critical, too."""

    def __init__(self, kind: Kind, event: str) -> None:
        self.own, self.event, self.kind = kind, event, f"{kind.name}-{event}"
        self.changes = f"{kind.name} and {event} happen on the same orbit: their curves cross"

    def others(self, here: CurvePoint) -> Array:
        multipliers = here.orbit.multipliers
        return np.delete(multipliers, self.own.critical(multipliers))

    def enters(self, point: Point[CurvePoint], index: int) -> bool:
        """Where an impact is at rest, multipliers pass through infinity."""
        return point.evaluation.orbit.unbounded

    def other(self, here: CurvePoint, index: int) -> tuple[str, Details] | None:
        return None if self.event == self.own.name else (self.event, {})


class MultiplierCoincides(Coincides):
    """Another multiplier is that of a kind; with two there is no other one, as their product is
    positive."""

    def of(self, here: CurvePoint) -> ArrayLike:
        others = self.others(here)
        others = others[np.isfinite(others)]
        if here.orbit.problem.m <= 2:
            return []
        mu = kind_of(self.event).multiplier or 0.0
        return float(np.prod((1.0 - mu * others) / (1.0 + np.abs(others))).real)

    def accept(self, event: Event[CurvePoint]) -> bool:
        """Of two kinds with one multiplier, that one at which branches cross, or do not."""
        orbit, kind = event.point.evaluation.orbit, kind_of(self.event)
        if kind.multiplier != 1.0:
            return True
        psi = orbit.singular_vectors(orbit.cyclic(1.0)[:, : orbit.problem.n])[0][-1]
        moved, most = np.abs(psi @ orbit.by_parameter), np.abs(psi) @ np.abs(orbit.by_parameter)
        return bool(np.all(moved < CROSSING * most)) == kind.crossing


CROSSING = 1e-6
"""Part of the size of what parameters change below which it is rounding."""


class PairCoincides(Coincides):
    """Another pair of multipliers is on the unit circle."""

    noise = Resonance.noise

    def __init__(self, kind: Kind) -> None:
        super().__init__(kind, "NS")

    def of(self, here: CurvePoint) -> ArrayLike:
        others = self.others(here)
        return neimark_sacker(products_of(others)) if len(others) > 1 else []

    def accept(self, event: Event[CurvePoint]) -> bool:
        """Two real multipliers with the product one are a neutral saddle."""
        return pair_on_circle(self.others(event.point.evaluation))


# On curves of orbits that touch a wall, seen from the shorter or from the longer word.

TouchPlace: TypeAlias = "Callable[[CurvePoint], tuple[int, str, float]]"
"""Gives the flight on which a point's orbit touches a wall, the wall, and the time since the flight
began."""


class DegenerateTouch(CurveTest):
    """The touch has no acceleration."""

    kind = "DG"
    changes = "the touch has zero acceleration: two touches of the flight are born or meet"

    def __init__(self, touch: TouchPlace) -> None:
        self.touch = touch

    def of(self, here: CurvePoint) -> ArrayLike:
        orbit, problem = here.orbit, here.orbit.problem
        flight, wall, since = self.touch(here)
        left, row = problem.leaving(orbit.unknowns, flight)
        return problem.kernels.gap_after(left, wall)(*row, since, *problem.values(orbit.unknowns))[
            2
        ]


SMALLEST = -700.0
"""Least logarithm of a determinant that is told from zero."""


def scaled_determinant(orbit: Linearisation, mu: float) -> float:
    """Return the determinant of C(mu) in natural sizes, which has the sign of its own."""
    n = orbit.problem.n
    free = mu == 1.0 and orbit.problem.autonomous  # C(1) is singular: of shifts in time
    matrix = orbit.jacobian if free else orbit.cyclic(mu)
    rows, sizes = orbit.sizes  # its own rows may vanish, as at rest
    sign, logarithm = log_determinant(matrix[:, :n] * sizes[:n] / rows[:, None])
    return sign * math.exp(max(logarithm, SMALLEST))


class TouchSingular(CurveTest):
    """A multiplier of the orbit, counted as one of a word, is mu."""

    def __init__(
        self, kind: str, changes: str, mu: float, counted: Callable[[CurvePoint], Linearisation]
    ) -> None:
        self.kind, self.changes, self.mu, self.counted = kind, changes, mu, counted

    def of(self, here: CurvePoint) -> ArrayLike:
        return scaled_determinant(self.counted(here), self.mu)

    def other(self, here: CurvePoint, index: int) -> tuple[str, Details] | None:
        same = self.counted(here) is here.orbit
        return (self.event, {}) if same else None

    @property
    def event(self) -> str:
        """The kind of event of which the orbit has the multiplier."""
        return "FB" if self.mu > 0.0 else "PD"

    def born(self, here: CurvePoint, index: int) -> list[CurveStart]:
        return [CurveStart(self.event, self.counted(here))]


class FoldBorn(TouchSingular):
    """The branch with the touch as an impact begins with a fold.

    The impact's velocity changes the parameter linearly along that branch, with a rate that is zero
    here. A contact that begins and ends at rest, as that of a soft stop or with a belt that takes
    the body along, changes it by the square of the velocity only, and so does an impact that is
    forgotten before the next one: then the rate is zero everywhere, and no fold is born by its
    change. An eigenvector of C(1) that moves nothing but what happens at the touch tells.
    """

    def __init__(self, touch: TouchPlace, longer: Callable[[CurvePoint], Linearisation]) -> None:
        changes = (
            "the fold of the new branch is born at the grazing: the grazing changes between "
            "supercritical and subcritical"
        )
        super().__init__("G-FB", changes, 1.0, longer)
        self.touch = touch

    def of(self, here: CurvePoint) -> ArrayLike:
        flight, _, since = self.touch(here)
        begin, _ = here.orbit.problem.times_around(here.orbit.unknowns, flight)
        if _leaves_no_trace(self.counted(here), begin + since):
            return np.nan
        acceleration = DegenerateTouch(self.touch).of(here)  # a factor, which is no fold's
        return np.sign(acceleration) * np.asarray(super().of(here))


NO_TRACE = 1e-7
"""Part of an equation's size below which what an impact at rest changes in it is rounding: times of
touches are known to the square root of rounding only."""
TOGETHER = 1e-6
"""Part of the period within which impacts happen at once."""


def _leaves_no_trace(orbit: Linearisation, time: float) -> bool:
    """Whether impacts at a time can move together, to the first order, so that no flight before or
    after them changes at its other end."""
    problem, unknowns, span = orbit.problem, orbit.unknowns, orbit.span
    apart = problem.impacts(unknowns)[: len(problem.word), 0] - time
    there = np.abs(apart - span * np.round(apart / span)) < TOGETHER * span
    (rows, sizes), moved = orbit.sizes, np.flatnonzero(np.repeat(there, problem.m))
    own = orbit.cyclic(0.0)
    around = orbit.cyclic(1.0) - own
    if problem.autonomous:  # the first impact is held in time, and all others move instead
        around[:, 0] = -own[:, : problem.n : problem.m].sum(axis=1)
    both = np.hstack([own[:, moved].T, around[:, moved].T]) / np.tile(rows, 2)
    return bool(np.linalg.norm(both * sizes[moved, None], -2) < NO_TRACE)


Counted: TypeAlias = Callable[["CurvePoint"], Linearisation]


def _remembering(counted: Counted) -> Counted:
    """A function that is asked twice for each point, and computes once."""
    last: list[tuple[CurvePoint, Linearisation]] = []

    def remembered(here: CurvePoint) -> Linearisation:
        if not last or last[0][0] is not here:
            last[:] = [(here, counted(here))]
        return last[0][1]

    return remembered


def touch_points(
    touch: TouchPlace,
    longer: Callable[[CurvePoint], Linearisation],
    shorter: Callable[[CurvePoint], Linearisation] | None,
) -> list[TestFunction[CurvePoint]]:
    """Return the test functions of a curve of orbits that touch a wall.

    `longer` and `shorter` give the orbit with the touch as an impact of its word, and without, None
    if no impact is left.
    """
    points: list[TestFunction[CurvePoint]] = [
        DegenerateTouch(touch),
        FoldBorn(touch, _remembering(longer)),
    ]
    if shorter is not None:
        shorter = _remembering(shorter)
        doubles = "the grazing orbit doubles its period here: the grazing is real on one side only"
        folds = "the branch that grazes folds at its grazing"
        points += [
            TouchSingular("G-PD", doubles, -1.0, shorter),
            TouchSingular("G-FB", folds, 1.0, shorter),
        ]
    return points
