"""Walls that are held in flights that are integrated: against `solve_ivp` on the constrained
equations, and against closed forms."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from integrated import IntegratedMasses
from scipy.integrate import solve_ivp

import contimpact as ci
from contimpact.results.scene import read_scene
from contimpact.simulation.attractor import Kind
from contimpact.simulation.run import Outcome
from contimpact.simulation.settle import settle
from contimpact.simulation.simulator import Simulator
from contimpact.systems.two_masses import TwoMasses

pytest.importorskip("heyoka", reason="needs contimpact[ode]")

LINEAR = {"c1": 0.1, "c2": 0.05, "k1": 1.0, "k2": 0.6, "a1": 1.0, "omega": 0.4}
LINEAR |= {"sigma_1": 0.2, "sigma_2": 0.3, "r": 0.4}


def scene_of(modes, guards, parameters):
    model = {"system": "hybrid", "period": "2*pi/w", "modes": modes, "guards": guards}
    follow = {"parameter": "w", "range": [0.05, 3.0], "orbits": [next(iter(guards))]}
    return {"name": "held", "model": {**model, "parameters": parameters}, "follow": follow}


def model_of(modes, guards, parameters):
    return read_scene(scene_of(modes, guards, parameters)).model


@pytest.mark.full
def test_impacts_releases_and_derivatives_are_those_of_the_closed_form():
    runs, steps, found = [], [], []
    for kind in (TwoMasses, IntegratedMasses):
        simulator = Simulator(kind(**LINEAR))
        runs.append(simulator.run(simulator.state("A", 0.3, 1.0, [0.1, 0.2]), impacts=150))
        steps.append(simulator.derivatives(runs[0].states()))
        found.append(settle(simulator, runs[0].end))
    one, other = runs
    assert other.word == one.word
    assert other.held.tolist() == one.held.tolist()
    assert (np.count_nonzero(one.released), np.count_nonzero(one.held)) == (6, 11)
    assert other.times == pytest.approx(one.times, abs=1e-12)
    assert other.velocities == pytest.approx(one.velocities, abs=1e-12)
    assert other.others == pytest.approx(one.others, abs=1e-12)
    for step, other_step in zip(*steps, strict=True):
        assert other_step == pytest.approx(step, abs=1e-12 * np.max(np.abs(step)))
    assert found[0].kind is found[1].kind is Kind.STICKING
    assert found[1].multipliers == pytest.approx(found[0].multipliers, abs=1e-12)


class Machine:
    """What `solve_ivp` makes of one row of a run: `law(t, x, v)` has an acceleration for each
    coordinate, or its rate if it is one of `first`; walls are (row, side, position, direction)."""

    def __init__(self, law, walls, restitution, first=()):
        self.law, self.walls, self.r, self.first = law, walls, restitution, list(first)

    def after(self, row):
        """Position and velocity after an impact; rates of first order are by the law."""
        normal, _, place, push = self.walls[row.wall]
        at = int(np.argmax(normal))
        x, v = np.zeros(len(normal)), np.zeros(len(normal))
        others = [i for i in range(len(normal)) if i != at]
        x[others], v[others] = row.others[::2], row.others[1::2]
        x[at], v[at] = (place - normal @ x) / normal[at], (row.velocity - normal @ v) / normal[at]
        if not row.released:
            v -= (1.0 + self.r) * row.velocity * np.array(push)
        return x, v

    def next(self, before, here, period):
        """The time, the wall and the state at the end of a flight in which walls are held."""
        held = [k for k in range(len(self.walls)) if here.held >> k & 1]
        x, v = self.after(before)
        n = np.array([self.walls[k][0] for k in held]).reshape(len(held), len(x))
        w = np.array([self.walls[k][3] for k in held]).reshape(len(held), len(x)).T
        if held:
            places = np.array([self.walls[k][2] for k in held])
            x = x - w @ np.linalg.solve(n @ w, n @ x - places)
            v = v - w @ np.linalg.solve(n @ w, n @ v)

        def pushes(t, y):
            x, v = np.reshape(y, (2, -1))
            a = np.array(self.law(t, x, v))
            a[self.first] = 0.0
            return np.linalg.solve(n @ w, n @ a)

        def flow(t, y):
            x, v = np.reshape(y, (2, -1)).copy()
            a = np.array(self.law(t, x, v))
            v[self.first] = a[self.first]
            a[self.first] = 0.0
            return [*v, *(a - w @ np.linalg.solve(n @ w, n @ a) if held else a)]

        def arrival(k):
            normal, side, place, _ = self.walls[k]
            return lambda t, y: side * (np.dot(normal, y[: len(normal)]) - place)

        def release(k):
            side = self.walls[held[k]][1]
            return lambda t, y: -side * pushes(t, y)[k]

        free = [k for k in range(len(self.walls)) if k not in held]
        events = [*map(arrival, free), *map(release, range(len(held)))]
        for event in events:
            event.terminal, event.direction = True, 1
        begin = before.phase + before.turns * period
        tight = {"rtol": 1e-12, "atol": 1e-14, "method": "DOP853", "events": events}
        tight |= {"first_step": 1e-3 if before.released else 1e-5, "max_step": period / 50}
        found = solve_ivp(flow, (begin, begin + 9 * period), [*x, *v], **tight)
        (met,) = [k for k, times in enumerate(found.t_events) if len(times)]
        return found.t[-1], [*free, *held][met], found.y[:, -1]


def compare(simulator, run, machine, least=1e-3):
    """Check the rows of a run but those after slow impacts, or at once; return the sets held."""
    seen = []
    for before, here in pairwise(run.states()):
        known = here.released or before.released or abs(before.velocity) > least
        if not (known and here.since(before, simulator.period) > least):
            continue
        time, wall, state = machine.next(before, here, simulator.period)
        x, v = np.reshape(state, (2, -1))
        assert wall == here.wall
        assert here.phase + here.turns * simulator.period == pytest.approx(time, abs=1e-10)
        assert here.velocity == pytest.approx(machine.walls[wall][0] @ v, abs=1e-10)
        others = [i for i in range(len(x)) if i != int(np.argmax(machine.walls[wall][0]))]
        assert here.others[::2] == pytest.approx(x[others], abs=1e-10)
        second = [i for i in others if i not in machine.first]
        rates = [here.others[1::2][others.index(i)] for i in second]
        assert rates == pytest.approx(v[second], abs=1e-10)
        seen.append((here.held, here.released))
    return seen


HARVESTER = {"w": 0.2, "A": 3.0, "z": 0.05, "th": 0.4, "tau": 2.0, "d": 1.2, "r": 0.3}
WELLS = {"x": "v", "v": "x - x**3 - 2*z*v + th*V + A*cos(w*t)"}
STOPS = {
    "B": {"within": "x >= -d", "set": {"v": "-r*v"}},
    "T": {"within": "x <= d", "set": {"v": "-r*v"}},
}


def harvester(coupling="1", **changed):
    modes = {"m": {**WELLS, "V": f"-V/tau - ({coupling})*v"}}
    return model_of(modes, STOPS, HARVESTER | changed)


def harvester_machine(values, coupling=lambda x: 1.0):
    def law(t, x, v):
        spring = x[0] - x[0] ** 3 - 2 * values["z"] * v[0] + values["th"] * x[1]
        push = spring + values["A"] * np.cos(values["w"] * t)
        return [push, -x[1] / values["tau"] - coupling(x[0]) * v[0]]

    d = values["d"]
    walls = [(np.array([1.0, 0.0]), side, side * d, [1.0, 0.0]) for side in (-1, 1)]
    return Machine(law, walls, values["r"], first=[1])


@pytest.mark.parametrize("mode", ["never", "always"])
@pytest.mark.parametrize("coupling", ["1", "1 + x/2"])
@pytest.mark.parametrize("r", [0.3, 0.0])
@pytest.mark.quick(1)
def test_a_bistable_harvester_sticks(r, coupling, mode, monkeypatch):
    monkeypatch.setenv("CONTIMPACT_COMPILED", mode)
    simulator = Simulator(harvester(coupling, r=r))
    run = simulator.run(simulator.state("T", 0.3, 0.5, [0.1, 0.0]), impacts=60)
    slope = {"1": 0.0, "1 + x/2": 0.5}[coupling]
    machine = harvester_machine(simulator.model.values, lambda x: 1.0 + slope * x)
    seen = compare(simulator, run, machine)
    assert {(1, True), (2, True), (0, False)} <= set(seen)
    found = settle(simulator, run.end)
    assert (found.kind, found.word, found.period) == (Kind.STICKING, "B*T*", 1)


@pytest.mark.parametrize("r", [0.0, 0.3])
@pytest.mark.full
def test_multipliers_of_sticking_are_those_of_differences(r):
    """Of motions one and two periods after their voltages differ; all else is forgotten."""
    simulator = Simulator(harvester(r=r, w=0.5, A=2.5, tau=9.0))
    attractor = settle(simulator)
    assert attractor.kind is Kind.STICKING
    state, count = attractor.state, len(attractor.walls)

    def volts_later(change):
        volts, *rest = state.others
        begun = replace(state, others=(volts + change, *rest))
        rows = simulator.run(begun, impacts=2 * count).states()
        return np.array([rows[k * count - 1].others[0] for k in (1, 2)])

    once, twice = volts_later(1e-4) - volts_later(-1e-4)
    assert attractor.multipliers[0] == pytest.approx(twice / once, rel=1e-5)
    assert attractor.multipliers[1:] == pytest.approx((0.0, 0.0, 0.0), abs=1e-15)


MASSES = {
    "x": "u",
    "u": "-x - x**3/2 - u/10 + k*(y - x) + a*cos(w*t)",
    "y": "v",
    "v": "-y/2 - sin(y) - v/20 - k*(y - x)",
}
MASS_WALLS = {
    "A": {"within": "x <= 0.2", "set": {"u": "-r*u"}},
    "B": {"within": "y <= 0.15", "set": {"v": "-r*v"}},
}
MASS_VALUES = {"w": 0.5, "k": 0.6, "a": 1.5, "r": 0.4}


def mass_law(t, x, v):
    k, a, w = (MASS_VALUES[name] for name in "kaw")
    push = -x[0] - x[0] ** 3 / 2 - v[0] / 10 + k * (x[1] - x[0]) + a * np.cos(w * t)
    return [push, -x[1] / 2 - np.sin(x[1]) - v[1] / 20 - k * (x[1] - x[0])]


def test_a_mass_is_held_while_another_one_hits_its_wall():
    simulator = Simulator(model_of({"m": MASSES}, MASS_WALLS, MASS_VALUES))
    run = simulator.run(simulator.state("A", 0.3, 1.0, [0.1, 0.2]), impacts=150)
    walls = [(np.eye(2)[0], 1, 0.2, [1.0, 0.0]), (np.eye(2)[1], 1, 0.15, [0.0, 1.0])]
    seen = compare(simulator, run, Machine(mass_law, walls, 0.4))
    assert {(1, False), (1, True), (0, False)} <= set(seen)


def test_a_flight_starts_anywhere():
    simulator = Simulator(model_of({"m": MASSES}, MASS_WALLS, MASS_VALUES))
    first = simulator.start(0.2, [0.0, 0.0], [1.0, 0.1])

    def flow(t, y):
        return [*y[2:], *mass_law(t, y[:2], y[2:])]

    def arrives(t, y):
        return y[0] - 0.2

    arrives.terminal = True
    tight = {"rtol": 1e-12, "atol": 1e-14, "method": "DOP853", "events": arrives}
    found = solve_ivp(flow, (0.2, 9.0), [0.0, 0.0, 1.0, 0.1], **tight)
    assert (first.wall, first.turns) == (0, 0)
    assert first.phase == pytest.approx(found.t[-1], abs=1e-10)
    assert (first.others[0], *first.section[::2]) == pytest.approx(found.y[1:, -1], abs=1e-10)


PUSHED = {
    "x": "u",
    "u": "2 + a*cos(w*t) - x/2 - u/5 - 0.3*x**3",
    "y": "v",
    "v": "-1/2 - y/2 - v/5 - sin(y)/3",
}
CONTACTS = {
    "K": {"within": "x - y <= 0", "set": {"u": "0.35*u + 0.65*v", "v": "0.65*u + 0.35*v"}},
    "B": {"within": "y <= 0.2", "set": {"v": "-0.3*v"}},
}


@pytest.mark.parametrize("values", [{"a": 3.0, "w": 0.5}, {"a": 2.0, "w": 1.0}])
@pytest.mark.full
def test_two_bodies_in_contact_rest_against_a_wall(values):
    def law(t, x, v):
        push = 2.0 + values["a"] * np.cos(values["w"] * t) - x[0] / 2 - v[0] / 5
        return [push - 0.3 * x[0] ** 3, -0.5 - x[1] / 2 - v[1] / 5 - np.sin(x[1]) / 3]

    simulator = Simulator(model_of({"m": PUSHED}, CONTACTS, values))
    run = simulator.run(simulator.state("K", 0.3, 1.0, [-0.1, 0.1]), impacts=200)
    walls = [(np.array([1.0, -1.0]), 1, 0.0, [0.5, -0.5]), (np.eye(2)[1], 1, 0.2, [0.0, 1.0])]
    seen = compare(simulator, run, Machine(law, walls, 0.3))
    assert {(3, True), (0, False)} <= set(seen)
    found = settle(simulator, run.end)
    assert (found.kind, found.period) == (Kind.STICKING, 1)


MODES_OF_TWO = {
    "A": {"mode": "small", "within": "x <= 0.2", "set": {"v": "-r*v"}},
    "J": {"mode": "small", "within": "x >= -0.3", "to": "big", "set": {"y": "0*x", "s": "v"}},
    "B": {"mode": "big", "within": "y <= 0.15", "set": {"s": "-r*s"}},
    "L": {"mode": "big", "within": "x <= 0.1", "to": "small"},
}


def modes_of_two(force, other):
    """A mode of one coordinate, and one of two with other forces."""
    push = "- x - v/10 + a*cos(w*t)"
    big = {"x": "v", "v": f"{push} + k*(y - x){other}", "y": "s", "s": "-y - s/5 - k*(y - x)"}
    modes = {"big": big, "small": {"x": "v", "v": push + force}}
    return Simulator(model_of(modes, MODES_OF_TWO, MASS_VALUES | {"a": 2.0, "w": 0.4}))


@pytest.mark.parametrize("other", ["", " - x**3/3"], ids=["other linear", "other integrated"])
@pytest.mark.parametrize("spring", [0.0, 1.0], ids=["linear", "integrated"])
@pytest.mark.full
def test_a_wall_is_held_in_a_mode_of_fewer_coordinates(spring, other):
    """The mode of two coordinates is linear, or integrated, too; in that of one it is as of one
    coordinate alone, which has no reaction of the other."""
    simulator = modes_of_two(" - x**3/3" if spring else "", other)
    run = simulator.run(simulator.state("A", 0.3, 1.0, [0.0, 0.0]), impacts=80)
    release = next(k for k in range(80) if run.released[k])
    held = 0.2 + spring * 0.2**3 / 3.0
    assert run.times[release] == pytest.approx(np.arccos(held / 2.0) / 0.4, abs=1e-12)
    found = settle(simulator, run.end)
    assert (found.kind, found.word, found.period) == (Kind.STICKING, "A*JBL", 1)


def test_motion_without_impacts_is_known_in_a_mode_of_fewer_coordinates():
    simulator = Simulator(modes_of_two("", "").model.replace(a=0.01))
    found = settle(simulator, None, mode="small")
    response = 0.01 / complex(1.0 - 0.4**2, 0.1 * 0.4)
    assert found.kind is Kind.NO_IMPACT
    expected = response.real, -0.4 * response.imag, 0.0, 0.0
    assert found.motion == pytest.approx(expected, abs=1e-15)


RESTING = {"x": "u", "u": "1 - u/5 + cos(w*t)/5 + x**3", "y": "v", "v": "-y - v/5 - y**3"}


@pytest.mark.parametrize(
    ("change", "law", "outcome"),
    [
        ({}, {}, Outcome.RESTING),
        ({"v": "v + u*y/3"}, {}, Outcome.ACCUMULATING),
        ({}, {"v": "y**3"}, Outcome.RUNAWAY),
        ({}, {"v": "50*y**3"}, Outcome.RUNAWAY),
    ],
    ids=["rests", "impacts push in many directions", "escapes", "escapes at once"],
)
def test_how_a_wall_that_is_pressed_for_ever_ends_a_run(change, law, outcome):
    guards = {"S": {"within": "x <= 0.5", "set": {"u": "-r*u"} | change}}
    simulator = Simulator(model_of({"m": RESTING | law}, guards, {"w": 1.0, "r": 0.3}))
    run = simulator.run(simulator.state("S", 0.3, 1.0, [0.9, 0.0]), impacts=100)
    assert run.outcome is outcome


FORCED = "-V/tau - v + 0.7*cos(w*t)"


@pytest.mark.parametrize("spring", ["-x/5", "x - x**3"], ids=["linear", "integrated"])
@pytest.mark.full
def test_derivatives_know_that_a_circuit_is_forced(spring):
    """By differences, of the time and the voltage of an impact after which the wall is held: the
    rate that it leaves depends on the time, too."""
    push = f"{spring} - 2*z*v + th*V + A*cos(w*t)"
    values = HARVESTER | {"r": 0.0, "w": 0.5, "A": 2.5, "tau": 9.0}
    simulator = Simulator(model_of({"m": {"x": "v", "v": push, "V": FORCED}}, STOPS, values))
    run = simulator.run(simulator.state("T", 0.3, 0.5, [0.1, 0.0]), impacts=8)
    pairs = [pair for pair in pairwise(run.states()) if pair[1].released]
    assert len(pairs) > 2
    for before, here in pairs:
        found = simulator.derivative(before, here)[:, [0, 2]]

        def moved(time, volts, before=before):
            others = before.others[0] + volts, before.others[1]
            there = simulator.machine.next(
                replace(before, phase=before.phase + time, others=others)
            )
            return np.array([there.turns * simulator.period + there.phase, *there.section])

        slopes = [moved(1e-6, 0.0) - moved(-1e-6, 0.0), moved(0.0, 1e-6) - moved(0.0, -1e-6)]
        assert found == pytest.approx(np.array(slopes).T / 2e-6, abs=1e-7)


@pytest.mark.full
def test_sweeps_and_fractions_of_a_bistable_harvester_show_that_it_sticks():
    found = ci.sweep(harvester(), "A", [3.0, 2.5, 2.0])
    assert [attractor.kind for attractor in found.attractors] == [Kind.STICKING] * 3
    alone = settle(Simulator(harvester(A=2.0)))
    assert found.attractors[-1].multipliers[0] == pytest.approx(alone.multipliers[0], rel=1e-6)
    box = {"position": [[-1.0, 1.0], [0.0, 0.0]]}
    counted = ci.basin_fractions(harvester(), "A", [3.0], starts=5, box=box)
    assert counted.fractions.tolist() == [[1.0]]


def test_exponents_follow_the_flow_from_impact_to_impact():
    """The derivatives of integrated flights, solved for between their ends, took nearly all of the
    time of chaotic motion; along the flow they agree but for what disturbances grow by."""
    simulator = Simulator(harvester(w=1.0, r=0.7))
    run = simulator.run(simulator.random_state(np.random.default_rng(0)), impacts=200)
    states = run.states()
    solved, along = (simulator.derivatives(states, along) for along in (False, True))
    sizes = np.max(np.abs(solved), axis=(1, 2))
    assert np.max(np.max(np.abs(along - solved), axis=(1, 2)) / sizes) < 1e-9
    assert not np.array_equal(along, solved)
