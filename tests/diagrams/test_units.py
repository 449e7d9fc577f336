"""The same branches in other units of length and time have the same points and events."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np
import pytest
from zoo import ROCKING_BLOCK

import contimpact as ci
from contimpact.bifurcations.crisis import Connected, Connection
from contimpact.bifurcations.extended_system import null_vectors
from contimpact.bifurcations.kind import _is_recorded, kind_of
from contimpact.bifurcations.kind import test_functions as make_tests
from contimpact.bifurcations.sliding import near_touches
from contimpact.bifurcations.zero_duration import ZeroDuration
from contimpact.continuation.branch import EndKind, Event, Point
from contimpact.continuation.settings import Settings
from contimpact.diagrams.connection_paths import is_physical
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.diagrams.orbit_walks import walk_both_ways, walk_orbits
from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.quiet import QuietProblem
from contimpact.orbits.search import find_orbits
from contimpact.results.scene import read_scene
from contimpact.segments.bounded import bounds_of
from contimpact.segments.checking import check_model
from contimpact.segments.kernels import Kernels
from contimpact.simulation.attractor import Kind
from contimpact.simulation.settle import Settling, settle
from contimpact.simulation.simulator import Simulator
from contimpact.systems.bouncing_ball import BouncingBall
from contimpact.systems.duffing import Duffing
from contimpact.systems.two_stops import TwoStops

pytest.importorskip("heyoka", reason="needs contimpact[ode]")


@functools.cache
def followed(length, time):
    """A branch of symmetric orbits of a Duffing oscillator, and the one born where their symmetry
    breaks: how many points they have, and their events in the units of the first call."""
    model = Duffing(
        a=3.0 * length / time**2,
        omega=1.2 / time,
        c=0.1 / time,
        alpha=1.0 / time**2,
        beta=1.0 / (length * time) ** 2,
        sigma=30.0 * length,
        r=0.7,
    )
    problem = QuietProblem(model, Word("", 1), Kernels(model, "omega"))
    guess = np.array([1.79974 * length, 0.2466 * length / time, 1.2 / time])
    limits = 1.05 / time, 1.21 / time
    tests = make_tests(problem, ["FB", "BP"], {})
    first = walk_both_ways(problem, guess, limits, tests, Settings())
    start = kind_of("BP").born(first.events[0])
    born = walk_orbits(
        problem,
        start.unknowns,
        1,
        tangent=start.tangent,
        branching=True,
        tests=tests,
        limits=limits,
        settings=Settings(),
    )
    events = [
        (e.kind, e.parameter * time, e.error * time, e.point.evaluation.multipliers)
        for e in (*first.events, *born.events)
    ]
    return [len(first.points), len(born.points)], events


@pytest.mark.quick(2)
@pytest.mark.parametrize(("length", "time"), [(1e5, 1e-3), (1e-6, 1e-6), (1e-6, 1e3), (1e5, 1e5)])
def test_branches_are_the_same_in_any_units(length, time):
    points, events = followed(1.0, 1.0)
    others, found = followed(length, time)
    assert others[0] == points[0]
    assert [kind for kind, *_ in events] == [kind for kind, *_ in found] == ["BP"]
    for (_, value, error, multipliers), (_, other, off, same) in zip(events, found, strict=True):
        assert abs(value - other) <= error + off
        assert np.allclose(multipliers, same, rtol=1e-7, atol=1e-7)


def rubbing(length, time):
    """The orbits `SN` of a body with dry friction that hits a stop in forward motion."""
    x, v = f"x/({length})", f"v*({time})/({length})"
    law = f"({length})/({time})**2*(1.5*cos(w*t/({time})) - {x} - 0.1*{v}"
    table = {
        "system": "hybrid",
        "period": f"2*pi*({time})/w",
        "parameters": {"w": 0.8},
        "modes": {"p": {"x": "v", "v": law + " - 0.3)"}, "n": {"x": "v", "v": law + " + 0.3)"}},
        "guards": {
            "N": {"mode": "n", "within": "v <= 0", "to": "p"},
            "S": {"mode": "p", "within": f"x <= 0.6*({length})", "to": "n", "set": {"v": "-0.7*v"}},
        },
    }
    follow = {"parameter": "w", "range": [0.5, 1.6], "orbits": ["SN"]}
    model = read_scene({"name": "rubbing", "model": table, "follow": follow}).model
    return OrbitProblem(model, Word("SN", 1), Kernels(model, "w"))


@pytest.mark.full
def test_sizes_of_guards_on_a_position_and_on_a_velocity():
    """At the stop the state is told by v, v and dv/dt, where the motion turns by dv/dt, x and v."""
    speed, force = 1e-6 / 1e-3, 1e-6 / 1e-3**2
    units = np.array([1e-3, speed, speed, force, 1e-3, force, 1e-6, speed, 1.0])
    z = np.array([0.2394, 2.153, 2.153, 0.3324, 4.279, 1.651, -1.324, 0.0, 1.1])
    problem, other = rubbing(1, 1), rubbing(1e-6, 1e-3)
    sizes, others = problem.scale(z, 1.1), other.scale(units * z, 1.1)
    assert others == pytest.approx(units * sizes, rel=1e-9)
    ends = np.array([speed, force, 1e-6, speed, 1e-6, speed, speed, force])
    assert other.residual_sizes(others) == pytest.approx(ends * problem.residual_sizes(sizes))
    assert other.natural_units(units * z) == pytest.approx(
        units * problem.natural_units(z), rel=1e-9
    )
    values = list(problem.model.values.values())
    (rows, *_), (errors, *_) = bounds_of(problem.segments[0], z[:4], z[4:8], values)
    moved = units * z
    (same, *_), (bounds, *_) = bounds_of(other.segments[0], moved[:4], moved[4:8], values)
    assert np.array(same) / ends[:4] == pytest.approx(np.array(rows), rel=1e-12)
    assert max(errors) < 1e-13
    assert np.all(np.array(bounds) / ends[:4] < 1e-11)


@pytest.mark.full
def test_a_law_in_units_in_which_random_states_are_far_away():
    """There motion of a hardening oscillator is too fast for differences, which contradicted it."""
    law = "1e-9*(0.5*cos(1.4*t/1000) - x/1e-3 - (x/1e-3)**3 - 0.1*(v*1e6))"
    table = {
        "system": "hybrid",
        "period": "2000*pi/w",
        "parameters": {"w": 1.4, "d": 0.8e-3},
        "modes": {"m": {"x": "v", "v": law.replace("1.4", "w")}},
        "guards": {"S": {"within": "x <= d", "set": {"v": "-0.8*v"}}},
    }
    follow = {"parameter": "w", "range": [1.1, 2.2], "orbits": ["1"]}
    model = read_scene({"name": "far", "model": table, "follow": follow}).model
    assert "flight from S" in check_model(model)


@pytest.mark.parametrize("word", ["0", "1"])
@pytest.mark.parametrize(("length", "rate"), [(1e-6, 1.0), (1e6, 1e6)])
def test_orbits_are_restored_in_any_units_and_those_of_other_models_refused(word, length, rate):
    model = ci.Oscillator(
        a=0.5 * length * rate**2,
        omega=1.7 * rate,
        c=0.2 * rate,
        k=rate**2,
        sigma=0.1 * length,
        r=0.8,
    )
    orbit = ci.find_orbits(model, word, parameter="omega")[0]
    limits = (1.2 * rate, 2.5 * rate)
    branch = ci.continue_orbit(orbit, "omega", limits, events=["FB", "PD", "G", "V"])
    event = branch.events[0]
    assert event.orbit().value == event.value
    assert branch.orbit(len(branch) // 2).parameter == "omega"
    damaged = replace(event, parameters={**event.parameters, "c": 0.4 * rate})
    with pytest.raises(ci.InputError, match="no orbit of this model"):
        damaged.orbit()


def test_orbits_whose_impacts_are_all_at_rest_on_walls_at_zero_are_restored():
    """At the symmetric V of a rocking block x = 1 - cosh t + ... turns at the corner: there
    b omega/(1 + omega^2) = tanh(pi/(2 omega)). Units taken from these impacts are rounding."""
    model = read_scene(ROCKING_BLOCK).model.replace(b=2.0)
    orbit = next(o for o in ci.find_orbits(model, "NP", parameter="b") if not o.physical)
    branch = ci.continue_orbit(orbit, "b", (1.5, 2.0), events=["V"])
    for event in branch.events:
        assert event.value == pytest.approx(2.5 * np.tanh(np.pi / 4.0), rel=1e-13)
        assert np.max(np.abs(event.orbit().velocities)) < 1e-14
    assert branch.events


@functools.cache
def between_stops(lower, factor=1.0):
    """Branches of an oscillator between two stops; the gap coordinate of the lower one has a
    factor, as guards of one's own may have."""
    table = {
        "system": "linear",
        "coordinates": ["x"],
        "mass": [1],
        "damping": ["c"],
        "stiffness": [1],
        "force": ["a*cos(omega*t)"],
        "period": "2*pi/omega",
        "guards": {
            "S": {"within": "x <= 1", "restitution": 0.6},
            "T": {"within": lower, "restitution": 0.5},
        },
        "parameters": {"omega": 0.8, "c": 0.1, "a": 1.0},
    }
    follow = {"parameter": "a", "range": [0.2, 1.6], "orbits": ["SST"]}
    scene = read_scene({"name": "stops", "model": table, "follow": follow})
    machine = scene.model.machine
    upper, own = machine.guards
    side = own.side if factor > 0.0 else -own.side
    own = replace(own, row=(factor,), side=side, position=f"({own.position})*({factor})")
    model = type(scene.model)(
        machine=replace(machine, guards=(upper, own)).text, **table["parameters"]
    )
    found = ci.follow(replace(scene, model=model))
    return [branch for branch in found.branches if branch.word == "SST"]


