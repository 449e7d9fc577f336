"""Ctrl-C during long work: what was computed until then is kept, and says where it ends."""

from __future__ import annotations

import dataclasses
import functools
import sys

import numpy as np
import pytest

from contimpact import continue_born, continue_orbit, find_orbits, follow, follow_curve, read_scene
from contimpact.continuation.branch import EndKind
from contimpact.continuation.settings import Settings
from contimpact.diagrams import explore
from contimpact.diagrams.crisis_location import NoCrisis
from contimpact.diagrams.orbit_walks import Run
from contimpact.errors import InputError
from contimpact.results.diagram_reading import read

RANGE = (0.3, 0.4)
FINE = Settings(step=1e-3, max_step=1e-3)
"""Several hundred points to interrupt."""


@pytest.fixture(scope="module")
def orbit(pair):
    return find_orbits(pair(s=0.34), "1:1", parameter="s")[0]


@pytest.fixture(scope="module")
def whole(orbit):
    return continue_orbit(orbit, "s", RANGE, settings=FINE, events=["PD", "G"])


def interrupting(after):
    """A callback during whose call number `after` the keyboard interrupts."""
    calls = 0

    def callback(point):
        nonlocal calls
        calls += 1
        if calls == after:
            raise KeyboardInterrupt

    return callback


def lies_on(part, whole):
    """Whether each point of a branch walked is one of the other, to the bit."""
    walked = part["event"] == ""
    return bool(np.isin(part["s"][walked], whole["s"]).all())


@pytest.mark.parametrize("after", [1, 2, 5, 60])
def test_a_branch_is_kept_as_far_as_it_has_come(orbit, whole, after):
    branch = continue_orbit(
        orbit, "s", RANGE, settings=FINE, events=["PD", "G"], callback=interrupting(after)
    )
    assert 1 <= len(branch) <= after + 1
    assert lies_on(branch, whole)
    start, end = branch.ends
    assert (start.kind, end.kind) == (EndKind.INTERRUPTED, EndKind.INTERRUPTED)
    assert start.value == pytest.approx(0.34, abs=1e-14)  # the other direction was never begun
    assert end.value == branch["s"][-1]
    assert "interrupted at s = 0.34" in start.message


def test_the_second_direction_is_kept_as_well(orbit, whole):
    forward = len(whole["s"][whole["s"] > 0.34])
    branch = continue_orbit(
        orbit, "s", RANGE, settings=FINE, events=["PD", "G"], callback=interrupting(forward + 10)
    )
    assert [end.kind for end in branch.ends] == [EndKind.INTERRUPTED, EndKind.RANGE]
    assert branch.ends[0].value == branch["s"][0] < 0.34
    assert [e.kind for e in branch.events] == ["PD"]
    assert branch.events[0].value == whole.events[-1].value
    assert lies_on(branch, whole)


@pytest.mark.full
def test_no_event_beyond_the_last_point(orbit, monkeypatch):
    """An interruption between the location of an event and the end of its step."""
    from contimpact.continuation import walk

    branch = continue_orbit(orbit, "s", (0.34, 0.4), settings=FINE, events=["PD"])
    assert [e.kind for e in branch.events] == ["PD"]
    original = walk._Walker.events_before

    def events_before(self, *step):
        found = original(self, *step)
        if found:
            raise KeyboardInterrupt
        return found

    monkeypatch.setattr(walk._Walker, "events_before", events_before)
    cut = continue_orbit(orbit, "s", (0.34, 0.4), settings=FINE, events=["PD"])
    assert cut.events == []
    assert cut["s"].max() < branch.events[0].value
    assert cut.ends[1].kind is EndKind.INTERRUPTED


def test_a_branch_whose_table_is_interrupted_is_whole(orbit, whole, monkeypatch):
    make = Run.branch
    calls = []

    def interrupted_once(self, *given, **named):
        calls.append(given)
        if len(calls) == 1:
            raise KeyboardInterrupt
        return make(self, *given, **named)

    monkeypatch.setattr(Run, "branch", interrupted_once)
    branch = continue_orbit(orbit, "s", RANGE, settings=FINE, events=["PD", "G"])
    assert branch == whole


