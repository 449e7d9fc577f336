"""Routine steps along a branch of orbits with one degree of freedom: many points at a time.

Everything a step needs of the orbit problem and of the test functions, as functions in the plain
subset of Python on flat vectors: `contimpact.continuation.march` runs them, plainly or compiled.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .bifurcations import (
    BranchPoint,
    Fold,
    Grazing,
    NeimarkSacker,
    PeriodDoubling,
    Requested,
    ZeroDuration,
    ZeroVelocity,
)
from .compiled import Compiled, compiled, mode, spend
from .continuation.arclength import Settings
from .continuation.branch import Walk
from .continuation.events import TestFunction
from .continuation.march import EVALUATIONS, EXTRA, Footing, Made, march
from .continuation.walk import walk
from .mechanics.cycle import (
    BLOCK,
    KEPT,
    assemble,
    eliminate,
    multipliers,
    product_of_multipliers,
    row_norms,
    scaled,
    solve,
    store,
)
from .mechanics.flight import excursion_of
from .mechanics.orbit import Array, OrbitProblem
from .mechanics.physicality import verdict
from .mechanics.zeros import time_zeros
from .status import explained
from .unfolding import meeting

if TYPE_CHECKING:
    from .program import Program

FB, BP, PD, NS, PARAMETER, LISTS = range(6)
"""Places in `facts`: values of single test functions; then come lists, of the gaps, of the
velocities, of the durations, of the slowest turns and of what the kernel ``setup`` returns."""

WALLS, PERIODS, FREE, GAPS, DOUBLING, SETUP = range(6)
"""Places in `counts`: how many walls and periods, the place of the free parameter among the
values, and whether gaps, the determinant of a PD and derived parameters are wanted."""

DESCRIBED = 11
"""Numbers that describe a point: the residual, two multipliers, and what `verdict` says."""

WORTH = 64
"""Points asked for at once from which compiled code is looked for."""

SAME_TIME = 1e-12
"""Durations below this have no value; see `contimpact.bifurcations.ZeroDuration`."""


class Course(NamedTuple):
    """What a branch is made of, as vectors and tables.

    Attributes
    ----------
    kinds, word : vector of int
        Kinds of the flights, and the walls they leave.
    counts : vector of int
        See `WALLS`.
    values, sides : vector
        Parameter values; sides of the walls.
    places, targets : vector
        The test functions: where in `facts` each is, and the value it is to reach.
    zeros : vector
        Zeros of the acceleration, where they are the same along the branch.
    blocks, kept, reduced, fixed : table
        Room for the flights, for their elimination, for what is left, and for what the kernel
        ``setup`` returns.
    clock, facts, durations, gaps, times, velocities : vector
        Room for the period, for the test functions, and for what decides whether an orbit is
        physical.
    """

    kinds: Any
    word: Any
    counts: Any
    values: Any
    sides: Any
    places: Any
    targets: Any
    zeros: Any
    blocks: Any
    kept: Any
    reduced: Any
    fixed: Any
    clock: Any
    facts: Any
    durations: Any
    gaps: Any
    times: Any
    velocities: Any


def evaluate_cycle(flight, setup, course, z):
    """Evaluate the flights of an orbit; returns the largest residual."""
    counts = course.counts
    return assemble(
        flight, setup, course.kinds, counts[PERIODS], counts[FREE], course.values, course.blocks,
        course.clock, course.fixed, z,
    )  # fmt: skip


def newton_step(course, row, g, out):
    """Fill `out` with Newton's step at the point last evaluated; whether there is one."""
    reduced = eliminate(
        course.blocks, course.kinds, course.counts[WALLS], course.kept, 1.0, False, out, 0.0
    )
    return abs(solve(reduced, course.kept, len(course.kinds), row, g, out)) > 0.0


