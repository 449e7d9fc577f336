"""Systems of the tests' own."""

from __future__ import annotations

from typing import ClassVar

from contimpact.mechanics.model import Formulas, Parameter
from contimpact.systems.impact_pair import ImpactPair

HARMONICS = 5


class HarmonicPair(ImpactPair):
    """The impact pair under `HARMONICS` harmonics whose orders and amplitudes are parameters.

    Kernels are derived once for all forcings: k_i, a_i, b_i for a_i cos(k_i pi t) + b_i
    sin(k_i pi t).
    """

    SYSTEM = "harmonic-pair"
    OPTIONS: ClassVar = {}
    EXPRESSIONS: ClassVar = {}
    PARAMETERS = ImpactPair.PARAMETERS + tuple(
        Parameter(f"{letter}{i}", "", "a harmonic", float(i + 1) if letter == "k" else 0.0)
        for i in range(HARMONICS)
        for letter in "kab"
    )

    def symmetry(self, parameter, harmonics):
        return None

    def formulas(self, symbols):
        import sympy

        from contimpact.mechanics.symbolic import harmonic_means

        beta, amplitude, s, mass, omega, g = (
            symbols[name] for name in ("beta", "A", "s", "M", "omega", "g")
        )
        harmonics = [tuple(symbols[f"{letter}{i}"] for letter in "kab") for i in range(HARMONICS)]
        length = mass * omega**2 * s / (amplitude * sympy.pi**2)
        constant = mass * g * sympy.sin(beta) / amplitude

        def reset(wall, x, v):
            return [-symbols.get("r", symbols.get(f"r_{wall}")) * v[0]]

        def flight(t0, x0, v0, dt):
            means = [harmonic_means(a, b, k * sympy.pi, t0, dt) for k, a, b in harmonics]
            once, twice = (sum(parts, sympy.Integer(0)) for parts in zip(*means, strict=True))
            return [v0[0] + dt * (constant / 2 + twice)], [v0[0] + dt * (constant + once)]

        def acceleration(t, x, v):
            waves = (
                a * sympy.cos(k * sympy.pi * t) + b * sympy.sin(k * sympy.pi * t)
                for k, a, b in harmonics
            )
            return [constant + sum(waves, sympy.Integer(0))]

        return Formulas(
            period=sympy.Integer(2),
            walls={"B": length / 2, "T": -length / 2},
            derived={"d": length, "gbar": constant},
            reset=reset,
            flight=flight,
            acceleration=acceleration,
            harmonics=(constant, harmonics),
        )


def harmonic_pair(waves, **given):
    """The pair under given waves, a list of (k, a, b)."""
    values = {
        f"{letter}{i}": float(value)
        for i, wave in enumerate(waves)
        for letter, value in zip("kab", wave, strict=True)
    }
    return HarmonicPair(**values, **given)
