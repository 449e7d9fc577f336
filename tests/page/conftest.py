"""Diagrams that the page is tested on, computed once."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from contimpact.diagrams.curves import follow_curve
from contimpact.diagrams.explore import follow
from contimpact.results.curve import Area, Doubt, StableOrbit
from contimpact.results.scene import read_scene

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


MASSES = {"c1": 0.1, "c2": 0.05, "k1": 1.0, "k2": 0.6, "a1": 1.0, "omega": 1.8}
MASSES |= {"sigma_1": 1.0, "sigma_2": 1.0, "r": 0.8}
TWO_MASSES = {
    "name": "two masses",
    "model": {"system": "two-masses", "parameters": MASSES},
    "follow": {"parameter": "omega", "range": [1.74, 1.83], "orbits": ["A"]},
    "detect": {"events": ["FB", "PD"]},
}
"""Two coordinates, of which one is hit."""


@pytest.fixture(scope="session")
def masses_scene():
    return read_scene(TWO_MASSES)


@pytest.fixture(scope="session")
def masses(masses_scene):
    return follow(masses_scene)


@pytest.fixture(scope="session")
def small_margins(small, small_scene):
    """It with margins that are distances to the period doubling, in tolerances of 0.01 m, and an
    output, s again; and its scene, which shades margins below 1."""
    doubling = next(e for e in small.entries if e.kind == "PD")
    branches = []
    for branch in small.branches:
        shown = branch.stable & branch.physical & (branch.id == doubling.branch)
        margins = np.where(shown, abs(branch["s"] - doubling.value) / 0.01, np.nan)
        events = np.where(shown, "PD", "").astype(object)
        columns = {"margin": margins, "margin_event": events, "size": branch["s"]}
        columns |= {"size_error": 0.0 * margins}
        branches.append(dataclasses.replace(branch, columns={**branch.columns, **columns}))
    plot = dataclasses.replace(small_scene.plot, margin=1.0)
    scene = dataclasses.replace(small_scene, plot=plot)
    return dataclasses.replace(small, branches=branches), scene


@pytest.fixture(scope="session")
def small_map(small, small_scene):
    """Its period doubling over r, and areas as records: one in the plane of the curve, one in which
    nothing is stable, one of another plane."""
    doubling = next(e for e in small.entries if e.kind == "PD")
    curve = follow_curve(doubling, None, "r", small_scene.range, (0.25, 0.35), detect=False)
    low, high = float(curve["d"].min()), float(curve["d"].max())
    ring = [(0.25, low), (0.35, low), (0.35, high), (0.25, high), (0.25, low)]
    orbit = StableOrbit("BT", 1, "1:1", "PD", "PD", "supercritical", [3])
    doubt = Doubt(0.3, 0.2, "no stable orbit of the scene's words")
    about = {"fixed": {}, "across": "r", "along": "d", "borders": [[(0, "side")]], "places": []}
    common = {"polygon": [ring], "part": 0.5, "checked": 1, **about}
    areas = [
        Area(id="a1", orbits=[orbit], doubtful=[doubt], **common),
        Area(id="a2", orbits=[], **common),
        Area(id="a3", orbits=[orbit], **{**common, "along": "s"}),
    ]
    return dataclasses.replace(small, curves=[curve], areas=areas)
