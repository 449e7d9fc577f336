"""Diagrams drawn, and figures as files.

Velocities before impact, or another quantity, against a parameter: stable solid, unstable dashed,
unphysical dotted; a colour for each wall, and its name at the right end of its curves; orbits by
their notation on stable stretches; events by marker and label, ghosts hollow. Global settings of
matplotlib are not touched.
"""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib
import matplotlib.figure
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.transforms import ScaledTranslation

from ..bifurcations.kind import kind_of
from ..display import draw_result
from ..errors import InputError, count_text, explain_arguments, require_known, short_repr
from ..results.branch import Branch, Entry, require_axis
from ..results.diagram import Diagram, to_diagram
from ..results.quantities import NO_IMPACT, NO_WALL, Quantity, numbers_of
from ..results.quantities import WALLS as COLOURS
from ..storage import Content, write, write_all
from ..systems.membrane import Membrane
from .lines import (
    BAND,
    BEYOND,
    CHOICES,
    DOTS,
    FORMULAS,
    STYLES,
    UNPHYSICAL,
    WIDTHS,
    branches_drawn_whole,
    choose_events,
    draw_guides,
    draw_labels,
    fixed_values,
    label_axis,
    limits_of,
    marks_of,
    name_orbits,
    name_walls,
    ordinate_label,
    pieces_of,
    plain_text,
    series_by_branch,
    shade_margins,
    text_width,
    units_of,
    values_text,
    walls_of,
)

# Figures that notebooks show by themselves, without a backend.

SHOWN_DOTS = 100
"""Per inch, in notebooks."""


class Canvas(FigureCanvasAgg):
    """A canvas on which a formula is laid out once, whatever size its figure takes."""

    def get_renderer(self) -> Any:
        """Return matplotlib's renderer, with the layouts that those before it have made."""
        renderer: Any = super().get_renderer()
        renderer.mathtext_parser = FORMULAS
        return renderer


class Figure(matplotlib.figure.Figure):
    """A figure that is its own picture in Jupyter."""

    def __init__(self, *given: Any, **options: Any) -> None:
        super().__init__(*given, **options)
        Canvas(self)

    def _repr_png_(self) -> bytes:
        content = io.BytesIO()
        self.savefig(content, format="png", dpi=SHOWN_DOTS)
        return content.getvalue()


NEUTRAL = "h"
"""The marker of no kind of event, for what the legend says of all kinds."""
SIZE = (7.2, 5.6)
AXES = (1.0, 1.2, 5.9, 3.1)
"""A diagram's figure, and in it the axes (left, bottom, width, height), in inches."""
BELOW = 0.26, 0.8
"""How far below them the axes of `axes_below` are, and how high."""


