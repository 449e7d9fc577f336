"""Phase planes and time series of orbits."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import contimpact as ci
from contimpact.plots.lines import STYLES
from contimpact.plots.orbit import IMPACT, TOUCH


@pytest.fixture(scope="module")
def branch():
    pair = ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    orbit = next(o for o in ci.find_orbits(pair, "1:1", parameter="s") if o.physical)
    return ci.continue_orbit(orbit, "s", range=(0.3, 0.4), events=["PD", "G"])


def lines(ax, orbit):
    """The lines of an orbit's flights, by their number of points."""
    return [line for line in ax.lines if len(line.get_xdata()) > 100]


def test_the_motion_stays_where_it_belongs(branch):
    orbit = branch.orbit(len(branch) - 1)
    plane, series = ci.plot_orbit(orbit)
    half = orbit.parameters["d"] / 2.0
    flights = lines(plane, orbit)
    assert len(flights) == 2
    assert all(np.abs(line.get_xdata()).max() <= half + 1e-12 for line in flights)
    assert max(line.get_ydata().max() for line in flights) == pytest.approx(orbit.velocities[0])
    marks = [line for line in plane.lines if line.get_marker() == IMPACT["marker"]]
    assert sorted(m.get_ydata()[0] for m in marks) == pytest.approx(sorted(orbit.velocities))
    assert series.get_xlabel() == "$t/T$"
    assert series.get_xlim()[1] > 2.0


def test_styles_are_those_of_diagrams_and_a_touch_is_marked(branch):
    stable, ghost = branch.orbit(len(branch) - 1), next(e for e in branch.events if e.kind == "G")
    plane, series = ci.plot_orbit(ghost, (branch, 0), stable)
    looks = [handle.get_linestyle() for handle in plane.get_legend().get_lines()]
    assert looks[-1] == STYLES["stable"]
    texts = [text.get_text() for text in plane.get_legend().get_texts()]
    assert [text.split(", ")[1] for text in texts] == ["unstable", "unphysical", "stable"]
    for ax in (plane, series):
        touches = [
            m for m in ax.lines if m.get_marker() == TOUCH["marker"] and m.get_markersize() == 6
        ]
        assert len(touches) == 1
        assert touches[0].get_markerfacecolor() == "white"


def test_own_axes_and_labels(branch):
    from matplotlib.figure import Figure

    ax = Figure().add_subplot()
    plane, series = ci.plot_orbit(branch.events[0], axes=(None, ax), labels=["mine"])
    assert plane is None
    assert series is ax
    plane, _ = ci.plot_orbit((branch, 3), labels=["$5"])
    assert plane.get_legend().get_texts()[0].get_text() == r"\$5"


@pytest.mark.parametrize(("given", "where"), [((), "orbits"), ((1,), "orbit")])
def test_what_is_no_orbit_is_refused(given, where):
    with pytest.raises(ci.InputError, match=f"^{where}: "):
        ci.plot_orbit(*given)


def test_a_label_for_each(branch):
    with pytest.raises(ci.InputError, match="give 1, one for each orbit"):
        ci.plot_orbit((branch, 3), labels=["a", "b"])


def test_an_attractor_is_drawn_with_its_model(branch):
    pair = ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.4)
    simulator = ci.Simulator(pair)
    attractor = ci.settle(simulator, simulator.state("B", 0.1, 0.6))
    plane, _ = ci.plot_orbit(attractor)
    flights = lines(plane, None)
    assert len(flights) == len(attractor.walls) == 2
    assert max(line.get_ydata().max() for line in flights) == pytest.approx(
        attractor.velocities.max()
    )
    with pytest.raises(ci.InputError, match="give the model it was simulated with as model="):
        ci.plot_orbit(dataclasses.replace(attractor, model=None))


def test_a_diagram_reads_itself(branch):
    diagram = ci.Diagram("one", [branch])
    assert diagram.reading == ci.read(diagram)
    assert diagram.reading.stable
