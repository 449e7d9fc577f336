"""Thirty digits: the kernels in mpmath's arithmetic, and what the library finds against them."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from contimpact.accuracy.reference import Reference
from contimpact.bifurcations.kind import test_functions as make_tests
from contimpact.continuation import corrector as linear
from contimpact.continuation.settings import Settings
from contimpact.diagrams.orbit_walks import walk_both_ways
from contimpact.models.guards import Word
from contimpact.orbits import status as stability
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import find_orbits
from contimpact.segments.bounded import many_digits
from contimpact.segments.kernels import Kernels

POINT = (0.37, 0.61, 1.52, -0.43)


@pytest.mark.parametrize(
    ("walls", "forcing"),
    [
        *((walls, "cos(pi*t)") for walls in ("BB", "BT", "TB", "TT")),
        *((walls, "cos(pi*t)**3") for walls in ("BB", "BT", "TB", "TT")),
        ("BT", "exp(cos(pi*t))/3"),
    ],
)
@pytest.mark.quick(3)
def test_kernels_in_many_digits(pair, exact, walls, forcing):
    """Against the flight integrated by hand in 60 digits, where quotients such as 1/3 matter."""
    model = pair(forcing=forcing)
    problem = OrbitProblem(model, Word(walls), Kernels(model, "s"))
    reference = Reference(problem, 40)
    values = [reference.ctx.mpf(v) for v in model.values.values()]
    ends = [reference.ctx.mpf(x) for x in POINT]
    found, *_ = reference.kernel(*walls)(*ends, *values)
    expected, sizes = exact(model, *walls, POINT)
    bound = 1e-15 if "exp" in forcing else 1e-45  # a sampled series has coefficients in doubles
    for a, b, size in zip(found, expected, sizes, strict=True):
        assert abs(mpmath.mpf(a) - b) < bound * size


def test_kernels_of_the_oscillator(exact, oscillator):
    model = oscillator(c=0.3)
    problem = OrbitProblem(model, Word("S"), Kernels(model, "sigma"))
    reference = Reference(problem, 40)
    values = [reference.ctx.mpf(v) for v in model.values.values()]
    found, *_ = reference.kernel("S", "S")(*[reference.ctx.mpf(x) for x in POINT], *values)
    expected, sizes = exact(model, "S", "S", POINT)
    for a, b, size in zip(found, expected, sizes, strict=True):
        assert abs(mpmath.mpf(a) - b) < 1e-40 * size


@pytest.mark.parametrize("q", [0, 1e-30, 1e-3, 3.99, 29.0, 31.0, 1e4, -1e-3, -7.0, -200.0])
def test_stumpff_functions(q):
    """c_k = 1/k! - q c_{k+2}, and the cosine that c_0 is."""
    ctx = mpmath.mp.clone()
    ctx.dps = 50
    names = many_digits(ctx).names
    value = ctx.mpf(q)
    assert abs(names["stumpff0"](value) - ctx.cos(ctx.sqrt(value)).real) <= 1e-45 * max(
        1, abs(names["stumpff0"](value))
    )
    for k in range(8):
        low, high = names[f"stumpff{k}"](value), names[f"stumpff{k + 2}"](value)
        size = max(abs(low), 1)
        assert abs(low - (1 / ctx.factorial(k) - value * high)) < 1e-44 * size


def test_no_global_precision_is_changed(pair):
    before = mpmath.mp.dps
    model = pair()
    Reference(OrbitProblem(model, Word("BT"), Kernels(model, "s")), 60)
    assert mpmath.mp.dps == before


@pytest.fixture(scope="module")
def fig7(pair):
    """The 1:1 and 2:1 branches of Fig. 7, with every kind of event they have."""
    runs = []
    for word in ("1:1", "2:1"):
        orbit = find_orbits(pair(s=0.34), word, parameter="s", starts=64, rounds=4)[0]
        kinds = ("FB", "BP", "PD", "G", "V", "T", "UZ")
        tests = make_tests(orbit.problem, kinds, {"d": [0.2], "s": [0.3]})
        runs.append(walk_both_ways(orbit.problem, orbit.unknowns, (0.08, 1.05), tests, Settings()))
    return runs


@pytest.mark.full
def test_events_are_confirmed_and_their_errors_are_honest(fig7):
    """30 digits: every event moves by less than 1e-13 and no more than it says."""
    kinds = set()
    for run in fig7:
        reference = Reference(run.problem)
        for event in run.events:
            found = reference.event(event.kind, event.point.unknowns, event.details)
            assert found is not None
            assert found.residual < 1e-30
            assert found.distance(event.point.unknowns) < 1e-13
            assert abs(found.parameter_error(event.parameter)) <= event.error
            kinds.add(event.kind)
    assert {"FB", "PD", "G", "UZ"} <= kinds


def test_the_printed_values_of_the_paper_family(fig7):
    """d of PD, FB and the grazing, known to 11 digits."""
    expected = {"PD": 0.23850682149, "G": 0.20445492649}
    reference = Reference(fig7[0].problem)
    for event in fig7[0].events:
        if event.kind in expected:
            found = reference.event(event.kind, event.point.unknowns, event.details)
            d = reference.setup(reference.values(found.unknowns)).derived[0]
            assert float(d) == pytest.approx(expected[event.kind], abs=2e-11)


def test_what_does_not_converge_is_none(pair):
    model = pair()
    problem = OrbitProblem(model, Word("BT"), Kernels(model, "s"))
    assert Reference(problem).orbit(np.array([0.0, 1e3, 1e3, 1e3, 0.389])) is None


# Multipliers and linear systems of long words.


@pytest.fixture
def rng():
    return np.random.default_rng(6)


def repeated(orbit, times):
    problem = orbit.problem
    rows = np.vstack([problem.impacts(orbit.unknowns)] * times)
    rows[:, 0] += 2.0 * np.repeat(np.arange(times), len(orbit.word))
    longer = OrbitProblem(problem.model, Word(orbit.word.walls * times, times), problem.kernels)
    return longer, np.append(rows.ravel(), orbit.unknowns[-1])


@pytest.mark.parametrize("times", [5, 25, 100])
@pytest.mark.quick(2)
def test_multipliers_of_long_words(pair, times):
    """Up to 200 impacts and 2e11, against the product of the flights' maps in many digits."""
    orbit = find_orbits(pair(s=0.3515), "1:1", parameter="s", starts=64, rounds=4)[0]
    problem, unknowns = repeated(orbit, times)
    large, small = Reference(problem).multipliers(
        [Reference(problem).ctx.mpf(float(u)) for u in unknowns]
    )
    found = problem.evaluate(unknowns).multipliers
    assert found[0].real == pytest.approx(float(large), rel=1e-13 * 50 * times)
    assert found[1].real == pytest.approx(float(small), rel=1e-13 * 50 * times)
    if times == 100:
        assert abs(float(large)) > 1e11


