"""Linear machines compiled: the same numbers as plainly, to the last bit."""

from __future__ import annotations

import importlib.util
import math

import numpy as np
import pytest
from zoo import ROOT

from contimpact import continue_orbit, find_orbits
from contimpact.continuation.settings import Settings
from contimpact.diagrams.orbit_program import flow_compiled, space_of
from contimpact.results.scene import load_scene
from contimpact.segments.linear_flow import Shape, flow
from contimpact.systems.coupled_by_impact import CoupledByImpact
from contimpact.systems.impact_damper import ImpactDamper
from contimpact.systems.two_masses import TwoMasses
from contimpact.systems.two_stops import TwoStops

needs_llvmlite = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="the extra 'fast' is not installed"
)
EVENTS = ("FB", "BP", "PD", "NS", "G", "V", "T")

THREE = load_scene(ROOT / "examples" / "three_masses.toml").model
MASSES = {"c1": 0.1, "c2": 0.05, "k1": 1.0, "k2": 0.6, "a1": 1.0, "sigma_1": 0.5, "sigma_2": 0.4}
COUPLED = {"c1": 0.1, "c2": 0.1, "k1": 1.0, "k2": 2.0, "a1": 1.0, "gap": 0.1, "r": 0.7}

CASES = {
    "two-stops": (TwoStops(a=1.0, omega=1.0, c=0.1, k=1.0, sigma=0.5, r=0.8), "RL", "omega"),
    "rattle": (TwoStops(a=1.0, omega=1.0, c=0.0, k=0.0, sigma=0.5, r=0.8), "RL", "sigma"),
    "two-masses": (TwoMasses(omega=1.8, r=0.8, **MASSES), "AB", "omega"),
    "coupled-by-impact": (CoupledByImpact(omega=1.5, **COUPLED), "K", "omega"),
    "impact-damper": (ImpactDamper(Omega=1.0, d=20.0, r=0.8, mu=0.1, zeta=0.01), "RL", "d"),
    "three-masses": (THREE, "C", "omega"),
}


@pytest.mark.parametrize("seed", range(20))
def test_flows_are_the_same_to_the_last_bit(seed):
    rng = np.random.default_rng(seed)
    shape = Shape(*(int(rng.integers(*ends)) for ends in ((1, 4), (0, 3), (0, 3))))
    size = shape.given * (1 + shape.directions)
    numbers = (rng.normal(size=size) * 10.0 ** rng.uniform(-2, 1, size)).tolist()
    if seed % 5 == 0:
        numbers[: shape.freedom] = [0.0] * shape.freedom
    space = rng.normal(size=space_of(*shape))
    for dt in (1e-9, -0.02, 0.3, 3.0):
        space[:size] = numbers
        assert list(flow(*shape, dt, *numbers)) == flow_compiled(*shape, dt, space).tolist()


def test_a_flow_beyond_the_range_of_floats_has_no_value():
    numbers = [-1.0, -0.1, math.inf, 0.0, 0.0, 1.3]
    with pytest.raises(OverflowError):
        flow(1, 1, 0, 1.0, *numbers)
    space = np.zeros(space_of(1, 1, 0))
    space[: len(numbers)] = numbers
    assert np.all(np.isnan(flow_compiled(1, 1, 0, 1.0, space)))


FAR = {"rattle", "coupled-by-impact"}
"""Whose first events lie far from where their branches begin."""


def branch(name, points, step, limits=(0.8, 1.2)):
    """A few points of a branch, both ways, with all events; limits are parts of its first value."""
    model, word, parameter = CASES[name]
    orbit = find_orbits(model, word, parameter=parameter)[0]
    settings = Settings(step=step, max_step=step, max_points=points)
    reach = tuple(part * orbit.unknowns[-1] for part in limits)
    return continue_orbit(orbit, parameter, reach, events=EVENTS, settings=settings)


def branch_with_events(name):
    return branch(name, 300, 0.05, (0.3, 3.0)) if name in FAR else branch(name, 300, 0.01)


def same(one, other):
    """The whole record of two branches: tables, events, ends."""
    assert len(one) > 2
    assert list(one.columns) == list(other.columns)
    for name, column in one.columns.items():
        equal_nan = column.dtype.kind == "f"
        assert np.array_equal(column, other.columns[name], equal_nan=equal_nan), name
    assert one.events == other.events
    assert one.missed == other.missed
    assert one.ends == other.ends


QUICKEST = "coupled-by-impact"
MARKED = [
    pytest.param(name, marks=pytest.mark.full if name == QUICKEST else pytest.mark.slow)
    for name in CASES
]


@needs_llvmlite
@pytest.mark.parametrize("name", MARKED)
def test_compiled_branches_are_the_same(plain_and_compiled, name):
    plain, fast = plain_and_compiled(lambda: branch_with_events(name))
    assert plain.events
    same(plain, fast)


@pytest.mark.parametrize(
    "mode", ["never", pytest.param("always", marks=[needs_llvmlite, pytest.mark.slow])]
)
@pytest.mark.slow
def test_flights_too_stiff_to_be_followed_in_few_steps_are_judged(kernel_cache, monkeypatch, mode):
    """With c2 = 400 a flight would take more steps than there is room for."""
    monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
    stiff = MASSES | {"c2": 400.0, "sigma_2": 100.0}
    model = TwoMasses(omega=0.8, r=0.8, **stiff)
    orbit = find_orbits(model, "A", parameter="omega")[0]
    branch = continue_orbit(orbit, "omega", (0.792, 0.808), events=[])
    for row in range(len(branch)):
        here = branch.orbit(row).linearisation
        assert bool(branch["physical"][row]) is here.verdict.physical is False
        assert branch["smallest_gap"][row] == pytest.approx(here.verdict.smallest_gap, abs=1e-9)
