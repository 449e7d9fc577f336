"""Simulations and voltages against many digits, and against `solve_ivp`.

A simulation has no tolerance: each flight is a closed form, and its arrival a zero found to
rounding. So its error is measured flight by flight, each from the simulated impact as it is, and
along the motion from one first impact, where errors grow or fade with the motion itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..models.guards import way_back
from ..models.word import Word
from ..orbits.problem import OrbitProblem
from ..segments.kernels import Kernels
from ..simulation.run import Run
from ..simulation.simulator import Simulator
from .reference import Reference
from .shooting import EVALUATIONS, EXPLICIT, IMPLICIT, Shooting, take_within_budget, time_task

if TYPE_CHECKING:
    from ..results.scene import Scene
    from ..systems.membrane import Membrane

IMPACTS = 200
"""Impacts of the simulation that is timed."""

TRANSIENT = 500
"""Periods before them, in which what is left of the random start fades."""

FLIGHTS = 40
"""Flights of it that are solved again in many digits, one by one and one after the other."""

INTEGRATED, CLEAR = 6, 1e-3
"""Flights integrated with `solve_ivp` at every tolerance, and the least speed at their ends: it
misses the ends of shorter ones."""

ITERATIONS = 12


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
        for _ in range(ITERATIONS):
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
