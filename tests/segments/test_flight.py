"""Extrema of gaps against dense sampling, the paper's grazing margins, and reasons."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from zoo import unknowns_of

from contimpact.models.model import Wall
from contimpact.orbits.search import find_orbits
from contimpact.orbits.status import findings, verdict_of
from contimpact.results.branch import orbit_with
from contimpact.segments import flight as module
from contimpact.segments.flight import (
    FlightGaps,
    Touch,
    chebyshev_zeros,
    excursions,
    first_hit,
    flight_gaps,
    time_zeros,
)
from contimpact.segments.segment import ARRAYS, evaluate_in
from contimpact.systems.oscillator import Oscillator

WALLS = (Wall("B", side=+1), Wall("T", side=-1))
MESH = 4001


# Zeros of the acceleration


def sign_changes(function, left, right):
    """Cells of a mesh on which a vectorised function changes sign."""
    mesh = np.linspace(left, right, MESH)
    values = function(mesh)
    change = np.nonzero(values[:-1] * values[1:] < 0.0)[0]
    return [(mesh[i], mesh[i + 1]) for i in change]


def series(harmonics, period):
    mean, terms = harmonics[0], harmonics[1:]

    def value(t):
        total = mean + 0.0 * t
        for k, a, b in zip(terms[::3], terms[1::3], terms[2::3], strict=True):
            angle = 2 * np.pi * k * t / period
            total = total + a * np.cos(angle) + b * np.sin(angle)
        return total

    return value


def in_cell(found, cell, slack):
    return any(cell[0] - slack <= x <= cell[1] + slack for x in found)


@pytest.mark.parametrize("seed", range(40))
def test_time_zeros(seed):
    """Up to eight harmonics below order 13, with amplitudes down to 1e-18 in every other case."""
    rng = np.random.default_rng(seed)
    orders = sorted(rng.choice(np.arange(1, 13), rng.integers(1, 9), replace=False).tolist())
    smallest = -18 if seed % 2 else -3
    harmonics = [0.5 * rng.normal()]
    for k in orders:
        harmonics += [k, *(rng.normal(size=2) * 10 ** rng.uniform(smallest, 0, 2))]
    period = rng.uniform(0.5, 4.0)
    found = time_zeros(harmonics, period)
    assert found == sorted(found)
    assert all(0.0 <= t <= period for t in found)
    for cell in sign_changes(series(harmonics, period), 0.0, period):
        assert in_cell(found, cell, 1e-12)


def test_time_zeros_in_closed_form():
    """1/2 + cos(x - 1): zeros at 1 +- 2 pi/3."""
    harmonics = [0.5, 1, math.cos(1.0), math.sin(1.0)]
    expected = sorted((1.0 + sign * 2 * math.pi / 3) % (2 * math.pi) / math.pi for sign in (1, -1))
    assert time_zeros(harmonics, 2.0) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize("harmonics", [[0.0], [3.0], [1.1, 1, 0.6, 0.8], [-2.0, 1, 1.0, 0.0]])
def test_no_zeros(harmonics):
    assert time_zeros(harmonics, 2.0) == []


def test_unknown_zeros():
    assert time_zeros([math.nan], 2.0) is None


@pytest.mark.parametrize(
    ("function", "length", "expected"),
    [
        (lambda t: np.cos(20 * t), 1.0, (np.arange(6) + 0.5) * np.pi / 20),
        (lambda t: (t - 0.2) * (t - 0.2001) * (t - 2.9), 3.0, [0.2, 0.2001, 2.9]),
        (lambda t: np.exp(-10 * t) - np.exp(-10), 2.0, [1.0]),
        (lambda t: np.sin(t + 0.1), 1e-6, []),
        (lambda t: t - 4e-7, 1e-6, [4e-7]),
        (lambda t: 0.0 * t, 1.0, []),
        (lambda t: 3.0, 1.0, []),
        (lambda t: 1e-200 * np.cos(t), 2.0, [np.pi / 2]),
    ],
    ids=["cosine", "close pair", "decay", "none", "short", "zero", "constant", "tiny"],
)
def test_chebyshev_zeros(function, length, expected):
    # Measured: 1.4e-12 of the length for the close pair and the decay, whose slopes are small.
    found = chebyshev_zeros(function, length)
    assert len(found) == len(expected)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10 * length)


@pytest.mark.parametrize("rate", [1e2, 1e3, 1e4, 1e6, 1e8, 1e12])
def test_zeros_in_a_boundary_layer(rate):
    """No node of a low degree lies in the layer, and what the others see is smooth."""
    late, about = 6.0, math.log(1.5 * rate / math.sin(0.57)) / rate

    def after(t):
        return 1.5 * rate * np.exp(-rate * t) - np.sin(0.57 + t)

    expected = [
        brentq(after, 0.5 * about, 2.0 * about, rtol=1e-15),
        math.pi - 0.57,
        2 * math.pi - 0.57,
    ]
    allowed = {"rel": 1e-6, "abs": 1e-8}
    assert chebyshev_zeros(after, late) == pytest.approx(expected, **allowed)
    before = chebyshev_zeros(lambda t: after(late - t), late)
    assert [late - t for t in reversed(before)] == pytest.approx(expected, **allowed)


@pytest.mark.full
def test_touches_of_overdamped_flights(oscillator, kernels_of):
    """Against the extrema on a mesh that is fine next to the start."""
    generator, met = np.random.default_rng(5), 0
    kernels = kernels_of(oscillator(a=1.0, omega=1.0, c=0.1, k=1.0, sigma=1.0, r=0.8), "sigma")
    motion = evaluate_in(kernels.motion("S"), ARRAYS)
    for _ in range(30):
        c, k = 10.0 ** generator.uniform(1, 8), generator.choice([1.0, 100.0])
        values = [c * generator.uniform(0.3, 3), 1.0, c, k, generator.uniform(-0.3, 0.9), 0.8]
        t0, v, length = generator.uniform((0.0, 0.0, 3.0), (6.28, 1.0, 12.0))
        inside = np.geomspace(1e-12, length, 4000), np.linspace(0.0, length, 4000)[1:]
        mesh = np.unique(np.concatenate(inside))
        x, speed, _ = motion(t0, v, mesh, *values)
        turns = np.flatnonzero((speed[:-1] > 0.0) & (speed[1:] <= 0.0))
        turns = turns[:-1] if speed[-1] < 0.0 else turns  # it reaches the stop from outside
        impacts = np.array([[t0, v], [t0 + length, speed[-1]]])
        (touch,) = flight_gaps(kernels, "SS", values, impacts, length + 1.0)[0].touches
        assert (touch is None) == (len(turns) == 0)
        if touch is not None:
            met += 1
            assert -touch.gap == pytest.approx(np.max(x[turns]), abs=1e-5 * np.max(np.abs(x)))
    assert met > 10


@pytest.mark.full
def test_rounding_alone_has_no_zeros_and_fast_oscillation_keeps_its_own():
    """However small, an oscillation above the bound is none of it."""
    calls = []

    def noise(t):
        calls.append(t)
        return (1.0 + 1e-3 * np.cos(t)) - 1.0 - 1e-3 * np.cos(t)

    assert chebyshev_zeros(noise, 6.0, rounding=lambda t: 4e-16) == []
    assert len(calls) < 10

    def fast(t):
        return 1e-9 * np.cos(1000.0 * t) + noise(t)

    count = 1000.0 * 6.0 / np.pi
    found = np.unique(np.round(chebyshev_zeros(fast, 6.0, rounding=lambda t: 4e-16), 7))
    assert len(found) == pytest.approx(count, abs=1.0)

    def fading(t):
        return np.exp(-40.0 * t) * np.cos(60.0 * t) + noise(t)

    kept = chebyshev_zeros(fading, 6.0, rounding=lambda t: 4e-16)
    early = np.unique(np.round([t for t in kept if t < 0.51], 9))
    assert early == pytest.approx((2 * np.arange(10) + 1) * np.pi / 120.0, abs=1e-8)
    assert len(kept) < 1000


def test_a_slow_forcing_turns_a_flight_by_accelerations_that_are_rounding():
    """Critically damped, x = cos(omega t) to 2 omega but for the first moments after the impact at
    0.3: the flight passes the stop by 0.7 although no acceleration after them is above rounding."""
    omega = 1e-8
    model = Oscillator(a=1.0, omega=1.0, c=2.0, k=1.0, sigma=0.3, r=0.7)
    find_orbits(model, "S", parameter="omega", starts=20, rounds=1)  # formulas are checked here
    model = model.replace(omega=omega)
    angle = 2.0 * np.pi - np.arccos(0.3)
    impact = np.array([angle / omega, -omega * np.sin(angle), omega])
    orbit = orbit_with(model, ("S", 1), "omega", impact)
    assert orbit.smallest_gap == pytest.approx(-0.7, abs=1e-7)
    assert not orbit.physical


def test_chebyshev_zeros_in_halves(monkeypatch):
    """What the highest degree does not resolve is cut: its zeros are found, in order, and cuts."""
    monkeypatch.setattr(module, "_DEGREES", (8, 16))
    found = np.array(chebyshev_zeros(lambda t: np.cos(20 * t), 3.0))
    assert np.all(np.diff(found) > 0.0)
    nearest = np.min(np.abs(found[:, None] - (np.arange(19) + 0.5) * np.pi / 20), axis=0)
    assert np.max(nearest) < 1e-13


# Excursions of single flights


def all_excursions(motion, length, arriving, breaks):
    """Highest maximum and lowest minimum of a flight whose impacts both run the right way."""
    left = -math.copysign(1.0, motion(0.0)[1])
    reached = math.copysign(1.0, arriving)
    return excursions(
        lambda head, dt, values: motion(dt),
        (0, 0.0),
        (),
        (length, arriving, left, reached),
        breaks,
        0.0,
        math.inf,
    )[:4]


def check_excursions(motion, vectorised, length, zeros):
    """Compare with a mesh: nothing beyond what was found, and what was found is a turning point."""
    speed = motion(length)[1]
    high, when_high, low, when_low = all_excursions(
        motion, length, speed, [t for t in zeros if 0.0 < t < length]
    )
    mesh = np.linspace(0.0, length, MESH)
    displacement = np.broadcast_to(vectorised(mesh)[0], mesh.shape)
    ends = [0.0, motion(length)[0]]
    rounding = 1e-14 * max(1.0, float(np.max(np.abs(displacement))))
    assert np.max(displacement) <= max([high] * (high == high) + ends) + rounding
    assert np.min(displacement) >= min([low] * (low == low) + ends) - rounding
    for extreme, dt, maximum in ((high, when_high, True), (low, when_low, False)):
        if math.isnan(extreme):
            continue
        shift, velocity, acceleration = motion(dt)
        assert shift == pytest.approx(extreme, abs=rounding)
        # A turning time is known to 1e-9 of its bracket, and the displacement to the square.
        assert abs(velocity) <= 1e-14 * (1.0 + abs(speed)) + 2e-9 * abs(acceleration) * length
        assert abs(acceleration) < 1e-6 or (acceleration < 0.0) == maximum
    turns = np.nonzero(np.diff(np.sign(np.diff(displacement))) != 0)[0] + 1
    tops = [displacement[i] for i in turns if displacement[i] > displacement[i - 1]]
    bottoms = [displacement[i] for i in turns if displacement[i] < displacement[i - 1]]
    assert not tops or max(tops) <= high + rounding
    assert not bottoms or min(bottoms) >= low - rounding


@pytest.mark.parametrize("speed", [-1e-17, 0.0, 1e-17])
@pytest.mark.parametrize("push", [-1.0, 1.0])
@pytest.mark.parametrize("backwards", [False, True])
def test_beside_an_impact_at_rest_the_acceleration_tells_whose_an_excursion_is(
    speed, push, backwards
):
    """Pushed beyond its wall, a flight passes it whatever the sign of a velocity that is rounding;
    pushed back, it does not."""

    def motion(_head, dt, _values):
        s = math.pi - dt if backwards else dt
        way = -1.0 if backwards else 1.0
        moved = push * (1.0 - math.cos(2.0 * s)) / 4.0 + speed * s
        return moved, way * (push * math.sin(2.0 * s) / 2.0 + speed), push * math.cos(2.0 * s)

    zeros = [0.25 * math.pi, 0.75 * math.pi]
    arriving = motion(None, math.pi, None)[1] if not backwards else -speed
    high, *_ = excursions(motion, (), (), (math.pi, arriving, 1.0, 1.0), zeros, 0.0, math.inf)
    assert (high > 0.49) == (push > 0.0)
    assert push > 0.0 or not high > 0.0


def tiled(zeros, period, start, length):
    """Zeros of a periodic function inside a flight, as times after its start."""
    first = math.floor(start / period)
    turns = range(first, first + int(length / period) + 3)
    return sorted(zero + n * period - start for n in turns for zero in zeros)


FLIGHT = {
    "start": st.floats(0.0, 50.0),
    "speed": st.floats(-2.0, 2.0),
    "length": st.floats(-6.0, 1.0).map(lambda x: 10**x),
}
SETTINGS = settings(deadline=None, derandomize=True, max_examples=60, database=None)


@pytest.mark.parametrize(
    "forcing", ["cos(pi*t)", "cos(pi*t)**3", "cos(pi*t+0.3)+sin(4*pi*t)/5-1/8", "exp(cos(pi*t))/3"]
)
@SETTINGS
@given(**FLIGHT)
@pytest.mark.quick(1)
def test_excursions_of_the_pair(pair, kernels_of, forcing, start, speed, length):
    model = pair(forcing=forcing, beta=-0.3)
    kernels, p = kernels_of(model, "s"), list(model.values.values())
    kernel = kernels.motion("B")
    zeros = tiled(time_zeros(kernels.harmonics(*p), 2.0), 2.0, start, length)
    check_excursions(
        lambda dt: kernel(start, speed, dt, *p),
        lambda dt: evaluate_in(kernel, ARRAYS)(start, speed, dt, *p),
        length,
        zeros,
    )


@pytest.mark.parametrize("c", [0.0, 0.1, 2.0, 5.0, -0.3])
@SETTINGS
@given(**FLIGHT)
@pytest.mark.quick(2)
def test_excursions_of_the_oscillator(oscillator, kernels_of, c, start, speed, length):
    model = oscillator(c=c)
    kernels, p = kernels_of(model, "omega"), list(model.values.values())
    kernel = kernels.motion("S")

    def vectorised(dt):
        return evaluate_in(kernel, ARRAYS)(start, speed, dt, *p)

    check_excursions(
        lambda dt: kernel(start, speed, dt, *p),
        vectorised,
        length,
        chebyshev_zeros(lambda dt: vectorised(dt)[2], length),
    )


# The first arrival at a wall


@SETTINGS
@given(low=st.floats(-3.0, -1e-3), high=st.floats(1e-3, 3.0), **FLIGHT)
def test_first_hit(pair, kernels_of, low, high, start, speed, length):
    """The first of the mesh's crossings, or an earlier excursion between two of its points."""
    model = pair(forcing="cos(pi*t+0.3)+sin(4*pi*t)/5-1/8")
    kernels, p = kernels_of(model, "s"), list(model.values.values())
    kernel = kernels.motion("B")
    head = (start, speed)
    zeros = tiled(time_zeros(kernels.harmonics(*p), 2.0), 2.0, start, length)
    breaks = [*(t for t in zeros if 0.0 < t < length), length]
    after = kernel(*head, 0.0, *p)[1]
    side, dt, arrival, rising = first_hit(
        kernels.motions, (0, *head), p, breaks, 0.0, after > 0, low, high
    )
    mesh = np.linspace(0.0, length, MESH)
    x = evaluate_in(kernel, ARRAYS)(*head, mesh, *p)[0]
    outside = np.nonzero((x >= high) | (x <= low))[0]
    if side == 0:
        assert len(outside) == 0
        assert dt == length
        return
    assert rising == (side > 0)
    assert arrival * side >= 0.0
    now = kernel(*head, dt, *p)
    assert now[0] == pytest.approx(high if side > 0 else low, abs=1e-14 + 1e-15 * length)
    assert arrival == pytest.approx(now[1], abs=2e-8 if abs(arrival) < 1e-7 else 1e-13)
    if len(outside):
        assert dt <= mesh[outside[0]] * (1 + 1e-14)
    before = x[mesh < dt * (1 - 1e-12)]
    assert np.all(before < high + 1e-14)
    assert np.all(before > low - 1e-14)


