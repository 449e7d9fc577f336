"""V where contact begins or ends at rest though it lasts: a flight only touches its guard.

The stop pulls or pushes with a force P as soon as it is touched, so that the field jumps there, and
a contact that ends at rest can be physical.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from zoo import PRELOADED as VALUES
from zoo import Preloaded

from contimpact import continue_orbit, find_orbits, follow_curve, read_scene
from contimpact.bifurcations.extended_system import has_multiplier
from contimpact.bifurcations.kind import Change, _missed_change
from contimpact.models.guards import Word
from contimpact.orbits.orbit import Orbit
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import solve_near
from contimpact.segments.kernels import Kernels
from contimpact.systems.soft_stop import SoftStop


def branch(limits, guess, events=("FB", "V"), **changes):
    """The branch of the orbit `CR` next to times and velocities of C and R."""
    model = Preloaded(**VALUES | changes)
    problem = OrbitProblem(model, Word("CR"), Kernels(model, "w"))
    found = solve_near(problem, np.array([*guess, model.values["w"]]))
    return continue_orbit(Orbit(problem, found), "w", limits, events=list(events))


@pytest.fixture(scope="module")
def magnet():
    asked = ("FB", "V", "G", ("at rest", lambda o: o.velocities[1]))
    return branch((0.403, 0.4146), (-2.0197, 0.2418, 3.3507, -0.0013), asked, w=0.40464)


def flown(values, pressed, start, until):
    """Position and velocity at a time, by SciPy."""
    p = SimpleNamespace(**values)

    def forces(t, y):
        stop = p.P + p.kb * (y[0] - p.e) + p.cb * y[1] if pressed else 0.0
        return [y[1], p.a * math.cos(p.w * t) - p.c * y[1] - p.k * y[0] - stop]

    options = {"rtol": 1e-12, "atol": 1e-13, "method": "DOP853"}
    return solve_ivp(forces, (start[0], until), start[1:], **options).y[:, -1]


def test_a_contact_that_ends_at_rest_is_a_v(magnet):
    (event,) = [e for e in magnet.events if e.kind == "V"]
    (asked,) = [e for e in magnet.events if e.kind == "at rest"]
    assert event.value == pytest.approx(asked.value, abs=2e-13)
    assert event.error < 1e-13
    assert (event.method, event.impact, event.wall) == ("newton", 1, "R")
    assert (event.ghost, event.label) == (False, "V")
    assert magnet.missed == []


def test_its_orbit_obeys_the_equations_of_motion(magnet):
    (event,) = [e for e in magnet.events if e.kind == "V"]
    (contact, release), speed = event.times, event.velocities[0]
    period, e = 2.0 * math.pi / event.value, event.parameters["e"]
    touch = flown(event.parameters, True, (contact, e, speed), release)
    assert touch == pytest.approx([e, 0.0], abs=1e-9)
    again = flown(event.parameters, False, (release, e, 0.0), contact + period)
    assert again == pytest.approx([e, speed], abs=1e-9)


def test_it_is_where_the_branch_turns_unphysical(magnet):
    (event,) = [e for e in magnet.events if e.kind == "V"]
    columns = magnet.columns
    physical, at = columns["physical"].astype(bool), columns["w"]
    assert np.array_equal(physical, at >= event.value)


def test_nothing_is_born_where_no_contact_vanishes(magnet):
    (event,) = [e for e in magnet.events if e.kind == "V"]
    assert event.becomes is None
    assert tuple(event.opens) == ()
    assert None in event.multipliers or abs(complex(*event.multipliers[0])) > 1e12


@pytest.mark.full
def test_every_zero_of_a_velocity_is_recorded_once():
    """A contact that vanishes is one event of its own."""
    found = branch((0.9, 1.8), (0.1017, 4.5225, 1.3676, -3.5937), w=1.3, P=0.3)
    columns = found.columns
    points = columns["event"] == ""
    for impact in (0, 1):
        speed = columns[f"v{impact + 1}"][points]
        changes = int(np.sum((speed[1:] >= 0.0) != (speed[:-1] >= 0.0)))
        alone = [e for e in found.events if e.kind == "V" and e.flight is not None]
        whole = [e for e in found.events if e.kind == "V" and e.becomes == "0"]
        assert len(whole) == 1
        assert changes == len(whole) + len([e for e in alone if e.impact == impact])
    assert found.missed == []


@pytest.mark.full
def test_it_is_a_ghost_where_the_body_is_pushed_back_at_once():
    """Released at rest into a field that pushes it towards the stop, it is in contact again."""
    found = branch((0.4728, 0.475), (-1.9581, 0.1518, -0.4985, -0.0046), w=0.47319, P=0.3)
    events = [e for e in found.events if e.kind == "V"]
    assert events
    for event in events:
        p, (_, release) = SimpleNamespace(**event.parameters), event.times
        force = p.a * math.cos(p.w * release) - p.k * p.e
        assert force > 0.0
        assert event.ghost
        assert "passes wall C" in event.reason


@pytest.mark.full
def test_its_curve_in_two_parameters(magnet):
    (event,) = [e for e in magnet.events if e.kind == "V"]
    curve = follow_curve(event, Preloaded(**VALUES), "P", (0.38, 0.43), (-0.35, -0.25))
    assert len(curve) > 5
    assert np.max(np.abs(curve.columns["v2"])) < 1e-10


@pytest.mark.parametrize(("width", "helps"), [(1e-15, False), (1e-3, True)])
def test_smaller_steps_are_advised_only_where_they_tell_more(width, helps):
    def end(arclength):
        verdict = SimpleNamespace(physical=False, reason="it passes")
        evaluation = SimpleNamespace(verdict=verdict)
        return SimpleNamespace(arclength=arclength, parameter=0.4, evaluation=evaluation)

    arc = SimpleNamespace(left=end(0.1), right=end(0.1 + width))
    reason = _missed_change("V", arc, Change.PHYSICALITY).reason
    assert ("a smaller max_step may tell" in reason) is helps


def test_a_multiplier_is_no_event_where_the_velocity_it_is_divided_by_is_rounding(magnet):
    """By chance it has any value: beside a V there was a PD on one processor, on others none."""
    (found,) = [e for e in magnet.events if e.kind == "V"]
    problem, unknowns = found.orbit().problem, found.orbit().unknowns.copy()
    for rest in (3e-16, -2e-15):
        unknowns[3] = rest
        here = problem.evaluate(unknowns)
        assert here.resting == [1]
        event = SimpleNamespace(point=SimpleNamespace(evaluation=here))
        assert not any(has_multiplier(event, value) for value in here.multipliers)
    unknowns[3] = 1e-9
    here = problem.evaluate(unknowns)
    event = SimpleNamespace(point=SimpleNamespace(evaluation=here))
    assert all(has_multiplier(event, value) for value in here.multipliers)


@pytest.mark.parametrize(
    "guess",
    [
        [2.0552, -0.9507, 9.2485, -0.0092, 9.2984, 0.0094, 9.2485, -0.0092, 7.05708669],
        [2.1032, -0.7725, 5.6136, 0.34, 6.8087, -0.611, 7.7372, 0.4585, 20.0],
    ],
)
def test_a_velocity_that_vanishes_with_both_flights_beside_it_is_no_v_of_its_own(guess):
    """Three impacts merge: both flights are marked, and the velocity over both durations, which
    passes infinity there, neither is nor counts as missed."""
    model = SoftStop(a=1.0, omega=1.3, c=0.1, k=1.0, e=0.5, k_b=guess[-1], c_b=0.3)
    problem = OrbitProblem(model, Word("CRCR", 2), Kernels(model, "k_b"))
    orbit = Orbit(problem, solve_near(problem, np.array(guess)))
    found = continue_orbit(orbit, "k_b", (6.0, guess[-1] + 0.1), events=["V"])
    merging = [event for event in found.events if abs(event.value - 7.055479307036) < 1e-11]
    assert sorted(event.impact for event in merging) == [1, 2]
    assert all(event.residual < 1e-9 for event in found.events)
    assert not found.missed


def test_multipliers_are_the_limit_where_an_end_of_a_contact_leaves_no_trace():
    """They were quotients of rounding, -466 in one unit and -84 in another. The product is that of
    Liouville's formula; beyond the V the motion is unphysical, and the multipliers go on."""
    model = {"system": "hybrid", "period": "2*pi/om", "parameters": {"om": 0.88, "C": 0.5}}
    model["modes"] = {
        "free": {"x": "v", "v": "cos(om*t) - v/10 - x"},
        "hit": {"x": "v", "v": "cos(om*t) - v/10 - x - 20*(x - 0.3) - C*v"},
    }
    model["guards"] = {
        "C": {"mode": "free", "within": "x <= 0.3", "to": "hit"},
        "R": {"mode": "hit", "within": "x >= 0.3", "to": "free"},
    }
    follow = {"parameter": "om", "range": [0.85, 0.9], "orbits": ["CR"]}
    scene = read_scene({"name": "soft", "model": model, "follow": follow})
    orbits = find_orbits(scene.model, "CR", parameter="om", starts=48)
    events = [e for o in orbits for e in continue_orbit(o, range=(0.85, 0.9), events=["V"]).events]
    assert events
    for event in events:
        assert (event.becomes, event.n_unstable) == (None, 0)
        begin, end = (impact["time"] for impact in event.impacts)
        found = np.prod([complex(*value) for value in event.multipliers])
        assert abs(found - np.exp(-0.2 * np.pi / event.value - 0.5 * (end - begin))) < 1e-9
        sides = np.array([event.multipliers_before, event.multipliers_after])[:, :, 0]
        between = np.array(event.multipliers)[:, 0]
        assert np.all((np.min(sides, axis=0) < between) & (between < np.max(sides, axis=0)))


