"""The numerics of a walk: tolerances, steps and limits."""

from __future__ import annotations

import math
import numbers
from dataclasses import dataclass

from ..errors import InputError, explain_arguments

PREDICTORS = ("tangent", "secant")


@explain_arguments
@dataclass(frozen=True)
class Settings:
    """Numerics of a walk; lengths are in the branch's metric.

    Parameters
    ----------
    tolerance : float
        Largest residual a point may have.
    max_iterations : int
        Corrector iterations before a step is refused.
    step, min_step, max_step : float
        First, smallest and largest step.
    max_angle : float
        Largest angle between the tangents of neighbouring points, rad. A tenth of it is the
        largest defect of a step, by which steps over a wiggle of the branch are seen.
    max_points : int
        Points of one walk.
    predictor : {"tangent", "secant"}
        Direction in which the next point is guessed: along the tangent, or along the chord from
        the point before.
    """

    tolerance: float = 1e-12
    max_iterations: int = 8
    step: float = 0.01
    min_step: float = 1e-7
    max_step: float = 0.1
    max_angle: float = 0.2
    max_points: int = 2000
    predictor: str = "tangent"

    def __post_init__(self) -> None:
        for name in ("tolerance", "step", "min_step", "max_step", "max_angle"):
            value = getattr(self, name)
            number = isinstance(value, numbers.Real) and not isinstance(value, bool)
            if not (number and math.isfinite(value) and value > 0.0):
                raise InputError(name, f"found {value!r}", "give a positive number")
        for name in ("max_iterations", "max_points"):
            value = getattr(self, name)
            if isinstance(value, bool) or not (isinstance(value, int) and value >= 1):
                raise InputError(name, f"found {value!r}", "give a whole number >= 1")
        if self.predictor not in PREDICTORS:
            raise InputError(
                "predictor", f"found {self.predictor!r}", f"accepted are {', '.join(PREDICTORS)}"
            )
        if not self.min_step <= self.step <= self.max_step:
            found = f"min_step = {self.min_step}, step = {self.step}, max_step = {self.max_step}"
            raise InputError("step", found, "keep them in this order")
