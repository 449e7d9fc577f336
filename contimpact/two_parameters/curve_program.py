"""The program that takes steps along curves of one kind for any word of a model, for compiling."""

from __future__ import annotations

from collections.abc import Callable

from ..continuation.step import take_steps
from ..orbit_continuation.orbit_program import choice
from ..segments.kernels import Kernels
from ..segments.machine_code import Program
from .curve_functions import (
    CurveVectors,
    evaluate_singular,
    evaluate_touching,
    newton_step,
    observe_curve,
    tangent_of_curve,
)

ENTRY = """
def entry({fields}, options, state, scale, z, tangent, chord, work, rows):
    curve = CurveVectors({fields})
    vectors = (options, state, scale, z, tangent, chord, work, rows)
    return take_steps(evaluate, newton_step, tangent_of_curve, observe_curve, curve, vectors)

def any_setup(p):
    return kernel_setup({p})
"""

EVALUATE = {
    "singular": """
def evaluate(curve, z):
    return evaluate_singular(any_flight, any_second, any_setup, curve, z)
""",
    "touching": """
def evaluate(curve, z):
    return evaluate_touching(any_flight, any_setup, curve, z)
""",
}


def program_of(kernels: Kernels, variant: str) -> Program:
    """Return the program that takes steps along curves of any word of a model.

    Parameters
    ----------
    kernels : Kernels
        With both parameters free.
    variant : str
        The equations: "singular" for FB and PD, "touching" for G.
    """
    program = Program({})
    p = ", ".join(f"p[{i}]" for i in range(len(kernels.model.values)))
    walls = kernels.model.letters
    pairs = [(a, b) for a in walls for b in walls]
    flights = {f"flight_{a}_{b}": kernels.flight(a, b) for a, b in pairs}
    ends = "t0, v0, t1, v1"
    chosen = choice("any_flight", f"kind, {ends}, p", "kind", list(flights), f"{ends}, {p}")
    program.glue(chosen, **flights)
    called: list[Callable[..., object]] = [take_steps, newton_step, tangent_of_curve, observe_curve]
    if variant == "singular":
        along = f"{ends}, q0, q1, q2, q3"
        seconds = {f"second_{a}_{b}": kernels.second(a, b) for a, b in pairs}
        text = choice(
            "any_second", f"kind, {along}, p", "kind", list(seconds), f"{along}, 0.0, 0.0, {p}"
        )
        program.glue(text, **seconds)
        called.append(evaluate_singular)
    else:
        called.append(evaluate_touching)
    program.constant("CurveVectors", CurveVectors)
    named = {function.__name__: function for function in called}
    text = EVALUATE[variant] + ENTRY.format(fields=", ".join(CurveVectors._fields), p=p)
    program.glue(text, kernel_setup=kernels.setup, **named)
    return program
