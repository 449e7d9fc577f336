"""Names in a diagram: of orbits on their stable stretches, of walls at the ends of their curves.

A name stands beside its curve where it covers no line, no marker and no other name.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.patheffects import withStroke

from ..arrays import Array
from .labels import text_width
from .lines import Piece
from .texts import plain

SIZE, HEIGHT = 7.5, 9.0
"""Font and height of a name of an orbit, in points."""
SHORTEST = 3.0
"""Stable stretches that are shorter in a picture have no name, in points."""
APART = 2.5
"""At which distance a line is taken to be a row of points, in points."""
FRACTIONS = (0.5, 0.4, 0.6, 0.25, 0.75, 0.1, 0.9)
GAPS = (2.5, 6.0, 11.0, 17.0)
"""Where a name is tried: along a stretch, and how far from its curve, in points."""
HALO = [withStroke(linewidth=1.6, foreground="white")]


def name_orbits(ax: Any, pieces: Sequence[Piece]) -> int:
    """Name the orbits on their stable stretches; returns how many found no place."""
    frame, dots = ax.get_window_extent(), ax.figure.dpi / 72.0
    size = frame.size / dots

    def in_points(x: Any, y: Any) -> Array:
        there = ax.transData.transform(np.column_stack([x, y]).astype(float))
        return np.asarray((there - frame.p0) / dots)

    lines = [(_dense(in_points(p.places, p.values)), p) for p in pieces]
    seen = [(_inside(points, size), piece) for points, piece in lines]
    marks = [line for line in ax.lines if line.get_linestyle() == "None"]
    spots = [in_points(*m.get_data()) for m in marks]
    filled = np.vstack([np.zeros((0, 2)), *(points for points, _ in seen), *spots])
    taken: list[tuple[float, float, float, float]] = []
    left_out = 0
    for name, curves in _stretches(seen):
        wide = text_width(name) * SIZE / 8.0 + 2.0
        tried = [
            (_covered(box, filled, taken) + cost, box)
            for box, cost in _places(curves, wide)
            if box[0] > 0 and box[1] > 0 and box[2] < size[0] and box[3] < size[1]
        ]
        cost, box = min(tried, default=(np.inf, (0.0,) * 4))
        if cost >= 4.0:
            left_out += 1
            continue
        taken.append(box)
        at = ax.transData.inverted().transform((np.array(box[:2]) + 1.0) * dots + frame.p0)
        look: dict[str, Any] = {"fontsize": SIZE, "gid": "orbit", "path_effects": HALO}
        ax.text(*at, name, ha="left", va="bottom", color="0.1", zorder=6, **look)
    return left_out


def _dense(corners: Array) -> Array:
    """A line as points close to one another."""
    corners = corners[np.all(np.isfinite(corners), axis=1)]
    if len(corners) < 2:
        return corners
    length = np.append(0.0, np.cumsum(np.hypot(*np.diff(corners, axis=0).T)))
    along = np.linspace(0.0, length[-1], int(min(length[-1] / APART, 4000)) + 2)
    return np.column_stack([np.interp(along, length, column) for column in corners.T])


def _inside(points: Array, size: Array) -> Array:
    return points[np.all((points >= 0.0) & (points <= size), axis=1)]


def _stretches(seen: Sequence[tuple[Array, Piece]]) -> list[tuple[str, list[Array]]]:
    """The stable stretches in sight with their curves, an orbit and range once, long ones first."""
    found: dict[tuple[str, int, int], list[Array]] = {}
    for points, piece in seen:
        if piece.style == "stable" and piece.orbit and len(points):
            low, high = np.min(points[:, 0]), np.max(points[:, 0])
            if high - low >= SHORTEST:
                key = (plain(piece.orbit), round(low / 3.0), round(high / 3.0))
                found.setdefault(key, []).append(points)
    order = sorted(found.items(), key=lambda item: item[0][1] - item[0][2])
    return [(key[0], sorted(c, key=lambda p: -np.max(p[:, 1]))) for key, c in order]


def _places(
    curves: Sequence[Array], wide: float
) -> Iterator[tuple[tuple[float, float, float, float], float]]:
    """Boxes beside the curves of a stretch, and what speaks against each."""
    for number, curve in enumerate(curves):
        for fraction in FRACTIONS:
            x, y = curve[round(fraction * (len(curve) - 1))]
            for gap in GAPS:
                for low in (y + gap, y - gap - HEIGHT):
                    box = (x - wide / 2, low, x + wide / 2, low + HEIGHT)
                    against = 0.3 * number + 0.05 * gap + 0.5 * abs(fraction - 0.5)
                    yield box, against + (0.2 if low < y else 0.0)


def _covered(
    box: tuple[float, float, float, float],
    filled: Array,
    taken: Sequence[tuple[float, float, float, float]],
) -> float:
    """How many points of lines a box covers; very many if it covers another name."""
    x0, y0, x1, y1 = box
    if any(x0 < b[2] and b[0] < x1 and y0 < b[3] and b[1] < y1 for b in taken):
        return 1e6
    x, y = filled.T
    return float(np.count_nonzero((x0 < x) & (x < x1) & (y0 < y) & (y < y1)))


def name_walls(ax: Any, pieces: Sequence[Piece], colours: Mapping[str, str]) -> None:
    """Write each wall's name to the right of the curves that belong to it; longer names stand in
    the legend alone."""
    apart = 0.06 * float(np.ptp(ax.get_ylim()))
    taken: list[float] = []
    for wall, colour in colours.items():
        own = [p for p in pieces if p.series == wall] if len(wall) == 1 else []
        physical = [p for p in own if p.style != "unphysical"]
        spots = _rightmost(ax, physical) or _rightmost(ax, own)
        if not spots:
            continue
        place, speed = spots[0]
        while any(abs(speed - other) < apart for other in taken):
            speed += apart
        taken.append(speed)
        look = {"fontsize": 9, "fontweight": "bold", "color": colour, "gid": "wall"}
        offset: dict[str, Any] = {"textcoords": "offset points", "annotation_clip": False}
        offset |= {"path_effects": HALO, "zorder": 6}
        beside = (5, 0) if place > ax.get_xlim()[1] - 1e-3 * np.ptp(ax.get_xlim()) else (3, 7)
        ax.annotate(wall, (place, speed), beside, ha="left", va="center", **offset, **look)


def _rightmost(ax: Any, pieces: Sequence[Piece]) -> list[tuple[float, float]]:
    """The point in sight that is farthest to the right; of several, the one of largest speed."""
    (low, high), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    found: list[tuple[float, float]] = []
    for _, _, places, speeds, _ in pieces:
        edge = np.nonzero((places[:-1] - high) * (places[1:] - high) < 0.0)[0]
        part = (high - places[edge]) / (places[edge + 1] - places[edge])
        crossing = speeds[edge] + part * (speeds[edge + 1] - speeds[edge])
        found += zip(places.tolist(), speeds.tolist(), strict=True)
        found += ((high, v) for v in crossing.tolist())
    seen = [(x, v) for x, v in found if low <= x <= high and bottom <= v <= top]
    return sorted(seen, key=lambda spot: (spot[0], abs(spot[1])))[-1:]
