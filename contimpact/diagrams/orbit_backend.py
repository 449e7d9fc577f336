"""Steps along branches of orbits of one degree of freedom, plainly or compiled."""

from __future__ import annotations

import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeAlias, TypeVar

import numpy as np

from ..arrays import ARRAYS, LISTS, Array, Containers, Vector
from ..bifurcations.extended_system import ManyOrbits
from ..continuation.branch import Block
from ..continuation.corrector import Evaluate, Solve
from ..continuation.sign_changes import look_plainly, look_through
from ..continuation.step import (
    EVALUATIONS,
    Batch,
    Observe,
    Position,
    StepVectors,
    TangentAt,
    batch_of,
    columns,
    take_steps,
)
from ..orbits.block_cyclic import BLOCK, GROWN, KEPT, POSITIONS, UNRESOLVED
from ..orbits.problem import OrbitProblem
from ..segments.compiling import (
    CompiledProgram,
    addresses,
    load,
    mode,
    note_uncompiled,
    timed_plainly,
)
from ..segments.flight import excursion_of, time_zeros, variant_of
from ..segments.kernel import Setup
from ..segments.oscillation import MOST, ROW
from .orbit_functions import (
    DESCRIBED,
    DETERMINANT,
    MEASURED,
    PRODUCT,
    SPAN,
    OrbitVectors,
    evaluate_cycle,
    newton_step,
    observe_cycle,
    tangent_of_cycle,
)

if TYPE_CHECKING:
    from ..orbits.cyclic_chain import ChainVectors
    from ..segments.machine_code import Program


V = TypeVar("V", "OrbitVectors", "ChainVectors")
"""A branch as vectors and tables."""

Functions: TypeAlias = tuple[Evaluate[V], Solve[V], TangentAt[V], Observe[V]]
"""Functions of a problem that `take_steps` calls: evaluate, solve, tangent_at and observe."""

KEPT_STEPS = 64
"""Arrays of more steps than this are not kept for further ones."""

TOO_STIFF = "flights of modes of different kinds, or too stiff"


LOOKING, LOOKS_AT = ("sign changes",), "FfiFF"
"""The program that looks for sign changes, the same for all models, and its arguments' kinds."""


def looking_program() -> Program:
    """Return `look_through` as a program."""
    from ..segments.machine_code import Program

    program = Program({})
    text = """
def entry(values, arclengths, rows, found, places):
    return look_through(values, arclengths, rows, found, places)
"""
    program.glue(text, look_through=look_through)
    return program


AT_A_TIME = 16
"""Steps at a time at most, where flights are dear."""


