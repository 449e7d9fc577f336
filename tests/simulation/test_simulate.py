"""Simulation: first arrivals against exact flights, settled orbits, chatter, sticking, exponents.

The reference for a first arrival is written from the equation of motion in mpmath and advances by
steps within which no wall can be reached: with the acceleration bounded by M, a gap g that closes
at the speed w lasts at least until w h + M h^2/2 = g.
"""

from __future__ import annotations

import importlib.util
import math
from collections import Counter, defaultdict
from itertools import pairwise

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from contimpact.errors import InputError
from contimpact.orbits.search import find_orbits
from contimpact.results.scene import read_scene
from contimpact.segments import compiling, flight
from contimpact.segments.flight import time_zeros, velocity_zero
from contimpact.segments.kernels import Kernels
from contimpact.simulation import one_coordinate
from contimpact.simulation import run as loops
from contimpact.simulation import simulator as simulate
from contimpact.simulation.run import Outcome, State, release_after
from contimpact.simulation.settle import exponents_of, settle
from contimpact.simulation.simulator import Simulator
from contimpact.systems.duffing import Duffing
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.soft_stop import SoftStop


@pytest.fixture(scope="session")
def simulator_of(kernels_of):
    """``simulator_of(model)``, with one set of kernels for all models of the same formulas."""

    def simulator(model, **options):
        parameter = "s" if "s" in model.values else "sigma"
        return Simulator(model, kernels_of(model, parameter), **options)

    return simulator


# The exact first arrival


class ExactFlight:
    """A flight of the impact pair under cos(pi t), and where it first meets a wall."""

    def __init__(self, model, wall, phase, velocity):
        p = {name: mp.mpf(value) for name, value in model.values.items()}
        self.length = p["M"] * p["omega"] ** 2 * p["s"] / (p["A"] * mp.pi**2)
        self.gravity = p["M"] * p["g"] * mp.sin(p["beta"]) / p["A"]
        self.t0 = mp.mpf(phase)
        self.out = -p["r"] * mp.mpf(velocity)
        self.start = self.length / 2 if wall == "B" else -self.length / 2
        self.wall = wall
        self.most = 1 + abs(self.gravity)

    def at(self, dt):
        """Position and velocity."""
        t1 = self.t0 + dt
        sine, cosine = mp.sin(mp.pi * self.t0), mp.cos(mp.pi * self.t0)
        speed = self.out + self.gravity * dt + (mp.sin(mp.pi * t1) - sine) / mp.pi
        moved = (
            (self.out - sine / mp.pi) * dt
            + self.gravity * dt**2 / 2
            - (mp.cos(mp.pi * t1) - cosine) / mp.pi**2
        )
        return self.start + moved, speed

    def first(self, longest=400):
        """Wall, time and velocity of the first arrival; the gap left at the end is below 1e-24."""
        dt = abs(self.out) / self.most  # the wall just left cannot be reached earlier
        other = self.length / (abs(self.out) + mp.sqrt(self.out**2 + 2 * self.most * self.length))
        dt = min(dt, other)
        while dt < longest:
            z, v = self.at(dt)
            gaps = {"B": (self.length / 2 - z, v), "T": (z + self.length / 2, -v)}
            steps = {}
            for name, (gap, closing) in gaps.items():
                if gap < mp.mpf("1e-24") and closing > -mp.mpf("1e-9"):
                    return name, dt, v
                root = mp.sqrt(max(closing**2 + 2 * self.most * gap, 0))
                steps[name] = (
                    (root - closing) / self.most
                    if closing < 0
                    else (2 * gap / (root + closing) if root + closing else mp.mpf(0))
                )
            dt += max(min(steps.values()), mp.mpf("1e-26"))
        return None, dt, None


def random_flights(pair, simulator_of, seed, count):
    """Flights of random models; an eighth each touches a wall to 1e-9 from either side, or misses.

    Yields the simulator, the wall left, phase and velocity, and the gap it was made for.
    """
    rng = np.random.default_rng(seed)
    while count:
        beta, r = rng.uniform(-1.5, 1.5), rng.uniform(0.05, 1.0)
        model = pair(beta=beta, r=r, A=rng.uniform(2.0, 15.0), d=rng.uniform(0.02, 0.8))
        wall = "BT"[rng.integers(2)]
        side = 1 if wall == "B" else -1
        phase = float(rng.uniform(0, 2))
        velocity = side * float(10 ** rng.uniform(-4, 0.2))
        simulator = simulator_of(model)
        kind = rng.integers(8)
        if kind < 2:  # the far wall is put 1e-9 before or behind the first turning point
            turn = first_turn(simulator, wall, phase, velocity, side)
            if turn is None:
                continue
            gap = 1e-9 if kind else -1e-9
            simulator = simulator_of(pair(beta=beta, r=r, A=model.values["A"], d=turn + gap))
        elif kind < 4:  # the velocity is tuned until the body returns to 1e-9 from the wall left
            gap = 1e-9 if kind == 2 else -1e-9
            tuned = grazing_velocity(simulator, wall, phase, side, gap)
            if tuned is None:
                continue
            velocity = tuned
        count -= 1
        yield simulator, wall, phase, velocity


