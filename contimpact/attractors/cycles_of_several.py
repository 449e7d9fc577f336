"""Cycles of motions with several coordinates: Newton's iteration on the simulated map.

As `cycle`, with all section coordinates. Motion that rests on a wall for a part of its period keeps
its other coordinates, so that it need not repeat itself at once: it has a cycle when its sojourns
agree.
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
from .cycle import NEAR, Cycle

CLOSED = 1e-15
"""A cycle that misses itself by less, in parts of its size, is closed; one that misses it by no
more than `ROUNDED` is where Newton's iteration gains nothing."""
ROUNDED = 1e-11

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
        cycle = _polished(simulator, run, int(last - back))
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


def _polished(simulator: Simulator, run: Run, impacts: int) -> Cycle | None:
    """The cycle of so many impacts near the end of a run, or of fewer if that repeats itself."""
    rows = run.states()[len(run) - impacts :]
    base = replace(max(rows, key=lambda row: abs(row.velocity)), turns=0)
    turned = run.times[-1] - run.times[-1 - impacts]
    cycle = polish_several(simulator, base, impacts, round(float(turned) / run.period))
    if cycle is None:
        return None
    parts = _repetitions(cycle, simulator.period)
    if parts == 1:
        return cycle
    state = cycle.state(simulator.period)
    return polish_several(simulator, state, impacts // parts, cycle.period // parts)


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


def polish_several(simulator: Simulator, state: State, impacts: int, period: int) -> Cycle | None:
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
    side = simulator.sides[state.wall]
    for _ in range(12):
        closed = simulator.run(state, impacts=impacts)
        walls, end = closed.walls.tolist(), closed.end
        left = len(closed) < impacts or closed.held.any() or word not in (None, walls)
        if left or end is None or end.wall != state.wall:
            return None
        word = walls
        late = (end.turns - state.turns - period) * simulator.period + end.phase - state.phase
        miss = np.array([late, *np.subtract(end.section, state.section)])
        size = float(np.max(np.abs(miss) / _around(simulator, state)))
        rows = [state, *closed.states()]
        if size < CLOSED or (size >= 0.5 * best and size < ROUNDED):
            return _cycle(simulator, rows[:-1], period, _multipliers(simulator, rows), size)
        step = _newton(_derivatives(simulator, rows), miss)
        if size > 10.0 * best or step is None:
            return None
        best = min(best, size)
        phase, section = state.phase + float(step[0]), np.add(state.section, step[1:]).tolist()
        state = replace(state, phase=phase, velocity=section[0], others=tuple(section[1:]))
        state = replace(state.within(simulator.period), turns=0)
        if state.velocity * side <= 0.0:
            return None
    return None


def _around(simulator: Simulator, state: State) -> Array:
    """Sizes beside which a miss is small."""
    return np.array([simulator.period, *np.maximum(1.0, np.abs(state.section))])


def _derivatives(simulator: Simulator, rows: Sequence[State]) -> Array:
    """From each row to the next, shape (N, m, m)."""
    pairs = itertools.pairwise(rows)
    return np.array([simulator.derivative_of_several(*pair) for pair in pairs])


def _newton(derivatives: Array, miss: Array) -> Array | None:
    """Solve (M - I) step = -miss, with M the product of all derivatives."""
    unit = np.eye(len(miss))
    if not np.all(np.isfinite(derivatives)):
        return None
    product = unit
    for derivative in derivatives:
        product = derivative @ product
    try:
        step: Array = np.linalg.solve(product - unit, -miss)
    except np.linalg.LinAlgError:
        return None
    return step if np.all(np.isfinite(step)) else None


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
