"""Segments with a closed form, answered by generated kernels."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np

from ..arrays import Array, Number
from .arithmetic import ARRAYS, Arithmetic, Kernel, evaluate_in
from .layout import SECTION, Blocks, Row
from .segment import KernelSource, Numbers
from .track import velocities


class ClosedForm:
    """The flight from one wall to another; see `segment.Segment`.

    Parameters
    ----------
    kernels : KernelSource
    start, end : str
        The walls left and reached.
    """

    def __init__(self, kernels: KernelSource, start: str, end: str) -> None:
        self.name = start + end
        self._kernels, self._walls = kernels, (start, end)
        self._flight = kernels.flight(start, end)

    def blocks(self, start: Numbers, end: Numbers, values: Numbers) -> Blocks:
        """Return residual and first derivatives."""
        return self._flight(*start, *end, *values)

    def over(self, arithmetic: Arithmetic) -> Callable[[Numbers, Numbers, Numbers], Blocks]:
        """Return `blocks` for the numbers of another arithmetic."""
        flight = evaluate_in(self._flight, arithmetic)
        return lambda start, end, values: flight(*start, *end, *values)

    def second(self, start: Numbers, end: Numbers, along: Numbers, values: Numbers) -> Blocks:
        """Return the derivatives of `blocks` along a direction."""
        return self._kernels.second(*self._walls)(*start, *end, *along, *values)

    def third(self, start: Numbers, end: Numbers, along: Numbers, values: Numbers) -> Row:
        """Return the third derivatives of the residual along a direction."""
        return self._kernels.third(*self._walls)(*start, *end, *along, *values)

    def track(self, start: Numbers, dt: Number, values: Numbers) -> tuple[Number, Number, Number]:
        """Return displacement, velocity and acceleration of the gap coordinate."""
        return self._motion(*start, dt, *values)

    def speeds(self, start: Numbers, step: float, count: int, values: Numbers) -> Array:
        """Return the velocity of the gap coordinate at so many equal steps after leaving."""
        kernels, left = self._kernels, self._walls[0]
        if left != SECTION and kernels.linear(left):
            guard = kernels.model.guard(left)
            found = velocities(kernels.law(left)(*start, *values), step, count)
            return found @ np.array(guard.row(kernels.model.DEGREES_OF_FREEDOM), dtype=float)
        times = step * np.arange(1.0, count + 1.0)
        motion = evaluate_in(self._motion, ARRAYS)
        return np.broadcast_to(motion(*start, times, *values)[1], times.shape)

    @functools.cached_property
    def _motion(self) -> Kernel:
        """The motion of the gap coordinate of the guard left, or of the first guard."""
        if self._walls[0] == SECTION:
            return self._kernels.since(self._kernels.model.WALLS[0].name)
        return self._kernels.motion(self._walls[0])
