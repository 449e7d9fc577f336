"""Steps along curves in two parameters, plainly or compiled."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import NamedTuple

from ..arrays import ARRAYS, LISTS, Array, Containers, Table, Vector
from ..bifurcations.extended_system import SingularCycle
from ..bifurcations.sliding import SlidingTouch
from ..continuation.branch import Block
from ..continuation.step import EVALUATIONS, Batch, Position, batch_of, columns, take_steps
from ..orbits.problem import CyclicBlocks, Linearisation
from ..segments.compiling import CompiledProgram, load, mode, timed_plainly
from ..segments.kernels import Kernels
from ..segments.layout import Blocks, Setup
from ..segments.machine_code import Program
from .curve_problem import CurvePoint, CurveProblem
from .orbit_program import choice
from .orbit_walks import SwitchingBackend

# What a step asks of a curve of FB, PD or G of orbits with one degree of freedom.
#
# Functions in the plain subset of Python that `contimpact.compiling` compiles, which run plainly or
# compiled. The unknowns are t_1, v_1, ..., t_N, v_N, lambda, those that the equations add, and mu;
# the equations are those of `contimpact.bifurcations.extended_system`.

PERIODS, FIRST, SECOND, FLIGHT, TOUCH = range(5)
"""Places in `counts`: how many periods, the places of both free parameters among the values, and of
a touch the flight and its kind."""

BLOCK = 14
"""Numbers of a flight: 2 residuals, the blocks A and B row by row, and the derivatives of both
residuals by lambda and mu in turn."""

SMALLEST = -700.0
"""The least logarithm of a determinant."""


class CurveVectors(NamedTuple):
    """A curve's problem as vectors and tables."""

    kinds: Vector
    """Kinds of the flights."""
    counts: Vector
    """See `PERIODS`."""
    numbers: Vector
    """The multiplier mu of a singular cycle."""
    values: Vector
    """Parameter values."""
    residual: Vector
    right: Vector
    """`residual`, `right`: the residuals at the point last evaluated, and scratch space."""
    blocks: Table
    """Its flights, a row of `BLOCK` numbers each."""
    jacobian: Table
    factors: Table
    """`jacobian`, `factors`: the Jacobian there, and scratch space for it and a border."""


def evaluate_orbit(
    flight: Callable[..., Blocks], setup: Callable[[Vector], Setup], curve: CurveVectors, z: Vector
) -> tuple[float, float, float]:
    """Evaluate the flights into the first rows of the Jacobian, all else of which becomes zero.

    Returns the orbit's period and its derivatives by both parameters.
    """
    count, last = len(curve.kinds), len(z) - 1
    n, values = 2 * count, curve.values
    values[curve.counts[FIRST]], values[curve.counts[SECOND]] = z[n], z[last]
    period, slopes, _, _, _, _ = setup(values)
    periods = curve.counts[PERIODS]
    span, drift, other = periods * period, periods * slopes[0], periods * slopes[1]
    for i in range(last):
        row = curve.jacobian[i]
        for j in range(last + 1):
            row[j] = 0.0
    for k in range(count):
        i = 2 * k
        j = i + 2 if k + 1 < count else 0
        arrival = z[j] if k + 1 < count else z[0] + span
        r, a, b, free = flight(curve.kinds[k], z[i], z[i + 1], arrival, z[j + 1], values)
        f0, f1, f2, f3 = free
        if k + 1 == count:  # the arrival at t_1 + pT moves with T
            f0, f1 = f0 + drift * b[0], f1 + other * b[0]
            f2, f3 = f2 + drift * b[2], f3 + other * b[2]
        keep_block(curve.blocks[k], r, a, b, f0, f1, f2, f3)
        curve.residual[i], curve.residual[i + 1] = r[0], r[1]
        put_flight(curve.jacobian, i, i, j, n, last, curve.blocks[k])
    return span, drift, other


