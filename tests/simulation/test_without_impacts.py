"""Motions that meet no guard: told apart by their mode, and matched with the word `0`."""

from __future__ import annotations

import importlib.util
import json
import math
from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp

from contimpact import Formulas, InputError, Model, Parameter, Simulator, read_scene, settle, sweep
from contimpact.diagrams.explore import follow as follow_scene
from contimpact.diagrams.scene_simulation import simulate
from contimpact.models.linear import Linear
from contimpact.models.model import Guard, Mode
from contimpact.orbits.search import find_orbits
from contimpact.results.diagram import Diagram
from contimpact.results.options import Settling
from contimpact.segments.track import IntegratedTrack
from contimpact.simulation.attractor import Attractor, Kind
from contimpact.simulation.settle import settle_again
from contimpact.simulation.simulator import state_after
from contimpact.simulation.sweep import Row, Simulators, Sweep, cover, same_attractor
from contimpact.simulation.transitions import find_transitions, locate
from contimpact.systems.belt import Belt
from contimpact.systems.duffing import Duffing
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.soft_stop import SoftStop

VALUES = {"a": 1.0, "w": 2.0, "c": 0.3, "k": 1.0, "e": 0.5, "P": 4.0, "kb": 5.0}


class Magnet(Model):
    """x'' + c x' + k x = a cos wt + [x > e](P - kb (x - e)): the body may stay where it is held."""

    SYSTEM = "magnet"
    MODES = (Mode("free"), Mode("held"))
    WALLS = (Guard("C", +1, "free", "held"), Guard("R", -1, "held", "free"))
    PARAMETERS = tuple(Parameter(name, "", name) for name in VALUES)

    def formulas(self, symbols):
        a, w, c, k, e, P, kb = (symbols[p.name] for p in self.PARAMETERS)
        period = 2 * sympy.pi / w

        def linear(stiffness, pull):
            given = {"mass": [[1]], "damping": [[c]], "stiffness": [[stiffness]]}
            return Linear(**given, period=period, force=lambda t: [a * sympy.cos(w * t) + pull])

        free, held = linear(k, 0), linear(k + kb, P + kb * e)
        return Formulas(
            period=period,
            walls={"C": e, "R": e},
            flight={"free": free.flight, "held": held.flight},
            acceleration={"free": free.acceleration, "held": held.acceleration},
        )


def response(k, c, w, a=1.0, mean=0.0):
    """Position and velocity at t = 0 of x'' + c x' + k x = a cos wt + mean k."""
    size = (k - w**2) ** 2 + (c * w) ** 2
    return mean + a * (k - w**2) / size, a * c * w**2 / size


@pytest.fixture(scope="module")
def simulator():
    return Simulator(Magnet(**VALUES))


@pytest.fixture(scope="module")
def free(simulator):
    return settle(simulator, simulator.start(0.0, position=0.0, velocity=0.0))


@pytest.fixture(scope="module")
def held(simulator):
    start = simulator.start(0.0, position=1.5, velocity=0.2, mode="held")
    return settle(simulator, start, mode="held")


def test_settle_says_what_a_start_that_meets_no_wall_leads_to(simulator, free):
    assert simulator.start(0.0, position=0.0, velocity=0.0) is None
    assert (free.kind, free.notation, free.mode) == (Kind.NO_IMPACT, "no impact", "free")
    assert free.motion == pytest.approx(response(1.0, 0.3, 2.0), rel=1e-12)


def test_modes_tell_motions_without_impacts_apart(free, held):
    assert (held.kind, held.notation, held.mode) == (Kind.NO_IMPACT, "no impact (held)", "held")
    assert held.motion == pytest.approx(response(6.0, 0.3, 2.0, mean=6.5 / 6.0), rel=1e-12)
    assert free != held
    assert free.label != held.label
    assert not same_attractor(free, held)
    assert same_attractor(held, held)


def test_a_motion_that_stops_hitting_says_in_which_mode_it_goes_on(simulator, held):
    found = settle(simulator, simulator.state("C", 2.0, 1.0))
    assert (found.mode, found.motion) == ("held", held.motion)


def test_records_keep_mode_and_motion(held):
    record = json.loads(json.dumps(held.as_record()))
    assert Attractor.from_record(record) == held
    record["motion"] = [1.0]
    with pytest.raises(ValueError, match="motion without all coordinates"):
        Attractor.from_record(record).require(Magnet(**VALUES))


