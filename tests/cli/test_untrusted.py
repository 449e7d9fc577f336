"""Result folders and names from elsewhere: messages, no tracebacks; text that stays text."""

from __future__ import annotations

import csv
import dataclasses
import json
import os
import re
import shutil
import subprocess
import sys

import numpy as np
import pytest
from mutations import SCENE, SIMULATE, sealed, written

from contimpact.cli import main, say
from contimpact.errors import InputError
from contimpact.results.branch import Entry
from contimpact.results.catalogue import entry_of, load_diagram, read_branch, write_diagram
from contimpact.results.formats import markdown_cell
from contimpact.schema import build_record
from contimpact.storage import csv_text, json_line, json_text, unescape_text

ESCAPE = "\x1b]0;title\x07\x1b[31m\x9b\u202e\0"


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of a run and of a simulation."""
    base = tmp_path_factory.mktemp("results")
    run, simulated = (written(s, base / f"{n}.toml") for n, s in SCENES.items())
    assert main(["run", run, "-o", str(base / "run"), "-q"]) == 0
    assert main(["simulate", simulated, "-o", str(base / "simulated"), "-q"]) == 0
    return base


SCENES = {"run": SCENE, "simulated": SCENE | {"simulate": SIMULATE}}


@pytest.fixture
def folder(results, tmp_path):
    return shutil.copytree(results / "run", tmp_path / "run")


@pytest.fixture
def refused(capsys):
    def call(*arguments, says):
        assert main([*map(str, arguments)]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1
        assert says in error

    return call


def branch_of(folder):
    return sorted((folder / "branches").iterdir())[0]


def edited(path, change):
    """Change a file's JSON: all of it, or the record in the first line of a table."""
    text = path.read_text(encoding="utf-8")
    first, rest = (text, "") if path.suffix == ".json" else text[2:].split("\n", 1)
    content = json.loads(first)
    change(content)
    new = json.dumps(content)
    path.write_text(new if path.suffix == ".json" else f"# {new}\n{rest}", encoding="utf-8")
    sealed(path.parent if path.suffix == ".json" else path.parent.parent)


# Forged tables and records


def cell(path, name, content, row=3):
    """Write one cell of a branch's table."""
    head, *lines = path.read_text(encoding="utf-8").split("\n")
    lines[row] = lines[row].split(",")
    lines[row][lines[0].split(",").index(name)] = content
    lines[row] = ",".join(lines[row])
    path.write_text("\n".join([head, *lines]), encoding="utf-8")
    sealed(path.parent.parent)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("reason", '"' + "x" * 200_000 + '"', "field larger than"),
        ("n_unstable", "9" * 30, "damaged (OverflowError"),
        ("n_unstable", "9" * 5000, "damaged (ValueError"),
        ("s", "nan", "s is not finite everywhere"),
        ("v1", "inf", "v1 is not finite everywhere"),
        ("t2", "1,2", "damaged"),
    ],
)
def test_forged_cells(folder, refused, name, content, says):
    cell(branch_of(folder), name, content)
    refused("plot", folder, says=says)


@pytest.mark.parametrize("column", ["v2", "t1", "s", "physical", "arclength"])
def test_missing_columns(folder, refused, column):
    path = branch_of(folder)
    head, names, rest = path.read_text().split("\n", 2)
    names = ",".join("other" if name == column else name for name in names.split(","))
    path.write_text("\n".join([head, names, rest]))
    sealed(folder)
    refused("plot", folder, says=f"no column {column}")


def forged(**changes):
    def change(record):
        for entry in record.get("events", record.get("entries")):
            entry.update(changes)

    return change


@pytest.mark.parametrize("notation", ["$\\frac{", "$a$b$", "\\", "x" * 100_000, ESCAPE, "\ud800"])
@pytest.mark.parametrize("key", ["notation", "label", "kind"])
@pytest.mark.quick(1)
def test_texts_of_entries_are_drawn_as_texts(folder, tmp_path, key, notation):
    edited(branch_of(folder), forged(**{key: notation, "ghost": True}))
    edited(branch_of(folder), lambda r: r["events"][0].update(notation="1:1", kind="PD"))
    assert main(["plot", str(folder), "-o", str(tmp_path / "a.svg")]) == 0


