"""Integrated flights from impact to impact, compiled: against plain ones, and SciPy's."""

import importlib.util
import signal
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import contimpact as ci
from contimpact.results.scene import read_scene
from contimpact.simulation.integrated_flights import IntegratedRuns
from contimpact.simulation.run import LONG, Outcome
from contimpact.simulation.simulator import Simulator
from contimpact.systems.duffing import Duffing
from contimpact.systems.pendulum import Pendulum

pytest.importorskip("heyoka", reason="needs contimpact[ode]")
pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="the extra 'fast' is not installed"
)

BRANCHES = Path(__file__).parents[2] / "branches"
HARD = {"a": 1.0, "omega": 1.3, "c": 0.1, "alpha": 1.0, "beta": 0.5, "sigma": 0.5, "r": 0.8}
STICKING = {"a": 0.3, "omega": 0.3, "c": 0.1, "alpha": 1.0, "beta": 0.2, "sigma": 0.1, "r": 0.3}
SOFTENING = {"a": 0.3, "omega": 1.0, "c": 0.1, "alpha": 1.0, "beta": -0.5, "sigma": 1.0, "r": 1.0}


def scene_model(name):
    return ci.load_scene(BRANCHES / name / "scene.toml").model


MODELS = {
    "one coordinate": lambda: Duffing(**HARD),
    "chatter and sticking": lambda: Duffing(**STICKING),
    "a guard passed back and forth": lambda: scene_model("coco_piecewise"),
    "two coordinates": lambda: scene_model("impact_duffing"),
    "a mode of fewer coordinates": lambda: scene_model("coco_stick_slip"),
    "a law that switches": lambda: scene_model("coco_bang_bang"),
}


