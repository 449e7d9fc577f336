r"""The status of an orbit: its multipliers, and whether it is physical.

Floquet multipliers are found by block-cyclic elimination. No block is inverted: B_k is singular
where the velocity of impact k + 1 vanishes. A multiplier mu makes the cyclic matrix with its last
coupling multiplied by mu singular. For two unknowns per impact the elimination of
`contimpact.orbits.block_cyclic` tells them all, at single points as along a branch. For more,
neighbouring flights are merged by orthogonal elimination of the impact between,

.. math:: [W_1\; W_2] \begin{bmatrix} B_1 \\ A_2 \end{bmatrix} = 0 \quad\Rightarrow\quad
          (W_1 A_1)\,\delta z_1 + (W_2 B_2)\,\delta z_3 = 0,

until one m x m pencil P + mu Q is left (the inverse-free collapse of Benner and Byers, Numer.
Linear Algebra Appl. 2001).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array, Table, Vector, lapack, norm
from ..models.guards import Guard
from ..segments.flight import FlightGaps
from .block_cyclic import Reduced, arrival_rate, eliminate, solve, store

# What the elimination of a cycle tells of it: its multipliers, and determinants by their signs.
#
# As in `contimpact.orbits.block_cyclic`, the functions are in the plain subset of Python that
# `contimpact.compiling` compiles.

TINIEST = -700.0
"""Logarithm of the smallest determinant told from zero."""


def row_norms(
    blocks: Table, count: int, mu: float, time: float, velocity: float, free: float
) -> float:
    """Return the logarithm of the product of the rows' norms in the cyclic matrix.

    The last coupling is multiplied by mu, the columns of times, velocities and the free parameter
    by the sizes given; a size of zero leaves columns out.
    """
    logarithm, product = 0.0, 1.0
    tt, vv, ff = time * time, velocity * velocity, free * free
    for k in range(count):
        _, _, a00, a01, a10, a11, b00, b01, b10, b11, l0, l1 = blocks[k]
        if count == 1:
            a00, a01, b00, b01 = a00 + mu * b00, a01 + mu * b01, 0.0, 0.0
            a10, a11, b10, b11 = a10 + mu * b10, a11 + mu * b11, 0.0, 0.0
        product *= tt * (a00 * a00 + b00 * b00) + vv * (a01 * a01 + b01 * b01) + ff * l0 * l0
        product *= tt * (a10 * a10 + b10 * b10) + vv * (a11 * a11 + b11 * b11) + ff * l1 * l1
        if not 1e-100 < product < 1e100:
            if not product > 0.0:
                return -math.inf
            logarithm += math.log(product)
            product = 1.0
    return 0.5 * (logarithm + math.log(product))


def scale_determinant(sign: float, logarithm: float, det: float, norms: float) -> float:
    """Return a determinant, det R_k (by sign and logarithm) times `det`, over the rows' norms."""
    size = abs(det)
    if not size > 0.0 or sign == 0.0 or norms == -math.inf:
        return 0.0
    value = math.exp(max(logarithm + math.log(size) - norms, TINIEST))
    return value if sign * det > 0.0 else -value


def tangent_by_elimination(
    blocks: Table,
    arrivals: Vector,
    kept: Table,
    reduced: Table,
    z: Vector,
    span: float,
    row: Vector,
    scale: Vector,
    out: Vector,
) -> float:
    """Fill `out` with the unit tangent at a point that goes on along `row`.

    Returns the determinant of the Jacobian bordered by the tangent, rows and columns scaled; NaN
    where no tangent is defined. `kept` and `reduced` are filled as by `block_cyclic.eliminate`.
    """
    count = len(arrivals)
    found = eliminate(blocks, arrivals, kept, 0.0, True, z, span)
    store(reduced, 0, found)
    det = solve(found, kept, count, row, 1.0, out)
    size = norm(out, scale)
    if not (abs(det) > 0.0 and size > 0.0 and size - size == 0.0):
        return math.nan
    for i in range(2 * count + 1):
        out[i] /= size
    time, velocity, free = scale[0], scale[1], scale[2 * count]
    sizes = count * math.log(time * velocity) + math.log(free)
    norms = row_norms(blocks, count, 1.0, time, velocity, free)
    # the border is row / scale^2; with the tangent itself in its place it is longer by `size`
    return scale_determinant(found[12], found[13] + sizes, det * size, norms)


