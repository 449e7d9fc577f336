"""Walks on which flights that are integrated may become too long to be computed as a whole."""

from __future__ import annotations

from ..continuation.problem import Problem
from ..continuation.step import Backend, Batch, DenseBackend, Position
from ..segments.kernels import Kernels


class UntilLong:
    """A backend of whole flights until one of them is long, and dense linear algebra from there.

    Parameters
    ----------
    whole : Backend
    problem : Problem
        Its problem, of which long flights are computed in pieces.
    kernels : Kernels
        Which notice that flights are long.
    """

    def __init__(self, whole: Backend, problem: Problem, kernels: Kernels) -> None:
        self.whole, self.kernels = whole, kernels
        self.pieces = DenseBackend(problem)
        self.long = False

    def advance(self, position: Position, most: int) -> Batch:
        """Take steps until one is proposed or refused, but `most` of them, or fewer."""
        if not self.long:
            self.kernels.long = False
            made = self.whole.advance(position, most)
            if not self.kernels.long:
                return made
            self.long = True
        return self.pieces.advance(position, most)
