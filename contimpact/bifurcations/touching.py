"""The equations of an orbit that touches a guard inside a flight, or where one begins."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..continuation.branch import Details
from ..orbits.linearisation import Linearisation
from ..orbits.problem import Array, OrbitProblem
from ..orbits.rounding import rounding
from ..segments.bounded import bounds_of
from ..segments.layout import SECTION
from ..segments.segment import Segment
from .extended_system import Assembled, ExtendedSystem


class Touching(ExtendedSystem):
    """A flight reaches a wall with zero velocity."""

    def __init__(self, problem: OrbitProblem, flight: int, wall: str, time: float) -> None:
        super().__init__(problem)
        self.flight, self.wall, self.time = flight, wall, time
        m = problem.m
        self.own_impact, self.free = slice(m * flight, m * flight + m), [0, *range(2, m)]
        left = problem.word.walls[flight : flight + 1] or SECTION
        self.segment = problem.kernels.segment(left, wall)

    def touch(self, own: Array) -> Array:
        """Return the touch as an impact: its time and section coordinates."""
        touch = np.zeros(self.problem.m)
        touch[self.free] = own
        return touch

    def start(self, here: Linearisation) -> Array:
        own = np.zeros(len(self.free))
        own[0] = self.time
        if len(own) > 1:  # the other coordinates, from the (near) linear flight equations
            out, _, end, _ = self.arrival(here, own)
            own[1:] -= np.linalg.lstsq(end[:, self.free[1:]], out, rcond=None)[0]
        return own

    def assemble(self, here: Linearisation, own: Array) -> Assembled:
        n, m = self.problem.n, self.problem.m
        orbit = len(here.unknowns)
        arrival, start, end, by_parameter = self.arrival(here, own)
        self.problem.kernel_evaluations += 1
        jacobian = np.zeros((n + m, orbit + m - 1))
        jacobian[:n, :orbit] = here.jacobian
        jacobian[n:, self.own_impact] = start
        jacobian[n:, n:orbit] = by_parameter
        jacobian[n:, orbit:] = end[:, self.free]
        return Assembled(np.concatenate([here.residual, arrival]), jacobian)

    def rounding(self, here: Linearisation, own: Array) -> Array:
        arrival, _, _, _ = bounds_of(self.segment, *self._arguments(here, own))[1]
        return np.concatenate([rounding(here).residual, arrival])

    def scale(self, own: Array, sizes: Array) -> Array:
        others = super().scale(own, sizes)
        others[0] = sizes[0]
        return others

    def details(self, own: Array) -> Details:
        return {"touch_time": float(own[0])}

    def arrival(self, here: Linearisation, own: Array) -> tuple[Array, Array, Array, Array]:
        """Return residual and derivatives of the flight to the touch."""
        m = self.problem.m
        rows, leaving, *ends = self.segment.blocks(*self._arguments(here, own))
        start, end, free = map(np.array, (self.problem.leaves(leaving), *ends))
        return np.array(rows), start.reshape(m, m), end.reshape(m, m), free.reshape(m, -1)

    def _arguments(self, here: Linearisation, own: Array) -> tuple[list[float], ...]:
        _, left = self.problem.leaving(here.unknowns, self.flight)
        return left, self.touch(own).tolist(), self.problem.values(here.unknowns)


class Beginning(ExtendedSystem):
    """Sliding begins on one of its limits: a flight to it takes no time.

    Its own unknowns are the section coordinates there.

    Parameters
    ----------
    problem : OrbitProblem
    impact : int
    sliding, limit : str
        See `contimpact.segments.limits`.
    """

    def __init__(self, problem: OrbitProblem, impact: int, sliding: str, limit: str) -> None:
        super().__init__(problem)
        self.impact = slice(problem.m * impact, problem.m * impact + problem.m)
        self.segment = problem.kernels.segment(sliding, limit)

    def start(self, here: Linearisation) -> Array:
        left, _, values = self._arguments(here, np.zeros(self.problem.m - 1))
        return np.array(arrived(self.segment, left, values)[1:])

    def assemble(self, here: Linearisation, own: Array) -> Assembled:
        n, m, orbit = self.problem.n, self.problem.m, len(here.unknowns)
        rows, start, end, free = map(np.array, self.segment.blocks(*self._arguments(here, own)))
        start, end = start.reshape(m, m), end.reshape(m, m)
        start[:, 0] += end[:, 0]  # both times are one
        self.problem.kernel_evaluations += 1
        jacobian = np.zeros((n + m, orbit + m - 1))
        jacobian[:n, :orbit] = here.jacobian
        jacobian[n:, self.impact] = start
        jacobian[n:, n:orbit] = free.reshape(m, -1)
        jacobian[n:, orbit:] = end[:, 1:]
        return Assembled(np.concatenate([here.residual, rows]), jacobian)

    def rounding(self, here: Linearisation, own: Array) -> Array:
        arrival, _, _, _ = bounds_of(self.segment, *self._arguments(here, own))[1]
        return np.concatenate([rounding(here).residual, arrival])

    def scale(self, own: Array, sizes: Array) -> Array:
        return np.asarray(sizes[1 : self.problem.m])

    def _arguments(self, here: Linearisation, own: Array) -> tuple[list[float], ...]:
        left = here.unknowns[self.impact].tolist()
        return left, [left[0], *own.tolist()], self.problem.values(here.unknowns)


def arrived(segment: Segment, left: Sequence[float], values: Sequence[float]) -> list[float]:
    """Return the unknowns of an impact at once after another, from those of that one."""
    rows = segment.blocks(left, [left[0], *[0.0] * (len(left) - 1)], values)[0]
    return [left[0], *(float(row) for row in rows[1:])]