def parabola(speed, acceleration):
    return lambda t: (speed * t + acceleration * t**2 / 2, speed + acceleration * t, acceleration)


NOWHERE = (pytest.approx(math.nan, nan_ok=True),) * 2


def test_excursions_of_a_parabola():
    found = all_excursions(parabola(1.0, -2.0), 3.0, -5.0, [])
    assert found == (0.25, 0.5, *NOWHERE)
    assert all_excursions(parabola(1.0, -2.0), 0.4, 0.2, []) == NOWHERE * 2
    assert all_excursions(parabola(1.0, 2.0), 3.0, 7.0, []) == NOWHERE * 2


def test_excursions_from_rest():
    """Leaving or arriving with no velocity is not a turning point inside the flight."""
    assert all_excursions(parabola(0.0, -2.0), 1.0, -2.0, []) == NOWHERE * 2
    assert all_excursions(parabola(0.0, 2.0), 1.0, 2.0, []) == NOWHERE * 2
    assert all_excursions(parabola(-2.0, 2.0), 1.0, 0.0, []) == NOWHERE * 2
    rest = all_excursions(parabola(-1e-9, 1.0), 1.0, 1.0 - 1e-9, [])
    assert rest[:2] == NOWHERE
    assert rest[3] == pytest.approx(1e-9, rel=1e-12)


