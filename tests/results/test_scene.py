"""Scenes: what a valid one is read as, and that every mistake is refused where it was made."""

from __future__ import annotations

import copy
import json
import math
import re
import string
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from contimpact.continuation.settings import Settings
from contimpact.errors import InputError
from contimpact.models.guards import Word
from contimpact.results.scene import Scene, load_scene, read_scene

VALID = {
    "name": "a scene",
    "model": {
        "system": "impact-pair",
        "parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.34},
    },
    "follow": {"parameter": "s", "range": [0.08, 1.05], "orbits": ["1:1"]},
}
"""The least a scene must say."""

FULL = {
    "name": "full",
    "source": "a paper, Fig. 1",
    "model": {
        "system": "impact-pair",
        "forcing": "sin(pi*t)",
        "parameters": {
            "beta": 0,
            "r_B": 0,
            "r_T": 1,
            "A": "2*5",
            "s": 0.5,
            "M": 0.2,
            "omega": "6*pi",
            "g": 0,
        },
    },
    "follow": {"parameter": "A", "range": [1, "9+3"], "orbits": ["2:1/2T", "BT", "1:1"]},
    "detect": {"events": ["PD", "UZ", "PD"], "values": {"A": [7, "5*2"], "d": [0.25]}},
    "numerics": {
        "tolerance": 1e-11,
        "max_iterations": 9,
        "step": 0.002,
        "min_step": 1e-6,
        "max_step": 0.05,
        "max_angle": 0.3,
        "max_points": 77,
        "seed": 3,
        "starts": 11,
        "rounds": 2,
    },
    "plot": {"x": "d", "xlim": [0, 1], "ylim": [-1, "pi/3"], "formats": ["pdf", "pdf"]},
}

OSCILLATOR = {
    "name": "stop",
    "model": {
        "system": "oscillator",
        "parameters": {"a": 1, "omega": 1, "c": 0.1, "k": 1, "sigma": 1, "r": 0.8},
    },
    "follow": {"parameter": "a", "range": [0.01, 1.5], "orbits": ["1"]},
}

ABSENT = object()


def changed(changes, base=VALID):
    """A copy of a scene with some keys, named by their paths, set or taken out."""
    scene = copy.deepcopy(base)
    for path, value in changes.items():
        *tables, key = path.split("/")
        table = scene
        for name in tables:
            table = table.setdefault(name, {})
        if value is ABSENT:
            del table[key]
        else:
            table[key] = value
    return scene


def refused(scene):
    """The error a scene is refused with: one line of a length that can be read."""
    with pytest.raises(InputError) as caught:
        read_scene(scene)
    error = caught.value
    assert str(error) == f"{error.where}: {error.found}; {error.accepted}"
    assert "\n" not in str(error)
    assert len(str(error)) < 500
    assert error.found
    assert error.accepted
    return error


# What is read


def test_least_scene():
    scene = read_scene(VALID)
    assert scene.name == "a scene"
    assert scene.source == ""
    assert scene.model.SYSTEM == "impact-pair"
    assert scene.model.options == {"forcing": "cos(pi*t)"}
    assert scene.model.values == {
        "beta": math.pi / 6,
        "r": 0.3,
        "A": 5.0,
        "s": 0.34,
        "M": 0.1245,
        "omega": 5 * math.pi,
        "g": 9.8,
    }
    assert scene.parameter == "s"
    assert scene.start == 0.34
    assert scene.range == (0.08, 1.05)
    assert scene.orbits == (Word("BT"),)
    assert scene.events == ("FB", "BP", "PD", "G", "V", "T")
    assert scene.values == {}
    assert scene.settings == Settings(max_step=0.03)
    assert (scene.seed, scene.starts, scene.rounds) == (0, 256, 8)
    assert scene.plot.x == "s"
    assert scene.plot.xlim is None
    assert scene.plot.ylim is None
    assert scene.plot.formats == ("svg", "png")
    assert scene.given == VALID


def test_full_scene():
    scene = read_scene(FULL)
    assert scene.source == "a paper, Fig. 1"
    assert scene.model.options == {"forcing": "sin(pi*t)"}
    assert scene.model.values == {
        "beta": 0.0,
        "r_B": 0.0,
        "r_T": 1.0,
        "A": 10.0,
        "s": 0.5,
        "M": 0.2,
        "omega": 6 * math.pi,
        "g": 0.0,
    }
    assert all(type(value) is float for value in scene.model.values.values())
    assert scene.range == (1.0, 12.0)
    assert scene.orbits == (Word("BBTBBT", 2), Word("BT"))  # BT and 1:1 are one
    assert scene.events == ("PD", "UZ")
    assert scene.values == {"A": [7.0, 10.0], "d": [0.25]}
    numerics = dict(FULL["numerics"])
    assert (scene.seed, scene.starts, scene.rounds) == (3, 11, 2)
    assert scene.settings == Settings(
        **{name: numerics[name] for name in numerics if name not in ("seed", "starts", "rounds")}
    )
    assert scene.plot.x == "d"
    assert scene.plot.xlim == (0.0, 1.0)
    assert scene.plot.ylim == (-1.0, math.pi / 3)
    assert scene.plot.formats == ("pdf",)


