"""A continuation problem given by functions of the unknowns, for tests of the walk alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Values:
    """An evaluation."""

    unknowns: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray


@dataclass
class Algebraic:
    """n equations in n + 1 unknowns, as functions of the unknowns; the parameter is last."""

    equations: object
    derivatives: object
    evaluations: int = 0

    def evaluate(self, unknowns):
        self.evaluations += 1
        return Values(
            unknowns,
            np.atleast_1d(np.array(self.equations(*unknowns.tolist()), dtype=float)),
            np.atleast_2d(np.array(self.derivatives(*unknowns.tolist()), dtype=float)),
        )

    def scale(self, unknowns, span):
        return np.ones(len(unknowns))

    def difference(self, one, other):
        return one - other
