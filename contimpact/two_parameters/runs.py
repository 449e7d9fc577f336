"""One-parameter runs across a map of curves: what the curves are started from and checked against.

A run is at one value of the second parameter, for one member of the family: orbits of every word of
the scene are looked for at several values of the first parameter, and their branches followed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from ..bifurcations.extended_system import solve
from ..bifurcations.registry import test_functions
from ..continuation.branch import Event, TestFunction
from ..continuation.corrector import first_tangent
from ..models.model import Model
from ..models.word import Word, is_rotation
from ..orbit_continuation.orbit_branch import Run, both_ways
from ..orbit_continuation.orbit_walks import walk_orbits
from ..orbit_continuation.symmetry import at_image, watched
from ..orbits.orbit import Orbit
from ..orbits.problem import Array, OrbitProblem
from ..orbits.quiet import problem_of
from ..orbits.search import find_orbits, rotated_to
from ..results.branch import Branch, Entry, orbit_of
from ..results.curve import BIRTHS, Curve
from ..results.entry_conversion import details_of
from ..results.scene import Scene
from ..results.tables import columns_of
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
    scene: Scene,
    model: Model,
    word: Word,
    kernels: Kernels,
    limits: tuple[float, float],
    searched: Sequence[float],
    tests: list[TestFunction] | None = None,
    wanted: Callable[[Orbit], bool] = lambda orbit: True,
) -> list[Run]:
    """Follow every wanted orbit of a word that is found at some values of a parameter.

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
    tests : list of TestFunction, optional
        Those of `tests_of` by default.
    wanted : callable ``wanted(orbit) -> bool``
        Of an orbit that was found.
    """
    problem = problem_of(model, word, kernels)
    tests = tests_of(scene, problem) if tests is None else tests
    runs: list[Run] = []
    for value in searched:
        at = model.replace(**{kernels.parameter: value})
        found = find_orbits(
            at, word, kernels=kernels, rng=scene.seed, starts=scene.starts, rounds=scene.rounds
        )
        for orbit in found:
            if wanted(orbit) and not any(run.holds(orbit.unknowns) for run in runs):
                runs.append(both_ways(problem, orbit.unknowns, limits, tests, scene.settings))
                if runs[-1].interrupted:
                    raise KeyboardInterrupt
    return runs


def run_through(scene: Scene, model: Model, entry: Entry, kernels: Kernels) -> Run:
    """Follow the branch of the first parameter through the orbit of an entry.

    From a step beside it: on the entry itself the walk could not tell which way it crosses.
    """
    orbit = orbit_of(entry, model, kernels)
    return _run_from(scene, orbit.problem, _beside(orbit.problem, orbit.unknowns, scene))


def run_with(scene: Scene, model: Model, entry: Entry, kernels: Kernels) -> Run:
    """Follow the branch through the orbit of an entry, with that as its only event.

    For where the test function sees no crossing: all orbits of the branch may be on the curve.
    """
    orbit = orbit_of(entry, model, kernels)
    run = _run_from(scene, orbit.problem, orbit.unknowns)
    place = int(np.argmin(np.max(np.abs(run.points.unknowns - orbit.unknowns), axis=1)))
    told = entry.residual, entry.error, entry.method, details_of(entry)
    return dataclasses.replace(run, events=[Event(entry.kind, run.points[place], *told)])


def _run_from(scene: Scene, problem: OrbitProblem, start: Array) -> Run:
    stop = at_image(problem)
    tests = watched(tests_of(scene, problem), stop)
    return both_ways(problem, start, scene.range, tests, scene.settings, stop=stop)


def _beside(problem: OrbitProblem, unknowns: Array, scene: Scene) -> Array:
    """An orbit one step further on the branch through another one, if that step can be made."""
    jacobian = problem.evaluate(unknowns).jacobian
    settings = dataclasses.replace(scene.settings, max_points=2)
    scale = problem.scale(unknowns, scene.range[1] - scene.range[0])
    tangent = first_tangent(jacobian, scale)
    if tangent is None:
        return unknowns
    for direction in (+1, -1):
        walk = walk_orbits(
            problem,
            unknowns,
            direction,
            limits=scene.range,
            settings=settings,
            tangent=tangent,
            gaps=False,
        )
        if len(walk.points) > 1 and scene.range[0] < walk.points[-1].parameter < scene.range[1]:
            return walk.points[-1].unknowns
    return unknowns


def tests_of(scene: Scene, problem: OrbitProblem) -> list[TestFunction]:
    """Return the test functions of a run: of the kinds with curves, then the scene's others."""
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


