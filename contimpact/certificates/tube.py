r"""Tubes about branches, laid from node to node within a budget.

Let p be a polynomial through two points of a branch with their tangents, on -1 <= u <= 1, near the
branch between them, and l(u) the row that runs from one tangent to the other. A point of the branch
is p(u) + w with

.. math:: G(w; u) = \begin{pmatrix} F(p(u) + w) \\ l(u) \cdot w \end{pmatrix} = 0 .

Krawczyk's test is made for all u at once, with a preconditioner Y(u) that is a polynomial near the
inverse of the Jacobian J: if componentwise

.. math:: |Y(u)\, G(0; u)| + |I - Y(u) J(p(u) + W)| \, W < W \quad \text{for all } u,

then for each u there is exactly one w(u) in the box W, J is regular there, and w is a smooth
function of u. Everything that depends on u is a polynomial with enclosed coefficients: the Taylor
coefficients in the middle of the tube, and instead of the highest one its enclosure over the whole
tube, which is Lagrange's remainder.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from flint import arb, arb_mat, arb_poly, arb_series

from ..arrays import Array
from ..orbits.problem import OrbitProblem
from ..progress import Progress
from ..results.branch import Branch, coordinates
from .equations import BallProblem, Balls, Flight, identity

# How long the proof of a branch may take: what is not looked at in that time is said.


class Budget:
    """Seconds of processor time from now on: another load of the machine proves the same."""

    def __init__(self, seconds: float = math.inf) -> None:
        self.seconds, self._began = seconds, time.process_time()

    @property
    def spent(self) -> bool:
        """Whether they are over."""
        return time.process_time() - self._began > self.seconds

    @property
    def message(self) -> str:
        """What is said of what is left."""
        return f"not proven within {self.seconds:g} s; more are given by seconds in [certify]"


ORDER = 8
"""Degree of the polynomials of residuals, the remainder's."""
ORDER_OF_BLOCKS = 6
"""That of Jacobians and test functions."""
DEGREE = 5
"""Degree of the preconditioner, and of what is added to the cubic."""
CLOSE = 1e-6
"""Distance from the branch below which a cubic is near enough, in natural sizes."""
FLOOR = 1e-10
"""Least size of the box W, in natural sizes of the unknowns."""
ROOM = 2.0
"""How much larger W is than the correction it has to hold."""

NODES = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
FIT = np.linalg.inv(np.vander(NODES, increasing=True))
"""Chebyshev's points, and what makes coefficients of a polynomial from its values there."""

WHOLE = arb(0, 1)
"""All u of a tube."""

Model: TypeAlias = list[Any]
"""Coefficients of a polynomial in u, the last one enclosing the remainder's."""


@dataclass(frozen=True)
class Node:
    """An orbit of a branch, in doubles: its unknowns, and the branch's direction there."""

    unknowns: Array
    tangent: Array


