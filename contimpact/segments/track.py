"""The tracks of flights, and sign changes of polynomials in Bernstein form.

A linear flight is cut into pieces in which no motion turns by more than about a radian. From one to
the next leads a matrix, and on each the state is its Taylor polynomial, whose zeros are isolated in
Bernstein form.
"""

from __future__ import annotations

import functools
import math
from bisect import bisect_right
from collections.abc import Sequence
from typing import Any, Protocol, Self

import numpy as np

from ..arrays import Array, Vector
from ..errors import InputError
from .integration import KEPT, statement
from .linear_flow import Shape, generator_of, mean_of, norm_in_units
from .taylor import polynomials_of

# Zeros of polynomials in pieces, each isolated by the signs of Bernstein coefficients.
#
# None change, no zero; one change, one zero; more, and the piece is halved (Farouki and Rajan,
# 1987).
# None is missed between samples.

HALVINGS = 30


@functools.cache
def _bernstein(degree: int) -> tuple[Array, Array, Array]:
    """What leads to Bernstein coefficients, and from these to those on both halves."""
    places = range(degree + 1)
    leading = [[math.comb(i, k) / math.comb(degree, k) for i in places] for k in places]
    first = np.array([[math.comb(i, j) / 2**i for i in places] for j in places])
    return np.array(leading), first, first[::-1, ::-1]


def coefficients_of(pieces: Array) -> Array:
    """Return the Bernstein coefficients of polynomials; between them lie their values on [0, 1]."""
    coefficients: Array = pieces @ _bernstein(pieces.shape[1] - 1)[0]
    return coefficients


def sign_changes(pieces: Array) -> list[float]:
    """Return where polynomials change sign, each on [k, k + 1] with its number k, in order."""
    found: list[float] = []
    leading, first, second = _bernstein(pieces.shape[1] - 1)
    bernstein, start, width = pieces @ leading, np.arange(float(len(pieces))), 1.0
    negative = np.signbit(bernstein)
    between = np.flatnonzero(negative[:-1, -1] != negative[1:, 0])
    found += (between + 1.0).tolist()  # by rounding, neither piece may have it
    for _ in range(HALVINGS):
        changes = np.count_nonzero(np.diff(np.signbit(bernstein), axis=1), axis=1)
        for row in np.flatnonzero(changes == 1):
            found.append(_zero(bernstein[row], float(start[row]), width))
        open_ = changes > 1
        if not np.any(open_):
            break
        width *= 0.5
        parts, start = bernstein[open_], start[open_]
        halves = parts @ first, parts @ second
        crossing = np.signbit(halves[0][:, -1]) != np.signbit(halves[1][:, 0])
        found += (start[crossing] + width).tolist()
        bernstein, start = np.concatenate(halves), np.concatenate([start, start + width])
    return sorted(found)


def _zero(coefficients: Any, start: float, width: float) -> float:
    """The zero of a polynomial with one change of sign, by the Illinois method."""
    rows = coefficients.tolist()
    low, high, below, above = 0.0, 1.0, rows[0], rows[-1]
    s, kept = 0.5, 0
    for _ in range(60):
        s = (low * above - high * below) / (above - below) if above != below else 0.5
        if not low < s < high:
            s = 0.5 * (low + high)
        value = _value(rows, s)
        if value == 0.0 or high - low < 1e-14:
            break
        if (value < 0.0) == (below < 0.0):
            low, below, above, kept = s, value, 0.5 * above if kept < 0 else above, -1
        else:
            high, above, below, kept = s, value, 0.5 * below if kept > 0 else below, 1
    return start + width * s


def _value(rows: list[float], s: float) -> float:
    """A polynomial by its Bernstein coefficients, by Horner's scheme in s/(1 - s)."""
    n, left = len(rows) - 1, 1.0 - s
    value, power, binomial = rows[0] * left, 1.0, 1.0
    for i in range(1, n):
        power *= s
        binomial = binomial * (n - i + 1) / i
        value = (value + power * binomial * rows[i]) * left
    return value + power * s * rows[n]


DEGREE = 18
"""1/19! is 8e-18."""

MOST_PIECES = 200_000
"""Pieces of one flight at most: motions that turn more often are not resolved in any sensible
time."""


DOUBLINGS = 6
"""Pieces come in blocks of 64 at most: nothing grows beyond the range of floats in as many."""


class TurnsError(InputError, OverflowError):
    """Motions of a law turn, or decay, too often to be followed."""


def turns_of(shape: Shape, generator: Array, length: float) -> float:
    """Return a bound of the radians by which motions of a law turn in a time.

    Raises TurnsError for more than `MOST_PIECES`, or numbers beyond the range of floats.
    """
    size = norm_in_units(shape, generator) * length
    if not size <= MOST_PIECES:
        found = f"a flight whose frequencies or dampings times its duration come to {size:.3g}"
        raise TurnsError("model", found, f"they may come to {MOST_PIECES:,}")
    return size


