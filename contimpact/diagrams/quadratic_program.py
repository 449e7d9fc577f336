r"""A convex quadratic program with elastic constraints, by a primal-dual interior point method.

.. math:: \min_x c^T x + \tfrac12 x^T H x + \rho \sum_i \max(0, -(a_i + b_i^T x)), \quad
          l \le x \le u,

has a feasible interior whatever the constraints are, so that the predictor-corrector method of
Mehrotra (Nocedal and Wright 2006, section 16.6) needs no start of its own.
"""

from __future__ import annotations

import numpy as np

from ..arrays import Array

ITERATIONS = 100
GAP = 1e-18
"""Mean product of a slack and its price, in parts of the largest coefficient, where it ends."""
INSIDE = 0.995
"""Part of the way to the next boundary that is gone at most."""
ON = 1e-9
"""A variable nearer to a bound, in parts of the range, lies on it."""


def least_quadratic(
    slope: Array,
    hessian: Array,
    penalty: float,
    constraints: tuple[Array, Array],
    bounds: tuple[Array, Array],
) -> tuple[Array, float]:
    """Return where the sum is least, and the sum there.

    Parameters
    ----------
    slope, hessian : ndarray
        c and H, which is positive definite.
    penalty : float
        Of a violated constraint.
    constraints : tuple of ndarray
        Values a at zero, and slopes b, a row for each.
    bounds : tuple of ndarray
        Below and above, which differ; zero is within.
    """
    at_zero, rows = constraints
    low, high = bounds
    reach = np.abs(rows) @ np.maximum(-low, high)
    bent = np.abs(at_zero) < reach  # all others are satisfied, or violated, on the whole box
    pulled = slope - penalty * np.sum(rows[~bent & (at_zero < 0.0)], axis=0)
    n, m, widths = len(slope), int(np.sum(bent)), high - low
    least_part, most_part, reach = low / widths, high / widths, reach[bent]
    quadratic = np.zeros((n + m, n + m))
    quadratic[:n, :n] = hessian * np.outer(widths, widths)
    linear = np.concatenate([widths * pulled, penalty * reach])
    identity = np.eye(n + m)
    scaled = np.hstack([rows[bent] * widths / reach[:, None], np.eye(m)])
    matrix = np.vstack([scaled, identity, -identity[:n]])
    least = np.concatenate([-at_zero[bent] / reach, least_part, np.zeros(m), -most_part])
    size = max(float(np.max(np.abs(linear))), float(np.max(np.abs(quadratic))))
    z = _interior_point(quadratic / size, linear / size, matrix, least)[:n]
    z = np.where(z - least_part < ON, least_part, z)
    x = np.clip(np.where(most_part - z < ON, most_part, z) * widths, low, high)

    def total(x: Array) -> float:
        violated = np.maximum(0.0, -(at_zero + rows @ x))
        return float(slope @ x + 0.5 * x @ hessian @ x + penalty * np.sum(violated))

    return min(((x, total(x)), (0.0 * x, total(0.0 * x))), key=lambda found: found[1])


def _interior_point(quadratic: Array, linear: Array, matrix: Array, least: Array) -> Array:
    """Where a quadratic function is least among the points with ``matrix @ z >= least``."""
    z, count = np.zeros(len(linear)), len(least)
    slack, prices = np.maximum(1.0, np.abs(matrix @ z - least)), np.ones(count)
    for _ in range(ITERATIONS):
        off = quadratic @ z + linear - matrix.T @ prices
        short = matrix @ z - least - slack
        mean = float(slack @ prices) / count
        if mean < GAP:
            break
        system = quadratic + (matrix.T * (prices / slack)) @ matrix
        given = matrix, system, off, short, slack, prices
        try:
            _, wider, dearer = _direction(-slack * prices, *given)
            far = min(_room(slack, wider), _room(prices, dearer))
            centre = ((slack + far * wider) @ (prices + far * dearer) / count / mean) ** 3
            products = centre * mean - slack * prices - wider * dearer
            step, wider, dearer = _direction(products, *given)
        except np.linalg.LinAlgError:  # slacks have vanished to rounding
            break
        far = min(1.0, INSIDE * min(_room(slack, wider, 2.0), _room(prices, dearer, 2.0)))
        z, slack, prices = z + far * step, slack + far * wider, prices + far * dearer
    return z


def _direction(
    products: Array, matrix: Array, system: Array, off: Array, short: Array, slack: Array,
    prices: Array,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """The steps of the point, the slacks and the prices that change the products so."""
    pulled = matrix.T @ ((products - prices * short) / slack)
    step = np.linalg.solve(system, pulled - off)
    wider = matrix @ step + short
    return step, wider, (products - prices * wider) / slack


def _room(values: Array, step: Array, most: float = 1.0) -> float:
    """How much of a step leaves values positive."""
    falling = step < 0.0
    return float(np.min(-values[falling] / step[falling], initial=most))
