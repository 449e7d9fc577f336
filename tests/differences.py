"""Folders of results compared cell by cell: tables, records, and what differs between two of them.

A file becomes a dictionary from places to values. A place names the way to a cell, such as
``entries/e3/parameters/s`` in a catalogue or ``e3/velocity1`` in ``events.csv``; what has an id is
found by it, so that one event more or less does not shift the others. Two cells are the same if
their types and all their bits are.
"""

from __future__ import annotations

import csv
import dataclasses
import itertools
import json
import lzma
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path

Value = str | int | float | bool | None
Table = dict[str, Value]

VOLATILE_FILES = {"scene.toml", "recording.json", "rows.jsonl", "report.md"}
VOLATILE = {"seconds", "long_words", "machine", "versions", "modules", "kernels", "compiled"}
VOLATILE |= {"sha256"}
"""Keys that depend on the machine, the hour, the cache or how the package is cut into modules."""

PICTURES = {".png", ".svg", ".pdf"}


# Files as tables.


def results(folder: Path) -> dict[str, Path]:
    """Return the files of results in a folder by their names, as which compressed ones are also
    found; pictures are left out."""
    return {
        str(path.relative_to(folder)).removesuffix(".xz"): path
        for pattern in ("*", "branches/*", "curves/*")
        for path in sorted(folder.glob(pattern))
        if path.is_file() and path.suffix not in PICTURES and path.name not in VOLATILE_FILES
    }


def table(path: Path) -> Table:
    """Read a JSON file, or a CSV file with or without a first line of JSON."""
    text = text_of(path)
    if ".json" in path.suffixes:
        return dict(flat(json.loads(text), ""))
    lines = text.split("\n")
    head = json.loads(lines.pop(0)[2:]) if text.startswith("# ") else {}
    return dict(itertools.chain(flat(head, "head"), _rows(csv.DictReader(lines, restval=""))))


def text_of(path: Path) -> str:
    """The text of a file, or of its compressed form."""
    packed = path if path.suffix == ".xz" else path.with_name(f"{path.name}.xz")
    content = lzma.decompress(packed.read_bytes()) if packed.exists() else path.read_bytes()
    return content.decode()


def flat(data: object, place: str) -> Iterator[tuple[str, Value]]:
    """The leaves of nested data with their places; an empty list or object is a leaf."""
    if isinstance(data, Mapping) and data:
        for key, item in data.items():
            if key not in VOLATILE:
                yield from flat(item, f"{place}/{key}" if place else key)
    elif isinstance(data, list) and data:
        keys = _ids(data)
        if keys:
            yield f"{place}/order", " ".join(keys)
        for key, item in zip(keys or range(1, len(data) + 1), data, strict=True):
            yield from flat(item, f"{place}/{key}")
    else:
        yield place, str(data) if isinstance(data, Mapping | list) else data


def _ids(items: list) -> list[str]:
    """The ids of a list's items; none if not all have one of their own."""
    ids = [item["id"] for item in items if isinstance(item, Mapping) and "id" in item]
    return ids if len(set(ids)) == len(items) else []


def _rows(rows: csv.DictReader) -> Iterator[tuple[str, Value]]:
    """The cells of a table, by the rows' ids or else by their numbers."""
    yield "columns", " ".join(rows.fieldnames or ())
    order = []
    for number, row in enumerate(rows, start=1):
        order.append(row.get("id") or f"row {number}")
        for column, cell in row.items():
            yield f"{order[-1]}/{column}", _value(cell)
    yield "order", " ".join(order) if rows.fieldnames and "id" in rows.fieldnames else len(order)


def _value(cell: str) -> Value:
    """A cell as the number that is written so, or as its text."""
    for kind in (int, float):
        try:
            if repr(kind(cell)) == cell:
                return kind(cell)
        except ValueError:
            pass
    return cell


# What differs.


@dataclasses.dataclass(frozen=True)
class Difference:
    """A cell that is not the same; `old` or `new` is ``...`` where there is none."""

    file: str
    place: str
    old: object
    new: object
    stated: float | None = None
    """The stated error of the event, if the cell is its value of the followed parameter."""

    @property
    def name(self) -> str:
        """The column or key."""
        return self.place.rpartition("/")[2]

    @property
    def ulps(self) -> int | None:
        """The distance of two floats in units of the last place: how many doubles further."""
        if isinstance(self.old, float) and isinstance(self.new, float):
            return abs(_rank(self.old) - _rank(self.new))
        return None

    @property
    def share(self) -> float | None:
        """The difference as a multiple of the stated error."""
        if not self.stated or self.ulps is None:
            return None
        return float(abs(self.new - self.old) / self.stated)

    def __str__(self) -> str:
        if self.new is ...:
            return f"{self.file}: {self.place}: missing"
        if self.old is ...:
            return f"{self.file}: {self.place}: new"
        text = f"{self.file}: {self.place}: {self.old!r} before, {self.new!r} now"
        if self.ulps is not None:
            text += f", {self.ulps:,} ulp"
        if self.share is not None:
            text += f", {self.share:.2g} of the stated error"
        return text


def is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _rank(number: float) -> int:
    """The place of a double in the order of all doubles."""
    bits = struct.unpack("<q", struct.pack("<d", number))[0]
    return bits if bits >= 0 else -(2**63) - bits


def differences(file: str, old: Table, new: Table) -> list[Difference]:
    """Return what differs between two tables; what is absent as a whole is named once."""
    absent = [*_absent(file, old, new), *_added(file, old, new)]
    changed = [
        Difference(file, place, value, new[place], _stated_error(place, new))
        for place, value in old.items()
        if place in new and _differ(value, new[place])
    ]
    return absent + changed


def _differ(old: Value, new: Value) -> bool:
    return type(old) is not type(new) or repr(old) != repr(new)


def _absent(file: str, old: Table, new: Table) -> Iterator[Difference]:
    for place in _lacking(old, new):
        yield Difference(file, place, old.get(place), ...)


def _added(file: str, old: Table, new: Table) -> Iterator[Difference]:
    for place in _lacking(new, old):
        yield Difference(file, place, ..., new.get(place))


def _lacking(one: Table, other: Table) -> list[str]:
    """The shortest places of one table under which the other has nothing."""
    known = {start for place in other for start in _starts(place)}
    lost = (
        next(s for s in _starts(place) if s not in known) for place in one if place not in known
    )
    return list(dict.fromkeys(lost))


def _starts(place: str) -> Iterator[str]:
    """``a``, ``a/b`` and ``a/b/c`` of ``a/b/c``."""
    return itertools.accumulate(place.split("/"), "{}/{}".format)


def _stated_error(place: str, cells: Table) -> float | None:
    """The error that an event states for its value of the followed parameter, at its place."""
    owner, _, name = place.rpartition("/")
    owner = owner.removesuffix("/parameters")
    error = cells.get(f"{owner}/error")
    return float(error) if is_number(error) and cells.get(f"{owner}/parameter") == name else None