class Pieces:
    """How linear flights of one law and positive duration are cut; see the head of the module. The
    numbers are those of `linear_flow.flow`, without the duration."""

    def __init__(self, shape: Shape, numbers: Sequence[float], length: float) -> None:
        self.freedom, self.length = shape.freedom, length
        self.generator = generator_of(shape, numbers)
        self.count = max(1, math.ceil(turns_of(shape, self.generator, length)))
        self.piece = length / self.count
        self.step = self.generator * self.piece
        doublings = min((self.count - 1).bit_length(), DOUBLINGS)
        gains = [
            dt * mean_of(shape, self.generator, dt)
            for dt in (self.piece * 2.0**k for k in range(doublings + 1))
        ]
        self.gains, self.leap = gains[:-1], gains[-1]
        """What states gain in 1, 2, 4, ... pieces."""


class Track:
    """The states of a flight, from the state X where it starts."""

    def __init__(self, pieces: Pieces, state: Sequence[float] | Array) -> None:
        self.pieces = pieces
        block = np.array(state, dtype=float)[:, None]
        for gain in pieces.gains:
            block = np.hstack([block, block + gain @ block])
        blocks = [block]
        while len(blocks) * block.shape[1] < pieces.count:
            blocks.append(blocks[-1] + pieces.leap @ blocks[-1])
        step, term = pieces.step, np.hstack(blocks)[:, : pieces.count]
        terms = [term]
        for k in range(1, DEGREE + 1):
            term = (step @ term) / k
            terms.append(term)
        self.terms = np.array(terms)

    def along(self, row: Sequence[float], from_start: bool = False) -> Curve:
        """Return a linear combination of the positions, or how far it is from where it starts."""
        d = self.pieces.freedom
        weights = np.array([float(c) for c in row])
        accelerations = weights @ self.pieces.generator[d : 2 * d]
        parts = weights @ self.terms[:, :d], weights @ self.terms[:, d : 2 * d]
        if from_start:
            parts[0][0] -= parts[0][0, 0]
        found = (part.T for part in (*parts, accelerations @ self.terms))
        return Curve(self.pieces.piece, *found)

    def bounds(self, row: Sequence[float]) -> tuple[float, float]:
        """Return bounds of a linear combination of the positions along the whole track."""
        weights = np.array([float(c) for c in row])
        bernstein = coefficients_of((weights @ self.terms[:, : self.pieces.freedom]).T)
        return float(bernstein.min()), float(bernstein.max())

    def changes(self, weights: Array) -> list[float]:
        """Return the times at which a linear combination of all of X changes sign, in order."""
        return [self.pieces.piece * s for s in sign_changes((weights @ self.terms).T)]

    def at(self, dt: float) -> Array:
        """Return X a time after the flight's start."""
        s = dt / self.pieces.piece
        k = min(max(int(s), 0), self.pieces.count - 1)
        powers = (s - k) ** np.arange(DEGREE + 1.0)
        state: Array = powers @ self.terms[:, :, k]
        return state


def track_of(law: Any, length: float) -> Track:
    """Return the track of a flight from what the kernel ``law`` says where it starts."""
    d, h, numbers, state = law
    return Track(Pieces(Shape(int(d), int(h), 0), numbers, length), state)


class Curve:
    """A coordinate along a flight: position, velocity and acceleration.

    Parameters
    ----------
    piece : float
        Duration of one piece.
    position, velocity, acceleration : ndarray of shape (pieces, degree + 1)
        Coefficients of powers of the time since the piece's start, as a part of its duration.
    """

    def __init__(self, piece: float, position: Array, velocity: Array, acceleration: Array) -> None:
        self.piece, self.last = piece, len(position) - 1
        self._acceleration = acceleration
        self._parts = list(
            zip(*(p[:, ::-1].tolist() for p in (position, velocity, acceleration)), strict=True)
        )

    def __call__(self, head: Vector, dt: float, values: Vector) -> tuple[float, float, float]:
        """Return position, velocity and acceleration; see `flight.Motion`."""
        s = dt / self.piece
        k = min(max(int(s), 0), self.last)
        s -= k
        x = v = a = 0.0
        for b, c, d in zip(*self._parts[k], strict=True):
            x, v, a = x * s + b, v * s + c, a * s + d
        return x, v, a

    def breaks(self) -> list[float]:
        """Return the times at which the acceleration changes sign, in order."""
        return [self.piece * s for s in sign_changes(self._acceleration)]


# Integrated flights from their start to their end, as the Taylor polynomials of their steps.
#
# Each polynomial is right to rounding on its step, so that extrema and arrivals found on them with
# certainty, as on those of linear flights, are the flight's.


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
        times, means, speeds = polynomials_of(field, [length, *numbers])
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
    """Return the track of a flight that is integrated, from the unknowns where it leaves.

    Raises ArithmeticError where the law has no value, as a root of a negative number.
    """
    try:
        field, numbers = kernels.field(wall)(*leave, *values)
    except ValueError as error:
        raise ArithmeticError(f"the law has no value: {error}") from error
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

    @property
    def largest_force(self) -> float:
        """The largest coefficient of the acceleration."""
        return float(np.abs(self._acceleration).max())

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
    powers = np.vander(part, terms.shape[2], increasing=True)
    found: Array = np.einsum("nik,nk->ni", terms, powers)
    return found
