"""An event on an arc of a branch, located in one go: guess, solution, and the point it is.

Functions in the plain subset of Python that `segments.compiling` compiles, for the systems of
`scalar_systems`. What they find is what `continuation.events` finds step by step; where they do not
find it, it is looked for there.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

from ..arrays import Table, Vector
from ..continuation.corrector import ALONG, NO_TANGENT, cubic
from ..continuation.problem import angle, norm
from ..orbits.block_cyclic import store
from ..orbits.multipliers import (
    multipliers_by_elimination,
    product_of_multipliers,
    tangent_by_elimination,
)
from ..orbits.physicality import AT_REST
from .scalar_systems import (
    FAILED,
    FIRST,
    FLIGHT,
    MU,
    PERIODS,
    SOLVED,
    SPAN,
    TOUCH,
    Bound,
    Evaluate,
    FlightCode,
    Search,
    SetupCode,
    SystemVectors,
    evaluate_orbit,
    factor,
    solve_system,
)

TASK, REACH, AT, LENGTH, USUAL, TURN, ORDER = range(7)
"""Places in `options`: whether to locate an event on an arc or to solve a system from its guess
(0); how far the solution may be from it; of an arc, the fraction at which the guess is, its length,
the larger orientation at its ends, and the largest angle; the mean order of the harmonics."""

LEFT, RATE, RIGHT, NEXT_RATE, SIZES = range(5)
"""Rows of `ends`."""

FRACTION, ORIENTATION, LARGEST, MULTIPLIERS, UNRESOLVED = 0, 1, 2, 3, 7
"""Places in `found`: how far along the arc the event is, the orientation there, the largest
residual of the orbit, its multipliers as real and imaginary parts, and whether the flight that
touches is too stiff for compiled code."""

CYCLE = 12
"""Numbers of a flight with one free parameter; see `orbits.block_cyclic`."""

VANISHING = 1e-4
"""Part of an orbit's period, and of its largest velocity, below which flights and velocities are
left to the search step by step."""

PASSING = 1e-9
"""A gap of a located touch below minus this is that of another place, where the flight passes."""


class ArcVectors(NamedTuple):
    """An arc and the event on it as vectors and tables."""

    options: Vector
    """See `TASK`."""
    ends: Table
    """Unknowns and tangents at its left end, then at its right end, and the unknowns' sizes."""
    arrivals: Vector
    leaving: Vector
    sides: Vector
    """`arrivals`, `leaving`, `sides`: where each flight ends; the sides of the walls on the flights
    that leave them, and otherwise."""
    zeros: Vector
    """Zeros of the acceleration, where they are the same along the branch."""
    fixed: Table
    cycle: Table
    kept: Table
    reduced: Table
    steps: Table
    border: Vector
    """`fixed` to `border`: scratch space for the walls' positions, for the flights and their
    elimination, for `segments.oscillation`, and for a row."""
    tangent: Vector
    """Filled with the unit tangent at the event."""
    found: Vector
    """Filled; see `FRACTION`."""


Examine: TypeAlias = Callable[[SystemVectors, ArcVectors, Vector], bool]


def locate_on_arc(
    evaluate: Evaluate,
    bound: Bound,
    guess: Examine,
    check: Examine,
    system: SystemVectors,
    search: Search,
    arc: ArcVectors,
) -> int:
    """Locate the event next to a place on an arc; returns as `solve_system`.

    `guess` fills in a guess of the system's own unknowns behind an orbit's, and says whether there
    is one; `check` says whether a solution z is an event.
    """
    z, sizes, options, ends = search.z, search.sizes, arc.options, arc.ends
    orbit = len(arc.tangent)
    for i in range(orbit):
        z[i] = cubic(
            ends[LEFT][i],
            ends[RIGHT][i],
            ends[RATE][i],
            ends[NEXT_RATE][i],
            options[LENGTH],
            options[AT],
        )
    z[len(z) - 1] = 0.0
    if not guess(system, arc, z):
        return FAILED
    fastest, count = 0.0, len(system.kinds)
    for k in range(count):
        fastest = max(fastest, abs(z[2 * k + 1]))
    wave = abs(system.numbers[SPAN]) / system.counts[PERIODS] / options[ORDER]
    for k in range(count):
        sizes[2 * k] = wave * math.sqrt(count)
        sizes[2 * k + 1] = fastest * math.sqrt(count)
    for i in range(len(z)):
        search.begin[i] = z[i]
    status = solve_system(evaluate, bound, system, search, options[REACH])
    if status != SOLVED:
        return status
    if not (lies_on_arc(search.best, arc) and check(system, arc, search.best)):
        return FAILED
    describe_point(system, search.best, arc)
    return SOLVED


