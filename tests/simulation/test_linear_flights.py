"""Linear flights from impact to impact: against the automaton, and plain against compiled."""

from __future__ import annotations

import importlib.util
import math
import tomllib
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from event_driven import random_scene
from zoo import ROCKING_BLOCK, TWO_MASSES

from contimpact.results.options import Settling
from contimpact.results.scene import load_scene, read_scene
from contimpact.simulation import linear_flights
from contimpact.simulation import run as run_loops
from contimpact.simulation.run import Outcome
from contimpact.simulation.settle import settle
from contimpact.simulation.simulator import Simulator
from contimpact.simulation.sweep import basins
from contimpact.systems.coupled_by_impact import CoupledByImpact
from contimpact.systems.impact_damper import ImpactDamper
from contimpact.systems.oscillator import Oscillator
from contimpact.systems.soft_pair import SoftPair
from contimpact.systems.soft_stop import SoftStop
from contimpact.systems.two_masses import TwoMasses

needs_llvmlite = pytest.mark.skipif(
    importlib.util.find_spec("llvmlite") is None, reason="the extra 'fast' is not installed"
)

BRANCHES = Path(__file__).parents[2] / "branches"
COMPLEX = {"omega": 1.3, "sigma_1": 0.1, "sigma_2": 0.2, "r": 0.8}
STICKING = {"omega": 0.6, "sigma_1": 0.1, "sigma_2": 0.3, "r": 0.5}


def masses(**given):
    return TwoMasses(**(TWO_MASSES | given))


MODELS = {
    "complex": masses(**COMPLEX),
    "sticking": masses(**STICKING),
    "stiff": masses(**COMPLEX | {"k2": 60.0, "c2": 20.0}),
    "free ball": ImpactDamper(Omega=1.0, d=20.0, r=0.8, mu=0.1, zeta=0.01),
    "on each other": CoupledByImpact(
        m2=2, c1=0.1, c2=0.2, k1=1, k2=2, a1=1, omega=1.3, gap=0.2, r=0.7
    ),
    "hybrid, position": read_scene(random_scene(2)).model,
    "hybrid, three modes": read_scene(random_scene(4)).model,
    "dry friction": load_scene(BRANCHES / "dry_friction" / "scene.toml").model,
}

ONE_COORDINATE = {
    "stop": Oscillator(a=1, omega=2.7, c=0.1, k=1, sigma=0.3, r=0.7),
    "sticking at a stop": Oscillator(a=1, omega=0.4, c=0.1, k=1, sigma=0.2, r=0.4),
    "stiff stop": Oscillator(a=3000, omega=1, c=100, k=1e4, sigma=0.3, r=0.8),
    "soft stop": SoftStop(a=1, omega=0.8, c=0.1, k=1, e=0.1, k_b=20, c_b=0.3),
    "soft pair": SoftPair(beta=0.5, r=0.3, A=5, s=0.39, k=500),
}
"""Their flights are in closed form, and follow laws as well."""


@pytest.fixture(scope="module")
def simulators():
    found = {}

    def simulator(name):
        if name not in found:
            found[name] = Simulator((MODELS | ONE_COORDINATE)[name])
        return found[name]

    return simulator


def starts(simulator, count, seed=0):
    generator = np.random.default_rng(seed)
    return [simulator.random_state(generator) for _ in range(count)]


def apart(one, other, period):
    """The largest difference of two states, beside their sizes."""
    time = (one.turns - other.turns) * period + one.phase - other.phase
    pairs = zip(one.section, other.section, strict=True)
    return max(abs(time), *(abs(a - b) / max(1.0, abs(a)) for a, b in pairs))


