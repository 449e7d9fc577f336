"""Integrity against the stable manifold that bounds a basin, and what cannot be asked."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from zoo import TWO_MASSES

from contimpact.errors import InputError
from contimpact.orbits.search import find_orbits
from contimpact.results.scene import read_scene
from contimpact.simulation.integrity import integrity
from contimpact.simulation.manifolds import grow_manifold
from contimpact.simulation.settle import settle
from contimpact.simulation.simulator import Simulator
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.two_masses import TwoMasses

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")


def physical(s=0.3556, word="2:1"):
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=s)
    return [o for o in find_orbits(model, word, parameter="s") if o.physical]


def from_manifold(orbit, saddle, sizes):
    """The distance from the manifold, which no simulation has met."""
    manifold = grow_manifold(saddle, stable=True, length=0.2, spacing=0.002)
    grower, best = manifold.grower, math.inf
    for piece in manifold.pieces:
        for k in (k for k, wall in enumerate(orbit.word.walls) if wall == piece.wall):

            def far(lap, sigma, k=k, impact=piece.impact):
                _, time, velocity = grower.point(impact, lap, sigma)
                apart = math.remainder(time - orbit.times[k], grower.period)
                return math.hypot(apart / sizes[0], (velocity - orbit.velocities[k]) / sizes[1])

            rows = zip(piece.laps.tolist(), piece.parameters.tolist(), strict=True)
            nearest = int(np.argmin([far(*row) for row in rows]))
            for j in (j for j in (nearest, nearest + 1) if 0 < j < len(piece)):
                lap, high = int(piece.laps[j]), piece.parameters[j]
                low = piece.parameters[j - 1] / grower.growth ** (lap - int(piece.laps[j - 1]))
                part = minimize_scalar(
                    lambda u, far=far, lap=lap, low=low, high=high: far(
                        lap, low + u * (high - low)
                    ),
                    bounds=(0.0, 1.0),
                    method="bounded",
                    options={"xatol": 1e-9},
                )
                best = min(best, part.fun)
    return best


@pytest.mark.full
def test_the_distance_is_that_of_the_stable_manifold():
    orbits = physical()
    orbit, saddle = (next(o for o in orbits if o.stable is stable) for stable in (True, False))
    found = integrity(orbit, directions=32)
    assert found.bounded
    assert found.distance == pytest.approx(from_manifold(orbit, saddle, found.sizes), rel=1e-8)
    assert np.linalg.norm(found.change / found.sizes) == pytest.approx(found.distance, rel=1e-12)
    assert (found.wall, found.leads_to) == ("B", "1:1/C")
    assert "2:1: 0.005651901" in repr(found)


@pytest.mark.full
def test_where_nothing_else_attracts_there_is_no_boundary():
    orbit = next(o for o in physical(0.42, "1:1") if o.stable)
    found = integrity(orbit, directions=6, largest=0.2)
    assert not found.bounded
    assert found.distance == 0.2
    assert "0.2 or more" in repr(found)


@pytest.mark.full
def test_of_several_coordinates():
    """All coordinates are moved; just inside the distance motion leads back, as a run shows."""
    orbits = find_orbits(TwoMasses(**TWO_MASSES), "A", parameter="omega")
    orbit = next(o for o in orbits if o.stable and o.physical)
    found = integrity(orbit, directions=8)
    assert found.bounded
    assert 0.0 < found.error < 1e-8
    assert found.leads_to == "0:1"
    simulator = Simulator(orbit.model)
    back = []
    for part in (0.999, 1.0):
        time, velocity, *others = orbit.problem.impacts(orbit.unknowns)[0] + part * found.change
        state = simulator.state("A", time % simulator.period, velocity, others)
        back.append(settle(simulator, state).notation)
    assert back == [orbit.notation, "0:1"]


@pytest.mark.full
def test_in_several_coordinates_the_nearest_does_not_depend_on_the_directions():
    """A harvester with a circuit: the voltage's rate is no part of the state, and is not moved."""
    model = {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": {"a": 6.0, "w": 240.0, "s": 4e-4},
        "modes": {
            "free": {"x": "v", "v": "a*cos(w*t) - 5*v - 35000*x - V/10", "V": "3e4*v - 250*V"}
        },
        "guards": {"S": {"within": "x <= s", "set": {"v": "-0.65*v"}}},
    }
    follow = {"parameter": "w", "range": [200.0, 300.0], "orbits": ["1"]}
    scene = read_scene({"name": "harvester", "model": model, "follow": follow})
    orbit = next(o for o in find_orbits(scene.model, "1", parameter="w") if o.stable and o.physical)
    found = [integrity(orbit, rng=seed) for seed in (0, 1)]
    assert found[0].distance == pytest.approx(found[1].distance, rel=1e-8)
    assert found[0].change[3] == 0.0
    simulator, row = Simulator(orbit.model), orbit.problem.impacts(orbit.unknowns)[0]
    for part, reached in ((0.999, "1"), (1.001, found[0].leads_to)):
        time, velocity, *others = row + part * found[0].change
        state = simulator.state("S", time % simulator.period, velocity, others)
        assert settle(simulator, state).notation == reached


def test_refusals():
    orbits = physical()
    with pytest.raises(InputError, match="an orbit that cannot be observed"):
        integrity(next(o for o in orbits if not o.stable))
    stable = next(o for o in orbits if o.stable)
    for given in ({"directions": 2}, {"largest": 0.0}, {"largest": math.nan}):
        with pytest.raises(InputError, match="at least 3 directions"):
            integrity(stable, **given)
