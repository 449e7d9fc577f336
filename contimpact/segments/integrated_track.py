"""Integrated flights from their start to their end, as the Taylor polynomials of their steps."""

from __future__ import annotations

import functools
from bisect import bisect_right
from collections.abc import Sequence
from typing import Any, Protocol, Self

import numpy as np

from ..arrays import Array, Vector
from .integration import KEPT, integrator, statement
from .track import coefficients_of, sign_changes

# Each polynomial is right to rounding on its step, so that extrema and arrivals found on them with
# certainty, as on those of `track`, are the flight's.


class Fields(Protocol):
    """What tracks ask of the kernels of a model; see `kernels.Kernels`."""

    whole: bool

    def field(self, a: str) -> Any:
        """Return the kernel of the field that flights from wall a are integrated in."""
        ...

    def segment(self, start: str, end: str) -> Any:
        """Return the segment from one wall to another."""
        ...


class IntegratedTrack:
    """The states of a flight by the field of `text_of`, of positive duration `length`.

    Its numbers are those of `flown`, without the duration.
    """

    def __init__(self, field: str, numbers: Sequence[float], length: float) -> None:
        freedom = statement(field).freedom
        times, means, speeds = integrator(field).dense([length, *numbers])
        self.start = list(numbers[1 : 1 + freedom])
        self.times, self.speeds = length * times, speeds
        self.moved = length * means

    @classmethod
    def of(cls, start: list[float], times: Array, moved: Array, speeds: Array) -> Self:
        """Return the states of a flight from its polynomials."""
        track = cls.__new__(cls)
        track.start, track.times, track.moved, track.speeds = start, times, moved, speeds
        return track

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return positions and velocities at times after it leaves, a row for each time."""
        moved, speeds = self.moved_at(times)
        return np.array(self.start) + moved, speeds

    def moved_at(self, times: Array) -> tuple[Array, Array]:
        """Return the ways from the start, and the velocities, at times after it leaves."""
        steps = np.diff(self.times)
        places = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(steps) - 1)
        part = (times - self.times[places]) / steps[places]
        moved, speeds = (_values(e[places], part) for e in (self.moved, self.speeds))
        return moved, speeds

    def along(self, row: Sequence[float], from_start: bool = False) -> IntegratedCurve:
        """Return a linear combination of the positions, or how far it is from where it starts.

        Coordinates that the mode does not have are at zero.
        """
        weights = np.array([float(c) for c in row[: len(self.start)]])
        position, velocity = (np.einsum("i,kij->kj", weights, e) for e in (self.moved, self.speeds))
        if not from_start:
            position[:, 0] += weights @ self.start
        return IntegratedCurve(self.times, position, velocity)


def integrated_track(
    kernels: Fields, wall: str, leave: Sequence[float], values: Sequence[float], length: float
) -> IntegratedTrack:
    """Return the track of a flight that is integrated, from the unknowns where it leaves."""
    field, numbers = kernels.field(wall)(*leave, *values)
    return _track(field, tuple(numbers), length)


@functools.lru_cache(KEPT)
def _track(field: str, numbers: tuple[float, ...], length: float) -> IntegratedTrack:
    return IntegratedTrack(field, numbers, length)


def join_flights(
    tracks: Sequence[IntegratedTrack], begins: Sequence[float] | Array, positions: Array
) -> IntegratedTrack:
    """Return one flight of several, which begin at these times and positions."""
    times, moved = [tracks[0].times[:1]], []
    for track, begin, position in zip(tracks, begins, positions, strict=True):
        times.append(begin + track.times[1:])
        way = track.moved.copy()
        way[:, :, 0] += position - positions[0]
        moved.append(way)
    speeds = np.concatenate([track.speeds for track in tracks])
    return IntegratedTrack.of(tracks[0].start, np.concatenate(times), np.concatenate(moved), speeds)


def track_between(
    kernels: Fields,
    ends: tuple[str, str],
    leave: Sequence[float],
    arrive: Sequence[float],
    values: Sequence[float],
    length: float,
) -> IntegratedTrack:
    """Return the track of a flight that is integrated, from one guard to another.

    A long one is held by both of its ends: from where it leaves alone, it would go astray.
    """
    segment: Any = kernels.segment(*ends)
    found: IntegratedTrack | None = None
    if not kernels.whole:
        found = segment.long_track(leave, arrive, values)
    return found or integrated_track(kernels, ends[0], leave, values, length)


class IntegratedCurve:
    """A coordinate along a flight: position, velocity and acceleration.

    `times` are the ends of the pieces; the coefficients, of shape (pieces, degree + 1), are of
    powers of the time since the piece's start, as a part of its duration.
    """

    def __init__(self, times: Array, position: Array, velocity: Array) -> None:
        self.times, self.last = times.tolist(), len(position) - 1
        self._steps = np.diff(times)
        self._position, self._velocity = position, velocity
        self._pieces: dict[int, list[tuple[float, float, float]]] = {}
        self._found: dict[float, tuple[float, float, float]] = {}

    @functools.cached_property
    def _acceleration(self) -> Array:
        found = np.zeros_like(self._velocity)
        orders = np.arange(1.0, found.shape[1])
        found[:, :-1] = self._velocity[:, 1:] * orders / self._steps[:, None]
        return found

    def _piece(self, k: int) -> list[tuple[float, float, float]]:
        """Coefficients of a piece, the highest first."""
        if k not in self._pieces:
            three = self._position[k], self._velocity[k], self._acceleration[k]
            self._pieces[k] = list(zip(*(part[::-1].tolist() for part in three), strict=True))
        return self._pieces[k]

    def __call__(self, head: Vector, dt: float, values: Vector) -> tuple[float, float, float]:
        """Return position, velocity and acceleration; see `flight.Motion`."""
        if dt in self._found:  # its ends are asked for again and again
            return self._found[dt]
        k = min(max(bisect_right(self.times, dt) - 1, 0), self.last)
        s = (dt - self.times[k]) / (self.times[k + 1] - self.times[k])
        x = v = a = 0.0
        for b, c, d in self._piece(k):
            x, v, a = x * s + b, v * s + c, a * s + d
        self._found[dt] = x, v, a
        return x, v, a

    def bounds(self) -> tuple[float, float]:
        """Return bounds of the position on the whole flight."""
        coefficients = coefficients_of(self._position)
        return float(coefficients.min()), float(coefficients.max())

    def at_end(self) -> tuple[float, float]:
        """Return position and velocity where the flight ends."""
        return float(self._position[-1].sum()), float(self._velocity[-1].sum())

    def breaks(self) -> list[float]:
        """Return the times at which the acceleration changes sign, in order."""
        found = []
        for place in sign_changes(self._acceleration[:, :-1]):
            k = min(int(place), self.last)
            found.append(self.times[k] + (place - k) * self._steps[k])
        return found


def velocities_at(field: str, numbers: Sequence[float], times: Array) -> Array:
    """Return mean velocities and end velocities of flights that leave together, as (2 * freedom,
    n).

    `times` are their n durations, none negative. NaN where the flow does not stay finite.
    """
    freedom = statement(field).freedom
    longest = float(np.max(times, initial=0.0))
    begun = [float(v) for v in numbers[1 + freedom : 1 + 2 * freedom]]
    if longest == 0.0:
        return np.repeat(np.array(begun * 2)[:, None], len(times), axis=1)
    try:
        track = _track(field, tuple(float(x) for x in numbers), longest)
    except ArithmeticError:
        return np.full((2 * freedom, len(times)), np.nan)
    moved, speeds = (column.T for column in track.moved_at(times))
    short = times == 0.0
    means = np.where(short, np.array(begun)[:, None], moved / np.where(short, 1.0, times))
    return np.concatenate([means, speeds])


def _values(terms: Array, part: Array) -> Array:
    """Polynomials of shape (n, freedom, degree + 1) at parts of their steps, shape (n, freedom)."""
    total = np.zeros(terms.shape[:2])
    for k in range(terms.shape[2] - 1, -1, -1):
        total = total * part[:, None] + terms[:, :, k]
    return total
