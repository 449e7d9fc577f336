"""What a run writes: the catalogue, the events, the branches, the manifest; and reading it back."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
import os
import re
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from zoo import ROOT

import contimpact
from contimpact import InputError, follow, load_diagram, load_scene, read_scene, write_diagram
from contimpact.cli import main
from contimpact.results.branch import Branch, Entry
from contimpact.results.catalogue import (
    BRANCH,
    branch_text,
    catalogue_text,
    events_text,
    read_branch,
)
from contimpact.results.diagram import Diagram
from contimpact.results.result_folder import CATALOGUE, MANIFEST, prepare_folder
from contimpact.storage import json_text, read_json, write_text

SCENE = ROOT / "branches" / "fig7" / "scene.toml"


@pytest.fixture(scope="module")
def diagram():
    return follow(load_scene(SCENE))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """An output folder of the command line, with the diagram left out."""
    path = tmp_path_factory.mktemp("catalogue") / "fig7"
    assert main(["run", str(SCENE), "-o", str(path), "--quiet", "--no-plot"]) == 0
    return path


@pytest.fixture(scope="module")
def catalogue(folder):
    return json.loads((folder / "catalogue.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def manifest(folder):
    return json.loads((folder / "manifest.json").read_text(encoding="utf-8"))


@pytest.fixture
def copied(folder, tmp_path):
    """The output folder again, to be damaged."""
    return Path(shutil.copytree(folder, tmp_path / "copy"))


# catalogue.json

NONE = type(None)
BRANCH_KEYS = {
    "id": str,
    "word": str,
    "period": int,
    "notation": str,
    "from": (str, NONE),
    "points": int,
    "ends": list,
}
ENTRY_KEYS = {
    "id": str,
    "kind": str,
    "ghost": bool,
    "label": str,
    "branch": str,
    "word": str,
    "period": int,
    "notation": str,
    "becomes": (str, NONE),
    "wall": (str, NONE),
    "flight": (int, NONE),
    "touch_time": (float, NONE),
    "parameters": dict,
    "impacts": list,
    "multipliers": list,
    "n_unstable": int,
    "stable": bool,
    "physical": bool,
    "reason": (str, NONE),
    "residual": float,
    "error": float,
    "opens": list,
}


def test_top_of_the_catalogue(catalogue):
    assert catalogue["schema"] == CATALOGUE == "contimpact.catalogue/1"
    assert catalogue["scene"] == "fig7"
    assert catalogue["branches"]
    assert catalogue["entries"]


def is_a(value, kind):
    """Whether a JSON value is of a kind; true and false are no numbers."""
    if isinstance(value, bool):
        return kind is bool or (isinstance(kind, tuple) and bool in kind)
    return isinstance(value, kind)


def test_branches_of_the_catalogue(catalogue):
    for record in catalogue["branches"]:
        for key, kind in BRANCH_KEYS.items():
            assert is_a(record[key], kind), key
        assert len(record["ends"]) == 2
        for end in record["ends"]:
            assert isinstance(end["kind"], str)
            assert isinstance(end["message"], str)
            assert end["message"]
            assert sum(isinstance(value, float) for value in end.values()) == 1
        assert len(record["word"]) >= 1
        assert record["points"] > 10


def test_entries_of_the_catalogue(catalogue):
    for record in catalogue["entries"]:
        for key, kind in ENTRY_KEYS.items():
            assert is_a(record[key], kind), key
        assert {"s", "A", "beta", "r", "d"} <= set(record["parameters"])
        assert all(type(value) is float for value in record["parameters"].values())
        assert "".join(impact["wall"] for impact in record["impacts"]) == record["word"]
        for impact in record["impacts"]:
            assert set(impact) == {"wall", "time", "velocity"}
            assert type(impact["time"]) is float
            assert type(impact["velocity"]) is float
        for multiplier in record["multipliers"]:
            assert multiplier is None or [type(part) for part in multiplier] == [float, float]


def test_names_in_the_catalogue_refer_to_something(catalogue):
    branches = {record["id"]: record for record in catalogue["branches"]}
    entries = {record["id"]: record for record in catalogue["entries"]}
    assert len(branches) == len(catalogue["branches"])
    assert len(entries) == len(catalogue["entries"])
    for record in catalogue["entries"]:
        carrier = branches[record["branch"]]
        for key in ("word", "period", "notation"):
            assert record[key] == carrier[key]
        assert set(record["opens"]) <= set(branches)
    for record in catalogue["branches"]:
        assert record["from"] is None or record["id"] in entries[record["from"]]["opens"]


def test_where_keys_do_not_apply_they_are_null(catalogue):
    for record in catalogue["entries"]:
        grazing = record["kind"] == "G"
        for key in ("becomes", "wall", "flight", "touch_time"):
            assert (record[key] is not None) == grazing
        assert (record["reason"] is None) == record["physical"]


def test_ghost_grazing_of_the_design(catalogue):
    """The entry of Fig. 7 that the format was drawn up with."""
    entry = next(e for e in catalogue["entries"] if e["label"] == "~G[1:1->2:1]")
    assert (entry["kind"], entry["ghost"], entry["stable"], entry["physical"]) == (
        "G",
        True,
        False,
        True,
    )
    assert (entry["word"], entry["period"], entry["notation"]) == ("BT", 1, "1:1")
    assert (entry["becomes"], entry["wall"], entry["flight"]) == ("BBT", "B", 0)
    assert entry["n_unstable"] == 1
    assert entry["touch_time"] == pytest.approx(0.754697, abs=1e-6)
    assert entry["parameters"]["s"] == pytest.approx(0.32844, abs=1e-5)
    assert entry["parameters"]["d"] == pytest.approx(0.204454926485485, rel=1e-13)
    times, speeds = zip(*((i["time"], i["velocity"]) for i in entry["impacts"]), strict=True)
    assert times == pytest.approx((0.11146, 1.50086), abs=1e-5)
    assert speeds == pytest.approx((0.636709, -0.449001), abs=1e-6)
    assert [m[0] for m in entry["multipliers"]] == pytest.approx([-1.5622, -0.005185], abs=1e-4)
    assert [m[1] for m in entry["multipliers"]] == [0.0, 0.0]


def test_first_impact_is_in_the_first_period(catalogue):
    for record in catalogue["entries"]:
        times = [impact["time"] for impact in record["impacts"]]
        assert 0.0 <= times[0] < 2.0
        if record["physical"]:
            assert times == sorted(times)
            assert times[-1] < times[0] + 2.0 * record["period"]
        if record["touch_time"] is not None and record["physical"]:
            flight = record["flight"]
            after = [*times, times[0] + 2.0 * record["period"]][flight + 1]
            assert times[flight] < record["touch_time"] < after


def test_reasons_count_time_as_their_entries_do(catalogue):
    """A passage was told in the clock of the branch, up to whole periods off the impacts."""
    told = r"flight (\d+) \(\w+ to \w+\) passes wall \w+ by \S+ at t = ([-+.\de]+)"
    seen = 0
    for entry in catalogue["entries"]:
        times = [impact["time"] for impact in entry["impacts"]]
        times.append(times[0] + 2.0 * entry["period"])
        for flight, time in re.findall(told, entry["reason"] or ""):
            begin, end = times[int(flight) - 1 : int(flight) + 1]
            assert begin - 1e-4 <= float(time) <= end + 1e-4
            seen += 1
    assert seen > 10


def test_no_number_that_json_does_not_have(folder):
    for name in ("catalogue.json", "manifest.json"):
        text = (folder / name).read_text(encoding="utf-8")

        def refuse(token):
            raise AssertionError(token)

        json.loads(text, parse_constant=refuse)
        assert not re.search(r"\b(NaN|Infinity|inf|nan)\b", text)
    for path in (folder / "branches").iterdir():
        head = path.read_text(encoding="utf-8").split("\n", 1)[0]
        assert not re.search(r"[ \[](NaN|-?Infinity)\b", head)


def bits(value):
    return struct.pack("<d", value)


def test_every_float_of_the_catalogue_reads_back_to_the_same_bits(diagram, catalogue):
    """The diagram computed again is the same to the last bit, so the files must be too."""
    assert len(catalogue["entries"]) == len(diagram.entries)
    for record, entry in zip(catalogue["entries"], diagram.entries, strict=True):
        for name, value in entry.parameters.items():
            assert bits(record["parameters"][name]) == bits(value)
        for got, impact in zip(record["impacts"], entry.impacts, strict=True):
            assert bits(got["time"]) == bits(impact["time"])
            assert bits(got["velocity"]) == bits(impact["velocity"])
        for got, multiplier in zip(record["multipliers"], entry.multipliers, strict=True):
            if got is not None:
                assert [bits(part) for part in got] == [bits(part) for part in multiplier]
        for name in ("residual", "error", "arclength"):
            assert bits(record[name]) == bits(getattr(entry, name))


def test_catalogue_holds_the_whole_entry(diagram, catalogue):
    """A certified radius stands there only once the entry is certified, sliding where it slides, a
    period where it is free, a state of the word `0`."""
    never = dict.fromkeys(("certified_radius", "sliding", "orbit_period", "crisis", "state"))
    for record, entry in zip(catalogue["entries"], diagram.entries, strict=True):
        absent = never if entry.scenario else never | {"scenario": None}
        assert set(record) == {field.name for field in dataclasses.fields(Entry)} - {*absent}
        assert record | absent == json.loads(json.dumps(dataclasses.asdict(entry)))


@settings(max_examples=200, deadline=None)
@given(
    value=st.recursive(
        st.one_of(st.none(), st.booleans(), st.integers(), st.text(max_size=5), st.floats()),
        lambda inner: st.one_of(
            st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=3), inner, max_size=3)
        ),
        max_leaves=8,
    )
)
def test_json_text_reads_back(value):
    def finite(part):
        if isinstance(part, float):
            return part if math.isfinite(part) else None
        if isinstance(part, list):
            return [finite(p) for p in part]
        if isinstance(part, dict):
            return {name: finite(p) for name, p in part.items()}
        return part

    got = json.loads(json_text(value))
    assert got == finite(value)
    assert repr(got) == repr(finite(value))  # signs of zero, and 1 apart from 1.0 and True


def test_lists_of_numbers_are_in_one_line():
    """Points of a polygon are many; all else has a line of its own."""
    given = {"ring": [[0.1, -2e-05], [1, 2.5]], "mixed": [1, None, "2"], "in": "[\n 1,\n 2\n]"}
    text = json_text(given)
    assert "[0.1, -2e-05],\n" in text
    assert "[1, 2.5]\n" in text
    assert len(text.splitlines()) == 2 + 4 + 5 + 1
    assert json.loads(text) == given


# events.csv


def table(text):
    return list(csv.DictReader(io.StringIO(text, newline="")))


def cell(value):
    """How a value is written in a CSV."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return str(int(value))
    return repr(value) if isinstance(value, float) else str(value)


