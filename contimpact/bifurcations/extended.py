r"""The exact extended systems of the bifurcations of periodic orbits.

======  ===================================================  ====================================
kind    equations                                            unknowns besides orbit and parameters
======  ===================================================  ====================================
FB      F = 0, C(1) q = 0, (q.q - 1)/2 = 0                   q, the eigenvector of the multiplier 1
PD      F = 0, C(-1) q = 0, (q.q - 1)/2 = 0                  q, the eigenvector of -1
BP      F + nu psi = 0, J' psi = 0, psi.psi - 1 = 0          nu (zero at a branch point), psi
G       F = 0, flight from its impact to the touch = 0       the touch: its time, and the section
                                                             coordinates other than its velocity
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

from ..orbits.linearisation import Linearisation
from ..orbits.problem import Array, OrbitProblem
from ..orbits.rounding import bounds_of, rounding

EPSILON = float(np.finfo(float).eps)
NEWTON_ITERATIONS = 12
CONVERGED = 1e-10
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


class SingularCycle(ExtendedSystem):
    """C(mu) is singular: FB for mu = 1, PD for mu = -1."""

    def __init__(self, problem: OrbitProblem, mu: float) -> None:
        super().__init__(problem)
        self.mu = mu

    def start(self, here: Linearisation) -> Array:
        n = self.problem.n
        return np.linalg.svd(here.cyclic(self.mu)[:, :n])[2][-1]

    def assemble(self, here: Linearisation, own: Array) -> Assembled:
        problem, n = self.problem, self.problem.n
        orbit = len(here.unknowns)
        cycle = here.cyclic(self.mu)[:, :n]
        along = np.concatenate([own, np.zeros(orbit - n)])
        jacobian = np.zeros((2 * n + 1, orbit + n))
        jacobian[:n, :orbit] = here.jacobian
        jacobian[n : 2 * n, :orbit] = problem.second_along(here.unknowns, along, self.mu)
        jacobian[n : 2 * n, orbit:] = cycle
        jacobian[2 * n, orbit:] = own
        return Assembled(
            np.concatenate([here.residual, cycle @ own, [0.5 * (own @ own - 1.0)]]), jacobian
        )

    def rounding(self, here: Linearisation, own: Array) -> Array:
        bounds, n = rounding(here), self.problem.n
        product = _rounding_of_product(here.cyclic(self.mu)[:, :n], bounds.cyclic(1.0)[:, :n], own)
        return np.concatenate([bounds.residual, product, [_rounding_of_length(own)]])


class Crossing(ExtendedSystem):
    """Two branches cross, with respect to the first free parameter; nu measures how far from it."""

    def start(self, here: Linearisation) -> Array:
        n = self.problem.n
        return np.concatenate([[0.0], np.linalg.svd(here.jacobian[:, : n + 1])[0][:, -1]])

    def assemble(self, here: Linearisation, own: Array) -> Assembled:
        problem, n = self.problem, self.problem.n
        orbit = len(here.unknowns)
        nu, psi = own[0], own[1:]
        square = here.jacobian[:, : n + 1]
        hessian = np.vstack(
            [psi @ problem.second_along(here.unknowns, e) for e in np.eye(orbit)[: n + 1]]
        )
        jacobian = np.zeros((2 * n + 2, orbit + n + 1))
        jacobian[:n, :orbit] = here.jacobian
        jacobian[:n, orbit] = psi
        jacobian[:n, orbit + 1 :] = nu * np.eye(n)
        jacobian[n : 2 * n + 1, :orbit] = hessian
        jacobian[n : 2 * n + 1, orbit + 1 :] = square.T
        jacobian[2 * n + 1, orbit + 1 :] = 2.0 * psi
        return Assembled(
            np.concatenate([here.residual + nu * psi, square.T @ psi, [psi @ psi - 1.0]]), jacobian
        )

    def rounding(self, here: Linearisation, own: Array) -> Array:
        bounds, n, psi = rounding(here), self.problem.n, own[1:]
        shifted = bounds.residual + EPSILON * (np.abs(here.residual) + np.abs(own[0] * psi))
        product = _rounding_of_product(
            here.jacobian[:, : n + 1].T, bounds.jacobian[:, : n + 1].T, psi
        )
        return np.concatenate([shifted, product, [2.0 * _rounding_of_length(psi)]])

    def nu_error(self, solution: Solution) -> float:
        """Bound the error of nu by its row of the inverse Jacobian, as that of the parameter."""
        orbit = len(solution.unknowns)
        here = self.problem.evaluate(solution.unknowns)
        at = self.assemble(here, solution.own)
        try:
            row = np.linalg.solve(at.jacobian.T, np.eye(len(at.residual))[orbit])
        except np.linalg.LinAlgError:
            return float("inf")
        off = FIRST_ORDER * np.abs(at.residual) + self.rounding(here, solution.own)
        return float(np.abs(row) @ off)


class Touching(ExtendedSystem):
    """A flight reaches a wall with zero velocity."""

    def __init__(self, problem: OrbitProblem, flight: int, wall: str, time: float) -> None:
        super().__init__(problem)
        self.flight, self.wall, self.time = flight, wall, time
        m = problem.m
        self.own_impact = slice(m * flight, m * flight + m)
        self.free = [i for i in range(m) if i != 1]
        self.kernel = problem.kernels.flight(problem.word.walls[flight], wall)

    def touch(self, own: Array) -> Array:
        """Return the touch as an impact: its time and section coordinates."""
        touch = np.zeros(self.problem.m)
        touch[self.free] = own
        return touch

    def start(self, here: Linearisation) -> Array:
        own = np.zeros(len(self.free))
        own[0] = self.time
        if len(own) > 1:  # the other coordinates, from the (near) linear flight equations
            out, _, end, _ = self._flight(here, own)
            own[1:] -= np.linalg.lstsq(end[:, self.free[1:]], out, rcond=None)[0]
        return own

    def assemble(self, here: Linearisation, own: Array) -> Assembled:
        n, m = self.problem.n, self.problem.m
        orbit = len(here.unknowns)
        arrival, start, end, by_parameter = self._flight(here, own)
        jacobian = np.zeros((n + m, orbit + m - 1))
        jacobian[:n, :orbit] = here.jacobian
        jacobian[n:, self.own_impact] = start
        jacobian[n:, n:orbit] = by_parameter
        jacobian[n:, orbit:] = end[:, self.free]
        return Assembled(np.concatenate([here.residual, arrival]), jacobian)

    def rounding(self, here: Linearisation, own: Array) -> Array:
        arrival = bounds_of(self.kernel, self._arguments(here, own))[1][: self.problem.m]
        return np.concatenate([rounding(here).residual, arrival])

    def _flight(self, here: Linearisation, own: Array) -> tuple[Array, Array, Array, Array]:
        """Residual and derivatives of the flight to the touch."""
        problem, m = self.problem, self.problem.m
        out = np.array(self.kernel(*self._arguments(here, own)))
        problem.kernel_evaluations += 1
        start, end = out[m : m + 2 * m * m].reshape(2, m, m)
        return out[:m], start, end, out[m + 2 * m * m :].reshape(m, -1)

    def _arguments(self, here: Linearisation, own: Array) -> list[float]:
        left = here.unknowns[self.own_impact].tolist()
        return [*left, *self.touch(own).tolist(), *self.problem.values(here.unknowns)]


class Reached(ExtendedSystem):
    """A function of the orbit's unknowns with a known gradient vanishes.

    Parameters
    ----------
    problem : OrbitProblem
    function : callable ``function(problem, unknowns) -> value, gradient``
    noise : callable ``noise(problem, unknowns) -> float``, optional
        A bound of the value's rounding error; without one, the value is exact.
    """

    def __init__(
        self, problem: OrbitProblem, function: Callable[[OrbitProblem, Array], tuple[float, Array]],
        noise: Callable[[OrbitProblem, Array], float] = lambda problem, unknowns: 0.0,
    ) -> None:  # fmt: skip
        super().__init__(problem)
        self.function, self.noise = function, noise

    def start(self, here: Linearisation) -> Array:
        return np.zeros(0)

    def assemble(self, here: Linearisation, own: Array) -> Assembled:
        value, gradient = self.function(self.problem, here.unknowns)
        return Assembled(np.append(here.residual, value), np.vstack([here.jacobian, gradient]))

    def rounding(self, here: Linearisation, own: Array) -> Array:
        return np.append(rounding(here).residual, self.noise(self.problem, here.unknowns))


def _rounding_of_product(matrix: Array, bounds: Array, vector: Array) -> Array:
    """Bound the rounding of a product with a matrix whose entries have errors of their own."""
    terms = np.count_nonzero(matrix, axis=1)
    return bounds @ np.abs(vector) + EPSILON * terms * (np.abs(matrix) @ np.abs(vector))


def _rounding_of_length(vector: Array) -> float:
    """Bound the rounding of half the difference of a vector's squared length from one."""
    return EPSILON * len(vector) * float(vector @ vector)


@dataclass(frozen=True)
class Solution:
    """A solved square system: where, its largest residual, and a bound of the parameter's error."""

    unknowns: Array
    own: Array
    residual: float
    error: float


def solve(system: ExtendedSystem, here: Linearisation) -> Solution | None:
    """Solve a system with one free parameter to rounding; None if Newton's iteration fails.

    The error of the parameter is its row of the inverse Jacobian against residual and rounding,
    both taken at their largest: what cannot be told from zero in double precision.
    """
    problem, orbit = system.problem, len(here.unknowns)
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
            here = problem.evaluate(x[:orbit])
            at = system.assemble(here, x[orbit:])
        if best is None or best[0] >= CONVERGED:
            return None
        size, x, at, here = best
        row = np.linalg.solve(at.jacobian.T, np.eye(len(x))[orbit - 1])
        off = FIRST_ORDER * np.abs(at.residual) + system.rounding(here, x[orbit:])
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None
    return Solution(x[:orbit], x[orbit:], size, float(np.abs(row) @ off))
