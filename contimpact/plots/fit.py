"""Residuals of a fit to measured impacts, in standard deviations."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import explain_arguments
from ..orbits.fitting import CLOCK, MEASURED, Fit
from . import diagram as style
from .texts import plain_text


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
        figure = style.new_figure(7.2, 1.0 + 2.2 * len(kinds))
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
            look = {"color": style.COLOURS[place % len(style.COLOURS)], "markersize": 4}
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