def doubling_by_elimination(reduced: Reduced, blocks: Table, count: int) -> float:
    """Return the scaled determinant of the cyclic matrix with its last coupling negative."""
    p00, p01, p10, p11, q00, q01, q10, q11, _, _, _, _, sign, logarithm, _ = reduced
    det = (p00 - q00) * (p11 - q11) - (p01 - q01) * (p10 - q10)
    return scale_determinant(sign, logarithm, det, row_norms(blocks, count, -1.0, 1.0, 1.0, 0.0))


def product_of_multipliers(blocks: Table, arrivals: Vector, z: Vector, span: float) -> float:
    """Return det A_k / det B_k over the cycle; NaN where an impact velocity is zero."""
    ratio = 1.0
    for k in range(len(arrivals)):
        _, _, a00, a01, a10, a11, b00, b01, b10, b11, _, _ = blocks[k]
        end = arrival_rate(z, k, 2, arrivals, span, b00) * b11 - b01 * b10
        if end == 0.0:
            return math.nan
        ratio *= (a00 * a11 - a01 * a10) / end
    return ratio


def multipliers_by_elimination(
    reduced: Reduced, product: float
) -> tuple[float, float, float, float]:
    """Return real and imaginary parts of both multipliers, the larger first.

    The larger comes from the pencil P + mu Q, the smaller from the product of both, det A_k / det
    B_k, which keeps its relative accuracy; it is NaN where an impact velocity is zero.
    """
    p00, p01, p10, p11, q00, q01, q10, q11 = reduced[:8]
    return roots(
        reduced[14], p00 * q11 + q00 * p11 - p01 * q10 - q01 * p10, p00 * p11 - p01 * p10, product
    )


def roots(
    quadratic: float, linear: float, constant: float, product: float
) -> tuple[float, float, float, float]:
    """Return the two roots of a quadratic, as real and imaginary parts, the larger first.

    Their product is more accurate than constant/quadratic, or NaN.
    """
    known = product - product == 0.0
    discriminant = linear * linear - 4.0 * quadratic * constant
    if discriminant < 0.0:
        real = -0.5 * linear / quadratic
        square = product if known else constant / quadratic
        imaginary = math.sqrt(max(square - real * real, 0.0))
        return real, imaginary, real, -imaginary
    larger = -0.5 * (linear + math.copysign(math.sqrt(discriminant), linear))
    if larger == 0.0:  # a nilpotent pencil
        both = 0.0 if constant == 0.0 else math.inf
        return both, 0.0, both, 0.0
    big = larger / quadratic if quadratic != 0.0 else math.inf
    if known and big - big == 0.0 and big != 0.0:
        return big, 0.0, product / big, 0.0
    return big, 0.0, constant / larger, 0.0


UNIT_CIRCLE_ROUNDING = 1e-10
"""A multiplier this little outside the unit circle is on it, within rounding."""

INFINITE = 1e3 * float(np.finfo(float).eps)
"""A multiplier of a pencil whose denominator is below this part of Q is infinite: QZ knows the
denominator no better."""

ALIKE = 1e-9
"""Part by which absolute values of multipliers differ that are in the order of their angles."""


@dataclass(frozen=True, eq=False)
class Stability:
    """What the flights of a cycle tell of its stability."""

    multipliers: Array
    """Largest first; infinite where an impact velocity vanishes, shape (m,)."""
    products: Array
    """Of every two multipliers; NaN or infinite where one of them is, shape (m (m - 1)."""
    doubling: float
    """The determinant of the cyclic matrix with its last coupling multiplied by -1, row by row
    scaled."""

    def without(self, lost: int, held: int = 0) -> Stability:
        """Return the same with so many directions lost: their multipliers are zero. Directions
        that are held have none; in the pencil theirs are zero, too."""
        if not lost and not held:
            return self
        values = known_multipliers(self.multipliers, lost, held)
        return replace(self, multipliers=values, products=products_of(values))


def known_multipliers(values: Array, lost: int, held: int) -> Array:
    """Return multipliers along the last axis as `Stability.without` has them."""
    values = values[..., : values.shape[-1] - held].copy()
    values[..., values.shape[-1] - lost :] = 0.0
    return values


