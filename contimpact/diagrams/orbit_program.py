"""Compiled programs of steps along branches of orbits."""

from __future__ import annotations

import ast

from ..continuation.step import take_steps
from ..orbits.block_cyclic import store, store_compiled
from ..segments.arithmetic import Kernel, kernel_of
from ..segments.compiled_flow import flow_compiled, space_of
from ..segments.excursion_code import add_excursions
from ..segments.kernels import Kernels
from ..segments.linear_flow import flow
from ..segments.machine_code import Program, choice
from ..segments.oscillation import FollowedFlight, row_of, row_of_compiled
from ..syntax import parse
from .chain_functions import (
    ChainVectors,
    chain_step,
    evaluate_chain,
    follow_law,
    observe_chain,
    tangent_of_chain,
)
from .orbit_functions import (
    OrbitVectors,
    evaluate_cycle,
    newton_step,
    observe_cycle,
    tangent_of_cycle,
)

# Kernels that call `flow`, as they are compiled: with scratch space, where it puts its tables.


def space_for(kernels: Kernels) -> int:
    """Return how many numbers of scratch space the flights of a model take; 0 for none."""
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


ENTRY = """
def entry({fields}, options, state, scale, z, tangent, chord, work, rows):
    orbit = OrbitVectors({fields})
    vectors = (options, state, scale, z, tangent, chord, work, rows)
    return take_steps(evaluate, newton_step, tangent_of_cycle, observe, orbit, vectors)

def any_setup(p):
    return kernel_setup({p})

def evaluate(orbit, z):
    return evaluate_cycle(any_flight, any_setup, orbit, z)

def observe(orbit, z, tangent, orientation, row, at):
    return observe_cycle(breaks, excursion, orbit, z, row, at)
"""


def program_of(kernels: Kernels, variant: str) -> Program:
    """Return the program that takes steps along a branch of any word of a model.

    `variant` says how the zeros of the acceleration are found; see `excursion_code.variant_of`.
    """
    program = Program({store: store_compiled, row_of: row_of_compiled, flow: flow_compiled})
    count = len(kernels.model.values)
    p = ", ".join(f"p[{i}]" for i in range(count))
    walls = kernels.model.letters
    flights = {f"flight_{a}_{b}": kernels.flight(a, b) for a in walls for b in walls}
    ends = f"t0, v0, t1, v1, {p}"
    if any(kernels.linear(wall) for wall in walls):
        flights = {name: add_scratch_space(kernel) for name, kernel in flights.items()}
        ends += f", p[{count}:]"
    flight = choice("any_flight", "kind, t0, v0, t1, v1, p", "kind", list(flights), ends)
    program.glue(flight, **flights)
    program.constant("OrbitVectors", OrbitVectors)
    add_excursions(program, kernels, variant, p)
    called = (take_steps, newton_step, tangent_of_cycle, evaluate_cycle, observe_cycle)
    named = {function.__name__: function for function in called}
    fields = ", ".join(OrbitVectors._fields)
    program.glue(ENTRY.format(fields=fields, p=p), kernel_setup=kernels.setup, **named)
    return program


# The program that takes steps along a branch of any word of a linear machine, for compiling.

CHAIN_ENTRY = """
def entry({fields}, options, state, scale, z, tangent, chord, step_work, rows):
    orbit = ChainVectors({fields})
    vectors = (options, state, scale, z, tangent, chord, step_work, rows)
    return take_steps(evaluate, chain_step, tangent_of_chain, observe, orbit, vectors)

def any_setup(p):
    return kernel_setup({p})

def evaluate(orbit, z):
    return evaluate_chain(any_flight, any_setup, orbit, z)

def follow(orbit, wall, z, at, length):
    return follow_law(any_law, orbit, wall, z, at, length)

def observe(orbit, z, tangent, orientation, row, at):
    return observe_chain(follow, orbit, z, tangent, orientation, row, at)
"""


def chain_program_of(kernels: Kernels) -> Program:
    """Return the program that takes steps along a branch of any word of a linear machine."""
    program = Program({store: store_compiled, row_of: row_of_compiled, flow: flow_compiled})
    count, m = len(kernels.model.values), kernels.model.unknowns_per_impact
    p = ", ".join(f"p[{i}]" for i in range(count))
    walls = kernels.model.letters
    flights = {
        f"flight_{a}_{b}": add_scratch_space(kernels.flight(a, b)) for a in walls for b in walls
    }
    ends = ", ".join(f"s[{i}]" for i in range(2 * m))
    given = f"{ends}, {p}, p[{count}:]"
    program.glue(choice("any_flight", "kind, s, p", "kind", list(flights), given), **flights)
    laws = {f"law_{a}": kernels.law(a) for a in walls}
    start = ", ".join(f"s[{i}]" for i in range(m))
    program.glue(choice("any_law", "wall, s, p", "wall", list(laws), f"{start}, {p}"), **laws)
    program.constant("ChainVectors", ChainVectors)
    program.constant("FollowedFlight", FollowedFlight)
    called = (
        take_steps,
        chain_step,
        tangent_of_chain,
        evaluate_chain,
        observe_chain,
        follow_law,
    )
    named = {function.__name__: function for function in called}
    fields = ", ".join(ChainVectors._fields)
    program.glue(CHAIN_ENTRY.format(fields=fields, p=p), kernel_setup=kernels.setup, **named)
    return program
