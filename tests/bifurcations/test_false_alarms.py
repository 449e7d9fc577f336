"""What looks like an event that was missed, and is none."""

import dataclasses
import importlib.util
import math
from types import SimpleNamespace

import numpy as np
import pytest
from zoo import ROOT

from contimpact.bifurcations.kind import _causes_by_multiplier, _unexplained
from contimpact.bifurcations.kind import test_functions as functions_of
from contimpact.continuation.branch import MissedEvent
from contimpact.continuation.settings import Settings
from contimpact.diagrams.explore import follow
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.diagrams.orbit_walks import walk_both_ways
from contimpact.models.guards import Word
from contimpact.orbits.quiet import problem_of
from contimpact.orbits.search import find_orbits, orbit_at
from contimpact.results.catalogue import load_diagram
from contimpact.results.scene import read_scene
from contimpact.segments.kernels import Kernels
from contimpact.systems.bouncing_ball import BouncingBall
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.two_masses import TwoMasses

SYMMETRIC = {
    "name": "symmetric",
    "model": {
        "system": "linear",
        "coordinates": ["x", "y"],
        "mass": [1, 1],
        "damping": ["c", "c"],
        "stiffness": [["1 + k", "-k"], ["-k", "1 + k"]],
        "force": ["a*cos(omega*t)", "a*cos(omega*t)"],
        "period": "2*pi/omega",
        "guards": {
            "A": {"within": "x <= s", "restitution": "r"},
            "B": {"within": "y <= s", "restitution": "r"},
        },
        "parameters": {"c": 0.1, "k": 0.3, "a": 1.0, "omega": 1.2, "s": 0.5, "r": 0.7},
    },
    "follow": {"parameter": "omega", "range": [1.0, 1.5], "orbits": ["AB"]},
}


@pytest.mark.full
def test_bodies_that_hit_at_once_all_along_a_branch():
    """Two equal ones move as one oscillator does; which impact comes first is rounding."""
    one = Oscillator(a=1.0, omega=1.2, c=0.1, k=1.0, sigma=0.5, r=0.7)
    orbits = find_orbits(one, "S", parameter="omega")
    model = read_scene(SYMMETRIC).model
    problem = problem_of(model, Word("AB"), Kernels(model, "omega"))
    for orbit in orbits:
        t, v, omega = orbit.unknowns.tolist()
        both = orbit_at(problem, np.array([t, v, 0.5, v, t, v, 0.5, -0.7 * v, omega]))
        branch = continue_orbit(both, "omega", (1.0, 1.5), events=["T", "G", "V"])
        assert not branch.missed
        assert not branch.events
        alone = continue_orbit(orbit, "omega", (1.0, 1.5), events=[])
        assert branch["physical"].all() == alone["physical"].all()


@pytest.mark.parametrize("limits", [(2.5, 2.54), (2.515, 2.523)])
@pytest.mark.full
def test_an_extremum_that_comes_from_the_next_flight(limits):
    """Beside an unphysical orbit one body turns beyond its stop while the other one hits."""
    values = {"m1": 1, "m2": 1, "c1": 0.1, "c2": 0.05, "k1": 1, "k2": 0.6, "a1": 1, "a2": 0}
    model = TwoMasses(**values, omega=1.5, sigma_1=1, sigma_2=2.517, r=0.8)
    problem = problem_of(model, Word("AB", 2), Kernels(model, "sigma_2"))
    first, second = [0.232, 1.872, 3.507, -0.340], [9.840, 1.148, 2.794, 0.007]
    orbit = orbit_at(problem, np.array([*first, *second, 2.517]))
    branch = continue_orbit(orbit, "sigma_2", limits, events=["G", "T"])
    gaps = branch["smallest_gap"]
    assert np.any(gaps > 0.5)
    assert np.any(gaps < -1.5)  # it jumps on the way
    assert not branch.missed
    assert not branch.events


