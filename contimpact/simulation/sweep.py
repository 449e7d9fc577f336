"""Sweeps of a parameter: the attractors at each value.

A sweep starts each value from the attractor at the value before, as the paper does, so that
falling and rising values show hysteresis. Random starts find attractors that no sweep meets, and a
grid of starts shows which of them each leads to.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, overload

import numpy as np

from ..arrays import Array
from ..display import NotebookResult, ParameterItems, Summary, frame, limit_lines
from ..errors import InputError, did_you_mean, explain_arguments, short_repr
from ..models.model import Model
from ..progress import Asked, progress_lines
from ..results.branch import coordinates, same_data
from ..results.options import SETTLING, Settling
from ..schema import build_record
from ..segments.kernels import Kernels
from .attractor import Attractor, Kind, distances_between
from .run import State
from .settle import settle
from .simulator import Simulator, as_simulator

SAME = 1e-6
"""Periodic attractors whose velocities and phases differ by less are one."""
APART = 0.03
"""Complex motions whose impacts are on average further from each other's, both ways, are two:
distances of phases in periods, of velocities in parts of the largest. Those of two runs of one
attractor are ten times as near."""


@dataclass(frozen=True)
class Row(ParameterItems):
    """An attractor of a sweep: the way it was found, the parameter value and what it is.

    `direction` is ``down`` or ``up`` for falling or rising values of the parameter, and ``random``
    for an attractor that random starts at this value found in addition.
    """

    direction: str
    value: float
    attractor: Attractor

    @property
    def parameters(self) -> Mapping[str, float]:
        """All parameters and derived parameters."""
        return self.attractor.parameters

    def as_record(self) -> dict[str, Any]:
        """Return plain data from which `from_record` makes the same row."""
        record = self.attractor.as_record()
        return {"direction": self.direction, "value": self.value, "attractor": record}

    @staticmethod
    def from_record(record: Mapping[str, Any]) -> Row:
        """Return the row a record was made of."""
        attractor = Attractor.from_record(record["attractor"])
        return build_record(Row, {**record, "attractor": attractor})


@dataclass(frozen=True, eq=False)
class Sweep(NotebookResult):
    """Attractors along a parameter."""

    model: Model
    """Gives the values of all other parameters."""
    parameter: str
    rows: list[Row]
    """Rows of all directions, each in the order it was computed."""
    interrupted: bool = field(default=False, compare=False)
    """Whether it was interrupted before all values were visited."""

    @property
    def values(self) -> Array:
        """The parameter's values, one for each row."""
        return np.array([row.value for row in self.rows])

    @property
    def attractors(self) -> list[Attractor]:
        """The attractors, one for each row."""
        return [row.attractor for row in self.rows]

    def __len__(self) -> int:
        return len(self.rows)

    def __bool__(self) -> bool:
        return True

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows)

    @overload
    def __getitem__(self, name: str) -> Array: ...
    @overload
    def __getitem__(self, name: int) -> Row: ...
    @overload
    def __getitem__(self, name: slice) -> list[Row]: ...

    def __getitem__(self, name: str | int | slice) -> Array | Row | list[Row]:
        """Return a row by its number, or the values of a parameter, one for each row."""
        if not isinstance(name, str):
            return self.rows[name]
        known = [*self.model.values, *self.model.DERIVED]
        if name not in known:
            text = f"sweep has no parameter {short_repr(name)}{did_you_mean(name, known)}"
            raise KeyError(f"{text}; it has {', '.join(known)}; columns are in to_dataframe()")
        return np.array([row[name] for row in self.rows])

    def _ipython_key_completions_(self) -> list[str]:
        return [*self.model.values, *self.model.DERIVED]

    def of(self, direction: str) -> list[Row]:
        """Return the rows of one direction."""
        return [row for row in self.rows if row.direction == direction]

    @property
    def directions(self) -> list[str]:
        """The directions that occur, in order."""
        return list(dict.fromkeys(row.direction for row in self.rows))

    def sequence(self, direction: str) -> list[str]:
        """Return the notations met one after another in one direction."""
        met: list[str] = []
        for row in self.of(direction):
            if not met or met[-1] != row.attractor.notation:
                met.append(row.attractor.notation)
        return met

    def to_dataframe(self) -> Any:
        """Return the attractors as a pandas DataFrame, a row for each; pandas must be installed."""

        columns, rows = table_of(self)
        return frame([dict(zip(columns, row, strict=True)) for row in rows])

    def summary(self) -> Summary:
        """Return the changes along the sweep in short."""
        rows = []
        for way in self.directions:
            met = self.of(way)
            for before, row in zip([None, *met], met, strict=False):
                if before is None or before.attractor.notation != row.attractor.notation:
                    velocities = ", ".join(f"{v:.6g}" for v in row.attractor.velocities[:8])
                    rows.append((way, row.value, row.attractor.notation, velocities))
        return Summary(
            self._head(), ("direction", self.parameter, "from there on", "velocities"), rows
        )

    def __eq__(self, other: object) -> bool:
        return same_data(self, other) if isinstance(other, Sweep) else NotImplemented

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        lines = [f"{way}: {_shorten_list(self.sequence(way))}" for way in self.directions]
        return limit_lines(self._head(), lines)

    def _head(self) -> str:
        cut = "; interrupted" if self.interrupted else ""
        return f"Sweep in {self.parameter}, {len(self.rows)} attractors{cut}"


