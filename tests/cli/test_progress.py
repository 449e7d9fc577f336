"""Progress of the commands: always told, named, soon; and interruptions at any stage."""

from __future__ import annotations

import contextlib
import io
import json
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from zoo import SMALL

from contimpact import load_diagram, progress
from contimpact.cli import folders, main
from contimpact.progress import Teller, telling
from contimpact.results.result_folder import MARK

SCENE = """
name = "{name}"
model = {{ system = "impact-pair", parameters = {{ beta = "pi/6", r = {r}, A = 5.0, s = {s} }} }}
follow = {{ parameter = "s", range = {range}, orbits = ["1:1"] }}
detect = {{ events = [] }}
numerics = {{ starts = 32 }}
plot = {{ formats = ["svg", "png"] }}
"""
SIMULATED = """
simulate = { range = [0.385, 0.389], values = 2, periods = 300, branches = true }
"""


@pytest.fixture
def scene(tmp_path):
    """``scene(name, more, r=..., ...)``: the path of a scene of one short branch."""

    def write(name="small", more="", **changes):
        given = {"r": "0.3", "s": "0.389", "range": "[0.386, 0.39]"} | changes
        path = tmp_path / f"{name}.toml"
        path.write_text(SCENE.format(name=name, **given) + more, encoding="utf-8")
        return str(path)

    return write


@pytest.fixture
def run(capsys):
    def call(*arguments):
        status = main([str(argument) for argument in arguments])
        said = capsys.readouterr()
        return status, said.out, said.err

    return call


def told(text):
    """The lines of progress among what was written to standard error."""
    return [line for line in text.splitlines() if re.match(r"\w+( \(\d of \d\))?, \d+ s: ", line)]


class Terminal(io.StringIO):
    def isatty(self):
        return True


# Telling


def test_the_first_line_comes_at_once_and_the_newest_later(monkeypatch):
    monkeypatch.setattr(progress, "PAUSE", 0.2)
    stream = io.StringIO()
    teller = Teller("small", stream)
    for k in range(1000):
        teller(f"step {k}")
    assert stream.getvalue() == "small, 0 s: step 0\n"
    limit = time.monotonic() + 10.0
    while "step 999" not in stream.getvalue() and time.monotonic() < limit:
        time.sleep(0.02)
    teller.close()
    assert [line.split(": ")[1] for line in stream.getvalue().splitlines()] == [
        "step 0",
        "step 999",
    ]


def test_long_silence_is_told(monkeypatch):
    monkeypatch.setattr(progress, "PAUSE", 0.01)
    monkeypatch.setattr(progress, "QUIET", 0.02)
    stream = io.StringIO()
    teller = Teller("small", stream)
    teller("deriving")
    limit = time.monotonic() + 10.0
    while stream.getvalue().count("deriving") < 3 and time.monotonic() < limit:
        time.sleep(0.01)
    teller.close()
    assert stream.getvalue().count("small, 0 s: deriving\n") >= 3


def test_a_patient_teller_says_nothing_of_short_work():
    stream = io.StringIO()
    teller = Teller("small", stream, patient=True)
    teller("step")
    teller.close()
    assert stream.getvalue() == ""


def test_on_a_terminal_the_line_is_rewritten_and_cleared():
    stream = Terminal()
    teller = Teller("small", stream)
    teller("x" * 500)
    teller.say("contimpact: a warning")
    teller.close()
    first, *_ = stream.getvalue().split("\r\x1b[K")[1:]
    assert first.startswith("small, 0 s: xxx")
    assert len(first) == 79  # it does not wrap
    assert "\r\x1b[Kcontimpact: a warning\n" in stream.getvalue()
    assert stream.getvalue().endswith("\r\x1b[K")


def test_a_broken_stream_does_not_stop_the_work():
    stream = io.StringIO()
    teller = Teller("small", stream)
    stream.close()
    teller("step")
    teller.close()


