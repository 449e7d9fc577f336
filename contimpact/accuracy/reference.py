r"""Orbits, multipliers and events to thirty digits and more: what the doubles are compared with.

The generated kernels are evaluated in mpmath's arithmetic. Parameters are the model's doubles,
taken as exact. Every system is written down anew from residuals and blocks alone: the second
derivatives of the library, its Jacobians and its step control have no part in what a solution is.
Only the step of Newton's iteration is computed in double precision, so that an iteration contracts
by about the condition number times 1e-16 until the digits asked for stand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np

from ..bifurcations.kind import System
from ..bifurcations.registry import kind_of
from ..bifurcations.requested import PERIOD
from ..orbits.problem import Array, OrbitProblem
from ..segments.arithmetic import evaluate_in
from ..segments.bounded import many_digits
from ..segments.layout import SECTION

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


class Reference:
    """The orbit problem of a word, and the systems of its events, in many digits.

    Parameters
    ----------
    problem : OrbitProblem
        Gives the word, the parameters' doubles and the kernels.
    digits : int
        Digits to reach; the arithmetic carries some more.
    """

    def __init__(self, problem: OrbitProblem, digits: int = 30) -> None:
        self.problem, self.digits = problem, digits
        self.ctx = mpmath.mp.clone()
        self.ctx.dps = digits + GUARD_DIGITS
        self.arithmetic = many_digits(self.ctx)
        values = problem.model.values
        self._values = [self.ctx.mpf(value) for value in values.values()]
        self._free = list(values).index(problem.parameter)

    # Solutions.

    def orbit(self, unknowns: Array, held: int = -1) -> Exact | None:
        """Return the orbit next to a point that shares one of its unknowns.

        Parameters
        ----------
        held : int
            Which unknown; by default the free parameter.

        Returns
        -------
        Exact or None
            None where the iteration does not converge.
        """
        point = [float(u) for u in unknowns]
        row = np.zeros(len(point))
        row[held] = 1.0
        jacobian = np.vstack([self.problem.evaluate(np.array(point)).jacobian, row])
        solved = self._solve(lambda x: [*self.residual(x), x[held] - point[held]], point, jacobian)
        return Exact(solved[0], [], *solved[1:]) if solved is not None else None

    def event(
        self, kind: str, unknowns: Array, details: Mapping[str, Any] | None = None
    ) -> Exact | None:
        """Return the event of a kind next to a point.

        None where the iteration does not converge, and for a kind without such equations.

        Parameters
        ----------
        details : mapping, optional
            As `Event.details` has them: for G ``flight``, ``wall`` and ``touch_time``, for V
            ``impact``, for T ``flight``, for UZ ``requested``.
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

    def multipliers(self, unknowns: Sequence[Any]) -> list[Any]:
        """Return the multipliers, largest first, from the product of the flights' maps.

        Products are safe here: their loss is made good by digits. For m = 2 alone.
        """
        ctx = self.ctx
        _, flights = self.flights(unknowns, held=True)
        with ctx.extradps(30 + 4 * len(flights)):
            total, product = ctx.eye(2), ctx.one
            for a, b, _ in flights:
                below = b[0, 0] * b[1, 1] - b[0, 1] * b[1, 0]
                inverse = ctx.matrix([[b[1, 1], -b[0, 1]], [-b[1, 0], b[0, 0]]])
                total = -(inverse * a) * total / below
                product *= (a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]) / below
            half = (total[0, 0] + total[1, 1]) / 2
            root = ctx.sqrt(half**2 - product)
            large = half + root if abs(half + root) >= abs(half - root) else half - root
            both = [+large, product / large if large else ctx.zero]
            return both[:1] if self.problem.autonomous else both

    # Residual and blocks.

    def flights(
        self, z: Sequence[Any], held: bool = False
    ) -> tuple[list[Any], list[tuple[Any, Any, list[Any]]]]:
        """Return the residuals, and for each flight its blocks A, B and derivative by lambda.

        Where the period is free, B of the last flight is without its first column, or A of the
        first if the first passage's time is to be held.
        """
        problem, ctx = self.problem, self.ctx
        m, n = problem.m, problem.n
        p = self.values(z)
        setup = self.setup(p)
        turns, closing = problem.word.period, problem.closing(z[0], setup.period)
        residual: list[Any] = []
        blocks = []
        for k, segment in enumerate(problem.segments):
            j = m * k + m
            arrival = z[j : j + m] if j < n else [closing, *z[1:m]]
            arrival = arrival if problem.word.walls else z[:m]
            left = self.leaving(z, k)
            rows, *entries, by_parameter = segment.over(self.arithmetic)(left, arrival, p)
            residual += rows
            start, end = (ctx.matrix([e[m * r : m * r + m] for r in range(m)]) for e in entries)
            if j == n and problem.word.walls:
                drift = turns * setup.slopes[0]
                by_parameter = tuple(g + drift * end[r, 0] for r, g in enumerate(by_parameter))
                if problem.autonomous and not held:
                    end[:, 0] *= 0
            if problem.autonomous and held and problem.word.walls and k == 0:
                start[:, 0] *= 0
            if problem.autonomous and not problem.word.walls:
                start[:, 1] *= 0
            blocks.append((start, end, list(by_parameter)))
        return residual, blocks

    def leaving(self, z: Sequence[Any], flight: int) -> list[Any]:
        """Return where a flight leaves; without impacts and forcing, where a coordinate turns."""
        m = self.problem.m
        return self.problem.leaves(list(z[m * flight : m * flight + m])).tolist()

    def residual(self, z: Sequence[Any]) -> list[Any]:
        """Return the residuals of the orbit problem."""
        return self.flights(z)[0]

    def values(self, z: Sequence[Any]) -> list[Any]:
        """Return all parameter values at a point."""
        values = self._values.copy()
        values[self._free] = self.ctx.mpf(z[-1])
        return values

    def flight(self, a: str, b: str) -> Callable[..., Any]:
        """Return the kernel of a flight in this arithmetic."""
        return evaluate_in(self.problem.kernels.flight(a, b), self.arithmetic)

    def setup(self, p: Sequence[Any]) -> Any:
        """Return what the kernel ``setup`` says at parameter values."""
        return evaluate_in(self.problem.kernels.setup, self.arithmetic)(*p)

    # Systems.

    def vanishing(self, function: Callable[[list[Any]], Any]) -> System:
        """Return F = 0 and a function = 0."""
        return lambda x: [*self.residual(x), function(x)], []

    def singular(self, z: Array, mu: float) -> System:
        """F = 0, C(mu) q = 0, l.q = 1."""
        n = self.problem.n
        null = np.linalg.svd(self.problem.evaluate(z).cyclic(mu)[:, :-1])[2][-1].tolist()

        def system(x: list[Any]) -> list[Any]:
            residual, blocks = self.flights(x[: n + 1])
            q = x[n + 1 :]
            size = sum((a * b for a, b in zip(null, q, strict=True)), self.ctx.mpf(-1))
            return [*residual, *self._cycle(blocks, q, mu), size]

        return system, null

    def singular_pair(self, null: Array, mu: complex) -> System:
        """F = 0, C(c + i s) (p + i q) = 0, the length and phase of p + i q held, c^2 + s^2 = 1."""
        n = self.problem.n
        bar = [self.ctx.mpc(complex(c).conjugate()) for c in null]

        def system(x: list[Any]) -> list[Any]:
            residual, blocks = self.flights(x[: n + 1])
            p, q, (c, s) = x[n + 1 : 2 * n + 1], x[2 * n + 1 : 3 * n + 1], x[3 * n + 1 :]
            whole = [self.ctx.mpc(a, b) for a, b in zip(p, q, strict=True)]
            rows = self._cycle(blocks, whole, self.ctx.mpc(c, s))
            size = sum((a * b for a, b in zip(bar, whole, strict=True)), self.ctx.mpf(-1))
            parts = [*(row.real for row in rows), *(row.imag for row in rows)]
            return [*residual, *parts, size.real, size.imag, c * c + s * s - 1]

        return system, [*null.real.tolist(), *null.imag.tolist(), mu.real, mu.imag]

    def _cycle(self, blocks: Sequence[Any], q: Sequence[Any], mu: Any) -> list[Any]:
        """The cyclic matrix with its last coupling multiplied by mu, times a vector."""
        m, count = self.problem.m, len(blocks)
        rows = []
        for k, (start, end, _) in enumerate(blocks):
            j = (k + 1) % count
            factor = mu if k == count - 1 else 1
            for r in range(m):
                own = sum(start[r, c] * q[m * k + c] for c in range(m))
                rows += [own + factor * sum(end[r, c] * q[m * j + c] for c in range(m))]
        return rows

    def branch_point(self, z: Array) -> System:
        """F + nu psi = 0, J' psi = 0, |psi| = 1."""
        n, m = self.problem.n, self.problem.m
        left = np.linalg.svd(self.problem.evaluate(z).jacobian)[0][:, -1].tolist()

        def system(x: list[Any]) -> list[Any]:
            residual, blocks = self.flights(x[: n + 1])
            nu, psi = x[n + 1], x[n + 2 :]
            columns = [self.ctx.zero] * (n + 1)
            for k, (start, end, by_parameter) in enumerate(blocks):
                j = (k + 1) % len(blocks)
                for r in range(m):
                    weight = psi[m * k + r]
                    for c in range(m):
                        columns[m * k + c] += start[r, c] * weight
                        columns[m * j + c] += end[r, c] * weight
                    columns[n] += by_parameter[r] * weight
            shifted = [f + nu * w for f, w in zip(residual, psi, strict=True)]
            return [*shifted, *columns, sum(w * w for w in psi) - 1]

        return system, [0.0, *left]

    def grazing(self, z: Array, details: Mapping[str, Any]) -> System:
        """F = 0, and a flight to a touch of zero velocity."""
        problem = self.problem
        m, n = problem.m, problem.n
        flight, wall = details["flight"], details["wall"]
        kernel = self.flight(problem.word.walls[flight : flight + 1] or SECTION, wall)

        def system(x: list[Any]) -> list[Any]:
            touch, left = [x[n + 1], self.ctx.zero, *x[n + 2 :]], self.leaving(x, flight)
            rows, _, _, _ = kernel(*left, *touch, *self.values(x[: n + 1]))
            return [*self.residual(x[: n + 1]), *rows]

        return system, [float(details["touch_time"]), *[0.0] * (m - 2)]

    def product(self, z: list[Any]) -> Any:
        """The product of all multipliers; for m = 2 a pair on the unit circle has the product 1."""
        total = self.ctx.one
        for start, end, _ in self.flights(z, held=True)[1]:
            total *= self.ctx.det(start) / self.ctx.det(end)
        return total

    def duration(self, z: list[Any], flight: int) -> Any:
        m, n = self.problem.m, self.problem.n
        i, j = m * flight, m * flight + m
        if j < n:
            return z[j] - z[i]
        period = self.setup(self.values(z)).period
        return self.problem.closing(z[0], period) - z[i]

    def requested(self, z: list[Any], requested: Mapping[str, float]) -> Any:
        ((name, wanted),) = requested.items()
        if name == self.problem.parameter:
            return z[-1] - wanted
        if name == PERIOD:
            return self.problem.closing(z[0], 0) - z[0] - wanted
        place = self.problem.model.DERIVED.index(name)
        return self.setup(self.values(z)).derived[place] - wanted

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