def turns_of(simulator, wall, phase, velocity, length=4.0):
    """The turning points of a flight that no wall ends: displacement, and whether a maximum."""
    motion = simulator.kernels.motion(wall)
    zeros = time_zeros(simulator.kernels.harmonics(*simulator.values), simulator.period)
    ahead = (t - phase + w * simulator.period for w in range(3) for t in zeros)
    breaks = [t for t in ahead if 0.0 < t < length]

    def moved(head, dt, values):
        return motion(phase, velocity, dt, *values)

    times = [0.0, *breaks, length]
    speeds = [moved((), t, simulator.values)[1] for t in times]
    turns = []
    for (left, right), (u, v) in zip(pairwise(times), pairwise(speeds), strict=True):
        if (u > 0.0) != (v > 0.0):
            dt, _ = velocity_zero(moved, (), simulator.values, left, u, right, v, u / (u - v))
            turns.append((moved((), dt, simulator.values)[0], u > 0.0))
    return turns


def first_turn(simulator, wall, phase, velocity, side):
    """How far from the wall it left the body turns first, if it does."""
    turns = turns_of(simulator, wall, phase, velocity)
    if not turns:
        return None
    away = -side * turns[0][0]
    return away if 1e-3 < away < 5.0 else None


def grazing_velocity(simulator, wall, phase, side, gap):
    """A velocity with which the second turning point is `gap` before the wall."""

    def excess(speed):
        turns = turns_of(simulator, wall, phase, side * speed)
        if len(turns) < 2 or turns[1][1] != (side > 0):
            return None
        return -side * turns[1][0] - gap

    speeds = np.linspace(0.05, 1.0, 12).tolist()
    values = [excess(speed) for speed in speeds]
    for a, b, fa, fb in zip(speeds, speeds[1:], values, values[1:], strict=False):
        if fa is None or fb is None or (fa > 0) == (fb > 0):
            continue
        for _ in range(60):
            middle = 0.5 * (a + b)
            fm = excess(middle)
            if fm is None:
                return None
            a, b, fa = (middle, b, fm) if (fm > 0) == (fa > 0) else (a, middle, fa)
        return side * b
    return None


def check_first_arrivals(pair, simulator_of, seed, count):
    """Wall, time and velocity of every flight agree; the largest error by the expected scale."""
    worst, touches = 0.0, 0
    with mp.workdps(32):
        for simulator, wall, phase, velocity in random_flights(pair, simulator_of, seed, count):
            k = simulator.letters.index(wall)
            found, dt, speed = simulator.fly(k, phase, velocity)
            name, exact_dt, exact_speed = ExactFlight(
                simulator.model, wall, phase, velocity
            ).first()
            where = f"{simulator.model!r}, {wall}, {phase!r}, {velocity!r}"
            assert found >= 0, where
            assert simulator.letters[found] == name, where
            # a touch of velocity w moves by e/w when the wall does by e, its velocity likewise
            late, faster = abs(float(dt - exact_dt)), abs(float(speed - exact_speed))
            arrival = max(abs(float(exact_speed)), 1e-12)
            touches += arrival < 1e-3
            size = float(1 + exact_dt) * (1 + 1 / arrival)
            worst = max(worst, late / size, faster / size)
    assert worst < 2e-15
    return touches


@pytest.mark.full
def test_first_arrival_against_exact_flights(pair, simulator_of):
    """No wrong wall and no missed hit in 500 flights, touches to 1e-9 among them."""
    assert check_first_arrivals(pair, simulator_of, 1, 500) > 30


@pytest.mark.slow
def test_first_arrival_against_ten_thousand_exact_flights(pair, simulator_of):
    assert check_first_arrivals(pair, simulator_of, 2, 10_000) > 600


def test_a_flight_that_passes_by_hits_what_is_behind(pair, simulator_of):
    """A wall 1e-9 beyond the turning point is not hit there; 1e-9 before it is, slowly."""
    simulator = simulator_of(pair(d=0.3))
    turn = first_turn(simulator, "B", 0.8, 0.5, 1)
    near, far = (simulator_of(pair(d=turn + gap)) for gap in (-1e-9, 1e-9))
    assert near.letters[near.fly(0, 0.8, 0.5)[0]] == "T"
    assert abs(near.fly(0, 0.8, 0.5)[2]) < 1e-4
    assert far.fly(0, 0.8, 0.5)[1] > near.fly(0, 0.8, 0.5)[1] + 0.1


# Settled orbits: simulation and the orbit solver agree, sharing no solver


def random_orbits(pair, kernels_of, seed, count):
    """Stable physical orbits at random parameters, not too near to a bifurcation."""
    rng = np.random.default_rng(seed)
    words = ["1:1", "2:1", "1:1/2T", "1:2", "2:2", "3:1"]
    while count:
        model = pair(
            beta=rng.uniform(0.0, 1.4),
            r=rng.uniform(0.15, 0.7),
            A=rng.uniform(4.0, 9.0),
            d=rng.uniform(0.12, 0.45),
        )
        word = words[rng.choice(len(words), p=[0.4, 0.25, 0.15, 0.05, 0.05, 0.1])]
        kernels = kernels_of(model, "s")
        for orbit in find_orbits(model, word, kernels=kernels, starts=48, rounds=2):
            slow = np.min(np.abs(orbit.velocities)) > 1e-3
            gap = orbit.linearisation.verdict.smallest_gap
            clear = math.isnan(gap) or gap > 1e-3
            if orbit.physical and clear and slow and abs(orbit.multipliers[0]) < 0.97:
                yield orbit
                count -= 1
                break


