"""The stretch of a branch between two neighbouring points of a walk."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .bordered import point_after
from .branch import Event, Point
from .corrector import correct
from .metric import angle, inner, length
from .predictor import hermite
from .problem import Array, Evaluation, Problem
from .settings import Settings

CLOSEST_BRANCHES = 1e-4
"""Branches closer to each other than this part of a step are taken to cross."""

NO_TANGENT = 1e-8
"""Where the orientation falls below this part of its size, rounding decides on the tangent."""


@dataclass(frozen=True, eq=False)
class Arc:
    """Two neighbouring points of a walk, and what is needed to go between them."""

    problem: Problem
    left: Point
    right: Point
    scale: Array
    settings: Settings

    @property
    def span(self) -> float:
        """Its length along the branch."""
        return self.right.arclength - self.left.arclength

    def at(self, fraction: float) -> Point | None:
        """Return the point of the branch at a fraction of the way, or None if it is not reached."""
        chord = self.right.unknowns - self.left.unknowns
        guess = hermite(self.left, self.right, self.span, fraction)
        result = correct(self.problem, guess, chord / self.scale**2, self.scale, self.settings)
        if result.evaluation is None:
            return None
        return self.point(result.evaluation, result.iterations)

    def near(self, fraction: float) -> Point | None:
        """Return a guess of that point, not corrected; None where the equations have no value."""
        try:
            here = self.problem.evaluate(hermite(self.left, self.right, self.span, fraction))
        except (ArithmeticError, ValueError):
            return None
        return Point(here, self.left.tangent, np.nan, self.left.arclength + fraction * self.span, 0)

    def point(self, evaluation: Evaluation, iterations: int) -> Point | None:
        """Return an evaluation as a point of this arc, None where it has no tangent."""
        travelled = self.fraction(evaluation.unknowns) * self.span
        return point_after(self.left, evaluation, iterations, self.scale, travelled)

    def event_point(self, evaluation: Evaluation, iterations: int) -> Point:
        """As `point`; at a branch point, where there is none, with a tangent between the ends'."""
        point, fraction = self.point(evaluation, iterations), self.fraction(evaluation.unknowns)
        between = (1.0 - fraction) * self.left.tangent + fraction * self.right.tangent
        between /= length(between, self.scale)
        if point is not None:
            usual = np.fmax(abs(self.left.orientation), abs(self.right.orientation))
            known = not abs(point.orientation) < NO_TANGENT * usual
            if known and angle(point.tangent, between, self.scale) <= 2.0 * self.settings.max_angle:
                return point
        place = self.left.arclength + fraction * self.span
        return Point(evaluation, between, 0.0, place, iterations)

    def holding(self, event: Event) -> Event:
        """Return an event located on this arc, not before or beyond it by rounding."""
        place = event.point.arclength
        within = min(max(place, self.left.arclength), self.right.arclength)
        return event if place == within else event.moved_to(within)

    def fraction(self, unknowns: Array) -> float:
        """Return how far along the chord a point lies: 0 at the left end, 1 at the right end."""
        chord = self.right.unknowns - self.left.unknowns
        return inner(unknowns - self.left.unknowns, chord, self.scale) / inner(
            chord, chord, self.scale
        )

    def halves(self, middle: Point) -> tuple[Arc, Arc]:
        """Return the arcs on both sides of a point between."""
        return replace(self, right=middle), replace(self, left=middle)

    def connected(self) -> bool:
        """Whether both ends lie on one branch, where their orientations differ.

        Bisection on the orientation closes on a branch point if there is one; if the right end lies
        on another branch, the two sides stay apart or no point is reached between them.
        """
        left, right, a, b = self.left, self.right, 0.0, 1.0
        chord = length(right.unknowns - left.unknowns, self.scale)
        while b - a > CLOSEST_BRANCHES:
            middle = self.at(0.5 * (a + b))
            if middle is None:
                return False
            if (middle.orientation >= 0.0) == (self.left.orientation >= 0.0):
                left, a = middle, 0.5 * (a + b)
            else:
                right, b = middle, 0.5 * (a + b)
            if length(right.unknowns - left.unknowns, self.scale) > 4.0 * (b - a) * chord:
                return False
        return True

    def holds(self, unknowns: Array) -> bool:
        """Whether a point lies on the branch between both ends, within a step of the chord."""
        chord = self.right.unknowns - self.left.unknowns
        fraction = self.fraction(unknowns)
        off = unknowns - self.left.unknowns - fraction * chord
        slack = 1e-9
        near = length(off, self.scale) <= 0.5 * length(chord, self.scale) + slack
        return near and -slack <= fraction <= 1.0 + slack
