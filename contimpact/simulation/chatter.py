"""Chatter: impacts that accumulate where the body is pressed against a wall.

With restitution e < 1 and the acceleration a towards the wall nearly constant, an impact of
velocity v is followed by flights of 2 e v/a, 2 e^2 v/a, ..., which end after 2 e v/(a (1 - e)).
Impacts are computed one by one until that is so short that the formula is exact to rounding. It
happens at rigid walls alone: where a guard leads to another mode the coefficient is 1.

Written in the subset of Python that `contimpact.compiling` compiles: vectors are lists in plain
Python, arrays in compiled code.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from .body import Body
from .sticking import pressed_at

SHORT = 1e-9
"""Chatter left to come, in periods, that is completed analytically."""
EARLY = 1e-6
"""... and in units of the time until the acceleration turns away."""
LOW = 1e-6
"""A velocity at which the coefficient of chatter is read off."""


def rest_after(
    motion: Callable[..., Any], body: Body, wall: int, phase: float, velocity: float
) -> float:
    """Return the time until accumulating impacts end; NaN if they do not (yet)."""
    e = body.restitution[wall]
    presses, until = pressed_at(body, wall, phase)
    if not presses or e >= 1.0:
        return math.nan
    if e == 0.0 or velocity == 0.0:
        return 0.0
    force = body.sides[wall] * motion((wall, phase, 0.0), 0.0, body.values)[2]
    if force <= 0.0:
        return math.nan
    rest = 2.0 * e * abs(velocity) / (force * (1.0 - e))
    return rest if rest <= SHORT * body.clock[0] and rest <= EARLY * until else math.nan


def slow_velocity(e: float, acceleration: float, period: float) -> float:
    """Return the velocity below which chatter may be near its end; infinite without restitution."""
    if e == 0.0:
        return math.inf
    return SHORT * period * acceleration * max(1.0 - e, 0.0) / (2.0 * e)


def coefficient(motion: Callable[..., Any], wall: int) -> float:
    """Return the coefficient of restitution at low velocity."""
    return abs(float(motion((wall, 0.0, LOW), 0.0)[1])) / LOW
