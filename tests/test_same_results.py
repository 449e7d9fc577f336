"""The comparison of results finds and names what differs, and accepts what it should."""

from __future__ import annotations

import copy
import json
import math
import shutil
from pathlib import Path

import pytest
import same_results
from differences import Difference, differences, flat, results, table
from reordered import Judge, close
from same_results import BRANCHES, Tally

STOP = BRANCHES / "stop"


@pytest.fixture
def altered(tmp_path):
    """``altered(change)``: the committed catalogue of a scene, changed."""

    def make(change):
        data = json.loads((STOP / "catalogue.json").read_text(encoding="utf-8"))
        change(data)
        (tmp_path / "catalogue.json").write_text(json.dumps(data), encoding="utf-8")
        return tmp_path / "catalogue.json"

    return make


def found(path: Path) -> list[Difference]:
    return differences(path.name, table(STOP / path.name), table(path))


def moved(ulps):
    """Move the last digits of the first event's value."""

    def change(data):
        values = data["entries"][0]["parameters"]
        for _ in range(ulps):
            values["a"] = math.nextafter(values["a"], math.inf)

    return change


def test_the_same_is_the_same(altered):
    assert found(altered(lambda data: None)) == []


def test_a_changed_last_digit_is_found(altered):
    (one,) = found(altered(moved(1)))
    assert one.place == "entries/e1/parameters/a"
    assert one.ulps == 1
    assert one.share == pytest.approx(math.ulp(one.old) / one.stated)
    assert "1 ulp" in str(one)
    assert repr(one.old) in str(one)
    assert repr(one.new) in str(one)


def test_a_removed_event_is_named_once(altered):
    one, other = found(altered(lambda data: data["entries"].pop(1)))
    assert str(one) == "catalogue.json: entries/e2: missing"
    assert other.place == "entries/order"


def test_an_added_key_is_named(altered):
    (one,) = found(altered(lambda data: data["entries"][0].update(colour="red")))
    assert str(one) == "catalogue.json: entries/e1/colour: new"


def test_a_swapped_order_is_found(altered):
    (one,) = found(altered(lambda data: data["entries"].reverse()))
    assert (one.place, one.old, one.new) == ("entries/order", "e1 e2 e3", "e3 e2 e1")


@pytest.mark.parametrize(
    ("key", "value"), [("label", "PD"), ("stable", False), ("n_unstable", 1.0), ("wall", "B")]
)
def test_a_changed_text_truth_or_type_is_found(altered, key, value):
    (one,) = found(altered(lambda data: data["entries"][0].update({key: value})))
    assert one.place == f"entries/e1/{key}"
    assert one.new == value


def test_volatile_keys_are_set_aside(altered):
    assert found(altered(lambda data: data.update(seconds={"total": 1.0}, sha256="f"))) == []


TABLE = "# {}\nt1,reason,event\n0.0,,\n-0.0,touches,e1\n1e-07,nan,\n"


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("-0.0,touches", "0.0,touches", "row 2/t1"),
        ("1e-07", "1e-7", "row 3/t1"),
        ("touches", "passes", "row 2/reason"),
        ("t1,reason", "t2,reason", "columns"),
        ("1e-07,nan,\n", "", "row 3"),
    ],
)
def test_tables_are_compared_cell_by_cell(tmp_path, old, new, place):
    before, after = tmp_path / "before.csv", tmp_path / "after.csv"
    before.write_text(TABLE, encoding="utf-8")
    after.write_text(TABLE.replace(old, new), encoding="utf-8")
    assert differences("b1.csv", table(before), table(before)) == []
    places = [one.place for one in differences("b1.csv", table(before), table(after))]
    assert place in places


def accepted(path: Path, digits: dict[str, str]) -> list[bool]:
    judge = Judge(digits)
    old, new = table(STOP / path.name), table(path)
    return [judge.accepts(one, old, new) for one in found(path)]


def test_reordered_values_are_right_to_their_stated_error(altered):
    entry = json.loads((STOP / "catalogue.json").read_text(encoding="utf-8"))["entries"][0]
    exact = {"e1": repr(entry["parameters"]["a"])}
    allowed = int(entry["error"] / math.ulp(entry["parameters"]["a"]))
    assert accepted(altered(moved(allowed)), exact) == [True]
    assert accepted(altered(moved(allowed + 1)), exact) == [False]
    assert accepted(altered(moved(2 * allowed)), {}) == [True]
    assert accepted(altered(moved(2 * allowed + 2)), {}) == [False]


def test_events_that_did_not_move_are_checked_too():
    cells = table(STOP / "catalogue.json")
    (one,) = Judge({"e1": "0.1073"}).wrong("catalogue.json", cells)
    assert one.place == "entries/e1/parameters/a"


@pytest.mark.parametrize(
    ("key", "value"), [("stable", False), ("label", "~FB"), ("arclength", 2.0), ("error", 1e-9)]
)
def test_what_no_rounding_explains_is_refused(altered, key, value):
    path = altered(lambda data: data["entries"][0].update({key: value}))
    assert accepted(path, {}) == [False]


def test_large_multipliers_agree_by_their_reciprocals(altered):
    def first(multiplier):
        return altered(lambda data: data["entries"][0]["multipliers"].__setitem__(0, multiplier))

    assert accepted(first([-1.00000000001, 0.0]), {}) == [True]
    assert accepted(first([-1.000000001, 0.0]), {}) == [False]
    assert close("e1/multiplier1_re", -2.8e16, math.inf)
    assert close("e1/multiplier1_re", 5849.524535, 5849.524538)
    assert not close("e1/multiplier1_re", 5.0, math.inf)
    assert not close("e1/velocity1", 5849.524535, 5849.524538)


