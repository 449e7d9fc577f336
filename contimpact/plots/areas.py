"""Areas of a map of two parameters: tinted by what ends the stable orbits in them.

The tint is the colour of the curve at which the stable orbit ends. Areas are hatched by kind, those
of a second bifurcation of a kind the other way, so that they are told without colours too, and
crossed where several orbits are stable. White is where none is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path

from ..arrays import Array
from ..bifurcations.registry import kind_of
from ..results.curve import Area, StableOrbit
from .texts import plain, set_label
from .thinning import thinned

TINT, DARKEST = 0.28, 0.84
"""Of a curve's colour in the area of the orbits that end at it, and what none is darker than."""
THROUGHOUT = "0.93"
CROSSED = "xxxx"
HATCHED = "0.55"
"""Colour of hatches."""

Colours = Callable[[StableOrbit], str]


def of_panel(
    areas: Sequence[Area], fixed: Mapping[str, float], across: str, along: str
) -> list[Area]:
    """Return the areas of one member of a family in one plane, without those of nothing stable."""
    return [
        area
        for area in areas
        if (dict(area.fixed), area.across, area.along) == (dict(fixed), across, along)
        and area.orbits
    ]


def draw_areas(ax: Any, areas: Sequence[Area], colours: Colours) -> None:
    """Tint areas below all else.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    areas : sequence of Area
    colours : callable ``colours(orbit) -> colour``
        Of the curve at which an orbit ends.
    """
    sizes = np.ptp(np.vstack([area.polygon[0] for area in areas]), axis=0)
    for area in areas:
        look, path = _look(area.orbits[0], colours), _path(area, sizes)
        sharp = {"linewidth": 0.0, "antialiased": False}  # no seams between areas
        ax.add_patch(PathPatch(path, zorder=0.5, **sharp, **look))
        if area.bistable:
            crossed = {"facecolor": "none", "edgecolor": HATCHED, "hatch": CROSSED}
            ax.add_patch(PathPatch(path, linewidth=0.0, zorder=0.6, **crossed))


def area_legend(areas: Sequence[Area], colours: Colours) -> list[Patch]:
    """Return the keys to the tints of some areas, each once."""
    several = len({o.notation for area in areas for o in area.orbits}) > 1
    keys = {_text(area.orbits[0], several): area.orbits[0] for area in areas}
    found = [Patch(label=text, **_look(orbit, colours)) for text, orbit in keys.items()]
    if any(area.bistable for area in areas):
        look: dict[str, Any] = {"facecolor": "none", "edgecolor": HATCHED, "hatch": CROSSED}
        found.append(Patch(label="several stable orbits", linewidth=0.0, **look))
    return found


def _look(orbit: StableOrbit, colours: Colours) -> dict[str, Any]:
    if orbit.kind is None:
        return {"facecolor": THROUGHOUT, "edgecolor": HATCHED}
    colour = 1.0 - TINT * (1.0 - np.array(to_rgb(colours(orbit))))
    colour = np.maximum(colour, DARKEST if colour.max() < DARKEST else 0.0)
    own = kind_of(orbit.kind).look
    hatch = own.hatch
    if hatch and colours(orbit) != own.colour:  # a second bifurcation of a kind
        hatch = hatch.replace("/", "\\")
    return {"facecolor": tuple(colour), "edgecolor": HATCHED, "hatch": hatch}


def _text(orbit: StableOrbit, several: bool) -> str:
    name = orbit.notation if several else ""
    if orbit.kind is not None and orbit.ends is not None:
        return f"stable until {set_label(orbit.kind, orbit.ends, name)}"
    until = f"stable until {plain(orbit.ends)}" if orbit.ends else "stable throughout"
    return until + (f" ({plain(name)})" if name else "")


def _path(area: Area, sizes: Array) -> Path:
    """An area's outline as it is seen in a picture of some size; holes run the other way round."""
    rings, codes = [], []
    for points, borders in zip(map(np.asarray, area.polygon), area.borders, strict=True):
        rings.append(points[thinned(points / sizes, [place for place, _ in borders])])
        codes += [Path.MOVETO, *[Path.LINETO] * (len(rings[-1]) - 2), Path.CLOSEPOLY]
    return Path(np.vstack(rings), codes)
