"""Forcings with high harmonics, along whose branches events lie close together: none is lost."""

from __future__ import annotations

import numpy as np
import pytest
from zoo import harmonic_pair

from contimpact.bifurcations.declarations import EVENTS
from contimpact.bifurcations.extended_system import TouchingFlight, located
from contimpact.bifurcations.grazing import Grazing
from contimpact.bifurcations.kind import test_functions as make_tests
from contimpact.continuation.branch import EndKind
from contimpact.continuation.settings import Settings
from contimpact.diagrams.orbit_walks import symmetric_end, walk_both_ways
from contimpact.orbits.search import find_orbits
from contimpact.segments.kernels import Kernels

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

HARMONICS = 5
RANGE = (0.08, 1.05)
WORDS = ("1:1", "1:1", "2:1", "1:1/2T", "2:2", "1:0")
PLAIN = Settings(max_points=4000)
FINE = Settings(step=5e-4, max_step=5e-3, max_angle=0.01, min_step=1e-9, max_points=80000)
"""Steps a twentieth of the default ones."""

FEW = {14: RANGE, 29: RANGE, 60: RANGE, 1092: (0.3, 0.5)}
"""Seeds run without the marker `slow`, and ranges. The first lost six events of nine; the last two
of 35, period doublings within a wave that the points on both sides did not show."""


def random_model(rng):
    """One harmonic of order 1 and up to four more, of orders up to 40."""
    count = int(rng.integers(1, HARMONICS))
    orders = [1, *sorted(rng.choice(np.arange(2, 41), count, replace=False).tolist())]
    waves = [(1, 1.0, 0.0)]
    for order in orders[1:]:
        a = rng.uniform(-0.5, 0.5)
        waves.append((order, a, 0.0 if rng.uniform() < 0.5 else rng.uniform(-0.5, 0.5)))
    return harmonic_pair(
        waves,
        beta=float(rng.uniform(0, 1.4)),
        r=float(rng.uniform(0.1, 0.9)),
        A=5.0,
        s=float(rng.uniform(0.2, 0.8)),
    )


def random_orbit(seed):
    """An orbit under a random forcing; None where none was found."""
    rng = np.random.default_rng(seed)
    model = random_model(rng)
    word = WORDS[rng.integers(len(WORDS))]
    found = find_orbits(model, word, kernels=Kernels(model, "s"), starts=64, rounds=3)
    return found[seed % len(found)] if found else None


def followed(orbit, limits, settings):
    problem = orbit.problem
    tests = make_tests(problem, EVENTS, {})
    return walk_both_ways(
        problem, orbit.unknowns, limits, tests, settings, stop=symmetric_end(problem)
    )


def lost(orbit, limits=RANGE):
    """How many events a twenty times finer walk has, none of them lost; and how many are `missed`.

    An entry of `missed` says where an event may be that the default walk cannot exclude.
    """
    run, fine = followed(orbit, limits, PLAIN), followed(orbit, limits, FINE)
    ends = [w.end.kind for w in run.walks]
    assert ends == [w.end.kind for w in fine.walks]
    assert EndKind.POINTS not in ends

    def same(one, other):
        apart = orbit.problem.difference(one.point.unknowns, other.point.unknowns)
        return (
            one.kind == other.kind
            and one.details.get("index") == other.details.get("index")
            and np.max(np.abs(apart)) < 1e-6
        )

    missing = [e for e in fine.events if not any(same(e, other) for other in run.events)]
    assert missing == []
    assert len(run.events) == len(fine.events)
    return len(fine.events), sum(len(walk.missed) for walk in run.walks)


@pytest.mark.parametrize(("seed", "limits"), FEW.items())
@pytest.mark.full
def test_no_event_is_stepped_over(seed, limits):
    events, missed = lost(random_orbit(seed), limits)
    assert events > 0
    assert missed == 0


@pytest.mark.full
def test_pairs_of_folds_and_doublings_inside_a_step():
    """Two folds, four period doublings and three stable windows lay between two points."""
    waves = [(1, 1, 0), (11, -0.091, 0), (19, -0.428, 0), (36, -0.401, 0), (37, 0.486, 0)]
    model = harmonic_pair(waves, beta=0.972, r=0.387, A=5.0, s=0.34)
    orbits = find_orbits(model, "1:1", kernels=Kernels(model, "s"))
    tests = [make_tests(o.problem, ("FB", "PD", "G"), {}) for o in orbits]
    for settings in (Settings(), Settings(max_step=0.01)):
        runs = [
            walk_both_ways(o.problem, o.unknowns, RANGE, t, settings)
            for o, t in zip(orbits, tests, strict=True)
        ]
        assert sum(len(run.events) for run in runs) == 23


@pytest.mark.full
def test_a_touch_where_the_flight_passes_elsewhere_is_no_grazing():
    """At 0.371883 a flight touches a wall that it passes 0.02 later; at 0.371886 nowhere."""
    orbit = random_orbit(1129)
    problem = orbit.problem
    test = Grazing(problem)
    run = walk_both_ways(problem, orbit.unknowns, RANGE, [test], PLAIN)
    (event,) = [e for e in run.events if abs(e.parameter - 0.3718857) < 1e-6]
    system = TouchingFlight(problem, 0, "B", event.details["touch_time"] - 0.018)
    beside = located(system, event.point)
    assert beside.unknowns[-1] == pytest.approx(0.3718825, abs=1e-6)
    assert not test.nearest(problem, beside, event.details["index"])
    assert test.nearest(problem, test.locate(problem, event.point, event.details["index"]), 0)


@pytest.mark.slow
def test_no_event_is_stepped_over_under_two_hundred_forcings():
    counts = []
    seed = 1000
    while len(counts) < 200:
        orbit = random_orbit(seed)
        counts += [] if orbit is None else [lost(orbit)]
        seed += 1
    events, missed = (sum(column) for column in zip(*counts, strict=True))
    assert events > 2000
    assert missed < 0.005 * events
