"""Calls as users guess them: they work, or are refused with the right call."""

from __future__ import annotations

import copy
import inspect
import math
import pickle
import re

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


@pytest.mark.parametrize("function", ["o.multipliers[0]", "'x'", "o.velocities"])
def test_an_event_of_ones_own_is_one_real_number(function, branch):
    """A multiplier is complex: its real part is asked for, and not taken by chance."""
    own = ("own", eval(f"lambda o: {function}"))
    with pytest.raises(InputError, match="event own: its function returned"):
        ci.continue_orbit(branch.orbit(0), "s", (0.3, 0.6), events=[own])


def test_events_of_ones_own_have_names_of_their_own(branch):
    own = [("own", lambda o: o.period - 3.0), ("own", lambda o: o.period - 4.0)]
    with pytest.raises(InputError, match="found two functions by the name 'own'"):
        ci.continue_orbit(branch.orbit(0), "s", (0.3, 0.6), events=own)


def test_values_outside_the_range_are_refused_as_in_scenes(branch):
    accepted = r"values.s\[1\]: 0.1 is outside the range; give a value from 0.3 to 0.6"
    with pytest.raises(InputError, match=accepted):
        ci.continue_orbit(branch.orbit(0), "s", (0.3, 0.6), values={"s": [0.4, 0.1]})


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


@pytest.mark.full
def test_results_are_plotted_by_their_method(branch):
    diagram = ci.Diagram("one", [branch])
    for result in (branch, diagram):
        axes = result.plot(xlim=(0.3, 0.6), unphysical="all")
        assert axes.get_xlim() == (0.3, 0.6)
    for result in (branch.orbit(0), diagram["PD"]):
        plane, series = result.plot(periods=3)
        assert plane.figure is series.figure
    assert np.ptp(ci.plot(branch.orbit(0), periods=5)[1].get_xlim()) > 4.0
    with pytest.raises(InputError, match=r"found \[\]; give branches"):
        ci.plot([])


# A hundred calls as users have guessed them without documentation, and what they get.

