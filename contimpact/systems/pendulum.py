r"""The driven pendulum with a stop: :math:`\ddot x + c\dot x + \sin x = a\cos\omega t`, x <= sigma.

Impacts at the stop S reverse the angular velocity with restitution r. Time is measured such that
small free oscillations have the frequency 1. The forcing period is 2 pi/omega.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..models.model import Example, Formulas, Geometry, Model, Parameter, Wall


class Pendulum(Model):
    """A driven, damped pendulum against a stop; angles in radians: pi is upright.

    Its flights are integrated, which takes the extra ``ode``.
    """

    SYSTEM = "pendulum"
    WALLS = (Wall("S", side=+1),)
    GEOMETRY = Geometry(turning=True)
    PARAMETERS = (
        Parameter("a", "", "the driving amplitude"),
        Parameter("omega", "", "the driving frequency", lower=0, above_lower=True),
        Parameter("c", "", "the damping"),
        Parameter("sigma", "rad", "the angle of the stop"),
        Parameter("r", "", "the restitution coefficient", lower=0, upper=1),
    )
    EXAMPLE = Example(
        {"a": 1.0, "omega": 0.8, "c": 0.1, "sigma": 1.0, "r": 0.8},
        ("omega", 0.55, 1.0),
        ["1"],
        ("sigma", 0.8, 1.2),
    )

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """A flight that is integrated."""
        import sympy

        from ..models.nonlinear import Nonlinear

        a, omega, c, sigma, r = (symbols[n] for n in ("a", "omega", "c", "sigma", "r"))
        motion = Nonlinear(lambda t, x, v: [a * sympy.cos(omega * t) - c * v[0] - sympy.sin(x[0])])
        return Formulas(
            period=2 * sympy.pi / omega,
            walls={"S": sigma},
            reset=lambda wall, x, v: [-r * v[0]],
            flight=motion.flight,
            acceleration=motion.acceleration,
        )