@pytest.mark.full
@pytest.mark.parametrize("given", [("-3*x <= 2",), ("x >= -2/3", -1.0), ("x >= -2/3", 3.0)])
def test_grazings_are_found_whatever_factor_a_guard_has(given):
    """Steps in one coordinate took each position for the gap coordinate, and found no G at all."""
    expected, found = between_stops("x >= -2/3"), between_stops(*given)
    assert sum(event.kind == "G" for branch in expected for event in branch.events) == 5
    for one, other in zip(expected, found, strict=True):
        assert [e.kind for e in other.events] == [e.kind for e in one.events]
        assert [e.physical for e in other.events] == [e.physical for e in one.events]
        values = [e.value for e in one.events]
        assert [e.value for e in other.events] == pytest.approx(values, rel=1e-13)


@functools.cache
def mapped(length, time):
    """A covered map of an oscillator with a stop, and the model it is of."""
    sizes = {"a": length / time**2, "omega": 1.0 / time, "c": 1.0 / time, "k": 1.0 / time**2}
    sizes |= {"sigma": length, "r": 1.0}
    given = {"a": 0.5, "omega": 1.7, "c": 0.2, "k": 1.0, "sigma": 0.1, "r": 0.8}
    values = {name: value * sizes[name] for name, value in given.items()}
    omegas = [1.2 / time, 2.8 / time]
    kinds = ["FB", "PD", "G"]
    follow = {"parameter": "omega", "range": omegas, "orbits": ["1"], "switch": ["PD", "G"]}
    curves = {"parameter": "sigma", "range": [0.05 * length, 0.15 * length]}
    table = {
        "name": "mapped",
        "model": {"system": "oscillator", "parameters": values},
        "follow": follow,
        "detect": {"events": kinds},
        "curves": curves | {"kinds": kinds, "cover": 2},
    }
    scene = read_scene(table)
    return ci.follow(scene), scene.model


