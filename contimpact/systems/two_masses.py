r"""Two masses in a row, each against a stop: Fig. 1(c) of the paper.

.. math:: m_1\ddot x_1 + c_1\dot x_1 + c_2(\dot x_1 - \dot x_2) + k_1 x_1 + k_2(x_1 - x_2)
          = a_1\cos\omega t, \qquad
          m_2\ddot x_2 + c_2(\dot x_2 - \dot x_1) + k_2(x_2 - x_1) = a_2\cos\omega t,

with x_1 <= sigma_1 (stop A) and x_2 <= sigma_2 (stop B). An impact multiplies the velocity of the
mass that hits by -r.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..models.model import Example, Formulas, Geometry, Model, Parameter, Wall


class TwoMasses(Model):
    """Two forced, damped masses, coupled by a spring, with a stop each; any units that fit."""

    SYSTEM = "two-masses"
    WALLS = (Wall("A", side=+1, coordinate=0), Wall("B", side=+1, coordinate=1))
    DEGREES_OF_FREEDOM = 2
    GEOMETRY = Geometry(springs=((-1, 0), (0, 1)))
    PARAMETERS = (
        Parameter("m1", "", "the first mass", 1.0, lower=0, above_lower=True),
        Parameter("m2", "", "the second mass", 1.0, lower=0, above_lower=True),
        Parameter("c1", "", "the damping between first mass and ground"),
        Parameter("c2", "", "the damping between the masses"),
        Parameter("k1", "", "the stiffness between first mass and ground"),
        Parameter("k2", "", "the stiffness between the masses"),
        Parameter("a1", "", "the force on the first mass"),
        Parameter("a2", "", "the force on the second mass", 0.0),
        Parameter("omega", "", "the forcing frequency", lower=0, above_lower=True),
        Parameter("sigma_1", "", "the position of the first mass's stop"),
        Parameter("sigma_2", "", "the position of the second mass's stop"),
        Parameter("r", "", "the restitution", lower=0, upper=1, split=("r_A", "r_B")),
    )
    EXAMPLE = Example(
        {"c1": 0.1, "c2": 0.05, "k1": 1.0, "k2": 0.6, "a1": 1.0, "omega": 1.8}
        | {"sigma_1": 1.0, "sigma_2": 1.0, "r": 0.8},
        ("omega", 0.9, 2.0),
        ["A"],
        ("sigma_1", 0.5, 1.5),
    )

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """Linear flights of both masses."""
        import sympy

        from ..models.linear import Linear

        p = symbols
        c1, c2, k1, k2 = (p[name] for name in ("c1", "c2", "k1", "k2"))
        wave = p["omega"]
        motion = Linear(
            mass=[[p["m1"], 0], [0, p["m2"]]],
            damping=[[c1 + c2, -c2], [-c2, c2]],
            stiffness=[[k1 + k2, -k2], [-k2, k2]],
            force=lambda t: [p["a1"] * sympy.cos(wave * t), p["a2"] * sympy.cos(wave * t)],
            period=2 * sympy.pi / wave,
        )

        def reset(wall: str, x: Sequence[Any], v: Sequence[Any]) -> list[Any]:
            restitution = p.get("r", p.get(f"r_{wall}"))
            return [-restitution * v[0], v[1]] if wall == "A" else [v[0], -restitution * v[1]]

        return Formulas(
            period=motion.period,
            walls={"A": p["sigma_1"], "B": p["sigma_2"]},
            reset=reset,
            flight=motion.flight,
            acceleration=motion.acceleration,
            mass=[[p["m1"], 0], [0, p["m2"]]],
        )
