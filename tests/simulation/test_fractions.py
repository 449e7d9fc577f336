"""Basin fractions: counts, intervals, the same motion along a parameter, and what tips."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest
from scipy import stats
from zoo import ROOT, TWO_MASSES, ProportionalMasses

import contimpact as ci
from contimpact.cli import main
from contimpact.errors import InputError
from contimpact.plots.attractors import plot_fractions, plot_sweep
from contimpact.results.options import Settling
from contimpact.simulation import integrity
from contimpact.simulation.integrity import basin_fractions, join_values, require_starts, start_box
from contimpact.simulation.settle import settle_again
from contimpact.simulation.simulator import Simulator
from contimpact.simulation.sweep import Simulators, find_attractors, sweep
from contimpact.systems.duffing import Duffing
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.two_masses import TwoMasses

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

PAIR = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.4)


@pytest.fixture(scope="module")
def found():
    """From 2:1 alone over both motions to complex motion alone, which becomes 1:1."""
    return basin_fractions(PAIR, "s", [0.35, 0.3562, 0.36, 0.38, 0.4], starts=40)


@pytest.mark.full
def test_bands_are_motions_whatever_they_are_called(found):
    assert found.motions == ["2:1", "1:1/C, 1:1/2T, 1:1"]
    assert found.counts.sum(axis=1).tolist() == [40] * 5
    assert (found.counts[:, 0] > 0).tolist() == [True, True, False, False, False]
    texts = [str(tipping) for tipping in found.tippings]
    assert texts == [
        "1:1/C, 1:1/2T, 1:1 appears between 0.35 and 0.3562",
        "2:1 vanishes between 0.3562 and 0.36",
    ]
    assert [row[2] for row in found.rows()] == ["2:1", "2:1", "1:1/C", "1:1/C", "1:1/2T", "1:1"]
    assert "40 starts at 5 values of s" in repr(found)


def test_twins_are_matched_by_their_orbits():
    """Of a level pair 1:1 has a mirror image, with the same counts of impacts."""
    level = ImpactPair(beta=0.0, r=0.3, A=5.0, s=0.35)
    simulators = Simulators(level, "s")
    twins = find_attractors(simulators.at(0.35), 8)
    assert [one.notation for one in twins] == ["1:1", "1:1"]
    later = [settle_again(simulators.at(0.352), one) for one in twins]
    count = np.array([5])
    for k in (0, 1):
        for other in (0, 1):
            counted = {0.35: ([twins[k]], count), 0.352: ([later[other]], count)}
            found = join_values(simulators, counted, 5, 0.95)
            assert len(found.motions) == (1 if k == other else 2)
            assert len(found.tippings) == (0 if k == other else 2)


def test_an_interruption_leaves_the_values_counted(monkeypatch):
    count = integrity._count

    def interrupted(simulator, *given):
        if simulator.model["s"] == 0.36:
            raise KeyboardInterrupt
        return count(simulator, *given)

    monkeypatch.setattr(integrity, "_count", interrupted)
    found = basin_fractions(PAIR, "s", [0.35, 0.36, 0.38], starts=3)
    assert (found.values, found.interrupted) == ([0.35], True)
    with pytest.raises(KeyboardInterrupt):
        basin_fractions(PAIR, "s", [0.36], starts=3)


@pytest.mark.full
def test_fractions_are_those_of_a_hundred_thousand_starts():
    """Counted by a program of its own, in C, over 250 periods: 0.34799 of them lead to 2:1."""
    found = basin_fractions(PAIR, "s", [0.3562], starts=400)
    k = found.motions.index("2:1")
    low, high = found.intervals
    assert low[0, k] < 0.34799 < high[0, k]


@pytest.mark.full
def test_intervals_are_exact(found):
    low, high = found.intervals
    for k, interval in zip(
        found.counts.ravel(), zip(low.ravel(), high.ravel(), strict=True), strict=True
    ):
        exact = stats.binomtest(int(k), 40).proportion_ci(0.95, method="exact")
        assert interval == pytest.approx((exact.low, exact.high), abs=1e-12)


def test_intervals_at_the_ends_of_a_picture_are_seen(found):
    low, high = plot_fractions(found).get_xlim()
    assert low < min(found.values)
    assert max(found.values) < high


def test_bands_of_a_single_value_have_a_width():
    found = basin_fractions(PAIR, "s", [0.3562], starts=12)
    ax = plot_fractions(found)
    low, high = ax.get_xlim()
    assert low < 0.3562 < high < 0.36
    assert ax.get_xticks().tolist() == [0.3562]
    tops = [band.get_paths()[0].vertices for band in ax.collections if band.get_hatch() is not None]
    assert all(np.ptp(band[:, 0]) == pytest.approx(high - low) for band in tops)
    assert max(band[:, 1].max() for band in tops) == pytest.approx(1.0)


@pytest.mark.full
def test_values_are_put_where_fractions_differ():
    found = basin_fractions(PAIR, "s", [0.34, 0.345, 0.36], starts=12, refine=2)
    assert found.values == pytest.approx([0.34, 0.345, 0.3525, 0.35625, 0.36])
    again = basin_fractions(PAIR, "s", [0.345], starts=12)
    assert again.counts.tolist() == [[12]]


def test_boxes_are_stated_in_physical_terms():
    simulator = Simulator(PAIR)
    default = start_box(simulator)
    assert default.time == (0.0, 2.0)
    assert default.positions is None
    rng = np.random.default_rng(1)
    for _ in range(50):
        time, (x,), (v,) = default.draw(simulator, rng)
        assert 0.0 <= time < 2.0
        assert abs(x) <= simulator.derived["d"] / 2.0
        assert abs(v) <= simulator.fastest
    half_a_period = 0.5 * simulator.period * (1.0 + simulator.derived["gbar"])
    assert simulator.fastest == pytest.approx(half_a_period, rel=1e-12)
    given = start_box(simulator, {"position": [0.0, 0.1], "velocity": [0.5, 0.5]})
    _, (x,), (v,) = given.draw(simulator, rng)
    assert 0.0 <= x <= 0.1
    assert v == 0.5


def test_refusals():
    for box, said in [
        ({"phase": [0, 1]}, "unknown key 'phase'"),
        ({"position": [0.2, 0.1]}, r"box\.position"),
        ({"velocity": "fast"}, r"box\.velocity"),
    ]:
        with pytest.raises(InputError, match=said):
            start_box(Simulator(PAIR), box)
    one = Oscillator(a=1.0, omega=1.3, c=0.1, k=1.0, sigma=0.5, r=0.8)
    with pytest.raises(InputError, match=r"box\.position"):
        basin_fractions(one, "omega", [1.3], starts=2)
    with pytest.raises(InputError, match="no values"):
        basin_fractions(PAIR, "s", [])
    for values, more, said in [
        (0.36, {}, "values: found 0.36; give values of the parameter"),
        (["a"], {}, "values: found"),
        ([0.36], {"starts": "many"}, "starts: found 'many'; give a whole number from 1 to"),
        ([0.36], {"refine": -1}, "refine: found -1; give a whole number from 0 to 10"),
        ([0.36], {"starts": 3, "box": [1, 2]}, "box: found"),
    ]:
        with pytest.raises(InputError, match=re.escape(said)):
            basin_fractions(PAIR, "s", values, **more)


@pytest.mark.full
def test_several_bodies():
    """Both coordinates of a box are drawn, again where a guard lies before the start."""
    box = {"position": [[-2.0, 0.9], [-1.0, 1.0]], "velocity": [[-2.0, 2.0], [-2.0, 2.0]]}
    model = TwoMasses(**{**TWO_MASSES, "omega": 1.8})
    found = basin_fractions(model, "omega", [1.8], starts=20, box=box)
    assert found.counts.sum() == 20
    assert found.motions == ["1:0"]
    with pytest.raises(InputError, match="2 pairs"):
        basin_fractions(model, "omega", [1.8], starts=2)


SCENE = """
name = "counted"
[model]
system = "impact-pair"
parameters = { beta = "pi/6", r = 0.3, A = 5.0, s = 0.4 }
[follow]
parameter = "s"
range = [0.34, 0.4]
orbits = ["1:1"]
[plot]
formats = ["png"]
[simulate]
values = 2
transitions = false
fractions = [0.35, 0.4]
fraction_starts = 5
box = { position = [-0.1, 0.1], velocity = [0.0, 1.0] }
"""


@pytest.mark.full
def test_a_scene_counts_fractions_and_draws_them(tmp_path, capsys):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE, encoding="utf-8")
    assert main(["simulate", str(path), "-o", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "2:1 vanishes between 0.35 and 0.4" in printed
    head, names, *rows = (tmp_path / "out/fractions.csv").read_text("utf-8").splitlines()
    assert json.loads(head[2:]) == {
        "schema": "contimpact.fractions/1",
        "parameter": "s",
        "starts": 5,
        "confidence": 0.95,
    }
    columns = "s,motion,notation,count,fraction,low,high,word,period,time,velocity"
    assert names == columns
    cells = [row.split(",") for row in rows]
    assert [row[:5] + row[7:9] for row in cells] == [
        ["0.35", "1", "2:1", "5", "1.0", "BBT", "1"],
        ["0.4", "2", "1:1", "5", "1.0", "BT", "1"],
    ]
    orbits = ci.find_orbits(PAIR, "1:1", "s")
    first = next([o.times[0], o.velocities[0]] for o in orbits if o.stable and o.physical)
    assert [float(cell) for cell in cells[1][9:]] == pytest.approx(first, abs=1e-10)
    assert (tmp_path / "out/fractions.png").stat().st_size > 0
    assert main(["plot", str(tmp_path / "out"), "-o", str(tmp_path / "again.png")]) == 0
    assert (tmp_path / "again.png").read_bytes()[16:24] == (
        tmp_path / "out/attractors.png"
    ).read_bytes()[16:24]  # its size


def test_integrated_flights_start_anywhere():
    """Of 120 that are integrated by other means 108 lead to impacts; they were refused."""
    pytest.importorskip("heyoka")
    model = Duffing(a=0.5, omega=1.8, c=0.1, alpha=1.0, beta=0.2, sigma=0.3, r=0.8)
    box = {"position": [-0.6, 0.25], "velocity": [-0.5, 0.5]}
    quick = Settling(transient=60, periods=300)
    found = basin_fractions(model, "omega", [1.8], starts=40, box=box, settling=quick)
    counts = dict(zip(found.motions, found.fractions[0], strict=True))
    assert set(counts) == {"1", "no impact"}
    assert 0.75 < counts["1"] < 1.0


def test_a_box_beyond_the_walls_is_named_as_in_the_scene(tmp_path, capsys):
    path = tmp_path / "scene.toml"
    text = (ROOT / "branches/fig7/scene.toml").read_text("utf-8").partition("\n[simulate]")[0]
    given = "\n[simulate]\nfractions = [0.36]\nbox = { position = [5, 6] }\n"
    path.write_text(text + given, encoding="utf-8")
    assert main(["simulate", str(path), "-o", str(tmp_path / "out")]) == 2
    assert "simulate.box.position: 1000 starts in a row beyond" in capsys.readouterr().err


def test_flights_that_start_at_guards_are_refused():
    """Those of a closed form that a system of one's own states."""
    model = ProportionalMasses(k1=1.0, k2=0.6, omega=0.3, r=0.3, a=2.0, c=0.07, sigma=0.0)
    said = (
        r"simulate\.box\.position: the flights of two-proportional-masses are known from guards on"
    )
    with pytest.raises(InputError, match=said):
        require_starts(Simulator(model), {"position": [[-0.1, 0.0], [0.0, 0.1]]})


