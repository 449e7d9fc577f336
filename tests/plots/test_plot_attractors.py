"""Pictures of simulated motion: what differs is told apart, nothing hides what lies beneath it."""

from __future__ import annotations

import dataclasses
import math
import tomllib

import numpy as np
import pytest
from matplotlib.colors import to_hex
from zoo import ROOT

from contimpact.diagrams.explore import follow
from contimpact.diagrams.scene_simulation import Simulation
from contimpact.plots import attractors as pictures
from contimpact.plots.attractors import names_of_gaps, others_at, plot_portrait, portrait_figure
from contimpact.plots.diagram import STYLES, WIDTHS
from contimpact.results.options import Settling
from contimpact.results.scene import read_model, read_scene
from contimpact.simulation.run import State
from contimpact.simulation.settle import settle
from contimpact.simulation.simulator import Simulator
from contimpact.simulation.sweep import Row, Simulators, Sweep, sweep
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.membrane import Membrane
from contimpact.systems.oscillator import Oscillator

QUICK = Settling(transient=50, periods=800, impacts=1500)
SCENE = ROOT / "branches" / "fig7" / "scene.toml"


@pytest.fixture(scope="module")
def simulation(kernels_of):
    """Fig. 7 between s = 0.35 and 0.36 down and up: 2:1 lives longer upwards."""
    given = tomllib.loads(SCENE.read_text(encoding="utf-8"))
    given["follow"]["depth"] = 1
    scene = read_scene(given)
    kernels = kernels_of(scene.model, "s")
    values = [0.35, 0.3535, 0.3562, 0.3585]
    rows = []
    for way, start in ((values[::-1], State(0, 0.25, 0.6)), (values, State(0, 0.1, 0.6))):
        rows += sweep(scene.model, "s", way, start=start, settling=QUICK, kernels=kernels).rows
    return Simulation(scene, Sweep(scene.model, "s", rows), diagram=follow(scene))


def marked(ax, marker):
    return [line for line in ax.lines if line.get_marker() == marker]


@pytest.mark.full
def test_the_second_direction_shows_other_attractors_alone(simulation):
    """At 0.3562 the sweep up still has 2:1 where that down is complex; elsewhere they agree."""
    ax = pictures.plot_sweep(simulation.sweep, diagram=simulation.diagram)
    crosses = [line for line in marked(ax, "x") if len(line.get_xdata())]
    assert {float(x) for line in crosses for x in line.get_xdata()} == {0.3562}
    counts = {to_hex(line.get_color()): len(line.get_xdata()) for line in crosses}
    assert counts == {pictures.style.COLOURS[0].lower(): 2, pictures.style.COLOURS[1].lower(): 1}
    texts = [t.get_text() for t in ax.get_legend().get_texts()]
    assert texts[-2:] == [
        r"simulated, $s$ falling ($\leftarrow$)",
        r"simulated, $s$ rising ($\rightarrow$): others",
    ]


def test_circles_are_the_sweep_along_which_the_drawn_axis_falls(simulation):
    """Over -s the sweep with s rising comes first, as that with A rising does over d."""
    turned = [
        dataclasses.replace(
            row,
            attractor=dataclasses.replace(
                row.attractor, parameters={**row.attractor.parameters, "d": -row.value}
            ),
        )
        for row in simulation.sweep.rows
    ]
    ax = pictures.plot_sweep(Sweep(simulation.scene.model, "s", turned), x="d")
    texts = [t.get_text() for t in ax.get_legend().get_texts()]
    assert texts[-2:] == [
        r"simulated, $s$ rising ($\leftarrow$)",
        r"simulated, $s$ falling ($\rightarrow$): others",
    ]
    named = [t.get_text() for t in ax.texts if t.get_gid() == "attractor"]
    assert "2:1" in named


