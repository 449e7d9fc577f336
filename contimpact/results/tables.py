"""What tables and records of orbits have in common: names of columns, equality."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, TypeVar, overload

import numpy as np

from ..arrays import Array
from ..bifurcations.declarations import SYNONYMS
from ..display import NotebookResult, frame
from ..errors import did_you_mean, short_repr
from ..orbits.problem import Linearisation


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
    def __getitem__(self, column: slice) -> dict[str, Array]: ...

    def __getitem__(self, column: str | slice) -> Array | dict[str, Array]:
        """Return a column; with a slice, these rows of all columns."""
        if isinstance(column, slice):
            return {name: values[column] for name, values in self.columns.items()}
        if column in self.columns:
            return self.columns[column]
        name = f"{type(self).__name__.lower()} {self.id}"
        hint = self._instead(column) or did_you_mean(str(column), self.columns).strip(" ()")
        known = f"{hint}; it has {', '.join(self.columns)}".removeprefix("; ")
        raise KeyError(f"{name} has no column {short_repr(column)}; {known}")

    def _instead(self, column: object) -> str:
        """What gives that which is no column, in words."""
        return ""

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.columns)

    @property
    def name(self) -> str:
        """The same as `id`."""
        return self.id

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


class NamedEvent(Protocol):
    """An event with its name and its kind."""

    @property
    def id(self) -> str: ...
    @property
    def kind(self) -> str: ...


Event = TypeVar("Event", bound=NamedEvent)


def event_by_id(events: Sequence[Event], name: object) -> Event | None:
    """Return the event of a name, such as ``e1``; None if there is none."""
    return next((event for event in events if event.id == name), None)


def event_by_kind(events: Sequence[Event], name: object) -> Event | None:
    """Return the event that a kind's name leads to: ``PD`` where there is one, else ``PD1``, ..."""
    parts = re.fullmatch(r"([A-Z]+)(\d*)", name) if isinstance(name, str) else None
    if parts is None:
        return None
    found = [event for event in events if event.kind == parts[1]]
    if not parts[2]:
        return found[0] if len(found) == 1 else None
    return found[int(parts[2]) - 1] if 0 < int(parts[2]) <= len(found) else None


def kinds_of(events: Sequence[NamedEvent], name: object) -> str:
    """Return the names that the events of a kind have, in words; empty if there are none."""
    kind = name.rstrip("0123456789") if isinstance(name, str) else ""
    count = sum(event.kind == kind for event in events)
    if count:
        return f", and {kind}1 to {kind}{count}" if count > 1 else f", and {kind}"
    return f"; {SYNONYMS[kind]}" if kind in SYNONYMS else ""