@pytest.mark.parametrize("name", MODELS)
def test_every_impact_is_that_of_the_automaton(simulators, name):
    """Guards, walls held and releases are the same; times and states to rounding."""
    simulator = simulators(name)
    automaton, made = simulator.machine, 0
    assert automaton._runs is not None
    for start in starts(simulator, 6):
        run = simulator.run(start, impacts=25)
        rows = [start, *run.states()]
        for before, after in pairwise(rows):
            alone = automaton.next(before)
            assert (after.wall, after.held, after.released) == (
                alone.wall,
                alone.held,
                alone.released,
            )
            assert apart(after, alone, simulator.period) < 2e-13
        if run.outcome is not Outcome.DONE:
            assert automaton.next(rows[-1]) is run.outcome
        made += len(rows) - 1
    assert made > 100


@pytest.mark.parametrize("name", ONE_COORDINATE)
def test_every_impact_is_that_of_the_closed_form(simulators, name):
    """Against flights found on the kernels' own functions of time; sticking is at another place."""
    simulator = simulators(name)
    assert isinstance(simulator.machine._runs, linear_flights.LinearRuns)
    made = 0
    for start in starts(simulator, 6):
        run = simulator.run(start, impacts=8)
        for before, after in pairwise([start, *run.states()]):
            if before.released or after.released:
                continue
            wall, dt, speed = simulator.fly(before.wall, before.phase, before.velocity)
            assert wall == after.wall
            assert after.since(before, simulator.period) == pytest.approx(dt, rel=1e-11, abs=1e-14)
            assert after.velocity == pytest.approx(
                speed, rel=1e-10, abs=1e-12 * simulator.machine.fastest
            )
            made += 1
    assert made > 20


def test_a_motion_at_a_stop_sticks(simulators):
    run = simulators("sticking at a stop").run(
        starts(simulators("sticking at a stop"), 1)[0], impacts=200
    )
    assert np.count_nonzero(run.released) > 5


def test_a_motion_sticks_as_the_automaton_has_it(simulators):
    """Chatter ends in a sojourn, which other impacts may share, and a release."""
    simulator = simulators("sticking")
    run = simulator.run(starts(simulator, 1)[0], impacts=300)
    assert np.count_nonzero(run.released) > 5
    assert np.count_nonzero(run.held) > 5


def test_a_polynomial_on_a_part_of_its_piece():
    """Against binomial sums of its own."""
    terms = linear_flights.TERMS
    space = [*np.random.default_rng(1).normal(size=terms).tolist(), *[0.0] * terms]
    start = linear_flights.shift(space, 0, terms, 0.375, 0.125)
    whole = [0.0, *space[:terms]]
    for j in range(1, terms + 1):
        shifted = sum(math.comb(k, j) * whole[k] * 0.375 ** (k - j) for k in range(j, terms + 1))
        assert space[terms + j - 1] == pytest.approx(shifted * 0.125**j, rel=1e-10, abs=1e-25)
    assert start == pytest.approx(sum(c * 0.375**k for k, c in enumerate(whole)), rel=1e-12)


@pytest.mark.parametrize("seed", range(40))
def test_no_arrival_on_a_piece_is_missed(seed):
    """Against all roots of polynomials whose walls lie near their extrema."""
    terms, draw = linear_flights.TERMS, np.random.default_rng(seed)
    c = draw.normal(size=terms) / [math.factorial(k) for k in range(terms)]
    c *= [6.0 ** draw.uniform(0.0, 1.0) if k else draw.uniform(-0.3, 0.3) for k in range(terms)]
    samples = np.polyval([*c[::-1], 0.0], np.linspace(0.0, 1.0, 1001))
    near = 10.0 ** draw.uniform(-13, -1)
    low, high = min(samples) - draw.choice([-1, 1]) * near, max(samples) + near
    low, high = min(low, -1e-3), max(high, 1e-3)
    space = [*c.tolist(), *[0.0] * terms]
    rising = c[0] > 0.0
    side, s, speed = linear_flights.first_in_piece(space, 0, terms, rising, low, high)
    found = []
    for wall, out in ((low, -1), (high, 1)):
        roots = np.roots([*c[::-1], -wall])
        real = roots[(abs(roots.imag) < 1e-9) & (roots.real > 0.0) & (roots.real <= 1.0)].real
        found += [(float(root), out) for root in real]
    if not found:
        assert side == 0
        return
    first, out = min(found)
    tangent = abs(np.polyval(np.polyder([*c[::-1], 0.0]), first)) < 1e-5
    assert side == out or tangent
    if side:
        assert s == pytest.approx(first, abs=1e-5 if tangent else 1e-11)
        assert speed * side >= 0.0


