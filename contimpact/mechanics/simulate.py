r"""Event-driven simulation: from impact to impact, to rounding, through chatter and sticking.

Each flight is the model's closed form, and its first arrival at a wall is found with certainty
(`flight.first_hit`). Time is a phase in [0, T) and a whole number of periods, so that it does not
lose digits however long a run is.

Where the body is pressed against a wall, impacts with restitution e < 1 accumulate: with the
acceleration a towards the wall nearly constant, an impact of velocity v is followed by flights of
2 e v/a, 2 e^2 v/a, ..., which end after

.. math:: \tau = \frac{2 e v}{a (1 - e)} .

Impacts are computed one by one until tau is so short that this is exact to rounding; then the body
sticks. It is released where the acceleration at the wall next turns away, at a zero of it.
Knows no orbit problem: it shares kernels and flights with it, and nothing else.
"""

from __future__ import annotations

import enum
import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from .flight import chebyshev_zeros, first_hit, time_zeros
from .kernels import Kernels
from .model import Model

Array = np.ndarray[Any, Any]

_SHORT = 1e-9
"""Chatter left to come, in periods, that is completed analytically."""
_EARLY = 1e-6
"""... and in units of the time until the acceleration turns away."""
_NUDGE = 1e-9
"""Zeros of a state-dependent acceleration this near a release belong to the release itself."""


class Outcome(enum.Enum):
    """Why a run ended; the value is a sentence."""

    DONE = "made as many impacts, or ran as many periods, as it was asked to"
    RESTING = "the body rests on a wall, which the acceleration never leaves"
    NO_IMPACT = "the body flew on without an impact for as long as a flight may last"


@dataclass(frozen=True)
class State:
    """The body at a wall just before an impact, or at rest there if the velocity is zero.

    Attributes
    ----------
    wall : int
        Number of the wall, in the model's order.
    phase : float
        Time in [0, T).
    velocity : float
        Before the impact, towards the wall.
    turns : int
        Whole periods passed.
    """

    wall: int
    phase: float
    velocity: float
    turns: int = 0


@dataclass(frozen=True, eq=False)
class Run:
    """What a simulation met, a row per impact or release.

    Attributes
    ----------
    letters : tuple of str
        Names of the walls.
    period : float
        Forcing period T.
    walls : ndarray of int, shape (N,)
        Number of the wall hit.
    turns : ndarray of int, shape (N,)
    phases : ndarray of float, shape (N,)
        Time of each row is turns*T + phase.
    velocities : ndarray of float, shape (N,)
        Before impact; zero for a release.
    released : ndarray of bool, shape (N,)
        Whether the row is a release: the body, at rest on the wall since shortly after the row
        before, is left by it.
    outcome : Outcome
    end : State or None
        From which a further run goes on; None where there is nothing to go on from.
    """

    letters: tuple[str, ...]
    period: float
    walls: Array
    turns: Array
    phases: Array
    velocities: Array
    released: Array
    outcome: Outcome
    end: State | None

    def __len__(self) -> int:
        return len(self.walls)

    @property
    def times(self) -> Array:
        """Times of the rows, from the start of the first one's period."""
        first = self.turns[0] if len(self) else 0
        return (self.turns - first) * self.period + self.phases

    @property
    def word(self) -> str:
        """The walls met; a release is written ``*``."""
        names = [*self.letters, "*"]
        marked = np.where(self.released, len(self.letters), self.walls)
        return "".join(names[i] for i in marked)


