"""Lengths and angles, measured by natural sizes w of the unknowns: |a|^2 = sum (a_i/w_i)^2.

`inner` and `length` take arrays; the others are in the plain subset of Python that
`contimpact.compiling` compiles, and take lists as well.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import Array, Vector

EPSILON = float(np.finfo(float).eps)


def inner(a: Array, b: Array, scale: Array) -> float:
    """Return the metric's inner product."""
    return float(np.dot(a / scale, b / scale))


def length(a: Array, scale: Array) -> float:
    """Return the metric's norm."""
    return float(np.linalg.norm(a / scale))


def norm(z: Vector, scale: Vector) -> float:
    """Return the length of a vector."""
    size = 0.0
    for i in range(len(z)):
        part = z[i] / scale[i]
        size += part * part
    return math.sqrt(size)


def distance(one: Vector, other: Vector, scale: Vector) -> float:
    """Return the length of the difference of two vectors."""
    size = 0.0
    for i in range(len(one)):
        part = (one[i] - other[i]) / scale[i]
        size += part * part
    return math.sqrt(size)


def angle(one: Vector, other: Vector, scale: Vector) -> float:
    """Return the angle between two unit tangents, accurate also when small."""
    return 2.0 * math.asin(min(1.0, 0.5 * distance(one, other, scale)))