def test_irregular_motion_is_compared_by_its_kind(tmp_path):
    before, after = tmp_path / "before.csv", tmp_path / "after.csv"
    before.write_text("kind,exponent1\ncomplex,0.5\nperiodic,-0.5\n", encoding="utf-8")
    after.write_text("kind,exponent1\ncomplex,0.6\nperiodic,-0.4\n", encoding="utf-8")
    old, new = table(before), table(after)
    (one,) = Judge({}).refused("sweep.csv", differences("sweep.csv", old, new), old, new)
    assert one.place == "row 2/exponent1"


@pytest.mark.parametrize(("residual", "accepted"), [("9e-10", True), ("2e-09", False)])
def test_residuals_scatter_as_much_as_along_their_branch(tmp_path, residual, accepted):
    before, after = tmp_path / "before.csv", tmp_path / "after.csv"
    before.write_text("t1,residual\n0.5,1e-12\n0.6,1e-09\n", encoding="utf-8")
    after.write_text(f"t1,residual\n0.5,{residual}\n0.6,1e-09\n", encoding="utf-8")
    old, new = table(before), table(after)
    found = differences("branches/b1.csv", old, new)
    assert (not Judge({}).refused("branches/b1.csv", found, old, new)) is accepted


def test_transitions_of_irregular_motion_are_compared_by_their_names():
    def refused(kind, **changes):
        side = {"kind": kind, "value": 0.5}
        old = {"transitions": [{"label": "TG", "before": side, "after": side, "width": 1e-3}]}
        new = copy.deepcopy(old)
        new["transitions"][0].update(changes)
        tables = [dict(flat(data, "")) for data in (old, new)]
        return Judge({}).refused(
            "transitions.json", differences("transitions.json", *tables), *tables
        )

    assert not refused("complex", width=2e-3)
    assert refused("complex", label="G")
    assert refused("periodic", width=2e-3)


def test_numbers_within_texts_may_end_otherwise(altered):
    def end(message):
        return altered(lambda data: data["branches"][0]["ends"][0].update(message=message))

    text = json.loads((STOP / "catalogue.json").read_text(encoding="utf-8"))
    message = text["branches"][0]["ends"][0]["message"]
    assert message.endswith("a = 1.5")
    assert accepted(end(message + "0000001"), {}) == [True]
    assert accepted(end(message + "1"), {}) == [False]
    assert accepted(end("did not reach" + message), {}) == [False]


def test_a_missing_file_counts(tmp_path, capsys):
    tally = Tally()
    tally.add("stop", results(STOP), results(tmp_path))
    assert tally.refused > 0
    assert "missing" in capsys.readouterr().out


def test_tallies_say_what_was_compared(altered, capsys):
    tally = Tally()
    files = {"catalogue.json": altered(moved(3))}
    tally.add("stop", {"catalogue.json": STOP / "catalogue.json"}, files)
    assert "numbers, 1 differ, by at most 3 ulp, " in str(tally)
    assert "entries/e1/parameters/a" in capsys.readouterr().out
    assert tally.refused == 1


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """``recorded(name, **files)``: the results of a run, plain and compiled, as recorded."""
    monkeypatch.setitem(same_results.MODES, "compiled", "always")

    def make(name, plain, compiled):
        for mode, path in (("plain", plain), ("compiled", compiled)):
            folder = tmp_path / name / mode / "stop" / "run"
            folder.mkdir(parents=True)
            shutil.copy(path, folder)
        return str(tmp_path / name)

    return make


def test_recordings_are_compared(recorded, altered, capsys):
    path = STOP / "catalogue.json"
    old, new = recorded("old", path, path), recorded("new", path, path)
    assert same_results.main(["compare", old, "stop", "--with", new]) == 0
    assert capsys.readouterr().out.endswith("numbers, all the same\n")
    other = recorded("other", altered(moved(1)), path)
    assert same_results.main(["compare", old, "stop", "--with", other]) == 1
    printed = capsys.readouterr().out
    assert "stop, run, plain: catalogue.json: entries/e1/parameters/a: " in printed
    assert "stop, run, compiled, against plain: catalogue.json: entries/e1/parameters/a" in printed
    assert same_results.main(["compare", old, "stop", "--with", old, "--reordered"]) == 0
    assert same_results.main(["compare", old, "stop", "--with", other, "--reordered"]) == 1


def test_scenes_are_checked(capsys):
    with pytest.raises(SystemExit):
        same_results.main(["compare", "branches", "fig99"])
    assert "no scene fig99" in capsys.readouterr().err


LONG = ["coco_bang_bang", "fig3a", "fig3b", "fig3c", "fig3d", "fig6_s"]
LONG += ["fig6_A", "fig6a", "fig6b", "fig6c", "fig6d", "fig7", "fig8"]
"""They take twenty seconds or more."""
ONE_SIDED = ["soft_pair_friction"]
"""The multipliers at a V jump, and the sign of a velocity of 1e-17 says which one is given."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name in LONG + ONE_SIDED else pytest.mark.full)
        for name in same_results.SCENES
    ],
)
def test_committed_results_are_made_again(name):
    """To their stated errors: other machines round otherwise."""
    assert same_results.main(["compare", str(BRANCHES), name, "--reordered"]) == 0