@pytest.mark.full
def test_bands_are_drawn_below_the_diagram(found):
    ax = plot_sweep(sweep(PAIR, "s", [0.4, 0.38, 0.36]), x="d", fractions=found.shares)
    upper, lower = ax.figure.axes
    assert upper is ax
    assert lower.get_xlim() == upper.get_xlim()
    (left, bottom, width, _), below = (a.get_position().bounds for a in (upper, lower))
    assert below[::2] == pytest.approx((left, width))
    assert below[1] + below[3] < bottom
    paths = [path for band in lower.collections for path in band.get_paths()]
    heights = {float(y) for path in paths for y in path.vertices[:, 1]}
    assert {0.0, 1.0, float(found.fractions[1, 0])} <= heights
    labels = [text.get_text() for text in lower.get_legend().texts]
    assert labels[-2:] == ["2:1", "1:1/C, 1:1/2T, 1:1"]


def test_what_a_scene_says_of_a_box_is_checked(tmp_path, capsys):
    for box, said in [
        ("{ speed = [0, 1] }", "simulate.box: unknown key 'speed'"),
        ("{ velocity = [1, 0] }", "simulate.box.velocity: found [1, 0]; give low and high"),
        ("3", "simulate.box: found 3"),
    ]:
        path = tmp_path / "scene.toml"
        path.write_text(re.sub(r"box = .*", f"box = {box}", SCENE), encoding="utf-8")
        assert main(["check", str(path)]) == 2
        assert said in capsys.readouterr().err
