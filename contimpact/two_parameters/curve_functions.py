"""What a step asks of a curve of FB, PD or G of orbits with one degree of freedom.

Functions in the plain subset of Python that `contimpact.compiling` compiles, which run plainly or
compiled. The unknowns are t_1, v_1, ..., t_N, v_N, lambda, those that the equations add, and mu;
the equations are those of `contimpact.bifurcations.extended_system`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from ..arrays import Table, Vector
from ..segments.layout import Blocks, Setup

PERIODS, FIRST, SECOND, FLIGHT, TOUCH = range(5)
"""Places in `counts`: how many periods, the places of both free parameters among the values, and of
a touch the flight and its kind."""

BLOCK = 14
"""Numbers of a flight: 2 residuals, the blocks A and B row by row, and the derivatives of both
residuals by lambda and mu in turn."""

SMALLEST = -700.0
"""The least logarithm of a determinant."""


class CurveVectors(NamedTuple):
    """A curve's problem as vectors and tables.

    Attributes
    ----------
    kinds : vector of int
        Kinds of the flights.
    counts : vector of int
        See `PERIODS`.
    numbers : vector
        The multiplier mu of a singular cycle.
    values : vector
        Parameter values.
    residual, right : vector
        The residuals at the point last evaluated, and scratch space.
    blocks : table
        Its flights, a row of `BLOCK` numbers each.
    jacobian, factors : table
        The Jacobian there, and scratch space for it and a border.
    """

    kinds: Vector
    counts: Vector
    numbers: Vector
    values: Vector
    residual: Vector
    right: Vector
    blocks: Table
    jacobian: Table
    factors: Table


def evaluate_orbit(
    flight: Callable[..., Blocks], setup: Callable[[Vector], Setup], curve: CurveVectors, z: Vector
) -> tuple[float, float, float]:
    """Evaluate the flights into the first rows of the Jacobian, all else of which becomes zero.

    Returns the orbit's period and its derivatives by both parameters.
    """
    count, last = len(curve.kinds), len(z) - 1
    n, values = 2 * count, curve.values
    values[curve.counts[FIRST]], values[curve.counts[SECOND]] = z[n], z[last]
    period, slopes, _, _, _, _ = setup(values)
    periods = curve.counts[PERIODS]
    span, drift, other = periods * period, periods * slopes[0], periods * slopes[1]
    for i in range(last):
        row = curve.jacobian[i]
        for j in range(last + 1):
            row[j] = 0.0
    for k in range(count):
        i = 2 * k
        j = i + 2 if k + 1 < count else 0
        arrival = z[j] if k + 1 < count else z[0] + span
        r, a, b, free = flight(curve.kinds[k], z[i], z[i + 1], arrival, z[j + 1], values)
        f0, f1, f2, f3 = free
        if k + 1 == count:  # the arrival at t_1 + pT moves with T
            f0, f1 = f0 + drift * b[0], f1 + other * b[0]
            f2, f3 = f2 + drift * b[2], f3 + other * b[2]
        keep_block(curve.blocks[k], r, a, b, f0, f1, f2, f3)
        curve.residual[i], curve.residual[i + 1] = r[0], r[1]
        put_flight(curve.jacobian, i, i, j, n, last, curve.blocks[k])
    return span, drift, other


def keep_block(
    row: Vector, r: Vector, a: Vector, b: Vector, f0: float, f1: float, f2: float, f3: float
) -> None:
    """Fill the row of a flight."""
    row[0], row[1] = r[0], r[1]
    row[2], row[3], row[4], row[5] = a[0], a[1], a[2], a[3]
    row[6], row[7], row[8], row[9] = b[0], b[1], b[2], b[3]
    row[10], row[11], row[12], row[13] = f0, f1, f2, f3


def put_flight(
    table: Table, i: int, start: int, end: int, first: int, second: int, block: Vector
) -> None:
    """Add a flight to two rows of the Jacobian, given the columns of its ends and parameters."""
    for half in range(2):
        row, at = table[i + half], 2 * half
        row[start] += block[2 + at]
        row[start + 1] += block[3 + at]
        row[end] += block[6 + at]
        row[end + 1] += block[7 + at]
        row[first] += block[10 + at]
        row[second] += block[11 + at]


def evaluate_singular(
    flight: Callable[..., Blocks],
    second: Callable[..., Blocks],
    setup: Callable[[Vector], Setup],
    curve: CurveVectors,
    z: Vector,
) -> float:
    """Evaluate F = 0, C(mu) q = 0, (q.q - 1)/2 = 0; returns the largest residual."""
    count, last, mu = len(curve.kinds), len(z) - 1, curve.numbers[0]
    n, own = 2 * count, 2 * count + 1
    span, drift, other = evaluate_orbit(flight, setup, curve, z)
    norm = curve.jacobian[last - 1]
    square = 0.0
    for k in range(count):
        i = 2 * k
        j = i + 2 if k + 1 < count else 0
        factor = 1.0 if k + 1 < count else mu
        arrival = z[j] if k + 1 < count else z[0] + span
        q0, q1 = z[own + i], z[own + i + 1]
        p0, p1 = factor * z[own + j], factor * z[own + j + 1]
        _, a, b, free = second(
            curve.kinds[k], z[i], z[i + 1], arrival, z[j + 1], q0, q1, p0, p1, curve.values
        )
        block = curve.blocks[k]
        for half in range(2):
            row, at = curve.jacobian[n + i + half], 2 * half
            row[i] += a[at]
            row[i + 1] += a[at + 1]
            row[j] += b[at]
            row[j + 1] += b[at + 1]
            row[n] += free[at]
            row[last] += free[at + 1]
            if k + 1 == count:
                row[n] += b[at] * drift
                row[last] += b[at] * other
            row[own + i] += block[2 + at]
            row[own + i + 1] += block[3 + at]
            row[own + j] += factor * block[6 + at]
            row[own + j + 1] += factor * block[7 + at]
            leaving = block[2 + at] * q0 + block[3 + at] * q1
            curve.residual[n + i + half] = leaving + block[6 + at] * p0 + block[7 + at] * p1
        norm[own + i], norm[own + i + 1] = q0, q1
        square += q0 * q0 + q1 * q1
    curve.residual[last - 1] = 0.5 * (square - 1.0)
    return largest(curve.residual)


def evaluate_touching(
    flight: Callable[..., Blocks], setup: Callable[[Vector], Setup], curve: CurveVectors, z: Vector
) -> float:
    """Evaluate F = 0 and a flight that reaches its touch with no velocity; the touch's time is the
    unknown between both parameters."""
    n, last = 2 * len(curve.kinds), len(z) - 1
    evaluate_orbit(flight, setup, curve, z)
    i = 2 * curve.counts[FLIGHT]
    kind = curve.counts[TOUCH]
    r, a, b, free = flight(kind, z[i], z[i + 1], z[n + 1], 0.0, curve.values)
    for half in range(2):
        row, at = curve.jacobian[n + half], 2 * half
        row[i], row[i + 1] = a[at], a[at + 1]
        row[n], row[last] = free[at], free[at + 1]
        row[n + 1] = b[at]
        curve.residual[n + half] = r[half]
    return largest(curve.residual)


def largest(residual: Vector) -> float:
    """Return the largest absolute value; NaN where one is not a number."""
    size, total = 0.0, 0.0
    for i in range(len(residual)):
        size = max(size, abs(residual[i]))
        total += abs(residual[i])
    return size if total - total == 0.0 else math.nan


def factor(matrix: Table, right: Vector) -> tuple[float, float]:
    """Eliminate with partial pivoting, the right side as well.

    Returns sign and logarithm of the determinant; the sign is 0 where it vanishes.
    """
    n = len(right)
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


def bordered_solution(
    curve: CurveVectors, row: Vector, factor_of_residual: float, g: float, out: Vector
) -> tuple[float, float]:
    """Fill `out` with the solution of the Jacobian bordered by a row, its right side a multiple of
    the residual, and g; returns sign and logarithm of the determinant."""
    n = len(out)
    last, right = n - 1, curve.right
    for i in range(last):
        given, copied = curve.jacobian[i], curve.factors[i]
        for j in range(n):
            copied[j] = given[j]
        right[i] = factor_of_residual * curve.residual[i]
    border = curve.factors[last]
    for j in range(n):
        border[j] = row[j]
    right[last] = g
    sign, logarithm = factor(curve.factors, right)
    if sign != 0.0:
        for i in range(last, -1, -1):
            line, value = curve.factors[i], right[i]
            for j in range(i + 1, n):
                value -= line[j] * out[j]
            out[i] = value / line[i]
    return sign, logarithm


def newton_step(curve: CurveVectors, row: Vector, g: float, out: Vector) -> bool:
    """Fill `out` with Newton's step at the point last evaluated; whether there is one."""
    return bordered_solution(curve, row, -1.0, g, out)[0] != 0.0