def test_excursions_that_belong_to_an_impact_running_the_wrong_way_are_left_out():
    """Upwards from a wall above, and back to it from above: one turn, either impact's."""

    def motion(head, dt, values):
        return parabola(1.0, -2.0)(dt)

    def found(left_side, reached_side):
        return excursions(
            motion, (0, 0.0), (), (1.0, -1.0, left_side, reached_side), [], 0.0, math.inf
        )[:4]

    assert found(1.0, -1.0) == NOWHERE * 2
    assert found(-1.0, 1.0) == NOWHERE * 2
    assert found(-1.0, -1.0) == (0.25, 0.5, *NOWHERE)


def test_the_slowest_turn_is_the_speed_nearest_to_zero_where_the_acceleration_vanishes():
    """x = dt^3/3 - dt^2 + c dt: the velocity is least at dt = 1, where it is c - 1."""
    for c in (0.9, 1.0, 1.1):

        def motion(head, dt, values, c=c):
            return dt**3 / 3.0 - dt**2 + c * dt, dt**2 - 2.0 * dt + c, 2.0 * dt - 2.0

        found = excursions(motion, (0, 0.0), (), (3.0, 3.0 + c, -1.0, 1.0), [1.0], 0.0, math.inf)
        assert found[4] == pytest.approx(c - 1.0, abs=1e-15)
        assert math.isnan(found[0]) == (c >= 1.0)
    assert math.isnan(
        excursions(motion, (0, 0.0), (), (0.9, 1.0, -1.0, 1.0), [1.0], 0.0, math.inf)[4]
    )


