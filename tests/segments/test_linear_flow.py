"""Linear flights against exponentials of matrices in many digits."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
import sympy
from zoo import TwoMasses, two_masses

from contimpact.errors import InputError
from contimpact.models.linear import Linear, harmonics_of
from contimpact.models.model import Formulas
from contimpact.segments import linear_flow
from contimpact.segments.bounded import BOUNDED, UNIT, BoundedNumber, many_digits
from contimpact.segments.kernel import flat
from contimpact.segments.kernels import Kernels
from contimpact.segments.linear_flow import (
    Shape,
    flow,
    flow_of_arrays,
    flow_of_series,
    rounding_scale,
)
from contimpact.segments.segment import evaluate_in
from contimpact.segments.track import Pieces

CTX = mpmath.mp.clone()
CTX.dps = 40


def exact(shape, dt, numbers):
    """The tables by mpmath's exponential, and differences in 90 digits for the directions."""
    with CTX.workdps(90 if shape.directions else 60):
        size, dt = shape.given, CTX.mpf(dt)
        base, *directions = (
            [CTX.mpf(x) for x in numbers[size * i : size * (i + 1)]]
            for i in range(shape.directions + 1)
        )
        generator, mean, end = _motion(shape, base, dt)
        pushed = generator * end
        found = [
            (mean, 0),
            (end, shape.freedom),
            ((pushed - mean) / dt, 0),
            (pushed, shape.freedom),
        ]
        step = CTX.mpf(10) ** -30
        for direction in directions:
            ahead, behind = (
                _motion(shape, [x + s * q for x, q in zip(base, direction, strict=True)], dt)
                for s in (step, -step)
            )
            for i, at in ((1, 0), (2, shape.freedom)):
                found.append(((ahead[i] - behind[i]) / (2 * step), at))
        return np.array(
            [
                [[float(m[at + i, j]) for j in range(shape.size)] for i in range(shape.freedom)]
                for m, at in found
            ]
        )


def _motion(shape, numbers, dt):
    d, n = shape.freedom, shape.size
    generator = CTX.zeros(n)
    for i in range(d):
        generator[i, d + i] = 1
        for j in range(n):
            generator[d + i, j] = numbers[n * i + j]
    for k in range(shape.waves):
        j = 2 * d + 2 * k
        generator[j, j + 1], generator[j + 1, j] = -numbers[d * n + k], numbers[d * n + k]
    end = CTX.expm(generator * dt)
    return generator, (end - CTX.eye(n)) / dt, end


def numbers_of(stiffness, damping, pushes, frequencies):
    rows = zip(-np.array(stiffness), -np.array(damping), np.array(pushes), strict=True)
    return [*(float(x) for row in rows for part in row for x in part), *frequencies]


K = [[1.6, -0.6], [-0.6, 0.6]]
C = [[0.1, 0.0], [0.0, 0.1]]
PUSH = [[1.0, 0.0, 0.0], [0.3, 0.0, 0.2]]
NONE = [[0.0, 0.0], [0.0, 0.0]]

CASES = {
    "two masses": numbers_of(K, C, PUSH, [1.3]),
    "at resonance": numbers_of([[1.69, 0.0], [0.0, 0.5]], NONE, PUSH, [1.3]),
    "free": numbers_of(NONE, NONE, PUSH, [1.3]),
    "stiff": numbers_of([[1e8, -0.6], [-0.6, 0.6]], C, PUSH, [1.3]),
    "overdamped": numbers_of([[1.0, -0.6], [-0.6, 0.6]], [[1e4, 0.0], [0.0, 0.1]], PUSH, [1.3]),
    "large force": numbers_of(K, C, [[1e6, 0.0, 3.0], [0.0, 0.0, 1e-5]], [1.3]),
    "driven apart": numbers_of([[-2.0, 0.0], [0.0, -1.0]], NONE, PUSH, [1.3]),
}
DURATIONS = (1e-12, 1e-6, 1e-3, 0.3, 4.0, 30.0, -2.0)
DIFFERENTIATED = (1e-6, 4.0)


