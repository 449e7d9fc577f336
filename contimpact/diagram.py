"""Results as data: branches as tables, entries of the catalogue, the diagram of both."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from .continuation.branch import End
from .errors import InputError, printable, shown
from .mechanics.orbit import Linearisation

if TYPE_CHECKING:
    from .mechanics.model import Model
    from .mechanics.search import Orbit
    from .two_parameters.curves import Curve
    from .two_parameters.runs import Check

Array = np.ndarray[Any, Any]


LABELLED = ("FB", "BP", "PD", "NS", "G", "V", "T")
"""Kinds of events that can be ghosts by name; requested values and users' events are not marked."""


@dataclass(frozen=True)
class Entry:
    """An event on a branch, as the catalogue records it; the attributes are its keys.

    Attributes
    ----------
    id, branch : str
        Its own name and its branch's.
    kind : str
        FB, BP, PD, NS, G, V, T, UZ, or a user's name.
    label : str
        As in Table 1 of the paper: ``PD``, ``~PD``, ``G[1:1->2:1]``.
    ghost : bool
        Whether the orbit that carries it is unstable or unphysical for another reason than the
        event; `n_unstable`, `stable`, `physical` and `reason` likewise leave the event out.
    word, period, notation
        The orbit.
    why : str or None
        Why it is a ghost.
    becomes : str or None
        The word beyond a grazing or a zero velocity, with its period.
    order : int or None
        For G, how many impacts are added.
    criticality : str or None
        ``supercritical`` or ``subcritical``, for G and PD, where it can be told.
    slope : float or None
        For G, the derivative of the new impact's velocity, towards its wall, by the parameter.
    flight, impact, wall, touch_time
        Where it happens, as far as that applies.
    requested : mapping or None
        For UZ, the name and value asked for.
    parameters : mapping of str to float
        All parameters and derived parameters.
    impacts : sequence of mappings
        Wall, time, velocity (and other section coordinates) of each impact; the first time is in
        [0, T).
    multipliers : sequence of (real, imaginary)
        None in the place of an infinite multiplier.
    multipliers_before, multipliers_after
        The same at the neighbouring points of the branch.
    residual, error : float
        Of the equations it was located with; a bound of the error of the followed parameter.
    method : str
        ``newton`` on the extended system, or ``bracket``.
    arclength : float
        Where it lies on its branch.
    tangent : sequence of float or None
        For BP, the branch's direction: by the time and section coordinates of each impact in turn,
        and by the parameter.
    opens : sequence of str
        Branches that start here.
    system, options
        The model, and the texts that shape its formulas; None and empty where a catalogue of an
        earlier version does not say.
    nu, nu_error : float or None
        For BP, what would unfold the crossing of branches, zero within its estimated error.
    """

    id: str
    kind: str
    ghost: bool
    label: str
    why: str | None
    branch: str
    word: str
    period: int
    notation: str
    becomes: str | None
    order: int | None
    criticality: str | None
    slope: float | None
    wall: str | None
    flight: int | None
    impact: int | None
    touch_time: float | None
    requested: Mapping[str, float] | None
    parameter: str
    parameters: Mapping[str, float]
    impacts: Sequence[Mapping[str, Any]]
    multipliers: Sequence[tuple[float, float] | None]
    multipliers_before: Sequence[tuple[float, float] | None]
    multipliers_after: Sequence[tuple[float, float] | None]
    n_unstable: int
    stable: bool
    physical: bool
    reason: str | None
    residual: float
    error: float
    method: str
    arclength: float
    tangent: Sequence[float] | None = None
    opens: Sequence[str] = ()
    system: str | None = None
    options: Mapping[str, str] = field(default_factory=dict)
    nu: float | None = None
    nu_error: float | None = None

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
        from .recovery import orbit_of

        return orbit_of(self, model)

    def __repr__(self) -> str:
        return printable(f"<{self.label} on {self.branch} at {self.parameter} = {self.value:.12g}>")


