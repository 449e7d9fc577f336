"""A system of one's own with modes of different dimension: a body that sticks to a belt and slips.

    python examples/belt.py

Follows the orbit that slips (P) and sticks (S) once in a period, in the frequency. One of its two
multipliers is zero: a body that sticks has lost its velocity.
"""

import sympy

import contimpact as ci
from contimpact.models.linear import Linear
from contimpact.models.model import Formulas, Guard, Mode, Model, Parameter
from contimpact.models.symbolic import Stumpff


class Belt(Model):
    """x'' + c x' + x = a cos(omega t) + friction, on a belt of speed V.

    Slipping behind the belt, q = x' - V < 0, the friction is mu, and q moves as an oscillator.
    Sticking, the friction f = x + c V - a cos(omega t) follows the belt, up to mu_s.
    """

    SYSTEM = "belt"
    MODES = (Mode("slip"), Mode("stick", first_order=(0,)))
    WALLS = (
        Guard("P", side=+1, mode="stick", to="slip"),
        Guard("S", side=+1, mode="slip", to="stick"),
    )
    PARAMETERS = tuple(
        Parameter(name, "", f"the parameter {name}", lower=0)
        for name in ("a", "omega", "c", "V", "mu", "mu_s")
    )

    def formulas(self, symbols):
        a, omega, c, V, mu, mu_s = symbols.values()
        slip = Linear(
            mass=[[1]],
            damping=[[c]],
            stiffness=[[1]],
            period=2 * sympy.pi / omega,
            force=lambda t: [-V - a * omega * sympy.sin(omega * t)],
        )

        def rate(t):
            return V + a * omega * sympy.sin(omega * t)

        def stick(t0, x0, v0, dt):
            half = omega * dt / 2
            mean = V + a * omega * sympy.sin(omega * t0 + half) * Stumpff(1, half**2)
            return [mean], [rate(t0 + dt)]

        def jump(guard, x, v):
            return ([mu - v[0]], []) if guard == "S" else ([0], [mu - x[0]])

        return Formulas(
            period=slip.period,
            walls={"P": mu_s, "S": 0},
            jump=jump,
            flight={"slip": slip.flight, "stick": stick},
            acceleration={"slip": slip.acceleration, "stick": lambda t, x, v: [rate(t)]},
        )


if __name__ == "__main__":
    belt = Belt(a=0.2, omega=1.3, c=0.1, V=0.3, mu=0.3, mu_s=0.5)
    (orbit,) = ci.find_orbits(belt, "PS", parameter="omega")
    print(orbit)
    for entry in ci.continue_orbit(orbit, range=(0.6, 1.6), events=["FB", "PD", "G", "V"]).events:
        print(f"{entry.label:4} at omega = {entry.value:.12g}")
