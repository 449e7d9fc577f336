"""The gap along a flight: zeros, excursions beyond the walls, the first arrival; compiled, too."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ..arrays import Array, Vector
from ..models.guards import Guard
from .compiling import load, mode, timed_plainly
from .kernels import Kernels
from .oscillation import (
    MOST,
    ROW,
    excursion_by_law,
    excursion_on_steps,
    follow,
    row_of,
    row_of_compiled,
)
from .oscillation import Ends as Ends
from .oscillation import Excursion as Excursion
from .oscillation import Motion as Motion
from .oscillation import Moved as Moved
from .oscillation import excursions as excursions
from .oscillation import turn_guess as turn_guess
from .oscillation import velocity_zero as velocity_zero
from .segment import ARRAYS, Kernel, evaluate_in
from .track import integrated_track, track_between, track_of

if TYPE_CHECKING:
    from .machine_code import Program

# Zeros of the acceleration in flight, between which the velocity is monotone.
#
# They follow from its harmonics where it depends on time alone, and otherwise from a Chebyshev
# interpolant resolved to rounding.

Rounding: TypeAlias = Callable[[float], float]
"""Returns a bound of a function's rounding error at a time."""

Turns: TypeAlias = Callable[[Array], list[float]]
"""Returns those of some times between which the velocity is seen to change its sign."""

_DEGREES = (16, 32, 64)

CUTS, FASTEST = 12, 30
"""Depth to which a piece that is not resolved is halved: at first, and where something in it
oscillates."""

_NOISE = 1e-5
"""Last coefficients below this part of the largest that no longer fall are the rounding of the
function itself, which grows with the angles in it."""

_EVERY = 3
"""Cuts after which a piece that is not resolved is compared with the function's rounding."""

_SMALLEST = 2.0**-1000
"""Sums of smaller terms are rounded to a multiple of the least number there is."""

_LAYER = 1e-12
"""Part of the largest coefficient by which the interpolant may miss the function at an end. No node
lies in the boundary layer of a strongly damped flight, whose rest looks smooth."""

_MISSED = 1e-6
"""Part of it by which an interpolant that is smooth misses an end behind such a layer, which is too
thin for higher degrees as well."""

_ALONE = 1.01
"""A mean that is larger than all oscillation about it, by so much, leaves no room for a zero, nor
for the pair beside the real axis that a touch may have become by rounding."""


def time_zeros(harmonics: Sequence[float], period: float) -> list[float] | None:
    """Return where in [0, period) the acceleration changes sign, or None if it depends on more,
    from what the kernel ``harmonics`` returns: mean, then k, a_k, b_k for each harmonic."""
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


def single_zeros(mean: float, a: float, b: float, period: float, zeros: Vector) -> int:
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
    roots = roots[roots != 0.0]
    near_circle = np.angle(roots[np.abs(np.log(np.abs(roots))) < 0.3])
    return [_polish_root(angle, mean, series) for angle in near_circle.tolist()]


def _polish_root(angle: float, mean: float, series: Sequence[tuple[int, float, float]]) -> float:
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
    function: Callable[[Array], Array],
    length: float,
    cuts: int = CUTS,
    rounding: Rounding | None = None,
    turns: Turns | None = None,
) -> list[float]:
    """Return the zeros in (0, length) of a smooth function, from its Chebyshev interpolant.

    The degree is doubled until the last coefficients are rounding, the function's own where that is
    larger; a function that is not resolved by the highest degree is cut in halves. A zero at a cut
    may be returned twice, but is not lost. A piece that is still not resolved after all cuts is
    rounding alone: its sign changes on a mesh are returned. Where `rounding` is given, a bound of
    the function's rounding error at a time, a piece with no larger values has no zeros but those
    that `turns` tells: however small, an acceleration turns a motion in a long time.
    """
    pieces = zeros_in_turn(function, length, cuts=cuts, fastest=0, rounding=rounding, turns=turns)
    return [zero for piece in pieces for zero in piece]


