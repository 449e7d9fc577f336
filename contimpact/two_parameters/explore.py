"""A scene's curves: started at the entries of its diagram, for every member of its family."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from ..bifurcations import Requested, test_functions
from ..continuation.branch import End
from ..continuation.interruption import interrupted
from ..diagram import Branch, Diagram, Entry
from ..mechanics.kernels import Kernels
from ..mechanics.model import Model
from ..mechanics.orbit import Array, OrbitProblem
from ..mechanics.search import settle
from ..orbit_branch import both_ways
from ..orbit_march import walk_orbits
from ..progress import Progress, counted, silent
from ..scene import CurveOptions, Scene
from .curves import Curve, follow_curve, with_fixed

SAME_CURVE = 1e-8


def with_curves(scene: Scene, diagram: Diagram, progress: Progress | None = None) -> Diagram:
    """Return a scene's diagram with its curves.

    Parameters
    ----------
    scene : Scene
        With ``curves``.
    diagram : Diagram
        Of that scene; its branches are those of the scene's own parameter values. For a family,
        the branches of its members are added.
    progress : callable, optional
    """
    assert scene.curves is not None
    return _CurveExplorer(scene, scene.curves, diagram, progress or silent).run()


@dataclasses.dataclass
class _CurveExplorer:
    scene: Scene
    options: CurveOptions
    diagram: Diagram
    progress: Progress
    branches: list[Branch] = dataclasses.field(default_factory=list)
    curves: list[Curve] = dataclasses.field(default_factory=list)
    notes: list[str] = dataclasses.field(default_factory=list)
    evaluations: int = 0

    def run(self) -> Diagram:
        began = time.perf_counter()
        scene, options = self.scene, self.options
        self.kernels = Kernels(scene.model, scene.parameter)
        self.pairs = Kernels(scene.model, scene.parameter, options.parameter)
        self.branches = list(self.diagram.branches)
        failure = None
        try:
            for fixed, model, branches in self.members():
                for entry in (entry for branch in branches for entry in branch.events):
                    if entry.kind in options.kinds and (entry.physical or options.unphysical):
                        self.follow(entry, model, fixed)
        except KeyboardInterrupt:
            failure = "interrupted"
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            failure = f"the computation failed ({type(error).__name__}: {error})"
        statistics = dict(self.diagram.statistics)
        statistics["seconds"] = {
            **statistics.get("seconds", {}), "curves": time.perf_counter() - began,
        }  # fmt: skip
        statistics["failure"] = failure
        counts = dict(statistics.get("counts", {}))
        counts["curve_points"] = sum(len(curve) for curve in self.curves)
        counts["curve_kernel_evaluations"] = sum(c.evaluations for c in self.curves)
        counts["family_kernel_evaluations"] = self.evaluations
        statistics["counts"] = counts
        statistics["notes"] = [*statistics.get("notes", []), *self.notes]
        loaded = statistics.get("kernels", {"loaded": [], "generated": []})
        statistics["kernels"] = {
            how: [*loaded[how], *(f"{name} (two parameters)" for name in getattr(self.pairs, how))]
            for how in ("loaded", "generated")
        }
        return dataclasses.replace(
            self.diagram, branches=self.branches, curves=self.curves, statistics=statistics
        )

    # The family: the scene's orbits carried to each value, and their branches there.

    def members(self) -> Iterator[tuple[dict[str, float], Model, list[Branch]]]:
        """The family's fixed values, the model there, and the branches there."""
        scene, family = self.scene, self.options.family
        if family is None:
            yield {}, scene.model, list(self.diagram.branches)
            return
        name, values = family
        carried = [self.carry(branch, name, values) for branch in self.diagram.branches]
        own = [b for b in self.diagram.branches if _orbit_at_start(b, self.scene) is not None]
        for value in values:
            model = scene.model.replace(**{name: value})
            if value == scene.model.values[name]:
                yield {name: value}, model, own
                continue
            members = []
            for reached in carried:
                if value in reached:
                    self.progress(f"{name} = {value:.6g}: branch of {scene.parameter}")
                    members.append(self.branch_at(model, *reached[value]))
                    self.branches.append(members[-1])
                    _go_on(members[-1].ends)
            yield {name: value}, model, members

    def carry(
        self, branch: Branch, name: str, values: tuple[float, ...]
    ) -> dict[float, tuple[OrbitProblem, Array]]:
        """A branch's orbit at the scene's start, followed in the family's parameter."""
        scene = self.scene
        start = _orbit_at_start(branch, scene)
        if start is None:
            self.notes.append(f"branch {branch.id} is not physical at the start: not in the family")
            return {}
        model = scene.model
        kernels = Kernels(model, name)
        word = next(w for w in scene.orbits if w.walls == branch.word and w.period == branch.period)
        problem = OrbitProblem(model, word, kernels)
        own = model.values[name]
        reached = {}
        for direction in (-1, 1):
            wanted = [v for v in values if (v - own) * direction > 0]
            if not wanted:
                continue
            limits = (min(own, *wanted), max(own, *wanted))
            test = Requested(problem, {name: wanted})
            done = walk_orbits(
                problem, np.append(start, own), direction, gaps=False, limits=limits,
                tests=[test], settings=dataclasses.replace(scene.settings, max_step=0.1),
            )  # fmt: skip
            points = {round(e.parameter, 14): e.point.unknowns for e in done.events}
            points[round(done.end.value, 14)] = done.points[-1].unknowns
            for value in wanted:
                if round(value, 14) in points:
                    reached[value] = (problem, points[round(value, 14)])
                else:
                    self.notes.append(
                        f"{name} = {value:.9g} was not reached from {own:.9g}: {done.end.message}"
                    )
        self.evaluations += problem.kernel_evaluations
        return reached

    def branch_at(self, model: Model, problem: OrbitProblem, unknowns: Array) -> Branch:
        scene = self.scene
        here = OrbitProblem(model, problem.word, self.kernels)
        start = np.append(unknowns[:-1], scene.start)
        settled = settle(here, start)
        tests = test_functions(here, scene.events, scene.values)
        at = start if settled is None else settled.unknowns
        run = both_ways(here, at, scene.range, tests, scene.settings)
        first = 1 + sum(len(branch.events) for branch in self.branches)
        branch = run.branch(f"b{len(self.branches) + 1}", None, first, scene.events)
        self.evaluations += here.kernel_evaluations
        return branch

    # The curves.

    def follow(self, entry: Entry, model: Model, fixed: Mapping[str, float]) -> None:
        """Follow the curve through an entry, unless a curve of this member passes it already."""
        options, scene = self.options, self.scene
        value = entry.parameters[options.parameter]
        if any(_passes(curve, entry, value, fixed) for curve in self.curves):
            return
        name = f"c{len(self.curves) + 1}"
        shown = f"curve {name}: {entry.label} in ({scene.parameter}, {options.parameter})"
        self.progress(shown)
        curve = follow_curve(
            entry, model, options.parameter, scene.range, options.range, name=name,
            values=sorted({*options.values, value}), settings=options.settings, kernels=self.pairs,
            callback=counted(shown, options.parameter, self.progress),
        )  # fmt: skip
        self.curves.append(with_fixed(curve, fixed))
        _go_on(curve.ends)