def test_events_are_the_catalogue_flat(folder, catalogue):
    rows = table((folder / "events.csv").read_text(encoding="utf-8"))
    assert [row["id"] for row in rows] == [record["id"] for record in catalogue["entries"]]
    assert None not in rows[0]
    for row, record in zip(rows, catalogue["entries"], strict=True):
        for key, kind in ENTRY_KEYS.items():
            if kind not in (dict, list):
                assert row[key] == cell(record[key]), key
        for name, value in record["parameters"].items():
            assert row[name] == cell(value)
        for k, impact in enumerate(record["impacts"], start=1):
            assert row[f"wall{k}"] == impact["wall"]
            assert row[f"time{k}"] == cell(impact["time"])
            assert row[f"velocity{k}"] == cell(impact["velocity"])
        for k, multiplier in enumerate(record["multipliers"], start=1):
            if multiplier is not None:
                assert row[f"multiplier{k}_re"] == cell(multiplier[0])
                assert row[f"multiplier{k}_im"] == cell(multiplier[1])
        beyond = len(record["impacts"]) + 1
        assert row.get(f"wall{beyond}", "") == row.get(f"velocity{beyond}", "") == ""


def test_events_have_a_column_per_name(folder):
    head = (folder / "events.csv").read_text(encoding="utf-8").split("\n", 1)[0].split(",")
    assert len(set(head)) == len(head)
    assert head[:4] == ["id", "kind", "ghost", "label"]


