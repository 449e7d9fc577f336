r"""Linear flights of several coordinates: propagators in floats, arrays and other arithmetics.

With the forcing's harmonics as coordinates of their own, X = (x, x', cos, sin, ..., 1), motion is
autonomous, :math:`\dot X = GX`, at resonance too. A flight of duration t changes X by
:math:`t\,QX`, with

.. math:: Q = \frac{e^{Gt} - 1}{t} = G\,\varphi(Gt), \qquad \varphi(z) = \frac{e^z - 1}{z}, \qquad
          S = GQ, \qquad H = \frac{dQ}{dt} = G^2 \varphi'(Gt) .

Q gives mean velocities that do not cancel for short flights. All three are summed for the time
t/2^s, and the time is doubled s times:

.. math:: Q(2t) = Q + \tfrac{t}{2} QQ, \qquad S(2t) = S + \tfrac{t}{2} QS, \qquad
          H(2t) = \tfrac14\left(S + 2H + tQ(S + H)\right) .

Nothing is subtracted from 1, so that slow motions keep their digits beside fast ones, and nothing
is multiplied by G, whose size would come to the errors. The state is scaled by powers of two first:
stiff springs and large forces then ask for no more doublings than their frequencies do (Higham,
Functions of Matrices, 2008, ch. 10).

Derivatives with respect to a parameter follow from the same functions of a block-triangular matrix
(ibid., sec. 3.1), and truncated series from products of these.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..arrays import Array, Vector

# Linear flights of floats, on NumPy's arrays.
#
# `diagrams.orbit_program` does the same in scalar code, and both round alike: no matrix product is
# left to a library, which would sum in an order of its own.
#
# Positions change with the velocities alone, so that the rows of S and H that are wanted need no
# products with G:
#
# .. math:: S_i = g_i\,Q_{d+i}, \qquad H_i = g_i\,(G\varphi')_{d+i}, \qquad
#           H(2t) = \tfrac14\left(S + 2H + t\,(S + H)\,Q\right) ,
#
# with i = 1, ..., d, and g_i = 1 in the units of the coordinates. All of these commute.

NORM = 0.5
"""Largest norm of z for which the series is summed directly."""
TERMS = 16
"""0.5^16/17! is 4e-20."""

MEANS = tuple(1.0 / math.factorial(k + 1) for k in range(TERMS))
"""Coefficients of phi."""
SLOPES = tuple((k + 1.0) / math.factorial(k + 2) for k in range(TERMS))
"""Coefficients of phi'."""

UNLIKE = 2.0**10
"""Coordinates have units of their own where what one does to another is so many times what the
other does to it."""

OWN = 32.0
"""How many times a coordinate's unit its size is, or the other way round, that becomes its unit."""

LONGEST = 2.0**60
"""Longest flight, in radians or as an exponent: no digit is left of a phase beyond."""
BEYOND = "a linear flight with numbers beyond the range of floats"


def flow(d: int, h: int, directions: int, dt: float, *numbers: float) -> tuple[float, ...]:
    """Return the rows of a linear flight that the equations of orbits are made of.

    d, h and directions as in `Shape`; dt is the duration. The numbers are the accelerations as d
    rows of G, the angular frequencies of the harmonics, then, for each direction, the derivatives
    of all these. Returns tables of d rows of `Shape.size` numbers: mean velocities (the rows of Q
    of the positions), end velocities (those of 1 + tQ of the velocities), the derivatives of both
    by the duration, and those of both by each direction. The last few are kept: both coordinates of
    a flight are asked for at its ends and turns.
    """
    return _flow(d, h, directions, dt, numbers)