def test_oscillator():
    scene = read_scene(OSCILLATOR)
    assert scene.model.SYSTEM == "oscillator"
    assert scene.orbits == (Word("S"),)
    assert scene.plot.x == "a"


def test_the_scene_given_is_not_changed():
    given_scene = copy.deepcopy(FULL)
    read_scene(given_scene)
    assert given_scene == FULL


@pytest.mark.parametrize("scene", [VALID, FULL, OSCILLATOR], ids=["least", "full", "oscillator"])
def test_resolved_scene_is_a_scene(scene):
    first = read_scene(scene)
    resolved = json.loads(json.dumps(first.resolved()))
    second = read_scene(resolved)
    assert json.loads(json.dumps(second.resolved())) == resolved
    for name in (
        "name",
        "source",
        "parameter",
        "range",
        "orbits",
        "events",
        "values",
        "settings",
        "seed",
        "starts",
        "rounds",
        "plot",
        "start",
    ):
        assert getattr(second, name) == getattr(first, name), name
    assert second.model.values == first.model.values
    assert second.model.options == first.model.options


def test_resolved_scene_leaves_no_default_open():
    resolved = read_scene(VALID).resolved()
    assert set(resolved) >= {"name", "source", "model", "follow", "detect", "numerics", "plot"}
    assert resolved["model"]["forcing"] == "cos(pi*t)"
    assert resolved["model"]["parameters"]["g"] == 9.8
    assert resolved["numerics"]["max_step"] == 0.03
    assert resolved["plot"]["formats"] is not None


def test_values_add_their_event():
    scene = read_scene(changed({"detect/events": ["G"], "detect/values": {"s": [0.3]}}))
    assert scene.events == ("G", "UZ")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"detect/events": ["G"]}, ["FB, BP, PD, NS, V, T, UZ", "second derivatives"]),
        ({"detect/events": ["FB"]}, ["BP, PD, NS, G, V, T, UZ"]),
        ({"plot/formats": []}, ["plot.formats is empty"]),
        ({"simulate": {}, "energy": {}}, ["simulation: [simulate] is for", "energy: [energy] is"]),
        ({"simulate": {}}, ["simulation: [simulate] is for", "energy: no [energy]"]),
        ({}, ["simulation: no [simulate]", "energy: no [energy]"]),
    ],
)
def test_left_out(changes, words):
    text = "\n".join(read_scene(changed(changes)).left_out())
    for word in words:
        assert word in text
    assert ("second derivatives" in text) == any("second" in word for word in words)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("1:1", Word("BT")),
        ("2:1", Word("BBT")),
        ("0:1", Word("T")),
        ("1:1/3T", Word("BTBTBT", 3)),
        ("BBT", Word("BBT")),
        ("TBB", Word("TBB")),
        ("BTBT/2T", Word("BTBT", 2)),
        ("B/3T", Word("B", 3)),
    ],
)
def test_words(text, word):
    assert read_scene(changed({"follow/orbits": [text]})).orbits == (word,)


# What is refused: unknown keys


@pytest.mark.parametrize(
    ("path", "suggestion"),
    [
        ("nane", "name"),
        ("sources", "source"),
        ("models", "model"),
        ("model/systems", "system"),
        ("model/force", "forcing"),
        ("follow/orbit", "orbits"),
        ("follow/params", "parameter"),
        ("detect/event", "events"),
        ("numerics/maxstep", "max_step"),
        ("numerics/tolerence", "tolerance"),
        ("plot/format", "formats"),
    ],
)
def test_unknown_key_is_refused_with_a_suggestion(path, suggestion):
    error = refused(changed({path: 1}))
    assert error.where == path.replace("/", ".")
    assert f"did you mean {suggestion!r}?" in error.found
    assert suggestion in error.accepted


@pytest.mark.parametrize(
    "path",
    [
        "zzz",
        "model/zzz",
        "model/parameters/zzz",
        "follow/zzz",
        "detect/zzz",
        "detect/values/zzz",
        "numerics/zzz",
        "plot/zzz",
    ],
)
def test_unknown_key_at_every_level(path):
    error = refused(changed({path: [1.0] if "values" in path else 1.0}))
    assert error.where == path.replace("/", ".")
    assert "accepted are" in error.accepted
    assert "did you mean" not in error.found


