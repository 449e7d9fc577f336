"""The impact pair with soft membranes: against two bodies in SI units, and its limits."""

from __future__ import annotations

import dataclasses
import itertools
import math
import pickle

import numpy as np
import pytest
import sympy
from scipy.integrate import solve_ivp
from zoo import ROOT

import contimpact as ci
from contimpact.accuracy.reference import Reference
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.errors import InputError
from contimpact.models.equations import equations_of
from contimpact.models.guards import Word
from contimpact.orbits import outputs
from contimpact.orbits.orbit import Orbit
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import find_orbits
from contimpact.results.options import check_range
from contimpact.segments.checking import check_model
from contimpact.segments.kernels import Kernels
from contimpact.simulation.simulator import Simulator
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.membrane import Membrane
from contimpact.systems.soft_pair import FrictionalSoftPair, SoftPair

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

FIG7 = {"beta": math.pi / 6, "A": 5.0, "s": 0.45}
RIGID = FIG7 | {"r": 0.3}
TABLE = {"k": Membrane().K, "nu": Membrane().nu}


def soft_pair(**changes):
    return SoftPair(**(RIGID | {"k": 5e3} | changes))


def gravity(model):
    """What g of a rigid pair makes its mean force that of the soft one."""
    return model["g"] * (1 + model["m"] / model["M"])


def rigid_limit(model):
    """The fast 1:1 of the pair with rigid ends."""
    p = model.values
    given = {n: p[n] for n in (*FIG7, "M", "omega", "r", "r_B", "r_T") if n in p}
    rigid = ImpactPair(**given, g=gravity(model))
    found = [o for o in find_orbits(rigid, "1:1") if o.physical]
    return max(found, key=lambda orbit: orbit.velocities[0])


def solved(model, parameter="s"):
    """The orbit BbTt beside the fast 1:1 of the rigid pair, by Newton's method."""
    p, limit, rows = model.values, rigid_limit(model), []
    for letter, t, v in zip("BT", limit.times, limit.velocities, strict=True):
        r, k = (p.get(name, p.get(f"{name}_{letter}")) for name in "rk")
        half = p["omega"] * math.sqrt(p["m"] / k) if p["nu"] == 1 else 0.045
        rows += [(t, v), (t + half, -r * v)]
    problem = OrbitProblem(model, Word("BbTt"), Kernels(model, parameter))
    orbit = improved(problem, np.append(np.ravel(rows), p[parameter]))
    assert orbit.residual < 1e-12
    assert orbit.physical
    return orbit


def improved(problem, z):
    """An orbit by Newton's method."""
    for _ in range(20):
        here = problem.evaluate(z)
        z[:-1] -= np.linalg.solve(here.jacobian[:, :-1], here.residual)
    return Orbit(problem, problem.evaluate(z))