@dataclass(frozen=True, eq=False)
class Segment:
    """The polynomial between two nodes."""

    space: BallProblem
    first: Node
    last: Node
    scale: Array
    """Natural sizes of the unknowns."""

    @cached_property
    def length(self) -> float:
        """Distance of the nodes in natural sizes."""
        change = (self.last.unknowns - self.first.unknowns) / self.scale
        return float(np.linalg.norm(change))

    @cached_property
    def cubic(self) -> list[list[Any]]:
        """Coefficients of the cubic through both ends, exact but for the rounding of balls."""
        half = 0.5 * self.length
        ends = (self.first.unknowns, self.last.unknowns)
        rates = (half * self.first.tangent, half * self.last.tangent)
        columns = zip(*(end.tolist() for end in (*ends, *rates)), strict=True)
        found = []
        for a, b, slope_a, slope_b in ((arb(x) for x in column) for column in columns):
            jump, both = b - a, slope_a + slope_b
            found.append(
                [
                    (a + b) / 2 + (slope_a - slope_b) / 4,
                    (3 * jump - both) / 4,
                    (slope_b - slope_a) / 4,
                    (both - jump) / 4,
                ]
            )
        return found

    @cached_property
    def sampled(self) -> tuple[Array, Array]:
        """The inverse of J on the cubic, and Newton's step from it to the branch, at `NODES`."""
        powers = np.vander(NODES, 4, increasing=True)
        points = powers @ np.array([[float(c.mid()) for c in row] for row in self.cubic]).T
        first, slope = (np.array([float(x.mid()) for x in part]) for part in self.row)
        inverses, steps = [], []
        for u, point in zip(NODES, points, strict=True):
            here = self.space.problem.evaluate(point)
            inverses.append(np.linalg.inv(np.vstack([here.jacobian, first + u * slope])))
            steps.append(-inverses[-1][:, :-1] @ here.residual)
        if not np.isfinite(inverses).all():
            raise ArithmeticError("the Jacobian is singular in a tube")
        return np.array(inverses), np.array(steps)

    @cached_property
    def curve(self) -> list[Any]:
        """The components of p: the cubic, and (1 - u^2)^2 times what leads to the branch.

        Where the cubic is close, rounding of the nodes would tell what that is.
        """
        if (np.abs(self.sampled[1]) < CLOSE * self.scale).all():
            return [arb_poly(cubic) for cubic in self.cubic]
        beside = FIT @ (self.sampled[1] / (1.0 - NODES[:, None] ** 2) ** 2)
        factor = arb_poly([1, 0, -2, 0, 1])
        pairs = zip(self.cubic, beside.T.tolist(), strict=True)
        return [arb_poly(cubic) + factor * arb_poly(more) for cubic, more in pairs]

    @cached_property
    def row(self) -> tuple[Balls, Balls]:
        """l(u) = row[0] + row[1] u."""
        weights = self.scale**-2
        a, b = ((weights * node.tangent).tolist() for node in (self.first, self.last))
        pairs = [(arb(x), arb(y)) for x, y in zip(a, b, strict=True)]
        return [(x + y) / 2 for x, y in pairs], [(y - x) / 2 for x, y in pairs]

    def at(self, u: Any) -> Balls:
        """Return p(u), u a number or a ball."""
        return [p(u) for p in self.curve]

    def slope(self, u: Any) -> Balls:
        """Return p'(u)."""
        return [p.derivative()(u) for p in self.curve]

    def series(self, u: Any, box: Balls, length: int) -> list[Any]:
        """Return p(u + e) + w as power series in e, for w in a box."""
        moved = arb_poly([u, 1])
        return [
            arb_series((p(moved) + w).coeffs(), prec=length)
            for p, w in zip(self.curve, box, strict=True)
        ]

    def doubles(self, u: float) -> Array:
        """Return p(u) in doubles."""
        return np.array([float(x.mid()) for x in self.at(arb(u))])


def preconditioner(segment: Segment) -> list[Any]:
    """Return the coefficients of a polynomial in u, exact matrices, near the inverse of J.

    Raises ArithmeticError, ValueError, numpy.linalg.LinAlgError if there is none.
    """
    return [
        arb_mat(matrix.tolist()) for matrix in np.einsum("ij,jkl->ikl", FIT, segment.sampled[0])
    ]


@dataclass(frozen=True, eq=False)
class Tube:
    """A segment around which the branch is proven to be one smooth curve."""

    segment: Segment
    box: Array
    """W: half widths. In it the curve is the only one."""
    inner: Array
    """Half widths of the part in which it lies."""
    inverse: list[Any]
    defect: Array
    """`inverse`, `defect`: coefficients of Y, and a bound of |I - Y J| for all u."""
    rate: Array
    """Bounds of w'(u)."""
    near: list[Flight]
    over: list[Flight]
    """`near`, `over`: the flights anywhere in W, as series around the middle, and around any u."""
    _models: dict[Any, Model] = field(default_factory=dict)

    def narrowed(self) -> Tube:
        """Return the same tube, its flights enclosed on the part of W in which the branch lies."""
        near = flights_of(self.segment, arb(0), self.around, ORDER_OF_BLOCKS)
        over = flights_of(self.segment, WHOLE, self.around, ORDER_OF_BLOCKS + 1)
        return replace(self, near=near, over=over, _models={})

    @cached_property
    def around(self) -> Balls:
        """Balls that hold w(u)."""
        return balls_around_zero(self.inner)

    @cached_property
    def rates(self) -> Balls:
        """Balls that hold w'(u)."""
        return balls_around_zero(self.rate)

    def end(self, u: int) -> Array:
        """Return a bound of w at a node: |Y G(0; u)| tells it better than what holds for all u."""
        residual = [*self.segment.space.residual(self.segment.at(arb(u))), arb(0)]
        inverse = self.inverse[0]
        for j, matrix in enumerate(self.inverse[1:], start=1):
            inverse = inverse + u**j * matrix
        offset = range_of([inverse * arb_mat([[r] for r in residual])])
        return bound_in(self.box, self.defect, offset)

    def state(self, u: Any) -> Balls:
        """Return an enclosure of the branch's point at u, a number or a ball."""
        return [x + w for x, w in zip(self.segment.at(u), self.around, strict=True)]

    def moving(self, u: Any) -> list[Any]:
        """Return an enclosure of the branch at u, and of its derivative by u, as series."""
        slopes = zip(self.segment.slope(u), self.rates, strict=True)
        return [
            arb_series([x, s + r], prec=2) for x, (s, r) in zip(self.state(u), slopes, strict=True)
        ]

    def model(self, name: str, function: Callable[[list[Flight]], Any]) -> Model:
        """Return a function of the flights along the tube as a polynomial."""
        if name not in self._models:
            near, over = function(self.near), function(self.over)
            self._models[name] = taylor(near, over, ORDER_OF_BLOCKS)
        return self._models[name]