def flights_last(system: SystemVectors, z: Vector) -> bool:
    """Whether no flight of an orbit nearly vanishes, nor the velocity at its start: there matrices
    are singular without a multiplier, and multipliers are rounding."""
    count, span, fastest, slowest = len(system.kinds), abs(system.numbers[SPAN]), 0.0, math.inf
    for k in range(count):
        end = z[2 * k + 2] if k + 1 < count else z[0] + system.numbers[SPAN]
        if not end - z[2 * k] > VANISHING * span:
            return False
        fastest, slowest = max(fastest, abs(z[2 * k + 1])), min(slowest, abs(z[2 * k + 1]))
    return slowest > VANISHING * fastest


def lies_on_arc(z: Vector, arc: ArcVectors) -> bool:
    """Whether an orbit lies on an arc, as `continuation.corrector.Arc.holds` has it; fills in how
    far along it."""
    left, right, scale = arc.ends[LEFT], arc.ends[RIGHT], arc.ends[SIZES]
    along, chord, off = 0.0, 0.0, 0.0
    for i in range(len(arc.tangent)):
        part = (right[i] - left[i]) / scale[i]
        along += (z[i] - left[i]) / scale[i] * part
        chord += part * part
    fraction = along / chord
    for i in range(len(arc.tangent)):
        part = (z[i] - left[i] - fraction * (right[i] - left[i])) / scale[i]
        off += part * part
    arc.found[FRACTION] = fraction
    near = math.sqrt(off) <= 0.5 * math.sqrt(chord) + ALONG
    return near and -ALONG <= fraction <= 1.0 + ALONG


def describe_point(system: SystemVectors, z: Vector, arc: ArcVectors) -> None:
    """Fill in the point at a solution, as `continuation.corrector.Arc.event_point` has it."""
    count, span, scale = len(system.kinds), system.numbers[SPAN], arc.ends[SIZES]
    tangent, border, found, worst = arc.tangent, arc.border, arc.found, 0.0
    for k in range(count):
        block, row = system.blocks[k], arc.cycle[k]
        for i in range(11):
            row[i] = block[i]
        row[11] = block[12]
        worst = max(worst, abs(block[0]), abs(block[1]))
    for i in range(len(tangent)):
        border[i] = arc.ends[RATE][i] / scale[i] / scale[i]
    orientation = tangent_by_elimination(
        arc.cycle, arc.arrivals, arc.kept, arc.reduced, z, span, border, scale, tangent
    )
    s = found[FRACTION]
    for i in range(len(tangent)):
        border[i] = (1.0 - s) * arc.ends[RATE][i] + s * arc.ends[NEXT_RATE][i]
    size = norm(border, scale)
    for i in range(len(tangent)):
        border[i] /= size
    known = abs(orientation) >= NO_TANGENT * arc.options[USUAL]
    if not (known and angle(tangent, border, scale) <= arc.options[TURN]):
        orientation = 0.0
        for i in range(len(tangent)):
            tangent[i] = border[i]
    found[ORIENTATION], found[LARGEST] = orientation, worst
    product = product_of_multipliers(arc.cycle, arc.arrivals, z, span)
    one, other, two, last = multipliers_by_elimination(arc.reduced[0], product)
    at = MULTIPLIERS
    found[at], found[at + 1], found[at + 2], found[at + 3] = one, other, two, last


def guess_orbit(flight: FlightCode, setup: SetupCode, system: SystemVectors, z: Vector) -> bool:
    """Evaluate the orbit alone, where a system has no unknowns of its own."""
    evaluate_orbit(flight, setup, system, z)
    return True


# F = 0, C(mu) q = 0: the eigenvector is guessed from the orbit's own matrix.


