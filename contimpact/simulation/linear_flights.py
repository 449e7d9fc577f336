r"""Linear flights from impact to impact, plainly and compiled.

A flight is cut into pieces of one length, on each of which the state X of `segments.linear_flow` is
its Taylor polynomial. Tables made once for each law lead from X at the beginning of a piece to the
polynomial of every gap coordinate, displacement by displacement,

.. math:: n \cdot x(sh) - n \cdot x(0) = \sum_{k=1}^{K} c_k s^k, \qquad
          c_k = \frac{h^k}{k!}\,(n, 0)\,G^k X,

and to X at its end. Bounds by the coefficients say that a piece is clear of all guards, or that the
velocity or the acceleration has one sign on it; otherwise it is halved. `segments.flight` then
finds the first arrival by Newton's iteration inside a bracket, so that none is missed.

The functions from `fly_linear` on are in the plain subset of Python that `contimpact.compiling`
compiles: vectors are lists in plain Python, arrays in compiled code, and both have the same bits. A
flight on which a wall is held or released, or that is not resolved here, is left to the
`automaton`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

from ..arrays import Vector
from ..segments.flight import hit_between
from .impacts import DONE, NO_IMPACT, RUNAWAY, SHORT, wrap_time

TERMS = 18
"""Powers of the polynomials."""
PARTS = 500
"""Parts of a piece at most; what is not resolved then is left to the `automaton`."""
REPEATED = 4e-16
"""States that differ by less, by their size, are one to rounding."""
TOGETHER = 1e-14
"""Arrivals within this part of a period are at one time; the fastest of them comes first."""

BEYOND, LEFT = 5, 6
"""Why a run ended, besides those of `impacts`: a jump led behind a guard, as
`contimpact.simulation.run.Outcome` has it; or the next flight is left to the `automaton`."""


class Flights(NamedTuple):
    """A system at fixed parameter values, as vectors."""

    values: Vector
    """Parameter values, shape (p,)."""
    clock: Vector
    """The forcing period, shape (1,)."""
    sizes: Vector
    """Coordinates d, largest size of X, gap coordinates g, all rows (with the coordinates
    themselves) q, and periods after which a flight is given up."""
    factors: Vector
    """Factors of the coordinates in each row, shape (q d,)."""
    unit: Vector
    """The row of each coordinate, shape (d,)."""
    width: Vector
    count: Vector
    piece: Vector
    """`width`, `count`, `piece`: of each law, the size of X, the pieces of a period, and their
    duration, shape (l,)."""
    tables: Vector
    """Of each law and row, `TERMS` coefficients for each coordinate of X."""
    steps: Vector
    """Of each law, what each coordinate of X gains on a piece by each."""
    below: Vector
    above: Vector
    """`below`, `above`: the guards of each law's mode on each gap coordinate; -1 for none, shape (l
    g,)."""
    law: Vector
    row: Vector
    pivot: Vector
    sides: Vector
    positions: Vector
    """`law`, `row`, `pivot`, `sides`, `positions`: after each guard its law; its gap coordinate,
    pivot, side and position, shape (w,)."""
    leaving: Vector
    stays: Vector
    """`leaving`, `stays`: the side of the surface that is left, on the flight, and whether the
    flight begins there; see `segments.segment`, shape (w,)."""
    restitution: Vector
    """At low velocity; 1 where no impacts accumulate, shape (w,)."""


def space_of(flights: Flights) -> int:
    """Return how many numbers of scratch space `make_flights` takes."""
    _, width, gaps, rows, _ = flights.sizes
    return int(4 * width + 3 * gaps + TERMS * (rows + 1))


# In the plain subset of Python.
#
# Scratch space holds X, what it becomes, X a period before, and the section coordinates, each in
# the largest size of X; the arrivals at each gap coordinate (time, velocity, side); the polynomial
# of each row, and one more.


def displacement(head: tuple[int], s: float, space: Vector) -> tuple[float, float, float]:
    """Return displacement, velocity and acceleration from a polynomial in scratch space."""
    x, v, a = 0.0, 0.0, 0.0
    for k in range(head[0] + TERMS - 1, head[0] - 1, -1):
        a = a * s + v
        v = v * s + x
        x = x * s + space[k]
    return s * x, x + s * v, 2.0 * (v + s * a)


def coefficients(flights: Flights, law: int, row: int, to: int, space: Vector) -> None:
    """Fill in the polynomial of a row on a piece."""
    width = flights.sizes[1]
    at = (law * flights.sizes[3] + row) * width * TERMS
    for k in range(TERMS):
        space[to + k] = 0.0
    for j in range(flights.width[law]):
        x = space[j]
        for k in range(TERMS):
            space[to + k] += x * flights.tables[at + k]
        at += TERMS


def shift(space: Vector, at: int, to: int, begin: float, length: float) -> float:
    """Fill in a polynomial on a part of its piece; returns the displacement at its beginning."""
    for k in range(TERMS):
        space[to + k] = space[at + k]
    # powers of s - begin, by Horner's scheme again and again; the displacement at s = 0 is zero
    value = 0.0
    for k in range(TERMS - 1, -1, -1):
        value = (value + space[to + k]) * begin
    for first in range(TERMS):
        for k in range(TERMS - 2, max(first - 1, 0) - 1, -1):
            space[to + k] += begin * space[to + k + 1]
    power = length
    for k in range(TERMS):
        space[to + k] *= power
        power *= length
    return value


OPEN, CLEAR, MONOTONE = range(3)
"""What is known of a part of a piece."""


def look(space: Vector, at: int, origin: float, low: float, high: float) -> int:
    """Return whether a polynomial on [0, 1] keeps clear of both walls, or has a velocity or an
    acceleration of one sign."""
    c1, c2 = space[at], space[at + 1]
    rest, slopes, bends = 0.0, 0.0, 0.0
    for k in range(2, TERMS):
        size = abs(space[at + k])
        rest += size
        slopes += (k + 1) * size
        bends += (k + 1) * k * size
    end = c1 + c2
    if (
        origin + min(0.0, 0.5 * c1, end) - rest > low
        and origin + max(0.0, 0.5 * c1, end) + rest < high
    ):
        return CLEAR
    end = c1 + 2.0 * c2
    if min(c1, end) >= slopes or max(c1, end) <= -slopes:
        return MONOTONE
    third = abs(6.0 * space[at + 2])
    end = 2.0 * c2 + 6.0 * space[at + 2]
    bends -= third
    if min(2.0 * c2, end) >= bends or max(2.0 * c2, end) <= -bends:
        return MONOTONE
    return OPEN


def first_in_piece(
    space: Vector, at: int, to: int, rising: bool, low: float, high: float
) -> tuple[int, float, float]:
    """Return side, time and velocity of the first arrival on a piece, with certainty.

    The side is 0 for none, and 2 where the piece is not resolved.

    Parameters
    ----------
    at, to : int
        Places of the polynomial, and of room for another one.
    rising, low, high
        As in `segments.flight.first_arrival`.
    """
    kind = look(space, at, 0.0, low, high)
    if kind == CLEAR:
        return 0, 1.0, 0.0
    begin, length, parts = 0.0, 1.0, 0
    left = (0.0, space[at], 2.0 * space[at + 1])
    while begin < 1.0:
        if parts > 0:
            start = shift(space, at, to, begin, length)
            kind = look(space, to, start, low, high)
        parts += 1
        if kind == OPEN:
            if parts > PARTS:
                return 2, begin, 0.0
            length *= 0.5
        else:
            end = begin + length
            right = displacement((at,), end, space)
            turned = right[1] != 0.0 and (right[1] > 0.0) != rising
            if kind == MONOTONE:
                side, s, speed = hit_between(
                    displacement,
                    (at,),
                    space,
                    begin,
                    left,
                    end,
                    right,
                    turned,
                    rising,
                    low,
                    high,
                )
                if side != 0:
                    return side, s, speed
            rising = rising != turned
            begin, left = end, right
            while length < 1.0 and math.fmod(begin, 2.0 * length) == 0.0:
                length *= 2.0
    return 0, 1.0, 0.0


def row_value(flights: Flights, row: int, space: Vector) -> float:
    """Return a row's combination of the positions."""
    d, found = flights.sizes[0], 0.0
    for i in range(d):
        found += flights.factors[row * d + i] * space[i]
    return found


