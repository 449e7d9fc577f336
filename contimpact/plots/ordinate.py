"""The y axis of a diagram: limits, label, guides, and where events stand, by the quantity drawn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from ..bifurcations.registry import kind_of
from ..results.branch import Entry
from ..results.diagram import Diagram
from ..results.quantities import Quantity, Series
from .lines import Piece
from .texts import axis_label, plain

VELOCITY = "velocity"
LABELS = {
    "multipliers": "multipliers (real parts)",
    "moduli": "moduli of the multipliers",
    "energy": "output voltage $U_k$ (V)",
    "U_I": r"mean voltage per impact $\bar{U}_I$ (V)",
    "U_T": r"mean voltage per time $\bar{U}_T$ (V)",
    "gap": "smallest gap",
    "period": "period of the orbit",
}
GUIDES = {"velocity": (0.0,), "multipliers": (-1.0, 0.0, 1.0), "moduli": (1.0,), "gap": (0.0,)}
"""Values at which a line is drawn: those an event is told by."""
SEEN = {"multipliers": (-3.0, 3.0), "moduli": (0.0, 3.0)}
"""Multipliers grow without bound next to a grazing; limits hold no more of them than this."""


def draw_guides(ax: Any, y: Quantity) -> None:
    """Draw thin lines where the quantity tells of an event."""
    for value in GUIDES.get(y, ()) if isinstance(y, str) else ():
        ax.axhline(value, color="0.75", linewidth=0.6, zorder=0)


IN_A_LINE = 4
"""Walls in a line of the label; more do not fit beside the axis."""


def limits_of(
    pieces: Sequence[Piece], seen: tuple[float, float], y: Quantity
) -> tuple[float, float]:
    """Return limits that hold the guides and every value drawn in the x range, with a margin."""
    low, high = seen
    inside = [
        v[(low <= places) & (places <= high) & np.isfinite(v)] for _, _, places, v, _ in pieces
    ]
    guides = GUIDES.get(y, ()) if isinstance(y, str) else ()
    values = np.concatenate([guides, *inside])
    if isinstance(y, str) and y in SEEN:
        values = np.clip(values, *SEEN[y])
    if not len(values):
        return 0.0, 1.0
    margin = 0.06 * (values.max() - values.min() or abs(values[0]) or 1.0)
    return float(values.min() - margin), float(values.max() + margin)


def ordinate_label(diagram: Diagram, y: Quantity, names: Sequence[str]) -> str:
    """Return the label of the y axis; of velocities, which sign they have at which wall."""
    if y == VELOCITY:
        signs = _signs(diagram, names)
        lines = [", ".join(signs[i : i + IN_A_LINE]) for i in range(0, len(signs), IN_A_LINE)]
        return "\n".join(["impact velocity (before impact)", *lines])
    if isinstance(y, str):
        return LABELS.get(y) or axis_label(y)
    return plain(names[0]) if len(names) == 1 else ""


def _signs(diagram: Diagram, walls: Sequence[str]) -> list[str]:
    signs = []
    for wall in walls:
        speeds = [np.zeros(0)]
        speeds += [
            b[f"v{k + 1}"][b.physical]
            for b in diagram.branches
            for k, name in enumerate(b.word)
            if name == wall
        ]
        total = float(np.sum(np.concatenate(speeds)))
        if total:
            signs.append(f"{'positive' if total > 0 else 'negative'} at {wall}")
    return signs


def marks_of(
    diagram: Diagram, series: Sequence[Sequence[Series]], entry: Entry, y: Quantity
) -> list[tuple[str | None, Any]]:
    """Return where an event is marked: the name of a series and a value of the quantity.

    A touch is marked at the velocity zero of its wall.
    """
    if y == VELOCITY:
        marks = [(impact["wall"], impact["velocity"]) for impact in entry.impacts]
        touches = "touch_time" in kind_of(entry.kind).needed
        return [*marks, (entry.wall, 0.0)] if touches else marks
    for branch, own in zip(diagram.branches, series, strict=True):
        if branch.id == entry.branch:
            rows: Array = np.nonzero(branch["event"] == entry.id)[0]
            return [(one.name, one.values[row]) for row in rows[:1] for one in own]
    return []
