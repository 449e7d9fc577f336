"""Events at which an impact comes to rest or a flight takes no time, and the limits of sliding."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
import pytest
from zoo import PRELOADED, ROOT, Preloaded

import contimpact
from contimpact.continuation.settings import Settings
from contimpact.models.guards import Word
from contimpact.orbits.orbit import Orbit
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import solve_near
from contimpact.results.branch import orbit_of
from contimpact.results.catalogue import load_entries
from contimpact.segments.kernels import Kernels
from contimpact.systems.belt import Belt

pytest.importorskip("flint", reason="needs contimpact[certify]")
from contimpact.certificates.event import certify_entry, verify_entry

VALUES = {"a": 0.6, "omega": 0.5, "c": 0.1, "V": 0.1, "mu_0": 0.5}
EVENTS = ["FB", "PD", "G", "V", "T"]


@functools.cache
def magnet_at_rest():
    """Where the magnet's contact, which lasts, ends at rest."""
    problem = OrbitProblem(Preloaded(**PRELOADED), Word("CR"), Kernels(Preloaded(**PRELOADED), "w"))
    found = solve_near(problem, np.array([-2.0197, 0.2418, 3.3507, -0.0013, 0.40464]))
    (event,) = contimpact.continue_orbit(
        Orbit(problem, found), "w", (0.403, 0.4146), events=["V"]
    ).events
    recorded = orbit_of(event, problem.model, problem.kernels).linearisation
    return event, lambda: recorded


@pytest.mark.full
def test_the_infinite_multiplier_of_a_contact_that_lasts_is_the_events_own():
    event, recorded = magnet_at_rest()
    assert (event.impact, event.flight, event.n_unstable) == (1, 0, 0)
    found = certify_entry(event, recorded)
    assert found.certified, found
    assert verify_entry(event, found, recorded).certified
    wrong = dataclasses.replace(event, n_unstable=1)
    assert certify_entry(wrong, recorded).clause == "stability"
    wrong = dataclasses.replace(event, physical=False)
    assert certify_entry(wrong, recorded).clause == "physicality"


def test_an_impact_at_rest_that_is_a_jump_does_not_vanish():
    """A bumper kicks what touches it: the orbit without that impact is none, and its multipliers
    were taken for those of the event. What runs away from it so fast that the kick stops it leaves
    without a rate, which was not proven."""
    table = {
        "name": "bumper",
        "model": {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"w": 1.7, "s": 0.4},
            "modes": {"free": {"x": "v", "v": "cos(w*t) - x - v/10"}},
            "guards": {"K": {"within": "x <= s", "set": {"v": "-0.6*v - 0.3"}}},
        },
        "follow": {"parameter": "s", "range": [-0.5, 1.2], "orbits": ["K/2T"]},
    }
    model = contimpact.read_scene(table).model
    orbits = contimpact.find_orbits(model, "K/2T", parameter="s", starts=16)
    branches = [contimpact.continue_orbit(o, range=(-0.5, 1.2), events=["V", "G"]) for o in orbits]
    events = [event for branch in branches for event in branch.events]
    assert {(event.kind, event.impact) for event in events} >= {("V", 0), ("G", 0)}
    for event in events:
        here = orbit_of(event, model).linearisation
        found = certify_entry(event, lambda here=here: here)
        assert found.certified, found
        wrong = dataclasses.replace(event, n_unstable=event.n_unstable + 1)
        assert certify_entry(wrong, lambda here=here: here).clause == "stability"


