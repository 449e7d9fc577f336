"""Orbits, events and curves of integrated flights are those of the same flights in closed form."""

import math
from pathlib import Path

import numpy as np
import pytest
from integrated import MASSES, Integrated, IntegratedMasses
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, fsolve

import contimpact as ci
from contimpact.accuracy.reference import Reference
from contimpact.continuation.settings import Settings
from contimpact.diagrams.map_explorer import entries_born, orbit_at
from contimpact.segments.integration import Integrator
from contimpact.segments.kernels import Kernels
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.pendulum import Pendulum
from contimpact.systems.two_masses import TwoMasses

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

ROOT = Path(__file__).parents[2]

OSCILLATOR = {"a": 1.0, "omega": 1.3, "c": 0.1, "k": 1.0, "sigma": 0.5, "r": 0.8}
pytest.importorskip("heyoka", reason="needs contimpact[ode]")

EVENTS = ["FB", "PD", "G", "V", "BP", "T"]


def branches(kind):
    orbits = ci.find_orbits(kind(**OSCILLATOR), "S", parameter="omega")
    orbit = next(orbit for orbit in orbits if orbit.physical)
    return orbit, ci.continue_orbit(orbit, "omega", (0.7, 3.0), events=EVENTS)


@pytest.fixture(scope="module")
def both():
    return branches(Oscillator), branches(Integrated)


@pytest.mark.full
def test_branches_and_events(both):
    (one, branch), (other, same) = both
    assert other.unknowns == pytest.approx(one.unknowns, abs=1e-13)
    assert other.multipliers == pytest.approx(one.multipliers, abs=1e-12)
    assert [e.label for e in same.events] == [e.label for e in branch.events]
    assert {e.kind for e in same.events} >= {"FB", "PD", "G", "V"}
    for found, truth in zip(same.events, branch.events, strict=True):
        assert abs(found.value - truth.value) <= found.error + truth.error
        assert abs(found.value - truth.value) < 1e-12
        assert (found.stable, found.physical) == (truth.stable, truth.physical)
    assert len(same) == len(branch)
    for column in ("times", "velocities"):  # steps differ by rounding
        assert getattr(same, column) == pytest.approx(getattr(branch, column), abs=1e-8)


@pytest.mark.full
def test_curves(both):
    events = [next(e for e in branch.events if e.kind == "PD") for _, branch in both]
    ranges = {"first_range": (0.6, 2.0), "second_range": (0.7, 0.85)}
    one, other = (ci.follow_curve(event, second="r", **ranges) for event in events)
    assert len(other) == len(one)
    for name in ("omega", "r"):
        assert other[name] == pytest.approx(one[name], abs=1e-8)
    for found, truth in zip(other.points, one.points, strict=True):
        assert found.parameters == pytest.approx(truth.parameters, abs=1e-12)


@pytest.mark.full
def test_two_masses():
    """By matrices, and integrated."""
    found = (
        ci.find_orbits(kind(**MASSES), "A", parameter="omega", starts=20, rounds=2)
        for kind in (TwoMasses, IntegratedMasses)
    )
    one, other = orbits = [next(o for o in each if o.physical) for each in found]
    assert other.unknowns == pytest.approx(one.unknowns, abs=1e-13)
    found, truth = (np.sort_complex(np.round(orbit.multipliers, 13)) for orbit in orbits)
    assert found == pytest.approx(truth, abs=1e-12)
    touches = [[t and (t.time, t.gap) for t in o.linearisation.gaps[0].touches] for o in orbits]
    assert touches[1][1] == pytest.approx(touches[0][1], abs=1e-12)


@pytest.mark.full
def test_searches_for_events_stay_near(monkeypatch):
    """Where no branches cross, the search for it does not wander off along ever longer flights."""
    monkeypatch.setenv("CONTIMPACT_COMPILED", "never")
    asked, steps = [], Integrator._propagate

    def noted(integrator, *given, **more):
        asked.append(abs(float(integrator._given[0])))
        steps(integrator, *given, **more)

    model = Pendulum(a=1.0, omega=1.4, c=0.1, sigma=1.0, r=0.8)
    orbits = ci.find_orbits(model, "S", parameter="omega", starts=10, rounds=1)
    orbit = max(orbits, key=lambda o: o.velocities[0])
    monkeypatch.setattr(Integrator, "_propagate", noted)
    branch = ci.continue_orbit(orbit, "omega", (1.3, 1.5), events=["FB"])
    assert [event.kind for event in branch.events] == ["FB"]
    assert max(asked) < 5 * 2 * math.pi / 1.3


