r"""BP: two branches of orbits of one word cross.

With null vectors phi_1 (the branch's tangent) and phi_2 and left null vector psi, the directions
a phi_1 + b phi_2 of the branches solve

.. math:: \alpha_{11} a^2 + 2 \alpha_{12} a b + \alpha_{22} b^2 = 0, \qquad
          \alpha_{ij} = \psi \cdot F_{zz}[\phi_i, \phi_j],

(Keller 1977), of which the branch itself is the root b = 0.
"""

from __future__ import annotations

import numpy as np

from ..continuation.branch import EndKind, Location, Problem, TestFunction
from ..continuation.corrector import orient_vector
from ..models.guards import Word
from ..orbits.problem import Array, Linearisation, OrbitProblem
from .codimension_two import MultiplierCoincides, PairCoincides, leaving_tests
from .extended_system import (
    ROUNDING,
    Crossing,
    ExtendedSystem,
    OrbitEvent,
    OrbitPoint,
    Orbits,
    OrbitTest,
    branches_cross,
    crossing_near,
    has_multiplier,
    located,
    unfolding_of,
)
from .kind import (
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

UNFOLDED = 1e-8
"""Size of nu beyond which a curve of branch points has none any more."""


class BranchPoint(OrbitTest):
    """The determinant of the Jacobian bordered by the tangent."""

    kind = "BP"
    rounding = ROUNDING

    def of(self, orbits: Orbits) -> Array:
        return orbits.orientations[:, None]

    def locate(
        self, problem: Problem[Linearisation], guess: OrbitPoint, index: int
    ) -> Location | None:
        found = located(Crossing(guess.evaluation.problem), guess, unfolding_of)
        return found if found is not None and branches_cross(found.details) else None

    def accept(self, event: OrbitEvent) -> bool:
        """Bracketing does not tell a crossing of branches from a near miss."""
        if event.method == "bracket":
            scale = np.ones(len(event.point.unknowns))
            near = crossing_near(event.point.evaluation.problem, event.point, scale)
            if near is not None and not near.crosses:
                return False
        return has_multiplier(event, 1.0)


@declared(place=2, born=True, curves=True, second=True)
class BP(Kind):
    """Branch point."""

    name = BranchPoint.kind
    changes = Change.STABILITY
    multiplier = 1.0
    crossing = True
    auto = 6
    look = Look("D", "#CC79A7")

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction[Linearisation]:
        return BranchPoint()

    def equations(self, problem: OrbitProblem, details: Details) -> ExtendedSystem:
        return Crossing(problem)

    def in_many_digits(self, orbit: Equations, unknowns: Array, details: Details) -> System:
        return orbit.branch_point(unknowns)

    def born(self, event: OrbitEvent) -> Start | None:
        here: Linearisation = event.point.evaluation
        problem = here.problem
        directions = directions_at(here)
        if directions is None:
            return None
        along = event.point.tangent
        units = here.sizes[1] ** 2
        other = orient_vector(min(directions, key=lambda one: abs(one / units @ along)))
        return Start(problem, here.unknowns, other, branching=True, both_ways=True)

    def curve_end(self, own: Array) -> EndKind | None:
        return EndKind.UNFOLDED if abs(own[0]) > UNFOLDED else None

    def codimension_two(self, word: Word) -> list[TestFunction[CurvePoint]]:
        also = MultiplierCoincides(self, "PD"), PairCoincides(self)
        return [*leaving_tests(self.name), *also]


def directions_at(here: Linearisation) -> list[Array] | None:
    """Return unit vectors along the two branches that cross at an orbit; None where none do."""
    left, right = here.singular_vectors(here.jacobian)
    psi, null = left[-1], right[-2:]
    along = [here.problem.second_along(here.unknowns, vector) for vector in null]
    form = np.array([[float(psi @ row @ vector) for vector in null] for row in along])
    found = _isotropic(form)
    return None if found is None else [pair @ null for pair in found]


def _isotropic(form: Array) -> list[Array] | None:
    """The two unit vectors on which an indefinite quadratic form in the plane vanishes."""
    sizes, axes = np.linalg.eigh(0.5 * (form + form.T))
    if not sizes[0] < 0.0 < sizes[1] or min(abs(sizes)) < 1e-10 * max(abs(sizes)):
        return None
    angle = np.arctan(np.sqrt(-sizes[0] / sizes[1]))
    return [np.cos(angle) * axes[:, 0] + sign * np.sin(angle) * axes[:, 1] for sign in (1.0, -1.0)]
