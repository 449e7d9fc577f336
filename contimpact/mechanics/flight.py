"""The gaps along a flight: where it comes nearest to a wall, and whether the orbit is physical.

Extrema are isolated, not sampled. Between two zeros of the acceleration the velocity is monotone
and has at most one zero, which a bracketed Newton iteration finds to rounding; that zero is an
extremum of every gap. The zeros of the acceleration follow from its harmonics where it depends on
time alone, and otherwise from a Chebyshev interpolant resolved to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .kernels import Kernels
from .model import Wall

Array = np.ndarray[Any, Any]

NEWTON_DONE = 1e-9
"""A Newton step below this part of the bracket is the last: the next would be its square."""

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


@dataclass(frozen=True)
class Extremum:
    """A turning point of the gap coordinate: after the time `dt`, displaced from the wall left."""

    dt: float
    displacement: float
    maximum: bool


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
        _, a, b = series[0]
        size = math.hypot(a, b)
        if not abs(mean) < size:
            return []
        middle, half = math.atan2(b, a), math.acos(-mean / size)
        angles = [middle - half, middle + half]
    else:
        angles = _trigonometric_zeros(mean, series)
    return sorted((angle % (2.0 * math.pi)) * period / (2.0 * math.pi) for angle in angles)


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


def extrema(
    motion: Callable[[float], tuple[float, float, float]], length: float,
    speed_at_end: float, breaks: Sequence[float],
) -> list[Extremum]:  # fmt: skip
    """Return the turning points of a flight, in order.

    Parameters
    ----------
    motion : callable ``motion(dt) -> (displacement, velocity, acceleration)``
    length : float
        Duration of the flight.
    speed_at_end : float
        Velocity before the impact that ends it.
    breaks : sequence of float
        Zeros of the acceleration in (0, length), in order.
    """
    found = []
    _, speed, acceleration = motion(0.0)
    rising = speed > 0.0 or (speed == 0.0 and acceleration > 0.0)
    left = 0.0
    for right in (*breaks, length):
        next_speed = speed_at_end if right == length else motion(right)[1]
        next_rising = next_speed > 0.0 or (next_speed == 0.0 and rising)
        if next_rising != rising:
            dt = velocity_zero(motion, (), (), left, speed, right, next_speed)
            found.append(Extremum(dt, motion(dt)[0], maximum=rising))
        left, speed, rising = right, next_speed, next_rising
    return found


def velocity_zero(motion, head, values, left, speed_left, right, speed_right):
    """Return where the velocity changes sign between `left` and `right`, where it is monotone.

    Newton's iteration kept inside a bracket. `motion` is called as
    ``motion(*head, dt, *values) -> (displacement, velocity, acceleration)``.
    """
    length = right - left
    t = left + length * speed_left / (speed_left - speed_right)
    for _ in range(80):
        _, speed, acceleration = motion(*head, t, *values)
        if speed == 0.0:
            return t
        if (speed > 0.0) == (speed_left > 0.0) and speed_left != 0.0:
            left = t
        else:
            right = t
        step = speed / acceleration if acceleration != 0.0 else math.inf
        new = t - step
        if left <= new <= right and abs(step) <= NEWTON_DONE * length:
            return new  # the next step would be its square
        if not left < new < right:
            new = 0.5 * (left + right)
        if right - left <= 2e-16 * max(abs(left), abs(right)):
            return new
        t = new
    return t


def wall_arrival(motion, head, values, left, speed_left, right, speed_right, wall, rising):
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
    speed_left, speed_right : float
        Velocities there.
    wall : float
        Displacement of the wall.
    rising : bool
        Whether the displacement grows towards it.

    Returns
    -------
    dt, speed : float
        The velocity does not run away from the wall, not even by rounding.
    """
    t = left if abs(speed_left) > abs(speed_right) else right
    speed = 0.0
    for _ in range(100):
        x, speed, acceleration = motion(*head, t, *values)
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


