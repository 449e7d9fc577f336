"""A study as it is read from a store: its quantities, its maps, its sweeps.

Nothing is read before it is asked for, and what is asked for row by row is never in memory whole.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
import json
import math
import sqlite3
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..bifurcations.declarations import SWITCHES
from ..display import NotebookResult, Summary, frame
from ..errors import InputError, count_text, explain_arguments, require_known, short_repr
from ..models import expressions
from ..models.guards import is_rotation
from ..results.catalogue import branch_in
from ..simulation.attractor import Attractor, Kind
from ..simulation.sweep import Row, Simulators, Sweep
from .store import OF_SCENES, STEPS, Store, decompress_text, open_store, refusal, schema_version
from .study_file import StudyFile, read_study

if TYPE_CHECKING:
    from ..results.branch import Entry


# Quantities of a study's scenes that maps show: a number or a name for each scene.
#
# Most are read from the *main* stable orbit of a notation: of all branches with stable orbits that
# on which they reach the largest value of the derived parameter (of the followed one where there is
# none). It ends where the last of its intervals of stability does as that value falls; "as the
# parameter falls" is said of that value, too.

Values = dict[int, Any]
PAIR = ("PD", "G")
"""Kinds whose distance is measured."""
assert {*PAIR} <= {*SWITCHES}


class Quantity(NamedTuple):
    """A quantity: how it is computed, what is said of it, and whether it is a name."""

    values: Callable[[Study, str], Values]
    text: str
    named: bool = False


class Main(NamedTuple):
    """The main stable orbit of a scene: its branch, its range, what ends it as the parameter
    falls."""

    branch: str
    low: float
    high: float
    end: str | None


def main_orbits(study: Study, orbit: str) -> dict[int, Main]:
    """Return the main stable orbit of a notation in each scene that has one."""
    intervals: dict[tuple[int, str], list[Main]] = {}
    columns = ("low_derived", "high_derived") if study.derived else ("low", "high")
    for row in study.rows(
        f"SELECT scene, branch, {', '.join(columns)}, low_end, high_end FROM intervals"
        " WHERE study = ? AND notation = ?",
        [study.number, orbit],
    ):
        scene, branch, low, high, low_end, high_end = row
        if low > high:  # the derived parameter falls as the followed one rises
            low, high, low_end = high, low, high_end
        intervals.setdefault((scene, branch), []).append(Main(branch, low, high, low_end))
    found: dict[int, Main] = {}
    for (scene, _), own in intervals.items():
        main = min(own, key=lambda one: one.low)._replace(high=max(one.high for one in own))
        if scene not in found or main.high > found[scene].high:
            found[scene] = main
    return found


def ends(study: Study, orbit: str) -> Values:
    """Which bifurcation ends the main stable orbit as the parameter falls."""
    query = "SELECT scene, event, label FROM events WHERE study = ? AND notation = ?"
    labels = {(s, event): label for s, event, label in study.rows(query, [study.number, orbit])}
    return {
        scene: labels.get((scene, main.end), main.end or "status changes")
        for scene, main in main_orbits(study, orbit).items()
    }


def mechanism(study: Study, orbit: str) -> Values:
    """By which mechanism the main stable orbit gives way to one with one impact more.

    Of several transitions that whose grazing is nearest to the end of stability.
    """
    mains, best = main_orbits(study, orbit), dict[int, tuple[float, Any]]()
    for scene, branch, number, value in study.rows(
        f"SELECT t.scene, e.branch, t.mechanism, {_value(study)} FROM transitions t"
        " JOIN events e ON e.study = t.study AND e.scene = t.scene AND e.event = t.grazing"
        " WHERE t.study = ? AND t.source = ?",
        [study.number, orbit],
    ):
        main = mains.get(scene)
        if main is not None and main.branch == branch:
            near = abs(value - main.low), number
            best[scene] = min(best.get(scene, near), near, key=lambda pair: pair[0])
    return {scene: str(number or "not decided") for scene, (_, number) in best.items()}


def distance(study: Study, orbit: str) -> Values:
    """The distance from the grazing to the period doubling of the main stable orbit.

    One of them ends its stability, the other, a ghost, is the nearest along the branch; positive
    where the doubling comes first as the parameter falls.
    """
    found = {}
    for scene, main, own in _main_events(study, orbit):
        ending = next((e for e in own if e[1] == main.end and e[2] in PAIR), None)
        others = [e for e in own if ending and e[2] in PAIR and e[2] != ending[2]]
        if ending is None or not others:
            continue
        other = min(others, key=lambda e: abs(e[4] - ending[4]))
        value = {ending[2]: ending[3], other[2]: other[3]}
        found[scene] = value[PAIR[0]] - value[PAIR[1]]
    return found


def bistability(study: Study, orbit: str) -> Values:
    """The widest range of the parameter in which two orbits are stable: a lower bound, since there
    may be others on no branch that was followed."""
    columns = ("low_derived", "high_derived") if study.derived else ("low", "high")
    low, high = (
        f"min({{0}}.{columns[0]}, {{0}}.{columns[1]})",
        f"max({{0}}.{columns[0]}, {{0}}.{columns[1]})",
    )
    query = (
        f"SELECT a.scene, max(min({high.format('a')}, {high.format('b')})"
        f" - max({low.format('a')}, {low.format('b')})) FROM intervals a"
        " JOIN intervals b ON a.study = b.study AND a.scene = b.scene AND a.number < b.number"
        " WHERE a.study = ? GROUP BY a.scene"
    )
    found = {scene: 0.0 for (scene,) in _done(study)}
    return found | {s: max(wide, 0.0) for s, wide in study.rows(query, [study.number])}


def energy(study: Study, orbit: str) -> Values:
    """The largest mean voltage per unit of time of a scene's attractors."""
    query = "SELECT scene, max(per_time) FROM energies WHERE study = ? GROUP BY scene"
    return dict(study.rows(query, [study.number]))