def slip(stated: str) -> dict:
    """A capsule on which an oscillator is driven, and which slips where its spring and damper pull
    more than friction holds; the pull is stated as the guard has it, or by parameters."""
    given = {"a": 0.06, "w": 0.8, "mu": 0.5, "F": 0.15, "k": 1.0, "c": 0.05}
    used = {name: given[name] for name in given if name not in ("k", "c") or name in stated}
    model = {"system": "hybrid", "period": "2*pi/w", "parameters": used, "define": {"S": stated}}
    model["modes"] = {
        "stick": {"z": "v", "v": "a*cos(w*t) - S", "u": "0"},
        "slip": {"z": "v", "v": "a*cos(w*t) - S - mu*(S - F)", "u": "mu*(S - F)"},
    }
    model["guards"] = {
        "R": {"mode": "stick", "within": "z + 0.05*v <= F", "to": "slip", "set": {"u": 0}},
        "S": {"mode": "slip", "within": "u >= 0", "to": "stick", "set": {"u": 0}},
    }
    follow = {"parameter": "a", "range": [0.05, 0.15], "orbits": ["RS"]}
    return {"name": "slip", "model": model, "follow": follow}


@pytest.mark.parametrize("stated", ["z + 0.05*v", "k*z + c*v"])
def test_a_slip_that_begins_without_a_force_begins_where_the_stuck_motion_pulls_as_much(stated):
    """There a slip that never lasts also solves the equations, and its multipliers are infinite.
    With parameters, the force at the beginning vanishes but for rounding."""
    scene = read_scene(slip(stated))
    orbit = next(o for o in find_orbits(scene.model, "RS", parameter="a", starts=48) if o.physical)
    found = continue_orbit(orbit, range=(0.05, 0.15), events=["V"])
    pull = abs((1 + 0.04j) / (1 - 0.64 + 0.04j))
    (event,) = found.events
    assert abs(event.value - 0.15 / pull) < 1e-12
    assert not event.ghost
    multiplier = np.exp((-0.025 + 1j * np.sqrt(1 - 0.025**2)) * 2 * np.pi / 0.8)
    assert abs(complex(*event.multipliers[0]) - multiplier) < 1e-3
    lasting = found.times[:, 1] > found.times[:, 0]
    assert found.physical[lasting].all()
    assert lasting.sum() > 50


