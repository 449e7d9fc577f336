"""Nodes between tubes: orbits of a branch in doubles. Nothing is proven by them."""

from __future__ import annotations

import numpy as np

from ..orbits.problem import Array, OrbitProblem
from .tube import Node, Segment

SHORTEST = 2e-5
"""Length of segments, in natural sizes of the unknowns, that are not halved: where branches cross,
no tube is short enough."""


def node_at(problem: OrbitProblem, unknowns: Array, scale: Array, along: Array) -> Node:
    """Return a node at an orbit, its tangent in the direction of another vector."""
    jacobian = problem.evaluate(unknowns).jacobian * scale
    tangent = np.linalg.svd(jacobian)[2][-1]
    if tangent @ (along / scale) < 0.0:
        tangent = -tangent
    return Node(unknowns, tangent * scale)


def halved(segment: Segment) -> tuple[Segment, Segment] | None:
    """Return two segments in place of one, through an orbit near its middle; None without one."""
    if segment.length < SHORTEST:
        return None
    problem, z = segment.space.problem, segment.doubles(0.0)
    row = np.array([float(x.mid()) for x in segment.row[0]])
    middle = z
    try:
        for _ in range(8):
            here = problem.evaluate(middle)
            matrix = np.vstack([here.jacobian, row])
            step = np.linalg.solve(matrix, np.append(here.residual, row @ (middle - z)))
            middle = middle - step
            if np.max(np.abs(step) / segment.scale) < 1e-14:
                break
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None
    if not np.max(np.abs(middle - z) / segment.scale) < 0.5 * segment.length:
        return None
    node = node_at(problem, middle, segment.scale, segment.last.unknowns - segment.first.unknowns)
    return (
        Segment(segment.space, segment.first, node, segment.scale),
        Segment(segment.space, node, segment.last, segment.scale),
    )
