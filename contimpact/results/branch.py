"""Entries of events and branches of orbits as data, and orbits recovered from them."""

from __future__ import annotations

import dataclasses
import operator
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np

from ..arrays import Array
from ..bifurcations.declarations import SYNONYMS
from ..bifurcations.kind import Scenario, kind_of, subclasses_of
from ..bifurcations.requested import PERIOD
from ..continuation.branch import End, EndKind, same_place
from ..display import NotebookResult, ParameterItems, Summary, frame, limit_lines
from ..errors import InputError, count_text, did_you_mean, printable, require_known, short_repr
from ..models.guards import Word, name_orbit
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..orbits.problem import Linearisation, OrbitProblem
from ..orbits.quiet import problem_of
from ..orbits.search import search_for
from ..schema import attribute, documented, table_columns
from ..segments.kernels import Kernels
from ..systems import find_system


def same_data(one: Any, other: Any) -> bool:
    """Whether two tables, or what they hold, are the same to the bit; nan is the same as nan."""
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == other.dtype.kind == "f")
    if isinstance(one, float) and isinstance(other, float):
        return one == other or (one != one and other != other)
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return list(one) == list(other) and all(same_data(one[k], other[k]) for k in one)
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(same_data, one, other))
    if dataclasses.is_dataclass(one) and type(one) is type(other):
        names = [f.name for f in dataclasses.fields(one) if f.compare]
        return all(same_data(getattr(one, n), getattr(other, n)) for n in names)
    return bool(one == other)


class Columns(NotebookResult):
    """Points as named columns: what branches and curves have in common."""

    id: str
    columns: Mapping[str, Array]

    @overload
    def __getitem__(self, column: str) -> Array: ...
    @overload
    def __getitem__(self, column: slice | Array) -> dict[str, Array]: ...

    def __getitem__(self, column: str | slice | Array) -> Array | dict[str, Array]:
        """Return a column; with a slice, or an array such as `stable`, these rows of all."""
        if isinstance(column, slice | np.ndarray):
            return {name: values[column] for name, values in self.columns.items()}
        if isinstance(column, str) and column in self.columns:
            return self.columns[column]
        name = f"{type(self).__name__.lower()} {self.id}"
        hint = self._instead(column) or did_you_mean(str(column), self.columns).strip(" ()")
        known = f"{hint}; it has {', '.join(self.columns)}".removeprefix("; ")
        raise KeyError(f"{name} has no column {short_repr(column)}; {known}")

    def _instead(self, column: object) -> str:
        """What gives that which is no column, in words."""
        return ""

    def _head_of(self, what: str, parameter: str) -> str:
        """What it is, with how many points there are, and where, by a parameter."""
        values, name = self[parameter], type(self).__name__
        return (
            f"{name} {self.id}: {what}, {count_text(len(self), 'point')}, "
            f"{parameter} from {values.min():.9g} to {values.max():.9g}"
        )

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.columns)

    @property
    def name(self) -> str:
        """The same as `id`."""
        return self.id

    @property
    def parameter_columns(self) -> list[str]:
        """Names of all parameters that have a column, derived ones included."""
        names = list(self.columns)
        return names[names.index("arclength") + 1 : first_unknown(names)]

    def __len__(self) -> int:
        return len(self.columns["arclength"])

    def __eq__(self, other: object) -> bool:
        return same_data(self, other) if type(self) is type(other) else NotImplemented

    __hash__ = None  # type: ignore[assignment]

    def to_dataframe(self) -> Any:
        """Return the columns as a pandas DataFrame; pandas must be installed."""
        return frame(self.columns)


def all_parameters(here: Linearisation) -> dict[str, float]:
    """Return every parameter and derived parameter at a point, by name."""
    problem = here.problem
    values = problem.values(here.unknowns)
    return dict(zip(problem.model.values, values, strict=True)) | dict(here.derived)


