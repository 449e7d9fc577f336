"""The cyclic linear systems of orbits of several coordinates, in time linear in their length.

As `block_cyclic`, with m unknowns per impact instead of two: impacts 2 to N are eliminated one
after the other by reflections of the 2m rows that hold them, and m rows are left: P z_1 + mu Q z_1.

The functions are in the plain subset of Python that `contimpact.compiling` compiles. A flight is a
row of `blocks`: m residuals, the blocks A and B row by row, m derivatives by lambda. An eliminated
impact is a row of `kept`: m rows of the coefficients of its own unknowns, of z_1, of z_{k+1}, of
lambda, and the right side. What is left stands in `reduced`: P, Q, the column of lambda, the right
side, then sign and logarithm of the product of all that was divided by.

Where the period is free, the orbit closes at t = 0 (see `quiet`): the last arrival does not move
with t_1, and the first column of Q is left out of the Jacobian, that of P out of the pencil.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from ..arrays import Table, Vector, norm
from ..segments.kernel import Blocks, Setup
from ..segments.oscillation import (
    MOST,
    FollowedFlight,
    excursions,
    follow_all,
    gap_at_rest,
    motion_of_gap,
    speed_at_end,
)
from ..segments.touches import BRIEF
from .block_cyclic import POSITIONS, arrival_rate, largest_residual, store
from .quiet import AGAIN, BEYOND
from .status import scale_determinant, verdict


def block_size(m: int) -> int:
    """Return the numbers of a flight."""
    return 2 * m * (m + 1)


def kept_size(m: int) -> int:
    """Return the numbers of an eliminated impact."""
    return m * (3 * m + 2)


# What a step asks of an orbit problem with several coordinates: as `diagrams.orbit_functions`.

WALLS, PERIODS, FREE, DERIVED, GAPS, DOUBLING, UNKNOWNS, COORDINATES = range(8)
"""Places in `counts`: as of `diagrams.orbit_functions`, then the unknowns of an impact, and how
many gap coordinates there are."""

FINDINGS = 6
"""Numbers that `verdict` returns."""


WATCHED, AT_START, BY_RATE, AT_END = 1, 2, 4, 8
"""Bits in `watched`, by the wall left: whether a wall is met on the flight, whether the flight may
begin beyond it, and whether the rate tells, on its surface. By the wall reached: whether the flight
may end beyond it."""

CLEARLY = 1e-9
"""Part of a position or a rate within which it is left to `segments.touches` on which side of a
wall a flight begins or ends."""


class ChainVectors(NamedTuple):
    """The orbits of a branch as vectors and tables; see `diagrams.orbit_functions.OrbitVectors`."""

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
    jumps: Vector
    """Of each wall, whether a flight begins elsewhere than on the wall it leaves."""
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
    units: Vector
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


Follow: TypeAlias = Callable[[ChainVectors, int, Vector, int, float], int]
"""``follow(orbit, wall, z, at, length)``: see `follow_law`."""


def evaluate_chain(
    flight: Callable[[int, Vector, Vector], Blocks],
    setup: Callable[[Vector], Setup],
    orbit: ChainVectors,
    z: Vector,
) -> float:
    """Evaluate every flight of an orbit at the unknowns z, as `block_cyclic.assemble` with m of
    them per impact; returns the largest residual in natural units.

    ``flight(kind, ends, values)`` takes the 2m unknowns at its ends. With no periods, the orbit's
    is free.
    """
    counts, ends, values, clock = orbit.counts, orbit.ends, orbit.values, orbit.clock
    count, m, periods = len(orbit.kinds), counts[UNKNOWNS], counts[PERIODS]
    n = m * count
    values[counts[FREE]] = z[n]
    period, slopes, _, positions, derived, _ = setup(values)
    store(orbit.fixed, 0, (period,) + positions + derived)  # noqa: RUF005
    span, drift = periods * period if periods > 0 else -z[0], periods * slopes[0]
    clock[0], clock[1] = span, drift
    for k in range(count):
        for i in range(m):
            ends[i] = z[m * k + i]
            ends[m + i] = z[(m * (k + 1) + i) % n]
        if k + 1 == count:
            ends[m] += span
        rows, start, end, free = flight(orbit.kinds[k], ends, values)
        store(orbit.blocks, k, rows + start + end + free)
    return largest_residual(orbit.blocks, orbit.units)


def parameter_derivative(row: Vector, i: int, m: int, drift: float, last: bool) -> float:
    """Return the derivative of equation i by lambda; the last arrival moves with the period."""
    own = row[m + 2 * m * m + i]
    return own + drift * row[m + m * m + m * i] if last else own


def eliminate(orbit: ChainVectors, right: float, exact: bool, z: Vector) -> None:
    """Eliminate impacts 2 to N at the point last evaluated, as `block_cyclic.eliminate` with m
    unknowns per impact; in what is left the sign is 0 where an impact cannot be eliminated."""
    span, drift, m = orbit.clock[0], orbit.clock[1], orbit.counts[UNKNOWNS]
    blocks, arrivals, kept, work = orbit.blocks, orbit.arrivals, orbit.kept, orbit.work
    reduced, count, size = orbit.reduced, len(arrivals), m * m
    b = blocks[0]
    for i in range(size):
        reduced[i], reduced[size + i] = b[m + i], b[m + size + i]
    if exact:
        reduced[size] = arrival_rate(z, 0, m, arrivals, span, b[m + size])
    for i in range(m):
        reduced[2 * size + i] = parameter_derivative(b, i, m, drift, count == 1)
        reduced[2 * size + m + i] = -right * b[i]
    sign, logarithm = 1.0, 0.0
    for k in range(1, count):
        b = blocks[k]
        for i in range(m):
            upper, lower = work[i], work[m + i]
            for j in range(m):
                upper[j], lower[j] = reduced[size + m * i + j], b[m + m * i + j]
                upper[m + j], lower[m + j] = reduced[m * i + j], 0.0
                upper[2 * m + j], lower[2 * m + j] = 0.0, b[m + size + m * i + j]
            upper[3 * m] = reduced[2 * size + i]
            lower[3 * m] = parameter_derivative(b, i, m, drift, k + 1 == count)
            upper[3 * m + 1], lower[3 * m + 1] = reduced[2 * size + m + i], -right * b[i]
        if exact:
            work[m][2 * m] = arrival_rate(z, k, m, arrivals, span, b[m + size])
        if not reflect(work, m):
            sign = 0.0
            break
        row = kept[k]
        for i in range(m):
            pivot = work[i][i]
            sign = -sign if pivot < 0.0 else sign
            logarithm += math.log(abs(pivot))
            for j in range(3 * m + 2):
                row[(3 * m + 2) * i + j] = work[i][j]
            lower = work[m + i]
            for j in range(m):
                reduced[m * i + j], reduced[size + m * i + j] = lower[m + j], lower[2 * m + j]
            reduced[2 * size + i], reduced[2 * size + m + i] = lower[3 * m], lower[3 * m + 1]
    reduced[2 * size + 2 * m], reduced[2 * size + 2 * m + 1] = sign, logarithm


def reflect(work: Table, m: int) -> bool:
    """Make the first m columns of 2m rows triangular; whether none of them vanishes."""
    width = 3 * m + 2
    for c in range(m):
        size = 0.0
        for i in range(c, 2 * m):
            size += work[i][c] * work[i][c]
        size = math.sqrt(size)
        if not size > 0.0:
            return False
        first = work[c][c]
        pivot = -size if first >= 0.0 else size
        first -= pivot
        factor = -1.0 / (pivot * first)
        for j in range(c + 1, width):
            s = first * work[c][j]
            for i in range(c + 1, 2 * m):
                s += work[i][c] * work[i][j]
            s *= factor
            work[c][j] -= s * first
            for i in range(c + 1, 2 * m):
                work[i][j] -= s * work[i][c]
        work[c][c] = pivot
    return True


def solve(orbit: ChainVectors, row: Vector, g: float, out: Vector) -> float:
    """Solve the system bordered by a row with the right side g, from what `eliminate` has left.

    Returns the determinant of the rows left and the border; 0 (or NaN) where there is no solution.
    """
    count, m, free_period = len(orbit.kinds), orbit.counts[UNKNOWNS], orbit.counts[PERIODS] == 0
    reduced, kept, work = orbit.reduced, orbit.kept, orbit.work
    size, width = m * m, 3 * m + 2
    for i in range(m):
        for j in range(m):
            work[i][j] = reduced[m * i + j] + reduced[size + m * i + j]
        if free_period:
            work[i][0] = reduced[m * i]
        work[i][m], work[i][m + 1] = reduced[2 * size + i], reduced[2 * size + m + i]
    eliminate_border(orbit, row, g)
    if reduced[2 * size + 2 * m] == 0.0:
        return 0.0
    determinant = triangular(work, m + 1, m + 2)
    if not abs(determinant) > 0.0:
        return 0.0
    for i in range(m, -1, -1):
        x = work[i][m + 1]
        for j in range(i + 1, m + 1):
            x -= work[i][j] * (out[m * count] if j == m else out[j])
        x /= work[i][i]
        if i == m:
            out[m * count] = x
        else:
            out[i] = x
    for k in range(count - 1, 0, -1):
        row = kept[k]
        later = (m * (k + 1)) % (m * count)
        for i in range(m - 1, -1, -1):
            at = width * i
            x = row[at + 3 * m + 1] - row[at + 3 * m] * out[m * count]
            for j in range(m):
                known = row[at + 2 * m + j] * out[later + j]
                if free_period and j == 0 and later == 0:
                    known = 0.0
                x -= row[at + m + j] * out[j] + known
            for j in range(i + 1, m):
                x -= row[at + j] * out[m * k + j]
            out[m * k + i] = x / row[at + i]
    return determinant


def eliminate_border(orbit: ChainVectors, row: Vector, g: float) -> None:
    """Fill in the border in z_1 and lambda alone, and its right side, in row m of `work`, where the
    next one is scratch space."""
    count, m, kept = len(orbit.kinds), orbit.counts[UNKNOWNS], orbit.kept
    border, left, free_period = orbit.work[m], orbit.work[m + 1], orbit.counts[PERIODS] == 0
    width = 3 * m + 2
    for i in range(m):
        border[i], left[i] = row[i], 0.0
    border[m], border[m + 1] = row[m * count], g
    for k in range(1, count):
        known = kept[k]
        for i in range(m):
            x = row[m * k + i] + left[i]
            for j in range(i):
                x -= left[m + j] * known[width * j + i]
            left[m + i] = x / known[width * i + i] if known[width * i + i] != 0.0 else math.nan
        for i in range(m):
            left[i] = 0.0
        for j in range(m):
            factor, at = left[m + j], width * j
            for i in range(m):
                border[i] -= factor * known[at + m + i]
                left[i] -= factor * known[at + 2 * m + i]
            border[m] -= factor * known[at + 3 * m]
            border[m + 1] -= factor * known[at + 3 * m + 1]
    for i in range(m):
        if not (free_period and i == 0):
            border[i] += left[i]


def triangular(work: Table, size: int, width: int) -> float:
    """Make a matrix upper triangular with partial pivoting; returns its determinant, 0 where none
    was found."""
    determinant = 1.0
    for c in range(size):
        best = c
        for i in range(c + 1, size):
            if abs(work[i][c]) > abs(work[best][c]):
                best = i
        if not abs(work[best][c]) > 0.0:
            return 0.0
        if best != c:
            determinant = -determinant
            for j in range(c, width):
                work[c][j], work[best][j] = work[best][j], work[c][j]
        determinant *= work[c][c]
        for i in range(c + 1, size):
            factor = work[i][c] / work[c][c]
            for j in range(c + 1, width):
                work[i][j] -= factor * work[c][j]
    return determinant


def row_norms(orbit: ChainVectors, mu: float, scale: Vector, free: float) -> float:
    """Return the logarithm of the product of the rows' norms in the cyclic matrix.

    The last coupling is multiplied by mu, the column of lambda by `free`, and the others by the
    sizes in `scale`; with a `free` of zero, lambda and the sizes are left out. Where the period is
    free, the matrix is the Jacobian for a positive mu, and that of the multipliers for a negative
    one.
    """
    count, m, free_period = len(orbit.kinds), orbit.counts[UNKNOWNS], orbit.counts[PERIODS] == 0
    logarithm, size, drift = 0.0, m * m, orbit.clock[1]
    for k in range(count):
        b, here = orbit.blocks[k], m * k
        there = here + m if k + 1 < count else 0
        for i in range(m):
            total = free * parameter_derivative(b, i, m, drift, k + 1 == count)
            total *= total
            for j in range(m):
                one, other = b[m + m * i + j], b[m + size + m * i + j]
                if free_period and j == 0:
                    other = 0.0 if mu > 0.0 and k + 1 == count else other
                    one = 0.0 if mu < 0.0 and k == 0 else one
                if count == 1:
                    one, other = one + mu * other, 0.0
                if free > 0.0:
                    one, other = one * scale[here + j], other * scale[there + j]
                total += one * one + other * other
            if not total > 0.0:
                return -math.inf
            logarithm += math.log(total)
    return 0.5 * logarithm


def doubling(reduced: Vector, work: Table, m: int, free_period: bool) -> float:
    """Return the determinant of P - Q."""
    size = m * m
    for i in range(m):
        for j in range(m):
            work[i][j] = reduced[m * i + j] - reduced[size + m * i + j]
        if free_period:
            work[i][0] = -reduced[size + m * i]
    return triangular(work, m, m)


def chain_step(orbit: ChainVectors, row: Vector, g: float, out: Vector) -> bool:
    """Fill `out` with Newton's step at the point last evaluated; whether there is one."""
    eliminate(orbit, 1.0, False, out)
    return abs(solve(orbit, row, g, out)) > 0.0


