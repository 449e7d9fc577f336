"""Orbits with a given multiplier: the cyclic matrix is singular. FB and PD share its equations."""

from __future__ import annotations

import numpy as np

from ..orbits.problem import Array, Linearisation, OrbitProblem, rounding
from .extended_system import Assembled, ExtendedSystem, rounding_of_length, rounding_of_product
from .orbit_test import OrbitEvent

UNIT_CIRCLE = 1e-2
"""How near to its critical value a located event's multiplier is at least."""

ROUNDING = 1e-14
"""Rounding of the scaled determinants."""


def has_multiplier(event: OrbitEvent, target: float) -> bool:
    """Whether a multiplier is where the event needs one.

    Determinants also vanish where flights do: at r = 0 impacts merge, and no multiplier is near.
    """
    multipliers = event.point.evaluation.multipliers
    return bool(np.min(np.abs(multipliers - target)) < UNIT_CIRCLE)


def null_vectors(matrix: Array) -> tuple[Array, Array]:
    """Return the left and the right null vector of a matrix that lacks one rank.

    They are oriented together: their product is a positive multiple of the adjugate, which does not
    vanish along a curve of such matrices.
    """
    left, _, right = np.linalg.svd(matrix)
    sign = np.sign(np.linalg.det(left) * np.linalg.det(right))
    return sign * left[:, -1], right[-1]


class SingularCycle(ExtendedSystem):
    """C(mu) is singular: mu is a multiplier. FB for mu = 1, PD for mu = -1."""

    def __init__(self, problem: OrbitProblem, mu: float) -> None:
        super().__init__(problem)
        self.mu = mu

    def start(self, here: Linearisation) -> Array:
        n = self.problem.n
        return np.linalg.svd(here.cyclic(self.mu)[:, :n])[2][-1]

    def assemble(self, here: Linearisation, own: Array) -> Assembled:
        problem, n = self.problem, self.problem.n
        orbit = len(here.unknowns)
        cycle = here.cyclic(self.mu)[:, :n]
        along = np.concatenate([own, np.zeros(orbit - n)])
        jacobian = np.zeros((2 * n + 1, orbit + n))
        jacobian[:n, :orbit] = here.jacobian
        jacobian[n : 2 * n, :orbit] = problem.second_along(here.unknowns, along, self.mu)
        jacobian[n : 2 * n, orbit:] = cycle
        jacobian[2 * n, orbit:] = own
        return Assembled(
            np.concatenate([here.residual, cycle @ own, [0.5 * (own @ own - 1.0)]]), jacobian
        )

    def rounding(self, here: Linearisation, own: Array) -> Array:
        bounds, n = rounding(here), self.problem.n
        product = rounding_of_product(here.cyclic(self.mu)[:, :n], bounds.cyclic(1.0)[:, :n], own)
        return np.concatenate([bounds.residual, product, [rounding_of_length(own)]])
