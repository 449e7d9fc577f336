"""Derivatives with respect to parameters, against differences of what is computed anew."""

from __future__ import annotations

import math

import numpy as np
import pytest

import contimpact as ci
from contimpact.orbits.search import orbit_at

VALUES = {"beta": math.pi / 6, "r": 0.3, "A": 5.0, "s": 0.34}
STEP = 1e-5


def events_at(**changes):
    """The events of the 2:1 and the 1:1 orbit along s, by label."""
    pair = ci.ImpactPair(**{**VALUES, **changes})
    found = {}
    for word, kinds in (("2:1", ["FB", "G"]), ("1:1", ["PD", "G"])):
        orbit = next(o for o in ci.find_orbits(pair, word, parameter="s") if o.physical)
        branch = ci.continue_orbit(orbit, "s", range=(0.25, 0.4), events=kinds)
        found |= {event.label: event for event in branch.events}
    return found


@pytest.mark.parametrize("parameter", ["r", "A"])
@pytest.mark.full
def test_of_events(parameter):
    """Measured: 2e-9 of the value; the differences' own error is of that size."""
    here = events_at()
    value = VALUES[parameter]
    low, high = (events_at(**{parameter: value + side * STEP}) for side in (-1, 1))
    for label in ("FB", "PD", "~G[1:1->2:1]", "G[2:1->3:1]"):
        expected = (high[label].value - low[label].value) / (2 * STEP)
        assert ci.sensitivity(here[label], parameter) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("parameter", ["r", "s", "beta"])
def test_of_orbits(parameter):
    pair = ci.ImpactPair(**VALUES)
    orbit = next(o for o in ci.find_orbits(pair, "2:1", parameter=parameter) if o.stable)
    value = VALUES[parameter]
    low, high = (
        orbit_at(orbit.problem, np.append(orbit.unknowns[:-1], value + side * STEP))
        for side in (-1, 1)
    )
    found = orbit.sensitivity(parameter)
    assert found.times == pytest.approx((high.times - low.times) / (2 * STEP), rel=1e-6)
    expected = (high.velocities - low.velocities) / (2 * STEP)
    assert found.velocities == pytest.approx(expected, rel=1e-6)
    other = orbit.sensitivity("A")  # of a parameter it was not found with
    assert np.isfinite(other.velocities).all()


def test_what_has_none_is_refused():
    fold = events_at()["FB"]
    for given, where in ((("s",), "parameter"), (("d",), "parameter")):
        with pytest.raises(ci.InputError, match=f"^{where}: "):
            ci.sensitivity(fold, *given)
    with pytest.raises(ci.InputError, match=r"^entry: "):
        ci.sensitivity(None, "r")
    with pytest.raises(ci.InputError, match=r"^parameter: "):
        fold.orbit().sensitivity("d")
