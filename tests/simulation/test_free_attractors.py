"""Attractors and sweeps of systems without forcing: self-excited ones, and clocked machines."""

from __future__ import annotations

import importlib.util
import itertools
import math
import tomllib

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import contimpact as ci
from contimpact.diagrams.scene_simulation import simulate, write_simulation
from contimpact.errors import InputError
from contimpact.models.guards import Word
from contimpact.results.options import Settling
from contimpact.results.scene import read_scene
from contimpact.simulation.attractor import Kind
from contimpact.simulation.files import sweep_of
from contimpact.simulation.run import Outcome
from contimpact.simulation.settle import settle_again
from contimpact.simulation.simulator import Simulator
from contimpact.simulation.sweep import Simulators, cover, same_attractor
from contimpact.simulation.transitions import find_transitions
from contimpact.systems.belt import Belt
from contimpact.systems.van_der_pol import VanDerPol

integrated = pytest.mark.skipif(
    importlib.util.find_spec("heyoka") is None, reason="needs contimpact[ode]"
)
OSCILLATOR = {"a": 0.0, "omega": 1.0, "c": -0.1, "k": 1.0, "sigma": 1.0, "r": 0.8}
BELT = {"a": 0.0, "omega": 1.0, "c": 0.2, "V": 1.6, "mu_0": 1.0, "delta": 3.0}


def oscillator(**changes):
    """An oscillator that is excited by negative damping, and loses energy at its stop."""
    return ci.Oscillator(**OSCILLATOR | changes, period="free")


def van_der_pol(**changes):
    return VanDerPol(**{"epsilon": 1.0, "sigma": 2.5, "r": 0.8} | changes)


def belt():
    return Belt(friction="weakening", period="free", **BELT)


# Self-excited motion.


def test_an_orbit_of_thirty_digits():
    """Its closed form; the multiplier that is not the flow's is r^2 e^(-cT)."""
    found = ci.settle(oscillator())
    with mpmath.workdps(30):
        c, r = mpmath.mpf(OSCILLATOR["c"]), mpmath.mpf(OSCILLATOR["r"])
        omega = mpmath.sqrt(1 - c**2 / 4)

        def misses(v, t):
            b, e = (-r * v + c / 2) / omega, mpmath.exp(-c * t / 2)
            x = e * (mpmath.cos(omega * t) + b * mpmath.sin(omega * t))
            speed = e * omega * (b * mpmath.cos(omega * t) - mpmath.sin(omega * t)) - c / 2 * x
            return x - 1, speed - v

        v, T = mpmath.findroot(misses, (found.velocities[0], found.span))
    assert (found.word, found.period, found.notation, found.label) == ("S", 0, "1", "S")
    assert found.times == [0.0]
    assert found.velocities[0] == pytest.approx(float(v), rel=1e-13)
    assert found.span == found.duration == pytest.approx(float(T), rel=1e-13)
    area = OSCILLATOR["r"] ** 2 * math.exp(-OSCILLATOR["c"] * float(T))
    assert found.multipliers == (pytest.approx(area, rel=1e-12),)
    assert found.exponents == (pytest.approx(math.log(area), rel=1e-12),)
    assert found.rate == pytest.approx(1.0 / float(T), rel=1e-13)
    assert found.per_period == pytest.approx(math.log(area) / float(T), rel=1e-12)
    orbit = found.orbit(parameter="c")
    assert (orbit.period, orbit.word) == (pytest.approx(float(T), rel=1e-13), Word("S", 0))


@integrated
def test_a_limit_cycle_without_impacts():
    """Period and amplitude are those of D. Andersen, J. Geer 1982; orbits of the word 0 are it."""
    found = ci.settle(van_der_pol())
    assert (found.kind, found.label) == (Kind.NO_IMPACT, "no impact")
    assert found.span == pytest.approx(6.66328685932313, abs=1e-13)
    assert found.motion == (pytest.approx(2.00861986087484, abs=1e-13), 0.0)
    (orbit,) = ci.find_orbits(van_der_pol(), "0", parameter="sigma")
    branch = ci.continue_orbit(orbit, "sigma", (2.2, 2.6))
    sweep = ci.sweep(van_der_pol(), "sigma", [2.5, 2.3])
    (match, other) = cover(sweep, ci.Diagram("cycle", [branch])).matches
    assert (match.word, match.period) == ("0", 0)
    assert max(match.distance, other.distance) < 1e-12


