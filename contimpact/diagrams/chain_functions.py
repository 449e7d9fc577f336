"""What a step asks of an orbit problem with several coordinates: as `orbit_functions` for one.

Functions in the plain subset of Python that `contimpact.compiling` compiles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from ..arrays import Table, Vector
from ..orbits.block_cyclic import POSITIONS
from ..orbits.cyclic_chain import assemble, doubling, eliminate, row_norms, solve
from ..orbits.multipliers import scale_determinant
from ..orbits.physicality import verdict
from ..segments.layout import Blocks, Setup
from ..segments.oscillation import MOST, FollowedFlight, excursions, follow_all, motion_of_gap
from .orbit_functions import UNRESOLVED

WALLS, PERIODS, FREE, DERIVED, GAPS, DOUBLING, UNKNOWNS, COORDINATES = range(8)
"""Places in `counts`: as of `orbit_functions`, then the unknowns of an impact, and how many gap
coordinates there are."""

FINDINGS = 6
"""Numbers that `verdict` returns."""


class ChainVectors(NamedTuple):
    """The orbits of a branch as vectors and tables; see `orbit_functions.OrbitVectors`."""

    kinds: Vector
    word: Vector
    arrivals: Vector
    watched: Vector
    counts: Vector
    measured: Vector
    """Number of the gap coordinate of each wall."""
    values: Vector
    sides: Vector
    leaving: Vector
    weights: Vector
    """Weights of the coordinates in each gap coordinate."""
    ends: Vector
    law: Vector
    reduced: Vector
    """`ends`, `law`, `reduced`: scratch space for the ends of a flight, for the numbers of its law,
    and for what is left of the cycle."""
    blocks: Table
    kept: Table
    work: Table
    fixed: Table
    clock: Vector
    durations: Vector
    gaps: Vector
    times: Vector
    velocities: Vector
    own: Table
    steps: Table
    breaks: Vector
    found: Vector
    signs: Vector
    zeros: Vector
    moving: Vector
    forces: Vector
    """`own`, `steps`, `breaks`, `found`, `signs`, `zeros`, `moving`, `forces`: those of
    `segments.oscillation.FollowedFlight`."""


def evaluate_chain(
    flight: Callable[[int, Vector, Vector], Blocks],
    setup: Callable[[Vector], Setup],
    orbit: ChainVectors,
    z: Vector,
) -> float:
    """Evaluate the flights of an orbit; returns the largest residual."""
    counts = orbit.counts
    periods, place, m = counts[PERIODS], counts[FREE], counts[UNKNOWNS]
    values, ends, blocks = orbit.values, orbit.ends, orbit.blocks
    clock, fixed = orbit.clock, orbit.fixed
    return assemble(
        flight, setup, orbit.kinds, periods, place, m, values, ends, blocks, clock, fixed, z
    )


def eliminate_chain(orbit: ChainVectors, right: float, exact: bool, z: Vector) -> None:
    """Eliminate impacts 2 to N at the point last evaluated."""
    span, drift = orbit.clock[0], orbit.clock[1]
    blocks, arrivals, kept, work = orbit.blocks, orbit.arrivals, orbit.kept, orbit.work
    m = orbit.counts[UNKNOWNS]
    eliminate(blocks, arrivals, kept, work, orbit.reduced, m, drift, right, exact, z, span)


def chain_step(orbit: ChainVectors, row: Vector, g: float, out: Vector) -> bool:
    """Fill `out` with Newton's step at the point last evaluated; whether there is one."""
    eliminate_chain(orbit, 1.0, False, out)
    count, m = len(orbit.kinds), orbit.counts[UNKNOWNS]
    return abs(solve(orbit.reduced, orbit.kept, orbit.work, count, m, row, g, out)) > 0.0


def tangent_of_chain(
    orbit: ChainVectors, z: Vector, row: Vector, scale: Vector, out: Vector
) -> float:
    """Fill `out` with the unit tangent; see `orbit_functions.tangent_of_cycle`."""
    count, m = len(orbit.kinds), orbit.counts[UNKNOWNS]
    n = m * count
    eliminate_chain(orbit, 0.0, True, z)
    det = solve(orbit.reduced, orbit.kept, orbit.work, count, m, row, 1.0, out)
    size = 0.0
    for i in range(n + 1):
        part = out[i] / scale[i]
        size += part * part
    size = math.sqrt(size)
    if not (abs(det) > 0.0 and size > 0.0 and size - size == 0.0):
        return math.nan
    sizes = math.log(scale[n])
    for i in range(m):
        sizes += count * math.log(scale[i])
    for i in range(n + 1):
        out[i] /= size
    norms = row_norms(orbit.blocks, count, m, orbit.clock[1], 1.0, scale, scale[n])
    at = 2 * m * m + 2 * m
    sign, logarithm = orbit.reduced[at], orbit.reduced[at + 1]
    return scale_determinant(sign, logarithm + sizes, det * size, norms)


