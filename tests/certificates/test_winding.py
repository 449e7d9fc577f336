"""Multipliers counted along the unit circle."""

from __future__ import annotations

import numpy as np
import pytest

flint = pytest.importorskip("flint", reason="needs contimpact[certify]")

from contimpact.certificates.orbit import count_outside  # noqa: E402


def flights_of(blocks):
    """Flights with these matrices A and B, numbers row by row."""
    size = len(blocks[0][0])
    nothing = [0.0] * size
    return [(nothing, a.ravel().tolist(), b.ravel().tolist(), nothing) for a, b in blocks]


def one_flight(multipliers, rng):
    """(A, B) with these multipliers: where one is infinite, B is singular."""
    basis = rng.normal(size=(len(multipliers),) * 2)
    finite = np.isfinite(multipliers)
    numbers = np.where(finite, multipliers, 1.0), finite.astype(float)
    a, b = (basis @ np.diag(row) @ np.linalg.inv(basis) for row in numbers)
    return -a, b


def two_flights(multipliers, rng):
    a, b = one_flight(multipliers, rng)
    between = rng.normal(size=a.shape)
    return [(a, between), (-between, b)]


@pytest.mark.parametrize(
    ("multipliers", "count"),
    [
        ([0.5, -0.3, 0.0, 0.9], 0),
        ([0.5, -1.3, 0.0, 2.0], 2),
        ([np.inf, 0.2, -0.4, 0.0], 1),
        ([np.inf, 1.01, -0.99, 1e8], 3),
        ([1.0 + 1e-4, 1.0 - 1e-4], 1),
    ],
)
def test_multipliers_outside_are_counted(multipliers, count):
    rng = np.random.default_rng(2)
    with flint.ctx.workprec(128):
        assert count_outside(flights_of([one_flight(multipliers, rng)])) == count
        assert count_outside(flights_of(two_flights(multipliers, rng))) == count


def test_a_pair_counts_twice():
    turn = np.array([[0.0, -1.1], [1.1, 0.0]])
    with flint.ctx.workprec(128):
        assert count_outside(flights_of([(-turn, np.eye(2))])) == 2
        assert count_outside(flights_of([(-turn / 1.21, np.eye(2))])) == 0


def test_one_on_the_circle_is_not_decided():
    with flint.ctx.workprec(128):
        assert count_outside(flights_of([(-np.diag([1.0, 0.5]), np.eye(2))])) is None
