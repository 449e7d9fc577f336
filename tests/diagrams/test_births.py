"""Curves that start at points of codimension two on other curves."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from contimpact.bifurcations.codimension_two import MultiplierCoincides, repeat_orbit
from contimpact.bifurcations.kind import kind_of
from contimpact.diagrams.curves import follow_curve
from contimpact.diagrams.map_explorer import entries_born, follow_codim2, model_at_point, orbit_at
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.orbits.search import find_orbits, repeats
from contimpact.results.branch import orbit_of
from contimpact.results.catalogue import load_diagram
from contimpact.results.options import CURVE_SETTINGS
from contimpact.results.scene import load_scene
from contimpact.segments.kernels import Kernels
from contimpact.systems.impact_damper import ImpactDamper
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.two_masses import TwoMasses

ROOT = Path(__file__).parents[2]
RANGES = ((0.8, 40.0), (0.05, 0.9))
KINDS = ("FB", "PD", "NS", "G")
MODEL = ImpactPair(beta=math.pi / 3, r=0.7, A=3.0, s=0.5)
PAIRS = Kernels(MODEL, "A", "r")


def events(kind, model=MODEL, word="1:1"):
    """The events of a kind on all branches of a word, over A."""
    at = [model.replace(A=value) for value in (3.0, 9.0)]
    return [
        e
        for there in at
        for o in find_orbits(there, word, parameter="A", starts=32)
        for e in continue_orbit(o, range=RANGES[0], events=(kind,)).events
        if e.physical
    ]


def curve_with(kind, point, r):
    """A point of codimension two on a curve of 1:1 that passes a value of r, and its entry."""
    for entry in events(kind, MODEL.replace(r=r)):
        curve = follow_curve(entry, MODEL, "r", *RANGES, kernels=PAIRS)
        for found in curve.points:
            if found.kind == point:
                return entry, found
    raise AssertionError(f"no {point} on a curve of {kind}")


def born(entry, point):
    return list(entries_born(entry, point, MODEL, KINDS, PAIRS, RANGES))


def solves(entry, second="r"):
    """The entry's own event, found anew on the branch through its orbit."""
    model = MODEL.replace(**{second: entry.parameters[second]})
    orbit = orbit_of(entry, model, Kernels(model, "A"))
    near = (0.9 * entry.value, 1.1 * entry.value)
    branch = continue_orbit(orbit, range=near, events=(entry.kind,))
    return min(abs(e.value - entry.value) for e in branch.events)


@pytest.fixture(scope="module")
def turning():
    return curve_with("PD", "GPD", 0.7)


@pytest.fixture(scope="module")
def grazing():
    return curve_with("PD", "PD-G", 0.7)


@pytest.mark.full
def test_the_fold_of_the_doubled_orbit_at_a_gpd(turning):
    entry, point = turning
    found = born(entry, point)
    assert {(e.kind, e.word, e.period) for e in found} == {("FB", "BTBT", 2)}
    assert all(e.residual < 1e-12 for e in found)
    assert max(solves(e) for e in found) < 1e-9


@pytest.mark.full
def test_it_ends_at_the_gpd(turning):
    entry, point = turning
    fold = born(entry, point)[0]
    curve = follow_curve(fold, MODEL, "r", *RANGES, kernels=PAIRS)
    (row,) = (i for i, end in zip((0, -1), curve.ends, strict=True) if end.kind.name == "SHORTER")
    for name in ("A", "r"):
        assert curve[name][row] == pytest.approx(point.parameters[name], abs=1e-9)
    assert "became 1:1, run 2 times" in curve.ends[row].message
    for one, other in (("v1", "v3"), ("v2", "v4")):
        assert curve[one][row] == pytest.approx(curve[other][row], abs=1e-8)


@pytest.mark.full
def test_three_curves_meet_at_a_pd_g(grazing):
    """The grazing of the orbit, and those of the doubled orbit on either side."""
    entry, point = grazing
    found = born(entry, point)
    assert [(e.kind, e.word) for e in found] == [("G", "BT")] * 2 + [("G", "BTBT")] * 2
    assert sum(e.physical for e in found if e.word == "BTBT") == 1
    assert max(solves(e) for e in found if e.physical) < 1e-9


@pytest.mark.full
def test_the_folds_at_a_grazing():
    """One of the orbit that grazes, one of that with an impact more: each physical on one side."""
    entry, _ = curve_with("G", "G-PD", 0.55)
    curve = follow_curve(entry, MODEL, "r", *RANGES, kernels=PAIRS)
    words = []
    for point in (p for p in curve.points if p.kind == "G-FB"):
        pair = born(entry, point)
        assert sorted(e.physical for e in pair) == [False, True]
        assert max(solves(e) for e in pair if e.physical) < 1e-9
        words += [e.word for e in pair if e.kind == "FB"]
    assert sorted(words) == ["BT", "BT", "BTT", "BTT"]


