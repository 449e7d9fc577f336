"""The orbit without what vanishes on it: an impact of zero velocity, or a flight of no duration."""

from __future__ import annotations

import numpy as np

from ..models.guards import is_path
from ..models.word import Word
from ..orbits.problem import Array, Linearisation, OrbitProblem
from ..orbits.quiet import QuietProblem, problem_of
from ..orbits.search import solve_near
from .sliding import CROSSING, SWITCHING, at_once, at_zero_velocity, is_brief, merged

TOUCHING = 1e-6
"""A gap below this is a touch, where the orbit without impacts is that of a V."""


def vanishing(problem: OrbitProblem, impact: int) -> tuple[int, ...]:
    """Return the impacts that vanish with one: itself, and the next at the end of an excursion."""
    if impact in problem.excursions:
        return impact, (impact + 1) % len(problem.word)
    return (impact,)


def without(here: Linearisation, impact: int) -> tuple[OrbitProblem, Array] | None:
    """The problem of the word without an impact of zero velocity, and the same orbit in it.

    None if no impact is left, and the motion without any has no orbit that touches there, or if the
    modes on both sides of the impact are not the same.
    """
    problem, dropped = here.problem, vanished(here, impact)
    before = (impact - 1) % len(problem.word)
    if at_zero_velocity(problem, here.unknowns, impact) == SWITCHING:
        return merged(problem, here.unknowns, before)
    if len(problem.word) == len(dropped):
        return _quiet(here, impact)
    word = problem.word.drop(*dropped)
    if not is_path(problem.model.WALLS, word.walls):
        return None
    shorter = problem_of(problem.model, word, problem.kernels)
    kept = np.delete(problem.impacts(here.unknowns), dropped, axis=0)
    return shorter, shorter.with_impacts(kept, here.span, here.unknowns)


def vanished(here: Linearisation, impact: int) -> tuple[int, ...]:
    """Return the same, with the impact at the other end of a flight that takes no time."""
    dropped = vanishing(here.problem, impact)
    problem, unknowns, count = here.problem, here.unknowns, len(here.problem.word)
    if len(dropped) == 1 < count and is_brief(problem, unknowns, impact):
        return impact, (impact + 1) % count
    before = (impact - 1) % count
    if at_once(problem, before) is not None and is_brief(problem, unknowns, before):
        return before, impact
    return dropped


def _quiet(here: Linearisation, impact: int) -> tuple[OrbitProblem, Array] | None:
    """The word `0` and its orbit, if that touches where the only impact vanishes."""
    problem, wall = here.problem, here.problem.word.walls[impact]
    quiet = problem_of(problem.model, Word("", problem.word.period), problem.kernels)
    assert isinstance(quiet, QuietProblem)
    guess = quiet.from_touch(problem, here.unknowns, impact)
    found = solve_near(quiet, np.append(guess, here.unknowns[-problem.free :]))
    touches = () if found is None else found.gaps[0].touches
    if any(t is not None and t.wall == wall and abs(t.gap) < TOUCHING for t in touches):
        return quiet, found.unknowns  # type: ignore[union-attr]
    return None


def without_flight(here: Linearisation, flight: int) -> tuple[OrbitProblem, Array] | None:
    """The same for a flight that takes no time, where sliding vanishes or begins with it."""
    found = at_once(here.problem, flight)
    if found in (CROSSING, SWITCHING):
        return merged(here.problem, here.unknowns, flight)
    return None if found is None else without(here, flight)
