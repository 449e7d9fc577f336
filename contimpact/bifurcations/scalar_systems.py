"""The equations of FB, PD and G in scalar code, which runs plainly and compiled.

They are those of `extended_system`, of orbits with one degree of freedom, in two free parameters: a
curve. Where one is free, an event is where a second one, on which nothing depends, is zero. The
unknowns are t_1, v_1, ..., t_N, v_N, lambda, those that the equations add, and mu.

Functions of vectors are in the plain subset of Python that `segments.compiling` compiles.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..arrays import Table, Vector, norm
from ..continuation.corrector import ALONG, NO_TANGENT, angle, cubic
from ..orbits.block_cyclic import store
from ..orbits.status import (
    AT_REST,
    multipliers_by_elimination,
    product_of_multipliers,
    tangent_by_elimination,
)
from ..segments.bounded import add_pairs, multiply_pairs
from ..segments.kernel import Blocks, Setup

EPSILON = float(np.finfo(float).eps)
NEWTON_ITERATIONS = 12
CONVERGED = 1e-10
FAR = 2.0
"""How far from its guess Newton's iteration may go, in waves of the forcing and largest velocities,
and how much longer the period may get: an event is much nearer, and integrated flights cost the
more the longer they are."""
FIRST_ORDER = 2.0
"""How much larger an error may be than what the linear equations say."""

LONGEST = 8
"""Impacts of a word up to which elimination without regard to the matrix's structure pays."""


class ScalarForm(NamedTuple):
    """What tells a system from others of its variant; see `event_solver.Solver`."""

    variant: str
    """"singular" for F = 0 and C(mu) q = 0, "touching" for F = 0 and a flight to a touch, "reached"
    for F = 0 and a velocity or duration of zero."""
    flight: int = 0
    touch: int = 0
    """`flight`, `touch`: of a touch, the flight and its kind; of what vanishes, the flight, and
    whether it is its first velocity (0) or its duration."""
    mu: float = 0.0


PERIODS, FIRST, SECOND, FLIGHT, TOUCH, VARIANT = range(6)
"""Places in `counts`: how many periods, the places of both free parameters among the values, what
`ScalarForm` says, and the number of the variant in `event_solver.FUNCTIONS`."""

MU, SPAN = range(2)
"""Places in `numbers`: the multiplier of a singular cycle, and the orbit's period where the system
was evaluated."""

BLOCK = 14
"""Numbers of a flight: 2 residuals, the blocks A and B row by row, and the derivatives of both
residuals by lambda and mu in turn."""


class SystemVectors(NamedTuple):
    """The problem as vectors and tables."""

    kinds: Vector
    """Kinds of the flights."""
    counts: Vector
    """See `PERIODS`."""
    numbers: Vector
    """See `MU`."""
    values: Vector
    """Parameter values."""
    sizes: Vector
    """Those of the orbit's unknowns at least."""
    residual: Vector
    units: Vector
    right: Vector
    """`residual`, `units`, `right`: the residuals at the point last evaluated, their sizes, and
    scratch space."""
    blocks: Table
    """Its flights, a row of `BLOCK` numbers each."""
    jacobian: Table
    factors: Table
    """`jacobian`, `factors`: the Jacobian there, and scratch space for it and a border."""


FlightCode: TypeAlias = Callable[..., Blocks]
SetupCode: TypeAlias = Callable[[Vector], Setup]
PeriodCode: TypeAlias = Callable[[Vector], tuple[float, float]]
"""Compiled code of a model: a flight, in doubles or in pairs with bounds; what is fixed with the
parameters; the forcing period and its bound."""

Evaluate: TypeAlias = Callable[[SystemVectors, Vector], float]
Bound: TypeAlias = Callable[[SystemVectors, Vector, Vector], None]
"""Fill in a system at a point and return its largest residual; fill in its residuals' bounds."""