def flights_of(segment: Segment, u: Any, box: Balls, length: int) -> list[Flight]:
    """Return the flights along a segment as power series around u."""
    return segment.space.flights(segment.series(u, box, length))


def taylor(near: Any, over: Any, order: int) -> Model:
    """Return a polynomial from series around the middle and around any u."""
    first = near.coeffs()[:order] if isinstance(near, arb_series) else [arb(near)]
    return [*first, *[arb(0)] * (order - len(first)), coefficient(over, order)]


def coefficient(number: Any, j: int) -> Any:
    """Return a coefficient of a series, or of a number."""
    if isinstance(number, arb_series):
        return number[j]
    return arb(number) if j == 0 else arb(0)


def prove_tube(segment: Segment, box: Array | None = None, widest: float = math.inf) -> Tube | None:
    """Return the tube around a segment, None where the test fails, or the tube would be wider than
    is asked for, in natural sizes; `box` is W, which is chosen by default."""
    try:
        test = _Test(segment)
        return test.tube(box) if (test.offset <= widest * segment.scale).all() else None
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None


class _Test:
    """Krawczyk's test along a segment."""

    def __init__(self, segment: Segment) -> None:
        self.segment = segment
        self.inverse = preconditioner(segment)
        self.n = segment.space.problem.n
        thin = balls_around_zero(np.zeros(self.n + 1))
        near = flights_of(segment, arb(0), thin, ORDER)
        over = flights_of(segment, WHOLE, thin, ORDER + 1)
        residual = self._columns(near, over, ORDER)
        self.offset = range_of(_times(self.inverse, residual))

    def _columns(self, near: list[Flight], over: list[Flight], order: int) -> list[Any]:
        """G(0; u): the residuals as columns, zero in the last row."""
        rows = [
            taylor(a, b, order)
            for one, other in zip(near, over, strict=True)
            for a, b in zip(one[0], other[0], strict=True)
        ]
        return [arb_mat([[row[j]] for row in rows] + [[0]]) for j in range(order + 1)]

    def tube(self, box: Array | None) -> Tube | None:
        """Return the tube, if the test succeeds for a box."""
        scale = self.segment.scale
        tries = [box] if box is not None else [ROOM * self.offset + FLOOR * scale] * 3
        for half in tries:
            if box is None and (half > 0.1 * scale).any():
                return None
            around = balls_around_zero(half)
            near = flights_of(self.segment, arb(0), around, ORDER_OF_BLOCKS)
            over = flights_of(self.segment, WHOLE, around, ORDER_OF_BLOCKS + 1)
            defect = self._defect(near, over)
            image = round_up(self.offset + round_up(defect @ half))
            if (image < half).all():
                for _ in range(3):
                    image = np.minimum(image, round_up(self.offset + round_up(defect @ image)))
                rate = bound_in(half, defect, self._rate(half, near, over))
                return Tube(self.segment, half, image, self.inverse, defect, rate, near, over)
            tries[1:] = [2.0 * image] * (len(tries) - 1)
        return None

    def _defect(self, near: list[Flight], over: list[Flight]) -> Array:
        """A bound of |I - Y J| for all u."""
        space, order = self.segment.space, ORDER_OF_BLOCKS
        rows = zip(space.jacobian(near), space.jacobian(over), strict=True)
        models = [[taylor(a, b, order) for a, b in zip(*pair, strict=True)] for pair in rows]
        models.append([list(pair) for pair in zip(*self.segment.row, strict=True)])
        matrices = [
            arb_mat([[x[j] if j < len(x) else 0 for x in row] for row in models])
            for j in range(order + 1)
        ]
        product = _times(self.inverse, matrices)
        product[0] -= identity(self.n + 1)
        return range_of(product).reshape(self.n + 1, self.n + 1)

    def _rate(self, half: Array, near: list[Flight], over: list[Flight]) -> Array:
        """|Y (F'(p + w) p', l' w)| for all u: F'(p + w) p' is the rate of F(p(u) + w), w held."""
        order = ORDER_OF_BLOCKS
        columns = self._columns(near, over, order)
        rates = [j * column for j, column in enumerate(columns)][1:]
        bend = sum(
            (abs(r) * float(w) for r, w in zip(self.segment.row[1], half, strict=True)), arb(0)
        )
        rates[0] += arb_mat([[0]] * self.n + [[arb(0, 1) * bend]])
        return range_of(_times(self.inverse, rates))


