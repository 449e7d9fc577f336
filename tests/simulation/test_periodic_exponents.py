"""Multipliers and exponents against many digits and Liouville's formula, and what is said where
rounding takes them."""

from __future__ import annotations

import json
import math

import mpmath as mp
import numpy as np
import pytest
from exact_flights import exact_flight

from contimpact.orbits.search import find_orbits
from contimpact.plots.attractors import plot_exponents
from contimpact.simulation.attractor import Cycle
from contimpact.simulation.settle import _without_rounding, exponents_of, periodic
from contimpact.simulation.simulator import Simulator
from contimpact.simulation.sweep import Row, Sweep, table_of
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.two_masses import TwoMasses

STIFF = {"a": 40.0, "omega": 1.0, "k": 100.0, "sigma": 0.3, "r": 0.8}
DAMPINGS = (0.5, 6.0, 8.0, 10.0, 12.0, 60.0)


def cycle_of(orbit):
    """An orbit as the cycle of the simulated map."""
    n = len(orbit.word.walls)
    rows = orbit.problem.impacts(orbit.unknowns)
    letters = [guard.name for guard in orbit.model.WALLS]
    walls = np.array([letters.index(wall) for wall in orbit.word.walls], dtype=np.int8)
    return Cycle(
        walls,
        rows[:, 0],
        rows[:, 1],
        np.zeros(n, dtype=bool),
        orbit.word.period,
        tuple(map(complex, orbit.multipliers)),
        orbit.residual,
        rows[:, 2:],
        np.zeros(n, dtype=np.int64),
    )


def told(orbit):
    return periodic(Simulator(orbit.model), cycle_of(orbit))


def stiff(c):
    """The orbit of one impact that is fastest."""
    found = find_orbits(Oscillator(**STIFF, c=c), "S", parameter="a")
    return max(found, key=lambda orbit: orbit.velocities[0])


def many_digits(orbit, exact):
    """Logarithms of the multipliers of an orbit of one impact, the larger first, and of their
    product; the orbit itself is solved for."""
    period = 2 * mp.pi / mp.mpf(STIFF["omega"])

    def residual(t, v, later, after):
        return exact(orbit.model, "S", "S", [t, v, later, after])[0]

    t, v = mp.findroot(
        lambda t, v: residual(t, v, t + period, v), [orbit.times[0], orbit.velocities[0]]
    )
    ends = [t, v, t + period, v]

    def derivative(k, i):
        return mp.diff(lambda x: residual(*ends[:i], x, *ends[i + 1 :])[k], ends[i])

    a, b = (mp.matrix([[derivative(k, i + j) for i in (0, 1)] for k in (0, 1)]) for j in (0, 2))
    step = -(b**-1) * a
    trace, det = step[0, 0] + step[1, 1], mp.det(a) / mp.det(b)
    root = mp.sqrt(mp.mpc(trace**2 / 4 - det))
    mus = sorted((abs(trace / 2 + root), abs(trace / 2 - root)), reverse=True)
    return [mp.log(mu) for mu in mus], mp.log(abs(det))


@pytest.mark.slow
def test_exponents_and_their_sum_against_many_digits():
    """Where rounding leaves both multipliers, one, or none; the sum is known throughout."""
    lost = []
    for c in DAMPINGS:
        orbit = stiff(c)
        found = told(orbit)
        with mp.workdps(400):
            logs, log_det = many_digits(orbit, exact_flight)
        assert found.exponent_sum == pytest.approx(float(log_det), rel=1e-14)
        assert found.exponent_sum == pytest.approx(2.0 * math.log(0.8) - c * 2.0 * math.pi)
        lost.append(math.isnan(found.exponents[0]))
        if lost[-1]:
            assert found.multipliers == (0j, 0j)
            assert np.all(np.isnan([*found.exponents, found.error, found.per_period]))
        else:
            off = [abs(e - float(log)) for e, log in zip(found.exponents, logs, strict=True)]
            assert max(off) <= found.error + 1e-9
            assert found.error < 0.01
            sizes = [math.exp(e) for e in found.exponents]
            assert np.abs(found.multipliers) == pytest.approx(sizes, rel=2.0 * found.error + 1e-9)
    either = DAMPINGS.index(12.0)  # both are 3e-17, and what is left is a matter of rounding
    del lost[either]
    assert lost == [c == 10.0 for c in DAMPINGS if c != 12.0]


def masses(c):
    values = {"c1": c, "c2": c, "k1": 1.0, "k2": 0.6, "a1": 2.0 + c, "omega": 1.3}
    model = TwoMasses(**values, sigma_1=0.5, sigma_2=9.0, r=0.8)
    return find_orbits(model, "A", parameter="c1", starts=16, rounds=1)[0]


