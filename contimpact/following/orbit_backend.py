"""Routine steps along a branch of orbits with one degree of freedom: many points at a time.

Everything a step needs of the orbit problem and of the test functions, as functions in the plain
subset of Python on flat vectors: `contimpact.continuation.step` runs them, plainly or compiled.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..bifurcations.branch_point import BranchPoint
from ..bifurcations.doubling import PeriodDoubling
from ..bifurcations.fold import Fold
from ..bifurcations.grazing import Grazing
from ..bifurcations.requested import Requested
from ..bifurcations.status import explained
from ..bifurcations.torus import NeimarkSacker
from ..bifurcations.unfolding import meeting
from ..bifurcations.zero_duration import ZeroDuration
from ..bifurcations.zero_velocity import ZeroVelocity
from ..compiling.compiled import Compiled, compiled, mode, spend
from ..continuation.batch import Batch, Notice, Position, Proposal, refusal
from ..continuation.branch import Block, Walk
from ..continuation.settings import Settings
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
from ..continuation.test_function import TestFunction
from ..continuation.walk import walk
from ..orbits.block_cyclic import (
    BLOCK,
    KEPT,
)
from ..orbits.problem import Array, OrbitProblem
from ..segments.flight import excursion_of
from ..segments.zeros import time_zeros
from .routine import (
    BP,
    DESCRIBED,
    FB,
    LISTS,
    NS,
    PARAMETER,
    PD,
    Course,
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
    """An orbit problem with its test functions, for routine steps of a walk.

    Parameters
    ----------
    problem : OrbitProblem
        With one degree of freedom and one free parameter.
    tests : sequence of (place, target)
        The test functions, by their places in `Course.facts`.
    gaps : bool
        Whether to decide at every point if it is physical.
    """

    def __init__(
        self, problem: OrbitProblem, tests: Sequence[tuple[int, float]], gaps: bool
    ) -> None:
        self.problem, self.gaps, self.tests = problem, gaps, list(tests)
        kernels, values = problem.kernels, problem.model.values.values()
        self.fixed = kernels.setup(*values)
        self.zeros = time_zeros(kernels.harmonics(*values), self.fixed[0])
        self.functions = plain_functions(problem, self.zeros)

    def course(self, vector: Callable[..., Any], table: Callable[[int, int], Any]) -> Course:
        """The branch as vectors and tables: lists, or arrays for compiled code."""
        problem = self.problem
        named = [wall.name for wall in problem.model.WALLS]
        word = [named.index(letter) for letter in problem.word.walls]
        count, walls = len(word), len(named)
        place = list(problem.model.values).index(problem.parameter)
        values = list(problem.model.values.values())
        places, targets = [place for place, _ in self.tests], [target for _, target in self.tests]
        facts = LISTS + count * (walls + 3)
        return Course(
            kinds=vector([a * walls + b for a, b in zip(word, word[1:] + word[:1], strict=True)]),
            word=vector(word),
            counts=vector([
                walls, problem.word.period, place, int(self.gaps), int(PD in places),
                int(max(places, default=0) >= facts),
            ]),
            values=vector(values),
            sides=vector([float(wall.side) for wall in problem.model.WALLS]),
            places=vector(places), targets=vector(targets, float),
            zeros=vector([0.0] * 2 if self.variant == "single" else self.zeros or [], float),
            blocks=table(count, BLOCK), kept=table(count, KEPT), reduced=table(1, KEPT),
            fixed=table(1, len(self.fixed)),
            clock=vector([0.0] * 2), facts=vector([0.0] * (facts + len(self.fixed))),
            durations=vector([0.0] * count),
            gaps=vector([0.0] * count * walls), times=vector([0.0] * count * walls),
            velocities=vector([0.0] * count),
        )  # fmt: skip

    def advance(self, position: Position, most: int) -> Batch:
        """Take steps until one is proposed or refused, `most` at most."""
        n, q = len(position.scale), len(self.tests)
        width = 2 * n + HEAD + q + DESCRIBED
        fast = self.compiled(most)
        vector = _array if fast else _list
        state, rows = vector(position.state()), vector(np.zeros(width * most))
        work = np.zeros((4, n)) if fast else _list_table(4, n)
        here = position.here
        points = (position.scale, here.unknowns, here.tangent, position.chord())
        given: list[Any] = [
            *(self.arrays if fast else [self.lists]), vector(position.options(), float), state,
            *(vector(p) for p in points), work, rows,
            *([vector([width, most])] if fast else [width, most]),
        ]  # fmt: skip
        made = fast(*given) if fast else take_steps(*self.functions, *given)
        flights = int(state[EVALUATIONS]) * len(self.problem.word)
        self.problem.kernel_evaluations += flights
        spend(0 if fast else flights)
        table = np.asarray(rows).reshape(most, width)
        notices = Notice(int(state[NOTICE]))
        proposal = None
        if notices:
            piece, values = self.read(table[made : made + 1], n)
            proposal = Proposal(piece, notices, float(state[NEXT_STEP]), values)
        piece, values = self.read(table[:made], n)
        return Batch(
            piece if made else None, float(state[STEP]), int(state[ITERATIONS]),
            int(state[REJECTED]), proposal, refusal(position, state, self.problem, work[1]), values,
        )  # fmt: skip

    def read(self, rows: Array, n: int) -> tuple[Block, Array]:
        """The points in the rows of `take_steps`, and their test functions."""
        mark, q = 2 * n, len(self.tests)
        block = Block(
            rows[:, :n], rows[:, n:mark], rows[:, mark], rows[:, mark + 1], rows[:, mark + 2],
            rows[:, mark + HEAD + q :], self.problem.described,
        )  # fmt: skip
        return block.kept(), rows[:, mark + HEAD : mark + HEAD + q]

    @functools.cached_property
    def lists(self) -> Course:
        """The branch as lists, for a plain run."""
        return self.course(_list, _list_table)

    @functools.cached_property
    def arrays(self) -> Course:
        """The branch as arrays, for compiled code."""
        return self.course(_array, lambda rows, columns: np.zeros((rows, columns)))

    def compiled(self, most: int) -> Compiled | None:
        """Compiled code, where there is any and the work is worth it."""
        said = mode()
        if self.variant is None or said == "never" or (said == "auto" and most < WORTH):
            return None
        kernels, variant = self.problem.kernels, self.variant

        def build() -> Program:
            from .orbit_program import program_of

            return program_of(kernels, variant)

        return compiled((kernels.identity, variant), ARGUMENTS, build)

    @functools.cached_property
    def variant(self) -> str | None:
        """How compiled code finds the zeros of the acceleration; None where it cannot."""
        kernels, values = self.problem.kernels, self.problem.model.values.values()
        harmonics = kernels.harmonics(*values)
        if math.isnan(harmonics[0]):
            return None
        if not kernels.depends("harmonics"):
            return "fixed"
        return "single" if len(harmonics) == 4 and harmonics[1] == 1 else None


def _list(numbers: Any, kind: type = float) -> Any:
    return numbers.tolist() if isinstance(numbers, np.ndarray) else list(numbers)


def _list_table(rows: int, columns: int) -> list[Any]:
    return [[0.0] * columns for _ in range(rows)]


def _array(numbers: Any, kind: type | None = None) -> Any:
    if kind is None and not isinstance(numbers, np.ndarray):
        kind = float if len(numbers) and isinstance(numbers[0], float) else np.int64
    return np.array(numbers, dtype=kind)


ARGUMENTS = "iiiff" "iff" "FFFF" "ffffff" "ff" "ffff" "Ffi"  # fmt: skip
"""Kinds of the entry's arguments, in its order: a course's fields, then those of `take_steps`."""


def plain_functions(problem: OrbitProblem, fixed: list[float] | None) -> tuple[Any, Any, Any, Any]:
    """Return what `take_steps` needs of a problem: evaluate, solve, tangent_at and observe.

    `fixed` are the zeros of the acceleration, where they are the same along the branch.
    """
    kernels = problem.kernels
    in_time = not math.isnan(kernels.harmonics(*problem.model.values.values())[0])
    flight, excursion = kernels.flights, excursion_of(kernels, in_time)
    moving = kernels.depends("harmonics")

    def setup(values):
        return kernels.setup(*values)

    def evaluate(course, z):
        try:
            return evaluate_cycle(flight, setup, course, z)
        except (ArithmeticError, ValueError):
            return math.nan

    def breaks(values, period, zeros):
        return time_zeros(kernels.harmonics(*values), period) if moving else fixed

    def observe(course, z, tangent, orientation, rows, at):
        return observe_cycle(breaks, excursion, course, z, tangent, orientation, rows, at)

    return evaluate, newton_step, tangent_of_cycle, observe


def places_of(problem: OrbitProblem, test: TestFunction) -> list[tuple[int, float]] | None:
    """Return the places of a test function's values, and what each is to reach.

    None for one that has none.
    """
    count, walls = len(problem.word), len(problem.model.WALLS)
    one = {Fold: FB, BranchPoint: BP, PeriodDoubling: PD, NeimarkSacker: NS}.get(type(test))
    if one is not None:
        return [(one, 0.0)]
    velocities = LISTS + walls * count
    slowest = velocities + 2 * count
    if isinstance(test, Grazing):
        gaps = range(LISTS, LISTS + walls * count)
        return [(place, 0.0) for place in (*gaps, *range(slowest, slowest + count))]
    first = {ZeroVelocity: velocities, ZeroDuration: velocities + count}.get(type(test))
    if first is not None:
        return [(first + i, 0.0) for i in range(count)]
    if isinstance(test, Requested):
        names, derived = list(problem.model.DERIVED), slowest + count + 3 + walls
        return [
            (PARAMETER if name == problem.parameter else derived + names.index(name), value)
            for name, value in test.requested
        ]
    return None


def walk_orbits(
    problem: OrbitProblem, start: Array, direction: int, *, tests: Sequence[TestFunction] = (),
    gaps: bool = True, **options: Any,
) -> Walk:  # fmt: skip
    """As `contimpact.continuation.walk.walk`, for orbits: routine steps are made many at once.

    With `gaps` it is decided at every point if the orbit is physical, and changes of that or of the
    number of unstable multipliers are explained by events; see `contimpact.bifurcations.status`.
    """
    found = walk(
        problem, start, direction, parameter=problem.parameter, tests=tests,
        backend=backend_of(problem, tests, gaps), meeting=meeting, **options,
    )  # fmt: skip
    if not gaps:
        return found
    settings, switched = options.get("settings") or Settings(), options.get("tangent") is not None
    return explained(problem, found, tests, settings, switched)


def backend_of(
    problem: OrbitProblem, tests: Sequence[TestFunction], gaps: bool = True
) -> OrbitBackend | None:
    """Return a problem with its test functions for routine steps.

    None where there is none: for more than one degree of freedom, for two free parameters, and
    for a user's own test functions.
    """
    places = [places_of(problem, test) for test in tests]
    if problem.m != 2 or problem.free != 1 or any(place is None for place in places):
        return None
    wanted = gaps or any(isinstance(test, Grazing) for test in tests)
    return OrbitBackend(problem, [place for found in places for place in found or ()], wanted)
