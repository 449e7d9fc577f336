"""From impact to impact: flights, and where they end in chatter, sticking and release.

Written in the subset of Python that `contimpact.compiling` compiles: vectors are lists in plain
Python, arrays in compiled code. `contimpact.simulation.simulator` says what it does.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from .body import Body, wall_on, wrapped
from .chatter import rest_after
from .sticking import release_after

DONE, RESTING, NO_IMPACT = range(3)
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
        Filled with a number for each impact or release; of shape (0,) if no rows are kept.
    span : vector of int, shape (2,)
        Rows to make at most, and the turns at which to stop.
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
            wall = wall_on(body, wall, side)
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