def tangent_of_chain(
    orbit: ChainVectors, z: Vector, row: Vector, scale: Vector, out: Vector
) -> float:
    """Fill `out` with the unit tangent; see `diagrams.orbit_functions.tangent_of_cycle`."""
    m = orbit.counts[UNKNOWNS]
    n = m * len(orbit.kinds)
    eliminate(orbit, 0.0, True, z)
    det = solve(orbit, row, 1.0, out)
    size = norm(out, scale)
    if not (abs(det) > 0.0 and size > 0.0 and size - size == 0.0):
        return math.nan
    sizes = 0.0
    for i in range(n + 1):
        sizes += math.log(scale[i])
        out[i] /= size
    norms = row_norms(orbit, 1.0, scale, scale[n])
    at = 2 * m * m + 2 * m
    sign, logarithm = orbit.reduced[at], orbit.reduced[at + 1]
    return scale_determinant(sign, logarithm + sizes, det * size, norms)


def observe_chain(
    measure: Callable[[Follow, ChainVectors, Vector, Vector, int], bool],
    follow: Follow,
    orbit: ChainVectors,
    z: Vector,
    row: Vector,
    at: int,
) -> None:
    """Record what describes a point, and what test functions go by, in a row.

    The largest residual, what `verdict` says, the pencil P and Q, the orbit's period, the
    determinant of a PD; the gaps of all flights and their slowest turns, as `measure` records them,
    derived parameters. What `verdict` says is NaN where flights are not followed, or may begin or
    end beyond a wall.
    """
    counts, clock = orbit.counts, orbit.clock
    count, m, walls = len(orbit.kinds), counts[UNKNOWNS], counts[WALLS]
    worst, free = 0.0, counts[PERIODS] == 0
    for k in range(count):
        for i in range(m):
            worst = max(worst, abs(orbit.blocks[k][i]))
    row[at] = worst
    at += 1 + FINDINGS
    for i in range(2 * m * m):
        row[at + i] = orbit.reduced[i]
    if free:
        for i in range(m):
            row[at + m * i] = 0.0
    at += 2 * m * m
    row[at], row[at + 1] = clock[0], math.nan
    if counts[DOUBLING] != 0:
        det, place = doubling(orbit.reduced, orbit.work, m, free), 2 * m * m + 2 * m
        norms = row_norms(orbit, -1.0, orbit.ends, 0.0)
        sign, logarithm = orbit.reduced[place], orbit.reduced[place + 1]
        row[at + 1] = scale_determinant(sign, logarithm, det, norms)
    at += 2
    told = measure(follow, orbit, z, row, at)
    for i in range(counts[DERIVED]):
        row[at + (walls + 1) * count + i] = orbit.fixed[0][POSITIONS + walls + i]
    word = orbit.word[: len(orbit.velocities)]  # without the section
    what, place, wall, amount, when, smallest = verdict(
        word, orbit.sides, orbit.durations, orbit.gaps, orbit.times, orbit.velocities
    )
    at -= 2 + 2 * m * m + FINDINGS
    row[at] = what if told else math.nan
    row[at + 1], row[at + 2], row[at + 3] = place, wall, amount
    row[at + 4], row[at + 5] = when, smallest


