"""The bifurcations of periodic orbits as test functions: where mechanics and continuation meet.

======  =================================================================================
kind    test function
======  =================================================================================
FB      parameter component of the tangent
BP      determinant of the Jacobian bordered by the tangent
PD      determinant of the cyclic block matrix with its last coupling multiplied by -1
NS      product of two multipliers minus one, without poles
G       smallest interior gap of each flight and wall
V       velocity of each impact, towards its wall
T       duration of each flight
UZ      a parameter or derived parameter minus a value
======  =================================================================================

Determinants are scaled row by row and have no pole where an impact velocity vanishes. Events are
solved in the systems of `contimpact.bifurcations.extended`; NS is located by bracketing.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from ..continuation.arclength import scaled_determinant
from ..continuation.branch import Event, Point
from ..continuation.events import Located, TestFunction
from ..errors import InputError
from ..orbits import multipliers as stability
from ..orbits.problem import Array, OrbitProblem
from ..orbits.rounding import rounding_of_setup
from .extended import EPSILON, Crossing, ExtendedSystem, Reached, SingularCycle, Touching, solve
from .names import KINDS
from .unfolding import crossed, meeting, stands_upright, unfolding

UNIT_CIRCLE = 1e-2
"""How near to the unit circle a located event's multiplier is at least."""

PASSING = 1e-9
"""A gap of a located touch below minus this is that of another place, where the flight passes."""

ROUNDING = 1e-14
"""Rounding of the scaled determinants, and of gaps as part of the distance between walls."""


def located(
    system: ExtendedSystem, guess: Point, details: Callable[[Any], Mapping[str, Any]] | None = None
) -> Located | None:
    """Solve an extended system from a point; None if that fails."""
    solution = solve(system, guess.evaluation)
    if solution is None:
        return None
    told = details(solution) if details else {}
    return Located(solution.unknowns, solution.residual, solution.error, told)


def at_unit_circle(event: Event, target: float) -> bool:
    """Whether a multiplier is where the event needs one.

    Determinants also vanish where flights do: at r = 0 impacts merge, and no multiplier is near.
    """
    multipliers: Any = event.point.evaluation.multipliers
    return bool(np.min(np.abs(multipliers - target)) < UNIT_CIRCLE)


class Fold(TestFunction):
    """FB: the parameter turns back along the branch."""

    kind = "FB"

    def values(self, point: Point) -> Array:
        return point.tangent[-1:]

    def locate(self, problem: Any, guess: Point, index: int) -> Located | None:
        return located(SingularCycle(problem, 1.0), guess)

    def accept(self, event: Event) -> bool:
        """A branch that passes a branch point sideways turns there too, but is not folded."""
        return at_unit_circle(event, 1.0) and not stands_upright(event.point)


class PeriodDoubling(TestFunction):
    """PD: a multiplier passes -1."""

    kind = "PD"
    rounding = ROUNDING

    def values(self, point: Point) -> Array:
        matrix = point.evaluation.cyclic(-1.0)[:, :-1]
        return np.array([scaled_determinant(matrix)])

    def locate(self, problem: Any, guess: Point, index: int) -> Located | None:
        return located(SingularCycle(problem, -1.0), guess)

    def accept(self, event: Event) -> bool:
        return at_unit_circle(event, -1.0)


class BranchPoint(TestFunction):
    """BP: two branches cross."""

    kind = "BP"
    rounding = ROUNDING

    def values(self, point: Point) -> Array:
        return np.array([point.orientation])

    def locate(self, problem: Any, guess: Point, index: int) -> Located | None:
        system = Crossing(problem)
        found = located(system, guess, lambda solution: unfolding(system, solution))
        return found if found is not None and crossed(found.details) else None

    def accept(self, event: Event) -> bool:
        """Bracketing does not tell a crossing of branches from a near miss."""
        if event.method == "bracket":
            scale = np.ones(len(event.point.unknowns))
            near = meeting(event.point.evaluation.problem, event.point, scale)
            if near is not None and not near.crosses:
                return False
        return at_unit_circle(event, 1.0)


class NeimarkSacker(TestFunction):
    """NS: a complex pair of multipliers crosses the unit circle."""

    kind = "NS"
    noise = 1e-9  # without damping and losses the product is one everywhere, within rounding

    def values(self, point: Point) -> Array:
        here: Any = point.evaluation
        return np.array([stability.neimark_sacker(here.start, here.end)])

    def accept(self, event: Event) -> bool:
        """Two real multipliers with the product one are a neutral saddle."""
        multipliers = event.point.evaluation.multipliers
        on_circle = np.abs(np.abs(multipliers) - 1.0) < 1e-6
        return bool(np.any(on_circle & (np.abs(multipliers.imag) > 1e-8)))


