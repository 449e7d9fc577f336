"""Where the motion after an impact begins on a limit of its mode.

Sliding begins on one of its limits, as where a crossing or a switching of sliding is; or a flight
that begins on the surface of a guard has no rate there: beyond, it leaves its mode at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..continuation.branch import Details, Located
from ..models.word import Word
from ..orbits.problem import Array, OrbitProblem
from ..orbits.quiet import problem_of
from ..segments.touches import limits_of, margin, on_surface
from .branch_point import directions_at
from .extended_system import ExtendedSystem, located
from .kind import SUB, SUPER
from .orbit_test import OrbitEvent, OrbitPoint
from .sliding import lengthened, longer, respelled
from .start import Start, regular
from .touching import Beginning, Tangent


@dataclass(frozen=True)
class Begun:
    """An impact after which the motion begins within a limit, or beyond.

    Attributes
    ----------
    problem : OrbitProblem
    impact : int
    begun, limit : str
    sign : float
        See `contimpact.segments.touches.limits_of`.
    """

    problem: OrbitProblem
    impact: int
    begun: str
    limit: str
    sign: float

    def margin(self, unknowns: Array) -> float:
        """Return how far it is from the limit, negative where another impact takes its place."""
        kernels, values = self.problem.kernels, self.problem.values(unknowns)
        leave = self.problem.impacts(unknowns)[self.impact].tolist()
        given = leave, values, kernels.setup(*values).walls
        return self.sign * margin(kernels, self.begun, self.limit, *given)

    @property
    def on_surface(self) -> bool:
        """Whether the flight begins on the surface of the limit, and its rate vanishes."""
        return on_surface(self.problem.kernels, self.begun, self.limit)

    def equations(self) -> ExtendedSystem:
        """Return the equations of an orbit on the limit."""
        if self.on_surface:
            return Tangent(self.problem, self.impact, self.limit)
        return Beginning(self.problem, self.impact, self.begun, self.limit)

    def locate(self, guess: OrbitPoint) -> Located | None:
        """Solve these from a point near it."""
        return located(self.equations(), guess, lambda solution: self.details(solution.unknowns))

    def details(self, unknowns: Array) -> Details:
        """Return where on the orbit it is."""
        time = float(self.problem.impacts(unknowns)[self.impact, 0])
        place = {"flight": self.impact, "impact": self.impact}
        return {**place, "wall": self.limit, "touch_time": time}

    def next_word(self) -> Word | None:
        """Return the word beyond."""
        letters = longer(self.problem, self.impact, self.limit)
        return None if letters is None else respelled(self.problem.word, self.impact, letters)

    def born(self, unknowns: Array) -> Start | None:
        """Return the start of the branch beyond, on which a flight more takes some time."""
        letters, word = longer(self.problem, self.impact, self.limit), self.next_word()
        if letters is None or word is None:
            return None
        there = problem_of(self.problem.model, word, self.problem.kernels)
        rows = lengthened(self.problem, unknowns, self.impact, letters)
        start = regular(there, there.with_impacts(rows, self.problem.span(unknowns), unknowns))
        return start if start is None or self._longer(start) >= 0.0 else start.reversed()

    def criticality(self, event: OrbitEvent, start: Start) -> str | None:
        """Return whether both orbits exist together or one takes over from the other."""
        along = event.point.tangent
        system, here = self.equations(), event.point.evaluation
        rates = system.assemble(here, system.start(here)).jacobian[self.problem.n]
        inwards = -self._side * self.sign * float(rates[: len(along)] @ along) * float(along[-1])
        longer = self._longer(start) * float(start.tangent[-1])
        if inwards == 0.0 or longer == 0.0:
            return None
        return SUB if (inwards > 0.0) == (longer > 0.0) else SUPER

    def _longer(self, start: Start) -> float:
        """The rate at which the new flight's duration grows along the new branch."""
        times = start.tangent[: start.problem.n : start.problem.m]
        return float(times[self.impact + 1] - times[self.impact])

    @property
    def _side(self) -> float:
        return self.problem.model.guard(self.limit).side


def added(problem: OrbitProblem, unknowns: Array, flight: int) -> Start | None:
    """Return the start of the branch on which sliding is interrupted, from where it takes no time.

    What leaves sliding does so at rest: two branches cross there, of which one is of interruptions
    that never take any time.
    """
    directions = directions_at(problem.evaluate(unknowns))
    if directions is None:
        return None
    n, m = problem.n, problem.m

    def lasts(along: Array) -> float:
        return float(along[:n:m][(flight + 1) % (n // m)] - along[m * flight])

    along = max(directions, key=lambda one: abs(lasts(one)))
    start = Start(problem, unknowns, along, branching=True, both_ways=False)
    return start if lasts(along) > 0.0 else start.reversed()


def beginnings(problem: OrbitProblem) -> Sequence[Begun]:
    """Return all of a word."""
    return [
        Begun(problem, k, *limit)
        for k, letter in enumerate(problem.word.walls)
        for limit in limits_of(problem.kernels, letter)
    ]


def beginning_of(problem: OrbitProblem, details: Details) -> Begun | None:
    """Return the one at which an event is; None where a flight touches inside."""
    if "impact" not in details:
        return None
    place = details["impact"], details["wall"]
    return next((one for one in beginnings(problem) if (one.impact, one.limit) == place), None)
