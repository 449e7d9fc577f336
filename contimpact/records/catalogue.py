"""Writing a diagram to a folder and reading it back.

The files are contracts with a schema name and number in each: ``catalogue.json``, the same flat in
``events.csv``, ``branches/<id>-<word>.csv``, and ``manifest.json``. Floating-point numbers are
written so that they read back to the same bits. What is not a finite number is null in JSON files;
the first lines of tables write it as the text ``inf``, ``-inf`` or ``nan``, which is read back.
"""

from __future__ import annotations

import dataclasses
import functools
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..arrays import Array
from ..errors import InputError
from ..storage.files import Content, write_all
from ..storage.texts import Json, csv_text, fitted, json_line, json_text, made
from .branch import Branch
from .diagram import Diagram
from .diagram_reading import SURVEYS, read
from .entry import FLAT, Entry
from .limits import Limit
from .loading import BRANCH, CURVE, checking, entry_of, read_branch, read_curve
from .result_folder import (
    CATALOGUE,
    TABLES,
    WANTED,
    branch_file,
    curve_file,
    held,
    read_json,
    reading,
    renewed,
)

if TYPE_CHECKING:
    from .area import Area
    from .curve import Check, Coverage, Curve


# Folders and files.


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
    with held(folder, FILES, TABLES) as place, renewed(place, ["run"]):
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


def catalogue_text(diagram: Diagram) -> str:
    """Return ``catalogue.json``."""
    content: dict[str, Json] = {
        "schema": CATALOGUE,
        "scene": diagram.name,
        "branches": [_branch_record(branch) for branch in diagram.branches],
        "entries": [_entry_record(entry) for entry in diagram.entries],
        "reading": read(diagram).as_record(),
        "survey": diagram.survey,
    }
    if diagram.curves:
        from .competition import regions

        content["curves"] = [_curve_record(curve) for curve in diagram.curves]
        content["competition"] = [
            dataclasses.asdict(r) for r in regions(diagram.curves, checks=diagram.checks)
        ]
        content["checks"] = [dataclasses.asdict(check) for check in diagram.checks]
    if diagram.limits:
        content["limits"] = [dataclasses.asdict(limit) for limit in diagram.limits]
    if diagram.coverage:
        content["coverage"] = [dataclasses.asdict(c) for c in diagram.coverage]
    if diagram.areas:
        content["areas"] = [dataclasses.asdict(area) for area in diagram.areas]
    if diagram.codim2_curves:
        content["codimension2_curves"] = [_curve_record(c) for c in diagram.codim2_curves]
    return json_text(content)


def _entry_record(entry: Entry) -> dict[str, Json]:
    """An entry as plain data; certified radius, free period and sliding only where there are."""
    record = dataclasses.asdict(entry)
    for name in ("certified_radius", "orbit_period", "sliding"):
        if record[name] is None:
            del record[name]
    return record


def _branch_record(branch: Branch) -> dict[str, Json]:
    return {
        "id": branch.id,
        "word": branch.word,
        "period": branch.period,
        "notation": branch.notation,
        "parameter": branch.parameter,
        "from": branch.origin,
        "meetings": list(branch.meetings),
        "points": len(branch),
        "ends": [
            {"kind": end.kind.name.lower(), "parameter": end.value, "message": end.message}
            for end in branch.ends
        ],
        "missed": list(branch.missed),
        "notes": list(branch.notes),
    }


def _curve_record(curve: Curve) -> dict[str, Json]:
    return {
        "id": curve.id,
        "kind": curve.kind,
        "label": curve.label,
        "word": curve.word,
        "period": curve.period,
        "notation": curve.notation,
        "parameters": list(curve.parameters),
        "fixed": dict(curve.fixed),
        "from": curve.origin,
        "branch": curve.branch,
        "points": len(curve),
        "ends": [
            {
                "kind": end.kind.name.lower(),
                "parameter": end.value,
                **{name: float(curve[name][row]) for name in curve.parameters},
                "message": end.message,
            }
            for end, row in zip(curve.ends, (0, -1), strict=True)
        ],
        "missed": list(curve.missed),
        "codimension2": [dataclasses.asdict(point) for point in curve.points],
    }