@integrated
def test_a_limit_cycle_at_a_stop():
    found = ci.settle(van_der_pol(sigma=1.5))
    (orbit,) = (o for o in ci.find_orbits(van_der_pol(sigma=1.5), "S") if o.stable and o.physical)
    assert found.span == pytest.approx(orbit.period, rel=1e-9)
    assert found.velocities == pytest.approx(orbit.velocities, rel=1e-9)
    assert found.multipliers == pytest.approx(orbit.multipliers, rel=1e-9)


@integrated
def test_an_equilibrium_is_an_attractor_where_it_is_stable():
    """The damping of van der Pol's oscillator is -epsilon at rest."""
    still = ci.Simulator(van_der_pol(epsilon=-0.2, sigma=1.0))
    found = ci.settle(still, still.start(0.0, 0.99, 0.9))
    assert (found.label, found.motion, found.span) == ("no impact, at rest", (0.0, 0.0), 0.0)
    assert settle_again(still, found).motion == (0.0, 0.0)
    moved = settle_again(ci.Simulator(van_der_pol(epsilon=0.2, sigma=1.0)), found)
    assert (moved.label, moved.motion) == ("no impact, at rest, unstable", None)


@integrated
@pytest.mark.full
def test_an_equilibrium_is_followed_to_its_hopf_bifurcation():
    """It is where the friction's slope delta mu_0/(1 + delta V)^2 is the damping c; beside it
    motion comes to rest too slowly to be waited for."""
    hopf = (math.sqrt(3.0 / 0.2) - 1.0) / 3.0
    sweep = ci.sweep(belt(), "V", [1.7, 1.0, 0.9])
    assert [row.attractor.label for row in sweep] == ["no impact, at rest"] * 2 + ["SP"]
    ends, _ = find_transitions(sweep, 1e-6)
    assert ends.after.value < hopf < ends.before.value
    assert ends.before.notation == "no impact, at rest"
    assert ends.wide is None


@integrated
@pytest.mark.full
def test_where_a_limit_cycle_comes_to_a_stop():
    """Its amplitude is 2.00861986087484."""
    sweep = ci.sweep(van_der_pol(), "sigma", [2.01, 2.0])
    (found,) = find_transitions(sweep, 1e-3)
    low, high = sorted((found.before.value, found.after.value))
    assert (found.label, found.order) == ("no impact->1", None)
    assert low < 2.00861986087484 < high < low + 1e-3


@integrated
@pytest.mark.full
def test_stick_and_slip_up_to_its_end():
    """It ends at V = 1.61195810086361 with the period 6.34602120823; beyond it the body slips."""
    (orbit,) = (o for o in ci.find_orbits(belt(), "SP", parameter="V") if o.physical)
    branch = ci.continue_orbit(orbit, "V", (1.5, 1.611958))
    sweep = ci.sweep(belt(), "V", [1.52, 1.6, 1.611958, 1.62])
    assert [row.attractor.label for row in sweep] == ["SP", "SP", "SP", "no impact, at rest"]
    assert [m.distance < 1e-9 for m in cover(sweep, ci.Diagram("belt", [branch])).matches] == [
        True,
        True,
        True,
    ]
    assert sweep[2].attractor.span == pytest.approx(6.34602120823, abs=1e-5)


def lifted(period):
    """A self-excited body at a stop pulls another one off its floor, where it comes to rest."""
    laws = {"y": "v", "v": "0.15*v - y - 0.9*(y - z)", "z": "w", "w": "-1 - 0.3*w - 0.9*(z - y)"}
    stop = {"within": "y <= s", "set": {"v": "-0.5*v"}}
    floor = {"within": "z >= 0", "set": {"w": "-r*w"}}
    model = {"system": "hybrid", "period": period, "parameters": {"r": 0.0, "s": 2.2}}
    model |= {"modes": {"m": laws}, "guards": {"F": floor, "S": stop}}
    follow = {"parameter": "s", "range": [1.0, 3.0], "orbits": ["FS"]}
    return ci.read_scene({"name": "lifted", "model": model, "follow": follow}).model


