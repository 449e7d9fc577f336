"""Simulation of systems of several coordinates, its linearisation, and impacts at random.

Each flight starts with the state that an impact, or a release, leaves. Of all guards that its mode
has, the one that is reached first ends it. At rigid walls impacts accumulate by the law of
`contimpact.simulation.run`; then the wall is held, and the motion goes on in the constrained
mode (`motions`), in which other walls may be hit and held. It ends where a contact ceases to
push, or where another impact moves the system off the wall.

Flights on which no wall is held are made by `linear_flights` or `integrated_flights`, plainly or
compiled, where all are linear, or integrated; nothing here is compiled.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..models.guards import orders_of, pivot, state_before
from ..models.model import Model
from ..segments.compiling import timed_plainly
from ..segments.flight import first_hit
from ..segments.integration import statement
from ..segments.kernels import Kernels
from ..segments.linear_flow import Shape
from ..segments.segment import ARRAYS, ELSEWHERE, FLOATS, evaluate_in
from .flights import (
    LEAST,
    NUDGE,
    SHORTEST,
    KernelWindow,
    TrackWindow,
    Window,
    departure_of,
    jump_derivative,
    of_guards,
    track_windows,
    windows,
)
from .linear_flights import runs_of
from .motions import Contact, IntegratedMotion, LinearMotion, ModeMotion
from .run import (
    BESIDE,
    CALM,
    EARLY,
    FASTER,
    LOW,
    SHORT,
    TOGETHER,
    Call,
    Outcome,
    OutsideError,
    PassageRule,
    Runs,
    Setting,
    State,
    columns_of,
    entered_guards,
    join_parts,
    wall_into,
    wrap_time,
)

TRIES = 10_000
PASSING, VAIN = 100, 1000
"""Trials after which the range of positions grows if flights pass a guard at once, and after which
such a flight is taken."""
GROWTH = 1.01
"""Factor by which the range of positions grows with each trial that lies beyond a guard."""

Piece = tuple[Array, Array, Array]
"""Times, gap coordinates and their velocities."""

MANY, STALLED = 100, 1e-6
"""Impacts that accumulate on guards that lead to other modes, if together they take less than this
part of a period."""
SLOW = 0.05
"""Flights after an impact slower than this part of the fastest may be short."""
SAMPLES, STEADY = 4, 1e-12
"""States at which directions of impacts are compared, and the part by which they may differ."""
MOVED = 1e-10
"""A wall is left by an impact elsewhere that gives it this part of the largest velocity; a guard is
passed at once, from its surface on, by this part of the fastest."""


def _faster(
    one: tuple[float, int, float], other: tuple[float, int, float]
) -> tuple[float, int, float]:
    """Return the faster of two arrivals at one time, the first if they are equally fast."""
    return other if abs(other[2]) > FASTER * abs(one[2]) else one


class Automaton:
    """A model at fixed parameter values, with all its modes and guards.

    A flight is given up after `longest` periods. `restitution` is that at low velocity; 1 where a
    guard leads to another mode.
    """

    costly = True

    def __init__(
        self,
        model: Model,
        kernels: Kernels,
        period: float,
        positions: Sequence[float],
        longest: int,
    ) -> None:
        self.kernels, self.guards, self.size = kernels, model.WALLS, model.DEGREES_OF_FREEDOM
        self.values, self.positions = tuple(model.values.values()), tuple(positions)
        self.period, self.longest = period, longest
        self.passages = kernels.passages
        self.first_mode = model.first_mode
        self.rows = tuple(np.array(guard.row(self.size), dtype=float) for guard in self.guards)
        self.restitution = of_guards(model, self._restitution)
        self._motions: dict[tuple[str, int], ModeMotion] = {}
        self._through = PassageRule(kernels, self.values, self.positions)

    # What is fixed with the parameters.

    @functools.cached_property
    def linear(self) -> tuple[bool, ...]:
        """Whether the flight after each guard is a linear one of the coordinates that there are."""
        return tuple(self.kernels.has_law(guard.name) for guard in self.guards)

    @functools.cached_property
    def tracked(self) -> tuple[bool, ...]:
        """Whether the flight after each guard is known from any state on: linear or integrated."""
        integrated = (self.kernels.integrated(guard.name) for guard in self.guards)
        return tuple(a or b for a, b in zip(self.linear, integrated, strict=True))

    def _after(self, wall: int, phase: float, section: Sequence[float]) -> Array:
        """Positions and velocities after an impact on a wall, shape (2, d)."""
        depart = departure_of(self.kernels, self.guards[wall].name, FLOATS)
        found = np.zeros((2, self.size))
        for row, part in zip(found, depart(phase, *section, *self.values), strict=True):
            row[: len(part)] = part
        return found

    @property
    def _low(self) -> tuple[float, ...]:
        """Section coordinates of an impact of low velocity, nothing else moving."""
        return (LOW, *[0.0] * (2 * self.size - 2))

    def _restitution(self, wall: int) -> float:
        if not self.guards[wall].rigid:
            return 1.0
        if not self.linear[wall]:
            name = self.guards[wall].name
            head = (0.0, *self._low, 0.0)
            return abs(float(self.kernels.motion(name)(*head, *self.values)[1])) / LOW
        return abs(float(self.rows[wall] @ self._after(wall, 0.0, self._low)[1])) / LOW

    def before(self, wall: int, section: Sequence[float]) -> tuple[list[float], list[float]]:
        """Return positions and velocities before an impact, from its section coordinates."""
        return state_before(self.rows[wall].tolist(), self.positions[wall], section)

    def contact(self, wall: int) -> Contact:
        """Return a wall as something to rest against."""
        direction, side = self._direction(wall, 0.0, self._low), self.guards[wall].side
        return Contact(wall, side, self.positions[wall], self.rows[wall], direction)

    def _direction(self, wall: int, phase: float, section: Sequence[float]) -> Array:
        """The direction in which an impact changes the velocities, by one."""
        d, row, inertia = self.size, self.rows[wall], self.has_inertia(wall)
        change = np.array(self.before(wall, section)[1]) - self._after(wall, phase, section)[1]
        if not inertia.all():
            change = np.where(inertia, change, 0.0)
            x, v = self.before(wall, (0.0, *section[1:]))
            change += self._rates(wall, phase, x, v)[1][:, d:] @ change
        found: Array = change / (row @ change)
        return found

    @functools.cached_property
    def _holds(self) -> tuple[bool, ...]:
        """Whether each guard is a wall against which the system can rest: impacts there push in one
        direction, whatever the state."""
        return tuple(
            tracked and self._is_wall(k) and self._is_steady(k)
            for k, tracked in enumerate(self.tracked)
        )

    def _is_steady(self, wall: int) -> bool:
        """Whether the direction is that of low velocity at some states, taken at random."""
        direction, generator = self.contact(wall).direction, np.random.default_rng(0)
        for phase, *section in generator.uniform(0.0, 1.0, (SAMPLES, 2 * self.size)).tolist():
            section[0] *= self.guards[wall].side
            try:
                found = self._direction(wall, phase * self.period, section)
            except (ArithmeticError, ValueError):
                return False
            if not np.max(np.abs(found - direction)) <= STEADY * np.max(np.abs(direction)):
                return False
        return True

    def has_inertia(self, wall: int) -> Array:
        """Return which coordinates are of second order in the mode after a guard."""
        mode = self.guards[wall].next_mode
        return np.array(orders_of(self.kernels.model.MODES, mode, self.size)) == 2

    def _rates(
        self, wall: int, phase: float, x: Sequence[float] | Array, v: Sequence[float] | Array
    ) -> tuple[Array, Array]:
        """The velocities of coordinates of first order, shape (d,), zero for others; and how they
        change with positions and velocities, shape (d, 2 d)."""
        rates, factors = self.kernels.rates(self.guards[wall].name)(phase, *x, *v, *self.values)
        return np.array(rates), np.reshape(factors, (self.size, 2 * self.size))

    def moving(
        self, wall: int, phase: float, x: Sequence[float] | Array, v: Sequence[float] | Array
    ) -> Array:
        """Return positions and velocities in the mode after a guard, in which those of coordinates
        of first order are by their laws."""
        inertia = self.has_inertia(wall)
        if not inertia.all():
            v = np.where(inertia, v, self._rates(wall, phase, x, v)[0])
        return np.concatenate([x, v])

    def motion(self, mode: str, held: int) -> ModeMotion:
        """Return the motion in a mode whose flights are `tracked`, some walls held."""
        if (mode, held) not in self._motions:
            wall = next(k for k, guard in enumerate(self.guards) if guard.next_mode == mode)
            contacts = [self.contact(k) for k in range(len(self.guards)) if held >> k & 1]
            self._motions[mode, held] = self._moving_by_law(wall, contacts)
        return self._motions[mode, held]

    def _moving_by_law(self, wall: int, contacts: Sequence[Contact]) -> ModeMotion:
        """The motion after a guard, some contacts held."""
        name = self.guards[wall].name
        if self.linear[wall]:
            section = [0.0] * (2 * self.size - 1)
            d, h, numbers, _ = self.kernels.law(name)(0.0, *section, *self.values)
            return LinearMotion(Shape(int(d), int(h), 0), numbers, self.size, contacts)
        field = self.kernels.field_text(name)
        values = dict(zip(self.kernels.model.values, self.values, strict=True))
        parameters = [values[p.removeprefix("p_")] for p in statement(field).parameters]
        return IntegratedMotion(field, parameters, self.size, contacts)

    def flying(self, wall: int, held: int) -> ModeMotion:
        """Return the motion after a guard, some walls held."""
        return self.motion(self.guards[wall].next_mode, held)

    @functools.cached_property
    def _holdable(self) -> tuple[int, ...]:
        """The walls of the mode after each guard, a bit for each."""
        return tuple(
            sum(1 << k for k, meets in enumerate(row) if meets and self._holds[k])
            for row in self.passages.watched
        )

    @functools.cached_property
    def fastest(self) -> float:
        """The velocity that half a period of the largest acceleration at rest gives."""
        largest, phases = 0.0, np.linspace(0.0, self.period, 17)[:-1]
        at_rest = [phases, *(0.0 * phases for _ in range(2 * self.size))]
        for guard, row in zip(self.guards, self.rows, strict=True):
            with np.errstate(all="ignore"):
                a = evaluate_in(self.kernels.motion(guard.name), ARRAYS)(*at_rest, *self.values)[2]
            sizes = np.abs(a) / np.linalg.norm(row)
            largest = float(np.max(sizes, where=np.isfinite(sizes), initial=largest))
        return 0.5 * self.period * largest or 1.0

    # One flight.

    def leave(self, state: State) -> tuple[Array, int]:
        """Return X as an impact or a release leaves it, and the walls held from there on."""
        motion = self.flying(state.wall, 0)
        if state.released:
            held = state.held & ~(1 << state.wall)
            found = motion.embedded(*self.before(state.wall, state.section), state.phase)
        else:
            x, v = self._after(state.wall, state.phase, state.section)
            found = motion.embedded(x, v, state.phase)
            held = state.held & ~self._moved(found, state.held) & self._holdable[state.wall]
            if self._comes_to_rest(state, found, held):
                held |= 1 << state.wall
            elif held != state.held:
                held = self._come_to_rest_together(state, found) or held
        return self.flying(state.wall, held).resting(found), held

    def _moved(self, after: Array, held: int) -> int:
        """The held walls that an impact has moved the system off, or against."""
        v = after[self.size : 2 * self.size]
        least = MOVED * float(np.max(np.abs(v)))
        moved = (k for k, row in enumerate(self.rows) if held >> k & 1 and abs(row @ v) > least)
        return sum(1 << k for k in moved)

    def _comes_to_rest(self, state: State, after: Array, held: int) -> bool:
        """Whether the impacts that follow are so short that what is left of them is known."""
        wall, free = state.wall, self.flying(state.wall, held)
        acceleration = float(self.rows[wall] @ free.rate(free.resting(after))[self.size :])
        speed = self.restitution[wall] * abs(state.velocity)
        rest = self._rest(wall, speed, acceleration)
        return self._stays_held(wall, after, held | 1 << wall, rest)

    def _come_to_rest_together(self, state: State, after: Array) -> int:
        """The walls held until an impact that moves the system off or against them, and its own, if
        impacts on all of these in turn are so short; zero if they are not."""
        d, own = self.size, 1 << state.wall
        walls, rest = state.held & self._holdable[state.wall] | own, 0.0
        for k, row in enumerate(self.rows):
            if walls >> k & 1:
                others = self.flying(state.wall, walls & ~(1 << k))
                acceleration = float(row @ others.rate(others.resting(after))[d:])
                speed = abs(float(row @ after[d : 2 * d]))
                rest = max(rest, self._rest(k, speed, acceleration))
        return walls if self._stays_held(state.wall, after, walls, rest) else 0

    def _stays_held(self, wall: int, after: Array, held: int, rest: float) -> bool:
        """Whether impacts that take so long are short, and leave walls that stay held."""
        if not (self._holds[wall] and rest <= SHORT * self.period):
            return False
        motion, length = self.flying(wall, held), SHORTEST * self.period
        begin = motion.resting(after)
        while length >= LEAST * self.period:
            try:
                released = motion.release(motion.track(begin, length))
            except InputError:
                raise
            except ArithmeticError:  # the flow does not stay finite for so long
                length *= 0.5
            else:
                return released is None or (released[0] > 0.0 and rest <= EARLY * released[0])
        return False

    def _rest(self, wall: int, speed: float, acceleration: float) -> float:
        """The time in which impacts accumulate on a wall; infinite if they do not.

        It takes the speed after the first one, and the acceleration of the gap coordinate.
        """
        e, force = self.restitution[wall], self.guards[wall].side * acceleration
        if not self._is_wall(wall) or e >= 1.0 or not force > 0.0:
            return math.inf
        return 2.0 * speed / (force * (1.0 - e))

    def _accumulates(self, state: State) -> bool:
        """Whether impacts accumulate on a wall that cannot be held."""
        if self._holds[state.wall]:
            return False
        motion = self.kernels.motion(self.guards[state.wall].name)
        acceleration = motion(state.phase, *state.section, 0.0, *self.values)[2]
        speed = self.restitution[state.wall] * abs(state.velocity)
        return self._rest(state.wall, speed, float(acceleration)) <= SHORT * self.period

    @np.errstate(over="ignore", invalid="ignore")
    def next(self, state: State, fastest: float = math.inf) -> State | Outcome:
        """Return the next impact or release, or why there is none; what is faster than `fastest`,
        or no finite number, runs away."""
        if self._accumulates(state):
            return Outcome.ACCUMULATING
        left = state.wall
        resting = False
        for number, (window, held) in enumerate(self._windows(state)):
            resting = held != 0
            if isinstance(window, TrackWindow) and not window.speed <= fastest:
                return Outcome.RUNAWAY
            if number == 0 and (self._beyond(window, left) or (not held and self.passes(state))):
                return Outcome.BEYOND
            first = left if number == 0 else None
            found = self._first_in_parts(window, held, first, left, fastest)
            if isinstance(found, Outcome):
                return found
            if found is not None:
                at = found[0]
                phase, passed = wrap_time(state.phase + at, self.period)
                return self._through(replace(found[1], phase=phase, turns=state.turns + passed))
        return Outcome.RESTING if resting else Outcome.NO_IMPACT

    def _windows(self, state: State) -> Iterator[tuple[Window, int]]:
        """The windows of the flight from a state, and the walls held in it."""
        wall = state.wall
        short = abs(state.velocity) < SLOW * self.fastest
        lengths = windows(self.period, self.longest, short)
        if self.tracked[wall]:
            start, held = self.leave(state)
            for one in track_windows(self.flying(wall, held), start, state.phase, lengths):
                yield one, held
            return
        known = (self.kernels, self.values, self.guards[wall], self.positions[wall], state)
        for begin, length in lengths:
            yield KernelWindow(*known, begin, length), 0

    def _first_in_parts(
        self, window: Window, held: int, left: int | None, mode_of: int, fastest: float
    ) -> tuple[float, State] | Outcome | None:
        """The first arrival or release in a window: when after the flight's start, and the state.

        Where the flow does not stay finite to the window's end it is halved: a guard may come
        before. If none does, the motion runs away, or comes to where the law has no value.
        """
        try:
            found = self._first(window, held, left, mode_of)
            return None if found is None else (found[0] + window.begin, found[1])
        except InputError:
            raise
        except (ArithmeticError, ValueError):
            half = 0.5 * window.length
        if half < LEAST * self.period:
            watched = (self.guards[k[0]] for k in self._watched(mode_of, held))
            rates = [abs(window.beginning(guard)[1]) for guard in watched]
            rates += [window.speed] if isinstance(window, TrackWindow) else []
            slow = all(rate <= CALM * fastest for rate in rates)
            return Outcome.UNDEFINED if slow else Outcome.RUNAWAY
        for begin, first in ((window.begin, left), (window.begin + half, None)):
            part = replace(window, begin=begin, length=half)
            there = self._first_in_parts(part, held, first, mode_of, fastest)
            if there is not None:
                return there
        return None

    def _first(
        self, window: Window, held: int, left: int | None, mode_of: int
    ) -> tuple[float, State] | None:
        """The first arrival or release in a window: when, and the state but for its time."""
        hits = [
            hit
            for numbers in self._watched(mode_of, held)
            if (hit := self._arrival(window, numbers, left)) is not None
        ]
        released = window.release() if held else None
        if hits:
            earliest = min(hit[0] for hit in hits)
            together = [hit for hit in hits if hit[0] <= earliest + TOGETHER * self.period]
            _, wall, speed = functools.reduce(_faster, together)
            dt = max(hit[0] for hit in together)  # the others have then arrived, too
            if released is None or dt < released[0]:
                section = window.section(self.guards[wall], dt, speed)
                return dt, State(wall, 0.0, speed, 0, section[1:], held)
        if released is None:
            return None
        dt, contact = released
        section = window.section(self.guards[contact.number], dt, 0.0)
        return dt, State(contact.number, 0.0, 0.0, 0, section[1:], held, released=True)

    def _watched(self, left: int, held: int) -> list[list[int]]:
        """The guards that a flight can meet, those on one coordinate together."""
        found: dict[Any, list[int]] = {}
        for k, meets in enumerate(self.passages.watched[left]):
            if meets and not held >> k & 1:
                found.setdefault(self.guards[k].row(self.size), []).append(k)
        return list(found.values())

    def _arrival(
        self, window: Window, numbers: Sequence[int], left: int | None
    ) -> tuple[float, int, float] | None:
        """When a window's coordinate first arrives at one of its guards: time, guard, velocity."""
        row = self.guards[numbers[0]].row(self.size)
        own = left is not None and self.guards[left].row(self.size) == row
        (low, below), (high, above) = (self._nearest(numbers, side) for side in (-1, 1))
        if not own:
            lowest, highest = window.bounds(self.guards[numbers[0]])
            if low < lowest and highest < high:
                return None
        curve, breaks, origin = window.coordinate(self.guards[numbers[0]])
        _, speed, force = curve((), 0.0, ())
        rising = speed > 0.0 or (speed == 0.0 and force > 0.0)
        from_wall = left if own else self._released_with(window, numbers, left)
        touched = None if own else self._touching(numbers, left, speed, force)
        if touched is not None:
            origin, rising = self.positions[touched], self.guards[touched].side < 0
            breaks = [t for t in breaks if t > NUDGE * self.period]
        if from_wall is not None:
            if self._stays(from_wall):
                origin = self.positions[from_wall]
            if self.passages.leaving[from_wall]:
                rising = self.passages.leaving[from_wall] < 0.0
            if abs(speed) <= window.rounding(self.guards[numbers[0]]) or not own:
                breaks = [t for t in breaks if t > NUDGE * self.period]
        times = [*(t for t in breaks if 0.0 < t < window.length), window.length]
        around = low - origin, high - origin
        side, dt, speed, _ = first_hit(curve, (), (), times, 0.0, rising, *around)
        return (dt, above if side > 0 else below, speed) if side else None

    def _released_with(
        self, window: Window, numbers: Sequence[int], left: int | None
    ) -> int | None:
        """The wall on which a coordinate rests where a flight begins, without a force to rounding:
        it was released together with the wall left."""
        if left is None or not isinstance(window, TrackWindow):
            return None
        guard = self.guards[numbers[0]]
        for k in (k for k in numbers if self._is_wall(k)):
            if window.rests(guard, self.positions[k], self.period):
                return k
        return None

    def _touching(
        self, numbers: Sequence[int], left: int | None, speed: float, force: float
    ) -> int | None:
        """The guard on whose surface the flight begins without a rate but for rounding, which must
        not decide whether it is passed at once, and from which it goes back into its mode."""
        if left is None or abs(speed) > MOVED * self.fastest:
            return None
        begun = (k for k in self.passages.beginning(left) if k in numbers)
        return next((k for k in begun if self.guards[k].side * force < 0.0), None)

    def _stays(self, left: int) -> bool:
        """Whether the motion goes on from the surface of the guard that it leaves."""
        return self.passages.arrivals[left][left] != ELSEWHERE

    def _is_wall(self, wall: int) -> bool:
        """Whether the motion goes on there in the same mode, so that it may come to rest."""
        return self._walls[wall]

    @functools.cached_property
    def _walls(self) -> tuple[bool, ...]:
        """The same of each guard; on a coordinate without inertia it goes on otherwise."""
        return tuple(
            guard.rigid and self._stays(k) and bool(np.any(self.rows[k][self.has_inertia(k)]))
            for k, guard in enumerate(self.guards)
        )

    def _beyond(self, window: Window, left: int) -> bool:
        """Whether a jump has led behind a guard of the next mode."""
        for k in self._entered[left]:
            begin, _ = window.beginning(self.guards[k])
            slack = BESIDE * abs(begin) if self._stays(left) else 0.0
            if self.guards[k].side * (self.positions[k] - begin) < -slack:
                return True
        return False

    @functools.cached_property
    def _entered(self) -> list[list[int]]:
        """After each guard, those of its mode behind which the flight may begin."""
        count = len(self.guards)
        table = np.reshape(entered_guards(self.guards, self.passages), (count, count))
        return [np.flatnonzero(row).tolist() for row in table]

    def passes(self, state: State) -> bool:
        """Whether the flight after an impact begins on the surface of a guard of its mode and
        passes it at once."""
        left = self.guards[state.wall]
        for k in () if state.released else self.passages.beginning(state.wall):
            own = self.guards[k].row(self.size) == left.row(self.size)
            name = self.guards[k].name
            kernel = self.kernels.motion(left.name) if own else self.kernels.gap(left.name, name)
            rate = kernel(state.phase, *state.section, 0.0, *self.values)[1]
            if self.guards[k].side * rate > MOVED * self.fastest:
                return True
        return False

    def _nearest(self, numbers: Sequence[int], side: int) -> tuple[float, int]:
        """Position and number of the nearest guard on a side; infinitely far if there is none."""
        there = [(side * self.positions[k], k) for k in numbers if self.guards[k].side == side]
        place, wall = min(there, default=(math.inf, -1))
        return side * place, wall

    def fly(
        self, wall: int, phase: float, velocity: float, others: tuple[float, ...] = ()
    ) -> tuple[int, float, float]:
        """Return the wall hit next, the time until then and the velocity before that impact."""
        found = self.next(State(wall, phase, velocity, others=others))
        if isinstance(found, Outcome):
            return -1, math.inf, velocity
        return found.wall, found.turns * self.period + found.phase - phase, found.velocity

    def pressed(self, wall: int, phase: float) -> tuple[bool, float]:
        """Refuse to say when a wall is pressed: the phase does not tell."""
        found = f"{self.kernels.model.SYSTEM} has more than one coordinate between two walls"
        raise InputError("pressed", found, "use state and run")

    def law_in(self, mode: str) -> LinearMotion | None:
        """Return the motion in a mode, no wall held, if it is linear."""
        after = zip(self.guards, self.tracked, strict=True)
        tracked = all(is_tracked for guard, is_tracked in after if guard.next_mode == mode)
        motion = self.motion(mode, 0) if tracked else None
        return motion if isinstance(motion, LinearMotion) else None

    def derivative(self, before: State, after: State) -> Array:
        """Return the derivative of the map from one row of a run to the next, shape (2 d, 2 d).

        It is infinite where the velocity of the second vanishes.
        """
        simple = not (before.released or after.released or after.held)
        found = (_segment_jacobian if simple else _track_jacobian)(self, before, after)
        return found if np.all(np.isfinite(found)) else np.full(found.shape, np.inf)

    def derivatives(self, states: Sequence[State], along: bool = False) -> Array:
        """Return the same from each of some states to the next, shape (N, 2 d, 2 d): of closed
        flights between the same guards at once; of integrated ones, if asked, along the flow from
        each state on, which is fast, and loses the digits by which disturbances grow."""
        found = np.empty((len(states) - 1, 2 * self.size, 2 * self.size))
        together: dict[tuple[int, int], list[int]] = {}
        for k, (before, after) in enumerate(itertools.pairwise(states)):
            ends = self.guards[before.wall].name, self.guards[after.wall].name
            apart = before.released or after.released or after.held or self.kernels.flown(*ends)
            if apart:
                by = _track_jacobian if along else Automaton.derivative
                found[k] = by(self, before, after)
            else:
                together.setdefault((before.wall, after.wall), []).append(k)
        for places in together.values():
            for first in range(0, len(places), AT_ONCE):
                part = places[first : first + AT_ONCE]
                found[part] = _segment_jacobians(self, [(states[k], states[k + 1]) for k in part])
        found[~np.isfinite(found).all(axis=(1, 2))] = np.inf
        return found

    # Runs.

    def joined(self, parts: Sequence[Sequence[Any]]) -> dict[str, Array]:
        """Return the columns of a run from those of its parts."""
        return join_parts(parts, 2 * self.size - 2)

    def random(self, generator: np.random.Generator) -> State:
        """Return an impact at random: guard, phase, and a state within the guards of its mode,
        after which no guard is passed at once if there are such.

        Velocities are up to `fastest`, positions first up to what that gives in a period.
        """
        wall = int(generator.integers(len(self.guards)))
        phase = float(generator.uniform(0.0, self.period))
        speed, side = self.fastest, self.guards[wall].side
        reach = 0.1 * speed * self.period
        for attempt in range(TRIES):
            others = generator.uniform(-1.0, 1.0, 2 * self.size - 2)
            others[::2] *= reach
            others[1::2] *= speed
            velocity = side * float(generator.uniform(0.0, speed))
            section = (velocity, *others.tolist())
            state = State(wall, phase, velocity, others=section[1:])
            within = self._is_within_guards(wall, section)
            if within and (attempt >= VAIN or self._begins(state)):
                break
            if not within or attempt >= PASSING:
                reach *= GROWTH
        return state

    def _begins(self, state: State) -> bool:
        """Whether the flight after an impact has values, and is not behind a guard at once."""
        try:
            if self._entered[state.wall] and self._beyond(
                next(self._windows(state))[0], state.wall
            ):
                return False
            return not self.passes(state)
        except (ArithmeticError, ValueError):
            return False

    def _is_within_guards(self, wall: int, section: tuple[float, ...]) -> bool:
        """Whether a state before an impact is within the other guards of a mode that it ends."""
        x = np.array(self.before(wall, section)[0])
        beyond = [
            guard
            for k, (guard, row, place) in enumerate(
                zip(self.guards, self.rows, self.positions, strict=True)
            )
            if k != wall and not guard.side * (place - row @ x) >= 0.0
        ]
        return any(all(m not in g.modes for g in beyond) for m in self.guards[wall].modes)

    def path(self, states: Sequence[State], times: Array, points: int) -> Piece:
        """Return the gap coordinate of every guard from state to state, and their velocities.

        The N states are at `times`; each flight has `points`.
        """
        parts = []
        for k in range(len(states) - 1):
            state, length = states[k], float(times[k + 1] - times[k])
            dt = np.linspace(0.0, length, points)
            if self.tracked[state.wall]:
                x, v = self._gaps_by_law(state, states[k + 1].held, dt)
            else:
                x, v = self._gaps_by_kernels(state, dt)
            parts.append((times[k] + dt, x, v))
        t, x, v = (np.concatenate(column) for column in zip(*parts, strict=True))
        return t, x, v

    def _gaps_by_law(self, state: State, held: int, dt: Array) -> tuple[Array, Array]:
        d, motion = self.size, self.flying(state.wall, held)
        begin, _ = self.leave(state)
        if dt[-1] > 0.0:
            track = motion.track(begin, float(dt[-1]))
            found = np.array([track.at(t) for t in dt.tolist()])
        else:
            found = np.tile(begin, (len(dt), 1))
        rows = np.array(self.rows).T
        return found[:, :d] @ rows, found[:, d : 2 * d] @ rows

    def _gaps_by_kernels(self, state: State, dt: Array) -> tuple[Array, Array]:
        left = self.guards[state.wall].name
        kernels = (self.kernels.gap(left, guard.name) for guard in self.guards)
        head = (state.phase + 0.0 * dt, *(y + 0.0 * dt for y in state.section))
        moved = [evaluate_in(kernel, ARRAYS)(*head, dt, *self.values) for kernel in kernels]
        return np.array([x for x, _, _ in moved]).T, np.array([v for _, v, _ in moved]).T

    def make(
        self, state: State, span: tuple[int, int], asked: int, record: bool, fastest: float
    ) -> tuple[State, Outcome, int, list[list[Any]]]:
        """Make so many rows at most, up to some turn, unless the run ends before, or runs away.

        Returns the last state, why the run ended, the number of rows, and their columns in parts.
        """
        most, last = span
        parts: list[list[Any]] = []
        rows: list[State] = []
        made, outcome = 0, Outcome.DONE
        seen, before = 0, state
        while made < most and state.turns < last:
            if made >= seen + MANY:
                stalls = state.since(before, self.period) < STALLED * self.period
                if stalls and not self._is_wall(state.wall):
                    outcome = Outcome.ACCUMULATING
                    break
                seen, before = made, state
            if self._runs is not None and not (state.held or state.released):
                alone = bool(self._through.pairs)  # which guard is met is told after each flight
                count = 1 if alone else min(most - made, AT_ONCE)
                given = (count, last), asked, record and not alone, fastest
                state, why, count, columns = self._runs.make(state, *given)
                made += count
                if alone:
                    state = self._through(state)
                    rows += [state] * count if record else []
                else:
                    parts += [columns_of(rows), columns]
                    rows = []
                outcome = why or Outcome.DONE
                if outcome is not Outcome.DONE:
                    break
                if why is not None:
                    continue
            with timed_plainly(self._runs.engine.identity if self._runs else ()):
                slow = state.speed <= fastest
                found = self.next(state, fastest) if slow else Outcome.RUNAWAY
            if self._runs is not None:
                self._runs.engine.plain += 1
            if isinstance(found, Outcome):
                outcome = found
                break
            state, made = found, made + 1
            if record:
                rows.append(state)
        return state, outcome, made, [*parts, columns_of(rows)]

    def batch(self, asked: int) -> Call | None:
        """Return compiled code for many motions; None if there is none, or it does not pay."""
        if self._runs is None or self._through.pairs:
            return None
        return self._runs.batch(asked)

    @property
    def dear(self) -> bool:
        """Whether compiled flights take long."""
        return self._runs is not None and self._runs.dear

    @functools.cached_property
    def _runs(self) -> Runs | None:
        """What makes flights on which no wall is held, if all are linear, or integrated."""
        fixed = self.kernels, self.values, self.positions, self.restitution
        return runs_of(Setting(*fixed, self.period, self.longest))

    def start(
        self, time: float, position: Sequence[float], velocity: Sequence[float], mode: str
    ) -> State | None:
        """Return the first impact of a system that starts anywhere, in a mode; None for none."""
        mode = mode or self.first_mode
        wall = self._wall_of_start(position, mode)
        turns = math.floor(time / self.period)
        phase, motion = time - turns * self.period, self.motion(mode, 0)
        x, v = self.moving(wall, phase, position, velocity).reshape(2, -1)
        begin = motion.embedded(x, v, phase)
        lengths = windows(self.period, self.longest, short=False)
        for window in track_windows(motion, begin, phase, lengths):
            first = self._first_in_parts(window, 0, None, wall, math.inf)
            if isinstance(first, Outcome):
                return None
            if first is not None:
                at, passed = wrap_time(phase + first[0], self.period)
                return self._through(replace(first[1], phase=at, turns=turns + passed))
        return None

    def _wall_of_start(self, position: Sequence[float], mode: str) -> int:
        """A guard that leads into the mode of a start; refused where the mode's flights are not
        known from anywhere, or the start lies beyond one of its guards."""
        wall, system = wall_into(self.kernels.model, mode), self.kernels.model.SYSTEM
        if not self.tracked[wall]:
            found = f"the flights of {system} are known from guards on"
            raise InputError("position", found, "start at a guard")
        for k, (guard, row) in enumerate(zip(self.guards, self.rows, strict=True)):
            gap = guard.side * (self.positions[k] - float(row @ np.array(position)))
            if self.passages.watched[wall][k] and not gap >= 0.0:
                raise self._outside_error(list(position), guard.name, mode)
        return wall

    def _outside_error(self, position: list[float], guard: str, mode: str) -> InputError:
        """A start beyond a guard of its mode."""
        found, accepted = f"{position} is beyond {guard}", "start within the guards"
        if not mode:
            return OutsideError("position", found, accepted)
        others = dict.fromkeys(g.next_mode for g in self.guards if g.next_mode != mode)
        named = " or ".join(f"mode={other!r}" for other in others)
        found += f", at which the mode {mode!r} ends"
        return OutsideError("position", found, f"{accepted}, or give {named}")