def stability_of(start: Array, end: Array) -> Stability:
    """Return multipliers and determinants of a cycle from the blocks A_k and B_k, shape (N, m, m).

    For m = 2 the larger multiplier comes from the pencil and the smaller from the product of both,
    which keeps its relative accuracy.
    """
    if start.shape[1:] != (2, 2):
        return _stability_of_any_size(start, end)
    count, product = len(start), determinant(start, end)
    ends = zip(start.reshape(-1, 4).tolist(), end.reshape(-1, 4).tolist(), strict=True)
    blocks = [(0.0, 0.0, *one, *other, 0.0, 0.0) for one, other in ends]
    reduced = eliminate(blocks, [0] * count, [()] * count, 0.0, False, [], 0.0)
    a, b, c, d = multipliers_by_elimination(reduced, product)
    doubling = doubling_by_elimination(reduced, blocks, count)
    return Stability(np.array([complex(a, b), complex(c, d)]), np.array([product]), doubling)


def with_arrival_rates(
    end: Array, arrivals: Sequence[int], unknowns: Sequence[float], span: float
) -> Array:
    """Return the blocks B_k with the derivatives of arrivals by their times as the orbit has them.

    `arrivals` as in `segments.segment`, `unknowns` and `span` as in `block_cyclic.eliminate`.
    """
    found, m = end.copy(), end.shape[1]
    for k, slope in enumerate(end[:, 0, 0].tolist()):
        found[k, 0, 0] = arrival_rate(unknowns, k, m, arrivals, span, slope)
    return found


def multipliers(start: Array, end: Array) -> Array:
    """Return the m multipliers of a cycle, largest first."""
    return stability_of(start, end).multipliers


def determinant(start: Array, end: Array) -> float:
    """Return the product of all multipliers, prod det A_k / det B_k (m is even).

    NaN where an impact velocity is zero.
    """
    ratio = 1.0
    numerators, denominators = _determinants(start).tolist(), _determinants(end).tolist()
    for numerator, denominator in zip(numerators, denominators, strict=True):
        if denominator == 0.0:
            return math.nan
        ratio *= numerator / denominator
    return ratio


def _determinants(blocks: Array) -> Array:
    if blocks.shape[1:] != (2, 2):
        return np.asarray(np.linalg.det(blocks))
    return blocks[:, 0, 0] * blocks[:, 1, 1] - blocks[:, 0, 1] * blocks[:, 1, 0]


def count_unstable(values: Array) -> Array:
    """Return how many multipliers lie outside the unit circle, along the last axis."""
    return np.count_nonzero(np.abs(values) > 1.0 + UNIT_CIRCLE_ROUNDING, axis=-1)


def neimark_sacker(products: Array) -> Array:
    """Return a bounded function that vanishes where two multipliers have the product 1.

    It is the product of (D - 1)/(|D| + 1) over all pairs (the last axis) that are finite.
    """
    with np.errstate(invalid="ignore"):
        parts = (products - 1.0) / (np.abs(products) + 1.0)
    return np.asarray(np.prod(np.where(np.isfinite(products), parts, 1.0), axis=-1).real)


def pair_on_circle(multipliers: Array) -> bool:
    """Whether a complex pair is on the unit circle; two real ones with the product one are a
    neutral saddle."""
    there = np.abs(np.abs(multipliers) - 1.0) < 1e-6
    return bool(np.any(there & (np.abs(multipliers.imag) > 1e-8)))


def collapse(start: Array, end: Array) -> tuple[Array, Array, float, float]:
    """Merge the flights of a cycle into one pencil P + mu Q, from its blocks A_k and B_k.

    Returns P and Q, of shape (m, m), and sign and logarithm of the factor by which the determinant
    of the cyclic matrix, the last coupling multiplied by mu, is that of P + mu Q (m is even).
    """
    sign, logarithm = 1.0, 0.0
    m = start.shape[1]
    while len(start) > 1:
        pairs = len(start) // 2
        first, second = slice(0, 2 * pairs, 2), slice(1, 2 * pairs, 2)
        stacked = np.concatenate([end[first], start[second]], axis=1)
        turned, triangle = np.linalg.qr(stacked, mode="complete")
        null = turned[:, :, m:].transpose(0, 2, 1)
        signs, logarithms = np.linalg.slogdet(triangle[:, :m])
        sign *= float(np.prod(signs * np.sign(np.linalg.det(turned))))
        logarithm += float(np.sum(logarithms))
        merged_start = null[:, :, :m] @ start[first]
        merged_end = null[:, :, m:] @ end[second]
        start = np.concatenate([merged_start, start[2 * pairs :]])
        end = np.concatenate([merged_end, end[2 * pairs :]])
    return start[0], end[0], sign, logarithm


