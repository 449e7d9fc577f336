"""Where branches of free period end: at equilibria, and where periods or rounding errors grow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..continuation.branch import Event, Point
from ..continuation.ends import End, EndKind
from ..continuation.problem import EPSILON
from ..continuation.walk import Stop
from ..orbits.problem import OrbitProblem
from ..orbits.quiet import FreeQuietProblem

LOST = 1e-9
"""A part of the orbit's size to which flights have amplified the rounding of their unknowns."""

STILL = 1e-13
"""A change of the parameter within a step, as part of it, with which its value is known."""

LONG = 1.5
"""Factor by which a period has grown that grows without bound."""


class FreePeriodEnds:
    """What ends a walk along orbits of free period, as `stop` of `walk`, and what else ends it."""

    def __init__(self, problem: OrbitProblem, stop: Stop | None) -> None:
        self.problem, self.stop = problem, stop
        self.before: Point | None = None
        self.shortest = np.inf

    def __call__(self, point: Point, events: Sequence[Event]) -> tuple[End, Point] | None:
        before, self.before = self.before or point, point
        if self.stop is not None and (ended := self.stop(point, events)):
            return ended
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
            return End.of(EndKind.FOR_EVER, *at, **told, what=what), point
        return (End.of(EndKind.ROUNDING, *at, **told), point) if lost else None