def columns_of(walls: str, m: int) -> list[str]:
    """Return the names of the columns of an orbit's unknowns."""
    if not walls:
        return [f"{n}{i}_0" for i in range(m // 2) for n in ("x", "v")]
    return [f"{name}{k}" for k in range(1, len(walls) + 1) for name in coordinates(m)]


def first_unknown(names: Sequence[str]) -> int:
    """Return the place of the first column of an orbit's unknowns."""
    return next(i for i, name in enumerate(names) if name in ("t1", "x0_0"))


def coordinates(m: int) -> list[str]:
    """Return the names of an impact's time and section coordinates."""
    return ["t", "v", *(f"{n}{i}_" for i in range(1, m // 2) for n in ("x", "v"))]


def event_by_kind(events: Sequence[Entry], name: object) -> Entry | None:
    """Return the event that a kind's name leads to: ``PD`` where there is one, else ``PD1``, ..."""
    parts = re.fullmatch(r"([A-Z]+)(\d*)", name) if isinstance(name, str) else None
    if parts is None:
        return None
    found = [event for event in events if event.kind == parts[1]]
    if not parts[2]:
        return found[0] if len(found) == 1 else None
    return found[int(parts[2]) - 1] if 0 < int(parts[2]) <= len(found) else None


def kinds_of(events: Sequence[Entry], name: object) -> str:
    """Return the names that the events of a kind have, in words; empty if there are none."""
    kind = name.rstrip("0123456789") if isinstance(name, str) else ""
    count = sum(event.kind == kind for event in events)
    if count:
        return f", and {kind}1 to {kind}{count}" if count > 1 else f", and {kind}"
    return f"; {SYNONYMS[kind]}" if kind in SYNONYMS else ""


# From recorded numbers back to orbits: rows of tables, entries of catalogues, their files.
#
# A record holds the system's name, its options and all parameters, the word and its impacts. With
# the system's formulas that is an orbit again; that it solves them is checked.

SOLVED = 1e-6
"""A larger residual, beside the sizes of what is compared, belongs to another model."""

OF_ENTRY = 1e-3
"""Parts of multipliers by which they differ from an entry's where the orbit is another one: at a
fold they are known to the root of rounding."""


def orbit_of(entry: Entry, model: Model | None = None, kernels: Kernels | None = None) -> Orbit:
    """Return the orbit a catalogue entry records, by default of the system that it names; kernels
    are the model's, with the entry's parameter free, and perhaps a second one.

    Raises InputError if the entry is damaged, or of another model.
    """
    at = model_of(entry, model)
    kernels = kernels or Kernels(at, entry.parameter)
    problem = problem_of(at, Word(entry.word, entry.period), kernels)
    if not entry.word:
        return _without_impacts(entry, problem)
    names = ["time", "velocity", *coordinates(problem.m)[2:]]
    whole = [impact for impact in entry.impacts if set(names) <= set(impact)]
    if len(whole) != len(entry.word):
        found = f"{len(whole)} impacts of the word {entry.word!r}"
        raise InputError("entry", found, "give an entry as a catalogue records it")
    rows = np.array([[impact[name] for name in names] for impact in whole])
    rows = _closing_impacts(problem, rows, entry.orbit_period, "entry")
    return _solve_orbit(problem, rows, "entry")


def orbit_at(
    branch: Branch, place: int | str, model: Model | None = None, kernels: Kernels | None = None
) -> Orbit:
    """Return the orbit of a row of a branch; see `Branch.orbit`. Kernels of the branch's parameter
    serve all rows."""
    where = f"branch {branch.id}"
    if isinstance(place, str):
        return orbit_of(branch.entry(place), model)
    row = _row(branch, place, where)
    at = model_at(branch, row, model)
    word = Word(branch.word, branch.period)
    problem = problem_of(at, word, kernels or Kernels(at, branch.parameter))
    return _solve_orbit(problem, impacts_at(branch, row, problem), where)


def impacts_at(branch: Branch, row: int, problem: OrbitProblem) -> Array:
    """Return the impacts of a row of a branch, in the clock of the unknowns."""
    unknowns = [branch[name][row] for name in columns_of(branch.word, problem.m)]
    rows = np.reshape(unknowns, (-1, problem.m))
    period = branch[PERIOD][row] if PERIOD in branch.columns else None
    return _closing_impacts(problem, rows, period, f"branch {branch.id}")


def _closing_impacts(problem: OrbitProblem, rows: Array, period: float | None, where: str) -> Array:
    """The impacts of a record in the clock of the unknowns."""
    if not problem.autonomous:
        return rows
    if period is None:
        raise InputError(where, "it has no period", "give what a catalogue records")
    if not problem.word.walls:  # it stands in the place of a velocity that is zero
        rows[0, 1] = period
        return rows
    return problem.placed(rows, period)


def _without_impacts(entry: Entry, problem: OrbitProblem) -> Orbit:
    """The orbit of the word `0` in an entry's state; of an older entry, which has none, one that is
    found by search and has its multipliers."""
    if entry.state is not None:
        if len(entry.state) != problem.m:
            raise InputError("entry", f"a state of {len(entry.state)} numbers", f"give {problem.m}")
        return _solve_orbit(problem, np.array(entry.state, dtype=float), "entry")
    told = np.array([np.inf if pair is None else complex(*pair) for pair in entry.multipliers])
    apart = {
        float(np.max(np.abs(orbit.multipliers - told) / (1.0 + np.abs(told)))): orbit
        for orbit in search_for(problem).orbits
    }
    if not (apart and min(apart) < OF_ENTRY):
        accepted = "compute it anew, which records its state, or give the model of the entry"
        raise InputError(
            "entry", "no orbit without impacts was found that has its multipliers", accepted
        )
    return apart[min(apart)]


def _row(branch: Branch, place: int, where: str) -> int:
    """The number of a row, counted from the end if it is negative."""
    accepted = f"give a row from 0 to {len(branch) - 1}, or the name of an event"
    try:
        row = operator.index(place)
    except TypeError:
        raise InputError(where, f"found {short_repr(place)}", accepted) from None
    if not -len(branch) <= row < len(branch):
        raise InputError(where, f"no row {row}", accepted)
    return row


def _solve_orbit(problem: OrbitProblem, rows: Array, where: str) -> Orbit:
    """The orbit of these impacts at the model's parameters, if it solves the equations."""
    free = [problem.model.values[name] for name in problem.kernels.parameters]
    here = problem.evaluate(np.append(rows.ravel(), free))
    orbit = Orbit(problem, here)
    for sizes in (problem.natural_units, lambda z: problem.scale(z, 1.0)):
        residual = float(
            np.max(np.abs(here.residual) / problem.residual_sizes(sizes(here.unknowns)))
        )
        if residual < SOLVED:  # by the impacts alone, or by the flights where all are at rest
            return orbit
    if not _rests(orbit):
        found = f"it is no orbit of this model (relative residual {residual:.2g})"
        raise InputError(where, found, "give the model it was computed with")
    return orbit


def _rests(orbit: Orbit) -> bool:
    """Whether an orbit without impacts is an equilibrium, but for rounding: its state is rounding
    beside its distance from the guards."""
    if orbit.word.walls:
        return False
    size = orbit.problem.natural_units(orbit.unknowns)[0]
    return bool(size < np.finfo(float).eps * abs(orbit.smallest_gap))


def orbit_with(model: Model, word: tuple[str, int], parameter: str, unknowns: Array) -> Orbit:
    """Return the orbit of a word, its walls and its period, that has these unknowns."""
    problem = problem_of(model, Word(*word), Kernels(model, parameter))
    if len(unknowns) != problem.n + 1:
        found = f"{len(unknowns)} unknowns of the word {problem.word}"
        raise InputError("orbit", found, f"give {problem.n + 1}")
    return _solve_orbit(problem, unknowns[:-1].reshape(-1, problem.m), "orbit")


# The system of a record.


def model_by_name(record: Mapping[str, Any], given: Model | None = None) -> Model:
    """Return the given model, or the one a record names, at the record's parameter values."""
    options, parameters = dict(record["options"]), dict(record["parameters"])
    return _model(str(record["system"]), options, parameters, given, "the file")


def model_of(entry: Entry, given: Model | None = None) -> Model:
    """Return the given model, or the one an entry names, at the entry's parameter values.

    Raises InputError if its system is not known, or another one than the given.
    """
    return _model(entry.system, entry.options, entry.parameters, given, "entry")


def model_at(branch: Branch, row: int, given: Model | None = None) -> Model:
    """Return the given model, or the one a branch names, at a row's parameter values.

    Raises InputError if its system is not known, or another one than the given.
    """
    parameters = {name: float(branch[name][row]) for name in branch.parameters}
    return _model(branch.system, branch.options, parameters, given, f"branch {branch.id}")


def _model(
    name: str | None,
    options: Mapping[str, str],
    parameters: Mapping[str, float],
    given: Model | None,
    where: str,
) -> Model:
    """The given model, or the one of a system by name, at recorded parameter values."""
    if given is None:
        kind = _system(name, where)
        return kind(**options, **{k: v for k, v in parameters.items() if k not in kind.DERIVED})
    if not isinstance(given, Model):
        raise InputError(
            "model", f"found {short_repr(given)}", "give a model, such as ImpactPair(...)"
        )
    if missing := [own for own in given.values if own not in parameters]:
        accepted = f"give a model with {', '.join(parameters)}"
        raise InputError(where, f"it has no parameter {missing[0]!r}", accepted)
    return given.replace(**{own: parameters[own] for own in given.values})


def _system(name: str | None, where: str) -> type[Model]:
    """The class of a system: one of the package's, or one of the user's that is imported."""
    accepted = "give the model it was computed with, as model="
    if name is None:
        raise InputError(where, "it does not say of what system it is", accepted)
    known = _classes(name)
    if len(known) != 1:
        found = f"{len(known)} imported classes are the system {name!r}"
        raise InputError(where, found, accepted)
    return known[0]


def find_imported_system(name: str) -> type[Model] | None:
    """Return the class of a system by its name; None if it is not imported, or ambiguous."""
    known = _classes(name)
    return known[0] if len(known) == 1 else None


def _classes(name: str) -> list[type[Model]]:
    if (kind := find_system(name)) is not None:
        return [kind]
    # a class that is defined again, as in a notebook, replaces the earlier one
    own = {
        (k.__module__, k.__qualname__): k
        for k in subclasses_of(Model)
        if getattr(k, "SYSTEM", None) == name
    }
    return list(own.values())


# An event on a branch, as the catalogue records it.


def column(doc: str) -> Any:
    """Return a field that is a key of a record and a column of a table."""
    return attribute(doc, column=True)


def end_record(end: End, **more: float) -> dict[str, Any]:
    """Return an end as catalogues record it."""
    named = {"kind": end.kind.name.lower(), "parameter": end.value}
    return {**named, **more, "message": end.message}


STATES = {"positions": "position", "velocities": "velocity"}
"""Columns of one coordinate in an impact's record."""


@documented
@dataclass(frozen=True)
class Entry(ParameterItems, NotebookResult):
    """An event on a branch, as the catalogue records it; the attributes are its keys."""

    id: str = column("such as `e1`")
    kind: str = column(
        "FB, BP, PD, NS, G, V, T, UZ, CR, or a user's; see [events](mathematics.md#events)"
    )
    ghost: bool = column("whether it is a [ghost](mathematics.md#ghosts-and-labels)")
    label: str = column(
        "such as `PD`, `~PD`, `G[1:1->2:1]`; the tilde marks ghosts, except of UZ and users' events"
    )
    why: str | None = column("why it is a ghost")
    branch: str = column("the branch it lies on")
    word: str = column("of its branch")
    period: int = column("of its branch")
    notation: str = column("of its branch")
    becomes: str | None = column(
        "G, V, and T where sliding vanishes or impacts exchange their order: the word beyond, with "
        "its period if that is not 1"
    )
    order: int | None = column("G: impacts added; several where several flights touch at once")
    criticality: str | None = column(
        "G and PD: [`supercritical` or `subcritical`](mathematics.md#criticality); null where "
        "unknown"
    )
    slope: float | None = column(
        "G: derivative of the new impact's velocity, towards its wall, by the followed parameter; "
        "null where it is infinite to rounding"
    )
    wall: str | None = column("G, V: the wall that is touched")
    flight: int | None = column(
        "G, T: the flight, from 0 (texts and columns count from 1); flight k leaves impact k. V: "
        "the flight that arrives where a lasting contact begins or ends at rest, else null"
    )
    impact: int | None = column(
        "V: the impact, from 0; also of a G where the flight after it begins on a [limit of "
        "sliding](belt.md#sliding-bifurcations) or [without a rate](mathematics.md#physicality)"
    )
    touch_time: float | None = column("G: the time of the touch, in the clock of `impacts`")
    requested: Mapping[str, float] | None = column("UZ: the name and the value asked for")
    parameter: str = column("the followed parameter")
    parameters: Mapping[str, float] = attribute("every parameter and derived parameter")
    impacts: Sequence[Mapping[str, Any]] = attribute(
        "for each impact its `wall`, `time`, and the `velocity` before it; the first time lies "
        "in [0, T). Systems of more degrees of freedom add `positions` and `velocities`, and the "
        "section coordinates `x1_`, `v1_`, …"
    )
    multipliers: Sequence[tuple[float, float] | None] = attribute(
        "pairs of real and imaginary part, largest first; null for an infinite one. At V: of the "
        "orbit without the vanishing impact"
    )
    multipliers_before: Sequence[tuple[float, float] | None] = attribute("at the point before")
    multipliers_after: Sequence[tuple[float, float] | None] = attribute("at the point after")
    n_unstable: int = column("multipliers outside the unit circle, without the event's own")
    stable: bool = column("whether `n_unstable` is 0")
    physical: bool = column(
        "whether the orbit is physical but for the event's own touch or impact, and the branch on "
        "one side at least"
    )
    reason: str | None = column("why it is not physical")
    residual: float = column("largest residual of the equations that the event solves")
    error: float = column(
        "[bound](mathematics.md#error-estimates) of the error of the followed parameter"
    )
    method: str = column("`newton` on the extended system, or `bracket`")
    arclength: float = column("where it lies on its branch")
    tangent: Sequence[float] | None = attribute(
        "of BP alone: the branch's direction, by the time and section coordinates of each impact "
        "in turn and by the parameter; newer",
        None,
    )
    opens: Sequence[str] = attribute("branches born here", (), column=True)
    system: str | None = attribute("the model", None)
    options: Mapping[str, str] = attribute("texts that shape its formulas", {})
    nu: float | None = attribute(
        "of BP alone: [what would unfold the crossing](mathematics.md#jumps-and-near-misses), zero "
        "within its error; newer",
        None,
    )
    nu_error: float | None = attribute("its error; newer", None)
    certified_radius: float | None = attribute(
        "only where the entry is [certified](certificates.md): radius of the proven enclosure of "
        "the followed parameter",
        None,
        silent=True,
    )
    orbit_period: float | None = attribute(
        "the orbit's period, only where it is [free](autonomous.md)", None, silent=True
    )
    state: Sequence[float] | None = attribute(
        "only of the word `0`: positions and velocities at t = 0, in turn; the period stands in "
        "the place of the first velocity where it is free; newer",
        None,
        silent=True,
    )
    sliding: str | None = attribute(
        "only of a [sliding bifurcation](belt.md#sliding-bifurcations): which one",
        None,
        silent=True,
    )
    crisis: Mapping[str, Any] | None = attribute(
        "only of [CR](crises.md), whose orbit is the unstable one: notation of the `attractor`, "
        "and `type`, `after`, `seen`, `lasted`, `leaves`, `homoclinic`, `walls`, `grazing`, "
        "`times`, `velocities` as in [`crises.json`](simulate.md#output); newer",
        None,
        silent=True,
    )
    scenario: Scenario | None = attribute(
        "only of a G that is no ghost: what is [seen beyond](crises.md#beyond-a-grazing), as "
        "`name`, and the `reason` if it is `not decided`; of the normal form the `trace`, "
        "`determinant`, `coefficient` κ and the gap's `rate`, its derivative by the parameter; and "
        "its `windows`, each with `cycles`, `notation`, `low`, `high` (null: no end that is "
        "admitted); newer",
        None,
        silent=True,
    )

    @property
    def times(self) -> Array:
        """Impact times, shape (N,)."""
        return np.array([impact["time"] for impact in self.impacts], dtype=float)

    @property
    def velocities(self) -> Array:
        """Velocities before impact, shape (N,)."""
        return np.array([impact["velocity"] for impact in self.impacts], dtype=float)

    @property
    def value(self) -> float:
        """Value of the followed parameter."""
        return self.parameters[self.parameter]

    def orbit(self, model: Model | None = None) -> Orbit:
        """Return the orbit at the event, to continue it or to look at it.

        Parameters
        ----------
        model : Model, optional
            The system, where its name does not tell: an own one that is not imported. Parameter
            values are taken from the entry.

        Raises
        ------
        InputError
            If the system is not known, or the entry is none of it.
        """

        return orbit_of(self, model)

    def as_row(self) -> dict[str, Any]:
        """Return the entry as a row of a table; impacts and multipliers are spread over columns."""
        row: dict[str, Any] = {name: getattr(self, name) for name in table_columns(Entry)}
        row["opens"] = " ".join(self.opens)
        if self.requested is not None:
            row["requested"] = " ".join(f"{n}={v!r}" for n, v in self.requested.items())
        row |= self.parameters
        if self.orbit_period is not None:
            row["orbit_period"] = self.orbit_period
        for k, impact in enumerate(self.impacts, start=1):
            for name, value in impact.items():
                if isinstance(value, list):  # of every coordinate
                    row |= {f"{STATES[name]}{i}_{k}": x for i, x in enumerate(value, start=1)}
                else:
                    row[f"{name}{k}"] = value
        for k, mu in enumerate(self.multipliers, start=1):
            real, imaginary = mu or (None, None)
            row |= {f"multiplier{k}_re": real, f"multiplier{k}_im": imaginary}
        if self.scenario is not None:
            row["scenario"] = self.scenario.name
        return row

    def to_dataframe(self) -> Any:
        """Return the entry as a pandas DataFrame of one row; pandas must be installed."""
        return frame([self.as_row()])

    def summary(self) -> Summary:
        """Return the entry's orbit in short."""
        columns = ("wall", "time", "velocity before impact")
        rows = [(impact["wall"], impact["time"], impact["velocity"]) for impact in self.impacts]
        error = f"error {self.error:.1g}, {self.method}"
        notes = [
            error,
            *([self.sliding] if self.sliding else []),
            *([f"a ghost: {self.why}"] if self.why else []),
        ]
        return Summary(repr(self)[1:-1], columns, rows, notes)

    def __repr__(self) -> str:
        return printable(f"<{self.label} on {self.branch} at {self.parameter} = {self.value:.12g}>")


STATUS = ("stable", "unstable", "unphysical", "unknown")
"""Status of the orbits of a piece of a branch; the last where two events have no row between."""
UNKNOWN = STATUS.index("unknown")


@documented
@dataclass(frozen=True, eq=False)
class Branch(Columns):
    """A branch of periodic orbits, as a table."""

    id: str = attribute("its name, such as `b1`")
    word: str = attribute("walls in order; empty for the word `0`")
    period: int = attribute("in forcing periods; 0 where the [period is free](autonomous.md)")
    notation: str = attribute("the orbit, as n:m/pT")
    system: str = attribute("the model, by its name")
    options: Mapping[str, str] = attribute("the texts that shape its formulas")
    parameter: str = attribute("the followed parameter")
    columns: Mapping[str, Array] = attribute(
        "one value per point: ``arclength`` (in the branch's metric), every parameter and "
        "derived parameter, ``t1``, ``v1``, ... (impact times and velocities before impact, in the "
        "model's clock), ``multiplier1_re``, ``multiplier1_im``, ..., ``n_unstable``, "
        "``physical``, ``reason``, ``smallest_gap``, ``residual``, ``iterations``, and ``event``: "
        "the name of the entry a row belongs to, empty for other points of the walk. Where the "
        "period is free, it is the column ``period``, and the first impact is at t = 0. "
        '``branch["s"]`` is a shorthand'
    )
    ends: tuple[End, End] = attribute(
        "how it ends at its first and at its last row: [`kind`](mathematics.md#ends), "
        "`parameter` (the followed parameter's value; in earlier files under the parameter's own "
        "name) and `message`",
        write=lambda ends: [end_record(end) for end in ends],
    )
    events: Sequence[Entry] = attribute("in order of arclength", ())
    missed: Sequence[str] = attribute(
        "events that [may be missing](mathematics.md#location), each with place and reason", ()
    )
    origin: str | None = attribute(
        "the entry at which the branch is born; null if a search found its start", None, name="from"
    )
    meetings: Sequence[str] = attribute("further entries at which this branch is born", ())
    notes: Sequence[str] = attribute(
        "[near misses](mathematics.md#jumps-and-near-misses); newer", ()
    )

    def _instead(self, column: object) -> str:
        event = self._event(column)
        if event is not None:
            return f"the orbit of an event is branch.orbit({event.id!r})"
        return f"the orbit of a row is branch.orbit({column})" if isinstance(column, int) else ""

    def _event(self, name: object) -> Entry | None:
        own = (event for event in self.events if event.id == name)
        return next(own, None) or event_by_kind(self.events, name)

    def entry(self, name: str) -> Entry:
        """Return an event by its name, ``e1``, or by that of its kind, ``PD`` or ``PD2``."""
        found = self._event(name)
        if found is None:
            known = ", ".join(entry.id for entry in self.events) or "none"
            known += kinds_of(self.events, name)
            raise InputError(f"branch {self.id}", f"no event {name!r}", f"its events are {known}")
        return found

    def orbit(self, place: int | str | Entry, model: Model | None = None) -> Orbit:
        """Return the orbit of a row, to continue it or to look at it.

        Parameters
        ----------
        place : int, str or Entry
            The number of a row, or one of `events`, or its name.
        model : Model, optional
            The system, where its name does not tell: an own one that is not imported. Parameter
            values are taken from the branch.

        Raises
        ------
        InputError
            If there is no such row or event, or the system is not known.
        """
        return place.orbit(model) if isinstance(place, Entry) else orbit_at(self, place, model)

    @property
    def stable(self) -> Array:
        """Whether no multiplier lies outside the unit circle, point by point."""
        return np.asarray(self["n_unstable"] == 0)

    @property
    def physical(self) -> Array:
        """Whether the orbit is physical, point by point."""
        return np.asarray(self["physical"] == 1)

    @property
    def between(self) -> Array:
        """Whether a row has the status of neither side.

        So it is at an event of the orbits themselves, no crisis, and where the branch is born,
        whose orbit is another branch's.
        """
        crises = [entry.id for entry in self.events if entry.crisis is not None]
        found = (self["event"] != "") & ~np.isin(self["event"].astype(str), crises)
        found[0] |= self.ends[0].kind is EndKind.BORN
        return found

    @property
    def status(self) -> Array:
        """What the orbits from each row to the next one are: places in `STATUS`, one row less.

        They are what both rows are, or one of them where the other has the status of neither side.
        Where it changes between two rows at no event, its place is not known, nor is the status
        between them. Tables hold an orbit between any two events; those of earlier versions may
        not, and there, too, the status is unknown.
        """
        rows = np.where(self.physical, np.where(self.stable, 0, 1), 2)
        neither = self.between
        changes = (rows[:-1] != rows[1:]) & ~neither[:-1] & ~neither[1:]
        found = np.where(changes, UNKNOWN, rows[:-1])
        for i in np.nonzero(neither[:-1])[0][::-1]:
            if not neither[i + 1]:
                found[i] = rows[i + 1]
            elif not self._at_one_place(i):
                found[i] = UNKNOWN
            else:
                found[i] = found[i + 1] if i + 1 < len(found) else rows[i + 1]
        return found

    def _at_one_place(self, row: int) -> bool:
        """Whether a row and the next one are events that their errors do not tell apart."""
        errors, rows = {entry.id: entry.error for entry in self.events}, slice(row, row + 2)
        apart, difference = (np.ptp(self[name][rows]) for name in ("arclength", self.parameter))
        error = sum(errors.get(name, 0.0) for name in self["event"][rows])
        return same_place(float(apart), float(difference), error)

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters, derived ones included."""
        return self.parameter_columns

    @property
    def constant(self) -> list[str]:
        """Names of the parameters, derived ones included, that do not vary along the branch."""
        return [n for n in self.parameters if n != self.parameter and np.ptp(self[n]) == 0.0]

    @property
    def velocities(self) -> Array:
        """Velocities before impact, shape (points, N)."""
        return self._impacts("v")

    @property
    def times(self) -> Array:
        """Impact times, shape (points, N)."""
        return self._impacts("t")

    def _impacts(self, name: str) -> Array:
        """The columns of a coordinate of all impacts."""
        columns = [self[f"{name}{k + 1}"] for k in range(len(self.word))]
        return np.column_stack(columns) if columns else np.zeros((len(self), 0))

    @property
    def multipliers(self) -> Array:
        """Multipliers, shape (points, m), complex."""
        count = sum(name.endswith("_re") for name in self.columns)
        return np.column_stack(
            [
                self[f"multiplier{k}_re"] + 1j * self[f"multiplier{k}_im"]
                for k in range(1, count + 1)
            ]
        )

    def summary(self) -> Summary:
        """Return the branch's events and ends in short."""
        columns = ("", "event", self.parameter, "error", "why a ghost", "opens")
        rows = [
            (e.id, e.label, e.value, f"{e.error:.1g}", e.why, " ".join(e.opens))
            for e in self.events
        ]
        start, end = (end.message for end in self.ends)
        return Summary(self._head(), columns, rows, [f"start: {start}; end: {end}", *self._said()])

    def _head(self) -> str:
        return self._head_of(name_orbit(self.notation, self.word), self.parameter)

    def _said(self) -> list[str]:
        """What could not be located, and further remarks."""
        missed = [f"not located: {text}" for text in self.missed]
        return missed + [f"note: {text}" for text in self.notes]

    def __repr__(self) -> str:
        events = [
            f"  {e.label:16} {e.parameter} = {e.value:.15g} +- {e.error:.1g}" for e in self.events
        ]
        said = [f"  {text}" for text in self._said()]
        if len(said) > 3:
            said[2:] = [f"  ... and {len(said) - 2} more remarks"]
        start, end = f"  start: {self.ends[0].message}", f"  end:   {self.ends[1].message}"
        return limit_lines(self._head(), events, [end, *said], ahead=[start])


def require_axis(branches: Sequence[Branch], x: str, where: str, found: str) -> None:
    """Raise `InputError` for a parameter that varies along none of some branches, and, as found,
    for what is none."""
    names = branches[0].parameters
    varying = [name for name in names if any(name not in branch.constant for branch in branches)]
    if x in names:
        found = f"{x} does not vary along the branches"
    require_known(x, ["arclength", *varying], where, found)


def constant_parameters(branches: Sequence[Branch], derived: Sequence[str]) -> list[str]:
    """Return the parameters that are constant along every branch, derived ones left out."""
    if not branches:
        return []
    return [
        name
        for name in branches[0].constant
        if name not in derived and all(name in branch.constant for branch in branches)
    ]


def shared_parameters(branches: Sequence[Branch], derived: Sequence[str]) -> dict[str, float]:
    """Return the constant parameters that all branches share."""
    shared = {}
    for name in constant_parameters(branches, derived):
        values = {float(branch[name][0]) for branch in branches}
        if len(values) == 1:
            shared[name] = values.pop()
    return shared


DETAILS = ("flight", "wall", "impact", "touch_time", "requested")
"""Details of an event that an entry keeps."""


def details_of(entry: Entry) -> dict[str, Any]:
    """Return where on its orbit an entry's event happens, in the clock of its unknowns.

    Raises InputError if the entry does not say.
    """
    kept = {name: getattr(entry, name) for name in DETAILS}
    details = {name: value for name, value in kept.items() if value is not None}
    if lacking := [name for name in kind_of(entry.kind).needed if name not in details]:
        found = f"it has no {lacking[0]}"
        raise InputError("entry", found, "give an entry as a catalogue records it")
    if entry.word and entry.orbit_period is not None and "touch_time" in details:
        details["touch_time"] -= entry.orbit_period
    return details
