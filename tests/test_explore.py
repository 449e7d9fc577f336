"""A scene's whole diagram: each orbit once, and nothing missed between its events."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from contimpact import InputError, follow, load_scene, read_scene
from contimpact.diagram import Diagram
from contimpact.reading import read

FIG7 = Path(__file__).parent.parent / "branches" / "fig7" / "scene.toml"
SMALL = {
    "name": "small",
    "model": {
        "system": "impact-pair",
        "parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.34},
    },
    "follow": {"parameter": "s", "range": [0.3, 0.4], "orbits": ["1:1"]},
    "detect": {"events": ["PD", "G"]},
}


def small(**follow_keys):
    return read_scene({**SMALL, "follow": SMALL["follow"] | follow_keys})


def test_every_change_of_physicality_is_an_event():
    """Where an orbit begins to pass a wall it grazes it, or an impact appears or vanishes."""
    scene = dataclasses.replace(load_scene(FIG7), events=("FB", "BP", "PD", "G", "V", "T"))
    for branch in follow(scene).branches:
        reasons, events = branch["reason"], branch["event"]
        for i in np.nonzero(np.diff(branch["physical"]))[0]:
            if "passes wall" in reasons[i] + reasons[i + 1]:
                assert events[i] or events[i + 1], (branch.id, branch["s"][i])


def test_rotated_words_are_one():
    assert len(follow(small(orbits=["BT", "TB"])).branches) == len(follow(small()).branches)


@pytest.mark.parametrize("max_step", [0.015, 0.03])
def test_grazing_of_the_3_1_orbit_of_fig7(max_step):
    scene = load_scene(FIG7)
    settings = dataclasses.replace(scene.settings, max_step=max_step)
    labels = [
        entry.label for entry in follow(dataclasses.replace(scene, settings=settings)).entries
    ]
    assert "G[3:1->4:1]" in labels


@pytest.mark.parametrize(("rounds", "searched"), [(1, "1 round of"), (8, "2 rounds of")])
def test_what_was_searched_is_told(rounds, searched):
    """The search ends after two rounds that find nothing."""
    given = {**SMALL, "numerics": {"starts": 8, "rounds": rounds}}
    given["model"] = {
        "system": "impact-pair", "parameters": {**SMALL["model"]["parameters"], "s": 1.04}
    }  # fmt: skip
    given["follow"] = {**SMALL["follow"], "range": [1.0, 1.05]}
    with pytest.raises(InputError, match=f"{searched} 8 random starts"):
        follow(read_scene(given))


def test_reading_a_part_of_a_diagram():
    """Transitions onto branches that are not there are passed over."""
    diagram = follow(load_scene(FIG7))
    assert read(diagram).transitions
    assert not read(Diagram("part", diagram.branches[:1])).transitions
