"""Catalogues: written, and loaded with every mistake named.

The files are contracts with a schema name and number in each: ``catalogue.json``, the same flat in
``events.csv``, ``branches/<id>-<word>.csv``, and ``manifest.json``. Floating-point numbers are
written so that they read back to the same bits. What is not a finite number is null in JSON files;
the first lines of tables write it as the text ``inf``, ``-inf`` or ``nan``, which is read back.
"""

from __future__ import annotations

import csv
import dataclasses
import functools
import hashlib
import io
import itertools
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TypeVar

import numpy as np

from ..arrays import Array
from ..errors import InputError, explain_arguments
from ..models.guards import LONGEST_WORD
from ..schema import attribute, build_record, fit_value, record, table_columns
from ..storage import (
    LARGEST_RECORD,
    Content,
    Json,
    check_length,
    check_reading,
    csv_of_records,
    csv_text,
    is_there,
    json_line,
    json_text,
    open_plain,
    read_bounded,
    unescape_text,
    write_all,
)
from .branch import Branch, Entry, end_record
from .curve import Area, Check, Coverage, Curve, regions
from .diagram import Diagram, Limit
from .diagram_reading import SURVEYS, read
from .result_folder import (
    CATALOGUE,
    LONGEST,
    TABLES,
    branch_file,
    curve_file,
    hold_folder,
    reading_catalogue,
    renew_folder,
)

T = TypeVar("T")


# What a result folder holds, read back: entries, branches and curves.
#
# Files may be damaged, or made by somebody else. Records have to fit what they become, tables have
# to have the columns and the number of rows that their records name; anything else is refused.

BRANCH = "contimpact.branch/1"
CURVE = "contimpact.curve/1"

NEEDED = ("id", "kind", "label", "branch", "word", "period", "parameter", "parameters", "impacts")
"""Keys that no entry goes without."""
TEXTS = ("reason", "event")
MORE_TEXTS = (*TEXTS, "margin_event")
"""Columns that hold texts: those all branches have, and all there may be."""
WHOLE = ("n_unstable", "physical", "iterations")
"""Columns of a table that hold no floating-point numbers."""
BLOCK = 1024
"""Rows of a table converted at a time."""


SWEEP = "contimpact.sweep/1"


def sweep_cells(path: Path) -> tuple[str, list[dict[str, str]]]:
    """Return what ``sweep.csv`` holds: the swept parameter, and the cells of each row by column.

    Raises InputError if the file is not of this schema or damaged.
    """
    with check_reading(path, SWEEP):
        head, names, lines = _short_table(path, SWEEP)
        rows = [dict(zip(names, map(unescape_text, line), strict=True)) for line in lines]
        return str(head.get("parameter", "")), rows


def stopped_at(path: Path) -> str:
    """Return what a simulation was doing, by its ``sweep.csv``, when it ended early; nothing of one
    that did not.

    Raises InputError if the table is damaged.
    """
    with check_reading(path, SWEEP), open_plain(path) as file:
        head = json.loads(file.readline(LONGEST).decode().removeprefix("# "))
        return str(head.get("interrupted") or "")


def simulation_remarks(folder: Path) -> list[str]:
    """Return what is said of a simulation in a folder that ended early; nothing of one that did
    not.

    Raises InputError if its table is damaged.
    """
    path = folder / "sweep.csv"
    stopped = stopped_at(path) if is_there(path) else ""
    lost = f"the simulation ended early ({stopped}): attractors and what follows from them may be "
    return [f"{lost}missing; contimpact simulate --resume finds them"] if stopped else []


def _short_table(path: Path, schema: str) -> tuple[dict[str, Any], list[str], list[list[str]]]:
    """The record in a table's first line, its columns and rows; it must end with a whole row."""
    head, _, table = read_bounded(path).decode().partition("\n")
    found = json.loads(head.removeprefix("# "))
    if found.get("schema") != schema:
        raise InputError(str(path), f"its schema is {found.get('schema')!r}", f"give {schema!r}")
    if not table.endswith("\n"):
        raise ValueError("cut short")
    names, *lines = csv.reader(io.StringIO(table))
    return found, names, lines


# Entries.


