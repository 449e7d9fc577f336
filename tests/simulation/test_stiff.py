"""Flights with many fast oscillations: the first arrival is found without looking at the rest."""

from __future__ import annotations

import math

import numpy as np
import pytest

from contimpact.results.options import SETTLING
from contimpact.segments import flight
from contimpact.segments.segment import ARRAYS, evaluate_in
from contimpact.simulation import flights
from contimpact.simulation.run import State
from contimpact.simulation.settle import settle
from contimpact.simulation.simulator import Simulator


@pytest.fixture
def pieces(monkeypatch):
    """How many pieces of flights have been looked at."""
    counted, interpolated = [], flight._zeros_of_interpolant

    def spy(function, length):
        counted.append(length)
        return interpolated(function, length)

    monkeypatch.setattr(flight, "_zeros_of_interpolant", spy)
    return counted


def stiff(oscillator, kernels_of, **changes):
    model = oscillator(**{"omega": 1.0, "c": 1.0, "sigma": 0.3, "r": 0.8} | changes)
    return Simulator(model, kernels_of(model, "sigma"))


def clear_before(simulator, phase, velocity, dt):
    """Whether nothing lies beyond the stop before an arrival, at sixty places an oscillation."""
    motion = evaluate_in(simulator.machine.motions[0], ARRAYS)
    step = math.tau / math.sqrt(simulator.model.values["k"]) / 60
    count = int(min(dt / step, 600_000))
    for mesh in (np.arange(1, count) * step, dt - np.arange(1, count) * step):
        x = motion(phase, velocity, mesh, *simulator.values)[0]
        if np.any(x > 0.0):
            return False
    return True


@pytest.mark.parametrize("k", [1e4, 1e8, 1e12, 1e14])
@pytest.mark.quick(1)
def test_first_arrivals_of_a_stiff_oscillator(oscillator, kernels_of, pieces, k):
    """Three impacts took 38 s at k = 1e8; beyond 1e12 some were passed over."""
    simulator = stiff(oscillator, kernels_of, a=k, k=k)
    run = simulator.run(simulator.state("S", math.acos(0.3), 0.5), impacts=6)
    assert len(run) == 6
    assert len(pieces) < 1500
    for i in np.flatnonzero(~run.released[1:]):
        dt = float(run.times[i + 1] - run.times[i])
        assert clear_before(simulator, float(run.phases[i]), float(run.velocities[i]), dt)


def test_a_flight_of_ten_thousand_oscillations(oscillator, kernels_of, pieces):
    """Released at rest it oscillates about its slow motion, far from the stop for most of it."""
    simulator = stiff(oscillator, kernels_of, a=1e8, k=1e8)
    release = math.acos(0.3)
    side, dt, speed = simulator.fly(0, release, 0.0)
    assert side == 0
    assert dt == pytest.approx(math.tau - 2 * release, abs=2e-4)  # the slow motion comes back
    assert speed > 0.0
    assert len(pieces) < 1000
    assert clear_before(simulator, release, 0.0, dt)


@pytest.mark.full
def test_an_arrival_is_the_one_of_the_whole_window(oscillator, kernels_of, monkeypatch):
    """With all zeros of the window isolated first, as far as their number allows."""
    generator = np.random.default_rng(11)
    skipped = []
    for _ in range(25):
        k, c = 10.0 ** generator.uniform(2, 5, 2)
        a = float(k * generator.uniform(0.2, 2))
        sigma = float(generator.uniform(-0.3, 1.5) * a / k)
        c = float(c if generator.uniform() < 0.3 else generator.uniform(0, 3))
        simulator = stiff(oscillator, kernels_of, a=a, k=float(k), c=c, sigma=sigma, r=0.8)
        simulator.machine.body.longest[0] = 2
        fast = generator.choice([0.0, 1e-3, 1.0, math.sqrt(k)])
        state = float(generator.uniform(0, math.tau)), float(fast * generator.uniform())
        found = simulator.fly(0, *state)
        with monkeypatch.context() as m:
            m.setattr(flights, "keeps_clear", lambda *given: skipped.append(given))
            whole = simulator.fly(0, *state)
        assert found[0] == whole[0]
        assert found[1:] == pytest.approx(whole[1:], rel=1e-13, abs=1e-15)
    assert skipped


