"""When two sets of impacts are the same orbit: rotations of the word, and the model's symmetry."""

from __future__ import annotations

import numpy as np

from ..models.model import Symmetry
from ..models.word import Word
from .problem import Array, OrbitProblem
from .quiet import problem_of


def rotated_to(problem: OrbitProblem, unknowns: Array, word: Word) -> Array | None:
    """Return an orbit's unknowns with its first impact chosen so that it reads as `word`.

    None if the orbit's word is no rotation of it.
    """
    own = problem.word
    if own.period != word.period or len(own) != len(word):
        return None
    if not own.walls:
        return unknowns
    shift = (own.walls * 2).find(word.walls)
    if shift < 0:
        return None
    rows = problem.impacts(unknowns).copy()
    span = problem.span(unknowns)
    rows[:shift, 0] += span
    return problem.with_impacts(_rolled(rows, shift), span, unknowns)


def mirrored(
    problem: OrbitProblem, unknowns: Array, symmetry: Symmetry
) -> tuple[OrbitProblem, Array]:
    """Return the image of an orbit under the model's symmetry, and its problem."""
    walls = "".join(symmetry.walls[wall] for wall in problem.word.walls)
    image = problem_of(problem.model, Word(walls, problem.word.period), problem.kernels)
    rows = problem.impacts(unknowns).copy()
    rows[:, 0] += symmetry.shift * problem.period(unknowns)
    rows[:, 1:] *= symmetry.sign
    return image, image.with_impacts(rows, problem.span(unknowns), unknowns)


def repeats(problem: OrbitProblem, unknowns: Array, tolerance: float) -> bool:
    """Whether an orbit is one of fewer periods, run several times."""
    return _shortest_shift(problem, unknowns, tolerance) is not None


def shortest(
    problem: OrbitProblem, unknowns: Array, tolerance: float
) -> tuple[OrbitProblem, Array]:
    """Return an orbit as one of its shortest period, itself if it repeats none."""
    shift = _shortest_shift(problem, unknowns, tolerance)
    if shift is None:
        return problem, unknowns
    word = Word(problem.word.walls[:shift], problem.word.period * shift // len(problem.word))
    first = problem_of(problem.model, word, problem.kernels)
    return first, first_lap(problem, unknowns, shift)


def first_lap(problem: OrbitProblem, unknowns: Array, impacts: int) -> Array:
    """Return the first of several laps of so many impacts, as an orbit of its own, or that part of
    a direction."""
    rows = problem.impacts(unknowns)
    lap = rows[:impacts].copy()
    if problem.autonomous:  # it closes at t = 0
        lap[:, 0] -= rows[impacts, 0]
    return np.append(lap.ravel(), unknowns[problem.n :])


def _shortest_shift(problem: OrbitProblem, unknowns: Array, tolerance: float) -> int | None:
    """How many impacts the orbit repeats after, None if only after all."""
    word = problem.word
    span = problem.span(unknowns)
    rows = problem.impacts(unknowns)
    n = len(word)
    for shift in word.rotations()[1:]:
        if word.period * shift % n:
            continue
        later = rows.copy()
        later[:shift, 0] += span
        later = _rolled(later, shift)
        later[:, 0] -= span * shift / n
        if abs(later - rows).max() < tolerance:
            return shift
    return None


def _rolled(rows: Array, shift: int) -> Array:
    return np.roll(rows, -shift, axis=0)