def test_options_of_another_system():
    error = refused(changed({"model/forcing": "cos(t)"}, OSCILLATOR))
    assert error.where == "model.forcing"


# What is refused: missing keys


@pytest.mark.parametrize(
    "path",
    [
        "name",
        "model",
        "model/system",
        "model/parameters",
        "model/parameters/beta",
        "model/parameters/r",
        "model/parameters/A",
        "model/parameters/s",
        "follow",
        "follow/parameter",
        "follow/range",
        "follow/orbits",
    ],
)
def test_missing_key(path):
    error = refused(changed({path: ABSENT}))
    assert error.where == path.replace("/", ".")
    assert error.found == "missing"
    assert error.accepted.startswith("give ")


@pytest.mark.parametrize("name", OSCILLATOR["model"]["parameters"])
def test_missing_parameter_of_the_oscillator(name):
    error = refused(changed({f"model/parameters/{name}": ABSENT}, OSCILLATOR))
    assert error.where == f"model.parameters.{name}"
    assert error.found == "missing"


def test_half_of_a_split_parameter():
    error = refused(changed({"model/parameters/r": ABSENT, "model/parameters/r_B": 0.3}))
    assert error.where == "model.parameters.r_T"
    assert error.found == "missing"


# What is refused: values


@pytest.mark.parametrize(
    ("changes", "where", "says"),
    [
        ({"r_B": 0.3}, "r", "r_B"),
        ({"r_B": 0.3, "r_T": 0.3}, "r", "r_B and r_T"),
        ({"r": -0.1}, "r", "-0.1"),
        ({"r": -1e-300}, "r", "from 0 to 1"),
        ({"r": 1.0000000000000002}, "r", "1.0000000000000002"),
        ({"r": "3/2"}, "r", "1.5"),
        ({"A": 0}, "A", "> 0"),
        ({"A": -5.0}, "A", "-5.0"),
        ({"A": "-0.0"}, "A", "> 0"),
        ({"s": 0.0}, "s", "> 0"),
        ({"s": -1}, "s", "> 0"),
        ({"M": 0}, "M", "> 0"),
        ({"M": -0.1}, "M", "> 0"),
        ({"omega": 0}, "omega", "> 0"),
        ({"g": -9.8}, "g", ">= 0"),
        ({"beta": 2.0}, "beta", "rad"),
        ({"beta": "-pi"}, "beta", "rad"),
        ({"A": math.nan}, "A", "nan"),
        ({"A": math.inf}, "A", "inf"),
        ({"s": -math.inf}, "s", "inf"),
        ({"beta": math.nan}, "beta", "nan"),
        ({"A": 10**400}, "A", "finite"),
        ({"A": "1e400"}, "A", "finite"),
        ({"A": "1/0"}, "A", "1/0"),
        ({"A": "log(-1)"}, "A", "log(-1)"),
        ({"A": "sqrt(-1)"}, "A", "sqrt(-1)"),
        ({"A": "(-1)**0.5"}, "A", "(-1)**0.5"),
        ({"A": "exp(1000)"}, "A", "exp(1000)"),
        ({"A": "5,0"}, "A", "5,0"),
        ({"A": "5 N"}, "A", "5 N"),
        ({"A": ""}, "A", "''"),
        ({"A": "nan"}, "A", "nan"),
        ({"A": "__import__('os').getcwd()"}, "A", "__import__"),
        ({"A": "beta"}, "A", "beta"),
        ({"A": "(" * 300 + ")" * 300}, "A", "("),
        ({"A": "2**2**2**2**2**2"}, "A", "exponent"),
        ({"A": True}, "A", "True"),
        ({"A": False}, "A", "False"),
        ({"A": [5.0]}, "A", "[5.0]"),
        ({"A": {}}, "A", "{}"),
        ({"A": {"value": 5.0}}, "A", "5.0"),
    ],
)
def test_parameters(changes, where, says):
    scene = changed({f"model/parameters/{name}": value for name, value in changes.items()})
    error = refused(scene)
    assert error.where == f"model.parameters.{where}"
    assert says in str(error)


