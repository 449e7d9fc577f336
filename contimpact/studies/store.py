"""The store of studies: its tables, and who writes to it.

A scene's rows are written in one transaction, so a scene is in the store whole or not at all. The
file is in WAL mode: who reads does not wait for who writes, and a process or a machine that stops
leaves it intact.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import re
import sqlite3
import time
import urllib.parse
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..errors import InputError, NotWrittenError, explain_arguments, shorten
from ..storage import hold_lock
from .study_file import StudyFile

# The schema of a store, as the steps by which it has grown.
#
# A new store takes all steps, an older one those it lacks. Steps are never changed; what has to
# become different is a further step. ``PRAGMA user_version`` says how many a store has taken.
#
# Rows are known by the study's number, the scene's number in it and a name or number in the scene,
# never by the order in which they came: the same study gives the same rows, however often it was
# interrupted.

APPLICATION = 0x636F6E74
"""``PRAGMA application_id`` of a store: "cont"."""

STEPS = (
    """
    CREATE TABLE versions (
        version INTEGER PRIMARY KEY,
        record  TEXT NOT NULL UNIQUE         -- of the package and its libraries, as JSON
    );
    CREATE TABLE studies (
        study      INTEGER PRIMARY KEY,
        name       TEXT NOT NULL UNIQUE,
        source     TEXT NOT NULL,
        digest     TEXT NOT NULL,            -- of all that decides what is computed
        record     TEXT NOT NULL,            -- the study file, as JSON
        keep       TEXT NOT NULL,            -- what is kept, names in a row
        axes       TEXT NOT NULL,            -- parameters that differ, names in a row
        parameter  TEXT NOT NULL,            -- followed
        derived    TEXT,                     -- the first derived parameter, if there is one
        scenes     INTEGER NOT NULL          -- how many there are to compute
    );
    CREATE TABLE runs (                      -- one for each time a study was started or resumed
        study     INTEGER NOT NULL REFERENCES studies,
        began     TEXT NOT NULL,             -- UTC
        executor  TEXT NOT NULL,
        workers   INTEGER,
        scenes    INTEGER NOT NULL,          -- to compute
        estimate  REAL,                      -- s, made after the first few of them
        seconds   REAL,                      -- it has taken; NULL if it did not end by itself
        done      INTEGER
    );
    CREATE TABLE scenes (                    -- that are finished
        study       INTEGER NOT NULL REFERENCES studies,
        scene       INTEGER NOT NULL,
        status      TEXT NOT NULL,           -- done, incomplete or failed
        version     INTEGER NOT NULL REFERENCES versions,
        seconds     REAL,                    -- NULL if its worker ended
        points      INTEGER,                 -- of its branches
        evaluations INTEGER,                 -- of flights
        PRIMARY KEY (study, scene)
    ) WITHOUT ROWID;
    CREATE TABLE coordinates (               -- of scenes, in the study's axes
        study INTEGER NOT NULL,
        scene INTEGER NOT NULL,
        name  TEXT NOT NULL,
        value REAL NOT NULL,
        PRIMARY KEY (study, scene, name)
    ) WITHOUT ROWID;
    CREATE TABLE failures (
        study  INTEGER NOT NULL,
        scene  INTEGER NOT NULL,
        kind   TEXT NOT NULL,                -- refused, numerical, budget, worker or error
        reason TEXT NOT NULL,
        PRIMARY KEY (study, scene)
    ) WITHOUT ROWID;
    CREATE TABLE branches (
        study     INTEGER NOT NULL,
        scene     INTEGER NOT NULL,
        branch    TEXT NOT NULL,
        notation  TEXT NOT NULL,
        word      TEXT NOT NULL,
        period    INTEGER NOT NULL,
        origin    TEXT,                      -- the event it was born at
        points    INTEGER NOT NULL,
        low       REAL NOT NULL,             -- of the followed parameter
        high      REAL NOT NULL,
        first_end TEXT NOT NULL,
        last_end  TEXT NOT NULL,
        missed    INTEGER NOT NULL,          -- events that could not be located
        content   BLOB,                      -- the branch's table, where it is kept
        PRIMARY KEY (study, scene, branch)
    ) WITHOUT ROWID;
    CREATE TABLE events (
        study       INTEGER NOT NULL,
        scene       INTEGER NOT NULL,
        event       TEXT NOT NULL,
        branch      TEXT NOT NULL,
        kind        TEXT NOT NULL,
        label       TEXT NOT NULL,
        ghost       INTEGER NOT NULL,
        notation    TEXT NOT NULL,
        word        TEXT NOT NULL,
        period      INTEGER NOT NULL,
        becomes     TEXT,
        wall        TEXT,
        value       REAL NOT NULL,           -- of the followed parameter
        derived     REAL,                    -- of the study's derived one
        stable      INTEGER NOT NULL,
        physical    INTEGER NOT NULL,
        n_unstable  INTEGER NOT NULL,
        criticality TEXT,
        why         TEXT,
        arclength   REAL NOT NULL,
        residual    REAL NOT NULL,
        error       REAL NOT NULL,
        PRIMARY KEY (study, scene, event)
    ) WITHOUT ROWID;
    CREATE INDEX events_by_label ON events (study, label, ghost);
    CREATE TABLE intervals (                 -- of stable physical orbits
        study        INTEGER NOT NULL,
        scene        INTEGER NOT NULL,
        number       INTEGER NOT NULL,
        branch       TEXT NOT NULL,
        notation     TEXT NOT NULL,
        low          REAL NOT NULL,
        high         REAL NOT NULL,
        low_end      TEXT,                   -- the event's name, or why the branch ends
        high_end     TEXT,
        low_derived  REAL,
        high_derived REAL,
        PRIMARY KEY (study, scene, number)
    ) WITHOUT ROWID;
    CREATE TABLE transitions (               -- from an orbit to one with one impact more
        study     INTEGER NOT NULL,
        scene     INTEGER NOT NULL,
        number    INTEGER NOT NULL,
        source    TEXT NOT NULL,
        target    TEXT NOT NULL,
        mechanism INTEGER,
        grazing   TEXT NOT NULL,             -- the event
        doubling  TEXT,
        fold      TEXT,
        PRIMARY KEY (study, scene, number)
    ) WITHOUT ROWID;
    CREATE TABLE attractors (
        study     INTEGER NOT NULL,
        scene     INTEGER NOT NULL,
        number    INTEGER NOT NULL,
        direction TEXT NOT NULL,
        value     REAL NOT NULL,
        kind      TEXT NOT NULL,
        notation  TEXT NOT NULL,
        word      TEXT,
        period    INTEGER,
        exponent  REAL,                      -- the larger Lyapunov exponent per impact
        rate      REAL,                      -- impacts per forcing period, or unit of time
        gap       REAL,                      -- the smallest
        PRIMARY KEY (study, scene, number)
    ) WITHOUT ROWID;
    CREATE TABLE energies (                  -- of the attractors
        study      INTEGER NOT NULL,
        scene      INTEGER NOT NULL,
        number     INTEGER NOT NULL,
        per_impact REAL NOT NULL,            -- V
        per_time   REAL NOT NULL,            -- V per unit of dimensionless time
        PRIMARY KEY (study, scene, number)
    ) WITHOUT ROWID;
    CREATE TABLE curves (                    -- of bifurcations in two parameters
        study    INTEGER NOT NULL,
        scene    INTEGER NOT NULL,
        curve    TEXT NOT NULL,
        kind     TEXT NOT NULL,
        label    TEXT NOT NULL,
        notation TEXT NOT NULL,
        first    TEXT NOT NULL,              -- the two parameters
        second   TEXT NOT NULL,
        points   INTEGER NOT NULL,
        content  BLOB NOT NULL,              -- its table
        PRIMARY KEY (study, scene, curve)
    ) WITHOUT ROWID;
    CREATE TABLE catalogues (                -- whole, where they are kept
        study   INTEGER NOT NULL,
        scene   INTEGER NOT NULL,
        content BLOB NOT NULL,
        PRIMARY KEY (study, scene)
    ) WITHOUT ROWID;
    """,
    """
    CREATE TABLE codimension_two (           -- points on the curves
        study        INTEGER NOT NULL,
        scene        INTEGER NOT NULL,
        number       INTEGER NOT NULL,
        curve        TEXT NOT NULL,
        kind         TEXT NOT NULL,
        notation     TEXT NOT NULL,
        first        TEXT NOT NULL,          -- the two parameters
        second       TEXT NOT NULL,
        first_value  REAL NOT NULL,
        second_value REAL NOT NULL,
        derived      REAL,
        residual     REAL NOT NULL,
        error        REAL NOT NULL,          -- of the second parameter
        PRIMARY KEY (study, scene, number)
    ) WITHOUT ROWID;
    """,
    """
    CREATE TABLE limits (                    -- of the scene, that cut something off
        study    INTEGER NOT NULL,
        scene    INTEGER NOT NULL,
        number   INTEGER NOT NULL,
        key      TEXT NOT NULL,              -- of the scene, such as follow.max_branches
        value    INTEGER NOT NULL,
        what     TEXT NOT NULL,              -- was left out
        left_out INTEGER NOT NULL,           -- how many
        PRIMARY KEY (study, scene, number)
    ) WITHOUT ROWID;
    """,
)

COLUMNS = {
    table: re.findall(r"^ +(\w+) +(?:TEXT|INTEGER|REAL|BLOB)", body, re.MULTILINE)
    for step in STEPS
    for table, body in re.findall(
        r"CREATE TABLE (\w+) \((.*?)^    \)", step, re.MULTILINE | re.DOTALL
    )
}
"""The columns of each table."""
OF_SCENES = tuple(t for t, own in COLUMNS.items() if "scene" in own and t != "scenes")
"""The tables with rows of a scene, besides that of the scenes."""


def row_of(table: str, one: Any, **known: Any) -> dict[str, Any]:
    """Return the row of a table: what is known of it, and for other columns the attributes that are
    called so."""
    names = (name for name in COLUMNS[table] if name not in ("study", "scene"))
    return {name: known[name] if name in known else getattr(one, name) for name in names}


def compress_text(text: str) -> bytes:
    """Return a text compressed."""
    return zlib.compress(text.encode(), 9)


def decompress_text(content: bytes) -> str:
    """Return the text that `compress_text` has compressed."""
    return zlib.decompress(content).decode()


@dataclass(frozen=True)
class Outcome:
    """What has become of a scene."""

    status: str
    """``done``, ``incomplete`` where a failure ended it early, or ``failed``."""
    seconds: float | None
    versions: str
    """Versions of the package and its libraries, as JSON."""
    rows: Mapping[str, Sequence[Mapping[str, Any]]] = field(default_factory=dict)
    """Rows, by table."""
    points: int | None = None
    evaluations: int | None = None


PATIENCE = 60.0
"""Seconds to wait for another process that writes."""
CLOSED = ("SQLITE_READONLY_DIRECTORY", "SQLITE_READONLY_CANTINIT", "SQLITE_CANTOPEN")
"""SQLite's message about a store in WAL mode in a folder that cannot be written."""
_HEAD = b"SQLite format 3\0"