@dataclass(frozen=True, eq=False)
class Branch:
    """A branch of periodic orbits, as a table.

    Attributes
    ----------
    id : str
    word, period, notation
        The orbits on it.
    system, options
        The model, and the texts that shape its formulas.
    parameter : str
        The followed parameter.
    columns : mapping of str to ndarray
        One value per point: ``arclength`` (in the branch's metric), every parameter and derived
        parameter, ``t1``, ``v1``, ... (impact times and velocities before impact, in the model's
        clock), ``multiplier1_re``, ``multiplier1_im``, ..., ``n_unstable``, ``physical``,
        ``reason``, ``smallest_gap``, ``residual``, ``iterations``, and ``event``: the name of the
        entry a row belongs to, empty for the points of the walk. ``branch["s"]`` is a shorthand.
    ends : (End, End)
        How it ends, at its first and at its last point.
    events : sequence of Entry
        In order of arclength.
    missed : sequence of str
        Sign changes of test functions that could not be located.
    origin : str or None
        The entry it starts from.
    meetings : sequence of str
        Further entries from which switching led to this branch.
    notes : sequence of str
        What else is to be known of it: where another branch passes it closely without meeting it.
    """

    id: str
    word: str
    period: int
    notation: str
    system: str
    options: Mapping[str, str]
    parameter: str
    columns: Mapping[str, Array]
    ends: tuple[End, End]
    events: Sequence[Entry] = ()
    missed: Sequence[str] = ()
    origin: str | None = None
    meetings: Sequence[str] = ()
    notes: Sequence[str] = ()

    def __getitem__(self, column: str) -> Array:
        return self.columns[column]

    def __len__(self) -> int:
        return len(self.columns["arclength"])

    def __eq__(self, other: object) -> bool:
        return same_data(self, other) if isinstance(other, Branch) else NotImplemented

    __hash__ = None  # type: ignore[assignment]

    def orbit(self, place: int | str, model: Model | None = None) -> Orbit:
        """Return the orbit of a row, to continue it or to look at it.

        Parameters
        ----------
        place : int or str
            The number of a row, or the name of one of `events`.
        model : Model, optional
            The system, where its name does not tell: an own one that is not imported. Parameter
            values are taken from the branch.

        Raises
        ------
        InputError
            If there is no such row or event, or the system is not known.
        """
        from .recovery import orbit_at

        return orbit_at(self, place, model)

    @property
    def stable(self) -> Array:
        """Whether no multiplier lies outside the unit circle, point by point."""
        return np.asarray(self["n_unstable"] == 0)

    @property
    def physical(self) -> Array:
        """Whether the orbit is physical, point by point."""
        return np.asarray(self["physical"] == 1)

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters, derived ones included."""
        names = list(self.columns)
        return names[names.index("arclength") + 1 : names.index("t1")]

    @property
    def constant(self) -> list[str]:
        """Names of the parameters, derived ones included, that do not vary along the branch."""
        return [n for n in self.parameters if n != self.parameter and np.ptp(self[n]) == 0.0]

    @property
    def velocities(self) -> Array:
        """Velocities before impact, shape (points, N)."""
        return np.column_stack([self[f"v{k + 1}"] for k in range(len(self.word))])

    @property
    def times(self) -> Array:
        """Impact times, shape (points, N)."""
        return np.column_stack([self[f"t{k + 1}"] for k in range(len(self.word))])

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

    def to_dataframe(self) -> Any:
        """Return the columns as a pandas DataFrame; pandas must be installed."""
        import pandas

        return pandas.DataFrame(dict(self.columns))

    def __repr__(self) -> str:
        values = self[self.parameter]
        lines = [
            f"Branch {self.id}: {self.notation} ({self.word}), {len(self)} points, "
            f"{self.parameter} from {values.min():.9g} to {values.max():.9g}",
            f"  start: {self.ends[0].message}",
            *(
                f"  {e.label:16} {e.parameter} = {e.value:.15g} +- {e.error:.1g}"
                for e in self.events
            ),
            f"  end:   {self.ends[1].message}",
            *(f"  not located: {text}" for text in self.missed),
            *(f"  note: {text}" for text in self.notes),
        ]
        return "\n".join(map(printable, lines))


@dataclass(frozen=True)
class Diagram:
    """All branches of a scene, with what it cost to compute them.

    Attributes
    ----------
    name : str
        The scene's.
    branches : sequence of Branch
    curves : sequence of Curve
        Of bifurcations in two parameters.
    checks : sequence of Check
        One-parameter runs against which the order of the curves was checked.
    statistics : mapping
        Seconds per stage, counts, kernels loaded and generated.
    """

    name: str
    branches: Sequence[Branch]
    curves: Sequence[Curve] = ()
    checks: Sequence[Check] = ()
    statistics: Mapping[str, Any] = field(default_factory=dict, compare=False)

    @property
    def entries(self) -> list[Entry]:
        """The events of all branches."""
        return [entry for branch in self.branches for entry in branch.events]

    def __getitem__(self, name: str) -> Branch | Curve | Entry:
        """Return a branch, a curve or an entry by its name: ``b1``, ``c1``, ``e1``."""
        kept: list[Branch | Curve | Entry] = [*self.branches, *self.curves, *self.entries]
        for one in kept:
            if one.id == name:
                return one
        groups = (self.branches, self.curves, self.entries)
        known = [_span([one.id for one in group]) for group in groups if group]
        raise InputError(
            f"diagram {self.name}", f"nothing is called {shown(name)}",
            f"there are {', '.join(known) or 'no branches'}",
        )  # fmt: skip

    def entry(self, name: str) -> Entry:
        """Return an entry by its name."""
        found = self[name]
        if not isinstance(found, Entry):
            accepted = "give the name of an entry, such as 'e1'; a row is branch.orbit(row)"
            raise InputError(f"diagram {self.name}", f"{name} has many orbits", accepted)
        return found

    def orbit(self, name: str, model: Model | None = None) -> Orbit:
        """Return the orbit of an entry by its name; see `Entry.orbit`."""
        return self.entry(name).orbit(model)

    def __repr__(self) -> str:
        rows = [_branch_line(b) for b in self.branches] + [_curve_line(c) for c in self.curves]
        if len(rows) > SHOWN:
            rows[SHOWN - 1 :] = [f"  ... and {len(rows) - SHOWN + 1} more"]
        counts = f"{len(self.branches)} branches, {len(self.entries)} events"
        curves = f", {len(self.curves)} curves" if self.curves else ""
        lines = [f"Diagram {self.name}: {counts}{curves}", *rows]
        return "\n".join(map(printable, lines))


SHOWN = 9
"""Lines of a diagram's branches and curves that are shown."""


