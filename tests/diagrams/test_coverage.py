"""Maps of curves covered by lines in both directions."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from zoo import scene

from contimpact.bifurcations.codimension_two import repeat_orbit
from contimpact.diagrams.explore import follow
from contimpact.diagrams.map_lines import (
    Line,
    Lines,
    _nearby_orbit,
    passes_entry,
    run_along,
    run_on_line,
)
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.errors import InputError
from contimpact.orbits.search import find_orbits
from contimpact.page.data import remarks_in
from contimpact.progress import ignore_progress
from contimpact.results.catalogue import load_diagram, write_diagram
from contimpact.results.curve import Coverage
from contimpact.segments.kernels import Kernels
from contimpact.systems.impact_pair import ImpactPair

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

RANGES = {"A": (0.8, 40.0), "r": (0.05, 0.9)}


def map_of(beta, r=0.5, word="1:1", cover=2, **curves):
    """PD and grazing over (A, r) at s = 0.5 m, as in Figs. 6(b) and 6(d), from one value of r."""
    return scene(
        model={"system": "impact-pair", "parameters": {"beta": beta, "r": r, "A": 7.0, "s": 0.5}},
        follow={"parameter": "A", "range": list(RANGES["A"]), "orbits": [word], "switch": []},
        detect={"events": ["FB", "PD", "G"]},
        curves={"parameter": "r", "range": list(RANGES["r"]), "cover": cover, **curves},
        numerics={"starts": 32},
    )


@pytest.fixture(scope="module")
def covered():
    given = map_of(math.pi / 3)
    return given, follow(given)


def test_an_orbit_is_found_where_a_line_passes_a_branch_point():
    """The equations have no tangent there: the branch was left out, and the map incomplete."""
    model = ImpactPair(beta=0.41, r=0.47, A=6.3, s=0.5)
    orbit = next(o for o in find_orbits(model, "1:1", parameter="s") if o.physical)
    (doubling,) = continue_orbit(orbit, range=(0.3, 0.5), events=("PD",)).events
    there = repeat_orbit(doubling.orbit().linearisation)
    found = _nearby_orbit(there.problem, there.unknowns, (0.1, 1.3))
    assert np.max(np.abs(there.problem.evaluate(found).residual)) < 1e-12
    assert 1e-5 < np.max(np.abs(found - there.unknowns)) < 1e-2


@pytest.mark.full
def test_both_doublings_of_fig_6b_are_found(covered):
    """At large r a second region of 1:1 is bounded by PD curves far above the first; none of them
    passes r = 0.5."""
    _, diagram = covered
    upper = [c for c in diagram.curves if c.kind == "PD" and c["d"].max() > 0.5]
    assert upper
    assert min(c["r"].min() for c in upper) > 0.5
    assert any(c.kind == "PD" and c["r"].min() < 0.06 for c in diagram.curves)


@pytest.mark.parametrize("held", ["A", "r"])
@pytest.mark.full
def test_nothing_off_the_curves_on_other_lines(covered, held):
    given, diagram = covered
    varying = "A" if held == "r" else "r"
    kernels = Kernels(given.model, varying)
    own = Kernels(given.model, "A")
    met = 0
    for value in np.random.default_rng(5).uniform(*RANGES[held], 3):
        model = given.model.replace(**{held: value})
        searched = np.linspace(*RANGES[varying], 6)[1:-1].tolist()
        runs = run_along(given, model, given.orbits[0], kernels, RANGES[varying], searched)
        for entry in (e for run in runs for e in run.branch("b", kinds=("PD", "G")).events):
            if entry.physical:
                there = dataclasses.replace(entry, parameter="A")
                assert any(passes_entry(curve, there, given.model, own) for curve in diagram.curves)
                met += 1
    assert met >= 3


@pytest.mark.full
def test_the_statement(covered, tmp_path):
    _, diagram = covered
    told, *others = diagram.coverage
    assert told.complete
    assert not told.switched
    assert all(other.switched and other.lines == told.lines for other in others)
    assert not told.uncovered
    assert told.started > 0
    assert {"A", "r"} == {*told.lines}
    assert all(len(set(values)) == len(values) >= 2 for values in told.lines.values())
    assert "on no curve" not in str(told)
    write_diagram(diagram, tmp_path)
    assert load_diagram(tmp_path) == diagram


@pytest.mark.full
def test_curves_of_doubled_orbits(covered):
    """One begins at the PD-G of Fig. 6(b); it belongs to no branch that a line meets by search."""
    _, diagram = covered
    (point,) = (p for c in diagram.curves if c.word == "BT" for p in c.points if p.kind == "PD-G")
    (told,) = (c for c in diagram.coverage if c.notation == "1:1/2T")
    assert told.born > 0
    assert "at points of codimension two" in str(told)
    ends = [
        (c["A"][row], c["r"][row])
        for c in diagram.curves
        if (c.kind, c.word) == ("G", "BTBT")
        for row, end in zip((0, -1), c.ends, strict=True)
        if end.kind.name == "SHORTER"
    ]
    place = point.parameters["A"], point.parameters["r"]
    assert any(end == pytest.approx(place, rel=1e-12) for end in ends)


@pytest.mark.slow
def test_branches_that_lines_switch_to():
    """With `switch`, entries of the doubled orbit are met on lines as well."""
    given = map_of(math.pi / 3, cover=1)
    given = dataclasses.replace(given, switch=("PD",), depth=1)
    doubled = [c for c in follow(given).coverage if c.notation == "1:1/2T"]
    assert doubled
    assert doubled[0].entries > 0
    assert doubled[0].switched


@pytest.mark.full
def test_lines_follow_what_crosses_them_of_words_that_curves_alone_have_shown(covered):
    """Without `switch` the doubled orbit is known from curves that start at a PD-G alone."""
    _, diagram = covered
    (told,) = (c for c in diagram.coverage if c.notation == "1:1/2T")
    assert told.entries > 0
    assert told.branches > 0
    assert not told.uncovered
    assert "not searched for" in str(told)


def test_lines_do_not_follow_a_shorter_orbit_run_several_times():
    """An orbit of 1:1/2T that crosses a line beside its doubling may lead to 1:1 there, which is
    followed as such."""
    given = map_of(math.pi / 3, word="1:1/2T")
    (word,), model = given.orbits, given.model
    kernels = {name: Kernels(model, name) for name in RANGES}
    short = next(o for o in find_orbits(model, "1:1", kernels=kernels["r"]) if o.physical)
    twice = repeat_orbit(short.linearisation, 2)
    across = run_on_line(given, twice.problem, twice.unknowns, RANGES["r"])
    lines = Lines(given, model, word, kernels["A"], list, bool, str, list, ignore_progress)
    lines.laid = [Line("A", 0.5, given.start, runs=[across])]
    assert lines.carry(Line("r", 0.5, 0.55), own=True) == []


@pytest.mark.full
def test_words_that_no_line_follows_are_not_said_to_be_complete(covered):
    _, diagram = covered
    (told,) = (c for c in diagram.coverage if c.notation == "1:1/2T")
    bare = dataclasses.replace(told, branches=0, complete=False)
    assert "no line followed these orbits" in str(bare)
    assert diagram.coverage[0].branches > 0
    assert diagram.coverage[0].complete


@pytest.mark.full
def test_branches_that_lines_leave_out_are_reported():
    given = dataclasses.replace(map_of(math.pi / 3, cover=1), switch=("PD",), depth=1)
    told = follow(dataclasses.replace(given, max_branches=1)).coverage[0]
    assert told.left_out
    assert not told.complete
    assert "follow.max_branches = 1" in str(told)


@pytest.mark.parametrize("quiet", [True, False])
def test_a_map_without_orbits_that_were_not_solved_names_the_remedy(quiet):
    """More lines leave those out again that the same lines did not solve."""
    lost = ["the branch through c1 at A = 5, s = 0.3 (not solved)"]
    lines = {"s": [0.3], "A": [5.0]}
    told = Coverage({}, "BT", 1, "1:1", lines, 1, 1, [], False, 0, False, 1, lost, quiet)
    assert ("curves.cover" in str(told)) is not quiet
    assert ("curves.max_step" in str(told)) is quiet


def test_a_map_without_lines_says_what_it_did_not_look_for():
    diagram = follow(map_of(math.pi / 3, cover=0))
    (note,) = (note for note in diagram.statistics["notes"] if "curves.cover" in note)
    assert "r = 0.5" in note


@pytest.mark.full
def test_the_page_remarks_on_coverage(covered):
    _, diagram = covered
    remarks = remarks_in(diagram.statistics, diagram.coverage)
    assert [f"covered: {told}" for told in diagram.coverage] == remarks[-len(diagram.coverage) :]
    assert {str(limit) for limit in diagram.limits} <= {*remarks}


@pytest.mark.full
def test_each_curve_once(covered):
    _, diagram = covered
    compared = 0
    for one in diagram.curves:
        for entry in diagram.entries:
            if entry.id == one.origin:
                compared += 1
                there = [c for c in diagram.curves if c.kind == entry.kind]
                own = Kernels(covered[0].model, "A")
                assert sum(passes_entry(c, entry, covered[0].model, own) for c in there) == 1
    assert compared == len(diagram.curves) > 1


@pytest.mark.slow
def test_a_map_without_an_orbit_at_its_own_value():
    """At s = 0.5 m there is no 2:1 orbit at A = 7 and r = 0.5."""
    diagram = follow(map_of(math.pi / 6, word="2:1", cover=1))
    assert {"PD", "G"} <= {c.kind for c in diagram.curves}
    with pytest.raises(InputError, match="no BBT orbit was found"):
        follow(map_of(math.pi / 6, word="2:1", cover=0))


@pytest.mark.full
def test_a_map_without_orbits_says_where_they_were_looked_for():
    given = map_of(math.pi / 6, word="2:1", cover=1)
    curves = dataclasses.replace(given.curves, range=(0.49, 0.51))
    with pytest.raises(InputError, match=r"nor at [1-9]"):
        follow(dataclasses.replace(given, range=(6.9, 7.1), curves=curves))


@pytest.mark.full
def test_ghosts_of_unphysical_orbits_are_followed_but_not_asked_of_lines():
    """There is no end to unphysical orbits: curves of theirs start at runs, of the kinds named."""
    given = map_of(math.pi / 6, word="2:1", cover=1, reach=0, unphysical=["PD"], start=[0.2])
    diagram = follow(dataclasses.replace(given, starts=16, range=(3.0, 12.0)))
    ghosts = [c for c in diagram.curves if not c["physical"].any()]
    assert {c.kind for c in ghosts} == {"PD"}
    assert {c.word for c in diagram.curves} == {"BBT"}  # the scene's, which reaches for no other
    (told,) = diagram.coverage
    assert told.complete
    assert not told.uncovered
