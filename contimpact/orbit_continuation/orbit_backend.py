"""The backend for orbits with one degree of freedom: many steps at a time, plain or compiled."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias, Unpack

import numpy as np

from ..arrays import Array, Table, Vector
from ..bifurcations.orbit_test import ManyOrbits, OrbitTest
from ..bifurcations.status import explained
from ..bifurcations.unfolding import meeting
from ..compiling.library import CompiledProgram, load, mode, plainly, spend
from ..continuation.batch import Batch, Notice, Position, Proposal, refusal
from ..continuation.branch import Block, Walk
from ..continuation.corrector import Evaluate, Solve
from ..continuation.settings import Settings
from ..continuation.step import (
    EVALUATIONS,
    HEAD,
    ITERATIONS,
    NEXT_STEP,
    NOTICE,
    REJECTED,
    STEP,
    Observe,
    TangentAt,
    take_steps,
)
from ..continuation.test_function import TestFunction
from ..continuation.walk import Options, walk
from ..orbits.block_cyclic import BLOCK, KEPT, POSITIONS
from ..orbits.linearisation import Linearisation
from ..orbits.problem import OrbitProblem
from ..segments.flight import excursion_of
from ..segments.layout import Setup
from ..segments.oscillation import MOST, ROW
from ..segments.zeros import time_zeros
from .linear_flights import space_for
from .orbit_functions import (
    DESCRIBED,
    DETERMINANT,
    MEASURED,
    PRODUCT,
    SPAN,
    UNRESOLVED,
    OrbitVectors,
    evaluate_cycle,
    newton_step,
    observe_cycle,
    tangent_of_cycle,
)

if TYPE_CHECKING:
    from ..compiling.program import Program


WORTH = 64
"""Points asked for at once from which compiled code is looked for."""


class OrbitBackend:
    """An orbit problem as steps ask for it: block-cyclic elimination, many steps at a time.

    Parameters
    ----------
    problem : OrbitProblem
        With one degree of freedom and one free parameter.
    gaps : bool
        Whether to decide at every point if it is physical.
    doubling : bool
        Whether the determinant of a PD is wanted.
    """

    def __init__(self, problem: OrbitProblem, gaps: bool, doubling: bool) -> None:
        self.problem, self.gaps, self.doubling = problem, gaps, doubling
        kernels, values = problem.kernels, problem.model.values.values()
        setup = kernels.setup(*values)
        self.fixed = POSITIONS + len(setup.walls) + len(setup.derived)
        self.zeros = time_zeros(kernels.harmonics(*values), setup.period)
        self.functions = plain_functions(problem, self.zeros)
        self.count, self.walls = len(problem.word), len(problem.model.WALLS)
        self.derived = len(problem.model.DERIVED)

    def vectors(
        self, vector: Callable[..., Vector], table: Callable[[int, int], Table]
    ) -> OrbitVectors:
        """The branch as vectors and tables: lists, or arrays for compiled code."""
        problem, count, walls = self.problem, self.count, self.walls
        named = [wall.name for wall in problem.model.WALLS]
        word = [named.index(letter) for letter in problem.word.walls]
        place = list(problem.model.values).index(problem.parameter)
        wanted = [int(self.gaps), int(self.doubling)]
        passages = problem.kernels.passages
        return OrbitVectors(
            kinds=vector([a * walls + b for a, b in zip(word, word[1:] + word[:1], strict=True)]),
            word=vector(word),
            arrivals=vector(problem.arrivals),
            watched=vector([int(meets) for row in passages.watched for meets in row]),
            counts=vector([walls, problem.word.period, place, self.derived, *wanted]),
            values=vector(list(problem.model.values.values())),
            sides=vector([float(wall.side) for wall in problem.model.WALLS]),
            leaving=vector(passages.leaving),
            zeros=vector([0.0] * 2 if self.variant == "single" else self.zeros or [], float),
            blocks=table(count, BLOCK),
            kept=table(count, KEPT),
            reduced=table(1, KEPT),
            fixed=table(1, self.fixed),
            clock=vector([0.0] * 3),
            steps=table(0, ROW),
            durations=vector([0.0] * count),
            gaps=vector([0.0] * count * walls),
            times=vector([0.0] * count * walls),
            velocities=vector([0.0] * count),
        )

    def advance(self, position: Position, most: int) -> Batch:
        """Take steps until one is proposed or refused, `most` at most."""
        fast = self.compiled(most)
        if fast is None:
            return self.steps(position, most, None)
        self.arrays.clock[UNRESOLVED] = 0.0
        made = self.steps(position, most, fast)
        if self.arrays.clock[UNRESOLVED] == 0.0:
            return made
        import logging

        logging.getLogger(__name__).info("flights too stiff for compiled code: going on plainly")
        self.variant = None
        return self.steps(position, most, None)

    def steps(self, position: Position, most: int, fast: CompiledProgram | None) -> Batch:
        """Take them by compiled code, or plainly."""
        n = len(position.scale)
        width = 2 * n + HEAD + MEASURED + self.count * (self.walls + 1) + self.derived
        vector = _array if fast else _list
        state = vector(position.state())
        rows = np.zeros(width * most) if fast else [0.0] * (width * most)
        work = np.zeros((4, n)) if fast else _list_table(4, n)
        here = position.here
        points = (position.scale, here.unknowns, here.tangent, position.chord())
        orbit = self.arrays if fast else [self.lists]
        size = [vector([width, most])] if fast else [width, most]
        settings, at = vector(position.options(), float), [vector(p) for p in points]
        given: list[Vector] = [*orbit, settings, state, *at, work, rows, *size]
        made = fast(*given) if fast else take_steps(*self.functions, *given)
        flights = int(state[EVALUATIONS]) * self.count
        self.problem.kernel_evaluations += flights
        spend(0 if fast else flights)
        table = np.asarray(rows).reshape(most, width)
        del given, rows  # lists take four times the space
        notices = Notice(int(state[NOTICE]))
        proposal = None
        if notices:
            proposed = self.block(table[made : made + 1], n)
            proposal = Proposal(proposed, notices, float(state[NEXT_STEP]))
        block = self.block(table[:made], n) if made else None
        counts = int(state[ITERATIONS]), int(state[REJECTED])
        refused = refusal(position, state, self.problem, work[1])
        return Batch(block, float(state[STEP]), *counts, proposal, refused)

    @functools.cached_property
    def obstacle(self) -> str:
        """Why there is no compiled code."""
        if self.zeros is None:
            return "flights whose equations are not linear, or too stiff"
        return "a forcing whose harmonics change along a branch"

    @functools.cached_property
    def space(self) -> int:
        """Numbers of scratch space behind the parameter values of compiled code."""
        return space_for(self.problem.kernels)

    def block(self, rows: Array, n: int) -> Block:
        """The points in the rows of `take_steps`."""
        mark = 2 * n
        seen = rows[:, mark + HEAD :]
        sign, place, tries = rows[:, mark : mark + HEAD].T
        about, made = seen[:, :DESCRIBED], self.problem.described
        block = Block(rows[:, :n], rows[:, n:mark], sign, place, tries, about, made).kept()
        gaps = MEASURED + self.count * self.walls
        turns = gaps + self.count
        points = block.unknowns, block.tangents, block.orientations
        cycle = seen[:, SPAN], seen[:, DETERMINANT], seen[:, PRODUCT, None]
        nearest = seen[:, MEASURED:gaps].reshape(-1, self.count, self.walls)
        measured = ManyOrbits(*points, *cycle, nearest, seen[:, gaps:turns], seen[:, turns:])
        return replace(block, measured=measured)

    @functools.cached_property
    def lists(self) -> OrbitVectors:
        """The branch as lists, for a plain run."""
        return self.vectors(_list, _list_table)

    @functools.cached_property
    def arrays(self) -> OrbitVectors:
        """The branch as arrays, for compiled code."""
        given = self.vectors(_array, lambda rows, columns: np.zeros((rows, columns)))
        if self.space:
            given = given._replace(values=np.append(given.values, np.zeros(self.space)))
        if self.variant == "law":
            given = given._replace(steps=np.zeros((MOST, ROW)), zeros=np.zeros(2 * MOST))
        return given

    def compiled(self, most: int) -> CompiledProgram | None:
        """Compiled code, where there is any and the work is worth it."""
        said = mode()
        if said == "never" or (said == "auto" and most < WORTH):
            return None
        if self.variant is None:
            plainly(self.obstacle)
            return None
        kernels, variant = self.problem.kernels, self.variant

        def build() -> Program:
            from .orbit_program import program_of

            return program_of(kernels, variant)

        return load((kernels.identity, variant), ARGUMENTS, build)

    @functools.cached_property
    def variant(self) -> str | None:
        """How compiled code finds the zeros of the acceleration; None where it cannot."""
        kernels, values = self.problem.kernels, self.problem.model.values.values()
        harmonics = kernels.harmonics(*values)
        if math.isnan(harmonics[0]):
            return "law" if kernels.oscillates else None
        if not kernels.depends("harmonics"):
            return "fixed"
        return "single" if len(harmonics) == 4 and harmonics[1] == 1 else None


def _list(numbers: Vector, kind: type = float) -> Vector:
    return numbers.tolist() if isinstance(numbers, np.ndarray) else list(numbers)


def _list_table(rows: int, columns: int) -> Table:
    return [[0.0] * columns for _ in range(rows)]


def _array(numbers: Vector, kind: type | None = None) -> Vector:
    if kind is None and not isinstance(numbers, np.ndarray):
        kind = float if len(numbers) and isinstance(numbers[0], float) else np.int64
    return np.array(numbers, dtype=kind)


ARGUMENTS = "iiiii" + "ffff" + "FFFF" + "fF" + "ffff" + "ff" + "ffff" + "Ffi"
"""Kinds of the entry's arguments: those of `OrbitVectors`, then those of `take_steps`."""