@pytest.mark.parametrize("parameter", ["s", "r"])
def test_the_event_at_which_a_walk_begins_is_found_and_explains_what_changes_there(parameter):
    """Right at an event multipliers within rounding of the unit circle count as stable: the count
    changes beside it, on the side of the walk that has not located it."""
    model = ImpactPair(beta="pi/3", r=0.5, A=5.0, s=0.3)
    asked = {"events": ["FB", "PD", "G"], "unphysical": True}
    found = {}
    for word in ("1:1", "2:1"):
        for orbit in find_orbits(model, word, parameter="s"):
            for event in continue_orbit(orbit, "s", (0.1, 1.05), **asked).events:
                if event.kind in ("FB", "PD"):
                    found[event.kind, event.value] = event
    assert {kind for kind, _ in found} == {"FB", "PD"}
    for event in found.values():
        start = event.orbit()
        value = start.parameters[parameter]
        branch = continue_orbit(start, parameter, (0.7 * value, 1.3 * value), **asked)
        assert branch.missed == []
        assert any(
            other.kind == event.kind and other.value == pytest.approx(value, rel=1e-12)
            for other in branch.events
        )


@pytest.mark.skipif(importlib.util.find_spec("heyoka") is None, reason="needs contimpact[ode]")
@pytest.mark.parametrize("value", [0.651, pytest.param(0.529, marks=pytest.mark.full)])
def test_no_grazing_is_seen_where_a_slip_vanishes_whose_impact_is_at_rest(value):
    """Beyond the V the flight after the slip begins beyond its guard, as deep as the square of the
    velocity: the sign of that is rounding before the V."""
    branch = load_diagram(ROOT / "branches" / "coco_stick_slip").branches[0]
    start = branch.orbit(int(np.argmin(np.abs(branch["V"] - value))))
    for longest in (0.1, 0.3, 0.97):
        for predictor in ("tangent", "secant"):
            steps = {"max_step": longest, "predictor": predictor}
            asked = {"events": ["G", "V"], "settings": steps, "unphysical": True}
            found = continue_orbit(start, "V", (0.5, 0.7), **asked)
            assert [event.kind for event in found.events] == ["V"]
            assert found.missed == []


def test_an_event_explains_only_what_is_missed_where_it_is():
    """Not what is missed on another orbit at its value, nor in another flight."""
    model = ImpactPair(beta="pi/6", r=0.3, A=5.0, s=0.34)
    orbit = next(o for o in find_orbits(model, "1:1", parameter="s") if o.physical)
    problem, asked = orbit.problem, (0.3, 0.4)
    tests = functions_of(problem, ["PD", "G"], {})
    run = walk_both_ways(problem, orbit.unknowns, asked, tests, Settings())
    for kind in ("PD", "G"):
        event = next(e for walk in run.walks for e in walk.events if e.kind == kind)
        walk = next(w for w in run.walks if event in w.events)
        index = event.details["index"] if kind == "G" else None
        ends, place = (event.parameter, event.parameter + event.error), event.point.arclength
        there = MissedEvent(kind, ends, "why", place, index=index)
        far = dataclasses.replace(there, arclength=place + 0.01)
        untold = dataclasses.replace(there, arclength=math.inf)
        other = dataclasses.replace(there, index=99)

        def left(missed, walk=walk):
            walks = tuple(
                dataclasses.replace(w, missed=[missed] if w is walk else []) for w in run.walks
            )
            return dataclasses.replace(run, walks=walks).branch("b1").missed

        assert left(there) == []
        assert all(len(left(missed)) == 1 for missed in (far, untold, other))


SINGLE, FLIP, PAIR = ["FB", "BP"], ["PD"], ["NS", "FB", "BP", "PD"]


