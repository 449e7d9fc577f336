r"""Predictor and corrector: bordered equations, Newton's method, and arcs between points.

It solves F(z) = 0 together with one more equation, :math:`c \cdot (z - z_p) = 0`, by Newton's
method on the bordered matrix

    [ dF/dz ]
    [   c   ]

(Keller 1977; Allgower and Georg, Introduction to Numerical Continuation Methods, 1990).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias, TypeVar

import numpy as np

from ..arrays import Array, Vector, norm
from .branch import Evaluation, Event, Point, Problem, Refusal, RefusalDetails
from .settings import Settings

if TYPE_CHECKING:
    from scipy.sparse.linalg import SuperLU

# Lengths and angles, measured by natural sizes w of the unknowns: |a|^2 = sum (a_i/w_i)^2.
#
# `inner_product` and `length` take arrays; the others are in the plain subset of Python that
# `contimpact.compiling` compiles, and take lists as well.

EPSILON = float(np.finfo(float).eps)


def inner_product(a: Array, b: Array, scale: Array) -> float:
    """Return the metric's inner product."""
    return float(np.dot(a / scale, b / scale))


def length(a: Array, scale: Array) -> float:
    """Return the metric's norm."""
    return float(np.linalg.norm(a / scale))


def distance(one: Vector, other: Vector, scale: Vector) -> float:
    """Return the length of the difference of two vectors."""
    size = 0.0
    for i in range(len(one)):
        part = (one[i] - other[i]) / scale[i]
        size += part * part
    return math.sqrt(size)


def angle(one: Vector, other: Vector, scale: Vector) -> float:
    """Return the angle between two unit tangents, accurate also when small."""
    return 2.0 * math.asin(min(1.0, 0.5 * distance(one, other, scale)))


# Square linear systems: dense for short problems, sparse LU with partial pivoting for long ones.
#
# The matrices are cyclic chains of small blocks with a few full columns or rows. An elimination
# along the chain without pivoting would lose all digits where flights expand; SuperLU pivots.

DENSE_UP_TO = 400
"""Rows up to which dense elimination is the faster one, the conversion counted."""


def solve(matrix: Array, right: Array) -> Array:
    """Solve a square system; numpy.linalg.LinAlgError if the matrix is exactly singular."""
    if len(matrix) <= DENSE_UP_TO:
        return np.asarray(np.linalg.solve(matrix, right))
    return np.asarray(_factors(matrix).solve(right))


def log_determinant(matrix: Array) -> tuple[float, float]:
    """Return sign and logarithm of the absolute value of a determinant."""
    if len(matrix) <= DENSE_UP_TO:
        sign, logarithm = np.linalg.slogdet(matrix)
        return float(sign), float(logarithm)
    try:
        factors = _factors(matrix)
    except np.linalg.LinAlgError:
        return 0.0, -np.inf
    diagonal = factors.U.diagonal()
    sign = np.prod(np.sign(diagonal)) * _parity(factors.perm_r) * _parity(factors.perm_c)
    return float(sign), float(np.sum(np.log(np.abs(diagonal))))


def _factors(matrix: Array) -> SuperLU:
    from scipy.sparse import csc_matrix
    from scipy.sparse.linalg import splu

    try:
        return splu(csc_matrix(matrix))
    except RuntimeError as error:  # SuperLU's word for exactly singular
        raise np.linalg.LinAlgError(str(error)) from None


def _parity(permutation: Array) -> int:
    """+1 for an even permutation, -1 for an odd one."""
    places, seen, sign = permutation.tolist(), set(), 1
    for first in range(len(places)):
        length, here = 0, first
        while here not in seen:
            seen.add(here)
            here = places[here]
            length += 1
        sign *= -1 if length and length % 2 == 0 else 1
    return sign


# Dense linear algebra of the Jacobian bordered by a row: tangents, determinants, Newton steps.

LARGEST = 0.999
"""Part of the largest component from which on others are as large."""


def border_jacobian(jacobian: Array, row: Array) -> Array:
    """Return the Jacobian with one more row."""
    matrix = np.empty((len(row), len(row)))
    matrix[:-1] = jacobian
    matrix[-1] = row
    return matrix