@needs_llvmlite
@pytest.mark.parametrize("name", [*MODELS, *ONE_COORDINATE])
@pytest.mark.full
def test_compiled_runs_are_the_same_to_the_last_bit(simulators, plain_and_compiled, name):
    simulator = simulators(name)
    for start in starts(simulator, 3, seed=1):
        plain, fast = plain_and_compiled(lambda start=start: simulator.run(start, impacts=150))
        assert plain == fast
        blind = simulator.run(start, impacts=150, record=False)
        assert (blind.end, blind.outcome, len(blind)) == (plain.end, plain.outcome, 0)


@needs_llvmlite
def test_parts_of_runs_join(simulators, plain_and_compiled, monkeypatch):
    simulator = simulators("sticking")
    start = starts(simulator, 1)[0]
    whole = simulator.run(start, impacts=100)
    monkeypatch.setattr(run_loops, "FEW", 7)
    for part in plain_and_compiled(lambda: simulator.run(start, impacts=100)):
        assert part == whole
    half = simulator.run(start, impacts=50)
    rest = simulator.run(half.end, impacts=50)
    assert [*half.states(), *rest.states()] == whole.states()


def test_what_is_not_resolved_is_left_to_the_automaton(simulators, monkeypatch):
    """The numbers are those of the automaton alone."""
    start = starts(simulators("complex"), 1)[0]
    monkeypatch.setenv("CONTIMPACT_COMPILED", "never")
    monkeypatch.setattr(linear_flights, "PARTS", 0)
    model = MODELS["complex"]
    left, alone = (Simulator(model, simulators("complex").kernels) for _ in range(2))
    alone.machine.__dict__["_runs"] = None
    some = left.run(start, impacts=20)
    assert [s.wall for s in some.states()] == [
        s.wall for s in alone.run(start, impacts=20).states()
    ]


@needs_llvmlite
@pytest.mark.parametrize("name", ["complex", "hybrid, position", "sticking", "sticking at a stop"])
@pytest.mark.quick(1)
def test_many_runs_at_once_are_those_alone(simulators, plain_and_compiled, name):
    """In threads, some of them left to Python, and plainly."""
    simulator = simulators(name)
    given = starts(simulator, 40, seed=2)
    plain, fast = plain_and_compiled(lambda: simulator.run_all(given, periods=12, threads=2))
    assert plain == fast
    for start, (outcome, end) in zip(given, fast, strict=True):
        alone = simulator.run(start, periods=12, record=False)
        assert outcome is alone.outcome
        assert end == (alone.end if outcome is Outcome.DONE else start)


@needs_llvmlite
@pytest.mark.slow
def test_basins_are_the_same_plain_and_on_any_number_of_cores(plain_and_compiled):
    """One of two masses with and without impacts, as each start alone has it."""
    simulator = Simulator(masses(omega=1.8, sigma_1=1.0, sigma_2=1.0))
    given = {"shape": (4, 5), "settling": Settling(transient=60, periods=300)}
    for threads in (1, 2):
        for found in plain_and_compiled(lambda n=threads: basins(simulator, threads=n, **given)):
            kinds = [found.attractors[k].kind for k in found.labels.ravel().tolist()]
            states = [
                simulator.state("A", phase, velocity, found.others)
                for velocity in found.velocities.tolist()
                for phase in found.phases.tolist()
            ]
            alone = [settle(simulator, state, given["settling"]).kind for state in states]
            assert kinds == alone
            assert len(set(kinds)) > 1


