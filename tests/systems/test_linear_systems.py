"""Systems with linear flights and rigid walls, against closed forms."""

from __future__ import annotations

import cmath
import copy
import math

import numpy as np
import pytest

from contimpact.bifurcations.kind import test_functions as functions
from contimpact.continuation.settings import Settings
from contimpact.diagrams.explore import follow
from contimpact.diagrams.orbit_walks import symmetric, symmetry_of, walk_both_ways
from contimpact.orbits.search import find_orbits
from contimpact.results.scene import read_scene
from contimpact.simulation.simulator import Simulator
from contimpact.systems.coupled_by_impact import CoupledByImpact
from contimpact.systems.impact_damper import ImpactDamper
from contimpact.systems.two_stops import TwoStops

MASRI = {"Omega": 1.0, "d": 20.0, "r": 0.8, "mu": 0.1, "zeta": 0.01}


def test_the_impact_damper_of_masri():
    """Against his numbers, and his equations: two impacts in a period, half a period apart.

    Between them the ball runs with constant velocity through the container. The oscillator's motion
    changes sign after half a period: it is the response to the force, and to kicks of alternating
    sign.
    """
    orbits = find_orbits(ImpactDamper(**MASRI), "RL", parameter="d", starts=64)
    orbit = next(o for o in orbits if o.stable and o.physical)
    time, speed, x, rate = orbit.problem.impacts(orbit.unknowns)[0]
    assert x == pytest.approx(2.0901334328, abs=1e-9)
    assert rate + speed == pytest.approx(7.6968179939, abs=1e-9)
    omega, d, r, mu, zeta = MASRI.values()
    half, kick = math.pi / omega, mu * (1.0 + r) / (1.0 + mu)
    assert [x, rate] == pytest.approx(
        antisymmetric(1.0, omega, 2.0 * zeta, 1.0, time, kick * speed), abs=1e-10
    )
    after = rate + kick * speed - r * speed
    assert after == pytest.approx(-(rate + speed), abs=1e-10)
    assert after * half + 2.0 * x + d == pytest.approx(0.0, abs=1e-10)
    assert symmetric(orbit.problem, orbit.unknowns, symmetry_of(orbit.problem), 1e-10)


def antisymmetric(a, omega, c, k, time, kick):
    """The state before a kick of an oscillator kicked every half period, with alternating signs."""
    flow = flown(c, k, math.pi / omega)
    transient = -np.linalg.solve(np.eye(2) + flow, flow @ [0.0, kick])
    return steady(a, omega, c, k, time) + transient


def flown(c, k, time):
    """The free motion of an oscillator."""
    values, vectors = np.linalg.eig(np.array([[0.0, 1.0], [-k, -c]]))
    return ((vectors * np.exp(values * time)) @ np.linalg.inv(vectors)).real


def steady(a, omega, c, k, time):
    """Its steady response to a cos(omega t)."""
    wave = a / complex(k - omega**2, c * omega) * np.exp(1j * omega * time)
    return np.array([wave.real, (1j * omega * wave).real])


def test_product_of_the_damper_s_multipliers():
    orbit = find_orbits(ImpactDamper(**MASRI), "RL", parameter="d", starts=64)[0]
    truth = 0.8**4 * math.exp(-2.0 * 0.01 * 2.0 * math.pi)
    assert np.prod(orbit.multipliers) == pytest.approx(truth, rel=1e-11)


def rattling(a, omega, c, k, sigma, r):
    """Time and velocity before the impact at R of the symmetric orbits between two stops.

    With f the transient before an impact of unit velocity, sigma = X cos(phase) + f_0 v and
    v = -X omega sin(phase) + f_1 v: without the phase a quadratic in v.
    """
    free = antisymmetric(0.0, omega, c, k, 0.0, -(1.0 + r))
    gain = a / complex(k - omega**2, c * omega)
    rate = (1.0 - free[1]) / omega
    roots = np.roots([free[0] ** 2 + rate**2, -2.0 * sigma * free[0], sigma**2 - abs(gain) ** 2])
    phases = (math.atan2(-rate * v, sigma - free[0] * v) - np.angle(gain) for v in roots)
    return [(p % (2.0 * math.pi) / omega, v) for p, v in zip(phases, roots, strict=True)]


