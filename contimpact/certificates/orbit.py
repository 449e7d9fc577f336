"""What is proven of an orbit at an event: its flights, its multipliers, its physicality.

The event's own touch, impact and multipliers are set aside, as its kind says.
"""

from __future__ import annotations

import enum
import functools
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from flint import acb, acb_mat, acb_poly, arb, arb_mat, arb_series

from ..bifurcations.equations import cyclic_matrix
from ..bifurcations.kind import Kind
from ..bifurcations.sliding import (
    CROSSING,
    SWITCHING,
    letter_of_merger,
    other_end_of,
    replace_letters,
    sliding_kind_of_zero_duration,
    sliding_kind_of_zero_velocity,
)
from ..bifurcations.zero_velocity import remove_impact
from ..models.guards import Guard, Word, orders_of, pivot, same_surface
from ..orbits.problem import OrbitProblem
from ..orbits.quiet import problem_of
from ..segments.balls import number, turns
from ..segments.kernel import SECTION
from ..segments.segment import ELSEWHERE
from ..segments.touches import begins_on_surface, coordinates, limits_of
from .equations import BallProblem, Balls, Flight, identity, images_of, krawczyk, prove_zero

NEARBY = 2.0**-40
"""Half the width, beside its size, of a box in which an orbit and its image are the same."""

# Where the motion begins after an impact, in balls; see `contimpact.segments.touches`.


@dataclass(frozen=True)
class Limit:
    """A limit that decides which of the guards on a surface an impact meets."""

    impact: int
    sliding: str
    wall: str
    """`sliding`, `wall`: the guard at which the motion would begin, and the one that limits it."""
    sign: float
    """+1 where it has to begin within the limit, -1 where beyond."""

    def margin(self, space: BallProblem, z: Balls) -> Any:
        """Return how far on the right side of the limit the motion begins, or on its surface how
        fast it goes there."""
        model, values = space.problem.model, space.values(z)
        motion = space.motion(self.sliding, self.wall)
        begin, rate, _ = motion(space.impacts(z)[self.impact], arb(0), values)
        on_it = begins_on_surface(space.problem.kernels, self.sliding, self.wall)
        places = space.setup(values).walls
        gap = -rate if on_it else places[model.letters.index(self.wall)] - begin
        return self.sign * model.guard(self.wall).side * gap


def limits(problem: OrbitProblem) -> list[Limit]:
    """Return those of all impacts of a word."""
    return [
        Limit(impact, *one)
        for impact, letter in enumerate(problem.word.walls)
        for one in limits_of(problem.kernels, letter)
    ]


# How many multipliers lie outside the unit circle, counted along the circle.
#
# The multipliers are the roots of :math:`p(\mu) = \det C(\mu)`, the cyclic matrix with its last
# coupling multiplied by mu: a polynomial whose degree is at most that of a block. If p has no zero
# on the circle, it winds around zero as many times as there are roots inside (the argument
# principle). Where an impact comes to rest the highest coefficient vanishes, and may only be known
# to be small: a multiplier is infinite there, or as good as that, and counts as one outside.

ARCS = 16
DEEPEST = 12
"""Into how many arcs the circle is cut first, and how often each of these."""


def count_outside(flights: Sequence[Flight]) -> int | None:
    """Return how many multipliers lie outside; None if one may lie on the circle."""
    p = characteristic_polynomial(flights)
    slope = p.derivative()
    total = arb(0)

    def judge(start: Any, end: Any) -> bool:
        nonlocal total
        arc, middle = _circle_point(start.union(end)), _circle_point((start + end) / 2)
        if (p(middle) + slope(arc) * (arc - middle)).contains(0):
            return False
        total += (p(_circle_point(end)) / p(_circle_point(start))).arg()
        return True

    for start, end in itertools.pairwise(arb(2 * k) / ARCS for k in range(ARCS + 1)):
        if next(open_cells((start, end), judge, DEEPEST, 0.5), None) is not None:
            return None
    inside = (total / (2 * arb.pi())).unique_fmpz()
    return None if inside is None else len(flights[0][0]) - int(inside)


def _circle_point(half_turns: Any) -> Any:
    """A number of the circle, by its angle over pi."""
    angle = half_turns * arb.pi()
    return acb(angle.cos(), angle.sin())


