"""Points of codimension two followed in a third parameter: ``PD-G``, cusps, resonances, ..."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..bifurcations.registry import kind_of
from ..continuation.branch import Point, TestFunction
from ..continuation.ends import End, EndKind
from ..continuation.settings import Settings
from ..errors import InputError
from ..models.model import Model
from ..models.word import Word
from ..orbits.problem import Array, Linearisation
from ..orbits.quiet import problem_of
from ..results.branch import Entry, model_of
from ..results.curve import Codim2, Curve
from ..results.entry_conversion import details_of
from ..results.options import CURVE_SETTINGS
from ..results.tables import coordinates
from ..segments.kernels import Kernels
from .curves import Range, admitted, checked_range, followed, tabulated
from .points import double_of
from .problem import CurveProblem, require_curve

ELSEWHERE = 1e-4
"""A curve's first point differs less from where it was to start, as part of its unknowns."""

SAME_VALUE = 1e-12
SAME_POINT = 1e-8
"""How far apart values and, as part of their ranges, coordinates of one point may be."""


def follow_codim2(
    entry: Entry,
    point: Codim2,
    model: Model | None = None,
    *,
    second: str,
    third: str,
    ranges: Sequence[Range],
    name: str = "c1",
    values: Sequence[float] = (),
    settings: Settings = CURVE_SETTINGS,
    kernels: Kernels | None = None,
    detect: bool = True,
    callback: Callable[[Point], bool | None] | None = None,
) -> Curve | End:
    """Follow a point of codimension two in a third parameter, in both directions.

    Parameters
    ----------
    entry : Entry
        From which the curve was started that has the point: its kind and place on the orbit.
    point : Codim2
        Of `Curve.points`.
    model : Model, optional
        The system, where its name does not tell; parameter values are taken from the point.
    second, third : str
        The curve's second parameter, and a further one.
    ranges : sequence of (low, high)
        Of the first, the second and the third parameter; the curve ends where it leaves one.
    name : str
    values : sequence of float
        Values of the third parameter to hit exactly.
    settings : Settings
    kernels : Kernels, optional
        With all three parameters free, if some are at hand.
    detect : bool
        Whether to look for points of codimension three, and for turns, where two points meet.
    callback : callable, optional
        Called with every accepted point.

    Returns
    -------
    Curve or End
        With three `parameters`; what is special on it in `points`. The end of a curve that has no
        point, where its equations are not solved at the start.

    Raises
    ------
    InputError
        For a parameter the model does not have, ranges that do not hold the point, or a point
        that is not on a curve of the entry's kind.
    """
    require_curve(entry)
    first = entry.parameter
    at = there(entry, point, model)
    names = (first, second, third)
    if len(ranges) != len(names):
        raise InputError("ranges", f"found {len(ranges)}", "give one for each of three parameters")
    limits = [
        checked_range(at, n, at.values.get(n, 0.0), r) for n, r in zip(names, ranges, strict=True)
    ]
    kernels = kernels or Kernels(at, *names)
    problem, tests, start = _problem(entry, point, at, kernels, limits)
    special = tests if detect else []
    found = followed(problem, start, limits, special, values, settings, callback)
    if isinstance(found, End):
        return found
    away = problem.difference(found[1].points[0].unknowns, start)[: problem.orbit.n]
    if np.max(np.abs(away)) > ELSEWHERE * np.max(np.abs(start[: problem.orbit.n])):
        why = "the equations lead to another orbit"
        return End.of(EndKind.START, third, start[-1], why=why)
    about = problem.kind.name, entry.notation, point.id
    return tabulated(name, problem, found, special, *about)


def _problem(
    entry: Entry, point: Codim2, model: Model, kernels: Kernels, limits: Sequence[Range]
) -> tuple[CurveProblem, Sequence[TestFunction], Array]:
    """The problem of a point's curve, what to look for on it, and where it starts."""
    here = orbit_at(entry, point, model, kernels)
    orbit = here.unknowns
    double = double_of(here, point.kind, kind_of(entry.kind), details_of(entry), point.changes)
    spans = [high - low for low, high in limits[:-1]]
    curve = CurveProblem(double.kind, double.system, double.details, spans)
    return curve, double.tests, curve.packed(orbit, double.system.start(here))


def orbit_at(entry: Entry, point: Codim2, model: Model, kernels: Kernels) -> Linearisation:
    """Return the orbit of a point of codimension two.

    Parameters
    ----------
    entry : Entry
        From which the curve was started that has the point.
    point : Codim2
    model : Model
        At the point's parameter values.
    kernels : Kernels
    """
    problem = problem_of(model, Word(entry.word, entry.period), kernels)
    names = ["time", "velocity", *coordinates(problem.m)[2:]]
    rows = [[impact[name] for name in names] for impact in point.impacts]
    free = [model.values[name] for name in kernels.parameters]
    return problem.evaluate(np.append(np.ravel(rows), free))


def there(entry: Entry, point: Codim2, model: Model | None) -> Model:
    """Return the model at a point's parameter values."""
    at = model_of(entry, model)
    given = point.parameters.items()
    own = {n: float(admitted(at, n, v)) for n, v in given if n in at.values}
    return at.replace(**own)


def on_curve(entry: Entry, point: Codim2, curve: Curve) -> bool:
    """Whether a curve that hits a point's value of the third parameter passes through the point."""
    *others, third = curve.parameters
    if (entry.word, entry.period) != (curve.word, curve.period):
        return False
    if {*point.kind.split("-")} != {*curve.kind.split("-")}:
        return False
    away = np.abs(curve[third] - point.parameters[third]) > SAME_VALUE
    for name in others:
        away |= np.abs(curve[name] - point.parameters[name]) > SAME_POINT * np.ptp(curve[name])
    return not bool(np.all(away))