class Grazing(TestFunction):
    """G: a flight touches a wall between its impacts."""

    kind = "G"

    def __init__(self, problem: OrbitProblem) -> None:
        walls = [w.name for w in problem.model.WALLS]
        self.places = [(k, wall) for k in range(len(problem.word)) for wall in walls]
        positions = problem.kernels.setup(*problem.model.values.values())[3 : 3 + len(walls)]
        self.rounding = ROUNDING * max(abs(position) for position in positions)
        self.guides = len(problem.word)

    def values(self, point: Point) -> Array:
        """Gaps; then, to see where extrema of a flight are born, how nearly it turns elsewhere."""
        flights = point.evaluation.gaps
        gaps = [np.nan if t is None else t.gap for flight in flights for t in flight.touches]
        return np.array(gaps + [flight.slowest for flight in flights])

    def guided(self, left: Array, right: Array) -> Array:
        """Flights that turn nowhere at either end of a segment may do so between."""
        gaps = np.vstack([left[: -self.guides], right[: -self.guides]])
        return np.all(np.isnan(gaps.reshape(2, self.guides, -1)), axis=(0, 2))

    @staticmethod
    def touch(evaluation: Any, index: int) -> Any:
        walls = len(evaluation.problem.model.WALLS)
        return evaluation.gaps[index // walls].touches[index % walls]

    def locate(self, problem: Any, guess: Point, index: int) -> Located | None:
        flight, wall = self.places[index]
        touch = self.touch(guess.evaluation, index)
        if touch is None:
            return None
        system = Touching(problem, flight, wall, touch.time)
        found = located(
            system, guess, lambda s: self._described(flight, wall, system.touch(s.own)[0])
        )
        if found is None:
            return None
        times = problem.impacts(found.unknowns)[:, 0]
        arrival = times[flight + 1] if flight + 1 < len(times) else np.inf
        within = times[flight] < found.details["touch_time"] < arrival
        return found if within and self.nearest(problem, found, index) else None

    def nearest(self, problem: Any, found: Located, index: int) -> bool:
        """Whether a flight does not pass the wall where it touches it at one of several extrema."""
        touch = self.touch(problem.evaluate(found.unknowns), index)
        return touch is None or touch.gap > -PASSING

    def details(self, point: Point, index: int) -> Mapping[str, Any]:
        flight, wall = self.places[index]
        time = self.touch(point.evaluation, index).time
        return {"index": index, **self._described(flight, wall, time)}

    @staticmethod
    def _described(flight: int, wall: str, time: float) -> dict[str, Any]:
        return {"flight": flight, "wall": wall, "touch_time": float(time)}


class ScalarTest(TestFunction):
    """A function of the unknowns with a known gradient: F = 0 and this function = 0."""

    @abstractmethod
    def scalar(self, problem: Any, z: Array, index: int) -> tuple[float, Array]:
        """Return the function and its gradient, shape (n + 1,)."""

    def values(self, point: Point) -> Array:
        problem = point.evaluation.problem
        return np.array(
            [self.scalar(problem, point.unknowns, i)[0] for i in range(self.count(problem))]
        )

    def count(self, problem: Any) -> int:
        """Return how many functions there are."""
        return len(problem.word)

    def locate(self, problem: Any, guess: Point, index: int) -> Located | None:
        system = Reached(
            problem,
            lambda orbit, z: self.scalar(orbit, z, index),
            lambda orbit, z: self.noise_of(orbit, z, index),
        )
        return located(system, guess, lambda solution: self.described(problem, index))

    def details(self, point: Point, index: int) -> Mapping[str, Any]:
        problem = point.evaluation.problem
        return {"index": index, **self.described(problem, index)}

    def described(self, problem: Any, index: int) -> dict[str, Any]:
        """What to record of a zero."""
        return {}

    def noise_of(self, problem: Any, z: Array, index: int) -> float:
        """Return a bound of the function's rounding error; zero where it is an unknown itself."""
        return 0.0


class ZeroVelocity(ScalarTest):
    """V: the velocity of an impact vanishes; beyond, the impact runs the wrong way."""

    kind = "V"

    def __init__(self, problem: OrbitProblem) -> None:
        sides = {w.name: float(w.side) for w in problem.model.WALLS}
        self.sides = [sides[w] for w in problem.word.walls]

    def scalar(self, problem: Any, z: Array, index: int) -> tuple[float, Array]:
        position = problem.m * index + 1
        gradient = np.zeros(len(z))
        gradient[position] = self.sides[index]
        return self.sides[index] * float(z[position]), gradient

    def described(self, problem: Any, index: int) -> dict[str, Any]:
        return {"impact": index, "wall": problem.word.walls[index]}


class ZeroDuration(ScalarTest):
    """T: a flight's duration vanishes; beyond, impacts are out of order.

    Durations within rounding of zero have no value: where r vanishes, those of a series of impacts
    do so together, without changing sign.
    """

    kind = "T"
    vanishing = 1e-12

    def values(self, point: Point) -> Array:
        found = super().values(point)
        return np.where(np.abs(found) < self.vanishing, np.nan, found)

    def scalar(self, problem: Any, z: Array, index: int) -> tuple[float, Array]:
        m, n = problem.m, problem.n
        i, j = m * index, m * (index + 1)
        gradient = np.zeros(len(z))
        gradient[i] -= 1.0
        gradient[j % n] += 1.0
        if j < n:
            return float(z[j] - z[i]), gradient
        period, slope = problem.kernels.setup(*problem.values(z))[:2]
        gradient[n] = problem.word.period * slope
        return float(z[0] + problem.word.period * period - z[i]), gradient

    def described(self, problem: Any, index: int) -> dict[str, Any]:
        return {"flight": index}

    def noise_of(self, problem: Any, z: Array, index: int) -> float:
        turns = problem.word.period if index == len(problem.word) - 1 else 0
        return turns * rounding_of_setup(problem, z)[0] + 2.0 * EPSILON * float(np.max(np.abs(z)))


class Requested(ScalarTest):
    """UZ: the free parameter, or a derived one, takes a value that was asked for.

    Parameters
    ----------
    problem : OrbitProblem
    requested : mapping of str to sequence of float
        Values by name.
    """

    kind = "UZ"

    def __init__(self, problem: OrbitProblem, requested: Mapping[str, Sequence[float]]) -> None:
        known = (problem.parameter, *problem.model.DERIVED)
        for name in requested:
            if name not in known:
                raise InputError(
                    f"values.{name}", "it does not vary along the branch",
                    f"accepted are {', '.join(known)}",
                )  # fmt: skip
        self.requested = [(name, float(v)) for name, values in requested.items() for v in values]

    def count(self, problem: Any) -> int:
        return len(self.requested)

    def scalar(self, problem: Any, z: Array, index: int) -> tuple[float, Array]:
        name, wanted = self.requested[index]
        gradient = np.zeros(len(z))
        if name == problem.parameter:
            gradient[-1] = 1.0
            return float(z[-1]) - wanted, gradient
        names = problem.model.DERIVED
        derived = problem.kernels.setup(*problem.values(z))[3 + len(problem.model.WALLS) :]
        place = names.index(name)
        gradient[-1] = derived[len(names) + place]
        return derived[place] - wanted, gradient

    def noise_of(self, problem: Any, z: Array, index: int) -> float:
        name, wanted = self.requested[index]
        if name == problem.parameter:
            return 0.0
        first = 3 + len(problem.model.WALLS)
        place = first + problem.model.DERIVED.index(name)
        return rounding_of_setup(problem, z)[place] + EPSILON * abs(wanted)

    def described(self, problem: Any, index: int) -> dict[str, Any]:
        name, wanted = self.requested[index]
        return {"requested": {name: wanted}}


def test_functions(
    problem: OrbitProblem, kinds: Sequence[str], requested: Mapping[str, Sequence[float]]
) -> list[TestFunction]:
    """Return the test functions of the kinds asked for; nothing else is evaluated.

    Raises
    ------
    InputError
        For a kind that does not exist, or a requested value of what does not vary.
    """
    makers: dict[str, Callable[[], TestFunction]] = {
        "FB": Fold,
        "BP": BranchPoint,
        "PD": PeriodDoubling,
        "NS": NeimarkSacker,
        "G": lambda: Grazing(problem),
        "V": lambda: ZeroVelocity(problem),
        "T": ZeroDuration,
        "UZ": lambda: Requested(problem, requested),
    }
    for kind in kinds:
        if kind not in makers:
            raise InputError(
                "events", f"no event kind {kind!r}", f"accepted are {', '.join(KINDS)}"
            )
    return [makers[kind]() for kind in dict.fromkeys(kinds)]


test_functions.__test__ = False  # type: ignore[attr-defined]


def critical(kind: str, multipliers: Any) -> list[int]:
    """Return which multipliers an event of this kind puts on the unit circle."""
    target = {"FB": 1.0, "BP": 1.0, "PD": -1.0}.get(kind)
    if target is not None:
        return [int(np.argmin(np.abs(multipliers - target)))]
    if kind == "V":  # the return map's derivative is infinite there
        return [int(np.argmax(np.abs(multipliers)))]
    if kind == "NS":
        return np.argsort(np.abs(np.abs(multipliers) - 1.0))[:2].tolist()
    return []
