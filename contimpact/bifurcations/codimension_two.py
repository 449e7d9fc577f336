"""Points of codimension two on curves of events, and where curves start.

====== ============ ======================================================================
kind   on           test function
====== ============ ======================================================================
FB-G.. FB, BP, PD   smallest interior gap of each flight and wall: the orbit also grazes
..-V   FB, BP, PD   velocity of each impact
..-T   FB, BP, PD   duration of each flight
G-PD   G, V         determinant of C(-1) of the orbit that grazes
G-FB   G, V         determinant of C(1) of the orbit that grazes (the old branch folds), and
                    parameter rate of the branch with one impact more (its fold is born)
DG     G, V         acceleration at the touch; rate with which motion begins on a limit of its mode
R1, R2 FB, PD       product of the critical multiplier and another minus one: two at 1, or at -1,
                    with one eigenvector
FB-BP, FB, PD       the same with an eigenvector of its own for each
PD-PD
FB-PD, FB, PD, NS   product of the distances of the multipliers not critical from -1 or 1:
..-FB, (m > 2)      both happen at once, as in the fold-flip
NS-PD
..-NS  FB, PD, NS   products of two multipliers that are not critical, minus one
====== ============ ======================================================================

Those of one kind alone stand with it: CP in `fold`, GPD in `doubling`. They are located by
bracketing along the curve, whose points solve its equations to rounding.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..continuation.branch import Details, Event, Location, Point, Problem, TestFunction
from ..continuation.corrector import log_determinant
from ..models.guards import Word
from ..orbits.problem import Linearisation
from ..orbits.quiet import problem_of
from ..orbits.status import neimark_sacker, pair_on_circle, products_of
from ..segments.flight import Touch
from .at_rest import Curve, acceleration_at_touch, solve_at_rest, solve_touch_at_impact
from .extended_system import NO_TRACE, UNIT_CIRCLE, ExtendedSystem, trace_of
from .kind import CurvePoint, Kind, kind_of

Leaves: TypeAlias = Callable[[ExtendedSystem, Array], tuple[Array, Array]]


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


def repeat_orbit(here: Linearisation, times: int = 2) -> Linearisation:
    """Return an orbit run several times, as one of the word that repeats its own."""
    problem, span = here.problem, here.span
    rows = np.tile(problem.impacts(here.unknowns), (times, 1))
    rows[:, 0] += span * np.repeat(np.arange(times), len(rows) // times)
    word = Word(problem.word.walls * times, problem.word.period * times)
    longer = problem_of(problem.model, word, problem.kernels)
    return longer.evaluate(longer.with_impacts(rows, times * span, here.unknowns))


MARKERS = {
    "PD-G": "o",
    "G-FB": "^",
    "CP": "v",
    "GPD": "s",
    "DG": "D",
    "FB-G": "p",
    "FB-V": "X",
    "PD-V": "*",
    "FB-T": "$T$",
    "PD-T": "$t$",
    "R1": "<",
    "R2": ">",
    "FB-BP": "d",
    "PD-PD": "1",
    "R3": "$3$",
    "R4": "$4$",
    "BP-G": "x",
    "BP-V": "+",
    "BP-T": "4",
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

    def at_rest(self, orbit: Linearisation) -> list[int]:
        """Return the values that vanish with the motion itself, of impacts that are none."""
        return []

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


BRIEF = 3e-5
"""Part of the period below which a contact vanishes with the velocities at its ends."""


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

    def at_rest(self, orbit: Linearisation) -> list[int]:
        return orbit.resting

    def locate(
        self, problem: Problem[CurvePoint], guess: Point[CurvePoint], index: int
    ) -> Location | None:
        """Where an impact at rest leaves no trace, solutions of the curve's equations cross."""
        found = solve_at_rest(cast(Curve, problem), guess.evaluation, index)
        return found and replace(found, details={"changes": self.changes})

    def other(self, here: CurvePoint, index: int) -> tuple[str, Details]:
        """V of an impact, of a contact that vanishes with it, or of the end of one that lasts."""
        problem, before = here.orbit.problem, (index - 1) % len(here.orbit.problem.word)
        contacts = [k for k in (index, before) if k in problem.excursions]
        ends = {k: problem.times_around(here.orbit.unknowns, k) for k in contacts}
        if any(abs(end - begin) < BRIEF * here.orbit.span for begin, end in ends.values()):
            return "V", {"impact": min(contacts, key=lambda k: abs(ends[k][1] - ends[k][0]))}
        return "V", {"impact": index} | ({"flight": before} if contacts else {})