def test_an_orbit_run_twice(turning):
    entry, _ = turning
    here = orbit_of(entry, MODEL).linearisation
    assert repeat_orbit(here).largest_residual == pytest.approx(here.largest_residual, abs=1e-14)
    assert repeat_orbit(here).multipliers[0] == pytest.approx(here.multipliers[0] ** 2, abs=1e-9)


def test_kinds_that_are_not_wanted_are_left_out(grazing):
    entry, point = grazing
    assert not list(entries_born(entry, point, MODEL, ("FB", "NS"), PAIRS, RANGES))


@pytest.mark.slow
def test_no_ns_begins_where_branch_points_pass_the_fold():
    """The impact damper: at d = 27.20067 two multipliers are 1, and a branch of asymmetric orbits
    is born on both sides; the eigenvectors are one that is its own image and one that is not."""
    machine = ImpactDamper(d=26.9, r=0.8, mu=0.1, zeta=0.01, Omega=1.0)
    orbits = find_orbits(machine, "RL", parameter="Omega", starts=16, rounds=1)
    events = continue_orbit(orbits[0], range=(0.9615, 1.02), events=("FB",)).events
    entry = next(e for e in events if e.kind == "FB")
    settings = dataclasses.replace(CURVE_SETTINGS, max_step=0.02)
    curve = follow_curve(entry, machine, "d", (0.93, 1.02), (26.5, 28.0), settings=settings)
    found = {p.kind: p for p in curve.points}
    assert found.keys() == {"R1", "FB-BP", "FB-NS"}
    assert found["R1"].parameters["d"] == pytest.approx(26.704401, abs=1e-6)
    assert found["FB-BP"].parameters["d"] == pytest.approx(27.200670, abs=1e-6)
    assert "no curve of NS begins" in found["FB-BP"].changes
    pairs = Kernels(machine, "Omega", "d")
    ranges = ((0.93, 1.02), (26.5, 28.0))
    assert not list(entries_born(entry, found["FB-BP"], machine, ("NS",), pairs, ranges))


@pytest.mark.slow
def test_ns_of_a_machine_begins_where_two_multipliers_of_its_fold_are_one():
    """The impact damper: its curve of NS passes what a run over d at Omega = 1 meets."""
    machine = ImpactDamper(d=26.9, r=0.8, mu=0.1, zeta=0.01, Omega=1.0)
    ranges = ((0.93, 1.02), (15.0, 27.0))
    orbits = find_orbits(machine, "RL", parameter="Omega", starts=16, rounds=1)
    events = continue_orbit(orbits[0], range=(0.9615, 1.02), events=("FB",)).events
    entry = next(e for e in events if e.kind == "FB")
    curve = follow_curve(entry, machine, "d", *ranges)
    points = [p for p in curve.points if p.kind == "R1"]
    point = min(points, key=lambda p: abs(p.parameters["d"] - 26.7044))  # at the other one is a BP
    pairs = Kernels(machine, "Omega", "d")
    begun = next(iter(entries_born(entry, point, machine, ("NS",), pairs, ranges)))
    torus = follow_curve(begun, machine, "d", *ranges, values=[26.324193380652915])
    (end,) = (e for e in torus.ends if e.kind.name == "RESONANCE")
    assert end.value == pytest.approx(point.parameters["Omega"], abs=1e-6)
    there = torus["Omega"][torus["event"] == "UZ"]
    assert np.min(np.abs(there - 1.0)) < 1e-9  # catalogued, from a run over d


@pytest.fixture(scope="module")
def masses():
    """Two masses, and the event of a kind on their 1:0 over omega."""
    machine = TwoMasses(**SHIPPED_MASSES)
    orbit = next(o for o in find_orbits(machine, "A", starts=20, rounds=1) if o.physical)
    events = continue_orbit(orbit, "omega", (1.6, 1.95), events=("FB", "PD")).events
    return machine, {kind: next(e for e in events if e.kind == kind) for kind in ("FB", "PD")}


SHIPPED_MASSES = {"c1": 0.1, "c2": 0.05, "k1": 1.0, "k2": 0.6, "a1": 1.0, "omega": 1.72}
SHIPPED_MASSES |= {"sigma_1": 1.0, "sigma_2": 1.0, "r": 0.8}
BOTH = ((1.6, 1.95), (0.95, 1.3))


@pytest.mark.full
def test_a_fold_and_a_doubling_of_one_orbit_are_one_point_on_both_curves(masses):
    """The curve of PD that begins at the fold-flip of a curve of FB has it as a point of its own,
    and so the other way round; the criticality of the PD has a pole there and no zero."""
    machine, events = masses
    pairs, places = Kernels(machine, "omega", "m1"), []
    for own, other in (("FB", "PD"), ("PD", "FB")):
        entry = events[own]
        curve = follow_curve(entry, machine, "m1", *BOTH)
        (point,) = curve.points
        assert (point.kind, curve.missed) == (f"{own}-{other}", [])
        here = orbit_at(entry, point, model_at_point(entry, point, machine), pairs)
        assert min(abs(here.multipliers - 1.0)) < 1e-9 > min(abs(here.multipliers + 1.0))
        start = next(entries_born(entry, point, machine, (other,), pairs, BOTH))
        assert start.kind == other
        (same,) = follow_curve(start, machine, "m1", *BOTH).points
        places += [(p.parameters["omega"], p.parameters["m1"]) for p in (point, same)]
    assert np.ptp(places, axis=0) == pytest.approx(0.0, abs=1e-11)
    assert places[0] == pytest.approx((1.703776954835, 1.218301570403), abs=1e-11)


