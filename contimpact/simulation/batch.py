"""Motions from many starts at once, on all cores.

Where the loop from impact to impact is compiled it runs in threads, each with a part of the starts:
compiled code does not hold Python's lock. What it leaves to Python is made one start after the
other, so that the results are those of `Simulator.run`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import parent_process
from typing import Any

import numpy as np

from ..arrays import Array
from ..segments.compiling import cores
from .impacts import DONE
from .linear_flights import LEFT
from .run import Call, Outcome, State

OUTCOMES = tuple(Outcome)
LONGEST = 65536
"""Impacts of a start made in one call at most."""
PARTS = 4
"""Parts of the starts for each thread, so that all end at about the same time."""


class Batch:
    """Motions from many starts.

    Parameters
    ----------
    simulator : Simulator
    states : sequence of State
    threads : int, optional
        As many as there are cores by default, or one in the processes of a study.

    Attributes
    ----------
    walls, turns, held, released : ndarray of shape (n,)
    phases : ndarray of shape (n,)
    sections : ndarray of shape (n, m)
        Where the motions are.
    """

    def __init__(self, simulator: Any, states: Sequence[State], threads: int | None = None) -> None:
        self.simulator = simulator
        self.threads = threads or (1 if parent_process() else cores())
        states = [state.within(simulator.period) for state in states]
        self.walls = np.array([state.wall for state in states], dtype=np.int64)
        self.turns = np.array([state.turns for state in states], dtype=np.int64)
        self.held = np.array([state.held for state in states], dtype=np.int64)
        self.released = np.array([state.released for state in states], dtype=bool)
        self.phases = np.array([state.phase for state in states], dtype=float)
        size = simulator.model.unknowns_per_impact - 1
        sections = [state.section for state in states]
        self.sections = np.array(sections, dtype=float).reshape(len(states), size)

    def state(self, k: int) -> State:
        """Return where a motion is."""
        velocity, *others = self.sections[k].tolist()
        place = int(self.walls[k]), float(self.phases[k]), velocity, int(self.turns[k])
        return State(*place, tuple(others), int(self.held[k]), bool(self.released[k]))

    def run(self, chosen: Array, periods: int) -> list[Outcome]:
        """Move some motions on, by so many periods; those that end before stay where they are.

        Parameters
        ----------
        chosen : ndarray of int
            Their numbers.
        """
        outcomes = [Outcome.DONE] * len(chosen)
        if not len(chosen):
            return outcomes
        call = self.simulator.machine.batch(periods * len(chosen))
        alone = np.ones(len(chosen), dtype=bool)
        if call is not None:
            alone = (self.held[chosen] != 0) | self.released[chosen]
            ends = self._run_compiled(call, chosen[~alone], periods)
            for place, end in zip(np.flatnonzero(~alone).tolist(), ends, strict=True):
                alone[place] = end is None
                outcomes[place] = end or Outcome.DONE
        for place in np.flatnonzero(alone).tolist():
            k = int(chosen[place])
            run = self.simulator.run(self.state(k), periods=periods, record=False)
            outcomes[place] = run.outcome
            if run.outcome is Outcome.DONE and run.end is not None:
                self._put(k, run.end)
        return outcomes

    def _run_compiled(self, call: Call, chosen: Array, periods: int) -> list[Outcome | None]:
        """Why each of some motions ended; None for those that compiled code leaves to Python."""
        if not len(chosen):
            return []
        at = _rows(self.walls[chosen], self.turns[chosen], 0 * chosen)
        speeds = np.max(np.abs(self.sections[chosen][:, ::2]), axis=1)
        fastest = [self.simulator.runaway_speed(speed) for speed in speeds.tolist()]
        when = _rows(self.phases[chosen], self.sections[chosen], fastest)
        limits = _rows(0 * chosen + LONGEST, self.turns[chosen] + periods)
        size = max(1, math.ceil(len(chosen) / (PARTS * self.threads)))
        parts = [slice(first, first + size) for first in range(0, len(chosen), size)]

        def make(part: slice) -> None:
            call(*(table[part].reshape(-1) for table in (at, when, limits)))

        if self.threads > 1 and len(parts) > 1:
            with ThreadPoolExecutor(self.threads) as pool:
                list(pool.map(make, parts))
        else:
            for part in parts:
                make(part)
        early = (at[:, 2] == DONE) & (at[:, 1] < limits[:, 1])
        at[early, 2] = LEFT
        moved: Array = at[:, 2] == DONE
        done = chosen[moved]
        self.walls[done], self.turns[done] = at[moved, 0], at[moved, 1]
        self.phases[done], self.sections[done] = when[moved, 0], when[moved, 1:-1]
        return [None if code == LEFT else OUTCOMES[code] for code in at[:, 2].tolist()]

    def _put(self, k: int, state: State) -> None:
        self.walls[k], self.turns[k], self.phases[k] = state.wall, state.turns, state.phase
        self.held[k], self.released[k] = state.held, state.released
        self.sections[k] = state.section


def _rows(*columns: Any) -> Array:
    """Columns side by side; rows are contiguous."""
    return np.ascontiguousarray(np.column_stack(columns))