@pytest.mark.full
@pytest.mark.parametrize(("length", "time"), [(1e-6, 1.0), (1e6, 1e-6)])
def test_maps_are_the_same_in_any_units(length, time):
    """In large units no curve passed an entry, and each was followed dozens of times; in small ones
    the points of curves were off by 1e-7 of their values."""
    expected, (found, model) = mapped(1.0, 1.0)[0], mapped(length, time)
    about = [[(c.kind, c.notation) for c in d.curves] for d in (expected, found)]
    assert sorted(about[0]) == sorted(about[1])
    assert all(told.complete and not told.uncovered for told in found.coverage)
    curve = next(curve for curve in found.curves if (curve.kind, curve.notation) == ("PD", "1"))
    for row in np.linspace(0, len(curve) - 1, 5).astype(int).tolist():
        there = model.replace(**{n: float(curve[n][row]) for n in ("omega", "sigma")})
        orbits = ci.find_orbits(there, "1", parameter="omega", starts=32)
        assert min(min(abs(orbit.multipliers + 1.0)) for orbit in orbits) < 1e-11


def scaled_masses(length, time, word):
    """A scene of two masses between stops, in other units."""
    sizes = {"c": 1.0 / time, "k": 1.0 / time**2, "a": length / time**2, "o": 1.0 / time}
    sizes |= {"s": length, "r": 1.0}
    given = {"c1": 0.1, "c2": 0.05, "k1": 1.0, "k2": 0.6, "a1": 1.0, "omega": 1.3}
    given |= {"sigma_1": 1.0, "sigma_2": 1.0, "r": 0.8}
    values = {name: value * sizes[name[0]] for name, value in given.items()}
    limits = [0.9 / time, 1.4 / time]
    follow = {"parameter": "omega", "range": limits, "orbits": [word], "switch": ["V"]}
    model = {"system": "two-masses", "parameters": values}
    detect = {"events": ["G", "V"]}
    return read_scene({"name": "m", "model": model, "follow": follow, "detect": detect})