# Gaps of orbits


def dense_gaps(orbit):
    """Smallest gaps of every flight and wall at interior turning points, from a mesh.

    Turning points are local extrema of the mesh; an excursion that belongs to an impact running
    the wrong way is left out as the documentation says: the first turn outwards after leaving
    outwards, the last before arriving from outside.
    """
    problem = orbit.problem
    p = problem.values(orbit.unknowns)
    setup = problem.kernels.setup(*p)
    walls = {wall.name: wall.side for wall in problem.model.WALLS}
    places = dict(zip(walls, setup.walls, strict=True))
    impacts = problem.impacts(orbit.unknowns)
    times = np.append(impacts[:, 0], impacts[0, 0] + problem.word.period * setup.period)
    speeds = np.append(impacts[:, 1], impacts[0, 1])
    result = []
    for k, (a, b) in enumerate(problem.kinds):
        kernel = problem.kernels.motion(a)
        mesh = np.linspace(0.0, times[k + 1] - times[k], MESH)
        x = places[a] + evaluate_in(kernel, ARRAYS)(times[k], speeds[k], mesh, *p)[0]
        turns = np.nonzero(np.diff(np.sign(np.diff(x))) != 0)[0] + 1
        rises = [bool(x[i] > x[i - 1]) for i in turns]
        after = kernel(times[k], speeds[k], 0.0, *p)[1]
        turning = list(zip(turns, rises, strict=True))
        if turning and after * walls[a] > 0 and turning[0][1] == (walls[a] > 0):
            turning = turning[1:]
        if turning and speeds[k + 1] * walls[b] < 0 and turning[-1][1] == (walls[b] > 0):
            turning = turning[:-1]
        for name, side in walls.items():
            gaps = [side * (places[name] - x[i]) for i, top in turning if top == (side > 0)]
            result.append((k, name, min(gaps) if gaps else None))
    return result


