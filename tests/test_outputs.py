"""Means of outputs along orbits, and the balance of energies."""

from __future__ import annotations

import numpy as np
import pytest

import contimpact as ci
from contimpact.errors import InputError
from contimpact.results.options import Table
from contimpact.results.scene_tables import read_model


@pytest.fixture(scope="module")
def oscillator():
    """An orbit with one impact in a period, closed forms with damping."""
    model = ci.Oscillator(a=1.0, omega=2.6, c=0.1, k=1.0, sigma=0.0, r=0.8)
    return next(o for o in ci.find_orbits(model, "1") if o.physical)


def test_balance_oscillator(oscillator):
    forcing = oscillator.mean("a*cos(omega*t)*v")
    damping = oscillator.mean("c*v**2")
    lost = ci.losses(oscillator).per_time
    assert lost > 0.0
    assert forcing.value == pytest.approx(damping.value + lost, rel=1e-12)
    assert forcing.error < 1e-14


def test_linear_response():
    """Without impacts the mean of v^2 is half the squared amplitude of the velocity."""
    model = ci.Oscillator(a=1.0, omega=2.0, c=0.3, k=1.5, sigma=10.0, r=0.8)
    (orbit,) = ci.find_orbits(model, "0")
    amplitude = 2.0 / np.hypot(1.5 - 4.0, 0.6)
    assert orbit.mean("v**2").value == pytest.approx(amplitude**2 / 2, rel=1e-13)
    assert abs(orbit.mean("v").value) < 1e-14


def test_before_impacts(oscillator):
    found = oscillator.mean("v**2", at_impacts=True)
    assert found.value == pytest.approx(np.mean(oscillator.velocities**2), rel=1e-13)


@pytest.mark.parametrize("text", ["w**2", "v**", "open('x')", "1/0"])
def test_wrong_expression(oscillator, text):
    with pytest.raises(InputError, match="expression"):
        oscillator.mean(text)


def test_balance_two_masses():
    """A machine of two masses that a scene states, whose velocities are v1 and v2."""
    scene = {
        "system": "linear",
        "coordinates": ["x1", "x2"],
        "mass": [["1", "0"], ["0", "mu"]],
        "damping": [["c", "-c"], ["-c", "c"]],
        "stiffness": [["2", "-1"], ["-1", "1"]],
        "force": ["0", "F*cos(w*t)"],
        "period": "2*pi/w",
        "guards": {"S": {"within": "x2 <= d", "restitution": "e"}},
        "parameters": {"mu": 0.5, "c": 0.2, "F": 1.0, "w": 1.3, "d": 0.1, "e": 0.7},
    }
    model = read_model(Table(scene, "model"))
    orbits = ci.find_orbits(model, "1")
    assert orbits
    for orbit in orbits:
        work = orbit.mean("F*cos(w*t)*v2").value
        damping = orbit.mean("c*(v2 - v1)**2").value
        assert work == pytest.approx(damping + ci.losses(orbit).per_time, rel=1e-12)
