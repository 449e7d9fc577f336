"""Programs and solvers of the events of `scalar_systems`: plain or compiled, of any word.

A system is solved from a guess, or an event located on an arc of a branch; see `locate_on_arc`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arrays import ARRAYS, LISTS, Array, Containers, Vector
from ..continuation.branch import Between, Point
from ..orbits.block_cyclic import KEPT, store, store_compiled
from ..orbits.problem import CyclicBlocks, Linearisation, OrbitProblem, Summary
from ..segments.compiling import CompiledProgram, addresses, load, mode, timed_plainly
from ..segments.flight import add_excursions, excursion_of, time_zeros, variant_of
from ..segments.kernel import Blocks, Family
from ..segments.kernels import Kernels
from ..segments.oscillation import MOST, ROW, row_of, row_of_compiled
from ..segments.touches import flights_are_apart
from .scalar_systems import (
    BLOCK,
    CYCLE,
    ERROR,
    EVALUATED,
    FAILED,
    FAR,
    FLIGHT,
    FRACTION,
    LARGEST,
    LONGEST,
    MU,
    MULTIPLIERS,
    ORIENTATION,
    SIZE,
    SOLVED,
    TOUCH,
    UNRESOLVED,
    VARIANT,
    ArcVectors,
    ScalarForm,
    Search,
    SystemVectors,
    bound_reached,
    bound_singular,
    bound_touching,
    check_touch,
    evaluate_reached,
    evaluate_singular,
    evaluate_touching,
    flights_last,
    guess_eigenvector,
    guess_orbit,
    guess_touch,
    locate_on_arc,
    solve_system,
    turn_of_flight,
)

if TYPE_CHECKING:
    from ..segments.machine_code import Program

# Programs: the kernels of a model by number, and the entry.

ENTRY = """
def any_flight(kind, t0, v0, t1, v1, p):
    r, a, b, free = one_flight(kind, t0, v0, t1, v1, p)
    return r, a, b, (free[0], 0.0, free[1], 0.0)

def any_second(kind, t0, v0, t1, v1, q0, q1, q2, q3, p):
    r, a, b, free = one_second(kind, t0, v0, t1, v1, q0, q1, q2, q3, p)
    return r, a, b, (free[0], 0.0, free[1], 0.0)

def any_setup(p):
    period, slopes, _, positions, _, _ = kernel_setup({p})
    return period, (slopes[0], 0.0), 0.0, positions, 0.0, 0.0

def any_period(p):
    return bounded_setup({pairs})

def evaluate(system, z):
    if system.counts[VARIANT] == SINGULAR:
        return evaluate_singular(any_flight, any_second, any_setup, system, z)
    if system.counts[VARIANT] == TOUCHING:
        return evaluate_touching(any_flight, any_setup, system, z)
    return evaluate_reached(any_flight, any_setup, system, z)

def bound(system, z, off):
    if system.counts[VARIANT] == SINGULAR:
        bound_singular(any_bounded, any_period, system, z, off)
    elif system.counts[VARIANT] == TOUCHING:
        bound_touching(any_bounded, any_period, system, z, off)
    else:
        bound_reached(any_bounded, any_period, system, z, off)

def guess(system, arc, z):
    if system.counts[VARIANT] == SINGULAR:
        return guess_eigenvector(any_flight, any_setup, system, z)
    if system.counts[VARIANT] == TOUCHING:
        return guess_touch(any_flight, any_setup, turn, system, arc, z)
    return guess_orbit(any_flight, any_setup, system, z)

def check(system, arc, z):
    if system.counts[VARIANT] == SINGULAR:
        return flights_last(system, z)
    return system.counts[VARIANT] != TOUCHING or check_touch(turn, system, arc, z)

def entry({fields}, {search}, {arc}):
    system, search, arc = SystemVectors({fields}), Search({search}), ArcVectors({arc})
    if options[0] == 0.0:
        return solve_system(evaluate, bound, system, search, options[1])
    return locate_on_arc(evaluate, bound, guess, check, system, search, arc)
"""

TURN = """
def turn(system, arc, z):
    return turn_of_flight(any_setup, breaks, excursion, system, arc, z)
"""

NO_TURN = """
def turn(system, arc, z):
    return nan, nan
"""
"""Where compiled code finds no turns."""

EVALUATE = {
    "singular": """
