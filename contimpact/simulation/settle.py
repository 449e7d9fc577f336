"""What a simulation settles on: periodic, chaotic or at rest, with its exponents.

A motion counts as periodic only if it closes. When it returns close to an earlier impact, Newton's
iteration on the simulated map solves for the cycle nearby; the cycle has to be stable, and the
motion has to have reached it within `Settling.tolerance` or to approach it with its word unchanged.
Motion is complex if its largest Lyapunov exponent exceeds zero by three standard errors; motion
that is neither is reported as not settled.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.linalg import eig

from ..arrays import Array
from ..errors import InputError, explain_arguments
from ..models.guards import Word, orders_of, state_before
from ..models.model import Model
from ..orbits.quiet import problem_of
from ..results.options import SETTLING, Settling
from ..segments.bounded import UNIT, bounds_of
from ..segments.flight import FlightGaps, flight_gaps
from ..segments.touches import interior_touches
from .attractor import (
    Attractor,
    Cycle,
    Kind,
    Unstable,
    cycle_near,
    map_derivatives,
    repeats,
    rounding_fills,
    sticking_cycle,
)
from .flights import jump_derivative
from .one_coordinate import OneCoordinate
from .run import Outcome, Run, State, states_of
from .simulator import Simulator, as_simulator, free_motion, limit_cycle, moved_rest, state_after

# Lyapunov exponents, by the contraction along impacts.
#
# One impact to the next changes a disturbance of (time, velocity before impact) by
# :math:`D = -B^{-1}A`. Disturbances are measured as (time, v times velocity), an energy: there the
# determinant of D is exactly r^2 where flights dissipate nothing, and the divergence at low
# velocities is weaker. The columns are kept orthogonal after each impact,
#
# .. math:: D q_1 = \rho_1 q_1', \qquad \rho_1 \rho_2 = \det D,
#
# and the exponents per impact are the means of :math:`\ln\rho_1` and :math:`\ln\rho_2`. With
# several degrees of freedom there are as many more section coordinates, exponents and factors of
# the diagonal; D is then that of `automaton`, which goes through sojourns on walls, too.
#
# By how much flights contract: determinants of the derivative of the map, by logarithms.
#
# Where flights are strongly damped all entries of the derivative are rounding, and its determinant
# is lost. Of linear flights it is known without them (Liouville): a flight of duration t multiplies
# volumes of states by :math:`e^{-t\,\mathrm{tr}\,M^{-1}C}`, an impact by the determinant of its
# law; through the surfaces of the guards they pass with the velocities of the gap coordinates,
#
# .. math:: \ln|\det D| = \ln\Bigl|\frac{\dot g_1^+}{\dot g_2}\,
#           \det\frac{\partial v_1^+}{\partial v_1}\Bigr| - t\,\mathrm{tr}\,M^{-1}C .
#
# Of other flights it is :math:`\ln|\det A| - \ln|\det B|`, where the bounds of rounding that the
# blocks have leave six digits of both.

DIGITS = 1e-6
"""Determinants known to this part are known."""


class Contraction(NamedTuple):
    """A determinant, or a product of them."""

    sign: float
    """Zero where the determinant is."""
    logarithm: float
    """Logarithm of its size; NaN where rounding leaves too little of it."""


class RoundedDerivative(NamedTuple):
    """A derivative of the map and bounds of its entries' rounding errors, shape (m, m) each."""

    derivative: Array
    errors: Array


def contraction(simulator: Simulator, rows: Sequence[State]) -> Contraction:
    """Return the determinant of the derivative of the map along impacts, no wall of them held."""
    each = [
        (_has_law(simulator, before.wall) and _law_contraction(simulator, before, after))
        or _block_contraction(simulator, before, after)
        for before, after in itertools.pairwise(rows)
    ]
    if any(found.sign == 0.0 for found in each):
        return Contraction(0.0, -math.inf)
    return Contraction(
        math.prod(found.sign for found in each), math.fsum(found.logarithm for found in each)
    )


