"""Sliding: where it begins, what touches its surface, and how words change there.

Sliding is motion in a mode whose state is smaller than the system's. There are four kinds (di
Bernardo, Budd, Champneys and Kowalczyk, Piecewise-smooth Dynamical Systems, 2008, chapter 8). With
S a guard that leads to sliding, C one that leads through the surface instead, P and A those at
which sliding ends on either side, and B one that leads to sliding from beyond, they are

=================  ========================================  ===========================
                   on the word without the new flight        on that with it
=================  ========================================  ===========================
grazing-sliding    G: a flight outside touches S             V at S; T of SP
adding-sliding     G: a flight that slides touches A         V at A, V at B; T of AB
switching-sliding  G where a flight begins: S slides from A  V at B; T of CB
crossing-sliding   G where a flight begins: C leads from A   T of SA
=================  ========================================  ===========================
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from ..continuation.branch import Details, Location
from ..models.guards import Guard, Word, are_parallel, crosses_at, is_path, slides_at, state_size
from ..models.model import Model
from ..orbits.problem import Linearisation, OrbitProblem, rounding
from ..orbits.quiet import QuietProblem, problem_of
from ..orbits.search import solve_near
from ..segments.bounded import bounds_of
from ..segments.flight import Touch
from ..segments.segment import ELSEWHERE, Segment
from ..segments.touches import ROUNDING, begins_on_surface, limits_of, margin
from .branch_point import directions_at
from .extended_system import (
    Arrival,
    ExtendedSystem,
    OrbitEvent,
    OrbitPoint,
    SystemEvaluation,
    TouchingFlight,
    located,
    solve,
)
from .kind import SUB, SUPER, Start, null_vector_start

# The equations of an orbit that touches a guard where a flight begins.

TOUCHING = 1e-9
"""A gap below this at an event, in natural sizes, is a touch at the same parameter value."""


class Beginning(Arrival):
    """Sliding begins on one of its limits (see `segments.touches`): a flight to it takes no time.

    Its own unknowns are the section coordinates there.
    """

    def __init__(self, problem: OrbitProblem, impact: int, sliding: str, limit: str) -> None:
        segment = problem.kernels.segment(sliding, limit)
        super().__init__(problem, impact, segment, range(1, problem.m))

    def start(self, here: Linearisation) -> Array:
        left = here.unknowns[self.left].tolist()
        return np.array(
            arrival_unknowns(self.segment, left, self.problem.values(here.unknowns))[1:]
        )

    def arrival(self, here: Linearisation, own: Array) -> tuple[Array, Array, Array, Array]:
        rows, start, end, free = super().arrival(here, own)
        start[:, 0] += end[:, 0]  # both times are one
        return rows, start, end, free

    def scale(self, own: Array, sizes: Array) -> Array:
        return np.asarray(sizes[1 : self.problem.m])

    def ends(self, here: Linearisation, own: Array) -> tuple[list[float], list[float]]:
        left = here.unknowns[self.left].tolist()
        return left, [left[0], *own.tolist()]


class SurfaceTangency(ExtendedSystem):
    """A flight begins on the surface of a guard of its mode, without a rate."""

    row = 1
    """That of the flight to the guard that vanishes; the position's is the first."""

    def __init__(self, problem: OrbitProblem, impact: int, wall: str) -> None:
        super().__init__(problem)
        self.segment = problem.kernels.segment(problem.word.walls[impact], wall)
        self.left = slice(problem.m * impact, problem.m * impact + problem.m)

    def start(self, here: Linearisation) -> Array:
        return np.zeros(0)

    def assemble(self, here: Linearisation, own: Array) -> SystemEvaluation:
        m, n = self.problem.m, self.problem.n
        values = self.problem.values(here.unknowns)
        rows, leaving, arriving, free = self.segment.blocks(*self._ends(here), values)
        self.problem.kernel_evaluations += 1
        gradient = np.zeros(len(here.unknowns))
        gradient[self.left] = np.reshape(leaving, (m, m))[self.row]
        gradient[n:] = np.reshape(free, (m, -1))[self.row]
        self._arrive_later(gradient, here, np.reshape(arriving, (m, m))[self.row, 0])
        return SystemEvaluation(
            np.append(here.residual, rows[self.row]), np.vstack([here.jacobian, gradient])
        )

    def _arrive_later(self, gradient: Array, here: Linearisation, rate: float) -> None:
        """Add what depends on the time at which the flight ends: that at which it begins."""
        gradient[self.left.start] += rate

    def rounding(self, here: Linearisation, own: Array) -> Array:
        values = self.problem.values(here.unknowns)
        bounds = bounds_of(self.segment, *self._ends(here), values)[1][0]
        return np.append(rounding(here).residual, bounds[self.row])

    def _ends(self, here: Linearisation) -> tuple[list[float], list[float]]:
        """The unknowns at both ends of a flight of no duration, whose second row is the rate."""
        left = here.unknowns[self.left].tolist()
        return left, [left[0], *[0.0] * (self.problem.m - 1)]


