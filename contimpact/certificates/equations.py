"""The equations of orbits and events in balls, and zeros proven by Krawczyk's operator.

Residuals and blocks are those of the generated kernels, evaluated on balls. Parameters are the
model's doubles, taken as exact. The systems of the events are stated by each kind, as for many
digits; their Jacobians come from power series of two terms.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from flint import arb, arb_mat, arb_series, ctx

from ..arrays import Array
from ..bifurcations.kind import System
from ..continuation.branch import Details
from ..orbits.problem import OrbitProblem
from ..segments.arithmetic import evaluate_in
from ..segments.ball_flow import Number, number
from ..segments.balls import Time, balls
from ..segments.layout import SECTION

Balls: TypeAlias = list[Any]
"""Numbers of this arithmetic: ``arb``, or ``arb_series`` of them."""

Flight: TypeAlias = tuple[Balls, Balls, Balls, Balls]
"""Residual, A, B and derivative by lambda of a flight, row by row."""


class BallProblem:
    """The orbit problem of a word, and the systems of its events, in balls.

    Parameters
    ----------
    problem : OrbitProblem
        Gives the word, the parameters' doubles and the kernels.
    bits : int
        Precision of the constants; numbers have that of Arb's context.
    """

    def __init__(self, problem: OrbitProblem, bits: int) -> None:
        self.problem, self.bits = problem, bits
        self.arithmetic = balls(bits)
        values = problem.model.values
        self._values = [arb(value) for value in values.values()]
        self._free = list(values).index(problem.parameter)
        self._segments = [segment.over(self.arithmetic) for segment in problem.segments]
        self._setup = evaluate_in(problem.kernels.setup, self.arithmetic)
        self._memory: dict[Any, Any] | None = None

    def values(self, z: Sequence[Number]) -> Balls:
        """Return all parameter values at a point."""
        values = self._values.copy()
        values[self._free] = z[-1]
        return values

    def setup(self, values: Sequence[Number]) -> Any:
        """Return what the kernel ``setup`` says at parameter values."""
        return self._setup(*values)

    def span(self, z: Sequence[Number]) -> Number:
        """Return the orbit's period."""
        return self.problem.word.period * self.setup(self.values(z)).period

    def impacts(self, z: Sequence[Number]) -> list[Balls]:
        """Return the unknowns of each impact, those of the first once more at the end, a period
        later."""
        m = self.problem.m
        rows = [list(z[i : i + m]) for i in range(0, self.problem.n, m)]
        return [*rows, [z[0] + self.span(z), *z[1:m]]]

    def flights(self, z: Sequence[Number]) -> list[Flight]:
        """Return residual and blocks of every flight."""
        values, rows = self.values(z), self.impacts(z)
        m, turns = self.problem.m, self.problem.word.period
        found = []
        for k, (start, end) in enumerate(itertools.pairwise(rows)):
            given = (*z[m * k : m * k + 2 * m], *z[:m], z[-1]) if self._memory is not None else ()
            found.append(self._remembered(k, given, start, end, values))
        residual, first, last, by_parameter = found[-1]
        slope = self.setup(values).slopes[0]
        drift = [turns * slope * last[m * row] for row in range(m)]
        moved = [g + d for g, d in zip(by_parameter, drift, strict=True)]
        return [*found[:-1], (residual, first, last, moved)]

    def _remembered(self, k: int, given: Any, start: Balls, end: Balls, values: Balls) -> Flight:
        """A flight of the same numbers as before is not evaluated again."""
        if self._memory is None:
            return self.flight(k, start, end, values)
        key = (k, *map(id, given))
        if key not in self._memory:
            self._memory[key] = given, self.flight(k, start, end, values)
        flight: Flight = self._memory[key][1]
        return flight

    def flight(self, k: int, start: Balls, end: Balls, values: Balls) -> Flight:
        """Return residual and blocks of a flight between the unknowns of two impacts."""
        leaving = [Time(start[0]), *start[1:]]
        rows = self._segments[k](leaving, end, values)
        residual, first, last, free = ([number(x) for x in row] for row in rows)
        return residual, first, last, free

    def residual(self, z: Sequence[Number]) -> Balls:
        """Return the residuals of the orbit problem."""
        return [row for flight in self.flights(z) for row in flight[0]]

    def quiet_flight(self, state: Balls, values: Balls) -> Flight:
        """Return residual and blocks of the flight of all periods from a state at the time zero,
        back to it.

        Raises ArithmeticError if it does not lead back.
        """
        segment = self.problem.kernels.segment(SECTION, str(self.problem.word.period))
        rows = segment.over(self.arithmetic)(state, state, values)
        residual, first, last, free = ([number(x) for x in row] for row in rows)
        if not all(x.contains(0) for x in residual):
            raise ArithmeticError("the orbit without impacts is not closed")
        return residual, first, last, free

    def motion(self, wall: str, other: str | None = None) -> Callable[..., Any]:
        """Return the kernel of the motion after a wall: ``motion(start, dt, values)``.

        It is that of the displacement from the wall, or of the gap coordinate of another one.
        """
        kernels = self.problem.kernels
        kernel = kernels.motion(wall) if other is None else kernels.gap(wall, other)
        function = evaluate_in(kernel, self.arithmetic)
        return lambda start, dt, values: function(Time(start[0]), *start[1:], dt, *values)

    # Systems of events; see `bifurcations.kind.ManyDigits`.

    def vanishing(self, function: Callable[[list[Any]], Any]) -> System:
        """F = 0, and a function = 0."""
        return lambda x: [*self.residual(x), function(x)], []

    def singular(self, z: Array, mu: float) -> System:
        """F = 0, C(mu) q = 0, l.q = 1."""
        n = self.problem.n
        null = np.linalg.svd(self.problem.evaluate(z).cyclic(mu)[:, :-1])[2][-1].tolist()

        def system(x: list[Any]) -> list[Any]:
            flights = self.flights(x[: n + 1])
            q = x[n + 1 :]
            size = sum((a * b for a, b in zip(null, q, strict=True)), arb(-1))
            return [*_residuals(flights), *self._cycle(flights, q, mu), size]

        return system, null

    def _cycle(self, flights: Sequence[Flight], q: Sequence[Any], mu: float) -> Balls:
        """The cyclic matrix with its last coupling multiplied by mu, times a vector."""
        m, rows = self.problem.m, []
        later = [*q[m:], *(mu * c for c in q[:m])]
        for k, (_, start, end, _) in enumerate(flights):
            i = m * k
            for r in range(m):
                a, b = start[m * r : m * r + m], end[m * r : m * r + m]
                rows.append(_dot(a, q[i : i + m]) + _dot(b, later[i : i + m]))
        return rows

    def singular_pair(self, null: Array, mu: complex) -> System:
        """F = 0, C(c + i s) (p + i q) = 0, the length and phase of p + i q held, c^2 + s^2 = 1."""
        n = self.problem.n
        re, im = null.real.tolist(), null.imag.tolist()

        def system(x: list[Any]) -> list[Any]:
            flights = self.flights(x[: n + 1])
            p, q, (c, s) = x[n + 1 : 2 * n + 1], x[2 * n + 1 : 3 * n + 1], x[3 * n + 1 :]
            first_p, first_q = (self._cycle(flights, part, 0) for part in (p, q))
            whole_p, whole_q = (self._cycle(flights, part, 1) for part in (p, q))
            last_p = [a - b for a, b in zip(whole_p, first_p, strict=True)]
            last_q = [a - b for a, b in zip(whole_q, first_q, strict=True)]
            ends = list(zip(last_p, last_q, strict=True))
            return [
                *_residuals(flights),
                *(a + c * x - s * y for a, (x, y) in zip(first_p, ends, strict=True)),
                *(b + c * y + s * x for b, (x, y) in zip(first_q, ends, strict=True)),
                _dot(re, p) + _dot(im, q) - 1,
                _dot(re, q) - _dot(im, p),
                c * c + s * s - 1,
            ]

        return system, [*re, *im, mu.real, mu.imag]

    def branch_point(self, z: Array) -> System:
        """F + nu psi = 0, J' psi = 0, |psi| = 1."""
        n = self.problem.n
        left = np.linalg.svd(self.problem.evaluate(z).jacobian)[0][:, -1].tolist()

        def system(x: list[Any]) -> list[Any]:
            flights = self.flights(x[: n + 1])
            nu, psi = x[n + 1], x[n + 2 :]
            shifted = [f + nu * w for f, w in zip(_residuals(flights), psi, strict=True)]
            columns = zip(*self.jacobian(flights), strict=True)
            return [*shifted, *(_dot(column, psi) for column in columns), _dot(psi, psi) - 1]

        return system, [0.0, *left]

    def jacobian(self, flights: Sequence[Flight]) -> list[Balls]:
        """Return the Jacobian of the orbit problem, row by row."""
        m, n = self.problem.m, self.problem.n
        rows: list[Balls] = []
        for k, (_, start, end, by_parameter) in enumerate(flights):
            for r in range(m):
                row: Balls = [arb(0)] * n + [by_parameter[r]]
                for c in range(m):
                    row[m * k + c] += start[m * r + c]
                    row[(m * k + m + c) % n] += end[m * r + c]
                rows.append(row)
        return rows

    def grazing(self, z: Array, details: Details) -> System:
        """F = 0, and a flight to a touch of zero velocity."""
        m, n = self.problem.m, self.problem.n
        flight, wall = details["flight"], details["wall"]
        segment = self.problem.kernels.segment(self.problem.word.walls[flight], wall)
        reach = segment.over(self.arithmetic)

        def system(x: list[Any]) -> list[Any]:
            start = x[m * flight : m * flight + m]
            touch = [x[n + 1], arb(0), *x[n + 2 :]]
            rows = reach([Time(start[0]), *start[1:]], touch, self.values(x[: n + 1]))[0]
            return [*self.residual(x[: n + 1]), *map(number, rows)]

        return system, [float(details["touch_time"]), *[0.0] * (m - 2)]

    def product(self, z: list[Any]) -> Any:
        """The product of all multipliers; for m = 2 a pair on the unit circle has the product 1."""
        total = arb(1)
        for _, start, end, _ in self.flights(z):
            total *= _determinant(start) / _determinant(end)
        return total

    def duration(self, z: list[Any], flight: int) -> Any:
        """A flight's duration."""
        rows = self.impacts(z[: self.problem.n + 1])
        return rows[flight + 1][0] - rows[flight][0]

    def requested(self, z: list[Any], requested: Mapping[str, float]) -> Any:
        """How far a parameter is from the value asked for."""
        ((name, wanted),) = requested.items()
        if name == self.problem.parameter:
            return z[-1] - wanted
        place = self.problem.model.DERIVED.index(name)
        return self.setup(self.values(z)).derived[place] - wanted

    # Jacobians of systems.

    def linearised(self, system: Callable[[list[Any]], list[Any]], x: Balls) -> Any:
        """Return the Jacobian of a system, an ``arb_mat``."""
        self._memory = {}
        try:
            columns = [self._column(system, x, i) for i in range(len(x))]
        finally:
            self._memory = None
        return arb_mat([list(row) for row in zip(*columns, strict=True)])

    @staticmethod
    def _column(system: Callable[[list[Any]], list[Any]], x: Balls, i: int) -> Balls:
        moved = arb_series([x[i], 1], prec=2)
        rows = system([*x[:i], moved, *x[i + 1 :]])
        return [row[1] if isinstance(row, arb_series) else arb(0) for row in rows]