@lru_cache(maxsize=64)
@np.errstate(over="ignore", invalid="ignore")  # what is tried and diverges says so by its residuals
def _flow(
    d: int, h: int, directions: int, dt: float, numbers: tuple[float, ...]
) -> tuple[float, ...]:
    n = 2 * d + 2 * h + 1
    scales, sums, sizes = [1.0] * n, [0.0] * n, [1.0] * (directions + 1)
    top = [0.0] * (n * n * (directions + 1))
    norm = balance(d, h, directions, numbers, scales, sums, sizes, top)
    if not norm * abs(dt) < LONGEST:
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
    return tuple(np.concatenate(found).ravel().tolist())


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

    `scales` is filled with the units of X (those of velocities and forces by the frequencies there
    are), `sums` with the sums of the sizes in each column of G, `sizes` with those of the
    derivatives beside G; all are powers of two. `top`, zero elsewhere, is filled with [G, G_1,
    G_2], row by row. In the plain subset of Python that `contimpact.compiling` compiles, as the
    rest.
    """
    n = 2 * d + 2 * h + 1
    given, columns = d * n + h, n * (directions + 1)
    if not choose_units(d, h, numbers, scales):
        return math.inf
    for i in range(d):
        top[columns * i + d + i] = scales[d + i] / scales[i]
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
                total += scales[j] / scales[j - d]
            sums[j] = total
        elif size < math.inf:
            total = total / size + sums[j]
        if not total <= largest:
            largest = total
    return largest


def choose_units(d: int, h: int, numbers: Sequence[float] | Vector, scales: Vector) -> bool:
    """Fill in the units of X; whether all numbers are within the range of floats."""
    n = 2 * d + 2 * h + 1
    for i in range(d * n + h):
        if not abs(numbers[i]) < math.inf:
            return False
    balance_coordinates(d, h, numbers, scales)
    stiffness, damping, waves = 0.0, 0.0, 0.0
    for i in range(d):
        for k in range(d):
            unit = scales[k] / scales[i]
            stiffness = max(stiffness, abs(numbers[n * i + k]) * unit)
            damping = max(damping, abs(numbers[n * i + d + k]) * unit)
    for i in range(h):
        waves = max(waves, abs(numbers[d * n + i]))
    stiffness = math.sqrt(stiffness)
    speed = power_of_two(stiffness or damping or waves or 1.0)
    fastest = max(stiffness, damping, waves) or 1.0
    for i in range(d):
        scales[d + i] = scales[i] * speed
    for k in range(h + 1):
        push = 0.0
        first = 2 * d + 2 * k
        for j in range(first, min(first + 2, n)):
            for i in range(d):
                push = max(push, abs(numbers[n * i + j]) / scales[i])
        unit = power_of_two(fastest * speed / push) if push > 0.0 else 1.0
        for j in range(first, min(first + 2, n)):
            scales[j] = unit
    return True


def balance_coordinates(d: int, h: int, numbers: Sequence[float] | Vector, scales: Vector) -> None:
    """Fill in the units of positions: one, unless what two coordinates do to each other is so
    unlike that their units are, as those of a position and a velocity in metres and seconds.

    Where one acts on others alone, or they on it alone, its unit is the size of what forces and
    other coordinates do to it at the rates there are, if that is far from one: beside the rate of a
    stiff contact it is less than what slow motion comes to.
    """
    n, rate = 2 * d + 2 * h + 1, 0.0
    for i in range(d):
        scales[i] = 1.0
        rate = max(rate, math.sqrt(abs(numbers[n * i + i])), abs(numbers[n * i + d + i]))
    for i in range(h):
        rate = max(rate, abs(numbers[d * n + i]))
    for i in range(d * d):
        own = i % d
        taken, given, size = 0.0, 0.0, 0.0
        for k in range(d):
            if k != own:
                unit = scales[k] / scales[own]
                by, to = n * own + k, n * k + own
                taken = max(taken, max(abs(numbers[by]), abs(numbers[by + d])) * unit)
                given = max(given, max(abs(numbers[to]), abs(numbers[to + d])) / unit)
                size = max(size, (abs(numbers[by]) + abs(numbers[by + d]) * rate) * scales[k])
        if taken > UNLIKE * given > 0.0 or given > UNLIKE * taken > 0.0:
            scales[own] *= power_of_two(math.sqrt(taken / given))
        elif (taken == 0.0 or given == 0.0) and rate > 0.0:
            for j in range(2 * d, n):
                size = max(size, abs(numbers[n * own + j]))
            size /= rate * rate
            if size > OWN * scales[own] or 0.0 < OWN * size < scales[own]:
                scales[own] = power_of_two(size)


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
"""Slopes by the power, then by the part; each part has four powers."""


def _product(one: Array, other: Array) -> Array:
    """A product whose sums are made in order: along an axis that is not the last, as NumPy does."""
    found: Array = np.add.reduce(one.T[:, :, None] * other[:, None, :], 0)
    return found


def _block_triangle(top: Array) -> Array:
    """[[A, B, C], [0, A, 0], [0, 0, A]] from [A, B, C]."""
    n, columns = top.shape[-2:]
    if n == columns:
        return top
    whole = np.zeros((*top.shape[:-2], columns, columns), top.dtype)
    whole[..., :n, :] = top
    for at in range(n, columns, n):
        whole[..., at : at + n, at : at + n] = top[..., :n]
    return whole


def _mean_rates(generator: Array, d: int, dt: float, norm: float) -> tuple[Array, Array]:
    """Q with its derivatives, and the rows of H that belong to positions."""
    n, columns = generator.shape
    t, doublings = halve_time(dt, norm)
    z = t * generator
    whole = _block_triangle(z)
    square = _product(z, whole)
    cubic, fourth = _product(np.concatenate([z, square]), _block_triangle(square)).reshape(
        2, n, columns
    )
    parts = np.zeros((4, n + d, columns))
    np.add.reduce(_MEANS * np.array([z, square, cubic])[:, None], 0, out=parts[:, :n])
    parts.reshape(4, -1)[:, : n * columns : columns + 1] += _ONES
    row = generator[d : 2 * d, :n]
    powers = np.concatenate([z[:, :n], square[:, :n], cubic[:, :n]], axis=1)
    rows = np.concatenate([row, _product(row, powers)], axis=1).reshape(d, 4, n).swapaxes(0, 1)
    np.add.reduce(_SLOPES * rows[:, None], 0, out=parts[:, n:, :n])
    whole, both = _block_triangle(fourth), parts[3]
    for i in (2, 1, 0):
        both = _product(both, whole)
        both += parts[i]
    mean = _product(generator, _block_triangle(both[:n]))
    unit = generator[0, d]
    rate = unit * both[n:, :n]
    for _ in range(doublings):
        pushed = unit * mean[d : 2 * d, :n]
        both[:n] = mean
        both[n:, :n] = pushed + rate
        gained = _product(both, _block_triangle(mean))
        gained *= t
        rate = 0.25 * ((pushed + 2.0 * rate) + gained[n:, :n])
        mean = mean + 0.5 * gained[:n]
        t = 2.0 * t
    return mean, rate


def halve_time(dt: float, norm: float) -> tuple[float, int]:
    """Return a time that is short enough for the series, and how often to double it."""
    t, size, doublings = dt, abs(dt) * norm, 0
    while size > NORM:
        t, size, doublings = 0.5 * t, 0.5 * size, doublings + 1
    return t, doublings


class Shape(NamedTuple):
    """The whole numbers that a call begins with."""

    freedom: int
    """Degrees of freedom d."""
    waves: int
    """Harmonics h of the forcing."""
    directions: int
    """Parameters with respect to which derivatives are wanted."""

    @property
    def size(self) -> int:
        """Coordinates of X."""
        return 2 * self.freedom + 2 * self.waves + 1

    @property
    def given(self) -> int:
        """Numbers that say what G is, or one of its derivatives."""
        return self.freedom * self.size + self.waves

    def place(self, table: int, i: int, j: int) -> int:
        """Where entry j of row i of a table stands in what `flow` returns."""
        return (self.freedom * table + i) * self.size + j


Product: TypeAlias = Callable[[Array, Array], Array]
"""The product of two matrices, or of matrices along the first axes, or of truncated series of these
whose coefficients are along the first axis."""

Summed: TypeAlias = Callable[[Array, Array, Product], tuple[Array, Array]]
"""phi and phi' of a matrix of norm `NORM` at most, given one, the matrix, and their product."""


