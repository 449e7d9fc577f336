r"""A linear flight of several coordinates in steps, as `oscillation` has it for one.

Motion is :math:`\ddot u = K(x_0 + u) + \Gamma\dot u + f(t)` with u the way from the start. Steps
are common to all gap coordinates: none has an acceleration with more than one zero in a step.

The functions are in the plain subset of Python that `contimpact.compiling` compiles.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..arrays import Table, Vector
from .oscillation import (
    COEFFICIENTS,
    DEGREE,
    HALVINGS,
    MOST,
    ROW,
    START,
    WIDTH,
    Moved,
    motion_in_step,
    row_of,
    zero_in,
    zeros_at_most,
)

LAST = ROW - 1


class FollowedFlight(NamedTuple):
    """What is known of a flight that is followed."""

    own: Table
    """A row of a step for each coordinate."""
    steps: Table
    """A row for each gap coordinate, step after step."""
    breaks: Vector
    """Times at which accelerations change sign: places for 2 `MOST` times of each gap
    coordinate."""
    found: Vector
    signs: Vector
    zeros: Vector
    """`found`, `signs`, `zeros`: of each gap coordinate, how many times those are, its last
    acceleration, and how many zeros this may have in the step under way."""
    moving: Vector
    forces: Vector
    """`moving`, `forces`: position and velocity of each coordinate, and the size of the forces on
    it."""


def follow_all(
    d: int,
    waves: int,
    numbers: Vector,
    state: Vector,
    weights: Vector,
    count: int,
    length: float,
    flown: FollowedFlight,
) -> int:
    """Fill in the steps of a flight, and when the gap coordinates' accelerations change sign.

    The law is as the kernel ``law`` returns it; `weights` are of the coordinates in each of `count`
    gap coordinates. Returns how many steps there are; -1 if they would be more than `MOST`.
    """
    rate = frequency_bound(d, waves, numbers)
    if not rate * length < MOST:
        return -1
    widest = length if rate * length <= 1.0 else 1.0 / rate
    least = widest * 0.5**HALVINGS
    for g in range(count):
        flown.found[g], flown.signs[g] = 0.0, 0.0
    for i in range(d):
        flown.moving[i], flown.moving[d + i] = 0.0, state[d + i]
    made, t, width = 0, 0.0, widest
    while t < length:
        if made == MOST:
            return -1
        width = min(width, length - t)
        expand_all(d, waves, numbers, state, t, width, flown)
        if zeros_of_all(d, weights, count, made, flown) > 1.0 and width > least:
            width *= 0.5
            continue
        after = t + width if t + width < length else length
        for g in range(count):
            record_break(g, count, made, after, flown)
        for i in range(d):
            x, v, _ = motion_in_step(flown.own[i], after)
            flown.moving[i], flown.moving[d + i] = x, v
        t = after
        width = min(2.0 * width, widest)
        made += 1
    return made


def frequency_bound(d: int, waves: int, numbers: Vector) -> float:
    """Return a bound of the frequencies: as of one coordinate, by the largest sums of rows."""
    n = 2 * d + 2 * waves + 1
    kappa, gamma = 0.0, 0.0
    for i in range(d):
        stiffness, damping = 0.0, 0.0
        for j in range(d):
            stiffness += abs(numbers[n * i + j])
            damping += abs(numbers[n * i + d + j])
        kappa, gamma = max(kappa, stiffness), max(gamma, damping)
    rate = 0.5 * (gamma + math.sqrt(gamma * gamma + 4.0 * kappa))
    for i in range(waves):
        rate = max(rate, abs(numbers[d * n + i]))
    return rate


def expand_all(
    d: int,
    waves: int,
    numbers: Vector,
    state: Vector,
    t: float,
    width: float,
    flown: FollowedFlight,
) -> None:
    """Fill in the coordinates' rows of a step, and the sizes of the forces in its units."""
    n, square = 2 * d + 2 * waves + 1, width * width
    own, moving = flown.own, flown.moving
    for i in range(d):
        row, at = own[i], n * i
        row[START], row[WIDTH] = t, width
        for k in range(DEGREE + 1):
            row[COEFFICIENTS + k] = 0.0
        force = numbers[at + n - 1]
        size = abs(force)
        for j in range(d):
            pull = numbers[at + j] * state[j]
            force += pull
            size += abs(pull) + abs(numbers[at + j] * moving[j])
            size += abs(numbers[at + d + j] * moving[d + j])
        row[LAST - 2] = force
        flown.forces[i] = size
    for w in range(waves):
        frequency, cosine, sine = numbers[d * n + w], state[2 * d + 2 * w], state[2 * d + 2 * w + 1]
        c, s = math.cos(frequency * t), math.sin(frequency * t)
        cosine, sine = cosine * c - sine * s, sine * c + cosine * s
        angle = frequency * width
        for i in range(d):
            a, b = numbers[n * i + 2 * d + 2 * w], numbers[n * i + 2 * d + 2 * w + 1]
            if a == 0.0 and b == 0.0:
                continue
            row = own[i]
            now, later = a * cosine + b * sine, b * cosine - a * sine
            flown.forces[i] += abs(now) + abs(later)
            for k in range(DEGREE - 1):
                row[LAST - 2 - k] += now
                now, later = angle * later / (k + 1), -angle * now / (k + 1)
    for i in range(d):
        own[i][LAST], own[i][LAST - 1] = moving[i], moving[d + i] * width
        flown.forces[i] *= square
    for k in range(DEGREE - 1):
        for i in range(d):
            row, at = own[i], n * i
            pulled, damped = row[LAST - 2 - k], 0.0
            for j in range(d):
                pulled += numbers[at + j] * own[j][LAST - k]
                damped += numbers[at + d + j] * own[j][LAST - 1 - k]
            row[LAST - 2 - k] = (square * pulled / (k + 1) + width * damped) / (k + 2)


