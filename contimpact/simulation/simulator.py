"""Event-driven simulation: from impact to impact, to rounding, through chatter and sticking.

Each flight is the model's closed form, and its first arrival at a wall is found with certainty
(`arrival.first_arrival`). Time is a phase in [0, T) and a whole number of periods, so that it does
not lose digits however long a run is. Chatter is completed analytically near its end; then the body
sticks, until the acceleration at the wall turns away. The loop itself is in
`contimpact.simulation.impacts`; it runs in plain Python, and compiled where that pays.

Knows no orbit problem: the two share kernels and flights, and nothing else.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from ..compiling.arguments import INTEGERS, VECTOR
from ..errors import InputError
from ..models.model import Model
from ..segments.arithmetic import ARRAYS, evaluate_in
from ..segments.arrival import first_arrival
from ..segments.kernels import Kernels
from ..segments.passages import beside
from ..segments.zeros import chebyshev_zeros, time_zeros
from .body import Body, wall_on, wrapped
from .chatter import coefficient, slow_velocity
from .engine import BODY, DTYPES, ROW, Engine, array, engine_of
from .flights import FlightInState, fly_in_time, motion_at
from .impacts import make_impacts
from .run import Outcome, Run, State, joined
from .sticking import Hold, hold_of, pressed_at

CHUNK, FEW = 65536, 256
"""Rows made at once, at most and at first: interrupts come through between chunks."""
_ENDLESS = 2**62
_OUTCOMES = tuple(Outcome)


class Simulator:
    """Simulates one model at fixed parameter values.

    Parameters
    ----------
    model : Model
        With one degree of freedom and, on each side in each mode, at most one wall.
    kernels : Kernels, optional
        Kernels of the same formulas, if there are any already.
    longest_flight : int, default 1000
        Periods after which a flight without an impact is given up.

    Raises
    ------
    InputError
        If the model is of another kind.
    """

    def __init__(
        self, model: Model, kernels: Kernels | None = None, *, longest_flight: int = 1000
    ) -> None:
        if model.DEGREES_OF_FREEDOM != 1:
            found = f"{model.SYSTEM} has {model.DEGREES_OF_FREEDOM} degrees of freedom"
            raise InputError("model", found, "simulate a system with one")
        sides = [wall.side for wall in model.WALLS]
        self.model = model
        self.kernels = kernels or Kernels(model, next(iter(model.values)))
        passages = self.kernels.passages
        self._met = [beside(model.WALLS, passages, k) for k in range(len(sides))]
        self.longest_flight = longest_flight
        self.letters = tuple(wall.name for wall in model.WALLS)
        self.sides = tuple(sides)
        self.values = tuple(model.values.values())
        setup = self.kernels.setup(*self.values)
        self.period = float(setup.period)
        self.positions = tuple(float(x) for x in setup.walls)
        self.derived = dict(zip(model.DERIVED, setup.derived, strict=True))
        self._motions = tuple(self.kernels.motion(letter) for letter in self.letters)
        self._motion = motion_at(self._motions, self.values)
        self._zeros = time_zeros(self.kernels.harmonics(*self.values), self.period)
        self._holds = tuple(self._hold(k) for k in range(len(sides)))
        self.restitution = tuple(
            coefficient(self._motion, k) if guard.rigid else 1.0
            for k, guard in enumerate(model.WALLS)
        )
        self._body = self._as_body()

    def __repr__(self) -> str:
        return f"Simulator({self.model!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        return functools.partial(Simulator, longest_flight=self.longest_flight), (self.model,)

    # What is fixed with the parameters.

    def _around(self, position: float, wall: int = 0) -> tuple[float, float]:
        """Displacements, from a position, of the walls below and above that end the flight from a
        wall."""
        below, above = self._met[wall]
        low = self.positions[below] - position if below >= 0 else -math.inf
        return low, self.positions[above] - position if above >= 0 else math.inf

    def _hold(self, wall: int) -> Hold:
        """When a body at rest on a wall is pressed against it."""
        kernel, period = self._motions[wall], self.period
        vectorised = evaluate_in(kernel, ARRAYS)

        def held(phase: Any) -> Any:
            return vectorised(phase, 0.0 * phase, 0.0 * phase, *self.values)[2]

        zeros = chebyshev_zeros(held, period) if self._zeros is None else self._zeros
        return hold_of(held, zeros, self.sides[wall], period)

    def _as_body(self) -> Body:
        """What is fixed with the parameters, as lists."""
        around = [self._around(position, k) for k, position in enumerate(self.positions)]
        leaving = self.kernels.passages.leaving
        pairs = zip(self.restitution, self._holds, strict=True)
        return Body(
            values=list(self.values),
            clock=[self.period],
            zeros=self._zeros or [],
            sides=list(self.sides),
            leaving=[int(side) for side in leaving],
            below=[below for below, _ in self._met],
            above=[above for _, above in self._met],
            low=[low for low, _ in around],
            high=[high for _, high in around],
            restitution=list(self.restitution),
            slow=[slow_velocity(e, hold.largest, self.period) for e, hold in pairs],
            edges=[edge for hold in self._holds for edge in hold.edges],
            presses=[int(press) for hold in self._holds for press in hold.presses],
            first=np.cumsum([0, *(len(hold.edges) for hold in self._holds)]).tolist(),
            longest=[self.longest_flight],
        )

    @functools.cached_property
    def _arrays(self) -> list[Array]:
        """The same as arrays, for compiled code."""
        return [array(numbers, kind) for numbers, kind in zip(self._body, BODY, strict=True)]

    # Sticking and flights.

    def pressed(self, wall: int, phase: float) -> tuple[bool, float]:
        """Return whether a body at rest on a wall is pressed against it, and for how long.

        The time is infinite if the acceleration never turns away.
        """
        return pressed_at(self._body, wall, phase)

    @property
    def _fly(self) -> Callable[..., Any]:
        """The flight as `make_impacts` calls it."""
        if self._zeros is None:
            return FlightInState(self._motions, self._motion)
        return functools.partial(fly_in_time, self._motion)

    def fly(self, wall: int, phase: float, velocity: float) -> tuple[int, float, float]:
        """Return the wall hit next, the time until then and the velocity before that impact.

        Parameters
        ----------
        wall : int
            The wall left.
        phase, velocity : float
            Of the impact there, the velocity before it.

        Returns
        -------
        wall : int
            -1 if a flight of `longest_flight` periods meets none.
        dt, velocity : float
        """
        side, dt, speed = self._fly(self._body, wall, phase, velocity)
        return wall_on(self._body, wall, side), dt, speed

    def start(self, time: float, position: float, velocity: float) -> State | None:
        """Return the first impact of a body that starts between the walls.

        Parameters
        ----------
        time, position, velocity : float

        Returns
        -------
        State or None
            None if no wall is met.

        Raises
        ------
        InputError
            If the position is not within the walls, or the acceleration depends on the state.
        """
        low, high = self._around(position)
        if not low <= 0.0 <= high:
            raise InputError("position", f"{position!r} is beyond a wall", "start within the walls")
        if self._zeros is None:
            found = f"the acceleration of {self.model.SYSTEM} depends on the state"
            raise InputError("position", found, "start at a wall")
        turns = math.floor(time / self.period)
        phase = time - turns * self.period

        def motion(head: tuple[float, float], dt: float, values: Sequence[float]) -> Any:
            phase, out = head
            x, speed, acceleration = self._motion((0, phase, 0.0), dt)
            return out * dt + x, out + speed, acceleration

        toward = self.sides[0] * (1 if self.pressed(0, phase)[0] else -1)
        rising = velocity > 0.0 or (velocity == 0.0 and toward > 0)
        head, longest = (phase, velocity), self.longest_flight
        times = (self._zeros, phase, self.period, longest)
        side, dt, speed, _ = first_arrival(
            motion, head, self.values, *times, 0.0, rising, low, high
        )
        if side == 0:
            return None
        phase, passed = wrapped(phase + dt, self.period)
        return State(wall_on(self._body, 0, side), phase, speed, turns + passed)

    # Runs.

    def state(self, wall: str, time: float, velocity: float) -> State:
        """Return the state before an impact on a wall.

        Parameters
        ----------
        wall : str
        time : float
        velocity : float
            Before the impact; it runs towards the wall.

        Raises
        ------
        InputError
            If there is no such wall or the velocity runs away from it.
        """
        if wall not in self.letters:
            raise InputError("wall", f"no wall {wall!r}", f"the walls are {self.letters}")
        k = self.letters.index(wall)
        if not velocity * self.sides[k] >= 0.0:
            accepted = f"give one {'>=' if self.sides[k] > 0 else '<='} 0"
            raise InputError("velocity", f"{velocity!r} runs away from the wall {wall}", accepted)
        return State(k, time, velocity).within(self.period)

    def random_state(self, generator: np.random.Generator) -> State:
        """Return an impact at random: wall, phase, and a velocity up to what a period gives."""
        wall = int(generator.integers(len(self.sides)))
        phase = float(generator.uniform(0.0, self.period))
        return State(wall, phase, self.sides[wall] * float(generator.uniform(0.0, self.fastest)))

    @property
    def fastest(self) -> float:
        """The velocity that half a period of the largest acceleration gives."""
        return 0.5 * self.period * max(hold.largest for hold in self._holds)

    def path(
        self, walls: Array, times: Array, velocities: Array, released: Array, points: int = 200
    ) -> tuple[Array, Array, Array]:
        """Return the motion between impacts, for pictures.

        Parameters
        ----------
        walls, times, velocities, released : ndarray of shape (N,)
            Impacts in order; they need not be physical.
        points : int
            Times on each flight.

        Returns
        -------
        t, x, v : ndarray of shape ((N - 1) points,)
            Times, gap coordinate and velocity; velocities jump at the impacts.
        """
        parts = []
        for k in range(len(walls) - 1):
            wall, length = int(walls[k]), float(times[k + 1] - times[k])
            dt = np.linspace(0.0, length, points)
            if released[k + 1]:  # at rest since shortly after impact k
                x, v = np.zeros(points), np.zeros(points)
            else:
                motion = evaluate_in(self._motions[wall], ARRAYS)
                x, v = motion(times[k] + 0.0 * dt, velocities[k] + 0.0 * dt, dt, *self.values)[:2]
            parts.append((times[k] + dt, self.positions[wall] + x, v))
        t, x, v = (np.concatenate(column) for column in zip(*parts, strict=True))
        return t, x, v

    def run(
        self,
        state: State,
        *,
        impacts: int | None = None,
        periods: int | None = None,
        record: bool = True,
    ) -> Run:
        """Simulate from an impact.

        Parameters
        ----------
        state : State
            The impact that is about to happen; it is not among the rows. A phase beyond [0, T) is
            taken as whole periods and a phase.
        impacts : int, optional
            Rows to make at most.
        periods : int, optional
            Stop at the first impact this many whole periods later.
        record : bool, default True
            Whether to keep the rows; without them a run takes no memory.

        Returns
        -------
        Run

        Raises
        ------
        InputError
            If neither `impacts` nor `periods` is given, or one is no whole number >= 0.
        """
        if impacts is None and periods is None:
            raise InputError("impacts", "no end of the run", "give impacts or periods")
        for name, number in (("impacts", impacts), ("periods", periods)):
            if number is not None and (not isinstance(number, int | np.integer) or number < 0):
                raise InputError(name, f"found {number!r}", "give a whole number >= 0")
        state = state.within(self.period)
        most = impacts if impacts is not None else _ENDLESS
        last = state.turns + periods if periods is not None else _ENDLESS
        asked = min(number for number in (impacts, periods) if number is not None)
        parts: list[list[Any]] = []
        made, outcome, size = 0, Outcome.DONE, CHUNK if impacts is not None else FEW
        while outcome is Outcome.DONE and made < most and state.turns < last:
            span = min(size, most - made), min(last, state.turns + CHUNK)
            state, outcome, count, columns = self._make(state, span, asked, record)
            parts.append(columns)
            made, size = made + count, min(4 * size, CHUNK)
        end = state if outcome is not Outcome.NO_IMPACT else None
        return Run(self.letters, self.period, *joined(parts), outcome, end)

    def _make(
        self, state: State, span: tuple[int, int], asked: int, record: bool
    ) -> tuple[State, Outcome, int, list[Any]]:
        """Make so many rows, up to some turn, unless the run ends before.

        Returns the last state, why the run ended, the number of rows, and their columns.
        """
        fast = self._engine.program(asked) if self._engine else None
        rows = span[0] if record else 0
        columns: list[Any] = [np.empty(rows, DTYPES[k]) if fast else [0] * rows for k in ROW]
        at: Any = [int(state.wall), int(state.turns), 0]
        when: Any = [float(state.phase), float(state.velocity)]
        if fast:
            at, when = array(at, INTEGERS), array(when, VECTOR)
            count = fast(*self._arrays, at, when, *columns, array(span, INTEGERS))
        else:
            given = (at, when, *columns, span)
            count = make_impacts(self._fly, self._motion, self._body, *given)
            if self._engine:
                self._engine.count_plain(count)
        end = State(int(at[0]), float(when[0]), float(when[1]), int(at[1]))
        return end, _OUTCOMES[at[2]], count, [column[:count] for column in columns]

    @functools.cached_property
    def _engine(self) -> Engine | None:
        """None if the acceleration depends on the state: compiled code does not find its zeros."""
        return None if self._zeros is None else engine_of(self._motions)

    # The linearised map.

    @functools.cached_property
    def _flights(self) -> dict[tuple[int, int], Any]:
        """Flight kernels by pairs of walls; only the linearisation needs them."""
        n = range(len(self.letters))
        watched = self.kernels.passages.watched
        pairs = ((a, b) for a in n for b in n if watched[a][b])
        return {(a, b): self.kernels.flight(self.letters[a], self.letters[b]) for a, b in pairs}

    def derivative(self, start: State, end: State) -> tuple[float, float, float, float]:
        """Return the derivative of the map from one impact to the next.

        Parameters
        ----------
        start, end : State
            Two consecutive impacts.

        Returns
        -------
        tt, tv, vt, vv : float
            Row by row, for (time, velocity before impact): -B^-1 A with the blocks of the flight
            kernel. A velocity of zero at `end` makes it infinite.
        """
        t1 = end.phase + (end.turns - start.turns) * self.period
        kernel = self._flights[start.wall, end.wall]
        ends = start.phase, start.velocity, t1, end.velocity
        _, (a11, a12, a21, a22), (b11, b12, b21, b22), _ = kernel(*ends, *self.values)
        det = b11 * b22 - b12 * b21
        if det == 0.0:
            return (math.inf,) * 4
        tt, tv = b12 * a21 - b22 * a11, b12 * a22 - b22 * a12
        vt, vv = b21 * a11 - b11 * a21, b21 * a12 - b11 * a22
        return tt / det, tv / det, vt / det, vv / det
