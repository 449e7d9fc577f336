"""What kernels call for flights that are integrated, in every arithmetic; see `taylor`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..arrays import Array
from .taylor import integrator, statement

TRIALS_APART = 0.7
"""Part of the mean step to which another integration is held, to see how far results differ."""

MANY = 64
"""Flights at once, as in searches, from which they are integrated side by side; the number alone
decides, so that results do not depend on what a process has done before."""


def flown(field: str, directions: str, *numbers: float) -> list[float]:
    """Return mean and end velocities of a flight, and their derivatives.

    Parameters
    ----------
    field : str
        As of `text_of`.
    directions : str
        Names of `Statement.names`.
    *numbers : float
        A value for each of these names.

    Returns
    -------
    list of float
        Mean velocities, then end velocities; the same of the derivatives by each direction.
    """
    return integrator(field, tuple(directions.split()))(numbers)


def flown_of_series(field: str, directions: str, rows: Sequence[Sequence[Any]]) -> list[Any]:
    """Return the same of truncated series, each row the coefficients of one.

    Derivatives by the directions are known to the first order; beyond it they are numbers.
    """
    return _of_series(field, directions, rows, 0)


def _of_series(field: str, directions: str, rows: Sequence[Sequence[Any]], bits: int) -> list[Any]:
    degree, by = len(rows[0]) - 1, tuple(directions.split())
    if degree == 0 or (degree > 1 and by):
        numbers = [row[0] for row in rows]
        tables = [[x] for x in integrator(field, by, 0, bits)(numbers)]
        if degree == 0:
            return tables
        values = integrator(field, (), degree, bits).of_series(rows)
        return [*values, *tables[len(values) :]]
    return integrator(field, by, degree, bits).of_series(rows)


def flown_of_arrays(field: str, directions: str, *numbers: Any) -> Array:
    """Return the same for arrays of numbers; results are along axis 0, NaN where there is none."""
    given = np.broadcast_arrays(*(np.asarray(x, dtype=float) for x in numbers))
    shape = given[0].shape
    if not directions and not any(np.ndim(x) for x in numbers[1:]) and np.min(numbers[0]) >= 0.0:
        from .integrated_track import velocities_at

        return velocities_at(field, numbers[1:], given[0].ravel()).reshape(-1, *shape)
    rows, by = np.column_stack([x.ravel() for x in given]), tuple(directions.split())
    if len(rows) >= MANY:
        from .taylor_batch import batch_integrator

        found = batch_integrator(field, by).each(rows)
    else:
        found = integrator(field, by).each(rows)
    return found.T.reshape(-1, *shape)


def rounded_beside(field: str, directions: str, numbers: Sequence[float], found: Array) -> Array:
    """Return what the results of `flown` are rounded beside.

    Beside the velocities there are, and beside what another integration, by other steps, is off.
    """
    function = integrator(field, tuple(directions.split()))
    function(numbers)
    steps = max(1, function.steps)
    other = np.array(function(numbers, TRIALS_APART / steps))
    d = statement(field).freedom
    tables = np.abs(found).reshape(-1, d)
    tables[:2] = np.max(np.abs([*tables[:2], numbers[2 + d : 2 + 2 * d]]), axis=0)
    return math.sqrt(steps) * tables.ravel() + np.abs(found - other) / np.finfo(float).eps


SCALAR: dict[str, Callable[..., Any]] = {"flown": flown, "flown_of_series": flown_of_series}
ARRAY: dict[str, Callable[..., Any]] = {"flown": flown_of_arrays}


def in_many_digits(ctx: Any) -> dict[str, Callable[..., Any]]:
    """Return the same functions for the numbers of an mpmath context."""

    def real(x: Any) -> Any:
        import heyoka

        return heyoka.real(ctx.nstr(ctx.mpf(x), ctx.dps + 5, strip_zeros=False), ctx.prec)

    def back(x: Any) -> Any:
        return ctx.mpf(str(x))

    def many(field: str, directions: str, *numbers: Any) -> list[Any]:
        function = integrator(field, tuple(directions.split()), 0, ctx.prec)
        return [back(x) for x in function([real(x) for x in numbers])]

    def many_of_series(field: str, directions: str, rows: Sequence[Sequence[Any]]) -> list[Any]:
        given = [[real(c) for c in row] for row in rows]
        return [[back(x) for x in row] for row in _of_series(field, directions, given, ctx.prec)]

    return {"flown": many, "flown_of_series": many_of_series}
