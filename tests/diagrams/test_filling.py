"""Points between those of a curve: how near splines through them keep to closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from contimpact.continuation.settings import Settings
from contimpact.diagrams.curves import follow_curve
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.orbits.search import find_orbits
from contimpact.systems.impact_pair import ImpactPair

RANGES = ((0.1, 12.0), (0.1, 0.95))
COARSE = Settings(tolerance=1e-13, step=0.2, max_step=0.5, max_angle=0.6)


def doubling_of_the_ball(r):
    """Its Gamma = 1/gbar, of a ball on a table."""
    return np.hypot(np.pi * (1 - r) / (1 + r), 2 * (1 + r**2) / (1 + r) ** 2)


@pytest.fixture(scope="module")
def doubling():
    model = ImpactPair(beta=math.pi / 2, r=0.5, A=1.6, s=40.0)
    orbit = next(o for o in find_orbits(model, "1:0", parameter="A") if o.physical)
    events = continue_orbit(orbit, range=RANGES[0], events=("PD",)).events
    return next(e for e in events if e.kind == "PD")


def departure(curve):
    """How far the spline through a curve's points is from the closed form, in parts of ranges."""
    s = curve["arclength"]
    places = np.linspace(s[0], s[-1], 4001)
    A, r = (CubicSpline(s, curve[name])(places) for name in ("A", "r"))
    exact = doubling_of_the_ball(r) * float(np.median(curve["A"] * curve["gbar"]))
    return float(np.max(np.abs(A - exact))) / np.ptp(RANGES[0])


@pytest.mark.parametrize("within", [1e-5, 1e-7])
def test_splines_keep_as_near_as_asked(doubling, within):
    plain = follow_curve(doubling, None, "r", *RANGES, settings=COARSE)
    filled = follow_curve(doubling, None, "r", *RANGES, settings=COARSE, within=within)
    assert departure(plain) > within
    assert departure(filled) < within
    assert np.all(np.isin(plain["r"], filled["r"]))
    assert np.max(np.abs(filled["residual"])) < 1e-12
    assert np.all(np.diff(filled["arclength"]) > 0.0)


@pytest.mark.full
def test_no_more_points_are_put_than_it_takes(doubling):
    near, nearer = (
        follow_curve(doubling, None, "r", *RANGES, settings=COARSE, within=within)
        for within in (1e-5, 1e-9)
    )
    assert len(nearer) < 12 * len(near)  # by the fourth root ten times as many
    steps = np.diff(nearer["arclength"])
    assert steps.max() > 2.0 * steps.min()
