"""Curves, areas, codimension two and transitions in the plane of two parameters.

A panel for each member of the family and each pair of parameters; PD blue, G green, FB orange, BP
and V in further colours, a second bifurcation of a kind in a colour of its own; ghosts dotted;
points of codimension two marked. Areas are tinted by the bifurcation that ends the stable orbits in
them as the quantity on the y axis falls; without areas a band under each panel tells which
bifurcation comes first. Curves of a single panel are named where they leave it to the right.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as OutlinePath

from ..arrays import Array
from ..bifurcations.codimension_two import MARKERS, OTHER_NAMES
from ..bifurcations.kind import kind_of
from ..display import draw_result
from ..errors import InputError, explain_arguments, require_known, short_repr
from ..results.curve import (
    Area,
    Check,
    Curve,
    Key,
    Region,
    StableOrbit,
    colour_of,
    falling_column,
    key_of,
    keys_of,
    lanes,
    panel_areas,
    panels,
    regions,
)
from ..results.diagram import Diagram
from ..simulation.attractor import Kind
from ..simulation.sweep import Row, Sweep
from .diagram import legend_mark, new_figure, plot_diagram, save_figure, write_heading
from .lines import HALO, label_axis, plain_text, set_label, symbol, values_text

# Outlines with as few points as are seen.

SEEN = 3e-4
"""Part of a picture below which a departure from a line is not seen."""


def thin_ring(points: Array, corners: Sequence[int]) -> Array:
    """Return the numbers of the points of a closed ring that are seen (Ramer, Douglas and Peucker),
    the first and the last among them; points (P, 2) are in parts of the picture. Corners are kept,
    so that neighbours keep the same ones."""
    last = len(points) - 1
    opposite = int(np.argmax(np.hypot(*(points - points[0]).T)))
    kept = {0, opposite, last, *corners}
    waiting = list(itertools.pairwise(sorted(kept)))
    while waiting:
        first, last = waiting.pop()
        away = _off_chord(points[first : last + 1])
        if len(away) and away.max() > SEEN:
            middle = first + 1 + int(np.argmax(away))
            kept.add(middle)
            waiting += [(first, middle), (middle, last)]
    return np.array(sorted(kept))


def _off_chord(points: Array) -> Array:
    """How far the inner points of an arc are from its chord."""
    chord = points[-1] - points[0]
    away = points[1:-1] - points[0]
    length = math.hypot(*chord) or 1.0
    return np.asarray(np.abs(chord[0] * away[:, 1] - chord[1] * away[:, 0]) / length)


# Areas of a map of two parameters: tinted by what ends the stable orbits in them.
#
# The tint is the colour of the curve at which the stable orbit ends. Areas are hatched by kind,
# those of a second bifurcation of a kind the other way, so that they are told without colours too,
# and crossed where several orbits are stable. White is where none is.

TINT, DARKEST = 0.28, 0.84
"""Share of a curve's colour in the area of the orbits that end at it, and the shade than which none
is darker."""
THROUGHOUT = "0.93"
HATCHED = "0.55"
"""Colour of hatches."""
CROSSED: dict[str, Any] = {
    "facecolor": "none",
    "edgecolor": HATCHED,
    "hatch": "xxxx",
    "linewidth": 0.0,
}
"""What is drawn over an area where several orbits are stable."""

Colours = Callable[[StableOrbit], str]


def draw_areas(ax: Any, areas: Sequence[Area], colours: Colours) -> None:
    """Tint areas below all else, by ``colours(orbit)``, that of the curve at which an orbit
    ends."""
    sizes = np.ptp(np.vstack([area.polygon[0] for area in areas]), axis=0)
    for area in areas:
        look, path = _region_style(area.orbits[0], colours), _path(area, sizes)
        sharp = {"linewidth": 0.0, "antialiased": False}  # no seams between areas
        ax.add_patch(PathPatch(path, zorder=0.5, **sharp, **look))
        if area.bistable:
            ax.add_patch(PathPatch(path, zorder=0.6, **CROSSED))


def area_legend(areas: Sequence[Area], colours: Colours) -> list[Patch]:
    """Return the keys to the tints of some areas, each once."""
    several = len({o.notation for area in areas for o in area.orbits}) > 1
    keys = {_text_of_area(area.orbits[0], several): area.orbits[0] for area in areas}
    found = [Patch(label=text, **_region_style(orbit, colours)) for text, orbit in keys.items()]
    if any(area.bistable for area in areas):
        found.append(Patch(label="several stable orbits", **CROSSED))
    return found


def _region_style(orbit: StableOrbit, colours: Colours) -> dict[str, Any]:
    if orbit.kind is None:
        return {"facecolor": THROUGHOUT, "edgecolor": HATCHED}
    colour = 1.0 - TINT * (1.0 - np.array(to_rgb(colours(orbit))))
    colour = np.maximum(colour, DARKEST if colour.max() < DARKEST else 0.0)
    own = kind_of(orbit.kind).look
    hatch = own.hatch
    if hatch and colours(orbit) != own.colour:  # a second bifurcation of a kind
        hatch = hatch.replace("/", "\\")
    return {"facecolor": tuple(colour), "edgecolor": HATCHED, "hatch": hatch}


def _text_of_area(orbit: StableOrbit, several: bool) -> str:
    name = orbit.notation if several else ""
    if orbit.kind is not None and orbit.ends is not None:
        return f"stable until {set_label(orbit.kind, orbit.ends, name)}"
    until = f"stable until {plain_text(orbit.ends)}" if orbit.ends else "stable throughout"
    return until + (f" ({plain_text(name)})" if name else "")


def _path(area: Area, sizes: Array) -> OutlinePath:
    """An area's outline as it is seen in a picture of some size; holes run the other way round."""
    rings, codes = [], []
    for points, borders in zip(map(np.asarray, area.polygon), area.borders, strict=True):
        rings.append(points[thin_ring(points / sizes, [place for place, _ in borders])])
        codes += [
            OutlinePath.MOVETO,
            *[OutlinePath.LINETO] * (len(rings[-1]) - 2),
            OutlinePath.CLOSEPOLY,
        ]
    return OutlinePath(np.vstack(rings), codes)