def derivative_product(simulator: Simulator, rows: Sequence[State]) -> RoundedDerivative:
    """Return the derivative of the map along impacts, and what rounding may have added to it."""
    m = simulator.model.unknowns_per_impact
    product, errors = np.eye(m), np.zeros((m, m))
    for pair in itertools.pairwise(rows):
        step, off = _rounded_derivative(simulator, *pair)
        size = np.abs(step)
        errors = size @ errors + off @ (np.abs(product) + errors)
        errors += m * UNIT * (size @ np.abs(product))
        product = step @ product
    free = int(simulator.model.autonomous)  # as of `map_derivatives`
    return RoundedDerivative(product[free:, free:], errors[free:, free:])


def _has_law(simulator: Simulator, wall: int) -> bool:
    """Whether the flight after a guard is linear, and that before it of as many coordinates."""
    model, kernels = simulator.model, simulator.kernels
    guard, size = model.WALLS[wall], model.DEGREES_OF_FREEDOM
    modes = (*guard.modes, guard.next_mode)
    whole = all(orders_of(model.MODES, mode, size) == (2,) * size for mode in modes)
    if not whole or kernels.integrated(guard.name):
        return False
    return len(kernels.law(guard.name)(0.0, *[1.0] * (2 * size - 1), *simulator.values)) > 1


def _law_contraction(simulator: Simulator, before: State, after: State) -> Contraction | None:
    """Of a linear flight; None where positions jump."""
    size, guard = simulator.model.DEGREES_OF_FREEDOM, simulator.model.WALLS[before.wall]
    row, law = guard.row(size), simulator.kernels.law(guard.name)
    place = state_before(row, simulator.positions[before.wall], before.section)[0]
    d, h, numbers, left = law(before.phase, *before.section, *simulator.values)
    if not np.allclose(left[:size], place, rtol=1e-12, atol=1e-300):
        return None
    speed = float(np.dot(row, left[size : 2 * size]))
    factor = (
        _impact_determinant(simulator, before) * speed / after.velocity
        if after.velocity
        else math.inf
    )
    width = 2 * int(d) + 2 * int(h) + 1
    trace = math.fsum(numbers[i * width + size + i] for i in range(size))
    if factor == 0.0:
        return Contraction(0.0, -math.inf)
    duration = after.since(before, simulator.period)
    return Contraction(math.copysign(1.0, factor), math.log(abs(factor)) + trace * duration)


def _impact_determinant(simulator: Simulator, before: State) -> float:
    """The determinant of velocities after an impact by those before it."""
    size, guard = simulator.model.DEGREES_OF_FREEDOM, simulator.model.WALLS[before.wall]
    rates = jump_derivative(simulator.kernels, guard.name, before, simulator.values)
    units = np.eye(2 * size - 1)[::2].tolist()
    into = [state_before(guard.row(size), 0.0, unit)[1] for unit in units]
    return float(np.linalg.det(rates[size:, 1::2].T) / np.linalg.det(into))


def _blocks(simulator: Simulator, before: State, after: State) -> tuple[Array, Array, Array, Array]:
    """The blocks A and B of a flight, and the bounds of their errors."""
    letters, m = simulator.letters, simulator.model.unknowns_per_impact
    ends = before.flight_to(after, simulator.period)
    segment = simulator.kernels.segment(letters[before.wall], letters[after.wall])
    (_, a, b, _), (_, off_a, off_b, _) = bounds_of(segment, *ends, simulator.values)
    found = [np.array(block, dtype=float).reshape(m, m) for block in (a, b, off_a, off_b)]
    return found[0], found[1], found[2], found[3]


def _rounded_derivative(simulator: Simulator, before: State, after: State) -> RoundedDerivative:
    a, b, off_a, off_b = _blocks(simulator, before, after)
    try:
        step = -np.linalg.solve(b, a)
        return RoundedDerivative(step, np.abs(np.linalg.inv(b)) @ (off_a + off_b @ np.abs(step)))
    except np.linalg.LinAlgError:
        return RoundedDerivative(np.full(a.shape, np.inf), np.full(a.shape, np.inf))


def _block_contraction(simulator: Simulator, before: State, after: State) -> Contraction:
    a, b, off_a, off_b = _blocks(simulator, before, after)
    sign, logarithm = 1.0, 0.0
    for block, off, way in ((a, off_a, 1.0), (b, off_b, -1.0)):
        own, size = np.linalg.slogdet(block)
        if own == 0.0 and not np.any(off):
            return Contraction(0.0, -math.inf)
        try:
            shares = off.T * np.abs(np.linalg.inv(block))
        except np.linalg.LinAlgError:
            return Contraction(1.0, math.nan)
        if not np.sum(shares) < DIGITS:
            return Contraction(1.0, math.nan)
        sign, logarithm = sign * float(own), logarithm + way * float(size)
    return Contraction(sign, logarithm)


