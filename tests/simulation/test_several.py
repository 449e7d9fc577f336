"""Simulation with several coordinates: orbits, chatter, sticking, exponents, against others."""

from __future__ import annotations

import itertools
import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from zoo import TWO_MASSES, ProportionalMasses

from contimpact import losses
from contimpact.errors import InputError
from contimpact.orbits.search import find_orbits
from contimpact.results.options import Settling
from contimpact.results.scene import read_scene
from contimpact.simulation.attractor import Attractor, Kind
from contimpact.simulation.automaton import _segment_jacobian, _track_jacobian
from contimpact.simulation.run import State
from contimpact.simulation.settle import exponents_of, settle
from contimpact.simulation.simulator import Simulator
from contimpact.simulation.sweep import basins, same_attractor, sweep
from contimpact.systems.coupled_by_impact import CoupledByImpact
from contimpact.systems.impact_damper import ImpactDamper
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.two_masses import TwoMasses

VALUES = TWO_MASSES | {"omega": 1.8, "sigma_1": 1.0, "sigma_2": 1.0}
STICKING = {"omega": 0.6, "sigma_1": 0.1, "sigma_2": 0.3, "r": 0.5}
RELEASED = (1.0098, (0.0864, -0.0536))
"""Near an impact on B of the motion with sojourns on A."""
QUICK = Settling(transient=60, periods=300)


def masses(**given):
    return TwoMasses(**(VALUES | given))


@pytest.fixture(scope="module")
def sticking():
    simulator = Simulator(masses(**STICKING))
    start = simulator.state("B", 0.173, *RELEASED)
    return simulator, settle(simulator, start, QUICK)


def test_rates_of_coordinates_without_inertia_are_asked_for_where_there_are_such(sticking):
    simulator, _ = sticking
    known = simulator.kernels.loaded + simulator.kernels.generated
    assert any(name.startswith("law_") for name in known)
    assert not any(name.startswith("rates_") for name in known)


SLOW = pytest.mark.slow
ORBITS = [
    pytest.param(masses(), "A", marks=SLOW),
    (masses(omega=1.0), "AB"),
    (ImpactDamper(Omega=1, d=20, r=0.8, mu=0.1, zeta=0.01), "RL"),
    pytest.param(
        CoupledByImpact(m2=2, c1=0.1, c2=0.2, k1=1, k2=2, a1=1, omega=1.3, gap=0.2, r=0.7),
        "K",
        marks=SLOW,
    ),
    pytest.param(
        ProportionalMasses(k1=1.0, k2=0.6, omega=1.8, r=0.8, a=1.0, c=0.07, sigma=1.0),
        "A",
        marks=SLOW,
    ),
]


@pytest.mark.parametrize(("model", "word"), ORBITS, ids=lambda x: getattr(x, "SYSTEM", x))
@pytest.mark.quick(1)
def test_it_settles_on_the_stable_orbit(model, word):
    """Word, times, all coordinates and multipliers; measured to a few 1e-15."""
    orbits = find_orbits(model, word, parameter="r", starts=24)
    orbit = next(o for o in orbits if o.stable and o.physical)
    impacts = orbit.problem.impacts(orbit.unknowns)
    simulator = Simulator(model)
    begin = impacts[0] * (1.0 + 1e-3)
    found = settle(simulator, simulator.state(word[0], *begin[:2], begin[2:]), QUICK)
    assert (found.kind, found.word) == (Kind.PERIODIC, word)
    late = (found.times - impacts[:, 0]) / simulator.period
    assert late == pytest.approx(np.round(late), abs=1e-10)
    assert np.column_stack([found.velocities, found.others]) == pytest.approx(
        impacts[:, 1:], abs=1e-10
    )
    assert np.poly(found.multipliers) == pytest.approx(np.poly(orbit.multipliers), abs=1e-9)


def test_masri_s_damper_is_settled_on():
    """x at impact, and the velocity of the ball itself before it, V."""
    model = ImpactDamper(Omega=1.0, d=20.0, r=0.8, mu=0.1, zeta=0.01)
    simulator = Simulator(model)
    found = settle(simulator, simulator.state("R", 3.0, 9.0, [2.0, -1.5]), QUICK)
    assert found.notation == "1:1"
    assert abs(found.others[0, 0]) == pytest.approx(2.0901334328, abs=1e-10)
    x, v, y = found.others[0, 0], found.others[0, 1], found.velocities[0]
    assert v + y == pytest.approx(math.copysign(7.6968179939, x), abs=1e-10)


