"""The simulator of a model, impact by impact, and its motion while nothing is hit.

Each flight is the model's closed form, and its first arrival at a wall is found with certainty
(`flight.first_arrival`). Time is a phase in [0, T) and a whole number of periods, so that it does
not lose digits however long a run is. Chatter is completed analytically near its end; then the body
sticks, until the acceleration at the wall turns away. The loop itself is in
`contimpact.simulation.run`; it runs in plain Python, and compiled where that pays.

Systems of one coordinate between two walls have a fast loop (`one_coordinate`); the `automaton`
simulates all others.

Knows no orbit problem: the two share kernels and flights, and nothing else.
"""

from __future__ import annotations

import functools
import math
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import numpy as np

from ..arrays import Array
from ..display import ParameterItems
from ..errors import InputError, explain_arguments, random_generator, require_whole
from ..models.model import Model
from ..segments.bounded import UNIT
from ..segments.compiling import cores
from ..segments.integration import statement
from ..segments.kernel import SECTION
from ..segments.kernels import Kernels
from ..segments.track import IntegratedTrack, integrated_track
from .motions import LinearMotion
from .one_coordinate import OneCoordinate
from .run import DONE, LEFT, OUTCOMES, Call, Outcome, PassageRule, Run, State, states_of, wall_into

if TYPE_CHECKING:
    from .automaton import Automaton

CHUNK, FEW = 16384, 256
"""Rows made at once, at most and at first: interrupts come through between chunks."""
_ENDLESS = 2**62

MOST_TURNS = 2**53
"""Periods after which a time has no phase in doubles."""

RUNAWAY = 1e6
"""A motion that is faster than its start and than `Simulator.fastest` by this factor runs away: no
resonance of a gain below it does. Where laws are not linear its flights take ever longer."""


