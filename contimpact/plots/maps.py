"""Maps of studies, curves of codimension two over them, and ranges of attractors as bars."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

from ..bifurcations.declarations import KINDS
from ..bifurcations.kind import kind_of
from ..diagrams.ranges import Ranges
from ..display import draw_result
from ..errors import explain_arguments
from ..studies.study import Map, Study
from .diagram import Figure, legend_mark, new_figure, save_figure, write_heading
from .lines import label_axis, plain_text, set_label

NAMED = ("#d5e5f2", "#56a0ce", "#f0c05a", "#1f4e79", "#cccccc", "#77913f", "#5b3a6b", "#c9733f")
"""Colours of names that are no kinds of events: of numbers from the first on, of others from the
fifth on."""
PALE = (0.45, 0.05, 0.75, 0.25)
"""How far colours of events are mixed with white: of the first name of a kind, the second, ..."""
LINES = ("-", "--", ":", "-.")


def plot_map(shown: Map, ax: Any = None, units: Mapping[str, str] | None = None) -> Any:
    """Draw a map, on axes of a new figure by default; units are those of the parameters."""
    ax = ax or Figure(figsize=(6.4, 4.8), layout="constrained").add_subplot()
    handles = _draw_names(ax, shown) if shown.named else _draw_numbers(ax, shown)
    handles += _draw_curves(ax, shown)
    x, y = shown.axes
    units = units or {}
    label_axis(ax.xaxis, x, units.get(x, ""))
    label_axis(ax.yaxis, y, units.get(y, ""))
    ax.margins(0.0 if shown.grid() is not None else 0.04)  # points are drawn whole
    if handles:
        legend: dict[str, Any] = {
            "loc": "upper center",
            "bbox_to_anchor": (0.5, -0.14),
            "frameon": False,
        }
        ax.legend(handles=handles, ncols=min(len(handles), 3), fontsize="small", **legend)
    return ax


def save_map(
    shown: Map, folder: str | Path, formats: Sequence[str], units: Mapping[str, str] | None = None
) -> list[str]:
    """Save a map as ``<study>-<quantity>.<format>``; returns the names."""
    ax = plot_map(shown, units=units)
    text = f": {plain_text(shown.text, 80)}" if shown.named else ""  # else at the colour bar
    write_heading(ax.figure, plain_text(shown.title) + text)
    return save_figure(ax.figure, Path(folder), shown.stem, formats, shown.stem)


def _draw_names(ax: Any, shown: Map) -> list[Any]:
    names = sorted({str(value) for value in shown.values if value is not None})
    colours = [_colour(name, [n for n in names if _family(n) == _family(name)]) for name in names]
    numbers = np.array(
        [np.nan if v is None else names.index(str(v)) for v in shown.values], dtype=float
    )
    options: dict[str, Any] = {
        "cmap": ListedColormap(colours or ["w"]),
        "vmin": -0.5,
        "vmax": len(names) - 0.5,
    }
    _draw(ax, shown, numbers, options)
    counts = [sum(str(v) == name for v in shown.values) for name in names]
    return [
        Patch(facecolor=colour, label=f"{_label_text(name)}  ({count})")
        for name, colour, count in zip(names, colours, counts, strict=True)
    ]


def _draw_numbers(ax: Any, shown: Map) -> list[Any]:
    finite = shown.values[np.isfinite(shown.values)]
    signed = len(finite) > 0 and finite.min() < 0.0 < finite.max()
    options: dict[str, Any] = {"cmap": "viridis"}
    if signed:
        most = float(np.max(np.abs(finite)))
        options = {"cmap": "RdBu_r", "vmin": -most, "vmax": most}
    drawn = _draw(ax, shown, shown.values, options)
    ax.figure.colorbar(drawn, ax=ax, label=plain_text(shown.text, 60))
    unknown = len(shown.values) - len(finite)
    white: dict[str, Any] = {"facecolor": "w", "edgecolor": "0.6"}
    handles: list[Any] = [Patch(**white, label=f"no value  ({unknown})")] if unknown else []
    grid = shown.grid() if signed else None
    if grid is None:
        return handles
    ax.contour(*grid, levels=[0.0], colors="k", linewidths=2.4, alpha=0.35)
    return [legend_mark(color="k", lw=2.4, alpha=0.35, label="zero of the map"), *handles]


def _draw(ax: Any, shown: Map, numbers: Any, options: Mapping[str, Any]) -> Any:
    """Cells of a grid; points where there is none."""
    grid = shown.grid(numbers)
    if grid is None:
        unknown = ~np.isfinite(numbers)
        ax.scatter(shown.x[unknown], shown.y[unknown], s=12, facecolor="w", edgecolor="0.6")
        return ax.scatter(shown.x, shown.y, c=numbers, s=12, **options)
    return ax.pcolormesh(*grid, shading="nearest", rasterized=True, **options)


def _draw_curves(ax: Any, shown: Map) -> list[Any]:
    handles = []
    for k, (kind, points) in enumerate(shown.curves.items()):
        joined = len(np.unique(points[:, 0])) == len(points)
        line = LINES[k % len(LINES)] if joined else "none"
        style: dict[str, Any] = {"color": "k", "linestyle": line, "linewidth": 1.0}
        style |= {"marker": "." if joined else "+", "markersize": 2.5 if joined else 4.0}
        ax.plot(*points.T, **style)
        handles.append(legend_mark(**style, label=f"{kind}, computed directly"))
    return handles


def _family(name: str) -> str | bool:
    """What names have colours of one row: a kind of events, or whether they are numbers."""
    kind = name.lstrip("~").partition("[")[0]
    return kind if kind in KINDS else name.isdecimal()


def _colour(name: str, alike: Sequence[str]) -> Any:
    """The colour of a name: its kind's own, mixed with white, or the next of `NAMED`."""
    kind, place = _family(name), alike.index(name)
    if isinstance(kind, bool):
        return NAMED[(int(name) - 1 if kind else 4 + place) % len(NAMED)]
    from matplotlib.colors import to_rgb

    pale = PALE[place % len(PALE)]
    return tuple(pale + (1.0 - pale) * part for part in to_rgb(kind_of(kind).look.colour))