class Bodies:
    """Capsule and ball on the incline: positions upwards along it, in SI units."""

    def __init__(self, model):
        p = self.p = model.values
        self.reduced = p["m"] * p["M"] / (p["m"] + p["M"])
        self.tilt = p["g"] * math.sin(p["beta"])

    def force(self, letter, delta, rate):
        """Of a membrane on the ball, in the direction in which the membrane is deflected."""
        p, nu = self.p, self.p["nu"]
        r, k = (p.get(n, p.get(f"{n}_{letter}")) for n in "rk")
        zeta = -math.log(r) / math.hypot(math.pi, math.log(r))
        spring = 2 * k / (nu + 1)
        c = 2 * zeta * math.sqrt(spring * self.reduced)
        size = delta**2 + p["delta_0"] ** 2
        y = delta * size ** ((nu - 1) / 4)
        slope = size ** ((nu - 1) / 4) + (nu - 1) / 2 * delta**2 * size ** ((nu - 5) / 4)
        return slope * (spring * y + c * rate)

    def rates(self, tau, state, membrane):
        """F = A cos(omega tau) shakes the capsule and holds the weights of both."""
        p = self.p
        X, V, x, v = state
        push = 0.0
        if membrane:
            side = 1.0 if membrane == "B" else -1.0
            push = self.force(membrane, X - x - side * p["s"] / 2, V - v)
        shaken = p["A"] * math.cos(p["omega"] * tau) + (p["m"] + p["M"]) * self.tilt
        return [V, (shaken - push) / p["M"] - self.tilt, v, push / p["m"] - self.tilt]

    def run(self, orbit):
        """Integrate from each guard to the next; times, distances beyond the ends and velocities
        of the two, in the units of the pair."""
        p = self.p
        clock = math.pi / p["omega"]
        unit = p["A"] * clock**2 / p["M"]
        word, times = orbit.word.walls, np.append(orbit.times, orbit.times[0] + 2.0)
        side = 1.0 if word[0] == "B" else -1.0
        ball = -side * p["s"] / 2, -orbit.velocities[0] * unit / clock
        state, found = [0.0, 0.0, *ball], []
        for k, letter in enumerate(word):
            membrane = letter if letter in "BT" else ""
            arriving = word[(k + 1) % len(word)]
            side = 1.0 if arriving in "Bb" else -1.0

            def gap(tau, y, membrane, side=side):
                return (y[0] - y[2]) - side * p["s"] / 2

            gap.terminal = True
            gap.direction = 1.0 if arriving in "Bt" else -1.0
            begin, until = times[k] * clock, (times[k + 1] + 0.1) * clock
            options = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-15}
            flight = solve_ivp(
                self.rates, (begin, until), state, events=gap, args=(membrane,), **options
            )
            assert flight.status == 1
            found.append(
                (
                    (flight.t[-1] - begin) / clock + times[k],
                    (flight.y[1, -1] - flight.y[3, -1]) * clock / unit,
                )
            )
            state = flight.y[:, -1]
            times[k + 1] = found[-1][0]
        return np.array(found), state


UNEVEN = {"r_B": 0.3, "r_T": 0.8, "k_B": 900.0, "k_T": 4e4, "m": 0.02, "s": 0.6}
MODELS = [soft_pair(), soft_pair(k=900.0, m=0.01), SoftPair(**FIG7 | UNEVEN)]


@pytest.mark.parametrize("model", MODELS, ids=["stiff", "soft", "uneven"])
@pytest.mark.full
def test_two_bodies(model):
    """The orbit against both bodies' equations, with their own masses: Z alone is enough."""
    _against_bodies(solved(model))


def _against_bodies(orbit, tolerance=1e-10):
    found, _ = Bodies(orbit.model).run(orbit)
    want = np.column_stack([orbit.times, orbit.velocities])
    want = np.vstack([want[1:], want[0] + np.array([2.0, 0.0])])
    assert np.max(abs(found - want)) < tolerance


def test_capsule_comes_back():
    """What carries both weights leaves the capsule no drift: its velocity is periodic."""
    orbit = solved(soft_pair(m=0.03))
    _, end = Bodies(orbit.model).run(orbit)
    assert abs(end[1]) < 1e-10


@pytest.mark.full
def test_formulas_agree():
    names = check_model(soft_pair(forcing="cos(pi*t) + sin(3*pi*t)/5"))
    assert "flight from B" in names
    assert soft_pair()["gbar"] == pytest.approx(
        (0.1245 + Membrane().m) * 9.8 * 0.5 / 5.0, rel=1e-15
    )


@pytest.mark.full
def test_multipliers_product():
    """Only dampers take volume: exp(-gamma T) in each contact."""
    orbit = solved(soft_pair())
    p = orbit.model.values
    reduced = p["m"] * p["M"] / (p["m"] + p["M"])
    zeta = -math.log(p["r"]) / math.hypot(math.pi, math.log(p["r"]))
    gamma = 2 * zeta * math.sqrt(p["k"] / reduced) * math.pi / p["omega"]
    taken = gamma * sum(c.duration for c in orbit.contacts)
    assert np.prod(orbit.multipliers).real == pytest.approx(math.exp(-taken), rel=1e-11)


@pytest.mark.full
def test_contact_of_a_spring():
    """A fast ball makes a damped half swing, other forces being small beside the membrane's."""
    simulator = Simulator(soft_pair())
    run = simulator.run(simulator.state("B", 0.3, 1e6), impacts=1)
    assert -run.velocities[0] / 1e6 == pytest.approx(0.3, rel=1e-6)


