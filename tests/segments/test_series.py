"""Kernels on truncated series: derivatives of every function, and of flights in many digits."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
from zoo import two_masses

from contimpact.errors import InputError
from contimpact.segments.bounded import many_digits
from contimpact.segments.derivatives import (
    RECORDED,
    Series,
    Tape,
    second_derivatives,
    series,
    third_derivatives,
)
from contimpact.segments.kernel import flat
from contimpact.segments.kernels import Kernels
from contimpact.segments.segment import FLOATS, FUNCTIONS, evaluate_in
from contimpact.segments.transients import HIGHEST, MOTIONS, TABLES, transient
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator

DIGITS = 60


@pytest.fixture
def ctx():
    found = mpmath.mp.clone()
    found.dps = DIGITS
    return found


def taylor(ctx, function, x, degree):
    """Taylor coefficients by differences in many digits."""
    with ctx.extradps(60):
        return [ctx.diff(function, x, n) / ctx.factorial(n) for n in range(degree + 1)]


ONE_ARGUMENT = [name for name in FUNCTIONS if name != "floor"]
ONE_ARGUMENT += [f"stumpff{k}" for k in range(HIGHEST - 5)]


@pytest.mark.parametrize("name", ONE_ARGUMENT)
def test_functions(ctx, name):
    names = series(many_digits(ctx)).names
    x = ctx.mpf("0.3")
    found = names[name](Series([x, ctx.one, 0, 0])).coefficients
    for one, other in zip(found, taylor(ctx, names[name], x, 3), strict=True):
        assert abs(one - other) < 1e-30


@pytest.mark.parametrize("moving", [(1, -1, 2), (0, 0, 1), (1, 0, 0)])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.quick(1)
def test_free_motions(ctx, order, moving):
    """Right as far as they go, and as far as the functions of highest order let them."""
    names = series(many_digits(ctx)).names
    start = [ctx.mpf(x) for x in ("0.4", "0.7", "1.3")]
    given = [Series([x, ctx.mpf(q), 0, 0]) if q else x for x, q in zip(start, moving, strict=True)]
    found = names[f"transients{order}"](*given)
    kinds = [
        (n, b, max(2 * b - 1 - n, 0) if i < len(TABLES[order]) else 0)
        for i, (n, b) in enumerate(TABLES[order] + MOTIONS[order])
    ]
    for (n, b, power), one in zip(kinds, found, strict=True):

        def along(e, n=n, b=b, power=power):
            c, k, t = (x + e * q for x, q in zip(start, moving, strict=True))
            return transient(ctx, n, b, c, k, t) * t ** (max(2 * b - 1 - n, 0) - power)

        assert len(one.coefficients) >= (4 if (n, b) in ((-1, 1), (0, 1)) else 2)
        expected = taylor(ctx, along, ctx.zero, len(one.coefficients) - 1)
        for x, y in zip(one.coefficients, expected, strict=True):
            assert abs(x - y) < 1e-30


def test_series_of_different_lengths_make_the_shorter_one():
    long, short = Series([2.0, 3.0, 5.0]), Series([1.0, 7.0])
    for found in (long + short, short - long, long * short, short * long, long / short):
        assert len(found.coefficients) == 2
    assert (long * short).coefficients == [2.0, 17.0]
    assert (long / short).coefficients == (short / (short * short / long)).coefficients[:2]


def test_operations(ctx):
    x, y = ctx.mpf("0.3"), ctx.mpf("1.7")

    def function(a, b):
        return (2 - a * b) / (b - a / 3) + a**3 - (-b) / 4 + 1 / a + (7 * b) % (a * 2) + 5 - b

    found = function(Series([x, ctx.one, 0, 0]), Series([y, 2 * ctx.one, 0, 0])).coefficients
    expected = taylor(ctx, lambda e: function(x + e, y + 2 * e), ctx.zero, 3)
    for one, other in zip(found, expected, strict=True):
        assert abs(one - other) < 1e-30


MODELS = {
    "pair": (lambda: ImpactPair(beta=0.7, r=0.3, A=5.0, s=0.389), "A", "BT"),
    "rich": (lambda: ImpactPair(beta=0.7, r=0.3, A=5.0, s=0.4, forcing="cos(pi*t)**3"), "s", "BB"),
    "oscillator": (
        lambda: Oscillator(a=1.0, omega=1.7, c=0.3, k=1.0, sigma=0.4, r=0.8),
        "omega",
        "SS",
    ),
    "overdamped": (lambda: Oscillator(a=1e4, omega=1.7, c=1e4, k=1.0, sigma=0.4, r=0.8), "c", "SS"),
    "two masses": (two_masses, "omega", "AA"),
}


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.quick(3)
def test_derivatives_of_flights_in_many_digits(ctx, name):
    """Written in floats, against differences of the same kernel in sixty digits.

    Measured: errors of 1.3e-14 of the largest derivative, of 1.4e-13 for two masses.
    """
    make, parameter, walls = MODELS[name]
    model = make()
    kernel = Kernels(model, parameter).flight(*walls)
    m, names = model.unknowns_per_impact, list(model.values)
    second = second_derivatives(kernel, 2 * m, (parameter,))
    third = third_derivatives(kernel, 2 * m)
    exact = evaluate_in(kernel, many_digits(ctx))
    rng = np.random.default_rng(2)
    for _ in range(3):
        start, end = rng.normal(size=m), rng.normal(size=m)
        end[0] = start[0] + rng.uniform(0.2, 4.0)
        z, p = [*start, *end], list(model.values.values())
        q = rng.normal(size=2 * m + 1).tolist()

        def moved(e, free, z=z, p=p, q=q):
            values = [ctx.mpf(value) for value in p]
            values[names.index(parameter)] += e * ctx.mpf(q[-1]) if free else 0
            ends = (ctx.mpf(a) + e * ctx.mpf(b) for a, b in zip(z, q, strict=False))
            return exact(*ends, *values)

        h = ctx.mpf(10) ** -12
        ahead, behind = flat(moved(h, True)), flat(moved(-h, True))
        expected = np.array([float((a - b) / (2 * h)) for a, b in zip(ahead, behind, strict=True)])
        found = np.array(flat(second(*z, *q, *p)))
        assert np.max(np.abs(found - expected)) < 2e-13 * np.max(np.abs(expected))
        a, b, c, d = (moved(k * h, False)[0] for k in (-2, -1, 1, 2))
        pairs = zip(a, b, c, d, strict=True)
        expected = np.array([float((w - 2 * v + 2 * u - t) / (2 * h**3)) for t, u, v, w in pairs])
        found = np.array(third(*z, *q[:-1], *p))
        assert np.max(np.abs(found - expected)) < 2e-13 * np.max(np.abs(expected))


# What is written down.


def test_a_recorded_computation_runs_again():
    tape = Tape()
    x, y = tape.step("x"), tape.step("y")
    sine = RECORDED.names["sin"]
    unused = x * 17.0
    text = tape.kernel("f", ["x", "y"], "About.", (sine(x * y) + sine(x * y) / 2 - y, -x, 3))
    assert text.count("sin(") == 1  # equal steps once, and those alone that are needed
    assert "17.0" not in text
    assert unused.place < len(tape.steps)
    namespace = dict(FLOATS.names)
    exec(text, namespace)
    found = namespace["f"](0.4, 1.1)
    assert found == pytest.approx((1.5 * math.sin(0.44) - 1.1, -0.4, 3.0), rel=1e-15)


def test_functions_of_numbers_are_numbers():
    assert RECORDED.names["sin"](0.5) == math.sin(0.5)
    assert series(FLOATS).names["sin"](0.5) == math.sin(0.5)
    assert RECORDED.names["stumpffs3"](0.5) == FLOATS.names["stumpffs3"](0.5)
    for names in (RECORDED.names, series(FLOATS).names):
        given = (0.3, 1.7, 0.5)
        assert names["transients2"](*given) == FLOATS.names["transients2"](*given)


def test_derivatives_beyond_the_highest_stumpff_function_are_refused():
    with pytest.raises(InputError, match=f"c_{HIGHEST}"):
        series(FLOATS).names[f"stumpff{HIGHEST}"](Series([0.5, 1.0]))
