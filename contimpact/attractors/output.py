"""Writing what was simulated, and going on with it after an interruption.

Each result is added to ``rows.jsonl`` as soon as it is found; ``--resume`` reads that file.
The other files are contracts, with a schema name and number each: ``sweep.csv``,
``transitions.json``, ``coverage.json``, ``losses.csv`` and ``energy.csv``.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .. import __version__
from ..errors import InputError
from ..results.branch import Branch
from ..results.diagram import Diagram
from ..storage.files import append, read_bounded, reason, write_text
from ..storage.texts import DAMAGE, Json, csv_text, fitted, json_text
from .flat import WRITTEN, table_of
from .sweep import Row, Sweep

if TYPE_CHECKING:
    from ..models.model import Model
    from ..segments.kernels import Kernels
    from .coverage import Coverage
    from .energy import Membrane
    from .transitions import Transition

SWEEP = "contimpact.sweep/1"
ROWS = "contimpact.rows/1"
TRANSITIONS = "contimpact.transitions/1"
COVERAGE = "contimpact.coverage/1"
ENERGY = "contimpact.energy/1"
LOSSES = "contimpact.losses/1"

LARGEST = 2**32
"""Bytes of ``rows.jsonl`` that are read."""


# Rows, as they are found.


def fingerprint(resolved: Mapping[str, Any]) -> str:
    """Return a digest of what decides the rows: model, followed parameter, and sweep."""
    parts = {name: resolved[name] for name in ("model", "simulate")}
    parts["parameter"] = resolved["follow"]["parameter"]
    drawn = ("portraits", "basins", "grid", "branches", "transitions", "losses")
    parts["simulate"] = {k: v for k, v in parts["simulate"].items() if k not in drawn}
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


class Checkpoint:
    """What was found so far, in a file that grows line by line.

    Parameters
    ----------
    path : Path
    digest : str
        Of the scene, by `fingerprint`.
    resume : bool
        Whether what is in the file already is kept.
    model : Model, optional
        Whose attractors the rows have to be.

    Attributes
    ----------
    lost : str or None
        Why nothing more could be kept, if so; what is found is then in memory alone.
    rows : list of Row
    changes : dict
        Transitions between two rows of a sweep, by direction and value of the second one.
    tried : set of float
        Values at which the random starts have been made.

    Raises
    ------
    InputError
        If the file is of another scene, or damaged.
    """

    def __init__(self, path: Path, digest: str, resume: bool, model: Model | None = None) -> None:
        self.path = path
        self.rows: list[Row] = []
        self.changes: dict[tuple[str, float], list[Transition]] = {}
        self.tried: set[float] = set()
        self.model = model
        self.lost: str | None = None
        lines = self._lines() if resume and path.exists() else []
        head = json.dumps({"schema": ROWS, "scene": digest, "version": __version__})
        if lines and lines[0] != head:
            accepted = "resume with the scene that was begun, or leave --resume out"
            raise InputError(str(path), "it belongs to another scene or version", accepted)
        for line in lines[1:]:
            self._take(line)
        write_text(path, "".join(f"{line}\n" for line in [head, *lines[1:]]))

    def _lines(self) -> list[str]:
        """The whole lines of the file; an interrupted last one is left out."""
        try:
            text = read_bounded(self.path, LARGEST).decode()
        except (OSError, ValueError) as error:
            raise self._unfit(f"cannot be read ({reason(error)})") from None
        return [line for line in text[: text.rfind("\n") + 1].split("\n") if line]

    def _take(self, line: str) -> None:
        from .transitions import Transition

        try:
            record = json.loads(line)
            if "row" in record:
                self.rows.append(self._fitting(Row.from_record(record["row"])))
            elif "changes" in record:
                found = [Transition.from_record(item) for item in record["changes"]]
                key = fitted([record["direction"], record["value"]], tuple[str, float], "changes")
                self.changes[key] = found
            else:
                self.tried.add(fitted(record["tried"], float, "tried"))
        except DAMAGE as error:
            raise self._unfit(f"damaged ({type(error).__name__}: {error})") from None

    def _unfit(self, why: str) -> InputError:
        return InputError(str(self.path), why, "leave --resume out to begin anew")

    def check(self, sweeps: Iterable[tuple[str, Sequence[float]]], at_random: Set[float]) -> None:
        """Make sure that the rows are the beginning of each sweep, and each there once.

        Parameters
        ----------
        sweeps : iterable
            Directions and the values that each visits.
        at_random : set of float
            Values at which random starts are made.

        Raises
        ------
        InputError
            If they are not: two runs have written to the file, or it was edited.
        """
        expected = {direction: list(values) for direction, values in sweeps}
        for direction, values in expected.items():
            found = [row.value for row in self.rows if row.direction == direction]
            if found != values[: len(found)]:
                raise self._unfit(f"its rows of the sweep {direction} are not those of one run")
        others = [row for row in self.rows if row.direction not in expected]
        if any(r.direction != "random" or r.value not in at_random for r in others):
            raise self._unfit("it has rows that are not of this scene")
        texts = [json.dumps(row.as_record()) for row in others]
        if len(set(texts)) < len(texts) or not self.tried <= at_random:
            raise self._unfit("its random starts are not those of one run")

    def _fitting(self, row: Row) -> Row:
        """A row, if it can be one of the model's."""
        if self.model is not None:
            row.attractor.require(self.model)
        return row

    def _append(self, record: Mapping[str, Any]) -> None:
        """Add a line; on a full disk go on without."""
        if self.lost:
            return
        try:
            append(self.path, (json.dumps(record) + "\n").encode())
        except OSError as error:
            self.lost = reason(error)

    def keep(self, row: Row) -> None:
        """Keep one more row."""
        self.rows.append(row)
        self._append({"row": row.as_record()})

    def keep_tried(self, value: float) -> None:
        """Keep that the random starts at a value have been made."""
        self.tried.add(value)
        self._append({"tried": value})

    def keep_changes(self, direction: str, value: float, found: Sequence[Transition]) -> None:
        """Keep the transitions on the way to a row."""
        self.changes[direction, value] = list(found)
        records = [transition.as_record() for transition in found]
        self._append({"direction": direction, "value": value, "changes": records})