@pytest.mark.parametrize("y", ["velocity", "moduli"])
def test_limits_of_another_quantity_are_not_those_of_velocities(
    simulation, y, tmp_path, monkeypatch
):
    limits, plot = list[object](), pictures.plot_sweep
    monkeypatch.setattr(
        pictures, "plot_sweep", lambda *_, **o: limits.append(o["ylim"]) or plot(*_, **o)
    )
    options = dataclasses.replace(simulation.scene.plot, y=y, ylim=(-0.5, 0.7), formats=())
    pictures.save_simulation(simulation, tmp_path, options)
    assert limits == [(-0.5, 0.7) if y == "velocity" else None]


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_no_simulated_impact_is_outside_the_frame(simulation, factor):
    """Impacts that are faster than those of all branches were not seen."""
    faster = [
        dataclasses.replace(
            row,
            attractor=dataclasses.replace(
                row.attractor, velocities=factor * row.attractor.velocities
            ),
        )
        for row in simulation.sweep.rows
    ]
    sweep = Sweep(simulation.scene.model, "s", faster)
    ax = pictures.plot_sweep(sweep, diagram=simulation.diagram)
    seen = np.concatenate([line.get_ydata() for line in marked(ax, "o")])
    low, high = ax.get_ylim()
    assert low < np.nanmin(seen) < np.nanmax(seen) < high


def test_values_of_a_parameter_are_written_in_full(simulation):
    """Exponents of `stiff` stood over -0.2 to 0.8, and +3e3 in a corner."""
    rows = [
        dataclasses.replace(
            row,
            attractor=dataclasses.replace(
                row.attractor, parameters={**row.attractor.parameters, "s": 3000.0 + row.value}
            ),
        )
        for row in simulation.sweep.rows
    ]
    sweep = Sweep(simulation.scene.model, "s", rows)
    for ax in (pictures.plot_exponents(sweep), pictures.plot_sweep(sweep)):
        ax.figure.draw_without_rendering()
        assert ax.xaxis.get_offset_text().get_text() == ""


def test_complex_motion_that_sticks_is_marked_as_sticking():
    pair = ImpactPair(beta=0.9, r_B=0.6, r_T=0.35, A=4.0, s=1.5, M=0.3, omega=9.0)
    found = sweep(pair, "s", [1.5, 1.49])
    assert [row.attractor.kind.value for row in found.rows] == ["complex", "complex"]
    (line,) = marked(pictures.plot_exponents(found), "v")
    assert len(line.get_xdata()) == 2


@pytest.mark.full
def test_attractors_do_not_hide_branches(simulation):
    ax = pictures.plot_sweep(simulation.sweep, diagram=simulation.diagram)
    circles = [
        line
        for line in marked(ax, "o")
        if line.get_markerfacecolor() == "none" and len(line.get_xdata())
    ]
    branches = [line for line in ax.lines if line.get_linewidth() == WIDTHS["stable"]]
    assert len(circles) == 2  # one for each wall
    assert branches
    assert max(c.get_zorder() for c in circles) < min(line.get_zorder() for line in branches)


@pytest.mark.parametrize("with_branches", [True, False])
@pytest.mark.full
def test_the_legend_is_inside_the_figure(simulation, with_branches):
    diagram = simulation.diagram if with_branches else None
    ax = pictures.plot_sweep(simulation.sweep, diagram=diagram)
    ax.figure.draw_without_rendering()
    box = ax.get_legend().get_window_extent()
    width, height = ax.figure.get_size_inches() * ax.figure.dpi
    assert box.x0 >= 0.0
    assert box.y0 >= 0.0
    assert box.x1 <= width
    assert box.y1 <= height


def test_energy_has_the_styles_of_physical_orbits(simulation):
    ax = pictures.plot_energy(Membrane(), simulation.sweep, diagram=simulation.diagram)
    texts = [t.get_text() for t in ax.get_legend().get_texts()]
    assert {"stable", "unstable"} <= set(texts)
    assert "unphysical" not in texts
    drawn = {line._unscaled_dash_pattern for line in ax.lines if line.get_marker() == "None"}
    assert len(drawn) == len({"stable", "unstable", "status unknown"} & set(texts))
    assert not any("accumulate" in text for text in texts)