@pytest.mark.parametrize("name", CASES)
@pytest.mark.quick(2)
def test_flows(name):
    """Beside the largest entry of a table; an angle of 1000 has lost three digits to rounding.

    Measured: 8e-16 and 5e-17 for each unit of the angle.
    """
    base = CASES[name]
    numbers = [*base, *np.random.default_rng(1).normal(size=len(base))]
    fastest = max(1.3, np.sqrt(np.max(np.abs(base[:2]))), *np.abs(base[2:4]))
    for dt in DURATIONS:
        if abs(dt) * fastest > 1e5 or (name == "overdamped" and dt < 0.0):
            continue
        shape = Shape(2, 1, int(dt in DIFFERENTIATED))
        found = np.array(flow(*shape, dt, *numbers[: (1 + shape.directions) * shape.given]))
        truth = exact(shape, dt, numbers)
        size = np.max(np.abs(truth), axis=(1, 2), keepdims=True)
        size[3] = max(size[3], fastest)  # accelerations: of a state that is rounded
        error = np.max(np.abs(found.reshape(truth.shape) - truth) / size)
        assert error < 1e-15 * (3.0 + abs(dt) * fastest), dt


def test_a_larger_force_gives_the_same_flight_in_larger_units():
    """A force has no part in how often a flight is doubled: an even power of two changes no digit
    of its response."""
    large, scale = 2.0**300, np.array([1.0, 1.0, 1.0, 1.0, *3 * [2.0**300]])
    numbers = CASES["two masses"]
    larger = numbers_of(K, C, large * np.array(PUSH), [1.3])
    found, other = (np.reshape(flow(2, 1, 0, 4.0, *g), (4, 2, 7)) for g in (numbers, larger))
    assert (found * scale).tolist() == other.tolist()
    gains = [Pieces(Shape(2, 1, 0), given, 4.0).gains[0] for given in (numbers, larger)]
    assert (gains[0][:4] * scale).tolist() == gains[1][:4].tolist()


def test_coordinates_coupled_one_way_have_units_of_their_own():
    """In other units of one that only gives and one that only takes no digit changes, and what they
    are rounded beside changes as they do: each is exact to a part of it, and of its own size."""
    pushes = np.array([[0.8, 0.0, 0.0], [0.0, 0.1, 0.0]])
    k, c = np.array([[1.0, 0.0], [-0.5, 2.3]]), np.array([[0.1, 0.0], [-0.3, 0.2]])

    def scaled(units):
        by = units[:, None] / units
        return numbers_of(k * by, c * by, pushes * units[:, None], [1.3])

    units = np.array([2.0**-10, 2.0**20])
    given, other = scaled(np.array([2.0**-10, 2.0**10])), scaled(np.array([2.0**-20, 2.0**30]))
    shape = Shape(2, 1, 0)
    tables = [np.array(flow(*shape, 4.0, *numbers)) for numbers in (given, other)]
    beside = [rounding_scale(*shape, *both) for both in zip((given, other), tables, strict=True)]
    back = (units[:, None] / [*units, *units, 1.0, 1.0, 1.0] * np.ones((4, 1, 1))).ravel()
    assert (tables[0] * back).tolist() == tables[1].tolist()
    assert (beside[0] * back).tolist() == beside[1].tolist()
    off = np.abs(tables[1] - exact(shape, 4.0, other).ravel())
    assert np.all(off <= 4.0 * UNIT * beside[1])
    found = tables[1] != 0.0
    assert np.all(beside[1][found] < 300.0 * np.abs(tables[1][found]))


def test_a_flight_that_turns_too_often_is_refused_at_the_model():
    numbers = numbers_of(K, [[1e9, 0.0], [0.0, 0.1]], PUSH, [1.3])
    with pytest.raises(InputError, match="model: a flight whose frequencies or dampings"):
        Pieces(Shape(2, 1, 0), numbers, 4.0)
    with pytest.raises(OverflowError):
        flow(2, 1, 0, 1e10, *numbers)


def test_a_flight_of_no_duration():
    numbers = CASES["two masses"]
    mean, end, _, pushed = np.array(flow(2, 1, 0, 0.0, *numbers)).reshape(4, 2, 7)
    assert mean.tolist() == [[0, 0, 1, 0, 0, 0, 0], [0, 0, 0, 1, 0, 0, 0]]
    assert end.tolist() == mean.tolist()
    assert pushed == pytest.approx(np.reshape(numbers[:-1], (2, 7)), abs=0)