def _residuals(flights: Iterable[Flight]) -> Balls:
    return [row for flight in flights for row in flight[0]]


def _dot(a: Iterable[Any], b: Iterable[Any]) -> Any:
    return sum((x * y for x, y in zip(a, b, strict=True)), arb(0))


def _determinant(block: Sequence[Any]) -> Any:
    """Of a block of two rows, as a number or a series; of a larger one, as a number."""
    if len(block) == 4:
        return block[0] * block[3] - block[1] * block[2]
    size = round(len(block) ** 0.5)
    return arb_mat(size, size, list(block)).det()


# Krawczyk's test: a zero of a system exists, and is the only one, in a box.
#
# For a box X with midpoint x, a matrix Y near the inverse of f'(x), and a matrix J that encloses f'
# on X, let
#
# .. math:: K = x - Y f(x) + (I - Y J)(X - x) .
#
# If K lies in the interior of X, there is exactly one zero of f in X, it lies in K, and f' is
# regular
# on X (Krawczyk 1969; Moore 1977; Neumaier, Interval Methods for Systems of Equations, 1990, ch.
# 5).

Function: TypeAlias = Callable[[list[Any]], list[Any]]

STEPS = 12
"""Newton steps at most; doubles are right to some digits from the beginning."""

ROUNDING = 1e-18
"""Steps below this that fall no more are those of rounding, where a system is ill-conditioned."""

