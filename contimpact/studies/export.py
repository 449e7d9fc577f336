"""A store written as files: each table as CSV, JSON or Parquet, row by row.

Rows of scenes have the name of their study and the values of its axes before their own columns.
"""

from __future__ import annotations

import contextlib
import gzip
import importlib
import io
import itertools
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import InputError, NotWrittenError, require_known, require_whole
from ..storage import csv_text, json_line, reason, temporary_beside
from .study import ROWS, Selection, Study, file_stem, studies

FORMATS = ("csv", "csv.gz", "json", "parquet")
BLOCK = 10_000
"""Rows that are in memory at once."""
ALL = 17
"""Significant digits from which on a float reads back to the bit."""

Row = Mapping[str, Any]


def export(
    store: str | Path,
    folder: str | Path,
    kind: str = "csv",
    *,
    names: Sequence[str] | None = None,
    tables: Sequence[str] | None = None,
    columns: Sequence[str] | None = None,
    digits: int | None = None,
) -> dict[str, int]:
    """Write the tables of a store as files ``<study>-<table>.<kind>``, and return these and how
    many rows each has.

    The kind is ``csv``, ``csv.gz``, ``json`` (an array of objects) or ``parquet`` (which needs
    pyarrow). All studies by default, of them the tables that have rows, and all columns; numbers
    with all their digits, so that they read back to the bit, or with so many significant ones.

    Raises InputError if something that is asked for is not there, or a file cannot be written.
    """
    write = _writer(kind)
    written: dict[str, int] = {}
    names = names or studies(store)
    if digits is not None:
        require_whole(digits, "digits")
    if columns is not None:
        known = _columns(store, names, tables or ROWS)
        for column in columns:
            require_known(column, known, "columns")
    for name in names:
        with Study(store, name) as study:
            for table in tables or ROWS:
                chosen = study.select(table)
                types = chosen.types()
                shown = {c: t for c, t in types.items() if columns is None or c in columns}
                if not tables and not (shown and len(chosen)):
                    continue
                target = Path(folder) / f"{file_stem(name)}-{table}.{kind}"
                with _replacing(target, list(written)) as temporary:
                    written[target.name] = write(
                        temporary, shown, _rows(chosen, list(shown), digits)
                    )
    return written


def _columns(store: str | Path, names: Iterable[str], tables: Iterable[str]) -> dict[str, str]:
    """The columns that any of the tables has."""
    found: dict[str, str] = {}
    for name in names:
        with Study(store, name) as study:
            for table in tables:
                found |= study.select(table).types()
    return found


def _rows(chosen: Selection, columns: Sequence[str], digits: int | None) -> Iterator[list[Any]]:
    for row in chosen:
        yield [_round_value(row[name], digits) for name in columns]


def _round_value(value: Any, digits: int | None) -> Any:
    if digits is None or digits >= ALL or not isinstance(value, float):
        return value
    return float(f"{value:.{digits}g}")


@contextlib.contextmanager
def _replacing(target: Path, written: Sequence[str]) -> Iterator[Path]:
    """A temporary file that takes the target's place once it is whole."""
    temporary = temporary_beside(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, target)
    except OSError as error:
        raise NotWrittenError(str(target.parent), written, {target.name: reason(error)}) from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)


Writer = Callable[[Path, Mapping[str, str], Iterable[list[Any]]], int]
"""Writes rows to a file; the columns come with their types in the store."""


def _writer(kind: str) -> Writer:
    require_known(kind, FORMATS, "format")
    if kind == "parquet":
        return _write_parquet
    return {"csv": _write_csv, "csv.gz": _write_gz, "json": _write_json}[kind]


def _blocks(rows: Iterable[list[Any]]) -> Iterator[list[list[Any]]]:
    iterator = iter(rows)
    while block := list(itertools.islice(iterator, BLOCK)):
        yield block


def _put_csv(stream: Any, columns: Mapping[str, str], rows: Iterable[list[Any]]) -> int:
    names = list(columns)
    head = csv_text(names, [])
    stream.write(head)
    count = 0
    for block in _blocks(rows):
        stream.write(csv_text(names, block).removeprefix(head))
        count += len(block)
    return count


def _write_csv(path: Path, columns: Mapping[str, str], rows: Iterable[list[Any]]) -> int:
    with open(path, "x", encoding="utf-8", newline="") as stream:
        return _put_csv(stream, columns, rows)


def _write_gz(path: Path, columns: Mapping[str, str], rows: Iterable[list[Any]]) -> int:
    """Compressed, the same bytes every time."""
    with (
        open(path, "xb") as file,
        gzip.GzipFile("", "wb", 9, file, mtime=0) as packed,
        io.TextIOWrapper(packed, "utf-8", newline="") as stream,
    ):
        return _put_csv(stream, columns, rows)


def _write_json(path: Path, columns: Mapping[str, str], rows: Iterable[list[Any]]) -> int:
    count = 0
    with open(path, "x", encoding="utf-8") as stream:
        stream.write("[")
        for count, row in enumerate(rows, start=1):
            stream.write(",\n" if count > 1 else "\n")
            stream.write(json_line(dict(zip(columns, row, strict=True))))
        stream.write("\n]\n")
    return count


def _write_parquet(path: Path, columns: Mapping[str, str], rows: Iterable[list[Any]]) -> int:
    try:
        arrow = importlib.import_module("pyarrow")
        parquet = importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        found = f"pyarrow cannot be imported ({error})"
        raise InputError("format", found, "pip install pyarrow, or take csv or json") from None
    kinds = {"INTEGER": arrow.int64(), "REAL": arrow.float64()}
    schema = arrow.schema([(name, kinds.get(t, arrow.string())) for name, t in columns.items()])
    count = 0
    with parquet.ParquetWriter(path, schema) as writer:
        for block in _blocks(rows):
            values = zip(*block, strict=True)
            held = dict(zip(columns, map(list, values), strict=True))
            writer.write_table(arrow.table(held, schema))
            count += len(block)
    return count
