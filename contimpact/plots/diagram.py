"""Bifurcation diagrams in the manner of the paper's Figs. 7(a) and 8(a).

Velocities before impact against a parameter: stable solid, unstable dashed, unphysical dotted; a
colour for each wall, and its name at the right end of its curves; events by marker and label,
ghosts hollow. The only file that imports matplotlib's foundations; global settings are not touched.
"""

from __future__ import annotations

import io
import itertools
import math
import re
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.figure
import numpy as np
from matplotlib.lines import Line2D
from matplotlib.textpath import TextPath

from ..diagram import LABELLED, Array, Branch, Diagram, Entry
from ..errors import InputError, printable, shortened, shown
from ..files import Content, write, write_all

COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7")
"""One for each wall; from the Okabe-Ito cycle, told apart by most colour-blind readers, the first
two by lightness alone."""

STYLES: dict[str, Any] = {"stable": "-", "unstable": (0, (5, 2)), "unphysical": (0, (1, 1.6))}
WIDTHS = {"stable": 1.6, "unstable": 1.1, "unphysical": 0.9}
MARKERS = {"FB": "^", "BP": "D", "PD": "s", "NS": "*", "G": "o", "V": "v", "T": "X", "UZ": "|"}
NEUTRAL = "h"
"""The marker of no kind of event, for what the legend says of all kinds."""
SHOWN = {"all": 10**9, "period-1": 1, "none": 0}
"""Up to which period unphysical orbits are drawn."""

SIZE = (7.2, 5.1)
AXES = (1.0, 1.0, 5.9, 3.1)
"""A diagram's figure, and in it the axes (left, bottom, width, height), in inches."""
LABEL_ROWS, ROW, LABEL_SIZE, GAP = 4, 16.0, 8.0, 4.0
"""Rows of labels above the frame; their height, font and distance in points."""
ORBIT = r"(?:[^\W_]|[:/()])*"
"""How orbits are called in labels; nothing in it has a meaning in mathematical text."""
FLAT = 3e-4
"""How far a drawn chord may be from a smooth curve, by the size of the picture."""


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

    Raises
    ------
    InputError
        For a column that the branches do not have or that holds texts, limits that are not finite
        and increasing, or another value of `unphysical`.
    """
    column = _checked(diagram, x, {"xlim": xlim, "ylim": ylim}, unphysical)
    ax = _fixed_axes() if ax is None else ax
    walls = list(dict.fromkeys(wall for branch in diagram.branches for wall in sorted(branch.word)))
    colours = dict(zip(walls, itertools.cycle(COLOURS), strict=False))
    pieces = _pieces(diagram, column, xlim, SHOWN[unphysical])
    for wall, style, places, speeds in pieces:
        ax.plot(
            places, speeds, linestyle=STYLES[style], color=colours[wall], linewidth=WIDTHS[style]
        )
    ax.axhline(0.0, color="0.75", linewidth=0.6, zorder=0)
    if xlim:
        ax.set_xlim(*xlim)
    else:
        ax.autoscale(axis="x")
    ax.set_ylim(*(ylim or _velocity_limits(pieces, ax.get_xlim())))
    low, high = ax.get_xlim()
    entries = [e for e in diagram.entries if e.physical or e.period <= SHOWN[unphysical]]
    drawn = [e for e in entries if low <= e.parameters.get(column, np.nan) <= high]
    for entry in drawn:
        _draw_event(ax, entry, column, colours)
    _name_walls(ax, pieces, colours)
    if labels:
        _draw_labels(ax, [e for e in drawn if e.kind != "UZ"], column)
    ax.set_xlabel(symbol(column) + (f" ({unit})" if unit else ""))
    ax.set_ylabel(_velocity_label(diagram, walls))
    _draw_legend(ax, colours, [style for _, style, *_ in pieces], drawn)
    return ax


def _checked(diagram: Diagram, x: str | None, limits: dict[str, Any], unphysical: str) -> str:
    """The column on the x axis, if all that was asked for can be drawn."""
    if unphysical not in SHOWN:
        found, accepted = f"found {shown(unphysical)}", f"accepted are {', '.join(SHOWN)}"
        raise InputError("unphysical", found, accepted)
    for name, pair in limits.items():
        if pair and not (all(map(math.isfinite, pair)) and pair[0] < pair[1]):
            raise InputError(
                name, f"found {pair[0]:g} to {pair[1]:g}", "give two finite numbers, lower first"
            )
    if not diagram.branches:
        return x or ""
    column = x or diagram.branches[0].parameter
    for branch in diagram.branches:
        numbers = [name for name, v in branch.columns.items() if v.dtype.kind in "fi"]
        if column not in numbers:
            raise InputError(
                "x", f"branch {branch.id} has no numbers {shown(column)}",
                f"accepted are {', '.join(numbers)}",
            )  # fmt: skip
    return column


def save_diagram(
    diagram: Diagram, folder: Path, formats: Sequence[str], **options: Any
) -> list[str]:
    """Draw a diagram to files ``diagram.<format>``; returns their names."""
    ax = plot_diagram(diagram, **options)
    return save_figure(ax.figure, folder, "diagram", formats, diagram.name)


def new_figure(width: float = 7.2, height: float = 4.8) -> Any:
    """Return an empty figure of a size in inches."""
    return matplotlib.figure.Figure(figsize=(width, height), dpi=150, layout="constrained")


def _fixed_axes() -> Any:
    """Axes of a size that does not depend on labels and legend, in a new figure."""
    figure = matplotlib.figure.Figure(figsize=SIZE, dpi=150)
    left, bottom, width, height = AXES
    wide, high = SIZE
    return figure.add_axes((left / wide, bottom / high, width / wide, height / high))


def save_figure(
    figure: Any, folder: Path, stem: str, formats: Sequence[str], salt: str
) -> list[str]:
    """Save a figure as ``<stem>.<format>``, the same bytes every time; returns the names."""
    return write_all(Path(folder), pictures(figure, stem, formats, salt))


def pictures(figure: Any, stem: str, formats: Sequence[str], salt: str) -> dict[str, Content]:
    """Return what draws a figure as ``<stem>.<format>``, by file name."""
    return {f"{stem}.{kind}": partial(picture, figure, kind, salt) for kind in formats}


def write_figure(figure: Any, path: Path, kind: str, salt: str) -> None:
    """Write a figure to a file, the same bytes every time. Takes the arguments of `picture`.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    write(path, picture(figure, kind, salt))


