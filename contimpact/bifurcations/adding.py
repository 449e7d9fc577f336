"""Where an interruption of sliding vanishes: adding-sliding, seen from the orbit that has it.

What leaves sliding does so at rest, so that the equations of that orbit are singular there. Those
of the orbit without the interruption are not: it touches a limit of sliding.
"""

from __future__ import annotations

import numpy as np

from ..continuation.branch import Details, Located
from ..models.guards import is_path
from ..orbits.problem import Array, OrbitProblem
from ..orbits.quiet import problem_of
from .extended_system import solve
from .orbit_test import OrbitPoint
from .sliding import ADDING, at_once
from .touching import Touching, arrived

BESIDE = 0.1
"""How near to its guess it is, in the sizes of the unknowns."""


def where_added(guess: OrbitPoint, flight: int, details: Details) -> Located | None:
    """Return where a flight between two pieces of sliding vanishes; None if nowhere near.

    Parameters
    ----------
    guess : Point
    flight : int
        That leaves sliding and comes back to it.
    details : dict
        What to record of it.
    """
    problem, unknowns = guess.evaluation.problem, guess.unknowns
    ends = flight, (flight + 1) % len(problem.word)
    word = problem.word.drop(*ends)
    possible = at_once(problem, flight) == ADDING and word.walls
    if not possible or not is_path(problem.model.WALLS, word.walls):
        return None
    without = problem_of(problem.model, word, problem.kernels)
    system = _touching(problem, without, unknowns, ends)
    rest = np.delete(problem.impacts(unknowns), ends, axis=0)
    begin = without.with_impacts(rest, guess.evaluation.span, unknowns)
    solution = solve(system, without.evaluate(begin))
    if solution is None:
        return None
    found = _with(problem, without, solution.unknowns, system.touch(solution.own), ends)
    sizes = problem.scale(unknowns, np.full(problem.free, np.inf))
    if not np.linalg.norm((found - unknowns) / sizes) < BESIDE:
        return None
    return Located(found, solution.residual, solution.error, details)


def _touching(
    problem: OrbitProblem, without: OrbitProblem, unknowns: Array, ends: tuple[int, int]
) -> Touching:
    """The equations of the orbit without the impacts at both ends, which touches there."""
    before = (ends[0] - 1) % len(problem.word)
    left = before - sum(end < before for end in ends)
    turn = problem.span(unknowns) if ends[0] == 0 else 0.0
    time = float(problem.impacts(unknowns)[ends[0], 0]) + turn
    return Touching(without, left, problem.word.walls[ends[0]], time)


def _with(
    problem: OrbitProblem,
    without: OrbitProblem,
    unknowns: Array,
    touch: Array,
    ends: tuple[int, int],
) -> Array:
    """The unknowns of that orbit with both impacts at the touch."""
    count, span = len(problem.word), without.span(unknowns)
    back = problem.kernels.segment(*(problem.word.walls[end] for end in ends))
    again = arrived(back, touch.tolist(), without.values(unknowns))
    rows = np.empty((count, problem.m))
    rows[list(ends)] = touch, again
    rows[[k for k in range(count) if k not in ends]] = without.impacts(unknowns)
    rows[ends[0], 0] -= span * (ends[0] == 0)
    rows[ends[1], 0] -= span * (ends[0] in (0, count - 1))
    return np.append(rows.ravel(), unknowns[-problem.free :])
