"""Flights with any number of coordinates: how each gap coordinate moves, and the state they reach.

A flight is looked at in windows, one after the other. In each every gap coordinate is known as a
displacement, with the times between which its acceleration has one sign; `segments.flight` then
finds its first arrival with certainty. Linear flights are polynomials in pieces and start anywhere;
others are answered by the model's kernels and start at a guard.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np

from ..arrays import Array
from ..models.guards import Guard, pivot
from ..segments.arithmetic import ARRAYS, evaluate_in
from ..segments.flight import Motion, chebyshev_zeros, rounding_along
from ..segments.kernels import Kernels
from ..segments.track import Track
from .linear_motion import Contact, LinearMotion
from .run import State

Coordinate: TypeAlias = tuple[Motion, list[float], float]
"""A gap coordinate in a window: its displacement, velocity and acceleration, the times between
which the acceleration has one sign, and where displacements are measured from."""

REPEATED = 4e-16
"""States that differ by less, by their size, are one to rounding."""

SHORTEST = 0.125
"""The first window of flights that may be short, in periods."""


class Window(Protocol):
    """A part of a flight.

    Attributes
    ----------
    begin, length : float
        Its first time, since the flight's start, and its duration.
    """

    @property
    def begin(self) -> float: ...
    @property
    def length(self) -> float: ...

    def coordinate(self, guard: Guard) -> Coordinate:
        """Return how a guard's gap coordinate moves; times count from the window's beginning."""
        ...

    def bounds(self, guard: Guard) -> tuple[float, float]:
        """Return bounds of a guard's gap coordinate in the window, wide ones if need be."""
        ...

    def section(self, guard: Guard, dt: float, speed: float) -> tuple[float, ...]:
        """Return the section coordinates at a guard, from the gap coordinate's velocity there."""
        ...

    def release(self) -> tuple[float, Contact] | None:
        """Return when a contact is released in it, and which."""
        ...


def windows(period: float, longest: int, short: bool) -> Iterator[tuple[float, float]]:
    """Yield begin and length of the windows of a flight, a short one first if it may be short."""
    begin = SHORTEST if short else 0.0
    if short:
        yield 0.0, begin * period
    for turn in range(longest):
        yield (begin + turn) * period, period


@dataclass(frozen=True, eq=False)
class LinearWindow:
    """A part of a linear flight.

    Attributes
    ----------
    motion : LinearMotion
    track : Track
    state : ndarray
        X at the window's beginning.
    begin, length : float
    """

    motion: LinearMotion
    track: Track
    state: Array
    begin: float
    length: float

    def coordinate(self, guard: Guard) -> Coordinate:
        size = self.motion.shape.freedom
        row = guard.row(size)
        curve = self.track.along(row, from_start=True)
        return curve, curve.breaks(), float(self.state[:size] @ row)

    def bounds(self, guard: Guard) -> tuple[float, float]:
        return self.track.bounds(guard.row(self.motion.shape.freedom))

    def section(self, guard: Guard, dt: float, speed: float) -> tuple[float, ...]:
        return section_of(self.motion, self.motion.resting(self.track.at(dt)), guard, speed)

    def release(self) -> tuple[float, Contact] | None:
        return self.motion.release(self.track, self.state)


def section_of(motion: LinearMotion, state: Array, guard: Guard, speed: float) -> tuple[float, ...]:
    """Return the section coordinates of a state at a guard."""
    size = motion.shape.freedom
    others = [i for i in range(size) if i != pivot(guard.row(size))]
    return (speed, *(float(state[j]) for i in others for j in (i, size + i)))


def linear_windows(
    motion: LinearMotion, state: Array, phase: float, lengths: Iterable[tuple[float, float]]
) -> Iterator[LinearWindow]:
    """Yield the windows of a flight from a state X at a phase, by their begins and lengths."""
    size = motion.shape.freedom
    for begin, length in lengths:
        track = motion.track(state, length)
        yield LinearWindow(motion, track, state, begin, length)
        state, now = track.at(length), phase + begin + length
        state = motion.resting(motion.embedded(state[:size], state[size : 2 * size], now))


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
    """A part of a flight that the model's kernels know.

    Attributes
    ----------
    kernels : Kernels
    values : sequence of float
    guard : Guard
        That is left.
    position : float
        Of its surface.
    start : State
        Before that.
    begin, length : float
    """

    kernels: Kernels
    values: Sequence[float]
    guard: Guard
    position: float
    start: State
    begin: float
    length: float

    def coordinate(self, guard: Guard) -> Coordinate:
        size = self.kernels.model.DEGREES_OF_FREEDOM
        own = guard.row(size) == self.guard.row(size)
        kernels, left = self.kernels, self.guard.name
        kernel = kernels.motion(left) if own else kernels.gap(left, guard.name)
        vectorised = evaluate_in(kernel, ARRAYS)
        head, values, begin = (self.start.phase, *self.start.section), self.values, self.begin

        def motion(_: Any, dt: float, __: Any) -> Any:
            return kernel(*head, begin + dt, *values)

        breaks = chebyshev_zeros(
            lambda dt: vectorised(*head, begin + dt, *values)[2],
            self.length,
            rounding=rounding_along(kernel, head, values, begin),
        )
        return motion, breaks, self.position if own else 0.0

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