def check_gaps(orbit):
    found = [
        (k, wall.name, touch)
        for k, flight in enumerate(orbit.linearisation.gaps)
        for wall, touch in zip(orbit.model.WALLS, flight.touches, strict=True)
    ]
    for (k, wall, touch), (k_dense, wall_dense, gap) in zip(found, dense_gaps(orbit), strict=True):
        assert (k, wall) == (k_dense, wall_dense)
        assert (touch is None) == (gap is None)
        if touch is not None:
            assert (touch.flight, touch.wall) == (k, wall)
            # The mesh's extremum is off by half a cell at most: acceleration h^2/8, h < 5e-3.
            assert touch.gap - 1e-13 <= gap <= touch.gap + 1e-5
            assert orbit.times[k] < touch.time < orbit.times[k] + 20.0


@pytest.mark.parametrize(
    ("word", "given"),
    [
        ("1:1", {"d": 0.242}),
        ("1:1", {"d": 0.205}),
        ("2:1", {"d": 0.174}),
        ("1:1/2T", {"d": 0.233}),
        ("2:1", {"d": 0.1132, "A": 13.7478, "r": 0.25}),
        ("2:1/2T", {"d": 0.12484, "A": 12.466, "r": 0.25}),
        ("1:0/2T", {"d": 0.3}),
        ("BT/3T", {"d": 1.5, "r": 0.8}),
        ("B/3T", {"d": 0.3, "r": 0.8}),
    ],
)
def test_gaps_of_pair_orbits(pair, kernels_of, word, given):
    model = pair(**given)
    found = find_orbits(model, word, kernels=kernels_of(model, "s"), starts=64)
    assert found
    for orbit in found:
        check_gaps(orbit)


