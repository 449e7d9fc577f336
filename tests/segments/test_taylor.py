"""Integrated flights in plain text, against many digits, closed forms and the tracks of heyoka."""

from __future__ import annotations

import importlib.util
import itertools
import math

import mpmath
import numpy as np
import pytest

from contimpact.segments import compiling, integrated_flight, taylor
from contimpact.segments.bounded import many_digits
from contimpact.segments.integrated_flight import (
    flown,
    flown_of_arrays,
    flown_of_series,
    flown_of_states,
    rounding_scale,
)
from contimpact.segments.integration import SOME_STEPS, integrator, statement, text_of
from contimpact.segments.machine_code import Program
from contimpact.segments.oscillation import (
    DEGREE,
    MOST,
    ROW,
    FollowedFlight,
    motion_in_step,
    motion_of_gap,
)
from contimpact.segments.taylor import flight_by_series, path_by_series, polynomials_of, run_flights
from contimpact.segments.track import IntegratedTrack

pytest.importorskip(
    "heyoka", reason="flights are integrated by heyoka: pip install contimpact[ode]"
)
needs_llvmlite = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="the extra 'fast' is not installed"
)

CTX = mpmath.mp.clone()
CTX.dps = 34

DUFFING = "a w: a*cos(w*t) - 0.1*v0 - x0**3"
CHAIN = "a w: -x0**3 - 0.2*(x0 - x1) + a*cos(w*t); -w*x1 + 0.2*(x0 - x1) - sin(a)*v1*ratio(1, 3)"
PLANE = text_of(
    ["a", "w"],
    ["v0 - x0**2*v0 - v1 - a*w*sin(w*t)", "0.08*v0 - 0.064*v1"],
    ["x0 - x0**3/3 - x1 + a*cos(w*t)", "0.08*x0 - 0.064*x1"],
)
"""FitzHugh and Nagumo's neuron, of first order; velocities may start off the rates."""
MIXED = text_of(
    ["a", "w"],
    [
        "-a*v0 + cos(x1)*v1 + 0.2*w*v1*(x0 - a*v1 - sin(x1) + cos(w*t))",
        "x0 - a*v1 - sin(x1) + cos(w*t)",
    ],
    ["-a*x0 + sin(x1) + 0.1*w*v1**2", ""],
)
"""The first coordinate is of first order, the second of second order."""
FIELDS = [
    DUFFING,
    CHAIN,
    PLANE,
    MIXED,
    "a w: -tanh(x0/a)*w - tan(0.3*sin(x0)) + 0.3*cos(w*t + 1)",
    "a w: -sinh(x0)*w - cosh(a*v0)*0.1",
    "a w: -asin(x0/4)*w - acos(0.2*sin(a*t))*0.1 - atan(v0*a)",
    "a w: -exp(-x0**2/a)*x0 - log(2 + w*sin(v0)**2)",
    "a w: -w*x0*sqrt(1 + x0**2) - 1/(a + x0**2) + x0/(3 + cos(t))",
    "a w: -w*x0*(1 + x0**2)**1.5 - (a + v0**2)**(-2) + power(2 + x0**2, w) - exp(w)*t*x0/10",
    "a w: -square(x0)*x0 - cube(v0)*0.1 + tan(a) + t*t*0.01 + sqrt(w) + atan(a) + pi",
    "a w: -exp(-t/4)*x0/(4 + t) + log(4 + a*t)*w*0.1 - sqrt(4 + t)*v0*0.1 - t*t*t*0.001",
    "a w: -a",
]
HIDING = "a w: cos(1.2*t) - a*x0 - 300*(x0 + w)*exp(-100*square(x0 + w)) - 0.1*tanh(200*v0)"
"""A field with forces that are below rounding where steps begin."""


def directions_of(field):
    return " ".join(statement(field).names)


def numbers_for(field, dt, seed):
    rng, stated = np.random.default_rng(seed), statement(field)
    state = rng.uniform(-1.0, 1.0, 1 + 2 * stated.freedom)
    return [dt, *state.tolist(), *rng.uniform(0.6, 1.4, len(stated.parameters)).tolist()]


