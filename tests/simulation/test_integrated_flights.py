"""Simulation of flights that are integrated."""

import numpy as np
import pytest
from integrated import Integrated
from scipy.integrate import solve_ivp

import contimpact as ci
from contimpact.results.scene import read_scene
from contimpact.segments.integration import limited_steps
from contimpact.segments.segment import ARRAYS, evaluate_in
from contimpact.segments.track import IntegratedCurve
from contimpact.simulation.attractor import Kind
from contimpact.simulation.run import Outcome
from contimpact.simulation.settle import settle
from contimpact.simulation.simulator import Simulator
from contimpact.systems.duffing import Duffing
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.pendulum import Pendulum

pytest.importorskip("heyoka", reason="needs contimpact[ode]")

OFTEN = {"a": 1.0, "omega": 1.3, "c": 0.1, "k": 1.0, "sigma": 0.5, "r": 0.8}
STICKING = {"a": 0.3, "omega": 0.3, "c": 0.1, "k": 1.0, "sigma": 0.1, "r": 0.3}


@pytest.mark.parametrize("values", [OFTEN, STICKING], ids=["impacts", "chatter and sticking"])
@pytest.mark.full
def test_impacts_are_those_of_the_closed_form(values):
    runs = []
    for kind in (Oscillator, Integrated):
        simulator = Simulator(kind(**values))
        runs.append(simulator.run(simulator.state("S", 0.3, 1.0), impacts=60))
    one, other = runs
    assert other.released.tolist() == one.released.tolist()
    assert any(one.released) == (values is STICKING)
    assert other.times == pytest.approx(one.times, abs=1e-11)
    assert other.velocities == pytest.approx(one.velocities, abs=1e-11)


@pytest.mark.full
def test_a_pendulum_settles_on_the_stable_orbit():
    model = Pendulum(a=1.0, omega=0.8, c=0.1, sigma=1.0, r=0.8)
    found = ci.find_orbits(model, "S", parameter="omega", starts=20, rounds=2)
    orbit = next(o for o in found if o.stable and o.physical)
    simulator = Simulator(model)
    run = simulator.run(simulator.state("S", 0.3, 1.0), impacts=120)
    assert run.velocities[-1] == pytest.approx(orbit.velocities[0], abs=1e-9)
    assert run.phases[-1] == pytest.approx(orbit.times[0], abs=1e-9)


def test_a_long_flight_misses_no_arrival():
    """A fast swing between slow ones: against impacts found on a mesh of the same motion."""
    model = Duffing(a=2.0, omega=0.31, c=0.02, alpha=1.0, beta=3.0, sigma=0.6, r=0.9)
    simulator = Simulator(model)
    run = simulator.run(simulator.state("S", 0.3, 0.1), impacts=25)
    motion = evaluate_in(simulator.kernels.motion("S"), ARRAYS)
    for k in range(24):
        length = run.times[k + 1] - run.times[k]
        inside = np.linspace(0.0, length, 2001)[1:-1]
        segment = simulator.kernels.segment("S", "S")
        x, _, _ = motion(run.times[k], run.velocities[k], inside, *simulator.values)
        assert np.max(x) < 1e-9
        arrived = segment.track((run.times[k], run.velocities[k]), length, simulator.values)
        assert arrived[0] == pytest.approx(0.0, abs=1e-12)
        assert arrived[1] == pytest.approx(run.velocities[k + 1], abs=1e-11)


def test_a_flight_that_escapes_runs_away():
    """Beyond the unstable rest of a softening spring motion is infinite after a finite time."""
    model = Duffing(a=0.3, omega=1.0, c=0.1, alpha=1.0, beta=-0.5, sigma=1.0, r=1.0)
    simulator = Simulator(model)
    run = simulator.run(simulator.state("S", 0.3, 30.0), impacts=200)
    assert (run.outcome, run.end, run.left) == (Outcome.RUNAWAY, None, None)


@pytest.mark.parametrize("spring", ["x", "x**3"])
@pytest.mark.full
def test_motion_that_runs_away_is_left(spring):
    """Without forcing and damping an impact is as fast as the wall has left the body, which doubles
    the velocity: 2, 4, 8, ... until a million."""
    scene = {
        "name": "doubling",
        "model": {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"w": 1.0, "a": 0.0},
            "modes": {"free": {"x": "v", "v": f"a*cos(w*t) - {spring}"}},
            "guards": {"S": {"mode": "free", "within": "x <= 0", "set": {"v": "-2*v"}}},
        },
        "follow": {"parameter": "w", "range": [0.9, 1.1], "orbits": ["S"]},
    }
    simulator = Simulator(read_scene(scene).model)
    run = simulator.run(simulator.state("S", 0.3, 1.0), impacts=200)
    assert (run.outcome, run.end, run.left) == (Outcome.RUNAWAY, None, None)
    assert run.velocities == pytest.approx(2.0 ** np.arange(1.0, 21.0), rel=1e-9)
    found = settle(simulator, simulator.state("S", 0.3, 1.0))
    assert (found.kind, found.notation, found.settled) == (Kind.RUNAWAY, "runaway", True)