def rounding_scale(
    d: int, h: int, directions: int, numbers: Sequence[float], tables: Array
) -> Array:
    """Return what the results of `flow` are rounded beside: the largest of their tables.

    In the units of `scales_of`, end velocities are of the size of the state's, at least, and their
    rates and accelerations by the fastest frequency larger. What harmonics do that push nothing is
    zero without rounding; they have no units.
    """
    shape = Shape(d, h, directions)
    each = generators(shape, numbers)
    generator = each[0]
    scales, fastest = scales_of(shape, generator), norm_in_units(shape, generator)
    units = scales / scales[:d, None], scales / scales[d : 2 * d, None]
    found = np.abs(tables).reshape(-1, d, shape.size)
    sizes = [float((table * units[i % 2]).max()) for i, table in enumerate(found)]
    sizes[1] = max(sizes[1], 1.0)
    sizes[2:4] = max(sizes[2], fastest * sizes[0]), max(sizes[3], fastest * sizes[1])
    pushed = np.array([_pushed(shape, generator) | _pushed(shape, part) for part in each])
    by_table = np.concatenate([pushed[:1], pushed]).repeat(2, axis=0)
    beside = [size / units[i % 2] for i, size in enumerate(sizes)]
    return np.where(by_table[:, None], beside, 0.0).ravel()


