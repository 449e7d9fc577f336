"""Output voltages: Table A1 and equations (9) against their plain form in mpmath."""

from __future__ import annotations

import math
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

import contimpact as ci
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.errors import InputError
from contimpact.orbits.search import find_orbits
from contimpact.results.quantities import branch_voltages, impact_voltages
from contimpact.simulation.attractor import Attractor, Kind
from contimpact.simulation.energy import attractor_voltages, energy, losses
from contimpact.simulation.settle import settle
from contimpact.simulation.simulator import Simulator
from contimpact.systems.membrane import Membrane, velocity_scale
from contimpact.systems.soft_pair import SoftPair


def plain_voltage(membrane, velocity):
    """The formulas as Table A1 prints them, at 50 digits."""
    m, u, rc, rb, k, nu = (
        mp.mpf(getattr(membrane, n)) for n in ("m", "U_in", "R_c", "R_b", "K", "nu")
    )
    delta = ((nu + 1) / (2 * k) * m * mp.mpf(velocity) ** 2) ** (1 / (nu + 1))
    cosine = (-2 * rb * (delta - rb) + 2 * rc * mp.sqrt(rc**2 + delta**2 - 2 * delta * rb)) / (
        2 * (rc**2 + (delta - rb) ** 2)
    )
    sine2 = 1 - cosine**2
    area = 2 * mp.pi * rb**2 * (1 - cosine) + (mp.pi * rc**2 - mp.pi * rb**2 * sine2) / cosine
    return (area / (mp.pi * rc**2)) ** 2 * u - u


@pytest.mark.parametrize("velocity", [1e-9, 1e-5, 1e-3, 0.1, 1.0, 3.0, 5.5, 30.0])
@pytest.mark.parametrize("membrane", [Membrane(), Membrane(m=0.02, R_b=4e-3, nu=1.5)])
def test_voltage_against_the_printed_formulas(membrane, velocity):
    """Measured: 3e-15, also where the printed form would cancel."""
    with mp.workdps(50):
        exact = plain_voltage(membrane, velocity)
        assert abs(mp.mpf(float(membrane.voltage(velocity))) / exact - 1) < 1e-14


def test_voltage_of_no_impact_is_zero_and_grows():
    membrane = Membrane()
    voltages = membrane.voltage(np.linspace(0.0, 8.0, 200))
    assert voltages[0] == 0.0
    assert np.all(np.diff(voltages) > 0)
    assert membrane.voltage(-2.0) == membrane.voltage(2.0)


def test_constants_of_the_paper_are_the_defaults():
    m = Membrane()
    assert (m.U_in, m.R_c, m.R_b, m.K, m.nu) == (2000.0, 6.3e-3, 5e-3, 4.0847e5, 2.6)
    assert m.m == pytest.approx(4.11e-3, rel=1e-3)  # a steel ball of radius 5 mm


def test_dimensional_velocity(pair):
    """8.032 m/s per unit at A = 5 N."""
    assert velocity_scale(pair().values) == pytest.approx(8.032, abs=5e-4)


def test_means_of_equations_9(pair):
    membrane, values = Membrane(), pair().values
    found = impact_voltages(membrane, values, [0.5, -0.4, 0.1], 4.0)
    each = [float(membrane.voltage(velocity_scale(values) * v)) for v in (0.5, 0.4, 0.1)]
    assert found.impacts == pytest.approx(each)
    assert found.per_impact == pytest.approx(sum(each) / 3)
    assert found.per_time == pytest.approx(sum(each) / 4)


def test_energy_along_a_branch(pair, kernels_of):
    """Each point as an orbit of its own; U_T relates to U_I as impacts per time."""
    model = pair(d=0.205)
    orbit = next(o for o in find_orbits(model, "2:1", kernels=kernels_of(model, "s")) if o.stable)
    branch = continue_orbit(orbit, "s", (0.32, 0.34), events=())
    columns = branch_voltages(Membrane(), branch)
    assert np.allclose(columns["U_T"], columns["U_I"] * 3 / 2)
    speeds = branch.velocities[3]
    found = impact_voltages(Membrane(), model.values, speeds, 2.0)
    assert columns["U_I"][3] == pytest.approx(found.per_impact)
    assert columns["U2"][3] == pytest.approx(found.impacts[1])


def motion(kind, released, period=1):
    n = len(released)
    sticks = released[-1:] == [True]
    return Attractor(
        kind,
        {"A": 5.0, "M": 0.1245, "omega": 5 * math.pi},
        "x",
        2.0,
        "BT",
        period,
        np.zeros(n, dtype=np.int8),
        np.linspace(0.0, 1.8, n),
        np.array([0.5] * (n - 2) + [1e-9, 0.0]) if sticks else np.full(n, 0.5),
        np.array(released),
    )