class OrbitBackend(ABC, Generic[V]):
    """An orbit problem as steps ask for it: block-cyclic elimination, many steps at a time.

    One parameter is free. `gaps` says whether to decide at every point if it is physical,
    `doubling` whether the determinant of a PD is wanted.
    """

    ARGUMENTS: ClassVar[str]
    """Kinds of the compiled entry's arguments: those of the vectors, then of `StepVectors`."""

    def __init__(self, problem: OrbitProblem, gaps: bool, doubling: bool) -> None:
        self.problem, self.gaps, self.doubling = problem, gaps, doubling
        self.setup = problem.kernels.setup(*problem.model.values.values())
        self.count, self.walls = len(problem.word), len(problem.model.WALLS)
        self.derived = len(problem.model.DERIVED)
        self.kept: dict[int, tuple[StepVectors, list[int]]] = {}

    @functools.cached_property
    @abstractmethod
    def described(self) -> int:
        """Numbers of a point before its gaps."""

    @functools.cached_property
    @abstractmethod
    def functions(self) -> Functions[V]:
        """What `take_steps` needs of the problem, plainly."""

    @functools.cached_property
    @abstractmethod
    def arrays(self) -> V:
        """The branch as arrays, for compiled code."""

    @functools.cached_property
    def addresses(self) -> list[int]:
        """Those of the arrays."""
        return addresses(self.arrays)

    @functools.cached_property
    @abstractmethod
    def variant(self) -> str | None:
        """How compiled code follows flights; None where it cannot."""

    @functools.cached_property
    @abstractmethod
    def obstacle(self) -> str:
        """Why there is no compiled code."""

    @abstractmethod
    def vectors(self, made_by: Containers) -> V:
        """The branch as vectors and tables."""

    @abstractmethod
    def told(self, rows: Array) -> tuple[Array, tuple[Array, Array, Array]]:
        """What describes points, and the periods, determinants and products that test functions go
        by, from what ``observe`` records."""

    def block(self, rows: Array) -> Block:
        """The points in the rows of `take_steps`."""
        unknowns, tangents, signs, places, tries, seen = columns(rows, self.problem.n + 1)
        described, cycle = self.told(seen)
        gaps = self.described + self.count * self.walls
        turns, points = gaps + self.count, (unknowns, tangents, signs)
        nearest = seen[:, self.described : gaps].reshape(-1, self.count, self.walls)
        measured = ManyOrbits(*points, *cycle, nearest, seen[:, gaps:turns], seen[:, turns:])
        return Block(*points, places, tries, described, self.problem.described, measured=measured)

    @abstractmethod
    def written(self) -> Program:
        """The program of the variant."""

    def common(self, made_by: Containers, *more: int) -> dict[str, Vector]:
        """The vectors and tables that all backends have, by name, with `more` in the counts."""
        vector, table = made_by
        problem, count, walls = self.problem, self.count, self.walls
        place = list(problem.model.values).index(problem.parameter)
        wanted: list[int] = [int(self.gaps), int(self.doubling), *more]
        return {
            "counts": vector([walls, problem.word.period, place, self.derived, *wanted]),
            "values": vector(list(problem.model.values.values())),
            "sides": vector([float(wall.side) for wall in problem.model.WALLS]),
            "fixed": table(1, POSITIONS + len(self.setup.walls) + len(self.setup.derived)),
            "clock": vector([0.0] * (GROWN + 1)),
            "units": vector([1.0] * problem.n),
            "durations": vector([0.0] * count),
            "gaps": vector([0.0] * count * walls),
            "times": vector([0.0] * count * walls),
            **{name: vector(numbers) for name, numbers in self.path().items()},
        }

    def path(self) -> dict[str, Sequence[float]]:
        """The word and what it passes, by numbers of its guards."""
        problem, walls, passages = self.problem, self.walls, self.problem.kernels.passages
        word = [problem.model.letters.index(letter) for letter in problem.word.walls]
        return {
            "kinds": [a * walls + b for a, b in zip(word, word[1:] + word[:1], strict=True)],
            "word": word,
            "arrivals": problem.arrivals,
            "watched": [int(meets) for row in passages.watched for meets in row],
            "leaving": passages.leaving,
            "velocities": [0.0] * len(word),
        }

    @property
    def dear(self) -> bool:
        """Whether flights take long, as those that are integrated do."""
        return False

    def advance(self, position: Position, most: int) -> Batch:
        """Take steps until one is proposed or refused, but `most` of them.

        Where flights are dear, fewer at a time: an interruption is noticed between batches, what is
        beyond an end is dropped, and sizes may outgrow those that a batch began with.
        """
        most = min(most, AT_A_TIME) if self.dear else most
        fast = self.compiled()
        if fast is None:
            return self.steps(position, most, None)
        self.arrays.clock[UNRESOLVED:] = 0.0
        made = self.steps(position, most, fast)
        self.problem.kernels.long |= self.arrays.clock[GROWN] > 0.0
        if self.arrays.clock[UNRESOLVED] == 0.0:
            return made
        import logging

        logging.getLogger(__name__).info("flights too stiff for compiled code: going on plainly")
        self.variant, self.obstacle = None, TOO_STIFF
        return self.steps(position, most, None)

    def look(self, values: Array, arclengths: Array) -> tuple[Array, Array, Array]:
        """Look for sign changes between points, by compiled code or plainly."""
        fast = self.compiled() and load(LOOKING, LOOKS_AT, looking_program)
        if not fast:
            with timed_plainly(LOOKING):
                return look_plainly(values, arclengths)
        points, count = values.shape
        rows = np.zeros(points, dtype=np.int64)
        found, places = np.zeros((2, points, count))
        made = fast(values, arclengths, rows, found, places)
        return rows[:made], found[:made], places[:made]

    def steps(self, position: Position, most: int, fast: CompiledProgram | None) -> Batch:
        """Take them by compiled code, or plainly."""
        units = self.problem.residual_sizes(position.scale)
        if fast:
            vectors, known = self.step_arrays(position, most)
            self.arrays.units[:] = units
            made = fast(known=known)
        else:
            vectors = position.vectors(self.recorded, most, LISTS)
            self.lists.units[:] = units.tolist()
            with timed_plainly(self.program):
                made = take_steps(*self.functions, self.lists, tuple(vectors))
        flights = int(vectors.state[EVALUATIONS]) * self.count
        self.problem.kernel_evaluations += flights
        return batch_of(position, self.problem, vectors, made, self.block)

    def step_arrays(self, position: Position, most: int) -> tuple[StepVectors, list[int]]:
        """The arrays of so many steps, filled in, and all addresses that compiled code takes."""
        found = self.kept.get(most)
        if found is not None:
            position.refill(found[0])
            return found
        vectors: StepVectors = position.vectors(self.recorded, most, ARRAYS)
        found = vectors, [*self.addresses, *addresses(vectors)]
        if most <= KEPT_STEPS:
            self.kept[most] = found
        return found

    @property
    def recorded(self) -> int:
        """How many numbers ``observe`` records of a point."""
        return self.described + self.count * (self.walls + 1) + self.derived

    @functools.cached_property
    def space(self) -> int:
        """Numbers of scratch space behind the parameter values of compiled code."""
        kernels, walls = self.problem.kernels, self.problem.model.WALLS
        if not kernels.has_paths and not any(kernels.linear(wall.name) for wall in walls):
            return 0
        from .orbit_program import space_for

        return space_for(kernels)

    @functools.cached_property
    def lists(self) -> V:
        """The branch as lists, for a plain run."""
        return self.vectors(LISTS)

    @property
    def program(self) -> tuple[str, ...]:
        """What tells its program from others."""
        return self.problem.kernels.identity, self.variant or ""

    def compiled(self) -> CompiledProgram | None:
        """Compiled code, if it is in the cache or worth compiling."""
        if mode() == "never":
            return None
        if self.variant is None:
            note_uncompiled(self.obstacle)
            return None
        return load(self.program, self.ARGUMENTS, self.written)


