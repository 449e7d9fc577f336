"""Transitions of simulated motion over curves of bifurcations, as in the paper's Fig. 10.

A marker stands where a sweep first met an orbit, between the value at which it did and the one
before, with a bar from one to the other. Filled markers lie where their orbit stays for two values
at least.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..attractors.sweep import Sweep
from ..errors import InputError
from ..records.competition import falling
from ..records.curve import Curve
from .curves import plot_curves
from .diagram import legend_mark
from .texts import plain

MARKS = ("o", "s", "^", "D", "v", "P")


@dataclass(frozen=True)
class Met:
    """Where a sweep first met an orbit: values of the parameter that is drawn."""

    notation: str
    before: float
    after: float
    stays: bool


def plot_transitions(
    curves: Sequence[Curve], sweeps: Sequence[Sweep], *, to: Sequence[str], ax: Any = None,
    along: str | None = None,
) -> Any:  # fmt: skip
    """Draw where simulated motion changes, over curves of bifurcations in two parameters.

    Parameters
    ----------
    curves : sequence of Curve
        Of one pair of parameters.
    sweeps : sequence of Sweep
        In the curves' first parameter, each at another value of the second one.
    to : sequence of str
        Notations of the orbits whose first appearance in each sweep is marked, such as ``2:1``.
    ax : matplotlib.axes.Axes, optional
    along : str, optional
        The parameter on the y axis, as of `plot_curves`.

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
    (ax,) = plot_curves(curves, None if ax is None else [ax], along=along)[:1]
    limits = ax.get_xlim(), ax.get_ylim()
    found = [(s.model.values[second], met) for s in sweeps for met in _met(s, to, along)]
    for place, met in found:
        _draw(ax, place, met, MARKS[list(to).index(met.notation) % len(MARKS)])
    ax.set_xlim(*limits[0])
    values = [value for _, met in found for value in (met.before, met.after)]
    ax.set_ylim(min([limits[1][0], *values]), max([limits[1][1], *values]))
    handles = [
        legend_mark(color="k", marker=MARKS[k % len(MARKS)], linestyle="none", markersize=4.5,
                    label=f"simulated, to {plain(name)}")
        for k, name in enumerate(to)
    ]  # fmt: skip
    inside: dict[str, Any] = {"loc": "upper right", "fontsize": 7.5, "framealpha": 0.85}
    ax.legend(handles=handles, **inside)
    return ax


def _met(sweep: Sweep, to: Sequence[str], along: str) -> list[Met]:
    """The first appearance of each orbit in a sweep, in its first direction."""
    rows = sweep.of(sweep.directions[0]) if sweep.rows else []
    names = [row.attractor.notation for row in rows]
    found = []
    for name in to:
        if name not in names[1:]:
            continue
        k = names.index(name, 1)
        before, after = (rows[i].attractor.parameters[along] for i in (k - 1, k))
        if names[k - 1] != name:
            found.append(Met(name, before, after, name in names[k + 1 : k + 2]))
    return found


def _draw(ax: Any, place: float, met: Met, marker: str) -> None:
    ax.plot([place] * 2, [met.before, met.after], color="k", linewidth=0.8, zorder=6)
    look = {"color": "k", "marker": marker, "markersize": 4.5, "linestyle": "none", "zorder": 7}
    face = "k" if met.stays else "white"
    ax.plot(place, 0.5 * (met.before + met.after), markerfacecolor=face, **look)
