"""Linear machines that a scene states."""

from __future__ import annotations

import copy
import json
import pickle

import numpy as np
import pytest
from zoo import ROOT, TWO_MASSES

from contimpact.diagrams.explore import follow
from contimpact.errors import InputError
from contimpact.orbits.search import find_orbits
from contimpact.results.scene import load_scene, read_scene
from contimpact.segments.checking import check_model
from contimpact.segments.kernels import Kernels
from contimpact.systems.impact_damper import ImpactDamper

MASSES = {
    "system": "linear",
    "coordinates": ["x1", "x2"],
    "mass": [1, 1],
    "damping": [["c1 + c2", "-c2"], ["-c2", "c2"]],
    "stiffness": [["k1 + k2", "-k2"], ["-k2", "k2"]],
    "force": ["a1*cos(omega*t)", 0],
    "period": "2*pi/omega",
    "guards": {
        "A": {"within": "x1 <= sigma_1", "restitution": "r"},
        "B": {"within": "x2 <= sigma_2", "restitution": "r"},
    },
    "parameters": TWO_MASSES,
}

DAMPER = {
    "system": "linear",
    "coordinates": ["x", "y"],
    "mass": [["1 + mu", "mu"], ["mu", "mu"]],
    "damping": ["2*zeta", 0],
    "stiffness": [1, 0],
    "force": ["cos(Omega*t)", 0],
    "period": "2*pi/Omega",
    "guards": {
        "R": {"within": "y <= d/2", "restitution": "r"},
        "L": {"within": "y >= -d/2", "restitution": "r"},
    },
    "parameters": {"Omega": 1.0, "d": 20.0, "r": 0.8, "mu": 0.1, "zeta": 0.01},
}


def scene_of(model, **follow_):
    given = {"parameter": "omega", "range": [1.2, 1.5], "orbits": ["A"]} | follow_
    return read_scene(
        {"name": "t", "model": model, "follow": given, "detect": {"events": ["FB", "PD", "G"]}}
    )


@pytest.mark.full
def test_two_masses_stated_in_a_scene_have_the_catalogue_of_the_system():
    """The same events at the same places, to their errors."""
    own = follow(scene_of(MASSES))
    known = follow(scene_of({"system": "two-masses", "parameters": TWO_MASSES}))
    assert [e.label for e in own.entries] == [e.label for e in known.entries]
    assert len(own.entries) > 0
    for one, other in zip(own.entries, known.entries, strict=True):
        difference = abs(one.parameters["omega"] - other.parameters["omega"])
        assert difference <= 4.0 * (one.error + other.error)


@pytest.mark.full
def test_impulses_between_bodies_are_those_of_the_impact_damper():
    """With the ball driven against the container the masses are coupled."""
    stated = scene_of(DAMPER, parameter="d", range=[10.0, 30.0], orbits=["RL"]).model
    own, known = (
        find_orbits(m, "RL", parameter="d", starts=64)
        for m in (stated, ImpactDamper(**DAMPER["parameters"]))
    )
    assert len(own) == len(known) > 0
    for one, other in zip(own, known, strict=True):
        assert one.unknowns == pytest.approx(other.unknowns, abs=1e-9)


THREE = {
    "system": "linear",
    "coordinates": ["x1", "x2", "x3"],
    "mass": [1, "m", 1],
    "damping": [["2*c", "-c", 0], ["-c", "2*c", "-c"], [0, "-c", "c"]],
    "stiffness": [["2*k", "-k", 0], ["-k", "2*k", "-k"], [0, "-k", "k"]],
    "force": ["a*cos(omega*t)", 0, "b*sin(3*omega*t)"],
    "period": "2*pi/omega",
    "guards": {
        "A": {"within": "x1 <= s", "restitution": "r"},
        "B": {"within": "x2 <= s", "restitution": "r"},
        "C": {"within": "x3 - x2 <= s", "restitution": "r"},
    },
    "parameters": {
        "m": 1.5,
        "c": 0.1,
        "k": 1.0,
        "a": 1.0,
        "b": 0.3,
        "omega": 1.2,
        "s": 0.4,
        "r": 0.7,
    },
}


