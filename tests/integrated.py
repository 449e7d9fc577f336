"""Systems with closed forms, as if they had none: their flights are integrated."""

import sympy
from zoo import TWO_MASSES

from contimpact.models.model import Formulas
from contimpact.models.nonlinear import Nonlinear
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.two_masses import TwoMasses


class Integrated(Oscillator):
    """The linear oscillator, as if its flights had no closed form."""

    SYSTEM = "integrated-oscillator"

    def formulas(self, symbols):
        a, omega, c, k, sigma, r = (symbols[p.name] for p in self.PARAMETERS)
        motion = Nonlinear(lambda t, x, v: [a * sympy.cos(omega * t) - c * v[0] - k * x[0]])
        return Formulas(
            period=2 * sympy.pi / omega,
            walls={"S": sigma},
            reset=lambda wall, x, v: [-r * v[0]],
            flight=motion.flight,
            acceleration=motion.acceleration,
        )


class IntegratedMasses(TwoMasses):
    SYSTEM = "integrated-masses"

    def formulas(self, symbols):
        formulas = super().formulas(symbols)
        motion = Nonlinear(formulas.acceleration, 2)
        return Formulas(**{**vars(formulas), "flight": motion.flight})


MASSES = TWO_MASSES | {"omega": 1.8, "sigma_1": 1.0, "sigma_2": 1.0}