def measure_chain(follow: Follow, orbit: ChainVectors, z: Vector, row: Vector, at: int) -> bool:
    """Record gaps and slowest turns, and fill in what decides if the orbit is physical; whether it
    does."""
    counts = orbit.counts
    count, m, walls = len(orbit.kinds), counts[UNKNOWNS], counts[WALLS]
    told, beyond = counts[GAPS] != 0, False
    for k in range(count):
        later, length = duration_of(orbit, z, k)
        orbit.durations[k], orbit.velocities[k] = length, z[m * k + 1]
        slowest = math.nan
        for j in range(walls):
            orbit.gaps[walls * k + j], orbit.times[walls * k + j] = math.nan, math.nan
        if counts[GAPS] != 0 and length > 0.0:
            made = follow(orbit, orbit.word[k], z, m * k, length)
            if made < 0:
                told = False
            else:
                for g in range(counts[COORDINATES]):
                    slow = touches_of(orbit, k, g, made, z[m * k], length, z[later + 1])
                    found = side_of_walls(orbit, k, g, made, length)
                    told, beyond = told and found != UNCLEAR, beyond or found == OUTSIDE
                    if not abs(slow) >= abs(slowest):
                        slowest = slow
        for j in range(walls):
            row[at + walls * k + j] = orbit.gaps[walls * k + j]
        row[at + walls * count + k] = slowest
    return told and (not beyond or fill_in_depths(follow, orbit, z))


