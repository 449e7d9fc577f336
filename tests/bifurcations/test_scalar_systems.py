"""Events solved by scalar code: against dense linear algebra, and compiled to the last bit."""

from __future__ import annotations

import importlib.util
import math

import numpy as np
import pytest

from contimpact import ImpactPair
from contimpact.bifurcations.event_solver import solver_of
from contimpact.bifurcations.extended_system import SingularCycle, TouchingFlight, solve
from contimpact.bifurcations.scalar_systems import LONGEST, ScalarForm
from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.segments.kernels import Kernels

needs_llvmlite = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="the extra 'fast' is not installed"
)


def problem_of_word(laps=1):
    pair = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.4)
    return OrbitProblem(pair, Word("BT" * laps, laps), Kernels(pair, "s"))


def orbit_at(problem, value):
    """The orbit at a parameter value, from a table of it."""
    z = np.array([0.3289672464099905, 0.9099069905380301, 1.4248536390000661, -0.7221992982303381])
    for s in np.linspace(0.45 / 0.6225, value, 40):
        for _ in range(6):
            here = problem.evaluate(np.append(z, s))
            z = z - np.linalg.solve(here.jacobian[:, :-1], here.residual)
    return problem.evaluate(np.append(z, s))


def system_of(kind, problem, here):
    if kind == "PD":
        return SingularCycle(problem, -1.0)
    (flight, wall), touch = min(
        (((k, "BT"[j]), t) for k, f in enumerate(here.gaps) for j, t in enumerate(f.touches) if t),
        key=lambda found: found[1].gap,
    )
    return TouchingFlight(problem, flight, wall, touch.time)


PLACES = {"PD": 0.2386 / 0.6225, "G": 0.2046 / 0.6225}


@pytest.mark.parametrize("kind", PLACES)
def test_solutions_are_those_of_dense_linear_algebra(kind, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "never")
    problem = problem_of_word()
    here = orbit_at(problem, PLACES[kind])
    system = system_of(kind, problem, here)
    found = solve(system, here)
    system.form = None
    dense = solve(system, here)
    assert found.unknowns == pytest.approx(dense.unknowns, abs=1e-14)
    assert found.residual <= 1e-15
    assert found.error == pytest.approx(dense.error, rel=0.2)
    own = found.own * np.sign(found.own @ dense.own)
    assert own == pytest.approx(dense.own, abs=1e-13)
    assert found.at.jacobian == pytest.approx(
        system.assemble(found.here, found.own).jacobian, abs=1e-12
    )


def test_what_lies_far_away_is_not_found(monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "never")
    problem = problem_of_word()
    here = orbit_at(problem, 0.6)
    assert solve(SingularCycle(problem, -1.0), here, 1e-6) is None


def test_long_words_are_left_to_dense_linear_algebra():
    form = ScalarForm("singular", mu=-1.0)
    assert solver_of(problem_of_word(LONGEST // 2), form) is not None
    assert solver_of(problem_of_word(LONGEST // 2 + 1), form) is None


@needs_llvmlite
@pytest.mark.full
@pytest.mark.parametrize("kind", PLACES)
def test_compiled_solutions_are_the_same_to_the_last_bit(kind, monkeypatch):
    found = []
    for mode in ("never", "always"):
        monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
        problem = problem_of_word()
        here = orbit_at(problem, PLACES[kind])
        found.append(solve(system_of(kind, problem, here), here))
    plain, compiled = found
    assert np.array_equal(plain.unknowns, compiled.unknowns)
    assert np.array_equal(plain.own, compiled.own)
    assert np.array_equal(plain.at.jacobian, compiled.at.jacobian)
    assert (plain.residual, plain.error) == (compiled.residual, compiled.error)
