"""The oscillator with negative damping: r^2 exp(-c T) = 1 where two complex multipliers are."""

from __future__ import annotations

import math

import pytest

from contimpact.diagrams.explore import follow
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.orbits.search import find_orbits
from contimpact.results.scene import read_scene
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator


def crossing(omega, r):
    return 2.0 * math.log(r) * omega / (2.0 * math.pi)


@pytest.mark.parametrize(("omega", "r"), [(1.5, 0.8), (1.5, 0.9), (1.7, 0.85)])
def test_neimark_sacker_points(omega, r):
    exact = crossing(omega, r)
    model = Oscillator(a=1.0, omega=omega, c=0.9 * exact, k=1.0, sigma=0.0, r=r)
    found = []
    for orbit in find_orbits(model, "S", parameter="c"):
        branch = continue_orbit(orbit, range=(1.2 * exact, 0.5 * exact), events=("NS",))
        assert not branch.missed
        found += branch.events
    assert found
    for entry in found:
        assert abs(entry.value - exact) <= entry.error < 1e-13
        assert all(abs(abs(complex(*mu)) - 1.0) < 1e-12 for mu in entry.multipliers)


@pytest.mark.full
def test_no_neimark_sacker_of_the_pair():
    """det M = r^(2N) < 1; and for r = 1 it is one everywhere, within rounding."""
    for r in (0.3, 1.0):
        model = ImpactPair(beta=math.pi / 6, r=r, A=5.0, s=0.4)
        for orbit in find_orbits(model, "1:1", parameter="s", starts=64):
            branch = continue_orbit(orbit, range=(0.3, 0.5), events=("NS",))
            assert not branch.events
            assert not branch.missed


def test_a_start_next_to_grazing_does_not_freeze():
    """The low-velocity orbit of the oscillator, started at 1 - 1e-8 of its grazing."""
    omega, c = 1.5, 0.1
    grazing = 1.0 / math.sqrt((1.0 - omega**2) ** 2 + (c * omega) ** 2)
    model = Oscillator(a=1.0, omega=omega, c=c, k=1.0, sigma=(1.0 - 1e-8) * grazing, r=0.8)
    orbits = find_orbits(model, "S", parameter="sigma")
    slow = min(orbits, key=lambda o: abs(o.velocities[0]))
    assert abs(slow.velocities[0]) < 1e-6
    branch = continue_orbit(slow, range=(0.1, 1.0), events=("V", "FB"))
    assert len(branch) < 500
    assert {end.kind.name for end in branch.ends} == {"RANGE"}


@pytest.mark.full
def test_nothing_is_missed_where_an_orbit_is_born_with_an_impact_at_rest():
    """There multipliers are quotients of rounding; det M = exp(-c T) < 1 all along the branch."""
    scene = {
        "name": "born at rest",
        "model": {
            "system": "soft-stop",
            "parameters": {"k": 1, "c": 0.1, "a": 1, "e": 0.5, "k_b": 20, "c_b": 0, "omega": 1.8},
        },
        "follow": {"parameter": "omega", "range": [1.6, 1.9], "orbits": ["0"], "switch": ["G"]},
        "detect": {"events": ["NS", "G", "V"]},
    }
    diagram = follow(read_scene(scene))
    assert [branch.notation for branch in diagram] == ["0", "1:1"]
    assert [branch.missed for branch in diagram] == [[], []]
    assert not [entry for entry in diagram.entries if entry.kind == "NS"]
