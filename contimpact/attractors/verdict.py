"""What a simulated motion settles on: a periodic orbit, complex motion, sticking, rest; or nothing.

A motion counts as periodic only if it closes. When it returns close to an earlier impact, Newton's
iteration on the simulated map solves for the cycle nearby; the cycle has to be stable, and the
motion has to have reached it within `Settling.tolerance` or to approach it with its word unchanged.
Motion is complex if its largest Lyapunov exponent exceeds zero by three standard errors; motion
that is neither is reported as not settled.
"""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..results.simulate_tables import SETTLING, Settling
from ..simulation.free_motion import free_motion, later
from ..simulation.lyapunov import exponents_of
from ..simulation.run import Outcome, Run, State
from ..simulation.simulator import Simulator
from .attractor import Attractor, Kind
from .cycle import Cycle
from .cycles_of_one import cycle_of_one, sticking_cycle_of_one
from .cycles_of_several import cycle_of_several, sticking_cycle_of_several
from .periodic import parameters, periodic

KEPT = 1000
"""Impacts kept of a motion that is not periodic."""
TIMES = (0.0, 0.5, 0.25, 0.75)
"""When a motion without impacts is started anew, in periods: the first one within the guards."""
FIRST = 64
"""Impacts after which a motion is examined for the first time."""
_ENDS = {
    Outcome.RESTING: Kind.RESTING,
    Outcome.NO_IMPACT: Kind.NO_IMPACT,
    Outcome.ACCUMULATING: Kind.NOT_SETTLED,
    Outcome.BEYOND: Kind.NOT_SETTLED,
}


def settle(
    simulator: Simulator, state: State | None, settling: Settling = SETTLING, *, mode: str = ""
) -> Attractor:
    """Simulate until it is known what the motion settles on, or the time is up.

    Parameters
    ----------
    simulator : Simulator
    state : State or None
        Where the motion starts. None, as `Simulator.start` returns it, is a motion that meets no
        wall.
    settling : Settling
    mode : str, optional
        The mode of a motion that meets no wall; the first one by default, as of `Simulator.start`.

    Returns
    -------
    Attractor
    """
    if state is None:
        return without_impact(simulator, mode)
    begun, made = state.turns, 0
    run = simulator.run(state, impacts=FIRST)
    if run.outcome is not Outcome.DONE:
        return _ended(simulator, run)
    if (found := _sticking(simulator, run, settling)) is not None:
        return periodic(simulator, *found, periods=int(run.turns[-1]) - begun)
    run = simulator.run(state, periods=settling.transient, record=False)
    earlier: tuple[Cycle, float, int] | None = None
    window = FIRST
    while run.outcome is Outcome.DONE and run.end is not None:
        periods = run.end.turns - begun
        if periods - settling.transient > settling.periods:
            return _unsettled(simulator, run.end, settling, periods)
        run = simulator.run(run.end, impacts=window)
        made += len(run)
        window = min(2 * window, 2 * settling.longest)
        found = _near(simulator, run, settling.longest)
        if found is not None:
            cycle, distance = found
            if distance < settling.tolerance or _approached(earlier, cycle, distance, made):
                return periodic(simulator, cycle, distance, periods)
            if earlier is None or not np.array_equal(earlier[0].walls, cycle.walls):
                earlier = (cycle, distance, made)
    return _ended(simulator, run)


def _near(simulator: Simulator, run: Run, longest: int) -> tuple[Cycle, float] | None:
    """The stable cycle near the end of a run, and the distance to it."""
    return (cycle_of_several if simulator.several else cycle_of_one)(simulator, run, longest)


def _sticking(simulator: Simulator, run: Run, settling: Settling) -> tuple[Cycle, float] | None:
    """The cycle of a motion that sticks and has reached it."""
    if not simulator.several:
        return sticking_cycle_of_one(run) if run.released.any() else None
    found = sticking_cycle_of_several(simulator, run)
    return found if found and found[1] < settling.tolerance else None


def _approached(
    earlier: tuple[Cycle, float, int] | None, cycle: Cycle, distance: float, made: int
) -> bool:
    """Whether a motion approaches its cycle at the rate of the cycle's multiplier.

    At least half of the logarithm of the decay is required.
    """
    if earlier is None or not np.array_equal(earlier[0].walls, cycle.walls):
        return False
    if cycle.held.any():
        return False  # it is not solved for
    rounds = (made - earlier[2]) / len(cycle.walls)
    return distance < earlier[1] * abs(cycle.multipliers[0]) ** (0.5 * rounds)


def _ended(simulator: Simulator, run: Run) -> Attractor:
    """The attractor of a run that ended by itself."""
    if run.left is not None:
        mode = simulator.model.WALLS[run.left.wall].next_mode
        return without_impact(simulator, mode, run.left)
    kind = _ENDS[run.outcome]
    return Attractor(kind, parameters(simulator), kind.value, simulator.period, state=run.end)


def without_impact(simulator: Simulator, mode: str = "", left: State | None = None) -> Attractor:
    """Return the motion without impacts in a mode, after its last one if there was one."""
    modes = [each.name for each in simulator.model.MODES]
    mode = mode or next(iter(modes), "")
    if mode not in (modes or [""]):
        raise InputError("mode", f"no mode {mode!r}", f"the modes are {', '.join(modes)}")
    kind = Kind.NO_IMPACT
    named = f"{kind.value} ({mode})" if mode in modes[1:] else kind.value
    motion = free_motion(simulator, mode, left)
    known = parameters(simulator)
    return Attractor(kind, known, named, simulator.period, mode=mode, motion=motion)


def settle_again(
    simulator: Simulator, attractor: Attractor, settling: Settling = SETTLING
) -> Attractor | None:
    """Return what an attractor of neighbouring parameter values leads to.

    None if that cannot be told: its motion is not known, or cannot be started without an impact.
    """
    if attractor.state is not None:
        return settle(simulator, attractor.state, settling)
    if attractor.motion is None:
        return None
    for part in TIMES:
        time = part * simulator.period
        try:
            at = later(simulator, attractor.mode, attractor.motion, time)
            state = at and simulator.start(time, *at, attractor.mode)
        except InputError:  # a guard has passed it, or its flights begin at guards alone
            continue
        if at is not None:
            return settle(simulator, state, settling, mode=attractor.mode)
    return None


def _unsettled(simulator: Simulator, state: State, settling: Settling, periods: int) -> Attractor:
    """Complex motion if the largest exponent is clearly positive, otherwise not settled."""
    run = simulator.run(state, impacts=settling.impacts)
    if run.outcome is not Outcome.DONE:
        return _ended(simulator, run)
    if (sticking := _sticking(simulator, run, settling)) is not None:
        return periodic(simulator, *sticking, periods=periods)
    found = exponents_of(simulator, state, run)
    is_complex = found.per_impact[0] > 3.0 * found.error
    rate = found.impacts / found.periods
    shares = [np.count_nonzero(run.walls == k) / len(run) for k in range(len(simulator.letters))]
    counts = ":".join(str(round(share * rate)) for share in shares)
    last = slice(-KEPT, None)
    return Attractor(
        Kind.COMPLEX if is_complex else Kind.NOT_SETTLED,
        parameters(simulator),
        f"{counts}/C" if is_complex else Kind.NOT_SETTLED.value,
        simulator.period,
        walls=run.walls[last],
        times=run.times[last],
        velocities=run.velocities[last],
        released=run.released[last],
        others=run.others[last],
        held=run.held[last],
        exponents=found.per_impact,
        error=found.error,
        restitution=found.restitution,
        per_period=found.per_period,
        rate=rate,
        periods=periods,
        state=run.end,
    )
