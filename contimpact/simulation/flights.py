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
from ..segments.linear_flow import Shape, flow
from ..segments.oscillation import Motion
from ..segments.segment import ARRAYS, Arithmetic, Kernel, evaluate_in
from ..segments.track import IntegratedCurve, IntegratedTrack, Pieces, Track
from .run import Body, State

# Linear motion of a mode, with guards against which the machine rests.
#
# A guard that is held keeps its gap coordinate :math:`n \cdot x` where it is. Its reaction acts
# along the direction in which an impact there changes the velocities,
#
# .. math:: w = \frac{v - v^+}{n \cdot (v - v^+)}, \qquad n \cdot w = 1,
#
# so that no more than the impact's law has to be known of it. With the held rows n as the rows of N
# and the directions w as the columns of W, the accelerations a of free motion become
#
# .. math:: a - W\lambda, \qquad \lambda = (NW)^{-1} N a .
#
# The constrained mode is thus a linear law again. A contact pushes as long as its :math:`\lambda`
# has the sign of the guard's side, and is released where that changes (B. Brogliato, Nonsmooth
# Mechanics, 2016, ch. 5).

AT_ONCE = 1e-12
"""A contact that pulls by this part of the sizes of its terms pulls by rounding."""


@dataclass(frozen=True, eq=False)
class Contact:
    """A guard against which a machine can rest."""

    number: int
    """Number of the guard."""
    side: int
    position: float
    row: Array
    """Row n of the gap coordinate, shape (d,)."""
    direction: Array
    """Direction w in which an impact changes the velocities, shape (d,)."""


class LinearMotion:
    """The motion of a mode by a linear law (see `linear_flow.flow`), some contacts held."""

    def __init__(
        self, shape: Shape, numbers: Sequence[float], contacts: Sequence[Contact] = ()
    ) -> None:
        self.shape, self.contacts = shape, tuple(contacts)
        d, size = shape.freedom, shape.freedom * shape.size
        free = np.array(numbers[:size], dtype=float).reshape(d, -1)
        self.frequencies = tuple(numbers[size : size + shape.waves])
        self.rows = np.array([c.row for c in contacts]).reshape(-1, d)
        self.directions = np.array([c.direction for c in contacts]).reshape(-1, d).T
        self.reactions = np.linalg.pinv(self.rows @ self.directions) @ self.rows @ free
        self.accelerations = free - self.directions @ self.reactions
        self.numbers = [*self.accelerations.ravel().tolist(), *self.frequencies]
        self._pieces: dict[float, Pieces] = {}

    def track(self, state: Array, length: float) -> Track:
        """Return the track of a flight from a state X."""
        if length not in self._pieces:
            self._pieces[length] = Pieces(self.shape, self.numbers, length)
        return Track(self._pieces[length], state)

    def embedded(
        self, x: Sequence[float] | Array, v: Sequence[float] | Array, phase: float
    ) -> Array:
        """Return X from positions and velocities at a phase."""
        angles = np.array(self.frequencies) * phase
        waves = np.stack([np.cos(angles), np.sin(angles)], axis=-1).ravel()
        return np.concatenate([x, v, waves, [1.0]])

    def resting(self, state: Array) -> Array:
        """Return X with the held coordinates where their guards are, and at rest; velocities that
        cancel to rounding are none."""
        d = self.shape.freedom
        found = state.copy()
        if self.contacts:
            inverse = np.linalg.pinv(self.rows @ self.directions)
            places = np.array([c.position for c in self.contacts])
            found[:d] -= self.directions @ (inverse @ (self.rows @ found[:d] - places))
            v = found[d : 2 * d]
            impulses = inverse @ (self.rows @ v)
            rounding = REPEATED * (np.abs(v) + np.abs(self.directions) @ np.abs(impulses))
            v -= self.directions @ impulses
            v[np.abs(v) <= rounding] = 0.0
        return found

    def moving(self, state: Array) -> Array:
        """Return positions and velocities of X, shape (2, d)."""
        return state[: 2 * self.shape.freedom].reshape(2, -1)

    def rate(self, state: Array) -> Array:
        """Return how positions and velocities change, shape (2 d,)."""
        d = self.shape.freedom
        return np.concatenate([state[d : 2 * d], self.accelerations @ state])

    def flowed(self, duration: float) -> Array:
        """Return the derivative of the state after a duration by the state, shape (2 d, 2 d)."""
        d, h, _ = self.shape
        tables = np.array(flow(d, h, 0, duration, *self.numbers)).reshape(4, d, -1)
        mean, end = duration * tables[0, :, : 2 * d], tables[1, :, : 2 * d]
        return np.concatenate([np.eye(d, 2 * d) + mean, end])

    def release(self, track: Track, state: Array) -> tuple[float, Contact] | None:
        """Return when, on a track that starts at a state, a contact ceases to push, and which.

        None if all of them push to the end of the track.
        """
        found = [
            (when, contact)
            for contact, weights in zip(self.contacts, self.reactions, strict=True)
            if (when := _first_negative(track, contact.side * weights, state)) is not None
        ]
        return min(found, key=lambda pair: pair[0], default=None)


