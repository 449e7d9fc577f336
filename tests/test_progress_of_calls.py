"""Progress of calls from Python: told where it is asked for, and nowhere else."""

from __future__ import annotations

import math

import pytest
from zoo import scene_table

import contimpact as ci
from contimpact import progress
from contimpact.results.options import Settling

SCENE = scene_table(name="pair", follow={"range": [0.3, 0.4]}, detect={"events": ["PD", "G"]})
FEW = ci.Settings(max_points=150, step=0.002, max_step=0.002)
QUICK = Settling(transient=20, periods=200, impacts=400)


@pytest.fixture(scope="module")
def pair():
    return ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)


@pytest.fixture(scope="module")
def branch(pair):
    orbit = next(o for o in ci.find_orbits(pair, "1:1", parameter="s") if o.physical)
    return ci.continue_orbit(orbit, range=(0.3, 0.4), events=["PD", "G"])


def calls(pair, branch):
    grazing = next(e for e in branch.events if e.kind == "G")
    walk = {"range": (0.3, 0.4), "events": ["PD"], "settings": FEW}
    ranges = (0.2, 0.5), (0.2, 0.4)
    return {
        "find_orbits": lambda p: ci.find_orbits(pair, "1:1", parameter="s", progress=p),
        "continue_orbit": lambda p: ci.continue_orbit(branch.orbit(0), progress=p, **walk),
        "continue_born": lambda p: ci.continue_born(grazing, progress=p, **walk),
        "follow": lambda p: ci.follow(ci.read_scene(SCENE), progress=p),
        "follow_curve": lambda p: ci.follow_curve(
            grazing, None, "r", *ranges, settings=FEW, progress=p
        ),
        "sweep": lambda p: ci.sweep(pair, "s", [0.4, 0.39], settling=QUICK, progress=p),
    }


NAMES = ["find_orbits", "continue_orbit", "continue_born", "follow", "follow_curve", "sweep"]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.quick(2)
def test_a_function_is_told_and_nothing_is_printed(name, pair, branch, capsys):
    told = []
    asked, unasked = (calls(pair, branch)[name](p) for p in (told.append, False))
    assert told
    assert all(isinstance(line, str) and line for line in told)
    assert repr(asked) == repr(unasked)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("name", NAMES)
def test_true_is_told_on_standard_error(name, pair, branch, capsys, monkeypatch):
    monkeypatch.setattr(progress, "PAUSE", 1e-4)
    calls(pair, branch)[name](True)
    out, err = capsys.readouterr()
    assert out == ""
    assert " s: " in err


def test_a_callback_is_called_all_the_same(branch):
    points = []

    def until(point):
        points.append(point.parameter)
        return len(points) == 5

    told = []
    ci.continue_orbit(
        branch.orbit(0), range=(0.3, 0.4), events=[], callback=until, progress=told.append
    )
    assert len(points) >= 5
