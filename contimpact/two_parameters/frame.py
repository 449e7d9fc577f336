"""The rectangle of a map of two parameters, and the unit square that stands for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..bifurcations.declarations import REQUESTED
from ..models.word import is_rotation
from ..results.curve import Curve, falling, ghostly
from ..results.scene import Scene
from .arrangement import Path


def bounding(scene: Scene, curves: Sequence[Curve]) -> list[Curve]:
    """Return the curves of a scene's own words: its orbits end on no others."""

    def own(curve: Curve) -> bool:
        of_period = (word for word in scene.orbits if word.period == curve.period)
        return any(is_rotation(word.walls, curve.word) for word in of_period)

    return list(filter(own, curves))


@dataclass(frozen=True)
class Frame:
    """The rectangle: the second parameter across, and along the first one or its derived one.

    Attributes
    ----------
    across, along : str
    left, right : float
    lower, upper : float
        Of the parameter along.
    power, factor : float
        That is ``factor * first**power``; power is 1 or -1.
    """

    across: str
    along: str
    left: float
    right: float
    lower: float
    upper: float
    power: float
    factor: float

    @classmethod
    def of(cls, scene: Scene, curves: Sequence[Curve]) -> Frame:
        """Return the frame of a scene's curves."""
        assert scene.curves is not None
        first, power, factor = scene.parameter, 1.0, 1.0
        along = falling(curves) if curves else first
        if along != first:
            ones, others = (np.concatenate([c[n] for c in curves]) for n in (first, along))
            power = 1.0 if np.ptp(others / ones) <= np.ptp(others * ones) else -1.0
            factor = float(np.median(others * ones**-power))
        low, high = sorted(factor * value**power for value in scene.range)
        left, right = scene.curves.range
        return cls(scene.curves.parameter, along, left, right, low, high, power, factor)

    def height(self, value: float) -> float:
        """Return where a value of the first parameter lies in the unit square."""
        return (self.factor * value**self.power - self.lower) / (self.upper - self.lower)

    def first(self, height: float) -> float:
        """Return the value of the first parameter at a height."""
        return float((self.at(0.0, height)[1] / self.factor) ** self.power)

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Return the parameters at a point of the unit square."""
        wide, high = self.right - self.left, self.upper - self.lower
        return self.left + x * wide, self.lower + y * high

    def path(self, curve: Curve) -> Path:
        """Return a curve in the unit square."""
        x = (curve[self.across] - self.left) / (self.right - self.left)
        y = (curve[self.along] - self.lower) / (self.upper - self.lower)
        event = curve["event"].astype(str)
        plain, points = event == "", np.column_stack([x, y])
        marked = ~plain & (event != REQUESTED)
        return Path(curve.id, points, curve["arclength"], plain, marked, ~ghostly(curve))
