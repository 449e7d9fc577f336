"""Integrated flights as kernels call them: ``flown`` in floats, arrays, series and many digits.

The field is that of `integration.text_of`; directions are among `Statement.names`, each of which
has a number. A compiled program integrates where one is there or pays, else heyoka by the same
steps.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from .compiling import timed_plainly
from .integration import KEPT, UNIT, batch_integrator, integrator, real_number, statement
from .taylor import flight_identity, run_flights
from .track import velocities_at

TRIALS_APART = 0.7
"""Part of the mean step to which another integration is held, to see how far results differ."""

MANY = 64
"""Flights at once, as in searches, from which heyoka integrates them side by side; the number alone
decides, not what a process has done before."""

COARSE = 2.0**-33
"""Tolerance of flights that searches fly: their orbits are solved for at rounding afterwards, from
the nine digits that they share with those of exact flights."""


def flown(field: str, directions: str, *numbers: float) -> Sequence[float]:
    """Return mean and end velocities of a flight, and the same of their derivatives by each
    direction."""
    if not directions and numbers[0] == 0.0:  # a law need not have a value where it leaves
        d = statement(field).freedom
        return numbers[2 + d : 2 + 2 * d] * 2
    return _flown(field, directions, numbers)


@functools.lru_cache(KEPT)
def _flown(field: str, directions: str, numbers: tuple[float, ...]) -> Sequence[float]:
    found = run_flights(field, directions, np.array([numbers]))
    if found is not None and np.isfinite(found).all():
        return tuple(found[0].tolist())
    with timed_plainly(flight_identity(field, directions)):
        return tuple(integrator(field, tuple(directions.split()))(numbers))


def flown_of_series(field: str, directions: str, rows: Sequence[Sequence[Any]]) -> list[Any]:
    """Return the same of truncated series, each row the coefficients of one.

    Derivatives by the directions are known to the first order; beyond it they are numbers.
    """
    return in_parts(_float_series, field, directions, rows)


def in_parts(
    fly: Callable[[str, str, Sequence[Sequence[Any]]], list[Any]],
    field: str,
    directions: str,
    rows: Sequence[Sequence[Any]],
) -> list[Any]:
    """Return series beyond the first order without directions, and derivatives by these as
    numbers."""
    if len(rows[0]) <= 2 or not directions:
        return fly(field, directions, rows)
    values = fly(field, "", rows)
    return [*values, *fly(field, directions, [row[:1] for row in rows])[len(values) :]]


def _float_series(field: str, directions: str, rows: Sequence[Sequence[float]]) -> list[Any]:
    degree = len(rows[0]) - 1
    if degree == 0:
        return [[x] for x in flown(field, directions, *(row[0] for row in rows))]
    factors = np.array([math.factorial(order) for order in range(degree + 1)])
    given = np.array(rows, dtype=float) * factors
    found = run_flights(field, directions, given.T.reshape(1, -1), degree)
    if found is not None and np.isfinite(found).all():
        coefficients: list[list[float]] = (found.reshape(degree + 1, -1).T / factors).tolist()
        return coefficients
    with timed_plainly(flight_identity(field, directions, degree)):
        return integrator(field, tuple(directions.split()), degree).of_series(rows)


def flown_of_arrays(field: str, directions: str, *numbers: Any) -> Array:
    """Return the same for arrays of numbers; results are along axis 0, NaN where there is none."""
    return _flown_of_arrays(field, directions, UNIT, *numbers)


def flown_of_states(field: str, directions: str, *numbers: Any) -> Array:
    """Return the same to `COARSE`, for searches, whose results are solved for once more, without
    derivatives by parameters, which are put at zero."""
    moved = [name for name in directions.split() if name not in statement(field).parameters]
    return _with_zeros(field, directions, moved, *numbers)


def flown_of_values(field: str, directions: str, *numbers: Any) -> Array:
    """Return the same to `COARSE` without derivatives, which are put at zero."""
    return _with_zeros(field, directions, [], *numbers)


def _with_zeros(field: str, directions: str, wanted: Sequence[str], *numbers: Any) -> Array:
    """The same with zeros for the derivatives that are not wanted, which are the last."""
    found = _flown_of_arrays(field, " ".join(wanted), COARSE, *numbers)
    rows = 2 * statement(field).freedom * (len(directions.split()) - len(wanted))
    return np.concatenate([found, np.zeros((rows, *found.shape[1:]))])


def _flown_of_arrays(field: str, directions: str, tolerance: float, *numbers: Any) -> Array:
    """The same with steps to a tolerance."""
    given = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in numbers))
    shape = given[0].shape
    if not directions and not any(np.ndim(x) for x in numbers[1:]) and np.min(numbers[0]) >= 0.0:
        return velocities_at(field, numbers[1:], given[0].ravel()).reshape(-1, *shape)
    rows, by = np.column_stack([x.ravel() for x in given]), tuple(directions.split())
    size = 2 * statement(field).freedom * (1 + len(by))
    found, left = np.full((len(rows), size), np.nan), np.isfinite(rows).all(axis=1)
    compiled = run_flights(field, directions, rows, tolerance=tolerance)
    if compiled is not None:
        found = compiled
        left &= ~np.isfinite(found).all(axis=1) & (tolerance == UNIT)
    if left.any():
        exact = len(rows) < MANY and tolerance == UNIT
        made = integrator(field, by) if exact else batch_integrator(field, by, tolerance)
        with timed_plainly(flight_identity(field, directions, tolerance=tolerance)):
            found[left] = made.each(rows[left])
    return found.T.reshape(-1, *shape)


def rounding_scale(field: str, directions: str, numbers: Sequence[float], found: Array) -> Array:
    """Return what the results of `flown` are rounded beside.

    Beside the velocities there are, and beside what another integration, by other steps, is off.
    """
    steps, other = _in_other_steps(field, directions, numbers)
    d = statement(field).freedom
    tables = np.abs(found).reshape(-1, d)
    tables[:2] = np.max(np.abs([*tables[:2], numbers[2 + d : 2 + 2 * d]]), axis=0)
    return math.sqrt(steps) * tables.ravel() + np.abs(found - other) / np.finfo(float).eps


def _in_other_steps(field: str, directions: str, numbers: Sequence[float]) -> tuple[int, Array]:
    """How many steps a flight takes, and its results by others."""
    rows, limits = np.array([numbers]), np.array([1.0, 0.0, 0.0])
    found = run_flights(field, directions, rows, limits=limits)
    if found is not None and np.isfinite(found).all():
        steps = int(limits[1])
        limits[0] = TRIALS_APART / steps
        other = run_flights(field, directions, rows, limits=limits)
        if other is not None and np.isfinite(other).all():
            return steps, other[0]
    function = integrator(field, tuple(directions.split()))
    function(numbers)
    steps = max(1, function.steps)
    return steps, np.array(function(numbers, TRIALS_APART / steps))


SCALAR: dict[str, Callable[..., Any]] = {"flown": flown, "flown_of_series": flown_of_series}
ARRAY: dict[str, Callable[..., Any]] = {"flown": flown_of_arrays}
STATES: dict[str, Callable[..., Any]] = {"flown": flown_of_states}
VALUES: dict[str, Callable[..., Any]] = {"flown": flown_of_values}


def multiprecision_functions(ctx: Any) -> dict[str, Callable[..., Any]]:
    """Return the same functions for the numbers of an mpmath context."""

    def real(x: Any) -> Any:
        return real_number(ctx.nstr(ctx.mpf(x), ctx.dps + 5, strip_zeros=False), ctx.prec)

    def back(x: Any) -> Any:
        return ctx.mpf(str(x))

    def many(field: str, directions: str, *numbers: Any) -> list[Any]:
        function = integrator(field, tuple(directions.split()), 0, ctx.prec)
        return [back(x) for x in function([real(x) for x in numbers])]

    def series(field: str, directions: str, rows: Sequence[Sequence[Any]]) -> list[Any]:
        function = integrator(field, tuple(directions.split()), len(rows[0]) - 1, ctx.prec)
        if len(rows[0]) == 1:
            return [[x] for x in function([row[0] for row in rows])]
        return function.of_series(rows)

    def many_of_series(field: str, directions: str, rows: Sequence[Sequence[Any]]) -> list[Any]:
        given = [[real(c) for c in row] for row in rows]
        found = in_parts(series, field, directions, given)
        return [[back(x) for x in row] for row in found]

    return {"flown": many, "flown_of_series": many_of_series}