POINT: dict[str, Any] = {"color": "k", "linestyle": "none", "markersize": 4.5}
LANE = 0.04
"""Height of a row of bands, as a part of the axes'."""
BAND: dict[str, Any] = {"alpha": 0.6, "edgecolor": "white", "linewidth": 0}


@dataclass(frozen=True)
class Panel:
    """The curves of one member of the family in one pair of parameters.

    `along` is the column on the y axis, `across` that on the x axis, the second parameter.
    """

    curves: Sequence[Curve]
    fixed: Mapping[str, float]
    along: str
    across: str


@explain_arguments
def plot_curves(
    curves: Curve | Diagram | Sequence[Curve],
    axes: Any = None,
    *,
    along: str | None = None,
    units: Mapping[str, str] | None = None,
    checks: Sequence[Check] = (),
    areas: Sequence[Area] = (),
    xlim: tuple[float, float] | None = None,
    ylim: tuple[float, float] | None = None,
) -> Any:
    """Draw curves, one panel for each member of their family and each pair of parameters.

    Parameters
    ----------
    curves : Curve, Diagram or sequence of Curve
    axes : sequence of matplotlib.axes.Axes, optional
        One for each panel; a new figure otherwise.
    along : str, optional
        The parameter on the y axis. By default the curve's first one, or a derived parameter that
        is that one, or its reciprocal, times a constant: ``d`` of the impact pair where s or A is
        followed.
    units : mapping of str to str, optional
        Of parameters, for the labels of axes.
    checks : sequence of Check, optional
        One-parameter runs; bands that none of them confirms are drawn half as high.
    areas : sequence of Area, optional
        Tinted below the curves; a panel that has areas has no band.
    xlim, ylim : (low, high), optional
        Limits of the axes. Curves that do not enter them have no entry in the legend.

    Returns
    -------
    list of matplotlib.axes.Axes

    Raises
    ------
    InputError
        For no curves, a parameter that they do not have, or axes that are too few.
    """
    if isinstance(curves, Diagram):
        curves = curves.curves
    curves = [curves] if isinstance(curves, Curve) else list(curves)
    if not curves:
        raise InputError("curves", "empty", "give at least one curve")
    panels = _panels(curves, along)
    axes = list(np.ravel(_axes(panels) if axes is None else axes))
    if len(axes) < len(panels):
        raise InputError("axes", f"found {len(axes)}", f"give {len(panels)}, one for each panel")
    keys = keys_of(curves)
    bands, tinted = [], []
    for ax, panel in zip(axes, panels, strict=False):
        _draw_panel(ax, panel, keys, units or {})
        if own := panel_areas(areas, panel.fixed, panel.across, panel.along):
            draw_areas(ax, own, partial(_end_colour, keys))
            tinted += own
        else:
            bands += _draw_regions(ax, panel, keys, checks)
    for ax in axes[: len(panels)]:  # after all: this ends scaling by data, also of shared axes
        ax.set_xlim(xlim)
        ax.set_ylim(ylim)
    if len(panels) == 1:
        _name_ends(axes[0], panels[0], keys)
    _draw_legend(
        axes[0],
        panels,
        keys,
        [*area_legend(tinted, partial(_end_colour, keys)), *_band_key(panels, bands)],
    )
    return axes


