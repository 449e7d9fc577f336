"""A kind of event of one's own: a multiplier takes a given value.

    python examples/requested_multiplier.py

The page "Architecture" of the documentation shows how kinds are written. A class of another
`value` is another kind: give it a `name` of its own.
"""

import numpy as np

import contimpact as ci
from contimpact.bifurcations.extended_system import ROUNDING, SingularCycle, has_multiplier, located
from contimpact.bifurcations.kind import Kind, Look
from contimpact.continuation.branch import TestFunction
from contimpact.continuation.corrector import scaled_determinant


class MultiplierValue(TestFunction):
    """The determinant of the cyclic matrix with its last coupling multiplied by the value."""

    rounding = ROUNDING

    def __init__(self, kind, value):
        self.kind, self.value = kind, value

    def values(self, point):
        matrix = point.evaluation.cyclic(self.value)[:, :-1]
        return np.array([scaled_determinant(matrix)])

    def locate(self, problem, guess, index):
        return located(SingularCycle(problem, self.value), guess)

    def accept(self, event):
        return has_multiplier(event, self.value)


class MU(Kind):
    """A multiplier is 0.5. Nothing changes there, so nothing is set aside, and no tilde."""

    name = "MU"
    value = 0.5
    tilde = False
    look = Look(marker="d")

    def test(self, problem, values):
        return MultiplierValue(self.name, self.value)

    def equations(self, problem, details):
        return SingularCycle(problem, self.value)

    def in_many_digits(self, orbit, unknowns, details):
        return orbit.singular(unknowns, self.value)


if __name__ == "__main__":
    pair = ci.ImpactPair(beta=np.pi / 6, r=0.3, A=5.0, s=0.389)
    orbit = ci.find_orbits(pair, "1:1", parameter="s")[0]
    for entry in ci.continue_orbit(orbit, range=(0.08, 1.05), events=["PD", "MU"]).events:
        multipliers = ", ".join(f"{complex(*mu):.6g}" for mu in entry.multipliers)
        print(f"{entry.label:4} at s = {entry.value:.12g}, multipliers {multipliers}")