@explain_arguments
class Simulator(ParameterItems):
    """Simulates one model at fixed parameter values.

    Parameters
    ----------
    model : Model
    kernels : Kernels, optional
        Kernels of the same formulas, if there are any already.
    longest_flight : int, default 1000
        Periods after which a flight without an impact is given up.

    Attributes
    ----------
    machine : OneCoordinate or Automaton
        What makes the impacts.
    met : PassageRule
        Returns a state at the guard that is met, of two on one surface.
    """

    def __init__(
        self, model: Model, kernels: Kernels | None = None, *, longest_flight: int = 1000
    ) -> None:
        self.model = model
        self.kernels = kernels or Kernels(model, next(iter(model.values)))
        self.longest_flight = longest_flight
        self.letters = tuple(model.letters)
        self.sides = tuple(wall.side for wall in model.WALLS)
        self.values = tuple(model.values.values())
        setup = self.kernels.setup(*self.values)
        self.period = float(setup.period)
        self.positions = tuple(float(x) for x in setup.walls)
        self.derived = dict(zip(model.DERIVED, setup.derived, strict=True))
        kind: type[Automaton | OneCoordinate] = OneCoordinate
        if has_several_coordinates(model, self.kernels):
            from .automaton import Automaton as kind
        given = (model, self.kernels, self.period, self.positions, longest_flight)
        self.machine: Automaton | OneCoordinate = kind(*given)
        self.restitution = self.machine.restitution
        self.met = PassageRule(self.kernels, self.values, self.positions)

    def __repr__(self) -> str:
        return f"Simulator({self.model!r})"

    def __reduce__(self) -> tuple[Any, ...]:
        return functools.partial(Simulator, longest_flight=self.longest_flight), (self.model,)

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters and derived parameters."""
        return {**self.model.values, **self.derived}

    # Flights.

    def pressed(self, wall: int, phase: float) -> tuple[bool, float]:
        """Return whether a body at rest on a wall is pressed against it, and for how long.

        The time is infinite if the acceleration never turns away.

        Raises
        ------
        InputError
            If the `machine` is an `Automaton`: what presses then depends on the state.
        """
        return self.machine.pressed(wall, phase)

    def fly(
        self, wall: int, phase: float, velocity: float, others: Sequence[float] = ()
    ) -> tuple[int, float, float]:
        """Return the wall hit next, the time until then and the velocity before that impact.

        Parameters
        ----------
        wall : int
            The wall left.
        phase, velocity : float
            Of the impact there, the velocity before it.
        others : sequence of float
            As of `state`.

        Returns
        -------
        wall : int
            -1 if a flight of `longest_flight` periods meets none.
        dt, velocity : float

        Raises
        ------
        InputError
            If others are missing.
        """
        return self.machine.fly(wall, phase, velocity, self._complete(others))

    def _complete(self, others: Sequence[float]) -> tuple[float, ...]:
        """Section coordinates but the first, all of them."""
        size = self.model.unknowns_per_impact - 2
        if len(others) != size:
            accepted = f"give {size}, position and velocity of the other coordinates"
            raise InputError("others", f"{len(others)} numbers", accepted)
        return tuple(map(float, others))

    def start(
        self,
        time: float,
        position: float | Sequence[float],
        velocity: float | Sequence[float],
        mode: str = "",
    ) -> State | None:
        """Return the first impact of a body that starts between the walls.

        Parameters
        ----------
        time : float
        position, velocity : float or sequence of float
            One for each degree of freedom.
        mode : str, optional
            In systems of several modes; the first one by default.

        Returns
        -------
        State or None
            None if no wall is met; `settle` takes it, too.

        Raises
        ------
        InputError
            If the position is not within the walls, the flight has to start at a guard, a number is
            not finite, or a phase cannot be told from the time.
        """
        x, v = np.atleast_1d(position).tolist(), np.atleast_1d(velocity).tolist()
        for name, given in (("position", x), ("velocity", v)):
            if len(given) != (size := self.model.DEGREES_OF_FREEDOM):
                accepted = f"give one for each degree of freedom: {size}"
                raise InputError(name, f"{len(given)} numbers", accepted)
        self._check_start(time, {"position": x, "velocity": v})
        return self.machine.start(time, x, v, mode)

    def _check_start(self, time: float, numbers: Mapping[str, Sequence[float]]) -> None:
        """Refuse numbers that are not finite, and times of which only the periods can be told."""
        for name, given in {"time": [time], **numbers}.items():
            for value in given:
                if not math.isfinite(value):
                    raise InputError(name, f"found {value!r}", "give a finite number")
        if abs(time) >= MOST_TURNS * self.period:
            found = f"{time!r} is {abs(time) / self.period:.3g} periods away"
            raise InputError("time", found, "give one whose phase can be told, such as from 0 to T")

    # Runs.

    def state(self, wall: str, time: float, velocity: float, others: Sequence[float] = ()) -> State:
        """Return the state before an impact on a wall.

        Parameters
        ----------
        wall : str
        time : float
        velocity : float
            Before the impact; it runs towards the wall.
        others : sequence of float
            With several degrees of freedom, position and velocity of each coordinate but the one
            that the wall gives, in order.

        Raises
        ------
        InputError
            If there is no such wall, the velocity runs away from it, others are missing, a number
            is not finite, or a phase cannot be told from the time.
        """
        if wall not in self.letters:
            raise InputError("wall", f"no wall {wall!r}", f"the walls are {self.letters}")
        k = self.letters.index(wall)
        self._check_start(time, {"velocity": [velocity], "others": others})
        if not velocity * self.sides[k] >= 0.0:
            accepted = f"give one {'>=' if self.sides[k] > 0 else '<='} 0"
            raise InputError("velocity", f"{velocity!r} runs away from the wall {wall}", accepted)
        return State(k, time, velocity, others=self._complete(others)).within(self.period)

    def random_state(self, generator: Any = 0) -> State:
        """Return an impact at random: wall, phase, and velocities up to what a period gives.

        Parameters
        ----------
        generator : None, int or numpy.random.Generator, default 0
        """
        return self.met(self.machine.random(random_generator(generator, "generator")))

    @property
    def fastest(self) -> float:
        """The velocity that half a period of the largest acceleration gives."""
        return self.machine.fastest

    def path(
        self,
        walls: Array,
        times: Array,
        velocities: Array,
        released: Array,
        points: int = 200,
        others: Array | None = None,
        held: Array | None = None,
    ) -> tuple[Array, Array, Array]:
        """Return the motion between impacts, for pictures.

        Parameters
        ----------
        walls, times, velocities, released : ndarray of shape (N,)
            Impacts in order; they need not be physical.
        points : int
            Times on each flight.
        others, held : ndarray, optional
            As of a `Run`, where there are several coordinates.

        Returns
        -------
        t, x, v : ndarray of shape ((N - 1) points,)
            Times, gap coordinate and velocity; velocities jump at the impacts. Of several
            coordinates x and v have a column for the gap coordinate of each guard.
        """
        none = np.zeros((len(walls), self.model.unknowns_per_impact - 2))
        given = none if others is None else others
        resting = np.zeros(len(walls), dtype=np.int64) if held is None else held
        states = states_of([walls, times, velocities, 0 * walls, given, resting, released])
        t, x, v = self.machine.path(states, times, points)
        return t, x, v

    def run(
        self,
        state: State | None,
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
            taken as whole periods and a phase. None, as `start` returns it, is refused.
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
            If there is no state, neither `impacts` nor `periods` is given, or one is no whole
            number >= 0.
        """
        if state is None:
            found = "None: the motion meets no wall"
            raise InputError("state", found, "give an impact; settle tells what that motion is")
        if impacts is None and periods is None:
            raise InputError("impacts", "no end of the run", "give impacts or periods")
        for name, number in (("impacts", impacts), ("periods", periods)):
            if number is not None:
                require_whole(number, name, 0)
        state = state.within(self.period)
        most = impacts if impacts is not None else _ENDLESS
        last = state.turns + periods if periods is not None else _ENDLESS
        fastest = self.runaway_speed(state.speed)
        asked = min(number for number in (impacts, periods) if number is not None)
        parts: list[list[Any]] = []
        made, outcome, size = 0, Outcome.DONE, CHUNK if impacts is not None else FEW
        while outcome is Outcome.DONE and made < most and state.turns < last:
            span = min(size, most - made), min(last, state.turns + CHUNK)
            state, outcome, count, made_of = self.machine.make(state, span, asked, record, fastest)
            parts += made_of if record else ()
            made, size = made + count, min(4 * size, CHUNK)
        nowhere = Outcome.NO_IMPACT, Outcome.RUNAWAY, Outcome.UNDEFINED
        end = None if outcome in nowhere else state
        left = state if outcome is Outcome.NO_IMPACT else None
        return Run(
            self.letters,
            self.period,
            **self.machine.joined(parts),
            outcome=outcome,
            end=end,
            left=left,
            model=self.model,
        )

    def runaway_speed(self, speed: float) -> float:
        """Return the speed beyond which a motion that starts with some speed runs away."""
        return RUNAWAY * float(np.fmax(self.fastest, speed)) or math.inf

    def run_all(
        self, states: Sequence[State], *, periods: int, threads: int | None = None
    ) -> list[tuple[Outcome, State]]:
        """Simulate from many impacts for so many periods, on all cores where that is compiled.

        Parameters
        ----------
        states : sequence of State
        periods : int
        threads : int, optional
            As many as there are cores by default.

        Returns
        -------
        list of (Outcome, State)
            Why each run ended, and where: as `end` of `run`; where it started if it ended before.

        Raises
        ------
        InputError
            If `periods` is no whole number >= 0.
        """
        require_whole(periods, "periods", 0)
        batch = Batch(self, states, threads)
        outcomes = batch.run(np.arange(len(states)), periods)
        return [(outcome, batch.state(k)) for k, outcome in enumerate(outcomes)]

    # The linearised map.

    @property
    def derivative(self) -> Callable[[State, State], Any]:
        """The derivative of the map from one impact to the next, as a function of both states.

        It returns rows, for (time, section coordinates).
        """
        return self.machine.derivative

    def derivatives(self, states: Sequence[State], along: bool = False) -> Array:
        """Return the derivatives from each of some states to the next, shape (N, m, m).

        Those of integrated flights are solved for between the states or, if asked, integrated along
        the flow from each on, which is faster, and loses the digits by which disturbances grow.
        """
        return self.machine.derivatives(states, along)