def check_settling(pair, kernels_of, simulator_of, seed, count):
    worst = 0.0
    for orbit in random_orbits(pair, kernels_of, seed, count):
        simulator = simulator_of(orbit.model)
        word, n = orbit.word.walls, len(orbit.word)
        start = simulator.state(word[0], orbit.times[0] + 1e-7, orbit.velocities[0] * (1 + 1e-7))
        rounds = 40 + math.ceil(25 / -math.log(abs(orbit.multipliers[0])))
        run = simulator.run(start, impacts=n * rounds)
        end = simulator.run(run.end, impacts=n)
        assert end.word == word[1:] + word[0], repr(orbit)
        exact = np.roll(orbit.velocities, -1)
        worst = max(worst, float(np.max(np.abs(end.velocities - exact))))
    assert worst < 1e-9
    return worst


@pytest.mark.full
def test_simulation_settles_on_stable_orbits(pair, kernels_of, simulator_of):
    """Measured: 3e-15."""
    check_settling(pair, kernels_of, simulator_of, 3, 12)


@pytest.mark.slow
def test_simulation_settles_on_two_hundred_stable_orbits(pair, kernels_of, simulator_of):
    check_settling(pair, kernels_of, simulator_of, 4, 200)


@pytest.mark.full
def test_the_oscillator_settles_on_its_orbit(oscillator, kernels_of, simulator_of):
    """Flights whose acceleration depends on the state."""
    model = oscillator(c=0.2, r=0.6, sigma=0.0)
    orbits = find_orbits(model, "S/2T", kernels=kernels_of(model, "sigma"))
    stable = [o for o in orbits if o.stable and o.physical]
    assert stable
    simulator = simulator_of(model)
    start = simulator.state("S", stable[0].times[0], stable[0].velocities[0] * 1.001)
    run = simulator.run(start, impacts=300)
    assert abs(run.velocities[-1] - stable[0].velocities[0]) < 1e-9


# Time


def test_time_does_not_lose_digits(pair, simulator_of):
    """Complex motion after 1e12 periods is bit for bit the motion at the beginning."""
    simulator = simulator_of(pair(d=0.226))
    early = simulator.run(State(0, 0.25, 0.6), impacts=3000)
    late = simulator.run(State(0, 0.25, 0.6, turns=10**12), impacts=3000)
    assert np.array_equal(early.phases, late.phases)
    assert np.array_equal(early.velocities, late.velocities)
    assert np.array_equal(early.turns, late.turns - 10**12)
    assert np.all((early.phases >= 0) & (early.phases < 2))


def test_runs_join(pair, simulator_of):
    """A run in two parts is the run in one."""
    simulator = simulator_of(pair(d=0.226))
    whole = simulator.run(State(0, 0.25, 0.6), impacts=200)
    first = simulator.run(State(0, 0.25, 0.6), impacts=90)
    second = simulator.run(first.end, impacts=110)
    assert np.array_equal(np.append(first.velocities, second.velocities), whole.velocities)
    assert second.end == whole.end


def test_a_run_without_rows_ends_at_the_same_impact(pair, simulator_of):
    simulator = simulator_of(pair(d=0.226))
    kept = simulator.run(State(0, 0.25, 0.6), periods=50)
    blind = simulator.run(State(0, 0.25, 0.6), periods=50, record=False)
    assert blind.end == kept.end
    assert len(blind) == 0
    assert kept.end.turns == 50


# Sticking


def test_chatter_on_the_bottom_sticks_and_is_released(pair, simulator_of):
    """A = 0.62 N: gbar = 0.984 presses nearly always; release where cos(pi t) = -gbar."""
    simulator = simulator_of(pair(A=0.62, s=0.5))
    run = simulator.run(simulator.state("T", 0.1, -0.6), impacts=200)
    assert run.released.any()
    assert run.outcome is Outcome.DONE
    gbar = simulator.derived["gbar"]
    exact = math.acos(-gbar) / math.pi
    assert np.max(np.abs(run.phases[run.released] - exact)) < 1e-15
    assert set(run.walls[run.released].tolist()) == {0}
    assert [state.released for state in run.states()] == run.released.tolist()


def test_a_ball_pressed_for_ever_rests(pair, simulator_of):
    """gbar = 1.22 > 1; r = 0.3 at the bottom."""
    simulator = simulator_of(pair(A=0.5, s=0.5))
    assert simulator.derived["gbar"] > 1
    run = simulator.run(simulator.state("T", 0.1, -0.6), impacts=10**6)
    assert run.outcome is Outcome.RESTING
    assert len(run) < 60
    again = simulator.run(run.end, impacts=10)
    assert again.outcome is Outcome.RESTING
    assert len(again) == 0


