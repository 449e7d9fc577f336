"""What reports compare: solutions to thirty digits and more, and shooting, which needs no kernels.

The generated kernels are evaluated in mpmath's arithmetic. Only the step of Newton's iteration is
computed in double precision, so that an iteration contracts by about the condition number times
1e-16 until the digits asked for stand.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import TYPE_CHECKING, Any, TypeVar

import mpmath
import numpy as np

from ..arrays import Array
from ..bifurcations.equations import Equations
from ..bifurcations.kind import kind_of
from ..continuation.branch import Point, Walk
from ..models.guards import Word, way_back
from ..orbits.problem import Linearisation, OrbitProblem
from ..segments.bounded import many_digits
from ..segments.kernels import Kernels
from ..segments.segment import evaluate_in
from ..simulation.run import Run
from ..simulation.simulator import Simulator

if TYPE_CHECKING:
    from ..results.scene import Scene
    from ..systems.membrane import Membrane

# Shooting, the contestant, and how it is timed.
#
# The flight is integrated numerically with an event at the next wall; a periodic orbit is a fixed
# point of (t, v) -> (t - pT, v) before the first impact, found by Newton's method with a Jacobian
# by forward differences. It knows nothing of the closed form of a flight.
#
# Repeated timings within a budget give the median, the least and the most. Seconds are those of the
# processor, which other programs that run meanwhile do not change.

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


CORRECTIONS = 12

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
        for _ in range(CORRECTIONS):
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
    everything = [p for w in walks for p in w.points]
    fastest = max((np.max(_speeds(p)) for p in everything), default=0.0)
    points = [p for p in everything if can_be_simulated(p, fastest)]
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


def can_be_simulated(point: Point[Linearisation], fastest: float) -> bool:
    """Whether a simulation can follow the orbit: physical, not nearly grazing beside the `fastest`
    impact of its branch, not at a fold."""
    turning = abs(point.tangent[-1]) < 0.05 * np.max(np.abs(point.tangent))
    slow = np.min(_speeds(point)) <= 1e-3 * fastest
    return bool(point.evaluation.verdict.physical and not slow and not turning)


def _speeds(point: Point[Linearisation]) -> Array:
    here = point.evaluation
    return np.abs(here.problem.impacts(here.unknowns)[:, 1])


def _perturbed_guess(unknowns: Array) -> Array:
    """A guess as good as a predictor's: three digits."""
    guess = unknowns.copy()
    guess[:-1] *= 1.0 + 1e-3 * np.cos(np.arange(len(guess) - 1))
    return guess


# Orbits, multipliers and events in many digits.

ITERATIONS = 60
GUARD_DIGITS = 18
DIFFERENCE = 1e-16


@dataclass(frozen=True)
class Exact:
    """A solution in many digits."""

    unknowns: list[Any]
    """Impact times, section coordinates and the free parameter."""
    extra: list[Any]
    """Further unknowns of the system: a touch's time, a null vector."""
    residual: float
    step: float
    """`residual`, `step`: largest residual, and the last step relative to the unknowns."""
    condition: float
    """Condition number of the system's Jacobian, in the 2-norm."""
    iterations: int

    @property
    def parameter(self) -> Any:
        """The free parameter."""
        return self.unknowns[-1]

    def distance(self, unknowns: Array) -> float:
        """Return the largest distance of a point in doubles from this one, absolute."""
        return max(abs(float(x - float(y))) for x, y in zip(self.unknowns, unknowns, strict=True))

    def parameter_error(self, value: float) -> float:
        """Return by how much a value of the free parameter is off."""
        return float(value - self.unknowns[-1])


