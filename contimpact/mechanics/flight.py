"""The gaps along a flight: where it comes nearest to a wall, and whether the orbit is physical.

Extrema are isolated, not sampled. Between two zeros of the acceleration the velocity is monotone
and has at most one zero, which a bracketed Newton iteration finds to rounding; that zero is an
extremum of every gap. The zeros of the acceleration follow from its harmonics where it depends on
time alone, and otherwise from a Chebyshev interpolant resolved to rounding.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .kernels import Kernels
from .model import Wall

Array = np.ndarray[Any, Any]

NEWTON_DONE = 1e-6
"""A Newton step below this part of the bracket is the last: the next would be its square, and the
displacement, which turns there, is right to the square of that."""

_DEGREES = (16, 32, 64)

_NOISE = 1e-5
"""Last coefficients below this part of the largest that no longer fall are the rounding of the
function itself, which grows with the angles in it."""


@dataclass(frozen=True)
class Touch:
    """A local minimum of the gap to a wall inside a flight."""

    flight: int
    wall: str
    time: float
    gap: float


@dataclass(frozen=True)
class Verdict:
    """Whether an orbit is physical; if not, the first reason found. `smallest_gap` is not a
    number where no flight comes nearer to a wall than at its ends."""

    physical: bool
    reason: str | None
    smallest_gap: float


def time_zeros(harmonics: Sequence[float], period: float) -> list[float] | None:
    """Return where in [0, period) the acceleration changes sign, or None if it depends on more.

    Parameters
    ----------
    harmonics : sequence of float
        What the kernel ``harmonics`` returns: mean, then k, a_k, b_k for each harmonic.
    period : float
    """
    mean, terms = harmonics[0], harmonics[1:]
    if math.isnan(mean):
        return None
    series = [(int(terms[i]), terms[i + 1], terms[i + 2]) for i in range(0, len(terms), 3)]
    if not series:
        return []
    if len(series) == 1 and series[0][0] == 1:
        zeros = [0.0, 0.0]
        return zeros[: single_zeros(mean, *series[0][1:], period, zeros)]
    angles = _trigonometric_zeros(mean, series)
    return sorted((angle % (2.0 * math.pi)) * period / (2.0 * math.pi) for angle in angles)


def single_zeros(mean, a, b, period, zeros):
    """Fill in where in [0, period) mean + a cos + b sin vanishes, in order; returns how many."""
    size = math.sqrt(a * a + b * b)
    if not abs(mean) < size:
        return 0
    middle, half = math.atan2(b, a), math.acos(-mean / size)
    turn = 2.0 * math.pi
    one = ((middle - half) % turn) * period / turn
    other = ((middle + half) % turn) * period / turn
    zeros[0], zeros[1] = min(one, other), max(one, other)
    return 2


def _trigonometric_zeros(mean: float, series: Sequence[tuple[int, float, float]]) -> list[float]:
    """Angles of the roots near the unit circle of sum_k c_k z^k, polished by Newton.

    A multiple root scatters around its place, so roots well off the circle are kept: a place where
    the acceleration does not change sign is one break too many, and harmless.
    """
    highest = max(k for k, _, _ in series)
    coefficients = np.zeros(2 * highest + 1, dtype=complex)
    coefficients[highest] = mean
    for k, a, b in series:
        coefficients[highest + k] += 0.5 * (a - 1j * b)
        coefficients[highest - k] += 0.5 * (a + 1j * b)
    roots = np.roots(coefficients[::-1])
    return [_polished(angle, mean, series) for angle in _near_circle(roots)]


def _near_circle(roots: Array) -> list[float]:
    near = np.abs(np.log(np.abs(roots[roots != 0.0]))) < 0.3
    return np.angle(roots[roots != 0.0][near]).tolist()


def _polished(angle: float, mean: float, series: Sequence[tuple[int, float, float]]) -> float:
    """Newton's iteration for a root of the trigonometric sum, as long as its steps are small."""
    for _ in range(3):
        value, slope = mean, 0.0
        for k, a, b in series:
            cosine, sine = math.cos(k * angle), math.sin(k * angle)
            value += a * cosine + b * sine
            slope += k * (b * cosine - a * sine)
        step = value / slope if slope else math.inf
        if not abs(step) < 1e-3:
            break
        angle -= step
    return angle


