"""Two guards of a mode that are met at once, and a mode after it that has one of them alone."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

from contimpact.continuation.branch import EndKind
from contimpact.diagrams.curves import follow_curve
from contimpact.diagrams.explore import follow
from contimpact.results.scene import load_scene, read_scene

BRANCHES = Path(__file__).parents[2] / "branches"
V, F, C, D, R, W = 0.5, 0.4, 0.05, 1.0, 0.6, 1.3
PULL = "a*cos(w*t) - x - c*v"
SCENE = {
    "name": "belt with a stop",
    "model": {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": {"a": 0.9, "w": W, "V": V, "F": F, "c": C, "d": D, "r": R},
        "modes": {"slip": {"x": "v", "v": f"{PULL} + F"}, "over": {"x": "v", "v": f"{PULL} - F"}},
        "guards": {
            "O": {"mode": "over", "within": "x <= d", "to": "slip", "set": {"v": "-r*v"}},
            "M": {"mode": "slip", "within": "v <= V", "to": "over"},
            "S": {"mode": "slip", "within": "x <= d", "set": {"v": "-r*v"}},
            "N": {"mode": "over", "within": "v >= V", "to": "slip"},
        },
    },
    "follow": {"parameter": "a", "range": [0.1, 2.0], "orbits": ["OM"]},
    "detect": {"events": ["FB", "PD", "G", "V", "T"]},
}
"""A body on a belt of velocity V, which it overtakes from M to O. Where it hits the stop with the
velocity V, it would fall behind the belt before it does, at N."""


def corner(start):
    """The time of O, that of M, and a: of the periodic motion that hits the stop with V."""

    def rates(friction, a):
        return lambda t, y: (y[1], a * math.cos(W * t) - y[0] - C * y[1] + friction)

    def flown(friction, a, span, y):
        return solve_ivp(rates(friction, a), span, y, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]

    def off(z):
        hit, passed, a = z
        there = flown(F, a, (hit, passed), (D, -R * V))
        back = flown(-F, a, (passed, hit + 2.0 * math.pi / W), (there[0], V))
        return there[1] - V, *(back - np.array([D, V]))

    return fsolve(off, start, xtol=1e-13)


def test_an_impact_at_the_speed_at_which_its_mode_ends_is_a_g():
    """It was not located: from there on the orbit is unphysical, as it ends beyond N."""
    scene = read_scene(SCENE)
    diagram = follow(scene)
    (branch,) = [b for b in diagram.branches if b.word == "OM"]
    assert branch.missed == []
    (event,) = [e for e in branch.events if e.kind == "G"]
    _, _, a = corner([event.times[0], event.times[1], event.value])
    assert event.value == pytest.approx(a, abs=1e-10)
    assert abs(event.velocities[0] - V) < 1e-10
    assert event.opens == ()


def test_a_curve_of_such_impacts_keeps_the_speed():
    scene = read_scene(SCENE)
    (event,) = [e for e in follow(scene).entries if e.kind == "G"]
    ranges = (0.1, 2.0), (0.5, 0.7)
    curve = follow_curve(event, scene.model, "r", *ranges, name="c1", values=[0.55])
    assert {end.kind for end in curve.ends} == {EndKind.RANGE}
    np.testing.assert_allclose(curve["v1"], V, rtol=1e-10)


def test_a_flight_that_turns_at_its_end_touches_once():
    """Where friction changes its sign the gap has an extremum: what touches there is its flight."""
    scene = load_scene(BRANCHES / "soft_pair_friction" / "scene.toml")
    scene = dataclasses.replace(scene, range=(0.3, 0.37), switch=())
    events = [e for e in follow(scene).entries if e.kind == "G"]
    assert [e.value for e in events] == [pytest.approx(0.3048581395, abs=1e-9)]
