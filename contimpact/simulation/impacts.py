"""From impact to impact: flights, chatter, sticking and release, for a body at fixed parameters.

Written in the plain subset of Python that `contimpact.compiling` compiles: vectors are lists where
it runs plainly, arrays where it runs compiled. `contimpact.simulation.simulator` says what it does.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ..segments.flight import first_arrival

SHORT = 1e-9
"""Chatter left to come, in periods, that is completed analytically."""
EARLY = 1e-6
"""... and in units of the time until the acceleration turns away."""

DONE, RESTING, NO_IMPACT = range(3)
"""Why a run ended: numbers of `contimpact.simulation.simulator.Outcome`."""


class Body(NamedTuple):
    """What a run is made of, as vectors: a model at fixed parameter values.

    Attributes
    ----------
    values : vector of shape (p,)
        Parameter values.
    clock : vector of shape (1,)
        The forcing period.
    zeros : vector
        Zeros of the acceleration in [0, T), in order, where it depends on time alone.
    sides : vector of int, shape (w,)
        Of the walls.
    low, high : vector of shape (w,)
        Displacements, from each wall, of the walls below and above.
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

    values: Any
    clock: Any
    zeros: Any
    sides: Any
    low: Any
    high: Any
    restitution: Any
    slow: Any
    edges: Any
    presses: Any
    first: Any
    longest: Any


def wrapped(time, period):
    """Return a time as a phase in [0, T) and whole periods."""
    passed = math.floor(time / period)
    phase = time - passed * period
    if phase >= period:  # rounding at the edge
        return 0.0, passed + 1
    return max(phase, 0.0), passed


def pressed_at(body, wall, phase):
    """Return whether a body at rest on a wall is pressed against it, and for how long.

    The time is infinite where the acceleration never turns away.
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


def rest_after(motion, body, wall, phase, velocity):
    """Return the time until accumulating impacts end; not a number where they do not (yet)."""
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


def release_after(body, wall, phase):
    """Return the phase of the next release from a wall, and the periods passed until then.

    The periods are negative where there is none.
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


def fly_in_time(motion, body, wall, phase, velocity):
    """Return side, time and velocity of the impact that ends a flight; the side is 0 for none.

    For an acceleration that depends on time alone.
    """
    side, dt, speed, _ = first_arrival(
        motion, (wall, phase, velocity), body.values, body.zeros, phase, body.clock[0],
        body.longest[0], 0.0, body.sides[wall] < 0, body.low[wall], body.high[wall],
    )  # fmt: skip
    return side, dt, speed


def make_impacts(fly, motion, body, state, when, walls, turns, phases, velocities, released, span):
    """Simulate from impact to impact.

    Parameters
    ----------
    fly : callable ``fly(body, wall, phase, velocity) -> (side, dt, velocity)``
        As `fly_in_time`.
    motion : callable ``motion((wall, phase, velocity), dt, values) -> (x, v, a)``
    body : Body
    state : vector of int, shape (3,)
        Wall and turns, kept up to date, and the number of the outcome, filled in.
    when : vector of shape (2,)
        Phase and velocity, kept up to date.
    walls, turns, phases, velocities, released : vector
        Filled with a number for each impact or release; of shape (0,) where no rows are kept.
    span : vector of int, shape (2,)
        Rows to make at most, and the turns at which to stop.

    Returns
    -------
    made : int
    """
    period, kept = body.clock[0], len(walls) > 0
    wall, turn, phase, velocity = state[0], state[1], when[0], when[1]
    most, last, made, outcome = span[0], span[1], 0, DONE
    while made < most and turn < last:
        rest, leaves = math.nan, 0
        if abs(velocity) <= body.slow[wall]:
            rest = rest_after(motion, body, wall, phase, velocity)
        if rest == rest:  # chatter has come to its end
            phase, passed = wrapped(phase + rest, period)
            turn += passed
            phase, passed = release_after(body, wall, phase)
            if passed < 0:
                outcome = RESTING
                break
            velocity, leaves = 0.0, 1
        else:
            side, dt, speed = fly(body, wall, phase, velocity)
            if side == 0:
                outcome = NO_IMPACT
                break
            wall = wall_on(body, side)
            velocity = speed
            phase, passed = wrapped(phase + dt, period)
        turn += passed
        if kept:
            walls[made], turns[made], released[made] = wall, turn, leaves
            phases[made], velocities[made] = phase, velocity
        made += 1
    state[0], state[1], state[2] = wall, turn, outcome
    when[0], when[1] = phase, velocity
    return made


def wall_on(body, side):
    """Return the number of the wall on a side; -1 for none."""
    for wall in range(len(body.sides)):
        if body.sides[wall] == side:
            return wall
    return -1
