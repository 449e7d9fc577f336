"""The run along a branch from where it is born at an event of another one."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

from ..bifurcations.start import Start
from ..continuation.branch import End, EndKind, Point, Walk
from ..continuation.interruption import kept, other_way
from ..continuation.settings import Settings
from ..continuation.test_function import TestFunction
from ..continuation.walk import Stop
from .orbit_backend import walk_orbits
from .orbit_branch import Run
from .symmetry import again, mirrors_back, symmetry_of, watched


def run_born(
    start: Start,
    born: End,
    limits: tuple[float, float],
    tests: Sequence[TestFunction],
    settings: Settings,
    name: str = "b1",
    stop: Stop | None = None,
    callback: Callable[[Point], bool | None] | None = None,
) -> Run | None:
    """Walk along a branch from its start, one way or both as `Start` says.

    Parameters
    ----------
    start : Start
    born : End
        That of the way that is not gone.
    limits : (low, high)
    tests : sequence of TestFunction
    settings : Settings
    name : str
        The branch's, for the end of one that mirrors itself.
    stop, callback : callable, optional
        As of `contimpact.continuation.walk.walk`.

    Returns
    -------
    Run or None
        None where there is no first point.
    """
    problem = start.problem

    def go(direction: int) -> Walk:
        return walk_orbits(
            problem,
            start.unknowns,
            direction,
            limits=limits,
            tests=watched(tests, stop),
            settings=settings,
            tangent=start.tangent,
            branching=start.branching,
            callback=callback,
            stop=stop,
        )

    forward = kept(lambda: go(+1))
    if not forward.points:
        return None
    first, closed = forward.points[:1], forward.end.kind is EndKind.CLOSED
    if not closed and mirrors_back(problem, start.unknowns, start.tangent, symmetry_of(problem)):
        backward = Walk(first, (), again(name, first[0]))
    elif start.both_ways or closed:
        backward = other_way(forward, problem.parameter, lambda: go(-1))
        if not backward.points:
            backward = Walk(first, (), backward.end)
    else:
        backward = Walk(first, (), born)
    return Run.of(problem, backward, forward)


def first_step(start: Start, limits: tuple[float, float], settings: Settings) -> Walk:
    """Return the walk's first step, to see where it leads."""
    return walk_orbits(
        start.problem,
        start.unknowns,
        +1,
        limits=limits,
        tangent=start.tangent,
        branching=start.branching,
        settings=dataclasses.replace(settings, max_points=2),
    )
