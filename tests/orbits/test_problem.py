"""The orbit problem: residual, Jacobian and second derivatives of whole words, and invariants."""

from __future__ import annotations

import importlib.util
import math

import mpmath as mp
import numpy as np
import pytest
from zoo import ROOT, unknowns_of

from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import find_orbits, mirror_orbit, repeats, rotate_to_word
from contimpact.results.catalogue import load_diagram

PAIR_WORDS = ["B", "T/2T", "BT", "BBT", "BTBT/2T", "BBTBTT/3T"]
OSCILLATOR_WORDS = ["S", "S/2T", "SS/3T"]


def random_point(problem, seed, value=None):
    """Times in order over the orbit's span, velocities of order one."""
    rng = np.random.default_rng(seed)
    n = len(problem.word)
    period = problem.kernels.setup(*problem.model.values.values()).period
    times = rng.uniform(0, period) + np.sort(rng.uniform(0, problem.word.period * period, n))
    return unknowns_of(problem, times, rng.normal(size=n), value)


def cases(pair, oscillator, problem_of):
    """(name, problem) with the impact pair in A and the oscillator in omega, on which T depends."""
    for word in PAIR_WORDS:
        yield f"pair {word}", problem_of(pair(), word, "A")
    yield "two restitutions", problem_of(pair(r_B=0.2, r_T=0.9), "BBTT", "r_T")
    for c in (0.1, 2.0):
        for word in OSCILLATOR_WORDS:
            yield f"oscillator c={c} {word}", problem_of(oscillator(c=c), word, "omega")


def curves(pair, oscillator, problem_of):
    """Two free parameters; T depends on none of them or on the second."""
    yield "pair A, r", problem_of(pair(), "BBT", "A", "r")
    yield "oscillator sigma, omega", problem_of(oscillator(c=0.1), "S/2T", "sigma", "omega")


class ExactOrbit:
    """The residual of a word in mpmath; the last arrival can be moved on its own."""

    def __init__(self, exact, problem):
        self.exact, self.problem = exact, problem

    def residual(self, z, first_arrival=None):
        problem, rows = self.problem, []
        changes = dict(zip(problem.kernels.parameters, z[problem.n :], strict=True))
        period = 2 * mp.pi / changes["omega"] if "omega" in changes else mp.mpf(2)
        impacts = [z[i : i + 2] for i in range(0, problem.n, 2)]
        t, v = impacts[0] if first_arrival is None else first_arrival
        arrivals = [*impacts[1:], [t + problem.word.period * period, v]]
        for kind, start, end in zip(problem.kinds, impacts, arrivals, strict=True):
            rows += self.exact(problem.model, *kind, (*start, *end), changes)[0]
        return rows

    def along(self, z, q, mu, step):
        """The residual a step along q, the last arrival moving by mu q_1."""
        moved = [x + step * y for x, y in zip(z, q, strict=True)]
        return self.residual(moved, [z[i] + step * mu * q[i] for i in range(2)])

    def slope(self, z, q, mu=1):
        h = mp.mpf(10) ** -20
        ahead, behind = self.along(z, q, mu, h), self.along(z, q, mu, -h)
        return [(a - b) / (2 * h) for a, b in zip(ahead, behind, strict=True)]

    def jacobian(self, z):
        return np.array([self.slope(z, unit) for unit in identity(len(z))], dtype=float).T

    def second(self, z, q, mu):
        h = mp.mpf(10) ** -14
        columns = []
        for unit in identity(len(z)):
            corners = [
                self.along([x + a * h * e for x, e in zip(z, unit, strict=True)], q, mu, b * h)
                for a in (1, -1)
                for b in (1, -1)
            ]
            columns.append(
                [(p - q - r + s) / (4 * h * h) for p, q, r, s in zip(*corners, strict=True)]
            )
        return np.array(columns, dtype=float).T


def identity(n):
    return [[mp.mpf(int(i == j)) for j in range(n)] for i in range(n)]


def in_mp(vector):
    return [mp.mpf(x) for x in vector.tolist()]


def row_error(matrix, expected):
    """Largest error of each row as a part of its largest entry; the worst row."""
    largest = np.max(np.abs(expected), axis=1, keepdims=True)
    return np.max(np.abs(matrix - expected) / largest)