def evaluate_orbit(
    flight: FlightCode, setup: SetupCode, system: SystemVectors, z: Vector
) -> tuple[float, float, float]:
    """Evaluate the flights into the first rows of the Jacobian, all else of which becomes zero.

    Returns the orbit's period and its derivatives by both parameters.
    """
    count, last = len(system.kinds), len(z) - 1
    n, values = 2 * count, system.values
    values[system.counts[FIRST]], values[system.counts[SECOND]] = z[n], z[last]
    period, slopes, _, _, _, _ = setup(values)
    periods = system.counts[PERIODS]
    span, drift, other = periods * period, periods * slopes[0], periods * slopes[1]
    system.numbers[SPAN] = span
    for i in range(last):
        row = system.jacobian[i]
        for j in range(last + 1):
            row[j] = 0.0
    for k in range(count):
        i = 2 * k
        j = i + 2 if k + 1 < count else 0
        arrival = z[j] if k + 1 < count else z[0] + span
        r, a, b, free = flight(system.kinds[k], z[i], z[i + 1], arrival, z[j + 1], values)
        f0, f1, f2, f3 = free
        if k + 1 == count:  # the arrival at t_1 + pT moves with T
            f0, f1 = f0 + drift * b[0], f1 + other * b[0]
            f2, f3 = f2 + drift * b[2], f3 + other * b[2]
        block = system.blocks[k]
        block[0], block[1] = r[0], r[1]
        block[2], block[3], block[4], block[5] = a[0], a[1], a[2], a[3]
        block[6], block[7], block[8], block[9] = b[0], b[1], b[2], b[3]
        block[10], block[11], block[12], block[13] = f0, f1, f2, f3
        system.residual[i], system.residual[i + 1] = r[0], r[1]
        put_flight(system.jacobian, i, i, j, n, last, a, b, (f0, f1, f2, f3))
    return span, drift, other


def put_flight(
    table: Table,
    i: int,
    start: int,
    end: int,
    first: int,
    second: int,
    a: Vector,
    b: Vector,
    free: Vector,
) -> None:
    """Add a flight to two rows of the Jacobian, given the columns of its ends and parameters."""
    for half in range(2):
        row, at = table[i + half], 2 * half
        row[start] += a[at]
        row[start + 1] += a[at + 1]
        row[end] += b[at]
        row[end + 1] += b[at + 1]
        row[first] += free[at]
        row[second] += free[at + 1]


def evaluate_singular(
    flight: FlightCode, second: FlightCode, setup: SetupCode, system: SystemVectors, z: Vector
) -> float:
    """Evaluate F = 0, C(mu) q = 0, (q.q - 1)/2 = 0; returns the largest residual."""
    count, last, mu = len(system.kinds), len(z) - 1, system.numbers[MU]
    n, own = 2 * count, 2 * count + 1
    span, drift, other = evaluate_orbit(flight, setup, system, z)
    norm = system.jacobian[last - 1]
    square = 0.0
    for k in range(count):
        i = 2 * k
        j = i + 2 if k + 1 < count else 0
        factor = 1.0 if k + 1 < count else mu
        arrival = z[j] if k + 1 < count else z[0] + span
        q0, q1 = z[own + i], z[own + i + 1]
        p0, p1 = factor * z[own + j], factor * z[own + j + 1]
        _, a, b, free = second(
            system.kinds[k], z[i], z[i + 1], arrival, z[j + 1], q0, q1, p0, p1, system.values
        )
        block = system.blocks[k]
        put_flight(system.jacobian, n + i, i, j, n, last, a, b, free)
        for half in range(2):
            row, at = system.jacobian[n + i + half], 2 * half
            if k + 1 == count:
                row[n] += b[at] * drift
                row[last] += b[at] * other
            row[own + i] += block[2 + at]
            row[own + i + 1] += block[3 + at]
            row[own + j] += factor * block[6 + at]
            row[own + j + 1] += factor * block[7 + at]
            leaving = block[2 + at] * q0 + block[3 + at] * q1
            system.residual[n + i + half] = leaving + block[6 + at] * p0 + block[7 + at] * p1
        norm[own + i], norm[own + i + 1] = q0, q1
        square += q0 * q0 + q1 * q1
    system.residual[last - 1] = 0.5 * (square - 1.0)
    return largest(system.residual)


def evaluate_touching(
    flight: FlightCode, setup: SetupCode, system: SystemVectors, z: Vector
) -> float:
    """Evaluate F = 0 and a flight that reaches its touch with no velocity; the touch's time is the
    unknown between both parameters."""
    n, last = 2 * len(system.kinds), len(z) - 1
    evaluate_orbit(flight, setup, system, z)
    i = 2 * system.counts[FLIGHT]
    kind = system.counts[TOUCH]
    r, a, b, free = flight(kind, z[i], z[i + 1], z[n + 1], 0.0, system.values)
    for half in range(2):
        row, at = system.jacobian[n + half], 2 * half
        row[i], row[i + 1] = a[at], a[at + 1]
        row[n], row[last] = free[at], free[at + 1]
        row[n + 1] = b[at]
        system.residual[n + half] = r[half]
    return largest(system.residual)


