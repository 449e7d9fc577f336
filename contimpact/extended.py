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

from .mechanics.orbit import Array, Linearisation, OrbitProblem

EPSILON = float(np.finfo(float).eps)
CURVES = ("FB", "BP", "PD", "G", "V")
"""Kinds of events that have curves in two parameters."""

NEWTON_ITERATIONS = 12
CONVERGED = 1e-10


@dataclass(frozen=True)
class Assembled:
    """An extended system at one point.

    Attributes
    ----------
    residual : ndarray of shape (q,)
    jacobian : ndarray
        Columns by the orbit's unknowns and parameters, then by the system's own unknowns.
    rounding : ndarray of shape (q,)
        Bounds of the rounding errors of the residuals.
    """

    residual: Array
    jacobian: Array
    rounding: Array


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
            np.concatenate([here.residual, cycle @ own, [0.5 * (own @ own - 1.0)]]),
            jacobian,
            np.concatenate(
                [rounding_of(here), 2.0 * EPSILON * (np.abs(cycle) @ np.abs(own)), [EPSILON]]
            ),
        )


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
            np.concatenate([here.residual + nu * psi, square.T @ psi, [psi @ psi - 1.0]]),
            jacobian,
            np.concatenate(
                [rounding_of(here), 2.0 * EPSILON * (np.abs(square).T @ np.abs(psi)), [EPSILON]]
            ),
        )

    def nu_error(self, solution: Solution) -> float:
        """Estimate the error of nu by its row of the inverse Jacobian, as that of the parameter."""
        orbit = len(solution.unknowns)
        at = self.assemble(self.problem.evaluate(solution.unknowns), solution.own)
        try:
            row = np.linalg.solve(at.jacobian.T, np.eye(len(at.residual))[orbit])
        except np.linalg.LinAlgError:
            return float("inf")
        return float(np.abs(row) @ (np.abs(at.residual) + at.rounding))


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
        everything = np.abs(np.concatenate([here.unknowns, own]))
        return Assembled(
            np.concatenate([here.residual, arrival]),
            jacobian,
            EPSILON * (np.abs(jacobian) @ everything),
        )

    def _flight(self, here: Linearisation, own: Array) -> tuple[Array, Array, Array, Array]:
        """Residual and derivatives of the flight to the touch."""
        problem, m = self.problem, self.problem.m
        left = here.unknowns[self.own_impact].tolist()
        values = problem.values(here.unknowns)
        out = np.array(self.kernel(*left, *self.touch(own).tolist(), *values))
        problem.kernel_evaluations += 1
        start, end = out[m : m + 2 * m * m].reshape(2, m, m)
        return out[:m], start, end, out[m + 2 * m * m :].reshape(m, -1)


class Reached(ExtendedSystem):
    """A function of the orbit's unknowns with a known gradient vanishes."""

    def __init__(
        self, problem: OrbitProblem, function: Callable[[OrbitProblem, Array], tuple[float, Array]]
    ) -> None:
        super().__init__(problem)
        self.function = function

    def start(self, here: Linearisation) -> Array:
        return np.zeros(0)

    def assemble(self, here: Linearisation, own: Array) -> Assembled:
        value, gradient = self.function(self.problem, here.unknowns)
        jacobian = np.vstack([here.jacobian, gradient])
        return Assembled(
            np.append(here.residual, value),
            jacobian,
            EPSILON * (np.abs(jacobian) @ np.abs(here.unknowns)),
        )


def rounding_of(here: Linearisation) -> Array:
    """Bound the rounding of each residual by that of its arguments."""
    return EPSILON * (np.abs(here.jacobian) @ np.abs(here.unknowns) + 1e-300)


@dataclass(frozen=True)
class Solution:
    """A solved square system: where, its largest residual, and the parameter's estimated error."""

    unknowns: Array
    own: Array
    residual: float
    error: float


def solve(system: ExtendedSystem, here: Linearisation) -> Solution | None:
    """Solve a system with one free parameter to rounding; None if Newton's iteration fails.

    The error of the parameter is its row of the inverse Jacobian against residual and rounding.
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
            best = (size, x, at)
            x = x - np.linalg.solve(at.jacobian, at.residual)
            at = system.assemble(problem.evaluate(x[:orbit]), x[orbit:])
        if best is None or best[0] >= CONVERGED:
            return None
        size, x, at = best
        row = np.linalg.solve(at.jacobian.T, np.eye(len(x))[orbit - 1])
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None
    error = float(np.abs(row) @ (np.abs(at.residual) + at.rounding))
    return Solution(x[:orbit], x[orbit:], size, error)
