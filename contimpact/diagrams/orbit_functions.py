"""What a step asks of an orbit problem with one degree of freedom: its block-cyclic backend.

Functions in the plain subset of Python that `contimpact.compiling` compiles, on flat vectors, which
run plainly or compiled.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from ..arrays import Table, Vector
from ..orbits.block_cyclic import (
    POSITIONS,
    UNRESOLVED,
    assemble,
    eliminate,
    largest_residual,
    solve,
)
from ..orbits.status import (
    doubling_by_elimination,
    multipliers_by_elimination,
    product_of_multipliers,
    tangent_by_elimination,
    verdict,
)
from ..segments.kernel import Blocks, Setup

WALLS, PERIODS, FREE, DERIVED, GAPS, DOUBLING = range(6)
"""Places in `counts`: how many walls and periods, the place of the free parameter among the
values, how many derived parameters, and whether gaps and the determinant of a PD are wanted."""

DESCRIBED = 11
"""Numbers that describe a point: the residual, two multipliers, and what `verdict` says."""

SPAN, DETERMINANT, PRODUCT, MEASURED = range(DESCRIBED, DESCRIBED + 4)
"""Places beside them of what test functions go by: the orbit's period, the determinant of a PD, the
product of the multipliers. Last, where the gaps of all flights begin, followed by the flights'
slowest turns and by derived parameters."""


class OrbitVectors(NamedTuple):
    """The orbits of a branch as vectors and tables."""

    kinds: Vector
    word: Vector
    arrivals: Vector
    """`kinds`, `word`, `arrivals`: kinds of the flights, the walls they leave, and where they
    end."""
    watched: Vector
    """Whether the flight that leaves each wall can meet each wall."""
    counts: Vector
    """See `WALLS`."""
    values: Vector
    sides: Vector
    leaving: Vector
    """`values`, `sides`, `leaving`: parameter values; sides of the walls; the same on the flights
    that leave them."""
    zeros: Vector
    """Zeros of the acceleration, where they are the same along the branch."""
    blocks: Table
    kept: Table
    reduced: Table
    fixed: Table
    """`blocks`, `kept`, `reduced`, `fixed`: scratch space for the flights, for their elimination,
    for what is left, and for what depends on the parameters alone."""
    clock: Vector
    """Filled with the period and its derivative; `UNRESOLVED` grows by the flights on which
    compiled code has not found the zeros of the acceleration, `GROWN` by those that are long."""
    steps: Table
    """Scratch space for `segments.oscillation`."""
    units: Vector
    """Natural sizes of the residuals."""
    durations: Vector
    gaps: Vector
    times: Vector
    velocities: Vector
    """`durations`, `gaps`, `times`, `velocities`: scratch space for what decides whether an orbit
    is physical."""


def evaluate_cycle(
    flight: Callable[..., Blocks], setup: Callable[[Vector], Setup], orbit: OrbitVectors, z: Vector
) -> float:
    """Evaluate the flights of an orbit; returns the largest residual in natural units."""
    periods, place, values = orbit.counts[PERIODS], orbit.counts[FREE], orbit.values
    blocks, clock, fixed = orbit.blocks, orbit.clock, orbit.fixed
    assemble(flight, setup, orbit.kinds, periods, place, values, blocks, clock, fixed, z)
    return largest_residual(blocks, orbit.units)


def newton_step(orbit: OrbitVectors, row: Vector, g: float, out: Vector) -> bool:
    """Fill `out` with Newton's step at the point last evaluated; whether there is one."""
    reduced = eliminate(orbit.blocks, orbit.arrivals, orbit.kept, 1.0, False, out, 0.0)
    return abs(solve(reduced, orbit.kept, len(orbit.kinds), row, g, out)) > 0.0


def tangent_of_cycle(
    orbit: OrbitVectors, z: Vector, row: Vector, scale: Vector, out: Vector
) -> float:
    """Fill `out` with the unit tangent at the point last evaluated that goes on along `row`.

    Returns the determinant of the Jacobian bordered by the tangent, rows and columns scaled; NaN
    where no tangent is defined.
    """
    cycle = orbit.blocks, orbit.arrivals, orbit.kept, orbit.reduced
    return tangent_by_elimination(*cycle, z, orbit.clock[0], row, scale, out)