@pytest.mark.parametrize("period", [2.0, 6.3])
def test_sticking_is_that_of_dop853(period):
    """The floor is left where the spring, 0.9 y, lifts the weight 1."""
    found = ci.settle(lifted(period))
    assert (found.kind, found.word, found.label) == (Kind.STICKING, "F*S", "F*S")

    def free(t, x):
        y, v, z, w = x
        return [v, 0.15 * v - y - 0.9 * (y - z), w, -1.0 - 0.3 * w - 0.9 * (z - y)]

    def held(t, x):
        return [x[1], 0.15 * x[1] - 1.9 * x[0], 0.0, 0.0]

    def flight(law, state, level):
        level.terminal, level.direction = True, 1.0
        given = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13, "events": level}
        made = solve_ivp(law, (0.0, 20.0), state, **given)
        return made.t[-1], made.y[:, -1]

    (k,) = np.flatnonzero(found.walls == 1)
    z, w = found.others[k]
    first, at_floor = flight(free, [2.2, -0.5 * found.velocities[k], z, w], lambda t, x: -x[2])
    second, leaving = flight(held, [*at_floor[:2], 0.0, 0.0], lambda t, x: 0.9 * x[0] - 1.0)
    third, at_stop = flight(free, leaving, lambda t, x: x[0] - 2.2)
    assert found.span == pytest.approx(first + second + third, abs=1e-9)
    assert at_stop[1:] == pytest.approx([found.velocities[k], z, w], abs=1e-9)
    assert len(found.multipliers) == 3


# A converter with a clock: Fossas and Olivar, IEEE Trans. Circuits Syst. I 43 (1996).

R, C, L, T = 22.0, 47e-6, 20e-3, 400e-6
GAIN, REFERENCE, LOW, HIGH = 8.4, 11.3, 3.8, 8.2
MATRIX = np.array([[-1.0 / (R * C), 1.0 / C], [-1.0 / L, 0.0]])
CONVERTER = {
    "system": "hybrid",
    "period": "T",
    "parameters": {"E": 24.0, "R": R, "C": C, "L": L, "T": T, "low": REFERENCE + LOW / GAIN},
    "modes": {
        "on": {"v": "(i - v/R)/C", "i": "(E - v)/L", "c": "1/T"},
        "off": {"v": "(i - v/R)/C", "i": "-v/L", "c": "1/T"},
    },
    "guards": {
        "D": {"mode": "on", "within": f"v - {(HIGH - LOW) / GAIN!r}*c <= low", "to": "off"},
        "P": {"mode": "off", "within": f"v - {(HIGH - LOW) / GAIN!r}*c >= low", "to": "on"},
        "K": {"mode": ["on", "off"], "within": "c <= 1", "to": "off", "set": {"c": 0}},
        "L": {"mode": ["on", "off"], "within": "c <= 1", "to": "on", "set": {"c": 0}, "past": "P"},
    },
}


def converter(period="T", **more):
    follow = {"parameter": "E", "range": [20, 35], "orbits": ["PK"]}
    model = CONVERTER | {"period": period}
    return ci.read_scene({"name": "converter", "model": model, "follow": follow, **more})


def flown(state, on, time, E):
    rest = np.array([E, E / R]) if on else np.zeros(2)
    return rest + expm(MATRIX * time) @ (state - rest)


def after_a_ramp(state, E):
    """Voltage and current a period of the clock later, by matrix exponentials, and how often it is
    switched in it."""

    def above(state, time):
        return GAIN * (state[0] - REFERENCE) - LOW - (HIGH - LOW) * time / T

    time, switched, on, step = 0.0, 0, bool(above(state, 0.0) < 0.0), T / 400
    while time < T * (1.0 - 1e-14):
        length = min(step, T - time)
        end = flown(state, on, length, E)

        def here(t, state=state, on=on, time=time):
            return above(flown(state, on, t, E), time + t)

        if here(0.0) * here(length) < 0.0 and (here(length) > 0.0) == on:
            length = brentq(here, 0.0, length, xtol=1e-20, rtol=1e-15)
            end, on, switched = flown(state, on, length, E), not on, switched + 1
        state, time = end, time + length
    return state, switched


