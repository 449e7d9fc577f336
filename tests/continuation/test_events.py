"""The crossing rule, and the location of events on curves with closed-form answers."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
import pytest
from algebraic import EPSILON, Values
from hypothesis import given, settings
from hypothesis import strategies as st

from contimpact.continuation import sign_changes
from contimpact.continuation.branch import (
    Event,
    Location,
    MissedEvent,
    Point,
    TestFunction,
    UserFunction,
    missed_texts,
)
from contimpact.continuation.corrector import Arc, point_after
from contimpact.continuation.events import STEP_TOO_LARGE, find_events
from contimpact.continuation.settings import Settings
from contimpact.continuation.sign_changes import (
    DIPS,
    Sample,
    Samples,
    Stretch,
    crosses,
    crossings,
    suspect_values,
)
from contimpact.continuation.walk import walk


@dataclass
class Curve:
    """One equation f(x, p) = 0."""

    equation: object
    derivatives: object

    def evaluate(self, unknowns):
        x, p = unknowns.tolist()
        return Values(unknowns, np.array([self.equation(x, p)]), np.array([self.derivatives(x, p)]))

    def scale(self, unknowns, span):
        return np.ones(2)

    def difference(self, one, other):
        return one - other


LINE = Curve(lambda x, p: x - 2.0 * p, lambda x, p: [1.0, -2.0])
CIRCLE = Curve(lambda x, p: x * x + p * p - 1.0, lambda x, p: [2.0 * x, 2.0 * p])
CUBIC = Curve(lambda x, p: x**3 + x - p, lambda x, p: [3.0 * x * x + 1.0, -1.0])


def follow(curve, start, direction, tests, max_points=2000):
    return walk(
        curve,
        np.array(start),
        direction,
        parameter="p",
        limits=(-3.0, 3.0),
        tests=tests,
        settings=Settings(max_points=max_points),
    )


def user(function, kind="mine"):
    return UserFunction(kind, function)


def arc_of(curve, left, right):
    """Two points of a curve as neighbours of a walk."""
    left, right = np.array(left), np.array(right)
    chord = right - left
    before = Point(curve.evaluate(left), chord / np.linalg.norm(chord), np.nan, 1.0, 0)
    first = point_after(before, before.evaluation, 0, np.ones(2))
    second = point_after(first, curve.evaluate(right), 0, np.ones(2))
    return Arc(curve, first, second, np.ones(2), Settings())


def events_on(arc, *tests):
    left = [test.values(arc.left) for test in tests]
    right = [test.values(arc.right) for test in tests]
    ends = (Sample.of(p.arclength, v) for p, v in ((arc.left, left), (arc.right, right)))
    return find_events(list(tests), arc, Stretch(*ends))


# The crossing rule: zero counts as positive


@pytest.mark.parametrize(
    ("left", "right", "crosses"),
    [
        (-1.0, 1.0, True),
        (1.0, -1.0, True),
        (-1.0, -2.0, False),
        (2.0, 1.0, False),
        (-1.0, 0.0, True),  # arrives at zero from below: found on this side
        (0.0, 1.0, False),  # and not again on the other
        (1.0, 0.0, False),  # arrives at zero from above: not yet
        (0.0, -1.0, True),  # found when it leaves
        (0.0, 0.0, False),
        (-0.0, 0.0, False),  # the sign of zero does not matter
        (0.0, -0.0, False),
        (1.0, -0.0, False),
        (-0.0, -1.0, True),
        (-1.0, -0.0, True),
        (-5e-324, 5e-324, True),
        (-math.inf, math.inf, True),
        (math.nan, 1.0, False),
        (math.nan, -1.0, False),
        (1.0, math.nan, False),
        (-1.0, math.nan, False),
        (math.nan, math.nan, False),
    ],
)
def test_crossing_rule(left, right, crosses):
    assert crossings(np.array([left]), np.array([right])) == ([0] if crosses else [])


def test_each_component_crosses_for_itself():
    left = np.array([1.0, -1.0, math.nan, 0.0, 3.0])
    right = np.array([-1.0, 1.0, -1.0, -2.0, 4.0])
    assert crossings(left, right) == [0, 1, 3]
    assert crossings(np.array([]), np.array([])) == []


@settings(deadline=None, derandomize=True)
@given(st.lists(st.sampled_from([-1.0, -0.0, 0.0, 1.0]), min_size=2, max_size=12))
def test_zeros_on_points_are_counted_the_same_both_ways(values):
    """A walk and its reverse find as many zeros: those of the values with zero taken as one."""

    def count(sequence):
        pairs = itertools.pairwise(sequence)
        return sum(len(crossings(np.array([a]), np.array([b]))) for a, b in pairs)

    signs = [1.0 if value == 0.0 else value for value in values]
    expected = sum(a != b for a, b in itertools.pairwise(signs))
    assert count(values) == count(values[::-1]) == expected


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("number", [1, 2, 5, 9])
@pytest.mark.parametrize("curve", [LINE, CUBIC])
@pytest.mark.quick(12)
def test_a_zero_exactly_on_a_point_is_found_once(curve, number, sign, direction):
    """The walk takes the same steps with and without the test function."""
    target = follow(curve, [0.0, 0.0], direction, []).points[number].parameter
    tests = [user(lambda point: sign * (point.parameter - target))]
    found = follow(curve, [0.0, 0.0], direction, tests)
    assert not found.missed
    (event,) = found.events
    assert abs(event.parameter - target) <= event.error
    assert event.error < 5e-12  # measured: 8e-13


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_zero_at_the_start_belongs_to_one_of_both_walks(sign):
    tests = [user(lambda point: sign * point.parameter)]
    walks = [follow(LINE, [0.0, 0.0], direction, tests) for direction in (1, -1)]
    (event,) = [event for w in walks for event in w.events]
    assert abs(event.parameter) <= event.error < 1e-15


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("limit", [1.5, -1.5])
def test_a_zero_on_the_end_of_the_range_is_found_from_inside(limit, sign):
    direction = 1 if limit > 0.0 else -1
    tests = [user(lambda point: sign * (point.parameter - limit))]
    for start in (0.0, limit):
        way = direction if start == 0.0 else -direction
        found = walk(
            LINE,
            np.array([2.0 * start, start]),
            way,
            parameter="p",
            limits=(-1.5, 1.5),
            tests=tests,
        )
        assert found.missed == []
        (event,) = found.events
        assert abs(event.parameter - limit) <= event.error < 1e-12


# Not-a-number


def test_values_that_do_not_exist_cross_nothing():
    tests = [user(lambda p: p.parameter - 0.4 if p.parameter < 0.3 else math.nan)]
    found = follow(LINE, [0.0, 0.0], 1, tests)
    assert found.events == []
    assert found.missed == []


def test_a_value_that_ceases_to_exist_inside_a_bracket_is_reported():
    arc = arc_of(LINE, [0.0, 0.0], [2.0, 1.0])
    test = user(lambda p: math.nan if 0.2 < p.parameter < 0.8 else p.parameter - 0.5)
    events, (missed,) = events_on(arc, test)
    assert events == []
    assert missed == MissedEvent(
        "mine", (0.0, 1.0), "the test function has no value inside the bracket", index=0
    )


def test_what_may_be_missing_at_several_places_is_said_once():
    here = [MissedEvent("G", (0.25, 0.5), "why", place=f"flight {k}") for k in range(1, 9)]
    other = MissedEvent("G", (0.5, 0.75), "why", place="flight 1")
    twins = [MissedEvent("FB", (0.25, 0.5), "why")] * 2
    more = MissedEvent("PD", (0.25, 0.5), "why"), MissedEvent("NS", (0.25, 0.5), "why")
    assert missed_texts("s", [*here, other, *twins, *more]) == [
        "G between s = 0.25 and 0.5, at 8 places (flight 1, flight 2, flight 3, flight 4, "
        "flight 5, flight 6, ...): why",
        "G between s = 0.5 and 0.75: why",
        "FB between s = 0.25 and 0.5, at 2 places: why",
        "PD, NS between s = 0.25 and 0.5: why",
    ]


@pytest.mark.parametrize("known", [False, True])
def test_a_step_across_which_no_orbit_is_found_is_too_large(known):
    """A dip is looked into where the arc can be cut; this one cannot be."""
    nothing = 0.2, (0.8 if not known else 0.2)
    line = Curve(
        lambda x, p: x - 2.0 * p if not nothing[0] < p < nothing[1] else math.nan,
        lambda x, p: [1.0, -2.0],
    )
    arc = arc_of(line, [0.0, 0.0], [2.0, 1.0])
    test = user(lambda p: (p.parameter - 0.5) ** 2 - 0.15)
    length = arc.right.arclength - arc.left.arclength
    beside = (arc.left.arclength - length, 2.1), (arc.right.arclength + length, 2.1)
    before, after = (Sample.of(at, [np.array([value])]) for at, value in beside)
    ends = (Sample.of(p.arclength, [test.values(p)]) for p in (arc.left, arc.right))
    events, missed = find_events([test], arc, Stretch(*ends, before, after))
    zeros = [0.5 - math.sqrt(0.15), 0.5 + math.sqrt(0.15)]
    assert [event.point.parameter for event in events] == pytest.approx(zeros if known else [])
    assert [one.reason for one in missed] == ([] if known else [STEP_TOO_LARGE])


# Location by bracketing


@pytest.mark.parametrize(
    ("curve", "start", "direction"),
    [
        (LINE, [0.0, 0.0], 1),
        (LINE, [1.8, 0.9], -1),
        (CIRCLE, [1.0, 0.0], 1),
        (CIRCLE, [0.0, 1.0], -1),
        (CUBIC, [0.0, 0.0], 1),
    ],
)
@settings(deadline=None, derandomize=True, max_examples=25)
@given(target=st.floats(0.02, 0.85))
@pytest.mark.full
def test_the_error_of_a_bracketed_event_is_honest(curve, start, direction, target):
    """Measured: true error at most 0.4 times the one reported, and that below 1e-12."""
    found = follow(curve, start, direction, [user(lambda p: p.parameter - target)], max_points=40)
    event = min(found.events, key=lambda e: abs(e.parameter - target))
    assert event.method == "bracket"
    assert abs(event.parameter - target) <= event.error + EPSILON
    if event.parameter != target:  # an exact zero ends the bracketing before it has closed
        assert event.error < 5e-12
    assert event.residual <= 1e-12


@pytest.mark.parametrize(
    "function",
    [
        lambda p, c: (p - c) ** 3,
        lambda p, c: math.expm1(40.0 * (p - c)),
        lambda p, c: math.copysign(abs(p - c) ** 0.2, p - c),
        lambda p, c: 1e-200 * (p - c),
        lambda p, c: 1e200 * (p - c),
        lambda p, c: math.atan(1e6 * (p - c)),
    ],
    ids=["flat", "steep", "vertical", "tiny", "huge", "step-like"],
)
@pytest.mark.parametrize("target", [0.0071, 0.37, 1.234567])
def test_awkward_functions_are_located_with_an_honest_error(function, target):
    found = follow(LINE, [0.0, 0.0], 1, [user(lambda p: function(p.parameter, target))])
    assert found.missed == []
    (event,) = found.events
    assert abs(event.parameter - target) <= 2.0 * event.error
    if event.parameter != target:  # an exact zero ends the bracketing before it has closed
        # secants are slow on the cube: measured 3.2e-10; 2e-14 on the others
        assert event.error < 1e-9


def test_on_a_circle_every_passage_is_found():
    target = 0.3
    tests = [user(lambda p: p.parameter - target), user(lambda p: p.unknowns[0], "x")]
    found = follow(CIRCLE, [1.0, 0.0], 1, tests)
    expected = [("mine", 0.3), ("x", 1.0), ("mine", 0.3), ("x", -1.0)]
    assert [event.kind for event in found.events] == [kind for kind, _ in expected]
    for event, (_, value) in zip(found.events, expected, strict=True):
        # near p = 1 the curve is flat, and the residual's 1e-12 decides: measured 3e-13
        assert abs(event.parameter - value) <= 2.0 * event.error
        assert event.error < 1e-11


def test_sign_changes_of_rounding_are_not_looked_at():
    """Below its noise a test function says nothing: it is told at the walk's own points only."""
    rounding = user(lambda p: 1e-12 * math.sin(1e5 * p.parameter))
    rounding.noise = 1e-9
    found = follow(CUBIC, [0.0, 0.0], 1, [rounding])
    assert not found.events
    assert not found.missed
    assert rounding.evaluations == len(found.points)


