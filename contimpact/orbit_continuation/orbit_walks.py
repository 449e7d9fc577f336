"""Walks along branches of orbits, each on the backend that fits its problem."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Unpack

from ..arrays import Array
from ..bifurcations.extended_system import OrbitTest, meeting
from ..bifurcations.status import explained
from ..continuation.branch import TestFunction, Walk
from ..continuation.settings import Settings
from ..continuation.walk import Options, walk
from ..orbits.problem import Linearisation, OrbitProblem
from ..segments.compiling import plainly
from .cycle_backend import CycleBackend
from .longest_period import bounded, told

if TYPE_CHECKING:
    from .chain_backend import ChainBackend
    from .long_flights import UntilLong


def walk_orbits(
    problem: OrbitProblem,
    start: Array,
    direction: int,
    *,
    tests: Sequence[TestFunction[Linearisation]] = (),
    gaps: bool = True,
    **options: Unpack[Options],
) -> Walk[Linearisation]:
    """As `contimpact.continuation.walk.walk`, for orbits: on a backend of their own.

    With `gaps` it is decided at every point if the orbit is physical, and changes of that or of the
    number of unstable multipliers are explained by events; see `contimpact.bifurcations.status`.
    """
    if problem.autonomous:
        from .free_period_ends import FreePeriodEnds

        options["stop"] = FreePeriodEnds(problem, options.get("stop"))
    backend = backend_of(problem, tests, gaps)
    at, name = (problem, start, direction), problem.parameter
    asked = options["limits"]
    options["limits"] = bounded(problem, start, asked)
    found = walk(*at, parameter=name, tests=tests, backend=backend, meeting=meeting, **options)
    found = told(found, problem, asked)
    if not gaps:
        return found
    settings, switched = options.get("settings") or Settings(), options.get("tangent") is not None
    return explained(problem, found, tests, settings, switched)


def backend_of(
    problem: OrbitProblem, tests: Sequence[TestFunction[Linearisation]], gaps: bool = True
) -> CycleBackend | ChainBackend | UntilLong | None:
    """Return a problem on block-cyclic elimination.

    None where there is none: for several coordinates that do not move linearly or are more than
    four, for two free parameters, for orbits without impacts, for free periods, and where jumps
    move the gap coordinate or turn the motion on a surface.
    """
    if problem.free != 1 or not problem.word.walls:
        return None
    if problem.autonomous:
        plainly("free periods")
        return None
    if problem.lost or not problem.kernels.passages.anchored:
        plainly("modes of different dimension, and jumps that move the gap coordinate")
        return None
    if problem.kernels.may_leave_at_once(problem.word.walls):
        plainly("flights that may leave their mode where they begin")
        return None
    needs = {need for test in tests if isinstance(test, OrbitTest) for need in test.needs}
    wanted = gaps or "gaps" in needs, "doubling" in needs
    if problem.m == 2:
        backend = CycleBackend(problem, *wanted)
        if not any(problem.kernels.flown(*kind) for kind in problem.kinds):
            return backend
        from .long_flights import UntilLong

        return UntilLong(backend, problem, problem.kernels)
    from .chain_backend import ChainBackend

    if not ChainBackend.follows(problem):
        plainly("several coordinates that do not move linearly, or more than four of them")
        return None
    return ChainBackend(problem, *wanted)
