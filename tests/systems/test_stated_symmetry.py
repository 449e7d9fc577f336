"""The symmetry that a hybrid scene states: all variables change their signs."""

from copy import deepcopy

import pytest

import contimpact as ci
from contimpact.models.model import Symmetry

RATTLE = {
    "system": "hybrid",
    "period": "2*pi/w",
    "symmetry": {"R": "L"},
    "parameters": {"w": 1.7, "s": 0.5, "r": 0.7, "b": 0.0},
    "modes": {"free": {"x": "v", "v": "cos(w*t) + b - 0.1*v"}},
    "guards": {
        "R": {"within": "x <= s", "set": {"v": "-r*v"}},
        "L": {"within": "x >= -s", "set": {"v": "-r*v"}},
    },
}
"""A mass that rattles between two stops, as `two-stops` without a spring."""


def stated(given, *keys, **changes):
    """The scene's table with other values at a path."""
    found = deepcopy(given)
    table = found
    for key in keys:
        table = table[key]
    table.update(changes)
    return found


def scene(model, low=0.1, high=0.6, parameter="s", orbits=("RL",), **follow):
    given = {"parameter": parameter, "range": [low, high], "orbits": list(orbits), **follow}
    return ci.read_scene({"name": "symmetric", "model": model, "follow": given})


def test_images_are_half_a_period_later():
    model = scene(RATTLE).model
    assert model.symmetry("s", (0.0,)) == Symmetry({"R": "L", "L": "R"}, shift=0.5, sign=-1.0)
    assert model.symmetry("b", (0.0,)) is None, "b tells left from right"
    assert model.replace(b=0.1).symmetry("s", (0.0,)) is None


def test_images_of_a_swing_are_at_once():
    law = {"x": "v", "v": "-0.1*v - (1 + cos(w*t))*sin(x)"}
    model = stated(stated(RATTLE, "modes", free=law), parameters={"w": 1.7, "s": 0.5, "r": 0.7})
    assert scene(model).model.symmetry("w", (0.0,)).shift == 0.0


def test_modes_have_images():
    def beyond(side):
        return {"x": "v", "v": f"cos(w*t) - v - x - 10*(x {side} s)"}

    model = {
        "system": "hybrid",
        "period": "2*pi/w",
        "symmetry": {"A": "C", "D": "B"},
        "parameters": {"w": 1.2, "s": 0.5},
        "modes": {
            "free": {"x": "v", "v": "cos(w*t) - v - x"},
            "right": beyond("-"),
            "left": beyond("+"),
        },
        "guards": {
            "A": {"mode": "free", "within": "x <= s", "to": "right"},
            "B": {"mode": "right", "within": "x >= s", "to": "free"},
            "C": {"mode": "free", "within": "x >= -s", "to": "left"},
            "D": {"mode": "left", "within": "x <= -s", "to": "free"},
        },
    }
    walls = scene(model, orbits=["ABCD"]).model.symmetry("w", (0.0,)).walls
    assert walls == {"A": "C", "C": "A", "B": "D", "D": "B"}
    crossed = stated(model, symmetry={"A": "B", "C": "D"})
    with pytest.raises(ci.InputError, match=r"model\.symmetry: the mode 'free' has several images"):
        scene(crossed, orbits=["ABCD"])


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (stated(RATTLE, symmetry={"R": "K"}), "found 'K'; the guards are R, L"),
        (stated(RATTLE, symmetry={"R": "R"}), "'R' and 'R' are not on two sides"),
        (stated(RATTLE, "parameters", b=0.1), "the law of 'v' in 'free' does not change its sign"),
        (stated(RATTLE, "guards", "L", within="x >= -1.1*s"), "the position of 'R' does not"),
        (stated(RATTLE, "guards", "L", set={"v": "-v"}), "'v' after 'R' does not"),
    ],
    ids=["unknown", "itself", "law", "position", "set"],
)
def test_what_is_no_symmetry_is_refused(model, message):
    with pytest.raises(ci.InputError, match=rf"^model\.symmetry: .*{message}"):
        scene(model)


def test_branches_that_are_images_are_followed_once():
    """They are those of `two-stops`, in which the symmetry is declared."""
    parameters = {"a": 1, "omega": 1.7, "c": 0.1, "k": 0, "sigma": 0.5, "r": 0.7}
    own = {"system": "two-stops", "parameters": parameters}
    options = {"switch": ["BP"], "unphysical": False}
    found = ci.follow(scene(RATTLE, **options))
    known = ci.follow(scene(own, parameter="sigma", **options))
    assert [e.kind for e in found.entries] == [e.kind for e in known.entries]
    values = [e.value for e in known.entries]
    assert [e.value for e in found.entries] == pytest.approx(values, abs=1e-11)
    assert [len(b.events) for b in found.branches] == [len(b.events) for b in known.branches]
    without = {key: table for key, table in RATTLE.items() if key != "symmetry"}
    twice = ci.follow(scene(without, **options))
    assert len(twice.entries) > len(found.entries)


def test_records_of_systems_without_one_are_the_same():
    without = {key: table for key, table in RATTLE.items() if key != "symmetry"}
    assert "symmetry" not in scene(without).model.options["machine"]
    text = scene(RATTLE).model.options["machine"]
    assert type(scene(RATTLE).model)(machine=text, **RATTLE["parameters"]).symmetry("s", (0.0,))
