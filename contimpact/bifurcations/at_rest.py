"""An impact of a bifurcating orbit comes to rest, and leaves no trace.

With q_0 the unknowns of an impact that can move there without a trace, C(mu) q_0 = v d along
orbits, v the impact's velocity. So all orbits with v = 0 solve C(mu) q = 0, and the curve of those
with the multiplier mu crosses them. On it C(mu), with d in the place of the impact's time, is
singular: F = 0, v = 0 and a bordered determinant of that matrix make the crossing regular.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np

from ..arrays import Array
from ..continuation.branch import Location
from ..orbits.problem import Linearisation, OrbitProblem, rounding
from .extended_system import (
    EPSILON,
    NO_TRACE,
    ExtendedSystem,
    SingularCycle,
    SystemEvaluation,
    TouchingFlight,
    solve,
    trace_of,
    unit_vector,
)
from .kind import CurvePoint

# Functions without derivatives of their own.

STEP = float(np.cbrt(EPSILON))
"""Step of central differences, as a part of an unknown's natural size."""


def difference_gradient(value: Callable[[Array], float], x: Array, sizes: Array) -> Array:
    """Return a function's gradient by central differences, given natural sizes of its arguments."""
    row = np.zeros(len(x))
    for place, step in enumerate(STEP * sizes):
        moved = np.zeros(len(x))
        moved[place] = step
        row[place] = (value(x + moved) - value(x - moved)) / (2.0 * step)
    return row


def sizes_of(here: Linearisation) -> Array:
    """Return natural sizes of an orbit's unknowns, its free parameters by their own."""
    problem = here.problem
    free = np.maximum(np.abs(here.unknowns[problem.n :]), STEP)
    sizes = problem.scale(here.unknowns, free)
    sizes[: problem.n] /= np.sqrt(max(len(problem.word), 1))
    return sizes


# The orbit at rest.

NEARLY = 0.1
"""Trace of an impact up to which it is looked where it leaves none."""


class RestingCycle(ExtendedSystem):
    """An orbit with the multiplier mu of which one impact is at rest and leaves no trace."""

    def __init__(self, problem: OrbitProblem, mu: float, impact: int) -> None:
        super().__init__(problem)
        self.mu = mu
        self.own = slice(problem.m * impact, problem.m * (impact + 1))

    def start(self, here: Linearisation) -> Array:
        left, right = here.singular_vectors(self.regular(here))
        self.border = unit_vector(left[-1]), unit_vector(right[-1])
        return np.zeros(0)

    def moved(self, here: Linearisation) -> Array:
        """Return how the impact moves without a trace: q_0, by its time."""
        n, (rows, sizes) = self.problem.n, here.sizes
        around = np.vstack([here.cyclic(mu)[:, self.own] / rows[:, None] for mu in (0.0, 1.0)])
        right = np.linalg.svd(around * sizes[self.own])[2][-1] * sizes[self.own]
        found = np.zeros(n)
        found[self.own] = right / right[0]
        return found

    def regular(self, here: Linearisation) -> Array:
        """Return C(mu) with d in the place of the impact's time."""
        problem, time = self.problem, self.own.start
        along = np.append(self.moved(here), np.zeros(problem.free))
        matrix = np.array(here.cyclic(self.mu)[:, : problem.n])
        second = problem.second_along(here.unknowns, along, self.mu)
        matrix[:, time] = second @ self.changed(here)
        return matrix

    def changed(self, here: Linearisation) -> Array:
        """Return how orbits change with the impact's velocity, by it: the shortest way."""
        rows, sizes = here.sizes
        velocity = np.eye(len(sizes))[self.own.start + 1]
        equations = np.vstack([here.jacobian / rows[:, None], velocity]) * sizes
        asked = np.append(np.zeros(len(rows)), 1.0)
        return np.asarray(np.linalg.lstsq(equations, asked, rcond=None)[0] * sizes)

    def bordered(self, unknowns: Array) -> float:
        """Return what vanishes where the regular matrix is singular."""
        matrix, (left, right) = self.regular(self.problem.evaluate(unknowns)), self.border
        whole = np.block([[matrix, left[:, None]], [right[None], np.zeros((1, 1))]])
        return float(np.linalg.solve(whole, np.eye(len(whole))[-1])[-1])

    def assemble(self, here: Linearisation, own: Array) -> SystemEvaluation:
        x, velocity = here.unknowns, self.own.start + 1
        row = difference_gradient(self.bordered, x, sizes_of(here))
        residual = np.append(here.residual, [x[velocity], self.bordered(x)])
        return SystemEvaluation(residual, np.vstack([here.jacobian, np.eye(len(x))[velocity], row]))

    def rounding(self, here: Linearisation, own: Array) -> Array:
        value = abs(self.bordered(here.unknowns))
        return np.append(rounding(here).residual, [0.0, max(value, EPSILON * len(here.unknowns))])


