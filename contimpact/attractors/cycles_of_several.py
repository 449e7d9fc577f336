"""Cycles of motions with several coordinates: Newton's iteration on the simulated map.

As `cycles_of_one`, with all section coordinates. Motion that rests on a wall for a part of its
period keeps its other coordinates, so that it need not repeat itself at once: it has a cycle when
its sojourns agree.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..orbits.multipliers import multipliers
from ..simulation.run import Run, State
from ..simulation.simulator import Simulator
from .cycle import NEAR, Cycle, Map, shortest_closed

NOTHING = 1e-14
"""Multipliers below this are zero where a wall is held: what it held is forgotten."""


def cycle_of_several(simulator: Simulator, run: Run, longest: int) -> tuple[Cycle, float] | None:
    """Return the stable cycle near the end of a run, and the distance to it."""
    if run.held.any():
        return sticking_cycle_of_several(simulator, run)
    table, last = _table(run), len(run) - 1
    early = np.arange(max(0, last - longest), last)
    apart = _apart(table[early] - table[last], _sizes(run))
    apart[run.walls[early] != run.walls[last]] = np.inf
    for back in early[apart < NEAR][::-1][:3]:
        cycle = shortest_closed(simulator, AROUND_SEVERAL, run, int(last - back), _repetitions)
        if cycle is not None and abs(cycle.multipliers[0]) < 1.0:
            return cycle, _distance(run, cycle)
    return None


def sticking_cycle_of_several(simulator: Simulator, run: Run) -> tuple[Cycle, float] | None:
    """Return the cycle of a motion that ends sojourns on a wall in the same state, if it does.

    With it comes the distance from it.
    """
    sojourns = np.nonzero(run.held)[0]
    if not len(sojourns):
        return None
    table, last = _table(run), int(sojourns[-1])
    earlier = sojourns[:-1]
    apart = _apart(table[earlier] - table[last], _sizes(run))
    marks = np.column_stack([run.walls, run.held, run.released])
    apart[np.any(marks[earlier] != marks[last], axis=1)] = np.inf
    for first in earlier[apart < NEAR][::-1][:1].tolist():
        rows = run.states()[first : last + 1]
        mus = tuple(mu if abs(mu) > NOTHING else 0j for mu in _multipliers(simulator, rows))
        if abs(mus[0]) < 1.0:
            miss = float(_apart(table[[first]] - table[last], _sizes(run))[0])
            period = rows[-1].turns - rows[0].turns
            if abs(rows[-1].phase - rows[0].phase) > 0.5 * run.period:
                period += 1 if rows[-1].phase > rows[0].phase else -1
            return _cycle(simulator, rows[:-1], period, mus, miss), miss / (1.0 - abs(mus[0]))
    return None


def _table(run: Run) -> Array:
    """Phases and section coordinates."""
    return np.column_stack([run.phases, run.velocities, run.others])


def _sizes(run: Run) -> Array:
    """Of phases and section coordinates: the period, and the largest there are."""
    found = np.max(np.abs(np.column_stack([run.velocities, run.others])), axis=0)
    return np.concatenate([[run.period], np.where(found > 0.0, found, 1.0)])


def _apart(difference: Array, sizes: Array) -> Array:
    """Distances of rows of a table, phases on the circle."""
    found = difference / sizes
    found[:, 0] -= np.round(found[:, 0])
    return np.asarray(np.max(np.abs(found), axis=1))


def _distance(run: Run, cycle: Cycle) -> float:
    """Distance from the run's last impact to a cycle."""
    table = np.column_stack([cycle.times, cycle.velocities, cycle.others])
    apart = _apart(table - _table(run)[-1], _sizes(run))
    return float(np.min(apart[cycle.walls == run.walls[-1]], initial=math.inf))


def _repetitions(cycle: Cycle, period: float) -> int:
    """How many times a cycle runs through a shorter one."""
    n, table = len(cycle.walls), np.column_stack([cycle.times, cycle.velocities, cycle.others])
    sizes = np.concatenate([[period], np.maximum(np.max(np.abs(table[:, 1:]), axis=0), 1e-300)])
    for parts in range(cycle.period, 1, -1):
        if n % parts or cycle.period % parts:
            continue
        shift = n // parts
        same_walls = np.array_equal(np.roll(cycle.walls, -shift), cycle.walls)
        if same_walls and np.max(_apart(np.roll(table, -shift, axis=0) - table, sizes)) < 1e-7:
            return parts
    return 1


def _size(simulator: Simulator, state: State, miss: Sequence[float]) -> float:
    sizes = [simulator.period, *np.maximum(1.0, np.abs(state.section))]
    return float(np.max(np.abs(miss) / np.array(sizes)))


def _step(
    simulator: Simulator, state: State, run: Run, miss: Sequence[float]
) -> Sequence[float] | None:
    """Solve (M - I) step = -miss, with M the product of all derivatives."""
    derivatives = _derivatives(simulator, [state, *run.states()])
    product = unit = np.eye(len(miss))
    if not np.all(np.isfinite(derivatives)):
        return None
    for derivative in derivatives:
        product = derivative @ product
    try:
        step = np.linalg.solve(product - unit, -np.array(miss))
    except np.linalg.LinAlgError:
        return None
    return step.tolist() if np.all(np.isfinite(step)) else None


def _moved(simulator: Simulator, state: State, step: Sequence[float]) -> State:
    phase, section = state.phase + step[0], np.add(state.section, step[1:]).tolist()
    state = replace(state, phase=phase, velocity=section[0], others=tuple(section[1:]))
    return replace(state.within(simulator.period), turns=0)


def _closed(simulator: Simulator, state: State, run: Run, period: int, closing: float) -> Cycle:
    rows = [state, *run.states()]
    mus = _multipliers(simulator, rows)
    return _cycle(simulator, rows[:-1], period, mus, closing)


def _derivatives(simulator: Simulator, rows: Sequence[State]) -> Array:
    """From each row to the next, shape (N, m, m)."""
    pairs = itertools.pairwise(rows)
    return np.array([simulator.derivative_of_several(*pair) for pair in pairs])


def _multipliers(simulator: Simulator, rows: Sequence[State]) -> tuple[complex, ...]:
    """Of the map around, the largest first."""
    derivatives = _derivatives(simulator, rows)
    if not np.all(np.isfinite(derivatives)):
        return (complex(math.inf),) * derivatives.shape[1]
    back = np.broadcast_to(-np.eye(derivatives.shape[1]), derivatives.shape)
    return tuple(complex(mu) for mu in multipliers(derivatives, back))


def _cycle(
    simulator: Simulator, rows: Sequence[State], period: int, mus: tuple[complex, ...], miss: float
) -> Cycle:
    begun = rows[0].turns
    return Cycle(
        np.array([row.wall for row in rows], dtype=np.int8),
        np.array([(row.turns - begun) * simulator.period + row.phase for row in rows]),
        np.array([row.velocity for row in rows]),
        np.array([row.released for row in rows]),
        period,
        mus,
        miss,
        np.array([row.others for row in rows]).reshape(len(rows), -1),
        np.array([row.held for row in rows], dtype=np.int64),
    )


AROUND_SEVERAL = Map(_size, _step, _moved, _closed)