def _shorten_list(met: Sequence[str], most: int = 12) -> str:
    left = f", ... and {len(met) - most} more" if len(met) > most else ""
    return ", ".join(met[:most]) + left


class Simulators:
    """Simulators of one model along a parameter; kernels are loaded once."""

    def __init__(self, model: Model, parameter: str, kernels: Kernels | None = None) -> None:
        self.model, self.parameter = model, parameter
        self.kernels = kernels or Kernels(model, parameter)

    def at(self, value: float) -> Simulator:
        """Return the simulator at a value of the parameter."""
        return Simulator(self.model.replace(**{self.parameter: value}), self.kernels)


@explain_arguments
def sweep(
    model: Model,
    parameter: str,
    values: Iterable[float],
    *,
    start: State | Literal["random"] | None = "random",
    settling: Settling = SETTLING,
    kernels: Kernels | None = None,
    rng: Any = 0,
    callback: Callable[[Row], None] | None = None,
    progress: Asked = False,
) -> Sweep:
    """Find the attractor at each value, starting from the one before.

    Parameters
    ----------
    model : Model
    parameter : str
    values : iterable of float
        In the order in which they are visited; falling for a sweep down.
    start : State, optional
        Where the first value starts; a random impact otherwise. None, as `Simulator.start` returns
        it where no wall is met, is refused.
    settling : Settling
    kernels : Kernels, optional
        Kernels of this model, if there are any already.
    rng : None, int or numpy.random.Generator, default 0
        Gives the first start, and a new one where a motion ended without impacts.
    callback : callable, optional
        Called with each row.
    progress : bool or callable
        Whether to tell on standard error how far the sweep is, or a function to call with lines of
        text.

    Returns
    -------
    Sweep
        After Ctrl-C with the values visited until then.

    Raises
    ------
    InputError
        If `start` is None.
    """
    if start is None:
        found = "None: the motion meets no wall"
        raise InputError("start", found, "give an impact, or leave it out for one at random")
    if not isinstance(values, Iterable):
        raise InputError("values", f"found {values!r}", "give the values to sweep, in their order")
    first = None if isinstance(start, str) else start
    simulators = Simulators(model, parameter, kernels)
    result = Sweep(model, parameter, [])
    values = list(values)
    try:
        with progress_lines(progress, f"sweep in {parameter}") as tell:
            for number, row in enumerate(sweep_rows(simulators, values, first, settling, rng), 1):
                result.rows.append(row)
                place = f"{number} of {len(values)}, {parameter} = {row.value:.6g}"
                tell(f"{place}: {row.attractor.notation}")
                if callback:
                    callback(row)
    except KeyboardInterrupt:
        return replace(result, interrupted=True)
    return result


def sweep_rows(
    simulators: Simulators,
    values: Sequence[float],
    start: State | None = None,
    settling: Settling = SETTLING,
    rng: Any = 0,
    direction: str | None = None,
) -> Iterator[Row]:
    """Yield the rows of one sweep; `start` is where the first value begins.

    `direction` follows from the values if it is not given.
    """
    falling = len(values) < 2 or values[-1] < values[0]
    for value in values:
        simulator = simulators.at(value)
        if start is None:
            start = simulator.random_state(np.random.default_rng(rng))
        attractor = settle(simulator, start, settling)
        start = attractor.state
        yield Row(direction or ("down" if falling else "up"), value, attractor)