def guess_eigenvector(
    flight: FlightCode, setup: SetupCode, system: SystemVectors, z: Vector
) -> bool:
    """Fill in the null vector of C(mu) but for its last pivot, as long as one."""
    evaluate_orbit(flight, setup, system, z)
    count, matrix = len(system.kinds), system.factors
    n = 2 * count
    for i in range(n):
        system.right[i] = 0.0
        for j in range(n):
            matrix[i][j] = 0.0
    for k in range(count):
        i, block, coupling = 2 * k, system.blocks[k], 1.0 if k + 1 < count else system.numbers[MU]
        j = i + 2 if k + 1 < count else 0
        for half in range(2):
            row, at = matrix[i + half], 2 * half
            row[i] += block[2 + at]
            row[i + 1] += block[3 + at]
            row[j] += coupling * block[6 + at]
            row[j + 1] += coupling * block[7 + at]
    factor(matrix, system.right, n)
    own, square = n + 1, 1.0
    z[own + n - 1] = 1.0
    for i in range(n - 2, -1, -1):
        value = 0.0
        for j in range(i + 1, n):
            value -= matrix[i][j] * z[own + j]
        if matrix[i][i] == 0.0:
            return False
        z[own + i] = value / matrix[i][i]
        square += z[own + i] * z[own + i]
    size = math.sqrt(square)
    for i in range(n):
        z[own + i] /= size
    return size - size == 0.0


# F = 0 and a flight to a touch: its time is guessed where the flight turns.


def guess_touch(
    flight: FlightCode,
    setup: SetupCode,
    turn: Callable[..., Any],
    system: SystemVectors,
    arc: ArcVectors,
    z: Vector,
) -> bool:
    """Fill in when the flight turns towards the wall; whether it does."""
    evaluate_orbit(flight, setup, system, z)
    time, _ = turn(system, arc, z)
    z[2 * len(system.kinds) + 1] = time
    return time - time == 0.0


def check_touch(
    turn: Callable[..., Any], system: SystemVectors, arc: ArcVectors, z: Vector
) -> bool:
    """Whether a solution touches inside its flight, which does not pass the wall elsewhere."""
    count, k = len(system.kinds), system.counts[FLIGHT]
    end = z[2 * k + 2] if k + 1 < count else z[0] + system.numbers[SPAN]
    system.values[system.counts[FIRST]] = z[2 * count]
    _, gap = turn(system, arc, z)
    return z[2 * k] < z[2 * count + 1] < end and not gap <= -PASSING


def turn_of_flight(
    setup: SetupCode,
    breaks: Callable[[Vector, float, Vector], Vector],
    excursion: Callable[..., Vector],
    system: SystemVectors,
    arc: ArcVectors,
    z: Vector,
) -> tuple[float, float]:
    """Return time and gap where the system's flight is nearest to its wall at an orbit; not numbers
    where it turns nowhere. As `orbits.problem.Linearisation.gaps_of` has it."""
    count, k, walls = len(system.kinds), system.counts[FLIGHT], len(arc.sides)
    left, wall = system.counts[TOUCH] // walls, system.counts[TOUCH] % walls
    last = k + 1 == count
    i, j, reached = 2 * k, 0 if last else 2 * k + 2, system.kinds[0 if last else k + 1] // walls
    fastest = 0.0
    for place in range(count):
        fastest = max(fastest, abs(z[2 * place + 1]))
    start, speed, arriving = z[i], z[i + 1], z[j + 1]
    if abs(speed) < AT_REST * fastest:
        speed = 0.0
    if abs(arriving) < AT_REST * fastest:
        arriving = 0.0
    length = (z[0] + system.numbers[SPAN] if last else z[j]) - start
    if not length > 0.0:
        return math.nan, math.nan
    period, _, _, positions, _, _ = setup(system.values)
    store(arc.fixed, 0, positions)
    zeros = breaks(system.values, period, arc.zeros)
    head, phase = (left, start, speed), start % period
    leaving, reaching = arc.leaving[left], arc.sides[reached]
    high, when_high, low, when_low, slow = excursion(
        head, system.values, length, arriving, leaving, reaching, zeros, phase, period, arc.steps
    )
    if slow == math.inf:
        arc.found[UNRESOLVED] = 1.0
        return math.nan, math.nan
    gap = arc.fixed[0][wall] - arc.fixed[0][left]
    if arc.sides[wall] > 0.0:
        return start + when_high, gap - high
    return start + when_low, low - gap
