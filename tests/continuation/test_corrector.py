"""Corrector, tangent and step control on algebraic problems with closed-form answers."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from algebraic import Algebraic
from hypothesis import given, settings
from hypothesis import strategies as st

from contimpact.continuation import corrector
from contimpact.continuation import corrector as metric
from contimpact.continuation import step as step_control
from contimpact.continuation.branch import Point
from contimpact.continuation.corrector import correct
from contimpact.continuation.settings import Settings
from contimpact.continuation.step import step_after
from contimpact.errors import InputError

ROUNDING = 4.0 * np.finfo(float).eps


def circle():
    return Algebraic(lambda x, p: x * x + p * p - 1.0, lambda x, p: [2.0 * x, 2.0 * p])


def parabola():
    return Algebraic(lambda x, p: x * x - p, lambda x, p: [2.0 * x, -1.0])


def line(slope=2.0):
    return Algebraic(lambda x, p: x - slope * p, lambda x, p: [1.0, -slope])


UNIT = np.ones(2)
FIXED = np.array([0.0, 1.0])


# Settings


def test_default_settings_are_accepted_and_frozen():
    numerics = Settings()
    assert numerics.min_step <= numerics.step <= numerics.max_step
    with pytest.raises(dataclasses.FrozenInstanceError):
        numerics.step = 1.0


@pytest.mark.parametrize("name", ["tolerance", "step", "min_step", "max_step", "max_angle"])
@pytest.mark.parametrize("value", [0.0, -0.1, math.inf, math.nan])
def test_lengths_and_tolerances_must_be_positive_numbers(name, value):
    with pytest.raises(InputError, match=r"give a (finite )?number") as refused:
        Settings(**{name: value})
    assert refused.value.where == name


@pytest.mark.parametrize("name", ["max_iterations", "max_points"])
@pytest.mark.parametrize("value", [0, -3, 2.5, 10.0])
def test_counts_must_be_whole_numbers(name, value):
    with pytest.raises(InputError, match="whole number") as refused:
        Settings(**{name: value})
    assert refused.value.where == name


def test_settings_are_refused_as_those_of_a_scene():
    """Their bounds are those that the keys declare."""
    with pytest.raises(InputError, match=r"give a number above 0, at most 0\.001") as refused:
        Settings(tolerance=0.01)
    assert refused.value.where == "tolerance"
    with pytest.raises(InputError, match="a whole number from 1 to 1000"):
        Settings(max_iterations=1001)
    assert Settings(step="1/128").step == 1 / 128


@pytest.mark.parametrize(
    "given",
    [
        {"step": 0.2},
        {"min_step": 0.02},
        {"max_step": 0.001},
        {"min_step": 0.3, "step": 0.2, "max_step": 0.1},
    ],
)
def test_steps_must_be_in_order(given):
    with pytest.raises(InputError, match="in this order"):
        Settings(**given)


@pytest.mark.parametrize("name", ["euler", "", "Tangent"])
def test_unknown_predictors_are_refused(name):
    with pytest.raises(InputError, match="accepted are tangent, secant") as refused:
        Settings(predictor=name)
    assert refused.value.where == "predictor"


def test_equal_steps_are_accepted():
    assert Settings(min_step=0.05, step=0.05, max_step=0.05).step == 0.05


# Metric


def test_lengths_are_measured_by_the_sizes_of_the_unknowns():
    scale = np.array([2.0, 10.0])
    a, b = np.array([6.0, 40.0]), np.array([2.0, -10.0])
    assert metric.inner_product(a, b, scale) == 3.0 * 1.0 + 4.0 * -1.0
    assert metric.length(a, scale) == 5.0


def test_bordering_puts_the_row_last():
    matrix = corrector.border_jacobian(np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), np.arange(3.0))
    assert matrix.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [0.0, 1.0, 2.0]]


# Corrector


def test_a_solution_is_returned_as_it_is():
    problem, guess = circle(), np.array([1.0, 0.0])
    result = correct(problem, guess, FIXED, UNIT, Settings())
    assert np.array_equal(result.evaluation.unknowns, guess)
    assert (result.iterations, result.first_step, problem.evaluations) == (0, 0.0, 1)


@pytest.mark.parametrize("value", np.linspace(-0.9, 0.9, 7))
def test_at_fixed_parameter_the_parameter_does_not_move(value):
    result = correct(circle(), np.array([0.8, value]), FIXED, UNIT, Settings())
    x, parameter = result.evaluation.unknowns
    assert parameter == value
    # a residual below 1e-12 leaves 1e-12/(2 x) in x, and x >= 0.43
    assert abs(x - math.sqrt(1.0 - value**2)) < 1.2e-12


@pytest.mark.parametrize("turn", np.linspace(0.0, 2.0 * np.pi, 9))
def test_correction_stays_on_the_plane_of_the_predictor(turn):
    """From a tangent step of h on the unit circle the corrected point is at the angle arcsin h."""
    h = 0.1
    radius, tangent = (
        np.array([np.cos(turn), np.sin(turn)]),
        np.array([-np.sin(turn), np.cos(turn)]),
    )
    guess = radius + h * tangent
    result = correct(circle(), guess, tangent, UNIT, Settings())
    expected = math.sqrt(1.0 - h * h) * radius + h * tangent
    assert np.max(np.abs(result.evaluation.unknowns - expected)) < 1e-12
    assert abs(tangent @ (result.evaluation.unknowns - guess)) < ROUNDING
    assert result.iterations <= 3  # 5e-3, 1e-5, 1e-10, below rounding: quadratic convergence


def test_a_linear_problem_takes_one_iteration_and_reports_its_step():
    scale = np.array([2.0, 10.0])
    result = correct(line(), np.array([5.0, 1.0]), FIXED, scale, Settings())
    assert result.evaluation.unknowns.tolist() == [2.0, 1.0]
    assert (result.iterations, result.first_step) == (1, 1.5)


@pytest.mark.parametrize("factor", [1e-12, -1.0, 3.0, 1e12])
def test_the_length_of_the_row_does_not_matter(factor):
    row, guess = np.array([0.3, 0.8]), np.array([0.6, 0.7])
    one = correct(circle(), guess, row, UNIT, Settings()).evaluation.unknowns
    other = correct(circle(), guess, factor * row, UNIT, Settings()).evaluation.unknowns
    assert np.max(np.abs(one - other)) < 1e-12


def test_a_fold_is_regular_for_the_tangent_row_and_singular_at_fixed_parameter():
    guess = np.array([0.0, 0.1])
    along = correct(parabola(), guess, np.array([1.0, 0.0]), UNIT, Settings())
    assert along.evaluation.unknowns.tolist() == [0.0, 0.0]
    fixed = correct(parabola(), guess, FIXED, UNIT, Settings())
    assert fixed.evaluation is None
    assert fixed.reason == "the bordered matrix is singular"


def test_a_residual_at_the_rounding_of_large_unknowns_is_accepted():
    """x^2 = 2e12 cannot have a residual below 1e-12; the corrector stops at the rounding of x."""
    scale = np.array([1e6, 2e12])
    result = correct(parabola(), np.array([1.5e6, 2e12]), FIXED, scale, Settings())
    x = result.evaluation.unknowns[0]
    assert abs(x / (1e6 * math.sqrt(2.0)) - 1.0) < ROUNDING


def test_several_equations():
    """The unit sphere cut by x = y: from (1, 1, 0.5) at fixed parameter to x = y = sqrt(3/8)."""
    sphere = Algebraic(
        lambda x, y, p: [x * x + y * y + p * p - 1.0, x - y],
        lambda x, y, p: [[2.0 * x, 2.0 * y, 2.0 * p], [1.0, -1.0, 0.0]],
    )
    result = correct(
        sphere, np.array([1.0, 0.7, 0.5]), np.array([0.0, 0.0, 1.0]), np.ones(3), Settings()
    )
    expected = [math.sqrt(0.375), math.sqrt(0.375), 0.5]
    assert result.evaluation.unknowns == pytest.approx(expected, rel=1e-12)


# Corrections that fail are values


def test_divergence():
    """Newton's iteration on the cube root maps x to -2x: every step is twice the one before."""
    root = Algebraic(lambda x, p: np.cbrt(x), lambda x, p: [abs(np.cbrt(x)) ** -2 / 3.0, 0.0])
    result = correct(root, np.array([1.0, 0.0]), FIXED, UNIT, Settings())
    assert result.evaluation is None
    assert result.reason == "Newton's iteration diverges"