@pytest.mark.parametrize(
    ("forcing", "word"),
    [
        ("cos(pi*t)**3", "1:0"),
        ("cos(pi*t)**3", "1:1"),
        ("cos(pi*t+0.3)+sin(4*pi*t)/5-1/8", "1:1"),
        ("cos(pi*t+0.3)+sin(4*pi*t)/5-1/8", "2:1"),
    ],
)
@pytest.mark.quick(3)
def test_gaps_with_several_harmonics(pair, kernels_of, forcing, word):
    model = pair(forcing=forcing, d=0.15, r=0.4)
    found = find_orbits(model, word, kernels=kernels_of(model, "s"), starts=64)
    assert found
    for orbit in found:
        check_gaps(orbit)


@pytest.mark.parametrize("c", [0.0, 0.1])
@pytest.mark.parametrize("word", ["S", "S/2T", "S/5T", "SS/3T"])
def test_gaps_of_oscillator_orbits(oscillator, kernels_of, word, c):
    model = oscillator(c=c, omega=6.3, sigma=0.001, r=0.7)
    found = find_orbits(model, word, kernels=kernels_of(model, "omega"), starts=64)
    assert found
    for orbit in found:
        check_gaps(orbit)


# The paper's numbers


@pytest.mark.parametrize(
    ("word", "given", "velocity", "gap"),
    [
        ("1:1", {"d": 0.205}, 0.63746038, 0.0003493),  # Fig. 7(f)
        ("1:1", {"d": 0.216567, "A": 7.186, "r": 0.25}, 0.63740979, 0.001648),  # Fig. 8(b)
        ("1:1", {"d": 0.194872, "A": 7.986, "r": 0.25}, 0.60388364, -0.0122018),  # Fig. 8(d)
        ("2:1", {"d": 0.1132, "A": 13.7478, "r": 0.25}, 0.47222962, -0.0008965),  # Fig. 8(h)
    ],
)
def test_margins_of_the_paper(pair, kernels_of, word, given, velocity, gap):
    model = pair(**given)
    found = find_orbits(model, word, kernels=kernels_of(model, "s"))
    (orbit,) = [o for o in found if abs(o.velocities[0] - velocity) < 1e-7]
    assert orbit.linearisation.verdict.smallest_gap == pytest.approx(gap, abs=6e-8, rel=2e-4)
    assert orbit.physical == (gap > 0.0)