def tangent_of_cycle(course, z, row, scale, out):
    """Fill `out` with the unit tangent at the point last evaluated that goes on along `row`.

    Returns the determinant of the Jacobian bordered by the tangent, rows and columns scaled; not a
    number where no tangent is defined.
    """
    count = len(course.kinds)
    reduced = eliminate(
        course.blocks, course.kinds, course.counts[WALLS], course.kept, 0.0, True, z,
        course.clock[0],
    )  # fmt: skip
    store(course.reduced, 0, reduced)
    det = solve(reduced, course.kept, count, row, 1.0, out)
    size = 0.0
    for i in range(2 * count + 1):
        part = out[i] / scale[i]
        size += part * part
    size = math.sqrt(size)
    if not (abs(det) > 0.0 and size > 0.0 and size - size == 0.0):
        return math.nan
    for i in range(2 * count + 1):
        out[i] /= size
    time, velocity, free = scale[0], scale[1], scale[2 * count]
    sizes = count * math.log(time * velocity) + math.log(free)
    norms = row_norms(course.blocks, count, 1.0, time, velocity, free)
    # the border is row / scale^2; with the tangent itself in its place it is longer by `size`
    return scaled(reduced[12], reduced[13] + sizes, det * size, norms)


def measure(breaks, excursion, course, z):
    """Fill in durations, velocities, gaps and when they are smallest, also among the facts.

    Returns the smallest gap of all (infinite where there is none), and whether the orbit is surely
    physical.
    """
    fixed = course.fixed[0]
    count, walls, wanted = len(course.kinds), course.counts[WALLS], course.counts[GAPS] != 0
    word, sides, values, facts = course.word, course.sides, course.values, course.facts
    gaps, times, span = course.gaps, course.times, course.clock[0]
    period = fixed[0]
    zeros = breaks(values, period, course.zeros)
    velocities = LISTS + walls * count
    durations = velocities + count
    slowest = durations + count
    smallest, sure = math.inf, True
    for k in range(count):
        i = 2 * k
        start, speed, wall = z[i], z[i + 1], word[k]
        if k + 1 < count:
            length, arriving, following = z[i + 2] - start, z[i + 3], word[k + 1]
        else:
            length, arriving, following = z[0] + span - start, z[1], word[0]
        course.durations[k], course.velocities[k] = length, speed
        towards = sides[wall] * speed
        facts[velocities + k] = towards
        if length < 0.0 or towards < 0.0:
            sure = False
        facts[durations + k] = length if abs(length) >= SAME_TIME else math.nan
        high, when_high, low, when_low, slow = math.nan, math.nan, math.nan, math.nan, math.nan
        at = walls * k
        if wanted and length > 0.0:
            high, when_high, low, when_low, slow = excursion(
                (wall, start, speed), values, length, arriving, sides[wall], sides[following],
                zeros, start % period, period,
            )  # fmt: skip
        facts[slowest + k] = slow
        for j in range(walls):
            gap, dt = fixed[3 + j] - fixed[3 + wall], when_high
            if sides[j] > 0.0:
                gap -= high
            else:
                gap, dt = low - gap, when_low
            gaps[at + j], times[at + j], facts[LISTS + at + j] = gap, start + dt, gap
            if gap < smallest:
                smallest = gap
    if course.counts[SETUP] != 0:
        for j in range(len(fixed)):
            facts[slowest + count + j] = fixed[j]
    return smallest, sure and smallest >= 0.0


