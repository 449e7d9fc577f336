"""Steps on block-cyclic elimination against the same walk on dense linear algebra."""

from __future__ import annotations

import importlib.util
import math

import numpy as np
import pytest

from contimpact.bifurcations.kind import test_functions as functions_of
from contimpact.continuation import corrector
from contimpact.continuation.branch import UserFunction
from contimpact.continuation.settings import Settings
from contimpact.continuation.step import Position
from contimpact.continuation.walk import walk
from contimpact.diagrams.orbit_walks import backend_of, walk_orbits
from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import find_orbits

needs_llvmlite = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="the extra 'fast' is not installed"
)
EVENTS = ("FB", "BP", "PD", "NS", "G", "V", "T")


def both(orbit, direction, limits, settings, requested=None):
    """The walk on both backends."""
    problem = orbit.problem
    kinds = (*EVENTS, "UZ") if requested else EVENTS

    def tests():
        return functions_of(problem, kinds, requested or {})

    cyclic = walk_orbits(
        problem, orbit.unknowns, direction, limits=limits, tests=tests(), settings=settings
    )
    dense = walk(
        problem,
        orbit.unknowns,
        direction,
        parameter=problem.parameter,
        limits=limits,
        tests=tests(),
        settings=settings,
    )
    return cyclic, dense


def compare(cyclic, dense):
    assert cyclic.end == dense.end
    assert len(cyclic.points) == len(dense.points)
    for one, other in zip(cyclic.points, dense.points, strict=True):
        assert np.max(np.abs(one.unknowns - other.unknowns)) < 1e-9
        assert np.max(np.abs(one.tangent - other.tangent)) < 1e-7
        assert one.orientation == pytest.approx(other.orientation, rel=1e-6, abs=1e-12)
        assert one.evaluation.verdict.reason == other.evaluation.verdict.reason
        mine, theirs = one.evaluation.multipliers, other.evaluation.multipliers
        assert mine == pytest.approx(theirs, rel=1e-6, abs=1e-12)
    kinds = [event.kind for event in dense.events]
    assert [event.kind for event in cyclic.events] == kinds
    for one, other in zip(cyclic.events, dense.events, strict=True):
        assert one.parameter == pytest.approx(other.parameter, rel=1e-11)


@pytest.mark.parametrize("predictor", ["tangent", "secant"])
@pytest.mark.parametrize("word", ["BT", "BBT", "BTBT", "B", "BBTT"])
@pytest.mark.full
def test_walks_of_the_pair(pair, word, predictor):
    """Fixed steps: rounding does not change how long the next one is."""
    settings = Settings(step=0.01, max_step=0.01, max_angle=1.0, predictor=predictor)
    for orbit in find_orbits(pair(s=0.34), word, parameter="s"):
        for direction in (1, -1):
            compare(*both(orbit, direction, (0.2, 0.6), settings))


@pytest.mark.full
def test_walks_where_the_period_changes(oscillator):
    """The arrival of the last flight moves with the forcing period."""
    settings = Settings(step=0.005, max_step=0.005, max_angle=1.0)
    for orbit in find_orbits(oscillator(), "S", parameter="omega"):
        value = orbit.unknowns[-1]
        compare(*both(orbit, 1, (0.9 * value, 1.1 * value), settings))


@pytest.mark.full
def test_requested_values_are_among_the_test_functions(pair):
    (orbit, *_) = find_orbits(pair(s=0.5), "BT", parameter="s")
    settings = Settings(step=0.01, max_step=0.01)
    requested = {"s": [0.45, 0.4], "d": [0.29]}
    cyclic, dense = both(orbit, -1, (0.3, 0.6), settings, requested)
    compare(cyclic, dense)
    hit = [event.details["requested"] for event in cyclic.events if event.kind == "UZ"]
    assert hit == [{"d": 0.29}, {"s": 0.45}, {"s": 0.4}]