def first_hit(motion, head, values, breaks, left, speed_left, rising, low, high):
    """Return the first arrival at a wall, with certainty.

    Between two zeros of the acceleration the velocity is monotone, so it has at most one zero
    there; between the turning points the displacement is monotone, so that comparing it with the
    walls at the ends of each piece misses nothing. A touch counts as an arrival.

    Parameters
    ----------
    motion, head, values
        As in `velocity_zero`; displacements are measured from where the flight starts.
    breaks : sequence of float
        Zeros of the acceleration after `left`, in order; further times among them do no harm.
    left, speed_left : float
        Time so far without a hit, and the velocity then.
    rising : bool
        Direction of motion then; it decides where the velocity is zero.
    low, high : float
        Displacements of the walls below and above; infinite where there is none.

    Returns
    -------
    side : int
        +1 at the wall above, -1 at the one below, 0 for no hit up to the last break.
    dt, speed : float
        Time and velocity before the impact; without a hit, at the last break.
    rising : bool
        Direction of motion at that time.
    """
    for right in breaks:
        x, speed_right, _ = motion(*head, right, *values)
        if speed_right != 0.0 and (speed_right > 0.0) != rising:
            turn = velocity_zero(motion, head, values, left, speed_left, right, speed_right)
            x_turn = motion(*head, turn, *values)[0]
            wall = high if rising else low
            if (x_turn >= wall) if rising else (x_turn <= wall):
                arrival = wall_arrival(
                    motion, head, values, left, speed_left, turn, 0.0, wall, rising
                )
                return (1 if rising else -1), *arrival, rising
            left, speed_left, rising = turn, 0.0, not rising
        wall = high if rising else low
        if (x >= wall) if rising else (x <= wall):
            arrival = wall_arrival(
                motion, head, values, left, speed_left, right, speed_right, wall, rising
            )
            return (1 if rising else -1), *arrival, rising
        left, speed_left = right, speed_right
    return 0, left, speed_left, rising


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
    positions = dict(zip((w.name for w in named), setup[3:], strict=False))
    sides = {w.name: w for w in named}
    zeros = time_zeros(kernels.harmonics(*values), period)
    rows = impacts.tolist()
    rows.append([rows[0][0] + span, *rows[0][1:]])
    result = []
    for k, wall in enumerate(walls):
        following = walls[(k + 1) % len(walls)]
        leave, arrive = rows[k], rows[k + 1]
        length = arrive[0] - leave[0]
        if not length > 0.0:
            result.append(FlightGaps(length, (None,) * len(named)))
            continue
        kernel = kernels.motion(wall)

        def motion(dt, kernel=kernel, leave=leave):
            return kernel(*leave, dt, *values)

        breaks = _breaks(kernels, kernel, zeros, period, leave, length, values)
        turns = extrema(motion, length, arrive[1], breaks)
        turns = _without_wrong_way(turns, motion(0.0)[1], sides[wall], arrive[1], sides[following])
        touches = tuple(
            _nearest(k, leave[0], w, positions[w.name] - positions[wall], turns) for w in named
        )
        result.append(FlightGaps(length, touches))
    return result


def _breaks(kernels, kernel, zeros, period, leave, length, values):
    """Zeros of the acceleration inside a flight, as times after leaving."""
    if zeros is None:
        vectorised = kernels.vectorised(kernel)
        return chebyshev_zeros(lambda dt: vectorised(*leave, dt, *values)[2], length)
    phase = leave[0] - math.floor(leave[0] / period) * period
    turns = range(int(length // period) + 2)
    times = (zero + turn * period - phase for turn in turns for zero in zeros)
    return [t for t in times if 0.0 < t < length]


def _without_wrong_way(turns, speed_out: float, left: Wall, speed_in: float, reached: Wall):
    """Leave out the excursions beyond a wall that belong to an impact running the wrong way."""
    if turns and speed_out * left.side > 0.0 and turns[0].maximum == (left.side > 0):
        turns = turns[1:]
    if turns and speed_in * reached.side < 0.0 and turns[-1].maximum == (reached.side > 0):
        turns = turns[:-1]
    return turns


def _nearest(flight: int, start: float, wall: Wall, distance: float, turns) -> Touch | None:
    """The smallest gap to a wall among the turning points towards it."""
    best = None
    for turn in turns:
        if turn.maximum == (wall.side > 0):
            gap = wall.side * (distance - turn.displacement)
            if best is None or gap < best.gap:
                best = Touch(flight, wall.name, start + turn.dt, gap)
    return best


def judge(
    word: str, named: Sequence[Wall], impacts: Array, gaps: Sequence[FlightGaps],
    forgive_touches: Collection[tuple[int, str]] = (), forgive_impact: int | None = None,
) -> Verdict:  # fmt: skip
    """Decide whether an orbit is physical.

    Parameters
    ----------
    word : str
    named : sequence of Wall
    impacts : ndarray of shape (N, m)
    gaps : sequence of FlightGaps
    forgive_touches : collection of (flight, wall)
        Touches that are not held against the orbit: the grazing event itself.
    forgive_impact : int, optional
        An impact whose direction is not held against it: the zero velocity itself.
    """
    n = len(word)
    smallest = math.nan
    reason = None
    sides = {w.name: w.side for w in named}
    for k, flight in enumerate(gaps):
        places = f"flight {k} ({word[k]} to {word[(k + 1) % n]})"
        if flight.duration < 0.0:
            reason = reason or f"impacts out of order: {places} lasts {flight.duration:.6g}"
        for touch in flight.touches:
            if touch is None or (k, touch.wall) in forgive_touches:
                continue
            smallest = touch.gap if math.isnan(smallest) else min(smallest, touch.gap)
            if touch.gap < 0.0 and reason is None:
                reason = (
                    f"{places} passes wall {touch.wall} by {-touch.gap:.6g} at t = {touch.time:.6g}"
                )
    for k, (wall, speed) in enumerate(zip(word, impacts[:, 1].tolist(), strict=True)):
        if speed * sides[wall] < 0.0 and k != forgive_impact:
            reason = f"impact {k} on wall {wall} runs the wrong way: velocity {speed:.6g}"
            break
    return Verdict(reason is None, reason, smallest)