def duration_of(orbit: ChainVectors, z: Vector, k: int) -> tuple[int, float]:
    """Return where the unknowns of the impact begin that ends a flight, and how long it lasts."""
    m = orbit.counts[UNKNOWNS]
    if k + 1 < len(orbit.kinds):
        return m * (k + 1), z[m * (k + 1)] - z[m * k]
    return 0, z[0] + orbit.clock[0] - z[m * k]


def evaluate_section(
    flight: Callable[[Vector, Vector], Blocks],
    spans: Callable[[Vector, float], tuple[float, float]],
    setup: Callable[[Vector], Setup],
    orbit: ChainVectors,
    z: Vector,
) -> float:
    """As `evaluate_chain`, for an orbit without impacts: one flight that leads back to the section.

    ``flight(z, values)`` takes the unknowns; ``spans(z, period)`` returns the orbit's period, and
    that of what repeats itself, from the forcing's.
    """
    values = orbit.values
    values[orbit.counts[FREE]] = z[orbit.counts[UNKNOWNS]]
    forced, _, _, positions, derived, _ = setup(values)
    store(orbit.fixed, 0, (forced,) + positions + derived)  # noqa: RUF005
    span, period = spans(z, forced)
    orbit.clock[0], orbit.clock[1], orbit.durations[0] = span, 0.0, span + BEYOND * period
    rows, start, end, free = flight(z, values)
    store(orbit.blocks, 0, rows + start + end + free)
    return largest_residual(orbit.blocks, orbit.units)