def at_clock(attractor):
    """Voltage and current at each reset of the clock, and passages between them."""
    rows = np.flatnonzero(attractor.walls >= 2)
    return attractor.others[rows][:, [0, 2]], np.diff(rows) - 1


@pytest.mark.parametrize(("E", "word"), [(24.0, "PK"), (25.0, "PKPK"), (32.0, "PKPKPKPK")])
def test_attractors_of_a_converter_against_matrix_exponentials(E, word):
    found = ci.settle(converter().model.replace(E=E))
    assert (found.word, found.span) == (word, pytest.approx(len(word) / 2 * T, rel=1e-12))
    states, _ = at_clock(found)
    for state, following in zip(states, np.roll(states, -1, axis=0), strict=True):
        assert after_a_ramp(state, E)[0] == pytest.approx(following, rel=1e-11)
    ends = []
    for moved in (*(1e-6 * np.eye(2)), *(-1e-6 * np.eye(2))):
        state = states[0] + moved
        for _ in states:
            state, _ = after_a_ramp(state, E)
        ends.append(state)
    told = np.linalg.eigvals((np.array(ends[:2]) - ends[2:]) / 2e-6)
    told = sorted(told, key=lambda mu: (-abs(mu), -mu.imag))
    assert found.multipliers[:2] == pytest.approx(told, rel=1e-6)
    assert found.multipliers[2:] == (0.0, 0.0, 0.0)  # the clock, and two rates of first order
    total = math.log(abs(np.prod(found.multipliers[:2]))) / len(word) * 2
    assert total == pytest.approx(-T / (R * C), rel=1e-9)  # of Liouville, per period of the clock


def test_chaos_of_a_converter_follows_matrix_exponentials():
    """From 32.27 on; several switchings in a period of the clock, or none, are met as they are."""
    found = ci.settle(converter().model.replace(E=33.0))
    assert (found.kind, found.notation, found.period) == (Kind.COMPLEX, "complex", None)
    assert found.exponents[0] > 10.0 * found.error
    run = ci.Simulator(converter().model.replace(E=33.0)).run(found.state, impacts=40)
    states, between = at_clock(run)
    assert {0, 1, 3} <= set(between.tolist())
    for (state, following), count in zip(itertools.pairwise(states[:10]), between, strict=False):
        end, switched = after_a_ramp(state, 33.0)
        assert end == pytest.approx(following, rel=1e-9)
        assert switched == count


def test_a_converter_doubles_its_period_where_a_multiplier_is_minus_one():
    """At E about 24.516, as it is published; the attractor's orbit is followed there."""
    orbit = ci.settle(converter().model).orbit(parameter="E")
    (event,) = ci.continue_orbit(orbit, "E", (24.0, 25.0), events=["PD"]).events
    assert event.kind == "PD"
    assert event.value == pytest.approx(24.516, abs=1e-3)
    before, after = (ci.settle(converter().model.replace(E=event.value + d)) for d in (-0.02, 0.02))
    assert (before.word, after.word) == ("PK", "PKPK")


@pytest.mark.parametrize("period", ["3*T", "0.2*T"])
def test_natural_times_do_not_matter(period):
    """They say how long is waited alone."""
    for E in (24.0, 25.0):
        found, other = (ci.settle(converter(p).model.replace(E=E)) for p in ("T", period))
        assert same_attractor(found, other, 1e-9)
        assert other.span == pytest.approx(found.span, rel=1e-12)
        assert other.multipliers == pytest.approx(found.multipliers, abs=1e-9)
        assert other.per_period == pytest.approx(found.per_period, rel=1e-9)


def test_guards_that_end_several_modes_are_starts():
    """None was found within the guards of all: starts were as far away as numbers go."""
    simulator = ci.Simulator(converter().model)
    starts = [simulator.random_state(seed) for seed in range(12)]
    assert {start.wall for start in starts} >= {0, 1}
    assert all(np.max(np.abs(start.others[::2])) < 1e3 for start in starts)
    assert {ci.settle(simulator, start).word for start in starts} == {"PK"}


FORCED = {
    "system": "hybrid",
    "period": "2*pi/w",
    "parameters": {"w": 2.0, "d": 0.0, "e": 0.8},
    "modes": {"m": {"x": "v", "v": "-0.1*v - x + cos(w*t)"}},
    "guards": {"S": {"within": "x <= d", "set": {"v": "-e*v"}}},
}


