"""Walks along branches of orbits: the backend, long flights, and ends of long or free periods."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Unpack

import numpy as np

from ..arrays import Array
from ..bifurcations.extended_system import OrbitTest, crossing_near
from ..bifurcations.status import explain_changes
from ..continuation.branch import End, EndKind, Event, Point, TestFunction, Walk
from ..continuation.problem import EPSILON, Problem
from ..continuation.settings import Settings
from ..continuation.step import Backend, Batch, DenseBackend, Position
from ..continuation.walk import Options, Policy, walk
from ..orbits.problem import Linearisation, OrbitProblem
from ..orbits.quiet import FreeQuietProblem
from ..segments.compiling import note_uncompiled
from ..segments.kernels import Kernels
from ..segments.layout import SECTION
from .orbit_backend import CycleBackend

if TYPE_CHECKING:
    from .chain_backend import ChainBackend

# Where the forcing's period goes to infinity within a range, as where a frequency goes to zero.
#
# Along such a branch there is no end: orbits wind ever more often within a period, and each step is
# shorter than the one before. It ends where the period is many times what it was at the start.

LONGEST = 1e3
"""How many times the period at its start a branch is followed to, where that has no bound."""

HALVINGS = 200


class LongestPeriod(Policy):
    """Keeps a walk where the period is bounded, and says so where it ended for the period's
    sake."""

    def __init__(self, problem: OrbitProblem, start: Array) -> None:
        self.problem, self.start = problem, start

    def limits(self, limits: tuple[float, float]) -> tuple[float, float]:
        self.asked = limits
        low, high = (_nearest_limit(self.problem, self.start, limit) for limit in limits)
        return low, high

    def ended(self, walk: Walk[Linearisation]) -> Walk[Linearisation]:
        end = walk.end
        if end.kind is not EndKind.RANGE or end.value in self.asked:
            return walk
        times, name = f"{LONGEST:g}", self.problem.parameter
        return replace(walk, end=End.of(EndKind.PERIOD, name, end.value, times=times))


def _nearest_limit(problem: OrbitProblem, start: Array, limit: float) -> float:
    """The limit, or where the period is `LONGEST` times that at the start if it has none there."""
    inside, outside = float(start[-1]), limit
    if problem.free != 1 or math.isfinite(_times(problem, start, limit)):
        return limit
    for _ in range(HALVINGS):
        middle = 0.5 * (inside + outside)
        if _times(problem, start, middle) <= LONGEST:
            inside = middle
        else:
            outside = middle
    return inside if _times(problem, start, inside) > 0.5 * LONGEST else limit


def _times(problem: OrbitProblem, start: Array, value: float) -> float:
    """How many times the period at the start that at a value is; infinite where there is none."""
    there = start.copy()
    there[-1] = value
    try:
        ratio = float(problem.period(there) / problem.period(start))
    except (ArithmeticError, ValueError):
        return math.inf
    return ratio if ratio > 0.0 else math.inf


class PhysicalityEnd(Policy):
    """Ends a walk a step behind the event that makes its orbits unphysical."""

    def accepted(self, point: Point, events: Sequence[Event]) -> tuple[End, Point] | None:
        here = point.evaluation
        if here.verdict.physical:
            return None
        about = here.problem.parameter, point.parameter
        return End.of(EndKind.UNPHYSICAL, *about, why=here.verdict.reason), point


@dataclass(frozen=True)
class StatusChanges(Policy):
    """Explains by events what changes along a walk; see `explain_changes`."""

    problem: OrbitProblem
    tests: Sequence[TestFunction[Linearisation]]
    settings: Settings
    switched: bool

    def ended(self, walk: Walk[Linearisation]) -> Walk[Linearisation]:
        return explain_changes(self.problem, walk, self.tests, self.settings, self.switched)


# Walks on which flights that are integrated may become too long to be computed as a whole.


class SwitchingBackend(Backend):
    """A backend of whole flights until one of them is long, and dense linear algebra from there.

    Of its problem long flights are computed in pieces; the kernels notice which are long.
    """

    def __init__(self, whole: Backend, problem: Problem, kernels: Kernels) -> None:
        self.whole, self.kernels = whole, kernels
        self.pieces = DenseBackend(problem)
        self.long = False

    def advance(self, position: Position, most: int) -> Batch:
        """Take steps until one is proposed or refused, but `most` of them, or fewer."""
        if not self.long:
            self.kernels.long = False
            made = self.whole.advance(position, most)
            if not self.kernels.long:
                return made
            self.long = True
        return self.pieces.advance(position, most)


def walk_orbits(
    problem: OrbitProblem,
    start: Array,
    direction: int,
    *,
    tests: Sequence[TestFunction[Linearisation]] = (),
    gaps: bool = True,
    unphysical: bool = True,
    policies: Sequence[Policy] = (),
    **options: Unpack[Options],
) -> Walk[Linearisation]:
    """As `contimpact.continuation.walk.walk`, for orbits: on a backend of their own.

    With `gaps` it is decided at every point if the orbit is physical, and changes of that or of the
    number of unstable multipliers are explained by events; see `contimpact.bifurcations.status`.
    Without `unphysical` the walk ends where its orbits are unphysical.
    """
    backend = backend_of(problem, tests, gaps)
    policies = [*policies, *([] if unphysical else [PhysicalityEnd()])]
    policies += [FreePeriodEnds(problem)] if problem.autonomous else [LongestPeriod(problem, start)]
    if gaps:
        settings, switched = options.get("settings"), options.get("tangent") is not None
        policies.append(StatusChanges(problem, tests, settings or Settings(), switched))
    return walk(
        problem,
        start,
        direction,
        tests=tests,
        policies=policies,
        parameter=problem.parameter,
        backend=backend,
        meeting=crossing_near,
        **options,
    )


def backend_of(
    problem: OrbitProblem, tests: Sequence[TestFunction[Linearisation]], gaps: bool = True
) -> CycleBackend | ChainBackend | SwitchingBackend | None:
    """Return a problem on block-cyclic elimination.

    None where there is none: for more than four coordinates, for two free parameters, and for
    orbits without impacts whose flight has a closed form.
    """
    kernels, walls = problem.kernels, problem.word.walls
    flights = problem.kinds or [(SECTION, str(problem.word.period))]
    flown = any(kernels.flown(*ends) for ends in flights)
    if problem.free != 1 or not (walls or flown):
        return None
    needs = {need for test in tests if isinstance(test, OrbitTest) for need in test.needs}
    wanted = gaps or "gaps" in needs, "doubling" in needs
    kind: Any = CycleBackend
    fixed = not problem.autonomous and not problem.lost
    one = walls and problem.m == 2 and fixed and kernels.passages.anchored
    if not one or kernels.may_leave_at_once(walls):
        from .chain_backend import MOST_COORDINATES, ChainBackend, SectionBackend

        kind = ChainBackend if walls else SectionBackend
        if problem.model.DEGREES_OF_FREEDOM > MOST_COORDINATES:
            note_uncompiled("more than four coordinates")
            return None
    backend = problem.solvers.get(f"steps{wanted}") or kind(problem, *wanted)
    problem.solvers[f"steps{wanted}"] = backend
    if flown:
        return SwitchingBackend(backend, problem, kernels)
    return backend


# Where branches of free period end: at equilibria, and where periods or rounding errors grow.

LOST = 1e-9
"""A part of the orbit's size to which flights have amplified the rounding of their unknowns."""