def test_contained_is_false_in_figure_5b(pair, kernels_of):
    """A = 7.8, r = 0.25, s = 0.5: out of the capsule by 0.00904."""
    model = pair(A=7.8, r=0.25, s=0.5)
    orbit = find_orbits(model, "1:1", kernels=kernels_of(model, "s"))[0]
    assert orbit.linearisation.verdict.smallest_gap == pytest.approx(-0.00904, abs=5e-6)
    assert orbit.reason.startswith("flight 1 (B to T) passes wall B by 0.00903")
    assert orbit.stable
    assert not orbit.physical


@pytest.mark.parametrize(
    ("word", "given", "wall", "flight"),
    [
        ("1:1", {"d": 0.20445492649}, "B", 0),  # Fig. 7: ghost G[1:1->2:1]
        ("2:1", {"d": 0.17369915135}, "B", 1),  # Fig. 7: G[2:1->3:1]
        ("1:1", {"d": 0.21377314088, "r": 0.25}, "B", 0),  # Fig. 8: G[1:1->2:1]
        ("2:1", {"d": 0.11477162872, "r": 0.25}, "T", 2),  # Fig. 8: ghost G[2:1->2:2]
    ],
)
def test_grazings(pair, kernels_of, word, given, wall, flight):
    """At the critical d, known to 11 digits, the gap vanishes and changes sign beside it."""
    if "r" in given:  # Fig. 8 varies A at s = 0.5 m
        given = given | {"A": 1.55625 / given["d"]}
    gaps = []
    for side in (-1e-7, 0.0, 1e-7):
        model = pair(**given | {"d": given["d"] + side})
        found = find_orbits(model, word, kernels=kernels_of(model, "s"))
        touches = [
            touch
            for orbit in found
            if np.all(
                orbit.velocities * np.where(np.array(list(orbit.word.walls)) == "B", 1, -1) > 0
            )
            for touch in orbit.linearisation.gaps[flight].touches
            if touch is not None and touch.wall == wall
        ]
        gaps.append(min((touch.gap for touch in touches), key=abs))
    assert abs(gaps[1]) < 2e-11  # measured: 2.9e-12; d is rounded to 1e-11
    assert gaps[0] < 0.0 < gaps[2]


# Verdicts and their reasons


def test_wrong_way(pair, kernels_of):
    """The second 1:1 orbit of Fig. 7(b) solves the maps with the ball behind the top."""
    model = pair(d=0.242)
    orbit = find_orbits(model, "1:1", kernels=kernels_of(model, "s"))[1]
    assert orbit.velocities[0] == pytest.approx(0.157103, abs=1e-6)
    assert not orbit.physical
    assert orbit.reason == "impact 2 on wall T runs the wrong way: velocity 0.0306042"
    forgiven = orbit.linearisation.judge(forgive_impacts={1})
    assert (forgiven.physical, forgiven.reason) == (True, None)


def test_excursion_of_a_wrong_way_impact_is_no_touch(pair, problem_of):
    """Leaving B outwards, the ball turns outside: that belongs to the impact."""
    problem = problem_of(pair(), "BT", "s")
    z = unknowns_of(problem, [0.9, 2.2], [-0.05, -0.4])
    gaps = problem.evaluate(z).gaps
    p = problem.values(z)
    motion = problem.kernels.motion("B")
    assert motion(0.9, -0.05, 0.0, *p)[1] > 0.0
    assert max(motion(0.9, -0.05, dt, *p)[0] for dt in np.linspace(0, 0.1, 50)) > 0.0
    assert gaps[0].touches[0] is None or gaps[0].touches[0].gap > 0.0
    reason = problem.evaluate(z).verdict.reason
    assert reason == "impact 1 on wall B runs the wrong way: velocity -0.05"