def as_simulator(of: Simulator | Model) -> Simulator:
    """Return a simulator, that of a model if a model is given."""
    return Simulator(of) if isinstance(of, Model) else of


def has_several_coordinates(model: Model, kernels: Kernels) -> bool:
    """Whether a system has more than one coordinate between two walls in each mode.

    Linear flights are simulated faster as polynomials in pieces than by their kernels, too, and
    where a jump leads elsewhere, or may lead on at once to another mode's guard, each flight is
    looked at.
    """
    passages, guards = kernels.passages, model.WALLS
    if not kernels.planar or not passages.anchored or 0.0 in passages.leaving:
        return True
    if any(kernels.mechanical(guard.name) for guard in guards):
        return True
    if any(passages.beginning(k) and not guard.rigid for k, guard in enumerate(guards)):
        return True
    met = (
        [g.side for g, sees in zip(model.WALLS, row, strict=True) if sees]
        for row in passages.watched
    )
    return any(len(set(sides)) < len(sides) for sides in met)


# Motions from many starts at once, on all cores.
#
# Where the loop from impact to impact is compiled it runs in threads, each with a part of the
# starts: compiled code does not hold Python's lock. What it leaves to Python is made one start
# after the other, so that the results are those of `Simulator.run`.

LONGEST = 65536
"""Impacts of a start made in one call at most."""
PARTS = 4
"""Parts of the starts for each thread at least, so that all end at about the same time."""
AT_A_TIME, OF_DEAR = 8192, 256
"""Periods that compiled code makes of all starts of a part at most, and where flights take long: an
interruption is noticed between calls."""
FEW_STARTS = 8
"""Starts of a part at most where flights take long."""