def test_what_was_just_asked_is_not_computed_again(monkeypatch):
    """Ends of a flight are asked for by the kernel of each gap coordinate."""
    numbers = CASES["two masses"]
    first = [flow(2, 1, 0, dt, *numbers) for dt in (0.0, 0.7)]
    monkeypatch.setattr(linear_flow, "_mean_rates", None)
    assert [flow(2, 1, 0, dt, *numbers) for dt in (0.0, 0.7)] == first


def test_arrays_are_rows_of_numbers():
    numbers = CASES["two masses"]
    times = np.array([[0.3, 4.0, 1e-9], [-1.0, 0.0, 2.0]])
    together = flow_of_arrays(2, 1, 0, times, *numbers)
    moving = flow_of_arrays(2, 1, 0, 0.3, *(x * np.array([1.0, 1.1]) for x in numbers))
    assert together.shape == (56, 2, 3)
    assert together[:, 0, 1] == pytest.approx(flow(2, 1, 0, 4.0, *numbers), rel=1e-14, abs=1e-15)
    assert together[:, 1, 1] == pytest.approx(flow(2, 1, 0, 0.0, *numbers), abs=0)
    second = flow(2, 1, 0, 0.3, *(1.1 * x for x in numbers))
    assert moving[:, 1] == pytest.approx(second, rel=1e-14, abs=1e-15)


def test_durations_that_differ_by_rounding_need_one_matrix(monkeypatch):
    numbers, durations = CASES["two masses"], np.array([[0.3, 0.1 + 0.2, 4.0], [0.3, 4.0, 0.0]])
    sizes, solve = [], linear_flow.mean_rates
    monkeypatch.setattr(
        linear_flow, "mean_rates", lambda g, dt, *how: sizes.append(dt.size) or solve(g, dt, *how)
    )
    found = linear_flow.flow_of_states(2, 1, 0, durations, *numbers)
    assert sizes == [3]
    for i, j in np.ndindex(durations.shape):
        expected = flow(2, 1, 0, durations[i, j], *numbers)
        assert found[:, i, j] == pytest.approx(expected, rel=1e-12, abs=1e-13)


def test_series_are_taylor_coefficients():
    numbers = CASES["two masses"]
    q = np.random.default_rng(2).normal(size=len(numbers) + 1).tolist()
    inside = many_digits(CTX).names["flow"]

    def along(e):
        moved = [CTX.mpf(x) + e * y for x, y in zip([0.7, *numbers], q, strict=True)]
        return np.array(inside(2, 1, 0, *moved))

    given = [[x, y, 0.0] for x, y in zip([0.7, *numbers], q, strict=True)]
    found = np.array(flow_of_series(2, 1, 0, given))
    e = CTX.mpf(10) ** -12
    ahead, here, behind = along(e), along(CTX.zero), along(-e)
    for k, truth in enumerate(
        (here, (ahead - behind) / (2 * e), (ahead - 2 * here + behind) / (2 * e * e))
    ):
        assert found[:, k] == pytest.approx(truth.astype(float), rel=1e-13, abs=1e-13)


@pytest.mark.parametrize("name", CASES)
def test_bounds_of_errors_hold(name):
    numbers = CASES[name]
    for dt in (1e-6, 0.3, 4.0):
        found = BOUNDED.names["flow"](2, 1, 0, BoundedNumber(dt), *numbers)
        truth = exact(Shape(2, 1, 0), dt, numbers).ravel()
        assert all(
            abs(x.value - y) <= x.error + 1e-16 * abs(y) for x, y in zip(found, truth, strict=True)
        )


class LinearMasses(TwoMasses):
    """The two masses of the zoo, by their matrices."""

    SYSTEM = "two-linear-masses"

    def formulas(self, symbols):
        a, omega, c, k1, k2, sigma, r = symbols.values()
        motion = Linear(
            mass=[[1, 0], [0, 1]],
            damping=[[c, 0], [0, c]],
            stiffness=[[k1 + k2, -k2], [-k2, k2]],
            force=lambda t: [a * sympy.cos(omega * t), 0],
            period=2 * sympy.pi / omega,
        )
        return Formulas(
            period=motion.period,
            walls={"A": sigma},
            reset=lambda wall, x, v: [-r * v[0], v[1]],
            flight=motion.flight,
            acceleration=motion.acceleration,
        )