def evaluate(system, z):
    size = evaluate_singular(any_flight, any_second, any_setup, system, z)
    return size_on_curve(system, z, size)
""",
    "touching": """
def evaluate(system, z):
    size = evaluate_touching(any_flight, any_setup, system, z)
    return size_on_curve(system, z, size)
""",
}


def add_kernels(program: Program, kernels: Kernels, variant: str, free: str) -> str:
    """Add what evaluates a variant's systems; flights have names that begin with `free`.

    Returns the text of the parameter values.
    """
    p = ", ".join(f"p[{i}]" for i in range(len(kernels.model.values)))
    walls = kernels.model.letters
    pairs = [(a, b) for a in walls for b in walls]
    ends = "t0, v0, t1, v1"
    flights = {f"flight_{a}_{b}": kernels.flight(a, b) for a, b in pairs}
    program.choose(f"{free}_flight", f"kind, {ends}, p", "kind", flights, f"{ends}, {p}")
    if variant == "singular":
        seconds = {f"second_{a}_{b}": kernels.second(a, b) for a, b in pairs}
        along, held = f"{ends}, q0, q1, q2, q3", ", 0.0" * len(kernels.parameters)
        given = f"{along}{held}, {p}"
        program.choose(f"{free}_second", f"kind, {along}, p", "kind", seconds, given)
    program.constant("SystemVectors", SystemVectors)
    return p


def program_of(kernels: Kernels, turns: str | None) -> Program:
    """Return the program that solves systems and locates events, for any word of a model.

    `turns` says how flights are found to turn; see `segments.flight.variant_of`.
    """
    from ..segments.machine_code import Program

    program = Program({store: store_compiled, row_of: row_of_compiled})
    p = add_kernels(program, kernels, "singular", "one")
    walls = kernels.model.letters
    bounded = {f"bounded_{a}_{b}": kernels.bounded(a, b) for a in walls for b in walls}
    pairs = ", ".join(f"(p[{i}], 0.0)" for i in range(len(kernels.model.values)))
    ends = "t0, v0, t1, v1"
    program.choose("any_bounded", f"kind, {ends}, p", "kind", bounded, f"{ends}, {pairs}")
    for kind in (Search, ArcVectors):
        program.constant(kind.__name__, kind)
    for name, number in (("VARIANT", VARIANT), ("SINGULAR", 0), ("TOUCHING", 1)):
        program.constant(name, number)
    called: list[Callable[..., Any]] = [solve_system, locate_on_arc]
    called += [guess_eigenvector, flights_last, guess_orbit, guess_touch, check_touch]
    called += [function for pair in FUNCTIONS.values() for function in pair]
    if turns is not None:
        add_excursions(program, kernels, turns, p)
        called.append(turn_of_flight)
    text = ENTRY.format(
        p=p,
        pairs=pairs,
        fields=", ".join(SystemVectors._fields),
        search=", ".join(Search._fields),
        arc=", ".join(ArcVectors._fields),
    )
    program.glue(
        (NO_TURN if turns is None else TURN) + text,
        kernel_setup=kernels.setup,
        bounded_setup=kernels.bounded_period,
        **{function.__name__: function for function in called},
    )
    return program


FUNCTIONS: dict[str, tuple[Callable[..., float], Callable[..., None]]] = {
    "singular": (evaluate_singular, bound_singular),
    "touching": (evaluate_touching, bound_touching),
    "reached": (evaluate_reached, bound_reached),
}

ARGUMENTS = "ii" + "ffffff" + "FFF" + "fffffff" + "fFifff" + "FFFFF" + "fff"
"""Kinds of the entry's arguments: those of `SystemVectors`, `Search` and `ArcVectors`."""


def vectors_of(
    problem: OrbitProblem, form: ScalarForm, size: int, second: int, made_by: Containers
) -> SystemVectors:
    """Return a system of so many unknowns as vectors and tables; `second` is the place of mu among
    the parameter values."""
    vector, table = made_by
    walls, names = problem.model.letters, list(problem.model.values)
    variant = list(FUNCTIONS).index(form.variant)
    places = [walls.index(a) for a in problem.word.walls]
    kinds = [len(walls) * a + b for a, b in zip(places, [*places[1:], places[0]], strict=True)]
    first = names.index(problem.parameter)
    values = list(problem.model.values.values())
    return SystemVectors(
        kinds=vector(kinds),
        counts=vector([problem.word.period, first, second, form.flight, form.touch, variant]),
        numbers=vector([form.mu, 0.0]),
        values=vector(values if second < len(values) else [*values, 0.0]),
        sizes=vector([0.0] * problem.n),
        residual=vector([0.0] * (size - 1)),
        units=vector([0.0] * (size - 1)),
        right=vector([0.0] * size),
        blocks=table(len(kinds), BLOCK),
        jacobian=table(size - 1, size),
        factors=table(size, size),
    )