def orient_vector(vector: Array) -> Array:
    """Return a vector or its negative, always the same one of both.

    That in which the first of its largest components is positive: of a null vector, rounding
    decides on the sign, and where components are equal by symmetry also on which is the largest.
    """
    sizes = np.abs(vector)
    leading = vector[np.argmax(sizes >= LARGEST * np.max(sizes))]
    return -vector if leading < 0.0 else vector


def residual_sizes(problem: Problem, scale: Array, here: Evaluation) -> Array:
    """Return natural sizes of the residuals at a point, given those of the unknowns: as the problem
    does, or ones."""
    own: Callable[[Array], Array] | None = getattr(problem, "residual_sizes", None)
    if own is not None:
        return own(scale)
    at: Callable[..., Array] | None = getattr(problem, "residual_sizes_at", None)
    return np.ones(len(scale) - 1) if at is None else at(here, scale)


def first_tangent(problem: Problem, jacobian: Array, scale: Array) -> Array | None:
    """Return the Jacobian's unit null vector as `orient_vector` has it, None if there are two."""
    own: Callable[[Array], Array] | None = getattr(problem, "residual_sizes", None)
    largest = np.max(np.abs(jacobian * scale), axis=1)
    units = np.where(largest > 0.0, largest, 1.0) if own is None else own(scale)
    _, sizes, vectors = np.linalg.svd(jacobian * scale / units[:, None])
    if sizes[-1] <= 1e-10 * sizes[0]:
        return None
    return scale * orient_vector(vectors[-1])


def next_tangent(jacobian: Array, row: Array, scale: Array) -> Array | None:
    """Return the unit null vector that has a positive product with a row."""
    right = np.zeros(len(row))
    right[-1] = 1.0
    try:
        tangent = solve(border_jacobian(jacobian, row), right)
    except np.linalg.LinAlgError:
        return None
    size = length(tangent, scale)
    return tangent / size if np.isfinite(size) and size > 0.0 else None


def scaled_determinant(matrix: Array) -> float:
    """Return the determinant with every row divided by its norm: between -1 and 1, no pole."""
    norms = np.linalg.norm(matrix, axis=1)
    if not np.all(norms > 0.0):
        return 0.0
    sign, logarithm = log_determinant(matrix / norms[:, None])
    return float(sign * np.exp(max(logarithm, -700.0)))


def orientation(jacobian: Array, tangent: Array, scale: Array) -> float:
    """Return the scaled determinant of the Jacobian bordered by the tangent."""
    return scaled_determinant(border_jacobian(jacobian * scale, tangent / scale))


def point_after(
    previous: Point,
    evaluation: Evaluation,
    iterations: int,
    scale: Array,
    travelled: float | None = None,
) -> Point | None:
    """Return an evaluation as the point that follows another, or None where it has no tangent."""
    jacobian = evaluation.jacobian
    tangent = next_tangent(jacobian, previous.tangent / scale**2, scale)
    if tangent is None:
        return None
    if travelled is None:
        travelled = length(evaluation.unknowns - previous.unknowns, scale)
    sign = orientation(jacobian, tangent, scale)
    return Point(evaluation, tangent, sign, previous.arclength + travelled, iterations)


class DenseSystem:
    """Any problem in the form in which `newton` and `take_steps` ask for it."""

    def __init__(self, problem: Problem, scale: Array) -> None:
        self.problem, self.scale = problem, scale
        self.here: Evaluation | None = None

    def evaluate(self, z: list[float]) -> float:
        """Evaluate; returns the largest residual in natural units, NaN where F has no value."""
        try:
            self.here = self.problem.evaluate(np.array(z))
            units = residual_sizes(self.problem, self.scale, self.here)
        except (ArithmeticError, ValueError):
            return math.nan
        return float(np.max(np.abs(self.here.residual) / units))

    def solve(self, row: list[float], g: float, out: list[float]) -> bool:
        """Fill `out` with the solution of the bordered system; whether there is one."""
        assert self.here is not None
        matrix = border_jacobian(self.here.jacobian, np.array(row))
        try:
            out[:] = solve(matrix, np.append(-self.here.residual, g)).tolist()
        except np.linalg.LinAlgError:
            return False
        return True

    def tangent_at(
        self, z: list[float], row: list[float], scale: list[float], out: list[float]
    ) -> float:
        """Fill `out` with the unit tangent along `row`; returns the orientation, NaN without."""
        assert self.here is not None
        sizes = np.array(scale)
        tangent = next_tangent(self.here.jacobian, np.array(row), sizes)
        if tangent is None:
            return math.nan
        out[:] = tangent.tolist()
        return orientation(self.here.jacobian, tangent, sizes)

    def observe(
        self, z: list[float], tangent: list[float], sign: float, rows: list[float], at: int
    ) -> None:
        """Put nothing into a row: test functions are asked of the evaluation."""


