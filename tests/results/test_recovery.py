"""From records back to orbits: rows and entries, just computed, loaded, or pickled."""

from __future__ import annotations

import dataclasses
import json
import math
import pickle

import numpy as np
import pytest
from zoo import scene_table

import contimpact as ci
from contimpact import InputError
from contimpact.cli import main
from contimpact.results.branch import model_at

LIMITS = (0.08, 1.05)
KINDS = ["FB", "PD", "G"]
SCENE = scene_table(
    name="pair",
    follow={"range": list(LIMITS), "switch": ["G", "PD"], "depth": 2},
    detect={"events": KINDS},
)


class OwnPair(ci.ImpactPair):
    """A system of one's own, found by its name while its module is imported."""

    SYSTEM = "own-pair"


def orbit_of(kind, **given):
    model = kind(**{"beta": math.pi / 6, "r": 0.3, "A": 5.0, "s": 0.34} | given)
    return next(o for o in ci.find_orbits(model, "1:1", parameter="s") if o.physical)


@pytest.fixture(scope="module")
def orbit():
    return orbit_of(ci.ImpactPair)


@pytest.fixture(scope="module")
def scene():
    return ci.read_scene(SCENE)


@pytest.fixture(scope="module")
def live(scene):
    return ci.follow(scene)


@pytest.fixture(scope="module")
def loaded(live, tmp_path_factory):
    folder = tmp_path_factory.mktemp("recovery")
    ci.write_diagram(live, folder)
    return ci.load_diagram(folder)


@pytest.fixture(params=["live", "loaded", "pickled"])
def diagram(request, live, loaded):
    kinds = {"live": live, "loaded": loaded}
    return kinds.get(request.param) or pickle.loads(pickle.dumps(loaded))


def values(branch):
    return sorted((e.kind, round(e.value, 11)) for e in branch.events)


# Entries.


@pytest.mark.quick(1)
def test_an_entry_gives_its_orbit(diagram):
    for entry in diagram.entries:
        orbit = entry.orbit()
        assert orbit.residual < 1e-12
        assert (str(orbit.word.walls), orbit.word.period) == (entry.word, entry.period)
        assert orbit.parameters == pytest.approx(dict(entry.parameters), rel=1e-15)
        assert orbit.velocities.tolist() == [i["velocity"] for i in entry.impacts]
        assert np.array_equal(diagram.orbit(entry.id).unknowns, orbit.unknowns)
        assert np.array_equal(diagram[entry.branch].orbit(entry.id).unknowns, orbit.unknowns)


@pytest.mark.parametrize("name", ["FB", "PD", "~G[1:1->2:1]"])
@pytest.mark.quick(3)
def test_an_entry_is_continued_to_its_own_branch(diagram, name):
    branch = diagram["b1"]
    entry = next(e for e in branch.events if e.label == name)
    for start in (entry, (branch, entry.id), (diagram, entry.id)):
        again = ci.continue_orbit(start, "s", LIMITS, events=KINDS)
        assert values(again) == values(branch)


def test_a_branch_point_is_continued_along_its_own_branch():
    start = orbit_of(ci.ImpactPair, beta=0.0, s=0.5)
    branch = ci.continue_orbit(start, range=(0.1, 1.2), events=["BP", "FB"])
    crossing = next(e for e in branch.events if e.kind == "BP")
    for given in (crossing, (branch, crossing.id)):
        again = ci.continue_orbit(given, "s", (0.1, 1.2), events=["BP", "FB"])
        assert values(again) == values(branch)


def test_an_entry_of_an_earlier_version_asks_for_its_model(live, loaded, tmp_path, orbit):
    record = dataclasses.asdict(live["e1"])
    del record["system"], record["options"]
    content = {"schema": "contimpact.catalogue/1", "entries": [record]}
    (tmp_path / "catalogue.json").write_text(json.dumps(content), encoding="utf-8")
    (entry,) = ci.load_entries(tmp_path)
    with pytest.raises(InputError, match="does not say of what system"):
        entry.orbit()
    assert entry.orbit(orbit.model).residual < 1e-12
    assert ci.continue_orbit(entry, "s", LIMITS, events=KINDS, model=orbit.model).events


