"""A diagram: branches and events of a scene, limits reached, and how entries are made of walks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from ..arrays import Array
from ..bifurcations.kind import kind_of
from ..bifurcations.requested import PERIOD
from ..continuation.branch import Event, Point, Points
from ..continuation.corrector import first_tangent
from ..display import NotebookResult, Summary, frame, limit_lines
from ..errors import InputError, count_text, short_repr
from ..models.guards import state_before
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..orbits.problem import Linearisation, OrbitProblem
from ..orbits.problem import Summary as PointSummary
from ..orbits.status import PHYSICAL, Verdict, count_unstable, reason_of
from ..segments.kernels import Kernels
from ..storage import logger
from .branch import (
    Branch,
    Entry,
    all_parameters,
    columns_of,
    coordinates,
    details_of,
    event_by_kind,
    kinds_of,
    orbit_of,
)

if TYPE_CHECKING:
    from .curve import Area, Check, Coverage, Curve
    from .diagram_reading import Reading


# Limits of a scene that cut its computation short: which, and what was left out for them.

LISTED = 12
"""Names that a sentence lists at most; the record has all of them."""


@dataclass(frozen=True)
class Limit:
    """A limit that cut something off."""

    key: str
    """Key of the scene, such as ``follow.max_branches``; a larger value goes further, or true."""
    value: int | bool
    what: str
    """What was left out, in words: orbits not followed, events not switched at, ..."""
    left_out: Sequence[tuple[str, int]]
    """How many of each were left out, by name."""

    def __str__(self) -> str:
        names = [f"{n} ({count})" if count > 1 else n for n, count in self.left_out[:LISTED]]
        more = sum(count for _, count in self.left_out[LISTED:])
        listed = ", ".join(names) + (f", and {more} more" if more else "")
        if isinstance(self.value, bool):
            value, other = (str(one).lower() for one in (self.value, not self.value))
            return f"{self.key} = {value}; {self.what}: {listed}; {other} includes them"
        return f"{self.key} = {self.value} was reached; {self.what}: {listed}; raise it to go on"


@dataclass
class Limits:
    """The limits that were reached, as a computation meets them."""

    found: dict[tuple[str, int, str], Counter[str]] = field(default_factory=dict)

    def reached(self, key: str, value: int, what: str, name: str) -> None:
        """Record something that a limit left out."""
        self.found.setdefault((key, value, what), Counter())[name] += 1

    def listed(self) -> list[Limit]:
        """Return the limits reached, in the order in which they were met."""
        return [Limit(*about, list(names.items())) for about, names in self.found.items()]


@dataclass(frozen=True)
class Diagram(NotebookResult):
    """All branches of a scene, with what it cost to compute them.

    Attributes
    ----------
    name : str
        The scene's.
    branches : sequence of Branch
    curves : sequence of Curve
        Of bifurcations in two parameters.
    codim2_curves : sequence of Curve
        Of points of codimension two, in three parameters.
    coverage : sequence of Coverage
        What lines across the map of curves say of its completeness.
    areas : sequence of Area
        Of two parameters, by what ends the stable orbits.
    checks : sequence of Check
        One-parameter runs against which the order of the curves was checked.
    statistics : mapping
        Seconds per stage, counts, kernels loaded and generated.
    survey : {"none", "cut short", "orbits", "done", "unknown"}
        Whether orbits were looked for across the range, as a scene's ``follow.survey`` asks.
    limits : sequence of Limit
        Limits of the scene that were reached, and what was left out for them.
    """

    name: str
    branches: Sequence[Branch]
    curves: Sequence[Curve] = ()
    checks: Sequence[Check] = ()
    statistics: Mapping[str, Any] = field(default_factory=dict, compare=False)
    codim2_curves: Sequence[Curve] = ()
    coverage: Sequence[Coverage] = ()
    areas: Sequence[Area] = ()
    survey: str = "none"
    limits: Sequence[Limit] = ()

    @property
    def entries(self) -> list[Entry]:
        """The events of all branches."""
        return [entry for branch in self.branches for entry in branch.events]

    @property
    def events(self) -> list[Entry]:
        """The same as `entries`, by the name that branches have for theirs."""
        return self.entries

    def view(self, **options: Any) -> Any:
        """Return the page of the diagram for a notebook; see `contimpact.view`."""
        from .. import view

        return view(self, **options)

    @overload
    def __getitem__(self, name: str) -> Branch | Curve | Entry: ...
    @overload
    def __getitem__(self, name: int) -> Branch: ...
    @overload
    def __getitem__(self, name: slice) -> Sequence[Branch]: ...

    def __getitem__(self, name: str | int | slice) -> Branch | Curve | Entry | Sequence[Branch]:
        """Return a branch, a curve or an entry by its name: ``b1``, ``c1``, ``e1``.

        A number or a slice is of the branches.

        Entries also have their kind's name where there is one of the kind, ``PD``, and its
        number among those of the kind otherwise, ``PD2``.
        """
        if isinstance(name, int | slice):
            return self.branches[name]
        found = [one for one in self._named if one.id == name]
        if not found:
            of_kind = event_by_kind(self.entries, name)
            found = [of_kind] if of_kind is not None else []
        if len(found) == 1:
            return found[0]
        if found:
            own = [f"{one.id} of {one.branch}" for one in found if isinstance(one, Entry)]
            accepted = f"take it from its branch: diagram['b1'].events; there are {', '.join(own)}"
            where = f"diagram {self.name}"
            raise InputError(where, f"{len(found)} are called {short_repr(name)}", accepted)
        groups = (self.branches, self.curves, self.codim2_curves, self.entries)
        known = [_span([one.id for one in group]) for group in groups if group]
        accepted = f"there are {', '.join(known) or 'no branches'}{kinds_of(self.entries, name)}"
        raise InputError(f"diagram {self.name}", f"nothing is called {short_repr(name)}", accepted)

    def _ipython_key_completions_(self) -> list[str]:
        return [one.id for one in self._named]

    def entry(self, name: str) -> Entry:
        """Return an entry by its name."""
        found = self[name]
        if not isinstance(found, Entry):
            accepted = "give the name of an entry, such as 'e1'; a row is branch.orbit(row)"
            raise InputError(f"diagram {self.name}", f"{name} has many orbits", accepted)
        return found

    def orbit(self, name: str | Entry, model: Model | None = None) -> Orbit:
        """Return the orbit of an entry, or of that of a name; see `Entry.orbit`."""
        return (name if isinstance(name, Entry) else self.entry(name)).orbit(model)

    def at(self, values: Mapping[str, float]) -> Diagram:
        """Return the diagram without the branches that are elsewhere, as at another angle.

        Parameters
        ----------
        values : mapping of str to float
            Of parameters. A branch along which one of them keeps another value is left out.

        Returns
        -------
        Diagram
        """
        own = [
            branch
            for branch in self.branches
            if all(
                branch[name][0] == values[name] for name in {*values}.intersection(branch.constant)
            )
        ]
        return replace(self, branches=own)

    @property
    def reading(self) -> Reading:
        """What the diagram says: where orbits are stable, and the transitions between them."""
        from .diagram_reading import read

        return read(self)

    def __iter__(self) -> Iterator[Branch]:
        return iter(self.branches)

    def __len__(self) -> int:
        return len(self.branches)

    def __bool__(self) -> bool:
        return True

    def __contains__(self, one: object) -> bool:
        """Whether there is something of this name, or this branch, curve or entry."""
        return any(one in (kept, kept.id) for kept in self._named)

    def to_dataframe(self, what: str = "points") -> Any:
        """Return a table of the diagram as a pandas DataFrame; pandas must be installed.

        Parameters
        ----------
        what : {"points", "events"}
            A row for each point, with the name of its branch and the notation of its orbits, or a
            row for each event, as in ``events.csv``.
        """
        if what == "events":
            return frame([entry.as_row() for entry in self.entries])
        if what != "points":
            raise InputError("what", f"found {short_repr(what)}", "accepted are 'points', 'events'")
        names = dict.fromkeys(name for branch in self.branches for name in branch.columns)
        columns: dict[str, Any] = {
            name: [getattr(b, name_of) for b in self.branches for _ in range(len(b))]
            for name, name_of in (("branch", "id"), ("notation", "notation"))
        }
        for name in names:
            parts = [b.columns.get(name, np.full(len(b), np.nan)) for b in self.branches]
            columns[name] = np.concatenate(parts)
        return frame(columns)

    def summary(self) -> Summary:
        """Return the diagram's branches and their events in short."""
        rows = []
        for b in self.branches:
            low, high = float(b[b.parameter].min()), float(b[b.parameter].max())
            rows.append((b.id, b.notation, len(b), low, high, b.origin, _list_events(b)))
        columns = ("", "orbits", "points", "from", "to", "born at", "events")
        curves = [_curve_line(c).strip() for c in self._all_curves]
        return Summary(self._head(), columns, rows, [*curves, *map(str, self.limits)])

    @property
    def _named(self) -> list[Branch | Curve | Entry]:
        return [*self.branches, *self._all_curves, *self.entries]

    @property
    def _all_curves(self) -> list[Curve]:
        return [*self.curves, *self.codim2_curves]

    def _head(self) -> str:
        branches = count_text(len(self.branches), "branch", "branches")
        counts = f"{branches}, {count_text(len(self.entries), 'event')}"
        curves = f", {count_text(len(self.curves), 'curve')}" if self.curves else ""
        return f"Diagram {self.name}: {counts}{curves}"

    def __repr__(self) -> str:
        rows = [
            f"  {b.id:4} {b.notation:9} {b.parameter} from {b[b.parameter].min():.6g} to "
            f"{b[b.parameter].max():.6g}: {_list_events(b)}"
            for b in self.branches
        ]
        return limit_lines(self._head(), rows + [_curve_line(c) for c in self._all_curves])


