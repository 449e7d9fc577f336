"""The quadratic programs of designs against the conditions of their minima, and vertices."""

from __future__ import annotations

import numpy as np
import pytest

from contimpact.diagrams.quadratic_program import least_quadratic


def gap(slope, hessian, penalty, constraints, bounds, x):
    """By how much the sum at x is above a lower bound, the dual's value at the best prices."""
    from scipy.optimize import lsq_linear

    (values, rows), (low, high) = constraints, bounds
    at = values + rows @ x
    near = 1e-7 * (np.abs(rows) @ (high - low) + np.abs(values))
    prices = np.where(at < 0.0, penalty, 0.0)
    free = np.abs(at) < near
    inside = (x - low > 1e-7 * (high - low)) & (high - x > 1e-7 * (high - low))
    rise = slope + hessian @ x
    if np.any(free) and np.any(inside):
        wanted = (rise - prices @ rows)[inside] + prices[free] @ rows[free][:, inside]
        prices[free] = lsq_linear(rows[free][:, inside].T, wanted, (0.0, penalty)).x
    pull = rise - prices @ rows
    # of a convex function, the tangent at x bounds the dual's minimum over the box from below
    total = penalty * np.sum(np.maximum(0.0, -at)) + prices @ at
    return float(total - np.sum(np.minimum(pull * (low - x), pull * (high - x))))


@pytest.mark.parametrize("seed", range(6))
def test_the_sum_is_least(seed):
    """The duality gap bounds the error, from radii of 1e-6 to 1/2, and penalties up to 1e4."""
    rng = np.random.default_rng(seed)
    for _ in range(50):
        n, m = rng.integers(1, 5), rng.integers(0, 5)
        root = rng.normal(size=(n, n)) * 10 ** rng.uniform(-2, 1)
        hessian = root @ root.T + 1e-3 * np.eye(n)
        slope, penalty = rng.normal(size=n), 10 ** rng.uniform(0, 4)
        radius = 10 ** rng.uniform(-6, -0.3)
        constraints = (
            radius * rng.normal(size=m) * 10 ** rng.uniform(-2, 2),
            rng.normal(size=(m, n)),
        )
        low = np.where(rng.uniform(size=n) < 0.3, 0.0, -radius)
        high = np.where((low < 0.0) & (rng.uniform(size=n) < 0.3), 0.0, radius)
        program = slope, hessian, penalty, constraints, (low, high)
        x, total = least_quadratic(*program)
        assert np.all((low <= x) & (x <= high))
        short = np.maximum(0.0, -(constraints[0] + constraints[1] @ x))
        given = slope @ x + 0.5 * x @ hessian @ x + penalty * np.sum(short)
        assert total == pytest.approx(given, rel=1e-12, abs=1e-14)
        assert gap(*program, x) < 1e-8 * penalty * radius


def test_bounds_are_reached_exactly_and_a_minimum_inside_is_one():
    box = np.array([0.0, -0.1]), np.array([0.1, 0.1])
    none = np.zeros(0), np.zeros((0, 2))
    x, total = least_quadratic(np.array([-1.0, 0.02]), np.eye(2), 1.0, none, box)
    assert x[0] == 0.1
    assert x[1] == pytest.approx(-0.02, abs=1e-8)
    assert total == pytest.approx(-0.1 + 0.005 - 0.0002, abs=1e-12)


def test_what_cannot_be_satisfied_costs_its_penalty():
    """x >= 1 and -x >= 0 cannot both hold within 0.1; the dearer way is left."""
    constraints = np.array([-1.0, 0.0]), np.array([[3.0], [-1.0]])
    box = np.array([-0.1]), np.array([0.1])
    x, total = least_quadratic(np.array([0.5]), np.eye(1), 10.0, constraints, box)
    assert x[0] == 0.1
    assert total == pytest.approx(0.05 + 0.005 + 10.0 * (0.7 + 0.1))
