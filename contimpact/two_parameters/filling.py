"""Points put between those of a curve, until splines through them are as near it as asked."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..arrays import Array
from ..continuation.branch import Point, Points, Walk
from ..continuation.corrector import Arc
from ..continuation.problem import length
from ..continuation.settings import Settings
from .problem import CurvePoint, CurveProblem

DEEPEST = 8
"""How often the way between two points is halved at most."""

UNIT = 1e-9
"""How far the length of a unit tangent is from one by rounding at most."""

MARGIN = 0.1
"""How much nearer the cubic with the tangents of two points is to be in the middle between them:
a spline, which is not told the tangents, departs more, at the ends and where steps change most."""


def filled(
    walk: Walk[CurvePoint],
    problem: CurveProblem,
    spans: Sequence[float],
    settings: Settings,
    within: float,
) -> Walk[CurvePoint]:
    """Return a walk with further points between its own.

    Parameters
    ----------
    walk : Walk
    problem : CurveProblem
    spans : sequence of float
        Widths of the ranges of the free parameters.
    settings : Settings
    within : float
        How far, as part of these, the spline through the points may be from the curve.
    """
    filling = _Filling(problem, spans, settings, within)
    return replace(walk, points=Points(list(filling.along(walk.points))))


class _Filling:
    def __init__(
        self, problem: CurveProblem, spans: Sequence[float], settings: Settings, within: float
    ) -> None:
        self.problem, self.settings, self.within = problem, settings, MARGIN * within
        self.spans = np.array(spans)
        self.last = spans[-1]

    def along(self, points: Sequence[Point[CurvePoint]]) -> Iterator[Point[CurvePoint]]:
        """The points with those between them."""
        scale = self.problem.scale(points[0].unknowns, self.last)
        yield points[0]
        for left, right in itertools.pairwise(points):
            if abs(length(left.tangent, scale) - 1.0) > UNIT:  # the walk's sizes have grown
                scale = np.maximum(scale, self.problem.scale(left.unknowns, self.last))
            between = self.between(Arc(self.problem, left, right, scale, self.settings))
            yield from _spaced([left, *between, right], scale)
            yield right

    def between(self, arc: Arc, depth: int = 0) -> Iterator[Point[CurvePoint]]:
        """The points between both ends of an arc: its middle, if the cubic is not near it."""
        end = arc.left.arclength + _chord(arc.left, arc.right, arc.scale)
        arc = replace(arc, right=replace(arc.right, arclength=end))
        guess = arc.near(0.5)
        middle = arc.at(0.5) if guess is not None and depth < DEEPEST else None
        if guess is None or middle is None or self.apart(guess, middle) <= self.within:
            return
        left, right = arc.halves(middle)
        yield from self.between(left, depth + 1)
        yield middle
        yield from self.between(right, depth + 1)

    def apart(self, one: Point[CurvePoint], other: Point[CurvePoint]) -> float:
        """How far two points are apart in the plane of the parameters."""
        return float(np.max(np.abs(self.place(one) - self.place(other)) / self.spans))

    def place(self, point: Point[CurvePoint]) -> Array:
        orbit = point.evaluation.orbit
        return np.asarray(orbit.unknowns[-len(self.spans) :])


def _chord(one: Point[CurvePoint], other: Point[CurvePoint], scale: Array) -> float:
    return length(other.unknowns - one.unknowns, scale)


def _spaced(points: Sequence[Point[CurvePoint]], scale: Array) -> Iterator[Point[CurvePoint]]:
    """The inner ones of some points, arclength growing from the first to the last by chords."""
    chords = [_chord(*pair, scale) for pair in itertools.pairwise(points)]
    first, last = points[0].arclength, points[-1].arclength
    parts = np.cumsum(chords) / sum(chords)
    for point, part in zip(points[1:-1], parts, strict=False):
        yield replace(point, arclength=first + float(part) * (last - first))
