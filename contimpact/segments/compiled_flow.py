"""Linear flights as scalar code: what `linear_flow` does on arrays, to the last bit.

The functions are in the plain subset of Python that `contimpact.compiling` compiles. Matrices stand
at places of one vector, row by row.
"""

from __future__ import annotations

import math

from ..arrays import Vector
from .linear_flow import MEANS, SLOPES, balance, halve_time


def space_of(d: int, h: int, directions: int) -> int:
    """Return how many numbers of scratch space `flow_compiled` takes."""
    n = 2 * d + 2 * h + 1
    columns = n * (directions + 1)
    given, tables = (d * n + h) * (directions + 1), d * n * (4 + 2 * directions)
    return given + tables + 2 * n + directions + 1 + 8 * n * columns + 7 * d * n


def flow_compiled(d: int, h: int, directions: int, dt: float, space: Vector) -> Vector:
    """As `flow`, with the numbers at the beginning of scratch space; returns a part of it."""
    n = 2 * d + 2 * h + 1
    columns = n * (directions + 1)
    matrix, row = n * columns, d * n
    given = (row + h) * (directions + 1)
    tables = row * (4 + 2 * directions)
    numbers, found = space[:given], space[given : given + tables]
    at = given + tables
    scales, sums, sizes = space[at : at + n], space[at + n : at + 2 * n], space[at + 2 * n :]
    work = space[at + 2 * n + directions + 1 :]
    sizes[0] = 1.0
    for i in range(matrix):
        work[i] = 0.0
    norm = balance(d, h, directions, numbers, scales, sums, sizes, work)
    if not norm * abs(dt) < math.inf:
        for i in range(tables):
            found[i] = math.nan
        return found
    mean, end, rate, pushed = matrix, 2 * matrix, 8 * matrix, 8 * matrix + row
    mean_rates_compiled(d, n, columns, dt, norm, work)
    for i in range(n):
        for j in range(columns):
            work[end + columns * i + j] = dt * work[mean + columns * i + j]
        work[end + columns * i + i] += 1.0
    multiply(work, columns * d, d, columns, end, n, columns, 0, pushed, n)
    for i in range(d):
        for b in range(directions + 1):
            first = 0 if b == 0 else 2 * row * (b + 1)
            for j in range(n):
                unit, to = sizes[b] / scales[j], first + n * i + j
                place = columns * i + n * b + j
                found[to] = work[mean + place] * (scales[i] * unit)
                place += columns * d
                found[to + row] = work[end + place] * (scales[d + i] * unit)
        for j in range(n):
            unit, to = 1.0 / scales[j], 2 * row + n * i + j
            found[to] = work[rate + n * i + j] * (scales[i] * unit)
            found[to + row] = work[pushed + n * i + j] * (scales[d + i] * unit)
    return found


def mean_rates_compiled(d: int, n: int, columns: int, dt: float, norm: float, work: Vector) -> None:
    """As `_mean_rates`: from G at the beginning, Q behind it, and H behind eight matrices."""
    matrix, row = n * columns, d * n
    mean, z, square, cubic, fourth, total, other = (
        matrix,
        2 * matrix,
        3 * matrix,
        4 * matrix,
        5 * matrix,
        6 * matrix,
        7 * matrix,
    )
    rate = 8 * matrix
    t, doublings = halve_time(dt, norm)
    for i in range(matrix):
        work[z + i] = t * work[i]
    multiply(work, z, n, columns, z, n, columns, columns // n - 1, square, columns)
    multiply(work, z, n, columns, square, n, columns, columns // n - 1, cubic, columns)
    multiply(work, square, n, columns, square, n, columns, columns // n - 1, fourth, columns)
    for part in range(3, -1, -1):
        if part < 3:
            multiply(work, total, n, columns, fourth, n, columns, columns // n - 1, other, columns)
        c1, c2, c3 = MEANS[4 * part + 1], MEANS[4 * part + 2], MEANS[4 * part + 3]
        for i in range(n):
            for j in range(columns):
                k = columns * i + j
                x = c1 * work[z + k] + c2 * work[square + k] + c3 * work[cubic + k]
                if i == j:
                    x += MEANS[4 * part]
                work[total + k] = x if part == 3 else work[other + k] + x
    multiply(work, 0, n, columns, total, n, columns, columns // n - 1, mean, columns)
    # rows of G times the powers of z: G itself is the first
    unit, one = work[d], columns * d
    first, second, third, sum_ = rate + 2 * row, rate + 3 * row, rate + 4 * row, rate + 5 * row
    multiply(work, one, d, columns, z, n, columns, 0, first, n)
    multiply(work, one, d, columns, square, n, columns, 0, second, n)
    multiply(work, one, d, columns, cubic, n, columns, 0, third, n)
    for part in range(3, -1, -1):
        if part < 3:
            multiply(work, rate, d, n, fourth, n, columns, 0, sum_, n)
        c0, c1 = SLOPES[4 * part], SLOPES[4 * part + 1]
        c2, c3 = SLOPES[4 * part + 2], SLOPES[4 * part + 3]
        for i in range(d):
            for j in range(n):
                k = n * i + j
                x = c0 * work[one + columns * i + j] + c1 * work[first + k]
                x = x + c2 * work[second + k] + c3 * work[third + k]
                work[rate + k] = x if part == 3 else work[sum_ + k] + x
    for k in range(row):
        work[rate + k] = unit * work[rate + k]
    pushed = first
    for _ in range(doublings):
        for i in range(d):
            for j in range(n):
                work[pushed + n * i + j] = unit * work[mean + columns * (d + i) + j]
                work[second + n * i + j] = work[pushed + n * i + j] + work[rate + n * i + j]
        multiply(work, second, d, n, mean, n, columns, 0, third, n)
        multiply(work, mean, n, columns, mean, n, columns, columns // n - 1, other, columns)
        for k in range(row):
            x = work[pushed + k] + 2.0 * work[rate + k] + t * work[third + k]
            work[rate + k] = 0.25 * x
        for k in range(matrix):
            work[mean + k] = work[mean + k] + 0.5 * (t * work[other + k])
        t = 2.0 * t


def multiply(
    work: Vector,
    one: int,
    rows: int,
    width: int,
    other: int,
    n: int,
    columns: int,
    blocks: int,
    out: int,
    out_width: int,
) -> None:
    """Multiply rows at a place by a matrix at another; sums are made in order.

    `width` and `columns` are those of a row of either, and `blocks` is how many derivatives there
    are besides: as of block-triangular matrices of which the upper rows are kept.
    """
    for i in range(rows):
        row, to = one + width * i, out + out_width * i
        size = n * (blocks + 1)
        factor = work[row]
        for j in range(size):
            work[to + j] = factor * work[other + j]
        for k in range(1, n):
            factor = work[row + k]
            for j in range(size):
                work[to + j] += factor * work[other + columns * k + j]
        for b in range(1, blocks + 1):
            for k in range(n):
                factor = work[row + n * b + k]
                for j in range(n):
                    work[to + n * b + j] += factor * work[other + columns * k + j]
