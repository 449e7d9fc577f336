r"""Two oscillators that meet nothing but each other: Fig. 1(d) of the paper.

.. math:: m_i\ddot x_i + c_i\dot x_i + k_i x_i = a_i\cos\omega t, \qquad i = 1, 2,

with x_1 - x_2 <= gap (impact K). An impact reverses the relative velocity with restitution r and
keeps the momentum.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..models.model import Example, Formulas, Geometry, Model, Parameter, Wall


class CoupledByImpact(Model):
    """Two forced, damped oscillators that hit each other; any units that fit each other."""

    SYSTEM = "coupled-by-impact"
    WALLS = (Wall("K", side=+1, coordinate=(1, -1)),)
    DEGREES_OF_FREEDOM = 2
    GEOMETRY = Geometry(springs=((-1, 0), (1, 2)))
    PARAMETERS = (
        Parameter("m1", "", "the first mass", 1.0, lower=0, above_lower=True),
        Parameter("m2", "", "the second mass", 1.0, lower=0, above_lower=True),
        Parameter("c1", "", "the first damping"),
        Parameter("c2", "", "the second damping"),
        Parameter("k1", "", "the first stiffness"),
        Parameter("k2", "", "the second stiffness"),
        Parameter("a1", "", "the force on the first mass"),
        Parameter("a2", "", "the force on the second mass", 0.0),
        Parameter("omega", "", "the forcing frequency", lower=0, above_lower=True),
        Parameter("gap", "", "the gap at rest"),
        Parameter("r", "", "the restitution coefficient", lower=0, upper=1),
    )
    EXAMPLE = Example(
        {"m2": 2.0, "c1": 0.1, "c2": 0.2, "k1": 1.0, "k2": 2.0, "a1": 1.0, "omega": 1.3}
        | {"gap": 0.2, "r": 0.7},
        ("omega", 0.85, 1.5),
        ["K"],
        ("gap", 0.1, 0.4),
    )

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """Linear flights, each mass by itself."""
        import sympy

        from ..models.linear import Linear

        p = symbols
        omega, m1, m2 = p["omega"], p["m1"], p["m2"]
        motion = Linear(
            mass=[[m1, 0], [0, m2]],
            damping=[[p["c1"], 0], [0, p["c2"]]],
            stiffness=[[p["k1"], 0], [0, p["k2"]]],
            force=lambda t: [p["a1"] * sympy.cos(omega * t), p["a2"] * sympy.cos(omega * t)],
            period=2 * sympy.pi / omega,
        )

        def reset(wall: str, x: Sequence[Any], v: Sequence[Any]) -> list[Any]:
            exchanged = (1 + p["r"]) * (v[0] - v[1]) / (m1 + m2)
            return [v[0] - m2 * exchanged, v[1] + m1 * exchanged]

        return Formulas(
            period=motion.period,
            walls={"K": p["gap"]},
            reset=reset,
            flight=motion.flight,
            acceleration=motion.acceleration,
            mass=[[m1, 0], [0, m2]],
        )
