r"""Linear flights of floats, on NumPy's arrays.

What is computed is told in `linear_flow`. `compiled_flow` does the same in scalar code, and both
round alike: no matrix product is left to a library, which would sum in an order of its own.

Positions change with the velocities alone, so that the rows of S and H that are wanted need no
products with G:

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
    parts = np.zeros((4, n + d, columns))
    np.add.reduce(_MEANS * np.array([z, square, cubic])[:, None], 0, out=parts[:, :n])
    parts.reshape(4, -1)[:, : n * columns : columns + 1] += _ONES
    row = generator[d : 2 * d, :n]
    powers = np.concatenate([z[:, :n], square[:, :n], cubic[:, :n]], axis=1)
    rows = np.concatenate([row, _product(row, powers)], axis=1).reshape(d, 4, n).swapaxes(0, 1)
    np.add.reduce(_SLOPES * rows[:, None], 0, out=parts[:, n:, :n])
    whole, both = _whole(fourth), parts[3]
    for i in (2, 1, 0):
        both = _product(both, whole)
        both += parts[i]
    mean = _product(generator, _whole(both[:n]))
    unit = generator[0, d]
    rate = unit * both[n:, :n]
    for _ in range(doublings):
        pushed = unit * mean[d : 2 * d, :n]
        both[:n] = mean
        both[n:, :n] = pushed + rate
        gained = _product(both, _whole(mean))
        gained *= t
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
