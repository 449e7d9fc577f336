"""Phase planes and time series of orbits, in the manner of Figs. 5, 7 and 8 of the paper.

Line styles are those of diagrams: stable orbits are solid, unstable ones dashed, unphysical ones
dotted. A small open circle is an impact, a larger coloured one the touch of a grazing orbit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..bifurcations.kind import kind_of
from ..display import draw_result
from ..errors import InputError, explain_arguments, short_repr
from ..models.model import Model
from ..orbits.fitting import CLOCK, MEASURED, Fit
from ..orbits.orbit import Orbit
from ..orbits.problem import positions
from ..results.branch import Branch, Entry
from ..results.curve import Curve
from ..results.diagram import entry_by_name, to_orbit
from ..simulation.attractor import Attractor
from .attractors import INK_OF_PORTRAITS, OTHERS, draw_walls, name_walls, names_of_gaps
from .curves import plot_curves
from .diagram import COLOURS, legend_mark, new_figure, plot_diagram
from .lines import STYLES, plain_text

PERIODS = 2
"""Forcing periods of a time series at least."""
IMPACT: dict[str, Any] = {"marker": "o", "markerfacecolor": "white", "markersize": 3.6, "zorder": 5}
TOUCH: dict[str, Any] = {"marker": kind_of("G").look.marker, "markersize": 6, "zorder": 6}


@draw_result.register(Orbit)
@draw_result.register(Entry)
@explain_arguments
def plot_orbit(
    *orbits: Any,
    axes: Any = None,
    labels: Sequence[str] | None = None,
    periods: int = PERIODS,
    model: Model | None = None,
) -> Any:
    """Draw the phase plane and the time series of an orbit, or of several on one another.

    Parameters
    ----------
    *orbits : Orbit, Entry, (Branch, row) or Attractor
        Whatever `continue_orbit` takes. An entry of a grazing has its touch marked. An attractor
        has to be periodic.
    axes : pair of matplotlib.axes.Axes, optional
        For the phase plane and for the time series; None in the place of one leaves it out. A new
        figure otherwise.
    labels : sequence of str, optional
        One for each orbit; its notation and parameter value by default.
    periods : int
        Forcing periods that the time series has at least.
    model : Model, optional
        The system of attractors that were read from a file, and of what names a system that is not
        imported; parameter values are those of what is drawn.

    Returns
    -------
    pair of matplotlib.axes.Axes

    Raises
    ------
    InputError
        For what is no orbit, or another number of labels.
    """
    given = [entry_by_name(one) for one in orbits]
    found = [
        one.orbit(model) if isinstance(one, Attractor) else to_orbit(one, model) for one in given
    ]
    if not found:
        raise InputError("orbits", "none", "give an orbit, an entry, or (branch, row)")
    if labels is not None and len(labels) != len(found):
        raise InputError("labels", f"found {len(labels)}", f"give {len(found)}, one for each orbit")
    if axes is None:
        axes = new_figure(9.0, 4.0).subplots(1, 2, width_ratios=(1.0, 1.5))
    plane, series = axes
    states = list(map(_state, given, found))
    told = list(labels) if labels is not None else list(map(_label, found, states))
    looks = _orbit_styles(states)
    if plane is not None:
        for orbit, look in zip(found, looks, strict=True):
            _draw_plane(plane, orbit, look)
        _finish(plane, found, False, *names_of_gaps(found[0].model))
        handles = [
            legend_mark(label=plain_text(t, 60), **k) for t, k in zip(told, looks, strict=True)
        ]
        below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16)}
        plane.legend(handles=handles, fontsize=7.5, frameon=False, handlelength=3.2, **below)
    if series is not None:
        for orbit, look in zip(found, looks, strict=True):
            _draw_series(series, orbit, look, periods)
        _finish(series, found, True, "$t/T$", names_of_gaps(found[0].model)[0])
    for one, orbit in zip(given, found, strict=True):
        if isinstance(one, Entry) and one.touch_time is not None:
            _mark_touch(plane, series, orbit, one)
    return plane, series


def _orbit_styles(states: Sequence[str]) -> list[dict[str, Any]]:
    """Colour, width and style of each: each is narrower than those beneath it."""
    colours = [INK_OF_PORTRAITS, *OTHERS]
    return [
        {
            "color": colours[k % len(colours)],
            "linewidth": max(1.0, (1.4 if len(states) == 1 else 2.6) - 0.7 * k),
            "linestyle": STYLES[state],
        }
        for k, state in enumerate(states)
    ]


def _state(given: Any, orbit: Orbit) -> str:
    """Which of `STYLES` an orbit has; an event of its own is not held against it."""
    one = given if isinstance(given, Entry) else orbit
    if not one.physical:
        return "unphysical"
    return "stable" if one.stable else "unstable"


def _label(orbit: Orbit, state: str) -> str:
    notation = orbit.word.notation(orbit.model.letters)
    parameter = orbit.problem.parameter
    return f"{notation}, {state}, {parameter} = {orbit.unknowns[-1]:.6g}"


def _draw_plane(ax: Any, orbit: Orbit, look: dict[str, Any]) -> None:
    _, x, v = orbit.path()
    flights = (np.split(column, len(orbit.word)) for column in (x, v))
    for flight_x, flight_v in zip(*flights, strict=True):
        ax.plot(flight_x, flight_v, **look)
    walls = positions(orbit.linearisation)
    for wall, speed in zip(orbit.word.walls, orbit.velocities, strict=True):
        ax.plot(walls[wall], speed, color=look["color"], linestyle="none", **IMPACT)
    ax.axhline(0.0, color="0.85", linewidth=0.6, zorder=0)
    ax.locator_params(axis="x", nbins=5)


def _draw_series(ax: Any, orbit: Orbit, look: dict[str, Any], periods: int) -> None:
    t, x, _ = orbit.path()
    forcing = orbit.period / (orbit.word.period or 1)
    walls = positions(orbit.linearisation)
    begin = np.floor(t[0] / forcing)
    for turn in range(-(-periods // (orbit.word.period or 1))):
        shift = turn * (orbit.word.period or 1) - begin
        ax.plot(t / forcing + shift, x, **look)
        for wall, time in zip(orbit.word.walls, orbit.times, strict=True):
            place = time / forcing + shift
            ax.plot(place, walls[wall], color=look["color"], linestyle="none", **IMPACT)
    ax.margins(x=0.01)


def _finish(ax: Any, orbits: Sequence[Orbit], across: bool, x: str, y: str) -> None:
    """The walls of all orbits, each named once, and the labels of the axes."""
    walls: dict[str, float] = {}
    for orbit in orbits:
        own = positions(orbit.linearisation)
        draw_walls(ax, list(own.values()), across)
        walls = own | walls
    name_walls(ax, list(walls), list(walls.values()), across)
    ax.set_xlabel(x)
    ax.set_ylabel(y)


def _mark_touch(plane: Any, series: Any, orbit: Orbit, entry: Entry) -> None:
    """Mark where a grazing orbit touches a wall."""
    wall = positions(orbit.linearisation)[str(entry.wall)]
    look = {"color": OTHERS[0], "linestyle": "none", **TOUCH}
    look["markerfacecolor"] = "white" if entry.ghost else OTHERS[0]
    if plane is not None:
        plane.plot(wall, 0.0, **look)
    if series is not None:
        forcing = orbit.period / (orbit.word.period or 1)
        begin = np.floor(orbit.times[0] / forcing)
        series.plot((entry.touch_time or 0.0) / forcing - begin, wall, **look)


# Residuals of a fit to measured impacts, in standard deviations.


@explain_arguments
def plot_fit(found: Fit, axes: Any = None) -> Any:
    """Draw the residuals of a fit against the phase of the orbit, in standard deviations.

    Grey lines are two deviations. Without times, residuals are drawn by their row.

    Parameters
    ----------
    found : Fit
    axes : sequence of matplotlib.axes.Axes, optional
        For times and for velocities, or the one that was measured; a new figure otherwise.

    Returns
    -------
    sequence of matplotlib.axes.Axes
    """
    kinds = [i for i in range(2) if MEASURED[i] in found.deviations]
    if axes is None:
        figure = new_figure(7.2, 1.0 + 2.2 * len(kinds))
        axes = list(np.atleast_1d(figure.subplots(len(kinds), 1, sharex=True)))
        figure.suptitle(plain_text(found.summary().title, 100), fontsize=10)
    letters, word = found.orbit.model.letters, found.orbit.word.walls
    walls = np.array([letters.index(word[k]) for k in found.impacts])
    timed = not np.all(np.isnan(found.data.times))
    since = (found.data.times - found.values.get(CLOCK, 0.0)) / found.orbit.period
    x = since - np.floor(since) if timed else np.arange(1.0, len(walls) + 1.0)
    if timed:  # a row without time stands at its impact
        own = found.orbit.times[found.impacts] / found.orbit.period
        x = np.where(np.isnan(x), own - np.floor(own), x)
    for ax, i in zip(axes, kinds, strict=False):
        for place in sorted(set(walls.tolist())):
            here = walls == place
            off = found.residuals[here, i] / found.deviations[MEASURED[i]]
            look = {"color": COLOURS[place % len(COLOURS)], "markersize": 4}
            ax.plot(x[here], off, "o^sDv"[place % 5], label=letters[place], alpha=0.7, **look)
        for level in (-2.0, 0.0, 2.0):
            ax.axhline(level, color="0.6", linewidth=0.8, zorder=0)
        ax.set_ylabel(f"{MEASURED[i]}: residual\nin {found.deviations[MEASURED[i]]:.3g}")
        ax.set_ylim(*(np.array([-1.05, 1.05]) * max(3.0, *np.abs(ax.get_ylim()))))
        if timed:
            ax.set_xlim(0.0, 1.0)
    axes[0].legend(title="wall", loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False)
    axes[len(kinds) - 1].set_xlabel("phase, in periods of the orbit" if timed else "row")
    return axes


@draw_result.register
def _(result: Fit, **options: Any) -> Any:
    return plot_fit(result, **options)


@draw_result.register
def _(result: list | tuple, *x: Any, **options: Any) -> Any:
    for kind, draw in ((Branch, plot_diagram), (Curve, plot_curves)):
        if result and all(isinstance(one, kind) for one in result):
            return draw(result, *x, **options)
    if result and all(isinstance(one, Orbit | Entry) for one in result):
        return plot_orbit(*result, *x, **options)
    found = f"found {short_repr(result)}"
    raise InputError("picture", found, "give branches, curves, or orbits and events")
