"""Points of codimension two followed in a third parameter."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from zoo import ROOT, scene

from contimpact.bifurcations.kind import kind_of
from contimpact.diagrams.curve_problem import CurveProblem, double_of
from contimpact.diagrams.curves import follow_curve
from contimpact.diagrams.explore import follow
from contimpact.diagrams.map_explorer import entries_born, follow_codim2
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.errors import InputError
from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import find_orbits
from contimpact.results.catalogue import load_diagram, load_entries, write_diagram
from contimpact.results.options import CURVE_SETTINGS
from contimpact.results.scene import read_scene
from contimpact.segments.kernels import Kernels
from contimpact.storage import read_bounded
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

PANELS = {
    "A": ({"A": 5.0, "s": 0.4}, "s", (0.03, 1.2)),
    "s": ({"A": 7.0, "s": 0.5}, "A", (0.8, 40.0)),
}
CROSSINGS = {
    "A": {
        1: (0.191990392, 0.394006503),
        2: (0.205889307, 0.295513665),
        3: (0.229925231, 0.185725166),
    },
    "s": {
        1: (0.188204593, 0.429318118),
        2: (0.194621522, 0.372079625),
        3: (0.204431375, 0.304161346),
        4.5: (0.240265313, 0.151180589),
    },
}
"""d and r where PD and grazing of 1:1 cross, by beta in units of pi/18: branches/fig6a and fig6b,
from curves in two parameters and one-parameter runs."""
ALL = ((0.01, 0.99), (0.001, math.pi / 2))


def curve_at(panel, kind, beta=math.pi / 6, which=0, limits=(0.02, 0.95), r=0.5):
    """An entry at some beta, its curve in r, and the model."""
    values, first, span = PANELS[panel]
    model = ImpactPair(beta=beta, r=r, **values)
    orbit = next(o for o in find_orbits(model, "1:1", parameter=first) if o.physical)
    events = continue_orbit(orbit, range=span, events=("FB", "PD", "G")).events
    entry = [e for e in events if e.kind == kind][which]
    return entry, follow_curve(entry, model, "r", span, limits), model


def point_of(curve, *kinds):
    return next(p for p in curve.points if p.kind in kinds)


def in_beta(panel, entry, point, **given):
    ranges = [PANELS[panel][2], *ALL]
    return follow_codim2(entry, point, second="r", third="beta", ranges=ranges, **given)


@pytest.mark.parametrize("kind", ["PD", "G"])
@pytest.mark.parametrize("panel", list(PANELS))
@pytest.mark.full
def test_one_curve_through_all_published_crossings(panel, kind):
    entry, curve, _ = curve_at(panel, kind)
    wanted = {n * math.pi / 18: place for n, place in CROSSINGS[panel].items()}
    found = in_beta(panel, entry, point_of(curve, "PD-G", "G-PD"), values=list(wanted))
    assert (found.kind, found.parameters[1:]) == ("PD-G", ("r", "beta"))
    for beta, (d, r) in wanted.items():
        row = int(np.argmin(np.abs(found["beta"] - beta)))
        assert abs(found["beta"][row] - beta) < 1e-14
        assert abs(found["r"][row] - r) < 1e-9
        assert abs(found["d"][row] - d) < 1e-9
    assert not found.missed


@pytest.mark.parametrize(
    ("kind", "name", "angles", "which", "tolerance"),
    [
        ("PD", "PD-G", (0.5, 0.6), 0, 1e-10),
        ("G", "G-PD", (0.5, 0.6), 0, 1e-10),
        ("PD", "GPD", (math.pi / 3, 7 * math.pi / 18), 1, 1e-7),
    ],
)
@pytest.mark.full
def test_as_on_a_curve_at_another_angle(kind, name, angles, which, tolerance):
    """GPD is bracketed along the curve in two parameters: to the square root of rounding."""
    here, there = angles
    r = 0.85 if name == "GPD" else 0.5
    entry, curve, _ = curve_at("s", kind, beta=here, r=r, which=which)
    _, other, _ = curve_at("s", kind, beta=there, r=r, which=which)
    found = in_beta("s", entry, point_of(curve, name), values=[there])
    rows = np.nonzero(np.abs(found["beta"] - there) < 1e-13)[0]
    point = point_of(other, name).parameters
    away = [max(abs(found[n][i] / point[n] - 1.0) for n in ("A", "r")) for i in rows]
    assert min(away) < tolerance


@pytest.mark.parametrize("name", ["PD-G", "GPD"])
@pytest.mark.full
def test_jacobian_against_differences(name):
    values = {"PD-G": ("s", "PD", 0.5, 0.5), "GPD": ("s", "PD", math.pi / 3, 0.85)}[name]
    panel, kind, beta, r = values
    entry, curve, model = curve_at(panel, kind, beta=beta, r=r)
    point = point_of(curve, name)
    first = PANELS[panel][1]
    at = model.replace(**{n: point.parameters[n] for n in (first, "r")})
    problem = OrbitProblem(at, Word(entry.word), Kernels(at, first, "r", "beta"))
    rows = [[impact["time"], impact["velocity"]] for impact in point.impacts]
    orbit = np.append(np.ravel(rows), [at.values[n] for n in (first, "r", "beta")])
    here = problem.evaluate(orbit)
    double = double_of(here, name, kind_of(kind), {})
    curve = CurveProblem(double.kind, double.system, double.details, [1.0, 1.0])
    z = curve.packed(orbit, double.system.start(here))
    assert np.max(np.abs(curve.evaluate(z).residual)) < 1e-9
    exact, h = curve.evaluate(z).jacobian, 1e-6
    for i in range(len(z)):
        step = h * np.eye(len(z))[i]
        rate = (curve.evaluate(z + step).residual - curve.evaluate(z - step).residual) / (2 * h)
        scale = 1.0 + np.abs(exact[:, i])
        assert np.max(np.abs(rate - exact[:, i]) / scale) < 1e-6


@pytest.mark.full
def test_two_points_meet_where_the_angle_turns():
    """Two G-FB of one curve at beta = pi/18, none at pi/9."""
    entry, curve, _ = curve_at("A", "G", beta=math.pi / 18)
    found = in_beta("A", entry, point_of(curve, "G-FB"))
    turn = point_of(found, "turn")
    counts = []
    for beta in (turn.parameters["beta"] - 0.005, turn.parameters["beta"] + 0.005):
        _, other, _ = curve_at("A", "G", beta=beta)
        near = [p for p in other.points if p.kind == "G-FB" and p.parameters["r"] < 0.3]
        counts.append(len(near))
    assert counts[0] == counts[1] + 2


def test_codimension_three_is_the_same_in_either_family():
    """The pair depends on d, gbar and r alone: s and A are two ways through the same points."""
    found = []
    for name in ("fig6_A", "fig6_s"):
        catalogue = json.loads(read_bounded(ROOT / "branches" / name / "catalogue.json"))
        points = [p for c in catalogue["codimension2_curves"] for p in c["codimension2"]]
        places = [p["parameters"] for p in points if p["kind"] == "PD-G, GPD"]
        found.append([[p[n] for n in ("d", "gbar", "r")] for p in places])
    assert len(found[0]) == 1
    assert found[0] == [pytest.approx(place, rel=1e-11) for place in found[1]]


def test_a_cusp_is_accepted_on_a_curve_of_two_kinds():
    """Own unknowns of grazing and of a fold are told apart: a null vector had 7 entries for 6."""
    diagram = load_diagram(ROOT / "branches" / "fig6_A")
    curve, point = next((c, p) for c in diagram.curves for p in c.points if p.id == "c8.1")
    entry = next(e for branch in diagram.branches for e in branch.events if e.id == curve.origin)
    ranges = [(0.01, 1.5), (0.03, 0.3), (0.19, 0.54)]
    found = follow_codim2(entry, point, second="r", third="beta", ranges=ranges)
    known = [p for c in diagram.codim2_curves for p in c.points if p.kind in ("FB-G, CP", "turn")]
    for kind in ("FB-G, CP", "turn"):
        place = point_of(found, kind).parameters["r"]
        assert min(abs(p.parameters["r"] / place - 1.0) for p in known if p.kind == kind) < 1e-10


@pytest.mark.full
def test_a_scene_follows_each_point_once(tmp_path):
    given = scene(
        model={"system": "impact-pair", "parameters": {"beta": 0.5, "r": 0.3, "A": 5.0, "s": 0.4}},
        follow={"parameter": "s", "range": [0.03, 1.2], "orbits": ["1:1"], "switch": []},
        detect={"events": ["PD", "G"]},
        curves={
            "parameter": "r",
            "range": [0.0, 0.95],
            "third": {"parameter": "beta", "range": [0.1, 1.5]},
        },
    )
    diagram = follow(given)
    found = [p.kind for c in diagram.curves for p in c.points]
    assert {"PD-G", "G-PD"} <= {*found}
    crossing = [c for c in diagram.codim2_curves if (c.kind, c.word) == ("PD-G", "BT")]
    assert len(crossing) == 1
    assert crossing[0].parameters == ("s", "r", "beta")
    write_diagram(diagram, tmp_path)
    again = load_diagram(tmp_path)
    assert again == diagram
    assert min(curve["r"].min() for curve in again.curves) == 0.0


@pytest.mark.full
def test_what_is_refused():
    entry, curve, _ = curve_at("A", "PD")
    point = point_of(curve, "PD-G")
    with pytest.raises(InputError, match="range of beta"):
        follow_codim2(
            entry, point, second="r", third="beta", ranges=[(0.03, 1.2), (0, 1), (0, 0.1)]
        )
    with pytest.raises(InputError, match="ranges"):
        follow_codim2(entry, point, second="r", third="beta", ranges=[(0.03, 1.2)])
    with pytest.raises(InputError, match="twice"):
        follow_codim2(entry, point, second="r", third="r", ranges=[(0.03, 1.2), (0, 1), (0, 1)])
    with pytest.raises(InputError, match="accepted: "):
        in_beta("A", entry, replace(point, kind="CP"))


@pytest.mark.parametrize(
    ("third", "message"),
    [
        ({"parameter": "r", "range": [0, 1]}, "third.parameter"),
        ({"parameter": "b", "range": [0, 1]}, "no parameter"),
        ({"parameter": "beta", "range": [1.0, 1.2]}, "third.range"),
        ({"parameter": "beta", "range": [0, 1], "values": [1]}, "third"),
    ],
)
def test_scenes_that_are_refused(third, message):
    with pytest.raises(InputError, match=message):
        scene(
            detect={"events": ["PD", "G"]},
            curves={"parameter": "r", "range": [0.0, 0.95], "third": third},
        )


def test_a_marked_point_is_physical_if_its_curve_is_on_one_side():
    """Where a doubling's orbit touches it violates nothing but rounding."""
    _, curve, _ = curve_at("s", "PD")
    places = [row for row, mark in enumerate(curve["event"]) if mark not in ("", "UZ")]
    sides = [(curve["physical"][row - 1], curve["physical"][row + 1]) for row in places]
    changes = [row for row, pair in zip(places, sides, strict=True) if set(pair) == {0, 1}]
    assert changes
    assert all(curve["physical"][row] == 1 and not curve["reason"][row] for row in changes)