# Derivatives


def test_residual(pair, oscillator, problem_of, exact):
    """Measured: 1.0e-15 absolute, where times and velocities are of order one."""
    for name, problem in cases(pair, oscillator, problem_of):
        z = random_point(problem, seed=1)
        expected = np.array(ExactOrbit(exact, problem).residual(in_mp(z)), dtype=float)
        np.testing.assert_allclose(
            problem.evaluate(z).residual, expected, rtol=0, atol=1e-14, err_msg=name
        )


def test_jacobian(pair, oscillator, problem_of, exact):
    """Measured: 7.4e-15 of the largest entry in the row."""
    for name, problem in cases(pair, oscillator, problem_of):
        for seed in (2, 3):
            z = random_point(problem, seed)
            matrix = problem.evaluate(z).jacobian
            assert matrix.shape == (problem.n, problem.n + 1), name
            assert row_error(matrix, ExactOrbit(exact, problem).jacobian(in_mp(z))) < 1e-13, name


@pytest.mark.full
def test_two_free_parameters(pair, oscillator, problem_of, exact):
    """Jacobian and its derivative along a direction, with a column for each parameter."""
    for name, problem in curves(pair, oscillator, problem_of):
        n = problem.n
        z = random_point(problem, 18)
        assert z.shape == (n + 2,)
        assert z[n:].tolist() == [problem.model.values[p] for p in problem.kernels.parameters]
        reference = ExactOrbit(exact, problem)
        matrix = problem.evaluate(z).jacobian
        assert matrix.shape == (n, n + 2)
        assert row_error(matrix, reference.jacobian(in_mp(z))) < 1e-13, name
        q = np.random.default_rng(19).normal(size=n + 2)
        for mu in (1.0, -1.0):
            q[n:] *= mu == 1.0
            second = problem.second_along(z, q, mu)
            assert second.shape == (n, n + 2)
            assert row_error(second, reference.second(in_mp(z), in_mp(q), mu)) < 1e-11, name
        assert list(problem.model_at(z * 1.25).values.values()) == problem.values(z * 1.25)
        assert not np.any(problem.evaluate(z).cyclic(-1.0)[:, n:])


def test_jacobian_away_from_the_models_own_value(oscillator, problem_of, exact):
    problem = problem_of(oscillator(c=0.1, omega=3.7), "SS/3T", "omega")
    z = random_point(problem, seed=4, value=1.3)
    matrix = problem.evaluate(z).jacobian
    assert row_error(matrix, ExactOrbit(exact, problem).jacobian(in_mp(z))) < 1e-13
    assert problem.model_at(z).values["omega"] == 1.3
    assert problem.model.values["omega"] == 3.7
    assert problem.values(z)[1] == 1.3


@pytest.mark.parametrize("mu", [1.0, -1.0, 0.3])
def test_cyclic_matrix(pair, oscillator, problem_of, exact, mu):
    """The last coupling times mu; the parameter's column is zero."""
    for name, problem in cases(pair, oscillator, problem_of):
        z = random_point(problem, seed=5)
        here = problem.evaluate(z)
        matrix = here.cyclic(mu)
        rng = np.random.default_rng(6)
        q = np.append(rng.normal(size=problem.n), 0.0)
        expected = ExactOrbit(exact, problem).slope(in_mp(z), in_mp(q), mu)
        largest = np.max(np.abs(matrix), axis=1)
        assert np.max(np.abs(matrix @ q - np.array(expected, dtype=float)) / largest) < 2e-13, name
        assert not np.any(matrix[:, -1])
        if mu == 1.0:
            np.testing.assert_array_equal(matrix[:, :-1], here.jacobian[:, :-1])


@pytest.mark.parametrize("mu", [1.0, -1.0])
def test_second_along(pair, oscillator, problem_of, exact, mu):
    """Measured: 2.2e-12 of the largest entry in the row."""
    for name, problem in cases(pair, oscillator, problem_of):
        if name == "two restitutions":
            continue
        z = random_point(problem, seed=7)
        q = np.random.default_rng(8).normal(size=problem.n + 1)
        if mu != 1.0:
            q[-1] = 0.0
        matrix = problem.second_along(z, q, mu)
        expected = ExactOrbit(exact, problem).second(in_mp(z), in_mp(q), mu)
        assert matrix.shape == (problem.n, problem.n + 1), name
        assert row_error(matrix, expected) < 1e-11, name