def test_a_bracketed_event_lies_on_the_curve_and_in_order():
    tests = [user(lambda p: p.parameter - 0.30), user(lambda p: p.parameter - 0.31, "other")]
    for direction, kinds in ((1, ["mine", "other"]), (-1, ["other", "mine"])):
        start = [0.0, 0.0] if direction > 0 else [0.68, 0.68 + 0.68**3]
        found = follow(CUBIC, start, direction, tests)
        first, second = found.events
        assert [first.kind, second.kind] == kinds
        assert first.point.arclength < second.point.arclength
        for event in found.events:
            x, p = event.point.unknowns
            assert abs(x**3 + x - p) <= 1e-12


def test_two_zeros_within_one_step_are_put_in_order():
    arc = arc_of(LINE, [0.0, 0.0], [2.0, 1.0])
    tests = [user(lambda p: p.parameter - 0.7, "late"), user(lambda p: 0.2 - p.parameter, "early")]
    events, missed = events_on(arc, *tests)
    assert [event.kind for event in events] == ["early", "late"]
    assert missed == []


def test_a_function_of_several_components_says_which_one_vanished():
    class Several(TestFunction):
        kind = "several"

        def values(self, point):
            return np.array([1.0, 0.75 - point.parameter, math.nan, point.parameter - 0.25])

    events, missed = events_on(arc_of(LINE, [0.0, 0.0], [2.0, 1.0]), Several())
    assert [event.details["index"] for event in events] == [3, 1]
    assert [event.parameter for event in events] == pytest.approx([0.25, 0.75], abs=1e-14)
    assert missed == []


