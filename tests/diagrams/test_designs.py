"""Designs against differences, many starts, and motions simulated by themselves."""

from __future__ import annotations

import copy
import math
import os
import signal
import subprocess
import sys

import numpy as np
import pytest
from mutations import toml

import contimpact as ci
from contimpact.diagrams import design as designs
from contimpact.results.scene import read_scene

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

SCENE = {
    "name": "harvester",
    "model": {
        "system": "impact-pair",
        "parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.34},
    },
    "follow": {"parameter": "s", "range": [0.2, 0.8], "orbits": ["2:1"]},
    "output": {
        "P": {"before_impacts": "U**2", "per": "time"},
        "speed": {"before_impacts": "sqrt(v**2)"},
        "height": "x**2",
    },
    "design": {
        "maximise": "P",
        "bounds": {"s": [0.25, 0.42], "A": [4.5, 5.5]},
        "tolerances": {"s": "2%", "r": "2%"},
        "starts": 4,
        "restarts": 1,
    },
}


def scene(**changes):
    """The scene with other keys of [design]; None takes one away."""
    given = copy.deepcopy(SCENE)
    given["design"] |= changes
    given["design"] = {key: value for key, value in given["design"].items() if value is not None}
    return given


@pytest.fixture(scope="module")
def design():
    return ci.design(scene(margins=[0.99, 1.01]))


@pytest.fixture(scope="module")
def found(design):
    return design.best


@pytest.mark.full
def test_the_margin_is_kept_and_named(found):
    """The distance is that which `find_margins` finds by itself; the price is a difference's."""
    model = found.orbit.model
    tolerances = {"s": 0.02 * model["s"], "r": 0.02 * model["r"]}
    orbit = next(o for o in ci.find_orbits(model, "2:1", parameter="s") if o.stable and o.physical)
    nearest = ci.find_margins(orbit, tolerances, within=3.0).nearest
    assert nearest.distance == pytest.approx(1.0, abs=1e-6)
    assert found.settled
    assert [one.name for one in found.active] == [nearest.label, "bound A = 5.5"]
    power = orbit.mean("U**2", per_time=True, harvester=ci.Membrane()).value
    assert found.value == pytest.approx(power, rel=1e-9)
    assert found.orbit.parameter == "s"
    assert found.orbit.fluctuations({"r": 1e-4}).times == pytest.approx(
        orbit.fluctuations({"r": 1e-4}).times, rel=1e-6
    )


@pytest.mark.full
def test_prices_are_slopes_of_the_trade_off(design):
    low, high = (one.value for one in design.trade_off)
    (price,) = (one.price for one in design.best.active if not one.name.startswith("bound"))
    assert price == pytest.approx((low - high) / 0.02, rel=1e-4)
    rows = design.table().splitlines()
    assert [row.split(",")[0] for row in rows] == ["is", "best", "margin", "margin"]
    assert "limited by" in repr(design)


@pytest.mark.parametrize(
    ("at", "kinds"), [("2:1, start 1", []), ("margin 1.01", ["best", "margin"])]
)
@pytest.mark.full
def test_what_was_found_before_an_interruption_is_kept_and_marked(at, kinds):
    """The keyboard interrupts at a line of progress."""

    def tell(text):
        if text == at:
            raise KeyboardInterrupt

    given = read_scene(scene(margins=[0.99, 1.01] if kinds else []))
    found = ci.design(given, progress=tell)
    assert found.interrupted == at
    rows = [row.split(",") for row in found.table().splitlines()[1:]]
    assert [row[0] for row in rows] == [*kinds, "interrupted"]
    assert rows[-1][-1].strip('"') in at
    assert repr(found).startswith(f"Incomplete, interrupted at {at}\n")


@pytest.mark.full
def test_what_fails_is_said_and_the_rest_is_computed(monkeypatch):
    """The first start, the first margin and the first simulation of complex motion fail."""
    calls = []

    def failing(name, number):
        original = getattr(designs._Designer, name)

        def compute(*given):
            calls.append(name)
            if calls.count(name) == number:
                raise np.linalg.LinAlgError("Singular matrix")
            return original(*given)

        monkeypatch.setattr(designs._Designer, name, compute)

    failing("orbits_at", 2)
    failing("climb", 1)
    failing("again", 1)
    failing("of_motion", 1)
    found = ci.design(scene(starts=8, restarts=2, margins=[0.9, 1.1, 30.0], chaos=8))
    assert found.best.settled
    assert [one.margin for one in found.trade_off] == [1.1]
    whats = ["orbits of BBT at random point 2", "2:1, start 1", "margin 0.9", "motion at s = "]
    assert len(found.failed) == len(whats)
    assert all(map(str.startswith, found.failed, whats))
    assert all(text.endswith("LinAlgError: Singular matrix") for text in found.failed)
    rows = [row.split(",")[0] for row in found.table().splitlines()]
    assert rows == ["is", "best", "margin", *["failed"] * 4]
    assert all(f"failed: {text}" in repr(found) for text in found.failed)
    assert "margin 30: no orbit that was found satisfies the constraints" in found.notes
    assert any(note.startswith("margin 30, from 2:1: it ends where") for note in found.notes)


