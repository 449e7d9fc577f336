"""Flights from a state to the first guard they reach: closed form, linear and integrated."""

from __future__ import annotations

import functools
import math
import types
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias, TypeVar

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..models.guards import Guard, pivot
from ..models.model import Model
from ..segments.derivatives import FLOAT_SERIES, Series
from ..segments.flight import (
    breaks_of,
    chebyshev_coefficients,
    chebyshev_nodes,
    first_arrival,
    first_hit,
    rounding_along,
    turns_along,
    zeros_in_turn,
)
from ..segments.integration import StepLimitError, statement
from ..segments.kernel import Family
from ..segments.kernels import Kernels
from ..segments.oscillation import Motion
from ..segments.segment import ARRAYS, Arithmetic, Kernel, evaluate_in
from ..segments.track import IntegratedCurve, IntegratedTrack
from .motions import AT_ONCE, REPEATED, AnyTrack, Contact, ModeMotion
from .run import Body, State

# Flights that are integrated, from one impact to the next: first arrivals on Taylor polynomials.
#
# The flight is integrated in windows, so that little of it lies beyond the wall that ends it: there
# the flow may cease to be finite. On each window the coordinate is a polynomial in pieces, the
# acceleration's zeros on it are isolated, and `segments.flight` misses nothing between them. Where
# the polynomials' bounds keep clear of the walls there is nothing to isolate.

FIRST, LEAST = 2.0**-5, 2.0**-30
"""Duration of the first window, and the shortest, in periods. Others are up to twice as long as the
one before, a period at most; where the flow does not stay finite they are halved."""


class Departure(NamedTuple):
    """What a flight leaves with."""

    field: str
    time: float
    position: float
    velocity: float
    parameters: list[float]


def departure(motion: Kernel, arguments: Sequence[float]) -> Departure:
    """Return what a kernel ``motion`` integrates, for ``(t0, v0, dt, *p)``."""
    found: list[Departure] = []

    def flown(field: str, directions: str, dt: float, *numbers: float) -> list[float]:
        t, x, v, *parameters = numbers
        found.append(Departure(field, t, x, v, parameters))
        return [v, v]

    names = {**motion.__globals__, "flown": flown}
    evaluate_in(motion, Arithmetic(names))(*arguments)
    return found[0]


def fly_integrated(
    motion: Kernel, body: Body, wall: int, phase: float, velocity: float, least: float
) -> tuple[int, float, float]:
    """Return side, time and velocity of the impact that ends a flight; see `fly_in_time`.

    A zero of the acceleration before the time `least` belongs to the release itself. See
    `integrated_arrival`.
    """
    left = departure(motion, (phase, velocity, 0.0, *body.values))
    walls, limits = (body.low[wall], body.high[wall]), (body.clock[0], body.longest[0])
    return integrated_arrival(left, *walls, body.leaving[wall] < 0, *limits, least)


def start_integrated(
    motion: Kernel, body: Body, phase: float, state: tuple[float, float], low: float, high: float
) -> tuple[int, float, float]:
    """As `fly_integrated`, from a position and velocity between walls at these displacements, in
    the mode of a kernel."""
    left = departure(motion, (phase, 0.0, 0.0, *body.values))
    left = left._replace(position=state[0], velocity=state[1])
    rising, period = left.velocity > 0.0, body.clock[0]
    if left.velocity == 0.0:
        numbers = [left.time, left.position, left.velocity, *left.parameters]
        curve = IntegratedTrack(left.field, numbers, LEAST * period).along((1,))
        rising = curve((), 0.0, ())[2] > 0.0
    return integrated_arrival(left, low, high, rising, period, body.longest[0])


