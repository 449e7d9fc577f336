"""Studies computed: what the store holds, whatever fails, hangs, or is killed on the way."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import random
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from concurrent.futures import BrokenExecutor, ThreadPoolExecutor

import pytest
import small_studies
from small_studies import TOML, computed, computed_here, contents, study_given
from zoo import ROOT

from contimpact import follow, load_diagram, load_entries, read_scene
from contimpact.cli import main
from contimpact.diagrams.scene_simulation import simulate
from contimpact.errors import InputError
from contimpact.results.catalogue import branch_text, catalogue_text, curve_text
from contimpact.simulation.energy import attractor_voltages
from contimpact.studies import executors, run
from contimpact.studies.run import BudgetError, Task, WorkersLostError, compute, diagram_rows
from contimpact.studies.store import Store, decompress_text
from contimpact.studies.study import Study
from contimpact.studies.study_file import read_study


@pytest.fixture
def here():
    """An executor of this process, as anybody may give one."""
    with ThreadPoolExecutor(1) as executor:
        yield executors.given(executor)


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    path = tmp_path_factory.mktemp("store") / "whole.sqlite"
    computed_here(path)
    return path


@pytest.mark.full
def test_the_store_holds_what_follow_gives(uninterrupted):
    held = contents(uninterrupted)
    assert [row["status"] for row in held["scenes"]] == ["done"] * 4
    study = read_study(study_given())
    for number, values in zip(*study.points, strict=True):
        diagram = follow(read_scene(study.scene_at(values, int(number))))
        (whole,) = (r["content"] for r in held["catalogues"] if r["scene"] == number)
        assert decompress_text(whole) == catalogue_text(diagram)
        events = [r for r in held["events"] if r["scene"] == number]
        assert [(e.id, e.label, e.value, e.parameters["d"], e.error) for e in diagram.entries] == [
            (r["event"], r["label"], r["value"], r["derived"], r["error"]) for r in events
        ]
        assert diagram.entries
        placed = {r["name"]: r["value"] for r in held["coordinates"] if r["scene"] == number}
        assert placed == dict(zip(("beta", "r"), values.tolist(), strict=True))


@pytest.mark.full
def test_it_is_said_how_many_scenes_there_are_and_how_long_it_will_take(
    here, tmp_path, monkeypatch
):
    monkeypatch.setattr(run, "FEW", 2)
    monkeypatch.setattr(run, "FOR_EACH", 0)
    lines = []
    tally, said = computed(tmp_path / "s.sqlite", study_given(), here, progress=lines.append)
    assert said[0] == "4 scenes"
    assert said[1].startswith("estimate after 3 scenes: ")
    assert tally.estimate == pytest.approx(tally.seconds, rel=0.8)
    assert lines[0] == "1 of 4 scenes"
    assert lines[-1].startswith("4 of 4 scenes, ")
    connection = sqlite3.connect(tmp_path / "s.sqlite")
    row = connection.execute("SELECT estimate, seconds, done, workers FROM runs").fetchone()
    connection.close()
    assert row == (tally.estimate, tally.seconds, 4, 1)


def test_a_second_start_has_nothing_to_do(uninterrupted, here):
    before = contents(uninterrupted)
    tally, said = computed(uninterrupted, study_given(), here)
    assert said == ["4 scenes, 4 of them in the store"]
    assert tally.done == 0
    assert contents(uninterrupted) == before


def test_another_study_of_the_same_name_is_refused(uninterrupted, here):
    with pytest.raises(InputError, match="another study called 'small'"):
        computed(uninterrupted, study_given(count=3), here)


@pytest.mark.full
def test_two_studies_in_one_store_and_names_that_would_be_commands(here, uninterrupted, tmp_path):
    path, evil = tmp_path / "two.sqlite", "x'); DROP TABLE events; --\""
    computed(path, study_given(evil), here)
    computed(path, study_given(), here)
    held = contents(path)
    whole = contents(uninterrupted)
    assert [row for row in held["events"] if row["study"] == "small"] == whole["events"]
    assert {row["study"] for row in held["events"]} == {"small", evil}


@pytest.mark.full
def test_two_studies_write_to_one_store_at_the_same_time(tmp_path, uninterrupted):
    path = tmp_path / "s.sqlite"
    with ThreadPoolExecutor(2) as both:
        list(both.map(lambda name: computed_here(path, name=name), ("small", "other")))
    held, whole = contents(path), contents(uninterrupted)
    assert held["failures"] == []
    del whole["catalogues"]  # they name their scenes
    for table, rows in whole.items():
        for name in ("small", "other"):
            own = [row | {"study": "small"} for row in held[table] if row["study"] == name]
            assert own == rows


@pytest.mark.full
def test_a_study_is_computed_by_one_process_at_a_time(here, uninterrupted, tmp_path):
    with Store(tmp_path / "s.sqlite") as store, store.claimed("small"):
        with pytest.raises(InputError, match="another contimpact is writing"):
            computed(tmp_path / "s.sqlite", study_given(), here)
        computed(tmp_path / "s.sqlite", study_given("other", count=2), here)


@pytest.mark.full
def test_what_is_kept_besides_is_what_the_scene_gives(here, tmp_path):
    """Attractors and voltages of simulated motion, branch tables, curves and their points."""
    keep = ["attractors", "energies", "tables", "curves"]
    given = study_given(keep=keep, grid={"beta": [math.pi / 6]})
    given["model"]["parameters"]["r"] = 0.25
    given["follow"]["range"] = [0.2, 0.6]
    given["curves"] = {"parameter": "r", "range": [0.1, 0.3], "kinds": ["PD"]}
    given["simulate"] = {"range": [0.4, 0.45], "values": 2, "transitions": False}
    given["energy"] = {}
    computed(tmp_path / "s.sqlite", given, here)
    study = read_study(given)
    scene = read_scene(study.scene_at(study.points[1][0], 0))
    diagram, simulation = follow(scene), simulate(scene, tmp_path)
    with Study(tmp_path / "s.sqlite") as asked:
        found = asked.attractors().arrays()
        rows = simulation.sweep.rows
        assert found["notation"].tolist() == [row.attractor.notation for row in rows]
        assert found["value"].tolist() == [row.value for row in rows] == [0.45, 0.4]
        (sweep,) = asked.sweeps()
        for one, row in zip(sweep.rows, rows, strict=True):
            assert (one.direction, one.value) == (row.direction, row.value)
            kept = ("kind", "parameters", "notation", "word", "period", "forcing_period")
            assert all(getattr(one.attractor, n) == getattr(row.attractor, n) for n in kept)
        energies = asked.select("energies").arrays()["per_time"].tolist()
        assert energies == [
            attractor_voltages(scene.energy, row.attractor).per_time for row in rows
        ]
        assert min(energies) > 0.0
        assert asked.table(0, "b1") == branch_text(diagram.branches[0])
        assert asked.curve(0, "c1") == curve_text(diagram.curves[0])
        (point,) = asked.select("codimension_two", kind="PD-G")
    assert point["second_value"] == pytest.approx(0.185725166, abs=1e-8)
    assert point["derived"] == pytest.approx(0.229925231, abs=1e-8)


# Scenes that fail


@pytest.mark.full
def test_a_scene_without_orbits_is_recorded_and_the_others_go_on(here, tmp_path):
    given = study_given(grid={"beta": [0.4], "r": [0.3], "s": [0.389, 0.37]})
    del given["model"]["parameters"]["s"]
    given["follow"]["orbits"] = ["7:1"]
    tally, _ = computed(tmp_path / "s.sqlite", given, here)
    assert (tally.done, tally.failed) == (2, 2)
    held = contents(tmp_path / "s.sqlite")
    assert {row["kind"] for row in held["failures"]} == {"refused"}
    assert "no BBBBBBBT orbit was found" in held["failures"][0]["reason"]


def broken_follow(scene, tell):
    raise ZeroDivisionError("by nothing")


@pytest.mark.full
def test_any_error_is_recorded_with_its_reason_and_can_be_tried_again(
    here, uninterrupted, tmp_path, monkeypatch
):
    path = tmp_path / "s.sqlite"
    with monkeypatch.context() as patch:
        patch.setattr(run, "follow", broken_follow)
        tally, _ = computed(path, study_given(), here)
    assert tally.failed == 4
    assert {r["reason"] for r in contents(path)["failures"]} == {"ZeroDivisionError: by nothing"}
    tally, _ = computed(path, study_given(), here)
    assert tally.done == 0
    tally, _ = computed(path, study_given(), here, again=True)
    assert tally.done == 4
    assert contents(path) == contents(uninterrupted)


def hanging(scene, tell):
    while True:
        pass


def telling(scene, tell):
    while True:
        tell("still at it")
        time.sleep(0.01)


def task(seconds):
    study = read_study(study_given())
    return Task(study.scene_at(study.points[1][0]), study.keep, "d", seconds)


@pytest.mark.skipif(os.name != "posix", reason="a POSIX timer")
def test_a_scene_that_hangs_is_ended_by_a_timer(monkeypatch):
    monkeypatch.setattr(run, "follow", hanging)
    outcome = compute(task(0.1))
    assert outcome.status == "failed"
    assert outcome.rows["failures"] == [
        {"kind": "budget", "reason": "not finished within its 0.1 s"}
    ]
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


@pytest.mark.skipif(os.name != "posix", reason="a POSIX timer")
@pytest.mark.parametrize("stage", ["following b2", "sweep"])
def test_what_a_scene_has_when_its_budget_ends_is_kept(monkeypatch, stage):
    """The budget ends while the second branch is followed, or the simulation runs."""
    given = task(600)
    whole = compute(given)
    assert (whole.status, "failures" in whole.rows) == ("done", False)

    def late(limit, text):
        if stage in text:
            limit.ring()

    monkeypatch.setattr(run.TimeLimit, "__call__", late)
    if stage == "sweep":
        table = {"range": [0.34, 0.35], "values": 3}
        scene = {**given.scene, "simulate": table}
        given = dataclasses.replace(given, scene=scene, keep=(*given.keep, "attractors"))
    outcome = compute(given)
    assert outcome.status == "incomplete"
    assert outcome.rows["failures"] == [
        {"kind": "budget", "reason": "not finished within its 600 s"}
    ]
    names = [row["branch"] for row in outcome.rows["branches"]]
    known = [row["branch"] for row in whole.rows["branches"]]
    assert names == (known if stage == "sweep" else known[: len(names)]) != []
    assert ("attractors" in outcome.rows) == (stage == "sweep")


def swallowing(scene, tell):
    """Loses what the timer raises, as callbacks of C do."""
    with contextlib.suppress(BudgetError):
        hanging(scene, tell)
    hanging(scene, tell)


@pytest.mark.skipif(os.name != "posix", reason="a POSIX timer")
def test_the_timer_rings_again_where_it_was_not_heard(monkeypatch):
    monkeypatch.setattr(run, "AGAIN", 0.05)
    monkeypatch.setattr(run, "follow", swallowing)
    assert compute(task(0.1)).rows["failures"][0]["kind"] == "budget"


@pytest.mark.full
def test_scenes_go_alone_and_with_time_to_compile_until_one_is_done(here, tmp_path, monkeypatch):
    """On a busy machine compiling takes longer than a scene may."""
    tasks = []

    def refused_first(given):
        tasks.append(given)
        return run.lost_outcome("nothing") if len(tasks) == 1 else compute(given)

    monkeypatch.setattr(run, "compute", refused_first)
    computed(tmp_path / "s.sqlite", study_given(), here)
    assert [t.budget for t in tasks] == [600 + run.COMPILING] * 2 + [600] * 2
    assert [t.expected > 0 for t in tasks] == [True] * 2 + [False] * 2


def test_elsewhere_than_in_the_main_thread_it_is_ended_when_it_tells_its_progress(monkeypatch):
    monkeypatch.setattr(run, "follow", telling)
    with ThreadPoolExecutor(1) as executor:
        outcome = executor.submit(compute, task(0.1)).result()
    assert outcome.rows["failures"][0]["kind"] == "budget"


def test_an_interrupted_diagram_is_incomplete(monkeypatch):
    def failing(scene, tell):
        diagram = follow(scene)
        diagram.statistics["failure"] = "the computation failed"
        return diagram

    monkeypatch.setattr(run, "follow", failing)
    outcome = compute(task(None))
    assert outcome.status == "incomplete"
    assert outcome.rows["events"]
    assert outcome.rows["failures"] == [{"kind": "numerical", "reason": "the computation failed"}]


# Processes


@pytest.mark.full
def test_a_scene_that_kills_its_worker_is_recorded_and_the_others_are_whole(
    uninterrupted, tmp_path, monkeypatch
):
    monkeypatch.setattr(run, "compute", small_studies.deadly)
    path = tmp_path / "s.sqlite"
    tally, _ = computed(
        path, study_given(grid={"beta": [0.3, 0.4], "r": [0.3]}), executors.processes(1)
    )
    assert (tally.done, tally.failed) == (2, 1)
    held = contents(path)
    assert [row["status"] for row in held["scenes"]] == ["failed", "done"]
    (failure,) = held["failures"]
    assert failure["kind"] == "worker"
    assert failure["reason"].startswith("its worker ended each of 2 times: killed")


@pytest.mark.full
def test_a_worker_that_somebody_kills_costs_nothing(uninterrupted, tmp_path, monkeypatch):
    monkeypatch.setattr(run, "compute", small_studies.killed_once)
    monkeypatch.setenv("KILLED_ONCE", str(tmp_path / "mark"))
    tally, _ = computed(tmp_path / "s.sqlite", study_given(), executors.processes(1))
    assert (tally.done, tally.failed) == (4, 0)
    assert contents(tmp_path / "s.sqlite") == contents(uninterrupted)


def test_workers_take_one_thread_each_and_leave_the_environment_alone(monkeypatch):
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("MKL_NUM_THREADS", "3")
    with executors.processes(1).opening(None) as pool:
        found = pool.submit(os.getenv, "OMP_NUM_THREADS").result()
        given = pool.submit(os.getenv, "MKL_NUM_THREADS").result()
    assert (found, given) == ("1", "3")
    assert "OMP_NUM_THREADS" not in os.environ


UNGUARDED = """
from pathlib import Path
with Path("started").open("a") as file:
    file.write("x")
