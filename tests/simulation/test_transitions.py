"""Transitions between attractors and coverage by branches, on the scene of Fig. 7."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import tomllib

import numpy as np
import pytest
from zoo import ROOT, scene_table

from contimpact import continue_orbit, load_entries
from contimpact.diagrams.explore import follow
from contimpact.orbits.search import find_orbits
from contimpact.results.options import Settling
from contimpact.results.scene import load_scene, read_scene
from contimpact.simulation.attractor import repetitions_of, solve_cycle
from contimpact.simulation.run import State
from contimpact.simulation.sweep import Row, Simulators, Sweep, cover, scene_fragment, sweep
from contimpact.simulation.transitions import (
    A_STEP,
    Side,
    Transition,
    _is_related,
    explain_transition,
    find_transitions,
    goes_on,
    locate,
    name,
    transitions_between,
)
from contimpact.systems.duffing import Duffing
from contimpact.systems.impact_pair import ImpactPair

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

QUICK = Settling(transient=50, periods=800, impacts=1500)
PD, G_DOUBLED, FB, G_21 = 0.383143488343, 0.365318559017, 0.356895277, 0.279034781278
"""Values of s at which the branches double, graze and fold; see test_shipped_scenes."""


@pytest.fixture(scope="module")
def scene():
    return read_scene(
        scene_table(
            name="fig7",
            follow={"range": [0.25, 0.42], "switch": ["G", "PD"], "depth": 2},
            detect={"events": ["FB", "PD", "G"]},
        )
    )


@pytest.fixture(scope="module")
def diagram(scene):
    return follow(scene)


def swept(scene, kernels_of, values, start=State(0, 0.25, 0.6)):  # noqa: B008
    model = scene.model
    return sweep(model, "s", values, start=start, settling=QUICK, kernels=kernels_of(model, "s"))


def only(scene, kernels_of, diagram, values, width=1e-6, start=State(0, 0.25, 0.6)):  # noqa: B008
    """The first transition between two values."""
    found = swept(scene, kernels_of, values, start)
    simulators = Simulators(scene.model, "s", kernels_of(scene.model, "s"))
    first = next(transitions_between(simulators, *found.rows, width, QUICK))
    return explain_transition(first, diagram, found)


@pytest.mark.full
def test_the_doubling_of_fig_7(scene, kernels_of, diagram):
    """PD, explained by the branch's, which lies in the bracket."""
    found = only(scene, kernels_of, diagram, [0.39, 0.376])
    assert (found.kind, found.before.notation, found.after.notation) == ("PD", "1:1", "1:1/2T")
    assert found.after.value < PD <= found.before.value + 1e-6
    assert found.explanations[0].role == "explains"
    assert found.explanations[0].value == pytest.approx(PD, abs=1e-11)
    assert found.before.multiplier == pytest.approx(-1, abs=1e-4)


@pytest.mark.full
def test_the_onset_of_complex_motion_of_fig_7(scene, kernels_of, diagram):
    """The doubled orbit grazes: in d, 0.22741080 on the branch, within 1e-6 by simulation."""
    found = only(scene, kernels_of, diagram, [0.368, 0.362])
    assert found.kind == "G"
    assert found.before.notation == "1:1/2T"
    assert found.after.value <= G_DOUBLED <= found.before.value
    assert found.before.value - found.after.value < 1e-6
    assert found.explanations[0].label.startswith("G[1:1/2T->")
    assert found.explanations[0].distance == 0


@pytest.mark.full
def test_the_grazing_of_the_2_1_orbit(scene, kernels_of, diagram):
    """Small steps follow 2:1 to its grazing, although 3:1 is stable already before it."""
    found = only(scene, kernels_of, diagram, [0.284, 0.276], start=State(0, 0.1, 0.54))
    assert (found.label, found.kind, found.order) == ("G[2:1->3:1]", "G", 1)
    assert found.after.value <= G_21 <= found.before.value
    assert found.explanations[0].role == "explains"


