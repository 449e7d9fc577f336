"""The scenes that come with the package: each is valid, runs, and gives the values it is cited for.

The critical values of Figs. 7 and 8 stand below to eleven digits; they were computed once with
methods of their own, apart from this package.
"""

from __future__ import annotations

import csv
import dataclasses
import functools
import importlib.util
import json
import math
from collections import Counter

import numpy as np
import pytest
from differences import differences, table, text_of
from reordered import Judge
from zoo import ROOT

from contimpact import follow, load_diagram, load_entries, load_scene, read, write_diagram
from contimpact.continuation.branch import EndKind

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

FOLDER = ROOT / "branches"
NAMES = sorted(path.parent.name for path in FOLDER.glob("*/scene.toml"))
SIMULATED = [name for name in NAMES if (FOLDER / name / "simulation").is_dir()]
MAPS = [name for name in NAMES if name.startswith("fig6")]
"""Scenes with curves."""

INTEGRATED = [name for name in NAMES if name in ("duffing", "pendulum", "belt_free")]
"""Scenes whose flights are integrated."""

QUICK = ["fig7", "stop"]
"""One scene of the pair and one of the oscillator: about a second each."""

FOLLOWED = [*QUICK, "fig3a", "fig3b", "fig3c", "fig3d", "fig8"]
"""Scenes that are followed here. Of the others, what is committed is read, which
test_same_results makes again."""

TO_A_POLE = {"belt_free": "b1"}
"""Branches whose unphysical slip comes to a pole of the friction law, and ends where rounding is
amplified to 1e-9: at the same point on every processor."""


def case(name, *others):
    """A scene as a case of a test, and its tier."""
    marks = []
    if name not in QUICK:
        marks.append(pytest.mark.full)
    if name in INTEGRATED:
        lacking = importlib.util.find_spec("heyoka") is None
        marks.append(pytest.mark.skipif(lacking, reason="needs contimpact[ode]"))
    return pytest.param(name, *others, marks=marks)


EVERY = [case(name) for name in NAMES]
EACH_SIMULATED = [case(name) for name in SIMULATED]

DAMPING = {
    "oscillator": lambda p: p["c"],
    "soft-stop": lambda p: p["c"],
    "belt": lambda p: p["c"],
    "two-stops": lambda p: p["c"],
    "two-masses": lambda p: (p["c1"] + p["c2"]) / p["m1"] + p["c2"] / p["m2"],
    "coupled-by-impact": lambda p: p["c1"] / p["m1"] + p["c2"] / p["m2"],
    "impact-damper": lambda p: 2.0 * p["zeta"],
    "duffing": lambda p: p["c"],
    "pendulum": lambda p: p["c"],
    "dry_friction": lambda p: 2.0 * p["zeta"],
    "impact_duffing": lambda p: 2.0 * p["zeta"] + 2.0 * p["xi"] * (1.0 + p["mu"]),
}
"""How fast flights contract volumes, where they do, by system or scene."""

LOSING = ("coco_bang_bang", "coco_piecewise", "coco_stick_slip", "soft_pair_friction")
"""Scenes whose modes or resets take a direction, so that a multiplier is zero exactly."""

BRACKETED = {"soft_pair_friction": 1e-8}
"""Scenes of which two events are bracketed, and how large estimates of their errors are: from the
exported orbit Newton's method moves the PD by 1e-12."""

FIG_7 = {
    ("1:1", "PD"): 0.23850682149,
    ("1:1", "~G[1:1->2:1]"): 0.20445492649,
    ("2:1", "FB"): 0.22216730993,
    ("2:1", "G[2:1->3:1]"): 0.17369915135,
    ("2:1", "~PD"): 0.14022934446,
}
FIG_8 = {
    ("1:1", "G[1:1->2:1]"): 0.21377314088,
    ("1:1", "~PD"): 0.19453108003,
    ("2:1", "FB"): 0.22172669232,
    ("2:1", "PD"): 0.12742085846,
    ("2:1", "~G[2:1->2:2]"): 0.11477162872,
}
"""Values of d by the orbit's count and the event's label."""