def entry_of(record: Any) -> Entry:
    """Return an entry made of its record; keys of later versions are passed over.

    Raises ValueError if it lacks what no entry goes without, or a value is of another type.
    """
    entry = build_record(Entry, record, NEEDED)
    entry.value  # noqa: B018  the parameter is among the parameters
    for impact in entry.impacts:
        fit_value(impact.get("wall"), str, "impacts.wall")
        fit_value(impact.get("velocity"), float, "impacts.velocity")
    names = ("multipliers", "multipliers_before", "multipliers_after")
    lists: dict[str, Any] = {name: getattr(entry, name) or [] for name in names}
    opens, options = tuple(entry.opens or ()), entry.options or {}
    return dataclasses.replace(entry, opens=opens, options=options, **lists)


# Tables.


def read_branch(path: str | Path) -> Branch:
    """Read a branch's CSV back into the same `Branch`.

    Raises InputError if the file is missing, not of this schema, or damaged.
    """
    return _read_table(Branch, Path(path), BRANCH)


def branch_in(text: str, where: str) -> Branch:
    """Return the branch of a table that is no file: `where` is what errors name.

    Raises InputError if it is not of this schema, or damaged.
    """
    return _read_table(Branch, Path(where), BRANCH, io.BytesIO(text.encode()))


def read_curve(path: str | Path) -> Curve:
    """Read a curve's CSV back into the same `Curve`.

    Raises InputError if the file is missing, not of this schema, or damaged.
    """
    return _read_table(Curve, Path(path), CURVE)


def _read_table(kind: type[T], path: Path, schema: str, kept: BinaryIO | None = None) -> T:
    """The branch or the curve of a table: the record in its first line, and its columns, which must
    have its number of rows; earlier versions write the value at an end under the parameter's name,
    and have the system beside the events."""
    with check_reading(path, schema):
        with kept or open_plain(path) as file:
            first = check_length(file.readline(LARGEST_RECORD + 1), LARGEST_RECORD)
            head = json.loads(first.decode().removeprefix("# "))
            if head["schema"] != schema:
                found = f"its schema is {head['schema']!r}"
                raise InputError(str(path), found, f"give {schema!r}")
            with io.TextIOWrapper(file, "utf-8", newline="") as lines:
                columns = _columns(lines)
        rows = len(next(iter(columns.values())))
        if rows != head.get("points", rows):
            found = f"damaged: {rows} of {head['points']} rows"
            raise InputError(str(path), found, f"give a file of {schema!r}")
        parameters = head["parameters"] if schema == CURVE else [head["parameter"]]
        _require(columns, head["word"], parameters, () if schema == CURVE else TEXTS)
        record = {"meetings": [], **head, "columns": columns, "origin": head["from"]}
        record["ends"] = [
            {
                "kind": end["kind"].upper(),
                "value": end["parameter" if "parameter" in end else parameters[-1]],
                "message": end["message"],
            }
            for end in head["ends"]
        ]
        if schema == CURVE:
            record["points"] = head["codimension2"]
        else:
            earlier = {"system": head["system"], "options": head["options"]}
            record["events"] = [entry_of(earlier | event) for event in head["events"]]
        return build_record(kind, record)


def _columns(lines: Iterator[str]) -> dict[str, Array]:
    """The columns of a table, read in one pass, a block of rows at a time."""
    reader = csv.reader(lines)
    names = [unescape_text(name) for name in next(reader, [])]
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
    if name in MORE_TEXTS:
        return np.array([unescape_text(cell) for cell in cells], dtype=object)
    if name in WHOLE:
        return np.array(list(map(int, cells)), dtype=np.int64)
    return np.array(list(map(float, cells)))


def _require(
    columns: Mapping[str, Array], word: Any, parameters: Any, texts: Sequence[str]
) -> None:
    """Raise `ValueError` if a table lacks columns, or numbers, that its record speaks of."""
    impacts = range(1, min(len(fit_value(word, str, "word")), LONGEST_WORD) + 1)
    finite = ["arclength", *parameters, *(f"{name}{k}" for k in impacts for name in "tv")]
    for name in [*finite, "n_unstable", "physical", *texts]:
        if name not in columns:
            raise ValueError(f"no column {name}")
    for name in finite:
        if not np.isfinite(columns[name]).all():
            raise ValueError(f"{name} is not finite everywhere")


# Folders and files.