def test_what_cannot_start_without_an_impact_says_so(simulator):
    with pytest.raises(InputError, match="state: None: the motion meets no wall"):
        simulator.run(None, impacts=10)
    start = simulator.start(0.0, position=0.0, velocity=0.0)
    with pytest.raises(InputError, match="start: None: the motion meets no wall; give an impact"):
        sweep(simulator.model, "w", [2.0, 1.9], start=start)


def test_a_start_in_another_mode_is_offered(simulator):
    with pytest.raises(InputError, match=r"beyond C, at which the mode 'free' ends; .*mode='held'"):
        simulator.start(0.0, position=1.0, velocity=0.0)


def test_a_mode_that_is_not_there_is_refused(simulator):
    with pytest.raises(InputError, match="no mode 'stuck'; the modes are free, held"):
        settle(simulator, None, mode="stuck")


@pytest.mark.full
def test_its_end_along_a_sweep_is_where_it_reaches_the_guard(free, held):
    """Held, the body swings about its mean with the amplitude a/hypot(k + kb - w^2, c w)."""
    model = Magnet(**VALUES)
    simulators = Simulators(model, "w")
    before, after = Row("up", 2.0, held), Row("up", 2.1, free)
    _, left, lost, _ = locate(simulators, before, after, 1e-2)
    far = 6.5 / 6.0 - 0.5
    limits = [1.0 / math.hypot(6.0 - w**2, 0.3 * w) - far for w in (left.value, lost.value)]
    assert limits[0] < 0.0 < limits[1]
    assert abs(lost.value - left.value) <= 1e-2


@pytest.mark.full
def test_its_end_is_found_where_a_guard_comes_to_it_as_it_is_started_anew():
    """At t = 0 the body is farthest out; the guard passes it there, and it starts half a period
    later. It was said to go on."""
    model = Magnet(**VALUES | {"w": 0.3, "a": 0.45})
    simulator = Simulator(model)
    free = settle(simulator, simulator.start(0.0, position=0.45, velocity=0.0))
    beyond = settle_again(Simulator(model.replace(e=0.485)), free)
    assert free.label != beyond.label == "no impact (held)"
    rows = Row("down", 0.496, free), Row("down", 0.485, beyond)
    _, left, lost, right = locate(Simulators(model, "e"), *rows, 4e-3)
    assert right.attractor.label == beyond.label
    assert left.value > 0.45 / math.hypot(0.91, 0.09) > lost.value
    assert left.value - lost.value <= 4e-3


@pytest.mark.full
def test_a_motion_that_is_not_known_is_not_followed(simulator, held):
    """Without damping it is quasiperiodic, which the transition says; it was said to go on."""
    model = Magnet(**VALUES | {"c": 0.0})
    undamped = Simulator(model)
    free = settle(undamped, undamped.start(0.0, position=0.0, velocity=0.0))
    assert (free.kind, free.motion) == (Kind.NO_IMPACT, None)
    rows = [Row("up", 1.0, free), Row("up", 1.2, held)]
    (found,) = find_transitions(Sweep(model, "a", rows), 1e-3)
    assert (found.kind, found.label) == (None, "no impact->no impact (held)")
    assert (found.before.value, found.after.value) == (1.0, 1.2)
    assert "no impact cannot be started anew beyond 1" in found.evidence
    assert "more simulate.values" in found.wide


def test_flights_by_kernels_settle_on_their_motion_too():
    """Of the soft stop, in closed form."""
    model = SoftStop(a=1.0, omega=2.0, c=0.3, k=1.0, e=0.5, k_b=20.0, c_b=0.3)
    simulator = Simulator(model, longest_flight=60)
    found = settle(simulator, simulator.state("C", 0.0, 1.0))
    assert found.motion == pytest.approx(response(1.0, 0.3, 2.0), rel=1e-9)


@pytest.mark.parametrize("closed", [False, True])
def test_a_sweep_stays_on_motion_without_impacts_until_it_reaches_the_wall(closed):
    """Beside it there is an orbit, on which impacts at random settle; each value began with one."""
    closed_form = Oscillator(a=1.0, omega=1.9, c=0.3, k=1.0, sigma=0.5, r=0.8)
    model = closed_form if closed else read_scene(RATTLE).model
    found = sweep(model, "omega", [1.9, 1.8, 1.7], settling=Settling(transient=40), rng=3)
    assert [a.notation for a in found.attractors] == ["no impact", "no impact", "1"]
    beside = Simulator(model.replace(omega=1.8))
    assert settle(beside, beside.random_state(3)).notation == "1"
    assert 1.0 / math.hypot(1.0 - 1.8**2, 0.3 * 1.8) < 0.5 < 1.0 / math.hypot(1.0 - 1.7**2, 0.51)
    assert found.attractors[1].motion == pytest.approx(response(1.0, 0.3, 1.8), rel=1e-12)