def test_no_events(diagram):
    branch = dataclasses.replace(diagram.branches[0], events=[])
    empty = Diagram("empty", [branch])
    assert table(events_text(empty)) == []
    assert events_text(empty).startswith("id,kind,ghost,label,")
    assert json.loads(catalogue_text(empty))["entries"] == []


# Branches


def test_branch_files(folder, catalogue):
    names = sorted(path.name for path in (folder / "branches").iterdir())
    assert names == sorted(f"{b['id']}-{b['word'][:40]}.csv" for b in catalogue["branches"])


def test_branches_read_back_equal(folder, diagram):
    read = load_diagram(folder)
    assert read == diagram
    assert read.name == "fig7"
    assert len(read.branches) == len(diagram.branches)
    for got, branch in zip(read.branches, diagram.branches, strict=True):
        assert got == branch
        assert list(got.columns) == list(branch.columns)
        for name, values in branch.columns.items():
            assert got[name].dtype == values.dtype, name
            if values.dtype.kind == "f":
                assert got[name].tobytes() == values.tobytes(), name
        assert list(got.events) == list(branch.events)
        assert got.ends == branch.ends
        assert repr(got) == repr(branch)
    assert repr(read.entries) == repr(diagram.entries)


def test_equality_of_branches_sees_a_difference(diagram):
    """The test of the test above."""
    branch = diagram.branches[0]
    columns = dict(branch.columns)
    columns["s"] = columns["s"].copy()
    columns["s"][3] = np.nextafter(columns["s"][3], 1.0)
    assert branch != dataclasses.replace(branch, columns=columns)
    assert branch != dataclasses.replace(branch, id="b9")
    assert branch != dataclasses.replace(branch, events=list(branch.events)[1:])
    assert branch == dataclasses.replace(branch)
    assert branch != "b1"
    fewer = {name: values for name, values in branch.columns.items() if name != "t1"}
    assert branch != dataclasses.replace(branch, columns=fewer)