@pytest.mark.full
def test_kernels_are_those_of_the_closed_form():
    """Residual, all derivatives up to the third, by modal superposition and by the matrices."""
    closed = two_masses()
    linear = LinearMasses(**closed.values)
    rng = np.random.default_rng(0)
    for parameter in ("omega", "r"):
        one, other = Kernels(closed, parameter), Kernels(linear, parameter)
        ends = rng.normal(size=8).tolist()
        ends[4] = ends[0] + 3.0
        q, p = rng.normal(size=9).tolist(), list(closed.values.values())
        for found, truth in (
            (other.flight("A", "A")(*ends, *p), one.flight("A", "A")(*ends, *p)),
            (other.motion("A")(*ends[:5], *p), one.motion("A")(*ends[:5], *p)),
            (other.second("A", "A")(*ends, *q, *p), one.second("A", "A")(*ends, *q, *p)),
            (other.third("A", "A")(*ends, *q[:8], *p), one.third("A", "A")(*ends, *q[:8], *p)),
        ):
            assert flat(found) == pytest.approx(flat(truth), rel=2e-14, abs=1e-12)


@pytest.mark.full
def test_kernels_in_many_digits_are_those_of_floats():
    linear = LinearMasses(**two_masses().values)
    kernel = Kernels(linear, "omega").flight("A", "A")
    given = [0.2, 0.7, 0.1, -0.4, 3.1, 0.6, 0.3, 0.2, *linear.values.values()]
    exact = evaluate_in(kernel, many_digits(CTX))(*map(CTX.mpf, given))
    assert flat(kernel(*given)) == pytest.approx([float(x) for x in flat(exact)], abs=1e-14)


T = sympy.Symbol("t", real=True)


def test_forces_are_expanded_into_harmonics():
    h, w = sympy.symbols("h w", real=True)
    found = harmonics_of(h * sympy.cos(w * T) ** 2 + sympy.sin(w * T - h), T, 2 * sympy.pi / w, "f")
    assert found[0][0] == h / 2
    assert found[2] == (h / 2, 0)
    assert found[1] == (-sympy.sin(h), sympy.cos(h))


@pytest.mark.parametrize(
    ("force", "said"),
    [
        (sympy.cos(T / 2), "does not have the period"),
        (sympy.exp(sympy.cos(T)), "found"),
        (T, "found"),
    ],
)
def test_other_forces_are_refused(force, said):
    with pytest.raises(InputError, match=said):
        harmonics_of(force, T, 2 * sympy.pi, "force")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"mass": [[1, 0], [0, 0]]}, "mass: the matrix is singular"),
        ({"mass": [[1, 1], [1, 1]]}, "mass: the matrix is singular"),
        ({"damping": [[1]]}, "damping: found rows"),
        ({"force": lambda t: [0]}, r"force: found \[0\]; give a list with one"),
    ],
)
def test_other_matrices_are_refused(changes, said):
    given = {"mass": [[1, 0], [0, 1]], "damping": NONE, "stiffness": K, "force": lambda t: [0, 0]}
    with pytest.raises(InputError, match=said):
        Linear(**given | changes, period=1)


@pytest.mark.parametrize("numbers", [(1.0, 0.0, 0.0), (1e200, 0.0, 0.0)])
def test_of_many_flights_those_beyond_the_range_of_floats_have_no_value(numbers):
    """Motion grows as exp(sqrt(k) t): the others keep theirs."""
    times = np.array([0.1, 2000.0, 1e300]) / numbers[0] ** 0.5
    with np.errstate(all="ignore"):
        found = flow_of_arrays(1, 0, 0, times, *numbers)
    alone = np.array(flow(1, 0, 0, float(times[0]), *numbers))
    np.testing.assert_allclose(found[:, 0], alone, rtol=1e-12)
    assert not np.isfinite(found[:, 1]).any(axis=0)
    assert np.isnan(found[:, 2]).all()


def test_of_many_flights_without_units_none_has_a_value():
    found = flow_of_arrays(1, 0, 0, np.array([0.1, 0.2]), math.inf, 0.0, 0.0)
    assert found.shape == (12, 2)
    assert np.isnan(found).all()
