"""The store of studies: one SQLite file, to which several studies may write at once.

A scene's rows are written in one transaction, so a scene is in the store whole or not at all. The
file is in WAL mode: who reads does not wait for who writes, and a process or a machine that stops
leaves it intact.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import sqlite3
import urllib.parse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError, NotWrittenError, shortened
from ..storage.files import locked
from .outcome import Outcome
from .schema import APPLICATION, OF_SCENES, STEPS
from .study_file import StudyFile

PATIENCE = 60.0
"""Seconds to wait for another process that writes."""
CLOSED = ("SQLITE_READONLY_DIRECTORY", "SQLITE_READONLY_CANTINIT", "SQLITE_CANTOPEN")
"""What SQLite says of a store in WAL mode in a folder that cannot be written."""
_HEAD = b"SQLite format 3\0"


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
            self.connection = opened(self.path)
            try:
                _grown(self.connection)
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
        return locked(self.path.parent, f".{self.path.name}-{own}.lock")

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
                return _entered(connection, study)
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


def opened(path: Path, *, readonly: bool = False) -> sqlite3.Connection:
    """Return a connection to a store.

    Raises
    ------
    InputError
        If there is none, or the file is something else.
    """
    _check_file(path, readonly)
    try:
        return _checked(path, "ro" if readonly else "rwc")
    except sqlite3.OperationalError as error:
        closed = error.sqlite_errorname in CLOSED
        if not (readonly and closed) or path.with_name(f"{path.name}-wal").exists():
            raise
        return _checked(path, "ro&immutable=1")  # nobody writes it, and nobody can


def _checked(path: Path, mode: str) -> sqlite3.Connection:
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


def _grown(connection: sqlite3.Connection) -> None:
    """Take the steps of the schema that a store lacks."""
    connection.execute("PRAGMA journal_mode = WAL")
    connection.execute("PRAGMA synchronous = NORMAL")
    while (done := taken(connection)) < len(STEPS):
        script = f"BEGIN IMMEDIATE; {STEPS[done]} PRAGMA user_version = {done + 1};"
        script += f" PRAGMA application_id = {APPLICATION}; COMMIT;"
        try:
            connection.executescript(script)
        except sqlite3.OperationalError:
            if connection.in_transaction:
                connection.execute("ROLLBACK")
            if taken(connection) == done:  # nobody else has taken the step meanwhile
                raise


def taken(connection: sqlite3.Connection) -> int:
    """Return how many steps of the schema a store has taken."""
    return int(connection.execute("PRAGMA user_version").fetchone()[0])


def _entered(connection: sqlite3.Connection, study: StudyFile) -> int:
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
    said = shortened(str(error), 100)
    name = getattr(error, "sqlite_errorname", "")
    if name.startswith(("SQLITE_FULL", "SQLITE_IOERR")):
        kept = ["all scenes that were finished before"]
        return NotWrittenError(str(path.parent), kept, {path.name: said})
    if name.startswith(("SQLITE_READONLY", "SQLITE_CANTOPEN")):
        return InputError(str(path), f"cannot be written ({said})", "give another place")
    if name.startswith("SQLITE_BUSY"):
        found = f"another process has been writing it for {PATIENCE:g} s"
        return InputError(str(path), found, "wait until it has ended, and start again: it goes on")
    found = f"cannot be used ({said})"
    return InputError(str(path), found, "give another store, or a copy of this one")