def test_resonance_without_damping():
    error = refused(changed({"model/parameters/c": 0}, OSCILLATOR))
    assert error.where == "model.parameters.omega"
    assert "resonance" in error.found


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("name", 1),
        ("name", ["x"]),
        ("name", True),
        ("name", {}),
        ("name", ""),
        ("name", "a\nb"),
        ("name", "a\0b"),
        ("source", 1),
        ("source", []),
        ("source", True),
        ("model", "impact-pair"),
        ("model", []),
        ("model", 1),
        ("model", [{}]),
        ("model/system", 1),
        ("model/system", []),
        ("model/system", ""),
        ("model/system", "impact_pair"),
        ("model/system", "IMPACT-PAIR"),
        ("model/system", "os"),
        ("model/parameters", []),
        ("model/parameters", "r = 1"),
        ("model/parameters", 0.3),
        ("model/forcing", 1),
        ("model/forcing", ["cos(pi*t)"]),
        ("model/forcing", True),
        ("follow", []),
        ("follow", "s"),
        ("follow", True),
        ("follow/parameter", 1),
        ("follow/parameter", ["s"]),
        ("follow/parameter", ""),
        ("follow/parameter", "S"),
        ("follow/parameter", "zzz"),
        ("follow/parameter", "r_B"),
        ("follow/parameter", "d"),
        ("follow/parameter", "gbar"),
        ("follow/parameter", "forcing"),
        ("follow/range", []),
        ("follow/range", [0.1]),
        ("follow/range", [0.1, 0.3, 0.5]),
        ("follow/range", "0.1 0.5"),
        ("follow/range", 0.1),
        ("follow/range", {"low": 0.1}),
        ("follow/range", [0.35, 1.05]),
        ("follow/range", [0.08, 0.33]),
        ("follow/range", [1.05, 0.08]),
        ("follow/range", [0.34, 0.34]),
        ("follow/range", [0.34, 0.34 + 1e-13]),
        ("follow/range", [-0.1, 1.05]),
        ("follow/range", [0.0, 1.05]),
        ("follow/orbits", []),
        ("follow/orbits", "1:1"),
        ("follow/orbits", [1]),
        ("follow/orbits", [["1:1"]]),
        ("follow/orbits", {"a": "1:1"}),
        ("follow/orbits", [True]),
        ("follow/orbits", ["1:1", 2]),
        ("detect", []),
        ("detect", "FB"),
        ("detect/events", "FB"),
        ("detect/events", [1]),
        ("detect/events", [["FB"]]),
        ("detect/events", {}),
        ("detect/events", True),
        ("detect/values", []),
        ("detect/values", 0.3),
        ("detect/values", "s"),
        ("detect/values/s", 0.3),
        ("detect/values/s", "0.3"),
        ("detect/values/s", {}),
        ("detect/values/A", [5.0]),
        ("detect/values/beta", [0.5]),
        ("detect/values/M", []),
        ("numerics", []),
        ("numerics", 1e-9),
        ("numerics/tolerance", 0),
        ("numerics/tolerance", -1e-9),
        ("numerics/tolerance", True),
        ("numerics/tolerance", math.nan),
        ("numerics/tolerance", math.inf),
        ("numerics/tolerance", "small"),
        ("numerics/tolerance", []),
        ("numerics/step", 0),
        ("numerics/step", -0.01),
        ("numerics/step", True),
        ("numerics/min_step", 0.0),
        ("numerics/min_step", False),
        ("numerics/max_step", -1),
        ("numerics/max_angle", 0),
        ("numerics/max_angle", True),
        ("numerics/max_iterations", 0),
        ("numerics/max_iterations", -3),
        ("numerics/max_iterations", True),
        ("numerics/max_iterations", 8.0),
        ("numerics/max_iterations", "8"),
        ("numerics/max_points", 0),
        ("numerics/max_points", False),
        ("numerics/max_points", 1e3),
        ("numerics/seed", -1),
        ("numerics/seed", 0.0),
        ("numerics/seed", True),
        ("numerics/starts", 0),
        ("numerics/starts", True),
        ("numerics/starts", 1.5),
        ("numerics/rounds", 0),
        ("numerics/rounds", True),
        ("numerics/rounds", "all"),
        ("plot", []),
        ("plot", False),
        ("plot/x", 1),
        ("plot/x", ""),
        ("plot/x", "zzz"),
        ("plot/x", "A"),
        ("plot/x", ["s"]),
        ("plot/xlim", [1, 0]),
        ("plot/xlim", [1, 1]),
        ("plot/xlim", [1]),
        ("plot/xlim", []),
        ("plot/xlim", "auto"),
        ("plot/xlim", 1),
        ("plot/xlim", [0, 1, 2]),
        ("plot/ylim", [0.5, -0.5]),
        ("plot/ylim", True),
        ("plot/ylim", {}),
        ("plot/formats", "svg"),
        ("plot/formats", [1]),
        ("plot/formats", True),
    ],
    ids=repr,
)
def test_wrong_types_and_values(path, value):
    error = refused(changed({path: value}))
    assert error.where == path.replace("/", ".")


