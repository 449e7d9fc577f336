"""A system of one's own with two modes: an oscillator whose spring is stiffer on one side.

    python examples/bilinear.py

x'' + c x' + k x = a cos(omega t), with k = k_r where x > 0 and k = k_l where x < 0.
"""

import sympy

from contimpact import Formulas, Model, Parameter
from contimpact.models.linear import Linear
from contimpact.models.model import Guard, Mode


class Bilinear(Model):
    SYSTEM = "bilinear"
    MODES = (Mode("left"), Mode("right"))
    WALLS = (
        Guard("P", side=+1, mode="left", to="right"),  # x rises through zero
        Guard("N", side=-1, mode="right", to="left"),  # and falls through it
    )
    PARAMETERS = (
        Parameter("a", "", "the forcing amplitude"),
        Parameter("omega", "", "the forcing frequency", lower=0, above_lower=True),
        Parameter("c", "", "the damping"),
        Parameter("k_l", "", "the stiffness on the left"),
        Parameter("k_r", "", "the stiffness on the right"),
    )

    def formulas(self, symbols):
        a, omega, c = (symbols[name] for name in ("a", "omega", "c"))
        period = 2 * sympy.pi / omega

        def motion(k):
            def force(t):
                return [a * sympy.cos(omega * t)]

            return Linear(mass=[[1]], damping=[[c]], stiffness=[[k]], force=force, period=period)

        motions = {"left": motion(symbols["k_l"]), "right": motion(symbols["k_r"])}
        return Formulas(
            period=period,
            walls={"P": sympy.Integer(0), "N": sympy.Integer(0)},
            flight={mode: m.flight for mode, m in motions.items()},
            acceleration={mode: m.acceleration for mode, m in motions.items()},
        )


if __name__ == "__main__":
    from contimpact import Simulator, check_model, continue_orbit, find_orbits, settle

    model = Bilinear(a=1.0, omega=1.5, c=0.2, k_l=1.0, k_r=4.0)
    print("agree:", ", ".join(check_model(model)))
    orbit = find_orbits(model, "PN", parameter="omega")[0]
    branch = continue_orbit(orbit, "omega", (1.0, 3.0), events=["FB", "PD"])
    print(branch)
    simulator = Simulator(orbit.model)
    print(settle(simulator, simulator.state("P", 0.0, 1.0)))
