"""Impacts that drive a circuit: linear modes in which a coordinate has no inertia."""

from __future__ import annotations

import cmath
import importlib.util
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from contimpact.diagrams.chain_backend import ChainBackend
from contimpact.diagrams.explore import follow
from contimpact.orbits.search import find_orbits
from contimpact.results.scene import read_scene
from contimpact.simulation.settle import exponents_of, settle
from contimpact.simulation.simulator import Simulator

M, K, C, THETA, CAPACITY, R, D = 0.01, 1e3, 0.1, 1e-3, 1e-7, 1e5, 1e-3
FOLLOW = {"parameter": "w", "range": [50.0, 600.0], "orbits": ["0"]}
SCENE = {
    "name": "harvester",
    "model": {
        "system": "hybrid",
        "period": "2*pi/w",
        "modes": {
            "m": {"x": "v", "v": "(-c*v - k*x - th*V)/m + a*cos(w*t)", "V": "(th*v - V/R)/C"}
        },
        "guards": {
            "B": {"within": "x <= d", "set": {"v": "-r*v"}},
            "T": {"within": "x >= -d", "set": {"v": "-r*v"}},
        },
        "parameters": {
            **{"m": M, "k": K, "c": C, "th": THETA, "C": CAPACITY, "R": R, "d": D},
            **{"a": 20.0, "w": 300.0, "r": 0.6},
        },
    },
    "follow": FOLLOW,
    "detect": {"events": ["FB", "PD", "G", "V", "NS"]},
}
"""A mass between two stops whose motion charges a capacitor: in metres and volts, so that one
coordinate is thirty thousand times as large as the other."""


def model(source="", **values):
    """The harvester, with a current that a source drives through its circuit."""
    own = SCENE["model"]
    modes = {"m": {**own["modes"]["m"], "V": f"(th*v - V/R{source})/C"}}
    stated = {**own, "modes": modes, "parameters": own["parameters"] | values}
    return read_scene({**SCENE, "model": stated}).model


def amplitude(w):
    """Of the steady state without impacts, for a unit of force."""
    charge = THETA * 1j * w / (1j * w * CAPACITY + 1.0 / R)
    return abs(1.0 / (K - M * w * w + 1j * w * C + THETA * charge)) * M


def test_branches_are_compiled_and_nothing_is_missed(monkeypatch):
    """Where an impact is at rest multipliers pass infinity: FB, PD and NS were said to be missed
    there. Compiled and plain the branches are the same to the last bit."""
    if importlib.util.find_spec("llvmlite") is None:
        pytest.skip("the extra 'fast' is not installed")
    asked = {**SCENE, "follow": {**FOLLOW, "switch": ["G"], "depth": 1, "range": [282.0, 302.0]}}
    found = []
    for mode in ("always", "never"):
        monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
        found.append(follow(read_scene(asked)))
    compiled, plain = found
    orbit = compiled.branches[1].orbit(0)
    assert not ChainBackend(orbit.problem, gaps=True, doubling=True).obstacle
    assert [branch.missed for branch in compiled.branches] == [[]] * len(compiled.branches)
    for one, other in zip(compiled.branches, plain.branches, strict=True):
        for name, column in one.columns.items():
            np.testing.assert_array_equal(column, other[name])
    quiet = [e.parameters["w"] for e in compiled.branches[0].events if e.kind == "G"]
    assert len(quiet) == 2  # both stops at once
    for w in quiet:
        assert 20.0 * amplitude(w) == pytest.approx(D, rel=1e-12)


def test_a_mass_sticks_while_the_capacitor_discharges():
    """Against flights and impacts by `solve_ivp`; while it sticks, V decays as exp(-t/RC)."""
    values = {"a": 300.0, "w": 100.0}
    simulator = Simulator(model(**values))
    attractor = settle(simulator)
    assert (attractor.kind.value, attractor.word, attractor.period) == ("sticking", "B*T*", 1)
    rows = simulator.run(attractor.state, impacts=80).states()
    k = next(i for i, row in enumerate(rows) if row.released)
    begun, side, volts = rows[k], 1 if rows[k].wall == 0 else -1, rows[k].others[0]
    push = 300.0 * math.cos(100.0 * begun.phase) - side * K / M * D - THETA / M * volts
    assert side * push == pytest.approx(0.0, abs=1e-11)
    assert begun.others[1] == pytest.approx(-volts / (R * CAPACITY), rel=1e-14)

    def law(t, y):
        x, v, volts = y
        force = (-C * v - K * x - THETA * volts) / M
        return [v, force + 300.0 * math.cos(100.0 * t), (THETA * v - volts / R) / CAPACITY]

    def hits(t, y):
        return y[0] + side * D

    hits.terminal, hits.direction = True, -side
    t, y = begun.phase, [side * D, 0.0, volts]
    for row in rows[k + 1 : k + 9]:
        near = {"rtol": 1e-13, "atol": [1e-16, 1e-13, 1e-12], "method": "DOP853"}
        flown = solve_ivp(law, (t, t + 0.2), y, events=hits, first_step=1e-6, **near)
        t, (_, v, volts) = flown.t_events[0][0], flown.y_events[0][0]
        since = row.phase + (row.turns - begun.turns) * simulator.period
        assert since == pytest.approx(t, abs=1e-13)
        assert row.velocity == pytest.approx(v, abs=1e-11)
        assert row.others[0] == pytest.approx(volts, abs=1e-10)
        y = [-side * D, -0.6 * v, volts]
    held, left = next((a, b) for a, b in zip(rows[k + 1 :], rows[k + 2 :], strict=False) if b.held)
    decay = math.exp(-left.since(held, simulator.period) / (R * CAPACITY))
    assert left.others[0] == pytest.approx(decay * held.others[0], rel=1e-2)  # but for the chatter