@pytest.mark.parametrize(
    ("path", "value", "index", "says"),
    [
        ("follow/range", [math.nan, 1.05], 0, "nan"),
        ("follow/range", [0.08, math.inf], 1, "inf"),
        ("follow/range", [True, 1.05], 0, "True"),
        ("follow/range", [0.08, "one"], 1, "one"),
        ("detect/events", ["FB", "XX"], 1, "XX"),
        ("detect/events", ["fb"], 0, "fb"),
        ("detect/events", ["FB", ""], 1, "''"),
        ("detect/events", ["HB"], 0, "FB, BP, PD, NS, G, V, T, UZ"),
        ("detect/values/s", [0.3, True], 1, "True"),
        ("detect/values/s", [math.nan], 0, "nan"),
        ("detect/values/s", [0.3, [0.4]], 1, "[0.4]"),
        ("plot/xlim", [True, False], 0, "True"),
        ("plot/ylim", [0, math.inf], 1, "inf"),
        ("plot/xlim", [math.nan, 1.0], 0, "nan"),
        ("plot/formats", ["svg", "jpg"], 1, "svg, png, pdf"),
        ("plot/formats", ["PNG"], 0, "PNG"),
        ("plot/formats", [""], 0, "''"),
        ("follow/orbits", ["1:1", "BTX"], 1, "'X'"),
        ("follow/orbits", ["bt"], 0, "'b'"),
        ("follow/orbits", [""], 0, "''"),
        ("follow/orbits", ["0:0"], 0, "0:0"),
        ("follow/orbits", ["1:1/0T"], 0, "1:1/0T"),
        ("follow/orbits", ["BT/0T"], 0, "BT/0T"),
        ("follow/orbits", ["1:1:1"], 0, "3 walls of 2"),
        ("follow/orbits", ["2"], 0, "1 walls of 2"),
        ("follow/orbits", ["1:1/2"], 0, "1:1/2"),
        ("follow/orbits", ["1:1/T"], 0, "1:1/T"),
        ("follow/orbits", ["/2T"], 0, "/2T"),
        ("follow/orbits", ["1:1 "], 0, "1:1 "),
        ("follow/orbits", [" BT"], 0, " BT"),
        ("follow/orbits", ["-1:1"], 0, "-1:1"),
        ("follow/orbits", ["1.5:1"], 0, "1.5:1"),
        ("follow/orbits", ["1001:1"], 0, "1000"),
        ("follow/orbits", ["B" * 1001], 0, "1000"),
        ("follow/orbits", ["999999999999999999999:1"], 0, "1000"),
        ("follow/orbits", ["1:1/999999999999999999999T"], 0, "1000"),
    ],
)
def test_items_of_lists(path, value, index, says):
    scene = changed({path: value})
    with pytest.raises(InputError) as caught:
        read_scene(scene)
    error = caught.value
    assert error.where == f"{path.replace('/', '.')}[{index}]"
    assert says in str(error)
    assert "\n" not in str(error)


@pytest.mark.parametrize("text", ["1:1", "BT", "S:1", "0/0T"])
def test_words_of_a_system_with_one_wall(text):
    error = refused(changed({"follow/orbits": [text]}, OSCILLATOR))
    assert error.where == "follow.orbits[0]"


def test_range_without_the_start_names_both():
    error = refused(changed({"follow/range": [0.5, 1.0]}))
    assert error.where == "follow.range"
    assert "[0.5, 1]" in error.found
    assert "s = 0.34" in error.found
    assert "model.parameters.s" in error.accepted


def test_derived_parameter_cannot_be_followed():
    error = refused(changed({"follow/parameter": "d"}))
    assert "derived" in error.found
    assert error.accepted.endswith("beta, r, A, s, M, omega, g")


def test_requested_values_without_the_values():
    error = refused(changed({"detect/events": ["UZ"]}))
    assert error.where == "detect.events"
    assert "detect.values.s" in error.accepted


@pytest.mark.parametrize(
    ("steps", "says"),
    [
        ({"min_step": 0.02}, "min_step = 0.02"),
        ({"step": 0.5}, "max_step = 0.03"),
        ({"max_step": 0.001}, "max_step = 0.001"),
        ({"min_step": 1.0, "step": 0.1, "max_step": 0.01}, "step = 0.1"),
    ],
)
def test_steps_out_of_order(steps, says):
    error = refused(changed({f"numerics/{name}": value for name, value in steps.items()}))
    assert error.where.startswith("numerics.")
    assert says in error.found


# Files


