"""From the points of a branch and its entries to the columns of its table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..arrays import Array
from ..bifurcations.requested import PERIOD
from ..continuation.branch import Point, Points
from ..orbits.multipliers import count_unstable
from ..orbits.physicality import PHYSICAL, reason_of
from ..orbits.problem import OrbitProblem, Summary
from ..results.branch import Entry
from ..results.tables import columns_of


def tabulate(
    points: Points, entries: Sequence[tuple[Point, Entry]], borrowed: Sequence[float] = ()
) -> dict[str, Array]:
    """Return the columns of a branch: a row per point, and one for each event between points.

    Parameters
    ----------
    points : Points
    entries : sequence of (Point, Entry)
        The events' points, in order of arclength. Their rows, or those of the points they stand on,
        have the verdicts of the first entry there, which leave the event itself out.
    borrowed : sequence of float
        Arclengths of points at which rounding would decide: their rows have the verdicts of the
        next one, the last of the one before.
    """
    places = points.arclengths
    between: list[Point] = []
    on_events = np.nonzero(np.isin(places, [point.arclength for point, _ in entries]))[0]
    rows = dict(zip(places[on_events].tolist(), on_events.tolist(), strict=True))
    marked: dict[int, Entry] = {}
    for point, entry in entries:
        if point.arclength not in rows:
            rows[point.arclength] = len(points) + len(between)
            between.append(point)
        marked.setdefault(rows[point.arclength], entry)
    columns = _columns(Points([*points.pieces, *between]))
    columns["event"] = np.full(len(columns["arclength"]), "", dtype=object)
    for row, entry in marked.items():
        columns["n_unstable"][row] = entry.n_unstable
        columns["physical"][row] = int(entry.physical)
        columns["reason"][row] = entry.reason or ""
        columns["event"][row] = entry.id
        if entry.impact in points[0].evaluation.problem.excursions and entry.flight is None:
            _set_multipliers(columns, row, entry)
    order = np.argsort(columns["arclength"], kind="stable")
    for name in columns:  # one after the other: a long branch is not held twice
        columns[name] = columns[name][order]
    rounding = np.isin(columns["arclength"], borrowed) & (columns["event"] == "")
    for place in np.nonzero(rounding)[0].tolist():
        beside = place + 1 if place + 1 < len(order) else place - 1
        for name in ("n_unstable", "physical", "reason"):
            columns[name][place] = columns[name][beside]
    return columns


def _set_multipliers(columns: dict[str, Array], row: int, entry: Entry) -> None:
    """Those of the orbit without the excursion that vanishes: with it they have no digits there."""
    for k, pair in enumerate(entry.multipliers, start=1):
        columns[f"multiplier{k}_re"][row], columns[f"multiplier{k}_im"][row] = pair or (np.inf, 0.0)


def _columns(points: Points) -> dict[str, Array]:
    """A row per point, in the points' order."""
    problem = points[0].evaluation.problem
    unknowns = points.unknowns
    columns = {"arclength": points.arclengths, **_parameters(problem, unknowns[:, -1])}
    for name, column in zip(columns_of(problem.word.walls, problem.m), unknowns.T, strict=False):
        columns[name] = column.copy()
    if problem.autonomous:
        columns |= _in_their_clock(problem, columns, unknowns)
    summary = Summary.of(points.numbers)
    factors, findings = summary.multipliers, summary.findings
    for k, factor in enumerate(factors.T, start=1):
        columns |= {f"multiplier{k}_re": factor.real, f"multiplier{k}_im": factor.imag}
    columns["n_unstable"] = count_unstable(factors)
    physical = findings[:, 0] == PHYSICAL
    columns["physical"] = physical.astype(np.int64)
    word, named = problem.word.walls, problem.model.WALLS
    reasons = columns["reason"] = np.full(len(findings), "", dtype=object)
    for row in np.nonzero(~physical)[0]:
        reasons[row] = reason_of(findings[row].tolist(), word, named) or ""
    columns["smallest_gap"] = findings[:, -1].copy()
    columns["residual"] = summary.largest_residual.copy()
    columns["iterations"] = points.iterations
    return columns


def _in_their_clock(
    problem: OrbitProblem, columns: Mapping[str, Array], unknowns: Array
) -> dict[str, Array]:
    """The columns of free periods, and of times since the first passage."""
    if not problem.word.walls:
        return {"v0_0": np.zeros(len(unknowns)), PERIOD: columns["v0_0"]}
    times = [f"t{k}" for k in range(1, len(problem.word) + 1)]
    moved = {name: columns[name] - columns["t1"] for name in times}
    return {**moved, PERIOD: -columns["t1"]}


def _parameters(problem: OrbitProblem, free: Array) -> dict[str, Array]:
    """The columns of the parameters and derived parameters, given the followed one's."""
    values = {name: np.full(len(free), value) for name, value in problem.model.values.items()}
    values[problem.parameter] = free.copy()
    derived = np.empty((len(problem.model.DERIVED), len(free)))
    for row in range(len(free)):
        derived[:, row] = problem.derived_at(problem.values(free[row : row + 1]))
    return values | dict(zip(problem.model.DERIVED, derived, strict=True))