@pytest.mark.parametrize(
    "function",
    [
        lambda x, w: x * x - w * w,
        lambda x, w: math.cosh(3.0 * x) - math.cosh(3.0 * w),
        lambda x, w: math.cos(3.0 * w) - math.cos(3.0 * x),
    ],
    ids=["parabola", "cosh", "cos"],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("width", [0.02, 0.005, 0.001])
@pytest.mark.parametrize("target", [0.4321, 0.777, 1.013])
@pytest.mark.quick(27)
def test_a_function_that_dips_below_zero_within_a_step_crosses_twice(function, sign, width, target):
    """The steps are 0.1 long; its signs on the points say nothing."""
    tests = [user(lambda p: sign * function(p.parameter - target, width))]
    found = walk(LINE, np.array([0.0, 0.0]), 1, parameter="p", limits=(-2.0, 1.4), tests=tests)
    assert found.missed == []
    expected = [target - width, target + width]
    assert [event.parameter for event in found.events] == pytest.approx(expected, abs=1e-12)
    for event, value in zip(found.events, expected, strict=True):
        # near its extremum the function knows its zeros to 1e-16/width
        assert abs(event.parameter - value) <= 2.0 * event.error + 1e-16 / width


# Functions that jump


@pytest.mark.parametrize(
    "function",
    [
        lambda p: math.copysign(1.0, p - 0.4),
        lambda p: 2.0 if p < 0.4 else -1.0,
        lambda p: p - 1.0 if p < 0.4 else p + 1.0,
        lambda p: 1.0 / (p - 0.4),
        lambda p: math.tan(math.pi * (p + 0.1)),
        lambda p: -((p - 0.4) ** -3),
    ],
    ids=["sign", "step", "sawtooth", "pole", "tangent", "odd pole"],
)
@pytest.mark.parametrize("direction", [1, -1])
def test_a_jump_is_not_an_event(function, direction):
    start = [0.0, 0.0] if direction > 0 else [1.6, 0.8]
    limit = user(lambda point: function(point.parameter))
    found = walk(LINE, np.array(start), direction, parameter="p", limits=(0.0, 0.8), tests=[limit])
    assert found.events == []
    (missed,) = found.missed
    assert missed.kind == "mine"
    assert missed.reason == "the test function jumps without passing through zero"
    assert min(missed.parameters) <= 0.4 <= max(missed.parameters)


class Entering(TestFunction):
    """A value that jumps at 0.4, where what it is of comes from elsewhere."""

    kind = "mine"

    def __init__(self, before):
        self.before = before

    def values(self, point):
        return np.array([1.0 if point.parameter < 0.4 else -self.before])

    def enters(self, point, index):
        return abs(point.parameter - 0.4) < 1e-9


@pytest.mark.parametrize("before", [1.0, 1e-3])
def test_a_value_that_enters_is_not_missed_however_small_it_is(before):
    """An extremum 7e-4 beyond a wall entered across the impact of another body."""
    tests = [Entering(before)]
    found = walk(LINE, np.zeros(2), 1, parameter="p", limits=(0.0, 0.8), tests=tests)
    assert (found.events, found.missed) == ([], [])


def test_a_zero_next_to_a_jump_is_still_found():
    tests = [user(lambda p: p.parameter - 0.2 if p.parameter < 0.4 else p.parameter - 1.0)]
    found = follow(LINE, [0.0, 0.0], 1, tests)
    assert [round(event.parameter, 12) for event in found.events] == [0.2, 1.0]
    (missed,) = found.missed
    assert missed.parameters[0] < 0.4 <= missed.parameters[1]


# Newton on an extended system


class Passage(TestFunction):
    """The parameter takes a value; `offset` puts the located point beside it."""

    kind = "passage"

    def __init__(self, target, offset=0.0, error=1e-16, accepted=True):
        self.target, self.offset, self.error, self.accepted = target, offset, error, accepted
        self.guesses = 0

    def values(self, point):
        return np.array([point.parameter - self.target])

    def locate(self, problem, guess, index):
        self.guesses += 1
        p = self.target + self.offset
        return Location(np.array([2.0 * p, p]), 0.0, self.error, {"asked": self.target})

    def accept(self, event):
        return self.accepted

    def details(self, point, index):
        return {"index": index, "bracketed": True}


def step_of_line():
    return arc_of(LINE, [0.2, 0.1], [0.4, 0.2])


def test_newton_decides_where_it_works():
    test = Passage(0.15)
    (event,), missed = events_on(step_of_line(), test)
    assert isinstance(event, Event)
    assert (event.kind, event.method, event.parameter) == ("passage", "newton", 0.15)
    assert (event.residual, event.error) == (0.0, 1e-16)
    assert event.details == {"index": 0, "asked": 0.15}
    assert missed == []
    assert test.guesses == 1


def test_the_arclength_of_an_event_lies_between_its_points():
    arc = step_of_line()
    (event,), _ = events_on(arc, Passage(0.15))
    middle = 0.5 * (arc.left.arclength + arc.right.arclength)
    assert event.point.arclength == pytest.approx(middle, abs=1e-15)


@pytest.mark.parametrize(
    "test",
    [
        Passage(0.15, offset=0.06),  # beyond the right end
        Passage(0.15, offset=-0.06),  # before the left end
        Passage(0.15, error=1e-6),  # converged, but badly conditioned
        Passage(0.15, error=math.nan),
    ],
)
def test_where_newton_leaves_the_step_the_bracket_decides(test):
    (event,), missed = events_on(step_of_line(), test)
    assert event.method == "bracket"
    assert event.parameter == pytest.approx(0.15, abs=1e-15)
    assert event.details == {"index": 0, "bracketed": True}
    assert missed == []


@pytest.mark.parametrize(("target", "left"), [(0.1, True), (0.2, False)])
def test_newton_may_land_exactly_on_an_end(target, left):
    """On the left end the function leaves its zero, on the right end it arrives there."""
    test = Passage(target)
    arc = step_of_line()
    values = [-1.0, 1.0] if not left else [1.0, -1.0]
    left, right = (Sample.of(s, [np.array([v])]) for s, v in zip((0.0, 1.0), values, strict=True))
    events, missed = find_events([test], arc, Stretch(left, right))
    assert [event.parameter for event in events] == [target]
    assert missed == []


def test_a_zero_that_is_turned_down_is_neither_an_event_nor_missed():
    assert events_on(step_of_line(), Passage(0.15, accepted=False)) == ([], [])


def test_a_bracket_without_points_is_reported():
    """Between both branches of a hyperbola no point is reached, though the sign changes."""
    hyperbola = Curve(lambda x, p: x * x - p * p + 1.0, lambda x, p: [2.0 * x, -2.0 * p])
    left, right = [0.1, -math.sqrt(1.01)], [0.1, math.sqrt(1.01)]
    arc = arc_of(hyperbola, left, right)
    events, (missed,) = events_on(arc, user(lambda p: p.parameter - 0.1))
    assert events == []
    assert missed.reason == "no point of the branch was reached inside the bracket"


# Arcs


@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.5, 0.77, 1.0])
def test_points_at_a_fraction_of_an_arc(fraction):
    turns = (0.3, 0.4)
    arc = arc_of(CIRCLE, *[[math.cos(turn), math.sin(turn)] for turn in turns])
    point = arc.at(fraction)
    assert abs(np.hypot(*point.unknowns) - 1.0) < 1e-12
    # the chord and the cubic through both ends share their ends, not their pace: measured 1.2e-4
    along = arc.fraction(point.unknowns)
    assert along == pytest.approx(fraction, abs=2e-4 if 0.0 < fraction < 1.0 else 1e-14)
    span = arc.right.arclength - arc.left.arclength
    expected = arc.left.arclength + along * span
    assert point.arclength == pytest.approx(expected, abs=1e-14)
    assert arc.holds(point.unknowns)