WIDTHS = (1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
"""Radii of boxes tried, relative, the widest first: the wider, the more the uniqueness says."""


def refine_zero(space: BallProblem, system: Function, guess: Sequence[float]) -> Balls | None:
    """Return a zero to the digits of the context, by Newton's iteration; nothing is proven by it.

    None where the iteration does not converge.
    """
    x, before = [arb(value) for value in guess], arb(1)
    inverse = preconditioner(space, system, x)
    for _ in range(STEPS if inverse is not None else 0):
        step = (inverse * column([f.mid() for f in system(x)])).entries()
        if not all(s.is_finite() for s in step):
            return None
        x = [(value - s).mid() for value, s in zip(x, step, strict=True)]
        size = max(abs(s).upper() / (1 + abs(v)).lower() for s, v in zip(step, x, strict=True))
        if size < arb(2) ** (12 - ctx.prec) or (size < ROUNDING and 2 * size > before):
            return x
        before = size
    return None


def preconditioner(space: BallProblem, system: Function, x: Balls) -> Any:
    """Return the inverse of the Jacobian in doubles, as an exact matrix; None without one."""
    matrix = to_doubles(space.linearised(system, [value.mid() for value in x]))
    try:
        inverse = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return None
    return arb_mat(inverse.tolist()) if np.isfinite(inverse).all() else None


def to_doubles(matrix: Any) -> Any:
    """Return the midpoints of an ``arb_mat``."""
    return np.array([[float(x.mid()) for x in row] for row in matrix.tolist()])


def krawczyk(space: BallProblem, system: Function, box: Balls, inverse: Any = None) -> Balls | None:
    """Return K for a box, if the test proves exactly one zero in it, else None.

    Parameters
    ----------
    inverse : arb_mat, optional
        Y, any exact matrix; by default the inverse of the Jacobian at the midpoint, in doubles.
    """
    middle = [value.mid() for value in box]
    inverse = preconditioner(space, system, middle) if inverse is None else inverse
    if inverse is None:
        return None
    offset = column([b - m for b, m in zip(box, middle, strict=True)])
    defect = _identity(len(box)) - inverse * space.linearised(system, box)
    change = (defect * offset - inverse * column(system(middle))).entries()
    image = [m + c for m, c in zip(middle, change, strict=True)]
    inside = (b.contains_interior(i) for b, i in zip(box, image, strict=True))
    return image if all(inside) else None


def column(values: Sequence[Any]) -> Any:
    return arb_mat([[value] for value in values])


def _identity(size: int) -> Any:
    return arb_mat([[int(i == j) for j in range(size)] for i in range(size)])


def prove_zero(
    space: BallProblem, system: Function, guess: Sequence[float]
) -> tuple[Balls, Balls] | None:
    """Return a box with exactly one zero around a guess, and a small one that holds the zero.

    The box holds the guess. None where the test fails.
    """
    found = refine_zero(space, system, guess)
    if found is None:
        return None
    inverse = preconditioner(space, system, found)
    for width in WIDTHS:
        box = [_ball_around(x, g, width) for x, g in zip(found, guess, strict=True)]
        if krawczyk(space, system, box, inverse) is not None:
            small = _smallest(space, system, found, inverse)
            return None if small is None else (box, small)
    return None


def _ball_around(x: Any, guess: float, width: float) -> Any:
    """A ball around a zero that holds the guess."""
    least = 2 * abs(x - guess).upper()
    return x + arb(0, 1) * max(float(least), width * max(1.0, abs(guess)))


def _smallest(space: BallProblem, system: Function, x: Balls, inverse: Any) -> Balls | None:
    """The smallest box, nearly, on which the test succeeds: again on what it gives, made wider."""
    for slack in (16, 24, 32, 44):
        radius = arb(2) ** (slack - ctx.prec)
        box = [value + arb(0, 1) * radius * (1 + abs(value)) for value in x]
        image = krawczyk(space, system, box, inverse)
        if image is not None:
            tight = [i.mid() + arb(0, 1) * 8 * i.rad() for i in image]
            return tight if krawczyk(space, system, tight, inverse) is not None else box
    return None


# Whether branches cross at a branch point: proven by the symmetry that makes them cross.
#
# The equations of a branch point, F + nu psi = 0, J^T psi = 0, \|psi\| = 1, have a solution nearby
# if
# branches only pass each other. They cross if nu is zero, which a ball never proves. But let S take
# orbits to orbits of the same word, F(Sz) = S F(z): the mirror image, or the orbit begun some
# periods
# later. With (z, nu, psi) also (Sz, -nu, -S psi) is a solution; if that lies in the box in which
# there is only one, it is the same, and nu = -nu.


def crosses(space: BallProblem, box: Balls, inner: Balls) -> bool:
    """Return whether nu is proven to be zero.

    Parameters
    ----------
    box, inner : list of arb
        Where the branch point's equations have one solution, and where that lies.
    """
    return any(
        all(b.contains(x) for b, x in zip(box, image, strict=True))
        for image in _images(space, box, inner)
    )


def _images(space: BallProblem, box: Balls, inner: Balls) -> Iterator[Balls]:
    """The solutions that symmetries make of one, with nu and psi reversed."""
    problem, m, n = space.problem, space.problem.m, space.problem.n
    value, nu, psi = inner[n], inner[n + 1], inner[n + 2 :]
    word, span = problem.word.walls, space.span(inner[: n + 1])
    period = space.setup(space.values(inner[: n + 1])).period
    for walls, shift, sign in _symmetries(problem):
        letters = "".join(walls[letter] for letter in word)
        rows = [
            [t + arb(shift) * period, *(arb(sign) * y for y in ys)] for t, *ys in _rows(inner, m, n)
        ]
        for first in range(len(word)):
            if letters[first:] + letters[:first] != word:
                continue
            moved = [*rows[first:], *([t + span, *ys] for t, *ys in rows[:first])]
            late = round(float((moved[0][0] - box[0]).mid()) / float(period.mid()))
            flat = [x for t, *ys in moved for x in (t - late * period, *ys)]
            parts = [[-arb(sign) * w for w in row] for row in _rows(psi, m, n)]
            back = [w for row in (*parts[first:], *parts[:first]) for w in row]
            yield [*flat, value, -nu, *back]


def _rows(numbers: Sequence[Any], m: int, n: int) -> list[Balls]:
    return [list(numbers[i : i + m]) for i in range(0, n, m)]


def _symmetries(problem: OrbitProblem) -> Iterator[tuple[Mapping[str, str], float, float]]:
    """Walls exchanged, shift in periods, and sign."""
    model = problem.model
    yield {wall.name: wall.name for wall in model.WALLS}, 0.0, 1.0
    harmonics = problem.kernels.harmonics(*model.values.values())
    mirror = model.symmetry(problem.parameter, harmonics)
    if mirror is not None:
        yield mirror.walls, mirror.shift, mirror.sign
