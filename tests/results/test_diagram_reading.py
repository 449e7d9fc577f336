"""Stability intervals, bistability and mechanisms, on Figs. 7 and 8 and the level pair."""

from __future__ import annotations

import dataclasses
from itertools import groupby

import numpy as np
import pytest
from zoo import ROOT, scene_table

from contimpact.continuation.branch import EndKind
from contimpact.diagrams.explore import follow
from contimpact.plots.lines import runs
from contimpact.results.catalogue import load_diagram
from contimpact.results.diagram_reading import Interval, _bistable, read, stable_intervals
from contimpact.results.scene import load_scene, read_scene

BRANCHES = ROOT / "branches"


@pytest.fixture(scope="module")
def fig7():
    return follow(load_scene(BRANCHES / "fig7" / "scene.toml"))


@pytest.fixture(scope="module")
def fig8():
    return follow(load_scene(BRANCHES / "fig8" / "scene.toml"))


def values(diagram, notation, kind):
    return [e.value for e in diagram.entries if e.notation == notation and e.kind == kind]


def test_intervals_end_exactly_at_events(fig7):
    found = {i.notation: i for i in read(fig7).stable}
    assert set(found) == {"1:1", "2:1", "1:1/2T", "3:1"}
    assert found["1:1"].low == values(fig7, "1:1", "PD")[0]
    assert found["1:1"].high == values(fig7, "1:1", "FB")[0]
    assert found["2:1"].high == values(fig7, "2:1", "FB")[0]
    assert found["2:1"].low == min(values(fig7, "2:1", "G"), key=lambda v: abs(v - 0.279))
    assert found["1:1/2T"].bounds[1] == "born"


def test_intervals_hold_only_stable_physical_points(fig7):
    """One for each stretch of such points along a branch."""
    stretches = 0
    for branch in fig7.branches:
        own, found = branch["event"] == "", stable_intervals(branch)
        good, values = (branch.stable & branch.physical)[own], branch["s"][own]
        rows = [list(group) for _, group in groupby(range(len(good)), key=lambda k: good[k])]
        held = [part for part in rows if good[part[0]]]
        assert len(found) == len(held)
        stretches += len(held)
        for part in held:
            low, high = np.min(values[part]), np.max(values[part])
            assert sum(i.low <= low and high <= i.high for i in found) == 1
    assert stretches == 4


def test_where_a_branch_is_born_it_has_no_status_of_its_own(fig7):
    """Its first orbit is another branch's, its multiplier on the unit circle but for rounding."""
    for branch in fig7.branches:
        if branch.ends[0].kind is not EndKind.BORN:
            continue
        found = []
        for unstable in (0, 1):
            columns = branch.columns | {"n_unstable": branch["n_unstable"].copy()}
            columns["n_unstable"][0] = unstable
            found.append(dataclasses.replace(branch, columns=columns))
        one, other = found
        assert stable_intervals(one) == stable_intervals(other)
        assert all(i.low < i.high for i in stable_intervals(one))
        assert runs(one) == runs(other)


def test_a_point_beside_an_event_by_rounding_ends_no_interval(fig7):
    """As where a branch is born at a zero velocity, beside which a multiplier is infinite."""
    branch = next(b for b in fig7.branches if b.notation == "1:1")
    (interval,) = stable_intervals(branch)
    place = branch["event"].tolist().index(interval.bounds[0])
    beside = place + 1 if branch.stable[place + 1] else place - 1
    columns = {name: column.copy() for name, column in branch.columns.items()}
    columns["s"][beside] = columns["s"][place] * (1.0 + 1e-16)
    columns["n_unstable"][beside] = 1
    assert stable_intervals(dataclasses.replace(branch, columns=columns)) == [interval]


@pytest.mark.full
def test_bistability_of_fig8_lies_between_fold_and_grazing(fig8):
    (both,) = [b for b in read(fig8).bistable if set(b.notations) == {"1:1", "2:1"}]
    assert both.low == values(fig8, "2:1", "FB")[0]
    assert both.high == next(e.value for e in fig8.entries if e.label == "G[1:1->2:1]")


