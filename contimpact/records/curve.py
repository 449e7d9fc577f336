"""Curves of bifurcations in two parameters as data, and the runs they are checked against."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arrays import Array
from ..continuation.ends import End
from ..display import Shown, Summary, frame, in_lines
from ..errors import shown
from .tables import same_data


@dataclass(frozen=True, eq=False)
class Curve(Shown):
    """A curve of bifurcations, as a table.

    Attributes
    ----------
    id, kind, label : str
        Its name, the kind of bifurcation, and the label of the entry it was started from.
    word, period, notation
        The orbits on it.
    parameters : (str, str) or (str, str, str)
        The branch's parameter and the second one; on curves of points of codimension two the
        third one besides.
    columns : mapping of str to ndarray
        As of a branch; `n_unstable`, `physical` and `reason` leave the bifurcation itself out.
    ends : (End, End)
    points : sequence of Codim2
        The points of codimension two on it, in order.
    origin : str
        The entry it was started from.
    missed : sequence of str
    fixed : mapping of str to float
        Values of a family's parameters.
    evaluations : int
        Flights evaluated to follow it; not written to files.
    branch : str
        The branch of the entry it was started from; empty in files of earlier versions.
    """

    id: str
    kind: str
    label: str
    word: str
    period: int
    notation: str
    parameters: tuple[str, ...]
    columns: Mapping[str, Array]
    ends: tuple[End, End]
    points: Sequence[Codim2]
    origin: str
    missed: Sequence[str] = ()
    fixed: Mapping[str, float] = field(default_factory=dict)
    evaluations: int = field(default=0, compare=False)
    branch: str = ""

    def __getitem__(self, column: str) -> Array:
        if column in self.columns:
            return self.columns[column]
        found = f"curve {self.id} has no column {shown(column)}; "
        raise KeyError(f"{found}it has {', '.join(self.columns)}")

    def _ipython_key_completions_(self) -> list[str]:
        return list(self.columns)

    @property
    def name(self) -> str:
        """The same as `id`."""
        return self.id

    def __len__(self) -> int:
        return len(self.columns["arclength"])

    def __eq__(self, other: object) -> bool:
        return same_data(self, other) if isinstance(other, Curve) else NotImplemented

    __hash__ = None  # type: ignore[assignment]

    @property
    def ghost(self) -> Array:
        """Whether the bifurcation is a ghost, point by point."""
        return np.asarray((self["n_unstable"] > 0) | (self["physical"] == 0))

    def to_dataframe(self) -> Any:
        """Return the columns as a pandas DataFrame; pandas must be installed."""
        return frame(self.columns)

    def summary(self) -> Summary:
        """Return the curve's points of codimension two and its ends in short."""
        names = self.parameters
        rows = [
            (p.id, p.kind, *(p.parameters[n] for n in names), f"{p.error:.1g}", p.changes)
            for p in self.points
        ]
        notes = [f"end: {end.message}" for end in self.ends]
        notes += [f"not located: {text}" for text in self.missed]
        return Summary(self._head(), ("", "point", *names, "error", "changes"), rows, notes)

    def _head(self) -> str:
        last = self.parameters[-1]
        values = self[last]
        return (
            f"Curve {self.id}: {self.label} in ({', '.join(self.parameters)}), {len(self)} points, "
            f"{last} from {values.min():.9g} to {values.max():.9g}"
        )

    def __repr__(self) -> str:
        points = [f"  {p.kind:6} {self._place(p)}: {p.changes}" for p in self.points]
        tail = [f"  end: {end.message}" for end in self.ends]
        tail += [f"  not located: {len(self.missed)}"] if self.missed else []
        return in_lines(self._head(), points, tail)

    def _place(self, point: Codim2) -> str:
        return ", ".join(f"{name} = {point.parameters[name]:.12g}" for name in self.parameters)


@dataclass(frozen=True)
class Codim2:
    """A point of codimension two on a curve, as the catalogue records it.

    Attributes
    ----------
    id, curve, kind : str
        PD-G, FB-G, BP-G, G-FB, G-PD, CP (cusp), GPD, DG (touch with zero acceleration), R1, R2, ...
    changes : str
        What changes there.
    parameters : mapping of str to float
    impacts : sequence of mappings
    residual, error : float
        Of the curve's equations; a bound of the error of the second parameter.
    """

    id: str
    curve: str
    kind: str
    changes: str
    parameters: Mapping[str, float]
    impacts: Sequence[Mapping[str, Any]]
    residual: float
    error: float


