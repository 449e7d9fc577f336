r"""The word `0`: orbits without impacts, and where they come nearest to a guard.

The unknowns are the state on the section t = 0, z = (x_0, v_0, x_1, v_1, ..., lambda), in the first
mode of the system. One flight of p periods leads back to the section; its residual and its blocks
stand in the cyclic matrix as those of a word of one letter:

.. math:: R(x, v, x', v', \lambda) = 0, \qquad (x', v') = (x, v).

There is no impact, so there are no times, and the multipliers are those of the map over p periods.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Vector
from ..models.guards import Row
from ..models.model import Model
from ..models.word import Word
from ..segments.arithmetic import ARRAYS, evaluate_in
from ..segments.flight import Excursion, FlightGaps, Moved, excursions, touch_of
from ..segments.integrated_track import integrated_track
from ..segments.kernels import Kernels
from ..segments.layout import SECTION
from ..segments.zeros import chebyshev_zeros
from .linearisation import CyclicBlocks, Linearisation
from .problem import Array, OrbitProblem

BEYOND = 0.125
"""Part of a period for which an orbit is looked at beyond its end: no extremum is at an end of both
the orbit and what is looked at."""


def problem_of(model: Model, word: Word, kernels: Kernels) -> OrbitProblem:
    """Return the equations of a word, `0` among them; arguments as of `OrbitProblem`."""
    kind = OrbitProblem if word.walls else QuietProblem
    return kind(model, word, kernels)


class QuietProblem(OrbitProblem):
    """The equations of orbits without impacts; see `OrbitProblem`."""

    def __init__(self, model: Model, word: Word, kernels: Kernels) -> None:
        self._begin(model, word, kernels)
        self.n = self.m
        self.kinds, self.arrivals, self.excursions, self.lost = (), (), (), 0
        self.segments = [kernels.segment(SECTION, str(word.period))]
        self._place_blocks()

    def impacts(self, unknowns: Array) -> Array:
        """Return the impacts: none."""
        return np.zeros((0, self.m))

    def leaving(self, unknowns: Array, flight: int) -> tuple[str, list[float]]:
        """Return the section and the state there."""
        return SECTION, unknowns[: self.m].tolist()

    def times_around(self, unknowns: Array, flight: int) -> tuple[float, float]:
        """Return the times between which touches are looked for."""
        return 0.0, self.span(unknowns) + BEYOND * self.period(unknowns)

    def evaluate(self, unknowns: Array) -> Linearisation:
        """Evaluate residual and blocks at a point."""
        m = self.m
        state = unknowns[:m].tolist()
        rows, start, end, free = self.segments[0].blocks(state, state, self.values(unknowns))
        self.kernel_evaluations += 1
        one, other = (np.reshape(part, (1, m, m)) for part in (start, end))
        blocks = CyclicBlocks(np.array(rows), one, other, np.reshape(free, (m, -1)))
        return Linearisation(self, unknowns, blocks)

    def second_along(
        self, unknowns: Array, direction: Array, mu: float = 1.0, beside: float = 1.0
    ) -> Array:
        """Return the gradient by z of the cyclic matrix times a direction."""
        m = self.m
        state, q = unknowns[:m].tolist(), direction.tolist()
        along = [*q[:m], *(mu * c for c in q[:m]), *q[m:]]
        _, start, end, free = self.segments[0].second(state, state, along, self.values(unknowns))
        self.kernel_evaluations += 1
        gradient = self.cyclic(np.array(start), beside * np.array(end))
        gradient[:, m:] = np.reshape(free, (m, -1))
        return gradient

    def third_along(self, unknowns: Array, direction: Array, mu: float = 1.0) -> Array:
        """Return the third derivative of the residual along a direction, shape (m,)."""
        m = self.m
        state, q = unknowns[:m].tolist(), direction.tolist()
        along = [*q[:m], *(mu * c for c in q[:m])]
        self.kernel_evaluations += 1
        return np.array(self.segments[0].third(state, state, along, self.values(unknowns)))

    def gaps(self, unknowns: Array) -> list[FlightGaps]:
        """Return the nearest touch of each guard of the first mode, in one row."""
        mode = self.model.MODES[0].name if self.model.MODES else ""
        positions = self.kernels.setup(*self.values(unknowns)).walls
        watched = {g.row(self.m // 2): g.name for g in self.model.WALLS if mode in g.modes}
        look = self._on_track if self.kernels.integrated(SECTION) else self._by_kernels
        found = look(watched, unknowns)
        touches = tuple(
            touch_of(0, 0.0, guard, position, found[guard.row(self.m // 2)])
            if mode in guard.modes
            else None
            for guard, position in zip(self.model.WALLS, positions, strict=True)
        )
        turns = (each[4] for each in found.values() if not math.isnan(each[4]))
        slowest = min(turns, key=abs, default=math.nan)
        return [FlightGaps(self.times_around(unknowns, 0)[1], touches, slowest)]

    def _on_track(self, watched: Mapping[Row, str], unknowns: Array) -> dict[Row, Excursion]:
        """The extrema of gap coordinates, of a flight that is integrated."""
        values, state = self.values(unknowns), unknowns[: self.m].tolist()
        length = self.times_around(unknowns, 0)[1]
        track = integrated_track(self.kernels, SECTION, state, values, length)
        found = {}
        for row in watched:
            curve = track.along(row)
            ends = (length, curve((), length, ())[1], 0.0, 0.0)
            found[row] = excursions(curve, (), (), *ends, curve.breaks(), 0.0, math.inf)
        return found

    def _by_kernels(self, watched: Mapping[Row, str], unknowns: Array) -> dict[Row, Excursion]:
        return {row: self._excursion(name, unknowns) for row, name in watched.items()}

    def _excursion(self, wall: str, unknowns: Array) -> Excursion:
        """The extrema of a guard's gap coordinate."""
        values, state = self.values(unknowns), unknowns[: self.m].tolist()
        length, kernel = self.times_around(unknowns, 0)[1], self.kernels.since(wall)
        along = evaluate_in(kernel, ARRAYS)
        breaks = chebyshev_zeros(lambda dt: along(*state, dt, *values)[2], length)

        def motion(head: Vector, dt: float, p: Vector) -> Moved:
            return kernel(*head, dt, *p)

        arriving = motion(state, length, values)[1]
        ends = (length, arriving, 0.0, 0.0)
        return excursions(motion, state, values, *ends, breaks, 0.0, math.inf)

    def scale(self, unknowns: Array, span: ArrayLike) -> Array:
        """Return natural sizes of the unknowns, by which arclength is measured."""
        sizes = np.abs(unknowns[: self.m])
        speed = max(self._largest_speed(unknowns), float(np.max(sizes)))
        return np.append(np.full(self.m, speed if speed > 0.0 else 1.0), span)

    def _largest_speed(self, unknowns: Array) -> float:
        values, state = self.values(unknowns), unknowns[: self.m].tolist()
        length = self.span(unknowns)
        track = self.kernels.since(self.model.WALLS[0].name)
        return max(abs(track(*state, part * length / 8.0, *values)[1]) for part in range(8))

    def difference(self, one: Array, other: Array) -> Array:
        """Return one - other as orbits."""
        return np.asarray(one - other)