def written(scene):
    """A scene as TOML."""

    def value(given_value):
        if isinstance(given_value, list):
            return "[" + ", ".join(map(value, given_value)) + "]"
        return json.dumps(given_value)

    def table(path, data):
        lines = [f"[{path}]"] if path else []
        lines += [f"{k} = {value(v)}" for k, v in data.items() if not isinstance(v, dict)]
        for key, inner in data.items():
            if isinstance(inner, dict):
                lines += table(f"{path}.{key}" if path else key, inner)
        return lines

    return "\n".join(table("", scene)) + "\n"


@pytest.mark.parametrize("scene", [VALID, FULL, OSCILLATOR], ids=["least", "full", "oscillator"])
@pytest.mark.parametrize("kind", [str, Path])
def test_load_scene(tmp_path, scene, kind):
    path = tmp_path / "scene.toml"
    path.write_text(written(scene), encoding="utf-8")
    loaded = load_scene(kind(path))
    assert isinstance(loaded, Scene)
    assert loaded.given == scene
    assert loaded.resolved() == read_scene(scene).resolved()


def test_line_ends_of_other_platforms(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_bytes(written(VALID).replace("\n", "\r\n").encode())
    assert load_scene(path).given == VALID


def not_loaded(path):
    with pytest.raises(InputError) as caught:
        load_scene(path)
    error = caught.value
    assert error.where == str(path)
    assert "\n" not in str(error)
    assert len(str(error)) < 500 + len(str(path))
    return error


def test_no_file(tmp_path):
    assert "no such file" in not_loaded(tmp_path / "scene.toml").found


def test_no_folder(tmp_path):
    assert "no such file" in not_loaded(tmp_path / "nowhere" / "scene.toml").found


def test_a_folder_is_not_a_file(tmp_path):
    error = not_loaded(tmp_path)
    assert "folder" in error.found
    assert "scene.toml" in error.accepted


def test_below_a_file(tmp_path):
    (tmp_path / "file").write_text("")
    assert "cannot be read" in not_loaded(tmp_path / "file" / "scene.toml").found


@pytest.mark.parametrize("content", [b"\xff\xfe", b"name = '\xe9'", "é".encode("utf-16")])
def test_not_utf8(tmp_path, content):
    path = tmp_path / "scene.toml"
    path.write_bytes(content)
    error = not_loaded(path)
    assert "not UTF-8" in error.found


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (
            "[model.parameters]\nc = 1\nc = 2\n[follow]\n",
            "'model.parameters.c' is there twice; line 3",
        ),
        ("[model]\n[follow]\n[model]\n", "'model' is there twice; line 3"),
        ("g = { a = 1, a = 2 }", "'g' is there twice; line 1"),
        ("[model.parameters]\nc = 0,34", "line 2: 'c = 0,34'; write decimals with a point"),
        ("[model]\nperiod = 2*pi/w", 'quotes: model.period = "..."'),
        ("[model.modes.f]\nx = v", 'quotes: model.modes.f.x = "..."'),
        ("[model]\nperiod = [1", "not TOML at model.period"),
    ],
)
def test_mistakes_of_a_toml_file_are_named_by_their_key(tmp_path, text, found):
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    assert found in str(not_loaded(path))


def test_a_decimal_comma_and_an_underscore_are_seen():
    assert refused(changed({"model/parameters/r": "0,3"})).accepted.endswith(
        "decimals have a point"
    )
    assert "did you mean 'impact-pair'?" in refused(changed({"model/system": "impact_pair"})).found


@pytest.mark.parametrize(
    "text",
    [
        "name",
        "name = ",
        "name = x",
        "[model",
        "[model]\n[model]",
        "a = 1\na = 2",
        "{}",
        "\0",
        '{"name": "x"}',
        "a = [1",
        'a = "',
        "a = 1e",
        "a = 2020-02-30",
        "<xml/>",
    ],
)
def test_not_toml(tmp_path, text):
    path = tmp_path / "scene.toml"
    path.write_text(text, encoding="utf-8")
    error = not_loaded(path)
    assert "not TOML" in error.found


@pytest.mark.parametrize(("opening", "closing"), [("[", "]"), ("{a = ", "}")])
def test_deeply_nested(tmp_path, opening, closing):
    path = tmp_path / "scene.toml"
    path.write_text("a = " + opening * 50_000 + closing * 50_000, encoding="utf-8")
    error = not_loaded(path)
    assert "nested too deeply" in error.found


