"""Events of integrated flights at random, against thirty digits."""

import math

import numpy as np
import pytest

import contimpact as ci
from contimpact.accuracy.reference import Reference
from contimpact.continuation.settings import Settings
from contimpact.results.branch import orbit_of
from contimpact.systems.duffing import Duffing
from contimpact.systems.pendulum import Pendulum

pytest.importorskip("heyoka", reason="needs contimpact[ode]")

DETAILS = ("flight", "wall", "impact", "touch_time", "requested")


def at_random(rng):
    """A model, a parameter and its range."""
    either = {"a": (0.2, 2), "omega": (0.5, 2.5), "c": (0.02, 0.4), "r": (0.4, 0.95)}
    if rng.random() < 0.5:
        kind, more, names = Pendulum, {"sigma": (-0.5, 2)}, ("omega", "a", "sigma")
    else:
        more = {"alpha": (-1, 1.5), "beta": (0.2, 2), "sigma": (-0.5, 1)}
        kind, names = Duffing, ("omega", "a", "beta")
    model = kind(**{name: rng.uniform(*limits) for name, limits in (either | more).items()})
    name = names[rng.integers(3)]
    value = model.values[name]
    return model, name, (max(0.3, value - 0.25) if name == "omega" else value - 0.25, value + 0.25)


@pytest.mark.slow
def test_true_errors_are_within_the_estimates():
    """Two hundred events; the largest true error was 2e-14, 0.4 of its estimate."""
    rng, ratios = np.random.default_rng(7), []
    while len(ratios) < 200:
        model, name, limits = at_random(rng)
        word = ("S", "SS", "S/2T")[rng.integers(3)]
        orbits = ci.find_orbits(model, word, parameter=name, starts=16, rounds=1)
        if not orbits:
            continue
        settings = Settings(max_points=150)
        branch = ci.continue_orbit(
            orbits[0], name, limits, events=["FB", "PD", "G", "V", "BP", "NS"], settings=settings
        )
        for entry in branch.events:
            here = orbit_of(entry, model, orbits[0].problem.kernels)
            details = {name: getattr(entry, name) for name in DETAILS}
            exact = Reference(here.problem, 30).event(entry.kind, here.unknowns, details)
            ratios.append(abs(exact.parameter_error(entry.value)) / entry.error)
            assert ratios[-1] < 1.0, (entry.kind, model, word, name)
            assert entry.error < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize(
    "values",
    [
        {"sigma": math.pi},
        {"c": 1e4, "a": 2e4, "omega": 1.0},
        *({"omega": w, "sigma": 0.3} for w in (1e-3, 1e-2, 3e-2, 1.0)),
        *({"omega": w, "sigma": 0.0} for w in (1e1, 1e2, 1e3)),
    ],
    ids=str,
)
def test_extremes(values):
    """The upright position, damping of 1e4, six decades of the frequency. That damping leaves a
    multiplier of 0.9994, and equations of the condition 7e4."""
    model = Pendulum(**{"a": 1.0, "omega": 0.8, "c": 0.1, "sigma": 1.0, "r": 0.8} | values)
    found = ci.find_orbits(model, "S", parameter="a", starts=4, rounds=1)
    assert found
    for orbit in found:
        reference = Reference(orbit.problem, 30)
        exact = reference.orbit(orbit.unknowns)
        condition = np.linalg.cond(orbit.linearisation.jacobian[:, :-1])
        assert exact.distance(orbit.unknowns) < max(
            1e-13 * max(1e3, orbit.period), 1e-14 * condition
        )
