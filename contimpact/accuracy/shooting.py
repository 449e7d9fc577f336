"""Shooting, the contestant, and how it is timed.

The flight is integrated numerically with an event at the next wall; a periodic orbit is a fixed
point of (t, v) -> (t - pT, v) before the first impact, found by Newton's method with a Jacobian by
forward differences. It knows nothing of the closed form of a flight.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from statistics import median
from typing import Any, TypeVar

import numpy as np

from ..arrays import Array
from ..continuation.branch import Point, Walk
from ..orbits.problem import Linearisation, OrbitProblem

# Repeated timings within a budget: the median, the least and the most.
#
# Seconds are those of the processor, which other programs that run meanwhile do not change.

SECONDS = 20.0
"""A part of a report that has taken so long is not repeated, nor measured at more places."""

T = TypeVar("T")


def time_task(
    task: Callable[[], Any], repetitions: int, per: float = 1.0
) -> tuple[Any, dict[str, float]]:
    """Run a task several times; returns its result and median, least and most seconds per unit.

    It is not repeated any more after `SECONDS`.
    """
    seconds: list[float] = []
    result = None
    for _ in take_within_budget(range(repetitions)):
        began = time.process_time()
        result = task()
        seconds.append((time.process_time() - began) / per)
    return result, spread(seconds)


def take_within_budget(items: Iterable[T], seconds: float | None = None) -> Iterator[T]:
    """Yield items until what is done with them has taken `SECONDS`; one at least."""
    end = time.process_time() + (SECONDS if seconds is None else seconds)
    for item in items:
        yield item
        if time.process_time() > end:
            break


def spread(seconds: Sequence[float]) -> dict[str, float]:
    """Return the median, the least and the most of some timings."""
    return {"median": median(seconds), "low": min(seconds), "high": max(seconds)}


ITERATIONS = 12

MOST_EVALUATIONS = 50_000
"""Largest number of evaluations in one flight: an explicit integrator takes more where the motion
is stiff."""

EXPLICIT, IMPLICIT = "DOP853", "Radau"
"""Integrators of `solve_ivp`, the second for stiff motion."""


class _BudgetSpent(Exception):
    """A flight has taken too many evaluations."""


class Shooting:
    """The return map of a word of one degree of freedom, by numerical integration with a tolerance,
    relative and absolute, by the method ``DOP853`` or ``Radau``.

    After `budget` evaluations of the equations of motion in all, nothing is integrated.
    `evaluations` counts them; `given_up` says whether a flight has been given up, so that nothing
    is known of its end.
    """

    def __init__(
        self,
        problem: OrbitProblem,
        tolerance: float,
        method: str = EXPLICIT,
        budget: float = np.inf,
    ) -> None:
        import sympy
        from scipy.integrate import solve_ivp

        from ..models.equations import mode_value, state_after

        self.problem, self._integrate = problem, solve_ivp
        self.tolerance = max(tolerance, 2.3e-14)  # the least that solve_ivp takes
        self.method, self.budget = method, budget
        self.evaluations, self.given_up = 0, False
        names = {name: sympy.Symbol(name, real=True) for name in problem.model.values}
        t, x, v = sympy.symbols("t x v", real=True)
        formulas = problem.model.formulas(names)
        given = list(names.values())
        self._force, self._slopes, self._after = {}, {}, {}
        for guard in problem.model.WALLS:
            force = mode_value(formulas.acceleration, guard.next_mode)(t, [x], [v])[0]
            force = sympy.sympify(force).doit()
            self._force[guard.name] = sympy.lambdify([t, x, v, *given], force, "math")
            slopes = [force.diff(x), force.diff(v)]
            self._slopes[guard.name] = sympy.lambdify([t, x, v, *given], slopes, "math")
            after = [e[0] for e in state_after(formulas, guard.name, [x], [v], "formulas")]
            self._after[guard.name] = sympy.lambdify([x, v, *given], after, "math")

    @staticmethod
    def follows(problem: OrbitProblem) -> bool:
        """Whether it integrates the flights of a problem."""
        return problem.kernels.planar

    def orbit(self, guess: Array) -> Array | None:
        """Return the orbit next to a guess at its parameter value; None if it is not reached."""
        p = self.problem.values(guess)
        state = np.array(guess[:2], dtype=float)
        h = np.sqrt(self.tolerance)
        for _ in range(ITERATIONS):
            here = self._around(state, p)
            if here is None:
                return None
            residual, rows = here
            columns = []
            for i in range(2):
                moved = state.copy()
                moved[i] += h
                there = self._around(moved, p)
                if there is None:
                    return None
                columns.append((there[0] - residual) / h)
            try:
                step = np.linalg.solve(np.array(columns).T, residual)
            except np.linalg.LinAlgError:
                return None
            if np.max(np.abs(step)) <= 2.0 * self.tolerance:
                return np.append(np.array(rows).ravel(), guess[-1])
            state = state - step
        if not np.max(np.abs(step)) <= h:
            return None
        return np.append(np.array(rows).ravel(), guess[-1])

    def _around(self, state: Array, p: list[float]) -> tuple[Array, list[list[float]]] | None:
        """Residual of the return map, and the impacts on the way; None if a wall is missed."""
        problem = self.problem
        span = problem.word.period * problem.kernels.setup(*p).period
        rows = []
        now = [float(state[0]), float(state[1])]
        for a, b in problem.kinds:
            rows.append(now)
            arrival = self.flight(a, b, now, span, p)
            if arrival is None:
                return None
            now = arrival
        return np.array([now[0] - span - state[0], now[1] - state[1]]), rows

    def flight(
        self, a: str, b: str, impact: list[float], span: float, p: list[float]
    ) -> list[float] | None:
        """Return time and velocity before the next impact, within twice a span of time.

        None if there is none, or if it takes more than `MOST_EVALUATIONS` or the budget.
        """
        walls = self.problem.model.WALLS
        places = self.problem.kernels.setup(*p).walls
        place = dict(zip((w.name for w in walls), places, strict=True))
        left, velocity = self._after[a](place[a], impact[1], *p)
        start, distance, force = [left - place[a], velocity], place[b] - place[a], self._force[a]
        last = min(self.evaluations + MOST_EVALUATIONS, self.budget)

        def arrival(t: float, y: Array) -> float:
            return float(y[0] - distance)

        def motion(t: float, y: Array) -> list[float]:
            self.evaluations += 1
            if self.evaluations > last:
                raise _BudgetSpent
            return [y[1], force(t, place[a] + y[0], y[1], *p)]

        def jacobian(t: float, y: Array) -> list[list[float]]:
            return [[0.0, 1.0], self._slopes[a](t, place[a] + y[0], y[1], *p)]

        event: Any = arrival
        event.terminal = True
        event.direction = next(w.side for w in walls if w.name == b)
        window, tolerance = (impact[0], impact[0] + 2.0 * span), self.tolerance
        options: dict[str, Any] = {"rtol": tolerance, "atol": tolerance, "method": self.method}
        if self.method == IMPLICIT:
            options["jac"] = jacobian
        try:
            result = self._integrate(motion, window, start, events=event, **options)
        except _BudgetSpent:
            self.given_up = True
            return None
        if result.status != 1:
            return None
        return [float(result.t_events[0][0]), float(result.y_events[0][0][1])]


# The contestant of reports: orbits by shooting, each row within a budget of evaluations.
#
# A row that spends it says how many orbits it has not come to; its cost is then the least it can
# be.

SHOT = 6
"""Orbits that are solved for."""

EVALUATIONS = 200_000
"""Largest number of evaluations of the equations of motion, for all orbits of a row."""

Row = dict[str, Any]


def measure_shooting(
    problem: OrbitProblem,
    walks: Sequence[Walk],
    tolerances: Sequence[float],
    repetitions: int,
    progress: Callable[[str], None],
) -> dict[str, list[Row]]:
    """Return rows by integrator; the one for stiff motion where the other spends its budget.

    They end with the first tolerance at which nothing has ended. There are none without
    coordinates to shoot in, or orbits that a simulation can follow.
    """
    points = [p for w in walks for p in w.points if can_be_simulated(p)]
    if not Shooting.follows(problem) or problem.lost or not points:
        return {}
    chosen = [point.unknowns for point in spread_sample(points, SHOT)]
    share = sum(len(w.points) for w in walks) / len(chosen)
    found: dict[str, list[Row]] = {}
    for method in (EXPLICIT, IMPLICIT):
        found[method] = []
        for tolerance in tolerances:
            progress(f"shooting by {method}, rtol {tolerance:.0e}")
            contestant = problem, tolerance, method, chosen
            found[method].append(_row(contestant, share, min(repetitions, 3)))
            if found[method][-1]["unfinished"] == len(chosen):
                break  # smaller tolerances cost more
        if not any(row["unfinished"] for row in found[method]):
            break
    return found


def _row(
    contestant: tuple[OrbitProblem, float, str, list[Array]], share: float, repetitions: int
) -> Row:
    """Some orbits by shooting; its cost as if all orbits of the branch were."""
    problem, tolerance, method, chosen = contestant
    shooting = Shooting(problem, tolerance, method, EVALUATIONS)

    def shoot() -> list[Array | None]:
        solved: list[Array | None] = []
        shooting.evaluations = 0
        for unknowns in chosen:
            shooting.given_up = False
            orbit = shooting.orbit(_perturbed_guess(unknowns))
            if not shooting.given_up:
                solved.append(orbit)
        return solved

    solved, seconds = time_task(shoot, repetitions, 1.0 / share)
    reached = [unknowns for unknowns in solved if unknowns is not None]
    return {
        "setting": tolerance,
        "reached": reached,
        "seconds": seconds,
        "evaluations": share * shooting.evaluations,
        "orbits": len(chosen),
        "failed": len(solved) - len(reached),
        "unfinished": len(chosen) - len(solved),
    }


def spread_sample(items: Sequence[Any], most: int) -> list[Any]:
    """Return at most `most` items of a sequence, evenly spread."""
    if len(items) <= most:
        return list(items)
    return [items[int(i)] for i in np.linspace(0, len(items) - 1, most)]


def can_be_simulated(point: Point[Linearisation]) -> bool:
    """Whether a simulation can follow the orbit: physical, not nearly grazing, not at a fold."""
    here = point.evaluation
    speeds = here.problem.impacts(here.unknowns)[:, 1]
    turning = abs(point.tangent[-1]) < 0.05 * np.max(np.abs(point.tangent))
    return bool(here.verdict.physical and np.min(np.abs(speeds)) > 1e-3 and not turning)


def _perturbed_guess(unknowns: Array) -> Array:
    """A guess as good as a predictor's: three digits."""
    guess = unknowns.copy()
    guess[:-1] *= 1.0 + 1e-3 * np.cos(np.arange(len(guess) - 1))
    return guess
