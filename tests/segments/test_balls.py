"""Kernels in ball arithmetic: enclosures hold what they enclose, to fifty digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from zoo import harmonic_pair

from contimpact.segments import linear_flow
from contimpact.segments import stumpff as plain
from contimpact.segments.arithmetic import evaluate_in
from contimpact.segments.kernels import Kernels
from contimpact.segments.layout import flat
from contimpact.segments.many_digits import many_digits
from contimpact.systems.bouncing_ball import BouncingBall
from contimpact.systems.impact_damper import ImpactDamper
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.two_stops import TwoStops

flint = pytest.importorskip("flint", reason="needs contimpact[certify]")
balls = pytest.importorskip("contimpact.segments.balls", reason="needs contimpact[certify]")
from flint import arb, arb_series, ctx  # noqa: E402

from contimpact.segments.ball_series import number  # noqa: E402

MP = mpmath.mp.clone()
MP.dps = 50
EXACT = many_digits(MP)

PAIR = ImpactPair(beta=0.5, r=0.3, A=5.0, s=0.34)
RICH = harmonic_pair([(1, 1.0, 0.2), (3, 0.3, -0.4)], beta=0.2, r=0.6, A=4.0, s=0.4)
LIGHT = Oscillator(a=1.0, omega=2.0, c=0.1, k=1.0, sigma=0.3, r=0.8)
HEAVY = Oscillator(a=1.0, omega=2.0, c=6.0, k=1.5, sigma=0.3, r=0.8)
BALL = BouncingBall(a=0.014, omega=50.0, r=0.5, g=9.8)
RATTLING = TwoStops(a=1.0, b=0.1, omega=1.7, c=0.1, k=0.3, sigma=0.5, r=0.7)
DAMPER = ImpactDamper(Omega=1.0, d=20.0, r=0.8, mu=0.1, zeta=0.01)
NAMES = {"pair": ("BB", "BT", "TB", "TT"), "oscillator": ("SS",)}


@pytest.fixture(autouse=True)
def precision():
    before = ctx.prec, ctx.cap
    ctx.prec, ctx.cap = 128, 16
    yield
    ctx.prec, ctx.cap = before


def holds(ball, number):
    """Whether a ball holds a number of fifty digits, these rounded."""
    with ctx.workprec(400):
        digits = arb(mpmath.nstr(number, 49))
        slack = abs(digits) * arb(10) ** -47 + arb(10) ** -60
        return ball.overlaps(digits + arb(0, 1) * slack)


def kernels_of(model, free, flights):
    kernels = Kernels(model, free)
    ends = [(f"flight_{a}_{b}", 4) for a, b in flights]
    motions = [(f"motion_{a}", 3) for a in sorted({a for a, _ in flights})]
    return [(kernels.kernel(name), count) for name, count in (*ends, *motions, ("setup", 0))]


def arguments(kernel, count, model, rng):
    """Random arguments of a kernel: times, section coordinates and the model's parameters."""
    start, end = (rng.uniform(-1.5, 1.5, model.unknowns_per_impact - 1).tolist() for _ in "se")
    given = [rng.uniform(0.0, 4.0), *start] if count else []
    if count == 4:
        given += [given[0] + 10.0 ** rng.uniform(-6.0, 0.7), *end]
    elif count == 3:
        given.append(10.0 ** rng.uniform(-6.0, 0.7))
    return given + [value * rng.uniform(0.8, 1.2) for value in model.values.values()]


RADII = (0.0, 0.0, 1e-30, 1e-12, 1e-6, 1e-3)
"""Of arguments, relative: half of them are numbers, the others stand for all numbers nearby."""


