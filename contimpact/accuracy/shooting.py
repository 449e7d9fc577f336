"""Shooting with SciPy's `solve_ivp`: what a user would write, for comparison in reports alone.

The flight is integrated numerically with an event at the next wall; a periodic orbit is a fixed
point of (t, v) -> (t - pT, v) before the first impact, found by Newton's method with a Jacobian by
forward differences. It knows nothing of the closed form of a flight.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..orbits.problem import Array, OrbitProblem

ITERATIONS = 12

MOST_EVALUATIONS = 50_000
"""In one flight: an explicit integrator takes more where the motion is stiff."""

EXPLICIT, IMPLICIT = "DOP853", "Radau"
"""Integrators of `solve_ivp`, the second for stiff motion."""


class _TooLong(Exception):
    """A flight has taken too many evaluations."""


class Shooting:
    """The return map of a word, by numerical integration.

    Parameters
    ----------
    problem : OrbitProblem
        Of a system with one degree of freedom.
    tolerance : float
        Relative and absolute tolerance of the integrator.
    method : {"DOP853", "Radau"}
    budget : float
        Evaluations of the equations of motion, all in all, after which nothing is integrated.

    Attributes
    ----------
    evaluations : int
        Evaluations of the equations of motion so far.
    given_up : bool
        Whether a flight has been given up, so that nothing is known of its end.
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

        from ..models.equations import of_mode, state_after

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
            force = of_mode(formulas.acceleration, guard.next_mode)(t, [x], [v])[0]
            force = sympy.sympify(force).doit()
            self._force[guard.name] = sympy.lambdify([t, x, v, *given], force, "math")
            slopes = [force.diff(x), force.diff(v)]
            self._slopes[guard.name] = sympy.lambdify([t, x, v, *given], slopes, "math")
            after = [e[0] for e in state_after(formulas, guard.name, [x], [v], "formulas")]
            self._after[guard.name] = sympy.lambdify([x, v, *given], after, "math")

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
                raise _TooLong
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
        except _TooLong:
            self.given_up = True
            return None
        if result.status != 1:
            return None
        return [float(result.t_events[0][0]), float(result.y_events[0][0][1])]