def test_no_gpd_is_made_of_rounding_where_an_impact_is_at_rest():
    """All along a curve of PD-V the determinant of C(1) is rounding, and its sign by chance."""
    limits = (0.1, 0.2), (0.72, 0.85), (5.85, 6.35)
    model = ImpactPair(beta=0.41, r=0.79, A=6.3, s=0.13)
    orbits = find_orbits(model, "BTB", parameter="s", starts=32)
    branches = (continue_orbit(orbit, range=limits[0], events=("PD",)) for orbit in orbits)
    doubling = next(event for branch in branches for event in branch.events)
    (point,) = follow_curve(doubling, "r", *limits[:2]).points
    found = follow_codim2(doubling, point, second="r", third="A", ranges=limits)
    assert (point.kind, found.points, found.missed) == ("PD-V", [], [])


@pytest.mark.full
def test_a_gpd_of_free_period_is_followed():
    """Its orbit was restored without its period, and parts of an eigenvector that are zero were
    asked to be as small as they are. Runs at the end's value of la end in the same GPD."""
    entry = next(e for e in load_entries(ROOT / "branches" / "coco_bang_bang") if e.id == "e5")
    limits = (0.9, 1.1), (23.0, 26.2), (0.1999, 0.201)
    (point,) = follow_curve(entry, None, "A", *limits[:2]).points
    settings = replace(CURVE_SETTINGS, step=0.2, max_step=0.5)
    about = {"second": "A", "third": "la", "ranges": limits, "settings": settings}
    found = follow_codim2(entry, point, detect=False, **about)
    assert [found["la"][0], found["la"][-1]] == pytest.approx(limits[2])
    assert [found["om"][-1], found["A"][-1]] == pytest.approx([0.971783910967, 24.5920517051])


