"""Flights from one impact to the next, for accelerations that depend on time or on the state."""

from __future__ import annotations

import types
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ..segments.arithmetic import ARRAYS, Kernel, evaluate_in
from ..segments.arrival import first_arrival, first_hit
from ..segments.zeros import chebyshev_zeros
from .body import Body

NUDGE = 1e-9
"""Zeros of a state-dependent acceleration this near a release belong to the release itself."""


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
    low, high, rising = body.low[wall], body.high[wall], body.sides[wall] < 0
    side, dt, speed, _ = first_arrival(
        motion, head, body.values, body.zeros, phase, period, longest, 0.0, rising, low, high
    )
    return side, dt, speed


@dataclass(frozen=True)
class FlightInState:
    """As `fly_in_time`, for an acceleration that depends on the state; not compiled.

    Attributes
    ----------
    motions : sequence of Kernel
        After each wall.
    motion : callable
        From `motion_at`.
    """

    motions: Sequence[Kernel]
    motion: Callable[..., Any]

    def __call__(
        self, body: Body, wall: int, phase: float, velocity: float
    ) -> tuple[int, float, float]:
        head, rising = (wall, phase, velocity), body.sides[wall] < 0
        low, high = body.low[wall], body.high[wall]
        side, left, speed = 0, 0.0, velocity
        for window in range(body.longest[0]):
            breaks = self.breaks(body, wall, phase, velocity, window)
            side, left, speed, rising = first_hit(
                self.motion, head, body.values, breaks, left, rising, low, high
            )
            if side:
                break
        return side, left, speed

    def breaks(
        self, body: Body, wall: int, phase: float, velocity: float, window: int
    ) -> list[float]:
        """Times after leaving, in one period's window, between which the velocity is monotone."""
        period, values = body.clock[0], body.values
        start = window * period
        vectorised = evaluate_in(self.motions[wall], ARRAYS)
        zeros = chebyshev_zeros(
            lambda dt: vectorised(phase, velocity, start + dt, *values)[2], period
        )
        at_rest = velocity == 0.0 or body.restitution[wall] == 0.0
        least = NUDGE * period if at_rest and window == 0 else 0.0
        return [*(start + t for t in zeros if least < t < period), start + period]
