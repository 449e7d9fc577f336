r"""Branches in balls where they are born, and where tubes join.

There the equations of the word run twice are singular. With the mean s of both halves of the orbit
and half their difference a e, l.e = 1, they are not: let R(a) be the residuals of one half at
(s + a e, lambda), its last flight arriving at s - a e, so that R(-a) are those of the other half.
Then

.. math:: E = \tfrac12 (R(a) + R(-a)) = 0, \quad O = \tfrac1{2a} (R(a) - R(-a)) = 0, \quad
          l \cdot e = 1

is a regular system for (s, lambda, e) at each a, which at a = 0 is that of the period doubling. In
A = a^2 it is smooth: with Taylor coefficients R_j, enclosed for all |a| up to the tube's end,

.. math:: E \in R_0 + A R_2, \quad O \in R_1 + A R_3, \quad
          \frac{dE}{dA} \in R_2, \quad \frac{dO}{dA} \in R_3 ,

where R_0 and R_1 are those at a = 0, because E and O are averages of derivatives between -a and a.
Krawczyk's test for all a at once proves a curve of doubled orbits that leaves the doubling.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from flint import arb, arb_mat, arb_series, ctx

from ..arrays import Array
from ..bifurcations.equations import cyclic_matrix, residuals_of
from ..models.guards import Word
from ..orbits.problem import OrbitProblem
from .equations import (
    BallProblem,
    Balls,
    Flight,
    column,
    identity,
    inverse_of,
    krawczyk,
    preconditioner,
)
from .tube import Node, Segment, Tube, balls_around_zero, bound_in, coefficient, range_of, round_up

ROOM = 2.0
FLOOR = 1e-9
"""How much larger the box is than the correction it has to hold, and its least size."""
BEYOND = 1.0 + 1e-6
"""How far the curve reaches beyond the orbit it is made for, relative."""


@dataclass(frozen=True, eq=False)
class Birth:
    """A curve of doubled orbits from a period doubling on; u from -1 to 1 is a from 0 to `end`."""

    segment: Segment
    """Segment from the doubling to an orbit on the curve, of the word run twice."""
    once: BallProblem
    """The problem of the word run once."""
    center: Array
    """(s, lambda, e) at the doubling."""
    row: Array
    """L."""
    end: float
    """The largest a."""
    box: Array
    inner: Array
    rate: Array
    """`box`, `inner`, `rate`: half widths of the box in which the curve is the only one, of the
    part it lies in, and a bound of its derivative by A."""
    turns: bool
    """Whether it is not excluded that the parameter turns back on it."""

    @property
    def n(self) -> int:
        return self.once.problem.n

    @cached_property
    def around(self) -> Balls:
        """(s, lambda, e) anywhere on the curve."""
        offsets = balls_around_zero(self.inner)
        return [arb(c) + w for c, w in zip(self.center.tolist(), offsets, strict=True)]

    def state(self, u: Any) -> Balls:
        """Return an enclosure of the doubled orbit at u, a number or a ball."""
        return self._doubled(self.around, (u + 1) / 2 * self.end)

    def moving(self, u: Any) -> list[Any]:
        """Return an enclosure of the curve at u, and of its derivative by u, as series."""
        a = (u + 1) / 2 * self.end
        rates = balls_around_zero(self.rate)
        along = [
            arb_series([x, r * a * self.end], prec=2)
            for x, r in zip(self.around, rates, strict=True)
        ]
        return self._doubled(along, arb_series([a, arb(self.end) / 2], prec=2))

    def _doubled(self, x: Sequence[Any], a: Any) -> list[Any]:
        s, value, e = x[: self.n], x[self.n], x[self.n + 1 :]
        span = self.once.span([*s, value])
        first = [m + a * d for m, d in zip(s, e, strict=True)]
        later = [m - a * d for m, d in zip(s, e, strict=True)]
        for i in range(0, self.n, self.once.problem.m):
            later[i] = later[i] + span
        return [*first, *later, value]

    def meets(self, next_one: Tube) -> bool:
        """Whether the branch's point at the beginning of the next tube is on the curve."""
        node, offsets = self.segment.last.unknowns.tolist(), balls_around_zero(next_one.end(-1))
        return self.holds([arb(x) + w for x, w in zip(node, offsets, strict=True)])

    def holds(self, z: Balls) -> bool:
        """Whether a doubled orbit is proven to lie on the curve, behind its beginning."""
        s, e, a = halves(self.once, z, self.row)
        if not (a > 0 and a < self.end):
            return False
        given = [*s, z[-1], *(d / a for d in e)]
        pairs = zip(given, self.center.tolist(), self.box.tolist(), strict=True)
        return all(bool(abs(x - c) < w) for x, c, w in pairs)


