"""Where motion begins after an impact, and interior touches of the guards of a mode.

Guards whose gap coordinates are the same combination of positions are looked at together. Linear
flights are polynomials in pieces; of others the zeros of every gap coordinate's acceleration are
found for each flight.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from ..arrays import Array, Vector
from ..models.guards import Guard, Row, slides_at, state_before
from ..models.model import Model
from .flight import FlightGaps, Touch, breaks_of, flight_gaps, smallest_gap, touch_of
from .kernels import Kernels
from .oscillation import SMALLEST, Excursion, Motion, Moved, excursions, gap_at_rest, speed_at_end
from .segment import ELSEWHERE, Kernel
from .track import IntegratedTrack, Track, track_between, track_of

# Whether the motion after a guard begins within the guards of its mode.
#
# A guard at which the motion comes to a switching surface leads to sliding, or, if sliding would
# begin beyond the limit it names (`Guard.past`), through the surface. Where a flight begins on the
# surface of a guard of its mode, the rate there says whether it leaves the mode at once.

AT_REST = 1e-10
"""A rate below this part of what the acceleration makes in a period is rounding."""


def limits_of(kernels: Kernels, letter: str) -> list[tuple[str, str, float]]:
    """Return the limits that decide whether a guard is the one that is met: the guard at which the
    motion would begin, its limit, and the side of it where it has to begin, +1 within, -1
    beyond."""
    guards, passages = kernels.model.WALLS, kernels.passages
    place = kernels.model.letters.index(letter)
    guard = guards[place]
    if guard.past:
        sliding = slides_at(guards, guard)
        assert sliding is not None, "checked when the class is defined"
        return [(sliding.name, guard.past, -1.0)]
    tangent = [(letter, guards[k].name, 1.0) for k in passages.beginning(place)]
    if passages.arrivals[place][place] != ELSEWHERE:
        ahead = [
            (letter, guards[k].name, 1.0)
            for k in kernels.guards_ahead(place)
            # where a flight between the two vanishes, both are passed at once: a V
            if not (passages.meets_at_rest(place, k) or passages.meets_at_rest(k, place))
        ]
        return [*tangent, *ahead]
    limits = [
        other.name
        for k, other in enumerate(guards)
        if passages.watched[place][k]
        and other.coordinate == guard.coordinate
        and not passages.meets_at_rest(place, k)
        and k not in passages.beginning(place)
    ]
    return [*tangent, *((letter, limit, 1.0) for limit in limits)]


def begins_on_surface(kernels: Kernels, begun: str, limit: str) -> bool:
    """Whether the motion after a guard begins on the surface of its limit, so that its rate tells
    on which side it goes on."""
    letters = kernels.model.letters
    return letters.index(limit) in kernels.passages.beginning(letters.index(begun))


def margin(
    kernels: Kernels,
    begun: str,
    limit: str,
    leave: Sequence[float],
    values: Sequence[float],
    positions: Sequence[float],
) -> float:
    """Return how far within a limit the motion would begin, or on its surface how fast it goes
    there; negative beyond it. `leave` are the unknowns of the impact, `values` and `positions`
    those of the parameters and of the guards.

    Not a number where that is rounding, as it is along all of a branch where sliding ends, and
    where the impact changes the rate of the gap alone, but the gap is not smallest there.
    """
    places = kernels.model.letters
    left, met = places.index(begun), places.index(limit)
    begin, rate, curvature = kernels.gap(begun, limit)(*leave, 0.0, *values)
    gap = positions[met] - begin
    if met in kernels.passages.bending(left):
        guards, size = kernels.model.WALLS, kernels.model.DEGREES_OF_FREEDOM
        state = state_before(guards[left].row(size), positions[left], leave[1:])
        place, before = (
            sum(c * x for c, x in zip(guards[met].row(size), part, strict=True)) for part in state
        )
        side, least = guards[met].side, ROUNDING * (abs(begin) + abs(positions[met]))
        smallest = side * before > 0.0 > side * rate and abs(gap) > least
        if abs(begin - place) <= least and not smallest:
            return math.nan
    if begins_on_surface(kernels, begun, limit):
        least = AT_REST * abs(curvature) * kernels.setup(*values).period
        gap = -rate if abs(rate) > least else math.nan
    return kernels.model.guard(limit).side * float(gap)


def not_past(
    kernels: Kernels,
    guard: Guard,
    leave: Sequence[float],
    values: Sequence[float],
    positions: Sequence[float],
) -> Iterator[tuple[str, float]]:
    """Yield the limit that a guard leads past, and by what (negative) gap it does not; past it, the
    guard on its surface by which the flight goes back at once, and about how far, as where a body
    that slips has more friction than one that sticks."""
    if not guard.past:
        return
    ((sliding, limit, _),) = limits_of(kernels, guard.name)
    within = margin(kernels, sliding, limit, leave, values, positions)
    if within > 0.0:
        yield limit, -within
        return
    left, passages = kernels.model.letters.index(guard.name), kernels.passages
    for k, other in enumerate(kernels.model.WALLS):
        if passages.watched[left][k] and passages.arrivals[left][k] != ELSEWHERE and not other.past:
            _, rate, acceleration = kernels.gap(guard.name, other.name)(*leave, 0.0, *values)
            least = AT_REST * abs(acceleration) * kernels.setup(*values).period
            if other.side * rate > least:
                depth = rate**2 / (2.0 * abs(acceleration)) if acceleration else abs(rate)
                yield other.name, -max(float(depth), SMALLEST)


ROUNDING = 1e-12
"""Rounding of the position at which a flight begins, as a part of its terms; of its rate and its
acceleration there, as parts of the largest at the ends of flights."""

BRIEF, AT_FIRST = 1e-9, 1e-4
"""A flight shorter than this part of the orbit's period may begin either way: it vanishes; and so
may one from rest for so long, but for this part of the flight at most."""


def interior_touches(
    kernels: Kernels, walls: str, values: Sequence[float], impacts: Array, span: float
) -> list[FlightGaps]:
    """Return the nearest interior touch of each wall on each flight of an orbit, as
    `flight.flight_gaps` does for guards on one coordinate whose motion is known in closed form."""
    if flights_are_apart(kernels, walls):
        return flight_gaps(kernels, walls, values, impacts, span)
    rows = impacts.tolist()
    rows.append([rows[0][0] + span, *rows[0][1:]])
    positions = kernels.setup(*values).walls
    places = {guard.name: i for i, guard in enumerate(kernels.model.WALLS)}
    found, flown = [], list[Flight]()
    for k, (wall, leave, arrive) in enumerate(zip(walls, rows[:-1], rows[1:], strict=True)):
        length = arrive[0] - leave[0]
        if length > 0.0:
            ends = places[wall], places[walls[(k + 1) % len(walls)]]
            letters = wall, walls[(k + 1) % len(walls)]
            if kernels.integrated(wall):
                flight = track_between(kernels, letters, leave, arrive, values, length)
                motions = motions_along(flight, kernels.model)
            elif kernels.linear(wall):
                law = kernels.law(wall)(*leave, *values)
                motions = motions_along(track_of(law, length), kernels.model)
            else:
                motions = motions_by_kernels(kernels, wall, leave, length, values)
            flown.append(Flight(k, ends, leave[0], length, arrive[1], motions))
            touches, slowest = _touches(kernels, flown[-1], positions, span)
            guard = kernels.model.WALLS[ends[0]]
            begun = (
                *not_past(kernels, guard, leave, values, positions),
                *violated_guards(kernels, ends, motions, positions),
            )
            past = [Touch(k, name, leave[0], gap) for name, gap in begun]
            ended = ends_beyond(kernels, ends, motions, positions, length)
            past += [Touch(k, name, arrive[0], gap) for name, gap in ended]
            found.append(FlightGaps(length, tuple(touches), slowest, tuple(past)))
        else:
            found.append(FlightGaps(length, (None,) * len(positions)))
    for touch in _leaving_at_once(kernels, flown, positions, span):
        own = found[touch.flight]
        found[touch.flight] = replace(own, beyond=(*own.beyond, touch))
    return found


def flights_are_apart(kernels: Kernels, walls: str) -> bool:
    """Whether the touches of a flight are found by `flight.flight_gaps`, without the others."""
    one = len(coordinates(kernels.model)) == 1
    by_matrices = any(kernels.linear(wall) for wall in dict.fromkeys(walls))
    by_one = one and kernels.passages.anchored and (not by_matrices or kernels.oscillates)
    return by_one and not kernels.may_leave_at_once(walls)


def coordinates(model: Model) -> dict[Row, list[int]]:
    """Return the numbers of the guards on each gap coordinate."""
    found: dict[Row, list[int]] = {}
    for i, guard in enumerate(model.WALLS):
        found.setdefault(guard.row(model.DEGREES_OF_FREEDOM), []).append(i)
    return found


Seen: TypeAlias = tuple[Motion, list[float]]
"""A gap coordinate on a flight: position, velocity and acceleration, and the times between which
the acceleration has one sign."""


class Flight(NamedTuple):
    """A flight: its number, the numbers of the guards at its ends, when it leaves, how long it
    lasts, the velocity with which it arrives, and each of the `coordinates` on it."""

    number: int
    ends: tuple[int, int]
    start: float
    length: float
    arriving: float
    motions: Sequence[Seen]


def motions_along(track: Track | IntegratedTrack, model: Model) -> list[Seen]:
    """Return each of the `coordinates` on a flight of which there is a track."""
    curves = [track.along(row) for row in coordinates(model)]
    return [(curve, curve.breaks()) for curve in curves]


def motions_by_kernels(
    kernels: Kernels, wall: str, leave: Sequence[float], length: float, values: Sequence[float]
) -> list[Seen]:
    """Return each of the `coordinates` on a flight by its kernels."""
    guards = kernels.model.WALLS
    first = (guards[numbers[0]].name for numbers in coordinates(kernels.model).values())
    return [seen_by(kernels.gap(wall, other), leave, length, values) for other in first]


def seen_by(kernel: Kernel, leave: Sequence[float], length: float, values: Sequence[float]) -> Seen:
    """Return a gap coordinate on a flight by its kernel."""
    breaks = breaks_of(kernel, leave, values, length)
    return (lambda head, dt, p: kernel(*leave, dt, *values)), breaks


def _touches(
    kernels: Kernels, flight: Flight, positions: Sequence[float], span: float
) -> tuple[list[Touch | None], float]:
    """The nearest touch of each wall, and the slowest turn. A coordinate that rests while others
    move is as near as ever."""
    guards, passages = kernels.model.WALLS, kernels.passages
    number, (left, reached), start, length, arriving, motions = flight
    touches: list[Touch | None] = [None] * len(positions)
    slowest = math.nan
    for seen, numbers in zip(motions, coordinates(kernels.model).values(), strict=True):
        leaving = passages.leaving[left] if left in numbers else 0.0
        here = reached in numbers
        speed = arriving if here else speed_at_end(seen[0]((), length, ()), length)
        rests = not {*passages.resting(left)}.isdisjoint(numbers)
        if not {*passages.beginning(left)}.isdisjoint(numbers):
            rests |= _turns_at_once(seen[0], _brief(length, span))
        motion, breaks = _from_rest(seen, _brief(length, span)) if rests else seen
        sides = leaving, float(guards[reached].side) if here else 0.0
        found = excursions(motion, (), (), (length, speed, *sides), breaks, 0.0, math.inf)
        others = not here and left not in numbers and length > BRIEF * span
        for i in numbers:
            if passages.watched[left][i] and not guards[i].past:
                touches[i] = touch_of(number, start, guards[i], positions[i], found)
                if left not in numbers and _is_at_start(touches[i], flight, positions[i]):
                    touches[i] = None
                if others and touches[i] is None:
                    touches[i] = _at_rest(flight, motion, guards[i], positions[i], found)
        if not abs(found[4]) >= abs(slowest):
            slowest = found[4]
    return touches, slowest


def _brief(length: float, span: float) -> float:
    """How long rounding decides which way a flight from rest begins."""
    return min(BRIEF * span, AT_FIRST * length)


def _turns_at_once(motion: Motion, brief: float) -> bool:
    """Whether a coordinate turns so soon after a flight begins that its rate there is rounding, as
    where a body slips whose force vanishes at these parameters alone."""
    _, rate, curvature = motion((), 0.0, ())
    return abs(rate) <= brief * abs(curvature)


def _from_rest(seen: Seen, brief: float) -> Seen:
    """What is seen of a coordinate that rests on a surface where the flight begins, from shortly
    after it on: where the acceleration vanishes, too, as where a contact ends, rounding turns it.
    """
    motion, breaks = seen

    def later(head: Vector, dt: float, p: Vector) -> Moved:
        return motion(head, max(dt, brief), p)

    return later, [dt for dt in breaks if dt > brief]


def _is_at_start(touch: Touch | None, flight: Flight, position: float) -> bool:
    """Whether a coordinate turns where a flight begins on the surface, but for rounding: there the
    impact before tells how near it is."""
    if touch is None:
        return False
    brief = touch.time - flight.start <= ROUNDING * flight.length
    return brief and abs(touch.gap) <= ROUNDING * abs(position)


def _at_rest(
    flight: Flight, motion: Motion, guard: Guard, position: float, found: Excursion
) -> Touch | None:
    """The gap of a coordinate that rests on a flight, as a touch where it begins."""
    begin, end = motion((), 0.0, ())[0], motion((), flight.length, ())[0]
    extrema = found[2] - begin, found[0] - begin
    gap = gap_at_rest(float(guard.side), position, begin, end - begin, *extrema)
    return None if math.isnan(gap) else Touch(flight.number, guard.name, flight.start, gap)


def violated_guards(
    kernels: Kernels, ends: tuple[int, int], motions: Sequence[Seen], positions: Sequence[float]
) -> Iterator[tuple[str, float]]:
    """Yield guards that a flight begins beyond, and by what (negative) gap.

    A jump of the gap coordinate leads there, or a mode that has guards which the one before does
    not have. To the guard reached the flight may have no duration, and then no gap but rounding.
    """
    left, reached = ends
    jumps = kernels.passages.arrivals[left][left] == ELSEWHERE
    watched = (k for k, meets in enumerate(kernels.passages.watched[left]) if meets)
    wanted = {*watched} if jumps else {*kernels.guards_ahead(left)}
    for i, gap, least in _gaps_at(kernels, wanted, motions, positions, 0.0):
        if gap < (0.0 if jumps and i != reached else -least):
            yield kernels.model.WALLS[i].name, gap


def _gaps_at(
    kernels: Kernels,
    wanted: set[int],
    motions: Sequence[Seen],
    positions: Sequence[float],
    dt: float,
) -> Iterator[tuple[int, float, float]]:
    """Yield some guards, their gaps at a time of a flight, and the sizes of what is rounding."""
    for (motion, _), numbers in zip(motions, coordinates(kernels.model).values(), strict=True):
        for i in wanted.intersection(numbers):
            place = motion((), dt, ())[0]
            gap = kernels.model.WALLS[i].side * (positions[i] - place)
            yield i, gap, ROUNDING * (abs(place) + abs(positions[i]))


def ends_beyond(
    kernels: Kernels,
    ends: tuple[int, int],
    motions: Sequence[Seen],
    positions: Sequence[float],
    length: float,
) -> Iterator[tuple[str, float]]:
    """Yield guards beyond which a flight ends that the next mode does not have, and by what gap: it
    need not turn there."""
    watched = kernels.passages.watched[ends[0]]
    behind = {k for k in kernels.guards_behind(ends[1]) if watched[k]}
    for i, gap, least in _gaps_at(kernels, behind, motions, positions, length):
        if gap < -least:
            yield kernels.model.WALLS[i].name, gap


def _leaving_at_once(
    kernels: Kernels, flights: Sequence[Flight], positions: Sequence[float], span: float
) -> Iterator[Touch]:
    """Yield the guards through which flights leave their modes where they begin, and how far.

    A flight that begins on a surface goes to the side to which its rate points, or, where that is
    rounding, its acceleration.
    """
    passages = kernels.passages
    for g, numbers in enumerate(coordinates(kernels.model).values()):
        began = [flight.motions[g][0]((), 0.0, ()) for flight in flights]
        ended = [flight.motions[g][0]((), flight.length, ()) for flight in flights]
        _, fastest, strongest = np.max(np.abs([*began, *ended]), axis=0, initial=0.0)
        for flight, (_, rate, curvature) in zip(flights, began, strict=True):
            left = flight.ends[0]
            if flight.length < BRIEF * span:
                continue
            motion, brief = flight.motions[g][0], _brief(flight.length, span)
            rates = abs(rate) > ROUNDING * fastest and not _turns_at_once(motion, brief)
            if not rates:  # a contact ends without force
                curvature = motion((), brief, ())[2]
            for i in {*passages.beginning(left), *passages.resting(left)} & {*numbers}:
                pushed = abs(curvature) > ROUNDING * strongest
                towards = rate if rates else curvature if pushed else 0.0
                if towards * kernels.model.WALLS[i].side > 0.0:
                    least = rate**2 / (2.0 * strongest) if rates and strongest else SMALLEST
                    yield _deepest(kernels, flight, flight.motions[g], i, positions[i], least)


def _deepest(
    kernels: Kernels, flight: Flight, seen: Seen, wall: int, position: float, least: float
) -> Touch:
    """The touch at the greatest depth beyond a guard through which a flight leaves, at `least` so
    deep."""
    (motion, breaks), guards = seen, kernels.model.WALLS
    guard, reached = guards[wall], guards[flight.ends[1]]
    size = kernels.model.DEGREES_OF_FREEDOM
    here = reached.row(size) == guard.row(size)
    last, speed, _ = motion((), flight.length, ())
    speed, side = (flight.arriving, float(reached.side)) if here else (speed, 0.0)
    ends = flight.length, speed, 0.0, side
    found = excursions(motion, (), (), ends, breaks, 0.0, math.inf)
    deep = [(-least, 0.0), (guard.side * (position - last), flight.length)]
    turned = smallest_gap(guard, position, found)
    if not math.isnan(turned[0]):
        deep.append(turned)
    gap, dt = min(deep)
    return Touch(flight.number, guard.name, flight.start + dt, gap)