def test_a_sweep_of_integrated_flights_stays_on_motion_without_impacts():
    """Each value began with an impact at random; the grazing is at 1.6348."""
    pytest.importorskip("heyoka")
    model = Duffing(a=0.5, omega=2.0, c=0.1, alpha=1.0, beta=0.2, sigma=0.3, r=0.8)
    quick = Settling(transient=40)
    found = sweep(model, "omega", [1.9, 1.8, 1.6], settling=quick, rng=0).attractors
    assert [a.notation for a in found] == ["no impact", "no impact", "1"]
    beside = Simulator(model.replace(omega=1.8))
    assert settle(beside, beside.random_state(0), quick).notation == "1"
    (orbit,) = (
        o for o in find_orbits(beside.model, "0", parameter="omega") if o.physical and o.stable
    )
    assert found[1].motion == pytest.approx(orbit.unknowns[:2], abs=1e-9)


SCENE = {
    "name": "quiet",
    "model": {
        "system": "linear",
        "coordinates": ["x"],
        "mass": [1],
        "damping": ["c"],
        "stiffness": [1],
        "force": ["cos(omega*t)"],
        "period": "2*pi/omega",
        "guards": {"S": {"within": "x <= 1/2", "restitution": 0.1}},
        "parameters": {"omega": 2.0, "c": 0.5},
    },
    "follow": {"parameter": "omega", "range": [1.9, 2.4], "orbits": ["0"], "switch": []},
    "detect": {"events": ["G"]},
    "simulate": {"values": 3, "branches": True, "transitions": False, "periods": 100},
}


RATTLE = deepcopy(SCENE)
RATTLE["model"]["parameters"] = {"omega": 1.9, "c": 0.3}
RATTLE["model"]["guards"]["S"]["restitution"] = 0.8
RATTLE["follow"]["range"] = [1.7, 1.9]


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    return simulate(read_scene(SCENE), tmp_path_factory.mktemp("quiet"))


def test_motions_without_impacts_lie_on_branches_of_the_word_0(simulated):
    assert {row.attractor.notation for row in simulated.sweep.rows} == {"no impact"}
    assert simulated.coverage.uncovered == []
    found = simulated.coverage.matches
    assert [(m.branch, m.word, m.period) for m in found] == [("b1", "0", 1)] * 3
    assert max(m.distance for m in found) < 1e-9


def test_where_no_branch_has_them_a_scene_would_follow_them(simulated):
    (uncovered,) = cover(simulated.sweep, Diagram("none", [])).uncovered
    assert (uncovered.kind, uncovered.count) == ("no impact", 3)
    assert uncovered.why == "no branch has this orbit"
    assert 'orbits = ["0"]' in uncovered.scene


def test_of_a_motion_that_is_not_known_it_is_not_said_that_no_orbit_is_it(simulated):
    sweep, unknown = simulated.sweep, {"motion": None}
    rows = [replace(row, attractor=replace(row.attractor, **unknown)) for row in sweep.rows]
    (uncovered,) = cover(replace(sweep, rows=rows), Diagram("none", [])).uncovered
    assert (uncovered.scene, uncovered.why) == (
        None,
        "no impact: its motion, which may be an orbit 0, is not known",
    )


@pytest.mark.full
def test_a_free_body_that_is_not_damped_settles_on_nothing():
    model = Magnet(**VALUES | {"c": 0.0})
    simulator = Simulator(model)
    found = settle(simulator, simulator.start(0.0, position=0.0, velocity=0.0))
    assert found.motion is None
    assert np.array_equal(found.velocities, [])


@pytest.mark.full
def test_the_search_for_a_transition_tells_what_it_tries(tmp_path):
    """What went before it is not the last that is heard for its whole time."""
    options = {"values": 2, "transitions": True, "width": 0.1, "periods": 100, "impacts": 100}
    follow = SCENE["follow"] | {"range": [1.3, 2.4]}
    heard = []
    scene = read_scene(SCENE | {"follow": follow, "simulate": options})
    found = simulate(scene, tmp_path, progress=heard.append)
    assert len(found.transitions) == 1
    tried = [line for line in heard if "; trying omega = " in line]
    assert len(tried) > 2
    assert all(line.startswith("transitions: 0 of 1, about ") for line in tried)