@pytest.mark.parametrize("r", [0.0, 0.3, 0.9])
def test_the_time_of_sticking_is_that_of_all_impacts(pair, simulator_of, r):
    """Constant acceleration (no forcing): the geometric series, in closed form."""
    model = type(pair())(beta=0.5, r=r, A=5.0, s=0.4, forcing="0*t")
    simulator = Simulator(model)
    g = simulator.derived["gbar"]
    run = simulator.run(simulator.state("B", 0.25, 0.1), impacts=10**5)
    assert run.outcome is Outcome.RESTING
    exact = 0.25 + (2 * r * 0.1 / g / (1 - r))
    total = run.end.turns * 2 + run.end.phase
    assert abs(total - exact) < 1e-9 * max(exact, 1)


def test_no_restitution(pair, simulator_of):
    """r = 0: every landing that is pressed sticks, and the release forgets the past."""
    simulator = simulator_of(pair(r=0.0, s=0.3))
    one = simulator.run(simulator.state("T", 0.1, -0.6), impacts=40)
    other = simulator.run(simulator.state("B", 1.3, 0.2), impacts=40)
    assert one.outcome is Outcome.DONE
    assert one.released.any()
    assert one.word[-8:] in ("B*T*" * 3, "T*B*" * 3, "*T*B" * 3) or "B*T*" in one.word
    first, second = (set(run.phases[run.released][-4:]) for run in (one, other))
    assert first & second


def test_the_bouncing_ball_without_restitution(pair, simulator_of):
    """Sticking for 1 < Gamma < sqrt(1 + pi^2), Gamma = 1/gbar (Mehta and Luck, 1990): period T.

    Landing in the sticking zone, the ball leaves at the same phase in every period.
    """
    for factor in (1.2, 2.0, 3.2):
        model = pair(r=0.0, beta=math.pi / 2, s=10.0)
        p = model.values
        model = model.replace(A=p["M"] * p["g"] * factor)
        simulator = simulator_of(model)
        assert simulator.derived["gbar"] == pytest.approx(1 / factor)
        run = simulator.run(simulator.state("B", 0.3, 0.1), impacts=60)
        assert run.word.endswith(("B*B*B*", "*B*B*B"))
        assert np.ptp(run.phases[run.released]) == 0
        assert np.all(np.diff(run.turns[run.released]) == 1)


def test_beyond_the_sticking_window_the_ball_flies_longer(pair, simulator_of):
    """Gamma = 3.4 > sqrt(1 + pi^2) = 3.2969: the flight from the release lasts over a period."""
    p = pair(r=0.0, beta=math.pi / 2, s=20.0)
    simulator = simulator_of(p.replace(A=p.values["M"] * p.values["g"] * 3.4))
    zone, until = simulator.pressed(0, 1.0), release_after(simulator.machine.body, 0, 0.0)[0]
    assert not zone[0]
    assert simulator.fly(0, until, 0.0)[1] > 2.0


# Ends


def test_a_flight_without_walls_in_reach_is_given_up(oscillator, simulator_of):
    """The stop lies beyond the steady amplitude: after some impacts there are no more."""
    model = oscillator(c=0.4, sigma=3.0, r=0.5)
    simulator = simulator_of(model, longest_flight=30)
    run = simulator.run(simulator.state("S", 0.1, 2.0), impacts=1000)
    assert run.outcome is Outcome.NO_IMPACT
    assert run.end is None


def test_a_level_capsule_can_be_too_long(pair, simulator_of):
    """beta = 0 and no mean velocity: the ball oscillates by 2/pi^2 for ever."""
    simulator = simulator_of(pair(beta=0.0, d=1.0), longest_flight=20)
    assert simulator.start(0.0, 0.1, 0.0) is None


def test_a_start_between_the_walls(pair, simulator_of):
    """It arrives where the exact flight does, here from a state on an earlier flight."""
    simulator = simulator_of(pair(d=0.3))
    state = State(0, 0.4, 0.5)
    hit, dt, speed = simulator.fly(*(state.wall, state.phase, state.velocity))
    x, v, _ = simulator.kernels.motion("B")(0.4, 0.5, 0.3 * dt, *simulator.values)
    found = simulator.start(0.4 + 0.3 * dt, simulator.positions[0] + x, v)
    assert found.wall == hit
    assert found.phase + 2 * found.turns == pytest.approx(0.4 + dt, abs=1e-14)
    assert found.velocity == pytest.approx(speed, abs=1e-14)


@pytest.mark.parametrize(
    ("model", "wall"),
    [
        (Oscillator(a=1.0, omega=1.3, c=0.1, k=1.0, sigma=0.5, r=0.8), "S"),
        (SoftStop(a=1.0, omega=0.71, c=0.1, k=1.0, e=0.5, k_b=20.0, c_b=0.3), "R"),
    ],
    ids=["oscillator", "soft-stop"],
)
@pytest.mark.parametrize("phase", [0.0, 0.4, 5.0])
def test_a_start_between_the_walls_where_the_acceleration_depends_on_the_state(model, wall, phase):
    """It arrives where the flight does from which it is taken, soft stops in their first mode."""
    simulator = Simulator(model)
    speed = -0.7 if wall == "R" else 0.7
    k = simulator.letters.index(wall)
    hit, dt, arrives = simulator.fly(k, phase, speed)
    for part in (0.1, 0.5, 0.9):
        x, v, _ = simulator.kernels.motion(wall)(phase, speed, part * dt, *simulator.values)
        found = simulator.start(phase + part * dt, simulator.positions[k] + x, v)
        assert found.wall == hit
        assert found.phase + simulator.period * found.turns == pytest.approx(phase + dt, abs=1e-12)
        assert found.velocity == pytest.approx(arrives, abs=1e-12)