def measure_section(follow: Follow, orbit: ChainVectors, z: Vector, row: Vector, at: int) -> bool:
    """As `measure_chain`, for an orbit without impacts; a touch is told within the first period:
    rounding decides which of both is the nearer."""
    counts, walls, length = orbit.counts, orbit.counts[WALLS], orbit.durations[0]
    told, slowest = counts[GAPS] != 0, math.nan
    for j in range(walls):
        orbit.gaps[j], orbit.times[j] = math.nan, math.nan
    if told:
        made = follow(orbit, orbit.word[0], z, 0, length)
        told = made >= 0
        if told:
            for g in range(counts[COORDINATES]):
                slow = touches_of(orbit, 0, g, made, 0.0, length, 0.0)
                if not abs(slow) >= abs(slowest):
                    slowest = slow
    for j in range(walls):
        watched = told and orbit.watched[walls * orbit.word[0] + j] & WATCHED != 0
        if watched and orbit.gaps[j] != orbit.gaps[j]:  # it does not turn: it is at rest
            begin = orbit.forces[len(orbit.forces) - counts[COORDINATES] + orbit.measured[j]]
            orbit.gaps[j] = orbit.sides[j] * (orbit.fixed[0][POSITIONS + j] - begin)
            orbit.times[j] = 0.0
        row[at + j] = orbit.gaps[j]
        if orbit.times[j] >= (1.0 + AGAIN) * orbit.clock[0]:
            orbit.times[j] -= orbit.clock[0]
    row[at + walls] = slowest
    return told