def _first_negative(track: Track, weights: Array, state: Array) -> float | None:
    """When a linear combination of X becomes negative; 0 if it is so from the start."""

    def negative(at: Array) -> bool:
        return bool(weights @ at < -AT_ONCE * (np.abs(weights) @ np.abs(at)))

    times = track.changes(weights)
    ends = [*times, track.pieces.length]
    if negative(state) or negative(track.at(0.5 * ends[0])):
        return 0.0
    after = (
        weights @ track.at(0.5 * (t + end)) < 0.0 for t, end in zip(times, ends[1:], strict=True)
    )
    return next((t for t, below in zip(times, after, strict=True) if below), None)


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

REPEATED = 4e-16
"""States that differ by less, by their size, are one to rounding."""
SHORTEST = 0.125
"""The first window of flights that may be short, in periods."""


def windows(period: float, longest: int, short: bool) -> Iterator[tuple[float, float]]:
    """Yield begin and length of the windows of a flight, a short one first if it may be short."""
    begin = SHORTEST if short else 0.0
    if short:
        yield 0.0, begin * period
    for turn in range(longest):
        yield (begin + turn) * period, period


class TrackWindow:
    """A part of a flight that is known by a track."""

    track: Any
    moving: Any
    """Positions and velocities at the window's beginning, shape (2, d)."""
    at: Any
    """Returns the same some time after."""

    def coordinate(self, guard: Guard) -> Coordinate:
        """Return how a guard's gap coordinate moves; times count from the window's beginning."""
        row = guard.row(self.moving.shape[1])
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

    def section(self, guard: Guard, dt: float, speed: float) -> tuple[float, ...]:
        """Return the section coordinates at a guard, from the gap coordinate's velocity there."""
        x, v = self.at(dt).tolist()
        others = [i for i in range(len(x)) if i != pivot(guard.row(len(x)))]
        return (speed, *(part[i] for i in others for part in (x, v)))


@dataclass(frozen=True, eq=False)
class LinearWindow(TrackWindow):
    """A part of a linear flight: its first time, since the flight's start, and its duration."""

    motion: LinearMotion
    track: Track
    state: Array
    """X at the window's beginning."""
    begin: float
    length: float

    @property
    def moving(self) -> Array:
        return self.motion.moving(self.state)

    def at(self, dt: float) -> Array:
        return self.motion.moving(self.motion.resting(self.track.at(dt)))

    @property
    def speed(self) -> float:
        """The largest velocity at the window's beginning."""
        return float(np.max(np.abs(self.moving[1])))

    def bounds(self, guard: Guard) -> tuple[float, float]:
        """Return bounds of a guard's gap coordinate in the window."""
        return self.track.bounds(guard.row(self.motion.shape.freedom))

    def rests(self, guard: Guard, position: float, period: float) -> bool:
        """Whether a gap coordinate is at a position, at rest and without a force, to rounding."""
        row, (x, v) = np.array(guard.row(self.motion.shape.freedom)), self.moving
        weights = row @ self.motion.accelerations
        force = AT_ONCE * float(
            np.abs(row) @ np.abs(self.motion.accelerations) @ np.abs(self.state)
        )
        return bool(
            abs(row @ x - position) <= AT_ONCE * float(np.abs(row) @ np.abs(x)) + force * period**2
            and abs(row @ v) <= force * period
            and abs(weights @ self.state) <= force
        )

    def release(self) -> tuple[float, Contact] | None:
        """Return when a contact is released in it, and which."""
        return self.motion.release(self.track, self.state)


