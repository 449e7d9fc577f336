r"""A body on a belt, with dry friction: it sticks and slips.

.. math:: \ddot x + c\dot x + x = a\cos\omega t - \mu(w)\,\mathrm{sign}\,w, \qquad
          w = \dot x - V, \qquad \mu(w) = \frac{\mu_0}{1 + \delta\lvert w\rvert} .

Sticking, w = 0, the friction is what holds the body, :math:`f = x + cV - a\cos\omega t`; it slips
where that reaches mu_0 (P, then w < 0) or -mu_0 (A, then w > 0), and sticks again where w comes
back to zero (S from below, B from above), unless that friction could not hold it: then it goes
through (C from below, D from above). The coordinate is w in slip and f in stick. The forcing
period is 2 pi/omega.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from ..errors import InputError, short_repr
from ..models.model import Example, Formulas, Guard, Mode, Model, Parameter

CONSTANT, WEAKENING = "constant", "weakening"


class Belt(Model):
    """A body on a moving belt, held by a spring and driven; units of its mass and its frequency.

    With delta = 0 all flights are in closed form; otherwise those in slip are integrated, which
    takes the extra ``ode``. Slow slip has the friction at rest, which weakens with the relative
    velocity. The option ``friction`` is ``"constant"`` or ``"weakening"``: the second unless delta
    is 0. To follow delta from 0 on, say ``"weakening"``.
    """

    SYSTEM = "belt"
    MODES = (Mode("slip"), Mode("stick", first_order=(0,)), Mode("ahead"))
    WALLS = (
        Guard("S", side=+1, mode="slip", to="stick"),
        Guard("P", side=+1, mode="stick", to="slip"),
        Guard("A", side=-1, mode="stick", to="ahead"),
        Guard("B", side=-1, mode="ahead", to="stick"),
        Guard("C", side=+1, mode="slip", to="ahead", past="A"),
        Guard("D", side=-1, mode="ahead", to="slip", past="P"),
    )
    GEOMETRY = None
    OPTIONS: ClassVar = {"friction": CONSTANT}
    PARAMETERS = (
        Parameter("a", "", "the forcing amplitude"),
        Parameter("omega", "", "the forcing frequency", lower=0, above_lower=True),
        Parameter("c", "", "the damping"),
        Parameter("V", "", "the velocity of the belt"),
        Parameter("mu_0", "", "the friction at rest", lower=0),
        Parameter("delta", "", "the weakening of friction", 0.0, lower=0),
    )
    EXAMPLE = Example(
        {"a": 0.2, "omega": 1.3, "c": 0.1, "V": 0.3, "mu_0": 0.4},
        ("V", 0.22, 0.5),
        ["SP"],
        ("mu_0", 0.3, 0.5),
    )

    def __init__(self, /, **given: Any) -> None:
        constant = given.get("delta", 0.0) == 0.0
        super().__init__(**{"friction": CONSTANT if constant else WEAKENING} | given)

    def validate(self) -> None:
        """Refuse friction that is stated to be constant and weakens."""
        friction, delta = self.options["friction"], self.values["delta"]
        if friction not in (CONSTANT, WEAKENING):
            accepted = f"give {CONSTANT!r} or {WEAKENING!r}"
            raise InputError("friction", f"found {short_repr(friction)}", accepted)
        if friction == CONSTANT and delta != 0.0:
            found = f"friction is stated to be constant, and delta is {delta!r}"
            accepted = f"give friction = {WEAKENING!r}, which needs contimpact[ode]"
            raise InputError("delta", found, accepted)

    def formulas(self, symbols: Mapping[str, Any]) -> Formulas:
        """Slip by the derivative of the equation of motion, stick by that of the friction."""
        import sympy

        a, omega, _, V, mu_0, _ = (symbols[p.name] for p in self.PARAMETERS)

        def rate(t: Any) -> Any:
            """How fast the friction changes that holds the body."""
            return V + a * omega * sympy.sin(omega * t)

        def stick(
            t0: Any, x0: Sequence[Any], v0: Sequence[Any], dt: Any
        ) -> tuple[list[Any], list[Any]]:
            from ..models.symbolic import harmonic_means

            return [V + harmonic_means(0, a * omega, omega, t0, dt)[0]], [rate(t0 + dt)]

        def jump(guard: str, x: Sequence[Any], v: Sequence[Any]) -> tuple[list[Any], list[Any]]:
            """Where slip ends, friction is mu_0 or -mu_0, less the body's acceleration."""
            limit = mu_0 if guard in "SPC" else -mu_0
            if guard in "SB":
                return [limit - v[0]], []
            return [0], [limit - x[0] if guard in "PA" else v[0] - 2 * limit]

        slip, ahead = (self._slip(symbols, side) for side in (-1, 1))
        return Formulas(
            period=2 * sympy.pi / omega,
            walls={"S": 0, "P": mu_0, "A": -mu_0, "B": 0, "C": 0, "D": 0},
            jump=jump,
            flight={"slip": slip.flight, "stick": stick, "ahead": ahead.flight},
            acceleration={
                "slip": slip.acceleration,
                "stick": lambda t, x, v: [rate(t)],
                "ahead": ahead.acceleration,
            },
        )

    def _slip(self, symbols: Mapping[str, Any], sign: int) -> Any:
        """The motion of w where it has a sign."""
        import sympy

        a, omega, c, V, mu_0, delta = (symbols[p.name] for p in self.PARAMETERS)

        def force(t: Any) -> Any:
            return -V - a * omega * sympy.sin(omega * t)

        if self.options["friction"] == CONSTANT:
            from ..models.linear import Linear

            return Linear(
                mass=[[1]],
                damping=[[c]],
                stiffness=[[1]],
                force=lambda t: [force(t)],
                period=2 * sympy.pi / omega,
            )
        from ..models.nonlinear import Nonlinear

        def law(t: Any, w: Sequence[Any], v: Sequence[Any]) -> list[Any]:
            weaker = mu_0 * delta / (1 + sign * delta * w[0]) ** 2
            return [force(t) - w[0] - (c - weaker) * v[0]]

        return Nonlinear(law)
