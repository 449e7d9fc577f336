"""Walks on algebraic curves: how they end, what they must not do, and what they cost."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from algebraic import Algebraic, follow

from contimpact.continuation import step
from contimpact.continuation.branch import (
    End,
    EndKind,
    Event,
    Refusal,
    RefusalDetails,
    TestFunction,
    UserFunction,
    join_walks,
)
from contimpact.continuation.settings import Settings
from contimpact.continuation.step import DenseBackend
from contimpact.continuation.walk import OUTGROWN, Policy, walk
from contimpact.errors import InputError

EPSILON = float(np.finfo(float).eps)


class Turning(TestFunction):
    """The parameter turns back."""

    kind = "FB"

    def values(self, point):
        return point.tangent[-1:]


class Crossing(TestFunction):
    """The orientation changes sign."""

    kind = "BP"

    def values(self, point):
        return np.array([point.orientation])


def kinds(found):
    return [event.kind for event in found.events]


def circle(x=0.0, p=0.0):
    return Algebraic(
        lambda u, v: (u - x) ** 2 + (v - p) ** 2 - 1.0, lambda u, v: [2.0 * (u - x), 2.0 * (v - p)]
    )


def ellipse():
    return Algebraic(lambda x, p: x * x / 9.0 + p * p - 1.0, lambda x, p: [2.0 * x / 9.0, 2.0 * p])


def lemniscate():
    return Algebraic(
        lambda x, p: (x * x + p * p) ** 2 - (x * x - p * p),
        lambda x, p: [4.0 * x * (x * x + p * p) - 2.0 * x, 4.0 * p * (x * x + p * p) + 2.0 * p],
    )


def line(slope=2.0):
    return Algebraic(lambda x, p: x - slope * p, lambda x, p: [1.0, -slope])


def parabola():
    return Algebraic(lambda x, p: x * x - p, lambda x, p: [2.0 * x, -1.0])


# Loops


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("turn", [0.0, 1e-9, 0.5, math.pi / 2, 2.0, 4.0, 3.0 * math.pi / 2])
def test_a_circle_closes_on_its_start(turn, direction):
    start = [math.cos(turn), math.sin(turn)]
    problem = circle()
    if abs(start[0]) < 1e-9:
        start[0] = 0.0  # on the fold the start must lie on the circle, as it does not move
    found = follow(problem, start, direction, tests=[Turning()])
    assert found.end.kind is EndKind.CLOSED
    assert found.end.message == "closed on itself: the branch is a loop"
    first, last = found.points[0], found.points[-1]
    assert np.max(np.abs(last.unknowns - first.unknowns)) < 1e-7
    # chords of 0.1 fall short of the arc by a part of 0.1^2/24
    assert last.arclength == pytest.approx(2.0 * math.pi, rel=5e-4)
    if abs(first.tangent[-1]) > 1e-6:
        assert sorted(round(event.parameter, 9) for event in found.events) == [-1.0, 1.0]
    assert first.tangent[-1] * direction >= 0.0
    # measured: 67 points, 195 iterations
    assert len(found.points) <= 70
    assert found.corrector_iterations <= 3.2 * len(found.points)
    assert found.rejected_steps == 0


def test_a_loop_is_run_through_once():
    """Its points go round by less than a whole turn before the last one."""
    found = follow(circle(), [1.0, 0.0])
    angles = np.unwrap([math.atan2(p, x) for x, p in (point.unknowns for point in found.points)])
    assert np.all(np.diff(angles) > 0.0)
    assert angles[-1] == pytest.approx(2.0 * math.pi, abs=1e-7)


@pytest.mark.parametrize("start", [[3.0, 0.0], [0.0, 1.0], [2.4, 0.6]])
def test_an_ellipse_closes(start):
    found = follow(ellipse(), start)
    assert found.end.kind is EndKind.CLOSED
    # 12 E(8/9) = 13.3648932; chords measured to fall short by 0.0012
    assert found.points[-1].arclength == pytest.approx(13.36489, abs=0.002)


@pytest.mark.parametrize("centre", [(50.0, 3.0), (-1e3, 0.5)])
def test_a_loop_far_from_the_origin_closes(centre):
    x, p = centre
    found = follow(circle(x, p), [x + 0.6, p + 0.8], limits=(p - 4.0, p + 4.0))
    assert found.end.kind is EndKind.CLOSED
    assert found.points[-1].arclength == pytest.approx(2.0 * math.pi, rel=5e-4)


def test_a_loop_is_closed_at_the_corrected_start():
    """The start given lies beside the circle."""
    found = follow(circle(), [0.7, 0.8])
    assert found.points[0].unknowns == pytest.approx([0.6, 0.8], abs=1e-12)
    assert found.end.kind is EndKind.CLOSED
    assert found.points[-1].unknowns == pytest.approx([0.6, 0.8], abs=1e-7)


def test_a_figure_of_eight_is_not_closed_at_its_crossing():
    """The walk passes the crossing twice, straight on, and closes at its start."""
    found = follow(lemniscate(), [1.0, 0.0], tests=[Turning()])
    assert found.end.kind is EndKind.CLOSED
    # the lemniscate's constant 2 times 2.62205755
    assert found.points[-1].arclength == pytest.approx(5.2441151, rel=5e-4)
    highest = math.sqrt(0.125)
    expected = [highest, -highest, highest, -highest]  # right, left by the crossing, and back
    assert sorted(e.parameter for e in found.events) == pytest.approx(sorted(expected), abs=1e-11)
    assert len({point.orientation >= 0.0 for point in found.points}) == 2


def test_a_helix_that_passes_close_to_its_start_is_no_loop():
    """Its turns lie closer to each other than a step is long."""
    pitch = 0.03 / (2.0 * math.pi)
    problem = Algebraic(
        lambda x, y, p: [x - math.cos(y / pitch), p - math.sin(y / pitch)],
        lambda x, y, p: [
            [1.0, math.sin(y / pitch) / pitch, 0.0],
            [0.0, -math.cos(y / pitch) / pitch, 1.0],
        ],
    )
    found = follow(problem, [1.0, 0.0, 0.0], settings=Settings(max_points=300))
    assert found.end.kind is EndKind.POINTS
    turns = abs(found.points[-1].unknowns[1]) / (2.0 * math.pi * pitch)
    assert turns > 3.0


def test_a_loop_started_inside_a_narrow_range_ends_on_its_limits():
    walks = [follow(circle(), [1.0, 0.0], d, limits=(-0.5, 0.5)) for d in (1, -1)]
    for found, limit in zip(walks, (0.5, -0.5), strict=True):
        assert found.end.kind is EndKind.RANGE
        assert found.points[-1].parameter == limit
        assert found.points[-1].unknowns[0] == pytest.approx(math.sqrt(0.75), abs=1e-12)


@pytest.mark.parametrize("direction", [1, -1])
def test_the_secant_predictor_walks_the_same_circle(direction):
    settings = Settings(predictor="secant")
    found = follow(circle(), [0.6, 0.8], direction, tests=[Turning()], settings=settings)
    assert found.end.kind is EndKind.CLOSED
    assert sorted(event.parameter for event in found.events) == pytest.approx([-1.0, 1.0])
    # its guesses are off further than those of the tangent: measured 129 points
    assert len(found.points) <= 150
    assert found.corrector_iterations <= 3.2 * len(found.points)


# The range


@pytest.mark.parametrize("slope", [-3.0, 0.0, 0.5, 100.0])
@pytest.mark.parametrize("limits", [(-1.0, 1.0), (-0.1, 0.7), (-1e-3, math.pi / 3)])
@pytest.mark.parametrize("direction", [1, -1])
def test_ends_of_the_range_are_hit_exactly(slope, limits, direction):
    found = follow(
        line(slope), [0.0, 0.0], direction, limits, settings=Settings(max_step=1.0, step=0.1)
    )
    limit = limits[direction > 0]
    assert found.end.kind is EndKind.RANGE
    assert found.points[-1].parameter == found.end.value == limit
    assert found.end.message == f"reached the end of the range at p = {limit:.12g}"
    assert found.points[-1].unknowns[0] == pytest.approx(slope * limit, rel=1e-14)
    parameters = [point.parameter for point in found.points]
    assert parameters == sorted(parameters, reverse=direction < 0)


def test_a_start_beyond_a_limit_by_rounding_lies_on_it():
    """As an event there: a branch born at A = 10.000000000000012 ended the whole diagram."""
    found = follow(line(1.0), [1.0, 1.0 + 1e-14], -1, limits=(0.0, 1.0))
    assert [found.points[i].parameter for i in (0, -1)] == [1.0, 0.0]
    with pytest.raises(InputError, match="do not hold the start"):
        follow(line(1.0), [1.0, 1.0 + 1e-8], -1, limits=(0.0, 1.0))


def test_both_directions_join_into_one_run():
    walks = [follow(parabola(), [0.5, 0.25], d, (-1.0, 1.0), tests=[Turning()]) for d in (-1, 1)]
    points, events = join_walks(*walks)
    x = [point.unknowns[0] for point in points]
    assert x == sorted(x)
    assert x[0] == pytest.approx(-1.0, abs=1e-12)
    assert x[-1] == pytest.approx(1.0, abs=1e-12)
    assert points[0].arclength == 0.0
    assert np.all(np.diff([point.arclength for point in points]) > 0.0)
    assert all(point.tangent[0] > 0.0 for point in points)
    assert len({point.orientation > 0.0 for point in points}) == 1
    (event,) = events
    assert event.kind == "FB"
    assert abs(event.parameter) < 1e-15
    middle = next(point for point in points if point.unknowns[0] > 0.0)
    assert event.point.arclength <= middle.arclength


@pytest.mark.parametrize("value", [1.0, -1.0])
def test_a_start_on_the_limit_goes_inwards_or_ends_there(value):
    outward = follow(line(), [2.0 * value, value], int(value), (-1.0, 1.0), tests=[Turning()])
    assert outward.end.kind is EndKind.RANGE
    assert [point.parameter for point in outward.points] == [value]
    assert outward.events == []
    inward = follow(line(), [2.0 * value, value], -int(value), (-1.0, 1.0))
    assert inward.end.kind is EndKind.RANGE
    assert inward.points[0].parameter == value
    assert inward.points[-1].parameter == -value


def test_a_branch_that_only_touches_a_limit_goes_on():
    """The circle's fold lies exactly on the limit."""
    found = follow(circle(), [1.0, 0.0], limits=(-1.5, 1.0 + 1e-9))
    assert found.end.kind is EndKind.CLOSED


