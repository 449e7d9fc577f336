"""V: an impact's velocity vanishes; beyond, the impact runs the wrong way.

It is the grazing of the orbit without that impact, seen from the longer word. Its multipliers are
those of the shorter word: the same orbit, whose own have no pole.

A contact with a soft stop vanishes as a whole: its two impacts meet, and the velocities of both
vanish with its duration, which tells when. A contact that lasts may also begin or end at rest: the
flight that arrives there only touches the guard. No word without that impact goes on from there;
nothing is born, and ``flight`` in the details tells this event from a contact that vanishes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..continuation.branch import Location, Problem, TestFunction
from ..models.guards import Word
from ..orbits.problem import Array, Linearisation, OrbitProblem
from ..orbits.status import WRONG_WAY, Verdict, count_unstable
from .codimension_two import touch_points
from .extended_system import (
    ExtendedSystem,
    OrbitEvent,
    OrbitPoint,
    Orbits,
    ReachedTest,
    ScalarTest,
    leaves_no_trace,
)
from .kind import (
    Change,
    CurvePoint,
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
from .scalar_systems import EPSILON, ScalarForm
from .sliding import (
    ADDING,
    INSTANT,
    TOUCHING,
    guard_at,
    is_same_orbit,
    other_end_of,
    remove_impacts,
    sliding_kind_of_zero_duration,
    sliding_kind_of_zero_velocity,
    tolerated_touches,
    vanishing_impacts,
    where_added,
)
from .zero_duration import ZeroDuration


class ZeroVelocity(ScalarTest):
    """The velocity of each impact, towards its wall; the duration of each excursion.

    The velocities at both ends of an excursion vanish with it. Divided by its duration they do not,
    and tell where one vanishes alone.
    """

    kind = "V"

    def __init__(self, problem: OrbitProblem) -> None:
        met = {k for flight in problem.excursions for k in vanishing_impacts(problem, flight)}
        self.impacts = [k for k in range(len(problem.word)) if k not in met]
        self.sides = np.array([float(guard_at(problem, k).side) for k in self.impacts])
        self.velocities = 1 + problem.m * np.array(self.impacts, dtype=int)
        self.excursions = list(problem.excursions)
        self.durations = ZeroDuration(problem)
        self.alone = [VelocityBetweenExcursions(problem, k) for k in sorted(met)]

    def of(self, orbits: Orbits) -> Array:
        speeds = self.sides * orbits.unknowns[:, self.velocities]
        if not (self.excursions or self.alone):
            return speeds
        lengths = self.durations.lengths(orbits)
        alone = [one.rates(orbits, lengths) for one in self.alone]
        return np.column_stack([speeds, lengths[:, self.excursions], *alone])

    def gradient(self, problem: OrbitProblem, z: Array, index: int) -> Array:
        if index >= self.together:
            return self.alone[index - self.together].gradient(problem, z, self.durations)
        if index >= len(self.impacts):
            return self.durations.gradient(problem, z, self.place(index))
        gradient = np.zeros(len(z))
        gradient[self.velocities[index]] = self.sides[index]
        return gradient

    def noise_of(self, problem: OrbitProblem, z: Array, index: int) -> float:
        if not len(self.impacts) <= index < self.together:
            return 0.0
        return self.durations.noise_of(problem, z, self.place(index))

    @property
    def together(self) -> int:
        """How many values tell of impacts that vanish."""
        return len(self.impacts) + len(self.excursions)

    def locate(
        self, problem: Problem[Linearisation], guess: OrbitPoint, index: int
    ) -> Location | None:
        own, impact = guess.evaluation.problem, self.place(index)
        told = self.described(own, index)
        flights = impact, (impact - 1) % len(own.word)
        found = (where_added(guess, flight, told) for flight in flights)
        return next(filter(None, found), None) or super().locate(problem, guess, index)

    def form(self, problem: OrbitProblem, index: int) -> ScalarForm | None:
        if index >= len(self.impacts):
            return None
        impact = self.impacts[index]
        around = impact, (impact - 1) % len(problem.word)
        adds = any(sliding_kind_of_zero_duration(problem, k) == ADDING for k in around)
        return None if adds else ScalarForm("reached", impact)

    def enters(self, point: OrbitPoint, index: int) -> bool:
        """Where both flights beside an impact vanish with its velocity, or one without it, the
        quotient passes infinity; that they vanish is an event of its own."""
        if index < self.together:
            return False
        alone = self.alone[index - self.together]
        return alone.merges(point) or alone.lasts(point)

    def accept(self, event: OrbitEvent) -> bool:
        """Where the quotient passes infinity, it has no zero."""
        index = event.details["index"]
        return index < self.together or self.alone[index - self.together].vanishes(event.point)

    def place(self, index: int) -> int:
        """Return the number of the impact, or of the first of those that meet."""
        return [*self.impacts, *self.excursions, *(one.impact for one in self.alone)][index]

    def index(self, details: Details) -> int:
        """Return which of the values an event is a zero of."""
        impact, alone = details["impact"], [one.impact for one in self.alone]
        if "flight" in details and impact in alone:
            return self.together + alone.index(impact)
        return [*self.impacts, *self.excursions].index(impact)

    def described(self, problem: OrbitProblem, index: int) -> Details:
        impact = self.place(index)
        told = {"impact": impact, "wall": problem.word.walls[impact]}
        if index < self.together:
            return told
        return told | {"flight": (impact - 1) % len(problem.word)}


MERGING = 1e-2
"""Flights beside an impact that are both below this part of the period vanish with it nearby."""

ALONE = 1e-3
"""A velocity vanishes alone if its part of the largest is below this part of what the shortest
flight beside it is of the period: at rounding instead of near one."""


class VelocityBetweenExcursions:
    """The velocity of an impact between excursions, towards its wall, over their durations."""

    def __init__(self, problem: OrbitProblem, impact: int) -> None:
        beside = impact, (impact - 1) % len(problem.word)
        self.impact, self.side = impact, float(guard_at(problem, impact).side)
        self.flights = [k for k in beside if k in problem.excursions]
        self.velocity = 1 + problem.m * impact

    def rates(self, orbits: Orbits, lengths: Array) -> Array:
        """Return them for many orbits; not a number where an excursion vanishes, shape (P,)."""
        least = np.min(np.abs(lengths[:, self.flights]), axis=1)
        there = least > INSTANT * orbits.spans
        over = np.where(there, np.prod(lengths[:, self.flights], axis=1), np.nan)
        return self.side * orbits.unknowns[:, self.velocity] / over

    def durations_at(self, point: OrbitPoint) -> list[float]:
        """Return those of the flights beside it."""
        ends = [point.evaluation.problem.times_around(point.unknowns, k) for k in self.flights]
        return [abs(end - begin) for begin, end in ends]

    def merges(self, point: OrbitPoint) -> bool:
        """Whether both flights beside it are short."""
        return max(self.durations_at(point)) < MERGING * point.evaluation.span

    def lasts(self, point: OrbitPoint) -> bool:
        """Whether the velocity does not vanish with a flight that is short."""
        return self._part(point) ** 2 > min(self.durations_at(point)) / point.evaluation.span

    def vanishes(self, point: OrbitPoint) -> bool:
        """Whether the velocity does, and the flights last."""
        most = ALONE * min(self.durations_at(point))
        return self._part(point) * point.evaluation.span < most

    def _part(self, point: OrbitPoint) -> float:
        """Return the velocity as a part of the largest."""
        here, z = point.evaluation, point.unknowns
        speeds = np.abs(z[1 :: here.problem.m][: len(here.problem.word)])
        return float(abs(z[self.velocity]) / np.max(speeds))

    def gradient(self, problem: OrbitProblem, z: Array, durations: ZeroDuration) -> Array:
        """Return the gradient of one of them, shape (n + 1,)."""
        ends = [problem.times_around(z, k) for k in self.flights]
        lengths = [end - begin for begin, end in ends]
        rates = (
            durations.gradient(problem, z, k) / d
            for k, d in zip(self.flights, lengths, strict=True)
        )
        gradient = -z[self.velocity] * np.sum(list(rates), axis=0)
        gradient[self.velocity] += 1.0
        return self.side * gradient / np.prod(lengths)


def impacts_at_rest(problem: OrbitProblem, details: Details) -> tuple[int, ...]:
    """Return the impacts that have no velocity at an event."""
    impact = details["impact"]
    return (impact,) if "flight" in details else vanishing_impacts(problem, impact)


@declared(place=6, born=True, curves=True)
class V(Kind):
    """Zero velocity of an impact."""

    name = ZeroVelocity.kind
    changes = Change.PHYSICALITY
    finding = WRONG_WAY
    needed = ("impact",)
    shorter_at = ("PD-V",)
    look = Look("v", "#B8860B")

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction[Linearisation]:
        return ZeroVelocity(problem)

    def equations(self, problem: OrbitProblem, details: Details) -> ExtendedSystem:
        test = ZeroVelocity(problem)
        return ReachedTest(problem, test, test.index(details))

    def in_many_digits(self, orbit: Equations, unknowns: Array, details: Details) -> System:
        impact = details["impact"]
        if impact in orbit.problem.excursions and "flight" not in details:
            return orbit.vanishing(lambda x: orbit.duration(x, impact))
        return orbit.vanishing(lambda x: x[orbit.problem.m * impact + 1])

    def born(self, event: OrbitEvent) -> Start | None:
        here: Linearisation = event.point.evaluation
        shorter = remove_impact(here, event.details)
        return None if shorter is None else null_vector_start(*shorter)

    def continues(self, event: OrbitEvent) -> bool:
        """A soft contact that vanishes leaves the motion without it."""
        contacts = event.point.evaluation.problem.excursions
        return event.details["impact"] in contacts and "flight" not in event.details

    def next_word(self, event: OrbitEvent) -> Word | None:
        shorter = remove_impact(event.point.evaluation, event.details)
        return None if shorter is None else shorter[0].word

    def critical(self, multipliers: Array) -> list[int]:
        """The return map's derivative is infinite there."""
        return [int(np.argmax(np.abs(multipliers)))]

    def multipliers(
        self, here: Linearisation, details: Details, beside: Sequence[Linearisation] = ()
    ) -> tuple[Array, int]:
        shorter = remove_impact(here, details)
        if shorter is not None:
            there = shorter[0].evaluate(shorter[1])
            found = there.by_blocks.multipliers
        elif leaves_no_trace(here):
            found = _limit_of_multipliers(here, beside)
        else:
            return super().multipliers(here, details)
        return found, int(count_unstable(found))

    def verdict(self, here: Linearisation, details: Details) -> Verdict:
        if "flight" in details:
            here, impacts = (
                _set_zero_velocity(here, details["impact"]),
                impacts_at_rest(here.problem, details),
            )
        else:
            impacts = other_end_of(here, details["impact"])
        here = _end_contacts(here)
        resting = {*impacts, *here.resting}
        return here.judge(forgive_touches=tolerated_touches(here), forgive_impacts=resting)

    def sliding(self, event: OrbitEvent) -> str | None:
        here = event.point.evaluation
        return sliding_kind_of_zero_velocity(here.problem, here.unknowns, event.details["impact"])

    def codimension_two(self, word: Word) -> list[TestFunction[CurvePoint]]:
        shorter = _without_touch if len(word) > 1 else None
        return touch_points(_impact_at_rest, lambda here: here.orbit, shorter)