def with_statistics(diagram: Diagram, notes: Iterable[str] = (), **more: Any) -> Diagram:
    """Return a diagram with further notes, and other statistics in the place of those it has."""
    known = diagram.statistics
    notes = [*known.get("notes", ()), *notes]
    return replace(diagram, statistics={**known, "notes": notes, **more})


def _list_events(branch: Branch) -> str:
    """A branch's events in a line."""
    events = ", ".join(f"{e.id} {e.label}" for e in branch.events) or "no events"
    if len(events) > 60:
        events = f"{len(branch.events)} events, {_span([e.id for e in branch.events])}"
    return events + (f"; {len(branch.missed)} not located" if branch.missed else "")


def _span(names: Sequence[str]) -> str:
    """The first and the last of some names."""
    return names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"


def _curve_line(curve: Curve) -> str:
    *others, last = curve.parameters
    low, high = curve[last].min(), curve[last].max()
    name = f"{curve.id:4} {curve.label} in {', '.join(others)}"
    return f"  {name}; {last} from {low:.6g} to {high:.6g}"


# What ends a computation early.

INTERRUPTED = "interrupted"
"""Reason of a computation that the keyboard ended early."""
ENDING = KeyboardInterrupt, Exception
"""What ends a computation early; what was computed until then is kept."""
NUMERICAL = ArithmeticError, np.linalg.LinAlgError


