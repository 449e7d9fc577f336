"""The cyclic elimination against dense linear algebra, and 60 digits where flights expand."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from contimpact.continuation.corrector import border_jacobian, scaled_determinant
from contimpact.orbits import status as stability
from contimpact.orbits.block_cyclic import KEPT, eliminate, solve
from contimpact.orbits.status import (
    multipliers_by_elimination,
    product_of_multipliers,
    roots,
    row_norms,
    scale_determinant,
)
from contimpact.segments.segment import ELSEWHERE


def random_cycle(count, rng, growth=1.0):
    """Blocks whose arrivals have the velocities of z, as those of orbits do."""
    z = rng.normal(size=2 * count + 1)
    blocks = rng.normal(size=(count, 12))
    blocks[:, 2:6] *= growth
    blocks[:, 6] = np.roll(z[1::2], -1)[:count]
    return blocks, z


def dense(blocks, mu=1.0):
    """The (n, n + 1) Jacobian, its last coupling multiplied by mu."""
    count = len(blocks)
    matrix = np.zeros((2 * count, 2 * count + 1))
    for k, b in enumerate(blocks):
        rows, after = slice(2 * k, 2 * k + 2), 2 * ((k + 1) % count)
        matrix[rows, 2 * k : 2 * k + 2] += b[2:6].reshape(2, 2)
        end = b[6:10].reshape(2, 2) * (mu if k + 1 == count else 1.0)
        matrix[rows, after : after + 2] += end
        matrix[rows, -1] = b[10:12]
    return matrix


def reduce(blocks, z, right=1.0, exact=False):
    count = len(blocks)
    kept = [[0.0] * KEPT for _ in range(count)]
    tables = [tuple(b) for b in blocks.tolist()]
    found = eliminate(tables, [ELSEWHERE] * count, kept, right, exact, z.tolist(), 2.0)
    return found, kept, tables


@pytest.mark.parametrize("count", [1, 2, 3, 4, 10, 40, 200])
@pytest.mark.parametrize("right", [0.0, 1.0])
def test_solutions_and_determinants_are_those_of_the_dense_matrix(count, right):
    rng = np.random.default_rng(count)
    blocks, z = random_cycle(count, rng)
    row, g, out = rng.normal(size=2 * count + 1), 0.7, [0.0] * (2 * count + 1)
    found, kept, _ = reduce(blocks, z, right)
    det = solve(found, kept, count, row.tolist(), g, out)
    matrix = border_jacobian(dense(blocks), row)
    expected = np.linalg.solve(matrix, np.append(-right * blocks[:, :2].ravel(), g))
    condition = np.linalg.cond(matrix)
    assert np.max(np.abs(np.array(out) - expected)) < 1e-15 * condition * np.max(np.abs(expected))
    sign, logarithm = np.linalg.slogdet(matrix)
    assert math.copysign(1.0, found[12] * det) == sign
    assert found[13] + math.log(abs(det)) == pytest.approx(logarithm, abs=1e-13 * condition)


@pytest.mark.parametrize("count", [1, 2, 3, 10, 40])
def test_scaled_determinants_are_those_of_the_dense_matrix(count):
    rng = np.random.default_rng(100 + count)
    blocks, z = random_cycle(count, rng)
    (p00, p01, p10, p11, q00, q01, q10, q11, *_, sign, logarithm, _), _, tables = reduce(blocks, z)
    doubled = (p00 - q00) * (p11 - q11) - (p01 - q01) * (p10 - q10)
    value = scale_determinant(
        sign, logarithm, doubled, row_norms(tables, count, -1.0, 1.0, 1.0, 0.0)
    )
    assert value == pytest.approx(scaled_determinant(dense(blocks, -1.0)[:, :-1]), rel=1e-10)
    sizes = np.append(np.tile([1.7, 0.3], count), 0.9)
    norms = np.linalg.norm(dense(blocks) * sizes, axis=1)
    found = row_norms(tables, count, 1.0, 1.7, 0.3, 0.9)
    assert found == pytest.approx(float(np.sum(np.log(norms))), abs=1e-12 * count)


@pytest.mark.parametrize("count", [1, 2, 3, 10, 40])
def test_multipliers_are_those_of_the_periodic_pencil(count):
    rng = np.random.default_rng(200 + count)
    for _ in range(20):
        blocks, z = random_cycle(count, rng)
        found, _, tables = reduce(blocks, z, exact=True)
        product = product_of_multipliers(tables, [ELSEWHERE] * count, z.tolist(), 2.0)
        real = np.array(multipliers_by_elimination(found, product)).reshape(2, 2)
        start, end = blocks[:, 2:6].reshape(-1, 2, 2), blocks[:, 6:10].reshape(-1, 2, 2)
        expected = stability.multipliers(start, end)
        assert product == pytest.approx(float(np.prod(expected).real), rel=1e-9)
        order = np.argsort(expected.imag)[::-1] if np.any(expected.imag) else [0, 1]
        apart = np.abs(real[:, 0] + 1j * real[:, 1] - expected[order])
        assert np.all(apart < 1e-9 * np.abs(expected[order]))


@pytest.mark.parametrize("growth", [1e-3, 30.0, 1e3])
@pytest.mark.full
def test_digits_are_kept_where_flights_expand(growth):
    """Forty flights that stretch by up to a thousand each, normwise."""
    rng = np.random.default_rng(7)
    count = 40
    blocks, z = random_cycle(count, rng, growth)
    row, out = rng.normal(size=2 * count + 1), [0.0] * (2 * count + 1)
    found, kept, _ = reduce(blocks, z)
    solve(found, kept, count, row.tolist(), 0.3, out)
    matrix, right = border_jacobian(dense(blocks), row), np.append(-blocks[:, :2].ravel(), 0.3)
    with mp.workdps(60):
        exact = mp.lu_solve(mp.matrix(matrix.tolist()), mp.matrix(right.tolist()))
        expected = np.array([float(x) for x in exact])
    dense_error = np.max(np.abs(np.linalg.solve(matrix, right) - expected))
    error = np.max(np.abs(np.array(out) - expected))
    assert error <= 20.0 * dense_error + 1e-13 * np.max(np.abs(expected))


def test_what_cannot_be_eliminated_has_no_solution():
    blocks, z = random_cycle(3, np.random.default_rng(3))
    blocks[0, 6:10] = 0.0
    blocks[1, 2:6] = 0.0  # nothing holds the second impact
    found, kept, _ = reduce(blocks, z)
    assert found[12] == 0.0
    assert solve(found, kept, 3, [1.0] * 7, 1.0, [0.0] * 7) == 0.0


@pytest.mark.parametrize(
    ("quadratic", "linear", "constant", "product", "expected"),
    [
        (1.0, -3.0, 2.0, math.nan, (2.0, 0.0, 1.0, 0.0)),
        (1.0, -3.0, 2.0, 2.0, (2.0, 0.0, 1.0, 0.0)),
        (1.0, 0.0, 1.0, 1.0, (0.0, 1.0, 0.0, -1.0)),
        (0.0, -3.0, 6.0, math.nan, (math.inf, 0.0, 2.0, 0.0)),
        (0.0, 0.0, 0.0, math.nan, (0.0, 0.0, 0.0, 0.0)),
        (1e-20, -1.0, 1e-20, 1.0, (1e20, 0.0, 1e-20, 0.0)),
    ],
)
def test_roots(quadratic, linear, constant, product, expected):
    assert roots(quadratic, linear, constant, product) == pytest.approx(expected, rel=1e-15)
