"""Scenes to start from: each is valid as it is printed, and with what its comments offer."""

from __future__ import annotations

import importlib.util
import re
import tomllib
from types import SimpleNamespace

import pytest

import contimpact as ci
from contimpact.cli import main
from contimpact.systems import SYSTEMS

INTEGRATED = ("pendulum", "duffing", "van-der-pol")
"""Systems whose flights need the extra `ode`."""


@pytest.fixture(params=SYSTEMS)
def name(request):
    if request.param in INTEGRATED and importlib.util.find_spec("heyoka") is None:
        pytest.skip("needs contimpact[ode]")
    return request.param


@pytest.fixture
def scene(tmp_path):
    def written(name):
        path = tmp_path / "scene.toml"
        path.write_text(ci.new_scene(name), encoding="utf-8")
        return str(path)

    return written


def test_each_system_has_one(name):
    text = ci.new_scene(name)
    scene = ci.read_scene(tomllib.loads(text))
    assert isinstance(scene.model, ci.list_systems()[name])
    declared = [p.name for p in scene.model.PARAMETERS]
    assert all(re.search(rf"^(# )?{name} += ", text, re.MULTILINE) for name in declared)
    assert max(map(len, text.splitlines())) <= 140


def test_what_comments_offer_is_valid(name):
    """Every line that a comment sign leaves out may be used."""
    lines = ci.new_scene(name).splitlines()
    used = [re.sub(r"^# (?=\[|\w+ += )", "", line) for line in lines]
    scene = ci.read_scene(tomllib.loads("\n".join(used)))
    assert scene.curves is not None
    assert scene.simulate is not None
    assert (scene.survey, scene.depth, scene.unphysical, scene.plot.html) == (True, 2, False, True)


@pytest.mark.quick(3)
def test_check_admits_it(name, scene, capsys):
    assert main(["check", scene(name)]) == 0
    assert " at the start" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["impact-pair", "oscillator", "belt"])
@pytest.mark.full
def test_a_run_of_it_finds_what_is_stable(name, scene, tmp_path, capsys):
    assert main(["run", scene(name), "-o", str(tmp_path / "out"), "--no-plot"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("stable   b1 ")
    assert "status changes" not in out


@pytest.mark.full
@pytest.mark.parametrize("name", ["hybrid", "linear"])
def test_machines_that_it_states_run(name, scene, tmp_path, capsys):
    assert main(["run", scene(name), "-o", str(tmp_path / "out"), "--no-plot"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("stable   b1 ")
    assert "status changes" not in out


def test_the_command_prints_it_and_lists_all_systems(capsys):
    assert main(["new", "soft-stop"]) == 0
    assert capsys.readouterr().out == ci.new_scene("soft-stop") + "\n"
    assert main(["systems"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(SYSTEMS)
    kinds = [kind.__name__ for kind in ci.list_systems().values()]
    assert [line.rpartition("(")[2].rstrip(")") for line in lines] == kinds


def test_a_plugin_has_one_if_it_gives_an_example(monkeypatch):
    class Swing(ci.Oscillator):
        """A swing against a stop."""

        SYSTEM = "swing"

    monkeypatch.setattr("contimpact.systems._plugins", lambda: {"swing": entry(Swing)})
    text = ci.new_scene("swing")
    assert ci.read_scene(tomllib.loads(text)).model == Swing(**ci.Oscillator.EXAMPLE.values)
    Swing.EXAMPLE = None
    with pytest.raises(ci.InputError, match=r"no system 'swing'; accepted are belt, bouncing-ball"):
        ci.new_scene("swing")


def entry(kind):
    """What a plugin offers."""
    return SimpleNamespace(value="swings:Swing", load=lambda: kind)


def test_a_name_that_is_no_system_is_refused(capsys):
    assert main(["new", "soft_stop"]) == 2
    said = capsys.readouterr().err
    assert "SYSTEM: no system 'soft_stop' (did you mean 'soft-stop'?)" in said