def test_a_run_is_that_of_an_integrator_with_events():
    """Impacts on both stops, from a start between them."""
    model = masses(omega=1.3, sigma_1=0.5, sigma_2=0.4)
    p, simulator = model.values, Simulator(model)
    first = simulator.start(0.2, [0.1, -0.3], [0.4, 0.6])
    found = [first, *simulator.run(first, impacts=11).states()]
    assert {state.wall for state in found} == {0, 1}

    def rate(t, z):
        x, y, u, v = z
        push = p["a1"] * math.cos(p["omega"] * t)
        coupling = p["c2"] * (u - v) + p["k2"] * (x - y)
        return [u, v, push - p["c1"] * u - p["k1"] * x - coupling, coupling]

    def event(k):
        def gap(t, z):
            return z[k] - (p["sigma_1"], p["sigma_2"])[k]

        gap.terminal, gap.direction = True, 1
        return gap

    t, z = 0.2, np.array([0.1, -0.3, 0.4, 0.6])
    given = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-14, "events": [event(0), event(1)]}
    for state in found:
        walk = solve_ivp(rate, (t, t + 50.0), z, **given)
        t, z = walk.t[-1], walk.y[:, -1].copy()
        wall = 0 if len(walk.t_events[0]) else 1
        assert wall == state.wall
        assert state.phase + state.turns * simulator.period == pytest.approx(t, abs=1e-9)
        other = z[[1, 3]] if wall == 0 else z[[0, 2]]
        assert [z[2 + wall], *other] == pytest.approx(state.section, abs=1e-9)
        z[2 + wall] *= -p["r"]


def test_bodies_that_rest_on_each_other_move_as_one():
    """The sum of both equations, and the container with the ball against its end."""
    m = {"m1": 1.3, "m2": 2.0, "c1": 0.1, "c2": 0.2, "k1": 1.0, "k2": 2.0, "a1": 1.0, "a2": 0.4}
    pair = Simulator(CoupledByImpact(**m, omega=1.3, gap=0.2, r=0.7)).machine.flying(0, 1)
    x, v, phase = np.array([0.5, 0.3]), np.array([0.7, 0.7]), 0.4
    found = pair.rate(pair.embedded(x, v, phase))[2:]
    force = -(m["c1"] + m["c2"]) * 0.7 - m["k1"] * 0.5 - m["k2"] * 0.3
    force += (m["a1"] + m["a2"]) * math.cos(1.3 * phase)
    assert found == pytest.approx([force / (m["m1"] + m["m2"])] * 2, abs=1e-14)
    damper = Simulator(ImpactDamper(Omega=1.1, d=2.0, r=0.5, mu=0.2, zeta=0.05)).machine.flying(
        0, 1
    )
    found = damper.rate(damper.embedded([0.3, 1.0], [0.5, 0.0], phase))[2:]
    force = math.cos(1.1 * phase) - 2 * 0.05 * 0.5 - 0.3
    assert found == pytest.approx([force / 1.2, 0.0], abs=1e-14)


@pytest.mark.full
def test_a_motion_with_sojourns_is_told(sticking):
    simulator, found = sticking
    assert (found.kind, found.word, found.notation) == (Kind.STICKING, "AABA*", "inf:1")
    assert found.multipliers[2:] == (0.0, 0.0)
    assert found.distance < QUICK.tolerance
    assert same_attractor(found, settle(simulator, found.state, QUICK))
    back = Attractor.from_record(found.as_record())
    back.require(simulator.model)
    assert np.array_equal(back.others, found.others)
    assert back.state == found.state


