"""Flights from one impact to the next, for accelerations that depend on time or on the state."""

from __future__ import annotations

import types
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..segments.arithmetic import ARRAYS, Kernel, evaluate_in
from ..segments.flight import (
    chebyshev_coefficients,
    chebyshev_nodes,
    first_arrival,
    first_hit,
    rounding_along,
    zeros_in_turn,
)
from .body import Body
from .integrated_flight import fly_integrated

NUDGE = 1e-9
"""Zeros of a state-dependent acceleration this near a release belong to the release itself."""

NODES = 67
"""At which a displacement is looked at that is not resolved: not those of the acceleration."""
SPREAD = 4.0
"""What a displacement may do between the nodes, in terms of its higher coefficients."""


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
        if "flown" in self.motions[wall].__code__.co_names:
            least = self._release(body, wall, velocity)
            return fly_integrated(self.motions[wall], body, wall, phase, velocity, least)
        head, rising = (wall, phase, velocity), body.leaving[wall] < 0
        low, high = body.low[wall], body.high[wall]
        side, left, speed = 0, 0.0, velocity
        windows = range(body.longest[0])
        for breaks in (b for k in windows for b in self.breaks(body, wall, phase, velocity, k)):
            side, left, speed, rising = first_hit(
                self.motion, head, body.values, breaks, left, rising, low, high
            )
            if side:
                break
        return side, left, speed

    def _release(self, body: Body, wall: int, velocity: float) -> float:
        """Time before which a zero of the acceleration belongs to the release itself."""
        at_rest = velocity == 0.0 or body.restitution[wall] == 0.0
        return NUDGE * body.clock[0] if at_rest else 0.0

    def breaks(
        self, body: Body, wall: int, phase: float, velocity: float, window: int
    ) -> Iterator[list[float]]:
        """Yield times after leaving, in a window of a period, between which velocity is monotone.

        They come piece by piece: an arrival spares those after it. A piece of many oscillations
        that keep clear of the walls has its ends alone.
        """
        period, values = body.clock[0], body.values
        start, vectorised = window * period, evaluate_in(self.motions[wall], ARRAYS)

        def motion(dt: Array) -> Any:
            return vectorised(phase, velocity, start + dt, *values)

        def clear(begin: float, length: float) -> bool:
            x = motion(begin + chebyshev_nodes(NODES, length))[0]
            return keeps_clear(x, body.low[wall], body.high[wall])

        least = self._release(body, wall, velocity) if window == 0 else 0.0
        rounding = rounding_along(self.motions[wall], (phase, velocity), values, start)
        for zeros in zeros_in_turn(lambda dt: motion(dt)[2], period, clear, rounding=rounding):
            inside = [start + t for t in zeros if least < t < period]
            if inside:
                yield inside
        yield [start + period]


def keeps_clear(x: Array, low: float, high: float) -> bool:
    """Whether a displacement stays off both walls, from its values at `chebyshev_nodes`.

    Between the nodes it may leave their range by what its higher coefficients say, oscillations
    among them that the nodes do not resolve.
    """
    rest = SPREAD * float(np.sum(np.abs(chebyshev_coefficients(x)[len(x) // 4 :])))
    return bool(low + rest < np.min(x) and np.max(x) < high - rest)