@pytest.mark.parametrize(
    ("key", "content"),
    [
        ("parameters", None),
        ("parameters", {}),
        ("parameters", {"s": "x"}),
        ("parameters", []),
        ("impacts", 3),
        ("impacts", [{}]),
        ("impacts", [{"wall": "B", "velocity": None}]),
        ("multipliers", [[1]]),
        ("n_unstable", 10**30),
        ("n_unstable", True),
        ("label", 1),
        ("physical", "yes"),
        ("period", 1.5),
        ("opens", "b2"),
        ("word", None),
        ("error", "x"),
    ],
)
def test_forged_entries(folder, refused, tmp_path, key, content):
    edited(branch_of(folder), forged(**{key: content}))
    refused("plot", folder, says="damaged")
    edited(folder / "catalogue.json", forged(**{key: content}))
    refused("catalogue", folder, "-o", tmp_path / "out", says="damaged")
    assert not (tmp_path / "out").exists()


def test_entries_without_parameters(folder, refused, tmp_path):
    edited(folder / "catalogue.json", lambda c: c["entries"][0].pop("parameters"))
    refused("catalogue", folder, "-o", tmp_path / "out", says="without parameters")


def test_words_of_other_walls(folder, refused):
    """Five walls had no colour; a system's walls are known."""
    edited(branch_of(folder), lambda r: r.update(word="XY"))
    edited(folder / "catalogue.json", lambda c: c["branches"][0].update(word="XY"))
    branch_of(folder).rename(folder / "branches" / "b1-XY.csv")
    refused("plot", folder, says="has the walls B, T")


@pytest.mark.parametrize("name", ["../b1", "/etc/passwd", "b1\0", "", "a b"])
def test_names_of_files_lead_nowhere_else(folder, refused, name):
    edited(folder / "catalogue.json", lambda c: c["branches"][0].update(id=name))
    refused("plot", folder, says="in the name of a file")


def test_deep_records(folder, refused, tmp_path):
    deep = json.loads("[" * 300 + "]" * 300)
    edited(folder / "catalogue.json", forged(extra=deep))
    refused("catalogue", folder, "-o", tmp_path / "out", says="nested too deeply")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
@pytest.mark.parametrize("name", ["catalogue.json", "manifest.json", "branches/b1-BT.csv"])
def test_a_pipe_in_place_of_a_file(folder, refused, name):
    (folder / name).unlink()
    os.mkfifo(folder / name)
    refused("plot", folder, says="not a plain file")


def test_entries_of_earlier_versions_are_read(results):
    """Keys that came later, and numbers written as texts or null."""
    record = json.loads((results / "run" / "catalogue.json").read_text())["entries"][0]
    for key in ("criticality", "order", "slope", "opens", "multipliers_before", "error"):
        del record[key]
    entry = entry_of(record | {"residual": "inf", "arclength": None})
    assert (entry.criticality, entry.error, entry.opens) == (None, None, ())
    assert entry.residual == float("inf")


def test_records_become_what_they_were(results):
    """Every entry of a catalogue passes, and nothing is lost on the way."""
    for record in json.loads((results / "run" / "catalogue.json").read_text())["entries"]:
        entry = entry_of(record)
        written = json.loads(json_text(dataclasses.asdict(entry)))
        # Written where they are.
        for name in ("certified_radius", "crisis", "sliding", "orbit_period", "state"):
            assert written.pop(name) is None
        if "scenario" not in record:
            assert written.pop("scenario") is None
        assert written == record
        assert build_record(Entry, vars(entry)).id == record["id"]


# Resuming


@pytest.mark.parametrize(
    "line",
    [
        "[" * 100_000 + "]" * 100_000,
        '{"row": ' + "[" * 100_000,
        "[]",
        "1",
        "null",
        '"row"',
        "{}",
        '{"tried": "x"}',
        '{"tried": []}',
        '{"row": {}}',
        '{"row": []}',
        '{"changes": [1]}',
        '{"changes": [], "direction": [], "value": 1}',
        '{"tried": ' + "9" * 5000 + "}",
        "\ud800",
    ],
    ids=lambda line: line[:20],
)
def test_forged_lines_on_resume(results, tmp_path, refused, line):
    folder = shutil.copytree(results / "simulated", tmp_path / "out")
    with open(folder / "rows.jsonl", "ab") as file:
        file.write(line.encode(errors="surrogatepass") + b"\n")
    command = ("simulate", results / "simulated.toml", "-o", folder, "--resume")
    refused(*command, says="leave --resume out to begin anew")


