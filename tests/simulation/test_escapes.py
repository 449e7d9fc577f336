"""Escape rates under noise, against motions of closed-form flights written out here."""

from __future__ import annotations

import math

import numpy as np
import pytest

import contimpact as ci

PI = math.pi


@pytest.fixture(scope="module")
def orbit():
    """One standard deviation from a touch of B, at the noise below."""
    pair = ci.ImpactPair(beta=PI / 6, r=0.3, A=5.0, s=0.39)
    return next(o for o in ci.find_orbits(pair, "1:1", parameter="s") if o.stable and o.physical)


NOISE = {"r": 0.0222}


def simulated(orbit, deviation, motions, periods):
    """Escapes and periods of all motions together: flights from B that are seen beyond B, or from T
    beyond T, at 400 instants before they arrive on the other wall."""
    rng, d, g = np.random.default_rng(5), orbit["d"], orbit["gbar"]
    t, v = (np.full(motions, x) for x in (orbit.times[0], orbit.velocities[0]))
    escapes = lasted = 0
    for flight in range(2 * periods):
        side = 1.0 if flight % 2 == 0 else -1.0
        left = -(0.3 + deviation * rng.standard_normal(len(t))) * v
        dt = np.linspace(0.0, 2.5, 1001)[1:, None]
        x = side * d / 2 + (left - np.sin(PI * t) / PI) * dt + g * dt**2 / 2
        x = side * (x + (np.cos(PI * t) - np.cos(PI * (t + dt))) / PI**2)
        beyond, across = np.argmax(x > d / 2, axis=0), np.argmax(x < -d / 2, axis=0)
        escaped = (x > d / 2).any(axis=0) & (beyond < across) | ~(x < -d / 2).any(axis=0)
        escapes, lasted = escapes + np.count_nonzero(escaped), lasted + 0.5 * len(t)
        low, high = (dt[:, 0][np.maximum(across - k, 0)] for k in (1, 0))
        for _ in range(40):
            mid = (low + high) / 2
            y = side * d / 2 + (left - np.sin(PI * t) / PI) * mid + g * mid**2 / 2
            y = side * (y + (np.cos(PI * t) - np.cos(PI * (t + mid))) / PI**2)
            low, high = np.where(y < -d / 2, low, mid), np.where(y < -d / 2, mid, high)
        end = t + high
        v = left + g * high + (np.sin(PI * end) - np.sin(PI * t)) / PI
        t, v = end[~escaped], v[~escaped]
    return escapes, lasted


@pytest.mark.slow
def test_rate_is_that_of_flights_in_closed_form(orbit):
    assert orbit.fluctuations(NOISE).margins[0].sigmas == pytest.approx(1.0, abs=0.01)
    found = ci.escape_rate(orbit, NOISE, motions=60, periods=20)
    escapes, lasted = simulated(orbit, NOISE["r"], 20_000, 20)
    low, high = found.interval
    assert low < escapes / lasted < high
    assert repr(found).startswith(f"{found.escapes} of 60 motions escape")


def test_without_noise_nothing_escapes(orbit):
    found = ci.escape_rate(orbit, {"r": 0.0}, motions=2, periods=3)
    assert (found.escapes, found.periods) == (0, 6)
    assert found.interval[0] == 0.0


def test_refusals(orbit):
    for noise, said in [
        ({"r": -1.0}, "standard deviations"),
        ({"q": 1.0}, "has no parameter"),
        ({"r": 50.0}, "restitution"),
    ]:
        with pytest.raises(ci.InputError, match=said):
            ci.escape_rate(orbit, noise, motions=1, periods=1)
    with pytest.raises(ci.InputError, match="motions"):
        ci.escape_rate(orbit, NOISE, motions=0)