def monodromy(orbit):
    """Of two masses, from the exponential of the flow and the saltation matrix of the impact."""
    p = orbit.model.values
    c, k1, k2, r, w = p["c1"], p["k1"], p["k2"], p["r"], mp.mpf(p["omega"])
    flow = mp.matrix([[0, 0, 1, 0], [0, 0, 0, 1], [-k1 - k2, k2, -2 * c, c], [k2, -k2, c, -c]])
    t, v, other, speed = orbit.unknowns[:4].tolist()
    force = mp.matrix([0, 0, p["a1"] * mp.cos(w * t), 0])
    before, after = (mp.matrix([p["sigma_1"], other, u, speed]) for u in (v, -r * v))
    salt = mp.diag([1, 1, -r, 1])
    late = (flow * after + force - salt * (flow * before + force)) / v
    for i in range(4):
        salt[i, 0] += late[i]
    return mp.expm(flow * (2 * mp.pi / w)) * salt


@pytest.mark.parametrize(("c", "lost"), [(0.1, 0), (6.0, 0), (40.0, 2)])
def test_exponents_of_several_coordinates_against_many_digits(c, lost):
    """m1 = m2 = 1: dampers between wall, first and second mass take (c1 + c2) + c2."""
    orbit = masses(c)
    found = told(orbit)
    liouville = 2.0 * math.log(0.8) - 3.0 * c * 2.0 * math.pi / 1.3
    assert found.exponent_sum == pytest.approx(liouville, rel=1e-13)
    with mp.workdps(400):
        mus = mp.eig(monodromy(orbit), left=False, right=False)
        exact = sorted((float(mp.log(abs(mu))) for mu in mus), reverse=True)
    assert math.fsum(exact) == pytest.approx(liouville, rel=1e-12)
    assert [math.isnan(e) for e in found.exponents] == [False] * (4 - lost) + [True] * lost
    assert [mu == 0 for mu in found.multipliers] == [math.isnan(e) for e in found.exponents]
    assert found.exponents[: 4 - lost] == pytest.approx(exact[: 4 - lost], abs=1e-9)


@pytest.mark.parametrize("c", [4.0, 15.0, pytest.param(60.0, marks=pytest.mark.slow)])
@pytest.mark.full
def test_exponents_of_any_motion_have_liouvilles_sum(c):
    """Also where the derivatives of flights are rounding."""
    orbit = stiff(c)
    simulator = Simulator(orbit.model)
    begin = simulator.state("S", orbit.times[0], 0.9 * orbit.velocities[0])
    found = exponents_of(simulator, begin, simulator.run(begin, impacts=30))
    per_impact = c * found.periods * 2.0 * math.pi / found.impacts
    assert found.impacts == 30
    assert math.fsum(found.per_impact) == pytest.approx(found.restitution - per_impact, rel=1e-9)


def motion_of_masses(c):
    """Thirty impacts from beside an orbit."""
    orbit = masses(c)
    simulator = Simulator(orbit.model)
    t, v, *others = orbit.unknowns[:4].tolist()
    begin = simulator.state("A", t, 0.98 * v, others)
    return exponents_of(simulator, begin, simulator.run(begin, impacts=30))


@pytest.mark.parametrize("c", [0.1, 1.5, 3.0, 9.0])
def test_exponents_of_any_motion_of_several_coordinates(c):
    found = motion_of_masses(c)
    time = found.periods * 2.0 * math.pi / 1.3
    liouville = found.restitution - 3.0 * c * time / found.impacts
    assert math.fsum(found.per_impact) == pytest.approx(liouville, rel=1e-9)


def test_several_that_are_rounding_are_unknown():
    logs = np.array([1.0, -30.0, 0.0, -40.0])
    _without_rounding(logs, np.eye(4), None, None, None)
    assert logs.tolist() == pytest.approx([1.0, math.nan, 0.0, math.nan], nan_ok=True)


@pytest.mark.full
def test_tables_and_pictures_say_what_is_lost():
    orbit = stiff(15.0)
    sweep = Sweep(orbit.model, "a", [Row("up", 40.0, told(orbit))])
    columns, (cells,) = table_of(sweep)
    row = dict(zip(columns, cells, strict=True))
    assert row["exponent_sum"] == pytest.approx(2.0 * math.log(0.8) - 30.0 * math.pi, rel=1e-14)
    assert math.isnan(row["exponent1"])
    assert math.isnan(row["exponent_error"])
    labels = [text.get_text() for text in plot_exponents(sweep).get_legend().get_texts()]
    assert labels == ["below rounding"]
    assert Row.from_record(json.loads(json.dumps(sweep.rows[0].as_record()))) == sweep.rows[0]