@pytest.mark.full
def test_the_fold_of_the_2_1_orbit_upwards(scene, kernels_of, diagram):
    """Rising, 2:1 lives up to its fold; behind it the motion is complex."""
    found = only(scene, kernels_of, diagram, [0.352, 0.36], start=State(0, 0.1, 0.6))
    assert (found.kind, found.before.notation) == ("FB", "2:1")
    assert found.before.value <= FB <= found.after.value
    assert found.direction == "up"
    assert found.explanations[0].value == pytest.approx(FB, abs=1e-9)


@pytest.mark.full
def test_the_end_of_complex_motion_is_bounded(scene, kernels_of, diagram):
    """TG: complex motion gives way to 2:1 between the fold and the ghost grazing of 1:1."""
    found = only(scene, kernels_of, diagram, [0.358, 0.35], width=1e-3)
    assert (found.kind, found.after.notation) == ("TG", "2:1")
    labels = {e.label: e for e in found.explanations}
    assert {"FB", "~G[1:1->2:1]"} <= set(labels)
    assert labels["~G[1:1->2:1]"].value < found.value < labels["FB"].value
    assert {e.role for e in found.explanations} == {"bounds"}


@pytest.mark.full
def test_an_attractor_that_does_not_end(scene, kernels_of):
    """Ten steps on 1:1 is still there: the change is one of basin, without a name."""
    first = swept(scene, kernels_of, [0.40]).rows[0]
    other = Row("down", 0.399, swept(scene, kernels_of, [0.33]).rows[0].attractor)
    simulators = Simulators(scene.model, "s", kernels_of(scene.model, "s"))
    _, left, _, right = locate(simulators, first, other, 1e-4, QUICK)
    assert (left.attractor.notation, right) == ("1:1", None)
    (change,) = transitions_between(simulators, first, other, 1e-4, QUICK)
    assert (change.kind, change.label) == (None, "1:1->2:1")
    assert "left the basin of 1:1" in change.evidence
    assert change.wide


@pytest.mark.full
def test_records_of_transitions_read_back(scene, kernels_of, diagram):
    found = only(scene, kernels_of, diagram, [0.368, 0.362], width=1e-4)
    assert Transition.from_record(json.loads(json.dumps(found.as_record()))) == found


@pytest.mark.full
def test_all_transitions_of_a_sweep(scene, kernels_of, diagram):
    rows = swept(scene, kernels_of, [0.39, 0.376, 0.37, 0.33, 0.3])
    found = find_transitions(rows, 1e-3, settling=QUICK, diagram=diagram)
    assert [t.label for t in found[:2]] == ["PD[1:1->1:1/2T]", found[1].label]
    assert found[-1].after.notation == "2:1"
    assert all(t.explanations for t in found if t.kind in ("PD", "TG"))


@pytest.mark.parametrize(
    ("first", "second", "kind"), [(0.40, 0.376, "PD"), (0.376, 0.40, None), (0.34, 0.26, None)]
)
def test_names_need_evidence(scene, kernels_of, first, second, kind):
    """A doubled word is a doubling wherever seen; other changes need a critical value near."""
    rows = swept(scene, kernels_of, [first]).rows + swept(scene, kernels_of, [second]).rows
    found = name(*rows)
    assert found.kind == ("PD" if {first, second} == {0.40, 0.376} else kind)
    assert found.label.endswith(
        f"{rows[0].attractor.notation}->{rows[1].attractor.notation}" + ("]" if found.kind else "")
    )


# Coverage


@pytest.mark.full
def test_attractors_lie_on_branches(scene, kernels_of, diagram):
    """Velocities of simulation and of the branches agree; measured: 3e-15."""
    rows = swept(scene, kernels_of, np.linspace(0.41, 0.26, 16).tolist())
    found = cover(rows, diagram, kernels_of(scene.model, "s"))
    words = {m.word for m in found.matches}
    assert {"BT", "BTBT", "BBT", "BBBT"} <= words
    assert max(m.distance for m in found.matches) < 1e-12
    matched = {(m.direction, m.value) for m in found.matches}
    others = [r for r in rows.rows if (r.direction, r.value) not in matched]
    assert sum(u.count for u in found.uncovered) == len(others)
    complex_ones = [u for u in found.uncovered if u.kind == "complex"]
    assert complex_ones
    assert complex_ones[0].scene is None


