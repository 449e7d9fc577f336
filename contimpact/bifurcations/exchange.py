"""Where impacts on different coordinates exchange their order: the same orbit on the word beyond.

At a T two impacts, or more of them, happen at once. Beyond it they come in another order, and each
may end another mode and have another letter there: the one of the same surface. If their resets
commute, the orbit of the exchanged word passes through the same point of state space, and its
equations are regular there. If they do not, it does not pass, and nothing continues the motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from ..models.guards import Guard
from ..models.word import Word
from ..orbits.problem import Array, Linearisation, OrbitProblem
from ..orbits.quiet import problem_of
from .sliding import guard_at, is_brief
from .touching import arrived

SAME_STATE = 1e-7
"""An orbit passes through a state if its equations hold there within this part of their size."""

SAME_RATE = 6
"""Digits to which the rates agree of impacts that keep happening at once."""


def exchanged_word(here: Linearisation, flight: int, rates: Array) -> Word | None:
    """Return the word beyond a flight that takes no time, its impacts in the order they have there.

    None if impacts only merge: those at both ends are on one surface, or no letters say so.

    Parameters
    ----------
    here : Linearisation
    flight : int
    rates : ndarray of shape (N,)
        How fast each flight's duration changes along the branch, up to a common factor.
    """
    problem, letters = here.problem, list(here.problem.word.walls)
    runs = list(_at_once(problem, here.unknowns))
    if not rates[flight] or not any(flight in impacts[:-1] for impacts in runs):
        return None
    for impacts in runs:
        times = np.append(0.0, np.cumsum([rates[k] for k in impacts[:-1]]))
        later = np.round(times / rates[flight], SAME_RATE)  # beyond, the last comes first
        order = [impacts[i] for i in np.argsort(-later, kind="stable")]
        if order != impacts:
            spelled = _spelled(problem, here.unknowns, impacts, order)
            if spelled is None:
                return None
            for k, letter in zip(impacts, spelled, strict=True):
                letters[k] = letter
    word = Word("".join(letters), problem.word.period)
    return None if word == problem.word else word


def exchanged(here: Linearisation, word: Word) -> tuple[OrbitProblem, Array] | None:
    """Return the problem of the word beyond, and the same orbit in it; None if it is none of it."""
    problem, span = here.problem, here.span
    there = problem_of(problem.model, word, problem.kernels)
    values, rows = problem.values(here.unknowns), problem.impacts(here.unknowns)
    moved = rows.copy()
    for impacts in _at_once(problem, here.unknowns):
        before = (impacts[0] - 1) % len(word)
        letter, left = problem.word.walls[before], rows[before].tolist()
        left[0] -= span * (impacts[0] == 0)
        time = float(rows[impacts[0], 0])
        for k in impacts:
            segment = problem.kernels.segment(letter, word.walls[k])
            left = arrived(segment, left, values, time)
            moved[k, 1:] = left[1:]
            letter = word.walls[k]
    unknowns = there.with_impacts(moved, span, here.unknowns)
    size = float(np.max(np.abs(rows[:, 1:])))
    missed = there.evaluate(unknowns).largest_residual
    return (there, unknowns) if missed < SAME_STATE * size else None


def _at_once(problem: OrbitProblem, unknowns: Array) -> Iterator[list[int]]:
    """The impacts that happen at once, in order, those of each instant."""
    count = len(problem.word)
    brief = [is_brief(problem, unknowns, k) for k in range(count)]
    for first in (k for k in range(count) if brief[k] and not brief[k - 1]):
        impacts = [first]
        while brief[impacts[-1]]:
            impacts.append((impacts[-1] + 1) % count)
        yield impacts


def _spelled(
    problem: OrbitProblem, unknowns: Array, impacts: Sequence[int], order: Sequence[int]
) -> str | None:
    """The letters of impacts in another order: a way through the modes along the same surfaces."""
    model = problem.model
    size = model.DEGREES_OF_FREEDOM
    setup = problem.kernels.setup(*problem.values(unknowns))
    places = dict(zip(model.letters, setup.walls, strict=True))

    def same(one: Guard, other: Guard) -> bool:
        near = math.isclose(places[one.name], places[other.name], rel_tol=1e-12, abs_tol=1e-300)
        return near and (one.side, one.row(size)) == (other.side, other.row(size))

    met = [guard_at(problem, k) for k in order]
    if len({guard.row(size) for guard in met}) < len(met):
        return None
    ways = [("", guard_at(problem, impacts[0] - 1).next_mode)]
    for guard in met:
        own_first = sorted(model.WALLS, key=lambda g: g.name != guard.name)
        ways = [
            (way + g.name, g.next_mode)
            for way, mode in ways
            for g in own_first
            if mode in g.modes and same(g, guard)
        ]
    target = guard_at(problem, impacts[-1]).next_mode
    return next((way for way, mode in ways if mode == target), None)