def save_curves(
    curves: Sequence[Curve],
    folder: Path,
    formats: Sequence[str],
    checks: Sequence[Check] = (),
    units: Mapping[str, str] | None = None,
    areas: Sequence[Area] = (),
) -> list[str]:
    """Draw curves to files ``curves.<format>``; returns their names.

    Of several pairs of parameters each has a picture, ``curves-s-r.<format>``.
    """
    pairs = list(dict.fromkeys(curve.parameters for curve in curves))
    written = []
    for pair in pairs:
        own = [curve for curve in curves if curve.parameters == pair]
        name = "curves" if len(pairs) == 1 else f"curves-{'-'.join(pair)}"
        axes = plot_curves(own, units=units, checks=checks, areas=areas)
        write_heading(axes[0].figure, values_text(fixed_values(own), units or {}))
        written += save_figure(axes[0].figure, folder, name, formats, "curves")
    return written


# Panels.


def _panels(curves: Sequence[Curve], along: str | None) -> list[Panel]:
    """The curves by member of the family and pair of parameters."""
    return [
        Panel(group, group[0].fixed, _column(group, along), group[0].parameters[1])
        for group in panels(curves)
    ]


def _column(curves: Sequence[Curve], along: str | None) -> str:
    """The column on the y axis: the one asked for, or the one that falls."""
    if along is None:
        return falling_column(curves)
    found = f"curve {curves[0].id} has no parameter {short_repr(along)}"
    require_known(along, curves[0].parameter_columns, "along", found)
    return along


def fixed_values(curves: Sequence[Curve]) -> dict[str, float]:
    """Parameters that are the same on all curves."""
    found = {}
    for name in curves[0].parameter_columns:
        values = {value for c in curves for value in (c[name].min(), c[name].max())}
        if len(values) == 1:
            found[name] = float(values.pop())
    return found


