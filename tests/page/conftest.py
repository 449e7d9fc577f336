"""Diagrams that the page is tested on, computed once."""

from __future__ import annotations

import pytest

from contimpact.scenes.scene import read_scene
from contimpact.studies.explore import follow

PAIR = {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.34}
SMALL = {
    "name": "small",
    "source": "a test",
    "model": {"system": "impact-pair", "parameters": PAIR},
    "follow": {"parameter": "s", "range": [0.27, 0.4], "orbits": ["1:1"], "switch": ["G"]},
    "detect": {"events": ["FB", "PD", "G"]},
    "plot": {"x": "d"},
}
"""The 1:1 orbit with a period doubling and a ghost grazing, and the 2:1 orbit born there."""


@pytest.fixture(scope="session")
def small_scene():
    return read_scene(SMALL)


@pytest.fixture(scope="session")
def small(small_scene):
    return follow(small_scene)