def test_a_damaged_entry_is_refused(live):
    entry = live["e1"]
    cut = [{"wall": "B", "time": 0.1}, entry.impacts[1]]
    for damaged in ({"impacts": cut}, {"impacts": entry.impacts[:1]}):
        with pytest.raises(InputError, match="1 impacts of the word 'BT'"):
            dataclasses.replace(entry, **damaged).orbit()
    moved = dict(entry.parameters, s=0.5)
    with pytest.raises(InputError, match="no orbit of this model"):
        dataclasses.replace(entry, parameters=moved).orbit()


# Rows.


def test_a_row_gives_its_orbit(diagram):
    for branch in diagram.branches[:4]:
        for row in range(-1, len(branch), 7):
            orbit = branch.orbit(row)
            assert orbit.residual == pytest.approx(branch["residual"][row], abs=1e-14)
            assert orbit.residual < 1e-11
            assert np.array_equal(orbit.velocities, branch.velocities[row])
            assert np.array_equal(orbit.times, branch.times[row])
            assert orbit.parameters == {n: branch[n][row] for n in branch.parameters}
            if branch["event"][row] == "":
                assert (orbit.stable, orbit.physical) == (branch.stable[row], branch.physical[row])


@pytest.mark.parametrize("row", [0, 3, 40, -1])
@pytest.mark.quick(4)
def test_a_row_is_continued_to_its_own_branch(diagram, row):
    branch = diagram["b2"]
    for start in (branch.orbit(row), (branch, row), (branch, np.int64(row))):
        again = ci.continue_orbit(start, "s", LIMITS, events=KINDS)
        assert values(again) == values(branch)


def test_a_row_is_followed_in_another_parameter(loaded):
    branch = ci.continue_orbit(loaded["b1"].orbit(5), "r", (0.1, 0.5), events=[])
    assert branch.parameter == "r"
    assert np.ptp(branch["s"]) == 0.0


# Systems of one's own.


@pytest.mark.full
def test_a_system_of_ones_own_is_found_by_its_name():
    branch = ci.continue_orbit(orbit_of(OwnPair), range=(0.32, 0.35), events=["G"])
    (grazing,) = branch.events
    assert grazing.system == branch.system == "own-pair"
    assert type(grazing.orbit().model) is type(branch.orbit(0).model) is OwnPair
    unknown = dataclasses.replace(grazing, system="nobody's")
    with pytest.raises(InputError, match="0 imported classes are the system"):
        unknown.orbit()
    assert unknown.orbit(branch.orbit(0).model).residual < 1e-12


def test_a_class_defined_anew_takes_the_place_of_the_earlier_one(live):
    kinds = []
    for _ in range(2):

        class Anew(ci.ImpactPair):
            SYSTEM = "anew"

        kinds.append(Anew)
    branch = dataclasses.replace(live["b1"], system="anew")
    assert type(model_at(branch, 0)) is kinds[1]

    class Another(ci.ImpactPair):
        SYSTEM = "anew"

    with pytest.raises(InputError, match="2 imported classes are the system 'anew'"):
        model_at(branch, 0)
    assert Another.SYSTEM == "anew"


# What is refused.


def test_what_is_no_orbit_is_refused_with_what_would_do(orbit, live):
    branch = live["b1"]
    refused = [
        (None, "found None"),
        ([orbit], "a list of 1, not one of its orbits"),
        ([orbit, orbit], "a list of 2"),
        (branch, f"the branch b1, which has {len(branch)} orbits"),
        (live, "the diagram pair"),
        ("1:1", "found '1:1'"),
        (orbit.model, "found ImpactPair"),
        ((live, 3), "found"),
        ((branch, "e99"), "no event 'e99'"),
        ((branch, 10**6), "no row 1000000"),
        ((branch, 1.5), "found 1.5"),
        ((branch, None), "found None"),
        ((live, "e99"), "nothing is called 'e99'"),
        ((live, "b1"), "b1 has many orbits"),
    ]
    for given, found in refused:
        with pytest.raises(InputError) as error:
            ci.continue_orbit(given, "s", LIMITS)
        assert found in error.value.found
        assert error.value.accepted
    with pytest.raises(InputError, match="model: found"):
        ci.continue_orbit(live["e1"], "s", LIMITS, model="impact-pair")
    with pytest.raises(InputError, match="range: missing; give"):
        ci.continue_orbit(live["e1"])


# One order of arguments.


