"""Where a flight first hits a wall, with certainty.

The functions are in the plain subset of Python that `contimpact.compiling` compiles.
"""

from __future__ import annotations

import math

from ..arrays import Vector
from .flight import Motion, Moved, turn_guess, velocity_zero

MARGIN = 1e-9
"""Part of the displacements by which tangents that tell of a turn must miss a wall."""


def wall_arrival(
    motion: Motion,
    head: Vector,
    values: Vector,
    left: float,
    at: Moved,
    right: float,
    reached: Moved,
    wall: float,
    rising: bool,
) -> tuple[float, float]:
    """Return time and velocity at which a monotone displacement reaches a wall.

    Newton's iteration kept inside a bracket, from the end with the larger speed: between two zeros
    of the acceleration the displacement is convex or concave, and from that end the iteration is
    monotone.

    Parameters
    ----------
    motion, head, values
        As in `velocity_zero`.
    left, right : float
        Times before and after the arrival.
    at, reached : (displacement, velocity, acceleration)
        What `motion` returns there.
    wall : float
        Displacement of the wall.
    rising : bool
        Whether the displacement grows towards it.

    Returns
    -------
    dt, speed : float
        The velocity does not run away from the wall, not even by rounding.
    """
    from_left = abs(at[1]) > abs(reached[1])
    t = left if from_left else right
    x, speed, acceleration = at if from_left else reached
    for trial in range(100):
        if trial > 0:
            x, speed, acceleration = motion(head, t, values)
        if (x < wall) == rising:
            left = t
        else:
            right = t
        step = (x - wall) / speed if speed != 0.0 else math.inf
        # the next error of Newton's iteration is about step^2 acceleration/(2 speed)
        after = step * step * abs(acceleration)
        small = abs(step) <= 1e-8 * right and after <= 1e-17 * right * abs(speed)
        if small or abs(step) <= 2e-16 * right:
            t, speed = t - step, speed - acceleration * step
            break
        if right - left <= 2e-16 * right:
            break
        t = t - step
        if not left < t < right:
            t = 0.5 * (left + right)
    if (speed > 0.0) != rising:
        speed = 0.0
    return t, speed


def first_hit(
    motion: Motion,
    head: Vector,
    values: Vector,
    breaks: Vector,
    left: float,
    rising: bool,
    low: float,
    high: float,
) -> tuple[int, float, float, bool]:
    """Return the first arrival at a wall; as `first_arrival`, between times that are given.

    Parameters
    ----------
    breaks : vector
        Zeros of the acceleration after `left`, in order; further times among them do no harm.
    """
    return first_arrival(motion, head, values, breaks, 0.0, 0.0, 1, left, rising, low, high)


def first_arrival(
    motion: Motion,
    head: Vector,
    values: Vector,
    zeros: Vector,
    phase: float,
    period: float,
    most: int,
    left: float,
    rising: bool,
    low: float,
    high: float,
) -> tuple[int, float, float, bool]:
    """Return the first arrival at a wall, with certainty.

    Between two zeros of the acceleration the velocity is monotone, so it has at most one zero
    there; between the turning points the displacement is monotone, so that comparing it with the
    walls at the ends of each piece misses nothing. A touch counts as an arrival.

    Parameters
    ----------
    motion, head, values
        As in `velocity_zero`; displacements are measured from where the flight starts.
    zeros : vector
        Zeros of the acceleration in [0, period), in order; further times among them do no harm.
    phase, period : float
        The flight starts at `phase`; the zeros repeat every `period`.
    most : int
        Periods after which it is given up.
    left : float
        Time so far without a hit.
    rising : bool
        Direction of motion then; it decides where the velocity is zero.
    low, high : float
        Displacements of the walls below and above; infinite where there is none.

    Returns
    -------
    side : int
        +1 at the wall above, -1 at the one below, 0 for no hit.
    dt, speed : float
        Time and velocity before the impact; without a hit, at the last zero.
    rising : bool
        Direction of motion at that time.
    """
    count, first = len(zeros), 0
    while first < count and zeros[first] <= phase:
        first += 1
    at = motion(head, left, values)
    for turns in range(most):
        for i in range(first, first + max(count, 1)):
            if count == 0:
                right = (turns + 1) * period
            elif i < count:
                right = zeros[i] - phase + turns * period
            else:
                right = zeros[i - count] - phase + period + turns * period
            reached = motion(head, right, values)
            speed = reached[1]
            turned = speed != 0.0 and (speed > 0.0) != rising
            ahead = high if rising != turned else low
            if turned or beyond(reached[0], ahead, rising):
                side, dt, speed = hit_between(
                    motion, head, values, left, at, right, reached, turned, rising, low, high
                )
                if side != 0:
                    return side, dt, speed, side > 0
                rising = rising != turned
            left, at = right, reached
    return 0, left, at[1], rising


def hit_between(
    motion: Motion,
    head: Vector,
    values: Vector,
    left: float,
    at: Moved,
    right: float,
    reached: Moved,
    turned: bool,
    rising: bool,
    low: float,
    high: float,
) -> tuple[int, float, float]:
    """Return side, time and velocity of the first arrival in a piece of monotone velocity.

    `at` and `reached` are what `motion` returns at its ends, `rising` is the direction of motion at
    the first, `turned` whether it is another at the second. Without a hit the side is 0.
    """
    if turned:
        wall = high if rising else low
        if not turns_before(right - left, at, reached, wall, rising):
            guess = turn_guess(at[1], reached[1], left > 0.0, True)
            turn, x = velocity_zero(motion, head, values, left, at[1], right, reached[1], guess)
            if beyond(x, wall, rising):
                there = motion(head, turn, values)
                dt, speed = wall_arrival(motion, head, values, left, at, turn, there, wall, rising)
                return (1 if rising else -1), dt, speed
            left = turn
        at, rising = (at[0], 0.0, at[2]), not rising  # sought from the other end, then
    wall = high if rising else low
    if not beyond(reached[0], wall, rising):
        return 0, right, reached[1]
    dt, speed = wall_arrival(motion, head, values, left, at, right, reached, wall, rising)
    return (1 if rising else -1), dt, speed


def beyond(x: float, wall: float, rising: bool) -> bool:
    """Whether a displacement has come to a wall."""
    return x >= wall if rising else x <= wall


def turns_before(length: float, at: Moved, reached: Moved, wall: float, rising: bool) -> bool:
    """Whether a monotone velocity surely changes sign before a wall is reached.

    The displacement lies on one side of the tangents at both ends: it is enough that these meet
    before the wall. That it is not sure says nothing. `at` and `reached` are as in `hit_between`.
    """
    if at[1] == reached[1]:
        return False
    dt = (reached[0] - at[0] - reached[1] * length) / (at[1] - reached[1])
    margin = MARGIN * (abs(at[0]) + abs(reached[0]) + abs(at[1]) * length)
    return not beyond(at[0] + at[1] * dt + (margin if rising else -margin), wall, rising)
