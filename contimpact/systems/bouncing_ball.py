r"""A ball on a vibrating table, by its height x above the table.

.. math:: \ddot x = -g + a\omega^2 \sin\omega t, \quad x \ge 0, \quad
          \dot x^+ = -r \dot x^- \text{ at } x = 0.

The table is at :math:`a\sin\omega t`; the forcing period is 2 pi/omega.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from ..models.model import Example, Formulas, Geometry, Model, Parameter, Wall


class BouncingBall(Model):
    """A ball on a vibrating table; any units that fit each other."""

    SYSTEM = "bouncing-ball"
    WALLS = (Wall("P", side=-1),)
    GEOMETRY = Geometry(direction=-math.pi / 2)
    DERIVED = ("Gamma",)
    DERIVED_FROM: ClassVar = {"Gamma": ("a", "omega", "g")}
    PARAMETERS = (
        Parameter("a", "", "the table's amplitude"),
        Parameter("omega", "", "the table's frequency", lower=0, above_lower=True),
        Parameter("r", "", "the restitution coefficient", lower=0, upper=1),
        Parameter("g", "", "gravity", lower=0, above_lower=True),
    )
    EXAMPLE = Example(
        {"a": 0.014, "omega": 50.0, "r": 0.5, "g": 9.8}, ("a", 0.003, 0.02), ["1"], ("r", 0.1, 0.8)
    )

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """Free fall, seen from the table."""
        import sympy

        from ..models.symbolic import harmonic_means

        a, omega, r, g = (symbols[name] for name in ("a", "omega", "r", "g"))
        push = a * omega**2

        def flight(
            t0: Any, x0: Sequence[Any], v0: Sequence[Any], dt: Any
        ) -> tuple[list[Any], list[Any]]:
            once, twice = harmonic_means(0, push, omega, t0, dt)
            return [v0[0] + dt * (twice - g / 2)], [v0[0] + dt * (once - g)]

        return Formulas(
            period=2 * sympy.pi / omega,
            walls={"P": sympy.Integer(0)},
            derived={"Gamma": push / g},
            reset=lambda wall, x, v: [-r * v[0]],
            flight=flight,
            acceleration=lambda t, x, v: [push * sympy.sin(omega * t) - g],
            harmonics=(-g, [(1, 0, push)]),
        )