@pytest.mark.full
def test_the_stiff_limit():
    """The difference from the rigid pair is the time in contact: it falls as k^-1/2."""
    soft = solved(soft_pair(k=1e4), "k")
    branch = continue_orbit(soft, "k", (1e4, 1e10), events=["FB", "PD", "G", "V"])
    assert branch.events == []
    limit = rigid_limit(soft.model)
    roots = np.sqrt(branch["k"])
    late = np.array([branch["t1"] - limit.times[0], branch["t3"] - limit.times[1]])
    speeds = np.array([branch["v1"], branch["v3"]]) - limit.velocities[:, None]
    stiff = branch["k"] > 1e7
    for off in (*late, *speeds):
        scaled = (off * roots)[stiff]
        assert scaled == pytest.approx(scaled[-1], rel=2e-2)
        assert abs(off[-1]) < 2e-5
    p = soft.model.values
    reduced = p["m"] * p["M"] / (p["m"] + p["M"])
    zeta = -math.log(0.3) / math.hypot(math.pi, math.log(0.3))
    half = p["omega"] * math.sqrt(reduced / (1 - zeta**2))
    assert (branch["t2"] - branch["t1"])[-1] * roots[-1] == pytest.approx(half, rel=1e-4)
    restitution = (-branch["v2"] / branch["v1"])[-1]
    assert restitution == pytest.approx(0.3, abs=2e-5)
    exact = Reference(branch.orbit(-1).problem).orbit(branch.orbit(-1).unknowns)
    assert exact.distance(branch.orbit(-1).unknowns) < 1e-12


def test_a_light_ball():
    """With k/m_* held, the mass changes gravity alone, by m/M: what is left is linear in it."""

    def at(m):
        stiffness = 1e6 * m * 0.1245 / (m + 0.1245)
        orbit = solved(soft_pair(m=m, k=stiffness))
        return np.array([orbit.times, orbit.velocities])

    none = at(1e-9)
    one, two = at(1e-4) - none, at(2e-4) - none
    assert np.max(abs(one)) > 1e-5
    assert np.max(abs(two - 2 * one)) < (2e-4 / 0.1245) ** 2


@pytest.mark.full
def test_symmetric_at_level():
    """By what the kernels say of a system of several laws: its flights have no harmonics."""
    model = soft_pair(beta=0.0, s=0.3)
    said = Kernels(model, "s").harmonics(*model.values.values())
    found = model.symmetry("s", said)
    assert found.walls == {"B": "T", "T": "B", "b": "t", "t": "b"}
    assert check_model(model)[-1].startswith("symmetry at all A, s, M")
    uneven = SoftPair(beta=0.0, A=5.0, s=0.3, r=0.3, k_B=500.0, k_T=600.0)
    assert uneven.symmetry("s", said) is None
    assert soft_pair().symmetry("s", said) is None
    assert soft_pair(beta=0.0, forcing="cos(pi*t) + cos(2*pi*t)/9").symmetry("s", said) is None


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"nu": 2.0, "membrane": "linear"}, "nu"),
        ({"membrane": "rubber"}, "membrane"),
        ({"r": 0.0}, "a number above 0, at most 1"),
        ({"mu": -0.1}, "a number > 0, or 0 where"),
        ({"mu": 0.1, "beta": math.pi / 2}, "does not press"),
        ({"r": 1.0, "k": 1.0, "m": 1.0, "M": 1.0, "omega": math.sqrt(2.0)}, "resonance"),
    ],
)
def test_refused(changes, where):
    with pytest.raises(InputError, match=where):
        soft_pair(**changes)


@pytest.mark.full
def test_power_law_of_exponent_one():
    """The integrated flight of nu = 1 against the closed form."""
    linear, integrated = solved(soft_pair()), solved(soft_pair(membrane="power"))
    assert integrated.times == pytest.approx(linear.times, abs=1e-12)
    assert integrated.velocities == pytest.approx(linear.velocities, abs=1e-12)


@pytest.mark.full
def test_table_a1():
    """The membranes of Table A1: two bodies, and the restitution and deflection of a fast ball."""
    model = soft_pair(**TABLE)
    orbit = solved(model)
    assert orbit.word.walls == "BbTt"
    _against_bodies(orbit)
    simulator = Simulator(model)
    run = simulator.run(simulator.state("B", 0.3, 1e4), impacts=1)
    assert -run.velocities[0] / 1e4 == pytest.approx(0.3, rel=1e-4)