@pytest.mark.parametrize(("position", "velocity"), [(-0.4, 0.6), (0.1, 0.0), (0.5, -0.7)])
def test_a_start_of_an_integrated_flight(position, velocity):
    """As the flight is integrated by other means; it was refused."""
    pytest.importorskip("heyoka")
    duffing = Duffing(alpha=1.0, beta=0.2, c=0.1, a=1.0, omega=1.2, sigma=0.5, r=0.8)
    found = Simulator(duffing).start(8.0, position, velocity)

    def rates(t, y):
        return y[1], math.cos(1.2 * t) - 0.1 * y[1] - y[0] - 0.2 * y[0] ** 3

    def gap(t, y):
        return 0.5 - y[0] if t > 8.0 else 1.0

    gap.terminal = True
    given = {"events": gap, "rtol": 1e-12, "atol": 1e-13, "method": "DOP853", "max_step": 0.1}
    flight = solve_ivp(rates, (8.0, 40.0), (position, velocity), **given)
    time = found.phase + 2.0 * math.pi / 1.2 * found.turns
    assert (time, found.velocity) == pytest.approx((flight.t[-1], flight.y[1, -1]), abs=1e-9)


@pytest.mark.parametrize("phase", [0.1, 6.0])
def test_a_start_under_strong_damping(phase):
    """With c = 100 nothing is left at 6.0 of what was at t = 0, from where flights were solved for;
    of x'' + 100 x' + x = 200 cos t all is known."""
    model = Oscillator(a=200.0, omega=1.0, c=100.0, k=1.0, sigma=1.0, r=0.8)
    found = Simulator(model).start(phase, 0.2, 0.5)
    slow, fast = np.roots([1.0, 100.0, 1.0])[::-1]
    rest = np.array([0.2 - 2.0 * math.sin(phase), 0.5 - 2.0 * math.cos(phase)])
    parts = np.linalg.solve([[1.0, 1.0], [slow, fast]], rest)
    time = found.phase + 2.0 * math.pi * found.turns
    decayed = parts * np.exp(np.array([slow, fast]) * (time - phase))
    assert 2.0 * math.sin(time) + decayed.sum() == pytest.approx(1.0, abs=1e-12)
    speed = 2.0 * math.cos(time) + slow * decayed[0] + fast * decayed[1]
    assert found.velocity == pytest.approx(speed, abs=1e-11)


def test_a_start_in_another_mode_is_not_that_of_the_first():
    """On the soft stop it was the free flight, which arrives elsewhere."""
    model = SoftStop(a=1.0, omega=2.0, c=0.3, k=1.0, e=0.5, k_b=20.0, c_b=0.3)
    with pytest.raises(InputError, match="soft-stop in 'contact' are known from guards on"):
        Simulator(model).start(0.3, 0.6, 0.2, mode="contact")


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda s: s.state("X", 0.0, 1.0), "wall"),
        (lambda s: s.state("B", 0.0, -1.0), "velocity"),
        (lambda s: s.state("T", 0.0, 1.0), "velocity"),
        (lambda s: s.state("B", math.nan, 1.0), "time"),
        (lambda s: s.state("B", -math.inf, 1.0), "time"),
        (lambda s: s.state("B", 1e20, 1.0), "time"),
        (lambda s: s.state("B", 0.0, math.inf), "velocity"),
        (lambda s: s.start(math.nan, 0.0, 0.0), "time"),
        (lambda s: s.start(0.0, 0.0, math.nan), "velocity"),
        (lambda s: s.run(State(0, 0.1, 0.5)), "impacts"),
        (lambda s: s.start(0.0, 5.0, 0.0), "position"),
        (lambda s: s.start(0.0, 0.0, 0.0, "other"), "mode"),
    ],
)
def test_what_cannot_be_simulated(pair, simulator_of, call, where):
    with pytest.raises(InputError) as error:
        call(simulator_of(pair()))
    assert error.value.where == where


# Exponents


@pytest.mark.parametrize(
    ("d", "r", "impacts"), [(0.226, 0.3, 3000), (0.242, 0.3, 500), (0.3, 0.9, 2000)]
)
def test_the_sum_of_the_exponents_is_ln_r2(pair, simulator_of, d, r, impacts):
    """Flights conserve area; measured: 5e-14."""
    simulator = simulator_of(pair(d=d, r=r))
    start = simulator.run(State(0, 0.25, 0.6), periods=100, record=False).end
    found = exponents_of(simulator, start, simulator.run(start, impacts=impacts))
    assert abs(sum(found.per_impact) - 2 * math.log(r)) < 1e-6
    assert found.restitution == pytest.approx(2 * math.log(r), abs=1e-14)


def test_the_sum_of_the_exponents_with_two_restitutions(pair, simulator_of):
    simulator = simulator_of(pair(r_B=0.4, r_T=0.7, d=0.2))
    start = simulator.run(simulator.state("B", 0.25, 0.6), periods=100, record=False).end
    found = exponents_of(simulator, start, simulator.run(start, impacts=1500))
    assert abs(sum(found.per_impact) - found.restitution) < 1e-6


