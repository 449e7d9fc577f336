"""Which attractors there are along a parameter, as a bar for each."""

from __future__ import annotations

from typing import Any

from matplotlib.patches import Patch

from ..diagrams.ranges import Ranges
from ..errors import explain_arguments
from . import diagram as style
from .texts import axis_label, plain_text

FILLS: dict[bool, dict[str, Any]] = {
    True: {"facecolor": "0.35", "edgecolor": "k"},
    False: {"facecolor": "white", "edgecolor": "k", "hatch": "////"},
}
"""Bars of orbits on branches, and of motion that simulation alone shows."""


@explain_arguments
def plot_ranges(found: Ranges, ax: Any = None, *, unit: str = "") -> Any:
    """Draw a bar for each attractor, those of one notation in one row.

    Where simulation alone shows an end, a line shows between which values it lies.

    Parameters
    ----------
    found : Ranges
    ax : matplotlib.axes.Axes, optional
        Where to draw, such as below a diagram; a new figure otherwise.
    unit : str
        Of the parameter.

    Returns
    -------
    matplotlib.axes.Axes
    """
    motions = sorted(found.motions, key=lambda motion: motion.low.value)
    names = list(dict.fromkeys(plain_text(motion.notation, 30) for motion in motions))
    ax = ax or style.new_figure(7.2, 0.9 + 0.32 * max(len(names), 1)).add_subplot()
    for motion in motions:
        row = names.index(plain_text(motion.notation, 30))
        low, high = motion.low, motion.high
        look = FILLS[motion.branch is not None]
        ax.barh(row, high.value - low.value, left=low.value, height=0.55, linewidth=0.8, **look)
        for end in (low, high):
            if end.entry is None and end.error:
                bar = {"fmt": "none", "ecolor": "k", "elinewidth": 1.2, "capsize": 3.0}
                ax.errorbar([end.value], [row], xerr=[end.error], **bar)
    ax.set_yticks(range(len(names)), names)
    ax.invert_yaxis()
    ax.set_xlim(found.ranges[0].low, found.ranges[-1].high)
    ax.set_xlabel(axis_label(found.parameter, unit))
    kinds = {motion.branch is not None for motion in motions}
    texts = {True: "stable orbits of branches", False: "simulated, on no branch"}
    handles = [Patch(label=texts[kind], **FILLS[kind]) for kind in sorted(kinds)]
    ax.legend(
        handles=handles, loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False
    )
    return ax