def test_empty_file(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text("")
    with pytest.raises(InputError, match=r"^name: missing"):
        load_scene(path)


@pytest.mark.parametrize(
    ("line", "where"),
    [
        ("A = nan", "model.parameters.A"),
        ("A = -inf", "model.parameters.A"),
        ("A = 1979-05-27", "model.parameters.A"),
        ("A = 07:32:00", "model.parameters.A"),
        ("A = true", "model.parameters.A"),
    ],
)
def test_what_toml_allows_and_a_parameter_does_not(tmp_path, line, where):
    path = tmp_path / "scene.toml"
    path.write_text(written(VALID).replace("A = 5.0", line), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        load_scene(path)
    assert caught.value.where == where


def test_reading_a_scene_imports_nothing_heavy():
    code = (
        "import sys, json, contimpact\n"
        f"contimpact.read_scene(json.loads({json.dumps(VALID)!r}))\n"
        "print([m for m in ('sympy', 'scipy', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# Any scene at all

scalars = st.one_of(
    st.booleans(),
    st.integers(),
    st.sampled_from([0, 1, -1, 10**400, 0.0, -0.0, 1e-320, 1e308]),
    st.floats(),
    st.dates(),
    st.text(max_size=8),
    st.sampled_from(["pi", "1/0", "s", "d", "G", "UZ", "BT", "1:1", "svg", "nan", "oscillator"]),
)
junk = st.recursive(
    scalars,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.dictionaries(st.text(string.ascii_letters, max_size=4), inner, max_size=2),
    ),
    max_leaves=5,
)
places = st.sampled_from(
    sorted(
        {
            f"{table}/{key}".removeprefix("/")
            for scene in (FULL, VALID)
            for table, data in [
                ("", scene),
                *((k, v) for k, v in scene.items() if isinstance(v, dict)),
                ("model/parameters", scene["model"]["parameters"]),
                ("detect/values", scene.get("detect", {}).get("values", {})),
            ]
            for key in [*data, "zzz"]
        }
    )
)


@settings(max_examples=400, deadline=None)
@given(
    base=st.sampled_from([VALID, FULL, OSCILLATOR]),
    mutations=st.dictionaries(places, st.one_of(st.just(ABSENT), junk), min_size=1, max_size=3),
)
@pytest.mark.full
def test_any_mutation_is_a_scene_or_is_refused(base, mutations):
    scene = copy.deepcopy(base)
    for path, value in mutations.items():
        *tables, key = path.split("/")
        table = scene
        for name in tables:
            table = table.setdefault(name, {}) if isinstance(table, dict) else table
        if not isinstance(table, dict):
            continue
        if value is ABSENT:
            table.pop(key, None)
        else:
            table[key] = value
    try:
        read = read_scene(scene)
    except InputError:
        return
    resolved = json.loads(json.dumps(read.resolved()))
    assert json.loads(json.dumps(read_scene(resolved).resolved())) == resolved


@settings(max_examples=100, deadline=None)
@given(scene=st.dictionaries(st.sampled_from([*VALID, "detect", "plot", "zzz"]), junk))
def test_anything_is_refused(scene):
    with pytest.raises(InputError):
        read_scene(scene)


@settings(max_examples=200, deadline=None)
@given(data=st.data())
def test_any_damage_to_the_file_is_refused_or_harmless(data, tmp_path_factory):
    text = written(VALID)
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 20)))
    damage = data.draw(st.one_of(st.just(b""), st.binary(max_size=4), st.just(b"[[a]]")))
    content = text[:start].encode() + damage + text[end:].encode()
    path = tmp_path_factory.getbasetemp() / "damaged.toml"
    path.write_bytes(content)
    try:
        scene = load_scene(path)
    except InputError:
        return
    assert tomllib.loads(content.decode()) == scene.given


# What the scene cannot mean


@pytest.mark.parametrize("name", ["", " ", "a\rb", "a\nb", "a\x1bb", "a\u202eb", "x" * 201])
def test_names_that_are_no_line_of_text(name):
    assert refused(changed({"name": name})).where == "name"


@pytest.mark.parametrize(
    "forcing",
    [
        "__import__('os')",
        "cos(pi*t",
        "",
        "cos(pi*x)",
        "1/0",
        "log(0)*cos(pi*t)",
        "1e999",
        "1e308*1e308*cos(pi*t)",
        "(1+sqrt(-1))*cos(pi*t)",
        "cos(pi*t)**(1/0)",
        "(-1)**0.5*cos(pi*t)",
    ],
)
def test_unreadable_forcing_is_refused_without_sympy(forcing):
    assert refused(changed({"model/forcing": forcing})).where == "model.forcing"


def test_unknown_names_are_named():
    assert "unknown name 'x'" in refused(changed({"model/forcing": "cos(pi*x)"})).found
    assert "unknown name 't'" in refused(changed({"model/parameters/A": "2*t"})).found


@pytest.mark.parametrize("key", ["forcing", "self", "name"])
def test_parameters_called_like_something_else(key):
    assert refused(changed({f"model/parameters/{key}": 1})).where == f"model.parameters.{key}"