def keep_block(
    row: Vector, r: Vector, a: Vector, b: Vector, f0: float, f1: float, f2: float, f3: float
) -> None:
    """Fill the row of a flight."""
    row[0], row[1] = r[0], r[1]
    row[2], row[3], row[4], row[5] = a[0], a[1], a[2], a[3]
    row[6], row[7], row[8], row[9] = b[0], b[1], b[2], b[3]
    row[10], row[11], row[12], row[13] = f0, f1, f2, f3


def put_flight(
    table: Table, i: int, start: int, end: int, first: int, second: int, block: Vector
) -> None:
    """Add a flight to two rows of the Jacobian, given the columns of its ends and parameters."""
    for half in range(2):
        row, at = table[i + half], 2 * half
        row[start] += block[2 + at]
        row[start + 1] += block[3 + at]
        row[end] += block[6 + at]
        row[end + 1] += block[7 + at]
        row[first] += block[10 + at]
        row[second] += block[11 + at]


def evaluate_singular(
    flight: Callable[..., Blocks],
    second: Callable[..., Blocks],
    setup: Callable[[Vector], Setup],
    curve: CurveVectors,
    z: Vector,
) -> float:
    """Evaluate F = 0, C(mu) q = 0, (q.q - 1)/2 = 0; returns the largest residual."""
    count, last, mu = len(curve.kinds), len(z) - 1, curve.numbers[0]
    n, own = 2 * count, 2 * count + 1
    span, drift, other = evaluate_orbit(flight, setup, curve, z)
    norm = curve.jacobian[last - 1]
    square = 0.0
    for k in range(count):
        i = 2 * k
        j = i + 2 if k + 1 < count else 0
        factor = 1.0 if k + 1 < count else mu
        arrival = z[j] if k + 1 < count else z[0] + span
        q0, q1 = z[own + i], z[own + i + 1]
        p0, p1 = factor * z[own + j], factor * z[own + j + 1]
        _, a, b, free = second(
            curve.kinds[k], z[i], z[i + 1], arrival, z[j + 1], q0, q1, p0, p1, curve.values
        )
        block = curve.blocks[k]
        for half in range(2):
            row, at = curve.jacobian[n + i + half], 2 * half
            row[i] += a[at]
            row[i + 1] += a[at + 1]
            row[j] += b[at]
            row[j + 1] += b[at + 1]
            row[n] += free[at]
            row[last] += free[at + 1]
            if k + 1 == count:
                row[n] += b[at] * drift
                row[last] += b[at] * other
            row[own + i] += block[2 + at]
            row[own + i + 1] += block[3 + at]
            row[own + j] += factor * block[6 + at]
            row[own + j + 1] += factor * block[7 + at]
            leaving = block[2 + at] * q0 + block[3 + at] * q1
            curve.residual[n + i + half] = leaving + block[6 + at] * p0 + block[7 + at] * p1
        norm[own + i], norm[own + i + 1] = q0, q1
        square += q0 * q0 + q1 * q1
    curve.residual[last - 1] = 0.5 * (square - 1.0)
    return largest(curve.residual)


def evaluate_touching(
    flight: Callable[..., Blocks], setup: Callable[[Vector], Setup], curve: CurveVectors, z: Vector
) -> float:
    """Evaluate F = 0 and a flight that reaches its touch with no velocity; the touch's time is the
    unknown between both parameters."""
    n, last = 2 * len(curve.kinds), len(z) - 1
    evaluate_orbit(flight, setup, curve, z)
    i = 2 * curve.counts[FLIGHT]
    kind = curve.counts[TOUCH]
    r, a, b, free = flight(kind, z[i], z[i + 1], z[n + 1], 0.0, curve.values)
    for half in range(2):
        row, at = curve.jacobian[n + half], 2 * half
        row[i], row[i + 1] = a[at], a[at + 1]
        row[n], row[last] = free[at], free[at + 1]
        row[n + 1] = b[at]
        curve.residual[n + half] = r[half]
    return largest(curve.residual)


def largest(residual: Vector) -> float:
    """Return the largest absolute value; NaN where one is not a number."""
    size, total = 0.0, 0.0
    for i in range(len(residual)):
        size = max(size, abs(residual[i]))
        total += abs(residual[i])
    return size if total - total == 0.0 else math.nan