def forced(**changes):
    follow = {"parameter": "w", "range": [1.0, 4.0], "orbits": ["S"]}
    return ci.read_scene({"name": "wave", "model": FORCED | changes, "follow": follow}).model


def clocked(period):
    modes = {"m": {"x": "v", "v": "-0.1*v - x + cos(2*pi*s)", "s": "w/(2*pi)"}}
    clock = {"within": "s <= 1", "set": {"s": 0}}
    return forced(period=period, modes=modes, guards=FORCED["guards"] | {"C": clock})


@integrated
@pytest.mark.parametrize("period", ["2*pi/w", "1"])
def test_a_forcing_is_a_clock(period):
    """Restated with its phase as a coordinate, motion is the same."""
    for w in (2.0, 3.0):
        found = ci.settle(forced().replace(w=w))
        other = ci.settle(clocked(period).replace(w=w))
        hits = other.walls == 0
        assert other.word.count("C") == found.period
        assert other.span == pytest.approx(found.duration, rel=1e-12)
        assert sorted(other.velocities[hits]) == pytest.approx(sorted(found.velocities), rel=1e-9)
        assert other.multipliers == pytest.approx([*found.multipliers, 0.0], abs=1e-9)


@integrated
@pytest.mark.full
def test_chaos_has_the_exponents_that_it_has_with_a_forcing():
    found, other = (ci.settle(m.replace(w=2.8)) for m in (forced(), clocked("1")))
    assert found.kind is other.kind is Kind.COMPLEX
    each = 2.0 * math.pi / 2.8
    errors = found.error * found.rate, other.error * other.rate * each
    apart = abs(other.per_period * each - found.per_period)
    assert apart < 4.0 * math.hypot(*errors)
    assert other.exponents[-1] == -math.inf


# Scenes and files.


def test_a_scene_of_a_converter(tmp_path):
    """Attractors lie on the branches, and its table has their periods as times."""
    asked = {"range": [24.0, 25.0], "values": 3, "branches": True, "transitions": False}
    scene = converter(simulate=asked)
    result = simulate(scene, tmp_path)
    assert result.coverage.uncovered[0].word == "PKPK"
    assert [m.distance < 1e-9 for m in result.coverage.matches] == [True, True]
    assert write_simulation(result, tmp_path)
    loaded = sweep_of(tmp_path / "sweep.csv", scene.model)
    for row, kept in zip(loaded, result.sweep, strict=True):
        one, other = row.attractor, kept.attractor
        assert (one.word, one.period, one.free) == (other.word, 0, True)
        assert one.span == other.span
        assert np.array_equal(one.velocities, other.velocities)
    names = (tmp_path / "sweep.csv").read_text().splitlines()[1].split(",")
    assert "multiplier5_re" in names
    assert "multiplier6_re" not in names
    assert len(simulate(scene, tmp_path, resume=True).sweep) == 3
    fragment = result.coverage.uncovered[0].scene
    assert 'orbits = ["PKPK"]' in fragment
    assert "np." not in fragment


@pytest.mark.parametrize(
    ("table", "place"),
    [
        ({"basins": [24.0]}, "basins"),
        ({"fractions": [24.0]}, "fractions"),
        ({"transitions": [1, 2]}, "transitions"),
        ({"crises": True, "branches": True}, "crises"),
    ],
)
def test_scenes_say_what_needs_a_forcing(table, place):
    with pytest.raises(InputError, match=rf"^simulate\.{place}: .* no forcing"):
        converter(simulate=table)


@pytest.mark.parametrize(
    "ask",
    [
        ci.basins,
        lambda model: ci.basin_fractions(model, "c", [-0.1], box={"position": [[0.0, 1.0]]}),
        lambda model: ci.integrity(ci.settle(model).orbit(parameter="c")),
    ],
)
@pytest.mark.quick(4)
def test_basins_need_a_forcing(ask):
    with pytest.raises(InputError, match=r"^model: .* no forcing; find_attractors lists"):
        ask(oscillator())


def test_sweeps_go_on_from_value_to_value():
    simulators = Simulators(oscillator(), "c")
    first = ci.settle(simulators.at(-0.1))
    led = simulators.lead(first, -0.09, Settling())
    assert same_attractor(led, ci.find_attractors(simulators.at(-0.09), 3)[0])


