"""Closed curves that no line crosses: an impact pair as a ball on a shaker with two harmonics.

Its orbits have one impact in a period, at the phase phi. The velocity that comes back asks for
sin phi + (p sin 2 phi - q cos 2 phi)/2 = K, and where the acceleration of the shaker vanishes,
cos phi + p cos 2 phi + q sin 2 phi = 0, the branch folds: for each phi at one p and one q.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from zoo import scene

from contimpact.diagrams.explore import follow
from contimpact.diagrams.map_lines import _gaps, _turning_places, near_misses, run_along
from contimpact.segments.kernels import Kernels

HALF, A, R = 30.0, 0.2, 0.9
K = math.pi * 0.1245 * 9.8 / A * (1.0 - R) / (1.0 + R)


def shaker(**curves):
    """The orbit with one impact at the bottom, over both amplitudes of the second harmonic."""
    return scene(
        model={
            "system": "impact-pair",
            "forcing": "cos(pi*t) + p*cos(2*pi*t) + q*sin(2*pi*t)",
            "parameters": {"beta": "pi/2", "r": R, "A": A, "s": 1.0, "p": 20.0, "q": 20.0},
        },
        follow={"parameter": "p", "range": [-HALF, HALF], "orbits": ["B"], "switch": []},
        detect={"events": ["FB", "PD"]},
        curves={"parameter": "q", "range": [-HALF, HALF], "kinds": ["FB", "PD"], **curves},
        numerics={"starts": 16},
    )


def folds(phi):
    """The closed form: p and q."""
    away = 2.0 * (K - np.sin(phi))
    c, s = np.cos(2.0 * phi), np.sin(2.0 * phi)
    return -np.cos(phi) * c + away * s, -np.cos(phi) * s - away * c


@pytest.fixture(scope="module")
def diagram():
    return follow(shaker(cover=1))


@pytest.mark.full
def test_isolas_are_found_from_lines_that_cross_none(diagram):
    """The lines are the sides of the rectangle; the curves are a ninth and a quarter as wide."""
    (told,) = diagram.coverage
    assert told.complete
    assert not told.uncovered
    for values in told.lines.values():
        assert np.abs(values) == pytest.approx([HALF, HALF], rel=1e-5)
    assert sorted(curve.kind for curve in diagram.curves) == ["FB", "PD"]
    for curve in diagram.curves:
        assert {end.kind.name for end in curve.ends} == {"CLOSED"}
        assert max(np.abs(curve["p"]).max(), np.abs(curve["q"]).max()) < 0.26 * HALF


@pytest.mark.full
def test_the_fold_is_that_of_the_closed_form(diagram):
    (fold,) = (curve for curve in diagram.curves if curve.kind == "FB")
    phi = math.pi * fold["t1"]
    for name, exact in zip(("p", "q"), folds(phi), strict=True):
        assert fold[name] == pytest.approx(exact, abs=1e-11)
    assert abs(phi[-1] - phi[0]) == pytest.approx(2.0 * math.pi, abs=1e-9)  # all of it, once


def test_near_misses_are_extrema_on_one_side_of_zero():
    """Along the line q = -20, which meets no event."""
    given = shaker()
    kernels = Kernels(given.model, "p")
    model = given.model.replace(q=-20.0)
    runs = run_along(given, model, given.orbits[0], kernels, given.range, [-10.0, 10.0])
    found = [miss for run in runs for miss in near_misses(run, ["FB", "PD"])]
    assert not any(event.kind in ("FB", "PD") for run in runs for event in run.events)
    assert {miss.kind for miss in found} == {"FB", "PD"}
    assert all(abs(miss.unknowns[-1]) < 0.1 * HALF for miss in found)


def test_near_misses_of_gaps_are_those_of_orbits_that_violate_nothing_else():
    """Descents from ghosts took most of a map's time. No orbit of this run is physical."""
    given = scene(
        model={
            "system": "oscillator",
            "parameters": {"a": 1.0, "omega": 1.3, "c": 0.1, "k": 1.0, "sigma": 0.2, "r": 0.6},
        },
        follow={"parameter": "omega", "range": [0.7, 3.2], "orbits": ["2"]},
        curves={"parameter": "sigma", "range": [-0.6, 1.2]},
    )
    word, kernels = given.orbits[0], Kernels(given.model, "omega")
    runs = run_along(given, given.model, word, kernels, given.range, [1.0, 2.0, 2.6])
    assert not any(point.evaluation.verdict.physical for run in runs for point in run.points)
    counts = [[len(near_misses(run, [kind])) for run in runs] for kind in ("FB", "G")]
    extrema = [sum(map(len, map(_turning_places, _gaps(run.points).T))) for run in runs]
    assert sum(extrema) > 0
    assert [sum(count) > 0 for count in counts] == [True, False]
