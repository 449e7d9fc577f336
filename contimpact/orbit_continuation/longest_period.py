"""Where the forcing's period goes to infinity within a range, as where a frequency goes to zero.

Along such a branch there is no end: orbits wind ever more often within a period, and each step is
shorter than the one before. It ends where the period is many times what it was at the start.
"""

from __future__ import annotations

import math
from dataclasses import replace

from ..arrays import Array
from ..continuation.branch import Walk
from ..continuation.ends import End, EndKind
from ..orbits.problem import Linearisation, OrbitProblem

LONGEST = 1e3
"""How many times the period at its start a branch is followed to, where that has no bound."""

HALVINGS = 200


def bounded(
    problem: OrbitProblem, start: Array, limits: tuple[float, float]
) -> tuple[float, float]:
    """Return the part of a range around a start in which the period is bounded."""
    low, high = (_nearest(problem, start, limit) for limit in limits)
    return low, high


def _nearest(problem: OrbitProblem, start: Array, limit: float) -> float:
    """The limit, or where the period is `LONGEST` times that at the start if it has none there."""
    inside, outside = float(start[-1]), limit
    has_none = problem.free != 1 or problem.autonomous
    if has_none or math.isfinite(_times(problem, start, limit)):
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


def told(
    walk: Walk[Linearisation], problem: OrbitProblem, limits: tuple[float, float]
) -> Walk[Linearisation]:
    """Return a walk that says so where it ended for the period's sake."""
    end = walk.end
    if end.kind is not EndKind.RANGE or end.value in limits:
        return walk
    longer = End.of(EndKind.PERIOD, problem.parameter, end.value, times=f"{LONGEST:g}")
    return replace(walk, end=longer)