def evaluate_reached(
    flight: FlightCode, setup: SetupCode, system: SystemVectors, z: Vector
) -> float:
    """Evaluate F = 0 and a velocity, or the duration of a flight, which is to vanish."""
    n, last, i = 2 * len(system.kinds), len(z) - 1, 2 * system.counts[FLIGHT]
    span, drift, other = evaluate_orbit(flight, setup, system, z)
    row = system.jacobian[n]
    if system.counts[TOUCH] == 0:
        row[i + 1], system.residual[n] = 1.0, z[i + 1]
    elif i + 2 < n:
        row[i], row[i + 2], system.residual[n] = -1.0, 1.0, z[i + 2] - z[i]
    else:
        row[0] += 1.0
        row[i] -= 1.0
        row[n], row[last], system.residual[n] = drift, other, z[0] + span - z[i]
    return largest(system.residual)


def largest(residual: Vector) -> float:
    """Return the largest absolute value; NaN where one is not a number."""
    size, total = 0.0, 0.0
    for i in range(len(residual)):
        size = max(size, abs(residual[i]))
        total += abs(residual[i])
    return size if total - total == 0.0 else math.nan


def factor(matrix: Table, right: Vector, n: int) -> tuple[float, float]:
    """Eliminate n rows with partial pivoting, the right side as well.

    Returns sign and logarithm of the determinant; the sign is 0 where it vanishes.
    """
    sign, logarithm = 1.0, 0.0
    for c in range(n):
        pivot, size = c, abs(matrix[c][c])
        for r in range(c + 1, n):
            if abs(matrix[r][c]) > size:
                pivot, size = r, abs(matrix[r][c])
        if not size > 0.0:
            return 0.0, 0.0
        head, other = matrix[c], matrix[pivot]
        if pivot != c:
            for j in range(c, n):
                head[j], other[j] = other[j], head[j]
            right[c], right[pivot] = right[pivot], right[c]
            sign = -sign
        if head[c] < 0.0:
            sign = -sign
        logarithm += math.log(size)
        for r in range(c + 1, n):
            row = matrix[r]
            s = row[c] / head[c]
            if s != 0.0:
                for j in range(c + 1, n):
                    row[j] -= s * head[j]
                right[r] -= s * right[c]
    return sign, logarithm


def solve_bordered(
    system: SystemVectors, row: Vector, factor_of_residual: float, g: float, out: Vector
) -> tuple[float, float]:
    """Fill `out` with the solution of the Jacobian bordered by a row, its right side a multiple of
    the residual, and g; returns sign and logarithm of the determinant."""
    n = len(out)
    last, right = n - 1, system.right
    for i in range(last):
        given, copied = system.jacobian[i], system.factors[i]
        for j in range(n):
            copied[j] = given[j]
        right[i] = factor_of_residual * system.residual[i]
    border = system.factors[last]
    for j in range(n):
        border[j] = row[j]
    right[last] = g
    return eliminate_all(system, out)


def solve_transposed(system: SystemVectors, row: Vector, place: int, out: Vector) -> float:
    """Fill `out` with a row of the inverse of the Jacobian bordered by `row`; returns the sign of
    the determinant."""
    n = len(out)
    for i in range(n):
        for j in range(n - 1):
            system.factors[i][j] = system.jacobian[j][i]
        system.factors[i][n - 1] = row[i]
        system.right[i] = 1.0 if i == place else 0.0
    return eliminate_all(system, out)[0]


def eliminate_all(system: SystemVectors, out: Vector) -> tuple[float, float]:
    """Solve with what is in the scratch space; returns sign and logarithm of the determinant."""
    right = system.right
    sign, logarithm = factor(system.factors, right, len(out))
    if sign != 0.0:
        for i in range(len(out) - 1, -1, -1):
            line, value = system.factors[i], right[i]
            for j in range(i + 1, len(out)):
                value -= line[j] * out[j]
            out[i] = value / line[i]
    return sign, logarithm


def newton_step(system: SystemVectors, row: Vector, g: float, out: Vector) -> bool:
    """Fill `out` with Newton's step at the point last evaluated; whether there is one."""
    return solve_bordered(system, row, -1.0, g, out)[0] != 0.0


# Bounds of the residuals' rounding errors.


