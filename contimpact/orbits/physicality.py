"""Whether an orbit is physical, and if not why and where."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

from ..arrays import Array, Vector
from ..models.guards import Guard
from ..segments.flight import FlightGaps


@dataclass(frozen=True)
class Verdict:
    """Whether an orbit is physical; if not, the first reason found. `smallest_gap` is not a
    number where no flight comes nearer to a wall than at its ends."""

    physical: bool
    reason: str | None
    smallest_gap: float


def findings(
    word: str,
    named: Sequence[Guard],
    impacts: Array,
    gaps: Sequence[FlightGaps],
    forgive_touches: Collection[tuple[int, str]] = (),
    forgive_impacts: Collection[int] = (),
) -> tuple[float, ...]:
    """Return what `verdict` says of an orbit, without what is the event itself: touches by flight
    and wall, and impacts of which neither the direction nor the order of two in a row matters."""
    places = {w.name: i for i, w in enumerate(named)}
    walls = [places[name] for name in word]
    touches = [
        None if t is None or (k, t.wall) in forgive_touches else t
        for k, flight in enumerate(gaps)
        for t in flight.touches
    ]
    begun = (t for flight in gaps for t in flight.beyond)
    for past in (t for t in begun if (t.flight, t.wall) not in forgive_touches):
        place = len(named) * past.flight + places[past.wall]
        known = touches[place]
        touches[place] = past if known is None or past.gap < known.gap else known
    sides, durations = [float(w.side) for w in named], [flight.duration for flight in gaps]
    velocities = impacts[:, 1].tolist()
    for k in forgive_impacts:
        velocities[k] = 0.0
        if (k + 1) % len(word) in forgive_impacts:
            durations[k] = 0.0
    nearest = [math.nan if t is None else t.gap for t in touches]
    times = [math.nan if t is None else t.time for t in touches]
    return verdict(walls, sides, durations, nearest, times, velocities)


def verdict_of(found: Sequence[float], word: str, named: Sequence[Guard]) -> Verdict:
    """Return what `verdict` found as an object."""
    return Verdict(found[0] == PHYSICAL, reason_of(found, word, named), found[5])


PHYSICAL, OUT_OF_ORDER, PASSES, WRONG_WAY = 0, 1, 2, 3
"""Verdicts of `verdict`."""


AT_REST = 1e-12
"""An impact whose velocity is below this part of the largest of the orbit runs neither way: beside
a zero velocity its sign is rounding."""


AT_ONCE = 1e-12
"""Impacts that follow each other within this part of the orbit's period are in either order: both
bodies of a symmetric machine hit at once, all along a branch."""


def verdict(
    walls: Vector, sides: Vector, durations: Vector, gaps: Vector, times: Vector, velocities: Vector
) -> tuple[int, int, int, float, float, float]:
    """Decide whether an orbit is physical, from numbers: its word, durations and velocities.

    It is if all flights last, within `AT_ONCE`, none passes a wall, and every impact runs towards
    its wall or is at rest within `AT_REST`. `gaps` has the smallest gap of each flight to each wall
    and `times` when it is reached, NaN where there is none; velocities are those before impacts.

    Returns what is found (0 for physical, or why not), the place of the flight or impact and the
    wall passed, the amount (a duration, depth or velocity), the time of a touch, and the smallest
    gap of all, NaN where there is none.
    """
    what, place, wall, amount, when, smallest = 0, 0, 0, 0.0, 0.0, math.inf
    count, span = len(sides), 0.0
    for k in range(len(durations)):
        span += durations[k]
    for k in range(len(durations)):
        if durations[k] < -AT_ONCE * span and what == 0:
            what, place, amount = 1, k, durations[k]
        for i in range(count):
            gap = gaps[count * k + i]
            if gap < smallest:  # not where there is none
                smallest = gap
                if gap < 0.0 and what == 0:
                    what, place, wall, amount, when = 2, k, i, -gap, times[count * k + i]
    fastest = 0.0
    for k in range(len(walls)):
        fastest = max(fastest, abs(velocities[k]))
    for k in range(len(walls)):
        wrong = velocities[k] * sides[walls[k]] < -AT_REST * fastest
        if wrong and what != 3:
            what, place, amount = 3, k, velocities[k]
    return what, place, wall, amount, when, smallest if smallest < math.inf else math.nan


def reason_of(found: Vector, word: str, named: Sequence[Guard]) -> str | None:
    """Return what `verdict` found as a sentence; None where the orbit is physical.

    Impacts and flights are counted from 1, as in columns and on the page.
    """
    if found[0] == PHYSICAL:
        return None
    what, k, wall = (int(number) for number in found[:3])
    amount, when = found[3], found[4]
    flight = f"flight {k + 1} ({word[k]} to {word[(k + 1) % len(word)]})" if word else "the orbit"
    if what == OUT_OF_ORDER:
        return f"impacts out of order: {flight} lasts {amount:.6g}"
    if (
        what == PASSES
        and word
        and any(g.name == word[k] and g.past == named[wall].name for g in named)
    ):
        name = named[wall].name
        return f"{flight} goes through where it would slide, {amount:.6g} within {name}"
    if what == PASSES:
        return f"{flight} passes wall {named[wall].name} by {amount:.6g} at t = {when:.6g}"
    return f"impact {k + 1} on wall {word[k]} runs the wrong way: velocity {amount:.6g}"
