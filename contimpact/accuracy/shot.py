"""The contestant of reports: orbits by shooting, each row within a budget of evaluations.

A row that spends it says how many orbits it has not come to; its cost is then the least it can be.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..continuation.branch import Point, Walk
from ..orbits.problem import Array, Linearisation, OrbitProblem
from .shooting import EXPLICIT, IMPLICIT, Shooting
from .timing import timed

SHOT = 6
"""Orbits that are solved for."""

EVALUATIONS = 200_000
"""Of the equations of motion, for all orbits of a row."""

Row = dict[str, Any]


def shot(
    problem: OrbitProblem,
    walks: Sequence[Walk],
    tolerances: Sequence[float],
    repetitions: int,
    progress: Callable[[str], None],
) -> dict[str, list[Row]]:
    """Return rows by integrator; the one for stiff motion where the other spends its budget.

    They end with the first tolerance at which nothing has ended. There are none without
    coordinates to shoot in, or orbits that a simulation can follow.
    """
    points = [p for w in walks for p in w.points if shootable(p)]
    if problem.m != 2 or problem.lost or not points:
        return {}
    chosen = [point.unknowns for point in some(points, SHOT)]
    share = sum(len(w.points) for w in walks) / len(chosen)
    found: dict[str, list[Row]] = {}
    for method in (EXPLICIT, IMPLICIT):
        found[method] = []
        for tolerance in tolerances:
            progress(f"shooting by {method}, rtol {tolerance:.0e}")
            contestant = problem, tolerance, method, chosen
            found[method].append(_row(contestant, share, min(repetitions, 3)))
            if found[method][-1]["unfinished"] == len(chosen):
                break  # smaller tolerances cost more
        if not any(row["unfinished"] for row in found[method]):
            break
    return found


def _row(
    contestant: tuple[OrbitProblem, float, str, list[Array]], share: float, repetitions: int
) -> Row:
    """Some orbits by shooting; its cost as if all orbits of the branch were."""
    problem, tolerance, method, chosen = contestant
    shooting = Shooting(problem, tolerance, method, EVALUATIONS)

    def shoot() -> list[Array | None]:
        solved: list[Array | None] = []
        shooting.evaluations = 0
        for unknowns in chosen:
            shooting.given_up = False
            orbit = shooting.orbit(_nearby(unknowns))
            if not shooting.given_up:
                solved.append(orbit)
        return solved

    solved, seconds = timed(shoot, repetitions, 1.0 / share)
    reached = [unknowns for unknowns in solved if unknowns is not None]
    return {
        "setting": tolerance,
        "reached": reached,
        "seconds": seconds,
        "evaluations": share * shooting.evaluations,
        "orbits": len(chosen),
        "failed": len(solved) - len(reached),
        "unfinished": len(chosen) - len(solved),
    }


def some(items: Sequence[Any], most: int) -> list[Any]:
    """Return at most `most` items of a sequence, evenly spread."""
    if len(items) <= most:
        return list(items)
    return [items[int(i)] for i in np.linspace(0, len(items) - 1, most)]


def shootable(point: Point[Linearisation]) -> bool:
    """Whether a simulation can follow the orbit: physical, not nearly grazing, not at a fold."""
    here = point.evaluation
    speeds = here.problem.impacts(here.unknowns)[:, 1]
    turning = abs(point.tangent[-1]) < 0.05 * np.max(np.abs(point.tangent))
    return bool(here.verdict.physical and np.min(np.abs(speeds)) > 1e-3 and not turning)


def _nearby(unknowns: Array) -> Array:
    """A guess as good as a predictor's: three digits."""
    guess = unknowns.copy()
    guess[:-1] *= 1.0 + 1e-3 * np.cos(np.arange(len(guess) - 1))
    return guess
