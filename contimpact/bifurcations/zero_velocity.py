"""V: an impact's velocity vanishes; beyond, the impact runs the wrong way.

It is the grazing of the orbit without that impact, seen from the longer word. Its multipliers are
those of the shorter word: the same orbit, whose own have no pole.

A contact with a soft stop vanishes as a whole: its two impacts meet, and the velocities of both
vanish with its duration, which tells when.
"""

from __future__ import annotations

import numpy as np

from ..continuation.problem import Problem
from ..continuation.test_function import Located, TestFunction
from ..models.word import Word
from ..orbits.linearisation import Linearisation
from ..orbits.multipliers import count_unstable, stability_of
from ..orbits.physicality import WRONG_WAY, Verdict
from ..orbits.problem import Array, OrbitProblem
from .adding import where_added
from .codimension_two import CurvePoint, touch_points
from .extended_system import ExtendedSystem
from .kind import Change, Details, Kind, Look, ManyDigits, System, Values
from .orbit_test import OrbitEvent, OrbitPoint, Orbits
from .reached import Reached, ScalarTest
from .sliding import at_rest
from .start import Start, regular
from .vanishing import vanished, vanishing, without
from .zero_duration import ZeroDuration


class ZeroVelocity(ScalarTest):
    """The velocity of each impact, towards its wall; the duration of each excursion."""

    kind = "V"

    def __init__(self, problem: OrbitProblem) -> None:
        sides = {w.name: float(w.side) for w in problem.model.WALLS}
        met = {k for flight in problem.excursions for k in vanishing(problem, flight)}
        self.impacts = [k for k in range(len(problem.word)) if k not in met]
        self.sides = np.array([sides[problem.word.walls[k]] for k in self.impacts])
        self.velocities = 1 + problem.m * np.array(self.impacts, dtype=int)
        self.excursions = list(problem.excursions)
        self.durations = ZeroDuration(problem)

    def of(self, orbits: Orbits) -> Array:
        speeds = self.sides * orbits.unknowns[:, self.velocities]
        return np.hstack([speeds, self.durations.lengths(orbits)[:, self.excursions]])

    def gradient(self, problem: OrbitProblem, z: Array, index: int) -> Array:
        if index >= len(self.impacts):
            return self.durations.gradient(problem, z, self.place(index))
        gradient = np.zeros(len(z))
        gradient[self.velocities[index]] = self.sides[index]
        return gradient

    def noise_of(self, problem: OrbitProblem, z: Array, index: int) -> float:
        if index < len(self.impacts):
            return 0.0
        return self.durations.noise_of(problem, z, self.place(index))

    def locate(
        self, problem: Problem[Linearisation], guess: OrbitPoint, index: int
    ) -> Located | None:
        own, impact = guess.evaluation.problem, self.place(index)
        told = self.described(own, index)
        flights = impact, (impact - 1) % len(own.word)
        found = (where_added(guess, flight, told) for flight in flights)
        return next(filter(None, found), None) or super().locate(problem, guess, index)

    def place(self, index: int) -> int:
        """Return the number of the impact, or of the first of those that meet."""
        return [*self.impacts, *self.excursions][index]

    def described(self, problem: OrbitProblem, index: int) -> Details:
        return {"impact": self.place(index), "wall": problem.word.walls[self.place(index)]}


class V(Kind):
    """Zero velocity of an impact."""

    name = ZeroVelocity.kind
    changes = Change.PHYSICALITY
    finding = WRONG_WAY
    needed = ("impact",)
    look = Look("v", "#E69F00")

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction[Linearisation]:
        return ZeroVelocity(problem)

    def equations(self, problem: OrbitProblem, details: Details) -> ExtendedSystem:
        test = ZeroVelocity(problem)
        return Reached(problem, test, [*test.impacts, *test.excursions].index(details["impact"]))

    def in_many_digits(self, orbit: ManyDigits, unknowns: Array, details: Details) -> System:
        impact = details["impact"]
        if impact in orbit.problem.excursions:
            return orbit.vanishing(lambda x: orbit.duration(x, impact))
        return orbit.vanishing(lambda x: x[orbit.problem.m * impact + 1])

    def born(self, event: OrbitEvent) -> Start | None:
        here: Linearisation = event.point.evaluation
        shorter = without(here, event.details["impact"])
        return None if shorter is None else regular(*shorter)

    def next_word(self, event: OrbitEvent) -> Word | None:
        shorter = without(event.point.evaluation, event.details["impact"])
        return None if shorter is None else shorter[0].word

    def critical(self, multipliers: Array) -> list[int]:
        """The return map's derivative is infinite there."""
        return [int(np.argmax(np.abs(multipliers)))]

    def multipliers(self, here: Linearisation, details: Details) -> tuple[Array, int]:
        shorter = without(here, details["impact"])
        if shorter is None:
            return super().multipliers(here, details)
        there = shorter[0].evaluate(shorter[1])
        found = there.told(stability_of(there.held, there.end)).multipliers
        return found, int(count_unstable(found))

    def verdict(self, here: Linearisation, details: Details) -> Verdict:
        return here.judge(forgive_impacts=vanished(here, details["impact"]))

    def sliding(self, event: OrbitEvent) -> str | None:
        here = event.point.evaluation
        return at_rest(here.problem, here.unknowns, event.details["impact"])

    def codimension_two(self, word: Word) -> list[TestFunction[CurvePoint]]:
        shorter = _without_touch if len(word) > 1 else None
        return touch_points(_at_impact, lambda here: here.orbit, shorter)


def _without_touch(here: CurvePoint) -> Linearisation:
    shorter = without(here.orbit, here.details["impact"])
    if shorter is None:
        raise ArithmeticError("no impact is left")
    here.orbit.problem.kernel_evaluations += len(shorter[0].word)
    return shorter[0].evaluate(shorter[1])


def _at_impact(here: CurvePoint) -> tuple[int, float]:
    return here.details["impact"], 0.0