def test_a_simulation_of_several_coordinates_continues_after_them(tmp_path):
    """Without impacts there is no table of coordinates; the rows were said to be damaged."""
    two = {"coordinates": ["x", "y"], "mass": [1, 1], "damping": ["c", "c"], "stiffness": [1, 2]}
    model = SCENE["model"] | two | {"force": ["cos(omega*t)", 0]}
    few = {"values": 3, "transitions": False, "periods": 100}
    scene = read_scene(SCENE | {"model": model, "simulate": few})
    rows = simulate(scene, tmp_path).sweep.rows
    again = simulate(scene, tmp_path, resume=True)
    assert [row.attractor.notation for row in rows] == ["no impact"] * 3
    assert (again.resumed, again.sweep.rows) == (3, rows)


def test_a_motion_may_leave_both_soft_stops_after_many_contacts():
    """Beside a fold it has more than a hundred contacts, and none in the periods looked at next."""

    def stopped(k, c, e):
        return {"x": "v", "v": f"F - {c}*v - {k}*(x - {e})"}

    free = {"x": "v", "v": "F"}
    model = {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": {"w": 2.41875},
        "define": {"F": "cos(w*t) - 0.05*v - x"},
        "modes": {"free": free, "right": stopped(15, 0.1, 1), "left": stopped(6, 0.3, -0.8)},
        "guards": {
            "A": {"mode": "free", "within": "x <= 1", "to": "right"},
            "B": {"mode": "right", "within": "x >= 1", "to": "free"},
            "C": {"mode": "free", "within": "x >= -0.8", "to": "left"},
            "D": {"mode": "left", "within": "x <= -0.8", "to": "free"},
        },
    }
    follow = {"parameter": "w", "range": [2.0, 3.0], "orbits": ["ABCD"]}
    given = read_scene({"name": "gap", "model": model, "follow": follow}).model
    simulator = Simulator(given)
    start = simulator.state("C", time=1.421646454417961, velocity=-5.319812585633188)
    assert settle(simulator, start).kind is Kind.NO_IMPACT


def test_a_sweep_of_integrated_flights_stays_on_motion_in_another_mode():
    """It was known where it settled first, not from where it went on: the value after the next one
    began at random."""
    pytest.importorskip("heyoka")
    modes = {
        "free": {"x": "v", "v": "a*cos(t) - v/5 - x - x**3/10 + 2"},
        "pressed": {"x": "v", "v": "a*cos(t) - 2*v/5 - 4*x - x**3/10 + 2"},
    }
    guards = {
        "I": {"mode": "free", "within": "x <= 0", "to": "pressed"},
        "O": {"mode": "pressed", "within": "x >= 0", "to": "free"},
    }
    model = {"system": "hybrid", "period": "2*pi", "parameters": {"a": 0.05}}
    model |= {"modes": modes, "guards": guards}
    asked = {"parameter": "a", "range": [0.01, 0.3], "orbits": ["IO"]}
    body = read_scene({"name": "pressed", "model": model, "follow": asked}).model
    here = settle(Simulator(body), Simulator(body).random_state(3))
    for a in (0.06, 0.07, 0.1):
        here = settle_again(Simulator(body.replace(a=a)), here)
        assert here.label == "no impact (pressed)"

    def motion(t, y):
        return [y[1], 0.1 * math.cos(t) - 0.4 * y[1] - 4.0 * y[0] - 0.1 * y[0] ** 3 + 2.0]

    there = solve_ivp(motion, (0.0, 60.0 * math.pi), [0.5, 0.0], rtol=1e-11, atol=1e-13).y[:, -1]
    assert here.motion == pytest.approx(there, abs=1e-9)


COUPLED = {
    "system": "hybrid",
    "period": "2*pi/w",
    "parameters": {"w": 1.2, "a": 0.1, "c": 0.2, "s": 1.8, "k": 0.3},
    "modes": {
        "in": {
            "x": "u",
            "u": "x - x**3 - c*u + a*cos(w*t) + k*(y - x)",
            "y": "v",
            "v": "-2*y - c*v + k*(x - y)",
        },
        "out": {"x": "u", "u": "-(x - 3) - (x - 3)**3 - c*u + a*cos(w*t)"},
    },
    "guards": {
        "C": {"mode": "in", "within": "x <= s", "to": "out"},
        "R": {"mode": "out", "within": "x >= s", "to": "in", "set": {"y": "0", "v": "0"}},
    },
}
"""A mass in a well that carries another one, which is lost in a third well beyond C."""