def is_beyond(flights: Flights, law: int, space: Vector) -> bool:
    """Whether a flight begins behind a guard of its mode."""
    gaps = flights.sizes[2]
    for row in range(gaps):
        below, above = flights.below[law * gaps + row], flights.above[law * gaps + row]
        x = row_value(flights, row, space)
        if below >= 0 and x < flights.positions[below]:
            return True
        if above >= 0 and x > flights.positions[above]:
            return True
    return False


def accumulates(flights: Flights, wall: int, velocity: float, at: int, space: Vector) -> bool:
    """Whether impacts on a wall are so near to their end that it may be held; see `impacts`."""
    e, piece = flights.restitution[wall], flights.piece[flights.law[wall]]
    force = flights.sides[wall] * (2.0 * space[at + 1]) / (piece * piece)
    if e >= 1.0 or not force > 0.0:
        return False
    return 2.0 * e * abs(velocity) <= SHORT * flights.clock[0] * force * (1.0 - e)


def advance(flights: Flights, law: int, space: Vector) -> None:
    """Move X to the end of a piece."""
    n, width = flights.width[law], flights.sizes[1]
    at, to = law * width * width, width
    for i in range(n):
        gained = 0.0
        for j in range(n):
            gained += flights.steps[at + j] * space[j]
        space[to + i] = space[i] + gained
        at += width
    for i in range(n):
        space[i] = space[to + i]


