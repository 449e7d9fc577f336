r"""Linear motion of a mode, with guards against which the machine rests.

A guard that is held keeps its gap coordinate :math:`n \cdot x` where it is. Its reaction acts along
the direction in which an impact there changes the velocities,

.. math:: w = \frac{v - v^+}{n \cdot (v - v^+)}, \qquad n \cdot w = 1,

so that no more than the impact's law has to be known of it. With the held rows n as the rows of N
and the directions w as the columns of W, the accelerations a of free motion become

.. math:: a - W\lambda, \qquad \lambda = (NW)^{-1} N a .

The constrained mode is thus a linear law again. A contact pushes as long as its :math:`\lambda` has
the sign of the guard's side, and is released where that changes (B. Brogliato, Nonsmooth Mechanics,
2016, ch. 5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..segments.linear_flow import Shape, flow
from ..segments.track import Pieces, Track

AT_ONCE = 1e-12
"""A contact that pulls by this part of the sizes of its terms pulls by rounding."""


@dataclass(frozen=True, eq=False)
class Contact:
    """A guard against which a machine can rest.

    Attributes
    ----------
    number : int
        Of the guard.
    side : int
    position : float
    row : ndarray of shape (d,)
        Of the gap coordinate, n.
    direction : ndarray of shape (d,)
        In which an impact changes the velocities, w.
    """

    number: int
    side: int
    position: float
    row: Array
    direction: Array


class LinearMotion:
    """The motion of a mode by a linear law, some guards held.

    Parameters
    ----------
    shape : Shape
    numbers : sequence of float
        The law of free motion, as of `segments.linear_flow.flow`.
    contacts : sequence of Contact
        Those that are held.
    """

    def __init__(
        self, shape: Shape, numbers: Sequence[float], contacts: Sequence[Contact] = ()
    ) -> None:
        self.shape, self.contacts = shape, tuple(contacts)
        d, size = shape.freedom, shape.freedom * shape.size
        free = np.array(numbers[:size], dtype=float).reshape(d, -1)
        self.frequencies = tuple(numbers[size : size + shape.waves])
        self.rows = np.array([c.row for c in contacts]).reshape(-1, d)
        self.directions = np.array([c.direction for c in contacts]).reshape(-1, d).T
        self.reactions = np.linalg.pinv(self.rows @ self.directions) @ self.rows @ free
        self.accelerations = free - self.directions @ self.reactions
        self.numbers = [*self.accelerations.ravel().tolist(), *self.frequencies]
        self._pieces: dict[float, Pieces] = {}

    def track(self, state: Array, length: float) -> Track:
        """Return the track of a flight from a state X."""
        if length not in self._pieces:
            self._pieces[length] = Pieces(self.shape, self.numbers, length)
        return Track(self._pieces[length], state)

    def embedded(
        self, x: Sequence[float] | Array, v: Sequence[float] | Array, phase: float
    ) -> Array:
        """Return X from positions and velocities at a phase."""
        angles = np.array(self.frequencies) * phase
        waves = np.stack([np.cos(angles), np.sin(angles)], axis=-1).ravel()
        return np.concatenate([x, v, waves, [1.0]])

    def resting(self, state: Array) -> Array:
        """Return X with the held coordinates where their guards are, and at rest."""
        d = self.shape.freedom
        found = state.copy()
        if self.contacts:
            inverse = np.linalg.pinv(self.rows @ self.directions)
            places = np.array([c.position for c in self.contacts])
            found[:d] -= self.directions @ (inverse @ (self.rows @ found[:d] - places))
            found[d : 2 * d] -= self.directions @ (inverse @ (self.rows @ found[d : 2 * d]))
        return found

    def rate(self, state: Array) -> Array:
        """Return how positions and velocities change, shape (2 d,)."""
        d = self.shape.freedom
        return np.concatenate([state[d : 2 * d], self.accelerations @ state])

    def flowed(self, duration: float) -> Array:
        """Return the derivative of the state after a duration by the state, shape (2 d, 2 d)."""
        d, h, _ = self.shape
        tables = np.array(flow(d, h, 0, duration, *self.numbers)).reshape(4, d, -1)
        mean, end = duration * tables[0, :, : 2 * d], tables[1, :, : 2 * d]
        return np.concatenate([np.eye(d, 2 * d) + mean, end])

    def pushes(self, state: Array) -> bool:
        """Whether all contacts push, or pull by no more than rounding."""
        sides = np.array([c.side for c in self.contacts])
        least = -AT_ONCE * (np.abs(self.reactions) @ np.abs(state))
        return bool(np.all(sides * (self.reactions @ state) >= least))

    def release(self, track: Track, state: Array) -> tuple[float, Contact] | None:
        """Return when, on a track that starts at a state, a contact ceases to push, and which.

        None if all of them push to the end of the track.
        """
        found = [
            (when, contact)
            for contact, weights in zip(self.contacts, self.reactions, strict=True)
            if (when := _ceases(track, contact.side * weights, state)) is not None
        ]
        return min(found, key=lambda pair: pair[0], default=None)


def _ceases(track: Track, weights: Array, state: Array) -> float | None:
    """When a linear combination of X becomes negative; 0 if it is so from the start."""
    if weights @ state < -AT_ONCE * (np.abs(weights) @ np.abs(state)):
        return 0.0
    times = track.changes(weights)
    ends = [*times, track.pieces.length][1:]
    after = (weights @ track.at(0.5 * (t + end)) < 0.0 for t, end in zip(times, ends, strict=True))
    return next((t for t, negative in zip(times, after, strict=True) if negative), None)
