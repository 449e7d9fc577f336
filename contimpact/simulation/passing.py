"""Arrivals at a switching surface: where the motion slides, and where it goes through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..models.guards import slides_at
from ..segments.kernels import Kernels
from ..segments.touches import margin
from .run import State


class Passing:
    """Decides which guard is met of two on one surface; see `Guard.past`.

    Parameters
    ----------
    kernels : Kernels
    values, positions : sequence of float
        Of the parameters, and of the guards.
    """

    def __init__(
        self, kernels: Kernels, values: Sequence[float], positions: Sequence[float]
    ) -> None:
        self.kernels, self.values, self.positions = kernels, values, positions
        guards = kernels.model.WALLS
        self.pairs: dict[int, tuple[int, int]] = {}
        for k, guard in enumerate(guards):
            sliding = slides_at(guards, guard) if guard.past else None
            if sliding is not None:
                pair = k, guards.index(sliding)
                self.pairs |= dict.fromkeys(pair, pair)

    def __call__(self, state: State) -> State:
        """Return an arrival at the guard that is met."""
        if state.wall not in self.pairs:
            return state
        through, sliding = self.pairs[state.wall]
        guards = self.kernels.model.WALLS
        given = (state.phase, *state.section), self.values, self.positions
        within = margin(self.kernels, guards[sliding].name, guards[through].past, *given)
        return replace(state, wall=through if within < 0.0 else sliding)
