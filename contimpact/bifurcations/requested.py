"""UZ: the free parameter, a derived one, or a free period takes a value that was asked for."""

from __future__ import annotations

import numpy as np

from ..arrays import Number
from ..continuation.branch import TestFunction
from ..errors import require_known
from ..models.guards import Word
from ..orbits.problem import Array, Linearisation, OrbitProblem, rounding_of_setup
from .codimension_two import leaving_tests
from .declarations import REQUESTED
from .extended_system import EPSILON, ExtendedSystem, Orbits, ReachedTest, ScalarTest
from .kind import Details, Equations, Kind, Look, System, Values, declared

PERIOD = "period"
"""Name of the orbit's period where it is free."""


class RequestedValues(ScalarTest):
    """A parameter or derived parameter, or a free period, minus each value requested of it."""

    kind = REQUESTED

    def __init__(self, problem: OrbitProblem, requested: Values) -> None:
        known = (problem.parameter, *problem.model.DERIVED, *[PERIOD] * problem.autonomous)
        for name in requested:
            found = "it does not vary along the branch"
            require_known(name, known, f"values.{name}", found)
        self.requested = [(name, float(v)) for name, values in requested.items() for v in values]
        derived = list(problem.model.DERIVED)
        self.first = problem.n
        others = {PERIOD: -2, problem.parameter: -1}
        self.columns = [others[n] if n in others else derived.index(n) for n, _ in self.requested]

    def of(self, orbits: Orbits) -> Array:
        """The columns of the derived parameters, the period and the free one, minus the values."""
        free = orbits.unknowns[:, self.first, None]
        columns = np.hstack([orbits.derived, orbits.spans[:, None], free])
        return columns[:, self.columns] - [value for _, value in self.requested]

    def gradient(self, problem: OrbitProblem, z: Array, index: int) -> Array:
        gradient, column = np.zeros(len(z)), self.columns[index]
        if column == -2:
            gradient[0] = problem.closing(1.0, 0.0) - 1.0
            return gradient
        gradient[self.first] = 1.0
        if column >= 0:
            slopes = problem.kernels.setup(*problem.values(z)).derived_slopes
            gradient[self.first :] = np.reshape(slopes, (-1, problem.free))[column]
        return gradient

    def noise_of(self, problem: OrbitProblem, z: Array, index: int) -> float:
        name, wanted = self.requested[index]
        if name in (problem.parameter, PERIOD):
            return 0.0
        place = problem.model.DERIVED.index(name)
        return rounding_of_setup(problem, z).derived[place] + EPSILON * abs(wanted)

    def described(self, problem: OrbitProblem, index: int) -> Details:
        name, wanted = self.requested[index]
        return {"requested": {name: wanted}}


@declared(place=8, usual=False, curves=True)
class UZ(Kind):
    """Requested value; AUTO's name for it."""

    name = RequestedValues.kind
    tilde = False
    look = Look("|", "0.55")

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction[Linearisation]:
        return RequestedValues(problem, values)

    def equations(self, problem: OrbitProblem, details: Details) -> ExtendedSystem:
        ((name, value),) = details["requested"].items()
        return ReachedTest(problem, RequestedValues(problem, {name: [value]}), 0)

    def codimension_two(self, word: Word) -> list[TestFunction]:
        return [*leaving_tests(self.name)]

    def in_many_digits(self, orbit: Equations, unknowns: Array, details: Details) -> System:
        ((name, wanted),) = details["requested"].items()
        problem = orbit.problem

        def off(z: list[Number]) -> Number:
            if name == problem.parameter:
                return z[-1] - wanted
            if name == PERIOD:
                return problem.closing(z[0], 0) - z[0] - wanted
            derived = orbit.setup(orbit.values(z)).derived
            return derived[problem.model.DERIVED.index(name)] - wanted

        return orbit.vanishing(off)
