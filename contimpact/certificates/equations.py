"""Orbits and events in balls, and zeros proven by Krawczyk's operator.

Residuals and blocks are those of the generated kernels, evaluated on balls; Jacobians of the
systems come from power series of two terms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from flint import arb, arb_mat, arb_series, ctx

from ..bifurcations.equations import Equations
from ..bifurcations.equations import Flight as Flight
from ..orbits.problem import OrbitProblem
from ..segments.balls import Number, Time, balls
from ..segments.kernel import SECTION
from ..segments.segment import evaluate_in

Balls: TypeAlias = list[Any]
"""Numbers of this arithmetic: ``arb``, or ``arb_series`` of them."""


class BallProblem(Equations):
    """The orbit problem of a word, and the systems of its events, in balls. `bits` is the precision
    of the constants; numbers have that of Arb's context."""

    def __init__(self, problem: OrbitProblem, bits: int) -> None:
        super().__init__(problem, balls(bits))
        self.bits = bits
        self._memory: dict[Any, Any] | None = None

    def span(self, z: Sequence[Number]) -> Number:
        """Return the orbit's period."""
        return self.problem.word.period * self.setup(self.values(z)).period

    def closing(self, z: Sequence[Number]) -> Number:
        """Return when the orbit closes."""
        return self._remembered(("closing", z[0], z[-1]), super().closing, z)

    def flight(self, k: int, start: Balls, end: Balls, values: Balls) -> Flight:
        """Return residual and blocks of a flight between the unknowns of two impacts."""
        given = (k, *start, *end, values[self._free])
        return self._remembered(given, super().flight, k, start, end, values)

    def _remembered(
        self, given: Sequence[Any], function: Callable[..., Any], *arguments: Any
    ) -> Any:
        """What the same numbers have given before is not evaluated again."""
        if self._memory is None:
            return function(*arguments)
        key = tuple(map(id, given))
        if key not in self._memory:
            self._memory[key] = given, function(*arguments)
        return self._memory[key][1]

    def motion(self, wall: str, other: str | None = None) -> Callable[..., Any]:
        """Return the kernel of the motion after a wall, or since the section: ``motion(start, dt,
        values)``.

        It is that of the displacement from the wall, or of the gap coordinate of another one.
        """
        kernels = self.problem.kernels
        if wall == SECTION and other is not None:
            since = evaluate_in(kernels.since(other), self.arithmetic)
            return lambda start, dt, values: since(*start, dt, *values)
        kernel = kernels.motion(wall) if other is None else kernels.gap(wall, other)
        function = evaluate_in(kernel, self.arithmetic)
        return lambda start, dt, values: function(Time(start[0]), *start[1:], dt, *values)

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


# Krawczyk's test: a zero of a system exists, and is the only one, in a box.
#
# For a box X with midpoint x, a matrix Y near the inverse of f'(x), and a matrix J that encloses f'
# on X, let
#
# .. math:: K = x - Y f(x) + (I - Y J)(X - x) .
#
# If K lies in the interior of X, there is exactly one zero of f in X, it lies in K, and f' is
# regular on X (Krawczyk 1969; Moore 1977; Neumaier, Interval Methods for Systems of Equations,
# 1990, ch. 5).

Function: TypeAlias = Callable[[list[Any]], list[Any]]

STEPS, BITS_A_STEP = 12, 16
"""Newton steps at most, and a further one for so many bits; doubles are right to some digits from
the beginning."""

ROUNDING = 1e-18
"""Steps below this that fall no more are those of rounding, where a system is ill-conditioned."""

WIDER = -40
"""Binary digits of the least part of a first box to which a ball shrinks in `_smallest`."""

WIDTHS = (1e-7, 1e-8, 1e-9, 1e-10, 1e-11, 1e-12)
"""Radii of boxes tried, beside sizes, the widest first: the wider, the more the uniqueness says."""


