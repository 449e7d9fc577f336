"""Curves through points of codimension two, and curves born on others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from ..arrays import Array
from ..bifurcations.codimension_two import CurveStart
from ..bifurcations.kind import kind_of
from ..continuation.branch import End, EndKind, Event, Point, TestFunction
from ..continuation.corrector import correct, first_tangent
from ..continuation.problem import length
from ..continuation.settings import Settings
from ..errors import InputError, explain_arguments
from ..models.model import Model
from ..models.word import Word
from ..orbits.problem import Linearisation
from ..orbits.quiet import problem_of
from ..orbits.search import repeats
from ..results.branch import Entry, coordinates, model_of
from ..results.curve import Codim2, Curve
from ..results.entry_conversion import details_of, entry_of
from ..results.options import CURVE_SETTINGS
from ..segments.kernels import Kernels
from .curve_problem import CurvePoint, CurveProblem, double_of, require_curve, starts_at
from .curves import Range, check_range, clip_rounding, curve_from_walks, walk_both_ways

ELSEWHERE = 1e-4
"""A curve's first point differs less from where it was to start, as part of its unknowns."""

SAME_VALUE = 1e-12
SAME_POINT = 1e-8
"""How far apart values and, as part of their ranges, coordinates of one point may be."""


@explain_arguments
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
    at = model_at_point(entry, point, model)
    names = (first, second, third)
    if len(ranges) != len(names):
        raise InputError("ranges", f"found {len(ranges)}", "give one for each of three parameters")
    limits = [
        check_range(at, n, at.values.get(n, 0.0), r) for n, r in zip(names, ranges, strict=True)
    ]
    kernels = kernels or Kernels(at, *names)
    problem, tests, start = _problem(entry, point, at, kernels, limits)
    special = tests if detect else []
    found = walk_both_ways(problem, start, limits, special, values, settings, callback)
    if isinstance(found, End):
        return found
    away = problem.difference(found[1].points[0].unknowns, start)[: problem.orbit.n]
    if np.max(np.abs(away)) > ELSEWHERE * np.max(np.abs(start[: problem.orbit.n])):
        why = "the equations lead to another orbit"
        return End.of(EndKind.START, third, start[-1], why=why)
    about = problem.kind.name, entry.notation, point.id
    return curve_from_walks(name, problem, found, special, *about)


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
    """Return the orbit of a point of codimension two, at the model's values; the curve that has the
    point was started from the entry."""
    problem = problem_of(model, Word(entry.word, entry.period), kernels)
    names = ["time", "velocity", *coordinates(problem.m)[2:]]
    rows = [[impact[name] for name in names] for impact in point.impacts]
    free = [model.values[name] for name in kernels.parameters]
    return problem.evaluate(np.append(np.ravel(rows), free))


def model_at_point(entry: Entry, point: Codim2, model: Model | None) -> Model:
    """Return the model at a point's parameter values."""
    at = model_of(entry, model)
    given = point.parameters.items()
    own = {n: float(clip_rounding(at, n, v)) for n, v in given if n in at.values}
    return at.replace(**own)


def passes_through(entry: Entry, point: Codim2, curve: Curve) -> bool:
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


# Curves that start at points of codimension two on other curves, or pass these.
#
# At a GPD the fold of the doubled orbit begins, at a G-FB the fold of the orbit with one impact
# more, at a PD-G the grazing of the doubled orbit, at R1 and R2 the curve of NS; the grazing of a
# PD-G and the fold of an FB-G are on curves of their own. (Through a cusp the one curve of both
# folds passes.) At such a point solutions cross or multipliers coincide, so that a curve is entered
# a little beside.

BESIDE = (0.05, 0.02, 0.005, 0.001)
"""How far beside the point a curve is entered, tried in turn; in the curve's metric."""

NEARLY = 1e-3
"""How near to a shorter orbit one is taken for it; points beside a PD-G are known no better."""

Bounds = tuple[float, float]


def entries_born(
    entry: Entry,
    point: Codim2,
    model: Model,
    kinds: Sequence[str],
    kernels: Kernels,
    ranges: Sequence[Bounds],
) -> Iterator[Entry]:
    """Yield events beside a point of codimension two, on the curves of other events, of these
    kinds, that meet there: one for each direction in which a curve leaves, within the ranges of
    both parameters. The curve that has the point was started from the entry."""
    at = model_at_point(entry, point, model)
    here = orbit_at(entry, point, at, kernels)
    starts = starts_at(here, point.kind, kind_of(entry.kind), details_of(entry), point.changes)
    for start in starts:
        if start.kind in kinds and not _repeats(start):
            for found in _points_beside(start, ranges):
                yield _entry_at(found, point.id)


def _repeats(start: CurveStart) -> bool:
    """Whether the orbits are shorter ones run several times, with a curve of their own: where one
    doubles its period, the double has the multiplier 1 as at a fold."""
    here = start.here
    return start.leaves is None and repeats(here.problem, here.unknowns, NEARLY)


def _points_beside(start: CurveStart, ranges: Sequence[Bounds]) -> Iterator[CurvePoint]:
    """Points of a curve in both directions from its start, where they lie within the ranges."""
    here = start.here
    system = kind_of(start.kind).equations(here.problem, start.details)
    assert system is not None, "every kind that has curves has equations"
    own = system.start(here)
    (low, high), (first, last) = ranges
    curve = CurveProblem(kind_of(start.kind), system, start.details, [high - low])
    middle = curve.packed(here.unknowns, own)
    scale = curve.scale(middle, last - first)
    if start.leaves is None:
        tangent = first_tangent(curve.evaluate(middle).jacobian, scale)
    else:
        tangent = curve.packed(*start.leaves(system, own))
    if tangent is None:
        return
    tangent = tangent / length(tangent, scale)
    for direction in (1.0, -1.0):
        found = _first_curve_point(curve, middle, direction * tangent, scale, ranges)
        if found is not None:
            yield found


def _first_curve_point(
    curve: CurveProblem, middle: Array, tangent: Array, scale: Array, ranges: Sequence[Bounds]
) -> CurvePoint | None:
    """The point of a curve at a small distance, by which its equations are regular."""
    for distance in BESIDE:
        guess = middle + distance * tangent
        solved = correct(curve, guess, tangent / scale**2, scale, CURVE_SETTINGS).evaluation
        if not isinstance(solved, CurvePoint):
            continue
        names = curve.orbit.kernels.parameters
        values = [solved.parameter(name) for name in names]
        if all(low <= v <= high for v, (low, high) in zip(values, ranges, strict=True)):
            return solved
    return None


def _entry_at(point: CurvePoint, origin: str) -> Entry:
    """A point of a curve as an event in the first parameter."""
    problem, unknowns = point.problem.orbit, point.orbit.unknowns
    first, second = problem.kernels.parameters
    model = problem.model.replace(**{second: point.parameter(second)})
    single = problem_of(model, problem.word, Kernels(model, first))
    here = single.evaluate(unknowns[: problem.n + 1])
    at = Point(here, np.zeros(problem.n + 1), np.nan, 0.0, 0)
    residual = float(np.max(np.abs(point.residual)))
    kind = point.problem.kind.name
    event = Event(kind, at, residual, np.nan, "newton", point.details)
    return entry_of(event, f"{origin} beside", origin, at, at)