@pytest.mark.parametrize(
    ("left", "right", "causes"),
    [
        ((-1e9, -5.7), (-6 + 5j, -6 - 5j), []),  # behind the birth of an impact of a chain
        ((3 + 1j, 3 - 1j), (2, 4), []),
        ((2, 0.5), (0.9, 0.5), [SINGLE]),
        ((-2, 0.5), (-0.9, 0.5), [FLIP]),
        ((2, -2), (0.5, -0.5), [SINGLE, FLIP]),
        ((2, -0.5), (0.5, -2), [SINGLE, FLIP]),
        ((1.1j, -1.1j), (0.9j, -0.9j), [["NS"], ["NS"]]),
        ((1.1, 1.2), (0.9j, -0.9j), [PAIR, PAIR]),
        ((1.1, 1.2, 3), (0.9j, -0.9j, 0.5), [SINGLE, PAIR, PAIR]),
    ],
)
def test_multipliers_that_meet_off_the_unit_circle_need_no_event(left, right, causes):
    """Where two become a pair, none has passed it; a pair that has may have become two."""
    points = [
        SimpleNamespace(evaluation=SimpleNamespace(multipliers=np.array(values, complex)))
        for values in (left, right)
    ]
    assert _causes_by_multiplier(*points) == causes


@pytest.mark.parametrize(
    ("left", "right", "times", "causes"),
    [
        ((1.07, 0.5), (0.01, 0.5), 1, [FLIP]),  # 1.07, infinity, -2, -1, 0.01
        ((1.07, 0.5), (-1.07, 0.5), 1, []),
        ((1.07, 0.5), (0.01, 0.5), 2, [SINGLE]),
        ((0.9, 0.5), (0.9, 0.5), 1, [SINGLE, FLIP]),
    ],
)
def test_a_multiplier_that_passes_infinity_at_a_v_comes_back_at_the_other_side(
    left, right, times, causes
):
    """A fold was said not to be located on branches that double twice next to a V."""
    points = [
        SimpleNamespace(
            arclength=place, evaluation=SimpleNamespace(multipliers=np.array(values, complex))
        )
        for place, values in ((0.0, left), (1.0, right))
    ]
    between = SimpleNamespace(multipliers=np.array([math.inf, 0.5]))
    point = SimpleNamespace(arclength=0.5, evaluation=between)
    events = [SimpleNamespace(kind="V", point=point)] * times
    found = _unexplained(events, *points, ("FB", "PD", "V"), math.inf)
    assert found == [kinds[0] for kinds in causes]


@pytest.mark.parametrize("longest", [0.1, 0.97])
def test_where_an_orbit_without_restitution_begins_to_rest_is_a_grazing(longest):
    """A ball that hits a table once a period leaves it at once as long as the table falls faster
    than it: at its fastest, Gamma cos phi = pi, and there Gamma sin phi = 1."""
    model = BouncingBall(a=0.014, omega=50.0, r=0.0, g=9.8)
    exact = math.hypot(1.0, math.pi) * model.values["g"] / model.values["omega"] ** 2
    asked = {"events": ["G", "V", "T"], "settings": {"max_step": longest}, "unphysical": True}
    for orbit in find_orbits(model, "P", parameter="a"):
        branch = continue_orbit(orbit, "a", (0.003, 0.03), **asked)
        (event,) = branch.events
        assert event.kind == "G"
        assert abs(event.value - exact) <= event.error < 1e-13
        assert branch.missed == []


@pytest.mark.parametrize("step", [0.05, 0.1, 0.97])
@pytest.mark.parametrize("beta", ["pi/6", "pi/4"])
def test_the_pair_without_restitution_rests_at_one_value_from_both_words(beta, step):
    """The flight between two impacts on a wall vanishes where that after one begins without an
    acceleration."""
    model, found = ImpactPair(beta=beta, r=0.0, A=5.0, s=0.3), {}
    asked = {"events": ["G", "T"], "settings": {"max_step": step}, "unphysical": True}
    for word in ("1:1", "2:1"):
        for orbit in find_orbits(model, word, parameter="s"):
            branch = continue_orbit(orbit, "s", (0.05, 1.5), **asked)
            assert branch.missed == []
            (found[word],) = branch.events
    grazing, merger = found["1:1"], found["2:1"]
    assert (grazing.kind, merger.kind) == ("G", "T")
    assert abs(grazing.value - merger.value) <= grazing.error + merger.error
    assert grazing.error < 1e-11


