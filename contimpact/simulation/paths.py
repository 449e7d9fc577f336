"""The motion between impacts, for pictures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array
from ..segments.arithmetic import ARRAYS, evaluate_in
from ..segments.track import Pieces, Track
from .run import State

if TYPE_CHECKING:
    from .automaton import Automaton

Piece = tuple[Array, Array, Array]
"""Times, gap coordinates and their velocities."""


def path_of(automaton: Automaton, states: Sequence[State], times: Array, points: int) -> Piece:
    """Return the gap coordinate of every guard from state to state, and their velocities.

    Parameters
    ----------
    automaton : Automaton
    states : sequence of State
    times : ndarray of shape (N,)
        Their times.
    points : int
        Times on each flight.

    Returns
    -------
    t : ndarray of shape ((N - 1) points,)
    x, v : ndarray of shape ((N - 1) points, guards)
    """

    def piece(k: int) -> Piece:
        state, held = states[k], states[k + 1].held
        length = float(times[k + 1] - times[k])
        dt = np.linspace(0.0, length, points)
        linear = automaton.linear[state.wall]
        x, v = (_linear if linear else _by_kernels)(automaton, state, held, dt)
        return times[k] + dt, x, v

    parts = [piece(k) for k in range(len(states) - 1)]
    t, x, v = (np.concatenate(column) for column in zip(*parts, strict=True))
    return t, x, v


def _linear(automaton: Automaton, state: State, held: int, dt: Array) -> tuple[Array, Array]:
    d, motion = automaton.size, automaton.flying(state.wall, held)
    begin, _ = automaton.leave(state)
    if dt[-1] > 0.0:
        track = Track(Pieces(motion.shape, motion.numbers, float(dt[-1])), begin)
        found = np.array([track.at(t) for t in dt.tolist()])
    else:
        found = np.tile(begin, (len(dt), 1))
    rows = np.array(automaton.rows).T
    return found[:, :d] @ rows, found[:, d : 2 * d] @ rows


def _by_kernels(automaton: Automaton, state: State, _: int, dt: Array) -> tuple[Array, Array]:
    left = automaton.guards[state.wall].name
    kernels = (automaton.kernels.gap(left, guard.name) for guard in automaton.guards)
    head = (state.phase + 0.0 * dt, *(y + 0.0 * dt for y in state.section))
    moved = [evaluate_in(kernel, ARRAYS)(*head, dt, *automaton.values) for kernel in kernels]
    return np.array([x for x, _, _ in moved]).T, np.array([v for _, v, _ in moved]).T