def test_where_motion_keeps_clear_of_walls_nothing_is_isolated(monkeypatch):
    """A pendulum that settles below its stop for ever."""
    looked = []
    breaks = IntegratedCurve.breaks
    monkeypatch.setattr(IntegratedCurve, "breaks", lambda c: looked.append(c) or breaks(c))
    model = Pendulum(a=0.1, omega=0.8, c=0.1, sigma=1.5, r=0.8)
    simulator = Simulator(model, longest_flight=40)
    wall, dt, speed = simulator.fly(0, 0.3, 0.9)
    assert (wall, len(looked) <= 8) == (-1, True)  # the windows after the release

    def swinging(t, y):
        return [y[1], 0.1 * np.cos(0.8 * t) - 0.1 * y[1] - np.sin(y[0])]

    same = solve_ivp(swinging, (0.3, 0.3 + dt), [1.5, -0.8 * 0.9], "DOP853", rtol=1e-11, atol=1e-12)
    assert speed == pytest.approx(same.y[1, -1], abs=1e-9)
    assert np.max(same.y[0, 1:]) < 1.5


def test_a_flight_ends_where_its_motion_has_settled():
    """Differences fall by a third in each period: to 1e-11 of the motion in 65 or so of 1,000."""
    model = Pendulum(a=0.1, omega=0.8, c=0.1, sigma=1.5, r=0.8)
    wall, dt, _ = Simulator(model).fly(0, 0.3, 0.9)
    assert wall == -1
    assert 60 < dt * model["omega"] / (2 * np.pi) < 100


@pytest.mark.full
def test_a_flight_goes_on_beside_an_unstable_motion():
    """Begun on it, differences from the period before are rounding at first, and then grow."""
    model = {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": {"a": 1.0, "w": 1.7},
        "modes": {"m": {"x": "v", "v": "v/5 - x - x**3/100 + a*cos(w*t)"}},
        "guards": {"S": {"within": "x <= 2", "set": {"v": "-v/2"}}},
    }
    asked = {"parameter": "a", "range": [0.5, 1.5], "orbits": ["0"]}
    scene = read_scene({"name": "unstable", "model": model, "follow": asked})
    (orbit,) = ci.find_orbits(scene.model, "0", parameter="a")
    assert not orbit.stable
    x, v = orbit.unknowns[:2].tolist()
    for off in (0.0, 1e-13, 1e-9):
        state = Simulator(scene.model).start(0.0, [x + off], [v], "m")
        assert state is not None
        assert state.turns > 30


def test_long_flights_of_several_coordinates_go_on_from_window_to_window():
    """Lorenz's motion that is thrown back at a plane, after up to twenty turns. Each window was
    flown from the impact on, and bounded by what is rounded along all of it: one flight that met
    nothing had not ended after ten minutes."""
    law = {"x": "10*(y - x)", "y": "x*(28 - z) - y", "z": "x*y - 8*z/3"}
    guard = {"mode": "free", "within": "x <= h", "to": "free", "set": {"x": "0.3*h"}}
    model = {
        "system": "hybrid",
        "period": 0.75,
        "parameters": {"h": 15.0},
        "modes": {"free": law},
        "guards": {"S": guard},
    }
    asked = {"parameter": "h", "range": [10, 20], "orbits": ["S"]}
    simulator = Simulator(read_scene({"name": "thrown", "model": model, "follow": asked}).model)
    start = simulator.random_state(np.random.default_rng(1))
    with limited_steps(20_000) as budget:
        run = simulator.run(start, impacts=8)
    assert budget.left > 16_000

    def flow(t, u):
        return [10 * (u[1] - u[0]), u[0] * (28 - u[2]) - u[1], u[0] * u[1] - 8 * u[2] / 3]

    def arrives(t, u):
        return u[0] - 15.0

    arrives.terminal, arrives.direction = True, 1.0
    times = run.turns * simulator.period + run.phases
    assert np.max(np.diff(times)) > 5.0
    for k in range(7):
        begun = [4.5, *run.others[k, ::2]]
        way = (times[k], times[k] + 40.0), begun, "DOP853"
        found = solve_ivp(flow, *way, events=arrives, rtol=1e-12, atol=1e-12)
        assert found.t[-1] == pytest.approx(times[k + 1], abs=1e-8)
        assert run.others[k + 1, ::2] == pytest.approx(found.y[1:, -1], abs=1e-6)
        assert run.velocities[k + 1] == pytest.approx(flow(0.0, found.y[:, -1])[0], abs=1e-6)