@explain_arguments
class Store:
    """A store that is open for writing.

    Parameters
    ----------
    path : str or Path
        The file; it is made if it is not there, and brought to the present schema if it is older.

    Raises
    ------
    InputError
        If it is no store, is of a newer schema, or cannot be opened.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        with self.writing():
            self.connection = open_store(self.path)
            try:
                _migrate(self.connection)
            except BaseException:
                self.connection.close()
                raise

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *ended: object) -> None:
        self.connection.close()

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Say clearly why the store cannot be written."""
        try:
            yield
        except sqlite3.Error as error:
            raise refusal(self.path, error) from None

    @contextlib.contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """Write all of the block or nothing."""
        with self.writing():
            self.connection.execute("BEGIN IMMEDIATE")
            try:
                yield self.connection
                self.connection.execute("COMMIT")
            except BaseException:
                with contextlib.suppress(sqlite3.Error):  # a full disk has ended it already
                    self.connection.execute("ROLLBACK")
                raise

    def claimed(self, name: str) -> contextlib.AbstractContextManager[None]:
        """Keep other processes from computing a study of this name into this store.

        Raises
        ------
        InputError
            If another one does.
        """
        own = hashlib.sha256(name.encode()).hexdigest()[:8]
        return hold_lock(self.path.parent, f".{self.path.name}-{own}.lock")

    def enter(self, study: StudyFile) -> int:
        """Return the number of a study in the store, new or known.

        Raises
        ------
        InputError
            If another study is called so.
        """
        with self.transaction() as connection:
            known = connection.execute(
                "SELECT study, digest FROM studies WHERE name = ?", [study.name]
            ).fetchone()
            if known is None:
                return _enter_study(connection, study)
        number, digest = known
        if digest != study.digest:
            found = f"another study called {study.name!r} is in it"
            raise InputError(str(self.path), found, "give the study a name of its own")
        return int(number)

    def finished(self, study: int, failed: bool = True) -> set[int]:
        """Return the scenes of a study that are in the store; without failed ones if so told."""
        with self.writing():
            rows = self.connection.execute(
                "SELECT scene FROM scenes WHERE study = ? AND (? OR status = 'done')",
                [study, failed],
            )
            return {scene for (scene,) in rows}

    def statuses(self, study: int) -> dict[str, int]:
        """Return how many scenes of a study there are in the store, by their status."""
        query = "SELECT status, count(*) FROM scenes WHERE study = ? GROUP BY status"
        with self.writing():
            return dict(self.connection.execute(query, [study]).fetchall())

    def record(
        self, study: int, scene: int, coordinates: Mapping[str, float], outcome: Outcome
    ) -> None:
        """Write all that is kept of a scene, in place of what there may be of it."""
        key = {"study": study, "scene": scene}
        own = {
            name: getattr(outcome, name) for name in ("status", "seconds", "points", "evaluations")
        }
        placed = [{"name": name, "value": value} for name, value in coordinates.items()]
        with self.transaction() as connection:
            for table in OF_SCENES:
                connection.execute(
                    f"DELETE FROM {table} WHERE study = ? AND scene = ?", [study, scene]
                )
            version = _version(connection, outcome.versions)
            _insert(connection, "scenes", [{**own, "version": version}], key, "OR REPLACE ")
            _insert(connection, "coordinates", placed, key)
            for table, rows in outcome.rows.items():
                _insert(connection, table, rows, key)

    def begin_run(self, study: int, executor: str, workers: int | None, scenes: int) -> int:
        """Record that a study is started or resumed; returns the run's number."""
        with self.transaction() as connection:
            return int(
                connection.execute(
                    "INSERT INTO runs (study, began, executor, workers, scenes)"
                    " VALUES (?, strftime('%Y-%m-%dT%H:%M:%SZ', 'now'), ?, ?, ?)",
                    [study, executor, workers, scenes],
                ).lastrowid
                or 0
            )

    def note_run(self, run: int, **known: float) -> None:
        """Record what is known of a run: its estimate, and at last what it has taken."""
        changes = ", ".join(f"{name} = :{name}" for name in known)
        with self.transaction() as connection:
            connection.execute(
                f"UPDATE runs SET {changes} WHERE rowid = :run", {**known, "run": run}
            )