def _label_text(name: str) -> str:
    kind = name.lstrip("~").partition("[")[0]
    return set_label(kind, name) if kind in KINDS else plain_text(name)


# Which attractors there are along a parameter, as a bar for each.

FILLS: dict[bool, dict[str, Any]] = {
    True: {"facecolor": "0.35", "edgecolor": "k"},
    False: {"facecolor": "white", "edgecolor": "k", "hatch": "////"},
}
"""Bars of orbits on branches, and of motion that simulation alone shows."""


@draw_result.register(Ranges)
@explain_arguments
def plot_ranges(found: Ranges, ax: Any = None, *, unit: str = "") -> Any:
    """Draw a bar for each attractor, those of one notation in one row where they do not overlap;
    returns the axes.

    Where simulation alone shows an end, a line shows between which values it lies. The axes, such
    as those below a diagram, are new ones by default; the unit is that of the parameter.
    """
    motions = sorted(found.motions, key=lambda motion: motion.low.value)
    names, ends, rows = list[str](), list[float](), list[int]()
    for motion in motions:
        name, begin = plain_text(motion.notation, 30), motion.low.value + motion.low.error
        free = (i for i, own in enumerate(names) if own == name and ends[i] <= begin)
        rows.append(next(free, len(names)))
        if rows[-1] == len(names):
            names.append(name)
            ends.append(math.inf)
        ends[rows[-1]] = motion.high.value
    ax = ax or new_figure(7.2, 0.9 + 0.32 * max(len(names), 1)).add_subplot()
    for motion, row in zip(motions, rows, strict=True):
        low, high = motion.low, motion.high
        look = FILLS[motion.branch is not None]
        ax.barh(row, high.value - low.value, left=low.value, height=0.55, linewidth=0.8, **look)
        for end in (low, high):
            if end.entry is None and end.error:
                bar = {"fmt": "none", "ecolor": "k", "elinewidth": 1.2, "capsize": 3.0}
                ax.errorbar([end.value], [row], xerr=[end.error], **bar)
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.set_xlim(found.ranges[0].low, found.ranges[-1].high)
    label_axis(ax.xaxis, found.parameter, unit)
    kinds = {motion.branch is not None for motion in motions}
    texts = {True: "stable orbits of branches", False: "simulated, on no branch"}
    handles = [Patch(label=texts[kind], **FILLS[kind]) for kind in sorted(kinds)]
    ax.legend(
        handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False
    )
    return ax


@draw_result.register
def _(result: Study, quantity: str = "ends", **options: Any) -> Any:
    return plot_map(result.map(quantity, **options))
