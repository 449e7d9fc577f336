"""What a script keeps, to files and back: diagrams, branches, curves, entries, orbits, sweeps.

A diagram is a folder, as `contimpact run` writes it; a branch and a curve are tables as in such a
folder; anything else is JSON. Numbers are read back to the same bits.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError, shown
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..results.branch import Branch, Entry, named_model, orbit_with
from ..results.catalogue import (
    BRANCH,
    CURVE,
    branch_text,
    checking,
    curve_text,
    entry_of,
    load_diagram,
    read_branch,
    read_curve,
    write_diagram,
)
from ..results.curve import Curve
from ..results.diagram import Diagram
from ..simulation.run import Outcome, Run, State
from ..storage.files import is_there, read_bounded, write_text
from ..storage.texts import fitted, json_line, made
from .attractor import Attractor
from .sweep import Row, Sweep

KEPT = "contimpact.kept/1"
LARGEST = 2**30
"""Bytes of a file that are read."""


def save(result: Any, path: str | Path) -> None:
    """Write a result to a file, or a diagram to a folder; `load` reads it back.

    Parameters
    ----------
    result : Diagram, Branch, Curve, Entry, Orbit, Attractor, Run, Sweep, or list
        Of entries, orbits, attractors or runs. Several branches or curves are kept as a diagram.
    path : str or Path
        A folder for a diagram; a file whose name ends in ``.csv`` for a branch or a curve, in
        ``.json`` for the rest.

    Raises
    ------
    InputError
        For anything else, another ending, or a place that cannot be written.
    """
    path = Path(path)
    if isinstance(result, Diagram):
        write_diagram(result, path)
    elif isinstance(result, Branch | Curve):
        _require_ending(path, ".csv")
        text = branch_text(result) if isinstance(result, Branch) else curve_text(result)
        write_text(path, text)
    else:
        content = _content(result)
        _require_ending(path, ".json")
        write_text(path, json_line({"schema": KEPT, **content}) + "\n")


def load(path: str | Path, model: Model | None = None) -> Any:
    """Read what `save` has written, or a folder of ``contimpact run``.

    Parameters
    ----------
    path : str or Path
    model : Model, optional
        The system of orbits or of a sweep, where its name does not tell: an own one that is not
        imported. Parameter values are taken from the file.

    Returns
    -------
    Diagram, Branch, Curve, Entry, Orbit, Attractor, Run, Sweep or list
        Equal to what was saved.

    Raises
    ------
    InputError
        If there is nothing of the kind, it is damaged, or its system is not known.
    """
    path = Path(path)
    if path.is_dir():
        return load_diagram(path)
    if path.suffix == ".csv":
        with checking(path, f"{BRANCH}' or '{CURVE}"):
            first = read_bounded(path, LARGEST).split(b"\n", 1)[0].decode()
            schema = json.loads(first.removeprefix("# "))["schema"]
        return read_curve(path) if schema == CURVE else read_branch(path)
    if not is_there(path):
        raise InputError(
            str(path), "no such file or folder", "give what `save` or a run has written"
        )
    with checking(path, KEPT):
        record = json.loads(read_bounded(path, LARGEST))
        if record["schema"] != KEPT:
            raise InputError(
                str(path), f"its schema is {shown(record['schema'])}", f"give {KEPT!r}"
            )
        return _result(record, model)


def _require_ending(path: Path, ending: str) -> None:
    if path.suffix != ending:
        raise InputError("path", f"found {shown(path.name)}", f"give a name that ends in {ending}")


def _content(result: Any) -> dict[str, Any]:
    """A result as plain data."""
    if isinstance(result, Sweep):
        rows = [row.as_record() for row in result.rows]
        about = _of_model(result.model) | {"parameter": result.parameter}
        return {"kind": "sweep", **about, "rows": rows}
    several = isinstance(result, Sequence) and not isinstance(result, str)
    items = list(result) if several else [result]
    for kind, name, record in (
        (Entry, "entries", dataclasses.asdict),
        (Orbit, "orbits", _of_orbit),
        (Attractor, "attractors", Attractor.as_record),
        (Run, "runs", _of_run),
    ):
        if items and all(isinstance(item, kind) for item in items):
            return {"kind": name, "several": several, "items": [record(item) for item in items]}
    accepted = (
        "give a diagram, branch, curve, entry, orbit, attractor, run, sweep, or a list of "
        "entries, orbits, attractors or runs; several branches as ci.Diagram(name, branches)"
    )
    raise InputError("result", f"found {shown(result)}", accepted)


def _of_model(model: Model) -> dict[str, Any]:
    return {"system": model.SYSTEM, "options": model.options, "parameters": model.values}


def _of_orbit(orbit: Orbit) -> dict[str, Any]:
    about = _of_model(orbit.model) | {"parameter": orbit.problem.parameter}
    word = {"word": orbit.word.walls, "period": orbit.word.period}
    return about | word | {"unknowns": orbit.unknowns.tolist()}


COLUMNS: dict[str, Any] = {"walls": np.int8, "turns": np.int64, "phases": float}
COLUMNS |= {"velocities": float, "released": bool, "others": float, "held": np.int64}

WIDER = ("others", "held")
"""Columns of several coordinates, empty for one."""


def _of_run(run: Run) -> dict[str, Any]:
    columns = {name: getattr(run, name).tolist() for name in COLUMNS}
    states = {"end": run.end, "left": run.left}
    kept = {name: None if s is None else dataclasses.asdict(s) for name, s in states.items()}
    about = {"letters": list(run.letters), "period": run.period, "outcome": run.outcome.name}
    return about | columns | kept


def _run(record: Mapping[str, Any]) -> Run:
    """A run; its columns have a row each for the same impacts."""
    columns: dict[str, Any] = {
        name: np.array(record[name], dtype=kind) for name, kind in COLUMNS.items()
    }
    if not columns["others"].size:
        columns["others"] = columns["others"].reshape(len(record["others"]), 0)
    own = [column for name, column in columns.items() if column.size or name not in WIDER]
    if len({len(column) for column in own}) != 1 or np.any(columns["walls"] < 0):
        raise ValueError("impacts that are no table")
    letters = tuple(fitted(record["letters"], Sequence[str], "letters"))
    if np.any(columns["walls"] >= len(letters)):
        raise ValueError("a wall without a name")
    end, left = (None if record[n] is None else made(State, record[n]) for n in ("end", "left"))
    period = fitted(record["period"], float, "period")
    return Run(letters, period, outcome=Outcome[record["outcome"]], end=end, left=left, **columns)


def _result(record: Mapping[str, Any], model: Model | None) -> Any:
    kind = record["kind"]
    if kind == "sweep":
        rows = [Row.from_record(row) for row in record["rows"]]
        return Sweep(
            named_model(record, model), fitted(record["parameter"], str, "parameter"), rows
        )
    make: Any = {
        "entries": entry_of,
        "orbits": lambda item: _orbit(item, model),
        "attractors": Attractor.from_record,
        "runs": _run,
    }[kind]
    items = [make(item) for item in record["items"]]
    return items if record["several"] else items[0]


def _orbit(record: Mapping[str, Any], model: Model | None) -> Orbit:
    unknowns = fitted(record["unknowns"], Sequence[float], "unknowns")
    word = fitted(record["word"], str, "word"), fitted(record["period"], int, "period")
    at = named_model(record, model)
    return orbit_with(at, word, fitted(record["parameter"], str, "parameter"), np.array(unknowns))
