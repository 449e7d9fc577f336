"""What is proven of the orbit that carries an event: whether it is physical, and how stable.

The event's own touch, impact and multipliers are set aside, as its kind says.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import acb_mat, arb, arb_mat

from ..bifurcations.kind import Kind
from ..orbits.problem import OrbitProblem
from ..segments.ball_flow import number
from ..segments.balls import turns
from ..segments.layout import SECTION
from . import winding
from .clearance import Clear
from .equations import BallProblem, Balls, Flight
from .krawczyk import proven
from .limits import Limit, limits
from .merging import Remains, remains_of, takes_no_time
from .quiet import gap_of, guards_met

ANYWHERE = (1.0, -1.0, 1j, -1j)
"""Multipliers of which an event that is one of a multiplier's sets one aside, at least."""

ON_CIRCLE = "a multiplier may lie on the unit circle"

Claim = tuple[Any, str]
"""What is proven, or None and what could not be decided."""


@dataclass(frozen=True)
class Orbit:
    """An orbit at its event.

    Attributes
    ----------
    space : BallProblem
    z : list of arb
        Its unknowns.
    kind : Kind
    details : mapping
        Where the event is, ``touch_time`` as an ``arb``.
    at_rest : tuple of int
        Impacts whose velocity is zero.
    """

    space: BallProblem
    z: Balls
    kind: Kind
    details: Mapping[str, Any]
    at_rest: tuple[int, ...] = ()

    # Stability.

    def unstable(self) -> Claim:
        """Return how many multipliers lie outside the unit circle, those of the event set aside."""
        try:
            flights = self._flights()
        except (ValueError, ZeroDivisionError) as error:
            return None, str(error)
        if self._lasts:
            counted = winding.outside(flights)
            return (None, ON_CIRCLE) if counted is None else (counted - 1, "")
        try:
            found = (_outside_of_two if self.space.problem.m == 2 else _outside)(self, flights)
        except (ValueError, ZeroDivisionError) as error:
            found = None, f"the multipliers are not isolated ({error})"
        if found[0] is None and not self.critical(ANYWHERE):
            counted = winding.outside(flights)
            found = found if counted is None else (counted, "")
        return found

    def critical(self, middles: Sequence[complex]) -> list[int]:
        """Return the places of the multipliers that belong to the event."""
        return [] if self._remains else self.kind.critical(np.array(middles))

    @functools.cached_property
    def _remains(self) -> Remains | None:
        return remains_of(self.space.problem, self.z, self.details)

    @property
    def _lasts(self) -> bool:
        """Whether the event is that a contact which lasts begins or ends at rest: a multiplier is
        infinite, and the event's."""
        return {"impact", "flight"} <= set(self.details) and "touch_time" not in self.details

    def _flights(self) -> list[Flight]:
        """The flights that tell the multipliers; those of the word without impacts at rest."""
        problem, remains = self.space.problem, self._remains
        if remains is None:
            return self.space.flights(self.z)
        lasting = [k for k in remains.brief if not self._vanishing(k)]
        if lasting:
            raise ValueError(f"flight {lasting[0]} is not proven to take no time")
        if not remains.word.walls:
            return [self._quiet_flight(remains.dropped)]
        shorter = OrbitProblem(problem.model, remains.word, problem.kernels)
        rows = self.space.impacts(self.z)[:-1]
        kept = [x for k, row in enumerate(rows) if k not in remains.dropped for x in row]
        return BallProblem(shorter, self.space.bits).flights([*kept, self.z[-1]])

    def _quiet_flight(self, dropped: Sequence[int]) -> Flight:
        """The flight of the orbit without impacts, from where it is at the time zero.

        The impact at rest changes nothing, so that the orbit passes through its state; a motion
        through a state is the only one, and leads from one state at the time zero.
        """
        space, problem = self.space, self.space.problem
        own = {k: problem.model.guard(problem.word.walls[k]) for k in dropped}
        first = problem.model.first_mode
        met = [k for k, guard in own.items() if first in guard.modes]
        if not met or own[dropped[-1]].next_mode != first:
            raise ValueError("those of the orbit without impacts are not known")
        impact, guard = met[0], own[met[0]]
        values, (time, _, *others) = space.values(self.z), space.impacts(self.z)[impact]
        period = space.setup(values).period
        touch = [time - turns(time, period) * period, arb(0), *others]
        reach = problem.kernels.segment(SECTION, guard.name).over(space.arithmetic)
        found = proven(
            space, lambda x: [number(r) for r in reach(x, touch, values)[0]], [0.0] * problem.m
        )
        if found is None:
            raise ValueError("the state of the orbit without impacts is not isolated")
        return space.quiet_flight(found[1], values)

    # Physicality.

    def physical(self) -> Claim:
        """Return whether the orbit is physical but for the event."""
        if why := self._unphysical():
            return False, why
        for k, (row, later) in enumerate(self._pairs()):
            if not later[0] - row[0] > 0 and not self._vanishing(k):
                return None, f"flight {k} lasts {(later[0] - row[0]).str(6)}"
        for k, speed in self._speeds():
            if not speed > 0:
                return None, f"impact {k} has the velocity {speed.str(6)} towards its wall"
        for one, margin in self._margins():
            if not margin > 0:
                return None, f"impact {one.impact} is {margin.str(6)} beyond the limit {one.wall}"
        return self._clear()

    def _pairs(self) -> list[tuple[Balls, Balls]]:
        return list(itertools.pairwise(self.space.impacts(self.z)))

    def _vanishing(self, flight: int) -> bool:
        """Whether a flight takes no time at the event."""
        if "impact" not in self.details:
            return self.details.get("flight") == flight and "touch_time" not in self.details
        if self._remains is None or flight not in self._remains.brief:
            return False
        if flight in self.space.problem.excursions and flight == self.details["impact"]:
            return True
        return takes_no_time(self.space, self.z, flight)

    def _speeds(self) -> list[tuple[int, Any]]:
        """Velocities towards the walls, those of impacts at rest set aside, and of those that the
        orbit without flights of no duration does not have."""
        problem = self.space.problem
        aside = {*self.at_rest, *(self._remains.dropped if self._remains else ())}
        sides = {wall.name: wall.side for wall in problem.model.WALLS}
        return [
            (k, sides[wall] * self.z[problem.m * k + 1])
            for k, wall in enumerate(problem.word.walls)
            if k not in aside
        ]

    def _unphysical(self) -> str:
        """Why the orbit is proven to be unphysical, if it is."""
        for k, (row, later) in enumerate(self._pairs()):
            if later[0] - row[0] < 0 and not self._vanishing(k):
                return f"flight {k} lasts {(later[0] - row[0]).str(6)}"
        for k, speed in self._speeds():
            if speed < 0:
                return f"impact {k} runs the wrong way"
        for one, margin in self._margins():
            if margin < 0:
                return f"impact {one.impact} leads through, though {one.sliding} would slide"
        return self._deepest()

    def _margins(self) -> list[tuple[Limit, Any]]:
        """How far beyond their limits impacts are that lead through a surface on which others
        slide, those at the ends of flights that take no time set aside."""
        problem = self.space.problem
        beyond = [one for one in limits(problem) if one.sign < 0]
        count = len(problem.word)
        return [
            (one, one.margin(self.space, self.z))
            for one in beyond
            if not (self._vanishing(one.impact) or self._vanishing((one.impact - 1) % count))
        ]

    def _deepest(self) -> str:
        """Where a flight passes a wall, at the nearest touches that doubles find."""
        space, problem = self.space, self.space.problem
        here = problem.evaluate(np.array([float(x.mid()) for x in self.z]))
        for touch in (t for flight in here.gaps for t in flight.touches if t is not None):
            if touch.gap < 0 and not self._own(touch.flight, touch.wall):
                gap = gap_of(space, self.z, touch.flight, touch.wall)
                time = (arb(touch.time) - gap.start[0]).mid()
                if time > 0 and time < gap.duration and gap.at(time)[0] < 0:
                    return f"flight {touch.flight} passes wall {touch.wall}"
        return ""

    def _own(self, flight: int, wall: str) -> bool:
        """Whether a touch there is the event."""
        where = self.details.get("flight"), self.details.get("wall")
        return "touch_time" in self.details and where == (flight, wall)

    def _clear(self) -> Claim:
        """Whether all flights keep clear of all walls."""
        for k in range(max(1, len(self.space.problem.word))):
            met = () if self._vanishing(k) else guards_met(self.space, k)
            for wall in met:
                touch = self.details["touch_time"] if self._own(k, wall.name) else None
                beside = self._beside(k, wall.name)
                found = gap_of(self.space, self.z, k, wall.name, touch, beside).proven()
                if found.what is not Clear.YES:
                    where = f"flight {k}, wall {wall.name}, {found.time:.6g} after it leaves"
                    passes = found.what is Clear.PASSES
                    return False if passes else None, f"{where}: the gap is {found.gap}"
        return True, ""

    def _beside(self, flight: int, wall: str) -> tuple[bool, bool]:
        """Whether a flight of no duration comes from a wall before it, or leads to it after it."""
        word = self.space.problem.word.walls
        if not word:
            return False, False
        before, behind = (flight - 1) % len(word), (flight + 1) % len(word)
        guards = self.space.problem.model.WALLS
        left = next(guard for guard in guards if guard.name == word[before])
        return (
            self._vanishing(before) and wall in (left.name, left.past),
            self._vanishing(behind) and word[(behind + 1) % len(word)] == wall,
        )

    def touches(self) -> Claim:
        """Return whether the event's touch is a strict local minimum of the gap."""
        if "touch_time" not in self.details:
            return True, ""
        gap = gap_of(self.space, self.z, self.details["flight"], self.details["wall"])
        curvature = gap.at(self.details["touch_time"] - gap.start[0])[2]
        within = self.details["touch_time"] - gap.start[0]
        ends = bool(self.space.problem.word.walls)
        if ends and not (within > 0 and within < gap.duration):
            return None, f"the touch comes {within.str(6)} after the flight leaves"
        return (True, "") if curvature > 0 else (None, f"the gap bends by {curvature.str(6)}")


