r"""A linear oscillator between two stops: :math:`\ddot x + c\dot x + kx = a\cos\omega t + b`.

The stops are at -sigma_L and sigma_R. Without a spring it is a mass that rattles between them, as
the teeth of loaded gears do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..models.model import Example, Formulas, Geometry, Model, Parameter, Symmetry, Wall


class TwoStops(Model):
    """A forced, damped linear oscillator of unit mass between stops; any units that fit each other.

    The stops are at sigma_R and -sigma_L; the stiffness may be zero.
    """

    SYSTEM = "two-stops"
    WALLS = (Wall("R", side=+1), Wall("L", side=-1))
    GEOMETRY = Geometry(springs=((-1, 0),))
    PARAMETERS = (
        Parameter("a", "", "the forcing amplitude"),
        Parameter("b", "", "the constant force", 0.0),
        Parameter("omega", "", "the forcing frequency", lower=0, above_lower=True),
        Parameter("c", "", "the damping"),
        Parameter("k", "", "the stiffness"),
        Parameter("sigma", "", "the distance of a stop", split=("sigma_R", "sigma_L")),
        Parameter("r", "", "the restitution", lower=0, upper=1, split=("r_R", "r_L")),
    )
    EXAMPLE = Example(
        {"a": 1.0, "omega": 1.7, "c": 0.1, "k": 0.0, "sigma": 0.5, "r": 0.7},
        ("sigma", 0.1, 0.6),
        ["RL"],
        ("r", 0.4, 0.9),
    )

    def symmetry(self, parameter: str, harmonics: Sequence[float]) -> Symmetry | None:
        """Left and right, half a period later, unless something tells them apart."""
        both = self._own("sigma"), self._own("r")
        alike = all(len({self.values[name] for name in names}) == 1 for names in both)
        varied = ("b", *(name for names in both if len(names) > 1 for name in names))
        if not alike or self.values["b"] != 0 or parameter in varied:
            return None
        return Symmetry({"R": "L", "L": "R"}, shift=0.5, sign=-1.0)

    def _own(self, name: str) -> list[str]:
        """A parameter, or those given instead of it."""
        return [n for n in self.values if n == name or n.startswith(f"{name}_")]

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """A linear flight, at resonance too."""
        import sympy

        from ..models.linear import Linear

        a, b, omega, c, k = (symbols[name] for name in ("a", "b", "omega", "c", "k"))
        motion = Linear(
            mass=[[1]],
            damping=[[c]],
            stiffness=[[k]],
            force=lambda t: [a * sympy.cos(omega * t) + b],
            period=2 * sympy.pi / omega,
        )

        def of(name: str, wall: str) -> Any:
            return symbols.get(name, symbols.get(f"{name}_{wall}"))

        return Formulas(
            period=motion.period,
            walls={"R": of("sigma", "R"), "L": -of("sigma", "L")},
            reset=lambda wall, x, v: [-of("r", wall) * v[0]],
            flight=motion.flight,
            acceleration=motion.acceleration,
        )