def factor(matrix: Table, right: Vector) -> tuple[float, float]:
    """Eliminate with partial pivoting, the right side as well.

    Returns sign and logarithm of the determinant; the sign is 0 where it vanishes.
    """
    n = len(right)
    sign, logarithm = 1.0, 0.0
    for c in range(n):
        pivot, size = c, abs(matrix[c][c])
        for r in range(c + 1, n):
            if abs(matrix[r][c]) > size:
                pivot, size = r, abs(matrix[r][c])
        if not size > 0.0:
            return 0.0, 0.0
        head, other = matrix[c], matrix[pivot]
        if pivot != c:
            for j in range(c, n):
                head[j], other[j] = other[j], head[j]
            right[c], right[pivot] = right[pivot], right[c]
            sign = -sign
        if head[c] < 0.0:
            sign = -sign
        logarithm += math.log(size)
        for r in range(c + 1, n):
            row = matrix[r]
            s = row[c] / head[c]
            if s != 0.0:
                for j in range(c + 1, n):
                    row[j] -= s * head[j]
                right[r] -= s * right[c]
    return sign, logarithm


def solve_bordered(
    curve: CurveVectors, row: Vector, factor_of_residual: float, g: float, out: Vector
) -> tuple[float, float]:
    """Fill `out` with the solution of the Jacobian bordered by a row, its right side a multiple of
    the residual, and g; returns sign and logarithm of the determinant."""
    n = len(out)
    last, right = n - 1, curve.right
    for i in range(last):
        given, copied = curve.jacobian[i], curve.factors[i]
        for j in range(n):
            copied[j] = given[j]
        right[i] = factor_of_residual * curve.residual[i]
    border = curve.factors[last]
    for j in range(n):
        border[j] = row[j]
    right[last] = g
    sign, logarithm = factor(curve.factors, right)
    if sign != 0.0:
        for i in range(last, -1, -1):
            line, value = curve.factors[i], right[i]
            for j in range(i + 1, n):
                value -= line[j] * out[j]
            out[i] = value / line[i]
    return sign, logarithm


def newton_step(curve: CurveVectors, row: Vector, g: float, out: Vector) -> bool:
    """Fill `out` with Newton's step at the point last evaluated; whether there is one."""
    return solve_bordered(curve, row, -1.0, g, out)[0] != 0.0


def tangent_of_curve(
    curve: CurveVectors, z: Vector, row: Vector, scale: Vector, out: Vector
) -> float:
    """Fill `out` with the unit tangent at the point last evaluated that goes on along `row`.

    Returns the determinant of the Jacobian bordered by the tangent, columns by their scales and
    rows by their lengths; NaN where no tangent is defined.
    """
    n = len(z)
    sign, logarithm = solve_bordered(curve, row, 0.0, 1.0, out)
    size = 0.0
    for i in range(n):
        part = out[i] / scale[i]
        size += part * part
    size = math.sqrt(size)
    if not (sign != 0.0 and size > 0.0 and size - size == 0.0):
        return math.nan
    for i in range(n):
        out[i] /= size
        logarithm += math.log(scale[i])
    for i in range(n - 1):
        given, length = curve.jacobian[i], 0.0
        for j in range(n):
            part = given[j] * scale[j]
            length += part * part
        if not length > 0.0:
            return 0.0
        logarithm -= 0.5 * math.log(length)
    # the border is row / scale^2; with the tangent itself in its place it is longer by `size`
    return sign * math.exp(max(logarithm + math.log(size), SMALLEST))


def observe_curve(
    curve: CurveVectors, z: Vector, tangent: Vector, orientation: float, row: Vector, at: int
) -> None:
    """Record flights and residuals in a row."""
    for k in range(len(curve.kinds)):
        block = curve.blocks[k]
        for i in range(BLOCK):
            row[at + i] = block[i]
        at += BLOCK
    for i in range(len(curve.residual)):
        row[at + i] = curve.residual[i]


# The program that takes steps along curves of one kind for any word of a model, for compiling.