def characteristic_polynomial(flights: Sequence[Flight]) -> Any:
    """Return p from its values at roots of unity."""
    count = len(flights[0][0]) + 1
    roots = [_circle_point(arb(2 * k) / count) for k in range(count)]
    values = [acb_mat(cyclic_matrix(flights, mu, acb(0))).det() for mu in roots]
    return acb_poly(
        [
            sum((v * roots[-j * k % count] for k, v in enumerate(values)), acb(0)) / count
            for j in range(count)
        ]
    )


# What is left of an orbit at an event where an impact comes to rest, or a flight takes no time.
#
# Multipliers at such an event are those of the word without what vanishes, as
# `contimpact.bifurcations.sliding` says. Which flights take no time is seen in doubles, and proven
# here: by the equations of the event, or as follows. Let a flight begin on the surface that it
# reaches. If it begins, or ends, at rest there, and the acceleration has one sign all along, it
# takes
# no time. If the jump of an impact at rest leads onto that surface, it is the velocity that has to
# have one sign. (Guards with `past` change a velocity of zero, too: nothing leaves them at rest.)


@dataclass(frozen=True)
class Remains:
    """A word, possibly that without impacts, and what is not in it."""

    word: Word
    dropped: tuple[int, ...]
    """Impacts of the longer word."""
    brief: tuple[int, ...]
    """Its flights that take no time."""


def remains_of(problem: OrbitProblem, z: Balls, details: Mapping[str, Any]) -> Remains | None:
    """Return what is left at an event; None where nothing vanishes, as where a contact that lasts
    begins or ends at rest, or without an impact at rest there is no such orbit."""
    impact, flight = details.get("impact"), details.get("flight")
    if "touch_time" in details or (impact is None) == (flight is None):
        return None
    unknowns = np.array([float(x.mid()) for x in z])
    if impact is None:
        return _without_flight(problem, unknowns, details["flight"])
    if sliding_kind_of_zero_velocity(problem, unknowns, impact) == SWITCHING:
        return _merged_remains(problem, (impact - 1) % len(problem.word))
    if remove_impact(problem.evaluate(unknowns), details) is None:
        return None
    return _remains_without(problem, unknowns, impact)


def _without_flight(problem: OrbitProblem, unknowns: Any, flight: int) -> Remains | None:
    found = sliding_kind_of_zero_duration(problem, flight)
    if found in (CROSSING, SWITCHING):
        return _merged_remains(problem, flight)
    return None if found is None else _remains_without(problem, unknowns, flight)


def _remains_without(problem: OrbitProblem, unknowns: Any, impact: int) -> Remains:
    dropped = other_end_of(problem.evaluate(unknowns), impact)
    return Remains(problem.word.drop(*dropped), dropped, dropped[:-1])


def _merged_remains(problem: OrbitProblem, flight: int) -> Remains | None:
    letter, other = letter_of_merger(problem, flight), (flight + 1) % len(problem.word)
    if letter is None:
        return None
    return Remains(replace_letters(problem.word, flight, letter, 2), (other,), (flight,))


def takes_no_time(space: BallProblem, z: Balls, flight: int) -> bool:
    """Return whether a flight with an impact at rest is proven to take no time."""
    problem = space.problem
    word, letters = problem.word.walls, problem.model.letters
    ends = word[flight], word[(flight + 1) % len(word)]
    left, reached = map(letters.index, ends)
    start, end = (space.impacts(z)[flight + i] for i in (0, 1))
    duration = end[0] - start[0]
    if not duration.contains(0):
        return False
    motion = space.motion(ends[0], None if left == reached else ends[1])
    _, speed, acceleration = motion(start, duration.union(arb(0)), space.values(z))
    passages = problem.kernels.passages
    leaves_at_rest = bool(start[1] == 0) and not problem.model.WALLS[left].past
    if passages.arrivals[left][reached] != ELSEWHERE:
        return (leaves_at_rest or bool(end[1] == 0)) and not acceleration.contains(0)
    return leaves_at_rest and passages.meets_at_rest(left, reached) and not speed.contains(0)


def stops_at_once(space: BallProblem, z: Balls, flight: int) -> bool:
    """Return whether a flight that takes no time is proven to begin with an impact at rest.

    The jump of an impact at rest leads onto the surface reached; that of no other velocity does if
    it moves the gap coordinate with the velocity.
    """
    problem = space.problem
    ends = [problem.word.walls[k % len(problem.word)] for k in (flight, flight + 1)]
    left, reached = map(problem.model.letters.index, ends)
    passages, start = problem.kernels.passages, space.impacts(z)[flight]
    if not (passages.onto and passages.onto[left][reached]) or not start[1].contains(0):
        return False
    faster = [start[0], arb_series([start[1].union(arb(0)), 1], prec=2), *start[2:]]
    begin = space.motion(*ends)(faster, arb(0), space.values(z))[0]
    return isinstance(begin, arb_series) and not begin[1].contains(0)


