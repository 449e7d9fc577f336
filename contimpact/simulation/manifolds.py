r"""Stable and unstable manifolds of unstable orbits, of systems of one coordinate.

With N impacts in its word, an impact of the orbit is a fixed point of Q, the impact map taken N
times. Beside it the manifold of a multiplier :math:`\mu` is

.. math:: z(\sigma) = z_0 + \sigma e + \sigma^2 q, \qquad Q(z(\sigma)) = z(\mu\sigma) + O(\sigma^3),

with e and q from exact derivatives of the flights. The rest consists of images of a short arc of
it: under the map for the unstable manifold, and under its inverse, flights backwards in time, for
the stable one. They stretch the arc by the growth, :math:`|\mu|` or :math:`1/|\mu|`, with every
lap, and what the expansion leaves out shrinks across the curve.

Every point is computed from its :math:`\sigma` on the arc, so that points are added wherever the
curve asks for them and no error accumulates. The map has cuts: where flights begin to graze, the
image of a curve ends, and goes on elsewhere. The curve is in pieces there, whose ends are one
rounding error of :math:`\sigma` apart.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arrays import Array
from ..display import NotebookResult, Summary
from ..errors import InputError, count_text, explain_arguments
from ..orbits.orbit import Orbit
from ..results.branch import Entry
from ..results.diagram import to_orbit
from ..segments.flight import chebyshev_zeros, first_arrival, rounding_along, turns_along
from ..segments.kernel import Family
from ..segments.segment import ARRAYS, evaluate_in
from .one_coordinate import OneCoordinate
from .run import wall_on, wrap_time
from .simulator import Simulator

SPACING = 0.01
"""Bound of the distance between consecutive points, in parts of the length, by default."""
REMAINDER = 1e-11
"""What the expansion may leave out at the end of the arc, by the orbit's size."""
LARGEST, SMALLEST = 1e-2, 1e-8
"""Where the arc may end, likewise."""
NODES = 8
"""Stretches into which the arc is divided at first."""
TURN = 0.3
"""Largest angle between consecutive chords, in radians."""
SHORT = 0.01
"""Part of the spacing below which chords may turn by more."""
MOST_POINTS = 100_000
"""Points tried on one side of an impact at most."""
MOST_IMPACTS = 2000
"""Impacts from the arc to a point at most."""
CONVERGED = 1e-9
"""Part of the length by which a lap makes it longer, below which the curve has come to an end."""
HALF_THE_DIGITS = 1.5e-8
"""Relative width within which values beside a minimum do not differ."""
SLOWEST = 1e-13
"""Impacts with less, in parts of the orbit's fastest, are not followed: there the map ends."""

Impact = tuple[int, int, float, float]
"""Wall, whole periods passed, phase, and velocity before it."""


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of a manifold without a cut, among the impacts on one wall."""

    wall: str
    impact: int
    """Number of the orbit's impact from which it comes."""
    side: int
    """1 or -1: the side of the orbit to which it leaves."""
    laps: Array
    """How often the map has carried the point from the arc around the orbit, shape (n,)."""
    parameters: Array
    """Where on the arc the point is from, sigma, shape (n,)."""
    times: Array
    """Shape (n,); continuous, not reduced to one period."""
    velocities: Array
    """Before impact, shape (n,)."""

    def __len__(self) -> int:
        return len(self.times)

    @property
    def length(self) -> float:
        """Arclength, by time and velocity."""
        return float(np.sum(np.hypot(np.diff(self.times), np.diff(self.velocities))))


