"""Attractors of a sweep as rows of a table, one for each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .attractor import Attractor
    from .sweep import Row, Sweep

WRITTEN = 64
"""Velocities of one motion in its row at most."""
COLUMNS = tuple(
    """direction kind notation word period rate exponent1 exponent2 exponent_error exponent_sum
    mean_ln_r2 exponent_per_period multiplier1_re multiplier1_im multiplier2_re multiplier2_im
    smallest_gap closing distance periods impacts""".split()
)


def table_of(sweep: Sweep) -> tuple[list[str], list[list[Any]]]:
    """Return the columns' names and the rows."""
    most = max((_shown(row.attractor) for row in sweep.rows), default=0)
    letters = [wall.name for wall in sweep.model.WALLS]
    names = [*sweep.model.values, *sweep.model.DERIVED]
    columns = [*names, *COLUMNS]
    columns += [f"{what}{k + 1}" for k in range(most) for what in ("wall", "t", "v")]
    return columns, [_cells(row, names, letters, most) for row in sweep.rows]


def _shown(attractor: Attractor) -> int:
    return min(len(attractor.walls), WRITTEN)


def _cells(row: Row, names: Sequence[str], letters: Sequence[str], most: int) -> list[Any]:
    a = row.attractor
    parts = [None, None] if a.multipliers is None else [complex(mu) for mu in a.multipliers]
    spread = [x for mu in parts for x in ((mu.real, mu.imag) if mu is not None else (None, None))]
    cells: list[Any] = [a.parameters[name] for name in names]
    cells += [row.direction, a.kind.value, a.notation, a.word, a.period, a.rate, *a.exponents]
    cells += [a.error, sum(a.exponents), a.restitution, a.per_period, *spread]
    cells += [a.smallest_gap, a.closing, a.distance, a.periods, len(a.walls)]
    count = _shown(a)
    for k in range(count):
        wall = letters[a.walls[k]] + ("*" if a.released[k] else "")
        cells += [wall, float(a.times[k]), float(a.velocities[k])]
    return cells + [None] * (3 * (most - count))
