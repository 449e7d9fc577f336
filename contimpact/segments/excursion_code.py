"""Where flights of one coordinate turn, as code of compiled programs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from .flight import single_zeros
from .kernels import Kernels
from .oscillation import excursion_by_law, excursions

if TYPE_CHECKING:
    from .machine_code import Program


def variant_of(kernels: Kernels, values: Sequence[float]) -> str | None:
    """Return how compiled code finds the zeros of the acceleration; None where it cannot.

    They are "fixed" along the branch, or those of a "single" harmonic that changes along it, or are
    found on each flight by its "law".
    """
    harmonics = kernels.harmonics(*values)
    if math.isnan(harmonics[0]):
        return "law" if kernels.oscillates else None
    if not kernels.depends("harmonics"):
        return "fixed"
    return "single" if len(harmonics) == 4 and harmonics[1] == 1 else None


MOTION = """
def excursion(
    head, values, length, arriving, left_side, reached_side, zeros, phase, period, steps,
):
    return excursions(
        any_motion, head, values, length, arriving, left_side, reached_side, zeros, phase, period
    )
"""

LAW = """
def excursion(
    head, values, length, arriving, left_side, reached_side, zeros, phase, period, steps,
):
    return excursion_by_law(
        any_law, head, values, length, arriving, left_side, reached_side, steps, zeros
    )
"""

GIVEN = """
def breaks(values, period, zeros):
    return zeros
"""

SINGLE = """
def breaks(p, period, zeros):
    mean, order, a, b = kernel_harmonics({p})
    return zeros[:single_zeros(mean, a, b, period, zeros)]
"""


def add_excursions(program: Program, kernels: Kernels, variant: str, p: str) -> None:
    """Add the functions ``excursion`` and ``breaks``, given the text of the parameter values."""
    from .machine_code import choice

    walls = kernels.model.letters
    if variant == "law":
        laws = {f"law_{a}": kernels.law(a) for a in walls}
        given = f"head[1], head[2], {p}"
        program.glue(choice("any_law", "head, p", "head[0]", list(laws), given), **laws)
        program.glue(LAW, excursion_by_law=excursion_by_law)
    else:
        motions = {f"motion_{a}": kernels.motion(a) for a in walls}
        given = f"head[1], head[2], dt, {p}"
        motion = choice("any_motion", "head, dt, p", "head[0]", list(motions), given)
        program.glue(motion, **motions)
        program.glue(MOTION, excursions=excursions)
    if variant == "single":
        single = SINGLE.format(p=p)
        program.glue(single, kernel_harmonics=kernels.harmonics, single_zeros=single_zeros)
    else:
        program.glue(GIVEN)