def bound_in(half: Array, defect: Array, offset: Array) -> Array:
    """Return a bound of all w of |w| <= |offset| + D |w|, a multiple of the box's half widths."""
    factor = float(np.max(round_up(round_up(defect @ half) / half)))
    bound = float(np.max(round_up(offset / half))) / np.nextafter(1.0 - factor, 0.0)
    return np.asarray(round_up(round_up(bound) * half))


def _times(one: Sequence[Any], other: Sequence[Any]) -> list[Any]:
    """The product of polynomials of matrices."""
    found: list[Any] = [None] * (len(one) + len(other) - 1)
    for i, a in enumerate(one):
        for j, b in enumerate(other):
            product = a * b
            found[i + j] = product if found[i + j] is None else found[i + j] + product
    return found


def range_of(polynomial: Sequence[Any]) -> Array:
    """Return a bound of the entries of a polynomial of matrices, for all |u| <= 1."""
    columns = zip(*(matrix.entries() for matrix in polynomial), strict=True)
    found = np.array([float(sum(map(abs, column)).upper()) for column in columns])
    if not np.isfinite(found).all():
        raise ArithmeticError("an enclosure is not finite")
    return np.asarray(round_up(found))


def round_up(x: Any) -> Any:
    """Return doubles, or sums and products of a few, rounded upwards."""
    return np.nextafter(x * (1.0 + 1e-14), np.inf)


def balls_around_zero(half: Array) -> Balls:
    """Return balls around zero of given radii."""
    return [arb(0, 1) * arb(float(h)) for h in half]


def shift_polynomial(model: Model, u: Any) -> list[Any]:
    """Return the coefficients of a polynomial around another u."""
    return arb_poly(model)(arb_poly([u, 1])).coeffs() or [arb(0)]


# Nodes between tubes: orbits of a branch in doubles. Nothing is proven by them.

SHORTEST = 2e-5
"""Length of segments, in natural sizes of the unknowns, that are not halved: where branches cross,
no tube is short enough."""


def node_at(problem: OrbitProblem, unknowns: Array, scale: Array, along: Array) -> Node:
    """Return a node at an orbit, its tangent in the direction of another vector."""
    jacobian = problem.evaluate(unknowns).jacobian * scale
    tangent = np.linalg.svd(jacobian)[2][-1]
    if tangent @ (along / scale) < 0.0:
        tangent = -tangent
    return Node(unknowns, tangent * scale)