@dataclass(frozen=True, eq=False)
class Manifold(NotebookResult):
    """A stable or an unstable manifold of an orbit, in pieces."""

    orbit: Orbit
    stable: bool
    multiplier: float
    """The multiplier it belongs to."""
    spacing: float
    """Bound of the distance between consecutive points."""
    pieces: Sequence[Piece]
    """By impact and side, then along the curve."""
    shortfalls: Sequence[str]
    """Where it ends before the length asked for, and why."""
    grower: Grower = field(repr=False)
    """Computes points between those of the pieces."""

    def distance(self, wall: str, time: float, velocity: float) -> float:
        """Return the distance of an impact from the curve; infinite without a piece on the wall.

        Beside the points nearest to the impact the curve is computed anew.
        """
        self.require_wall(wall)
        found: list[tuple[float, int, Piece]] = []
        for piece in (p for p in self.pieces if p.wall == wall):
            apart = np.array([math.remainder(time - t, self.grower.period) for t in piece.times])
            far = np.hypot(apart, velocity - piece.velocities)
            found += [(float(far[k]), k, piece) for k in (int(np.argmin(far)),)]
        best = math.inf
        for far_off, k, piece in sorted(found, key=lambda f: f[0]):
            if far_off - self.spacing > best:
                break
            between = [i for i in (k, k + 1) if 0 < i < len(piece)]
            nearest = (self._nearest(piece, i, time, velocity) for i in between)
            best = min(best, far_off, *nearest)
        return best

    def _nearest(self, piece: Piece, k: int, time: float, velocity: float) -> float:
        """The distance from the curve between two consecutive points of a piece.

        A minimum is located to half the digits; on the short chords beside it, to all.
        """
        from scipy.optimize import minimize_scalar

        grower, lap = self.grower, int(piece.laps[k])

        def offset(sigma: float) -> Array:
            _, t, v = grower.point(piece.impact, lap, sigma)
            return np.array([math.remainder(t - time, grower.period), v - velocity])

        def far(sigma: float) -> float:
            return float(np.hypot(*offset(sigma)))

        begin = piece.parameters[k - 1] / grower.growth ** (lap - int(piece.laps[k - 1]))
        low, high = sorted((float(begin), float(piece.parameters[k])))
        width = high - low
        exact = {"xatol": HALF_THE_DIGITS * width}
        least = minimize_scalar(
            lambda u: far(low + u), bounds=(0.0, width), method="bounded", options=exact
        )
        best = low + float(least.x)
        here, found = offset(best), [far(best)]
        for end in (low, high):
            step = math.copysign(4.0 * HALF_THE_DIGITS * width, end - best)
            beside = float(np.clip(best + step, low, high))
            if beside == best:
                beside = float(np.nextafter(best, end))
            chord = offset(beside) - here
            along = np.clip(-(here @ chord) / max(float(chord @ chord), 1e-300), 0.0, 1.0)
            found.append(float(np.hypot(*(here + along * chord))))
        return min(found)

    def require_wall(self, wall: str) -> None:
        """Raise `InputError` for a wall that the system does not have."""
        letters = self.orbit.model.letters
        if wall not in letters:
            raise InputError("wall", f"no wall {wall!r}", f"the walls are {letters}")

    def summary(self) -> Summary:
        """Return its pieces in short."""
        rows = [(p.wall, p.impact, f"{p.side:+d}", len(p), p.length) for p in self.pieces]
        columns = ("wall", "impact", "side", "points", "length")
        return Summary(repr(self)[1:-1], columns, rows, self.shortfalls)

    def __repr__(self) -> str:
        kind, points = "stable" if self.stable else "unstable", sum(map(len, self.pieces))
        place = f"{self.orbit.parameter} = {self.orbit.value:.9g}"
        head = f"{kind} manifold of {self.orbit.notation} at {place}"
        return f"<{head}: {count_text(points, 'point')}, {count_text(len(self.pieces), 'piece')}>"