def _stability_of_any_size(start: Array, end: Array) -> Stability:
    p, q, sign, logarithm = collapse(start, end)
    if not np.all(np.isfinite([p, q])):
        raise ValueError("the blocks of an orbit are not finite")
    values = pencil_multipliers(p, q)
    norms = _row_norms(start, end)
    value = scale_determinant(sign, logarithm, float(np.linalg.det(p - q)), norms)
    return Stability(values, products_of(values), value)


def pencil_multipliers(p: Array, q: Array) -> Array:
    """Return the values of mu at which P + mu Q is singular, in their order, for pencils of shape
    (..., m, m); NaN for those that are not finite."""
    # unknowns in units that lie far apart, as nanoseconds and metres per second do, would be
    # rounded beside the largest; powers of two change no digit
    sizes = np.maximum(np.max(np.abs(p), axis=-2), np.max(np.abs(q), axis=-2))
    scales = np.exp2(-np.round(np.log2(np.where(sizes > 0.0, sizes, 1.0))))
    shape, m = p.shape[:-1], p.shape[-1]
    one, other = (np.reshape(part * scales[..., None, :], (-1, m, m)) for part in (p, q))
    real, imaginary, below = (np.full((len(one), m), np.nan) for _ in range(3))
    for i in np.flatnonzero(np.isfinite(one).all((1, 2)) & np.isfinite(other).all((1, 2))).tolist():
        found = lapack().dggev(one[i], -other[i], 0, 0)  # eigvals takes five times longer
        if found[-1]:
            raise np.linalg.LinAlgError("eigenvalues of a pencil did not converge")
        real[i], imaginary[i], below[i] = found[:3]
    with np.errstate(divide="ignore", invalid="ignore"):
        infinite = np.abs(below) <= INFINITE * np.linalg.norm(other, axis=(1, 2))[:, None]
        values = np.where(infinite, np.inf + 0.0j, (real + 1j * imaginary) / below)
    rows, upper = np.nonzero(imaginary > 0.0)
    values[rows, upper + 1] = values[rows, upper].conj()  # but for rounding, they are
    return order_multipliers(values).reshape(shape)


def order_multipliers(values: Array) -> Array:
    """Return multipliers by their absolute values, the largest first, along the last axis.

    Those of one absolute value, as far as rounding tells, follow each other as they do along the
    upper half of a circle from the positive real axis on, each before its complex conjugate.
    """
    with np.errstate(invalid="ignore"):
        order = np.argsort(-np.abs(values), axis=-1, kind="stable")
        values = np.take_along_axis(values, order, axis=-1)
        sizes = np.abs(values)
        smaller = sizes[..., 1:] < (1.0 - ALIKE) * sizes[..., :-1]
    group = np.zeros(values.shape)
    group[..., 1:] = np.cumsum(smaller, axis=-1)
    order = np.lexsort((values.imag < 0.0, np.abs(np.angle(values)), group))
    return np.asarray(np.take_along_axis(values, order, axis=-1), dtype=complex)


def products_of(values: Array) -> Array:
    """Return the products of every two of them, along the last axis, where both are finite."""
    first, second = np.triu_indices(values.shape[-1], 1)
    one, other = values[..., first], values[..., second]
    with np.errstate(invalid="ignore"):
        return np.where(np.isfinite(one) & np.isfinite(other), one * other, np.nan)


def _row_norms(start: Array, end: Array) -> float:
    """Logarithm of the product of the rows' norms in the cyclic matrix with its coupling at -1."""
    rows = start - end if len(start) == 1 else np.concatenate([start, end], axis=2)
    norms = np.linalg.norm(rows, axis=2)
    return float(np.sum(np.log(norms))) if np.all(norms > 0.0) else -math.inf


# Whether an orbit is physical, and if not why and where.


@dataclass(frozen=True)
class Verdict:
    """Whether an orbit is physical; if not, the first reason found. `smallest_gap` is not a
    number where no flight comes nearer to a wall than at its ends."""

    physical: bool
    reason: str | None
    smallest_gap: float


