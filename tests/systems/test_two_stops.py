"""Two stops: what its symmetry makes happen at once."""

from __future__ import annotations

import math

import pytest

from contimpact import continue_orbit, find_orbits
from contimpact.errors import InputError
from contimpact.systems.two_stops import TwoStops


@pytest.fixture(scope="module")
def symmetric():
    def at(sigma):
        model = TwoStops(a=1.0, omega=1.7, c=0.1, k=0.0, sigma=sigma, r=0.7)
        half = math.pi / model.values["omega"]
        orbits = [o for o in find_orbits(model, "RL", parameter="sigma") if o.velocities[0] > 0]
        return min(orbits, key=lambda orbit: abs(orbit.times[1] - orbit.times[0] - half))

    return at


@pytest.mark.parametrize("start", [0.022, 0.05, 0.09])
@pytest.mark.quick(1)
def test_both_touches_of_a_symmetric_orbit_stand_in_order_of_flights(symmetric, start):
    """Whichever way the branch is walked; rounding puts now the one first and now the other."""
    branch = continue_orbit(symmetric(start), "sigma", range=(0.02, 0.1), events=["G"])
    low, also_low, high, also_high = sorted(branch.events, key=lambda e: round(e.value, 9))
    assert low.value == pytest.approx(also_low.value, abs=low.error + also_low.error)
    assert high.value == pytest.approx(also_high.value, abs=high.error + also_high.error)
    assert [(e.flight, e.wall) for e in (low, also_low)] == [(0, "L"), (1, "R")]
    assert [(e.flight, e.wall) for e in (high, also_high)] == [(0, "R"), (1, "L")]
    places = [event.arclength for event in branch.events]
    assert places == sorted(places)


def test_stops_beyond_each_other_are_refused():
    """-0.5 given as the left stop's place is its distance."""
    model = TwoStops(a=1.0, omega=1.7, c=0.1, k=0.0, sigma_R=0.4, sigma_L=-0.5, r=0.7)
    with pytest.raises(InputError, match=r"the wall L is at 0\.5, beyond R at 0\.4"):
        find_orbits(model, "RL")
    find_orbits(model.replace(sigma_L=-0.3), "RL", starts=8, rounds=1)  # on one side of zero
