"""The motion of a mode by its law, linear or integrated, some guards held."""

from __future__ import annotations

import functools
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ..arrays import Array
from ..segments.derivatives import FLOAT_SERIES, Series
from ..segments.integrated_flight import flown
from ..segments.integration import statement, text_of
from ..segments.linear_flow import Shape, flow, generator_of
from ..segments.segment import Kernel, evaluate_in, kernel_of
from ..segments.track import Curve, IntegratedCurve, IntegratedTrack, Pieces, Track

# A guard that is held keeps its gap coordinate :math:`n \cdot x` where it is. Its reaction acts
# along the direction in which an impact there changes the velocities,
#
# .. math:: w = \frac{v - v^+}{n \cdot (v - v^+)}, \qquad n \cdot w = 1,
#
# so that no more than the impact's law has to be known of it. With the held rows n as the rows of N
# and the directions w as the columns of W, the accelerations a of free motion become
#
# .. math:: a - W\lambda, \qquad \lambda = (NW)^{-1} N a .
#
# The constrained mode is thus a law of the same family again: linear, or a field that is
# integrated. A contact pushes as long as its :math:`\lambda` has the sign of the guard's side, and
# is released where that changes (B. Brogliato, Nonsmooth Mechanics, 2016, ch. 5).

AT_ONCE = 1e-12
"""A contact that pulls by this part of the sizes of its terms pulls by rounding."""
REPEATED = 4e-16
"""States that differ by less, by their size, are one to rounding."""


@dataclass(frozen=True, eq=False)
class Contact:
    """A guard against which a machine can rest."""

    number: int
    """Number of the guard."""
    side: int
    position: float
    row: Array
    """Row n of the gap coordinate, shape (d,)."""
    direction: Array
    """Direction w in which an impact there changes the velocities, shape (d,)."""


class AnyTrack(Protocol):
    """What flights ask of a track."""

    def at(self, dt: float) -> Array:
        """Return X a time after the flight's start."""
        ...

    def along(self, row: Sequence[float], from_start: bool = False) -> Curve | IntegratedCurve:
        """Return a linear combination of the positions, or how far it is from where it starts."""
        ...

    def bounds(self, row: Sequence[float]) -> tuple[float, float]:
        """Return bounds of a linear combination of the positions along the whole track."""
        ...


Weighing = tuple[Callable[[float], tuple[float, float]], list[float], float]
"""A reaction along a track, positive where the contact pushes: its value at a time and the size
beside which that is rounded, when it changes sign, and how long the track is."""


