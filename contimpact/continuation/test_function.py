"""Test functions: functions of the points of a branch whose zeros are events."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from ..arrays import Array
from .branch import Block, Details, Event, Point
from .problem import Evaluation, Problem

At = TypeVar("At", bound=Evaluation, contravariant=True)
"""What a problem makes of the points a test function is for."""


@dataclass(frozen=True, eq=False)
class Located:
    """A solution of a test function's equations: where, how well, and what was evaluated there."""

    unknowns: Array
    residual: float
    error: float
    details: Details = field(default_factory=dict)
    evaluation: Evaluation | None = None


class TestFunction(ABC, Generic[At]):
    """A function of points whose zeros are events; generic in what the problem makes of a point.

    Implementers give `kind`, `values`, and, where they can, `locate`; `accept` may turn a located
    zero down, and `details` describe one found by bracketing.
    """

    __test__ = False  # not a test case
    kind: str
    noise = 0.0
    """Values below this on both sides of a sign change are rounding, not a crossing."""
    rounding = 0.0
    """Two zeros are not looked for among values below this."""

    vanishing = 0.0
    """Values below this do not exist where they cannot be told from zero."""

    evaluations = 0

    guides = 0
    """How many of the values, the last ones, are no test functions themselves but tell where the
    others begin or end."""

    def guided(self, left: Array, right: Array) -> Array:
        """Return which guides are to be followed between two points, shape (guides,)."""
        return np.ones(self.guides, dtype=bool)

    def at(self, point: Point[At]) -> Array:
        """Return `values`, and count the evaluation."""
        self.evaluations += 1
        return self.values(point)

    def on(self, piece: Point[At] | Block) -> Array:
        """Return the values at every point of a piece, and count the evaluations, shape (P, q)."""
        if isinstance(piece, Point):
            return self.at(piece)[None]
        self.evaluations += len(piece)
        return self.batch(piece)

    def batch(self, block: Block) -> Array:
        """Return the values at every point of a block, shape (P, q)."""
        return np.array([self.values(block.point(i)) for i in range(len(block))])

    @abstractmethod
    def values(self, point: Point[At]) -> Array:
        """Return the function's values, shape (q,), the same q along a branch.

        Not-a-number says that a value does not exist here; it never takes part in a crossing.
        """

    def locate(self, problem: Problem[At], guess: Point[At], index: int) -> Located | None:
        """Solve the exact extended system from a nearby point; None if that fails."""
        return None

    def enters(self, point: Point[At], index: int) -> bool:
        """Whether a value begins at the point, where what it is of comes from elsewhere: that it
        jumps there is nothing that was missed."""
        return False

    def accept(self, event: Event[At]) -> bool:
        """Whether a located zero is an event of this kind."""
        return True

    def details(self, point: Point[At], index: int) -> Details:
        """Return what to record of a zero found by bracketing."""
        return {"index": index}


class UserFunction(TestFunction[At]):
    """A user's own function of the point, located by bracketing.

    Parameters
    ----------
    kind : str
        Name of its events.
    function : callable ``function(point) -> float``
    """

    def __init__(self, kind: str, function: Callable[[Point[At]], float]) -> None:
        self.kind, self.function = kind, function

    def values(self, point: Point[At]) -> Array:
        try:
            return np.atleast_1d(np.asarray(self.function(point), dtype=float))
        except ArithmeticError:  # a pole met exactly
            return np.array([np.nan])
