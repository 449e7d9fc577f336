"""Step control: how well a step resolves the branch, and how long the next one is.

Written in the plain subset of Python that `contimpact.compiling` compiles.
"""

from __future__ import annotations

import math

from ..arrays import Vector

LARGEST_DEFECT = 0.1
"""Largest defect of a step (see `defect`), as part of the largest angle."""

DIGITS = 2.0**47 + 1.0
"""By which a length is rounded to six binary digits, see `rounded`."""


def defect(
    z: Vector, new: Vector, tangent: Vector, along: Vector, size: float, scale: Vector
) -> float:
    """Return by how much a step differs from what the tangents at its ends make of it.

    The distance between the chord and the mean of both unit tangents times the chord's length, as
    part of that length: the error of the trapezoidal rule. It falls with the square of the step
    where the branch is resolved, and does not where a step spans a wiggle, however well the
    tangents agree. `size` is the distance of both points.
    """
    if size == 0.0:
        return 0.0
    off = 0.0
    for i in range(len(z)):
        part = (new[i] - z[i] - 0.5 * size * (tangent[i] + along[i])) / scale[i]
        off += part * part
    return math.sqrt(off) / size


def step_after(
    step: float,
    turned: float,
    first_correction: float,
    off: float,
    max_angle: float,
    max_defect: float,
    max_step: float,
) -> float:
    """Return the length of the step after an accepted one.

    The angle between tangents grows with the step, the first correction with its square, as part
    of the step, and so does the defect `off`; the largest of them against their targets decides,
    by at most a factor of two. The targets of angle and defect are half the largest ones, that of
    the correction a twentieth of the step.
    """
    by_angle = turned / (0.5 * max_angle)
    by_distance = math.sqrt(first_correction / (0.05 * step))
    by_defect = math.sqrt(off / (0.5 * max_defect))
    factor = 1.0 / max(by_angle, by_distance, by_defect, 0.5)
    return min(step * max(factor, 0.5), max_step)


def rounded(step: float, max_step: float) -> float:
    """Return the length with a few leading digits (Veltkamp's splitting).

    How a walk rounds its points, which differs between processors, then has no part in where the
    next ones lie: it would grow from step to step.
    """
    large = DIGITS * step
    return min(large - (large - step), max_step)


def shorter(step: float, min_step: float) -> float:
    """Return the length to try after a step was refused."""
    return max(0.5 * step, min_step)