def failure_of(error: BaseException, kept: Sequence[Any]) -> str:
    """Return what is said of a computation that one of `ENDING` has ended.

    Input that cannot be used, and a package that is missing, are raised again unless something is
    kept. Of other errors but numerical failures the traceback is logged.
    """
    if isinstance(error, KeyboardInterrupt):
        return INTERRUPTED
    if isinstance(error, (InputError, ImportError)):
        if not kept:
            raise error
        return f"the computation failed ({error})"
    if not isinstance(error, NUMERICAL):
        logger(__name__).error("this error is not expected; please report it", exc_info=error)
    return f"the computation failed ({type(error).__name__}: {error})"


# From points and events of a walk to entries and given orbits.
#
# An event is a ghost when the orbit that carries it is unstable, or unphysical, for a reason other
# than the event itself: of its multipliers the critical one is left out, of its gaps the touch.


def entry_of(event: Event, identity: str, branch: str, before: Point, after: Point) -> Entry:
    """Return the catalogue entry of an event, given the branch's points around it."""
    here: Linearisation = event.point.evaluation
    kind, problem = kind_of(event.kind), here.problem
    word, details = problem.word, event.details
    letters = problem.model.letters
    becomes = kind.next_word(event)
    added = 0 if becomes is None else len(becomes) - len(word)
    beside = before.evaluation, after.evaluation
    multipliers, n_unstable = kind.multipliers(here, details, beside)
    verdict = kind.verdict_on_branch(here, details, beside)
    ghost = n_unstable > 0 or not verdict.physical
    side, slope = kind.criticality(event, before, after)
    return Entry(
        id=identity,
        kind=event.kind,
        ghost=ghost,
        label=kind.label(ghost, word, becomes, letters),
        why=_ghost_reason(n_unstable, verdict),
        branch=branch,
        word=word.walls,
        period=word.period,
        notation=word.notation(letters),
        becomes=None if becomes is None else str(becomes),
        order=added if added > 0 else None,
        criticality=side,
        slope=slope,
        wall=details.get("wall"),
        flight=details.get("flight"),
        impact=details.get("impact"),
        touch_time=_shift_time(problem, here.unknowns, details.get("touch_time")),
        requested=details.get("requested"),
        parameter=problem.parameter,
        parameters=all_parameters(here),
        impacts=impacts_of(problem, here.unknowns),
        multipliers=pairs_of(multipliers),
        multipliers_before=pairs_of(before.evaluation.multipliers),
        multipliers_after=pairs_of(after.evaluation.multipliers),
        n_unstable=n_unstable,
        stable=n_unstable == 0,
        physical=verdict.physical,
        reason=verdict.reason,
        residual=event.residual,
        error=event.error,
        method=event.method,
        arclength=event.point.arclength,
        tangent=event.point.tangent.tolist() if kind.crossing else None,
        system=problem.model.SYSTEM,
        options=problem.model.options,
        nu=details.get("nu"),
        nu_error=details.get("nu_error"),
        **orbit_record(here),
        sliding=kind.sliding(event),
        scenario=None if ghost else kind.scenario(event),
    )


