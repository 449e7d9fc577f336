"""Error against run time: a scene's branches and events, measured against thirty digits.

Methods on the same axes, for one branch: the library with its tolerance varied and with its step
varied, each with both predictors, and what a user would write without it: SciPy's `solve_ivp` with
events, shooting, and a Jacobian by finite differences. Evaluations do not depend on the machine;
seconds do, so repetitions, their median and their spread are kept.
"""

from __future__ import annotations

import dataclasses
import os
import platform
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from .. import __version__
from ..continuation.branch import Point, Walk
from ..continuation.settings import PREDICTORS, Settings
from ..diagrams.explore import follow
from ..diagrams.orbit_walks import walk_orbits
from ..diagrams.starting_orbits import orbits_at_start
from ..errors import InputError
from ..orbits.orbit import Orbit
from ..orbits.problem import Array
from ..results.diagram import Diagram
from ..results.scene import Scene
from ..segments.kernels import Kernels
from .certified import certified
from .events import DIGITS, honesty, measured_events
from .long_words import long_words
from .reference import Reference
from .shooting import EXPLICIT
from .shot import shot, some
from .simulated import simulated
from .timing import SECONDS, spread, within_budget

SCHEMA = "contimpact.report/1"
TOLERANCES = tuple(10.0**-k for k in range(4, 15))
STEPS = (0.2, 0.1, 0.05, 0.025, 0.0125, 0.00625, 0.003125)
SAMPLES = 40
"""Orbits or places between points at which a method's error is measured, as far as the budget of a
row allows."""

POINTS = 400


def report(
    scene: Scene, repetitions: int = 5, progress: Callable[[str], None] | None = None
) -> dict[str, Any]:
    """Measure error against run time for a scene.

    Parameters
    ----------
    scene : Scene
    repetitions : int
        How often each timing is repeated.
    progress : callable, optional
        Called with a line of text now and then.

    Returns
    -------
    dict
        Plain data, as written to ``report.json``.

    Raises
    ------
    InputError
        If the scene's first orbit with impacts does not exist at its start, it has none, or
        `repetitions` is below 1.
    """
    if repetitions < 1:
        raise InputError("repetitions", f"found {repetitions!r}", "give a whole number >= 1")
    progress = progress or (lambda text: None)
    kernels = Kernels(scene.model, scene.parameter)
    progress("the scene's diagram")
    diagram = follow(scene)
    orbit = _orbit(scene, kernels, diagram)
    task = _Task(scene, orbit, repetitions, progress)
    methods = task.walked()
    methods += task.shooting()
    progress("events")
    events = measured_events(scene, kernels, diagram)
    progress("simulation")
    simulation = simulated(scene, TOLERANCES, repetitions, DIGITS)
    proofs = certified(scene, progress)
    progress("long words")
    return {
        "schema": SCHEMA,
        "scene": scene.name,
        "orbit": str(orbit.word),
        "digits": DIGITS,
        "repetitions": repetitions,
        "machine": machine(),
        "methods": methods,
        "events": events,
        "honesty": honesty(events),
        "simulation": simulation,
        "certificates": proofs,
        "long_words": long_words(orbit, repetitions),
    }


