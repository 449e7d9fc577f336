"""Curves of bifurcations in two parameters, in the manner of the paper's Fig. 6.

A panel for each member of the family; PD blue, G green, FB orange, BP and V in further colours;
ghosts dotted; points of codimension two marked; the band under each panel tells which bifurcation
comes first as d falls.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
from matplotlib.lines import Line2D

from ..two_parameters.competition import Region, column, regions
from ..two_parameters.curves import Curve
from ..two_parameters.runs import Check
from .diagram import save_figure

COLOURS = {"PD": "#0072B2", "G": "#009E73", "FB": "#D55E00", "BP": "#CC79A7", "V": "#E69F00"}
WIDTHS = {"PD": 1.8, "G": 1.2, "FB": 1.2, "BP": 1.2, "V": 1.2}
HATCHES = {"G": "//////", "FB": "......"}
"""Of the bands, so that they differ without colour."""
MARKERS = {"PD-G": "o", "G-PD": "o", "G-FB": "^", "CP": "v", "GPD": "s", "DG": "D"}
SYMBOLS = {"beta": r"\beta", "omega": r"\omega", "sigma": r"\sigma", "gbar": r"\bar{g}"}


def plot_curves(
    curves: Sequence[Curve], axes: Any = None, *, along: str | None = None,
    checks: Sequence[Check] = (),
) -> Any:  # fmt: skip
    """Draw curves, one panel for each member of their family.

    Parameters
    ----------
    curves : sequence of Curve
    axes : sequence of matplotlib.axes.Axes, optional
        One for each member; a new figure otherwise.
    along : str, optional
        The column on the y axis: ``d`` where there is one, else the branch's parameter.
    checks : sequence of Check, optional
        One-parameter runs; bands that none of them confirms are drawn half as high.

    Returns
    -------
    list of matplotlib.axes.Axes
    """
    members = list({tuple(c.fixed.items()): dict(c.fixed) for c in curves}.values())
    along = along or column(list(curves[0].columns), curves[0].parameters[0])
    if axes is None:
        axes = _panels(len(members))
    axes = list(np.ravel(axes))
    labels = list(dict.fromkeys(c.label for c in curves))
    for ax, fixed in zip(axes, members, strict=False):
        own = [c for c in curves if dict(c.fixed) == fixed]
        _draw_member(ax, own, fixed, along, labels)
        for region in regions(own, along, checks):
            _draw_region(ax, region, labels)
    _draw_legend(axes[0], curves, any(r.said for r in regions(curves, along, checks)))
    return axes


def save_curves(
    curves: Sequence[Curve], folder: Path, formats: Sequence[str], checks: Sequence[Check] = ()
) -> list[str]:
    """Draw curves to files ``curves.<format>``; returns their names."""
    axes = plot_curves(curves, checks=checks)
    return save_figure(axes[0].figure, folder, "curves", formats, "curves")


def _panels(count: int) -> Any:
    columns = min(count, 4)
    rows = -(-count // columns)
    size = (3.0 * columns + 0.6, 2.7 * rows + 0.5) if count > 1 else (5.6, 4.2)
    figure = matplotlib.figure.Figure(figsize=size, dpi=150, layout="constrained")
    axes = np.ravel(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False))
    for ax in axes[count:]:
        ax.set_visible(False)
    for ax in axes[max(count - columns, 0) : count]:  # nothing stands below these
        ax.tick_params(labelbottom=True)
    return axes[:count]


def _draw_member(
    ax: Any, curves: Sequence[Curve], fixed: Mapping[str, float], along: str, labels: Sequence[str]
) -> None:
    second = curves[0].parameters[1]
    for curve in curves:
        _draw_curve(ax, curve, second, along, labels)
        for point in curve.points:
            ax.plot(
                point.parameters[second], point.parameters[along], linestyle="none", color="k",
                marker=MARKERS.get(point.kind, "P"), markersize=4.5, zorder=5,
            )  # fmt: skip
    if ax.xaxis.get_tick_params().get("labelbottom", True):
        ax.set_xlabel(f"${_symbol(second)}$")
    if ax.yaxis.get_tick_params().get("labelleft", True):
        ax.set_ylabel(f"${_symbol(along)}$")
    if fixed:
        title = ", ".join(f"${_symbol(name)} = {_angle(v)}$" for name, v in fixed.items())
        ax.set_title(title, fontsize=9)


def _draw_curve(ax: Any, curve: Curve, second: str, along: str, labels: Sequence[str]) -> None:
    """Draw runs of equal status; a piece that starts at a marked point takes it from its end."""
    ghost = curve.ghost.copy()
    marked = np.nonzero(curve["event"][:-1] != "")[0]
    ghost[marked] = ghost[marked + 1]
    edges = np.nonzero(np.diff(ghost.astype(int)))[0] + 1
    for first, last in zip([0, *edges], [*edges, len(ghost)], strict=True):
        piece = slice(first, min(last + 1, len(ghost)))
        ax.plot(
            curve[second][piece], curve[along][piece], color=_colour(curve.label, labels),
            linestyle=(0, (1, 1.4)) if ghost[first] else "-", linewidth=WIDTHS[curve.kind],
        )  # fmt: skip


def _draw_region(ax: Any, region: Region, labels: Sequence[str]) -> None:
    """A band along the x axis in the colour of what comes first; half as high if unconfirmed."""
    colour = _colour(region.first, labels)
    hatch = HATCHES.get(region.first.removeprefix("~").split("[")[0])
    height = 0.015 if region.said else 0.03
    ax.axvspan(
        region.low, region.high, ymin=0, ymax=height, facecolor=colour, edgecolor="white",
        alpha=0.6, linewidth=0, hatch=hatch,
    )  # fmt: skip


def _colour(label: str, labels: Sequence[str]) -> str:
    """The kind's colour; a second grazing is black."""
    kind = label.split("[")[0]
    same = [other for other in labels if other.split("[")[0] == kind]
    return COLOURS[kind] if label == same[0] else "k"


def _draw_legend(ax: Any, curves: Sequence[Curve], unconfirmed: bool) -> None:
    labels = list(dict.fromkeys(c.label for c in curves))
    handles = []
    for kind, label in dict.fromkeys((c.kind, c.label) for c in curves):
        handles.append(Line2D([], [], color=_colour(label, labels), lw=WIDTHS[kind], label=label))
    handles.append(Line2D([], [], color="0.3", linestyle=(0, (1, 1.4)), label="ghost"))
    kinds = {"G-PD": "PD-G"}
    for kind in dict.fromkeys(kinds.get(p.kind, p.kind) for c in curves for p in c.points):
        marker = MARKERS.get(kind, "P")
        handles.append(Line2D([], [], color="k", ls="none", marker=marker, ms=4.5, label=kind))
    first = "first as d falls" + "\n(half as high: not checked)" * unconfirmed
    handles.append(Line2D([], [], color="0.5", lw=4, alpha=0.6, label=first))
    ax.figure.legend(
        handles=handles, loc="outside right upper", fontsize=7.5, frameon=False, handlelength=1.8
    )


def _symbol(name: str) -> str:
    return SYMBOLS.get(name, name)


def _angle(value: float) -> str:
    """A value as a simple multiple of pi, if it is one."""
    for below in (1, 2, 3, 4, 6, 9, 12, 18):
        above = value / np.pi * below
        if abs(above - round(above)) < 1e-12 and round(above):
            top = "" if round(above) == 1 else str(round(above))
            return rf"{top}\pi/{below}" if below > 1 else rf"{top}\pi"
    return f"{value:.4g}"
