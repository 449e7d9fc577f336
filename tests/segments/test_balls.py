"""Kernels in ball arithmetic: enclosures hold what they enclose, to fifty digits."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest

from contimpact.segments import linear_flow
from contimpact.segments import transients as plain
from contimpact.segments.kernel import flat
from contimpact.segments.kernels import Kernels
from contimpact.segments.segment import evaluate_in
from contimpact.systems.impact_pair import ImpactPair

flint = pytest.importorskip("flint", reason="needs contimpact[certify]")
balls = pytest.importorskip("contimpact.segments.balls", reason="needs contimpact[certify]")
from fifty_digits import MP, PLAIN, holds  # noqa: E402
from flint import arb, arb_mat, arb_series, ctx  # noqa: E402

from contimpact.segments.balls import number  # noqa: E402

PAIR = ImpactPair(beta=0.5, r=0.3, A=5.0, s=0.34)


@pytest.fixture(autouse=True)
def precision():
    before = ctx.prec, ctx.cap
    ctx.prec, ctx.cap = 128, 16
    yield
    ctx.prec, ctx.cap = before


@pytest.mark.parametrize("moving", ["number", "time", "both"])
@pytest.mark.full
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
        return PLAIN.names["flow"](*shape, moved[0], moved[1], *others)[i]

    for i in (0, 7, 13, 19):
        exact = MP.taylor(lambda e, i=i: entry(i, e), 0, 4)
        for n, digits in enumerate(exact):
            with ctx.workprec(200):
                slack = arb(0, 1) * (abs(arb(mpmath.nstr(digits, 20))) * 1e-9 + 1e-12)
                assert (found[i][n] + slack).overlaps(arb(mpmath.nstr(digits, 30))), (i, n)
                assert float(found[i][n].rad()) < 0.1


@pytest.mark.parametrize(("orders", "directions"), [(1, 1), (1, 2), (4, 1), (3, 3)])
def test_exponentials_of_blocks_are_those_of_the_whole_matrix(orders, directions):
    """One that holds every block many times, and Arb's exponential."""
    rng, n = np.random.default_rng(5), 3
    parts = rng.uniform(-2.0, 2.0, (orders, directions, n, n))
    each = [linear_flow.triangular(list(p), [1.0] * directions) for p in parts]
    whole = sum(np.kron(np.eye(orders, k=k), block) for k, block in enumerate(each))
    exact = arb_mat(whole.tolist()).exp()
    found = balls.exponential([[arb_mat(a.tolist()) for a in row] for row in parts])
    for place, block in enumerate(block for row in found for block in row):
        for i, j in np.ndindex(n, n):
            assert block[i, j].overlaps(exact[i, n * place + j])
            assert float(block[i, j].rad()) < 1e-30


ARGUMENTS = [0.0, 1e-300, -1e-300, 1e-9, -1e-9, 0.3, -0.3, 0.5, 3.7, -3.7, 40.0, 1e4, -400.0, 1e8]


@pytest.mark.parametrize("k", range(plain.HIGHEST + 1))
def test_stumpff_functions_are_enclosed(k):
    rng = np.random.default_rng(k)
    for q in [*ARGUMENTS, *rng.uniform(-20.0, 60.0, 6).tolist()]:
        for radius in (0.0, 1e-12, 0.25):
            (found,) = balls.stumpff([k], arb(q, radius))
            for part in (-1.0, 0.3, 1.0):
                exact = PLAIN.names[f"stumpff{k}"](MP.mpf(q) + MP.mpf(radius) * part)
                assert holds(found, exact), (q, radius, part)


@pytest.mark.parametrize("q", [0.0, 0.02, -0.3, 0.7, 5.0, 90.0, -7.0])
@pytest.mark.parametrize("k", [1, 3, 5])
def test_taylor_coefficients_of_stumpff_functions_are_enclosed(k, q):
    (found,) = balls.stumpff([k], arb_series([arb(q, 1e-3), 1, 2], prec=7))
    at = MP.mpf(q) + MP.mpf("7e-4")
    exact = MP.taylor(lambda e: PLAIN.names[f"stumpff{k}"](at + e + 2 * e * e), 0, 6)
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
    assert not holds(steep, PLAIN.names["stumpff3"](MP.mpf("-1e-3")))
    monkeypatch.undo()
    whole = balls.stumpff([3], arb(0.0, 1e-3))[0]
    assert holds(whole, PLAIN.names["stumpff3"](MP.mpf("-1e-3")))
    exact = PLAIN.names["stumpff3"](MP.mpf(0.3))
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
                exact = PLAIN.names[f"transients{order}"](MP.mpf(c), MP.mpf(k), at)
                assert all(holds(x, y) for x, y in zip(found, exact, strict=True))


LONG_MOTIONS = [(1.0, 40.0, 6.0), (0.0, 90.0, 5.0), (30.0, 2.0, 4.0), (-1.0, 50.0, 7.0)]
LONG_MOTIONS += [(5.0, -3.0, 8.0), (100.0, 1e4, 0.7)]


@pytest.mark.parametrize(("c", "k", "t"), LONG_MOTIONS)
def test_long_free_motions_have_closed_forms(monkeypatch, c, k, t):
    """They are as narrow as the power series, of which those of a stiff stop have 3,800 bits."""
    closed, about = [], (arb(c), arb(k))
    for bound in (math.inf, balls.LONG):
        monkeypatch.setattr(balls, "LONG", bound)
        for time in (arb(t), arb(t, 1e-7), arb_series([arb(t, 1e-7), 1], prec=3)):
            found = [balls.transient(n, b, *about, time) for n, b in plain.TABLES[4]]
            series = isinstance(time, arb_series)
            closed.append([one[i] for one in found for i in range(3)] if series else found)
    for one, other in zip(closed[:3], closed[3:], strict=True):
        for x, y in zip(one, other, strict=True):
            assert x.overlaps(y)
            assert y.rad() <= 1.01 * x.rad() + 1e-30 * abs(y.mid())


def test_a_long_free_motion_of_many_decay_times():
    """Damping takes a stiff stop's motion to 1e-137 within a period."""
    exact = PLAIN.names["transients4"](MP.mpf(100), MP.mpf(10**4), MP.mpf(2 * math.pi))
    found = balls.balls(128).names["transients4"](arb(100), arb(10**4), arb(2 * math.pi))
    assert all(holds(x, y) for x, y in zip(found, exact, strict=True))
    assert all(x.rad() <= 1e-30 * abs(x.mid()) for x in found)


def test_a_time_that_is_hardly_known_says_nothing():
    found = balls.transient(0, 1, arb(100), arb(10**4), arb(3.0, 3.0))
    assert not found.is_finite()


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
