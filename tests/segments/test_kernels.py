"""Generated kernels against exact flights, and the cache they are kept in."""

from __future__ import annotations

import logging
import math
import os
import subprocess
import sys

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from contimpact.errors import InputError
from contimpact.segments.kernel import flat
from contimpact.segments.kernels import Kernels
from contimpact.segments.segment import ARRAYS, evaluate_in

PAIR_KINDS = ["BB", "BT", "TB", "TT"]
SHORT_FORCINGS = ["cos(pi*t)", "cos(pi*t)**3", "cos(pi*t+0.3)+sin(4*pi*t)/5-1/8"]
CRITICAL = 2.0  # the oscillator's critical damping at k = 1
DAMPINGS = [0.0, 0.1, CRITICAL * (1 - 1e-9), CRITICAL, CRITICAL * (1 + 1e-9), 5.0, -0.3]


def flights(count, latest, shortest=1e-6, longest=10.0, seed=0):
    """(t0, v0, t1, v1) of random flights, their durations spread evenly in the logarithm."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        t0 = rng.uniform(0.0, latest)
        t1 = t0 + math.exp(rng.uniform(math.log(shortest), math.log(longest)))
        v0, v1 = rng.normal(size=2)
        yield float(t0), float(v0), float(t1), float(v1)


def values_of(model):
    return list(model.values.values())


# The reference itself


@pytest.mark.parametrize("forcing", ["cos(pi*t)**3", "exp(cos(pi*t))/3"])
def test_reference_flight_of_the_pair_solves_its_equation(pair, exact, forcing):
    model = pair(forcing=forcing)
    start, v0, t1 = mp.mpf("0.3"), mp.mpf("0.7"), mp.mpf("1.1")

    def position(t):
        return exact(model, "B", "T", (start, v0, t, 0))[0][0]

    f = {"cos(pi*t)**3": lambda t: mp.cos(mp.pi * t) ** 3}.get(
        forcing, lambda t: mp.exp(mp.cos(mp.pi * t)) / 3
    )
    p = model.values
    gbar = mp.mpf(p["M"]) * p["g"] * mp.sin(p["beta"]) / p["A"]
    speed = exact(model, "B", "T", (start, v0, t1, 0))[0][1]
    assert abs(mp.diff(position, t1, 2) - f(t1) - gbar) < mp.mpf(10) ** -15
    assert abs(mp.diff(position, t1) - speed) < mp.mpf(10) ** -25
    assert abs(mp.diff(position, start + mp.mpf(10) ** -30) + p["r"] * v0) < mp.mpf(10) ** -15


@pytest.mark.parametrize("c", [0.1, CRITICAL, 5.0])
def test_reference_flight_of_the_oscillator_solves_its_equation(oscillator, exact, c):
    model = oscillator(c=c)
    start, v0, t1 = mp.mpf("0.3"), mp.mpf("0.7"), mp.mpf("1.1")

    def position(t):
        sigma = mp.mpf(model.values["sigma"])
        return sigma + (t - start) * exact(model, "S", "S", (start, v0, t, 0))[0][0]

    speed = exact(model, "S", "S", (start, v0, t1, 0))[0][1]
    push = mp.cos(model.values["omega"] * t1) - c * speed - position(t1)
    assert abs(mp.diff(position, t1, 2) - push) < mp.mpf(10) ** -15
    assert abs(mp.diff(position, t1) - speed) < mp.mpf(10) ** -25
    assert abs(mp.diff(position, start + mp.mpf(10) ** -30) + mp.mpf(0.8) * v0) < mp.mpf(10) ** -15


# Residuals


@pytest.mark.parametrize(
    ("forcing", "kind"),
    [(forcing, kind) for forcing in SHORT_FORCINGS for kind in PAIR_KINDS]
    + [("cos(pi*t)*cos(2*pi*t)*sin(3*pi*t)", "BT"), ("sin(pi*t)", "TT")]
    + [("exp(cos(pi*t))/3", "TB")],
)
@pytest.mark.quick(3)
def test_residual_of_the_pair(pair, exact, kernels_of, forcing, kind):
    """Flights of 1e-6 to 10 that start as late as 1e3 lose nothing.

    Measured: errors of 9.7e-16 of the largest term. Where the residual is no smaller than a
    hundredth of that term, 2e-14 of the residual itself.
    """
    model = pair(forcing=forcing)
    flight = kernels_of(model, "s").flight(*kind)
    for ends in flights(80, latest=1e3):
        out, *_ = flight(*ends, *values_of(model))
        for row, (residual, size) in enumerate(zip(*exact(model, *kind, ends), strict=True)):
            error = abs(out[row] - residual)
            assert error < 2e-15 * size
            assert error < 1e-13 * abs(residual) or abs(residual) < 0.01 * size


def test_residual_with_two_restitutions(pair, exact, kernels_of):
    model = pair(r_B=0.2, r_T=0.9)
    for kind in PAIR_KINDS:
        flight = kernels_of(model, "r_T").flight(*kind)
        for ends in flights(20, latest=10.0):
            out, *_ = flight(*ends, *values_of(model))
            residual, size = exact(model, *kind, ends)
            assert all(abs(out[i] - residual[i]) < 2e-15 * size[i] for i in range(2))


@pytest.mark.parametrize("c", DAMPINGS)
def test_residual_of_the_oscillator(oscillator, exact, kernels_of, c):
    """Measured: 5.2e-16 of the largest term for starts within a period; for late starts the
    rounding of omega t is added, measured 1.4e-13 at t = 1e3, where omega t eps is 4e-13."""
    model = oscillator(c=c)
    flight = kernels_of(model, "omega").flight("S", "S")
    for latest in (1.0, 1e3):
        for ends in flights(40, latest=latest):
            out, *_ = flight(*ends, *values_of(model))
            late = 1e-15 * (1 + model.values["omega"] * ends[0])
            residual, size = exact(model, "S", "S", ends)
            assert all(abs(out[i] - residual[i]) < late * size[i] for i in range(2))


@pytest.mark.parametrize("c", [0.1, CRITICAL, 5.0, -0.3])
def test_oscillator_against_integration(oscillator, kernels_of, c):
    """A flight of 5 against a Runge-Kutta method with tolerance 1e-12; they agree to 2e-12."""
    model = oscillator(c=c)
    t0, v0, t1 = 0.4, 0.9, 5.4
    p = model.values
    start = [p["sigma"], -p["r"] * v0]
    run = solve_ivp(
        lambda t, y: [y[1], math.cos(p["omega"] * t) - c * y[1] - y[0]],
        (t0, t1),
        start,
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
    )
    out, *_ = kernels_of(model, "omega").flight("S", "S")(t0, v0, t1, 0.0, *values_of(model))
    assert out[0] * (t1 - t0) == pytest.approx(run.y[0, -1] - p["sigma"], abs=2e-11)
    assert out[1] == pytest.approx(run.y[1, -1], abs=2e-11)


def test_zero_duration(pair, oscillator, kernels_of):
    """A flight that has not begun: the mean velocity is the velocity after impact."""
    for model, wall, parameter in ((pair(), "B", "s"), (oscillator(c=0.1), "S", "omega")):
        r, v = model.values["r"], 0.7
        out, *_ = kernels_of(model, parameter).flight(wall, wall)(
            1.3, v, 1.3, 0.2, *values_of(model)
        )
        assert out[0] == pytest.approx(-r * v, rel=1e-15)
        assert out[1] == pytest.approx(-r * v - 0.2, rel=1e-15)
        assert all(map(math.isfinite, out))


# Derivatives


def exact_gradients(exact, model, kind, ends, parameter, direction=None):
    """The 2 x 5 derivatives by (t0, v0, t1, v1, parameter), or those of the slope along a
    direction, from central differences with steps far below the digits asked for."""
    base = [mp.mpf(end) for end in ends] + [mp.mpf(model.values[parameter])]
    along = [mp.mpf(0)] * 5 if direction is None else [mp.mpf(float(q)) for q in direction]
    step = mp.mpf(10) ** (-20 if direction is None else -14)

    def residual(i, moved, sideways):
        z = [x + sideways * q for x, q in zip(base, along, strict=True)]
        z[i] += moved
        return exact(model, *kind, z[:4], {parameter: z[4]})[0]

    gradients = []
    for i in range(5):
        if direction is None:
            ahead, behind = residual(i, step, 0), residual(i, -step, 0)
            column = [(a - b) / (2 * step) for a, b in zip(ahead, behind, strict=True)]
        else:
            corners = [residual(i, p * step, q * step) for p in (1, -1) for q in (1, -1)]
            column = [(a - b - c + d) / (4 * step**2) for a, b, c, d in zip(*corners, strict=True)]
        gradients.append(column)
    return list(zip(*gradients, strict=True))


def check_rows(rows, expected, tolerance):
    for row, exact_row in zip(rows, expected, strict=True):
        largest = max(abs(e) for e in exact_row)
        for value, e in zip(row, exact_row, strict=True):
            assert abs(value - e) <= tolerance * largest


def first_rows(blocks):
    """Gradients of both residuals, from what a flight's kernel returns."""
    _, start, end, by_parameter = blocks
    return [
        [*start[2 * row : 2 * row + 2], *end[2 * row : 2 * row + 2], by_parameter[row]]
        for row in range(2)
    ]


