"""The backend for curves of FB, PD and G of short words: plain, or several steps at a time."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING

from ..arrays import ARRAYS, LISTS, Array, Containers, Vector
from ..bifurcations.extended_system import SingularCycle
from ..bifurcations.grazing import Touching
from ..continuation.branch import Block
from ..continuation.step import EVALUATIONS, Batch, Position, batch_of, columns, take_steps
from ..orbit_continuation.long_flights import UntilLong
from ..orbits.problem import CyclicBlocks, Linearisation
from ..segments.compiling import PAYS_AFTER, CompiledProgram, load, mode, spend
from ..segments.layout import Setup
from .curve_functions import (
    BLOCK,
    CurveVectors,
    evaluate_singular,
    evaluate_touching,
    newton_step,
    observe_curve,
    tangent_of_curve,
)
from .problem import CurvePoint, CurveProblem

if TYPE_CHECKING:
    from ..segments.machine_code import Program

LONGEST = 8
"""Impacts of a word up to which elimination without regard to the matrix's structure pays."""

AT_ONCE = 8
"""Steps made at a time by compiled code; those beyond the end of a curve are made in vain."""

SINGULAR, TOUCHING = "singular", "touching"
VARIANTS = {SingularCycle: SINGULAR, Touching: TOUCHING}
"""Which equations are compiled."""

PLAIN: Counter[tuple[str, str]] = Counter()
"""Flights evaluated plainly on the curves of each program. Those of two other parameters have
another one, and a map has few curves."""

ARGUMENTS = "ii" + "ffff" + "FFF" + "ffffff" + "FF"
"""Kinds of the entry's arguments: those of `CurveVectors`, then those of `StepVectors`."""


class CurveBackend:
    """A curve's problem as steps ask for it; use `backend_of`.

    Parameters
    ----------
    problem : CurveProblem
    variant : str
        Its equations; see `curve_program`.
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
        if isinstance(system, Touching):
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
            made = take_steps(*functions, curve, tuple(vectors))
        flights = int(vectors.state[EVALUATIONS]) * self.flights
        self.problem.orbit.kernel_evaluations += flights
        spend(0 if fast else flights)
        PLAIN[self.program] += 0 if fast else flights
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
            from .curve_program import program_of

            return program_of(kernels, variant)

        worth = PLAIN[self.program] >= PAYS_AFTER
        return load((*self.program, "curves"), ARGUMENTS, build, worth)

    @property
    def program(self) -> tuple[str, str]:
        """What tells its program from others."""
        return self.problem.orbit.kernels.identity, self.variant


def backend_of(problem: CurveProblem) -> CurveBackend | UntilLong | None:
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
    return UntilLong(backend, problem, orbit.kernels)