def blank(function):
    """Scratch space in which nothing is known, as after a flight that does not stay finite."""
    return np.full(function.space, np.nan)


def flown_by(function, numbers, most=SOME_STEPS):
    return function.function(*numbers, blank(function), most, 1.0)


def flown_plainly(field, directions, numbers):
    found = flight_by_series(field, directions)
    with np.errstate(over="ignore", invalid="ignore"):
        return np.array(flown_by(found, numbers))


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("dt", [5.0, 0.0, 1e-9, 0.7, -1.5])
@pytest.mark.quick(6)
def test_flights_and_derivatives_are_those_in_many_digits(field, dt):
    directions, numbers = directions_of(field), numbers_for(field, dt, 7)
    exact = many_digits(CTX).names["flown"](field, directions, *numbers)
    found = flown_plainly(field, directions, numbers)
    size = max(1.0, max(abs(float(x)) for x in exact))
    assert max(abs(float(x - y)) for x, y in zip(exact, found, strict=True)) < 2e-14 * size


@pytest.mark.full
def test_forces_that_steps_could_miss_are_met():
    """Such forces make many steps of few, and are rounded by more."""
    directions, numbers = directions_of(HIDING), [4.0, 0.3, 0.6, -4.5, 1.0, 1.0]
    exact = many_digits(CTX).names["flown"](HIDING, directions, *numbers)
    exact = np.array([float(x) for x in exact])
    for found in (flown_plainly(HIDING, directions, numbers), flown(HIDING, directions, *numbers)):
        assert np.max(abs(found - exact)) < 1e-12 * np.max(abs(exact))


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.quick(4)
def test_second_derivatives_are_those_in_many_digits(field):
    directions, numbers = directions_of(field), numbers_for(field, 2.0, 5)
    slopes = np.random.default_rng(6).uniform(-1.0, 1.0, len(numbers)).tolist()
    rows = [list(row) for row in zip(numbers, slopes, strict=True)]
    exact = many_digits(CTX).names["flown_of_series"](field, directions, rows)
    exact = np.array([[float(c) for c in row] for row in exact])
    function = flight_by_series(field, directions, along=True)
    found = flown_by(function, [*numbers, *slopes])
    size = max(1.0, np.max(abs(exact)))
    assert np.max(abs(np.reshape(found, (2, -1)).T - exact)) < 2e-14 * size


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.quick(2)
def test_third_derivatives_are_those_in_many_digits(field):
    numbers = np.array(numbers_for(field, 2.0, 5))
    rows = [numbers, *np.random.default_rng(6).uniform(-1.0, 1.0, (3, len(numbers)))]
    exact = many_digits(CTX).names["flown_of_series"](field, "", np.transpose(rows).tolist())
    exact = np.array([[float(c) * math.factorial(k) for k, c in enumerate(row)] for row in exact])
    given = [math.factorial(k) * row for k, row in enumerate(rows)]
    found = flown_by(flight_by_series(field, "", along=3), np.concatenate(given).tolist())
    size = max(1.0, np.max(abs(exact)))
    assert np.max(abs(np.reshape(found, (4, -1)).T - exact)) < 1e-13 * size


@needs_llvmlite
@pytest.mark.parametrize("field", [DUFFING, CHAIN])
def test_steps_of_a_flight_are_counted_and_as_short_as_they_have_to_be(
    field, kernel_cache, monkeypatch
):
    """By ever shorter steps: as many as their lengths say, and results differ by rounding."""
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    numbers = numbers_for(field, 2.0, 3)
    for longest in (1.0, 0.03, 0.003):
        limits = np.array([longest, 0.0, 0.0])
        (found,) = run_flights(field, "v0", np.array([numbers]), limits=limits)
        steps = len(integrator(field).dense(numbers)[0]) - 1
        assert limits[1] >= max(steps, math.ceil(1.0 / longest))
        assert limits[1] <= math.ceil(1.0 / longest) + 2 * steps
        assert limits[2] == limits[1]
        assert found == pytest.approx(flown(field, "v0", *numbers), rel=1e-13, abs=1e-14)


