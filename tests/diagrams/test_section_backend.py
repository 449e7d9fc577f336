"""Branches of orbits without impacts whose flights are integrated, by steps plain and compiled."""

from __future__ import annotations

import importlib.util
import math

import numpy as np
import pytest
from integrated import MASSES, Integrated, IntegratedMasses

import contimpact as ci
from contimpact.diagrams.chain_backend import SectionBackend
from contimpact.diagrams.orbit_walks import backend_of
from contimpact.models.guards import parse_word
from contimpact.orbits.orbit import Orbit
from contimpact.orbits.quiet import problem_of
from contimpact.orbits.search import solve_near
from contimpact.segments.kernels import Kernels
from contimpact.systems.duffing import Duffing
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.two_masses import TwoMasses
from contimpact.systems.van_der_pol import VanDerPol

integrate = pytest.importorskip("scipy.integrate")
pytestmark = [
    pytest.mark.skipif(importlib.util.find_spec(name) is None, reason=f"{name} is not installed")
    for name in ("heyoka", "llvmlite")
]
OSCILLATOR = {"a": 1.0, "omega": 1.3, "c": 0.1, "k": 1.0, "sigma": 0.5, "r": 0.8}
DUFFING = {"a": 0.5, "omega": 1.4, "c": 0.1, "alpha": 1.0, "beta": 1.0, "sigma": 0.8, "r": 0.8}
EVENTS = ["FB", "BP", "PD", "G", "NS"]


def both_ways(orbit, limits, plain_and_compiled):
    """The branch of `0` by plain and by compiled steps, which agree to rounding."""
    parameter = orbit.problem.parameter
    one, other = plain_and_compiled(
        lambda: ci.continue_orbit(orbit, parameter, limits, events=EVENTS)
    )
    assert len(one) == len(other)
    assert (one[parameter].min(), one[parameter].max()) == limits
    for name, column in one.columns.items():
        if column.dtype.kind == "f" and name not in ("residual", "iterations"):
            assert other[name] == pytest.approx(column, rel=1e-8, abs=1e-8, nan_ok=True), name
    assert [e.label for e in one.events] == [e.label for e in other.events]
    for found, truth in zip(other.events, one.events, strict=True):
        assert abs(found.value - truth.value) <= 2.0 * (found.error + truth.error)
    return other


def flown(force, state, span):
    """States along a flight and the derivatives of its end by its start, by SciPy."""
    d = len(state) // 2
    every = np.eye(len(state))
    step = 1e-6 * max(1.0, float(np.max(np.abs(state))))

    def end(start, dense=False):
        def rate(t, y):
            return [*y[d:], *force(t, y[:d], y[d:])]

        given = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "dense_output": dense}
        return integrate.solve_ivp(rate, (0.0, span), start, **given)

    slopes = [
        (end(state + step * e).y[:, -1] - end(state - step * e).y[:, -1]) / (2.0 * step)
        for e in every
    ]
    return end(state, dense=True).sol, np.array(slopes).T


@pytest.mark.full
def test_duffing_against_scipy(plain_and_compiled):
    """Residuals, multipliers and gaps on both sides of the folds; the touch is in the period."""
    orbit = ci.find_orbits(Duffing(**DUFFING), "0", parameter="omega", rounds=1)[0]
    branch = both_ways(orbit, (0.88, 2.5), plain_and_compiled)
    assert [e.kind for e in branch.events].count("FB") == 2
    (first, *_) = [e for e in branch.events if e.kind == "G"]
    assert 0.0 <= first.touch_time < 2.0 * math.pi / first.value
    for row in np.linspace(1, len(branch) - 2, 6).astype(int).tolist():
        p = DUFFING | {"omega": branch["omega"][row]}

        def force(t, x, v, p=p):
            return p["a"] * np.cos(p["omega"] * t) - p["alpha"] * x - p["beta"] * x**3 - p["c"] * v

        state, span = np.array([branch["x0_0"][row], branch["v0_0"][row]]), 2 * math.pi / p["omega"]
        states, monodromy = flown(force, state, span)
        assert states(span) == pytest.approx(state, abs=1e-9)
        multipliers = np.sort_complex(np.linalg.eigvals(monodromy))
        parts = [
            branch[f"multiplier{i}_re"][row] + 1j * branch[f"multiplier{i}_im"][row] for i in (1, 2)
        ]
        assert np.sort_complex(np.array(parts)) == pytest.approx(multipliers, abs=1e-6)
        highest = np.max(states(np.linspace(0.0, span, 20001))[0])
        assert branch["smallest_gap"][row] == pytest.approx(p["sigma"] - highest, abs=1e-6)


