"""Random systems: every event is a true one, and a twenty times finer walk finds no other."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from contimpact.accuracy.reference import Reference
from contimpact.bifurcations.declarations import EVENTS
from contimpact.bifurcations.kind import test_functions as make_tests
from contimpact.continuation.settings import Settings
from contimpact.diagrams.orbit_walks import walk_both_ways
from contimpact.orbits.search import find_orbits
from contimpact.segments.kernels import Kernels
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

COARSE = Settings(max_points=150)
FINER = 20
WORDS = ("1:1", "2:1", "1:1/2T", "2:2", "3:1", "1:0", "1:2/2T", "BTBT", "B/2T", "3:2")
FEW = (2, 15, 40, 62, 71, 94, 111, 119, 1027, 1103)
"""Seeds run without the marker `slow`; 15 has two grazings within one step, in 1027 a gap jumps
from nearly nothing, and in 1103 a velocity of rounding's size is an impact at rest."""


def random_pair(rng):
    model = ImpactPair(
        beta=float(rng.choice([0.0, rng.uniform(0, 1.5)])),
        r=float(rng.uniform(0.05, 0.95)),
        A=float(rng.uniform(3, 12)),
        s=float(rng.uniform(0.15, 1.0)),
    )
    parameter = ["s", "A", "r", "beta"][rng.integers(4)]
    value = model.values[parameter]
    fixed = {"r": (0.0, 1.0), "beta": (-math.pi / 2, math.pi / 2)}
    return (
        model,
        parameter,
        WORDS[rng.integers(len(WORDS))],
        fixed.get(parameter, (0.4 * value, 2.0 * value)),
    )


def random_oscillator(rng):
    model = Oscillator(
        a=1.0,
        omega=float(rng.uniform(1.5, 5)),
        c=float(rng.uniform(0, 0.3)),
        k=1.0,
        sigma=float(rng.uniform(-0.2, 0.5)),
        r=float(rng.uniform(0.2, 0.95)),
    )
    parameter = ["omega", "sigma", "r", "a"][rng.integers(4)]
    word = ["S", "S/2T", "SS/2T", "SS/3T"][rng.integers(4)]
    value = model.values[parameter]
    low, high = {"omega": (0.6, 1.5)}.get(parameter, (0.5, 2.0))
    fixed = {"sigma": (-0.5, 0.8), "r": (0.0, 1.0)}
    return model, parameter, word, fixed.get(parameter, (low * value, high * value))


def random_branch(seed):
    """An orbit of a random system and a range to follow it in; None where none was found."""
    rng = np.random.default_rng(seed)
    make = random_oscillator if rng.uniform() < 0.2 else random_pair
    model, parameter, word, limits = make(rng)
    kernels = Kernels(model, parameter)
    orbits = find_orbits(model, word, kernels=kernels, starts=64, rounds=3)
    return (orbits[seed % len(orbits)], limits) if orbits else None


def followed(orbit, limits, settings):
    tests = make_tests(orbit.problem, EVENTS, {})
    return walk_both_ways(orbit.problem, orbit.unknowns, limits, tests, settings)


def check(seed):
    """Returns the number of events checked, None where there is no orbit."""
    found = random_branch(seed)
    if found is None:
        return None
    orbit, limits = found
    run = followed(orbit, limits, COARSE)
    reference = Reference(orbit.problem)
    for event in run.events:
        names, at = orbit.problem.kernels.parameters, event.point.parameter
        if names == ("r",) and 1e-10 < event.error < 1e-7 and abs(at) < event.error:
            continue  # at r = 0 several impacts come together: no exact system is regular there
        exact = reference.event(event.kind, event.point.unknowns, event.details)
        assert exact is not None, event
        assert exact.distance(event.point.unknowns) < 1e-10, event
    fine = followed(orbit, limits, finer())
    reach = [reached(walk) for walk in run.walks]
    start = fine.walks[0].points[-1].arclength
    for event in fine.events:
        if -reach[0] < event.point.arclength - start < reach[1]:
            assert any(same(orbit.problem, event, other) for other in run.events), event
    return len(run.events)


def finer():
    changes = {name: getattr(COARSE, name) / FINER for name in ("max_step", "step", "max_angle")}
    return dataclasses.replace(
        COARSE, min_step=COARSE.min_step / FINER, max_points=COARSE.max_points * FINER, **changes
    )


def reached(walk):
    """How far a walk went; what lies beyond its limit of points is not compared."""
    return walk.points[-1].arclength if walk.end.kind.name == "POINTS" else math.inf


def same(problem, one, other):
    apart = problem.difference(one.point.unknowns, other.point.unknowns)
    return (
        one.kind == other.kind
        and one.details.get("index") == other.details.get("index")
        and np.max(np.abs(apart)) < 1e-7
    )


@pytest.mark.parametrize("seed", FEW)
@pytest.mark.quick(1)
def test_no_event_is_missed_or_false(seed):
    check(seed)


@pytest.mark.slow
def test_no_event_is_missed_or_false_in_a_hundred_systems():
    counts = []
    seed = 1000
    while len(counts) < 100:
        count = check(seed)
        counts += [] if count is None else [count]
        seed += 1
    assert sum(counts) > 200


def test_the_remedy_costs_little():
    """The 1:1 branch of Fig. 7 at the default settings."""
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    orbit = find_orbits(model, "1:1", parameter="s", starts=64, rounds=3)[0]
    run = followed(orbit, (0.08, 1.05), Settings(max_step=0.03))
    points = sum(len(walk.points) for walk in run.walks)
    iterations = sum(walk.corrector_iterations for walk in run.walks)
    assert points < 300
    assert iterations < 3 * points