def open_store(path: Path, *, readonly: bool = False) -> sqlite3.Connection:
    """Return a connection to a store.

    Raises InputError if there is none, or the file is something else.
    """
    _check_file(path, readonly)
    try:
        return _connect(path, "ro" if readonly else "rwc")
    except sqlite3.OperationalError as error:
        closed = error.sqlite_errorname in CLOSED
        if not (readonly and closed) or path.with_name(f"{path.name}-wal").exists():
            raise
        return _connect(path, "ro&immutable=1")  # nobody writes it, and nobody can


def _connect(path: Path, mode: str) -> sqlite3.Connection:
    place = f"file:{urllib.parse.quote(str(path.absolute()))}?mode={mode}"
    connection = sqlite3.connect(place, uri=True, timeout=PATIENCE, isolation_level=None)
    try:
        connection.execute("PRAGMA trusted_schema = OFF")
        _check_owner(connection, path)
    except BaseException:
        connection.close()
        raise
    return connection


def _check_file(path: Path, readonly: bool) -> None:
    """Refuse what is no store before SQLite touches it."""
    if path.is_symlink():
        raise InputError(str(path), "a link", "give the store itself")
    if not path.exists():
        if readonly:
            accepted = "give a store, as contimpact study writes it"
            raise InputError(str(path), "no such file", accepted)
        if not path.parent.is_dir():
            raise InputError(str(path), f"no folder {path.parent}", "make it first")
        return
    try:
        with open(path, "rb") as file:
            head = file.read(len(_HEAD))
    except OSError as error:
        found = f"cannot be read ({error.strerror or error})"
        raise InputError(str(path), found, "give a store, or a new file") from None
    if head and head != _HEAD:
        accepted = "give a store, as contimpact study writes it, or a new file"
        raise InputError(str(path), "no SQLite file", accepted)