@pytest.mark.parametrize("limit", [1, 2, 3])
def test_too_few_iterations(limit):
    result = correct(circle(), np.array([2.0, 0.0]), FIXED, UNIT, Settings(max_iterations=limit))
    assert result.evaluation is None
    assert result.iterations == limit
    assert result.reason == f"no convergence in {limit} iterations"


def test_the_last_allowed_iteration_counts():
    """A linear problem is solved by the first iteration, which must not be thrown away."""
    result = correct(line(), np.array([5.0, 1.0]), FIXED, UNIT, Settings(max_iterations=1))
    assert result.evaluation is not None


@pytest.mark.parametrize(
    ("function", "reason"),
    [
        (lambda x, p: math.sqrt(p - 1.0), "the equations have no value: math domain error"),
        (lambda x, p: 1.0 / p, "the equations have no value: float division by zero"),
        (lambda x, p: math.exp(1e4 + p), "the equations have no value: math range error"),
        (lambda x, p: math.nan, "the residual is not finite"),
        (lambda x, p: math.inf, "the residual is not finite"),
    ],
)
def test_equations_without_a_value(function, reason):
    problem = Algebraic(function, lambda x, p: [1.0, 1.0])
    result = correct(problem, np.zeros(2), FIXED, UNIT, Settings())
    assert result.evaluation is None
    assert result.iterations == 0
    assert result.reason == reason


