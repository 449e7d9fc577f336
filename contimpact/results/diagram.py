"""A diagram: all branches and events of a scene, and the limits that its computation reached."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from ..display import NotebookResult, Summary, frame, limit_lines
from ..errors import InputError, short_repr
from .branch import Branch, Entry, event_by_kind, kinds_of

if TYPE_CHECKING:
    from ..models.model import Model
    from ..orbits.orbit import Orbit
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
        counts = f"{len(self.branches)} branches, {len(self.entries)} events"
        curves = f", {len(self.curves)} curves" if self.curves else ""
        return f"Diagram {self.name}: {counts}{curves}"

    def __repr__(self) -> str:
        curves = [_curve_line(c) for c in self._all_curves]
        rows = [_branch_line(b) for b in self.branches] + curves
        return limit_lines(self._head(), rows)


def _branch_line(branch: Branch) -> str:
    values = branch[branch.parameter]
    return (
        f"  {branch.id:4} {branch.notation:9} {branch.parameter} from {values.min():.6g} to "
        f"{values.max():.6g}: {_list_events(branch)}"
    )


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