@explain_arguments
def plot_diagram(
    diagram: Diagram | Branch | Sequence[Branch],
    ax: Any = None,
    *,
    x: str | None = None,
    y: Quantity = "velocity",
    xlim: tuple[float, float] | None = None,
    ylim: tuple[float, float] | None = None,
    unphysical: str = "period-1",
    labels: bool | str = True,
    unit: str = "",
    membrane: Membrane | None = None,
    margin: float | None = None,
) -> Any:
    """Draw a diagram.

    Parameters
    ----------
    diagram : Diagram, Branch or sequence of Branch
    ax : matplotlib.axes.Axes or str, optional
        Where to draw; a new figure otherwise. A text is `x`.
    x : str, optional
        The column on the x axis; the followed parameter by default.
    y : str or callable
        The quantity on the y axis: ``velocity``, ``multipliers`` (their real parts), ``moduli``,
        ``energy`` (the output voltage of each impact), ``U_I``, ``U_T``, ``gap``, ``period``, a
        numeric column, or a function of a branch that returns an array with a row for each point.
    xlim, ylim : (low, high), optional
    unphysical : {"period-1", "all", "none"}
        On which branches unphysical orbits and their events are drawn: those of period T that
        are physical somewhere, all, or none.
    labels : {"all", "period-1", "real", "none"} or bool
        Which events are labelled above the frame: all, those on orbits of period T, those that are
        no ghosts, or none; True is all of them. Labels that find no room are left out, those of
        ghosts and of long orbits first, and the legend counts them.
    unit : str
        Unit of x, for the axis label.
    membrane : Membrane, optional
        Of the voltages; with the paper's values by default.
    margin : float, optional
        Stretches of stable orbits with a smaller margin are shaded; needs branches with the column
        ``margin``, see ``[margins]`` of scenes.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        For a quantity or a column that the branches do not have or that holds texts, limits that
        are not finite and increasing, or another value of `unphysical` or `labels`.
    """
    diagram = to_diagram(diagram)
    if isinstance(ax, str):
        ax, x = None, ax
    labelled = labels if isinstance(labels, str) else "all" if labels else "none"
    if margin is not None and not any("margin" in b.columns for b in diagram.branches):
        raise InputError("margin", "no branch has margins", "follow a scene with [margins]")
    column = _check_request(diagram, x, {"xlim": xlim, "ylim": ylim}, unphysical, labelled)
    own = ax is None
    if ax is None:
        ax = fixed_axes()
        write_heading(ax.figure, heading(diagram))
    series = series_by_branch(diagram, y, membrane)
    names = list(dict.fromkeys(n for one in series for n in sorted(each.name for each in one)))
    known = colours_of(walls_of(diagram.branches, names))
    colours = {name: colour for name, colour in known.items() if name in names}
    whole = branches_drawn_whole(diagram, unphysical)
    pieces = pieces_of(diagram, series, column, xlim, whole)
    broken: dict[tuple[str, str], list[Any]] = {}
    for wall, style, places, speeds, _ in pieces:
        (line,) = ax.plot(
            places, speeds, linestyle=STYLES[style], color=colours[wall], linewidth=WIDTHS[style]
        )
        if style != "stable":
            broken.setdefault((wall, style), []).append(line)
    shaded = margin is not None and shade_margins(ax, diagram, series, column, margin)
    draw_guides(ax, y)
    if xlim:
        ax.set_xlim(*xlim)
    else:
        ax.autoscale(axis="x")
    ax.set_ylim(*(ylim or limits_of(pieces, ax.get_xlim(), y)))
    for lines in broken.values():
        _part_lines(ax, lines)
    low, high = ax.get_xlim()
    entries = [e for e in diagram.entries if e.physical or e.branch in whole]
    drawn = [e for e in entries if low <= e.parameters.get(column, np.nan) <= high]
    for entry in sorted(drawn, key=lambda e: not e.ghost):  # real ones on top
        _draw_event(ax, entry, column, known, marks_of(diagram, series, entry, y))
    name_walls(ax, pieces, colours)
    left_out = draw_labels(ax, choose_events(drawn, labelled), column)
    if labelled != "none":
        left_out += name_orbits(ax, pieces)
    label_axis(ax.xaxis, column, unit)
    ax.set_ylabel(ordinate_label(diagram, y, names))
    if ax.get_yscale() == "linear":  # narrow numbers: the room is fixed
        ax.ticklabel_format(axis="y", scilimits=(-2, 4), useMathText=True)
    power, width = ax.yaxis.get_offset_text(), ax.get_window_extent().width
    power.set(ha="right", x=-BEYOND * ax.figure.dpi / 72.0 / width)  # where no label of an event is
    styles = [style for _, style, _, values, _ in pieces if np.sum(np.isfinite(values)) > 1]
    handles = legend_handles(colours, styles, drawn, left_out)
    if shaded:
        handles.append(legend_mark(**BAND, label=f"margin below {margin:g}"))
    draw_legend(ax, handles)
    if own:
        fit(ax)
    return ax


ALONG = 12.0
"""Pixels on which a line follows another one before it is left out there."""


def _part_lines(ax: Any, lines: Sequence[Any]) -> None:
    """Leave out of dotted or dashed lines of one look what lies on an earlier one of them, whose
    gaps it would fill."""
    taken = np.zeros(np.ceil(ax.bbox.size).astype(int) + 3, dtype=bool)  # pixels, and those around
    for line in lines:
        x, y = (np.asarray(values, dtype=float) for values in line.get_data())
        if len(x) < 2:
            continue
        pixels = ax.transData.transform(np.column_stack([x, y])) - ax.bbox.min + 1.0
        shown = np.all((pixels >= 1.0) & (pixels <= ax.bbox.size + 1.0), axis=1)
        segments = np.nonzero(shown[:-1] & shown[1:])[0]
        steps = np.diff(pixels, axis=0)[segments]
        lengths = np.hypot(*steps.T)
        counts = 2 + (2.0 * lengths).astype(int)
        each = np.repeat(np.arange(len(segments)), counts)
        parts = (np.arange(len(each)) - np.repeat(np.cumsum(counts) - counts, counts)) / (
            counts[each] - 1.0
        )
        at = np.rint(pixels[segments[each]] + parts[:, None] * steps[each]).astype(int)
        hidden = np.zeros(len(x) - 1, dtype=bool)
        free = np.bincount(each, ~taken[at[:, 0], at[:, 1]], len(segments))
        hidden[segments] = free == 0.0
        long = np.zeros(len(x) - 1)
        long[segments] = lengths
        edges = [0, *(np.nonzero(np.diff(hidden))[0] + 1).tolist(), len(hidden)]
        for first, last in itertools.pairwise(edges):
            hidden[first:last] &= np.sum(long[first:last]) >= ALONG
        after = np.nonzero(hidden)[0] + 1
        line.set_data(np.insert(x, after, np.nan), np.insert(y, after, np.nan))
        for i, j in itertools.product((-1, 0, 1), repeat=2):
            taken[at[:, 0] + i, at[:, 1] + j] = True