def test_the_thread_ends_and_the_log_is_left_as_it_was(capsys):
    import logging

    log = logging.getLogger("contimpact")
    before = log.level, list(log.handlers), threading.active_count()
    with telling("small") as tell:
        tell("step")
        log.warning("a warning")
        assert threading.active_count() == before[2] + 1
    assert (log.level, log.handlers, threading.active_count()) == before
    assert capsys.readouterr().err == "small, 0 s: step\ncontimpact: a warning\n"


# Of the commands


@pytest.mark.full
def test_kernels_being_derived_are_named(run, scene, tmp_path, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_CACHE", str(tmp_path / "cold"))
    monkeypatch.setattr(progress, "PAUSE", 0.02)
    status, out, err = run("run", scene(), "-o", tmp_path / "out", "--no-plot")
    assert status == 0
    lines = told(err)
    assert lines == err.splitlines()
    assert re.fullmatch(r"small, \d+ s: generating kernel \w+ of impact-pair", lines[0])
    assert len(set(lines)) > 1
    assert "generating" not in out


@pytest.mark.full
def test_run_tells_its_stages(run, scene, tmp_path, monkeypatch):
    monkeypatch.setattr(progress, "PAUSE", 0.0005)
    path = scene(range="[0.3, 0.39]")
    status, _, err = run("run", path, "-o", tmp_path / "out")
    assert status == 0
    assert told(err) == err.splitlines()
    for stage in ("looking for BT at s = 0.389", "drawing"):
        assert stage in err
    assert run("run", path, "-o", tmp_path / "out", "-q") == (0, "", "")


def test_check_says_nothing_of_short_work(run, scene):
    status, _, err = run("check", scene())
    assert (status, err) == (0, "")


def test_simulate_tells_its_stages(run, scene, tmp_path, monkeypatch):
    monkeypatch.setattr(progress, "PAUSE", 0.0005)
    path = scene(more=SIMULATED)
    status, _, err = run("simulate", path, "-o", tmp_path / "out", "--no-plot")
    assert status == 0
    assert told(err) == err.splitlines()
    assert re.search(r"sweep: \d of 2", err)
    assert run("simulate", path, "-o", tmp_path / "out", "--no-plot", "-q") == (0, "", "")


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.full
def test_a_log_file_is_filled_as_work_goes_on(tmp_path, scene):
    """Of a run in another process: lines can be read before it ends, on both streams."""
    endless = scene("endless")
    text = Path(endless).read_text(encoding="utf-8")
    text = text.replace("starts = 32", "step = 1e-6, max_step = 1e-6, max_points = 100000000")
    text = text.replace("follow = {", "follow = { max_points = 100000000,")
    Path(endless).write_text(text, encoding="utf-8")
    log, err = tmp_path / "log", tmp_path / "err"
    with open(log, "wb") as out_file, open(err, "wb") as err_file:
        process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "contimpact",
                "run",
                scene(),
                endless,
                "-o",
                str(tmp_path / "out"),
                "--no-plot",
            ],
            stdout=out_file,
            stderr=err_file,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        try:
            limit = time.monotonic() + 60.0
            while "endless (2 of 2)" not in err.read_text() and time.monotonic() < limit:
                time.sleep(0.05)
            assert process.poll() is None
            assert "small (1 of 2), 0 s: looking for BT" in err.read_text()
            assert "written to" in log.read_text()  # the first scene's summary
            process.send_signal(signal.SIGINT)
            process.wait(30)
        finally:
            process.kill()
            process.wait()
    assert process.returncode == 1


# Several scenes


@pytest.mark.full
def test_bad_scenes_are_named_and_the_others_run(run, scene, tmp_path):
    good, late = scene("good"), scene("late", range="[0.387, 0.39]")
    bad = scene("bad", r="3")
    none = scene("none", s="1.04", range="[1.0, 1.05]")
    nowhere = str(tmp_path / "nowhere.toml")
    status, out, err = run(
        "run", bad, good, nowhere, none, late, "-o", tmp_path / "out", "--no-plot"
    )
    assert status == 2
    messages = [line for line in err.splitlines() if line not in told(err)]
    assert [line.split(": ")[:3] for line in messages] == [
        ["contimpact", bad, "model.parameters.r"],
        ["contimpact", nowhere, "no such file; give the path of a scene.toml"],
        ["contimpact", none, "follow.orbits"],
    ]
    assert err.splitlines()[:2] == messages[:2]  # all are validated first
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["good", "late"]
    assert out.count("written to") == 2