def zeros_in_turn(
    function: Callable[[Array], Array],
    length: float,
    passed: Callable[[float, float], bool] = lambda begin, length: False,
    begin: float = 0.0,
    cuts: int = CUTS,
    fastest: int = FASTEST,
    rounding: Rounding | None = None,
    turns: Turns | None = None,
) -> Iterator[list[float]]:
    """Yield the same piece by piece, in order, each found when it is asked for.

    ``passed(begin, length)`` says whether zeros in a piece that would have to be cut do not matter,
    counted from `begin` as the function's zero; its ends are returned in their place. A piece that
    is not resolved after `cuts` is cut on as long as one of its halves is, or some part of it that
    takes `fastest` more, at most: in it something decays or oscillates fast. For `rounding` and
    `turns` see `chebyshev_zeros`.
    """
    found = _zeros_of_interpolant(function, length)
    if found is None and passed(begin, length):
        found = [0.0, length]
    if found is None and rounding and cuts % _EVERY == 0 and _vanishes(function, length, rounding):
        found = turns(chebyshev_nodes(_DEGREES[0] + 1, length)) if turns else []
    if found is None and cuts <= 0 and _is_rounding(function, length, cuts + fastest):
        found = _mesh_zeros(function, length)
    if found is not None:
        yield found
        return
    half = 0.5 * length
    limits = cuts - 1, fastest
    yield from zeros_in_turn(function, half, passed, begin, *limits, rounding, turns)
    late = rounding and (lambda t: rounding(half + t))
    turned = turns and (lambda times: [t - half for t in turns(half + times)])
    later = passed, begin + half, *limits, late, turned
    for piece in zeros_in_turn(lambda t: function(half + t), half, *later):
        yield [half + zero for zero in piece]


def breaks_of(
    kernel: Kernel,
    head: Sequence[float],
    values: Sequence[float],
    length: float,
    begin: float = 0.0,
) -> list[float]:
    """Return the zeros of an acceleration, a kernel's third result, in a window of a flight."""
    vectorised = evaluate_in(kernel, ARRAYS)
    return chebyshev_zeros(
        lambda dt: vectorised(*head, begin + dt, *values)[2],
        length,
        rounding=rounding_along(kernel, head, values, begin),
        turns=turns_along(kernel, head, values, begin),
    )


def rounding_along(
    kernel: Kernel, head: Sequence[float], values: Sequence[float], begin: float = 0.0
) -> Rounding:
    """Return what bounds the rounding of an acceleration, a kernel's third result."""

    def rounding(dt: float) -> float:
        from .bounded import bounds_of_kernel

        return float(bounds_of_kernel(kernel, [*head, begin + dt, *values])[1][2])

    return rounding


def turns_along(
    kernel: Kernel,
    head: Sequence[float],
    values: Sequence[float],
    begin: float = 0.0,
    direction: float = 1.0,
) -> Turns:
    """Return what tells between which times a velocity, a kernel's second result, changes its sign:
    the first at which it is not rounding, and those behind each change."""

    def turns(times: Array) -> list[float]:
        from .bounded import bounds_of_kernel

        moving = []
        for dt in sorted(times.tolist()):
            found, bounds = bounds_of_kernel(kernel, [*head, begin + direction * dt, *values])
            if abs(found[1]) > bounds[1]:
                moving.append((dt, found[1] > 0.0))
        changed = [later for one, later in pairwise(moving) if one[1] != later[1]]
        return [t for t, _ in moving[:1] + changed]

    return turns


def _vanishes(function: Callable[[Array], Array], length: float, rounding: Rounding) -> bool:
    """Whether no value is larger than its rounding; the largest one tells most often."""
    times = chebyshev_nodes(_DEGREES[0] + 1, length)
    sizes = np.abs(np.broadcast_to(function(times), times.shape))
    order = np.argsort(-sizes, kind="stable")
    bounds = map(rounding, times[order].tolist())
    pairs = zip(sizes[order].tolist(), bounds, strict=True)
    return all(size <= bound + _SMALLEST < math.inf for size, bound in pairs)


def _is_rounding(function: Callable[[Array], Array], length: float, cuts: int) -> bool:
    """Whether neither half is resolved, nor the short parts that so many cuts make.

    Of a boundary layer one half is.
    """
    half = 0.5 * length
    parts = (0.5**k for k in (1, *range(2, cuts, 3)))
    return _zeros_of_interpolant(lambda t: function(half + t), half) is None and all(
        _zeros_of_interpolant(function, part * length) is None for part in parts
    )


