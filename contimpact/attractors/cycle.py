"""Cycles of the simulated map: where a motion repeats itself, and Newton's iteration for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..simulation.run import Run, State
from ..simulation.simulator import Simulator

CLOSED = 1e-15
"""A cycle that misses itself by less, in parts of its size, is closed; one that misses it by no
more than `ROUNDED` is where Newton's iteration gains nothing."""
ROUNDED = 1e-11

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


class Map(NamedTuple):
    """The simulated map around a cycle, for one section coordinate or several.

    Attributes
    ----------
    size : callable ``size(simulator, state, miss)``
        How large it is by what the end of a run misses its start: time and section coordinates.
    step : callable ``step(simulator, state, run, miss)``
        Newton's step, None if there is none.
    moved : callable ``moved(simulator, state, step)``
        The start after a step.
    cycle : callable ``cycle(simulator, state, run, period, closing)``
        A run that closes, as a cycle.
    """

    size: Callable[[Simulator, State, Sequence[float]], float]
    step: Callable[[Simulator, State, Run, Sequence[float]], Sequence[float] | None]
    moved: Callable[[Simulator, State, Sequence[float]], State]
    cycle: Callable[[Simulator, State, Run, int, float], Cycle]


def closed(
    simulator: Simulator, around: Map, state: State, impacts: int, period: int
) -> Cycle | None:
    """Solve for the cycle near a state by Newton's iteration on the simulated map.

    Parameters
    ----------
    simulator : Simulator
    around : Map
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
        run = simulator.run(state, impacts=impacts)
        walls, end = run.walls.tolist(), run.end
        rests = (run.held if simulator.several else run.released).any()
        left = len(run) < impacts or rests or word not in (None, walls)
        if left or end is None or end.wall != state.wall:
            return None
        word = walls
        late = (end.turns - state.turns - period) * simulator.period + end.phase - state.phase
        miss = [late, *(b - a for a, b in zip(state.section, end.section, strict=True))]
        size = around.size(simulator, state, miss)
        if size < CLOSED or (size >= 0.5 * best and size < ROUNDED):
            return around.cycle(simulator, state, run, period, size)
        step = around.step(simulator, state, run, miss)
        if size > 10.0 * best or step is None:
            return None
        best = min(best, size)
        state = around.moved(simulator, state, step)
        if state.velocity * simulator.sides[state.wall] <= 0.0:
            return None
    return None


def shortest_closed(
    simulator: Simulator,
    around: Map,
    run: Run,
    impacts: int,
    repetitions: Callable[[Cycle, float], int],
) -> Cycle | None:
    """The cycle of so many impacts near the end of a run, or of fewer if that repeats itself.

    `repetitions` says how many times a cycle runs through a shorter one, for a forcing period.
    """
    k = len(run) - impacts + int(np.argmax(np.abs(run.velocities[-impacts:])))
    base = State(int(run.walls[k]), float(run.phases[k]), float(run.velocities[k]))
    if simulator.several:
        base = replace(base, others=tuple(run.others[k].tolist()))
    turned = run.times[-1] - run.times[-1 - impacts]
    cycle = closed(simulator, around, base, impacts, round(float(turned) / run.period))
    if cycle is None:
        return None
    parts = repetitions(cycle, simulator.period)
    if parts == 1:
        return cycle
    state = cycle.state(simulator.period)
    return closed(simulator, around, state, impacts // parts, cycle.period // parts)