@dataclass(frozen=True)
class CheckedOrbit:
    """What a one-parameter run says of one of the orbits of a word: of one branch.

    Attributes
    ----------
    first, curve : str
        Label of its first real bifurcation, and the curve that passes there; empty without one.
    curves : mapping of str to sequence of float
        The curves on which its real bifurcations lie, and the values of the parameter that falls.
    """

    first: str
    curve: str
    curves: Mapping[str, Sequence[float]]


@dataclass(frozen=True)
class Check:
    """What a one-parameter run says comes first.

    Attributes
    ----------
    fixed : mapping of str to float
        The family's parameter.
    word, period, notation
        The orbit.
    second : str
    value : float
        Of the second parameter.
    first : str or None
        Label of the first real bifurcation, as the parameter that `regions` go by falls.
    orbits : sequence of CheckedOrbit
        The same of each branch; none in files of earlier versions.
    """

    fixed: Mapping[str, float]
    word: str
    period: int
    notation: str
    second: str
    value: float
    first: str | None
    orbits: Sequence[CheckedOrbit] = ()


@dataclass(frozen=True)
class Coverage:
    """What lines across a map of curves say of its completeness.

    Attributes
    ----------
    fixed : mapping of str to float
        The family's parameter.
    word, period, notation
        The orbit.
    lines : mapping of str to sequence of float
        Where runs were made: values of each of the two parameters at which it was held.
    entries : int
        Entries that these runs met, all on curves but those below.
    started : int
        Curves that were started from them.
    uncovered : sequence of mappings
        Entries that lie on no curve: `kind`, the two parameters, and `reason`.
    complete : bool
        Whether the last lines met nothing that was not on a curve, and lines followed these orbits.
    born : int
        Curves that were started at points of codimension two on others.
    switched : bool
        Whether these orbits were reached by switching from those of a word of the scene.
    branches : int, optional
        How many branches of these orbits the lines followed; absent in earlier files.
    left_out : sequence of str
        What a limit of the scene left out on lines, with the limit and the line.
    """

    fixed: Mapping[str, float]
    word: str
    period: int
    notation: str
    lines: Mapping[str, Sequence[float]]
    entries: int
    started: int
    uncovered: Sequence[Mapping[str, Any]]
    complete: bool
    born: int = 0
    switched: bool = False
    branches: int | None = None
    left_out: Sequence[str] = field(default_factory=list)

    @property
    def place(self) -> str:
        """The member of the family, in words."""
        return "".join(f"{name} = {value:.6g}  " for name, value in self.fixed.items())

    def __str__(self) -> str:
        lines = " and ".join(f"{len(v)} lines at values of {n}" for n, v in self.lines.items())
        told = f"{self.notation}: {self.entries} entries on {lines}, {self.started} curves started"
        told += f", {self.born} more at points of codimension two" if self.born else ""
        told += "; reached by switching alone" if self.switched else ""
        if self.switched and self.branches == 0:
            told += (
                "; no line followed these orbits, so further curves of theirs may be missing: "
                "name the word in follow.orbits, or raise follow.depth"
            )
        elif not self.complete:
            told += "; the last lines still met new curves: give curves.cover a larger number"
        if self.uncovered:
            places = ", ".join(
                " ".join(f"{k} = {v:.6g}" if isinstance(v, float) else str(v) for k, v in u.items())
                for u in self.uncovered[:SHOWN]
            )
            more = f" and {len(self.uncovered) - SHOWN} more" if len(self.uncovered) > SHOWN else ""
            told += f"; on no curve: {places}{more}"
        if self.left_out:
            more = f" and {len(self.left_out) - SHOWN} more" if len(self.left_out) > SHOWN else ""
            told += f"; left out: {', '.join(self.left_out[:SHOWN])}{more}"
        return told


SHOWN = 4
"""Entries on no curve that are named."""