def test_an_arc_holds_what_is_near_its_chord():
    arc = arc_of(LINE, [0.0, 0.0], [2.0, 1.0])
    inside, beyond = np.array([1.0, 0.5]), np.array([2.02, 1.01])
    aside = inside + 0.6 * np.array([1.0, -2.0])
    assert arc.holds(inside)
    assert not arc.holds(beyond)
    assert not arc.holds(-0.01 * beyond)
    assert not arc.holds(aside)


def test_an_arc_across_a_branch_point_is_connected():
    pitchfork = Curve(lambda x, p: x**3 - p * x, lambda x, p: [3.0 * x * x - p, -x])
    assert arc_of(pitchfork, [0.0, -0.05], [0.0, 0.03]).connected()


@pytest.mark.parametrize("gap", [1e-1, 1e-2, 1e-3, 1e-4])
def test_an_arc_between_two_branches_is_not_connected(gap):
    """Closer than 4e-4 of a step they are taken to cross; here the step is 0.1."""
    pair = Curve(lambda x, p: x * (x - gap), lambda x, p: [2.0 * x - gap, 0.0])
    assert not arc_of(pair, [0.0, 0.0], [gap, 0.1]).connected()


def test_a_dip_between_two_parabolas_that_agree_is_suspected():
    """A determinant with the factor of a doubling, which passes zero twice in the second step."""
    before, left, right, after = (np.array([v]) for v in (0.0557, 0.0210, 0.0049, 0.0924))
    found, places = suspect_values(before, left, right, after, 0.0080, 0.0157, 0.0220)
    assert found.tolist() == [DIPS]
    assert 0.5 < places[0] < 0.9