# Tangents


@pytest.mark.parametrize("turn", np.linspace(0.1, 6.0, 7))
def test_first_tangent_is_the_unit_null_vector_of_the_metric(turn):
    scale = np.array([3.0, 0.2])
    jacobian = np.array([[np.cos(turn), np.sin(turn)]])
    tangent = corrector.first_tangent(None, jacobian, scale)
    assert abs(jacobian @ tangent) < ROUNDING
    assert metric.length(tangent, scale) == pytest.approx(1.0, rel=ROUNDING)


@pytest.mark.parametrize(
    "jacobian", [np.zeros((1, 2)), np.array([[1.0, 2.0, 3.0], [2.0, 4.0, 6.0]])]
)
def test_two_directions_have_no_first_tangent(jacobian):
    assert corrector.first_tangent(None, jacobian, np.ones(jacobian.shape[1])) is None


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_next_tangent_keeps_the_direction(sign):
    scale = np.array([2.0, 0.5])
    jacobian = np.array([[2.0 * 0.6, 2.0 * 0.8]])
    previous = sign * np.array([-0.7, 0.7])
    tangent = corrector.next_tangent(jacobian, previous / scale**2, scale)
    expected = sign * np.array([-0.8, 0.6])
    expected /= np.linalg.norm(expected / scale)
    assert tangent == pytest.approx(expected, rel=ROUNDING)


def test_next_tangent_is_undefined_where_the_bordered_matrix_is_singular():
    assert corrector.next_tangent(np.array([[1.0, 0.0]]), np.array([1.0, 0.0]), UNIT) is None


def test_point_after_measures_the_chord_and_the_orientation():
    """Around the circle the tangent turns with the gradient, so the orientation keeps its sign."""
    start = circle().evaluate(np.array([1.0, 0.0]))
    point = Point(start, np.array([0.0, 1.0]), -1.0, 2.0, 0)
    for turn in np.arange(0.1, 6.4, 0.1):
        evaluation = circle().evaluate(np.array([np.cos(turn), np.sin(turn)]))
        new = corrector.point_after(point, evaluation, 3, UNIT)
        assert new.arclength - point.arclength == pytest.approx(2.0 * math.sin(0.05), rel=1e-13)
        assert new.tangent == pytest.approx([-np.sin(turn), np.cos(turn)], abs=ROUNDING)
        assert new.orientation == pytest.approx(1.0, rel=ROUNDING)
        assert new.iterations == 3
        point = new


def test_point_after_takes_a_given_length_and_may_fail():
    start = Point(line().evaluate(np.zeros(2)), np.array([2.0, 1.0]) / 5**0.5, 1.0, 1.0, 0)
    end = line().evaluate(np.array([2.0, 1.0]))
    assert corrector.point_after(start, end, 1, UNIT, travelled=0.25).arclength == 1.25
    across = dataclasses.replace(start, tangent=np.array([1.0, -2.0]))
    assert corrector.point_after(across, end, 1, UNIT) is None


# Scaled determinant


def square_matrices():
    entry = st.floats(-10.0, 10.0)
    return st.integers(1, 4).flatmap(
        lambda n: st.lists(entry, min_size=n * n, max_size=n * n).map(
            lambda values: np.array(values).reshape(n, n)
        )
    )


@settings(deadline=None, derandomize=True)
@given(square_matrices())
def test_scaled_determinant_is_bounded(matrix):
    assert abs(corrector.scaled_determinant(matrix)) <= 1.0 + 1e-12  # Hadamard's inequality


