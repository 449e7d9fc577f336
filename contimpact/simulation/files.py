"""Sweeps, attractors and orbits as files, written and loaded.

A diagram is a folder, as `contimpact run` writes it; a branch and a curve are tables as in such a
folder; anything else is JSON. Numbers are read back to the same bits.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import __version__
from ..errors import DAMAGE, InputError, explain_arguments, short_repr
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..results.branch import Branch, Entry, coordinates, model_by_name, orbit_with
from ..results.catalogue import (
    BRANCH,
    CURVE,
    SWEEP,
    branch_text,
    curve_text,
    entry_of,
    load_diagram,
    read_branch,
    read_curve,
    stopped_at,
    sweep_cells,
    write_diagram,
)
from ..results.curve import Curve
from ..results.diagram import Diagram
from ..schema import build_record, fit_value
from ..segments.kernels import Kernels
from ..storage import (
    Json,
    append_line,
    check_reading,
    csv_of_records,
    csv_text,
    is_there,
    json_line,
    json_text,
    read_bounded,
    reason,
    write_text,
)
from .attractor import Attractor, Kind
from .run import RUN_COLUMNS, WIDER, Run
from .sweep import WRITTEN, Row, Sweep, table_of

if TYPE_CHECKING:
    from ..systems.membrane import Membrane
    from .energy import Energy
    from .sweep import Coverage
    from .transitions import Transition


# Writing what was simulated, and going on with it after an interruption.
#
# Each result is added to ``rows.jsonl`` as soon as it is found; ``--resume`` reads that file.
# The other files are contracts, with a schema name and number each: ``sweep.csv``,
# ``transitions.json``, ``coverage.json``, ``losses.csv`` and ``energy.csv``.

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
    drawn = {"portraits", "basins", "grid", "branches", "transitions", "losses", "crises"}
    drawn |= {"fractions", "fraction_starts", "refine", "box"}
    parts["simulate"] = {k: v for k, v in parts["simulate"].items() if k not in drawn}
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


@dataclasses.dataclass(frozen=True)
class Trial:
    """What an attractor led to at a value, after so many periods; None if that cannot be told."""

    value: float
    periods: int
    attractor: Attractor | None

    def as_record(self) -> dict[str, Any]:
        """Return plain data."""
        record = None if self.attractor is None else self.attractor.as_record()
        return {"trial": self.value, "periods": self.periods, "attractor": record}

    @staticmethod
    def from_record(record: Mapping[str, Any]) -> Trial:
        """Return the trial a record was made of."""
        at, found = fit_value(record["trial"], float, "trial"), record["attractor"]
        periods = fit_value(record["periods"], int, "periods")
        return Trial(at, periods, None if found is None else Attractor.from_record(found))


TRIAL = '{"trial"'
"""How the lines of trials begin."""


class Checkpoint:
    """What was found so far, in a file that grows line by line, of the scene with this
    `fingerprint`; to `resume` is to keep what is in the file already. Rows have to be of the
    model's attractors.

    The rows are in `rows`; transitions between two rows of a sweep in `changes`, by direction and
    value of the second one; in `tried` the values at which the random starts have been made; in
    `trials` those of transitions that are being located, in order: the file is without them, once
    these are found. `lost` says why nothing more could be kept, if so; what is found is then in
    memory alone.

    Raises InputError if the file is of another scene, or damaged.
    """

    def __init__(self, path: Path, digest: str, resume: bool, model: Model | None = None) -> None:
        self.path = path
        self.rows: list[Row] = []
        self.changes: dict[tuple[str, float], list[Transition]] = {}
        self.tried: set[float] = set()
        self.trials: list[Trial] = []
        self.model = model
        self.lost: str | None = None
        lines = self._lines() if resume and path.exists() else []
        head = json.dumps({"schema": ROWS, "scene": digest, "version": __version__})
        if lines and lines[0] != head:
            accepted = "resume with the scene that was begun, or leave --resume out"
            raise InputError(str(path), "it belongs to another scene or version", accepted)
        for line in lines[1:]:
            self._take(line)
        self.known: Iterator[Trial] = iter([*self.trials])
        others = [line for line in lines[1:] if not line.startswith(TRIAL)]
        trials = [json.dumps(trial.as_record()) for trial in self.trials]
        write_text(path, "".join(f"{line}\n" for line in [head, *others, *trials]))

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
                self.rows.append(Row.from_record(record["row"]))
                self._require(self.rows[-1].attractor)
            elif "changes" in record:
                found = [Transition.from_record(item) for item in record["changes"]]
                key = fit_value(
                    [record["direction"], record["value"]], tuple[str, float], "changes"
                )
                self.changes[key] = found
                self.trials.clear()
            elif "trial" in record:
                self.trials.append(Trial.from_record(record))
                self._require(self.trials[-1].attractor)
            else:
                self.tried.add(fit_value(record["tried"], float, "tried"))
        except DAMAGE as error:
            raise self._unfit(f"damaged ({type(error).__name__}: {error})") from None

    def _unfit(self, why: str) -> InputError:
        return InputError(str(self.path), why, "leave --resume out to begin anew")

    def check(self, sweeps: Iterable[tuple[str, Sequence[float]]], at_random: Set[float]) -> None:
        """Make sure that the rows are the beginning of each sweep, by its direction and the values
        that it visits, and each there once; random starts are made at some values.

        Raises InputError if they are not: two runs have written to the file, or it was edited.
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

    def _require(self, attractor: Attractor | None) -> None:
        if self.model is not None and attractor is not None:
            attractor.require(self.model)

    def _append(self, record: Mapping[str, Any]) -> None:
        """Add a line; on a full disk go on without."""
        if self.lost:
            return
        try:
            append_line(self.path, json.dumps(record))
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
        self._forget_trials()

    def _forget_trials(self) -> None:
        """Leave trials out of the file; where it cannot be written, go on without."""
        if self.trials and not self.lost:
            try:
                lines = [line for line in self._lines() if not line.startswith(TRIAL)]
                write_text(self.path, "".join(f"{line}\n" for line in lines))
            except InputError as error:
                self.lost = str(error)
        self.trials.clear()
        self.known = iter(())

    def next_trial(self, value: float, periods: int) -> Trial | None:
        """Return the next trial that was made before an interruption, if it is this one."""
        found = next(self.known, None)
        if found is not None and (found.value, found.periods) != (value, periods):
            self._forget_trials()
            return None
        return found

    def keep_trial(self, trial: Trial) -> None:
        """Keep one more trial."""
        self.trials.append(trial)
        self._append(trial.as_record())


