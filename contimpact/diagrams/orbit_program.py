"""Compiled programs of steps along branches of orbits."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from typing import Any

from ..arrays import Vector
from ..continuation.step import take_steps
from ..models.guards import following_letters
from ..orbits.block_cyclic import notice_growth, store, store_compiled
from ..orbits.cyclic_chain import (
    ChainVectors,
    chain_step,
    evaluate_chain,
    evaluate_section,
    follow_field,
    follow_law,
    measure_chain,
    measure_section,
    observe_chain,
    tangent_of_chain,
)
from ..segments.flight import add_excursions
from ..segments.kernel import SECTION, Family
from ..segments.kernels import Kernels
from ..segments.linear_flow import LONGEST, MEANS, SLOPES, balance, flow, halve_time
from ..segments.machine_code import Program
from ..segments.oscillation import FollowedFlight, row_of, row_of_compiled
from ..segments.segment import Kernel, kernel_of
from ..segments.taylor import EXCURSION, flight_kernel, path_kernel, start_kernel
from ..syntax import parse
from .orbit_functions import (
    OrbitVectors,
    evaluate_cycle,
    newton_step,
    observe_cycle,
    tangent_of_cycle,
)

# Linear flights as scalar code: what `linear_flow` does on arrays, to the last bit.
#
# The functions are in the plain subset of Python that `contimpact.compiling` compiles. Matrices
# stand at places of one vector, row by row.


def space_of(d: int, h: int, directions: int) -> int:
    """Return how many numbers of scratch space `flow_compiled` takes."""
    n = 2 * d + 2 * h + 1
    columns = n * (directions + 1)
    given, tables = (d * n + h) * (directions + 1), d * n * (4 + 2 * directions)
    return given + tables + 2 * n + directions + 1 + 8 * n * columns + 7 * d * n


def flow_compiled(d: int, h: int, directions: int, dt: float, space: Vector) -> Vector:
    """As `flow`, with the numbers at the beginning of scratch space; returns a part of it."""
    n = 2 * d + 2 * h + 1
    columns = n * (directions + 1)
    matrix, row = n * columns, d * n
    given = (row + h) * (directions + 1)
    tables = row * (4 + 2 * directions)
    numbers, found = space[:given], space[given : given + tables]
    at = given + tables
    scales, sums, sizes = space[at : at + n], space[at + n : at + 2 * n], space[at + 2 * n :]
    work = space[at + 2 * n + directions + 1 :]
    sizes[0] = 1.0
    for i in range(matrix):
        work[i] = 0.0
    norm = balance(d, h, directions, numbers, scales, sums, sizes, work)
    if not norm * abs(dt) < LONGEST:
        for i in range(tables):
            found[i] = math.nan
        return found
    mean, end, rate, pushed = matrix, 2 * matrix, 8 * matrix, 8 * matrix + row
    mean_rates_compiled(d, n, columns, dt, norm, work)
    for i in range(n):
        for j in range(columns):
            work[end + columns * i + j] = dt * work[mean + columns * i + j]
        work[end + columns * i + i] += 1.0
    multiply(work, columns * d, d, columns, end, n, columns, 0, pushed, n)
    for i in range(d):
        for b in range(directions + 1):
            first = 0 if b == 0 else 2 * row * (b + 1)
            for j in range(n):
                unit, to = sizes[b] / scales[j], first + n * i + j
                place = columns * i + n * b + j
                found[to] = work[mean + place] * (scales[i] * unit)
                place += columns * d
                found[to + row] = work[end + place] * (scales[d + i] * unit)
        for j in range(n):
            unit, to = 1.0 / scales[j], 2 * row + n * i + j
            found[to] = work[rate + n * i + j] * (scales[i] * unit)
            found[to + row] = work[pushed + n * i + j] * (scales[d + i] * unit)
    return found


def mean_rates_compiled(d: int, n: int, columns: int, dt: float, norm: float, work: Vector) -> None:
    """As `_mean_rates`: from G at the beginning, Q behind it, and H behind eight matrices."""
    matrix, row = n * columns, d * n
    mean, z, square, cubic, fourth, total, other = (
        matrix,
        2 * matrix,
        3 * matrix,
        4 * matrix,
        5 * matrix,
        6 * matrix,
        7 * matrix,
    )
    rate = 8 * matrix
    t, doublings = halve_time(dt, norm)
    for i in range(matrix):
        work[z + i] = t * work[i]
    multiply(work, z, n, columns, z, n, columns, columns // n - 1, square, columns)
    multiply(work, z, n, columns, square, n, columns, columns // n - 1, cubic, columns)
    multiply(work, square, n, columns, square, n, columns, columns // n - 1, fourth, columns)
    for part in range(3, -1, -1):
        if part < 3:
            multiply(work, total, n, columns, fourth, n, columns, columns // n - 1, other, columns)
        c1, c2, c3 = MEANS[4 * part + 1], MEANS[4 * part + 2], MEANS[4 * part + 3]
        for i in range(n):
            for j in range(columns):
                k = columns * i + j
                x = c1 * work[z + k] + c2 * work[square + k] + c3 * work[cubic + k]
                if i == j:
                    x += MEANS[4 * part]
                work[total + k] = x if part == 3 else work[other + k] + x
    multiply(work, 0, n, columns, total, n, columns, columns // n - 1, mean, columns)
    # rows of G times the powers of z: G itself is the first
    unit, one = work[d], columns * d
    first, second, third, sum_ = rate + 2 * row, rate + 3 * row, rate + 4 * row, rate + 5 * row
    multiply(work, one, d, columns, z, n, columns, 0, first, n)
    multiply(work, one, d, columns, square, n, columns, 0, second, n)
    multiply(work, one, d, columns, cubic, n, columns, 0, third, n)
    for part in range(3, -1, -1):
        if part < 3:
            multiply(work, rate, d, n, fourth, n, columns, 0, sum_, n)
        c0, c1 = SLOPES[4 * part], SLOPES[4 * part + 1]
        c2, c3 = SLOPES[4 * part + 2], SLOPES[4 * part + 3]
        for i in range(d):
            for j in range(n):
                k = n * i + j
                x = c0 * work[one + columns * i + j] + c1 * work[first + k]
                x = x + c2 * work[second + k] + c3 * work[third + k]
                work[rate + k] = x if part == 3 else work[sum_ + k] + x
    for k in range(row):
        work[rate + k] = unit * work[rate + k]
    pushed = first
    for _ in range(doublings):
        for i in range(d):
            for j in range(n):
                work[pushed + n * i + j] = unit * work[mean + columns * (d + i) + j]
                work[second + n * i + j] = work[pushed + n * i + j] + work[rate + n * i + j]
        multiply(work, second, d, n, mean, n, columns, 0, third, n)
        multiply(work, mean, n, columns, mean, n, columns, columns // n - 1, other, columns)
        for k in range(row):
            x = work[pushed + k] + 2.0 * work[rate + k] + t * work[third + k]
            work[rate + k] = 0.25 * x
        for k in range(matrix):
            work[mean + k] = work[mean + k] + 0.5 * (t * work[other + k])
        t = 2.0 * t


def multiply(
    work: Vector,
    one: int,
    rows: int,
    width: int,
    other: int,
    n: int,
    columns: int,
    blocks: int,
    out: int,
    out_width: int,
) -> None:
    """Multiply rows at a place by a matrix at another; sums are made in order.

    `width` and `columns` are those of a row of either, and `blocks` is how many derivatives there
    are besides: as of block-triangular matrices of which the upper rows are kept.
    """
    for i in range(rows):
        row, to = one + width * i, out + out_width * i
        size = n * (blocks + 1)
        factor = work[row]
        for j in range(size):
            work[to + j] = factor * work[other + j]
        for k in range(1, n):
            factor = work[row + k]
            for j in range(size):
                work[to + j] += factor * work[other + columns * k + j]
        for b in range(1, blocks + 1):
            for k in range(n):
                factor = work[row + n * b + k]
                for j in range(n):
                    work[to + n * b + j] += factor * work[other + columns * k + j]


# Kernels that call `flow`, as they are compiled: with scratch space, where it puts its tables.


def space_for(kernels: Kernels) -> int:
    """Return how many numbers of scratch space the flights of a model take; 0 for none."""
    if kernels.has_paths:
        walls = kernels.model.letters
        flights = [flight_kernel(kernels.flight(a, b)) for a, b in pairs_of(kernels)]
        paths = [path_kernel(kernels.field(a)) for a in walls]
        return max(found.space for found in (*flights, *paths)) + EXCURSION
    values = kernels.model.values.values()
    start = [0.0] * kernels.model.unknowns_per_impact
    linear = [guard.name for guard in kernels.model.WALLS if kernels.linear(guard.name)]
    shapes = [kernels.law(name)(*start, *values)[:2] for name in linear]
    return max((space_of(int(d), int(h), len(kernels.parameters)) for d, h in shapes), default=0)


def add_scratch_space(kernel: Kernel) -> Kernel:
    """Return a kernel with scratch space as its last argument, which it hands on to `flow`.

    The numbers of the flow are put at the beginning of the space, instead of being arguments.

    Raises NotImplementedError for a kernel with two flows: the second would overwrite what the
    first has found.
    """
    tree = parse(kernel.text)
    (function,) = (node for node in tree.body if isinstance(node, ast.FunctionDef))
    function.args.args.append(ast.arg("space"))
    body: list[ast.stmt] = []
    flows = 0
    for statement in function.body:
        call = getattr(statement, "value", None)
        if isinstance(call, ast.Call) and getattr(call.func, "id", "") == "flow":
            flows += 1
            for i, number in enumerate(call.args[4:]):
                body += parse(f"space[{i}] = {ast.unparse(number)}").body
            call.args[4:] = [ast.Name("space", ast.Load())]
        body.append(statement)
    if flows > 1:
        raise NotImplementedError(f"{kernel.__name__} has {flows} flows")
    function.body = body
    text = ast.unparse(ast.fix_missing_locations(tree))
    return kernel_of(kernel.__name__, text, f"<{kernel.__name__} with space>")


# What makes functions of a problem a compiled program that takes steps.

STEPS = """
def entry({fields}, options, state, scale, z, tangent, chord, step_work, rows):
    problem = {vectors}({fields})
    step_vectors = (options, state, scale, z, tangent, chord, step_work, rows)
    return take_steps(evaluate, {solve}, {tangent_at}, {observe}, problem, step_vectors)