def bound(study: Study, orbit: str) -> Values:
    """How much sooner simulated motion meets the orbit to which a ghost grazing leads than that.

    The ghost is the grazing of the main stable orbit that is nearest to its end along the branch.
    Of a sweep with falling values it is the first that has the orbit or a multiple of its period.
    """
    ghosts = dict[int, list[Any]]()
    for scene, main, own in _main_events(study, orbit):
        end = next((e[4] for e in own if e[1] == main.end), math.nan)
        grazings = [e for e in own if e[2] == PAIR[1] and math.isfinite(end)]
        nearest = min(grazings, key=lambda e: abs(e[4] - end), default=None)
        if nearest is not None and nearest[5] and nearest[6]:
            ghosts[scene] = nearest
    met = _first_met(study, {scene: event[6:] for scene, event in ghosts.items()})
    return {scene: value - ghosts[scene][3] for scene, value in met.items()}


def _first_met(study: Study, orbits: Mapping[int, Sequence[Any]]) -> dict[int, float]:
    """Where a sweep with falling values first meets the orbit of a word and a period in a scene."""
    along, met = derived_axis(study), dict[int, float]()
    query = (
        "SELECT scene, direction, value, word, period FROM attractors WHERE study = ?"
        " AND direction <> 'random' ORDER BY scene, number"
    )
    rows = study.rows(query, [study.number])
    for (scene, _), sweep in itertools.groupby(rows, key=lambda row: (row[0], row[1])):
        own = list(sweep) if scene in orbits else []
        first = next((k for k, p in enumerate(own) if _repeats(*p[3:], *orbits[scene])), 0)
        values = [along(scene, own[k][2]) for k in (first - 1, first)] if first else [0.0, 0.0]
        if values[1] < values[0]:
            met[scene] = values[1]
    return met


def _repeats(word: str | None, period: int | None, becomes: str, of: int) -> bool:
    """Whether a word, if there is one, is another one, run once or several times."""
    times, rest = divmod(period or 0, of)
    return bool(word) and not rest and is_rotation(word or "", becomes.partition("/")[0] * times)