# Other ends


@pytest.mark.parametrize("limit", [1, 2, 5, 40])
def test_the_limit_of_points(limit):
    found = follow(circle(), [1.0, 0.0], settings=Settings(max_points=limit))
    assert found.end.kind is EndKind.POINTS
    assert len(found.points) == limit
    assert f"the limit of {limit} points was reached" in found.end.message
    assert found.end.value == found.points[-1].parameter


def test_a_callback_sees_every_point_and_may_stop():
    seen = []

    def watch(point):
        seen.append(point)
        return point.parameter > 0.5

    found = follow(circle(), [1.0, 0.0], callback=watch)
    assert found.end.kind is EndKind.STOPPED
    assert found.end.message.startswith("stopped at p = ")
    assert found.points[1:] == seen
    assert found.points[-1].parameter > 0.5 >= found.points[-2].parameter


def test_a_callback_without_a_value_does_not_stop():
    count = itertools.count()
    found = follow(circle(), [1.0, 0.0], callback=lambda point: next(count) and None)
    assert found.end.kind is EndKind.CLOSED


def test_a_policy_sees_the_events_and_gives_the_end():
    calls = []

    class AtFold(Policy):
        def accepted(self, point, events):
            calls.append((point, list(events)))
            if any(event.kind == "FB" for event in events):
                end = End.of(EndKind.KNOWN, "p", events[0].parameter, known="b1")
                return end, events[0].point
            return None

        def limits(self, limits):
            return limits[0], min(limits[1], 1.5)

        def ended(self, walk):
            return replace(walk, notes=[walk.end.kind.name])

    found = walk(
        circle(),
        np.array([1.0, 0.0]),
        1,
        parameter="p",
        limits=(-2.0, 2.0),
        tests=[Turning()],
        policies=[Policy(), AtFold()],
    )
    assert found.end.kind is EndKind.KNOWN
    assert found.end.message == "met branch b1 at p = 1"
    assert found.notes == ["KNOWN"]
    assert found.points[-1] is found.events[-1].point
    assert isinstance(found.events[-1], Event)
    assert [len(events) for _, events in calls] == [0] * (len(calls) - 1) + [1]
    assert len(calls) == len(found.points) - 1


