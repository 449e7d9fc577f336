"""How an orbit moves with a parameter, to first order."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..segments.kernels import Kernels
from .quiet import problem_of

if TYPE_CHECKING:
    from .orbit import Orbit


class Sensitivity(NamedTuple):
    """Derivatives of an orbit with respect to a parameter, all others held.

    Attributes
    ----------
    times : ndarray of shape (N,)
        Of the impact times.
    velocities : ndarray of shape (N,)
        Of the velocities before impact.
    """

    times: Array
    velocities: Array


def sensitivity_of(orbit: Orbit, parameter: str) -> Sensitivity:
    """Solve J dz = -dF/dp for an orbit's derivative.

    Raises
    ------
    InputError
        For a parameter the model does not have, or an orbit at a fold or a branch point.
    """
    model = orbit.model
    model.require(parameter, "parameter")
    problem = problem_of(model, orbit.word, Kernels(model, parameter))
    unknowns = np.append(orbit.unknowns[: problem.n], model.values[parameter])
    jacobian = problem.evaluate(unknowns).jacobian
    try:
        moved = -np.linalg.solve(jacobian[:, : problem.n], jacobian[:, problem.n])
    except np.linalg.LinAlgError:
        accepted = "take an orbit beside it"
        raise InputError("orbit", "it turns here: its derivatives are infinite", accepted) from None
    rows = moved.reshape(-1, problem.m)
    return Sensitivity(rows[:, 0], rows[:, 1])