def _orbit(scene: Scene, kernels: Kernels, diagram: Diagram) -> Orbit:
    """The orbit whose branch a report compares: the first with impacts of those that the scene
    names, or of those that were found from them, half way along its branch."""
    word = next((word for word in scene.orbits if word.walls), None)
    if word is not None:
        return orbits_at_start(scene, kernels, word)[0]
    for branch in diagram.branches:
        if branch.word and branch.parameter == scene.parameter:
            return branch.orbit(len(branch) // 2, scene.model)
    accepted = "name one with impacts besides: a report compares times and velocities of impacts"
    raise InputError("follow.orbits", "no word but 0, and none was born on it", accepted)


def machine() -> dict[str, Any]:
    """Return what the timings depend on, in general terms."""
    import mpmath
    import scipy

    return {
        "processors": os.cpu_count(),
        "system": sys.platform,
        "architecture": platform.machine(),
        "python": platform.python_version(),
        "contimpact": __version__,
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "mpmath": mpmath.__version__,
    }


_Place = tuple[Array, int]


@dataclasses.dataclass
class _Task:
    """What all methods do: orbits of the branch through the scene's first orbit."""

    scene: Scene
    orbit: Orbit
    repetitions: int
    progress: Callable[[str], None]

    def __post_init__(self) -> None:
        self.problem = self.orbit.problem
        self.exact = Reference(self.problem, DIGITS)

    def walks(self, settings: Settings) -> list[Walk]:
        start, limits = (self.problem, self.orbit.unknowns), self.scene.range
        return [
            walk_orbits(*start, direction, gaps=False, limits=limits, settings=settings)
            for direction in (-1, +1)
        ]

    def settings(self, **changes: Any) -> Settings:
        base = dataclasses.replace(self.scene.settings, max_points=POINTS, min_step=1e-7)
        return dataclasses.replace(base, **changes)

    def walked(self) -> list[dict[str, Any]]:
        """The branch at every tolerance and at every largest step, with both predictors.

        Repetitions go around all of them, so that what else the machine does meets all alike.
        """
        methods = []
        for predictor in PREDICTORS:
            methods.append(self.tolerances(predictor))
            methods.append(self.steps(predictor))
        rows = [row for method in methods for row in method["rows"]]
        settings = [row.pop("settings") for row in rows]
        firsts = [row.pop("first") for row in rows]
        seconds = [[first] if first > SECONDS else [] for first in firsts]
        for number in range(self.repetitions):
            self.progress(f"timings, repetition {number + 1}")
            for own, chosen in zip(seconds, settings, strict=True):
                if sum(own) <= SECONDS:
                    began = time.process_time()
                    self.walks(chosen)
                    own.append(time.process_time() - began)
        for row, own in zip(rows, seconds, strict=True):
            row["seconds"] = spread(own)
        return methods

    def tolerances(self, predictor: str) -> dict[str, Any]:
        """Errors of the points, at every tolerance."""
        rows = [
            self.row(tolerance, self.settings(tolerance=tolerance, predictor=predictor), _at_points)
            for tolerance in TOLERANCES
        ]
        return _method(f"tolerance, {predictor} predictor", "tolerance", "points", rows)

    def steps(self, predictor: str) -> dict[str, Any]:
        """Errors of the curve half way between points, at every largest step."""
        rows = []
        for step in STEPS:
            least = min(step, self.scene.settings.step)
            steps = {"max_step": step, "step": least, "max_angle": step * 2.0}
            settings = self.settings(
                **steps, predictor=predictor, tolerance=1e-13, max_points=20 * POINTS
            )
            rows.append(self.row(step, settings, _between_points))
        return _method(f"step, {predictor} predictor", "max_step", "curve between points", rows)

    def row(
        self, value: float, settings: Settings, places: Callable[[Walk], list[_Place]]
    ) -> dict[str, Any]:
        """Error and evaluations; the seconds are measured afterwards."""
        self.progress(f"a branch with the setting {value:.0e}")
        before, began = self.problem.kernel_evaluations, time.process_time()
        walks = self.walks(settings)
        evaluations = self.problem.kernel_evaluations - before
        first = time.process_time() - began
        guesses = _mixed(some([guess for w in walks for guess in places(w)], SAMPLES))
        errors = [self.error(*place) for place in within_budget(guesses)]
        return {
            "setting": value,
            "error": max(errors, default=None),
            "places": len(errors),
            "evaluations": evaluations,
            "orbits": sum(len(w.points) for w in walks),
            "failed": 0,
            "settings": settings,
            "first": first,
        }

    def error(self, unknowns: Array, held: int = -1) -> float:
        """The distance from the exact branch, where it has the same value of one unknown."""
        found = self.exact.orbit(unknowns, held)
        return found.distance(unknowns) if found else float("inf")

    def shooting(self) -> list[dict[str, Any]]:
        """What a user would write: nothing for systems it has no simple form for."""
        walks = self.walks(self.settings())
        found = shot(self.problem, walks, TOLERANCES, self.repetitions, self.progress)
        methods = []
        for integrator, rows in found.items():
            for row in rows:
                row["error"] = max(map(self.error, row.pop("reached")), default=None)
            name = "shooting, solve_ivp" + (f" ({integrator})" if integrator != EXPLICIT else "")
            methods.append(_method(name, "rtol", "points", rows))
        return methods


def _method(name: str, varied: str, measure: str, rows: list[dict[str, Any]]) -> dict[str, Any]:
    return {"name": name, "varied": varied, "error_of": measure, "rows": rows}


def _mixed(items: list[Any]) -> list[Any]:
    """The same items in an order in which the first few are spread over all."""
    order = sorted(range(len(items)), key=lambda i: f"{i:010b}"[::-1])
    return [items[i] for i in order]


def _at_points(walked: Walk) -> list[_Place]:
    return [(point.unknowns, _fastest(point)) for point in walked.points]


def _between_points(walked: Walk) -> list[_Place]:
    """The cubic through neighbouring points with their tangents, half way."""
    places = []
    for a, b in zip(walked.points, walked.points[1:], strict=False):
        bend = 0.125 * (b.arclength - a.arclength) * (a.tangent - b.tangent)
        places.append((0.5 * (a.unknowns + b.unknowns) + bend, _fastest(a)))
    return places


def _fastest(point: Point) -> int:
    """The unknown by which the branch is best told along its way: not the parameter at a fold."""
    return int(np.argmax(np.abs(point.tangent)))