def test_scaled_determinant_does_not_depend_on_the_size_of_the_rows():
    matrix = np.array([[3.0, 4.0], [-4.0, 3.0]])
    for sizes in ([1.0, 1.0], [1e-150, 1e140], [1e120, 1e150]):
        scaled = corrector.scaled_determinant(matrix * np.array(sizes)[:, None])
        assert scaled == pytest.approx(1.0, rel=ROUNDING)
    assert corrector.scaled_determinant(matrix[::-1]) == pytest.approx(-1.0, rel=ROUNDING)


def test_scaled_determinant_of_singular_matrices():
    assert corrector.scaled_determinant(np.array([[1.0, 2.0], [0.0, 0.0]])) == 0.0
    assert abs(corrector.scaled_determinant(np.array([[1.0, 2.0], [2.0, 4.0]]))) < ROUNDING


def test_scaled_determinant_of_a_nearly_singular_matrix_keeps_its_sign():
    for size in (1e-3, 1e-100, 1e-250):
        matrix = np.array([[1.0, 0.0], [1.0, size]])
        expected = size / math.hypot(1.0, size)
        assert corrector.scaled_determinant(matrix) == pytest.approx(expected, rel=1e-12)
        assert corrector.scaled_determinant(matrix * [[1.0], [-1.0]]) < 0.0


# Angles and steps


@pytest.mark.parametrize("turn", [1e-12, 1e-8, 1e-4, 0.1, 1.0, 3.0, math.pi])
def test_angles_are_accurate_also_when_small(turn):
    a, b = np.array([1.0, 0.0]), np.array([math.cos(turn), math.sin(turn)])
    # arcsin loses accuracy towards a half turn: 1 - x is known to eps, its root to 1e-8
    assert metric.angle(a, b, UNIT) == pytest.approx(turn, rel=1e-14 if turn < 2.0 else 3e-8)


def test_the_step_is_kept_where_both_targets_are_met():
    numerics = Settings()
    step = 0.02
    angle = numerics.max_angle
    kept = step_after(
        step, 0.5 * angle, 0.05 * step, 0.05 * angle, angle, 0.1 * angle, numerics.max_step
    )
    assert kept == pytest.approx(step, rel=ROUNDING)


@pytest.mark.parametrize(
    ("turned", "correction", "defect", "factor"),
    [
        (0.0, 0.0, 0.0, 2.0),  # nothing to see: twice as far
        (0.05, 0.0, 0.0, 2.0),  # a quarter of the largest angle
        (0.1, 0.0, 0.0, 1.0),
        (0.16, 0.0, 0.0, 0.625),
        (0.2, 0.0, 0.0, 0.5),
        (3.0, 0.0, 0.0, 0.5),  # never less than half
        (0.0, 0.05, 0.0, 1.0),  # a correction grows with the square of the step
        (0.0, 0.2, 0.0, 0.5),
        (0.0, 0.1125, 0.0, 1.0 / 1.5),
        (0.0, 0.0, 0.01, 1.0),  # half of a tenth of the largest angle
        (0.0, 0.0, 0.0225, 1.0 / 1.5),  # a defect too
        (0.1, 0.2, 0.01, 0.5),  # the worst of them decides
    ],
)
def test_the_step_follows_angle_correction_and_defect(turned, correction, defect, factor):
    step = 0.01
    new = step_after(step, turned, correction * step, defect, 0.2, 0.02, 0.1)
    assert new == pytest.approx(factor * step, rel=1e-14)


@settings(deadline=None, derandomize=True)
@given(st.floats(1e-7, 0.1), st.floats(0.0, 0.2), st.floats(0.0, 1.0))
def test_the_step_changes_by_two_at_most_and_respects_its_ceiling(step, turned, correction):
    new = step_after(step, turned, correction, 0.0, 0.2, 0.02, 0.1)
    assert 0.5 * step <= new <= min(2.0 * step, 0.1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("last", [-1e-16, 0.0, 1e-16])
def test_a_null_vector_has_one_sign_however_it_is_rounded(sign, last):
    """Of components that are equal by symmetry the first decides."""
    vector = np.array([0.3, -0.5, 0.5 + last, -0.5 - last, last])
    assert corrector.orient_vector(sign * vector) == pytest.approx(-vector)


@settings(deadline=None, derandomize=True)
@given(st.floats(1e-7, 0.1), st.floats(-1e-13, 1e-13))
def test_the_length_of_a_step_forgets_how_it_was_rounded(step, noise):
    kept = step_control.round_length(step, 1.0)
    assert kept == pytest.approx(step, rel=2.0**-6)
    assert (64.0 * math.frexp(kept)[0]).is_integer()
    assert step_control.round_length(kept * (1.0 + noise), 1.0) == kept
    assert step_control.round_length(step, 0.5 * step) == 0.5 * step
