"""The test of the tests: branches are checked where they are followed, and broken ones refused."""

from __future__ import annotations

import dataclasses

import invariants
import pytest
from zoo import scene

from contimpact.continuation.settings import Settings
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.diagrams.orbit_walks import walk_orbits
from contimpact.orbits.search import find_orbits

LIMITS = (0.3, 0.4)


@pytest.fixture(scope="module")
def orbit(kernel_cache):
    return find_orbits(scene().model, "1:1", parameter="s")[0]


def test_branches_are_watched(orbit):
    before = invariants.watched.copy()
    continue_orbit(orbit, range=LIMITS)
    assert invariants.watched - before == {"walks": 2, "branches": 1}


@pytest.mark.corrupting
def test_those_of_a_corrupting_test_are_not(orbit):
    before = invariants.watched.copy()
    continue_orbit(orbit, range=LIMITS)
    assert invariants.watched == before


def test_broken_tables_are_refused(orbit):
    branch = continue_orbit(orbit, range=LIMITS)
    event = branch.events[0]
    for broken in (
        dataclasses.replace(branch, columns={**branch.columns, "t1": branch["t1"][1:]}),
        dataclasses.replace(branch, columns={**branch.columns, "r": 1.01 * branch["r"]}),
        dataclasses.replace(branch, events=[dataclasses.replace(event, ghost=not event.ghost)]),
        dataclasses.replace(branch, events=[]),
    ):
        with pytest.raises(AssertionError):
            invariants.check_branch(broken)


def test_broken_walks_are_refused(orbit):
    from contimpact.bifurcations.kind import test_functions as make_tests

    tests = make_tests(orbit.problem, ["PD", "G"], {})
    walk = walk_orbits(orbit.problem, orbit.unknowns, 1, limits=LIMITS, tests=tests)
    (doubling,) = (event for event in walk.events if event.kind == "PD")
    away = dataclasses.replace(doubling.point, arclength=2.0 * doubling.point.arclength)
    for broken in (
        dataclasses.replace(walk, events=[]),
        dataclasses.replace(walk, points=walk.points[::-1]),
        dataclasses.replace(walk, events=[dataclasses.replace(doubling, point=away)]),
        dataclasses.replace(walk, events=[dataclasses.replace(doubling, residual=1e-6)]),
    ):
        with pytest.raises(AssertionError):
            invariants.check_walk(orbit.problem, broken, ["PD", "G"], Settings(), False)
