"""Cycles of the simulated map: where a motion repeats itself, and Newton's iteration for it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..orbits.cyclic_multipliers import roots
from ..simulation.run import Run, State
from ..simulation.simulator import Simulator

NEAR = 1e-4
"""A motion this close to an earlier impact may be periodic; in periods and largest velocities."""


@dataclass(frozen=True, eq=False)
class Cycle:
    """One period of a motion that repeats itself.

    Attributes
    ----------
    walls, released : ndarray of shape (N,)
    times, velocities : ndarray of shape (N,)
        Times from the start of the first impact's period.
    period : int
        In forcing periods.
    multipliers : tuple of float or complex
        Of the map over the period, the largest first; of one degree of freedom both are zero if the
        body sticks.
    closing : float
        By how much the last impact misses the first.
    others : ndarray of shape (N, n)
        The other section coordinates; n is zero for one degree of freedom.
    held : ndarray of int, shape (N,)
        The walls held before each row, of several.
    """

    walls: Array
    times: Array
    velocities: Array
    released: Array
    period: int
    multipliers: tuple[complex, ...]
    closing: float
    others: Array = field(default_factory=lambda: np.zeros((0, 0)))
    held: Array = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def state(self, forcing_period: float) -> State:
        """Return a state on the cycle: its fastest impact."""
        k = int(np.argmax(np.abs(self.velocities)))
        state = State(int(self.walls[k]), float(self.times[k]), float(self.velocities[k]))
        if self.held.size:
            others = tuple(self.others[k].tolist())
            state = replace(state, others=others, held=int(self.held[k]))
        return replace(state.within(forcing_period), turns=0)


def cycle_near(simulator: Simulator, run: Run, longest: int) -> tuple[Cycle, float] | None:
    """Return the stable cycle near the end of a run, and the distance to it."""
    if run.released.any():
        return sticking_cycle(run)
    last = len(run) - 1
    first = max(0, last - longest)
    scale = float(np.max(np.abs(run.velocities))) or 1.0
    early = np.arange(first, last)
    apart = _apart(run.phases[early] - run.phases[last], run.period) / run.period
    apart = np.maximum(apart, np.abs(run.velocities[early] - run.velocities[last]) / scale)
    apart[run.walls[early] != run.walls[last]] = np.inf
    for back in early[apart < NEAR][::-1][:3]:
        cycle = _polished(simulator, run, int(last - back))
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


def sticking_cycle(run: Run) -> tuple[Cycle, float] | None:
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


def _polished(simulator: Simulator, run: Run, impacts: int) -> Cycle | None:
    """The cycle of so many impacts near the end of a run, or of fewer if that repeats itself."""
    rows = np.arange(len(run) - impacts, len(run))
    base = int(rows[np.argmax(np.abs(run.velocities[rows]))])
    state = State(int(run.walls[base]), float(run.phases[base]), float(run.velocities[base]))
    turned = run.times[-1] - run.times[-1 - impacts]
    cycle = polish(simulator, state, impacts, round(float(turned) / run.period))
    if cycle is None:
        return None
    parts = _repetitions(cycle, simulator.period)
    if parts == 1:
        return cycle
    state = cycle.state(simulator.period)
    return polish(simulator, state, impacts // parts, cycle.period // parts)


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


def polish(simulator: Simulator, state: State, impacts: int, period: int) -> Cycle | None:
    """Solve for the cycle near a state by Newton's iteration on the simulated map.

    Parameters
    ----------
    simulator : Simulator
    state : State
        An impact near the cycle.
    impacts, period : int
        Of the cycle; the period in forcing periods.

    Returns
    -------
    Cycle or None
        None if the iteration leaves the word or does not converge.
    """
    best, word = math.inf, None
    for _ in range(12):
        closed = simulator.run(state, impacts=impacts)
        walls, end = closed.walls.tolist(), closed.end
        left = len(closed) < impacts or closed.released.any() or word not in (None, walls)
        if left or end is None or end.wall != state.wall:
            return None
        word = walls
        late = (end.turns - period) * simulator.period + end.phase - state.phase
        faster = end.velocity - state.velocity
        miss = max(abs(late) / simulator.period, abs(faster))
        m, det = _product(simulator, state, closed)
        if miss < 1e-15 or (miss >= 0.5 * best and miss < 1e-11):
            return Cycle(*_impacts(state, closed), period, _eigenvalues(m, det), miss)
        step = _newton(m, late, faster)
        if miss > 10.0 * best or step is None or not math.isfinite(step[0] + step[1]):
            return None
        best = min(best, miss)
        phase = (state.phase + step[0]) % simulator.period
        state = State(state.wall, phase, state.velocity + step[1])
        if state.velocity * simulator.sides[state.wall] <= 0.0:
            return None
    return None


def _newton(m: Sequence[float], late: float, faster: float) -> tuple[float, float] | None:
    """Solve (M - I) step = -(late, faster)."""
    a, b, c, d = m[0] - 1.0, m[1], m[2], m[3] - 1.0
    det = a * d - b * c
    if det == 0.0:
        return None
    return (b * faster - d * late) / det, (c * late - a * faster) / det


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