def test_the_end_of_a_contact_that_lasts_stops_where_its_orbit_doubles():
    """Its V is told by the flight that ends there; maps ended in an error, asking for another."""
    model = read_scene(
        {
            "name": "beam",
            "model": {
                "system": "hybrid",
                "period": "2*pi/w",
                "parameters": {"a": 0.9718, "w": 0.51, "k": 4.0, "d": 0.2, "r": 0.7, "e": 1.5},
                "modes": {
                    "left": {"x": "v", "v": "a*cos(w*t) - 0.08*v - x"},
                    "right": {"x": "v", "v": "a*cos(w*t) - 0.08*v - x - k*(x - d)"},
                },
                "guards": {
                    "P": {"mode": "left", "within": "x <= d", "to": "right"},
                    "N": {"mode": "right", "within": "x >= d", "to": "left"},
                    "S": {"mode": "left", "within": "x >= -e", "set": {"v": "-r*v"}},
                },
            },
            "follow": {"parameter": "w", "range": [0.49, 0.53], "orbits": ["PNS"]},
        }
    ).model
    events = [
        event
        for orbit in find_orbits(model, "PNS", parameter="w")
        for event in continue_orbit(orbit, range=(0.49, 0.53), events=["PD"]).events
    ]
    ranges = [(0.49, 0.53), (0.95, 0.99)]
    curve = follow_curve(events[0], model, "a", *ranges)
    (point,) = (point for point in curve.points if point.kind == "PD-V")
    pair = Kernels(model, "w", "a")
    found = list(entries_born(events[0], point, model, ["V"], pair, ranges))
    assert len(found) == 2
    for entry in found:
        assert abs(entry.impacts[1]["velocity"]) < 1e-12
        assert entry.impacts[0]["velocity"] > 0.1
        again = continue_orbit(entry.orbit(model), range=ranges[0], events=["V"]).events
        assert min(abs(event.value - entry.value) for event in again) < 1e-12