class Reference(Equations):
    """The orbit problem of a word, and the systems of its events, in many digits; the arithmetic
    carries some more than it is to reach. `problem` gives the word, the parameters' doubles and the
    kernels."""

    def __init__(self, problem: OrbitProblem, digits: int = 30) -> None:
        self.digits = digits
        self.ctx = mpmath.mp.clone()
        self.ctx.dps = digits + GUARD_DIGITS
        super().__init__(problem, many_digits(self.ctx))

    # Solutions.

    def orbit(self, unknowns: Array, held: int = -1) -> Exact | None:
        """Return the orbit next to a point that shares one of its unknowns, `held`, by default the
        free parameter; None where the iteration does not converge."""
        point = [float(u) for u in unknowns]
        row = np.zeros(len(point))
        row[held] = 1.0
        jacobian = np.vstack([self.problem.evaluate(np.array(point)).jacobian, row])
        solved = self._solve(lambda x: [*self.residual(x), x[held] - point[held]], point, jacobian)
        return Exact(solved[0], [], *solved[1:]) if solved is not None else None

    def event(
        self, kind: str, unknowns: Array, details: Mapping[str, Any] | None = None
    ) -> Exact | None:
        """Return the event of a kind next to a point; `details` are those of `Event.details`.

        None where the iteration does not converge, and for a kind without such equations.
        """
        given = np.asarray(unknowns, dtype=float)
        equations = kind_of(kind).in_many_digits(self, given, details or {})
        if equations is None:
            return None
        count = self.problem.n + 1
        solved = self._solve(equations[0], [*given.tolist(), *equations[1]])
        if solved is None:
            return None
        x, residual, step, condition, iterations = solved
        return Exact(x[:count], x[count:], residual, step, condition, iterations)

    def has_event(self, kind: str, unknowns: Array, details: Mapping[str, Any]) -> bool:
        """Return whether there are equations of an event of a kind next to a point."""
        return kind_of(kind).in_many_digits(self, np.asarray(unknowns), details) is not None

    def multipliers(self, unknowns: Sequence[Any]) -> list[Any]:
        """Return the multipliers, largest first, from the product of the flights' maps.

        Products are safe here: their loss is made good by digits. For m = 2 alone.
        """
        ctx = self.ctx
        flights = self.flights(unknowns, held=True)
        with ctx.extradps(30 + 4 * len(flights)):
            total, product = ctx.eye(2), ctx.one
            for _, a, b, _ in flights:
                below = b[0] * b[3] - b[1] * b[2]
                inverse = ctx.matrix([[b[3], -b[1]], [-b[2], b[0]]])
                total = -(inverse * ctx.matrix([a[:2], a[2:]])) * total / below
                product *= (a[0] * a[3] - a[1] * a[2]) / below
            half = (total[0, 0] + total[1, 1]) / 2
            root = ctx.sqrt(half**2 - product)
            large = half + root if abs(half + root) >= abs(half - root) else half - root
            both = [+large, product / large if large else ctx.zero]
            return both[:1] if self.problem.autonomous else both

    def kernel(self, a: str, b: str) -> Callable[..., Any]:
        """Return the kernel of a flight in this arithmetic."""
        return evaluate_in(self.problem.kernels.flight(a, b), self.arithmetic)

    # Newton's iteration.

    def _solve(
        self,
        system: Callable[[list[Any]], list[Any]],
        guess: Sequence[float],
        jacobian: Array | None = None,
    ) -> tuple[list[Any], float, float, float, int] | None:
        """Iterate with a Jacobian in doubles, renewed where it no longer serves."""
        ctx = self.ctx
        x = [ctx.mpf(value) for value in guess]
        before = np.inf
        for iteration in range(ITERATIONS):
            residual = system(x)
            matrix = self._differences(system, x, residual) if jacobian is None else jacobian
            jacobian = matrix
            moved = _step(ctx, matrix, residual)
            if moved is None:
                return None
            size = max(float(abs(d) / max(1, abs(v))) for d, v in zip(moved, x, strict=True))
            if not np.isfinite(size):
                return None
            x = [v - d for v, d in zip(x, moved, strict=True)]
            if size < 10.0**-self.digits:
                left = max(float(abs(r)) for r in system(x))
                return x, left, size, float(np.linalg.cond(matrix)), iteration + 1
            if size > 1e-3 * before:
                jacobian = None
            before = size
        return None

    def _differences(
        self, system: Callable[[list[Any]], list[Any]], x: list[Any], here: list[Any]
    ) -> Array:
        """The Jacobian by differences, in this arithmetic; accurate beyond doubles' rounding."""
        columns = []
        for i, value in enumerate(x):
            h = self.ctx.mpf(DIFFERENCE) * max(1, abs(value))
            there = system([*x[:i], value + h, *x[i + 1 :]])
            columns.append([float((b - a) / h) for a, b in zip(here, there, strict=True)])
        return np.array(columns).T


def _step(ctx: Any, jacobian: Array, residual: list[Any]) -> list[Any] | None:
    """Solve for a Newton step in doubles; the residual is scaled so that none underflows."""
    size = max(abs(r) for r in residual)
    if size == 0:
        return [ctx.zero] * len(residual)
    right = np.array([float(r / size) for r in residual])
    try:
        step = np.linalg.solve(jacobian, right)
    except np.linalg.LinAlgError:
        return None
    return [size * ctx.mpf(s) for s in step.tolist()]


# Simulations and voltages against many digits, and against `solve_ivp`.
#
# A simulation has no tolerance: each flight is a closed form, and its arrival a zero found to
# rounding. So its error is measured flight by flight, each from the simulated impact as it is, and
# along the motion from one first impact, where errors grow or fade with the motion itself.

IMPACTS = 200
"""Impacts of the simulation that is timed."""

TRANSIENT = 500
"""Periods before them, in which what is left of the random start fades."""

FLIGHTS = 40
"""Flights of it that are solved again in many digits, one by one and one after the other."""

