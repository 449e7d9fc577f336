r"""Van der Pol's oscillator against a stop: it oscillates by itself.

.. math:: \ddot x - \varepsilon (1 - x^2)\dot x + x = 0, \qquad x \le \sigma .

Impacts at the stop S reverse the velocity with restitution r. There is no forcing: the periods of
orbits are unknowns. Small oscillations have the period 2 pi.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..models.model import Example, Formulas, Geometry, Model, Parameter, Wall


class VanDerPol(Model):
    """Van der Pol's oscillator against a stop, in units of its frequency.

    Its flights are integrated, which takes the extra ``ode``.
    """

    SYSTEM = "van-der-pol"
    AUTONOMOUS = True
    WALLS = (Wall("S", side=+1),)
    GEOMETRY = Geometry(springs=((-1, 0),))
    PARAMETERS = (
        Parameter("epsilon", "", "the strength of the excitation"),
        Parameter("sigma", "", "the position of the stop"),
        Parameter("r", "", "the restitution coefficient", lower=0, upper=1),
    )
    EXAMPLE = Example(
        {"epsilon": 1.0, "sigma": 1.5, "r": 0.8}, ("sigma", 1.0, 2.2), ["S"], ("epsilon", 0.5, 2.0)
    )

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """A flight that is integrated."""
        import sympy

        from ..models.nonlinear import Nonlinear

        epsilon, sigma, r = (symbols[p.name] for p in self.PARAMETERS)
        motion = Nonlinear(lambda t, x, v: [epsilon * (1 - x[0] ** 2) * v[0] - x[0]])
        return Formulas(
            period=2 * sympy.pi,
            walls={"S": sigma},
            reset=lambda wall, x, v: [-r * v[0]],
            flight=motion.flight,
            acceleration=motion.acceleration,
        )