def chebyshev_zeros(
    function: Callable[[Array], Array], length: float, cuts: int = 12
) -> list[float]:
    """Return the zeros in (0, length) of a smooth function, from its Chebyshev interpolant.

    The degree is doubled until the last coefficients are rounding, the function's own where that is
    larger; a function that is not resolved by the highest degree is cut in halves. A zero at a cut
    may be returned twice, but is not lost. A piece that is still not resolved after all cuts is
    rounding alone: its sign changes on a mesh are returned.
    """
    from numpy.polynomial import chebyshev

    before = math.inf
    for degree in _DEGREES:
        nodes = np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))
        values = np.broadcast_to(function(0.5 * length * (nodes + 1.0)), nodes.shape)
        coefficients = _chebyshev_coefficients(values)
        size = float(np.max(np.abs(coefficients)))
        if size == 0.0:
            return []
        tail = float(np.max(np.abs(coefficients[-3:]))) / size
        if tail < 1e-14 or (tail < _NOISE and tail > 0.1 * before):
            kept = np.nonzero(np.abs(coefficients) > 1e-15 * size)[0][-1] + 1
            roots = chebyshev.chebroots(coefficients[:kept]) if kept > 1 else np.array([])
            near = (np.abs(roots.imag) < 1e-6) & (np.abs(roots.real) <= 1.0 + 1e-9)
            return sorted((0.5 * length * (np.clip(roots.real[near], -1.0, 1.0) + 1.0)).tolist())
        before = tail
    if cuts == 0:
        return _mesh_zeros(function, length)
    half = 0.5 * length
    later = chebyshev_zeros(lambda t: function(half + t), half, cuts - 1)
    return chebyshev_zeros(function, half, cuts - 1) + [half + root for root in later]


def _mesh_zeros(function: Callable[[Array], Array], length: float) -> list[float]:
    times = np.linspace(0.0, length, 257)
    signs = np.broadcast_to(function(times), times.shape) >= 0.0
    changes = np.nonzero(signs[1:] != signs[:-1])[0]
    return (0.5 * (times[changes] + times[changes + 1])).tolist()


def _chebyshev_coefficients(values: Array) -> Array:
    """Chebyshev coefficients of the interpolant through values at the Chebyshev roots."""
    n = len(values)
    angles = np.pi * (np.arange(n) + 0.5) / n
    coefficients = 2.0 / n * np.cos(np.outer(np.arange(n), angles)) @ values
    coefficients[0] *= 0.5
    return coefficients


