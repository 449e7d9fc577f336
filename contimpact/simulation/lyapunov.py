r"""Lyapunov exponents, by the contraction along impacts.

One impact to the next changes a disturbance of (time, velocity before impact) by
:math:`D = -B^{-1}A`. Disturbances are measured as (time, v times velocity), an energy: there the
determinant of D is exactly r^2 where flights dissipate nothing, and the divergence at low
velocities is weaker. The columns are kept orthogonal after each impact,

.. math:: D q_1 = \rho_1 q_1', \qquad \rho_1 \rho_2 = \det D,

and the exponents per impact are the means of :math:`\ln\rho_1` and :math:`\ln\rho_2`.

With several degrees of freedom there are as many more section coordinates, exponents and factors
of the diagonal; D is then that of `automaton`, which goes through sojourns on walls, too.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Array
from ..models.guards import orders_of, state_before
from ..segments.arithmetic import FLOATS, evaluate_in
from ..segments.bounded import UNIT, bounds_of
from ..segments.derivatives import Series, series
from .run import Run, State
from .simulator import Simulator

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
    each = [_flight_contraction(simulator, *pair) for pair in itertools.pairwise(rows)]
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
    return RoundedDerivative(product, errors)


def _flight_contraction(simulator: Simulator, before: State, after: State) -> Contraction:
    found = _law_contraction(simulator, before, after) if _has_law(simulator, before.wall) else None
    return found or _block_contraction(simulator, before, after)


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
    duration = _duration(simulator, before, after)
    return Contraction(math.copysign(1.0, factor), math.log(abs(factor)) + trace * duration)


def _impact_determinant(simulator: Simulator, before: State) -> float:
    """The determinant of velocities after an impact by those before it."""
    size, guard = simulator.model.DEGREES_OF_FREEDOM, simulator.model.WALLS[before.wall]
    law = evaluate_in(simulator.kernels.law(guard.name), series(FLOATS))
    into, out = [], []
    for j in range(0, 2 * size - 1, 2):
        unit = [float(i == j) for i in range(2 * size - 1)]
        section = [Series([y, e]) for y, e in zip(before.section, unit, strict=True)]
        moved = law(Series([before.phase, 0.0]), *section, *simulator.values)[3]
        speeds = moved[size : 2 * size]
        into.append(state_before(guard.row(size), 0.0, unit)[1])
        out.append([float(e.coefficients[1]) if isinstance(e, Series) else 0.0 for e in speeds])
    return float(np.linalg.det(out) / np.linalg.det(into))


def _duration(simulator: Simulator, before: State, after: State) -> float:
    return (after.turns - before.turns) * simulator.period + after.phase - before.phase


def _blocks(simulator: Simulator, before: State, after: State) -> tuple[Array, Array, Array, Array]:
    """The blocks A and B of a flight, and the bounds of their errors."""
    letters, m = simulator.letters, simulator.model.unknowns_per_impact
    start = (before.phase, *before.section)
    end = (before.phase + _duration(simulator, before, after), *after.section)
    segment = simulator.kernels.segment(letters[before.wall], letters[after.wall])
    (_, a, b, _), (_, off_a, off_b, _) = bounds_of(segment, start, end, simulator.values)
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
    """Length of the run, in forcing periods."""
    end: State | None
    """State at which the run ended."""

    @property
    def per_period(self) -> float:
        """The largest exponent per forcing period."""
        return self.per_impact[0] * self.impacts / self.periods if self.periods > 0 else math.nan


def exponents_of(
    simulator: Simulator, state: State, run: Run, batches: int = 20, rng: Any = 0
) -> Exponents:
    """Return the Lyapunov exponents of a run from a state on the attractor.

    The error comes from the means of `batches` parts of the run; `rng` gives the first disturbance.
    Benettin et al., Meccanica 15 (1980), with the QR factors of 2x2 matrices written out.
    """
    periods = (_time(simulator, run.end) - _time(simulator, state)) / simulator.period
    count = len(run)
    if run.held.size:
        return _exponents_by_qr(simulator, state, run, batches, rng, periods)
    if not count or run.released.any() or state.velocity == 0.0:
        lost = -math.inf if count else math.nan
        return Exponents((lost, lost), 0.0, math.nan, count, periods, run.end)
    angle = float(np.random.default_rng(rng).uniform(0.0, math.pi))
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
    count = len(first)
    pair = (_mean(first), _mean(second))
    return Exponents(
        pair, _scatter(first, batches), _restitution(simulator, run), count, periods, run.end
    )


def _exponents_by_qr(
    simulator: Simulator, state: State, run: Run, batches: int, rng: Any, periods: float
) -> Exponents:
    """By the QR factors of the derivatives, in (time, v times velocity, the other coordinates)."""
    m = simulator.model.unknowns_per_impact
    q = np.linalg.qr(np.random.default_rng(rng).normal(size=(m, m)))[0]
    logs, before, scale = [], state, _scale(state, m)
    for after in run.states():
        step = simulator.derivative(before, after)
        if not np.all(np.isfinite(step)):
            break
        next_scale = _scale(after, m)
        q, r = np.linalg.qr((next_scale[:, None] * step / scale) @ q)
        with np.errstate(divide="ignore"):
            logs.append(np.log(np.abs(np.diag(r))))
        if not (before.released or after.released or after.held):
            _without_rounding(logs[-1], simulator, before, after)
        before, scale = after, next_scale
    table = np.array(logs).reshape(-1, m)
    means = [_mean(column) for column in table.T.tolist()]
    known = sorted((mean for mean in means if not math.isnan(mean)), reverse=True)
    per_impact = (*known, *[math.nan] * (m - len(known)))
    scatter = _scatter(table[:, 0].tolist(), batches)
    restitution = _restitution(simulator, run)
    return Exponents(per_impact, scatter, restitution, len(table), periods, run.end)


def _without_rounding(logs: Array, simulator: Simulator, before: State, after: State) -> None:
    """Take out what is rounding of the logarithms of a diagonal; one alone is what is left of the
    determinant."""
    lost = logs < np.max(logs) + math.log(CANCELS)
    if np.any(lost):
        rest = math.fsum(logs[~lost])
        one = np.count_nonzero(lost) == 1
        logs[lost] = _contraction(simulator, before, after) - rest if one else math.nan


def _contraction(simulator: Simulator, before: State, after: State) -> float:
    """The logarithm of a flight's determinant, in the units of disturbances."""
    one, other = abs(before.velocity), abs(after.velocity)
    if not one or not other:
        return -math.inf
    return contraction(simulator, [before, after]).logarithm + math.log(other / one)


def _scale(state: State, m: int) -> Any:
    """Units of disturbances: the gap coordinate's velocity is multiplied by itself."""
    found = np.ones(m)
    found[1] = abs(state.velocity) or 1.0
    return found


def _mean(values: list[float]) -> float:
    if not values:
        return math.nan
    return -math.inf if -math.inf in values else math.fsum(values) / len(values)


def _restitution(simulator: Simulator, run: Run) -> float:
    """Mean of ln r^2 over the impacts of a run."""
    logs = [2.0 * math.log(e) if e else -math.inf for e in simulator.restitution]
    return _mean([logs[wall] for wall in run.walls.tolist()])


def _time(simulator: Simulator, state: State | None) -> float:
    return math.nan if state is None else state.turns * simulator.period + state.phase


def _scatter(values: list[float], batches: int) -> float:
    """Standard error of the mean, from the means of consecutive batches."""
    size = len(values) // batches
    if size < 1:
        return math.inf
    means = np.array(values[: size * batches]).reshape(batches, size).mean(axis=1)
    return float(means.std(ddof=1) / math.sqrt(batches))