def integrated_arrival(
    left: Departure,
    low: float,
    high: float,
    rising: bool,
    period: float,
    longest: float,
    least: float = 0.0,
) -> tuple[int, float, float]:
    """Return side, time and velocity of the arrival at walls at these displacements.

    The side is 0 after the longest flight, or where the motion has settled off the walls; the time
    is not a number where the flow ceases to be finite before any impact. Raises StepLimitError
    where a window as short as the first one takes too many steps.
    """
    speed, passed, moved, widest = left.velocity, 0.0, 0.0, 0.0
    length, window = FIRST * period, period
    while passed < longest * period and length > LEAST * period:
        numbers = [left.time + passed, left.position + moved, left.velocity, *left.parameters]
        try:
            curve = IntegratedTrack(left.field, numbers, length).along((1,), from_start=True)
        except ArithmeticError as error:
            if isinstance(error, StepLimitError) and length <= FIRST * period:
                raise
            length = window = 0.5 * length
            continue
        walls = low - moved, high - moved
        x, speed = curve.at_end()
        if _clear(curve, *walls):
            rising = speed > 0.0
        else:
            breaks = [t for t in curve.breaks() if least < passed + t < passed + length]
            within: Any = ((), (), [*breaks, length], 0.0, rising, *walls)
            side, dt, before, rising = first_hit(curve, *within)
            if side:
                return side, passed + dt, before
        settled = False
        if length == period:
            apart = max(abs(x), abs(speed - left.velocity) * period)
            widest = max(widest, apart)
            settled = _has_settled(curve, walls, apart, widest, left.position + moved)
        left = left._replace(velocity=speed)
        passed, moved = passed + length, moved + x
        if settled:
            break
        length = min(2.0 * length, window)
    return 0, passed if length > LEAST * period else math.nan, speed


SETTLED, UNSETTLED = 1e-11, 1e-8
"""Part of its size by which a settled motion differs from the one a period before, and by which it
differed once: beside an unstable motion, from rounding on, the difference grows."""
ASIDE = 1e3
"""How many such differences a settled motion keeps off the walls, over all periods that follow."""


def _has_settled(
    curve: IntegratedCurve, walls: tuple[float, float], apart: float, widest: float, position: float
) -> bool:
    """Whether a motion has come so near to one that repeats itself that it meets no wall later.

    It moved by `apart` over this period, by `widest` at most over one before.
    """
    least, most = curve.bounds()
    size, off = max(abs(position), most - least), ASIDE * apart
    settled = apart <= SETTLED * size and widest >= UNSETTLED * size
    return settled and walls[0] < least - off and most + off < walls[1]


def _clear(curve: IntegratedCurve, low: float, high: float) -> bool:
    """Whether a coordinate surely keeps clear of both walls."""
    least, most = curve.bounds()
    return low < least and most < high


NUDGE = 1e-9
"""Zeros of a state-dependent acceleration this near a release belong to the release itself."""

NODES = 67
"""Nodes at which a displacement is examined that is not resolved: not those of the acceleration."""
SPREAD = 4.0
"""Variation of a displacement between the nodes, in terms of its higher coefficients."""
FINER = 16
"""Angles at which a displacement is interpolated, for each node."""

T = TypeVar("T")


def of_guards(model: Model, of: Callable[[int], T]) -> tuple[T, ...]:
    """Return what is asked of slow motion at each guard.

    Raises `InputError`, naming the guard, where it has no value.
    """
    values: list[T] = []
    for k, guard in enumerate(model.WALLS):
        try:
            values.append(of(k))
        except InputError:
            raise
        except (ArithmeticError, ValueError) as error:
            accepted = "give laws and a reset that have values at all velocities"
            where = model.place("slow motion at", guard.name)
            found = f"motion at low velocities has no value there ({error})"
            raise InputError(where, found, accepted) from None
    return tuple(values)


def motion_at(motions: Sequence[Kernel], values: Sequence[float]) -> Callable[..., Any]:
    """Return the motion after a wall, at fixed values: ``motion((wall, t0, v0), dt)``."""
    fixed = tuple(
        types.FunctionType(kernel.__code__, kernel.__globals__, kernel.__name__, tuple(values))
        for kernel in motions
    )

    def motion(head: tuple[int, float, float], dt: float, values: Any = None) -> Any:
        return fixed[head[0]](head[1], head[2], dt)

    return motion


def fly_in_time(
    motion: Callable[..., Any], body: Body, wall: int, phase: float, velocity: float
) -> tuple[int, float, float]:
    """Return side, time and velocity of the impact that ends a flight; the side is 0 for none.

    For an acceleration that depends on time alone. Written in the plain subset of Python that
    `contimpact.compiling` compiles.
    """
    head, period, longest = (wall, phase, velocity), body.clock[0], body.longest[0]
    low, high, rising = body.low[wall], body.high[wall], body.leaving[wall] < 0
    side, dt, speed, _ = first_arrival(
        motion, head, body.values, body.zeros, phase, period, longest, 0.0, rising, low, high
    )
    return side, dt, speed


