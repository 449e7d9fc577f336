"""Flights that begin on the surface of a guard of their mode, and leave it at once."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest
from scipy.optimize import brentq
from zoo import unknowns_of

from contimpact import continue_orbit, find_orbits
from contimpact.models.guards import Word
from contimpact.orbits.orbit import Orbit
from contimpact.orbits.problem import Linearisation, OrbitProblem
from contimpact.orbits.search import solve_near
from contimpact.results.scene import read_scene
from contimpact.segments.kernels import Kernels
from contimpact.simulation.run import Outcome
from contimpact.simulation.simulator import Simulator

LAW = "a*cos(w*t) - x - 2*z*v"
FRICTION = {
    "name": "friction",
    "model": {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": {"a": 1.0, "F": 0.3, "w": 0.5, "z": 0.02},
        "modes": {"up": {"x": "v", "v": f"{LAW} - F"}, "down": {"x": "v", "v": f"{LAW} + F"}},
        "guards": {
            "A": {"mode": "up", "within": "v >= 0", "to": "down"},
            "B": {"mode": "down", "within": "v <= 0", "to": "up"},
        },
    },
    "follow": {"parameter": "w", "range": [0.4, 0.6], "orbits": ["AB"]},
}
"""A body with dry friction that never sticks, and whose guards all lie on v = 0."""


def friction(**values):
    table = FRICTION["model"]
    changed = {**FRICTION, "model": {**table, "parameters": {**table["parameters"], **values}}}
    return read_scene(changed).model


def slipping(model):
    """The orbit on which both impacts run towards their guards."""
    found = find_orbits(model, "AB", parameter="w")
    return next(o for o in found if o.velocities[0] < 0.0 < o.velocities[1])


def where_it_sticks(z, a=1, friction=0.3):
    """When the body turns at A, where, and at what frequency its rate vanishes after it, by the
    closed form of the half period in which it moves back."""

    def residual(w, turns, x0):
        root, half = mp.sqrt(1 - z**2), mp.pi / w
        response = a / mp.mpc(1 - w**2, 2 * z * w)

        def steady(t):
            moved = response * mp.expj(w * t)
            return mp.re(moved) + friction, mp.re(1j * w * moved)

        (x, v), e = steady(turns), mp.exp(-z * half)
        x, v = x0 - x, -v
        cos, sin = mp.cos(root * half), mp.sin(root * half) / root
        p, q = steady(turns + half)
        later = p + e * (x * cos + (v + z * x) * sin)
        speed = q + e * (v * cos - (x + z * v) * sin)
        return [later + x0, speed, a * mp.cos(w * turns) - x0 + friction]

    with mp.workdps(30):
        return mp.findroot(residual, (0.4921, 0.0066, 1.3))


@pytest.mark.parametrize(("w", "physical"), [(0.45, False), (0.49, False), (0.495, True)])
@pytest.mark.full
def test_an_orbit_that_leaves_its_mode_at_once_is_unphysical(w, physical):
    orbit = slipping(friction(w=w))
    assert orbit.physical is physical
    if not physical:
        assert orbit.reason.startswith("flight 1 (A to B) passes wall B by ")


@pytest.mark.full
def test_where_it_does_is_a_grazing_with_an_error():
    limit = where_it_sticks(mp.mpf(0.02), friction=mp.mpf(0.3))
    branch = continue_orbit(slipping(friction()), "w", (0.48, 0.52), events=["G", "V"])
    grazings = [event for event in branch.events if event.kind == "G"]
    assert {(e.impact, e.wall) for e in grazings} == {(0, "B"), (1, "A")}
    for event in grazings:
        assert abs(event.value - float(limit[0])) <= event.error < 1e-12
    inside = branch["w"] > float(limit[0])
    assert np.array_equal(branch.physical[~branch.between], inside[~branch.between])
    assert not branch.missed


ON_THE_BELT = {
    "vanishes": (
        0.61277,
        [1.02344e01, -0.599999, 1.297930, 0.05, 1.0234512e01, -6e-7, 1.297931, 0.05],
    ),
    "rests where it ends": (
        0.349722,
        [-1.718233, -0.732034, 1.254856, 0.05, 9.747844, 2.7e-5, -0.666477, 0.05],
    ),
    "rests where it begins": (
        0.339661,
        [-1.433403, -0.599941, 1.181742, 0.05, 10.741412, 0.157854, -0.734132, 0.05],
    ),
}
"""Orbits of a body on a belt near to where a flight vanishes or rests."""


@pytest.mark.parametrize("what", ON_THE_BELT)
def test_nothing_is_missed_where_a_flight(what):
    """A quotient of a velocity passes infinity with the flight; the gap of a flight jumps, whose
    excursion belongs to an impact that runs the wrong way on one side only."""
    w, unknowns = ON_THE_BELT[what]
    table = FRICTION["model"]
    guards = {
        name: guard | {"within": guard["within"].replace("0", "V")}
        for name, guard in table["guards"].items()
    }
    parameters = table["parameters"] | {"w": w, "V": 0.05}
    model = table | {"parameters": parameters, "guards": guards}
    follow = FRICTION["follow"] | {"range": [0.9 * w, 1.1 * w]}
    model = read_scene(FRICTION | {"model": model, "follow": follow}).model
    problem = OrbitProblem(model, Word("AB"), Kernels(model, "w"))
    orbit = Orbit(problem, solve_near(problem, np.array([*unknowns, w])))
    branch = continue_orbit(orbit, "w", (w - 2e-5, w + 2e-5), events=["G", "V"])
    assert len(branch) > 2
    assert branch.events
    assert not branch.missed


@pytest.mark.full
def test_a_coordinate_that_vanishes_at_all_impacts_is_measured_along_the_flights():
    """The rate of x is v, which is zero on both surfaces."""
    orbit = slipping(friction())
    sizes = orbit.problem.scale(orbit.unknowns, 1.0)[:4] / np.sqrt(2.0)
    assert np.max(np.abs(orbit.problem.impacts(orbit.unknowns)[:, 3])) < 1e-12
    assert 0.1 < sizes[3] / np.ptp(orbit.problem.impacts(orbit.unknowns)[:, 2]) < 5.0


DAMPED_FILM = {
    "name": "film",
    "model": {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": {"a": 1.0, "w": 0.8, "z": 0.1, "e": 0.2, "H": 0.2},
        "modes": {"left": {"x": "v", "v": LAW}, "right": {"x": "v", "v": LAW}},
        "guards": {
            "A": {"mode": "left", "within": "x <= e", "to": "right", "set": {"v": "v - H"}},
            "B": {"mode": "right", "within": "x >= e", "to": "left"},
        },
    },
    "follow": {"parameter": "H", "range": [0.1, 3.0], "orbits": ["AB"]},
}


@pytest.mark.full
def test_a_jump_that_takes_all_of_the_velocity_ends_what_is_physical():
    """A film takes H of the velocity: the body goes through where it comes with more."""
    model = read_scene(DAMPED_FILM).model
    orbit = next(o for o in find_orbits(model, "AB", parameter="H") if o.physical)
    branch = continue_orbit(orbit, "H", (0.1, 3.0), events=["G", "V"])
    (event,) = [e for e in branch.events if e.kind == "G" and e.impact == 0]
    assert abs(event.impacts[0]["velocity"] - event.value) < 1e-11
    told = ~branch.between
    turned = (branch["v1"] < branch["H"]) & told
    assert turned.any()
    assert not branch.physical[turned].any()


AT_REST = {
    "name": "at rest",
    "model": {
        "system": "hybrid",
        "period": "4*pi",
        "parameters": {"c": 0.02},
        "modes": {mode: {"x": "v", "v": "cos(t) + c"} for mode in ("left", "right")},
        "guards": {
            "A": {"mode": "left", "within": "x <= 0", "to": "right"},
            "B": {"mode": "right", "within": "x >= 0", "to": "left"},
        },
    },
    "follow": {"parameter": "c", "range": [0.01, 0.03], "orbits": ["AB"]},
}


@pytest.mark.parametrize("speed", [-1e-17, 0.0, 1e-17])
def test_the_sign_of_rounding_does_not_tell_what_a_flight_from_rest_passes(speed):
    """From rest at t = pi: x = -1 - cos t + c (t - pi)^2 / 2 falls, rises beyond 0, and reaches
    it falling."""
    c, start = 0.02, np.pi

    def x(t):
        return -1.0 - np.cos(t) + c * (t - start) ** 2 / 2

    def v(t):
        return np.sin(t) + c * (t - start)

    arrival = brentq(x, 3 * np.pi, 4 * np.pi, xtol=1e-15)
    depth = -x(brentq(v, 1.5 * np.pi, 2.5 * np.pi, xtol=1e-15))
    model = read_scene(AT_REST).model
    problem = OrbitProblem(model, Word("AB"), Kernels(model, "c"))
    orbit = Linearisation(problem, unknowns_of(problem, [start, arrival], [speed, v(arrival)]))
    (touch,) = [t for t in orbit.gaps[0].touches if t is not None and t.wall == "B"]
    assert abs(touch.gap + depth) < 1e-12
    assert not orbit.verdict.physical


# Motions that are simulated.


@pytest.mark.parametrize(("w", "lasts"), [(0.45, False), (0.6, True)])
def test_motion_that_does_not_leave_its_guard_is_not_simulated_on(w, lasts):
    """A body would stick where its rate in the new mode leads back: it has come to rest by then."""
    model = friction(w=w)
    simulator = Simulator(model)
    a, friction_force = model["a"], model["F"]
    rate = float(a * np.cos(0.4 * w)) - 2.0 - friction_force
    run = simulator.run(simulator.state("A", 0.4, rate, (2.0, 0.0)), impacts=40)
    assert run.outcome is (Outcome.DONE if lasts else Outcome.BEYOND)
    force = np.where(run.walls == 0, -friction_force, friction_force)  # before the impact
    rates = a * np.cos(w * run.phases) - run.others[:, 0] + force
    assert run.velocities == pytest.approx(rates, abs=1e-9)
    before = run.velocities + np.where(run.walls == 0, 1.0, -1.0) * 2.0 * friction_force
    on = np.where(run.walls == 0, before < 0.0, before > 0.0)
    assert on[:-1].all()
    assert bool(on[-1]) is lasts


JUMP = {
    "name": "jump",
    "model": {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": {"a": 1.0, "w": 1.1, "e": 0.1, "H": 0.3},
        "modes": {
            "left": {"x": "v", "v": "a*cos(w*t) - x - 0.2*v"},
            "right": {"x": "v", "v": "a*cos(w*t) - 3*x - 0.2*v"},
        },
        "guards": {
            "A": {"mode": "left", "within": "x <= e", "to": "right", "set": {"v": "v - H"}},
            "B": {"mode": "right", "within": "x >= e", "to": "left"},
        },
    },
    "follow": {"parameter": "w", "range": [0.6, 1.5], "orbits": ["AB"]},
}


@pytest.mark.parametrize("law", ["", " - x**3/10"])
@pytest.mark.parametrize("speed", [0.29, 0.31])
def test_a_jump_back_ends_a_run(law, speed):
    """A body that arrives more slowly than H would be on the other side's guard for ever."""
    table = {**JUMP["model"], "modes": {n: dict(m) for n, m in JUMP["model"]["modes"].items()}}
    for mode in table["modes"].values():
        mode["v"] += law
    simulator = Simulator(read_scene({**JUMP, "model": table}).model)
    run = simulator.run(simulator.state("A", 0.3, speed), impacts=3)
    assert run.outcome is (Outcome.DONE if speed > 0.3 else Outcome.BEYOND)
    assert len(run) == (3 if speed > 0.3 else 0)


def test_random_impacts_are_followed_by_flights():
    simulator = Simulator(friction(w=0.6))
    rng = np.random.default_rng(3)
    starts = [simulator.random_state(rng) for _ in range(40)]
    assert all(len(simulator.run(start, impacts=1)) == 1 for start in starts)


def test_pitchforks_that_are_not_asked_for_are_no_folds_that_are_missed():
    """The orbit is symmetric; along its branch the frequency turns once, at a fold."""
    model = friction().replace(w=0.9)
    orbit = next(o for o in find_orbits(model, "AB", parameter="w") if o.physical)
    for asked in (["FB"], ["FB", "BP"]):
        branch = continue_orbit(orbit, "w", (0.3, 1.0), events=asked)
        assert not branch.missed
        kinds = [event.kind for event in branch.events]
        assert kinds == (["FB"] if asked == ["FB"] else kinds)
    assert kinds.count("BP") == 3