def test_a_start_that_cannot_be_corrected():
    nothing = Algebraic(lambda x, p: x * x + p * p + 1.0, lambda x, p: [2.0 * x, 2.0 * p])
    found = follow(nothing, [0.3, 0.2])
    assert found.end.kind is EndKind.START
    assert len(found.points) == len(found.events) == 0
    assert found.end.value == 0.2
    assert "the first point was not reached at p = 0.2" in found.end.message


def test_a_start_without_a_value():
    root = Algebraic(lambda x, p: x - math.sqrt(p), lambda x, p: [1.0, -0.5 / math.sqrt(p)])
    found = follow(root, [0.0, -1.0])
    assert found.end.kind is EndKind.START
    assert len(found.points) == 0
    assert "the equations have no value: math domain error" in found.end.message


@pytest.mark.parametrize("direction", [1, -1])
def test_a_start_that_two_directions_leave(direction):
    cross = Algebraic(lambda x, p: x * x - p * p, lambda x, p: [2.0 * x, -2.0 * p])
    found = follow(cross, [0.0, 0.0], direction)
    assert found.end.kind is EndKind.SINGULAR
    assert len(found.points) == 1
    assert "two directions leave the first point" in found.end.message


@pytest.mark.parametrize("tangent", [[1.0, 1.0], [3.0, -3.0]])
@pytest.mark.parametrize("direction", [1, -1])
def test_a_start_on_a_branch_point_leaves_along_the_direction_given(tangent, direction):
    cross = Algebraic(lambda x, p: x * x - p * p, lambda x, p: [2.0 * x, -2.0 * p])
    found = follow(
        cross,
        [0.0, 0.0],
        direction,
        tangent=np.array(tangent),
        branching=True,
        tests=[Turning(), Crossing()],
    )
    assert found.end.kind is EndKind.RANGE
    last = found.points[-1].unknowns
    assert last == pytest.approx(direction * np.array(tangent) * 2.0 / abs(tangent[0]), rel=1e-12)
    assert found.events == []
    assert found.missed == []