NO_TIME = 1e-9
"""Part of the period below which a flight between impacts at rest is rounding."""


class OrderCoincides(CurveTest):
    """A flight of the bifurcating orbit loses its duration, but for excursions: theirs go with
    velocities."""

    noise = 1e-12

    def __init__(self, kind: str) -> None:
        self.kind = f"{kind}-T"
        self.changes = (
            f"a flight loses its duration on the orbit of the {kind}: beyond, impacts are out of "
            "order"
        )

    def of(self, here: CurvePoint) -> ArrayLike:
        return self.durations(here.orbit)

    @staticmethod
    def durations(orbit: Linearisation) -> Array:
        """Those of flights, as parts of the period."""
        times = orbit.problem.impacts(orbit.unknowns)[:, 0]
        durations = np.append(times[1:], times[:1] + orbit.span) - times
        durations[list(orbit.problem.excursions)] = np.nan
        return np.asarray(durations / orbit.span)

    def at_rest(self, orbit: Linearisation) -> list[int]:
        at_once = np.abs(self.durations(orbit)) < NO_TIME
        return np.flatnonzero(at_once).tolist() if orbit.resting else []

    def other(self, here: CurvePoint, index: int) -> tuple[str, Details]:
        return "T", {"flight": index}

    def born(self, here: CurvePoint, index: int) -> list[CurveStart]:
        """None: T has no curves."""
        return []


def leaving_tests(kind: str) -> list[CurveTest]:
    """Return the tests of where orbits of a kind that touches nothing become unphysical."""
    return [GrazingCoincides(kind), StopCoincides(kind), OrderCoincides(kind)]


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
        matrix = _in_natural_sizes(event.point.evaluation.orbit, self.multiplier)
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


NOT_STARTED = "; one of NS of the doubled orbits may begin here, and is not started"


class Coincides(CurveTest):
    """Other multipliers of the bifurcating orbit are critical, too."""

    def __init__(self, kind: Kind, event: str) -> None:
        self.own, self.event, self.kind = kind, event, f"{kind.name}-{event}"
        self.changes = f"{kind.name} and {event} happen on the same orbit: their curves cross"
        both = kind, kind_of(event)
        if {one.multiplier for one in both} == {1.0, -1.0} and not any(k.crossing for k in both):
            self.changes += NOT_STARTED

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
        if here.orbit.problem.m <= 2:
            return []
        others, mu = self.others(here), kind_of(self.event).multiplier
        assert mu is not None, "these kinds have one"
        others = others[np.isfinite(others)]
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
        flight, wall, since = self.touch(here)
        return acceleration_at_touch(here.orbit, flight, wall, since)

    def locate(
        self, problem: Problem[CurvePoint], guess: Point[CurvePoint], index: int
    ) -> Location | None:
        """Where the touch has reached an impact, the equations of a curve of G are singular."""
        here = guess.evaluation
        if not here.orbit.problem.word.walls:
            return None
        flight, _, since = self.touch(here)
        begin, end = here.orbit.problem.times_around(here.orbit.unknowns, flight)
        found = solve_touch_at_impact(cast(Curve, problem), here, bool(end - begin < 2.0 * since))
        return found and replace(found, details={"changes": self.changes})


SMALLEST = -700.0
"""Least logarithm of a determinant that is told from zero."""


def scaled_determinant(orbit: Linearisation, mu: float) -> float:
    """Return the determinant of C(mu) in natural sizes, which has the sign of its own."""
    sign, logarithm = log_determinant(_in_natural_sizes(orbit, mu))
    return sign * math.exp(max(logarithm, SMALLEST))


def _in_natural_sizes(orbit: Linearisation, mu: float) -> Array:
    """C(mu), or where that is singular of shifts in time, the Jacobian; its own rows may vanish, as
    at rest."""
    n, (rows, sizes) = orbit.problem.n, orbit.sizes
    free = mu == 1.0 and orbit.problem.autonomous
    matrix = orbit.jacobian if free else orbit.cyclic(mu)
    return matrix[:, :n] * sizes[:n] / rows[:, None]


