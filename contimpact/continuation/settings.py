"""The numerics of a walk: tolerances, steps and limits."""

from __future__ import annotations

from dataclasses import dataclass

from ..errors import InputError, explain_arguments
from ..schema import documented, fit, key, keys_of

PREDICTORS = ("tangent", "secant")


@explain_arguments
@documented
@dataclass(frozen=True)
class Settings:
    """Numerics of a walk; lengths are in the branch's metric."""

    tolerance: float = key(1e-12, "largest relative residual of a point", above=0, most=1e-3)
    max_iterations: int = key(8, "corrector iterations before a step is refused", most=1000)
    step: float = key(0.01, "first step", above=0)
    min_step: float = key(1e-7, "smallest step", above=0)
    max_step: float = key(0.1, "largest step", above=0)
    max_angle: float = key(
        0.2,
        "largest angle between the tangents of neighbouring points, rad; a tenth of it is the "
        "largest defect of a step, by which steps over a wiggle of the branch are seen",
        above=0,
    )
    max_points: int = key(2000, "points in one direction", most=10**9)
    predictor: str = key(
        "tangent",
        'how the next point is guessed: `"tangent"` along the tangent, `"secant"` along the chord '
        "from the point before",
        choices=PREDICTORS,
    )

    def __post_init__(self) -> None:
        for field, hint, rule in keys_of(Settings):
            value = fit(getattr(self, field.name), hint, field.name, rule)
            object.__setattr__(self, field.name, value)
        if not self.min_step <= self.step <= self.max_step:
            found = f"min_step = {self.min_step}, step = {self.step}, max_step = {self.max_step}"
            raise InputError("step", found, "keep them in this order")


NARROWEST = 1e-12
"""A range narrower than this part of its limits cannot be walked in doubles."""


def require_width(low: float, high: float, where: str) -> None:
    """Raise `InputError` for a range that is too narrow to be walked in."""
    if high - low < max(NARROWEST * max(abs(low), abs(high)), 1e-100):
        found = f"({low}, {high}) is as narrow as rounding"
        raise InputError(where, found, "give a wider range")
