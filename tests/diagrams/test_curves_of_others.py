"""Curves of other systems, against their closed forms."""

import numpy as np
import pytest

import contimpact as ci
from contimpact.results.scene import read_scene
from contimpact.systems.oscillator import Oscillator


@pytest.mark.full
def test_grazing_orbits_of_an_oscillator():
    """COCO's demonstration `impact`: the orbit without impacts has the amplitude sigma."""
    model = Oscillator(a=1.0, omega=1.0, c=0.1, k=1.0, sigma=1.0, r=0.8)
    orbit = next(o for o in ci.find_orbits(model, "S", parameter="a") if o.physical)
    branch = ci.continue_orbit(orbit, "a", (0.01, 1.0), events=["V"])
    (grazing,) = branch.events
    assert abs(grazing.value - 0.1) < 1e-15
    curve = ci.follow_curve(
        grazing, second="omega", first_range=(0.01, 1.0), second_range=(0.2, 1.5)
    )
    a, omega = curve["a"], curve["omega"]
    assert (omega.min(), a.max()) == (0.2, 1.0)
    assert np.max(np.abs(a - np.hypot(1.0 - omega**2, 0.1 * omega))) < 1e-12


def neuron(g, w, orbit):
    """A forced neuron that fires at 1."""
    given = {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": {"I": 1.34, "a": 0.66, "g": g, "w": w},
        "modes": {"m": {"V": "I - g*V + a*cos(w*t)"}},
        "guards": {"S": {"mode": "m", "within": "V <= 1", "set": {"V": "0"}}},
    }
    follow = {"parameter": "I", "range": [1.2, 1.5], "orbits": [orbit]}
    return read_scene({"name": "neuron", "model": given, "follow": follow}).model


def test_no_fold_is_born_where_the_touch_is_a_jump():
    """Rounding of a determinant was looked at. Without firing, V = I/g + a cos(w t - phase)/Z."""
    model = neuron(0.7, 6.0, "0").replace(I=0.3)
    (orbit,) = ci.find_orbits(model, "0", parameter="I")
    (event,) = ci.continue_orbit(orbit, range=(0.2, 1.5), events=["G"]).events
    curve = ci.follow_curve(event, model, "a", (0.2, 1.5), (0.1, 1.2))
    assert (curve.missed, curve.points) == ([], [])
    assert curve["I"] / 0.7 + curve["a"] / np.hypot(0.7, 6.0) == pytest.approx(1.0, abs=1e-13)


@pytest.mark.parametrize("kind", ["V", "G"])
def test_a_jump_touches_where_the_flight_before_it_ends(kind):
    """A forced neuron fires at 1 without a rate. The touch is degenerate where the rate's own rate
    vanishes, too: I - g = a at the forcing's minimum. After the reset it does elsewhere."""
    g, w = 0.7, 6.0
    model = neuron(g, w, "1")
    events = [
        event
        for orbit in ci.find_orbits(model, "1", parameter="I")
        for event in ci.continue_orbit(orbit, range=(1.2, 1.5), events=["V", "G"]).events
        if event.kind == kind
    ]
    curve = ci.follow_curve(events[0], model, "a", (1.2, 1.5), (0.6, 0.75))
    (point,) = curve.points
    place = point.parameters
    decay = 1.0 - np.exp(-2.0 * np.pi * g / w)
    a = (1.0 / decay - 1.0) / (1.0 / g - g / (g**2 + w**2))
    assert (point.kind, curve.missed) == ("DG", [])
    assert (place["a"], place["I"]) == pytest.approx((a, g + a), abs=1e-12)
    assert abs(place["a"] - a) < point.error < 1e-12
    if kind == "G":  # its curve ends there
        assert curve["a"][[0, -1]].min() == pytest.approx(a, abs=1e-12)