@dataclass(frozen=True)
class FlightInState:
    """As `fly_in_time`, for an acceleration that depends on the state; not compiled."""

    motions: Sequence[Kernel]
    """Motions after each wall."""
    motion: Callable[..., Any]
    """Motion from `motion_at`."""

    def __call__(
        self, body: Body, wall: int, phase: float, velocity: float
    ) -> tuple[int, float, float]:
        if self.motions[wall].family is Family.INTEGRATED:
            least = self._release(body, wall, velocity)
            return fly_integrated(self.motions[wall], body, wall, phase, velocity, least)
        return self.arrive(body, (wall, phase, velocity), body.leaving[wall] < 0)

    def arrive(self, body: Body, head: tuple[Any, ...], rising: bool) -> tuple[int, float, float]:
        """Return the same from a head: the wall left, the phase, and the state there, the velocity
        last."""
        side, left, speed = 0, 0.0, head[-1]
        walls = body.low[head[0]], body.high[head[0]]
        for breaks in (b for k in range(body.longest[0]) for b in self._breaks(body, head, k)):
            side, left, speed, rising = first_hit(
                self.motion, head, body.values, breaks, left, rising, *walls
            )
            if side:
                break
        return side, left, speed

    def _release(self, body: Body, wall: int, velocity: float) -> float:
        """Time before which a zero of the acceleration belongs to the release itself."""
        at_rest = velocity == 0.0 or body.restitution[wall] == 0.0
        return NUDGE * body.clock[0] if at_rest else 0.0

    def _breaks(self, body: Body, head: tuple[Any, ...], window: int) -> Iterator[list[float]]:
        """Yield times after leaving, in a window of a period, between which velocity is monotone.

        They come piece by piece: an arrival spares those after it. A window after the first that
        keeps clear of the walls, and a piece of many oscillations that does, have their ends alone.
        """
        period, values, (wall, *state) = body.clock[0], body.values, head
        start, vectorised = window * period, evaluate_in(self.motions[wall], ARRAYS)

        def motion(dt: Array) -> Any:
            return vectorised(*state, start + dt, *values)

        def clear(begin: float, length: float) -> bool:
            x = motion(begin + chebyshev_nodes(NODES, length))[0]
            return keeps_clear(x, body.low[wall], body.high[wall])

        if window and clear(0.0, period):
            yield [start + period]
            return
        least = self._release(body, wall, head[-1]) if window == 0 else 0.0
        way = self.motions[wall], state, values, start
        rounding, turns = rounding_along(*way), turns_along(*way)
        pieces = zeros_in_turn(
            lambda dt: motion(dt)[2], period, clear, rounding=rounding, turns=turns
        )
        for zeros in pieces:
            inside = [start + t for t in zeros if least < t < period]
            if inside:
                yield inside
        yield [start + period]


def keeps_clear(x: Array, low: float, high: float) -> bool:
    """Whether a displacement stays off both walls, from its values at `chebyshev_nodes`.

    They are interpolated at FINER times as many angles, of which the cosine runs over the interval.
    As a function of the angle a displacement is flat where it is largest, and there it has fallen
    at the nearest one by no more than its second derivative says. Of its higher coefficients more
    is allowed for, oscillations that the nodes do not resolve.
    """
    table, falls = _finer(len(x))
    coefficients = chebyshev_coefficients(x)
    found, rest = table @ coefficients, float(falls @ np.abs(coefficients))
    return bool(low + rest < np.min(found) and np.max(found) < high - rest)