@pytest.mark.parametrize("m", [2, 4])
@pytest.mark.parametrize("count", [2, 3, 5, 8, 17, 64, 200])
def test_collapse_keeps_determinants(rng, count, m):
    """The factor that merging puts between the pencil's determinants and the cyclic matrix's."""
    start, end = rng.normal(size=(2, count, m, m))
    p, q, sign, logarithm = stability.collapse(start, end)
    # with the last coupling alone multiplied by mu, its highest power has the product of all det B
    signs, sizes = np.linalg.slogdet(end)
    expected = sign * np.prod(signs) * math.exp(np.sum(sizes) - logarithm)
    assert np.linalg.det(q) == pytest.approx(expected, abs=1e-12 * np.linalg.norm(q) ** m)
    assert np.all(np.isfinite(p))


@pytest.mark.parametrize("n", [3, 40, 401, 601])
@pytest.mark.full
def test_sparse_and_dense_agree(rng, n, monkeypatch):
    """A bordered cyclic chain, solved both ways; determinants with their signs."""
    matrix = np.zeros((n, n))
    for k in range(n - 1):
        matrix[k, k : k + 2] = rng.choice([-1.0, 1.0]), rng.uniform(-0.9, 0.9)
    matrix[-2, 0], matrix[-1], matrix[:-1, -1] = 1.0, rng.normal(size=n), rng.normal(size=n - 1)
    right = rng.normal(size=n)
    results = []
    for limit in (0, 10**6):
        monkeypatch.setattr(linear, "DENSE_UP_TO", limit)
        results.append((linear.solve(matrix, right), linear.log_determinant(matrix)))
    condition = np.linalg.cond(matrix)
    sizes = np.max(np.abs(results[0][0]))
    assert np.max(np.abs(results[0][0] - results[1][0])) < 1e-14 * condition * sizes
    assert results[0][1][0] == results[1][1][0]
    assert results[0][1][1] == pytest.approx(results[1][1][1], abs=1e-9)


def test_singular_systems_are_refused_both_ways(monkeypatch):
    for limit in (0, 100):
        monkeypatch.setattr(linear, "DENSE_UP_TO", limit)
        with pytest.raises(np.linalg.LinAlgError):
            linear.solve(np.zeros((4, 4)), np.ones(4))
        assert linear.log_determinant(np.zeros((4, 4)))[0] == 0.0