def picture(figure: Any, kind: str, salt: str) -> bytes:
    """Return a figure as a file's content, the same bytes every time.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    kind : {"svg", "png", "pdf"}
    salt : str
        What names inside an SVG are made from.
    """
    undated: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    content = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": salt}):
        figure.savefig(content, format=kind, metadata=undated.get(kind))
    return content.getvalue()


def legend_mark(**style: Any) -> Any:
    """Return a line or marker for a legend."""
    return Line2D([], [], **style)


Piece = tuple[str, str, Array, Array]
"""A run of equal status of one impact: wall, style, values on the x axis, velocities."""


def _pieces(
    diagram: Diagram, x: str, xlim: tuple[float, float] | None, longest: int
) -> list[Piece]:
    """All that is drawn of branches; of unphysical orbits those up to the longest period."""
    pieces = []
    for branch in diagram.branches:
        low, high = xlim or (np.nanmin(branch[x]), np.nanmax(branch[x]))
        span = float(high - low) or 1.0
        runs = [r for r in _runs(branch) if r[2] != "unphysical" or branch.period <= longest]
        for k, wall in enumerate(branch.word):
            places, speeds, rows = _smooth(branch, x, branch[f"v{k + 1}"], span)
            for first, last, style in runs:
                piece = slice(rows[first], rows[last] + 1)
                pieces.append((wall, style, places[piece], speeds[piece]))
    return pieces