@explain_arguments
def grow_manifold(
    orbit: Orbit | Entry, *, stable: bool = False, length: float = 5.0, spacing: float | None = None
) -> Manifold:
    """Grow the stable or the unstable manifold of an orbit.

    Parameters
    ----------
    orbit : Orbit or Entry
        Physical, with one multiplier outside the unit circle and one inside.
    stable : bool
        Whether the stable manifold is grown; by default the unstable one.
    length : float
        Arclength, by time and velocity before impact, to which it is grown from each impact of the
        orbit to each side.
    spacing : float, optional
        Bound of the distance between consecutive points; by default a hundredth of the length.

    Returns
    -------
    Manifold
        In pieces where the map has cuts. Stretches between two cuts may be missed if all of what
        they come from lies between two points. Where it ends before the length asked for is listed
        in `shortfalls`.

    Raises
    ------
    InputError
        For a system with several coordinates or without forcing, an orbit that is not physical or
        not a saddle, a length or spacing that is not positive, or a stable manifold where impacts
        or flights cannot be inverted.
    """
    for name, value in (("length", length), ("spacing", 1.0 if spacing is None else spacing)):
        if not (isinstance(value, int | float) and 0.0 < value < math.inf):
            raise InputError(name, f"found {value!r}", "give a number > 0")
    spacing = SPACING * length if spacing is None else spacing
    grower = Grower(to_orbit(orbit), stable)
    orbit = grower.orbit
    pieces, shortfalls = list[Piece](), list[str]()
    for impact in range(len(orbit.word)):
        for side in (1, -1):
            for found in grower.grow(impact, side, length, spacing):
                if isinstance(found, Piece):
                    pieces.append(found)
                else:
                    shortfalls.append(f"impact {impact + 1}, side {side:+d}: {found}")
    return Manifold(orbit, stable, grower.multiplier, spacing, pieces, shortfalls, grower)