@pytest.mark.parametrize("k", [1.3, 0.0, 4.0])
def test_symmetric_orbits_between_two_stops(k):
    given = {"a": 1.0, "omega": 1.7, "c": 0.1, "k": k, "sigma": 0.2, "r": 0.7}
    model = TwoStops(**given)
    orbits = find_orbits(model, "RL", parameter="sigma", starts=64)
    symmetry = symmetry_of(orbits[0].problem)
    rows = [
        o.problem.impacts(o.unknowns)[0]
        for o in orbits
        if symmetric(o.problem, o.unknowns, symmetry, 1e-9)
    ]
    for time, v in rattling(**given):
        assert min(max(abs(row[0] - time), abs(row[1] - v)) for row in rows) < 1e-10


def test_undamped_resonance_has_impacting_orbits():
    model = TwoStops(a=1.0, omega=1.0, c=0.0, k=1.0, sigma=0.5, r=0.6)
    orbits = find_orbits(model, "RL", parameter="sigma", starts=64)
    assert any(o.stable and o.physical for o in orbits)
    assert np.prod(orbits[0].multipliers) == pytest.approx(0.6**4, rel=1e-12)


@pytest.mark.parametrize(
    ("given", "parameter"),
    [({"b": 0.1}, "a"), ({}, "b"), ({"sigma_R": 0.2, "sigma_L": 0.2}, "sigma_R")],
)
def test_what_tells_the_stops_apart_breaks_the_symmetry(given, parameter):
    values = {"a": 1.0, "omega": 1.7, "c": 0.1, "k": 0.0, "r": 0.7, **given}
    model = TwoStops(**({"sigma": 0.2} | values if "sigma_R" not in given else values))
    assert model.symmetry(parameter, ()) is None
    assert TwoStops(a=1.0, omega=1.7, c=0.1, k=0.0, r=0.7, sigma=0.2).symmetry("a", ()) is not None


def coupled(**given):
    values = {
        "c1": 0.1,
        "c2": 0.2,
        "k1": 1.0,
        "k2": 2.0,
        "a1": 1.0,
        "omega": 1.3,
        "gap": 0.2,
        "r": 0.7,
        "m2": 2.0,
    }
    return CoupledByImpact(**(values | given))


def test_impacts_between_bodies_keep_the_momentum():
    """The orbit, by each oscillator's own Green's function of kicks once in a period."""
    model = coupled()
    orbit = next(o for o in find_orbits(model, "K", parameter="gap", starts=64) if o.physical)
    (time, speed, x2, v2), p = orbit.problem.impacts(orbit.unknowns)[0], model.values
    period = 2.0 * math.pi / p["omega"]
    exchanged = (1.0 + p["r"]) * speed / (p["m1"] + p["m2"])
    kicks = (-p["m2"] * exchanged, p["m1"] * exchanged)
    truth = [
        periodic(p[f"m{i}"], p[f"c{i}"], p[f"k{i}"], p[f"a{i}"], p["omega"], time, kick, period)
        for i, kick in ((1, kicks[0]), (2, kicks[1]))
    ]
    assert truth[1] == pytest.approx([x2, v2], abs=1e-10)
    assert truth[0] == pytest.approx([x2 + p["gap"], v2 + speed], abs=1e-10)
    product = p["r"] ** 2 * math.exp(-(0.1 + 0.2 / 2.0) * period)
    assert np.prod(orbit.multipliers) == pytest.approx(product, rel=1e-11)


def periodic(m, c, k, a, omega, time, kick, period):
    """The state before each kick of an oscillator that is kicked once in a period."""
    flow = flown(c / m, k / m, period)
    transient = np.linalg.solve(np.eye(2) - flow, flow @ [0.0, kick])
    return steady(a / m, omega, c / m, k / m, time) + transient


@pytest.mark.full
def test_branches_of_impacting_bodies_have_events():
    orbit = next(o for o in find_orbits(coupled(), "K", parameter="omega", starts=64) if o.physical)
    tests = functions(orbit.problem, ["FB", "PD", "G"], {})
    run = walk_both_ways(orbit.problem, orbit.unknowns, (0.9, 1.9), tests, Settings())
    assert run.events
    assert all(event.error < 1e-10 for event in run.events)


