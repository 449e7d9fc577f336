"""Orbits without impacts of twice the forcing's period, where they become those of one period."""

import pytest

import contimpact as ci

MODEL = {
    "system": "hybrid",
    "period": "2*pi/w",
    "parameters": {"a": 0.8, "w": 2.45, "c": 0.1, "s": 9.0, "r": 0.7},
    "modes": {"swing": {"x": "v", "v": "-c*v - (1 + a*cos(w*t))*x - x**3"}},
    "guards": {"S": {"within": "x <= s", "set": {"v": "-r*v"}}},
}
"""A parametrically excited spring that hardens: x = 0 doubles its period at some w."""


def followed(orbit):
    follow = {"parameter": "w", "range": [2.1, 2.6], "orbits": [orbit], "switch": ["PD"]}
    given = {"name": "swing", "model": MODEL, "follow": follow}
    return ci.follow(ci.read_scene(given | {"numerics": {"starts": 16, "rounds": 2}}))


def test_a_branch_ends_where_it_is_the_orbit_of_one_period_run_twice():
    """x and -x are one orbit, begun a period of the forcing apart, and followed once."""
    doubled, rest = followed("0/2T"), followed("0")
    (doubling,) = [event for event in rest.entries if event.branch == "b1"]
    assert doubling.kind == "PD"
    born = rest[doubling.opens[0]].orbit(-1)
    assert born.value == 2.6
    ending = [b for b in doubled.branches if any(end.kind.name == "SHORTER" for end in b.ends)]
    (branch,) = ending
    (crossing,) = [event for event in branch.events if event.kind == "BP"]
    assert crossing.value == pytest.approx(doubling.value, abs=1e-12)
    (limit,) = {0, -1} - {0 if branch.ends[0].kind.name == "SHORTER" else -1}
    there = branch.orbit(limit)
    assert abs(there.unknowns) == pytest.approx(abs(born.unknowns), abs=1e-9)
    at_rest = doubled.orbit(crossing.id)
    assert abs(at_rest.unknowns[:2]).max() < 1e-15
