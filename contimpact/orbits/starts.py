"""Newton's iteration from many random starts at once: arrays have one row per start.

Impact times are drawn at random; the section coordinates that fit them best follow from least
squares, since residuals are (close to) linear in them. Steps are shortened so that impacts stay in
order.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..segments.arithmetic import ARRAYS
from .problem import Array, OrbitProblem

ITERATIONS = 25

SPANS = 0.2, 5.0
"""Free periods that starts are given, as parts of the system's natural time."""

LONGEST = 2.0 * SPANS[1]
"""Free period from which on a start is given up, likewise."""

FAR = 30.0
"""Times as large as those of most starts: section coordinates at which one is given up, where
flights are integrated, which takes the longer the faster they oscillate."""

SIZES = 0.1, 1.0, 10.0
"""Of section coordinates that are drawn at random."""

ROUNDS_AT_ONCE = 3
"""Rounds iterated together; where there is an orbit, no search ends before the third."""


def rounds_of_starts(
    problem: OrbitProblem,
    generator: np.random.Generator,
    starts: int,
    rounds: int,
    fitted: bool = True,
) -> Iterator[Array]:
    """The solutions that the starts of each round lead to, in the order of their iterations.

    Section coordinates are drawn at random, too, unless they are fitted to the times.
    """
    for first in range(0, rounds, ROUNDS_AT_ONCE):
        count = min(ROUNDS_AT_ONCE, rounds - first)
        times = [_random_times(problem, generator, starts) for _ in range(count)]
        with np.errstate(all="ignore"):
            at = np.concatenate(times)
            begun = _with_sections(problem, at) if fitted else _drawn(problem, at, generator)
            solutions, origin = _newton(problem, begun)
        for k in range(count):
            yield solutions[origin // starts == k]


def _random_times(problem: OrbitProblem, generator: np.random.Generator, count: int) -> Array:
    """Impact times in order, one row per start."""
    period = problem.kernels.setup(*problem.model.values.values()).period
    if problem.autonomous:
        low, high = np.log(SPANS).tolist()
        spans = period * np.exp(generator.uniform(low, high, (count, 1)))
        first = -spans
    else:
        spans = problem.word.period * period
        first = generator.uniform(0.0, period, count)[:, None]
    durations = generator.dirichlet(np.ones(len(problem.word)), count)
    durations *= spans
    return np.hstack([first, first + np.cumsum(durations, axis=1)[:, :-1]])


def _with_sections(problem: OrbitProblem, times: Array) -> Array:
    """The starts with these impact times: section coordinates by least squares."""
    count, n = times.shape
    m = problem.m
    z = np.zeros((count, n, m))
    z[:, :, 0] = times
    residual, jacobian = _evaluate_all(problem, z)
    sections = [i for i in range(n * m) if i % m]
    by_section = jacobian[:, :, sections]
    normal = by_section.transpose(0, 2, 1) @ by_section
    normal += 1e-12 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(len(sections))
    right = -(by_section.transpose(0, 2, 1) @ residual[:, :, None])
    z.reshape(count, -1)[:, sections] = np.linalg.solve(normal, right)[:, :, 0]
    return z


def _drawn(problem: OrbitProblem, times: Array, generator: np.random.Generator) -> Array:
    """The starts with these impact times: section coordinates at random."""
    z = generator.normal(size=(*times.shape, problem.m))
    z *= generator.choice(SIZES, (len(times), 1, 1))
    z[:, :, 0] = times
    return z


def _newton(problem: OrbitProblem, z: Array) -> tuple[Array, Array]:
    """Newton's iteration from every start.

    Returns
    -------
    solutions : ndarray of shape (K, n + 1)
        The unknowns of those that converged, the soonest first.
    origin : ndarray of shape (K,)
        The numbers of their starts.
    """
    count, n, m = z.shape
    value = problem.model.values[problem.parameter]
    period = problem.kernels.setup(*problem.model.values.values()).period
    origin = np.arange(count)
    reached: list[Array] = []
    origins: list[Array] = []
    far = _far(problem, z)
    for _ in range(ITERATIONS):
        residual, jacobian = _evaluate_all(problem, z)
        healthy = np.isfinite(jacobian).all(axis=(1, 2)) & np.isfinite(residual).all(axis=1)
        if problem.autonomous:
            healthy &= -z[:, 0, 0] < LONGEST * period
        healthy &= _sizes(z) < far
        z, origin = z[healthy], origin[healthy]
        jacobian = jacobian[healthy] + 1e-300 * np.eye(n * m)
        step = _solve_all(jacobian, -residual[healthy]).reshape(-1, n, m)
        done = np.max(np.abs(step), axis=(1, 2)) < 1e-8
        reached.append((z + step)[done])
        origins.append(origin[done])
        z, step, origin = z[~done], step[~done], origin[~done]
        if not len(z):
            break
        z = z + step * _shortening(problem, z, step, period)[:, None, None]
    solutions = np.concatenate(reached).reshape(-1, n * m)
    return np.insert(solutions, n * m, value, axis=1), np.concatenate(origins)


def _far(problem: OrbitProblem, z: Array) -> float:
    """The size of section coordinates at which starts are given up."""
    sizes = _sizes(z)
    known = sizes[np.isfinite(sizes) & (sizes > 0.0)]
    integrated = any(problem.kernels.flown(*kind) for kind in problem.kinds)
    return FAR * float(np.median(known)) if integrated and len(known) else np.inf


def _sizes(z: Array) -> Array:
    return np.max(np.abs(z[:, :, 1:]), axis=(1, 2))


def _solve_all(matrices: Array, right: Array) -> Array:
    try:
        return np.linalg.solve(matrices, right[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        return (np.linalg.pinv(matrices) @ right[:, :, None])[:, :, 0]


def _shortening(problem: OrbitProblem, z: Array, step: Array, period: float) -> Array:
    """The part of each step that keeps impacts in order and moves no time by over T/4."""
    times, moves = z[:, :, 0], step[:, :, 0]
    closings = problem.closing(times[:, :1], period)
    durations = np.diff(np.concatenate([times, closings], axis=1), axis=1)
    back = problem.closing(moves[:, :1], 0.0)
    changes = np.diff(np.concatenate([moves, back], axis=1), axis=1)
    shrinking = np.where(
        changes < 0.0, -0.9 * durations / np.where(changes < 0.0, changes, 1.0), 1.0
    )
    if problem.autonomous:
        period = np.sum(durations, axis=1)
    largest = 0.25 * period / np.maximum(np.max(np.abs(moves), axis=1), 1e-300)
    return np.minimum(1.0, np.minimum(np.min(shrinking, axis=1), largest))


def _evaluate_all(problem: OrbitProblem, z: Array) -> tuple[Array, Array]:
    """Residuals (S, n) and square Jacobians (S, n, n) of all starts at the model's parameters.

    All flights between the same walls are evaluated together.
    """
    count, n, m = z.shape
    p = list(problem.model.values.values())
    arrivals = np.roll(z, -1, axis=1)
    period = problem.kernels.setup(*p).period
    arrivals[:, -1, 0] = problem.closing(z[:, 0, 0], period)
    moving = np.ones(n)
    moving[-1] = problem.closing(1.0, 0.0)
    residual = np.zeros((count, n, m))
    jacobian = np.zeros((count, n, m, n, m))
    for a, b in dict.fromkeys(problem.kinds):
        leaving = [k for k, kind in enumerate(problem.kinds) if kind == (a, b)]
        arriving = [(k + 1) % n for k in leaving]
        start, end = (np.ascontiguousarray(e[:, leaving].transpose(2, 0, 1)) for e in (z, arrivals))
        blocks = problem.kernels.segment(a, b).over(ARRAYS)
        rows, by_start, by_end, _ = blocks(start, end, p)
        for i in range(m):
            residual[:, leaving, i] = rows[i]
            for j in range(m):
                jacobian[:, leaving, i, leaving, j] += by_start[m * i + j]
                moved = by_end[m * i + j] * moving[leaving] if j == 0 else by_end[m * i + j]
                jacobian[:, leaving, i, arriving, j] += moved
    problem.kernel_evaluations += count * n
    return residual.reshape(count, -1), jacobian.reshape(count, n * m, n * m)