UNCLEAR, WITHIN, OUTSIDE = range(3)
"""Where a flight begins and ends: `OUTSIDE` where it leaves its mode at once."""


def side_of_walls(orbit: ChainVectors, k: int, g: int, made: int, length: float) -> int:
    """Return whether a flight clearly begins and ends within all walls of a gap coordinate beyond
    which it may, or clearly runs through one from its surface."""
    counts, following = orbit.counts, k + 1 if k + 1 < len(orbit.kinds) else 0
    walls, coordinates = counts[WALLS], counts[COORDINATES]
    left, reached, head = orbit.word[k], orbit.word[following], (g, coordinates, made)
    begin = orbit.forces[len(orbit.forces) - coordinates + g]
    _, rate, _ = motion_of_gap(head, 0.0, orbit.steps)
    moved, speed, _ = motion_of_gap(head, length, orbit.steps)
    fastest, found = max(abs(rate), abs(speed)), WITHIN
    for j in range(walls):
        if orbit.measured[j] == g:
            bits, side, position = (
                orbit.watched[walls * left + j],
                orbit.sides[j],
                orbit.fixed[0][POSITIONS + j],
            )
            ends = bits & WATCHED != 0 and orbit.watched[walls * reached + j] & AT_END != 0
            least = CLEARLY * (abs(position) + abs(begin) + abs(moved))
            if bits & AT_START != 0 and not side * (position - begin) > least:
                return UNCLEAR
            if bits & BY_RATE != 0 and not -side * rate > CLEARLY * fastest:
                found = OUTSIDE
                if not side * rate > CLEARLY * fastest:
                    return UNCLEAR
            if ends and not side * (position - begin - moved) > least:
                return UNCLEAR
    return found


def fill_in_depths(follow: Follow, orbit: ChainVectors, z: Vector) -> bool:
    """Put the greatest depths of flights that leave their modes at once in the place of their gaps,
    as `segments.touches` does; whether it is clear which these are."""
    count, m = len(orbit.kinds), orbit.counts[UNKNOWNS]
    for g in range(orbit.counts[COORDINATES]):
        fastest, strongest = 0.0, 0.0
        for again in range(2):  # after the rates at the ends of all flights
            for k in range(count):
                later, length = duration_of(orbit, z, k)
                if not length > CLEARLY * orbit.clock[0]:
                    return False
                made = follow(orbit, orbit.word[k], z, m * k, length)
                head = (g, orbit.counts[COORDINATES], made)
                _, rate, begun = motion_of_gap(head, 0.0, orbit.steps)
                _, speed, ended = motion_of_gap(head, length, orbit.steps)
                if again == 0:
                    fastest = max(fastest, abs(rate), abs(speed))
                    strongest = max(strongest, abs(begun), abs(ended))
                elif not (abs(rate) > CLEARLY * fastest and strongest > 0.0):
                    return False
                else:
                    least = 0.5 * rate * rate / strongest
                    fill_in_depth(orbit, k, g, made, z[m * k], length, z[later + 1], least)
    return True