@pytest.mark.full
def test_what_is_born_without_impacts_is_found_in_large_units():
    """From a touch at which all is zero a search saw no size, and its residual was too large."""
    expected, found = (ci.follow(scaled_masses(length, 1.0, "A")) for length in (1.0, 1e6))
    assert [entry.label for entry in found.entries] == [entry.label for entry in expected.entries]
    assert {"V[1:0->0]", "G[0->0:1]"} <= {entry.label for entry in found.entries}
    assert [branch.notation for branch in found.branches] == ["1:0", "0"]


def test_durations_are_not_rounding_in_small_units_of_time():
    model = scaled_masses(1.0, 1e-12, "A").model
    orbit = ci.find_orbits(model, "A", parameter="omega", starts=32)[0]
    point = Point(orbit.linearisation, np.full(5, np.nan), 0.0, 0.0, 0)
    assert ZeroDuration(orbit.problem).values(point) == pytest.approx([1.0])


@pytest.mark.parametrize("length", [1.0, 1e-9])
def test_a_gap_is_no_touch_in_small_units_of_length(length):
    """A gap of a fifth of the amplitude is below 1e-9 in them."""
    model = ci.Oscillator(a=0.5 * length, omega=1.0, c=0.2, k=1.0, sigma=0.1 * length, r=0.8)
    orbit = next(o for o in ci.find_orbits(model, "1", parameter="omega") if o.stable)
    assert orbit.smallest_gap == pytest.approx(0.155706800621 * length)
    assert not near_touches(orbit.linearisation)


@pytest.mark.parametrize(("time", "off"), [(1e-6, 0.0), (1e-6, 1e-3), (1e6, 0.0), (1e6, 1e-3)])
def test_a_path_is_physical_if_flights_repeat_it_in_any_unit_of_time(time, off):
    rate = 1.0 / time
    model = ci.Oscillator(
        a=0.5 * rate**2, omega=1.7 * rate, c=0.2 * rate, k=rate**2, sigma=0.1, r=0.8
    )
    simulator = Simulator(model)
    run = simulator.run(simulator.state("S", 0.3 * time, rate), impacts=6)
    rows = np.column_stack([run.times, run.velocities])
    rows[3, 0] += off * time
    word = Word("S", 1)
    problem = Connection(model, Kernels(model, "omega"), "S" * len(rows), None, word, word)
    path = Connected(problem, np.append(rows.ravel(), 1.7 * rate), np.zeros(0), np.zeros(0))
    assert is_physical(path) == (not off)


def test_events_of_different_orbits_are_two_in_small_units():
    model = ci.Oscillator(a=0.5, omega=1.7e9, c=2e8, k=1e18, sigma=1e-19, r=0.8)
    orbit = ci.find_orbits(model, "1", parameter="sigma", starts=32)[0]
    points = [
        Point(orbit.problem.evaluate(part * orbit.unknowns), np.zeros(3), 0.0, 0.0, 0)
        for part in (1.0, 1.01)
    ]
    one, other = (Event("FB", point, 0.0, 0.0, "newton") for point in points)
    assert _is_recorded(one, [one])
    assert not _is_recorded(other, [one])


