r"""Linear flights of floats, plainly on NumPy's arrays or as scalar code that is compiled.

What is computed is told in `linear_flow`. Both forms, `flow` and `flow_compiled`, round alike: no
matrix product is left to a library, which would sum in an order of its own. Positions change with
the velocities alone, so that the rows of S and H that are wanted need no products with G:

.. math:: S_i = g_i\,Q_{d+i}, \qquad H_i = g_i\,(G\varphi')_{d+i}, \qquad
          H(2t) = \tfrac14\left(S + 2H + t\,(S + H)\,Q\right) ,

with i = 1, ..., d, and g_i = 1 in the units of the coordinates. All of these commute.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..arrays import Array, Vector

NORM = 0.5
"""Of z, below which the series are summed."""
TERMS = 16
"""0.5^16/17! is 4e-20."""

MEANS = tuple(1.0 / math.factorial(k + 1) for k in range(TERMS))
"""Coefficients of phi."""
SLOPES = tuple((k + 1.0) / math.factorial(k + 2) for k in range(TERMS))
"""Coefficients of phi'."""

BEYOND = "a linear flight with numbers beyond the range of floats"


def flow(d: int, h: int, directions: int, dt: float, *numbers: float) -> list[float]:
    """Return the rows of a linear flight that the equations of orbits are made of.

    Parameters
    ----------
    d, h, directions : int
        As in `linear_flow.Shape`.
    dt : float
        Duration.
    *numbers : float
        The accelerations as d rows of G; the angular frequencies of the harmonics; then, for each
        direction, the derivatives of all these.

    Returns
    -------
    list of float
        Tables of d rows of `Shape.size` numbers: mean velocities (the rows of Q of the positions),
        end velocities (those of 1 + tQ of the velocities), the derivatives of both by the
        duration, and those of both by each direction.
    """
    n = 2 * d + 2 * h + 1
    scales, sums, sizes = [1.0] * n, [0.0] * n, [1.0] * (directions + 1)
    top = [0.0] * (n * n * (directions + 1))
    norm = balance(d, h, directions, numbers, scales, sums, sizes, top)
    if not norm * abs(dt) < math.inf:
        raise OverflowError(BEYOND)
    generator, units = np.array(top).reshape(n, -1), np.array(scales)
    mean, rate = _mean_rates(generator, d, dt, norm)
    end = dt * mean
    end.ravel()[:: end.shape[1] + 1] += 1.0
    pushed = _product(generator[d : 2 * d, :n], end[:, :n])
    back = np.concatenate([size / units for size in sizes])
    of_means, of_ends = units[:d, None] * back, units[d : 2 * d, None] * back
    means, ends = mean[:d] * of_means, end[d : 2 * d] * of_ends
    found = [means[:, :n], ends[:, :n], rate * of_means[:, :n], pushed * of_ends[:, :n]]
    for i in range(1, directions + 1):
        found += [means[:, n * i : n * i + n], ends[:, n * i : n * i + n]]
    return np.concatenate(found).ravel().tolist()


def balance(
    d: int,
    h: int,
    directions: int,
    numbers: Sequence[float] | Vector,
    scales: Vector,
    sums: Vector,
    sizes: Vector,
    top: Vector,
) -> float:
    """Fill in G and its derivatives in units of their own; returns the norm of all these together.

    In the plain subset of Python that `contimpact.compiling` compiles, as the rest.

    Parameters
    ----------
    d, h, directions, numbers
        As of `flow`.
    scales : vector
        Filled with the units of X: those of velocities and forces by the frequencies there are.
    sums : vector
        Filled with the sums of the sizes in each column of G.
    sizes : vector
        Filled with those of the derivatives, beside G. All of these are powers of two.
    top : vector
        Filled with [G, G_1, G_2], row by row; it has to be zero elsewhere.
    """
    n = 2 * d + 2 * h + 1
    given, columns = d * n + h, n * (directions + 1)
    if not choose_units(d, h, numbers, scales):
        return math.inf
    for i in range(d):
        top[columns * i + d + i] = scales[d + i]
    whole = largest = column_sums(d, h, numbers, 0, scales, sums, 0.0)
    for b in range(directions + 1):
        if b > 0:
            size = column_sums(d, h, numbers, given * b, scales, sums, math.inf)
            if not size < math.inf:
                return math.inf
            sizes[b] = power_of_two(size / (largest or 1.0)) if size > 0.0 else 1.0
            beside = column_sums(d, h, numbers, given * b, scales, sums, sizes[b])
            whole = max(whole, beside)
        for i in range(d):
            unit = sizes[b] * scales[d + i]
            for j in range(n):
                x = numbers[given * b + n * i + j]
                top[columns * (d + i) + n * b + j] = x * (scales[j] / unit)
        for i in range(h):
            j, x = 2 * d + 2 * i, numbers[given * b + d * n + i] / sizes[b]
            top[columns * j + n * b + j + 1] = -x
            top[columns * (j + 1) + n * b + j] = x
    return whole