# The predictor: where the next point is guessed, along the tangent or the chord behind.

Value = TypeVar("Value", float, Array)
"""A number, or many at once."""


def predict(
    z: Vector,
    tangent: Vector,
    chord: Vector,
    secant: bool,
    step: float,
    scale: Vector,
    guess: Vector,
) -> None:
    """Fill `guess` with the point one step ahead of z, along its unit tangent, or the chord.

    The chord leads here from the point before; `secant` chooses it. Written in the plain subset of
    Python that `contimpact.compiling` compiles.
    """
    if not secant:
        for i in range(len(z)):
            guess[i] = z[i] + step * tangent[i]
        return
    size = norm(chord, scale)
    for i in range(len(z)):
        guess[i] = z[i] + step * (chord[i] / size)


def cubic(left: Value, right: Value, rate: Value, next_rate: Value, span: float, s: float) -> Value:
    """Return a value of the cubic through two values with their rates, at a fraction s."""
    t = 1.0 - s
    return (
        left * t * t * (1.0 + 2.0 * s)
        + right * s * s * (1.0 + 2.0 * t)
        + span * s * t * (t * rate - s * next_rate)
    )


def hermite(left: Point, right: Point, span: float, fraction: float) -> Array:
    """Return a value of the cubic through two points with their tangents."""
    return cubic(left.unknowns, right.unknowns, left.tangent, right.tangent, span, fraction)


D = TypeVar("D")
"""The problem, in the form in which functions of the plain subset take it."""

Evaluate: TypeAlias = Callable[[D, Vector], float]
Solve: TypeAlias = Callable[[D, Vector, float, Vector], bool]
"""Linear solver that `newton` asks of a problem."""

CONVERGED, NO_VALUE, NO_SOLUTION, DIVERGES, SLOW = range(5)
"""Status codes of `newton`."""

MAY_BE_ROUNDING = 1e-6
"""Newton steps longer than this are not asked if they are rounding."""


def newton(
    evaluate: Evaluate[D],
    solve: Solve[D],
    data: D,
    z: Vector,
    guess: Vector,
    row: Vector,
    scale: Vector,
    step: Vector,
    tolerance: float,
    most: int,
) -> tuple[int, int, float]:
    """Solve F(z) = 0, row . (z - guess) = 0 by Newton's method, with `most` iterations at most.

    Fills z and returns status, iterations and the length of the first step. Accepts a point whose
    residual is below the tolerance, or whose Newton step is at the rounding of the unknowns. A step
    that no longer contracts is refused. ``evaluate(data, z)`` returns the largest residual, NaN
    where F has no value; ``solve(data, row, g, out)`` solves the bordered system at the point last
    evaluated with the border's right side g, and returns whether there is a solution. Written in
    the plain subset of Python that `contimpact.compiling` compiles.
    """
    n = len(z)
    before, first = math.inf, 0.0
    for i in range(n):
        z[i] = guess[i]
    for iteration in range(most + 1):
        worst = evaluate(data, z)
        if worst - worst != 0.0:  # infinite or NaN
            return NO_VALUE, iteration, first
        if worst <= tolerance:
            return CONVERGED, iteration, first
        if iteration == most:
            break
        g = 0.0
        if iteration > 0:
            for i in range(n):
                g += row[i] * (guess[i] - z[i])
        if not solve(data, row, g, step):
            return NO_SOLUTION, iteration, first
        moved = norm(step, scale)
        if iteration == 0:
            first = moved
        if not moved < 2.0 * before:
            return DIVERGES, iteration, first
        if moved < MAY_BE_ROUNDING and moved <= 4.0 * EPSILON * norm(z, scale):
            return CONVERGED, iteration, first
        before = moved
        for i in range(n):
            z[i] += step[i]
    return SLOW, most, first


@dataclass(frozen=True, eq=False)
class Correction:
    """What the corrector reached: an evaluation, or the reason it reached none."""

    evaluation: Evaluation | None
    iterations: int
    refused: RefusalDetails | None = None
    first_step: float = 0.0

    @property
    def reason(self) -> str:
        """The reason in words."""
        return str(self.refused or "")


