"""The ball on a vibrating table, against closed forms."""

from __future__ import annotations

import importlib.util
import math

import numpy as np
import pytest

from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.orbits.search import find_orbits
from contimpact.simulation.simulator import Simulator
from contimpact.systems.bouncing_ball import BouncingBall

OMEGA, R, G = 50.0, 0.5, 9.8
needs_llvmlite = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="llvmlite is not installed"
)


def ball(gamma=3.6, **changes):
    return BouncingBall(**({"a": gamma * G / OMEGA**2, "omega": OMEGA, "r": R, "g": G} | changes))


def fold(periods, r=R):
    """Gamma at the fold of the orbits with one impact in so many periods."""
    return periods * math.pi * (1 - r) / (1 + r)


@pytest.mark.parametrize("periods", [1, 2, 3])
@pytest.mark.parametrize("r", [0.2, 0.5, 0.9])
def test_one_impact_in_several_periods(periods, r):
    """It leaves the table at g p T/2, seen from the room."""
    model = ball(gamma=1.1 * fold(periods, r), r=r)
    orbits = find_orbits(model, f"P/{periods}T", parameter="a")
    period = 2 * math.pi / OMEGA
    speed = -G * periods * period / (1 + r)
    phase = math.acos(fold(periods, r) / model.values["a"] / OMEGA**2 * G)
    assert len(orbits) == 2
    for orbit in orbits:
        assert orbit.velocities == pytest.approx([speed], rel=1e-12)
        assert math.cos(OMEGA * orbit.times[0]) == pytest.approx(math.cos(phase), abs=1e-11)
        assert np.prod(orbit.multipliers) == pytest.approx(r**2, rel=1e-12)
    trace = (1 + r) ** 2 * model.values["a"] * OMEGA**2 / G * math.sin(phase)
    sums = sorted(float(np.sum(orbit.multipliers).real) for orbit in orbits)
    assert sums == pytest.approx([1 + r**2 - trace, 1 + r**2 + trace], rel=1e-10)


@pytest.mark.parametrize("periods", [1, 2])
def test_fold_and_doubling(periods):
    orbit = find_orbits(ball(gamma=1.1 * fold(periods)), f"P/{periods}T", parameter="a")[0]
    branch = continue_orbit(orbit, "a", (0.003, 0.02), events=["FB", "PD"])
    found = {event.kind: event.parameters["Gamma"] for event in branch.events}
    doubling = math.hypot(fold(periods), 2 * (1 + R**2) / (1 + R) ** 2)
    assert found == pytest.approx({"FB": fold(periods), "PD": doubling}, rel=1e-12)
    assert branch.missed == []


@pytest.mark.slow  # a program is compiled
@needs_llvmlite
def test_compiled_code_gives_the_same_branch(plain_and_compiled):
    """To the last bit; the phase of the forcing's one harmonic is found in compiled code too."""
    orbit = find_orbits(ball(gamma=1.2), "1", parameter="a")[0]
    plain, fast = plain_and_compiled(
        lambda: continue_orbit(orbit, "a", (0.003, 0.02), events=["FB", "PD", "G"])
    )
    for name, column in plain.columns.items():
        assert np.array_equal(column, fast[name], equal_nan=column.dtype.kind == "f"), name


def test_a_simulation_settles_on_the_stable_orbit():
    model = ball(gamma=1.3)
    (stable,) = [o for o in find_orbits(model, "1", parameter="a") if o.stable]
    simulator = Simulator(model)
    run = simulator.run(simulator.state("P", 0.03, -0.9), impacts=200)
    assert run.word[-5:] == "PPPPP"
    assert run.velocities[-1] == pytest.approx(stable.velocities[0], abs=1e-12)
    assert run.phases[-1] == pytest.approx(stable.times[0], abs=1e-13)
