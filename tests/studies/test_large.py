"""Large stores: questions answered in time, and memory that does not grow with the scenes."""

from __future__ import annotations

import random
import re
import sqlite3
import subprocess
import sys
import time

import pytest
from small_studies import study_given
from zoo import ROOT

from contimpact import follow, read_scene
from contimpact.studies.run import diagram_rows
from contimpact.studies.store import Store
from contimpact.studies.study import Study
from contimpact.studies.study_file import read_study

QUERIES = re.search(
    r"```sql\n(.*?)```", (ROOT / "docs" / "studies.md").read_text(encoding="utf-8"), re.DOTALL
)[1].split(";")[:-1]
"""The questions of the documentation."""


def filled(path, studies, scenes):
    """A store of many scenes, made of the events of real ones."""
    study = read_study(study_given())
    given = [study.scene_at(values) for values in study.points[1]]
    rows = [diagram_rows(follow(read_scene(g)), ("readings",), "d", {}) for g in given]
    with Store(path) as store:
        store.connection.execute("PRAGMA synchronous = OFF")
        number = 0
        for name in range(studies):
            number = store.enter(read_study(study_given(f"study {name}")))
            store.connection.execute("BEGIN")
            for scene in range(scenes):
                own = {
                    table: [{"study": number, "scene": scene, **row} for row in some]
                    for table, some in rows[scene % len(rows)].items()
                }
                for axis in ("beta", "r"):
                    own.setdefault("coordinates", []).append(
                        {"study": number, "scene": scene, "name": axis, "value": random.random()}
                    )
                for table, some in own.items():
                    if some:
                        names = ", ".join(some[0])
                        marks = ", ".join(f":{column}" for column in some[0])
                        store.connection.executemany(
                            f"INSERT INTO {table} ({names}) VALUES ({marks})", some
                        )
            store.connection.execute("COMMIT")


@pytest.mark.full
def test_the_documented_queries_are_answered(tmp_path):
    filled(tmp_path / "s.sqlite", 1, 20)
    with Study(tmp_path / "s.sqlite") as study:
        assert len(QUERIES) == 5
        for query in QUERIES[:2]:
            assert list(study.rows(query))
        for query in QUERIES:
            list(study.rows(query))


@pytest.mark.slow
def test_a_million_events_are_asked_within_a_second(tmp_path):
    path = tmp_path / "s.sqlite"
    filled(path, 100, 10_000)
    connection = sqlite3.connect(path)
    assert connection.execute("SELECT count(*) FROM events").fetchone()[0] >= 10**6
    seconds = {}
    for query in QUERIES:
        began = time.perf_counter()
        connection.execute(query).fetchall()
        seconds[query.strip().splitlines()[0]] = time.perf_counter() - began
    connection.close()
    print(seconds, path.stat().st_size)
    assert max(seconds.values()) < 1.0


GROWING = """
import sys, resource
from concurrent.futures import Executor, Future
from contimpact import read_study, run_study, Store
from contimpact.studies import run
from contimpact.studies.executors import given
from contimpact.studies.run import diagram_rows
from contimpact.studies.store import Outcome
from contimpact import follow, read_scene
sys.path.insert(0, sys.argv[1])
from small_studies import study_given

class Here(Executor):
    def submit(self, function, *given):
        future = Future()
        future.set_result(outcome)
        return future

study = read_study(study_given())
rows = diagram_rows(follow(read_scene(study.scene_at(study.points[1][0]))), ("readings",), "d", {})
outcome = Outcome("done", 0.1, "{}", rows, 10, 100)
grid = {"beta": {"from": 0.3, "to": 0.5, "count": int(sys.argv[3])}, "r": [0.3]}
with Store(sys.argv[2]) as store:
    run_study(read_study(study_given(grid=grid)), store, given(Here()))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.full
def test_memory_stays_flat_with_the_number_of_scenes(tmp_path):
    """What is left is the list of points: some 50 bytes for each."""

    def peak(scenes):
        command = [sys.executable, "-c", GROWING, str(ROOT / "tests" / "studies")]
        done = subprocess.run(
            [*command, str(tmp_path / f"{scenes}.sqlite"), str(scenes)],
            capture_output=True,
            text=True,
            check=True,
        )
        return int(done.stdout) * (1 if sys.platform == "darwin" else 1024)

    assert peak(3000) - peak(100) < 8e6


def test_what_a_worker_gives_back_is_pickled(tmp_path):
    """Models, scenes, orbits, branches and studies go between processes as they are."""
    import pickle

    import contimpact

    study = read_study(study_given())
    scene = read_scene(study.scene_at(study.points[1][0]))
    (orbit, *_) = contimpact.find_orbits(scene.model, "1:1", parameter="s")
    branch = contimpact.continue_orbit(orbit, "s", (0.3, 0.41), events=["PD", "G"])
    for one in (scene.model, scene, orbit, branch, branch.events[0], study):
        again = pickle.loads(pickle.dumps(one))
        assert type(again) is type(one)
        assert repr(again) == repr(one)