@pytest.mark.full
def test_where_mechanism_1_begins():
    """Both folds of the 3:1 born at the grazing meet in a cusp: above it a run in s finds two,
    below it none, and the stable 3:1 takes over from the 2:1."""
    scene = ci.load_scene(ROOT / "branches" / "soft_pair_500" / "scene.toml")
    stiffer = scene.model.replace(k=5000.0, s=0.41)
    diagram = ci.follow(dataclasses.replace(scene, model=stiffer, range=(0.2, 0.42), outputs=()))
    (branch,) = [b for b in diagram.branches if b.word == "BbBbBbTt"]
    fold = max((e for e in branch.events if e.kind == "FB"), key=lambda e: e.value)
    curve = ci.follow_curve(fold, None, "k", (0.2, 0.4), (600.0, 5100.0))
    (cusp,) = [p for p in curve.points if p.kind == "CP"]
    stable = branch.orbit(int(np.flatnonzero(branch["n_unstable"] == 0)[-1]))
    for k, folds in ((0.98 * cusp.parameters["k"], 0), (1.02 * cusp.parameters["k"], 2)):
        softer = continue_orbit(stable, "k", (k, 5000.0), events=[]).orbit(0)
        assert softer.model["k"] == k
        found = continue_orbit(softer, "s", (0.24, 0.27), events=["FB", "PD", "V"])
        assert [e.kind for e in found.events if not e.ghost].count("FB") == folds
        assert folds or found.events[-1].stable


# With dry friction on the incline.

LETTERS = {"": "SPARCD", "B": "sparcd", "T": "kmnluw"}
"""Stops rising, begins to rise, to fall, stops falling, turns to fall, to rise; by the membrane."""


class RubbedBodies(Bodies):
    """The two with friction between them, integrated from event to event: no word is given."""

    def __init__(self, model):
        super().__init__(model)
        p = self.p
        self.most = p["mu"] * p["m"] * p["g"] * math.cos(p["beta"])

    def rates(self, tau, state, membrane, sign):
        """`sign` is that of the relative velocity V - v; 0 where the ball sticks."""
        rates = super().rates(tau, state, membrane)
        held = (rates[1] - rates[3]) * self.reduced
        push = sign * self.most if sign else held
        rates[1] -= push / self.p["M"]
        rates[3] += push / self.p["m"]
        return rates

    def held(self, tau, state, membrane):
        """The friction that keeps the relative velocity."""
        rates = super().rates(tau, state, membrane)
        return (rates[1] - rates[3]) * self.reduced

    def follow(self, orbit, periods=1):
        """Letters, times and relative velocities in the pair's units from the first contact on."""
        p = self.p
        clock = math.pi / p["omega"]
        unit = p["A"] * clock**2 / p["M"]
        assert orbit.word.walls[0] == "B"
        state = np.array([0.0, 0.0, -p["s"] / 2, -orbit.velocities[0] * unit / clock])
        tau, end = orbit.times[0] * clock, (orbit.times[0] + 2.0 * periods) * clock
        membrane, sign, found = "B", 1, []
        while True:
            if sign:
                side = {"": sign, "B": 1, "T": -1}[membrane]
                events = [lambda t, y, *given: y[1] - y[3]]
                if not (membrane and sign == side):
                    events.append(lambda t, y, *given, side=side: y[0] - y[2] - side * p["s"] / 2)
                for event, way in zip(events, (-sign, sign), strict=False):
                    event.terminal, event.direction = True, way
            else:
                events = [
                    lambda t, y, at, _: self.held(t, y, at) - self.most,
                    lambda t, y, at, _: self.held(t, y, at) + self.most,
                ]
                for event, way in zip(events, (1, -1), strict=True):
                    event.terminal, event.direction = True, way
            options = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-15, "max_step": clock / 50}
            span, given = (tau, end + 1e-9), (membrane, sign)
            flight = solve_ivp(self.rates, span, state, events=events, args=given, **options)
            if flight.status == 0:
                return found
            tau, state = flight.t[-1], flight.y[:, -1]
            stops, begins_up, begins_down, rests, to_down, to_up = LETTERS[membrane]
            if not sign:
                sign = 1 if len(flight.t_events[0]) else -1
                letter = begins_down if sign > 0 else begins_up
            elif len(flight.t_events[-1]) and len(events) > 1:
                letter = ("B" if sign > 0 else "T") if not membrane else membrane.lower()
                membrane = letter if letter in "BT" else ""
            else:
                held = self.held(tau, state, membrane)
                came, sign = sign, 0 if abs(held) < self.most else (1 if held > 0 else -1)
                ways = (rests, to_up) if came > 0 else (stops, to_down)
                letter = ways[sign != 0]
                state[1] = state[3] = 0.5 * (state[1] + state[3])
            found.append((letter, tau / clock, (state[1] - state[3]) * clock / unit))