def linear_windows(
    motion: LinearMotion, state: Array, phase: float, lengths: Iterable[tuple[float, float]]
) -> Iterator[LinearWindow]:
    """Yield the windows of a flight from a state X at a phase, by their begins and lengths."""
    for begin, length in lengths:
        track = motion.track(state, length)
        yield LinearWindow(motion, track, state, begin, length)
        x, v = motion.moving(track.at(length))
        state = motion.resting(motion.embedded(x, v, phase + begin + length))


@dataclass(frozen=True, eq=False)
class IntegratedWindow(TrackWindow):
    """The same of a flight that is integrated."""

    field: str
    numbers: Sequence[float]
    """What `integration.flown` takes of the field's flight from a known state on."""
    known: float
    """When that is, since the flight's start: at the window's beginning or before."""
    size: int
    """Coordinates of the model, of which the mode has the first ones."""
    begin: float
    length: float

    @functools.cached_property
    def moving(self) -> Array:
        if self.begin == self.known:
            own = statement(self.field).freedom
            return self._whole(*np.reshape(self.numbers[1 : 1 + 2 * own], (2, own)))
        before = replace(self, begin=self.known, length=self.begin - self.known)
        return before.at(before.length)

    @functools.cached_property
    def track(self) -> IntegratedTrack:
        return IntegratedTrack(self.field, self._from(self.begin, self.moving), self.length)

    def then(self, begin: float, length: float) -> IntegratedWindow:
        """Return the window that begins where this one ends."""
        numbers = self._from(self.begin + self.length, self.at(self.length))
        return replace(self, numbers=numbers, known=begin, begin=begin, length=length)

    def _from(self, begin: float, moving: Array) -> list[float]:
        """What `integration.flown` takes from a state on."""
        own = statement(self.field).freedom
        moved = self.numbers[0] + (begin - self.known)
        return [moved, *moving[:, :own].ravel().tolist(), *self.numbers[1 + 2 * own :]]

    def at(self, dt: float) -> Array:
        found = self.track.at(np.array([dt]))
        return self._whole(found[0][0], found[1][0])

    def _whole(self, x: Array, v: Array) -> Array:
        """The state of all coordinates: those that the mode does not have are at zero."""
        whole = np.zeros((2, self.size))
        whole[:, : len(x)] = x, v
        return whole

    def bounds(self, guard: Guard) -> tuple[float, float]:
        return self.track.along(guard.row(self.size)).bounds()

    def release(self) -> None:
        """Nothing is held here."""


def integrated_windows(
    kernels: Kernels,
    values: Sequence[float],
    guard: Guard,
    start: State,
    lengths: Iterable[tuple[float, float]],
) -> Iterator[IntegratedWindow]:
    """Yield the windows of a flight from a state before a guard, by their begins and lengths."""
    field, numbers = kernels.field(guard.name)(start.phase, *start.section, *values)
    size, window = kernels.model.DEGREES_OF_FREEDOM, None
    for part in lengths:
        if window is None:
            window = IntegratedWindow(field, numbers, part[0], size, *part)
        else:
            window = window.then(*part)
        yield window


def until_repeated(found: Iterable[LinearWindow]) -> Iterator[LinearWindow]:
    """Yield windows of a flight until one is the one before it again, to rounding.

    What meets no guard in it meets none in any that follows.
    """
    before = None
    for window in found:
        if before is not None and window.length == before.length:
            apart = np.max(np.abs(window.state - before.state))
            if apart <= REPEATED * np.max(np.abs(window.state)):
                return
        yield window
        before = window


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


Window: TypeAlias = LinearWindow | IntegratedWindow | KernelWindow


def jump_derivative(kernels: Kernels, guard: str, state: State, values: Sequence[float]) -> Array:
    """Return how positions and velocities after an impact on a guard depend on the time and the
    section coordinates before it, shape (2 d, 2 d)."""
    law, d = evaluate_in(kernels.law(guard), FLOAT_SERIES), kernels.model.DEGREES_OF_FREEDOM
    columns = []
    for j in range(2 * d):
        before = (state.phase, *state.section)
        given = [Series([y, float(i == j)]) for i, y in enumerate(before)]
        after = law(*given, *values)[3][: 2 * d]
        columns.append([float(e.coefficients[1]) if isinstance(e, Series) else 0.0 for e in after])
    return np.array(columns).T