@explain_arguments
def write_diagram(diagram: Diagram, folder: str | Path) -> list[str]:
    """Write catalogue, events and branches of a diagram.

    Parameters
    ----------
    diagram : Diagram
    folder : str or Path
        Made if it is not there. Files of an earlier diagram are replaced.

    Returns
    -------
    list of str
        The files written, relative to the folder.

    Raises
    ------
    InputError
        If the folder cannot be written, or another process writes to it.
    NotWrittenError
        If some of the files could not be written; the others are there.
    """
    names = [branch.id for branch in diagram.branches]
    if odd := next((name for name in names if not re.fullmatch(r"[\w-]+", name)), None):
        accepted = "give names of letters, digits, - and _"
        raise InputError("branches", f"a branch is called {odd!r}", accepted)
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(
            "branches",
            f"two branches are called {twice!r}",
            "give each its own name when following",
        )
    with hold_folder(folder, FILES, TABLES) as place, renew_folder(place, ["run"]):
        return sorted(write_all(place, diagram_files(diagram)))


FILES = ("catalogue.json", "events.csv")


def diagram_files(diagram: Diagram) -> dict[str, Content]:
    """Return what makes the files of `write_diagram`, by name, the catalogue first."""
    contents: dict[str, Content] = {
        "catalogue.json": lambda: catalogue_text(diagram),
        "events.csv": lambda: events_text(diagram),
    }
    for branch in diagram.branches:
        contents[branch_file(branch.id, branch.word)] = functools.partial(branch_text, branch)
    for curve in (*diagram.curves, *diagram.codim2_curves):
        contents[curve_file(curve.id, curve.kind, curve.word)] = functools.partial(
            curve_text, curve
        )
    return contents


# The catalogue.


@dataclass(frozen=True)
class _Catalogue:
    """A catalogue as its file has it; what earlier versions do not have is optional."""

    schema: str
    scene: str
    branches: Sequence[Mapping[str, Any]]
    entries: Sequence[Any]
    reading: Any = None
    survey: Any = None
    curves: Sequence[Mapping[str, Any]] | None = attribute(default=None, silent=True)
    competition: Any = attribute(default=None, silent=True)
    checks: Sequence[Check] | None = attribute(default=None, silent=True)
    limits: Sequence[Limit] | None = attribute(default=None, silent=True)
    interrupted: str | None = attribute(default=None, silent=True)
    coverage: Sequence[Coverage] | None = attribute(default=None, silent=True)
    areas: Sequence[Area] | None = attribute(default=None, silent=True)
    codimension2_curves: Sequence[Mapping[str, Any]] | None = attribute(default=None, silent=True)


def catalogue_text(diagram: Diagram) -> str:
    """Return ``catalogue.json``."""
    curves = diagram.curves
    content = _Catalogue(
        *(CATALOGUE, diagram.name, [_branch_record(branch) for branch in diagram.branches]),
        *(diagram.entries, read(diagram).as_record(), diagram.survey),
        curves=[_curve_record(curve) for curve in curves] or None,
        competition=regions(curves, checks=diagram.checks) if curves else None,
        checks=diagram.checks if curves else None,
        limits=diagram.limits or None,
        interrupted=diagram.statistics.get("stopped") or None,
        coverage=diagram.coverage or None,
        areas=diagram.areas or None,
        codimension2_curves=[_curve_record(curve) for curve in diagram.codim2_curves] or None,
    )
    return json_text(record(content))


def _branch_record(branch: Branch) -> dict[str, Json]:
    head = record(branch, ("id", "word", "period", "notation", "parameter", "origin", "meetings"))
    return {**head, "points": len(branch), **record(branch, ("ends", "missed", "notes"))}


def _curve_record(curve: Curve) -> dict[str, Json]:
    names = ("id", "kind", "label", "word", "period", "notation", "parameters", "fixed", "origin")
    ends = [
        end_record(end, **{name: float(curve[name][row]) for name in curve.parameters})
        for end, row in zip(curve.ends, (0, -1), strict=True)
    ]
    counted = {"points": len(curve), "ends": ends}
    return {**record(curve, (*names, "branch")), **counted, **record(curve, ("missed", "points"))}


def curve_text(curve: Curve) -> str:
    """Return a curve's CSV: a comment line with its record, then the table."""
    return _table_text({"schema": CURVE, **_curve_record(curve)}, curve.columns)


