"""Branches born at events: starts, directions, and the whole of Figs. 7 and 8."""

from __future__ import annotations

import importlib.util
import itertools
import math

import numpy as np
import pytest
from zoo import scene

from contimpact.bifurcations.grazing import touches_at
from contimpact.bifurcations.kind import switch
from contimpact.bifurcations.kind import test_functions as functions
from contimpact.continuation.settings import Settings
from contimpact.diagrams.explore import follow
from contimpact.diagrams.orbit_branch import continue_born, continue_orbit
from contimpact.diagrams.orbit_walks import walk_both_ways, walk_orbits
from contimpact.errors import InputError
from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import find_orbits, orbit_at
from contimpact.results.branch import Branch
from contimpact.results.scene import read_scene
from contimpact.segments.kernels import Kernels
from contimpact.systems.impact_pair import ImpactPair


@pytest.fixture(scope="module")
def fig7():
    return follow(scene())


@pytest.fixture(scope="module")
def fig8():
    return follow(
        scene(
            model={"parameters": {"beta": "pi/6", "r": 0.25, "A": 7.2, "s": 0.5}},
            follow={"parameter": "A", "range": [1.4, 23.0]},
        )
    )


def find(diagram, label, branch_notation):
    found = [e for e in diagram.entries if e.label == label and e.notation == branch_notation]
    assert found, f"{label} on {branch_notation}"
    return found


@pytest.mark.parametrize(
    ("name", "label", "notation", "d"),
    [
        ("fig7", "PD", "1:1", 0.23850682149),
        ("fig7", "~G[1:1->2:1]", "1:1", 0.20445492649),
        ("fig7", "FB", "2:1", 0.22216730993),
        ("fig7", "G[2:1->3:1]", "2:1", 0.17369915135),
        ("fig7", "~PD", "2:1", 0.14022934446),
        ("fig8", "G[1:1->2:1]", "1:1", 0.21377314088),
        ("fig8", "~PD", "1:1", 0.19453108003),
        ("fig8", "FB", "2:1", 0.22172669232),
        ("fig8", "PD", "2:1", 0.12742085846),
        ("fig8", "~G[2:1->2:2]", "2:1", 0.11477162872),
    ],
)
@pytest.mark.full
def test_everything_follows_from_the_1_1_orbit(request, name, label, notation, d):
    values = [e.parameters["d"] for e in find(request.getfixturevalue(name), label, notation)]
    # the reference values have eleven digits
    assert min(abs(v - d) for v in values) < 1e-11


def test_the_doubled_branch_of_fig7_has_its_own_grazing(fig7):
    grazings = [e for e in fig7.entries if e.notation == "1:1/2T" and e.kind == "G"]
    real = [e for e in grazings if not e.ghost]
    assert [e.criticality for e in real] == ["supercritical"]
    # the onset of complex motion is seen in simulations at d = 0.227 or so
    assert real[0].parameters["d"] == pytest.approx(0.2274, abs=1e-4)


def test_fig8_reaches_the_2_2_branch(fig8):
    assert "2:2" in [b.notation for b in fig8.branches]


@pytest.mark.parametrize("name", ["fig7", "fig8"])
def test_branches_and_entries_know_each_other(name, request):
    diagram = request.getfixturevalue(name)
    entries = {e.id: e for e in diagram.entries}
    assert len(entries) == len(diagram.entries)
    for branch in diagram.branches[1:]:
        assert branch.id in entries[branch.origin].opens
        for meeting in branch.meetings:
            assert branch.id in entries[meeting].opens
    assert diagram.branches[0].origin is None


@pytest.mark.parametrize("name", ["fig7", "fig8"])
def test_new_branches_start_on_the_orbit_of_their_event(name, request):
    """Times and velocities of the parent are among those of the new branch, to 1e-10."""
    diagram = request.getfixturevalue(name)
    entries = {e.id: e for e in diagram.entries}
    for branch in diagram.branches[1:]:
        entry = entries[branch.origin]
        row = start_row(branch, entry)
        period = 2.0
        phases = branch.times[row] % (period * branch.period)
        for impact in entry.impacts:
            near = np.abs(branch.velocities[row] - impact["velocity"]) < 1e-10
            turn = np.abs((phases - impact["time"]) / period)
            assert np.any(near & (np.abs(turn - np.round(turn)) * period < 1e-10))
        assert abs(branch[branch.parameter][row] - entry.value) < 1e-10
        if entry.kind == "G":
            assert np.min(np.abs(branch.velocities[row])) < 1e-10
        steps = np.abs(np.diff(branch["arclength"]))[[max(row - 1, 0), min(row, len(branch) - 2)]]
        assert np.min(steps) <= 0.03 * 1.01


