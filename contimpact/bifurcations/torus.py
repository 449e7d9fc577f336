r"""NS: a complex pair of multipliers crosses the unit circle (Neimark and Sacker); a torus is born.

The test function is the product of the pair minus one, without poles; located by bracketing. Its
curves solve F = 0 and, with the states q_0, q_1, q_2 of three laps in the plane of the pair,
C_0 q_k + C_1 q_{k+1} = 0, in which C(mu) = C_0 + mu C_1 and q_2 = 2 cos(theta) q_1 - q_0. All is
real, and regular where the pair meets at 1 or -1, beyond which it is a neutral saddle.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..continuation.branch import EndKind, Point, TestFunction
from ..models.guards import Word
from ..orbits.problem import Array, Linearisation, OrbitProblem, rounding
from ..orbits.status import neimark_sacker, pair_on_circle, products_of
from .codimension_two import CurveTest, MultiplierCoincides, PairCoincides, leaving_tests
from .extended_system import (
    ExtendedSystem,
    OrbitEvent,
    OrbitPoint,
    Orbits,
    OrbitTest,
    SystemEvaluation,
    is_near,
    rounding_of_length,
    rounding_of_product,
)
from .kind import Change, CurvePoint, Details, Equations, Kind, Look, System, Values, declared

RESONANT = 1e-5
"""How far from the unit circle a double multiplier is seen, known to the root of rounding."""

ENORMOUS = 1e7
"""Size of a multiplier whose sign, beside an impact at rest, may be that of a residual."""


class NeimarkSacker(OrbitTest):
    """The product of two multipliers minus one."""

    kind = "NS"
    noise = 1e-9  # without damping and losses the product is one everywhere, within rounding

    def of(self, orbits: Orbits) -> Array:
        return neimark_sacker(orbits.products)[:, None]

    def enters(self, point: OrbitPoint, index: int) -> bool:
        """Where an impact is at rest, or as slow as points are solved to, a multiplier passes
        infinity: a jump there says nothing."""
        here = point.evaluation
        return here.unbounded or bool(np.max(np.abs(here.multipliers)) > ENORMOUS)

    def accept(self, event: OrbitEvent) -> bool:
        return pair_on_circle(event.point.evaluation.multipliers)


class SingularPair(ExtendedSystem):
    """The plane of a pair with the product 1 and the sum 2 kappa; its own unknowns are q_0, q_1 and
    kappa, the cosine of theta on the unit circle."""

    def start(self, here: Linearisation) -> Array:
        kappa = cosine_of_pair(here)
        plane = np.linalg.svd(_plane(*_parts(here), kappa))[2][-2:]
        self.phase = plane[0]
        return np.append(plane[1], kappa)

    def assemble(self, here: Linearisation, own: Array) -> SystemEvaluation:
        n, orbit = self.problem.n, len(here.unknowns)
        one, two, kappa = own[:n], own[n : 2 * n], own[-1]
        first, last = _parts(here)
        plane = _plane(first, last, kappa)
        jacobian = np.zeros((3 * n + 2, orbit + 2 * n + 1))
        jacobian[:n, :orbit] = here.jacobian
        (one_first, one_last), (two_first, two_last) = self._bent(here, one), self._bent(here, two)
        jacobian[n : 2 * n, :orbit] = one_first + two_last
        jacobian[2 * n : 3 * n, :orbit] = two_first + 2.0 * kappa * two_last - one_last
        jacobian[n : 3 * n, orbit:-1] = plane
        jacobian[2 * n : 3 * n, -1] = 2.0 * last @ two
        jacobian[3 * n, orbit:-1] = own[:-1]
        jacobian[3 * n + 1, orbit:-1] = self.phase
        length = 0.5 * (own[:-1] @ own[:-1] - 1.0)
        added = [*(plane @ own[:-1]), length, self.phase @ own[:-1]]
        return SystemEvaluation(np.append(here.residual, added), jacobian)

    def _bent(self, here: Linearisation, q: Array) -> tuple[Array, Array]:
        """The derivatives of C_0 q and of C_1 q."""
        problem = self.problem
        along = np.concatenate([q, np.zeros(problem.free)])
        first = problem.second_along(here.unknowns, along, 0.0)
        return first, problem.second_along(here.unknowns, along, 1.0) - first

    def rounding(self, here: Linearisation, own: Array) -> Array:
        bounds, n = rounding(here), self.problem.n
        first, last = _parts(here)
        matrix = np.abs(_plane(np.abs(first), np.abs(last), 1.0))
        errors = bounds.cyclic(1.0)[:, :n]
        product = rounding_of_product(matrix, _plane(errors, errors, 1.0), np.abs(own[:-1]))
        length = rounding_of_length(own[:-1])
        return np.concatenate([bounds.residual, product, [length, length]])


def _plane(first: Array, last: Array, kappa: float) -> Array:
    """The matrix that takes (q_0, q_1) to the equations of two laps."""
    return np.block([[first, last], [-last, first + 2.0 * kappa * last]])


def cosine_of_pair(here: Linearisation) -> float:
    """Return cos(theta) of the pair of multipliers nearest to the unit circle.

    Raises numpy.linalg.LinAlgError if there is no pair.
    """
    multipliers = here.multipliers[np.isfinite(here.multipliers)]
    pairs = multipliers[multipliers.imag > 0.0]
    if not len(pairs):  # they have met on the real axis, at R1 or R2
        pairs = multipliers[np.abs(np.abs(multipliers) - 1.0) < RESONANT]
    if not len(pairs):
        raise np.linalg.LinAlgError("no complex pair of multipliers")
    mu = pairs[np.argmin(np.abs(np.abs(pairs) - 1.0))]
    return float(mu.real / abs(mu))


def _parts(here: Linearisation) -> tuple[Array, Array]:
    """C0 and C1."""
    n = here.problem.n
    first = here.cyclic(0.0)[:, :n]
    return first, here.cyclic(1.0)[:, :n] - first


class RealPair(TestFunction):
    """Along a curve, the pair meets on the real axis."""

    kind = "resonance"

    def values(self, point: Point) -> Array:
        here: CurvePoint = point.evaluation
        return np.array([1.0 - here.own[-1] ** 2])


class StrongResonance(CurveTest):
    """R3, R4: the pair is a third or a fourth root of one."""

    def __init__(self, order: int) -> None:
        self.kind, self.order = f"R{order}", order
        self.changes = f"the multipliers are roots of one of order {order}: a strong resonance"

    def of(self, here: CurvePoint) -> float:
        return float(here.own[-1] - np.cos(2.0 * np.pi / self.order))


@declared(place=4, curves=True, second=True, tori=True)
class NS(Kind):
    """Neimark-Sacker bifurcation."""

    name = NeimarkSacker.kind
    changes = Change.STABILITY
    auto = 8
    look = Look("*", "#56B4E9")

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction[Linearisation]:
        return NeimarkSacker()

    def equations(self, problem: OrbitProblem, details: Details) -> ExtendedSystem:
        return SingularPair(problem)

    def in_many_digits(self, orbit: Equations, unknowns: Array, details: Details) -> System:
        system = SingularPair(orbit.problem)
        own = system.start(orbit.problem.evaluate(unknowns))
        return orbit.singular_pair(system.phase, own)

    def passed(self, multiplier: float | None) -> bool:
        return multiplier is None

    def critical(self, multipliers: Array) -> list[int]:
        """A pair, also beside a real multiplier on the unit circle, if it has not met there."""
        away = np.abs(np.abs(multipliers) - 1.0)
        apart = (multipliers.imag == 0.0) | (away > RESONANT)
        return np.lexsort((away, apart))[:2].tolist()

    def is_on_circle(self, here: Linearisation) -> bool:
        return is_near(here, products_of(here.multipliers), 1.0, known=True)

    def curve_limits(self) -> Mapping[EndKind, TestFunction]:
        return {EndKind.RESONANCE: RealPair()}

    def curve_end(self, own: Array) -> EndKind | None:
        """Beyond the resonance the multipliers are real."""
        return EndKind.RESONANCE if abs(own[-1]) > 1.0 else None

    def codimension_two(self, word: Word) -> list[TestFunction]:
        also = [MultiplierCoincides(self, kind) for kind in ("FB", "BP", "PD")]
        resonances = [StrongResonance(3), StrongResonance(4)]
        return [*leaving_tests(self.name), *resonances, *also, PairCoincides(self)]
