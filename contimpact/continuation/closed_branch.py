"""When a branch is closed: a walk passes its start again, in the direction it was left in.

A problem may have images of its solutions that stand for the same one (an orbit's shifts by whole
periods). A walk that comes to an image of its start has come round if it goes on along the image of
its own way; if it comes from the other side, it has turned back on its way, and has not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arrays import Array
from .arc import Arc
from .bordered import point_after
from .branch import Point, Points
from .corrector import correct
from .metric import inner, length
from .predictor import hermite
from .problem import Problem

RETURNED = 1e-6
"""How near the values of test functions are that stand for the same one."""

PART = 1e-6
"""The part of a tangent that is followed to an image."""


def closing(arc: Arc, first: Point, same: float) -> Point | None:
    """Return the start of a walk, solved for anew from a step that passes it; None otherwise.

    Parameters
    ----------
    arc : Arc
        The step.
    first : Point
        The start.
    same : float
        How near two points are that stand for the same solution.
    """
    here, new, problem, scale = arc.left, arc.right, arc.problem, arc.scale
    for near in (here, new):
        start = near.unknowns - problem.difference(near.unknowns, first.unknowns)
        leaving = image_of_tangent(problem, start, first)
        if not passes(arc, start, leaving):
            continue
        guess = where_passing(arc, start, leaving)
        found = correct(problem, guess, leaving / scale**2, scale, arc.settings)
        if found.evaluation is not None:
            apart = problem.difference(found.evaluation.unknowns, first.unknowns)
            if length(apart, scale) <= same:
                return point_after(here, found.evaluation, found.iterations, scale)
    return None


def before(problem: Problem, points: Points, again: Array, scale: Array) -> Points:
    """Return the points of a walk before it passed its start, and the start at their end.

    Parameters
    ----------
    problem : Problem
    points : Points
        The start is a branch point: no point is solved for there.
    again : ndarray of shape (n + 1,)
        The second point of the walk, come to again.
    scale : ndarray of shape (n + 1,)
    """
    first = points[0]
    start = again - problem.difference(again, first.unknowns)
    leaving = image_of_tangent(problem, start, first)
    last = len(points) - 1
    while last > 1 and inner(points[last].unknowns - start, leaving, scale) >= 0.0:
        last -= 1
    here, tangent = points[last], leaving / length(leaving, scale)
    place = here.arclength + length(start - here.unknowns, scale)
    point = Point(problem.evaluate(start), tangent, here.orientation, place, 0)
    return Points([*points[: last + 1].pieces, point])


def as_at_start(values: Sequence[Array], start: Sequence[Array]) -> Array:
    """Return the test functions where a walk has come round, as they were at its start.

    Rounding must not decide whether an event at the start is found as the walk leaves or as it
    returns. At an image of the start the values of a function stand in another order: each becomes
    the nearest one.
    """
    found = []
    for here, first in zip(values, start, strict=True):
        same = np.abs(here - first) <= RETURNED
        apart = np.abs(here[:, None] - np.where(np.isnan(first), np.inf, first))
        nearest = first[np.argmin(apart, axis=1)] if len(here) else first
        aligned = np.where(np.abs(here - nearest) <= RETURNED, nearest, here)
        found.append(np.where(same, first, aligned))
    return np.concatenate([*found, np.zeros(0)])


def image_of_tangent(problem: Problem, start: Array, first: Point) -> Array:
    """Return the tangent of the first point as it is at an image of it."""
    moved = problem.difference(start, first.unknowns + PART * first.tangent)
    return -moved / PART


def where_passing(arc: Arc, start: Array, leaving: Array) -> Array:
    """Return where the cubic between both ends of a step passes beside a point.

    From there Newton leads back to the walk's own branch, and to the point only if it is on it.
    """
    here, new, scale = arc.left, arc.right, arc.scale
    behind, beyond = (inner(end.unknowns - start, leaving, scale) for end in (here, new))
    span = new.arclength - here.arclength
    beside = hermite(here, new, span, behind / (behind - beyond))
    along = inner(beside - start, leaving, scale) / inner(leaving, leaving, scale)
    return beside - along * leaving


def passes(arc: Arc, start: Array, leaving: Array) -> bool:
    """Whether a step passes a point in a direction."""
    here, new, scale = arc.left, arc.right, arc.scale
    after = new.unknowns - start
    stepped = length(new.unknowns - here.unknowns, scale)
    return (
        inner(here.unknowns - start, leaving, scale) < 0.0
        and inner(after, leaving, scale) >= 0.0
        and inner(new.tangent, leaving, scale) > 0.0
        and length(after, scale) <= 1.5 * stepped
    )