def test_a_slip_is_physical_though_its_force_begins_with_the_rounding_of_another_coordinate():
    """A feeder whose table lifts the part, too: its guard is on the force that is missing, which is
    a coordinate, and its law on the force itself. The slip was unphysical by 6e-27."""
    model = {"system": "hybrid", "period": "2*pi", "parameters": {"A": 0.43}}
    rates = {"h": "-A*sin(t) - 0.2*sin(t + 0.7) - (h - force)"}
    model["define"] = {"force": "A*cos(t) - 0.5 + 0.2*cos(t + 0.7)"}
    model["modes"] = {"stick": rates | {"u": "0"}, "slip": rates | {"u": "force"}}
    model["guards"] = {
        "P": {"mode": "stick", "within": "h <= 0", "to": "slip", "set": {"u": 0}},
        "S": {"mode": "slip", "within": "u >= 0", "to": "stick", "set": {"u": 0}},
    }
    follow = {"parameter": "A", "range": [0.3, 0.45], "orbits": ["PS"]}
    scene = read_scene({"name": "feeder", "model": model, "follow": follow})
    orbit = next(o for o in find_orbits(scene.model, "PS", parameter="A", starts=48) if o.physical)
    found = continue_orbit(orbit, range=(0.3, 0.45), events=["V"])
    begins = np.sqrt(0.25 - (0.2 * np.sin(0.7)) ** 2) - 0.2 * np.cos(0.7)
    assert abs(found["A"].min() - begins) < 1e-12
    lasting = (found.velocities[:, 0] > 1e-6) & (found.times[:, 1] > found.times[:, 0])
    assert found.physical[lasting].all()
    assert lasting.sum() > 20
