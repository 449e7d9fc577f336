"""Between any two events a branch has a point that tells what lies there."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from algebraic import follow
from test_closed_branches import Hit
from test_walk import circle

from contimpact.continuation.events import separate_events, snap_to_points


def between(values):
    """The points and events of a circle with some values to hit."""
    problem = circle()
    found = follow(problem, [1.0, 0.0], tests=[Hit(value) for value in values])
    events = snap_to_points(found.points, found.events)
    return found, events, separate_events(problem, found.points, events)


def test_a_point_lies_between_any_two_adjacent_events():
    found, events, points = between([0.5, 0.5001, 0.50015, 0.50015 + 1e-8])
    assert len(events) == 8
    assert len(points) > len(found.points)
    lengths = points.arclengths
    assert np.all(np.diff(lengths) > 0.0)
    places = [event.point.arclength for event in events]
    for left, right in pairwise(places):
        assert np.any((lengths > left) & (lengths < right))
    x, p = points.unknowns.T
    assert np.hypot(x, p) == pytest.approx(np.ones(len(points)), abs=1e-12)


def test_where_points_lie_between_no_more_are_solved():
    found, _, points = between([0.2, 0.5])
    assert len(points) == len(found.points)


def test_events_that_their_errors_do_not_tell_apart_are_one_place():
    found, _, points = between([0.5, 0.5 + 1e-16])
    assert len(points) == len(found.points)


def test_an_event_on_a_point_is_at_its_place():
    found, events, points = between([0.0])
    ends = {0.0, found.points[-1].arclength}
    assert len(ends & {event.point.arclength for event in events}) == 1
    assert len(points) == len(found.points)
