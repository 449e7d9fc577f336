"""Whether branches of orbits cross, or pass each other: what unfolds the crossing, and its error.

The equations stand in `contimpact.continuation.crossing_branches`.
"""

from __future__ import annotations

import numpy as np

from ..continuation.branch import Details
from ..continuation.crossing_branches import Meeting
from ..continuation.problem import Problem
from ..orbits.problem import Array, Linearisation, OrbitProblem, rounding
from .extended_system import (
    EPSILON,
    FIRST_ORDER,
    Assembled,
    ExtendedSystem,
    Solution,
    rounding_of_length,
    rounding_of_product,
    solve,
)
from .orbit_test import OrbitPoint

UPRIGHT = 1e-6
"""A branch whose direction at a branch point changes the parameter by less is not told from one
that stands upright there: their folds lie within the square of this."""

BESIDE = 1e-3
"""How near to such a branch point a fold is not told from it."""


class Crossing(ExtendedSystem):
    """Two branches cross, with respect to the first free parameter; nu measures how far from it."""

    def start(self, here: Linearisation) -> Array:
        n = self.problem.n
        return np.concatenate([[0.0], np.linalg.svd(here.jacobian[:, : n + 1])[0][:, -1]])

    def assemble(self, here: Linearisation, own: Array) -> Assembled:
        problem, n = self.problem, self.problem.n
        orbit = len(here.unknowns)
        nu, psi = own[0], own[1:]
        square = here.jacobian[:, : n + 1]
        hessian = np.vstack(
            [psi @ problem.second_along(here.unknowns, e) for e in np.eye(orbit)[: n + 1]]
        )
        jacobian = np.zeros((2 * n + 2, orbit + n + 1))
        jacobian[:n, :orbit] = here.jacobian
        jacobian[:n, orbit] = psi
        jacobian[:n, orbit + 1 :] = nu * np.eye(n)
        jacobian[n : 2 * n + 1, :orbit] = hessian
        jacobian[n : 2 * n + 1, orbit + 1 :] = square.T
        jacobian[2 * n + 1, orbit + 1 :] = 2.0 * psi
        return Assembled(
            np.concatenate([here.residual + nu * psi, square.T @ psi, [psi @ psi - 1.0]]), jacobian
        )

    def rounding(self, here: Linearisation, own: Array) -> Array:
        bounds, n, psi = rounding(here), self.problem.n, own[1:]
        shifted = bounds.residual + EPSILON * (np.abs(here.residual) + np.abs(own[0] * psi))
        product = rounding_of_product(
            here.jacobian[:, : n + 1].T, bounds.jacobian[:, : n + 1].T, psi
        )
        return np.concatenate([shifted, product, [2.0 * rounding_of_length(psi)]])

    def nu_error(self, solution: Solution) -> float:
        """Bound the error of nu by its row of the inverse Jacobian, as that of the parameter."""
        orbit = len(solution.unknowns)
        here = self.problem.evaluate(solution.unknowns)
        at = self.assemble(here, solution.own)
        try:
            row = np.linalg.solve(at.jacobian.T, np.eye(len(at.residual))[orbit])
        except np.linalg.LinAlgError:
            return float("inf")
        off = FIRST_ORDER * np.abs(at.residual) + self.rounding(here, solution.own)
        return float(np.abs(row) @ off)


def unfolding(system: Crossing, solution: Solution) -> dict[str, float]:
    """Return what unfolds a crossing of branches, with its error."""
    return {"nu": float(solution.own[0]), "nu_error": system.nu_error(solution)}


def crossed(details: Details) -> bool:
    """Whether branches cross, as far as can be told."""
    return abs(details["nu"]) <= details["nu_error"]


def meeting(problem: Problem[Linearisation], guess: OrbitPoint, scale: Array) -> Meeting | None:
    """Return where two branches cross, or pass each other, next to a point; None if nowhere.

    Parameters
    ----------
    problem : Problem
        Of orbits.
    guess : Point
    scale : ndarray of shape (n + 1,)
        Sizes of the unknowns, by which the distance is measured.
    """
    orbits = guess.evaluation.problem
    system = Crossing(orbits)
    solution = solve(system, guess.evaluation)
    if solution is None:
        return None
    told = unfolding(system, solution)
    sizes, _ = np.linalg.eigh(form_at(orbits, solution, scale)[0])
    if not sizes[0] < 0.0 < sizes[1]:
        return None
    own, other = abs(sizes[::-1] if told["nu"] > 0.0 else sizes).tolist()
    return Meeting(solution.unknowns, told["nu"], told["nu_error"], (own, other))


def form_at(problem: OrbitProblem, solution: Solution, scale: Array) -> tuple[Array, Array]:
    """Return the form psi . F_zz on the null space of a crossing, and the null vectors in rows."""
    psi, here = solution.own[1:], problem.evaluate(solution.unknowns)
    null = np.linalg.svd(here.jacobian * scale)[2][-2:] * scale
    along = [psi @ problem.second_along(solution.unknowns, vector) for vector in null]
    form = np.array([[float(row @ vector) for vector in null] for row in along])
    return 0.5 * (form + form.T), null


def stands_upright(point: OrbitPoint) -> bool:
    """Whether two branches cross at a point, one of them with the parameter at rest."""
    problem = point.evaluation.problem
    system = Crossing(problem)
    solution = solve(system, point.evaluation)
    if solution is None or not crossed(unfolding(system, solution)):
        return False
    if np.max(np.abs(solution.unknowns - point.unknowns)) > BESIDE:
        return False
    form, null = form_at(problem, solution, np.ones(len(point.unknowns)))
    upright = null @ np.eye(len(point.unknowns))[-1]  # a direction at right angles to this is
    size = float(np.linalg.norm(upright))
    if size == 0.0:
        return True
    sideways = np.array([-upright[1], upright[0]]) / size
    return abs(float(sideways @ form @ sideways)) <= UPRIGHT * float(np.max(np.abs(form)))