def _limit_of_multipliers(here: Linearisation, known: Sequence[Linearisation]) -> Array:
    """The multipliers where an impact at rest leaves no trace, so that they are quotients of
    rounding: the middle of those of the branch to either side, or of known orbits beside it where
    another solution crosses the branch, as that of a slip that never lasts."""
    step = np.cbrt(EPSILON) * here.singular_vectors(here.jacobian)[1][-1]
    near = [here.problem.evaluate(here.unknowns + side * step) for side in (-1.0, 1.0)]
    for sides in (near, known):
        if sides and all(np.isfinite(at.multipliers).all() for at in sides):
            found = np.roots(sum(np.poly(at.multipliers) for at in sides))
            return found[np.argsort(-np.abs(found), kind="stable")].astype(complex)
    return here.multipliers


def _impact_at_rest(here: CurvePoint) -> tuple[int, str, float]:
    """The touch is the end of the flight before: the impact may be a jump."""
    orbit, impact = here.orbit, here.details["impact"]
    before = (impact - 1) % len(orbit.problem.word)
    begin, end = orbit.problem.times_around(orbit.unknowns, before)
    return before, orbit.problem.word.walls[impact], end - begin


def remove_impact(here: Linearisation, details: Details) -> tuple[OrbitProblem, Array] | None:
    """As `remove_impacts`, with all others that vanish at this value; None where a contact that
    lasts begins or ends at rest, or an impact at rest is a jump."""
    shorter = None if "flight" in details else remove_impacts(here, details["impact"])
    while shorter is not None:
        there = shorter[0].evaluate(shorter[1])
        if not is_same_orbit(there):
            return None
        test = ZeroVelocity(there.problem)
        others = [*_brief_contacts(there), *(k for k in there.resting if k in test.impacts)]
        if not others:
            break
        shorter = remove_impacts(there, others[0])
    return shorter


