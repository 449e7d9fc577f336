r"""Whether branches cross at a branch point: proven by the symmetry that makes them cross.

The equations of a branch point, F + nu psi = 0, J^T psi = 0, \|psi\| = 1, have a solution nearby if
branches only pass each other. They cross if nu is zero, which a ball never proves. But let S take
orbits to orbits of the same word, F(Sz) = S F(z): the mirror image, or the orbit begun some periods
later. With (z, nu, psi) also (Sz, -nu, -S psi) is a solution; if that lies in the box in which
there is only one, it is the same, and nu = -nu.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from flint import arb

from ..orbits.problem import OrbitProblem
from .equations import BallProblem, Balls


def crosses(space: BallProblem, box: Balls, inner: Balls) -> bool:
    """Return whether nu is proven to be zero.

    Parameters
    ----------
    space : BallProblem
    box, inner : list of arb
        Where the branch point's equations have one solution, and where that lies.
    """
    return any(
        all(b.contains(x) for b, x in zip(box, image, strict=True))
        for image in _images(space, box, inner)
    )


def _images(space: BallProblem, box: Balls, inner: Balls) -> Iterator[Balls]:
    """The solutions that symmetries make of one, with nu and psi reversed."""
    problem, m, n = space.problem, space.problem.m, space.problem.n
    value, nu, psi = inner[n], inner[n + 1], inner[n + 2 :]
    word, span = problem.word.walls, space.span(inner[: n + 1])
    period = space.setup(space.values(inner[: n + 1])).period
    for walls, shift, sign in _symmetries(problem):
        letters = "".join(walls[letter] for letter in word)
        rows = [
            [t + arb(shift) * period, *(arb(sign) * y for y in ys)] for t, *ys in _rows(inner, m, n)
        ]
        for first in range(len(word)):
            if letters[first:] + letters[:first] != word:
                continue
            moved = [*rows[first:], *([t + span, *ys] for t, *ys in rows[:first])]
            late = round(float((moved[0][0] - box[0]).mid()) / float(period.mid()))
            flat = [x for t, *ys in moved for x in (t - late * period, *ys)]
            parts = [[-arb(sign) * w for w in row] for row in _rows(psi, m, n)]
            back = [w for row in (*parts[first:], *parts[:first]) for w in row]
            yield [*flat, value, -nu, *back]


def _rows(numbers: Sequence[Any], m: int, n: int) -> list[Balls]:
    return [list(numbers[i : i + m]) for i in range(0, n, m)]


def _symmetries(problem: OrbitProblem) -> Iterator[tuple[Mapping[str, str], float, float]]:
    """Walls exchanged, shift in periods, and sign."""
    model = problem.model
    yield {wall.name: wall.name for wall in model.WALLS}, 0.0, 1.0
    harmonics = problem.kernels.harmonics(*model.values.values())
    mirror = model.symmetry(problem.parameter, harmonics)
    if mirror is not None:
        yield mirror.walls, mirror.shift, mirror.sign