def refine_zero(system: Function, guess: Sequence[float], inverse: Any) -> Balls | None:
    """Return a zero to the digits of the context, by Newton's iteration with a matrix near the
    inverse of the Jacobian; nothing is proven by it.

    None where the iteration does not converge.
    """
    x, before = [arb(value) for value in guess], arb(1)
    for _ in range(STEPS + ctx.prec // BITS_A_STEP):
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
    return inverse_of(space.linearised(system, [value.mid() for value in x]))


def inverse_of(matrix: Any) -> Any:
    """Return the inverse of a matrix's midpoint, in doubles, as an exact matrix; None without
    one."""
    middle = np.array([[float(x.mid()) for x in row] for row in matrix.tolist()])
    try:
        inverse = np.linalg.inv(middle)
    except np.linalg.LinAlgError:
        return None
    return arb_mat(inverse.tolist()) if np.isfinite(inverse).all() else None


def krawczyk(
    space: BallProblem, system: Function, box: Balls, inverse: Any = None, jacobian: Any = None
) -> Balls | None:
    """Return K for a box, if the test proves exactly one zero in it, else None.

    `inverse` is Y, any exact matrix, by default the inverse of the Jacobian at the midpoint, in
    doubles; `jacobian` encloses the Jacobian on a box that holds this one, if that is known.
    """
    middle = [value.mid() for value in box]
    inverse = preconditioner(space, system, middle) if inverse is None else inverse
    if inverse is None:
        return None
    offset = column([b - m for b, m in zip(box, middle, strict=True)])
    jacobian = space.linearised(system, box) if jacobian is None else jacobian
    defect = identity(len(box)) - inverse * jacobian
    change = (defect * offset - inverse * column(system(middle))).entries()
    image = [m + c for m, c in zip(middle, change, strict=True)]
    inside = (b.contains_interior(i) for b, i in zip(box, image, strict=True))
    return image if all(inside) else None


def column(values: Sequence[Any]) -> Any:
    return arb_mat([[value] for value in values])


def identity(size: int) -> Any:
    return arb_mat(np.eye(size, dtype=int).tolist())


def prove_zero(
    space: BallProblem, system: Function, guess: Sequence[float]
) -> tuple[Balls, Balls] | None:
    """Return a box with exactly one zero around a guess, and a small one that holds the zero.

    The box holds the guess. None where the test fails. One enclosure of the Jacobian, on the box,
    serves for all: its midpoint is inverted, and smaller boxes lie in it.
    """
    x, found, sizes = [arb(value) for value in guess], None, _sizes(space, guess)
    for width in WIDTHS:
        box = [_ball_around(v, g, width * s) for v, g, s in zip(x, guess, sizes, strict=True)]
        jacobian = space.linearised(system, box)
        inverse = inverse_of(jacobian)
        if found is None and inverse is not None:
            found = refine_zero(system, guess, inverse)
        if found is None:
            return None
        if krawczyk(space, system, box, inverse, jacobian) is not None:
            small = _smallest(space, system, found, box, inverse, jacobian)
            if small is not None:
                return box, small
        x = found
    return None


def _sizes(space: BallProblem, guess: Sequence[float]) -> Sequence[float]:
    """Sizes of unknowns: the orbit's go first, and small ones have natural units."""
    sizes, count = np.maximum(1.0, np.abs(guess)), space.problem.n + 1
    if len(guess) >= count:
        own = space.problem.evaluate(np.array(guess[:count])).sizes[1]
        sizes[:count] = np.fmin(sizes[:count], own)
    return sizes.tolist()


def _ball_around(x: Any, guess: float, radius: float) -> Any:
    """A ball around a zero that holds the guess."""
    return x + arb(0, 1) * max(float(2 * abs(x - guess).upper()), radius)


def _smallest(
    space: BallProblem, system: Function, x: Balls, whole: Balls, inverse: Any, jacobian: Any
) -> Balls | None:
    """The smallest box in another one, nearly, on which the test succeeds: again on what it gives,
    made wider.

    An unknown that an equation says outright, as a velocity of zero, comes out far below rounding
    with one inverse and not with another; its ball is kept wide enough for any.
    """
    for slack in (16, 24, 32, 44):
        radius = arb(2) ** (slack - ctx.prec)
        box = [value + arb(0, 1) * radius * (1 + abs(value)) for value in x]
        if not all(w.contains(b) for w, b in zip(whole, box, strict=True)):
            return None
        image = krawczyk(space, system, box, inverse, jacobian)
        if image is None:
            continue
        for turn in range(2):
            least = [radius * (1 + abs(v)).upper() * arb(2) ** (WIDER - turn) for v in x]
            radii = [max(4 * i.rad(), r) for i, r in zip(image, least, strict=True)]
            tight = [i.mid() + arb(0, 1) * r for i, r in zip(image, radii, strict=True)]
            inside = all(b.contains(t) for b, t in zip(box, tight, strict=True))
            again = krawczyk(space, system, tight, inverse, jacobian) if inside else None
            if again is None:
                break
            box, image = tight, again
        return box
    return None


# Whether branches cross at a branch point: proven by the symmetry that makes them cross.
#
# The equations of a branch point, F + nu psi = 0, J^T psi = 0, \|psi\| = 1, have a solution nearby
# if branches only pass each other. They cross if nu is zero, which a ball never proves. But let S
# take orbits to orbits of the same word, F(Sz) = S F(z): the mirror image, or the orbit begun some
# periods later. With (z, nu, psi) also (Sz, -nu, -S psi) is a solution; if that lies in the box in
# which there is only one, it is the same, and nu = -nu.


def crosses(space: BallProblem, box: Balls, inner: Balls) -> bool:
    """Return whether nu is proven to be zero, from the box where the branch point's equations have
    one solution, and the inner one where that lies."""
    return any(
        all(b.contains(x) for b, x in zip(box, image, strict=True))
        for image in _images(space, box, inner)
    )


def _images(space: BallProblem, box: Balls, inner: Balls) -> Iterator[Balls]:
    """The solutions that symmetries make of one, with nu and psi reversed."""
    m, n = space.problem.m, space.problem.n
    nu, psi = inner[n + 1], inner[n + 2 :]
    for image in images_of(space, inner[: n + 1], box[0]):
        parts = [[-arb(image.sign) * w for w in row] for row in _rows(psi, m, n)]
        back = [w for row in (*parts[image.first :], *parts[: image.first]) for w in row]
        yield [*image.z, -nu, *back]


@dataclass(frozen=True)
class Image:
    """An orbit of the same word that a symmetry makes of another one.

    Attributes
    ----------
    z : list of arb
        Its unknowns.
    walls : mapping
        The wall that comes in the place of each.
    sign : float
    first, count : int
        The impact whose image is its first, and how many impacts there are.
    later, span : arb
        By how much its times are later, and its period.
    """

    z: Balls
    walls: Mapping[str, str]
    sign: float
    first: int
    count: int
    later: Any
    span: Any

    def touch(self, flight: int, wall: str, time: Any) -> tuple[int, str, Any]:
        """Return flight, wall and time that a touch of the other orbit has in this one."""
        again = self.span if flight < self.first else 0
        return (flight - self.first) % self.count, self.walls[wall], time + self.later + again


def images_of(space: BallProblem, z: Balls, near: Any) -> Iterator[Image]:
    """Yield the orbits of the same word that symmetries make of one, each with its first impact
    less than a period from a time."""
    problem, m, n = space.problem, space.problem.m, space.problem.n
    word, span = problem.word.walls, space.span(z)
    period = arb(space.setup(space.values(z)).period)
    for walls, shift, sign in _symmetries(problem):
        letters = "".join(walls[letter] for letter in word)
        rows = [
            [t + arb(shift) * period, *(arb(sign) * y for y in ys)] for t, *ys in _rows(z, m, n)
        ]
        for first in range(len(word)):
            if letters[first:] + letters[:first] != word:
                continue
            moved = [*rows[first:], *([t + span, *ys] for t, *ys in rows[:first])]
            late = round(float((moved[0][0] - near).mid()) / float(period.mid())) * period
            flat = [x for t, *ys in moved for x in (t - late, *ys)]
            later = arb(shift) * period - late
            yield Image([*flat, z[n]], walls, sign, first, len(word), later, span)


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