def _check_owner(connection: sqlite3.Connection, path: Path) -> None:
    """Refuse other people's databases, and stores of a later version of the package."""
    # emptiness first: another process may make a store of it at this moment
    empty = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0] == 0
    owner, grown = (
        connection.execute(f"PRAGMA {name}").fetchone()[0]
        for name in ("application_id", "user_version")
    )
    if owner != APPLICATION and not (owner == 0 and empty):
        accepted = "give a store, as contimpact study writes it, or a new file"
        raise InputError(str(path), "a database of something else", accepted)
    if grown > len(STEPS):
        found = f"its schema is {grown}, this version of contimpact knows {len(STEPS)}"
        raise InputError(str(path), found, "use a newer contimpact, or another store")


def _migrate(connection: sqlite3.Connection) -> None:
    """Take the steps of the schema that a store lacks."""
    _log_ahead(connection)
    connection.execute("PRAGMA synchronous = NORMAL")
    while (done := schema_version(connection)) < len(STEPS):
        script = f"BEGIN IMMEDIATE; {STEPS[done]} PRAGMA user_version = {done + 1};"
        script += f" PRAGMA application_id = {APPLICATION}; COMMIT;"
        try:
            connection.executescript(script)
        except sqlite3.OperationalError:
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            if schema_version(connection) == done:  # nobody else has taken the step meanwhile
                raise


