"""Attractors of a sweep as rows of a table, one for each."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..results.tables import coordinates

if TYPE_CHECKING:
    from .attractor import Attractor
    from .sweep import Row, Sweep

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
    most = max((_shown(row.attractor) for row in sweep.rows), default=0)
    letters = sweep.model.letters
    names = [*sweep.model.values, *sweep.model.DERIVED]
    m = sweep.model.unknowns_per_impact
    each = ("wall", *coordinates(m))
    columns = [*names, *columns_of(m)]
    columns += [f"{what}{k + 1}" for k in range(most) for what in each]
    width = most * len(each) + len(columns_of(m)) + len(names)
    rows = [_cells(row, names, letters, m) for row in sweep.rows]
    return columns, [cells + [None] * (width - len(cells)) for cells in rows]


def _shown(attractor: Attractor) -> int:
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
    for k in range(_shown(a)):
        wall = letters[a.walls[k]] + ("*" if a.released[k] else "")
        cells += [wall, float(a.times[k]), float(a.velocities[k])]
        cells += a.others[k].tolist() if a.others.size else []
    return cells