INTEGRATED, CLEAR = 6, 1e-3
"""Flights integrated with `solve_ivp` at every tolerance, and the least speed at their ends: it
misses the ends of shorter ones."""

SOLVING = 12


class ExactFlights:
    """Arrivals in many digits."""

    def __init__(self, simulator: Simulator, digits: int = 30) -> None:
        model, kernels = simulator.model, simulator.kernels
        self.letters = simulator.letters
        guards = model.WALLS
        around = way_back(guards, self.letters[0], guards[0].modes[0], "".join(self.letters))
        self.problem = OrbitProblem(model, Word(around or self.letters[0]), kernels)
        self.exact = Reference(self.problem, digits)
        self.values = [self.exact.ctx.mpf(value) for value in model.values.values()]
        self.period = self.exact.setup(self.values).period

    def arrival(self, walls: tuple[int, int], start: Sequence[Any], guess: Sequence[Any]) -> Any:
        """Return time and section coordinates of the arrival next to a guess.

        None if it is not reached.
        """
        ctx, m = self.exact.ctx, len(guess)
        flight = self.exact.kernel(*(self.letters[wall] for wall in walls))
        x = ctx.matrix([ctx.mpf(value) for value in guess])
        for _ in range(SOLVING):
            rows, _, end, _ = flight(*map(ctx.mpf, start), *x, *self.values)
            blocks = [end[m * i : m * i + m] for i in range(m)]
            step = ctx.lu_solve(ctx.matrix(blocks), ctx.matrix(rows))
            x = x - step
            if max(map(abs, step)) < ctx.mpf(10) ** -self.exact.digits:
                return x
        return None

    def errors(self, run: Run, flights: int = FLIGHTS) -> list[float]:
        """Return the error of each of some flights, from the simulated impact before it."""
        found = []
        for k in take_within_budget(flights_of(run)[:flights]):
            arrived = self.arrival(*self.about(run, k, impact(run, k)))
            found.append(self.off(run, k, arrived))
        return found

    def along(self, run: Run, flights: int = FLIGHTS) -> tuple[list[float], list[Any]]:
        """Return the errors at the impacts since the first one, and their exact velocities.

        They end where the body sticks to a wall.
        """
        errors: list[float] = []
        velocities: list[Any] = []
        start: list[Any] = impact(run, 0)
        flown = set(flights_of(run))
        for k in take_within_budget(range(min(flights, len(run) - 1))):
            if k not in flown:
                break
            found = self.arrival(*self.about(run, k, start))
            errors.append(self.off(run, k, found))
            if found is None:
                break
            start = [found[0] - self.turns(run, k) * self.period, *list(found)[1:]]
            velocities.append(found[1])
        return errors, velocities

    def about(self, run: Run, k: int, start: Sequence[Any]) -> tuple[Any, ...]:
        """The walls of flight k, where it starts, and where the simulation has it arrive."""
        phase, *section = impact(run, k + 1)
        walls = int(run.walls[k]), int(run.walls[k + 1])
        return walls, start, [phase + self.turns(run, k) * self.period, *section]

    def off(self, run: Run, k: int, found: Any) -> float:
        """How far the simulated arrival of flight k is from another one."""
        if found is None:
            return float("inf")
        phase, *section = impact(run, k + 1)
        late = found[0] - self.turns(run, k) * self.period - phase
        apart = (one - other for one, other in zip(list(found)[1:], section, strict=True))
        return max(abs(float(difference)) for difference in (late, *apart))

    @staticmethod
    def turns(run: Run, k: int) -> int:
        """Forcing periods that end during flight k."""
        return int(run.turns[k + 1] - run.turns[k])


def flights_of(run: Run) -> list[int]:
    """Return the rows from which the body flies to the next one; before a release it rests."""
    if not run.held.size:
        return [k for k in range(len(run) - 1) if not run.released[k + 1]]
    flown = [not (released or held) for released, held in zip(run.released, run.held, strict=True)]
    return [k for k in range(len(run) - 1) if flown[k] and flown[k + 1]]


def impact(run: Run, k: int) -> list[float]:
    """Return phase and section coordinates of a row."""
    others = run.others[k].tolist() if run.others.size else []
    return [float(run.phases[k]), float(run.velocities[k]), *others]


