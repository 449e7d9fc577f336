r"""The bifurcations of periodic orbits as test functions: where mechanics and continuation meet.

======  =====================================================  ==================================
kind    test function                                          extended system
======  =====================================================  ==================================
FB      parameter component of the tangent                     F = 0, C(1) q = 0, l.q = 1
BP      determinant of the Jacobian bordered by the tangent    F + nu psi = 0, J'psi = 0, |psi|=1
PD      determinant of C(-1)                                   F = 0, C(-1) q = 0, l.q = 1
NS      product of two multipliers minus one, pole-free        (bracketed)
G       smallest interior gap of each flight and wall          F = 0, flight to a touch at tau = 0
V       velocity of each impact, towards its wall              F = 0, v_k = 0
T       duration of each flight                                F = 0, t_{k+1} - t_k = 0
UZ      a parameter or derived parameter minus a value         F = 0, value reached
======  =====================================================  ==================================

C(mu) is the cyclic block matrix of the orbit with its last coupling multiplied by mu; J is the
Jacobian including the free parameter. Determinants are scaled row by row and have no pole where an
impact velocity vanishes. FB and PD are solved in the standard extended systems of Seydel (1979), BP
in that of Moore (1980).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from .continuation.arclength import bordered, scaled_determinant
from .continuation.branch import Event, Point
from .continuation.events import Located, TestFunction
from .errors import InputError
from .mechanics import stability
from .mechanics.orbit import Linearisation, OrbitProblem

Array = np.ndarray[Any, Any]
EPSILON = float(np.finfo(float).eps)
NEWTON_ITERATIONS = 12


def newton(
    system: Callable[[Array], tuple[Array, Array, Array]], guess: Array, parameter: int
) -> tuple[Array, float, float] | None:
    """Solve a square system to rounding.

    Parameters
    ----------
    system : callable ``system(x) -> (residual, jacobian, rounding)``
        `rounding` bounds the rounding error of each residual.
    guess : ndarray of shape (q,)
    parameter : int
        Position of the parameter among the unknowns.

    Returns
    -------
    x, residual, error
        The solution, its largest residual, and the estimated error of the parameter: the parameter
        row of the inverse Jacobian against the residual and its rounding. None if the iteration
        fails.
    """
    x, best = guess, None
    try:
        for _ in range(NEWTON_ITERATIONS):
            residual, jacobian, rounding = system(x)
            size = float(np.max(np.abs(residual)))
            if not np.isfinite(size) or (
                best is not None and size >= 0.5 * best[1] and best[1] < 1e-10
            ):
                break
            row = np.linalg.solve(jacobian.T, np.eye(len(x))[parameter])
            best = (x, size, float(np.abs(row) @ (np.abs(residual) + rounding)))
            x = x - np.linalg.solve(jacobian, residual)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None
    return best if best is not None and best[1] < 1e-10 else None


def rounding_of(here: Linearisation) -> Array:
    """Bound the rounding of each residual by that of its arguments."""
    return EPSILON * (np.abs(here.jacobian) @ np.abs(here.unknowns) + 1e-300)


class SingularCycle(TestFunction):
    """Where C(mu) is singular: FB for mu = 1, PD for mu = -1."""

    mu: float

    def locate(self, problem: Any, guess: Point, index: int) -> Located | None:
        n = problem.n
        matrix = guess.evaluation.cyclic(self.mu)[:, :-1]  # type: ignore[attr-defined]
        null = np.linalg.svd(matrix)[2][-1]

        def system(x: Array) -> tuple[Array, Array, Array]:
            z, q = x[: n + 1], x[n + 1 :]
            here = problem.evaluate(z)
            cycle = here.cyclic(self.mu)[:, :-1]
            jacobian = np.zeros((2 * n + 1, 2 * n + 1))
            jacobian[:n, : n + 1] = here.jacobian
            jacobian[n : 2 * n, : n + 1] = problem.second_along(z, np.append(q, 0.0), self.mu)
            jacobian[n : 2 * n, n + 1 :] = cycle
            jacobian[2 * n, n + 1 :] = null
            residual = np.concatenate([here.residual, cycle @ q, [null @ q - 1.0]])
            rounding = np.concatenate(
                [rounding_of(here), 2.0 * EPSILON * (np.abs(cycle) @ np.abs(q)), [EPSILON]]
            )
            return residual, jacobian, rounding

        solved = newton(system, np.concatenate([guess.unknowns, null]), n)
        if solved is None:
            return None
        x, residual, error = solved
        return Located(x[: n + 1], residual, error)


class Fold(SingularCycle):
    """FB: the parameter turns back along the branch."""

    kind = "FB"
    mu = 1.0

    def values(self, point: Point) -> Array:
        return point.tangent[-1:]

    def accept(self, event: Event) -> bool:
        """A branch that passes a branch point sideways turns there too, but is not folded."""
        here: Any = event.point.evaluation
        left, _, _ = np.linalg.svd(here.cyclic(1.0)[:, :-1])
        size = float(np.linalg.norm(here.by_parameter))
        return size == 0.0 or abs(float(left[:, -1] @ here.by_parameter)) > 1e-4 * size


class PeriodDoubling(SingularCycle):
    """PD: a multiplier passes -1."""

    kind = "PD"
    mu = -1.0

    def values(self, point: Point) -> Array:
        matrix = point.evaluation.cyclic(-1.0)[:, :-1]  # type: ignore[attr-defined]
        return np.array([scaled_determinant(matrix)])


class BranchPoint(TestFunction):
    """BP: two branches cross."""

    kind = "BP"

    def values(self, point: Point) -> Array:
        return np.array([point.orientation])

    def locate(self, problem: Any, guess: Point, index: int) -> Located | None:
        n = problem.n
        left = np.linalg.svd(guess.evaluation.jacobian)[0][:, -1]

        def system(x: Array) -> tuple[Array, Array, Array]:
            z, nu, psi = x[: n + 1], x[n + 1], x[n + 2 :]
            here = problem.evaluate(z)
            hessian = np.column_stack([problem.second_along(z, e).T @ psi for e in np.eye(n + 1)])
            jacobian = np.zeros((2 * n + 2, 2 * n + 2))
            jacobian[:n, : n + 1] = here.jacobian
            jacobian[:n, n + 1] = psi
            jacobian[:n, n + 2 :] = nu * np.eye(n)
            jacobian[n : 2 * n + 1, : n + 1] = hessian
            jacobian[n : 2 * n + 1, n + 2 :] = here.jacobian.T
            jacobian[2 * n + 1, n + 2 :] = 2.0 * psi
            residual = np.concatenate(
                [here.residual + nu * psi, here.jacobian.T @ psi, [psi @ psi - 1.0]]
            )
            rounding = np.concatenate(
                [
                    rounding_of(here),
                    2.0 * EPSILON * (np.abs(here.jacobian).T @ np.abs(psi)),
                    [EPSILON],
                ]
            )
            return residual, jacobian, rounding

        solved = newton(system, np.concatenate([guess.unknowns, [0.0], left]), n)
        if solved is None or abs(solved[0][n + 1]) > 1e-10:
            return None
        x, residual, error = solved
        return Located(x[: n + 1], residual, error)


class NeimarkSacker(TestFunction):
    """NS: a complex pair of multipliers crosses the unit circle."""

    kind = "NS"
    resolution = 1e-9

    def values(self, point: Point) -> Array:
        here: Any = point.evaluation
        value = stability.neimark_sacker(here.start, here.end)
        return np.array([value if abs(value) > self.resolution else np.nan])

    def accept(self, event: Event) -> bool:
        """Two real multipliers with the product one are a neutral saddle."""
        multipliers = event.point.evaluation.multipliers  # type: ignore[attr-defined]
        on_circle = np.abs(np.abs(multipliers) - 1.0) < 1e-6
        return bool(np.any(on_circle & (np.abs(multipliers.imag) > 1e-8)))


class Grazing(TestFunction):
    """G: a flight touches a wall between its impacts."""

    kind = "G"

    def __init__(self, problem: OrbitProblem) -> None:
        walls = [w.name for w in problem.model.WALLS]
        self.places = [(k, wall) for k in range(len(problem.word)) for wall in walls]

    def values(self, point: Point) -> Array:
        gaps = point.evaluation.gaps  # type: ignore[attr-defined]
        return np.array([np.nan if t is None else t.gap for flight in gaps for t in flight.touches])

    def touch(self, point: Point, index: int) -> Any:
        flight = index // (len(self.places) // len(point.evaluation.gaps))  # type: ignore[attr-defined]
        touches = point.evaluation.gaps[flight].touches  # type: ignore[attr-defined]
        return touches[index % len(touches)]

    def locate(self, problem: Any, guess: Point, index: int) -> Located | None:
        flight, wall = self.places[index]
        touch = self.touch(guess, index)
        if touch is None:
            return None
        n, m = problem.n, problem.m
        own = slice(m * flight, m * flight + m)
        free = [i for i in range(m) if i != 1]  # of the touch, all but its zero velocity
        kernel = problem.kernels.flight(problem.word.walls[flight], wall)

        def split(x: Array) -> tuple[Array, Array]:
            at_touch = np.zeros(m)
            at_touch[free] = x[n + 1 :]
            return x[: n + 1], at_touch

        def system(x: Array) -> tuple[Array, Array, Array]:
            z, at_touch = split(x)
            here = problem.evaluate(z)
            out = np.array(kernel(*z[own].tolist(), *at_touch.tolist(), *problem.values(z)))
            problem.kernel_evaluations += 1
            start, end = out[m : m + 2 * m * m].reshape(2, m, m)
            jacobian = np.zeros((n + m, n + m))
            jacobian[:n, : n + 1] = here.jacobian
            jacobian[n:, own] = start
            jacobian[n:, n] = out[m + 2 * m * m :]
            jacobian[n:, n + 1 :] = end[:, free]
            residual = np.concatenate([here.residual, out[:m]])
            rounding = EPSILON * (np.abs(jacobian) @ np.abs(x))
            return residual, jacobian, rounding

        first = np.zeros(len(free))
        first[0] = touch.time
        guess_all = np.concatenate([guess.unknowns, first])
        if m > 2:  # the other coordinates at the touch, from the (near) linear flight equations
            residual, jacobian, _ = system(guess_all)
            guess_all[n + 2 :] -= np.linalg.lstsq(jacobian[n:, n + 2 :], residual[n:], rcond=None)[
                0
            ]
        solved = newton(system, guess_all, n)
        if solved is None:
            return None
        x, size, error = solved
        z, at_touch = split(x)
        impacts = problem.impacts(z)[:, 0]
        arrival = impacts[flight + 1] if flight + 1 < len(impacts) else np.inf
        if not impacts[flight] < at_touch[0] < arrival:
            return None
        return Located(z, size, error, self._described(flight, wall, at_touch[0]))

    def details(self, point: Point, index: int) -> Mapping[str, Any]:
        flight, wall = self.places[index]
        return {"index": index, **self._described(flight, wall, self.touch(point, index).time)}

    @staticmethod
    def _described(flight: int, wall: str, time: float) -> dict[str, Any]:
        return {"flight": flight, "wall": wall, "touch_time": float(time)}


class ScalarTest(TestFunction):
    """A function of the unknowns with a known gradient: F = 0 and this function = 0."""

    def scalar(self, problem: Any, z: Array, index: int) -> tuple[float, Array]:
        """Return the function and its gradient, shape (n + 1,)."""
        raise NotImplementedError

    def values(self, point: Point) -> Array:
        problem = point.evaluation.problem  # type: ignore[attr-defined]
        return np.array(
            [self.scalar(problem, point.unknowns, i)[0] for i in range(self.count(problem))]
        )

    def count(self, problem: Any) -> int:
        """Return how many functions there are."""
        return len(problem.word)

    def locate(self, problem: Any, guess: Point, index: int) -> Located | None:
        def system(x: Array) -> tuple[Array, Array, Array]:
            here = problem.evaluate(x)
            value, gradient = self.scalar(problem, x, index)
            jacobian = bordered(here.jacobian, gradient)
            residual = np.append(here.residual, value)
            return residual, jacobian, EPSILON * (np.abs(jacobian) @ np.abs(x))

        solved = newton(system, guess.unknowns, problem.n)
        if solved is None:
            return None
        x, residual, error = solved
        return Located(x, residual, error, self.described(problem, index))

    def described(self, problem: Any, index: int) -> dict[str, Any]:
        """What to record of a zero."""
        return {}


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
    """T: a flight's duration vanishes; beyond, impacts are out of order."""

    kind = "T"

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

    def described(self, problem: Any, index: int) -> dict[str, Any]:
        name, wanted = self.requested[index]
        return {"requested": {name: wanted}}


KINDS = ("FB", "BP", "PD", "NS", "G", "V", "T", "UZ")


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
