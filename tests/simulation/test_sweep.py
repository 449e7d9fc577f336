"""Sweeps, their classification, random starts and basins, on the paper's figures."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.orbits.search import find_orbits
from contimpact.results.diagram import Diagram
from contimpact.results.options import SETTLING, Settling
from contimpact.simulation.attractor import Attractor, Kind, solve_cycle
from contimpact.simulation.run import State
from contimpact.simulation.settle import complex_notation, settle
from contimpact.simulation.simulator import Simulator
from contimpact.simulation.sweep import (
    Row,
    Simulators,
    Sweep,
    basins,
    cover,
    find_attractors,
    same_attractor,
    sweep,
    sweep_rows,
)
from contimpact.systems.duffing import Duffing
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.two_stops import TwoStops

pytestmark = pytest.mark.usefixtures("compiled_where_it_pays")

QUICK = Settling(transient=50, periods=600, impacts=1500)


@pytest.fixture(scope="session")
def settled(pair, kernels_of):
    """``settled(**values)``: the attractor of the impact pair from one start."""

    def at(start=(0, 0.25, 0.6), settling=QUICK, **values):
        model = pair(**values)
        return settle(Simulator(model, kernels_of(model, "s")), State(*start), settling)

    return at


# Classification


@pytest.mark.parametrize(
    ("d", "notation", "word", "velocities"),
    [
        (0.242, "1:1", "BT", [0.68617778, -0.49847009]),
        (0.233, "1:1/2T", "BTBT", [0.68655287, -0.51214634, 0.65862782, -0.45761896]),
        (0.205, "2:1", "BBT", [0.59836271, 0.11700541, -0.52766043]),
        (0.174, "2:1", "BBT", [0.54373554, 0.13247196, -0.48849981]),
    ],
)
def test_attractors_of_the_captions_of_fig_7(settled, d, notation, word, velocities):
    """Velocities computed independently to eight digits."""
    found = settled(d=d)
    assert (found.kind, found.notation, found.word) == (Kind.PERIODIC, notation, word)
    assert np.max(np.abs(found.velocities - velocities)) < 6e-9
    assert found.closing < 1e-9
    assert found.settled


def test_alternating_motion_of_fig_8h(settled):
    """d = 0.1132: 2:1 and 2:2 alternate over 2T, seven impacts."""
    found = settled(r=0.25, A=13.7478, s=0.5)
    expected = [
        0.46268051,
        0.07201093,
        -0.44067532,
        -0.05696903,
        0.46168431,
        0.08924472,
        -0.44597813,
    ]
    assert found.notation == "(4:3)/2T"
    assert found.word == "BBTBBTT"
    shift = found.velocities.tolist().index(
        min(found.velocities.tolist(), key=lambda v: abs(v - expected[4]))
    )
    assert np.max(np.abs(np.roll(found.velocities, -shift) - np.roll(expected, -4))) < 2e-6


def test_complex_motion_between_the_doubling_and_the_fold(settled):
    found = settled(d=0.226)
    assert found.kind is Kind.COMPLEX
    assert found.notation == "1:1/C"
    assert found.exponents[0] > 10 * found.error
    assert sum(found.exponents) == pytest.approx(2 * math.log(0.3), abs=1e-6)
    assert found.word is None


def test_sticking_motion_at_short_lengths(settled):
    """After many impacts on the bottom the ball rests there once in every period."""
    found = settled(d=0.14)
    assert (found.kind, found.word, found.period) == (Kind.STICKING, "B*T", 1)
    assert found.notation == "inf:1"
    assert found.exponents == (-math.inf, -math.inf)


def test_a_ball_that_never_leaves_rests(settled):
    found = settled(A=0.5, s=0.5)
    assert found.kind is Kind.RESTING
    assert found.label == "resting"


def test_no_restitution(settled):
    found = settled(r=0.0, s=0.3)
    assert found.kind is Kind.STICKING
    assert found.period == 1


def test_without_time_it_says_so(settled):
    """Between the doubled orbit and complex motion a few periods do not tell."""
    found = settled(d=0.2385, settling=Settling(transient=0, periods=1, impacts=40))
    assert found.kind is Kind.NOT_SETTLED
    assert not found.settled
    assert found.notation == "not settled"


def test_a_motion_near_an_unstable_orbit_is_not_taken_for_it(pair, kernels_of):
    """Beyond the doubling, from next to the unstable 1:1 orbit: the doubled orbit."""
    model = pair(d=0.237)
    orbit = next(o for o in find_orbits(model, "1:1", kernels=kernels_of(model, "s")))
    assert not orbit.stable
    simulator = Simulator(model, kernels_of(model, "s"))
    start = simulator.state("B", orbit.times[0], orbit.velocities[0] + 1e-8)
    assert settle(simulator, start, SETTLING).notation == "1:1/2T"


def test_close_to_a_doubling_the_period_is_the_shorter_one(pair, kernels_of):
    """Multiplier -0.996: a run closes after two periods before it does after one."""
    model = pair(s=0.38361)
    found = settle(Simulator(model, kernels_of(model, "s")), State(0, 0.25, 0.6), SETTLING)
    assert found.notation == "1:1"
    assert complex(found.multipliers[0]).real == pytest.approx(-0.996, abs=1e-3)


@pytest.mark.parametrize("word", ["1:1", "2:1", "1:1/2T"])
def test_multipliers_of_the_simulated_map_are_those_of_the_orbit(pair, kernels_of, word):
    d = {"1:1": 0.242, "2:1": 0.205, "1:1/2T": 0.233}[word]
    model = pair(d=d)
    simulator = Simulator(model, kernels_of(model, "s"))
    orbit = next(
        o
        for o in find_orbits(model, word, kernels=kernels_of(model, "s"))
        if o.stable and o.physical
    )
    state = simulator.state("B", orbit.times[0], orbit.velocities[0])
    cycle = solve_cycle(simulator, state, len(orbit.word), orbit.word.period)
    # measured: 2e-15; the smaller multiplier from the determinant
    assert np.allclose(cycle.multipliers, orbit.multipliers, rtol=1e-11, atol=0)
    gap = settle(simulator, state, QUICK).smallest_gap
    assert gap == pytest.approx(orbit.linearisation.verdict.smallest_gap, abs=1e-12)


def test_words_begin_as_users_write_them(settled):
    """Whatever the start, BBT begins with the faster impact on B, in the first period."""
    for start in [(0, 0.25, 0.6), (1, 1.1, -0.4), (0, 1.7, 0.05)]:
        found = settled(start, d=0.205)
        assert found.word == "BBT"
        assert found.velocities[0] > found.velocities[1] > 0
        assert 0 <= found.times[0] < 2
        assert np.all(np.diff(found.times) > 0)


def test_records_read_back_to_the_same_bits(settled):
    for d in (0.242, 0.226, 0.14):
        row = Row("down", d, settled(d=d))
        text = json.dumps(row.as_record())
        again = Row.from_record(json.loads(text))
        assert json.dumps(again.as_record()) == text
        assert np.array_equal(again.attractor.velocities, row.attractor.velocities)
        assert again.attractor.state == row.attractor.state


# Sweeps


@pytest.mark.full
def test_fig_7_downwards(pair, kernels_of):
    """1:1, 1:1/2T, complex, 2:1 from the fold on, 3:1, 4:1 and more as d falls."""
    model = pair()
    found = sweep(
        model,
        "s",
        np.linspace(0.4016, 0.2217, 46).tolist(),
        start=State(0, 0.25, 0.6),
        settling=QUICK,
        kernels=kernels_of(model, "s"),
    )
    met = found.sequence("down")
    assert met[:6] == ["1:1", "1:1/2T", "1:1/C", "2:1", "3:1", "4:1"]
    assert met[-1] == "inf:1"
    assert all(row.attractor.settled for row in found.rows)
    folds = [r.value for r in found.rows if r.attractor.notation == "2:1"]
    assert max(folds) < 0.356895277  # FB of the 2:1 branch


@pytest.mark.full
def test_fig_7_upwards_shows_hysteresis(pair, kernels_of):
    """Beside the fold of 2:1 (d = 0.22217) complex motion and 2:1 coexist; so do 2:1 and 3:1."""
    model = pair()
    values = np.linspace(0.27, 0.37, 26).tolist()
    kernels = kernels_of(model, "s")
    up = sweep(model, "s", values, start=State(0, 0.25, 0.5), settling=QUICK, kernels=kernels)
    down = sweep(
        model, "s", values[::-1], start=State(0, 0.5, 0.66), settling=QUICK, kernels=kernels
    )
    assert up.sequence("up")[:3] == ["3:1", "2:1", "1:1/C"]
    assert down.sequence("down")[:4] == ["1:1/2T", "1:1/C", "2:1", "3:1"]
    last_up = max(r.value for r in up.rows if r.attractor.notation == "2:1")
    first_down = max(r.value for r in down.rows if r.attractor.notation == "2:1")
    assert first_down <= last_up < 0.356895277


@pytest.mark.full
def test_fig_8_upwards_in_A(pair, kernels_of):
    """1:1 to 2:1 by grazing, the doubling to 2:1/2T, then more complicated motion."""
    model = pair(r=0.25, s=0.5)
    values = np.linspace(5.986, 12.9, 26).tolist()
    found = sweep(
        model,
        "A",
        values,
        start=State(0, 0.25, 0.6),
        settling=QUICK,
        kernels=kernels_of(model, "A"),
    )
    assert found.sequence("up")[:3] == ["1:1", "2:1", "2:1/2T"]


FIG_3 = {
    "fig3a": (
        {"beta": math.pi / 9, "r": 0.3, "A": 5.0, "s": 0.5},
        "s",
        (0.64, 0.16),
        ["1:1", "2:1", "3:1"],
    ),
    "fig3b": (
        {"beta": math.pi / 4, "r": 0.5, "A": 5.0, "s": 0.5},
        "A",
        (3.1, 14.5),
        ["1:1", "1:1/2T", "2:1"],
    ),
    "fig3c": (
        {"beta": math.pi / 3, "r": 0.5, "A": 5.0, "s": 0.5},
        "s",
        (0.72, 0.19),
        ["1:1", "1:1/2T", "2:1", "2:1/2T"],
    ),
    "fig3d": (
        {"beta": math.pi / 2, "r": 0.7, "A": 5.0, "s": 0.5},
        "A",
        (1.4, 14.5),
        ["1:1", "1:1/2T", "2:1"],
    ),
}
"""Parameters, the parameter swept, from where to where, and notations met in this order."""


@pytest.mark.parametrize("panel", FIG_3)
@pytest.mark.full
def test_fig_3(pair, kernels_of, panel):
    values, parameter, (first, last), expected = FIG_3[panel]
    model = pair(**values)
    found = sweep(
        model,
        parameter,
        np.linspace(first, last, 56).tolist(),
        start=State(0, 0.25, 0.6),
        settling=QUICK,
        kernels=kernels_of(model, parameter),
    )
    met = iter(found.sequence(found.directions[0]))
    assert all(notation in met for notation in expected)


@pytest.mark.full
def test_a_sweep_goes_on_where_it_was(pair, kernels_of):
    """The rows of the second half, from the last state of the first, are those of the whole."""
    model = pair()
    simulators = Simulators(model, "s", kernels_of(model, "s"))
    values = np.linspace(0.37, 0.34, 9).tolist()
    start = State(0, 0.25, 0.6)
    whole = list(sweep_rows(simulators, values, start, QUICK))
    half = list(sweep_rows(simulators, values[:4], start, QUICK))
    rest = list(sweep_rows(simulators, values[4:], half[-1].attractor.state, QUICK))
    assert [r.as_record() for r in [*half, *rest]] == [r.as_record() for r in whole]


# Random starts and basins


@pytest.mark.full
def test_random_starts_find_both_attractors(pair, kernels_of):
    """Between grazing and fold of 3:1 (s = 0.27903 to 0.27940) 2:1 and 3:1 are both stable."""
    model = pair(s=0.2792)
    simulator = Simulator(model, kernels_of(model, "s"))
    found = find_attractors(simulator, 24, rng=1, settling=QUICK)
    assert {"2:1", "3:1"} <= {a.notation for a in found}
    again = find_attractors(simulator, 24, rng=1, settling=QUICK)
    assert [a.notation for a in again] == [a.notation for a in found]
    assert find_attractors(simulator, 6, rng=1, settling=QUICK, known=found) == []


def test_basins_at_the_same_place(pair, kernels_of):
    model = pair(s=0.2792)
    simulator = Simulator(model, kernels_of(model, "s"))
    found = basins(simulator, shape=(6, 6), settling=QUICK)
    assert found.labels.shape == (6, 6)
    assert sum(found.shares) == pytest.approx(1)
    assert {"2:1", "3:1"} <= {a.notation for a in found.attractors}
    k, j = 2, 3
    direct = settle(simulator, simulator.state("B", found.phases[j], found.velocities[k]), QUICK)
    assert same_attractor(direct, found.attractors[found.labels[k, j]])


def test_attractors_are_the_same_up_to_whole_periods(settled):
    one = settled(d=0.233)
    shifted = Attractor(
        **{**vars(one), "times": np.roll(one.times, -2), "velocities": np.roll(one.velocities, -2)}
    )
    assert same_attractor(one, shifted)
    assert not same_attractor(one, settled(d=0.2335))


def test_motions_that_stick_alike_are_told_apart_by_their_releases():
    """The acceleration turns away twice a period; each release leads to itself. Half of the
    starts do so by the phases at which `settle` finds them released."""
    wave = {"forcing": "-sin(pi*t) - b*sin(2*pi*t + p)", "b": 2.69, "p": 2.77}
    model = ImpactPair(beta=math.asin(0.452), r=0.02, A=1.0, s=50.0, **wave)
    found = basins(model, shape=(4, 8), settling=QUICK)
    assert [a.notation for a in found.attractors] == ["inf:0", "inf:0"]
    phases = [float(a.times[a.released][0]) / 2 % 1 for a in found.attractors]
    assert sorted(phases) == pytest.approx([0.266, 0.825], abs=2e-3)
    assert found.shares == [0.5, 0.5]


def test_bodies_at_rest_on_two_walls_are_two_attractors():
    """A spring of negative stiffness presses them against either stop."""
    model = TwoStops(a=0.1, omega=1.0, c=0.1, k=-1.0, sigma=0.5, r=0.5)
    found = find_attractors(model, 8, settling=QUICK)
    assert [a.notation for a in found] == ["resting", "resting"]


@pytest.mark.parametrize(("length", "time"), [(1e-8, 1.0), (1e9, 1e-6)])
def test_attractors_are_counted_alike_in_all_units(length, time):
    """Two wells before the stop; one orbit if that stands between them."""
    pytest.importorskip("heyoka")
    rate, stiff = 0.2 / time, 1.0 / time**2
    given = {"omega": 1.2 / time, "c": rate, "alpha": -stiff, "beta": stiff / length**2, "r": 0.8}
    wells = Duffing(a=0.02 * stiff * length, sigma=1.5 * length, **given)
    found = find_attractors(wells, 8)
    assert [a.notation for a in found] == ["no impact"] * 2
    upper = max(find_orbits(wells, "0", parameter="omega"), key=lambda orbit: orbit.unknowns[0])
    followed = continue_orbit(upper, "omega", range=(1.1 / time, 1.3 / time), events=[])
    rows = [Row("up", wells.values["omega"], attractor) for attractor in found]
    covered = cover(Sweep(wells, "omega", rows), Diagram("upper well", [followed]))
    assert (len(covered.matches), covered.uncovered[0].count) == (1, 1)
    between = Duffing(a=0.3 * stiff * length, sigma=0.0, **given)
    assert [a.notation for a in find_attractors(between, 8)] == ["1"]


def test_attractors_lie_on_the_branch_of_their_mirror_images():
    """Of symmetric stops, where 1:1 has lost its symmetry: the way from R to L takes more than half
    a period, or as much less."""
    stops = TwoStops(a=1.0, omega=1.7, c=0.1, k=0.0, sigma=0.41, r=0.7)
    found = find_attractors(stops, 8)
    assert [a.notation for a in found] == ["1:1", "1:1"]
    one, other = (
        np.diff(a.times[[a.word.index(w) for w in "RL"]])[0] % a.forcing_period for a in found
    )
    assert one + other == pytest.approx(2 * np.pi / 1.7, abs=1e-9)
    assert abs(one - other) > 0.1
    stable = next(o for o in find_orbits(stops, "1:1", parameter="sigma") if o.stable)
    followed = continue_orbit(stable, "sigma", range=(0.4, 0.42), events=[])
    rows = [Row("random", 0.41, attractor) for attractor in found]
    covered = cover(Sweep(stops, "sigma", rows), Diagram("one of two", [followed]))
    assert (len(covered.matches), covered.uncovered) == (2, [])


def test_an_attractor_of_several_periods_goes_on_from_its_state(settled, pair, kernels_of):
    """Its fastest impact is in a later period than its first."""
    found = settled(s=50.0, A=50.0, r=0.3)
    assert found.period == 10
    assert 0.0 <= found.state.phase < 2.0
    model = pair(s=50.0, A=50.0, r=0.3)
    run = Simulator(model, kernels_of(model, "s")).run(found.state, impacts=len(found.walls))
    np.testing.assert_allclose(np.sort(run.velocities), np.sort(found.velocities), atol=1e-9)
    assert run.end.phase == pytest.approx(found.state.phase, abs=1e-9)
    assert run.end.turns == 10
    found.require(model)


def test_complex_motion_is_called_by_its_impacts_per_period_or_in_several():
    """Motion of less than half an impact in each period was called as if it had none."""
    rates = [1.1, 0.9], [0.6, 0.1], [0.45, 0.35], [0.5, 0.0], [0.2]
    names = ["1:1/C", "1:0/C", "(1:1)/2T/C", "(1:0)/2T/C", "(1)/3T/C"]
    assert [complex_notation(rate) for rate in rates] == names


def test_one_complex_attractor_is_not_two():
    """The 200 impacts that are compared fill an area: they are 0.035 from each other's, as from
    their own."""
    simulator = Simulator(ImpactPair(beta=0.3, r=0.99, A=5.0, s=0.1))
    one, other = (settle(simulator, simulator.random_state(seed)) for seed in (0, 3))
    assert one.kind is other.kind is Kind.COMPLEX
    assert same_attractor(one, other)


def test_mirror_images_of_complex_motion_are_two():
    simulator = Simulator(ImpactPair(beta=0.0, r=0.5, A=5.0, s=0.2))
    one, other = (settle(simulator, simulator.random_state(seed)) for seed in (0, 1))
    assert {one.notation, other.notation} == {"1:2/C", "2:1/C"}
    assert not same_attractor(one, other)
