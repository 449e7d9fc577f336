"""Writing a diagram to a folder and reading it back.

The files are contracts with a schema name and number in each: ``catalogue.json``, the same flat in
``events.csv``, ``branches/<id>-<word>.csv``, and ``manifest.json``. Floating-point numbers are
written so that they read back to the same bits. What is not a finite number is null in JSON files;
the first lines of tables write it as the text ``inf``, ``-inf`` or ``nan``, which is read back.
"""

from __future__ import annotations

import contextlib
import csv
import dataclasses
import functools
import io
import json
import math
import platform
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import __version__
from .compiled import mode, used
from .continuation.branch import End, EndKind
from .diagram import Branch, Diagram, Entry
from .errors import InputError
from .files import Content, reason, write_all
from .reading import read
from .result_folder import (
    CATALOGUE,
    MANIFEST,
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
    from .two_parameters.competition import Region
    from .two_parameters.curves import Curve

BRANCH = "contimpact.branch/1"
CURVE = "contimpact.curve/1"

EVENT_COLUMNS = (
    "id", "kind", "ghost", "label", "why", "branch", "word", "period", "notation", "becomes",
    "order", "criticality", "slope", "wall", "flight", "impact", "touch_time", "requested",
    "parameter", "n_unstable", "stable", "physical", "reason", "residual", "error", "method",
    "arclength", "opens",
)  # fmt: skip

NUMBERS = ("slope", "touch_time", "residual", "error", "arclength", "nu", "nu_error")
"""Keys of an entry whose numbers may be not finite."""
NEEDED = ("id", "kind", "label", "branch", "word", "period", "parameter", "parameters", "impacts")
"""Keys that no entry goes without."""


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
    for curve in diagram.curves:
        contents[curve_file(curve.id, curve.kind, curve.word)] = functools.partial(
            curve_text, curve
        )
    return contents


# The catalogue.


def catalogue_text(diagram: Diagram) -> str:
    """Return ``catalogue.json``."""
    content = {
        "schema": CATALOGUE,
        "scene": diagram.name,
        "branches": [_branch_record(branch) for branch in diagram.branches],
        "entries": [dataclasses.asdict(entry) for entry in diagram.entries],
        "reading": read(diagram).as_record(),
    }
    if diagram.curves:
        content["curves"] = [_curve_record(curve) for curve in diagram.curves]
        content["competition"] = [dataclasses.asdict(region) for region in _competition(diagram)]
    return json_text(content)


def _branch_record(branch: Branch) -> dict[str, Any]:
    return {
        "id": branch.id,
        "word": branch.word,
        "period": branch.period,
        "notation": branch.notation,
        "parameter": branch.parameter,
        "from": branch.origin,
        "meetings": list(branch.meetings),
        "points": len(branch),
        "ends": [_end_record(branch, end) for end in branch.ends],
        "missed": list(branch.missed),
        "notes": list(branch.notes),
    }


def _curve_record(curve: Curve) -> dict[str, Any]:
    first, second = curve.parameters
    return {
        "id": curve.id,
        "kind": curve.kind,
        "label": curve.label,
        "word": curve.word,
        "period": curve.period,
        "notation": curve.notation,
        "parameters": [first, second],
        "fixed": dict(curve.fixed),
        "from": curve.origin,
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


def _competition(diagram: Diagram) -> list[Region]:
    from .two_parameters.competition import regions

    first = diagram.curves[0].parameters[0]
    along = "d" if "d" in diagram.curves[0].columns else first
    return regions(diagram.curves, along)


def curve_text(curve: Curve) -> str:
    """Return a curve's CSV: a comment line with its record, then the table."""
    head = {"schema": CURVE, **_curve_record(curve)}
    rows = zip(*(values.tolist() for values in curve.columns.values()), strict=True)
    return f"# {_plain_json(head)}\n" + csv_text(list(curve.columns), rows)


def _end_record(branch: Branch, end: End) -> dict[str, Any]:
    return {"kind": end.kind.name.lower(), "parameter": end.value, "message": end.message}


def events_text(diagram: Diagram) -> str:
    """Return ``events.csv``: a row per entry; impacts and multipliers are spread over columns."""
    rows = [_flat(entry) for entry in diagram.entries]
    columns = list(EVENT_COLUMNS)
    for row in rows:
        columns += [name for name in row if name not in columns]
    return csv_text(columns, ([row.get(name) for name in columns] for row in rows))


def _flat(entry: Entry) -> dict[str, Any]:
    row: dict[str, Any] = {name: getattr(entry, name) for name in EVENT_COLUMNS}
    row["opens"] = " ".join(entry.opens)
    if entry.requested is not None:
        row["requested"] = " ".join(f"{n}={v!r}" for n, v in entry.requested.items())
    row |= entry.parameters
    for k, impact in enumerate(entry.impacts, start=1):
        row |= {f"{name}{k}": value for name, value in impact.items()}
    for k, mu in enumerate(entry.multipliers, start=1):
        real, imaginary = mu or (None, None)
        row |= {f"multiplier{k}_re": real, f"multiplier{k}_im": imaginary}
    return row


# Branches.


def branch_text(branch: Branch) -> str:
    """Return a branch's CSV: a comment line with all that is not a column, then the table."""
    head = {
        "schema": BRANCH,
        "id": branch.id,
        "word": branch.word,
        "period": branch.period,
        "notation": branch.notation,
        "system": branch.system,
        "options": dict(branch.options),
        "parameter": branch.parameter,
        "from": branch.origin,
        "meetings": list(branch.meetings),
        "points": len(branch),
        "ends": [_end_record(branch, end) for end in branch.ends],
        "missed": list(branch.missed),
        "notes": list(branch.notes),
        "events": [dataclasses.asdict(entry) for entry in branch.events],
    }
    rows = zip(*(values.tolist() for values in branch.columns.values()), strict=True)
    return f"# {_plain_json(head)}\n" + csv_text(list(branch.columns), rows)


def read_branch(path: str | Path) -> Branch:
    """Read a branch's CSV back into the same `Branch`.

    Raises
    ------
    InputError
        If the file is missing, not of this schema, or damaged.
    """
    with _reading(Path(path), BRANCH):
        head, columns = _table(Path(path), BRANCH)
        parameter = head["parameter"]
        return Branch(
            head["id"], head["word"], head["period"], head["notation"], head["system"],
            head["options"], parameter, columns, _ends(head["ends"], parameter),
            [_entry(_system(head) | record) for record in head["events"]], head["missed"],
            head["from"], head.get("meetings", []), head.get("notes", []),
        )  # fmt: skip


def read_curve(path: str | Path) -> Curve:
    """Read a curve's CSV back into the same `Curve`.

    Raises
    ------
    InputError
        If the file is missing, not of this schema, or damaged.
    """
    from .two_parameters.curves import Codim2, Curve

    with _reading(Path(path), CURVE):
        head, columns = _table(Path(path), CURVE)
        first, second = head["parameters"]
        points = [_fields(Codim2, record) for record in head["codimension2"]]
        return Curve(
            head["id"], head["kind"], head["label"], head["word"], head["period"],
            head["notation"], (first, second), columns, _ends(head["ends"], second), points,
            head["from"], head["missed"], head["fixed"],
        )  # fmt: skip


@contextlib.contextmanager
def _reading(path: Path, schema: str) -> Iterator[None]:
    """Turn what goes wrong with a file of a schema into `InputError`."""
    try:
        yield
    except InputError:
        raise
    except OSError as error:
        raise InputError(
            str(path), f"cannot be read ({reason(error)})", f"give a file of {schema!r}"
        ) from None
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise InputError(
            str(path), f"damaged ({type(error).__name__}: {error})", f"give a file of {schema!r}"
        ) from None


def _table(path: Path, schema: str) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
    """The record in a table's first line, and its columns; they must have its number of rows."""
    first, rest = path.read_text(encoding="utf-8").split("\n", 1)
    head = json.loads(first.removeprefix("# "))
    if head["schema"] != schema:
        raise InputError(str(path), f"its schema is {head['schema']!r}", f"give {schema!r}")
    names, *rows = csv.reader(io.StringIO(rest))
    points = head.get("points", len(rows))
    if len(rows) != points:
        raise InputError(
            str(path), f"damaged: {len(rows)} of {points} rows", f"give a file of {schema!r}"
        )
    return head, {name: _column(name, [row[i] for row in rows]) for i, name in enumerate(names)}


def _ends(records: Sequence[Mapping[str, Any]], parameter: str) -> tuple[End, End]:
    """Both ends; earlier versions write the value under the parameter's name."""
    first, last = (
        End(
            EndKind[e["kind"].upper()], float(e["parameter" if "parameter" in e else parameter]),
            e["message"],
        )
        for e in records
    )  # fmt: skip
    return first, last


def _column(name: str, texts: Sequence[str]) -> np.ndarray[Any, Any]:
    if name in ("reason", "event"):
        return np.array(texts, dtype=object)
    if name in ("n_unstable", "physical", "iterations"):
        return np.array([int(text) for text in texts], dtype=np.int64)
    return np.array([float(text) for text in texts])


def _system(head: Mapping[str, Any]) -> dict[str, Any]:
    """What entries of earlier versions leave to their branch."""
    return {"system": head["system"], "options": head["options"]}


def _entry(record: Mapping[str, Any]) -> Entry:
    """An entry from its record; keys of later versions are passed over, missing ones empty."""
    known: dict[str, Any] = {f.name: record.get(f.name) for f in dataclasses.fields(Entry)}
    known |= {name: _number(known[name]) for name in NUMBERS}
    for name in ("multipliers", "multipliers_before", "multipliers_after"):
        known[name] = [None if mu is None else (mu[0], mu[1]) for mu in known[name] or ()]
    known["opens"] = tuple(known["opens"] or ())
    known["options"] = known["options"] or {}
    if lacking := [name for name in NEEDED if known[name] is None]:
        raise ValueError(f"an entry without {', '.join(lacking)}")
    return Entry(**known)


def _number(value: Any) -> Any:
    return float(value) if isinstance(value, str) else value


def _fields(kind: type[Any], record: Mapping[str, Any]) -> Any:
    return kind(**{f.name: record[f.name] for f in dataclasses.fields(kind)})


def load_entries(folder: str | Path) -> list[Entry]:
    """Read the entries of a saved catalogue, to start branches and curves from.

    Raises
    ------
    InputError
        If there is no catalogue of this schema, or its run was ended while it wrote the folder.
    """
    path = Path(folder) / "catalogue.json"
    with reading(path.parent), _reading(path, CATALOGUE):
        content = read_json(path, CATALOGUE, WANTED)
        return [_entry(record) for record in content["entries"]]


def load_diagram(folder: str | Path) -> Diagram:
    """Read a folder written by `write_diagram`.

    Raises
    ------
    InputError
        If there is no catalogue, its schema is another one, a file is missing or damaged, or the
        folder's run was ended while it wrote the folder.
    """
    folder = Path(folder)
    path = folder / "catalogue.json"
    with reading(folder), _reading(path, CATALOGUE):
        catalogue = read_json(path, CATALOGUE, WANTED)
        branches = [_branch_of(folder, record) for record in catalogue["branches"]]
        names = [curve_file(c["id"], c["kind"], c["word"]) for c in catalogue.get("curves", [])]
        curves = [read_curve(folder / name) for name in names]
        return Diagram(catalogue["scene"], branches, curves or ())


def _branch_of(folder: Path, record: Mapping[str, Any]) -> Branch:
    """The branch of a record of the catalogue, if its table belongs to it."""
    path = folder / branch_file(record["id"], record["word"])
    branch = read_branch(path)
    if len(branch) != record["points"]:
        raise InputError(
            str(path), f"damaged: {len(branch)} of {record['points']} rows",
            "give a folder whose files are of one run",
        )  # fmt: skip
    return branch


# The manifest.


def manifest_text(
    scene: Mapping[str, Any], given: Mapping[str, Any], left_out: Sequence[str],
    statistics: Mapping[str, Any], files: Sequence[str], catalogue: str | None = None,
) -> str:  # fmt: skip
    """Return ``manifest.json``: what was asked, what ran, what it cost, what was left out.

    `catalogue` is the digest of the catalogue beside it.
    """
    versions = {"contimpact": __version__, "python": platform.python_version()}
    for name in ("numpy", "scipy", "sympy", "matplotlib"):
        if name in sys.modules:
            versions[name] = sys.modules[name].__version__
    return json_text(
        {
            "schema": MANIFEST,
            "versions": versions,
            "scene": {"given": given, "resolved": scene},
            **statistics,
            "compiled": {"mode": mode(), "programs": used()},
            "modules": _modules(),
            "left_out": list(left_out),
            "files": sorted(files),
            "sha256": {"catalogue.json": catalogue} if catalogue else {},
        }
    )


def _modules() -> list[str]:
    """The package's modules that were imported, and the libraries among its dependencies."""
    own = [name for name in sys.modules if name.split(".")[0] == "contimpact"]
    libraries = ("numpy", "scipy", "sympy", "mpmath", "matplotlib", "numba")
    return sorted(own) + [name for name in libraries if name in sys.modules]


# Text.


def json_text(content: Any) -> str:
    """Return readable JSON with no number that is not finite."""
    return json.dumps(_finite(content), indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _plain_json(content: Any) -> str:
    return json.dumps(_finite(content, repr), allow_nan=False, ensure_ascii=False)


def _finite(value: Any, instead: Callable[[float], Any] = lambda value: None) -> Any:
    """Plain data with every number that is not finite replaced."""
    if isinstance(value, float):
        return value if math.isfinite(value) else instead(value)
    if isinstance(value, Mapping):
        return {name: _finite(v, instead) for name, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v, instead) for v in value]
    return value


def csv_text(columns: Sequence[str], rows: Any) -> str:
    """Return a table as CSV; numbers read back to the same bits, None is an empty cell."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([_cell(value) for value in row] for row in rows)
    return buffer.getvalue()


def _cell(value: Any) -> Any:
    if isinstance(value, bool):
        return int(value)
    if isinstance(value, float):
        return repr(value)
    return value
