"""NS: a complex pair of multipliers crosses the unit circle (Neimark and Sacker); a torus is born.

The test function is the product of the pair minus one, without poles; located by bracketing.
"""

from __future__ import annotations

import numpy as np

from ..continuation.branch import Event
from ..continuation.test_function import TestFunction
from ..orbits.multipliers import neimark_sacker
from ..orbits.problem import Array, OrbitProblem
from .kind import Change, Details, Kind, Look, ManyDigits, System, Values
from .orbit_test import Orbits, OrbitTest


class NeimarkSacker(OrbitTest):
    """The product of two multipliers minus one."""

    kind = "NS"
    noise = 1e-9  # without damping and losses the product is one everywhere, within rounding

    def of(self, orbits: Orbits) -> Array:
        return neimark_sacker(orbits.products)[:, None]

    def accept(self, event: Event) -> bool:
        """Two real multipliers with the product one are a neutral saddle."""
        multipliers = event.point.evaluation.multipliers
        on_circle = np.abs(np.abs(multipliers) - 1.0) < 1e-6
        return bool(np.any(on_circle & (np.abs(multipliers.imag) > 1e-8)))


class NS(Kind):
    """Neimark-Sacker bifurcation."""

    name = NeimarkSacker.kind
    changes = Change.STABILITY
    auto = 8
    look = Look("*")

    def test(self, problem: OrbitProblem, values: Values) -> TestFunction:
        return NeimarkSacker()

    def in_many_digits(self, orbit: ManyDigits, unknowns: Array, details: Details) -> System:
        return orbit.vanishing(lambda x: orbit.product(x) - 1)

    def passed(self, multiplier: float | None) -> bool:
        return multiplier is None

    def critical(self, multipliers: Array) -> list[int]:
        return np.argsort(np.abs(np.abs(multipliers) - 1.0))[:2].tolist()
