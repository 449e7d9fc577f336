"""V: an impact's velocity vanishes; beyond, the impact runs the wrong way.

It is the grazing of the orbit without that impact, seen from the longer word. Its multipliers are
those of the shorter word: the same orbit, whose own have no pole.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..continuation.branch import Event
from ..continuation.test_function import TestFunction
from ..models.word import Word
from ..orbits.linearisation import Linearisation
from ..orbits.multipliers import count_unstable, multipliers
from ..orbits.physicality import WRONG_WAY, Verdict
from ..orbits.problem import Array, OrbitProblem
from .codimension_two import CurvePoint, touch_points
from .extended_system import ExtendedSystem
from .kind import Change, Details, Kind, Look, ManyDigits, System, Values
from .orbit_test import Orbits
from .reached import Reached, ScalarTest
from .start import Start, regular


class ZeroVelocity(ScalarTest):
    """The velocity of each impact, towards its wall."""

    kind = "V"

    def __init__(self, problem: OrbitProblem) -> None:
        sides = {w.name: float(w.side) for w in problem.model.WALLS}
        self.sides = np.array([sides[w] for w in problem.word.walls])
        self.velocities = np.arange(1, problem.n, problem.m)

    def of(self, orbits: Orbits) -> Array:
        return self.sides * orbits.unknowns[:, self.velocities]

    def gradient(self, problem: OrbitProblem, z: Array, index: int) -> Array:
        gradient = np.zeros(len(z))
        gradient[self.velocities[index]] = self.sides[index]
        return gradient

    def described(self, problem: OrbitProblem, index: int) -> dict[str, Any]:
        return {"impact": index, "wall": problem.word.walls[index]}


class V(Kind):
    """Zero velocity of an impact."""

    name = ZeroVelocity.kind
    changes = Change.PHYSICALITY
    finding = WRONG_WAY
    needed = ("impact",)
    look = Look("v", "#E69F00")

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction:
        return ZeroVelocity(problem)

    def equations(self, problem: OrbitProblem, details: Details) -> ExtendedSystem:
        return Reached(problem, ZeroVelocity(problem), details["impact"])

    def in_many_digits(self, orbit: ManyDigits, unknowns: Array, details: Details) -> System:
        return orbit.vanishing(lambda x: x[orbit.problem.m * details["impact"] + 1])

    def born(self, event: Event) -> Start | None:
        here: Linearisation = event.point.evaluation
        if len(here.problem.word) == 1:
            return None
        return regular(*_without(here, event.details["impact"]))

    def next_word(self, event: Event) -> Word | None:
        word: Word = event.point.evaluation.problem.word
        return word.drop(event.details["impact"]) if len(word) > 1 else None

    def critical(self, multipliers: Array) -> list[int]:
        """The return map's derivative is infinite there."""
        return [int(np.argmax(np.abs(multipliers)))]

    def multipliers(self, here: Linearisation, details: Details) -> tuple[Array, int]:
        if len(here.problem.word) == 1:
            return super().multipliers(here, details)
        shorter, unknowns = _without(here, details["impact"])
        there = shorter.evaluate(unknowns)
        found = multipliers(there.start, there.end)
        return found, int(count_unstable(found))

    def verdict(self, here: Linearisation, details: Details) -> Verdict:
        return here.judge(forgive_impact=details["impact"])

    def codimension_two(self, word: Word) -> list[TestFunction]:
        shorter = _without_touch if len(word) > 1 else None
        return touch_points(_at_impact, lambda here: here.orbit, shorter)


def _without(here: Linearisation, impact: int) -> tuple[OrbitProblem, Array]:
    """The problem of the word without an impact of zero velocity, and the same orbit in it."""
    problem = here.problem
    shorter = OrbitProblem(problem.model, problem.word.drop(impact), problem.kernels)
    kept = np.delete(problem.impacts(here.unknowns), impact, axis=0)
    return shorter, np.append(kept.ravel(), here.unknowns[-problem.free :])


def _without_touch(here: CurvePoint) -> Linearisation:
    shorter, unknowns = _without(here.orbit, here.details["impact"])
    here.orbit.problem.kernel_evaluations += len(shorter.word)
    return shorter.evaluate(unknowns)


def _at_impact(here: CurvePoint) -> tuple[int, float]:
    return here.details["impact"], 0.0
