"""A frequency followed to zero: the branch ends where the period has grown a thousandfold."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contimpact import continue_orbit, find_orbits, read_scene
from contimpact.continuation.branch import EndKind

SCENE = {
    "name": "slow",
    "model": {
        "system": "linear",
        "coordinates": ["x"],
        "mass": [1],
        "damping": ["c"],
        "stiffness": [1],
        "force": ["cos(omega*t)"],
        "period": "2*pi/omega",
        "guards": {"S": {"within": "x <= 2", "restitution": 0.1}},
        "parameters": {"omega": 2.0, "c": 0.5},
    },
    "follow": {"parameter": "omega", "range": [0.5, 2.4], "orbits": ["0"]},
}


@pytest.mark.parametrize("low", [-1.0, 0.0])
@pytest.mark.quick(1)
def test_a_branch_of_unbounded_period_ends(low):
    model = read_scene(SCENE).model
    (orbit,) = find_orbits(model, "0", parameter="omega")
    branch = continue_orbit(orbit, "omega", (low, 2.4), events=[])
    end = branch.ends[0]
    assert end.kind is EndKind.PERIOD
    assert end.value == pytest.approx(2e-3, rel=1e-12)
    assert "1000 times that of the start" in end.message
    assert branch.ends[1].kind is EndKind.RANGE
    omega = end.value
    size = (1.0 - omega**2) ** 2 + (0.5 * omega) ** 2
    last = np.argmin(branch["omega"])
    assert branch["x0_0"][last] == pytest.approx((1.0 - omega**2) / size, rel=1e-9)


@pytest.mark.full
def test_a_limit_at_which_there_is_a_period_is_reached():
    model = read_scene(SCENE).model
    (orbit,) = find_orbits(model, "0", parameter="omega")
    branch = continue_orbit(orbit, "omega", (1e-3, 2.4), events=[])
    assert [end.kind for end in branch.ends] == [EndKind.RANGE] * 2
    assert math.isclose(branch.ends[0].value, 1e-3)