def bound_orbit(
    bounded_flight: FlightCode,
    bounded_period: PeriodCode,
    system: SystemVectors,
    z: Vector,
    off: Vector,
    singular: bool,
) -> None:
    """Fill in the bounds of the flights' residuals, and those of C(mu) q if that is asked for."""
    count = len(system.kinds)
    n, own = 2 * count, 2 * count + 1
    periods = (float(system.counts[PERIODS]), 0.0)
    closing = add_pairs((z[0], 0.0), multiply_pairs(bounded_period(system.values), periods))
    for k in range(count):
        i = 2 * k
        j = i + 2 if k + 1 < count else 0
        arrival = (z[j], 0.0) if k + 1 < count else closing
        start, speed, arriving = (z[i], 0.0), (z[i + 1], 0.0), (z[j + 1], 0.0)
        r, a, b, _ = bounded_flight(system.kinds[k], start, speed, arrival, arriving, system.values)
        off[i], off[i + 1] = r[0][1], r[1][1]
        if singular:
            q0, q1 = abs(z[own + i]), abs(z[own + i + 1])
            p0, p1 = abs(z[own + j]), abs(z[own + j + 1])
            block = system.blocks[k]
            for half in range(2):
                at = 2 * half
                size = abs(block[2 + at]) * q0 + abs(block[3 + at]) * q1
                size += abs(block[6 + at]) * p0 + abs(block[7 + at]) * p1
                terms = 0.0
                for place in (2 + at, 3 + at, 6 + at, 7 + at):
                    terms += 1.0 if block[place] != 0.0 else 0.0
                spread = a[at][1] * q0 + a[at + 1][1] * q1 + b[at][1] * p0 + b[at + 1][1] * p1
                off[n + i + half] = spread + EPSILON * terms * size


def bound_singular(
    flight: FlightCode, period: PeriodCode, system: SystemVectors, z: Vector, off: Vector
) -> None:
    """Fill in the bounds of the residuals of `evaluate_singular`, at the point last evaluated."""
    bound_orbit(flight, period, system, z, off, True)
    n, square = 2 * len(system.kinds), 0.0
    for i in range(n):
        square += z[n + 1 + i] * z[n + 1 + i]
    off[2 * n] = EPSILON * n * square


def bound_touching(
    flight: FlightCode, period: PeriodCode, system: SystemVectors, z: Vector, off: Vector
) -> None:
    """The same of `evaluate_touching`."""
    bound_orbit(flight, period, system, z, off, False)
    n, i = 2 * len(system.kinds), 2 * system.counts[FLIGHT]
    start, speed, touch = (z[i], 0.0), (z[i + 1], 0.0), (z[n + 1], 0.0)
    kind = system.counts[TOUCH]
    r, _, _, _ = flight(kind, start, speed, touch, (0.0, 0.0), system.values)
    off[n], off[n + 1] = r[0][1], r[1][1]


def bound_reached(
    flight: FlightCode, period: PeriodCode, system: SystemVectors, z: Vector, off: Vector
) -> None:
    """The same of `evaluate_reached`."""
    bound_orbit(flight, period, system, z, off, False)
    n, size = 2 * len(system.kinds), 0.0
    for i in range(n + 1):
        size = max(size, abs(z[i]))
    periods = system.counts[PERIODS] if 2 * system.counts[FLIGHT] + 2 == n else 0
    duration = periods * period(system.values)[1] + 2.0 * EPSILON * size
    off[n] = duration if system.counts[TOUCH] != 0 else 0.0


# The solution of a system with one free parameter.

SIZE, ERROR, EVALUATED = range(3)
"""Places in `told`: the largest residual, a bound of the parameter's error, and how often the
system was evaluated."""

SETTLED = 4.0
"""Residuals of so many units in the last place of the largest unknown are rounding. The step from
there, which ill-conditioned events need, is the last, and is within what the error allows for."""


class Search(NamedTuple):
    """Scratch space and results of `solve_system`."""

    z: Vector
    """The guess, then the last iterate."""
    begin: Vector
    best: Vector
    """`begin`, `best`: the guess, and the solution."""
    row: Vector
    """The border: the parameter on which nothing depends."""
    step: Vector
    off: Vector
    told: Vector
    """`step`, `off`, `told`: Newton's step, bounds of the residuals' errors, and see `SIZE`."""


