"""Competition regions as areas: what they say against runs of their own, and their polygons."""

from __future__ import annotations

import dataclasses
import itertools
import json
import math

import numpy as np
import pytest
from zoo import scene

import contimpact as ci
from contimpact.diagrams.areas import runs_agree, stable_branches, stretches, unique_stretches
from contimpact.diagrams.arrangement import Frame, slabs
from contimpact.diagrams.explore import follow
from contimpact.results.catalogue import catalogue_text, load_diagram, write_diagram
from contimpact.results.curve import StableOrbit
from contimpact.segments.kernels import Kernels

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

A, R = (6.4, 9.4), (0.25, 0.36)
CROSSING = 0.304161346
"""r of PD-G at beta = pi/6, s = 0.5 m."""


def around_the_crossing(**curves):
    """1:1 around the crossing of PD and grazing in Fig. 6(b)."""
    return scene(
        model={
            "system": "impact-pair",
            "parameters": {"beta": math.pi / 6, "r": 0.3, "A": 7.0, "s": 0.5},
        },
        follow={"parameter": "A", "range": list(A), "orbits": ["1:1"], "switch": []},
        detect={"events": ["FB", "PD", "G"]},
        curves={
            "parameter": "r",
            "range": list(R),
            "start": [0.34],
            "areas": True,
            "max_step": 0.02,
            **curves,
        },
        numerics={"starts": 16},
    )


@pytest.fixture(scope="module")
def diagram():
    return follow(around_the_crossing())


def ends(area):
    return [orbit.ends for orbit in area.orbits]


@pytest.mark.full
def test_the_rectangle_is_divided_by_what_ends_the_orbit(diagram):
    assert sum(area.part for area in diagram.areas) == pytest.approx(1.0, abs=1e-12)
    assert sorted(map(ends, diagram.areas)) == [[], ["G[1:1->2:1]"], ["PD"]]
    assert all(area.checked == len(area.places) for area in diagram.areas)
    assert not any(area.doubtful or area.bistable for area in diagram.areas)
    assert all(area.departure < 1e-7 for area in diagram.areas)
    assert [n for n in diagram.statistics["notes"] if "curves.cover" not in n] == []


@pytest.mark.full
def test_borders_are_the_curves(diagram):
    """PD on the right of the crossing and G on its left; above it a line parts what is below."""
    kinds, lines = {curve.id: curve.kind for curve in diagram.curves}, 0
    for area in diagram.areas:
        (ring,), (borders,) = area.polygon, area.borders
        named = [kinds.get(name, name) for _, name in borders]
        wanted = {"PD": ["PD", "side", "line"], "G[1:1->2:1]": ["G", "line", "side"]}
        assert sorted(named) == sorted(wanted.get("".join(ends(area)), ["PD", "side", "G"]))
        assert ring[0] == ring[-1]
        if "line" in named:
            lines += 1
            start = borders[named.index("line")][0]
            assert [ring[start + k][0] for k in (0, 1)] == pytest.approx([CROSSING] * 2, abs=1e-8)
    assert lines == 2


@pytest.mark.full
def test_mechanisms(diagram):
    """Onto an unstable orbit that turns at a fold: the second; after a doubling: the last two."""
    shown = {tuple(ends(area)): area.orbits for area in diagram.areas}
    (grazing,), (doubling,) = shown["G[1:1->2:1]",], shown["PD",]
    assert (grazing.criticality, grazing.mechanisms) == ("subcritical", [2])
    assert doubling.criticality == "supercritical"
    assert {*doubling.mechanisms} <= {3, 4}
    assert doubling.mechanisms


def first_end(model, A_start):
    """What ends the stable orbit at a place, by walking to larger A alone, that is to smaller d."""
    for orbit in ci.find_orbits(model.replace(A=A_start), "1:1", parameter="A", starts=16):
        if orbit.stable and orbit.physical:
            branch = ci.continue_orbit(orbit, range=(A_start, A[1]), events=["FB", "PD", "G"])
            real = [e for e in branch.events if not e.ghost]
            return min(real, key=lambda e: e.value).label
    return None


def places(diagram, number, near=None, seed=3):
    """Random places in the unit square with their distance from the nearest border, upright; with
    `near` not farther from one than that."""
    frame = Frame.of(around_the_crossing(), diagram.curves)
    cut = slabs([frame.path(curve) for curve in diagram.curves])
    rng = np.random.default_rng(seed)
    while number:
        x, y = rng.uniform(0.0, 1.0, 2).tolist()
        slab = next(slab for slab in cut if slab.left <= x <= slab.right)
        heights = slab.heights(x)
        if near is not None:
            border = rng.choice(heights[1:-1]) if len(heights) > 2 else 0.0
            y = min(max(float(border + rng.choice((-1.0, 1.0)) * rng.uniform(0.0, near)), 0.0), 1.0)
        away = min([abs(y - heights).min(), x - slab.left, slab.right - x])
        if away > 1e-6:
            number -= 1
            yield frame.at(x, y)