def test_a_tangent_decides_the_way_at_a_fold():
    for x in (1.0, -1.0):
        found = follow(parabola(), [0.0, 0.0], 1, (-1.0, 1.0), tangent=np.array([7.0 * x, 0.0]))
        assert found.points[-1].unknowns == pytest.approx([x, 1.0], abs=1e-12)


# Where the equations cease to have a value


@pytest.mark.parametrize("scale", [1.0, 0.3])
def test_a_branch_ends_where_its_equations_have_no_value_beyond(scale):
    """x = sqrt(1 - p), which at p = 1 stands upright: the last point comes within rounding."""
    root = Algebraic(
        lambda x, p: x - scale * math.sqrt(1.0 - p),
        lambda x, p: [1.0, 0.5 * scale / math.sqrt(1.0 - p)],
    )
    found = follow(root, [scale, 0.0])
    assert found.end.kind is EndKind.CORRECTOR
    assert "the equations have no value: math domain error" in found.end.message
    assert 1.0 - 1e-12 < found.points[-1].parameter <= 1.0
    # measured: 49 and 46 points, 51 and 44 rejected steps on the way down to the floor
    assert len(found.points) <= 60
    assert found.rejected_steps <= 80


def test_a_residual_that_is_not_finite_ends_a_branch():
    cut = Algebraic(lambda x, p: x - p if p < 0.4321 else math.nan, lambda x, p: [1.0, -1.0])
    found = follow(cut, [0.0, 0.0])
    assert found.end.kind is EndKind.CORRECTOR
    assert "the residual is not finite" in found.end.message
    # the smallest step is 1e-7 along a line of slope one
    assert 0.4321 - 1e-7 <= found.points[-1].parameter < 0.4321


def test_a_corner_ends_a_branch_at_the_smallest_step():
    """No step gets round a corner of 53 degrees."""
    corner = Algebraic(
        lambda x, p: x - 0.5 * abs(p), lambda x, p: [1.0, -0.5 * math.copysign(1.0, p)]
    )
    found = follow(corner, [0.5, -1.0])
    assert found.end.kind is EndKind.STEP
    assert "the step fell below 1e-07" in found.end.message
    assert -1e-7 <= found.points[-1].parameter <= 0.0
    assert found.rejected_steps <= 60  # measured: 31


