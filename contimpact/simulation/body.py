"""A model at fixed parameter values, as vectors: what the loop from impact to impact reads.

Written in the subset of Python that `contimpact.compiling` compiles: vectors are lists in plain
Python, arrays in compiled code.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..arrays import Vector


class Body(NamedTuple):
    """A model at fixed parameter values, as vectors.

    Attributes
    ----------
    values : vector of shape (p,)
        Parameter values.
    clock : vector of shape (1,)
        The forcing period.
    zeros : vector
        Zeros of the acceleration in [0, T), in order, if it depends on time alone.
    sides, leaving : vector of int, shape (w,)
        Of the walls, and of the same on the flights that leave them; see `segments.segment`.
    below, above : vector of int, shape (w,)
        The walls that flights from each wall can meet below and above; -1 for none.
    low, high : vector of shape (w,)
        Their displacements from it.
    restitution, slow : vector of shape (w,)
        Coefficients at low velocity; velocities below which chatter may be near its end.
    edges : vector
        Phases at which the acceleration at a wall changes sign, wall after wall.
    presses : vector of int
        Whether it presses in the interval after each.
    first : vector of int, shape (w + 1,)
        Where the edges of each wall begin, and where the last ones end.
    longest : vector of int, shape (1,)
        Periods after which a flight is given up.
    """

    values: Vector
    clock: Vector
    zeros: Vector
    sides: Vector
    leaving: Vector
    below: Vector
    above: Vector
    low: Vector
    high: Vector
    restitution: Vector
    slow: Vector
    edges: Vector
    presses: Vector
    first: Vector
    longest: Vector


def wrapped(time: float, period: float) -> tuple[float, int]:
    """Return a time as a phase in [0, T) and whole periods."""
    passed = math.floor(time / period)
    phase = time - passed * period
    if phase >= period:  # rounding at the edge
        return 0.0, passed + 1
    return max(phase, 0.0), passed


def wall_on(body: Body, wall: int, side: int) -> int:
    """Return the number of the wall that a flight from a wall meets on a side; -1 for none."""
    if side == 0:
        return -1
    met: int = body.above[wall] if side > 0 else body.below[wall]
    return met