def measure_simulation(
    scene: Scene, tolerances: Sequence[float], repetitions: int, digits: int
) -> dict[str, Any] | None:
    """Measure a scene's simulation, and its voltages.

    None for a scene without ``[simulate]``, or where the motion comes to meet no wall. With several
    coordinates nothing is integrated.
    """
    if scene.simulate is None:
        return None
    simulator = Simulator(scene.model, Kernels(scene.model, scene.parameter))
    state = simulator.random_state(np.random.default_rng(scene.seed))
    state = simulator.run(state, periods=TRANSIENT, record=False).end or state
    run, seconds = time_task(lambda: simulator.run(state, impacts=IMPACTS), repetitions, IMPACTS)
    if not len(run):
        return None
    exact = ExactFlights(simulator, digits)
    one_by_one = exact.errors(run)
    along, velocities = exact.along(run)
    row = {"setting": None, "error": max(one_by_one, default=None), "seconds": seconds}
    row |= {"evaluations": None, "failed": 0, "unfinished": 0}
    by_integrator: dict[str, list[dict[str, Any]]] = {EXPLICIT: [], IMPLICIT: []}
    for method, rows in by_integrator.items():
        stiff = any(row["unfinished"] for row in by_integrator[EXPLICIT])
        if not Shooting.follows(exact.problem) or (method == IMPLICIT and not stiff):
            continue
        rows += [compare_with_ivp(exact, run, tolerance, method) for tolerance in tolerances]
    energy = None
    if scene.energy is not None:
        energy = voltages(scene.energy, scene.model.values, run, velocities, exact.exact.ctx)
    return {
        "impacts": len(run),
        "flights": len(one_by_one),
        "simulator": row,
        "solve_ivp": by_integrator[EXPLICIT],
        "radau": by_integrator[IMPLICIT],
        "along": along,
        "energy": energy,
    }


def compare_with_ivp(
    exact: ExactFlights, run: Run, tolerance: float, method: str
) -> dict[str, Any]:
    """Some of the flights by `solve_ivp`: the largest error, and cost per flight."""
    shooting = Shooting(exact.problem, tolerance, method, EVALUATIONS)
    values = list(exact.problem.model.values.values())
    span = float(exact.period)
    clear = np.abs(run.velocities) > CLEAR
    rows = [k for k in flights_of(run) if clear[k] and clear[k + 1]][:INTEGRATED]

    def fly(k: int) -> tuple[list[float] | None, bool]:
        shooting.given_up = False
        a, b = (exact.letters[int(run.walls[i])] for i in (k, k + 1))
        start = [float(run.phases[k]), float(run.velocities[k])]
        arrival = shooting.flight(a, b, start, (1 + exact.turns(run, k)) * span, values)
        return arrival, shooting.given_up

    arrivals, seconds = time_task(lambda: [fly(k) for k in rows], 1, max(len(rows), 1))
    errors = []
    unfinished = sum(given_up for _, given_up in arrivals)
    for k, (found, _) in zip(rows, arrivals, strict=True):
        start = [float(run.phases[k]), float(run.velocities[k])]
        truth = exact.arrival(*exact.about(run, k, start))
        if found is not None and truth is not None:
            errors.append(max(abs(float(x - y)) for x, y in zip(truth, found, strict=True)))
    return {
        "setting": tolerance,
        "error": max(errors, default=None),
        "seconds": seconds,
        "evaluations": shooting.evaluations / max(len(rows), 1),
        "failed": len(rows) - len(errors) - unfinished,
        "unfinished": unfinished,
    }


def voltages(
    membrane: Membrane, values: Mapping[str, float], run: Run, velocities: Sequence[Any], ctx: Any
) -> dict[str, Any]:
    """The relative errors of voltages: of the formula alone, and with the simulation's own."""
    from ..systems.membrane import velocity_scale

    pi = +ctx.pi
    scale = ctx.mpf(values["A"]) * pi / (ctx.mpf(values["M"]) * ctx.mpf(values["omega"]))
    formula, whole = [], []
    for v, exact in zip(run.velocities[1:].tolist(), velocities, strict=False):
        found = float(membrane.voltage(velocity_scale(values) * v))
        same, truth = (plain_voltage(membrane, scale * ctx.mpf(speed), ctx) for speed in (v, exact))
        formula.append(abs(float(found / same - 1)))
        whole.append(abs(float(found / truth - 1)))
    largest = {"formula": max(formula, default=None), "along": max(whole, default=None)}
    return {"impacts": len(formula), **largest}


def plain_voltage(membrane: Membrane, velocity: Any, ctx: Any) -> Any:
    """The formulas of Table A1 as they are printed; what cancels is made good by digits."""
    m, u, rc, rb, k, nu = (
        ctx.mpf(getattr(membrane, name)) for name in ("m", "U_in", "R_c", "R_b", "K", "nu")
    )
    depth = ((nu + 1) / (2 * k) * m * velocity**2) ** (1 / (nu + 1))
    root = ctx.sqrt(rc**2 + depth**2 - 2 * depth * rb)
    cosine = (rb * (rb - depth) + rc * root) / (rc**2 + (depth - rb) ** 2)
    cap = 2 * ctx.pi * rb**2 * (1 - cosine)
    cone = ctx.pi * (rc**2 - rb**2 * (1 - cosine**2)) / cosine
    return u * (((cap + cone) / (ctx.pi * rc**2)) ** 2 - 1)
