"""Simulation of systems of one coordinate, plainly and compiled.

Their flights are displacements from a wall alone, so that they are simulated by the fast loop of
`run`, plainly or compiled.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import INTEGERS, VECTOR, Array
from ..errors import InputError
from ..models.model import Model
from ..segments.compiling import timed_plainly
from ..segments.flight import chebyshev_zeros, first_arrival, rounding_along, time_zeros
from ..segments.kernel import Family
from ..segments.kernels import Kernels
from ..segments.segment import ARRAYS, Kernel, evaluate_in, neighbouring_guards
from .flights import FlightInState, fly_in_time, motion_at, of_guards, start_integrated
from .run import (
    COLUMNS,
    Body,
    Call,
    Engine,
    Hold,
    Outcome,
    OutsideError,
    Runs,
    Setting,
    State,
    coefficient,
    fly_or_stick,
    formulas,
    glue_entry,
    hold_of,
    join_parts,
    make_flights,
    pressing_at,
    rest_after,
    slow_velocity,
    wall_into,
    wall_on,
    wrap_time,
)

if TYPE_CHECKING:
    from ..segments.machine_code import Program


# The loop of a simulation as a compiled program.

BODY = VECTOR * 3 + INTEGERS * 4 + VECTOR * 5 + INTEGERS * 4
"""Kinds of a body's fields."""
ARGUMENTS = BODY + VECTOR + INTEGERS + VECTOR + COLUMNS + INTEGERS
"""Kinds of the entry's arguments, as in `linear_flights`."""

FLY = """
def fly_on(body, wall, phase, velocity):
    return fly_in_time(any_motion, body, wall, phase, velocity)

def fly(body, wall, phase, space):
    return fly_or_stick(fly_on, any_motion, body, wall, phase, space)
"""


def program_of(motions: Sequence[Kernel]) -> Program:
    """Return the program that simulates from impact to impact."""
    from ..segments.machine_code import Program

    program = Program({})
    names = {f"motion_{wall}": motion for wall, motion in enumerate(motions)}
    numbers = ", ".join(f"p[{i}]" for i in range(motions[0].__code__.co_argcount - 3))
    given = f"head[1], head[2], dt, {numbers}"
    program.choose("any_motion", "head, dt, p", "head[0]", names, given)
    program.glue(FLY, fly_in_time=fly_in_time, fly_or_stick=fly_or_stick)
    glue_entry(program, Body)
    return program


class ImpactRuns(Runs):
    """Runs by the fast loop, plainly or compiled; plainly alone if the acceleration depends on the
    state: compiled code does not find its zeros."""

    fields, size = BODY, 1

    def __init__(
        self,
        body: Body,
        motions: Sequence[Kernel],
        motion: Callable[..., Any],
        fly: Callable[..., Any],
        in_time: bool,
    ) -> None:
        self.flights, self.fly = body, functools.partial(fly_or_stick, fly, motion)
        identity, build = ("simulate", *formulas(motions)), functools.partial(program_of, motions)
        self.engine = Engine.of(identity, ARGUMENTS, build) if in_time else Engine((), "", None)

    def room(self) -> list[Array]:
        return [np.zeros(2)]

    def make_plainly(self, at: Any, when: Any, columns: Sequence[Any], span: Any) -> int:
        given: Any = ([0.0, 0.0], at, when, *columns, span)
        return make_flights(self.fly, self.flights, *given)


# The derivative of the map from one impact to the next.


