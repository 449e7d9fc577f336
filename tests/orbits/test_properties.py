"""Whatever the scene: only `InputError` is raised, nothing hangs, branches end with a reason."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from contimpact.continuation.branch import EndKind
from contimpact.diagrams.explore import follow
from contimpact.errors import InputError
from contimpact.results.scene import read_scene

MODEST = settings(
    max_examples=12,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=list(HealthCheck),
)
MANY = settings(MODEST, max_examples=300)
FORCINGS = ["cos(pi*t)", "sin(pi*t)", "cos(pi*t) + 0.5*cos(2*pi*t)", "0", "cos(3*t)", "1/t"]


def numbers(low, high):
    """Plain numbers of a range, its ends and what lies beyond among them."""
    inside = st.floats(low, high, allow_subnormal=False)
    return st.one_of(inside, inside, inside, st.sampled_from([low, high, low - 1.0, 0.0]))


@st.composite
def pairs(draw):
    values = {
        "beta": draw(numbers(-1.5, 1.5)),
        "r": draw(numbers(0.0, 1.0)),
        "A": draw(numbers(0.5, 30.0)),
        "s": draw(numbers(0.01, 2.0)),
    }
    forcing = draw(st.sampled_from([*["cos(pi*t)"] * 4, *FORCINGS]))
    words = ["1:1", "2:1", "1:0", "0:1", "1:1/2T", "BTBT", "3:2", "X", "0:0", "B/3T", ""]
    model = {"system": "impact-pair", "forcing": forcing, "parameters": values}
    return model, draw(st.sampled_from(list(values))), draw(st.sampled_from(words))


@st.composite
def oscillators(draw):
    values = {
        "a": draw(numbers(0.0, 3.0)),
        "omega": draw(numbers(0.2, 6.0)),
        "c": draw(numbers(-0.1, 3.0)),
        "k": draw(numbers(0.1, 4.0)),
        "sigma": draw(numbers(-1.0, 1.0)),
        "r": draw(numbers(0.0, 1.0)),
    }
    words = ["1", "1/2T", "S/2T", "SS/3T", "2", "T"]
    model = {"system": "oscillator", "parameters": values}
    return model, draw(st.sampled_from(list(values))), draw(st.sampled_from(words))


@st.composite
def scenes(draw):
    model, parameter, word = draw(st.one_of(pairs(), pairs(), oscillators()))
    value = model["parameters"][parameter]
    below, above = draw(st.floats(0.0, 0.5)), draw(st.floats(0.0, 0.5))
    kinds = ["FB", "BP", "PD", "NS", "G", "V", "T"]
    events = draw(st.lists(st.sampled_from(kinds), unique=True, max_size=7))
    switch = [kind for kind in events if kind in ("G", "PD", "V", "BP") and draw(st.booleans())]
    return {
        "name": "random",
        "model": model,
        "follow": {
            "parameter": parameter,
            "range": [value - below, value + above],
            "orbits": [word],
            "switch": switch,
            "depth": 1,
            "max_branches": 4,
            "max_points": 150,
        },
        "detect": {"events": events},
        "numerics": {
            "starts": 16,
            "rounds": 2,
            "max_points": 60,
            "predictor": draw(st.sampled_from(["tangent", "secant"])),
        },
    }


def holds(given_scene):
    try:
        diagram = follow(read_scene(given_scene))
    except InputError:
        return
    for branch in diagram.branches:
        assert len(branch.ends) == 2
        for end in branch.ends:
            assert isinstance(end.kind, EndKind)
            assert end.message
        assert len(branch) <= 60 * 2 + len(branch.events)
        for event in branch.events:
            assert event.kind in given_scene["detect"]["events"]
            assert event.error >= 0.0


@MODEST
@given(scenes())
@pytest.mark.full
def test_random_scenes(given_scene):
    holds(given_scene)


@pytest.mark.slow
@MANY
@given(scenes())
def test_many_random_scenes(given_scene):
    holds(given_scene)