def in_own_clock(entry: Entry, event: Event) -> Entry:
    """Return the entry of an event with the times in its reason those of its impacts, no longer
    those of the branch's table."""
    here: Linearisation = event.point.evaluation
    problem, details = here.problem, event.details
    late = -_shift_time(problem, here.unknowns, 0.0) if problem.word.walls else 0.0
    if entry.reason is None or late == 0.0 or problem.autonomous:
        return entry
    unknowns, touch = here.unknowns.copy(), details.get("touch_time")
    unknowns[: problem.n : problem.m] -= late
    moved = details if touch is None else {**details, "touch_time": touch - late}
    verdict = kind_of(event.kind).verdict_on_branch(problem.evaluate(unknowns), moved)
    if verdict.reason is None:
        return entry
    why = _ghost_reason(entry.n_unstable, verdict)
    return replace(entry, reason=verdict.reason, why=why)


def orbit_record(here: Linearisation) -> dict[str, Any]:
    """Return what restores an orbit besides its impacts: its period where that is free, and without
    impacts its state."""
    problem = here.problem
    return {
        "orbit_period": here.span if problem.autonomous else None,
        "state": None if problem.word.walls else here.unknowns[: problem.m].tolist(),
    }


def event_of(entry: Entry, model: Model | None = None, kernels: Kernels | None = None) -> Event:
    """Return the event a catalogue entry records, to switch at it; see `branch.orbit_of`.

    Raises InputError if the entry is damaged, or of another model.
    """
    orbit = orbit_of(entry, model, kernels)
    problem = orbit.problem
    details = details_of(entry)
    here, recorded = orbit.linearisation, entry.tangent
    tangent = recorded or first_tangent(problem, here.jacobian, here.sizes[1])
    along = np.zeros(problem.n + 1) if tangent is None else np.array(tangent)
    point = Point(here, along, 0.0, entry.arclength, 0)
    return Event(entry.kind, point, entry.residual, entry.error, entry.method, details)


def pairs_of(multipliers: Array) -> list[tuple[float, float] | None]:
    """Return multipliers as an entry records them."""
    return [(m.real, m.imag) if np.isfinite(m) else None for m in multipliers.tolist()]


def _ghost_reason(n_unstable: int, verdict: Verdict) -> str | None:
    """Why an event is a ghost, or None."""
    reasons = []
    if n_unstable:
        reasons.append(f"unstable: {n_unstable} multiplier{'s' * (n_unstable > 1)} outside")
    if verdict.reason:
        reasons.append(f"unphysical: {verdict.reason}")
    return "; ".join(reasons) or None


def impacts_of(problem: OrbitProblem, unknowns: Array) -> list[dict[str, Any]]:
    """Return the impacts as records, the first one's time in [0, T), see `EARLY`."""
    names = ["time", "velocity", *coordinates(problem.m)[2:]]
    rows = problem.impacts(unknowns).tolist()
    for row in rows:
        row[0] = _shift_time(problem, unknowns, row[0])
    return [
        {"wall": wall} | dict(zip(names, row, strict=True)) | states
        for wall, row, states in zip(
            problem.word.walls, rows, _states(problem, unknowns), strict=True
        )
    ]