@pytest.mark.parametrize(
    ("parameter", "given", "kinds"),
    [
        ("s", {"forcing": SHORT_FORCINGS[0]}, PAIR_KINDS),
        ("s", {"forcing": SHORT_FORCINGS[1]}, PAIR_KINDS),
        ("s", {"forcing": SHORT_FORCINGS[2]}, PAIR_KINDS),
        ("s", {"forcing": "exp(cos(pi*t))/3"}, ["TB"]),
        ("A", {}, ["BB", "BT"]),
        ("beta", {}, ["TT", "TB"]),
        ("r", {}, ["BB", "BT"]),
        ("M", {}, ["BB", "TB"]),
        ("omega", {}, ["TT", "BT"]),
        ("g", {}, ["BB", "BT"]),
        ("r_T", {"r_B": 0.2, "r_T": 0.9}, PAIR_KINDS),
    ],
)
@pytest.mark.quick(1)
def test_first_derivatives_of_the_pair(pair, exact, kernels_of, parameter, given, kinds):
    """Measured: errors of 1.0e-14 of the largest derivative in the row."""
    model = pair(**given)
    for kind in kinds:
        flight = kernels_of(model, parameter).flight(*kind)
        for ends in flights(12, latest=1e3, seed=1):
            out = flight(*ends, *values_of(model))
            expected = exact_gradients(exact, model, kind, ends, parameter)
            check_rows(first_rows(out), expected, 1e-13)