def fill_in_depth(
    orbit: ChainVectors,
    k: int,
    g: int,
    made: int,
    start: float,
    length: float,
    arriving: float,
    least: float,
) -> int:
    """Do so for a flight and the walls of one gap coordinate; it leaves by `least` at least."""
    walls, coordinates = orbit.counts[WALLS], orbit.counts[COORDINATES]
    left, reached = orbit.word[k], orbit.word[k + 1 if k + 1 < len(orbit.kinds) else 0]
    head, begin = (g, coordinates, made), orbit.forces[len(orbit.forces) - coordinates + g]
    _, rate, _ = motion_of_gap(head, 0.0, orbit.steps)
    moved, speed, _ = motion_of_gap(head, length, orbit.steps)
    side = 0.0
    if orbit.measured[reached] == g:
        speed, side = arriving, orbit.sides[reached]
    breaks = orbit.breaks[2 * MOST * g : 2 * MOST * g + int(orbit.found[g])]
    ends = (length, speed, 0.0, side)
    high, when_high, low, when_low, _ = excursions(
        motion_of_gap, head, orbit.steps, ends, breaks, 0.0, math.inf
    )
    for j in range(walls):
        side, place = orbit.sides[j], walls * k + j
        by_rate = orbit.watched[walls * left + j] & BY_RATE != 0
        if orbit.measured[j] == g and by_rate and side * rate > 0.0:
            distance, gap, dt = orbit.fixed[0][POSITIONS + j] - begin, -least, 0.0
            if side * (distance - moved) < gap:
                gap, dt = side * (distance - moved), length
            if side > 0.0 and distance - high < gap:
                gap, dt = distance - high, when_high
            if side < 0.0 and low - distance < gap:
                gap, dt = low - distance, when_low
            if not orbit.gaps[place] <= gap:
                orbit.gaps[place], orbit.times[place] = gap, start + dt
    return 0


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
        speed = speed_at_end(motion_of_gap(head, length, orbit.steps), length)
    breaks = orbit.breaks[place : place + int(orbit.found[g])]
    ends = (length, speed, leaving, side)
    high, when_high, low, when_low, slow = excursions(
        motion_of_gap, head, orbit.steps, ends, breaks, 0.0, math.inf
    )
    begin = orbit.forces[len(orbit.forces) - coordinates + g]
    others = orbit.measured[left] != g and orbit.measured[reached] != g
    others, moved = others and length > BRIEF * orbit.clock[0], 0.0
    if others:
        moved, _, _ = motion_of_gap(head, length, orbit.steps)
    for j in range(walls):
        if orbit.measured[j] == g and orbit.watched[walls * left + j] & WATCHED != 0:
            position, dt = orbit.fixed[0][POSITIONS + j], when_high
            gap = position - begin
            if orbit.sides[j] > 0.0:
                gap -= high
            else:
                gap, dt = low - gap, when_low
            if others and gap != gap:
                gap, dt = gap_at_rest(orbit.sides[j], position, begin, moved, low, high), 0.0
            orbit.gaps[walls * k + j], orbit.times[walls * k + j] = gap, start + dt
    return slow


def begin_flight(orbit: ChainVectors, wall: int, freedom: int, positions: Vector) -> FollowedFlight:
    """Return what is filled in of a flight that starts from these positions.

    Where each gap coordinate starts is put behind the forces; that of the wall left is its wall's.
    """
    coordinates = orbit.counts[COORDINATES]
    begins = len(orbit.forces) - coordinates
    for g in range(coordinates):
        place = 0.0
        for i in range(freedom):
            place += orbit.weights[freedom * g + i] * positions[i]
        orbit.forces[begins + g] = place
    if orbit.jumps[wall] == 0:
        orbit.forces[begins + orbit.measured[wall]] = orbit.fixed[0][POSITIONS + wall]
    return FollowedFlight(
        orbit.own,
        orbit.steps,
        orbit.breaks,
        orbit.found,
        orbit.signs,
        orbit.zeros,
        orbit.moving,
        orbit.forces,
    )


def follow_law(
    law: Callable[[int, Vector, Vector], tuple[float, float, Vector, Vector]],
    orbit: ChainVectors,
    wall: int,
    z: Vector,
    at: int,
    length: float,
) -> int:
    """Follow a flight by its law, from the impact whose unknowns stand in z; returns the steps."""
    m, coordinates = orbit.counts[UNKNOWNS], orbit.counts[COORDINATES]
    for i in range(m):
        orbit.ends[i] = z[at + i]
    d, waves, numbers, state = law(wall, orbit.ends, orbit.values)
    freedom, given = int(d), len(numbers)
    for i in range(given):
        orbit.law[i] = numbers[i]
    for i in range(len(state)):
        orbit.ends[i] = state[i]
    flown = begin_flight(orbit, wall, freedom, orbit.ends)
    return follow_all(
        freedom, int(waves), orbit.law, orbit.ends, orbit.weights, coordinates, length, flown
    )


def follow_field(
    start: Callable[[int, Vector, Vector], Vector],
    path: Callable[[int, Vector, Vector, float, Vector, int, FollowedFlight], int],
    orbit: ChainVectors,
    wall: int,
    z: Vector,
    at: int,
    length: float,
) -> int:
    """As `follow_law`, for a flight that is integrated: by ``path``, from the positions that
    ``start`` returns; see `segments.taylor`."""
    m, coordinates = orbit.counts[UNKNOWNS], orbit.counts[COORDINATES]
    for i in range(m):
        orbit.ends[i] = z[at + i]
    positions = start(wall, orbit.ends, orbit.values)
    flown = begin_flight(orbit, wall, len(positions), positions)
    return path(wall, orbit.ends, orbit.values, length, orbit.weights, coordinates, flown)