def test_second_along_is_the_jacobians_derivative(oscillator, problem_of):
    """Central differences with step h: their own error is h^2 and eps/h, 1e-9 at h = 1e-5."""
    problem = problem_of(oscillator(c=0.1), "SS/3T", "omega")
    z, q = random_point(problem, 9), np.random.default_rng(9).normal(size=problem.n + 1)
    h = 1e-5
    difference = (problem.evaluate(z + h * q).jacobian - problem.evaluate(z - h * q).jacobian) / (
        2 * h
    )
    assert row_error(problem.second_along(z, q), difference) < 1e-7


def test_second_along_is_linear_in_the_direction(pair, problem_of):
    problem = problem_of(pair(), "BBT", "A")
    z = random_point(problem, 10)
    p, q = np.random.default_rng(10).normal(size=(2, problem.n + 1))
    combined = problem.second_along(z, 2 * p - 3 * q)
    parts = 2 * problem.second_along(z, p) - 3 * problem.second_along(z, q)
    np.testing.assert_allclose(combined, parts, rtol=0, atol=1e-12 * np.max(np.abs(parts)))
    # Second derivatives commute.
    np.testing.assert_allclose(
        problem.second_along(z, p) @ q, problem.second_along(z, q) @ p, rtol=1e-12
    )


# Blocks