def any_setup(p):
    return kernel_setup({p})
"""


def glue_steps(
    program: Program,
    kernels: Kernels,
    vectors: Any,
    text: str,
    *functions: Callable[..., Any],
    observe: str = "observe",
) -> Program:
    """Add to a program what takes steps with these vectors, and the text of its own functions:
    `evaluate` and `observe`. The functions are solve, tangent_at, and those that the text calls."""
    named = {function.__name__: function for function in (*functions, take_steps)}
    solve, tangent_at, *_ = named
    p = ", ".join(f"p[{i}]" for i in range(len(kernels.model.values)))
    called = {"solve": solve, "tangent_at": tangent_at, "observe": observe, "p": p}
    program.constant(vectors.__name__, vectors)
    steps = STEPS.format(fields=", ".join(vectors._fields), vectors=vectors.__name__, **called)
    program.glue(text + steps, kernel_setup=kernels.setup, **named)
    return program


OF_CYCLE = """
def evaluate(orbit, z):
    size = evaluate_cycle(any_flight, any_setup, orbit, z)
    {notice}
    return size

def observe(orbit, z, tangent, orientation, row, at):
    return observe_cycle(breaks, excursion, orbit, z, row, at)
"""

NOTICE = "notice_growth(orbit.blocks, len(orbit.kinds), 2, True, orbit.clock)"


def program_of(kernels: Kernels, variant: str) -> Program:
    """Return the program that takes steps along a branch of any word of a model.

    `variant` says how the zeros of the acceleration are found; see `segments.flight.variant_of`.
    """
    program = Program({store: store_compiled, row_of: row_of_compiled, flow: flow_compiled})
    count, walls = len(kernels.model.values), kernels.model.letters
    p = ", ".join(f"p[{i}]" for i in range(count))
    flights = {f"flight_{a}_{b}": kernels.flight(a, b) for a in walls for b in walls}
    ends = f"t0, v0, t1, v1, {p}"
    if any(kernels.linear(wall) for wall in walls):
        flights = {name: add_scratch_space(kernel) for name, kernel in flights.items()}
        ends += f", p[{count}:]"
    if variant == "path":
        flights = {name: flight_kernel(kernel).function for name, kernel in flights.items()}
        ends += f", p[{count}:]"
    program.choose("any_flight", "kind, t0, v0, t1, v1, p", "kind", flights, ends)
    add_excursions(program, kernels, variant, p)
    called = newton_step, tangent_of_cycle, evaluate_cycle, observe_cycle, notice_growth
    text = OF_CYCLE.format(notice=NOTICE if variant == "path" else "pass")
    return glue_steps(program, kernels, OrbitVectors, text, *called)


OF_CHAIN = """
def evaluate(orbit, z):
    size = evaluate_chain(any_flight, any_setup, orbit, z)
    {notice}
    return size