def observe_cycle(breaks, excursion, course, z, tangent, orientation, rows, at):
    """Put the test functions, the residual, the multipliers and the verdict into a row."""
    smallest, sure = measure(breaks, excursion, course, z)
    facts, walls, last = course.facts, course.counts[WALLS], len(z) - 1
    product = product_of_multipliers(course.blocks, course.kinds, walls, z, course.clock[0])
    facts[FB], facts[BP], facts[PARAMETER] = tangent[last], orientation, z[last]
    facts[PD] = doubling(course) if course.counts[DOUBLING] != 0 else math.nan
    facts[NS] = 1.0
    if product - product == 0.0:
        facts[NS] = (product - 1.0) / (abs(product) + 1.0)
    for i in range(len(course.places)):
        rows[at + i] = facts[course.places[i]] - course.targets[i]
    worst = 0.0
    for k in range(len(course.kinds)):
        block = course.blocks[k]
        worst = max(worst, abs(block[0]), abs(block[1]))
    at += len(course.places)
    rows[at] = worst
    at += 1
    rows[at], rows[at + 1], rows[at + 2], rows[at + 3] = multipliers(course.reduced[0], product)
    what, place, wall, amount, when = 0, 0, 0, 0.0, 0.0
    if sure:
        smallest = smallest if smallest < math.inf else math.nan
    else:
        what, place, wall, amount, when, smallest = verdict(
            course.word, course.sides, course.durations, course.gaps, course.times,
            course.velocities, -1,
        )  # fmt: skip
    known = course.counts[GAPS] != 0
    rows[at + 4], rows[at + 5], rows[at + 6] = what if known else math.nan, place, wall
    rows[at + 7], rows[at + 8], rows[at + 9] = amount, when, smallest


def doubling(course):
    """Return the scaled determinant of the cyclic matrix with its last coupling negative."""
    p00, p01, p10, p11, q00, q01, q10, q11, _, _, _, _, sign, logarithm, _ = course.reduced[0]
    det = (p00 - q00) * (p11 - q11) - (p01 - q01) * (p10 - q10)
    norms = row_norms(course.blocks, len(course.kinds), -1.0, 1.0, 1.0, 0.0)
    return scaled(sign, logarithm, det, norms)


class OrbitSystem:
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

    def march(self, footing: Footing, settings: Settings, most: int) -> Made:
        """Make routine steps, `most` of them unless one is not routine."""
        n, q = len(footing.scale), len(self.tests)
        width = 2 * n + EXTRA + q + DESCRIBED
        fast = self.compiled(most)
        vector = _array if fast else _list
        state, rows = vector(footing.state()), vector(np.zeros(width * most))
        here = footing.here
        points = (footing.scale, here.unknowns, here.tangent, footing.chord())
        given: list[Any] = [
            *(self.arrays if fast else [self.lists]), vector(footing.options(settings)), state,
            *(vector(p) for p in points), np.zeros((4, n)) if fast else _list_table(4, n), rows,
            *([vector([width, most])] if fast else [width, most]),
        ]  # fmt: skip
        made = fast(*given) if fast else march(*self.functions, *given)
        flights = int(state[EVALUATIONS]) * len(self.problem.word)
        self.problem.kernel_evaluations += flights
        spend(0 if fast else flights)
        block = np.asarray(rows[: width * made]).reshape(made, width)
        return Made.of(footing, state, block, most, self.problem.described)

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
"""Kinds of the entry's arguments, in its order: a course's fields, then those of `march`."""


def plain_functions(problem: OrbitProblem, fixed: list[float] | None) -> tuple[Any, Any, Any, Any]:
    """Return what `march` needs of a problem: evaluate, solve, tangent_at and observe.

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
    number of unstable multipliers are explained by events; see `contimpact.status`.
    """
    found = walk(
        problem, start, direction, parameter=problem.parameter, tests=tests,
        system=system_of(problem, tests, gaps), meeting=meeting, **options,
    )  # fmt: skip
    if not gaps:
        return found
    settings, switched = options.get("settings") or Settings(), options.get("tangent") is not None
    return explained(problem, found, tests, settings, switched)


def system_of(
    problem: OrbitProblem, tests: Sequence[TestFunction], gaps: bool = True
) -> OrbitSystem | None:
    """Return a problem with its test functions for routine steps.

    None where there is none: for more than one degree of freedom, for two free parameters, and
    for a user's own test functions.
    """
    places = [places_of(problem, test) for test in tests]
    if problem.m != 2 or problem.free != 1 or any(place is None for place in places):
        return None
    wanted = gaps or any(isinstance(test, Grazing) for test in tests)
    return OrbitSystem(problem, [place for found in places for place in found or ()], wanted)
