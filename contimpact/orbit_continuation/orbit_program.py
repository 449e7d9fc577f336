"""The program that takes steps along a branch of any word of a model, for compiling."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..compiling.program import Program
from ..continuation.step import take_steps
from ..orbits.block_cyclic import store, store_compiled
from ..segments.flight import excursions
from ..segments.kernels import Kernels
from ..segments.zeros import single_zeros
from .orbit_functions import (
    OrbitVectors,
    evaluate_cycle,
    newton_step,
    observe_cycle,
    tangent_of_cycle,
)

ENTRY = """
def entry(
    kinds, word, arrivals, watched, counts, values, sides, leaving, zeros, blocks, kept, reduced,
    fixed, clock, durations, gaps, times, velocities, options, state, scale, z, tangent, chord,
    work, rows, size,
):
    orbit = OrbitVectors(
        kinds, word, arrivals, watched, counts, values, sides, leaving, zeros, blocks, kept,
        reduced, fixed, clock, durations, gaps, times, velocities,
    )
    return take_steps(
        evaluate, newton_step, tangent_of_cycle, observe, orbit, options, state, scale, z, tangent,
        chord, work, rows, size[0], size[1],
    )

def any_setup(p):
    return kernel_setup({p})

def evaluate(orbit, z):
    return evaluate_cycle(any_flight, any_setup, orbit, z)

def excursion(head, values, length, arriving, left_side, reached_side, zeros, phase, period):
    return excursions(
        any_motion, head, values, length, arriving, left_side, reached_side, zeros, phase, period
    )

def observe(orbit, z, tangent, orientation, rows, at):
    return observe_cycle(breaks, excursion, orbit, z, tangent, orientation, rows, at)
"""


BREAKS = {
    "fixed": """
def breaks(values, period, zeros):
    return zeros
""",
    "single": """
def breaks(p, period, zeros):
    mean, order, a, b = kernel_harmonics({p})
    return zeros[:single_zeros(mean, a, b, period, zeros)]
""",
}


def program_of(kernels: Kernels, variant: str) -> Program:
    """Return the program that takes steps along a branch of any word of a model.

    `variant` says how the zeros of the acceleration are found: they are "fixed" along the branch,
    or those of a "single" harmonic that changes along it.
    """
    program = Program({store: store_compiled})
    p = ", ".join(f"p[{i}]" for i in range(len(kernels.model.values)))
    walls = [wall.name for wall in kernels.model.WALLS]
    flights = {f"flight_{a}_{b}": kernels.flight(a, b) for a in walls for b in walls}
    motions = {f"motion_{a}": kernels.motion(a) for a in walls}
    ends, state = f"t0, v0, t1, v1, {p}", f"head[1], head[2], dt, {p}"
    flight = _choice("any_flight", "kind, t0, v0, t1, v1, p", "kind", list(flights), ends)
    program.glue(flight, **flights)
    motion = _choice("any_motion", "head, dt, p", "head[0]", list(motions), state)
    program.glue(motion, **motions)
    program.constant("OrbitVectors", OrbitVectors)
    found: dict[str, Any] = {}
    if variant == "single":
        found = {"kernel_harmonics": kernels.harmonics, "single_zeros": single_zeros}
    program.glue(BREAKS[variant].format(p=p), **found)
    called = (take_steps, newton_step, tangent_of_cycle, evaluate_cycle, observe_cycle, excursions)
    named = {function.__name__: function for function in called}
    program.glue(ENTRY.format(p=p), kernel_setup=kernels.setup, **named)
    return program


def _choice(name: str, arguments: str, chosen: str, functions: Sequence[str], given: str) -> str:
    """The text of a function that calls one of several by number."""
    lines = [f"def {name}({arguments}):"]
    for i, function in enumerate(functions[:-1]):
        lines += [f"    if {chosen} == {i}:", f"        return {function}({given})"]
    return "\n".join([*lines, f"    return {functions[-1]}({given})"])
