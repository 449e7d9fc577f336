"""Two stable orbits side by side: a motion settles on that which its impacts repeat."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contimpact.orbits.search import find_orbits
from contimpact.simulation.attractor import Unstable, solve_cycle
from contimpact.simulation.settle import settle
from contimpact.simulation.simulator import Simulator
from contimpact.systems.impact_pair import ImpactPair


@pytest.mark.slow
def test_a_motion_that_passes_a_cycle_does_not_settle_on_it():
    """Just beyond a grazing of 3:1, where windows of period adding overlap."""
    pair = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.25646119172420084)
    simulator, generator, found = Simulator(pair), np.random.default_rng(0), set()
    for _ in range(30):
        start = simulator.state("B", generator.uniform(0.0, 2.0), generator.uniform(0.05, 0.7))
        attractor = settle(simulator, start)
        late = simulator.run(start, periods=3000, record=False).end
        walls = simulator.run(late, impacts=300).walls
        count = len(attractor.walls)
        assert np.array_equal(walls[count:], walls[:-count])
        found.add((attractor.notation, count))
    assert found == {("(10:3)/3T", 13), ("(13:4)/4T", 17)}


def test_an_unstable_cycle_is_solved_for_once(monkeypatch):
    """Just beyond the doubling of Fig. 7(a), at s = 0.383143488343, 1:1 is left slowly."""
    solved = []

    def record(*given, **named):
        solved.append(solve_cycle(*given, **named))
        return solved[-1]

    pair = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.382)
    orbit = next(o for o in find_orbits(pair, "1:1") if o.physical)
    simulator = Simulator(pair)
    start = simulator.state("B", orbit.times[0] + 1e-7, orbit.velocities[0])
    monkeypatch.setattr("contimpact.simulation.attractor.solve_cycle", record)
    found = settle(simulator, start)
    unstable = [cycle for cycle in solved if cycle and abs(cycle.multipliers[0]) >= 1.0]
    assert found.notation == "1:1/2T"
    assert len(unstable) == 1


def test_the_stable_one_of_two_cycles_beside_a_fold_is_not_taken_for_the_other():
    """2:1 folds at s = 0.356895277 in Fig. 7(a)."""
    simulator = Simulator(ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.3568952))
    orbits = [o for o in find_orbits(simulator.model, "2:1") if o.physical]
    stable, other = sorted(orbits, key=lambda orbit: not orbit.stable)
    assert not other.stable
    cycles, runs = [], []
    for orbit in (stable, other):
        state = simulator.state("B", orbit.times[0], orbit.velocities[0])
        cycles.append(solve_cycle(simulator, state, 3, 1))
        moved = simulator.state("B", orbit.times[0] + 1e-6, orbit.velocities[0])
        runs.append(simulator.run(moved, impacts=12))
    rows = cycles[1].rows(simulator.period)
    unstable = Unstable(cycles[1], simulator.derivatives(rows))
    assert not unstable.leads_here(runs[0], 8)
    assert unstable.leads_here(runs[1], 8)