def _go_on(ends: Iterable[End]) -> None:
    """Let an interruption go on that has ended a branch or a curve, now that this is kept."""
    if interrupted(ends):
        raise KeyboardInterrupt


def _orbit_at_start(branch: Branch, scene: Scene) -> Array | None:
    """Impacts of a physical orbit of the branch at the scene's start, nearly; None without one."""
    away = branch[branch.parameter] - scene.start
    passes = (away[:-1] * away[1:] <= 0.0) & branch.physical[:-1] & branch.physical[1:]
    if not np.any(passes):
        return None
    row = int(np.argmax(passes))
    span = away[row + 1] - away[row]
    part = -away[row] / span if span else 0.0
    impacts = np.stack([branch.times, branch.velocities], axis=2).reshape(len(branch), -1)
    return np.asarray(impacts[row] + part * (impacts[row + 1] - impacts[row]))


def _passes(curve: Curve, entry: Entry, value: float, fixed: Mapping[str, Any]) -> bool:
    """Whether a curve passes through an entry's orbit at the entry's second parameter."""
    if (curve.kind, curve.word, curve.period) != (entry.kind, entry.word, entry.period):
        return False
    if dict(curve.fixed) != dict(fixed):
        return False
    first, second = curve.parameters
    rows = np.nonzero(np.abs(curve[second] - value) < SAME_CURVE)[0]
    speeds = np.array([impact["velocity"] for impact in entry.impacts])
    return any(
        abs(curve[first][row] - entry.parameters[first]) < SAME_CURVE
        and np.max(np.abs([curve[f"v{k + 1}"][row] for k in range(len(speeds))] - speeds))
        < SAME_CURVE
        for row in rows
    )
