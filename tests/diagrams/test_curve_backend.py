"""Curves on the scalar backend: against dense linear algebra, and compiled to the last bit."""

from __future__ import annotations

import importlib.util
import math
from collections import defaultdict

import numpy as np
import pytest

from contimpact.arrays import LISTS
from contimpact.bifurcations.extended_system import SingularCycle
from contimpact.bifurcations.kind import kind_of
from contimpact.bifurcations.scalar_systems import LONGEST, factor
from contimpact.bifurcations.torus import SingularPair
from contimpact.continuation.step import DenseBackend
from contimpact.diagrams import curve_problem as steps
from contimpact.diagrams import curves
from contimpact.diagrams.curve_problem import CurveProblem, backend_of, curve_problem
from contimpact.diagrams.curves import follow_curve
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import find_orbits
from contimpact.segments import compiling
from contimpact.segments.kernels import Kernels
from contimpact.systems.duffing import Duffing
from contimpact.systems.impact_pair import ImpactPair

MODEL = ImpactPair(beta=math.pi / 3, r=0.55, A=9.0, s=0.5)
RANGES = ((0.8, 40.0), (0.05, 0.9))
PAIRS = Kernels(MODEL, "A", "r")
KINDS = ("FB", "PD", "G")
needs_llvmlite = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="the extra 'fast' is not installed"
)


@pytest.fixture(scope="module")
def entries():
    """An FB, a PD and a G of 1:1."""
    return {
        entry.kind: entry
        for orbit in find_orbits(MODEL, "1:1", parameter="A", starts=32)
        for entry in continue_orbit(orbit, range=RANGES[0], events=KINDS).events
    }


def problem_at(entry):
    return curve_problem(MODEL, entry, PAIRS, RANGES[0][1] - RANGES[0][0])


@pytest.mark.parametrize("kind", KINDS)
def test_residual_and_jacobian_are_those_of_the_system(entries, kind):
    problem, start = problem_at(entries[kind])
    backend = backend_of(problem)
    vectors, scale = backend.vectors(len(start), LISTS), problem.scale(start, 0.85)
    vectors.sizes[:] = scale[: problem.orbit.n].tolist()
    z = start * (1.0 + 1e-3 * np.random.default_rng(3).uniform(-1, 1, len(start)))
    expected = problem.evaluate(z)
    worst = backend.evaluate(vectors, z.tolist())
    units = problem.residual_sizes_at(expected, scale)
    assert units.max() <= 1.0
    assert 1.0 <= worst / np.max(np.abs(expected.residual) / units) <= 2.0  # they are powers of two
    assert vectors.residual == pytest.approx(expected.residual, abs=1e-14)
    sizes = np.max(np.abs(expected.jacobian), axis=1)
    for row, other, size in zip(vectors.jacobian, expected.jacobian, sizes, strict=True):
        assert row == pytest.approx(other, abs=1e-13 * size)


@pytest.mark.parametrize("kind", KINDS)
def test_steps_are_those_of_dense_linear_algebra(entries, kind, monkeypatch):
    curve = follow_curve(entries[kind], MODEL, "r", *RANGES, kernels=PAIRS)
    monkeypatch.setattr(curves, "backend_of", DenseBackend)
    dense = follow_curve(entries[kind], MODEL, "r", *RANGES, kernels=PAIRS)
    assert len(curve) == len(dense)
    assert [end.kind for end in curve.ends] == [end.kind for end in dense.ends]
    for name in ("s", "r", "arclength"):
        assert curve[name] == pytest.approx(dense[name], abs=1e-9)
    assert [p.kind for p in curve.points] == [p.kind for p in dense.points]
    assert np.max(curve["residual"]) <= 1e-13


def test_a_system_is_eliminated_with_pivots():
    matrix = np.random.default_rng(1).normal(size=(7, 7))
    matrix[0, 0] = 0.0
    rows, right = matrix.tolist(), [1.0] * 7
    sign, logarithm = factor(rows, right, len(right))
    expected = np.linalg.slogdet(matrix)
    assert sign == expected[0]
    assert logarithm == pytest.approx(expected[1], abs=1e-12)
    singular = [[1.0, 2.0], [0.0, 0.0]]
    assert factor(singular, [1.0, 1.0], 2)[0] == 0.0


def test_what_is_left_to_dense_linear_algebra():
    def made(word, system):
        orbit = OrbitProblem(MODEL, Word(word, len(word) // 2), PAIRS)
        return backend_of(CurveProblem(kind_of("PD"), system(orbit), {}, [1.0]))

    def doubling(orbit):
        return SingularCycle(orbit, -1.0)

    assert made("BT" * (LONGEST // 2), doubling) is not None
    assert made("BT" * (LONGEST // 2 + 1), doubling) is None
    assert made("BT", SingularPair) is None


def test_curves_of_integrated_flights_are_not_compiled(monkeypatch):
    """They cannot be, and compiling in vain ended it for all that the process computes."""
    pytest.importorskip("heyoka")
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    values = {"a": 0.5, "omega": 1.4, "c": 0.1, "alpha": 1.0, "beta": 1.0, "sigma": 0.8, "r": 0.8}
    orbit = OrbitProblem(Duffing(**values), Word("S", 1), Kernels(Duffing(**values), "omega", "a"))
    backend = backend_of(CurveProblem(kind_of("PD"), SingularCycle(orbit, -1.0), {}, [1.0]))
    assert backend.whole.compiled is None


def test_a_process_that_has_computed_much_else_compiles_no_short_curve(entries, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "auto")
    monkeypatch.setattr(compiling, "PAYS_AFTER", 1e6)
    monkeypatch.setattr(compiling, "PAYS_SOON", 1e6)  # another test may have compiled a like one
    monkeypatch.setattr(compiling, "_SPENT", defaultdict(float, {("another",): 1e9}))
    monkeypatch.setattr(compiling, "_EXPECTED", [0.0])
    monkeypatch.setattr(compiling, "_compile_program", lambda *given: pytest.fail("it compiles"))
    follow_curve(entries["G"], MODEL, "r", *RANGES, kernels=PAIRS)


@needs_llvmlite
@pytest.mark.parametrize(
    "kind", ["G", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("FB", "PD"))]
)
@pytest.mark.full
def test_compiled_curves_are_the_same_to_the_last_bit(
    entries, kind, monkeypatch, plain_and_compiled
):
    compiled = []
    advance = steps.CurveBackend.advance

    def noted(self, position, most):
        compiled.append(self.compiled is not None)
        return advance(self, position, most)

    monkeypatch.setattr(steps.CurveBackend, "advance", noted)
    plain, fast = plain_and_compiled(
        lambda: follow_curve(entries[kind], MODEL, "r", *RANGES, kernels=PAIRS)
    )
    assert {*compiled} == {False, True}
    assert fast == plain