def test_damped_flights_contract_as_the_damping_says(oscillator, simulator_of):
    """The sum per impact is ln r^2 - c times the mean duration of a flight."""
    c = 0.2
    simulator = simulator_of(oscillator(c=c, r=0.6, sigma=0.0, omega=2.0))
    start = simulator.run(simulator.state("S", 0.1, 1.0), impacts=60).end
    found = exponents_of(simulator, start, simulator.run(start, impacts=60))
    duration = found.periods * simulator.period / found.impacts
    assert abs(sum(found.per_impact) - (2 * math.log(0.6) - c * duration)) < 1e-6


def test_exponents_of_a_periodic_orbit_are_its_multipliers(pair, simulator_of, kernels_of):
    model = pair(d=0.242)
    orbit = next(o for o in find_orbits(model, "1:1", kernels=kernels_of(model, "s")) if o.stable)
    simulator = simulator_of(model)
    start = simulator.state("B", orbit.times[0], orbit.velocities[0])
    runs = (simulator.run(start, impacts=n) for n in (1000, 3000))
    short, long = (exponents_of(simulator, start, run).per_impact[0] for run in runs)
    # the first disturbance turns into the leading direction: that part is the same in both
    assert (3 * long - short) / 2 == pytest.approx(
        math.log(abs(orbit.multipliers[0])) / 2, abs=1e-9
    )


def test_complex_motion_has_a_positive_exponent(pair, simulator_of):
    """Fig. 7(i), d = 0.226: 0.085 per impact from an independent computation."""
    simulator = simulator_of(pair(d=0.226))
    start = simulator.run(State(0, 0.25, 0.6), periods=100, record=False).end
    found = exponents_of(simulator, start, simulator.run(start, impacts=6000))
    assert abs(found.per_impact[0] - 0.0851) < 4 * found.error + 1e-3
    assert found.per_impact[0] > 10 * found.error


def test_sticking_forgets(pair, simulator_of):
    simulator = simulator_of(pair(d=0.14))
    run = simulator.run(State(0, 0.25, 0.5), impacts=300)
    assert run.released.any()
    assert exponents_of(simulator, State(0, 0.25, 0.5), run).per_impact == (-math.inf, -math.inf)


@pytest.mark.parametrize(
    ("s", "kind", "notation"), [(0.55, "sticking", "(inf:1)/8T"), (1.5, "complex", "2:0/C")]
)
def test_a_cycle_that_rounding_makes_is_none(s, kind, notation):
    """Between two releases at s = 1.5 m rounding grows by 1e18: doubles repeat after 47 periods, 50
    digits after 94. At s = 0.55 m it grows by 1e5."""
    simulator = Simulator(ImpactPair(beta=0.9, r_B=0.6, r_T=0.35, A=4.0, s=s, M=0.3, omega=9.0))
    found = settle(simulator, simulator.state("B", time=0.1, velocity=0.4))
    assert (found.kind.value, found.notation) == (kind, notation)


def test_a_cycle_that_rounding_makes_is_none_in_stated_machines():
    """A ball on a table that moves in two harmonics first sticks again after 690 periods in 16
    digits, 5202 in 30 and 687 in 60: the motion between is chaotic, not of period 3911."""
    height = "-g + a*w**2*cos(w*t) + 4*b*w**2*cos(2*w*t + phi)"
    machine = {"coordinates": ["y"], "mass": [1], "force": [height], "period": "2*pi/w"}
    guards = {"F": {"within": "y >= 0", "restitution": 0.8}}
    values = {"g": 9.81, "a": 0.01, "b": 0.002, "w": 80.0, "phi": 0.5}
    model = {"system": "linear", **machine, "guards": guards, "parameters": values}
    follow = {"parameter": "w", "range": [20.0, 80.0], "orbits": ["F"]}
    ball = read_scene({"name": "ball", "model": model, "follow": follow}).model
    simulator = Simulator(ball)
    found = settle(simulator, simulator.state("F", time=0.03, velocity=-0.5))
    assert (found.kind.value, found.notation) == ("complex", "(1)/3T/C")


# Turning points that are not looked for


@pytest.mark.full
def test_a_turn_told_by_tangents_changes_nothing(pair, simulator_of, monkeypatch):
    """Where tangents tell that the body turns before a wall, the turning point is left out."""
    flights = list(random_flights(pair, simulator_of, 5, 600))
    fast = [s.fly(s.letters.index(wall), *at) for s, wall, *at in flights]
    told = Counter(flight.turns_before(*given) for given in turns_of_flights(flights, monkeypatch))
    assert told[True] > 200
    assert told[False] > 50
    monkeypatch.setattr(flight, "turns_before", lambda *given: False)
    assert [s.fly(s.letters.index(wall), *at) for s, wall, *at in flights] == fast


def turns_of_flights(flights, monkeypatch):
    """What `turns_before` is asked on some flights."""
    asked, tell = [], flight.turns_before
    with monkeypatch.context() as patch:
        patch.setattr(flight, "turns_before", lambda *given: asked.append(given) or tell(*given))
        for simulator, wall, phase, velocity in flights:
            simulator.fly(simulator.letters.index(wall), phase, velocity)
    return asked


