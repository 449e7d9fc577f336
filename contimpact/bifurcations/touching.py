"""The equations of an orbit that touches a guard inside a flight, or where a flight begins."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from ..continuation.branch import Details
from ..orbits.problem import Array, Linearisation, OrbitProblem, rounding
from ..segments.bounded import bounds_of
from ..segments.flight import Touch
from ..segments.layout import SECTION
from ..segments.segment import Segment
from .extended_system import Assembled, ExtendedSystem

TOUCHING = 1e-9
"""A gap below this at an event is a touch at the same parameter value."""


class Arrival(ExtendedSystem):
    """A flight leaves with one of the orbit's and arrives at a guard; of the unknowns there those
    numbered in `free` are the system's own."""

    def __init__(
        self, problem: OrbitProblem, flight: int, segment: Segment, free: Sequence[int]
    ) -> None:
        super().__init__(problem)
        self.flight, self.segment, self.free = flight, segment, list(free)
        self.left = slice(problem.m * flight, problem.m * flight + problem.m)

    @abstractmethod
    def ends(self, here: Linearisation, own: Array) -> tuple[list[float], list[float]]:
        """Return the unknowns at both ends of the flight."""

    def assemble(self, here: Linearisation, own: Array) -> Assembled:
        n, m = self.problem.n, self.problem.m
        orbit = len(here.unknowns)
        arrival, start, end, by_parameter = self.arrival(here, own)
        self.problem.kernel_evaluations += 1
        jacobian = np.zeros((n + m, orbit + m - 1))
        jacobian[:n, :orbit] = here.jacobian
        jacobian[n:, self.left] = start
        jacobian[n:, n:orbit] = by_parameter
        jacobian[n:, orbit:] = end[:, self.free]
        return Assembled(np.concatenate([here.residual, arrival]), jacobian)

    def rounding(self, here: Linearisation, own: Array) -> Array:
        values = self.problem.values(here.unknowns)
        arrival, _, _, _ = bounds_of(self.segment, *self.ends(here, own), values)[1]
        return np.concatenate([rounding(here).residual, arrival])

    def arrival(self, here: Linearisation, own: Array) -> tuple[Array, Array, Array, Array]:
        """Return residual and derivatives of the flight."""
        m, values = self.problem.m, self.problem.values(here.unknowns)
        rows, leaving, *ends = self.segment.blocks(*self.ends(here, own), values)
        start, end, free = map(np.array, (self.problem.leaves(leaving), *ends))
        return np.array(rows), start.reshape(m, m), end.reshape(m, m), free.reshape(m, -1)


class Touching(Arrival):
    """A flight reaches a wall with zero velocity."""

    def __init__(self, problem: OrbitProblem, flight: int, wall: str, time: float) -> None:
        left = problem.word.walls[flight : flight + 1] or SECTION
        segment = problem.kernels.segment(left, wall)
        super().__init__(problem, flight, segment, [0, *range(2, problem.m)])
        self.wall, self.time = wall, time

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

    def scale(self, own: Array, sizes: Array) -> Array:
        others = super().scale(own, sizes)
        others[0] = sizes[0]
        return others

    def details(self, own: Array) -> Details:
        return {"touch_time": float(own[0])}

    def ends(self, here: Linearisation, own: Array) -> tuple[list[float], list[float]]:
        _, left = self.problem.leaving(here.unknowns, self.flight)
        return left, self.touch(own).tolist()


class Beginning(Arrival):
    """Sliding begins on one of its limits: a flight to it takes no time.

    Its own unknowns are the section coordinates there.

    Parameters
    ----------
    problem : OrbitProblem
    impact : int
    sliding, limit : str
        See `contimpact.segments.touches`.
    """

    def __init__(self, problem: OrbitProblem, impact: int, sliding: str, limit: str) -> None:
        segment = problem.kernels.segment(sliding, limit)
        super().__init__(problem, impact, segment, range(1, problem.m))

    def start(self, here: Linearisation) -> Array:
        left = here.unknowns[self.left].tolist()
        return np.array(arrived(self.segment, left, self.problem.values(here.unknowns))[1:])

    def arrival(self, here: Linearisation, own: Array) -> tuple[Array, Array, Array, Array]:
        rows, start, end, free = super().arrival(here, own)
        start[:, 0] += end[:, 0]  # both times are one
        return rows, start, end, free

    def scale(self, own: Array, sizes: Array) -> Array:
        return np.asarray(sizes[1 : self.problem.m])

    def ends(self, here: Linearisation, own: Array) -> tuple[list[float], list[float]]:
        left = here.unknowns[self.left].tolist()
        return left, [left[0], *own.tolist()]


class Tangent(ExtendedSystem):
    """A flight begins on the surface of a guard of its mode, without a rate."""

    def __init__(self, problem: OrbitProblem, impact: int, wall: str) -> None:
        super().__init__(problem)
        self.segment = problem.kernels.segment(problem.word.walls[impact], wall)
        self.left = slice(problem.m * impact, problem.m * impact + problem.m)

    def start(self, here: Linearisation) -> Array:
        return np.zeros(0)

    def assemble(self, here: Linearisation, own: Array) -> Assembled:
        m, n = self.problem.m, self.problem.n
        values = self.problem.values(here.unknowns)
        rows, leaving, arriving, free = self.segment.blocks(*self._ends(here), values)
        self.problem.kernel_evaluations += 1
        gradient = np.zeros(len(here.unknowns))
        gradient[self.left] = np.reshape(leaving, (m, m))[1]
        gradient[self.left.start] += np.reshape(arriving, (m, m))[1, 0]  # both times are one
        gradient[n:] = np.reshape(free, (m, -1))[1]
        return Assembled(np.append(here.residual, rows[1]), np.vstack([here.jacobian, gradient]))

    def rounding(self, here: Linearisation, own: Array) -> Array:
        values = self.problem.values(here.unknowns)
        bounds = bounds_of(self.segment, *self._ends(here), values)[1][0]
        return np.append(rounding(here).residual, bounds[1])

    def _ends(self, here: Linearisation) -> tuple[list[float], list[float]]:
        """The unknowns at both ends of a flight of no duration, whose second row is the rate."""
        left = here.unknowns[self.left].tolist()
        return left, [left[0], *[0.0] * (self.problem.m - 1)]


def arrived(
    segment: Segment, left: Sequence[float], values: Sequence[float], time: float | None = None
) -> list[float]:
    """Return the unknowns of an impact at some time after another, at once unless it is given,
    from those of that one."""
    time = left[0] if time is None else time
    rows = segment.blocks(left, [time, *[0.0] * (len(left) - 1)], values)[0]
    return [time, *(float(row) for row in rows[1:])]


def touching(here: Linearisation) -> list[Touch]:
    """Return the touches at which an orbit is not told from one that grazes."""
    touches = (t for flight in here.gaps for t in flight.touches)
    return [t for t in touches if t is not None and abs(t.gap) < TOUCHING]


def forgiven(here: Linearisation) -> set[tuple[int, str]]:
    """Return the touches that are not held against the orbit of an event: rounding decides on
    which side of the guard they are."""
    begun = (t for flight in here.gaps for t in flight.beyond if abs(t.gap) < TOUCHING)
    return {(t.flight, t.wall) for t in (*touching(here), *begun)}