class Curve(Protocol):
    """What is asked of the problem of a curve."""

    @property
    def system(self) -> ExtendedSystem: ...
    def packed(self, orbit: Array, own: Array) -> Array: ...


def solve_at_rest(curve: Curve, at: CurvePoint, impact: int) -> Location | None:
    """Solve for the point next to one of a curve of FB or PD at which an impact is at rest and
    leaves no trace; None if there is none."""
    system, here = curve.system, at.orbit
    problem = here.problem
    moved = np.arange(problem.m * impact, problem.m * (impact + 1))
    if not isinstance(system, SingularCycle) or trace_of(here, moved) > NEARLY:
        return None
    resting = RestingCycle(problem, system.mu, impact)
    try:
        found = solve(resting, here)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):  # the guess is no orbit
        return None
    if found is None or trace_of(found.here, moved) > NO_TRACE:
        return None
    own = unit_vector(resting.moved(found.here))
    unknowns = curve.packed(found.unknowns, own * (np.sign(own @ at.own) or 1.0))
    return Location(unknowns, found.residual, found.error)


def acceleration_at_touch(orbit: Linearisation, flight: int, wall: str, since: float) -> float:
    """The second derivative of the gap to a wall, so long after a flight has begun."""
    problem = orbit.problem
    left, row = problem.leaving(orbit.unknowns, flight)
    gap = problem.kernels.gap_after(left, wall)(*row, since, *problem.values(orbit.unknowns))
    return float(gap[2])


class TouchAtImpact(ExtendedSystem):
    """An orbit of which one impact is at rest, while the flight that begins or ends with it has no
    acceleration there: where a touch of the flight reaches the impact, for its gap has a double
    zero at the touch and one at the impact."""

    def __init__(self, problem: OrbitProblem, flight: int, wall: str, after: bool) -> None:
        super().__init__(problem)
        self.flight, self.wall, self.after = flight, wall, after
        self.impact = (flight + after) % len(problem.word)

    def start(self, here: Linearisation) -> Array:
        return np.zeros(0)

    def acceleration(self, unknowns: Array) -> float:
        """Return the second derivative of the gap at the impact, on the flight."""
        begin, end = self.problem.times_around(unknowns, self.flight)
        here, since = self.problem.evaluate(unknowns), end - begin if self.after else 0.0
        return acceleration_at_touch(here, self.flight, self.wall, since)

    def assemble(self, here: Linearisation, own: Array) -> SystemEvaluation:
        x, velocity = here.unknowns, self.problem.m * self.impact + 1
        row = difference_gradient(self.acceleration, x, sizes_of(here))
        residual = np.append(here.residual, [x[velocity], self.acceleration(x)])
        return SystemEvaluation(residual, np.vstack([here.jacobian, np.eye(len(x))[velocity], row]))

    def rounding(self, here: Linearisation, own: Array) -> Array:
        x, sizes = here.unknowns, sizes_of(here)
        terms = np.abs(difference_gradient(self.acceleration, x, sizes)) @ np.abs(x)
        return np.append(rounding(here).residual, [0.0, EPSILON * terms])


def solve_touch_at_impact(curve: Curve, at: CurvePoint, after: bool) -> Location | None:
    """Solve for the point next to one of a curve of G at which the touch reaches the impact before
    or `after` it, where the equations of the curve are singular; None if there is none."""
    system, here = curve.system, at.orbit
    if not isinstance(system, TouchingFlight):
        return None
    touching = TouchAtImpact(here.problem, system.flight, system.wall, after)
    try:
        found = solve(touching, here)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):  # the guess is no orbit
        return None
    if found is None:
        return None
    own = here.problem.impacts(found.unknowns)[touching.impact, system.free]
    own[0] = here.problem.times_around(found.unknowns, system.flight)[after]
    return Location(curve.packed(found.unknowns, own), found.residual, found.error)


def points_at_rest(curve: Curve, at: CurvePoint) -> Iterator[Location]:
    """Yield such points for each of the impacts, the slowest first."""
    problem = at.orbit.problem
    speeds = np.abs(problem.impacts(at.orbit.unknowns)[: len(problem.word), 1])
    found = (solve_at_rest(curve, at, i) for i in np.argsort(speeds).tolist())
    return (location for location in found if location is not None)