@pytest.fixture
def compiled(monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")


def after(machine, before, made=1):
    """What one plain flight makes of a state."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CONTIMPACT_COMPILED", "never")
        end, outcome, count, _ = machine.make(before, (made, 2**62), made, False, np.inf)
    return end if count else outcome


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("seed", [0, 1, 3])
@pytest.mark.quick(3)
def test_every_impact_is_that_of_plain_python(seed, name, compiled):
    """Guards, releases and outcomes are the same; times and states to rounding. Of one coordinate a
    run alone tells releases, not its end."""
    simulator = Simulator(MODELS[name]())
    assert simulator.machine._runs is not None
    start = simulator.random_state(seed)
    run = simulator.run(start, impacts=20)
    assert len(run) == 20
    for before, here in pairwise([start, *run.states()]):
        alone = after(simulator.machine, before)
        assert here.wall == alone.wall
        assert here.released == alone.released or simulator.model.DEGREES_OF_FREEDOM == 1
        time = (here.turns - alone.turns) * simulator.period + here.phase - alone.phase
        assert abs(time) < 1e-11
        assert here.section == pytest.approx(alone.section, rel=1e-10, abs=1e-10)
    assert simulator.machine._runs.engine.found is not None


def test_chatter_and_sticking_are_left_to_plain_python(compiled, monkeypatch):
    runs = []
    for mode in ("always", "never"):
        monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
        simulator = Simulator(Duffing(**STICKING))
        runs.append(simulator.run(simulator.state("S", 0.3, 1.0), impacts=60))
    one, other = runs
    assert np.count_nonzero(one.released) == 3
    assert one.released.tolist() == other.released.tolist()
    assert one.times == pytest.approx(other.times, abs=1e-10)


def test_impacts_are_where_an_integration_has_them(compiled):
    """SciPy's, to a tolerance of 1e-12, one flight after the other."""
    model = Duffing(**HARD)
    simulator = Simulator(model)
    start = simulator.state("S", 0.3, 1.0)
    run = simulator.run(start, impacts=10)

    def field(t, y):
        spring = HARD["alpha"] * y[0] + HARD["beta"] * y[0] ** 3
        return [y[1], HARD["a"] * np.cos(HARD["omega"] * t) - HARD["c"] * y[1] - spring]

    def gap(t, y):
        return HARD["sigma"] - y[0]

    gap.terminal, gap.direction = True, -1
    tight = {"rtol": 1e-12, "atol": 1e-13, "method": "DOP853", "events": gap}
    for before, here in pairwise([start, *run.states()]):
        begin = before.phase + before.turns * simulator.period
        left = [HARD["sigma"] - 1e-300, -HARD["r"] * before.velocity]
        found = solve_ivp(field, (begin, begin + 30.0), left, **tight)
        assert here.turns * simulator.period + here.phase == pytest.approx(found.t[-1], abs=1e-9)
        assert here.velocity == pytest.approx(found.y[1, -1], abs=1e-9)


def test_many_starts_end_where_each_does_alone(compiled):
    simulator = Simulator(Duffing(**HARD))
    starts = [simulator.random_state(seed) for seed in range(12)]
    together = simulator.run_all(starts, periods=5, threads=2)
    alone = [simulator.run(start, periods=5) for start in starts]
    assert [outcome for outcome, _ in together] == [run.outcome for run in alone]
    assert [end for _, end in together] == [run.end for run in alone]


@pytest.fixture
def calls(monkeypatch):
    """The periods that each call of compiled code is asked for, of all its starts."""
    asked, batch = [], IntegratedRuns.batch

    def counted(self, *given):
        call = batch(self, *given)

        def counting(at, when, limits):
            asked.append(int(np.sum(limits[1::2] - at[1::3])))
            if len(asked) == INTERRUPTED:
                signal.raise_signal(signal.SIGINT)
            return call(at, when, limits)

        return counting

    monkeypatch.setattr(IntegratedRuns, "batch", counted)
    return asked


INTERRUPTED = 12


def test_calls_of_many_starts_are_short(compiled, calls):
    """A call is not interrupted: it makes few periods, and where it ends the next one begins."""
    simulator = Simulator(Duffing(**HARD))
    starts = [simulator.random_state(seed) for seed in range(2)]
    together = simulator.run_all(starts, periods=600, threads=1)
    assert calls == [256, 256, 88] * 2
    alone = [simulator.run(start, periods=600) for start in starts]
    assert together == [(run.outcome, run.end) for run in alone]


@pytest.mark.parametrize("threads", [1, 2])
def test_an_interruption_ends_many_starts_at_once(threads, compiled, calls):
    simulator = Simulator(Duffing(**HARD))
    starts = [simulator.random_state(seed) for seed in range(100)]
    with pytest.raises(KeyboardInterrupt):
        simulator.run_all(starts, periods=1000, threads=threads)
    assert INTERRUPTED <= len(calls) < 100  # of 400


@pytest.mark.parametrize(("longest", "outcome"), [(LONG, Outcome.NO_IMPACT), (LONG + 1, None)])
def test_a_flight_that_is_too_long_for_a_call_is_left_to_plain_python(longest, outcome, compiled):
    model = Pendulum(a=0.1, omega=2.0, c=0.5, sigma=1.0, r=0.8)
    simulator = Simulator(model, longest_flight=longest)
    runs, start = simulator.machine._runs, simulator.state("S", 0.3, 0.1)
    assert runs.make(start, (9, 9), 9, False, np.inf)[1:3] == (outcome, 0)


@pytest.mark.parametrize("periods", [1.5, -1])
def test_many_starts_run_for_whole_periods(periods, compiled):
    """As one does: compiled code would not end at half a period."""
    simulator = Simulator(Duffing(**HARD))
    with pytest.raises(ci.InputError, match="whole number"):
        simulator.run_all([simulator.random_state(0)], periods=periods)


def test_a_flight_that_escapes_runs_away(compiled):
    """Beyond the unstable rest of a softening spring motion is infinite after a finite time."""
    simulator = Simulator(Duffing(**SOFTENING))
    run = simulator.run(simulator.state("S", 0.3, 30.0), impacts=200)
    assert (run.outcome, run.end, run.left) == (Outcome.RUNAWAY, None, None)


REBOUND, JUMP = {"v": "-.9*v"}, {"x": "s/2", "v": "-.9*v"}


@pytest.mark.parametrize("mode", ["never", "always"])
@pytest.mark.parametrize("change", [REBOUND, JUMP])
@pytest.mark.parametrize("beside", [{}, {"y": "u", "u": "x - y - u"}])
@pytest.mark.parametrize(
    ("law", "velocity", "outcome"),
    [("-x**1.5", 1.0, Outcome.UNDEFINED), ("x**3", 30.0, Outcome.RUNAWAY)],
)
@pytest.mark.filterwarnings("ignore:invalid value encountered in power:RuntimeWarning")
@pytest.mark.quick(1)
def test_where_a_law_has_no_value_is_told_from_motion_that_runs_away(
    law, velocity, outcome, beside, change, mode, monkeypatch
):
    """At x < 0 the power is no real number; it was called a motion that runs away, or raised an
    error. The cube makes x infinite after a finite time."""
    monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
    scene = {
        "name": "powers",
        "model": {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"w": 1.0, "a": 1.3, "s": 0.5},
            "modes": {"free": {"x": "v", "v": f"a*cos(w*t) + {law}"} | beside},
            "guards": {"S": {"within": "x <= s", "set": change}},
        },
        "follow": {"parameter": "w", "range": [0.9, 1.1], "orbits": ["S"]},
    }
    simulator = Simulator(read_scene(scene).model)
    start = simulator.state("S", 0.3, velocity, [0.0] * len(beside))
    run = simulator.run(start, impacts=50)
    assert (run.outcome, run.end, run.left) == (outcome, None, None)


