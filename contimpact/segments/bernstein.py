"""Zeros of polynomials in pieces, each isolated by the signs of Bernstein coefficients.

None change, no zero; one change, one zero; more, and the piece is halved (Farouki and Rajan, 1987).
None is missed between samples.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np

from ..arrays import Array

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
