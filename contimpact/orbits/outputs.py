r"""Contacts, and means of outputs along orbits.

The mean of f over the period T of an orbit with flights from :math:`t_k` to :math:`t_{k+1}` is

.. math:: \bar f = \frac1T \sum_k \int_{t_k}^{t_{k+1}} f(t, x, v)\,dt.

Flights are analytic, so that Gauss-Legendre quadrature on them converges geometrically.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np

from ..arrays import Array, Vector
from ..errors import InputError
from ..models.expressions import values_of
from ..models.model import Model
from ..models.outputs import CONTACT, TIME, VOLTAGE, Output, state_names
from ..segments.segment import ARRAYS, evaluate_in
from .problem import Linearisation, motion_of

if TYPE_CHECKING:
    from ..segments.derivatives import Series
    from ..segments.segment import Arithmetic

# Contacts with what gives way: how long they last, how deep they go, what velocity they leave.

DEGREES = (16, 32, 64, 128)
"""Degrees of the polynomials by which a contact's motion is interpolated, one after the other."""


class Contact(NamedTuple):
    """One contact, from a guard to the one that ends it on the same surface."""

    wall: str
    """The letter at which it begins."""
    time: float
    duration: float
    deflection: float
    """The greatest distance beyond the surface."""
    speed: float
    """Before the contact."""
    restitution: float
    """The velocity of release by that of arrival, with the sign turned."""
    error: float
    """An estimate of the deflection's error."""


def contacts_of(here: Linearisation, model: Model, deep: bool = True) -> list[Contact]:
    """Return the contacts along an orbit at the model's parameter values; unless `deep`, their
    deflections, which take the motion between impacts, are not numbers."""
    problem, z = here.problem, here.unknowns
    word = problem.word.walls
    places = dict(zip(model.letters, problem.kernels.setup(*problem.values(z)).walls, strict=True))
    contacts = _contacts(model, word, places)
    if not contacts:
        return []
    speeds = problem.impacts(z)[:, 1].tolist()
    depths = before = np.full(len(contacts), np.nan)
    for degree in DEGREES if deep else ():
        before, depths = depths, _depths(here, model, contacts, places, degree)
        if (abs(depths - before) <= 1e-14 * np.max(abs(depths))).all():
            break  # positions round alike in slow contacts and in fast ones
    found = []
    for flights, depth, error in zip(
        contacts, depths.tolist(), abs(depths - before).tolist(), strict=True
    ):
        first, last = flights[0], flights[-1]
        duration = sum(end - begin for begin, end in map(partial(problem.times_around, z), flights))
        begin, _ = problem.times_around(z, first)
        arriving, leaving = speeds[first], speeds[(last + 1) % len(word)]
        ratio = -leaving / arriving if arriving else np.nan
        found.append(Contact(word[first], begin, duration, depth, abs(arriving), ratio, error))
    return found


def _contacts(model: Model, word: str, places: dict[str, float]) -> list[list[int]]:
    """The flights of each contact.

    It begins at a guard that leads away from the first mode, or from those that guards on other
    coordinates lead to from there, and ends at the next guard on its coordinate, if that is the
    same surface on the way back. What can slide on its surface is in no contact there.
    """
    found, switching = [], {guard.coordinate for guard in model.WALLS if guard.past}
    for k, letter in enumerate(word):
        begin = model.guard(letter)
        if begin.coordinate in switching:
            continue
        outside = _modes_around(model, begin.coordinate)
        if begin.next_mode in outside or outside.isdisjoint(begin.modes):
            continue
        for n in range(1, len(word) + 1):
            end = model.guard(word[(k + n) % len(word)])
            if end.coordinate == begin.coordinate:
                if end.side == -begin.side and places[end.name] == places[letter]:
                    found.append([(k + i) % len(word) for i in range(n)])
                break
    return found


def _modes_around(model: Model, coordinate: int | tuple[float, ...]) -> set[str]:
    """The first mode, and those reached from it by guards on other coordinates."""
    found, more = set[str](), {model.first_mode}
    while more:
        found |= more
        others = (g for g in model.WALLS if g.coordinate != coordinate)
        more = {g.next_mode for g in others if found & {*g.modes}} - found
    return found


def _depths(
    here: Linearisation,
    model: Model,
    contacts: list[list[int]],
    places: dict[str, float],
    degree: int,
) -> Array:
    """The greatest distances beyond the surfaces, from polynomials of a degree."""
    word = here.problem.word.walls
    parts = (1.0 - np.cos(np.pi * np.arange(degree + 1) / degree)) / 2.0
    motion = np.reshape(motion_of(here, parts).x, (len(word), degree + 1, -1))
    found = []
    for flights in contacts:
        guard = model.guard(word[flights[0]])
        row = np.array(guard.row(model.DEGREES_OF_FREEDOM), dtype=float)
        beyond = (guard.side * (motion[k] @ row - places[guard.name]) for k in flights)
        found.append(max(_greatest(parts, values) for values in beyond))
    return np.array(found)