def excursions(
    motion, head, values, length, arriving, left_side, reached_side, zeros, phase, period
):  # fmt: skip
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
        Sides of the walls left and reached.
    zeros : vector
        Zeros of the acceleration in [0, period), in order.
    phase, period : float
        The flight leaves at `phase`; the zeros repeat every `period`.

    Returns
    -------
    highest, when_highest, lowest, when_lowest : float
        Displacements, and times after leaving; not numbers where there is none.
    """
    high, when_high, low, when_low = math.nan, math.nan, math.nan, math.nan
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
    return high, when_high, low, when_low


def velocity_zero(motion, head, values, left, speed_left, right, speed_right, fraction):
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


def turn_guess(speed_left, speed_right, flat_left, flat_right):
    """Return where a monotone velocity changes sign, as part of the way, roughly.

    Where the acceleration vanishes at an end, the velocity is flat there.
    """
    u = speed_left / (speed_left - speed_right)
    if flat_left and flat_right:  # 3 s^2 - 2 s^3 = u
        return 0.5 - math.sin(math.asin(1.0 - 2.0 * u) / 3.0)
    if flat_right:
        return u / (1.0 + math.sqrt(1.0 - u))
    return math.sqrt(u) if flat_left else u


def wall_arrival(motion, head, values, left, at, right, reached, wall, rising):
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


def first_hit(motion, head, values, breaks, left, rising, low, high):
    """Return the first arrival at a wall; as `first_arrival`, between times that are given.

    Parameters
    ----------
    breaks : vector
        Zeros of the acceleration after `left`, in order; further times among them do no harm.
    """
    return first_arrival(motion, head, values, breaks, 0.0, 0.0, 1, left, rising, low, high)


def first_arrival(motion, head, values, zeros, phase, period, most, left, rising, low, high):
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
    motion, head, values, left, at, right, reached, turned, rising, low, high
):  # fmt: skip
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


def beyond(x, wall, rising):
    """Whether a displacement has come to a wall."""
    return x >= wall if rising else x <= wall


MARGIN = 1e-9
"""Part of the displacements by which tangents that tell of a turn must miss a wall."""


def turns_before(length, at, reached, wall, rising):
    """Whether a monotone velocity surely changes sign before a wall is reached.

    The displacement lies on one side of the tangents at both ends: it is enough that these meet
    before the wall. That it is not sure says nothing. `at` and `reached` are as in `hit_between`.
    """
    if at[1] == reached[1]:
        return False
    dt = (reached[0] - at[0] - reached[1] * length) / (at[1] - reached[1])
    margin = MARGIN * (abs(at[0]) + abs(reached[0]) + abs(at[1]) * length)
    return not beyond(at[0] + at[1] * dt + (margin if rising else -margin), wall, rising)


@dataclass(frozen=True)
class FlightGaps:
    """The nearest touches of one flight, by wall, and whether the flight runs forward in time."""

    duration: float
    touches: tuple[Touch | None, ...]


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
    period, named = setup[0], kernels.model.WALLS
    places = {w.name: i for i, w in enumerate(named)}
    positions = setup[3 : 3 + len(named)]
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
        phase = leave[0] % period
        found = excursion(
            (i, *leave), values, length, arrive[1], named[i].side, named[j].side, zeros, phase,
            period,
        )  # fmt: skip
        touches = tuple(
            _touch(k, leave[0], w, positions[place] - positions[i], found)
            for place, w in enumerate(named)
        )
        result.append(FlightGaps(length, touches))
    return result


def excursion_of(kernels: Kernels, in_time: bool) -> Callable[..., Any]:
    """Return `excursions` for the flights of a model, without its first argument.

    Where the acceleration depends on the state (not `in_time`), its zeros are found for each
    flight, and those given are not used.
    """
    motion, named = kernels.motions, kernels.model.WALLS
    if in_time:
        return functools.partial(excursions, motion)

    def excursion(head, values, length, arriving, left_side, reached_side, *_):
        vectorised = kernels.vectorised(kernels.motion(named[head[0]].name))
        breaks = chebyshev_zeros(lambda dt: vectorised(*head[1:], dt, *values)[2], length)
        return excursions(
            motion, head, values, length, arriving, left_side, reached_side, breaks, 0.0, math.inf
        )

    return excursion


def _touch(flight: int, start: float, wall: Wall, distance: float, found: Any) -> Touch | None:
    """The smallest gap to a wall among the turning points towards it."""
    high, when_high, low, when_low = found
    gap, dt = (distance - high, when_high) if wall.side > 0 else (low - distance, when_low)
    return None if math.isnan(gap) else Touch(flight, wall.name, start + dt, gap)


def judge(
    word: str, named: Sequence[Wall], impacts: Array, gaps: Sequence[FlightGaps],
    forgive_touches: Collection[tuple[int, str]] = (), forgive_impact: int | None = None,
) -> Verdict:  # fmt: skip
    """Decide whether an orbit is physical.

    Parameters
    ----------
    word, named, impacts, gaps
        As in `findings`.
    forgive_touches : collection of (flight, wall)
        Touches that are not held against the orbit: the grazing event itself.
    forgive_impact : int, optional
        An impact whose direction is not held against it: the zero velocity itself.
    """
    return verdict_of(
        findings(word, named, impacts, gaps, forgive_touches, forgive_impact), word, named
    )


def findings(
    word: str, named: Sequence[Wall], impacts: Array, gaps: Sequence[FlightGaps],
    forgive_touches: Collection[tuple[int, str]] = (), forgive_impact: int | None = None,
) -> tuple[float, ...]:  # fmt: skip
    """Return what `verdict` says of an orbit.

    Parameters
    ----------
    word : str
    named : sequence of Wall
    impacts : ndarray of shape (N, m)
    gaps : sequence of FlightGaps
    forgive_touches, forgive_impact
        As in `judge`.
    """
    places = {w.name: i for i, w in enumerate(named)}
    walls = [places[name] for name in word]
    touches = [
        None if t is None or (k, t.wall) in forgive_touches else t
        for k, flight in enumerate(gaps)
        for t in flight.touches
    ]
    return verdict(
        walls, [float(w.side) for w in named], [flight.duration for flight in gaps],
        [math.nan if t is None else t.gap for t in touches],
        [math.nan if t is None else t.time for t in touches],
        impacts[:, 1].tolist(), -1 if forgive_impact is None else forgive_impact,
    )  # fmt: skip


def verdict_of(found: Sequence[float], word: str, named: Sequence[Wall]) -> Verdict:
    """Return what `verdict` found as an object."""
    return Verdict(found[0] == PHYSICAL, reason_of(found, word, named), found[5])


PHYSICAL, OUT_OF_ORDER, PASSES = 0, 1, 2
"""What `verdict` says; 3 is for an impact that runs the wrong way."""


def verdict(walls, sides, durations, gaps, times, velocities, forgiven):
    """Decide whether an orbit is physical, from numbers.

    Parameters
    ----------
    walls : vector of int
        The word.
    sides : vector
        Of the walls.
    durations : vector
        Of the flights.
    gaps, times : vector
        Smallest gap of each flight to each wall, and when; not numbers where there is none.
    velocities : vector
        Before the impacts.
    forgiven : int
        An impact whose direction does not count, or -1.

    Returns
    -------
    what : int
        0 for physical, or why not.
    place, wall : int
        Of the flight or impact, and of the wall passed.
    amount, when : float
        The duration, the depth or the velocity; the time of a touch.
    smallest : float
        Smallest gap of all; not a number where there is none.
    """
    what, place, wall, amount, when, smallest = 0, 0, 0, 0.0, 0.0, math.inf
    count = len(sides)
    for k in range(len(walls)):
        if durations[k] < 0.0 and what == 0:
            what, place, amount = 1, k, durations[k]
        for i in range(count):
            gap = gaps[count * k + i]
            if gap < smallest:  # not where there is none
                smallest = gap
                if gap < 0.0 and what == 0:
                    what, place, wall, amount, when = 2, k, i, -gap, times[count * k + i]
    for k in range(len(walls)):
        if velocities[k] * sides[walls[k]] < 0.0 and k != forgiven and what != 3:
            what, place, amount = 3, k, velocities[k]
    return what, place, wall, amount, when, smallest if smallest < math.inf else math.nan


def reason_of(found: Any, word: str, named: Sequence[Wall]) -> str | None:
    """Return what `verdict` found as a sentence; None where the orbit is physical."""
    if found[0] == PHYSICAL:
        return None
    what, k, wall = (int(number) for number in found[:3])
    amount, when = found[3], found[4]
    flight = f"flight {k} ({word[k]} to {word[(k + 1) % len(word)]})"
    if what == OUT_OF_ORDER:
        return f"impacts out of order: {flight} lasts {amount:.6g}"
    if what == PASSES:
        return f"{flight} passes wall {named[wall].name} by {amount:.6g} at t = {when:.6g}"
    return f"impact {k} on wall {word[k]} runs the wrong way: velocity {amount:.6g}"
