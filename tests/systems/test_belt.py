"""Dry friction on a belt: stick and slip against an integration of the body's own position."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import contimpact as ci
from contimpact.errors import InputError
from contimpact.results.scene import read_model
from contimpact.simulation.run import Outcome
from contimpact.simulation.simulator import Simulator
from contimpact.systems.belt import Belt

VALUES = {"a": 0.2, "omega": 1.3, "c": 0.1, "V": 0.3, "mu_0": 0.4, "delta": 0.0}
EVENTS = ["FB", "PD", "G", "V"]
TIGHT = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-15}


def by_integration(start, values):
    """From the end of a stick at rest on the belt: when the body sticks again, its acceleration
    before, and when it slips next."""
    a, w, c, V, mu_0, delta = values.values()
    x = mu_0 - c * V + a * math.cos(w * start)

    def slipping(t, y):
        friction = mu_0 / (1 + delta * abs(y[1] - V))
        return [y[1], a * math.cos(w * t) - c * y[1] - y[0] + friction]

    def as_fast(t, y):
        return y[1] - V

    def held(t, y):
        return y[0] + c * V - a * math.cos(w * t) - mu_0

    as_fast.terminal, as_fast.direction = True, 1.0
    held.terminal, held.direction = True, 1.0
    slip = solve_ivp(slipping, (start, start + 20.0), [x, V], events=as_fast, **TIGHT)
    end, (x, v) = slip.t[-1], slip.y[:, -1]
    stick = solve_ivp(lambda t, y: [V], (end, end + 20.0), [x], events=held, **TIGHT)
    return end, slipping(end, [x, v])[1], stick.t[-1]


def sticking(delta=0.0):
    """The orbit that slips and sticks once in a period."""
    starts = {"starts": 10, "rounds": 1} if delta else {}
    (found,) = ci.find_orbits(Belt(**VALUES | {"delta": delta}), "PS", parameter="V", **starts)
    return found


def agrees(unknowns, values):
    start, _, stick, speed = unknowns[:4]
    end, approach, again = by_integration(start, values)
    assert (end, approach) == pytest.approx((stick, speed), abs=1e-10)
    assert again - start == pytest.approx(2.0 * math.pi / values["omega"], abs=1e-10)


def compare_along(branch, values):
    """Some physical orbits of a branch in V, but not the one in which sticking vanishes."""
    columns = branch.columns
    rows = np.flatnonzero((columns["physical"] == 1) & (columns["event"] == ""))[::3]
    assert len(rows) >= 3
    for row in rows:
        V, *unknowns = (columns[name][row] for name in ("V", "t1", "v1", "t2", "v2"))
        agrees(unknowns, values | {"V": V})


@pytest.fixture(scope="module")
def orbit():
    return sticking()


@pytest.fixture(scope="module")
def branch(orbit):
    return ci.continue_orbit(orbit, "V", (0.25, 0.5), events=EVENTS)


@pytest.fixture(scope="module")
def slipping():
    (orbit,) = ci.find_orbits(Belt(**VALUES | {"V": 0.4}), "0", parameter="V")
    return ci.continue_orbit(orbit, "V", (0.35, 0.45), events=EVENTS)


def test_stick_and_slip_against_integration(orbit, branch):
    assert orbit.physical
    agrees(orbit.unknowns, VALUES)
    compare_along(branch, VALUES)


def test_a_lost_direction_has_the_multiplier_zero(orbit, branch):
    kept, lost = orbit.multipliers
    assert lost == 0.0
    step = 1e-4
    ahead, behind = (by_integration(orbit.unknowns[0] + h, VALUES)[2] for h in (step, -step))
    assert kept == pytest.approx((ahead - behind) / (2.0 * step), abs=1e-6)
    ordinary = branch.columns["event"] == ""
    assert np.all(branch.columns["multiplier2_re"][ordinary] == 0.0)


def test_sticking_vanishes_where_slip_comes_up_to_the_belt(branch, slipping):
    """At the velocity that the body has at most, moving linearly."""
    a, w, c = (VALUES[name] for name in ("a", "omega", "c"))
    fastest = a * w / math.hypot(1 - w**2, c * w)
    (last,) = branch.events
    (first,) = slipping.events
    for event in (last, first):
        assert event.physical
        assert abs(event.value - fastest) <= event.error + 1e-15
    assert (last.label, last.becomes) == ("V[PS->0]", "0")
    assert (first.label, first.becomes) == ("G[0->SP]", "SP")
    assert (first.criticality, first.slope) == ("supercritical", None)
    assert np.array(last.multipliers) == pytest.approx(np.array(first.multipliers), abs=1e-12)
    assert list(branch.missed) == list(slipping.missed) == []


@pytest.mark.full
def test_both_sides_of_a_sliding_grazing(slipping):
    """The branch born there is physical where the touch sticks."""
    (event,) = slipping.events
    born = ci.continue_born(event, range=(0.3, 0.45), events=[])
    columns = born.columns
    assert np.all(columns["v1"][columns["physical"] == 1] >= 0.0)
    row = int(np.argmin(np.where(columns["physical"] == 1, columns["V"], np.inf)))
    assert columns["V"][row] == 0.3
    S, v, P = (columns[name][row] for name in ("t1", "v1", "t2"))
    period = 2.0 * math.pi / VALUES["omega"]
    agrees([P, 0.0, S + (period if S < P else 0.0), v], VALUES | {"V": columns["V"][row]})


@pytest.mark.full
def test_what_friction_cannot_do_is_unphysical():
    model = Belt(**VALUES | {"a": 0.53})
    (orbit,) = ci.find_orbits(model, "PS", parameter="a", starts=10, rounds=1)
    verdict = orbit.linearisation.verdict
    speed = orbit.unknowns[3]
    assert speed > 2.0 * model.values["mu_0"]  # friction of that size would have to hold it
    assert not verdict.physical
    assert verdict.reason.startswith("flight 2 (S to P) passes wall A by")
    assert verdict.smallest_gap == pytest.approx(2.0 * model.values["mu_0"] - speed, abs=1e-12)
    (slip,) = ci.find_orbits(Belt(**VALUES), "0", parameter="V")
    assert slip.linearisation.verdict.reason.startswith("the orbit passes wall S by")


def test_simulation_settles_on_it(orbit):
    simulator = Simulator(Belt(**VALUES))
    run = simulator.run(simulator.state("S", 1.0, 0.5), impacts=100)
    period = 2.0 * math.pi / VALUES["omega"]
    t, v = orbit.unknowns[[0, 2]] % period, orbit.unknowns[[1, 3]]
    assert run.word[-2:] == "PS"
    assert run.phases[-2:] == pytest.approx(t, abs=1e-10)
    assert run.velocities[-2:] == pytest.approx(v, abs=1e-10)


def test_simulation_stops_where_the_body_does_not_stick():
    simulator = Simulator(Belt(**VALUES))
    run = simulator.run(simulator.state("S", 1.0, 0.81), impacts=100)
    assert run.outcome is Outcome.BEYOND


def test_starts_are_at_the_guard_that_friction_allows():
    """Half of the rates at which slip ends are too fast to stick: the body goes through."""
    found = ci.basins(Belt(**VALUES), shape=(4, 4), fastest=4.0 * VALUES["mu_0"])
    assert [attractor.notation for attractor in found.attractors] == ["SP"]
    assert [a.notation for a in ci.find_attractors(Belt(**VALUES), 12)] == ["SP"]


def test_slip_ahead_of_the_belt_mirrors_slip_behind_it(orbit):
    """x -> -x, V -> -V, half a period later."""
    (other,) = ci.find_orbits(Belt(**VALUES | {"V": -0.3}), "AB", parameter="V")
    assert other.physical
    half = math.pi / VALUES["omega"]
    assert other.unknowns[[1, 3]] == pytest.approx(-orbit.unknowns[[1, 3]], abs=1e-12)
    turned = np.exp(1j * VALUES["omega"] * (other.unknowns[[0, 2]] - orbit.unknowns[[0, 2]] - half))
    assert turned == pytest.approx(1.0, abs=1e-12)


def test_what_is_stated_of_friction_holds():
    assert Belt(**VALUES).options["friction"] == "constant"
    weak = VALUES | {"delta": 0.5}
    assert Belt(**weak).options["friction"] == "weakening"
    stated = read_model({"system": "belt", "parameters": weak})
    assert stated.options["friction"] == "weakening"
    with pytest.raises(InputError, match="delta: friction is stated to be constant"):
        Belt(**VALUES).replace(delta=0.1)
    with pytest.raises(InputError, match="friction: found 'dry'"):
        Belt(**VALUES, friction="dry")


@pytest.mark.full
def test_weakening_friction_against_integration():
    pytest.importorskip("heyoka", reason="needs contimpact[ode]")
    orbit = sticking(delta=1.0)
    assert orbit.physical
    assert orbit.multipliers[1] == 0.0
    agrees(orbit.unknowns, VALUES | {"delta": 1.0})
    branch = ci.continue_orbit(orbit, "V", (0.28, 0.36), events=[])
    compare_along(branch, VALUES | {"delta": 1.0})


@pytest.mark.slow
def test_laws_with_poles_are_checked_on_short_flights(caplog):
    """Long ones run into the pole of weakening friction, at w = -1/delta ahead of the belt."""
    model = Belt(a=0.2, omega=0.3, c=0.1, V=0.45, mu_0=0.4, delta=2.0)
    assert "flight from A" in ci.check_model(model)
    assert not caplog.records


def test_sliding_grazings_of_both_kinds():
    """Sticking begins where slip ends, or, friction weakening fast, beside it, up to a fold."""
    pytest.importorskip("heyoka", reason="needs contimpact[ode]")
    for delta, expected in ((0.5, "supercritical"), (4.0, "subcritical")):
        model = Belt(**VALUES | {"V": 0.42, "delta": delta})
        (orbit,) = ci.find_orbits(model, "0", parameter="V", starts=8, rounds=1)
        (event,) = ci.continue_orbit(orbit, "V", (0.3, 0.45), events=["G"]).events
        assert event.criticality == expected
        born = ci.continue_born(event, range=(event.value - 0.01, event.value + 0.01), events=[])
        there = born.columns["V"][born.columns["physical"] == 1][:3]
        assert there[0] == pytest.approx(event.value, abs=1e-12)
        assert np.all((there[1:] > event.value) == (expected == "subcritical"))
