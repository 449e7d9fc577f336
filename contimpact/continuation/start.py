"""The first point of a walk, and its test functions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .bordered import first_tangent, point_after
from .branch import Point
from .corrector import correct
from .metric import length
from .problem import Array, Problem
from .settings import Settings

ON_ZERO = 1e-12
"""Test functions below this at a start that was solved for vanish there."""

NO_CROSSING = 1e-9
"""A test function below this at a branch point a walk starts from vanishes because of it."""


STILL = 1e-12
"""A parameter's rate below this part of the tangent is rounding: at a fold neither way is up."""


@dataclass(frozen=True, eq=False)
class Start:
    """The first point, if there is one, and why no walk leaves it, or nothing."""

    point: Point | None
    iterations: int
    reason: str = ""


def first_point(
    problem: Problem,
    guess: Array,
    direction: int,
    tangent: Array | None,
    branching: bool,
    scale: Array,
    settings: Settings,
) -> Start:
    """Solve for the first point of a walk; parameters as of `contimpact.continuation.walk.walk`."""
    fixed = np.zeros(len(guess))
    fixed[-1] = 1.0
    row = fixed if tangent is None else tangent / scale**2
    result = correct(problem, guess, row, scale, settings)
    here, iterations = result.evaluation, result.iterations
    if here is None:
        return Start(None, iterations, result.reason)
    if tangent is None:
        tangent = first_tangent(here.jacobian, scale)
        if tangent is None:
            unknown = Point(here, fixed, 0.0, 0.0, iterations)
            return Start(unknown, iterations, "two directions leave the first point")
        still = abs(tangent[-1]) < STILL * scale[-1]
        direction = direction if still or tangent[-1] >= 0.0 else -direction
    else:
        tangent = tangent / length(tangent, scale)
    first: Point | None = Point(here, direction * tangent, np.nan, 0.0, iterations)
    if first is not None and not branching:
        first = point_after(first, here, iterations, scale)
    return Start(first, iterations, "" if first else "the tangent is not defined")


def settled(values: list[Array], branching: bool, switched: bool) -> list[Array]:
    """Return the test functions at a start, those that vanish there as zero."""
    small = NO_CROSSING if branching else ON_ZERO
    if not (branching or switched):
        return values
    return [np.where(np.abs(v) < small, 0.0, v) for v in values]


def leaving(start: Array, other: Array) -> Array:
    """Give what vanishes or has no value at a branch point the sign it leaves with."""
    tiny = np.finfo(float).tiny
    return np.where((start == 0.0) | np.isnan(start), np.sign(other) * tiny, start)
