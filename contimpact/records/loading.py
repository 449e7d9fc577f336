"""What a result folder holds, read back: entries, branches and curves.

Files may be damaged, or made by somebody else. Records have to fit what they become, tables have to
have the columns and the number of rows that their records name; anything else is refused.
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import io
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import Array
from ..continuation.ends import End, EndKind
from ..errors import InputError
from ..models.word import LONGEST_WORD
from ..storage.files import LARGEST_RECORD, bounded, open_plain, reason
from ..storage.texts import DAMAGE, fitted, made, original
from .branch import Branch
from .entry import Entry

if TYPE_CHECKING:
    from .curve import Curve

BRANCH = "contimpact.branch/1"
CURVE = "contimpact.curve/1"

NEEDED = ("id", "kind", "label", "branch", "word", "period", "parameter", "parameters", "impacts")
"""Keys that no entry goes without."""
TEXTS = ("reason", "event")
WHOLE = ("n_unstable", "physical", "iterations")
"""Columns of a table that hold no floating-point numbers."""
BLOCK = 1024
"""Rows of a table converted at a time."""


# Files.


@contextlib.contextmanager
def checking(path: Path, schema: str) -> Iterator[None]:
    """Turn what goes wrong with a file of a schema into `InputError`."""
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        raise InputError(
            str(path), f"cannot be read ({reason(error)})", f"give a file of {schema!r}"
        ) from None
    except (*DAMAGE, csv.Error) as error:
        raise InputError(
            str(path), f"damaged ({type(error).__name__}: {error})", f"give a file of {schema!r}"
        ) from None


# Entries.


def entry_of(record: Any) -> Entry:
    """Return an entry made of its record; keys of later versions are passed over.

    Raises
    ------
    ValueError
        If it lacks what no entry goes without, or a value is of another type.
    """
    entry = made(Entry, record, NEEDED)
    entry.value  # noqa: B018  the parameter is among the parameters
    for impact in entry.impacts:
        fitted(impact.get("wall"), str, "impacts.wall")
        fitted(impact.get("velocity"), float, "impacts.velocity")
    names = ("multipliers", "multipliers_before", "multipliers_after")
    lists: dict[str, Any] = {name: getattr(entry, name) or [] for name in names}
    opens, options = tuple(entry.opens or ()), entry.options or {}
    return dataclasses.replace(entry, opens=opens, options=options, **lists)


# Tables.


def read_branch(path: str | Path) -> Branch:
    """Read a branch's CSV back into the same `Branch`.

    Raises
    ------
    InputError
        If the file is missing, not of this schema, or damaged.
    """
    with checking(Path(path), BRANCH):
        head, columns = _table(Path(path), BRANCH)
        parameter = head["parameter"]
        _require(columns, head["word"], [parameter], TEXTS)
        earlier = {"system": head["system"], "options": head["options"]}
        record = {"meetings": [], **head, "columns": columns, "origin": head["from"]}
        record["ends"] = _ends(head["ends"], parameter)
        record["events"] = [entry_of(earlier | record) for record in head["events"]]
        return made(Branch, record)


def read_curve(path: str | Path) -> Curve:
    """Read a curve's CSV back into the same `Curve`.

    Raises
    ------
    InputError
        If the file is missing, not of this schema, or damaged.
    """
    from .curve import Codim2, Curve

    with checking(Path(path), CURVE):
        head, columns = _table(Path(path), CURVE)
        _require(columns, head["word"], head["parameters"], ())
        record = head | {"columns": columns, "origin": head["from"]}
        record["ends"] = _ends(head["ends"], head["parameters"][-1])
        record["points"] = [made(Codim2, record) for record in head["codimension2"]]
        return made(Curve, record)


def _table(path: Path, schema: str) -> tuple[dict[str, Any], dict[str, Array]]:
    """The record in a table's first line, and its columns; they must have its number of rows."""
    with open_plain(path) as file:
        first = bounded(file.readline(LARGEST_RECORD + 1), LARGEST_RECORD)
        head = json.loads(first.decode().removeprefix("# "))
        if head["schema"] != schema:
            raise InputError(str(path), f"its schema is {head['schema']!r}", f"give {schema!r}")
        with io.TextIOWrapper(file, "utf-8", newline="") as lines:
            columns = _columns(lines)
    rows = len(next(iter(columns.values())))
    if rows != head.get("points", rows):
        raise InputError(
            str(path), f"damaged: {rows} of {head['points']} rows", f"give a file of {schema!r}"
        )
    return head, columns


def _columns(lines: Iterator[str]) -> dict[str, Array]:
    """The columns of a table, read in one pass, a block of rows at a time."""
    reader = csv.reader(lines)
    names = [original(name) for name in next(reader, [])]
    blocks = []
    while rows := list(itertools.islice(reader, BLOCK)):
        cells = zip(*rows, strict=True)
        blocks.append([_column(n, c) for n, c in zip(names, cells, strict=True)])
    if not blocks:
        raise ValueError("no rows")
    return {
        name: np.concatenate(parts)
        for name, parts in zip(names, zip(*blocks, strict=True), strict=True)
    }


def _column(name: str, cells: Sequence[str]) -> Array:
    if name in TEXTS:
        return np.array([original(cell) for cell in cells], dtype=object)
    if name in WHOLE:
        return np.array(list(map(int, cells)), dtype=np.int64)
    return np.array(list(map(float, cells)))


def _require(
    columns: Mapping[str, Array], word: Any, parameters: Any, texts: Sequence[str]
) -> None:
    """Raise `ValueError` if a table lacks columns, or numbers, that its record speaks of."""
    impacts = range(1, min(len(fitted(word, str, "word")), LONGEST_WORD) + 1)
    finite = ["arclength", *parameters, *(f"{name}{k}" for k in impacts for name in "tv")]
    for name in [*finite, "n_unstable", "physical", *texts]:
        if name not in columns:
            raise ValueError(f"no column {name}")
    for name in finite:
        if not np.isfinite(columns[name]).all():
            raise ValueError(f"{name} is not finite everywhere")


def _ends(records: Any, parameter: str) -> tuple[End, End]:
    """Both ends; earlier versions write the value under the parameter's name."""
    first, last = (
        End(
            EndKind[e["kind"].upper()],
            fitted(e["parameter" if "parameter" in e else parameter], float, "parameter"),
            fitted(e["message"], str, "message"),
        )
        for e in records
    )
    return first, last