def characteristic(flights: Sequence[Flight]) -> tuple[Any, Any, Any]:
    r"""Return b, c, a of b mu^2 - c mu + a, whose roots are the multipliers, for m = 2.

    .. math:: b = \prod \det B_k, \quad a = \prod \det A_k, \quad
              c = \operatorname{tr} \prod (-\operatorname{adj} B_k \, A_k) .

    Nothing is divided by: b vanishes with the velocity of an impact. Numbers may be series.
    """
    b, a = arb(1), arb(1)
    total: Any = ((arb(1), arb(0)), (arb(0), arb(1)))
    for _, (a11, a12, a21, a22), (b11, b12, b21, b22), _ in flights:
        rows = (
            (b12 * a21 - b22 * a11, b12 * a22 - b22 * a12),
            (b21 * a11 - b11 * a21, b21 * a12 - b11 * a22),
        )
        (p, q), (r, s) = total
        total = tuple((x * p + y * r, x * q + y * s) for x, y in rows)
        b, a = b * (b11 * b22 - b12 * b21), a * (a11 * a22 - a12 * a21)
    return b, total[0][0] + total[1][1], a


def _outside_of_two(orbit: Orbit, flights: Sequence[Flight]) -> Claim:
    """How many of two multipliers lie outside, from the signs of their polynomial at 1 and -1.

    Where they differ, one does; where they are the same, both or none, as their product tells.
    """
    b, c, a = characteristic(flights)
    middles = np.roots([float(x.mid()) for x in (b, -c, a)])
    own = len(orbit.critical(middles.tolist())) if len(middles) == 2 else 0
    inside, outside = abs(a) < abs(b), abs(a) > abs(b)
    if own == 2 and not abs(c) < 2 * abs(b):
        return None, "the pair of multipliers may be real"
    if own == 2:
        return 0, ""
    if own == 0:
        at_one, at_minus_one = b - c + a, b + c + a
        if at_one * at_minus_one < 0:
            return 1, ""
        inside, outside = (found and at_one * at_minus_one > 0 for found in (inside, outside))
    if not (inside or outside):
        return None, f"the polynomial of the multipliers is {b.str(6)}, {c.str(6)}, {a.str(6)}"
    return (2 - own if outside else 0), ""


def _outside(orbit: Orbit, flights: Sequence[Flight]) -> Claim:
    """The same of more multipliers, from enclosures of all of them."""
    found = multipliers(flights)
    own = orbit.critical([complex(float(mu.real.mid()), float(mu.imag.mid())) for mu in found])
    if len(own) == 2 and any(found[i].imag.contains(0) for i in own):
        return None, "the pair of multipliers may be real"
    sizes = [abs(mu) for i, mu in enumerate(found) if i not in own]
    if near := next((s for s in sizes if not (s < 1 or s > 1)), None):
        return None, f"a multiplier has the size {near.str(6)}"
    return sum(1 for s in sizes if s > 1), ""


def multipliers(flights: Sequence[Flight]) -> list[Any]:
    """Return enclosures of all multipliers, ``acb``, each of one.

    Raises
    ------
    ValueError, ZeroDivisionError
        If they are not isolated, or an impact's velocity may be zero.
    """
    m = len(flights[0][0])
    total = arb_mat([[int(i == j) for j in range(m)] for i in range(m)])
    for _, start, end, _ in flights:
        total = -(arb_mat(m, m, end).inv() * arb_mat(m, m, start)) * total
    found: list[Any] = acb_mat(total).eig()
    return found
