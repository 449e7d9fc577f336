"""Excursions and arrivals of flights that follow one law of oscillation, or a linear law.

Each step is a Taylor polynomial about its start, right to rounding, on which the acceleration has
at most one zero: a step is halved until its coefficients show that either the acceleration or its
derivative has no zero in it. So none is missed between samples.

The functions are in the plain subset of Python that `contimpact.compiling` compiles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

from ..arrays import Table, Vector

# Where a flight turns, from motion whose acceleration has known zeros.
#
# Extrema are isolated, not sampled. Between two zeros of the acceleration the velocity is monotone
# and has at most one zero, which a bracketed Newton iteration finds to rounding; that zero is an
# extremum of every gap. The functions are in the plain subset of Python that `contimpact.compiling`
# compiles.

Moved: TypeAlias = tuple[float, float, float]
"""Displacement, velocity and acceleration."""

Motion: TypeAlias = Callable[[Vector, float, Vector], Moved]
"""``motion(head, dt, values)``: where a flight is a time dt after it left."""

Ends: TypeAlias = tuple[float, float, float, float]
"""Of a flight its duration, the velocity before the impact that ends it, and the sides, on this
flight, of the walls left and reached, zero where there is none."""

Excursion: TypeAlias = tuple[float, float, float, float, float]
"""Result of `excursions`."""

NEWTON_DONE = 1e-6
"""A Newton step below this part of the bracket is the last: the next would be its square, and the
displacement, which turns there, is right to the square of that."""


def excursions(
    motion: Motion,
    head: Vector,
    values: Vector,
    ends: Ends,
    zeros: Vector,
    phase: float,
    period: float,
) -> Excursion:
    """Return the highest maximum and the lowest minimum inside a flight, and when they are
    reached.

    Between two zeros of the acceleration the velocity is monotone and has at most one zero. A
    flight that leaves its wall outwards, or reaches the next from outside, does so because an
    impact runs the wrong way; that excursion belongs to the impact and is left out. Beside an
    impact at rest (`TURNED`) it is the flight's where the acceleration leads it there.

    `motion`, `head` and `values` are as in `velocity_zero`. The flight leaves at `phase`; `zeros`
    are those of the acceleration in [0, period), in order.

    Displacements, and times after leaving, are NaN where there is none. Last comes the velocity
    nearest to zero at a zero of the acceleration inside the flight: where it passes zero, two
    extrema are born or merge.
    """
    high, when_high, low, when_low = math.nan, math.nan, math.nan, math.nan
    length, arriving, left_side, reached_side = ends
    slowest = math.nan
    _, speed, acceleration = motion(head, 0.0, values)
    rising = speed > 0.0 or (speed == 0.0 and acceleration > 0.0)
    outwards, inwards = speed * left_side > 0.0, arriving * reached_side < 0.0
    if outwards and acceleration * left_side > 0.0:
        outwards = not abs(speed) <= TURNED * abs(acceleration * length)
    if inwards:
        ending = motion(head, length, values)[2]
        if ending * reached_side > 0.0:
            inwards = not abs(arriving) <= TURNED * abs(ending * length)
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


TURNED = 1e-9
"""A velocity at a flight's end below this part of its change is zero: orbits solve their equations
to 1e-12."""

SMALLEST = 1e-300
"""A depth of which is only known that there is one."""


def speed_at_end(end: Moved, length: float) -> float:
    """Return the velocity of a coordinate at the end of a flight, from what it is there. Where a
    residual alone is left of it, the flight ends because the coordinate turns, and has turned: a
    touch there is the flight's."""
    speed, acceleration = end[1], end[2]
    turned = abs(speed) <= TURNED * abs(acceleration * length)
    return math.copysign(SMALLEST, acceleration) if turned else speed


AT_REST = 1e-12
"""Part of its position by which a coordinate at rest may move, by rounding."""


