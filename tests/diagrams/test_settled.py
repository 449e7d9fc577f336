"""What attracts is found: starts of searches come from short simulations, too."""

import numpy as np
import pytest

import contimpact as ci
from contimpact.diagrams.explore import follow
from contimpact.diagrams.starting_orbits import (
    MotionEnd,
    Settled,
    _settle_orbit,
    settled_orbits,
    turn_to_word,
    unknowns_of_word,
    word_of,
)
from contimpact.models.guards import Word
from contimpact.orbits import search
from contimpact.orbits.quiet import problem_of
from contimpact.results.options import Settling
from contimpact.results.scene import read_scene
from contimpact.segments.kernels import Kernels
from contimpact.simulation.attractor import Kind
from contimpact.simulation.simulator import Simulator
from contimpact.simulation.sweep import find_attractors
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.soft_stop import SoftStop

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

SETTLING = Settling(transient=200, periods=600, longest=32, impacts=20)
SOFT = {"k": 1.0, "c": 0.05, "a": 1.0, "e": 0.5, "k_b": 25.0, "c_b": 0.1, "omega": 1.8}


def missed(model, parameter, motions, kernels=None):
    """The attractors of a longer simulation that neither a search for their word nor the short
    simulations find, and their number."""
    kernels = kernels or Kernels(model, parameter)
    met = find_attractors(Simulator(model, kernels), motions, rng=1, settling=SETTLING)
    settled, lost = settled_orbits(model, kernels).orbits, []
    periodic = [a for a in met if a.kind is Kind.PERIODIC]
    for attractor in periodic:
        word, orbit = Word(attractor.word, attractor.period), attractor.orbit(model, parameter)
        found = search.find_orbits(model, word, kernels=kernels, starts=64, rounds=4)
        found = search.add_orbits(
            found, problem_of(model, word, kernels), unknowns_of_word(settled, word)
        )
        turned = turn_to_word(orbit, word)
        apart = (o.problem.difference(o.unknowns, turned) for o in found)
        if all(np.max(np.abs(difference)) > 1e-6 for difference in apart):
            lost.append(attractor)
    return lost, len(periodic)


@pytest.mark.full
def test_the_attractor_of_a_soft_stop_is_found_by_a_single_start():
    model = SoftStop(**SOFT)
    kernels = Kernels(model, "omega")
    assert not any(o.physical for o in search.find_orbits(model, "CRCR/3T", starts=1, rounds=1))
    found = ci.find_orbits(model, "CRCR/3T", kernels=kernels, starts=1, rounds=1)
    (orbit,) = [o for o in found if o.physical]
    assert orbit.stable
    assert orbit.residual < 1e-12


@pytest.mark.full
def test_motions_that_fly_on_do_not_end_the_search():
    """Of those from random states the first three settle below the stop; the fourth on CRCR/3T."""
    model = SoftStop(k=1.2534, c=0.0935, a=1.1291, e=0.5479, k_b=17.1697, c_b=0.2770, omega=1.8749)
    settled = settled_orbits(model, Kernels(model, "omega"))
    assert [str(word_of(orbit)) for orbit in settled.orbits] == ["CRCR/3T"]


@pytest.mark.full
def test_a_scene_follows_it():
    table = {"parameter": "omega", "range": [1.79, 1.81], "orbits": ["CRCR/3T"]}
    given = {"name": "soft", "model": {"system": "soft-stop", "parameters": SOFT}, "follow": table}
    few = {"numerics": {"starts": 1, "rounds": 1}, "detect": {"events": ["FB"]}}
    diagram = follow(read_scene({**given, **few}))
    assert [b.word for b in diagram.branches if b["physical"].all()] == ["CRCR"]
    assert diagram.statistics["notes"] == [
        "3 of 7 motions simulated at omega = 1.8 fly on without impacts: add 0 to follow.orbits"
    ]
    table["orbits"].append("0")
    assert follow(read_scene({**given, **few})).statistics["notes"] == []


def pair(s, orbits):
    low, high = s - 0.005, s + 0.005
    return read_scene(
        {
            "name": "pair",
            "model": {
                "system": "impact-pair",
                "parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": s},
            },
            "follow": {"parameter": "s", "range": [low, high], "orbits": orbits},
            "detect": {"events": []},
        }
    )


@pytest.mark.full
def test_one_that_was_not_asked_for_is_reported():
    """1:1 is unstable there, and 2:1 stable: Fig. 7 of the paper."""
    (note,) = follow(pair(0.34, ["1:1"])).statistics["notes"]
    assert note == (
        "simulation settles on BBT at s = 0.34, which is on no followed branch: "
        "add it to follow.orbits"
    )
    assert follow(pair(0.34, ["1:1", "2:1"])).statistics["notes"] == []


@pytest.mark.full
def test_a_scene_without_orbits_is_told_on_what_simulation_settles():
    with pytest.raises(ci.InputError, match="ask for BT, on which simulation settles there"):
        follow(pair(0.45, ["2:1"]))


@pytest.mark.full
def test_a_scene_without_orbits_is_told_that_motions_meet_no_stop():
    """Without impacts the amplitude is 1 / (omega^2 - 1) = 0.1, far below the stop at 0.9."""
    values = {"a": 1.0, "omega": 3.3, "c": 0.1, "k": 1.0, "sigma": 0.9, "r": 0.5}
    table = {
        "name": "below",
        "model": {"system": "oscillator", "parameters": values},
        "follow": {"parameter": "omega", "range": [3.2, 3.4], "orbits": ["S"]},
        "numerics": {"starts": 4, "rounds": 1},
    }
    with pytest.raises(ci.InputError, match="ask for 0, on which simulation settles there"):
        follow(read_scene(table))