def _log_ahead(connection: sqlite3.Connection) -> None:
    """Keep a write-ahead log. Where several turn to it at once, SQLite refuses without waiting."""
    end = time.monotonic() + PATIENCE
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
            return
        except sqlite3.OperationalError as error:
            if error.sqlite_errorname != "SQLITE_BUSY" or time.monotonic() > end:
                raise
        time.sleep(0.01)


def schema_version(connection: sqlite3.Connection) -> int:
    """Return how many steps of the schema a store has taken."""
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def _enter_study(connection: sqlite3.Connection, study: StudyFile) -> int:
    scene = study.first
    row = {
        "name": study.name,
        "source": study.source,
        "digest": study.digest,
        "record": json.dumps(study.given),
        "keep": " ".join(study.keep),
        "axes": " ".join(study.design.names),
        "parameter": scene.parameter,
        "derived": next(iter(scene.model.DERIVED), None),
        "scenes": len(study),
    }
    _insert(connection, "studies", [row], {})
    return int(connection.execute("SELECT last_insert_rowid()").fetchone()[0])


def _version(connection: sqlite3.Connection, record: str) -> int:
    connection.execute("INSERT OR IGNORE INTO versions (record) VALUES (?)", [record])
    found = connection.execute("SELECT version FROM versions WHERE record = ?", [record])
    return int(found.fetchone()[0])


def _insert(
    connection: sqlite3.Connection,
    table: str,
    rows: Sequence[Mapping[str, Any]],
    key: Mapping[str, int],
    how: str = "",
) -> None:
    """Insert rows of a table that all have the same columns, and those of a key."""
    if not rows:
        return
    columns = [*key, *rows[0]]
    places = ", ".join(f":{name}" for name in columns)
    command = f"INSERT {how}INTO {table} ({', '.join(columns)}) VALUES ({places})"
    connection.executemany(command, [{**key, **row} for row in rows])


def refusal(path: Path, error: sqlite3.Error) -> InputError:
    """Return what is said of a store that could not be read or written."""
    said = shorten(str(error), 100)
    name = getattr(error, "sqlite_errorname", "")
    if name.startswith(("SQLITE_FULL", "SQLITE_IOERR")):
        kept = ["all scenes that were finished before"]
        return NotWrittenError(str(path.parent), kept, {path.name: said})
    if name.startswith(("SQLITE_READONLY", "SQLITE_CANTOPEN")):
        return InputError(str(path), f"cannot be written ({said})", "give another place")
    if name.startswith("SQLITE_BUSY"):
        found = f"another process has been writing it for {PATIENCE:g} s"
        return InputError(str(path), found, "wait until it has ended, and start again: it goes on")
    if name == "SQLITE_ERROR":
        accepted = "mend the query, or give another store"
        return InputError(str(path), f"a query cannot be answered ({said})", accepted)
    found = f"cannot be used ({said})"
    return InputError(str(path), found, "give another store, or a copy of this one")
