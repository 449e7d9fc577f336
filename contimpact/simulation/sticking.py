"""Sticking: when the acceleration presses a body at rest against a wall, and when it is released.

Written in the subset of Python that `contimpact.compiling` compiles: vectors are lists in plain
Python, arrays in compiled code.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from .body import Body


class Hold(NamedTuple):
    """The sign of the acceleration of a body at rest on a wall, over a period.

    Attributes
    ----------
    edges : sequence of float
        Phases at which it changes; (0,) if it never does.
    presses : sequence of bool
        Whether the body is pressed against the wall in the interval after each.
    largest : float
        A bound of its size.
    """

    edges: tuple[float, ...]
    presses: tuple[bool, ...]
    largest: float


def hold_of(
    acceleration: Callable[[Any], Any], zeros: Sequence[float], side: int, period: float
) -> Hold:
    """Return when a body at rest on a wall is pressed against it.

    Parameters
    ----------
    acceleration : callable
        At the wall, of phases.
    zeros : sequence of float
        Its zeros in a period.
    side : int
        Of the wall.
    period : float
    """
    edges = sorted(zeros) or [0.0]
    middles = [0.5 * (a + b) for a, b in zip(edges, [*edges[1:], edges[0] + period], strict=True)]
    pressed = [bool(side * float(acceleration(np.float64(t))) > 0.0) for t in middles]
    changes = [i for i in range(len(edges)) if pressed[i] != pressed[i - 1]] or [0]
    size = float(np.max(np.abs(acceleration(np.linspace(0.0, period, 65)))))
    return Hold(tuple(edges[i] for i in changes), tuple(pressed[i] for i in changes), 1.1 * size)


def pressed_at(body: Body, wall: int, phase: float) -> tuple[bool, float]:
    """Return whether a body at rest on a wall is pressed against it, and for how long.

    The time is infinite if the acceleration never turns away.
    """
    start, end = body.first[wall], body.first[wall + 1]
    if end - start == 1:
        return body.presses[start] != 0, math.inf
    i = end - 1
    if phase >= body.edges[start]:
        while body.edges[i] > phase:
            i -= 1
    left = body.edges[start if i + 1 == end else i + 1] - phase
    return body.presses[i] != 0, left if left > 0.0 else left + body.clock[0]


def release_after(body: Body, wall: int, phase: float) -> tuple[float, int]:
    """Return the phase of the next release from a wall, and the periods passed until then.

    The periods are negative if there is none.
    """
    start, end = body.first[wall], body.first[wall + 1]
    if end - start == 1:
        return phase, -1
    for i in range(start, end):
        if body.presses[i] == 0 and body.edges[i] > phase:
            return body.edges[i], 0
    if body.presses[start] == 0:
        return body.edges[start], 1
    return body.edges[start + 1], 1