CANCELS = 1e-9
"""A factor of the diagonal, or a determinant, below this part of the others, or of its terms, is
rounding: strong damping leaves it to Liouville's formula."""


@dataclass(frozen=True)
class Exponents:
    """Lyapunov exponents of a run."""

    per_impact: tuple[float, ...]
    """The largest one first; minus infinity where the body stuck to a wall, which forgets the past:
    with one degree of freedom all of it, with several a part. NaN, and last, where damping takes
    several below rounding."""
    error: float
    """Standard error of the largest one, from the scatter of means over batches of impacts."""
    restitution: float
    """Mean of ln r^2 over the impacts, which the sum of all equals where flights do not
    dissipate."""
    impacts: int
    periods: float
    """Time that these impacts take, in forcing periods if there are any: they end where a
    derivative is infinite."""
    end: State | None
    """State at which the run ended."""

    @property
    def per_period(self) -> float:
        """The largest exponent per forcing period, or unit of time."""
        return self.per_impact[0] * self.impacts / self.periods if self.periods > 0 else math.nan


BATCHES = 20
"""Parts of a run from whose means the error of its exponents comes."""


def exponents_of(simulator: Simulator, state: State, run: Run) -> Exponents:
    """Return the Lyapunov exponents of a run from a state on the attractor.

    Benettin et al., Meccanica 15 (1980), with the QR factors of 2x2 matrices written out.
    """
    if run.held.size or run.free:
        return _exponents_by_qr(simulator, state, run)
    if not (count := len(run)) or run.released.any() or state.velocity == 0.0:
        lost, periods = -math.inf if count else math.nan, _periods(simulator, state, run.end)
        return Exponents((lost, lost), 0.0, math.nan, count, periods, run.end)
    angle = float(np.random.default_rng(0).uniform(0.0, math.pi))
    x, y = math.cos(angle), math.sin(angle)
    first, second, before = [], [], state
    columns = (run.walls, run.phases, run.velocities, run.turns)
    for row in zip(*(column.tolist() for column in columns), strict=True):
        after = State(*row)
        (tt, tv), (vt, vv) = simulator.derivative(before, after)
        # in (time, energy): the column by v is divided, the row of v multiplied by a velocity
        tv, vt = tv / before.velocity, vt * after.velocity
        vv *= after.velocity / before.velocity
        x, y = tt * x + tv * y, vt * x + vv * y
        size, det, terms = math.hypot(x, y), abs(tt * vv - tv * vt), abs(tt * vv) + abs(tv * vt)
        if not 0.0 < size < math.inf:
            break
        x, y = x / size, y / size
        first.append(math.log(size))
        whole = math.log(det) if det > CANCELS * terms else _contraction(simulator, before, after)
        second.append(whole - first[-1])
        before = after
    pair, periods = (_mean(first), _mean(second)), _periods(simulator, state, before)
    restitution = _mean(_restitutions(simulator, run.walls))
    return Exponents(pair, _scatter(first), restitution, len(first), periods, run.end)


def _exponents_by_qr(simulator: Simulator, state: State, run: Run) -> Exponents:
    """By the QR factors of the derivatives, in (time, v times velocity, the other coordinates);
    without forcing all but the time."""
    m = simulator.model.unknowns_per_impact - int(run.free)
    q = np.linalg.qr(np.random.default_rng(0).normal(size=(m, m)))[0]
    logs, before, scale = [], state, _scale(state, m)
    states = list(run.states())
    steps = map_derivatives(simulator, [state, *states], along=True)
    for after, step in zip(states, steps, strict=True):
        if not np.all(np.isfinite(step)):
            break
        next_scale = _scale(after, m)
        q, r = np.linalg.qr((next_scale[:, None] * step / scale) @ q)
        with np.errstate(divide="ignore"):
            logs.append(np.log(np.abs(np.diag(r))))
        if not (before.released or after.released or after.held):
            _without_rounding(logs[-1], step, simulator, before, after)
        before, scale = after, next_scale
    table = np.array(logs).reshape(-1, m)
    means = [_mean(column) for column in table.T.tolist()]
    known = sorted((mean for mean in means if not math.isnan(mean)), reverse=True)
    per_impact = (*known, *[math.nan] * (m - len(known)))
    scatter = _scatter(table[:, 0].tolist())
    restitution = _mean(_restitutions(simulator, run.walls))
    periods = _periods(simulator, state, before)
    return Exponents(per_impact, scatter, restitution, len(table), periods, run.end)