def events_text(diagram: Diagram) -> str:
    """Return ``events.csv``: a row per entry; impacts and multipliers are spread over columns."""
    return csv_of_records([entry.as_row() for entry in diagram.entries], table_columns(Entry))


def table_remark(folder: Path, entries: Sequence[Entry]) -> str:
    """Return where ``events.csv`` says something else than the catalogue beside it; nothing if it
    does not, or is not there. Columns of other versions are left out."""
    path = folder / "events.csv"
    if not is_there(path):
        return ""
    with check_reading(path, "a table of events"):
        theirs = list(csv.DictReader(io.StringIO(read_bounded(path).decode(), newline="")))
    text = csv_of_records([entry.as_row() for entry in entries], table_columns(Entry))
    ours = list(csv.DictReader(io.StringIO(text, newline="")))
    if len(theirs) != len(ours):
        return f"events.csv has {len(theirs)} rows, the catalogue {len(ours)} entries"
    for row, own in zip(theirs, ours, strict=True):
        for name in (name for name in own if name in row):
            if row[name] != own[name]:
                said = f"{row[name]!r} in events.csv, {own[name]!r} in the catalogue"
                return f"{own['id']}: {name} is {said}"
    return ""


# Branches.


def branch_text(branch: Branch) -> str:
    """Return a branch's CSV: a comment line with all that is not a column, then the table."""
    names = ("id", "word", "period", "notation", "system", "options")
    head = {"schema": BRANCH, **record(branch, names), **_branch_record(branch)}
    head |= record(branch, ("events",))
    return _table_text(head, branch.columns)


def _table_text(head: Mapping[str, Any], columns: Mapping[str, Array]) -> str:
    """A table as CSV, its record in a comment line before it."""
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    return f"# {json_line(head)}\n" + csv_text(list(columns), rows, exact=True)


@explain_arguments
def load_entries(folder: str | Path) -> list[Entry]:
    """Read the entries of a saved catalogue, to start branches and curves from.

    Parameters
    ----------
    folder : str or Path

    Returns
    -------
    list of Entry

    Raises
    ------
    InputError
        If there is no catalogue of this schema, or its run was ended while it wrote the folder.
    """
    with reading_catalogue(Path(folder)) as (_, content):
        return [entry_of(record) for record in content["entries"]]


@explain_arguments
def load_diagram(folder: str | Path) -> Diagram:
    """Read a folder written by `write_diagram`.

    Parameters
    ----------
    folder : str or Path

    Returns
    -------
    Diagram

    Raises
    ------
    InputError
        If there is no catalogue, its schema is another one, a file is missing or damaged, or the
        folder's run was ended while it wrote the folder.
    """
    return open_results(Path(folder)).diagram


@dataclass(frozen=True)
class Results:
    """A folder of results, read once: what its catalogue says, entries and diagram."""

    folder: Path
    manifest: Mapping[str, Any] | None
    """None without one."""
    catalogue: Mapping[str, Any]
    entries: Sequence[Entry]
    """Those of the catalogue, with certified radii."""
    diagram: Diagram

    @property
    def digest(self) -> str:
        """Of what the catalogue says of branches and events, certified radii aside."""
        entries = [
            {k: v for k, v in entry.items() if k != "certified_radius"}
            for entry in self.catalogue["entries"]
        ]
        said = {"branches": self.catalogue["branches"], "entries": entries}
        return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()


def open_results(folder: Path) -> Results:
    """Return what a folder of results holds; raises InputError as `load_diagram` does."""
    with reading_catalogue(folder) as (manifest, content):
        found = build_record(_Catalogue, content)
        entries = [entry_of(record) for record in found.entries]
        branches = [_branch_of(folder, record) for record in found.branches]
        curves, points = (
            [read_curve(folder / curve_file(c["id"], c["kind"], c["word"])) for c in records or ()]
            for records in (found.curves, found.codimension2_curves)
        )
    # earlier versions do not say how far a diagram was surveyed
    survey = found.survey
    diagram = Diagram(
        found.scene,
        branches,
        curves or (),
        found.checks or (),
        {"stopped": found.interrupted} if found.interrupted else {},
        codim2_curves=points or (),
        coverage=found.coverage or (),
        areas=found.areas or (),
        survey=survey if isinstance(survey, str) and survey in SURVEYS else "unknown",
        limits=found.limits or (),
    )
    return Results(folder, manifest, content, entries, diagram)