@pytest.mark.parametrize("c", DAMPINGS)
@pytest.mark.parametrize("parameter", ["omega", "c", "k"])
@pytest.mark.quick(9)
def test_first_derivatives_of_the_oscillator(oscillator, exact, kernels_of, parameter, c):
    """Measured: errors of 4.4e-14 of the largest derivative in the row, for starts below 2."""
    model = oscillator(c=c)
    flight = kernels_of(model, parameter).flight("S", "S")
    for ends in flights(10, latest=2.0, seed=2):
        out = flight(*ends, *values_of(model))
        expected = exact_gradients(exact, model, "SS", ends, parameter)
        check_rows(first_rows(out), expected, 2e-13)


def test_late_derivatives_where_the_period_varies(oscillator, exact, kernels_of):
    """By omega at fixed times: the residual's derivative grows with t. Measured: 2.1e-12."""
    model = oscillator(c=0.1)
    flight = kernels_of(model, "omega").flight("S", "S")
    for ends in flights(15, latest=1e3, seed=3):
        out = flight(*ends, *values_of(model))
        expected = exact_gradients(exact, model, "SS", ends, "omega")
        check_rows(first_rows(out), expected, 1e-11)


@pytest.mark.parametrize(
    ("parameter", "forcing", "kind"),
    [("A", "cos(pi*t)", "BB"), ("A", "cos(pi*t)", "BT"), ("s", "cos(pi*t)**3", "TB")],
)
def test_second_derivatives_of_the_pair(pair, exact, kernels_of, parameter, forcing, kind):
    """Measured: errors of 7.7e-14 of the largest in the row, for starts up to 1e3."""
    model = pair(forcing=forcing)
    second = kernels_of(model, parameter).second(*kind)
    rng = np.random.default_rng(4)
    for ends in flights(12, latest=1e3, seed=4):
        q = rng.normal(size=5)
        out = second(*ends, *q, *values_of(model))
        expected = exact_gradients(exact, model, kind, ends, parameter, q)
        check_rows(first_rows(out), expected, 5e-13)


@pytest.mark.parametrize("c", DAMPINGS)
def test_second_derivatives_of_the_oscillator(oscillator, exact, kernels_of, c):
    """Measured: errors of 1.2e-13 of the largest in the row, for starts below 2."""
    model = oscillator(c=c)
    second = kernels_of(model, "omega").second("S", "S")
    rng = np.random.default_rng(5)
    for ends in flights(6, latest=2.0, seed=5):
        q = rng.normal(size=5)
        out = second(*ends, *q, *values_of(model))
        expected = exact_gradients(exact, model, "SS", ends, "omega", q)
        check_rows(first_rows(out), expected, 1e-12)


# Motion, setup, harmonics