@pytest.mark.full
def test_three_masses_with_three_stops():
    model = scene_of(THREE, orbits=["ABC"]).model
    assert model.unknowns_per_impact == 6
    for word in ("A", "C", "ABC"):
        orbits = find_orbits(model, word, parameter="omega", starts=32, rounds=3)
        assert orbits
        assert orbits[0].residual < 1e-12
    product = np.prod(orbits[0].multipliers)
    rate = 0.1 * (2.0 + 2.0 / 1.5 + 1.0)
    truth = 0.7**6 * np.exp(-rate * 2.0 * np.pi / 1.2)
    assert product == pytest.approx(truth, rel=1e-10)


def test_what_is_recorded_makes_the_machine_again():
    model = scene_of(MASSES).model
    again = type(model).__mro__[1](**model.options, **model.values)
    for other in (again, copy.copy(model), pickle.loads(pickle.dumps(model)), model.replace(r=0.8)):
        assert other.values == model.values
        assert other.identity == model.identity
    resolved = scene_of(MASSES).resolved()["model"]
    assert scene_of(resolved).model.identity == model.identity


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"mass": [1]}, r"model\.mass: found \[1\]; give 2 rows of 2 entries, or the 2 entries"),
        ({"mass": [[1, 0], [0]]}, r"model\.mass\[1\]: found \[0\]; give a list of 2 entries"),
        ({"mass": ["m", 1]}, r"model\.mass\[0\]\[0\]: unknown name 'm'"),
        ({"force": ["cos(x1)", 0]}, r"model\.force\[0\]: unknown name 'x1'"),
        ({"force": ["cos(omega*t", 0]}, r"model\.force\[0\]: .* cannot be read"),
        ({"period": "t"}, r"model\.period: unknown name 't'"),
        ({"period": True}, r"model\.period: found True; give a number, or an expression"),
        ({"coordinates": ["x1", "r"]}, r"\.coordinates\[1\]: the name 'r', which is a parameter"),
        ({"coordinates": ["x1", "t"]}, r"\.coordinates\[1\]: the name 't', which is the time"),
        ({"coordinates": []}, r"model\.coordinates: found \[\]; give a list of 1 to 20 names"),
        ({"guards": {}}, r"model\.guards: none; give at least one"),
        ({"guards": {"A": {"within": "x1 < 1", "restitution": 1}}}, r"guards\.A\.within: found"),
        ({"guards": {"A": {"within": "x1*x2 <= 1", "restitution": 1}}}, r"a linear combination"),
        ({"guards": {"A": {"within": "x1 + 1 <= 1", "restitution": 1}}}, r"a linear combination"),
        ({"guards": {"A": {"within": "x1 <= x2", "restitution": 1}}}, "coordinates alone on one"),
        ({"guards": {"A": {"within": "x1 <= 1"}}}, r"guards\.A\.restitution: missing"),
        ({"guards": {"A": {"within": "x1 <= 1", "r": 1}}}, r"guards\.A\.r: unknown key"),
        ({"guards": {"AB": {"within": "x1 <= 1", "restitution": 1}}}, r"a single letter"),
        ({"guards": {"A": {"within": "x1 - r <= 0", "restitution": 1}}}, "coordinates alone on"),
        (
            {"guards": {"A": {"within": "r*x1 <= 0", "restitution": 1}}},
            r"factors, .* as .x <= 1/k.",
        ),
        ({"guards": {"A": {"within": "-1 <= x1 <= 1", "restitution": 1}}}, "for each side a guard"),
        (
            {"guards": {"A": {"within": "x1 <= 1", "restitution": -0.3}}},
            "A.restitution: it is -0.3",
        ),
        ({"guards": {"A": {"within": "x1 <= 1", "restitution": "2*r"}}}, "it must be from 0 to 1"),
        ({"mass": [[1, 0.2], [0.1, 1]]}, r"model\.mass\[1\]\[0\]: it is 0\.1, .* symmetric"),
        ({"mass": [[1, 2], [2, 1]]}, r"model\.mass: .* not positive definite \(row 1\)"),
        ({"mass": [0, 1]}, r"model\.mass: .* not positive definite \(row 0\); give masses above 0"),
        (
            {"mass": [1e200, 1]},
            r"model\.mass\[0\]: found 1e\+200; give a number of at most 1e\+100",
        ),
        ({"period": "omega - omega"}, r"model\.period: it is 0; give the period of the forcing"),
        (
            {"parameters": TWO_MASSES | {"t": 1.0}},
            r"\.parameters\.t: the name 't', which is the time",
        ),
        ({"parameters": TWO_MASSES | {"r": 1.5}}, r"model\.parameters\.r: .*from 0 to 1"),
        (
            {"parameters": TWO_MASSES | {"sigma_3": 1.5}},
            r"model\.parameters\.sigma_3: no expression has it; use sigma_3 in the machine",
        ),
        ({"parameters": TWO_MASSES | {"event": 1.5}}, r"model\.parameters: the name 'event'"),
        ({"guard": {}}, r"model\.guard: unknown key \(did you mean 'guards'"),
    ],
)
def test_mistakes_are_refused_with_their_place(changes, says):
    with pytest.raises(InputError, match=says):
        scene_of(MASSES | changes)