@pytest.mark.parametrize(
    "change",
    [
        lambda a: a.update(walls=[7]),
        lambda a: a.update(times=[[0.1]]),
        lambda a: a.pop("kind"),
        lambda a: a.update(kind="NOBODY"),
        lambda a: a["parameters"].pop("s"),
        lambda a: a["state"].update(phase=1e300),
        lambda a: a["state"].update(wall=-1),
        lambda a: a["state"].update(turns=10**30),
        lambda a: a.update(velocities=["x"]),
        lambda a: a.update(velocities=[float("nan")] * len(a["walls"])),
        lambda a: a.update(word=1),
        lambda a: a.update(multipliers=[1, 2, 3]),
        lambda a: a.update(exponents=[1]),
    ],
)
def test_forged_rows_on_resume(results, tmp_path, refused, change):
    folder = shutil.copytree(results / "simulated", tmp_path / "out")
    head, first, *rest = (folder / "rows.jsonl").read_text().splitlines()
    record = json.loads(first)
    change(record["row"]["attractor"])
    (folder / "rows.jsonl").write_text("\n".join([head, json.dumps(record), *rest]) + "\n")
    command = ("simulate", results / "simulated.toml", "-o", folder, "--resume")
    refused(*command, says="damaged")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names")
def test_a_pipe_to_resume_from(results, tmp_path, refused):
    os.mkfifo(tmp_path / "rows.jsonl")
    command = ("simulate", results / "simulated.toml", "-o", tmp_path, "--resume")
    refused(*command, says="not a plain file")


# Text


def test_what_is_said(capsys):
    say(f"a {ESCAPE}\nb")
    said = capsys.readouterr().out
    assert said.splitlines() == ["a \\x1b]0;title\\x07\\x1b[31m\\x9b\\u202e\\x00", "b"]


@pytest.mark.parametrize("text", ["=1+cmd|x", "+1", "-1", "@SUM(A1)", "\t=1", "\r=1", "'", "'=1"])
def test_texts_are_no_formulas(text):
    for exact in (True, False):
        row = next(csv.reader([csv_text(["a"], [[text]], exact=exact).split("\n", 1)[1]]))
        assert row[0][0] in "'\\"
    header = next(csv.reader([csv_text([text], [], exact=True)]))[0]
    assert unescape_text(header) == text.replace("\r", "\\r")
    assert csv_text(["a"], [[-1.5, True, -2, None, "b=1"]]) == "a\n-1.5,1,-2,,b=1\n"
    assert csv_text(["a"], [[np.float64(-1.5), np.int64(2)]]) == "a\n-1.5,2\n"


def test_control_characters_in_tables():
    assert csv_text(["a"], [[ESCAPE]]) == "a\n\\x1b]0;title\\x07\\x1b[31m\\x9b\\u202e\\x00\n"
    assert csv_text(["a"], [["\ud800"]], exact=True) == "a\n\\ud800\n"


@pytest.mark.parametrize("text", [ESCAPE, "\x7f", "\x9b", "\u2028", "\ud800", "é\U0001f600"])
def test_json_shows_what_it_holds_and_reads_back(text):
    for written_text in (json_text({"a": text}), json_line({"a": text})):
        assert json.loads(written_text)["a"] == text
        assert all(c.isprintable() or c == "\n" for c in written_text)
        written_text.encode()


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("~G[1:1->2:1]", "\\~G[1:1->2:1]"),
        ("a|b", "a\\|b"),
        ("a\\|b", "a\\\\\\|b"),
        ("a\n| b |", "a\\\\n\\| b \\|"),
        ("<img src=x onerror=y>", "&lt;img src=x onerror=y>"),
        ("&lt;", "&amp;lt;"),
        ("[a](http://b)", "[a]\\(http://b)"),
        ("![a][b]", "![a]\\[b]"),
        ("`x`", "\\`x\\`"),
        (1 / 3, "0.333333333333"),
        (True, "yes"),
        (None, ""),
    ],
)
def test_markdown_cells(text, shown):
    # line breaks are escapes before the backslash of the escape is made a plain one
    assert markdown_cell(text) == shown.replace("\\\\n", "\\\\n")