def test_energy_says_where_impacts_accumulate(simulation):
    row = simulation.sweep.rows[0]
    sticking = dataclasses.replace(row.attractor, kind=pictures.Kind.STICKING)
    swept = Sweep(simulation.scene.model, "s", [Row("down", row.value, sticking)])
    ax = pictures.plot_energy(Membrane(), swept)
    assert any("accumulate" in t.get_text() for t in ax.get_legend().get_texts())


@pytest.fixture(scope="module")
def portrait(simulation, kernels_of):
    """At the ghost grazing of 1:1, where the unstable 1:1 and 2:1 all but coincide."""
    model = simulation.scene.model
    simulator = Simulators(model, "s", kernels_of(model, "s")).at(0.329)
    attractor = settle(simulator, State(0, 0.1, 0.6), QUICK)
    others = others_at(simulation, Row("down", 0.329, attractor), simulator)
    return simulator, attractor, others


def test_dashes_tell_the_state(portrait):
    """As in diagrams, whatever the order of the orbits."""
    simulator, attractor, others = portrait
    assert {label.rpartition(" ")[2] for label in others} == {"unstable", "unphysical"}
    for order in (list(others), list(others)[::-1]):
        ax = plot_portrait(simulator, attractor, others={k: others[k] for k in order})
        handles = {h.get_label(): h for h in ax.get_legend().legend_handles}
        assert handles.pop(attractor.notation).get_linestyle() == "-"
        for label, handle in handles.items():
            dashes = handle._unscaled_dash_pattern[1]
            assert tuple(dashes) == STYLES[label.rpartition(" ")[2]][1]


def test_no_orbit_hides_another(portrait):
    """Those drawn later are narrower, and all differ in colour from each other and the walls."""
    simulator, attractor, others = portrait
    ax = plot_portrait(simulator, attractor, others=others)
    handles = ax.get_legend().legend_handles[1:]
    widths = [handle.get_linewidth() for handle in handles]
    assert widths == sorted(widths, reverse=True)
    assert len(set(widths)) == len(widths) == 3
    colours = [handle.get_color() for handle in handles]
    assert len({*colours, *pictures.style.COLOURS[:2]}) == len(colours) + 2


@pytest.mark.full
def test_a_portrait_names_all_parameters(simulation, portrait):
    simulator, attractor, others = portrait
    figure = portrait_figure(simulator, attractor, others)
    pictures._head(figure, simulation, attractor.parameters)
    text = figure.get_suptitle()
    assert text.startswith("fig7: ")
    assert "$s$ = 0.329 m" in text
    assert "$d$ = 0.204802" in text
    figure.draw_without_rendering()


@pytest.mark.full
def test_basins_name_value_and_starts(simulation, kernels_of):
    from contimpact.simulation.sweep import basins

    model = simulation.scene.model
    simulator = Simulators(model, "s", kernels_of(model, "s")).at(0.3562)
    found = basins(simulator, shape=(3, 4), settling=QUICK)
    ax = pictures.plot_basins(found)
    assert sorted(ax.get_title(loc="right").split()[::2][:2]) == ["3", "4"]
    assert not any(marks.get_clip_on() for marks in ax.lines)  # at the edge, too
    pictures._head(ax.figure, simulation, found.parameters)
    assert "$s$ = 0.3562 m" in ax.figure.get_suptitle()
    assert np.sum(found.shares) == pytest.approx(1.0)


def test_a_portrait_of_motion_without_impacts_draws_it():
    """Both axes were empty."""
    model = Oscillator(a=1.0, omega=2.5, c=0.1, k=1.0, sigma=0.5, r=0.8)
    simulator = Simulator(model)
    attractor = settle(simulator, simulator.state("S", time=1.2, velocity=0.1))
    assert not attractor.times.size
    left, right = portrait_figure(simulator, attractor, {}).axes
    size = 1.0 / math.hypot(1.0 - 2.5**2, 0.1 * 2.5)
    position, velocity = left.lines[0].get_data()
    assert [position.max(), velocity.max()] == pytest.approx([size, 2.5 * size], rel=1e-3)
    times, again = right.lines[0].get_data()
    assert (times[0], times[-1], again.max()) == pytest.approx((0.0, 4.0, size), rel=1e-3)
    left, right = portrait_figure(simulator, dataclasses.replace(attractor, motion=None), {}).axes
    assert (left.axison, right.axison) == (False, False)


