"""The status of every stretch of a branch, also between adjacent events."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from zoo import ROOT

import contimpact as ci
from contimpact.bifurcations.declarations import EVENTS
from contimpact.continuation.corrector import correct
from contimpact.continuation.settings import Settings
from contimpact.diagrams.explore import follow
from contimpact.page.data import PageView, page_data
from contimpact.plots.lines import STYLES, runs
from contimpact.results.branch import STATUS, UNKNOWN
from contimpact.results.diagram import Diagram
from contimpact.results.diagram_reading import read, stable_intervals, unknown_intervals
from contimpact.results.scene import load_scene
from contimpact.systems.impact_pair import ImpactPair

TIERS = {"fig3a": pytest.mark.full, "fig7": pytest.mark.full, "stop": (), "bouncing_ball": ()}
"""Marks of scenes that are not slow."""

SCENES = sorted(path.parent.name for path in (ROOT / "branches").glob("*/scene.toml"))


def pair(s):
    return ImpactPair(beta=math.pi / 5, r_B=0.6, r_T=0.4, A=6.0, s=s)


@pytest.fixture(scope="module")
def three():
    """1:3 orbits whose doubling and fold lie between neighbouring points."""
    (orbit,) = (o for o in ci.find_orbits(pair(0.33615), "1:3", parameter="s") if o.stable)
    return ci.continue_orbit(orbit, "s", (0.1, 1.05))


def orbit_between(branch, row, model=None):
    """An orbit solved in the middle of two rows; None where none is reached."""
    ends = [branch.orbit(k, model) for k in (row, row + 1)]
    problem, (one, other) = ends[0].problem, (end.unknowns for end in ends)
    scale = problem.scale(one, float(np.ptp(branch[branch.parameter])) or 1.0)
    way = other - one
    found = correct(problem, 0.5 * (one + other), way / scale**2, scale, Settings()).evaluation
    if found is None:
        return None
    off = (found.unknowns - 0.5 * (one + other)) / scale
    return found if np.linalg.norm(off) < 0.5 * np.linalg.norm(way / scale) else None


def told(branch):
    """The pieces that events bound, and one in the middle of every run; those in which the status
    changes at no event say that it is unknown."""
    neither, length = branch.between, np.diff(branch["arclength"])
    rows = set(np.nonzero(neither[:-1] | neither[1:])[0].tolist())
    rows |= {(first + last) // 2 for first, last, _ in runs(branch)}
    known = branch.status != UNKNOWN
    return [k for k in sorted(rows) if k < len(length) and length[k] > 1e-8 and known[k]]


def check_pieces(diagram, model=None):
    """Every drawn stretch has the status of an orbit solved in its middle."""
    checked = 0
    for branch in diagram.branches:
        assert not unknown_intervals(branch)
        for row in told(branch):
            here = orbit_between(branch, row, model)
            if here is None:
                continue
            one = "stable" if here.n_unstable == 0 else "unstable"
            found = one if here.verdict.physical else "unphysical"
            assert STATUS[branch.status[row]] == found, (branch.id, row)
            checked += 1
    return checked


def of_all_kinds(name):
    scene = load_scene(ROOT / "branches" / name / "scene.toml")
    return dataclasses.replace(scene, events=tuple(dict.fromkeys((*scene.events, *EVENTS))))


# The pair whose orbits are stable between two adjacent events.


def test_a_stable_stretch_between_adjacent_events_is_read(three):
    """Ends as simulations and other arithmetic give them: PD, then FB."""
    (interval,) = stable_intervals(three)
    assert interval.low == pytest.approx(0.336119274, abs=1e-9)
    assert interval.high == pytest.approx(0.336181918, abs=1e-9)
    kinds = {entry.id: entry.kind for entry in three.events}
    assert [kinds[name] for name in interval.bounds] == ["PD", "FB"]
    assert "0.336119274 to 0.336181918" in str(Diagram("three", [three]).reading)


def test_it_is_drawn_so(three):
    (stable,) = (run for run in runs(three) if run[2] == "stable")
    values = three["s"][stable[0] : stable[1] + 1]
    assert sorted(values)[0] == pytest.approx(0.336119274, abs=1e-9)
    assert sorted(values)[-1] == pytest.approx(0.336181918, abs=1e-9)


def test_pictures_and_the_page_draw_one_status(three):
    from contimpact.plots.lines import pieces_of, series_by_branch

    diagram = Diagram("three", [three])
    series = series_by_branch(diagram, "velocity")
    drawn = {style for _, style, *_ in pieces_of(diagram, series, "s", None, {three.id})}
    assert drawn == {STATUS[k] for k in three.status} <= set(STYLES)
    (record,) = page_data(diagram, pair(0.3), PageView("s"))["branches"]
    import base64

    packed = record["status"]
    assert packed.startswith("u1")
    status = np.frombuffer(base64.b64decode(packed[3:]), "u1")
    assert np.array_equal(status[:-1], three.status)


def test_a_loaded_folder_says_the_same(three, tmp_path):
    ci.save(three, tmp_path / "b1.csv")
    loaded = ci.load(tmp_path / "b1.csv")
    assert np.array_equal(loaded.status, three.status)
    assert stable_intervals(loaded) == stable_intervals(three)


def test_multipliers_around_an_event_are_those_before_the_next(three):
    """Not those beyond a fold next to it: a doubling loses stability on one side alone."""
    doubling = next(e for e in three.events if e.kind == "PD" and abs(e.value - 0.3361193) < 1e-6)
    sides = (doubling.multipliers_before, doubling.multipliers_after)
    largest = sorted(max(abs(complex(*m)) for m in side) for side in sides)
    assert largest[0] < 1.0 < largest[1]


def earlier(branch):
    """The branch as earlier versions kept it: without rows between adjacent events."""
    neither = branch.between
    alone = np.zeros(len(branch), dtype=bool)
    alone[1:-1] = neither[:-2] & neither[2:] & ~neither[1:-1]
    columns = {name: column[~alone] for name, column in branch.columns.items()}
    return dataclasses.replace(branch, columns=columns)


def test_files_without_the_orbit_between_say_that_its_status_is_unknown(three):
    old = earlier(three)
    assert len(old) < len(three)
    unknown = unknown_intervals(old)
    assert any(i.low == pytest.approx(0.336119274, abs=1e-9) for i in unknown)
    assert "unknown" in {style for *_, style in runs(old)}
    assert stable_intervals(old) == []
    text = str(read(Diagram("old", [old])))
    assert "no orbit between these events is recorded; run the scene again" in text
    (remark, *_) = page_data(Diagram("old", [old]), pair(0.3), PageView("s"))["shown"]["remarks"]
    assert remark.startswith("unknown")
    assert unknown_intervals(three) == []


# Shipped scenes.


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=TIERS.get(n, pytest.mark.slow)) for n in SCENES]
)
def test_every_drawn_stretch_has_the_status_of_an_orbit_in_its_middle(name):
    scene = of_all_kinds(name)
    assert check_pieces(follow(scene), scene.model) > 0


@pytest.fixture(scope="module")
def fig3a():
    return follow(load_scene(ROOT / "branches" / "fig3a" / "scene.toml"))


def test_a_status_that_changes_at_no_event_is_unknown_between_its_rows(fig3a):
    """V is not among the events of fig3a: only the rows tell where orbits turn unphysical there."""
    model, found = load_scene(ROOT / "branches" / "fig3a" / "scene.toml").model, 0
    for branch in fig3a.branches:
        for row in np.nonzero(branch.status == UNKNOWN)[0].tolist():
            sides = [branch.orbit(k, model) for k in (row, row + 1)]
            assert not branch.between[row : row + 2].any()
            assert len({(o.stable, o.physical) for o in sides}) == 2
            found += 1
    assert found
    assert fig3a.reading.unknown == []


def test_fig3a_is_unstable_between_its_ghost_grazing_and_its_doubling(fig3a):
    """The region which that figure is about: d from 0.20516 to 0.20644."""
    branch = fig3a.branches[0]
    for row in np.nonzero((branch["d"][:-1] > 0.2051) & (branch["d"][1:] < 0.2065))[0]:
        middle = 0.5 * (branch["d"][row] + branch["d"][row + 1])
        if 0.20517 < middle < 0.20643:
            assert STATUS[branch.status[row]] == "unstable"