def test_a_scene_without_orbits_is_told_that_motions_do_not_settle():
    """A table that accelerates by 0.9 g: below pi (1 - r)/(1 + r) g the ball comes to rest."""
    table = {
        "name": "sticking",
        "model": {
            "system": "bouncing-ball",
            "parameters": {"a": 0.0035, "omega": 50.0, "r": 0.5, "g": 9.8},
        },
        "follow": {"parameter": "a", "range": [0.0034, 0.0036], "orbits": ["PPP"]},
        "numerics": {"starts": 4, "rounds": 1},
    }
    with pytest.raises(ci.InputError, match=r"3 of 3 motions simulated"):
        follow(read_scene(table))


def test_a_motion_that_sticks_at_first_is_followed_on():
    """It starts in impacts that accumulate on the lower wall, and settles on 2:1."""
    model = ImpactPair(beta=np.pi / 6, r=0.3, A=5.0, s=0.34)
    simulator = Simulator(model)
    slow = simulator.state("B", time=1.6, velocity=1e-3)
    assert simulator.run(slow, impacts=64).released.any()
    orbit, _ = _settle_orbit(simulator, slow, (64, 96))
    assert orbit is not None
    assert str(word_of(orbit)) == "BBT"


@pytest.mark.full
def test_motions_that_run_away_are_reported():
    """Impacts faster than 1 make the body faster still; slow ones settle."""
    table = {
        "name": "growing",
        "model": {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"w": 1.5, "a": 0.5},
            "modes": {"free": {"x": "v", "v": "a*cos(w*t) - x"}},
            "guards": {"S": {"mode": "free", "within": "x <= 0", "set": {"v": "-v*(1 + v)/2"}}},
        },
        "follow": {"parameter": "w", "range": [1.49, 1.51], "orbits": ["S", "SSS/2T"]},
        "detect": {"events": []},
        "numerics": {"starts": 16, "rounds": 1},
    }
    assert follow(read_scene(table)).statistics["notes"][0] == (
        "1 of 2 motions simulated at w = 1.5 run away, a million times faster than their start and "
        "their forcing"
    )


@pytest.mark.full
def test_it_is_the_same_every_time():
    model = SoftStop(**SOFT)
    kernels = Kernels(model, "omega")
    one, other = (settled_orbits(model, kernels, 3).orbits for _ in range(2))
    assert [o.unknowns.tolist() for o in one] == [o.unknowns.tolist() for o in other]


def random_pairs(count):
    generator = np.random.default_rng(27)
    for _ in range(count):
        beta, r, s = generator.uniform((0.1, 0.2, 0.2), (1.2, 0.8, 0.8)).tolist()
        yield ImpactPair(beta=beta, r=r, A=5.0, s=s)


@pytest.mark.full
def test_no_attractor_of_random_pairs_is_lost():
    found = [missed(model, "s", 4) for model in random_pairs(12)]
    assert [lost for lost, _ in found if lost] == []
    assert sum(count for _, count in found) > 6


@pytest.mark.slow
def test_no_attractor_of_random_scenes_is_lost():
    generator = np.random.default_rng(28)
    kernels = Kernels(SoftStop(**SOFT), "omega")
    found = [missed(model, "s", 10) for model in random_pairs(150)]
    for _ in range(50):
        factors = np.exp(generator.uniform(-0.25, 0.25, len(SOFT))).tolist()
        model = SoftStop(**{k: v * f for (k, v), f in zip(SOFT.items(), factors, strict=True)})
        found.append(missed(model, "omega", 6, kernels))
    assert [lost for lost, _ in found if lost] == []
    assert sum(count for _, count in found) > 100


def test_a_word_of_two_orbits_is_named_once():
    """As of an orbit and its mirror image."""
    orbit, *_ = search.find_orbits(ImpactPair(beta=0.5, r=0.3, A=5.0, s=0.39), "1:1")
    assert Settled([orbit, orbit], 3, {MotionEnd.FLOWN: 1}, False).words() == ["BT", "0"]


def test_motions_that_the_system_does_not_carry_on_say_so():
    """A converter whose coil is full only after the clock, which its mode does not watch: i = q = 1
    at t = L q/E = 1.5 T. They were said to stick or to be complex."""
    model = {
        "system": "hybrid",
        "period": "1",
        "parameters": {"q": 1.0},
        "modes": {"on": {"i": "2/3", "s": "1"}, "off": {"i": "-2/3", "s": "1"}},
        "guards": {
            "P": {"mode": "on", "within": "i <= q", "to": "off"},
            "B": {"mode": "off", "within": "s <= 1", "to": "on", "set": {"s": 0, "i": "-i/9"}},
        },
    }
    follow = {"parameter": "q", "range": [0.3, 2.0], "orbits": ["PB"]}
    model = read_scene({"name": "converter", "model": model, "follow": follow}).model
    found = settled_orbits(model, Kernels(model, "q"))
    assert found.ends == {MotionEnd.BEYOND: found.motions, MotionEnd.UNSETTLED: 0}
    (said,) = found.remarks("q = 1", quiet=False)
    assert "ended: a jump led behind a guard of the next mode" in said