# The derivative of the map from one impact, or release, to the next.
#
# It acts on disturbances of (time, section coordinates). Between two impacts it is :math:`-B^{-1}A`
# with the blocks of the segment. Where walls are held, or released, it is put together from the law
# of the constrained mode: the disturbance that the jump leaves, at a fixed time, what the flow
# makes of it, and the time by which the event's function h comes earlier or later,
#
# .. math:: \delta X^+ = \frac{\partial X^+}{\partial y}\,\delta y - f^+\,\delta t, \qquad
#           \delta t_1 = -\frac{\nabla h \cdot \delta X}{\nabla h \cdot f}, \qquad
#           \delta X_1 = \delta X + f\,\delta t_1 ,
#
# which is the saltation matrix of the event (R. I. Leine and H. Nijmeijer, Dynamics and
# Bifurcations of Non-Smooth Mechanical Systems, 2004, ch. 7). A wall that comes to be held projects
# the disturbance onto its surface.


def _segment_jacobian(automaton: Automaton, before: State, after: State) -> Array:
    names = [automaton.guards[state.wall].name for state in (before, after)]
    start, end = before.flight_to(after, automaton.period)
    segment = automaton.kernels.segment(names[0], names[1])
    _, leaving, arriving, _ = segment.blocks(start, end, automaton.values)
    m = len(start)
    try:
        blocks = np.array(arriving).reshape(m, m), np.array(leaving).reshape(m, m)
        return -np.linalg.solve(*blocks)
    except np.linalg.LinAlgError:
        return np.full((m, m), np.inf)


