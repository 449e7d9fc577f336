r"""The linear oscillator with one stop: :math:`\ddot x + c\dot x + kx = a\cos\omega t`, x <= sigma.

Impacts at the stop S reverse the velocity with restitution r. The forcing period is 2 pi/omega.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from ..errors import InputError
from ..models.model import Formulas, Model, Parameter, Wall


class Oscillator(Model):
    """A forced, damped linear oscillator against a stop; any units that fit each other.

    Parameters
    ----------
    a : float
        Forcing amplitude per unit mass.
    omega : float
        Forcing frequency.
    c : float
        Damping per unit mass: below, at or above critical, or negative.
    k : float
        Stiffness per unit mass.
    sigma : float
        Position of the stop.
    r : float
        Restitution, from 0 to 1.
    """

    SYSTEM = "oscillator"
    WALLS = (Wall("S", side=+1),)
    PARAMETERS = (
        Parameter("a", "", "the forcing amplitude"),
        Parameter("omega", "", "the forcing frequency", lower=0, above_lower=True),
        Parameter("c", "", "the damping"),
        Parameter("k", "", "the stiffness", lower=0, above_lower=True),
        Parameter("sigma", "", "the position of the stop"),
        Parameter("r", "", "the restitution coefficient", lower=0, upper=1),
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

        from ..models.symbolic import MeanTransient, Stumpff, Transient

        a, omega, c, k, sigma, r = (symbols[n] for n in ("a", "omega", "c", "k", "sigma", "r"))
        denominator = (k - omega**2) ** 2 + (c * omega) ** 2
        in_phase, quadrature = a * (k - omega**2) / denominator, a * c * omega / denominator

        def steady(t: Any) -> Any:
            return in_phase * sympy.cos(omega * t) + quadrature * sympy.sin(omega * t)

        def steady_rate(t: Any) -> Any:
            return omega * (quadrature * sympy.cos(omega * t) - in_phase * sympy.sin(omega * t))

        def flight(
            t0: Any, x0: Sequence[Any], v0: Sequence[Any], dt: Any
        ) -> tuple[list[Any], list[Any]]:
            # With A, B the free motions from unit displacement and from unit velocity,
            #   x1 - x0 = [p(t1) - p(t0)] + (x0 - p0)(A - 1) + (v0 - p0') B,
            # each bracket divided by dt in closed form. 1 - A is k times the integral of B.
            def motion(kind: Any, n: int) -> Any:
                return kind(sympy.Integer(n), sympy.Integer(1), c, k, dt)

            middle = t0 + dt / 2
            steady_mean = Stumpff(sympy.Integer(1), (omega * dt / 2) ** 2) * steady_rate(middle)
            offset, rate = x0[0] - steady(t0), v0[0] - steady_rate(t0)
            fall = k * dt * motion(MeanTransient, -1)  # (1 - A)/dt
            mean = steady_mean - offset * fall + rate * motion(MeanTransient, 0)
            # A' = -k B
            speed = (
                steady_rate(t0 + dt)
                - offset * k * motion(Transient, 0)
                + rate * motion(Transient, 1)
            )
            return [mean], [speed]

        return Formulas(
            period=2 * sympy.pi / omega,
            walls={"S": sigma},
            reset=lambda wall, x, v: [-r * v[0]],
            flight=flight,
            acceleration=lambda t, x, v: [a * sympy.cos(omega * t) - c * v[0] - k * x[0]],
        )