def test_branch_columns(diagram):
    for branch in diagram.branches:
        n = len(branch.word)
        expected = ["arclength", "beta", "r", "A", "s", "M", "omega", "g", "d", "gbar"]
        expected += [f"{name}{k}" for k in range(1, n + 1) for name in "tv"]
        assert list(branch.columns)[: len(expected)] == expected
        assert {
            "multiplier1_re",
            "multiplier1_im",
            "multiplier2_re",
            "n_unstable",
            "physical",
            "smallest_gap",
            "event",
        } <= set(branch.columns)
        assert {len(values) for values in branch.columns.values()} == {len(branch)}
        assert branch.times.shape == branch.velocities.shape == (len(branch), n)
        named = [str(name) for name in branch["event"] if name]
        assert set(named) <= {entry.id for entry in branch.events}


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan, -0.0, 5e-324, 1.0 / 3.0])
def test_any_float_in_a_column_reads_back(diagram, tmp_path, value):
    branch = diagram.branches[0]
    multiplier = branch["multiplier1_re"].copy()
    multiplier[2] = value
    odd = dataclasses.replace(branch, columns={**branch.columns, "multiplier1_re": multiplier})
    path = tmp_path / "b.csv"
    path.write_text(branch_text(odd), encoding="utf-8")
    got = read_branch(path)
    assert got == odd
    assert got["multiplier1_re"].tobytes() == multiplier.tobytes()


@pytest.mark.parametrize("text", ["", "a, b", 'say "so"', "naïve ∂B", "two\nlines", "#", "'"])
def test_any_text_in_a_branch_reads_back(diagram, tmp_path, text):
    branch = diagram.branches[0]
    reasons = branch["reason"].copy()
    reasons[1] = text
    events = [dataclasses.replace(entry, reason=text, label=text) for entry in branch.events]
    odd = dataclasses.replace(
        branch, columns={**branch.columns, "reason": reasons}, events=events, missed=[text]
    )
    path = tmp_path / "b.csv"
    write_text(path, branch_text(odd))
    assert read_branch(path) == odd