def test_simulation_between_two_stops_settles_on_the_stable_orbit():
    model = TwoStops(a=1.0, omega=1.7, c=0.1, k=0.0, sigma=0.5, r=0.7)
    orbits = find_orbits(model, "RL", parameter="sigma", starts=64)
    orbit = next(o for o in orbits if o.stable and o.physical)
    simulator = Simulator(model)
    end = simulator.run(simulator.state("R", 0.3, 0.9), impacts=200).end
    time, speed = orbit.problem.impacts(orbit.unknowns)[0]
    assert (end.phase, end.velocity) == pytest.approx((time, speed), abs=1e-10)


CORNER = {
    "name": "corner",
    "model": {
        "system": "linear",
        "coordinates": ["x", "y"],
        "mass": [[1, 0], [0, 1]],
        "damping": [[0.2, 0], [0, 0.2]],
        "stiffness": [[1, 0], [0, 2]],
        "force": ["a*cos(w*t)", "b*cos(w*t)"],
        "period": "2*pi/w",
        "parameters": {"a": 1.0, "b": 0.2, "w": 1.3, "d": 0.2, "g": 1.0, "r": 0.8},
        "guards": {
            "A": {"within": "x <= d", "restitution": "r"},
            "C": {"within": "x + y <= g", "restitution": "r"},
        },
    },
    "follow": {"parameter": "g", "range": [-0.5, 1.0], "orbits": ["A"], "max_branches": 1},
    "detect": {"events": ["G", "V", "T"]},
    "numerics": {"max_step": 0.05},
}
"""Two bodies that know nothing of each other, and a guard on the sum of their positions, which is
largest where the first one hits its wall."""


@pytest.mark.full
def test_a_gap_that_is_smallest_at_an_impact_elsewhere_is_found():
    scene = read_scene({**CORNER, "follow": {**CORNER["follow"], "unphysical": True}})
    (branch,) = follow(scene).branches
    (event,) = branch.events
    response = 0.2 / (2.0 - 1.3**2 + 0.26j)
    expected = 0.2 + (response * cmath.exp(1.3j * branch["t1"][0])).real
    assert (event.kind, event.wall, event.impact) == ("G", "C", 0)
    assert event.value == pytest.approx(expected, abs=1e-13)
    assert branch.missed == []
    assert np.array_equal(branch["physical"] == 1, branch["g"] >= event.value)
    assert branch["smallest_gap"][0] == pytest.approx(branch["g"][0] - expected, abs=1e-12)
    others = [branch["x1_1"][0], branch["v1_1"][0]]
    for beside, word in ((1e-6, "AAAA"), (-1e-6, "C")):
        simulator = Simulator(scene.model.replace(g=event.value + beside))
        state = simulator.state("A", branch["t1"][0], branch["v1"][0], others)
        assert simulator.run(state, impacts=4).word.startswith(word)


@pytest.mark.full
def test_a_touch_inside_a_flight_is_not_that_at_its_end():
    """On the orbit that touches the guard from within a flight and passes it at an impact."""
    table = copy.deepcopy(CORNER)
    k1, k2, c = 2.391, 1.364, 0.545
    table["model"] |= {
        "mass": [[1, 0], [0, 0.662]],
        "damping": [[0.095, 0], [0, 0.137]],
        "stiffness": [[k1 + c, -c], [-c, k2 + c]],
        "force": ["a*cos(w*t)", "b*sin(w*t)"],
        "parameters": {"a": 1.408, "b": 0.011, "w": 1.39, "d": 0.236, "g": 0.6, "r": 0.696},
    }
    table["model"]["guards"]["C"]["within"] = "x - 0.587*y <= g"
    table["follow"]["unphysical"] = True
    (branch,) = follow(read_scene(table)).branches
    inside, corner = branch.events
    assert (inside.kind, inside.impact, inside.physical) == ("G", None, False)
    assert (corner.kind, corner.impact, corner.physical) == ("G", 0, True)
    assert np.array_equal(branch["physical"] == 1, branch["g"] >= corner.value)