ENTRY = """
def entry({fields}, options, state, scale, z, tangent, chord, work, rows):
    curve = CurveVectors({fields})
    vectors = (options, state, scale, z, tangent, chord, work, rows)
    return take_steps(evaluate, newton_step, tangent_of_curve, observe_curve, curve, vectors)

def any_setup(p):
    return kernel_setup({p})
"""

EVALUATE = {
    "singular": """
def evaluate(curve, z):
    return evaluate_singular(any_flight, any_second, any_setup, curve, z)
""",
    "touching": """
def evaluate(curve, z):
    return evaluate_touching(any_flight, any_setup, curve, z)
""",
}


def program_of(kernels: Kernels, variant: str) -> Program:
    """Return the program that takes steps along curves of any word of a model.

    Parameters
    ----------
    kernels : Kernels
        With both parameters free.
    variant : str
        The equations: "singular" for FB and PD, "touching" for G.
    """
    program = Program({})
    p = ", ".join(f"p[{i}]" for i in range(len(kernels.model.values)))
    walls = kernels.model.letters
    pairs = [(a, b) for a in walls for b in walls]
    flights = {f"flight_{a}_{b}": kernels.flight(a, b) for a, b in pairs}
    ends = "t0, v0, t1, v1"
    chosen = choice("any_flight", f"kind, {ends}, p", "kind", list(flights), f"{ends}, {p}")
    program.glue(chosen, **flights)
    called: list[Callable[..., object]] = [take_steps, newton_step, tangent_of_curve, observe_curve]
    if variant == "singular":
        along = f"{ends}, q0, q1, q2, q3"
        seconds = {f"second_{a}_{b}": kernels.second(a, b) for a, b in pairs}
        text = choice(
            "any_second", f"kind, {along}, p", "kind", list(seconds), f"{along}, 0.0, 0.0, {p}"
        )
        program.glue(text, **seconds)
        called.append(evaluate_singular)
    else:
        called.append(evaluate_touching)
    program.constant("CurveVectors", CurveVectors)
    named = {function.__name__: function for function in called}
    text = EVALUATE[variant] + ENTRY.format(fields=", ".join(CurveVectors._fields), p=p)
    program.glue(text, kernel_setup=kernels.setup, **named)
    return program


LONGEST = 8
"""Impacts of a word up to which elimination without regard to the matrix's structure pays."""

AT_ONCE = 8
"""Steps made at a time by compiled code; those beyond the end of a curve are made in vain."""

SINGULAR, TOUCHING = "singular", "touching"
VARIANTS = {SingularCycle: SINGULAR, SlidingTouch: TOUCHING}
"""Equations that are compiled."""

ARGUMENTS = "ii" + "ffff" + "FFF" + "ffffff" + "FF"
"""Kinds of the entry's arguments: those of `CurveVectors`, then those of `StepVectors`."""