def _runs(branch: Branch) -> list[tuple[int, int, str]]:
    """Runs of equal status, each joined to the next at their common row: first row, last, style.

    The status changes at events, so a run that starts at one takes it from its other end.
    """
    status = np.where(branch.physical, np.where(branch.stable, 0, 1), 2)
    at_event = np.nonzero(branch["event"][:-1] != "")[0]
    status[at_event] = status[at_event + 1]
    edges = (np.nonzero(np.diff(status))[0] + 1).tolist()
    names = list(STYLES)
    last = len(status) - 1
    return [
        (first, min(beyond, last), names[status[first]])
        for first, beyond in zip([0, *edges], [*edges, len(status)], strict=True)
    ]


def _smooth(branch: Branch, x: str, speed: Array, span: float) -> tuple[Array, Array, Array]:
    """A branch's points, and points of a cubic in arclength where chords would be seen.

    Returns values on the x axis, velocities, and where the branch's own rows stand among them.
    """
    own = np.column_stack([branch[x], speed])
    length = branch["arclength"]
    names = list(branch.columns)
    if len(own) < 3 or names.index(x) > names.index("t1"):
        return own[:, 0], own[:, 1], np.arange(len(own))
    steps, slopes = np.diff(length), _slopes(length, own)
    size = np.array([span, float(np.ptp(speed)) or 1.0])
    bend = np.max(steps[:, None] * np.abs(np.diff(slopes, axis=0)) / (8.0 * size), axis=1)
    parts = np.clip(np.ceil(np.sqrt(np.nan_to_num(bend) / FLAT)), 1, 24).astype(int)
    rows = np.concatenate([[0], np.cumsum(parts)])
    i = np.repeat(np.arange(len(parts)), parts)
    u = ((np.arange(rows[-1]) - rows[i]) / parts[i])[:, None]
    dense = np.empty((rows[-1] + 1, 2))
    dense[:-1] = _cubic(u, steps[i, None], own[i], own[i + 1], slopes[i], slopes[i + 1])
    dense[rows] = own
    return dense[:, 0], dense[:, 1], rows


def _slopes(length: Array, values: Array) -> Array:
    """Derivatives by arclength; rows that all but coincide (events on points) share theirs."""
    apart = np.append(True, np.diff(length) > 1e-9 * (length[-1] - length[0]))
    if np.count_nonzero(apart) < 3:
        return np.zeros_like(values)
    there = np.gradient(values[apart], length[apart], axis=0, edge_order=2)
    return np.asarray(there[np.cumsum(apart) - 1])


def _cubic(u: Array, step: Array, a: Array, b: Array, da: Array, db: Array) -> Array:
    """Cubics from a to b with derivatives da and db, at fractions u of their steps."""
    bump = u * (1.0 - u)
    lean = (1.0 - u) * (step * da - (b - a)) - u * (step * db - (b - a))
    return a + u * (b - a) + bump * lean


def _velocity_limits(pieces: Sequence[Piece], seen: tuple[float, float]) -> tuple[float, float]:
    """Limits that hold zero and every velocity drawn in the x range, with a margin."""
    low, high = seen
    inside = [v[(low <= places) & (places <= high)] for _, _, places, v in pieces]
    values = np.concatenate([[0.0], *inside])
    margin = 0.06 * (values.max() - values.min() or 1.0)
    return float(values.min() - margin), float(values.max() + margin)


def _velocity_label(diagram: Diagram, walls: Sequence[str]) -> str:
    """The label of the y axis: which sign the velocity has at which wall."""
    signs = []
    for wall in walls:
        speeds = [
            b[f"v{k + 1}"][b.physical]
            for b in diagram.branches
            for k, name in enumerate(b.word)
            if name == wall
        ]
        total = float(np.sum(np.concatenate(speeds)))
        if total:
            signs.append(f"{'positive' if total > 0 else 'negative'} at {wall}")
    return "impact velocity (before impact)" + (f"\n{', '.join(signs)}" if signs else "")


