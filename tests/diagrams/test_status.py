"""Changes of physicality and stability: every one has its event, or is said to have none."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from scipy.optimize import brentq

from contimpact.bifurcations.declarations import EVENTS
from contimpact.bifurcations.kind import places_with_status
from contimpact.bifurcations.kind import test_functions as make_tests
from contimpact.continuation.branch import Points, TestFunction
from contimpact.continuation.settings import Settings
from contimpact.diagrams.orbit_walks import walk_both_ways
from contimpact.orbits.search import find_orbits
from contimpact.orbits.status import count_unstable
from contimpact.systems.impact_pair import ImpactPair


def walked(model, limits, kinds=EVENTS, word="1:1", settings=None):
    orbits = find_orbits(model, word, parameter="s")
    return [
        walk_both_ways(
            o.problem, o.unknowns, limits, make_tests(o.problem, kinds, {}), settings or Settings()
        )
        for o in orbits
    ]


def test_the_grazing_without_rebound_against_its_closed_form():
    """At r = 0 the ball leaves B as the acceleration vanishes and T at rest, each from its wall.

    With u the displacement and v the velocity from rest at t, after dt: gbar dt^2/2 + [cos(pi t) -
    cos(pi (t + dt)) - pi dt sin(pi t)]/pi^2, both flights pass the same distance d.
    """
    model = ImpactPair(beta=math.pi / 6, r=0.0, A=5.0, s=0.45)
    p = model.values
    gravity = p["M"] * p["g"] * math.sin(p["beta"]) / p["A"]

    def moved(t, dt):
        waves = math.cos(math.pi * t) - math.cos(math.pi * (t + dt))
        return gravity * dt**2 / 2 + (waves - math.pi * dt * math.sin(math.pi * t)) / math.pi**2

    first = math.acos(-gravity) / math.pi
    second = brentq(
        lambda t: moved(first, t - first) + moved(t, first + 2.0 - t), 1.5, 1.8, xtol=1e-15
    )
    s = -moved(first, second - first) * p["A"] * math.pi**2 / (p["M"] * p["omega"] ** 2)
    for run in walked(model, (0.1, 1.0)):
        (grazing,) = [e for e in run.events if e.kind == "G"]
        assert abs(grazing.parameter - s) <= grazing.error + 1e-15
        assert grazing.error < 1e-7


@pytest.mark.parametrize("r", [0.0, 1e-16, 1e-12, 1e-10, 1e-8, 1e-6])
@pytest.mark.full
def test_the_grazing_of_a_ball_that_hardly_rebounds(r):
    """The touch lies within sqrt(r) of the impact before it; its gap ends just beyond its zero.

    At r = 0 the ball leaves when the acceleration does: mean + cos(pi t) = 0 at the impact.
    """
    model = ImpactPair(beta=math.pi / 6, r=r, A=5.0, s=0.45)
    for run in walked(model, (0.1, 1.0)):
        (grazing,) = [e for e in run.events if e.kind == "G"]
        assert not any(walk.missed for walk in run.walks) or run.branch("b1", 1).missed == []
        first = grazing.point.unknowns[0]
        p = model.values
        gravity = p["M"] * p["g"] * math.sin(p["beta"]) / p["A"]
        assert abs(gravity + math.cos(math.pi * first)) < 4.0 * math.sqrt(r) + 1e-5


class Blind(TestFunction):
    """A grazing that nothing ever finds."""

    kind = "G"

    def values(self, point):
        return np.ones(1)


def test_a_change_that_no_event_explains_is_said():
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.3)
    orbit = next(o for o in find_orbits(model, "2:1", parameter="s") if o.physical)
    tests = [*make_tests(orbit.problem, ("FB", "PD", "V", "T"), {}), Blind()]
    run = walk_both_ways(orbit.problem, orbit.unknowns, (0.2, 0.35), tests, Settings())
    missed = [m for walk in run.walks for m in walk.missed]
    assert missed
    for miss in missed:
        assert miss.kind == "G"
        assert "turns unphysical there" in miss.reason
        low, high = sorted(miss.parameters)
        assert high - low < 1e-9
    asked = [min(abs(0.27903478127844920 - p) for p in m.parameters) for m in missed]
    assert min(asked) < 1e-9  # the grazing 2:1 -> 3:1 of Fig. 7


@pytest.mark.full
def test_what_was_not_asked_for_is_not_missed():
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    for kinds in ((), ("FB",), ("PD", "FB")):
        for run in walked(model, (0.1, 1.0), kinds):
            assert not any(walk.missed for walk in run.walks)


@pytest.mark.parametrize("step", [0.1, 0.05, 0.02])
def test_beside_a_zero_velocity_the_verdict_is_not_rounding(step):
    """At the V itself an impact's velocity is zero within 1e-17, of either sign."""
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    runs = walked(model, (0.1, 1.0), ("V",), settings=Settings(max_step=step))
    assert all(run.events for run in runs)
    for run in runs:
        for event in run.events:
            here = event.point.evaluation
            others = [
                v * side
                for i, (v, side) in enumerate(zip(here.unknowns[1:-1:2], (1.0, -1.0), strict=True))
                if i != event.details["impact"]
            ]
            passes = here.verdict.reason is not None and "passes" in here.verdict.reason
            assert here.verdict.physical == (min(others) >= 0.0 and not passes)


