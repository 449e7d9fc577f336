"""From the table of a branch to tubes, one after the other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..orbits.problem import Array, OrbitProblem
from ..progress import Progress
from ..results.branch import Branch
from ..results.tables import coordinates
from .budget import Budget
from .equations import BallProblem
from .nodes import halved, node_at
from .tube import Node, Segment, Tube, proven_tube

FINEST = 1e-4
"""Largest half width of a tube, in natural sizes of the unknowns, unless it spans one step."""
DEEPEST = 12
"""How often the step of a table is halved."""
AWAY = 0.05
"""Tubes do not end nearer to an event than this part of the step."""


def points_of(branch: Branch, problem: OrbitProblem) -> Array:
    """The orbits of a table from which tubes may begin: events are no ends of tubes."""
    names = [f"{n}{k}" for k in range(1, len(branch.word) + 1) for n in coordinates(problem.m)]
    rows = np.column_stack([branch[name] for name in (*names, branch.parameter)])
    events = np.array([name != "" for name in branch["event"]])
    places = branch["arclength"]
    spacing = np.gradient(places) if len(places) > 1 else np.ones(1)
    near = np.zeros(len(rows), dtype=bool)
    for where in [e.arclength for e in branch.events]:
        near |= np.abs(places - where) < AWAY * np.abs(spacing)
    kept = ~(events | near)
    kept[[0, -1]] = True
    kept[1:] &= np.any(rows[1:] != rows[:-1], axis=1)
    return rows[kept]


def scale_of(problem: OrbitProblem, points: Array) -> Array:
    """Natural sizes of the unknowns: the largest of those along the branch, because one that
    passes through zero has none there."""
    span = float(np.ptp(points[:, -1])) or 1.0
    sizes = [problem.scale(z, span) for z in points]
    return np.asarray(np.max(sizes, axis=0))


def nodes_of(problem: OrbitProblem, points: Array, scale: Array) -> list[Node]:
    count = len(points)
    return [
        node_at(problem, z, scale, points[min(i + 1, count - 1)] - points[max(i - 1, 0)])
        for i, z in enumerate(points)
    ]


def laid(
    space: BallProblem, nodes: Sequence[Node], scale: Array, progress: Progress, budget: Budget
) -> Iterator[tuple[Segment, Tube | None]]:
    """Yield tubes from node to node, each over as many steps as it can, or None; None for every
    step that is left when the budget is spent."""
    i, steps = 0, 4
    while i < len(nodes) - 1:
        if budget.spent:
            yield Segment(space, nodes[i], nodes[i + 1], scale), None
            i += 1
            continue
        j = min(i + steps, len(nodes) - 1)
        segment = Segment(space, nodes[i], nodes[j], scale)
        tube = proven_tube(segment)
        wide = tube is not None and bool(np.max(tube.inner / scale) > FINEST)
        if j - i > 1 and (tube is None or wide):
            steps = (j - i) // 2
            continue
        if tube is None:
            yield from split(segment, DEEPEST, budget)
        else:
            yield segment, tube
        i, steps = j, 2 * steps
        progress(f"{i} of {len(nodes) - 1} steps")


def split(segment: Segment, depth: int, budget: Budget) -> Iterator[tuple[Segment, Tube | None]]:
    """Yield tubes along a step in which a single one is not proven."""
    parts = halved(segment) if depth > 0 and not budget.spent else None
    if parts is None:
        yield segment, None
        return
    for part in parts:
        tube = proven_tube(part)
        if tube is not None:
            yield part, tube
        else:
            yield from split(part, depth - 1, budget)