# Tables.


def sweep_text(sweep: Sweep) -> str:
    """Return ``sweep.csv``: a comment line with the schema, then a row per attractor."""
    columns, rows = table_of(sweep)
    head = json.dumps({"schema": SWEEP, "parameter": sweep.parameter})
    return f"# {head}\n" + csv_text(columns, rows)


def transitions_text(transitions: Sequence[Transition], parameter: str, width: float) -> str:
    """Return ``transitions.json``."""
    found = [transition.as_record() for transition in transitions]
    head: dict[str, Json] = {"schema": TRANSITIONS, "parameter": parameter, "width": width}
    return json_text({**head, "transitions": found})


def coverage_text(coverage: Coverage, parameter: str) -> str:
    """Return ``coverage.json``."""
    return json_text({"schema": COVERAGE, "parameter": parameter, **coverage.as_record()})


def energy_text(membrane: Membrane, sweep: Sweep, diagram: Diagram | None = None) -> str:
    """Return ``energy.csv``: a row per attractor and per point of a branch.

    The column ``from`` is a direction of the sweep or a branch; the comment line holds the
    constants of membranes and ball.
    """
    parameter, rows = sweep.parameter, _attractor_rows(membrane, sweep)
    for branch in diagram.branches if diagram else []:
        rows += _branch_rows(membrane, branch, sweep.model.DERIVED)
    columns = ["from", "notation", "stable", "physical", parameter]
    columns += [name for row in rows for name in row if name not in columns]
    columns = list(dict.fromkeys(columns))
    head = json.dumps({"schema": ENERGY, "parameter": parameter, "membrane": asdict(membrane)})
    return f"# {head}\n" + csv_text(columns, ([row.get(c) for c in columns] for row in rows))


def losses_text(sweep: Sweep, kernels: Kernels) -> str:
    """Return ``losses.csv``: a row per attractor, the kinetic energy that its impacts take."""
    from .losses import of_attractor

    rows = []
    for row in sweep.rows:
        found = of_attractor(row.attractor, sweep.model, kernels)
        derived = {name: row.attractor.parameters[name] for name in sweep.model.DERIVED}
        means = {"E_I": found.per_impact, "E_T": found.per_time}
        each = {f"E{k + 1}": lost for k, lost in enumerate(found.impacts[:WRITTEN].tolist())}
        named = {"from": row.direction, "notation": row.attractor.notation}
        rows.append(named | {sweep.parameter: row.value} | derived | means | each)
    columns = list(dict.fromkeys(name for row in rows for name in row))
    head = json.dumps({"schema": LOSSES, "parameter": sweep.parameter})
    return f"# {head}\n" + csv_text(columns, ([row.get(c) for c in columns] for row in rows))


def _attractor_rows(membrane: Membrane, sweep: Sweep) -> list[dict[str, Any]]:
    from .energy import of_attractor

    rows = []
    for row in sweep.rows:
        a = row.attractor
        energy = of_attractor(membrane, a)
        derived = {name: a.parameters[name] for name in sweep.model.DERIVED}
        means = {"U_I": energy.per_impact, "U_T": energy.per_time}
        each = {f"U{k + 1}": u for k, u in enumerate(energy.impacts[:WRITTEN].tolist())}
        named = {"from": row.direction, "notation": a.notation, sweep.parameter: row.value}
        rows.append(named | derived | means | each)
    return rows


def _branch_rows(
    membrane: Membrane, branch: Branch, derived: Sequence[str]
) -> list[dict[str, Any]]:
    from .energy import along

    names = [branch.parameter, *derived]
    columns = {name: branch[name].tolist() for name in names}
    columns["stable"], columns["physical"] = branch.stable.tolist(), branch.physical.tolist()
    columns |= {name: values.tolist() for name, values in along(membrane, branch).items()}
    return [
        {"from": branch.id, "notation": branch.notation}
        | {name: values[k] for name, values in columns.items()}
        for k in range(len(branch))
    ]
