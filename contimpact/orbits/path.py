"""The motion along an orbit, for pictures and time series."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..arrays import Array
from ..segments.arithmetic import ARRAYS, evaluate_in

if TYPE_CHECKING:
    from .linearisation import Linearisation


class Path(NamedTuple):
    """The motion along an orbit's period.

    Attributes
    ----------
    t, x, v : ndarray of shape (N * points,)
        Times, gap coordinate and its velocity, flight by flight: velocities jump at impacts.
    """

    t: Array
    x: Array
    v: Array


def path_of(here: Linearisation, points: int = 200) -> Path:
    """Return the motion from an orbit's first impact until that impact returns."""
    problem = here.problem
    values = problem.values(here.unknowns)
    rows = problem.impacts(here.unknowns).tolist()
    ends = [row[0] for row in rows[1:]] + [rows[0][0] + here.span]
    walls, begin = positions(here), rows[0][0] if rows and problem.autonomous else 0.0
    parts = []
    for wall, row, end in zip(problem.word.walls, rows, ends, strict=True):
        dt = np.linspace(0.0, end - row[0], points)
        motion = evaluate_in(problem.kernels.motion(wall), ARRAYS)
        x, v = motion(*(value + 0.0 * dt for value in row), dt, *values)[:2]
        parts.append((row[0] - begin + dt, walls[wall] + x, v))
    return Path(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def positions(here: Linearisation) -> dict[str, float]:
    """Return the positions of the walls at an orbit's parameter values, by name."""
    problem = here.problem
    setup = problem.kernels.setup(*problem.values(here.unknowns))
    names = (wall.name for wall in problem.model.WALLS)
    return {name: float(x) for name, x in zip(names, setup.walls, strict=True)}
