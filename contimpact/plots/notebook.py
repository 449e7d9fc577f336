"""The picture of each kind of result, as notebooks and its method `plot` show it."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Any

from ..diagrams.ranges import Ranges
from ..display import PAINTERS
from ..errors import InputError, short_repr
from ..models.model import Model
from ..orbits.fitting import Fit
from ..orbits.orbit import Orbit
from ..results.branch import Branch, Entry
from ..results.curve import Curve
from ..results.diagram import Diagram
from ..simulation.attractor import Attractor
from ..simulation.integrity import BasinFractions
from ..simulation.manifolds import Manifold
from ..simulation.run import Run
from ..simulation.simulator import Simulator
from ..simulation.sweep import Basins, Sweep
from ..studies.study import Study
from .attractors import (
    attractor_of_run,
    plot_basins,
    plot_fractions,
    plot_manifold,
    plot_sweep,
    portrait_figure,
)
from .curves import plot_curves
from .diagram import plot_diagram, plot_ranges
from .maps import plot_map
from .orbit import plot_fit, plot_orbit

DRAWN = (
    "branches, diagrams, curves, orbits, events, attractors, runs, sweeps, basins, fractions, "
    "ranges, manifolds, fits and studies"
)


@functools.singledispatch
def draw_result(result: Any, *x: Any, **options: Any) -> Any:
    """Draw a result and return the axes.

    Raises InputError if it cannot be drawn.
    """
    found = f"found {short_repr(result)}"
    if isinstance(result, str | Path):
        raise InputError("picture", found, "give a result, as contimpact.load reads it")
    raise InputError("picture", found, f"there are pictures of {DRAWN}")


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
def _(result: Attractor, model: Model | None = None) -> Any:
    simulator = Simulator(result.require_model(model))
    return tuple(portrait_figure(simulator, result, {}).axes)


@draw_result.register
def _(result: Run, model: Model | None = None) -> Any:
    return draw_result(attractor_of_run(result, model))


@draw_result.register
def _(result: Basins, *x: Any, **options: Any) -> Any:
    return plot_basins(result, *x, **options)


@draw_result.register
def _(result: list | tuple, *x: Any, **options: Any) -> Any:
    for kind, draw in ((Branch, plot_diagram), (Curve, plot_curves)):
        if result and all(isinstance(one, kind) for one in result):
            return draw(result, *x, **options)
    if result and all(isinstance(one, Orbit | Entry) for one in result):
        return plot_orbit(*result, *x, **options)
    found = f"found {short_repr(result)}"
    raise InputError("picture", found, "give branches, curves, or orbits and events")


@draw_result.register
def _(result: Sweep, *x: str, **options: Any) -> Any:
    return plot_sweep(result, **{**({"x": x[0]} if x else {}), **options})


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
def _(result: Fit, **options: Any) -> Any:
    return plot_fit(result, **options)


@draw_result.register
def _(result: Study, quantity: str = "ends", **options: Any) -> Any:
    return plot_map(result.map(quantity, **options))