def findings(
    word: str,
    named: Sequence[Guard],
    impacts: Array,
    gaps: Sequence[FlightGaps],
    forgive_touches: Collection[tuple[int, str]] = (),
    forgive_impacts: Collection[int] = (),
) -> tuple[float, ...]:
    """Return what `verdict` says of an orbit, without what is the event itself: touches by flight
    and wall, and impacts of which neither the direction nor the order of two in a row matters."""
    places = {w.name: i for i, w in enumerate(named)}
    walls = [places[name] for name in word]
    touches = [
        None if t is None or (k, t.wall) in forgive_touches else t
        for k, flight in enumerate(gaps)
        for t in flight.touches
    ]
    begun = (t for flight in gaps for t in flight.beyond)
    for past in (t for t in begun if (t.flight, t.wall) not in forgive_touches):
        place = len(named) * past.flight + places[past.wall]
        known = touches[place]
        touches[place] = past if known is None or past.gap < known.gap else known
    sides, durations = [float(w.side) for w in named], [flight.duration for flight in gaps]
    velocities = impacts[:, 1].tolist()
    for k in forgive_impacts:
        velocities[k] = 0.0
        if (k + 1) % len(word) in forgive_impacts:
            durations[k] = 0.0
    nearest = [math.nan if t is None else t.gap for t in touches]
    times = [math.nan if t is None else t.time for t in touches]
    return verdict(walls, sides, durations, nearest, times, velocities)


def verdict_of(
    found: Sequence[float], word: str, named: Sequence[Guard], first: float = 0.0
) -> Verdict:
    """Return what `verdict` found as an object; for `first` see `reason_of`."""
    return Verdict(found[0] == PHYSICAL, reason_of(found, word, named, first), found[5])


PHYSICAL, OUT_OF_ORDER, PASSES, WRONG_WAY = 0, 1, 2, 3
"""Verdicts of `verdict`."""


AT_REST = 1e-12
"""An impact whose velocity is below this part of the largest of the orbit runs neither way: beside
a zero velocity its sign is rounding."""


AT_ONCE = 1e-12
"""Impacts that follow each other within this part of the orbit's period are in either order: both
bodies of a symmetric machine hit at once, all along a branch."""


def verdict(
    walls: Vector, sides: Vector, durations: Vector, gaps: Vector, times: Vector, velocities: Vector
) -> tuple[int, int, int, float, float, float]:
    """Decide whether an orbit is physical, from numbers: its word, durations and velocities.

    It is if all flights last, within `AT_ONCE`, none passes a wall, and every impact runs towards
    its wall or is at rest within `AT_REST`. `gaps` has the smallest gap of each flight to each wall
    and `times` when it is reached, NaN where there is none; velocities are those before impacts.

    Returns what is found (0 for physical, or why not), the place of the flight or impact and the
    wall passed, the amount (a duration, depth or velocity), the time of a touch, and the smallest
    gap of all, NaN where there is none.
    """
    what, place, wall, amount, when, smallest = 0, 0, 0, 0.0, 0.0, math.inf
    count, span = len(sides), 0.0
    for k in range(len(durations)):
        span += durations[k]
    for k in range(len(durations)):
        if durations[k] < -AT_ONCE * span and what == 0:
            what, place, amount = 1, k, durations[k]
        for i in range(count):
            gap = gaps[count * k + i]
            if gap < smallest:  # not where there is none
                smallest = gap
                if gap < 0.0 and what == 0:
                    what, place, wall, amount, when = 2, k, i, -gap, times[count * k + i]
    fastest = 0.0
    for k in range(len(walls)):
        fastest = max(fastest, abs(velocities[k]))
    for k in range(len(walls)):
        wrong = velocities[k] * sides[walls[k]] < -AT_REST * fastest
        if wrong and what != 3:
            what, place, amount = 3, k, velocities[k]
    return what, place, wall, amount, when, smallest if smallest < math.inf else math.nan


def reason_of(found: Vector, word: str, named: Sequence[Guard], first: float = 0.0) -> str | None:
    """Return what `verdict` found as a sentence; None where the orbit is physical.

    Impacts and flights are counted from 1, as in columns and on the page, and times from `first`.
    """
    if found[0] == PHYSICAL:
        return None
    what, k, wall = (int(number) for number in found[:3])
    amount, when = found[3], found[4]
    flight = f"flight {k + 1} ({word[k]} to {word[(k + 1) % len(word)]})" if word else "the orbit"
    if what == OUT_OF_ORDER:
        return f"impacts out of order: {flight} lasts {amount:.6g}"
    if (
        what == PASSES
        and word
        and any(g.name == word[k] and g.past == named[wall].name for g in named)
    ):
        name = named[wall].name
        return f"{flight} goes through where it would slide, {amount:.6g} within {name}"
    if what == PASSES:
        return f"{flight} passes wall {named[wall].name} by {amount:.6g} at t = {when - first:.6g}"
    return f"impact {k + 1} on wall {word[k]} runs the wrong way: velocity {amount:.6g}"
