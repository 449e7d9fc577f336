r"""The linear oscillator with a soft stop, a spring and a damper beyond e.

.. math:: \ddot x + c\dot x + kx + [x > e]\,(k_b (x - e) + c_b \dot x) = a\cos\omega t.

Contact begins at C, where x rises to e, and ends at R, where it falls back to e: the stop releases
there, not where its force vanishes. The forcing period is 2 pi/omega.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ..errors import InputError
from ..models.model import Example, Formulas, Geometry, Guard, Mode, Model, Parameter


class SoftStop(Model):
    """A forced, damped linear oscillator of unit mass against a soft stop; any units that fit.

    In contact stiffness and damping of the stop come besides those in flight.
    """

    SYSTEM = "soft-stop"
    MODES = (Mode("free"), Mode("contact"))
    WALLS = (
        Guard("C", side=+1, mode="free", to="contact"),
        Guard("R", side=-1, mode="contact", to="free"),
    )
    GEOMETRY = Geometry(springs=((-1, 0),))
    PARAMETERS = (
        Parameter("a", "", "the forcing amplitude"),
        Parameter("omega", "", "the forcing frequency", lower=0, above_lower=True),
        Parameter("c", "", "the damping"),
        Parameter("k", "", "the stiffness", lower=0, above_lower=True),
        Parameter("e", "", "the position of the stop"),
        Parameter("k_b", "", "the stop's stiffness", lower=0),
        Parameter("c_b", "", "the stop's damping", lower=0),
    )
    EXAMPLE = Example(
        {"a": 1.0, "omega": 2.0, "c": 0.1, "k": 1.0, "e": 0.5, "k_b": 20.0, "c_b": 0.3},
        ("omega", 0.6, 2.0),
        ["0"],
        ("k_b", 5.0, 50.0),
    )

    def validate(self) -> None:
        """Refuse undamped resonance, in flight or in contact."""
        c, k, omega = self.values["c"], self.values["k"], self.values["omega"]
        laws = {"free": (c, k), "contact": (c + self.values["c_b"], k + self.values["k_b"])}
        for mode, (damping, stiffness) in laws.items():
            if damping == 0 and math.isclose(stiffness, omega**2, rel_tol=1e-15):
                found = f"undamped, the mode {mode!r} is at resonance: it has no periodic response"
                raise InputError("omega", found, "give damping or another frequency")

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """Two oscillators, the one in contact about the stop's position."""
        import sympy

        from ..models.symbolic import driven_oscillator

        names = ("a", "omega", "c", "k", "e", "k_b", "c_b")
        a, omega, c, k, e, k_b, c_b = (symbols[name] for name in names)
        motions = {
            "free": driven_oscillator([(omega, a, 0)], c, k),
            "contact": driven_oscillator([(omega, a, 0)], c + c_b, k + k_b, rest=e, load=-k * e),
        }
        return Formulas(
            period=2 * sympy.pi / omega,
            walls={"C": e, "R": e},
            flight={mode: flight for mode, (flight, _) in motions.items()},
            acceleration={mode: acceleration for mode, (_, acceleration) in motions.items()},
        )