@pytest.mark.parametrize("source", ["", " + 1e-4*cos(w*t)"])
@pytest.mark.parametrize("r", [0.0, 0.6])
def test_multipliers_of_sticking_are_those_of_the_capacitor(r, source):
    """By differences of motions one and two periods after their voltages differ; all else is
    forgotten. Where a source drives the circuit the rate that an impact leaves depends on the time:
    as if it did not, one of .0019 was .0015."""
    simulator = Simulator(model(source, a=300.0, w=100.0, r=r))
    attractor = settle(simulator)
    state, count = attractor.state, len(attractor.walls)

    def volts_later(change):
        volts, *rest = state.others
        begun = replace(state, others=(volts + change, *rest))
        rows = simulator.run(begun, impacts=2 * count).states()
        return np.array([rows[k * count - 1].others[0] for k in (1, 2)])

    once, twice = volts_later(0.05) - volts_later(-0.05)
    assert attractor.multipliers[0] == pytest.approx(twice / once, rel=1e-5)
    assert attractor.multipliers[1:] == pytest.approx((0.0, 0.0, 0.0), abs=1e-15)


def test_exponents_know_that_a_rate_is_no_state():
    """One is minus infinity, by no determinant of bounded blocks, which took half a minute."""
    simulator = Simulator(model(w=313.6))
    start = simulator.run(simulator.random_state(), impacts=300).end
    found = exponents_of(simulator, start, simulator.run(start, impacts=3000))
    assert found.per_impact[-1] == -math.inf
    assert all(map(math.isfinite, found.per_impact[:-1]))
    decay = -simulator.period / (R * CAPACITY) - C / M * simulator.period
    whole = decay * found.periods / found.impacts + 2.0 * math.log(0.6)
    assert math.fsum(found.per_impact[:-1]) == pytest.approx(whole, rel=3e-3)  # the ends tell


def test_the_motion_without_impacts_is_the_steady_state():
    """It was not known, so that sweeps did not follow it to its grazing."""
    (orbit,) = find_orbits(model(w=500.0), "0", parameter="w")
    found = settle(Simulator(model(w=500.0)))
    assert found.kind.value == "no impact"
    x, v, volts, rate = found.motion
    assert cmath.isclose(abs(complex(x, -v / 500.0)), 20.0 * amplitude(500.0), rel_tol=1e-12)
    assert rate == pytest.approx((THETA * v - volts / R) / CAPACITY, rel=1e-12)
    assert found.motion == pytest.approx(orbit.unknowns[:4], rel=1e-11)


def test_a_start_has_the_rate_that_its_law_gives():
    simulator = Simulator(model(w=500.0))
    found = [simulator.start(0.3, [0.0, 2.0], [1.5, rate], "m") for rate in (0.0, 1e4)]
    assert found[0] == found[1]

    def law(t, y):
        x, v, volts = y
        force = (-C * v - K * x - THETA * volts) / M
        return [v, force + 20.0 * math.cos(500.0 * t), (THETA * v - volts / R) / CAPACITY]

    def hits(t, y):
        return y[0] - D

    hits.terminal = True
    near = {"rtol": 1e-13, "atol": [1e-16, 1e-13, 1e-12], "method": "DOP853"}
    flown = solve_ivp(law, (0.3, 0.4), [0.0, 1.5, 2.0], events=hits, first_step=1e-6, **near)
    (first,) = flown.t_events[0]
    time = found[0].phase + found[0].turns * simulator.period
    assert time == pytest.approx(first, abs=1e-14)
    known = (found[0].velocity, found[0].others[0])
    assert known == pytest.approx(flown.y_events[0][0][1:], rel=1e-12)