def test_infinite_multipliers_of_an_entry_read_back(diagram, tmp_path):
    branch = diagram.branches[0]
    entry = dataclasses.replace(branch.events[0], multipliers=[None, (0.5, 0.0)])
    odd = dataclasses.replace(branch, events=[entry])
    write_text(tmp_path / "b.csv", branch_text(odd))
    assert read_branch(tmp_path / "b.csv") == odd
    assert table(events_text(Diagram("x", [odd])))[0]["multiplier1_re"] == ""


def test_a_spreadsheet_can_read_a_branch(folder):
    """Without its first line the file is a plain CSV: a rectangle of cells under names."""
    for path in (folder / "branches").iterdir():
        first, rest = path.read_text(encoding="utf-8").split("\n", 1)
        assert first.startswith("# {")
        assert json.loads(first[2:])["schema"] == BRANCH
        rows = list(csv.reader(io.StringIO(rest, newline="")))
        assert {len(row) for row in rows} == {len(rows[0])}
        assert "\r" not in rest


def test_dataframe(diagram):
    pandas = pytest.importorskip("pandas")
    frame = diagram.branches[0].to_dataframe()
    assert isinstance(frame, pandas.DataFrame)
    assert list(frame.columns) == list(diagram.branches[0].columns)


# Damage


def not_read(read, *arguments, place=None):
    with pytest.raises(InputError) as caught:
        read(*arguments)
    assert "\n" not in str(caught.value)
    if place is not None:
        assert caught.value.where == str(place)
    return caught.value


HEADS = {
    "empty": "",
    "one line": "# {}",
    "binary": "\0\1\2",
    "no head": "arclength,s\n0.0,1.0\n",
    "head is no json": "# schema\narclength\n0.0\n",
    "head is a list": "# []\narclength\n0.0\n",
    "head is a number": "# 1\narclength\n0.0\n",
    "head is a text": '# "schema"\narclength\n0.0\n',
    "foreign schema": '# {"schema": "other/1"}\narclength\n0.0\n',
    "later schema": '# {"schema": "contimpact.branch/2"}\narclength\n0.0\n',
    "nothing but the schema": '# {"schema": "contimpact.branch/1"}\narclength\n0.0\n',
    "a picture": "<svg></svg>\n",
}


@pytest.mark.parametrize("text", HEADS.values(), ids=HEADS)
def test_not_a_branch(tmp_path, text):
    path = tmp_path / "b1-BT.csv"
    path.write_text(text, encoding="utf-8")
    not_read(read_branch, path, place=path)


def test_branch_that_is_not_there(tmp_path):
    assert "cannot be read" in not_read(read_branch, tmp_path / "b.csv").found
    not_read(read_branch, tmp_path)
    (tmp_path / "b.csv").write_bytes(b"# {}\xff\n")
    not_read(read_branch, tmp_path / "b.csv")