class ModeMotion(ABC):
    """The motion of a mode, some contacts held.

    A state X has the positions and velocities of all coordinates, and behind them what tells the
    time.
    """

    def __init__(self, freedom: int, contacts: Sequence[Contact]) -> None:
        self.freedom, self.contacts = freedom, tuple(contacts)
        self.rows = np.array([c.row for c in contacts]).reshape(-1, freedom)
        self.directions = np.array([c.direction for c in contacts]).reshape(-1, freedom).T
        self.inverse = np.linalg.pinv(self.rows @ self.directions)

    @abstractmethod
    def embedded(
        self, x: Sequence[float] | Array, v: Sequence[float] | Array, phase: float
    ) -> Array:
        """Return X from positions and velocities at a phase."""

    @abstractmethod
    def track(self, state: Array, length: float) -> AnyTrack:
        """Return the track of a flight from a state X."""

    @abstractmethod
    def rate(self, state: Array) -> Array:
        """Return how positions and velocities change, shape (2 d,)."""

    @abstractmethod
    def flowed(self, state: Array, duration: float) -> Array:
        """Return the derivative of positions and velocities after a duration by those of the state,
        shape (2 d, 2 d)."""

    @abstractmethod
    def force(self, row: Array, state: Array, track: Any) -> tuple[float, float]:
        """Return the acceleration of a gap coordinate where a track begins, and the size beside
        which it is rounded."""

    @abstractmethod
    def reaction(self, k: int, track: Any) -> Weighing:
        """Return the reaction of the contact in this place along a track."""

    @abstractmethod
    def reaction_slopes(self, k: int, state: Array) -> tuple[Array, float]:
        """Return how it changes with positions and velocities, shape (2 d,), and with the time."""

    def resting(self, state: Array) -> Array:
        """Return X with the held coordinates where their guards are, and at rest; velocities that
        cancel to rounding are none."""
        d = self.freedom
        found = state.copy()
        if self.contacts:
            places = np.array([c.position for c in self.contacts])
            found[:d] -= self.directions @ (self.inverse @ (self.rows @ found[:d] - places))
            v = found[d : 2 * d]
            impulses = self.inverse @ (self.rows @ v)
            rounding = REPEATED * (np.abs(v) + np.abs(self.directions) @ np.abs(impulses))
            v -= self.directions @ impulses
            v[np.abs(v) <= rounding] = 0.0
        return found

    def moving(self, state: Array) -> Array:
        """Return positions and velocities of X, shape (2, d)."""
        return state[: 2 * self.freedom].reshape(2, -1)

    def release(self, track: AnyTrack) -> tuple[float, Contact] | None:
        """Return when a contact ceases to push on a track, and which.

        None if all of them push to its end.
        """
        found = [
            (when, contact)
            for k, contact in enumerate(self.contacts)
            if (when := _first_pull(*self.reaction(k, track))) is not None
        ]
        return min(found, key=lambda pair: pair[0], default=None)


def _first_pull(
    weigh: Callable[[float], tuple[float, float]], times: list[float], length: float
) -> float | None:
    """When a reaction becomes negative; 0 if it is so from the start."""

    def pulls(t: float) -> bool:
        value, size = weigh(t)
        return value < -AT_ONCE * size

    ends = [*times, length]
    if pulls(0.0) or pulls(0.5 * ends[0]):
        return 0.0
    after = (weigh(0.5 * (t + end))[0] < 0.0 for t, end in zip(times, ends[1:], strict=True))
    return next((t for t, below in zip(times, after, strict=True) if below), None)


class LinearMotion(ModeMotion):
    """The motion of a mode by a linear law; see `linear_flow.flow`.

    The mode has the first of the `freedom` coordinates, whose law has this shape.
    """

    def __init__(
        self, shape: Shape, numbers: Sequence[float], freedom: int, contacts: Sequence[Contact] = ()
    ) -> None:
        super().__init__(freedom, contacts)
        n, size = shape.freedom, shape.freedom * shape.size
        self.own = n
        parts = np.split(np.reshape(numbers[:size], (n, -1)), [n, 2 * n], axis=1)
        none = (0, freedom - n), (0, freedom - n)
        state = (np.pad(part, none) for part in parts[:2])
        free = np.hstack([*state, np.pad(parts[2], (none[0], (0, 0)))])
        self.shape = shape._replace(freedom=freedom)
        self.frequencies = tuple(numbers[size : size + shape.waves])
        self.reactions = self.inverse @ self.rows @ free
        self.accelerations = free - self.directions @ self.reactions
        self.numbers = [*self.accelerations.ravel().tolist(), *self.frequencies]
        self._pieces: dict[float, Pieces] = {}

    def track(self, state: Array, length: float) -> Track:
        if length not in self._pieces:
            self._pieces[length] = Pieces(self.shape, self.numbers, length)
        return Track(self._pieces[length], state)

    def embedded(
        self, x: Sequence[float] | Array, v: Sequence[float] | Array, phase: float
    ) -> Array:
        angles = np.array(self.frequencies) * phase
        waves = np.stack([np.cos(angles), np.sin(angles)], axis=-1).ravel()
        return np.concatenate([x, v, waves, [1.0]])

    def rate(self, state: Array) -> Array:
        d = self.freedom
        return np.concatenate([state[d : 2 * d], self.accelerations @ state])

    def flowed(self, state: Array, duration: float) -> Array:
        d, h, _ = self.shape
        tables = np.array(flow(d, h, 0, duration, *self.numbers)).reshape(4, d, -1)
        mean, end = duration * tables[0, :, : 2 * d], tables[1, :, : 2 * d]
        return np.concatenate([np.eye(d, 2 * d) + mean, end])

    def force(self, row: Array, state: Array, track: Track) -> tuple[float, float]:
        size = np.abs(row) @ np.abs(self.accelerations) @ np.abs(state)
        return float(row @ self.accelerations @ state), float(size)

    def reaction(self, k: int, track: Track) -> Weighing:
        weights = self.contacts[k].side * self.reactions[k]

        def weigh(t: float) -> tuple[float, float]:
            state = track.at(t)
            return float(weights @ state), float(np.abs(weights) @ np.abs(state))

        return weigh, track.changes(weights), track.pieces.length

    def reaction_slopes(self, k: int, state: Array) -> tuple[Array, float]:
        rates = generator_of(self.shape, self.numbers) @ state
        return self.reactions[k, : 2 * self.freedom], float(self.reactions[k] @ rates)