def velocities(*values: tuple[float, float]) -> list[Sample]:
    """Velocities at an arc's ends and beside it, by their arclengths."""
    return [Sample.of(at, [np.array([value])]) for at, value in values]


@pytest.mark.parametrize(
    ("values", "vanishes"),
    [
        ((0.3003, 0.1, -0.1, -0.3), True),  # it passes zero
        ((0.4, 0.05, 0.05, 0.4), True),  # it may do so twice
        ((-0.4, 0.05, 0.05, -0.4), True),  # the same one, or two of opposite sign
        ((0.30003, 0.30001, -0.30001, -0.30003), False),  # another one has become the smallest
        ((-0.30003, 0.30001, -0.30001, 0.30003), False),
        ((-0.0010, -0.0013, 0.3, 0.30001), True),  # so small before it jumps that it may
        ((-0.1010, -0.1013, 0.3, 0.30001), False),
        ((-0.0010, -0.0011, -0.0012, 0.3), False),  # a jump beyond says nothing of what is here
    ],
)
def test_a_smallest_value_vanishes_if_its_size_does(values, vanishes):
    """Of several velocities the one nearest to zero changes sign without vanishing where it is
    another one's turn."""
    before, left, right, after = velocities(*enumerate(values))
    found = Stretch(left, right, before, after).vanishing(slice(0, 1))
    assert found.tolist() == [vanishes]


def test_a_step_may_hide_what_its_batch_has_found(monkeypatch):
    """Of random test functions, some without values here and there: the search of a batch finds
    before each point what the step there alone does, which is then not asked again."""
    random = np.random.default_rng(5)
    noted = 0
    for _ in range(20):
        steps = np.cumsum(random.uniform(0.1, 1.0, 12))
        values = random.normal(size=(12, 5)).cumsum(axis=0) + random.normal(0.0, 2.0, 5)
        values[random.uniform(size=values.shape) < 0.1] = np.nan
        if random.uniform() < 0.3:
            steps[0] = np.nan  # there is no point before
        samples = Samples(steps, values, [2, 3])
        found = samples.noteworthy()
        for i in range(10):
            around = [samples.at(i + k) for k in (1, 2, 0, 3)]
            alone, places = Stretch(*around).suspects()
            if i not in found:
                assert not alone.any()
                assert not crosses(around[0].flat, around[1].flat).any()
                continue
            noted += 1
            with monkeypatch.context() as patch:
                patch.delattr(sign_changes, "suspect_values")
                known, where = samples.stretch(i, found[i]).suspects()
            assert known.tolist() == alone.tolist()
            assert where[alone > 0].tolist() == places[alone > 0].tolist()
    assert noted > 60