def test_masses_are_checked_at_both_ends_of_a_range():
    model = MASSES | {"mass": ["m", 1], "parameters": TWO_MASSES | {"m": 1.0}}
    with pytest.raises(InputError, match=r"follow\.range\.mass: .* not positive definite"):
        scene_of(model, parameter="m", range=[-0.5, 2.0])


def test_the_sides_of_a_guard_may_change_places():
    guards = {"A": "sigma_1 >= x1", "B": "-sigma_2 <= x1 - x2"}
    stated = {name: {"within": text, "restitution": "r"} for name, text in guards.items()}
    walls = scene_of(MASSES | {"guards": stated}).model.WALLS
    assert [(wall.side, wall.coordinate) for wall in walls] == [(+1, (1.0, 0.0)), (-1, (1.0, -1.0))]


@pytest.mark.parametrize("text", ["-x1 >= -sigma_1", "3*x1 <= 3*sigma_1", "-sigma_1/2 <= -x1/2"])
def test_a_guard_on_one_coordinate_has_it_as_its_gap_coordinate(text):
    """Others were told apart from guards on the same surface, and their grazings not found."""
    guards = MASSES["guards"] | {"A": {"within": text, "restitution": "r"}}
    model = scene_of(MASSES | {"guards": guards}).model
    wall = model.guard("A")
    assert (wall.side, wall.coordinate) == (+1, (1.0, 0.0))
    position = Kernels(model, "omega").setup(*model.values.values()).walls[0]
    assert position == pytest.approx(model.values["sigma_1"], rel=1e-15)


def test_a_mistake_in_such_a_guard_is_shown_as_it_was_stated():
    guards = MASSES["guards"] | {"A": {"within": "-2*x1 >= -2*sigma", "restitution": "r"}}
    with pytest.raises(InputError, match=r"guards\.A\.within: unknown name 'sigma' in '-2\*sigma'"):
        scene_of(MASSES | {"guards": guards})


def test_names_may_be_words_of_python():
    renamed = json.loads(json.dumps(MASSES).replace("a1", "lambda").replace("x2", "None"))
    assert scene_of(renamed).model.values["lambda"] == 1.0
    check_model(scene_of(renamed).model)


def test_a_text_that_is_no_machine_is_refused():
    with pytest.raises(InputError, match=r"model\.machine: found '\{\}'; state the system in a"):
        scene_of({"system": "linear", "machine": "{}", "parameters": TWO_MASSES})


@pytest.mark.full
def test_the_example_of_the_documentation():
    scene = load_scene(ROOT / "examples" / "three_masses.toml")
    orbits = find_orbits(scene.model, "C", parameter="omega", starts=32, rounds=3)
    assert any(orbit.stable and orbit.physical for orbit in orbits)