def test_rates_of_first_order_are_no_part_of_the_orbit_without_impacts():
    """What the rate is at the time zero changes no motion, so that the state that leads to the
    impact at rest was never the only one. The filter q decays by exp(-T/2)."""
    table = {
        "name": "filter",
        "model": {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"w": 1.7, "s": 0.4},
            "modes": {"free": {"q": "x - q/2", "x": "v", "v": "cos(w*t) - x - v/10"}},
            "guards": {"R": {"within": "x <= s", "set": {"v": "-0.7*v"}}},
        },
        "follow": {"parameter": "s", "range": [0.3, 0.9], "orbits": ["R"]},
    }
    model = contimpact.read_scene(table).model
    amplitude = 1.0 / np.hypot(1.0 - 1.7**2, 0.17)
    orbits = contimpact.find_orbits(model.replace(s=0.9 * amplitude), "R", parameter="s", starts=16)
    branches = [contimpact.continue_orbit(o, range=(0.3, 0.9), events=["V"]) for o in orbits]
    event = next(e for b in branches for e in b.events if abs(e.value - amplitude) < 1e-9)
    here = orbit_of(event, model).linearisation
    found = certify_entry(event, lambda: here)
    assert found.certified, found
    wrong = dataclasses.replace(event, n_unstable=event.n_unstable + 1)
    assert certify_entry(wrong, lambda: here).clause == "stability"


@pytest.mark.parametrize("kind", ["G", "V"])
@pytest.mark.full
def test_where_sliding_vanishes_multipliers_are_those_without_it(kind):
    """Of the belt: a touch of S, beside which C lies on the same surface, and the V of SP."""
    (entry,) = (e for e in load_entries(ROOT / "branches" / "belt") if e.kind == kind)
    found = certify_entry(entry)
    assert found.certified, found
    assert found.certified_radius < 1e-30
    for clause, values in {
        "stability": {"n_unstable": 1},
        "physicality": {"physical": False},
    }.items():
        assert certify_entry(dataclasses.replace(entry, **values)).clause == clause


def followed(word, at, limits):
    orbits = contimpact.find_orbits(Belt(**VALUES | {"a": at}), word, parameter="a", starts=20)
    orbit = next(orbit for orbit in orbits if orbit.physical)
    return contimpact.continue_orbit(orbit, "a", limits, events=EVENTS)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("word", "at", "limits", "sliding", "kinds"),
    [
        ("DSA", 1.74, (1.72, 1.764), "crossing-sliding", {"T"}),
        ("DSA", 1.74, (1.72, 1.764), "switching-sliding", {"T", "V"}),
        ("DC", 1.77, (1.7645, 1.78), "grazing-sliding", {"T", "V"}),
    ],
)
def test_flights_that_take_no_time_are_proven_to(word, at, limits, sliding, kinds):
    """On the branch born at a sliding bifurcation, from its other end."""
    (begun,) = (e for e in followed(word, at, limits).events if e.sliding == sliding)
    near = begun.value - 1e-3, begun.value + 1e-3
    born = contimpact.continue_born(begun, range=near, events=EVENTS)
    start = born.orbit(int(np.flatnonzero(born.physical & (born.columns["event"] == ""))[-1]))
    steps = Settings(step=7.3e-4)
    back = contimpact.continue_orbit(start, "a", near, events=EVENTS, settings=steps)
    events = [event for event in back.events if event.sliding == sliding]
    assert {event.kind for event in events} == kinds
    for event in events:
        assert certify_entry(event).certified, event
        assert certify_entry(dataclasses.replace(event, n_unstable=1)).clause == "stability"


@pytest.mark.slow
def test_where_sliding_begins_on_a_limit_no_branch_is_complete():
    """These grazings have no touch, and no equations that are certified."""
    branch = followed("DSA", 1.74, (1.72, 1.764))
    assert [e.kind for e in branch.events] == ["G", "G"]
    (found,) = contimpact.certify(branch).branches
    assert not found.complete
    assert len(found.unproven) == 2
    for piece, event, where in zip(
        found.unproven,
        branch.events,
        ("impact 1 comes to the limit P", "impact 2 comes to the limit A"),
        strict=True,
    ):
        assert where in piece.what
        assert min(piece.start, piece.end) < event.value < max(piece.start, piece.end)


def test_an_impact_at_rest_is_a_touch_of_the_orbit_run_once():
    """BBTBT of Fig. 7 grazes where BT does, which it is run twice; the period is a constant."""
    (entry,) = (e for e in load_entries(ROOT / "branches" / "fig7") if e.id == "e18")
    assert (entry.word, entry.kind) == ("BBTBT", "G")
    found = certify_entry(entry)
    assert found.certified, found
    assert found.certified_radius < 1e-30