# Compiled runs

needs_llvmlite = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="the extra 'fast' is not installed"
)
COLUMNS = ("walls", "turns", "phases", "velocities", "released")
MOTIONS = {"1:1": 0.389, "2:1": 0.3, "1:1/C": 0.3631}


def same_runs(one, other):
    """To the last bit."""
    assert (one.outcome, one.end) == (other.outcome, other.end)
    for name in COLUMNS:
        assert np.array_equal(getattr(one, name), getattr(other, name)), name


def check_random_models(both, simulator_of, pair, seed, count, impacts, **options):
    """Runs of random models are the same; returns how often each outcome and a release was met."""
    rng = np.random.default_rng(seed)
    met = Counter()
    for _ in range(count):
        names = ("r_B", "r_T") if options.get("apart") else ("r",)
        values = {n: rng.choice([0.0, 1.0, rng.uniform(), rng.uniform(0.0, 0.4)]) for n in names}
        values["beta"] = rng.choice([0.0, rng.uniform(-1.5, 1.5)], p=[0.25, 0.75])
        values |= {"A": 10 ** rng.uniform(-0.5, 1.3), "s": 10 ** rng.uniform(-1.7, 1.0)}
        given = {name: float(value) for name, value in values.items()}
        if "forcing" in options:
            given["forcing"] = options["forcing"]
        simulator = simulator_of(pair(**given), longest_flight=40)
        start = simulator.random_state(rng)
        plain, fast = both(lambda s=simulator, at=start: s.run(at, impacts=impacts))
        same_runs(plain, fast)
        met[plain.outcome] += 1
        met["released"] += bool(plain.released.any())
    return met


@needs_llvmlite
@pytest.mark.parametrize("s", MOTIONS.values(), ids=MOTIONS)
@pytest.mark.full
def test_compiled_runs_are_the_same_to_the_last_bit(pair, simulator_of, plain_and_compiled, s):
    simulator = simulator_of(pair(s=s))
    plain, fast = plain_and_compiled(lambda: simulator.run(State(0, 0.14, 0.686), impacts=10_000))
    same_runs(plain, fast)
    assert [column.dtype for column in vars(fast).values() if isinstance(column, np.ndarray)] == [
        column.dtype for column in vars(plain).values() if isinstance(column, np.ndarray)
    ]


@needs_llvmlite
@pytest.mark.slow
@pytest.mark.parametrize("s", MOTIONS.values(), ids=MOTIONS)
def test_long_compiled_runs_are_the_same(pair, simulator_of, plain_and_compiled, s):
    simulator = simulator_of(pair(s=s))
    same_runs(*plain_and_compiled(lambda: simulator.run(State(0, 0.14, 0.686), impacts=100_000)))


@needs_llvmlite
@pytest.mark.full
def test_compiled_runs_of_random_models_are_the_same(pair, simulator_of, plain_and_compiled):
    """Restitution from 0 to 1, level and inclined, chatter, sticking, rest and flights given up."""
    met = check_random_models(plain_and_compiled, simulator_of, pair, 6, 60, 400)
    assert met["released"] > 10
    assert all(met[outcome] for outcome in (Outcome.DONE, Outcome.RESTING, Outcome.NO_IMPACT))


@needs_llvmlite
@pytest.mark.parametrize(
    ("forcing", "count"),
    [
        ("cos(pi*t+0.3)+sin(4*pi*t)/5-1/8", 10),
        pytest.param("cos(pi*t)**3", 20, marks=pytest.mark.slow),
        pytest.param("cos(pi*t)*cos(2*pi*t)*sin(3*pi*t)", 20, marks=pytest.mark.slow),
        pytest.param("exp(cos(pi*t))/3", 10, marks=pytest.mark.slow),
        pytest.param("0*t", 10, marks=pytest.mark.slow),
    ],
)
@pytest.mark.full
def test_compiled_runs_with_two_restitutions_and_other_forcings(
    pair, simulator_of, plain_and_compiled, forcing, count
):
    check_random_models(
        plain_and_compiled, simulator_of, pair, 7, count, 300, apart=True, forcing=forcing
    )


@needs_llvmlite
@pytest.mark.parametrize("kind", [{"impacts": 100}, {"periods": 60}, {"impacts": 50, "periods": 9}])
def test_compiled_chunks_join(pair, simulator_of, plain_and_compiled, monkeypatch, kind):
    simulator, start = simulator_of(pair(s=0.3631)), State(0, 0.14, 0.686, turns=3)
    whole = plain_and_compiled(lambda: simulator.run(start, **kind))
    blind = plain_and_compiled(lambda: simulator.run(start, record=False, **kind))
    monkeypatch.setattr(simulate, "CHUNK", 7)
    monkeypatch.setattr(simulate, "FEW", 2)
    for part in plain_and_compiled(lambda: simulator.run(start, **kind)):
        same_runs(part, whole[0])
    same_runs(*whole)
    assert [run.end for run in blind] == [whole[0].end] * 2
    assert not any(len(run) for run in blind)


