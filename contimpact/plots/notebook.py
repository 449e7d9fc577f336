"""Pictures of results as notebooks show them."""

from __future__ import annotations

import functools
from typing import Any

from ..display import PAINTERS
from ..errors import InputError
from ..orbits.orbit import Orbit
from ..results.branch import Branch, Entry
from ..results.curve import Curve
from ..results.diagram import Diagram
from ..simulation.sweep import Sweep
from ..studies.study import Study
from .attractors import plot_sweep
from .curves import plot_curves
from .diagram import plot_diagram, png_of
from .maps import plot_map
from .orbit import plot_orbit


def picture(result: Any) -> bytes:
    """Return the picture of a result as PNG.

    Raises InputError if it cannot be drawn.
    """
    return png_of(drawn(result))


PAINTERS.append(picture)


@functools.singledispatch
def drawn(result: Any) -> Any:
    """Return a figure of a result."""
    raise InputError("picture", f"found a {type(result).__name__}", "there is none")


@drawn.register
def _(result: Branch) -> Any:
    return plot_diagram(Diagram(result.id, [result]), unphysical="all").figure


@drawn.register
def _(result: Diagram) -> Any:
    if not result.branches and result.curves:
        return plot_curves(result.curves)[0].figure
    return plot_diagram(result).figure


@drawn.register
def _(result: Curve) -> Any:
    return plot_curves([result])[0].figure


@drawn.register(Orbit)
@drawn.register(Entry)
def _(result: Any) -> Any:
    return plot_orbit(result)[0].figure


@drawn.register
def _(result: Sweep) -> Any:
    return plot_sweep(result).figure


@drawn.register
def _(result: Study) -> Any:
    return plot_map(result.map("ends")).figure