def simulated(word, impacts, **changes):
    """An orbit that a motion comes to, by Newton's method from there."""
    model = soft_pair(**changes)
    simulator = Simulator(model)
    run = simulator.run(simulator.state("B", 0.3, 0.4, [0.4, 0.5]), impacts=impacts)
    k = run.word.rindex(word)
    lap = slice(k, k + len(word))
    times, periods = run.times[lap], round((run.times[k] - run.times[k - len(word)]) / 2.0)
    rows = np.column_stack([times - 2.0 * (times[0] // 2.0), run.velocities[lap], run.others[lap]])
    problem = OrbitProblem(model, Word(word, periods), Kernels(model, "s"))
    return improved(problem, np.append(np.ravel(rows), model["s"]))


@pytest.mark.full
@pytest.mark.parametrize(
    ("word", "changes", "zeros"),
    [
        pytest.param("BdbTut", {"mu": 0.02}, 2, marks=pytest.mark.slow),
        ("BdbCRPTut", {"mu": 0.2, "k": 500.0, "s": 0.3692}, 3),
        ("BdspbCBdbC", {"mu": 0.6, "A": 2.0, "s": 0.2, "k": 500.0}, 3),
        pytest.param("BdcrpbSA", {"mu": 0.3, "A": 1.0, "s": 0.1}, 3, marks=pytest.mark.slow),
    ],
    ids=["slips", "sticks", "sticks on a membrane", "sticks on both"],
)
def test_two_bodies_with_friction(word, changes, zeros):
    """Letters, times and velocities at contacts; each direction that sticking takes is zero."""
    orbit = simulated(word, 50, **changes)
    assert orbit.physical
    found = RubbedBodies(orbit.model).follow(orbit, orbit.word.period)
    letters, times, speeds = zip(*found, strict=True)
    assert "".join(letters) == word[1:] + word[0]
    assert times[:-1] == pytest.approx(orbit.times[1:], abs=1e-10)
    assert times[-1] == pytest.approx(orbit.times[0] + 2.0 * orbit.word.period, abs=1e-10)
    at = [k for k, letter in enumerate(letters) if letter in "BbTt"]
    assert np.array(speeds)[at] == pytest.approx(np.roll(orbit.velocities, -1)[at], abs=1e-10)
    assert np.count_nonzero(orbit.multipliers == 0.0) == zeros
    for contact in orbit.contacts:
        assert contact.wall in "BT"
        k = int(np.argmin(abs(orbit.times - contact.time)))
        last = word.index(contact.wall.lower(), k)
        assert contact.duration == pytest.approx(orbit.times[last] - orbit.times[k], rel=1e-12)
        assert contact.restitution == pytest.approx(-orbit.velocities[last] / orbit.velocities[k])
    assert len(orbit.contacts) == sum(word.count(letter) for letter in "BT")


@pytest.mark.slow
def test_little_friction():
    """The difference from the pair without friction is linear in mu."""
    without = solved(soft_pair())
    plain = np.array([without.times, without.velocities])
    orbit, off = simulated("BdbTut", 50, mu=0.02), []
    for mu in (2e-4, 1e-4):
        branch = continue_orbit(orbit, "mu", (mu, 0.02), events=[])
        end = branch.orbit(0)
        assert end.model["mu"] == mu
        at = [0, 2, 3, 5]
        off.append(np.array([end.times[at], end.velocities[at]]) - plain)
    assert np.max(abs(off[1])) > 1e-6
    assert np.max(abs(off[0] - 2.0 * off[1])) < 1e-2 * np.max(abs(off[1]))


def test_friction_has_its_own_modes():
    assert type(soft_pair()) is type(soft_pair(mu=0.0)) is SoftPair
    assert soft_pair() == soft_pair(mu=0.0)
    rubbed = soft_pair(mu=0.1)
    assert type(rubbed) is FrictionalSoftPair
    assert pickle.loads(pickle.dumps(rubbed)) == rubbed == rubbed.replace(mu=0.2).replace(mu=0.1)
    for letter, there in zip("BbSPARCDspardc", "TtRAPSDClnmkuw", strict=True):
        level = soft_pair(beta=0.0, mu=0.1).symmetry("s", [math.nan])
        assert level.walls[letter] == there
        assert level.walls[there] == letter


def test_only_deflections_take_the_motion_between_impacts(monkeypatch):
    orbit = solved(soft_pair())
    expected = orbit.mean("restitution", contacts="B"), orbit.mean("duration", contacts="T")
    contact = next(c for c in orbit.contacts if c.wall == "B")
    assert expected[0].value == contact.restitution
    monkeypatch.setattr(outputs, "_depths", None)
    assert orbit.mean("restitution", contacts="B") == expected[0]
    assert orbit.mean("duration", contacts="T") == expected[1]
    with pytest.raises(TypeError):
        orbit.mean("deflection", contacts="B")


def test_friction_is_not_followed_to_none():
    with pytest.raises(InputError, match="a number > 0, or 0 where it is not followed"):
        check_range(soft_pair(mu=0.1), "mu", 0.1, (0.0, 0.2))


@pytest.mark.full
def test_a_ball_with_friction_turns_at_letters_alone():
    """Where it turns a flight ends: a touch of a membrane is there, on every orbit of a branch.
    Rounding made it one inside the flight or none."""
    branch = ci.load_diagram(ROOT / "branches" / "soft_pair_friction").branches[0]
    for row in np.flatnonzero(branch.physical):
        orbit = branch.orbit(int(row))
        ends = np.roll(orbit.times, -1)
        touches = [t for flight in orbit.linearisation.gaps for t in flight.touches[:2] if t]
        assert [(t.flight, t.wall) for t in touches] == [(2, "T"), (3, "B")]
        assert [t.time for t in touches] == pytest.approx([ends[t.flight] for t in touches])


@pytest.mark.full
def test_formulas_with_friction_agree():
    assert "symmetry at all" in check_model(soft_pair(beta=0.0, mu=0.1))[-1]


@pytest.mark.full
def test_rates_that_do_not_vanish_are_not_simplified(monkeypatch):
    """SymPy would take twenty seconds to compare them with zero."""
    equations = equations_of(soft_pair(mu=0.1))
    monkeypatch.delattr(sympy.Expr, "equals")
    pairs = itertools.product(equations.guards, repeat=2)
    found = {a + b for a, b in pairs if equations.begins(a, b)}
    turning = ("PS", "PC", "AR", "AD")  # a ball that begins to move does so without velocity
    assert found == {
        pair.translate(str.maketrans(LETTERS[""], letters))
        for letters in LETTERS.values()
        for pair in turning
    }


@pytest.fixture(scope="module")
def stiff():
    """1:1 and 2:1 where a V, a PD and an FB lie within 6e-12 m."""
    model = {"system": "soft-pair", "parameters": STIFF}
    follow = {
        "parameter": "s",
        "range": [0.32, 0.4],
        "orbits": ["BbTt"],
        "depth": 1,
        "switch": ["G"],
    }
    detect = {"events": ["FB", "PD", "G", "V"]}
    numerics = {"starts": 32, "rounds": 1}
    given = {"name": "stiff", "model": model, "follow": follow, "detect": detect}
    return ci.read_scene(given | {"numerics": numerics})


STIFF = {"beta": math.pi / 6, "r": 0.3, "A": 5.0, "s": 0.39, "k": 50_000.0}


@pytest.mark.full
def test_a_doubling_beside_the_birth_of_an_impact_is_found_or_missed(stiff):
    """The multiplier passes from -73 through -1 and 1 to 61 within 6e-12 m: as many are outside on
    both sides. Determinants vanish at the V, too, where a contact does."""
    (born,) = [b for b in ci.follow(stiff).branches if b.word == "BbBbTt"]
    beside = [e.kind for e in born.events if abs(e.value - 0.32614520801) < 1e-10]
    beside += [m[:2] for m in born.missed if "one multiplier leaves the unit circle there" in m]
    assert sorted(beside) == ["FB", "PD", "V"]
