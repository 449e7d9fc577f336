"""Orbits without impacts: the word `0`."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from contimpact.accuracy.reference import Reference
from contimpact.accuracy.report import report
from contimpact.diagrams.explore import follow
from contimpact.diagrams.orbit_branch import continue_born, continue_orbit
from contimpact.errors import InputError
from contimpact.models.guards import Word
from contimpact.orbits.quiet import QuietProblem
from contimpact.orbits.search import find_orbits
from contimpact.results.catalogue import load_diagram, write_diagram
from contimpact.results.scene import read_scene
from contimpact.segments import touches as module
from contimpact.segments.flight import breaks_of
from contimpact.segments.kernels import Kernels
from contimpact.systems.duffing import Duffing
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.pendulum import Pendulum
from contimpact.systems.soft_stop import SoftStop

VALUES = {"a": 0.3, "omega": 1.3, "c": 0.1, "k": 1.0, "sigma": 0.5, "r": 0.8}


def oscillator(**changes):
    return Oscillator(**(VALUES | changes))


def amplitude(p):
    """Of the response to a force of amplitude one."""
    return 1.0 / math.hypot(p["k"] - p["omega"] ** 2, p["c"] * p["omega"])


def quiet(model, parameter="a"):
    (orbit,) = find_orbits(model, "0", parameter=parameter)
    return orbit


@pytest.mark.parametrize("changes", [{}, {"c": 0.0}, {"c": 3.0, "omega": 0.2}, {"a": 0.0}])
def test_the_steady_response(changes):
    orbit = quiet(oscillator(**changes))
    p = orbit.model.values
    in_phase, quadrature = (
        p["a"] * amplitude(p) ** 2 * part
        for part in (p["k"] - p["omega"] ** 2, p["c"] * p["omega"])
    )
    want = [in_phase, p["omega"] * quadrature, p["a"]]
    assert orbit.unknowns == pytest.approx(want, rel=1e-13, abs=1e-14)
    period = 2 * math.pi / p["omega"]
    assert np.prod(orbit.multipliers) == pytest.approx(math.exp(-p["c"] * period), rel=1e-12)
    assert len(orbit.times) == 0
    assert "Orbit 0 at a = " in repr(orbit)


@pytest.mark.parametrize("parameter", ["a", "omega", "c", "k", "sigma"])
def test_derivatives_against_differences_in_many_digits(parameter):
    problem = quiet(oscillator(), parameter).problem
    z = np.array([0.3, -0.2, problem.model.values[parameter]])
    exact = Reference(problem)
    point = [exact.ctx.mpf(u) for u in z]
    differences = exact._differences(exact.residual, point, exact.residual(point))
    assert problem.evaluate(z).jacobian == pytest.approx(differences, rel=1e-13, abs=1e-13)
    along = np.array([0.7, -0.4, 0.9])
    step = 1e-6
    ahead, behind = (problem.evaluate(z + s * step * along).jacobian for s in (1, -1))
    assert problem.second_along(z, along) == pytest.approx((ahead - behind) / (2 * step), abs=1e-8)


@pytest.mark.parametrize("c", [0.0, 0.1])
def test_the_orbit_grazes_where_its_amplitude_reaches_the_stop(c):
    """Also where it turns on the section t = 0 itself, without damping."""
    orbit = quiet(oscillator(c=c))
    branch = continue_orbit(orbit, "a", (0.01, 1.0), events=["FB", "PD", "G", "V", "T", "BP"])
    (event,) = branch.events
    p = event.parameters
    assert (event.kind, event.label, event.becomes, event.order) == ("G", "G[0->1]", "S", 1)
    assert event.value == pytest.approx(0.5 / amplitude(p), rel=1e-14)
    phase = math.atan2(c * p["omega"], p["k"] - p["omega"] ** 2)
    turn = 2 * math.pi
    assert event.touch_time * p["omega"] % turn == pytest.approx(phase % turn, abs=1e-12)
    assert event.error < 1e-13
    assert set(branch.columns["physical"][branch["a"] < event.value]) == {1}
    assert set(branch.columns["physical"][branch["a"] > event.value + 1e-12]) == {0}
    exact = Reference(orbit.problem).event("G", event.orbit().unknowns, vars(event))
    assert abs(float(exact.parameter) - event.value) <= event.error


def test_the_first_impact_is_born_at_the_grazing():
    """The classical grazing bifurcation: V of the word with one impact, at the same value."""
    branch = continue_orbit(quiet(oscillator()), "a", (0.01, 1.0), events=["G"])
    born = continue_born(branch.events[0], range=(0.01, 1.0), events=["V", "FB"])
    assert born.word == "S"
    (zero,) = [e for e in born.events if e.kind == "V"]
    assert zero.value == pytest.approx(branch.events[0].value, rel=1e-14)
    row = np.argmin(np.abs(born["a"] - 0.9))
    assert set(born["physical"][born["v1"] > 1e-9]) == {1}
    assert born.orbit(int(row)).physical


@pytest.mark.full
def test_the_first_contact_is_born_at_the_grazing():
    model = SoftStop(a=0.3, omega=1.3, c=0.1, k=1.0, e=0.5, k_b=20.0, c_b=0.3)
    branch = continue_orbit(quiet(model), "a", (0.01, 1.0), events=["G"])
    (event,) = branch.events
    assert (event.becomes, event.order, event.criticality) == ("CR", 2, "supercritical")
    assert event.value == pytest.approx(0.5 / amplitude(event.parameters), rel=1e-14)
    born = continue_born(event, range=(0.01, 1.0), events=[])
    assert (born.word, born.period) == ("CR", 1)


def test_a_motion_without_a_steady_response_has_no_such_orbit():
    pair = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    assert find_orbits(pair, "0", parameter="s") == []


def test_the_orbit_is_not_found_again_with_twice_the_period():
    assert find_orbits(oscillator(), "0/2T", parameter="a") == []
    problem = QuietProblem(oscillator(), Word("", 2), Kernels(oscillator(), "a"))
    once = quiet(oscillator())
    assert problem.evaluate(once.unknowns).largest_residual < 1e-14


@pytest.mark.full
def test_a_scene_from_the_word_zero(tmp_path):
    """Followed, switched, its grazing in two parameters, written and read again."""
    scene = read_scene(
        {
            "name": "t",
            "model": {"system": "oscillator", "parameters": VALUES},
            "follow": {
                "parameter": "a",
                "range": [0.01, 0.6],
                "orbits": ["0"],
                "switch": ["G"],
                "depth": 1,
            },
            "detect": {"events": ["G"]},
            "curves": {"parameter": "omega", "range": [1.2, 1.4], "kinds": ["G"]},
        }
    )
    write_diagram(follow(scene), tmp_path)
    diagram = load_diagram(tmp_path)
    assert [b.word for b in diagram.branches] == ["", "S"]
    (curve,) = diagram.curves
    rows = zip(curve["a"], curve["omega"], strict=True)
    want = [0.5 / amplitude(VALUES | {"omega": omega}) for _, omega in rows]
    assert curve["a"] == pytest.approx(want, rel=1e-12)
    again = diagram.branches[0].orbit(0)
    assert again.unknowns[:-1] == pytest.approx(
        [diagram.branches[0][name][0] for name in ("x0_0", "v0_0")]
    )


def test_names_of_its_columns_are_taken():
    with pytest.raises(InputError, match="column of that name"):
        type("Taken", (Oscillator,), {"DERIVED": ("x0_0",)})


def test_a_report_asks_for_an_orbit_with_impacts():
    scene = read_scene(
        {
            "name": "t",
            "model": {"system": "oscillator", "parameters": VALUES},
            "follow": {"parameter": "a", "range": [0.01, 0.6], "orbits": ["0"]},
        }
    )
    with pytest.raises(
        InputError, match="no word but 0, and none was born on it; name one with impacts"
    ):
        report(scene)


@pytest.mark.parametrize(("c", "k"), [(100.0, 1e4), (0.1, 1.0), (30.0, 1.0)])
def test_no_forcing_at_all_costs_no_more_than_some(c, k, monkeypatch):
    """What is left of the state, 1e-190 of nothing, moves by its rounding alone."""
    counts = []

    def counted(*given, **options):
        counts.append(len(found := breaks_of(*given, **options)))
        return found

    monkeypatch.setattr(module, "breaks_of", counted)
    (orbit,) = find_orbits(
        Oscillator(a=0.1, omega=1.0, c=c, k=k, sigma=1.0, r=0.8), "0", parameter="a"
    )
    for state in ([-1.4e-194, 0.0], [-4.5e-190, 7.2e-189], [1e-310, -1e-312]):
        (gaps,) = orbit.problem.gaps(np.array([*state, 0.0]))
        assert all(touch is None or touch.gap == pytest.approx(1.0) for touch in gaps.touches)
    assert max(counts) < 100


def test_orbits_whole_turns_apart_are_listed_once():
    """The nearest, here unphysical, and the nearest physical one; solve_ivp and fsolve from a grid
    find two orbits within a turn, of which one is upright."""
    pytest.importorskip("heyoka")
    model = Pendulum(a=0.7, omega=0.75, c=0.15, sigma=0.3, r=0.6)
    found = find_orbits(model, "0", parameter="omega", rounds=1)
    swinging = [o for o in found if abs(o.unknowns[1] - 0.70291718) < 1e-6]
    assert [orbit.physical for orbit in swinging] == [False, True]
    places = [orbit.unknowns[0] for orbit in swinging]
    assert np.allclose(places, [-2.42422937, -2.42422937 - 2.0 * math.pi])


@pytest.mark.full
def test_events_are_restored_from_their_states(tmp_path):
    """Also at the pitchfork of a pendulum, where no search finds the singular orbit, and orbits one
    turn further, whose multipliers are the same, are others."""
    pytest.importorskip("heyoka")
    model = Pendulum(a=0.8, omega=0.9, c=0.2, sigma=3.0, r=0.7)
    orbit = find_orbits(model, "0", parameter="a", rounds=1)[0]
    branch = continue_orbit(orbit, "a", (0.2, 1.4), events=["BP"])
    (event,) = branch.events
    assert event.orbit().unknowns[:2].tolist() == event.state
    born = continue_born(event, range=(0.2, 1.4), events=["G"])
    assert (born.word, len(born) > 10) == ("", True)
    middle = born.orbit(len(born) // 2)
    assert abs(middle.unknowns[0] - event.state[0]) < 3.0

    def force(t, s):
        return s[1], middle.value * math.cos(0.9 * t) - 0.2 * s[1] - math.sin(s[0])

    end = solve_ivp(
        force,
        (0.0, 2.0 * math.pi / 0.9),
        middle.unknowns[:2],
        method="DOP853",
        rtol=1e-13,
        atol=1e-13,
    ).y[:, -1]
    assert end == pytest.approx(middle.unknowns[:2], abs=1e-11)


@pytest.mark.full
def test_an_older_entry_has_the_orbit_of_its_multipliers_or_says_that_there_is_none():
    pytest.importorskip("heyoka")
    model = Duffing(a=0.3, omega=1.3, c=0.1, alpha=1.0, beta=1.0, sigma=0.8, r=0.8)
    orbit = find_orbits(model, "0", parameter="a", rounds=1)[0]
    branch = continue_orbit(orbit, "a", (0.05, 2.0), events=["G"])
    (event,) = branch.events
    older = dataclasses.replace(event, state=None)
    assert older.orbit().unknowns == pytest.approx(event.orbit().unknowns, abs=1e-9)
    other = dataclasses.replace(older, multipliers=[(0.5, 0.0), (0.1, 0.0)])
    with pytest.raises(InputError, match="that has its multipliers"):
        other.orbit()


def test_an_orbit_of_two_periods_is_found_once():
    """It was there twice: from the first period on, and from the second."""
    pytest.importorskip("heyoka")
    model = Duffing(a=12.0, omega=1.2, c=0.3, alpha=-1.0, beta=1.0, sigma=50.0, r=0.7)
    found = find_orbits(model, "0/2T", parameter="omega")
    starts = [orbit.unknowns[:2] for orbit in found]

    def after(state, periods):
        def motion(t, y):
            return [y[1], 12.0 * math.cos(1.2 * t) - 0.3 * y[1] + y[0] - y[0] ** 3]

        span = (0.0, periods * 2.0 * math.pi / 1.2)
        return solve_ivp(motion, span, state, rtol=1e-11, atol=1e-12).y[:, -1]

    assert len(found) == 2  # mirror images of each other
    assert after(starts[0], 2.0) == pytest.approx(starts[0], abs=1e-6)
    assert min(np.max(np.abs(after(starts[0], k + 0.5) + starts[1])) for k in (0, 1)) < 1e-6


@pytest.mark.full
@pytest.mark.parametrize("law", ["-z + 1000000*cos(w*t)", "-z + x*v/1000000"])
def test_a_coordinate_that_acts_on_none_changes_nothing(law):
    """Whatever its size: folds of Duffing's oscillator are where they are without it. By the size
    of the largest coordinate the branch ended beside the first one."""
    pytest.importorskip("heyoka")

    def folds(**more):
        table = {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"w": 1.4, "d": 9.0},
            "modes": {"free": {"x": "v", "v": "0.3*cos(w*t) - 0.1*v - x - x**3", **more}},
            "guards": {"S": {"within": "x <= d", "set": {"v": "-0.5*v"}}},
        }
        asked = {"parameter": "w", "range": [1.0, 2.0], "orbits": ["0"]}
        given = {"name": "d", "model": table, "follow": asked, "detect": {"events": ["FB"]}}
        (branch,) = follow(read_scene(given)).branches
        return sorted(entry.value for entry in branch.events)

    alone = folds()
    assert len(alone) == 2
    assert folds(z=law) == pytest.approx(alone, rel=1e-11)