def _without_rounding(
    logs: Array, step: Array, simulator: Simulator, before: State, after: State
) -> None:
    """Take out what is rounding of the logarithms of a diagonal; one alone is what is left of the
    determinant, which is zero where the state has a number that the flight does not depend on."""
    lost = logs < np.max(logs) + math.log(CANCELS)
    if np.count_nonzero(lost) > 1:
        logs[lost] = math.nan
    elif np.any(lost):
        rest, regular = math.fsum(logs[~lost]), step.any(axis=0).all()
        logs[lost] = _contraction(simulator, before, after) - rest if regular else -math.inf


def _contraction(simulator: Simulator, before: State, after: State) -> float:
    """The logarithm of a flight's determinant, in the units of disturbances."""
    one, other = abs(before.velocity), abs(after.velocity)
    if not one or not other:
        return -math.inf
    return contraction(simulator, [before, after]).logarithm + math.log(other / one)


def _scale(state: State, m: int) -> Any:
    """Units of disturbances: the gap coordinate's velocity is multiplied by itself."""
    found = np.ones(1 + len(state.section))
    found[1] = abs(state.velocity) or 1.0
    return found[-m:]


def _mean(values: list[float]) -> float:
    if not values:
        return math.nan
    return -math.inf if -math.inf in values else math.fsum(values) / len(values)


def _restitutions(simulator: Simulator, walls: Array) -> list[float]:
    """ln r^2 of impacts on walls."""
    logs = [2.0 * math.log(e) if e else -math.inf for e in simulator.restitution]
    return [logs[wall] for wall in walls.tolist()]


def _periods(simulator: Simulator, one: State, other: State | None) -> float:
    """Time from one state to another, in forcing periods if there are any."""
    begun, ended = (
        math.nan if state is None else state.turns * simulator.period + state.phase
        for state in (one, other)
    )
    return (ended - begun) / (1.0 if simulator.model.autonomous else simulator.period)


def _scatter(values: list[float]) -> float:
    """Standard error of the mean, from the means of consecutive batches; none of one that is
    minus infinity."""
    size = len(values) // BATCHES
    if size < 1:
        return math.inf
    if -math.inf in values:
        return 0.0
    means = np.array(values[: size * BATCHES]).reshape(BATCHES, size).mean(axis=1)
    return float(means.std(ddof=1) / math.sqrt(BATCHES))


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
    rows = cycle.rows(simulator.period)
    whole = contraction(simulator, rows)
    errors = _errors(*derivative_product(simulator, rows), mus)
    mus, logs, error = _multiplier_sizes(mus, errors, whole)
    total = math.fsum(logs) if math.isnan(whole.logarithm) else whole.logarithm
    error = 0.0 if error <= NEGLIGIBLE else -math.log1p(-min(error, 1.0 - NEGLIGIBLE))
    return CycleContraction(mus, tuple(e / count for e in logs), error / count, total / count)


def multipliers_alone(_: Simulator, cycle: Cycle) -> CycleContraction:
    """Return the multipliers as the cycle has them, and no exponents."""
    mus = tuple(complex(mu) for mu in cycle.multipliers)
    return CycleContraction(mus, (math.nan,) * len(mus), math.nan, math.nan)


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


# Attractors made of cycles: the word from its first rotation on, its notation, its gaps.


