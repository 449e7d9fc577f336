"""Impacts at rest that are no event of their own: proven by the symmetry that makes them rest.

Where an orbit that is run twice grazes, it is at once an orbit of a longer word, in which one of
its touches counts as an impact of zero velocity, and the event of that word in which the other one
grazes.
A ball never proves a velocity to be zero. But the grazing of the orbit run once can be proven; made
into an orbit of the longer word it solves the equations of the event, and if it lies in the box in
which these have one solution, it is that solution: the velocity is zero.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from flint import arb

from ..models.word import Word
from ..orbits.problem import OrbitProblem
from . import quiet_rest
from .equations import BallProblem, Balls
from .krawczyk import proven


def resting(space: BallProblem, box: Balls, inner: Balls) -> list[int]:
    """Return the impacts of a grazing orbit that are proven to be at rest.

    Parameters
    ----------
    space : BallProblem
    box, inner : list of arb
        Where the grazing is the only one, and where it lies.
    """
    m, count = space.problem.m, len(space.problem.word)
    if not count or len(inner) == space.problem.n + 1:
        return []
    slow = [k for k in range(count) if inner[m * k + 1].contains(0)]
    return [k for k in slow if _rests(space, box, inner, k)]


def _rests(space: BallProblem, box: Balls, inner: Balls, impact: int) -> bool:
    """Whether the orbit without an impact is another one run several times, which grazes there."""
    problem, m = space.problem, space.problem.m
    if len(problem.word) == 1:
        return quiet_rest.rests(space, box, inner)
    once, times = _root(problem.word.drop(impact))
    if times == 1 or m != 2:
        return False
    base = BallProblem(OrbitProblem(problem.model, once, problem.kernels), space.bits)
    kept = [*inner[: m * impact], *inner[m * impact + m :]]
    z = np.array([float(x.mid()) for x in [*kept[: base.problem.n], inner[problem.n]]])
    span = base.problem.span(z)
    starts = z[: base.problem.n : m]
    first, time = starts[0], float(inner[m * impact].mid())
    time -= np.floor((time - first) / span) * span
    where = {
        "flight": int(np.searchsorted(starts, time)) - 1,
        "wall": problem.word.walls[impact],
        "touch_time": time,
    }
    system, own = base.grazing(z, where)
    found = proven(base, system, [*z.tolist(), *own])
    return found is not None and _same(base, found[1], times, box, impact)


def _root(word: Word) -> tuple[Word, int]:
    """A word as another one that is repeated, and how often."""
    for times in range(len(word), 1, -1):
        part, left = divmod(len(word), times)
        if not left and word.period % times == 0 and word.walls == word.walls[:part] * times:
            return Word(word.walls[:part], word.period // times), times
    return word, 1


def _same(base: BallProblem, z: Balls, times: int, box: Balls, impact: int) -> bool:
    """Whether a grazing orbit, run several times with one touch as an impact and another one as
    the event, lies in a box."""
    n = base.problem.n
    span, touch = base.span(z[: n + 1]), z[n + 1]
    rows = [
        [row[0] + copy * span, *row[1:]]
        for copy in range(times)
        for row in base.impacts(z[: n + 1])[:-1]
    ]
    for copy in range(-1, times + 1):
        moved: list[Any] = [*rows[:impact], [touch + copy * span, arb(0)], *rows[impact:]]
        whole = [x for row in moved for x in row] + [z[n]]
        for other in range(-1, times + 1):
            given = [*whole, touch + other * span]
            if other != copy and all(b.contains(x) for b, x in zip(box, given, strict=True)):
                return True
    return False
