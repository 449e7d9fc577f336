"""Points of codimension two on curves of events, and where curves start.

====== ============ ======================================================================
kind   on           test function
====== ============ ======================================================================
FB-G.. FB, BP, PD   smallest interior gap of each flight and wall: the orbit also grazes
..-V   FB, BP, PD   velocity of each impact
G-PD   G, V         determinant of C(-1) of the orbit that grazes
G-FB   G, V         determinant of C(1) of the orbit that grazes (the old branch folds), and
                    parameter rate of the branch with one impact more (its fold is born)
DG     G, V         acceleration at the touch
R1, R2 FB, PD       product of the critical multiplier and another minus one: two at 1, or at -1,
                    with one eigenvector
FB-BP, FB, PD       the same with an eigenvector of its own for each
PD-PD
====== ============ ======================================================================

Those of one kind alone stand with it: CP in `fold`, GPD in `doubling`. They are located by
bracketing along the curve, whose points solve its equations to rounding.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from ..continuation.branch import Details, Event, Point, TestFunction
from ..continuation.corrector import scaled_determinant
from ..continuation.problem import Evaluation
from ..models.word import Word
from ..orbits.multipliers import neimark_sacker
from ..orbits.problem import Linearisation
from ..orbits.quiet import problem_of
from ..segments.flight import Touch
from .declarations import CROSSINGS
from .extended_system import ExtendedSystem

# Where a curve in two parameters begins, or passes, that is seen from a point of another curve.

if TYPE_CHECKING:
    from .extended_system import ExtendedSystem

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


MARKERS = dict.fromkeys(CROSSINGS, "o") | {
    "G-FB": "^",
    "CP": "v",
    "GPD": "s",
    "DG": "D",
    "FB-G": "P",
    "FB-V": "X",
    "PD-V": "*",
}
"""Markers of the points in pictures."""


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
        return neimark_sacker(values[critical] * np.delete(values, critical))

    def accept(self, event: Event[CurvePoint]) -> bool:
        """Whether there is one eigenvector."""
        return self.alone(event.point.evaluation.orbit)

    def alone(self, orbit: Linearisation) -> bool:
        """Whether the double multiplier has one eigenvector."""
        matrix = orbit.cyclic(self.multiplier)[:, : orbit.problem.n]
        sizes = np.linalg.svd(matrix, compute_uv=False)
        return bool(sizes[-2] > ONE_EIGENVECTOR * sizes[0])

    def born(self, here: CurvePoint, index: int) -> list[CurveStart]:
        """The curve of NS; with q the eigenvector, C(mu) q + C'(mu) mu q = 0 gives the next one."""
        orbit, n = here.orbit, here.orbit.problem.n

        def leaves(_: ExtendedSystem, own: Array) -> tuple[Array, Array]:
            mu, q = float(np.sign(np.cos(own[-1]))), own[:n]
            last = orbit.cyclic(1.0)[:, :n] - orbit.cyclic(0.0)[:, :n]
            singular = orbit.cyclic(mu)[:, :n]
            further = np.linalg.lstsq(singular, -mu * last @ q, rcond=ONE_EIGENVECTOR)[0]
            return np.zeros(len(orbit.unknowns)), np.concatenate([0.0 * q, further, [1.0]])

        return [CurveStart("NS", orbit, {}, leaves)]


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


# On curves of orbits that touch a wall, seen from the shorter or from the longer word.


class DegenerateTouch(CurveTest):
    """The touch has no acceleration."""

    kind = "DG"
    changes = "the touch has zero acceleration: two touches of the flight are born or meet"

    def __init__(self, touch: Callable[[CurvePoint], tuple[int, float]]) -> None:
        self.touch = touch

    def of(self, here: CurvePoint) -> ArrayLike:
        orbit, problem = here.orbit, here.orbit.problem
        left, since = self.touch(here)
        _, row = problem.leaving(orbit.unknowns, left)
        return problem.segments[left].track(row, since, problem.values(orbit.unknowns))[2]


class TouchSingular(CurveTest):
    """A multiplier of the orbit, counted as one of a word, is mu."""

    def __init__(
        self, kind: str, changes: str, mu: float, counted: Callable[[CurvePoint], Linearisation]
    ) -> None:
        self.kind, self.changes, self.mu, self.counted = kind, changes, mu, counted

    def of(self, here: CurvePoint) -> ArrayLike:
        orbit = self.counted(here)
        return scaled_determinant(orbit.cyclic(self.mu)[:, : orbit.problem.n])

    def other(self, here: CurvePoint, index: int) -> tuple[str, Details] | None:
        same = self.counted(here) is here.orbit
        return (self.event, {}) if same else None

    @property
    def event(self) -> str:
        """The kind of event of which the orbit has the multiplier."""
        return "FB" if self.mu > 0.0 else "PD"

    def born(self, here: CurvePoint, index: int) -> list[CurveStart]:
        return [CurveStart(self.event, self.counted(here))]


def touch_points(
    touch: Callable[[CurvePoint], tuple[int, float]],
    longer: Callable[[CurvePoint], Linearisation],
    shorter: Callable[[CurvePoint], Linearisation] | None,
) -> list[TestFunction[CurvePoint]]:
    """Return the test functions of a curve of orbits that touch a wall.

    ``touch(point)`` gives the impact before the touch, and the time since then; `longer` and
    `shorter` the orbit with the touch as an impact of its word, and without, None if no impact is
    left.
    """
    points: list[TestFunction[CurvePoint]] = [
        DegenerateTouch(touch),
        TouchSingular(
            "G-FB",
            "the fold of the new branch is born at the grazing: the grazing changes between "
            "supercritical and subcritical",
            1.0,
            longer,
        ),
    ]
    if shorter is not None:
        doubles = "the grazing orbit doubles its period here: the grazing is real on one side only"
        folds = "the branch that grazes folds at its grazing"
        points += [
            TouchSingular("G-PD", doubles, -1.0, shorter),
            TouchSingular("G-FB", folds, 1.0, shorter),
        ]
    return points
