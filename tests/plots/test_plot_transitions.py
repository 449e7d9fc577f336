"""Transitions of sweeps over curves: where the markers stand."""

from __future__ import annotations

import dataclasses
import math

import pytest

import contimpact as ci
from contimpact.plots.curves import MARKS, RISING
from contimpact.simulation.attractor import Attractor, Kind
from contimpact.simulation.sweep import Row, Sweep


@pytest.fixture(scope="module")
def pair():
    return ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)


@pytest.fixture(scope="module")
def curve(pair):
    orbit = next(o for o in ci.find_orbits(pair, "1:1", parameter="s") if o.physical)
    branch = ci.continue_orbit(orbit, range=(0.3, 0.4), events=["G"])
    few = ci.Settings(max_points=6)
    return ci.follow_curve(branch.events[0], None, "r", (0.3, 0.4), (0.2, 0.4), settings=few)


def sweep_of(pair, r, met, way="down"):
    """A sweep that meets these orbits at 0.40, 0.39, ..., or back."""
    rows = []
    for k, name in enumerate(met):
        at = pair.replace(r=r, s=0.4 - 0.01 * (k if way == "down" else len(met) - 1 - k))
        values = {**at.values, "d": at.values["s"] * 0.6225, "gbar": 0.0}
        kind = Kind.COMPLEX if name.endswith("/C") else Kind.PERIODIC
        period = None if kind is Kind.COMPLEX else int(name.partition("/")[2].strip("T") or 1)
        found = Attractor(kind, values, name, 2.0, period=period)
        rows.append(Row(way, at.values["s"], found))
    return Sweep(pair.replace(r=r), "s", rows)


def marks(ax, marker, colour="k"):
    found = [m for m in ax.lines if m.get_marker() == marker and len(m.get_xdata()) == 1]
    return [
        (m.get_xdata()[0], m.get_ydata()[0], m.get_markerfacecolor())
        for m in found
        if m.get_color() == colour
    ]


def test_markers_stand_between_the_values(pair, curve):
    """Filled by what the orbit is reached from."""
    sweeps = [
        sweep_of(pair, 0.25, ["1:1", "1:1", "2:1", "2:1", "3:1"]),
        sweep_of(pair, 0.35, ["2:1", "1:1/2T", "2:1", "2:1"]),  # where it begins is no transition
        sweep_of(pair, 0.36, ["2:1", "2:1"]),
        sweep_of(pair, 0.30, ["1:1/2T", "2:1", "2:1/4T", "3:1"]),
        sweep_of(pair, 0.32, ["1:1", "1:1/C", "2:1"]),
    ]
    ax = ci.plot_transitions([curve], sweeps, to=["2:1", "3:1"], along="s")
    two, three = (marks(ax, MARKS[k]) for k in (0, 1))
    assert two == [
        (0.25, pytest.approx(0.385), "white"),
        (0.35, pytest.approx(0.385), "0.65"),
        (0.30, pytest.approx(0.395), "0.65"),
        (0.32, pytest.approx(0.385), "k"),
    ]
    assert three == [(0.25, pytest.approx(0.365), "white"), (0.30, pytest.approx(0.375), "0.65")]
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert texts[:2] == ["to 2:1 as $s$ falls", "to 3:1 as $s$ falls"]
    assert len(texts) == 5
    assert not any("rises" in text for text in texts)


def test_rising_values_leave_an_orbit_elsewhere(pair, curve):
    """Up to 0.39 the orbit is kept, down it is met at 0.38."""
    both = sweep_of(pair, 0.3, ["1:1", "1:1", "2:1", "2:1"])
    both.rows.extend(sweep_of(pair, 0.3, ["1:1", "2:1", "2:1", "2:1"][::-1], "up").rows)
    ax = ci.plot_transitions([curve], [both], to=["2:1"], along="s")
    assert [value for _, value, _ in marks(ax, MARKS[0])] == pytest.approx([0.385])
    assert marks(ax, MARKS[0], RISING) == [(0.3, pytest.approx(0.395), "none")]
    assert ax.get_legend().get_texts()[-1].get_text() == "left as $s$ rises"


def test_directions_are_those_of_the_y_axis(pair, curve):
    """Where the y axis is the reciprocal of what is swept, rising values are falling ones."""
    rows = sweep_of(pair, 0.3, ["1:1", "2:1"][::-1], "up").rows
    turned = [
        dataclasses.replace(
            row,
            attractor=dataclasses.replace(
                row.attractor, parameters={**row.attractor.parameters, "d": 0.1 / row.value}
            ),
        )
        for row in rows
    ]
    ax = ci.plot_transitions([curve], [Sweep(pair, "s", turned)], to=["1:1"], along="d")
    assert len(marks(ax, MARKS[0])) == 1
    assert not marks(ax, MARKS[0], RISING)


def test_what_does_not_fit_is_refused(pair, curve):
    other = dataclasses.replace(curve, parameters=("s", "A"))
    with pytest.raises(ci.InputError, match=r"^curves: 2 pairs"):
        ci.plot_transitions([curve, other], [], to=["2:1"])
    with pytest.raises(ci.InputError, match=r"^sweeps: one is in A; give sweeps in s"):
        ci.plot_transitions([curve], [Sweep(pair, "A", [])], to=["2:1"])
