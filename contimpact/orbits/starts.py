"""Newton's iteration from many starts, compiled, as `search` does it on arrays.

It is for one degree of freedom and flights in closed form. Functions are in the plain subset of
Python that `contimpact.segments.compiling` compiles.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Array, Table, Vector
from ..segments.compiling import CompiledProgram, load, mode
from ..segments.flight import variant_of
from ..segments.layout import Blocks, Setup
from .block_cyclic import BLOCK, KEPT, POSITIONS, assemble, eliminate, solve, store, store_compiled

if TYPE_CHECKING:
    from ..segments.kernels import Kernels
    from ..segments.machine_code import Program
    from .problem import OrbitProblem

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
    `search.shortening`.
    """
    count, evaluated = len(kinds), 0
    n = 2 * count
    for number in range(len(made)):
        z = starts[number]
        made[number] = -1.0
        astray, shrunk, last = 0, 0, 1.0
        for iteration in range(ITERATIONS):
            evaluated += 1
            worst = assemble(
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
            if worst - worst != 0.0:  # infinite or NaN
                break
            reduced = eliminate(blocks, arrivals, kept, 1.0, False, z, 0.0)
            if not abs(solve(reduced, kept, count, border, 0.0, step)) > 0.0:
                break
            farthest, period = 0.0, clock[0] / counts[PERIODS]
            largest, total, part, size = 0.0, 0.0, 1.0, 1.0
            for k in range(count):
                i = 2 * k
                farthest, size = max(farthest, abs(step[i])), max(size, abs(z[i + 1]))
                largest = max(largest, abs(step[i + 1]))
                total += abs(step[i]) + abs(step[i + 1])
            if total - total != 0.0:
                break
            if largest < SETTLED * size and farthest < SETTLED * max(1.0, period):
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
    from ..segments.machine_code import Program, choice

    program = Program({store: store_compiled})
    walls = kernels.model.letters
    p = ", ".join(f"p[{i}]" for i in range(len(kernels.model.values)))
    flights = {f"flight_{a}_{b}": kernels.flight(a, b) for a in walls for b in walls}
    given = f"t0, v0, t1, v1, {p}"
    chosen = choice("any_flight", "kind, t0, v0, t1, v1, p", "kind", list(flights), given)
    program.glue(chosen, **flights)
    text = f"""
def any_setup(p):
    return kernel_setup({p})

def entry({VECTORS}):
    return solve_from_starts(any_flight, any_setup, {VECTORS})
"""
    program.glue(text, kernel_setup=kernels.setup, solve_from_starts=solve_from_starts)
    return program


def solve_compiled(fast: CompiledProgram, problem: OrbitProblem, z: Array) -> tuple[Array, Array]:
    """As `search.solve_on_arrays`."""
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