@functools.cache
def _finer(nodes: int) -> tuple[Array, Array]:
    """Chebyshev polynomials at the finer angles, and by how much each may differ between them."""
    orders, count = np.arange(nodes), FINER * nodes
    angles = np.pi / count * np.arange(count + 1)
    falls = np.where(orders < nodes // 4, 0.5 * (0.5 * np.pi / count * orders) ** 2, SPREAD)
    return np.cos(np.outer(angles, orders)), falls


# Flights with any number of coordinates: how each gap coordinate moves, and the state they reach.
#
# A flight is looked at in windows, one after the other. In each every gap coordinate is known as a
# displacement, with the times between which its acceleration has one sign; `segments.flight` then
# finds its first arrival with certainty. Linear and integrated flights are polynomials in pieces
# and start anywhere; others are answered by the model's kernels and start at a guard.

Coordinate: TypeAlias = tuple[Motion, list[float], float]
"""A gap coordinate in a window: its displacement, velocity and acceleration, the times between
which the acceleration has one sign, and where displacements are measured from."""

SHORTEST = 0.125
"""The first window of flights that may be short, in periods."""


def windows(period: float, longest: int, short: bool) -> Iterator[tuple[float, float]]:
    """Yield begin and length of the windows of a flight, a short one first if it may be short."""
    begin = SHORTEST if short else 0.0
    if short:
        yield 0.0, begin * period
    for turn in range(longest):
        yield (begin + turn) * period, period


@dataclass(frozen=True, eq=False)
class TrackWindow:
    """A part of a flight that is known by a track: its first time, since the flight's start, and
    its duration."""

    motion: ModeMotion
    given: Array
    """X at a time of the flight."""
    known: float
    """That time, since the flight's start: the window's beginning, or before."""
    phase: float
    """Of the flight's start."""
    begin: float
    length: float

    @functools.cached_property
    def state(self) -> Array:
        """X at the window's beginning."""
        if self.begin == self.known:
            return self.given
        return replace(self, begin=self.known, length=self.begin - self.known).end

    @functools.cached_property
    def track(self) -> AnyTrack:
        return self.motion.track(self.state, self.length)

    @property
    def end(self) -> Array:
        """X at the window's end."""
        motion, time = self.motion, self.phase + self.begin + self.length
        x, v = motion.moving(self.track.at(self.length))
        return motion.resting(motion.embedded(x, v, time))

    @property
    def moving(self) -> Array:
        """Positions and velocities at the window's beginning, shape (2, d)."""
        return self.motion.moving(self.state)

    @property
    def speed(self) -> float:
        """The largest velocity at the window's beginning."""
        return float(np.max(np.abs(self.moving[1])))

    def at(self, dt: float) -> Array:
        """Return positions and velocities some time after."""
        return self.motion.moving(self.motion.resting(self.track.at(dt)))

    def coordinate(self, guard: Guard) -> Coordinate:
        """Return how a guard's gap coordinate moves; times count from the window's beginning."""
        row = guard.row(self.motion.freedom)
        curve = self.track.along(row, from_start=True)
        return curve, curve.breaks(), float(self.moving[0] @ row)

    def beginning(self, guard: Guard) -> tuple[float, float]:
        """Return a guard's gap coordinate and its velocity at the window's beginning."""
        x, v = self.moving
        row = guard.row(len(x))
        return float(x @ row), float(v @ row)

    def rounding(self, guard: Guard) -> float:
        """Return the rounding error of a gap coordinate's velocity at the window's beginning."""
        return REPEATED * float(np.abs(guard.row(self.moving.shape[1])) @ np.abs(self.moving[1]))

    def bounds(self, guard: Guard) -> tuple[float, float]:
        """Return bounds of a guard's gap coordinate in the window."""
        return self.track.bounds(guard.row(self.motion.freedom))

    def section(self, guard: Guard, dt: float, speed: float) -> tuple[float, ...]:
        """Return the section coordinates at a guard, from the gap coordinate's velocity there."""
        x, v = self.at(dt).tolist()
        others = [i for i in range(len(x)) if i != pivot(guard.row(len(x)))]
        return (speed, *(part[i] for i in others for part in (x, v)))

    def rests(self, guard: Guard, position: float, period: float) -> bool:
        """Whether a gap coordinate is at a position, at rest and without a force, to rounding."""
        row, (x, v) = np.array(guard.row(self.motion.freedom), dtype=float), self.moving
        value, size = self.motion.force(row, self.state, self.track)
        force = AT_ONCE * size
        return bool(
            abs(row @ x - position) <= AT_ONCE * float(np.abs(row) @ np.abs(x)) + force * period**2
            and abs(row @ v) <= force * period
            and abs(value) <= force
        )

    def release(self) -> tuple[float, Contact] | None:
        """Return when a contact is released in it, and which."""
        return self.motion.release(self.track)


def track_windows(
    motion: ModeMotion, state: Array, phase: float, lengths: Iterable[tuple[float, float]]
) -> Iterator[TrackWindow]:
    """Yield the windows of a flight from a state X at a phase, by their begins and lengths, until
    one is the one before it again, to rounding: what meets no guard in it meets none in any that
    follows."""
    window = None
    for begin, length in lengths:
        before, state = window, state if window is None else window.end
        window = TrackWindow(motion, state, begin, phase, begin, length)
        if before is not None and length == before.length:
            apart = np.max(np.abs(window.moving - before.moving))
            if apart <= REPEATED * np.max(np.abs(state)):
                return
        yield window


@dataclass(frozen=True, eq=False)
class KernelWindow:
    """The same of a flight that the model's kernels know."""

    kernels: Kernels
    values: Sequence[float]
    guard: Guard
    """Guard that is left."""
    position: float
    """Position of its surface."""
    start: State
    """Before that."""
    begin: float
    length: float

    def coordinate(self, guard: Guard) -> Coordinate:
        own, kernel = self._kernel(guard)
        head, values, begin = (self.start.phase, *self.start.section), self.values, self.begin

        def motion(_: Any, dt: float, __: Any) -> Any:
            return kernel(*head, begin + dt, *values)

        breaks = breaks_of(kernel, head, values, self.length, begin)
        return motion, breaks, self.position if own else 0.0

    def _kernel(self, guard: Guard) -> tuple[bool, Kernel]:
        """Whether a guard is on the gap coordinate that is left, and the kernel of its own."""
        size, left = self.kernels.model.DEGREES_OF_FREEDOM, self.guard.name
        own = guard.row(size) == self.guard.row(size)
        return own, self.kernels.motion(left) if own else self.kernels.gap(left, guard.name)

    def beginning(self, guard: Guard) -> tuple[float, float]:
        own, kernel = self._kernel(guard)
        x, v, _ = kernel(self.start.phase, *self.start.section, self.begin, *self.values)
        return (self.position if own else 0.0) + float(x), float(v)

    def rounding(self, guard: Guard) -> float:
        """None is known."""
        return 0.0

    def bounds(self, guard: Guard) -> tuple[float, float]:
        """None are known."""
        return -math.inf, math.inf

    def section(self, guard: Guard, dt: float, speed: float) -> tuple[float, ...]:
        """By the segment's residual: what arrives, less what is said to."""
        start = (self.start.phase, *self.start.section)
        end = (self.start.phase + self.begin + dt, *(0.0 for _ in self.start.section))
        segment = self.kernels.segment(self.guard.name, guard.name)
        return (speed, *segment.blocks(start, end, self.values)[0][2:])

    def release(self) -> None:
        """Nothing is held here."""


Window: TypeAlias = TrackWindow | KernelWindow


def departure_of(
    kernels: Kernels, guard: str, arithmetic: Arithmetic
) -> Callable[..., tuple[Sequence[Any], Sequence[Any]]]:
    """Return a function of a time, section coordinates and parameters: positions and velocities
    with which flights leave a guard, linear or integrated ones, in an arithmetic; of the
    coordinates that the mode has."""
    integrated = kernels.integrated(guard)
    kernel = evaluate_in((kernels.field if integrated else kernels.law)(guard), arithmetic)

    def depart(*given: Any) -> tuple[Sequence[Any], Sequence[Any]]:
        if integrated:
            field, numbers = kernel(*given)
            size, state = statement(field).freedom, numbers[1:]
        else:
            size, state = kernels.model.DEGREES_OF_FREEDOM, kernel(*given)[3]
        return state[:size], state[size : 2 * size]

    return depart


def jump_derivative(kernels: Kernels, guard: str, state: State, values: Sequence[float]) -> Array:
    """Return how positions and velocities after an impact on a guard depend on the time and the
    section coordinates before it, shape (2 d, 2 d)."""
    depart, d = departure_of(kernels, guard, FLOAT_SERIES), kernels.model.DEGREES_OF_FREEDOM
    at = (state.phase, *state.section)
    given = [Series([y, unit]) for y, unit in zip(at, np.eye(2 * d), strict=True)]
    found = np.zeros((2 * d, 2 * d))
    for begin, part in zip((0, d), depart(*given, *values), strict=True):
        for i, e in enumerate(part):
            found[begin + i] = e.coefficients[1] if isinstance(e, Series) else 0.0
    return found
