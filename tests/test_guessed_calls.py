"""Calls as users guess them: they work, or are refused with the right call."""

from __future__ import annotations

import math

import numpy as np
import pytest

import contimpact as ci
from contimpact.errors import InputError

PAIR = {"r": 0.3, "A": 5.0, "s": 0.5}
SCENE = {
    "name": "short",
    "model": {"system": "impact-pair", "parameters": {"beta": "pi/6", **PAIR}},
    "follow": {"parameter": "s", "range": [0.3, 0.6], "orbits": ["1:1"]},
}


@pytest.fixture(scope="module")
def model():
    return ci.ImpactPair(beta="pi/6", **PAIR)


@pytest.fixture(scope="module")
def branch(model):
    return ci.continue_orbit(ci.find_orbits(model, "1:1", "s")[0], "s", (0.3, 0.6))


def test_parameters_are_expressions_as_in_scenes(model):
    assert model == ci.ImpactPair(beta=math.pi / 6, **PAIR)
    with pytest.raises(InputError, match=r"30 degrees are math.radians\(30\)"):
        ci.ImpactPair(beta=30, **PAIR)
    with pytest.raises(InputError, match="beta"):
        ci.ImpactPair(beta="pi/", **PAIR)


def test_a_model_gives_the_values_of_its_parameters(model):
    assert model["s"] == 0.5
    assert model["d"] == pytest.approx(
        0.1245 * (5 * math.pi) ** 2 * 0.5 / (5 * math.pi**2), rel=1e-15
    )
    assert model.parameters == {name: model[name] for name in (*model.values, "d", "gbar")}
    with pytest.raises(InputError, match="no parameter 'q'"):
        model["q"]


def test_an_event_is_found_by_its_kind(branch):
    diagram = ci.Diagram("one", [branch])
    assert diagram["PD"] is diagram["PD1"] is branch.events[1]
    assert branch.orbit("PD").value == branch.orbit("e2").value
    with pytest.raises(InputError, match="folds are FB here"):
        diagram["LP"]
    with pytest.raises(InputError, match="folds are FB here"):
        ci.continue_orbit(branch.orbit(0), "s", (0.3, 0.6), events=["LP"])
    with pytest.raises(KeyError, match=r"branch.orbit\('e1'\)"):
        branch["e1"]


def test_several_events_of_a_kind_have_numbers(branch):
    diagram = ci.Diagram("two", [branch, branch])
    assert diagram["PD2"] is branch.events[1]
    for name in ("PD", "PD0", "PD3"):
        with pytest.raises(InputError, match="PD1 to PD2"):
            diagram[name]


def test_rows_of_a_branch(branch):
    rows = branch[3:5]
    assert list(rows) == list(branch.columns)
    assert np.array_equal(rows["s"], branch["s"][3:5])
    assert branch.name == branch.id


def test_follow_reads_a_scene(tmp_path):
    diagram = ci.follow(SCENE)
    (tmp_path / "short.toml").write_text(
        """name = "short"
        [model]
        system = "impact-pair"
        parameters = {beta = "pi/6", r = 0.3, A = 5.0, s = 0.5}
        [follow]
        parameter = "s"
        range = [0.3, 0.6]
        orbits = ["1:1"]
        """
    )
    assert ci.follow(tmp_path / "short.toml").branches == diagram.branches


def test_what_is_missing_is_called_missing(model):
    with pytest.raises(InputError, match="range: missing; give"):
        ci.continue_orbit(ci.find_orbits(model, "1:1", "s")[0])
    with pytest.raises(InputError, match="no such file or folder"):
        ci.load("nope")


def test_results_are_plotted_by_their_method(branch):
    diagram = ci.Diagram("one", [branch])
    for result in (branch, diagram):
        axes = result.plot(xlim=(0.3, 0.6), unphysical="all")
        assert axes.get_xlim() == (0.3, 0.6)
    for result in (branch.orbit(0), diagram["PD"]):
        plane, series = result.plot(periods=3)
        assert plane.figure is series.figure
    assert np.ptp(ci.plot(branch.orbit(0), periods=5)[1].get_xlim()) > 4.0
    with pytest.raises(InputError, match="found a list"):
        ci.plot([])