@pytest.mark.full
@pytest.mark.skipif(os.name != "posix", reason="sends a POSIX signal")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_command_asked_to_end_writes_what_it_found(tmp_path, number):
    file, table = tmp_path / "scene.toml", tmp_path / "found.csv"
    margins = [1.0 + 0.001 * k for k in range(200)]
    file.write_text(toml(scene(margins=margins, tolerances={"s": "2%"})), encoding="utf-8")
    command = [sys.executable, "-m", "contimpact", "design", str(file), "-o", str(table)]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, **streams) as process:
        for line in process.stderr:
            if "margin 1.0" in line:
                break
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "interrupted (margin 1.0" in err
    assert out.startswith("Incomplete, interrupted at margin 1.0")
    rows = [row.split(",")[0] for row in table.read_text(encoding="utf-8").splitlines()]
    assert rows[:2] == ["is", "best"]
    assert rows[-1] == "interrupted"


@pytest.mark.full
def test_no_random_point_keeps_the_margin_and_gives_more(found):
    rng, better = np.random.default_rng(1), 0
    for s, force in rng.uniform((0.25, 4.5), (0.42, 5.5), size=(80, 2)).tolist():
        model = found.orbit.model.replace(s=s, A=force)
        for orbit in ci.find_orbits(model, "2:1", starts=32, rounds=1):
            power = orbit.mean("U**2", per_time=True, harvester=ci.Membrane()).value
            if orbit.stable and orbit.physical and power > found.value:
                better += 1
                margins = ci.find_margins(orbit, {"s": 0.02 * s, "r": 0.006}, within=1.0)
                assert margins.nearest.distance < 1.0
    assert better > 0


@pytest.mark.full
def test_limits():
    """The largest speed of an impact, and the largest square of the position, at their limits."""
    fast = ci.design(scene(limits={"speed": 0.6}, tolerances=None)).best
    assert max(abs(fast.orbit.velocities)) == pytest.approx(0.6, abs=1e-6)
    assert "speed = 0.6" in fast.limited_by
    high = ci.design(scene(limits={"height": 0.01}, tolerances=None)).best
    half = high.orbit["d"] / 2  # a wall bounds it
    assert half**2 == pytest.approx(0.01, abs=1e-6)
    assert "height = 0.01" in high.limited_by


@pytest.mark.full
def test_what_cannot_be_is_said():
    nothing = ci.design(scene(margin=1000.0, bounds={"s": [0.25, 0.42]}, tolerances={"s": "2%"}))
    assert nothing.best is None
    assert "No orbit satisfies the constraints" in repr(nothing)
    none = ci.design({**scene(), "follow": {**SCENE["follow"], "orbits": ["7:2"]}})
    assert none.notes == ("no stable physical 7:2 at 4 random points",)


@pytest.mark.full
def test_fractions_of_starts():
    """Of the motions at an optimum, the parts of starts add up to one."""
    design = ci.design(scene(fraction=0.01, fraction_starts=40))
    part, low, high = design.best.fraction
    assert low <= part <= high
    assert part >= 0.01
    refused = ci.design(scene(fraction=1.0, fraction_starts=40, bounds={"s": [0.33, 0.355]}))
    if refused.best is None:
        assert refused.others[0].fraction[0] < 1.0


@pytest.mark.full
def test_a_limit_that_costs_much_is_kept_on_the_way_to_another_margin():
    """A penalty below a limit's price led elsewhere, and its basin had no box to start in."""
    given = {
        "name": "oscillator",
        "model": {
            "system": "oscillator",
            "parameters": {"a": 1, "omega": 1.47, "c": 0.2, "k": 1, "sigma": 0.1, "r": 0.7},
        },
        "follow": {"parameter": "sigma", "range": [0.1, 1.2], "orbits": ["1"]},
        "output": {"D": "c*v**2", "P": {"before_impacts": "v**2", "per": "time"}},
        "design": {
            "maximise": "P",
            "bounds": {"sigma": [0.1, 1.2], "omega": [1, 2]},
            "margins": [0.5],
            "tolerances": {"sigma": 0.05},
            "limits": {"D": 0.5},
            "fraction": 0.1,
            "fraction_starts": 2,
            "starts": 8,
        },
    }
    with pytest.raises(ci.InputError, match=r"^simulate\.box\.position: no two walls"):
        ci.design(given)
    found = ci.design(given | {"simulate": {"box": {"position": [-2, 0.1]}}})
    assert found.trade_off[0].value == pytest.approx(found.best.value, rel=1e-6)


