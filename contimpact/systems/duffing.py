r"""The impacting Duffing oscillator: its flights are integrated.

.. math:: \ddot x + c\dot x + \alpha x + \beta x^3 = a\cos\omega t, \qquad x \le \sigma .

Impacts at the stop S reverse the velocity with restitution r. The spring hardens for beta > 0 and
softens for beta < 0; with alpha < 0 < beta there are two wells. The forcing period is 2 pi/omega.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..models.model import Example, Formulas, Geometry, Model, Parameter, Wall


class Duffing(Model):
    """A forced, damped Duffing oscillator of unit mass against a stop; any units that fit.

    Its flights are integrated, which takes the extra ``ode``.
    """

    SYSTEM = "duffing"
    WALLS = (Wall("S", side=+1),)
    GEOMETRY = Geometry(springs=((-1, 0),))
    PARAMETERS = (
        Parameter("a", "", "the forcing amplitude"),
        Parameter("omega", "", "the forcing frequency", lower=0, above_lower=True),
        Parameter("c", "", "the damping"),
        Parameter("alpha", "", "the linear stiffness", 1.0),
        Parameter("beta", "", "the cubic stiffness"),
        Parameter("sigma", "", "the position of the stop"),
        Parameter("r", "", "the restitution coefficient", lower=0, upper=1),
    )
    EXAMPLE = Example(
        {"a": 0.5, "omega": 1.4, "c": 0.1, "alpha": 1.0, "beta": 1.0, "sigma": 0.8, "r": 0.8},
        ("omega", 0.8, 2.5),
        ["0", "1"],
        ("sigma", 0.6, 1.0),
    )

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """A flight that is integrated."""
        import sympy

        from ..models.nonlinear import Nonlinear

        a, omega, c, alpha, beta, sigma, r = (symbols[p.name] for p in self.PARAMETERS)
        motion = Nonlinear(
            lambda t, x, v: [a * sympy.cos(omega * t) - c * v[0] - alpha * x[0] - beta * x[0] ** 3]
        )
        return Formulas(
            period=2 * sympy.pi / omega,
            walls={"S": sigma},
            reset=lambda wall, x, v: [-r * v[0]],
            flight=motion.flight,
            acceleration=motion.acceleration,
        )