def observe_chain(
    follow: Callable[[ChainVectors, int, Vector, int, float], int],
    orbit: ChainVectors,
    z: Vector,
    tangent: Vector,
    orientation: float,
    row: Vector,
    at: int,
) -> None:
    """Record what describes a point, and what test functions go by, in a row.

    The largest residual, what `verdict` says, the pencil P and Q, the orbit's period, the
    determinant of a PD; the gaps of all flights, their slowest turns, derived parameters.
    """
    counts, clock = orbit.counts, orbit.clock
    count, m, walls = len(orbit.kinds), counts[UNKNOWNS], counts[WALLS]
    worst = 0.0
    for k in range(count):
        for i in range(m):
            worst = max(worst, abs(orbit.blocks[k][i]))
    row[at] = worst
    at += 1 + FINDINGS
    for i in range(2 * m * m):
        row[at + i] = orbit.reduced[i]
    at += 2 * m * m
    row[at], row[at + 1] = clock[0], math.nan
    if counts[DOUBLING] != 0:
        det, place = doubling(orbit.reduced, orbit.work, m), 2 * m * m + 2 * m
        for i in range(m):
            orbit.ends[i] = 1.0
        norms = row_norms(orbit.blocks, count, m, clock[1], -1.0, orbit.ends, 0.0)
        sign, logarithm = orbit.reduced[place], orbit.reduced[place + 1]
        row[at + 1] = scale_determinant(sign, logarithm, det, norms)
    at += 2
    measure_chain(follow, orbit, z, row, at)
    for i in range(counts[DERIVED]):
        row[at + (walls + 1) * count + i] = orbit.fixed[0][POSITIONS + walls + i]
    what, place, wall, amount, when, smallest = verdict(
        orbit.word, orbit.sides, orbit.durations, orbit.gaps, orbit.times, orbit.velocities
    )
    at -= 2 + 2 * m * m + FINDINGS
    row[at] = what if counts[GAPS] != 0 else math.nan
    row[at + 1], row[at + 2], row[at + 3] = place, wall, amount
    row[at + 4], row[at + 5] = when, smallest


def measure_chain(
    follow: Callable[[ChainVectors, int, Vector, int, float], int],
    orbit: ChainVectors,
    z: Vector,
    row: Vector,
    at: int,
) -> None:
    """Record gaps and slowest turns, and fill in what decides if the orbit is physical."""
    counts = orbit.counts
    count, m, walls = len(orbit.kinds), counts[UNKNOWNS], counts[WALLS]
    for k in range(count):
        later = m * (k + 1) if k + 1 < count else 0
        length = z[later] - z[m * k] if later > 0 else z[0] + orbit.clock[0] - z[m * k]
        orbit.durations[k], orbit.velocities[k] = length, z[m * k + 1]
        slowest = math.nan
        for j in range(walls):
            orbit.gaps[walls * k + j], orbit.times[walls * k + j] = math.nan, math.nan
        if counts[GAPS] != 0 and length > 0.0:
            made = follow(orbit, orbit.word[k], z, m * k, length)
            if made < 0:
                orbit.clock[UNRESOLVED] += 1.0
            else:
                for g in range(counts[COORDINATES]):
                    slow = touches_of(orbit, k, g, made, z[m * k], length, z[later + 1])
                    if not abs(slow) >= abs(slowest):
                        slowest = slow
        for j in range(walls):
            row[at + walls * k + j] = orbit.gaps[walls * k + j]
        row[at + walls * count + k] = slowest


def touches_of(
    orbit: ChainVectors, k: int, g: int, made: int, start: float, length: float, arriving: float
) -> float:
    """Fill in the gaps of a flight to the walls of one gap coordinate; returns its slowest turn."""
    counts, following = orbit.counts, k + 1 if k + 1 < len(orbit.kinds) else 0
    walls, coordinates = counts[WALLS], counts[COORDINATES]
    left, reached = orbit.word[k], orbit.word[following]
    head, place = (g, coordinates, made), 2 * MOST * g
    leaving = orbit.leaving[left] if orbit.measured[left] == g else 0.0
    side, speed = 0.0, arriving
    if orbit.measured[reached] == g:
        side = orbit.sides[reached]
    else:
        speed = motion_of_gap(head, length, orbit.steps)[1]
    breaks = orbit.breaks[place : place + int(orbit.found[g])]
    high, when_high, low, when_low, slow = excursions(
        motion_of_gap, head, orbit.steps, length, speed, leaving, side, breaks, 0.0, math.inf
    )
    begin = orbit.forces[len(orbit.forces) - coordinates + g]
    for j in range(walls):
        if orbit.measured[j] == g and orbit.watched[walls * left + j] != 0:
            gap, dt = orbit.fixed[0][POSITIONS + j] - begin, when_high
            if orbit.sides[j] > 0.0:
                gap -= high
            else:
                gap, dt = low - gap, when_low
            orbit.gaps[walls * k + j], orbit.times[walls * k + j] = gap, start + dt
    return slow


def follow_law(
    law: Callable[[int, Vector, Vector], tuple[float, float, Vector, Vector]],
    orbit: ChainVectors,
    wall: int,
    z: Vector,
    at: int,
    length: float,
) -> int:
    """Follow a flight by its law, from the impact whose unknowns stand in z; returns the steps.

    Where each gap coordinate starts is put behind the forces; that of the wall left is its wall's.
    """
    m, coordinates = orbit.counts[UNKNOWNS], orbit.counts[COORDINATES]
    for i in range(m):
        orbit.ends[i] = z[at + i]
    d, waves, numbers, state = law(wall, orbit.ends, orbit.values)
    freedom, given = int(d), len(numbers)
    for i in range(given):
        orbit.law[i] = numbers[i]
    for i in range(len(state)):
        orbit.ends[i] = state[i]
    begins = len(orbit.forces) - coordinates
    for g in range(coordinates):
        place = 0.0
        for i in range(freedom):
            place += orbit.weights[freedom * g + i] * orbit.ends[i]
        orbit.forces[begins + g] = place
    orbit.forces[begins + orbit.measured[wall]] = orbit.fixed[0][POSITIONS + wall]
    flown = FollowedFlight(
        orbit.own,
        orbit.steps,
        orbit.breaks,
        orbit.found,
        orbit.signs,
        orbit.zeros,
        orbit.moving,
        orbit.forces,
    )
    return follow_all(
        freedom, int(waves), orbit.law, orbit.ends, orbit.weights, coordinates, length, flown
    )
