r"""The inclined impact pair: a ball flying between the two ends of a forced capsule.

.. math:: \ddot Z = f(t) + \bar g, \quad |Z| \le d/2, \quad
          \dot Z^+ = -r \dot Z^- \text{ at } Z = \pm d/2,

with the bottom B at Z = +d/2, the top T at Z = -d/2, forcing period 2,
:math:`d = M\omega^2 s/(A\pi^2)` and :math:`\bar g = M g \sin\beta / A`. Equations (4)-(6) of the
paper on vibro-impact pairs, with the signs under which its captions hold.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from ..models.model import (
    Example,
    Formulas,
    Geometry,
    Guard,
    Model,
    Parameter,
    Symmetry,
    Wall,
    mean_depends,
)

State = Sequence[Any]
"""Positions or velocities, one for each degree of freedom."""


class ImpactPair(Model):
    """A ball in an inclined, shaken capsule; times in half forcing periods, speeds dimensionless.

    Parameters
    ----------
    beta : float
        Inclination, rad.
    r, or r_B and r_T : float
        Restitution at both ends, or at the bottom and the top, from 0 to 1.
    A : float
        Forcing amplitude, N.
    s : float
        Capsule length, m.
    M : float, default 0.1245
        Capsule mass, kg.
    omega : float, default 5 pi
        Forcing frequency, rad/s.
    g : float, default 9.8
        Gravity, m/s^2.
    forcing : str, default ``"cos(pi*t)"``
        f(t), of period 2. Any name in it that is given a value, too, is a parameter.
    """

    SYSTEM = "impact-pair"
    WALLS: ClassVar[tuple[Guard, ...]] = (Wall("B", side=+1), Wall("T", side=-1))
    DERIVED = ("d", "gbar")
    DERIVED_UNITS: ClassVar = {"d": "dimensionless", "gbar": "dimensionless"}
    DERIVED_FROM: ClassVar = {"d": ("A", "s", "M", "omega"), "gbar": ("beta", "A", "M", "g")}
    MEMBRANES = True
    GEOMETRY: ClassVar[Geometry | None] = Geometry(direction="beta", contained=((0, -1),))
    OPTIONS: ClassVar = {"forcing": "cos(pi*t)"}
    EXPRESSIONS: ClassVar = {"forcing": ("t",)}
    PARAMETRIC = ("forcing",)
    PARAMETERS: ClassVar[tuple[Parameter, ...]] = (
        Parameter("beta", "rad", "the inclination", lower=-math.pi / 2, upper=math.pi / 2),
        Parameter("r", "", "the restitution coefficient", lower=0, upper=1, split=("r_B", "r_T")),
        Parameter("A", "N", "the forcing amplitude", lower=0, above_lower=True),
        Parameter("s", "m", "the capsule length", lower=0, above_lower=True),
        Parameter("M", "kg", "the capsule mass", 0.1245, lower=0, above_lower=True),
        Parameter("omega", "rad/s", "the forcing frequency", 5 * math.pi, 0.0, above_lower=True),
        Parameter("g", "m/s^2", "gravity", 9.8, lower=0),
    )
    EXAMPLE = Example(
        {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.34},
        ("s", 0.2, 0.6),
        ["1:1", "2:1"],
        ("r", 0.1, 0.8),
        plot=('x = "d"', "the dimensionless length"),
    )

    def symmetry(self, parameter: str, harmonics: Sequence[float]) -> Symmetry | None:
        """The ends exchanged half a period later: level capsule, equal ends, odd harmonics only."""
        mean, orders = harmonics[0], harmonics[1::3]
        broken_by = {"beta", "r_B", "r_T"} | ({"g"} if self.values["beta"] != 0 else set())
        equal = "r" in self.values or self.values["r_B"] == self.values["r_T"]
        own = {name: self.values[name] for name in self.own}
        if parameter in own and mean_depends(self.options["forcing"], own, parameter, 2.0):
            return None
        if mean == 0 and equal and all(k % 2 for k in orders) and parameter not in broken_by:
            return Symmetry({"B": "T", "T": "B"}, shift=0.5, sign=-1.0)
        return None

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """Return equations (6)-(8): flight under gravity and a sum of harmonics."""
        import sympy

        from ..models.symbolic import fourier_series, harmonic_means, over_harmonics

        beta, amplitude, s, mass, omega, g = (
            symbols[name] for name in ("beta", "A", "s", "M", "omega", "g")
        )
        restitution = {
            wall.name: symbols.get("r", symbols.get(f"r_{wall.name}")) for wall in self.WALLS
        }
        period = sympy.Integer(2)
        own = {name: symbols[name] for name in self.own}
        mean, harmonics = fourier_series(self.options["forcing"], "forcing", period, own)
        length = mass * omega**2 * s / (amplitude * sympy.pi**2)
        gravity = mass * g * sympy.sin(beta) / amplitude
        constant = gravity + mean

        def reset(wall: str, x: State, v: State) -> list[Any]:
            return [-restitution[wall] * v[0]]

        def flight(t0: Any, x0: State, v0: State, dt: Any) -> tuple[list[Any], list[Any]]:
            def mean(n: int) -> Any:
                return over_harmonics(
                    harmonics, lambda k, a, b: harmonic_means(a, b, k * sympy.pi, t0, dt)[n]
                )

            once, twice = mean(0), mean(1)
            return [v0[0] + dt * (constant / 2 + twice)], [v0[0] + dt * (constant + once)]

        def acceleration(t: Any, x: State, v: State) -> list[Any]:
            def wave(k: Any, a: Any, b: Any) -> Any:
                return a * sympy.cos(k * sympy.pi * t) + b * sympy.sin(k * sympy.pi * t)

            return [constant + over_harmonics(harmonics, wave)]

        return Formulas(
            period=period,
            walls={"B": length / 2, "T": -length / 2},
            derived={"d": length, "gbar": gravity},
            reset=reset,
            flight=flight,
            acceleration=acceleration,
            harmonics=(constant, harmonics),
        )
