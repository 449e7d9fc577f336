"""Newton's iteration from many random starts at once.

Impact times are drawn at random; the section coordinates that fit them best follow from least
squares, since residuals are (close to) linear in them. Steps are shortened so that impacts stay
in order. Arrays have one start along their last axis, so that each number of all starts is in one
place.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Table, Vector
from ..models.guards import orders_of, pivot
from ..segments.compiling import CompiledProgram, load, mode, timed_plainly
from ..segments.flight import variant_of
from ..segments.integrated_flight import flown
from ..segments.integration import statement
from ..segments.kernel import SECTION, Blocks, Setup
from ..segments.segment import ELSEWHERE, STATES
from .block_cyclic import BLOCK, KEPT, POSITIONS, assemble, eliminate, solve, store, store_compiled

if TYPE_CHECKING:
    from ..segments.kernels import Kernels
    from ..segments.machine_code import Program
    from .problem import OrbitProblem

SPANS = 0.2, 5.0
"""Free periods that starts are given, as parts of the system's natural time."""

LONGEST = 2.0 * SPANS[1]
"""Free period from which on a start is given up, likewise."""

FAR = 30.0
"""Times as large as those of most starts: section coordinates at which one is given up, where
flights are integrated, which takes the longer the faster they oscillate."""

AT_REST = 1e-15
"""Times as large as those of most starts: section coordinates with which a machine without forcing
rests, whatever the time."""

NEARLY = 1e-6
"""Times as large as those of most starts: section coordinates that have vanished with a contact,
after all iterations but for what steps leave that halve them."""

SIZES = 0.1, 1.0, 10.0
"""Sizes of section coordinates that are drawn at random, in each unit."""

COARSE = 16.0
"""Units in which states are drawn are powers of this, beside which they have three sizes."""

FINEST, BRIEF, BENT, UNLIKE = 10, 2.0**-8, 0.5, -0.6
"""The least such power at which laws are looked at, for how many radians of the natural rate, by
which part of it a derivative has changed where they are not linear any more, and the next
coordinate as a part of each."""