AT_ONCE = 1024
"""Flights made, and of which derivatives are computed, at once."""


def _segment_jacobians(automaton: Automaton, pairs: Sequence[tuple[State, State]]) -> Array:
    """The same of many flights between the same guards."""
    names = [automaton.guards[state.wall].name for state in pairs[0]]
    rows = [before.flight_to(after, automaton.period) for before, after in pairs]
    start, end = np.array(rows).transpose(1, 2, 0)
    m, count = start.shape
    blocks = automaton.kernels.segment(*names).over(ARRAYS)
    with np.errstate(all="ignore"):
        _, leaving, arriving, _ = blocks(start, end, automaton.values)
    one, other = (
        np.array([np.broadcast_to(x, count) for x in block]).T.reshape(count, m, m)
        for block in (arriving, leaving)
    )
    try:
        return np.asarray(-np.linalg.solve(one, other))
    except np.linalg.LinAlgError:
        return np.array([_segment_jacobian(automaton, *pair) for pair in pairs])


def _track_jacobian(automaton: Automaton, before: State, after: State) -> Array:
    d = automaton.size
    motion = automaton.flying(before.wall, after.held)
    begin, _ = automaton.leave(before)
    left = _departure_derivative(automaton, motion, before)
    left[:, 0] -= motion.rate(begin)
    disturbed = motion.flowed(begin, after.since(before, automaton.period)) @ left
    row = automaton.rows[after.wall]
    end = motion.embedded(*automaton.before(after.wall, after.section), after.phase)
    with np.errstate(divide="ignore", invalid="ignore"):  # what only touches comes at any time
        late = _delays(motion, after, row, end) @ disturbed
        moved = disturbed + np.outer(motion.rate(end), late)
    others = _section_rows(row, d)
    return np.vstack([late, others @ moved])


