"""A system of one's own: a ball on a vibrating table, checked against its closed-form answers.

    python examples/bouncing_ball.py

The table moves as a sin(omega t); x is the height of the ball above it. With Gamma = a omega^2/g
the orbit of one impact per period is born in a fold and loses stability in a period doubling at

    Gamma_FB = pi (1 - r)/(1 + r),   Gamma_PD^2 = Gamma_FB^2 + (2 (1 + r^2)/(1 + r)^2)^2.
"""

import math

import contimpact as ci
from contimpact.models.model import Formulas, Model, Parameter, Wall


class BouncingBall(Model):
    """A ball falling on a table that moves as a sin(omega t)."""

    SYSTEM = "bouncing-ball"
    WALLS = (Wall("P", side=-1),)  # the plate; the ball stays above it
    DERIVED = ("Gamma",)
    PARAMETERS = (
        Parameter("a", "m", "the amplitude of the table", lower=0, above_lower=True),
        Parameter("omega", "rad/s", "the frequency of the table", lower=0, above_lower=True),
        Parameter("r", "", "the restitution coefficient", lower=0, upper=1),
        Parameter("g", "m/s^2", "gravity", 9.8, lower=0, above_lower=True),
    )

    def formulas(self, symbols):
        """x'' = -g + a omega^2 sin(omega t), x >= 0."""
        import sympy

        from contimpact.models.symbolic import harmonic_means

        a, omega, r, g = (symbols[name] for name in ("a", "omega", "r", "g"))
        force = a * omega**2

        def flight(t0, x0, v0, dt):
            once, twice = harmonic_means(0, force, omega, t0, dt)
            return [v0[0] + dt * (twice - g / 2)], [v0[0] + dt * (once - g)]

        return Formulas(
            period=2 * sympy.pi / omega,
            walls={"P": sympy.Integer(0)},
            derived={"Gamma": force / g},
            reset=lambda wall, x, v: [-r * v[0]],
            flight=flight,
            acceleration=lambda t, x, v: [force * sympy.sin(omega * t) - g],
            harmonics=(-g, [(1, 0, force)]),
        )


if __name__ == "__main__":
    r, omega, g = 0.5, 50.0, 9.8
    fold = math.pi * (1 - r) / (1 + r)
    doubling = math.hypot(fold, 2 * (1 + r**2) / (1 + r) ** 2)

    ball = BouncingBall(a=1.3 * g / omega**2, omega=omega, r=r, g=g)
    orbit = ci.find_orbits(ball, "1", parameter="a")[0]
    branch = ci.continue_orbit(orbit, "a", (0.5 * ball.values["a"], 2.0 * ball.values["a"]))
    print(branch)
    for kind, exact in (("FB", fold), ("PD", doubling)):
        for event in (e for e in branch.events if e.kind == kind):
            found = event.parameters["Gamma"]
            print(f"{kind}: Gamma = {found:.15f}, closed form {exact:.15f}")