def _states(problem: OrbitProblem, unknowns: Array) -> list[dict[str, list[float]]]:
    """All positions and velocities before each impact, where there are several."""
    size = problem.model.DEGREES_OF_FREEDOM
    if size == 1:
        return [{}] * len(problem.word)
    setup = problem.kernels.setup(*problem.values(unknowns))
    guards = {
        g.name: (g.row(size), x) for g, x in zip(problem.model.WALLS, setup.walls, strict=True)
    }
    rows = problem.impacts(unknowns)[:, 1:].tolist()
    return [
        dict(zip(("positions", "velocities"), state_before(*guards[wall], row), strict=True))
        for wall, row in zip(problem.word.walls, rows, strict=True)
    ]


EARLY = 1e-12
"""Part of the period by which the first impact may come before 0: rounding does not decide whether
an impact at the forcing's phase 0 is recorded at 0 or at T."""


def _shift_time(problem: OrbitProblem, unknowns: Array, time: Any) -> Any:
    """A time in the clock in which the first impact comes in [0, T), see `EARLY`."""
    if time is None:
        return None
    period = problem.period(unknowns)
    first, _ = problem.times_around(unknowns, 0)
    return time - float(np.floor(first / period + EARLY)) * period


# What a user gave to be followed, as an orbit.

FOLLOWED = (
    "give an orbit of find_orbits, an entry, branch.orbit(row), or diagram.orbit('e5') by its name"
)


def to_diagram(given: object) -> Diagram:
    """Return the diagram meant by a diagram, a branch, or several branches.

    Raises InputError for anything else.
    """
    if isinstance(given, Diagram):
        return given
    branches = [given] if isinstance(given, Branch) else given
    if isinstance(branches, list | tuple) and all(isinstance(one, Branch) for one in branches):
        return Diagram(", ".join(dict.fromkeys(one.notation for one in branches)), branches)
    raise InputError(
        "diagram", _found_text(given), "give a diagram, a branch, or a list of branches"
    )


def entry_by_name(given: object) -> object:
    """Return the entry that a pair (branch or diagram, name) means, and anything else as it is."""
    if not (isinstance(given, tuple) and len(given) == 2 and isinstance(given[1], str)):
        return given
    holder, name = given
    return holder.entry(name) if isinstance(holder, Branch | Diagram) else given


def to_orbit(given: object, model: Model | None = None) -> Orbit:
    """Return the orbit meant by an orbit, an entry, an event, a point, or a pair (branch, row).

    Raises InputError for anything else, or where the record and the model do not fit.
    """
    if isinstance(given, Orbit):
        return given
    if isinstance(given, Entry):
        return given.orbit(model)
    if isinstance(given, tuple) and len(given) == 2 and isinstance(given[0], Branch):
        return given[0].orbit(given[1], model)
    point = given.point if isinstance(given, Event) else given
    here = point.evaluation if isinstance(point, Point) else None
    if isinstance(here, Linearisation):
        return Orbit(here.problem, here)
    raise InputError("orbit", _found_text(given), FOLLOWED)


def _found_text(given: object) -> str:
    """What was given in the place of an orbit, in words."""
    if isinstance(given, Branch):
        return f"found the branch {given.id}, which has {len(given)} orbits"
    if isinstance(given, Diagram):
        return f"found the diagram {given.name}"
    if isinstance(given, list | tuple) and any(isinstance(item, Orbit) for item in given):
        return f"found a list of {len(given)}, not one of its orbits"
    return f"found {short_repr(given)}"


def entry_first(entry: Any, model: Any) -> tuple[Any, Any]:
    """Return an entry and its model, which may have been given the other way round."""
    return (model, entry) if isinstance(entry, Model) else (entry, model)


# From the points of a branch and its entries to the columns of its table.


