"""Routine steps, many at a time, against the same walk step by step on dense linear algebra."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contimpact.bifurcations.kinds import test_functions as functions_of
from contimpact.continuation.settings import Settings
from contimpact.continuation.walk import walk
from contimpact.following.orbit_backend import backend_of, walk_orbits
from contimpact.orbits.search import find_orbits

EVENTS = ("FB", "BP", "PD", "NS", "G", "V", "T")


def both(orbit, direction, limits, settings, requested=None):
    """The walk by routine steps, and step by step."""
    problem = orbit.problem
    kinds = (*EVENTS, "UZ") if requested else EVENTS

    def tests():
        return functions_of(problem, kinds, requested or {})

    marched = walk_orbits(
        problem, orbit.unknowns, direction, limits=limits, tests=tests(), settings=settings
    )
    stepped = walk(
        problem, orbit.unknowns, direction, parameter=problem.parameter, limits=limits,
        tests=tests(), settings=settings,
    )  # fmt: skip
    return marched, stepped


def compare(marched, stepped):
    assert marched.end == stepped.end
    assert len(marched.points) == len(stepped.points)
    for one, other in zip(marched.points, stepped.points, strict=True):
        assert np.max(np.abs(one.unknowns - other.unknowns)) < 1e-9
        assert np.max(np.abs(one.tangent - other.tangent)) < 1e-7
        assert one.orientation == pytest.approx(other.orientation, rel=1e-6, abs=1e-12)
        assert one.evaluation.verdict.reason == other.evaluation.verdict.reason
        mine, theirs = one.evaluation.multipliers, other.evaluation.multipliers
        assert mine == pytest.approx(theirs, rel=1e-6, abs=1e-12)
    kinds = [event.kind for event in stepped.events]
    assert [event.kind for event in marched.events] == kinds
    for one, other in zip(marched.events, stepped.events, strict=True):
        assert one.parameter == pytest.approx(other.parameter, rel=1e-11)


@pytest.mark.parametrize("predictor", ["tangent", "secant"])
@pytest.mark.parametrize("word", ["BT", "BBT", "BTBT", "B", "BBTT"])
def test_walks_of_the_pair(pair, word, predictor):
    """Fixed steps: rounding does not change how long the next one is."""
    settings = Settings(step=0.01, max_step=0.01, max_angle=1.0, predictor=predictor)
    for orbit in find_orbits(pair(s=0.34), word, parameter="s"):
        for direction in (1, -1):
            compare(*both(orbit, direction, (0.2, 0.6), settings))


def test_walks_where_the_period_changes(oscillator):
    """The arrival of the last flight moves with the forcing period."""
    settings = Settings(step=0.005, max_step=0.005, max_angle=1.0)
    for orbit in find_orbits(oscillator(), "S", parameter="omega"):
        value = orbit.unknowns[-1]
        compare(*both(orbit, 1, (0.9 * value, 1.1 * value), settings))


def test_requested_values_are_among_the_test_functions(pair):
    (orbit, *_) = find_orbits(pair(s=0.5), "BT", parameter="s")
    settings = Settings(step=0.01, max_step=0.01)
    requested = {"s": [0.45, 0.4], "d": [0.29]}
    marched, stepped = both(orbit, -1, (0.3, 0.6), settings, requested)
    compare(marched, stepped)
    hit = [event.details["requested"] for event in marched.events if event.kind == "UZ"]
    assert hit == [{"d": 0.29}, {"s": 0.45}, {"s": 0.4}]


def test_what_has_no_routine_steps_is_walked_step_by_step(pair):
    from contimpact.continuation.test_function import UserFunction

    (orbit, *_) = find_orbits(pair(s=0.5), "BT", parameter="s")
    own = UserFunction("own", lambda point: point.parameter - 0.4)
    assert backend_of(orbit.problem, [own]) is None
    walked = walk_orbits(orbit.problem, orbit.unknowns, -1, limits=(0.3, 0.6), tests=[own])
    assert [event.parameter for event in walked.events] == pytest.approx([0.4], abs=1e-12)


def test_routine_steps_cost_as_many_flights_as_they_say(pair):
    """Two evaluations a point where one iteration suffices, and none for its description."""
    (orbit, *_) = find_orbits(pair(s=0.7), "BT", parameter="s")
    settings = Settings(step=0.001, max_step=0.001, max_points=500)
    before = orbit.problem.kernel_evaluations
    found = walk_orbits(orbit.problem, orbit.unknowns, -1, limits=(0.1, 0.72), settings=settings)
    [point.evaluation.multipliers for point in found.points]
    [point.evaluation.verdict for point in found.points]
    spent = orbit.problem.kernel_evaluations - before
    assert found.corrector_iterations <= 1.01 * len(found.points)
    assert spent <= 2.05 * 2 * len(found.points)
    assert math.isfinite(found.points[-1].parameter)