@pytest.mark.full
def test_a_pair_on_the_unit_circle_beside_a_fold():
    """The curve of NS that begins there has the multiplier 1 at the same place."""
    machine = TwoMasses(**SHIPPED_MASSES | {"omega": 1.1})
    orbit = find_orbits(machine, "A/2T", parameter="omega", starts=20, rounds=1)[0]
    (fold,) = continue_orbit(orbit, "omega", (1.0, 1.2), events=("FB",)).events
    ranges = ((1.0, 1.3), (0.65, 1.05))
    pairs = Kernels(machine, "omega", "m1")
    curve = follow_curve(fold, machine, "m1", *ranges)
    point = next(p for p in curve.points if p.kind == "FB-NS")
    here = orbit_at(fold, point, model_at_point(fold, point, machine), pairs)
    others = np.delete(here.multipliers, np.argmin(abs(here.multipliers - 1.0)))
    pair = others[others.imag != 0.0]
    assert (len(pair), abs(pair)) == (2, pytest.approx(1.0, abs=1e-9))
    start = next(entries_born(fold, point, machine, ("NS",), pairs, ranges))
    torus = follow_curve(start, machine, "m1", *ranges)
    (same,) = [p for p in torus.points if p.kind == "NS-FB"]
    assert same.parameters == pytest.approx(point.parameters, abs=1e-10)


def test_no_orbit_of_several_laps_is_entered_for_the_one_that_grazes():
    """Beside the crossing of their curves Newton's method may lead from one to the other."""
    model, ranges = ImpactPair(beta=0.41, r=0.31, A=6.3, s=0.2095), [(0.1, 1.3), (0.15, 0.85)]
    orbits = find_orbits(model, "2:1/2T", parameter="s", starts=32)
    branches = [continue_orbit(o, range=(0.2, 0.215), events=("PD",)) for o in orbits]
    (doubling,) = [event for branch in branches for event in branch.events]
    points = follow_curve(doubling, model, "r", *ranges).points
    point = max((p for p in points if p.kind == "PD-G"), key=lambda p: p.parameters["r"])
    found = list(entries_born(doubling, point, model, ("G",), Kernels(model, "s", "r"), ranges))
    assert len(found) == 4
    assert not any(repeats(o.problem, o.unknowns, 1e-6) for o in map(orbit_of, found))


@pytest.mark.full
def test_a_fold_flip_is_followed_in_a_third_parameter(masses):
    """Along it both multipliers keep their values, on the equations of both events."""
    machine, events = masses
    ranges = [(1.2, 2.4), (0.8, 1.5), (0.5, 0.7)]
    found = []
    for kind in ("FB", "PD"):
        entry = events[kind]
        (point,) = follow_curve(entry, machine, "m1", *BOTH).points
        given = {"second": "m1", "third": "k2", "ranges": ranges}
        found.append(follow_codim2(entry, point, machine, **given))
        assert not found[-1].missed
        assert "NS of the doubled orbits may begin here, and is not started" in point.changes
    one, other = found
    assert (one.kind, other.kind) == ("FB-PD", "PD-FB")
    multipliers = np.array([one[f"multiplier{i}_re"] for i in (1, 2, 3, 4)])
    for mu in (1.0, -1.0):
        assert np.min(abs(multipliers - mu), axis=0) == pytest.approx(0.0, abs=1e-8)
    assert other["omega"][[0, -1]] == pytest.approx(one["omega"][[0, -1]], abs=1e-9)


@pytest.mark.full
@pytest.mark.parametrize(("scene", "kind"), [("impact_damper", "BP"), ("coupled_by_impact", "FB")])
def test_of_two_kinds_with_one_multiplier_branches_cross_at_one(scene, kind):
    """A BP of symmetric orbits, and a fold."""
    entry = next(e for e in load_diagram(ROOT / "branches" / scene).entries if e.kind == kind)
    model = load_scene(ROOT / "branches" / scene / "scene.toml").model
    second = next(name for name in model.values if name != entry.parameter)
    here = orbit_of(entry, model, Kernels(model, entry.parameter, second)).linearisation
    event = SimpleNamespace(point=SimpleNamespace(evaluation=SimpleNamespace(orbit=here)))
    accepted = [k for k in ("FB", "BP") if MultiplierCoincides(kind_of("NS"), k).accept(event)]
    assert accepted == [kind]
