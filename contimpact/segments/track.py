"""The track of a linear flight, and sign changes of polynomials in Bernstein form.

The flight is cut into pieces in which no motion turns by more than about a radian. From one to the
next leads a matrix, and on each the state is its Taylor polynomial, whose zeros are
isolated in Bernstein form.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import Array, Vector
from ..errors import InputError
from .linear_flow import Shape, generator_of, mean_of, norm_in_units

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
        self.mean = mean_of(shape, self.generator, self.piece)
        self.step = self.generator * self.piece


class Track:
    """The states of a flight, from the state X where it starts."""

    def __init__(self, pieces: Pieces, state: Sequence[float] | Array) -> None:
        self.pieces = pieces
        states = [np.array(state, dtype=float)]
        for _ in range(pieces.count - 1):
            states.append(states[-1] + pieces.piece * (pieces.mean @ states[-1]))
        step, term = pieces.step, np.array(states).T
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