def arrive(flights: Flights, law: int, wall: int, s: float, speed: float, space: Vector) -> None:
    """Fill in the section coordinates of an arrival on a piece."""
    d, width, gaps = flights.sizes[0], flights.sizes[1], flights.sizes[2]
    piece, section, j = flights.piece[law], 3 * width, 0
    polynomials = 4 * width + 3 * gaps
    space[section] = speed / piece
    for i in range(d):
        if i != flights.pivot[wall]:
            row = flights.unit[i]
            at = polynomials + TERMS * row
            coefficients(flights, law, row, at, space)
            x, v, _ = displacement((at,), s, space)
            space[section + 1 + j] = space[i] + x
            space[section + 2 + j] = v / piece
            j += 2


def arrivals(
    flights: Flights, law: int, left: int, velocity: float, space: Vector
) -> tuple[int, float, float]:
    """Return guard, time and velocity of the first arrival on a piece; -1 for none, -2 where the
    flight is left to the `automaton`.

    Parameters
    ----------
    left : int
        The guard that is left at the beginning of the piece; -1 for none.
    velocity : float
        Before the impact there.
    """
    width, gaps = flights.sizes[1], flights.sizes[2]
    hits, polynomials = 4 * width, 4 * width + 3 * gaps
    spare = polynomials + TERMS * flights.sizes[3]
    earliest = math.inf
    for row in range(gaps):
        space[hits + 3 * row] = math.inf
        below, above = flights.below[law * gaps + row], flights.above[law * gaps + row]
        if below < 0 and above < 0:
            continue
        at = polynomials + TERMS * row
        coefficients(flights, law, row, at, space)
        origin = row_value(flights, row, space)
        c1, c2 = space[at], space[at + 1]
        rising = c1 > 0.0 or (c1 == 0.0 and c2 > 0.0)
        if not abs(c1) + abs(c2) < math.inf:
            return -2, 0.0, 0.0
        if left >= 0 and flights.row[left] == row:
            if c1 == 0.0 or accumulates(flights, left, velocity, at, space):
                return -2, 0.0, 0.0
            if flights.stays[left] != 0:
                origin = flights.positions[left]
            if flights.leaving[left] != 0:
                rising = flights.leaving[left] < 0
        low = flights.positions[below] - origin if below >= 0 else -math.inf
        high = flights.positions[above] - origin if above >= 0 else math.inf
        side, s, speed = first_in_piece(space, at, spare, rising, low, high)
        if side == 2:
            return -2, 0.0, 0.0
        if side != 0:
            space[hits + 3 * row] = s
            space[hits + 3 * row + 1] = speed
            space[hits + 3 * row + 2] = side
            earliest = min(earliest, s)
    if earliest == math.inf:
        return -1, 0.0, 0.0
    chosen, fastest = -1, -1.0
    for row in range(gaps):
        speed = abs(space[hits + 3 * row + 1])
        if space[hits + 3 * row] <= earliest + TOGETHER * flights.count[law] and speed > fastest:
            chosen, fastest = row, speed
    at = law * gaps + chosen
    wall = flights.above[at] if space[hits + 3 * chosen + 2] > 0.0 else flights.below[at]
    return wall, space[hits + 3 * chosen], space[hits + 3 * chosen + 1]


