"""Points of a walk kept as columns: a sequence like any other, and what they cost."""

from __future__ import annotations

import tracemalloc
from dataclasses import dataclass

import numpy as np
import pytest

from contimpact.continuation.branch import (
    Block,
    End,
    EndKind,
    Event,
    Point,
    Points,
    Walk,
    join_walks,
)
from contimpact.diagrams.orbit_branch import continue_orbit


@dataclass(frozen=True)
class Here:
    """An evaluation: a point on a line, and what is told of it."""

    unknowns: np.ndarray
    numbers: np.ndarray


def block_of(first, last):
    place = np.arange(first, last, dtype=float)
    return Block(
        np.column_stack([place, place]),
        np.full((len(place), 2), 0.5),
        np.ones(len(place)),
        place,
        np.full(len(place), 3),
        place[:, None],
        Here,
    )


def point_at(place):
    here = Here(np.array([place, place], dtype=float), np.array([float(place)]))
    return Point(here, np.full(2, 0.5), 1.0, float(place), 3)


def mixed():
    """0 to 12: single points, a block put down row by row, one at once, another point."""
    points = Points([point_at(0), point_at(1)])
    block = block_of(2, 7)
    for i in range(4):
        points.extend(block, i, i + 1)
    points.extend(block, 4, 4)
    points.extend(block, 4, 5)
    points.extend(block_of(7, 12), 0, 5)
    points.append(point_at(12))
    return points


def places(points):
    return [point.arclength for point in points]


def test_points_read_like_a_list():
    points, listed = mixed(), list(range(13))
    assert places(points) == listed
    assert [points[i].arclength for i in range(-13, 13)] == listed + listed
    assert points.unknowns.tolist() == [[i, i] for i in listed]
    assert points.numbers.tolist() == [[i] for i in listed]
    assert points.arclengths.tolist() == listed
    assert points.iterations.tolist() == [3] * 13
    for out in (-14, 13):
        with pytest.raises(IndexError):
            points[out]


@pytest.mark.parametrize("step", [None, 1, -1, 2, -3])
def test_slices_are_those_of_a_list(step):
    points, listed = mixed(), list(range(13))
    bounds = [None, -15, -4, -1, 0, 1, 3, 7, 12, 13, 20]
    for first in bounds:
        for last in bounds:
            cut = slice(first, last, step)
            assert places(points[cut]) == listed[cut]
            assert points[cut].arclengths.tolist() == listed[cut]


def test_the_last_point_may_be_replaced_inside_a_block():
    points = mixed()[:5]
    points.end_with(point_at(40))
    points.append(point_at(41))
    assert places(points) == [0, 1, 2, 3, 40, 41]


def test_moved_points_are_turned_twice_or_not_at_all():
    points = mixed()
    there = points.moved(-1.0, 12.0)
    assert places(there) == list(range(12, -1, -1))
    for point in there:
        assert point.orientation == -1.0
        assert point.tangent.tolist() == [-0.5, -0.5]
    back = there.moved(-1.0, 12.0)
    assert places(back) == list(range(13))
    assert [p.tangent.tolist() for p in back] == [[0.5, 0.5]] * 13


def test_two_walks_are_joined_in_order():
    end = End(EndKind.RANGE, 0.0, "")
    points, events = join_walks(Walk(mixed(), (), end), Walk(mixed(), (), end))
    assert places(points) == list(range(25))
    assert points.unknowns[:, 0].tolist() == [*range(12, -1, -1), *range(1, 13)]
    assert events == []


@pytest.mark.parametrize("apart", [0.0, 4e-16, -4e-16])
def test_events_of_one_place_have_one_arclength(apart):
    """Rounding does not say whether both touches of a symmetric orbit have one row or two."""
    places = enumerate([3.5, 3.5 + apart])
    pair = [Event("G", point_at(at), 0.0, 1e-15, "newton", {"index": i}) for i, at in places]
    end = End(EndKind.RANGE, 0.0, "")
    _, found = join_walks(Walk([point_at(0)], (), end), Walk(mixed(), pair, end))
    assert [event.details["index"] for event in found] == [0, 1]
    assert found[0].point.arclength == found[1].point.arclength


@pytest.mark.parametrize(("index", "number"), [(0, 1), (1, 2)])
def test_an_event_that_two_walks_find_at_their_start_is_one(index, number):
    """Where the branch turns on a limit of the range, both walks lead inside."""
    end = End(EndKind.RANGE, 0.0, "")
    walks = [
        Walk(mixed(), [Event("FB", point_at(0), 0.0, 1e-15, "newton", {"index": i})], end)
        for i in (0, index)
    ]
    _, found = join_walks(*walks)
    assert [event.kind for event in found] == ["FB"] * number


@pytest.mark.full
def test_a_watched_walk_keeps_no_objects(pair, kernel_cache):
    """Bytes for each point of a branch: its numbers, not the objects made of them."""
    from contimpact.continuation.settings import Settings
    from contimpact.orbits.search import find_orbits

    orbit = next(o for o in find_orbits(pair(), "1:1", parameter="s") if o.physical)
    fine = Settings(step=5e-4, max_step=5e-4, min_step=1e-7, max_points=4000)

    def follow(limits):
        return continue_orbit(
            orbit, range=limits, events=["PD"], settings=fine, callback=lambda point: None
        )

    follow((0.38, 0.4))
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    branch = follow((0.3, 0.45))
    after, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(branch) > 1000
    # measured for each point: 240 kept of 27 columns, 590 at the most
    assert (after - before) / len(branch) < 400
    assert (peak - before) / len(branch) < 900