class CurveBackend:
    """A curve's problem as steps ask for it; use `backend_of`.

    Parameters
    ----------
    problem : CurveProblem
    variant : str
        Its equations.
    """

    def __init__(self, problem: CurveProblem, variant: str) -> None:
        self.problem, self.variant = problem, variant
        self.count = len(problem.orbit.word)
        self.made: dict[bytes, CurvePoint] = {}

    def vectors(self, size: int, made_by: Containers) -> CurveVectors:
        """The problem as vectors and tables."""
        vector, table = made_by
        orbit, system = self.problem.orbit, self.problem.system
        walls = orbit.model.letters
        names, places = list(orbit.model.values), [walls.index(a) for a in orbit.word.walls]
        kinds = [len(walls) * a + b for a, b in zip(places, [*places[1:], places[0]], strict=True)]
        first, second = (names.index(name) for name in orbit.kernels.parameters)
        flight, touch, mu = 0, 0, 0.0
        if isinstance(system, SlidingTouch):
            flight = system.flight
            touch = len(walls) * places[flight] + walls.index(system.wall)
        elif isinstance(system, SingularCycle):
            mu = system.mu
        counts = [orbit.word.period, first, second, flight, touch]
        return CurveVectors(
            kinds=vector(kinds),
            counts=vector(counts),
            numbers=vector([mu]),
            values=vector(list(orbit.model.values.values())),
            residual=vector([0.0] * (size - 1)),
            right=vector([0.0] * size),
            blocks=table(self.count, BLOCK),
            jacobian=table(size - 1, size),
            factors=table(size, size),
        )

    def advance(self, position: Position, most: int) -> Batch:
        """Take steps until one is proposed or refused, `most` at most; plainly, one."""
        n, fast = len(position.scale), self.compiled
        made_by, most = (ARRAYS, min(most, AT_ONCE)) if fast else (LISTS, 1)
        curve = self.vectors(n, made_by)
        vectors = position.vectors(BLOCK * self.count + n - 1, most, made_by)
        if fast:
            made = fast(*curve, *vectors)
        else:
            functions = self.evaluate, newton_step, tangent_of_curve, observe_curve
            with timed_plainly(self.program):
                made = take_steps(*functions, curve, tuple(vectors))
        flights = int(vectors.state[EVALUATIONS]) * self.flights
        self.problem.orbit.kernel_evaluations += flights
        return batch_of(position, self.problem, vectors, made, lambda rows: self.block(rows, n))

    @property
    def flights(self) -> int:
        """Flights evaluated at a point, those of second derivatives among them."""
        return 2 * self.count if self.variant == SINGULAR else self.count + 1

    def block(self, rows: Array, n: int) -> Block:
        """The points in the rows of `take_steps`."""
        return Block(*columns(rows, n), self.point)

    def point(self, unknowns: Array, described: Array) -> CurvePoint:
        """The point of a row, made once: what is asked of it is kept with it."""
        key = unknowns.tobytes()
        if key not in self.made:
            orbit, own = self.problem.unpacked(unknowns)
            flights = described[: BLOCK * self.count].reshape(-1, BLOCK)
            start, end = (flights[:, i : i + 4].reshape(-1, 2, 2) for i in (2, 6))
            free = flights[:, 10:].reshape(-1, 2)
            blocks = CyclicBlocks(flights[:, :2].ravel(), start, end, free)
            here = Linearisation(self.problem.orbit, orbit, blocks)
            residual = described[BLOCK * self.count :]
            self.made[key] = CurvePoint(self.problem, unknowns, residual, here, own)
        return self.made[key]

    @functools.cached_property
    def evaluate(self) -> Callable[[CurveVectors, Vector], float]:
        """The plain evaluation."""
        kernels = self.problem.orbit.kernels
        flight, singular = kernels.flights, self.variant == SINGULAR

        def setup(values: Vector) -> Setup:
            return kernels.setup(*values)

        def evaluate(curve: CurveVectors, z: Vector) -> float:
            try:
                if singular:
                    return evaluate_singular(flight, kernels.seconds, setup, curve, z)
                return evaluate_touching(flight, setup, curve, z)
            except (ArithmeticError, ValueError):
                return math.nan

        return evaluate

    @functools.cached_property
    def compiled(self) -> CompiledProgram | None:
        """Compiled code, where there is any and it pays."""
        if mode() == "never":
            return None
        kernels, variant = self.problem.orbit.kernels, self.variant

        def build() -> Program:

            return program_of(kernels, variant)

        return load(self.program, ARGUMENTS, build)

    @property
    def program(self) -> tuple[str, ...]:
        """What tells its program from others."""
        return self.problem.orbit.kernels.identity, self.variant, "curves"


def backend_of(problem: CurveProblem) -> CurveBackend | SwitchingBackend | None:
    """Return a curve's problem for several steps at a time.

    None where there is none: for other equations, more than one degree of freedom or two free
    parameters, free periods, long words, and flights that are no straight-line code.
    """
    orbit = problem.orbit
    variant = VARIANTS.get(type(problem.system))
    if variant is None or orbit.m != 2 or orbit.free != 2 or orbit.autonomous:
        return None
    if not 1 <= len(orbit.word) <= LONGEST or orbit.kernels.loops:
        return None
    backend = CurveBackend(problem, variant)
    if not any(orbit.kernels.flown(*kind) for kind in orbit.kinds):
        return backend
    return SwitchingBackend(backend, problem, orbit.kernels)