def margin(study: Study, orbit: str) -> Values:
    """The largest margin of stable orbits of a notation, at most the distance up to which events
    were looked for; of scenes with ``[margins]``, of which tables are kept."""
    asked = study.file.first.margins
    return {} if asked is None else _largest(study, orbit, "margin", asked.within)


def largest_output(study: Study, orbit: str, name: str) -> Values:
    """The largest mean of an output along stable orbits of a notation; tables are kept.

    Raises InputError if the study has no such output, or no tables.
    """
    file = study.file
    names = [output.name for output in file.first.outputs]
    if name not in names:
        accepted = f"it has {', '.join(names)}" if names else "state it in [output]"
        raise InputError("quantity", f"no output {short_repr(name)} in {study.name}", accepted)
    if "tables" not in file.keep:
        found = f"{study.name} keeps {', '.join(file.keep) or 'nothing'}"
        raise InputError("quantity", found, "add 'tables' to study.keep")
    return _largest(study, orbit, name)


def _largest(study: Study, orbit: str, column: str, most: float = math.inf) -> Values:
    """The largest value in a column of stable physical orbits of a notation, from kept tables."""
    found: Values = {}
    for row in study.branches(notation=orbit):
        where = f"study {study.name}, scene {row['scene']}, {row['branch']}"
        branch = branch_in(study.table(row["scene"], row["branch"]), where)
        values = branch[column][branch.stable & branch.physical]
        if not np.isnan(values).all():
            largest = min(float(np.nanmax(values)), most)
            found[row["scene"]] = max(largest, found.get(row["scene"], -math.inf))
    return found


def count_events(study: Study, label: str) -> Values:
    """How many events with a label there are."""
    query = "SELECT scene, count(*) FROM events WHERE study = ? AND label = ? GROUP BY scene"
    found = {scene: 0 for (scene,) in _done(study)}
    return found | dict(study.rows(query, [study.number, label]))


QUANTITIES: Mapping[str, Quantity] = {
    "ends": Quantity(ends, "what ends stable {orbit} as {along} falls", True),
    "mechanism": Quantity(mechanism, "mechanism of the transition from {orbit}", True),
    "distance": Quantity(distance, "{along} of PD less {along} of grazing, {orbit}"),
    "bistability": Quantity(bistability, "width in {along} of bistability, at least"),
    "energy": Quantity(energy, "largest mean voltage per time (V)"),
    "bound": Quantity(
        bound, "{along} of the transition less {along} of the ghost grazing, {orbit}"
    ),
    "margin": Quantity(margin, "largest margin of stable {orbit} along {parameter}"),
}
COUNT, OUTPUT = "count:", "output:"


def quantity_of(name: str) -> Quantity:
    """Return a quantity by its name; ``count:LABEL`` counts events, ``output:NAME`` is the largest
    mean of an output.

    Raises InputError if there is none of this name.
    """
    if name.startswith(COUNT):
        label = name.removeprefix(COUNT)
        return Quantity(lambda study, orbit: count_events(study, label), f"number of {label}")
    if name.startswith(OUTPUT):
        output = name.removeprefix(OUTPUT)
        text = f"largest {output} of stable {{orbit}} along {{parameter}}"
        return Quantity(lambda study, orbit: largest_output(study, orbit, output), text)
    require_known(name, QUANTITIES, "quantity", more=f", {COUNT}LABEL and {OUTPUT}NAME")
    return QUANTITIES[name]


def _value(study: Study) -> str:
    return "e.derived" if study.derived else "e.value"


def _main_events(study: Study, orbit: str) -> Iterator[tuple[int, Main, list[Any]]]:
    """The main stable orbit of each scene, and the events on its branch: branch, name, kind, value,
    arclength, whether it is a ghost, and the word and the period of the orbit at the other side."""
    mains = main_orbits(study, orbit)
    rows = study.rows(
        f"SELECT scene, branch, event, kind, {_value(study)}, arclength, ghost, becomes, period"
        " FROM events e WHERE study = ? AND notation = ? ORDER BY scene",
        [study.number, orbit],
    )
    for scene, events in itertools.groupby(rows, key=lambda row: row[0]):
        if (main := mains.get(scene)) is not None:
            yield int(scene), main, [row[1:] for row in events if row[1] == main.branch]


