"""Where a branch begins that is born at an event of another one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..continuation.corrector import bordered, first_tangent
from ..models.word import repetitions
from ..orbits.problem import Array, OrbitProblem, rounding
from ..orbits.search import first_lap, shortest
from .extended_system import FIRST_ORDER, rounding_of_product

ALONG, REPEATS = 1e-3, 1e-7
"""How far along a branch it is seen whether its orbits repeat shorter ones, and how nearly."""


@dataclass(frozen=True)
class Start:
    """Where a branch begins, and which way it leaves.

    Attributes
    ----------
    problem : OrbitProblem
        Of the new word.
    unknowns, tangent : ndarray of shape (n + 1,)
        The tangent is not normalised. At a G it points to where the touch is a physical impact.
    branching : bool
        Whether the start is a branch point of the new problem.
    both_ways : bool
        Whether both directions lead to different orbits.
    note : str
        What a reader should know of the branch; empty if there is nothing.
    """

    problem: OrbitProblem
    unknowns: Array
    tangent: Array
    branching: bool
    both_ways: bool
    note: str = ""

    def reversed(self) -> Start:
        """Return the start the other way."""
        return replace(self, tangent=-self.tangent)


def regular(problem: OrbitProblem, unknowns: Array) -> Start | None:
    """Return the start along the null vector of the Jacobian; None where it is not regular."""
    jacobian = problem.evaluate(unknowns).jacobian
    tangent = first_tangent(jacobian, np.ones(len(unknowns)))
    return None if tangent is None else Start(problem, unknowns, tangent, False, True)


def rate_error(start: Start) -> float:
    """Bound the error of the parameter's rate along the tangent of a regular start.

    The tangent is what the Jacobian maps to zero, up to the rounding of both and to where the start
    is: what these move the parameter's component by, at most, is its row of the inverse of the
    Jacobian, bordered by the tangent, against them.
    """
    problem, along = start.problem, start.tangent
    here = problem.evaluate(start.unknowns)
    bounds = rounding(here)
    off = np.abs(here.residual) + bounds.residual
    try:
        inverse = np.abs(np.linalg.inv(bordered(here.jacobian, along)))[:, :-1]
    except np.linalg.LinAlgError:
        return float("inf")
    bent = np.abs(problem.second_along(start.unknowns, along)) @ (inverse @ off)
    product = rounding_of_product(here.jacobian, bounds.jacobian, along)
    return FIRST_ORDER * float(inverse[-1] @ (product + bent))


def once(start: Start) -> Start:
    """Return a start whose branch is one of shorter orbits run several times as one of these.

    So it is where an orbit of several periods touches in each of them, and where one becomes an
    orbit of a shorter period.
    """
    problem, unknowns, tangent = start.problem, start.unknowns, start.tangent
    ahead = unknowns + ALONG * tangent / np.max(np.abs(tangent))
    shorter, _ = shortest(problem, ahead, REPEATS)
    if shorter is problem:
        return start
    longer, repeated = (p.word.notation(p.model.letters) for p in (problem, shorter))
    note = f"the {longer} orbits born there are {repetitions([repeated])}, and followed as such"
    impacts = len(shorter.word)
    unknowns, tangent = (first_lap(problem, z, impacts) for z in (unknowns, tangent))
    return Start(shorter, unknowns, tangent, False, True, note)
