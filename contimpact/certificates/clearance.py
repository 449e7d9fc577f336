r"""Gaps along flights in balls, and that flights keep clear of walls.

The time of a flight is cut into cells. In each the gap, or its rate, or its curvature is enclosed;
the gap of a cell is enclosed around the cell's middle,

.. math:: g(t) \in g(m) + g'(m)(t - m) + \tfrac12 g''(C)(t - m)^2 .

A cell is clear if its gap is positive. Where the flight leaves or reaches the wall itself the gap
is zero at the cell's end, and the cell is clear if the rate there runs away from the wall, or does
not run to it and the curvature is positive. Around the event's own touch, where gap and rate are
zero, the curvature has to be positive: the touch is then a strict local minimum.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from flint import arb

from ..models.guards import Guard, same_surface
from ..orbits.problem import OrbitProblem
from ..segments.layout import SECTION
from ..segments.segment import ELSEWHERE
from ..segments.touches import coordinates
from .equations import BallProblem, Balls

# What a flight can meet: the gap coordinates of its guards, in balls.
#
# Guards on one coordinate are looked at together, and those on one surface once. Displacements are
# counted from the guard left where that is on the coordinate, so that the gap to its surface is
# zero exactly when the flight leaves.


@dataclass(frozen=True)
class ReachableGuard:
    """A guard that a flight can meet."""

    guard: Guard
    number: int
    """Its place among the model's guards."""
    left: bool
    reached: bool
    """`left`, `reached`: whether the gap vanishes by itself when the flight leaves, and when it
    ends."""


@dataclass(frozen=True)
class Coordinate:
    """A gap coordinate on a flight."""

    met: Sequence[ReachableGuard]
    since: int | None
    """The guard from which displacements are counted; None for positions."""
    motion: Any
    """``motion(start, dt, values)``: displacement or position, velocity and acceleration."""

    def distance(self, one: ReachableGuard, places: Sequence[Any]) -> Any:
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
    if not word:
        mode = problem.model.first_mode
        return [
            Coordinate([ReachableGuard(g, i, False, False)], None, space.motion(SECTION, g.name))
            for i, g in enumerate(problem.model.WALLS)
            if mode in g.modes and not g.past
        ]
    ends = letters.index(word[flight]), letters.index(word[(flight + 1) % len(word)])
    found = []
    for numbers in coordinates(problem.model).values():
        met = [
            _reachable_guard(problem, i, *ends) for i in numbers if _can_meet(problem, ends[0], i)
        ]
        if not met:
            continue
        own = ends[0] in numbers
        other = None if own else letters[numbers[0]]
        found.append(Coordinate(met, ends[0] if own else None, space.motion(word[flight], other)))
    return found


def walls_met(space: BallProblem, flight: int) -> list[Guard]:
    """Return the guards that a flight can meet."""
    return [one.guard for coordinate in coordinates_of(space, flight) for one in coordinate.met]


def _can_meet(problem: OrbitProblem, left: int, guard: int) -> bool:
    through = problem.model.WALLS[guard].past
    return problem.kernels.passages.watched[left][guard] and not through


def _reachable_guard(problem: OrbitProblem, guard: int, left: int, reached: int) -> ReachableGuard:
    walls = problem.model.WALLS
    own = problem.kernels.passages.arrivals[left][guard] != ELSEWHERE
    return ReachableGuard(walls[guard], guard, own, same_surface(walls[guard], walls[reached]))


DEEPEST = 40
"""How often a flight is cut."""
CUT = 0.4921875
"""Fraction at which a cell is cut: no place at which an event is likely to lie."""


def open_cells(
    whole: tuple[Any, Any], judge: Callable[[Any, Any], bool | None], deepest: int, cut: float = CUT
) -> Iterator[tuple[Any, Any]]:
    """Yield the cells of a range on which nothing is decided, those further left first.

    ``judge(left, right)`` says whether a cell is decided; None for one that is not, and need not be
    cut. A cell is cut `deepest` times at most.
    """
    cells = [(*whole, 0)]
    while cells:
        left, right, depth = cells.pop()
        if decided := judge(left, right):
            continue
        if decided is None or depth == deepest:
            yield left, right
            continue
        middle = left + cut * (right - left)
        middle = middle.mid() if isinstance(middle, arb) else middle
        cells += [(middle, right, depth + 1), (left, middle, depth + 1)]


