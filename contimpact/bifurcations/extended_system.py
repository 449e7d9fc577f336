r"""Exact equations of events: those of the orbit, and what makes it one of the kind.

======  ===================================================  ====================================
kind    equations                                            unknowns besides orbit and parameters
======  ===================================================  ====================================
FB      F = 0, C(1) q = 0, (q.q - 1)/2 = 0                   q, the eigenvector of the multiplier 1
PD      F = 0, C(-1) q = 0, (q.q - 1)/2 = 0                  q, the eigenvector of -1
NS      F = 0, C(e^{i theta}) q = 0, |q| = 1, phase of q     Re q, Im q, theta
BP      F + nu psi = 0, J' psi = 0, psi.psi - 1 = 0          nu (zero at a branch point), psi
G       F = 0, flight from its impact to the touch = 0       the touch: its time, and the section
                                                             coordinates other than its velocity
        F = 0, rate where a flight begins on a surface = 0
V       F = 0, v_k = 0
T       F = 0, t_{k+1} - t_k = 0
UZ      F = 0, parameter - value = 0
======  ===================================================  ====================================

C(mu) is the cyclic block matrix with its last coupling multiplied by mu; J the Jacobian including
the first parameter. With one free parameter a system is square and its solution an event; with two,
its solutions are a curve. FB and PD after Seydel (1979), BP after Moore (1980).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..continuation.branch import Details, Located
from ..orbits.problem import Array, Linearisation, OrbitProblem
from .orbit_test import OrbitPoint

EPSILON = float(np.finfo(float).eps)
NEWTON_ITERATIONS = 12
CONVERGED = 1e-10
FAR = 2.0
"""How far from its guess Newton's iteration may go, in waves of the forcing and largest velocities,
and how much longer the period may get: an event is much nearer, and integrated flights cost the
more the longer they are."""
FIRST_ORDER = 2.0
"""How much larger an error may be than what the linear equations say."""


@dataclass(frozen=True)
class Assembled:
    """An extended system at one point.

    Attributes
    ----------
    residual : ndarray of shape (q,)
    jacobian : ndarray
        Columns by the orbit's unknowns and parameters, then by the system's own unknowns.
    """

    residual: Array
    jacobian: Array


class ExtendedSystem(ABC):
    """The defining equations of one kind of event, on the orbits of one problem."""

    def __init__(self, problem: OrbitProblem) -> None:
        self.problem = problem

    @abstractmethod
    def start(self, here: Linearisation) -> Array:
        """Return a guess of the system's own unknowns at an orbit near the event."""

    @abstractmethod
    def assemble(self, here: Linearisation, own: Array) -> Assembled:
        """Return the system at an orbit and its own unknowns."""

    @abstractmethod
    def rounding(self, here: Linearisation, own: Array) -> Array:
        """Return bounds of the rounding errors of the residuals there, shape (q,)."""

    def scale(self, own: Array, sizes: Array) -> Array:
        """Return natural sizes of the system's own unknowns, given those of the orbit's."""
        return np.ones(len(own))

    def details(self, own: Array) -> Details:
        """Return what the system's own unknowns tell of where on the orbit it is."""
        return {}


@dataclass(frozen=True)
class Solution:
    """A solved square system: the orbit, the system's own unknowns, its largest residual, and a
    bound of the parameter's error."""

    here: Linearisation
    unknowns: Array
    own: Array
    residual: float
    error: float


def solve(system: ExtendedSystem, here: Linearisation) -> Solution | None:
    """Solve a system with one free parameter to rounding; None if Newton's iteration fails.

    It fails where it leaves the surroundings of its guess, be it for another event further away.
    The error of the parameter is its row of the inverse Jacobian against residual and rounding,
    both taken at their largest: what cannot be told from zero in double precision.
    """
    problem, orbit = system.problem, len(here.unknowns)
    near = _surroundings(here)
    x, best = np.concatenate([here.unknowns, system.start(here)]), None
    try:
        at = system.assemble(here, x[orbit:])
        for _ in range(NEWTON_ITERATIONS):
            size = float(np.max(np.abs(at.residual)))
            if not np.isfinite(size) or (
                best is not None and size >= 0.5 * best[0] < 0.5 * CONVERGED
            ):
                break
            best = (size, x, at, here)
            x = x - np.linalg.solve(at.jacobian, at.residual)
            if not near(x[:orbit]):
                break
            here = problem.evaluate(x[:orbit])
            at = system.assemble(here, x[orbit:])
        if best is None or best[0] >= CONVERGED:
            return None
        size, x, at, here = best
        row = np.linalg.solve(at.jacobian.T, np.eye(len(x))[orbit - 1])
        off = FIRST_ORDER * np.abs(at.residual) + system.rounding(here, x[orbit:])
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None
    return Solution(here, x[:orbit], x[orbit:], size, float(np.abs(row) @ off))


def _surroundings(here: Linearisation) -> Callable[[Array], bool]:
    """Return whether unknowns are those of an orbit like one."""
    problem, begin = here.problem, here.unknowns
    sizes, span = problem.scale(begin, np.full(problem.free, np.inf)), problem.span(begin)

    def near(unknowns: Array) -> bool:
        away = float(np.linalg.norm((unknowns - begin) / sizes))
        return away < FAR and abs(problem.span(unknowns)) < FAR * span

    return near


def located(
    system: ExtendedSystem,
    guess: OrbitPoint,
    details: Callable[[Solution], Details] | None = None,
) -> Located | None:
    """Solve a system from a point as a test function does; None if that fails."""
    solution = solve(system, guess.evaluation)
    if solution is None:
        return None
    told = details(solution) if details else {}
    return Located(solution.unknowns, solution.residual, solution.error, told, solution.here)


def rounding_of_product(matrix: Array, bounds: Array, vector: Array) -> Array:
    """Bound the rounding of a product with a matrix whose entries have errors of their own."""
    terms = np.count_nonzero(matrix, axis=1)
    return bounds @ np.abs(vector) + EPSILON * terms * (np.abs(matrix) @ np.abs(vector))


def rounding_of_length(vector: Array) -> float:
    """Bound the rounding of half the difference of a vector's squared length from one."""
    return EPSILON * len(vector) * float(vector @ vector)
