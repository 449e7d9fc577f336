"""Bounds of the rounding errors of an orbit problem's residual and blocks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..segments.bounded import UNIT, Bounded, bounds_of, bounds_of_kernel
from ..segments.layout import Setup
from .linearisation import Array, CyclicBlocks, Linearisation

if TYPE_CHECKING:
    from .problem import OrbitProblem


def rounding(here: Linearisation) -> Linearisation:
    """Return bounds of the rounding errors of residual and blocks, in their places."""
    problem = here.problem
    m, n = problem.m, problem.n
    quiet = not problem.word.walls  # its flight leads to the state itself, not a time of its own
    z, p = here.unknowns.tolist(), problem.values(here.unknowns)
    setup, off = bounds_of_kernel(problem.kernels.setup, p)
    closing = problem.closing(Bounded(z[0]), Bounded(setup.period, off.period))
    parts: list[list[float]] = [[], [], [], []]
    for k, segment in enumerate(problem.segments):
        j = m * k + m
        arrival = z[j : j + m] if j < n else [closing, *z[1:m]]
        arrival = z[:m] if quiet else arrival
        _, errors = bounds_of(segment, problem.leaving(here.unknowns, k)[1], arrival, p)
        for part, block in zip(parts, errors, strict=True):
            part += block
    residual, start, end, by_parameter = map(np.array, parts)
    start = problem.leaves(start)
    blocks = start.reshape(-1, m, m), end.reshape(-1, m, m), by_parameter.reshape(n, -1)
    bounds = Linearisation(problem, here.unknowns, CyclicBlocks(residual, *blocks))
    if not quiet:
        _add_drift(bounds, here, np.array(setup.slopes), np.array(off.slopes))
    return bounds


def _add_drift(bounds: Linearisation, here: Linearisation, slopes: Array, off: Array) -> None:
    """The last arrival moves with the forcing period, and so with the parameters."""
    problem = here.problem
    last = slice(problem.n - problem.m, problem.n)
    moved = np.outer(bounds.end[-1, :, 0], np.abs(slopes)) + np.outer(
        np.abs(here.end[-1, :, 0]), off + 2.0 * UNIT * np.abs(slopes)
    )
    bounds.by_parameter[last] += problem.word.period * moved


def rounding_of_setup(problem: OrbitProblem, unknowns: Array) -> Setup:
    """Return bounds of the rounding errors of what the kernel ``setup`` says at a point."""
    return bounds_of_kernel(problem.kernels.setup, problem.values(unknowns))[1]