def _pushed(shape: Shape, generator: Array) -> Array:
    """Which coordinates of X may change velocities: all but harmonics without a force."""
    d, h, _ = shape
    pushes: Array = np.max(np.abs(generator[d : 2 * d]), axis=0) > 0.0
    waves = pushes[2 * d : -1].reshape(h, 2).any(axis=1).repeat(2)
    found: Array = np.concatenate([np.ones(2 * d, bool), waves, pushes[-1:]])
    return found


def flow_of_arrays(d: int, h: int, directions: int, dt: Any, *numbers: Any) -> Array:
    """Return the same for arrays of durations, or of all arguments; results are along axis 0, NaN
    beyond the range of floats."""
    shape = Shape(d, h, directions)
    given = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in (dt, *numbers)))
    if any(np.ndim(x) for x in numbers):
        apart = np.broadcast_arrays(*numbers)  # durations may differ where these do not
        rows = np.array([np.ravel(x) for x in apart], dtype=float).T.tolist()
        many = [generators(shape, values) for values in rows]
        row = np.arange(len(rows)).reshape(apart[0].shape)
        each = np.broadcast_to(row, given[0].shape).ravel()
        matrices = [np.array(matrix)[each] for matrix in zip(*many, strict=True)]
    else:
        matrices = generators(shape, numbers)
    times = given[0].reshape(-1, 1, 1)
    try:
        found = _tables(shape, matrices, times, series_of_floats)
    except OverflowError:  # there are no units for all of them
        found = np.full((len(times), 4 + 2 * directions, d, shape.size), math.nan)
    return found.reshape(given[0].size, -1).T.reshape(-1, *given[0].shape)


