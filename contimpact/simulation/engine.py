"""The loop of a simulation as a compiled program, and when that is loaded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import INTEGERS, VECTOR, Array
from ..segments.arithmetic import Kernel
from ..segments.compiling import CompiledProgram, load, mode, spend
from .body import Body
from .flights import fly_in_time
from .impacts import make_impacts

if TYPE_CHECKING:
    from ..segments.machine_code import Program

WORTH = 2000
"""Impacts, in one run or made so far by plain Python, from which compiled code is worth loading."""
PRICE = 3
"""Evaluations of a flight that one impact in plain Python counts for."""

BODY = VECTOR * 3 + INTEGERS * 4 + VECTOR * 5 + INTEGERS * 3
"""Kinds of a body's fields."""
ROW = INTEGERS * 2 + VECTOR * 2 + INTEGERS
"""Kinds of the columns that `make_impacts` fills."""
ARGUMENTS = BODY + INTEGERS + VECTOR + ROW + INTEGERS
"""Kinds of the entry's arguments, in its order: a body's fields, then those of `make_impacts`."""

ENTRY = """
def fly(body, wall, phase, velocity):
    return fly_in_time(any_motion, body, wall, phase, velocity)

def entry(
    values, clock, zeros, sides, leaving, below, above, low, high, restitution, slow, edges,
    presses, first, longest, state, when, walls, turns, phases, velocities, released, span,
):
    body = Body(
        values, clock, zeros, sides, leaving, below, above, low, high, restitution, slow, edges,
        presses, first, longest
    )
    return make_impacts(
        fly, any_motion, body, state, when, walls, turns, phases, velocities, released, span
    )
"""

DTYPES = {INTEGERS: np.int64, VECTOR: np.float64}


def array(numbers: Sequence[float], kind: str) -> Array:
    """Return a vector for compiled code."""
    return np.array(numbers, dtype=DTYPES[kind])


class Engine:
    """Compiled code for all simulators with the same motions.

    Parameters
    ----------
    motions : sequence of Kernel
        After each wall.
    """

    def __init__(self, motions: Sequence[Kernel]) -> None:
        self.motions = motions
        self.found: CompiledProgram | None = None
        self.plain = 0

    def program(self, asked: int) -> CompiledProgram | None:
        """Return the compiled program if there is one and the work is worth loading it.

        Parameters
        ----------
        asked : int
            Impacts of the run.
        """
        chosen = mode()
        if chosen == "never":
            return None
        if self.found is None and (chosen == "always" or asked + self.plain >= WORTH):
            self.plain = 0
            identity = ("simulate", *formulas(self.motions))
            self.found = load(identity, ARGUMENTS, lambda: program_of(self.motions))
        return self.found

    def count_plain(self, impacts: int) -> None:
        """Count impacts that were made by plain Python."""
        self.plain += impacts
        spend(PRICE * impacts)


_ENGINES: dict[tuple[str, ...], Engine] = {}


def engine_of(motions: Sequence[Kernel]) -> Engine:
    """Return the engine for these motions; simulators of the same formulas share it."""
    return _ENGINES.setdefault(formulas(motions), Engine(motions))


def formulas(motions: Sequence[Kernel]) -> tuple[str, ...]:
    """Return the kernels' texts without their heads, which name the free parameters."""
    texts = (motion.source for motion in motions)
    return tuple(text[text.index("def ") :] for text in texts)


def program_of(motions: Sequence[Kernel]) -> Program:
    """Return the program that simulates from impact to impact."""
    from ..segments.machine_code import Program

    program = Program({})
    names = {f"motion_{wall}": motion for wall, motion in enumerate(motions)}
    given = ", ".join(f"p[{i}]" for i in range(motions[0].__code__.co_argcount - 3))
    lines = ["def any_motion(head, dt, p):"]
    for wall, name in enumerate(names):
        condition = f"if head[0] == {wall}: " if wall + 1 < len(names) else ""
        lines.append(f"    {condition}return {name}(head[1], head[2], dt, {given})")
    program.glue("\n".join(lines), **names)
    program.constant("Body", Body)
    program.glue(ENTRY, fly_in_time=fly_in_time, make_impacts=make_impacts)
    return program