def derivative_of_pair(
    kernels: Kernels, values: Sequence[float], period: float
) -> Callable[[State, State], tuple[tuple[float, float], tuple[float, float]]]:
    """Return what gives the derivative of the map between two impacts, of one degree of freedom.

    Its rows are for (time, velocity before impact): -B^-1 A with the blocks of the flight kernel.
    A velocity of zero at the end makes it infinite.
    """
    letters = kernels.model.letters
    watched = kernels.passages.watched
    places = range(len(letters))
    flights = {
        (a, b): kernels.flight(letters[a], letters[b])
        for a in places
        for b in places
        if watched[a][b]
    }

    def derivative(start: State, end: State) -> tuple[tuple[float, float], tuple[float, float]]:
        t1 = end.phase + (end.turns - start.turns) * period
        kernel = flights[start.wall, end.wall]
        _, leaving, arriving, _ = kernel(start.phase, start.velocity, t1, end.velocity, *values)
        a11, a12, a21, a22 = leaving
        b11, b12, b21, b22 = arriving
        det = b11 * b22 - b12 * b21
        if det == 0.0:
            return ((math.inf,) * 2,) * 2
        return (
            ((b12 * a21 - b22 * a11) / det, (b12 * a22 - b22 * a12) / det),
            ((b21 * a11 - b11 * a21) / det, (b21 * a12 - b11 * a22) / det),
        )

    return derivative