def periodic(
    simulator: Simulator,
    cycle: Cycle,
    distance: float = 0.0,
    periods: int = 0,
    contracts: Callable[[Simulator, Cycle], CycleContraction] = contraction_of,
) -> Attractor:
    """Return the attractor of a stable cycle, with exponents as `contracts` gives them."""
    cycle = _first_rotation(cycle, simulator.period)
    sticks = bool(cycle.released.any() or cycle.held.any())
    word = _sticking_word(simulator, cycle) if sticks else _letters(simulator, cycle.walls)
    count, smallest, periods_in = len(cycle.walls), math.nan, cycle.period or cycle.span
    found = contracts(simulator, cycle)
    if sticks:
        notation = _sticking_notation(simulator, cycle)
    else:
        notation = Word(word, cycle.period).notation(simulator.letters)
        smallest = _smallest_gap(simulator, word, cycle)
    return Attractor(
        Kind.STICKING if sticks else Kind.PERIODIC,
        simulator.parameters,
        notation,
        simulator.period,
        word,
        **(vars(cycle) | {"multipliers": found.multipliers}),
        exponents=found.exponents,
        error=found.error,
        exponent_sum=found.total,
        restitution=math.nan if sticks else float(np.mean(_restitutions(simulator, cycle.walls))),
        per_period=found.exponents[0] * count / periods_in,
        rate=math.inf if sticks else count / periods_in,
        smallest_gap=smallest,
        distance=distance,
        periods=periods,
        state=cycle.state(simulator.period),
        model=simulator.model,
        free=simulator.model.autonomous,
    )


def _letters(simulator: Simulator, walls: Array) -> str:
    return "".join(simulator.letters[k] for k in walls.tolist())


def _first_rotation(cycle: Cycle, period: float) -> Cycle:
    """The cycle in its first rotation: walls in order, the faster impact first."""
    n = len(cycle.walls)
    walls, fast = cycle.walls.tolist(), np.abs(cycle.velocities).tolist()

    def key(shift: int) -> tuple[list[int], bool, float]:
        # a rotation begins with an impact, not in the middle of chatter
        order = [(i + shift) % n for i in range(n)]
        return [walls[i] for i in order], bool(cycle.released[order[0]]), -fast[order[0]]

    shift = min(range(n), key=key)
    times = np.roll(cycle.times, -shift).copy()
    times[n - shift :] += cycle.duration(period)
    times -= math.floor(times[0] / period) * period if cycle.period else times[0]
    names = ("walls", "velocities", "released", "others", "held")
    rolled = {name: np.roll(getattr(cycle, name), -shift, axis=0) for name in names}
    return replace(cycle, times=times, **rolled)


def _sticking_word(simulator: Simulator, cycle: Cycle) -> str:
    """The word, chatter that ends in a sojourn written as its wall and ``*``."""
    n = len(cycle.walls)
    dropped: set[int] = set()
    parts: list[list[str]] = []
    for wall, released in zip(cycle.walls, cycle.released, strict=True):
        parts.append([simulator.letters[wall] + ("*" if released else "")])
    for wall, first, last in sojourns(cycle):
        i = (first - 1) % n
        while i != last and cycle.walls[i] == wall and not cycle.released[i]:
            dropped.add(i)
            i = (i - 1) % n
        if not (cycle.released[last] and cycle.walls[last] == wall):
            parts[last].insert(0, simulator.letters[wall] + "*")
    kept = ["".join(part) for i, part in enumerate(parts) if i not in dropped]
    rotations = [kept[i:] + kept[:i] for i in range(len(kept))]
    return "".join(min(rotations))


def sojourns(cycle: Cycle | Attractor) -> Iterator[tuple[int, int, int]]:
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
    stuck = {wall for wall, _, _ in sojourns(cycle)}
    totals = [int(np.count_nonzero(cycle.walls == k)) for k in range(len(simulator.letters))]
    p = cycle.period or 1
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
    span = cycle.duration(simulator.period)
    flights = touches(simulator.kernels, word, simulator.values, impacts, span)
    return _smallest_of(flights)


def _smallest_of(flights: Sequence[FlightGaps]) -> float:
    gaps = [t.gap for flight in flights for t in flight.touches if t is not None]
    return min(gaps, default=math.nan)