def test_impacts_out_of_order(pair, problem_of):
    problem = problem_of(pair(), "BT", "s")
    verdict = problem.evaluate(unknowns_of(problem, [1.0, 0.9], [0.6, -0.5])).verdict
    assert not verdict.physical
    assert verdict.reason == "impacts out of order: flight 1 (B to T) lasts -0.1"


def test_no_duration(pair, problem_of):
    """A flight without duration has no interior: nothing to touch, nothing out of order."""
    problem = problem_of(pair(), "BBT", "s")
    here = problem.evaluate(unknowns_of(problem, [0.5, 0.5, 1.5], [0.6, 0.1, -0.5]))
    duration, touches, slowest, beyond = dataclasses.astuple(here.gaps[0])
    assert (duration, touches, beyond) == (0.0, (None, None), ())
    assert math.isnan(slowest)
    assert "out of order" not in (here.verdict.reason or "")


def test_oscillator_passes_its_stop(oscillator, kernels_of):
    """sigma = -0.06, omega = 3.7, r = 0.8: the (1, 2) orbit that is not physical."""
    model = oscillator(sigma=-0.06)
    orbit = find_orbits(model, "S/2T", kernels=kernels_of(model, "omega"))[0]
    assert orbit.reason.startswith("flight 1 (S to S) passes wall S by 0.0497482 at t = 0.73217")
    check_gaps(orbit)


def verdict(gaps, velocities=(0.5, -0.5), **forgiven):
    """Judge BT with these gaps (flight, wall, gap)."""
    flights = [
        FlightGaps(
            1.0,
            tuple(
                next((Touch(k, w, 0.5 + k, g) for f, w, g in gaps if (f, w) == (k, wall)), None)
                for wall in "BT"
            ),
        )
        for k in range(2)
    ]
    impacts = np.column_stack([[0.0, 1.0], velocities])
    found = findings("BT", WALLS, impacts, flights, **forgiven)
    return verdict_of(found, "BT", WALLS)


def test_judge_without_touches():
    found = verdict([])
    assert (found.physical, found.reason) == (True, None)
    assert math.isnan(found.smallest_gap)


def test_judge_takes_the_smallest_gap():
    found = verdict([(0, "B", 0.3), (0, "T", 0.1), (1, "T", 0.2)])
    assert (found.physical, found.reason, found.smallest_gap) == (True, None, 0.1)


def test_judge_touching_is_physical():
    assert verdict([(0, "B", 0.0)]).physical
    assert not verdict([(0, "B", -5e-324)]).physical


def test_judge_names_the_first_excursion():
    found = verdict([(0, "T", -0.25), (1, "B", -0.5)])
    assert found.reason == "flight 1 (B to T) passes wall T by 0.25 at t = 0.5"
    assert found.smallest_gap == -0.5


def test_judge_forgives_one_touch():
    gaps = [(0, "T", -0.25), (1, "B", 0.5)]
    found = verdict(gaps, forgive_touches=[(0, "T")])
    assert (found.physical, found.reason, found.smallest_gap) == (True, None, 0.5)
    assert not verdict(gaps, forgive_touches=[(0, "B")]).physical
    assert not verdict(gaps, forgive_touches=[(1, "T")]).physical


def test_judge_wrong_way_comes_first():
    found = verdict([(0, "T", -0.25)], velocities=(0.5, 0.125))
    assert found.reason == "impact 2 on wall T runs the wrong way: velocity 0.125"
    assert not verdict([], velocities=(-0.5, -0.5)).physical
    assert verdict([], velocities=(-0.5, -0.5), forgive_impacts={0}).physical
    assert not verdict([], velocities=(-0.5, 0.5), forgive_impacts={0}).physical
    assert verdict([], velocities=(0.0, -0.0)).physical


def test_flight_gaps_has_one_entry_per_flight(pair, kernels_of):
    model = pair()
    kernels = kernels_of(model, "s")
    impacts = np.array([[0.1, 0.6], [0.7, 0.2], [1.4, -0.5]])
    gaps = flight_gaps(kernels, "BBT", list(model.values.values()), impacts, 2.0)
    assert [flight.duration for flight in gaps] == pytest.approx([0.6, 0.7, 0.7])
    assert all(len(flight.touches) == 2 for flight in gaps)