def correct(
    problem: Problem, guess: Array, row: Array, scale: Array, settings: Settings
) -> Correction:
    """Solve F(z) = 0, row . (z - guess) = 0 by Newton's method; see `newton`."""
    row = row / np.linalg.norm(row * scale)
    system, z = DenseSystem(problem, scale), [0.0] * len(guess)
    vectors = z, guess.tolist(), row.tolist(), scale.tolist(), [0.0] * len(z)
    most = settings.max_iterations
    status, iterations, first = newton(
        DenseSystem.evaluate, DenseSystem.solve, system, *vectors, settings.tolerance, most
    )
    if status == CONVERGED:
        return Correction(system.here, iterations, first_step=first)
    return Correction(None, iterations, failure(status, problem, z, most))


def failure(status: int, problem: Problem, z: list[float], most: int) -> RefusalDetails:
    """Return why `newton` failed at a point."""
    if status == NO_VALUE:
        return RefusalDetails(Refusal.NO_VALUE, why_no_value(problem, np.array(z)))
    reasons = {NO_SOLUTION: Refusal.NO_SOLUTION, DIVERGES: Refusal.DIVERGES, SLOW: Refusal.SLOW}
    return RefusalDetails(reasons[status], most)


def why_no_value(problem: Problem, z: Array) -> str:
    """Return in words why the equations have no finite value at a point."""
    try:
        problem.evaluate(z)
    except (ArithmeticError, ValueError) as error:
        return f"the equations have no value: {error}"
    return "the residual is not finite"


# The first point of a walk, and its test functions.

ON_ZERO = 1e-12
"""Test functions below this at a start that was solved for vanish there."""

NO_CROSSING = 1e-9
"""A test function below this at a branch point a walk starts from vanishes because of it."""


STILL = 1e-12
"""A parameter's rate below this part of the tangent is rounding: at a fold neither way is up."""


@dataclass(frozen=True, eq=False)
class Start:
    """The first point, if there is one, and why no walk leaves it, or nothing."""

    point: Point | None
    iterations: int
    reason: str = ""


TWO_DIRECTIONS = "two directions leave the first point, as where branches cross"
"""Why no branch is followed from a branch point."""


def first_point(
    problem: Problem,
    guess: Array,
    direction: int,
    tangent: Array | None,
    branching: bool,
    scale: Array,
    settings: Settings,
) -> Start:
    """Solve for the first point of a walk; parameters as of `contimpact.continuation.walk.walk`."""
    fixed = np.zeros(len(guess))
    fixed[-1] = 1.0
    row = fixed if tangent is None else tangent / scale**2
    result = correct(problem, guess, row, scale, settings)
    here, iterations = result.evaluation, result.iterations
    if here is None:
        return Start(None, iterations, result.reason)
    if tangent is None:
        tangent = first_tangent(problem, here.jacobian, scale)
        if tangent is None:
            unknown = Point(here, fixed, 0.0, 0.0, iterations)
            return Start(unknown, iterations, TWO_DIRECTIONS)
        still = abs(tangent[-1]) < STILL * scale[-1]
        direction = direction if still or tangent[-1] >= 0.0 else -direction
    else:
        tangent = tangent / length(tangent, scale)
    first: Point | None = Point(here, direction * tangent, np.nan, 0.0, iterations)
    if first is not None and not branching:
        first = point_after(first, here, iterations, scale)
    return Start(first, iterations, "" if first else "the tangent is not defined")


def test_values_at_start(values: list[Array], branching: bool, switched: bool) -> list[Array]:
    """Return the test functions at a start, those that vanish there as zero."""
    small = NO_CROSSING if branching else ON_ZERO
    if not (branching or switched):
        return values
    return [np.where(np.abs(v) < small, 0.0, v) for v in values]


def signs_on_leaving(start: Array, other: Array) -> Array:
    """Give what vanishes or has no value at a branch point the sign it leaves with."""
    tiny = np.finfo(float).tiny
    return np.where((start == 0.0) | np.isnan(start), np.sign(other) * tiny, start)


# The stretch of a branch between two neighbouring points of a walk.

CLOSEST_BRANCHES = 1e-4
"""Branches closer to each other than this part of a step are taken to cross."""

ALONG = 1e-9
"""How far before or beyond an arc a point may lie by rounding, as part of it."""

