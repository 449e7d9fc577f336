"""A routine step's view of an orbit problem with one degree of freedom, for `continuation.march`.

Everything a step needs of the orbit problem and of the test functions, as functions in the plain
subset of Python on flat vectors, which run plainly or compiled.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ..orbits.block_cyclic import (
    assemble,
    eliminate,
    multipliers,
    product_of_multipliers,
    row_norms,
    scaled,
    solve,
    store,
)
from ..orbits.physicality import verdict

FB, BP, PD, NS, PARAMETER, LISTS = range(6)
"""Places in `facts`: values of single test functions; then come lists, of the gaps, of the
velocities, of the durations, of the slowest turns and of what the kernel ``setup`` returns."""


WALLS, PERIODS, FREE, GAPS, DOUBLING, SETUP = range(6)
"""Places in `counts`: how many walls and periods, the place of the free parameter among the
values, and whether gaps, the determinant of a PD and derived parameters are wanted."""


DESCRIBED = 11
"""Numbers that describe a point: the residual, two multipliers, and what `verdict` says."""


SAME_TIME = 1e-12
"""Durations below this have no value; see `contimpact.bifurcations.test_functions.ZeroDuration`."""


class Course(NamedTuple):
    """What a branch is made of, as vectors and tables.

    Attributes
    ----------
    kinds, word : vector of int
        Kinds of the flights, and the walls they leave.
    counts : vector of int
        See `WALLS`.
    values, sides : vector
        Parameter values; sides of the walls.
    places, targets : vector
        The test functions: where in `facts` each is, and the value it is to reach.
    zeros : vector
        Zeros of the acceleration, where they are the same along the branch.
    blocks, kept, reduced, fixed : table
        Room for the flights, for their elimination, for what is left, and for what the kernel
        ``setup`` returns.
    clock, facts, durations, gaps, times, velocities : vector
        Room for the period, for the test functions, and for what decides whether an orbit is
        physical.
    """

    kinds: Any
    word: Any
    counts: Any
    values: Any
    sides: Any
    places: Any
    targets: Any
    zeros: Any
    blocks: Any
    kept: Any
    reduced: Any
    fixed: Any
    clock: Any
    facts: Any
    durations: Any
    gaps: Any
    times: Any
    velocities: Any


def evaluate_cycle(flight, setup, course, z):
    """Evaluate the flights of an orbit; returns the largest residual."""
    counts = course.counts
    return assemble(
        flight, setup, course.kinds, counts[PERIODS], counts[FREE], course.values, course.blocks,
        course.clock, course.fixed, z,
    )  # fmt: skip


def newton_step(course, row, g, out):
    """Fill `out` with Newton's step at the point last evaluated; whether there is one."""
    reduced = eliminate(
        course.blocks, course.kinds, course.counts[WALLS], course.kept, 1.0, False, out, 0.0
    )
    return abs(solve(reduced, course.kept, len(course.kinds), row, g, out)) > 0.0


def tangent_of_cycle(course, z, row, scale, out):
    """Fill `out` with the unit tangent at the point last evaluated that goes on along `row`.

    Returns the determinant of the Jacobian bordered by the tangent, rows and columns scaled; not a
    number where no tangent is defined.
    """
    count = len(course.kinds)
    reduced = eliminate(
        course.blocks, course.kinds, course.counts[WALLS], course.kept, 0.0, True, z,
        course.clock[0],
    )  # fmt: skip
    store(course.reduced, 0, reduced)
    det = solve(reduced, course.kept, count, row, 1.0, out)
    size = 0.0
    for i in range(2 * count + 1):
        part = out[i] / scale[i]
        size += part * part
    size = math.sqrt(size)
    if not (abs(det) > 0.0 and size > 0.0 and size - size == 0.0):
        return math.nan
    for i in range(2 * count + 1):
        out[i] /= size
    time, velocity, free = scale[0], scale[1], scale[2 * count]
    sizes = count * math.log(time * velocity) + math.log(free)
    norms = row_norms(course.blocks, count, 1.0, time, velocity, free)
    # the border is row / scale^2; with the tangent itself in its place it is longer by `size`
    return scaled(reduced[12], reduced[13] + sizes, det * size, norms)