class TouchSingular(CurveTest):
    """A multiplier of the orbit, counted as one of a word, is mu."""

    def __init__(
        self, kind: str, changes: str, mu: float, counted: Callable[[CurvePoint], Linearisation]
    ) -> None:
        self.kind, self.changes, self.mu, self.counted = kind, changes, mu, counted

    def of(self, here: CurvePoint) -> ArrayLike:
        return scaled_determinant(self.counted(here), self.mu)

    def accept(self, event: Event[CurvePoint]) -> bool:
        """Whether the orbit has the multiplier: where an impact leaves no trace, C(mu) is singular
        for every mu."""
        away = np.abs(self.counted(event.point.evaluation).multipliers - self.mu)
        return bool(np.any(away < UNIT_CIRCLE))

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
        self.jumps: bool | None = None
        """Whether the touch changes the acceleration: as orbits that are closed tell, beside which
        others, by which the function is differenced, are taken for the same."""

    def of(self, here: CurvePoint) -> ArrayLike:
        flight, wall, since = self.touch(here)
        begin, _ = here.orbit.problem.times_around(here.orbit.unknowns, flight)
        orbit = self.counted(here)
        there = _impacts_at(orbit, begin + since)
        if _leaves_no_trace(orbit, there):
            return np.nan
        value = np.asarray(super().of(here))
        if self.jumps is None or _is_closed(orbit):
            self.jumps = _changes_acceleration(orbit, int(np.argmax(there)), wall)
        if self.jumps:
            return value
        factor = acceleration_at_touch(here.orbit, flight, wall, since)  # which is no fold's
        return np.sign(factor) * value

    def accept(self, event: Event[CurvePoint]) -> bool:
        """Where the touch is a jump, no orbit has it as an impact."""
        return _is_closed(self.counted(event.point.evaluation))

    def enters(self, point: Point[CurvePoint], index: int) -> bool:
        """Where no orbit has the touch as an impact, rounding alone changes the sign."""
        return not _is_closed(self.counted(point.evaluation))


TOGETHER = 1e-6
"""Part of the period within which impacts happen at once."""

CLOSED = 1e-9
"""Largest residual of an orbit that is one, beside natural sizes."""

SMOOTH = 1e-6
"""Change of an acceleration, beside natural ones, that is rounding."""


def _is_closed(orbit: Linearisation) -> bool:
    """Whether the equations are solved."""
    problem = orbit.problem
    sizes = problem.residual_sizes(problem.natural_units(orbit.unknowns))
    return bool(np.all(np.abs(orbit.residual) < CLOSED * sizes))


def _impacts_at(orbit: Linearisation, time: float) -> Array:
    """Which impacts are at a time."""
    problem, span = orbit.problem, orbit.span
    apart = problem.impacts(orbit.unknowns)[: len(problem.word), 0] - time
    return np.abs(apart - span * np.round(apart / span)) < TOGETHER * span


def _changes_acceleration(orbit: Linearisation, impact: int, wall: str) -> bool:
    """Whether an impact at rest changes the acceleration of its gap, as where friction does: what
    its time changes then does not vanish with that acceleration."""
    before = impact - 1 if impact else len(orbit.problem.word) - 1
    begin, end = orbit.problem.times_around(orbit.unknowns, before)
    sides = (
        acceleration_at_touch(orbit, before, wall, end - begin),
        acceleration_at_touch(orbit, impact, wall, 0.0),
    )
    return bool(abs(sides[1] - sides[0]) > SMOOTH * orbit.sizes[1][1] / orbit.span)


def _leaves_no_trace(orbit: Linearisation, there: Array) -> bool:
    """Whether impacts can move together, to the first order, so that no flight before or after
    them changes at its other end; without forcing also in time, with all impacts before them."""
    if orbit.problem.autonomous:
        return _leaves_no_trace_but_time(orbit, np.flatnonzero(there))
    return trace_of(orbit, np.flatnonzero(np.repeat(there, orbit.problem.m))) < NO_TRACE


def _leaves_no_trace_but_time(orbit: Linearisation, there: Array) -> bool:
    problem, (rows, sizes) = orbit.problem, orbit.sizes
    n, m, first = problem.n, problem.m, int(there[0])
    columns = orbit.jacobian[:, :n] / rows[:, None]
    times = columns[:, ::m] * sizes[0]  # the first impact leaves at minus the period
    others = times[:, :first] if first else np.delete(times, there, axis=1)
    moved = columns[:, (m * there[:, None] + np.arange(m)).ravel()]
    own = moved * sizes[:n].reshape(-1, m)[there].ravel()
    together = np.column_stack([own, others.sum(axis=1)]) if others.size else own
    return bool(np.linalg.norm(together, -2) < NO_TRACE)


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