@pytest.mark.parametrize("sigma", [0.3, math.pi], ids=["near", "upright"])
@pytest.mark.full
def test_orbits_of_a_pendulum_in_many_digits(sigma):
    model = Pendulum(a=1.0, omega=0.8, c=0.1, sigma=sigma, r=0.8)
    orbits = ci.find_orbits(model, "S", parameter="a", starts=20, rounds=2)
    assert orbits
    for orbit in orbits[:2]:
        reference = Reference(orbit.problem, 30)
        exact = reference.orbit(orbit.unknowns)
        assert exact.distance(orbit.unknowns) < 1e-12
        multipliers = np.array([complex(m) for m in reference.multipliers(exact.unknowns)])
        sizes = np.maximum(1.0, np.abs(multipliers))
        assert np.max(np.abs(orbit.multipliers - multipliers) / sizes) < 1e-12


@pytest.mark.full
def test_orbits_without_impacts():
    """Small oscillations of a pendulum, and those about the next turn."""
    model = Pendulum(a=0.01, omega=2.0, c=0.1, sigma=1.0, r=0.8)
    orbits = ci.find_orbits(model, "0", parameter="a")
    near = min(orbits, key=lambda orbit: abs(orbit.unknowns[0]))
    size = 0.01 / math.hypot(1 - 2.0**2, 0.1 * 2.0)
    assert near.physical
    assert math.hypot(near.unknowns[0], near.unknowns[1] / 2.0) == pytest.approx(size, rel=1e-4)
    assert near.linearisation.verdict.smallest_gap == pytest.approx(1.0 - size, abs=1e-6)
    assert np.prod(near.multipliers).real == pytest.approx(math.exp(-0.1 * math.pi), rel=1e-13)


@pytest.mark.full
def test_a_period_doubling_without_impacts():
    """Of a driven pendulum that swings freely: the orbit of two periods is born."""
    model = Pendulum(a=1.0, omega=0.83, c=0.1, sigma=4.0, r=0.8)
    orbits = ci.find_orbits(model, "0", parameter="omega", rounds=1)
    orbit = next(orbit for orbit in orbits if orbit.stable and orbit.physical)
    branch = ci.continue_orbit(orbit, "omega", (0.822, 0.835), events=["PD"])
    (event,) = branch.events
    assert event.criticality == "supercritical"
    doubled = ci.continue_born(event, range=(0.822, 0.835), events=["PD"])
    assert (doubled.word, doubled.period) == ("", 2)
    last = doubled.orbit(len(doubled) - 1)
    assert last.stable
    once = last.problem.kernels.segment("0", "1").blocks
    state = last.unknowns[:2]
    moved = np.array(once(state, state, last.problem.values(last.unknowns))[0])
    assert np.max(np.abs(moved)) > 0.01  # not back after one period
    here = last.linearisation  # a point of a walk, solved to its tolerance
    assert np.max(np.abs(here.residual) / here.sizes[0]) <= Settings().tolerance


def touch_that_forgets_its_velocity(unknowns):
    """The orbit 0 of the Duffing oscillator, from a touch to the next one, and what a velocity at
    the first one changes the position at the second by: zero where T, the trace of the return
    map times the velocity, vanishes."""
    time, omega, a = unknowns

    def rates(t, y):
        stiffness = 1.0 + 3.0 * y[0] ** 2
        force = a * np.cos(omega * t) - 0.1 * y[1] - y[0] - y[0] ** 3
        return [y[1], force, y[3], -0.1 * y[3] - stiffness * y[2]]

    span = time, time + 2.0 * np.pi / omega
    motion = solve_ivp(rates, span, [0.8, 0.0, 0.0, 1.0], "DOP853", rtol=1e-12, atol=1e-13)
    x, v, moved, _ = motion.y[:, -1]
    return [x - 0.8, v, moved]


@pytest.fixture(scope="module")
def forgetful():
    """Values of omega and a with such a touch."""
    return fsolve(touch_that_forgets_its_velocity, [0.146, 0.895, 0.522], xtol=1e-13)[1:]