def coupled(t, z, beyond):
    """The rates, written anew."""
    x, u, y, v = z
    push = 0.1 * math.cos(1.2 * t) - 0.2 * u
    if beyond:
        return u, push - (x - 3) - (x - 3) ** 3, 0.0, 0.0
    return u, push + x - x**3 + 0.3 * (y - x), v, -2 * y - 0.2 * v + 0.3 * (x - y)


@pytest.mark.parametrize(
    ("wall", "mode", "near"),
    [("R", "in", (-0.8, 0.0, -0.1, 0.0)), ("C", "out", (3.0, 0.0, 0.0, 0.0))],
)
def test_motion_of_several_coordinates_that_is_integrated_is_known(wall, mode, near):
    """It had none: no portrait, and no match with a branch of `0`."""
    pytest.importorskip("heyoka")
    follow = {"parameter": "a", "range": [0.09, 0.11], "orbits": ["0"]}
    scene = read_scene({"name": "coupled", "model": COUPLED, "follow": follow})
    simulator = Simulator(scene.model)
    speed = {"R": -0.3, "C": 0.3}[wall]
    found = settle(simulator, simulator.state(wall, 0.5, speed, (0.0, 0.0)))
    assert (found.kind, found.mode) == (Kind.NO_IMPACT, mode)
    span, limits = 60 * 2 * math.pi / 1.2, {"rtol": 1e-11, "atol": 1e-13}
    after = solve_ivp(coupled, (0.0, span), near, "DOP853", args=(mode == "out",), **limits).y[
        :, -1
    ]
    assert found.motion == pytest.approx(after, abs=1e-8)
    quarter = solve_ivp(coupled, (0.0, 1.0), after, "DOP853", args=(mode == "out",), **limits).y
    place, velocity = state_after(simulator, mode, found.motion, 1.0)
    assert np.ravel([place, velocity], "F") == pytest.approx(quarter[:, -1], abs=1e-8)
    matches = cover(Sweep(scene.model, "a", [Row("up", 0.1, found)]), follow_scene(scene)).matches
    assert len(matches) == (mode == "in")


def test_motion_is_followed_until_it_has_settled(monkeypatch):
    """Not for a thousand periods; the orbit is solved for."""
    pytest.importorskip("heyoka")
    follow = {"parameter": "a", "range": [0.09, 0.11], "orbits": ["0"]}
    model = read_scene({"name": "coupled", "model": COUPLED, "follow": follow}).model
    simulator, flown = Simulator(model), []

    def counted(field, numbers, length):
        flown.append(length / simulator.period)
        return IntegratedTrack(field, numbers, length)

    monkeypatch.setattr("contimpact.simulation.simulator.IntegratedTrack", counted)
    motion = settle(simulator, simulator.state("R", 0.5, -0.3, (0.0, 0.0))).motion
    assert 50 < sum(flown) < 150
    orbits = find_orbits(model, "0", parameter="a")
    assert min(np.max(np.abs(o.unknowns[:4] - motion)) for o in orbits) < 1e-13


@pytest.mark.skipif(importlib.util.find_spec("heyoka") is None, reason="needs contimpact[ode]")
def test_slip_by_a_nonlinear_law_is_known():
    """The friction of a belt that is never met; its map was taken for a linear one."""
    values = {"a": 0.1, "omega": 1.0, "c": 0.2, "V": 2.5, "mu_0": 1.0, "delta": 3.0}
    model = Belt(friction="weakening", **values)
    simulator = Simulator(model)
    found = settle(simulator, simulator.random_state(0))

    def law(t, state):
        friction = values["mu_0"] / (1.0 - values["delta"] * (state[1] - values["V"]))
        force = values["a"] * math.cos(values["omega"] * t)
        return [state[1], force - values["c"] * state[1] - state[0] + friction]

    given = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
    place, speed = solve_ivp(law, (0.0, 200.0 * math.pi), [0.0, 0.0], **given).y[:, -1]
    acceleration = law(0.0, [place, speed])[1]
    assert found.motion == pytest.approx((speed - values["V"], acceleration), abs=1e-9)
