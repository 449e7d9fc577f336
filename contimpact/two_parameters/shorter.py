"""Where the orbits of a curve become shorter ones, run several times: there the curve ends.

Beyond, the same orbits come again, whole periods later. So ends the fold of a doubled orbit at a
GPD, where the doubling changes its direction, and the grazing of one at a PD-G.
"""

from __future__ import annotations

import numpy as np

from ..bifurcations.codimension_two import twice
from ..bifurcations.extended_system import solve
from ..bifurcations.registry import kind_of
from ..continuation.branch import Event, Located, Point, TestFunction
from ..continuation.crossing_branches import Meeting
from ..continuation.ends import End, EndKind
from ..continuation.problem import Problem
from ..orbits.problem import Array, Linearisation, OrbitProblem
from ..orbits.quiet import problem_of
from ..orbits.search import repeats, shortest
from .points import double_of
from .problem import CurvePoint

SAME_ORBIT = 1e-6
"""How near an orbit is to a shorter one where it is one."""

NEAR = 0.1
"""How far from a point the end of its curve is looked for, in the curve's metric."""

ROUNDING = 1e-14


class Repeats(TestFunction[CurvePoint]):
    """The orbit becomes a shorter one: impacts that are to be the same have the same velocity."""

    kind = "shorter"
    noise = rounding = 1e-9  # on a curve of shorter orbits it is zero everywhere

    def __init__(self, problem: OrbitProblem) -> None:
        self.impacts = len(problem.word.repeated()[-1])

    def values(self, point: Point[CurvePoint]) -> Array:
        orbit = point.evaluation.orbit
        speeds = orbit.problem.impacts(orbit.unknowns)[:, 1]
        return np.asarray(speeds - np.roll(speeds, self.impacts))[: self.impacts]

    def locate(
        self, problem: Problem[CurvePoint], guess: Point[CurvePoint], index: int
    ) -> Located | None:
        return doubling_turns(guess.evaluation)

    def accept(self, event: Event[CurvePoint]) -> bool:
        orbit = event.point.evaluation.orbit
        return repeats(orbit.problem, orbit.unknowns, SAME_ORBIT)


def ended(point: Point[CurvePoint]) -> End:
    """Return the end of a curve at an orbit that repeats a shorter one."""
    orbit = point.evaluation.orbit
    once, _ = shortest(orbit.problem, orbit.unknowns, SAME_ORBIT)
    letters = orbit.problem.model.letters
    first, times = orbit.problem.kernels.parameter, len(orbit.problem.word) // len(once.word)
    told = {"word": once.word.notation(letters), "times": times}
    return End.of(EndKind.SHORTER, first, point.evaluation.parameter(first), **told)


def crossing(problem: Problem[CurvePoint], guess: Point, scale: Array) -> Meeting | None:
    """Return the GPD near a point on the fold of a doubled orbit, where the curve of PD crosses."""
    found = doubling_turns(guess.evaluation)
    if found is None:
        return None
    away = (found.unknowns - guess.unknowns) / scale
    if float(np.linalg.norm(away)) > NEAR:
        return None
    return Meeting(found.unknowns, 0.0, ROUNDING, (1.0, 1.0))


def doubling_turns(here: CurvePoint) -> Located | None:
    """Solve for the GPD next to a point on the fold of a doubled orbit; None if there is none."""
    curve, problem = here.problem, here.orbit.problem
    halves, crossed = problem.word.repeated(), curve.kind.shorter_at
    if crossed is None or not halves or 2 * len(halves[-1]) != len(problem.word):
        return None
    kind, name = crossed
    short = problem_of(problem.model, halves[-1], problem.kernels)
    mean = short.evaluate(_mean_half(here.orbit))
    solution = solve(double_of(mean, name, kind_of(kind), {}).system, mean)
    problem.kernel_evaluations += short.kernel_evaluations
    if solution is None:
        return None
    orbit = twice(short.evaluate(solution.unknowns))
    own = curve.system.start(orbit)
    own *= np.sign(own @ here.own) or 1.0
    return Located(curve.packed(orbit.unknowns, own), solution.residual, solution.error)


def _mean_half(here: Linearisation) -> Array:
    """The mean of a doubled orbit's halves, as a shorter orbit."""
    problem = here.problem
    rows = problem.impacts(here.unknowns)
    count = len(rows) // 2
    later = rows[count:].copy()
    later[:, 0] -= 0.5 * problem.span(here.unknowns)
    mean = 0.5 * (rows[:count] + later)
    return np.append(mean.ravel(), here.unknowns[problem.n :])
