"""Curves of bifurcations in two parameters, in the manner of the paper's Fig. 6.

A panel for each member of the family and each pair of parameters; PD blue, G green, FB orange, BP
and V in further colours, a second bifurcation of a kind in a colour of its own; ghosts dotted;
points of codimension two marked. Areas are tinted by the bifurcation that ends the stable orbits in
them as the quantity on the y axis falls; without areas a band under each panel tells which
bifurcation comes first. Curves of a single panel are named where they leave it to the right.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.lines import Line2D

from ..bifurcations.codimension_two import MARKERS
from ..bifurcations.declarations import CROSSINGS
from ..bifurcations.registry import kind_of
from ..errors import InputError, shown
from ..results.curve import (
    Area,
    Check,
    Curve,
    Region,
    StableOrbit,
    falling,
    lanes,
    panels,
    parameters_of,
    regions,
)
from .areas import area_legend, draw_areas, of_panel
from .diagram import save_figure, write_heading
from .figures import Figure
from .texts import axis_label, set_label, symbol, values_text

POINT: dict[str, Any] = {"color": "k", "linestyle": "none", "markersize": 4.5}
FURTHER = ("k", "#7B3294", "#8C510A", "#1B4F9C", "#C51B7D", "#5F6B00", "0.5")
"""Colours of further bifurcations of a kind."""
BAND: dict[str, Any] = {"alpha": 0.6, "edgecolor": "white", "linewidth": 0}


class Key(NamedTuple):
    """What a colour stands for: a bifurcation of an orbit."""

    kind: str
    label: str
    notation: str


@dataclass(frozen=True)
class Panel:
    """The curves of one member of the family in one pair of parameters.

    `along` is the column on the y axis, `across` that on the x axis, the second parameter.
    """

    curves: Sequence[Curve]
    fixed: Mapping[str, float]
    along: str
    across: str


def plot_curves(
    curves: Curve | Sequence[Curve],
    axes: Any = None,
    *,
    along: str | None = None,
    units: Mapping[str, str] | None = None,
    checks: Sequence[Check] = (),
    areas: Sequence[Area] = (),
) -> Any:
    """Draw curves, one panel for each member of their family and each pair of parameters.

    Parameters
    ----------
    curves : Curve or sequence of Curve
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

    Returns
    -------
    list of matplotlib.axes.Axes

    Raises
    ------
    InputError
        For no curves, a parameter that they do not have, or axes that are too few.
    """
    curves = [curves] if isinstance(curves, Curve) else list(curves)
    if not curves:
        raise InputError("curves", "empty", "give at least one curve")
    panels = _panels(curves, along)
    axes = list(np.ravel(_axes(panels) if axes is None else axes))
    if len(axes) < len(panels):
        raise InputError("axes", f"found {len(axes)}", f"give {len(panels)}, one for each panel")
    keys = _ordered(curves)
    bands, tinted = [], []
    for ax, panel in zip(axes, panels, strict=False):
        _draw_panel(ax, panel, keys, units or {})
        if own := of_panel(areas, panel.fixed, panel.across, panel.along):
            draw_areas(ax, own, partial(_end_colour, keys))
            tinted += own
        else:
            bands += _draw_regions(ax, panel, keys, checks)
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
        return falling(curves)
    names = parameters_of(curves[0])
    if along not in names:
        found = f"curve {curves[0].id} has no parameter {shown(along)}"
        raise InputError("along", found, f"accepted are {', '.join(names)}")
    return along


def fixed_values(curves: Sequence[Curve]) -> dict[str, float]:
    """Parameters that are the same on all curves."""
    found = {}
    for name in parameters_of(curves[0]):
        values = {value for c in curves for value in (c[name].min(), c[name].max())}
        if len(values) == 1:
            found[name] = float(values.pop())
    return found


def _axes(panels: Sequence[Panel]) -> Any:
    """Axes for panels in rows of four, in a new figure; limits are shared where all fit."""
    columns = min(len(panels), 4)
    rows = -(-len(panels) // columns)
    size = (3.0 * columns + 1.2, 2.7 * rows + 0.7) if len(panels) > 1 else (6.2, 4.4)
    figure = Figure(figsize=size, dpi=150, layout="constrained")
    one, alike = len({p.across for p in panels}) == 1, _alike(panels)
    axes = np.ravel(figure.subplots(rows, columns, sharex=one, sharey=alike, squeeze=False))
    for ax in axes[len(panels) :]:
        ax.set_visible(False)
    for ax in axes[max(len(panels) - columns, 0) : len(panels)]:  # nothing stands below these
        ax.tick_params(labelbottom=True)
    return axes[: len(panels)]


def _alike(panels: Sequence[Panel]) -> bool:
    """Whether panels have one quantity on the y axis and none needs much less than another."""
    spans = [np.ptp(np.concatenate([c[p.along] for c in p.curves])) for p in panels]
    return len({p.along for p in panels}) == 1 and max(spans) < 3.0 * min(spans)


# Drawing.


def _draw_panel(ax: Any, panel: Panel, keys: Sequence[Key], units: Mapping[str, str]) -> None:
    for curve in panel.curves:
        _draw_curve(ax, curve, panel, _colour(_key(curve), keys))
        for point in curve.points:
            place = (point.parameters[panel.across], point.parameters[panel.along])
            ax.plot(*place, marker=MARKERS.get(point.kind, "P"), zorder=5, **POINT)
    if ax.xaxis.get_tick_params().get("labelbottom", True):
        ax.set_xlabel(axis_label(panel.across, units.get(panel.across, "")))
    if ax.yaxis.get_tick_params().get("labelleft", True):
        ax.set_ylabel(axis_label(panel.along, units.get(panel.along, "")))
    if panel.fixed:
        ax.set_title(values_text(panel.fixed, units), fontsize=9)


def _draw_curve(ax: Any, curve: Curve, panel: Panel, colour: str) -> None:
    """Draw runs of equal status; a piece that starts at a marked point takes it from its end."""
    ghost = curve.ghost.copy()
    marked = np.nonzero(curve["event"][:-1] != "")[0]
    ghost[marked] = ghost[marked + 1]
    edges = np.nonzero(np.diff(ghost.astype(int)))[0] + 1
    x, y, width = curve[panel.across], curve[panel.along], kind_of(curve.kind).look.width
    for first, last in zip([0, *edges], [*edges, len(ghost)], strict=True):
        piece = slice(first, min(last + 1, len(ghost)))
        style = (0, (1, 1.4)) if ghost[first] else "-"
        ax.plot(x[piece], y[piece], color=colour, linestyle=style, linewidth=width)


def _draw_region(ax: Any, region: Region, keys: Sequence[Key], lane: int) -> None:
    """A band along the x axis in the colour of what comes first, one over another by orbit; half as
    high if unconfirmed."""
    key = next(k for k in keys if k.label == region.first and k.notation == region.notation)
    low, height = 0.04 * lane, 0.015 if region.said else 0.03
    look = {"facecolor": _colour(key, keys), "hatch": kind_of(key.kind).look.hatch, **BAND}
    ax.axvspan(region.low, region.high, ymin=low, ymax=low + height, **look)


def _draw_regions(
    ax: Any, panel: Panel, keys: Sequence[Key], checks: Sequence[Check]
) -> list[Region]:
    found = regions(panel.curves, panel.along, checks)
    for region, lane in zip(found, lanes(found), strict=True):
        _draw_region(ax, region, keys, lane)
    return found


def _key(curve: Curve) -> Key:
    return Key(curve.kind, curve.label, curve.notation)


def _end_colour(keys: Sequence[Key], orbit: StableOrbit) -> str:
    """The colour of the curve at which an orbit ends."""
    own = Key(orbit.kind or "", orbit.ends or "", orbit.notation)
    return _colour(own, keys) if own in keys else kind_of(own.kind).look.colour


def _colour(key: Key, keys: Sequence[Key]) -> str:
    """The kind's colour for the first bifurcation of a kind; a colour of its own for each other."""
    firsts = {other.kind: other for other in reversed(keys)}
    if firsts[key.kind] == key:
        return kind_of(key.kind).look.colour
    others = [other for other in keys if firsts[other.kind] != other]
    return FURTHER[others.index(key) % len(FURTHER)]


