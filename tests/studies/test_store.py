"""The store: what is none is refused, an older one grows, nothing is ever half written."""

from __future__ import annotations

import contextlib
import os
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest
from small_studies import TOML, computed_here, contents, study_given

from contimpact.cli import main
from contimpact.errors import InputError, NotWrittenError
from contimpact.studies.store import (
    APPLICATION,
    COLUMNS,
    STEPS,
    Outcome,
    Store,
    _migrate,
    schema_version,
)
from contimpact.studies.study_file import read_study

EVENT = {
    "event": "e1",
    "branch": "b1",
    "kind": "PD",
    "label": "PD",
    "ghost": False,
    "notation": "1:1",
    "word": "BT",
    "period": 1,
    "becomes": None,
    "wall": None,
    "value": 0.1,
    "stable": True,
    "physical": True,
    "n_unstable": 0,
    "criticality": None,
    "why": 'it\'s a "quoted" name',
    "arclength": 0.5,
    "residual": 0.0,
    "error": 1e-16,
    "derived": 0.3,
}


def outcome(*events, **more):
    return Outcome("done", 0.1, "{}", {"events": events, **more}, 10, 100)


def test_tables_are_those_of_the_schema(tmp_path):
    with Store(tmp_path / "s.sqlite") as store:
        known = store.connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        assert {name for (name,) in known} == {*COLUMNS}
        assert store.connection.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        assert store.connection.execute("PRAGMA user_version").fetchone() == (len(STEPS),)


def test_a_store_is_made_by_several_at_once(tmp_path):
    """None of them takes what another one is making for somebody else's."""

    def make(path):
        Store(path).connection.close()

    with ThreadPoolExecutor(4) as threads:
        for number in range(30):
            list(threads.map(make, [tmp_path / f"{number}.sqlite"] * 4))


def test_a_log_that_others_begin_at_the_same_time_is_waited_for(tmp_path):
    """SQLite's timeout does not hold for that: one in a thousand such stores failed at once."""
    path, refused = tmp_path / "s.sqlite", []

    class Busy(sqlite3.Connection):
        def execute(self, text, *given):
            if "journal_mode" in text and len(refused) < 3:
                refused.append(sqlite3.OperationalError("database is locked"))
                refused[-1].sqlite_errorname = "SQLITE_BUSY"
                raise refused[-1]
            return super().execute(text, *given)

    with contextlib.closing(sqlite3.connect(path, factory=Busy, isolation_level=None)) as one:
        _migrate(one)
        assert one.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        assert schema_version(one) == len(STEPS)
    assert len(refused) == 3


def test_a_scene_is_there_whole_or_not_at_all(tmp_path):
    path = tmp_path / "s.sqlite"
    with Store(path) as store:
        study = store.enter(read_study(study_given()))
        store.record(study, 0, {"beta": 0.3}, outcome(EVENT))
        before = contents(path)
        with pytest.raises(InputError, match="UNIQUE"):
            store.record(study, 1, {"beta": 0.4}, outcome(EVENT, EVENT))
        assert contents(path) == before
        store.record(study, 0, {"beta": 0.3}, outcome(EVENT))  # again, in its place
        assert contents(path) == before
        assert before["events"][0]["why"] == EVENT["why"]


def test_a_store_of_a_newer_schema_is_refused_and_not_touched(tmp_path):
    path = tmp_path / "s.sqlite"
    Store(path).connection.close()
    connection = sqlite3.connect(path)
    connection.execute(f"PRAGMA user_version = {len(STEPS) + 1}")
    connection.close()
    before = path.read_bytes()
    with pytest.raises(InputError, match=f"its schema is {len(STEPS) + 1}"):
        Store(path)
    assert path.read_bytes() == before


@pytest.mark.parametrize("taken", range(1, len(STEPS)))
def test_a_store_of_an_older_schema_grows_and_keeps_what_it_holds(taken, tmp_path):
    path = tmp_path / "s.sqlite"
    older = sqlite3.connect(path)
    for step in STEPS[:taken]:
        older.executescript(step)
    older.execute(f"PRAGMA user_version = {taken}")
    older.execute(f"PRAGMA application_id = {APPLICATION}")
    key = {"study": 1, "scene": 7}
    names = ", ".join((*key, *EVENT))
    places = ", ".join("?" * len((*key, *EVENT)))
    older.execute(f"INSERT INTO events ({names}) VALUES ({places})", [*{**key, **EVENT}.values()])
    older.commit()
    before = older.execute("SELECT * FROM events").fetchall()
    older.close()
    with Store(path) as store:
        assert store.connection.execute("PRAGMA user_version").fetchone() == (len(STEPS),)
        assert store.connection.execute("SELECT * FROM events").fetchall() == before
        known = store.connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
        assert {name for (name,) in known} == {*COLUMNS}


