"""What is seen beyond a grazing: the true return map, and the normal form iterated."""

from __future__ import annotations

import cmath
import dataclasses
import functools
import math

import mpmath as mp
import numpy as np
import pytest

import contimpact as ci
from contimpact.bifurcations.grazing import (
    CHAOS,
    IMMEDIATE,
    JUMP,
    OVERLAP,
    UNDECIDED,
    images_of,
    predict,
    windows,
)
from contimpact.bifurcations.kind import kind_of
from contimpact.results.diagram import event_of


def real_grazings(branch):
    return [entry for entry in branch.events if entry.kind == "G" and not entry.ghost]


AT = {"2:1": 0.3, "3:1": 0.27, "4:1": 0.25}
"""Values of s at which orbits of Fig. 7 are stable, before they graze."""


@functools.cache
def pair_grazings():
    """The grazings of these orbits, by their notation."""
    found = {}
    for word, s in AT.items():
        pair = ci.ImpactPair(beta="pi/6", r=0.3, A=5.0, s=s)
        orbit = next(o for o in ci.find_orbits(pair, word, "s") if o.physical and o.stable)
        branch = ci.continue_orbit(orbit, "s", range=(s - 0.03, s), events=["G"])
        (found[word],) = real_grazings(branch)
    return found


def test_a_restored_grazing_has_its_criticality():
    """An entry keeps no tangent of its branch; the orbit tells it, up to a sign."""
    for entry in pair_grazings().values():
        side, slope = kind_of("G").criticality(event_of(entry), None, None)
        assert (side, slope) == (entry.criticality, pytest.approx(entry.slope))


# The square root and its linearisation, from the true return map.


class TrueMap:
    """Smallest gap and its time, from one grazing flight of the impact pair to the next, in many
    digits and by no code of the package."""

    def __init__(self, entry):
        p = {name: mp.mpf(value) for name, value in entry.parameters.items()}
        self.r, self.g = p["r"], p["M"] * p["g"] * mp.sin(p["beta"]) / p["A"]
        self.d = p["M"] * p["omega"] ** 2 * p["s"] / (p["A"] * mp.pi**2)
        self.side = {"B": 1, "T": -1}
        self.wall, self.period, flight = entry.wall, 2 * entry.period, entry.flight
        count = len(entry.impacts)
        order = [(flight + 1 + k) % count for k in range(count)]
        self.walls = [entry.impacts[k]["wall"] for k in order]
        times = np.array([entry.impacts[k]["time"] for k in order])
        times -= 2.0 * entry.period * np.ceil((times - entry.touch_time) / (2.0 * entry.period) - 1)
        self.times, self.touch = times, entry.touch_time

    def flown(self, t0, x, v, t):
        """Position and velocity at t under cos(pi t) + g."""
        w, dt = mp.pi, t - t0
        speed = v + (mp.sin(w * t) - mp.sin(w * t0)) / w + self.g * dt
        ahead = v * dt - (mp.cos(w * t) - mp.cos(w * t0)) / w**2 - mp.sin(w * t0) * dt / w
        return x + ahead + self.g * dt**2 / 2, speed

    def place(self, wall):
        return self.side[wall] * self.d / 2

    def around(self, gap, time, impact=False):
        """From a smallest gap to the next; with the impact where it is negative."""
        t, x, v = time, self.place(self.wall) - self.side[self.wall] * gap, mp.mpf(0)
        if impact:
            away = abs(mp.cos(mp.pi * time) + self.g)
            t = mp.findroot(
                lambda s: self.flown(time, x, 0, s)[0] - self.place(self.wall),
                time - mp.sqrt(-2 * gap / away),
            )
            x, v = self.place(self.wall), -self.r * self.flown(time, x, 0, t)[1]
        for wall, guess in zip(self.walls, self.times, strict=True):
            state = t, x, v
            t = mp.findroot(
                lambda s, at=state, w=wall: self.flown(*at, s)[0] - self.place(w), guess
            )
            x, v = self.place(wall), -self.r * self.flown(*state, t)[1]
        state = t, x, v
        end = mp.findroot(lambda s: self.flown(*state, s)[1], self.touch + self.period)
        gap = self.side[self.wall] * (self.place(self.wall) - self.flown(*state, end)[0])
        return gap, end - self.period


