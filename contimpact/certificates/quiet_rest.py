"""An impact at rest without which the orbit has none: proven by the grazing of the word `0`.

The orbit without impacts that grazes once a period, run over several of them, is at once an orbit
of a word with one impact of zero velocity, at one of its touches, which grazes at another one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..models.word import Word
from ..orbits.quiet import problem_of
from ..orbits.search import solve_near
from .equations import BallProblem, Balls
from .krawczyk import proven
from .quiet import QuietBalls


def rests(space: BallProblem, box: Balls, inner: Balls) -> bool:
    """Return whether the only impact of a grazing orbit is proven to be at rest.

    Parameters
    ----------
    space : BallProblem
        Of a word with one impact.
    box, inner : list of arb
        Where the grazing is the only one, and where it lies.
    """
    problem, m = space.problem, space.problem.m
    word = problem.word
    guard = problem.model.guard(word.walls[0])
    if word.period == 1 or not guard.rigid:
        return False
    base = problem_of(problem.model, Word("", 1), problem.kernels)
    touch = [float(x.mid()) for x in inner[:m]]
    start = solve_near(base, np.append(np.zeros(base.m), float(inner[m].mid())))
    if start is None:
        return False
    state = start.unknowns
    period = base.span(state)
    where = {"wall": guard.name, "touch_time": touch[0] % period}
    quiet = QuietBalls(base, space.bits)
    system, own = quiet.grazing(state, where)
    found = proven(quiet, system, [*state.tolist(), own[0], *touch[2:]])
    return found is not None and _same(quiet, found[1], word.period, box)


def _same(base: BallProblem, z: Balls, times: int, box: Sequence[Any]) -> bool:
    """Whether the grazing, with one touch as an impact and another one as the event, lies in a
    box."""
    n = base.problem.n
    value, touch, others, span = z[n], z[n + 1], z[n + 2 :], base.span(z[: n + 1])
    copies = range(-1, times + 1)
    first = round(float((box[0] - touch).mid()) / float(span.mid()))
    for event in (first + copy for copy in copies if copy):
        given = [touch + first * span, 0, *others, value, touch + event * span, *others]
        if all(b.contains(x) for b, x in zip(box, given, strict=True)):
            return True
    return False