@needs_llvmlite
def test_the_rounding_of_a_flight_of_very_many_steps_is_by_heyoka(kernel_cache, monkeypatch):
    """Where compiled code has no result, what it leaves is no number of steps."""
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    field, directions, numbers = "a: -a*x0", "v0", [40.0, 0.0, 1.0, 1.0, 1.0]
    found = np.array(integrator(field, (directions,))(numbers))
    usual = rounding_scale(field, directions, numbers, found)
    monkeypatch.setattr(taylor, "SOME_STEPS", 5)
    monkeypatch.setattr(taylor, "MOST_STEPS", 5)
    monkeypatch.setattr(taylor, "FLOWN", "flown in five steps")
    assert np.isnan(run_flights(field, directions, np.array([numbers]))).all()
    assert rounding_scale(field, directions, numbers, found) == pytest.approx(usual, rel=20.0)


@needs_llvmlite
def test_series_by_compiled_code_are_heyokas(kernel_cache, monkeypatch):
    field = text_of(["p_a", "p_w"], ["p_a*cos(p_w*t) - sin(x0)"])
    rows = [[x, 0.3 - 0.1 * i] for i, x in enumerate([2.0, 0.1, 0.4, -0.2, 0.9, 1.1])]
    found = []
    for mode in ("never", "always"):
        monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
        found.append(np.array(flown_of_series(field, "dt x0 v0 p_w", rows)))
    assert found[1] == pytest.approx(found[0], rel=1e-13, abs=1e-14)
    assert not np.array_equal(found[0], found[1])  # another code
    with pytest.raises(OverflowError, match="finite"):
        flown_of_series("a: x0**2 + a", "dt", [[x, 0.0] for x in (3.0, 0.0, 1.0, 1.0, 1.0)])


@needs_llvmlite
def test_flights_that_are_compared_with_the_force_are_heyokas_by_compiled_code(
    kernel_cache, monkeypatch
):
    """Alone and of arrays; where compiled code has no result, they are heyoka's."""
    field, directions, given = "a: -a*tanh(30*x0)", "v0 a", [2.0, 0.3, 0.6, -1.5, 1.0]
    rows = np.array(given) + np.random.default_rng(2).normal(scale=0.1, size=(5, len(given)))
    rows[1, 0] = np.nan
    found = []
    for mode, most in [("never", SOME_STEPS), ("always", SOME_STEPS), ("always", 2)]:
        monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
        monkeypatch.setattr(taylor, "SOME_STEPS", most)
        if most == 2:
            monkeypatch.setattr(taylor, "MOST_STEPS", most)
            compiling._LOADED.clear()
            monkeypatch.setattr(taylor, "FLOWN", "flown in two steps")
        integrated_flight._flown.cache_clear()
        alone = flown(field, directions, *given)
        many = flown_of_arrays(field, directions, *rows.T)
        found.append(np.hstack([np.array(alone)[:, None], many]))
    plainly, compiled, left = found
    assert np.isnan(plainly[0, 2])
    assert compiled == pytest.approx(plainly, rel=1e-12, abs=1e-13, nan_ok=True)
    assert not np.array_equal(compiled, plainly, equal_nan=True)
    assert np.array_equal(left, plainly, equal_nan=True)


@needs_llvmlite
@pytest.mark.parametrize("field", FIELDS)
def test_polynomials_of_flights_are_heyokas_by_compiled_code(field, kernel_cache, monkeypatch):
    """Where these have too many steps, they are heyoka's themselves."""
    numbers = numbers_for(field, 2.5, 3)
    theirs = integrator(field).dense(numbers)
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    times, *series = polynomials_of(field, numbers)
    assert times == pytest.approx(theirs[0], abs=1e-13)
    assert times[0] == 0.0 < 1.0 == times[-1]
    for own, others in zip(series, theirs[1:], strict=True):
        assert own == pytest.approx(others, abs=1e-13)
    assert field == FIELDS[-1] or not np.array_equal(series[1], theirs[2])  # another code
    monkeypatch.setattr(taylor, "ROWS", 1)
    assert all(map(np.array_equal, polynomials_of(field, numbers), theirs))