# Tables.


def sweep_text(sweep: Sweep, stopped: str | None = None) -> str:
    """Return ``sweep.csv``: a comment line with the schema, and with what was being done when the
    simulation ended early, if it did; then a row per attractor."""
    columns, rows = table_of(sweep)
    head = {"schema": SWEEP, "parameter": sweep.parameter}
    head |= {"interrupted": stopped} if stopped else {}
    return f"# {json.dumps(head)}\n" + csv_text(columns, rows)


def sweep_of(path: Path, model: Model) -> Sweep:
    """Return the sweep of ``sweep.csv`` with what pictures show of its attractors: kinds, names,
    periods, and the impacts that the table keeps.

    Raises InputError if the file is damaged, or of another system.
    """
    parameter, table = sweep_cells(path)
    kernels = Kernels(model, parameter)
    with check_reading(path, SWEEP):
        rows = [_attractor_row(cells, model, parameter, kernels) for cells in table]
    return Sweep(model, parameter, rows, stopped_at(path).startswith(("sweep", "random")))


def _attractor_row(cells: Mapping[str, str], model: Model, parameter: str, kernels: Kernels) -> Row:
    values = {name: float(cells[name]) for name in (*model.values, *model.DERIVED)}
    count = sum(bool(cells.get(f"wall{k + 1}")) for k in range(WRITTEN))
    walls = [cells[f"wall{k + 1}"] for k in range(count)]
    names = coordinates(model.unknowns_per_impact)
    table = [[float(cells[f"{name}{k + 1}"]) for name in names] for k in range(count)]
    impacts = np.array(table).reshape(count, len(names))
    T = float(kernels.setup(*(values[name] for name in model.values)).period)
    span, free = float(cells["period"] or math.nan), model.autonomous
    attractor = Attractor(
        Kind(cells["kind"]),
        values,
        cells["notation"],
        T,
        cells["word"] or None,
        None if not cells["word"] else 0 if free else int(cells["period"]),
        np.array([model.letters.index(wall.rstrip("*")) for wall in walls], dtype=np.int8),
        impacts[:, 0],
        impacts[:, 1],
        np.array([wall.endswith("*") for wall in walls], dtype=bool),
        impacts[:, 2:],
        span=span if free else math.nan,
        free=free,
    )
    return Row(cells["direction"], values[parameter], attractor)


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
    from .energy import attractor_voltages

    parameter = sweep.parameter
    rows = _energy_rows(sweep, "U", lambda a: attractor_voltages(membrane, a))
    for branch in diagram.branches if diagram else []:
        rows += _branch_rows(membrane, branch, sweep.model.DERIVED)
    head = json.dumps({"schema": ENERGY, "parameter": parameter, "membrane": asdict(membrane)})
    first = "from", "notation", "stable", "physical", parameter
    return f"# {head}\n" + csv_of_records(rows, first)