def tabulate(
    points: Points, entries: Sequence[tuple[Point, Entry]], borrowed: Sequence[float] = ()
) -> dict[str, Array]:
    """Return the columns of a branch: a row per point, and one for each event between points.

    `entries` are in order of arclength. The rows of events, or of the points they lie on, have the
    verdicts of the first entry there, which leave the event itself out. `borrowed` has the
    arclengths of points at which rounding would decide: their rows have the verdicts of the next
    one, the last of the one before.
    """
    places = points.arclengths
    between: list[Point] = []
    on_events = np.nonzero(np.isin(places, [point.arclength for point, _ in entries]))[0]
    rows = dict(zip(places[on_events].tolist(), on_events.tolist(), strict=True))
    marked: dict[int, Entry] = {}
    for point, entry in entries:
        if point.arclength not in rows:
            rows[point.arclength] = len(points) + len(between)
            between.append(point)
        marked.setdefault(rows[point.arclength], entry)
    columns = _columns(Points([*points.pieces, *between]))
    columns["event"] = np.full(len(columns["arclength"]), "", dtype=object)
    for row, entry in marked.items():
        columns["n_unstable"][row] = entry.n_unstable
        columns["physical"][row] = int(entry.physical)
        columns["reason"][row] = entry.reason or ""
        columns["event"][row] = entry.id
        if entry.impact in points[0].evaluation.problem.excursions and entry.flight is None:
            # of the orbit without the excursion that vanishes: with it they have no digits there
            for k, pair in enumerate(entry.multipliers, start=1):
                real, imaginary = pair or (np.inf, 0.0)
                columns[f"multiplier{k}_re"][row] = real
                columns[f"multiplier{k}_im"][row] = imaginary
    order = np.argsort(columns["arclength"], kind="stable")
    for name in columns:  # one after the other: a long branch is not held twice
        columns[name] = columns[name][order]
    rounding = np.isin(columns["arclength"], borrowed) & (columns["event"] == "")
    for place in np.nonzero(rounding)[0].tolist():
        beside = place + 1 if place + 1 < len(order) else place - 1
        for name in ("n_unstable", "physical", "reason"):
            columns[name][place] = columns[name][beside]
    return columns


def _columns(points: Points) -> dict[str, Array]:
    """A row per point, in the points' order."""
    problem = points[0].evaluation.problem
    unknowns = points.unknowns
    columns = {"arclength": points.arclengths, **_parameters(problem, unknowns[:, -1])}
    for name, column in zip(columns_of(problem.word.walls, problem.m), unknowns.T, strict=False):
        columns[name] = column.copy()
    if problem.autonomous:
        columns |= _clock_columns(problem, columns, unknowns)
    summary = PointSummary.of(points.numbers)
    factors, findings = summary.multipliers, summary.findings
    for k, factor in enumerate(factors.T, start=1):
        columns |= {f"multiplier{k}_re": factor.real, f"multiplier{k}_im": factor.imag}
    columns["n_unstable"] = count_unstable(factors)
    physical = findings[:, 0] == PHYSICAL
    columns["physical"] = physical.astype(np.int64)
    word, named = problem.word.walls, problem.model.WALLS
    reasons = columns["reason"] = np.full(len(findings), "", dtype=object)
    first = -columns[PERIOD] if problem.autonomous and word else np.zeros(len(findings))
    for row in np.nonzero(~physical)[0]:
        reasons[row] = reason_of(findings[row].tolist(), word, named, first[row]) or ""
    columns["smallest_gap"] = findings[:, -1].copy()
    columns["residual"] = summary.largest_residual.copy()
    columns["iterations"] = points.iterations
    return columns


def _clock_columns(
    problem: OrbitProblem, columns: Mapping[str, Array], unknowns: Array
) -> dict[str, Array]:
    """The columns of free periods, and of times since the first passage."""
    if not problem.word.walls:
        return {"v0_0": np.zeros(len(unknowns)), PERIOD: columns["v0_0"]}
    times = [f"t{k}" for k in range(1, len(problem.word) + 1)]
    moved = {name: columns[name] - columns["t1"] for name in times}
    return {**moved, PERIOD: -columns["t1"]}


def _parameters(problem: OrbitProblem, free: Array) -> dict[str, Array]:
    """The columns of the parameters and derived parameters, given the followed one's."""
    values = {name: np.full(len(free), value) for name, value in problem.model.values.items()}
    values[problem.parameter] = free.copy()
    derived = np.empty((len(problem.model.DERIVED), len(free)))
    for row in range(len(free)):
        derived[:, row] = problem.derived_at(problem.values(free[row : row + 1]))
    return values | dict(zip(problem.model.DERIVED, derived, strict=True))
