"""Free motions and whole flights of oscillators against textbook formulas at many digits."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest
import sympy

from contimpact.errors import InputError
from contimpact.models.symbolic import MeanTransient, Transient
from contimpact.segments import codegen
from contimpact.segments.bounded import BOUNDED, BoundedNumber, many_digits
from contimpact.segments.kernel import flat
from contimpact.segments.kernels import Kernels
from contimpact.segments.transients import ARRAY, MOTIONS, SCALAR, TABLES, _power_series, transient
from contimpact.systems.oscillator import Oscillator

CTX = mp.mp.clone()
CTX.dps = 30
ALLOWED = {1: 4e-15, 2: 4e-14, 3: 4e-13, 4: 4e-12}
"""By the number of factors; those above two are derivatives of higher order."""

PLACES = [  # (y, kappa): both sides of all borders, and far away
    (0.0, 1e-20),
    (0.0, 30.0),
    (1e-9, 0.999),
    (0.3, 1e-6),
    (0.499, 0.999),
    (1.1, 0.2),
    (1.1, 5.2),
    (2.0, 4.0),
    (2.0, 1e-9),
    (2.001, 1e-9),
    (2.8, 3.9),
    (2.9, 4.5),
    (3.0, 13.1),
    (7.0, 20.0),
    (7.0, 50.0),
    (7.0, 0.1),
    (40.0, 1e3),
    (5e3, 1.0),
    (5e7, 40.0),
    (5e11, 40.0),
    (-0.4, 0.3),
    (-2.5, 1.0),
    (-30.0, 1.0),
    (-30.0, 5e3),
    (0.1, 1e6),
]


def exact(n, b, c, k, t):
    """The function and how far it is from its neighbours, by which rounded arguments move it."""
    here = transient(CTX, n, b, c, k, t)
    moved = [
        transient(CTX, n, b, *[x * (1 + 1e-9 * (i == j)) for j, x in enumerate((c, k, t))])
        for i in range(3)
    ]
    return here, abs(here) + sum(abs(m - here) for m in moved) * 10**9


@pytest.mark.parametrize(("c", "k"), [(0.4, 21.0), (3.0, 0.5), (2.0, 1.0 + 1e-7), (-1.0, 0.01)])
@pytest.mark.parametrize("t", [0.02, 0.7, 4.0, -0.7])
@pytest.mark.quick(3)
def test_sums_over_roots_and_power_series_are_the_same(c, k, t):
    for n, b in TABLES[4]:
        with CTX.workdps(90):
            series = _power_series(CTX, n, b, CTX.mpf(c), CTX.mpf(k), CTX.mpf(t), CTX.mpf(30))
        found = transient(CTX, n, b, c, k, t)
        assert abs(found - series) <= 1e-28 * max(1, abs(series)), (n, b)


@pytest.mark.parametrize(("y", "kappa"), PLACES)
@pytest.mark.parametrize("t", [1.0, 1e-7])
@pytest.mark.quick(5)
def test_free_motions(y, kappa, t):
    c, k = 2 * y / t, kappa / t**2
    for order, table in TABLES.items():
        found = SCALAR[f"transients{order}"](c, k, t)
        arrays = ARRAY[f"transients{order}"](c, k, np.array([t, 2 * t]))
        for (n, b), value, values in zip(table, found, arrays, strict=False):
            truth, size = exact(n, b, c, k, t)
            assert abs(value - truth) <= ALLOWED[b] * size, (n, b, order)
            assert abs(values[0] - truth) <= ALLOWED[b] * size, (n, b, order)


@pytest.mark.parametrize("order", TABLES)
def test_arrays_of_all_kinds_of_damping(order):
    rng = np.random.default_rng(order)
    y, kappa = rng.choice([-5, -2, 0.1, 3, 30, 700], 300), rng.choice([0, 0.01, 3, 30, 1e4], 300)
    t = rng.uniform(0.1, 10.0, 300)
    c, k = 2 * y / t, kappa / t**2
    together = np.array(ARRAY[f"transients{order}"](c, k, t))
    for i, given in enumerate(zip(c.tolist(), k.tolist(), t.tolist(), strict=True)):
        found = SCALAR[f"transients{order}"](*given)
        assert together[:, i] == pytest.approx(found, rel=1e-12, abs=1e-280)


@pytest.mark.parametrize(
    ("y", "kappa"), [*PLACES, (2.0816, 0.479), (3.2836, 7.051), (2.6367, 2.8384), (0.0073, 4.2356)]
)
def test_bounds_of_errors_hold(y, kappa):
    given, names = (2 * y / 0.7, kappa / 0.49, 0.7), many_digits(CTX).names
    for order in TABLES:
        truth = names[f"transients{order}"](*given)
        for found, exact in zip(
            BOUNDED.names[f"transients{order}"](*map(BoundedNumber, given)), truth, strict=True
        ):
            assert abs(found.value - exact) <= found.error + 1e-290


@pytest.mark.parametrize("order", TABLES)
def test_functions_of_time_are_means_by_powers_of_time(order):
    t = 0.7
    for arithmetic, time in ((SCALAR, t), (ARRAY, np.array([t]))):
        found = arithmetic[f"transients{order}"](0.3, 1.7, time)
        means = dict(zip(TABLES[order], found, strict=False))
        timed = dict(zip(MOTIONS[order], found[len(means) :], strict=True))
        for (n, b), value in timed.items():
            assert value == pytest.approx(means[n, b] * t ** (2 * b - 1 - n), rel=1e-15)


def test_without_duration():
    """Accelerations have a limit, the rest are the reciprocals of factorials."""
    found = dict(zip(TABLES[4], SCALAR["transients4"](3.0, 5.0, 0.0), strict=False))
    for (n, b), value in found.items():
        if n < 2 * b:
            assert value == pytest.approx(1 / math.factorial(2 * b - 1 - n), rel=1e-15)
    assert (found[2, 1], found[3, 1]) == (-3.0, 4.0)


@pytest.mark.parametrize("kind", [Transient, MeanTransient])
@pytest.mark.parametrize(("n", "b"), [(-1, 1), (1, 1), (0, 2)])
def test_rules_of_differentiation(kind, n, b):
    def value(e, at):
        order, power, *_ = e.args
        found = transient(CTX, int(order), int(power), *at)
        scaled = kind is Transient and order < 2 * power
        return found * at[2] ** (2 * int(power) - 1 - int(order)) if scaled else found

    symbols, at = sympy.symbols("c k t"), [CTX.mpf(x) for x in ("0.7", "1.3", "0.9")]
    function = kind(n, b, *symbols)
    for i, symbol in enumerate(symbols):
        rule = function.diff(symbol)
        calls = {e: value(e, at) for e in rule.atoms(kind)}
        by_rule = rule.xreplace({e: sympy.Float(str(v), 30) for e, v in calls.items()})
        by_rule = by_rule.subs(dict(zip(symbols, map(str, at), strict=True)))
        slope = CTX.diff(lambda x, i=i: value(function, [*at[:i], x, *at[i + 1 :]]), at[i])
        assert abs(CTX.mpf(str(by_rule)) - slope) < 1e-12 * (1 + abs(slope))


NAMES = ("a", "omega", "c", "k", "sigma", "r", "t0", "v0", "t1")
FLIGHTS = [
    (c, k, dt)
    for k in (1e-4, 1.0, 1e8)
    for c in (0.0, 1.9, 40.0, 1e4, 1e8, 1e12)
    for dt in (1e-8, 0.7, 30.0)
]
ENTRIES = {
    (0, None): 0,
    (1, None): 1,
    (0, "v0"): 3,
    (1, "v0"): 5,
    (0, "t1"): 6,
    (1, "t1"): 8,
    (0, "free"): 10,
    (1, "free"): 11,
}
"""Mean and end velocity, and their derivatives, in what the kernel returns."""
LEAST = 1e-40


@pytest.mark.parametrize("free", ["c", "k"])
@pytest.mark.full
def test_flights_and_their_derivatives(free):
    """Both are right to rounding for any damping. Measured: 2e-16 and, by c without damping in the
    shortest flight, 9e-15."""
    kernel = Kernels(Oscillator(**dict.fromkeys(NAMES[:6], 0.5)), free).flight("S", "S")
    worst = dict.fromkeys(ENTRIES, 0.0)
    for c, k, dt in FLIGHTS:
        given = (0.8 * max(c, k), 1.3, c, k, 0.3, 0.8, 0.25, 0.5, 0.25 + dt)
        found = flat(kernel(*given[6:], 0.0, *given[:6]))
        with mp.workdps(100):
            for entry, (truth, size) in true_entries(free, given).items():
                error = float(abs(found[ENTRIES[entry]] - truth) / (size + LEAST))
                worst[entry] = max(worst[entry], error)
    assert max(worst[0, None], worst[1, None]) < 1e-15
    assert max(worst.values()) < 2e-14


def true_entries(free, given):
    """Each entry, and its size: itself and by how much rounded arguments move it."""
    at = [mp.mpf(x) for x in given]
    dt = at[8] - at[6]
    units = [abs(x) or at[1] for x in at]  # without damping, by the frequency
    units[8] = dt
    here = entries(free, at, units)
    sizes = {entry: abs(value) for entry, value in here.items()}
    for i, unit in enumerate(units):
        there = entries(free, [x + 1e-12 * unit * (i == j) for j, x in enumerate(at)], units)
        sizes = {e: sizes[e] + abs(there[e] - here[e]) * 10**12 for e in sizes}
    return {entry: (here[entry], sizes[entry]) for entry in here}


def entries(free, at, units):
    value = flown(at)
    found = {(row, None): value[row] for row in (0, 1)}
    for name in ("v0", "t1", "free"):
        i = NAMES.index(free if name == "free" else name)
        step = units[i] * mp.mpf(10) ** -30
        up, down = (flown([x + h * (i == j) for j, x in enumerate(at)]) for h in (step, -step))
        found |= {(row, name): (up[row] - down[row]) / (2 * step) for row in (0, 1)}
    return found


def flown(at):
    """Mean velocity and end velocity of a flight after an impact, by the roots of s^2 + cs + k."""
    a, w, c, k, sigma, r, t0, v0, t1 = at
    size = a / ((k - w**2) ** 2 + (c * w) ** 2)

    def steady(t):
        return size * ((k - w**2) * mp.cos(w * t) + c * w * mp.sin(w * t))

    def rate(t):
        return w * size * (c * w * mp.cos(w * t) - (k - w**2) * mp.sin(w * t))

    root = mp.sqrt(mp.mpc(c * c - 4 * k))
    high, low, dt = (-c + root) / 2, (-c - root) / 2, t1 - t0
    x, v = sigma - steady(t0), -r * v0 - rate(t0)
    up, down = (v - low * x) / root, (high * x - v) / root
    grown, shrunk = up * mp.exp(high * dt), down * mp.exp(low * dt)
    mean = (steady(t1) + grown + shrunk - sigma) / dt
    return mp.re(mean), mp.re(rate(t1) + high * grown + low * shrunk)


def test_a_free_motion_outside_the_tables_is_refused_by_its_orders():
    """A system's author, not a solver, can do something about it."""
    call = Transient(9, 4, *sympy.symbols("c k t", positive=True))
    with pytest.raises(InputError, match=r"\(n, b\) = \[\(9, 4\)\].*lower n and b"):
        list(codegen._transients([call]))