class Simulator:
    """Simulates one model at fixed parameter values.

    Parameters
    ----------
    model : Model
        With one degree of freedom and, on each side, at most one wall.
    kernels : Kernels, optional
        Kernels at hand for the same formulas.
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
            raise InputError(
                "model", f"{model.SYSTEM} has {model.DEGREES_OF_FREEDOM} degrees of freedom",
                "simulate a system with one",
            )  # fmt: skip
        sides = [wall.side for wall in model.WALLS]
        if len(set(sides)) != len(sides):
            raise InputError("model", "two walls on one side", "give at most one on each side")
        self.model = model
        self.kernels = kernels or Kernels(model, next(iter(model.values)))
        self.longest_flight = longest_flight
        self.letters = tuple(wall.name for wall in model.WALLS)
        self.sides = tuple(sides)
        self.values = tuple(model.values.values())
        setup = self.kernels.setup(*self.values)
        self.period = float(setup[0])
        self.positions = tuple(float(x) for x in setup[3 : 3 + len(sides)])
        names = model.DERIVED
        self.derived = dict(zip(names, setup[3 + len(sides) :], strict=False))
        self._motions = tuple(self.kernels.motion(letter) for letter in self.letters)
        self._zeros = time_zeros(self.kernels.harmonics(*self.values), self.period)
        self._gaps = tuple(self._around(position) for position in self.positions)
        self._holds = tuple(self._hold(k) for k in range(len(sides)))
        self.restitution = tuple(self._restitution(k) for k in range(len(sides)))
        self._slow = tuple(self._slow_velocity(k) for k in range(len(sides)))

    # What is fixed with the parameters.

    def _around(self, position: float) -> tuple[float, float]:
        """Displacements, from a position, of the walls below and above."""
        low, high = -math.inf, math.inf
        for side, wall in zip(self.sides, self.positions, strict=True):
            if side > 0:
                high = wall - position
            else:
                low = wall - position
        return low, high

    def _restitution(self, wall: int) -> float:
        """Coefficient of restitution at low velocity."""
        return abs(float(self._motions[wall](0.0, 1e-6, 0.0, *self.values)[1])) / 1e-6

    def _hold(self, wall: int) -> tuple[tuple[float, ...], tuple[bool, ...], float]:
        """When a body at rest on a wall is pressed against it.

        Returns the phases at which the acceleration changes sign, whether it presses in the
        interval after each, and its largest size. Without a change the one interval begins at 0.
        """
        kernel, side, period = self._motions[wall], self.sides[wall], self.period
        vectorised = self.kernels.vectorised(kernel)

        def held(phase: Any) -> Any:
            return vectorised(phase, 0.0 * phase, 0.0 * phase, *self.values)[2]

        zeros = self._zeros
        if zeros is None:
            zeros = chebyshev_zeros(held, period)
        edges = sorted(zeros) or [0.0]
        middles = [
            0.5 * (a + b) for a, b in zip(edges, [*edges[1:], edges[0] + period], strict=True)
        ]
        pressed = [bool(side * float(held(np.float64(t))) > 0.0) for t in middles]
        changes = [i for i in range(len(edges)) if pressed[i] != pressed[i - 1]] or [0]
        size = float(np.max(np.abs(held(np.linspace(0.0, period, 65)))))
        return (
            tuple(edges[i] for i in changes), tuple(pressed[i] for i in changes), 1.1 * size
        )  # fmt: skip

    def _slow_velocity(self, wall: int) -> float:
        """Velocity below which chatter may be near its end; infinite without restitution."""
        e, size = self.restitution[wall], self._holds[wall][2]
        if e == 0.0:
            return math.inf
        return _SHORT * self.period * size * max(1.0 - e, 0.0) / (2.0 * e)

    # Sticking.

    def pressed(self, wall: int, phase: float) -> tuple[bool, float]:
        """Return whether a body at rest on a wall is pressed against it, and for how long.

        The time is infinite where the acceleration never turns away.
        """
        edges, presses, _ = self._holds[wall]
        if len(edges) == 1:
            return presses[0], math.inf
        i = len(edges) - 1
        if phase >= edges[0]:
            while edges[i] > phase:
                i -= 1
        left = edges[(i + 1) % len(edges)] - phase
        return presses[i], left if left > 0.0 else left + self.period

    def _sticks_after(self, wall: int, phase: float, velocity: float) -> float:
        """Time until accumulating impacts come to rest; not a number where they do not (yet)."""
        e = self.restitution[wall]
        presses, until = self.pressed(wall, phase)
        if not presses or e >= 1.0:
            return math.nan
        if e == 0.0 or velocity == 0.0:
            return 0.0
        force = self.sides[wall] * self._motions[wall](phase, 0.0, 0.0, *self.values)[2]
        if force <= 0.0:
            return math.nan
        rest = 2.0 * e * abs(velocity) / (force * (1.0 - e))
        exact = rest <= _SHORT * self.period and rest <= _EARLY * until
        return rest if exact else math.nan

    def _release(self, wall: int, phase: float) -> tuple[float, int] | None:
        """Phase of the next release and the periods passed until then; None for never."""
        edges, presses, _ = self._holds[wall]
        if len(edges) == 1:
            return None
        later = [z for z, press in zip(edges, presses, strict=True) if not press and z > phase]
        if later:
            return later[0], 0
        return next(z for z, press in zip(edges, presses, strict=True) if not press), 1

    # Flights.

    def _breaks(self, wall: int, phase: float, velocity: float, window: int) -> Sequence[float]:
        """Times after leaving, in one period's window, between which the velocity is monotone."""
        period = self.period
        if self._zeros is None:
            return self._state_breaks(wall, phase, velocity, window)
        if not self._zeros:
            return ((window + 1) * period,)
        ahead = [z - phase for z in self._zeros if z > phase]
        ahead += [z - phase + period for z in self._zeros if z <= phase]
        return [t + window * period for t in ahead] if window else ahead

    def _state_breaks(self, wall: int, phase: float, velocity: float, window: int) -> list[float]:
        """The same where the acceleration depends on the state."""
        start, period = window * self.period, self.period
        vectorised = self.kernels.vectorised(self._motions[wall])
        zeros = chebyshev_zeros(
            lambda dt: vectorised(phase, velocity, start + dt, *self.values)[2], period
        )
        at_rest = velocity == 0.0 or self.restitution[wall] == 0.0
        least = _NUDGE * period if at_rest and window == 0 else 0.0
        return [*(start + t for t in zeros if least < t < period), start + period]

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
            -1 where a flight of `longest_flight` periods meets none.
        dt, velocity : float
        """
        motion, head = self.kernels.motions, (wall, phase, velocity)
        low, high = self._gaps[wall]
        rising = self.sides[wall] < 0
        left, speed = 0.0, motion(head, 0.0, self.values)[1]
        return self._first(
            motion, head, (left, speed, rising, low, high),
            lambda window: self._breaks(wall, phase, velocity, window),
        )  # fmt: skip

    def _first(self, motion, head, start, breaks) -> tuple[int, float, float]:
        """Window after window until a wall is hit."""
        left, speed, rising, low, high = start
        for window in range(self.longest_flight):
            side, left, speed, rising = first_hit(
                motion, head, self.values, breaks(window), left, speed, rising, low, high
            )
            if side:
                return self.sides.index(side), left, speed
        return -1, left, speed

    def start(self, time: float, position: float, velocity: float) -> State | None:
        """Return the first impact of a body that starts between the walls.

        Parameters
        ----------
        time, position, velocity : float

        Returns
        -------
        State or None
            None where no wall is met.

        Raises
        ------
        InputError
            If the position is not within the walls, or the acceleration depends on the state.
        """
        low, high = self._around(position)
        if not low <= 0.0 <= high:
            raise InputError("position", f"{position!r} is beyond a wall", "start within the walls")
        if self._zeros is None:
            raise InputError(
                "position", f"the acceleration of {self.model.SYSTEM} depends on the state",
                "start at a wall",
            )  # fmt: skip
        turns = math.floor(time / self.period)
        phase = time - turns * self.period
        fall = self._motions[0]

        def motion(head: tuple[float, float], dt: float, values: Sequence[float]) -> Any:
            phase, out = head
            x, speed, acceleration = fall(phase, 0.0, dt, *values)
            return out * dt + x, out + speed, acceleration

        toward = self.sides[0] * (1 if self.pressed(0, phase)[0] else -1)
        rising = velocity > 0.0 or (velocity == 0.0 and toward > 0)
        wall, dt, speed = self._first(
            motion, (phase, velocity), (0.0, velocity, rising, low, high),
            lambda window: self._breaks(0, phase, 0.0, window),
        )  # fmt: skip
        if wall < 0:
            return None
        phase, passed = self._wrapped(phase + dt)
        return State(wall, phase, speed, turns + passed)

    def _wrapped(self, phase: float) -> tuple[float, int]:
        """A time as a phase in [0, T) and whole periods."""
        passed = math.floor(phase / self.period)
        phase -= passed * self.period
        if phase >= self.period:  # rounding at the edge
            return 0.0, passed + 1
        return max(phase, 0.0), passed

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
            raise InputError(
                "velocity", f"{velocity!r} runs away from the wall {wall}",
                f"give one {'>=' if self.sides[k] > 0 else '<='} 0",
            )  # fmt: skip
        phase, turns = self._wrapped(time)
        return State(k, phase, velocity, turns)

    def random_state(self, generator: np.random.Generator) -> State:
        """Return an impact at random: wall, phase, and a velocity up to what a period gives."""
        wall = int(generator.integers(len(self.sides)))
        phase = float(generator.uniform(0.0, self.period))
        return State(wall, phase, self.sides[wall] * float(generator.uniform(0.0, self.fastest)))

    @property
    def fastest(self) -> float:
        """The velocity that half a period of the largest acceleration gives."""
        return 0.5 * self.period * max(hold[2] for hold in self._holds)

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
                motion = self.kernels.vectorised(self._motions[wall])
                x, v = motion(times[k] + 0.0 * dt, velocities[k] + 0.0 * dt, dt, *self.values)[:2]
            parts.append((times[k] + dt, self.positions[wall] + x, v))
        t, x, v = (np.concatenate(column) for column in zip(*parts, strict=True))
        return t, x, v

    def run(
        self, state: State, *, impacts: int | None = None, periods: int | None = None,
        record: bool = True,
    ) -> Run:  # fmt: skip
        """Simulate from an impact.

        Parameters
        ----------
        state : State
            The impact that is about to happen; it is not among the rows.
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
            If neither `impacts` nor `periods` is given.
        """
        if impacts is None and periods is None:
            raise InputError("impacts", "no end of the run", "give impacts or periods")
        most = impacts if impacts is not None else 10**18
        last_turn = state.turns + periods if periods is not None else 10**18
        wall, phase, velocity, turns = state.wall, state.phase, state.velocity, state.turns
        rows: list[tuple[int, int, float, float, bool]] = []
        outcome, made = Outcome.DONE, 0
        while made < most and turns < last_turn:
            released = False
            rest = math.nan
            if abs(velocity) <= self._slow[wall]:
                rest = self._sticks_after(wall, phase, velocity)
            if rest == rest:  # chatter has come to its end
                phase, passed = self._wrapped(phase + rest)
                turns += passed
                release = self._release(wall, phase)
                if release is None:
                    outcome = Outcome.RESTING
                    break
                (phase, passed), velocity, released = release, 0.0, True
                turns += passed
            else:
                hit, dt, speed = self.fly(wall, phase, velocity)
                if hit < 0:
                    outcome = Outcome.NO_IMPACT
                    break
                wall, velocity = hit, speed
                phase, passed = self._wrapped(phase + dt)
                turns += passed
            made += 1
            if record:
                rows.append((wall, turns, phase, velocity, released))
        end = State(wall, phase, velocity, turns)
        return self._as_run(rows, outcome, end if outcome is not Outcome.NO_IMPACT else None)

    def _as_run(self, rows: list[Any], outcome: Outcome, end: State | None) -> Run:
        columns: list[Any] = list(zip(*rows, strict=True)) if rows else [()] * 5
        kinds = (np.int8, np.int64, float, float, bool)
        walls, turns, phases, velocities, released = (
            np.array(column, dtype=kind) for column, kind in zip(columns, kinds, strict=True)
        )
        return Run(
            self.letters, self.period, walls, turns, phases, velocities, released, outcome, end
        )

    # The linearised map.

    @functools.cached_property
    def _flights(self) -> dict[tuple[int, int], Any]:
        """Flight kernels by pairs of walls; only the linearisation needs them."""
        n = range(len(self.letters))
        return {(a, b): self.kernels.flight(self.letters[a], self.letters[b]) for a in n for b in n}

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
        out = kernel(start.phase, start.velocity, t1, end.velocity, *self.values)
        a11, a12, a21, a22, b11, b12, b21, b22 = out[2:10]
        det = b11 * b22 - b12 * b21
        if det == 0.0:
            return (math.inf,) * 4
        return (
            (b12 * a21 - b22 * a11) / det, (b12 * a22 - b22 * a12) / det,
            (b21 * a11 - b11 * a21) / det, (b21 * a12 - b11 * a22) / det,
        )  # fmt: skip