Functions: TypeAlias = tuple[
    Evaluate[OrbitVectors], Solve[OrbitVectors], TangentAt[OrbitVectors], Observe[OrbitVectors]
]


def plain_functions(problem: OrbitProblem, fixed: list[float] | None) -> Functions:
    """Return what `take_steps` needs of a problem: evaluate, solve, tangent_at and observe.

    `fixed` are the zeros of the acceleration, where they are the same along the branch.
    """
    kernels = problem.kernels
    in_time = not math.isnan(kernels.harmonics(*problem.model.values.values())[0])
    flight, excursion = kernels.flights, excursion_of(kernels, in_time)
    moving = kernels.depends("harmonics")

    def setup(values: Vector) -> Setup:
        return kernels.setup(*values)

    def evaluate(orbit: OrbitVectors, z: Vector) -> float:
        try:
            return evaluate_cycle(flight, setup, orbit, z)
        except (ArithmeticError, ValueError):
            return math.nan

    def breaks(values: Vector, period: float, zeros: Vector) -> list[float] | None:
        return time_zeros(kernels.harmonics(*values), period) if moving else fixed

    def observe(
        orbit: OrbitVectors, z: Vector, tangent: Vector, sign: float, rows: Vector, at: int
    ) -> None:
        observe_cycle(breaks, excursion, orbit, z, tangent, sign, rows, at)

    return evaluate, newton_step, tangent_of_cycle, observe


