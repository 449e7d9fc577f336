"""Diagrams of other quantities than velocities: where events stand, and what is asked for how."""

from __future__ import annotations

import numpy as np
import pytest
from test_plot import curves, fig7, marks, scene_of

import contimpact as ci
from contimpact.cli import main
from contimpact.plots.lines import _break_line

__all__ = ["fig7"]


@pytest.mark.full
def test_multipliers_are_one_at_folds_and_minus_one_at_doublings(fig7):
    ax = ci.plot_diagram(fig7, x="d", y="multipliers", unphysical="all")
    at = {e.parameters["d"]: e.kind for e in fig7.entries}
    reached = {at[m.get_xdata()[0]]: [] for m in marks(ax)}
    for mark in marks(ax):
        reached[at[mark.get_xdata()[0]]].append(float(mark.get_ydata()[0]))
    assert min(abs(v - 1.0) for v in reached["FB"]) < 1e-6
    assert min(abs(v + 1.0) for v in reached["PD"]) < 1e-9
    assert ax.get_ylabel() == "multipliers (real parts)"
    low, high = ax.get_ylim()
    assert -3.5 < low < -1.0 < 1.0 < high < 3.5
    texts = [t.get_text() for t in ax.get_legend().get_texts()]
    assert texts[:2] == ["multiplier 1", "multiplier 2"]


def test_no_line_runs_through_infinity():
    places, values = _break_line(np.arange(4.0), np.array([2.0, 90.0, -70.0, -2.0]))
    assert np.isnan(values).tolist() == [False, False, True, False, False]
    assert len(places) == 5


@pytest.mark.parametrize("y", ["moduli", "energy", "U_I", "U_T", "gap", "period", "t2", "residual"])
@pytest.mark.full
def test_every_quantity_is_drawn(fig7, y):
    ax = ci.plot_diagram(fig7, x="d", y=y, xlim=(0.13, 0.25))
    low, high = ax.get_ylim()
    assert all(np.isfinite((low, high)))
    assert any(
        ((low <= line.get_ydata()) & (line.get_ydata() <= high)).any() for line in curves(ax)
    )
    assert ax.get_ylabel()


@pytest.mark.full
def test_a_function_of_the_branch(fig7):
    ax = ci.plot_diagram(fig7, y=lambda branch: {"slowest": abs(branch.velocities).min(axis=1)})
    assert ax.get_legend().get_texts()[0].get_text() == "slowest"
    top = max(line.get_ydata().max() for line in curves(ax))
    assert top == max(abs(b.velocities).min(axis=1).max() for b in fig7.branches)


def test_a_scene_asks_for_a_quantity(tmp_path):
    given = {**scene_of("fig7").resolved(), "plot": {"x": "d", "y": "multipliers"}}
    assert ci.read_scene(given).plot.y == "multipliers"
    given["plot"]["y"] = "speed"
    with pytest.raises(ci.InputError, match=r"plot\.y: found 'speed'; accepted are velocity, mult"):
        ci.read_scene(given)
    stop = {**scene_of("stop").resolved(), "plot": {"y": "energy"}}
    with pytest.raises(ci.InputError, match=r"plot\.y: .* has no membranes"):
        ci.read_scene(stop)


@pytest.mark.full
def test_the_command_draws_a_quantity(fig7, tmp_path, capsys):
    ci.write_diagram(fig7, tmp_path)
    assert main(["plot", str(tmp_path), "-y", "multipliers", "-o", str(tmp_path / "m.svg")]) == 0
    assert (tmp_path / "m.svg").stat().st_size > 10_000
    assert main(["plot", str(tmp_path), "-y", "speed"]) == 2
    assert "accepted are velocity, multipliers" in capsys.readouterr().err