def test_the_derivative_through_a_sojourn_is_that_of_differences(sticking):
    simulator, found = sticking
    start = found.state
    reached = simulator.run(start, impacts=60)
    after = int(np.nonzero(reached.released)[0][0]) + 1
    product = np.eye(4)
    for pair in itertools.pairwise([start, *reached.states()[: after + 1]]):
        product = simulator.derivative(*pair) @ product

    def row(moved):
        section = np.add(start.section, moved[1:])
        state = simulator.state("B", start.phase + moved[0], section[0], section[1:])
        run = simulator.run(state, impacts=60)
        end = run.states()[int(np.nonzero(run.released)[0][0]) + 1]
        return np.array([end.phase + end.turns * simulator.period, *end.section])

    step = 1e-6
    differences = [(row(step * e) - row(-step * e)) / (2 * step) for e in np.eye(4)]
    assert product == pytest.approx(np.array(differences).T, abs=1e-7)


def test_runs_join_also_within_a_sojourn(sticking):
    simulator, found = sticking
    whole = simulator.run(found.state, impacts=90).states()
    for cut in (1, 27, 28, 29):
        first = simulator.run(found.state, impacts=cut)
        rest = simulator.run(first.end, impacts=90 - cut)
        assert [*first.states(), *rest.states()] == whole


def test_both_ways_to_the_derivative_agree():
    model = masses(omega=1.0)
    simulator = Simulator(model)
    states = simulator.run(simulator.state("A", 0.2, 1.0, [0.1, 0.2]), impacts=12).states()
    assert {state.wall for state in states} == {0, 1}
    for pair in itertools.pairwise(states):
        one, other = (way(simulator.machine, *pair) for way in (_segment_jacobian, _track_jacobian))
        assert one == pytest.approx(other, abs=1e-10 * np.max(np.abs(one)))


@pytest.mark.full
def test_the_sum_of_the_exponents_is_what_impacts_and_damping_take():
    """Of complex motion: ln r^2 of each impact, and the trace of the damping over the time."""
    model = masses(omega=1.5)
    simulator = Simulator(model)
    start = simulator.run(simulator.state("A", 0.3, 2.0, [0.1, 0.2]), periods=30).end
    found = exponents_of(simulator, start, simulator.run(start, impacts=400))
    p = model.values
    trace = (p["c1"] + p["c2"]) / p["m1"] + p["c2"] / p["m2"]
    taken = trace * found.periods * simulator.period / found.impacts
    assert found.restitution == pytest.approx(2.0 * math.log(p["r"]), rel=1e-14)
    assert sum(found.per_impact) == pytest.approx(found.restitution - taken, abs=1e-3)
    assert found.per_impact[0] > 3.0 * found.error


@pytest.mark.slow
def test_exponents_of_a_stable_orbit_are_those_of_its_multipliers():
    model = masses()
    simulator = Simulator(model)
    found = settle(simulator, simulator.state("A", 0.68, 3.0, [-2.0, 0.09]), QUICK)
    measured = exponents_of(simulator, found.state, simulator.run(found.state, impacts=600))
    expected = [math.log(abs(mu)) for mu in found.multipliers]
    assert found.exponents == pytest.approx(expected)
    assert measured.per_impact == pytest.approx(expected, abs=5e-3)


@pytest.mark.slow
def test_a_sweep_goes_from_orbit_to_orbit_and_has_all_coordinates():
    found = sweep(masses(), "omega", [1.0, 0.95], settling=QUICK)
    assert [row.attractor.word for row in found.rows] == ["AB", "AB"]
    from contimpact.simulation.sweep import table_of

    columns, rows = table_of(found)
    assert {"exponent4", "multiplier4_im", "x1_2", "v1_2"} <= set(columns)
    assert all(len(row) == len(columns) for row in rows)


@pytest.mark.full
def test_complex_motion_has_all_coordinates():
    simulator = Simulator(masses(omega=1.5))
    few = Settling(transient=20, periods=40, impacts=300)
    found = settle(simulator, simulator.state("A", 0.3, 2.0, [0.1, 0.2]), few)
    assert found.kind is Kind.COMPLEX
    assert found.others.shape == (300, 2)
    found.require(simulator.model)
    taken = losses(found, simulator.model)
    assert taken.impacts == pytest.approx(0.18 * found.velocities**2, rel=1e-12)


