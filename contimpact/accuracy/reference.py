"""Orbits, multipliers and events to thirty digits and more: what the doubles are compared with.

The generated kernels are evaluated in mpmath's arithmetic. Only the step of Newton's iteration is
computed in double precision, so that an iteration contracts by about the condition number times
1e-16 until the digits asked for stand.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mpmath
import numpy as np

from ..bifurcations.equations import Equations
from ..bifurcations.registry import kind_of
from ..orbits.problem import Array, OrbitProblem
from ..segments.arithmetic import evaluate_in
from ..segments.bounded import many_digits

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