@pytest.mark.full
def test_a_free_period(plain_and_compiled):
    """Van der Pol's oscillation has the period 6.663286859323130... at epsilon = 1."""
    model = VanDerPol(epsilon=1.0, sigma=2.1, r=0.8)
    word = parse_word("0", model.letters, free=True)
    problem = problem_of(model, word, Kernels(model, "epsilon"))
    orbit = Orbit(problem, solve_near(problem, np.array([2.0, 6.7, 1.0])))
    branch = both_ways(orbit, (0.7, 1.5), plain_and_compiled)
    row = int(np.argmin(np.abs(branch["epsilon"] - 1.0)))
    assert branch["epsilon"][row] == pytest.approx(1.0, abs=1e-15)
    orbit = branch.orbit(row)
    assert orbit.period == pytest.approx(6.663286859323130, rel=1e-14)
    state = np.array([orbit.unknowns[0], 0.0])
    states, monodromy = flown(lambda t, x, v: (1.0 - x**2) * v - x, state, orbit.period)
    assert states(orbit.period) == pytest.approx(state, abs=1e-9)
    assert orbit.multipliers[0].real == pytest.approx(np.linalg.det(monodromy), abs=1e-6)


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("kinds", "values", "parameter", "limits"),
    [
        ((Oscillator, Integrated), OSCILLATOR, "omega", (1.1, 1.6)),
        ((TwoMasses, IntegratedMasses), MASSES, "omega", (1.7, 1.9)),
    ],
    ids=["one", "two"],
)
def test_flights_that_have_a_closed_form(kinds, values, parameter, limits, plain_and_compiled):
    exact, integrated = (kind(**values) for kind in kinds)
    orbit = ci.find_orbits(integrated, "0", parameter=parameter, rounds=1)[0]
    found = both_ways(orbit, limits, plain_and_compiled)
    (orbit,) = ci.find_orbits(exact, "0", parameter=parameter)
    truth = ci.continue_orbit(orbit, parameter, limits, events=EVENTS)
    assert len(found) == len(truth)
    assert [e.label for e in found.events] == [e.label for e in truth.events]
    for name, column in truth.columns.items():
        if column.dtype.kind == "f" and name not in ("residual", "iterations"):
            assert found[name] == pytest.approx(column, rel=1e-8, abs=1e-8, nan_ok=True), name


@pytest.mark.full
def test_flights_that_grow_too_long(plain_and_compiled):
    """About the top between two wells a period enlarges differences by exp(2 pi/omega) and more:
    from there on flights are computed in pieces."""
    model = Duffing(**DUFFING | {"alpha": -1.0, "a": 0.1, "omega": 1.2, "sigma": 3.0})
    orbits = ci.find_orbits(model, "0", parameter="omega")
    orbit = min(orbits, key=lambda orbit: abs(orbit.unknowns[0]))
    branch = both_ways(orbit, (0.55, 1.3), plain_and_compiled)
    assert branch["omega"][0] == 0.55
    assert branch["multiplier1_re"][0] > 1e4
    product = branch["multiplier1_re"] * branch["multiplier2_re"]
    assert product == pytest.approx(np.exp(-0.1 * 2.0 * math.pi / branch["omega"]), rel=1e-8)


def test_the_backend_is_chosen_for_integrated_flights_alone():
    kinds = {Oscillator: None, Integrated: SectionBackend}
    for kind, backend in kinds.items():
        orbit = ci.find_orbits(kind(**OSCILLATOR), "0", parameter="omega")[0]
        found = backend_of(orbit.problem, [])
        assert found is None if backend is None else isinstance(found.whole, backend)