def tangent_of_curve(
    curve: CurveVectors, z: Vector, row: Vector, scale: Vector, out: Vector
) -> float:
    """Fill `out` with the unit tangent at the point last evaluated that goes on along `row`.

    Returns the determinant of the Jacobian bordered by the tangent, columns by their scales and
    rows by their lengths; NaN where no tangent is defined.
    """
    n = len(z)
    sign, logarithm = bordered_solution(curve, row, 0.0, 1.0, out)
    size = 0.0
    for i in range(n):
        part = out[i] / scale[i]
        size += part * part
    size = math.sqrt(size)
    if not (sign != 0.0 and size > 0.0 and size - size == 0.0):
        return math.nan
    for i in range(n):
        out[i] /= size
        logarithm += math.log(scale[i])
    for i in range(n - 1):
        given, length = curve.jacobian[i], 0.0
        for j in range(n):
            part = given[j] * scale[j]
            length += part * part
        if not length > 0.0:
            return 0.0
        logarithm -= 0.5 * math.log(length)
    # the border is row / scale^2; with the tangent itself in its place it is longer by `size`
    return sign * math.exp(max(logarithm + math.log(size), SMALLEST))


def observe_curve(
    curve: CurveVectors, z: Vector, tangent: Vector, orientation: float, row: Vector, at: int
) -> None:
    """Record flights and residuals in a row."""
    for k in range(len(curve.kinds)):
        block = curve.blocks[k]
        for i in range(BLOCK):
            row[at + i] = block[i]
        at += BLOCK
    for i in range(len(curve.residual)):
        row[at + i] = curve.residual[i]
