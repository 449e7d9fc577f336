"""A study in a store, to be asked: rows of its scenes, as tables, arrays or records.

Nothing is read before it is asked for, and what is asked for row by row is never in memory whole.
"""

from __future__ import annotations

import contextlib
import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..display import Shown, Summary, frame
from ..errors import InputError, shown
from .outcome import unpacked
from .schema import OF_SCENES, STEPS
from .store import Store, opened, refusal, taken

if TYPE_CHECKING:
    from ..results.branch import Entry
    from ..simulation.sweep import Sweep
    from .maps import Map

ROWS = ("scenes", *(name for name in OF_SCENES if name not in ("coordinates", "catalogues")))
"""The tables whose rows belong to scenes, which a `Study` gives by these names."""
KEYS = {"events": "event", "branches": "branch", "curves": "curve"}
"""Names within scenes by which rows are put in order: e2 before e10."""
WHOLE = "content"
"""The column of what is kept whole, compressed; it is no column of a selection."""


class Study(Shown):
    """A study in a store, read lazily.

    Parameters
    ----------
    store : str or Path
    name : str, optional
        The study's; it can be left out where the store holds one alone.

    Attributes
    ----------
    name, source : str
    given : mapping
        The study file.
    axes : tuple of str
        The parameters that differ between scenes.
    parameter : str
        Followed in every scene.
    derived : str or None
        The derived parameter that is recorded beside it.
    total : int
        Scenes it has; `len` says how many of them are finished.

    Raises
    ------
    InputError
        If there is no such store, or no such study in it.
    """

    def __init__(self, store: str | Path, name: str | None = None) -> None:
        self.path = Path(store)
        self.connection = _opened(self.path)
        row = self._row(name)
        self.number, self.name, self.source, record, axes, self.parameter, self.derived = row[:7]
        self.total: int = row[7]
        self.axes = tuple(axes.split())
        self.given: Mapping[str, Any] = json.loads(record)

    def _row(self, name: str | None) -> Any:
        columns = "study, name, source, record, axes, parameter, derived, scenes"
        rows = self.rows(f"SELECT {columns} FROM studies WHERE ?1 IS NULL OR name = ?1", [name])
        found = list(rows)
        if len(found) == 1:
            return found[0]
        names = ", ".join(repr(known) for known in studies(self.path))
        self.connection.close()
        what = f"no study {name!r}" if name is not None else f"{len(found)} studies"
        raise InputError(str(self.path), what, f"name one of {names or 'none'}")

    def __enter__(self) -> Study:
        return self

    def __exit__(self, *ended: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the store."""
        self.connection.close()

    def __len__(self) -> int:
        return int(next(self.rows("SELECT count(*) FROM scenes WHERE study = ?", [self.number]))[0])

    def __repr__(self) -> str:
        axes = ", ".join(self.axes)
        return f"<Study {self.name} over {axes}: {len(self)} of {self.total} scenes>"

    def __reduce__(self) -> tuple[Any, ...]:
        """The store is opened again, not sent along."""
        return Study, (str(self.path), self.name)

    def to_dataframe(self, table: str = "scenes") -> Any:
        """Return a table's rows as a pandas DataFrame; see `select`. pandas must be installed."""
        return self.select(table).to_dataframe()

    def summary(self) -> Summary:
        """Return the study's axes, and how much was found on them, in short."""
        columns = "name, count(DISTINCT value), min(value), max(value)"
        query = f"SELECT {columns} FROM coordinates WHERE study = ? GROUP BY name"
        known = {row[0]: row for row in self.rows(query, [self.number])}
        counts = [f"{len(self.select(name))} {name}" for name in ("branches", "events", "failures")]
        rows = [known[name] for name in self.axes if name in known]
        return Summary(
            repr(self)[1:-1], ("axis", "values", "from", "to"), rows, [", ".join(counts)]
        )

    def rows(self, query: str, values: Sequence[Any] | Mapping[str, Any] = ()) -> Iterator[Any]:
        """Yield the rows of a query of one's own, in SQL; `values` stand for its ``?``.

        Raises
        ------
        InputError
            If the store does not answer it.
        """
        try:
            yield from self.connection.execute(query, values)
        except sqlite3.Error as error:
            raise refusal(self.path, error) from None

    # Rows of tables.

    def select(self, table: str, **where: Any) -> Selection:
        """Return rows of a table with given values.

        Parameters
        ----------
        table : str
            Of `ROWS`.
        **where
            By column or axis, a value or a sequence of values.

        Raises
        ------
        InputError
            If there is no such table or column.
        """
        if table not in ROWS:
            raise InputError("table", f"found {shown(table)}", f"accepted are {', '.join(ROWS)}")
        chosen = Selection(self, table, where)
        for name in where:
            if name not in chosen.columns:
                accepted = f"accepted are {', '.join(chosen.columns)}"
                raise InputError(table, f"no column {name!r}", accepted)
        return chosen

    def scenes(self, **where: Any) -> Selection:
        """Return the finished scenes; see `select`."""
        return self.select("scenes", **where)

    def events(self, **where: Any) -> Selection:
        """Return the events of all scenes; see `select`."""
        return self.select("events", **where)

    def branches(self, **where: Any) -> Selection:
        """Return the branches of all scenes; see `select`."""
        return self.select("branches", **where)

    def intervals(self, **where: Any) -> Selection:
        """Return the intervals of stable physical orbits; see `select`."""
        return self.select("intervals", **where)

    def transitions(self, **where: Any) -> Selection:
        """Return the transitions between orbits, with their mechanisms; see `select`."""
        return self.select("transitions", **where)

    def attractors(self, **where: Any) -> Selection:
        """Return the attractors of simulated motion; see `select`."""
        return self.select("attractors", **where)

    def failures(self, **where: Any) -> Selection:
        """Return the scenes that have failed, with their reasons; see `select`."""
        return self.select("failures", **where)

    # What is kept whole.

    def entries(self, scene: int) -> list[Entry]:
        """Return the entries of a scene's catalogue, to look at their orbits or go on from them.

        Raises
        ------
        InputError
            If the study does not keep catalogues, or has no such scene.
        """
        from ..results.catalogue import entry_of

        content = self._content("catalogues", scene)
        return [entry_of(record) for record in json.loads(content)["entries"]]

    def table(self, scene: int, branch: str) -> str:
        """Return a branch's table as `run` writes it; see `entries`."""
        return self._content("branches", scene, "branch", branch)

    def curve(self, scene: int, curve: str) -> str:
        """Return a curve's table as `run` writes it; see `entries`."""
        return self._content("curves", scene, "curve", curve)

    def _content(self, table: str, scene: int, column: str = "scene", name: Any = None) -> str:
        query = f"SELECT content FROM {table} WHERE study = ? AND scene = ? AND {column} = ?"
        found = list(self.rows(query, [self.number, scene, scene if name is None else name]))
        if not found or found[0][0] is None:
            what = f"nothing is kept whole of scene {scene}" + (f", {name}" if name else "")
            kept = {"branches": "tables", "catalogues": "catalogue"}.get(table, table)
            raise InputError(f"study {self.name}", what, f"add {kept!r} to study.keep")
        return unpacked(found[0][0])

    def sweeps(self) -> list[Sweep]:
        """Return the sweeps of simulated motion, one for each scene, for `plot_transitions`.

        Of their attractors a store keeps what they are and where, not the impacts.

        Raises
        ------
        InputError
            If the study does not keep attractors.
        """
        from .sweeps import sweeps_of

        return sweeps_of(self)

    def map(self, quantity: str, **options: Any) -> Map:
        """Return a quantity over two axes; see `contimpact.parameter_studies.maps.map_of`."""
        from .maps import map_of

        return map_of(self, quantity, **options)


@dataclass(frozen=True)
class Selection:
    """Rows of a table of a study, each with the values of its scene's axes; read when asked for.

    Iterate over it for rows as mappings, or take all of it by `arrays` or `to_dataframe`.
    """

    study: Study
    table: str
    where: Mapping[str, Any]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, the study's axes first."""
        return tuple(self.types())

    def types(self) -> dict[str, str]:
        """Return the columns and their types in the store: INTEGER, REAL or TEXT."""
        info = self.study.rows(f"PRAGMA table_info({self.table})")
        own = {row[1]: row[2] for row in info if row[1] not in ("study", WHOLE)}
        return {"scene": "INTEGER"} | dict.fromkeys(self.study.axes, "REAL") | own

    def _places(self) -> dict[str, str]:
        """The columns, each with what stands for it in a query."""
        axes = {name: f"x{k}.value" for k, name in enumerate(self.study.axes)}
        return {name: axes.get(name, f't."{name}"') for name in self.types()}

    def query(self, chosen: str | None = None) -> tuple[str, list[Any]]:
        """Return the SQL that selects the rows, and the values it takes."""
        places, values = self._places(), [self.study.number]
        joins, conditions = "", ["t.study = ?"]
        for k, name in enumerate(self.study.axes):
            joins += (
                f" LEFT JOIN coordinates x{k} ON x{k}.study = t.study AND x{k}.scene = t.scene"
                f" AND x{k}.name = {_quoted(name)}"
            )
        for name, wanted in self.where.items():
            several = list(wanted) if isinstance(wanted, list | tuple | set) else [wanted]
            marks = ", ".join("?" * len(several))
            conditions.append(f"{places[name]} IN ({marks})")
            values += several
        what = chosen or ", ".join(places.values())
        own = KEYS.get(self.table)
        order = f"t.scene, length(t.{own}), t.{own}" if own else "t.scene"
        tail = "" if chosen else f" ORDER BY {order}"
        query = f"SELECT {what} FROM {self.table} t{joins} WHERE {' AND '.join(conditions)}{tail}"
        return query, values

    def __len__(self) -> int:
        return int(next(self.study.rows(*self.query("count(*)")))[0])

    def __iter__(self) -> Iterator[dict[str, Any]]:
        columns = self.columns
        if not columns:
            return
        for row in self.study.rows(*self.query()):
            yield dict(zip(columns, row, strict=True))

    def arrays(self) -> dict[str, Array]:
        """Return the columns as arrays; numbers that are not there are NaN, texts None."""
        rows = list(self.study.rows(*self.query()))
        columns = zip(*rows, strict=True) if rows else ([] for _ in self.columns)
        pairs = zip(self.types().items(), columns, strict=True)
        return {name: _array(list(values), kind) for (name, kind), values in pairs}

    def to_dataframe(self) -> Any:
        """Return the rows as a pandas DataFrame; pandas must be installed."""
        return frame(self.arrays())


def studies(store: str | Path) -> list[str]:
    """Return the names of the studies in a store.

    Raises
    ------
    InputError
        If there is no such store.
    """
    with contextlib.closing(_opened(Path(store))) as connection:
        return [name for (name,) in connection.execute("SELECT name FROM studies ORDER BY study")]


def _opened(path: Path) -> sqlite3.Connection:
    """A connection for reading; a store of an older schema is brought up to date first."""
    try:
        connection = opened(path, readonly=True)
    except sqlite3.Error as error:
        raise refusal(path, error) from None
    if taken(connection) == len(STEPS):
        return connection
    connection.close()
    Store(path).connection.close()
    return opened(path, readonly=True)


def _quoted(name: str) -> str:
    """A name as a text of SQL."""
    return "'" + name.replace("'", "''") + "'"


def _array(values: list[Any], kind: str) -> Array:
    """A column of the store: whole numbers if none is missing, numbers, or texts."""
    if kind == "INTEGER" and None not in values:
        return np.array(values, dtype=np.int64)
    if kind in ("INTEGER", "REAL"):
        return np.array([np.nan if v is None else v for v in values], dtype=float)
    return np.array(values, dtype=object)
