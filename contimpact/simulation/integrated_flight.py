"""Flights that are integrated, from one impact to the next: first arrivals on Taylor polynomials.

The flight is integrated in windows, so that little of it lies beyond the wall that ends it: there
the flow may cease to be finite. On each window the coordinate is a polynomial in pieces, the
acceleration's zeros on it are isolated, and `segments.flight` misses nothing between them. Where
the polynomials' bounds keep clear of the walls there is nothing to isolate.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from ..segments.arithmetic import Arithmetic, Kernel, evaluate_in
from ..segments.flight import first_hit
from ..segments.integration import IntegratedCurve, IntegratedTrack
from .body import Body

FIRST, LEAST = 2.0**-5, 2.0**-30
"""Duration of the first window, and the shortest, in periods. Others are up to twice as long as the
one before, a period at most; where the flow does not stay finite they are halved."""


class Begun(NamedTuple):
    """What a flight leaves with."""

    field: str
    time: float
    position: float
    velocity: float
    parameters: list[float]


def begun(motion: Kernel, arguments: Sequence[float]) -> Begun:
    """Return what a kernel ``motion`` integrates, for ``(t0, v0, dt, *p)``."""
    found: list[Begun] = []

    def flown(field: str, directions: str, dt: float, *numbers: float) -> list[float]:
        t, x, v, *parameters = numbers
        found.append(Begun(field, t, x, v, parameters))
        return [v, v]

    names = {**motion.__globals__, "flown": flown}
    evaluate_in(motion, Arithmetic(names))(*arguments)
    return found[0]


def fly_integrated(
    motion: Kernel, body: Body, wall: int, phase: float, velocity: float, least: float
) -> tuple[int, float, float]:
    """Return side, time and velocity of the impact that ends a flight; see `flights.fly_in_time`.

    The side is 0 also where the flow ceases to be finite before any impact.

    Parameters
    ----------
    motion : Kernel
        After the wall.
    body, wall, phase, velocity
        As of `flights.fly_in_time`.
    least : float
        Time before which a zero of the acceleration belongs to the release itself.
    """
    period, rising, speed = body.clock[0], body.leaving[wall] < 0, velocity
    left = begun(motion, (phase, velocity, 0.0, *body.values))
    passed, moved, length = 0.0, 0.0, FIRST * period
    while passed < body.longest[0] * period and length > LEAST * period:
        numbers = [left.time + passed, left.position + moved, left.velocity, *left.parameters]
        try:
            curve = IntegratedTrack(left.field, numbers, length).along((1,), from_start=True)
        except ArithmeticError:
            length *= 0.5
            continue
        walls = body.low[wall] - moved, body.high[wall] - moved
        x, speed = curve.at_end()
        if _clear(curve, *walls):
            rising = speed > 0.0
        else:
            breaks = [t for t in curve.breaks() if least < passed + t < passed + length]
            window: Any = ((), (), [*breaks, length], 0.0, rising, *walls)
            side, dt, before, rising = first_hit(curve, *window)
            if side:
                return side, passed + dt, before
        left = left._replace(velocity=speed)
        passed, moved = passed + length, moved + x
        length = min(2.0 * length, period)
    return 0, passed, speed


def _clear(curve: IntegratedCurve, low: float, high: float) -> bool:
    """Whether a coordinate surely keeps clear of both walls."""
    least, most = curve.bounds()
    return low < least and most < high