FARTHEST = 1e100
"""Largest limit of an axis: squares of what is drawn do not overflow."""


def _check_request(
    diagram: Diagram, x: str | None, limits: dict[str, Any], unphysical: str, labels: str
) -> str:
    """The column on the x axis; raises `InputError` if a request cannot be drawn."""
    require_known(unphysical, UNPHYSICAL, "unphysical")
    require_known(labels, CHOICES, "labels")
    for name, pair in limits.items():
        if pair and not (all(map(math.isfinite, pair)) and pair[0] < pair[1]):
            raise InputError(
                name, f"found {pair[0]:g} to {pair[1]:g}", "give two finite numbers, lower first"
            )
        if pair and max(map(abs, pair)) > FARTHEST:
            raise InputError(name, f"found {pair[0]:g} to {pair[1]:g}", f"at most {FARTHEST:g}")
    if not diagram.branches:
        return x or ""
    column = x or diagram.branches[0].parameter
    for branch in diagram.branches:
        found = f"branch {branch.id} has no numbers {short_repr(column)}"
        require_known(column, numbers_of(branch), "x", found)
    if column in diagram.branches[0].parameters:
        require_axis(diagram.branches, column, "x", "")
    return column


def save_diagram(
    diagram: Diagram, folder: Path, formats: Sequence[str], **options: Any
) -> list[str]:
    """Draw a diagram to files ``diagram.<format>``; returns their names."""
    ax = plot_diagram(diagram, **options)
    return save_figure(ax.figure, folder, "diagram", formats, diagram.name)


def new_figure(width: float = 7.2, height: float = 4.8) -> Any:
    """Return an empty figure of a size in inches."""
    return Figure(figsize=(width, height), dpi=DOTS, layout="constrained")


def fixed_axes() -> Any:
    """Return axes of a size that does not depend on labels and legend, in a new figure."""
    figure = Figure(figsize=SIZE, dpi=DOTS)
    left, bottom, width, height = AXES
    wide, high = SIZE
    return figure.add_axes((left / wide, bottom / high, width / wide, height / high))


def colours_of(names: Sequence[str]) -> dict[str, str]:
    """Return a colour for each series, such as those of walls."""
    walls = [name for name in names if name != NO_IMPACT]
    found = dict(zip(walls, itertools.cycle(COLOURS), strict=False))
    return {name: found.get(name, NO_WALL) for name in names}


def axes_below(ax: Any) -> Any:
    """Return flat axes below those of `fixed_axes`, which share its x axis and take its legend."""
    left, bottom, width, _ = ax.get_position().bounds
    low, high = (part / ax.figure.get_figheight() for part in BELOW)
    below = ax.figure.add_axes((left, bottom - low - high, width, high))
    ax.tick_params(labelbottom=False)
    ax.set_xlabel("")
    if (legend := ax.get_legend()) is not None:
        legend.remove()
    return below


def fit(ax: Any, lowest: Any = None) -> None:
    """Make the figure of `fixed_axes`, and of `axes_below`, as high as labels and legend need."""
    figure, dots = ax.figure, ax.figure.dpi
    figure.draw_without_rendering()
    frame = ax.get_window_extent()
    texts = [t for t in ax.texts if t.get_gid() == "event"]
    above = max([0.0, *(Text.get_window_extent(t).y1 - frame.y1 for t in texts)]) / dots + 0.3
    below = (frame.y0 - (lowest or ax).get_legend().get_window_extent().y0) / dots + 0.06
    left, _, width, height = AXES
    wide, high = SIZE[0], below + height + above
    figure.set_size_inches(wide, high)
    ax.set_position((left / wide, below / high, width / wide, height / high))
    if lowest is not None:
        gap, low = BELOW
        lowest.set_position((left / wide, (below - gap - low) / high, width / wide, low / high))


def heading(diagram: Diagram) -> str:
    """Return what a diagram is of: its name and the parameters that are fixed."""
    if not diagram.branches:
        return plain_text(diagram.name, 60)
    fixed = values_text(fixed_values(diagram.branches), units_of(diagram.branches[0].system))
    return ": ".join(part for part in (plain_text(diagram.name, 60), fixed) if part)


