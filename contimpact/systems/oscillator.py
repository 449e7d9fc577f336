r"""The linear oscillator with one stop: :math:`\ddot x + c\dot x + kx = a\cos\omega t`, x <= sigma.

Impacts at the stop S reverse the velocity with restitution r. The forcing period is 2 pi/omega.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..errors import InputError
from ..models.model import Example, Formulas, Geometry, Model, Parameter, Wall


class Oscillator(Model):
    """A forced, damped linear oscillator of unit mass against a stop; any units that fit."""

    SYSTEM = "oscillator"
    WALLS = (Wall("S", side=+1),)
    GEOMETRY = Geometry(springs=((-1, 0),))
    PARAMETERS = (
        Parameter("a", "", "the forcing amplitude"),
        Parameter("omega", "", "the forcing frequency", lower=0, above_lower=True),
        Parameter("c", "", "the damping"),
        Parameter("k", "", "the stiffness", lower=0, above_lower=True),
        Parameter("sigma", "", "the position of the stop"),
        Parameter("r", "", "the restitution coefficient", lower=0, upper=1),
    )
    EXAMPLE = Example(
        {"a": 1.0, "omega": 1.0, "c": 0.1, "k": 1.0, "sigma": 1.0, "r": 0.8},
        ("a", 0.05, 1.5),
        ["0", "1"],
        ("sigma", 0.5, 1.5),
    )

    def validate(self) -> None:
        """Refuse undamped resonance."""
        stiffness, omega = self.values["k"], self.values["omega"]
        if self.values["c"] == 0 and math.isclose(stiffness, omega**2, rel_tol=1e-15):
            found = "an undamped oscillator at resonance has no periodic response"
            raise InputError("omega", found, "give c != 0 or omega^2 != k")

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """Steady response plus a transient, for any damping."""
        import sympy

        from ..models.symbolic import driven_oscillator

        a, omega, c, k, sigma, r = (symbols[n] for n in ("a", "omega", "c", "k", "sigma", "r"))
        flight, acceleration = driven_oscillator([(omega, a, 0)], c, k)
        return Formulas(
            period=2 * sympy.pi / omega,
            walls={"S": sigma},
            reset=lambda wall, x, v: [-r * v[0]],
            flight=flight,
            acceleration=acceleration,
        )