WORKS = """
m["s"]; m["d"]; m.parameters; m.values; m.letters; m.replace(s=0.4)
ci.TwoMasses; ci.HybridSystem; ci.list_systems(); ci.new_scene("two-masses"); ci.Branch
ci.find_orbits(m, "1:1"); ci.find_orbits(m, "BT", "s"); ci.find_orbits(m, "1:1", parameter="s")
ci.continue_orbit(o, "s", (0.45, 0.55)); ci.continue_orbit(o, "s", [0.45, 0.55])
ci.continue_orbit(o, "s", (0.45, 0.55), settings={"max_step": 0.1})
ci.continue_orbit(o, "r", (0.29, 0.31)); ci.continue_born(pd, range=(0.3, 0.6))
ci.continue_born(pd, "s", (0.3, 0.6)); ci.follow_curve(pd, "r", (0.3, 0.6), (0.29, 0.31))
b["s"]; b["d"]; b["v1"]; b[3:5]; b.orbit(0); b.orbit(-1); b.orbit("PD"); b.orbit("e1"); b.orbit(e)
b.events[0]; b.name; b.id; b.word; b.plot(); b.plot(x="d"); b.plot("d"); b.to_dataframe(); len(b)
b.summary(); b.stable; b.multipliers; b.parameter; b.ends; ci.stable_intervals(b)
ci.stable_intervals(d); e.value; e["s"]; e.parameters["s"]; e.orbit(); e.label; e.kind; e.error
d["PD"]; d["PD1"]; d["b1"]; d["e1"]; d[0]; d[:3]; d.branches; d.events; d.plot(); list(d)
ci.plot(d); ci.plot(b, "d"); ci.plot_diagram(d, "d"); ci.plot_diagram(b); ci.plot_orbit(e)
ci.plot_orbit(o); d.reading; d.summary(); d.to_dataframe(); o.plot(); e.plot()
o.times; o.velocities; o.stable; o.word; o["s"]; o.parameters["s"]; o.period; o.path()
ci.energy(o); o.to_dataframe(); c.plot(); c["r"]; c[2:4]; c.name; c.points; ci.plot_curves([c])
scene["s"]; scene["d"]; ci.plot_curves(ci.Diagram("two", [], [c]))
"s" in m; "s" in o; sim["s"]; sim.parameters; sim.random_state(); ci.settle(m); ci.settle(sim)
run["s"]; run.plot(); run.to_dataframe(); run.times; ci.plot(run); repr(run); run.parameters
att["d"]; att.plot(); ci.plot(att); att.stable; att.orbit(); att.to_dataframe(); att._repr_html_()
sw["s"]; sw["d"]; sw[0]; sw[0]["s"]; len(sw); sw.attractors; sw.values; list(sw); sw.plot("d")
ci.basins(m, shape=(2, 3)); ci.Basins; bas.plot(); ci.plot(bas); ci.plot_basins(bas); bas["s"]
bas.shares; bas._repr_html_(); ci.find_attractors(m, 2); ci.plot([b, b]); ci.plot([o, e])
sim._ipython_key_completions_(); att._ipython_key_completions_(); o._ipython_key_completions_()
b._ipython_key_completions_(); pickle.loads(pickle.dumps(d)) == d; copy.deepcopy(b) == b
d._repr_html_(); repr(b)
"""
ANSWERED = {
    "m.s": "it is the item ['s']",
    "m.d": "it is the item ['d']",
    "m.copy(s=0.4)": "there is 'replace'",
    "m.set(s=0.4)": "there is 'replace'",
    "m.walls": "there is 'letters'",
    "m.find_orbits('1:1')": "call contimpact.find_orbits(impactpair, ...)",
    "ci.ImpactPair(0.5, 0.3, 5.0, 0.5)": "give them by name: beta=..., r=...",
    "ci.ImpactPair(beta=0.5)": "r: missing",
    "ci.ImpactPair(beta=30, r=0.3, A=5, s=1)": "math.radians(30)",
    "ci.System": "there is 'Model'",
    "ci.find_orbit(m, '1:1')": "did you mean 'find_orbits'?",
    "ci.find_orbits('1:1', m)": "give a model",
    "ci.find_orbits(m, '1-1')": "give n:m",
    "ci.find_orbits(m, '1:1', 'd')": "no parameter 'd'",
    "ci.continue_orbit(o)": "range: missing; give (low, high)",
    "ci.continue_orbit([o], 's', (0.3, 0.6))": "not one of its orbits",
    "ci.continue_orbit(b, 's', (0.3, 0.6))": "give an orbit of find_orbits",
    "ci.continue_orbit(o, 's', (0.3, 0.6), events=['SN'])": "folds are FB here",
    "ci.continue_orbit(o, 's', (0.3, 0.6), events=['TR'])": "tori are born at NS here",
    "ci.continue_orbit(o, 's', (0.3, 0.6), values={'s': 0.4})": "give a list of numbers",
    "ci.continue_orbit(o, 's', (0.3, 0.6), values=[0.4])": "values: found [0.4]; give Mapping",
    "ci.stable_intervals(o)": "branch: found",
    "ci.plot_sweep(b)": "give Sweep",
    "ci.write_auto(d, 'x')": "give Branch",
    "ci.write_mat(None, 'x')": "branch: found None; give Branch",
    "ci.settle(None)": "simulator: found None; give Simulator | Model",
    "ci.check_model(ci.SoftStop)": "give Model",
    "ci.run_study('study.toml', 'store.sqlite')": "give Store",
    "ci.sweep(m, 's', 0.4)": "values: found 0.4",
    "ci.sweep(m, 's', [0.4], start=(0, 0, 0))": "found (0, 0, 0); give State",
    "ci.continue_branch(o)": "there is 'continue_orbit'",
    "o.follow('s')": "call contimpact.continue_orbit(orbit, ...)",
    "ci.follow(m)": "give a scene",
    "ci.follow('nope.toml')": "no such file",
    "ci.run('scene.toml')": "there is 'follow'",
    "ci.simulate(m)": "there is 'sweep'",
    "ci.basins(m, wall='Q')": "the walls are B, T",
    "ci.basins(m, shape=40)": "such as (40, 40)",
    "att['q']": "attractor has no parameter 'q'; it has beta",
    "o['q']": "orbit has no parameter 'q'; it has beta",
    "sw['q']": "it has beta, r",
    "sim.sweep('s', [0.4])": "call contimpact.sweep(simulator, ...)",
    "run.settle()": "call contimpact.settle(run, ...)",
    "sim.lyapunov": "contimpact.settle(simulator, ...)",
    "att.lyapunov": "there is 'exponents'",
    "ci.Settings(ds=1)": "did you mean 'step'?",
    "ci.Settings(max_steps=1)": "did you mean 'max_points'?",
    "ci.continue_orbit(o, 's', ds=1)": "did you mean 'settings'?",
    "ci.find_orbits(m, '1:1', n=3)": "did you mean 'starts'?",
    "ci.bifurcation_diagram(m)": "there is 'follow'",
    "m.with_parameters(s=0.3)": "there is 'replace'",
    "b.special_points": "there is 'events'",
    "b.at(0.3)": "there is 'orbit'",
    "o.floquet": "there is 'multipliers'",
    "d.transitions": "there is 'reading'",
    "scene.run()": "call contimpact.follow(scene, ...)",
    "scene['q']": "scene has no parameter 'q'; it has beta",
    "ci.load('scene.toml')": "no such file",
    "ci.read_scene('scene.toml')": "load_scene reads a file",
    "ci.new_scene(m)": "accepted are belt",
    "ci.certify(o)": "give a diagram, a branch, events, a scene, or a folder",
    "ci.plot('folder')": "as contimpact.load reads it",
    "ci.plot(m)": "there are pictures of branches, diagrams",
    "ci.switch(pd)": "there is 'continue_born'",
    "b[0]": "branch.orbit(0)",
    "b['PD']": "branch.orbit('e2')",
    "b['e1']": "branch.orbit('e1')",
    "b.s": "it is the item ['s']",
    "b.orbits": "there is 'orbit'",
    "b.save('b.csv')": "call contimpact.save(branch, ...)",
    "b.to_csv('b.csv')": "call contimpact.save(branch, ...)",
    "b.stable_intervals()": "call contimpact.stable_intervals(branch, ...)",
    "e.s": "it is the item ['s']",
    "e.switch()": "call contimpact.continue_born(entry, ...)",
    "d.stable": "there is 'reading'",
    "d['SN']": "folds are FB here",
    "o.energy()": "call contimpact.energy(orbit, ...)",
    "ci.load('nope')": "no such file or folder",
}