@pytest.mark.full
def test_impacts_that_are_none_at_one_instant_make_no_points_of_rounding():
    """At twice the natural frequency a kick leaves no displacement after a period: two impacts at
    rest, at one instant, solve the equations of FB-V and FB-T for any restitution."""
    model = Oscillator(a=1.0, omega=1.45, c=0.1, k=1.0, sigma=-0.431052744, r=0.6)
    events = [
        event
        for orbit in find_orbits(model, "2", parameter="omega")
        for event in continue_orbit(orbit, range=(1.4, 1.6), events=["FB"]).events
    ]
    ranges = [(1.3, 2.2), (-0.45, -0.3), (0.4, 0.8)]
    points = {
        point.id: (event, point)
        for event in events[:1]
        for point in follow_curve(event, model, "sigma", *ranges[:2]).points
    }
    kinds = []
    for event, point in points.values():
        if point.kind in ("FB-T", "FB-V"):
            found = follow_codim2(event, point, model, second="sigma", third="r", ranges=ranges)
            assert (found.points, found.missed) == ([], [])
            assert found["omega"] == pytest.approx(2.0 * math.sqrt(1.0 - 0.1**2 / 4.0), rel=1e-12)
            kinds.append(point.kind)
    assert {*kinds} == {"FB-T", "FB-V"}