@pytest.mark.full
def test_one_scene_left_of_two_is_in_its_own_folder(run, scene, tmp_path):
    assert run("run", scene("bad", r="3"), scene("good"), "-o", tmp_path / "out", "-q")[0] == 2
    assert (tmp_path / "out" / "good" / "manifest.json").exists()


def test_a_failed_computation_is_named_and_the_others_run(run, scene, tmp_path, monkeypatch):
    from contimpact.diagrams import explore

    walked = explore.walk_both_ways

    def failing(problem, *given):
        if problem.model.values["r"] == 0.31:
            raise ZeroDivisionError("of a test")
        return walked(problem, *given)

    monkeypatch.setattr(explore, "walk_both_ways", failing)
    paths = [scene("one", r="0.31"), scene("two")]
    status, _, err = run("run", *paths, "-o", tmp_path / "out", "-q", "--no-plot")
    assert status == 1
    assert f"contimpact: {paths[0]}: the computation failed (ZeroDivisionError: of a test)" in err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["two"]


def test_an_interruption_names_what_was_not_run(run, scene, tmp_path, monkeypatch):
    def interrupted(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr("contimpact.diagrams.explore.follow", interrupted)
    one, two, three = (scene(name) for name in ("one", "two", "three"))
    status, _, err = run("run", one, two, three, "-o", tmp_path / "out", "-q")
    assert status == 1
    assert err == f"contimpact: {one}: interrupted\ncontimpact: not run: two, three\n"


# Interruptions after the computation


def manifest_of(folder):
    return json.loads((folder / "manifest.json").read_text(encoding="utf-8"))


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_an_interruption_while_tables_are_written_leaves_pictures_out(
    run, scene, tmp_path, monkeypatch
):
    from contimpact.cli import run as command

    write = command.diagram_files

    def interrupted(*given):
        signal.raise_signal(signal.SIGINT)
        return write(*given)

    monkeypatch.setattr(command, "diagram_files", interrupted)
    monkeypatch.setattr(command, "_save_plots", None)
    status, _, err = run("run", scene(), "-o", tmp_path / "out", "-q")
    assert status == 1
    assert err == f"contimpact: interrupted; what was computed is in {tmp_path / 'out'}\n"
    manifest = manifest_of(tmp_path / "out")
    assert manifest["failure"] == "interrupted"
    assert any("contimpact plot" in text for text in manifest["left_out"])
    assert len(load_diagram(tmp_path / "out").branches[0]) > 2


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
@pytest.mark.full
def test_an_interruption_while_drawing_leaves_at_once(run, scene, tmp_path, monkeypatch):
    """Pictures that are whole stay; the manifest is written and knows them."""
    from contimpact.plots import diagram

    draw = diagram.picture

    def interrupted(figure, kind, salt):
        if kind == "png":
            signal.raise_signal(signal.SIGINT)
            pytest.fail("the drawing went on")
        return draw(figure, kind, salt)

    monkeypatch.setattr(diagram, "picture", interrupted)
    folder = tmp_path / "out"
    assert run("run", scene(), "-o", folder, "-q")[0] == 1
    manifest = manifest_of(folder)
    assert manifest["failure"] == "interrupted"
    there = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert set(manifest["files"]) == there - {"manifest.json"}
    assert "diagram.svg" in there
    assert "diagram.png" not in there
    assert MARK not in there
    monkeypatch.undo()
    assert run("plot", folder)[0] == 0


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_an_impatient_user_still_gets_the_manifest(run, scene, tmp_path, monkeypatch):
    """Interruptions after the first, at any moment of the writing, spoil nothing."""
    from contimpact.plots import diagram
    from contimpact.results import result_folder

    put = result_folder.write_all

    def picture(*given):
        signal.raise_signal(signal.SIGINT)

    def write(*given):
        signal.raise_signal(signal.SIGINT)
        return put(*given)

    monkeypatch.setattr(diagram, "picture", picture)
    monkeypatch.setattr(result_folder, "write_all", write)  # of the manifest
    assert run("run", scene(), "-o", tmp_path / "out", "-q")[0] == 1
    assert manifest_of(tmp_path / "out")["failure"] == "interrupted"
    assert load_diagram(tmp_path / "out").branches


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_an_interruption_on_a_full_disk_stops_all_scenes(run, scene, tmp_path, monkeypatch):
    from contimpact import storage as files

    def full(*_, **__):
        signal.raise_signal(signal.SIGINT)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files, "put", full)
    one, two = scene("one"), scene("two")
    status, _, err = run("run", one, two, "-o", tmp_path / "out", "-q")
    assert status == 1
    first, last = err.splitlines()
    assert first.startswith(f"contimpact: {one}: {tmp_path / 'out' / 'one'}: not written (No space")
    assert last == "contimpact: not run: two"
    assert (tmp_path / "out" / "one" / MARK).exists()