def _axes(panels: Sequence[Panel]) -> Any:
    """Axes for panels in rows of four, in a new figure; limits are shared where all fit."""
    columns = min(len(panels), 4)
    rows = -(-len(panels) // columns)
    size = (3.0 * columns + 1.2, 2.7 * rows + 0.7) if len(panels) > 1 else (6.2, 4.4)
    figure = new_figure(*size)
    one = len({p.across for p in panels}) == 1
    spans = [np.ptp(np.concatenate([c[p.along] for c in p.curves])) for p in panels]
    alike = len({p.along for p in panels}) == 1 and max(spans) < 3.0 * min(spans)
    axes = np.ravel(figure.subplots(rows, columns, sharex=one, sharey=alike, squeeze=False))
    for ax in axes[len(panels) :]:
        ax.set_visible(False)
    for ax in axes[max(len(panels) - columns, 0) : len(panels)]:  # nothing stands below these
        ax.tick_params(labelbottom=True)
    return axes[: len(panels)]


# Drawing.


def _draw_panel(ax: Any, panel: Panel, keys: Sequence[Key], units: Mapping[str, str]) -> None:
    for curve in panel.curves:
        _draw_curve(ax, curve, panel, colour_of(key_of(curve), keys))
        for point in curve.points:
            place = (point.parameters[panel.across], point.parameters[panel.along])
            ax.plot(*place, marker=_marker(point.kind), zorder=5, **POINT)
    if ax.xaxis.get_tick_params().get("labelbottom", True):
        label_axis(ax.xaxis, panel.across, units.get(panel.across, ""))
    if ax.yaxis.get_tick_params().get("labelleft", True):
        label_axis(ax.yaxis, panel.along, units.get(panel.along, ""))
    if panel.fixed:
        ax.set_title(values_text(panel.fixed, units), fontsize=9)


def _draw_curve(ax: Any, curve: Curve, panel: Panel, colour: str) -> None:
    """Draw runs of equal status."""
    ghost = curve.ghost_pieces
    edges = np.nonzero(np.diff(ghost.astype(int)))[0] + 1
    x, y, width = curve[panel.across], curve[panel.along], kind_of(curve.kind).look.width
    for first, last in zip([0, *edges], [*edges, len(ghost)], strict=True):
        piece = slice(first, min(last + 1, len(ghost)))
        style = (0, (1, 1.4)) if ghost[first] else "-"
        ax.plot(x[piece], y[piece], color=colour, linestyle=style, linewidth=width)


def _draw_regions(
    ax: Any, panel: Panel, keys: Sequence[Key], checks: Sequence[Check]
) -> list[Region]:
    found = regions(panel.curves, panel.along, checks)
    rows = lanes(found)
    room = LANE * (max(rows, default=-1) + 1)
    if found and room < 0.5:  # bands stand below the curves
        values = np.concatenate([curve[panel.along] for curve in panel.curves])
        below = values.min() - room / (1.0 - room) * np.ptp(values)
        ax.update_datalim([(panel.curves[0][panel.across][0], below)])
        ax.autoscale_view()
    named = dict(reversed([*zip(rows, found, strict=True)]))
    for lane, region in named.items() if len({r.notation for r in found}) > 1 else ():
        look: dict[str, Any] = {"fontsize": 6.5, "va": "bottom", "path_effects": HALO}
        look["transform"] = ax.get_xaxis_transform()
        text = f" {plain_text(region.notation)}"
        ax.text(region.low, LANE * (lane + 0.35), text, clip_on=True, gid="orbit", **look)
    for region, lane in zip(found, rows, strict=True):
        key = next(k for k in keys if k.label == region.first and k.notation == region.notation)
        low, height = LANE * lane, (0.375 if region.said else 0.75) * LANE
        look = {"facecolor": colour_of(key, keys), "hatch": kind_of(key.kind).look.hatch, **BAND}
        ax.axvspan(region.low, region.high, ymin=low, ymax=low + height, **look)
    return found


def _end_colour(keys: Sequence[Key], orbit: StableOrbit) -> str:
    """The colour of the curve at which an orbit ends."""
    own = Key(orbit.kind or "", orbit.ends or "", orbit.notation)
    return colour_of(own, keys) if own in keys else kind_of(own.kind).look.colour


def _name_ends(ax: Any, panel: Panel, keys: Sequence[Key]) -> None:
    """Name curves where they leave the picture to the right, as far as names fit beside it."""
    apart, high = 0.045 * float(np.ptp(ax.get_ylim())), ax.get_xlim()[1]
    bottom, top = ax.get_ylim()
    spots = []
    for curve in panel.curves:
        x, y = curve[panel.across], curve[panel.along]
        over = np.nonzero((x[:-1] - high) * (x[1:] - high) <= 0.0)[0]
        ends = [float(y[k]) for k in over] or [float(y[np.argmax(x)])] * bool(
            x.max() > high - 0.06 * np.ptp(ax.get_xlim())
        )
        spots += [(value, key_of(curve)) for value in ends if bottom <= value <= top]
    before = -np.inf
    for value, key in sorted(set(spots)):
        place = max(value, before + apart)
        if place > top:
            break
        before = place
        look: dict[str, Any] = {"fontsize": 7.5, "va": "center", "annotation_clip": False}
        where: dict[str, Any] = {"xycoords": ax.get_yaxis_transform(), "gid": "end"}
        where |= {"textcoords": "offset points", "color": colour_of(key, keys)}
        ax.annotate(_text(key, keys), (1.0, place), (4, 0), **where, **look)


def _marker(kind: str) -> str:
    return MARKERS.get(OTHER_NAMES.get(kind, kind), "P")


def _draw_legend(
    ax: Any, panels: Sequence[Panel], keys: Sequence[Key], further: Sequence[Any]
) -> None:
    seen = _visible(ax, panels)
    handles = [
        legend_mark(color=colour_of(k, keys), lw=kind_of(k.kind).look.width, label=_text(k, keys))
        for k in keys
        if k in seen
    ]
    curves = [c for panel in panels for c in panel.curves]
    if any(c.ghost.any() for c in curves):
        handles.append(legend_mark(color="0.3", linestyle=(0, (1, 1.4)), label="ghost"))
    kinds = (p.kind for c in curves for p in c.points)
    for kind in dict.fromkeys(OTHER_NAMES.get(k, k) for k in kinds):
        marker = _marker(kind)
        handles.append(legend_mark(color="k", ls="none", marker=marker, ms=4.5, label=kind))
    legend_beside(ax.figure, [*handles, *further], fontsize=7.5, handlelength=1.8)


def legend_beside(figure: Any, handles: Sequence[Any], **look: Any) -> None:
    """Draw a legend right of the axes, in as many columns as the figure's height needs."""
    look |= {"handles": handles, "loc": "outside right upper", "frameon": False}
    legend = figure.legend(**look)
    columns = math.ceil(legend.get_window_extent().height / figure.bbox.height)
    if columns > 1:
        legend.remove()
        figure.legend(**look, ncols=columns, columnspacing=1.0)


def _visible(ax: Any, panels: Sequence[Panel]) -> set[Key]:
    """The keys of curves that enter the limits of the axes."""
    (left, right), (bottom, top) = map(sorted, (ax.get_xlim(), ax.get_ylim()))
    found = set()
    for panel in panels:
        for curve in panel.curves:
            x, y = curve[panel.across], curve[panel.along]
            if np.any((x >= left) & (x <= right) & (y >= bottom) & (y <= top)):
                found.add(key_of(curve))
    return found


def _band_key(panels: Sequence[Panel], bands: Sequence[Region]) -> list[Any]:
    """The key to the bands, if there are any."""
    if not bands:
        return []
    falling = " or ".join(dict.fromkeys(symbol(panel.along) for panel in panels))
    unconfirmed = any(region.said for region in bands)
    first = f"first as {falling} falls" + "\n(half as high: not checked)" * unconfirmed
    return [legend_mark(color="0.5", lw=4, alpha=0.6, label=first)]


def _text(key: Key, keys: Sequence[Key]) -> str:
    """A bifurcation as in Table 1; with its orbit where there are several."""
    several = len({k.notation for k in keys}) > 1
    return set_label(key.kind, key.label, key.notation if several else "")


# Curves of points of codimension two in three parameters, as projections.

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#B87400", "#56B4E9", "0.3")
DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (4, 1.5, 1, 1.5)), (0, (1, 1.2)))


