"""Cycles of motions with one coordinate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from ..orbits.multipliers import roots
from ..simulation.run import Run, State
from ..simulation.simulator import Simulator
from .cycle import NEAR, Cycle, Map, shortest_closed


def cycle_of_one(simulator: Simulator, run: Run, longest: int) -> tuple[Cycle, float] | None:
    """Return the stable cycle near the end of a run, and the distance to it."""
    if run.released.any():
        return sticking_cycle_of_one(run)
    last = len(run) - 1
    first = max(0, last - longest)
    scale = float(np.max(np.abs(run.velocities))) or 1.0
    early = np.arange(first, last)
    apart = _apart(run.phases[early] - run.phases[last], run.period) / run.period
    apart = np.maximum(apart, np.abs(run.velocities[early] - run.velocities[last]) / scale)
    apart[run.walls[early] != run.walls[last]] = np.inf
    for back in early[apart < NEAR][::-1][:3]:
        cycle = shortest_closed(simulator, AROUND_ONE, run, int(last - back), _repetitions)
        if cycle is not None and abs(cycle.multipliers[0]) < 1.0:
            return cycle, _distance(run, cycle, scale)
    return None


def _apart(difference: Any, period: float) -> Any:
    """Distance between two phases on the circle."""
    return np.abs(difference - period * np.round(difference / period))


def _distance(run: Run, cycle: Cycle, scale: float) -> float:
    """Distance from the run's last impact to a cycle."""
    last = len(run) - 1
    times = _apart(cycle.times - run.phases[last], run.period) / run.period
    apart = np.maximum(times, np.abs(cycle.velocities - run.velocities[last]) / scale)
    return float(np.min(apart[cycle.walls == run.walls[last]], initial=math.inf))


def sticking_cycle_of_one(run: Run) -> tuple[Cycle, float] | None:
    """Return the cycle of a motion that sticks: released twice at one phase, it repeats itself."""
    releases = np.nonzero(run.released)[0]
    last = releases[-1]
    for first in releases[:-1][::-1]:
        same = run.walls[first] == run.walls[last] and run.phases[first] == run.phases[last]
        if same:
            rows = slice(first, last)
            times = (run.turns[rows] - run.turns[first]) * run.period + run.phases[rows]
            columns = (run.walls[rows], times, run.velocities[rows], run.released[rows])
            return Cycle(*columns, int(run.turns[last] - run.turns[first]), (0.0, 0.0), 0.0), 0.0
    return None


def _repetitions(cycle: Cycle, period: float) -> int:
    """How many times a cycle runs through a shorter one."""
    n, span = len(cycle.walls), cycle.period * period
    for parts in range(cycle.period, 1, -1):
        if n % parts or cycle.period % parts:
            continue
        shift = n // parts
        late = _apart(np.roll(cycle.times, -shift) - cycle.times - span / parts, span)
        faster = np.abs(np.roll(cycle.velocities, -shift) - cycle.velocities)
        same_walls = np.array_equal(np.roll(cycle.walls, -shift), cycle.walls)
        if same_walls and max(np.max(late), np.max(faster)) < 1e-7:
            return parts
    return 1


def _size(simulator: Simulator, state: State, miss: Sequence[float]) -> float:
    return max(abs(miss[0]) / simulator.period, abs(miss[1]))


def _step(
    simulator: Simulator, state: State, run: Run, miss: Sequence[float]
) -> Sequence[float] | None:
    """Solve (M - I) step = -miss."""
    m, _ = _product(simulator, state, run)
    a, b, c, d = m[0] - 1.0, m[1], m[2], m[3] - 1.0
    late, faster = miss
    det = a * d - b * c
    if det == 0.0:
        return None
    step = (b * faster - d * late) / det, (c * late - a * faster) / det
    return step if math.isfinite(step[0] + step[1]) else None


def _moved(simulator: Simulator, state: State, step: Sequence[float]) -> State:
    phase = (state.phase + step[0]) % simulator.period
    return State(state.wall, phase, state.velocity + step[1])


def _cycle(simulator: Simulator, state: State, run: Run, period: int, closing: float) -> Cycle:
    mus = _eigenvalues(*_product(simulator, state, run))
    return Cycle(*_impacts(state, run), period, mus, closing)


def _product(
    simulator: Simulator, state: State, run: Run
) -> tuple[tuple[float, float, float, float], float]:
    """The derivative of the map over a run, and its determinant."""
    a, b, c, d = 1.0, 0.0, 0.0, 1.0
    det, before = 1.0, state
    columns = (run.walls, run.phases, run.velocities, run.turns)
    for row in zip(*(column.tolist() for column in columns), strict=True):
        after = State(*row)
        tt, tv, vt, vv = simulator.derivative(before, after)
        a, b, c, d = tt * a + tv * c, tt * b + tv * d, vt * a + vv * c, vt * b + vv * d
        det *= tt * vv - tv * vt
        before = after
    return (a, b, c, d), det


def _eigenvalues(m: Sequence[float], det: float) -> tuple[complex, complex]:
    """The larger one first; the smaller one from the determinant."""
    a, b, c, d = roots(1.0, -(m[0] + m[3]), det, det)
    return complex(a, b), complex(c, d)


def _impacts(state: State, closed: Run) -> tuple[Array, Array, Array, Array]:
    """The impacts of a closed run, beginning with its start, as the columns of a cycle."""
    times = closed.turns * closed.period + closed.phases
    return (
        np.concatenate([[state.wall], closed.walls[:-1]]),
        np.concatenate([[state.phase], times[:-1]]),
        np.concatenate([[state.velocity], closed.velocities[:-1]]),
        np.zeros(len(closed), dtype=bool),
    )


AROUND_ONE = Map(_size, _step, _moved, _cycle)
