"""Steps along curves in two parameters, plainly or compiled."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable

from ..arrays import ARRAYS, LISTS, Array, Containers, Vector
from ..bifurcations.event_solver import (
    EVALUATE,
    FUNCTIONS,
    add_kernels,
    flights_of,
    is_scalar,
    vectors_of,
)
from ..bifurcations.scalar_systems import (
    BLOCK,
    SystemVectors,
    evaluate_singular,
    evaluate_touching,
    newton_step,
    solve_bordered,
)
from ..continuation.branch import Block
from ..continuation.step import EVALUATIONS, Backend, Batch, Position, batch_of, columns, take_steps
from ..orbits.problem import Linearisation
from ..segments.compiling import CompiledProgram, load, mode, timed_plainly
from ..segments.kernels import Kernels
from ..segments.layout import Setup
from ..segments.machine_code import Program
from .curve_problem import CurvePoint, CurveProblem
from .orbit_walks import SwitchingBackend

SMALLEST = -700.0
"""The least logarithm of a determinant."""


def tangent_of_curve(
    curve: SystemVectors, z: Vector, row: Vector, scale: Vector, out: Vector
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
    curve: SystemVectors, z: Vector, tangent: Vector, orientation: float, row: Vector, at: int
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
    curve = SystemVectors({fields})
    vectors = (options, state, scale, z, tangent, chord, work, rows)
    return take_steps(evaluate, newton_step, tangent_of_curve, observe_curve, curve, vectors)

def any_setup(p):
    return kernel_setup({p})
"""


def program_of(kernels: Kernels, variant: str) -> Program:
    """Return the program that takes steps along curves of any word of a model.

    Both parameters of the kernels are free; the variant is "singular" for FB and PD, "touching" for
    G.
    """
    program = Program({})
    p = add_kernels(program, kernels, variant, "any")
    evaluate = FUNCTIONS[variant][0]
    called: list[Callable[..., object]] = [
        take_steps,
        newton_step,
        tangent_of_curve,
        observe_curve,
        evaluate,
    ]
    named = {function.__name__: function for function in called}
    text = EVALUATE[variant] + ENTRY.format(fields=", ".join(SystemVectors._fields), p=p)
    program.glue(text, kernel_setup=kernels.setup, **named)
    return program


AT_ONCE = 8
"""Steps made at a time by compiled code; those beyond the end of a curve are made in vain."""

ARGUMENTS = "ii" + "ffff" + "FFF" + "ffffff" + "FF"
"""Kinds of the entry's arguments: those of `SystemVectors`, then those of `StepVectors`."""


class CurveBackend(Backend):
    """A curve's problem as steps ask for it, by the equations `variant`; use `backend_of`."""

    def __init__(self, problem: CurveProblem, variant: str) -> None:
        self.problem, self.variant = problem, variant
        self.count = len(problem.orbit.word)
        self.made: dict[bytes, CurvePoint] = {}

    def vectors(self, size: int, made_by: Containers) -> SystemVectors:
        """The problem as vectors and tables."""
        orbit, form = self.problem.orbit, self.problem.system.form
        assert form is not None
        second = list(orbit.model.values).index(orbit.kernels.parameters[1])
        return vectors_of(orbit, form, size, second, made_by)

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
        return 2 * self.count if self.variant == "singular" else self.count + 1

    def block(self, rows: Array, n: int) -> Block:
        """The points in the rows of `take_steps`."""
        return Block(*columns(rows, n), self.point)

    def point(self, unknowns: Array, described: Array) -> CurvePoint:
        """The point of a row, made once: what is asked of it is kept with it."""
        key = unknowns.tobytes()
        if key not in self.made:
            orbit, own = self.problem.unpacked(unknowns)
            blocks = flights_of(described[: BLOCK * self.count].reshape(-1, BLOCK), 2)
            here = Linearisation(self.problem.orbit, orbit, blocks)
            residual = described[BLOCK * self.count :]
            self.made[key] = CurvePoint(self.problem, unknowns, residual, here, own)
        return self.made[key]

    @functools.cached_property
    def evaluate(self) -> Callable[[SystemVectors, Vector], float]:
        """The plain evaluation."""
        kernels = self.problem.orbit.kernels
        flight, singular = kernels.flights, self.variant == "singular"

        def setup(values: Vector) -> Setup:
            return kernels.setup(*values)

        def evaluate(curve: SystemVectors, z: Vector) -> float:
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
    form = problem.system.form
    if form is None or orbit.free != 2 or not is_scalar(orbit):
        return None
    backend = CurveBackend(problem, form.variant)
    if not any(orbit.kernels.flown(*kind) for kind in orbit.kinds):
        return backend
    return SwitchingBackend(backend, problem, orbit.kernels)
