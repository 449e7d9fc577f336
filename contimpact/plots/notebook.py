"""The picture of each kind of result, as notebooks and its method `plot` show it."""

from __future__ import annotations

import functools
from typing import Any

from ..diagrams.ranges import Ranges
from ..display import PAINTERS
from ..errors import InputError
from ..orbits.orbit import Orbit
from ..results.branch import Branch, Entry
from ..results.curve import Curve
from ..results.diagram import Diagram
from ..simulation.fractions import BasinFractions
from ..simulation.manifolds import Manifold
from ..simulation.sweep import Sweep
from ..studies.study import Study
from .attractors import plot_fractions, plot_manifold, plot_sweep
from .curves import plot_curves
from .diagram import plot_diagram
from .maps import plot_map
from .orbit import plot_orbit
from .ranges import plot_ranges


@functools.singledispatch
def draw_result(result: Any, *x: Any, **options: Any) -> Any:
    """Draw a result and return the axes.

    Raises InputError if it cannot be drawn.
    """
    raise InputError("picture", f"found a {type(result).__name__}", "there is none")


PAINTERS.append(draw_result)


@draw_result.register
def _(result: Branch, *x: Any, **options: Any) -> Any:
    return plot_diagram(result, *x, **{"unphysical": "all", **options})


@draw_result.register
def _(result: Diagram, *x: Any, **options: Any) -> Any:
    if not result.branches and result.curves:
        return plot_curves(result.curves, *x, **options)
    return plot_diagram(result, *x, **options)


@draw_result.register
def _(result: Curve, **options: Any) -> Any:
    return plot_curves([result], **options)


@draw_result.register(Orbit)
@draw_result.register(Entry)
def _(result: Any, *x: Any, **options: Any) -> Any:
    return plot_orbit(result, *x, **options)


@draw_result.register
def _(result: Sweep, **options: Any) -> Any:
    return plot_sweep(result, **options)


@draw_result.register
def _(result: Manifold, *x: Any, **options: Any) -> Any:
    return plot_manifold(result, *x, **options)


@draw_result.register
def _(result: BasinFractions, *x: Any, **options: Any) -> Any:
    return plot_fractions(result, *x, **options)


@draw_result.register
def _(result: Ranges, *x: Any, **options: Any) -> Any:
    return plot_ranges(result, *x, **options)


@draw_result.register
def _(result: Study, quantity: str = "ends", **options: Any) -> Any:
    return plot_map(result.map(quantity, **options))