@needs_llvmlite
def test_a_run_may_go_on_compiled(pair, simulator_of, plain_and_compiled, monkeypatch):
    """It pays from the third chunk on."""
    simulator, start = simulator_of(pair(s=0.3631)), State(0, 0.14, 0.686)
    plain, _ = plain_and_compiled(lambda: simulator.run(start, impacts=5000))
    monkeypatch.setattr(simulate, "CHUNK", 700)
    engine = simulator.machine.loop.engine
    monkeypatch.setattr(
        engine, "program", lambda asked, found=engine.found: found if engine.plain >= 1400 else None
    )
    engine.plain = 0
    same_runs(simulator.run(start, impacts=5000), plain)
    assert engine.plain == 1400


@needs_llvmlite
def test_motion_that_runs_away_ends_compiled_code_too(
    pair, simulator_of, plain_and_compiled, monkeypatch
):
    """Motion faster than what is allowed, which is made less than what it reaches."""
    simulator, start = simulator_of(pair(s=0.3631)), State(0, 0.14, 0.1)
    speeds = np.abs(simulator.run(start, impacts=50).velocities)
    monkeypatch.setattr(simulate, "RUNAWAY", 0.9 * np.max(speeds) / simulator.fastest)
    plain, compiled = plain_and_compiled(lambda: simulator.run(start, impacts=50))
    same_runs(compiled, plain)
    assert plain.outcome is Outcome.RUNAWAY
    assert len(plain) == np.argmax(speeds > 0.9 * np.max(speeds)) + 1


def test_what_cannot_be_compiled_runs_plainly(oscillator, simulator_of, monkeypatch):
    """The acceleration of the oscillator depends on the state."""
    monkeypatch.setenv("CONTIMPACT_COMPILED", "always")
    simulator = simulator_of(oscillator(c=0.2, r=0.6, sigma=0.0))
    assert len(simulator.run(simulator.state("S", 0.1, 1.0), impacts=5)) == 5


def test_the_program_holds_all_it_calls(pair, simulator_of):
    """Its text runs on its own, with nothing of the package around it."""
    simulator = simulator_of(pair(d=0.14))
    namespace = {}
    exec(one_coordinate.program_of(simulator.machine.motions).text, namespace)
    at, when, rows = [0, 0, 0], [0.25, 0.5, math.inf], [[0] * 200 for _ in COLUMNS]
    given = *simulator.machine.body, [0.0] * 2, at, when, *rows
    assert namespace["entry"](*given, (200, 10**9)) == 200
    run = simulator.run(State(0, 0.25, 0.5), impacts=200)
    assert run.released.any()
    for name, column in zip(COLUMNS, rows, strict=True):
        assert getattr(run, name).tolist() == column


@pytest.fixture
def looked_for(monkeypatch):
    """How often compiled code is looked for; there is none."""
    calls = []
    monkeypatch.setattr(loops, "_ENGINES", {})
    monkeypatch.setattr(compiling, "_SPENT", defaultdict(float))
    monkeypatch.setattr(loops, "load", lambda *given: calls.append(given) and None)
    return calls


@pytest.mark.parametrize(
    ("mode", "kind", "times"),
    [
        ("never", {"impacts": 10_000}, 0),
        ("auto", {"impacts": 100}, 0),
        ("auto", {"periods": 100}, 0),
        ("auto", {"impacts": 200}, 1),
        ("always", {"impacts": 1}, 1),
    ],
)
def test_compiled_code_is_looked_for_where_it_is_worth_it(
    pair, kernels_of, looked_for, monkeypatch, mode, kind, times
):
    monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
    model = pair()
    Simulator(model, kernels_of(model, "s")).run(State(0, 0.14, 0.686), **kind)
    assert len(looked_for) == times
    assert all(seconds > 0.0 for seconds in compiling._SPENT.values())


def test_many_short_runs_are_worth_it_too(pair, kernels_of, looked_for, monkeypatch):
    """Simulators of the same formulas count together, whatever the free parameter."""
    monkeypatch.setenv("CONTIMPACT_COMPILED", "auto")
    for i in range(9):
        model = pair(s=0.3 + 0.01 * i)
        simulator = Simulator(model, Kernels(model, "As"[i % 2]))
        for _ in range(5):
            simulator.run(State(0, 0.14, 0.686), impacts=9)
    assert len(loops._ENGINES) == 1
    assert len(looked_for) == 2


def test_motion_that_sticks_in_a_hybrid_scene_has_an_exponent_without_error():
    """It forgets the past: minus infinity, whose scatter was NaN, with a warning of NumPy's."""
    model = {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": {"w": 1.2, "r": 0.4},
        "modes": {"free": {"x": "v", "v": "cos(w*t) - v/10 - x"}},
        "guards": {"S": {"within": "x <= 0", "set": {"v": "-r*v/(1 + v/2)"}}},
    }
    asked = {"parameter": "w", "range": [1, 2], "orbits": ["S"]}
    scene = read_scene({"name": "sticks", "model": model, "follow": asked})
    simulator = Simulator(scene.model)
    start = simulator.state("S", 0.1, 0.5)
    run = simulator.run(start, impacts=200)
    assert run.released.any()
    found = exponents_of(simulator, start, run)
    assert found.per_impact == (-math.inf, -math.inf)
    assert found.error == 0.0
