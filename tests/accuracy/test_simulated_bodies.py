"""Simulated flights of two masses against the same in thirty digits."""

from __future__ import annotations

import pytest

from contimpact.accuracy.reference import ExactFlights, flights_of
from contimpact.simulation.simulator import Simulator
from contimpact.systems.two_masses import TwoMasses

VALUES = {"c1": 0.1, "c2": 0.05, "k1": 1.0, "k2": 0.6, "a1": 1.0, "omega": 0.6, "r": 0.5}


@pytest.mark.full
def test_all_coordinates_of_flights_are_right_to_rounding():
    simulator = Simulator(TwoMasses(**VALUES, sigma_1=0.1, sigma_2=0.3))
    run = simulator.run(simulator.state("B", 0.173, 1.0098, [0.0864, -0.0536]), impacts=40)
    exact = ExactFlights(simulator)
    assert max(exact.errors(run, 3)) < 1e-14
    along, _ = exact.along(run, 3)
    assert len(along) == 3
    assert max(along) < 1e-13


def test_sojourns_are_no_flights():
    simulator = Simulator(TwoMasses(**VALUES, sigma_1=0.1, sigma_2=0.3))
    run = simulator.run(simulator.state("B", 0.173, 1.0098, [0.0864, -0.0536]), impacts=40)
    resting = {k for k in range(40) if run.released[k] or run.held[k]}
    assert resting
    assert not resting & set(flights_of(run))
    assert not {k - 1 for k in resting} & set(flights_of(run))