class Batch:
    """Motions from many starts.

    `walls`, `turns`, `held`, `released`, `phases` (n,) and `sections` (n, m) say where they are.
    There are as many threads as cores by default, or one in the processes of a study.
    """

    def __init__(
        self, simulator: Simulator, states: Sequence[State], threads: int | None = None
    ) -> None:
        self.simulator = simulator
        from multiprocessing import parent_process

        self.threads = threads or (1 if parent_process() else cores())
        states = [state.within(simulator.period) for state in states]
        self.walls = np.array([state.wall for state in states], dtype=np.int64)
        self.turns = np.array([state.turns for state in states], dtype=np.int64)
        self.held = np.array([state.held for state in states], dtype=np.int64)
        self.released = np.array([state.released for state in states], dtype=bool)
        self.phases = np.array([state.phase for state in states], dtype=float)
        size = simulator.model.unknowns_per_impact - 1
        sections = [state.section for state in states]
        self.sections = np.array(sections, dtype=float).reshape(len(states), size)

    def state(self, k: int) -> State:
        """Return where a motion is."""
        velocity, *others = self.sections[k].tolist()
        place = int(self.walls[k]), float(self.phases[k]), velocity, int(self.turns[k])
        return State(*place, tuple(others), int(self.held[k]), bool(self.released[k]))

    def run(self, chosen: Array, periods: int) -> list[Outcome]:
        """Move the motions of these numbers on, by so many periods; those that end before stay
        there."""
        outcomes = [Outcome.DONE] * len(chosen)
        if not len(chosen):
            return outcomes
        call = self.simulator.machine.batch(periods * len(chosen))
        alone = np.ones(len(chosen), dtype=bool)
        if call is not None:
            alone = (self.held[chosen] != 0) | self.released[chosen]
            ends = self._run_compiled(call, chosen[~alone], periods)
            for place, end in zip(np.flatnonzero(~alone).tolist(), ends, strict=True):
                alone[place] = end is None
                outcomes[place] = end or Outcome.DONE
        for place in np.flatnonzero(alone).tolist():
            k = int(chosen[place])
            run = self.simulator.run(self.state(k), periods=periods, record=False)
            outcomes[place] = run.outcome
            if run.outcome is Outcome.DONE and run.end is not None:
                self._put(k, run.end)
        return outcomes

    def _run_compiled(self, call: Call, chosen: Array, periods: int) -> list[Outcome | None]:
        """Why each of some motions ended; None for those that compiled code leaves to Python."""
        if not len(chosen):
            return []
        at = _rows(self.walls[chosen], self.turns[chosen], 0 * chosen)
        speeds = np.max(np.abs(self.sections[chosen][:, ::2]), axis=1)
        fastest = [self.simulator.runaway_speed(speed) for speed in speeds.tolist()]
        when = _rows(self.phases[chosen], self.sections[chosen], fastest)
        limits = _rows(0 * chosen + LONGEST, self.turns[chosen] + periods)
        dear, stopped = self.simulator.machine.dear, threading.Event()
        most = OF_DEAR if dear else AT_A_TIME
        step = max(1, min(periods, most))
        size = min(most // step, FEW_STARTS) if dear else most // step
        rounds = max(PARTS, math.ceil(len(chosen) / (size * self.threads)))
        parts = np.array_split(np.arange(len(chosen)), min(len(chosen), rounds * self.threads))

        def make(part: Array) -> None:
            for passed in range(step, periods + step, step):
                part = part[(at[part, 2] == DONE) & (at[part, 1] < limits[part, 1])]
                if not len(part) or stopped.is_set():
                    return
                given = at[part], when[part], limits[part]
                given[2][:, 1] = np.minimum(limits[part, 1], self.turns[chosen[part]] + passed)
                call(*(table.reshape(-1) for table in given))
                at[part], when[part] = given[:2]

        if self.threads > 1 and len(parts) > 1:
            from concurrent.futures import ThreadPoolExecutor

            with ThreadPoolExecutor(self.threads) as pool:
                try:
                    list(pool.map(make, parts))
                except KeyboardInterrupt:
                    stopped.set()
                    raise
        else:
            for part in parts:
                make(part)
        early = (at[:, 2] == DONE) & (at[:, 1] < limits[:, 1])
        at[early, 2] = LEFT
        moved: Array = at[:, 2] == DONE
        done = chosen[moved]
        self.walls[done], self.turns[done] = at[moved, 0], at[moved, 1]
        self.phases[done], self.sections[done] = when[moved, 0], when[moved, 1:-1]
        return [None if code == LEFT else OUTCOMES[code] for code in at[:, 2].tolist()]

    def _put(self, k: int, state: State) -> None:
        self.walls[k], self.turns[k], self.phases[k] = state.wall, state.turns, state.phase
        self.held[k], self.released[k] = state.held, state.released
        self.sections[k] = state.section


def _rows(*columns: Any) -> Array:
    """Columns side by side; rows are contiguous."""
    return np.ascontiguousarray(np.column_stack(columns))


# Motions that meet no guard: the periodic motion they settle on, as it passes the section t = 0.
#
# A linear mode has one, the fixed point of its map over a forcing period, if that contracts. Of
# other flights of one coordinate, and of those that are integrated, the motion itself is looked at,
# after as many periods as a flight may last.

CONTRACTS = 1.0 - 1e-9
"""A map contracts if its multipliers are below this; undamped they are one within rounding."""

TOGETHER = 16
"""Periods for which a motion is followed before it is looked at."""
REPEATED, ROUNDED = 1e-9, 1e-13
"""A motion that differs by less from one period to the next has settled, by its size; below this
part of the place of the wall that it has left, it is rounding."""


def free_motion(
    simulator: Simulator, mode: str, left: State | Sequence[float] | None = None
) -> tuple[float, ...] | None:
    """Return position and velocity of each coordinate at t = 0, x0, v0, x1, v1, ...

    The motion continues in this mode after its last impact `left`, or after such numbers. None if
    it settles on no motion of the forcing's period, or on none that is known; without forcing it is
    where it is after its longest flight.
    """
    law = simulator.machine.law_in(mode)
    if law is not None:
        return _fixed_point(law, simulator, mode)
    flow = _flow_of_section(simulator, mode)
    affine = not simulator.kernels.integrated(SECTION)
    if flow is not None and mode == simulator.model.first_mode and affine:
        return _fixed_point_of(flow, simulator.period)
    onward = flow if simulator.kernels.integrated(_letter_before(simulator, mode)) else None
    if isinstance(left, State):
        after = _flow_of_impact(simulator, left)
        return after and _repeating_motion(simulator, after, onward, left.wall)
    if flow is None or left is None:
        return None
    return _repeating_motion(simulator, functools.partial(flow, left), onward, 0)


def state_after(
    simulator: Simulator, mode: str, motion: tuple[float, ...], time: float
) -> tuple[list[float], list[float]] | None:
    """Return position and velocity some time after t = 0, guards passed through.

    None if the mode is neither linear nor integrated nor, of one coordinate, the first one.
    """
    place, speed = list(motion[::2]), list(motion[1::2])
    law, d = simulator.machine.law_in(mode), len(place)
    if time == 0.0:
        return place, speed
    if law is None:
        flow = _flow_of_section(simulator, mode)
        if flow is None:
            return None
        after = flow(motion, time)
        return after[::2], after[1::2]
    moved = law.track(law.embedded(place, speed, 0.0), simulator.period).at(time)
    return moved[:d].tolist(), moved[d : 2 * d].tolist()


def _fixed_point(motion: LinearMotion, simulator: Simulator, mode: str) -> tuple[float, ...] | None:
    """Where the affine map over a period leads back to, if it contracts: a map of the state, which
    has no velocities of coordinates of first order."""
    d, period = motion.shape.freedom, simulator.period
    machine = cast("Automaton", simulator.machine)
    wall = wall_into(simulator.model, mode)
    own = np.arange(d) < motion.own
    state = np.flatnonzero(np.concatenate([own, machine.has_inertia(wall)]))

    def moving(row: Array) -> Array:
        return machine.moving(wall, 0.0, *row.reshape(2, -1))

    at_rest = moving(np.zeros(2 * d))
    embedding = np.array([moving(unit) for unit in np.eye(2 * d)[state]]).T - at_rest[:, None]
    begin = motion.embedded(at_rest[:d], at_rest[d:], 0.0)
    forced = motion.track(begin, period).at(period)[state]
    derivative = motion.flowed(begin, period)[state] @ embedding
    if not float(np.max(np.abs(np.linalg.eigvals(derivative)))) < CONTRACTS:
        return None
    found: Array = at_rest + embedding @ np.linalg.solve(np.eye(len(state)) - derivative, forced)
    return tuple(found.reshape(2, d).T.ravel().tolist())


Flow: TypeAlias = Callable[[Sequence[float], float], list[float]]
"""Position and velocity some time after t = 0, guards passed through, from those at t = 0."""


def _flow_of_section(simulator: Simulator, mode: str) -> Flow | None:
    """The flow from t = 0 of a mode that is integrated, or, of one coordinate, of the first one, by
    kernels; None of others."""
    kernels, guard = simulator.kernels, simulator.model.WALLS[0]
    own, left = mode == simulator.model.first_mode, _letter_before(simulator, mode)
    if kernels.integrated(left):
        return functools.partial(_integrated_flow, simulator, left, mode)
    if not (kernels.planar and own):
        return None
    kernel, (by,) = kernels.since(guard.name), guard.row(1)

    def flow(state: Sequence[float], time: float) -> list[float]:
        return [float(x) / by for x in kernel(*state, time, *simulator.values)[:2]]

    return flow


def _letter_before(simulator: Simulator, mode: str) -> str:
    """What flights in a mode are named by: a guard that leads to it, or the section t = 0."""
    model = simulator.model
    return SECTION if mode == model.first_mode else simulator.letters[wall_into(model, mode)]


def _integrated_flow(
    simulator: Simulator, left: str, mode: str, state: Sequence[float], time: float
) -> list[float]:
    """The flow from t = 0 in the mode after a guard, or the first one; see `_end_of`.

    Velocities of coordinates of first order are by their laws: a state may be of other values.
    """
    freedom, (place, speed) = simulator.model.DEGREES_OF_FREEDOM, (state[::2], state[1::2])
    if not isinstance(simulator.machine, OneCoordinate):
        moving = simulator.machine.moving(wall_into(simulator.model, mode), 0.0, place, speed)
        place, speed = moving.reshape(2, -1).tolist()
    field, numbers = simulator.kernels.field(left)(*[0.0] * (2 * freedom), *simulator.values)
    n = statement(field).freedom
    begin = [numbers[0], *place[:n], *speed[:n], *numbers[1 + 2 * n :]]
    return _padded(IntegratedTrack(field, begin, time), time, freedom)


def _flow_of_impact(simulator: Simulator, left: State) -> Callable[[float], list[float]] | None:
    """The same after an impact; None of several coordinates that are not integrated."""
    kernels, name = simulator.kernels, simulator.letters[left.wall]
    if not kernels.planar:
        return functools.partial(_end_of, simulator, left) if kernels.integrated(name) else None
    kernel = kernels.motion(name)
    place, (by,) = simulator.positions[left.wall], simulator.model.WALLS[left.wall].row(1)

    def flow(time: float) -> list[float]:
        dt = time - left.phase
        moved, speed = kernel(left.phase, left.velocity, dt, *simulator.values)[:2]
        return [float(place + moved) / by, float(speed) / by]

    return flow


def _end_of(simulator: Simulator, left: State, time: float) -> list[float]:
    """Position and velocity of each coordinate after an impact whose flight is integrated."""
    name, row, length = simulator.letters[left.wall], [left.phase, *left.section], time - left.phase
    track = integrated_track(simulator.kernels, name, row, simulator.values, length)
    return _padded(track, length, simulator.model.DEGREES_OF_FREEDOM)


def _padded(track: IntegratedTrack, time: float, freedom: int) -> list[float]:
    """The state on a track; coordinates that the mode does not have are at zero."""
    found = np.zeros((freedom, 2))
    (place,), (speed,) = track.at(np.array([time]))
    found[: len(place)] = np.column_stack([place, speed])
    numbers: list[float] = found.ravel().tolist()
    return numbers


def _fixed_point_of(flow: Flow, period: float) -> tuple[float, ...] | None:
    """The same of a closed form, which is affine in the state."""
    rate = 2.0 * math.pi / period
    try:
        forced = np.array(flow((0.0, 0.0), period))
        size = float(np.max(np.abs(forced) / (1.0, rate))) or 1.0
        units = [flow(state, period) for state in ((size, 0.0), (0.0, size * rate))]
    except ArithmeticError:
        return None
    derivative = (np.array(units) - forced).T / (size, size * rate)
    found = np.zeros(2)
    if not np.all(np.isfinite(derivative)):
        return None
    if not float(np.max(np.abs(np.linalg.eigvals(derivative)))) < CONTRACTS:
        return None
    for _ in range(2):  # again, for what the differences have lost
        miss = np.array(flow(found.tolist(), period)) - found
        found += np.linalg.solve(np.eye(2) - derivative, miss)
    return tuple(found.tolist())


def _repeating_motion(
    simulator: Simulator, after: Callable[[float], list[float]], onward: Flow | None, wall: int
) -> tuple[float, ...] | None:
    """The motion after its longest flight, beside a wall, if it is the same a period before."""
    row = simulator.model.WALLS[wall].row(simulator.model.DEGREES_OF_FREEDOM)
    by, period = max(row, key=abs), simulator.period
    longest, place = simulator.longest_flight, simulator.positions[wall]
    try:
        if onward is None or simulator.model.autonomous:
            ends = np.array([after(periods * period) for periods in (longest - 1, longest)])
        else:
            ends = _settled_states(onward, after(period), period, longest - 1)
    except ArithmeticError:
        return None
    places, rounding = natural_places(ends, simulator.period), ROUNDED * abs(place / by)
    apart, size = float(np.max(np.abs(places[1] - places[0]))), float(np.max(np.abs(places[1])))
    if not (apart <= max(REPEATED * size, rounding) or simulator.model.autonomous):
        return None
    return tuple(np.where(np.abs(places[1]) > rounding, ends[1], 0.0).tolist())


def _settled_states(onward: Flow, state: list[float], period: float, most: int) -> Array:
    """States a period apart, of a motion from t = 0 on: after so many periods, or before, where
    what is left of the way, by the rate at which it has become shorter, is rounding, twice."""
    passed, first, still = 0, 0.0, 0
    ends = np.array([state, state])
    while passed < most and still < 2:
        many = min(TOGETHER, most - passed)
        before = onward(state, (many - 1) * period) if many > 1 else state
        state, passed = onward(before, period), passed + many
        places = natural_places(ends := np.array([before, state]), period)
        apart, size = (float(np.max(np.abs(x))) for x in (places[1] - places[0], places[1]))
        first = apart if passed == many else first
        rate = (apart / first) ** (1.0 / passed) if first else 0.0
        still = still + 1 if apart * rate <= (1.0 - rate) * ROUNDED * size else 0
    return ends


ROUNDS, SAMPLES = 16, 64
"""Natural times for which a motion without forcing is looked at, and instants in each."""
RESTED, POLISHED = 1e-6, 4
"""Distance from a state of rest, by its size, at which a motion counts as at rest if that is
stable; steps of Newton's iteration to it."""
DISTURBED, GROWS = 1e-6, 1e-7
"""Size of a disturbance, in natural units, and by which part it grows in a natural time if it is
not rounding."""


def limit_cycle(
    simulator: Simulator, mode: str, motion: tuple[float, ...]
) -> tuple[tuple[float, ...] | None, float]:
    """Return a motion without forcing where its first coordinate is largest, and the time after
    which it is there again; the motion and 0 where it rests, None and 0 where that is not stable,
    None and NaN where it does neither."""
    if simulator.machine.law_in(mode) is not None:  # it is linear, and has been found to contract
        return motion, 0.0
    flow, step = _flow_of_section(simulator, mode), simulator.period / SAMPLES
    if flow is None:
        return None, math.nan
    rest = _rest_near(simulator, flow, motion)
    if rest is not None and _is_near(simulator, motion, rest, RESTED):
        motion = rest
    if _repeat(simulator, motion, flow(motion, simulator.period)):
        return (motion if _is_stable(simulator, flow, motion) else None), 0.0
    turns: list[tuple[float, list[float]]] = []
    state = list(motion)
    for k in range(ROUNDS * SAMPLES):
        further = flow(state, step)
        if state[1] > 0.0 >= further[1]:
            time = _turning_time(flow, state, step)
            turns.append((k * step + time, flow(state, time)))
            if _repeat(simulator, turns[0][1], turns[-1][1]) and len(turns) > 1:
                largest = max((place for _, place in turns[1:]), key=lambda place: place[0])
                return (largest[0], 0.0, *largest[2:]), turns[-1][0] - turns[0][0]
        state = further
    return None, math.nan


def moved_rest(
    simulator: Simulator, mode: str, motion: tuple[float, ...]
) -> tuple[float, ...] | None:
    """Return the state to which a state of rest has moved from neighbouring values, if it is stable
    there: beside a Hopf bifurcation motion comes to it slowly. None where all is linear."""
    flow = None if simulator.machine.law_in(mode) else _flow_of_section(simulator, mode)
    rest = flow and _rest_near(simulator, flow, motion)
    return rest if flow and rest and _is_stable(simulator, flow, rest) else None


def _rest_near(
    simulator: Simulator, flow: Flow, motion: Sequence[float]
) -> tuple[float, ...] | None:
    """The state of rest to which Newton's iteration leads from a motion directly."""
    step, found, before = simulator.period / SAMPLES, np.array(motion), math.inf
    for _ in range(POLISHED):
        moving = _flow_derivative(simulator, flow, found, step) - np.eye(len(found))
        try:
            way = np.linalg.solve(moving, np.subtract(flow(found.tolist(), step), found))
        except np.linalg.LinAlgError:
            return None
        length = float(np.max(np.abs(natural_places(way[None], simulator.period))))
        size = float(np.max(np.abs(natural_places(found[None], simulator.period))))
        if not length <= max(0.5 * before, REPEATED * size):
            return None
        found, before = found - way, length
    return tuple(found.tolist())


def _turning_time(flow: Flow, state: Sequence[float], step: float) -> float:
    """When, within a step, the first coordinate ceases to rise."""
    from scipy.optimize import brentq

    def speed(time: float) -> float:
        return flow(state, time)[1] if time else state[1]

    return float(brentq(speed, 0.0, step, xtol=UNIT * step, rtol=8.0 * UNIT))


def _is_stable(simulator: Simulator, flow: Flow, motion: Sequence[float]) -> bool:
    """Whether small disturbances of a motion at rest do not grow."""
    grown = _flow_derivative(simulator, flow, motion, simulator.period)
    return bool(np.max(np.abs(np.linalg.eigvals(grown))) < 1.0 + GROWS)


def _flow_derivative(
    simulator: Simulator, flow: Flow, motion: Sequence[float] | Array, time: float
) -> Array:
    """How the state after some time depends on that at first, by small disturbances."""
    size = DISTURBED * simulator.fastest
    units = np.resize([size * simulator.period / (2.0 * math.pi), size], len(motion))
    columns = []
    for unit, disturbance in zip(units, np.diag(units), strict=True):
        ends = [flow(np.add(motion, sign * disturbance), time) for sign in (1.0, -1.0)]
        columns.append(np.subtract(ends[0], ends[1]) / (2.0 * unit))
    return np.array(columns).T


def _repeat(simulator: Simulator, one: Sequence[float], other: Sequence[float]) -> bool:
    """Whether two states are one, by their size."""
    return _is_near(simulator, one, other, REPEATED)


def _is_near(
    simulator: Simulator, one: Sequence[float], other: Sequence[float], part: float
) -> bool:
    """Whether two states are as near to each other as a part of their size."""
    places = natural_places([one, other], simulator.period)
    return bool(np.max(np.abs(places[1] - places[0])) <= part * np.max(np.abs(places)))


def natural_places(motions: Sequence[Sequence[float]] | Array, period: float) -> Array:
    """Return rows of positions and velocities in turn, in one unit: a velocity as the position that
    it is in a wave of the forcing."""
    found = np.array(motions, dtype=float)
    found[:, 1::2] *= period / (2.0 * math.pi)
    return found
