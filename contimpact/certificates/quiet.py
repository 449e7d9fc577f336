"""Orbits without impacts in ball arithmetic: their one flight, and the gaps along it."""

from __future__ import annotations

from typing import Any

from flint import arb

from ..bifurcations.kind import Details, System
from ..models.guards import Guard
from ..orbits.problem import Array, OrbitProblem
from ..segments.arithmetic import evaluate_in
from ..segments.ball_flow import number
from ..segments.layout import SECTION
from .clearance import Gap
from .equations import BallProblem, Balls, Flight
from .gaps import Met, walls_met

BEFORE = 0.43
"""The part of the orbit that is looked at before its touch."""


def ball_problem(problem: OrbitProblem, bits: int) -> BallProblem:
    """Return the equations of a word in balls, `0` among them."""
    return (BallProblem if problem.word.walls else QuietBalls)(problem, bits)


class QuietBalls(BallProblem):
    """The equations of orbits without impacts; see `contimpact.orbits.quiet`.

    The unknowns are the state at the time zero and the followed parameter.
    """

    def impacts(self, z: Any) -> list[Balls]:
        """Return the impacts: none."""
        return []

    def flights(self, z: Any) -> list[Flight]:
        """Return residual and blocks of the flight through all periods."""
        state = list(z[: self.problem.m])
        rows = self._segments[0](state, state, self.values(z))
        residual, first, last, free = ([number(x) for x in row] for row in rows)
        return [(residual, first, last, free)]

    def grazing(self, z: Array, details: Details) -> System:
        """F = 0, and the orbit touches a guard with zero velocity."""
        m, n = self.problem.m, self.problem.n
        reach = self.problem.kernels.segment(SECTION, details["wall"]).over(self.arithmetic)

        def system(x: list[Any]) -> list[Any]:
            touch = [x[n + 1], arb(0), *x[n + 2 :]]
            rows = reach(x[:m], touch, self.values(x[: n + 1]))[0]
            return [*self.residual(x[: n + 1]), *map(number, rows)]

        return system, [float(details["touch_time"]), *[0.0] * (m - 2)]


class QuietGap(Gap):
    """The gap to a guard through all periods of an orbit without impacts; arguments as of `Gap`."""

    def __init__(self, space: BallProblem, z: Balls, wall: str, touch: Any = None) -> None:
        problem = space.problem
        place = problem.model.letters.index(wall)
        self.met = Met(problem.model.WALLS[place], place, False, False)
        self.side, self.beside = self.met.guard.side, (False, False)
        self.values, self.state = space.values(z), list(z[: problem.m])
        self.distance = space.setup(self.values).walls[place]
        self.along = evaluate_in(problem.kernels.since(wall), space.arithmetic)
        self.duration = space.span(z)
        self.begin = arb(0) if touch is None else (touch - BEFORE * self.duration).mid()
        self.start, self.touch = [self.begin], None if touch is None else touch - self.begin

    def at(self, dt: Any) -> tuple[Any, Any, Any]:
        """Return gap, rate and curvature at a time, or on a cell of times."""
        x, speed, acceleration = self.along(*self.state, self.begin + dt, *self.values)
        return self.side * (self.distance - x), -self.side * speed, -self.side * acceleration


def gap_of(
    space: BallProblem,
    z: Balls,
    flight: int,
    wall: str,
    touch: Any = None,
    beside: tuple[bool, bool] = (False, False),
) -> Gap:
    """Return the gap to a guard along a flight; parameters are those of `Gap`."""
    if space.problem.word.walls:
        return Gap(space, z, flight, wall, touch, beside)
    return QuietGap(space, z, wall, touch)


def guards_met(space: BallProblem, flight: int) -> list[Guard]:
    """Return the guards that a flight can meet, or an orbit without impacts."""
    model = space.problem.model
    if space.problem.word.walls:
        return walls_met(space, flight)
    return [g for g in model.WALLS if model.first_mode in g.modes and not g.past]