def halve_segment(segment: Segment) -> tuple[Segment, Segment] | None:
    """Return two segments in place of one, through an orbit near its middle; None without one."""
    if segment.length < SHORTEST:
        return None
    problem, row = segment.space.problem, np.array([float(x.mid()) for x in segment.row[0]])
    try:
        middle = z = np.array([float(c[0].mid()) for c in segment.cubic])
        for _ in range(8):
            here = problem.evaluate(middle)
            matrix = np.vstack([here.jacobian, row])
            step = np.linalg.solve(matrix, np.append(here.residual, row @ (middle - z)))
            middle = middle - step
            if np.max(np.abs(step) / segment.scale) < 1e-14:
                break
    except (ArithmeticError, ValueError, np.linalg.LinAlgError):
        return None
    if not np.max(np.abs(middle - z) / segment.scale) < 0.5 * segment.length:
        return None
    node = node_at(problem, middle, segment.scale, segment.last.unknowns - segment.first.unknowns)
    return (
        Segment(segment.space, segment.first, node, segment.scale),
        Segment(segment.space, node, segment.last, segment.scale),
    )


# From the table of a branch to tubes, one after the other.

FINEST = 1e-4
"""Largest half width of a tube, in natural sizes of the unknowns, unless it spans one step."""
THINNER = 0.5
"""How much thinner tubes become before longer ones are tried again."""
DEEPEST = 12
"""How often the step of a table is halved."""
AWAY = 0.05
"""Tubes do not end nearer to an event than this part of the step."""


def points_of(branch: Branch, problem: OrbitProblem) -> Array:
    """The orbits of a table from which tubes may begin: events are no ends of tubes."""
    names = [f"{n}{k}" for k in range(1, len(branch.word) + 1) for n in coordinates(problem.m)]
    rows = np.column_stack([branch[name] for name in (*names, branch.parameter)])
    events = np.array([name != "" for name in branch["event"]])
    places = branch["arclength"]
    spacing = np.gradient(places) if len(places) > 1 else np.ones(1)
    near = np.zeros(len(rows), dtype=bool)
    for where in [e.arclength for e in branch.events]:
        near |= np.abs(places - where) < AWAY * np.abs(spacing)
    kept = ~(events | near)
    kept[[0, -1]] = True
    kept[1:] &= np.any(rows[1:] != rows[:-1], axis=1)
    return rows[kept]


def scale_of(problem: OrbitProblem, points: Array) -> Array:
    """Natural sizes of the unknowns: the largest of those along the branch, because one that
    passes through zero has none there."""
    span = float(np.ptp(points[:, -1])) or 1.0
    sizes = [problem.scale(z, span) for z in points]
    return np.asarray(np.max(sizes, axis=0))


def nodes_of(problem: OrbitProblem, points: Array, scale: Array) -> list[Node]:
    count = len(points)
    return [
        node_at(problem, z, scale, points[min(i + 1, count - 1)] - points[max(i - 1, 0)])
        for i, z in enumerate(points)
    ]


def tubes_along(
    space: BallProblem, nodes: Sequence[Node], scale: Array, progress: Progress, budget: Budget
) -> Iterator[tuple[Segment, Tube | None]]:
    """Yield tubes from node to node, each over as many steps as it can, or None; None for every
    step that is left when the budget is spent.

    Twice as many steps are tried where tubes have become thinner than the last one of which that
    was refused.
    """
    i, steps, doubled, refused = 0, 4, False, math.inf
    thin = 0.0
    while i < len(nodes) - 1:
        if budget.spent:
            yield Segment(space, nodes[i], nodes[i + 1], scale), None
            i += 1
            continue
        j = min(i + steps, len(nodes) - 1)
        segment = Segment(space, nodes[i], nodes[j], scale)
        tube = prove_tube(segment, widest=FINEST if j - i > 1 else math.inf)
        width = math.inf if tube is None else float(np.max(tube.inner / scale))
        if j - i > 1 and width > FINEST:
            refused = thin if doubled else math.inf
            steps, doubled = (j - i) // 2, False
            continue
        if tube is None:
            yield from split(segment, DEEPEST, budget)
        else:
            yield segment, tube
        thin, doubled = width, width < THINNER * refused
        i, steps = j, (2 * steps if doubled else steps)
        progress(f"{i} of {len(nodes) - 1} steps")


def split(segment: Segment, depth: int, budget: Budget) -> Iterator[tuple[Segment, Tube | None]]:
    """Yield tubes along a step in which a single one is not proven."""
    parts = halve_segment(segment) if depth > 0 and not budget.spent else None
    if parts is None:
        yield segment, None
        return
    for part in parts:
        tube = prove_tube(part)
        if tube is not None:
            yield part, tube
        else:
            yield from split(part, depth - 1, budget)