ANYWHERE = (1.0, -1.0, 1j, -1j)
"""Multipliers of which an event that is one of a multiplier's sets one aside, at least."""

ON_CIRCLE = "a multiplier may lie on the unit circle"

Claim = tuple[Any, str]
"""Proven statement, or None and the question that could not be decided."""


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

    def claims(self) -> Iterator[tuple[str, Claim]]:
        """Yield what is proven of it by the name of the clause, one after the other."""
        yield "touch", self.touches()
        yield "stability", self.unstable()
        yield "physicality", self.physical()

    # Stability.

    def unstable(self) -> Claim:
        """Return how many multipliers lie outside the unit circle, those of the event set aside."""
        try:
            flights = self._flights()
        except (ValueError, ZeroDivisionError) as error:
            return None, str(error)
        if self._stays:
            counted = count_outside(flights)
            return (None, ON_CIRCLE) if counted is None else (counted - 1, "")
        try:
            found = _count_outside(self, flights)
        except (ValueError, ZeroDivisionError) as error:
            found = None, f"the multipliers are not isolated ({error})"
        if found[0] is None and not self.critical(ANYWHERE):
            counted = count_outside(flights)
            found = found if counted is None else (counted, "")
        return found

    def critical(self, middles: Sequence[complex]) -> list[int]:
        """Return the places of the multipliers that belong to the event."""
        return [] if self._remains else self.kind.critical(np.array(middles))

    @functools.cached_property
    def _remains(self) -> Remains | None:
        return remains_of(self.space.problem, self.z, self.details)

    @property
    def _stays(self) -> bool:
        """Whether an impact at rest does not vanish, that of a contact which lasts or a jump: a
        multiplier is infinite, and the event's."""
        at_rest = "impact" in self.details and "touch_time" not in self.details
        return at_rest and self._remains is None

    def _flights(self) -> list[Flight]:
        """The flights that tell the multipliers; those of the word without impacts at rest."""
        problem, remains = self.space.problem, self._remains
        if remains is None:
            return self.space.flights(self.z)
        lasting = [k for k in remains.brief if not self._vanishing(k)]
        if lasting:
            raise ValueError(f"flight {lasting[0] + 1} is not proven to take no time")
        if not remains.word.walls:
            return [self._quiet_flight(remains.dropped)]
        shorter = OrbitProblem(problem.model, remains.word, problem.kernels)
        rows = self.space.impacts(self.z)[:-1]
        kept = [x for k, row in enumerate(rows) if k not in remains.dropped for x in row]
        return BallProblem(shorter, self.space.bits).flights([*kept, self.z[-1]])

    def _quiet_flight(self, dropped: Sequence[int]) -> Flight:
        """The flight of the orbit without impacts, from where it is at the time zero.

        The impact at rest changes nothing, so that the orbit passes through its state; a motion
        through a state is the only one, and leads from one state at the time zero. Of numbers that
        a law of first order leaves out of the state, it is known that they close.
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
        closed = problem_of(problem.model, Word("", problem.word.period), problem.kernels)
        quiet, size = BallProblem(closed, space.bits), problem.m // 2
        place, orders = pivot(guard.row(size)), orders_of(problem.model.MODES, first, size)
        order = [place, *(i for i in range(size) if i != place)]
        missing = {2 * k + j: 2 * i + j for k, i in enumerate(order) for j in range(orders[i], 2)}

        def system(x: Balls) -> Balls:
            rows = [number(r) for r in reach(x, touch, values)[0]]
            for row, own in missing.items():
                rows[row] = quiet.flights([*x, self.z[-1]])[0][0][own]
            return rows

        found = prove_zero(space, system, [0.0] * problem.m)
        if found is None:
            raise ValueError("the state of the orbit without impacts is not isolated")
        (flight,) = quiet.flights([*found[1], self.z[-1]])
        if not all(x.contains(0) for x in flight[0]):
            raise ArithmeticError("the orbit without impacts is not closed")
        return flight

    # Physicality.

    def physical(self) -> Claim:
        """Return whether the orbit is physical but for the event."""
        if why := self.why_unphysical():
            return False, why
        open_ones = (text for value, text, _ in self._conditions if not value > 0)
        text = next(open_ones, None)
        return self._clear() if text is None else (None, text)

    @functools.cached_property
    def _conditions(self) -> list[tuple[Any, str, str]]:
        """What has to be positive on a physical orbit, besides gaps, and what is said where that is
        open, and where it is negative.

        Left out are flights that take no time at the event, velocities of impacts that are at rest,
        or that the orbit without such flights does not have, and at the ends of these how far
        beyond their limits impacts are that lead through a surface on which others slide.
        """
        problem, rows = self.space.problem, self.space.impacts(self.z)
        count = len(problem.word)
        aside = {*self.at_rest, *(self._remains.dropped if self._remains else ())}
        found = []
        for k, (row, later) in enumerate(itertools.pairwise(rows)):
            if not self._vanishing(k):
                lasts = f"flight {k + 1} lasts {(later[0] - row[0]).str(6)}"
                found.append((later[0] - row[0], lasts, lasts))
        for k, wall in enumerate(problem.word.walls):
            if k not in aside:
                speed = problem.model.guard(wall).side * self.z[problem.m * k + 1]
                slow = f"impact {k + 1} has the velocity {speed.str(6)} towards its wall"
                found.append((speed, slow, f"impact {k + 1} runs the wrong way"))
        for one in limits(problem):
            k = one.impact
            if one.sign < 0 and not (self._vanishing(k) or self._vanishing((k - 1) % count)):
                margin = one.margin(self.space, self.z)
                beyond = f"impact {k + 1} is {margin.str(6)} beyond the limit {one.wall}"
                slides = f"impact {k + 1} leads through, though {one.sliding} would slide"
                found.append((margin, beyond, slides))
        return found

    def _vanishing(self, flight: int) -> bool:
        """Whether a flight takes no time at the event."""
        if "impact" not in self.details:
            return self.details.get("flight") == flight and "touch_time" not in self.details
        if self._remains is None or flight not in self._remains.brief:
            return False
        if flight in self.space.problem.excursions and flight == self.details["impact"]:
            return True
        return takes_no_time(self.space, self.z, flight)

    def why_unphysical(self) -> str:
        """Return why the orbit is proven to be unphysical; nothing where it is not."""
        broken = (text for value, _, text in self._conditions if value < 0)
        return next(broken, "") or self._deepest()

    def _deepest(self) -> str:
        """Where a flight passes a wall, at the nearest touches that doubles find."""
        space, problem = self.space, self.space.problem
        here = problem.evaluate(np.array([float(x.mid()) for x in self.z]))
        for touch in (t for flight in here.gaps for t in flight.touches if t is not None):
            if touch.gap < 0 and not self._own(touch.flight, touch.wall):
                gap = Gap(space, self.z, touch.flight, touch.wall)
                time = (arb(touch.time) - gap.begin).mid()
                if time > 0 and time < gap.duration and gap.at(time)[0] < 0:
                    return f"flight {touch.flight + 1} passes wall {touch.wall}"
        return ""

    def _own(self, flight: int, wall: str) -> bool:
        """Whether a touch there is the event."""
        where = self.details.get("flight"), self.details.get("wall")
        return "touch_time" in self.details and where == (flight, wall)

    def _clear(self) -> Claim:
        """Whether all flights keep clear of all walls."""
        for k in range(max(1, len(self.space.problem.word))):
            near = [] if self._vanishing(k) else coordinates_of(self.space, k)
            for wall in (one.guard for coordinate in near for one in coordinate.met):
                own = self._own(k, wall.name)
                touch = self.details["touch_time"] if own else self._images.get((k, wall.name))
                beside = self._beside(k, wall.name)
                found = Gap(self.space, self.z, k, wall.name, touch, beside).proven()
                if found.what is not ClearanceProof.YES:
                    where = f"flight {k + 1}, wall {wall.name}, {found.time:.6g} after it leaves"
                    passes = found.what is ClearanceProof.PASSES
                    return False if passes else None, f"{where}: the gap is {found.gap}"
        return True, ""

    @functools.cached_property
    def _images(self) -> dict[tuple[int, str], Any]:
        """When the images of the event's touch come, where the orbit is proven to be its own image:
        at its parameter there is one orbit in a box, in which both lie."""
        if "touch_time" not in self.details or not self.space.problem.word:
            return {}
        box = [x + arb(0, 1) * NEARBY * (1 + abs(x)) for x in self.z]
        own = self.details["flight"], self.details["wall"], self.details["touch_time"]
        found = {}
        for image in images_of(self.space, self.z, self.z[0]):
            if all(b.contains(x) for b, x in zip(box, image.z, strict=True)):
                flight, wall, time = image.touch(*own)
                found[flight, wall] = time
        system, _ = self.space.vanishing(lambda z: z[-1] - self.z[-1])
        alone = found and krawczyk(self.space, system, box) is not None
        return found if alone else {}

    def _beside(self, flight: int, wall: str) -> tuple[bool, bool]:
        """Whether a flight of no duration comes from a wall before it, or leads to it after it."""
        word = self.space.problem.word.walls
        if not word:
            return False, False
        before, behind = (flight - 1) % len(word), (flight + 1) % len(word)
        left = self.space.problem.model.guard(word[before])
        return (
            self._vanishing(before) and wall in (left.name, left.past),
            self._vanishing(behind) and word[(behind + 1) % len(word)] == wall,
        )

    def touches(self) -> Claim:
        """Return whether the event's touch is a strict local minimum of the gap; where the flight
        begins there, its gap only has to bend."""
        if "touch_time" not in self.details:
            return True, ""
        gap = Gap(self.space, self.z, self.details["flight"], self.details["wall"])
        curvature = gap.at(self.details["touch_time"] - gap.begin)[2]
        within = self.details["touch_time"] - gap.begin
        begins, ends = "impact" in self.details, bool(self.space.problem.word.walls)
        if ends and not begins and not (within > 0 and within < gap.duration):
            return None, f"the touch comes {within.str(6)} after the flight leaves"
        bends = curvature > 0 or (begins and curvature < 0)
        return (True, "") if bends else (None, f"the gap bends by {curvature.str(6)}")


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


def _count_outside(orbit: Orbit, flights: Sequence[Flight]) -> Claim:
    """How many multipliers lie outside, those of the event set aside, from enclosures of all."""
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

    Raises ValueError, ZeroDivisionError if they are not isolated, or an impact's velocity may be
    zero.
    """
    m = len(flights[0][0])
    total = identity(m)
    for _, start, end, _ in flights:
        total = -(arb_mat(m, m, end).inv() * arb_mat(m, m, start)) * total
    found: list[Any] = acb_mat(total).eig()
    return found


