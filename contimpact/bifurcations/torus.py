r"""NS: a complex pair of multipliers crosses the unit circle (Neimark and Sacker); a torus is born.

The test function is the product of the pair minus one, without poles; located by bracketing. Its
curves solve F = 0, C(e^{i theta}) q = 0 with q complex, |q| = 1, and the phase of q held.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..continuation.branch import EndKind, Point, TestFunction
from ..models.word import Word
from ..orbits.problem import Array, Linearisation, OrbitProblem, rounding
from ..orbits.status import neimark_sacker
from .extended_system import (
    ExtendedSystem,
    OrbitEvent,
    OrbitPoint,
    Orbits,
    OrbitTest,
    SystemEvaluation,
    rounding_of_length,
    rounding_of_product,
)
from .kind import (
    Change,
    CurvePoint,
    CurveTest,
    Details,
    Equations,
    GrazingCoincides,
    Kind,
    Look,
    StopCoincides,
    System,
    Values,
    declared,
)

RESONANT = 1e-5
"""How far from the unit circle a double multiplier is seen, known to the root of rounding."""


class NeimarkSacker(OrbitTest):
    """The product of two multipliers minus one."""

    kind = "NS"
    noise = 1e-9  # without damping and losses the product is one everywhere, within rounding

    def of(self, orbits: Orbits) -> Array:
        return neimark_sacker(orbits.products)[:, None]

    def enters(self, point: OrbitPoint, index: int) -> bool:
        """Where an impact is at rest, multipliers are quotients of rounding: a jump there says
        nothing."""
        return bool(point.evaluation.resting)

    def accept(self, event: OrbitEvent) -> bool:
        """Two real multipliers with the product one are a neutral saddle."""
        multipliers = event.point.evaluation.multipliers
        on_circle = np.abs(np.abs(multipliers) - 1.0) < 1e-6
        return bool(np.any(on_circle & (np.abs(multipliers.imag) > 1e-8)))


class SingularPair(ExtendedSystem):
    """C(e^{i theta}) is singular. Its own unknowns are Re q, Im q and theta.

    C(mu) = C0 + mu C1, with the last coupling in C1, so that its derivatives for a complex mu are
    those for 0 and 1 put together.
    """

    def start(self, here: Linearisation) -> Array:
        self.phase, mu = null_pair(here)
        return np.concatenate([self.phase.real, self.phase.imag, [np.angle(mu)]])

    def assemble(self, here: Linearisation, own: Array) -> SystemEvaluation:
        n, orbit = self.problem.n, len(here.unknowns)
        re, im, theta = own[:n], own[n : 2 * n], own[-1]
        cos, sin = np.cos(theta), np.sin(theta)
        first, last = _parts(here)
        real, imaginary = first + cos * last, sin * last
        jacobian = np.zeros((3 * n + 2, orbit + 2 * n + 1))
        jacobian[:n, :orbit] = here.jacobian
        (re_first, re_last), (im_first, im_last) = self._bent(here, re), self._bent(here, im)
        jacobian[n : 2 * n, :orbit] = re_first + cos * re_last - sin * im_last
        jacobian[2 * n : 3 * n, :orbit] = im_first + cos * im_last + sin * re_last
        jacobian[n : 3 * n, orbit:-1] = np.block([[real, -imaginary], [imaginary, real]])
        jacobian[n : 2 * n, -1] = -last @ (sin * re + cos * im)
        jacobian[2 * n : 3 * n, -1] = last @ (cos * re - sin * im)
        jacobian[3 * n, orbit:-1] = own[:-1]
        jacobian[3 * n + 1, orbit:-1] = np.concatenate([-self.phase.imag, self.phase.real])
        residual = [
            here.residual,
            real @ re - imaginary @ im,
            real @ im + imaginary @ re,
            [0.5 * (own[:-1] @ own[:-1] - 1.0), self.phase.real @ im - self.phase.imag @ re],
        ]
        return SystemEvaluation(np.concatenate(residual), jacobian)

    def _bent(self, here: Linearisation, q: Array) -> tuple[Array, Array]:
        """The derivatives of C0 q and of C1 q."""
        problem = self.problem
        along = np.concatenate([q, np.zeros(problem.free)])
        first = problem.second_along(here.unknowns, along, 0.0)
        return first, problem.second_along(here.unknowns, along, 1.0) - first

    def rounding(self, here: Linearisation, own: Array) -> Array:
        bounds, n = rounding(here), self.problem.n
        largest = np.abs(own[:n]) + np.abs(own[n : 2 * n])
        matrix, errors = np.abs(here.cyclic(1.0)[:, :n]), bounds.cyclic(1.0)[:, :n]
        product = rounding_of_product(matrix, errors, largest)
        length = rounding_of_length(own[:-1])
        return np.concatenate([bounds.residual, product, product, [length, length]])


def null_pair(here: Linearisation) -> tuple[Array, complex]:
    """Return the null vector of the pair of multipliers nearest to the unit circle, and the one of
    them above the real axis, on the circle.

    Raises numpy.linalg.LinAlgError if there is no pair.
    """
    multipliers = here.multipliers[np.isfinite(here.multipliers)]
    pairs = multipliers[multipliers.imag > 0.0]
    if not len(pairs):  # they have met on the real axis, at R1 or R2
        pairs = multipliers[np.abs(np.abs(multipliers) - 1.0) < RESONANT]
    if not len(pairs):
        raise np.linalg.LinAlgError("no complex pair of multipliers")
    mu = pairs[np.argmin(np.abs(np.abs(pairs) - 1.0))]
    mu = complex(mu / abs(mu))
    first, last = _parts(here)
    return np.linalg.svd(first + mu * last)[2][-1].conj(), mu


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
        return np.array([np.sin(here.own[-1])])


class StrongResonance(CurveTest):
    """R3, R4: the pair is a third or a fourth root of one."""

    def __init__(self, order: int) -> None:
        self.kind, self.order = f"R{order}", order
        self.changes = f"the multipliers are roots of one of order {order}: a strong resonance"

    def of(self, here: CurvePoint) -> float:
        return float(np.cos(here.own[-1]) - np.cos(2.0 * np.pi / self.order))


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
        return orbit.singular_pair(*null_pair(orbit.problem.evaluate(unknowns)))

    def passed(self, multiplier: float | None) -> bool:
        return multiplier is None

    def critical(self, multipliers: Array) -> list[int]:
        return np.argsort(np.abs(np.abs(multipliers) - 1.0), kind="stable")[:2].tolist()

    def curve_limits(self) -> Mapping[EndKind, TestFunction]:
        return {EndKind.RESONANCE: RealPair()}

    def codimension_two(self, word: Word) -> list[TestFunction]:
        grazes, stops = GrazingCoincides(self.name), StopCoincides(self.name)
        return [grazes, stops, StrongResonance(3), StrongResonance(4)]