@pytest.mark.parametrize("kind", ["G", "PD", "V"])
@pytest.mark.parametrize("nudge", [-3e-16, 0.0, 3e-16])
@pytest.mark.full
def test_an_event_on_a_limit_is_found_at_both_ends(kind, nudge):
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    values = {
        e.parameter for run in walked(model, (0.1, 1.0)) for e in run.events if e.kind == kind
    }
    value = min(values)
    for limits, start in (
        ((value * (1.0 + nudge), 1.0), value + 0.02),
        ((0.1, value * (1.0 + nudge)), value - 0.02),
    ):
        runs = walked(model.replace(s=start), limits, (kind,))
        assert any(abs(e.parameter - value) < 1e-13 for run in runs for e in run.events)


def test_an_event_beyond_a_limit_is_not_found():
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    for beyond, count in ((1e-12, 0), (-1e-12, 1)):
        runs = walked(model, (0.3284416489727 + beyond, 0.36), ("G",))
        assert sum(len(run.events) for run in runs) == count


@pytest.mark.full
def test_statuses_change_at_events_alone():
    """Along every branch of a few random pairs: between neighbouring points without an event."""
    rng = np.random.default_rng(5)
    for _ in range(4):
        model = ImpactPair(
            beta=float(rng.uniform(0, 1.5)),
            r=float(rng.choice([0.0, 1.0, rng.uniform()])),
            A=float(rng.uniform(3, 12)),
            s=float(rng.uniform(0.2, 0.8)),
        )
        for run in walked(model, (0.1, 1.2)):
            numbers = run.points.numbers
            status = np.column_stack(
                [numbers[:, -6] != 0, count_unstable(numbers[:, 1:-6].copy().view(complex))]
            )
            lengths = np.array(run.points.arclengths)
            for i in np.nonzero(np.any(status[1:] != status[:-1], axis=1))[0]:
                inside = [
                    e
                    for e in run.events
                    if lengths[i] - 1e-9 <= e.point.arclength <= lengths[i + 1] + 1e-9
                ]
                assert inside or any(walk.missed for walk in run.walks)


def test_next_to_a_branch_point_a_status_tells_nothing():
    """A point within the root of the tolerance may lie off both branches that cross there."""
    model = ImpactPair(beta=0.0, r=0.3, A=5.0, s=0.34)
    walks = [walk for run in walked(model, (0.1, 1.0)) for walk in run.walks]
    walk = next(w for w in walks if any(e.kind == "BP" for e in w.events))
    places = np.array([point.arclength for point in walk.points])
    crossing = next(e for e in walk.events if e.kind == "BP").point.arclength
    after = int(np.searchsorted(places, crossing))
    for beside, told in ((1e-6, False), (1e-3, True)):
        points = list(walk.points)
        points[after] = dataclasses.replace(points[after], arclength=crossing + beside)
        left = places_with_status(dataclasses.replace(walk, points=Points(points)), Settings())
        assert (after in left) == told
        assert set(range(len(points))) - {after} <= set(left.tolist())