def _branch_line(branch: Branch) -> str:
    values = branch[branch.parameter]
    events = ", ".join(f"{e.id} {e.label}" for e in branch.events) or "no events"
    if len(events) > 60:
        events = f"{len(branch.events)} events, {_span([e.id for e in branch.events])}"
    missed = f"; {len(branch.missed)} not located" if branch.missed else ""
    return (
        f"  {branch.id:4} {branch.notation:9} {branch.parameter} from {values.min():.6g} to "
        f"{values.max():.6g}: {events}{missed}"
    )


def _span(names: Sequence[str]) -> str:
    """The first and the last of some names."""
    return names[0] if len(names) == 1 else f"{names[0]} to {names[-1]}"


def _curve_line(curve: Curve) -> str:
    first, second = curve.parameters
    low, high = curve[second].min(), curve[second].max()
    return f"  {curve.id:4} {curve.label} in {first}; {second} from {low:.6g} to {high:.6g}"


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


def all_parameters(here: Linearisation) -> dict[str, float]:
    """Return every parameter and derived parameter at a point, by name."""
    problem = here.problem
    values = problem.values(here.unknowns)
    return dict(zip(problem.model.values, values, strict=True)) | dict(here.derived)


def coordinates(m: int) -> list[str]:
    """Return the names of an impact's time and section coordinates."""
    return ["t", "v", *(f"{n}{i}_" for i in range(1, m // 2) for n in ("x", "v"))]
