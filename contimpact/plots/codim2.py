"""Curves of points of codimension two in three parameters, as projections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
from matplotlib.lines import Line2D

from ..errors import InputError
from ..results.curve import Curve, falling
from .curves import fixed_values
from .diagram import save_figure, write_heading
from .texts import axis_label, plain, values_text

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#B87400", "#56B4E9", "0.3")
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (4, 1.5, 1, 1.5)), (0, (1, 1.2)))


def plot_codim2(
    curves: Sequence[Curve], axes: Any = None, *, units: Mapping[str, str] | None = None
) -> Any:
    """Draw curves in three parameters as projections on each pair of them.

    The second and the first one are drawn over the third, then the first over the second.

    Parameters
    ----------
    curves : sequence of Curve
        Of three parameters, the same ones.
    axes : three of matplotlib.axes.Axes, optional
        A new figure otherwise; with two the last projection is left out.
    units : mapping of str to str, optional
        Of parameters.

    Returns
    -------
    list of matplotlib.axes.Axes

    Raises
    ------
    InputError
        For no curves, or curves in different parameters.
    """
    triples = {curve.parameters for curve in curves}
    if len(triples) != 1:
        found = "empty" if not triples else f"curves in {len(triples)} triples of parameters"
        raise InputError("curves", found, "give curves in the same three parameters")
    _, second, third = triples.pop()
    if axes is None:
        figure = matplotlib.figure.Figure(figsize=(11.4, 3.4), dpi=150, layout="constrained")
        axes = figure.subplots(1, 3)
    axes = list(np.ravel(axes))
    kinds = list(dict.fromkeys((c.kind, c.notation) for c in curves))
    first = falling(curves)
    planes = ((third, second), (third, first), (second, first))
    for ax, (across, along) in zip(axes, planes, strict=False):
        for curve in curves:
            _draw(ax, curve, across, along, kinds.index((curve.kind, curve.notation)))
        ax.set_xlabel(axis_label(across, (units or {}).get(across, "")))
        ax.set_ylabel(axis_label(along, (units or {}).get(along, "")))
    _legend(axes[0], curves, kinds)
    return axes


def _draw(ax: Any, curve: Curve, across: str, along: str, place: int) -> None:
    look = _look(place)
    ax.plot(curve[across], curve[along], **look)
    for point in curve.points:
        at = (point.parameters[across], point.parameters[along])
        ax.plot(*at, marker="o", color=look["color"], markersize=4, markerfacecolor="w")


def _look(place: int) -> dict[str, Any]:
    return {
        "color": COLOURS[place % len(COLOURS)],
        "linestyle": DASHES[place % len(DASHES)],
        "linewidth": 1.4,
    }


def _legend(ax: Any, curves: Sequence[Curve], kinds: Sequence[tuple[str, str]]) -> None:
    several = len({notation for _, notation in kinds}) > 1
    handles = [
        Line2D([], [], label=kind + (f" ({plain(notation)})" if several else ""), **_look(place))
        for place, (kind, notation) in enumerate(kinds)
    ]
    if any(curve.points for curve in curves):
        look: dict[str, Any] = {
            "marker": "o",
            "color": "k",
            "markerfacecolor": "w",
            "markersize": 4,
            "ls": "none",
        }
        handles.append(Line2D([], [], label="turn, or codimension three", **look))
    ax.figure.legend(handles=handles, loc="outside right upper", fontsize=8, frameon=False)


def save_codim2(
    curves: Sequence[Curve],
    folder: Path,
    formats: Sequence[str],
    units: Mapping[str, str] | None = None,
) -> list[str]:
    """Draw curves to files ``codim2.<format>``; returns their names."""
    axes = plot_codim2(curves, units=units)
    write_heading(axes[0].figure, values_text(fixed_values(curves), units or {}))
    return save_figure(axes[0].figure, folder, "codim2", formats, "codim2")