def test_an_attractor_without_a_branch_comes_with_a_scene(scene, kernels_of, diagram):
    """4:1 was not followed; the fragment follows it, and then it is covered."""
    rows = swept(scene, kernels_of, [0.252], start=State(0, 0.1, 0.5))
    found = cover(rows, diagram, kernels_of(scene.model, "s"))
    assert found.matches == []
    (missing,) = found.uncovered
    assert (missing.notation, missing.word) == ("4:1", "BBBBT")
    text = 'name = "4:1"\n' + missing.scene
    fragment = tomllib.loads(text)
    fragment["follow"]["range"] = [0.251, 0.253]
    again = cover(rows, follow(read_scene(fragment)), kernels_of(scene.model, "s"))
    assert [m.word for m in again.matches] == ["BBBBT"]
    assert again.uncovered == []


def test_the_fragment_keeps_every_parameter(scene, kernels_of):
    rows = swept(scene, kernels_of, [0.3])
    fragment = tomllib.loads(scene_fragment(rows.rows[0], rows))
    assert fragment["model"]["parameters"] == {**scene.model.values, "s": 0.3}
    assert fragment["model"]["forcing"] == scene.model.options["forcing"]
    assert Sweep.of(rows, "down")


# What is a period doubling and what is not; brackets


def changed(row, value, **changes):
    """A row at another value whose attractor differs in some attributes."""
    return Row(row.direction, value, dataclasses.replace(row.attractor, **changes))


@pytest.fixture(scope="module")
def ending(scene, kernels_of):
    """1:1 twice, its larger multiplier on its way to -1, which it would reach at 0.3999."""
    row = swept(scene, kernels_of, [0.4]).rows[0]
    parts = [(-0.98 - 0.02 * step, 0.0) for step in (0.0, 0.95)]
    return changed(row, 0.4019, multipliers=parts[0]), changed(row, 0.4, multipliers=parts[1])


def test_a_multiplier_of_minus_one_alone_is_no_doubling(scene, kernels_of, ending):
    """Table 1's PD is n:m to n:m/2T; what else follows has no name, and the evidence is kept."""
    earlier, before = ending
    other = swept(scene, kernels_of, [0.33]).rows[0]
    found = name(before, changed(other, 0.3999), earlier)
    assert (found.kind, found.label) == (None, "1:1->2:1")
    assert found.evidence == "1 + mu = 0.001, zero at 0.3999, but no doubled orbit follows"
    assert "no name: 1 + mu" in found.lines("s")[1]


def test_a_doubling_is_named_by_what_follows(scene, kernels_of, ending):
    earlier, before = ending
    doubled = swept(scene, kernels_of, [0.376]).rows[0]
    assert doubled.attractor.notation == "1:1/2T"
    found = name(before, changed(doubled, 0.3999), earlier)
    assert (found.kind, found.label) == ("PD", "PD[1:1->1:1/2T]")
    assert found.evidence.startswith("the word is run twice over twice the period")
    tripled = changed(doubled, 0.3999, word="BTBTBT", period=3, notation="1:1/3T")
    assert name(before, tripled, earlier).kind is None


@pytest.mark.slow
def test_a_subcritical_doubling_has_no_name(scene, kernels_of):
    """4:1 loses its stability at s = 0.2558358860, where its branch has a subcritical PD: no
    doubled orbit is stable beyond it, the motion goes to (7:2)/2T."""
    found = swept(scene, kernels_of, [0.2550, 0.2560], start=State(0, 0.1, 0.5))
    simulators = Simulators(scene.model, "s", kernels_of(scene.model, "s"))
    first = next(transitions_between(simulators, *found.rows, 1e-6, QUICK))
    assert (first.before.notation, first.kind) == ("4:1", None)
    assert first.after.notation != "4:1/2T"
    assert first.before.value <= 0.2558358860 <= first.after.value
    assert first.evidence.startswith("1 + mu")
    assert float(re.search(r"zero at ([\d.]+)", first.evidence)[1]) == pytest.approx(
        0.2558358860, abs=1e-8
    )


