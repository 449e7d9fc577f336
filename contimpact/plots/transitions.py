"""Transitions of simulated motion over curves of bifurcations, as in the paper's Fig. 10.

Where a sweep with falling values first meets an orbit, a marker stands between the value at which
it does and the one before, with a bar from one to the other. Its filling says from what the orbit
is reached: black from complex motion, as by a transient grazing, grey from an orbit of several
forcing periods, as by a grazing after period doublings, white from one of a single period. A
sweep with rising values leaves the orbit at the smaller marker in another colour: between the two
it depends on the direction what is seen. Points of codimension two are left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..errors import InputError
from ..results.curve import Area, Check, Curve, falling
from ..simulation.attractor import Attractor, Kind
from ..simulation.sweep import Row, Sweep
from .curves import plot_curves
from .diagram import legend_mark
from .texts import plain, symbol

MARKS = ("o", "s", "^", "D", "v", "P")
RISING = "#CC79A7"
FROM = {
    "complex": ("k", "from complex motion (as TG)"),
    "multiplied": ("0.65", "from period 2T, 3T, ... (as PD$_\\mathrm{G}$)"),
    "single": ("white", "from period T"),
}
"""What an orbit is reached from: the filling of its marker, and the words for it."""


@dataclass(frozen=True)
class Met:
    """Where a sweep first meets an orbit, or leaves it: values of the parameter that is drawn.

    `source` is one of `FROM`, what was there before; None where a sweep with rising values leaves
    the orbit.
    """

    notation: str
    before: float
    after: float
    source: str | None


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
    units, areas, checks : optional
        As of `plot_curves`.

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
    along = along or falling(curves)
    given = None if ax is None else [ax]
    bare = [replace(curve, points=()) for curve in curves]  # their marks are like those drawn here
    (ax,) = plot_curves(bare, given, along=along, units=units, areas=areas, checks=checks)[:1]
    limits = ax.get_xlim(), ax.get_ylim()
    found = [(s.model.values[second], met) for s in sweeps for met in _met(s, to, along)]
    for place, met in found:
        _draw(ax, place, met, MARKS[list(to).index(met.notation) % len(MARKS)])
    ax.set_xlim(*limits[0])
    values = [value for _, met in found for value in (met.before, met.after)]
    ax.set_ylim(min([limits[1][0], *values]), max([limits[1][1], *values]))
    _legend(ax, [met for _, met in found], to, along)
    return ax


def _met(sweep: Sweep, to: Sequence[str], along: str) -> list[Met]:
    """Where the sweep's orbits are met or left, in all its directions."""
    ways = (sweep.of(way) for way in sweep.directions if way != "random")
    return [met for rows in ways for name in to for met in _changes(rows, name, along)]


def _changes(rows: Sequence[Row], name: str, along: str) -> list[Met]:
    """The first appearance of an orbit as values fall; its last one as they rise."""
    values = [row.attractor.parameters[along] for row in rows]
    here = [row.attractor.notation == name for row in rows]
    steps = range(1, len(rows))
    if values and values[-1] > values[0]:
        left = [k for k in steps if here[k - 1] and not here[k]][-1:]
        return [Met(name, values[k - 1], values[k], None) for k in left]
    met = [k for k in steps if here[k] and not here[k - 1]][:1]
    return [Met(name, values[k - 1], values[k], _source(rows[k - 1].attractor)) for k in met]


def _source(before: Attractor) -> str:
    if before.kind is not Kind.PERIODIC:
        return "complex"
    return "multiplied" if (before.period or 1) > 1 else "single"


def _draw(ax: Any, place: float, met: Met, marker: str) -> None:
    colour = "k" if met.source else RISING
    ax.plot([place] * 2, [met.before, met.after], color=colour, linewidth=0.8, zorder=6)
    ax.plot(place, 0.5 * (met.before + met.after), marker=marker, zorder=7, **_look(met.source))


def _look(source: str | None) -> dict[str, Any]:
    if source is None:
        size = {"markersize": 3.4, "markeredgewidth": 1.2}
        return {"color": RISING, "markerfacecolor": "none", "linestyle": "none", **size}
    return {"color": "k", "markerfacecolor": FROM[source][0], "linestyle": "none", "markersize": 5}


def _legend(ax: Any, found: Sequence[Met], to: Sequence[str], along: str) -> None:
    """What the markers say, in the panel."""
    handles = [
        legend_mark(
            marker=MARKS[k % len(MARKS)],
            label=f"to {plain(name)} as {symbol(along)} falls",
            **_look("single"),
        )
        for k, name in enumerate(to)
    ]
    handles += [
        legend_mark(marker="o", label=FROM[source][1], **_look(source))
        for source in FROM
        if any(met.source == source for met in found)
    ]
    if any(met.source is None for met in found):
        told = f"left as {symbol(along)} rises"
        handles.append(legend_mark(marker="o", label=told, **_look(None)))
    inside: dict[str, Any] = {"loc": "upper right", "fontsize": 7.0, "framealpha": 0.85}
    ax.legend(handles=handles, **inside)
