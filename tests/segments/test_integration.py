"""Flights that are integrated, against closed forms, matrices, many digits and mpmath's own."""

import functools
import math

import mpmath
import numpy as np
import pytest
import scipy.integrate
import sympy
from integrated import MASSES, Integrated, IntegratedMasses

from contimpact.errors import InputError
from contimpact.models.model import Formulas
from contimpact.models.nonlinear import Nonlinear
from contimpact.orbits.search import find_orbits
from contimpact.segments import integrated_flight, integration, kernels
from contimpact.segments.bounded import BOUNDED, BoundedNumber, many_digits
from contimpact.segments.checking import check_model
from contimpact.segments.integrated_flight import MANY, flown, flown_of_arrays, flown_of_series
from contimpact.segments.integration import integrator, text_of
from contimpact.segments.kernel import flat
from contimpact.segments.kernels import Kernels
from contimpact.segments.segment import ARRAYS, evaluate_in
from contimpact.segments.taylor import polynomials_of
from contimpact.segments.track import IntegratedTrack, integrated_track, track_of
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.pendulum import Pendulum
from contimpact.systems.two_masses import TwoMasses

pytest.importorskip(
    "heyoka", reason="flights are integrated by heyoka: pip install contimpact[ode]"
)

CTX = mpmath.mp.clone()
CTX.dps = 40

FIELD = text_of(["p_a", "p_c", "p_w"], ["p_a*cos(p_w*t) - p_c*v0 - sin(x0)"])
AT = [3.0, 0.3, 0.5, -1.0, 0.7, 0.1, 1.1]
"""Duration, time, angle, velocity, a, c and omega."""
ALL = "dt t x0 v0 p_a p_c p_w"


@pytest.mark.full
def test_a_flight_is_that_of_another_integrator():
    """By mpmath's own Taylor method, with the variational equations by the initial velocity."""
    given = [1.2, *AT[1:]]
    dt, t0, x0, v0, a, c, w = map(CTX.mpf, given)

    def rates(s, y):
        x, v, dx, dv = y
        force = a * CTX.cos(w * (t0 + s)) - c * v - CTX.sin(x)
        return [v, force, dv, -c * dv - CTX.cos(x) * dx]

    with CTX.workdps(22):
        x, v, dx, dv = CTX.odefun(rates, 0, [x0, v0, 0, 1])(dt)
    found = np.reshape(flown(FIELD, "v0", *given), (2, 2))
    truth = np.array([[(x - x0) / dt, v], [dx / dt, dv]], dtype=float)
    assert found == pytest.approx(truth, abs=1e-15)
    exact = many_digits(CTX).names["flown"](FIELD, "v0", *given)
    assert max(abs(exact[0] - (x - x0) / dt), abs(exact[3] - dv)) < 1e-20