KEPT = 1000
"""Impacts kept of a motion that is not periodic."""
TIMES = (0.0, 0.5, 0.25, 0.75)
"""Times, in periods, at which a motion without impacts is started again: the first one within the
guards is taken."""
FIRST = 64
"""Impacts after which a motion is examined for the first time."""
SPANNED = 8
"""Periods that are examined at least, unless that takes more impacts than exponents do."""
PAUSE = 0.5
"""Part of the periods that have passed in vain for which a motion goes on unexamined: to look for
its cycle takes longer than many impacts do, and chaotic motion has none."""
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
    """
    simulator = as_simulator(simulator)
    if isinstance(state, str):
        state = simulator.random_state()
    if state is None:
        found = without_impact(simulator, mode)
    else:
        found = _settled(simulator, state, settling)
    return _of_model(found, simulator.model)


def _of_model(found: Attractor, model: Model) -> Attractor:
    return replace(found, model=model, free=model.autonomous)


def _settled(simulator: Simulator, state: State, settling: Settling) -> Attractor:
    """What the motion from a state settles on."""
    begun = state.turns
    run = _examined(simulator, state, FIRST, settling)
    if run.outcome is not Outcome.DONE:
        return _attractor_of_end(simulator, run)
    if (found := _sticking(simulator, run, settling)) is not None:
        return periodic(simulator, *found, periods=int(run.turns[-1]) - begun)
    run = simulator.run(state, periods=settling.transient, record=False)
    earlier: tuple[Cycle, float, int] | None = None
    unstable: dict[int, Unstable] = {}
    window = FIRST
    while run.outcome is Outcome.DONE and run.end is not None:
        periods = run.end.turns - begun
        passed = periods - settling.transient
        if passed > settling.periods:
            return _unsettled_motion(simulator, run.end, settling, periods)
        pause = min(int(PAUSE * passed), settling.periods - passed)
        if pause > 0:
            run = simulator.run(run.end, periods=pause, record=False)
            if run.outcome is not Outcome.DONE or run.end is None:
                break
        run = _examined(simulator, run.end, window, settling)
        window = min(2 * window, 2 * settling.longest)
        found = cycle_near(simulator, run, settling.longest, unstable)
        if found is not None:
            (cycle, distance), turns = found, int(run.turns[-1])
            close = distance < settling.tolerance
            if close or _approaches_cycle(earlier, cycle, distance, turns, run):
                return periodic(simulator, cycle, distance, periods)
            earlier = (cycle, distance, turns)
    return _attractor_of_end(simulator, run)


def _examined(simulator: Simulator, state: State | None, impacts: int, settling: Settling) -> Run:
    """A run of so many impacts, or of more where they are so many in a period that they are over
    early: where they accumulate, a period of one word may have hundreds."""
    run = simulator.run(state, impacts=impacts)
    while (
        run.outcome is Outcome.DONE
        and impacts < settling.impacts
        and not run.free
        and run.times[-1] - run.times[0] < SPANNED * run.period
    ):
        impacts = min(2 * impacts, settling.impacts)
        run = simulator.run(state, impacts=impacts)
    return run


def _sticking(simulator: Simulator, run: Run, settling: Settling) -> tuple[Cycle, float] | None:
    """The cycle of a motion that sticks and has reached it."""
    found = sticking_cycle(simulator, run)
    return found if found and found[1] < settling.tolerance else None


def _approaches_cycle(
    earlier: tuple[Cycle, float, int] | None, cycle: Cycle, distance: float, turns: int, run: Run
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
    rounds = (turns - earlier[2]) * run.period / cycle.duration(run.period)
    rate, ratio = abs(cycle.multipliers[0]) ** rounds, distance / earlier[1]
    return bool(PASSING * rate**2 < ratio < rate**0.5)


def _attractor_of_end(simulator: Simulator, run: Run) -> Attractor:
    """The attractor of a run that ended by itself."""
    if run.left is not None:
        mode = simulator.model.WALLS[run.left.wall].next_mode
        return without_impact(simulator, mode, run.left)
    kind, state = _ENDS[run.outcome], run.end
    if kind is Kind.RESTING and state and not isinstance(simulator.machine, OneCoordinate):
        state = replace(state, held=simulator.machine.leave(state)[1])
    named = kind.value
    if kind is Kind.NOT_SETTLED and run.end is not None:
        named += f" ({run.outcome.name} at {simulator.model.letters[run.end.wall]})"
    return Attractor(kind, simulator.parameters, named, simulator.period, state=state)


def without_impact(
    simulator: Simulator, mode: str = "", left: State | Sequence[float] | None = None
) -> Attractor:
    """Return the motion without impacts in a mode, after its last one if there was one, or from
    numbers as of `Attractor.motion`."""
    modes = [each.name for each in simulator.model.MODES]
    mode = mode or next(iter(modes), "")
    if mode not in (modes or [""]):
        raise InputError("mode", f"no mode {mode!r}", f"the modes are {', '.join(modes)}")
    kind = Kind.NO_IMPACT
    named = f"{kind.value} ({mode})" if mode in modes[1:] else kind.value
    motion, span, gap = free_motion(simulator, mode, left), math.nan, math.nan
    if simulator.model.autonomous and motion is not None:
        motion, span = limit_cycle(simulator, mode, motion)
        named += ", at rest" * (span == 0.0) + ", unstable" * (span == 0.0 and motion is None)
    elif motion is not None and mode == simulator.model.first_mode:
        model, kernels = simulator.model, simulator.kernels
        free = [model.values[name] for name in kernels.parameters]
        flights = problem_of(model, Word("", 1), kernels).gaps(np.append(motion, free))
        gap = _smallest_of(flights)
    about = simulator.parameters, named, simulator.period
    return Attractor(kind, *about, mode=mode, motion=motion, span=span, smallest_gap=gap)


def settle_again(
    simulator: Simulator, attractor: Attractor, settling: Settling = SETTLING
) -> Attractor | None:
    """Return what an attractor of neighbouring parameter values leads to.

    None if that cannot be told: its motion is not known, or cannot be started without an impact.
    """
    if attractor.state is not None:
        return settle(simulator, _start_near(simulator, attractor, attractor.state), settling)
    if (motion := attractor.motion) is None:
        return None
    if attractor.rests:
        motion = moved_rest(simulator, attractor.mode, motion) or motion
    for part in TIMES:
        time = part * simulator.period
        try:
            at = state_after(simulator, attractor.mode, motion, time)
            state = at and simulator.start(time, *at, attractor.mode)
        except InputError:  # a guard has passed it, or its flights begin at guards alone
            continue
        if at is not None and state is not None:
            return settle(simulator, state, settling)
        if at is not None:
            found = without_impact(simulator, attractor.mode, motion)
            return _of_model(found, simulator.model)
    return None


def _start_near(simulator: Simulator, attractor: Attractor, state: State) -> State:
    """The state, or an impact of the attractor after which motion begins within its guards: after
    one at the edge of sliding it does at its own parameter values alone."""
    a, tried = attractor, slice(FIRST)
    if not len(a.others):
        return state
    columns = a.walls, a.times, a.velocities, 0 * a.walls, a.others, a.held, a.released
    others = (replace(s.within(simulator.period), turns=0) for s in states_of([*columns])[tried])
    for start in (state, *others):
        if simulator.run(start, impacts=1, record=False).outcome is not Outcome.BEYOND:
            return start
    return state


def complex_notation(rates: Sequence[float]) -> str:
    """Return what complex motion is called: its impacts on each wall per period, rounded; where
    they are none, those in as few periods as have any, in parentheses."""
    periods = math.floor(0.5 / max(rates)) + 1
    counts = ":".join(str(round(periods * rate)) for rate in rates)
    return f"{counts}/C" if periods == 1 else f"({counts})/{periods}T/C"


def _unsettled_motion(
    simulator: Simulator, state: State, settling: Settling, periods: int
) -> Attractor:
    """Complex motion if the largest exponent is clearly positive, or if what lies between sojourns
    on walls is rounding; otherwise not settled."""
    run = simulator.run(state, impacts=settling.impacts)
    if run.outcome is not Outcome.DONE:
        return _attractor_of_end(simulator, run)
    if (sticking := _sticking(simulator, run, settling)) is not None:
        return periodic(simulator, *sticking, periods=periods)
    found = exponents_of(simulator, state, run)
    is_complex = found.per_impact[0] > 3.0 * found.error
    if run.released.any():
        is_complex = is_complex or rounding_fills(simulator, run.states())
    rate = len(run) / _periods(simulator, state, run.end)
    shares = [np.count_nonzero(run.walls == k) / len(run) for k in range(len(simulator.letters))]
    last = slice(-KEPT, None)
    return Attractor(
        Kind.COMPLEX if is_complex else Kind.NOT_SETTLED,
        simulator.parameters,
        complex_notation([share * rate for share in shares])
        if is_complex and not run.free
        else (Kind.COMPLEX if is_complex else Kind.NOT_SETTLED).value,
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