def test_energy_where_impacts_accumulate():
    """Infinitely many impacts per period: nothing per impact, the same per time."""
    found = attractor_voltages(Membrane(), motion(Kind.STICKING, [False, False, True]))
    assert found.per_impact == 0.0
    assert len(found.impacts) == 2
    assert found.per_time == pytest.approx(float(np.sum(found.impacts)) / 2)


def test_without_restitution_a_mean_per_impact_exists():
    """The wall is held from the first impact on: one a period, and nothing accumulates."""
    model = ci.Oscillator(a=1.0, c=0.1, k=1.0, omega=0.8, sigma=0.0, r=0.0)
    attractor = settle(Simulator(model))
    assert attractor.released.tolist() == [False, True]
    speed, period = attractor.velocities[0], 2.0 * math.pi / 0.8
    lost = losses(attractor, model)
    assert lost.per_impact == pytest.approx(0.5 * speed**2, rel=1e-12)
    assert lost.per_time == pytest.approx(0.5 * speed**2 / period, rel=1e-12)
    pair = settle(Simulator(ci.ImpactPair(beta=math.pi / 6, r=0.0, A=5.0, s=0.5)))
    found = attractor_voltages(Membrane(), pair)
    assert found.per_impact == pytest.approx(found.impacts.mean(), rel=1e-12)
    assert len(found.impacts) == 2 == len(pair.times) - 1


def test_losses_of_complex_motion_count_no_releases():
    """Per impact and per time are in the ratio of impacts and time."""
    model = ci.Oscillator(a=1.0, c=0.1, k=1.0, omega=0.8, sigma=0.0, r=0.0)
    cycle = settle(Simulator(model))
    twice = replace(
        cycle,
        kind=Kind.COMPLEX,
        period=None,
        walls=np.tile(cycle.walls, 2),
        times=np.append(cycle.times, cycle.times + 2.0 * math.pi / 0.8),
        velocities=np.tile(cycle.velocities, 2),
        released=np.tile(cycle.released, 2),
    )
    assert losses(twice, model).per_impact == pytest.approx(0.5 * cycle.velocities[0] ** 2)


def test_energy_of_complex_motion_is_over_its_time():
    """N - 1 impacts in the time from the first to the last."""
    found = attractor_voltages(Membrane(), motion(Kind.COMPLEX, [False] * 4, period=None))
    assert len(found.impacts) == 3
    assert found.per_time == pytest.approx(float(np.sum(found.impacts)) / 1.8)


def test_energy_at_rest_is_none():
    assert attractor_voltages(Membrane(), motion(Kind.RESTING, [])).per_time == 0.0


@pytest.mark.parametrize(
    ("given", "where"), [({"m": 0.0}, "m"), ({"R_b": 7e-3}, "R_b"), ({"K": math.inf}, "K")]
)
def test_refused_constants(given, where):
    with pytest.raises(InputError) as error:
        Membrane(**given)
    assert error.value.where == where


def test_other_systems_have_no_membranes(oscillator):
    with pytest.raises(InputError):
        velocity_scale(oscillator().values)


def test_a_pair_whose_contacts_last_has_no_voltages():
    """It leaves its membranes at events of its own, which were counted as impacts."""
    soft = SoftPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.45, k=500.0)
    orbit = find_orbits(soft, "BbTt", rng=0)[0]
    branch = continue_orbit(orbit, "s", range=(0.449, 0.451), events=[])
    attractor = settle(Simulator(soft))
    assert attractor.notation == "BbTt"
    for of in (orbit, branch, attractor):
        with pytest.raises(InputError, match="use the impact pair"):
            energy(of)
    with pytest.raises(InputError, match="use the impact pair"):
        orbit.mean("U", per_time=True, harvester=Membrane())


def test_parameters_of_the_same_names_make_no_membranes():
    """The scale A pi/(M omega) is that of the impact pair's equations; others have units of their
    own, and voltages were given with it."""
    given = {"A": 1.0, "M": 1.0, "omega": 2.8, "c": 0.1, "k": 1.0, "sigma": 0.0, "r": 0.8}
    stated = {
        "coordinates": ["x"],
        "mass": ["M"],
        "damping": ["c"],
        "stiffness": ["k"],
        "force": ["A*cos(omega*t)"],
        "period": "2*pi/omega",
        "guards": {"S": {"within": "x <= sigma", "restitution": "r"}},
    }
    scene = {
        "name": "stop",
        "model": {"system": "linear", **stated, "parameters": given},
        "follow": {"parameter": "A", "range": [0.99, 1.01], "orbits": ["S"]},
    }
    model = ci.read_scene(scene).model
    orbit = find_orbits(model, "S", rng=0)[0]
    branch = continue_orbit(orbit, "A", range=(0.99, 1.01), events=[])
    attractor = settle(Simulator(model))
    for of in (orbit, branch, attractor):
        with pytest.raises(InputError, match="use the impact pair"):
            energy(of)
    with pytest.raises(InputError, match="use the impact pair"):
        orbit.mean("U", per_time=True, harvester=Membrane())