def halves(once: BallProblem, z: Sequence[Any], row: Array) -> tuple[Balls, Balls, Any]:
    """Return s, a e and a of a doubled orbit."""
    n, span = once.problem.n, once.span([*z[: once.problem.n], z[-1]])
    later = list(z[n : 2 * n])
    for i in range(0, n, once.problem.m):
        later[i] = later[i] - span
    s = [(x + y) / 2 for x, y in zip(z, later, strict=False)]
    d = [(x - y) / 2 for x, y in zip(z, later, strict=False)]
    return s, d, sum((r * x for r, x in zip(row.tolist(), d, strict=True)), arb(0))


def prove_birth(segment: Segment) -> Birth | None:
    """Return the curve along a segment that begins at a period doubling; None if not proven."""
    try:
        return _birth(segment)
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None


def _birth(segment: Segment) -> Birth | None:
    problem = segment.space.problem
    word = Word(problem.word.walls[: len(problem.word) // 2], problem.word.period // 2)
    once = BallProblem(OrbitProblem(problem.model, word, problem.kernels), segment.space.bits)
    n = once.problem.n
    start = np.append(segment.first.unknowns[:n], segment.first.unknowns[-1])
    null = np.linalg.svd(once.problem.evaluate(start).cyclic(-1.0)[:, :n])[2][-1]
    far = [arb(x) for x in segment.last.unknowns.tolist()]
    if float(halves(once, far, null)[2].mid()) < 0.0:
        null = -null
    center = np.concatenate([start, null])
    end = BEYOND * float(halves(once, far, null)[2].mid())
    thin = _Expansion(once, [arb(c) for c in center.tolist()], null, end)
    matrix = inverse_of(thin.jacobian)
    if matrix is None:
        return None
    offset = range_of([matrix * thin.values])
    half = ROOM * offset + FLOOR
    for _ in range(3):
        balls = [arb(c) + w for c, w in zip(center.tolist(), balls_around_zero(half), strict=True)]
        wide = _Expansion(once, balls, null, end)
        size = len(half)
        defect = range_of([identity(size) - matrix * wide.jacobian]).reshape(size, size)
        image = round_up(offset + round_up(defect @ half))
        if (image < half).all():
            # the derivative of the curve by A: J y = -dH/dA
            step = matrix * wide.slopes
            rate = bound_in(half, defect, range_of([step]))
            slope = step.entries()[n] + arb(0, 1) * float(round_up(defect @ rate)[n])
            turns = not (slope > 0 or slope < 0)
            return Birth(segment, once, center, null, end, half, image, rate, turns)
        half = 2.0 * image
        if (half > 1.0).any():
            return None
    return None


class _Expansion:
    """H = (E, O, l.e - 1), its Jacobian and its derivative by A, for all a up to an end."""

    def __init__(self, once: BallProblem, x: Balls, row: Array, end: float) -> None:
        self.once, self.n = once, once.problem.n
        self.s, self.value, self.e = x[: self.n], x[self.n], x[self.n + 1 :]
        self.row = [arb(r) for r in row.tolist()]
        self.square = arb(0).union(arb(end) * arb(end))
        self.near = self._flights(arb(0), 2)
        self.over = self._flights(arb(0, 1) * end, 4)

    def _flights(self, a: Any, length: int) -> list[Flight]:
        """The flights of the first half around a, as power series; the last one arrives at the
        second half."""
        once, m = self.once, self.once.problem.m
        one = [arb_series([s + a * e, e], prec=length) for s, e in zip(self.s, self.e, strict=True)]
        other = [
            arb_series([s - a * e, -e], prec=length) for s, e in zip(self.s, self.e, strict=True)
        ]
        values = once.values([*self.s, self.value])
        rows = [one[i : i + m] for i in range(0, self.n, m)]
        rows.append([once.problem.closing(other[0], once.setup(values).period), *other[1:m]])
        return once.between(pairwise(rows), values)

    def _even(self, near: Any, over: Any) -> Any:
        return coefficient(near, 0) + self.square * coefficient(over, 2)

    def _odd(self, near: Any, over: Any) -> Any:
        return coefficient(near, 1) + self.square * coefficient(over, 3)

    @property
    def values(self) -> Any:
        """H."""
        pairs = list(zip(residuals_of(self.near), residuals_of(self.over), strict=True))
        size = sum((r * e for r, e in zip(self.row, self.e, strict=True)), arb(-1))
        even, odd = [self._even(*p) for p in pairs], [self._odd(*p) for p in pairs]
        return arb_mat([[x] for x in (*even, *odd, size)])

    @property
    def slopes(self) -> Any:
        """dH/dA."""
        rows = residuals_of(self.over)
        found = [coefficient(r, 2) for r in rows] + [coefficient(r, 3) for r in rows]
        return arb_mat([[x] for x in (*found, arb(0))])

    @cached_property
    def jacobian(self) -> Any:
        """H' by (s, lambda, e).

        With M the cyclic matrix of the flights, and M' that with its last coupling negative, of
        which the even and the odd parts are taken: E_s and O_e are those of M and M', even;
        O_s is that of M, odd; E_e is A times that of M', odd.
        """
        both = self.near, self.over
        whole = [self.once.jacobian(flights) for flights in both]
        turned = [cyclic_matrix(flights, -1, arb(0)) for flights in both]

        def each(part: Callable[[Any, Any], Any], tables: list[Any]) -> list[list[Any]]:
            rows = zip(*tables, strict=True)
            return [[part(*pair) for pair in zip(*row, strict=True)] for row in rows]

        even = zip(each(self._even, whole), each(self._odd, turned), strict=True)
        odd = zip(each(self._odd, whole), each(self._even, turned), strict=True)
        rows = [[*by_s, *(self.square * x for x in by_e)] for by_s, by_e in even]
        rows += [[*by_s, *by_e] for by_s, by_e in odd]
        return arb_mat([*rows, [arb(0)] * (self.n + 1) + self.row])


# Where tubes end: neighbours have to hold the same orbit at their common node.
#
# Both test the hyperplane through the node to which the branch's direction there is normal, and
# each holds one orbit in it. That of a tube is in the other one's box if a bound of its distance
# from the node says so, of the whole tube or at the node. Where branches cross nearby both are too
# wide: then an orbit is proven to lie near the node by Krawczyk's test there alone, in both
# boxes.


def meet(one: Tube | Birth, other: Tube) -> bool:
    """Return whether a tube is proven to hold the same orbit as the next one, where they meet."""
    if isinstance(one, Birth):
        return one.meets(other)
    if (one.inner < other.box).all() or (other.inner < one.box).all():
        return True
    if (one.end(1) < other.box).all() or (other.end(-1) < one.box).all():
        return True
    near = _orbit_near(one.segment, one.segment.last)
    places = one.segment.last.unknowns.tolist()
    boxes = zip(one.box.tolist(), other.box.tolist(), strict=True)
    return near is not None and all(
        bool(abs(x - p) < min(pair)) for x, p, pair in zip(near, places, boxes, strict=True)
    )


def _orbit_near(segment: Segment, node: Node) -> Balls | None:
    """A ball with one orbit in the hyperplane through a node; None if that is not proven."""
    space, scale = segment.space, segment.scale
    places = [arb(x) for x in node.unknowns.tolist()]
    row = (scale**-2 * node.tangent).tolist()  # to the last bit that of the tubes

    def system(z: list[Any]) -> list[Any]:
        away = (w * (x - p) for w, x, p in zip(row, z, places, strict=True))
        return [*space.residual(z), sum(away, arb(0))]

    inverse = preconditioner(space, system, places)
    if inverse is None:
        return None
    step = (inverse * column(system(places))).entries()
    least = arb(2) ** (20 - ctx.prec)
    halves = [
        2 * abs(s).upper() + least * unit for s, unit in zip(step, scale.tolist(), strict=True)
    ]
    box = [p + arb(0, 1) * half for p, half in zip(places, halves, strict=True)]
    return krawczyk(space, system, box, inverse)