def shortfall(study: Study) -> str:
    """Return in words how many scenes of a study have failed, ended early or are not computed;
    empty if none."""
    query = "SELECT status, count(*) FROM scenes WHERE study = ? GROUP BY status"
    counts = dict(study.rows(query, [study.number]))
    ((total,),) = study.rows("SELECT scenes FROM studies WHERE study = ?", [study.number])
    counts["not computed"] = total - sum(counts.values())
    left = [f"{n} {what}" for what, n in counts.items() if n and what != "done"]
    return f"of {count_text(total, 'scene')}: {', '.join(left)}" if left else ""


def _done(study: Study) -> Iterator[Any]:
    return study.rows(
        "SELECT scene FROM scenes WHERE study = ? AND status = 'done'", [study.number]
    )


# The sweeps of simulated motion that a study has made, one for each of its scenes.


def _sweep(file: StudyFile, values: Sequence[float], rows: Sequence[Mapping[str, Any]]) -> Sweep:
    scene = file.read_scene_at(values)
    simulators = Simulators(scene.model, scene.parameter)
    made = []
    for row in sorted(rows, key=lambda row: row["number"]):
        simulator = simulators.at(row["value"])
        about = Kind(row["kind"]), simulator.parameters, row["notation"], simulator.period
        free = scene.model.autonomous
        attractor = Attractor(*about, row["word"], row["period"], free=free)
        made.append(Row(row["direction"], row["value"], attractor))
    return Sweep(scene.model, scene.parameter, made)


def derived_axis(study: Study) -> Callable[[int, float], float]:
    """Return what gives a followed value in a scene as one of the derived parameter, if there is
    one."""
    if not study.derived:
        return lambda scene, value: value
    file = study.file
    model, names = file.first.model, file.design.names
    kernels = Simulators(model, study.parameter).kernels
    which = model.DERIVED.index(study.derived)
    places = dict(zip(*file.points, strict=True))

    def along(scene: int, value: float) -> float:
        own = dict(zip(names, places[scene].tolist(), strict=True))
        values = {**model.values, **own, study.parameter: value}
        return float(kernels.setup(*values.values()).derived[which])

    return along


ROWS = ("scenes", *(name for name in OF_SCENES if name not in ("coordinates", "catalogues")))
"""The tables whose rows belong to scenes, which a `Study` gives by these names."""
KEYS = {"events": "event", "branches": "branch", "curves": "curve"}
"""Names within scenes by which rows are put in order: e2 before e10."""
WHOLE = "content"
"""The column of what is kept whole, compressed; it is no column of a selection."""


