r"""Multipliers and exponents of cycles, and what rounding leaves of them.

To first order a multiplier is off by

.. math:: |\delta\mu| \le \frac{|y|^\top E\,|x|}{|y^* x|}

where E bounds the errors of the derivative's entries, and y and x are the left and the right
eigenvector (Golub and Van Loan, Matrix Computations, 2013, sec. 7.2); and by no less than errors of
random signs move it, which matters where they are larger than what separates eigenvalues. If one
multiplier alone is lost, it is what the determinant leaves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import eig

from ..arrays import Array
from ..simulation.contraction import Contraction, contraction, rounded_product
from ..simulation.run import State
from ..simulation.simulator import Simulator
from .cycle import Cycle

NEGLIGIBLE = 1e-9
"""An error below this part of a multiplier is none."""
LOST = 0.1
"""A multiplier off by more than this part is lost."""
TRIALS = 9
"""Derivatives looked at: the one found, and some with errors of random signs."""


@dataclass(frozen=True)
class Contracting:
    """What the linearised map around a cycle tells.

    Attributes
    ----------
    multipliers : tuple of complex
        The largest first; zero where rounding leaves nothing of them.
    exponents : tuple of float
        Per impact; NaN where rounding leaves nothing of the multiplier.
    error : float
        Of the largest exponent, by rounding; NaN where that is unknown.
    total : float
        The sum of all exponents, from determinants; NaN where it is unknown.
    """

    multipliers: tuple[complex, ...]
    exponents: tuple[float, ...]
    error: float
    total: float


def contracting(simulator: Simulator, cycle: Cycle) -> Contracting:
    """Return multipliers and exponents of a cycle, with what rounding leaves of them.

    Of motion that sticks they are as the cycle has them.
    """
    count, mus = len(cycle.walls), tuple(complex(mu) for mu in cycle.multipliers)
    if cycle.released.any() or cycle.held.any():
        each = tuple(_log(mu) / count for mu in mus)
        return Contracting(mus, each, 0.0, sum(each))
    rows = _rows(cycle, simulator.period)
    whole = contraction(simulator, rows)
    errors = _errors(*rounded_product(simulator, rows), mus)
    mus, logs, error = _told(mus, errors, whole)
    total = math.fsum(logs) if math.isnan(whole.logarithm) else whole.logarithm
    error = 0.0 if error <= NEGLIGIBLE else -math.log1p(-min(error, 1.0 - NEGLIGIBLE))
    return Contracting(mus, tuple(e / count for e in logs), error / count, total / count)


def _log(mu: complex) -> float:
    return math.log(abs(mu)) if mu != 0 else -math.inf


def _told(
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
