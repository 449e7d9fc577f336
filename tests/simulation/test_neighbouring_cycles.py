"""Two stable orbits side by side: a motion settles on that which its impacts repeat."""

from __future__ import annotations

import math

import numpy as np
import pytest

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
