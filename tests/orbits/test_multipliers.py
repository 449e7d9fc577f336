"""Multipliers and determinants of block cycles against products of matrices in mpmath."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest

from contimpact.continuation.corrector import scaled_determinant
from contimpact.orbits import status as stability
from contimpact.orbits.search import find_orbits

EPS = 2.0**-52


def gentle_blocks(rng, count, m):
    """End blocks of condition one and start blocks such that each flight is 1 + 0.1 noise."""
    end = np.linalg.qr(rng.normal(size=(count, m, m)))[0]
    return -end @ (np.eye(m) + 0.1 * rng.normal(size=(count, m, m))), end


def exact_multipliers(start, end):
    """Eigenvalues of the product of -B_k^{-1} A_k, largest first, at 150 digits."""
    with mp.workdps(150):
        m = start.shape[1]
        product = mp.eye(m)
        for a, b in zip(start.tolist(), end.tolist(), strict=True):
            product = -(mp.matrix(b) ** -1) * mp.matrix(a) * product
        if m == 2:
            (a, b), (c, d) = product.tolist()
            half, root = (a + d) / 2, mp.sqrt(mp.mpc(((a - d) / 2) ** 2 + b * c))
            values = [half + root, half - root]
        else:
            values = list(mp.eig(product, left=False, right=False))
        return sorted(values, key=lambda value: -abs(value))


def distance(one, other):
    """Chordal distance: a relative one for small and large multipliers alike, at most 1."""
    if not np.isfinite(one) or mp.isinf(other):
        finite = other if not np.isfinite(one) else mp.mpc(complex(one))
        return 0.0 if mp.isinf(finite) else float(1 / mp.sqrt(1 + abs(finite) ** 2))
    one = mp.mpc(complex(one))
    return float(abs(one - other) / mp.sqrt((1 + abs(one) ** 2) * (1 + abs(other) ** 2)))


def worst_match(found, exact):
    """Largest distance from a value in one list to the nearest in the other, both ways."""
    there = max(min(distance(f, e) for e in exact) for f in found)
    back = max(min(distance(f, e) for f in found) for e in exact)
    return max(there, back)


def relative(found, exact):
    return float(abs(mp.mpc(complex(found)) / exact - 1))


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 31, 200])
@pytest.mark.parametrize("m", [2, 4])
@pytest.mark.quick(8)
def test_well_conditioned_cycles(m, count):
    """Measured, up to 200 flights: 3.8e-14, next to a double multiplier; else 1e-14."""
    rng = np.random.default_rng(count)
    for _ in range(20 if count < 30 else 2):
        start, end = gentle_blocks(rng, count, m)
        found = stability.multipliers(start, end)
        assert found.shape == (m,)
        assert found.dtype == complex
        assert worst_match(found, exact_multipliers(start, end)) < 2e-13
        assert np.all(np.diff(np.abs(found)) <= 1e-13 * np.abs(found[0]))


@pytest.mark.parametrize("count", [1, 2, 3, 5])
@pytest.mark.parametrize("m", [2, 4])
@pytest.mark.quick(2)
def test_random_cycles(m, count):
    """Blocks with entries from a normal distribution, some of them close to singular.

    Measured over 480 draws: 1.3e-12 in the chordal distance.
    """
    rng = np.random.default_rng(100 + count)
    for _ in range(20):
        start, end = rng.normal(size=(2, count, m, m))
        found = stability.multipliers(start, end)
        assert worst_match(found, exact_multipliers(start, end)) < 1e-11


def test_complex_pair():
    """A rotation by an angle, shrunk: multipliers 0.9 e^(+-i)."""
    rotation = 0.9 * np.array([[math.cos(1), -math.sin(1)], [math.sin(1), math.cos(1)]])
    found = stability.multipliers(-rotation[None], np.eye(2)[None])
    assert found[0] == found[1].conjugate()
    assert found[0] == pytest.approx(0.9 * complex(math.cos(1), math.sin(1)), abs=1e-15)


@pytest.mark.parametrize("turns", [2, 3, 10, 100])
def test_repeated_flights(pair, kernels_of, turns):
    """Powers of a stable orbit's multipliers, both to a relative error.

    The smaller one is 1e-207 after a hundred turns; measured: 6.0e-14 for either.
    """
    (orbit, _) = find_orbits(pair(d=0.242), "1:1", kernels=kernels_of(pair(), "s"))
    here = orbit.linearisation
    found = stability.multipliers(
        np.tile(here.start, (turns, 1, 1)), np.tile(here.end, (turns, 1, 1))
    )
    for value, once in zip(found, exact_multipliers(here.start, here.end), strict=True):
        assert relative(value, once**turns) < 5e-15 * (turns + 1)


@pytest.mark.parametrize("turns", [2, 4, 8, 20])
def test_huge_multipliers(pair, kernels_of, turns):
    """Powers of 289.125 and 2.5e-6, up to 1e49 and 1e-112; measured: 1.3e-12 relative."""
    saddle = find_orbits(pair(d=0.205), "2:1", kernels=kernels_of(pair(), "s"))[0]
    here = saddle.linearisation
    found = stability.multipliers(
        np.tile(here.start, (turns, 1, 1)), np.tile(here.end, (turns, 1, 1))
    )
    for value, once in zip(found, exact_multipliers(here.start, here.end), strict=True):
        assert relative(value, once**turns) < 1e-11


@pytest.mark.parametrize(
    ("word", "d"), [("1:1", 0.242), ("1:1", 0.205), ("2:1", 0.205), ("1:1/2T", 0.233)]
)
def test_multipliers_of_orbits(pair, kernels_of, word, d):
    """Both multipliers of every orbit, 289 and 2.5e-6 next to the grazing among them.

    Measured: 7e-16 relative where |mu| < 2; the larger one loses up to eps |mu| (2.8e-13 at 289),
    and the smaller with it, since their product is kept.
    """
    found = find_orbits(pair(d=d), word, kernels=kernels_of(pair(), "s"))
    assert found
    if (word, d) == ("2:1", 0.205):
        assert max(abs(orbit.multipliers[0]) for orbit in found) == pytest.approx(289.0, abs=0.5)
    for orbit in found:
        here = orbit.linearisation
        exact = exact_multipliers(here.start, here.end)
        bound = 2e-15 + 20 * EPS * float(abs(exact[0]))
        assert all(relative(f, e) < bound for f, e in zip(here.multipliers, exact, strict=True))


@pytest.mark.parametrize("m", [2, 4])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_singular_end_block(m, count):
    """An impact without velocity: one multiplier is infinite, the others are right."""
    rng = np.random.default_rng(200)
    for place in range(count):
        start, end = gentle_blocks(rng, count, m)
        end[place, :, 0] = 0.0
        found = stability.multipliers(start, end)
        # Backwards in time the infinite multiplier is zero.
        backwards = exact_multipliers(end[::-1], start[::-1])
        assert abs(backwards[-1]) < 1e-100
        exact = [1 / value for value in backwards[:-1]] + [mp.inf]
        assert abs(found[0]) > 1e13
        assert worst_match(found, exact) < 1e-13
        assert stability.count_unstable(found) >= 1
        assert math.isnan(stability.determinant(start, end))


def test_end_block_with_a_zero_column_gives_infinity():
    """The larger multiplier is infinite, exactly, and the smaller is kept."""
    start, end = -np.eye(2)[None], np.array([[[0.0, 0.0], [0.0, 4.0]]])
    np.testing.assert_array_equal(stability.multipliers(start, end), [math.inf, 0.25])
    assert stability.count_unstable(stability.multipliers(start, end)) == 1


@pytest.mark.parametrize("m", [2, 4])
def test_singular_start_block(m):
    """A restitution of zero: one multiplier is zero."""
    rng = np.random.default_rng(300)
    start, end = gentle_blocks(rng, 3, m)
    start[1, :, 0] = 0.0
    found = stability.multipliers(start, end)
    assert abs(found[-1]) < 1e-14
    assert worst_match(found[:-1], exact_multipliers(start, end)[:-1]) < 1e-13
    assert abs(stability.determinant(start, end)) < 1e-15


def test_all_multipliers_zero():
    zero = np.zeros((1, 2, 2))
    np.testing.assert_array_equal(stability.multipliers(zero, np.eye(2)[None]), [0.0, 0.0])


def test_determinant():
    """Measured: 9e-14 relative for random blocks."""
    rng = np.random.default_rng(400)
    for count in (1, 4, 50):
        start, end = rng.normal(size=(2, count, 2, 2))
        with mp.workdps(60):
            exact = mp.mpf(1)
            for a, b in zip(start.tolist(), end.tolist(), strict=True):
                exact *= mp.det(mp.matrix(a)) / mp.det(mp.matrix(b))
            assert abs(stability.determinant(start, end) / exact - 1) < 2e-12


def test_collapse_keeps_the_pencil():
    """P + mu Q is singular where the cyclic matrix is, at multipliers of any cycle."""
    rng = np.random.default_rng(500)
    for count in (1, 2, 3, 7):
        start, end = gentle_blocks(rng, count, 2)
        p, q, _, _ = stability.collapse(start, end)
        assert p.shape == q.shape == (2, 2)
        for value in exact_multipliers(start, end):
            pencil = p + complex(value) * q
            assert np.linalg.svd(pencil)[1][-1] < 1e-14 * np.linalg.norm(pencil)


def test_inputs_are_left_alone():
    start, end = np.random.default_rng(600).normal(size=(2, 5, 2, 2))
    copies = start.copy(), end.copy()
    stability.multipliers(start, end)
    torus(start, end)
    np.testing.assert_array_equal(start, copies[0])
    np.testing.assert_array_equal(end, copies[1])


@pytest.mark.parametrize(
    ("values", "count"),
    [
        ([0.5, -0.9], 0),
        ([1.0, -1.0], 0),
        ([1.0 + 1e-11, 0.0], 0),
        ([1.0 + 1e-9, 0.0], 1),
        ([-1.1, 0.3], 1),
        ([complex(0.8, 0.8), complex(0.8, -0.8)], 2),
        ([math.inf, 0.1], 1),
        ([complex(math.inf, 0.0), -2.0, 3.0, 0.0], 3),
    ],
)
def test_count_unstable(values, count):
    assert stability.count_unstable(np.array(values)) == count


def cycle_with(values):
    """One flight with the given real multipliers, in a basis that is not orthogonal."""
    rng = np.random.default_rng(700)
    basis = np.eye(len(values)) + 0.2 * rng.normal(size=(len(values),) * 2)
    product = basis @ np.diag(values) @ np.linalg.inv(basis)
    end = rng.normal(size=product.shape)
    return -(end @ product)[None], end[None]


def torus(start, end):
    return float(stability.neimark_sacker(stability.stability_of(start, end).products))


@pytest.mark.parametrize("m", [2, 4, 6])
@pytest.mark.parametrize("count", [1, 2, 3, 8, 40])
def test_the_determinant_of_a_doubling_is_that_of_the_dense_matrix(m, count):
    start, end = gentle_blocks(np.random.default_rng(900 + count), count, m)
    matrix = np.zeros((count, m, count, m))
    for k in range(count):
        matrix[k, :, k] += start[k]
        matrix[k, :, (k + 1) % count] += end[k] if k + 1 < count else -end[k]
    expected = scaled_determinant(matrix.reshape(count * m, count * m))
    assert stability.stability_of(start, end).doubling == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("others", [[], [0.3, 0.7], [5.0, -0.01]])
def test_neimark_sacker_vanishes_where_a_product_is_one(others):
    """Positive on one side, negative on the other, zero to rounding between."""
    at = [torus(*cycle_with([2.0, x, *others])) for x in (0.4, 0.5, 0.6)]
    assert abs(at[1]) < 1e-13
    assert at[0] * at[2] < 0.0


def test_neimark_sacker_is_finite_at_a_singular_block():
    start, end = gentle_blocks(np.random.default_rng(800), 3, 2)
    end[1, :, 0] = 0.0
    assert math.isfinite(torus(start, end))


ORDERED = np.array([3.0, 2.0j, -2.0j, -2.0, 0.8 + 0.6j, 0.8 - 0.6j, -0.6 + 0.8j, -0.6 - 0.8j, 0.5])


@pytest.mark.parametrize("seed", range(20))
def test_rounding_has_no_part_in_the_order(seed):
    """By absolute value; of one absolute value by the angle, each before its conjugate."""
    rng = np.random.default_rng(seed)
    noise = 1.0 + 1e-14 * rng.normal(size=len(ORDERED))
    noise[[2, 5, 7]] = noise[[1, 4, 6]]
    found = stability.order_multipliers(rng.permutation(ORDERED * noise))
    assert found == pytest.approx(ORDERED, rel=1e-13)


@pytest.mark.parametrize("seed", range(5))
def test_a_denominator_that_is_rounding_gives_infinity(seed):
    """Q lacks one rank but for rounding, of which the smallest denominator consists."""
    rng = np.random.default_rng(seed)
    p, (left, right) = rng.normal(size=(4, 4)), np.linalg.qr(rng.normal(size=(2, 4, 4)))[0]
    for rounded in (0.0, 1e-17, 1e-16, -1e-15):
        values = stability.pencil_multipliers(p, left @ np.diag([1.0, 0.7, 0.2, rounded]) @ right)
        assert np.isinf(values[0])
        assert np.all(np.isfinite(values[1:]))


@pytest.mark.parametrize("count", [1, 3])
def test_units_that_lie_far_apart_change_no_digit(count):
    """As of times in nanoseconds beside velocities in metres per second, by powers of two."""
    start, end = gentle_blocks(np.random.default_rng(5), count, 4)
    units = 2.0 ** np.array([-30, 0, 30, 1])
    found = stability.multipliers(start * units, end * units)
    assert found.tolist() == stability.multipliers(start, end).tolist()
    assert worst_match(found, exact_multipliers(start, end)) < 1e-14
