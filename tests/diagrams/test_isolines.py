"""Curves of requested values, and of functions of one's own."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contimpact.continuation.branch import End
from contimpact.diagrams.curves import follow_curve, follow_isoline
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.errors import InputError
from contimpact.orbits.search import find_orbits
from contimpact.systems.impact_pair import ImpactPair

RANGES = ((0.2, 1.0), (0.1, 0.8))


@pytest.fixture(scope="module")
def orbit():
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.5)
    return next(o for o in find_orbits(model, "1:1", parameter="s") if o.physical)


def speed(orbit):
    return float(abs(orbit.velocities[0]))


def test_a_requested_gap_keeps_its_value(orbit):
    """d is proportional to s/A."""
    branch = continue_orbit(orbit, range=(0.3, 0.6), events=(), values={"d": [0.3]})
    (entry,) = branch.events
    curve = follow_curve(entry, None, "A", (0.2, 1.0), (3.0, 8.0), values=[4.0, 7.0])
    assert curve.kind == "UZ"
    assert curve["d"] == pytest.approx(0.3, abs=1e-14)
    assert curve["s"] == pytest.approx(entry.value * curve["A"] / 5.0, rel=1e-14)
    assert {4.0, 7.0} <= set(curve["A"])


@pytest.mark.full
def test_an_isoline_against_one_parameter_runs(orbit):
    wanted = [0.2, 0.5]
    curve = follow_isoline(orbit, speed, second="r", ranges=RANGES, values=wanted, label="speed")
    assert (curve.label, curve.parameters) == ("speed", ("s", "r"))
    assert np.abs(curve["v1"]) == pytest.approx(speed(orbit), rel=1e-12)
    goal = ("speed", lambda o: speed(o) - speed(orbit))
    for r in wanted:
        found = find_orbits(orbit.model.replace(r=r), "1:1", parameter="s")
        runs = [continue_orbit(o, range=RANGES[0], events=[goal]) for o in found if o.physical]
        events = [entry for branch in runs for entry in branch.events]
        rows = np.nonzero(np.abs(curve["r"] - r) < 1e-14)[0]
        assert min(abs(e.value - curve["s"][i]) for e in events for i in rows) < 1e-10


@pytest.mark.full
def test_another_value_next_to_the_orbit(orbit):
    curve = follow_isoline(orbit, speed, second="r", ranges=RANGES, value=1.02 * speed(orbit))
    assert np.abs(curve["v1"]) == pytest.approx(1.02 * speed(orbit), rel=1e-12)


def test_a_value_that_is_not_reached(orbit):
    end = follow_isoline(orbit, speed, second="r", ranges=RANGES, value=100.0)
    assert isinstance(end, End)
    assert "the first point was not reached" in end.message


def test_what_is_refused(orbit):
    with pytest.raises(InputError, match="function: it returned 'x'"):
        follow_isoline(orbit, lambda o: "x", second="r", ranges=RANGES)
    with pytest.raises(InputError, match="function: it returned nan"):
        follow_isoline(orbit, lambda o: math.nan, second="r", ranges=RANGES)
    with pytest.raises(InputError, match="range of r"):
        follow_isoline(orbit, speed, second="r", ranges=[(0.2, 1.0), (0.5, 0.8)])
    with pytest.raises(InputError, match="no parameter 'q'"):
        follow_isoline(orbit, speed, second="q", ranges=RANGES)
