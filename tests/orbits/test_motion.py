"""The motion of all coordinates along an orbit, against the equations of motion."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from contimpact import find_orbits
from contimpact.errors import InputError
from contimpact.systems.impact_damper import ImpactDamper
from contimpact.systems.soft_stop import SoftStop
from contimpact.systems.two_masses import TwoMasses

TWO = {"c1": 0.1, "c2": 0.05, "k1": 1.0, "k2": 0.6, "a1": 1.0, "omega": 1.4, "r": 0.8}


def two_masses(p, t, y):
    (x1, x2), (v1, v2) = y[:2], y[2:]
    spring = p["c2"] * (v1 - v2) + p["k2"] * (x1 - x2)
    force = p["a1"] * math.cos(p["omega"] * t) - p["c1"] * v1 - p["k1"] * x1
    return [v1, v2, (force - spring) / p["m1"], spring / p["m2"]]


def impact_damper(p, t, y):
    x, v = y[0], y[2]
    a = math.cos(p["Omega"] * t) - 2.0 * p["zeta"] * v - x
    return [v, y[3], a, -a]


def soft_stop(p, t, y):
    contact = y[0] > p["e"]
    stop = p["k_b"] * (y[0] - p["e"]) + p["c_b"] * y[1] if contact else 0.0
    return [y[1], p["a"] * math.cos(p["omega"] * t) - p["c"] * y[1] - p["k"] * y[0] - stop]


SOFT = {"a": 1.0, "omega": 1.3, "c": 0.1, "k": 1.0, "e": 0.5, "k_b": 20.0, "c_b": 0.3}
CASES = [
    (TwoMasses(**TWO, sigma_1=1.0, sigma_2=1.0), "A", "omega", two_masses, 1e-9),
    (TwoMasses(**TWO, sigma_1=1.0, sigma_2=1.0), "0", "omega", two_masses, 1e-9),
    (ImpactDamper(Omega=1.0, d=20.0, r=0.8, mu=0.1, zeta=0.01), "RL", "Omega", impact_damper, 1e-9),
    (SoftStop(**SOFT), "CR", "omega", soft_stop, 1e-8),
]


@pytest.mark.parametrize(("model", "word", "parameter", "rates", "within"), CASES)
@pytest.mark.full
def test_each_flight_obeys_the_equations_of_motion(model, word, parameter, rates, within):
    orbit = find_orbits(model, word, parameter=parameter)[0]
    count = max(len(orbit.times), 1)
    motion = orbit.motion(30)
    size = model.DEGREES_OF_FREEDOM
    assert motion.x.shape == motion.v.shape == (30 * count, size)
    for t, x, v in zip(*(np.split(part, count) for part in motion), strict=True):
        exact = solve_ivp(
            lambda t, y: rates(model.values, t, y),
            (t[0], t[-1]),
            [*x[0], *v[0]],
            t_eval=t,
            rtol=1e-11,
            atol=1e-12,
        )
        assert np.hstack([x, v]) == pytest.approx(exact.y.T, abs=within)


def test_it_agrees_with_the_path_of_the_gap_coordinate():
    orbit = find_orbits(SoftStop(**SOFT), "CR", parameter="omega")[0]
    path, motion = orbit.path(20), orbit.motion(20)
    assert np.array_equal(motion.t, path.t)
    assert motion.x[:, 0] == pytest.approx(path.x, abs=1e-13)
    assert motion.v[:, 0] == pytest.approx(path.v, abs=1e-13)


@pytest.mark.parametrize("word", ["A", "0"])
@pytest.mark.quick(1)
def test_an_expression_is_evaluated_along_the_motion(word):
    orbit = find_orbits(TwoMasses(**TWO, sigma_1=1.0, sigma_2=1.0), word, parameter="omega")[0]
    path = orbit.motion(4001)
    power = orbit.evaluate("c2*(v2 - v1)**2 + t", 4001)
    expected = TWO["c2"] * (path.v[:, 1] - path.v[:, 0]) ** 2 + path.t
    np.testing.assert_allclose(power, expected, rtol=1e-14)
    mean = np.trapezoid(power - path.t, path.t) / (path.t[-1] - path.t[0])
    assert orbit.mean("c2*(v2 - v1)**2").value == pytest.approx(mean, rel=1e-5)
    with pytest.raises(InputError, match="expression"):
        orbit.evaluate("v3**2")