from contimpact import Store, load_study, run_study
with Store("s.sqlite") as store:
    run_study(load_study("study.toml"), store)
"""


@pytest.mark.full
def test_a_script_that_its_workers_would_run_again_is_told_what_to_write(tmp_path):
    (tmp_path / "study.toml").write_text(TOML.format(name="small", count=2))
    (tmp_path / "script.py").write_text(UNGUARDED)
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, timeout=100
    )
    assert done.returncode == 1
    assert done.stderr.count("Traceback") == 1
    assert done.stderr.rstrip().endswith(
        "run_study: its workers run this script again, and end before they begin; "
        'write what calls it below the line  if __name__ == "__main__":'
    )
    assert (tmp_path / "started").read_text() == "xx"


@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
def test_a_worker_killed_before_it_begins_is_no_fault_of_a_script(monkeypatch):
    """It is lost like any other, so that a new one takes its place."""
    monkeypatch.setattr(executors, "_start_worker", small_studies.killed_at_once)
    with executors.processes(1).opening(None) as pool, pytest.raises(BrokenExecutor):
        pool.submit(int).result()


def test_it_is_said_that_a_study_waits_for_workers(tmp_path, monkeypatch):
    """As on a scheduler that no worker has joined yet."""
    lines, joining = [], threading.Event()
    monkeypatch.setattr(run, "LONG", 0.05)

    def tell(text):
        lines.append(text)
        joining.set()

    with ThreadPoolExecutor(1) as executor:
        executor.submit(joining.wait, 60.0)
        own = executors.given(executor)
        workshop = dataclasses.replace(own, joined=True, workers=lambda executor: None)
        tally, _ = computed(tmp_path / "s.sqlite", study_given(), workshop, progress=tell)
    assert lines[0] == "0 of 4 scenes, waiting for a worker: none has joined, or is left"
    assert tally.done == 4


@pytest.mark.full
def test_an_executor_that_is_lost_is_reported(tmp_path):
    with ThreadPoolExecutor(1) as executor:
        workshop = executors.given(executor)

        class Lost(ThreadPoolExecutor):
            def submit(self, *given):
                from concurrent.futures import BrokenExecutor

                raise BrokenExecutor("gone")

        with Lost(1) as lost, pytest.raises(WorkersLostError, match="0 of 4 scenes finished"):
            computed(tmp_path / "s.sqlite", study_given(), executors.given(lost))
        tally, _ = computed(tmp_path / "s.sqlite", study_given(), workshop)
    assert tally.done == 4


def command(study, store, *more):
    return [sys.executable, "-m", "contimpact", "study", str(study), "-o", str(store), "-q", *more]


@pytest.mark.skipif(os.name != "posix", reason="POSIX signals")
@pytest.mark.parametrize("kills", [1, pytest.param(10, marks=pytest.mark.slow)])
@pytest.mark.full
def test_a_killed_study_goes_on_to_the_same_result(kills, tmp_path):
    """Killed at random moments; the workers end with their parent."""
    generator = random.Random(3)
    study = tmp_path / "study.toml"
    study.write_text(TOML.format(name="small", count=3 * kills))
    computed_here(tmp_path / "whole.sqlite", count=3 * kills)
    path, killed, longest = tmp_path / "killed.sqlite", 0, 3.0
    while killed < kills:
        begun = time.monotonic()
        process = subprocess.Popen(command(study, path, "-w", "1"))
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(generator.uniform(0.3, 1.0) * longest)
        if process.poll() is None:
            killed += 1
            process.kill()
            process.wait()
        else:  # done before all kills: what is left of them has to find more to do, and be sooner
            assert process.returncode == 0
            longest = min(longest, time.monotonic() - begun)
            path.unlink()
    subprocess.run(command(study, path, "-w", "1"), check=True)
    assert contents(path) == contents(tmp_path / "whole.sqlite")


def test_the_entries_of_a_kept_catalogue_are_those_of_a_run(uninterrupted, tmp_path):
    (row, *_) = contents(uninterrupted)["catalogues"]
    (tmp_path / "catalogue.json").write_text(decompress_text(row["content"]))
    assert load_entries(tmp_path)


# The command


@pytest.mark.full
def test_the_command_says_what_it_does(tmp_path, capsys):
    study = tmp_path / "study.toml"
    study.write_text(TOML.format(name="small", count=2))
    store = tmp_path / "s.sqlite"
    assert main(["study", str(study), "-o", str(store), "-w", "1"]) == 0
    out, err = capsys.readouterr()
    assert out.splitlines()[0] == "small: 4 scenes"
    assert out.splitlines()[-1].startswith(f"small: 4 of 4 scenes in {store}; 4 took ")
    assert out.splitlines()[-1].endswith("; limits cut 4 short: SELECT * FROM limits")
    assert "of 4 scenes" in err
    assert main(["study", str(study), "-o", str(store), "-q"]) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["-w", "0"], "--workers: found 0"),
        (["--mpi", "--scheduler", "x"], "--mpi: --scheduler is given too"),
    ],
)
def test_options_that_make_no_sense(more, message, tmp_path, capsys):
    study = tmp_path / "study.toml"
    study.write_text(TOML.format(name="small", count=2))
    assert main(["study", str(study), "-o", str(tmp_path / "s"), *more]) == 2
    assert message in capsys.readouterr().err


def half_failing(scene, tell):
    """Numbers fail in one scene, and another one is refused."""
    if scene.model.values["r"] == 0.35:
        raise InputError("scene", "refused", "give another")
    diagram = follow(scene)
    diagram.statistics["failure"] = "the computation failed"
    return diagram


@pytest.mark.parametrize("quiet", [False, True])
def test_scenes_that_failed_are_told_also_of_earlier_runs(
    quiet, here, tmp_path, capsys, monkeypatch
):
    study, store = tmp_path / "study.toml", str(tmp_path / "s.sqlite")
    study.write_text(TOML.format(name="small", count=2))
    monkeypatch.setattr(run, "follow", half_failing)
    monkeypatch.setattr("contimpact.cli.study._workshop", lambda options: here)
    command = ["study", str(study), "-o", store, *["-q"] * quiet]
    for _ in range(2):
        assert main(command) == 0
        said = capsys.readouterr()
        told = said.err if quiet else said.out
        assert "2 failed and 2 incomplete: SELECT * FROM failures; --again" in told
    assert main(["atlas", store, "-o", str(tmp_path / "maps"), "--no-plot"]) == 0
    assert "small: of 4 scenes: 2 failed, 2 incomplete; values" in capsys.readouterr().err


def test_a_scene_is_read_at_its_own_values():
    diagram = load_diagram(ROOT / "branches/fig6_s")  # curves of it start at further values of r
    rows = diagram_rows(diagram, ("readings",), "d", {"r": 0.5})
    own = {branch.id for branch in diagram.branches if branch["r"][0] == 0.5}
    assert {row["branch"] for row in rows["intervals"]} <= own < {b.id for b in diagram.branches}