@pytest.mark.slow  # 20 s of it are spent on motions that settle within thousands of periods
def test_a_narrow_window_of_the_doubled_orbit_is_resolved(kernels_of):
    """Fig. 3(a): 1:1/2T lives from s = 0.331622886, a PD, to 0.331580764, where it grazes; 4.2e-5.

    Both are those of the branches; the motion settles within thousands of periods only.
    """
    model = ImpactPair(beta=np.pi / 9, r=0.3, A=5.0, s=0.3317)
    kernels = kernels_of(model, "s")
    orbit = next(o for o in find_orbits(model, "1:1", kernels=kernels) if o.stable and o.physical)
    simulators = Simulators(model, "s", kernels)
    start = simulators.at(0.3317).state("B", orbit.times[0], orbit.velocities[0])
    long = dataclasses.replace(QUICK, periods=2000)
    before = sweep(model, "s", [0.3317], start=start, settling=long, kernels=kernels).rows[0]
    after = sweep(model, "s", [0.3309], start=State(0, 0.25, 0.6), kernels=kernels).rows[0]
    assert (before.attractor.notation, after.attractor.notation) == ("1:1", "2:1")
    doubling, grazing = transitions_between(simulators, before, after, 1e-5, long)
    assert (doubling.label, grazing.label) == ("PD[1:1->1:1/2T]", "PD_G[1:1/2T->2:1]")
    assert doubling.after.value <= 0.331622886 <= doubling.before.value + 1e-9
    assert doubling.width < 2.5e-5
    assert grazing.after.value <= 0.331580764 <= grazing.before.value
    assert grazing.evidence.startswith("smallest gap")


def counting(simulators):
    """What the simulators are asked to settle at, in a list."""
    asked, lead = [], simulators.lead

    def counted(attractor, value, settling):
        asked.append(value)
        return lead(attractor, value, settling)

    simulators.lead = counted
    return asked


@pytest.mark.full
def test_a_doubling_is_located_without_waiting(scene, kernels_of):
    """Beside it motion takes 1e8 periods to leave the orbit that doubles, and the doubled one is
    solved for; `PD` is that of the branch."""
    found = swept(scene, kernels_of, [0.39, 0.376])
    simulators = Simulators(scene.model, "s", kernels_of(scene.model, "s"))
    asked = counting(simulators)
    (doubling,) = transitions_between(simulators, *found.rows, 1e-9, QUICK)
    assert doubling.label == "PD[1:1->1:1/2T]"
    assert doubling.after.value <= PD <= doubling.before.value
    assert (doubling.width <= 1e-9, doubling.wide) == (True, None)
    assert len(asked) <= 1


@pytest.mark.full
def test_wide_brackets_say_why(scene, kernels_of):
    """Beyond a fold motion lingers where the orbit was; the bracket is wider and says so."""
    found = swept(scene, kernels_of, [0.352, 0.36], State(0, 0.1, 0.6))
    simulators = Simulators(scene.model, "s", kernels_of(scene.model, "s"))
    wide = next(transitions_between(simulators, *found.rows, 1e-11, QUICK))
    assert wide.value == pytest.approx(FB, abs=1e-9)
    assert wide.width > 1e-11
    assert "instead of 1e-11" in wide.wide
    assert "simulate.periods" in wide.wide
    assert any("wide: " in line for line in wide.lines("s"))
    narrow = next(transitions_between(simulators, *found.rows, 1e-3, QUICK))
    assert narrow.width <= 1e-3
    assert narrow.wide is None


def test_records_without_evidence_can_be_read(ending):
    """Those of runs before it was kept."""
    record = name(*ending).as_record()
    del record["evidence"], record["wide"]
    found = Transition.from_record(record)
    assert (found.evidence, found.wide) == ("", None)


def test_a_symmetry_that_breaks_is_a_transition():
    """Both orbits are 1:1; the branch's branch point lies in the bracket."""
    level = ImpactPair(beta=0.0, r=0.5, A=5.0, s=0.45)
    found = sweep(level, "s", [0.44, 0.43, 0.42, 0.41], settling=QUICK)
    (breaks,) = find_transitions(found, 1e-8, settling=QUICK)
    assert (breaks.kind, breaks.label, breaks.wide) == (None, "1:1->1:1", None)
    assert breaks.after.value < 0.423183267920 < breaks.before.value
    assert breaks.evidence.endswith("beside it follows, as where a symmetry breaks")


