r"""Multipliers and determinants of the periodic pencil A_k dz_k + B_k dz_{k+1} = 0.

No block is inverted: B_k is singular where the velocity of impact k + 1 vanishes. A multiplier mu
makes the cyclic matrix with its last coupling multiplied by mu singular. Neighbouring flights are
merged by orthogonal elimination of the impact between them,

.. math:: [W_1\; W_2] \begin{bmatrix} B_1 \\ A_2 \end{bmatrix} = 0 \quad\Rightarrow\quad
          (W_1 A_1)\,\delta z_1 + (W_2 B_2)\,\delta z_3 = 0,

until one m x m pencil P + mu Q is left (the inverse-free collapse of Benner and Byers, Numer.
Linear Algebra Appl. 2001).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .block_cyclic import roots

Array = np.ndarray[Any, Any]

UNIT_CIRCLE_ROUNDING = 1e-10
"""A multiplier this little outside the unit circle is on it, within rounding."""


def collapse(start: Array, end: Array) -> tuple[Array, Array]:
    """Merge the flights of a cycle into one pencil P + mu Q.

    Parameters
    ----------
    start, end : ndarray of shape (N, m, m)
        The blocks A_k and B_k.

    Returns
    -------
    P, Q : ndarray of shape (m, m)
    """
    return _collapsed(start, end)[:2]


def _collapsed(start: Array, end: Array) -> tuple[Array, Array, float]:
    """P and Q, and the factor that the merging has put between their determinants and the flights'.

    With O the orthogonal matrix of which [W1 W2]' is the last m columns, and R of the same
    elimination, the minors of an orthogonal matrix give det W2 = det O det B_1 / det R and
    det W1 = det O det A_2 / det R: det Q is the product of all det B_k times the factor, and
    det P that of all det A_k, without the cancellation of a determinant that is nearly zero.
    """
    factor = 1.0
    while len(start) > 1:
        pairs = len(start) // 2
        first, second = slice(0, 2 * pairs, 2), slice(1, 2 * pairs, 2)
        m = start.shape[1]
        stacked = np.concatenate([end[first], start[second]], axis=1)
        turned, triangle = np.linalg.qr(stacked, mode="complete")
        null = turned[:, :, m:].transpose(0, 2, 1)
        factor *= float(np.prod(np.linalg.det(turned) / np.linalg.det(triangle[:, :m])))
        merged_start = null[:, :, :m] @ start[first]
        merged_end = null[:, :, m:] @ end[second]
        start = np.concatenate([merged_start, start[2 * pairs :]])
        end = np.concatenate([merged_end, end[2 * pairs :]])
    return start[0], end[0], factor


def multipliers(start: Array, end: Array) -> Array:
    """Return the m multipliers of a cycle, largest first.

    Parameters
    ----------
    start, end : ndarray of shape (N, m, m)

    Notes
    -----
    For m = 2 the larger multiplier comes from the collapsed pencil and the smaller from the
    product of all, prod det A_k / det B_k, which keeps its relative accuracy.
    """
    p, q, factor = _collapsed(start, end)
    if p.shape != (2, 2):
        return _general(p, q)
    quadratic = float(np.linalg.det(q))
    if math.isfinite(factor) and factor != 0.0:
        exact = factor * float(np.prod(np.linalg.det(end)))
        quadratic = exact if exact != 0.0 or quadratic == 0.0 else quadratic
    linear = float(p[0, 0] * q[1, 1] + q[0, 0] * p[1, 1] - p[0, 1] * q[1, 0] - q[0, 1] * p[1, 0])
    constant = float(np.linalg.det(p))
    larger_re, larger_im, smaller_re, smaller_im = roots(
        quadratic, linear, constant, determinant(start, end)
    )
    return np.array([complex(larger_re, larger_im), complex(smaller_re, smaller_im)])


def determinant(start: Array, end: Array) -> float:
    """Return the product of all multipliers, prod det A_k / det B_k (m is even).

    Not a number where an impact velocity is zero.
    """
    ratio = 1.0
    numerators, denominators = np.linalg.det(start).tolist(), np.linalg.det(end).tolist()
    for numerator, denominator in zip(numerators, denominators, strict=True):
        if denominator == 0.0:
            return math.nan
        ratio *= numerator / denominator
    return ratio


def count_unstable(values: Array) -> Any:
    """Return how many multipliers lie outside the unit circle, along the last axis."""
    return np.count_nonzero(np.abs(values) > 1.0 + UNIT_CIRCLE_ROUNDING, axis=-1)


def neimark_sacker(start: Array, end: Array) -> float:
    """Return a bounded function that vanishes where two multipliers have the product 1.

    For m = 2 their product D is that of all, and the function is (D - 1)/(D + 1); otherwise it is
    the product of the like over all pairs.
    """
    if start.shape[1:] == (2, 2):
        product = determinant(start, end)
        return (product - 1.0) / (abs(product) + 1.0) if math.isfinite(product) else 1.0
    values = _general(*collapse(start, end))
    result = 1.0 + 0.0j
    for i in range(len(values)):
        for j in range(i):
            if np.isfinite(values[i]) and np.isfinite(values[j]):
                product = values[i] * values[j]
                result *= (product - 1.0) / (1.0 + abs(product))
    return float(result.real)


def _general(p: Array, q: Array) -> Array:
    from scipy.linalg import eigvals

    above, below = eigvals(p, -q, homogeneous_eigvals=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        values = np.where(below == 0.0, np.inf + 0.0j, above / below)
    return np.asarray(values[np.argsort(-np.abs(values))], dtype=complex)