@pytest.mark.parametrize("word", AT)
def test_normal_form_of_the_true_return_map(word):
    """Trace, determinant and the coefficient of the square root, by differences in 60 digits; the
    grazing itself is known to 1e-15 only, which moves derivatives by as much."""
    entry = pair_grazings()[word]
    said = entry.scenario
    with mp.workdps(60):
        true, h = TrueMap(entry), mp.mpf("1e-18")
        base = true.around(mp.mpf(0), mp.mpf(entry.touch_time))
        assert abs(base[0]) < 1e-13
        assert abs(base[1] - entry.touch_time) < 1e-12
        columns = [
            [(one - zero) / h for one, zero in zip(true.around(*moved), base, strict=True)]
            for moved in ((h, mp.mpf(entry.touch_time)), (0, entry.touch_time + h))
        ]
        (a, c), (b, d) = columns
        deep = mp.mpf("1e-24")
        jump = true.around(-deep, mp.mpf(entry.touch_time), impact=True)[0] - base[0]
        root = jump / mp.sqrt(deep)
    assert said.trace == pytest.approx(float(a + d), rel=1e-9)
    assert said.determinant == pytest.approx(float(a * d - b * c), rel=1e-9)
    assert said.coefficient == pytest.approx(float(root), rel=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_normal_form_of_the_oscillator(seed):
    """A motion without impacts grazes: A is the fundamental matrix over a period, and kappa =
    (1 + r) sqrt(2 alpha) Phi_12."""
    rng = np.random.default_rng(seed)
    c, omega, r = 10.0 ** rng.uniform(-1.5, 0.7), rng.uniform(0.4, 4.0), rng.uniform(0.2, 0.9)
    size = 1.0 / math.hypot(1.0 - omega**2, c * omega)
    stop = ci.Oscillator(a=1.0, omega=omega, c=c, k=1.0, sigma=1.02 * size, r=r)
    quiet = ci.find_orbits(stop, "0", "sigma")[0]
    branch = ci.continue_orbit(quiet, "sigma", range=(0.9 * size, 1.1 * size), events=["G"])
    (entry,) = real_grazings(branch)
    said, period = entry.scenario, 2.0 * math.pi / omega
    one, other = (-0.5 * c + sign * cmath.sqrt(0.25 * c * c - 1.0) for sign in (1, -1))
    first, second = cmath.exp(one * period), cmath.exp(other * period)
    across = ((first - second) / (one - other)).real
    assert said.trace == pytest.approx((first + second).real, rel=1e-9, abs=1e-12)
    assert said.determinant == pytest.approx(math.exp(-c * period), rel=1e-9, abs=1e-14)
    root = (1.0 + r) * math.sqrt(2.0 * omega**2 * size) * across
    assert said.coefficient == pytest.approx(root, rel=1e-8, abs=1e-11)
    assert said.rate == pytest.approx(1.0, rel=1e-9)
    assert (entry.criticality == "supercritical") == (across > 0.0)


@pytest.mark.parametrize("word", AT)
def test_slope_of_the_new_velocity(word):
    """The branch with the impact leaves G at the slope that the normal form has."""
    entry = pair_grazings()[word]
    said = entry.scenario
    acceleration = abs(math.cos(math.pi * entry.touch_time) + entry.parameters["gbar"])
    open_ = 1.0 - said.trace + said.determinant
    slope = -math.sqrt(2.0 * acceleration) * open_ * said.rate / said.coefficient
    assert entry.slope == pytest.approx(slope, rel=1e-10)
    assert (entry.criticality == "supercritical") == (said.coefficient > 0.0)


# Scenarios, from the normal form iterated.


def gaps_along(trace, determinant, away, epsilon, count, start=(0.0, 0.0)):
    """Gaps along iterates of a normal form with kappa = 1 or -1."""
    sign, (y, t) = (1.0 if away else -1.0), start
    gaps = np.empty(count)
    for k in range(count):
        gaps[k] = y - epsilon
        if gaps[k] < 0.0:
            t -= math.sqrt(-gaps[k])
        y, t = trace * y - sign * t, sign * determinant * y
    return gaps


def cycles_per_impact(gaps, tail=400):
    """In how many cycles one impact repeats at the end, or None."""
    late = np.nonzero(gaps[-tail:] < 0.0)[0]
    apart = np.diff(late)
    if len(apart) < 3 or np.ptp(apart) or np.ptp(gaps[-tail:][late]) > 1e-9 * np.ptp(gaps[-tail:]):
        return None
    return int(apart[0])


MAPS = [(0.2, 0.0), (0.45, 0.0), (0.5, 0.05), (0.3, 0.01), (0.55, 0.02), (0.1, 0.001), (0.72, 0.0)]


@pytest.mark.parametrize(("trace", "determinant"), MAPS)
def test_windows_hold_what_they_say(trace, determinant):
    """Begun beside an orbit with one impact in n cycles, the motion returns to it inside its window
    and leaves it outside."""
    found = windows(trace, determinant, True)
    assert len(found) > 4
    images, traces = images_of(trace, determinant, 8)
    for n, (low, high) in found[1:6]:
        for epsilon, stays in (
            (1.02 * low, True), (0.98 * high, True), (0.98 * low, False), (1.02 * high, False)
        ):  # fmt: skip
            bend = images[n] / (1.0 - traces[n] + determinant**n)
            w = 0.5 * (-bend + math.sqrt(bend * bend + 4.0 * epsilon))
            # the state before the impact, from u = -(1 - A^n)^-1 A^n (0, w)
            matrix = np.array([[trace, -1.0], [determinant, 0.0]])
            power = np.linalg.matrix_power(matrix, n)
            state = -np.linalg.solve(np.eye(2) - power, power @ [0.0, w])
            gaps = gaps_along(trace, determinant, True, epsilon, 6000, state * (1.0 + 1e-9))
            assert (cycles_per_impact(gaps) == n) is stays, (n, epsilon)


@pytest.mark.parametrize(
    ("multiplier", "name"), [(0.15, OVERLAP), (0.4, CHAOS), (0.6, CHAOS), (0.72, IMMEDIATE)]
)
@pytest.mark.full
def test_period_adding_of_the_square_root_map(multiplier, name):
    """One dimension: Nordmark's thresholds 1/4 and 2/3, and the motion at small epsilon."""
    said, found = predict(multiplier, 0.0, True)
    assert said == name
    far = [n for n, _ in windows(multiplier, 0.0, True) if n > 20]
    seen = set()
    for epsilon in np.geomspace(1e-7, 1e-9, 100):
        kinds = {
            cycles_per_impact(gaps_along(multiplier, 0.0, True, epsilon, 1500, (y, 0.0)))
            for y in (0.0, *np.geomspace(epsilon, 1e-2, 6))
        }
        seen.add(frozenset(kinds))
    several = any(len(kinds - {None}) > 1 for kinds in seen)
    chaos = any(kinds == {None} for kinds in seen)
    windows_ = any(kinds - {None} for kinds in seen)
    assert (several, chaos, windows_) == (name == OVERLAP, name != OVERLAP, name != IMMEDIATE)
    assert bool(far) == (name != IMMEDIATE)
    assert found == windows(multiplier, 0.0, True)[:5]


@pytest.mark.parametrize(
    ("trace", "determinant", "away"),
    [
        (-0.5, 0.05, True),
        (0.8, 0.4, True),
        (0.4, 0.02, False),
        (-0.3, 0.8, True),
        (0.6, 0.16, False),
    ],
)
def test_jumps(trace, determinant, away):
    """As epsilon vanishes, the impacts do not; the motion settles on one of the orbits named."""
    name, found = predict(trace, determinant, away)
    assert name == JUMP
    for epsilon in (1e-6, 1e-9, 1e-12):
        gaps = gaps_along(trace, determinant, away, epsilon, 6000)
        assert gaps[-400:].min() < -1e-4
        assert cycles_per_impact(gaps) in [n for n, _ in found]


def test_motion_stays_near_where_there_is_no_jump():
    for trace, determinant in MAPS:
        for epsilon in (1e-6, 1e-9, 1e-12):
            gaps = gaps_along(trace, determinant, True, epsilon, 3000)
            assert gaps.min() >= -epsilon


def test_thresholds_are_those_of_the_larger_multiplier():
    for larger, name in ((0.24, OVERLAP), (0.26, CHAOS), (0.66, CHAOS), (0.67, IMMEDIATE)):
        for smaller in (-0.2, 0.0, 0.2):
            assert predict(larger + smaller, larger * smaller, True)[0] == name
    for larger, smaller in ((0.1, -0.2), (-0.1, -0.2)):
        assert predict(larger + smaller, larger * smaller, True)[0] == JUMP


# What is said where.


def test_scenarios_of_fig_7():
    found = list(pair_grazings().values())
    assert [entry.label for entry in found] == ["G[2:1->3:1]", "G[3:1->4:1]", "G[4:1->5:1]"]
    assert [entry.scenario.name for entry in found] == [JUMP, OVERLAP, OVERLAP]
    first, second, _ = found
    assert [w.notation for w in first.scenario.windows] == ["3:1"]
    adding = ["4:1", "(7:2)/2T", "(10:3)/3T", "(13:4)/4T", "(16:5)/5T"]
    assert [w.notation for w in second.scenario.windows] == adding
    assert second.as_row()["scenario"] == OVERLAP


@pytest.mark.full
def test_where_the_normal_form_does_not_apply_it_says_why():
    soft = ci.SoftStop(a=1.0, omega=2.2, c=0.3, k=1.0, e=0.3, c_b=0.3, k_b=10.0)
    quiet = ci.find_orbits(soft, "0", "e")[0]
    branch = ci.continue_orbit(quiet, "e", range=(0.1, 0.35), events=["G"])
    (entry,) = real_grazings(branch)
    assert entry.scenario.name == UNDECIDED
    assert entry.scenario.reason == "the wall gives way"
    assert not entry.scenario.windows


@pytest.mark.parametrize(
    ("circuit", "dimensions"),
    [({"V": "v - V/2"}, 3), ({"V": "W", "W": "v - V - W"}, 4)],
    ids=["of first order", "of second order"],
)
def test_dimensions_are_those_of_the_state(circuit, dimensions):
    """The rate of a coordinate of first order is none of it: a circuit on an oscillator."""
    model = {
        "system": "hybrid",
        "period": "pi",
        "modes": {"free": {"x": "v", "v": "a*cos(2*t) - v/10 - x - V/5", **circuit}},
        "guards": {"S": {"within": "x <= 1", "set": {"v": "-7*v/10"}}},
        "parameters": {"a": 2.5},
    }
    follow = {"parameter": "a", "range": [2.0, 4.0], "orbits": ["0"]}
    scene = ci.read_scene({"name": "circuit", "model": model, "follow": follow})
    (orbit,) = ci.find_orbits(scene.model, "0", "a")
    (entry,) = real_grazings(ci.continue_orbit(orbit, range=(2.0, 4.0), events=["G"]))
    assert entry.scenario.reason == f"the return map has {dimensions} dimensions"


def test_a_clock_that_switches_the_force_leaves_the_square_root():
    """A hammer pushed for two fifths of each period. Motions that just hit the stop before the end
    of a period are later for it by parts of the impact's velocity."""
    model = {
        "system": "hybrid",
        "period": "T",
        "modes": {
            "push": {"x": "v", "v": "1 - v/5 - x", "s": "1/T"},
            "rest": {"x": "v", "v": "-v/5 - x", "s": "1/T"},
        },
        "guards": {
            "S": {"mode": "push", "within": "x <= 3/5", "set": {"v": "-v/2"}},
            "K": {"mode": "rest", "within": "x <= 3/5", "set": {"v": "-v/2"}},
            "E": {"mode": "push", "within": "s <= 2/5", "to": "rest"},
            "B": {"mode": "rest", "within": "s <= 1", "to": "push", "set": {"s": 0}},
        },
        "parameters": {"T": 7.0},
    }
    follow = {"parameter": "T", "range": [6.8, 7.2], "orbits": ["SEB"]}
    scene = ci.read_scene({"name": "hammer", "model": model, "follow": follow})
    orbit = next(o for o in ci.find_orbits(scene.model, "SEB", "T", starts=64) if o.stable)
    (entry,) = real_grazings(ci.continue_orbit(orbit, range=(6.8, 7.2), events=["G"]))

    def moved(depth):
        """What the rest of a period makes of a touch that is so much deeper."""
        w = math.sqrt(1 - 0.01)

        def free(x, v, t):
            a, b = x, (v + 0.1 * x) / w
            wave = [math.cos(w * t), math.sin(w * t)]
            return math.exp(-0.1 * t) * (a * wave[0] + b * wave[1])

        top, speed = 0.6 + depth, math.sqrt(2 * 0.6 * depth)
        hit = speed / 0.6  # before the top
        return free(0.6, -speed / 2, 1.0 + hit) - free(top, 0.0, 1.0)

    assert moved(1e-8) / moved(1e-10) == pytest.approx(10, rel=1e-3)
    assert "several coordinates" in entry.scenario.reason


def test_scenarios_are_kept_in_files(tmp_path):
    pair = ci.ImpactPair(beta="pi/6", r=0.3, A=5.0, s=0.27)
    orbit = next(o for o in ci.find_orbits(pair, "3:1", "s") if o.physical and o.stable)
    branch = ci.continue_orbit(orbit, "s", range=(0.24, 0.27), events=["G"])
    diagram = ci.Diagram("one", [branch])
    ci.write_diagram(diagram, tmp_path)
    (entry,) = real_grazings(branch)
    said = (
        "beyond e1, 3:1 at s = 0.256462458: overlapping period adding; windows, to leading order: "
    )
    assert f"{said}(7:2)/2T 0.255718383 to" in str(diagram.reading)
    assert diagram.reading.as_record()["scenarios"][0]["scenario"]["name"] == OVERLAP
    for read in (ci.load_entries(tmp_path), ci.load_diagram(tmp_path).entries):
        assert [one.scenario for one in read if one.id == entry.id] == [entry.scenario]
    written = (tmp_path / "catalogue.json").read_text(encoding="utf-8")
    (tmp_path / "catalogue.json").write_text(written.replace('"trace": ', '"trace": "no", "t": '))
    with pytest.raises(ci.InputError, match="scenario"):
        ci.load_entries(tmp_path)


def test_windows_beyond_all_branches_are_said_to_be_there():
    """Leading order says little of what is far from the grazing."""
    pair = ci.ImpactPair(beta="pi/6", r=0.3, A=5.0, s=0.27)
    orbit = next(o for o in ci.find_orbits(pair, "3:1", "s") if o.physical and o.stable)
    for low, remark in ((0.24, ""), (0.25644, " (beyond all branches)")):
        branch = ci.continue_orbit(orbit, "s", range=(low, 0.27), events=["G"])
        (said,) = ci.Diagram("one", [branch]).reading.scenarios
        first = next(w for w in said.scenario.windows if None not in (w.low, w.high))
        assert first.high < 0.25644
        assert f"{first.low:.9g} to {first.high:.9g}{remark}," in str(said)


def test_windows_that_no_admitted_value_is_in_are_left_out():
    pair = ci.ImpactPair(beta=0.10269381282505924, r=0.55, A=3.0, s=0.17257)
    (orbit,) = (o for o in ci.find_orbits(pair, "1:1/2T", "s") if o.physical and o.stable)
    (entry,) = real_grazings(ci.continue_orbit(orbit, "s", range=(0.17, 0.18), events=["G"]))
    assert entry.scenario.name == IMMEDIATE
    scenario = entry.scenario  # one of its multipliers is near 1, so that leading order is far off
    _, found = predict(scenario.trace, scenario.determinant, away=True)
    unit = scenario.coefficient**2 / scenario.rate
    assert found
    assert all(entry.value - unit * low < 0.0 for _, (low, _) in found)
    assert scenario.windows == ()


def test_windows_with_an_end_that_is_not_admitted_are_left_out():
    """The second window of 3:1 is from 0.25572 to 0.25643; the first has one end."""

    class LongPair(ci.ImpactPair):
        SYSTEM = "long_pair"
        PARAMETERS = tuple(
            dataclasses.replace(p, lower=0.256) if p.name == "s" else p
            for p in ci.ImpactPair.PARAMETERS
        )

    pair = LongPair(beta="pi/6", r=0.3, A=5.0, s=0.27)
    orbit = next(o for o in ci.find_orbits(pair, "3:1", "s") if o.physical and o.stable)
    (entry,) = real_grazings(ci.continue_orbit(orbit, "s", range=(0.2561, 0.27), events=["G"]))
    known = pair_grazings()["3:1"].scenario.windows
    within = [w.notation for w in known if w.low is not None and w.low > 0.256]
    assert [w.notation for w in entry.scenario.windows] == within