def test_a_tolerance_below_rounding_is_named():
    """Beyond p = 0.4 an equation has the rounding of terms of 1e5, as long flights have in all
    their coordinates."""

    def error(y, p):
        return 2e-11 * math.sin(1e16 * (p + math.pi * y)) if p > 0.4 else 0.0

    rough = Algebraic(
        lambda x, y, p: [1e5 * (x - p), y - p + error(y, p)],
        lambda x, y, p: [[1e5, 0.0, -1e5], [0.0, 1.0, -1.0]],
    )
    found = walk(rough, np.zeros(3), 1, parameter="p", limits=(-1.0, 1.0))
    assert found.end.kind is EndKind.STEP
    assert "a tolerance above 2e-11, the rounding of the equations" in found.end.message
    loose = {"settings": Settings(tolerance=1e-10)}
    found = walk(rough, np.zeros(3), 1, parameter="p", limits=(-1.0, 1.0), **loose)
    assert found.end.kind is EndKind.RANGE


@pytest.mark.parametrize("largest", [1e-12, 1e-9])
def test_a_largest_angle_that_no_step_keeps_is_named(largest):
    found = follow(circle(), [1.0, 0.0], settings=Settings(max_angle=largest))
    assert found.end.kind is EndKind.STEP
    assert "a larger max_angle may carry on" in found.end.message


def test_a_branch_that_touches_the_limit_closer_than_a_step_says_so():
    """It passes p = 0 by 1e-15 over a width of 6e-8, less than the smallest step."""
    over = Algebraic(lambda x, p: p + x * x - 1e-15, lambda x, p: [2.0 * x, 1.0])
    # symmetric steps: from x = -5e-8 to 5e-8, both below the limit
    start = [-5e-8, 1e-15 - 2.5e-15]
    exact = Settings(step=1e-7, min_step=1e-7, tolerance=1e-17)
    found = follow(over, start, 1, (-1.0, 0.0), settings=exact)
    assert found.end.kind is EndKind.EDGE
    assert "left the range within a step of 1e-07" in found.end.message
    assert "the branch leaves the range and returns inside the step" in found.end.message


def test_a_limit_on_which_nothing_is_reached_is_an_edge_of_the_range():
    def line_but(x, p):
        if p == 0.5:
            raise ValueError("no value on the limit")
        return x - p

    found = follow(Algebraic(line_but, lambda x, p: [1.0, -1.0]), [0.0, 0.0], 1, (0.0, 0.5))
    assert found.end.kind is EndKind.EDGE
    assert "no point was reached on the limit" in found.end.message
    assert 0.5 - 2e-7 < found.points[-1].parameter < 0.5


@pytest.mark.parametrize("cause", list(Refusal))
def test_every_refusal_has_an_end_and_a_sentence(cause):
    refused = RefusalDetails(cause, 0.3)
    told = {"floor": 1e-7, "near": "1e-9", "place": 0.2, "advice": "another parameter"}
    end = End.of(refused.kind, "p", 0.1, why=str(refused), **told)
    assert str(refused) in end.message
    assert "{" not in end.message


# Folds


@pytest.mark.parametrize("sharpness", [1.0, 1e-2, 1e-4])
def test_a_fold_is_rounded_and_located(sharpness):
    fold = Algebraic(lambda x, p: x * x + sharpness * p, lambda x, p: [2.0 * x, sharpness])
    start = math.sqrt(sharpness)
    found = follow(fold, [start, -1.0], limits=(-1.0, 1.0), tests=[Turning(), Crossing()])
    assert found.end.kind is EndKind.RANGE
    assert found.points[-1].unknowns == pytest.approx([-start, -1.0], abs=1e-8)
    assert kinds(found) == ["FB"]
    # a residual of 1e-12 moves the fold by 1e-12 over the sharpness; measured 6e-11 for 1e-4
    assert abs(found.events[0].parameter) < 1e-12 / sharpness
    assert len(found.points) <= 120  # measured: 39, 56, 69


def test_many_folds():
    """p = sin 3x between -2 and 2 has four folds."""
    waves = Algebraic(
        lambda x, p: p - math.sin(3.0 * x), lambda x, p: [-3.0 * math.cos(3.0 * x), 1]
    )
    found = follow(
        waves, [0.0, 0.0], callback=lambda point: point.unknowns[0] > 2.0, tests=[Turning()]
    )
    expected = [1.0, -1.0]
    assert [event.parameter for event in found.events] == pytest.approx(expected, abs=1e-12)
    places = [event.point.unknowns[0] for event in found.events]
    assert places == pytest.approx([math.pi / 6, math.pi / 2], abs=1e-12)


# Imperfect and perfect pitchforks


def pitchfork(imperfection):
    return Algebraic(lambda x, p: x**3 - p * x + imperfection, lambda x, p: [3.0 * x * x - p, -x])