def test_suggestion_for_a_parameter():
    assert "did you mean 'beta'" in refused(changed({"model/parameters/betta": 1})).found


def test_misspelt_required_key_is_named_with_the_right_one():
    error = refused(changed({"follow/orbits": ABSENT, "follow/orbit": ["1:1"]}))
    assert error.where == "follow.orbit"
    assert "'orbits'" in error.found


def test_accepted_keys_are_all_told():
    accepted = refused(changed({"plot/zzz": 1})).accepted
    assert {"x", "xlim", "ylim", "unphysical", "formats"} <= set(re.findall(r"\w+", accepted))


@pytest.mark.parametrize(
    "detect",
    [
        {"values": {"s": []}},
        {"events": ["UZ"], "values": {"s": []}},
        {"values": {"s": [0.5, 5.0]}},
        {"values": {"gbar": [0.2]}},  # it does not depend on s
    ],
)
def test_values_that_cannot_be_hit(detect):
    assert refused(changed({"detect": detect})).where.startswith("detect.")


@pytest.mark.parametrize("parameter", ["A", "beta", "M"])
def test_derived_values_of_parameters_they_depend_on(parameter):
    limits = [0.1, 1.0] if parameter == "beta" else [0.1, 6.0]
    follow = {"follow/parameter": parameter, "follow/range": limits}
    scene = changed(follow | {"detect": {"values": {"gbar": [0.2]}}})
    assert read_scene(scene).values == {"gbar": [0.2]}


@pytest.mark.parametrize("tolerance", [0, -1e-9, 1e-2, 1])
def test_tolerance(tolerance):
    assert refused(changed({"numerics/tolerance": tolerance})).where == "numerics.tolerance"


def test_resolved_scene_in_memory_is_a_scene():
    scene = read_scene(changed({"plot/xlim": [0, 1]}))
    assert read_scene(scene.resolved()).resolved() == scene.resolved()


# Messages


def test_messages_are_one_line():
    for path in ("a\nb", "detect/values/a\nb", "model/parameters/a\nb"):
        refused(changed({path: [1] if "values" in path else 1}))


@pytest.mark.parametrize(
    "changes",
    [
        {"model/parameters/A": "9" * 1999},
        {"model/parameters/A": list(range(5000))},
        {"follow/orbits": [1] * 5000},
        {"follow/orbits": ["9" * 5000 + ":1"]},
        {"follow/depth": -(10**5000)},
        {"x" * 3000: 1},
    ],
)
def test_messages_are_short(changes):
    with pytest.raises(InputError) as caught:
        read_scene(changed(changes))
    assert len(str(caught.value)) < 600


def test_whole_numbers_of_thousands_of_digits(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(written(VALID) + "\n[extra]\nx = " + "9" * 5000, encoding="utf-8")
    assert "not TOML" in not_loaded(path).found


def test_byte_order_mark(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(written(VALID), encoding="utf-8-sig")
    assert load_scene(path).name == VALID["name"]


def test_a_resolved_map_keeps_its_third_parameter():
    third = {"parameter": "beta", "range": [0.1, 1.0]}
    scene = read_scene(changed({"curves": {"parameter": "r", "range": [0.1, 0.9], "third": third}}))
    assert scene.resolved()["curves"]["third"] == third
    again = read_scene(json.loads(json.dumps(scene.resolved())))
    assert again.curves.third == scene.curves.third


@pytest.mark.parametrize(
    ("path", "given", "found"),
    [
        ("follow/orbits", ["1:1", "2:1", "BT"], lambda s: s.orbits),
        ("follow/switch", ["PD", "G", "PD"], lambda s: s.switch),
        ("detect/events", ["FB", "G", "FB"], lambda s: s.events),
        ("detect/values", {"s": [0.3, 0.4, "3/10"]}, lambda s: s.values["s"]),
        ("curves/start", [0.3, 0.25, 0.3], lambda s: s.curves.start),
        ("simulate/transitions", [1, 2, 1], lambda s: s.simulate.transitions),
        ("simulate/basins", [0.3, 0.2, 0.3], lambda s: s.simulate.basins),
    ],
)
def test_what_a_list_repeats_is_used_once_and_named(path, given, found, caplog):
    more = {"curves": {"parameter": "r", "range": [0.2, 0.4], "kinds": ["G"]}, "simulate": {}}
    scene = read_scene(changed({path: given}, {**VALID, **more}))
    assert len(found(scene)) == len(set(found(scene))) == 2
    (message,) = caplog.messages
    assert message.startswith(path.replace("/", "."))
    assert message.endswith("more than once; each value is used once")