def misses(model, free, flights, tries, seed=1):
    """Results of kernels that are not in their enclosures, of so many random arguments each.

    The arguments are balls, and the exact ones anywhere in them, at their ends as often as not.
    """
    rng, found = np.random.default_rng(seed), 0
    names = balls.balls(128)
    for kernel, count in kernels_of(model, free, flights):
        enclosed, exact = evaluate_in(kernel, names), evaluate_in(kernel, EXACT)
        for _ in range(tries):
            given = arguments(kernel, count, model, rng)
            radii = [abs(x) * rng.choice(RADII) for x in given]
            within = [rng.choice((-1.0, 1.0, rng.uniform(-1.0, 1.0))) for _ in given]
            wide = [arb(x, radius) for x, radius in zip(given, radii, strict=True)]
            first = [balls.Time(wide[0])] if count else []
            results = enclosed(*first, *wide[len(first) :])
            numbers = zip(given, radii, within, strict=True)
            digits = exact(*(MP.mpf(x) + MP.mpf(radius) * MP.mpf(u) for x, radius, u in numbers))
            pairs = zip(flat(results), flat(digits), strict=True)
            enclosures = [(number(x), y) for x, y in pairs]
            found += any(not (x.is_finite() and holds(x, y)) for x, y in enclosures)
    return found


@pytest.mark.parametrize(
    ("model", "free", "flights"),
    [
        (PAIR, "s", NAMES["pair"]),
        (RICH, "A", ("BT",)),
        (LIGHT, "omega", NAMES["oscillator"]),
        (HEAVY, "sigma", NAMES["oscillator"]),
        (BALL, "a", ("PP",)),
    ],
    ids=["pair", "harmonics", "light damping", "heavy damping", "ball"],
)
def test_enclosures_hold_fifty_digits(model, free, flights):
    assert misses(model, free, flights, 15) == 0


@pytest.mark.parametrize("free", ["sigma", "omega"])
def test_linear_flights_are_enclosed(free):
    """The frequency is one of the numbers of the matrix: its derivatives are blocks of it."""
    assert misses(RATTLING, free, ("RL",), 4) == 0


@pytest.mark.parametrize("moving", ["number", "time", "both"])
def test_power_series_of_linear_flights_are_enclosed(moving):
    """A number that changes along a line: its powers have coefficients of every order."""
    shape, numbers = linear_flow.Shape(1, 1, 0), [-1.3, -0.1, 0.7, 0.2, 0.1, 1.7]
    dt, by_time, by_number = 2.0, moving != "number", moving != "time"
    time = arb_series([arb(dt, 1e-3), 1], prec=5) if by_time else arb(dt, 1e-3)
    given = [arb(x) for x in numbers]
    if by_number:
        given[0] = arb_series([arb(numbers[0], 1e-6), 1], prec=5)
    found = balls.balls(128).names["flow"](*shape, time, *given)
    at, start = MP.mpf("2.0004"), MP.mpf(numbers[0]) + MP.mpf("7e-7")

    def entry(i, e):
        others = [MP.mpf(x) for x in numbers[1:]]
        moved = (at + e * by_time, start + e * by_number)
        return EXACT.names["flow"](*shape, moved[0], moved[1], *others)[i]

    for i in (0, 7, 13, 19):
        exact = MP.taylor(lambda e, i=i: entry(i, e), 0, 4)
        for n, digits in enumerate(exact):
            with ctx.workprec(200):
                slack = arb(0, 1) * (abs(arb(mpmath.nstr(digits, 20))) * 1e-9 + 1e-12)
                assert (found[i][n] + slack).overlaps(arb(mpmath.nstr(digits, 30))), (i, n)
                assert float(found[i][n].rad()) < 0.1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "free", "flights", "tries"),
    [
        (PAIR, "s", NAMES["pair"], 10_000),
        (RICH, "A", ("BT",), 2_000),
        (LIGHT, "omega", NAMES["oscillator"], 10_000),
        (HEAVY, "sigma", NAMES["oscillator"], 2_000),
        (BALL, "a", ("PP",), 10_000),
        (RATTLING, "omega", ("RL", "RR"), 500),
        (DAMPER, "d", ("RL",), 200),
    ],
    ids=["pair", "harmonics", "light damping", "heavy damping", "ball", "two stops", "damper"],
)
def test_enclosures_hold_fifty_digits_at_many_arguments(model, free, flights, tries):
    assert misses(model, free, flights, tries, seed=7) == 0


ARGUMENTS = [0.0, 1e-300, -1e-300, 1e-9, -1e-9, 0.3, -0.3, 0.5, 3.7, -3.7, 40.0, 1e4, -400.0, 1e8]


