"""The program that takes steps along a branch of any word of a model, for compiling."""

from __future__ import annotations

from collections.abc import Sequence

from ..continuation.step import take_steps
from ..orbits.block_cyclic import store, store_compiled
from ..segments.compiled_flow import flow_compiled
from ..segments.flight import single_zeros
from ..segments.kernels import Kernels
from ..segments.linear_flow import flow
from ..segments.machine_code import Program
from ..segments.oscillation import excursion_by_law, excursions, row_of, row_of_compiled
from .linear_flights import with_space
from .orbit_functions import (
    OrbitVectors,
    evaluate_cycle,
    newton_step,
    observe_cycle,
    tangent_of_cycle,
)

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


MOTION = """
def excursion(
    head, values, length, arriving, left_side, reached_side, zeros, phase, period, steps,
):
    return excursions(
        any_motion, head, values, length, arriving, left_side, reached_side, zeros, phase, period
    )
"""

LAW = """
def excursion(
    head, values, length, arriving, left_side, reached_side, zeros, phase, period, steps,
):
    return excursion_by_law(
        any_law, head, values, length, arriving, left_side, reached_side, steps, zeros
    )
"""

GIVEN = """
def breaks(values, period, zeros):
    return zeros
"""

SINGLE = """
def breaks(p, period, zeros):
    mean, order, a, b = kernel_harmonics({p})
    return zeros[:single_zeros(mean, a, b, period, zeros)]
"""


def program_of(kernels: Kernels, variant: str) -> Program:
    """Return the program that takes steps along a branch of any word of a model.

    `variant` says how the zeros of the acceleration are found: they are "fixed" along the branch,
    or those of a "single" harmonic that changes along it, or are found on each flight by its "law".
    """
    program = Program({store: store_compiled, row_of: row_of_compiled, flow: flow_compiled})
    count = len(kernels.model.values)
    p = ", ".join(f"p[{i}]" for i in range(count))
    walls = kernels.model.letters
    flights = {f"flight_{a}_{b}": kernels.flight(a, b) for a in walls for b in walls}
    ends = f"t0, v0, t1, v1, {p}"
    if any(kernels.linear(wall) for wall in walls):
        flights = {name: with_space(kernel) for name, kernel in flights.items()}
        ends += f", p[{count}:]"
    flight = choice("any_flight", "kind, t0, v0, t1, v1, p", "kind", list(flights), ends)
    program.glue(flight, **flights)
    program.constant("OrbitVectors", OrbitVectors)
    _add_excursions(program, kernels, variant, walls, p)
    called = (take_steps, newton_step, tangent_of_cycle, evaluate_cycle, observe_cycle)
    named = {function.__name__: function for function in called}
    fields = ", ".join(OrbitVectors._fields)
    program.glue(ENTRY.format(fields=fields, p=p), kernel_setup=kernels.setup, **named)
    return program


def _add_excursions(
    program: Program, kernels: Kernels, variant: str, walls: Sequence[str], p: str
) -> None:
    """Add the functions ``excursion`` and ``breaks``."""
    if variant == "law":
        laws = {f"law_{a}": kernels.law(a) for a in walls}
        given = f"head[1], head[2], {p}"
        program.glue(choice("any_law", "head, p", "head[0]", list(laws), given), **laws)
        program.glue(LAW, excursion_by_law=excursion_by_law)
    else:
        motions = {f"motion_{a}": kernels.motion(a) for a in walls}
        given = f"head[1], head[2], dt, {p}"
        motion = choice("any_motion", "head, dt, p", "head[0]", list(motions), given)
        program.glue(motion, **motions)
        program.glue(MOTION, excursions=excursions)
    if variant == "single":
        single = SINGLE.format(p=p)
        program.glue(single, kernel_harmonics=kernels.harmonics, single_zeros=single_zeros)
    else:
        program.glue(GIVEN)


def choice(name: str, arguments: str, chosen: str, functions: Sequence[str], given: str) -> str:
    """The text of a function that calls one of several by number."""
    lines = [f"def {name}({arguments}):"]
    for i, function in enumerate(functions[:-1]):
        lines += [f"    if {chosen} == {i}:", f"        return {function}({given})"]
    return "\n".join([*lines, f"    return {functions[-1]}({given})"])