@pytest.mark.full
def test_entry_first_and_the_model_where_it_is_needed(live, orbit):
    entry, model = live["e1"], orbit.model
    born = [
        ci.continue_born(entry, model, LIMITS, events=KINDS),
        ci.continue_born(model, entry, LIMITS, events=KINDS),
        ci.continue_born(entry, range=LIMITS, events=KINDS),
    ]
    assert born[0] == born[1] == born[2]
    ranges = {"first_range": LIMITS, "second_range": (0.2, 0.4)}
    settings = ci.Settings(max_points=5)
    curves = [
        ci.follow_curve(entry, model, "r", *ranges.values(), settings=settings),
        ci.follow_curve(model, entry, "r", *ranges.values(), settings=settings),
        ci.follow_curve(entry, second="r", **ranges, settings=settings),
    ]
    assert curves[0] == curves[1] == curves[2]


def test_what_a_curve_needs_is_said(live):
    entry = live["e1"]
    for given, where in (
        ((None,), "entry"),
        ((entry,), "parameter"),
        ((entry, None, "r"), "range of s"),
        ((entry, None, "r", LIMITS), "range of r"),
        ((entry, None, "r", LIMITS, 0.5), "range of r"),
        ((entry, None, "r", LIMITS, (0.4, 0.5)), "range of r"),
        ((entry, "r", LIMITS), "range of r"),  # as without a model
    ):
        with pytest.raises(InputError) as error:
            ci.follow_curve(*given)
        assert error.value.where == where
    with pytest.raises(InputError, match="range: missing; give"):
        ci.continue_born(entry)


# A diagram at a glance.


def test_a_diagram_is_shown_in_ten_lines(live):
    many = [dataclasses.replace(live["b1"], id=f"b{i}") for i in range(1, 31)]
    for diagram in (live, dataclasses.replace(live, branches=many), ci.Diagram("none", [])):
        lines = repr(diagram).splitlines()
        assert len(lines) <= 10
        assert max(map(len, lines)) <= 120
    assert "and 22 more" in repr(dataclasses.replace(live, branches=many))
    assert "1 not located" in repr(
        ci.Diagram("gap", [dataclasses.replace(live["b1"], missed=["PD between"])])
    )
    shown = repr(live).splitlines()
    assert shown[0] == f"Diagram pair: {len(live.branches)} branches, {len(live.entries)} events"
    assert "b1" in shown[1]
    assert "e2 PD" in shown[1]


def test_parts_of_a_diagram_have_names(live):
    assert live["b2"] is live.branches[1]
    assert live["e3"] is live.entry("e3") is live.entries[2]
    assert live[0] is live["b1"]
    assert live[:2] == live.branches[:2]
    for name in ("b0", None):
        with pytest.raises(InputError, match="there are b1 to"):
            live[name]


def test_a_name_that_means_several_is_refused(live):
    """Branches followed one by one count their events from e1."""
    other = dataclasses.replace(live["b1"], id="b9", events=live["b1"].events)
    twice = ci.Diagram("mine", [live["b1"], other])
    assert twice["b9"] is other
    with pytest.raises(InputError, match="2 are called 'e1'; take it from its branch"):
        twice["e1"]


@pytest.mark.full
def test_a_folder_written_from_python_is_drawn(live, tmp_path, capsys):
    ci.write_diagram(ci.Diagram("mine", [live["b1"]]), tmp_path)
    assert main(["plot", str(tmp_path)]) == 0
    assert main(["plot", str(tmp_path), "-x", "d", "-o", str(tmp_path / "d.svg")]) == 0
    assert "dimensionless" in (tmp_path / "d.svg").read_text(encoding="utf-8")
    assert (tmp_path / "diagram.png").stat().st_size > 10_000
    assert main(["plot", str(tmp_path), "-x", "nothing"]) == 2
    assert "accepted are arclength, s, d" in capsys.readouterr().err


@pytest.mark.full
def test_a_folder_of_an_unknown_system_is_drawn_without_units(live, tmp_path):
    foreign = dataclasses.replace(live["b1"], system="foreign")
    ci.write_diagram(ci.Diagram("mine", [foreign]), tmp_path)
    assert main(["plot", str(tmp_path), "-o", str(tmp_path / "s.svg")]) == 0
    assert "(m)" not in (tmp_path / "s.svg").read_text(encoding="utf-8")
