"""Transitions of sweeps over curves: where the markers stand."""

from __future__ import annotations

import dataclasses
import math

import pytest

import contimpact as ci
from contimpact.attractors.attractor import Attractor, Kind
from contimpact.attractors.sweep import Row, Sweep
from contimpact.plots.transitions import MARKS


@pytest.fixture(scope="module")
def pair():
    return ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)


@pytest.fixture(scope="module")
def curve(pair):
    orbit = next(o for o in ci.find_orbits(pair, "1:1", parameter="s") if o.physical)
    branch = ci.continue_orbit(orbit, range=(0.3, 0.4), events=["G"])
    few = ci.Settings(max_points=6)
    return ci.follow_curve(branch.events[0], None, "r", (0.3, 0.4), (0.2, 0.4), settings=few)


def sweep_of(pair, r, met):
    """A sweep that meets these orbits at 0.40, 0.39, ..."""
    rows = []
    for k, name in enumerate(met):
        at = pair.replace(r=r, s=0.4 - 0.01 * k)
        d = (at.values["s"]) * 0.6225
        values = {**at.values, "d": d, "gbar": 0.0}
        rows.append(Row("down", at.values["s"], Attractor(Kind.PERIODIC, values, name, 2.0)))
    return Sweep(pair.replace(r=r), "s", rows)


def marks(ax, marker):
    found = [m for m in ax.lines if m.get_marker() == marker and len(m.get_xdata()) == 1]
    return [(m.get_xdata()[0], m.get_ydata()[0], m.get_markerfacecolor()) for m in found]


def test_markers_stand_between_the_values(pair, curve):
    sweeps = [
        sweep_of(pair, 0.25, ["1:1", "1:1", "2:1", "2:1", "3:1"]),
        sweep_of(pair, 0.35, ["2:1", "1:1/C", "2:1", "2:1"]),
    ]
    ax = ci.plot_transitions([curve], sweeps, to=["2:1", "3:1"], along="s")
    two, three = (marks(ax, MARKS[k]) for k in (0, 1))
    assert [place for place, *_ in two] == [0.25, 0.35]
    assert [value for _, value, _ in two] == pytest.approx([0.385, 0.385])
    assert [face for *_, face in two] == ["k", "k"]
    assert three == [(0.25, pytest.approx(0.365), "white")]  # only for the last value
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert texts == ["simulated, to 2:1", "simulated, to 3:1"]


def test_what_does_not_fit_is_refused(pair, curve):
    other = dataclasses.replace(curve, parameters=("s", "A"))
    with pytest.raises(ci.InputError, match=r"^curves: 2 pairs"):
        ci.plot_transitions([curve, other], [], to=["2:1"])
    with pytest.raises(ci.InputError, match=r"^sweeps: one is in A; give sweeps in s"):
        ci.plot_transitions([curve], [Sweep(pair, "A", [])], to=["2:1"])