def _zeros_of_interpolant(function: Callable[[Array], Array], length: float) -> list[float] | None:
    """The zeros of the interpolant of the lowest degree that resolves the function, if one does."""
    from numpy.polynomial import chebyshev

    before = math.inf
    for degree in _DEGREES:
        nodes = chebyshev_nodes(degree + 1, length)
        nodes = np.append(nodes, (0.0, length))
        *values, first, last = np.broadcast_to(function(nodes), nodes.shape)
        coefficients = chebyshev_coefficients(np.array(values))
        size = float(np.max(np.abs(coefficients)))
        # the interpolant where Chebyshev polynomials are 1 and -1 in turn
        begin = float(np.sum(coefficients[::2]) - np.sum(coefficients[1::2]))
        off = max(abs(begin - first), abs(np.sum(coefficients) - last))
        if size == off == 0.0:
            return []
        tail = float(np.max(np.abs(coefficients[-3:]))) / size if size else math.inf
        resolved = tail < 1e-14 or (tail < _NOISE and tail > 0.1 * before)
        if resolved and off <= max(_LAYER, len(values) * tail) * size:
            if abs(coefficients[0]) > _ALONE * np.sum(np.abs(coefficients[1:])):
                return []
            kept = np.nonzero(np.abs(coefficients) > 1e-15 * size)[0][-1] + 1
            roots = chebyshev.chebroots(coefficients[:kept]) if kept > 1 else np.array([])
            near = (np.abs(roots.imag) < 1e-6) & (np.abs(roots.real) <= 1.0 + 1e-9)
            return sorted((0.5 * length * (np.clip(roots.real[near], -1.0, 1.0) + 1.0)).tolist())
        if resolved and off > _MISSED * size:
            return None
        before = tail
    return None


def _mesh_zeros(function: Callable[[Array], Array], length: float) -> list[float]:
    times = np.linspace(0.0, length, 257)
    signs = np.broadcast_to(function(times), times.shape) >= 0.0
    changes = np.nonzero(signs[1:] != signs[:-1])[0]
    return (0.5 * (times[changes] + times[changes + 1])).tolist()


def chebyshev_nodes(count: int, length: float) -> Array:
    """Return the roots of a Chebyshev polynomial on (0, length), from the last to the first."""
    nodes = np.cos(np.pi * (np.arange(count) + 0.5) / count)
    return 0.5 * length * (nodes + 1.0)


def chebyshev_coefficients(values: Array) -> Array:
    """Return the coefficients of the interpolant through values at `chebyshev_nodes`."""
    coefficients = _transform(len(values)) @ values
    coefficients[0] *= 0.5
    return coefficients


@cache
def _transform(n: int) -> Array:
    angles = np.pi * (np.arange(n) + 0.5) / n
    return np.asarray(2.0 / n * np.cos(np.outer(np.arange(n), angles)))


@dataclass(frozen=True)
class Touch:
    """A local minimum of the gap to a wall inside a flight."""

    flight: int
    wall: str
    time: float
    gap: float


@dataclass(frozen=True)
class FlightGaps:
    """The nearest touches of one flight, by wall, and whether the flight runs forward in time.

    `slowest` is the velocity nearest to zero where the acceleration vanishes; see `excursions`.
    `has_reached` are the walls behind which the flight begins or ends, as touches there.
    """

    duration: float
    touches: tuple[Touch | None, ...]
    slowest: float = math.nan
    beyond: tuple[Touch, ...] = ()


