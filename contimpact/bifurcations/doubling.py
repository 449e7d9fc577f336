r"""PD: a multiplier passes -1, and the word run twice leaves the branch.

The branch born there leaves along (q, -q), q the eigenvector of -1; both ways lead to the same
orbits, half a period apart. It is supercritical where the doubled orbit exists for values at which
the old one has a multiplier beyond -1. With z = z_0 + a q + a^2 w + ... on one half of the doubled
orbit and z_0 - a q + a^2 w + ... on the other, lambda = lambda_0 + c a^2 solves the equations to
third order:

.. math:: C(1) w_0 = -\tfrac12 B[q,q], \quad C(1) z_\lambda = -F_\lambda, \quad
          c = -\frac{\psi \cdot (B[q, w_0] + T[q,q,q]/6)}
                    {\psi \cdot (B[q, z_\lambda] + F_{z\lambda} q)},

with psi the left null vector of C(-1), B and T the second and third derivatives of F, the
directions q continued with the factor -1 over the period (Lyapunov and Schmidt; see Golubitsky and
Schaeffer 1985).
"""

from __future__ import annotations

from typing import cast

import numpy as np

from ..continuation.branch import Event, Location, Point, Problem, TestFunction
from ..continuation.corrector import orient_vector
from ..models.guards import Word
from ..orbits.problem import Array, Linearisation, OrbitProblem
from ..orbits.quiet import QuietProblem, problem_of
from .at_rest import Curve, points_at_rest
from .codimension_two import (
    SMALLEST,
    CurveStart,
    CurveTest,
    GrazingCoincides,
    MultiplierCoincides,
    PairCoincides,
    Resonance,
    SecondEigenvector,
    leaving_tests,
    repeat_orbit,
    scaled_determinant,
)
from .extended_system import (
    ROUNDING,
    ExtendedSystem,
    OrbitEvent,
    OrbitPoint,
    Orbits,
    SingularCycle,
    SingularTest,
    null_vectors,
    unit_vector,
    vanishes,
)
from .kind import (
    SUB,
    SUPER,
    Change,
    CurvePoint,
    Details,
    Equations,
    Kind,
    Look,
    Start,
    System,
    Values,
    declared,
)


class PeriodDoubling(SingularTest):
    """The determinant of the cyclic block matrix with its last coupling multiplied by -1."""

    kind = "PD"
    mu = -1.0
    rounding = ROUNDING
    needs = ("doubling",)

    def of(self, orbits: Orbits) -> Array:
        return orbits.doubling[:, None]


class DoublingTurns(CurveTest):
    """GPD: the numerator of c, which has no pole where the curve turns in lambda, times det C(1),
    which leaves it none where the orbit also folds."""

    kind, pole = "GPD", "FB"
    changes = "the period doubling changes between supercritical and subcritical"

    def of(self, here: CurvePoint) -> float:
        """Where an impact is at rest, C(1) is singular, so that its determinant and what is solved
        with it are rounding; their product is not, if both have the same factors."""
        orbit, n = here.orbit, here.orbit.problem.n
        bend = float(np.sum(_bend(orbit)[0]))
        if orbit.problem.autonomous:
            return bend * scaled_determinant(orbit, 1.0)
        rows, sizes = orbit.sizes
        sign, logarithm = np.linalg.slogdet(orbit.cyclic(1.0)[:, :n])
        logarithm += np.sum(np.log(sizes[:n] / rows))
        return bend * float(sign * np.exp(max(logarithm, SMALLEST)))

    def locate(
        self, problem: Problem[CurvePoint], guess: Point[CurvePoint], index: int
    ) -> Location | None:
        """Where an impact leaves no trace, the sign is that of its velocity."""
        return next(points_at_rest(cast(Curve, problem), guess.evaluation), None)

    def accept(self, event: Event[CurvePoint]) -> bool:
        """Where an impact leaves no trace, C(1) is singular without the multiplier 1."""
        orbit = event.point.evaluation.orbit
        terms, _ = _bend(orbit)
        return vanishes(orbit, float(np.sum(terms)), float(np.sum(np.abs(terms))))

    def born(self, here: CurvePoint, index: int) -> list[CurveStart]:
        """The fold of the doubled orbit, z = z_0 + a (q, -q) + a^2 (w, w), at a = 0."""
        orbit, n = here.orbit, here.orbit.problem.n

        def leaves(_: ExtendedSystem, own: Array) -> tuple[Array, Array]:
            bent = _second_order_term(orbit, own[:n])
            back = 2.0 * orbit.problem.laps(bent, bent)
            return np.append(own, np.zeros(orbit.problem.free)), back

        return [CurveStart("FB", repeat_orbit(orbit), {}, leaves)]