@pytest.fixture(scope="module")
def names(model, branch):
    """What the guessed calls are about."""
    doubling = branch.events[1]
    curve = ci.follow_curve(doubling, None, "r", (0.3, 0.6), (0.29, 0.31))
    known = {"m": model, "b": branch, "e": branch.events[0], "pd": doubling, "c": curve}
    known |= {"o": branch.orbit(9), "d": ci.Diagram("one", [branch])}
    simulator = ci.Simulator(model)
    known |= {"sim": simulator, "run": simulator.run(simulator.random_state(), impacts=9)}
    known |= {"att": ci.settle(simulator), "sw": ci.sweep(model, "s", [0.5, 0.49])}
    known["scene"] = ci.read_scene(SCENE)
    known["bas"] = ci.basins(simulator, shape=(2, 3))
    return {"ci": ci, "copy": copy, "pickle": pickle, **known}


@pytest.mark.parametrize("call", [text.strip() for text in re.split(r"[;\n]+", WORKS.strip())])
def test_a_guessed_call_works(names, call):
    if "to_dataframe" in call:
        pytest.importorskip("pandas")
    assert eval(call, names) is not None


FUNCTIONS = sorted(name for name in ci.__all__ if inspect.isfunction(getattr(ci, name)))
CLASSES = [
    "Formulas",
    "Geometry",
    "Membrane",
    "Parameter",
    "Settings",
    "Simulator",
    "Store",
    "Wall",
]