def _name_walls(ax: Any, pieces: Sequence[Piece], colours: dict[str, str]) -> None:
    """Write each wall's name to the right of the curves that belong to it."""
    apart = 0.06 * float(np.ptp(ax.get_ylim()))
    taken: list[float] = []
    for wall, colour in colours.items():
        own = [p for p in pieces if p[0] == wall]
        physical = [p for p in own if p[1] != "unphysical"]
        spots = _rightmost(ax, physical) or _rightmost(ax, own)
        if not spots:
            continue
        place, speed = spots[0]
        while any(abs(speed - other) < apart for other in taken):
            speed += apart
        taken.append(speed)
        ax.annotate(
            wall, (place, speed), (4, 0), textcoords="offset points", ha="left", va="center",
            fontsize=9, fontweight="bold", color=colour, annotation_clip=False, gid="wall",
        )  # fmt: skip


def _rightmost(ax: Any, pieces: Sequence[Piece]) -> list[tuple[float, float]]:
    """The point in sight that is farthest to the right; of several, the one of largest speed."""
    (low, high), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    found: list[tuple[float, float]] = []
    for _, _, places, speeds in pieces:
        edge = np.nonzero((places[:-1] - high) * (places[1:] - high) < 0.0)[0]
        part = (high - places[edge]) / (places[edge + 1] - places[edge])
        crossing = speeds[edge] + part * (speeds[edge + 1] - speeds[edge])
        found += zip(places.tolist(), speeds.tolist(), strict=True)
        found += ((high, v) for v in crossing.tolist())
    seen = [(x, v) for x, v in found if low <= x <= high and bottom <= v <= top]
    return sorted(seen, key=lambda spot: (spot[0], abs(spot[1])))[-1:]


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
    """Put each label above the frame, over its value or near it, so that none overlap."""
    low, high = ax.get_xlim()
    width = ax.get_window_extent().width / ax.figure.dpi * 72.0
    named = _kinds_on_several_orbits(entries)
    told = {(label_text(e, e.kind in named), e.parameters[x]) for e in entries}
    for value in sorted({value for _, value in told}):
        _draw_value(ax, value)
    labels = _merged(sorted(told, key=lambda label: label[1]), 3 * GAP / width * (high - low))
    places = [(value - low) / (high - low) * width for _, value in labels]
    widths = [_text_width(text) for text, _ in labels]
    spots = _arranged(places, widths, width)
    transform = ax.get_xaxis_transform()
    for (text, value), place, (row, middle) in sorted(
        zip(labels, places, spots, strict=True), key=lambda item: -item[2][0]
    ):
        line = {"arrowstyle": "-", "color": "0.8", "linewidth": 0.5, "shrinkA": 0, "shrinkB": 0}
        ax.annotate(
            text, (value, 1.0), (middle - place, GAP + ROW * row), xycoords=transform,
            textcoords="offset points", ha="center", va="bottom", fontsize=LABEL_SIZE,
            arrowprops=line | {"relpos": (0.5, 0.0)} if row or middle != place else None,
            bbox={"boxstyle": "square,pad=0.05", "facecolor": "white", "edgecolor": "none"},
        )  # fmt: skip


def _draw_value(ax: Any, value: float) -> None:
    transform = ax.get_xaxis_transform()
    ax.plot([value] * 2, [0.0, 1.0], transform=transform, color="0.8", linewidth=0.5, zorder=0)


def _merged(labels: Sequence[tuple[str, float]], near: float) -> list[tuple[str, float]]:
    """Labels and values, a text not repeated where it stands nearby already."""
    kept: list[tuple[str, float]] = []
    for text, value in labels:
        if not any(text == other and value - before < near for other, before in kept):
            kept.append((text, value))
    return kept