def losses_text(sweep: Sweep, kernels: Kernels) -> str:
    """Return ``losses.csv``: a row per attractor, the kinetic energy that its impacts take."""
    from .energy import losses_of_attractor

    rows = _energy_rows(sweep, "E", lambda a: losses_of_attractor(a, sweep.model, kernels))
    head = json.dumps({"schema": LOSSES, "parameter": sweep.parameter})
    return f"# {head}\n" + csv_of_records(rows)


def _energy_rows(
    sweep: Sweep, letter: str, of: Callable[[Attractor], Energy]
) -> list[dict[str, Any]]:
    """A row for each attractor with what its impacts deliver, or lose, under names with a
    letter."""
    rows = []
    for row in sweep.rows:
        found = of(row.attractor)
        derived = {name: row.attractor.parameters[name] for name in sweep.model.DERIVED}
        means = {f"{letter}_I": found.per_impact, f"{letter}_T": found.per_time}
        listed = enumerate(found.impacts[:WRITTEN].tolist(), start=1)
        each = {f"{letter}{k}": value for k, value in listed}
        named = {"from": row.direction, "notation": row.attractor.notation}
        rows.append(named | {sweep.parameter: row.value} | derived | means | each)
    return rows


def _branch_rows(
    membrane: Membrane, branch: Branch, derived: Sequence[str]
) -> list[dict[str, Any]]:
    from ..results.quantities import branch_voltages

    names = [branch.parameter, *derived]
    columns = {name: branch[name].tolist() for name in names}
    columns["stable"], columns["physical"] = branch.stable.tolist(), branch.physical.tolist()
    columns |= {name: values.tolist() for name, values in branch_voltages(membrane, branch).items()}
    return [
        {"from": branch.id, "notation": branch.notation}
        | {name: values[k] for name, values in columns.items()}
        for k in range(len(branch))
    ]


KEPT = "contimpact.kept/1"
LARGEST_KEPT = 2**30
"""Bytes of a file that are read."""


@explain_arguments
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


