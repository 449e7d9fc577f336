"""Quantities along branches: against the orbits of the rows, one by one."""

from __future__ import annotations

import math

import numpy as np
import pytest

import contimpact as ci
from contimpact.results import options
from contimpact.results.quantities import QUANTITIES, series_of
from contimpact.systems.membrane import velocity_scale

MEMBRANE = ci.Membrane(m=0.02)


@pytest.fixture(scope="module")
def branch():
    pair = ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    orbit = next(o for o in ci.find_orbits(pair, "2:1", parameter="s") if o.stable and o.physical)
    return ci.continue_orbit(orbit, "s", range=(0.25, 0.36), events=["FB", "G"])


@pytest.fixture(scope="module")
def orbits(branch):
    return [(row, branch.orbit(row)) for row in (0, 7, len(branch) - 1)]


def values(branch, quantity, row, membrane=None):
    return [one.values[row] for one in series_of(branch, quantity, membrane)]


def test_scenes_know_the_same_names():
    assert options.QUANTITIES == QUANTITIES


def test_quantities_are_those_of_the_orbits(branch, orbits):
    for row, orbit in orbits:
        assert values(branch, "velocity", row) == pytest.approx(orbit.velocities, abs=1e-12)
        assert values(branch, "multipliers", row) == pytest.approx(orbit.multipliers.real)
        assert values(branch, "moduli", row) == pytest.approx(np.abs(orbit.multipliers))
        assert values(branch, "period", row) == [2.0]
        assert values(branch, "gap", row) == pytest.approx([orbit.smallest_gap], nan_ok=True)
    assert [one.name for one in series_of(branch)] == [*"BBT"]


def test_voltages_are_those_of_each_impact(branch, orbits):
    for row, orbit in orbits:
        dimensional = velocity_scale(orbit.parameters) * orbit.velocities
        impacts = [float(MEMBRANE.voltage(v)) for v in dimensional]
        assert values(branch, "energy", row, MEMBRANE) == pytest.approx(impacts)
        assert values(branch, "U_I", row, MEMBRANE) == pytest.approx([sum(impacts) / 3])
        assert values(branch, "U_T", row, MEMBRANE) == pytest.approx([sum(impacts) / 2])


def test_energy_of_whatever_has_some(branch):
    orbit, entry = branch.orbit("e1"), branch.events[0]
    whole = ci.energy(branch, MEMBRANE)
    row = int(np.flatnonzero(branch["event"] == entry.id)[0])
    for one in (ci.energy(orbit, MEMBRANE), ci.energy(entry, MEMBRANE)):
        assert one.per_time == pytest.approx(whole["U_T"][row])
        assert one.impacts == pytest.approx([whole[f"U{k}"][row] for k in (1, 2, 3)])
    with pytest.raises(ci.InputError, match="give an orbit, an entry"):
        ci.energy("e1")


def test_a_function_gives_a_series_or_several(branch):
    def flight_times(branch):
        return np.diff(branch.times)

    assert [one.name for one in series_of(branch, flight_times)] == ["flight_times"] * 2
    named = series_of(branch, lambda b: {"sum": b["v1"] + b["v2"], "r": list(b["r"])})
    assert [one.name for one in named] == ["sum", "r"]
    assert named[0].values == pytest.approx(branch["v1"] + branch["v2"])


@pytest.mark.parametrize("wrong", ["reason", "energie", lambda b: 1.0, lambda b: b["event"]])
def test_what_is_no_quantity_is_refused(branch, wrong):
    with pytest.raises(ci.InputError, match=r"^y: "):
        series_of(branch, wrong)


def test_a_system_without_membranes_has_no_voltages():
    stop = ci.Oscillator(omega=1.0, c=0.1, k=1.0, sigma=1.0, r=0.8, a=0.8)
    orbit = ci.find_orbits(stop, "1", parameter="a")[0]
    short = ci.continue_orbit(orbit, "a", range=(0.79, 0.81), events=[])
    with pytest.raises(ci.InputError, match="use the impact pair"):
        series_of(short, "energy")
    assert series_of(short, "period")[0].values == pytest.approx(2 * math.pi)
