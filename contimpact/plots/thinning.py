"""Outlines with as few points as are seen."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np

from ..arrays import Array

SEEN = 3e-4
"""What departs from a line by less than this part of a picture is not seen to."""


def thinned(points: Array, corners: Sequence[int]) -> Array:
    """Return which points of a closed ring are seen (Ramer, Douglas and Peucker).

    Parameters
    ----------
    points : ndarray of shape (P, 2)
        In parts of the picture; the last one is the first.
    corners : sequence of int
        Points that are kept, so that neighbours keep the same ones.

    Returns
    -------
    ndarray of int
        Their numbers, the first and the last among them.
    """
    last = len(points) - 1
    opposite = int(np.argmax(np.hypot(*(points - points[0]).T)))
    kept = {0, opposite, last, *corners}
    waiting = list(itertools.pairwise(sorted(kept)))
    while waiting:
        first, last = waiting.pop()
        away = _off_chord(points[first : last + 1])
        if len(away) and away.max() > SEEN:
            middle = first + 1 + int(np.argmax(away))
            kept.add(middle)
            waiting += [(first, middle), (middle, last)]
    return np.array(sorted(kept))


def _off_chord(points: Array) -> Array:
    """How far the inner points of an arc are from its chord."""
    chord = points[-1] - points[0]
    away = points[1:-1] - points[0]
    length = math.hypot(*chord) or 1.0
    return np.asarray(np.abs(chord[0] * away[:, 1] - chord[1] * away[:, 0]) / length)