def _ordered(curves: Sequence[Curve]) -> list[Key]:
    """The bifurcations: of grazings of an orbit those first after which it hits the first wall more
    often, so that G is green to 3:1 and black to 2:2, as in the paper's Fig. 6."""
    kinds = list(dict.fromkeys(curve.kind for curve in curves))
    words = list(dict.fromkeys(curve.notation for curve in curves))

    def rank(key: Key) -> tuple[int, int, list[int]]:
        onto = key.label.partition("->")[2]
        counts = [-int(number) for number in re.findall(r"\d+", onto)]
        return words.index(key.notation), kinds.index(key.kind), counts

    return sorted(dict.fromkeys(map(_key, curves)), key=rank)


def _name_ends(ax: Any, panel: Panel, keys: Sequence[Key]) -> None:
    """Name curves where they leave the picture to the right."""
    apart, high = 0.045 * float(np.ptp(ax.get_ylim())), ax.get_xlim()[1]
    bottom, top = ax.get_ylim()
    spots = []
    for curve in panel.curves:
        x, y = curve[panel.across], curve[panel.along]
        over = np.nonzero((x[:-1] - high) * (x[1:] - high) <= 0.0)[0]
        ends = [float(y[k]) for k in over] or [float(y[np.argmax(x)])] * bool(
            x.max() > high - 0.06 * np.ptp(ax.get_xlim())
        )
        spots += [(value, _key(curve)) for value in ends if bottom <= value <= top]
    before = -np.inf
    for value, key in sorted(set(spots)):
        place = max(value, before + apart)
        before = place
        look: dict[str, Any] = {"fontsize": 7.5, "va": "center", "annotation_clip": False}
        where: dict[str, Any] = {"xycoords": ax.get_yaxis_transform(), "gid": "end"}
        where |= {"textcoords": "offset points", "color": _colour(key, keys)}
        ax.annotate(_text(key, keys), (1.0, place), (4, 0), **where, **look)


