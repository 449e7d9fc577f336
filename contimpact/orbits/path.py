"""The motion along an orbit, for pictures and time series."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..models.guards import state_before
from ..segments.arithmetic import ARRAYS, evaluate_in
from ..segments.layout import SECTION
from ..segments.track import track_of

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
    parts: list[tuple[Any, ...]] = []
    for wall, row, end in zip(problem.word.walls, rows, ends, strict=True):
        dt = np.linspace(0.0, end - row[0], points)
        if (states := _long(here, len(parts), dt)) is not None:
            guard = next(g for g in problem.model.WALLS if g.name == wall)
            factors = np.array(guard.row(problem.model.DEGREES_OF_FREEDOM), dtype=float)
            x, v = (part @ factors for part in states)
        else:
            motion = evaluate_in(problem.kernels.motion(wall), ARRAYS)
            x, v = motion(*(value + 0.0 * dt for value in row), dt, *values)[:2]
            x = walls[wall] + x
        parts.append((row[0] - begin + dt, x, v))
    return Path(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def positions(here: Linearisation) -> dict[str, float]:
    """Return the positions of the walls at an orbit's parameter values, by name."""
    problem = here.problem
    setup = problem.kernels.setup(*problem.values(here.unknowns))
    places = zip(problem.model.letters, setup.walls, strict=True)
    return {name: float(x) for name, x in places}


def motion_of(here: Linearisation, points: int = 200) -> Path:
    """Return the motion of all coordinates along an orbit's period; `x` and `v` have a column for
    each. Without impacts it begins at t = 0."""
    problem = here.problem
    rows = problem.impacts(here.unknowns).tolist()
    if not rows:
        dt = np.linspace(0.0, here.span, points)
        state, wall = here.unknowns[: problem.m].tolist(), problem.model.WALLS[0].name
        if (states := _long(here, 0, dt)) is not None:
            return Path(dt, *states)
        return Path(dt, *_by_segment(here, SECTION, wall, state, 0.0, dt))
    walls = problem.word.walls
    parts = []
    for k, (wall, row) in enumerate(zip(walls, rows, strict=True)):
        dt = np.linspace(0.0, np.subtract(*problem.times_around(here.unknowns, k)[::-1]), points)
        if (states := _long(here, k, dt)) is not None:
            x, v = states
        elif problem.kernels.linear(wall):
            x, v = _on_track(here, wall, row, dt)
        else:
            x, v = _by_segment(here, wall, walls[(k + 1) % len(walls)], row, row[0], dt)
        parts.append((row[0] + dt, x, v))
    return Path(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def _long(here: Linearisation, flight: int, dt: Array) -> tuple[Array, Array] | None:
    """Positions and velocities of all coordinates along a flight that is computed in pieces."""
    problem, z = here.problem, here.unknowns
    left, leave = problem.leaving(z, flight)
    if not problem.kernels.integrated(left):
        return None
    rows = [*problem.impacts(z).tolist(), z[: problem.m].tolist()]
    arrive = rows[flight + 1] if len(rows) > 1 else rows[0]
    if flight + 2 == len(rows):
        arrive[0] += here.span
    segment: Any = problem.segments[flight]
    track = segment.long_track(leave, arrive, problem.values(here.unknowns))
    if track is None:
        return None
    size = problem.model.DEGREES_OF_FREEDOM
    curves = [track.along(row) for row in np.eye(size).tolist()]
    found = np.array([[curve((), t, ())[:2] for curve in curves] for t in dt.tolist()])
    return found[:, :, 0], found[:, :, 1]


def _on_track(here: Linearisation, wall: str, row: list[float], dt: Array) -> tuple[Array, Array]:
    """Positions and velocities of all coordinates along a linear flight."""
    problem, size = here.problem, here.problem.model.DEGREES_OF_FREEDOM
    law = problem.kernels.law(wall)(*row, *problem.values(here.unknowns))
    if not dt[-1] > 0.0:
        states = np.tile(np.array(law[3], dtype=float), (len(dt), 1))
    else:
        track = track_of(law, float(dt[-1]))
        states = np.array([track.at(t) for t in dt.tolist()])
    return states[:, :size], states[:, size : 2 * size]


def _by_segment(
    here: Linearisation, left: str, wall: str, row: list[float], begin: float, dt: Array
) -> tuple[Array, Array]:
    """The same by the kernels of a flight to a wall: its gap coordinate, and what arrives there."""
    problem = here.problem
    values, kernels = problem.values(here.unknowns), problem.kernels
    guard = problem.model.guard(wall)
    gap = kernels.since(wall) if left == SECTION else kernels.gap(left, wall)
    segment, none = kernels.segment(left, wall), [0.0] * (problem.m - 1)
    found = []
    for t in dt.tolist():
        place, speed = gap(*row, t, *values)[:2]
        others = segment.blocks(row, [begin + t, *none], values)[0][2:] if problem.m > 2 else ()
        factors = guard.row(problem.model.DEGREES_OF_FREEDOM)
        found.append(state_before(factors, place, [speed, *others]))
    x, v = np.array(found, dtype=float).transpose(1, 0, 2)
    return x, v