class EndOnGuard(SurfaceTangency):
    """A flight ends on a guard of the mode that it leaves, when it meets another."""

    row = 0

    def _arrive_later(self, gradient: Array, here: Linearisation, rate: float) -> None:
        n = self.problem.n
        gradient[self.left.stop % n] += rate
        if self.left.stop == n:
            gradient[n:] += rate * np.array(self.problem.drifts(here.unknowns))

    def _ends(self, here: Linearisation) -> tuple[list[float], list[float]]:
        left = here.unknowns[self.left].tolist()
        _, end = self.problem.times_around(here.unknowns, self.left.start // self.problem.m)
        return left, [end, *[0.0] * (self.problem.m - 1)]


def arrival_unknowns(
    segment: Segment, left: Sequence[float], values: Sequence[float], time: float | None = None
) -> list[float]:
    """Return the unknowns of an impact at some time after another, at once unless it is given,
    from those of that one."""
    time = left[0] if time is None else time
    rows = segment.blocks(left, [time, *[0.0] * (len(left) - 1)], values)[0]
    return [time, *(float(row) for row in rows[1:])]


def near_touches(here: Linearisation) -> list[Touch]:
    """Return the touches at which an orbit is not told from one that grazes."""
    touches, least = (t for flight in here.gaps for t in flight.touches), _touching(here)
    return [t for t in touches if t is not None and abs(t.gap) < least]


def _touching(here: Linearisation) -> float:
    return TOUCHING * here.problem.size_of_gaps(here)


def tolerated_touches(here: Linearisation) -> set[tuple[int, str]]:
    """Return the touches that are not held against the orbit of an event: rounding decides on
    which side of the guard they are."""
    least = _touching(here)
    begun = (t for flight in here.gaps for t in flight.beyond if abs(t.gap) < least)
    return {(t.flight, t.wall) for t in (*near_touches(here), *begun)} - violations(here)


def violations(here: Linearisation) -> set[tuple[int, str]]:
    """Return the guards beyond which flights begin or end, whatever they touch inside."""
    begun, least = (t for flight in here.gaps for t in flight.beyond), _touching(here)
    return {(t.flight, t.wall) for t in begun if t.gap <= -least}


GRAZING, ADDING = "grazing-sliding", "adding-sliding"
SWITCHING, CROSSING = "switching-sliding", "crossing-sliding"

INSTANT = 1e-9
"""A flight shorter than this part of the period takes no time."""


def is_sliding(model: Model, mode: str) -> bool:
    """Whether the motion in a mode is sliding."""
    degrees = model.DEGREES_OF_FREEDOM
    here, first = (state_size(model.MODES, m, degrees) for m in (mode, model.first_mode))
    return here < first


def sliding_kind_of_touch(problem: OrbitProblem, details: Details) -> str | None:
    """Return which sliding bifurcation a G is; None if it is none."""
    model = problem.model
    if "impact" in details:
        guard = guard_at(problem, details["impact"])
        if isinstance(onset_of(problem, details), Corner):
            return None
        if guard.past:
            return CROSSING
        begun = guard.name, details["wall"]
        slid = is_sliding(model, guard.next_mode) and not begins_on_surface(problem.kernels, *begun)
        return SWITCHING if slid else None
    touched = model.guard(details["wall"])
    slides, then = (is_sliding(model, mode) for mode in (touched.modes[0], touched.next_mode))
    return None if slides == then else ADDING if slides else GRAZING


def sliding_kind_of_zero_velocity(
    problem: OrbitProblem, unknowns: Array, impact: int
) -> str | None:
    """Return which sliding bifurcation a V is."""
    guard, model = guard_at(problem, impact), problem.model
    slides, then = (is_sliding(model, mode) for mode in (guard.modes[0], guard.next_mode))
    if slides or not then:
        return ADDING if slides and not then else None
    before = (impact - 1) % len(problem.word)
    return (
        sliding_kind_of_zero_duration(problem, before)
        if is_brief(problem, unknowns, before)
        else None
    ) or GRAZING


def sliding_kind_of_zero_duration(problem: OrbitProblem, flight: int) -> str | None:
    """Return which sliding bifurcation a T is."""
    model = problem.model
    one, other = guard_at(problem, flight), guard_at(problem, flight + 1)
    if is_sliding(model, one.next_mode):
        return GRAZING if one.modes[0] == other.next_mode else CROSSING
    if not is_sliding(model, other.next_mode):
        return None
    if one.past:
        return SWITCHING
    return ADDING if is_sliding(model, one.modes[0]) else None


def is_brief(problem: OrbitProblem, unknowns: Array, flight: int) -> bool:
    """Whether a flight takes no time."""
    begin, end = problem.times_around(unknowns, flight)
    return abs(end - begin) < INSTANT * problem.span(unknowns)


def guard_at(problem: OrbitProblem, impact: int) -> Guard:
    """Return the guard of an impact, counted around."""
    return problem.model.guard(problem.word.walls[impact % len(problem.word)])


# What an impact at which sliding begins on a limit becomes.


def letters_of_split(problem: OrbitProblem, impact: int, limit: str) -> str | None:
    """Return the two letters in the place of an impact's: SA for C, CB for S; None if not known."""
    guards, guard = problem.model.WALLS, guard_at(problem, impact)
    arrival = problem.kernels.arrival
    if guard.past:
        sliding = slides_at(guards, guard)
        return None if sliding is None else sliding.name + guard.past
    crossing = crosses_at(guards, guard, limit)
    if crossing is None:
        return None
    back = (g for g in guards if crossing.next_mode in g.modes and g.next_mode == guard.next_mode)
    letters = (g.name for g in back if arrival(crossing.name, g.name) != ELSEWHERE)
    letter = next(letters, None)
    return None if letter is None else crossing.name + letter


def letter_of_merger(problem: OrbitProblem, flight: int) -> str | None:
    """Return the letter in the place of those at both ends of a flight that takes no time."""
    guards = problem.model.WALLS
    one, other = guard_at(problem, flight), guard_at(problem, flight + 1)
    through = slides_at(guards, one) if one.past else crosses_at(guards, one, other.name)
    return through.name if through is not None and through.next_mode == other.next_mode else None


def replace_letters(word: Word, impact: int, letters: str, taken: int = 1) -> Word:
    """Return a word with other letters in the place of so many from an impact on."""
    kept = word.drop(*((impact + k) % len(word) for k in range(taken)))
    place = impact - sum((impact + k) % len(word) < impact for k in range(taken))
    return Word(kept.walls[:place] + letters + kept.walls[place:], word.period)


def split_impact(problem: OrbitProblem, unknowns: Array, impact: int, letters: str) -> Array:
    """Return the impacts of an orbit with two that take no time in the place of one."""
    rows = problem.impacts(unknowns)
    segment = problem.kernels.segment(*letters)
    added = arrival_unknowns(segment, rows[impact].tolist(), problem.values(unknowns))
    return np.insert(rows, impact + 1, added, axis=0)


def merge_impacts(
    problem: OrbitProblem, unknowns: Array, flight: int
) -> tuple[OrbitProblem, Array] | None:
    """Return the problem with one impact in the place of the two at the ends of a flight that takes
    no time, and the same orbit in it; None if no letter says so."""
    letter, other = letter_of_merger(problem, flight), (flight + 1) % len(problem.word)
    if letter is None:
        return None
    word = replace_letters(problem.word, flight, letter, 2)
    there = problem_of(problem.model, word, problem.kernels)
    rows = np.delete(problem.impacts(unknowns), other, axis=0)
    return there, there.with_impacts(rows, problem.span(unknowns), unknowns)


# Where an interruption of sliding vanishes: adding-sliding, seen from the orbit that has it.
#
# What leaves sliding does so at rest, so that the equations of that orbit are singular there. Those
# of the orbit without the interruption are not: it touches a limit of sliding.

BESIDE = 0.1
"""How near to its guess it is, in the sizes of the unknowns."""


def where_added(guess: OrbitPoint, flight: int, details: Details) -> Location | None:
    """Return where a flight that leaves sliding and comes back to it vanishes; None if nowhere
    near."""
    problem, unknowns = guess.evaluation.problem, guess.unknowns
    ends = flight, (flight + 1) % len(problem.word)
    word = problem.word.drop(*ends)
    possible = sliding_kind_of_zero_duration(problem, flight) == ADDING and word.walls
    if not possible or not is_path(problem.model.WALLS, word.walls):
        return None
    without = problem_of(problem.model, word, problem.kernels)
    system = _merged_touch_system(problem, without, unknowns, ends)
    rest = np.delete(problem.impacts(unknowns), ends, axis=0)
    begin = without.with_impacts(rest, guess.evaluation.span, unknowns)
    solution = solve(system, without.evaluate(begin))
    if solution is None:
        return None
    found = _unknowns_with_touch(
        problem, without, solution.unknowns, system.touch(solution.own), ends
    )
    sizes = problem.scale(unknowns, np.full(problem.free, np.inf))
    if not np.linalg.norm((found - unknowns) / sizes) < BESIDE:
        return None
    return Location(found, solution.residual, solution.error, details)


def _merged_touch_system(
    problem: OrbitProblem, without: OrbitProblem, unknowns: Array, ends: tuple[int, int]
) -> TouchingFlight:
    """The equations of the orbit without the impacts at both ends, which touches there."""
    before = (ends[0] - 1) % len(problem.word)
    left = before - sum(end < before for end in ends)
    turn = problem.span(unknowns) if ends[0] == 0 else 0.0
    time = float(problem.impacts(unknowns)[ends[0], 0]) + turn
    return TouchingFlight(without, left, problem.word.walls[ends[0]], time)


def _unknowns_with_touch(
    problem: OrbitProblem,
    without: OrbitProblem,
    unknowns: Array,
    touch: Array,
    ends: tuple[int, int],
) -> Array:
    """The unknowns of that orbit with both impacts at the touch."""
    count, span = len(problem.word), without.span(unknowns)
    back = problem.kernels.segment(*(problem.word.walls[end] for end in ends))
    again = arrival_unknowns(back, touch.tolist(), without.values(unknowns))
    rows = np.empty((count, problem.m))
    rows[list(ends)] = touch, again
    rows[[k for k in range(count) if k not in ends]] = without.impacts(unknowns)
    rows[ends[0], 0] -= span * (ends[0] == 0)
    rows[ends[1], 0] -= span * (ends[0] in (0, count - 1))
    return np.append(rows.ravel(), unknowns[-problem.free :])


# Where the motion after an impact begins on a limit of its mode.
#
# Sliding begins on one of its limits, as where a crossing or a switching of sliding is; or a flight
# that begins on the surface of a guard has no rate there: beyond, it leaves its mode at once.


@dataclass(frozen=True)
class SlidingOnset:
    """An impact after which the motion begins within a limit, or beyond."""

    problem: OrbitProblem
    impact: int
    begun: str
    limit: str
    sign: float
    """See `contimpact.segments.touches.limits_of`."""

    def margin(self, unknowns: Array) -> float:
        """Return how far it is from the limit, negative where another impact takes its place."""
        kernels, values = self.problem.kernels, self.problem.values(unknowns)
        leave = self.problem.impacts(unknowns)[self.impact].tolist()
        given = leave, values, kernels.setup(*values).walls
        return self.sign * margin(kernels, self.begun, self.limit, *given)

    def tangency(self, unknowns: Array) -> float:
        """Return the rate with which the motion begins on the limit, or on its surface the
        acceleration."""
        problem, order = self.problem, 2 if self.on_surface else 1
        leave = problem.impacts(unknowns)[self.impact].tolist()
        gap = problem.kernels.gap(self.begun, self.limit)
        return float(gap(*leave, 0.0, *problem.values(unknowns))[order])

    @property
    def on_surface(self) -> bool:
        """Whether the flight begins on the surface of the limit, and its rate vanishes."""
        return begins_on_surface(self.problem.kernels, self.begun, self.limit)

    def equations(self) -> ExtendedSystem:
        """Return the equations of an orbit on the limit."""
        if self.on_surface:
            return SurfaceTangency(self.problem, self.impact, self.limit)
        return Beginning(self.problem, self.impact, self.begun, self.limit)

    def locate(self, guess: OrbitPoint) -> Location | None:
        """Solve these from a point near it."""
        return located(self.equations(), guess, lambda solution: self.details(solution.unknowns))

    def details(self, unknowns: Array) -> Details:
        """Return where on the orbit it is."""
        time = float(self.problem.impacts(unknowns)[self.impact, 0])
        place = {"flight": self.impact, "impact": self.impact}
        return {**place, "wall": self.limit, "touch_time": time}

    def next_word(self) -> Word | None:
        """Return the word beyond."""
        letters = letters_of_split(self.problem, self.impact, self.limit)
        return None if letters is None else replace_letters(self.problem.word, self.impact, letters)

    def born(self, unknowns: Array) -> Start | None:
        """Return the start of the branch beyond, on which a flight more takes some time."""
        letters, word = letters_of_split(self.problem, self.impact, self.limit), self.next_word()
        if letters is None or word is None:
            return None
        there = problem_of(self.problem.model, word, self.problem.kernels)
        rows = split_impact(self.problem, unknowns, self.impact, letters)
        start = null_vector_start(
            there, there.with_impacts(rows, self.problem.span(unknowns), unknowns)
        )
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


def interrupted_sliding_start(problem: OrbitProblem, unknowns: Array, flight: int) -> Start | None:
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


@dataclass(frozen=True)
class Corner(SlidingOnset):
    """An impact before which the motion is within another guard of its mode, or beyond: where both
    are met at once. The mode after the impact does not have the other one."""

    on_surface = False

    def margin(self, unknowns: Array) -> float:
        problem, flight = self.problem, (self.impact - 1) % len(self.problem.word)
        values, (start, end) = problem.values(unknowns), problem.times_around(unknowns, flight)
        letter, leave = problem.leaving(unknowns, flight)
        place, rate, curvature = problem.kernels.gap(letter, self.limit)(
            *leave, end - start, *values
        )
        setup = problem.kernels.setup(*values)
        position = setup.walls[problem.model.letters.index(self.limit)]
        gap, least = position - place, ROUNDING * (abs(place) + abs(position))
        touches = abs(rate) <= INSTANT * abs(curvature) * setup.period  # the flight turns there
        if abs(gap) <= least or touches:
            return math.nan
        return problem.model.guard(self.limit).side * float(gap)

    def equations(self) -> ExtendedSystem:
        return EndOnGuard(self.problem, (self.impact - 1) % len(self.problem.word), self.limit)

    def details(self, unknowns: Array) -> Details:
        flight = (self.impact - 1) % len(self.problem.word)
        end = float(self.problem.times_around(unknowns, flight)[1])
        return {"flight": flight, "impact": self.impact, "wall": self.limit, "touch_time": end}

    def tangency(self, unknowns: Array) -> float:
        return math.nan

    def next_word(self) -> None:
        """The guard that is met first leads to a mode of its own."""

    def born(self, unknowns: Array) -> None:
        """Nothing is known to start there."""


def onsets_of_word(problem: OrbitProblem) -> Sequence[SlidingOnset]:
    """Return all of a word."""
    kernels, guards = problem.kernels, problem.model.WALLS
    size = problem.model.DEGREES_OF_FREEDOM
    found = []
    for k, letter in enumerate(problem.word.walls):
        before, place = problem.word.walls[k - 1], problem.model.letters.index(letter)
        watched = kernels.passages.watched[problem.model.letters.index(before)]
        found += [SlidingOnset(problem, k, *limit) for limit in limits_of(kernels, letter)]
        found += [
            Corner(problem, k, before, guards[other].name, 1.0)
            for other in kernels.guards_behind(place)
            if watched[other] and not are_parallel(guards[other].row(size), guards[place].row(size))
        ]
    return found


def onset_of(problem: OrbitProblem, details: Details) -> SlidingOnset | None:
    """Return the one at which an event is; None where a flight touches inside."""
    if "impact" not in details:
        return None
    place = details["impact"], details["wall"]
    return next((one for one in onsets_of_word(problem) if (one.impact, one.limit) == place), None)


# Where a flight begins at rest on its wall, as after an impact without restitution.
#
# It leaves the wall where its acceleration leads away, else it is beyond at once. There the gap is
# of the third order in that acceleration, and has no smallest value on the other side.

AT_REST = 4e-16
"""A rate below this part of the velocity of the impact is rounding: with a restitution of 1e-12
flights do not begin at rest."""


@dataclass(frozen=True)
class RestingStart:
    """An impact after which a flight may begin at rest."""

    problem: OrbitProblem
    impact: int

    def margin(self, unknowns: Array) -> float:
        """Return the acceleration away from the wall; not a number where there is a rate."""
        leave = self.problem.impacts(unknowns)[self.impact].tolist()
        return self.margin_from(leave, self.problem.values(unknowns))

    def margin_from(self, leave: Sequence[float], values: Sequence[float]) -> float:
        """Return the same, from the unknowns of the impact."""
        _, rate, acceleration = self.problem.kernels.motion(self.wall)(*leave, 0.0, *values)
        side = guard_at(self.problem, self.impact).side
        return -side * float(acceleration) if abs(rate) <= AT_REST * abs(leave[1]) else math.nan

    @property
    def wall(self) -> str:
        """The wall that is left."""
        return self.problem.word.walls[self.impact]

    def locate(self, guess: OrbitPoint) -> Location | None:
        """The acceleration has a zero of the first order, which is located by bracketing."""
        return None

    def details(self, unknowns: Array) -> Details:
        """Return where on the orbit it is: a touch where the flight begins."""
        time = float(self.problem.impacts(unknowns)[self.impact, 0])
        return {"flight": self.impact, "wall": self.wall, "touch_time": time}


def resting_starts(problem: OrbitProblem) -> list[RestingStart]:
    """Return those of a word with the values of its model."""
    values, m = [*problem.model.values.values()], problem.m
    rigid = [k for k in range(len(problem.word)) if guard_at(problem, k).rigid]
    starts = [RestingStart(problem, k) for k in rigid]
    arrivals = [[0.0, guard_at(problem, k).side, *[0.0] * (m - 2)] for k in rigid]
    return [
        one
        for one, leave in zip(starts, arrivals, strict=True)
        if not math.isnan(one.margin_from(leave, values))
    ]


# The orbit without what vanishes on it: an impact of zero velocity, or a flight of no duration.

TOUCHING_WHILE_VANISHING = 1e-6
"""A gap below this, in natural sizes, is a touch: the orbit without impacts is that of a V."""


def vanishing_impacts(problem: OrbitProblem, impact: int) -> tuple[int, ...]:
    """Return the impacts that vanish with one: itself, and the next at the end of an excursion."""
    if impact in problem.excursions:
        return impact, (impact + 1) % len(problem.word)
    return (impact,)


SAME_ORBIT = 1e-4
"""Part of their sizes within which the equations hold of an orbit whose word has changed; where an
impact at rest is a jump, they are off by that jump."""


def is_same_orbit(there: Linearisation) -> bool:
    """Whether an orbit is one of the word that it has been given."""
    return bool(np.max(np.abs(there.residual) / there.sizes[0]) < SAME_ORBIT)


def remove_impacts(here: Linearisation, impact: int) -> tuple[OrbitProblem, Array] | None:
    """The problem of the word without an impact of zero velocity, and the same orbit in it.

    None if no impact is left, and the motion without any has no orbit that touches there, or if the
    modes on both sides of the impact are not the same.
    """
    problem, dropped = here.problem, other_end_of(here, impact)
    before = (impact - 1) % len(problem.word)
    if sliding_kind_of_zero_velocity(problem, here.unknowns, impact) == SWITCHING:
        return merge_impacts(problem, here.unknowns, before)
    if len(problem.word) == len(dropped):
        return _quiet_orbit(here, impact)
    word = problem.word.drop(*dropped)
    if not is_path(problem.model.WALLS, word.walls):
        return None
    shorter = problem_of(problem.model, word, problem.kernels)
    kept = np.delete(problem.impacts(here.unknowns), dropped, axis=0)
    return shorter, shorter.with_impacts(kept, here.span, here.unknowns)


def other_end_of(here: Linearisation, impact: int) -> tuple[int, ...]:
    """Return the same, with the impact at the other end of a flight that takes no time."""
    dropped = vanishing_impacts(here.problem, impact)
    problem, unknowns, count = here.problem, here.unknowns, len(here.problem.word)
    if len(dropped) == 1 < count and is_brief(problem, unknowns, impact):
        return impact, (impact + 1) % count
    before = (impact - 1) % count
    if sliding_kind_of_zero_duration(problem, before) is not None and is_brief(
        problem, unknowns, before
    ):
        return before, impact
    return dropped


def _quiet_orbit(here: Linearisation, impact: int) -> tuple[OrbitProblem, Array] | None:
    """The word `0` and its orbit, if that touches where the only impact vanishes."""
    problem, wall = here.problem, here.problem.word.walls[impact]
    quiet = problem_of(problem.model, Word("", problem.word.period), problem.kernels)
    assert isinstance(quiet, QuietProblem)
    guess = quiet.from_touch(problem, here.unknowns, impact)
    found = solve_near(quiet, np.append(guess, here.unknowns[-problem.free :]))
    if found is None:
        return None
    least = TOUCHING_WHILE_VANISHING * quiet.size_of_gaps(found)
    if any(t is not None and t.wall == wall and abs(t.gap) < least for t in found.gaps[0].touches):
        return quiet.first_lap(found.unknowns)
    return None


def without_flight(here: Linearisation, flight: int) -> tuple[OrbitProblem, Array] | None:
    """The same for a flight that takes no time, where sliding vanishes or begins with it."""
    found = sliding_kind_of_zero_duration(here.problem, flight)
    if found in (CROSSING, SWITCHING):
        return merge_impacts(here.problem, here.unknowns, flight)
    return None if found is None else remove_impacts(here, flight)


# Where impacts on different coordinates exchange their order: the same orbit on the word beyond.
#
# At a T two impacts, or more of them, happen at once. Beyond it they come in another order, and
# each
# may end another mode and have another letter there: the one of the same surface. If their resets
# commute, the orbit of the exchanged word passes through the same point of state space, and its
# equations are regular there. If they do not, it does not pass, and nothing continues the motion.

SAME_STATE = 1e-7
"""An orbit passes through a state if its equations hold there within this part of their size."""

SAME_RATE = 6
"""Digits to which the rates agree of impacts that keep happening at once."""


def exchanged_word(here: Linearisation, flight: int, rates: Array) -> Word | None:
    """Return the word beyond a flight that takes no time, its impacts in the order they have
    there.

    `rates` are those of each flight's duration along the branch, up to a common factor. None if
    impacts only merge: those at both ends are on one surface, or no letters say so.
    """
    problem, letters = here.problem, list(here.problem.word.walls)
    runs = list(_simultaneous_impacts(problem, here.unknowns))
    if not rates[flight] or not any(flight in impacts[:-1] for impacts in runs):
        return None
    for impacts in runs:
        times = np.append(0.0, np.cumsum([rates[k] for k in impacts[:-1]]))
        later = np.round(times / rates[flight], SAME_RATE)  # beyond, the last comes first
        order = [impacts[i] for i in np.argsort(-later, kind="stable")]
        if order != impacts:
            spelled = _respell(problem, here.unknowns, impacts, order)
            if spelled is None:
                return None
            for k, letter in zip(impacts, spelled, strict=True):
                letters[k] = letter
    word = Word("".join(letters), problem.word.period)
    return None if word == problem.word else word


def impacts_at_once(here: Linearisation, flight: int) -> str:
    """Return the letters of the impacts that happen at the ends of a flight that takes no time, if
    they are on several surfaces."""
    problem, size = here.problem, here.problem.model.DEGREES_OF_FREEDOM
    for impacts in _simultaneous_impacts(problem, here.unknowns):
        rows = [guard_at(problem, k).row(size) for k in impacts]
        pairs = itertools.combinations(rows, 2)
        if flight in impacts[:-1] and not all(are_parallel(*pair) for pair in pairs):
            return "".join(problem.word.walls[k] for k in impacts)
    return ""


def exchange_impacts(here: Linearisation, word: Word) -> tuple[OrbitProblem, Array] | None:
    """Return the problem of the word beyond, and the same orbit in it; None if it is none of it."""
    problem, span = here.problem, here.span
    there = problem_of(problem.model, word, problem.kernels)
    values, rows = problem.values(here.unknowns), problem.impacts(here.unknowns)
    moved = rows.copy()
    for impacts in _simultaneous_impacts(problem, here.unknowns):
        before = (impacts[0] - 1) % len(word)
        letter, left = problem.word.walls[before], rows[before].tolist()
        left[0] -= span * (impacts[0] == 0)
        time = float(rows[impacts[0], 0])
        for k in impacts:
            segment = problem.kernels.segment(letter, word.walls[k])
            left = arrival_unknowns(segment, left, values, time)
            moved[k, 1:] = left[1:]
            letter = word.walls[k]
    unknowns = there.with_impacts(moved, span, here.unknowns)
    size = float(np.max(np.abs(rows[:, 1:])))
    missed = there.evaluate(unknowns).largest_residual
    return (there, unknowns) if missed < SAME_STATE * size else None


def _simultaneous_impacts(problem: OrbitProblem, unknowns: Array) -> Iterator[list[int]]:
    """The impacts that happen at once, in order, those of each instant."""
    count = len(problem.word)
    brief = [is_brief(problem, unknowns, k) for k in range(count)]
    for first in (k for k in range(count) if brief[k] and not brief[k - 1]):
        impacts = [first]
        while brief[impacts[-1]]:
            impacts.append((impacts[-1] + 1) % count)
        yield impacts


def _respell(
    problem: OrbitProblem, unknowns: Array, impacts: Sequence[int], order: Sequence[int]
) -> str | None:
    """The letters of impacts in another order: a way through the modes along the same surfaces."""
    model = problem.model
    size = model.DEGREES_OF_FREEDOM
    setup = problem.kernels.setup(*problem.values(unknowns))
    places = dict(zip(model.letters, setup.walls, strict=True))

    def same(one: Guard, other: Guard) -> bool:
        near = math.isclose(places[one.name], places[other.name], rel_tol=1e-12, abs_tol=1e-300)
        return near and (one.side, one.row(size)) == (other.side, other.row(size))

    met = [guard_at(problem, k) for k in order]
    rows = [guard.row(size) for guard in met]
    if any(are_parallel(one, other) for one, other in itertools.combinations(rows, 2)):
        return None
    ways = [("", guard_at(problem, impacts[0] - 1).next_mode)]
    for guard in met:
        own_first = sorted(model.WALLS, key=lambda g: g.name != guard.name)
        ways = [
            (way + g.name, g.next_mode)
            for way, mode in ways
            for g in own_first
            if mode in g.modes and same(g, guard)
        ]
    target = guard_at(problem, impacts[-1]).next_mode
    return next((way for way, mode in ways if mode == target), None)