def measure(
    breaks: Callable[[Vector, float, Vector], Vector],
    excursion: Callable[..., Vector],
    orbit: OrbitVectors,
    z: Vector,
    row: Vector,
    at: int,
) -> tuple[float, bool]:
    """Record gaps, slowest turns and derived parameters in a row, from `at` on.

    Returns the smallest gap of all (infinite if there is none), and whether the orbit is surely
    physical. What decides that is filled in.
    """
    fixed, counts = orbit.fixed[0], orbit.counts
    walls, wanted = counts[WALLS], counts[GAPS] != 0
    word, sides, values = orbit.word, orbit.sides, orbit.values
    gaps, times, span = orbit.gaps, orbit.times, orbit.clock[0]
    leaving, watched, steps = orbit.leaving, orbit.watched, orbit.steps
    period = fixed[0]
    zeros = breaks(values, period, orbit.zeros)
    durations, velocities = orbit.durations, orbit.velocities
    count, smallest, sure = len(word), math.inf, True
    slowest = at + walls * count
    for k in range(count):
        i = 2 * k
        start, speed, wall = z[i], z[i + 1], word[k]
        if k + 1 < count:
            length, arriving, following = z[i + 2] - start, z[i + 3], word[k + 1]
        else:
            length, arriving, following = z[0] + span - start, z[1], word[0]
        durations[k], velocities[k] = length, speed
        if length < 0.0 or sides[wall] * speed < 0.0:
            sure = False
        high, when_high, low, when_low, slow = math.nan, math.nan, math.nan, math.nan, math.nan
        if wanted and length > 0.0:
            head, phase = (wall, start, speed), start % period
            ends = (length, arriving, leaving[wall], sides[following])
            high, when_high, low, when_low, slow = excursion(
                head, values, ends, zeros, phase, period, steps
            )
            if slow == math.inf:
                orbit.clock[UNRESOLVED] += 1.0
        row[slowest + k] = slow
        for j in range(walls):
            place = walls * k + j
            gap, dt = fixed[POSITIONS + j] - fixed[POSITIONS + wall], when_high
            if sides[j] > 0.0:
                gap -= high
            else:
                gap, dt = low - gap, when_low
            if watched[walls * wall + j] == 0:
                gap, dt = math.nan, math.nan
            gaps[place], times[place], row[at + place] = gap, start + dt, gap
            if gap < smallest:
                smallest = gap
    for i in range(counts[DERIVED]):
        row[slowest + count + i] = fixed[POSITIONS + walls + i]
    return smallest, sure and smallest >= 0.0


def observe_cycle(
    breaks: Callable[[Vector, float, Vector], Vector],
    excursion: Callable[..., Vector],
    orbit: OrbitVectors,
    z: Vector,
    row: Vector,
    at: int,
) -> None:
    """Record what describes a point, and what test functions go by, in a row."""
    smallest, sure = measure(breaks, excursion, orbit, z, row, at + MEASURED)
    count, span = len(orbit.kinds), orbit.clock[0]
    reduced = orbit.reduced[0]
    product = product_of_multipliers(orbit.blocks, orbit.arrivals, z, span)
    row[at + SPAN], row[at + PRODUCT] = span, product
    wanted = orbit.counts[DOUBLING] != 0
    row[at + DETERMINANT] = (
        doubling_by_elimination(reduced, orbit.blocks, count) if wanted else math.nan
    )
    worst = 0.0
    for k in range(count):
        block = orbit.blocks[k]
        worst = max(worst, abs(block[0]), abs(block[1]))
    row[at] = worst
    row[at + 1], row[at + 2], row[at + 3], row[at + 4] = multipliers_by_elimination(
        reduced, product
    )
    what, place, wall, amount, when = 0, 0, 0, 0.0, 0.0
    if sure:
        smallest = smallest if smallest < math.inf else math.nan
    else:
        what, place, wall, amount, when, smallest = verdict(
            orbit.word, orbit.sides, orbit.durations, orbit.gaps, orbit.times, orbit.velocities
        )
    known = orbit.counts[GAPS] != 0
    row[at + 5], row[at + 6], row[at + 7] = what if known else math.nan, place, wall
    row[at + 8], row[at + 9], row[at + 10] = amount, when, smallest
