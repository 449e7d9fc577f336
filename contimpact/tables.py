"""From the points of a branch and its entries to the columns of its table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .continuation.branch import Point, Points
from .diagram import Array, Entry, coordinates
from .mechanics.physicality import PHYSICAL, reason_of
from .mechanics.stability import count_unstable


def tabulate(points: Points, entries: Sequence[tuple[Point, Entry]]) -> dict[str, Array]:
    """Return the columns of a branch: a row per point, and one for each event between points.

    Parameters
    ----------
    points : Points
    entries : sequence of (Point, Entry)
        The events' points, in order of arclength. Their rows have the entry's verdicts, which
        leave the event itself out.
    """
    taken, between = set(points.arclengths), []
    for point, entry in entries:
        if point.arclength not in taken:
            taken.add(point.arclength)
            between.append((point, entry))
    columns = _columns(Points([*points.items, *(point for point, _ in between)]))
    columns["event"] = np.array([""] * len(taken), dtype=object)
    for row, (_, entry) in enumerate(between, start=len(points)):
        columns["n_unstable"][row] = entry.n_unstable
        columns["physical"][row] = int(entry.physical)
        columns["reason"][row] = entry.reason or ""
        columns["event"][row] = entry.id
    order = np.argsort(columns["arclength"], kind="stable")
    return {name: column[order] for name, column in columns.items()}


def _columns(points: Points) -> dict[str, Array]:
    """A row per point, in the points' order."""
    problem = points[0].evaluation.problem
    unknowns = points.unknowns
    columns = {"arclength": np.array(points.arclengths)}
    parameters = [problem.values(row) for row in unknowns]
    derived = [problem.derived_at(values) for values in parameters]
    columns |= dict(zip(problem.model.values, np.array(parameters).T, strict=True))
    columns |= dict(zip(problem.model.DERIVED, np.array(derived).T, strict=True))
    named = coordinates(problem.m)
    for i, column in enumerate(unknowns[:, : problem.n].T):
        columns[f"{named[i % problem.m]}{i // problem.m + 1}"] = column
    numbers = points.numbers
    factors = numbers[:, 1:-6].copy().view(complex)
    for k, factor in enumerate(factors.T, start=1):
        columns |= {f"multiplier{k}_re": factor.real, f"multiplier{k}_im": factor.imag}
    columns["n_unstable"] = count_unstable(factors)
    columns["physical"] = (numbers[:, -6] == PHYSICAL).astype(np.int64)
    word, named = problem.word.walls, problem.model.WALLS
    reasons = [reason_of(found, word, named) or "" for found in numbers[:, -6:].tolist()]
    columns["reason"] = np.array(reasons, dtype=object)
    columns["smallest_gap"] = numbers[:, -1]
    columns["residual"] = numbers[:, 0]
    columns["iterations"] = points.iterations
    return columns
