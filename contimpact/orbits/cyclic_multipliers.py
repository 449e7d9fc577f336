"""What the elimination of a cycle tells of it: its multipliers, and determinants by their signs.

As in `contimpact.orbits.block_cyclic`, the functions are in the plain subset of Python that
`contimpact.compiling` compiles.
"""

from __future__ import annotations

import math

from ..arrays import Table, Vector
from .block_cyclic import Reduced, arriving

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


def scaled(sign: float, logarithm: float, det: float, norms: float) -> float:
    """Return a determinant, det R_k (by sign and logarithm) times `det`, over the rows' norms."""
    size = abs(det)
    if not size > 0.0 or sign == 0.0 or norms == -math.inf:
        return 0.0
    value = math.exp(max(logarithm + math.log(size) - norms, TINIEST))
    return value if sign * det > 0.0 else -value


def doubling(reduced: Reduced, blocks: Table, count: int) -> float:
    """Return the scaled determinant of the cyclic matrix with its last coupling negative."""
    p00, p01, p10, p11, q00, q01, q10, q11, _, _, _, _, sign, logarithm, _ = reduced
    det = (p00 - q00) * (p11 - q11) - (p01 - q01) * (p10 - q10)
    return scaled(sign, logarithm, det, row_norms(blocks, count, -1.0, 1.0, 1.0, 0.0))


def product_of_multipliers(blocks: Table, arrivals: Vector, z: Vector, span: float) -> float:
    """Return det A_k / det B_k over the cycle; NaN where an impact velocity is zero."""
    ratio = 1.0
    for k in range(len(arrivals)):
        _, _, a00, a01, a10, a11, b00, b01, b10, b11, _, _ = blocks[k]
        end = arriving(z, k, arrivals, span, b00) * b11 - b01 * b10
        if end == 0.0:
            return math.nan
        ratio *= (a00 * a11 - a01 * a10) / end
    return ratio


def multipliers(reduced: Reduced, product: float) -> tuple[float, float, float, float]:
    """Return real and imaginary parts of both multipliers, the larger first.

    Parameters
    ----------
    reduced : tuple
        What `eliminate` returned.
    product : float
        Of all multipliers, det A_k / det B_k; NaN where an impact velocity is zero.

    Notes
    -----
    The larger comes from the pencil P + mu Q, the smaller from the product of both, which keeps
    its relative accuracy.
    """
    p00, p01, p10, p11, q00, q01, q10, q11 = reduced[:8]
    return roots(
        reduced[14], p00 * q11 + q00 * p11 - p01 * q10 - q01 * p10, p00 * p11 - p01 * p10, product
    )


def roots(
    quadratic: float, linear: float, constant: float, product: float
) -> tuple[float, float, float, float]:
    """Return the two roots of a quadratic, as real and imaginary parts, the larger first.

    Parameters
    ----------
    quadratic, linear, constant : float
        Coefficients.
    product : float
        Of the roots, more accurate than constant/quadratic, or not a number.
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