def damaged(text, how):
    lines = text.split("\n")
    if how == "a cell is no number":
        lines[5] = "x" + lines[5]
    elif how == "a cell is missing":
        lines[5] = lines[5].split(",", 1)[1]
    elif how == "a row is cut":
        lines[-2] = lines[-2][: len(lines[-2]) // 2]
    elif how == "no table":
        lines = lines[:1]
    elif how == "no rows and no names":
        lines = [lines[0], ""]
    elif how == "an empty row":
        lines.insert(6, "")
    elif how == "a head without ends":
        head = json.loads(lines[0][2:])
        del head["ends"]
        lines[0] = "# " + json.dumps(head)
    elif how == "an end of no kind":
        lines[0] = lines[0].replace('"kind": "range"', '"kind": "why not"')
    elif how == "one end":
        head = json.loads(lines[0][2:])
        head["ends"] = head["ends"][:1]
        lines[0] = "# " + json.dumps(head)
    elif how == "an entry without a key":
        head = json.loads(lines[0][2:])
        del head["events"][0]["kind"]
        lines[0] = "# " + json.dumps(head)
    elif how == "the head is cut":
        lines[0] = lines[0][: len(lines[0]) // 2]
    return "\n".join(lines)


@pytest.mark.parametrize(
    "how",
    [
        "a cell is no number",
        "a cell is missing",
        "a row is cut",
        "no table",
        "no rows and no names",
        "an empty row",
        "a head without ends",
        "an end of no kind",
        "one end",
        "an entry without a key",
        "the head is cut",
    ],
)
def test_damaged_branch(copied, how):
    path = copied / "branches" / "b1-BT.csv"
    text = path.read_text(encoding="utf-8")
    other = damaged(text, how)
    assert other != text
    path.write_text(other, encoding="utf-8")
    error = not_read(read_branch, path, place=path)
    assert "damaged" in error.found
    not_read(load_diagram, copied, place=path)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(place=st.floats(0.0, 1.0), junk=st.binary(min_size=1, max_size=3))
def test_any_damage_to_a_branch_is_refused_or_harmless(folder, tmp_path, place, junk):
    content = bytearray((folder / "branches" / "b1-BT.csv").read_bytes())
    start = int(place * (len(content) - len(junk)))
    content[start : start + len(junk)] = junk
    path = tmp_path / "b.csv"
    path.write_bytes(content)
    try:
        read = read_branch(path)
    except InputError:
        return
    assert isinstance(read, Branch)


DAMAGED_CATALOGUES = {
    "empty": "",
    "cut": '{"schema": "contimpact.catalogue/1", "sce',
    "null": "null",
    "list": "[]",
    "text": '"contimpact.catalogue/1"',
    "no schema": "{}",
    "foreign schema": '{"schema": "else/1"}',
    "later schema": '{"schema": "contimpact.catalogue/2"}',
    "not utf-8": b"\xff\xfe",
}


@pytest.mark.parametrize("content", DAMAGED_CATALOGUES.values(), ids=DAMAGED_CATALOGUES)
def test_damaged_catalogue(copied, content):
    path = copied / "catalogue.json"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    not_read(load_diagram, copied, place=path)


def test_folder_without_results(tmp_path):
    error = not_read(load_diagram, tmp_path, place=tmp_path / "catalogue.json")
    assert "contimpact run" in error.accepted
    not_read(load_diagram, tmp_path / "nowhere")
    (tmp_path / "file").write_text("")
    not_read(load_diagram, tmp_path / "file")


def test_branch_file_missing(copied):
    path = copied / "branches" / "b1-BT.csv"
    path.unlink()
    not_read(load_diagram, copied, place=path)


def test_read_json_of_another_schema(folder):
    error = not_read(read_json, folder / "manifest.json", CATALOGUE, "a catalogue")
    assert MANIFEST in error.found
    assert CATALOGUE in error.accepted


def test_load_diagram_takes_a_path_or_a_text(folder):
    assert load_diagram(str(folder)) == load_diagram(folder)


# Writing


def test_writing_twice_gives_the_same_bytes(diagram, folder, tmp_path):
    names = write_diagram(diagram, tmp_path / "again")
    for name in names:
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes(), name
    assert names == sorted(names)


def test_writing_leaves_no_temporary_file(folder):
    assert [path for path in folder.rglob("*") if path.name.startswith(".")] == []
    assert [path for path in folder.rglob("*") if path.suffix == ".tmp"] == []


def test_files_can_be_read_by_others(folder):
    for path in folder.rglob("*"):
        if path.is_file() and os.name == "posix":
            assert path.stat().st_mode & 0o444 == 0o444


def test_writing_fewer_branches_removes_the_others(diagram, tmp_path):
    write_diagram(diagram, tmp_path)
    (tmp_path / "branches" / "mine.csv").write_text("kept")
    (tmp_path / "notes.txt").write_text("kept")
    first = diagram.branches[0]
    alone = [dataclasses.replace(entry, opens=()) for entry in first.events]
    fewer = Diagram(diagram.name, [dataclasses.replace(first, events=alone)])
    write_diagram(fewer, tmp_path)
    names = {path.name for path in (tmp_path / "branches").iterdir()}
    assert names == {"b1-BT.csv", "mine.csv"}
    assert (tmp_path / "notes.txt").read_text() == "kept"
    assert load_diagram(tmp_path) == fewer


@pytest.mark.parametrize("name", ["../outside.csv", "/outside", "a/../../outside"])
def test_a_foreign_catalogue_does_not_have_files_removed_elsewhere(diagram, tmp_path, name):
    folder = tmp_path / "out"
    (folder / "branches").mkdir(parents=True)
    victim = tmp_path / "outside.csv"
    victim.write_text("kept")
    (folder / "outside-.csv").write_text("kept")
    record = {"branches": [{"id": name.removesuffix(".csv"), "word": ""}, {"id": "..", "word": ""}]}
    (folder / "catalogue.json").write_text(json.dumps(record))
    write_diagram(diagram, folder)
    assert victim.exists()
    assert (folder / "outside-.csv").exists()


@pytest.mark.parametrize("content", ["", "{", "[]", "null", '{"branches": [1]}', '{"branches": 1}'])
def test_a_damaged_catalogue_is_written_over(diagram, tmp_path, content):
    (tmp_path / "catalogue.json").write_text(content)
    write_diagram(diagram, tmp_path)
    assert load_diagram(tmp_path) == diagram


def test_a_folder_below_a_file_cannot_be_written(diagram, tmp_path):
    (tmp_path / "file").write_text("kept")
    for place in (tmp_path / "file", tmp_path / "file" / "below" / "it"):
        error = not_read(write_diagram, diagram, place, place=place)
        assert "cannot be written" in error.found
        not_read(prepare_folder, place)
    assert (tmp_path / "file").read_text() == "kept"


def test_prepare_folder(tmp_path):
    made = prepare_folder(str(tmp_path / "a" / "b"))
    assert made == tmp_path / "a" / "b"
    assert list(made.iterdir()) == []
    assert prepare_folder(made) == made


def test_write_text_is_whole_or_nothing(tmp_path):
    path = tmp_path / "file.txt"
    write_text(path, "first é\n")
    with pytest.raises(UnicodeEncodeError):
        write_text(path, "second " + "\ud800")
    assert path.read_bytes() == "first é\n".encode()
    assert [p.name for p in tmp_path.iterdir()] == ["file.txt"]


# manifest.json


def test_manifest(manifest, folder):
    assert manifest["schema"] == MANIFEST == "contimpact.manifest/1"
    assert manifest["versions"]["contimpact"] == contimpact.__version__
    assert re.fullmatch(r"3\.\d+\.\d+.*", manifest["versions"]["python"])
    assert manifest["versions"]["numpy"] == np.__version__
    assert all(isinstance(version, str) for version in manifest["versions"].values())


def test_manifest_holds_the_scene_as_given_and_resolved(manifest):
    scene = load_scene(SCENE)
    assert manifest["scene"]["given"] == scene.given
    again = read_scene(manifest["scene"]["resolved"])
    assert json.loads(json.dumps(again.resolved())) == manifest["scene"]["resolved"]
    for name in ("name", "source", "parameter", "range", "orbits", "events", "settings", "plot"):
        assert getattr(again, name) == getattr(scene, name)
    assert again.model.values == scene.model.values
    assert manifest["scene"]["resolved"]["numerics"]["tolerance"] == scene.settings.tolerance


@pytest.mark.full
def test_resolved_scene_gives_the_same_diagram(manifest, diagram):
    assert follow(read_scene(manifest["scene"]["resolved"])) == diagram


def test_manifest_counts(manifest, diagram):
    counts = manifest["counts"]
    assert {"points", "corrector_iterations", "kernel_evaluations"} <= set(counts)
    assert all(type(count) is int and count >= 0 for count in counts.values())
    rows = sum(len(branch) for branch in diagram.branches)
    assert rows - len(diagram.entries) <= counts["points"] <= rows
    assert counts["corrector_iterations"] >= counts["points"] - 2 * len(diagram.branches)
    assert counts["kernel_evaluations"] > counts["corrector_iterations"]


def test_manifest_seconds(manifest):
    seconds = dict(manifest["seconds"])
    total = seconds.pop("total")
    assert {"kernels", "search", "walk", "events", "tables", "export"} <= set(seconds)
    assert all(type(value) is float and value >= 0.0 for value in seconds.values())
    assert sum(seconds.values()) <= total


def test_manifest_kernels(manifest):
    kernels = manifest["kernels"]
    used = [*kernels["loaded"], *kernels["generated"]]
    assert len(set(used)) == len(used)
    assert {"setup", "flight_B_T", "flight_T_B", "flight_B_B"} <= set(used)


def test_manifest_says_what_was_left_out(manifest):
    text = "\n".join(manifest["left_out"])
    assert "BP, NS, V, T, UZ" in text
    assert "--no-plot" in text


def test_manifest_lists_the_files(manifest, folder):
    there = {
        path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()
    } - {"manifest.json"}
    assert set(manifest["files"]) == there
    assert manifest["files"] == sorted(manifest["files"])


def test_nothing_written_names_this_machine(folder):
    """Results can be shared: they hold no path of the machine they were computed on."""
    for path in folder.rglob("*"):
        if path.is_file():
            text = path.read_text(encoding="utf-8")
            assert str(folder) not in text
            assert str(SCENE.parent) not in text


# What is read back


def test_a_truncated_branch_is_refused(copied):
    path = next((copied / "branches").iterdir())
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(lines[:-5]), encoding="utf-8")
    assert "rows" in not_read(read_branch, path, place=path).found
    not_read(load_diagram, copied, place=path)


def test_a_branch_of_another_run_is_refused(copied):
    path = copied / "catalogue.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    content["branches"][0]["points"] += 1
    path.write_text(json.dumps(content), encoding="utf-8")
    assert "manifest.json belongs to" in not_read(load_diagram, copied, place=path).found
    (copied / "manifest.json").unlink()
    assert "rows" in not_read(load_diagram, copied).found


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
@pytest.mark.parametrize("key", ["error", "residual", "slope"])
def test_numbers_of_an_entry_that_are_not_finite_read_back(diagram, tmp_path, key, value):
    branch = diagram.branches[0]
    event = dataclasses.replace(branch.events[0], **{key: value})
    branch = dataclasses.replace(branch, events=[event, *branch.events[1:]])
    (tmp_path / "b.csv").write_text(branch_text(branch), encoding="utf-8")
    assert read_branch(tmp_path / "b.csv") == branch


def test_part_of_a_diagram_can_be_written(diagram, tmp_path):
    """Its entries open branches that are not there."""
    part = Diagram("x", diagram.branches[:1])
    assert any(entry.opens for entry in part.entries)
    write_diagram(part, tmp_path)
    assert load_diagram(tmp_path) == part


def test_events_tell_what_they_open_and_what_was_asked_for(diagram):
    entry = dataclasses.replace(
        diagram.entries[0], kind="UZ", requested={"d": 0.25}, opens=("b2", "b3")
    )
    branch = dataclasses.replace(diagram.branches[0], events=[entry])
    (row,) = csv.DictReader(io.StringIO(events_text(Diagram("x", [branch]))))
    assert row["requested"] == "d=0.25"
    assert row["opens"] == "b2 b3"


def test_ends_hold_the_value_under_one_key(catalogue):
    for record in catalogue["branches"]:
        for end in record["ends"]:
            assert set(end) == {"kind", "parameter", "message"}
            assert isinstance(end["parameter"], float)


def test_ends_of_earlier_files_are_read(diagram, tmp_path):
    branch = diagram.branches[0]
    text = branch_text(branch)
    head, rest = text.split("\n", 1)
    record = json.loads(head[2:])
    for end in record["ends"]:
        end["s"] = end.pop("parameter")
    del record["points"]
    (tmp_path / "b.csv").write_text(f"# {json.dumps(record)}\n{rest}", encoding="utf-8")
    assert read_branch(tmp_path / "b.csv") == branch


@pytest.mark.full
def test_curves_read_back_equal(tmp_path):
    scene = load_scene(SCENE.parent.parent / "fig6b" / "scene.toml")
    family = "beta", (0.3, math.pi / 6)
    quick = dataclasses.replace(
        scene.curves, start=(), cover=0, areas=False, family=family, kinds=("PD", "G")
    )
    diagram = follow(dataclasses.replace(scene, curves=quick))
    write_diagram(diagram, tmp_path)
    loaded = load_diagram(tmp_path)
    assert loaded == diagram
    assert any(curve.points for curve in loaded.curves)
    first = diagram.curves[0]
    other = dataclasses.replace(first, columns={**first.columns, "r": first["r"] + 1e-15})
    assert other != first