def _draw_legend(
    ax: Any, panels: Sequence[Panel], keys: Sequence[Key], further: Sequence[Any]
) -> None:
    handles = [
        Line2D([], [], color=_colour(k, keys), lw=kind_of(k.kind).look.width, label=_text(k, keys))
        for k in keys
    ]
    curves = [c for panel in panels for c in panel.curves]
    if any(c.ghost.any() for c in curves):
        handles.append(Line2D([], [], color="0.3", linestyle=(0, (1, 1.4)), label="ghost"))
    kinds = (p.kind for c in curves for p in c.points)
    for kind in dict.fromkeys(CROSSINGS[0] if k in CROSSINGS else k for k in kinds):
        marker = MARKERS.get(kind, "P")
        handles.append(Line2D([], [], color="k", ls="none", marker=marker, ms=4.5, label=kind))
    ax.figure.legend(
        handles=[*handles, *further],
        loc="outside right upper",
        fontsize=7.5,
        frameon=False,
        handlelength=1.8,
    )


def _band_key(panels: Sequence[Panel], bands: Sequence[Region]) -> list[Line2D]:
    """The key to the bands, if there are any."""
    if not bands:
        return []
    falling = " or ".join(dict.fromkeys(symbol(panel.along) for panel in panels))
    unconfirmed = any(region.said for region in bands)
    first = f"first as {falling} falls" + "\n(half as high: not checked)" * unconfirmed
    return [Line2D([], [], color="0.5", lw=4, alpha=0.6, label=first)]


def _text(key: Key, keys: Sequence[Key]) -> str:
    """A bifurcation as in Table 1; with its orbit where there are several."""
    several = len({k.notation for k in keys}) > 1
    return set_label(key.kind, key.label, key.notation if several else "")
