"""Exact derivatives of impacts and of means along orbits, against thirty digits."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from zoo import TWO_MASSES

import contimpact as ci
from contimpact.accuracy.reference import Reference
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import orbit_at
from contimpact.results.scene import read_model
from contimpact.segments.kernels import Kernels

STEP = 1e-9
MEANS = {
    "v**2*cos(pi*t) + x*s + d": {},
    "r*v**2": {"at_impacts": True},
    "U**2": {"per_time": True, "harvester": ci.Membrane()},
}


@pytest.fixture(scope="module")
def orbit():
    pair = ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    return next(o for o in ci.find_orbits(pair, "2:1", parameter="s") if o.stable)


def voltage(mp, speed):
    """Table A1 of the paper, as it is printed."""
    f = mp.mpf
    given = ci.Membrane()
    m, b, c = f(given.m), f(given.R_b), f(given.R_c)
    depth = ((f(given.nu) + 1) / (2 * f(given.K)) * m * speed**2) ** (1 / (f(given.nu) + 1))
    h = b - depth
    q = mp.sqrt(c**2 - depth * (2 * b - depth))
    cosine = (b * h + c * q) / (c**2 + h**2)
    missing = 1 - cosine
    x = missing * (c**2 - b**2 * missing) / (c**2 * cosine)
    return f(given.U_in) * ((1 + x) ** 2 - 1)


def exact(orbit, parameter, value):
    """Times, velocities and `MEANS` of the orbit in thirty digits, by flights written out here."""
    model = orbit.model.replace(**{parameter: value})
    problem = OrbitProblem(model, orbit.word, Kernels(model, parameter))
    reference = Reference(problem, 30)
    mp = reference.ctx
    z = reference.orbit(np.append(orbit.unknowns[:-1], value)).unknowns
    p = {name: mp.mpf(x) for name, x in model.values.items()}
    times, speeds = z[:-1:2], z[1:-1:2]
    d = p["M"] * p["omega"] ** 2 * p["s"] / (p["A"] * mp.pi**2)
    g = p["M"] * p["g"] * mp.sin(p["beta"]) / p["A"]
    total = mp.mpf(0)
    for k, wall in enumerate(orbit.word.walls):
        t, end = times[k], [*times[1:], times[0] + 2][k]
        begin, left = (d / 2 if wall == "B" else -d / 2), -p["r"] * speeds[k]

        def integrand(u, t=t, begin=begin, left=left):
            v = left + g * (u - t) + (mp.sin(mp.pi * u) - mp.sin(mp.pi * t)) / mp.pi
            x = begin + (left - mp.sin(mp.pi * t) / mp.pi) * (u - t) + g * (u - t) ** 2 / 2
            x += (mp.cos(mp.pi * t) - mp.cos(mp.pi * u)) / mp.pi**2
            return v**2 * mp.cos(mp.pi * u) + x * p["s"] + d

        total += mp.quad(integrand, [t, (t + end) / 2, end])
    scale = p["A"] * mp.pi / (p["M"] * p["omega"])
    hits = sum(p["r"] * v**2 for v in speeds) / 3
    power = sum(voltage(mp, scale * abs(v)) ** 2 for v in speeds) / 2
    return [*times, *speeds, total / 2, hits, power]


@pytest.mark.parametrize("parameter", ["s", "A", "beta", "r", "omega"])
@pytest.mark.full
def test_in_thirty_digits(orbit, parameter):
    """Measured: 3e-13 at most of the largest of each kind."""
    low, high = (orbit[parameter] + step for step in (-STEP, STEP))
    ends = exact(orbit, parameter, low), exact(orbit, parameter, high)
    width = mpmath.mpf(high) - mpmath.mpf(low)
    expected = [float((b - a) / width) for a, b in zip(*ends, strict=True)]
    moved = orbit.sensitivity(parameter)
    assert moved.times == pytest.approx(expected[:3], rel=1e-10)
    assert moved.velocities == pytest.approx(expected[3:6], rel=1e-10)
    for (expression, kind), rate in zip(MEANS.items(), expected[6:], strict=True):
        found = orbit.mean_sensitivity(expression, parameter, **kind)
        assert found == pytest.approx(rate, rel=1e-10)


HYBRID = {
    "system": "hybrid",
    "period": "2*pi/w",
    "mass": {"x": "m"},
    "modes": {"free": {"x": "v", "v": "(F*cos(w*t) - c*v - k*x**3)/m"}},
    "guards": {"S": {"within": "x <= d", "set": {"v": "-e*v"}}},
    "parameters": {"m": 2.0, "c": 0.2, "k": 3.0, "F": 1.5, "w": 2.3, "d": 0.05, "e": 0.7},
}


def others():
    """With damping, of two masses, with many harmonics, and with integrated flights."""
    oscillator = ci.Oscillator(a=1.0, omega=2.6, c=0.1, k=1.0, sigma=0.0, r=0.8)
    yield oscillator, "1", "a*cos(omega*t)*v", "omega"
    yield ci.TwoMasses(**TWO_MASSES), "A", "x1*v2 + v1**2", "omega"
    rich = "cos(pi*t)+" + "+".join(f"0.01*sin({k}*pi*t)" for k in range(2, 12))
    pair = ci.ImpactPair(beta=0.5, r=0.3, A=5.0, s=0.45, forcing=rich)
    yield pair, "1:1", "v**2", "A"
    yield read_model(HYBRID), "1", "c*v**2", "w"


@pytest.mark.parametrize("number", range(4))
@pytest.mark.full
def test_of_other_systems_against_differences(number):
    model, word, expression, parameter = list(others())[number]
    if number == 3:
        pytest.importorskip("heyoka")
    orbit = next(o for o in ci.find_orbits(model, word, parameter=parameter) if o.physical)
    step = 1e-4 * orbit.value

    def moved(by):
        unknowns = np.append(orbit.unknowns[:-1], orbit.value + by)
        return orbit_at(orbit.problem, unknowns).mean(expression).value

    expected = (8 * (moved(step) - moved(-step)) - moved(2 * step) + moved(-2 * step)) / 12 / step
    assert orbit.mean_sensitivity(expression, parameter) == pytest.approx(expected, rel=1e-8)


def test_refusals(orbit):
    for given, said in [
        (("w", "s"), "unknown name 'w'"),
        (("U", "s"), "unknown name 'U'"),
        (("v", "q"), "has no parameter 'q'"),
    ]:
        with pytest.raises(ci.InputError, match=said):
            orbit.mean_sensitivity(*given)
    quiet = ci.find_orbits(ci.Oscillator(a=1.0, omega=2.0, c=0.3, k=1.5, sigma=10.0, r=0.8), "0")
    with pytest.raises(ci.InputError, match="no impacts"):
        quiet[0].mean_sensitivity("v**2", "omega")
