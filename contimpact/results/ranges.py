"""An attractor over all values of a parameter at which it is known, and where it ends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Bound:
    """Where an attractor begins or ends along the parameter."""

    value: float
    error: float
    """Bound of the value's error; half the bracket's width where only simulation shows it."""
    entry: str | None
    """The event, by its name in the catalogue."""
    text: str
    """What happens there."""

    def __str__(self) -> str:
        return f"{self.value:.9g}: {self.text}"


@dataclass(frozen=True)
class Motion:
    """An attractor over all values at which it is known."""

    notation: str
    branch: str | None
    """Of its orbits; None for motion that simulation alone shows."""
    low: Bound
    high: Bound
    simulated: int
    """How many simulated attractors it is."""
    values: Sequence[float] = field(repr=False)
    speeds: Sequence[float] = field(repr=False)
    """`values`, `speeds`: the largest speed before an impact at rising values."""

    def speed(self, low: float, high: float) -> float:
        """Return the largest impact speed between two values.

        Of orbits it is interpolated between the points of the branch; of simulated motion it is
        that of the values simulated there, or of both neighbours if there are none. Not a number
        without impacts.
        """
        values, speeds = np.array(self.values), np.array(self.speeds)
        if not len(values):
            return math.nan
        if self.branch:
            ends = np.interp([low, high], values, speeds)
        else:
            first, beyond = np.searchsorted(values, (low, high)).tolist()
            ends = speeds[max(first - 1, 0) : first + 1] if first == beyond else []
        inside = speeds[(values >= low) & (values <= high)]
        return float(max([*inside, *ends], default=math.nan))

    def nearest(self, value: float) -> tuple[float, Bound]:
        """Return the distance from a value to the nearer end, and that end."""
        return min(
            ((abs(end.value - value), end) for end in (self.low, self.high)), key=lambda e: e[0]
        )