def test_what_is_not_resolved_does_not_keep_clear():
    nodes = flight.chebyshev_nodes(flights.NODES, 1.0)
    for rate in (300.0, 1e3, 1e4, 12345.6, 1e6):
        for size in (0.3, 1e-3):
            x = -1.0 + size * np.sin(rate * nodes)
            assert flights.keeps_clear(x, -math.inf, 40 * size - 1.0)
            assert not flights.keeps_clear(x, -math.inf, 0.99 * size - 1.0)
            assert not flights.keeps_clear(x, -1.0 - 0.99 * size, math.inf)


@pytest.mark.parametrize("rate", [2.0, 2 * math.pi, 7.3, 12.0])
def test_a_motion_between_the_nodes_is_not_passed_over(rate):
    """Its largest value was taken from the nodes, up to a part in 400 below it."""
    nodes = flight.chebyshev_nodes(flights.NODES, 1.0)
    for phase in np.linspace(0.0, 1.0, 301):
        x = np.cos(rate * (nodes - phase))
        assert not flights.keeps_clear(x, -math.inf, 1.0)
        assert not flights.keeps_clear(-x, -1.0, math.inf)
        assert flights.keeps_clear(x, -math.inf, 1.0 + 2e-5 * max(1.0, rate / 6) ** 2)


@pytest.mark.full
def test_zeros_one_after_the_other_are_all_zeros():
    def function(t):
        return np.cos(400.0 * t) + 0.3 * t

    whole = flight.chebyshev_zeros(function, 3.0)
    turn = list(flight.zeros_in_turn(function, 3.0))
    assert [zero for piece in turn for zero in piece] == whole
    assert len(turn) > 4


def test_oscillations_however_fast_are_not_rounding():
    rate = 3e9
    first = next(flight.zeros_in_turn(lambda t: np.cos(rate * t), 6.0))
    assert first[0] == pytest.approx(0.5 * math.pi / rate, rel=1e-12)
    noise = np.random.default_rng(0)
    pieces = flight.zeros_in_turn(lambda t: noise.normal(size=np.shape(t)), 6.0, cuts=2)
    assert len(list(pieces)) == 4


def test_a_phase_of_another_period(pair, kernels_of):
    """A phase beyond [0, T) was flown on from as if zeros of the acceleration lay behind it."""
    model = pair(s=0.34)
    simulator = Simulator(model, kernels_of(model, "s"))
    one = simulator.run(State(0, 0.4, 0.6, 7), impacts=20)
    other = simulator.run(State(0, 14.4, 0.6), impacts=20)
    np.testing.assert_allclose(other.times, one.times, rtol=0, atol=1e-12)
    np.testing.assert_allclose(other.velocities, one.velocities, rtol=0, atol=1e-12)
    assert simulator.run(State(0, 14.4, 0.6), periods=3).turns[-1] >= 10


@pytest.mark.parametrize("r", [0.9, 0.95])
def test_chatter_of_hundreds_of_impacts_settles_at_once(oscillator, kernels_of, monkeypatch, r):
    """The stop is left where a cos(omega t) = k sigma; of the chatter only its end is plain."""
    values = {"a": 3000.0, "omega": 1.162, "c": 100.0, "k": 7900.0, "sigma": 0.3102, "r": r}
    model = oscillator(**values)
    plain, search = [], flights.zeros_in_turn
    monkeypatch.setattr(
        flights, "zeros_in_turn", lambda *a, **k: plain.append(a) or search(*a, **k)
    )
    found = settle(Simulator(model, kernels_of(model, "sigma")), State(0, 2.77, 1e4))
    assert (found.label, found.notation) == ("S*/1T", "inf")
    (released,) = found.times[found.released]
    leaves = math.acos(7900.0 * 0.3102 / 3000.0) / 1.162
    assert released % (math.tau / 1.162) == pytest.approx(leaves, abs=1e-12)
    assert len(found.times) > SETTLING.longest
    assert found.periods < 20
    assert len(plain) < 0.02 * len(found.times) * found.periods