CHAIN = {
    "name": "chain",
    "model": {
        "system": "linear",
        "coordinates": ["x", "y", "z"],
        "mass": [1, 1, 1],
        "damping": [["2*c", "-c", "0"], ["-c", "2*c", "-c"], ["0", "-c", "c"]],
        "stiffness": [["1 + k", "-k", "0"], ["-k", "2*k", "-k"], ["0", "-k", "k"]],
        "force": ["a*cos(omega*t)", "0", "0"],
        "period": "2*pi/omega",
        "guards": {
            "A": {"within": "x <= s1", "restitution": "r"},
            "B": {"within": "y <= s2", "restitution": "r"},
            "C": {"within": "z <= s3", "restitution": "r"},
        },
        "parameters": {"c": 0.064, "k": 0.1175, "a": 1.0, "omega": 0.994}
        | {"s1": 1.196, "s2": 0.443, "s3": 0.457, "r": 0.348},
    },
    "follow": {"parameter": "k", "range": [0.1, 0.13], "orbits": ["ABC"]},
}


@pytest.mark.parametrize("limits", [(0.1165, 0.118), (0.115, 0.119)])
def test_two_extrema_that_are_born_beyond_a_wall(limits):
    """The smallest gap at which a flight turns jumps there, and the flight is beyond the wall on
    either side: the gap at the time of the new extremum passes smoothly."""
    model = read_scene(CHAIN).model
    problem = problem_of(model, Word("ABC"), Kernels(model, "k"))
    first = [6.4184, 1.7890, -1.2705, 0.2402, 1.0508, -0.4986]
    second = [-3.5995, 0.4010, -7.0396, 3.8128, 2.1288, -0.4848]
    third = [32.3275, -0.3346, 4.7301, 1.2330, -0.5312, 0.3212]
    orbit = orbit_at(problem, np.array([*first, *second, *third, 0.1175]))
    branch = continue_orbit(orbit, "k", limits, events=["G"], unphysical=True)
    assert branch.events == branch.missed == []
    found = []
    for row in range(len(branch)):
        z = branch.orbit(row).unknowns
        touch = problem.evaluate(z).gaps_of(1).touches[2]
        leave = z[problem.m : 2 * problem.m]
        position = problem.kernels.gap("B", "C")(*leave, 29.1525, *problem.values(z))[0]
        found.append((abs(z[-1] - 0.116751858585), touch.gap, 0.457 - position))
    near = np.array([gaps for away, *gaps in found if away < 5e-4])
    assert np.any(near[:, 0] > 0.2)
    assert np.any(near[:, 0] < -0.5)  # it jumps on the way
    assert np.all(np.abs(near[:, 1] + 0.645) < 0.2)


def test_orbits_that_all_belong_to_one_value_have_no_folds():
    """The current of a coil that is switched off at I and on by a clock: its map is linear, and
    where its slope is -1 every current has the period two."""
    model = {
        "system": "hybrid",
        "period": 1.0,
        "parameters": {"I": 1.7},
        "modes": {"on": {"i": "2 - i/2", "s": "1"}, "off": {"i": "-1 - i/2", "s": "1"}},
        "guards": {
            "T": {"mode": "on", "within": "i <= I", "to": "off"},
            "C": {"mode": "off", "within": "s <= 1", "to": "on", "set": {"s": 0}},
        },
    }
    asked = {"parameter": "I", "range": [1.6, 1.8], "orbits": ["TC"], "switch": ["PD"]}
    asked |= {"unphysical": False}
    scene = {"name": "coil", "model": model, "follow": asked, "detect": {"events": ["FB", "PD"]}}
    diagram = follow(read_scene(scene | {"numerics": {"max_points": 12, "starts": 32}}))
    # I + 2 = exp(1/2) (4 - I)
    value = (4.0 * math.exp(0.5) - 2.0) / (1.0 + math.exp(0.5))
    assert "FB" not in {entry.kind for entry in diagram.entries}
    (doubling,) = (entry for entry in diagram.entries if entry.kind == "PD")
    assert doubling.value == pytest.approx(value, rel=1e-14)
    assert np.ptp(diagram.branches[1]["I"]) < 1e-12
