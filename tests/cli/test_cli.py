"""The command line: what it does, says and writes, and how it refuses what it cannot use."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from zoo import SMALL

import contimpact
from contimpact import load_diagram
from contimpact.cli import main

SCENE = SMALL.replace("[model]\n", 'source = "a test"\n[model]\n') + '[plot]\nx = "d"\n'


NO_ORBIT = (
    "s = 0.34",
    "s = 1.04",
    "[0.3, 0.4]",
    "[1.0, 1.05]",
    "[plot]",
    "[numerics]\nstarts = 16\nrounds = 1\n[plot]",
)
"""Changes to the scene: beyond the fold at s = 0.991, where its orbits end."""


@pytest.fixture
def scene(tmp_path):
    """``scene(old, new)``: the path of the scene with some text replaced."""

    def write(*changes, name="scene.toml"):
        text = SCENE
        for old, new in zip(changes[::2], changes[1::2], strict=True):
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return str(path)

    return write


@pytest.fixture
def run(capsys):
    """``run(*arguments)``: exit status, standard output, standard error of the command line.

    Progress is left out of the latter; it has tests of its own.
    """

    def call(*arguments):
        capsys.readouterr()
        try:
            status = main([str(argument) for argument in arguments])
        except SystemExit as done:
            status = done.code
        said = capsys.readouterr()
        return status, said.out, without_progress(said.err)

    return call


def without_progress(text):
    return re.sub(r"^[\w ]+(\(\d of \d\))?, \d+ s: .*\n", "", text, flags=re.MULTILINE)


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """An output folder with everything in it."""
    folder = tmp_path_factory.mktemp("results")
    (folder / "scene.toml").write_text(SCENE, encoding="utf-8")
    assert main(["run", str(folder / "scene.toml"), "-o", str(folder / "out"), "-q"]) == 0
    return folder / "out"


@pytest.fixture
def copied(results, tmp_path):
    return Path(shutil.copytree(results, tmp_path / "copy"))


def one_line(text):
    """The message of a refusal: one line that names the program, and no traceback."""
    assert "Traceback" not in text
    assert text.startswith("contimpact: ")
    assert text.endswith("\n")
    assert text.count("\n") == 1
    assert text.count("; ") >= 1  # what was found; what would do
    return text.removeprefix("contimpact: ").rstrip("\n")


def python(*arguments, **options):
    """A Python process that sees the package as users do."""
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True,
        text=True,
        timeout=60,
        **options,
    )


def files_of(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


# check


def test_check_says_what_would_run(run, scene):
    status, out, err = run("check", scene())
    assert status == 0
    assert err == ""
    assert "scene small: a test" in out
    assert "A=5" in out
    assert re.search(r"\bd = 0\.21165\b", out)
    assert "s from 0.34 within [0.3, 0.4]" in out
    assert re.search(r"orbits +1:1 \(word BT\): 2 at the start, 1 of them unphysical", out)
    assert re.search(r"events +PD, G\n", out)
    assert re.search(r"left out .*FB, BP, NS, V, T, UZ", out)


def test_check_names_what_simulation_settles_on(run, scene):
    said = "simulation settles on BBT at s = 0.34, which is not in follow.orbits"
    assert said in run("check", scene())[1]
    assert "settles" not in run("check", scene('["1:1"]', '["1:1", "2:1"]'))[1]


def test_check_names_requested_values(run, scene):
    status, out, _ = run("check", scene("[plot]", "[detect.values]\nd = [0.2]\n[plot]"))
    assert status == 0
    assert "UZ" in out
    assert "d = 0.2\n" in out


@pytest.mark.full
def test_check_says_what_was_simulated(run, tmp_path):
    """An attractor of a soft stop that one random start of the search does not find."""
    values = {"k": 1, "c": 0.05, "a": 1, "e": 0.5, "k_b": 25, "c_b": 0.1, "omega": 1.8}
    text = 'name = "soft"\n[model]\nsystem = "soft-stop"\n[model.parameters]\n'
    text += "".join(f"{name} = {value}\n" for name, value in values.items())
    text += '[follow]\nparameter = "omega"\nrange = [1.79, 1.81]\norbits = ["CRCR/3T"]\n'
    path = tmp_path / "scene.toml"
    path.write_text(f"{text}[numerics]\nstarts = 1\nrounds = 1\n", encoding="utf-8")
    status, out, _ = run("check", path)
    assert status == 0
    assert "add 0 to follow.orbits" in out
    path.write_text(path.read_text().replace('"CRCR/3T"', '"CRCR/3T", "0"'), encoding="utf-8")
    assert "simulated" not in run("check", path)[1]


def test_check_writes_nothing(run, scene, tmp_path, monkeypatch):
    path = scene()
    monkeypatch.chdir(tmp_path)
    assert run("check", path)[0] == 0
    assert [p.name for p in tmp_path.iterdir()] == ["scene.toml"]


# run


@pytest.mark.full
def test_run_writes_the_folder_and_a_summary(run, scene, tmp_path):
    status, out, err = run("run", scene(), "--ghosts", "-o", tmp_path / "a" / "out")
    assert status == 0
    assert err == ""
    folder = tmp_path / "a" / "out"
    names = set(files_of(folder))
    assert names >= {
        "catalogue.json",
        "events.csv",
        "manifest.json",
        "diagram.svg",
        "diagram.png",
        "branches/b1-BT.csv",
    }
    assert not any(Path(name).name.startswith(".") for name in names)
    diagram = load_diagram(folder)
    for branch in diagram.branches:
        assert re.search(rf"^{branch.id} +{branch.notation} ", out, re.MULTILINE)
        for end in branch.ends:
            assert end.message in out
    for entry in diagram.entries:
        assert re.search(rf"{entry.id} +{re.escape(entry.label)} +s = {entry.value:.12g}", out)
    assert str(folder) in out.splitlines()[-1]


@pytest.mark.full
def test_quiet(run, scene, tmp_path):
    assert run("run", scene(), "-o", tmp_path / "out", "--quiet") == (0, "", "")
    assert (tmp_path / "out" / "manifest.json").exists()


def test_quiet_still_says_errors(run, scene, tmp_path):
    status, out, err = run("run", scene("r = 0.3", "r = 3"), "-o", tmp_path / "out", "-q")
    assert (status, out) == (2, "")
    one_line(err)


@pytest.mark.full
def test_progress_in_a_file_has_no_escape_sequences(results):
    scene_file = results.parent / "scene.toml"
    done = python("-m", "contimpact", "run", scene_file, "-o", results.parent / "p", "--no-plot")
    assert (done.returncode, without_progress(done.stderr)) == (0, "")
    for escape in ("\r", "\x1b"):
        assert escape not in done.stdout
        assert escape not in done.stderr


def test_no_plot(run, scene, tmp_path):
    status, _, _ = run("run", scene(), "-o", tmp_path / "out", "--no-plot", "-q")
    assert status == 0
    assert not any(name.startswith("diagram") for name in files_of(tmp_path / "out"))
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text(encoding="utf-8"))
    assert any("--no-plot" in text for text in manifest["left_out"])
    assert "plot" not in manifest["seconds"]


@pytest.mark.full
def test_formats_of_the_scene(run, scene, tmp_path):
    path = scene('x = "d"', 'x = "d"\nformats = ["pdf"]')
    assert run("run", path, "-o", tmp_path / "out", "-q")[0] == 0
    names = set(files_of(tmp_path / "out"))
    assert {name for name in names if name.startswith("diagram")} == {"diagram.pdf"}
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text(encoding="utf-8"))
    assert set(manifest["files"]) == names - {"manifest.json"}
    assert manifest["seconds"]["plot"] > 0.0


def test_no_formats(run, scene, tmp_path):
    path = scene('x = "d"', "formats = []")
    assert run("run", path, "-o", tmp_path / "out", "-q")[0] == 0
    assert not any(name.startswith("diagram") for name in files_of(tmp_path / "out"))


@pytest.mark.full
def test_running_twice_gives_the_same_bytes(run, results, tmp_path):
    path = results.parent / "scene.toml"
    for name in ("one", "two"):
        assert run("run", path, "-o", tmp_path / name, "-q")[0] == 0
    one, two = files_of(tmp_path / "one"), files_of(tmp_path / "two")
    assert one.keys() == two.keys()
    for name in one:
        if name != "manifest.json":
            assert one[name] == two[name], name
    assert set(one) == set(files_of(results))


@pytest.mark.full
def test_rerun_in_another_process_gives_the_same_bytes(results):
    folder = results.parent / "another"
    scene_file = results.parent / "scene.toml"
    done = python("-m", "contimpact", "run", scene_file, "-o", folder, "-q")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    one, two = files_of(results), files_of(folder)
    assert one.keys() == two.keys()
    for name in one:
        if name.endswith((".json", ".csv", ".svg")) and name != "manifest.json":
            assert one[name] == two[name], name


def test_rerun_removes_stale_branches_and_leaves_foreign_files(run, scene, tmp_path):
    folder = tmp_path / "out"
    two = scene('orbits = ["1:1"]', 'orbits = ["1:1", "2:1"]')
    assert run("run", two, "-o", folder, "-q", "--no-plot")[0] == 0
    before = {path.name for path in (folder / "branches").iterdir()}
    assert any(name.endswith("-BBT.csv") for name in before)
    (folder / "branches" / "b1-mine.csv").write_text("kept")
    (folder / "branches" / "notes").mkdir()
    (folder / "notes.txt").write_text("kept")
    assert run("run", scene(), "-o", folder, "-q", "--no-plot")[0] == 0
    after = {path.name for path in (folder / "branches").iterdir()}
    assert not any(name.endswith("-BBT.csv") for name in after)
    assert {"b1-mine.csv", "notes"} <= after
    assert (folder / "notes.txt").read_text() == "kept"
    catalogue = json.loads((folder / "catalogue.json").read_text(encoding="utf-8"))
    kept = {f"{b['id']}-{b['word']}.csv" for b in catalogue["branches"]}
    assert after == kept | {"b1-mine.csv", "notes"}
    assert [b.id for b in load_diagram(folder).branches] == [b["id"] for b in catalogue["branches"]]


def test_results_of_a_folder_survive_a_scene_that_is_refused(run, scene, copied):
    before = files_of(copied)
    assert run("run", scene("r = 0.3", "r = 3"), "-o", copied)[0] == 2
    assert run("run", scene(*NO_ORBIT), "-o", copied)[0] == 2
    assert files_of(copied) == before


# Bad input

BAD_SCENES = {
    "unknown key": ('name = "small"', 'name = "small"\nnane = 1', "nane"),
    "unknown parameter": ("r = 0.3", "r = 0.3\nq = 1", "model.parameters.q"),
    "missing": ("r = 0.3", "", "model.parameters.r"),
    "contradiction": ("r = 0.3", "r = 0.3\nr_B = 0.3", "model.parameters.r"),
    "out of bounds": ("r = 0.3", "r = 1.3", "model.parameters.r"),
    "not a number": ("A = 5.0", "A = nan", "model.parameters.A"),
    "infinite": ("A = 5.0", "A = inf", "model.parameters.A"),
    "wrong type": ("A = 5.0", "A = true", "model.parameters.A"),
    "code": ("A = 5.0", "A = \"__import__('os')\"", "model.parameters.A"),
    "unknown system": ('"impact-pair"', '"impact"', "model.system"),
    "derived": ('parameter = "s"', 'parameter = "d"', "follow.parameter"),
    "start outside": ("[0.3, 0.4]", "[0.35, 0.4]", "follow.range"),
    "narrow": ("[0.3, 0.4]", "[0.34, 0.3400000000001]", "follow.range"),
    "reversed": ("[0.3, 0.4]", "[0.4, 0.3]", "follow.range"),
    "bad word": ('["1:1"]', '["BTX"]', "follow.orbits[0]"),
    "no orbits": ('["1:1"]', "[]", "follow.orbits"),
    "unknown event": ('["PD", "G"]', '["PD", "GG"]', "detect.events[1]"),
    "no values": ('["PD", "G"]', '["UZ"]', "detect.events"),
    "numerics": ("[plot]", "[numerics]\nstep = -1\n[plot]", "numerics.step"),
    "plot": ('x = "d"', 'x = "q"', "plot.x"),
    "not toml": ("[model]", "[model", "scene.toml"),
}


@pytest.mark.parametrize("command", ["check", "run"])
@pytest.mark.parametrize(("old", "new", "where"), BAD_SCENES.values(), ids=BAD_SCENES)
def test_bad_scene(run, scene, tmp_path, command, old, new, where):
    output = ["-o", tmp_path / "out"] if command == "run" else []
    status, out, err = run(command, scene(old, new), *output)
    assert (status, out) == (2, "")
    assert where in one_line(err).split(": ")[0]
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["check", "run"])
def test_bad_scene_files(run, tmp_path, command):
    output = ["-o", tmp_path / "out"] if command == "run" else []
    (tmp_path / "latin.toml").write_bytes('name = "é"'.encode("latin-1"))
    (tmp_path / "deep.toml").write_text("a = " + "[" * 50_000)
    bad = ["nowhere.toml", "", "latin.toml", "deep.toml", "latin.toml/below"]
    for name in bad:
        status, out, err = run(command, tmp_path / name, *output)
        assert (status, out) == (2, ""), name
        assert str(tmp_path / name) in one_line(err)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("forcing", "says"),
    [
        ("cos(t)", "period"),
        ("cos(pi*t) + cos(3*t)", "period"),
        ("exp(t)", "beyond 700"),
        ("cos(pi*t", "cannot be read"),
        ("", "cannot be read"),
        ("__import__('os').getcwd()", "__import__"),
        ("cos(pi*x)", "'x'"),
        ("sqrt(cos(pi*t))", "finite and real"),
        ("cos(65*pi*t)", "64"),
        ("abs(cos(pi*t))", "abs"),
    ],
)
def test_bad_forcing(run, scene, tmp_path, forcing, says):
    """Some of it is seen only when the flights are derived."""
    path = scene("[model.parameters]", f"forcing = {json.dumps(forcing)}\n[model.parameters]")
    status, out, err = run("run", path, "-o", tmp_path / "out")
    assert (status, out) == (2, "")
    message = one_line(err)
    assert "forcing" in message.split(": ")[0]
    assert says in message
    assert not (tmp_path / "out").exists()
    assert run("check", path)[0] == 2


@pytest.mark.parametrize("command", ["check", "run"])
def test_start_where_no_orbit_exists(run, scene, tmp_path, command):
    """The message says what was tried, and where orbits exist."""
    path = scene(*NO_ORBIT, "[1.0, 1.05]", "[0.3, 1.05]", "starts = 16", "starts = 32")
    output = ["-o", tmp_path / "out"] if command == "run" else []
    status, out, err = run(command, path, *output)
    assert status == 2
    assert command == "check" or out == ""
    message = one_line(err)
    assert message.startswith("follow.orbits: no BT orbit was found at s = 1.04")
    assert "32 random starts" in message
    nearby = re.findall(r"(\d+) at s = ([0-9.]+)", message)
    assert nearby
    assert all(int(count) > 0 and 0.3 < float(value) < 0.992 for count, value in nearby)
    assert "model.parameters.s" in message
    assert not (tmp_path / "out").exists()


@pytest.mark.full
def test_words_without_an_orbit(run, scene, tmp_path):
    """They are listed, by check and by run, and the others followed."""
    words = ('["1:1"]', '["5:1", "1:1"]', "[0.3, 0.4]", "[0.25, 0.4]")
    status, out, err = run("check", scene(*words))
    assert (status, err) == (0, "")
    assert re.search(r"orbits +5:1 \(word BBBBBT\): 0 at the start; \d at s = 0.265", out)
    status, out, _ = run("run", scene(*words), "-o", tmp_path / "out", "--no-plot")
    assert status == 0
    assert re.search(r"^no BBBBBT orbit was found at s = 0.34 .*at s = 0.265", out, re.MULTILINE)
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text(encoding="utf-8"))
    assert [each["word"] for each in manifest["not_found"]] == ["BBBBBT"]
    assert load_diagram(tmp_path / "out").branches


def test_no_orbit_anywhere(run, scene, tmp_path):
    status, out, err = run("run", scene(*NO_ORBIT), "-o", tmp_path / "out")
    assert (status, out) == (2, "")
    message = one_line(err)
    assert "no BT orbit was found at s = 1.04" in message
    assert "nor at" in message
    assert not (tmp_path / "out").exists()


def test_output_that_cannot_be_written(run, scene, tmp_path):
    (tmp_path / "file").write_text("kept")
    for place in (tmp_path / "file", tmp_path / "file" / "out", tmp_path / "file" / "a" / "b"):
        status, out, err = run("run", scene(), "-o", place)
        assert (status, out) == (2, "")
        message = one_line(err)
        assert str(place) in message
        assert "cannot be written" in message
    assert (tmp_path / "file").read_text() == "kept"


def test_the_output_is_tried_before_the_computation(run, scene, tmp_path, monkeypatch):
    def refuse(*arguments, **options):
        raise AssertionError("computed first")

    monkeypatch.setattr("contimpact.diagrams.explore.follow", refuse)
    (tmp_path / "file").write_text("")
    assert run("run", scene(), "-o", tmp_path / "file" / "out")[0] == 2


def test_an_empty_folder_that_was_there_stays(run, scene, tmp_path):
    (tmp_path / "out").mkdir()
    assert run("run", scene(*NO_ORBIT), "-o", tmp_path / "out")[0] == 2
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["bogus"],
        ["check"],
        ["run"],
        ["run", "scene.toml"],
        ["plot"],
        ["check", "a", "b"],
        ["run", "-o", "out"],
        ["check", "a", "--no-plot"],
        ["plot", "a", "--xlim", "0"],
        ["plot", "a", "--xlim", "a", "b"],
        ["--verbose"],
    ],
)
def test_bad_arguments(run, arguments, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, out, err = run(*arguments)
    assert (status, out) == (2, "")
    assert "usage: contimpact" in err
    assert "error: " in err
    assert "Traceback" not in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [["--help"], ["check", "-h"], ["run", "-h"], ["plot", "-h"]])
def test_help(run, arguments):
    status, out, err = run(*arguments)
    assert (status, err) == (0, "")
    assert out.startswith("usage: contimpact")


# plot


@pytest.mark.parametrize("kind", ["svg", "png", "pdf"])
@pytest.mark.quick(1)
def test_plot_to_a_file(run, copied, tmp_path, kind):
    target = tmp_path / f"figure.{kind}"
    before = files_of(copied)
    status, out, err = run("plot", copied, "-o", target)
    assert (status, err) == (0, "")
    assert str(target) in out
    start = {"svg": b"<?xml", "png": b"\x89PNG", "pdf": b"%PDF"}[kind]
    assert target.read_bytes().startswith(start)
    assert files_of(copied) == before


def test_plot_into_the_folder(run, copied):
    (copied / "diagram.png").unlink()
    assert run("plot", copied)[0] == 0
    assert (copied / "diagram.png").read_bytes().startswith(b"\x89PNG")


def figure_of(monkeypatch, run, *arguments):
    """The axes that ``contimpact plot`` draws."""
    import contimpact.plots.diagram as plot

    drawn = []
    original = plot.plot_diagram

    def spy(*given, **options):
        drawn.append(original(*given, **options))
        return drawn[-1]

    monkeypatch.setattr(plot, "plot_diagram", spy)
    assert run("plot", *arguments)[0] == 0
    return drawn[0]


def test_plot_uses_the_options_of_the_scene(monkeypatch, run, copied):
    assert figure_of(monkeypatch, run, copied).get_xlabel() == "$d$ (dimensionless)"


def test_plot_over_another_column(monkeypatch, run, copied):
    ax = figure_of(monkeypatch, run, copied, "-x", "s", "--xlim", "0.31", "0.39")
    assert ax.get_xlabel() == "$s$ (m)"
    assert ax.get_xlim() == (0.31, 0.39)


@pytest.mark.full
def test_plot_limits(monkeypatch, run, copied):
    ax = figure_of(monkeypatch, run, copied, "--xlim", "0.1", "0.3", "--ylim", "-1e0", "2")
    assert ax.get_xlim() == (0.1, 0.3)
    assert ax.get_ylim() == (-1.0, 2.0)


@pytest.mark.parametrize("drawn", ["f.png", "f.html"])
def test_plot_limits_beyond_all_points(run, copied, tmp_path, drawn):
    """An empty picture was written."""
    status, _, err = run("plot", copied, "--xlim", "5", "6", "-o", tmp_path / drawn)
    assert status == 2
    assert one_line(err).startswith("--xlim: found 5 to 6; all that is to be drawn is from 0.")
    assert not (tmp_path / drawn).exists()


def test_a_table_of_ranges_in_place_of_a_folder_is_refused(run, copied, tmp_path):
    for place in (".", "/", tmp_path):
        status, _, err = run("range", copied, "-o", place)
        assert status == 2
        assert "a folder; move it: a file is to be written" in err


@pytest.mark.parametrize("column", ["q", ""])
def test_plot_of_a_column_that_is_not_there(run, copied, tmp_path, column):
    status, out, err = run("plot", copied, "-x", column, "-o", tmp_path / "f.png")
    assert (status, out) == (2, "")
    message = one_line(err)
    assert message.startswith(f"-x: no column '{column}'; accepted are ")
    assert {"s", "d", "arclength"} <= set(message.split("accepted are ")[1].split(", "))
    assert not (tmp_path / "f.png").exists()


@pytest.mark.parametrize("drawn", ["f.png", "f.html"])
def test_plot_over_a_parameter_that_does_not_vary(run, copied, tmp_path, drawn):
    """All points were on one vertical line."""
    status, _, err = run("plot", copied, "-x", "A", "-o", tmp_path / drawn)
    message = one_line(err)
    assert status == 2
    assert message.startswith("-x: A does not vary along the branches; accepted are arclength, s")
    assert "A" not in message.split("accepted are ")[1].split(", ")
    assert not (tmp_path / drawn).exists()


@pytest.mark.parametrize("name", ["figure.jpg", "figure", "figure.", ".png", "figure.png.txt"])
def test_plot_to_another_format(run, copied, tmp_path, name):
    status, out, err = run("plot", copied, "-o", tmp_path / name)
    assert (status, out) == (2, "")
    assert "svg, png, pdf" in one_line(err)
    assert not (tmp_path / name).exists()


def test_plot_to_where_nothing_can_be_written(run, copied, tmp_path):
    (tmp_path / "file").write_text("kept")
    for target in (tmp_path / "file" / "f.png", tmp_path / "nowhere" / "f.svg"):
        status, out, err = run("plot", copied, "-o", target)
        assert (status, out) == (2, "")
        assert str(target) in one_line(err)
    assert not (tmp_path / "nowhere").exists()


def test_plot_of_no_results(run, tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").write_text("")
    for name in ("empty", "file", "nowhere"):
        status, out, err = run("plot", tmp_path / name)
        assert (status, out) == (2, "")
        assert "contimpact run" in one_line(err)
    assert list((tmp_path / "empty").iterdir()) == []


@pytest.mark.parametrize("name", ["catalogue.json", "manifest.json", "branches/b1-BT.csv"])
@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"schema": "else/1"}', b"\xff"])
def test_plot_of_damaged_results(run, copied, name, content):
    (copied / name).write_bytes(content)
    status, out, err = run("plot", copied)
    assert (status, out) == (2, "")
    assert str(copied / name) in one_line(err)


@pytest.mark.parametrize("name", ["catalogue.json", "branches/b1-BT.csv"])
def test_plot_of_results_that_lack_a_file(run, copied, name):
    (copied / name).unlink()
    status, out, err = run("plot", copied)
    assert (status, out) == (2, "")
    assert str(copied / name) in one_line(err)


def test_plot_of_results_without_a_scene(run, copied):
    """As written from Python: the followed parameter is on the x axis."""
    (copied / "manifest.json").unlink()
    status, out, err = run("plot", copied)
    assert (status, err) == (0, "")
    assert str(copied / "diagram.png") in out


# Interruption


def test_interrupt_in_process(run, scene, tmp_path, monkeypatch):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr("contimpact.diagrams.explore.follow", interrupted)
    status, out, err = run("run", scene(), "-o", tmp_path / "out")
    assert (status, out) == (1, "")
    assert err == "contimpact: interrupted\n"
    assert not (tmp_path / "out").exists()  # nothing was computed


@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
def test_ctrl_c(scene, tmp_path):
    """Of a run that would take minutes."""
    small = "[numerics]\nstep = 1e-6\nmax_step = 1e-6\nmax_points = 100000000\n[plot]"
    folder = tmp_path / "out"
    process = subprocess.Popen(
        [sys.executable, "-m", "contimpact", "run", scene("[plot]", small), "-o", str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        limit = time.monotonic() + 60.0
        while not folder.exists() and time.monotonic() < limit:
            time.sleep(0.02)
        time.sleep(0.3)
        assert process.poll() is None
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 1
    assert re.fullmatch(r"contimpact: .*interrupted.*\n", without_progress(err))
    assert "Traceback" not in out
    if folder.exists():  # what was computed is there, and whole
        assert not any(path.name.startswith(".") for path in folder.rglob("*"))
        assert load_diagram(folder).name == "small"


# The doors, and what comes through them

HEAVY = "[m for m in ('numpy', 'scipy', 'sympy', 'matplotlib', 'pandas') if m in sys.modules]"


def test_versions():
    done = python("-m", "contimpact", "--version")
    assert (done.returncode, done.stdout, done.stderr) == (
        0,
        f"contimpact {contimpact.__version__}\n",
        "",
    )


def test_installed_command():
    command = shutil.which("contimpact", path=Path(sys.executable).parent)
    if command is None:
        pytest.skip("the package is not installed with its command")
    done = subprocess.run([command, "--version"], capture_output=True, text=True, timeout=60)
    assert done.stdout == f"contimpact {contimpact.__version__}\n"


def test_status_of_the_process(tmp_path):
    done = python("-m", "contimpact", "check", tmp_path / "nowhere.toml")
    assert (done.returncode, done.stdout) == (2, "")
    one_line(done.stderr)


def test_importing_the_package_imports_nothing_heavy():
    done = python("-c", f"import sys, contimpact, contimpact.cli\nprint({HEAVY})")
    assert done.stdout == "[]\n"


def test_every_public_name_is_there():
    for name in contimpact.__all__:
        assert getattr(contimpact, name) is not None
    assert set(dir(contimpact)) >= set(contimpact.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        contimpact.nothing  # noqa: B018


@pytest.mark.parametrize(
    ("options", "imported"), [("'--no-plot'", ["numpy"]), ("'-q'", ["numpy", "matplotlib"])]
)
@pytest.mark.quick(1)
def test_a_warm_run_imports_what_it_needs(results, options, imported):
    """The kernels are there since `results`: no SymPy; nothing in a run needs SciPy."""
    scene_file, folder = results.parent / "scene.toml", results.parent / "warm"
    code = (
        "import sys\n"
        "from contimpact.cli import main\n"
        f"assert main(['run', {str(scene_file)!r}, '-o', {str(folder)!r}, '-q', {options}]) == 0\n"
        f"print({HEAVY})"
    )
    done = python("-c", code)
    assert done.stderr == ""
    assert done.stdout == f"{imported}\n"
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["kernels"]["generated"] == []
    assert manifest["kernels"]["loaded"]


@pytest.mark.full
def test_a_warm_check_imports_what_it_needs(results):
    code = (
        "import sys\n"
        "from contimpact.cli import main\n"
        f"assert main(['check', {str(results.parent / 'scene.toml')!r}]) == 0\n"
        f"print({HEAVY})"
    )
    done = python("-c", code)
    assert done.stdout.splitlines()[-1] == "['numpy']"


# Interruptions and obstacles

ENDLESS = (
    "[plot]",
    "[numerics]\nstep = 1e-6\nmax_step = 1e-6\nmax_points = 100000000\n[plot]",
    "[follow]",
    "[follow]\nmax_points = 100000000",
)


def interrupted(*arguments):
    """A run in another process that is interrupted in the middle of a branch."""
    process = subprocess.Popen(
        [sys.executable, "-m", "contimpact", "run", *map(str, arguments), "--no-plot"],
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    try:
        time.sleep(3)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=30)
    finally:
        process.kill()
    return process.returncode, without_progress(said)


def test_an_interruption_of_the_search_keeps_the_results_of_an_earlier_run(
    run, scene, copied, monkeypatch
):
    def interrupted(*given, **named):
        raise KeyboardInterrupt

    monkeypatch.setattr("contimpact.diagrams.starting_orbits.search", interrupted)
    before = files_of(copied)
    status, out, err = run("run", scene(), "-o", copied, "-q")
    assert (status, out) == (1, "")
    assert "interrupted" in err
    assert files_of(copied) == before


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.full
def test_an_interruption_keeps_the_branch_under_way_and_stops_all_scenes(scene, tmp_path):
    paths = [scene(*ENDLESS, '"small"', f'"{name}"', name=name) for name in ("one", "two")]
    status, said = interrupted(*paths, "-o", tmp_path / "out")
    assert status == 1
    assert said.count("interrupted") == 1
    assert said.endswith("contimpact: not run: two\n")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["one"]
    (branch,) = load_diagram(tmp_path / "out" / "one").branches
    assert [end.kind.name for end in branch.ends] == ["INTERRUPTED", "INTERRUPTED"]
    assert len(branch) > 100
    manifest = json.loads((tmp_path / "out" / "one" / "manifest.json").read_text("utf-8"))
    assert manifest["failure"] == "interrupted"


@pytest.mark.parametrize("name", ["branches", "catalogue.json", "manifest.json", "diagram.png"])
def test_something_else_in_the_way(run, scene, tmp_path, monkeypatch, name):
    """It is seen before anything is computed."""
    monkeypatch.setattr("contimpact.diagrams.explore.follow", None)
    place = tmp_path / "out" / name
    place.parent.mkdir()
    place.write_text("") if name == "branches" else place.mkdir()
    status, out, err = run("run", scene(), "-o", tmp_path / "out")
    assert (status, out) == (2, "")
    assert str(place) in one_line(err)


def test_output_with_a_name_too_long(run, scene, tmp_path):
    status, _, err = run("run", scene(), "-o", tmp_path / ("a" * 300))
    assert status == 2
    assert "cannot be written" in one_line(err)


@pytest.mark.parametrize(
    "command",
    [
        ["run", "scene.toml"],
        ["catalogue", "."],
        ["plot", "."],
        ["range", "."],
        ["design", "scene.toml"],
        ["fit", "scene.toml", "data.csv", "--parameter", "r"],
    ],
    ids=lambda command: command[0],
)
def test_empty_output(run, scene, copied, monkeypatch, command):
    path = scene(name="scene.toml")
    monkeypatch.chdir(copied)
    command = [path if name == "scene.toml" else name for name in command]
    status, _, err = run(*command, "-o", "")
    assert status == 2
    assert one_line(err).startswith("-o: empty")


def test_a_value_that_is_none_is_refused(run, copied):
    """Of two dashes argparse makes an empty list, in Python 3.11."""
    status, _, err = run("range", copied, "--at=--")
    assert status == 2
    assert "--at" in err


def test_no_folder_of_a_refused_run_stays(run, scene, tmp_path):
    path = scene("[model.parameters]", 'forcing = "cos(t)"\n[model.parameters]')
    status, _, err = run("run", path, "-o", tmp_path / "a" / "b" / "c")
    assert status == 2
    assert one_line(err).startswith("model.forcing: ")
    assert not (tmp_path / "a").exists()


def test_a_picture_that_is_not_drawn_anew_is_removed(run, scene, copied):
    assert (copied / "diagram.png").exists()
    assert run("run", scene(), "-o", copied, "-q", "--no-plot")[0] == 0
    assert not (copied / "diagram.png").exists()


@pytest.mark.parametrize("kind", ["svg", "pdf", "PNG"])
@pytest.mark.quick(1)
def test_plot_writes_the_same_bytes_every_time(run, copied, tmp_path, kind):
    for name in ("a", "b"):
        assert run("plot", copied, "-o", tmp_path / f"{name}.{kind}")[0] == 0
    assert (tmp_path / f"a.{kind}").read_bytes() == (tmp_path / f"b.{kind}").read_bytes()


@pytest.mark.parametrize("limits", [("nan", "1"), ("1", "inf"), ("1", "1"), ("2", "1")])
@pytest.mark.parametrize("axis", ["--xlim", "--ylim"])
def test_plot_limits_that_are_none(run, copied, axis, limits):
    status, _, err = run("plot", copied, axis, *limits)
    assert status == 2
    assert one_line(err).startswith(axis[2:])


@pytest.mark.parametrize("column", ["event", "reason"])
def test_plot_over_texts(run, copied, column):
    assert run("plot", copied, "-x", column)[0] == 2


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("catalogue.json", '{"schema": "contimpact.catalogue/1"}'),
        ("catalogue.json", '{"schema": "contimpact.catalogue/1", "branches": 3}'),
        ("catalogue.json", '{"schema": "contimpact.catalogue/1", "scene": "x", "branches": [{}]}'),
        ("catalogue.json", "[" * 100_000),
        ("manifest.json", '{"schema": "contimpact.manifest/1"}'),
        ("manifest.json", '{"schema": "contimpact.manifest/1", "scene": {"resolved": 3}}'),
    ],
)
@pytest.mark.parametrize("command", ["plot", "catalogue"])
def test_incomplete_records(run, copied, tmp_path, command, name, content):
    (copied / name).write_text(content)
    output = ["-o", tmp_path / "merged"] if command == "catalogue" else []
    status, _, err = run(command, copied, *output)
    if command == "plot" or '"branches": [{}]' not in content:
        assert status == 2
        assert name in one_line(err)


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX shell")
@pytest.mark.parametrize("sink", ["| true", "> /dev/full", ">&-"])
@pytest.mark.parametrize("arguments", ["check", "--help"])
@pytest.mark.quick(2)
def test_output_that_nobody_reads(scene, sink, arguments):
    """A closed pipe, a full disk, no output at all: no traceback."""
    if "full" in sink and not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    path = scene() if arguments == "check" else ""
    done = subprocess.run(
        f"{sys.executable} -m contimpact {arguments} {path} {sink}",
        shell=True,
        capture_output=True,
        text=True,
        env=environment,
    )
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr
    assert ("No space left" in done.stderr) == ("full" in sink)


@pytest.mark.parametrize("given", [None, "3"])
def test_a_command_takes_one_thread_for_linear_algebra_unless_told_otherwise(
    given, scene, tmp_path
):
    """A system's file is run by the command, after NumPy was loaded."""
    file = tmp_path / "file.py"
    file.write_text("import os\nraise SystemExit(os.environ['OPENBLAS_NUM_THREADS'])")
    environment = {k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"}
    if given:
        environment["OPENBLAS_NUM_THREADS"] = given
    command = [sys.executable, "-m", "contimpact", "check", str(scene()), "--system", str(file)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert f"SystemExit: {given or 1}" in done.stderr
