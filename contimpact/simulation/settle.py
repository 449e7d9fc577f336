"""What a simulation settles on: periodic, chaotic or at rest, with its exponents.

A motion counts as periodic only if it closes. When it returns close to an earlier impact, Newton's
iteration on the simulated map solves for the cycle nearby; the cycle has to be stable, and the
motion has to have reached it within `Settling.tolerance` or to approach it with its word unchanged.
Motion is complex if its largest Lyapunov exponent exceeds zero by three standard errors; motion
that is neither is reported as not settled.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.linalg import eig

from ..arrays import Array
from ..errors import InputError, explain_arguments
from ..models.model import Model, require_forcing
from ..models.word import Word
from ..results.options import SETTLING, Settling
from ..segments.flight import FlightGaps, flight_gaps
from ..segments.touches import interior_touches
from .attractor import Attractor, Cycle, Kind, cycle_near, repeats, sticking_cycle
from .lyapunov import Contraction, contraction, derivative_product, exponents_of
from .run import Outcome, Run, State
from .simulator import Simulator, as_simulator, free_motion, state_after

# Multipliers and exponents of cycles, and what rounding leaves of them.
#
# To first order a multiplier is off by
#
# .. math:: |\delta\mu| \le \frac{|y|^\top E\,|x|}{|y^* x|}
#
# where E bounds the errors of the derivative's entries, and y and x are the left and the right
# eigenvector (Golub and Van Loan, Matrix Computations, 2013, sec. 7.2); and by no less than errors
# of random signs move it, which matters where they are larger than what separates eigenvalues. If
# one multiplier alone is lost, it is what the determinant leaves.

NEGLIGIBLE = 1e-9
"""An error below this part of a multiplier is none."""
LOST = 0.1
"""A multiplier off by more than this part is lost."""
TRIALS = 9
"""Derivatives looked at: the one found, and some with errors of random signs."""


@dataclass(frozen=True)
class CycleContraction:
    """What the linearised map around a cycle tells."""

    multipliers: tuple[complex, ...]
    """The largest first; zero where rounding leaves nothing of them."""
    exponents: tuple[float, ...]
    """Per impact; NaN where rounding leaves nothing of the multiplier."""
    error: float
    """Error of the largest exponent by rounding; NaN where it is unknown."""
    total: float
    """The sum of all exponents, from determinants; NaN where it is unknown."""


def contraction_of(simulator: Simulator, cycle: Cycle) -> CycleContraction:
    """Return multipliers and exponents of a cycle, with what rounding leaves of them.

    Of motion that sticks they are as the cycle has them.
    """
    count, mus = len(cycle.walls), tuple(complex(mu) for mu in cycle.multipliers)
    if cycle.released.any() or cycle.held.any():
        each = tuple(_log(mu) / count for mu in mus)
        return CycleContraction(mus, each, 0.0, sum(each))
    rows = _rows(cycle, simulator.period)
    whole = contraction(simulator, rows)
    errors = _errors(*derivative_product(simulator, rows), mus)
    mus, logs, error = _multiplier_sizes(mus, errors, whole)
    total = math.fsum(logs) if math.isnan(whole.logarithm) else whole.logarithm
    error = 0.0 if error <= NEGLIGIBLE else -math.log1p(-min(error, 1.0 - NEGLIGIBLE))
    return CycleContraction(mus, tuple(e / count for e in logs), error / count, total / count)


def _log(mu: complex) -> float:
    return math.log(abs(mu)) if mu != 0 else -math.inf


def _multiplier_sizes(
    mus: tuple[complex, ...], errors: list[float], whole: Contraction
) -> tuple[tuple[complex, ...], list[float], float]:
    """Multipliers and the logarithms of their sizes, zero and NaN where lost, and the error of the
    first one's."""
    known = [error < LOST for error in errors]
    logs = [_log(mu) if k else math.nan for mu, k in zip(mus, known, strict=True)]
    told = [mu if k else 0j for mu, k in zip(mus, known, strict=True)]
    if known.count(False) == 1 and not math.isnan(whole.logarithm):
        place = known.index(False)
        rest = [k for k in range(len(mus)) if k != place]
        logs[place] = whole.logarithm - math.fsum(logs[k] for k in rest)
        errors[place] = math.fsum(errors[k] for k in rest)
        sign = whole.sign * math.copysign(1.0, np.prod([told[k] for k in rest]).real)
        told[place] = complex(sign * math.exp(logs[place]))
    return tuple(told), logs, math.nan if math.isnan(logs[0]) else errors[0]