def first_of(entries: Sequence[Entry], kinds: Sequence[str], along: str) -> Entry | None:
    """Return the real bifurcation with the largest value of a column."""
    others = [kind for kind in kinds if kind not in BIRTHS] or kinds
    real = [e for e in entries if e.kind in others and not e.ghost]
    return max(real, key=lambda e: e.parameters[along], default=None)


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
    if (curve.kind, curve.period) != (entry.kind, entry.period):
        return False
    if not is_rotation(curve.word, entry.word):
        return False
    here = orbit_of(entry, model, kernels)
    problem = here.problem
    first, second = curve.parameters
    if any(
        _same(problem, entry, guess, here.unknowns, size)
        for name in (second, first)
        for guess, size in _crossings(curve, name, entry.parameters[name], problem)
    ):
        return True
    near = [
        (np.append(guess[:-1], entry.parameters[second]), size)
        for guess, size in _crossings(curve, first, entry.parameters[first], problem)
        if _apart(problem, guess, here.unknowns) < NEAR_CURVE
    ]
    return bool(near) and _passes_across(entry, model, second, near)


def _passes_across(
    entry: Entry, model: Model, second: str, near: Sequence[tuple[Array, float]]
) -> bool:
    """The same with the second parameter free: where the curve keeps its value, the first one is
    not told by the equations."""
    turned = dataclasses.replace(entry, parameter=second)
    here = orbit_of(turned, model, Kernels(model, second))
    return any(_same(here.problem, turned, guess, here.unknowns, size) for guess, size in near)


def _crossings(
    curve: Curve, name: str, value: float, problem: OrbitProblem
) -> list[tuple[Array, float]]:
    """Orbits where a curve passes a parameter's value, nearly, and the distance of its points
    around it."""
    first, word = curve.parameters[0], Word(curve.word, curve.period)
    own = problem_of(problem.model, word, problem.kernels)
    away = curve[name] - value
    names = columns_of(curve.word, problem.m)
    rows = np.column_stack([curve[name] for name in [*names, first]])
    found = []
    for i in np.nonzero((away[:-1] * away[1:] <= 0.0) & (away[:-1] != away[1:]))[0]:
        part = away[i] / (away[i] - away[i + 1])
        guess = rotated_to(own, rows[i] + part * (rows[i + 1] - rows[i]), problem.word)
        assert guess is not None, "the words are rotations of each other"
        found.append((guess, float(np.max(np.abs(rows[i + 1] - rows[i])))))
    return found


def _same(problem: OrbitProblem, entry: Entry, guess: Array, unknowns: Array, size: float) -> bool:
    """Whether the bifurcation next to a guess is that of an entry."""
    away = problem.difference(guess, unknowns)
    off = _apart(problem, guess, unknowns)
    if off > size + NEAR_CURVE:
        return False
    solution = solve(system_of(problem, entry), problem.evaluate(unknowns + away))
    if solution is None:
        return off < NEAR_CURVE
    return bool(np.max(np.abs(problem.difference(solution.unknowns, unknowns))) < SAME_CURVE)


def _apart(problem: OrbitProblem, one: Array, other: Array) -> float:
    return float(np.max(np.abs(problem.difference(one, other))))


def same_curve(one: Curve, other: Curve) -> bool:
    """Whether two curves have the same ends, in either direction."""
    about = [(c.kind, c.period, dict(c.fixed)) for c in (one, other)]
    if about[0] != about[1] or not is_rotation(one.word, other.word):
        return False
    a, b = (_ends(curve) for curve in (one, other))
    return bool(np.allclose(a, b, atol=1e-6) or np.allclose(a, b[::-1], atol=1e-6))


def _ends(curve: Curve) -> Array:
    speeds = [f"v{k + 1}" for k in range(len(curve.word))]
    return np.array(
        [
            [*(curve[n][row] for n in curve.parameters), *sorted(curve[n][row] for n in speeds)]
            for row in (0, -1)
        ]
    )