def test_a_simulation_interrupted_in_its_branches_ends_there(run, scene, tmp_path, monkeypatch):
    from contimpact.diagrams import explore

    walked = explore.walk_both_ways

    def interrupted(*about):
        *_, tell = about
        tell(1, walked(*about).points[0].parameter)
        raise KeyboardInterrupt

    monkeypatch.setattr(explore, "walk_both_ways", interrupted)
    status, _, err = run("simulate", scene(more=SIMULATED), "-o", tmp_path / "out", "-q")
    assert status == 1
    assert "interrupted (branches)" in err
    assert "--resume" in err
    manifest = manifest_of(tmp_path / "out")
    assert manifest["interrupted"] == "branches"
    assert manifest["counts"]["attractors"] == 0


@pytest.mark.full
def test_a_simulation_interrupted_while_drawing(run, scene, tmp_path, monkeypatch):
    from contimpact.plots import attractors

    def interrupted(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr(attractors, "save_simulation", interrupted)
    path, folder = scene(more=SIMULATED), tmp_path / "out"
    status, _, err = run("simulate", path, "-o", folder, "-q")
    assert status == 1
    assert "interrupted (pictures)" in err
    assert not (folder / MARK).exists()
    assert manifest_of(folder)["interrupted"] == "pictures"
    assert manifest_of(folder)["counts"]["attractors"] == 2
    monkeypatch.undo()
    assert run("simulate", path, "-o", folder, "-q", "--resume")[0] == 0
    assert manifest_of(folder)["resumed"] == 2
    assert (folder / "attractors.png").exists()


@pytest.mark.full
def test_drawing_a_folder_tells_what_it_does(tmp_path, monkeypatch):
    """Each branch of the page is named; so is what comes before and what a picture needs."""
    (tmp_path / "scene.toml").write_text(SMALL, encoding="utf-8")
    out = tmp_path / "out"
    assert main(["run", str(tmp_path / "scene.toml"), "-o", str(out), "-q", "--no-plot"]) == 0
    told = []

    @contextlib.contextmanager
    def collecting(name, patient):
        assert (name, patient) == ("out", True)
        yield told.append

    monkeypatch.setattr(folders, "telling", collecting)
    assert main(["plot", str(out), "--html"]) == 0
    branches = len(json.loads((out / "catalogue.json").read_text(encoding="utf-8"))["branches"])
    names = [f"drawing the orbits of b{k}, {k} of {branches}" for k in range(1, branches + 1)]
    assert told == ["reading", *names]
    told.clear()
    assert main(["plot", str(out)]) == 0
    assert told == ["reading", "drawing"]