def follow(orbit, wall, z, at, length):
    return {follow}

def observe(orbit, z, tangent, orientation, row, at):
    return observe_chain(measure_chain, follow, orbit, z, row, at)
"""

FROM_SECTION = """
def one_flight(z, p):
    rows, start, end, free = flight_on({state}, {unknowns}, {p}, p[{count}:])
    return rows, ({leaves}), end, free

def spans(z, period):
    return {spans}

def any_start(wall, z, p):
    return start_of({state}, {p})

def any_path(wall, z, p, length, weights, count, way):
    return path_of({state}, {p}, length, p[{count}:], weights, count, way)
"""

OF_SECTION = """
def evaluate(orbit, z):
    size = evaluate_section(one_flight, spans, any_setup, orbit, z)
    notice_growth(orbit.blocks, 1, {m}, False, orbit.clock)
    return size

def follow(orbit, wall, z, at, length):
    return follow_field(any_start, any_path, orbit, wall, z, at, length)

def observe(orbit, z, tangent, orientation, row, at):
    return observe_chain(measure_section, follow, orbit, z, row, at)
"""


def chain_program_of(kernels: Kernels) -> Program:
    """Return the program that takes steps along a branch of any word of a machine whose flights
    are linear, or all integrated."""
    program = Program({store: store_compiled, row_of: row_of_compiled, flow: flow_compiled})
    count, m = len(kernels.model.values), kernels.model.unknowns_per_impact
    p = ", ".join(f"p[{i}]" for i in range(count))
    walls = kernels.model.letters
    flights = {f"flight_{a}_{b}": _integrating(kernels.flight(a, b)) for a, b in pairs_of(kernels)}
    some = next(iter(flights.values()))
    every = [f"flight_{a}_{b}" for a in walls for b in walls]  # some never follow each other
    named = {name: flights.get(name, some) for name in every}
    ends = ", ".join(f"s[{i}]" for i in range(2 * m))
    given = f"{ends}, {p}, p[{count}:]"
    program.choose("any_flight", "kind, s, p", "kind", named, given)
    start = ", ".join(f"s[{i}]" for i in range(m))
    about = {"notice": "pass", "follow": "follow_law(any_law, orbit, wall, z, at, length)"}
    called: list[Callable[..., Any]]
    called = [chain_step, tangent_of_chain, evaluate_chain, observe_chain, measure_chain]
    if kernels.has_paths:
        called += [notice_growth, follow_field]
        about["notice"] = f"notice_growth(orbit.blocks, len(orbit.kinds), {m}, True, orbit.clock)"
        about["follow"] = "follow_field(any_start, any_path, orbit, wall, z, at, length)"
        freedom = kernels.model.DEGREES_OF_FREEDOM
        starts = {f"start_{a}": start_kernel(kernels.field(a), freedom) for a in walls}
        paths = {f"path_{a}": path_kernel(kernels.field(a)).function for a in walls}
        more = "length, weights, count, way"
        given = f"{start}, {p}, length, p[{count}:], weights, count, way"
        program.choose("any_path", f"wall, s, p, {more}", "wall", paths, given)
        program.choose("any_start", "wall, s, p", "wall", starts, f"{start}, {p}")
    else:
        called.append(follow_law)
        laws = {f"law_{a}": kernels.law(a) for a in walls}
        program.choose("any_law", "wall, s, p", "wall", laws, f"{start}, {p}")
    program.constant("FollowedFlight", FollowedFlight)
    return glue_steps(program, kernels, ChainVectors, OF_CHAIN.format(**about), *called)


def section_program_of(kernels: Kernels, periods: int) -> Program:
    """Return the program that takes steps along a branch of orbits without impacts of so many
    periods, or a free one for 0, whose flights are integrated."""
    program = Program({store: store_compiled, row_of: row_of_compiled})
    m, count = kernels.model.unknowns_per_impact, len(kernels.model.values)
    unknowns = [f"z[{i}]" for i in range(m)]
    leaves = [f"start[{i}]" for i in range(m * m)]
    if not periods:
        leaves[1::m] = ["0.0"] * m
    given = {
        "state": ", ".join(unknowns if periods else [unknowns[0], "0.0", *unknowns[2:]]),
        "unknowns": ", ".join(unknowns),
        "leaves": ", ".join(leaves),
        "spans": f"{periods} * period, period" if periods else "z[1], z[1]",
        "p": ", ".join(f"p[{i}]" for i in range(count)),
    }
    field, freedom = kernels.field(SECTION), kernels.model.DEGREES_OF_FREEDOM
    program.glue(
        FROM_SECTION.format(count=count, **given),
        flight_on=flight_kernel(kernels.flight(SECTION, str(periods))).function,
        start_of=start_kernel(field, freedom),
        path_of=path_kernel(field).function,
    )
    called: list[Callable[..., Any]] = [chain_step, tangent_of_chain, evaluate_section]
    called += [observe_chain, measure_section]
    called += [notice_growth, follow_field]
    program.constant("FollowedFlight", FollowedFlight)
    return glue_steps(program, kernels, ChainVectors, OF_SECTION.format(m=m), *called)


def space_from_section(kernels: Kernels, periods: int) -> int:
    """Return how many numbers of scratch space flights from the section take."""
    flight = flight_kernel(kernels.flight(SECTION, str(periods)))
    return max(flight.space, path_kernel(kernels.field(SECTION)).space)


def pairs_of(kernels: Kernels) -> list[tuple[str, str]]:
    """Return the guards that can follow each other."""
    guards = kernels.model.WALLS
    return [(a.name, b) for a in guards for b in following_letters(guards, a.name)]


def _integrating(kernel: Kernel) -> Kernel:
    """A kernel as it is compiled, with scratch space."""
    if kernel.family is Family.INTEGRATED:
        return flight_kernel(kernel).function
    return add_scratch_space(kernel)