def _departure_derivative(automaton: Automaton, motion: ModeMotion, before: State) -> Array:
    """How the state after an impact or a release depends on the time and the section coordinates
    before it, shape (2 d, 2 d)."""
    d, row = automaton.size, automaton.rows[before.wall]
    if before.released:
        units = (state_before(row.tolist(), 0.0, unit) for unit in np.eye(2 * d - 1).tolist())
        found = np.array([np.zeros(2 * d), *map(np.concatenate, units)]).T
    else:
        name = automaton.guards[before.wall].name
        found = jump_derivative(automaton.kernels, name, before, automaton.values)
    if motion.contacts:
        pushed = motion.directions @ motion.inverse @ motion.rows
        found[:d] -= pushed @ found[:d]
        found[d:] -= pushed @ found[d:]
    return found


def _delays(motion: ModeMotion, after: State, row: Array, end: Array) -> Array:
    """How much later the event comes, for each disturbance of the state."""
    if after.released:
        places = [contact.number for contact in motion.contacts]
        slopes, rate = motion.reaction_slopes(places.index(after.wall), end)
    else:
        slopes = np.concatenate([row, np.zeros(len(row))])
        rate = row @ motion.moving(end)[1]
    found: Array = -slopes / np.float64(rate)
    return found


def _section_rows(row: Array, d: int) -> Array:
    """The section coordinates as combinations of positions and velocities."""
    others = [i for i in range(d) if i != pivot(row.tolist())]
    unit = np.eye(2 * d)
    speed = np.concatenate([np.zeros(d), row])
    return np.array([speed, *(unit[j] for i in others for j in (i, d + i))])
