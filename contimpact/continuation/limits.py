"""The range of the free parameter, and the points on its limits."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from .arc import Arc
from .bordered import point_after
from .branch import Point
from .corrector import correct
from .metric import angle
from .problem import Array

NARROWEST = 1e-12
"""A range narrower than this part of its limits cannot be walked in doubles."""

NEAR_LIMIT = 1e-9
"""A test function smaller than this part of its value one step before may vanish on a limit."""


def check(start: Array, direction: int, limits: tuple[float, float]) -> None:
    """Raise `InputError` for a range that is none or does not hold the start."""
    low, high = limits
    if direction not in (1, -1):
        raise InputError("direction", f"found {direction!r}", "give +1 or -1")
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise InputError("limits", f"found ({low}, {high})", "give two finite numbers, low < high")
    if high - low < max(NARROWEST * max(abs(low), abs(high)), 1e-100):
        found = f"({low}, {high}) is as narrow as rounding"
        raise InputError("limits", found, "give a wider range")
    if not low <= start[-1] <= high:
        found = f"they do not hold the start, {start[-1]:.12g}"
        raise InputError("limits", found, "start within the limits")


def on_limit(step: Arc, limits: tuple[float, float]) -> tuple[Point | None, int]:
    """Return the point of the branch on the limit that a step passed, and the iterations it took.

    None where the corrector finds none on the way.
    """
    here, beyond, scale = step.left, step.right, step.scale
    low, high = limits
    limit = low if beyond.parameter < low else high
    fraction = (limit - here.parameter) / (beyond.parameter - here.parameter)
    guess = here.unknowns + fraction * (beyond.unknowns - here.unknowns)
    guess[-1] = limit
    fixed = np.zeros(len(guess))
    fixed[-1] = 1.0
    found = correct(step.problem, guess, fixed, scale, step.settings)
    if found.evaluation is None:
        return None, found.iterations
    new = point_after(here, found.evaluation, found.iterations, scale)
    if new is None or new.arclength > beyond.arclength:
        return None, found.iterations
    turned = angle(here.tangent, new.tangent, scale)
    return (new if turned <= step.settings.max_angle else None), found.iterations


def apart(zeros: Array, others: Array) -> Array:
    """Give what may vanish on a limit the sign the other values do not have."""
    tiny = np.finfo(float).tiny
    near = (np.abs(zeros) <= NEAR_LIMIT * np.abs(others)) & (others != 0.0)
    return np.where(near, np.where(others >= 0.0, -tiny, tiny), zeros)