ROUNDED = 1e-15
"""Factors of accelerations that are smaller are zero."""


class IntegratedMotion(ModeMotion):
    """The motion of a mode by a field that is integrated, and its parameters.

    The mode has the first of the `freedom` coordinates. X has the time as its last number. Along a
    track reactions are integrated as further coordinates, whose accelerations they are, so that
    steps resolve them, and their zeros are isolated as all others.
    """

    def __init__(
        self,
        field: str,
        parameters: Sequence[float],
        freedom: int,
        contacts: Sequence[Contact] = (),
    ) -> None:
        super().__init__(freedom, contacts)
        n = self.own = statement(field).freedom
        reactions = self.inverse @ self.rows[:, :n]
        kept = np.eye(n) - self.directions[:n] @ reactions
        self.field, self.parameters = field, [*parameters]
        self.watched, self._watching = field, self.parameters
        if contacts:
            self.field, factors = _combined(field, kept)
            self.parameters = [*parameters, *factors]
            self.watched, factors = _combined(field, np.concatenate([kept, reactions]))
            self._watching = [*parameters, *factors]

    def embedded(
        self, x: Sequence[float] | Array, v: Sequence[float] | Array, phase: float
    ) -> Array:
        return np.array([*x, *v, phase], dtype=float)

    def _numbers(self, state: Array) -> list[float]:
        """Time, positions, velocities and parameters, as of `integration.flown`."""
        x, v = self.moving(state)[:, : self.own].tolist()
        return [float(state[-1]), *x, *v, *self.parameters]

    def _watched_numbers(self, state: Array) -> list[float]:
        """The same with the reactions."""
        none = [0.0] * len(self.contacts)
        x, v = self.moving(state)[:, : self.own].tolist()
        return [float(state[-1]), *x, *none, *v, *none, *self._watching]

    def track(self, state: Array, length: float) -> FieldTrack:
        track = IntegratedTrack(self.watched, self._watched_numbers(state), length)
        return FieldTrack(self, track, float(state[-1]))

    def rate(self, state: Array) -> Array:
        found = np.zeros((2, self.freedom))
        found[0] = self.moving(state)[1]
        found[1, : self.own] = _forces(self.field)(*self._numbers(state))
        return found.ravel()

    def flowed(self, state: Array, duration: float) -> Array:
        n, d = self.own, self.freedom
        names = " ".join(statement(self.field).names[2 : 2 + 2 * n])
        found = np.reshape(flown(self.field, names, duration, *self._numbers(state)), (-1, 2, n))
        moved = np.eye(n, 2 * n) + duration * found[1:, 0].T
        whole, own = np.zeros((2 * d, 2 * d)), [*range(n), *range(d, d + n)]
        whole[np.ix_(own, own)] = np.concatenate([moved, found[1:, 1].T])
        return whole

    def force(self, row: Array, state: Array, track: FieldTrack) -> tuple[float, float]:
        return float(row @ self.rate(state)[self.freedom :]), track.along(row).largest_force

    def reaction(self, k: int, track: FieldTrack) -> Weighing:
        curve, side = track.reaction(k), self.contacts[k].side
        size = curve.largest_force
        return (lambda t: (side * curve((), t, ())[2], size)), curve.breaks(), curve.times[-1]

    def reaction_slopes(self, k: int, state: Array) -> tuple[Array, float]:
        forces = evaluate_in(_forces(self.watched), FLOAT_SERIES)
        numbers, n, m = self._watched_numbers(state), self.own, len(self.contacts)
        places = [*range(1, 1 + n), *range(1 + n + m, 1 + 2 * n + m)]

        def slope(rates: dict[int, float]) -> float:
            given = [Series([x, rates.get(i, 0.0)]) for i, x in enumerate(numbers)]
            found = forces(*given)[n + k]
            return float(found.coefficients[1]) if isinstance(found, Series) else 0.0

        found = np.zeros((2, self.freedom))
        found[:, :n] = np.reshape([slope({i: 1.0}) for i in places], (2, n))
        rates = self.rate(state).reshape(2, -1)[:, :n].ravel().tolist()
        return found.ravel(), slope({0: 1.0, **dict(zip(places, rates, strict=True))})