@explain_arguments
class Study(NotebookResult):
    """A study in a store, read lazily.

    Parameters
    ----------
    store : str or Path
    name : str, optional
        The study's; it can be left out where the store holds one alone.
    systems : sequence of str or Path
        Python files that define its system or kinds of events, as for `load_study`.

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

    def __init__(
        self, store: str | Path, name: str | None = None, systems: Sequence[str | Path] = ()
    ) -> None:
        self.path, self.systems = Path(store), tuple(map(str, systems))
        self.connection = _open_reader(self.path)
        row = self._row(name)
        self.number, self.name, self.source, record, axes, self.parameter, self.derived = row[:7]
        self.total: int = row[7]
        self.axes = tuple(axes.split())
        self.given: Mapping[str, Any] = json.loads(record)

    @functools.cached_property
    def file(self) -> StudyFile:
        """The study file, read and validated."""
        return read_study(self.given, self.systems)

    def _row(self, name: str | None) -> Any:
        columns = "study, name, source, record, axes, parameter, derived, scenes"
        query = f"SELECT {columns} FROM studies WHERE :name IS NULL OR name = :name"
        found = list(self.rows(query, {"name": name}))
        if len(found) == 1:
            return found[0]
        names = ", ".join(repr(known) for known in studies(self.path))
        self.connection.close()
        what = (
            f"no study {name!r}"
            if name is not None
            else f"{count_text(len(found), 'study', 'studies')}"
        )
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
        return f"<Study {self.name} over {axes}: {len(self)} of {count_text(self.total, 'scene')}>"

    def __reduce__(self) -> tuple[Any, ...]:
        """The store is opened again, not sent along."""
        return Study, (str(self.path), self.name, self.systems)

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
        require_known(table, ROWS, "table")
        chosen = Selection(self, table, where)
        for name in where:
            require_known(name, chosen.columns, table, f"no column {name!r}")
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
            accepted = f"add {kept!r} to study.keep"
            if kept in self.given["study"].get("keep", ()):
                accepted = f"give a scene from 0 to {self.total - 1} that is finished"
                accepted += f", and one of its {table}" if name else ""
            raise InputError(f"study {self.name}", what, accepted)
        return decompress_text(found[0][0])

    def sweeps(self) -> list[Sweep]:
        """Return the sweeps of simulated motion, for `plot_transitions`, in the scenes' order.

        Scenes without attractors have none. Attractors say what they are and where, by kind, word,
        period and notation; the impacts are not kept in a store.

        Raises
        ------
        InputError
            If the study does not keep attractors.
        """
        file = self.file
        if "attractors" not in file.keep:
            found = f"it keeps {', '.join(file.keep) or 'nothing'}"
            raise InputError(f"study {self.name}", found, "add 'attractors' to study.keep")
        rows: dict[int, list[Mapping[str, Any]]] = {}
        for row in self.attractors():
            rows.setdefault(row["scene"], []).append(row)
        places = dict(zip(*file.points, strict=True))
        return [_sweep(file, places[number], found) for number, found in sorted(rows.items())]

    def map(
        self,
        quantity: str,
        axes: Sequence[str] | None = None,
        orbit: str = "1:1",
        at: Mapping[str, float] | None = None,
    ) -> Map:
        """Return a quantity over two axes.

        Parameters
        ----------
        quantity : str
            ``ends``, ``mechanism``, ``distance``, ``bistability``, ``energy``, ``bound``,
            ``margin``, ``count:LABEL`` or ``output:NAME``; see `contimpact.studies.study`.
        axes : (str, str), optional
            The first two of the study by default.
        orbit : str
            The notation of the orbit it is asked of.
        at : mapping of str to float, optional
            Values of the study's other axes, if any has several: the nearest there is.

        Raises
        ------
        InputError
            If there is no such quantity or axis, or another axis is left open or has no value near.
        """
        which, chosen = quantity_of(quantity), _axes(self, axes)
        at, only = dict(at or {}), _only_values(self, chosen)
        places, at = _scenes_at(self, chosen, only | at)
        known = which.values(self, orbit)
        empty = None if which.named else np.nan
        values = [known.get(scene, empty) for scene in places]
        values = [empty if v is None else v for v in values]
        x, y = np.array(list(places.values())).reshape(-1, 2).T
        falling, parameter = self.derived or self.parameter, self.parameter
        said = which.text.format(orbit=orbit, along=falling, parameter=parameter)
        kind: Any = object if which.named else float
        column = np.array(values, dtype=kind)
        curves = codimension_two(self, chosen, orbit, at)
        at = {name: value for name, value in at.items() if name not in only}
        return Map(self.name, quantity, said, chosen, x, y, column, which.named, curves, at)


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
            quoted = name.replace("'", "''")
            joins += (
                f" LEFT JOIN coordinates x{k} ON x{k}.study = t.study AND x{k}.scene = t.scene"
                f" AND x{k}.name = '{quoted}'"
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

    Raises InputError if there is no such store, or no study in it.
    """
    with contextlib.closing(_open_reader(Path(store))) as connection:
        found = [name for (name,) in connection.execute("SELECT name FROM studies ORDER BY study")]
    if not found:
        accepted = "give a store into which contimpact study has computed"
        raise InputError(str(store), "no study in it", accepted)
    return found