def flight_gaps(
    kernels: Kernels,
    walls: str,
    values: Sequence[float],
    impacts: Array,
    span: float,
    only: int | None = None,
) -> list[FlightGaps]:
    """Return the nearest interior touch of each wall on each flight of an orbit of a word, from
    parameter values in the model's order, the impacts' times and section coordinates, of shape (N,
    m), and the orbit's period `span`; on one flight alone if it is named.

    A flight that leaves its wall outwards, or reaches the next from outside, does so because an
    impact runs the wrong way; that excursion belongs to the impact and is not a touch.
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
    for k in range(len(walls)) if only is None else (only,):
        wall, leave, arrive = walls[k], rows[k], rows[k + 1]
        i, j = places[wall], places[walls[(k + 1) % len(walls)]]
        length = arrive[0] - leave[0]
        if not length > 0.0:
            result.append(FlightGaps(length, (None,) * len(named)))
            continue
        head, phase = (i, *leave), leave[0] % period
        ends = length, arrive[1], passages.leaving[i], named[j].side
        if kernels.integrated(wall):
            track = track_between(kernels, (wall, named[j].name), leave, arrive, values, length)
            curve = track.along(named[i].row(1), from_start=True)
            found = excursions(curve, (), (), ends, curve.breaks(), 0.0, math.inf)
        else:
            found = excursion(head, values, ends, zeros, phase, period)
        touches = tuple(
            touch_of(k, leave[0], w, setup.walls[place] - setup.walls[i], found) if meets else None
            for place, (w, meets) in enumerate(zip(named, passages.watched[i], strict=True))
        )
        result.append(FlightGaps(length, touches, found[4]))
    return result


def excursion_of(kernels: Kernels, in_time: bool) -> Callable[..., Any]:
    """Return `excursions` for the flights of a model, without its first argument.

    Where the acceleration depends on the state (not `in_time`), its zeros are found for each
    flight, and those given are not used. A last argument is scratch space of compiled code.
    """
    motion, named = kernels.motions, kernels.model.WALLS
    if in_time:
        return lambda head, p, ends, zeros, phase, period, _=None: excursions(
            motion, head, p, ends, zeros, phase, period
        )

    def excursion(head: Vector, values: Vector, ends: Ends, *_: Any) -> Excursion:
        wall, length = named[head[0]], ends[0]
        if kernels.oscillates:
            found = excursion_alone(kernels.law(wall.name)(*head[1:], *values), ends)
            if found[4] != math.inf:
                return found
        if kernels.linear(wall.name):
            track: Any = track_of(kernels.law(wall.name)(*head[1:], *values), length)
        elif kernels.integrated(wall.name):
            track = integrated_track(kernels, wall.name, head[1:], values, length)
        else:
            breaks = breaks_of(kernels.motion(wall.name), head[1:], values, length)
            return excursions(motion, head, values, ends, breaks, 0.0, math.inf)
        curve = track.along(wall.row(kernels.model.DEGREES_OF_FREEDOM), from_start=True)
        return excursions(curve, (), (), ends, curve.breaks(), 0.0, math.inf)

    return excursion


def touch_of(flight: int, start: float, wall: Guard, distance: float, found: Any) -> Touch | None:
    """Return the smallest gap to a wall, at a distance from where displacements are measured, among
    the turning points towards it: what `excursions` found, in times counted from `start`."""
    gap, dt = smallest_gap(wall, distance, found)
    return None if math.isnan(gap) else Touch(flight, wall.name, start + dt, gap)


def smallest_gap(wall: Guard, distance: float, found: Any) -> tuple[float, float]:
    """Return the same gap, and its time; not numbers where there is none."""
    high, when_high, low, when_low = found[:4]
    return (distance - high, when_high) if wall.side > 0 else (low - distance, when_low)


# Where a flight first hits a wall, with certainty.
#
# The functions are in the plain subset of Python that `contimpact.compiling` compiles.

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
    """Return time and velocity at which a monotone displacement reaches a wall, rising or falling,
    between two times and what the motion is there (displacement, velocity, acceleration). The
    velocity does not run away from the wall, not even by rounding.

    Newton's iteration kept inside a bracket, from the end with the larger speed: between two zeros
    of the acceleration the displacement is convex or concave, and from that end the iteration is
    monotone.
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
    """Return the first arrival at a wall; as `first_arrival`, between times that are given: zeros
    of the acceleration after `left`, in order. Further times among them do no harm."""
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

    `motion`, `head` and `values` are as in `velocity_zero`; displacements, those of the walls
    (`low`, `high`; infinite where there is none) too, are measured from where the flight starts, at
    `phase`. `zeros` are those of the acceleration in [0, period), in order; further times among
    them do no harm. The search begins after the time `left` with the direction of motion `rising`,
    which decides where the velocity is zero, and is given up after `most` periods.

    Returns the side (+1 at the wall above, -1 at the one below, 0 for no hit), time and velocity
    before the impact (without a hit, at the last zero), and the direction of motion then.
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
            if turned or has_reached(reached[0], ahead, rising):
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
            if has_reached(x, wall, rising):
                there = motion(head, turn, values)
                dt, speed = wall_arrival(motion, head, values, left, at, turn, there, wall, rising)
                return (1 if rising else -1), dt, speed
            left = turn
        at, rising = (at[0], 0.0, at[2]), not rising  # sought from the other end, then
    wall = high if rising else low
    if not has_reached(reached[0], wall, rising):
        return 0, right, reached[1]
    dt, speed = wall_arrival(motion, head, values, left, at, right, reached, wall, rising)
    return (1 if rising else -1), dt, speed


def has_reached(x: float, wall: float, rising: bool) -> bool:
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
    return not has_reached(at[0] + at[1] * dt + (margin if rising else -margin), wall, rising)


# Where flights of one coordinate turn, as code of compiled programs.