# Gaps along flights in balls, and that flights keep clear of walls.
#
# The time of a flight is cut into cells. In each the gap, or its rate, or its curvature is
# enclosed; the gap of a cell is enclosed around the cell's middle,
#
# .. math:: g(t) \in g(m) + g'(m)(t - m) + \tfrac12 g''(C)(t - m)^2 .
#
# A cell is clear if its gap is positive. Where the flight leaves or reaches the wall itself the gap
# is zero at the cell's end, and the cell is clear if the rate there runs away from the wall, or
# does not run to it and the curvature is positive. Around the event's own touch, where gap and rate
# are zero, the curvature has to be positive: the touch is then a strict local minimum.

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
    letters, word = problem.model.letters, problem.word.walls
    if not word:
        mode = problem.model.first_mode
        return [
            Coordinate([ReachableGuard(g, i, False, False)], None, space.motion(SECTION, g.name))
            for i, g in enumerate(problem.model.WALLS)
            if mode in g.modes and not g.past
        ]
    left, reached = letters.index(word[flight]), letters.index(word[(flight + 1) % len(word)])
    walls, passages = problem.model.WALLS, problem.kernels.passages
    arrivals, watched = passages.arrivals[left], passages.watched[left]
    found = []
    for numbers in coordinates(problem.model).values():
        met = [
            ReachableGuard(
                walls[i], i, arrivals[i] != ELSEWHERE, same_surface(walls[i], walls[reached])
            )
            for i in numbers
            if watched[i] and not walls[i].past
        ]
        if not met:
            continue
        own = left in numbers
        other = None if own else letters[numbers[0]]
        found.append(Coordinate(met, left if own else None, space.motion(word[flight], other)))
    return found


DEEPEST_CUT = 40
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

        for left, right in open_cells((arb(0), self.duration.upper()), judge, DEEPEST_CUT):
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
        first = self.at(arb(0))[1]
        at_rest = self.start[1] == 0 and first.contains(0)  # it leaves at rest, if it is no jump
        return bool(rate > 0 or (curvature > 0 and (at_rest or first >= 0)))

    def _arrives(self, rate: Any, curvature: Any) -> bool:
        """Whether the gap, zero at the end of the flight, is positive before it."""
        return bool(rate < 0 or (curvature > 0 and -self.side * self.arrival[1] <= 0))
