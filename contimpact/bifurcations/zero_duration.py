"""T: a flight's duration vanishes; beyond, impacts are out of order.

Impacts on different coordinates exchange their order there: the motion continues on another word.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..continuation.branch import Location, Problem, TestFunction
from ..continuation.corrector import first_tangent
from ..models.guards import Word
from ..orbits.problem import Array, Linearisation, OrbitProblem, rounding_of_setup
from ..orbits.status import OUT_OF_ORDER, Verdict, count_unstable
from .extended_system import (
    EPSILON,
    ExtendedSystem,
    OrbitEvent,
    OrbitPoint,
    Orbits,
    ReachedTest,
    ScalarTest,
)
from .kind import (
    Change,
    Details,
    Equations,
    Kind,
    Look,
    Start,
    System,
    Values,
    declared,
    null_vector_start,
)
from .scalar_systems import ScalarForm
from .sliding import (
    ADDING,
    exchange_impacts,
    exchanged_word,
    impacts_at_once,
    sliding_kind_of_zero_duration,
    tolerated_touches,
    where_added,
    without_flight,
)


class ZeroDuration(ScalarTest):
    """The duration of each flight, but of excursions, which are those of a V.

    They are measured by the period. Those within rounding of zero have no value: where r vanishes,
    those of a series of impacts do so together, without changing sign.
    """

    kind = "T"
    vanishing = 1e-12

    def __init__(self, problem: OrbitProblem) -> None:
        self.times = np.arange(0, problem.n, problem.m)
        self.excursions = list(problem.excursions)

    def of(self, orbits: Orbits) -> Array:
        lengths = self.lengths(orbits)
        lengths[:, self.excursions] = np.nan
        return lengths

    def measured(self, orbits: Orbits) -> Array:
        with np.errstate(invalid="ignore", divide="ignore"):  # an orbit of no period has none
            return np.asarray(self.of(orbits) / np.abs(orbits.spans[:, None]))

    def lengths(self, orbits: Orbits) -> Array:
        """Return the durations of all flights."""
        times = orbits.unknowns[:, self.times]
        lengths = np.empty(times.shape)
        lengths[:, :-1] = times[:, 1:] - times[:, :-1]
        lengths[:, -1] = times[:, 0] + orbits.spans - times[:, -1]
        return lengths

    def gradient(self, problem: OrbitProblem, z: Array, index: int) -> Array:
        m, n = problem.m, problem.n
        i, j = m * index, m * (index + 1)
        gradient = np.zeros(len(z))
        gradient[i] -= 1.0
        gradient[j % n] += 1.0 if j < n else problem.closing(1.0, 0.0)
        if j == n:
            slopes = problem.kernels.setup(*problem.values(z)).slopes
            gradient[n:] = problem.word.period * np.array(slopes)
        return gradient

    def locate(
        self, problem: Problem[Linearisation], guess: OrbitPoint, index: int
    ) -> Location | None:
        told = self.described(guess.evaluation.problem, index)
        return where_added(guess, index, told) or super().locate(problem, guess, index)

    def form(self, problem: OrbitProblem, index: int) -> ScalarForm | None:
        adds = sliding_kind_of_zero_duration(problem, index) == ADDING
        return None if adds else ScalarForm("reached", index, 1)

    def described(self, problem: OrbitProblem, index: int) -> Details:
        return {"flight": index}

    def noise_of(self, problem: OrbitProblem, z: Array, index: int) -> float:
        turns = problem.word.period if index == len(problem.word) - 1 else 0
        span = turns * rounding_of_setup(problem, z).period
        return span + 2.0 * EPSILON * float(np.max(np.abs(z[self.times])))


@declared(place=7, born=True, continues=True)
class T(Kind):
    """Zero duration of a flight."""

    name = ZeroDuration.kind
    changes = Change.PHYSICALITY
    finding = OUT_OF_ORDER
    look = Look("X")

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction[Linearisation]:
        return ZeroDuration(problem)

    def equations(self, problem: OrbitProblem, details: Details) -> ExtendedSystem:
        return ReachedTest(problem, ZeroDuration(problem), details["flight"])

    def in_many_digits(self, orbit: Equations, unknowns: Array, details: Details) -> System:
        return orbit.vanishing(lambda x: orbit.duration(x, details["flight"]))

    def born(self, event: OrbitEvent) -> Start | None:
        """Without the flight, where sliding vanishes or begins; with its impacts exchanged, where
        they are on different coordinates: others only merge there."""
        here = event.point.evaluation
        there = without_flight(here, event.details["flight"])
        if there is None and (word := _exchange_word(event)) is not None:
            there = exchange_impacts(here, word)
        return None if there is None else null_vector_start(*there)

    def next_word(self, event: OrbitEvent) -> Word | None:
        there = without_flight(event.point.evaluation, event.details["flight"])
        return _exchange_word(event) if there is None else there[0].word

    def deeper(self, event: OrbitEvent) -> int | None:
        if without_flight(event.point.evaluation, event.details["flight"]) is not None:
            return 1
        return 0 if _exchange_word(event) is not None or _impacts_at_once(event) else None

    def nothing(self, event: OrbitEvent) -> str:
        word = _exchange_word(event)
        if word is None:
            together = _impacts_at_once(event)
            if not together:
                return super().nothing(event)
            return f"{together} happen at once: as which word the motion continues is not known"
        return (
            f"the motion does not continue as {word}: the order of the impacts that happen at once "
            "decides what follows"
        )

    def label(self, ghost: bool, word: Word, beyond: Word | None, walls: Sequence[str]) -> str:
        """Return the label, which shows the order of impacts where they exchange it."""
        if beyond is None or len(beyond) != len(word):
            return super().label(ghost, word, beyond, walls)
        return f"{'~' * ghost}{self.name}[{word}->{beyond}]"

    def multipliers(
        self, here: Linearisation, details: Details, beside: Sequence[Linearisation] = ()
    ) -> tuple[Array, int]:
        there = without_flight(here, details["flight"])
        if there is None and not here.resting:
            return super().multipliers(here, details)
        orbit = here if there is None else there[0].evaluate(there[1])
        found = orbit.by_blocks.multipliers  # of flights they are rounding at rest
        return found, int(count_unstable(found))

    def verdict(self, here: Linearisation, details: Details) -> Verdict:
        return here.judge(forgive_touches=tolerated_touches(here), forgive_impacts=here.resting)

    def sliding(self, event: OrbitEvent) -> str | None:
        return sliding_kind_of_zero_duration(
            event.point.evaluation.problem, event.details["flight"]
        )

    def explains(self, change: Change) -> bool:
        """Where impacts merge, multipliers change too."""
        return True


def _impacts_at_once(event: OrbitEvent) -> str:
    return impacts_at_once(event.point.evaluation, event.details["flight"])


def _exchange_word(event: OrbitEvent) -> Word | None:
    """The word beyond, if impacts exchange their order."""
    here, flight = event.point.evaluation, event.details["flight"]
    problem, unknowns = here.problem, here.unknowns
    tangent = first_tangent(problem, here.jacobian, here.sizes[1])
    if tangent is None:
        return None
    gradient = ZeroDuration(problem).gradient
    rates = [gradient(problem, unknowns, k) @ tangent for k in range(len(problem.word))]
    return exchanged_word(here, flight, np.array(rates))
