"""One-parameter runs across a map of curves: what the curves are started from and checked against.

A run is at one value of the second parameter, for one member of the family: orbits of every word of
the scene are looked for at several values of the first parameter, and their branches followed.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..bifurcations.extended_system import solve
from ..bifurcations.registry import test_functions
from ..continuation.test_function import TestFunction
from ..models.model import Model
from ..models.word import Word
from ..orbit_continuation.orbit_branch import Run, both_ways
from ..orbits.problem import Array, OrbitProblem
from ..orbits.quiet import problem_of
from ..orbits.search import find_orbits
from ..records.branch import Branch
from ..records.competition import BIRTHS
from ..records.curve import Curve
from ..records.entry import Entry
from ..records.recovery import orbit_of
from ..records.tables import columns_of
from ..scenes.scene import Scene
from ..segments.kernels import Kernels
from .problem import system_of

SEARCHED = 6
"""Values of the first parameter at which a run looks for orbits, besides the scene's own."""

SAME_CURVE = 1e-8
NEAR_CURVE = 1e-3


def run_at(scene: Scene, model: Model, word: Word, kernels: Kernels) -> list[Run]:
    """Follow every orbit of a word that is found at some value of the first parameter.

    Parameters
    ----------
    scene : Scene
    model : Model
        The member, at the second parameter's value.
    word : Word
    kernels : Kernels
        With the first parameter free.
    """
    return run_along(scene, model, word, kernels, scene.range, _searched(scene))


def run_along(
    scene: Scene, model: Model, word: Word, kernels: Kernels, limits: tuple[float, float],
    searched: Sequence[float],
) -> list[Run]:  # fmt: skip
    """Follow every orbit of a word that is found at some values of a parameter.

    Parameters
    ----------
    scene : Scene
    model : Model
        Gives the values of the other parameters.
    word : Word
    kernels : Kernels
        With the parameter free.
    limits : (low, high)
        Its range.
    searched : sequence of float
        The values.
    """
    problem = problem_of(model, word, kernels)
    tests = _tests(scene, problem)
    runs: list[Run] = []
    for value in searched:
        at = model.replace(**{kernels.parameter: value})
        found = find_orbits(
            at, word, kernels=kernels, rng=scene.seed, starts=scene.starts, rounds=scene.rounds
        )
        for orbit in found:
            if not any(run.holds(orbit.unknowns) for run in runs):
                runs.append(both_ways(problem, orbit.unknowns, limits, tests, scene.settings))
                if runs[-1].interrupted:
                    raise KeyboardInterrupt
    return runs


def run_through(scene: Scene, model: Model, entry: Entry, kernels: Kernels) -> Run:
    """Follow the branch of the first parameter through the orbit of an entry."""
    orbit = orbit_of(entry, model, kernels)
    tests = _tests(scene, orbit.problem)
    return both_ways(orbit.problem, orbit.unknowns, scene.range, tests, scene.settings)


def _tests(scene: Scene, problem: OrbitProblem) -> list[TestFunction]:
    assert scene.curves is not None
    return test_functions(problem, [*scene.curves.kinds, *_before(scene)], {})


def _before(scene: Scene) -> list[str]:
    """Kinds that explain a change of stability and are wanted on branches that are kept."""
    assert scene.curves is not None
    return [kind for kind in scene.events if kind not in scene.curves.kinds]


def _searched(scene: Scene) -> list[float]:
    """The start, and values across the range: even in their logarithms where all are positive."""
    low, high = scene.range
    spaced = np.geomspace if low > 0.0 else np.linspace
    return [scene.start, *spaced(low, high, SEARCHED + 2)[1:-1].tolist()]


def orbit_at_start(branch: Branch, scene: Scene) -> Array | None:
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


def first_of(entries: Sequence[Entry], kinds: Sequence[str], along: str) -> str | None:
    """Return the label of the real bifurcation with the largest value of a column."""
    others = [kind for kind in kinds if kind not in BIRTHS] or kinds
    real = [e for e in entries if e.kind in others and not e.ghost]
    return max(real, key=lambda e: e.parameters[along]).label if real else None


def passes(curve: Curve, entry: Entry, model: Model, kernels: Kernels) -> bool:
    """Whether a curve of the same member passes through an entry.

    Wherever the curve passes the entry's value of the second parameter, its orbit there is solved
    for and compared.

    Parameters
    ----------
    curve : Curve
    entry : Entry
    model : Model
    kernels : Kernels
        With the first parameter free.
    """
    if (curve.kind, curve.word, curve.period) != (entry.kind, entry.word, entry.period):
        return False
    here = orbit_of(entry, model, kernels)
    problem = here.problem
    return any(
        _same(problem, entry, guess, here.unknowns, size)
        for name in curve.parameters[::-1]
        for guess, size in _crossings(curve, name, entry.parameters[name], problem)
    )


def _crossings(
    curve: Curve, name: str, value: float, problem: OrbitProblem
) -> list[tuple[Array, float]]:
    """Orbits where a curve passes a parameter's value, nearly, and the distance of its points
    around it."""
    first = curve.parameters[0]
    away = curve[name] - value
    names = columns_of(curve.word, problem.m)
    rows = np.column_stack([curve[name] for name in [*names, first]])
    found = []
    for i in np.nonzero((away[:-1] * away[1:] <= 0.0) & (away[:-1] != away[1:]))[0]:
        part = away[i] / (away[i] - away[i + 1])
        found.append(
            (rows[i] + part * (rows[i + 1] - rows[i]), float(np.max(np.abs(rows[i + 1] - rows[i]))))
        )
    return found


def _same(problem: OrbitProblem, entry: Entry, guess: Array, unknowns: Array, size: float) -> bool:
    """Whether the bifurcation next to a guess is that of an entry."""
    away = problem.difference(guess, unknowns)
    off = float(np.max(np.abs(away)))
    if off > size + NEAR_CURVE:
        return False
    solution = solve(system_of(problem, entry), problem.evaluate(unknowns + away))
    if solution is None:
        return off < NEAR_CURVE
    return bool(np.max(np.abs(problem.difference(solution.unknowns, unknowns))) < SAME_CURVE)


def same_curve(one: Curve, other: Curve) -> bool:
    """Whether two curves have the same ends, in either direction."""
    about = [(c.kind, c.word, c.period, dict(c.fixed)) for c in (one, other)]
    if about[0] != about[1]:
        return False
    a, b = (_ends(curve) for curve in (one, other))
    return bool(np.allclose(a, b, atol=1e-6) or np.allclose(a, b[::-1], atol=1e-6))


def _ends(curve: Curve) -> Array:
    names = [*curve.parameters, *(f"v{k + 1}" for k in range(len(curve.word)))]
    return np.array([[curve[name][row] for name in names] for row in (0, -1)])