FIGURES = [case("fig7", FIG_7), case("fig8", FIG_8)]

SECOND_FOLD = 10.2813
"""Where the second family of 2:1 orbits of Fig. 8 turns, in A."""


@functools.cache
def scene(name):
    return load_scene(FOLDER / name / "scene.toml")


@functools.cache
def diagram(name):
    return follow(scene(name)) if name in FOLLOWED else load_diagram(FOLDER / name)


@functools.cache
def without_survey(name):
    return follow(dataclasses.replace(scene(name), survey=False))


def test_the_scenes_of_the_figures_are_there():
    assert {"fig3a", "fig3b", "fig3c", "fig3d", "fig7", "fig8", "stop"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_scene_is_valid_and_named_like_its_folder(name):
    assert scene(name).name == name
    assert scene(name).source
    assert scene(name).plot.formats


@pytest.mark.parametrize("name", EVERY)
def test_scene_runs(name):
    asked, result = scene(name), diagram(name)
    assert result.name == name
    assert len(result.branches) >= 1
    for word in asked.orbits:
        assert any(branch.word in word.walls * 2 for branch in result.branches)
    for branch in result.branches:
        assert branch.parameter == asked.parameter
        values = branch[asked.parameter]
        assert asked.range[0] <= values.min() <= values.max() <= asked.range[1]


@pytest.mark.parametrize("name", EVERY)
def test_branches_end_for_a_reason_of_the_scene(name):
    """Nothing stops early: not the corrector, not the step, not the limit of points."""
    good = {EndKind.RANGE, EndKind.CLOSED, EndKind.KNOWN, EndKind.BORN, EndKind.REST}
    if not scene(name).unphysical:
        good |= {EndKind.UNPHYSICAL}
    for branch in diagram(name).branches:
        at_pole = TO_A_POLE.get(name) == branch.id
        for end, row in zip(branch.ends, (0, -1), strict=True):
            excused = at_pole and not branch.physical[row] and end.kind is EndKind.ROUNDING
            assert excused or end.kind in good
        assert list(branch.missed) == []


@pytest.mark.parametrize("name", EVERY)
def test_points_solve_the_equations_once(name):
    for branch in diagram(name).branches:
        assert np.all(np.diff(branch["arclength"]) > 0.0)
        at_pole = ~branch.physical if TO_A_POLE.get(name) == branch.id else np.array(False)
        large = branch["residual"] >= np.where(at_pole, 1e-7, 1e-11)
        for row in np.flatnonzero(large).tolist():  # where motion is, too
            orbit = branch.orbit(row)
            sizes = orbit.problem.residual_sizes(orbit.problem.scale(orbit.unknowns, 1.0))
            assert branch["residual"][row] < 1e-11 * np.min(sizes)
        assert np.all(np.isfinite(branch.velocities))
        assert np.all(np.isfinite(branch.times))


def impact_factor(name, branch, impact, wall):
    """How an impact contracts volumes; where dry friction turns, by the accelerations."""
    if name == "dry_friction":
        before = branch.velocities[:, impact]
        before = np.where(np.abs(before) > 1e-9, before, np.nan)  # at a T it is rounding
        return (before + {"C": 2.0, "D": -2.0}.get(wall, -before)) / before
    r = "r" if "r" in branch.columns else f"r_{wall}"
    return branch[r] ** 2 if r in branch.columns else 1.0


def contact_damping(branch):
    """How fast contacts contract volumes."""
    if branch.system == "soft-stop":
        return branch["c_b"]
    r, k, m, M, omega = (branch[n] for n in ("r", "k", "m", "M", "omega"))
    zeta = -np.log(r) / np.hypot(math.pi, np.log(r))
    return 2.0 * zeta * np.sqrt(k * (1.0 / m + 1.0 / M)) * math.pi / omega


@pytest.mark.parametrize("name", EVERY)
def test_multipliers_have_the_product_of_the_impacts(name):
    """Each impact contracts volumes by r^2, each unit of time by damping, of contact by c_b; a body
    that sticks loses a direction."""
    for branch in diagram(name).branches:
        if branch.system == "belt" and not branch.word and branch["delta"][0] > 0.0:
            continue  # weakening friction's part is integrated in tests/orbits/test_free_period.py
        product = np.ones(len(branch))
        soft = branch.system in ("soft-stop", "soft-pair") and name not in LOSING
        lost = soft or name in LOSING or branch.system == "belt"
        for k, wall in enumerate("" if lost else branch.word):
            product = product * impact_factor(name, branch, k, wall)
        if soft:
            assert set(branch.word[::2]) <= set("CBT")
            contact = np.sum(branch.times[:, 1::2] - branch.times[:, ::2], axis=1)
            product = product * np.exp(-contact_damping(branch) * contact)
        if name in LOSING or (branch.system == "belt" and branch.word):
            product = np.zeros(len(branch))
        damping = DAMPING.get(branch.system) or DAMPING.get(name)
        if damping:
            omega = branch["Omega"] if "Omega" in branch.columns else branch["omega"]
            time = branch.period * 2.0 * math.pi / omega
            product = product * np.exp(-damping(branch) * time)
        multipliers = branch.multipliers
        finite = np.all(np.isfinite(multipliers), axis=1) & np.isfinite(product)
        largest = np.max(np.abs(multipliers[finite]), axis=1)
        found = np.prod(multipliers[finite], axis=1)
        assert np.mean(finite) > 0.9
        assert np.all(np.abs(found - product[finite]) <= 1e-10 * np.maximum(largest, 1.0))


@pytest.mark.parametrize("name", EVERY)
def test_columns_agree_with_the_multipliers(name):
    for branch in diagram(name).branches:
        sizes = np.abs(branch.multipliers)
        clear = np.all(np.abs(sizes - 1.0) > 1e-6, axis=1)
        clear &= branch["event"] == ""  # an event's row leaves the event itself out
        assert np.array_equal(branch["n_unstable"][clear], np.sum(sizes[clear] > 1.0, axis=1))
        assert np.array_equal(branch["physical"] == 1, branch["reason"] == "")


@pytest.mark.parametrize("name", EVERY)
def test_events_are_located_to_rounding(name):
    asked, result = scene(name), diagram(name)
    entries = result.entries
    assert len({entry.id for entry in entries}) == len(entries)
    for entry in entries:
        assert entry.kind in asked.events
        assert entry.residual < 1e-12
        assert entry.error < BRACKETED.get(name, 1e-10) * max(1.0, abs(entry.value))
        bracketed = entry.kind == "NS" or (name in BRACKETED and entry.kind in ("PD", "G"))
        assert entry.method == "newton" or (bracketed and entry.method == "bracket")
        assert asked.range[0] <= entry.value <= asked.range[1]
        assert entry.ghost == (not entry.stable or not entry.physical)
        assert entry.label.startswith("~") == (entry.ghost and entry.kind != "UZ")


@pytest.mark.parametrize("name", EVERY)
def test_events_are_rows_of_their_branch_between_points(name):
    for branch in diagram(name).branches:
        rows = {str(entry): k for k, entry in enumerate(branch["event"]) if entry}
        lengths = [entry.arclength for entry in branch.events]
        assert lengths == sorted(lengths)
        for entry in branch.events:
            if entry.id in rows:
                k = rows[entry.id]
                # the row of a point on which the event lies is the point's own
                assert abs(branch[branch.parameter][k] - entry.value) <= entry.error
                assert branch["arclength"][k] == entry.arclength


@pytest.mark.parametrize("name", EVERY)
def test_no_event_is_found_twice(name):
    """Twice on one branch with the same orbit at the same value would be one zero counted twice,
    but where two of its impacts come to rest at once."""
    for branch in diagram(name).branches:
        seen = Counter()
        for entry in branch.events:
            speeds = sorted(round(impact["velocity"], 7) for impact in entry.impacts)
            place = entry.flight, entry.wall  # symmetric orbits touch both walls at once
            # orbits that are each other's mirror image may lie on one branch
            where = [round(x, 6) for impact in entry.impacts for x in impact.get("positions", ())]
            orbit = (*speeds, *where)
            key = (entry.kind, entry.label, round(entry.value, 9), orbit, place)
            seen[key] += 1
            assert seen[key] <= max(1, speeds.count(0.0) if entry.kind == "V" else 1), key


@pytest.mark.parametrize(("name", "values"), FIGURES)
@pytest.mark.full
def test_critical_values_of_the_figures(name, values):
    """All of them, with their labels, and on the simple orbits nothing else within the figure."""
    low, high = scene(name).plot.xlim
    found = {
        (entry.notation, entry.label): entry.parameters["d"]
        for entry in without_survey(name).entries
        if entry.notation in ("1:1", "2:1") and low <= entry.parameters["d"] <= high
    }
    assert found.keys() == values.keys()
    assert found == pytest.approx(values, rel=0.0, abs=2e-11)


@pytest.mark.parametrize(("name", "values"), FIGURES)
@pytest.mark.parametrize("max_step", [0.1, 0.02, 0.005])
@pytest.mark.quick(1)
def test_critical_values_do_not_depend_on_the_step(name, values, max_step):
    """Long steps neither jump to another branch nor miss an event."""
    asked = scene(name)
    step = min(asked.settings.step, max_step)
    settings = dataclasses.replace(asked.settings, step=step, max_step=max_step)
    asked = dataclasses.replace(asked, settings=settings, depth=1, survey=False)
    found = follow(asked).entries
    for (notation, label), d in values.items():
        here = [e.parameters["d"] for e in found if (e.notation, e.label) == (notation, label)]
        assert min(np.abs(np.array(here) - d), default=math.inf) < 2e-11, (notation, label)


@pytest.mark.full
def test_the_survey_of_fig8_finds_the_second_family():
    """And adds to what follows from the 1:1 orbit, of which it changes nothing."""
    found, plain = diagram("fig8"), without_survey("fig8")
    same = [(e.id, e.label, e.value) for e in found.entries[: len(plain.entries)]]
    assert same == [(e.id, e.label, e.value) for e in plain.entries]
    folds = [e for e in found.entries if (e.notation, e.kind) == ("2:1", "FB")]
    second = min(folds, key=lambda e: abs(e.value - SECOND_FOLD))
    assert abs(second.value - SECOND_FOLD) < 5e-5
    branch = found[second.branch]
    seen = branch.physical & (branch["event"] == "")
    assert np.all(branch["n_unstable"][seen] > 0)
    assert 10.30 < branch["A"][seen].min() < branch["A"][seen].max() < 10.63
    assert any("survey ended" in note for note in found.statistics["notes"])


MECHANISMS = {
    "fig3a": {("1:1", "2:1"): 3},
    "fig3b": {("1:1", "2:1"): 4, ("2:1", "3:1"): 2},
    "fig3c": {("1:1", "2:1"): 4, ("2:1", "3:1"): 4},
    "fig3d": {("1:1", "2:1"): 4, ("2:1", "3:1"): 3},
    "fig7": {("1:1", "2:1"): 4, ("2:1", "3:1"): 2},
    "fig8": {("1:1", "2:1"): 2, ("2:1", "2:2"): 4},
}
"""Decided by the order of the exact values; the page on results compares them with the paper."""


@pytest.mark.parametrize("name", [*map(case, MECHANISMS)])
def test_mechanisms_of_the_figures(name):
    found = {(t.source, t.target): t.mechanism for t in read(diagram(name)).transitions}
    assert found.items() >= MECHANISMS[name].items()


def test_grazing_of_the_oscillator():
    """The steady response, of amplitude a/(c omega) at resonance, touches the stop at a = 0.1."""
    grazing = [entry for entry in diagram("stop").entries if entry.kind == "V"]
    assert grazing
    for entry in grazing:
        assert entry.parameters["a"] == pytest.approx(0.1, rel=1e-12)
        assert entry.impacts[0]["velocity"] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.full
def test_grazings_of_the_stiff_oscillator():
    """The steady response first touches the stop at its amplitude; each next one adds an impact.

    Nothing of an impact is left when the next one comes: the amplitude goes with the square of the
    new velocity, by which the response passes the stop.
    """
    found = diagram("stiff")
    touches = {entry.label: entry.value for entry in found.entries if entry.kind == "G"}
    assert touches["G[0->1]"] == pytest.approx(0.3 * abs(1e4 - 1 + 100j), rel=1e-13)
    entries = [entry for entry in found.entries if entry.kind == "G"]
    assert {(entry.criticality, entry.slope) for entry in entries} == {("supercritical", None)}
    grazings = [t for t in read(found).transitions if t.mechanism == 1]
    assert {(int(t.source), int(t.target)) for t in grazings} >= {(0, 1), (1, 2), (2, 3)}


@pytest.mark.parametrize("name", EVERY)
def test_requested_values_are_hit_exactly(name):
    wanted = scene(name).values
    found = [entry for entry in diagram(name).entries if entry.kind == "UZ"]
    assert bool(found) == bool(wanted)
    for entry in found:
        ((parameter, value),) = entry.requested.items()
        assert value in wanted[parameter]
        reached = entry.parameters | {"period": entry.orbit_period}
        assert reached[parameter] == pytest.approx(value, rel=4e-16)


@pytest.mark.parametrize("name", list(map(case, FOLLOWED)))
def test_exported_events_agree_with_a_fresh_run(name, tmp_path):
    """To their stated errors; arclength also depends on where the points lie."""
    write_diagram(diagram(name), tmp_path)
    old, new = table(FOLDER / name / "events.csv"), table(tmp_path / "events.csv")
    found = [one for one in differences("events.csv", old, new) if one.name != "arclength"]
    assert Judge({}).refused("events.csv", found, old, new) == []


@pytest.mark.parametrize("name", EACH_SIMULATED)
def test_exported_simulations_are_of_the_exported_branches(name):
    """What explains a transition is an event of the scene, attractors lie on its branches; no file
    is large."""
    events = {entry.id: entry for entry in diagram(name).entries}
    folder, options = FOLDER / name / "simulation", scene(name).simulate
    matches = json.loads(text_of(folder / "coverage.json"))["matches"]
    assert matches
    assert {match["branch"] for match in matches} <= {b.id for b in diagram(name).branches}
    told = []
    if options.transitions:
        text = text_of(folder / "transitions.json")
        told = [e for t in json.loads(text)["transitions"] for e in t["explanations"]]
        assert told
    for explanation in told:
        entry = events[explanation["entry"]]
        assert explanation["label"] == entry.label
        assert explanation["value"] == pytest.approx(entry.value, rel=1e-10)
    head, *rows = text_of(folder / "sweep.csv").splitlines()
    assert json.loads(head.removeprefix("# "))["parameter"] == scene(name).parameter
    directions = {row["direction"] for row in csv.DictReader(rows)}
    asked = options.direction
    assert directions == ({"up", "down"} if asked == "both" else {asked})
    assert all(path.stat().st_size < 600 * 1024 for path in folder.iterdir())


def test_every_scene_with_a_simulation_has_it_exported():
    assert [name for name in NAMES if scene(name).simulate is not None] == SIMULATED


@pytest.mark.parametrize("name", [*(name for name in NAMES if name not in MAPS), *MAPS])
@pytest.mark.quick(len(NAMES) - len(MAPS))
def test_branch_tables_and_the_catalogue_hold_the_same_entries(name):
    """Each is read without the other."""
    told = {entry.id: entry for entry in load_entries(FOLDER / name)}
    for entry in load_diagram(FOLDER / name).entries:
        same = told[entry.id]
        assert (entry.kind, entry.label, entry.value) == (same.kind, same.label, same.value)
        assert entry.scenario == same.scenario
