"""Section coordinates: the state before an impact, without what the guard's surface gives.

They are the velocity of the gap coordinate, and position and velocity of every coordinate but one,
the guard's pivot.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def pivot(row: Sequence[Any]) -> int:
    """Return the coordinate that a surface gives: the first of those with the largest factor."""
    return max(range(len(row)), key=lambda i: abs(row[i]))


def state_before(
    row: Sequence[Any], position: Any, section: Sequence[Any]
) -> tuple[list[Any], list[Any]]:
    """Return positions and velocities before an impact.

    Parameters
    ----------
    row : sequence
        Factors of the coordinates in the gap coordinate.
    position : number or sympy.Expr
        Of the guard's surface.
    section : sequence
        Section coordinates.
    """
    place = pivot(row)
    found = []
    for level, others in ((position, section[1::2]), (section[0], section[2::2])):
        factors = [*row[:place], *row[place + 1 :]]
        rest = sum(c * x for c, x in zip(factors, others, strict=True) if c)
        own = (level - rest) / row[place]
        found.append([*others[:place], own, *others[place:]])
    return found[0], found[1]