class Solved(NamedTuple):
    """A solution, or that it is not known whether there is one near enough (`known`)."""

    known: bool
    here: Linearisation
    own: Array
    residual: Array
    jacobian: Array
    error: float | None
    """A bound of the parameter's error, if there is one."""


class LocatedPoint(NamedTuple):
    """An event on an arc."""

    point: Point[Linearisation]
    own: Array
    """The system's own unknowns."""
    residual: float
    error: float


class Solver:
    """Solves the systems of a variant (see `ScalarForm`) on a problem with one free parameter."""

    def __init__(self, problem: OrbitProblem, variant: str) -> None:
        self.problem, self.variant = problem, variant
        self.own = {"singular": problem.n, "touching": 1, "reached": 0}[variant]
        kernels, values = problem.kernels, list(problem.model.values.values())
        self.turns = variant_of(kernels, values)
        apart = self.turns is not None and flights_are_apart(kernels, problem.word.walls)
        self.locates = not problem.lost and (variant != "touching" or apart)

    @functools.cached_property
    def functions(self) -> tuple[Callable[..., Any], ...]:
        """``evaluate``, ``bound``, ``guess`` and ``check``, plainly."""
        kernels = self.problem.kernels
        evaluate, bound = FUNCTIONS[self.variant]

        def flight(kind: int, t0: float, v0: float, t1: float, v1: float, p: Vector) -> Blocks:
            r, a, b, free = kernels.flights(kind, t0, v0, t1, v1, p[:-1])
            return r, a, b, (free[0], 0.0, free[1], 0.0)

        def second(kind: int, *given: Any) -> Blocks:
            r, a, b, free = kernels.seconds(kind, *given[:-1], given[-1][:-1])
            return r, a, b, (free[0], 0.0, free[1], 0.0)

        def setup(p: Vector) -> Any:
            period, slopes, *others = kernels.setup(*p[:-1])
            return period, (slopes[0], 0.0), *others

        def bounded(kind: int, t0: Any, v0: Any, t1: Any, v1: Any, p: Vector) -> Any:
            walls = kernels.model.letters
            a, b = divmod(kind, len(walls))
            return kernels.bounded(walls[a], walls[b])(t0, v0, t1, v1, *[(x, 0.0) for x in p[:-1]])

        def period(p: Vector) -> Any:
            return kernels.bounded_period(*[(x, 0.0) for x in p[:-1]])

        flights = (flight, second) if self.variant == "singular" else (flight,)

        def evaluated(system: SystemVectors, z: Vector) -> float:
            try:
                return evaluate(*flights, setup, system, z)
            except (ArithmeticError, ValueError):
                return math.nan

        def bounds(system: SystemVectors, z: Vector, off: Vector) -> None:
            try:
                bound(bounded, period, system, z, off)
            except (ArithmeticError, ValueError):
                off[:] = [math.nan] * len(off)

        if self.variant != "touching":
            singular = self.variant == "singular"
            own = functools.partial(guess_eigenvector if singular else guess_orbit, flight, setup)
            given = evaluated, bounds, lambda system, arc, z: own(system, z)
            return *given, lambda system, arc, z: not singular or flights_last(system, z)
        moving, along = self.turns == "single", excursion_of(kernels, self.turns != "law")

        def breaks(values: Vector, period: float, zeros: Vector) -> Vector:
            return time_zeros(kernels.harmonics(*values[:-1]), period) if moving else zeros

        def excursion(head: Vector, values: Vector, *given: Any) -> Any:
            return along(head, values[:-1], *given)

        def turn(system: SystemVectors, arc: ArcVectors, z: Vector) -> tuple[float, float]:
            return turn_of_flight(setup, breaks, excursion, system, arc, z)

        def guess(system: SystemVectors, arc: ArcVectors, z: Vector) -> bool:
            return guess_touch(flight, setup, turn, system, arc, z)

        return evaluated, bounds, guess, functools.partial(check_touch, turn)

    @functools.cached_property
    def lists(self) -> tuple[SystemVectors, Search, ArcVectors]:
        """What a plain run works on."""
        return self.vectors(LISTS)

    @functools.cached_property
    def arrays(self) -> tuple[SystemVectors, Search, ArcVectors]:
        """What compiled code works on."""
        system, search, arc = self.vectors(ARRAYS)
        if self.turns == "law" and self.variant == "touching":
            arc = arc._replace(steps=np.zeros((MOST, ROW)), zeros=np.zeros(2 * MOST))
        return system, search, arc

    @functools.cached_property
    def addresses(self) -> list[int]:
        """Those of the arrays."""
        return addresses([vector for vectors in self.arrays for vector in vectors])

    def vectors(self, made_by: Containers) -> tuple[SystemVectors, Search, ArcVectors]:
        """A system, what its solution takes, and an arc; all but the guess is filled in."""
        vector, table = made_by
        problem, size = self.problem, self.problem.n + 2 + self.own
        form = ScalarForm(self.variant)
        second = len(problem.model.values)
        search = Search(*[vector([0.0] * size) for _ in Search._fields])
        search.row[size - 1] = 1.0
        values, kernels = list(problem.model.values.values()), problem.kernels
        harmonics, count = kernels.harmonics(*values), len(problem.word)
        breaks = time_zeros(harmonics, kernels.setup(*values).period) or []
        walls, orbit = problem.model.WALLS, problem.n + 1
        arc = ArcVectors(
            options=vector([0.0] * 6 + [problem.mean_order(values)]),
            ends=table(5, orbit),
            arrivals=vector(problem.arrivals),
            leaving=vector(kernels.passages.leaving),
            sides=vector([float(wall.side) for wall in walls]),
            zeros=vector([0.0] * 2 if self.turns == "single" else breaks),
            fixed=table(1, len(walls)),
            cycle=table(count, CYCLE),
            kept=table(count, KEPT),
            reduced=table(1, KEPT),
            steps=table(0, ROW),
            border=vector([0.0] * orbit),
            tangent=vector([0.0] * orbit),
            found=vector([0.0] * (UNRESOLVED + 1)),
        )
        return vectors_of(problem, form, size, second, made_by), search, arc

    @property
    def program(self) -> tuple[str, ...]:
        """What tells its program from others."""
        return self.problem.kernels.identity, self.turns or "", "events"

    def solve(
        self, form: ScalarForm, here: Linearisation, start: Array, far: float
    ) -> Solved | None:
        """Return the solution next to an orbit, where the system's own unknowns are like `start`;
        None where there is none."""
        problem = self.problem
        fast = self.compiled()
        system, search, arc = self.arrays if fast else self.lists
        guess = [*here.unknowns.tolist(), *start.tolist(), 0.0]
        search.z[:], search.begin[:] = guess, guess
        system.sizes[:] = problem.least_scale(here.unknowns).tolist()
        arc.options[:2] = 0.0, far
        status = self.run(form, fast)
        return None if status == FAILED else self.solved(status == SOLVED, system, search)

    def locate(self, form: ScalarForm, arc: Between, fraction: float) -> LocatedPoint | None:
        """Return the event next to a place on an arc; None where it is not found in one go."""
        if not self.locates:
            return None
        fast = self.compiled()
        found = self._located(form, arc, fraction, fast)
        if found is None and fast and self.arrays[2].found[UNRESOLVED]:
            return self._located(form, arc, fraction, None)
        return found

    def _located(
        self, form: ScalarForm, arc: Between, fraction: float, fast: CompiledProgram | None
    ) -> LocatedPoint | None:
        _, search, given = self.arrays if fast else self.lists
        left, right = arc.left, arc.right
        rows = left.unknowns, left.tangent, right.unknowns, right.tangent, arc.scale
        given.ends[:] = rows if fast else [row.tolist() for row in rows]
        usual = max(abs(left.orientation), abs(right.orientation))
        given.options[:6] = 1.0, FAR, fraction, arc.span, usual, 2.0 * arc.settings.max_angle
        given.found[UNRESOLVED] = 0.0
        self.problem.kernel_evaluations += len(self.problem.word)  # for the guess
        if self.run(form, fast) != SOLVED:
            return None
        best, tangent, found = np.array(search.best), np.array(given.tangent), list(given.found)
        n = self.problem.n
        multipliers = np.array(found[MULTIPLIERS:UNRESOLVED]).view(complex)
        told = Summary(found[LARGEST], multipliers, np.full(6, np.nan))
        here = Linearisation(self.problem, best[: n + 1], summary=told)
        place = left.arclength + found[FRACTION] * arc.span
        point = Point(here, tangent, float(found[ORIENTATION]), float(place), 0)
        told_of = float(search.told[SIZE]), float(search.told[ERROR])
        return LocatedPoint(point, best[n + 1 : -1], *told_of)

    def run(self, form: ScalarForm, fast: CompiledProgram | None) -> int:
        """Solve or locate by compiled code, or plainly; returns as `solve_system`."""
        system, search, arc = self.arrays if fast else self.lists
        system.numbers[MU] = form.mu
        system.counts[FLIGHT], system.counts[TOUCH] = form.flight, form.touch
        search.told[EVALUATED] = 0.0
        if fast:
            status = fast(known=self.addresses)
        else:
            with timed_plainly(self.program):
                status = self._run_plainly(system, search, arc)
        self.problem.kernel_evaluations += int(search.told[EVALUATED]) * self.flights
        return status

    def _run_plainly(self, system: SystemVectors, search: Search, arc: ArcVectors) -> int:
        evaluate, bound, guess, check = self.functions
        try:
            if not arc.options[0]:
                return solve_system(evaluate, bound, system, search, arc.options[1])
            return locate_on_arc(evaluate, bound, guess, check, system, search, arc)
        except (ArithmeticError, ValueError):
            return FAILED

    @property
    def flights(self) -> int:
        """Flights evaluated at a point, those of second derivatives among them."""
        count = len(self.problem.word)
        return {"singular": 2 * count, "touching": count + 1, "reached": count}[self.variant]

    def solved(self, known: bool, vectors: SystemVectors, search: Search) -> Solved:
        """What is in the vectors."""
        problem, n = self.problem, self.problem.n
        best, error = np.array(search.best), float(search.told[ERROR])
        here = Linearisation(problem, best[: n + 1], flights_of(np.array(vectors.blocks)))
        residual, jacobian = np.array(vectors.residual), np.array(vectors.jacobian)[:, :-1]
        own, error_known = best[n + 1 : -1], error if math.isfinite(error) else None
        return Solved(known, here, own, residual, jacobian, error_known)

    def compiled(self) -> CompiledProgram | None:
        """Compiled code, where there is any and it pays."""
        if mode() == "never":
            return None
        kernels = self.problem.kernels
        return load(self.program, ARGUMENTS, lambda: program_of(kernels, self.turns))