STILL = 1e-13
"""A change of the parameter within a step, as part of it, with which its value is known."""

LONG = 1.5
"""Factor by which a period has grown that grows without bound."""


class FreePeriodEnds(Policy):
    """What ends a walk along orbits of free period."""

    def __init__(self, problem: OrbitProblem) -> None:
        self.problem = problem
        self.before: Point | None = None
        self.shortest = np.inf

    def accepted(self, point: Point, events: Sequence[Event]) -> tuple[End, Point] | None:
        before, self.before = self.before or point, point
        return self.comes_to_rest(before, point) or self.for_ever(before, point)

    def comes_to_rest(self, before: Point, point: Point) -> tuple[End, Point] | None:
        """The end before the first coordinate turns the other way: the orbits have shrunk to none.

        They do so with the root of the parameter's distance, by which its value is told.
        """
        problem = self.problem
        if not isinstance(problem, FreeQuietProblem):
            return None
        one, other = (problem.turning(p.unknowns) for p in (before, point))
        if one * other > 0.0 or before is point:
            return None
        value = (before.parameter * other**2 - point.parameter * one**2) / (other**2 - one**2)
        return End.of(EndKind.REST, problem.parameter, value), before

    def for_ever(self, before: Point, point: Point) -> tuple[End, Point] | None:
        """The end where the period grows alone, or rounding errors, with it or without.

        How much of them the equations amplify is smooth along the branch; a residual is not, and
        would end the walk where a processor has it.
        """
        here, problem = point.evaluation, self.problem
        longer = here.span > before.evaluation.span
        self.shortest = min(self.shortest, here.span)
        size = max(1.0, float(np.max(np.abs(problem.impacts(here.unknowns)[:, 1:]), initial=0.0)))
        error = EPSILON * float(np.max(np.abs(here.jacobian) @ np.abs(here.unknowns)))
        lost, step = error > LOST * size, point.parameter - before.parameter
        still = before is not point and abs(step) < STILL * abs(point.parameter)
        at, told = (problem.parameter, point.parameter), {"period": here.span, "error": error}
        if longer and (lost or still) and here.span > LONG * self.shortest:
            what = f"{problem.parameter} changes no more"
            if lost:
                what = f"the rounding errors of so long a flight to {error:.1g}"
                if isinstance(problem, FreeQuietProblem):
                    what += " (two modes of its law, with guards at v = 0, would divide it)"
            return End.of(EndKind.FOR_EVER, *at, **told, what=what), point
        return (End.of(EndKind.ROUNDING, *at, **told), point) if lost else None