def other_database(path):
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE mine (x)")
    connection.close()


NO_STORES = {
    "text": (lambda path: path.write_text("something else entirely"), "no SQLite file"),
    "foreign": (other_database, "a database of something else"),
    "folder": (lambda path: path.mkdir(), "cannot be read"),
    "link": (lambda path: path.symlink_to(path.with_name("elsewhere")), "a link"),
    "damaged": (
        lambda path: path.write_bytes(b"SQLite format 3\0" + bytes(range(256)) * 20),
        "cannot be",
    ),
}


@pytest.mark.parametrize("name", NO_STORES)
def test_what_is_no_store_is_refused_and_not_touched(name, tmp_path):
    make, message = NO_STORES[name]
    path = tmp_path / "s.sqlite"
    make(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(InputError, match=message):
        Store(path)
    assert (path.read_bytes() if path.is_file() else None) == before


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="no folder"):
        Store(tmp_path / "nowhere" / "s.sqlite")


@pytest.mark.skipif(
    not os.path.isdir("/proc/self"), reason="no file system that is read-only to all"
)
def test_a_folder_that_cannot_be_written(tmp_path, capsys):
    study = tmp_path / "study.toml"
    study.write_text(TOML.format(name="small", count=2))
    assert main(["study", str(study), "-o", "/proc/self/s.sqlite"]) == 2
    assert "/proc/self/s.sqlite: cannot be written" in capsys.readouterr().err


def test_a_file_that_cannot_be_written(tmp_path, monkeypatch):
    path = tmp_path / "s.sqlite"
    with Store(path) as store:
        study = store.enter(read_study(study_given()))
        store.connection.execute("PRAGMA query_only = ON")
        with pytest.raises(InputError, match=r"s\.sqlite: cannot be written .*readonly"):
            store.record(study, 0, {"beta": 0.3}, outcome(EVENT))


def test_a_full_store_keeps_what_it_holds(tmp_path):
    """SQLite's own limit of pages: the same error as a disk without room."""
    path = tmp_path / "s.sqlite"
    with Store(path) as store:
        study = store.enter(read_study(study_given()))
        store.record(study, 0, {"beta": 0.3}, outcome(EVENT))
        before = contents(path)
        pages = store.connection.execute("PRAGMA page_count").fetchone()[0]
        store.connection.execute(f"PRAGMA max_page_count = {pages}")
        big = {"catalogues": [{"content": bytes(10**6)}]}
        with pytest.raises(NotWrittenError, match=r"full.*finished before.*run it again"):
            store.record(study, 1, {"beta": 0.3}, outcome(EVENT, **big))
        assert contents(path) == before
        store.connection.execute("PRAGMA max_page_count = 1000000")
        store.record(study, 1, {"beta": 0.3}, outcome(EVENT, **big))
    assert len(contents(path)["scenes"]) == 2


LIMITED = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
limit = int(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
from contimpact.cli import main
sys.exit(main(sys.argv[2:]))
"""


@pytest.mark.skipif(os.name != "posix", reason="limits of POSIX")
@pytest.mark.full
def test_a_study_on_a_disk_that_gets_full_goes_on_when_there_is_room(tmp_path):
    """A file that cannot grow: what was finished stays, and the rest is made later."""
    study, path, whole = (tmp_path / name for name in ("study.toml", "s.sqlite", "w.sqlite"))
    study.write_text(TOML.format(name="small", count=2))
    order = ["study", str(study), "-o", str(path), "-w", "1", "-q"]
    Store(path).connection.close()
    room = str(path.stat().st_size + 60_000)
    done = subprocess.run(
        [sys.executable, "-c", LIMITED, room, *order], capture_output=True, text=True
    )
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert "s.sqlite" in done.stderr
    computed_here(path)
    computed_here(whole)
    assert contents(path) == contents(whole)
    assert sqlite3.connect(path).execute("PRAGMA integrity_check").fetchone() == ("ok",)
