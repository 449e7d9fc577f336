"""The backend for any problem: dense linear algebra, one step at a time."""

from __future__ import annotations

from .batch import Batch, Position, batch_of, columns
from .bordered import DenseSystem
from .branch import Point
from .problem import Array, Problem
from .step import HEAD, take_steps


class DenseBackend:
    """A problem as steps ask for it, with test functions asked of its points."""

    def __init__(self, problem: Problem) -> None:
        self.system = DenseSystem(problem)

    def advance(self, position: Position, most: int) -> Batch:
        """Take one step."""
        functions = DenseSystem.evaluate, DenseSystem.solve
        asked_besides = DenseSystem.tangent_at, DenseSystem.observe
        vectors = position.vectors(0, 1)
        made = take_steps(*functions, *asked_besides, self.system, tuple(vectors))
        return batch_of(position, self.system.problem, vectors, made, self.point)

    def point(self, rows: Array) -> Point:
        """The point last evaluated, which is that of the only row."""
        _, tangents, *head, _ = columns(rows, (rows.shape[1] - HEAD) // 2)
        orientation, arclength, iterations = (float(column[0]) for column in head)
        return Point(self.system.here, tangents[0], orientation, arclength, int(iterations))
