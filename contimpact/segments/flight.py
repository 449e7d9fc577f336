"""Along a flight: where it comes nearest to a wall."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from ..arrays import Array, Vector
from ..models.guards import Guard
from .arithmetic import ARRAYS, evaluate_in
from .integrated_track import integrated_track, track_between
from .kernels import Kernels
from .oscillation import MOST, excursion_by_law
from .track import track_of
from .turning_points import Excursion as Excursion
from .turning_points import Motion as Motion
from .turning_points import Moved as Moved
from .turning_points import excursions as excursions
from .turning_points import turn_guess as turn_guess
from .turning_points import velocity_zero as velocity_zero
from .zeros import chebyshev_zeros, rounding_along, time_zeros


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
    `beyond` are the walls behind which the flight begins or ends, as touches there.
    """

    duration: float
    touches: tuple[Touch | None, ...]
    slowest: float = math.nan
    beyond: tuple[Touch, ...] = ()


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
        if kernels.integrated(wall):
            track = track_between(kernels, (wall, named[j].name), leave, arrive, values, length)
            curve = track.along(named[i].row(1), from_start=True)
            along = arrive[1], *sides, curve.breaks(), 0.0, math.inf
            found = excursions(curve, (), (), length, *along)
        else:
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
    flight, and those given are not used. A last argument is scratch space of compiled code.
    """
    motion, named = kernels.motions, kernels.model.WALLS
    if in_time:
        return lambda head, p, length, arriving, left, reached, zeros, phase, period, _=None: (
            excursions(motion, head, p, length, arriving, left, reached, zeros, phase, period)
        )
    steps: list[list[float]] = []
    zeros = [0.0] * (2 * MOST)

    def law(head: Vector, values: Vector) -> Any:
        return kernels.law(named[head[0]].name)(head[1], head[2], *values)

    def excursion(
        head: Vector,
        values: Vector,
        length: float,
        arriving: float,
        left_side: float,
        reached_side: float,
        *_: Any,
    ) -> Excursion:
        if kernels.oscillates:
            given = law, head, values, length, arriving, left_side, reached_side, steps, zeros
            found = excursion_by_law(*given)
            if found[4] != math.inf:
                return found
        wall = named[head[0]]
        if kernels.linear(wall.name):
            track = track_of(kernels.law(wall.name)(*head[1:], *values), length)
            curve = track.along(wall.row(kernels.model.DEGREES_OF_FREEDOM), from_start=True)
            sides, breaks = (left_side, reached_side), curve.breaks()
            return excursions(curve, (), (), length, arriving, *sides, breaks, 0.0, math.inf)
        if kernels.integrated(wall.name):
            flown = integrated_track(kernels, wall.name, head[1:], values, length)
            along = flown.along(wall.row(1), from_start=True)
            sides = left_side, reached_side
            return excursions(
                along, (), (), length, arriving, *sides, along.breaks(), 0.0, math.inf
            )
        kernel = kernels.motion(wall.name)
        vectorised, rounding = evaluate_in(kernel, ARRAYS), rounding_along(kernel, head[1:], values)
        breaks = chebyshev_zeros(
            lambda dt: vectorised(*head[1:], dt, *values)[2], length, rounding=rounding
        )
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
