"""A scene's whole diagram: each orbit once, and nothing missed between its events."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pytest
from zoo import ROOT, scene_table

from contimpact import (
    InputError,
    Oscillator,
    continue_born,
    continue_orbit,
    find_orbits,
    follow,
    load_diagram,
    load_scene,
    read_scene,
    write_diagram,
)
from contimpact.bifurcations.doubling import DoublingTurns
from contimpact.diagrams import starting_orbits
from contimpact.models.guards import Word
from contimpact.orbits.search import Search
from contimpact.results.catalogue import catalogue_text
from contimpact.results.diagram import Diagram
from contimpact.results.diagram_reading import read, stable_intervals
from contimpact.segments.integration import StepLimitError
from contimpact.segments.kernels import Kernels

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

FIG7 = ROOT / "branches" / "fig7" / "scene.toml"
SMALL = scene_table(name="small", follow={"range": [0.3, 0.4]}, detect={"events": ["PD", "G"]})


def small(**follow_keys):
    return read_scene({**SMALL, "follow": SMALL["follow"] | follow_keys})


@pytest.mark.full
def test_every_change_of_physicality_is_an_event():
    """Where an orbit begins to pass a wall it grazes it, or an impact appears or vanishes."""
    scene = dataclasses.replace(load_scene(FIG7), events=("FB", "BP", "PD", "G", "V", "T"))
    passing = 0
    for branch in follow(scene).branches:
        reasons, events = branch["reason"], branch["event"]
        for i in np.nonzero(np.diff(branch["physical"]))[0]:
            if "passes wall" in reasons[i] + reasons[i + 1]:
                passing += 1
                assert events[i] or events[i + 1], (branch.id, branch["s"][i])
    assert passing == 4


@pytest.mark.parametrize("r", [0.8, 1.0])
def test_orbits_that_attract_nothing_are_said_to(r):
    """Without losses the product of the multipliers, r^4, is one."""
    table = scene_table(follow={"orbits": ["1:1"], "range": [0.4, 1.0], "switch": []})
    table["model"]["parameters"] |= {"r": r, "s": 0.8}
    found = follow(read_scene(table))
    assert found.reading.stable
    said = [note for note in found.statistics["notes"] if "attract nothing" in note]
    assert len(said) == (r == 1.0)


@pytest.mark.full
def test_rotated_words_are_one():
    assert len(follow(small(orbits=["BT", "TB"])).branches) == len(follow(small()).branches)


def limited(**follow_keys):
    """The limits that a diagram of 1:1 and 2:1 reports, and the diagram."""
    found = follow(small(**{"orbits": ["1:1", "2:1"], "range": [0.27, 0.4]} | follow_keys))
    return {limit.key: limit for limit in found.limits}, found


def test_requested_values_that_no_branch_takes_are_said():
    """Values within the range are hit; d is far below 3 in all of it."""
    scene = small(**{"orbits": ["1:1"], "switch": [], "range": [0.3, 0.4]})
    asked = {"s": [0.3, 0.35], "d": [0.2, 3.0]}
    found = follow(dataclasses.replace(scene, values=asked, events=("UZ",)))
    assert {tuple(e.requested.items()) for e in found.events} == {
        (("s", 0.3),),
        (("s", 0.35),),
        (("d", 0.2),),
    }
    assert "no branch takes d = 3 (detect.values)" in found.statistics["notes"]
    assert not any("no branch takes s" in note for note in found.statistics["notes"])


@pytest.mark.full
def test_orbits_that_max_branches_leaves_out_are_reported():
    """All words are looked for; what is found and not followed is named, with the word."""
    whole, every = limited(orbits=["1:1", "1:1/2T"])
    cut, found = limited(orbits=["1:1", "1:1/2T"], max_branches=1)
    assert "follow.max_branches" not in whole
    assert [b.id for b in found.branches] == ["b1"]
    assert len(every.branches) > 1
    limit = cut["follow.max_branches"]
    words = {f"{b.word}/2T" if b.period > 1 else b.word for b in every}
    assert limit.value == 1
    assert {name for name, _ in limit.left_out} <= {f"{word} at s = 0.34" for word in words}
    assert any("BTBT/2T" in name for name, _ in limit.left_out)
    assert str(limit) in found.statistics["notes"]
    assert "follow.max_branches = 1 was reached; orbits not followed: " in found._repr_html_()


def test_words_share_in_turn_what_may_be_followed():
    """Both 2:1 orbits are not followed before the first 1:1."""
    found = follow(small(orbits=["2:1", "1:1"], switch=[], max_branches=2, range=[0.33, 0.35]))
    assert [branch.word for branch in found.branches] == ["BBT", "BT"]


@pytest.mark.full
def test_without_unphysical_orbits_every_stable_range_is_found(tmp_path):
    """Branches end a step behind the events at which orbits turn unphysical, which are located."""
    asked = {"orbits": ["1:1", "2:1"], "switch": ["PD", "G"], "range": [0.27, 0.4]}
    whole, physical = (follow(small(**asked, unphysical=each)) for each in (True, False))
    for branch in physical.branches:
        inside = np.nonzero(~branch.physical & (branch["event"] == ""))[0]
        assert set(inside.tolist()) <= {0, 1, len(branch) - 2, len(branch) - 1}
    ranges = [
        sorted((i.low, i.high) for i in read(found).stable if i.high - i.low > 1e-9)
        for found in (whole, physical)
    ]
    assert len(ranges[0]) > 2
    assert np.array(ranges[0]) == pytest.approx(np.array(ranges[1]), rel=1e-12)
    assert sum(len(b) for b in physical) < 0.6 * sum(len(b) for b in whole)
    (limit,) = {i.key: i for i in physical.limits if i.key == "follow.unphysical"}.values()
    assert str(limit).startswith("follow.unphysical = false; ")
    assert str(limit).endswith("; true includes them")
    write_diagram(physical, tmp_path / "out")
    assert load_diagram(tmp_path / "out").limits == physical.limits
    ends = [end for branch in physical for end in branch.ends if end.kind.name == "UNPHYSICAL"]
    assert "passes wall" in ends[0].message


def one_stop(**follow_keys):
    """The oscillator whose motion without impacts grazes where its amplitude is the gap."""
    keys = {"parameter": "a", "range": [0.1, 0.6], "orbits": ["0"], "unphysical": False}
    values = {"a": 0.5, "omega": 1.5, "c": 0.1, "k": 1.0, "sigma": 0.25, "r": 0.7}
    model = {"system": "oscillator", "parameters": values}
    return follow(read_scene({"name": "stop", "model": model, "follow": keys | follow_keys}))


def test_the_motion_without_impacts_is_followed_throughout():
    (branch,) = one_stop().branches
    grazing = 0.25 * math.hypot(1.0 - 1.5**2, 0.1 * 1.5)
    assert (branch["a"].min(), branch["a"].max()) == (0.1, 0.6)
    (stable,) = stable_intervals(branch)
    assert (stable.low, stable.high) == (0.1, pytest.approx(grazing, rel=1e-12))


def unphysical_at_start(limits):
    """2:1 orbits at s = 0.24, below the grazing up to which they are physical."""
    model = SMALL["model"] | {"parameters": SMALL["model"]["parameters"] | {"s": 0.24}}
    keys = {"parameter": "s", "range": limits, "orbits": ["2:1"], "unphysical": False}
    asked = {"model": model, "follow": keys, "detect": {"events": ["FB", "G"]}}
    return follow(read_scene({**SMALL, **asked}))


@pytest.mark.full
def test_a_word_with_unphysical_orbits_at_the_start_is_looked_for_elsewhere():
    found = unphysical_at_start([0.2, 0.4])
    (stable,) = read(found).stable
    assert (stable.low, stable.high) == pytest.approx((0.27903478127845, 0.35689527700013))
    (note,) = (n for n in found.statistics["notes"] if n.startswith("no physical BBT orbit"))
    assert note.endswith("(followed from there)")
    with pytest.raises(InputError, match=r"follow unphysical ones \(2\) by follow.unphysical"):
        unphysical_at_start([0.2, 0.26])


@pytest.mark.full
def test_an_unphysical_orbit_that_is_given_is_followed():
    """From Python an orbit is followed as it is, unless it is asked otherwise."""
    model = Oscillator(a=0.5, omega=1.5, c=0.1, k=1.0, sigma=0.25, r=0.7)
    (orbit,) = find_orbits(model, "0", "a")
    assert not orbit.physical
    whole = continue_orbit(orbit, range=(0.1, 0.6))
    assert [e.kind for e in whole.events] == ["G"]
    assert len(continue_orbit(orbit, range=(0.1, 0.6), unphysical=False)) == 3
    beyond = continue_orbit(whole.events[0], range=(0.1, 0.6), unphysical=False)
    assert beyond["a"].min() == 0.1
    assert beyond.ends[1].kind.name == "UNPHYSICAL"


@pytest.mark.full
def test_events_that_limits_leave_unswitched_are_named():
    """By the budget of branches, and by the depth."""
    for keys, key in (({"max_branches": 1}, "follow.max_branches"), ({"depth": 0}, "follow.depth")):
        cut, found = limited(orbits=["1:1"], switch=["PD", "G"], **keys)
        events = [f"{e.id} ({e.label})" for e in found.entries]
        assert [name for name, _ in cut[key].left_out] == events
        assert cut[key].what == "events not switched at"


def test_branches_that_a_limit_of_points_ends_are_named():
    _, found = limited(orbits=["1:1"], max_points=4)
    ended = [limit for limit in found.limits if limit.what == "branches ended by it"]
    assert [(limit.key, limit.left_out) for limit in ended] == [("follow.max_points", [("b1", 1)])]
    scene = small()
    scene = dataclasses.replace(scene, settings=dataclasses.replace(scene.settings, max_points=3))
    (limit,) = follow(scene).limits
    assert (limit.key, limit.value) == ("numerics.max_points", 3)
    assert ("b1", 1) in limit.left_out


@pytest.mark.full
def test_a_search_that_rounds_end_says_so():
    """After one round that found orbits another one might find more."""
    cut, _ = limited(orbits=["1:1"])
    assert not cut
    (limit,) = follow(dataclasses.replace(small(), rounds=1)).limits
    assert (limit.key, limit.value) == ("numerics.rounds", 1)


@pytest.mark.full
def test_a_survey_is_told_from_none_and_from_one_cut_short(tmp_path):
    """In the reading, as text, and read back from a folder."""
    for keys, survey, text in (
        ({}, "none", "not surveyed: orbits on no followed branch may exist"),
        ({"survey": True}, "done", "surveyed for the words that were followed"),
        ({"survey": "orbits"}, "orbits", "surveyed for the words of follow.orbits alone"),
        ({"survey": True, "max_branches": 1}, "cut short", "surveyed in part"),
    ):
        found = follow(small(**keys))
        assert found.reading.survey == survey
        assert found.reading.incomplete.startswith(text)
        assert found.reading.incomplete in str(found.reading)
        write_diagram(found, tmp_path)
        assert load_diagram(tmp_path) == found


@pytest.mark.parametrize("max_step", [0.015, 0.03])
@pytest.mark.full
def test_grazing_of_the_3_1_orbit_of_fig7(max_step):
    scene = load_scene(FIG7)
    settings = dataclasses.replace(scene.settings, max_step=max_step)
    labels = [
        entry.label for entry in follow(dataclasses.replace(scene, settings=settings)).entries
    ]
    assert "G[3:1->4:1]" in labels


@pytest.mark.parametrize(("rounds", "searched"), [(1, "1 round of"), (8, "2 rounds of")])
@pytest.mark.full
def test_what_was_searched_is_told(rounds, searched):
    """The search ends after two rounds that find nothing."""
    given = {**SMALL, "numerics": {"starts": 8, "rounds": rounds}}
    given["model"] = {
        "system": "impact-pair",
        "parameters": {**SMALL["model"]["parameters"], "s": 1.04},
    }
    given["follow"] = {**SMALL["follow"], "range": [1.0, 1.05]}
    with pytest.raises(InputError, match=f"{searched} 8 random starts"):
        follow(read_scene(given))


LACKING = {"orbits": ["5:1", "1:1", "3:1"], "range": [0.25, 0.4]}
"""At s = 0.34 the search finds neither 3:1 nor 5:1; folds of their stable orbits lie below."""


@pytest.mark.full
def test_words_without_an_orbit_are_listed_and_the_others_followed():
    diagram = follow(small(**LACKING))
    assert {b.word for b in diagram.branches} == {"BT"}
    listed = diagram.statistics["not_found"]
    assert [(each["notation"], each["value"]) for each in listed] == [("5:1", 0.34), ("3:1", 0.34)]
    settled, *notes = diagram.statistics["notes"]
    assert settled.startswith("simulation settles on BBT at s = 0.34, which is on no followed")
    for each, note in zip(listed, notes, strict=True):
        assert each["tried"] == 9
        assert (each["starts"], each["rounds"]) == (256, 2)
        assert {value < 0.34 for value, _ in each["elsewhere"]} == {True}
        assert f"no {each['word']} orbit was found at s = 0.34 (2 rounds of 256" in note
        assert "at s = 0.265" in note
        assert "follow.survey" in note
    found = find_orbits(small().model.replace(s=0.265), "3:1", parameter="s")
    assert dict(listed[1]["elsewhere"])[0.265] == len(found)


@pytest.mark.full
def test_a_survey_follows_words_without_an_orbit_at_the_start():
    diagram = follow(small(survey=True, orbits=["3:1"], range=[0.25, 0.4]))
    assert {b.word for b in diagram.branches} == {"BBBT"}
    stable = [b for b in diagram.branches if b["s"].max() < 0.34]
    assert stable  # the search at the start could not find it
    passes = [b for b in diagram.branches if b["s"].min() <= 0.34 <= b["s"].max()]
    assert bool(passes) != bool(diagram.statistics["not_found"])


@pytest.mark.full
def test_interrupted_before_words_were_looked_for_elsewhere():
    """What was not looked for is not said to be missing."""

    def progress(text):
        if "following b1" in text:
            raise KeyboardInterrupt

    diagram = follow(small(**LACKING), progress)
    assert diagram.statistics["failure"] == "interrupted"
    assert diagram.statistics["stopped"].startswith("following b1")
    assert json.loads(catalogue_text(diagram))["interrupted"] == diagram.statistics["stopped"]
    assert [each["tried"] for each in diagram.statistics["not_found"]] == [0, 0]
    assert not any("nor at" in note for note in diagram.statistics["notes"])


def test_what_failed_is_in_the_catalogue():
    def progress(text):
        if "following b1" in text:
            raise ZeroDivisionError("of a test")

    content = json.loads(catalogue_text(follow(small(), progress)))
    assert content["interrupted"].startswith(
        "the computation failed (ZeroDivisionError: of a test), while following b1"
    )


def test_what_nobody_expects_keeps_the_branches_and_logs_where_it_was(monkeypatch, caplog):
    """A mistake in a test function of curves lost all that had been followed before."""
    monkeypatch.setattr(DoublingTurns, "of", lambda test, here: [][1])
    curves = {"parameter": "r", "range": [0.2, 0.6], "kinds": ["PD"]}
    diagram = follow(read_scene({**SMALL, "curves": curves}))
    assert diagram.branches
    assert not diagram.curves
    expected = "the computation failed (IndexError: list index out of range)"
    assert diagram.statistics["failure"] == expected
    assert "in <lambda>" in caplog.text
    assert "please report it" in caplog.text


@pytest.mark.parametrize(
    "error", [InputError("r", "of a test", "none"), ModuleNotFoundError("of a test")]
)
def test_what_the_user_can_mend_is_raised(error: Exception):
    def progress(text):
        if "following b1" in text:
            raise error

    with pytest.raises(type(error), match="of a test"):
        follow(small(), progress)


@pytest.mark.full
def test_a_survey_for_named_words_finds_the_second_stable_range_of_1_1():
    """At beta = pi/3, r = 0.7 it is on a branch that does not pass the start; at d = 0.185 the maps
    (11) and (12) have a stable orbit of 1:1 and one of 2:1."""
    scene = small(range=[0.2, 0.4], switch=["G"], survey="orbits")
    scene = dataclasses.replace(scene, model=scene.model.replace(beta=math.pi / 3, r=0.7, s=0.35))
    found = follow(scene)
    at = 0.185 / 0.6225
    stable = {i.notation for i in found.reading.stable if i.low < at < i.high}
    assert stable == {"1:1", "2:1"}
    assert not any("/2T" in branch.notation for branch in found.branches)
    with pytest.raises(InputError, match='true, false or "orbits"'):
        small(survey="all")


@pytest.mark.parametrize("survey", [False, True])
@pytest.mark.full
def test_a_scene_is_refused_if_none_of_its_words_has_an_orbit(survey):
    given = {**SMALL, "numerics": {"starts": 8}}
    parameters = {**SMALL["model"]["parameters"], "s": 1.04}
    given["model"] = {"system": "impact-pair", "parameters": parameters}
    wanted = {"range": [1.0, 1.05], "orbits": ["1:1", "2:1"], "survey": survey}
    given["follow"] = SMALL["follow"] | wanted
    with pytest.raises(InputError, match=r"no BT orbit was found at s = 1\.04") as refused:
        follow(read_scene(given))
    assert "nor of BBT" in str(refused.value)
    assert "nor at 9 other values" in str(refused.value)


@pytest.mark.full
def test_reading_a_part_of_a_diagram():
    """Transitions onto branches that are not there are passed over."""
    diagram = follow(load_scene(FIG7))
    assert read(diagram).transitions
    assert not read(Diagram("part", diagram.branches[:1])).transitions


def above_the_doubling(*orbits):
    """A scene that starts above the doubling of 1:1 at s = 0.38314, where 1:1/2T ends."""
    given = small(orbits=list(orbits), range=[0.33, 0.45])
    return dataclasses.replace(given, model=given.model.replace(s=0.42))


@pytest.mark.full
def test_only_repetitions_of_a_shorter_orbit_are_called_so():
    with pytest.raises(InputError) as refused:
        follow(above_the_doubling("1:1/2T"))
    assert "no BTBT/2T orbit but repetitions of 1:1 was found at s = 0.42" in str(refused.value)
    assert "ask for 1:1, or " in str(refused.value)
    diagram = follow(above_the_doubling("1:1", "1:1/2T"))
    (listed,) = diagram.statistics["not_found"]
    assert listed["repeated"] == ["1:1"]
    assert "but repetitions of 1:1 was found" in diagram.statistics["notes"][-1]


@pytest.mark.full
def test_a_branch_of_repetitions_is_followed_once_and_called_so():
    """(3:2)/2T grazes in one of its periods only, and becomes 2:1 run twice."""
    orbits = {"orbits": ["BBTBT/2T"], "range": [0.32, 0.345], "switch": ["G"]}
    diagram = follow(small(**orbits))
    (grazing,) = (e for e in diagram.entries if e.label == "~G[(3:2)/2T->2:1/2T]")
    said = "the 2:1/2T orbits born there are repetitions of 2:1, and followed as such"
    assert f"{grazing.id} ({grazing.label}): {said}" in diagram.statistics["notes"]
    assert {diagram[name].notation for name in grazing.opens} == {"2:1"}
    born = continue_born(grazing, range=(0.32, 0.345))
    assert (born.notation, born.notes) == ("2:1", [said])


def test_elsewhere_few_starts_come_first(monkeypatch):
    """Nine whole searches in vain took as long as everything else together."""
    asked = []

    def counted(model, word, parameter, kernels, rng, starts, rounds):
        asked.append((starts, rounds))
        return Search([], starts)

    monkeypatch.setattr(starting_orbits, "search", counted)
    with pytest.raises(InputError, match=r"nor at 9 other values .*\(64 random starts at each\)"):
        follow(small(orbits=["3:1"]))
    assert asked == [(256, 8)] + 9 * [(64, 1)]
    asked.clear()
    with pytest.raises(InputError, match=r"\(256 random starts at each\)"):
        follow(small(orbits=["3:1"], survey=True))
    assert asked == 10 * [(256, 8)]


def test_values_at_which_the_steps_of_integration_run_out_are_not_looked_at(monkeypatch):
    """A search that had used them up with solutions still to look at ended `check` and `run`."""

    def out_of_steps(*given):
        raise StepLimitError("flights have taken all steps of integration that they may")

    scene = small()
    monkeypatch.setattr(starting_orbits, "search_elsewhere", out_of_steps)
    kernels = Kernels(scene.model, scene.parameter)
    missing = starting_orbits.not_found(scene, kernels, Word("BBBBBT", 1))
    assert missing.elsewhere == ()
    assert missing.tried == 0
    assert "flights take too many steps of integration" in missing.nowhere


@pytest.mark.parametrize(("b", "family"), [(0.0, True), (0.1, False)])
def test_motions_that_nothing_holds_in_its_place_are_a_family(b, family):
    """A damped mass without a spring swings about any place, unless a constant force moves it."""
    table = {
        "name": "free",
        "model": {
            "system": "two-stops",
            "parameters": {
                "a": 1.0,
                "b": b,
                "omega": 1.3,
                "c": 0.3,
                "k": 0.0,
                "sigma": 1.0,
                "r": 0.7,
            },
        },
        "follow": {"parameter": "omega", "range": [1.2, 1.4], "orbits": ["0", "1:1"]},
        "detect": {"events": []},
    }
    notes = " ".join(follow(read_scene(table)).statistics["notes"])
    assert ("no 0 orbit but a family that cannot be followed" in notes) is family
    assert ("no 0 orbit was found" in notes) is not family