@pytest.mark.parametrize("name", MODELS)
def test_derivatives_of_many_flights_are_those_of_each(simulators, name):
    """Of those between the same guards at once, and of others, as where a wall is held, alone."""
    simulator = simulators(name)
    state = simulator.random_state(np.random.default_rng(1))
    rows = [state, *simulator.run(state, impacts=40).states()]
    each = np.array([simulator.derivative(*pair) for pair in pairwise(rows)])
    together = simulator.derivatives(rows)
    np.testing.assert_array_equal(np.isfinite(together), np.isfinite(each))
    sizes = np.max(np.abs(each), axis=(1, 2), keepdims=True, initial=0.0)
    with np.errstate(invalid="ignore"):
        apart = np.abs(together - each) / sizes
    assert np.nanmax(apart) < 1e-12


@needs_llvmlite
@pytest.mark.parametrize("w", [2.0, 0.005])
def test_a_linear_motion_that_grows_without_bound_runs_away(w, plain_and_compiled):
    """Where a period amplifies more than floats hold, too; it meets no guard, but never settles."""
    model = read_scene(ROCKING_BLOCK).model.replace(w=w)
    simulator = Simulator(model)
    start = simulator.state("P", 0.1, 20.0)
    for run in plain_and_compiled(lambda: simulator.run(start, impacts=200)):
        assert (run.outcome, len(run), run.end, run.left) == (Outcome.RUNAWAY, 0, None, None)
    found = settle(simulator, start)
    assert (found.notation, found.settled) == ("runaway", True)


def test_a_block_that_rocks_returns_at_its_time():
    """x = 1 - cosh t + v sinh t, without forcing: the arrival at x = 0 is at tanh(t/2) = v, with
    the velocity -v."""
    model = read_scene(ROCKING_BLOCK).model.replace(b=0.0, w=0.005)
    simulator = Simulator(model)
    run = simulator.run(simulator.state("P", 0.0, 0.5 / 0.9), impacts=1)
    assert run.times[0] == pytest.approx(2.0 * math.atanh(0.5), rel=1e-13)
    assert run.velocities[0] == pytest.approx(-0.5, rel=1e-13)


FEEDER = """
name = "feeder"
[model]
system = "hybrid"
period = "2*pi"
[model.parameters]
A = 0.4
[model.define]
force = "A*cos(t) - 0.5 + 0.2*cos(t + 0.7)"
rate = "-A*sin(t) - 0.2*sin(t + 0.7) - (h - force)"
[model.modes.stick]
h = "rate"
u = "0"
[model.modes.slip]
h = "rate"
u = "force"
[model.modes.back]
h = "rate"
u = "force + 1"
[model.guards]
P = { mode = "stick", within = "h <= 0", to = "slip", set = { u = 0 } }
S = { mode = "slip", within = "u >= 0", to = "stick", set = { u = 0 } }
Q = { mode = "stick", within = "h >= -1", to = "back", set = { u = 0 } }
B = { mode = "back", within = "u <= 0", to = "stick", set = { u = 0 } }
[follow]
parameter = "A"
range = [0.3, 0.45]
orbits = ["PS"]
"""


@needs_llvmlite
def test_a_run_ends_where_two_guards_lead_to_each_other_at_once(plain_and_compiled):
    """The part begins to slip, and sticks again at the same time, as h is not the force yet: time
    stands still. Compiled runs over periods never ended."""
    simulator = Simulator(read_scene(tomllib.loads(FEEDER)).model)
    start = simulator.random_state(np.random.default_rng(1))
    for run in plain_and_compiled(lambda: simulator.run(start, periods=20, record=False)):
        assert run.outcome is Outcome.ACCUMULATING
        assert run.end.turns <= 1
