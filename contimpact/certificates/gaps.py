"""What a flight can meet: the gap coordinates of its guards, in balls.

Guards on one coordinate are looked at together, and those on one surface once. Displacements are
counted from the guard left where that is on the coordinate, so that the gap to its surface is zero
exactly when the flight leaves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..models.guards import Guard, same_surface
from ..orbits.problem import OrbitProblem
from ..segments.segment import ELSEWHERE
from ..segments.touches import coordinates
from .equations import BallProblem


@dataclass(frozen=True)
class Met:
    """A guard that a flight can meet.

    Attributes
    ----------
    guard : Guard
    number : int
        Its place among the model's guards.
    left, reached : bool
        Whether the gap vanishes by itself when the flight leaves, and when it ends.
    """

    guard: Guard
    number: int
    left: bool
    reached: bool


@dataclass(frozen=True)
class Coordinate:
    """A gap coordinate on a flight.

    Attributes
    ----------
    met : sequence of Met
    since : int or None
        The guard from which displacements are counted; None for positions.
    motion : callable ``motion(start, dt, values)``
        Displacement or position, velocity and acceleration.
    """

    met: Sequence[Met]
    since: int | None
    motion: Any

    def distance(self, one: Met, places: Sequence[Any]) -> Any:
        """Return how far a guard is from where displacements are counted."""
        if one.left:
            return 0
        here = 0 if self.since is None else places[self.since]
        return places[one.number] - here


def coordinates_of(space: BallProblem, flight: int) -> list[Coordinate]:
    """Return the gap coordinates of the guards that a flight can meet."""
    problem = space.problem
    letters = [guard.name for guard in problem.model.WALLS]
    word = problem.word.walls
    ends = letters.index(word[flight]), letters.index(word[(flight + 1) % len(word)])
    found = []
    for numbers in coordinates(problem.model).values():
        met = [_met(problem, i, *ends) for i in numbers if _meets(problem, ends[0], i)]
        if not met:
            continue
        own = ends[0] in numbers
        other = None if own else letters[numbers[0]]
        found.append(Coordinate(met, ends[0] if own else None, space.motion(word[flight], other)))
    return found


def walls_met(space: BallProblem, flight: int) -> list[Guard]:
    """Return the guards that a flight can meet."""
    return [one.guard for coordinate in coordinates_of(space, flight) for one in coordinate.met]


def met_by(space: BallProblem, flight: int, wall: str) -> tuple[Coordinate, Met]:
    """Return a guard that a flight can meet, and its gap coordinate."""
    found = ((c, one) for c in coordinates_of(space, flight) for one in c.met)
    return next((c, one) for c, one in found if one.guard.name == wall)


def _meets(problem: OrbitProblem, left: int, guard: int) -> bool:
    through = problem.model.WALLS[guard].past
    return problem.kernels.passages.watched[left][guard] and not through


def _met(problem: OrbitProblem, guard: int, left: int, reached: int) -> Met:
    walls = problem.model.WALLS
    own = problem.kernels.passages.arrivals[left][guard] != ELSEWHERE
    return Met(walls[guard], guard, own, same_surface(walls[guard], walls[reached]))