def _branch_of(folder: Path, record: Mapping[str, Any]) -> Branch:
    """The branch of a record of the catalogue, if its table belongs to it."""
    path = folder / branch_file(record["id"], record["word"])
    branch = read_branch(path)
    if len(branch) != record["points"]:
        accepted = "give a folder whose files are of one run"
        raise InputError(str(path), f"damaged: {len(branch)} of {record['points']} rows", accepted)
    return branch


# The table of basin fractions: what part of random starts leads to each motion at each value.

FRACTIONS = "contimpact.fractions/1"
"""Schema of ``fractions.csv``."""


class Share(NamedTuple):
    """The part of random starts that leads to a motion at a value."""

    value: float
    notation: str
    fraction: float
    motion: int = 0
    """Number of the motion along the parameter, from 1 on; 0 if it is not known."""
    low: float = 0.0
    high: float = 1.0
    """`low`, `high`: the interval of the fraction."""
    word: str = ""
    period: int = 0
    time: float = math.nan
    velocity: float = math.nan
    """`word`, `period`, `time`, `velocity`: of a periodic motion, with those of its first impact;
    the word is empty otherwise."""
    branch: str | None = None
    """The branch on which this orbit was found to lie."""

    @classmethod
    def of(cls, row: Sequence[Any]) -> Share:
        """Return the share of a row of the table; rows of version 0.2 have no orbits."""
        value, motion, notation, _, part, low, high, *orbit = row
        found = cls(float(value), notation, float(part), int(motion), float(low), float(high))
        if not orbit or not orbit[0]:
            return found
        word, period, time, velocity = orbit
        return found._replace(
            word=word, period=int(period), time=float(time), velocity=float(velocity)
        )


def shorten_names(names: Sequence[str]) -> str:
    """Return the different ones of several notations in order, of many the first and the last."""
    short = list(dict.fromkeys(names))
    return ", ".join(short if len(short) < 5 else [*short[:2], "...", short[-1]])


def read_fractions(path: Path) -> tuple[str, list[Share]]:
    """Return the parameter and the shares of a ``fractions.csv``.

    Raises InputError if it is not of this schema, or damaged.
    """
    with check_reading(path, FRACTIONS):
        _, (parameter, *_), rows = _short_table(path, FRACTIONS)
        return parameter, [Share.of(row) for row in rows]


# Attractors along a parameter, over all values at which they are known.


@dataclass(frozen=True)
class Bound:
    """Where an attractor begins or ends along the parameter."""

    value: float
    error: float
    """Bound of the value's error; half the bracket's width where only simulation shows it."""
    entry: str | None
    """The event, by its name in the catalogue."""
    text: str
    """What happens there."""

    def __str__(self) -> str:
        return f"{self.value:.9g}: {self.text}"


@dataclass(frozen=True)
class Motion:
    """An attractor over all values at which it is known."""

    notation: str
    branch: str | None
    """Of its orbits; None for motion that simulation alone shows."""
    low: Bound
    high: Bound
    simulated: int
    """How many simulated attractors it is."""
    values: Sequence[float] = field(repr=False)
    speeds: Sequence[float] = field(repr=False)
    """`values`, `speeds`: the largest speed before an impact at rising values."""
    met: Sequence[str] = field(default=(), repr=False)
    """Notations of the attractors simulated."""

    def speed(self, low: float, high: float) -> float:
        """Return the largest impact speed between two values.

        Of orbits it is interpolated between the points of the branch; of simulated motion it is
        that of the values simulated there, or of both neighbours if there are none. Not a number
        without impacts.
        """
        values, speeds = np.array(self.values), np.array(self.speeds)
        if not len(values):
            return math.nan
        if self.branch:
            ends = np.interp([low, high], values, speeds)
        else:
            first, beyond = np.searchsorted(values, (low, high)).tolist()
            ends = speeds[max(first - 1, 0) : first + 1] if first == beyond else []
        inside = speeds[(values >= low) & (values <= high)]
        return float(max([*inside, *ends], default=math.nan))

    def nearest(self, value: float) -> tuple[float, Bound]:
        """Return the distance from a value to the nearer end, and that end."""
        return min(
            ((abs(end.value - value), end) for end in (self.low, self.high)), key=lambda e: e[0]
        )