@pytest.mark.parametrize("max_step", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("size", [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8])
@pytest.mark.quick(12)
def test_on_an_imperfect_pitchfork_the_walk_stays_on_its_piece(size, sign, max_step):
    """x (x^2 - p) = -e: the piece through x < 0 (for e > 0) has no fold and crosses no x = 0."""
    found = follow(
        pitchfork(sign * size),
        [-sign * size, -1.0],
        limits=(-1.0, 1.0),
        tests=[Turning(), Crossing()],
        settings=Settings(max_step=max_step),
    )
    assert found.end.kind is EndKind.RANGE
    assert all(sign * point.unknowns[0] < 0.0 for point in found.points)
    assert found.points[-1].unknowns == pytest.approx([-sign, 1.0], abs=0.51 * size + 1e-12)
    assert (found.events, found.missed) == ([], [])
    # measured at most: 153 points, 17 rejected steps, 287 iterations
    assert len(found.points) <= 200
    assert found.rejected_steps <= 30
    assert found.corrector_iterations <= 400


@pytest.mark.parametrize("max_step", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("size", [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8])
@pytest.mark.quick(9)
def test_the_other_piece_of_an_imperfect_pitchfork_has_a_fold(size, max_step):
    """It comes down x = sqrt(p) and turns back at p = 3 (e/2)^(2/3) to go along x = e/p."""
    found = follow(
        pitchfork(size),
        [1.0, 1.0],
        -1,
        limits=(-1.0, 1.0),
        tests=[Turning(), Crossing()],
        settings=Settings(max_step=max_step),
    )
    assert found.end.kind is EndKind.RANGE
    assert all(point.unknowns[0] > 0.0 for point in found.points)
    assert found.points[-1].unknowns == pytest.approx([size, 1.0], abs=1.1 * size**3 + 1e-12)
    assert kinds(found) == ["FB"]
    assert found.missed == []
    # a residual of 1e-12 moves the fold by 1e-12/x, up to 6e-10 at x = (e/2)^(1/3): measured 3e-11
    assert found.events[0].parameter == pytest.approx(3.0 * (size / 2.0) ** (2.0 / 3.0), abs=6e-10)
    assert len(found.points) <= 200
    assert found.rejected_steps <= 30


@pytest.mark.parametrize("start", [-1.0, -0.937, -0.51])
@pytest.mark.parametrize("max_step", [0.02, 0.1, 0.3])
def test_a_perfect_pitchfork_is_passed_straight_and_its_orientation_turns(start, max_step):
    found = follow(
        pitchfork(0.0), [0.0, start], limits=(-1.0, 1.0), settings=Settings(max_step=max_step)
    )
    assert found.end.kind is EndKind.RANGE
    assert all(point.unknowns[0] == 0.0 for point in found.points)
    before = {point.orientation >= 0.0 for point in found.points if point.parameter < 0.0}
    after = {point.orientation >= 0.0 for point in found.points if point.parameter > 0.0}
    assert len(before) == len(after) == 1
    assert before != after
    assert found.rejected_steps == 0


def pitchfork_in_two():
    """The pitchfork again, as y = p x and y = x^3: its Jacobian has no row that vanishes."""
    return Algebraic(
        lambda x, y, p: [y - p * x, y - x**3],
        lambda x, y, p: [[-p, 1.0, -x], [-3.0 * x * x, 1.0, 0.0]],
    )


@pytest.mark.parametrize(
    ("start", "max_step"), [(-1.0, 0.02), (-1.0, 0.1), (-1.0, 0.3), (-0.937, 0.1), (-0.51, 0.1)]
)
def test_a_branch_point_is_located_by_the_orientation(start, max_step):
    found = follow(
        pitchfork_in_two(),
        [0.0, 0.0, start],
        limits=(-1.0, 1.0),
        tests=[Turning(), Crossing()],
        settings=Settings(max_step=max_step),
    )
    assert kinds(found) == ["BP"]
    assert abs(found.events[0].parameter) <= 2.0 * found.events[0].error + 1e-16
    assert found.events[0].error < 1e-12
    assert found.missed == []


@pytest.mark.parametrize("start", [-1.0, 1.0, -0.3, 0.5])
@pytest.mark.parametrize("max_step", [0.02, 0.3])
def test_a_branch_point_on_the_limit_ends_the_walk_there(start, max_step):
    found = follow(
        pitchfork_in_two(),
        [0.0, 0.0, start],
        -1 if start > 0.0 else 1,
        limits=(min(start, 0.0), max(start, 0.0)),
        tests=[Turning(), Crossing()],
        settings=Settings(max_step=max_step),
    )
    assert (found.end.kind, found.end.value) == (EndKind.RANGE, 0.0)
    assert found.points[-1].unknowns == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    assert kinds(found) == ["BP"]


def test_the_curved_branch_passes_the_branch_point_too():
    """Along p = x^2 the parameter turns exactly where the branches cross."""
    found = follow(pitchfork_in_two(), [1.0, 1.0, 1.0], -1, limits=(-1.0, 1.0))
    assert found.end.kind is EndKind.RANGE
    assert found.points[-1].unknowns == pytest.approx([-1.0, -1.0, 1.0], abs=1e-12)
    signs = {(point.unknowns[0] > 0.0, point.orientation > 0.0) for point in found.points}
    assert len(signs) == 2


@pytest.mark.parametrize("direction", [1, -1])
def test_a_branch_is_left_at_its_branch_point_in_the_direction_given(direction):
    start, tangent = [0.0, 0.0, 0.0], np.array([1.0, 0.0, 0.0])
    found = follow(
        pitchfork_in_two(),
        start,
        direction,
        (-1.0, 1.0),
        tangent=tangent,
        branching=True,
        tests=[Turning(), Crossing()],
    )
    expected = [direction, direction, 1.0]
    assert found.points[-1].unknowns == pytest.approx(expected, abs=1e-12)
    assert (found.events, found.missed) == ([], [])


# Close branches


def parallel(distance, height=0.3):
    """Two waves x = h sin 3p and x = h sin 3p + d."""

    def both(x, p):
        first = x - height * math.sin(3.0 * p)
        return first, first - distance

    def slopes(x, p):
        first, second = both(x, p)
        slope = (first + second) / distance
        return [slope, -slope * 3.0 * height * math.cos(3.0 * p)]

    return Algebraic(lambda x, p: both(x, p)[0] * both(x, p)[1] / distance, slopes)


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize(
    ("distance", "points"),  # measured: 40, 40, 43, 53, 82, 216
    [(1e-1, 50), (3e-2, 50), (1e-2, 60), (3e-3, 80), (1e-3, 120), (1e-4, 300)],
)
@pytest.mark.quick(10)
def test_the_walk_does_not_change_to_a_parallel_branch(distance, points, number):
    offset = number * distance
    found = follow(parallel(distance), [offset, 0.0], tests=[Turning(), Crossing()])
    assert found.end.kind is EndKind.RANGE
    for point in found.points:
        x, p = point.unknowns
        # the residual is divided by the distance, so 1e-12 of it moves x by as much
        assert abs(x - offset - 0.3 * math.sin(3.0 * p)) < 1e-11
    assert found.events == []
    assert len(found.points) <= points
    assert found.corrector_iterations <= 15 * points


@pytest.mark.parametrize("radius", [0, 1])
@pytest.mark.parametrize("distance", [1e-1, 1e-2, 1e-3])
def test_the_walk_does_not_change_between_concentric_circles(distance, radius):
    def square(x, p):
        return x * x + p * p

    outer = (1.0 + distance) ** 2
    rings = Algebraic(
        lambda x, p: (square(x, p) - 1.0) * (square(x, p) - outer) / distance,
        lambda x, p: [2.0 * u * (2.0 * square(x, p) - 1.0 - outer) / distance for u in (x, p)],
    )
    own = 1.0 + radius * distance
    found = follow(rings, [own, 0.0])
    assert found.end.kind is EndKind.CLOSED
    assert all(abs(np.hypot(*point.unknowns) - own) < 1e-11 for point in found.points)
    assert len(found.points) <= 500  # measured: 70, 95, 328 on the inner circle


# Effort


def test_straight_lines_take_the_longest_steps():
    problem = line(0.0)
    found = follow(problem, [0.0, 0.0])
    # 0.01 doubled up to 0.1, then 0.1 up to 2: measured 24
    assert len(found.points) <= 26
    assert found.corrector_iterations == 0
    assert problem.evaluations <= 30


def test_tests_cost_one_point_where_nothing_happens():
    """The first step is cut once: before it nothing is known of how a test function bends."""
    bare, watched = circle(), circle()
    follow(bare, [1.0, 0.0])
    follow(watched, [1.0, 0.0], tests=[UserFunction("far", lambda point: point.parameter + 5.0)])
    assert watched.evaluations <= bare.evaluations + 3


def test_natural_sizes_are_measured_once_at_a_point(monkeypatch):
    measured, scale = [], Algebraic.scale

    def counted(self, unknowns, span):
        measured.append(tuple(unknowns))
        return scale(self, unknowns, span)

    monkeypatch.setattr(Algebraic, "scale", counted)
    found = follow(line(), [0.0, 0.0], limits=(-1.0, 1.0))
    assert found.end.kind is EndKind.RANGE
    assert len(measured) == len(set(measured)) == len(found.points) - 1


def test_steps_shrink_where_a_branch_bends_and_grow_again():
    """A smooth corner: x = sqrt(p^2 + 1e-4), curvature 100 at p = 0."""
    bend = Algebraic(
        lambda x, p: x - math.hypot(p, 0.01), lambda x, p: [1.0, -p / math.hypot(p, 0.01)]
    )
    found = follow(bend, [math.hypot(1.0, 0.01), -1.0], limits=(-1.0, 1.0))
    assert found.end.kind is EndKind.RANGE
    steps = np.diff([point.arclength for point in found.points])
    sharp = [
        s for s, point in zip(steps, found.points, strict=False) if abs(point.parameter) < 0.01
    ]
    assert max(sharp) < 0.01
    assert max(steps) > 0.05
    assert len(found.points) <= 80  # measured: 52


@pytest.mark.parametrize(
    ("orientation", "dips"),
    [
        (lambda s: 1.3 - s, True),
        (lambda s: math.exp(-3.0 * s) * (1.2 - s), True),
        (lambda s: -math.exp(-s) * (0.4 - s) ** 2, True),
        (lambda s: math.exp(-3.0 * s), False),
        (lambda s: -math.exp(-3.0 * s + 0.02 * s * s), False),
        (lambda s: 2.0 + 0.1 * s, False),
    ],
)
@pytest.mark.parametrize("lengths", [(1.0, 1.0), (0.25, 0.5)])
def test_an_orientation_that_changes_by_one_factor_is_not_about_to_vanish(
    orientation, dips, lengths
):
    """As those of long words do, at the points before a step of length one and behind it."""
    state = [0.0] * step.PLACES
    state[step.FARTHER], state[step.BEHIND] = -sum(lengths), -lengths[1]
    state[step.EARLIEST] = orientation(-sum(lengths))
    state[step.EARLIER], state[step.ORIENTATION] = orientation(-lengths[1]), orientation(0.0)
    assert step.orientation_dips(state, orientation(1.0), 1.0) is dips


def test_batches_end_before_sizes_may_have_grown_much():
    asked = []

    class Recorded(DenseBackend):
        def advance(self, position, most):
            asked.append(most)
            return super().advance(position, most)

    problem, settings = line(), Settings(max_step=0.5)
    follow(problem, np.zeros(2), limits=(-1.0, 9.0), settings=settings, backend=Recorded(problem))
    assert max(asked) == OUTGROWN / settings.max_step


@dataclass
class Outgrowing(Algebraic):
    """Its unknowns have the sizes that they are of."""

    def scale(self, unknowns, span):
        return np.append(np.maximum(np.abs(unknowns[:-1]), 1e-30), span)


@pytest.mark.parametrize("pole", [0.0, 0.5])
def test_a_branch_ends_where_it_grows_without_bound(pole):
    """It went on until the parameter was rounding, with folds that there are not."""
    problem = Outgrowing(lambda x, p: x * (p - pole) - 1.0, lambda x, p: [p - pole, x])
    found = walk(problem, np.array([1.0, 1.0 + pole]), -1, parameter="p", limits=(-2.0, 2.0))
    assert found.end.kind is EndKind.UNBOUNDED
    assert found.end.message.startswith("grew without bound as p approached")
    assert found.end.value == pytest.approx(pole, abs=1e-8)
    assert len(found.points) < 1000
    assert found.points[-1].unknowns[0] > 1e6


@pytest.mark.parametrize("start", [0.0, 1e-30])
def test_a_branch_that_begins_next_to_nothing_goes_on(start):
    problem = Outgrowing(lambda x, p: x - p, lambda x, p: [1.0, -1.0])
    settings = Settings(max_points=10_000)
    begin = np.array([start, start])
    found = walk(problem, begin, 1, parameter="p", limits=(-2.0, 2.0), settings=settings)
    assert found.end.kind is EndKind.RANGE