ALONE = """
def entry(waves, numbers, state, given, steps, zeros, out):
    made, count = follow(waves[0], numbers, state, given[0], steps, zeros)
    ends = (given[0], given[1], given[2], given[3])
    out[0], out[1], out[2], out[3], out[4] = excursion_on_steps(
        made, count, state, ends, steps, zeros
    )
    return 0
"""


def excursion_alone(found: Sequence[Any], ends: Ends) -> Excursion:
    """As `excursion_by_law`, of one flight and what its law has returned, by a compiled program if
    that is there or pays; it is that of every model."""
    _, waves, numbers, state = found
    run = load(EXCURSION, "ifffFff", _program_alone) if mode() != "never" else None
    if run is None:
        steps: list[list[float]] = []
        zeros = [0.0] * (2 * MOST)
        with timed_plainly(EXCURSION):
            made, count = follow(int(waves), numbers, state, ends[0], steps, zeros)
            return excursion_on_steps(made, count, state, ends, steps, zeros)
    given = np.array([int(waves)]), *(np.array(row, dtype=float) for row in (numbers, state, ends))
    out = np.empty(5)
    run(*given, *_scratch(), out)
    high, when_high, low, when_low, slowest = out.tolist()
    return high, when_high, low, when_low, slowest


EXCURSION = ("excursion",)
"""Identity of the program of one flight's extrema."""


@cache
def _scratch() -> tuple[Array, Array]:
    return np.empty((MOST, ROW)), np.empty(2 * MOST)


def _program_alone() -> Program:
    from .machine_code import Program

    program = Program({row_of: row_of_compiled})
    program.glue(ALONE, follow=follow, excursion_on_steps=excursion_on_steps)
    return program


def variant_of(kernels: Kernels, values: Sequence[float]) -> str | None:
    """Return how compiled code finds the zeros of the acceleration; None where it cannot.

    They are "fixed" along the branch, or those of a "single" harmonic that changes along it, or are
    found on each flight by its "law".
    """
    harmonics = kernels.harmonics(*values)
    if math.isnan(harmonics[0]):
        return "law" if kernels.oscillates else None
    if not kernels.depends("harmonics"):
        return "fixed"
    return "single" if len(harmonics) == 4 and harmonics[1] == 1 else None


MOTION = """
def excursion(head, values, ends, zeros, phase, period, steps):
    return excursions(any_motion, head, values, ends, zeros, phase, period)
"""

LAW = """
def excursion(head, values, ends, zeros, phase, period, steps):
    return excursion_by_law(any_law, head, values, ends, steps, zeros)
"""

PATH = """
def excursion(head, values, ends, zeros, phase, period, steps):
    return excursion_by_path(any_path, head, values, ends, steps, zeros, values[{count}:])
"""

GIVEN = """
def breaks(values, period, zeros):
    return zeros
"""

SINGLE = """
def breaks(p, period, zeros):
    mean, order, a, b = kernel_harmonics({p})
    return zeros[:single_zeros(mean, a, b, period, zeros)]
"""


def add_excursions(program: Program, kernels: Kernels, variant: str, p: str) -> None:
    """Add the functions ``excursion`` and ``breaks``, given the text of the parameter values."""
    walls = kernels.model.letters
    if variant == "law":
        laws = {f"law_{a}": kernels.law(a) for a in walls}
        given = f"head[1], head[2], {p}"
        program.choose("any_law", "head, p", "head[0]", laws, given)
        program.glue(LAW, excursion_by_law=excursion_by_law)
    elif variant == "path":
        from .taylor import excursion_by_path, path_kernel

        paths = {f"path_{a}": path_kernel(kernels.field(a)).function for a in walls}
        given = f"head[1], head[2], {p}, length, space, (1.0,), 1, way"
        program.choose("any_path", "head, p, length, space, way", "head[0]", paths, given)
        count = len(kernels.model.values)
        program.glue(PATH.format(count=count), excursion_by_path=excursion_by_path)
    else:
        motions = {f"motion_{a}": kernels.motion(a) for a in walls}
        given = f"head[1], head[2], dt, {p}"
        program.choose("any_motion", "head, dt, p", "head[0]", motions, given)
        program.glue(MOTION, excursions=excursions)
    if variant == "single":
        single = SINGLE.format(p=p)
        program.glue(single, kernel_harmonics=kernels.harmonics, single_zeros=single_zeros)
    else:
        program.glue(GIVEN)