NO_TANGENT = 1e-8
"""Part of its size below which rounding decides on the tangent's orientation."""


@dataclass(frozen=True, eq=False)
class Arc:
    """Two neighbouring points of a walk, and what is needed to go between them."""

    problem: Problem
    left: Point
    right: Point
    scale: Array
    settings: Settings

    @property
    def span(self) -> float:
        """Its length along the branch."""
        return self.right.arclength - self.left.arclength

    @functools.cached_property
    def chord(self) -> Array:
        """From its left end to its right end."""
        return self.right.unknowns - self.left.unknowns

    def at(self, fraction: float) -> Point | None:
        """Return the point of the branch at a fraction of the way, or None if it is not reached."""
        guess = hermite(self.left, self.right, self.span, fraction)
        row = self.chord / self.scale**2
        result = correct(self.problem, guess, row, self.scale, self.settings)
        if result.evaluation is None:
            return None
        return self.point(result.evaluation, result.iterations)

    def near(self, fraction: float) -> Point | None:
        """Return a guess of that point, not corrected; None where the equations have no value."""
        try:
            here = self.problem.evaluate(hermite(self.left, self.right, self.span, fraction))
        except (ArithmeticError, ValueError):
            return None
        return Point(here, self.left.tangent, np.nan, self.left.arclength + fraction * self.span, 0)

    def point(
        self, evaluation: Evaluation, iterations: int, fraction: float | None = None
    ) -> Point | None:
        """Return an evaluation as a point of this arc, None where it has no tangent.

        `fraction` is that of its unknowns, if it is known.
        """
        if fraction is None:
            fraction = self.fraction(evaluation.unknowns)
        return point_after(self.left, evaluation, iterations, self.scale, fraction * self.span)

    def event_point(self, evaluation: Evaluation, iterations: int) -> Point:
        """As `point`; at a branch point, where there is none, with a tangent between the ends'."""
        fraction = self.fraction(evaluation.unknowns)
        point = self.point(evaluation, iterations, fraction)
        between = (1.0 - fraction) * self.left.tangent + fraction * self.right.tangent
        between /= length(between, self.scale)
        if point is not None:
            usual = np.fmax(abs(self.left.orientation), abs(self.right.orientation))
            known = not abs(point.orientation) < NO_TANGENT * usual
            if known and angle(point.tangent, between, self.scale) <= 2.0 * self.settings.max_angle:
                return point
        place = self.left.arclength + fraction * self.span
        return Point(evaluation, between, 0.0, place, iterations)

    def holding(self, event: Event) -> Event:
        """Return an event located on this arc, not before or beyond it by rounding."""
        place = event.point.arclength
        within = min(max(place, self.left.arclength), self.right.arclength)
        return event if place == within else event.moved_to(within)

    def fraction(self, unknowns: Array) -> float:
        """Return how far along the chord a point lies: 0 at the left end, 1 at the right end."""
        along = inner_product(unknowns - self.left.unknowns, self.chord, self.scale)
        return along / inner_product(self.chord, self.chord, self.scale)

    def halves(self, middle: Point) -> tuple[Arc, Arc]:
        """Return the arcs on both sides of a point between."""
        return replace(self, right=middle), replace(self, left=middle)

    def connected(self) -> bool:
        """Whether both ends lie on one branch, where their orientations differ.

        Bisection on the orientation closes on a branch point if there is one; if the right end lies
        on another branch, the two sides stay apart or no point is reached between them.
        """
        left, right, a, b = self.left, self.right, 0.0, 1.0
        chord = length(self.chord, self.scale)
        while b - a > CLOSEST_BRANCHES:
            middle = self.at(0.5 * (a + b))
            if middle is None:
                return False
            if (middle.orientation >= 0.0) == (self.left.orientation >= 0.0):
                left, a = middle, 0.5 * (a + b)
            else:
                right, b = middle, 0.5 * (a + b)
            if length(right.unknowns - left.unknowns, self.scale) > 4.0 * (b - a) * chord:
                return False
        return True

    def holds(self, unknowns: Array) -> bool:
        """Whether a point lies on the branch between both ends, within a step of the chord."""
        fraction = self.fraction(unknowns)
        off = unknowns - self.left.unknowns - fraction * self.chord
        near = length(off, self.scale) <= 0.5 * length(self.chord, self.scale) + ALONG
        return near and -ALONG <= fraction <= 1.0 + ALONG