def same_attractor(one: Attractor, other: Attractor, tolerance: float = SAME) -> bool:
    """Whether two attractors at the same parameter values are one.

    Complex ones are compared as sets of impacts: runs that each visit another part of one attractor
    count as two.
    """
    if one.label != other.label:
        return False
    if one.motion is not None and other.motion is not None:
        sizes = 1.0 + np.max(np.abs(one.motion))
        return bool(np.max(np.abs(np.subtract(one.motion, other.motion))) < tolerance * sizes)
    if one.kind is Kind.COMPLEX:
        return min(distances_between(one, other)) < APART
    if one.kind is not Kind.PERIODIC:
        return True
    T = one.forcing_period
    for shift in range(len(one.walls)):
        columns = (other.walls, other.times, other.velocities, other.others)
        walls, times, speeds, others = (np.roll(column, -shift, axis=0) for column in columns)
        if not np.array_equal(walls, one.walls):
            continue
        phases = (times - one.times) / T
        apart = [np.abs(phases - np.round(phases)), np.abs(speeds - one.velocities)]
        apart.append(np.abs(others - one.others))
        if max(np.max(part, initial=0.0) for part in apart) < tolerance:
            return True
    return False


@explain_arguments
def find_attractors(
    simulator: Simulator | Model,
    starts: int = 20,
    *,
    rng: Any = 0,
    settling: Settling = SETTLING,
    known: Sequence[Attractor] = (),
) -> list[Attractor]:
    """Find attractors from random starts.

    Parameters
    ----------
    simulator : Simulator or Model
    starts : int
        How many.
    rng : None, int or numpy.random.Generator, default 0
    settling : Settling
    known : sequence of Attractor
        Attractors that are not returned again.

    Returns
    -------
    list of Attractor
        Each once.
    """
    simulator = as_simulator(simulator)
    generator = np.random.default_rng(rng)
    found: list[Attractor] = []
    for _ in range(starts):
        attractor = settle(simulator, simulator.random_state(generator), settling)
        if not any(same_attractor(attractor, other) for other in (*known, *found)):
            found.append(attractor)
    return found


# Attractors of a sweep as rows of a table, one for each.

WRITTEN = 64
"""Velocities of one motion in its row at most."""


def columns_of(m: int) -> list[str]:
    """Return the names of the columns that say what an attractor is, of m unknowns an impact."""
    places = range(1, m + 1)
    return [
        *("direction", "kind", "notation", "word", "period", "rate"),
        *(f"exponent{k}" for k in places),
        *("exponent_error", "exponent_sum", "mean_ln_r2", "exponent_per_period"),
        *(f"multiplier{k}_{part}" for k in places for part in ("re", "im")),
        *("smallest_gap", "closing", "distance", "periods", "impacts"),
    ]


def table_of(sweep: Sweep) -> tuple[list[str], list[list[Any]]]:
    """Return the columns' names and the rows."""
    most = max((_count_written(row.attractor) for row in sweep.rows), default=0)
    letters = sweep.model.letters
    names = [*sweep.model.values, *sweep.model.DERIVED]
    m = sweep.model.unknowns_per_impact
    each = ("wall", *coordinates(m))
    columns = [*names, *columns_of(m)]
    columns += [f"{what}{k + 1}" for k in range(most) for what in each]
    width = most * len(each) + len(columns_of(m)) + len(names)
    rows = [_cells(row, names, letters, m) for row in sweep.rows]
    return columns, [cells + [None] * (width - len(cells)) for cells in rows]


def _count_written(attractor: Attractor) -> int:
    return min(len(attractor.walls), WRITTEN)


def _cells(row: Row, names: Sequence[str], letters: Sequence[str], m: int) -> list[Any]:
    a = row.attractor
    parts = [None] * m if a.multipliers is None else [complex(mu) for mu in a.multipliers]
    spread = [x for mu in parts for x in ((mu.real, mu.imag) if mu is not None else (None, None))]
    exponents = a.exponents if len(a.exponents) == m else (math.nan,) * m
    cells: list[Any] = [a.parameters[name] for name in names]
    cells += [row.direction, a.kind.value, a.notation, a.word, a.period, a.rate, *exponents]
    total = sum(exponents) if a.exponent_sum is None else a.exponent_sum
    cells += [a.error, total, a.restitution, a.per_period, *spread]
    cells += [a.smallest_gap, a.closing, a.distance, a.periods, len(a.walls)]
    for k in range(_count_written(a)):
        wall = letters[a.walls[k]] + ("*" if a.released[k] else "")
        cells += [wall, float(a.times[k]), float(a.velocities[k])]
        cells += a.others[k].tolist() if a.others.size else []
    return cells