def _greatest(parts: Vector, values: Vector) -> float:
    """The greatest value of a polynomial that has some at Chebyshev's points on [0, 1]."""
    from numpy.polynomial import chebyshev

    factors = chebyshev.chebfit(2.0 * parts - 1.0, values, len(parts) - 1)
    turns = chebyshev.chebroots(chebyshev.chebder(factors))
    inside = turns[(abs(turns.imag) < 1e-8) & (abs(turns.real) <= 1.0)].real
    return float(np.max(chebyshev.chebval(np.r_[-1.0, inside, 1.0], factors)))


NODES = 20
"""Nodes of the quadrature on each part of a flight."""
MOST_PARTS = 64
"""Parts into which a flight is divided at most; their number is doubled from 1."""
ROUNDING = 8 * float(np.finfo(float).eps)
"""Relative difference of two quadratures that is rounding."""


class Mean(NamedTuple):
    """The mean of an output, and an estimate of its error."""

    value: float
    """Not a number where impacts are out of order, or there are none, or no contacts, to take the
    mean over."""
    error: float


def means_of(here: Linearisation, outputs: Sequence[Output], model: Model) -> list[Mean]:
    """Return the means of outputs along an orbit at the model's parameter values.

    The error of a mean over time is the difference between two quadratures, of which the last one
    is on twice as many parts of each flight, and at least its rounding.
    """
    problem = here.problem
    if problem.word.walls:
        flights = range(len(problem.word.walls))
        ends = [problem.times_around(here.unknowns, k) for k in flights]
        lengths = np.array([float(end - begin) for begin, end in ends])
    else:
        lengths = np.array([here.span])
    if (lengths < 0.0).any():
        return [Mean(np.nan, np.nan)] * len(outputs)
    if any(output.contacts for output in outputs):
        along = iter(means_of(here, [o for o in outputs if not o.contacts], model))
        deep = any("deflection" in output.expression for output in outputs if output.contacts)
        contacts, known = contacts_of(here, model, deep), {**model.values, **here.derived}
        return [
            _over_contacts(contacts, one, known) if one.contacts else next(along) for one in outputs
        ]
    if not outputs:
        return []
    found = []
    values, over_time, errors = integrals_of(
        outputs, lambda places: values_at(here, outputs, model, places), lengths / here.span
    )
    for k, output in enumerate(outputs):
        arriving = values[k, :, -1] if problem.word.walls else np.zeros(0)
        if not output.at_impacts:
            found.append(Mean(float(over_time[k]), float(errors[k])))
        elif len(arriving):
            count = here.span if output.per_time else len(arriving)
            rounding = ROUNDING * float(np.sum(abs(arriving))) / count
            found.append(Mean(float(np.sum(arriving)) / count, rounding))
        else:
            found.append(Mean(np.nan, np.nan))
    return found


def integrals_of(
    outputs: Sequence[Output], integrand: Callable[[Array], Array], lengths: Array
) -> tuple[Array, Array, Array]:
    """Integrate outputs over the flights: values at the last places, integrals, and their errors;
    those at impacts need no integral."""
    smooth = np.array([not output.at_impacts for output in outputs])
    if not smooth.any():
        values = integrand(np.ones(1))
        return values, np.zeros(len(outputs)), np.zeros(len(outputs))
    before, parts = np.array(np.nan), 2
    while True:
        rules = quadrature(parts), *([quadrature(1)] if parts == 2 else [])
        places = np.unique(np.concatenate([nodes for nodes, _ in rules]))
        known = integrand(places)  # both of the first two at once: it is dear to begin
        for nodes, weights in reversed(rules):
            values = np.take(known, np.searchsorted(places, nodes), axis=-1)
            over_time = np.einsum("ofi,i,f->o", values, weights, lengths)
            sizes = np.einsum("ofi,i,f->o", abs(values), weights, lengths)
            errors = np.maximum(abs(over_time - before), ROUNDING / 8 * sizes)
            before = over_time
        if parts == MOST_PARTS or (errors <= ROUNDING * sizes)[smooth].all():
            return values, over_time, errors
        parts *= 2


def _over_contacts(
    contacts: Sequence[Contact], output: Output, parameters: dict[str, float]
) -> Mean:
    """The mean of an output over contacts; its error is by that of the deflections."""
    chosen = [c for c in contacts if c.wall in output.contacts]
    if not chosen:
        return Mean(np.nan, np.nan)
    both = []
    for shift in (0.0, 1.0):
        known = {name: np.array([getattr(c, name) for c in chosen]) for name in CONTACT}
        known["deflection"] = known["deflection"] + shift * np.array([c.error for c in chosen])
        with np.errstate(all="ignore"):
            found = values_of(output.expression, output.name, known | parameters)
        both.append(float(np.mean(found)))
    return Mean(both[0], abs(both[1] - both[0]) + ROUNDING * abs(both[0]))


def rates_of(here: Linearisation) -> Array:
    """Return the derivatives of an orbit's unknowns by its free parameters, shape (n, free).

    Raises InputError for an orbit at a fold or a branch point.
    """
    jacobian, n = here.jacobian, here.problem.n
    try:
        return -np.linalg.solve(jacobian[:, :n], jacobian[:, n:])
    except np.linalg.LinAlgError:
        accepted = "take an orbit beside it"
        raise InputError("orbit", "it turns here: its derivatives are infinite", accepted) from None