@pytest.mark.slow
def test_basins_are_a_section_with_the_other_coordinates_of_an_attractor():
    simulator = Simulator(masses())
    known = settle(simulator, simulator.state("A", 0.68, 3.0, [-2.0, 0.09]), QUICK)
    found = basins(simulator, shape=(2, 3), settling=QUICK, known=[known])
    assert found.others == tuple(known.others[0])
    assert found.labels.shape == (2, 3)
    kinds = {a.kind for a in found.attractors}
    assert kinds <= {Kind.PERIODIC, Kind.NO_IMPACT}


@pytest.mark.parametrize(
    ("call", "where"),
    [
        (lambda s: s.state("A", 0.0, 1.0), "others"),
        (lambda s: s.state("A", 0.0, 1.0, [0.1]), "others"),
        (lambda s: s.fly(0, 0.0, 1.0), "others"),
        (lambda s: s.pressed(0, 0.0), "pressed"),
        (lambda s: s.start(0.0, [2.0, 0.0], [0.0, 0.0]), "position"),
        (lambda s: s.start(0.0, [0.0], [0.0]), "position"),
        (lambda s: s.start(0.0, [0.0, 0.0], [0.0, 0.0], "other"), "mode"),
    ],
)
def test_what_cannot_be_simulated_is_refused(call, where):
    with pytest.raises(InputError) as refused:
        call(Simulator(masses()))
    assert refused.value.where == where


def test_a_flight_is_that_of_a_run():
    simulator = Simulator(masses())
    run = simulator.run(simulator.state("A", 0.3, 2.0, [0.1, 0.2]), impacts=40)
    flights = [
        pair for pair in itertools.pairwise(run.states()) if not (pair[1].held or pair[1].released)
    ]
    assert len(flights) > 20
    for before, after in flights:
        wall, dt, velocity = simulator.fly(
            before.wall, before.phase, before.velocity, before.others
        )
        expected = (after.turns - before.turns) * simulator.period + after.phase - before.phase
        assert wall == after.wall
        assert (dt, velocity) == pytest.approx((expected, after.velocity), abs=1e-10)


def test_it_rests_for_ever_or_meets_nothing():
    rests = Simulator(masses(a1=0.0, sigma_1=-0.4, sigma_2=0.5), longest_flight=30)
    run = rests.run(rests.state("A", 0.0, 0.1, [-0.3, 0.0]), impacts=200)
    assert run.outcome.name == "RESTING"
    assert run.end.held == 0  # the last impact is before the sojourn
    free = Simulator(masses(a1=0.0), longest_flight=30)
    run = free.run(replace(State(0, 0.0, 0.1), others=(0.0, 0.0)), impacts=9)
    assert run.outcome.name == "NO_IMPACT"


@pytest.mark.slow
def test_where_a_wall_cannot_be_held_the_run_ends_and_says_so():
    model = ProportionalMasses(k1=1.0, k2=0.6, omega=0.3, r=0.3, a=2.0, c=0.07, sigma=0.0)
    simulator = Simulator(model)
    run = simulator.run(simulator.state("A", 0.1, 0.3, [0.0, 0.0]), periods=9)
    assert run.outcome.name == "ACCUMULATING"
    assert settle(simulator, run.end, QUICK).kind is Kind.NOT_SETTLED


PUSHED = """
name = "pushed"
[model]
system = "linear"
coordinates = ["x", "y"]
mass = [1, 1]
damping = [0.2, 0.2]
stiffness = [0.5, 0.5]
force = ["2 + a*cos(t)", "-0.5"]
period = "2*pi"
[model.guards]
K = { within = "x - y <= 0", restitution = 0.3 }
B = { within = "y <= 0.2", restitution = 0.5 }
[model.parameters]
a = 2.0
[follow]
parameter = "a"
range = [1.0, 3.0]
orbits = ["K"]
"""


def test_an_impact_elsewhere_parts_what_rests_on_each_other():
    """One body pushes the other against a wall: that bounces back into the first."""
    simulator = Simulator(read_scene(tomllib.loads(PUSHED)).model)
    first = simulator.start(0.0, [-1.0, -0.5], [0.0, 0.0])
    rows = [first, *simulator.run(first, impacts=80).states()]
    pairs = [p for p in itertools.pairwise(rows) if p[0].wall == 1 and p[0].held == 1]
    assert pairs
    for hit, back in pairs:
        assert (back.wall, back.held) == (0, 0)
        assert back.phase - hit.phase == pytest.approx(0.0, abs=1e-12)
        assert back.velocity == pytest.approx(1.5 * hit.velocity, rel=1e-12)