def test_a_portrait_of_motion_in_another_mode_is_that_of_the_mode():
    """It was refused as no orbit of the model: it was looked for in the first mode. Beyond C the
    mass is held about 13/12 by a spring of stiffness 6."""
    free = "cos(2*t) - 3/10*v - x"
    model = {
        "system": "hybrid",
        "period": "pi",
        "parameters": {"e": 0.5},
        "modes": {"free": {"x": "v", "v": free}, "held": {"x": "v", "v": f"{free} + 13/2 - 5*x"}},
        "guards": {
            "C": {"mode": "free", "within": "x <= e", "to": "held"},
            "R": {"mode": "held", "within": "x >= e", "to": "free"},
        },
    }
    follow = {"parameter": "e", "range": [0.4, 0.6], "orbits": ["0"]}
    scene = read_scene({"name": "magnet", "model": model, "follow": follow})
    simulator = Simulator(scene.model)
    attractor = settle(simulator, simulator.start(0.0, 1.5, 0.2, "held"), mode="held")
    left, _ = portrait_figure(simulator, attractor, {}).axes
    position, _ = left.lines[0].get_data()
    size = 1.0 / math.hypot(6.0 - 2.0**2, 0.3 * 2.0)
    assert position.max() == pytest.approx(13 / 12 + size, rel=1e-3)
    assert position.min() == pytest.approx(13 / 12 - size, rel=1e-3)


def test_axes_of_portraits_have_the_names_of_the_system():
    """They were all called Z."""
    rates = {"x": "u", "u": "-x - u", "y": "2*x - y", "z_1": "-z_1"}
    guards = {"A": "x <= 1", "B": "x >= -1", "C": "z_1 - 2*y <= 3"}
    model = {
        "system": "hybrid",
        "period": 1,
        "parameters": {},
        "modes": {"in": rates},
        "guards": {letter: {"within": text} for letter, text in guards.items()},
    }
    assert names_of_gaps(read_model(model)) == (
        "$x$, $z_{1}$ $-$ 2 $y$",
        "$u$, rate of $z_{1}$ $-$ 2 $y$",
    )
    assert names_of_gaps(Oscillator(a=1.0, omega=2.5, c=0.1, k=1.0, sigma=0.5, r=0.8)) == (
        "$Z$",
        r"$\dot{Z}$",
    )


def test_walls_of_a_stated_system_have_one_colour_in_all_pictures():
    """Guards are not in the order of the alphabet: circles had the colour of the other wall."""
    model = {
        "system": "linear",
        "coordinates": ["x"],
        "mass": [1],
        "damping": [0.1],
        "force": ["3/10 + cos(w*t)"],
        "period": "2*pi/w",
        "guards": {
            "R": {"within": "x <= 0.5", "restitution": 0.6},
            "L": {"within": "x >= -0.5", "restitution": 0.6},
        },
        "parameters": {"w": 2.8},
    }
    given = {"parameter": "w", "range": [2.3, 2.9], "orbits": ["RL"]}
    scene = read_scene({"name": "rattle", "model": model, "follow": given})
    diagram = follow(scene)
    found = sweep(scene.model, "w", [2.4, 2.3], settling=QUICK)
    assert {tuple(row.attractor.word) for row in found.rows} == {("R", "L")}
    ax = pictures.plot_sweep(found, diagram=diagram)
    stable = {line.get_color() for line in ax.lines if line.get_linestyle() == "-"}
    hits = {True: set(), False: set()}
    for line in ax.lines:
        speeds = line.get_ydata()
        if line.get_color() in stable and len(speeds) and np.all(np.abs(speeds) > 0.5):
            hits[bool(speeds[0] > 0)].add(line.get_color())
    assert hits == {True: {pictures.style.COLOURS[0]}, False: {pictures.style.COLOURS[1]}}
