r"""Orbits of systems without forcing: their period T is an unknown.

Neither has the clock of such an orbit a phase. It is set such that the orbit closes at t = 0: the
first passage is at t_1 = -T, and no unknown is added. That passage is a Poincare section, so that
no other condition fixes the phase. The last flight arrives at t = 0, whatever the unknowns are; its
column of t_1 vanishes (N = 3)::

    [ A1 B1      | L1 ]
    [    A2 B2   | L2 ]      B3' is B3 without its first column
    [ B3'   A3   | L3 ]

The multipliers are those of the section's return map, m - 1 of them. In their pencil the first
passage's time is held, and when the orbit returns is what follows: the first column is left out of
A1, not of B3. The multiplier 1 of the flow's direction becomes a 0 in that place, and is left out.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..arrays import Array, Number
from ..models.model import Model
from ..models.word import Word
from ..segments.kernels import Kernels
from .forcing import require_no_forcing
from .problem import OrbitProblem


class WithoutForcing(OrbitProblem):
    """Orbits of a system without forcing."""

    autonomous = True

    def _begin(self, model: Model, word: Word, kernels: Kernels) -> None:
        super()._begin(model, word, kernels)
        require_no_forcing(model, kernels)

    def period(self, unknowns: Array) -> float:
        """Return the orbit's period."""
        return self.span(unknowns)


class FreePeriodProblem(WithoutForcing):
    """The equations of a word in a system without forcing; see `OrbitProblem`."""

    def span(self, unknowns: Array) -> float:
        """Return the orbit's period."""
        return -float(unknowns[0])

    def closing(self, first: Number, period: Number) -> Number:
        """Return when an orbit closes: at t = 0."""
        return 0.0 * first

    def cyclic(self, start: Array, end: Array) -> Array:
        """Return the (n, n + free) cyclic matrix of flattened blocks."""
        end = end.copy()
        end[-self.m * self.m :: self.m] = 0.0
        return super().cyclic(start, end)

    def returned(self, moved: Sequence[float], mu: float) -> list[float]:
        """Return how the arrival at impact 1 moves: not in time."""
        return [0.0, *super().returned(moved[1:], mu)]

    def placed(self, rows: Array, span: float) -> Array:
        """Return an orbit's impacts in the clock in which it closes at t = 0."""
        rows = rows.copy()
        rows[:, 0] -= rows[0, 0] + span
        return rows

    def held(self, start: Array) -> Array:
        """Return the blocks A_k with the first passage's time held."""
        start = start.copy()
        start[0, :, 0] = 0.0
        return start

    def laps(self, first: Array, second: Array) -> Array:
        """Return the direction of the word run twice: one lap closes where the next starts."""
        first = first.copy()
        first[:: self.m] += second[0]
        return super().laps(first, second)