def test_a_function_of_ones_own_is_evaluated_on_the_points_of_a_batch(pair):
    """The walk is that without it, to the last bit, and its zeros are located like others."""
    (orbit, *_) = find_orbits(pair(s=0.5), "BT", parameter="s")
    own = UserFunction("own", lambda point: point.parameter - 0.4)
    settings = Settings(step=0.002, max_step=0.002)

    def go(tests):
        before = orbit.problem.kernel_evaluations
        found = walk_orbits(
            orbit.problem, orbit.unknowns, -1, limits=(0.3, 0.6), tests=tests, settings=settings
        )
        return found, orbit.problem.kernel_evaluations - before

    (plain, spent), (walked, more) = go([]), go([own])
    assert [event.parameter for event in walked.events] == pytest.approx([0.4], abs=1e-12)
    assert np.array_equal(walked.points.unknowns, plain.points.unknowns)
    assert own.evaluations >= len(walked.points)
    assert more - spent < 100  # to locate the event


@pytest.mark.parametrize("word", ["BT", "BBT", "B"])
def test_test_functions_of_a_batch_are_those_of_its_points(pair, word):
    """One text for both; the rounding of a row's norm may differ."""
    (orbit, *_) = find_orbits(pair(s=0.34), word, parameter="s")
    tests = functions_of(orbit.problem, (*EVENTS, "UZ"), {"s": [0.4], "d": [0.2]})
    found = walk_orbits(orbit.problem, orbit.unknowns, 1, limits=(0.2, 0.5), tests=tests)
    backend = backend_of(orbit.problem, tests)
    position = Position(
        found.points[1],
        found.points[:1],
        orbit.unknowns[-1],
        2,
        0.01,
        orbit.problem.scale(orbit.unknowns, 0.3),
        (0.2, 0.5),
        1e-7,
        Settings(),
        True,
        False,
    )
    block = backend.advance(position, 5).piece
    assert len(block) > 1
    for test in tests:
        many = test.on(block)
        for i in range(len(block)):
            one = test.on(block.point(i))
            assert many[i] == pytest.approx(one[0], rel=1e-13, abs=1e-15, nan_ok=True)


def test_steps_cost_as_many_flights_as_they_say(pair):
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


def test_the_first_tangent_of_a_long_word_takes_no_dense_matrix(pair, monkeypatch):
    """It is the null vector of a matrix that is not made."""
    (orbit, *_) = find_orbits(pair(s=0.7), "BT", parameter="s")
    laps = 20
    problem = OrbitProblem(orbit.problem.model, Word("BT" * laps, laps), orbit.problem.kernels)
    t0, v0, t1, v1, s = orbit.unknowns
    rows = [(t + 2.0 * k, v) for k in range(laps) for t, v in ((t0, v0), (t1, v1))]
    start = np.append(np.ravel(rows), s)
    scale = problem.scale(start, 0.1)
    expected = corrector.first_tangent(problem, problem.evaluate(start).jacobian, scale)
    monkeypatch.setattr(corrector, "first_tangent", None)
    settings = Settings(max_points=2)
    for direction in (1, -1):
        found = walk_orbits(problem, start, direction, limits=(0.65, 0.75), settings=settings)
        tangent = found.points[0].tangent
        assert np.sign(tangent[-1]) == direction
        assert tangent == pytest.approx(np.sign(expected[-1]) * direction * expected, abs=1e-11)


@needs_llvmlite
@pytest.mark.full
def test_sign_changes_are_looked_for_alike_plainly_and_compiled(plain_and_compiled, pair):
    """Also of values that do not exist, are infinite or zero, and of points at one place."""
    orbit = find_orbits(pair(s=0.34), "BT", parameter="s")[0]
    backend, random = backend_of(orbit.problem, ()), np.random.default_rng(7)
    given = []
    for trial in range(300):
        values = random.normal(size=(9, 6)).cumsum(axis=0) + random.normal(0.0, 2.0, 6)
        values[random.uniform(size=values.shape) < 0.1] = (0.0, np.nan, np.inf)[trial % 3]
        places = np.cumsum(random.uniform(0.1, 1.0, 9))
        places[:2] = np.nan if trial % 2 else places[1]
        given.append((values, places))
    plain, fast = plain_and_compiled(lambda: [backend.look(*one) for one in given])
    assert sum(len(rows) for rows, _, _ in plain) > 300
    for one, other in zip(plain, fast, strict=True):
        assert all(map(np.array_equal, one, other))
