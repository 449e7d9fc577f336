r"""The impact damper: a ball that runs free in a container on a driven oscillator.

.. math:: \ddot x + 2\zeta\dot x + x = \cos\Omega t, \qquad \ddot x + \ddot y = 0,

with y the ball's place in the container, of clearance d: abs(y) <= d/2. The ball is mu times as
heavy as the oscillator. An impact reverses y' with restitution r and keeps the momentum
(S. F. Masri, On the stability of the impact damper, J. Appl. Mech. 33, 1966).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..models.model import Example, Formulas, Geometry, Model, Parameter, Symmetry, Wall


class ImpactDamper(Model):
    """An oscillator with an impact damper, in units of its frequency and of the static deflection.

    The coordinates are those of the oscillator, x, and of the ball in the container, y; the mass
    ratio is that of the ball to the oscillator.
    """

    SYSTEM = "impact-damper"
    WALLS = (Wall("R", side=+1, coordinate=1), Wall("L", side=-1, coordinate=1))
    DEGREES_OF_FREEDOM = 2
    GEOMETRY = Geometry(springs=((-1, 0),), contained=((1, 0),))
    PARAMETERS = (
        Parameter("Omega", "", "the forcing frequency", lower=0, above_lower=True),
        Parameter("d", "", "the clearance", lower=0),
        Parameter("r", "", "the restitution coefficient", lower=0, upper=1),
        Parameter("mu", "", "the mass ratio", lower=0),
        Parameter("zeta", "", "the damping ratio"),
    )
    EXAMPLE = Example(
        {"Omega": 1.0, "d": 20.0, "r": 0.8, "mu": 0.1, "zeta": 0.01},
        ("d", 10.0, 40.0),
        ["RL"],
        ("mu", 0.05, 0.2),
    )

    def symmetry(self, parameter: str, harmonics: Sequence[float]) -> Symmetry:
        """Left and right, half a period later."""
        return Symmetry({"R": "L", "L": "R"}, shift=0.5, sign=-1.0)

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """A linear flight of both; the ball's is free."""
        import sympy

        from ..models.linear import Linear

        omega, d, r, mu, zeta = (symbols[name] for name in ("Omega", "d", "r", "mu", "zeta"))
        motion = Linear(
            mass=[[1, 0], [1, 1]],
            damping=[[2 * zeta, 0], [0, 0]],
            stiffness=[[1, 0], [0, 0]],
            force=lambda t: [sympy.cos(omega * t), 0],
            period=2 * sympy.pi / omega,
        )

        def reset(wall: str, x: Sequence[Any], v: Sequence[Any]) -> list[Any]:
            return [v[0] + mu * (1 + r) / (1 + mu) * v[1], -r * v[1]]

        return Formulas(
            period=motion.period,
            walls={"R": d / 2, "L": -d / 2},
            reset=reset,
            flight=motion.flight,
            acceleration=motion.acceleration,
            mass=[[1 + mu, mu], [mu, mu]],
        )