def column_sums(
    d: int,
    h: int,
    numbers: Sequence[float] | Vector,
    at: int,
    scales: Vector,
    sums: Vector,
    size: float,
) -> float:
    """Return the largest sum of sizes in a column: of G, which are kept (`size` 0), of one of its
    derivatives alone (infinite), or of that, divided by its size, below G."""
    n, largest = 2 * d + 2 * h + 1, 0.0
    for j in range(n):
        total = 0.0
        for i in range(d):
            total += abs(numbers[at + n * i + j] * (scales[j] / scales[d + i]))
        if 2 * d <= j < n - 1:
            total += abs(numbers[at + d * n + (j - 2 * d) // 2])
        if size == 0.0:
            if d <= j < 2 * d:
                total += scales[j]
            sums[j] = total
        elif size < math.inf:
            total = total / size + sums[j]
        if not total <= largest:
            largest = total
    return largest


def choose_units(d: int, h: int, numbers: Sequence[float] | Vector, scales: Vector) -> bool:
    """Fill in the units of X; whether all numbers are within the range of floats."""
    n = 2 * d + 2 * h + 1
    stiffness, damping, waves = 0.0, 0.0, 0.0
    for i in range(d):
        for j in range(n):
            size = abs(numbers[n * i + j])
            if not size < math.inf:
                return False
            if j < d:
                stiffness = max(stiffness, size)
            elif j < 2 * d:
                damping = max(damping, size)
            else:
                waves = max(waves, size)
    for i in range(h):
        size = abs(numbers[d * n + i])
        if not size < math.inf:
            return False
        waves = max(waves, size)
    stiffness = math.sqrt(stiffness)
    speed = power_of_two(stiffness or damping or waves or 1.0)
    fastest = max(stiffness, damping, waves) or 1.0
    for i in range(d):
        scales[i], scales[d + i] = 1.0, speed
    for k in range(h + 1):
        push = 0.0
        first = 2 * d + 2 * k
        for j in range(first, min(first + 2, n)):
            for i in range(d):
                push = max(push, abs(numbers[n * i + j]))
        unit = power_of_two(fastest * speed / push) if push > 0.0 else 1.0
        for j in range(first, min(first + 2, n)):
            scales[j] = unit
    return True


def power_of_two(size: float) -> float:
    """Return the power of two next to a size; a size that is none comes back."""
    if not 0.0 < size < math.inf:
        return size
    found = 1.0
    while 1.4 * found < size:
        found *= 2.0
    while 0.7 * found > size:
        found *= 0.5
    return found


# Plainly.

_MEANS = np.array(MEANS).reshape(4, 4).T[1:, :, None, None]
_ONES = np.array(MEANS[::4])[:, None]
_SLOPES = np.array(SLOPES).reshape(4, 4).T[:, :, None, None]
"""By the power, then by the part; each part has four powers."""


def _product(one: Array, other: Array) -> Array:
    """A product whose sums are made in order: along an axis that is not the last, as NumPy does."""
    found: Array = np.add.reduce(one.T[:, :, None] * other[:, None, :], 0)
    return found


def _whole(top: Array) -> Array:
    """[[A, B, C], [0, A, 0], [0, 0, A]] from [A, B, C]."""
    n, columns = top.shape
    if n == columns:
        return top
    whole = np.zeros((columns, columns))
    whole[:n] = top
    for at in range(n, columns, n):
        whole[at : at + n, at : at + n] = top[:, :n]
    return whole


def _mean_rates(generator: Array, d: int, dt: float, norm: float) -> tuple[Array, Array]:
    """Q with its derivatives, and the rows of H that belong to positions."""
    n, columns = generator.shape
    t, doublings = halved(dt, norm)
    z = t * generator
    whole = _whole(z)
    square = _product(z, whole)
    cubic, fourth = _product(np.concatenate([z, square]), _whole(square)).reshape(2, n, columns)
    parts = np.add.reduce(_MEANS * np.array([z, square, cubic])[:, None], 0)
    parts.reshape(4, -1)[:, : n * columns : columns + 1] += _ONES
    total, whole = parts[3], _whole(fourth)
    for i in (2, 1, 0):
        total = _product(total, whole) + parts[i]
    mean = _product(generator, _whole(total))
    unit = generator[0, d]
    row = generator[d : 2 * d, :n]
    rows = [row, *(_product(row, power[:, :n]) for power in (z, square, cubic))]
    slopes = np.add.reduce(_SLOPES * np.array(rows)[:, None], 0)
    rate = slopes[3]
    for i in (2, 1, 0):
        rate = _product(rate, fourth[:, :n]) + slopes[i]
    rate = unit * rate
    both = np.zeros((n + d, columns))
    for _ in range(doublings):
        pushed = unit * mean[d : 2 * d, :n]
        both[:n] = mean
        both[n:, :n] = pushed + rate
        gained = t * _product(both, _whole(mean))
        rate = 0.25 * ((pushed + 2.0 * rate) + gained[n:, :n])
        mean = mean + 0.5 * gained[:n]
        t = 2.0 * t
    return mean, rate


def halved(dt: float, norm: float) -> tuple[float, int]:
    """Return a time that is short enough for the series, and how often to double it."""
    t, size, doublings = dt, abs(dt) * norm, 0
    while size > NORM:
        t, size, doublings = 0.5 * t, 0.5 * size, doublings + 1
    return t, doublings


# Compiled.


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
    t, doublings = halved(dt, norm)
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