def doubled():
    """The PD of the orbit 1/2T of the Duffing oscillator."""
    return next(e for e in ci.load_entries(ROOT / "branches" / "duffing") if e.id == "e15")


def check_end(curve, row, values):
    assert curve.ends[row].kind.name == "SHORTER"
    assert [curve["omega"][row], curve["a"][row]] == pytest.approx(values, abs=1e-10)


@pytest.mark.full
def test_a_doubling_of_a_doubled_orbit_ends_where_both_of_its_impacts_are_at_rest(forgetful):
    """It ended nowhere: the curve passed two points PD-V, wrong by 2e-5, and what was beyond."""
    limits = {"first_range": (0.87, 0.93), "second_range": (0.49, 0.57)}
    curve = ci.follow_curve(doubled(), second="a", **limits)
    row = [end.kind.name for end in curve.ends].index("SHORTER")
    check_end(curve, -row, forgetful)
    assert curve.missed == []
    assert [point.kind for point in curve.points] == ["GPD"]


@pytest.mark.full
@pytest.mark.parametrize("kind", ["PD", "V"])
def test_so_end_curves_of_orbits_of_four_periods(kind, forgetful):
    """The orbit of one period was not looked for: curves of V ended 6e-10 beside that point, one of
    PD passed it."""
    branch = ci.continue_born(doubled(), range=(0.9140, 0.915), events=["FB", "PD", "V"])
    entry = next(event for event in branch.events if event.kind == kind)
    curve = ci.follow_curve(entry, second="a", first_range=(0.85, 1.6), second_range=(0.49, 0.53))
    row = next(k for k in (0, -1) if "became 1, run 4 times" in curve.ends[k].message)
    check_end(curve, row, forgetful)
    assert curve.missed == []


@pytest.mark.full
def test_a_curve_ends_there_whatever_becomes_of_its_vectors(forgetful):
    """Vectors of kernels are not unique there, and turned the end aside: it was refused 2e-5 ahead
    of the last point. Of the orbits 1/1T and 11/2T, that of the one run twice is known to 1e-7."""
    branch = ci.continue_born(doubled(), range=(0.912, 0.915), events=["PD"])
    entry = next(event for event in branch.events if event.value < 0.9135)
    assert entry.value == pytest.approx(0.912550509, abs=1e-9)
    curve = ci.follow_curve(entry, second="a", first_range=(0.85, 1.6), second_range=(0.49, 0.53))
    row = next(k for k in (0, -1) if "became 1, run 4 times" in curve.ends[k].message)
    check_end(curve, row, forgetful)


@pytest.mark.slow
def test_a_gpd_ends_in_three_parameters_where_its_orbit_becomes_a_shorter_one():
    """That point of codimension three is not located: the curve passed it, to the same orbits half
    a period later, and both of its ends were the same."""
    near = {"first_range": (0.905, 0.915), "second_range": (0.5, 0.51)}
    curve = ci.follow_curve(doubled(), second="a", **near)
    (point,) = (point for point in curve.points if point.kind == "GPD")
    ranges = (0.5, 1.6), (0.2, 0.9), (0.7, 0.81)
    third = ci.follow_codim2(doubled(), point, second="a", third="r", ranges=ranges, detect=False)
    assert {end.kind.name for end in third.ends} == {"SHORTER", "RANGE"}
    (message,) = (end.message for end in third.ends if end.kind.name == "SHORTER")
    assert message.startswith("became 1, run 2 times")
    assert message.endswith("that place is not located")
    assert min(third["r"]) == pytest.approx(0.717, abs=0.005)
    assert third.missed == []


@pytest.mark.full
def test_an_orbit_at_rest_on_a_curve_of_doublings_has_no_multipliers():
    """C(mu) is singular for every mu at this PD-V: the row had -29.97, and one unstable."""
    entry = next(e for e in ci.load_entries(ROOT / "branches" / "duffing") if e.id == "e12")
    curve = ci.follow_curve(entry, second="a", first_range=(0.88, 0.93), second_range=(0.49, 0.53))
    (row,) = np.flatnonzero(curve["event"] == "c1.1")
    assert curve.points[0].kind == "PD-V"
    assert np.isnan(curve["multiplier1_re"][row])
    assert set(curve["n_unstable"]) == {0}


