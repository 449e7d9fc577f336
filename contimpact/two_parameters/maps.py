"""A scene's map of two parameters: its curves, and the areas between them."""

from __future__ import annotations

import dataclasses
import itertools
import time

import numpy as np

from ..progress import Progress, silent
from ..results.curve import Area
from ..results.diagram import Diagram
from ..results.scene import Scene
from ..segments.kernels import Kernels
from .areas import divide
from .explore import with_curves


def with_map(scene: Scene, diagram: Diagram, progress: Progress | None = None) -> Diagram:
    """Return a scene's diagram with its curves, and with areas if the scene asks for them.

    Parameters
    ----------
    scene : Scene
        With ``curves``.
    diagram : Diagram
        Of that scene.
    progress : callable, optional
    """
    assert scene.curves is not None
    diagram = with_curves(scene, diagram, progress)
    if not scene.curves.areas or diagram.statistics["failure"]:
        return diagram
    return with_areas(scene, diagram, progress)


def with_areas(scene: Scene, diagram: Diagram, progress: Progress | None = None) -> Diagram:
    """Return a diagram of curves with the areas between them, for every member of the family."""
    assert scene.curves is not None
    began = time.perf_counter()
    kernels, names, failure = Kernels(scene.model, scene.parameter), itertools.count(1), None
    areas: list[Area] = []
    notes: list[str] = []
    name, values = scene.curves.family or ("", ())
    try:
        for fixed in [{name: value} for value in values] or [{}]:
            own = [curve for curve in diagram.curves if dict(curve.fixed) == fixed]
            model = scene.model.replace(**fixed)
            found, told = divide(scene, model, own, fixed, kernels, progress or silent, names)
            areas += found
            notes += told
    except KeyboardInterrupt:
        failure = "interrupted"
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        failure = f"the computation failed ({type(error).__name__}: {error})"
    statistics = dict(diagram.statistics)
    statistics["seconds"] = statistics["seconds"] | {"areas": time.perf_counter() - began}
    statistics["notes"] = [*statistics["notes"], *notes]
    statistics["failure"] = failure
    return dataclasses.replace(diagram, areas=areas or (), statistics=statistics)
