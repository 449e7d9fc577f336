"""Bounds of the rounding errors of an orbit problem's residual and blocks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..segments.bounded import UNIT, Bounded, bounds_of
from .linearisation import Array, Linearisation

if TYPE_CHECKING:
    from .problem import OrbitProblem


def rounding(here: Linearisation) -> Linearisation:
    """Return bounds of the rounding errors of residual and blocks, in their places."""
    problem = here.problem
    m, n = problem.m, problem.n
    z, p = here.unknowns.tolist(), problem.values(here.unknowns)
    span = _span(problem, p)
    rows: list[list[float]] = []
    for k, (a, b) in enumerate(problem.kinds):
        i, j = m * k, m * k + m
        arrival = z[j : j + m] if j < n else [Bounded(z[0]) + span, *z[1:m]]
        rows.append(bounds_of(problem.kernels.flight(a, b), [*z[i:j], *arrival, *p])[1])
    found = np.array(rows)
    residual, start, end, by_parameter = np.split(found, [m, m + m * m, m + 2 * m * m], axis=1)
    bounds = Linearisation(
        problem, here.unknowns, residual.ravel(), start.reshape(-1, m, m), end.reshape(-1, m, m),
        by_parameter.reshape(n, -1),
    )  # fmt: skip
    _add_drift(bounds, here)
    return bounds


def _add_drift(bounds: Linearisation, here: Linearisation) -> None:
    """The last arrival moves with the forcing period, and so with the parameters."""
    problem = here.problem
    values, errors = bounds_of(problem.kernels.setup, problem.values(here.unknowns))
    slopes, off = (np.array(problem._period_slopes(setup)) for setup in (values, errors))
    last = slice(problem.n - problem.m, problem.n)
    moved = np.outer(bounds.end[-1, :, 0], np.abs(slopes)) + np.outer(
        np.abs(here.end[-1, :, 0]), off + 2.0 * UNIT * np.abs(slopes)
    )
    bounds.by_parameter[last] += problem.word.period * moved


def rounding_of_setup(problem: OrbitProblem, unknowns: Array) -> list[float]:
    """Return bounds of the rounding errors of what the kernel ``setup`` says at a point."""
    return bounds_of(problem.kernels.setup, problem.values(unknowns))[1]


def _span(problem: OrbitProblem, values: Sequence[float]) -> Bounded:
    """The duration of the orbit."""
    values, errors = bounds_of(problem.kernels.setup, values)
    return Bounded(values[0], errors[0]) * problem.word.period
