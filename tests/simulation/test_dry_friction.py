"""Motion with dry friction, which turns where a velocity vanishes: there it is rounding."""

from __future__ import annotations

import tomllib

import pytest

from contimpact.diagrams.starting_orbits import settled_orbits
from contimpact.results.scene import read_scene
from contimpact.segments.kernels import Kernels
from contimpact.simulation.settle import settle
from contimpact.simulation.simulator import Simulator

SCENE = """
name = "dry friction"
[model]
system = "hybrid"
period = "2*pi/w"
[model.parameters]
w = 3.0
[model.modes.plus]
x = "v"
v = "cos(w*t) - v/20 - x - 1/10"
[model.modes.minus]
x = "v"
v = "cos(w*t) - v/20 - x + 1/10"
[model.guards]
P = { mode = "plus", within = "v >= 0", to = "minus" }
M = { mode = "minus", within = "v <= 0", to = "plus" }
[follow]
parameter = "w"
range = [2, 4]
orbits = ["PM"]
"""


@pytest.mark.parametrize("w", [2.5, 3.0, 3.5])
def test_motion_with_dry_friction_has_one_period(w):
    """Two motions approach each other, so that there is one of the forcing's period; it counted as
    one of up to 19 periods, since velocities where it turns, of rounding, were compared."""
    simulator = Simulator(read_scene(tomllib.loads(SCENE)).model.replace(w=w))
    for x in (-3.0, -4.0):
        found = settle(simulator, simulator.state("M", 0.0, 1.0, (x, 0.0)))
        assert (found.word, found.period) == ("PM", 1)


def test_motions_with_dry_friction_settle_on_the_orbit_a_search_starts_from():
    model = read_scene(tomllib.loads(SCENE)).model
    found = settled_orbits(model, Kernels(model, "w"))
    assert found.words() == ["PM"]
    assert all(number == 0 for end, number in found.ends.items() if end.value)
