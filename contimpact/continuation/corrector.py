r"""The corrector: Newton's method on the bordered system.

It solves F(z) = 0 together with one more equation, :math:`c \cdot (z - z_p) = 0`, by Newton's
method on the bordered matrix

    [ dF/dz ]
    [   c   ]

(Keller 1977; Allgower and Georg, Introduction to Numerical Continuation Methods, 1990).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

import numpy as np

from ..arrays import Array, Vector
from .bordered import DenseSystem
from .metric import EPSILON, norm
from .problem import Evaluation, Problem
from .refusal import Refusal, Refused
from .settings import Settings

D = TypeVar("D")
"""The problem, in the form in which functions of the plain subset take it."""

Evaluate: TypeAlias = Callable[[D, Vector], float]
Solve: TypeAlias = Callable[[D, Vector, float, Vector], bool]
"""What `newton` asks of a problem."""

CONVERGED, NO_VALUE, NO_SOLUTION, DIVERGES, SLOW = range(5)
"""Status codes of `newton`."""

MAY_BE_ROUNDING = 1e-6
"""Newton steps longer than this are not asked if they are rounding."""


def newton(
    evaluate: Evaluate[D],
    solve: Solve[D],
    data: D,
    z: Vector,
    guess: Vector,
    row: Vector,
    scale: Vector,
    step: Vector,
    tolerance: float,
    most: int,
) -> tuple[int, int, float]:
    """Solve F(z) = 0, row . (z - guess) = 0 by Newton's method.

    Accepts a point whose residual is below the tolerance, or whose Newton step is at the rounding
    of the unknowns. A step that no longer contracts is refused. Written in the plain subset of
    Python that `contimpact.compiling` compiles.

    Parameters
    ----------
    evaluate : callable ``evaluate(data, z)``
        The largest residual; NaN where F has no value.
    solve : callable ``solve(data, row, g, out)``
        Fills `out` with the solution of the bordered system at the point last evaluated, with the
        border's right side g; whether there is one.
    data
        Handed on to both.
    z, guess, row, scale, step : vector
        `z` is filled with the point reached, `step` is scratch space.
    tolerance : float
    most : int
        Iterations at most.

    Returns
    -------
    status, iterations : int
    first : float
        Length of the first step.
    """
    n = len(z)
    before, first = math.inf, 0.0
    for i in range(n):
        z[i] = guess[i]
    for iteration in range(most + 1):
        worst = evaluate(data, z)
        if worst - worst != 0.0:  # infinite or NaN
            return NO_VALUE, iteration, first
        if worst <= tolerance:
            return CONVERGED, iteration, first
        if iteration == most:
            break
        g = 0.0
        if iteration > 0:
            for i in range(n):
                g += row[i] * (guess[i] - z[i])
        if not solve(data, row, g, step):
            return NO_SOLUTION, iteration, first
        moved = norm(step, scale)
        if iteration == 0:
            first = moved
        if not moved < 2.0 * before:
            return DIVERGES, iteration, first
        if moved < MAY_BE_ROUNDING and moved <= 4.0 * EPSILON * norm(z, scale):
            return CONVERGED, iteration, first
        before = moved
        for i in range(n):
            z[i] += step[i]
    return SLOW, most, first


@dataclass(frozen=True, eq=False)
class Correction:
    """What the corrector reached: an evaluation, or the reason it reached none."""

    evaluation: Evaluation | None
    iterations: int
    refused: Refused | None = None
    first_step: float = 0.0

    @property
    def reason(self) -> str:
        """The reason in words."""
        return str(self.refused or "")


def correct(
    problem: Problem, guess: Array, row: Array, scale: Array, settings: Settings
) -> Correction:
    """Solve F(z) = 0, row . (z - guess) = 0 by Newton's method; see `newton`."""
    row = row / np.linalg.norm(row * scale)
    system, z = DenseSystem(problem), [0.0] * len(guess)
    vectors = z, guess.tolist(), row.tolist(), scale.tolist(), [0.0] * len(z)
    most = settings.max_iterations
    status, iterations, first = newton(
        DenseSystem.evaluate, DenseSystem.solve, system, *vectors, settings.tolerance, most
    )
    if status == CONVERGED:
        return Correction(system.here, iterations, first_step=first)
    return Correction(None, iterations, failure(status, problem, z, most))


def failure(status: int, problem: Problem, z: list[float], most: int) -> Refused:
    """Return why `newton` failed at a point."""
    if status == NO_VALUE:
        return Refused(Refusal.NO_VALUE, why_no_value(problem, np.array(z)))
    reasons = {NO_SOLUTION: Refusal.NO_SOLUTION, DIVERGES: Refusal.DIVERGES, SLOW: Refusal.SLOW}
    return Refused(reasons[status], most)


def why_no_value(problem: Problem, z: Array) -> str:
    """Return in words why the equations have no finite value at a point."""
    try:
        problem.evaluate(z)
    except (ArithmeticError, ValueError) as error:
        return f"the equations have no value: {error}"
    return "the residual is not finite"