@pytest.mark.parametrize("k", range(plain.HIGHEST + 1))
def test_stumpff_functions_are_enclosed(k):
    rng = np.random.default_rng(k)
    for q in [*ARGUMENTS, *rng.uniform(-20.0, 60.0, 6).tolist()]:
        for radius in (0.0, 1e-12, 0.25):
            (found,) = balls.stumpff([k], arb(q, radius))
            for part in (-1.0, 0.3, 1.0):
                exact = EXACT.names[f"stumpff{k}"](MP.mpf(q) + MP.mpf(radius) * part)
                assert holds(found, exact), (q, radius, part)


@pytest.mark.parametrize("q", [0.0, 0.02, -0.3, 0.7, 5.0, 90.0, -7.0])
@pytest.mark.parametrize("k", [1, 3, 5])
def test_taylor_coefficients_of_stumpff_functions_are_enclosed(k, q):
    (found,) = balls.stumpff([k], arb_series([arb(q, 1e-3), 1, 2], prec=7))
    at = MP.mpf(q) + MP.mpf("7e-4")
    exact = MP.taylor(lambda e: EXACT.names[f"stumpff{k}"](at + e + 2 * e * e), 0, 6)
    for n, digits in enumerate(exact):
        with ctx.workprec(200):
            slack = arb(0, 1) * (abs(arb(mpmath.nstr(digits, 20))) * 1e-9 + 1e-12)
            assert (found[n] + slack).overlaps(arb(mpmath.nstr(digits, 30))), n


def test_rounding_the_wrong_way_is_found(monkeypatch):
    """A slope too small by a little, or a result without its radius, fails the tests above."""
    monkeypatch.setattr(balls, "_spread", lambda ball: ball.rad() * 0.9)
    found = balls.stumpff([0], arb(2.4, 1e-9))[0]
    assert holds(found, MP.cos(MP.sqrt(MP.mpf(2.4))))
    steep = balls.stumpff([3], arb(0.0, 1e-3))[0]
    assert not holds(steep, EXACT.names["stumpff3"](MP.mpf("-1e-3")))
    monkeypatch.undo()
    whole = balls.stumpff([3], arb(0.0, 1e-3))[0]
    assert holds(whole, EXACT.names["stumpff3"](MP.mpf("-1e-3")))
    exact = EXACT.names["stumpff3"](MP.mpf(0.3))
    assert not holds(balls.stumpff([3], arb(0.3))[0].mid(), exact)


def test_free_motions_are_enclosed_on_wide_times():
    rng = np.random.default_rng(4)
    for _ in range(15):
        c, k = rng.uniform(-1.0, 5.0), rng.uniform(0.01, 20.0)
        t, radius = rng.uniform(0.01, 4.0), 10.0 ** rng.uniform(-12.0, -2.0)
        for order in (1, 2):
            found = balls.balls(128).names[f"transients{order}"](arb(c), arb(k), arb(t, radius))
            for part in (-1.0, 0.6):
                at = MP.mpf(t) + MP.mpf(radius) * part
                exact = EXACT.names[f"transients{order}"](MP.mpf(c), MP.mpf(k), at)
                assert all(holds(x, y) for x, y in zip(found, exact, strict=True))


def test_what_is_not_decided_is_refused():
    names = balls.balls(128).names
    assert names["floor"](arb(2.5, 0.25)) == 2
    with pytest.raises(balls.UndecidedError, match="floor"):
        names["floor"](arb(3.0, 0.25))
    with pytest.raises(balls.UndecidedError, match="sign"):
        names["abs"](arb_series([arb(0, 1), 1], prec=2))
    assert names["abs"](arb_series([arb(-2), 1], prec=2))[1] == -1


def test_whole_periods_make_no_difference():
    """On a ball across the beginning of a period, too: one number of turns is taken for all of
    it."""
    kernel = evaluate_in(Kernels(PAIR, "s").flight("B", "T"), balls.balls(128))
    values = [arb(v) for v in PAIR.values.values()]
    rows = [
        flat(kernel(balls.Time(arb(t, 1e-9)), arb(0.6), arb(t) + 1.25, arb(-0.4), *values))
        for t in (0.0, 2.0, -4.0)
    ]
    for row in rows[1:]:
        assert all(number(x).overlaps(number(y)) for x, y in zip(rows[0], row, strict=True))
    assert all(float(number(x).rad()) < 1e-7 for x in rows[0])