@pytest.mark.full
def test_motion(pair, oscillator, exact, kernels_of):
    """Displacement, velocity and acceleration along a flight, as its end would have them.

    Measured: 6e-16 of the residual's terms.
    """
    cases = [(pair(forcing=text), wall, "s") for text in SHORT_FORCINGS for wall in "BT"]
    cases += [(oscillator(c=c), "S", "omega") for c in (0.1, CRITICAL, 5.0)]
    for model, wall, parameter in cases:
        motion = kernels_of(model, parameter).motion(wall)
        for t0, v0, t1, _ in flights(10, latest=2.0, seed=6):
            dt = t1 - t0
            displacement, velocity, acceleration = motion(t0, v0, dt, *values_of(model))
            ends = (t0, v0, mp.mpf(t0) + mp.mpf(dt), 0)
            (mean, speed), sizes = exact(model, wall, wall, ends)
            assert abs(displacement - mean * dt) < 2e-15 * sizes[0] * dt
            assert abs(velocity - speed) < 2e-15 * sizes[1]
            h = mp.mpf(10) ** -20
            ahead = exact(model, wall, wall, (t0, v0, ends[2] + h, 0))[0][1]
            assert abs(acceleration - (ahead - speed) / h) < 3e-15 * sizes[1] + 1e-14


def test_setup_of_the_pair(pair, kernels_of):
    """d = 0.6225 s at A = 5 N and gbar = 0.12201 at beta = pi/6, as in the paper."""
    model = pair(s=0.5)
    out = kernels_of(model, "A").setup(*values_of(model))
    (bottom, top), (d, gbar), (d_slope, gbar_slope) = out.walls, out.derived, out.derived_slopes
    assert (out.period, out.slopes, out.curvatures) == (2, (0,), (0,))
    assert d == pytest.approx(0.6225 * 0.5, rel=1e-15)
    assert (bottom, top) == pytest.approx((d / 2, -d / 2), rel=1e-15)
    assert gbar == pytest.approx(0.12201, rel=1e-15)
    assert d_slope == pytest.approx(-d / 5, rel=1e-15)
    assert gbar_slope == pytest.approx(-gbar / 5, rel=1e-15)


def test_setup_of_the_oscillator(oscillator, kernels_of):
    model = oscillator(omega=0.7)
    out = kernels_of(model, "omega").setup(*values_of(model))
    period = 2 * math.pi / 0.7
    expected = (period, -period / 0.7, 2 * period / 0.49, model.values["sigma"])
    assert flat(out) == pytest.approx(expected, rel=4e-16)
    assert (out.derived, out.derived_slopes) == ((), ())


@pytest.mark.parametrize("forcing", SHORT_FORCINGS)
def test_harmonics_of_the_pair(pair, kernels_of, forcings, forcing):
    model = pair(forcing=forcing)
    out = kernels_of(model, "s").harmonics(*values_of(model))
    mean, series = forcings[forcing]()
    expected = [0.12201 + float(mean), *(float(x) for term in series for x in term)]
    assert out == pytest.approx(expected, rel=4e-16)


def test_sampled_harmonics(pair, kernels_of):
    """exp(cos(pi t))/3 from its samples: Bessel functions, to rounding of the largest."""
    model = pair(forcing="exp(cos(pi*t))/3", g=0.0)
    out = kernels_of(model, "s").harmonics(*values_of(model))
    found = {int(out[i]): out[i + 1 : i + 3] for i in range(1, len(out), 3)}
    assert out[0] == pytest.approx(float(mp.besseli(0, 1)) / 3, abs=2e-16)
    for k in range(1, 65):
        a, b = found.get(k, (0.0, 0.0))
        assert a == pytest.approx(2 * float(mp.besseli(k, 1)) / 3, abs=2e-16)
        assert b == pytest.approx(0.0, abs=2e-16)


def test_oscillator_has_no_harmonics(oscillator, kernels_of):
    model = oscillator()
    assert math.isnan(kernels_of(model, "omega").harmonics(*values_of(model))[0])