@pytest.mark.full
@pytest.mark.parametrize(("output", "both"), [("U**2", True), ("sin(pi*t)", False)])
def test_a_mirror_image_counts_if_it_gives_as_much(output, both):
    """At beta = 0 two 1:1 orbits attract, each the other's mirror image half a period later."""
    given = scene(maximise="Q", bounds={"s": [0.39, 0.41]}, tolerances=None, fraction=0.1)
    given["model"]["parameters"] |= {"beta": 0.0, "r": 0.5, "s": 0.4}
    given["follow"]["orbits"] = ["1:1"]
    given["output"]["Q"] = {"before_impacts": output, "per": "time"}
    best = ci.design(given).best
    model = best.orbit.model
    (counts,) = ci.basin_fractions(model, "s", [model["s"]], starts=200).fractions
    assert len(counts) == 2
    assert best.fraction[0] == pytest.approx(1.0) if both else best.fraction[0] in counts


@pytest.mark.full
def test_complex_motion():
    """The mean of a longer run, whose own error is small, is about where the interval says."""
    given = scene(bounds={"s": [0.357, 0.361]}, tolerances=None, chaos=10, starts=1)
    found = ci.design(given).chaos
    low, high = found.interval
    assert low < found.value < high
    model = read_scene(given).model.replace(**found.parameters)
    simulator = ci.Simulator(model)
    run = simulator.run(ci.settle(simulator).state, periods=20000)
    scale = model["A"] * math.pi / (model["M"] * model["omega"])
    powers = ci.Membrane().voltage(scale * run.velocities) ** 2
    assert abs(powers.sum() / 40000 - found.value) < 2.0 * (high - low)


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"maximise": "Q"}, r"design\.maximise: .Q. is no output over .*are P, speed, height"),
        ({"bounds": {}}, r"design\.bounds"),
        ({"bounds": {"q": [0, 1]}}, r"design\.bounds\.q"),
        ({"bounds": {"s": [0.4, 0.3]}}, r"design\.bounds\.s"),
        ({"bounds": {"s": [-1, 0.3]}}, r"design\.bounds\.s"),
        ({"tolerances": {"s": "-5%"}}, r"design\.tolerances\.s"),
        ({"tolerances": {"s": 0}}, r"design\.tolerances\.s"),
        ({"tolerances": None, "margin": 1}, r"design\.margin.*design\.tolerances"),
        ({"margins": [-1]}, r"design\.margins\[0\]"),
        ({"limits": {"v": 1}}, r"design\.limits\.v"),
        ({"fraction": 2}, r"design\.fraction"),
        ({"maximise": "height", "chaos": 5}, r"design\.chaos"),
        ({"restart": 5}, r"design\.restart.*restarts"),
    ],
)
def test_refusals(changes, where):
    with pytest.raises(ci.InputError, match=where):
        read_scene(scene(**changes))


def test_scenes_without_a_design_are_refused():
    given = {key: table for key, table in SCENE.items() if key != "design"}
    with pytest.raises(ci.InputError, match=r"^design: missing"):
        ci.design(given)
    options = read_scene(scene()).resolved()["design"]
    assert read_scene({**SCENE, "design": options}).design == read_scene(scene()).design


@pytest.mark.full
def test_branch_points_constrain_only_where_the_symmetry_is():
    """At beta = 0 the 1:1 orbit has a branch point that it has nowhere else. With a small margin
    the optimum leaves beta = 0; with a large one it is where the distance to that point ends it.
    Both are compared with powers beside them."""
    given = scene(bounds={"s": [0.7, 0.8], "A": [3, 12], "beta": [0, "pi/3"]}, margins=[0.25, 4])
    given["follow"]["orbits"] = ["1:1"]
    given["design"]["tolerances"] = dict.fromkeys(("s", "A", "beta", "r"), "5%")
    found = ci.design(given)
    small, large = found.trade_off
    assert small.settled
    assert large.settled
    assert small.value > found.best.value > large.value

    def power(beta, amplitude):
        model = small.orbit.model.replace(beta=beta, A=amplitude, s=0.8)
        orbits = ci.find_orbits(model, "1:1", parameter="s")
        one = next(o for o in orbits if o.stable and o.physical)
        return one.mean("U**2", per_time=True, harvester=ci.Membrane()).value

    beta = small.parameters["beta"]
    assert small.parameters["A"] == 12.0
    assert small.value == pytest.approx(power(beta, 12.0), rel=1e-9)
    assert small.value > max(power(beta - 0.01, 12.0), power(beta + 0.01, 12.0), power(0.0, 12.0))
    assert [one.name for one in large.active] == ["BP", "bound s = 0.8"]
    tolerances = dict.fromkeys(("s", "A", "r"), "5%")
    level = large.orbit.model.replace(beta=0.0)
    orbits = ci.find_orbits(level, "1:1", parameter="s")
    orbit = next(o for o in orbits if o.stable and o.physical)
    assert ci.find_margins(orbit, tolerances).nearest.distance == pytest.approx(4.0, abs=1e-6)