def disagreeing(diagram, *about):
    """The places at which a run says something else than the polygon there."""
    model = around_the_crossing().model
    found = []
    for r, d in places(diagram, *about):
        value = 1.55625 / d
        (area,) = [area for area in diagram.areas if area.holds(r, d)]
        if ends(area) != [end for end in [first_end(model.replace(r=r), value)] if end]:
            found.append((r, d, ends(area)))
    return found


@pytest.mark.full
def test_random_runs_agree(diagram):
    assert not disagreeing(diagram, 20)


@pytest.mark.full
def test_runs_next_to_borders_agree(diagram):
    """As near as a millionth of the rectangle's side."""
    assert not disagreeing(diagram, 6, 1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("near", [None, 1e-3, 1e-4, 1e-5])
def test_two_thousand_runs_agree(diagram, near):
    assert not disagreeing(diagram, 500, near, 4)


@pytest.mark.parametrize("kind", ["PD", "G"])
@pytest.mark.full
def test_sides_of_polygons_keep_to_curves(diagram, kind):
    """The middle of every side, on the curve that is followed anew through its value of r."""
    (curve,) = (c for c in diagram.curves if c.kind == kind)
    entry = next(e for e in diagram.entries if e.id == curve.origin)
    sides = []
    for area in diagram.areas:
        ring = np.array(area.polygon[0])
        starts = [*area.borders[0], (len(ring) - 1, "")]
        for (first, name), (last, _) in itertools.pairwise(starts):
            if name == curve.id:
                sides += list(0.5 * (ring[first:last] + ring[first + 1 : last + 1]))
    sides = sides[:: max(1, len(sides) // 40)]
    model = around_the_crossing().model
    anew = ci.follow_curve(
        entry, model, "r", A, R, values=sorted(float(r) for r, _ in sides), detect=False
    )
    high = np.ptp([1.55625 / value for value in A])
    for r, d in sides:
        row = int(np.argmin(np.abs(anew["r"] - r)))
        assert anew["r"][row] == pytest.approx(r, abs=1e-12)
        assert abs(anew["d"][row] - d) < 2e-6 * high


@pytest.mark.full
def test_what_is_on_no_curve_is_said():
    """Without the curve of grazings runs meet an end that is no border."""
    told = follow(around_the_crossing(kinds=["PD"]))
    assert any("ends at G[1:1->2:1] on no curve" in note for note in told.statistics["notes"])
    doubts = [doubt for area in told.areas for doubt in area.doubtful]
    assert {"1:1 ends at G[1:1->2:1] on no curve"} <= {doubt.says for doubt in doubts}
    assert any(area.checked < len(area.places) for area in told.areas)
    assert "a run says otherwise" in "".join(map(str, told.areas))


@pytest.mark.full
def test_the_catalogue(diagram, tmp_path):
    records = json.loads(catalogue_text(diagram))["areas"]
    assert [record["id"] for record in records] == ["a1", "a2", "a3"]
    for record in records:
        for ring in record["polygon"]:
            assert all(R[0] <= x <= R[1] and 0.16 < d < 0.25 for x, d in ring)
            x, d = np.array(ring).T
            assert np.sum(x[:-1] * d[1:] - x[1:] * d[:-1]) > 0.0  # counter-clockwise
    write_diagram(diagram, tmp_path)
    assert load_diagram(tmp_path) == diagram


@pytest.mark.full
def test_a_scene_without_areas_has_none():
    given = around_the_crossing(areas=False)
    assert given.resolved()["curves"]["areas"] is False
    assert not follow(given).areas


@pytest.mark.full
def test_an_orbit_found_twice_is_one(diagram):
    """Its branch followed from two starts, as happens next to a fold."""
    given = around_the_crossing()
    kernels, frame = Kernels(given.model, "A"), Frame.of(given, diagram.curves)
    (word,) = given.orbits
    branches = [stable_branches(given, given.model, word, kernels, [a])[0] for a in (6.6, 6.9)]
    found = [stretch for branch in branches for stretch in stretches(branch, frame)]
    assert len(found) == 2
    assert len(unique_stretches(found)) == 1
    other = dataclasses.replace(found[1], low=found[1].low + 1e-3)
    assert len(unique_stretches([found[0], other])) == 2


def test_what_is_not_told_is_no_disagreement():
    """The criticality next to where it changes; what ends the orbit is told always."""
    told = StableOrbit("BT", 1, "1:1", "PD", "PD", "supercritical")
    unknown = dataclasses.replace(told, criticality=None)
    assert runs_agree([told], [unknown])
    assert runs_agree([unknown], [told])
    assert not runs_agree([told], [dataclasses.replace(told, criticality="subcritical")])
    assert not runs_agree([told], [dataclasses.replace(unknown, ends="G")])
    assert not runs_agree([told], [told, told])