def values_at(here: Linearisation, outputs: Sequence[Output], model: Model, places: Array) -> Array:
    """Values of outputs at places on all flights, shape (outputs, flights, places)."""
    path, walls = motion_of(here, places), here.problem.word.walls
    count = max(len(walls), 1)
    t, x, v = (np.reshape(part, (count, len(places), -1)) for part in path)
    found = np.empty((len(outputs), count, len(places)))
    for k in range(count):
        mode = model.guard(walls[k]).next_mode if walls else model.first_mode
        names = state_names(model, mode)
        columns = [*x[k].T[: len(names) // 2], *v[k].T[: len(names) // 2]]
        known = dict(zip(names, columns, strict=True)) | {TIME: t[k, :, 0]}
        known |= {**model.values, **here.derived}
        known.pop("", None)
        for row, output in enumerate(outputs):
            with np.errstate(all="ignore"):  # what is not finite is a mean that is no number
                if output.harvester is not None:
                    speed = output.harvester.scale(known) * columns[len(names) // 2]
                    known[VOLTAGE] = output.harvester.voltage(speed)
                used = {name: known[name] for name in output.variables(model)}
                found[row, k] = values_of(output.expression, output.name, used)
    return found


@functools.cache
def quadrature(parts: int) -> tuple[Array, Array]:
    """Places and weights on (0, 1), divided into equal parts; both ends have no weight."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    places = (np.arange(parts)[:, None] + (nodes + 1.0) / 2.0) / parts
    inner = np.tile(weights / (2.0 * parts), parts)
    return np.r_[0.0, places.ravel(), 1.0], np.r_[0.0, inner, 0.0]


# Derivatives of outputs' means by parameters, and largest values of outputs with theirs.
#
# At a given part of a flight the state is a function of what it leaves with, its length and the
# parameters: the mean's derivative by a parameter is an integral of the same kind. Series of two
# terms carry the derivatives of orbit, flight and expression.


PLACED = 1e-8
"""Part of a flight to which the largest value of an output is placed on it."""


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


@functools.cache
def _moving_numbers() -> tuple[Arithmetic, Arithmetic]:
    """Numbers, and arrays of them, with their derivatives; imported where they are asked for."""
    from ..segments.derivatives import FLOAT_SERIES, series

    return FLOAT_SERIES, series(ARRAYS)


_Moving: TypeAlias = "tuple[list[list[Series]], list[Series], list[Series]]"
"""Impacts, lengths of flights and parameters, with their derivatives by a parameter."""


def _moving(here: Linearisation, rates: Array, column: int) -> _Moving:
    """An orbit as it moves with a free parameter."""
    from ..segments.derivatives import Series

    problem = here.problem
    name = problem.kernels.parameters[column]
    parameters = [
        Series([value, float(one == name)])
        for one, value in zip(problem.model.values, problem.values(here.unknowns), strict=True)
    ]
    pairs = np.c_[here.unknowns[: problem.n], rates[:, column]].reshape(-1, problem.m, 2)
    rows = [[Series(pair) for pair in row] for row in pairs.tolist()]
    period = evaluate_in(problem.kernels.setup, _moving_numbers()[0])(*parameters).period
    ends = [row[0] for row in rows[1:]] + [problem.closing(rows[0][0], period)]
    return rows, [end - row[0] for row, end in zip(rows, ends, strict=True)], parameters


def _slopes(
    here: Linearisation, outputs: Sequence[Output], model: Model, places: Array, moving: _Moving
) -> Array:
    """Derivatives of outputs at places on all flights, shape (outputs, flights, places); of those
    over time with the part by which the flight's length grows."""
    from ..segments.derivatives import Series, compose_series

    moving_numbers, moving_arrays = _moving_numbers()
    problem, (rows, flights, parameters) = here.problem, moving
    found = np.empty((len(outputs), len(rows), len(places)))
    derived = evaluate_in(problem.kernels.setup, moving_numbers)(*parameters).derived
    for k, (wall, row, length) in enumerate(zip(problem.word.walls, rows, flights, strict=True)):
        kernel = problem.kernels.states(wall)
        if kernel.family.stepped:
            states = evaluate_in(kernel, moving_numbers)
            flown = [states(*row, length * place, *parameters) for place in places.tolist()]
            pairs = np.array([[_pair(x) for x in state] for state in flown]).transpose(1, 2, 0)
        else:
            flown = evaluate_in(kernel, moving_arrays)(*row, length * places, *parameters)
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
                values_of(output.expression, output.name, used, moving_arrays.names), len(places)
            )
            found[number, k] = slope if output.at_impacts else slope + growth * value
    return found


def _pair(number: Any, size: int | None = None) -> Array:
    """A number and its derivative, of arrays if a size is given."""
    pair = [*getattr(number, "coefficients", (number,)), 0.0][:2]
    return np.array([np.broadcast_to(x, (size,)) if size else x for x in pair], dtype=float)
