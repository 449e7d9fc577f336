"""Whether branches of orbits cross, or pass each other: what unfolds the crossing, and its error.

The equations stand in `contimpact.continuation.crossing`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..continuation.branch import Point
from ..continuation.crossing import Meeting
from ..orbits.problem import Array
from .extended import Crossing, Solution, solve

UPRIGHT = 1e-6
"""A branch whose direction at a branch point changes the parameter by less is not told from one
that stands upright there: their folds lie within the square of this."""

BESIDE = 1e-3
"""How near to such a branch point a fold is not told from it."""


def unfolding(system: Crossing, solution: Solution) -> dict[str, float]:
    """Return what unfolds a crossing of branches, with its error."""
    return {"nu": float(solution.own[0]), "nu_error": system.nu_error(solution)}


def crossed(details: Mapping[str, Any]) -> bool:
    """Whether branches cross, as far as can be told."""
    return abs(details["nu"]) <= details["nu_error"]


def meeting(problem: Any, guess: Point, scale: Array) -> Meeting | None:
    """Return where two branches cross, or pass each other, next to a point; None if nowhere.

    Parameters
    ----------
    problem : OrbitProblem
    guess : Point
    scale : ndarray of shape (n + 1,)
        Sizes of the unknowns, by which the distance is measured.
    """
    system = Crossing(problem)
    solution = solve(system, guess.evaluation)
    if solution is None:
        return None
    told = unfolding(system, solution)
    sizes, _ = np.linalg.eigh(form_at(problem, solution, scale)[0])
    if not sizes[0] < 0.0 < sizes[1]:
        return None
    own, other = abs(sizes[::-1] if told["nu"] > 0.0 else sizes).tolist()
    return Meeting(solution.unknowns, told["nu"], told["nu_error"], (own, other))


def form_at(problem: Any, solution: Solution, scale: Array) -> tuple[Array, Array]:
    """Return the form psi . F_zz on the null space of a crossing, and the null vectors in rows."""
    psi, here = solution.own[1:], problem.evaluate(solution.unknowns)
    null = np.linalg.svd(here.jacobian * scale)[2][-2:] * scale
    along = [psi @ problem.second_along(solution.unknowns, vector) for vector in null]
    form = np.array([[float(row @ vector) for vector in null] for row in along])
    return 0.5 * (form + form.T), null


def stands_upright(point: Point) -> bool:
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