@pytest.mark.parametrize(
    "forcing",
    [
        "cos(t)",
        "cos(1.5*pi*t)",
        "cos(0.1*pi*t)*cos(0.9*pi*t)",
        "t",
        "t*cos(pi*t)",
        "exp(t)",
        "exp(pi*t)",
        "cosh(pi*t)",
        "exp(-t)*cos(pi*t)",
        "sqrt(cos(pi*t)**2)",
        "asin(cos(pi*t))",
        "atan(1000*sin(pi*t))",
        "cos(pi*t)/sqrt(cos(pi*t)**2)",
        "1/cos(pi*t)",
        "tan(pi*t)",
        "log(cos(pi*t))",
        "sqrt(cos(pi*t))",
        "1/(1.01+cos(pi*t))",
        "cos(65*pi*t)",
        "cos(pi*x)",
        "cos(pi*t",
        "",
        "cos(pi*t).diff(t)",
    ],
)
def test_forcing_refused(pair, forcing, tmp_path, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_CACHE", str(tmp_path))
    with pytest.raises(InputError, match=r"^forcing: "):
        _ = Kernels(pair(forcing=forcing), "s").setup
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("forcing", "expected"),
    [
        ("0", [0]),
        ("3/4", [0.75]),
        ("t - t", [0]),
        ("sin(pi*t)**2 + cos(pi*t)**2", [1]),
        ("cos(pi*(t + 1/3))", [0, 1, 0.5, -math.sqrt(3) / 2]),
        ("cos(-pi*t)", [0, 1, 1, 0]),
        ("2*sin(pi*t)*cos(pi*t)", [0, 2, 0, 1]),
        ("cos(64*pi*t)", [0, 64, 1, 0]),
        ("exp(1)*cos(3.141592653589793*t)", [0, 1, math.e, 0]),
        ("1e-30*cos(pi*t)", [0, 1, 1e-30, 0]),
    ],
)
def test_forcing_accepted(pair, forcing, expected, tmp_path, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_CACHE", str(tmp_path))
    model = pair(forcing=forcing, g=0.0)
    out = Kernels(model, "s").harmonics(*values_of(model))
    assert out == pytest.approx(expected, rel=2e-16)


# Vectors


def vector_cases(pair, oscillator):
    yield pair(forcing=SHORT_FORCINGS[2]), "s", ["BT", "BB"]
    for c in (0.1, CRITICAL, 5.0):
        yield oscillator(c=c), "omega", ["SS"]


def test_vectorised_flight_is_the_scalar_one(pair, oscillator, kernels_of):
    """The same arithmetic on arrays; NumPy's functions may differ in the last place."""
    for model, parameter, kinds in vector_cases(pair, oscillator):
        kernels = kernels_of(model, parameter)
        ends = np.array(list(flights(200, latest=50.0, seed=7)))
        for kind in kinds:
            kernel = kernels.flight(*kind)
            columns = flat(evaluate_in(kernel, ARRAYS)(*ends.T, *values_of(model)))
            columns = np.stack([np.broadcast_to(c, len(ends)) for c in columns], axis=1)
            rows = np.array([flat(kernel(*row, *values_of(model))) for row in ends.tolist()])
            np.testing.assert_allclose(columns, rows, rtol=0, atol=2e-13 * np.max(np.abs(rows)))
            largest = np.max(np.abs(rows), axis=1, keepdims=True)
            assert np.max(np.abs(columns - rows) / largest) < 4e-15  # measured: 9e-16


def test_vectorised_motion_broadcasts(pair, kernels_of):
    model = pair()
    kernels = kernels_of(model, "s")
    motion = kernels.motion("B")
    dt = np.linspace(0.0, 3.0, 50)
    out = evaluate_in(motion, ARRAYS)(0.2, 0.7, dt, *values_of(model))
    for i in (0, 7, 49):
        assert [o[i] for o in out] == pytest.approx(
            motion(0.2, 0.7, dt[i], *values_of(model)), rel=1e-14, abs=1e-15
        )


def test_kernels_are_scalar(pair, kernels_of):
    out = kernels_of(pair(), "s").flight("B", "T")(0.1, 0.6, 1.4, -0.5, *values_of(pair()))
    assert [len(block) for block in out] == [2, 4, 4, 2]
    assert all(type(value) in (float, int) for value in flat(out))


# The cache

QUICK = "motion_B"
UNWRITTEN = "contimpact.segments.kernels._unwritten"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def evaluated(model, parameter="s", name=QUICK):
    kernels = Kernels(model, parameter)
    return kernels, kernels.kernel(name)(0.2, 0.7, 0.4, *values_of(model))


def warnings_of(caplog):
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


def test_second_use_loads(pair, folder, caplog):
    first, out = evaluated(pair())
    second, again = evaluated(pair(A=7.0).replace(A=5.0))
    assert (first.generated, first.loaded) == ([QUICK], [])
    assert (second.generated, second.loaded) == ([], [QUICK])
    assert out == again
    assert len(list(folder.iterdir())) == 1
    assert not warnings_of(caplog)


def test_kernel_is_loaded_once(pair, folder):
    kernels, _ = evaluated(pair())
    assert kernels.kernel(QUICK) is kernels.kernel(QUICK)
    assert kernels.generated == [QUICK]


def test_only_what_was_asked_for(pair, folder):
    kernels = Kernels(pair(), "s")
    assert not folder.exists()
    kernels.flight("B", "T")
    assert kernels.generated == ["flight_B_T"]
    assert len(list(folder.iterdir())) == 1


def test_different_formulas_different_files(pair, oscillator, folder):
    evaluated(pair())
    evaluated(pair(), "A")
    Kernels(pair(), "A", "s").kernel(QUICK)
    Kernels(pair(), "s", "A").kernel(QUICK)
    evaluated(pair(forcing="sin(pi*t)"))
    evaluated(pair(r_B=0.3, r_T=0.4))
    evaluated(oscillator(), "omega", "motion_S")
    assert len(list(folder.iterdir())) == 7


def test_cached_source_is_readable(pair, folder):
    evaluated(pair(forcing="sin(pi*t)"))
    (file,) = folder.iterdir()
    text = file.read_text(encoding="utf-8")
    assert file.name.startswith("impact_pair-s-motion_B-")
    assert "delete freely" in text
    assert "'forcing': 'sin(pi*t)'" in text
    assert (
        f'def {QUICK}(t0, v0, dt, p_beta, p_r, p_A, p_s, p_M, p_omega, p_g):\n    """Flight after'
        in text
    )


DAMAGE = {
    "empty": lambda body: b"",
    "truncated": lambda body: body[: len(body) // 2],
    "first line only": lambda body: body.split(b"\n", 1)[0] + b"\n",
    "one character changed": lambda body: body.replace(b"phase", b"fhase", 1),
    "lengthened": lambda body: body + b"\nprint('foreign')\n",
    "not UTF-8": lambda body: b"\xff\xfe" + body,
    "zeros": lambda body: bytes(len(body)),
    "foreign": lambda body: b"raise SystemExit('foreign')\n",
    "other key": lambda body: b"# " + b"0" * 64 + body[66:],
}


@pytest.mark.parametrize("how", DAMAGE)
def test_damaged_file_is_generated_anew(pair, folder, caplog, how):
    _, expected = evaluated(pair())
    (file,) = folder.iterdir()
    good = file.read_bytes()
    file.write_bytes(DAMAGE[how](good))
    assert file.read_bytes() != good
    kernels, out = evaluated(pair())
    assert kernels.generated == [QUICK]
    assert out == expected
    assert [str(file) in message for message in warnings_of(caplog)] == [True]
    assert file.read_bytes() == good
    assert evaluated(pair())[0].loaded == [QUICK]


def test_file_of_another_kernel_is_refused(pair, folder, caplog):
    evaluated(pair())
    (file,) = folder.iterdir()
    evaluated(pair(), name="motion_T")
    (other,) = set(folder.iterdir()) - {file}
    file.write_bytes(other.read_bytes())
    assert evaluated(pair())[0].generated == [QUICK]
    assert len(warnings_of(caplog)) == 1


def test_folder_that_is_a_file(pair, tmp_path, monkeypatch, caplog):
    (tmp_path / "file").write_text("not a folder")
    for place in (tmp_path / "file", tmp_path / "file" / "below"):
        monkeypatch.setenv("CONTIMPACT_CACHE", str(place))
        monkeypatch.setattr(UNWRITTEN, {})
        caplog.clear()
        kernels, out = evaluated(pair())
        assert kernels.generated == [QUICK]
        assert all(map(math.isfinite, out))
        again, same = evaluated(pair())  # other searches, and each orbit, have kernels of their own
        assert (again.generated, same) == ([], out)
        assert any("not cached" in message for message in warnings_of(caplog))
    assert (tmp_path / "file").read_text() == "not a folder"


def test_folder_that_cannot_be_written(pair, folder, monkeypatch, caplog):
    def refuse(*args, **kwargs):
        raise PermissionError("read-only")

    monkeypatch.setattr(os, "replace", refuse)
    monkeypatch.setattr(UNWRITTEN, {})
    kernels, out = evaluated(pair())
    assert kernels.generated == [QUICK]
    assert all(map(math.isfinite, out))
    again, same = evaluated(pair())
    assert (again.generated, same) == ([], out)
    evaluated(pair(), name="motion_T")
    (said,) = warnings_of(caplog)
    assert "not cached" in said
    assert "CONTIMPACT_CACHE" in said
    assert not list(folder.iterdir())


def test_file_that_cannot_be_read(pair, folder, monkeypatch, caplog):
    _, expected = evaluated(pair())

    def refuse(*args, **kwargs):
        raise PermissionError("not yours")

    with monkeypatch.context() as patch:
        patch.setattr("contimpact.segments.kernels.load_file", refuse)
        kernels, out = evaluated(pair())
    assert (kernels.generated, out) == ([QUICK], expected)
    assert any("cannot be read" in message for message in warnings_of(caplog))


def test_two_free_parameters(pair, exact, kernels_of):
    """A second parameter adds a column; one parameter's kernels are unchanged by it."""
    model = pair()
    flight = kernels_of(model, "A", "r").flight("B", "T")
    for ends in flights(5, latest=10.0, seed=8):
        out = flight(*ends, *values_of(model))
        by_amplitude = kernels_of(model, "A").flight("B", "T")(*ends, *values_of(model))
        for both, alone in zip(out[:3], by_amplitude[:3], strict=True):
            assert both == pytest.approx(alone, rel=1e-13, abs=1e-15)
        for column, name in enumerate(("A", "r")):
            expected = exact_gradients(exact, model, "BT", ends, name)
            rows = first_rows([*out[:3], out[3][column::2]])
            check_rows(rows, expected, 1e-13)


def test_setup_with_two_free_parameters(pair, oscillator, kernels_of):
    """Period and derived parameters have slopes by both; the rest is as with the first alone."""
    model = pair(s=0.5)
    alone = kernels_of(model, "A").setup(*values_of(model))
    out = kernels_of(model, "A", "s").setup(*values_of(model))
    assert (out.period, out.walls, out.derived) == (alone.period, alone.walls, alone.derived)
    assert out.derived_slopes[::2] == alone.derived_slopes
    by_s = [out.derived[0] / 0.5, 0.0]  # d is proportional to s, gbar does not depend on it
    assert out.derived_slopes[1::2] == pytest.approx(by_s, rel=1e-15)
    assert (out.slopes, out.curvatures) == ((0, 0), (0, 0, 0, 0))
    model = oscillator(omega=0.7)
    period = 2 * math.pi / 0.7
    out = kernels_of(model, "sigma", "omega").setup(*values_of(model))
    assert (out.period, *out.walls) == pytest.approx((period, model.values["sigma"]), rel=4e-16)
    assert out.slopes == pytest.approx((0, -period / 0.7), rel=4e-16)
    assert out.curvatures == pytest.approx((0, 0, 0, 2 * period / 0.49), rel=4e-16)


def test_one_parameter_twice(pair):
    with pytest.raises(InputError, match="give different"):
        Kernels(pair(), "A", "A")


@pytest.mark.parametrize("parameter", ["d", "x", ""])
def test_unknown_parameter(pair, parameter):
    with pytest.raises(InputError, match=r"^parameter: "):
        Kernels(pair(), parameter)
    with pytest.raises(InputError, match=r"^parameter: "):
        Kernels(pair(), "A", parameter)


# Other processes

USE = """
import sys
from contimpact.segments.kernels import Kernels
from contimpact.systems.impact_pair import ImpactPair
model = ImpactPair(beta=0.5, r=0.3, A=5.0, s=0.389)
kernels = Kernels(model, "s")
p = model.values.values()
rows, *_ = kernels.flight("B", "T")(0.1, 0.6, 1.4, -0.5, *p)
print(rows[0].hex(), kernels.setup(*p).walls[0].hex())
print(*kernels.generated)
print("sympy" in sys.modules)
"""


def process(folder, code=USE):
    environment = os.environ | {"CONTIMPACT_CACHE": str(folder)}
    return subprocess.Popen(
        [sys.executable, "-W", "error", "-c", code],
        env=environment,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def finished(started):
    out, err = started.communicate()
    assert started.returncode == 0, err
    assert err == ""
    return out.splitlines()


@pytest.mark.full
def test_two_processes_at_once_then_a_warm_one(tmp_path):
    """Both may generate; both succeed, leave whole files, and the next one needs no SymPy."""
    one, other = [finished(p) for p in [process(tmp_path), process(tmp_path)]]
    assert one[0] == other[0]
    assert sorted(file.suffix for file in tmp_path.iterdir()) == [".py", ".py"]
    warm = finished(process(tmp_path))
    assert warm == [one[0], "", "False"]


@pytest.mark.full
def test_warm_search_imports_neither_sympy_nor_plots(tmp_path):
    code = """
import sys
from contimpact.orbits.search import find_orbits
from contimpact.systems.impact_pair import ImpactPair
orbits = find_orbits(ImpactPair(beta=0.5, r=0.3, A=5.0, s=0.389), "1:1", parameter="s")
print(len(orbits), *[orbit.physical for orbit in orbits], *[orbit.stable for orbit in orbits])
print(*[name for name in ("sympy", "matplotlib", "scipy.linalg") if name in sys.modules])
"""
    cold, warm = finished(process(tmp_path, code)), finished(process(tmp_path, code))
    assert cold[0] == warm[0]
    assert "sympy" in cold[1]
    assert warm[1] == ""


@pytest.mark.parametrize(
    ("forcing", "says"),
    [
        ("cos(pi*t)/(1-cos(0*t))", "finite"),
        ("1/cos(pi*t)", "finite"),
        ("tan(pi*t/2)", "finite"),
        ("sqrt(cos(pi*t)-2)", "real"),
        ("cos(pi*t)*log(cos(0*t)-2)", "real"),
        ("cos(t)", "period"),
    ],
)
def test_forcings_are_refused_by_their_cause(pair, forcing, says):
    with pytest.raises(InputError) as caught:
        Kernels(pair(forcing=forcing), "s").setup  # noqa: B018
    assert caught.value.where == "forcing"
    assert says in caught.value.found


@pytest.mark.parametrize(
    ("forcing", "harmonics"),
    [
        ("(1+cos(pi*t))**64", 64),  # too many terms to expand: sampled
        ("cos(pi*t)**64", 32),
        ("sqrt(2+cos(pi*t))", 25),
        ("1/(1.5+cos(pi*t))", 40),
        ("+".join(f"cos({k}*pi*t)/{k}" for k in range(1, 65)), 64),
    ],
)
@pytest.mark.quick(2)
def test_rich_forcings_are_read(pair, kernels_of, forcing, harmonics):
    """Their sums of harmonics are their values, to rounding of the largest."""
    model = pair(forcing=forcing, g=0.0)
    mean, *series = kernels_of(model, "s").harmonics(*values_of(model))
    assert len(series) <= 3 * harmonics
    times = np.linspace(0.0, 2.0, 101)
    found = mean + sum(
        a * np.cos(k * np.pi * times) + b * np.sin(k * np.pi * times)
        for k, a, b in zip(series[::3], series[1::3], series[2::3], strict=True)
    )
    expected = eval(forcing, {"cos": np.cos, "sqrt": np.sqrt, "pi": np.pi, "t": times})
    assert np.max(np.abs(found - expected)) < 1e-14 * np.max(np.abs(expected))


@pytest.mark.full
def test_derivatives_of_any_order_take_a_few_steps_for_each_harmonic(pair):
    """Written out, the third derivative of ten harmonics has a hundred thousand operations.

    Texts twice as long, and a little more for the longer names in them.
    """
    steps = {}
    for count in (2, 4, 8):
        forcing = "+".join(f"cos({k}*pi*t)" for k in range(1, count + 1))
        kernels = Kernels(pair(forcing=forcing), "s")
        for ask in (kernels.flight, kernels.second, kernels.third):
            steps[ask.__name__, count] = len(ask("B", "T").source)
    for name in ("flight", "second", "third"):
        assert steps[name, 8] < 2.3 * steps[name, 4] < 2.3 * 2.3 * steps[name, 2]


def test_third_derivatives(pair, oscillator, exact, kernels_of):
    """From differences of exact residuals along a direction. Measured: 3e-14 of the largest."""
    rng = np.random.default_rng(9)
    cases = [(pair(forcing=text), "s", kind) for text in SHORT_FORCINGS for kind in ("BT", "BB")]
    cases += [(oscillator(c=c), "omega", "SS") for c in (0.1, CRITICAL, 5.0)]
    for model, parameter, kind in cases:
        third = kernels_of(model, parameter).third(*kind)
        for ends in flights(4, latest=2.0, shortest=0.1, longest=5.0, seed=9):
            q = rng.normal(size=4)
            step = mp.mpf(10) ** -10

            def residual(k, kind=kind, model=model, ends=ends, q=q, step=step):
                moved = [
                    mp.mpf(e) + k * step * mp.mpf(float(d)) for e, d in zip(ends, q, strict=True)
                ]
                return exact(model, *kind, moved)[0]

            at = [residual(k) for k in (-2, -1, 1, 2)]
            for row, value in enumerate(third(*ends, *q, *values_of(model))):
                a, b, c, d = (corner[row] for corner in at)
                expected = float((d - 2 * c + 2 * b - a) / (2 * step**3))
                scale = float(np.abs(q).max() ** 3) * max(1.0, model.values.get("omega", 1.0) ** 3)
                assert abs(value - expected) < 1e-12 * max(abs(expected), scale)