def flow_of_states(d: int, h: int, directions: int, dt: Any, *numbers: Any) -> Array:
    """Return the same for a search, which has many durations: without derivatives by parameters,
    which are put at zero, and with durations to thirteen digits: those of orbits of one impact
    differ by rounding alone, and need one matrix."""
    given = numbers[: len(numbers) // (1 + directions)]
    if np.ndim(dt) and not any(np.ndim(x) for x in given):
        _, first, numbered = np.unique(_to_digits(dt), return_index=True, return_inverse=True)
        times = np.ravel(dt)[first].tobytes()
        found = _flow_at(d, h, times, given)[:, numbered.reshape(np.shape(dt))]
    else:
        found = flow_of_arrays(d, h, 0, dt, *given)
    size = 2 * directions * d * Shape(d, h, 0).size
    return np.concatenate([found, np.zeros((size, *found.shape[1:]))])


@lru_cache(maxsize=4)
def _flow_at(d: int, h: int, times: bytes, numbers: tuple[float, ...]) -> Array:
    """The same for each of some times; both coordinates of a flight are asked for at once."""
    return flow_of_arrays(d, h, 0, np.frombuffer(times), *numbers)


def _to_digits(dt: Array) -> Array:
    """Durations to thirteen digits, at least."""
    parts, powers = np.frexp(dt)
    return np.ldexp(np.round(parts * 2.0**45), powers - 45)


def make_flow(summed: Summed) -> Callable[..., list[Any]]:
    """Return `flow` for numbers of another kind, from what sums the series of these."""

    def function(d: int, h: int, directions: int, dt: Any, *numbers: Any) -> list[Any]:
        shape = Shape(d, h, directions)
        matrices = generators(shape, numbers, object)
        found: list[Any] = _tables(shape, matrices, dt, summed).ravel().tolist()
        return found

    return function


def flow_of_series(
    d: int, h: int, directions: int, rows: Sequence[Sequence[Any]], summed: Summed | None = None
) -> list[list[Any]]:
    """Return `flow` of truncated series, each row the coefficients of one; that of the duration is
    first."""
    shape, kind = Shape(d, h, directions), object if summed else float
    orders = [generators(shape, row, kind) for row in zip(*rows[1:], strict=True)]
    for matrices in orders[1:]:
        matrices[0][_rates(shape)] = 0
    matrices = [np.array(each) for each in zip(*orders, strict=True)]
    times = np.array(rows[0], kind).reshape(-1, 1, 1)
    found = _tables(shape, matrices, times, summed or series_of_floats, series=True)
    columns: list[list[Any]] = found.reshape(len(times), -1).T.tolist()
    return columns


def generators(shape: Shape, numbers: Sequence[Any], kind: Any = float) -> list[Array]:
    """G and its derivatives by each direction."""
    size = shape.given
    parts = [numbers[size * i : size * (i + 1)] for i in range(shape.directions + 1)]
    found = [_generator(shape, part, kind) for part in parts]
    found[0][_rates(shape)] = 1
    return found


def _generator(shape: Shape, numbers: Sequence[Any], kind: Any) -> Array:
    d, h, _ = shape
    matrix = np.zeros((shape.size, shape.size), kind)
    matrix[d : 2 * d] = np.array(numbers[: d * shape.size], kind).reshape(d, -1)
    for i in range(h):
        j, frequency = 2 * d + 2 * i, numbers[d * shape.size + i]
        matrix[j, j + 1], matrix[j + 1, j] = -frequency, frequency
    return matrix


def _rates(shape: Shape) -> tuple[range, range]:
    """Where G says that positions change with the velocities."""
    return range(shape.freedom), range(shape.freedom, 2 * shape.freedom)


def generator_of(shape: Shape, numbers: Sequence[float]) -> Array:
    """Return G from the numbers that `flow` takes, the duration left out."""
    return generators(shape._replace(directions=0), numbers)[0]


def norm_in_units(shape: Shape, generator: Array) -> float:
    """Return the norm of G in the units of `scales_of`: about the fastest frequency."""
    scales = scales_of(shape, generator)
    return _norm(generator * (scales / scales[:, None]))


def _tables(
    shape: Shape, matrices: list[Array], dt: Any, summed: Summed, series: bool = False
) -> Array:
    """What `flow` returns, as an array (..., tables, d, size); for series a row for each order."""
    d, n = shape.freedom, shape.size
    scales = scales_of(shape, matrices[0][0] if series else matrices[0])
    balance = scales / scales[:, None]
    balanced = [matrix * balance for matrix in matrices]
    sizes = [_relative(matrix, balanced[0]) for matrix in balanced]
    whole = triangular(balanced, sizes)
    mean, rate = mean_rates(whole, dt, summed, series)
    end = _times(dt, mean, series)
    (end[0] if series else end)[...] += np.eye(whole.shape[-1], dtype=end.dtype)
    pushed = products(series)(whole, end)
    wanted = [(mean, 0, 0), (end, d, 0), (rate, 0, 0), (pushed, d, 0)]
    wanted += [(m, at, i) for i in range(1, len(sizes)) for m, at in ((mean, 0), (end, d))]
    found = [
        table[..., at : at + d, n * i : n * (i + 1)] * (sizes[i] / balance[at : at + d])
        for table, at, i in wanted
    ]
    return np.stack(found, axis=-3)


def scales_of(shape: Shape, generator: Array) -> Array:
    """Units of X, powers of two: those of velocities and forces by the frequencies there are."""
    d, h, _ = shape
    sizes = np.abs(generator).astype(float).reshape(-1, shape.size, shape.size).max(axis=0)
    waves = [sizes[j + 1, j] for j in range(2 * d, 2 * d + 2 * h, 2)]
    scales = [1.0] * shape.size
    if not choose_units(d, h, [*sizes[d : 2 * d].ravel().tolist(), *map(float, waves)], scales):
        raise OverflowError(BEYOND)
    return np.array(scales)


def mean_of(shape: Shape, generator: Array, dt: float) -> Array:
    """Return Q of floats, summed in the units of `scales_of`."""
    scales = scales_of(shape, generator)
    balance = scales / scales[:, None]
    mean: Array = mean_rates(generator * balance, dt, series_of_floats)[0] / balance
    return mean


def _power_of_two(size: float) -> float:
    if not 0.0 < size < math.inf:
        raise OverflowError(BEYOND)
    return 2.0 ** round(math.log2(size))


def _relative(matrix: Array, other: Array) -> float:
    """The size of a matrix beside another one, as a power of two."""
    size = _norm(matrix)
    return (
        _power_of_two(size / (_norm(other) or 1.0)) if size > 0.0 and matrix is not other else 1.0
    )


def triangular(parts: list[Array], sizes: list[float]) -> Array:
    """[[G, G_1, G_2], [0, G, 0], [0, 0, G]], each G_i divided by its size."""
    beside = (part / size for part, size in zip(parts[1:], sizes[1:], strict=True))
    return _block_triangle(np.concatenate([parts[0], *beside], axis=-1))


def products(series: bool) -> Product:
    """Return how matrices are multiplied, or truncated series of them."""
    return partial(_convolve, np.matmul) if series else np.matmul


def _convolve(product: Product, one: Array, other: Array) -> Array:
    """The coefficients of a product of two truncated series."""
    found = product(one[0], other)
    for i in range(1, len(one)):
        found[i:] += product(one[i], other[:-i])
    return found


def _norm(matrices: Array) -> float:
    return float(np.abs(matrices).sum(axis=-2).max())


def _times(dt: Any, matrix: Array, series: bool) -> Array:
    """A matrix times a time: a number, numbers of shape (..., 1, 1), or those of a series.

    The matrix first: mpmath's numbers write out arrays before they leave a product to them.
    """
    return _convolve(np.multiply, dt, matrix) if series else np.asarray(matrix * dt)


def mean_rates(
    generator: Array, dt: Any, summed: Summed, series: bool = False
) -> tuple[Array, Array]:
    """Return Q and H of matrices G, shape (..., n, n), for a time as in `_times`.

    Of many times they are NaN for those beyond the range of floats, or `LONGEST`: the others share
    their doublings.
    """
    many, product = np.ndim(dt) == 3 and not series, products(series)
    with np.errstate(over="ignore", invalid="ignore"):
        turned = _times(dt, generator, series)
    beyond = ~(np.abs(turned).sum(axis=-2).max(axis=-1) < LONGEST) if many else False
    if np.any(beyond):
        dt, turned = np.array(dt), np.array(turned)
        dt[beyond], turned[beyond] = 0.0, 0.0
    size = _norm(np.abs(turned).sum(axis=0) if series else turned)
    if not size < math.inf:
        raise OverflowError(BEYOND)
    doublings = max(0, math.ceil(math.log2(size / NORM))) if size > 0.0 else 0
    t = dt * 0.5**doublings
    n, short = generator.shape[-1], _times(t, generator, series)
    one = np.zeros_like(short)
    (one[0] if series else one)[...] = np.eye(n, dtype=one.dtype)
    value, slope = summed(one, short, product)
    mean, change = product(generator, value), product(generator, product(generator, slope))
    found = np.concatenate([mean, product(generator, mean), change], axis=-1)
    q, s, h = ((..., slice(n * i, n * i + n)) for i in range(3))
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(doublings):
            gained = _times(t, product(found[q], found), series)
            last = 0.25 * (found[s] + 2.0 * found[h] + gained[s] + gained[h])
            found = found + 0.5 * gained
            found[h] = last
            t = 2.0 * t
    found[beyond] = math.nan
    if not many and found.dtype != object and not np.all(np.isfinite(found)):
        raise OverflowError("a linear flight grows beyond the range of floats")
    return found[q], found[h]


_SERIES = np.array([MEANS, SLOPES]).reshape(8, 4)
"""Coefficients of both functions, four powers in a row."""


def series_of_floats(one: Array, z: Array, product: Product) -> tuple[Array, Array]:
    """Both series, by powers of z^4 (Paterson and Stockmeyer)."""
    n = z.shape[-1]
    square = product(z, z)
    powers = np.stack([one, z, square, product(square, z)], axis=-3)
    flat = powers.reshape(*z.shape[:-2], 4, n * n)
    parts = (_SERIES @ flat).reshape(*z.shape[:-2], 2, 4, n, n)
    fourth = product(square, square)[..., None, :, :]
    total = parts[..., 3, :, :]
    for i in (2, 1, 0):
        total = product(total, fourth) + parts[..., i, :, :]
    return total[..., 0, :, :], total[..., 1, :, :]


def make_series(ctx: Any) -> Summed:
    """Return what sums both series to the digits of an mpmath context."""

    def summed(one: Array, z: Array, product: Product) -> tuple[Array, Array]:
        power = one * ctx.one
        value, slope = power * 0, power * 0
        k, least = 0, ctx.eps * 1e-3
        while NORM**k > least * math.factorial(k + 1):
            value = value + power / ctx.factorial(k + 1)
            slope = slope + power * (k + 1) / ctx.factorial(k + 2)
            power, k = product(power, z), k + 1
        return value, slope

    return summed


SCALAR = {"flow": flow, "flow_of_series": flow_of_series}
ARRAY = {"flow": flow_of_arrays}
STATES = {"flow": flow_of_states}


def multiprecision_functions(ctx: Any) -> dict[str, Callable[..., Any]]:
    """Return the same functions for the numbers of an mpmath context."""
    summed = make_series(ctx)
    return {"flow": make_flow(summed), "flow_of_series": partial(flow_of_series, summed=summed)}