class DoublingGrazes(GrazingCoincides):
    """PD-G: the orbit that doubles its period also grazes, and so do doubled ones beside it."""

    def born(self, here: CurvePoint, index: int) -> list[CurveStart]:
        touch = self.touches(here)[index]
        assert touch is not None, "only a gap that exists has a zero"
        doubled, n = repeat_orbit(here.orbit), here.orbit.problem.n
        details = {"flight": touch.flight, "wall": touch.wall, "touch_time": touch.time}
        jacobian = SingularCycle(here.orbit.problem, -1.0).assemble(here.orbit, here.own).jacobian
        along = np.linalg.svd(jacobian)[2][-1, : len(here.orbit.unknowns)]
        laps = here.orbit.problem.laps
        apart = np.append(laps(here.own, -here.own), 0.0 * along[n:])
        together = np.append(laps(along[:n], along[:n]), along[n:])

        def leaves(system: ExtendedSystem, own: Array) -> tuple[Array, Array]:
            """Doubled orbits as far along the curve of PD as the touch asks for."""
            rows = system.assemble(doubled, own).jacobian[2 * n :]
            orbit, rest = rows[:, : len(apart)], rows[:, len(apart) :]
            found = np.linalg.solve(np.column_stack([orbit @ together, rest]), -orbit @ apart)
            return apart + found[0] * together, found[1:]

        return [*super().born(here, index), CurveStart("G", doubled, details, leaves)]


@declared(place=3, born=True, curves=True, second=True)
class PD(Kind):
    """Period doubling."""

    name = PeriodDoubling.kind
    changes = Change.STABILITY
    multiplier = -1.0
    shorter_at = ("PD-V",)
    auto = 7
    look = Look("s", "#0072B2", 1.8)

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction[Linearisation]:
        return PeriodDoubling()

    def equations(self, problem: OrbitProblem, details: Details) -> ExtendedSystem:
        return SingularCycle(problem, -1.0)

    def in_many_digits(self, orbit: Equations, unknowns: Array, details: Details) -> System:
        return orbit.singular(unknowns, -1.0)

    def born(self, event: OrbitEvent) -> Start | None:
        here: Linearisation = event.point.evaluation
        problem, word = here.problem, here.problem.word
        null = unit_vector(here.singular_vectors(here.cyclic(-1.0)[:, :-1])[1][-1])
        null = orient_vector(null)  # of two equal branches
        if not word.walls:
            doubled = problem_of(problem.model, Word("", word.period * 2), problem.kernels)
            assert isinstance(doubled, QuietProblem)
            unknowns, tangent = doubled.second_lap(here.unknowns, np.append(null, 0.0))
            return Start(doubled, unknowns, tangent, branching=True, both_ways=False)
        tangent, both = np.append(problem.laps(null, -null), 0.0), repeat_orbit(here)
        return Start(both.problem, both.unknowns, tangent, branching=True, both_ways=False)

    def criticality(
        self, event: OrbitEvent, before: OrbitPoint, after: OrbitPoint
    ) -> tuple[str | None, None]:
        """None where the branch folds between the points around the event, or where the laws have
        no third derivative."""
        value = event.parameter
        try:
            terms, crossing = _bend(event.point.evaluation)
        except ArithmeticError:
            return None, None
        bend = -float(np.sum(terms)) / crossing
        if not bend or (before.parameter - value) * (after.parameter - value) >= 0.0:
            return None, None
        before_is_there = (before.parameter - value) * bend > 0.0
        there, other = (before, after) if before_is_there else (after, before)
        unstable = [p.evaluation.n_unstable for p in (there, other)]
        if unstable[0] == unstable[1]:
            return None, None
        return (SUPER if unstable[0] > unstable[1] else SUB), None

    def codimension_two(self, word: Word) -> list[TestFunction[CurvePoint]]:
        double = Resonance("R2", -1.0), SecondEigenvector("PD-PD", -1.0)
        also = MultiplierCoincides(self, "FB"), PairCoincides(self)
        _, *leaving = leaving_tests(self.name)
        return [DoublingGrazes(self.name), *leaving, DoublingTurns(), *double, *also]


def _second_order_term(here: Linearisation, q: Array) -> Array:
    """The w of z = z_0 + a (q, -q) + a^2 (w, w), on which the doubled orbits lie."""
    problem, n = here.problem, here.problem.n
    along = np.concatenate([q, np.zeros(problem.free)])
    squared = problem.second_along(here.unknowns, along, -1.0, beside=-1.0)[:, :n] @ q
    return np.linalg.solve(here.cyclic(1.0)[:, :n], -0.5 * squared)


def _bend(here: Linearisation) -> tuple[Array, float]:
    """Both terms of the numerator of -c, and its denominator.

    As `null_vectors` orients psi and q, the numerator is continuous along a curve, also through R2.
    """
    problem, n = here.problem, here.problem.n
    psi, q = null_vectors(here, -1.0)
    along = np.concatenate([q, np.zeros(problem.free)])
    mixed = problem.second_along(here.unknowns, along, -1.0)
    squared = problem.second_along(here.unknowns, along, -1.0, beside=-1.0)[:, :n] @ q
    cubed = problem.third_along(here.unknowns, q, -1.0)
    periodic = here.cyclic(1.0)[:, :n]
    bent, moved = np.linalg.solve(
        periodic, np.column_stack([-0.5 * squared, -here.by_parameter[:, 0]])
    ).T
    crossing = psi @ (mixed[:, :n] @ moved + mixed[:, n])
    return np.array([psi @ mixed[:, :n] @ bent, psi @ cubed / 6.0]), float(crossing)
