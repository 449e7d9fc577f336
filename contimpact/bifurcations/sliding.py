"""Sliding bifurcations: which of them an event is, and the word beyond those of a crossing.

Sliding is motion in a mode whose state is smaller than the system's. There are four kinds (di
Bernardo, Budd, Champneys and Kowalczyk, Piecewise-smooth Dynamical Systems, 2008, chapter 8). With
S a guard that leads to sliding, C one that leads through the surface instead, P and A those at
which sliding ends on either side, and B one that leads to sliding from beyond, they are

=================  ========================================  ===========================
                   on the word without the new flight        on that with it
=================  ========================================  ===========================
grazing-sliding    G: a flight outside touches S             V at S; T of SP
adding-sliding     G: a flight that slides touches A         V at A, V at B; T of AB
switching-sliding  G where a flight begins: S slides from A  V at B; T of CB
crossing-sliding   G where a flight begins: C leads from A   T of SA
=================  ========================================  ===========================
"""

from __future__ import annotations

import numpy as np

from ..continuation.branch import Details
from ..models.guards import Guard, crosses_at, slides_at, state_size
from ..models.model import Model
from ..models.word import Word
from ..orbits.problem import Array, OrbitProblem
from ..orbits.quiet import problem_of
from ..segments.segment import ELSEWHERE
from ..segments.touches import on_surface
from .touching import arrived

GRAZING, ADDING = "grazing-sliding", "adding-sliding"
SWITCHING, CROSSING = "switching-sliding", "crossing-sliding"

INSTANT = 1e-9
"""A flight shorter than this part of the period takes no time."""


def slides(model: Model, mode: str) -> bool:
    """Whether the motion in a mode is sliding."""
    degrees = model.DEGREES_OF_FREEDOM
    here, first = (state_size(model.MODES, m, degrees) for m in (mode, model.first_mode))
    return here < first


def at_touch(problem: OrbitProblem, details: Details) -> str | None:
    """Return which sliding bifurcation a G is; None if it is none."""
    model = problem.model
    if "impact" in details:
        guard = guard_at(problem, details["impact"])
        if guard.past:
            return CROSSING
        begun = guard.name, details["wall"]
        slid = slides(model, guard.next_mode) and not on_surface(problem.kernels, *begun)
        return SWITCHING if slid else None
    touched = model.guard(details["wall"])
    if slides(model, touched.modes[0]):
        return ADDING
    return GRAZING if slides(model, touched.next_mode) else None


def at_zero_velocity(problem: OrbitProblem, unknowns: Array, impact: int) -> str | None:
    """Return which sliding bifurcation a V is."""
    guard = guard_at(problem, impact)
    if slides(problem.model, guard.modes[0]):
        return ADDING
    if not slides(problem.model, guard.next_mode):
        return None
    before = (impact - 1) % len(problem.word)
    return (at_once(problem, before) if is_brief(problem, unknowns, before) else None) or GRAZING


def at_once(problem: OrbitProblem, flight: int) -> str | None:
    """Return which sliding bifurcation a T is."""
    model = problem.model
    one, other = guard_at(problem, flight), guard_at(problem, flight + 1)
    if slides(model, one.next_mode):
        return GRAZING if one.modes[0] == other.next_mode else CROSSING
    if not slides(model, other.next_mode):
        return None
    if one.past:
        return SWITCHING
    return ADDING if slides(model, one.modes[0]) else None


def is_brief(problem: OrbitProblem, unknowns: Array, flight: int) -> bool:
    """Whether a flight takes no time."""
    begin, end = problem.times_around(unknowns, flight)
    return abs(end - begin) < INSTANT * problem.span(unknowns)


def guard_at(problem: OrbitProblem, impact: int) -> Guard:
    """Return the guard of an impact, counted around."""
    return problem.model.guard(problem.word.walls[impact % len(problem.word)])


# What an impact at which sliding begins on a limit becomes.


def longer(problem: OrbitProblem, impact: int, limit: str) -> str | None:
    """Return the two letters in the place of an impact's: SA for C, CB for S; None if not known."""
    guards, guard = problem.model.WALLS, guard_at(problem, impact)
    arrival = problem.kernels.arrival
    if guard.past:
        sliding = slides_at(guards, guard)
        return None if sliding is None else sliding.name + guard.past
    crossing = crosses_at(guards, guard, limit)
    if crossing is None:
        return None
    back = (g for g in guards if crossing.next_mode in g.modes and g.next_mode == guard.next_mode)
    letters = (g.name for g in back if arrival(crossing.name, g.name) != ELSEWHERE)
    letter = next(letters, None)
    return None if letter is None else crossing.name + letter


def shorter(problem: OrbitProblem, flight: int) -> str | None:
    """Return the letter in the place of those at both ends of a flight that takes no time."""
    guards = problem.model.WALLS
    one, other = guard_at(problem, flight), guard_at(problem, flight + 1)
    through = slides_at(guards, one) if one.past else crosses_at(guards, one, other.name)
    return through.name if through is not None and through.next_mode == other.next_mode else None


def respelled(word: Word, impact: int, letters: str, taken: int = 1) -> Word:
    """Return a word with other letters in the place of so many from an impact on."""
    kept = word.drop(*((impact + k) % len(word) for k in range(taken)))
    place = impact - sum((impact + k) % len(word) < impact for k in range(taken))
    return Word(kept.walls[:place] + letters + kept.walls[place:], word.period)


def lengthened(problem: OrbitProblem, unknowns: Array, impact: int, letters: str) -> Array:
    """Return the impacts of an orbit with two that take no time in the place of one."""
    rows = problem.impacts(unknowns)
    segment = problem.kernels.segment(*letters)
    added = arrived(segment, rows[impact].tolist(), problem.values(unknowns))
    return np.insert(rows, impact + 1, added, axis=0)


def merged(
    problem: OrbitProblem, unknowns: Array, flight: int
) -> tuple[OrbitProblem, Array] | None:
    """Return the problem with one impact in the place of the two at the ends of a flight that takes
    no time, and the same orbit in it; None if no letter says so."""
    letter, other = shorter(problem, flight), (flight + 1) % len(problem.word)
    if letter is None:
        return None
    word = respelled(problem.word, flight, letter, 2)
    there = problem_of(problem.model, word, problem.kernels)
    rows = np.delete(problem.impacts(unknowns), other, axis=0)
    return there, there.with_impacts(rows, problem.span(unknowns), unknowns)