# The backend for orbits with one degree of freedom: many steps at a time, plain or compiled.


class CycleBackend(OrbitBackend[OrbitVectors]):
    """See `OrbitBackend`; for problems with one degree of freedom."""

    @property
    def dear(self) -> bool:
        return self.variant == "path"

    ARGUMENTS = "iiiii" + "ffff" + "FFFF" + "fF" + "fffff" + "ff" + "ffff" + "FF"

    @functools.cached_property
    def zeros(self) -> list[float] | None:
        """Of the acceleration, where they are the same along the branch."""
        harmonics = self.problem.kernels.harmonics(*self.problem.model.values.values())
        return time_zeros(harmonics, self.setup.period)

    @functools.cached_property
    def functions(self) -> Functions[OrbitVectors]:
        kernels, fixed = self.problem.kernels, self.zeros
        in_time = not math.isnan(kernels.harmonics(*self.problem.model.values.values())[0])
        excursion, moving = excursion_of(kernels, in_time), kernels.depends("harmonics")

        def breaks(values: Vector, period: float, zeros: Vector) -> list[float] | None:
            return time_zeros(kernels.harmonics(*values), period) if moving else fixed

        evaluate = plainly(evaluate_cycle, self.problem, kernels.flights)
        observe = observing(observe_cycle, breaks, excursion)
        return evaluate, newton_step, tangent_of_cycle, observe

    @functools.cached_property
    def described(self) -> int:
        return MEASURED

    def vectors(self, made_by: Containers) -> OrbitVectors:
        vector, table = made_by
        return OrbitVectors(
            **self.common(made_by),
            zeros=vector([0.0] * 2 if self.variant == "single" else self.zeros or []),
            blocks=table(self.count, BLOCK),
            kept=table(self.count, KEPT),
            reduced=table(1, KEPT),
            steps=table(0, ROW),
        )

    @functools.cached_property
    def obstacle(self) -> str:
        """Why there is no compiled code."""
        if self.zeros is None:
            return TOO_STIFF
        return "a forcing whose harmonics change along a branch"

    def told(self, rows: Array) -> tuple[Array, tuple[Array, Array, Array]]:
        cycle = rows[:, SPAN], rows[:, DETERMINANT], rows[:, PRODUCT, None]
        return rows[:, :DESCRIBED].copy(), cycle

    @functools.cached_property
    def arrays(self) -> OrbitVectors:
        given = self.vectors(ARRAYS)
        if self.space:
            given = given._replace(values=np.append(given.values, np.zeros(self.space)))
        if self.variant in ("law", "path"):
            given = given._replace(steps=np.zeros((MOST + 1, ROW)), zeros=np.zeros(2 * MOST))
        return given

    @functools.cached_property
    def variant(self) -> str | None:
        """See `segments.flight.variant_of`; "path" where flights are integrated."""
        kernels = self.problem.kernels
        found = variant_of(kernels, list(self.problem.model.values.values()))
        return found or ("path" if kernels.has_paths else None)

    def written(self) -> Program:
        from .orbit_program import program_of

        assert self.variant is not None
        return program_of(self.problem.kernels, self.variant)


def observing(record: Callable[..., None], *of: Callable[..., Any]) -> Observe[Any]:
    """Return what records points, plainly, by functions such as those that measure gaps."""

    def observe(orbit: Any, z: Vector, tangent: Vector, sign: float, row: Vector, at: int) -> None:
        record(*of, orbit, z, row, at)

    return observe


def plainly(
    evaluate: Callable[..., float], problem: OrbitProblem, *of: Callable[..., Any]
) -> Callable[[V, Vector], float]:
    """Return what evaluates points of a problem, by functions such as flights; it returns no number
    where they fail."""

    def setup(values: Vector) -> Setup:
        return problem.kernels.setup(*values)

    def evaluate_point(orbit: V, z: Vector) -> float:
        try:
            return evaluate(*of, setup, orbit, z)
        except (ArithmeticError, ValueError):
            return math.nan

    return evaluate_point