def curve_text(curve: Curve) -> str:
    """Return a curve's CSV: a comment line with its record, then the table."""
    return _table_text({"schema": CURVE, **_curve_record(curve)}, curve.columns)


def events_text(diagram: Diagram) -> str:
    """Return ``events.csv``: a row per entry; impacts and multipliers are spread over columns."""
    rows = [entry.as_row() for entry in diagram.entries]
    columns = list(FLAT)
    for row in rows:
        columns += [name for name in row if name not in columns]
    return csv_text(columns, ([row.get(name) for name in columns] for row in rows))


# Branches.


def branch_text(branch: Branch) -> str:
    """Return a branch's CSV: a comment line with all that is not a column, then the table."""
    names = ("id", "word", "period", "notation", "system")
    head = {"schema": BRANCH, **{name: getattr(branch, name) for name in names}}
    head |= {"options": dict(branch.options), **_branch_record(branch)}
    head["events"] = [_entry_record(entry) for entry in branch.events]
    return _table_text(head, branch.columns)


def _table_text(head: Mapping[str, Any], columns: Mapping[str, Array]) -> str:
    """A table as CSV, its record in a comment line before it."""
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    return f"# {json_line(head)}\n" + csv_text(list(columns), rows, exact=True)


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
    path = Path(folder) / "catalogue.json"
    with reading(path.parent), checking(path, CATALOGUE):
        content = read_json(path, CATALOGUE, WANTED)
        return [entry_of(record) for record in content["entries"]]


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
    folder = Path(folder)
    path = folder / "catalogue.json"
    with reading(folder), checking(path, CATALOGUE):
        catalogue = read_json(path, CATALOGUE, WANTED)
        branches = [_branch_of(folder, record) for record in catalogue["branches"]]
        curves, points = (
            [
                read_curve(folder / curve_file(c["id"], c["kind"], c["word"]))
                for c in catalogue.get(key, [])
            ]
            or ()
            for key in ("curves", "codimension2_curves")
        )
        checks, coverage = _checks(catalogue)
        name = fitted(catalogue["scene"], str, "scene")
        return Diagram(
            name,
            branches,
            curves,
            checks,
            codim2_curves=points,
            coverage=coverage,
            areas=_areas(catalogue),
            survey=_survey(catalogue),
            limits=[made(Limit, record) for record in catalogue.get("limits", [])] or (),
        )


def _survey(catalogue: Mapping[str, Any]) -> str:
    """How far the diagram of a catalogue was surveyed; earlier versions do not say."""
    found = catalogue.get("survey")
    return found if isinstance(found, str) and found in SURVEYS else "unknown"


def _checks(catalogue: Mapping[str, Any]) -> tuple[Sequence[Check], Sequence[Coverage]]:
    """The one-parameter runs a catalogue records, and what they cover, if there are any."""
    checks, coverage = catalogue.get("checks", []), catalogue.get("coverage", [])
    if not (checks or coverage):
        return (), ()
    from .curve import Check, Coverage

    return [made(Check, r) for r in checks] or (), [made(Coverage, r) for r in coverage] or ()


def _areas(catalogue: Mapping[str, Any]) -> Sequence[Area]:
    """The areas that a catalogue records, if there are any."""
    if not (records := catalogue.get("areas")):
        return ()
    from .area import Area

    return [made(Area, record) for record in records]


def _branch_of(folder: Path, record: Mapping[str, Any]) -> Branch:
    """The branch of a record of the catalogue, if its table belongs to it."""
    path = folder / branch_file(record["id"], record["word"])
    branch = read_branch(path)
    if len(branch) != record["points"]:
        accepted = "give a folder whose files are of one run"
        raise InputError(str(path), f"damaged: {len(branch)} of {record['points']} rows", accepted)
    return branch