def test_an_interruption_before_the_first_point_is_one(orbit, monkeypatch):
    def interrupted(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr("contimpact.continuation.step.take_point", interrupted)
    with pytest.raises(KeyboardInterrupt):
        continue_orbit(orbit, "s", RANGE)


def test_a_branch_born_at_an_event_is_kept(pair, whole):
    doubling = next(e for e in whole.events if e.kind == "PD")
    born = continue_born(doubling, pair(), RANGE, settings=FINE, callback=interrupting(20))
    assert [end.kind for end in born.ends] == [EndKind.BORN, EndKind.INTERRUPTED]
    assert 15 < len(born) <= 21
    grazing = next(e for e in whole.events if e.kind == "G")
    both = continue_born(grazing, pair(), RANGE, settings=FINE, callback=interrupting(20))
    assert both.ends[1].kind is EndKind.INTERRUPTED


def test_a_curve_is_kept(pair, whole):
    entry = whole.events[-1]
    ranges = (RANGE, (0.2, 0.4))
    settings = dataclasses.replace(FINE, tolerance=1e-13, step=0.01, max_step=0.01)
    curve = follow_curve(
        pair(), entry, "r", *ranges, settings=settings, detect=False, callback=interrupting(8)
    )
    assert [end.kind for end in curve.ends] == [EndKind.INTERRUPTED] * 2
    assert len(curve) == 8
    assert "interrupted at r = " in str(curve)


SCENE = {
    "name": "small",
    "model": {
        "system": "impact-pair",
        "parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.34},
    },
    "follow": {"parameter": "s", "range": [0.3, 0.4], "orbits": ["1:1"], "switch": ["PD"]},
    "detect": {"events": ["PD", "G"]},
    "numerics": {"step": 1e-3, "max_step": 1e-3},
}


def stopped_at(marker, times=1):
    """Progress during which the keyboard interrupts, when a line with some text has come."""
    left = times

    def progress(text):
        nonlocal left
        left -= marker in text
        if not left:
            raise KeyboardInterrupt

    return progress


@pytest.mark.parametrize("marker", ["b1", "b2", "b3"])
@pytest.mark.full
def test_a_diagram_keeps_the_branch_under_way(marker):
    """Those before it are whole; nothing is followed after it."""
    whole = follow(read_scene(SCENE))
    part = follow(read_scene(SCENE), stopped_at(f"{marker}, ", times=2))
    assert part.statistics["failure"] == "interrupted"
    assert part.branches[-1].id == marker
    assert EndKind.INTERRUPTED in [end.kind for end in part.branches[-1].ends]
    for one, other in zip(part.branches[:-1], whole.branches, strict=False):
        assert np.array_equal(one["s"], other["s"])
    read(part)


@pytest.mark.full
def test_a_diagram_keeps_the_curve_under_way():
    curves = {
        "parameter": "r",
        "range": [0.2, 0.4],
        "kinds": ["PD"],
        "step": 0.003,
        "max_step": 0.003,
    }
    scene = read_scene(SCENE | {"curves": curves})
    whole = follow(scene)
    part = follow(scene, stopped_at("curve c1", times=2))
    assert part.statistics["failure"] == "interrupted"
    assert len(part.curves) == 1
    assert EndKind.INTERRUPTED in [end.kind for end in part.curves[0].ends]
    assert len(part.curves[0]) < len(whole.curves[0])
    assert len(part.branches) == len(whole.branches)


@pytest.mark.parametrize("after", [1, 2])
def test_an_interruption_at_the_first_points_of_a_born_branch_ends_the_run(after, monkeypatch):
    run_born = explore.run_born

    def interrupted(*given):
        return run_born(*given[:6], interrupting(after), *given[7:])

    monkeypatch.setattr(explore, "run_born", interrupted)
    part = follow(read_scene(SCENE))
    assert part.statistics["failure"] == "interrupted"
    assert part.statistics["stopped"]


@pytest.mark.full
def test_a_branch_that_an_area_asks_for_is_not_taken_as_far_as_it_has_come(monkeypatch):
    curves = {"parameter": "r", "range": [0.28, 0.32], "cover": 1, "areas": True, "reach": 0}
    scene = read_scene(SCENE | {"curves": curves, "numerics": {"starts": 16, "rounds": 2}})
    stopping = functools.partial(continue_born, callback=interrupting(3))
    monkeypatch.setattr("contimpact.diagrams.areas.continue_born", stopping)
    assert follow(scene).statistics["failure"] == "interrupted"


MARGINS = {
    **SCENE,
    "follow": {"parameter": "s", "range": [0.33, 0.395], "orbits": ["1:1"], "switch": ["PD"]},
    "numerics": {"max_step": 0.4},
    "output": {"P": {"before_impacts": "v**2"}},
    "margins": {"tolerances": {"s": "2%"}},
}


def interrupted_margins(monkeypatch, rows, error=KeyboardInterrupt):
    """The margins of a few rows are found, and then the keyboard interrupts, or they fail."""
    left = iter(range(rows))

    class Found:
        nearest, notes = None, ()

    def margins(search):
        if next(left, None) is None:
            raise error
        return Found

    monkeypatch.setattr("contimpact.diagrams.margins.Search.margins", margins)


@pytest.mark.parametrize("error", [KeyboardInterrupt, FloatingPointError("0/0")])
def test_margins_are_kept_as_far_as_they_have_come(error, monkeypatch):
    interrupted_margins(monkeypatch, 3, error)
    part = follow(read_scene(MARGINS))
    stopped = part.statistics["stopped"]
    assert f"margins along {part.branches[-1].id}" in stopped
    assert ("0/0" in stopped) == (error is not KeyboardInterrupt)
    assert sum(np.count_nonzero(branch["margin"] == np.inf) for branch in part.branches) == 3
    assert all(np.isfinite(branch["P"]).all() for branch in part.branches)
    assert "margins are missing" in part.branches[-1].notes[-1]
    assert not part.branches[0].notes


def test_after_an_interruption_no_margins_are_sought(monkeypatch):
    interrupted_margins(monkeypatch, 0, AssertionError)
    part = follow(read_scene({**MARGINS, "numerics": SCENE["numerics"]}), stopped_at("b1, "))
    assert part.statistics["stopped"].startswith("following b1")
    assert np.isnan(part.branches[0]["margin"]).all()
    assert len(part.branches[0].notes) == 2


@pytest.mark.parametrize(
    ("module", "asked"),
    [
        ("map_explorer", {"curves": {"parameter": "r", "range": [0.2, 0.4]}}),
        ("crises", {"detect": {"events": ["PD"], "crises": True}}),
        ("margins", {"margins": MARGINS["margins"]}),
    ],
)
def test_an_interruption_while_modules_are_imported_keeps_the_branches(module, asked, monkeypatch):
    """Importing those of a map takes as long as branches do."""

    class Interrupting:
        @staticmethod
        def find_spec(name, path, target=None):
            if name.endswith(f".diagrams.{module}"):
                raise KeyboardInterrupt

    monkeypatch.delitem(sys.modules, f"contimpact.diagrams.{module}", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Interrupting, *sys.meta_path])
    small = {**MARGINS["follow"], "switch": []}
    diagram = follow({"name": "small", "model": SCENE["model"], "follow": small, **asked})
    assert diagram.statistics["failure"] == "interrupted"
    assert [branch.notation for branch in diagram.branches] == ["1:1", "1:1"]


FAILURES = [FloatingPointError("0/0"), InputError("entry", "of 0/0", "another"), ImportError("0/0")]


@pytest.mark.parametrize("error", FAILURES, ids=lambda error: type(error).__name__)
def test_a_failure_in_the_search_for_crises_keeps_the_branches(monkeypatch, error):
    def failing(*given):
        raise error

    monkeypatch.setattr("contimpact.diagrams.crises.locate_in_scene", failing)
    detect = {**SCENE["detect"], "crises": True}
    part = follow(read_scene({**SCENE, "detect": detect}))
    assert "0/0" in part.statistics["failure"]
    assert part.branches


def test_crises_before_an_interruption_are_in_the_diagram(monkeypatch):
    def interrupted(sweep, diagram, found, *given):
        found.append(NoCrisis("the first"))
        raise KeyboardInterrupt

    monkeypatch.setattr("contimpact.diagrams.crises.collect_crises", interrupted)
    detect = {**SCENE["detect"], "crises": True}
    simulate = {"values": 3, "starts": 1}
    part = follow(read_scene({**SCENE, "detect": detect, "simulate": simulate}))
    assert part.statistics["failure"] == "interrupted"
    assert "no crisis: the first" in part.statistics["notes"]