def test_flights_take_no_more_steps_than_they_may():
    """A long flight takes many; those after it none, until the limit ends."""
    long, short = [300.0, *AT[1:]], [0.1, *AT[1:]]
    single = integrator(FIELD)
    steps = len(single.dense(long)[0]) - 1
    assert 50 < steps < 5000
    for integrate in (single.dense, single):
        with integration.limited_steps(steps // 2) as budget:
            integrate(short)
            assert budget.left >= steps // 2 - 3
            with pytest.raises(integration.StepLimitError):
                integrate(long)
            assert budget.left <= 0
            with pytest.raises(integration.StepLimitError):
                integrate(short)
        assert np.all(np.isfinite(np.hstack([np.ravel(part) for part in integrate(short)])))


@pytest.mark.parametrize("compiled", ["never", "auto"])
def test_motions_that_run_away_within_a_finite_time_end_soon(monkeypatch, compiled):
    """Steps go down with the time that is left, to none: a flight took all it may, 200,000."""
    monkeypatch.setenv("CONTIMPACT_COMPILED", compiled)
    field, numbers = "a: v0**2 + a", [3.0, 0.0, 0.0, 1.0, 1.0]  # v = tan(t + pi/4)

    def fly_once(field, numbers):
        return flown(field, "", *numbers)

    with integration.limited_steps(5_000) as budget:
        _, speed = fly_once(field, [0.7, *numbers[1:]])
        assert speed == pytest.approx(math.tan(0.7 + math.pi / 4), rel=1e-13)
        for fly in (fly_once, polynomials_of):
            with pytest.raises(OverflowError, match="finite"):
                fly(field, numbers)
    both = np.array([[0.7, *numbers[1:]], numbers])
    found = integration.batch_integrator(field, ()).each(both)
    assert np.isfinite(found).all(axis=1).tolist() == [True, False]
    assert budget.left > 2_000


@pytest.mark.parametrize("dt", [0.0, 1e-9, 0.4, 17.0, -2.0])
def test_flights_and_derivatives_in_floats_are_those_in_many_digits(dt):
    given = [dt, *AT[1:]]
    exact = many_digits(CTX).names["flown"](FIELD, ALL, *given)
    found = np.array(flown(FIELD, ALL, *given))
    size = max(1.0, max(abs(float(x)) for x in exact))
    assert max(abs(float(x - y)) for x, y in zip(exact, found, strict=True)) < 2e-14 * size


def test_a_flight_of_no_duration_leaves_as_it_was_left():
    mean, end, by_mean, by_end = flown(FIELD, "dt", 0.0, *AT[1:])
    push = 0.7 * math.cos(1.1 * 0.3) + 0.1 - math.sin(0.5)
    assert (mean, end) == (-1.0, -1.0)
    assert (by_mean, by_end) == pytest.approx((0.5 * push, push), rel=1e-15)


def test_series_are_taylor_coefficients():
    q = np.random.default_rng(2).normal(size=len(AT)).tolist()
    inside = many_digits(CTX).names["flown"]
    e = CTX.mpf(10) ** -8

    def along(times):
        return np.array(inside(FIELD, "", *(x + times * e * y for x, y in zip(AT, q, strict=True))))

    low, before, here, after, high = (along(k) for k in (-2, -1, 0, 1, 2))
    truth = [here, (after - before) / 2 / e, (after - 2 * here + before) / 2 / e**2]
    truth.append((high - 2 * after + 2 * before - low) / 12 / e**3)
    found = np.array(
        flown_of_series(FIELD, "", [[x, y, 0.0, 0.0] for x, y in zip(AT, q, strict=True)])
    )
    for order, exact in enumerate(truth):
        assert found[:, order] == pytest.approx(exact.astype(float), rel=1e-13, abs=1e-13)


@pytest.mark.parametrize("parameter", ["omega", "sigma"])
def test_kernels_are_those_of_the_closed_form(parameter):
    """Residual, and all derivatives up to the third."""
    values = {"a": 1.0, "omega": 1.3, "c": 0.1, "k": 1.0, "sigma": 0.5, "r": 0.8}
    one, other = (Kernels(kind(**values), parameter) for kind in (Oscillator, Integrated))
    ends, q, p = [0.3, 1.1, 3.4, 0.7], [0.3, -0.4, 0.2, 0.6, 0.5], list(values.values())
    for found, truth in (
        (other.flight("S", "S")(*ends, *p), one.flight("S", "S")(*ends, *p)),
        (other.motion("S")(*ends[:3], *p), one.motion("S")(*ends[:3], *p)),
        (other.second("S", "S")(*ends, *q, *p), one.second("S", "S")(*ends, *q, *p)),
        (other.third("S", "S")(*ends, *q[:4], *p), one.third("S", "S")(*ends, *q[:4], *p)),
    ):
        assert flat(found) == pytest.approx(flat(truth), rel=2e-14, abs=2e-14)


@pytest.mark.full
def test_kernels_of_two_masses_are_those_of_the_matrices():
    one, other = (kind(**MASSES) for kind in (TwoMasses, IntegratedMasses))
    one, other = Kernels(one, "k2"), Kernels(other, "k2")
    rng, p = np.random.default_rng(0), list(one.model.values.values())
    ends = rng.normal(size=8).tolist()
    ends[4] = ends[0] + 3.0
    for a, b in ("AB", "BB"):
        found, truth = (flat(k.flight(a, b)(*ends, *p)) for k in (other, one))
        assert found == pytest.approx(truth, rel=1e-14, abs=2e-14)
    found = integrated_track(other, "A", ends[:4], p, 3.0).along((0.5, 2.0))
    truth = track_of(one.law("A")(*ends[:4], *p), 3.0).along((0.5, 2.0))
    for dt in (0.0, 0.7, 3.0):
        assert found((), dt, ()) == pytest.approx(truth((), dt, ()), rel=1e-13, abs=1e-13)
    assert found.breaks() == pytest.approx(truth.breaks(), rel=1e-12)


def test_arrays_are_rows_of_numbers():
    times = np.array([[0.0, 1e-9, 0.7], [3.0, 2.0, 0.1]])
    together = evaluate_in(Kernels(_pendulum(), "a").motion("S"), ARRAYS)
    one = Kernels(_pendulum(), "a").motion("S")
    p = list(_pendulum().values.values())
    found = np.array(together(0.3, 1.2, times, *p))
    for place in np.ndindex(times.shape):
        assert found[:, *place] == pytest.approx(one(0.3, 1.2, times[place], *p), abs=2e-15)
    moving = flown_of_arrays(FIELD, "v0", *(np.array([x, x + 0.1]) for x in AT))
    assert moving[:, 1] == pytest.approx(flown(FIELD, "v0", *(x + 0.1 for x in AT)), abs=0)


def test_a_flow_that_does_not_stay_finite():
    field = text_of([], ["v0**2"])  # v = 1/(1 - t)
    assert flown(field, "", 0.5, 0.0, 0.0, 1.0)[1] == pytest.approx(2.0, rel=1e-15)
    with pytest.raises(ArithmeticError, match="a flight"):
        flown(field, "", 1.5, 0.0, 0.0, 1.0)
    found = flown_of_arrays(field, "", np.array([0.5, 1.5]), 0.0, 0.0, np.ones(2))
    assert np.isnan(found).tolist() == [[False, True], [False, True]]


@pytest.mark.parametrize("scale", [1.0, 1e-12, 1e9])
@pytest.mark.quick(1)
def test_bounds_of_errors_hold(scale):
    """For states of any size: a pendulum in other units."""
    field = text_of(["p_s"], ["p_s*(cos(t) - sin(x0/p_s)) - v0/10"])
    rng, names = np.random.default_rng(3), "dt t x0 v0"
    for dt in (1e-6, 0.3, 4.0, 25.0):
        x0, v0 = (scale * rng.normal(size=2)).tolist()
        found = BOUNDED.names["flown"](field, names, BoundedNumber(dt), 0.2, x0, v0, scale)
        truth = many_digits(CTX).names["flown"](field, names, dt, CTX.mpf(0.2), x0, v0, scale)
        for x, y in zip(found, truth, strict=True):
            assert abs(float(x.value - y)) <= x.error + 1e-16 * abs(float(y))
        assert found[1].error < 1e-12 * scale * math.exp(dt)


def test_what_is_missing_is_said(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "heyoka", None)
    integrator.cache_clear()
    kernels._function_of.cache_clear()
    with pytest.raises(InputError, match=r"pip install contimpact\[ode\]"):
        flown(FIELD, "", *AT)
    with pytest.raises(InputError, match=r"pip install contimpact\[ode\]"):
        check_model(_pendulum())
    with pytest.raises(InputError, match=r"pip install contimpact\[ode\]"):
        Kernels(_pendulum(), "a").motion("S")


def test_accelerations_are_one_for_each_coordinate():
    with pytest.raises(InputError, match="found 1; give one for each degree of freedom: 2"):
        Nonlinear(lambda t, x, v: [x[0]], 2)
    with pytest.raises(InputError, match="1, or another number as degrees_of_freedom="):
        Nonlinear(lambda t, x, v: [x[1], -x[0]])


def test_accelerations_are_in_the_symbols_given():
    class Foreign(Pendulum):
        SYSTEM = "foreign-pendulum"

        def formulas(self, symbols):
            motion = Nonlinear(lambda t, x, v: [sympy.Symbol("gravity") * sympy.sin(x[0])])
            return Formulas(
                period=sympy.Integer(1),
                walls={"S": symbols["sigma"]},
                reset=lambda wall, x, v: [-v[0]],
                flight=motion.flight,
                acceleration=motion.acceleration,
            )

    with pytest.raises(InputError, match="found 'gravity'"):
        Kernels(Foreign(**_pendulum().values), "a").motion("S")


def _pendulum():
    return Pendulum(a=1.0, omega=0.8, c=0.1, sigma=1.0, r=0.8)


# Many flights at once


def in_turn(field, names, rows):
    """Each flight by the scalar integrator; NaN where it has no value."""
    found = []
    for row in rows.tolist():
        try:
            found.append(flown(field, names, *row))
        except ArithmeticError:
            found.append([math.nan] * (2 * (1 + len(names.split()))))
    return np.array(found).T


def test_flights_side_by_side_are_those_in_turn():
    rng = np.random.default_rng(0)
    rows = np.array(AT) + rng.normal(scale=0.5, size=(MANY + 3, len(AT)))
    rows[:20, 0] *= -1.0
    rows[5, 0] = 0.0
    found = flown_of_arrays(FIELD, ALL, *rows.T)
    expected = in_turn(FIELD, ALL, rows)
    assert not np.any(np.isnan(expected))
    assert found == pytest.approx(expected, rel=1e-13, abs=1e-14)


def test_flights_beside_those_that_do_not_stay_finite():
    """Half of them fall to infinity on the way; they stop no other."""
    field, rng = text_of([], ["x0**3"]), np.random.default_rng(1)
    rows = rng.normal(size=(2 * MANY, 4)) * [2.0, 0.0, 2.0, 1.0]
    rows[7, 2] = math.nan
    found = flown_of_arrays(field, "dt", *rows.T)
    expected = in_turn(field, "dt", rows)
    without = np.isnan(expected).any(axis=0)
    assert 20 < np.sum(without) < len(rows) - 20
    assert np.array_equal(np.isnan(found), np.isnan(expected))
    assert found[:, ~without] == pytest.approx(expected[:, ~without], rel=1e-12)


@pytest.mark.full
def test_searches_find_the_same_side_by_side(monkeypatch):
    model = Pendulum(a=1.0, omega=1.2, c=0.1, sigma=0.3, r=0.8)
    together = find_orbits(model, "S", parameter="omega")
    monkeypatch.setattr(integrated_flight, "MANY", 10**9)
    alone = find_orbits(model, "S", parameter="omega")
    assert len(together) == len(alone) == 6
    for one, other in zip(together, alone, strict=True):
        assert one.unknowns == pytest.approx(other.unknowns, abs=1e-13)


# Forces that are below rounding where a step begins.

HIDDEN = {
    "a wall that grows exponentially": (
        "0.5*cos(1.2*t) - x0 - 0.2*exp(50*(x0 - 0.4))",
        [7.0, 0.3, 0.6, -2.8],
    ),
    "a bump in the midst of a step": (
        "0.5*cos(1.2*t) - x0 - 300*(x0 + 1)*exp(-100*square(x0 + 1))",
        [3.0, 0.3, 0.6, -4.5],
    ),
    "friction that changes its sign": (
        "0.5*cos(1.2*t) - x0 - 0.2*tanh(300*v0)",
        [6.0, 0.3, 0.6, -1.8],
    ),
    "a corner behind a branch point": ("-x0 - 0.1*sqrt(1e-20 + v0*v0)", [3.0, 0.0, 0.1, -2.0]),
    "a power that begins at zero": ("-x0**7", [6.0, 0.3, 0.0, 1.0]),
}
"""Accelerations, and duration, time, position and velocity of a flight."""


@functools.cache
def flight_by_runge_kutta(acceleration, given):
    """Mean and end velocities by DOP853, in steps that meet every layer."""
    functions = {
        "square": np.square,
        **{name: getattr(np, name) for name in ("cos", "exp", "tanh", "sqrt")},
    }
    force = eval(f"lambda t, x0, v0: {acceleration}", functions)
    length, begin, position, velocity = given
    found = scipy.integrate.solve_ivp(
        lambda t, y: [y[1], force(t, *y)],
        (begin, begin + length),
        [position, velocity],
        method="DOP853",
        rtol=1e-13,
        atol=1e-14,
        max_step=0.005,
    )
    return [(found.y[0, -1] - position) / length, found.y[1, -1]]


@pytest.mark.parametrize("kind", HIDDEN)
@pytest.mark.quick(3)
def test_what_is_below_rounding_where_a_step_begins_is_met(kind):
    """Alone, side by side, in many digits, and as polynomials."""
    acceleration, given = HIDDEN[kind]
    expected = pytest.approx(flight_by_runge_kutta(acceleration, tuple(given)), abs=2e-12)
    field = text_of([], [acceleration])
    assert integration.may_hide(field)
    assert list(flown(field, "", *given)) == expected
    together = flown_of_arrays(field, "v0", *np.tile(given, (MANY, 1)).T)
    assert all(list(flight[:2]) == expected for flight in together.T)
    real = integration._heyoka().real
    many = integrator(field, (), 0, 120)([real(number, 120) for number in given])
    assert list(map(float, many)) == expected
    length = given[0]
    position, velocity = IntegratedTrack(field, given[1:], length).at(np.array([length]))
    assert [(position[0, 0] - given[2]) / length, velocity[0, 0]] == expected


def test_polynomials_of_low_degree_are_not_looked_at():
    """It takes as long as the integration of such a flight; nothing of theirs is hidden."""
    for plain in (FIELD, text_of([], ["-x0 - x0**3"]), text_of([], ["x0/(1 + x0**2)**2"])):
        assert not integration.may_hide(plain)
    for acceleration in (
        "-x0**7",
        "exp(x0)",
        "x0**2.5",
        "sqrt(1 + x0**2)",
        "sin(x0**2)",
        "2**x0",
        "cos(t)*tanh(v0)",
    ):
        assert integration.may_hide(text_of([], [acceleration]))
