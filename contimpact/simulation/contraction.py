r"""By how much flights contract: determinants of the derivative of the map, by logarithms.

Where flights are strongly damped all entries of the derivative are rounding, and its determinant is
lost. Of linear flights it is known without them (Liouville): a flight of duration t multiplies
volumes of states by :math:`e^{-t\,\mathrm{tr}\,M^{-1}C}`, an impact by the determinant of its law;
through the surfaces of the guards they pass with the velocities of the gap coordinates,

.. math:: \ln|\det D| = \ln\Bigl|\frac{\dot g_1^+}{\dot g_2}\,
          \det\frac{\partial v_1^+}{\partial v_1}\Bigr| - t\,\mathrm{tr}\,M^{-1}C .

Of other flights it is :math:`\ln|\det A| - \ln|\det B|`, where the bounds of rounding that the
blocks have leave six digits of both.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..arrays import Array
from ..models.guards import orders_of, state_before
from ..segments.arithmetic import FLOATS, evaluate_in
from ..segments.bounded import UNIT, bounds_of
from ..segments.derivatives import Series, series
from .run import State
from .simulator import Simulator

DIGITS = 1e-6
"""Determinants known to this part are known."""


class Contraction(NamedTuple):
    """A determinant, or a product of them.

    Attributes
    ----------
    sign : float
        Zero where the determinant is.
    logarithm : float
        Of its size; NaN where rounding leaves too little of it.
    """

    sign: float
    logarithm: float


class Rounded(NamedTuple):
    """A derivative of the map and bounds of its entries' rounding errors, shape (m, m) each."""

    derivative: Array
    errors: Array


def contraction(simulator: Simulator, rows: Sequence[State]) -> Contraction:
    """Return the determinant of the derivative of the map along impacts, no wall of them held."""
    each = [_of_flight(simulator, *pair) for pair in itertools.pairwise(rows)]
    if any(found.sign == 0.0 for found in each):
        return Contraction(0.0, -math.inf)
    return Contraction(
        math.prod(found.sign for found in each), math.fsum(found.logarithm for found in each)
    )


def rounded_product(simulator: Simulator, rows: Sequence[State]) -> Rounded:
    """Return the derivative of the map along impacts, and what rounding may have added to it."""
    m = simulator.model.unknowns_per_impact
    product, errors = np.eye(m), np.zeros((m, m))
    for pair in itertools.pairwise(rows):
        step, off = _rounded(simulator, *pair)
        size = np.abs(step)
        errors = size @ errors + off @ (np.abs(product) + errors)
        errors += m * UNIT * (size @ np.abs(product))
        product = step @ product
    return Rounded(product, errors)


def _of_flight(simulator: Simulator, before: State, after: State) -> Contraction:
    found = _of_law(simulator, before, after) if _has_law(simulator, before.wall) else None
    return found or _of_blocks(simulator, before, after)


def _has_law(simulator: Simulator, wall: int) -> bool:
    """Whether the flight after a guard is linear, and that before it of as many coordinates."""
    model, kernels = simulator.model, simulator.kernels
    guard, size = model.WALLS[wall], model.DEGREES_OF_FREEDOM
    modes = (*guard.modes, guard.next_mode)
    whole = all(orders_of(model.MODES, mode, size) == (2,) * size for mode in modes)
    if not whole or kernels.integrated(guard.name):
        return False
    return len(kernels.law(guard.name)(0.0, *[1.0] * (2 * size - 1), *simulator.values)) > 1


def _of_law(simulator: Simulator, before: State, after: State) -> Contraction | None:
    """Of a linear flight; None where positions jump."""
    size, guard = simulator.model.DEGREES_OF_FREEDOM, simulator.model.WALLS[before.wall]
    row, law = guard.row(size), simulator.kernels.law(guard.name)
    place = state_before(row, simulator.positions[before.wall], before.section)[0]
    d, h, numbers, left = law(before.phase, *before.section, *simulator.values)
    if not np.allclose(left[:size], place, rtol=1e-12, atol=1e-300):
        return None
    speed = float(np.dot(row, left[size : 2 * size]))
    factor = _of_impact(simulator, before) * speed / after.velocity if after.velocity else math.inf
    width = 2 * int(d) + 2 * int(h) + 1
    trace = math.fsum(numbers[i * width + size + i] for i in range(size))
    if factor == 0.0:
        return Contraction(0.0, -math.inf)
    duration = _duration(simulator, before, after)
    return Contraction(math.copysign(1.0, factor), math.log(abs(factor)) + trace * duration)


def _of_impact(simulator: Simulator, before: State) -> float:
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


def _rounded(simulator: Simulator, before: State, after: State) -> Rounded:
    a, b, off_a, off_b = _blocks(simulator, before, after)
    try:
        step = -np.linalg.solve(b, a)
        return Rounded(step, np.abs(np.linalg.inv(b)) @ (off_a + off_b @ np.abs(step)))
    except np.linalg.LinAlgError:
        return Rounded(np.full(a.shape, np.inf), np.full(a.shape, np.inf))


def _of_blocks(simulator: Simulator, before: State, after: State) -> Contraction:
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