class ClearanceProof(enum.Enum):
    """What is proven of a flight and a wall."""

    YES = "clear"
    PASSES = "passes"
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class Clearance:
    """What is proven of a flight and a wall, and where it is not: a time after leaving, and the
    enclosure of the gap."""

    what: ClearanceProof
    time: float = 0.0
    gap: str = ""


BEFORE = 0.43
"""The part of an orbit without impacts that is looked at before its touch."""


class Gap:
    """The gap to a wall along a flight of the orbit `z`, or through all periods of an orbit without
    impacts.

    `touch` is when the flight touches the wall, its event. `beside` says whether the flight is at
    the wall when it leaves, and when it ends, because a flight of no duration comes before it, or
    after it.
    """

    def __init__(
        self,
        space: BallProblem,
        z: Balls,
        flight: int,
        wall: str,
        touch: Any = None,
        beside: tuple[bool, bool] = (False, False),
    ) -> None:
        self.beside = beside
        rows, self.values = space.impacts(z), space.values(z)
        if rows:
            self.start, self.arrival = rows[flight], rows[flight + 1]
            self.begin, self.late = self.start[0], None
            self.duration = self.arrival[0] - self.begin
        else:
            self.start, self.duration = list(z[: space.problem.m]), space.span(z)
            begin = arb(0) if touch is None else (touch - BEFORE * self.duration).mid()
            self.begin = self.late = begin
        self.touch = None if touch is None else touch - self.begin
        found = ((c, one) for c in coordinates_of(space, flight) for one in c.met)
        self.coordinate, self.met = next((c, one) for c, one in found if one.guard.name == wall)
        self.side = self.met.guard.side
        self.distance = self.coordinate.distance(self.met, space.setup(self.values).walls)

    def at(self, dt: Any) -> tuple[Any, Any, Any]:
        """Return gap, rate and curvature at a time, or on a cell of times."""
        dt = dt if self.late is None else self.late + dt
        x, speed, acceleration = self.coordinate.motion(self.start, dt, self.values)
        return self.side * (self.distance - x), -self.side * speed, -self.side * acceleration

    def proven(self) -> Clearance:
        """Return whether the flight keeps clear of the wall."""
        if not self.duration > 0:
            return Clearance(ClearanceProof.UNDECIDED, 0.0, f"duration {self.duration.str(6)}")
        found: tuple[ClearanceProof, Any] = ClearanceProof.YES, None

        def judge(left: Any, right: Any) -> bool | None:
            nonlocal found
            found = self._cell(left, right)
            return None if found[0] is ClearanceProof.PASSES else found[0] is ClearanceProof.YES

        for left, right in open_cells((arb(0), self.duration.upper()), judge, DEEPEST):
            return Clearance(found[0], float((left + CUT * (right - left)).mid()), found[1].str(6))
        return Clearance(ClearanceProof.YES)

    def _cell(self, left: Any, right: Any) -> tuple[ClearanceProof, Any]:
        cell = left.union(right)
        middle = cell.mid()
        _, rate, curvature = self.at(cell)
        gap, slope, _ = self.at(middle)
        change = cell - middle
        whole = gap + slope * change + curvature * change * change / 2
        begins, ends = left == 0, right >= self.duration.lower()
        first, last = self.met.left and begins, self.met.reached and ends
        touched = self.touch is not None and cell.overlaps(self.touch)
        if whole > 0 or (first and not touched and self._leaves(rate, curvature)):
            return ClearanceProof.YES, whole
        if last and not touched and self._arrives(rate, curvature):
            return ClearanceProof.YES, whole
        before, behind = self.beside
        if not touched and ((before and begins and rate > 0) or (behind and ends and rate < 0)):
            return ClearanceProof.YES, whole
        if touched and cell.contains(self.touch) and curvature > 0:
            return ClearanceProof.YES, whole
        passes = gap < 0 and middle > 0 and middle < self.duration
        return (ClearanceProof.PASSES if passes else ClearanceProof.UNDECIDED), whole

    def _leaves(self, rate: Any, curvature: Any) -> bool:
        """Whether the gap, zero at the start of a cell, is positive behind it."""
        at_rest = self.start[1] == 0  # an impact at rest leaves at rest
        return bool(rate > 0 or (curvature > 0 and (at_rest or self.at(arb(0))[1] >= 0)))

    def _arrives(self, rate: Any, curvature: Any) -> bool:
        """Whether the gap, zero at the end of the flight, is positive before it."""
        return bool(rate < 0 or (curvature > 0 and -self.side * self.arrival[1] <= 0))