def write_heading(figure: Any, text: str) -> None:
    """Write a line at the upper edge of a figure, as large as there is room for."""
    wide = figure.get_figwidth()
    if figure.legends:
        figure.draw_without_rendering()
    beside = [legend.get_window_extent().width / figure.dpi for legend in figure.legends]
    free = wide - max(beside, default=0.0) - 0.2  # a legend at the right reaches up to here
    room = 72.0 * free / max(text_width(text), 1.0)
    look: dict[str, Any] = {"fontsize": min(8.0, 8.0 * room), "gid": "heading"}
    if figure.get_layout_engine() is not None:
        figure.suptitle(text, x=(0.1 + 0.5 * free) / wide, **look)
    else:
        top = figure.transFigure + ScaledTranslation(0.0, -0.06, figure.dpi_scale_trans)
        figure.text(0.5, 1.0, text, ha="center", va="top", transform=top, **look)


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

    Raises InputError if the file cannot be written.
    """
    write(path, picture(figure, kind, salt))


def picture(figure: Any, kind: str, salt: str) -> bytes:
    """Return a figure as a file's content, the same bytes every time; names inside an SVG are made
    from `salt`."""
    undated: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    content = io.BytesIO()
    with matplotlib.rc_context({"svg.hashsalt": salt}):
        figure.savefig(content, format=kind, metadata=undated.get(kind))
    return content.getvalue()


def legend_mark(**style: Any) -> Any:
    """Return a line or marker for a legend."""
    return Line2D([], [], **style)


def _draw_event(
    ax: Any, entry: Entry, x: str, colours: dict[str, str], marks: Sequence[tuple[str | None, Any]]
) -> None:
    for name, value in marks:
        colour, marker = colours.get(name or "", "k"), kind_of(entry.kind).look.marker
        look = {"color": colour, "markerfacecolor": "white" if entry.ghost else colour}
        mark: dict[str, Any] = {"linestyle": "none", "marker": marker, "markersize": 5.0}
        ax.plot(entry.parameters[x], value, zorder=5, **mark, **look)


def legend_handles(
    colours: dict[str, str], styles: Sequence[str], entries: Sequence[Entry], left_out: int = 0
) -> list[Any]:
    """Return lines and markers for what is drawn and nothing else: colours by wall, or by the name
    of another series, and those of `STYLES` in use; `left_out` counts the labels without a
    place."""
    handles = [
        legend_mark(color=colour, label=f"wall {name}" if len(name) == 1 else plain_text(name))
        for name, colour in colours.items()
    ]
    handles += style_marks(styles)
    mark: dict[str, Any] = {"color": "0.3", "linestyle": "none", "markersize": 5}
    for kind in dict.fromkeys(e.kind for e in entries):
        marker = kind_of(kind).look.marker
        handles.append(legend_mark(marker=marker, label=plain_text(kind), **mark))
    if left_out:
        text = f"no room for {count_text(left_out, 'label')}"
        handles.append(legend_mark(linestyle="none", label=text))
    if any(e.ghost for e in entries):
        hollow = legend_mark(marker=NEUTRAL, markerfacecolor="white", **mark)
        hollow.set_label("hollow: ghost")
        handles.append(hollow)
    return handles


def style_marks(styles: Sequence[str]) -> list[Any]:
    """Return lines for those of `STYLES` that are in use."""
    labels = {"unknown": "status unknown"}
    return [
        legend_mark(
            label=labels.get(name, name), color="0.3", linestyle=look, linewidth=WIDTHS[name]
        )
        for name, look in STYLES.items()
        if name in styles
    ]


def draw_legend(ax: Any, handles: Sequence[Any]) -> None:
    """Draw a legend below the frame, in as many columns as fit into the figure."""
    below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0)}
    sizes = {"borderaxespad": 4.6, "fontsize": 8, "handlelength": 2.2, "columnspacing": 1.4}
    frame, room = ax.get_window_extent(), ax.figure.get_window_extent()
    room = 2.0 * min(frame.x0 + 0.5 * frame.width, room.width - frame.x0 - 0.5 * frame.width)
    for columns in range(max(2, int(frame.width / ax.figure.dpi)), 0, -1):
        legend = ax.legend(handles=list(handles), ncols=columns, frameon=False, **below, **sizes)
        if legend.get_window_extent().width <= room:
            break


@draw_result.register
def _(result: Branch, *x: Any, **options: Any) -> Any:
    return plot_diagram(result, *x, **{"unphysical": "all", **options})
