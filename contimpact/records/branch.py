"""A branch of periodic orbits, as a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from ..continuation.branch import at_one_place
from ..continuation.ends import End, EndKind
from ..display import Shown, Summary, frame, in_lines
from ..errors import shown
from .entry import Entry
from .tables import first_unknown, named_by_id, same_data

if TYPE_CHECKING:
    from ..models.model import Model
    from ..orbits.orbit import Orbit

from ..arrays import Array

STATUS = ("stable", "unstable", "unphysical", "unknown")
"""What the orbits of a piece of a branch are; the last where rows do not tell."""
UNKNOWN = STATUS.index("unknown")


@dataclass(frozen=True, eq=False)
class Branch(Shown):
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
        entry a row belongs to, empty for other points of the walk. Where the period is free, it
        is the column ``period``, and the first impact is at t = 0. ``branch["s"]`` is a shorthand.
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
        Further remarks: where another branch passes it closely without meeting it.
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
        found = f"branch {self.id} has no column {shown(column)}; "
        if named_by_id(self.events, column) is not None:
            found += f"the orbit of an event is branch.orbit({column!r}); "
        row = f"the orbit of a row is branch.orbit({column}); " if isinstance(column, int) else ""
        raise KeyError(found + row + f"it has {', '.join(self.columns)}")

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.columns)

    @property
    def name(self) -> str:
        """The same as `id`."""
        return self.id

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
    def between(self) -> Array:
        """Whether a row has the status of neither side.

        So it is at an event, and where the branch is born, whose orbit is another branch's.
        """
        found = np.asarray(self["event"] != "")
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
        return at_one_place(float(apart), float(difference), error)

    @property
    def parameters(self) -> list[str]:
        """Names of the parameters, derived ones included."""
        names = list(self.columns)
        return names[names.index("arclength") + 1 : first_unknown(names)]

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

    def to_dataframe(self) -> Any:
        """Return the columns as a pandas DataFrame; pandas must be installed."""
        return frame(self.columns)

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
        values = self[self.parameter]
        return (
            f"Branch {self.id}: {self.notation} ({self.word or 0}), {len(self)} points, "
            f"{self.parameter} from {values.min():.9g} to {values.max():.9g}"
        )

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
        return in_lines(self._head(), events, [end, *said], ahead=[start])
