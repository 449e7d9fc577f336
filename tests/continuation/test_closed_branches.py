"""Closed branches are gone round once, wherever they begin; events at their start count once."""

from __future__ import annotations

import math

import numpy as np
import pytest
from algebraic import Algebraic, follow
from test_walk import Turning, circle, kinds, lemniscate
from zoo import ROOT

from contimpact.continuation.branch import EndKind, TestFunction, Walk, join_walks
from contimpact.continuation.settings import Settings
from contimpact.continuation.walk import both_ways, closed_test_values
from contimpact.results.catalogue import load_diagram
from contimpact.results.diagram_reading import stable_intervals


class Hit(TestFunction):
    """The parameter takes a value."""

    kind = "UZ"

    def __init__(self, value):
        self.value = value

    def values(self, point):
        return point.unknowns[-1:] - self.value


def once(found: Walk, way: float):
    """Assert that a walk went round once; chords fall short of the way."""
    assert found.end.kind is EndKind.CLOSED
    assert found.points[-1].arclength == pytest.approx(way, rel=2e-3)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("turn", np.linspace(-0.12, 0.12, 13).tolist())
@pytest.mark.quick(14)
def test_a_loop_that_begins_beside_a_fold_is_gone_round_once(turn, direction):
    """A step over the fold may end where the parameter is as it was before it."""
    start = [math.sin(turn), math.cos(turn)]
    found = follow(circle(), start, direction, tests=[Turning()])
    once(found, 2.0 * math.pi)
    assert len(found.events) == 2


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("turn", np.linspace(-1.5, 4.7, 32).tolist())
@pytest.mark.quick(16)
def test_a_requested_value_at_the_start_is_found_once(turn, direction):
    """The circle has each value twice, once where it begins."""
    value = math.sin(turn)
    found = follow(circle(), [math.cos(turn), value], direction, tests=[Hit(value)])
    once(found, 2.0 * math.pi)
    assert kinds(found) == ["UZ", "UZ"]
    assert [event.parameter for event in found.events] == pytest.approx([value] * 2, abs=1e-12)


def pitchfork():
    """A line, and a circle that folds where it crosses it."""
    return Algebraic(
        lambda x, p: x * (x * x + p * p - 1.0),
        lambda x, p: [3.0 * x * x + p * p - 1.0, 2.0 * x * p],
    )


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("place", [1.0, -1.0])
def test_a_loop_that_begins_at_a_branch_point_is_gone_round_once(place, direction):
    """Where branches cross, Newton's method does not lead back to the start."""
    along = np.array([1.0, 0.0])
    found = follow(
        pitchfork(), [0.0, place], direction, tests=[Turning()], tangent=along, branching=True
    )
    once(found, 2.0 * math.pi)
    assert found.points[-1].unknowns == pytest.approx([0.0, place], abs=1e-12)
    assert sum(abs(e.parameter + place) < 1e-9 for e in found.events) == 1


@pytest.mark.parametrize("way", [(1.0, 1.0), (1.0, -1.0)])
def test_a_figure_of_eight_that_begins_at_its_crossing_is_gone_round_once(way):
    found = follow(
        lemniscate(),
        [0.0, 0.0],
        tests=[Turning()],
        tangent=np.array(way) / math.sqrt(2.0),
        branching=True,
    )
    once(found, 5.2441151)
    assert len(found.events) == 4


@pytest.mark.parametrize("most", range(31, 69))
@pytest.mark.parametrize("begin", ["beside a fold", "branch point"])
def test_a_loop_longer_than_the_walk_is_gone_round_once(begin, most):
    """The walk in the other direction ends where the first one did."""
    problem, start, options = circle(), [math.sin(0.1), math.cos(0.1)], {}
    if begin == "branch point":
        problem, start = pitchfork(), [0.0, -1.0]
        options = {"tangent": np.array([1.0, 0.0]), "branching": True}

    def go(direction, goal=None):
        options.update(goal=goal, settings=Settings(max_points=most))
        return follow(problem, start, direction, tests=[Turning()], **options)

    backward, forward = both_ways(go(1), "p", lambda goal: go(-1, goal))
    points, events = join_walks(backward, forward)
    assert backward.end == forward.end or {backward.end.kind, forward.end.kind} == {EndKind.POINTS}
    closed = forward.end.kind is EndKind.CLOSED
    assert closed == (most >= 36)
    if closed:
        assert points[-1].arclength == pytest.approx(2.0 * math.pi, rel=2e-3)
        assert points[-1].unknowns == pytest.approx(points[0].unknowns, abs=1e-7)
        at_start = begin == "branch point"  # its event is that of the branch it comes from
        assert sorted(e.parameter for e in events) == pytest.approx([-1.0, 1.0][at_start:])


def test_values_at_the_end_of_a_loop_are_those_of_its_start():
    """In another order where the end is an image of the start; NaN stays."""
    start = [np.array([1e-17, 2.0]), np.array([-1e-17, 0.5, np.nan])]
    here = [np.array([-1e-16, 2.0 + 1e-9]), np.array([np.nan, 1e-16, 0.5])]
    found = closed_test_values(here, start)
    assert found[:2].tolist() == [1e-17, 2.0]
    assert np.isnan(found[2])
    assert found[3:].tolist() == [-1e-17, 0.5]


def test_stable_orbits_on_both_sides_of_the_first_point_are_one_run():
    """1:0 of two masses is a loop begun at omega = 1.8, where it is stable."""
    diagram = load_diagram(ROOT / "branches/two_masses")
    (run,) = (i for i in stable_intervals(diagram) if i.branch == "b1")
    assert run.bounds == ("e8", "e1")
    assert (run.low, run.high) == pytest.approx((1.742860601061951, 1.8639075573052062), abs=1e-9)
