"""Derivatives of outputs' means by parameters, and largest values of outputs with theirs.

At a given part of a flight the state is a function of what it leaves with, its length and the
parameters: the mean's derivative by a parameter is an integral of the same kind. Series of two
terms carry the derivatives of orbit, flight and expression.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError
from ..models.expressions import values_of
from ..models.model import Model
from ..models.outputs import TIME, VOLTAGE, Output, check_output, state_names
from ..segments.derivatives import Series, compose_series, series
from ..segments.segment import ARRAYS, FLOATS, evaluate_in
from .outputs import NODES, integrals_of, means_of, quadrature, rates_of, values_at
from .problem import Linearisation
from .quiet import problem_in

MOVING, MOVING_ARRAYS = series(FLOATS), series(ARRAYS)
"""Numbers, and arrays of them, with their derivatives."""
PLACED = 1e-8
"""Part of a flight to which the largest value of an output is placed on it."""


def mean_slope(here: Linearisation, model: Model, output: Output, parameter: str) -> float:
    """Return the derivative of a mean by a parameter; see `Orbit.mean_sensitivity`."""
    check_output(output, model, "expression")
    model.require(parameter, "parameter")
    problem, unknowns = problem_in(parameter, model, here)
    return float(slopes_of_means(problem.evaluate(unknowns), [output], model)[0, 0])


def slopes_of_means(here: Linearisation, outputs: Sequence[Output], model: Model) -> Array:
    """Return the derivatives of means by the free parameters, shape (outputs, free).

    Raises InputError for an orbit without impacts, or at a fold or a branch point.
    """
    problem = here.problem
    if not problem.word.walls:
        raise InputError("orbit", "it has no impacts", "give an orbit with impacts")
    if any(output.contacts for output in outputs):
        accepted = "give means over time or impacts"
        raise InputError("expression", "means over contacts have no derivatives yet", accepted)
    rates, span = rates_of(here), here.span
    means = np.array([mean.value for mean in means_of(here, outputs, model)])
    found = np.empty((len(outputs), problem.free))
    for column in range(problem.free):
        moving = _moving(here, rates, column)
        rows, flights, _ = moving
        whole = sum(length.coefficients[1] for length in flights)

        def integrand(places: Array, moving: _Moving = moving) -> Array:
            return _slopes(here, outputs, model, places, moving)

        lengths = np.array([length.coefficients[0] for length in flights])
        values, over_time, _ = integrals_of(outputs, integrand, lengths)
        for k, output in enumerate(outputs):
            total = float(np.sum(values[k, :, -1]))
            if output.per_time or not output.at_impacts:
                total = total if output.at_impacts else float(over_time[k])
                found[k, column] = (total - means[k] * whole) / span
            else:
                found[k, column] = total / len(rows)
    return found


def largest_values(here: Linearisation, output: Output, model: Model) -> tuple[Array, Array]:
    """Return the largest values of an output on all flights, or its values before impacts, and
    their derivatives by the free parameters, shapes (flights,) and (flights, free)."""
    count, rates = len(here.problem.word.walls), rates_of(here)
    places = np.ones(count)
    if not output.at_impacts:
        grid = quadrature(NODES // 4)[0]
        for k, row in enumerate(values_at(here, [output], model, grid)[0]):
            top = int(np.argmax(row))
            ends = grid[max(top - 1, 0)], grid[min(top + 1, len(grid) - 1)]
            places[k] = _highest(
                lambda place: values_at(here, [output], model, np.array([place]))[0, k, 0],  # noqa: B023
                *ends,
            )
    one = replace(output, at_impacts=True)  # its values at places, not their integrals
    values = values_at(here, [one], model, places)[0].diagonal()
    slopes = [
        _slopes(here, [one], model, places, _moving(here, rates, column))[0].diagonal()
        for column in range(here.problem.free)
    ]
    return values, np.transpose(slopes)


def _highest(function: Callable[[float], float], low: float, high: float) -> float:
    """The place of a function's maximum between two places, the ends included."""
    from scipy.optimize import minimize_scalar

    inside = minimize_scalar(
        lambda x: -function(x), bounds=(low, high), method="bounded", options={"xatol": PLACED}
    ).x
    return max((low, float(inside), high), key=function)


_Moving = tuple[list[list[Series]], list[Series], list[Series]]
"""Impacts, lengths of flights and parameters, with their derivatives by a parameter."""


def _moving(here: Linearisation, rates: Array, column: int) -> _Moving:
    """An orbit as it moves with a free parameter."""
    problem = here.problem
    name = problem.kernels.parameters[column]
    parameters = [
        Series([value, float(one == name)])
        for one, value in zip(problem.model.values, problem.values(here.unknowns), strict=True)
    ]
    pairs = np.c_[here.unknowns[: problem.n], rates[:, column]].reshape(-1, problem.m, 2)
    rows = [[Series(pair) for pair in row] for row in pairs.tolist()]
    period = evaluate_in(problem.kernels.setup, MOVING)(*parameters).period
    ends = [row[0] for row in rows[1:]] + [problem.closing(rows[0][0], period)]
    return rows, [end - row[0] for row, end in zip(rows, ends, strict=True)], parameters


def _slopes(
    here: Linearisation, outputs: Sequence[Output], model: Model, places: Array, moving: _Moving
) -> Array:
    """Derivatives of outputs at places on all flights, shape (outputs, flights, places); of those
    over time with the part by which the flight's length grows."""
    problem, (rows, flights, parameters) = here.problem, moving
    found = np.empty((len(outputs), len(rows), len(places)))
    derived = evaluate_in(problem.kernels.setup, MOVING)(*parameters).derived
    for k, (wall, row, length) in enumerate(zip(problem.word.walls, rows, flights, strict=True)):
        kernel = problem.kernels.states(wall)
        if kernel.family.stepped:
            states = evaluate_in(kernel, MOVING)
            flown = [states(*row, length * place, *parameters) for place in places.tolist()]
            pairs = np.array([[_pair(x) for x in state] for state in flown]).transpose(1, 2, 0)
        else:
            flown = evaluate_in(kernel, MOVING_ARRAYS)(*row, length * places, *parameters)
            pairs = np.array([_pair(x, len(places)) for x in flown])
        x, v = pairs[::2], pairs[1::2]
        names = state_names(model, model.guard(wall).next_mode)
        known: dict[str, Any] = dict(
            zip(names, [Series(list(pair)) for pair in (*x, *v)], strict=True)
        )
        known[TIME] = row[0] + length * places
        known |= zip((*model.values, *model.DERIVED), (*parameters, *derived), strict=True)
        growth = length.coefficients[1] / length.coefficients[0]
        for number, output in enumerate(outputs):
            if (source := output.harvester) is not None:
                speed = source.scale(known) * known[names[len(names) // 2]]
                slopes = [lambda s, source=source: Series([source.slope(s.coefficients[0])])]
                known[VOLTAGE] = compose_series(source.voltage, slopes, speed)
            used = {name: known[name] for name in output.variables(model)}
            value, slope = _pair(
                values_of(output.expression, output.name, used, MOVING_ARRAYS.names), len(places)
            )
            found[number, k] = slope if output.at_impacts else slope + growth * value
    return found


def _pair(number: Any, size: int | None = None) -> Array:
    """A number and its derivative, of arrays if a size is given."""
    pair = [*number.coefficients, 0.0][:2] if isinstance(number, Series) else [number, 0.0]
    return np.array([np.broadcast_to(x, (size,)) if size else x for x in pair], dtype=float)