TWINS = """
name = "twins"
[model]
system = "linear"
coordinates = ["x", "y"]
mass = [1, 1]
damping = [0.1, 0.1]
stiffness = [["1 + c", "-c"], ["-c", "1 + c"]]
force = ["cos(w*t)", "cos(w*t)"]
period = "2*pi/w"
[model.guards]
A = { within = "x <= s", restitution = "r" }
B = { within = "y <= s", restitution = "r" }
[model.parameters]
c = 0.3
w = 1.3
s = 0.3
r = 0.0
[follow]
parameter = "w"
range = [0.3, 2.0]
orbits = ["AB"]
"""


@pytest.mark.parametrize(
    ("w", "s", "r", "word"),
    [(1.3, 0.3, 0.0, "A*B*"), (0.6, 0.1, 0.3, "AB" * 16 + "A*B*"), (0.6, 0.1, 0.6, "ABABABAB")],
)
@pytest.mark.quick(1)
def test_two_that_hit_and_part_at_once_move_as_one(w, s, r, word):
    """Released together, neither hits again, and neither stays; and the word does not change."""
    model = read_scene(tomllib.loads(TWINS)).model.replace(w=w, s=s, r=r)
    both, one = Simulator(model), Simulator(Oscillator(a=1, omega=w, c=0.1, k=1, sigma=s, r=r))
    start = both.start(0.1, [-0.2, -0.2], [0.0, 0.0])
    rows = both.run(start, impacts=150).states()
    alone = one.run(one.start(0.1, -0.2, 0.0), impacts=200).states()
    times = np.array([row.turns * one.period + row.phase for row in alone])
    for row in rows[1:]:
        k = np.argmin(np.abs(times - row.turns * one.period - row.phase))
        assert times[k] == pytest.approx(row.turns * one.period + row.phase, abs=1e-12)
        assert alone[k].velocity == pytest.approx(row.velocity, abs=1e-12)
    found = settle(both, start, QUICK)
    assert (found.word, found.period) == (word, 1)


def test_two_balls_that_come_to_rest_on_each_other_together():
    """The upper one pushes the lower one into the table, which it leaves for the next impact: in
    ever shorter turns, which did not end. Both rest, then, until the table falls away from under
    them, and fly as one until they meet it."""
    weight = "-g + a*w**2*cos(w*t)"
    machine = {"coordinates": ["y", "z"], "mass": [1, "m"], "period": "2*pi/w"}
    machine["force"] = [weight, f"m*({weight})"]
    guards = {"F": {"within": "y >= 0", "restitution": 0.5}}
    guards["C"] = {"within": "z - y >= 0", "restitution": 0.6}
    values = {"g": 1.0, "a": 1.0, "w": 2.8, "m": 0.5}
    model = {"system": "linear", **machine, "guards": guards, "parameters": values}
    follow = {"parameter": "w", "range": [1.0, 4.0], "orbits": ["FC"]}
    scene = read_scene({"name": "column", "model": model, "follow": follow})
    simulator = Simulator(scene.model)
    run = simulator.run(simulator.state("F", 0.9, -0.01, [1e-3, -0.01]), impacts=300)
    release = next(k for k, row in enumerate(run.states()) if row.released and row.held == 3)
    begin = (2.0 * math.pi - math.acos(1.0 / 2.8**2)) / 2.8
    assert run.phases[release] == pytest.approx(begin, abs=1e-13)

    def height(t):
        return -0.5 * t * t - math.cos(2.8 * t), -t + 2.8 * math.sin(2.8 * t)

    (y, v), rise = height(begin), lambda t: height(t)[0] - y - v * (t - begin)
    meeting = brentq(rise, begin + 5.0, begin + 6.5, xtol=1e-15)
    hit = release + int(np.argmax(run.velocities[release:] < -1e-3))
    assert run.times[hit] - run.times[release] == pytest.approx(meeting - begin, abs=1e-12)
    assert run.velocities[hit] == pytest.approx(height(meeting)[1] - v, abs=1e-12)