def _arranged(
    places: Sequence[float], widths: Sequence[float], width: float
) -> list[tuple[int, float]]:
    """Row and middle of each label, from left to right: over its place where a row is free there,
    else shifted along the row that ends first, and in rows beyond the last where all are full."""
    edges = [-math.inf] * LABEL_ROWS
    found = []
    for place, wide in zip(places, widths, strict=True):
        free = (i for i, edge in enumerate(edges) if edge + GAP <= place - wide / 2)
        row = next(free, min(range(len(edges)), key=edges.__getitem__))
        middle = max(place, edges[row] + GAP + wide / 2)
        if middle + wide / 2 > width + 10 * GAP and middle > place:
            edges.append(-math.inf)
            row, middle = len(edges) - 1, place
        edges[row] = middle + wide / 2
        found.append((row, middle))
    return found


def _text_width(text: str) -> float:
    """Width of a label in points."""
    path = TextPath((0, 0), text.replace("\n", " ") or " ", size=LABEL_SIZE)
    return float(path.get_extents().width) if len(path.vertices) else 0.0


def _kinds_on_several_orbits(entries: Iterable[Entry]) -> set[str]:
    """Kinds of events that are found on orbits of several notations."""
    orbits: dict[str, set[str]] = {}
    for entry in entries:
        orbits.setdefault(entry.kind, set()).add(entry.notation)
    return {kind for kind, names in orbits.items() if len(names) > 1}


def label_text(entry: Entry, orbit: bool = False) -> str:
    """Return an entry's label set as in Table 1: a tilde over ghosts, words raised and lowered.

    A grazing of orbits with the period 2T, 4T, ... is PD_G. With `orbit`, labels without words
    name the orbit.
    """
    if entry.kind not in LABELLED:
        return _plain(entry.kind)
    doubled = entry.kind == "G" and entry.period > 1 and entry.period & (entry.period - 1) == 0
    name = r"\mathrm{PD}" if doubled else rf"\mathrm{{{entry.kind}}}"
    if entry.ghost:
        name = rf"\widetilde{{{name}}}"
    if doubled:
        name += r"_{\mathrm{G}}"
    elif match := re.fullmatch(rf"~?\w+\[({ORBIT})->({ORBIT})\]", entry.label):
        return f"${name}_{{{match[1]}}}^{{\\,{match[2]}}}$"
    return f"${name}$" + (f"({_plain(entry.notation)})" if orbit else "")


def _plain(text: str) -> str:
    """A text from elsewhere as it is drawn: short, in one line, none of it set as mathematics."""
    return printable(shortened(text, 40)).replace("\\", "/").replace("$", r"\$")


def symbol(name: str) -> str:
    """Return a parameter's name as it is set in labels."""
    greek = {"beta": r"$\beta$", "omega": r"$\omega$", "sigma": r"$\sigma$", "gbar": r"$\bar{g}$"}
    return greek.get(name, f"${name}$" if name else "")


def _draw_legend(
    ax: Any, colours: dict[str, str], styles: Sequence[str], entries: list[Entry]
) -> None:
    """Below the frame, what is drawn and nothing else."""
    handles = [Line2D([], [], color=colour, label=f"wall {w}") for w, colour in colours.items()]
    handles += [
        Line2D([], [], color="0.3", linestyle=STYLES[name], linewidth=WIDTHS[name], label=name)
        for name in STYLES
        if name in styles
    ]
    mark: dict[str, Any] = {"color": "0.3", "linestyle": "none", "markersize": 5}
    for kind in dict.fromkeys(e.kind for e in entries):
        label = kind if kind in MARKERS else label_text(next(e for e in entries if e.kind == kind))
        handles.append(Line2D([], [], marker=MARKERS.get(kind, "P"), label=label, **mark))
    if any(e.ghost for e in entries):
        hollow = Line2D([], [], marker=NEUTRAL, markerfacecolor="white", **mark)
        hollow.set_label("hollow: ghost")
        handles.append(hollow)
    columns = max(2, int(ax.get_window_extent().width / ax.figure.dpi * 72.0 / 72.0))
    ax.legend(
        handles=handles, loc="upper center", bbox_to_anchor=(0.5, 0.0), borderaxespad=4.6,
        ncols=columns, fontsize=8, frameon=False, handlelength=2.2, columnspacing=1.4,
    )  # fmt: skip