def start_row(branch: Branch, entry) -> int:
    speeds = np.sort([i["velocity"] for i in entry.impacts] * (branch.period // entry.period))
    if entry.kind == "G":
        speeds = np.sort(np.append(speeds, 0.0))
    return int(np.argmin(np.abs(np.sort(branch.velocities, axis=1) - speeds).max(axis=1)))


def test_grazing_branches_have_a_physical_and_an_unphysical_side(fig7):
    looked_at = []
    for branch in fig7.branches:
        entry = next((e for e in fig7.entries if e.id == branch.origin), None)
        if entry is None or entry.kind != "G" or not entry.physical:
            continue
        row = start_row(branch, entry)
        sides = {bool(branch.physical[row - 1]), bool(branch.physical[row + 1])}
        assert sides == {True, False}
        looked_at.append(entry.label)
    assert len(looked_at) >= 3
    assert "G[2:1->3:1]" in looked_at


def test_no_branch_is_followed_twice(fig7):
    """Rotations of words, shifted times: no two branches share an orbit."""
    seen = {}
    for branch in fig7.branches:
        key = min(branch.word[i:] + branch.word[:i] for i in range(len(branch.word)))
        middle = len(branch) // 2
        here = (
            round(float(branch["s"][middle]), 9),
            tuple(sorted(branch.velocities[middle].round(7))),
        )
        assert here not in seen.get(key, set())
        seen.setdefault(key, set()).add(here)


@pytest.mark.full
def test_a_zero_velocity_leads_back_to_the_grazing_branch():
    """The V of 2:1 is the G of 1:1: a meeting, with the same parameter value."""
    diagram = follow(
        scene(follow={"switch": ["G", "V"], "depth": 2}, detect={"events": ["FB", "PD", "G", "V"]})
    )
    grazing = find(diagram, "~G[1:1->2:1]", "1:1")[0]
    zeros = [
        e for e in diagram.entries if e.kind == "V" and e.notation == "2:1" and e.becomes == "BT"
    ]
    matching = [e for e in zeros if abs(e.value - grazing.value) < 1e-12]
    assert matching
    assert matching[0].label == "~V[2:1->1:1]"
    assert matching[0].ghost == grazing.ghost
    assert diagram.branches[0].id in matching[0].opens


def test_doubled_orbits_fall_back_onto_the_branch_they_came_from():
    """Followed in r at beta = pi/3, A = 3.89, 1:1 doubles twice: one bubble joins both events."""
    diagram = follow(
        scene(
            model={"parameters": {"beta": "pi/3", "r": 0.2, "A": 1.55625 / 0.4, "s": 0.5}},
            follow={"parameter": "r", "range": [0.05, 0.9], "switch": ["PD"], "depth": 1},
            detect={"events": ["FB", "PD"]},
        )
    )
    first, second = (e for e in diagram.branches[0].events if e.kind == "PD")
    assert first.criticality == second.criticality == "supercritical"
    assert first.opens == second.opens == ("b2",)
    bubble = diagram.branches[1]
    assert bubble.notation == "1:1/2T"
    assert bubble.ends[1].kind.name == "KNOWN"
    assert bubble.ends[1].value == pytest.approx(second.value, abs=1e-9)
    assert bubble.meetings == [second.id]


def test_symmetric_pair_pitchfork_is_followed_once():
    diagram = follow(
        scene(
            model={"parameters": {"beta": 0.0, "r": 0.3, "A": 5.0, "s": 0.4}},
            follow={"range": [0.2, 1.2], "switch": ["BP", "G"], "depth": 1},
            detect={"events": ["FB", "BP", "G"]},
        )
    )
    point = next(e for e in diagram.entries if e.kind == "BP")
    assert point.parameters["d"] == pytest.approx(0.2270368473, abs=1e-10)
    (born,) = [b for b in diagram.branches if b.origin == point.id]
    assert "mirror image" in born.ends[0].message
    # the branch leaves with the parameter at rest, and with unequal times
    row = int(np.argmin(np.abs(born["s"] - point.value)))
    assert born["arclength"][row] == 0.0
    gaps = np.diff(born.times, axis=1)[:, 0]
    assert abs(gaps[row] - 1.0) < 1e-9
    assert abs(gaps[-1] - 1.0) > 0.1


def test_touches_on_two_flights_of_a_symmetric_orbit_are_inserted_together():
    model = ImpactPair(beta=0.0, r=0.3, A=5.0, s=0.4)
    orbit = next(o for o in find_orbits(model, "1:1", parameter="s") if o.physical)
    tests = functions(orbit.problem, ["G"], {})
    run = walk_both_ways(orbit.problem, orbit.unknowns, (0.1, 0.4), tests, Settings())
    events = [e for e in run.events if e.kind == "G"]
    assert len(events) == 2
    assert abs(events[0].parameter - events[1].parameter) < 1e-13
    for event in events:
        assert len(touches_at(event)) == 2
        start = switch(event)
        assert len(start.problem.word) == 4
        assert np.max(np.abs(start.problem.evaluate(start.unknowns).residual)) < 1e-13


@pytest.mark.parametrize("r", [0.2954, 0.2956])
def test_near_coincidence_of_doubling_and_grazing(r):
    """At beta = pi/9, A = 5 the PD and the G of 1:1 cross at r = 0.295513665."""
    model = ImpactPair(beta=math.pi / 9, r=r, A=5.0, s=0.36)
    orbit = next(o for o in find_orbits(model, "1:1", parameter="s") if o.physical)
    branch = continue_orbit(orbit, range=(0.2, 0.6), events=("PD", "G"))
    by_kind = {e.kind: e for e in branch.events if e.physical or e.kind == "PD"}
    doubling, grazing = by_kind["PD"], by_kind["G"]
    assert abs(doubling.parameters["d"] - grazing.parameters["d"]) < 1e-4
    doubling_first = r > 0.295513665
    assert (doubling.parameters["d"] > grazing.parameters["d"]) == doubling_first
    assert grazing.ghost == doubling_first
    assert doubling.ghost != doubling_first


def test_continue_born_follows_from_an_entry(fig7):
    entry = find(fig7, "~G[1:1->2:1]", "1:1")[0]
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    branch = continue_born(entry, model, (0.08, 1.05), events=("FB", "PD", "G"))
    known = next(b for b in fig7.branches if b.notation == "2:1")
    assert branch.notation == "2:1"
    ours = sorted(e.value for e in branch.events)
    theirs = sorted(e.value for e in known.events)
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)


@pytest.mark.full
def test_twice_gives_the_same_catalogue():
    from contimpact.results.catalogue import catalogue_text

    assert catalogue_text(follow(scene())) == catalogue_text(follow(scene()))


def test_budget_is_kept_and_reported():
    diagram = follow(scene(follow={"max_branches": 3}))
    assert len(diagram.branches) == 3
    assert any("follow.max_branches = 3" in note for note in diagram.statistics["notes"])


def test_survey_finds_branches_the_start_does_not_reach():
    found = follow(
        scene(
            model={"parameters": {"beta": "pi/2", "r": 0.7, "A": 2.0, "s": 0.5}},
            follow={
                "parameter": "A",
                "range": [1.2, 12.0],
                "switch": [],
                "depth": 0,
                "survey": True,
            },
            detect={"events": ["FB"]},
            numerics={"starts": 64, "rounds": 3},
        )
    )
    without = follow(
        scene(
            model={"parameters": {"beta": "pi/2", "r": 0.7, "A": 2.0, "s": 0.5}},
            follow={"parameter": "A", "range": [1.2, 12.0], "switch": [], "depth": 0},
            detect={"events": ["FB"]},
            numerics={"starts": 64, "rounds": 3},
        )
    )
    assert len(found.branches) > len(without.branches)


@pytest.mark.full
def test_an_orbit_run_twice_is_the_branch_it_runs():
    """At depth 3 a grazing of (3:2)/2T leads to 2:1 run twice: a meeting, not a branch."""
    diagram = follow(scene(follow={"depth": 3, "max_branches": 16}))
    for branch in diagram.branches:
        half = len(branch.word) // 2
        if branch.period % 2 or branch.word != branch.word[:half] * 2:
            continue
        row = len(branch) // 2
        later = branch.times[row, half:] - branch.times[row, :half] - branch.period
        assert np.max(np.abs(later)) > 1e-6, branch.id
    found = [e for e in diagram.entries if e.label == "~G[(3:2)/2T->2:1/2T]" and e.opens]
    known = {b.id: b.notation for b in diagram.branches}
    assert any(known[e.opens[0]] == "2:1" for e in found)


def test_touches_at_the_same_value_are_real_or_ghosts_together():
    diagram = follow(
        scene(
            model={"parameters": {"beta": 0.0, "r": 0.5, "A": 5.0, "s": 0.4}},
            follow={"parameter": "r", "range": [0.0, 1.0], "switch": [], "depth": 0},
            detect={"events": ["G"]},
        )
    )
    pairs = {}
    for entry in diagram.entries:
        if entry.order == 2:
            pairs.setdefault(round(entry.value, 10), set()).add(entry.ghost)
    assert pairs
    assert all(len(kinds) == 1 for kinds in pairs.values())


def test_merging_impacts_are_no_bifurcation_of_multipliers():
    """At r = 0 impacts merge and determinants vanish, but no multiplier is near +1 or -1."""
    diagram = follow(
        scene(
            model={"parameters": {"beta": 0.5, "r": 0.0, "A": 5.0, "s": 0.34}},
            follow={"orbits": ["2:1"], "switch": [], "depth": 0},
            detect={"events": ["FB", "BP", "PD", "G"]},
        )
    )
    assert {entry.kind for entry in diagram.entries} >= {"FB", "PD"}
    for entry in diagram.entries:
        if entry.kind in ("FB", "BP", "PD"):
            target = -1.0 if entry.kind == "PD" else 1.0
            sizes = [abs(complex(*mu) - target) for mu in entry.multipliers if mu]
            assert min(sizes) < 1e-5


def test_an_entry_of_another_model_is_refused(fig7):
    entry = find(fig7, "PD", "1:1")[0]
    other = ImpactPair(beta=0.5, r=0.3, A=5.0, s=0.34, forcing="cos(pi*t)+0.3*cos(3*pi*t)")
    with pytest.raises(InputError, match="no orbit of this model"):
        continue_born(entry, other, (0.08, 1.05))
    split = ImpactPair(beta=0.5, r_B=0.3, r_T=0.3, A=5.0, s=0.34)
    with pytest.raises(InputError, match="r_B"):
        continue_born(entry, split, (0.08, 1.05))
    with pytest.raises(InputError, match="nothing is born"):
        continue_born(None, other, (0.08, 1.05))


@pytest.mark.full
def test_a_long_word_is_not_taken_for_a_crossing_at_each_step(monkeypatch):
    """Its orientation, a product over all flights, halves at each step, as evenly as it does not
    before a crossing; each search for one solves dense systems of three times as many unknowns."""
    from contimpact.continuation import crossing_branches

    searches = []
    search = crossing_branches.meeting_on
    monkeypatch.setattr(
        crossing_branches, "meeting_on", lambda *args: searches.append(1) or search(*args)
    )
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.72)
    once = next(o for o in find_orbits(model, "1:1", parameter="s") if o.stable)
    times = 60
    columns = np.reshape(once.unknowns[:-1], (2, 2))
    unknowns = [columns + np.array([2.0 * k, 0.0]) for k in range(times)]
    problem = OrbitProblem(model, Word("BT" * times, times), Kernels(model, "s"))
    walked = walk_orbits(
        problem,
        np.append(np.ravel(unknowns), once.unknowns[-1]),
        -1,
        limits=(0.4, 0.75),
        tests=functions(problem, ("FB", "BP"), {}),
        settings=Settings(step=0.01, max_step=0.01, max_points=12),
    )
    assert len(walked.points) == 12
    values = [point.orientation for point in walked.points]
    assert all(0.0 < after / before < 0.6 for before, after in itertools.pairwise(values))
    assert not searches


