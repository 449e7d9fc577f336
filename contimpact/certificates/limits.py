"""Where the motion begins after an impact, in balls; see `contimpact.segments.touches`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from flint import arb

from ..orbits.problem import OrbitProblem
from ..segments.touches import limits_of, on_surface
from .equations import BallProblem, Balls


@dataclass(frozen=True)
class Limit:
    """A limit that decides which of the guards on a surface an impact meets.

    Attributes
    ----------
    impact : int
    sliding, wall : str
        The guard at which the motion would begin, and the one that limits it.
    sign : float
        +1 where it has to begin within the limit, -1 where beyond.
    """

    impact: int
    sliding: str
    wall: str
    sign: float

    def margin(self, space: BallProblem, z: Balls) -> Any:
        """Return how far on the right side of the limit the motion begins, or on its surface how
        fast it goes there."""
        guards, values = space.problem.model.WALLS, space.values(z)
        place = next(i for i, guard in enumerate(guards) if guard.name == self.wall)
        motion = space.motion(self.sliding, self.wall)
        begin, rate, _ = motion(space.impacts(z)[self.impact], arb(0), values)
        on_it = on_surface(space.problem.kernels, self.sliding, self.wall)
        gap = -rate if on_it else space.setup(values).walls[place] - begin
        return self.sign * guards[place].side * gap


def limits(problem: OrbitProblem) -> list[Limit]:
    """Return those of all impacts of a word."""
    return [
        Limit(impact, *one)
        for impact, letter in enumerate(problem.word.walls)
        for one in limits_of(problem.kernels, letter)
    ]