def test_a_motion_that_meets_no_wall_says_so(compiled):
    """The stop is out of reach of the small orbit, on which a slow start settles."""
    model = Pendulum(a=0.1, omega=2.0, c=0.5, sigma=1.0, r=0.8)
    simulator = Simulator(model, longest_flight=50)
    run = simulator.run(simulator.state("S", 0.3, 0.1), impacts=200)
    assert run.outcome is Outcome.NO_IMPACT


@pytest.mark.parametrize("mode", ["never", "always"])
@pytest.mark.quick(1)
def test_a_flow_that_ceases_behind_a_guard_is_cut_there(mode, monkeypatch):
    """Behind its contact the force is singular: windows that reach so far are halved."""
    monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
    simulator = Simulator(scene_model("coco_stick_slip"))
    run = simulator.run(simulator.random_state(1), impacts=30)
    assert len(run) == 30
    assert run.outcome is Outcome.DONE


HIDDEN = {
    "exp": ("0.2*exp(50*(x - 0.4))", 2.0, 10.038384482, 1.507896894),
    "exp, fast": ("0.2*exp(50*(x - 0.4))", 10.0, 3.54941996, 7.76113984),
    "bump": ("90*(x + 1)*exp(-30*(x + 1)**2)", 5.0, 3.8474783, 3.85958059),
}
"""Forces below rounding beside the wall; velocities there, and SciPy's next impacts, with DOP853 in
steps of .002."""


@pytest.mark.parametrize("how", ["always", "never"])
@pytest.mark.parametrize("kind", HIDDEN)
@pytest.mark.quick(2)
def test_forces_below_rounding_where_a_flight_begins_are_met(kind, how, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", how)
    force, velocity, time, speed = HIDDEN[kind]
    modes = {"m": {"x": "v", "v": f"0.5*cos(w*t) - x - {force}"}}
    guards = {"S": {"within": "x <= s", "set": {"v": "-r*v"}}}
    model = {"system": "hybrid", "period": "2*pi/w", "modes": modes, "guards": guards}
    model["parameters"] = {"w": 1.2, "s": 0.6, "r": 0.9}
    follow = {"parameter": "w", "range": [1, 2], "orbits": ["1"]}
    simulator = Simulator(read_scene({"name": "hidden", "model": model, "follow": follow}).model)
    run = simulator.run(simulator.state("S", 0.3, velocity), impacts=1)
    assert run.turns[0] * run.period + run.phases[0] == pytest.approx(time, abs=1e-8)
    assert run.velocities[0] == pytest.approx(speed, abs=1e-8)