class Grower:
    """The impact map, forwards or backwards, from an arc beside an orbit to its `end`.

    A lap stretches the arc by `growth`. It goes twice around the orbit where the multiplier is
    negative, so that it leads back to the same side.
    """

    def __init__(self, orbit: Orbit, stable: bool) -> None:
        self.orbit, self.stable = orbit, stable
        simulator = Simulator(orbit.model, orbit.problem.kernels)
        if orbit.model.autonomous or not isinstance(simulator.machine, OneCoordinate):
            accepted = "manifolds are grown of one forced coordinate between rigid walls"
            raise InputError("orbit", f"one of {orbit.model.SYSTEM}", accepted)
        large, small = orbit.multipliers[:2]
        if not (orbit.physical and abs(large) > 1.0 > abs(small) > 0.0):
            accepted = (
                "give a physical orbit with one multiplier outside the unit circle, one inside"
            )
            raise InputError("orbit", repr(orbit).partition("\n")[0], accepted)
        self.machine, self.period = simulator.machine, simulator.period
        self.multiplier = float((small if stable else large).real)
        self._first = simulator.letters.index(orbit.word.walls[0])
        self._letters = simulator.letters
        self._slowest = SLOWEST * float(np.max(np.abs(orbit.velocities)))
        if stable:
            self._require_inverse()
        times = 1 if self.multiplier > 0.0 else 2
        self._lap, self._turns = times * len(orbit.word), times * orbit.word.period
        self.growth = abs(self.multiplier) ** (-times if stable else times)
        self._along, self._bend = self._expand()
        self._paths: dict[float, list[Impact | None]] = {}
        self.end = self._end()

    # Beside the orbit.

    def _expand(self) -> tuple[Array, Array]:
        """The expansion's e and q at the first impact, carried around the orbit and closed."""
        problem, z = self.orbit.problem, self.orbit.unknowns
        p, rows = problem.values(z), problem.impacts(z).tolist()
        ends = [*rows[1:], [rows[0][0] + self.orbit.period, rows[0][1]]]
        flights = list(zip(problem.segments, rows, ends, strict=True))
        steps: list[tuple[Array, Array]] = []
        carried: Array = np.eye(2)
        for segment, start, end in flights:
            leaving, arriving = (np.reshape(b, (2, 2)) for b in segment.blocks(start, end, p)[1:3])
            steps.append((-np.linalg.solve(arriving, leaving), arriving))
            carried = steps[-1][0] @ carried
        factors, vectors = np.linalg.eig(carried)
        own = np.real(vectors[:, int(np.argmin(np.abs(factors - self.multiplier)))])
        along, bend = own, np.zeros(2)
        for (segment, start, end), (step, arriving) in zip(flights, steps, strict=True):
            after = step @ along
            rates = [*along, *after, *[0.0] * problem.free]
            blocks = [np.reshape(b, (2, 2)) for b in segment.second(start, end, rates, p)[1:3]]
            second = np.linalg.solve(arriving, blocks[0] @ along + blocks[1] @ after)
            along, bend = after, step @ bend - 0.5 * second
        return own, np.linalg.solve(self.multiplier**2 * np.eye(2) - carried, bend)

    def _local(self, sigma: float) -> Impact:
        t, v = sigma * (self._along + sigma * self._bend)
        phase, turns = wrap_time(float(self.orbit.times[0] + t), self.period)
        return self._first, turns, phase, float(self.orbit.velocities[0] + v)

    def _end(self) -> float:
        """The farthest end of the arc at which the expansion is exact enough."""
        size = max(self.period, float(np.max(np.abs(self.orbit.velocities))))
        end = LARGEST * size
        while end > SMALLEST * size and not self._left_out(end) <= REMAINDER * size:
            end *= 0.5
        self._paths.clear()
        return end

    def _left_out(self, end: float) -> float:
        """How far the images of points beside the orbit are from where the expansion has them."""
        apart = []
        for sigma in (end, -end):
            wall, turns, phase, velocity = self._local(sigma)
            here = self.point(0, 1, sigma / self.growth)
            time = turns * self.period + phase
            far = math.hypot(math.remainder(here[1] - time, self.period), here[2] - velocity)
            apart.append(far if here[0] == wall else math.inf)
        return max(apart)

    # The map and its inverse.

    def _forward(self, at: Impact) -> Impact | None:
        """The impact that follows."""
        wall, turns, phase, velocity = at
        reached, dt, speed = self.machine.fly(wall, phase, velocity)
        if reached < 0 or abs(speed) <= self._slowest:
            return None
        phase, passed = wrap_time(phase + dt, self.period)
        return reached, turns + passed, phase, speed

    def _backward(self, at: Impact) -> Impact | None:
        """The impact before: where the flight that arrives, backwards, first meets a wall."""
        wall, turns, phase, velocity = at
        machine, body = self.machine, self.machine.body
        kernel, values = machine.motions[wall], machine.values
        left = -velocity / machine.restitution[wall]

        def reversed_motion(head: Any, dt: float, _: Any) -> Any:
            x, speed, acceleration = kernel(phase, left, -dt, *values)
            return x, -speed, acceleration

        if machine.zeros is None:
            zeros, clock = self._turning(wall, phase, left), (0.0, 0.0, 1)
        else:
            zeros = sorted(-z % self.period for z in machine.zeros)
            clock = (-phase % self.period, self.period, body.longest[0])
        rising, guards = body.leaving[wall] < 0, (body.low[wall], body.high[wall])
        side, dt, speed, _ = first_arrival(
            reversed_motion, (), values, zeros, *clock, 0.0, rising, *guards
        )
        before = wall_on(body, wall, side)
        if before < 0 or abs(speed) <= self._slowest:
            return None
        phase, passed = wrap_time(phase - dt, self.period)
        return before, turns + passed, phase, speed / machine.restitution[before]

    def _turning(self, wall: int, phase: float, left: float) -> list[float]:
        """How long before an impact the acceleration vanishes, and the end of where it is looked
        at: a few periods."""
        kernel, values = self.machine.motions[wall], self.machine.values
        vectorised, length = evaluate_in(kernel, ARRAYS), 4.0 * self.period
        bound = rounding_along(kernel, (phase, left), values)
        found = chebyshev_zeros(
            lambda dt: vectorised(phase, left, -dt, *values)[2],
            length,
            rounding=lambda dt: bound(-dt),
            turns=turns_along(kernel, (phase, left), values, direction=-1.0),
        )
        return [*found, length]

    def _require_inverse(self) -> None:
        """Raise `InputError` where flights or impacts cannot be inverted."""
        machine = self.machine
        for kernel, r in zip(machine.motions, machine.restitution, strict=True):
            closed = kernel.family is not Family.INTEGRATED
            left = [kernel(0.0, v, 0.0, *machine.values)[1] for v in (1.0, 2.0)] if closed else []
            if not (r > 0.0 and left and np.allclose(left, [-r, -2.0 * r], rtol=1e-12)):
                found = f"flights or impacts of {self.orbit.model.SYSTEM} that cannot be inverted"
                accepted = "it needs flights in closed form and constant restitutions above 0"
                raise InputError("stable", found, accepted)

    # The curve.

    def point(self, impact: int, lap: int, sigma: float) -> tuple[int, float, float]:
        """Return wall, time and velocity of the image of a point of the arc, -1 for no wall.

        It is what the map makes of it after so many laps and on to one of the orbit's impacts; the
        time is that without the laps.
        """
        count = lap * self._lap + (-impact % len(self.orbit.word) if self.stable else impact)
        path = self._paths.setdefault(sigma, [self._local(sigma)])
        step = self._backward if self.stable else self._forward
        while len(path) <= count and path[-1] is not None:
            path.append(step(path[-1]))
        found = path[min(count, len(path) - 1)]
        if found is None:
            return -1, math.nan, math.nan
        wall, turns, phase, velocity = found
        turns += lap * self._turns * (1 if self.stable else -1)
        return wall, turns * self.period + phase, velocity

    def grow(self, impact: int, side: int, length: float, spacing: float) -> Iterator[Piece | str]:
        """Yield the pieces from one of the orbit's impacts, in order, and why they end too soon."""
        nodes = [0.0, *(side * self.end * self.growth ** (k / NODES) for k in range(-NODES, 1))]
        begin, rows = abs(nodes[1]), list[Row]()
        grown, tried = 0.0, 0
        for lap in range(MOST_IMPACTS // self._lap):
            before = grown
            kept, waiting = nodes[:1], nodes[:0:-1]
            here = self.point(impact, lap, nodes[0])
            if lap == 0:
                rows.append((lap, nodes[0], *here))
            while waiting:
                there, between = (
                    self.point(impact, lap, waiting[-1]),
                    0.5 * (kept[-1] + waiting[-1]),
                )
                fits, tried = _fits(rows, here, there, spacing), tried + 1
                if not fits and between not in (kept[-1], waiting[-1]):
                    waiting.append(between)
                    continue
                kept.append(waiting.pop())
                if not fits:
                    yield from self._pieces(impact, side, rows)
                    rows = []
                if there[0] >= 0:
                    grown += math.dist(rows[-1][3:], there[1:]) if rows else 0.0
                    rows.append((lap, kept[-1], *there))
                here = there
                if grown >= length or tried >= MOST_POINTS:
                    yield from self._pieces(impact, side, rows)
                    if grown < length:
                        yield f"{tried} points were tried; its length is {grown:.6g}"
                    return
            nodes = [sigma for sigma in kept if abs(sigma) >= begin]
            if grown - before <= CONVERGED * grown:
                break
        yield from self._pieces(impact, side, rows)
        yield f"it ends after {lap} laps; its length is {grown:.6g}"

    def _pieces(self, impact: int, side: int, rows: Sequence[Row]) -> Iterator[Piece]:
        """The piece of these points, unless there is only one."""
        if len(rows) > 1:
            laps, sigmas, walls, times, velocities = (np.array(c) for c in zip(*rows, strict=True))
            letter = self._letters[int(walls[0])]
            yield Piece(letter, impact, side, laps, sigmas, times, velocities)


Row = tuple[int, float, int, float, float]
"""Lap, sigma, wall, time, velocity."""


def _fits(
    rows: Sequence[Row],
    here: tuple[int, float, float],
    there: tuple[int, float, float],
    spacing: float,
) -> bool:
    """Whether a point of the curve follows another one closely, and without a turn; or neither is
    there."""
    if here[0] != there[0] or here[0] < 0:
        return here[0] == there[0]
    chord = np.subtract(there[1:], here[1:])
    size = float(np.hypot(*chord))
    if size > spacing or size <= SHORT * spacing or len(rows) < 2:
        return size <= spacing
    before = np.subtract(rows[-1][3:], rows[-2][3:])
    across = float(before[0] * chord[1] - before[1] * chord[0])
    return abs(math.atan2(across, float(before @ chord))) <= TURN