@pytest.mark.parametrize(("length", "time"), [(1.0, 1.0), (1e6, 1e-6), (1e-9, 1e-6)])
def test_motions_are_simulated_alike_in_any_units(length, time):
    """The restitution of slow impacts was read off at a speed of 1e-6: where speeds are 1e12 it was
    0 for 0.3, and all motions stuck."""
    rate = 1.0 / time
    given = {"a": 0.5 * length * rate**2, "c": 0.1 * rate, "k": rate**2, "sigma": 0.1 * length}
    model = ci.Oscillator(**given, omega=2.46 * rate, r=0.3)
    simulator = Simulator(model)
    assert simulator.machine.restitution == pytest.approx([0.3], rel=1e-11)
    start = simulator.state("S", 0.3 * time, length * rate)
    found = settle(simulator, start, Settling(periods=1000))
    assert (found.kind, found.notation) == (Kind.PERIODIC, "1/2T")
    orbits = ci.find_orbits(model, "1/2T", parameter="omega", starts=64)
    speeds = next(np.sort(o.velocities) for o in orbits if o.stable and o.physical)
    assert np.sort(found.velocities) == pytest.approx(speeds, rel=1e-12)


@pytest.mark.parametrize(("length", "time"), [(1.0, 1.0), (1e6, 1e-6)])
def test_motions_of_two_masses_settle_in_any_units(length, time):
    """Derivatives of the map mixed units, and a cycle's multipliers were infinite."""
    model = scaled_masses(length, time, "A").model.replace(omega=1.05 / time)
    simulator = Simulator(model)
    speed = length / time
    start = simulator.state("A", 0.3 * time, speed, others=(0.1 * length, 0.2 * speed))
    found = settle(simulator, start, Settling(periods=600))
    assert (found.kind, found.notation) == (Kind.PERIODIC, "0:1")
    orbit = next(o for o in ci.find_orbits(model, "B", parameter="omega") if o.stable)
    assert found.velocities == pytest.approx(orbit.velocities, rel=1e-12)
    moduli = np.sort(np.abs(found.multipliers))
    assert moduli == pytest.approx(np.sort(np.abs(orbit.multipliers)), rel=1e-7)


@pytest.mark.parametrize("length", [1e-9, 1e9])
def test_null_vectors_of_long_words_have_an_orientation(length):
    """Determinants of 40 flights overflow in such units, and vectors of no length came of it."""
    ball = BouncingBall(a=0.0055 * length, omega=50.0, r=0.5, g=9.8 * length)
    problem = OrbitProblem(ball, Word("P" * 40, 40), Kernels(ball, "a"))
    impacts = [(0.0146 + k * np.pi / 25.0, -0.821 * length) for k in range(40)]
    here = problem.evaluate(np.array([*np.ravel(impacts), 0.0055 * length]))
    assert list(map(np.linalg.norm, null_vectors(here, -1.0))) == pytest.approx([1.0, 1.0])


def test_errors_of_events_do_not_depend_on_the_unit_of_length():
    """A linear flight without a constant force was said to be rounded beside one of one unit: of
    stops some nanometres away, in metres, errors were up to 2, and branches were left out."""
    events = []
    for length in (1.0, 2.0**-30):
        model = TwoStops(a=length, omega=1.2, c=0.1, k=1.0, sigma=0.3 * length, r=0.7)
        orbit = find_orbits(model, "1:1", parameter="omega")[-1]
        found = continue_orbit(orbit, "omega", range=(0.9, 2.2)).events
        events.append([(event.kind, event.value, event.error) for event in found])
    for (kind, value, error), (same, there, off) in zip(*events, strict=True):
        assert (same, there) == (kind, pytest.approx(value, abs=1e-13))
        assert 0.3 * error < off < 3.0 * error