@explain_arguments
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
        axes = new_figure(11.4, 3.4).subplots(1, 3)
    axes = list(np.ravel(axes))
    kinds = list(dict.fromkeys((c.kind, c.notation) for c in curves))
    first = falling_column(curves)
    planes = ((third, second), (third, first), (second, first))
    for ax, (across, along) in zip(axes, planes, strict=False):
        for curve in curves:
            _draw(ax, curve, across, along, kinds.index((curve.kind, curve.notation)))
        label_axis(ax.xaxis, across, (units or {}).get(across, ""))
        label_axis(ax.yaxis, along, (units or {}).get(along, ""))
    _legend(axes[0], curves, kinds)
    return axes


def _draw(ax: Any, curve: Curve, across: str, along: str, place: int) -> None:
    look = _look_of_point(place)
    ax.plot(curve[across], curve[along], **look)
    for point in curve.points:
        at = (point.parameters[across], point.parameters[along])
        ax.plot(*at, marker="o", color=look["color"], markersize=4, markerfacecolor="w")


def _look_of_point(place: int) -> dict[str, Any]:
    return {
        "color": COLOURS[place % len(COLOURS)],
        "linestyle": DASHES[place % len(DASHES)],
        "linewidth": 1.4,
    }


def _legend(ax: Any, curves: Sequence[Curve], kinds: Sequence[tuple[str, str]]) -> None:
    several = len({notation for _, notation in kinds}) > 1
    handles = [
        legend_mark(
            label=kind + (f" ({plain_text(notation)})" if several else ""), **_look_of_point(place)
        )
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
        handles.append(legend_mark(label="turn, or codimension three", **look))
    legend_beside(ax.figure, handles, fontsize=8)


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


# Transitions of simulated motion over curves of bifurcations, as in the paper's Fig. 10.
#
# Where a sweep with falling values first meets an orbit, a marker stands between the value at which
# it does and the one before, with a bar from one to the other. Its filling says from what the orbit
# is reached: black from complex motion, as by a transient grazing, grey from an orbit of several
# forcing periods, as by a grazing after period doublings, white from one of a single period. A
# sweep with rising values leaves the orbit at the smaller marker in another colour: between the two
# it depends on the direction what is seen. Points of codimension two are left out.

MARKS = ("o", "s", "^", "D", "v", "P")
RISING = "#CC79A7"
MET: dict[str, Any] = {"color": "k", "linestyle": "none", "markersize": 5}
LEFT: dict[str, Any] = {"color": RISING, "linestyle": "none", "markersize": 3.4}
FROM: Mapping[str, tuple[dict[str, Any], str]] = {
    "complex": (MET | {"markerfacecolor": "k"}, "from complex motion (as TG)"),
    "multiplied": (
        MET | {"markerfacecolor": "0.65"},
        "from period 2T, 3T, ... (as PD$_\\mathrm{G}$)",
    ),
    "single": (MET | {"markerfacecolor": "white"}, "from period T"),
    "left": (LEFT | {"markerfacecolor": "none", "markeredgewidth": 1.2}, "left as {along} rises"),
}
"""What was there before an orbit, or that it is left: the look of its marker, and the words for
it."""


@dataclass(frozen=True)
class SweepLimits:
    """Where a sweep first meets an orbit, or leaves it: values of the parameter that is drawn.

    `source` is one of `FROM`.
    """

    notation: str
    before: float
    after: float
    source: str


@explain_arguments
def plot_transitions(
    curves: Sequence[Curve],
    sweeps: Sequence[Sweep],
    *,
    to: Sequence[str],
    ax: Any = None,
    along: str | None = None,
    units: Mapping[str, str] | None = None,
    areas: Sequence[Area] = (),
    checks: Sequence[Check] = (),
    xlim: tuple[float, float] | None = None,
    ylim: tuple[float, float] | None = None,
) -> Any:
    """Draw where simulated motion changes, over curves of bifurcations in two parameters.

    Parameters
    ----------
    curves : sequence of Curve
        Of one pair of parameters.
    sweeps : sequence of Sweep
        In the curves' first parameter, each at another value of the second one, with falling
        values, rising ones or both; of a store by `Study.sweeps`.
    to : sequence of str
        Notations of the orbits that are marked, such as ``2:1``: where a sweep with falling values
        of the parameter on the y axis first meets them, and where one with rising values leaves
        them.
    ax : matplotlib.axes.Axes, optional
    along : str, optional
        The parameter on the y axis, as of `plot_curves`.
    units, areas, checks, xlim, ylim : optional
        As of `plot_curves`; limits that are not given hold all changes.

    Returns
    -------
    matplotlib.axes.Axes

    Raises
    ------
    InputError
        For curves of several pairs of parameters, or sweeps in another parameter.
    """
    pairs = {curve.parameters for curve in curves}
    if len(pairs) != 1:
        raise InputError("curves", f"{len(pairs)} pairs of parameters", "give curves of one pair")
    ((first, second),) = pairs
    if odd := next((sweep for sweep in sweeps if sweep.parameter != first), None):
        raise InputError("sweeps", f"one is in {odd.parameter}", f"give sweeps in {first}")
    along = along or falling_column(curves)
    given = None if ax is None else [ax]
    bare = [replace(curve, points=()) for curve in curves]  # their marks are like those drawn here
    (ax,) = plot_curves(
        bare, given, along=along, units=units, checks=checks, areas=areas, xlim=xlim, ylim=ylim
    )[:1]
    limits = ax.get_xlim(), ax.get_ylim()
    found = [
        (swept.model.values[second], met)
        for swept in sweeps
        for way in swept.directions
        for name in to
        for met in (_changes(swept.of(way), name, along) if way != "random" else ())
    ]
    for place, met in found:
        marker = MARKS[list(to).index(met.notation) % len(MARKS)]
        ends, look = [met.before, met.after], FROM[met.source][0]
        ax.plot([place] * 2, ends, color=look["color"], linewidth=0.8, zorder=6)
        ax.plot(place, 0.5 * sum(ends), marker=marker, zorder=7, **look)
    ax.set_xlim(*limits[0])
    values = [value for _, met in found for value in (met.before, met.after)]
    if ylim is None:
        ax.set_ylim(min([limits[1][0], *values]), max([limits[1][1], *values]))
    _legend_of_transitions(ax, [met for _, met in found], to, along)
    return ax


def _changes(rows: Sequence[Row], name: str, along: str) -> list[SweepLimits]:
    """The first appearance of an orbit as values fall; its last one as they rise."""
    values = [row.attractor.parameters[along] for row in rows]
    here = [row.attractor.notation == name for row in rows]
    steps = range(1, len(rows))
    if values and values[-1] > values[0]:
        left = [k for k in steps if here[k - 1] and not here[k]][-1:]
        return [SweepLimits(name, values[k - 1], values[k], "left") for k in left]
    for k in (k for k in steps if here[k] and not here[k - 1]):
        before = rows[k - 1].attractor
        source = "multiplied" if (before.period or 1) > 1 else "single"
        source = source if before.kind is Kind.PERIODIC else "complex"
        return [SweepLimits(name, values[k - 1], values[k], source)]
    return []


def _legend_of_transitions(
    ax: Any, found: Sequence[SweepLimits], to: Sequence[str], along: str
) -> None:
    """What the markers say, in the panel."""
    handles = [
        legend_mark(
            marker=MARKS[k % len(MARKS)],
            label=f"to {plain_text(name)} as {symbol(along)} falls",
            **FROM["single"][0],
        )
        for k, name in enumerate(to)
    ]
    handles += [
        legend_mark(marker="o", label=text.replace("{along}", symbol(along)), **look)
        for source, (look, text) in FROM.items()
        if any(met.source == source for met in found)
    ]
    inside: dict[str, Any] = {"loc": "upper right", "fontsize": 7.0, "framealpha": 0.85}
    ax.legend(handles=handles, **inside)


# Results as they are drawn where nothing is asked for.


@draw_result.register
def _(result: Curve, **options: Any) -> Any:
    return plot_curves([result], **options)


@draw_result.register
def _(result: Diagram, *x: Any, **options: Any) -> Any:
    if not result.branches and result.curves:
        return plot_curves(result.curves, *x, **options)
    return plot_diagram(result, *x, **options)
