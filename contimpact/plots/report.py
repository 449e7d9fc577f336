"""Work-precision plots: error against seconds and against evaluations, one line for each method.

Follows the manners of `contimpact.plots.diagram`: ``ax=``, no global settings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter

from .diagram import save_figure

COLOURS = ("#0072B2", "#56B4E9", "#D55E00", "#B87400", "#009E73", "#CC79A7")
MARKERS = "osDv^X"
STYLES: tuple[Any, ...] = ("-", (0, (5, 2)), "-", (0, (5, 2)), (0, (1, 1.2)), "-.")


def plot_report(data: Mapping[str, Any], ax: Any = None, *, against: str = "seconds") -> Any:
    """Draw error against cost, from `contimpact.accuracy.report.report`: against ``seconds``, the
    medians with bars from the least to the most, or against ``evaluations``. On axes of a new
    figure by default."""
    if ax is None:
        figure = matplotlib.figure.Figure(figsize=(5.2, 4.2), dpi=150, layout="constrained")
        ax = figure.add_subplot()
    for k, method in enumerate(sorted(data["methods"], key=lambda m: m["varied"] != "tolerance")):
        rows = [r for r in method["rows"] if r["error"] and np.isfinite(r["error"])]
        if rows:
            _draw_method(ax, method["name"], rows, against, k)
    ax.set_xscale("log")
    ax.set_yscale("log")
    low, high = ax.get_xlim()
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0, 3.0) if high < 100.0 * low else (1.0,)))
    ax.xaxis.set_minor_formatter(NullFormatter())
    evaluations = "kernel evaluations (shooting: of the equations of motion)"
    ax.set_xlabel("seconds for the branch" if against == "seconds" else evaluations)
    ax.set_ylabel("largest error of impact times and velocities")
    ax.axhline(2.2e-16, color="0.75", linewidth=0.6, zorder=0)
    where = {"xycoords": ax.get_yaxis_transform(), "textcoords": "offset points"}
    look: dict[str, Any] = {"ha": "right", "va": "bottom", "fontsize": 7, "color": "0.45"}
    ax.annotate("rounding", (1.0, 2.2e-16), (-3, 2), **where, **look)
    ax.grid(True, which="major", color="0.92", linewidth=0.6)
    ax.set_axisbelow(True)
    return ax


def _draw_method(
    ax: Any, name: str, rows: Sequence[Mapping[str, Any]], against: str, k: int
) -> None:
    errors = [r["error"] for r in rows]
    style: dict[str, Any] = {"markersize": 4, "linewidth": 1.2, "label": name}
    style |= {"color": COLOURS[k % len(COLOURS)], "marker": MARKERS[k % len(MARKERS)]}
    style |= {"linestyle": STYLES[k % len(STYLES)]}
    if against == "evaluations":
        ax.plot([r["evaluations"] for r in rows], errors, **style)
        return
    middle = np.array([r["seconds"]["median"] for r in rows])
    below = middle - [r["seconds"]["low"] for r in rows]
    above = np.array([r["seconds"]["high"] for r in rows]) - middle
    ax.errorbar(middle, errors, xerr=[below, above], elinewidth=0.7, capsize=0, **style)


def save_report(data: Mapping[str, Any], folder: Path, formats: Sequence[str]) -> list[str]:
    """Draw both plots side by side to files ``work-precision.<format>``; returns their names."""
    figure = matplotlib.figure.Figure(figsize=(9.6, 4.6), dpi=120, layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    plot_report(data, left)
    plot_report(data, right, against="evaluations")
    right.set_ylabel("")
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return save_figure(figure, folder, "work-precision", formats, str(data["scene"]))