@pytest.mark.parametrize("name", [*FUNCTIONS, *CLASSES])
def test_an_argument_that_is_not_there_is_answered_with_those_that_are(name):
    call = getattr(ci, name)
    known = inspect.signature(call).parameters
    if any(p.kind is p.VAR_KEYWORD for p in known.values()):
        with pytest.raises(TypeError, match=r"missing .*; it takes "):
            call()
        return
    with pytest.raises(TypeError) as error:
        call(no_such_argument=1)
    assert str(error.value) == (
        f"{name}() has no argument 'no_such_argument'; it takes {', '.join(known) or 'none'}"
    )
    if known:
        first = max(known, key=len)
        with pytest.raises(TypeError, match=rf"\(did you mean '{first}'\?\)"):
            call(**{f"{first}_": 1})


def test_a_mistake_within_a_call_is_reported_as_it_is(model):
    def callback(point):
        return point.no_such_method(1) + len(3)

    with pytest.raises((TypeError, AttributeError)) as error:
        ci.continue_orbit(ci.find_orbits(model, "1:1", "s")[0], "s", (0.3, 0.6), callback=callback)
    assert "it takes" not in str(error.value)


@pytest.mark.parametrize("seed", [-1, "x", 0.5])
def test_a_seed_that_is_none_is_refused(model, seed):
    calls = {
        "rng": [
            lambda: ci.find_orbits(model, "2:1", parameter="s", rng=seed),
            lambda: ci.sweep(model, "s", [0.3], rng=seed),
            lambda: ci.basin_fractions(model, "s", [0.3], rng=seed),
        ],
        "generator": [lambda: ci.Simulator(model).random_state(seed)],
    }
    for name, each in calls.items():
        for call in each:
            with pytest.raises(ci.InputError, match=f"^{name}: found .*give a seed"):
                call()


def test_capitals_are_no_other_name():
    with pytest.raises(InputError, match=r"S: no such parameter \(did you mean 's'\?\)"):
        ci.ImpactPair(beta=0.5, r=0.3, A=5.0, S=0.5)


def test_interrupted_simulations_keep_what_they_had(model):
    def interrupt(*done):
        raise KeyboardInterrupt

    swept = ci.sweep(model, "s", [0.5, 0.49], callback=interrupt)
    assert swept.interrupted
    assert swept.values.tolist() == [0.5]
    assert "interrupted" in repr(swept)
    basins = ci.basins(model, shape=(2, 3), callback=interrupt)
    assert basins.interrupted
    assert (basins.labels >= 0).tolist() == [[True, False, False], [False] * 3]
    assert "interrupted after 1" in repr(basins)
    assert sum(basins.shares) == pytest.approx(1.0)
    assert basins.plot().get_xlabel()


def test_a_scene_is_certified(tmp_path):
    pytest.importorskip("flint")
    short = {**SCENE, "certify": {"branches": False}}
    certificates = ci.certify(ci.read_scene(short))
    assert certificates.certified
    assert not certificates.branches


def test_what_was_read_from_a_file_asks_for_its_model(names, tmp_path):
    for name in ("att", "run"):
        ci.save(names[name], tmp_path / "one.json")
        again = ci.load(tmp_path / "one.json")
        assert again == names[name]
        with pytest.raises(InputError, match="give the model it was simulated with"):
            again.plot()
        assert again.plot(model=names["m"])


@pytest.mark.parametrize("call", ANSWERED)
def test_a_guessed_call_is_answered(names, call):
    if "certify" in call:
        pytest.importorskip("flint")
    with pytest.raises((InputError, KeyError, AttributeError, TypeError)) as error:
        eval(call, names)
    assert ANSWERED[call] in str(error.value)
