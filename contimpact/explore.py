"""A scene's whole diagram: its orbits, their branches, and what they cost."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .bifurcations import test_functions
from .continuation.branch import Point
from .diagram import Branch, Diagram
from .errors import InputError
from .mechanics.kernels import Kernels
from .mechanics.orbit import OrbitProblem
from .mechanics.search import Orbit, find_orbits
from .mechanics.word import Word
from .orbit_branch import Run, both_ways
from .scene import Scene


def follow(scene: Scene, progress: Callable[[str], None] | None = None) -> Diagram:
    """Compute the diagram of a scene.

    Parameters
    ----------
    scene : Scene
        From `load_scene`.
    progress : callable, optional
        Called with a line of text now and then.

    Returns
    -------
    Diagram

    Raises
    ------
    InputError
        If an orbit the scene names does not exist at its start.
    """
    return _Follower(scene, progress or (lambda text: None)).run()


STAGES = ("kernels", "search", "walk", "events", "tables")


@dataclass
class _Follower:
    scene: Scene
    progress: Callable[[str], None]
    runs: list[Run] = field(default_factory=list)
    branches: list[Branch] = field(default_factory=list)
    seconds: dict[str, float] = field(
        default_factory=lambda: dict.fromkeys(
            ("kernels", "search", "walk", "events", "tables"), 0.0
        )
    )

    def run(self) -> Diagram:
        scene = self.scene
        began = time.perf_counter()
        self.kernels = Kernels(scene.model, scene.parameter)
        for word in scene.orbits:
            OrbitProblem(scene.model, word, self.kernels)
        self.seconds["kernels"] += time.perf_counter() - began
        started = [(word, self.orbits_of(word)) for word in scene.orbits]
        for word, orbits in started:
            for orbit in orbits:
                if not any(
                    run.problem.word == word and run.holds(orbit.unknowns) for run in self.runs
                ):
                    self.follow_from(orbit)
        return Diagram(scene.name, self.branches, self.statistics())

    def orbits_of(self, word: Word) -> list[Orbit]:
        began = time.perf_counter()
        self.progress(f"looking for {word} at {self.scene.parameter} = {self.scene.start:.9g}")
        found = orbits_at_start(self.scene, self.kernels, word)
        self.seconds["search"] += time.perf_counter() - began
        return found

    def follow_from(self, orbit: Orbit) -> None:
        scene, problem = self.scene, orbit.problem
        name = f"b{len(self.branches) + 1}"
        shown = problem.word.notation([w.name for w in scene.model.WALLS])
        count = 0

        def report(point: Point) -> None:
            nonlocal count
            count += 1
            if count % 20 == 0:
                self.progress(
                    f"{name} {shown}: {count} points, {scene.parameter} = {point.parameter:.6g}"
                )

        began = time.perf_counter()
        tests = test_functions(problem, scene.events, scene.values)
        run = both_ways(problem, orbit.unknowns, scene.range, tests, scene.settings, report)
        in_events = sum(w.seconds_in_events for w in run.walks)
        self.seconds["events"] += in_events
        walked = time.perf_counter()
        self.seconds["walk"] += walked - began - in_events
        self.runs.append(run)
        first = 1 + sum(len(branch.events) for branch in self.branches)
        self.branches.append(run.branch(name, first_entry=first))
        self.seconds["tables"] += time.perf_counter() - walked

    def statistics(self) -> dict[str, Any]:
        walks = [w for run in self.runs for w in run.walks]
        problems = {id(run.problem): run.problem for run in self.runs}
        return {
            "seconds": self.seconds,
            "counts": {
                "points": sum(len(run.points) for run in self.runs),
                "corrector_iterations": sum(w.corrector_iterations for w in walks),
                "rejected_steps": sum(w.rejected_steps for w in walks),
                "kernel_evaluations": sum(p.kernel_evaluations for p in problems.values()),
            },
            "kernels": {"loaded": self.kernels.loaded, "generated": self.kernels.generated},
        }


def orbits_at_start(scene: Scene, kernels: Kernels, word: Word) -> list[Orbit]:
    """Find the orbits of a word at a scene's start.

    Raises
    ------
    InputError
        If there is none; it says what was tried and what exists nearby.
    """
    options: Any = {"rng": scene.seed, "starts": scene.starts, "rounds": scene.rounds}
    found = find_orbits(scene.model, word, kernels=kernels, **options)
    if found:
        return found
    nearby = []
    for value in np.linspace(*scene.range, 11)[1:-1].tolist():
        model = scene.model.replace(**{scene.parameter: value})
        if count := len(find_orbits(model, word, kernels=kernels, **options)):
            nearby.append(f"{count} at {scene.parameter} = {value:.6g}")
    where = f"model.parameters.{scene.parameter}"
    raise InputError(
        "follow.orbits",
        f"no {word} orbit was found at {scene.parameter} = {scene.start:.9g} (rounds of "
        f"{scene.starts} random starts)",
        f"start where one exists, by {where}: {', '.join(nearby)}"
        if nearby
        else "nor at nine other values within the range; try another word or other parameters",
    )