def solve_rounds(
    problem: OrbitProblem,
    generator: np.random.Generator,
    starts: int,
    rounds: int,
    fitted: bool = True,
) -> list[Array]:
    """The solutions that the starts of each round lead to, in the order of their iterations.

    Section coordinates are drawn at random, too, unless they are fitted to the times.
    """
    times = [_random_times(problem, generator, starts) for _ in range(rounds)]
    with np.errstate(all="ignore"):
        at = np.concatenate(times).T
        begun = _fit_sections(problem, at) if fitted else _draw_sections(problem, at, generator)
        if fast := compiled_starts(problem):
            solutions, origin = solve_compiled(fast, problem, begun)
        else:
            with timed_plainly(identity_of(problem.kernels)):
                solutions, origin = solve_on_arrays(problem, begun)
    return [solutions[origin // starts == k] for k in range(rounds)]


def _random_times(problem: OrbitProblem, generator: np.random.Generator, count: int) -> Array:
    """Impact times in order, one row per start."""
    period = problem.kernels.setup(*problem.model.values.values()).period
    if problem.autonomous:
        low, high = np.log(SPANS).tolist()
        spans = period * np.exp(generator.uniform(low, high, (count, 1)))
        first = -spans
    else:
        spans = problem.word.period * period
        first = generator.uniform(0.0, period, count)[:, None]
    durations = generator.dirichlet(np.ones(len(problem.word)), count)
    durations *= spans
    return np.hstack([first, first + np.cumsum(durations, axis=1)[:, :-1]])


def _fit_sections(problem: OrbitProblem, times: Array) -> Array:
    """The starts with these impact times: section coordinates by least squares."""
    n, count = times.shape
    m = problem.m
    z = np.zeros((n, m, count))
    z[:, 0] = times
    residual, jacobian = _evaluate_all(problem, z)
    waves = 2.0 * math.pi / problem.kernels.setup(*problem.model.values.values()).period
    elsewhere = [arrival == ELSEWHERE for arrival in problem.arrivals]
    for found in (residual, jacobian):  # positions in the unit of velocities
        rows = found.reshape(n, m, -1)
        rows[:, 2::2] *= waves
        rows[elsewhere, 0] *= waves
    sections = [i for i in range(n * m) if i % m]
    by_section = np.moveaxis(jacobian[:, sections], -1, 0)
    normal = by_section.transpose(0, 2, 1) @ by_section
    normal += 1e-12 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(len(sections))
    right = -(by_section.transpose(0, 2, 1) @ residual.T[:, :, None])
    z.reshape(-1, count)[sections] = np.linalg.solve(normal, right)[:, :, 0].T
    return z


def _draw_sections(problem: OrbitProblem, times: Array, generator: np.random.Generator) -> Array:
    """The starts with these impact times: section coordinates at random."""
    z = generator.normal(size=(*times.T.shape, problem.m))
    rest = np.zeros(problem.n + 1)
    rest[: problem.n : problem.m] = times[:, 0]
    rest[-1] = problem.model.values[problem.parameter]
    units = units_of_states(problem, rest)
    sizes = np.multiply.outer(SIZES, units).reshape(-1, 1, problem.m)
    z *= generator.choice(sizes, times.shape[1])
    z[:, :, 0] = times.T
    return np.ascontiguousarray(np.moveaxis(z, 0, -1))


def units_of_states(problem: OrbitProblem, rest: Array) -> list[Array]:
    """Return units of states, powers of `COARSE`, each of shape (m,): those of `units_at_rest`, and
    the least in which laws are not linear, if far from these. `rest` has a state of zeros."""
    found, laws = units_at_rest(problem, rest), units_of_laws(problem)
    if found is None:
        return [_coarse_units(_units(problem, 1.0) if laws is None else laws)]
    known = _coarse_units(found)
    if laws is None or known[0] / COARSE <= laws[0] <= known[0] * COARSE:
        return [known]
    return [known, laws]


def units_at_rest(problem: OrbitProblem, rest: Array) -> Array | None:
    """Return units in which motion is of ordinary size, powers of two: for positions near where
    walls are, or to where forces lead from rest, each coordinate by its own; None where all are at
    zero. Coordinates that stay there have the largest of the others."""
    setup, lengths = problem.kernels.setup(*problem.model.values.values()), np.zeros(problem.m // 2)
    for guard, position in zip(problem.model.WALLS, setup.walls, strict=True):
        row = np.array(guard.row(len(lengths))) != 0.0
        places = 0 if problem.word.walls else row  # sections have the gap coordinate first
        lengths[places] = np.maximum(lengths[places], abs(position))
    try:
        moved = np.abs(problem.evaluate(rest).residual[: problem.n]).reshape(-1, len(lengths), 2)
    except ArithmeticError:
        moved = np.zeros((1, len(lengths), 2))
    moved[:, :, 1] *= setup.period / (2.0 * math.pi)
    found = np.max(moved, axis=(0, 2), initial=0.0, where=np.isfinite(moved))
    lengths = np.maximum(lengths, found)
    largest = np.max(lengths)
    return _units(problem, np.where(lengths > 0.0, lengths, largest)) if largest > 0.0 else None


def units_of_laws(problem: OrbitProblem) -> Array | None:
    """Return the least units, powers of `COARSE`, in which laws that are integrated are not linear;
    None where they are, or have no value at rest."""
    left = dict.fromkeys(problem.word.walls or [SECTION])
    laws = (_size_of_law(problem, a) for a in left if problem.kernels.integrated(a))
    sizes = [size for size in laws if size is not None]
    return _coarse_units(_units(problem, min(sizes))) if sizes else None


def _size_of_law(problem: OrbitProblem, left: str) -> float | None:
    """The least size of positions at which a law's derivatives have changed: accelerations', by the
    square of the natural rate at least, and rates' of coordinates of first order."""
    values = list(problem.model.values.values())
    try:
        field, numbers = problem.kernels.field(left)(*[0.0] * problem.m, *values)
    except (ArithmeticError, ValueError):  # no value at the time zero
        return None
    rate, first = 2.0 * math.pi / problem.kernels.setup(*values).period, None
    d = statement(field).freedom
    brief = BRIEF / rate
    weights, units = UNLIKE ** np.arange(d), np.repeat([1.0, rate], d)
    directions = " ".join(f"{x}{k}" for x in "xv" for k in range(d))
    for power in range(-FINEST, FINEST + 1):
        size = COARSE**power
        state = (size * units * np.tile(weights, 2)).tolist()
        try:
            found = flown(field, directions, brief, numbers[0], *state, *numbers[1 + 2 * d :])
        except (ArithmeticError, ValueError):
            return None if first is None else size
        ends = np.reshape(found[2 * d :], (2 * d, 2, d))[:, 1] * units[:, None] / rate
        first = ends if first is None else first
        if not np.max(np.abs(ends - first)) <= BENT * BRIEF:
            return size
    return None


def _coarse_units(units: Array) -> Array:
    found: Array = COARSE ** np.round(np.log2(units) / math.log2(COARSE))
    return found


def _units(problem: OrbitProblem, lengths: ArrayLike) -> Array:
    """Units of lengths for positions, and for velocities with the forcing's rate, as powers of
    two."""
    period = problem.kernels.setup(*problem.model.values.values()).period
    units = np.empty((problem.m // 2, 2))
    units[:, 0] = 2.0 ** np.round(np.log2(lengths))
    units[:, 1] = units[:, 0] * 2.0 ** round(math.log2(2.0 * math.pi / period))
    return units.ravel()


def solve_on_arrays(problem: OrbitProblem, z: Array) -> tuple[Array, Array]:
    """Newton's iteration from every start: the unknowns of those that converged, of shape (K, n +
    1), the soonest first, and the numbers of their starts."""
    n, m, count = z.shape
    value = problem.model.values[problem.parameter]
    period = problem.kernels.setup(*problem.model.values.values()).period
    origin = np.arange(count)
    reached: list[Array] = []
    origins: list[Array] = []
    integrated = any(problem.kernels.flown(*kind) for kind in problem.kinds)
    flown, typical = _flown_from(problem), _typical_size(z)
    far = FAR * typical if integrated else math.inf
    near = AT_REST * typical if problem.autonomous and typical < math.inf else 0.0
    astray, shrunk, last = np.zeros(count, dtype=int), np.zeros(count, dtype=int), np.ones(count)
    for _ in range(ITERATIONS):
        left = np.abs(z[flown]).max(axis=0, initial=0.0) < far
        if problem.autonomous:
            left &= -z[0, 0] < LONGEST * period
        z, origin = z[..., left], origin[left]
        if not len(origin):
            break
        residual, jacobian = _evaluate_all(problem, z)
        healthy = np.isfinite(residual.sum(axis=0) + jacobian.sum(axis=(0, 1)))
        if not healthy.all():
            z, origin, residual = z[..., healthy], origin[healthy], residual[:, healthy]
            jacobian = jacobian[..., healthy]
        step = solve_all(jacobian, -residual).reshape(n, m, -1)
        done = _sizes(step) < SETTLED * _sizes(z)
        done &= np.abs(step[:, 0]).max(axis=0) < SETTLED * period
        if done.any():
            ended = (z + step)[..., done]
            moving = _sizes(ended) >= near
            reached.append(ended[..., moving])
            origins.append(origin[done][moving])
            z, step, origin = z[..., ~done], step[..., ~done], origin[~done]
        part = shortening(problem, z, step, period)
        z = z + step * part
        off = part < ASTRAY
        astray[origin] += off
        shrunk[origin] = np.where(off & (part < SHRINKING * last[origin]), shrunk[origin] + 1, 0)
        last[origin] = part
        kept = (astray[origin] < LOST) & (shrunk[origin] < VANISHING)
        if not kept.all():
            z, origin = z[..., kept], origin[kept]
    if not problem.autonomous:  # where contacts vanish steps are halved, with all coordinates
        resting = _sizes(z) < NEARLY * typical
        reached.append(z[..., resting])
        origins.append(origin[resting])
    if not reached:
        return np.empty((0, n * m + 1)), np.empty(0, dtype=int)
    solutions = np.concatenate(reached, axis=-1).reshape(n * m, -1).T
    return np.insert(solutions, n * m, value, axis=1), np.concatenate(origins)


def _flown_from(problem: OrbitProblem) -> Array:
    """Which numbers of z are of a state: not times, nor velocities that a mode has none of."""
    size, found = problem.model.DEGREES_OF_FREEDOM, []
    for letter in problem.word.walls:
        guard = problem.model.guard(letter)
        own, place = orders_of(problem.model.MODES, guard.modes[0], size), pivot(guard.row(size))
        others = [order > k for order in (*own[:place], *own[place + 1 :]) for k in range(2)]
        found.append([False, own[place] > 1, *others])
    return np.array(found)


def _typical_size(z: Array) -> float:
    """The median size of section coordinates other than zero; infinite if there are none."""
    sizes = _sizes(z)
    known = np.sort(sizes[np.isfinite(sizes) & (sizes > 0.0)])
    middle = known[(len(known) - 1) // 2 : len(known) // 2 + 1]  # np.median imports numpy.ma
    return float(np.mean(middle)) if len(known) else math.inf


def _sizes(z: Array) -> Array:
    sizes: Array = np.abs(z[:, 1:]).max(axis=(0, 1))
    return sizes


def solve_all(matrices: Array, right: Array) -> Array:
    """Solutions of all systems, which are changed a little, so that zeros are divided by."""
    n = len(right)
    matrices[range(n), range(n)] += 1e-300
    systems, sides = np.moveaxis(matrices, -1, 0), right.T[:, :, None]
    try:
        return np.linalg.solve(systems, sides)[:, :, 0].T
    except np.linalg.LinAlgError:
        return (np.linalg.pinv(systems) @ sides)[:, :, 0].T


def shortening(problem: OrbitProblem, z: Array, step: Array, period: float) -> Array:
    """The part of each step that keeps impacts in order and moves no time by over T/4."""
    times, moves = z[:, 0], step[:, 0]
    durations, changes = np.empty_like(times), np.empty_like(times)
    for given, found, span in ((times, durations, period), (moves, changes, 0.0)):
        np.subtract(given[1:], given[:-1], out=found[:-1])
        np.subtract(problem.closing(given[0], span), given[-1], out=found[-1])
    less = changes < 0.0
    shrinking = np.where(less, -0.9 * durations / np.where(less, changes, 1.0), 1.0)
    if problem.autonomous:
        period = durations.sum(axis=0)
    largest = 0.25 * period / np.maximum(np.abs(moves).max(axis=0), 1e-300)
    return np.minimum(1.0, np.minimum(shrinking.min(axis=0), largest))


def _evaluate_all(problem: OrbitProblem, z: Array) -> tuple[Array, Array]:
    """Residuals (n, S) and square Jacobians (n, n, S) of all starts at the model's parameters.

    All flights between the same walls are evaluated together.
    """
    n, m, count = z.shape
    p = list(problem.model.values.values())
    period = problem.kernels.setup(*p).period
    arrivals = np.concatenate([z[1:], z[:1]])
    arrivals[-1, 0] = problem.closing(z[0, 0], period)
    closing = problem.closing(1.0, 0.0)
    residual = np.zeros((n, m, count))
    jacobian = np.zeros((n, m, n, m, count))
    for a, b in dict.fromkeys(problem.kinds):
        leaving = [k for k, kind in enumerate(problem.kinds) if kind == (a, b)]
        arriving = [(k + 1) % n for k in leaving]
        start, end = (np.ascontiguousarray(e[leaving].transpose(1, 0, 2)) for e in (z, arrivals))
        blocks = problem.kernels.segment(a, b).over(STATES)
        rows, by_start, by_end, _ = blocks(start, end, p)
        for i in range(m):
            for flight, (k, to) in enumerate(zip(leaving, arriving, strict=True)):
                residual[k, i] = _of_flight(rows[i], flight)
                for j in range(m):
                    jacobian[k, i, k, j] = _of_flight(by_start[m * i + j], flight)
                    moved = _of_flight(by_end[m * i + j], flight)
                    if j == 0 and k + 1 == n:
                        moved = moved * closing
                    jacobian[k, i, to, j] += moved
    problem.kernel_evaluations += count * n
    return residual.reshape(-1, count), jacobian.reshape(n * m, n * m, count)


def _of_flight(values: Any, flight: int) -> Any:
    """One flight's part of what is of all of them, or the same for all."""
    return values[flight] if np.ndim(values) else values


# Newton's iteration from many starts, compiled, as `solve_on_arrays` does it.
#
# It is for one degree of freedom and flights in closed form. Functions are in the plain subset of
# Python that `contimpact.segments.compiling` compiles.


ITERATIONS, SETTLED = 25, 1e-8
"""Most iterations, and the length of the Newton step after which a start has led to an orbit:
above one, of the period or of the largest velocity that part."""

ASTRAY, LOST = 1e-2, 10
"""Part of its Newton step that a start takes where it is astray, and how often it may be so: of
19,000 starts that led to orbits two were so seven times, none more often."""

SHRINKING, VANISHING = 0.2, 4
"""Part of the last part at which the part shrinks with a flight, and how often it may do so in a
row: steps towards a flight of no duration are shortened tenfold each time. Of 50,000 starts that
led to orbits 15 shrank so twice, none more often."""

PERIODS, PLACE = range(2)
"""Places in `counts`: forcing periods of the orbit, and the free parameter's among the values."""


def solve_from_starts(
    flight: Callable[..., Blocks],
    setup: Callable[[Vector], Setup],
    kinds: Vector,
    arrivals: Vector,
    counts: Vector,
    values: Vector,
    clock: Vector,
    border: Vector,
    step: Vector,
    made: Vector,
    blocks: Table,
    kept: Table,
    fixed: Table,
    starts: Table,
) -> int:
    """Iterate from every row of `starts`, which becomes the solution; fills `made` with the
    iterations it took, -1 where there is none. Returns how many points were evaluated.

    Steps leave the parameter, last in a row, as it is; they are shortened as in
    `shortening`.
    """
    count, evaluated = len(kinds), 0
    n = 2 * count
    for number in range(len(made)):
        z = starts[number]
        made[number] = -1.0
        astray, shrunk, last = 0, 0, 1.0
        for iteration in range(ITERATIONS):
            evaluated += 1
            total = assemble(
                flight,
                setup,
                kinds,
                counts[PERIODS],
                counts[PLACE],
                values,
                blocks,
                clock,
                fixed,
                z,
            )
            if total - total != 0.0:  # infinite or NaN
                break
            reduced = eliminate(blocks, arrivals, kept, 1.0, False, z, 0.0)
            if not abs(solve(reduced, kept, count, border, 0.0, step)) > 0.0:
                break
            farthest, period = 0.0, clock[0] / counts[PERIODS]
            largest, total, part, size = 0.0, 0.0, 1.0, 0.0
            for k in range(count):
                i = 2 * k
                farthest, size = max(farthest, abs(step[i])), max(size, abs(z[i + 1]))
                largest = max(largest, abs(step[i + 1]))
                total += abs(step[i]) + abs(step[i + 1])
            if total - total != 0.0:
                break
            if largest < SETTLED * size and farthest < SETTLED * period:
                for i in range(n):
                    z[i] += step[i]
                made[number] = float(iteration)
                break
            for k in range(count):
                i = 2 * k
                if k + 1 < count:
                    duration, change = z[i + 2] - z[i], step[i + 2] - step[i]
                else:
                    duration, change = z[0] + clock[0] - z[i], step[0] - step[i]
                if change < 0.0:
                    part = min(part, -0.9 * duration / change)
            part = min(part, 0.25 * period / max(farthest, 1e-300))
            for i in range(n):
                z[i] += part * step[i]
            if part < ASTRAY:
                astray += 1
                shrunk = shrunk + 1 if part < SHRINKING * last else 0
            else:
                shrunk = 0
            last = part
            if astray >= LOST or shrunk >= VANISHING:
                break
    return evaluated


ARGUMENTS = "iii" + "fffff" + "FFFF"
VECTORS = "kinds, arrivals, counts, values, clock, border, step, made, blocks, kept, fixed, starts"


def compiled_starts(problem: OrbitProblem) -> CompiledProgram | None:
    """Return compiled code for a problem, if there can be some and it is in the cache or pays."""
    kernels, walls = problem.kernels, problem.model.WALLS
    if mode() == "never" or not problem.paired:
        return None
    if any(kernels.linear(wall.name) or kernels.integrated(wall.name) for wall in walls):
        return None
    if variant_of(kernels, list(problem.model.values.values())) is None:
        return None
    return load(identity_of(kernels), ARGUMENTS, lambda: starts_program(kernels))


def identity_of(kernels: Kernels) -> tuple[str, ...]:
    """Return what tells the program from others."""
    return kernels.identity, "starts"


def starts_program(kernels: Kernels) -> Program:
    """Return `solve_from_starts` as a program, for words of a model."""
    from ..segments.machine_code import Program

    program = Program({store: store_compiled})
    walls = kernels.model.letters
    p = ", ".join(f"p[{i}]" for i in range(len(kernels.model.values)))
    flights = {f"flight_{a}_{b}": kernels.flight(a, b) for a in walls for b in walls}
    given = f"t0, v0, t1, v1, {p}"
    program.choose("any_flight", "kind, t0, v0, t1, v1, p", "kind", flights, given)
    text = f"""
def any_setup(p):
    return kernel_setup({p})

def entry({VECTORS}):
    return solve_from_starts(any_flight, any_setup, {VECTORS})
"""
    program.glue(text, kernel_setup=kernels.setup, solve_from_starts=solve_from_starts)
    return program


def solve_compiled(fast: CompiledProgram, problem: OrbitProblem, z: Array) -> tuple[Array, Array]:
    """As `solve_on_arrays`."""
    n, m, starts = z.shape
    model, setup = problem.model, problem.kernels.setup(*problem.model.values.values())
    letters, names = model.letters, list(model.values)
    word = [letters.index(letter) for letter in problem.word.walls]
    kinds = [a * len(letters) + b for a, b in zip(word, word[1:] + word[:1], strict=True)]
    place = names.index(problem.parameter)
    values, border = np.array(list(model.values.values())), np.zeros(n * m + 1)
    border[-1] = 1.0
    rows = np.empty((starts, n * m + 1))
    rows[:, :-1], rows[:, -1] = z.reshape(n * m, starts).T, values[place]
    made = np.empty(starts)
    evaluated = fast(
        np.array(kinds),
        np.array(problem.arrivals),
        np.array([problem.word.period, place]),
        values,
        np.zeros(3),
        border,
        np.empty(n * m + 1),
        made,
        np.empty((n, BLOCK)),
        np.empty((n, KEPT)),
        np.empty((1, POSITIONS + len(setup.walls) + len(setup.derived))),
        rows,
    )
    problem.kernel_evaluations += evaluated * n
    order = np.argsort(made, kind="stable")
    order = order[made[order] >= 0.0]
    return rows[order], order