def flights_of(rows: Array, free: int = 1) -> CyclicBlocks:
    """Return the blocks of an orbit from rows of `BLOCK` numbers, with so many free parameters."""
    start, end = (rows[:, i : i + 4].reshape(-1, 2, 2) for i in (2, 6))
    by_parameter = rows[:, 10:].reshape(-1, 2)[:, :free]
    return CyclicBlocks(rows[:, :2].ravel(), start, end, by_parameter)


def is_scalar(problem: OrbitProblem) -> bool:
    """Whether systems on the orbits of a problem are scalar code: not for more than one degree of
    freedom, free periods, long words, and flights that are no straight-line code."""
    if not problem.paired or not 1 <= len(problem.word) <= LONGEST:
        return False
    families = {problem.kernels.flight(*kind).family for kind in problem.kinds}
    return not families & {Family.LINEAR, Family.HARMONICS}


def solver_of(problem: OrbitProblem, form: ScalarForm | None) -> Solver | None:
    """Return what solves a system in one free parameter; None where that is no scalar code."""
    if form is None or problem.free != 1 or not is_scalar(problem):
        return None
    if form.variant not in problem.solvers:
        flown = any(problem.kernels.flown(*kind) for kind in problem.kinds)
        problem.solvers[form.variant] = None if flown else Solver(problem, form.variant)
    solver: Solver | None = problem.solvers[form.variant]
    return solver