def test_a_doubled_orbit_goes_on_where_newtons_iteration_leads_to_the_one_that_doubles():
    pair = ImpactPair(beta=math.pi / 3.0, r=0.5, A=5.0, s=0.38)
    _, before, after = sweep(pair, "s", [0.3798, 0.3796772, 0.3796119], settling=QUICK).rows
    assert before.attractor.notation == after.attractor.notation == "1:1/6T"
    simulators = Simulators(pair, "s")
    state, there = before.attractor.state, simulators.at(after.value)
    solved = solve_cycle(there, state, 12, 6)
    assert solved is not None
    assert repetitions_of(solved, there.period) == 2
    assert goes_on(simulators, before, after, QUICK)


@pytest.mark.full
def test_an_orbit_of_a_window_is_not_the_one_of_its_name_before_chaos():
    """The branch of 1:1/4T doubles, then its doubled orbits; the 1:1/4T at 0.45 is another one."""
    pair = ImpactPair(beta=1.1465038, r=0.6847645, A=5.5766278, s=0.475)
    rows = sweep(pair, "s", [0.475, 0.4665, 0.45], settling=QUICK)
    _, before, after = rows.attractors
    assert before.notation == after.notation == "1:1/4T"
    branch = continue_orbit(before.orbit(parameter="s"), range=(0.46, 0.476))
    doubling = next(event.value for event in branch.events if event.kind == "PD")
    changes = find_transitions(rows, 1e-6, settling=QUICK)
    labels = [change.label for change in changes]
    at = labels.index("PD[1:1/4T->1:1/8T]")
    assert changes[at].after.value <= doubling <= changes[at].before.value
    assert labels[at + 1] == "PD[1:1/8T->1:1/16T]"


@pytest.mark.parametrize("last", [[], [0.57]])
def test_transitions_about_a_value_that_has_not_settled_do_not_overlap(last):
    """Complex motion ends just beyond it: a change to, or from, what is not settled was none."""
    pair, short = ImpactPair(beta=0.2, r=0.3, A=5.0, s=0.35), Settling(periods=300, impacts=400)
    values = [0.15454545454545454, 0.2590909090909091, 0.3636363636363636, 0.46818181818181814]
    found = sweep(pair, "beta", [0.05, *values, *last], settling=short)
    kinds = [attractor.kind.value for attractor in found.attractors]
    assert kinds == ["periodic"] * 4 + ["not settled"] + ["periodic"] * len(last)
    changes = find_transitions(found, 1e-3, settling=short)
    ends = [side.value for change in changes for side in (change.before, change.after)]
    assert ends == sorted(ends)
    notations = [change.before.notation for change in changes] + [changes[-1].after.notation]
    assert notations == ["1:1", "1:1/2T", "1:1/C", "2:1"]


def test_a_jump_to_another_motion_of_the_same_name_is_a_transition():
    """From resonance down, where each value begins with an impact at random."""
    pytest.importorskip("heyoka")
    model = Duffing(a=0.3, omega=1.0, c=0.1, beta=1.0, sigma=10.0, r=0.8)
    rows = [sweep(model, "omega", [w], settling=QUICK).rows[0] for w in (1.35, 1.4, 1.45, 1.6)]
    found = Sweep(model, "omega", rows)
    large = [abs(row.attractor.motion[0]) > 0.5 for row in found.rows]
    assert large == [True, True, False, False]
    (change,) = find_transitions(found, 1e-3, settling=QUICK)
    orbits = find_orbits(model.replace(omega=1.4), "0", parameter="omega")
    orbit = max(orbits, key=lambda o: abs(o.unknowns[0]) if o.stable else 0.0)
    fold = max(e.value for e in continue_orbit(orbit, range=(1.3, 1.9), events=["FB"]).events)
    assert change.label == "no impact->no impact"
    assert change.before.value < fold < change.after.value