def _open_reader(path: Path) -> sqlite3.Connection:
    """A connection for reading; a store of an older schema is brought up to date first."""
    try:
        connection = open_store(path, readonly=True)
    except sqlite3.Error as error:
        raise refusal(path, error) from None
    if schema_version(connection) == len(STEPS):
        return connection
    connection.close()
    Store(path).connection.close()
    return open_store(path, readonly=True)


def _array(values: list[Any], kind: str) -> Array:
    """A column of the store: whole numbers if none is missing, numbers, or texts."""
    if kind == "INTEGER" and None not in values:
        return np.array(values, dtype=np.int64)
    if kind in ("INTEGER", "REAL"):
        return np.array([np.nan if v is None else v for v in values], dtype=float)
    return np.array(values, dtype=object)


def file_stem(text: str) -> str:
    """Return what a file about a study is called, without its ending."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in text)


# Maps of a study: a quantity over two of its axes, with curves of codimension two over it.

NEAR = 1e-9
"""Values of an axis that differ by less, of their size, are the same."""
SPARSE = 5
"""Points of which there is one to more places than that of a grid are no grid."""


@dataclass(frozen=True, eq=False)
class Map:
    """A quantity over two axes."""

    study: str
    quantity: str
    text: str
    """`study`, `quantity`, `text`: of what, which, and what is said of it."""
    axes: tuple[str, str]
    x: Array
    y: Array
    """`x`, `y`: shape (points,)."""
    values: Array
    """Numbers, NaN where there is none; or names, None where there is none, shape (points,)."""
    named: bool
    """Whether the values are names."""
    curves: Mapping[str, Array] = field(default_factory=dict)
    """Points of codimension two that studies of the same store have found, by kind, shape (n,
    2)."""
    at: Mapping[str, float] = field(default_factory=dict)
    """Values of those other axes that have several."""

    @property
    def title(self) -> str:
        """The study, and where the map is."""
        return ", ".join([self.study, *(f"{name} = {v:.6g}" for name, v in self.at.items())])

    @property
    def stem(self) -> str:
        """What its files are called, without their endings."""
        return file_stem(f"{self.study}-{self.quantity}")

    def grid(self, values: Array | None = None) -> tuple[Array, Array, Array] | None:
        """Return the values (or numbers that stand for them) on x and y as a table with a row for
        each y; None if the points are no grid, of which a part may be missing."""
        values = self.values if values is None else values
        xs, ys = np.unique(self.x), np.unique(self.y)
        if len(xs) * len(ys) > SPARSE * len(self.x):
            return None
        empty = None if values.dtype == object else np.nan
        table = np.full((len(ys), len(xs)), empty, values.dtype)
        table[np.searchsorted(ys, self.y), np.searchsorted(xs, self.x)] = values
        return xs, ys, table

    def zeros(self) -> Array:
        """Return where the values change sign along y, interpolated linearly, shape (n, 2).

        Raises InputError if the points are no grid, or the values names.
        """
        grid = None if self.named else self.grid()
        if grid is None:
            found = "names" if self.named else "points that are no grid"
            raise InputError(f"map {self.quantity}", found, "give numbers over a grid")
        xs, ys, table = grid
        found_at = []
        for x, column in zip(xs, table.T, strict=True):
            for k in np.flatnonzero(column[:-1] * column[1:] < 0.0):
                part = column[k] / (column[k] - column[k + 1])
                found_at.append([x, ys[k] + part * (ys[k + 1] - ys[k])])
        return np.array(found_at).reshape(-1, 2)

    def departure(self, kind: str) -> float | None:
        """Return how far, in y, `zeros` are at most from the points of codimension two of a kind.

        These are joined by straight lines; None where they pass no zero.
        """
        zeros, points = self.zeros(), self.curves.get(kind, np.zeros((0, 2)))
        if not len(points):
            return None
        inside = (zeros[:, 0] >= points[0, 0]) & (zeros[:, 0] <= points[-1, 0])
        x, y = zeros[inside].T
        return float(np.max(np.abs(y - np.interp(x, *points.T)))) if len(x) else None


def _axes(study: Study, axes: Sequence[str] | None) -> tuple[str, str]:
    x, y = (*(axes or study.axes[:2]), "", "")[:2]
    for name in (x, y):
        if name not in study.axes or x == y:
            accepted = f"give two of {', '.join(study.axes)}"
            raise InputError("axes", f"found {x!r} and {y!r}", accepted)
    return x, y


def _only_values(study: Study, axes: tuple[str, str]) -> dict[str, float]:
    """The values of those other axes that have only one."""
    columns = study.scenes().arrays()
    each = {name: {*columns[name].tolist()} for name in study.axes if name not in axes}
    return {name: values.pop() for name, values in each.items() if len(values) == 1}


def _scenes_at(
    study: Study, axes: tuple[str, str], at: Mapping[str, float]
) -> tuple[dict[int, tuple[float, float]], dict[str, float]]:
    """The finished scenes at the values of the other axes that are nearest to some, with their
    places, and these values."""
    for name in (*at, *study.axes):
        if name not in study.axes or (name in at) == (name in axes):
            open_ = ", ".join(a for a in study.axes if a not in axes)
            found = f"found {name!r}" if name in at else f"found nothing for {name!r}"
            accepted = f"give values of {open_}" if open_ else "the map is over all axes"
            raise InputError("at", found, accepted)
    taken = {}
    columns = study.scenes().arrays()
    keep = np.ones(len(columns["scene"]), dtype=bool)
    for name, value in at.items() if len(columns["scene"]) else ():
        low, high = columns[name].min(), columns[name].max()
        if not low - NEAR * abs(low) <= value <= high + NEAR * abs(high):
            raise InputError(f"at {name}", f"found {value:g}", f"give {low:g} to {high:g}")
        taken[name] = nearest = float(columns[name][np.abs(columns[name] - value).argmin()])
        keep &= np.abs(columns[name] - nearest) <= NEAR * max(abs(nearest), NEAR)
    places = zip(*(columns[name][keep].tolist() for name in axes), strict=True)
    return dict(zip(columns["scene"][keep].tolist(), places, strict=True)), taken


def codimension_two(
    study: Study, axes: tuple[str, str], orbit: str, at: Mapping[str, float]
) -> dict[str, Array]:
    """Return the points of codimension two over two axes that any study of the store has found, by
    kind.

    A point counts if it is of the same system, and of the same values of all parameters but the
    axes and the followed one.
    """
    found: dict[str, list[list[float]]] = {}
    free, own = {*axes, study.parameter}, _study_parameters(study.given) | dict(at)
    for number, other in _other_studies(study):
        query = (
            "SELECT scene, kind, first, first_value, second, second_value"
            " FROM codimension_two WHERE study = ? AND notation = ?"
        )
        for scene, kind, first, one, second, two in study.rows(query, [number, orbit]):
            placed = other | _coordinates(study, number, scene) | {first: one, second: two}
            agree = all(own.get(n) == placed.get(n) for n in {*own, *placed} - free)
            if agree and {*axes} <= {*placed}:
                found.setdefault(kind, []).append([placed[name] for name in axes])
    return {kind: np.array(sorted(points)) for kind, points in found.items()}


def _other_studies(study: Study) -> Iterator[tuple[int, dict[str, float]]]:
    """The studies of the same system that may have such points, with their fixed parameters."""
    system = _system(study.given)
    for number, record in study.rows("SELECT study, record FROM studies"):
        given = json.loads(record)
        if _system(given) == system:
            yield number, _study_parameters(given)


def _system(given: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in given["model"].items() if key != "parameters"}


def _study_parameters(given: Mapping[str, Any]) -> dict[str, float]:
    """The parameters that a study gives all its scenes."""
    parameters = given["model"].get("parameters", {})
    return {
        n: expressions.number(v, n) if isinstance(v, str) else float(v)
        for n, v in parameters.items()
    }


def _coordinates(study: Study, number: int, scene: int) -> dict[str, float]:
    query = "SELECT name, value FROM coordinates WHERE study = ? AND scene = ?"
    return dict(study.rows(query, [number, scene]))