BELT_WITH_A_CLOCK = """
name = "belt"
[model]
system = "hybrid"
period = "2*pi/w"
[model.parameters]
a = 0.35
w = 1.3
V = 0.5
F = 0.4
[model.modes.slip]
x = "v"
v = "a*cos(2*pi*s) - x - 0.05*v + F"
s = "w/(2*pi)"
[model.modes.stick]
x = "V"
u = "-a*w*sin(2*pi*s) - V"
s = "w/(2*pi)"
[model.guards.K]
mode = "slip"
within = "v <= V"
to = "stick"
set = { u = "a*cos(2*pi*s) - x - 0.05*V" }
[model.guards.D]
mode = "stick"
within = "u >= -F"
to = "slip"
set = { v = "V" }
[model.guards.R]
mode = "slip"
within = "s <= 1"
set = { s = 0 }
[model.guards.X]
mode = "stick"
within = "s <= 1"
set = { s = 0 }
[follow]
parameter = "a"
range = [0.3, 0.45]
orbits = ["KDR"]
"""


@integrated
@pytest.mark.parametrize(("slip", "stick"), [("xvs", "xus"), ("xvs", "sxu"), ("vsx", "xus")])
def test_a_sweep_goes_on_where_a_state_is_beyond_its_limit_at_other_values(slip, stick):
    """The spring's force u is known twice, as a coordinate and by x: where slip begins at one value
    of a, at a larger one the body slips forward. The sweep starts at another impact. Where slip
    begins v keeps its rate but for rounding, which is another one with coordinates in another
    order."""
    given = tomllib.loads(BELT_WITH_A_CLOCK)
    laws = given["model"]["modes"]
    for name, order in (("slip", slip), ("stick", stick)):
        laws[name] = {key: laws[name][key] for key in order}
    model = read_scene(given).model
    simulator = Simulator(model)
    slips = simulator.state("R", 0.0, 1.3 / (2.0 * math.pi), [0.0, 0.0, 0.0, 0.0])
    found = ci.settle(simulator, slips)
    there = Simulator(model.replace(a=0.4))
    beyond = there.run(found.state, impacts=1)
    assert (beyond.outcome, len(beyond)) == (Outcome.BEYOND, 0)
    assert found.notation == "KDR"
    (other,) = [one for one in ci.find_orbits(there.model, "KDR") if one.physical]
    moved = settle_again(there, found)
    assert moved.notation == "KDR"
    np.testing.assert_allclose(moved.velocities, other.velocities, rtol=1e-9)


def test_an_equilibrium_of_coordinates_of_first_order_moves_with_the_parameter():
    """It kept the state at the first value: a drill string's steady rotation, which is stable down
    to W = ln(15) / 0.4 = 6.77, was left at 10.36, where the basin no longer held W = 20."""
    pytest.importorskip("heyoka", reason="needs contimpact[ode]")
    table = {
        "name": "drill string",
        "model": {
            "system": "hybrid",
            "period": 4.7,
            "parameters": {"W": 12.0},
            "modes": {
                "slip": {"q": "W - v", "v": "(473*q + 120*(W - v) - 4500 - 4500*exp(-0.4*v))/374"},
                "stick": {"q": "W"},
            },
            "guards": {
                "S": {"mode": "slip", "within": "v >= 0", "to": "stick"},
                "P": {
                    "mode": "stick",
                    "within": "q <= (9000 - 120*W)/473",
                    "to": "slip",
                    "set": {"v": 0},
                },
            },
        },
        "follow": {"parameter": "W", "range": [5.0, 20.0], "orbits": ["SP"]},
    }
    found = ci.sweep(ci.read_scene(table).model, "W", [20.0, 12.0, 10.5, 9.0, 7.0, 6.0])
    for row in found.rows[:-1]:
        assert row.attractor.notation == "no impact, at rest"
        force = (4500.0 + 4500.0 * math.exp(-0.4 * row.value)) / 473.0
        assert row.attractor.motion == pytest.approx((force, 0.0, row.value, 0.0), abs=1e-9)
    assert found.rows[-1].attractor.word == "SP"