class OneCoordinate:
    """A model of one degree of freedom with, on each side in each mode, at most one wall.

    A flight is given up after `longest` periods. `restitution` is that at low velocity, 1 where a
    guard leads to another mode; `motions` are those after each wall; `zeros` are where in a period
    the acceleration changes sign, None if it depends on the state; `costly` says whether an impact
    takes far longer than in the fast loop.
    """

    costly = False

    def __init__(
        self,
        model: Model,
        kernels: Kernels,
        period: float,
        positions: Sequence[float],
        longest: int,
    ) -> None:
        guards = model.WALLS
        self.model, self.kernels, self.period, self.longest = model, kernels, period, longest
        self.positions, self.sides = tuple(positions), tuple(wall.side for wall in guards)
        self.values = tuple(model.values.values())
        self._met = [neighbouring_guards(guards, kernels.passages, k) for k in range(len(guards))]
        self.motions = tuple(kernels.motion(wall.name) for wall in guards)
        self._motion = motion_at(self.motions, self.values)
        self.zeros = time_zeros(kernels.harmonics(*self.values), period)
        self._holds = of_guards(model, self._hold)
        fastest = [hold.bound * period for hold in self._holds]

        def restitution(k: int) -> float:
            return coefficient(self._motion, k, fastest[k]) if guards[k].rigid else 1.0

        self.restitution = of_guards(model, restitution)
        self.body = self._as_body()

    def _around(self, position: float, wall: int = 0) -> tuple[float, float]:
        """Displacements, from a position, of the walls below and above that end the flight from a
        wall."""
        below, above = self._met[wall]
        low = self.positions[below] - position if below >= 0 else -math.inf
        return low, self.positions[above] - position if above >= 0 else math.inf

    def _hold(self, wall: int) -> Hold:
        """When a body at rest on a wall is pressed against it."""
        kernel, period = self.motions[wall], self.period
        vectorised = evaluate_in(kernel, ARRAYS)

        def held(phase: Any) -> Any:
            return vectorised(phase, 0.0 * phase, 0.0 * phase, *self.values)[2]

        def rounding(phase: float) -> float:
            return rounding_along(kernel, (phase, 0.0), self.values)(0.0)

        zeros = self.zeros
        if zeros is None:
            zeros = chebyshev_zeros(held, period, rounding=rounding)
        return hold_of(held, zeros, self.sides[wall], period)

    def _as_body(self) -> Body:
        """What is fixed with the parameters, as lists."""
        around = [self._around(position, k) for k, position in enumerate(self.positions)]
        leaving = self.kernels.passages.leaving
        pairs = zip(self.restitution, self._holds, strict=True)
        return Body(
            values=list(self.values),
            clock=[self.period],
            zeros=self.zeros or [],
            sides=list(self.sides),
            leaving=[int(side) for side in leaving],
            below=[below for below, _ in self._met],
            above=[above for _, above in self._met],
            low=[low for low, _ in around],
            high=[high for _, high in around],
            restitution=list(self.restitution),
            slow=[slow_velocity(e, hold.bound, self.period) for e, hold in pairs],
            edges=[edge for hold in self._holds for edge in hold.edges],
            presses=[int(press) for hold in self._holds for press in hold.presses],
            first=np.cumsum([0, *(len(hold.edges) for hold in self._holds)]).tolist(),
            longest=[self.longest],
            sizes=[1, 0],
        )

    @property
    def fastest(self) -> float:
        """The velocity that half a period of the largest acceleration gives."""
        return 0.5 * self.period * max(hold.largest for hold in self._holds)

    def random(self, generator: np.random.Generator) -> State:
        """Return an impact at random: wall, phase, and a velocity up to what a period gives."""
        wall = int(generator.integers(len(self.sides)))
        phase = float(generator.uniform(0.0, self.period))
        limit = 0.5 * self.period * max(hold.bound for hold in self._holds)
        return State(wall, phase, self.sides[wall] * float(generator.uniform(0.0, limit)))

    # Sticking and flights.

    def pressed(self, wall: int, phase: float) -> tuple[bool, float]:
        """Return whether a body at rest on a wall is pressed against it, and for how long."""
        return pressing_at(self.body, wall, phase)

    @functools.cached_property
    def _fly(self) -> Callable[..., Any]:
        """The flight as `fly_or_stick` calls it."""
        if self.zeros is None:
            return FlightInState(self.motions, self._motion)
        return functools.partial(fly_in_time, self._motion)

    def fly(
        self, wall: int, phase: float, velocity: float, _: tuple[float, ...] = ()
    ) -> tuple[int, float, float]:
        """Return the wall hit next, the time until then and the velocity before that impact."""
        side, dt, speed = self._fly(self.body, wall, phase, velocity)
        return wall_on(self.body, wall, side), dt, speed

    def start(
        self, time: float, positions: Sequence[float], velocities: Sequence[float], mode: str
    ) -> State | None:
        """Return the first impact of a body that starts anywhere, in a mode; None for none."""
        (position,), (velocity,) = positions, velocities
        wall = wall_into(self.model, mode)
        low, high = self._around(position, wall)
        if not low <= 0.0 <= high:
            raise OutsideError(
                "position", f"{position!r} is beyond a wall", "start within the walls"
            )
        turns = math.floor(time / self.period)
        phase = time - turns * self.period
        start = self._start_in_time if self.zeros is not None else self._start_in_state
        side, dt, speed = start(wall, phase, position, velocity, low, high)
        if side == 0:
            return None
        phase, passed = wrap_time(phase + dt, self.period)
        return State(wall_on(self.body, wall, side), phase, speed, turns + passed)

    def _start_in_time(
        self, wall: int, phase: float, _: float, velocity: float, low: float, high: float
    ) -> tuple[int, float, float]:
        """The flight from a place between walls, where the acceleration depends on the time."""

        def motion(head: tuple[float, float], dt: float, values: Sequence[float]) -> Any:
            phase, out = head
            x, speed, acceleration = self._motion((wall, phase, 0.0), dt)
            return out * dt + x, out + speed, acceleration

        toward = self.sides[wall] * (1 if self.pressed(wall, phase)[0] else -1)
        rising = velocity > 0.0 or (velocity == 0.0 and toward > 0)
        times = (self.zeros, phase, self.period, self.longest)
        return first_arrival(
            motion, (phase, velocity), self.values, *times, 0.0, rising, low, high
        )[:3]

    def _start_in_state(
        self, wall: int, phase: float, position: float, velocity: float, low: float, high: float
    ) -> tuple[int, float, float]:
        """The same where it depends on the state."""
        if self.motions[wall].family is Family.INTEGRATED:
            given = self.motions[wall], self.body, phase, (position, velocity), low, high
            return start_integrated(*given)
        guard, values, model = self.model.WALLS[wall], self.values, self.model
        if guard.next_mode != model.first_mode:
            found = f"the flights of {model.SYSTEM} in {guard.next_mode!r} are known from guards on"
            raise InputError("position", found, "start at a guard")
        kernel, head = self.kernels.passing(guard.name), (0, phase, position, velocity)

        def motion(head: Any, dt: float, _: Any) -> Any:
            return kernel(*head[1:], dt, *values)

        body = self.body._replace(low=[position + low], high=[position + high])
        rising = velocity > 0.0 or (velocity == 0.0 and motion(head, 0.0, values)[2] > 0.0)
        return FlightInState((kernel,), motion).arrive(body, head, rising)

    def path(self, states: Sequence[State], times: Array, points: int) -> Any:
        """Return gap coordinate and velocity from impact to impact: times, x and v by flights."""
        ends = zip(itertools.pairwise(states), itertools.pairwise(times), strict=True)
        parts = [self._piece(*rows, *when, points) for rows, when in ends]
        return tuple(np.concatenate(column) for column in zip(*parts, strict=True))

    def _piece(
        self, left: State, reached: State, begin: float, end: float, points: int
    ) -> tuple[Array, Array, Array]:
        dt = np.linspace(0.0, float(end - begin), points)
        if reached.released:  # at rest since shortly after the impact
            x, v = np.zeros(points), np.zeros(points)
        else:
            motion, zeros = evaluate_in(self.motions[left.wall], ARRAYS), 0.0 * dt
            x, v = motion(begin + zeros, left.velocity + zeros, dt, *self.values)[:2]
        return begin + dt, self.positions[left.wall] + x, v

    def law_in(self, mode: str) -> None:
        """Its motion is no linear law."""

    @functools.cached_property
    def derivative(self) -> Callable[[State, State], Any]:
        """See `derivative_of_pair`."""
        return derivative_of_pair(self.kernels, self.values, self.period)

    def derivatives(self, states: Sequence[State], along: bool = False) -> Array:
        """Return those from each of some states to the next, shape (N, 2, 2)."""
        return np.array([self.derivative(*pair) for pair in itertools.pairwise(states)])

    # Runs.

    @functools.cached_property
    def loop(self) -> ImpactRuns:
        """The fast loop."""
        about = self.body, self.motions, self._motion, self._fly
        return ImpactRuns(*about, in_time=self.zeros is not None)

    def joined(self, parts: Sequence[Sequence[Any]]) -> dict[str, Array]:
        """Return the columns of a run from those of its parts."""
        return join_parts(parts)

    def make(
        self, state: State, span: tuple[int, int], asked: int, record: bool, fastest: float
    ) -> tuple[State, Outcome, int, list[list[Any]]]:
        """Make so many rows at most, up to some turn, unless the run ends before, or runs away.

        Returns the last state, why the run ended, the number of rows, and their columns in parts.
        """
        runs = self._runs or self.loop
        state, found, made, columns = runs.make(state, span, asked, record, fastest)
        parts, limits = [columns], (1, span[1])
        if found is None and self._slow_runs and self._bounces(state):
            state, found, count, columns = self._slow_runs.make(
                state, limits, asked, record, fastest
            )
            made += count
            parts.append(columns)
        if found is None:
            with timed_plainly(runs.engine.identity):
                state, found, count, columns = self.loop.make(state, limits, 1, record, fastest)
            runs.engine.plain += count
            made += count
            parts.append(columns)
        return state, found or Outcome.DONE, made, parts

    def batch(self, asked: int) -> Call | None:
        """Return compiled code for many motions; None where the work is not worth it."""
        return (self._runs or self.loop).batch(asked)

    @property
    def dear(self) -> bool:
        """Whether compiled flights take long."""
        return self._runs is not None and self._runs.dear

    @functools.cached_property
    def _runs(self) -> Runs | None:
        """What makes flights whose acceleration depends on the state, but those from rest, where
        all are integrated or follow laws."""
        return self._runs_left_at(self.body.slow)

    @functools.cached_property
    def _slow_runs(self) -> Runs | None:
        """The same for slow impacts, where chatter is not near its end."""
        return self._runs_left_at(())

    def _runs_left_at(self, slow: Sequence[float]) -> Runs | None:
        if self.zeros is not None:
            return None
        from .linear_flights import runs_of

        fixed = self.kernels, self.values, self.positions, self.restitution
        return runs_of(Setting(*fixed, self.period, self.longest, slow))

    def _bounces(self, state: State) -> bool:
        """Whether a slow impact is followed by a flight, and chatter not near its end."""
        given = self._motion, self.body, state.wall, state.phase, state.velocity
        return state.velocity != 0.0 and math.isnan(rest_after(*given))