@needs_llvmlite
@pytest.mark.parametrize("field", ["a: -a*tanh(30*x0)", DUFFING])
@pytest.mark.parametrize("mode", ["never", "always"])
def test_flights_of_searches_have_nine_digits_and_no_derivatives_by_parameters(
    field, mode, kernel_cache, monkeypatch
):
    monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
    count = len(statement(field).parameters)
    given = np.array([2.0, 0.3, 0.6, -1.5, *[1.0] * count])
    rows = given + np.random.default_rng(2).normal(scale=0.1, size=(100, len(given)))
    rows[1, 0] = np.nan
    exact = flown_of_arrays(field, "v0 a", *rows.T)
    found = flown_of_states(field, "v0 a", *rows.T)
    size = np.nanmax(np.abs(exact[:4]))
    assert np.isnan(found[0]).tolist() == [k == 1 for k in range(100)]
    assert 0.0 < np.nanmax(np.abs(found[:4] - exact[:4])) < 1e-9 * size
    assert not found[4:].any()


@pytest.mark.parametrize("dt", [60.0, -30.0])
@pytest.mark.quick(1)
def test_long_flights_differ_from_heyokas_by_what_rounding_grows_to(dt):
    directions, numbers = "dt x0 v0", numbers_for(DUFFING, dt, 3)
    exact = many_digits(CTX).names["flown"](DUFFING, directions, *numbers)
    exact = np.array([float(x) for x in exact])
    theirs = np.array(integrator(DUFFING, ("dt", "x0", "v0"))(numbers))
    found = flown_plainly(DUFFING, directions, numbers)
    assert np.max(abs(found - exact)) < 4.0 * np.max(abs(theirs - exact)) + 1e-15


def test_a_stiff_flight_is_that_of_the_closed_form():
    c, dt = 1e4, 1.0
    mean, end, by_mean, by_end = flown_plainly("c: -c*v0", "v0", [dt, 0.0, 0.3, 2.0, c])
    mean_rate = -math.expm1(-c * dt) / (c * dt)
    assert (mean, by_mean) == pytest.approx((2.0 * mean_rate, mean_rate), rel=1e-12)
    assert abs(end) < 1e-13 > abs(by_end)


def test_flights_that_do_not_stay_finite_or_take_too_many_steps_are_no_number():
    assert all(np.isnan(flown_plainly("a: x0**2 + a", "dt", [3.0, 0.0, 1.0, 1.0, 1.0])))
    given = [40.0, 0.0, 1.0, 1.0, 1.0]
    assert all(np.isnan(flown_by(flight_by_series("a: -a*x0", ""), given, most=5)))


def test_what_is_known_already_is_not_integrated():
    """Derivatives by the duration take two numbers of each order; those by nothing, none."""
    alone, more, nothing = (
        flight_by_series("a: -x0**3", names).space for names in ("v0", "dt v0", "dt t v0 a")
    )
    assert more - alone == 2 * (DEGREE + 1)
    assert nothing == more


def test_what_has_no_series_is_refused():
    with pytest.raises(NotImplementedError, match="abs"):
        flight_by_series("a: -a*abs(x0)", "")


def path_of(field, numbers, weights):
    """The pieces of a flight, for gap coordinates of these weights."""
    found, (count, d) = path_by_series(field), np.shape(weights)
    way = FollowedFlight(
        np.zeros((d, ROW)),
        np.zeros((count * MOST, ROW)),
        np.zeros(2 * MOST * count),
        *(np.zeros(count) for _ in range(3)),
        np.zeros(2 * d),
        np.zeros(d + count),
    )
    flat = np.ravel(weights)
    return found.function(*numbers, blank(found), flat, count, way), way