def fly_linear(
    leave: Callable[..., Any], flights: Flights, wall: int, phase: float, space: Vector
) -> tuple[int, int, float]:
    """Make one flight, from the section coordinates before an impact to those before the next.

    Returns
    -------
    outcome, wall : int
        `DONE`, `NO_IMPACT`, `BEYOND` or `LEFT`; the guard that ends the flight.
    dt : float
        Its duration.
    """
    width, law = flights.sizes[1], flights.law[wall]
    section, n, d = 3 * width, flights.width[law], flights.sizes[0]
    velocity, period, piece = space[section], flights.clock[0], flights.piece[law]
    leave(wall, phase, flights.values, space)
    if flights.stays[wall] == 0 and is_beyond(flights, law, space):
        return BEYOND, wall, 0.0
    left, begun = wall, 2 * width
    for j in range(n):
        space[begun + j] = space[j]
    for turn in range(flights.sizes[4]):
        for k in range(flights.count[law]):
            reached, s, speed = arrivals(flights, law, left, velocity, space)
            if reached == -2:
                return LEFT, wall, 0.0
            if reached >= 0:
                arrive(flights, law, reached, s, speed, space)
                return DONE, reached, turn * period + (k + s) * piece
            advance(flights, law, space)
            left = -1
        for j in range(2 * d, n):  # a whole period later
            space[j] = space[begun + j]
        apart, size = 0.0, 0.0
        for j in range(n):
            apart = max(apart, abs(space[j] - space[begun + j]))
            size = max(size, abs(space[j]))
            space[begun + j] = space[j]
        if apart <= REPEATED * size:
            break
    return NO_IMPACT, wall, 0.0


def make_flights(
    leave: Callable[..., Any],
    flights: Flights,
    space: Vector,
    state: Any,
    when: Any,
    walls: Any,
    turns: Any,
    phases: Any,
    sections: Any,
    span: Any,
) -> int:
    """Simulate from impact to impact; returns how many there were.

    Parameters
    ----------
    leave : callable ``leave(wall, phase, values, space)``
        Fills in X after an impact, from the section coordinates before it.
    state : vector of int, shape (3,)
        Guard and turns, kept up to date, and the number of the outcome, filled in.
    when : vector of shape (2 d + 1,)
        Phase and section coordinates, kept up to date, and the speed beyond which the motion runs
        away.
    walls, turns, phases, sections : vector
        Filled with a number for each impact, or 2 d - 1; of shape (0,) if no rows are kept.
    span : vector of int, shape (2,)
        Impacts to make at most, and the turns at which to stop.
    """
    size = 2 * flights.sizes[0] - 1
    at, period, kept = 3 * flights.sizes[1], flights.clock[0], len(walls) > 0
    wall, turn, phase, fastest = state[0], state[1], when[0], when[size + 1]
    most, last, made, outcome = span[0], span[1], 0, DONE
    for j in range(size):
        space[at + j] = when[1 + j]
    while made < most and turn < last:
        for j in range(size):
            when[1 + j] = space[at + j]
        speed = abs(space[at])
        for j in range(2, size, 2):
            speed = max(speed, abs(space[at + j]))
        if not speed <= fastest:
            outcome = RUNAWAY
            break
        outcome, wall, dt = fly_linear(leave, flights, wall, phase, space)
        if outcome != DONE:
            break
        phase, passed = wrap_time(phase + dt, period)
        turn += passed
        if kept:
            walls[made], turns[made], phases[made] = wall, turn, phase
            for j in range(size):
                sections[made * size + j] = space[at + j]
        made += 1
    if outcome == DONE:
        for j in range(size):
            when[1 + j] = space[at + j]
    state[0], state[1], state[2] = wall, turn, outcome
    when[0] = phase
    return made
