"""Along a flight: where it turns, and where it comes nearest to a wall.

Extrema are isolated, not sampled. Between two zeros of the acceleration the velocity is monotone
and has at most one zero, which a bracketed Newton iteration finds to rounding; that zero is an
extremum of every gap.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from ..arrays import Array, Vector
from ..models.guards import Guard
from .arithmetic import ARRAYS, evaluate_in
from .kernels import Kernels
from .track import track_of
from .zeros import chebyshev_zeros, time_zeros

Moved: TypeAlias = tuple[float, float, float]
"""Displacement, velocity and acceleration."""

Motion: TypeAlias = Callable[[Vector, float, Vector], Moved]
"""``motion(head, dt, values)``: where a flight is a time dt after it left."""

Excursion: TypeAlias = tuple[float, float, float, float, float]
"""What `excursions` returns."""

NEWTON_DONE = 1e-6
"""A Newton step below this part of the bracket is the last: the next would be its square, and the
displacement, which turns there, is right to the square of that."""


@dataclass(frozen=True)
class Touch:
    """A local minimum of the gap to a wall inside a flight."""

    flight: int
    wall: str
    time: float
    gap: float


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


@dataclass(frozen=True)
class FlightGaps:
    """The nearest touches of one flight, by wall, and whether the flight runs forward in time.

    `slowest` is the velocity nearest to zero where the acceleration vanishes; see `excursions`.
    """

    duration: float
    touches: tuple[Touch | None, ...]
    slowest: float = math.nan


def flight_gaps(
    kernels: Kernels, walls: str, values: Sequence[float], impacts: Array, span: float
) -> list[FlightGaps]:
    """Return the nearest interior touch of each wall on each flight of an orbit.

    A flight that leaves its wall outwards, or reaches the next from outside, does so because an
    impact runs the wrong way; that excursion belongs to the impact and is not a touch.

    Parameters
    ----------
    kernels : Kernels
    walls : str
        The word.
    values : sequence of float
        Parameter values, in the model's order.
    impacts : ndarray of shape (N, m)
        Times and section coordinates.
    span : float
        Period of the orbit.
    """
    setup = kernels.setup(*values)
    period, named = setup.period, kernels.model.WALLS
    places = {w.name: i for i, w in enumerate(named)}
    passages = kernels.passages
    zeros = time_zeros(kernels.harmonics(*values), period)
    excursion = excursion_of(kernels, zeros is not None)
    rows = impacts.tolist()
    rows.append([rows[0][0] + span, *rows[0][1:]])
    result = []
    for k, wall in enumerate(walls):
        leave, arrive = rows[k], rows[k + 1]
        i, j = places[wall], places[walls[(k + 1) % len(walls)]]
        length = arrive[0] - leave[0]
        if not length > 0.0:
            result.append(FlightGaps(length, (None,) * len(named)))
            continue
        head, phase = (i, *leave), leave[0] % period
        sides = passages.leaving[i], named[j].side
        found = excursion(head, values, length, arrive[1], *sides, zeros, phase, period)
        touches = tuple(
            touch_of(k, leave[0], w, setup.walls[place] - setup.walls[i], found) if meets else None
            for place, (w, meets) in enumerate(zip(named, passages.watched[i], strict=True))
        )
        result.append(FlightGaps(length, touches, found[4]))
    return result


def excursion_of(kernels: Kernels, in_time: bool) -> Callable[..., Any]:
    """Return `excursions` for the flights of a model, without its first argument.

    Where the acceleration depends on the state (not `in_time`), its zeros are found for each
    flight, and those given are not used.
    """
    motion, named = kernels.motions, kernels.model.WALLS
    if in_time:
        return functools.partial(excursions, motion)

    def excursion(
        head: Vector,
        values: Vector,
        length: float,
        arriving: float,
        left_side: float,
        reached_side: float,
        *_: Any,
    ) -> Excursion:
        wall = named[head[0]]
        if kernels.linear(wall.name):
            track = track_of(kernels.law(wall.name)(*head[1:], *values), length)
            curve = track.along(wall.row(kernels.model.DEGREES_OF_FREEDOM), from_start=True)
            sides, breaks = (left_side, reached_side), curve.breaks()
            return excursions(curve, (), (), length, arriving, *sides, breaks, 0.0, math.inf)
        vectorised = evaluate_in(kernels.motion(wall.name), ARRAYS)
        breaks = chebyshev_zeros(lambda dt: vectorised(*head[1:], dt, *values)[2], length)
        return excursions(
            motion, head, values, length, arriving, left_side, reached_side, breaks, 0.0, math.inf
        )

    return excursion


def touch_of(flight: int, start: float, wall: Guard, distance: float, found: Any) -> Touch | None:
    """Return the smallest gap to a wall among the turning points towards it.

    Parameters
    ----------
    flight : int
    start : float
        The time from which `found` counts.
    wall : Guard
    distance : float
        Of the wall, from where displacements are measured.
    found : tuple
        What `excursions` returns.
    """
    high, when_high, low, when_low = found[:4]
    gap, dt = (distance - high, when_high) if wall.side > 0 else (low - distance, when_low)
    return None if math.isnan(gap) else Touch(flight, wall.name, start + dt, gap)
