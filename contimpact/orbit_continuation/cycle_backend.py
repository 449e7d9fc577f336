"""The backend for orbits with one degree of freedom: many steps at a time, plain or compiled."""

from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import ARRAYS, Array, Containers, Vector
from ..bifurcations.extended_system import ManyOrbits
from ..continuation.branch import Block
from ..continuation.step import columns
from ..orbits.block_cyclic import BLOCK, KEPT
from ..orbits.problem import OrbitProblem
from ..segments.flight import excursion_of, time_zeros
from ..segments.layout import Setup
from ..segments.oscillation import MOST, ROW
from .orbit_backend import TOO_STIFF, Functions, OrbitBackend
from .orbit_functions import (
    DESCRIBED,
    DETERMINANT,
    MEASURED,
    PRODUCT,
    SPAN,
    OrbitVectors,
    evaluate_cycle,
    newton_step,
    observe_cycle,
    tangent_of_cycle,
)

if TYPE_CHECKING:
    from ..segments.machine_code import Program


class CycleBackend(OrbitBackend[OrbitVectors]):
    """See `OrbitBackend`; for problems with one degree of freedom."""

    ARGUMENTS = "iiiii" + "ffff" + "FFFF" + "fF" + "ffff" + "ff" + "ffff" + "FF"

    @functools.cached_property
    def zeros(self) -> list[float] | None:
        """Of the acceleration, where they are the same along the branch."""
        harmonics = self.problem.kernels.harmonics(*self.problem.model.values.values())
        return time_zeros(harmonics, self.setup.period)

    @functools.cached_property
    def functions(self) -> Functions[OrbitVectors]:
        return plain_functions(self.problem, self.zeros)

    @functools.cached_property
    def described(self) -> int:
        return MEASURED

    def vectors(self, made_by: Containers) -> OrbitVectors:
        vector, table = made_by
        return OrbitVectors(
            **self.common(made_by),
            zeros=vector([0.0] * 2 if self.variant == "single" else self.zeros or []),
            blocks=table(self.count, BLOCK),
            kept=table(self.count, KEPT),
            reduced=table(1, KEPT),
            steps=table(0, ROW),
        )

    @functools.cached_property
    def obstacle(self) -> str:
        """Why there is no compiled code."""
        if self.zeros is None:
            return TOO_STIFF
        return "a forcing whose harmonics change along a branch"

    def block(self, rows: Array) -> Block:
        unknowns, tangents, signs, places, tries, seen = columns(rows, self.problem.n + 1)
        gaps = MEASURED + self.count * self.walls
        turns = gaps + self.count
        cycle = seen[:, SPAN], seen[:, DETERMINANT], seen[:, PRODUCT, None]
        nearest = seen[:, MEASURED:gaps].reshape(-1, self.count, self.walls)
        points, flights = (unknowns, tangents, signs), (nearest, seen[:, gaps:turns])
        measured = ManyOrbits(*points, *cycle, *flights, seen[:, turns:])
        described, made = seen[:, :DESCRIBED].copy(), self.problem.described
        return Block(*points, places, tries, described, made, measured=measured)

    @functools.cached_property
    def arrays(self) -> OrbitVectors:
        given = self.vectors(ARRAYS)
        if self.space:
            given = given._replace(values=np.append(given.values, np.zeros(self.space)))
        if self.variant == "law":
            given = given._replace(steps=np.zeros((MOST, ROW)), zeros=np.zeros(2 * MOST))
        return given

    @functools.cached_property
    def variant(self) -> str | None:
        """How compiled code finds the zeros of the acceleration; None where it cannot."""
        kernels, values = self.problem.kernels, self.problem.model.values.values()
        harmonics = kernels.harmonics(*values)
        if math.isnan(harmonics[0]):
            return "law" if kernels.oscillates else None
        if not kernels.depends("harmonics"):
            return "fixed"
        return "single" if len(harmonics) == 4 and harmonics[1] == 1 else None

    def written(self) -> Program:
        from .orbit_program import program_of

        assert self.variant is not None
        return program_of(self.problem.kernels, self.variant)


def plain_functions(problem: OrbitProblem, fixed: list[float] | None) -> Functions[OrbitVectors]:
    """Return what `take_steps` needs of a problem: evaluate, solve, tangent_at and observe.

    `fixed` are the zeros of the acceleration, where they are the same along the branch.
    """
    kernels = problem.kernels
    in_time = not math.isnan(kernels.harmonics(*problem.model.values.values())[0])
    flight, excursion = kernels.flights, excursion_of(kernels, in_time)
    moving = kernels.depends("harmonics")

    def setup(values: Vector) -> Setup:
        return kernels.setup(*values)

    def evaluate(orbit: OrbitVectors, z: Vector) -> float:
        try:
            return evaluate_cycle(flight, setup, orbit, z)
        except (ArithmeticError, ValueError):
            return math.nan

    def breaks(values: Vector, period: float, zeros: Vector) -> list[float] | None:
        return time_zeros(kernels.harmonics(*values), period) if moving else fixed

    def observe(
        orbit: OrbitVectors, z: Vector, tangent: Vector, sign: float, row: Vector, at: int
    ) -> None:
        observe_cycle(breaks, excursion, orbit, z, row, at)

    return evaluate, newton_step, tangent_of_cycle, observe
