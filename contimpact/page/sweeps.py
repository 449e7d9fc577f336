"""Sweeps on the page, and numbers packed for it."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import printable
from ..models.model import Model
from ..results.branch import coordinates
from ..results.catalogue import SWEEP, check_reading, sweep_cells

# Numbers and texts as a page embeds them: compact, exact, and nothing but data.

TYPES = {"f8": "<f8", "f4": "<f4", "u4": "<u4", "u1": "u1"}
"""Types of packed numbers, as the script knows them and as NumPy does."""


def pack_column(values: Array, kind: str = "f8") -> str | float:
    """Return a column as one number where it is constant and finite, else as base64.

    The text is the kind of `TYPES` and the bytes, as ``f8:AAAAAAAA8D8=``, all rows in order.
    """
    array = np.ascontiguousarray(values, dtype=TYPES[kind])
    flat = array.ravel()
    if len(flat) and np.all(flat == flat[0]) and math.isfinite(flat[0]):
        return float(flat[0])
    return f"{kind}:{base64.b64encode(array.tobytes()).decode()}"


def plain_data(value: Any) -> Any:
    """Return plain data whose texts are printable, with None for numbers that are not finite."""
    if isinstance(value, str):
        return printable(value)
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {printable(str(name)): plain_data(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain_data(part) for part in value]
    return value


def script_json(value: Any) -> str:
    """Return JSON that can stand in a script element: no character of it begins markup."""
    text = json.dumps(plain_data(value), allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


LAST = 40
"""Impacts shown of a motion that is not periodic."""


@dataclass(frozen=True, eq=False)
class SweepSeries:
    """Attractors of one kind that a sweep found in one direction."""

    direction: str
    kind: str
    notation: str
    word: str
    """Word of periodic motion without sojourns on a wall; else empty."""
    period: int | None
    parameters: Mapping[str, Array]
    """Shape (n,)."""
    starts: Array
    """Index at which the impacts of each begin among those of all, shape (n + 1,)."""
    times: Array
    velocities: Array
    walls: Array
    """`times`, `velocities`, `walls`: walls by their numbers."""
    sections: Array
    """Times and all section coordinates, shape (impacts, m)."""
    multipliers: Array
    """Real and imaginary parts of the two largest, not numbers where there are none, shape (n, 2,
    2)."""

    def __len__(self) -> int:
        return len(self.starts) - 1

    @property
    def periodic(self) -> bool:
        """Whether these are orbits of a word."""
        return bool(self.word)


@dataclass(frozen=True)
class _Row:
    """A line of the table."""

    cells: Mapping[str, str]
    impacts: Sequence[tuple[float, ...]]
    word: str

    def key(self) -> tuple[str, ...]:
        return (*(self.cells[name] for name in ("direction", "kind", "notation")), self.word)


def read_sweep(path: Path, model: Model) -> list[SweepSeries]:
    """Read the attractors of a simulation, those of one word and direction together.

    Raises InputError if the file is not of this schema, damaged, or of another system.
    """
    _, table = sweep_cells(path)
    with check_reading(path, SWEEP):
        groups: dict[tuple[str, ...], list[_Row]] = {}
        for cells in table:
            row = _row(cells, model)
            groups.setdefault(row.key(), []).append(row)
        return [_join_rows(rows, model) for rows in groups.values()]


def _row(cells: Mapping[str, str], model: Model) -> _Row:
    letters = model.letters
    names = coordinates(model.unknowns_per_impact)
    impacts: list[tuple[float, ...]] = []
    for k in range(1, len(cells)):
        wall = cells.get(f"wall{k}")
        if not wall:
            break
        if not wall.endswith("*"):
            section = (_number(cells[f"{name}{k}"]) for name in names)
            impacts.append((letters.index(wall), *section))
    word = "".join(letters[int(wall)] for wall, *_ in impacts)
    whole = cells["kind"] == "periodic" and len(impacts) == int(cells["impacts"])
    return _Row(cells, impacts if whole else impacts[-LAST:], word if whole else "")


def _join_rows(rows: Sequence[_Row], model: Model) -> SweepSeries:
    cells = rows[0].cells
    direction, kind, notation, word = rows[0].key()
    width = 1 + model.unknowns_per_impact
    table = np.array([impact for row in rows for impact in row.impacts]).reshape(-1, width)
    names = (*model.values, *model.DERIVED)
    return SweepSeries(
        direction,
        kind,
        notation,
        word,
        int(cells["period"]) if cells["period"] else None,
        {name: np.array([_number(row.cells[name]) for row in rows]) for name in names},
        np.cumsum([0, *(len(row.impacts) for row in rows)]),
        table[:, 1],
        table[:, 2],
        table[:, 0],
        table[:, 1:],
        np.array([_multipliers(row.cells) for row in rows]),
    )


def _multipliers(cells: Mapping[str, str]) -> list[list[float]]:
    parts = ("re", "im")
    return [[float(cells.get(f"multiplier{k}_{part}") or "nan") for part in parts] for k in (1, 2)]


def _number(cell: Any) -> float:
    """A finite number; raises `ValueError` for anything else."""
    value = float(cell)
    if not math.isfinite(value):
        raise ValueError(f"{cell!r} in a row")
    return value
