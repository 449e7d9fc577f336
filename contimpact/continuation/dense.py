"""The backend for any problem: dense linear algebra, one step at a time."""

from __future__ import annotations

import numpy as np

from .batch import Batch, Notice, Position, Proposal, refusal
from .bordered import DenseSystem
from .branch import Point
from .problem import Problem
from .step import HEAD, ITERATIONS, NEXT_STEP, NOTICE, REJECTED, STEP, take_steps


class DenseBackend:
    """A problem as steps ask for it, with test functions asked of its points."""

    def __init__(self, problem: Problem) -> None:
        self.system = DenseSystem(problem)

    def advance(self, position: Position, most: int) -> Batch:
        """Take one step."""
        here, scale = position.here, position.scale.tolist()
        n = len(scale)
        state, row, work = position.state(), [0.0] * (2 * n + HEAD), [[0.0] * n for _ in range(4)]
        made = take_steps(
            DenseSystem.evaluate,
            DenseSystem.solve,
            DenseSystem.tangent_at,
            DenseSystem.observe,
            self.system,
            position.options(),
            state,
            scale,
            here.unknowns.tolist(),
            here.tangent.tolist(),
            position.chord().tolist(),
            work,
            row,
            len(row),
            1,
        )
        problem, notices = self.system.problem, int(state[NOTICE])
        point = self.point(row, n) if made or notices else None
        proposal = None
        if point and notices:
            proposal = Proposal(point, Notice(notices), state[NEXT_STEP])
        counts = int(state[ITERATIONS]), int(state[REJECTED])
        refused = refusal(position, state, problem, work[1])
        return Batch(point if made else None, state[STEP], *counts, proposal, refused)

    def point(self, row: list[float], n: int) -> Point:
        """The point last evaluated, which is that of a row."""
        orientation, arclength, iterations = row[2 * n :]
        evaluation = self.system.here
        return Point(evaluation, np.array(row[n : 2 * n]), orientation, arclength, int(iterations))