def _errors(derivative: Array, off: Array, mus: tuple[complex, ...]) -> list[float]:
    """By which parts multipliers, the largest first, are off."""
    if not np.all(np.isfinite(derivative) & np.isfinite(off)):
        return [math.inf] * len(mus)
    found, left, right = eig(derivative, left=True, right=True)
    scale = np.abs(np.sum(left.conj() * right, axis=0))
    moved = np.sum(np.abs(left) * (off @ np.abs(right)), axis=0)
    order, sizes = np.argsort(-np.abs(found), kind="stable"), np.abs(mus)
    signs = np.random.default_rng(0).choice((-1.0, 1.0), size=(TRIALS, *off.shape))
    signs[0] = 0.0
    trials = -np.sort(-np.abs(np.linalg.eigvals(derivative + signs * off)), axis=1)
    apart = np.max(np.abs(trials - sizes), axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        parts = np.maximum((moved / scale)[order], apart) / sizes
    return [part if part >= 0.0 else math.inf for part in parts.tolist()]


def _rows(cycle: Cycle, period: float) -> list[State]:
    """The impacts of a cycle, the first one once more at the end."""
    others = [tuple(row) for row in cycle.others.tolist()] or [()] * len(cycle.walls)
    columns = cycle.walls.tolist(), cycle.times.tolist(), cycle.velocities.tolist(), others
    found = [
        State(wall, time, velocity, others=more).within(period)
        for wall, time, velocity, more in zip(*columns, strict=True)
    ]
    return [*found, replace(found[0], turns=found[0].turns + cycle.period)]


# Attractors made of cycles: the word from its first rotation on, its notation, its gaps.


def parameters(simulator: Simulator) -> dict[str, float]:
    """Return every parameter and derived parameter of a simulated model."""
    return {**simulator.model.values, **simulator.derived}


def periodic(
    simulator: Simulator, cycle: Cycle, distance: float = 0.0, periods: int = 0
) -> Attractor:
    """Return the attractor of a stable cycle."""
    cycle = _first_rotation(cycle, simulator.period)
    sticks = bool(cycle.released.any() or cycle.held.any())
    word = _sticking_word(simulator, cycle) if sticks else _letters(simulator, cycle.walls)
    count, smallest = len(cycle.walls), math.nan
    found = contraction_of(simulator, cycle)
    logs = [2.0 * math.log(e) if e else -math.inf for e in simulator.restitution]
    if sticks:
        notation = _sticking_notation(simulator, cycle)
    else:
        notation = Word(word, cycle.period).notation(simulator.letters)
        smallest = _smallest_gap(simulator, word, cycle)
    return Attractor(
        Kind.STICKING if sticks else Kind.PERIODIC,
        parameters(simulator),
        notation,
        simulator.period,
        word,
        **(vars(cycle) | {"multipliers": found.multipliers}),
        exponents=found.exponents,
        error=found.error,
        exponent_sum=found.total,
        restitution=math.nan if sticks else float(np.mean([logs[wall] for wall in cycle.walls])),
        per_period=found.exponents[0] * count / cycle.period,
        rate=math.inf if sticks else count / cycle.period,
        smallest_gap=smallest,
        distance=distance,
        periods=periods,
        state=cycle.state(simulator.period),
    )


def _letters(simulator: Simulator, walls: Array) -> str:
    return "".join(simulator.letters[k] for k in walls.tolist())


def _first_rotation(cycle: Cycle, period: float) -> Cycle:
    """The cycle in its first rotation: walls in order, the faster impact first."""
    n = len(cycle.walls)
    span = cycle.period * period
    walls, fast = cycle.walls.tolist(), np.abs(cycle.velocities).tolist()

    def key(shift: int) -> tuple[list[int], bool, float]:
        # a rotation begins with an impact, not in the middle of chatter
        order = [(i + shift) % n for i in range(n)]
        return [walls[i] for i in order], bool(cycle.released[order[0]]), -fast[order[0]]

    shift = min(range(n), key=key)
    times = np.roll(cycle.times, -shift).copy()
    times[n - shift :] += span
    times -= math.floor(times[0] / period) * period
    roll = [np.roll(a, -shift) for a in (cycle.walls, cycle.velocities, cycle.released)]
    others = np.roll(cycle.others, -shift, axis=0), np.roll(cycle.held, -shift)
    told = cycle.period, cycle.multipliers, cycle.closing
    return Cycle(roll[0], times, roll[1], roll[2], *told, *others)


def _sticking_word(simulator: Simulator, cycle: Cycle) -> str:
    """The word, chatter that ends in a sojourn written as its wall and ``*``."""
    n = len(cycle.walls)
    dropped: set[int] = set()
    parts: list[list[str]] = []
    for wall, released in zip(cycle.walls, cycle.released, strict=True):
        parts.append([simulator.letters[wall] + ("*" if released else "")])
    for wall, first, last in _sojourns(cycle):
        i = (first - 1) % n
        while i != last and cycle.walls[i] == wall and not cycle.released[i]:
            dropped.add(i)
            i = (i - 1) % n
        if not (cycle.released[last] and cycle.walls[last] == wall):
            parts[last].insert(0, simulator.letters[wall] + "*")
    kept = ["".join(part) for i, part in enumerate(parts) if i not in dropped]
    rotations = [kept[i:] + kept[:i] for i in range(len(kept))]
    return "".join(min(rotations))


def _sojourns(cycle: Cycle) -> Iterator[tuple[int, int, int]]:
    """The wall of each sojourn, and the rows before which it begins and with which it ends."""
    n = len(cycle.walls)
    if not cycle.held.size:
        for k in np.nonzero(cycle.released)[0].tolist():
            yield int(cycle.walls[k]), k, k
        return
    held = cycle.held.tolist()
    for wall in range(max(held).bit_length()):
        for k in range(n):
            if held[k] >> wall & 1 and not held[k - 1] >> wall & 1:
                last = k
                while held[(last + 1) % n] >> wall & 1 and (last + 1) % n != k:
                    last = (last + 1) % n
                yield wall, k, last


def _sticking_notation(simulator: Simulator, cycle: Cycle) -> str:
    """Impacts per wall, infinite on walls where they accumulate."""
    stuck = {wall for wall, _, _ in _sojourns(cycle)}
    totals = [int(np.count_nonzero(cycle.walls == k)) for k in range(len(simulator.letters))]
    p = cycle.period
    finite = [total for k, total in enumerate(totals) if k not in stuck]
    whole = all(total % p == 0 for total in finite)
    each = [total // p if whole else total for total in totals]
    counts = ":".join("inf" if k in stuck else str(n) for k, n in enumerate(each))
    if p == 1:
        return counts
    return f"{counts}/{p}T" if whole else f"({counts})/{p}T"


def _smallest_gap(simulator: Simulator, word: str, cycle: Cycle) -> float:
    impacts = np.column_stack([cycle.times, cycle.velocities])
    touches: Callable[..., list[FlightGaps]] = flight_gaps
    if cycle.held.size:
        impacts, touches = np.column_stack([impacts, cycle.others]), interior_touches
    span = cycle.period * simulator.period
    flights = touches(simulator.kernels, word, simulator.values, impacts, span)
    gaps = [t.gap for flight in flights for t in flight.touches if t is not None]
    return min(gaps, default=math.nan)


KEPT = 1000
"""Impacts kept of a motion that is not periodic."""
TIMES = (0.0, 0.5, 0.25, 0.75)
"""Times, in periods, at which a motion without impacts is started again: the first one within the
guards is taken."""
FIRST = 64
"""Impacts after which a motion is examined for the first time."""
PASSING = 0.3
"""Factor by which a motion that approaches a cycle may come near faster."""
_ENDS = {
    Outcome.RESTING: Kind.RESTING,
    Outcome.NO_IMPACT: Kind.NO_IMPACT,
    Outcome.RUNAWAY: Kind.RUNAWAY,
    Outcome.ACCUMULATING: Kind.NOT_SETTLED,
    Outcome.BEYOND: Kind.NOT_SETTLED,
    Outcome.UNDEFINED: Kind.NOT_SETTLED,
}


def require_attractors(model: Model) -> None:
    """Raise `InputError` for a system whose attractors cannot be told."""
    accepted = "use Simulator for single motions, find_orbits for orbits"
    require_forcing(model, "model", "attractors are told by", accepted)


@explain_arguments
def settle(
    simulator: Simulator | Model,
    state: State | Literal["random"] | None = "random",
    settling: Settling = SETTLING,
    *,
    mode: str = "",
) -> Attractor:
    """Simulate until it is known what the motion settles on, or the time is up.

    Parameters
    ----------
    simulator : Simulator or Model
    state : State or None, optional
        Where the motion starts; an impact at random by default. None, as `Simulator.start` returns
        it, is a motion that meets no wall.
    settling : Settling
    mode : str, optional
        The mode of a motion that meets no wall; the first one by default, as of `Simulator.start`.

    Returns
    -------
    Attractor

    Raises
    ------
    InputError
        If the system has no forcing.
    """
    simulator = as_simulator(simulator)
    require_attractors(simulator.model)
    if isinstance(state, str):
        state = simulator.random_state()
    if state is None:
        found = without_impact(simulator, mode)
    else:
        found = _settled(simulator, state, settling)
    return replace(found, model=simulator.model)


def _settled(simulator: Simulator, state: State, settling: Settling) -> Attractor:
    """What the motion from a state settles on."""
    begun, made = state.turns, 0
    run = simulator.run(state, impacts=FIRST)
    if run.outcome is not Outcome.DONE:
        return _attractor_of_end(simulator, run)
    if (found := _sticking(simulator, run, settling)) is not None:
        return periodic(simulator, *found, periods=int(run.turns[-1]) - begun)
    run = simulator.run(state, periods=settling.transient, record=False)
    earlier: tuple[Cycle, float, int] | None = None
    window = FIRST
    while run.outcome is Outcome.DONE and run.end is not None:
        periods = run.end.turns - begun
        if periods - settling.transient > settling.periods:
            return _unsettled_motion(simulator, run.end, settling, periods)
        run = simulator.run(run.end, impacts=window)
        made += len(run)
        window = min(2 * window, 2 * settling.longest)
        found = cycle_near(simulator, run, settling.longest)
        if found is not None:
            cycle, distance = found
            close = distance < settling.tolerance
            if close or _approaches_cycle(earlier, cycle, distance, made, run):
                return periodic(simulator, cycle, distance, periods)
            earlier = (cycle, distance, made)
    return _attractor_of_end(simulator, run)


def _sticking(simulator: Simulator, run: Run, settling: Settling) -> tuple[Cycle, float] | None:
    """The cycle of a motion that sticks and has reached it."""
    found = sticking_cycle(simulator, run)
    return found if found and found[1] < settling.tolerance else None


def _approaches_cycle(
    earlier: tuple[Cycle, float, int] | None, cycle: Cycle, distance: float, made: int, run: Run
) -> bool:
    """Whether a motion approaches its cycle at the rate of the cycle's multiplier.

    At least half of the logarithm of the decay is required, and at most twice of it but for a
    factor: what comes near faster may pass. The walls have to be those of the cycle already: beside
    it there may be a longer one, which passes it in each round.
    """
    if earlier is None or not np.array_equal(earlier[0].walls, cycle.walls):
        return False
    if cycle.held.any():
        return False  # it is not solved for
    if not earlier[1] > 0.0 or not repeats(run.walls, len(cycle.walls)):
        return False
    rounds = (made - earlier[2]) / len(cycle.walls)
    rate, ratio = abs(cycle.multipliers[0]) ** rounds, distance / earlier[1]
    return bool(PASSING * rate**2 < ratio < rate**0.5)


def _attractor_of_end(simulator: Simulator, run: Run) -> Attractor:
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
            at = state_after(simulator, attractor.mode, attractor.motion, time)
            state = at and simulator.start(time, *at, attractor.mode)
        except InputError:  # a guard has passed it, or its flights begin at guards alone
            continue
        if at is not None:
            return settle(simulator, state, settling, mode=attractor.mode)
    return None


def _unsettled_motion(
    simulator: Simulator, state: State, settling: Settling, periods: int
) -> Attractor:
    """Complex motion if the largest exponent is clearly positive, otherwise not settled."""
    run = simulator.run(state, impacts=settling.impacts)
    if run.outcome is not Outcome.DONE:
        return _attractor_of_end(simulator, run)
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
