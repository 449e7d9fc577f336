r"""The derivative of the map from one impact, or release, to the next.

It acts on disturbances of (time, section coordinates). Between two impacts it is :math:`-B^{-1}A`
with the blocks of the segment. Where walls are held, or released, it is put together from the law
of the constrained mode: the disturbance that the jump leaves, at a fixed time, what the flow makes
of it, and the time by which the event's function h comes earlier or later,

.. math:: \delta X^+ = \frac{\partial X^+}{\partial y}\,\delta y - f^+\,\delta t, \qquad
          \delta t_1 = -\frac{\nabla h \cdot \delta X}{\nabla h \cdot f}, \qquad
          \delta X_1 = \delta X + f\,\delta t_1 ,

which is the saltation matrix of the event (R. I. Leine and H. Nijmeijer, Dynamics and Bifurcations
of Non-Smooth Mechanical Systems, 2004, ch. 7). A wall that comes to be held projects the
disturbance onto its surface.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from ..models.guards import pivot, state_before
from ..segments.arithmetic import FLOATS, evaluate_in
from ..segments.derivatives import Series, series
from ..segments.kernels import Kernels
from ..segments.linear_flow import generator_of
from .automaton import Automaton
from .linear_motion import LinearMotion
from .run import State


def derivative_between(automaton: Automaton, before: State, after: State) -> Array:
    """Return the derivative of the map from one row of a run to the next, shape (2 d, 2 d).

    It is infinite where the velocity of the second vanishes.
    """
    simple = not (before.released or after.released or after.held)
    found = (_of_segment if simple else _of_linear_law)(automaton, before, after)
    return found if np.all(np.isfinite(found)) else np.full(found.shape, np.inf)


def derivative_of_pair(
    kernels: Kernels, values: Sequence[float], period: float
) -> Callable[[State, State], tuple[float, float, float, float]]:
    """Return what gives the derivative of the map between two impacts, of one degree of freedom.

    Its four entries tt, tv, vt, vv stand row by row, for (time, velocity before impact): -B^-1 A
    with the blocks of the flight kernel. A velocity of zero at the end makes it infinite.
    """
    letters = kernels.model.letters
    watched = kernels.passages.watched
    places = range(len(letters))
    flights = {
        (a, b): kernels.flight(letters[a], letters[b])
        for a in places
        for b in places
        if watched[a][b]
    }

    def derivative(start: State, end: State) -> tuple[float, float, float, float]:
        t1 = end.phase + (end.turns - start.turns) * period
        kernel = flights[start.wall, end.wall]
        _, leaving, arriving, _ = kernel(start.phase, start.velocity, t1, end.velocity, *values)
        a11, a12, a21, a22 = leaving
        b11, b12, b21, b22 = arriving
        det = b11 * b22 - b12 * b21
        if det == 0.0:
            return (math.inf,) * 4
        return (
            (b12 * a21 - b22 * a11) / det,
            (b12 * a22 - b22 * a12) / det,
            (b21 * a11 - b11 * a21) / det,
            (b21 * a12 - b11 * a22) / det,
        )

    return derivative


def _duration(automaton: Automaton, before: State, after: State) -> float:
    return (after.turns - before.turns) * automaton.period + after.phase - before.phase


def _of_segment(automaton: Automaton, before: State, after: State) -> Array:
    names = [automaton.guards[state.wall].name for state in (before, after)]
    start = (before.phase, *before.section)
    end = (before.phase + _duration(automaton, before, after), *after.section)
    segment = automaton.kernels.segment(names[0], names[1])
    _, leaving, arriving, _ = segment.blocks(start, end, automaton.values)
    m = len(start)
    try:
        blocks = np.array(arriving).reshape(m, m), np.array(leaving).reshape(m, m)
        return -np.linalg.solve(*blocks)
    except np.linalg.LinAlgError:
        return np.full((m, m), np.inf)


def _of_linear_law(automaton: Automaton, before: State, after: State) -> Array:
    d = automaton.size
    motion = automaton.flying(before.wall, after.held)
    begin, _ = automaton.leave(before)
    left = _left(automaton, motion, before)
    left = np.column_stack([-motion.rate(begin), left])
    disturbed = motion.flowed(_duration(automaton, before, after)) @ left
    row = automaton.rows[after.wall]
    end = motion.embedded(*automaton.before(after.wall, after.section), after.phase)
    late = _late(motion, after, row, end) @ disturbed
    moved = disturbed + np.outer(motion.rate(end), late)
    others = _section_rows(row, d)
    return np.vstack([late, others @ moved])


def _left(automaton: Automaton, motion: LinearMotion, before: State) -> Array:
    """How the state after an impact or a release depends on the section coordinates before it."""
    d, row = automaton.size, automaton.rows[before.wall]
    m = 2 * d - 1
    if before.released:
        units = (state_before(row.tolist(), 0.0, unit) for unit in np.eye(m).tolist())
        found = np.array([np.concatenate(unit) for unit in units]).T
    else:
        name = automaton.guards[before.wall].name
        law = evaluate_in(automaton.kernels.law(name), series(FLOATS))
        found = np.array([_along(law, before, j, automaton.values)[: 2 * d] for j in range(m)]).T
    if motion.contacts:
        pushed = motion.directions @ np.linalg.pinv(motion.rows @ motion.directions) @ motion.rows
        found[:d] -= pushed @ found[:d]
        found[d:] -= pushed @ found[d:]
    return found


def _along(law: Callable[..., Any], state: State, j: int, values: Any) -> list[float]:
    """The derivative of the state after an impact by one of the section coordinates before it."""
    section = [Series([y, float(i == j)]) for i, y in enumerate(state.section)]
    after = law(Series([state.phase, 0.0]), *section, *values)[3]
    return [float(e.coefficients[1]) if isinstance(e, Series) else 0.0 for e in after]


def _late(motion: LinearMotion, after: State, row: Array, end: Array) -> Array:
    """How much later the event comes, for each disturbance of the state."""
    d = len(row)
    rates = generator_of(motion.shape, motion.numbers) @ end
    event = np.concatenate([row, np.zeros(len(end) - d)])
    if after.released:
        places = [contact.number for contact in motion.contacts]
        event = motion.reactions[places.index(after.wall)]
    with np.errstate(divide="ignore", invalid="ignore"):
        found: Array = -event[: 2 * d] / (event @ rates)
    return found


def _section_rows(row: Array, d: int) -> Array:
    """The section coordinates as combinations of positions and velocities."""
    others = [i for i in range(d) if i != pivot(row.tolist())]
    unit = np.eye(2 * d)
    speed = np.concatenate([np.zeros(d), row])
    return np.array([speed, *(unit[j] for i in others for j in (i, d + i))])