def gap_at_rest(
    side: float, position: float, begin: float, moved: float, low: float, high: float
) -> float:
    """Return the gap to a wall of a coordinate that rests from `begin` to the end of a flight.

    Not a number where it has moved there, or to its extrema, by more than rounding; zero where it
    rests on the wall.
    """
    least = AT_REST * (abs(position) + abs(begin))
    rests = abs(moved) <= least and not (abs(low) > least or abs(high) > least)
    gap = side * (position - begin) if abs(position - begin) > least else 0.0
    return gap if rests else math.nan


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
    """Return when the velocity changes sign between two times, and the displacement then, by
    ``motion(head, dt, values) -> (displacement, velocity, acceleration)``.

    Newton's iteration kept inside a bracket in which the velocity is monotone, from a guess: a
    fraction of the way between the times.
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


DEGREE = 20
"""Degree of the polynomials of positions; 1/19! is 8e-18."""

START, WIDTH, COEFFICIENTS = range(3)
"""Places in the row of a step: the time at which it starts, its duration, and where coefficients
begin, of powers of the time since its start as a part of its duration: the highest first."""

ROW = COEFFICIENTS + DEGREE + 1
MOST = 2048
"""Steps of a flight, at most; those of stiffer ones are not made."""
HALVINGS = 24
ROUNDING = 4e-16
"""Part of the forces below which an acceleration is their rounding."""
CLOSE = 1e-9
"""Part of a step within which zeros of the acceleration are found. The velocity, which is flat
there, is monotone to the square of that."""


def row_of(table: Table, i: int) -> Vector:
    """Return a row of a table, which grows by it."""
    if i == len(table):
        table.append([0.0] * ROW)
    return table[i]


def row_of_compiled(table: Table, i: int) -> Vector:
    """As `row_of`, for tables that are arrays."""
    return table[i]


def excursion_by_law(
    law: Callable[[Vector, Vector], Any],
    head: Vector,
    values: Vector,
    ends: Ends,
    steps: Table,
    breaks: Vector,
) -> Excursion:
    """As `excursions`, for a flight that has a law of one degree of freedom, as the kernel ``law``
    returns it. `steps` and `breaks` are scratch space for `MOST` steps, and for the zeros of the
    acceleration. The `slowest` is infinite where the flight is too stiff, or too long, for so
    many."""
    _, waves, numbers, state = law(head, values)
    made, found = follow(int(waves), numbers, state, ends[0], steps, breaks)
    return excursion_on_steps(made, found, values, ends, steps, breaks)


def excursion_on_steps(
    made: int, found: int, values: Vector, ends: Ends, steps: Table, breaks: Vector
) -> Excursion:
    """As `excursions`, on the steps that were made, with the zeros of the acceleration that were
    found; its `slowest` is infinite where `made` is negative: the steps would be too many."""
    if made < 0:
        return math.nan, math.nan, math.nan, math.nan, math.inf
    zeros = breaks[:found]
    return excursions(motion_along_steps, steps[:made], values, ends, zeros, 0.0, math.inf)


def motion_along_steps(steps: Table, dt: float, values: Vector) -> Moved:
    """Return displacement, velocity and acceleration at a time after the start."""
    return motion_of_gap((0, 1, len(steps)), dt, steps)


def motion_in_step(row: Vector, dt: float) -> Moved:
    """Return the same on a step."""
    width = row[WIDTH]
    s = (dt - row[START]) / width
    x, v, a = 0.0, 0.0, 0.0
    for c in row[COEFFICIENTS:]:
        a = a * s + v
        v = v * s + x
        x = x * s + c
    return x, v / width, 2.0 * a / (width * width)


def follow(
    waves: int, numbers: Vector, state: Vector, length: float, steps: Table, breaks: Vector
) -> tuple[int, int]:
    """Fill in the steps of a flight, and the times at which the acceleration changes sign.

    Returns how many there are of both; -1 for the first where they would be more than `MOST`.
    """
    kappa, gamma = numbers[0], numbers[1]
    rate = 0.5 * (abs(gamma) + math.sqrt(gamma * gamma + 4.0 * abs(kappa)))
    for i in range(waves):
        rate = max(rate, abs(numbers[3 + 2 * waves + i]))
    if not rate * length < MOST:
        return -1, 0
    widest = length if rate * length <= 1.0 else 1.0 / rate
    least = widest * 0.5**HALVINGS
    made, found, t, x, v, width, sign = 0, 0, 0.0, 0.0, state[1], widest, 0.0
    while t < length:
        if made == MOST:
            return -1, 0
        width = min(width, length - t)
        row = row_of(steps, made)
        size = expand(waves, numbers, state, t, width, x, v, row)
        zeros = zeros_at_most(row, size)
        if zeros > 1 and width > least:
            width *= 0.5
            continue
        begins = 2.0 * row[ROW - 3] / (width * width)
        if sign * begins < 0.0:
            breaks[found] = t  # neither step may have it, by rounding
            found += 1
        after = t + width if t + width < length else length
        x, v, last = motion_in_step(row, after)
        if zeros > 0 and begins * last < 0.0:
            breaks[found] = zero_in(row, begins, last)
            found += 1
        sign = last if last != 0.0 else begins
        t = after
        width = min(2.0 * width, widest)
        made += 1
    return made, found


def expand(
    waves: int,
    numbers: Vector,
    state: Vector,
    t: float,
    width: float,
    x: float,
    v: float,
    row: Vector,
) -> float:
    """Fill in the row of a step from displacement and velocity at its start.

    Returns the size of the forces, in the units of the second coefficient.
    """
    kappa, gamma, square = numbers[0], numbers[1] * width, width * width
    last = ROW - 1
    for k in range(DEGREE + 1):
        row[COEFFICIENTS + k] = 0.0
    rest, from_start = numbers[2 + 2 * waves], kappa * state[0]
    row[last - 2] = rest + from_start
    size = abs(rest) + abs(from_start) + abs(kappa * x) + abs(numbers[1] * v)
    for i in range(waves):
        a, b, frequency = numbers[2 + 2 * i], numbers[3 + 2 * i], numbers[3 + 2 * waves + i]
        cosine, sine = state[2 + 2 * i], state[3 + 2 * i]
        c, s = math.cos(frequency * t), math.sin(frequency * t)
        cosine, sine = cosine * c - sine * s, sine * c + cosine * s
        now, next_ = a * cosine + b * sine, b * cosine - a * sine
        angle = frequency * width
        size += abs(now) + abs(next_)
        for k in range(DEGREE - 1):
            row[last - 2 - k] += now
            now, next_ = angle * next_ / (k + 1), -angle * now / (k + 1)
    one, two = x, v * width
    row[last], row[last - 1] = one, two
    for k in range(DEGREE - 1):
        pushed = square * (kappa * one + row[last - 2 - k]) / (k + 1) + gamma * two
        one, two = two, pushed / (k + 2)
        row[last - 2 - k] = two
    row[START], row[WIDTH] = t, width
    return square * size


def zeros_at_most(row: Vector, size: float) -> int:
    """Return how many zeros the acceleration may have in a step: none, one, or (2) more.

    By the ranges of its first terms, and the sums of the sizes of all others.
    """
    last = ROW - 1
    a0, a1, a2 = 2.0 * row[last - 2], 6.0 * row[last - 3], 12.0 * row[last - 4]
    more, steeper, factor = 0.0, 0.0, 20.0
    for k in range(3, DEGREE - 1):
        term = factor * abs(row[last - 2 - k])
        more += term
        steeper += k * term
        factor += 2.0 * k + 4.0
    end, slope = a0 + a1 + a2, a1 + 2.0 * a2
    low, high = min(a0, end), max(a0, end)
    if a1 * slope < 0.0:
        turn = a0 - 0.25 * a1 * a1 / a2
        low, high = min(low, turn), max(high, turn)
    margin = more + ROUNDING * size
    if low > margin or high < -margin or max(high, -low) <= ROUNDING * size - more:
        return 0
    return 1 if min(a1, slope) > steeper or max(a1, slope) < -steeper else 2


def zero_in(row: Vector, begins: float, ends: float) -> float:
    """Return where in a step the acceleration vanishes, by the Illinois method."""
    low, width = row[START], row[WIDTH]
    high, kept = low + width, 0
    below, above = begins, ends
    t = low
    for _ in range(60):
        t = (low * above - high * below) / (above - below)
        if not low < t < high:
            t = 0.5 * (low + high)
        _, _, value = motion_in_step(row, t)
        if value == 0.0 or high - low < CLOSE * width:
            break
        if (value < 0.0) == (begins < 0.0):
            low, below = t, value
            above, kept = (0.5 * above if kept < 0 else above), -1
        else:
            high, above = t, value
            below, kept = (0.5 * below if kept > 0 else below), 1
    return t


# A linear flight of several coordinates in steps, as above for one.
#
# Motion is :math:`\ddot u = K(x_0 + u) + \Gamma\dot u + f(t)` with u the way from the start. Steps
# are common to all gap coordinates: none has an acceleration with more than one zero in a step.

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
