"""Bifurcation diagrams in the manner of the paper's Figs. 7(a) and 8(a).

Velocities before impact against a parameter: stable solid, unstable dashed, unphysical dotted; a
colour for each wall; events by marker and label, ghosts hollow. The only file that imports
matplotlib; global settings are not touched.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.figure
import numpy as np
from matplotlib.lines import Line2D

from .diagram import LABELLED, Branch, Diagram, Entry

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
"""One for each wall; from the Okabe-Ito cycle, told apart by most colour-blind readers."""

STYLES: dict[str, Any] = {"stable": "-", "unstable": (0, (5, 2)), "unphysical": (0, (1, 1.6))}
WIDTHS = {"stable": 1.6, "unstable": 1.1, "unphysical": 0.9}
MARKERS = {"FB": "^", "BP": "D", "PD": "s", "NS": "*", "G": "o", "V": "v", "T": "X", "UZ": "|"}
LABEL_ROWS = 5


def plot_diagram(
    diagram: Diagram, ax: Any = None, *, x: str | None = None,
    xlim: tuple[float, float] | None = None, ylim: tuple[float, float] | None = None,
    unphysical: str = "period-1", labels: bool = True, unit: str = "",
) -> Any:  # fmt: skip
    """Draw a diagram.

    Parameters
    ----------
    diagram : Diagram
    ax : matplotlib.axes.Axes, optional
        Where to draw; a new figure otherwise.
    x : str, optional
        The column on the x axis; the followed parameter by default.
    xlim, ylim : (low, high), optional
    unphysical : {"period-1", "all", "none"}
        On which branches unphysical orbits and their events are drawn: those of period T, all,
        or none.
    labels : bool
        Whether to label events above the frame.
    unit : str
        Unit of x, for the axis label.

    Returns
    -------
    matplotlib.axes.Axes
    """
    ax = ax or new_figure().add_subplot()
    walls = list(dict.fromkeys(wall for branch in diagram.branches for wall in sorted(branch.word)))
    colours = dict(zip(walls, COLOURS, strict=False))
    everything = {"all": 10**9, "period-1": 1, "none": 0}[unphysical]
    for branch in diagram.branches:
        _draw_branch(ax, branch, x or branch.parameter, colours, ghosts=branch.period <= everything)
    ax.axhline(0.0, color="0.75", linewidth=0.6, zorder=0)
    entries = [e for e in diagram.entries if e.physical or e.period <= everything]
    column = x or (diagram.branches[0].parameter if diagram.branches else "")
    if xlim:
        ax.set_xlim(*xlim)
    else:
        ax.autoscale(axis="x")
    ax.set_ylim(*(ylim or _velocity_limits(diagram, column, ax.get_xlim())))
    low, high = sorted(ax.get_xlim())
    shown = [e for e in entries if low <= e.parameters.get(column, np.nan) <= high]
    for entry in shown:
        _draw_event(ax, entry, column, colours)
    if labels:
        _draw_labels(ax, [e for e in shown if e.kind != "UZ"], column)
    ax.set_xlabel(symbol(column) + (f" ({unit})" if unit else ""))
    ax.set_ylabel("velocity before impact")
    _draw_legend(ax, walls, colours, shown)
    return ax


def save_diagram(
    diagram: Diagram, folder: Path, formats: Sequence[str], **options: Any
) -> list[str]:
    """Draw a diagram to files ``diagram.<format>``; returns their names."""
    ax = plot_diagram(diagram, **options)
    return save_figure(ax.figure, folder, "diagram", formats, diagram.name)


def new_figure(width: float = 7.2, height: float = 4.8) -> Any:
    """Return an empty figure of a size in inches."""
    return matplotlib.figure.Figure(figsize=(width, height), dpi=150, layout="constrained")


def save_figure(
    figure: Any, folder: Path, stem: str, formats: Sequence[str], salt: str
) -> list[str]:
    """Save a figure as ``<stem>.<format>``, the same bytes every time; returns the names."""
    names = [f"{stem}.{kind}" for kind in formats]
    with matplotlib.rc_context({"svg.hashsalt": salt}):
        for name in names:
            metadata = {"Date": None} if name.endswith("svg") else None
            figure.savefig(folder / name, metadata=metadata)
    return names


def legend_mark(**style: Any) -> Any:
    """Return a line or marker for a legend."""
    return Line2D([], [], **style)


def _draw_branch(ax: Any, branch: Branch, x: str, colours: dict[str, str], ghosts: bool) -> None:
    """Draw runs of equal status, each joined to the next at their common point.

    The status changes at events, so a piece that starts at one takes it from its other end.
    """
    status = np.where(branch.physical, np.where(branch.stable, 0, 1), 2)
    at_event = np.nonzero(branch["event"][:-1] != "")[0]
    status[at_event] = status[at_event + 1]
    names = list(STYLES)
    for k, wall in enumerate(branch.word):
        speed = branch[f"v{k + 1}"]
        edges = np.nonzero(np.diff(status))[0] + 1
        for first, last in zip([0, *edges], [*edges, len(status)], strict=True):
            piece = slice(first, min(last + 1, len(status)))
            style = names[status[first]]
            if style == "unphysical" and not ghosts:
                continue
            ax.plot(
                branch[x][piece], speed[piece], linestyle=STYLES[style], color=colours[wall],
                linewidth=WIDTHS[style], alpha=0.7 if style == "unphysical" else 1.0,
            )  # fmt: skip


def _velocity_limits(diagram: Diagram, x: str, shown: tuple[float, float]) -> tuple[float, float]:
    """Limits that hold every velocity in the x range shown, with a margin."""
    inside = []
    for branch in diagram.branches:
        here = (branch[x] >= min(shown)) & (branch[x] <= max(shown))
        inside.append(branch.velocities[here].ravel())
    values = np.concatenate([[0.0], *inside])
    margin = 0.06 * (values.max() - values.min() or 1.0)
    return float(values.min() - margin), float(values.max() + margin)


def _draw_event(ax: Any, entry: Entry, x: str, colours: dict[str, str]) -> None:
    marks = [(impact["wall"], impact["velocity"]) for impact in entry.impacts]
    if entry.kind == "G":
        marks.append((entry.wall, 0.0))
    for wall, speed in marks:
        ax.plot(
            entry.parameters[x], speed, linestyle="none", marker=MARKERS.get(entry.kind, "P"),
            markersize=5.0, color=colours.get(wall, "k"), zorder=5,
            markerfacecolor="white" if entry.ghost else colours.get(wall, "k"),
        )  # fmt: skip


def _draw_labels(ax: Any, entries: list[Entry], x: str) -> None:
    """Put each label above the frame, over its value, in rows so that none overlap."""
    low, high = sorted(ax.get_xlim())
    taken = [-np.inf] * LABEL_ROWS
    transform = ax.get_xaxis_transform()
    unique = {(e.label, round(e.parameters[x], 9)): e for e in entries}
    for entry in sorted(unique.values(), key=lambda e: e.parameters[x]):
        text = label_text(entry)
        place = (entry.parameters[x] - low) / (high - low)
        half = 0.009 * max(len(re.sub(r"[\\${}^_,]|mathrm|widetilde", "", text)) * 0.75, 3)
        row = next((i for i, edge in enumerate(taken) if edge < place - half), LABEL_ROWS - 1)
        taken[row] = place + half
        ax.plot(
            [entry.parameters[x]] * 2, [0.0, 1.0], transform=transform, color="0.8",
            linewidth=0.5, zorder=0,
        )  # fmt: skip
        ax.annotate(
            text, (entry.parameters[x], 1.0), (0, 4 + 15 * row), xycoords=transform,
            textcoords="offset points", ha="center", va="bottom", fontsize=8,
        )  # fmt: skip


def label_text(entry: Entry) -> str:
    """Return an entry's label set as in Table 1: a tilde over ghosts, words raised and lowered."""
    if entry.kind not in LABELLED:
        return entry.kind.replace("\\", "/").replace("$", r"\$")
    name = rf"\mathrm{{{entry.kind}}}"
    if entry.ghost:
        name = rf"\widetilde{{{name}}}"
    if match := re.fullmatch(r"~?\w+\[(.*)->(.*)\]", entry.label):
        return f"${name}_{{{match[1]}}}^{{\\,{match[2]}}}$"
    return f"${name}$"


def symbol(name: str) -> str:
    """Return a parameter's name as it is set in labels."""
    greek = {"beta": r"$\beta$", "omega": r"$\omega$", "sigma": r"$\sigma$", "gbar": r"$\bar{g}$"}
    return greek.get(name, f"${name}$")


def _draw_legend(ax: Any, walls: list[str], colours: dict[str, str], entries: list[Entry]) -> None:
    handles = [Line2D([], [], color=colours[w], label=f"wall {w}") for w in walls]
    handles += [
        Line2D([], [], color="0.3", linestyle=style, label=name) for name, style in STYLES.items()
    ]
    for kind in dict.fromkeys(e.kind for e in entries):
        marker = MARKERS.get(kind, "P")
        handles.append(Line2D([], [], color="0.3", ls="none", marker=marker, ms=5, label=kind))
    if any(e.ghost for e in entries):
        handles.append(
            Line2D([], [], color="0.3", linestyle="none", marker="o", markerfacecolor="white",
                   markersize=5, label="hollow: ghost")
        )  # fmt: skip
    ax.legend(
        handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=8, frameon=False,
        borderaxespad=0.0,
    )  # fmt: skip
