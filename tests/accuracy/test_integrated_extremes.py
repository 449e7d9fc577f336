"""Extreme integrated flights: each has the right answer, or an end that says what it is."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import contimpact as ci
from contimpact.continuation.branch import EndKind
from contimpact.models.guards import Word
from contimpact.orbits.quiet import problem_of
from contimpact.orbits.search import orbit_at
from contimpact.segments.kernels import Kernels
from contimpact.simulation.run import Outcome
from contimpact.simulation.simulator import Simulator
from contimpact.systems.pendulum import Pendulum

pytest.importorskip("heyoka", reason="needs contimpact[ode]")

VALUES = {"a": 0.3, "omega": 1.0, "c": 0.1, "sigma": 1.5, "r": 0.8}


def flown(values, start, begin, end, method="DOP853", rtol=1e-12):
    a, w, c = (values[name] for name in ("a", "omega", "c"))

    def swinging(t, y):
        return [y[1], a * math.cos(w * t) - c * y[1] - math.sin(y[0])]

    return solve_ivp(swinging, (begin, end), start, method, rtol=rtol, atol=1e-14).y[:, -1]


@pytest.mark.parametrize("omega", [1e-3, 1e-2, 0.1, 1.5, 10.0, 1e2, 1e3])
@pytest.mark.full
def test_orbits_over_six_decades_of_frequency(omega):
    """From the linear response, or from rest where the forcing is slow."""
    values = VALUES | {"omega": omega}
    model = Pendulum(**values)
    problem = problem_of(model, Word(""), Kernels(model, "omega"))
    answer = values["a"] / complex(1.0 - omega**2, values["c"] * omega)
    slow = math.asin(values["a"]) if omega < 0.3 else answer.real
    orbit = orbit_at(problem, np.array([slow, -omega * answer.imag, omega]))
    assert orbit.residual < 1e-11
    state = orbit.unknowns[:2]
    back = flown(values, state, 0.0, 2.0 * math.pi / omega)
    assert back == pytest.approx(state, abs=1e-9 * float(np.max(np.abs(state))))
    assert orbit.physical


@pytest.mark.full
def test_a_flight_under_strong_damping():
    """c = 1e4: against an implicit method."""
    values = VALUES | {"c": 1e4}
    simulator = Simulator(Pendulum(**values), longest_flight=2)
    wall, dt, speed = simulator.fly(0, 0.3, 1.0)
    assert wall == -1  # it creeps away from the stop
    same = flown(values, [1.5, -0.8], 0.3, 0.3 + dt, "Radau", 1e-10)
    assert speed == pytest.approx(same[1], rel=1e-9)
    run = simulator.run(simulator.state("S", 0.3, 1.0), impacts=3)
    assert run.outcome is Outcome.NO_IMPACT


def test_a_stop_beyond_upright():
    """Orbits that pass the upright position by little are followed, and verified."""
    values = {"a": 1.0, "omega": 0.8, "c": 0.1, "sigma": 3.1, "r": 0.8}
    found = ci.find_orbits(Pendulum(**values), "S", parameter="sigma", starts=20, rounds=1)
    assert found
    branch = ci.continue_orbit(
        found[0], "sigma", (3.1, 3.2), events=["UZ"], values={"sigma": [math.pi]}
    )
    assert [end.kind for end in branch.ends] == [EndKind.RANGE] * 2
    assert [entry.kind for entry in branch.events] == ["UZ"]
    for entry in branch.events:
        t, v = entry.times[0], entry.velocities[0]
        span = 2.0 * math.pi / values["omega"]
        back = flown(values, [math.pi, -0.8 * v], t, t + span)
        assert back == pytest.approx([math.pi, v], abs=1e-8 * max(1.0, abs(v)))