@pytest.mark.skipif(importlib.util.find_spec("heyoka") is None, reason="needs contimpact[ode]")
def test_a_doubling_without_a_third_derivative_is_kept():
    """A ball falls through air onto a table: where it turns, |w| w has no second derivative, and
    its smooth form a third one of 1e15. The run ended there."""
    law = "-1 - b*w*sqrt(w**2 + 1/10**30) + A*cos(t)"
    model = {
        "system": "hybrid",
        "period": "2*pi",
        "parameters": {"A": 2.7, "r": 0.6, "b": 0.1},
        "define": {"w": "u - A*sin(t)"},
        "modes": {"m": {"y": "u", "u": law}},
        "guards": {"S": {"within": "y >= 0", "set": {"u": "-r*u"}}},
    }
    asked = {"parameter": "A", "range": [2.7, 2.75], "orbits": ["S"]}
    given = read_scene({"name": "drag", "model": model, "follow": asked}).model
    problem = OrbitProblem(given, Word("S", 1), Kernels(given, "A"))
    orbit = orbit_at(problem, np.array([5.6406, -4.1195, 2.7]))
    (event,) = continue_orbit(orbit, "A", (2.7, 2.75), events=["PD"]).events
    assert event.value == pytest.approx(2.725338565, abs=1e-9)  # by modes for both signs of w
    assert event.criticality is None
