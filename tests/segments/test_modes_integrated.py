"""A system whose modes have flights of two kinds."""

import dataclasses

import numpy as np
import pytest
import sympy

from contimpact.models.nonlinear import Nonlinear
from contimpact.segments.kernel import flat
from contimpact.segments.kernels import Kernels
from contimpact.systems.soft_stop import SoftStop

pytest.importorskip("heyoka", reason="needs contimpact[ode]")


class IntegratedContact(SoftStop):
    """In contact with the stop flights are integrated, away from it they have a closed form."""

    SYSTEM = "integrated-contact"

    def formulas(self, symbols):
        a, omega, c, k, e, k_b, c_b = (symbols[p.name] for p in self.PARAMETERS)
        formulas = super().formulas(symbols)
        contact = Nonlinear(
            lambda t, x, v: [
                a * sympy.cos(omega * t) - (c + c_b) * v[0] - k * x[0] - k_b * (x[0] - e)
            ]
        )
        flight = {**formulas.flight, "contact": contact.flight}
        acceleration = {**formulas.acceleration, "contact": contact.acceleration}
        return dataclasses.replace(formulas, flight=flight, acceleration=acceleration)


def test_one_mode_in_closed_form_and_one_integrated():
    values = {"a": 1.0, "omega": 1.1, "c": 0.1, "k": 1.0, "e": 0.5, "k_b": 20.0, "c_b": 0.3}
    one, other = (Kernels(kind(**values), "omega") for kind in (SoftStop, IntegratedContact))
    assert (other.integrated("C"), other.integrated("R")) == (True, False)
    for a, b in ("CR", "RC"):
        ends = [0.3, 0.8, 0.9, -0.6]
        found, truth = (flat(k.flight(a, b)(*ends, *values.values())) for k in (other, one))
        assert np.max(np.abs(np.subtract(found, truth))) < 1e-13
