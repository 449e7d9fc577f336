"""The backend for curves of FB, PD and G of short words: plain, or several steps at a time."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array, Table, Vector
from ..bifurcations.grazing import Touching
from ..bifurcations.singular_cycle import SingularCycle
from ..compiling.library import PAYS_AFTER, CompiledProgram, load, mode, spend
from ..continuation.batch import Batch, Notice, Position, Proposal, refusal
from ..continuation.branch import Block
from ..continuation.step import (
    EVALUATIONS,
    HEAD,
    ITERATIONS,
    NEXT_STEP,
    NOTICE,
    REJECTED,
    STEP,
    take_steps,
)
from ..orbits.linearisation import CyclicBlocks, Linearisation
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
    from ..compiling.program import Program

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

ARGUMENTS = "ii" + "ffff" + "FFF" + "ffffff" + "Ffi"
"""Kinds of the entry's arguments: those of `CurveVectors`, then those of `take_steps`."""


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

    def vectors(
        self, size: int, vector: Callable[..., Vector], table: Callable[[int, int], Table]
    ) -> CurveVectors:
        """The problem as vectors and tables: lists, or arrays for compiled code."""
        orbit, system = self.problem.orbit, self.problem.system
        walls = [wall.name for wall in orbit.model.WALLS]
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
            kinds=vector(kinds, np.int64),
            counts=vector(counts, np.int64),
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
        n = len(position.scale)
        fast = self.compiled
        most = min(most, AT_ONCE) if fast else 1
        vector, table = (_array, _array_table) if fast else (_list, _list_table)
        width = 2 * n + HEAD + BLOCK * self.count + n - 1
        state, rows = vector(position.state()), vector([0.0] * (width * most))
        here, curve = position.here, self.vectors(n, vector, table)
        points = (position.scale, here.unknowns, here.tangent, position.chord())
        scale, z, tangent, chord = (vector(p.tolist()) for p in points)
        options, work = vector(position.options()), table(4, n)
        given = options, state, scale, z, tangent, chord, work, rows
        if fast:
            made = fast(*curve, *given, np.array([width, most]))
        else:
            made = take_steps(
                self.evaluate,
                newton_step,
                tangent_of_curve,
                observe_curve,
                curve,
                *given,
                width,
                most,
            )
        flights = int(state[EVALUATIONS]) * self.flights
        self.problem.orbit.kernel_evaluations += flights
        spend(0 if fast else flights)
        PLAIN[self.program] += 0 if fast else flights
        found, notices = np.asarray(rows).reshape(most, width), Notice(int(state[NOTICE]))
        proposal = None
        if notices:
            proposed = self.block(found[made : made + 1], n)
            proposal = Proposal(proposed, notices, float(state[NEXT_STEP]))
        block = self.block(found[:made], n) if made else None
        counts = int(state[ITERATIONS]), int(state[REJECTED])
        refused = refusal(position, state, self.problem, work[1])
        return Batch(block, float(state[STEP]), *counts, proposal, refused)

    @property
    def flights(self) -> int:
        """Flights evaluated at a point, those of second derivatives among them."""
        return 2 * self.count if self.variant == SINGULAR else self.count + 1

    def block(self, rows: Array, n: int) -> Block:
        """The points in the rows of `take_steps`."""
        mark = 2 * n
        sign, place, tries = rows[:, mark : mark + HEAD].T
        described = rows[:, mark + HEAD :]
        return Block(rows[:, :n], rows[:, n:mark], sign, place, tries, described, self.point).kept()

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


def backend_of(problem: CurveProblem) -> CurveBackend | None:
    """Return a curve's problem for several steps at a time.

    None where there is none: for other equations, more than one degree of freedom or two free
    parameters, long words, and flights that are no straight-line code.
    """
    orbit = problem.orbit
    variant = VARIANTS.get(type(problem.system))
    if variant is None or orbit.m != 2 or orbit.free != 2:
        return None
    if not 1 <= len(orbit.word) <= LONGEST or orbit.kernels.loops:
        return None
    return CurveBackend(problem, variant)


def _list(numbers: Sequence[float], kind: type = float) -> Vector:
    return list(numbers)


def _list_table(rows: int, columns: int) -> Table:
    return [[0.0] * columns for _ in range(rows)]


def _array(numbers: Sequence[float], kind: type = float) -> Vector:
    return np.array(numbers, dtype=kind)


def _array_table(rows: int, columns: int) -> Table:
    return np.zeros((rows, columns))