class FieldTrack:
    """The states of a flight that is integrated, and the reactions of the contacts held in it."""

    def __init__(self, motion: IntegratedMotion, track: IntegratedTrack, time: float) -> None:
        self.motion, self.track, self.time = motion, track, time

    def at(self, dt: float) -> Array:
        """Return X a time after the flight's start."""
        motion, found = self.motion, np.zeros((2, self.motion.freedom))
        found[:, : motion.own] = np.array(self.track.at(np.array([dt])))[:, 0, : motion.own]
        return np.append(found, self.time + dt)

    def along(self, row: Sequence[float] | Array, from_start: bool = False) -> IntegratedCurve:
        """Return a linear combination of the positions, or how far it is from where it starts."""
        none = [0.0] * len(self.motion.contacts)
        return self.track.along([*row[: self.motion.own], *none], from_start)

    def bounds(self, row: Sequence[float]) -> tuple[float, float]:
        """Return bounds of a linear combination of the positions along the whole track."""
        return self.along(row).bounds()

    def reaction(self, k: int) -> IntegratedCurve:
        """Return the curve whose acceleration is the reaction of the contact in this place."""
        size, place = len(self.track.start), self.motion.own + k
        return self.track.along([float(i == place) for i in range(size)])


def _combined(field: str, rows: Array) -> tuple[str, list[float]]:
    """The field whose accelerations are linear combinations of another one's, and the factors that
    are further parameters of it, so that one text serves for all values."""
    stated, texts, factors = statement(field), list[str](), list[float]()
    for row in rows.tolist():
        terms = []
        for factor, acceleration in zip(row, stated.accelerations, strict=True):
            if factor == 1.0:
                terms.append(f"({acceleration})")
            elif abs(factor) > ROUNDED:
                terms.append(f"factor{len(factors)}*({acceleration})")
                factors.append(factor)
        texts.append(" + ".join(terms) or "0.0")
    names = (f"factor{i}" for i in range(len(factors)))
    return text_of([*stated.parameters, *names], texts), factors


@functools.cache
def _forces(field: str) -> Kernel:
    """The accelerations of a field as a kernel, of the numbers of `Statement.names` but for the
    duration."""
    stated = statement(field)
    returned = "".join(f"{text}, " for text in stated.accelerations)
    text = f"def forces({', '.join(stated.names[1:])}):\n    return ({returned})\n"
    return kernel_of("forces", text, f"<forces by {field}>")
