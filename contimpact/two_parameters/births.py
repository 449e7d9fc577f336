"""Curves that start at points of codimension two on other curves, or pass these.

At a GPD the fold of the doubled orbit begins, at a G-FB the fold of the orbit with one impact more,
at a PD-G the grazing of the doubled orbit, at R1 and R2 the curve of NS; the grazing of a PD-G and
the fold of an FB-G are on curves of their own. (Through a cusp the one curve of both folds passes.)
At such a point solutions cross or multipliers coincide, so that a curve is entered a little beside.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..bifurcations.codimension_two import CurveStart
from ..bifurcations.registry import kind_of
from ..continuation.branch import Event, Point
from ..continuation.corrector import correct, first_tangent
from ..continuation.problem import length
from ..models.model import Model
from ..orbits.problem import Array
from ..orbits.quiet import problem_of
from ..orbits.search import repeats
from ..results.branch import Entry
from ..results.curve import Codim2
from ..results.entry_conversion import details_of, entry_of
from ..results.options import CURVE_SETTINGS
from ..segments.kernels import Kernels
from .codim2_curves import orbit_at, there
from .points import starts_at
from .problem import CurvePoint, CurveProblem

BESIDE = (0.05, 0.02, 0.005, 0.001)
"""How far beside the point a curve is entered, tried in turn; in the curve's metric."""

NEARLY = 1e-3
"""How near to a shorter orbit one is taken for it; points beside a PD-G are known no better."""

Range = tuple[float, float]


def entries_born(
    entry: Entry,
    point: Codim2,
    model: Model,
    kinds: Sequence[str],
    kernels: Kernels,
    ranges: Sequence[Range],
) -> Iterator[Entry]:
    """Events beside a point of codimension two, on the curves of other events that meet there.

    Parameters
    ----------
    entry : Entry
        From which the curve was started that has the point.
    point : Codim2
    model : Model
    kinds : sequence of str
        Of the curves that are wanted.
    kernels : Kernels
        With both parameters free.
    ranges : sequence of (low, high)
        Of both parameters, within which the events lie.

    Yields
    ------
    Entry
        One for each direction in which a curve leaves.
    """
    at = there(entry, point, model)
    here = orbit_at(entry, point, at, kernels)
    starts = starts_at(here, point.kind, kind_of(entry.kind), details_of(entry), point.changes)
    for start in starts:
        if start.kind in kinds and not _repeats(start):
            for found in _beside(start, ranges):
                yield _entry_at(found, point.id)


def _repeats(start: CurveStart) -> bool:
    """Whether the orbits are shorter ones run several times, with a curve of their own: where one
    doubles its period, the double has the multiplier 1 as at a fold."""
    here = start.here
    return start.leaves is None and repeats(here.problem, here.unknowns, NEARLY)


def _beside(start: CurveStart, ranges: Sequence[Range]) -> Iterator[CurvePoint]:
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
        found = _entered(curve, middle, direction * tangent, scale, ranges)
        if found is not None:
            yield found


def _entered(
    curve: CurveProblem, middle: Array, tangent: Array, scale: Array, ranges: Sequence[Range]
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