@pytest.mark.full
def test_mechanisms(fig7, fig8):
    """Fig. 7: a fold quenches what doublings left; Fig. 8: a grazing onto an orbit that folds."""
    seven = {(t.source, t.target): t for t in read(fig7).transitions}
    assert seven["1:1", "2:1"].mechanism == 4
    assert seven["1:1", "2:1"].doubling_value == values(fig7, "1:1", "PD")[0]
    assert seven["1:1", "2:1"].fold_value == values(fig7, "2:1", "FB")[0]
    grazings = dict(seven["1:1", "2:1"].doubled_grazings)
    assert 0.6225 * max(grazings.values()) == pytest.approx(0.2274108, abs=1e-7)
    assert seven["2:1", "3:1"].mechanism == 2
    eight = {(t.source, t.target): t for t in read(fig8).transitions}
    assert eight["1:1", "2:1"].mechanism == 2
    assert eight["2:1", "2:2"].mechanism == 4


def test_a_stable_grazing_onto_a_stable_orbit():
    """At beta = pi/18, r = 0.1 the grazing of 1:1 is supercritical: mechanism 1."""
    diagram = follow(
        read_scene(
            scene_table(
                {"beta": "pi/18", "r": 0.1, "s": 0.45},
                name="m1",
                follow={"range": [0.2, 0.6], "switch": ["G"], "depth": 1},
                detect={"events": ["FB", "PD", "G"]},
            )
        )
    )
    grazing = next(e for e in diagram.entries if e.label == "G[1:1->2:1]")
    assert grazing.criticality == "supercritical"
    transition = next(t for t in read(diagram).transitions if t.entry == grazing.id)
    born = next(b for b in diagram.branches if b.origin == grazing.id)
    row = int(np.argmin(np.abs(born["s"] - grazing.value)))
    beside = [r for r in (row - 1, row + 1) if born.physical[r]]
    expected = 1 if born.stable[beside[0]] else None
    assert transition.mechanism == expected


def test_readings_print(fig7):
    text = str(read(fig7))
    assert "mechanism 4" in text
    assert text.count("stable") >= 5


def test_orbits_on_both_sides_of_a_pitchfork_are_stable_in_intervals_of_their_own():
    """Nothing says that a stated oscillator between two stops is symmetric: the branch that is born
    is followed both ways, to its orbits and their mirror images."""
    stated = {
        "name": "two stops",
        "model": {
            "system": "linear",
            "coordinates": ["x"],
            "mass": [1],
            "damping": ["c"],
            "stiffness": [[0]],
            "force": ["cos(1.7*t)"],
            "period": "2*pi/1.7",
            "parameters": {"c": 0.1, "sigma": 0.5, "r": 0.7},
            "guards": {
                "R": {"within": "x <= sigma", "restitution": "r"},
                "L": {"within": "x >= -sigma", "restitution": "r"},
            },
        },
        "follow": {"parameter": "sigma", "range": [0.2, 0.6], "orbits": ["RL"], "switch": ["BP"]},
        "detect": {"events": ["FB", "BP", "PD"]},
    }
    reading = read(diagram := follow(read_scene(stated)))
    (pitchfork,) = [e for e in diagram.entries if e.kind == "BP"]
    doublings = [e for e in diagram.entries if e.kind == "PD"]
    broken = [i for i in reading.stable if i.branch == pitchfork.opens[0]]
    assert [i.bounds for i in broken] == [(e.id, "born") for e in doublings]
    for interval, doubling in zip(broken, doublings, strict=True):
        assert (interval.low, interval.high) == (doubling.value, pytest.approx(pitchfork.value))
    (both,) = reading.bistable
    assert both.branches == (pitchfork.opens[0],) * 2
    declared = {e.kind: e.value for e in load_diagram(BRANCHES / "two_stops").entries}
    assert both.low == pytest.approx(declared["PD"], abs=1e-13)
    assert both.high == pytest.approx(declared["BP"], abs=1e-13)


def test_bistability_that_differs_by_rounding_is_told_once():
    """Mirrored stretches of one branch end at the same values, to the last digits at best."""
    bounds = ("FB", "PD")
    ends = [(0.9, 1.1), (0.9 * (1.0 + 1e-15), 1.1), (0.9, 1.0)]
    stable = [Interval("b2", "1:1", *pair, bounds) for pair in ends]
    stable.append(Interval("b3", "2:2", 0.8, 0.95, bounds))
    member = {"b2": (), "b3": ()}
    both = [b for b in _bistable(stable, member) if b.branches == ("b2", "b3")]
    assert [(b.low, b.high) for b in both] == [(0.9, 0.95)]
