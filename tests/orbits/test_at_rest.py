"""Bodies that rest, at one place in all of a period, on this side of a wall or beyond it."""

from __future__ import annotations

import pytest

from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.orbits.search import find_orbits
from contimpact.results.scene import read_scene
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.soft_stop import SoftStop

STOP = {"omega": 1.3, "c": 0.1, "k": 1.0}


def two_bodies(law, **given):
    """Two that know nothing of each other: x is driven, y rests, and each has a wall."""
    values = {"w": 1.3, "c": 0.1, "s": 0.4, "r": 0.7, "d": 0.3} | given
    model = {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": values,
        "modes": {"free": {"x": "v", "v": "cos(w*t) - c*v - x", "y": "u", "u": law}},
        "guards": {
            "S": {"within": "x <= s", "set": {"v": "-r*v"}},
            "R": {"within": "y <= d", "set": {"u": "-r*u"}},
        },
    }
    follow = {"parameter": "d", "range": [-0.5, 0.5], "orbits": ["S"]}
    return read_scene({"name": "two", "model": model, "follow": follow}).model


def agree_with_place(branch, parameter, place):
    """The orbit is physical if the wall is beyond the place, and touches it there."""
    (touch,) = branch.events
    assert touch.kind == "G"
    assert touch.value == pytest.approx(place, abs=1e-15)
    clear = abs(branch[parameter] - place) > 1e-12
    beyond = branch[parameter][clear] > place
    assert (branch["physical"][clear] == 1).tolist() == beyond.tolist()
    assert branch["smallest_gap"][clear & (branch[parameter] < place)] == pytest.approx(
        branch[parameter][clear & (branch[parameter] < place)] - place
    )
    assert not branch.missed


@pytest.mark.parametrize(
    ("model", "parameter"),
    [
        (Oscillator(a=0.0, sigma=0.5, r=0.8, **STOP), "sigma"),
        (SoftStop(a=0.0, e=0.5, k_b=20.0, c_b=0.3, **STOP), "e"),
    ],
)
def test_an_oscillator_without_a_force_is_at_its_place(model, parameter, plain_and_compiled):
    def run():
        (orbit,) = find_orbits(model, "0", parameter=parameter)
        return continue_orbit(orbit, parameter, (-1.0, 1.0), events=["G"])

    for branch in plain_and_compiled(run):
        agree_with_place(branch, parameter, 0.0)


@pytest.mark.parametrize(
    ("law", "place"), [("-c*u - 2*y", 0.0), ("0.2 - c*u - 2*y", 0.1), ("0.003 - c*u - 3*y**3", 0.1)]
)
def test_a_body_that_rests_while_another_has_impacts_is_at_its_place(
    law, place, plain_and_compiled
):
    def run():
        orbits = find_orbits(two_bodies(law), "S", parameter="d", starts=32, rounds=2)
        orbit = next(o for o in orbits if o.physical)
        return continue_orbit(orbit, "d", (-0.5, 0.5), events=["G"], unphysical=True)

    for branch in plain_and_compiled(run):
        agree_with_place(branch, "d", place)
