"""A curve that another package's demonstration follows, against its closed form."""

import numpy as np
import pytest

import contimpact as ci
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