def test_hostile_names_in_merged_catalogues(folder, tmp_path):
    name = "=1+cmd|' /C calc'!A0<script>\n" + ESCAPE
    edited(folder / "catalogue.json", lambda c: c.update(scene=name))
    edited(folder / "catalogue.json", forged(why="a\n|b|"))
    out = tmp_path / "out"
    assert main(["catalogue", str(folder), "-o", str(out)]) == 0
    lines = (out / "catalogues.md").read_text(encoding="utf-8").splitlines()
    entries = json.loads((out / "catalogues.json").read_text(encoding="utf-8"))["entries"]
    assert len(lines) == len(entries) + 2
    assert entries[0]["scene"] == name
    assert "<" not in "".join(lines)
    for file in out.iterdir():
        text = file.read_text(encoding="utf-8")
        assert all(c.isprintable() or c == "\n" for c in text)
    rows = list(csv.reader((out / "catalogues.csv").read_text(encoding="utf-8").splitlines()))
    assert not any(cell.startswith(("=", "+", "@", "\t")) for row in rows for cell in row)


@pytest.mark.parametrize("text", ["=1", "'", "'=1", "\x1b[31m", "a\nb", "\0", ""])
def test_hostile_texts_of_a_branch_read_back(results, tmp_path, text):
    diagram = load_diagram(results / "run")
    diagram.branches[0].columns["reason"][:] = text
    write_diagram(diagram, tmp_path)
    assert load_diagram(tmp_path) == diagram
    assert read_branch(branch_of(tmp_path))["reason"][0] == text


# Places and terminals


def python(*arguments, **environment):
    """Run contimpact in a process of its own."""
    return subprocess.run(
        [sys.executable, "-m", "contimpact", *map(os.fsencode, arguments)],
        capture_output=True,
        env=os.environ | environment,
        check=False,
    )


@pytest.mark.skipif(sys.platform != "linux", reason="names of files that are no text")
@pytest.mark.full
def test_folders_whose_names_are_not_utf8(folder, tmp_path):
    odd = folder.rename(tmp_path / os.fsdecode(b"\xff\x1b[31m"))
    assert main(["plot", str(odd)]) == 0
    assert main(["catalogue", str(odd), "-o", str(odd)]) == 0
    sources = json.loads((odd / "catalogues.json").read_text())["sources"]
    assert sources[0]["folder"] == odd.name
    said = python("plot", str(odd))
    assert said.returncode == 0
    assert said.stdout.count(b"\\udcff\\x1b[31m") == 1


@pytest.mark.full
def test_names_that_a_terminal_does_not_know(tmp_path):
    scene = written(SCENE | {"name": "naïve", "source": "∂B\x1b[31m"}, tmp_path / "scene.toml")
    said = python("check", scene, PYTHONIOENCODING="ascii")
    assert (said.returncode, said.stderr) == (0, b"")
    assert said.stdout.startswith(b"scene na\\xefve: \\u2202B\\x1b[31m")


@pytest.mark.parametrize("backend", ["nonsense", "module://nowhere", "\x1b[31m", "TkAgg"])
@pytest.mark.full
def test_backends_that_do_not_exist(folder, backend):
    said = python("plot", str(folder), MPLBACKEND=backend)
    progress = rb"[\w-]+, \d+ s: \w+"  # which a slow machine tells
    lines = said.stderr.splitlines()
    assert (said.returncode, [x for x in lines if not re.fullmatch(progress, x)]) == (0, [])
    assert (folder / "diagram.png").stat().st_size > 1000


def test_the_backend_that_was_asked_for_stays():
    code = (
        "import contimpact.plots, matplotlib, os\n"
        "print(matplotlib.rcParams['backend'], os.environ['MPLBACKEND'])"
    )
    said = subprocess.run(
        [sys.executable, "-c", code],
        env=os.environ | {"MPLBACKEND": "svg"},
        capture_output=True,
        check=True,
        text=True,
    )
    assert said.stdout == "svg svg\n"


def test_refusals_are_input_errors(tmp_path):
    with pytest.raises(InputError):
        load_diagram(tmp_path)