def test_events_of_coordinates_coupled_one_way_do_not_depend_on_their_units():
    """In micrometres beside kilometres flights took 1e9 turns, and errors were beside the larger
    unit: the first coordinate is an oscillator of its own."""
    damping = [["0.1", 0], ["-0.3*w/u", "0.2"]]
    stiffness = [[1, 0], ["-0.5*w/u", 2.3]]
    machine = {"coordinates": ["x", "y"], "mass": [1, 1], "damping": damping}
    machine |= {"stiffness": stiffness, "force": ["0.8*u*cos(om*t)", "0.1*w*sin(om*t)"]}
    guards = {"A": {"within": "x <= 0.4*u", "restitution": 0.7}}
    values = {"u": 1e-6, "w": 1e3, "om": 1.3}
    model = {"system": "linear", **machine, "period": "2*pi/om", "guards": guards}
    follow = {"parameter": "om", "range": [0.9, 1.9], "orbits": ["A"]}
    scene = {"name": "two units", "model": {**model, "parameters": values}, "follow": follow}
    alone = ci.Oscillator(a=0.8, omega=1.3, c=0.1, k=1.0, sigma=0.4, r=0.7)
    orbits = [
        ci.find_orbits(machine, "A" if name == "om" else "S", parameter=name)
        for machine, name in ((read_scene(scene).model, "om"), (alone, "omega"))
    ]
    values = []
    for found, name in zip(orbits, ("om", "omega"), strict=True):
        branch = continue_orbit(found[0], name, range=(0.9, 1.9), events=["PD"])
        values.append([(event.value, event.error) for event in branch.events])
    (found, error), *_ = values[0]
    assert error < 1e-12
    assert found == pytest.approx(values[1][0][0], abs=1e-13)


def test_a_coordinate_that_rests_but_for_rounding_bends_no_curve():
    """It was measured by its rounding, 1e-41, beside which every step of the curve turned."""
    machine = {"system": "linear", "period": "2*pi/om", "guards": {}}
    machine["guards"]["R"] = {"within": "x <= s", "restitution": "r"}
    machine["guards"]["L"] = {"within": "x >= -0.5", "restitution": "r"}
    alone = {"coordinates": ["x"], "mass": [1], "damping": [0.1], "stiffness": [1]}
    beside = {"coordinates": ["x", "q"], "mass": [1, 1], "damping": [0.1, 0.7]}
    beside |= {"stiffness": [1, 1.3], "force": ["cos(om*t) + 0.05", 0]}
    ends = []
    for one in (alone | {"force": ["cos(om*t) + 0.05"]}, beside):
        model = {**machine, **one, "parameters": {"om": 1.7, "s": 0.1, "r": 0.8}}
        follow = {"parameter": "s", "range": [0.05, 0.9], "orbits": ["RL"]}
        scene = read_scene({"name": "beside", "model": model, "follow": follow})
        orbits = find_orbits(scene.model, "RL", parameter="s", starts=16)
        branches = [continue_orbit(o, range=(0.05, 0.2), events=["PD"]) for o in orbits]
        (doubling,) = (e for b in branches for e in b.events if not e.ghost)
        curve = ci.follow_curve(doubling, scene.model, "r", (0.05, 0.9), (0.7, 0.9))
        ends.append(sorted((curve["s"][k], curve["r"][k]) for k in (0, -1)))
    assert np.max(np.abs(np.subtract(*ends))) < 1e-12


@pytest.mark.full
def test_a_double_multiplier_has_one_eigenvector_in_any_unit():
    """Beside velocities of a million it was taken for one of two, at which no curve of NS begins.
    One ends there by its own equations."""
    machine = {"coordinates": ["x", "y"], "mass": [1, 1.5], "damping": [[0.2, -0.1], [-0.1, 0.1]]}
    machine |= {"stiffness": [[2, -1], [-1, 1]], "force": ["u*cos(om*t)", 0]}
    guards = {"A": {"within": "y <= s*u", "restitution": "r"}}
    model = {"system": "linear", **machine, "period": "2*pi/om", "guards": guards}
    model |= {"parameters": {"u": 1e6, "om": 1.3, "s": 0.69, "r": 0.7}}
    follow = {"parameter": "s", "range": [0.3, 0.8], "orbits": ["A/2T"]}
    scene = read_scene({"name": "column", "model": model, "follow": follow})
    orbits = find_orbits(scene.model, "AA/2T", parameter="s", starts=32)
    branches = [continue_orbit(o, range=(0.67, 0.76), events=["PD", "NS"]) for o in orbits]
    events = sorted((e for b in branches for e in b.events), key=lambda e: (e.kind, -e.value))
    torus, *_, doubling = (
        ci.follow_curve(e, scene.model, "r", (0.3, 0.8), (0.55, 0.72)) for e in events if e.physical
    )
    end = next(end for end in torus.ends if end.kind is EndKind.RESONANCE)
    (double,) = doubling.points
    assert (double.kind, double.parameters["s"]) == ("R2", pytest.approx(end.value, rel=1e-9))
