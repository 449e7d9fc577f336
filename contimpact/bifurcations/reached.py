"""A function of the unknowns with a known gradient reaches zero: V, T and UZ share this."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from ..continuation.branch import Details, Located
from ..continuation.problem import Problem
from ..orbits.problem import Array, Linearisation, OrbitProblem, rounding
from .extended_system import Assembled, ExtendedSystem, located
from .orbit_test import OneOrbit, OrbitPoint, OrbitTest


class ScalarTest(OrbitTest):
    """A function of the unknowns with a known gradient: F = 0 and this function = 0."""

    @abstractmethod
    def gradient(self, problem: OrbitProblem, z: Array, index: int) -> Array:
        """Return the gradient of one of the values, shape (n + 1,)."""

    def locate(
        self, problem: Problem[Linearisation], guess: OrbitPoint, index: int
    ) -> Located | None:
        system = Reached(guess.evaluation.problem, self, index)
        return located(system, guess, lambda solution: self.described(system.problem, index))

    def details(self, point: OrbitPoint, index: int) -> Details:
        problem = point.evaluation.problem
        return {"index": index, **self.described(problem, index)}

    def described(self, problem: OrbitProblem, index: int) -> Details:
        """What to record of a zero."""
        return {}

    def noise_of(self, problem: OrbitProblem, z: Array, index: int) -> float:
        """Return a bound of the function's rounding error; zero where it is an unknown itself."""
        return 0.0


class Reached(ExtendedSystem):
    """One of a test's functions vanishes."""

    def __init__(self, problem: OrbitProblem, test: ScalarTest, index: int) -> None:
        super().__init__(problem)
        self.test, self.index = test, index

    def start(self, here: Linearisation) -> Array:
        return np.zeros(0)

    def assemble(self, here: Linearisation, own: Array) -> Assembled:
        value = self.test.of(OneOrbit(here))[0, self.index]
        gradient = self.test.gradient(self.problem, here.unknowns, self.index)
        return Assembled(np.append(here.residual, value), np.vstack([here.jacobian, gradient]))

    def rounding(self, here: Linearisation, own: Array) -> Array:
        noise = self.test.noise_of(self.problem, here.unknowns, self.index)
        return np.append(rounding(here).residual, noise)
