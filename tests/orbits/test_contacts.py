"""Contacts along orbits: against an integration, and as outputs of scenes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import contimpact as ci
from contimpact.errors import InputError
from contimpact.orbits import outputs
from contimpact.results.scene import read_scene

STOP = {"a": 1.0, "omega": 1.3, "c": 0.1, "k": 1.0, "e": 0.5, "k_b": 20.0, "c_b": 0.3}


@pytest.fixture(scope="module")
def orbit():
    found = ci.find_orbits(ci.SoftStop(**STOP), "CR", parameter="a")
    return next(o for o in found if o.physical)


def test_deepest_point(orbit):
    p, (begin, end), (speed, back) = STOP, orbit.times, orbit.velocities

    def rates(t, y):
        x, v = y
        stop = p["k_b"] * (x - p["e"]) + p["c_b"] * v
        return [v, p["a"] * math.cos(p["omega"] * t) - p["c"] * v - p["k"] * x - stop]

    def turning(t, y):
        return y[1]

    turning.terminal = True
    options = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14, "events": turning}
    deepest = solve_ivp(rates, (begin, end), [p["e"], speed], **options).y[0, -1] - p["e"]
    (contact,) = orbit.contacts
    assert (contact.wall, contact.time, contact.speed) == ("C", begin, speed)
    assert contact.duration == pytest.approx(end - begin, rel=1e-14)
    assert contact.restitution == pytest.approx(-back / speed, rel=1e-14)
    assert contact.deflection == pytest.approx(deepest, rel=1e-11)
    assert contact.error < 1e-13


@pytest.mark.full
def test_slow_contacts_beside_fast_ones(monkeypatch):
    """Their deflections take no more points of the motion."""
    pair = ci.SoftPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.3088, k=500.0)
    found = ci.find_orbits(pair, "BbBbTt", parameter="s", starts=128)
    orbit = next(o for o in found if o.physical and min(c.speed for c in o.contacts) < 0.01)
    degrees, depths = [], outputs._depths
    monkeypatch.setattr(outputs, "_depths", lambda *given: degrees.append(given) or depths(*given))
    contacts = orbit.contacts
    assert len(degrees) == 2
    slow, fast = sorted(c.deflection for c in contacts if c.wall == "B")
    assert slow < 0.1 * fast
    assert max(c.error for c in contacts) < 1e-16


def test_rigid_walls_have_none():
    pair = ci.ImpactPair(beta=0.5, r=0.3, A=5.0, s=0.45)
    orbit = ci.find_orbits(pair, "1:1")[0]
    assert orbit.contacts == []
    assert math.isnan(orbit.mean("duration", contacts="B").value)


@pytest.mark.full
def test_means_use_what_the_orbit_knows(monkeypatch):
    """Derived parameters in an expression are the orbit's: no formula is evaluated for them."""
    pair = ci.SoftPair(beta=0.5, r=0.3, A=5.0, s=0.45, k=500.0)
    orbit = next(o for o in ci.find_orbits(pair, "BbTt") if o.physical)
    gap, ratio = orbit.derived["d"], orbit.contacts[0].restitution
    assert gap == pytest.approx(0.45 * 0.1245 * (5 * math.pi) ** 2 / (5.0 * math.pi**2), rel=1e-14)

    def formula(model, name):
        raise AssertionError(name)

    monkeypatch.setattr(ci.SoftPair, "__getitem__", formula)
    found = orbit.mean("restitution*d", contacts="B")
    assert found.value == pytest.approx(ratio * gap, rel=1e-14)


@pytest.mark.slow
def test_columns(orbit):
    given = {
        "name": "contacts",
        "model": {"system": "soft-stop", "parameters": STOP},
        "follow": {"parameter": "a", "range": [0.95, 1.05], "orbits": ["CR"]},
        "detect": {"events": []},
        "output": {
            "deflection": {"contacts": "C", "mean": "deflection/e"},
            "power": "c*v**2",
            "r_eff": {"contacts": "C", "mean": "restitution"},
        },
    }
    branch = ci.follow(given).branches[0]
    row = int(np.argmin(abs(branch["a"] - 1.0)))
    there = branch.orbit(row)
    assert branch["deflection"][row] == there.contacts[0].deflection / STOP["e"]
    assert branch["power"][row] == there.mean("c*v**2").value
    assert branch["r_eff"] == pytest.approx(-branch["v2"] / branch["v1"], rel=1e-9)
    assert read_scene(given).resolved()["output"] == given["output"]


@pytest.mark.parametrize(
    ("output", "accepted"),
    [
        ({"contacts": "X", "mean": "speed"}, "letters of guards: C, R"),
        ({"contacts": "C", "mean": "v"}, "duration"),
        ({"contacts": "C"}, "mean"),
    ],
)
def test_refused(output, accepted):
    scene = {
        "name": "contacts",
        "model": {"system": "soft-stop", "parameters": STOP},
        "follow": {"parameter": "a", "range": [0.9, 1.1], "orbits": ["CR"]},
        "output": {"P": output},
    }
    with pytest.raises(InputError, match=accepted):
        read_scene(scene)