def _brief_contacts(here: Linearisation) -> list[int]:
    """The excursions that vanish at this value: their depths, which go with the square of their
    durations, are those of touches.

    Where several vanish at once, rounding of the parameter leaves its square root to their
    durations.
    """
    problem, least = here.problem, math.sqrt(TOUCHING) * here.span
    ends = {k: problem.times_around(here.unknowns, k) for k in problem.excursions}
    return [k for k, (begin, end) in ends.items() if abs(end - begin) < least]


def _end_contacts(here: Linearisation) -> Linearisation:
    """The orbit with these excursions at one instant, and at rest there."""
    problem, unknowns = here.problem, here.unknowns.copy()
    flights = _brief_contacts(here)
    for flight in flights:
        begin, end = problem.times_around(unknowns, flight)
        first, last = vanishing_impacts(problem, flight)
        later = first if last == 0 else last  # the first time of all may be a period
        unknowns[problem.m * later] += (end - begin) * (1.0 if last == 0 else -1.0)
        unknowns[[problem.m * first + 1, problem.m * last + 1]] = 0.0
    return Linearisation(problem, unknowns) if flights else here


def _set_zero_velocity(here: Linearisation, impact: int) -> Linearisation:
    """The orbit with a velocity of zero exactly: the sign of rounding does not tell on which side
    of their guards the flights before and after are; their accelerations do."""
    unknowns = here.unknowns.copy()
    unknowns[here.problem.m * impact + 1] = 0.0
    return Linearisation(here.problem, unknowns)


def _without_touch(here: CurvePoint) -> Linearisation:
    shorter = remove_impact(here.orbit, here.details)
    if shorter is None:
        raise ArithmeticError("no impact is left")
    here.orbit.problem.kernel_evaluations += len(shorter[0].word)
    return shorter[0].evaluate(shorter[1])
