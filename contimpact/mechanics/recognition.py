"""When two sets of impacts are the same orbit: rotations of the word, and the model's symmetry."""

from __future__ import annotations

import numpy as np

from .model import Symmetry
from .orbit import Array, OrbitProblem
from .word import Word


def rotated_to(problem: OrbitProblem, unknowns: Array, word: Word) -> Array | None:
    """Return an orbit's unknowns with its first impact chosen so that it reads as `word`.

    None if the orbit's word is no rotation of it.
    """
    own = problem.word
    if own.period != word.period or len(own) != len(word):
        return None
    shift = (own.walls * 2).find(word.walls)
    if shift < 0:
        return None
    rows = problem.impacts(unknowns).copy()
    rows[:shift, 0] += own.period * problem.kernels.setup(*problem.values(unknowns))[0]
    rotated = unknowns.copy()
    rotated[:-1] = _rolled(rows, shift).ravel()
    return rotated


def mirrored(
    problem: OrbitProblem, unknowns: Array, symmetry: Symmetry
) -> tuple[OrbitProblem, Array]:
    """Return the image of an orbit under the model's symmetry, and its problem."""
    walls = "".join(symmetry.walls[wall] for wall in problem.word.walls)
    image = OrbitProblem(problem.model, Word(walls, problem.word.period), problem.kernels)
    rows = problem.impacts(unknowns).copy()
    rows[:, 0] += symmetry.shift * problem.kernels.setup(*problem.values(unknowns))[0]
    rows[:, 1:] *= symmetry.sign
    moved = unknowns.copy()
    moved[:-1] = rows.ravel()
    return image, moved


def repeats(problem: OrbitProblem, unknowns: Array, tolerance: float) -> bool:
    """Whether an orbit is one of fewer periods, run several times."""
    word = problem.word
    span = word.period * problem.kernels.setup(*problem.values(unknowns))[0]
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
            return True
    return False


def _rolled(rows: Array, shift: int) -> Array:
    return np.roll(rows, -shift, axis=0)
