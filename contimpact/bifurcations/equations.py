"""The equations of orbits and of their events, in any arithmetic.

They are stated from the segments' residuals and blocks alone: many digits (`accuracy.reference`),
balls (`certificates.equations`) and series evaluate the same text, in which the second derivatives
of `extended_system` have no part. Parameters are the model's doubles, taken as exact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from typing import Any, TypeAlias

from ..arrays import Array, Number
from ..continuation.branch import Details
from ..orbits.problem import OrbitProblem
from ..segments.kernel import SECTION
from ..segments.segment import Arithmetic, evaluate_in
from .extended_system import Crossing, SingularCycle

Flight: TypeAlias = tuple[list[Any], list[Any], list[Any], list[Any]]
"""Residual, A, B and derivative by lambda of a flight, row by row."""

System: TypeAlias = tuple[Callable[[list[Number]], list[Number]], list[float]]
"""A function of all unknowns, as a list, with a guess of those beyond the orbit's."""


class Equations:
    """The orbit problem of a word in one free parameter, and the systems of its events."""

    def __init__(self, problem: OrbitProblem, arithmetic: Arithmetic) -> None:
        self.problem, self.arithmetic = problem, arithmetic
        self.number = arithmetic.number
        values = problem.model.values
        self._values = [self.number(value) for value in values.values()]
        self._free = list(values).index(problem.parameter)
        self._segments = [segment.over(arithmetic) for segment in problem.segments]
        self._setup = evaluate_in(problem.kernels.setup, arithmetic)

    # The orbit.

    def values(self, z: Sequence[Number]) -> list[Any]:
        """Return all parameter values at a point."""
        values = self._values.copy()
        values[self._free] = self.number(z[-1])
        return values

    def setup(self, values: Sequence[Number]) -> Any:
        """Return what the kernel ``setup`` says at parameter values."""
        return self._setup(*values)

    def closing(self, z: Sequence[Number]) -> Number:
        """Return when the orbit closes."""
        return self.problem.closing(z[0], self.setup(self.values(z)).period)

    def impacts(self, z: Sequence[Number]) -> list[list[Any]]:
        """Return the unknowns of each impact, those of the first once more at the end, a period
        later."""
        if not self.problem.word.walls:
            return []
        m = self.problem.m
        rows = [list(z[i : i + m]) for i in range(0, self.problem.n, m)]
        return [*rows, [self.closing(z), *z[1:m]]]

    def leaving(self, z: Sequence[Number], flight: int) -> list[Any]:
        """Return where a flight leaves; without impacts and forcing, where a coordinate turns."""
        m, problem = self.problem.m, self.problem
        time, *others = z[m * flight : m * flight + m]
        if problem.word.walls:
            return [self.arithmetic.time(time), *others]
        return [time, self.number(0), *others[1:]] if problem.autonomous else [time, *others]

    def flight(self, k: int, start: list[Any], end: list[Any], values: list[Any]) -> Flight:
        """Return residual and blocks of a flight between the unknowns of two impacts."""
        rows = self._segments[k](self.leaving(start, 0), end, values)
        residual, first, last, free = ([self.number(x) for x in row] for row in rows)
        return residual, first, last, free

    def between(self, ends: Iterable[tuple[list[Any], list[Any]]], values: list[Any]) -> list[Any]:
        """Return residual and blocks of flights between given ends, the last one's a period later
        than an unknown."""
        found = [self.flight(k, *pair, values) for k, pair in enumerate(ends)]
        residual, first, last, free = found[-1]
        if self.problem.word.walls:
            m, turns = self.problem.m, self.problem.word.period
            slope = self.setup(values).slopes[0]
            drift = [turns * slope * last[m * row] for row in range(m)]
            free = [g + d for g, d in zip(free, drift, strict=True)]
        return [*found[:-1], (residual, first, last, free)]

    def flights(self, z: Sequence[Number], held: bool = False) -> list[Flight]:
        """Return residual and blocks of every flight.

        Where the period is free, B of the last flight is without its first column, or A of the
        first one if the first passage's time is to be held.
        """
        problem, values = self.problem, self.values(z)
        if not problem.word.walls:
            state = list(z[: problem.m])
            found = self.between([(state, state)], values)
        else:
            found = self.between(pairwise(self.impacts(z)), values)
        if problem.autonomous:
            place, part, column = (-1, 2, 0) if problem.word.walls else (0, 1, 1)
            if held and problem.word.walls:
                place, part = 0, 1
            flight = list(found[place])
            flight[part] = [
                self.number(0) if i % problem.m == column else x for i, x in enumerate(flight[part])
            ]
            found[place] = tuple(flight)
        return found

    def residual(self, z: Sequence[Number]) -> list[Any]:
        """Return the residuals of the orbit problem."""
        return residuals_of(self.flights(z))

    def jacobian(self, flights: Sequence[Flight]) -> list[list[Any]]:
        """Return the Jacobian of the orbit problem, row by row."""
        free = (x for _, _, _, by_parameter in flights for x in by_parameter)
        cyclic = cyclic_matrix(flights, 1, self.number(0))
        return [[*row, x] for row, x in zip(cyclic, free, strict=True)]

    # Systems of events.

    def vanishing(self, function: Callable[[list[Any]], Any]) -> System:
        """F = 0, and a function of the unknowns is zero."""
        return lambda x: [*self.residual(x), function(x)], []

    def singular(self, z: Array, mu: float) -> System:
        """F = 0, C(mu) q = 0, l.q = 1."""
        n = self.problem.n
        null = SingularCycle(self.problem, mu).start(self.problem.evaluate(z)).tolist()

        def system(x: list[Any]) -> list[Any]:
            flights, q = self.flights(x[: n + 1]), x[n + 1 :]
            return [*residuals_of(flights), *self._cycle(flights, q, mu), self._dot(null, q, -1)]

        return system, null

    def singular_pair(self, phase: Array, own: Array) -> System:
        """F = 0, C_0 q_k + C_1 q_(k+1) = 0 for k = 0 and 1 with q_2 = 2 kappa q_1 - q_0, the length
        and phase of (q_0, q_1) held."""
        n, plane, held = self.problem.n, own[:-1].tolist(), phase.tolist()

        def system(x: list[Any]) -> list[Any]:
            flights = self.flights(x[: n + 1])
            q, kappa = x[n + 1 : -1], x[-1]
            first, whole = ([self._cycle(flights, p, mu) for p in (q[:n], q[n:])] for mu in (0, 1))
            last = [
                [a - b for a, b in zip(*pair, strict=True)]
                for pair in zip(whole, first, strict=True)
            ]
            return [
                *residuals_of(flights),
                *(a + b for a, b in zip(first[0], last[1], strict=True)),
                *(a + 2 * kappa * c - b for a, b, c in zip(first[1], *last, strict=True)),
                self._dot(plane, q, -1),
                self._dot(held, q),
            ]

        return system, own.tolist()

    def branch_point(self, z: Array) -> System:
        """F + nu psi = 0, J' psi = 0, |psi| = 1."""
        n = self.problem.n
        left = Crossing(self.problem).start(self.problem.evaluate(z))[1:].tolist()

        def system(x: list[Any]) -> list[Any]:
            flights = self.flights(x[: n + 1])
            nu, psi = x[n + 1], x[n + 2 :]
            shifted = [f + nu * w for f, w in zip(residuals_of(flights), psi, strict=True)]
            columns = zip(*self.jacobian(flights), strict=True)
            return [
                *shifted,
                *(self._dot(column, psi) for column in columns),
                self._dot(psi, psi) - 1,
            ]

        return system, [0.0, *left]

    def grazing(self, z: Array, details: Details) -> System:
        """F = 0, and a flight to a touch of zero velocity."""
        m, n = self.problem.m, self.problem.n
        flight = details["flight"] if self.problem.word.walls else 0
        letter = self.problem.word.walls[flight] if self.problem.word.walls else SECTION
        reach = self.problem.kernels.segment(letter, details["wall"]).over(self.arithmetic)

        def system(x: list[Any]) -> list[Any]:
            orbit, touch = x[: n + 1], [x[n + 1], self.number(0), *x[n + 2 :]]
            rows = reach(self.leaving(x, flight), touch, self.values(orbit))[0]
            return [*self.residual(orbit), *map(self.number, rows)]

        return system, [float(details["touch_time"]), *[0.0] * (m - 2)]

    def leaving_without_rate(self, impact: int, wall: str) -> System:
        """F = 0, and a flight leaves a guard's surface, which it would reach at once, at rest."""
        reach = self.problem.kernels.segment(self.problem.word.walls[impact], wall)
        rows, rest = reach.over(self.arithmetic), [self.number(0)] * (self.problem.m - 1)

        def rate(x: list[Any]) -> Any:
            start = self.impacts(x)[impact]
            return self.number(
                rows(self.leaving(start, 0), [start[0], *rest], self.values(x))[0][1]
            )

        return self.vanishing(rate)

    def duration(self, z: list[Any], flight: int) -> Any:
        """A flight's duration."""
        rows = self.impacts(z[: self.problem.n + 1])
        return rows[flight + 1][0] - rows[flight][0]

    def _cycle(self, flights: Sequence[Flight], q: Sequence[Any], mu: float) -> list[Any]:
        """The cyclic matrix with its last coupling multiplied by mu, times a vector."""
        m, rows = self.problem.m, []
        later = [*q[m:], *(mu * c for c in q[:m])]
        for k, (_, start, end, _) in enumerate(flights):
            i = m * k
            for r in range(m):
                a, b = start[m * r : m * r + m], end[m * r : m * r + m]
                rows.append(self._dot(a, q[i : i + m]) + self._dot(b, later[i : i + m]))
        return rows

    def _dot(self, a: Iterable[Any], b: Iterable[Any], beside: int = 0) -> Any:
        return sum((x * y for x, y in zip(a, b, strict=True)), self.number(beside))


def residuals_of(flights: Iterable[Flight]) -> list[Any]:
    """Return the residuals of all flights."""
    return [row for flight in flights for row in flight[0]]


def cyclic_matrix(flights: Sequence[Flight], mu: Any, zero: Any) -> list[list[Any]]:
    """Return the cyclic matrix, its last coupling multiplied by mu, row by row."""
    m, last = len(flights[0][0]), len(flights) - 1
    n, rows = m * len(flights), []
    for k, (_, start, end, _) in enumerate(flights):
        for r in range(m):
            row = [zero] * n
            for c in range(m):
                moved = end[m * r + c] if k < last or mu == 1 else mu * end[m * r + c]
                row[m * k + c] += start[m * r + c]
                row[(m * k + m + c) % n] += moved
            rows.append(row)
    return rows