def size_equations(system: SystemVectors, z: Vector) -> None:
    """Fill in how far unknowns that move by their sizes move the equations."""
    sizes, units = system.sizes, system.units
    orbit, far = len(sizes), 0.0
    if system.counts[VARIANT] == 0:  # a direction of the orbit's unknowns, as long as it is
        for j in range(orbit):
            far = max(far, abs(z[orbit + 1 + j]) / sizes[j])
    for i in range(len(system.residual)):
        row, largest = system.jacobian[i], 0.0
        for j in range(len(z)):
            size = sizes[j] if j < orbit else abs(z[j])
            if orbit < j <= 2 * orbit and far > 0.0:
                size = far * sizes[j - orbit - 1]
            if j == orbit + 1 and system.counts[VARIANT] == 1:  # the time of a touch
                size = sizes[0]
            largest = max(largest, abs(row[j]) * size)
        units[i] = largest if largest > 0.0 else 1.0
    if system.counts[VARIANT] == 1:  # where the flight to a touch vanishes, so do its blocks
        n = 2 * len(system.kinds)
        for half in range(2):
            least = math.inf
            for k in range(len(system.kinds)):
                least = min(least, units[2 * k + half])
            units[n + half] = max(units[n + half], least)


def relative_size(system: SystemVectors) -> float:
    """Return the largest residual beside its size."""
    size = 0.0
    for i in range(len(system.residual)):
        size = max(size, abs(system.residual[i]) / system.units[i])
    return size


ON_CURVE = 0.125
"""Part of a residual's size that it is measured by on a curve: where unknowns are about one, no
residual is measured by more than that."""


def size_on_curve(system: SystemVectors, z: Vector, size: float) -> float:
    """Return the largest residual beside this part of its size; NaN where the largest is not a
    number."""
    if size - size != 0.0:
        return size
    size_equations(system, z)
    return relative_size(system) / ON_CURVE


SOLVED, FAILED, AWAY = range(3)
"""What `solve_system` returns: a solution was found, there is none, or the iteration has left the
surroundings of its guess as far as these sizes tell."""


def solve_system(
    evaluate: Evaluate, bound: Bound, system: SystemVectors, search: Search, far: float
) -> int:
    """Solve a system to rounding by Newton's iteration, as `extended_system.solve` does."""
    z, best, told, step = search.z, search.best, search.told, search.step
    n, orbit = len(z), 2 * len(system.kinds)
    least, span, found = math.inf, 0.0, False
    told[ERROR], told[EVALUATED] = math.nan, 0.0
    at_best = False
    for _ in range(NEWTON_ITERATIONS):
        size, longest = evaluate(system, z), abs(system.numbers[SPAN])
        told[EVALUATED] += 1.0
        at_best = False
        if not size < math.inf:
            break
        if not found:
            size_equations(system, z)
        size = relative_size(system)
        if found and size >= 0.5 * least and least < CONVERGED:
            break
        if not found:
            span = longest
        elif not longest < FAR * span:
            return AWAY
        least, found, at_best, largest_unknown = size, True, True, 0.0
        for i in range(n):
            best[i] = z[i]
            if i < orbit and system.sizes[i] > 0.0:  # all velocities may vanish
                largest_unknown = max(largest_unknown, abs(z[i]) / system.sizes[i])
        if not newton_step(system, search.row, 0.0, step):
            return FAILED
        if size <= SETTLED * EPSILON * largest_unknown:
            for i in range(n):
                best[i] += step[i]
            break
        away = 0.0
        for i in range(n):
            z[i] += step[i]
            if i < orbit:
                part = (z[i] - search.begin[i]) / system.sizes[i]
                away += part * part
        if not away < far * far:
            return AWAY
    if not (found and least < CONVERGED):
        return FAILED
    if not at_best:
        evaluate(system, best)
        told[EVALUATED] += 1.0
    told[SIZE] = largest(system.residual)
    bound(system, best, search.off)
    if solve_transposed(system, search.row, orbit, step) != 0.0:
        error = 0.0
        for i in range(n - 1):
            off = FIRST_ORDER * abs(system.residual[i]) + search.off[i]
            error += abs(step[i]) * off
        told[ERROR] = error
    return SOLVED


# An event on an arc of a branch, located in one go: guess, solution, and the point it is.
#
# Functions in the plain subset of Python that `segments.compiling` compiles, for the systems of
# `scalar_systems`. What they find is what `continuation.events` finds step by step; where they do
# not find it, it is looked for there.

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
    z, sizes, options, ends = search.z, system.sizes, arc.options, arc.ends
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
    ends = (length, arriving, arc.leaving[left], arc.sides[reached])
    high, when_high, low, when_low, slow = excursion(
        head, system.values, ends, zeros, phase, period, arc.steps
    )
    if slow == math.inf:
        arc.found[UNRESOLVED] = 1.0
        return math.nan, math.nan
    gap = arc.fixed[0][wall] - arc.fixed[0][left]
    if arc.sides[wall] > 0.0:
        return start + when_high, gap - high
    return start + when_low, low - gap