@pytest.mark.parametrize(
    ("field", "weights"), [(DUFFING, [[1.0]]), (CHAIN, [[1.0, 0.0], [1.0, -1.0], [0.0, 1.0]])]
)
@pytest.mark.parametrize("seed", range(4))
def test_paths_and_every_zero_of_the_acceleration(field, weights, seed):
    length = 12.0
    numbers = numbers_for(field, length, seed)
    made, way = path_of(field, numbers, weights)
    track = IntegratedTrack(field, numbers[1:], length)
    times = np.linspace(0.0, length, 701)
    moved, speeds = track.moved_at(times)
    count = len(weights)
    for g, row in enumerate(weights):
        curve = track.along(row, from_start=True)
        assert way.breaks[2 * MOST * g :][: int(way.found[g])] == pytest.approx(
            curve.breaks(), abs=1e-8
        )
        ours = np.array([motion_of_gap((g, count, made), t, way.steps) for t in times])
        assert ours[:, 0] == pytest.approx(moved @ row, abs=1e-12)
        assert ours[:, 1] == pytest.approx(speeds @ row, abs=1e-12)
        pieces = way.steps[g : count * made : count]
        assert np.sum(pieces[:, 1]) == pytest.approx(length, rel=1e-14)
        for one, other in itertools.pairwise(pieces):  # pieces meet
            assert motion_in_step(one, other[0]) == pytest.approx(
                motion_in_step(other, other[0]), abs=1e-11
            )


def test_a_path_of_more_pieces_than_places_is_refused():
    numbers = [600.0, 0.0, 0.5, 0.0, 0.0, 900.0]
    made, _ = path_of("a w: a - w*x0", numbers, [[1.0]])
    assert made == -1


@needs_llvmlite
@pytest.mark.parametrize(
    "field",
    [HIDING, *FIELDS[:2], *(pytest.param(field, marks=pytest.mark.full) for field in FIELDS[2:])],
)
def test_compiled_flights_are_those_of_the_plain_text(field, monkeypatch, tmp_path):
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    monkeypatch.setenv("CONTIMPACT_CACHE", str(tmp_path))
    directions, numbers = directions_of(field), numbers_for(field, 3.0, 11)
    function = flight_by_series(field, directions)
    size = 2 * statement(field).freedom * (1 + len(directions.split()))
    given = ", ".join(f"x[{i}]" for i in range(len(numbers)))

    def build():
        program = Program({})
        text = f"""
def entry(x, w, out):
    found = flown({given}, w, {SOME_STEPS}, 1.0)
    for i in range({size}):
        out[i] = found[i]
    return 0
"""
        program.glue(text, flown=function.function)
        return program

    compiled = compiling.load(("flown", field), "fff", build)
    out = np.zeros(size)
    compiled(np.array(numbers), blank(function), out)
    assert out.tolist() == flown_plainly(field, directions, numbers).tolist()


def test_the_order_is_heyokas():
    integrate = integrator(DUFFING)
    assert integrate._adaptive.order == taylor.ORDER == DEGREE


def test_fields_of_kernels_are_read():
    field = text_of(["p_a"], ["p_a*power(p_a, ratio(3, 2)) - (x0*x0*x0)/square(p_a)"])
    numbers = [0.4, 0.0, 0.3, 0.1, 1.3]
    exact = integrator(field, ("p_a",))(numbers)
    assert flown_plainly(field, "p_a", numbers) == pytest.approx(exact, rel=1e-14)


@needs_llvmlite
def test_programs_share_the_machine_code_of_a_flight(monkeypatch, tmp_path):
    """Another program that calls a flight compiles its own functions alone."""
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    monkeypatch.setenv("CONTIMPACT_CACHE", str(tmp_path))
    field = "a b: -a*x0 - b*x0**3 - 0.125*v0"
    flight, kept = flight_by_series(field, "v0"), []
    for factor in (1.0, 2.0):
        program = Program({})
        text = f"""
def entry(x, w, out):
    out[0] = {factor}*flown(x[0], x[1], x[2], x[3], x[4], x[5], w, {SOME_STEPS}, 1.0)[0]
    return 0
"""
        program.glue(text, flown=flight.function)
        compiled = compiling.load(("shared", str(factor)), "fff", lambda: program)  # noqa: B023
        out, numbers = np.zeros(1), [1.0, 0.0, 0.5, -0.3, 1.0, 1.0]
        compiled(np.array(numbers), blank(flight), out)
        assert out[0] == factor * flown_by(flight, numbers)[0]
        kept.append({path.name for path in tmp_path.glob("*.o")})
    assert len(kept[1]) == len(kept[0]) + 1