def test_blocks_and_where_they_stand(pair, problem_of):
    problem = problem_of(pair(), "BBT", "A")
    here = problem.evaluate(random_point(problem, 11))
    full = np.zeros((6, 7))
    for k in range(3):
        full[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = here.start[k]
        j = (2 * k + 2) % 6
        full[2 * k : 2 * k + 2, j : j + 2] = here.end[k]
    full[:, 6:] = here.by_parameter
    np.testing.assert_array_equal(here.jacobian, full)


def test_one_impact_adds_both_blocks(pair, problem_of):
    problem = problem_of(pair(), "B", "A")
    here = problem.evaluate(random_point(problem, 12))
    np.testing.assert_array_equal(here.jacobian[:, :2], here.start[0] + here.end[0])
    np.testing.assert_array_equal(here.cyclic(-1.0)[:, :2], here.start[0] - here.end[0])


@pytest.mark.parametrize("text", ["100:100", "200:0", "1:1/100T", "BBT" * 66 + "/66T", "3:2/40T"])
@pytest.mark.quick(1)
def test_long_words(pair, problem_of, text):
    """Two hundred impacts: evaluated once per flight, banded but for one corner, regular."""
    problem = problem_of(pair(), text, "A")
    n = len(problem.word)
    before = problem.kernel_evaluations
    here = problem.evaluate(random_point(problem, 13))
    assert problem.kernel_evaluations - before == n
    assert here.jacobian.shape == (2 * n, 2 * n + 1)
    assert here.residual.shape == (2 * n,)
    assert np.all(np.isfinite(here.jacobian))
    rows, columns = np.nonzero(here.jacobian[:, :-1])
    distance = (columns // 2 - rows // 2) % n
    assert set(distance.tolist()) == {0, 1}
    assert np.linalg.matrix_rank(here.jacobian) == 2 * n


def test_longest_word(pair, problem_of):
    problem = problem_of(pair(), "500:500", "A")
    assert problem.evaluate(random_point(problem, 14)).jacobian.shape == (2000, 2001)


def test_no_value(pair, problem_of):
    """Outside a parameter's domain the evaluation raises what the continuer expects."""
    problem = problem_of(pair(), "BT", "A")
    z = random_point(problem, 15, value=0.0)
    with pytest.raises((ArithmeticError, ValueError)):
        problem.evaluate(z)


# Unknowns as orbits


def test_impacts(pair, problem_of):
    problem = problem_of(pair(), "BT", "A")
    z = unknowns_of(problem, [0.1, 1.4], [0.6, -0.5])
    assert z.tolist() == [0.1, 0.6, 1.4, -0.5, 5.0]
    assert unknowns_of(problem, [0.1, 1.4], [[0.6], [-0.5]], 7.0)[-1] == 7.0
    np.testing.assert_array_equal(problem.impacts(z), [[0.1, 0.6], [1.4, -0.5]])


@pytest.mark.parametrize(("word", "shifts"), [("BT", [0]), ("BTBT/2T", [0, 2]), ("BB/2T", [0, 1])])
def test_difference(pair, problem_of, word, shifts):
    """Zero for the same orbit named from another impact or another period."""
    problem = problem_of(pair(), word, "A")
    z = random_point(problem, 16)
    n, span = len(problem.word), 2.0 * problem.word.period
    for shift in shifts:
        for periods in (0, 3, -2):
            impacts = np.roll(problem.impacts(z), -shift, axis=0).copy()
            impacts[n - shift :, 0] += span
            impacts[:, 0] += 2.0 * periods
            moved = np.append(impacts.ravel(), z[-1])
            assert np.max(np.abs(problem.difference(z, moved))) < 1e-13
            assert np.max(np.abs(problem.difference(moved, z))) < 1e-13
    other = z.copy()
    other[1] += 0.25
    other[-1] += 1.0
    found = problem.difference(other, z)
    np.testing.assert_allclose(found[[1, -1]], [0.25, 1.0], rtol=1e-14)


def test_scale(pair, problem_of):
    """A shift of every time by a period, or of every velocity by the largest, has length one."""
    problem = problem_of(pair(), "BBT", "A")
    z = unknowns_of(problem, [0.1, 0.5, 1.4], [0.6, 0.1, -0.5])
    scale = problem.scale(z, 2.5)
    assert scale[-1] == 2.5
    times, velocities = np.zeros(7), np.zeros(7)
    times[0:6:2], velocities[1:6:2] = 2.0, 0.6
    assert np.linalg.norm(times / scale) == pytest.approx(1.0, rel=1e-15)
    assert np.linalg.norm(velocities / scale) == pytest.approx(1.0, rel=1e-15)
    resting = unknowns_of(problem, [0.1, 0.5, 1.4], [0.0, 0.0, 0.0])
    assert np.all(problem.scale(resting, 1.0) > 0.0)


@pytest.mark.parametrize("word", ["1:1", "2:1", "2:1/2T"])
def test_mirror_images_solve_the_equations(pair, kernels_of, word):
    """At beta = 0 the ends may be exchanged half a period later."""
    model = pair(beta=0.0, d=0.15, r=0.4)
    kernels = kernels_of(model, "s")
    symmetry = model.symmetry("s", kernels.harmonics(*model.values.values()))
    found = find_orbits(model, word, kernels=kernels, starts=64)
    assert found
    for orbit in found:
        image, unknowns = mirror_orbit(orbit.problem, orbit.unknowns, symmetry)
        assert np.max(np.abs(image.evaluate(unknowns).residual)) < 1e-14
        walls = orbit.word.walls
        for shift in range(len(walls)):
            rotation = Word(walls[shift:] + walls[:shift], orbit.word.period)
            moved = rotate_to_word(orbit.problem, orbit.unknowns, rotation)
            other = OrbitProblem(model, rotation, kernels)
            assert np.max(np.abs(other.evaluate(moved).residual)) < 1e-14
        assert rotate_to_word(orbit.problem, orbit.unknowns, Word(walls, 7)) is None


def test_repetitions_are_recognised(pair, kernels_of):
    model = pair(d=0.233)
    kernels = kernels_of(model, "s")
    once = find_orbits(model, "1:1", kernels=kernels)[0]
    rows = once.problem.impacts(once.unknowns)
    twice = np.append(np.vstack([rows, rows + np.array([2.0, 0.0])]).ravel(), once.unknowns[-1])
    problem = OrbitProblem(model, Word("BTBT", 2), kernels)
    assert np.max(np.abs(problem.evaluate(twice).residual)) < 1e-14
    assert repeats(problem, twice, 1e-9)
    (doubled,) = find_orbits(model, "1:1/2T", kernels=kernels)
    assert not repeats(problem, doubled.unknowns, 1e-9)
    assert not repeats(once.problem, once.unknowns, 1e-9)


# Invariants of orbits


@pytest.mark.parametrize("word", ["1:0", "1:1", "2:1", "2:2", "1:1/2T", "2:1/2T", "BBTBT/2T"])
@pytest.mark.parametrize(
    "given", [{"d": 0.12484, "A": 12.466, "r": 0.25}, {"d": 0.115, "r_B": 0.25, "r_T": 0.4}]
)
@pytest.mark.quick(7)
def test_invariants_of_the_pair(pair, kernels_of, given, word):
    """sum (1 + r_k) v_k = gbar p T and det = prod r_k^2, physical orbits or not.

    Measured: 1.0e-15 for the sum. The determinant is a product of blocks' determinants, each with
    a relative error of eps/|v_k|: measured 2.9e-15 over the smallest |v_k|.
    """
    model = pair(**given)
    restitution = {w: model.values.get("r", model.values.get(f"r_{w}")) for w in "BT"}
    found = find_orbits(model, word, kernels=kernels_of(model, "A"), starts=64)
    assert found
    for orbit in found:
        walls = orbit.word.walls
        total = sum((1 + restitution[w]) * v for w, v in zip(walls, orbit.velocities, strict=True))
        gbar = orbit.linearisation.derived["gbar"]
        assert total == pytest.approx(2 * gbar * orbit.word.period, abs=1e-14)
        product = math.prod(restitution[w] ** 2 for w in walls)
        slowest = np.min(np.abs(orbit.velocities))
        assert abs(np.prod(orbit.multipliers) / product - 1) < 2e-14 / slowest
        assert orbit.residual < 1e-14


@pytest.mark.parametrize("c", [0.0, 0.1, 2.0])
@pytest.mark.parametrize("word", ["S", "S/2T", "SS/2T"])
def test_invariants_of_the_oscillator(oscillator, kernels_of, word, c):
    """det = r^(2N) exp(-c p T); measured: 1.1e-13 relative, at c = 2."""
    model = oscillator(c=c, sigma=0.01, omega=2.6)
    found = find_orbits(model, word, kernels=kernels_of(model, "omega"), starts=64)
    for orbit in found:
        span = orbit.word.period * 2 * math.pi / 2.6
        product = 0.8 ** (2 * len(orbit.word)) * math.exp(-c * span)
        assert np.prod(orbit.multipliers).real == pytest.approx(product, rel=1e-12)
    assert found or word == "SS/2T"


def test_derived(pair, problem_of):
    problem = problem_of(pair(d=0.242), "BT", "A")
    here = problem.evaluate(random_point(problem, 17))
    assert here.derived == pytest.approx({"d": 0.242, "gbar": 0.12201}, rel=1e-14)


@pytest.mark.parametrize("laps", [1, 2, 4, 8])
def test_velocities_have_a_natural_size_where_a_flight_begins_and_ends_at_rest(
    oscillator, problem_of, laps
):
    """The steady response that touches the stop is at rest twice a period: at all eighths of four
    or eight periods."""
    model = oscillator(c=0.1)
    a, omega, c, k = (model.values[name] for name in ("a", "omega", "c", "k"))
    swing = a / math.hypot(k - omega**2, c * omega)
    problem = problem_of(model, "S" if laps == 1 else f"S/{laps}T", "sigma")
    touching = np.array([math.atan2(c * omega, k - omega**2) / omega, 0.0, swing])
    assert np.max(np.abs(problem.evaluate(touching).residual)) < 1e-13
    speed = problem.scale(touching, 1.0)[1]
    assert 0.5 * omega * swing < speed <= omega * swing * (1.0 + 1e-12)


@pytest.mark.skipif(importlib.util.find_spec("heyoka") is None, reason="needs contimpact[ode]")
def test_velocities_are_measured_along_all_flights():
    """The flight that leaves an impact at rest takes no time at the V of a stick-slip: the gap
    coordinate's speed is that of the others."""
    branches = load_diagram(ROOT / "branches" / "coco_stick_slip").branches
    (event,) = [e for b in branches if b.word == "IR" for e in b.events if e.kind == "V"]
    orbit = event.orbit()
    size = orbit.linearisation.problem.scale(orbit.unknowns, 1.0)[1] / math.sqrt(2.0)
    fastest = np.max(np.abs(orbit.motion(400).v[:, 0]))
    assert 0.8 * fastest < size <= fastest * (1.0 + 1e-4)
