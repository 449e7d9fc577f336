"""The program that takes steps along a branch of any word of a linear machine, for compiling."""

from __future__ import annotations

from ..continuation.step import take_steps
from ..orbits.block_cyclic import store, store_compiled
from ..segments.compiled_flow import flow_compiled
from ..segments.kernels import Kernels
from ..segments.linear_flow import flow
from ..segments.machine_code import Program
from ..segments.oscillation import row_of, row_of_compiled
from ..segments.oscillations import Followed
from .chain_functions import (
    ChainVectors,
    chain_step,
    evaluate_chain,
    follow_law,
    observe_chain,
    tangent_of_chain,
)
from .linear_flights import with_space
from .orbit_program import choice

ENTRY = """
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


def program_of(kernels: Kernels) -> Program:
    """Return the program that takes steps along a branch of any word of a linear machine."""
    program = Program({store: store_compiled, row_of: row_of_compiled, flow: flow_compiled})
    count, m = len(kernels.model.values), kernels.model.unknowns_per_impact
    p = ", ".join(f"p[{i}]" for i in range(count))
    walls = kernels.model.letters
    flights = {f"flight_{a}_{b}": with_space(kernels.flight(a, b)) for a in walls for b in walls}
    ends = ", ".join(f"s[{i}]" for i in range(2 * m))
    given = f"{ends}, {p}, p[{count}:]"
    program.glue(choice("any_flight", "kind, s, p", "kind", list(flights), given), **flights)
    laws = {f"law_{a}": kernels.law(a) for a in walls}
    start = ", ".join(f"s[{i}]" for i in range(m))
    program.glue(choice("any_law", "wall, s, p", "wall", list(laws), f"{start}, {p}"), **laws)
    program.constant("ChainVectors", ChainVectors)
    program.constant("Followed", Followed)
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
    program.glue(ENTRY.format(fields=fields, p=p), kernel_setup=kernels.setup, **named)
    return program