def test_two_balls_that_leave_a_table_together_do_not_touch_in_the_air():
    """Rounding of what a held system's velocities cancel to made 18 impacts of 1e-32 where both
    are released; their derivatives of 4e31 hid that the motion repeats itself."""
    modes = {"m": {"x": "u", "u": "sin(w*t)*w**2 - 1", "y": "v", "v": "sin(w*t)*w**2 - 1"}}
    guards = {"T": {"within": "x >= 0", "set": {"u": "-u/2"}}}
    swapped = {"u": "u/4 + 3*v/4", "v": "3*u/4 + v/4"}
    guards["B"] = {"within": "y - x >= 0", "set": swapped}
    values = {"w": 1.296875}
    model = {"system": "hybrid", "modes": modes, "guards": guards, "parameters": values}
    follow = {"parameter": "w", "range": [1.0, 2.0], "orbits": ["TB"]}
    scene = {"name": "column", "model": {**model, "period": "2*pi/w"}, "follow": follow}
    simulator, w = Simulator(read_scene(scene).model), values["w"]
    run = simulator.run(simulator.state("B", 3.6, -3.05, [0.0, -2.03]), impacts=500)
    release = next(k for k, row in enumerate(run.states()) if row.released and row.held == 3)
    begin = math.asin(1.0 / w**2) / w
    assert run.phases[release] == pytest.approx(begin, abs=1e-13)
    hit = next(k for k in range(release, 500) if not run.released[k])
    assert not run.velocities[release:hit].any()

    def height(t):
        fall, rate = -0.5 * (t - begin) ** 2, w * math.cos(w * begin)
        return fall - math.sin(w * t) + math.sin(w * begin) + rate * (t - begin)

    meeting = brentq(height, begin + 1.0, begin + 4.5, xtol=1e-15)
    assert run.times[hit] - run.times[release] == pytest.approx(meeting - begin, abs=1e-12)
    found = settle(simulator, run.states()[-1], QUICK)
    assert (found.kind.value, found.notation, found.period) == ("sticking", "inf:inf", 1)


@pytest.mark.filterwarnings("error")
def test_exponents_are_of_the_time_that_they_look_at(monkeypatch):
    """Two balls that leave a table at once touch in the air, by rounding: a derivative is infinite
    there, and the exponents of what came before were divided by the time of the whole run."""
    weight = "-g + a*w**2*cos(w*t)"
    machine = {"coordinates": ["y", "z"], "mass": [1, "m"], "period": "2*pi/w"}
    machine["force"] = [weight, f"m*({weight})"]
    guards = {"F": {"within": "y >= 0", "restitution": 0.6}}
    guards["C"] = {"within": "z - y >= 0", "restitution": 0.8}
    values = {"g": 1.0, "a": 16 / 35, "w": 3.0, "m": 0.5}
    model = {"system": "linear", **machine, "guards": guards, "parameters": values}
    follow = {"parameter": "w", "range": [1.0, 4.0], "orbits": ["FC"]}
    scene = read_scene({"name": "column", "model": model, "follow": follow})
    simulator = Simulator(scene.model)
    begin = (2.0 * math.pi - math.acos(values["g"] / (values["a"] * 9.0))) / 3.0
    left = State(0, begin, 0.0, 0, (-6e-33, -1.7e-32), held=1, released=True)
    touch, *_ = simulator.run(left, impacts=20).states()
    assert (touch.wall, touch.velocity, touch.held) == (1, 0.0, 0)
    assert not np.isfinite(simulator.derivatives([left, touch])[0]).any()
    start = simulator.state("F", 0.9, -1.0, [1.0, 0.5])
    run = simulator.run(start, impacts=20)
    steps = list(simulator.derivatives([start, *run.states()]))
    steps[12] = np.full((4, 4), np.inf)
    monkeypatch.setattr(Simulator, "derivatives", lambda *_: steps)
    found = exponents_of(simulator, start, run)
    assert found.impacts == 12
    assert found.periods == pytest.approx((run.times[11] - 0.9) / simulator.period, rel=1e-14)
    assert found.per_period == found.per_impact[0] * 12 / found.periods