def test_changes_from_and_to_no_impacts_are_named_by_the_event_that_lies_there():
    """They had no name, though the branches had the event. Motion without impacts shows its gap, so
    that its end has one without branches, too."""
    stop = load_scene(ROOT / "branches" / "stop" / "scene.toml")
    short = dataclasses.replace(stop, model=stop.model.replace(a=0.175), range=(0.05, 0.3))
    diagram = follow(short)
    for values, label, kind, alone in (
        ([0.09, 0.095, 0.11], "G[no impact->1]", "V", "G"),
        ([0.11, 0.095, 0.09], "FB[1->no impact]", "FB", None),
    ):
        found = sweep(stop.model, "a", values, settling=QUICK)
        for row in (row for row in found.rows if row.attractor.label == "no impact"):
            assert row.attractor.smallest_gap == pytest.approx(1.0 - 10.0 * row.value, abs=1e-12)
        (change,) = find_transitions(found, 1e-5, settling=QUICK, diagram=diagram)
        (entry,) = (e for e in diagram.entries if e.kind == kind)
        assert (change.label, change.kind) == (label, label.split("[")[0])
        assert [one.entry for one in change.explanations] == [entry.id]
        assert not any("no name" in line for line in change.lines("a"))
        (change,) = find_transitions(found, 1e-5, settling=QUICK)
        assert change.kind == alone
        wide = f"{A_STEP}; it was not followed to its end"
        step = dataclasses.replace(change, kind=None, wide=wide)
        (bound,) = explain_transition(step, diagram, found).explanations
        assert (bound.entry, bound.role) == (entry.id, "bounds")
        assert explain_transition(step, diagram, found).kind is None


@pytest.mark.parametrize(("period", "related"), [(1, True), (2, False)])
def test_an_orbit_of_another_period_is_not_the_one_a_grazing_leads_to(period, related):
    """The grazing of 1:2/2T onto (3:4)/2T was said to bound the end of (3:4)/3T."""
    entries = load_entries(ROOT / "branches" / "fig7")
    grazing = next(e for e in entries if (e.word, e.becomes) == ("BT", "BBT"))
    chaos = Side(0.31, "complex", "complex", None, None, 1.0, None, None)
    orbit = Side(0.30, "periodic", "", "BBT", period, 3.0 / period, None, None)
    assert _is_related(grazing, Transition("down", "TG", "", None, chaos, orbit, 0.01)) is related


def test_a_sweep_from_no_forcing_at_all_names_its_end():
    """At a = 0 the motion is at rest, and has no size: a division by zero."""
    stop = load_scene(ROOT / "branches" / "stop" / "scene.toml")
    found = sweep(stop.model, "a", [0.0, 0.11], settling=QUICK)
    (change,) = find_transitions(found, 6e-2, settling=QUICK)
    assert (change.label, change.before.smallest_gap > 0.0) == ("G[no impact->1]", True)


@pytest.mark.full
def test_a_touch_that_is_a_jump_explains_the_motion_that_it_ends():
    """A stop that kicks: no orbit with an impact is born where the motion without any touches it,
    at the amplitude s sqrt((1 - w^2)^2 + c^2 w^2)."""
    table = scene_table(
        model={
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"c": 0.1, "a": 0.4, "w": 1.3},
            "modes": {"m": {"x": "v", "v": "-x - c*v + a*cos(w*t)"}},
            "guards": {"H": {"within": "x <= 0.6", "set": {"v": "-0.6*v - 0.2"}}},
        },
        follow={"parameter": "a", "range": [0.3, 0.5], "orbits": ["0"], "switch": ["G"]},
    )
    kicked = read_scene(table)
    diagram = follow(kicked)
    found = sweep(kicked.model, "a", [0.08, 0.42, 0.43], settling=QUICK)
    (change,) = find_transitions(found, 1e-5, settling=QUICK, diagram=diagram)
    (entry,) = diagram.entries
    assert (entry.label, list(entry.opens)) == ("G", [])
    assert entry.value == pytest.approx(0.6 * math.hypot(1 - 1.3**2, 0.1 * 1.3), rel=1e-12)
    assert (change.label, change.explanations[0].entry) == ("G[no impact->1]", entry.id)