def measure(breaks, excursion, course, z):
    """Fill in durations, velocities, gaps and when they are smallest, also among the facts.

    Returns the smallest gap of all (infinite where there is none), and whether the orbit is surely
    physical.
    """
    fixed = course.fixed[0]
    count, walls, wanted = len(course.kinds), course.counts[WALLS], course.counts[GAPS] != 0
    word, sides, values, facts = course.word, course.sides, course.values, course.facts
    gaps, times, span = course.gaps, course.times, course.clock[0]
    period = fixed[0]
    zeros = breaks(values, period, course.zeros)
    velocities = LISTS + walls * count
    durations = velocities + count
    slowest = durations + count
    smallest, sure = math.inf, True
    for k in range(count):
        i = 2 * k
        start, speed, wall = z[i], z[i + 1], word[k]
        if k + 1 < count:
            length, arriving, following = z[i + 2] - start, z[i + 3], word[k + 1]
        else:
            length, arriving, following = z[0] + span - start, z[1], word[0]
        course.durations[k], course.velocities[k] = length, speed
        towards = sides[wall] * speed
        facts[velocities + k] = towards
        if length < 0.0 or towards < 0.0:
            sure = False
        facts[durations + k] = length if abs(length) >= SAME_TIME else math.nan
        high, when_high, low, when_low, slow = math.nan, math.nan, math.nan, math.nan, math.nan
        at = walls * k
        if wanted and length > 0.0:
            high, when_high, low, when_low, slow = excursion(
                (wall, start, speed), values, length, arriving, sides[wall], sides[following],
                zeros, start % period, period,
            )  # fmt: skip
        facts[slowest + k] = slow
        for j in range(walls):
            gap, dt = fixed[3 + j] - fixed[3 + wall], when_high
            if sides[j] > 0.0:
                gap -= high
            else:
                gap, dt = low - gap, when_low
            gaps[at + j], times[at + j], facts[LISTS + at + j] = gap, start + dt, gap
            if gap < smallest:
                smallest = gap
    if course.counts[SETUP] != 0:
        for j in range(len(fixed)):
            facts[slowest + count + j] = fixed[j]
    return smallest, sure and smallest >= 0.0


def observe_cycle(breaks, excursion, course, z, tangent, orientation, rows, at):
    """Put the test functions, the residual, the multipliers and the verdict into a row."""
    smallest, sure = measure(breaks, excursion, course, z)
    facts, walls, last = course.facts, course.counts[WALLS], len(z) - 1
    product = product_of_multipliers(course.blocks, course.kinds, walls, z, course.clock[0])
    facts[FB], facts[BP], facts[PARAMETER] = tangent[last], orientation, z[last]
    facts[PD] = doubling(course) if course.counts[DOUBLING] != 0 else math.nan
    facts[NS] = 1.0
    if product - product == 0.0:
        facts[NS] = (product - 1.0) / (abs(product) + 1.0)
    for i in range(len(course.places)):
        rows[at + i] = facts[course.places[i]] - course.targets[i]
    worst = 0.0
    for k in range(len(course.kinds)):
        block = course.blocks[k]
        worst = max(worst, abs(block[0]), abs(block[1]))
    at += len(course.places)
    rows[at] = worst
    at += 1
    rows[at], rows[at + 1], rows[at + 2], rows[at + 3] = multipliers(course.reduced[0], product)
    what, place, wall, amount, when = 0, 0, 0, 0.0, 0.0
    if sure:
        smallest = smallest if smallest < math.inf else math.nan
    else:
        what, place, wall, amount, when, smallest = verdict(
            course.word, course.sides, course.durations, course.gaps, course.times,
            course.velocities, -1,
        )  # fmt: skip
    known = course.counts[GAPS] != 0
    rows[at + 4], rows[at + 5], rows[at + 6] = what if known else math.nan, place, wall
    rows[at + 7], rows[at + 8], rows[at + 9] = amount, when, smallest


def doubling(course):
    """Return the scaled determinant of the cyclic matrix with its last coupling negative."""
    p00, p01, p10, p11, q00, q01, q10, q11, _, _, _, _, sign, logarithm, _ = course.reduced[0]
    det = (p00 - q00) * (p11 - q11) - (p01 - q01) * (p10 - q10)
    norms = row_norms(course.blocks, len(course.kinds), -1.0, 1.0, 1.0, 0.0)
    return scaled(sign, logarithm, det, norms)
