"""Impacts, chatter and sticking of one body, plainly and compiled.

Written in the subset of Python that `contimpact.compiling` compiles: vectors are lists in plain
Python, arrays in compiled code. `contimpact.simulation.simulator` says what it does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Vector

# A model at fixed parameter values, as vectors: what the loop from impact to impact reads.
#
# Written in the subset of Python that `contimpact.compiling` compiles: vectors are lists in plain
# Python, arrays in compiled code.


class Body(NamedTuple):
    """A model at fixed parameter values, as vectors."""

    values: Vector
    """Parameter values, shape (p,)."""
    clock: Vector
    """The forcing period, shape (1,)."""
    zeros: Vector
    """Zeros of the acceleration in [0, T), in order, if it depends on time alone."""
    sides: Vector
    leaving: Vector
    """`sides`, `leaving`: of the walls, and of the same on the flights that leave them; see
    `segments.segment`, shape (w,)."""
    below: Vector
    above: Vector
    """`below`, `above`: the walls that flights from each wall can meet below and above; -1 for
    none, shape (w,)."""
    low: Vector
    high: Vector
    """`low`, `high`: their displacements from it, shape (w,)."""
    restitution: Vector
    slow: Vector
    """`restitution`, `slow`: coefficients at low velocity; velocities below which chatter may be
    near its end, shape (w,)."""
    edges: Vector
    """Phases at which the acceleration at a wall changes sign, wall after wall."""
    presses: Vector
    """Whether it presses in the interval after each."""
    first: Vector
    """Index at which the edges of each wall begin, and at which the last ones end, shape (w +
    1,)."""
    longest: Vector
    """Periods after which a flight is given up, shape (1,)."""


def wrap_time(time: float, period: float) -> tuple[float, int]:
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


# Sticking: when the acceleration presses a body at rest against a wall, and when it is released.
#
# Written in the subset of Python that `contimpact.compiling` compiles: vectors are lists in plain
# Python, arrays in compiled code.


class Hold(NamedTuple):
    """The sign of the acceleration of a body at rest on a wall, over a period."""

    edges: tuple[float, ...]
    """Phases at which it changes; (0,) if it never does."""
    presses: tuple[bool, ...]
    """Whether the body is pressed against the wall in the interval after each."""
    largest: float
    """A bound of its size."""


def hold_of(
    acceleration: Callable[[Any], Any], zeros: Sequence[float], side: int, period: float
) -> Hold:
    """Return when a body at rest on the wall of this side is pressed against it.

    The acceleration at the wall is a function of phases, with these zeros in a period.
    """
    edges = sorted(zeros) or [0.0]
    middles = [0.5 * (a + b) for a, b in zip(edges, [*edges[1:], edges[0] + period], strict=True)]
    pressed = [bool(side * float(acceleration(np.float64(t))) > 0.0) for t in middles]
    changes = [i for i in range(len(edges)) if pressed[i] != pressed[i - 1]] or [0]
    size = float(np.max(np.abs(acceleration(np.linspace(0.0, period, 65)))))
    return Hold(tuple(edges[i] for i in changes), tuple(pressed[i] for i in changes), 1.1 * size)


def pressing_at(body: Body, wall: int, phase: float) -> tuple[bool, float]:
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


# Chatter: impacts that accumulate where the body is pressed against a wall.
#
# With restitution e < 1 and the acceleration a towards the wall nearly constant, an impact of
# velocity v is followed by flights of 2 e v/a, 2 e^2 v/a, ..., which end after 2 e v/(a (1 - e)).
# Impacts are computed one by one until that is so short that the formula is exact to rounding. It
# happens at rigid walls alone: where a guard leads to another mode the coefficient is 1.
#
# Written in the subset of Python that `contimpact.compiling` compiles: vectors are lists in plain
# Python, arrays in compiled code.

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
    presses, until = pressing_at(body, wall, phase)
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


DONE, RESTING, NO_IMPACT, RUNAWAY = range(4)
"""Why a run ended: numbers of `contimpact.simulation.run.Outcome`."""


def make_impacts(
    fly: Callable[..., Any],
    motion: Callable[..., Any],
    body: Body,
    state: Any,
    when: Any,
    walls: Any,
    turns: Any,
    phases: Any,
    velocities: Any,
    released: Any,
    span: Any,
) -> int:
    """Simulate from impact to impact; ``fly(body, wall, phase, velocity)`` is as `fly_in_time`.

    `state` (wall, turns) and `when` (phase, velocity) are kept up to date; they also have the
    number of the outcome, filled in, and the speed beyond which the motion runs away. The vectors
    of rows are filled with a number for each impact or release; of shape (0,) if none are kept.
    `span` has the rows to make at most, and the turns at which to stop.
    """
    period, kept = body.clock[0], len(walls) > 0
    wall, turn, phase, velocity, fastest = state[0], state[1], when[0], when[1], when[2]
    most, last, made, outcome = span[0], span[1], 0, DONE
    while made < most and turn < last:
        if not abs(velocity) <= fastest:
            outcome = RUNAWAY
            break
        rest, leaves = math.nan, 0
        if abs(velocity) <= body.slow[wall]:
            rest = rest_after(motion, body, wall, phase, velocity)
        if rest == rest:  # chatter has come to its end
            phase, passed = wrap_time(phase + rest, period)
            turn += passed
            phase, passed = release_after(body, wall, phase)
            if passed < 0:
                outcome = RESTING
                break
            velocity, leaves = 0.0, 1
        else:
            side, dt, speed = fly(body, wall, phase, velocity)
            if side == 0:
                outcome = NO_IMPACT if abs(speed) <= fastest else RUNAWAY
                break
            wall = wall_on(body, wall, side)
            velocity = speed
            phase, passed = wrap_time(phase + dt, period)
        turn += passed
        if kept:
            walls[made], turns[made], released[made] = wall, turn, leaves
            phases[made], velocities[made] = phase, velocity
        made += 1
    state[0], state[1], state[2] = wall, turn, outcome
    when[0], when[1] = phase, velocity
    return made
