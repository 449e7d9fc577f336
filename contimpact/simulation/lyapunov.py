r"""Lyapunov exponents of a simulated motion, from the linearised flights.

One impact to the next changes a disturbance of (time, velocity before impact) by
:math:`D = -B^{-1}A`. Disturbances are measured as (time, v times velocity), an energy: there the
determinant of D is exactly r^2 where flights dissipate nothing, and the divergence at low
velocities is weaker. The columns are kept orthogonal after each impact,

.. math:: D q_1 = \rho_1 q_1', \qquad \rho_1 \rho_2 = \det D,

and the exponents per impact are the means of :math:`\ln\rho_1` and :math:`\ln\rho_2`.

With several degrees of freedom there are as many more section coordinates, exponents and factors
of the diagonal; D is then that of `linearised`, which goes through sojourns on walls, too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from .contraction import contraction
from .run import Run, State
from .simulator import Simulator

CANCELS = 1e-9
"""A factor of the diagonal, or a determinant, below this part of the others, or of its terms, is
rounding: strong damping leaves it to Liouville's formula; see `contraction`."""


@dataclass(frozen=True)
class Exponents:
    """Lyapunov exponents of a run.

    Attributes
    ----------
    per_impact : tuple of float
        The largest one first; minus infinity where the body stuck to a wall, which forgets the
        past: with one degree of freedom all of it, with several a part. NaN, and last, where
        damping takes several below rounding.
    error : float
        Standard error of the largest one, from the scatter of means over batches of impacts.
    restitution : float
        Mean of ln r^2 over the impacts, which the sum of all equals where flights do not
        dissipate.
    impacts : int
    periods : float
        Length of the run, in forcing periods.
    end : State or None
        Where the run ended.
    """

    per_impact: tuple[float, ...]
    error: float
    restitution: float
    impacts: int
    periods: float
    end: State | None

    @property
    def per_period(self) -> float:
        """The largest exponent per forcing period."""
        return self.per_impact[0] * self.impacts / self.periods if self.periods > 0 else math.nan


def exponents(
    simulator: Simulator, state: State, impacts: int, *, batches: int = 20, rng: Any = 0
) -> Exponents:
    """Simulate and return Lyapunov exponents.

    Parameters
    ----------
    simulator : Simulator
    state : State
        On the attractor.
    impacts : int
        Length of the run.
    batches : int
        Parts of it whose means give the error.
    rng : optional
        Gives the first disturbance; see `numpy.random.default_rng`.

    Notes
    -----
    Benettin et al., Meccanica 15 (1980), with the QR factors of 2x2 matrices written out.
    """
    return exponents_of(simulator, state, simulator.run(state, impacts=impacts), batches, rng)


def exponents_of(
    simulator: Simulator, state: State, run: Run, batches: int = 20, rng: Any = 0
) -> Exponents:
    """As `exponents`, for a run from `state` that was made already."""
    periods = (_time(simulator, run.end) - _time(simulator, state)) / simulator.period
    count = len(run)
    if simulator.several and count:
        return _of_several(simulator, state, run, batches, rng, periods)
    if not count or run.released.any() or state.velocity == 0.0:
        lost = -math.inf if count else math.nan
        return Exponents((lost, lost), 0.0, math.nan, count, periods, run.end)
    angle = float(np.random.default_rng(rng).uniform(0.0, math.pi))
    x, y = math.cos(angle), math.sin(angle)
    first, second, before = [], [], state
    columns = (run.walls, run.phases, run.velocities, run.turns)
    for row in zip(*(column.tolist() for column in columns), strict=True):
        after = State(*row)
        tt, tv, vt, vv = simulator.derivative(before, after)
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


def _of_several(
    simulator: Simulator, state: State, run: Run, batches: int, rng: Any, periods: float
) -> Exponents:
    """By the QR factors of the derivatives, in (time, v times velocity, the other coordinates)."""
    m = simulator.model.unknowns_per_impact
    q = np.linalg.qr(np.random.default_rng(rng).normal(size=(m, m)))[0]
    logs, before, scale = [], state, _scale(state, m)
    for after in run.states():
        step = simulator.derivative_of_several(before, after)
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