@explain_arguments
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
        with check_reading(path, BRANCH, CURVE):
            first = read_bounded(path, LARGEST_KEPT).split(b"\n", 1)[0].decode()
            schema = json.loads(first.removeprefix("# "))["schema"]
        return read_curve(path) if schema == CURVE else read_branch(path)
    if not is_there(path):
        raise InputError(
            str(path), "no such file or folder", "give what `save` or a run has written"
        )
    if path.suffix == ".toml":
        raise InputError(str(path), "a scene", "read it with load_scene, or run it with follow")
    with check_reading(path, KEPT):
        record = json.loads(read_bounded(path, LARGEST_KEPT))
        if record["schema"] != KEPT:
            raise InputError(
                str(path), f"its schema is {short_repr(record['schema'])}", f"give {KEPT!r}"
            )
        return _result(record, model)


def _require_ending(path: Path, ending: str) -> None:
    if path.suffix != ending:
        raise InputError(
            "path", f"found {short_repr(path.name)}", f"give a name that ends in {ending}"
        )


def _content(result: Any) -> dict[str, Any]:
    """A result as plain data."""
    if isinstance(result, Sweep):
        rows = [row.as_record() for row in result.rows]
        about = _model_record(result.model) | {"parameter": result.parameter}
        return {"kind": "sweep", **about, "rows": rows}
    several = isinstance(result, Sequence) and not isinstance(result, str)
    items = list(result) if several else [result]
    for kind, name, record in (
        (Entry, "entries", dataclasses.asdict),
        (Orbit, "orbits", _orbit_record),
        (Attractor, "attractors", Attractor.as_record),
        (Run, "runs", _run_record),
    ):
        if items and all(isinstance(item, kind) for item in items):
            return {"kind": name, "several": several, "items": [record(item) for item in items]}
    accepted = (
        "give a diagram, branch, curve, entry, orbit, attractor, run, sweep, or a list of "
        "entries, orbits, attractors or runs; several branches as ci.Diagram(name, branches)"
    )
    raise InputError("result", f"found {short_repr(result)}", accepted)


def _model_record(model: Model) -> dict[str, Any]:
    return {"system": model.SYSTEM, "options": model.options, "parameters": model.values}


def _orbit_record(orbit: Orbit) -> dict[str, Any]:
    about = _model_record(orbit.model) | {"parameter": orbit.problem.parameter}
    word = {"word": orbit.word.walls, "period": orbit.word.period}
    return about | word | {"unknowns": orbit.unknowns.tolist()}


def _run_record(run: Run) -> dict[str, Any]:
    columns = {name: getattr(run, name).tolist() for name in RUN_COLUMNS}
    states = {"end": run.end, "left": run.left}
    kept = {name: None if s is None else dataclasses.asdict(s) for name, s in states.items()}
    about = {"letters": list(run.letters), "period": run.period, "outcome": run.outcome.name}
    return about | columns | kept


def _run(record: Mapping[str, Any]) -> Run:
    """A run; its columns have a row each for the same impacts."""
    given = dict(record)
    for name, kind in RUN_COLUMNS.items():
        given[name] = np.array(given[name], dtype=kind)
    if not given["others"].size:
        given["others"] = given["others"].reshape(len(record["others"]), 0)
    own = {len(given[name]) for name in RUN_COLUMNS if given[name].size or name not in WIDER}
    run = build_record(Run, given)
    if len(own) != 1 or np.any(run.walls < 0):
        raise ValueError("impacts that are no table")
    if np.any(run.walls >= len(run.letters)):
        raise ValueError("a wall without a name")
    return run


def _result(record: Mapping[str, Any], model: Model | None) -> Any:
    kind = record["kind"]
    if kind == "sweep":
        rows = [Row.from_record(row) for row in record["rows"]]
        return Sweep(
            model_by_name(record, model), fit_value(record["parameter"], str, "parameter"), rows
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
    unknowns = fit_value(record["unknowns"], Sequence[float], "unknowns")
    word = fit_value(record["word"], str, "word"), fit_value(record["period"], int, "period")
    at = model_by_name(record, model)
    return orbit_with(
        at, word, fit_value(record["parameter"], str, "parameter"), np.array(unknowns)
    )
