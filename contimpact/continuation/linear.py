"""Square linear systems: dense for short problems, sparse LU with partial pivoting for long ones.

The matrices are cyclic chains of small blocks with a few full columns or rows. An elimination along
the chain without pivoting would lose all digits where flights expand; SuperLU pivots.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .problem import Array

if TYPE_CHECKING:
    from scipy.sparse.linalg import SuperLU

DENSE_UP_TO = 400
"""Rows up to which dense elimination is the faster one, the conversion counted."""


def solve(matrix: Array, right: Array) -> Array:
    """Solve a square system.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is exactly singular.
    """
    if len(matrix) <= DENSE_UP_TO:
        return np.asarray(np.linalg.solve(matrix, right))
    return np.asarray(_factors(matrix).solve(right))


def log_determinant(matrix: Array) -> tuple[float, float]:
    """Return sign and logarithm of the absolute value of a determinant."""
    if len(matrix) <= DENSE_UP_TO:
        sign, logarithm = np.linalg.slogdet(matrix)
        return float(sign), float(logarithm)
    try:
        factors = _factors(matrix)
    except np.linalg.LinAlgError:
        return 0.0, -np.inf
    diagonal = factors.U.diagonal()
    sign = np.prod(np.sign(diagonal)) * _parity(factors.perm_r) * _parity(factors.perm_c)
    return float(sign), float(np.sum(np.log(np.abs(diagonal))))


def _factors(matrix: Array) -> SuperLU:
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu

    try:
        return splu(csc_matrix(matrix))
    except RuntimeError as error:  # SuperLU's word for exactly singular
        raise np.linalg.LinAlgError(str(error)) from None


def _parity(permutation: Array) -> int:
    """+1 for an even permutation, -1 for an odd one."""
    places, seen, sign = permutation.tolist(), set(), 1
    for first in range(len(places)):
        length, here = 0, first
        while here not in seen:
            seen.add(here)
            here = places[here]
            length += 1
        sign *= -1 if length and length % 2 == 0 else 1
    return sign
