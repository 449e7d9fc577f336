"""Where a flight turns, from motion whose acceleration has known zeros.

Extrema are isolated, not sampled. Between two zeros of the acceleration the velocity is monotone
and has at most one zero, which a bracketed Newton iteration finds to rounding; that zero is an
extremum of every gap. The functions are in the plain subset of Python that `contimpact.compiling`
compiles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

from ..arrays import Vector

Moved: TypeAlias = tuple[float, float, float]
"""Displacement, velocity and acceleration."""

Motion: TypeAlias = Callable[[Vector, float, Vector], Moved]
"""``motion(head, dt, values)``: where a flight is a time dt after it left."""

Excursion: TypeAlias = tuple[float, float, float, float, float]
"""What `excursions` returns."""

NEWTON_DONE = 1e-6
"""A Newton step below this part of the bracket is the last: the next would be its square, and the
displacement, which turns there, is right to the square of that."""


def excursions(
    motion: Motion,
    head: Vector,
    values: Vector,
    length: float,
    arriving: float,
    left_side: float,
    reached_side: float,
    zeros: Vector,
    phase: float,
    period: float,
) -> Excursion:
    """Return the highest maximum and the lowest minimum inside a flight, and when they are reached.

    Between two zeros of the acceleration the velocity is monotone and has at most one zero. A
    flight that leaves its wall outwards, or reaches the next from outside, does so because an
    impact runs the wrong way; that excursion belongs to the impact and is left out.

    Parameters
    ----------
    motion, head, values
        As in `velocity_zero`.
    length : float
        Duration of the flight.
    arriving : float
        Velocity before the impact that ends it.
    left_side, reached_side : float
        Sides, on this flight, of the walls left and reached; zero where there is none.
    zeros : vector
        Zeros of the acceleration in [0, period), in order.
    phase, period : float
        The flight leaves at `phase`; the zeros repeat every `period`.

    Returns
    -------
    highest, when_highest, lowest, when_lowest : float
        Displacements, and times after leaving; not numbers where there is none.
    slowest : float
        The velocity nearest to zero at a zero of the acceleration inside the flight: where it
        passes zero, two extrema are born or merge. Not a number where there is none.
    """
    high, when_high, low, when_low = math.nan, math.nan, math.nan, math.nan
    slowest = math.nan
    _, speed, acceleration = motion(head, 0.0, values)
    rising = speed > 0.0 or (speed == 0.0 and acceleration > 0.0)
    outwards, inwards = speed * left_side > 0.0, arriving * reached_side < 0.0
    x, dt, maximum, waiting, first = 0.0, 0.0, False, False, True
    left, index, turns, done = 0.0, 0, 0, False
    while not done:
        right = length
        if len(zeros) > 0:
            if index == len(zeros):
                index, turns = 0, turns + 1
            right = zeros[index] - phase
            if turns > 0:
                right += turns * period
            index += 1
            if right <= 0.0:
                continue
        if not right < length:
            right, done = length, True
        next_speed = arriving if done else motion(head, right, values)[1]
        if not done and not abs(next_speed) >= abs(slowest):
            slowest = next_speed
        next_rising = next_speed > 0.0 or (next_speed == 0.0 and rising)
        if next_rising != rising:
            if waiting and maximum and not x <= high:
                high, when_high = x, dt
            elif waiting and not maximum and not x >= low:
                low, when_low = x, dt
            waiting = not (first and outwards and rising == (left_side > 0.0))
            first, maximum = False, rising
            if waiting:
                guess = turn_guess(speed, next_speed, left > 0.0, not done)
                dt, x = velocity_zero(motion, head, values, left, speed, right, next_speed, guess)
        left, speed, rising = right, next_speed, next_rising
    if waiting and not (inwards and maximum == (reached_side > 0.0)):
        if maximum and not x <= high:
            high, when_high = x, dt
        elif not maximum and not x >= low:
            low, when_low = x, dt
    return high, when_high, low, when_low, slowest


def velocity_zero(
    motion: Motion,
    head: Vector,
    values: Vector,
    left: float,
    speed_left: float,
    right: float,
    speed_right: float,
    fraction: float,
) -> tuple[float, float]:
    """Return when the velocity changes sign between two times, and the displacement then.

    Newton's iteration kept inside a bracket in which the velocity is monotone.

    Parameters
    ----------
    motion, head, values
        Called as ``motion(head, dt, values) -> (displacement, velocity, acceleration)``.
    left, right : float
        The times.
    speed_left, speed_right : float
        Velocities there.
    fraction : float
        A guess, as part of the way between them.
    """
    length = right - left
    t = left + length * fraction
    x = 0.0
    for _ in range(80):
        x, speed, acceleration = motion(head, t, values)
        if speed == 0.0:
            return t, x
        if (speed > 0.0) == (speed_left > 0.0) and speed_left != 0.0:
            left = t
        else:
            right = t
        step = speed / acceleration if acceleration != 0.0 else math.inf
        new = t - step
        if left <= new <= right and abs(step) <= NEWTON_DONE * length:
            return new, x - 0.5 * speed * step  # the next step would be its square
        if not left < new < right:
            new = 0.5 * (left + right)
        if right - left <= 2e-16 * max(abs(left), abs(right)):
            return new, x
        t = new
    return t, x


def turn_guess(speed_left: float, speed_right: float, flat_left: bool, flat_right: bool) -> float:
    """Return where a monotone velocity changes sign, as part of the way, roughly.

    Where the acceleration vanishes at an end, the velocity is flat there.
    """
    u = speed_left / (speed_left - speed_right)
    if flat_left and flat_right:  # 3 s^2 - 2 s^3 = u
        return 0.5 - math.sin(math.asin(1.0 - 2.0 * u) / 3.0)
    if flat_right:
        return u / (1.0 + math.sqrt(1.0 - u))
    return math.sqrt(u) if flat_left else u