def walk_orbits(
    problem: OrbitProblem,
    start: Array,
    direction: int,
    *,
    tests: Sequence[TestFunction[Linearisation]] = (),
    gaps: bool = True,
    **options: Unpack[Options],
) -> Walk[Linearisation]:
    """As `contimpact.continuation.walk.walk`, for orbits: on a backend of their own.

    With `gaps` it is decided at every point if the orbit is physical, and changes of that or of the
    number of unstable multipliers are explained by events; see `contimpact.bifurcations.status`.
    """
    backend = backend_of(problem, tests, gaps)
    at, name = (problem, start, direction), problem.parameter
    found = walk(*at, parameter=name, tests=tests, backend=backend, meeting=meeting, **options)
    if not gaps:
        return found
    settings, switched = options.get("settings") or Settings(), options.get("tangent") is not None
    return explained(problem, found, tests, settings, switched)


def backend_of(
    problem: OrbitProblem, tests: Sequence[TestFunction[Linearisation]], gaps: bool = True
) -> OrbitBackend | None:
    """Return a problem on block-cyclic elimination.

    None where there is none: for more than one degree of freedom, for two free parameters, for
    orbits without impacts, and where jumps move the gap coordinate.
    """
    if problem.free != 1 or not problem.word.walls:
        return None
    if problem.m != 2:
        plainly("orbits with several degrees of freedom")
        return None
    if problem.lost or not problem.kernels.passages.anchored:
        plainly("modes of different dimension, and jumps that move the gap coordinate")
        return None
    needs = {need for test in tests if isinstance(test, OrbitTest) for need in test.needs}
    return OrbitBackend(problem, gaps or "gaps" in needs, "doubling" in needs)
