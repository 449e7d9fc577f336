"""What a script keeps is pickled, and what is read back is the same."""

from __future__ import annotations

import copy
import math
import pickle

import numpy as np
import pytest

import contimpact as ci
from contimpact.diagrams.orbit_walks import walk_both_ways

SCENE = {
    "name": "pair",
    "model": {
        "system": "impact-pair",
        "parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.34},
    },
    "follow": {"parameter": "s", "range": [0.3, 0.4], "orbits": ["1:1"], "switch": ["G"]},
    "detect": {"events": ["PD", "G"]},
}


class OwnPair(ci.ImpactPair):
    """A model of a module is pickled by its name."""


@pytest.fixture(scope="module")
def orbit():
    model = ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    return next(o for o in ci.find_orbits(model, "1:1", parameter="s") if o.physical)


@pytest.mark.parametrize("copied", [lambda o: pickle.loads(pickle.dumps(o)), copy.deepcopy])
def test_an_orbit_is_copied_whole(orbit, copied):
    again = copied(orbit)
    assert np.array_equal(again.unknowns, orbit.unknowns)
    assert np.array_equal(again.multipliers, orbit.multipliers)
    assert (again.word, again.parameters, again.residual, again.physical) == (
        orbit.word,
        orbit.parameters,
        orbit.residual,
        orbit.physical,
    )
    branches = [ci.continue_orbit(o, range=(0.3, 0.4), events=["PD", "G"]) for o in (again, orbit)]
    assert branches[0] == branches[1]


def test_orbits_pickled_together_share_their_kernels(orbit):
    one, other = pickle.loads(pickle.dumps([orbit, copy.copy(orbit)]))
    assert one.problem.kernels is other.problem.kernels


def test_what_a_script_keeps_is_pickled(orbit):
    scene = ci.read_scene(SCENE)
    diagram = ci.follow(scene)
    branch = diagram.branches[0]
    grazing = next(e for e in branch.events if e.kind == "G")
    ranges = (0.3, 0.4), (0.2, 0.4)
    few = ci.Settings(max_points=5)
    curve = ci.follow_curve(orbit.model, grazing, "r", *ranges, settings=few)
    for kept in (branch, grazing, diagram, curve):
        assert pickle.loads(pickle.dumps(kept)) == kept
    again = pickle.loads(pickle.dumps(scene))
    assert again.resolved() == scene.resolved()
    for model in (orbit.model, OwnPair(beta=0.1, r_B=0.2, r_T=0.3, A=5.0, s=0.4)):
        same = pickle.loads(pickle.dumps(model))
        assert type(same) is type(model)
        assert (same.values, same.options) == (model.values, model.options)


def test_what_a_walk_hands_out_is_pickled(orbit):
    kept = []
    ci.continue_orbit(orbit, range=(0.33, 0.35), events=[], callback=kept.append)
    for point in kept:
        again = pickle.loads(pickle.dumps(point))
        assert np.array_equal(again.unknowns, point.unknowns)
        assert np.array_equal(again.evaluation.multipliers, point.evaluation.multipliers)
    run = walk_both_ways(orbit.problem, orbit.unknowns, (0.33, 0.35), [], ci.Settings())
    assert pickle.loads(pickle.dumps(run)).branch("b1") == run.branch("b1")