def test_the_fold_at_a_grazing_of_an_orbit_without_impacts():
    """The time of the touch was read off impacts: an IndexError ended the map."""
    entry = next(e for e in ci.load_entries(ROOT / "branches" / "duffing") if e.id == "e1")
    limits, model = ((0.87, 0.92), (0.5, 0.54)), entry.orbit().problem.model
    curve = ci.follow_curve(entry, second="a", first_range=limits[0], second_range=limits[1])
    assert [point.kind for point in curve.points] == ["G-FB"]
    kernels = Kernels(model, "omega", "a")
    here = orbit_at(entry, curve.points[0], model, kernels)
    assert here.largest_residual < 1e-12
    found = list(entries_born(entry, curve.points[0], model, ("FB",), kernels, limits))
    assert [(e.kind, e.word) for e in found] == [("FB", "S")] * 2
    assert sorted(e.physical for e in found) == [False, True]


@pytest.mark.full
def test_where_that_fold_is_born_in_a_third_parameter(forgetful):
    """The orbit without impacts was lost, and a derivative by differences had the wrong sign: the
    restitution changes nothing there."""
    entry = next(e for e in ci.load_entries(ROOT / "branches" / "duffing") if e.id == "e1")
    limits = (0.87, 0.92), (0.5, 0.54), (0.7, 0.9)
    curve = ci.follow_curve(entry, second="a", first_range=limits[0], second_range=limits[1])
    third = ci.follow_codim2(entry, curve.points[0], second="a", third="r", ranges=limits)
    assert [third["r"][0], third["r"][-1]] == pytest.approx([0.7, 0.9])
    assert third["omega"] == pytest.approx(forgetful[0], abs=1e-10)
    assert third["a"] == pytest.approx(forgetful[1], abs=1e-10)


def test_events_of_a_doubled_orbit_without_impacts_are_followed():
    """The stop has no influence on them; curves ended in an error."""
    well = {"a": 0.183, "omega": 1.1, "c": 0.2, "alpha": -1.0, "beta": 1.0, "r": 0.75}
    model = ci.Duffing(**well, sigma=1.3)
    orbits = ci.find_orbits(model, "0/2T", parameter="a", starts=32, rounds=2)
    orbit = next(o for o in orbits if o.stable)
    (doubling,) = ci.continue_orbit(orbit, range=(0.18, 0.19), events=["PD"]).events
    curve = ci.follow_curve(doubling, None, "sigma", (0.18, 0.19), (1.29, 1.31))
    assert curve["a"] == pytest.approx(doubling.value, abs=1e-12)
    assert (curve["sigma"].min(), curve["sigma"].max()) == pytest.approx((1.29, 1.31))


def test_a_branch_that_shrinks_to_a_rest_ends_at_the_resonance_of_small_motions():
    """A pendulum whose weight oscillates hangs at rest up to a PD of Mathieu's equation."""

    def hill(p):
        def rates(t, y):
            return [y[1], -0.1 * y[1] - (1.0 + p * np.cos(2.0 * t)) * y[0]]

        ends = [
            solve_ivp(rates, (0.0, np.pi), start, "DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
            for start in np.eye(2)
        ]
        return np.linalg.det(np.array(ends) + np.eye(2))

    model = {
        "system": "hybrid",
        "period": "pi",
        "modes": {"swing": {"x": "v", "v": "-v/10 - (1 + p*cos(2*t))*sin(x)"}},
        "guards": {"R": {"within": "x <= s", "set": {"v": "-v/2"}}},
        "parameters": {"p": 0.8, "s": 2.5},
    }
    follow = {"parameter": "p", "range": [0.1, 0.9], "orbits": ["0/2T"]}
    scene = ci.read_scene({"name": "pendulum", "model": model, "follow": follow})
    orbits = ci.find_orbits(scene.model, "0/2T", parameter="p", starts=64, rounds=1)
    orbit = min(orbits, key=lambda one: abs(one.unknowns[0]))
    branch = ci.continue_orbit(orbit, "p", (0.1, 0.9), events=["FB", "BP"])
    (event,) = branch.events
    assert event.kind == "BP"
    assert abs(event.value - brentq(hill, 0.15, 0.25, xtol=1e-15)) < event.error + 1e-13