def zeros_of_all(d: int, weights: Vector, count: int, made: int, flown: FollowedFlight) -> float:
    """Fill in the rows of the gap coordinates; returns the most zeros of an acceleration."""
    most = 0.0
    for g in range(count):
        row, size = row_of(flown.steps, count * made + g), 0.0
        for k in range(ROW):
            row[k] = 0.0
        for i in range(d):
            weight = weights[d * g + i]
            if weight != 0.0:
                size += abs(weight) * flown.forces[i]
                for k in range(COEFFICIENTS, ROW):
                    row[k] += weight * flown.own[i][k]
        row[START], row[WIDTH] = flown.own[0][START], flown.own[0][WIDTH]
        flown.zeros[g] = float(zeros_at_most(row, size))
        most = max(most, flown.zeros[g])
    return most


def record_break(g: int, count: int, made: int, after: float, flown: FollowedFlight) -> None:
    """Record where the acceleration of a gap coordinate changes sign at or in a step."""
    row, place, found = flown.steps[count * made + g], 2 * MOST * g, int(flown.found[g])
    begins = 2.0 * row[LAST - 2] / (row[WIDTH] * row[WIDTH])
    if flown.signs[g] * begins < 0.0:
        flown.breaks[place + found] = row[START]  # neither step may have it, by rounding
        found += 1
    _, _, last = motion_in_step(row, after)
    if flown.zeros[g] > 0.0 and begins * last < 0.0:
        flown.breaks[place + found] = zero_in(row, begins, last)
        found += 1
    flown.found[g] = float(found)
    flown.signs[g] = last if last != 0.0 else begins


def motion_of_gap(head: tuple[int, int, int], dt: float, steps: Table) -> Moved:
    """Return how far a gap coordinate has come, its velocity and its acceleration.

    `head` is its number, how many gap coordinates there are, and how many steps.
    """
    g, count, made = head
    low, high = 0, made - 1
    while low < high:
        middle = (low + high + 1) // 2
        if steps[count * middle][START] <= dt:
            low = middle
        else:
            high = middle - 1
    return motion_in_step(steps[count * low + g], dt)
