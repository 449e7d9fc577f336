"""The branches that cross one line of a map: found on other lines, by search, and by switching."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ..bifurcations.kind import once
from ..bifurcations.registry import kind_of, switch
from ..continuation.branch import Event, Points
from ..continuation.ends import End, EndKind
from ..orbit_continuation.born import first_step, run_born
from ..orbit_continuation.orbit_branch import Run, both_ways
from ..orbit_continuation.symmetry import at_image, watched
from ..orbits.physicality import PHYSICAL
from ..orbits.problem import Array, OrbitProblem, Summary
from ..orbits.quiet import problem_of
from ..orbits.search import rotated_to, search_for, shortest, solve_near
from ..results.scene import Scene
from .runs import tests_of

AT_ONE_VALUE = 32
"""Starts of a search at one value: many values with few starts each see more of a line than few
values with many."""

FEWEST_VALUES = 5

SAME_ORBIT = 1e-7

Range = tuple[float, float]


def crossing_runs(
    scene: Scene,
    problem: OrbitProblem,
    limits: Range,
    known: Iterable[Array],
    generator: np.random.Generator,
) -> list[Run]:
    """Follow every orbit of a word that is found on a line.

    First those that other lines have met where they cross this one, then those that a search finds
    at values scattered along it, until it finds nothing new.

    Parameters
    ----------
    scene : Scene
    problem : OrbitProblem
        At the value that is held.
    limits : (low, high)
        Of the other parameter.
    known : iterable of ndarray
        Orbits nearly, that parameter's value last.
    generator : numpy.random.Generator
    """
    runs: list[Run] = []
    for unknowns in known:
        here = solve_near(problem, unknowns)
        if here is not None:
            _follow(runs, scene, problem, here.unknowns, limits)
    count = max(FEWEST_VALUES, scene.starts // AT_ONE_VALUE)
    for _ in range(scene.rounds):
        before = len(runs)
        for part in (np.arange(count) + generator.uniform(size=count)) / count:
            model = problem.model.replace(**{problem.parameter: across(limits, part)})
            there = problem_of(model, problem.word, problem.kernels)
            for orbit in search_for(there, generator, AT_ONE_VALUE, 1).orbits:
                _follow(runs, scene, problem, orbit.unknowns, limits)
            problem.kernel_evaluations += there.kernel_evaluations
        if len(runs) == before:
            break
    return runs


def _follow(
    runs: list[Run], scene: Scene, problem: OrbitProblem, unknowns: Array, limits: Range
) -> None:
    """Add the run through an orbit, unless it lies on one already."""
    if not lies_on(runs, problem, unknowns):
        runs.append(run_on_line(scene, problem, unknowns, limits))


def run_on_line(scene: Scene, problem: OrbitProblem, unknowns: Array, limits: Range) -> Run:
    """Follow an orbit along a line, both ways."""
    stop = at_image(problem)
    tests = watched(tests_of(scene, problem), stop)
    run = both_ways(problem, unknowns, limits, tests, scene.settings, stop=stop)
    _uninterrupted(run)
    return run


def lies_on(runs: Sequence[Run], problem: OrbitProblem, unknowns: Array) -> bool:
    """Whether an orbit lies on one of several runs, its word rotated perhaps."""
    for run in runs:
        turned = rotated_to(problem, unknowns, run.problem.word)
        if turned is not None and run.holds(turned):
            return True
    return False


def _uninterrupted(run: Run) -> None:
    if run.interrupted:
        raise KeyboardInterrupt


def switched_runs(scene: Scene, runs: Sequence[Run], limits: Range) -> tuple[list[Run], int]:
    """Follow the branches born at events of runs, as often in turn as the scene switches.

    Those of unphysical orbits are left out. Returns also at how many events the limit on branches
    kept it from switching.
    """
    found: list[Run] = []
    last, unswitched = list(runs), 0
    for _ in range(scene.depth if scene.switch else 0):
        new: list[Run] = []
        for event in _births(scene, last):
            if len(runs) + len(found) + len(new) >= scene.max_branches:
                unswitched += 1
                continue
            run = _switched(scene, event, [*runs, *found, *new], limits)
            new += [] if run is None else [run]
        found += new
        last = new
    return found, unswitched


def _births(scene: Scene, runs: Sequence[Run]) -> Iterator[Event]:
    """The events at which to switch."""
    for event in (event for run in runs for event in run.events if event.kind in scene.switch):
        kind, here = kind_of(event.kind), event.point.evaluation
        if kind.verdict(here, event.details).physical:
            yield event


def _switched(scene: Scene, event: Event, known: Sequence[Run], limits: Range) -> Run | None:
    """The run along the branch born at an event, unless it is known."""
    start = switch(event)
    if start is None:
        return None
    start = once(start)
    probe = first_step(start, limits, scene.settings)
    if not probe.points:
        return None
    problem, unknowns = shortest(start.problem, probe.points[-1].unknowns, SAME_ORBIT)
    if lies_on(known, problem, unknowns):
        return None
    stop = at_image(start.problem)
    tests = tests_of(scene, start.problem)
    born = End.of(EndKind.BORN, start.problem.parameter, event.parameter, entry="", parent="")
    run = run_born(start, born, limits, tests, scene.settings, stop=stop)
    if isinstance(run, End):
        return None
    _uninterrupted(run)
    return run


def across(limits: Range, part: float) -> float:
    """Part of the way across a range, in logarithms where it is wide and all is positive."""
    low, high = limits
    if low > 0.0 and high > 4.0 * low:
        return float(min(max(low * (high / low) ** part, low), high))
    return float(low + (high - low) * part)


def at_value(run: Run, value: float) -> Iterator[Array]:
    """Orbits on a run at a value of its parameter, nearly."""
    rows = run.rows
    behind, ahead = rows[:-1, -1], rows[1:, -1]
    for i in np.nonzero(((behind - value) * (ahead - value) <= 0.0) & (behind != ahead))[0]:
        part = (value - behind[i]) / (ahead[i] - behind[i])
        yield rows[i] + part * (rows[i + 1] - rows[i])


def physical(points: Points) -> Array:
    """Whether each of the points is physical."""
    return np.asarray(Summary.of(points.numbers).findings[:, 0] == PHYSICAL)
