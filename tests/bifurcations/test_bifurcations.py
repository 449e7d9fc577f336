"""Bifurcations of the impact pair, the bouncing ball and the oscillator against exact answers.

Exact answers are closed forms, or the equations of an event solved anew in mpmath: the plain flight
formulas (11) and (12) of the paper, multipliers from products of 2 x 2 matrices, 40 digits. Every
walk is checked for what must hold on every branch (`check_branch`).
"""

from __future__ import annotations

import bisect
import functools
import math

import mpmath as mp
import numpy as np
import pytest
from scipy.spatial import cKDTree

from contimpact.bifurcations.kind import kind_of, test_functions
from contimpact.continuation.branch import EndKind, Event, Point
from contimpact.continuation.settings import Settings
from contimpact.continuation.walk import walk
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.diagrams.orbit_walks import walk_orbits
from contimpact.errors import InputError
from contimpact.models.guards import Word
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import find_orbits
from contimpact.segments.kernels import Kernels
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.oscillator import Oscillator

DETECTED = ("FB", "BP", "PD", "G", "V", "T")
D_PER_S = 0.6225  # m^-1 at A = 5 N
D_TIMES_A = 1.55625  # N at s = 0.5 m


# Walks, and what holds on all of them


def follow(orbit, limits, direction, kinds=DETECTED, requested=None, settings=None):
    """Follow an orbit one way with these events on, and check the branch."""
    problem = orbit.problem
    tests = test_functions(problem, kinds, requested or {})
    options = {"limits": limits, "tests": tests, "settings": settings}
    found = walk_orbits(problem, orbit.unknowns, direction, gaps=False, **options)
    check_branch(found, settings or Settings())
    return found


def follow_both(orbit, limits, **options):
    return [follow(orbit, limits, direction, **options) for direction in (1, -1)]


def events_of(walks, kind=None):
    return [event for w in walks for event in w.events if kind in (None, event.kind)]


def check_branch(found, settings):
    points = list(found.points)  # each is made when it is asked for
    assert points[0].arclength == 0.0
    assert np.all(np.diff([point.arclength for point in points]) > 0.0)
    problem = points[0].evaluation.problem
    residuals = np.abs([point.evaluation.residual for point in points])
    sizes = [problem.residual_sizes(problem.scale(point.unknowns, 1.0)) for point in points]
    assert np.all(residuals <= settings.tolerance * np.max(sizes, axis=0))
    check_sum_rule(points)
    check_determinant(points)
    check_no_repetition(found)
    check_events_bracketed(found)
    assert found.missed == []


def restitutions(points):
    """The restitution of every impact, shape (points, impacts)."""
    problem = points[0].evaluation.problem
    rows = []
    for point in points:
        values = problem.model_at(point.unknowns).values
        rows.append([values.get("r", values.get(f"r_{wall}")) for wall in problem.word.walls])
    return np.array(rows)


def impacts_of(points):
    """Times and velocities, shape (points, impacts, 2)."""
    problem = points[0].evaluation.problem
    return np.array([problem.impacts(point.unknowns) for point in points])


def check_sum_rule(points):
    """Impact pair: the sum of (1 + r_k) v_k over an orbit is gbar p T.

    It holds to the residual: measured up to 1e-12 of the velocities.
    """
    problem = points[0].evaluation.problem
    if "gbar" not in problem.model.DERIVED:
        return
    velocities = impacts_of(points)[:, :, 1]
    gbar = np.array([point.evaluation.derived["gbar"] for point in points])
    total = np.sum((1.0 + restitutions(points)) * velocities, axis=1)
    off = total - gbar * problem.word.period * 2.0
    assert np.max(np.abs(off) / np.maximum(1.0, np.sum(np.abs(velocities), axis=1))) <= 4e-12


def check_determinant(points):
    """The multipliers' product is that of r_k^2, times the contraction in flight.

    Away from zero velocity only, where the larger one is infinite. Measured: 2e-8 where multipliers
    reach 1e6; 1e-11 otherwise. The larger one is compared with the return map's own eigenvalue.
    """
    problem = points[0].evaluation.problem
    speeds = np.abs(impacts_of(points)[:, :, 1])
    moving = np.min(speeds, axis=1) >= 1e-3 * np.max(speeds, axis=1)
    if not np.any(moving):
        return
    here = [point.evaluation for point, good in zip(points, moving, strict=True) if good]
    expected = np.prod(restitutions(points)[moving] ** 2, axis=1)
    if "c" in problem.model.values:
        values = [problem.model_at(e.unknowns).values for e in here]
        damping = np.array([v["c"] / v["omega"] for v in values])
        expected *= np.exp(-2.0 * math.pi * problem.word.period * damping)
    multipliers = np.array([e.multipliers for e in here])
    products = np.prod(multipliers, axis=1)
    assert np.max(np.abs(products / expected - 1.0)) <= 1e-6
    steps = -np.linalg.solve(np.array([e.end for e in here]), np.array([e.start for e in here]))
    monodromy = functools.reduce(lambda m, k: steps[:, k] @ m, range(steps.shape[1]), np.eye(2))
    largest = np.max(np.abs(np.linalg.eigvals(monodromy)), axis=1)
    assert np.max(np.abs(multipliers), axis=1) == pytest.approx(largest, rel=1e-6)


def check_no_repetition(found):
    """No orbit comes twice, up to whole periods; a closed branch ends where it began."""
    points = found.points[:-1] if found.end.kind is EndKind.CLOSED else found.points
    problem = points[0].evaluation.problem
    periods = np.array([problem.period(p.unknowns) for p in points])
    rows = impacts_of(points)
    phases = 2.0 * math.pi * rows[:, :, 0] / periods[:, None]
    values = np.array([[point.parameter] for point in points])
    z = np.hstack([np.cos(phases), np.sin(phases), rows[:, :, 1], values])
    assert not cKDTree(z).query_pairs(1e-10)


def check_events_bracketed(found):
    """Every event lies between two neighbouring points, and not far off their chord."""
    arclengths = [point.arclength for point in found.points]
    scale = found.points[0].evaluation.problem.scale(found.points[0].unknowns, 1.0)[:-1]
    places = [event.point.arclength for event in found.events]
    assert places == sorted(places)
    for event in found.events:
        right = min(max(bisect.bisect(arclengths, event.point.arclength), 1), len(arclengths) - 1)
        left, right = found.points[right - 1], found.points[right]
        slack = 2e-9 * (right.arclength - left.arclength)
        assert left.arclength - slack <= event.point.arclength <= right.arclength + slack

        def apart(one, other):
            return np.linalg.norm((one.unknowns - other.unknowns)[:-1] / scale)

        step = right.arclength - left.arclength
        assert max(apart(event.point, left), apart(event.point, right)) <= 1.2 * step + 1e-12
        assert event.method == "newton"
        assert event.residual <= 1e-12
        assert 0.0 <= event.error <= 1e-11


# Exact equations in mpmath


def exact_values(problem, value):
    """Parameters as mpmath sees the doubles of the model, the free one replaced."""
    values = {name: mp.mpf(number) for name, number in problem.model.values.items()}
    values[problem.parameter] = value
    return values


def exact_pair(values):
    """d and gbar."""
    d = values["M"] * values["omega"] ** 2 * values["s"] / (values["A"] * mp.pi**2)
    return d, values["M"] * values["g"] * mp.sin(values["beta"]) / values["A"]


def exact_flight(r, gbar, wall0, wall1, t0, v0, t1, v1):
    """Residual of equations (11) and (12), and its derivatives by (t0, v0) and by (t1, v1)."""
    dt = t1 - t0
    first, second = mp.sin(mp.pi * t0) / mp.pi, -mp.cos(mp.pi * t0) / mp.pi**2
    once = mp.sin(mp.pi * t1) / mp.pi - first
    twice = -mp.cos(mp.pi * t1) / mp.pi**2 - second - first * dt
    push0, push1 = mp.cos(mp.pi * t0) + gbar, mp.cos(mp.pi * t1) + gbar
    residual = [
        wall0 - r * v0 * dt + gbar * dt**2 / 2 + twice - wall1,
        -r * v0 + gbar * dt + once - v1,
    ]
    start = mp.matrix([[r * v0 - push0 * dt, -r * dt], [-push0, -r]])
    end = mp.matrix([[-r * v0 + gbar * dt + once, 0], [push1, -1]])
    return residual, start, end


def exact_flights(problem, unknowns):
    """All flights of an orbit, the last one closing it."""
    values = exact_values(problem, unknowns[-1])
    d, gbar = exact_pair(values)
    places = {"B": d / 2, "T": -d / 2}
    walls = problem.word.walls
    rows = [unknowns[2 * k : 2 * k + 2] for k in range(len(walls))]
    rows.append([rows[0][0] + 2 * problem.word.period, rows[0][1]])
    flights = []
    for k, wall in enumerate(walls):
        r = values.get("r", values.get(f"r_{wall}"))
        ends = places[wall], places[walls[(k + 1) % len(walls)]]
        flights.append(exact_flight(r, gbar, *ends, *rows[k], *rows[k + 1]))
    return flights


def exact_return_map(flights):
    """Derivative of the return map, by impacts of non-zero velocity."""
    monodromy = mp.eye(2)
    for _, start, end in flights:
        monodromy = -(end**-1) * start * monodromy
    return monodromy


def exact_touch(problem, unknowns, flight, wall, time):
    """Displacement and velocity that vanish where a flight touches a wall at `time`."""
    values = exact_values(problem, unknowns[-1])
    d, gbar = exact_pair(values)
    places = {"B": d / 2, "T": -d / 2}
    left = problem.word.walls[flight]
    r = values.get("r", values.get(f"r_{left}"))
    start = unknowns[2 * flight : 2 * flight + 2]
    return exact_flight(r, gbar, places[left], places[wall], *start, time, mp.mpf(0))[0]


def exact_parameter(event):
    """The event's parameter from its own equations, solved at 40 digits from where it was found."""
    problem = event.point.evaluation.problem
    guess = [mp.mpf(z) for z in event.point.unknowns.tolist()]
    size = len(guess)
    if event.kind == "G":
        guess.append(mp.mpf(event.details["touch_time"]))

    def equations(*x):
        unknowns = list(x[:size])
        flights = exact_flights(problem, unknowns)
        residual = [equation for flight in flights for equation in flight[0]]
        if event.kind == "V":
            return [*residual, unknowns[2 * event.details["impact"] + 1]]
        if event.kind == "G":
            place = event.details["flight"], event.details["wall"]
            return [*residual, *exact_touch(problem, unknowns, *place, x[size])]
        target = {"FB": 1, "PD": -1}[event.kind]
        return [*residual, mp.det(exact_return_map(flights) - target * mp.eye(2))]

    return mp.findroot(equations, guess, solver="mdnewton", tol=mp.mpf(10) ** -60)[size - 1]


# Figures 7 and 8


def family(figure):
    if figure == 7:
        return ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34), "s", (0.08, 1.05)
    return ImpactPair(beta=math.pi / 6, r=0.25, s=0.5, A=7.2), "A", (1.4, 23.0)


@functools.cache
def figure_branch(figure, word):
    """Both walks from the main orbit of a word, with every kind of event on."""
    model, parameter, limits = family(figure)
    orbit = find_orbits(model, word, parameter=parameter)[0]
    return follow_both(orbit, limits)


def d_of(event):
    return event.point.evaluation.derived["d"]


CRITICAL = [
    (7, "1:1", "PD", 0.23850682149, True, True),
    (7, "1:1", "G", 0.20445492649, False, True),
    (7, "2:1", "FB", 0.22216730993, True, True),
    (7, "2:1", "G", 0.17369915135, True, True),
    (7, "2:1", "PD", 0.14022934446, True, False),
    (8, "1:1", "G", 0.21377314088, True, True),
    (8, "1:1", "PD", 0.19453108003, True, False),
    (8, "2:1", "FB", 0.22172669232, True, True),
    (8, "2:1", "PD", 0.12742085846, True, True),
    (8, "2:1", "G", 0.11477162872, False, True),
]
"""Figure, word, kind, d, stable up to the event, physical but for the event."""


@pytest.mark.parametrize(("figure", "word", "kind", "d", "stable", "physical"), CRITICAL)
def test_critical_lengths_of_figures_7_and_8(figure, word, kind, d, stable, physical):
    """Measured: 5e-12, half a unit of the last digit given."""
    found = events_of(figure_branch(figure, word), kind)
    event = min(found, key=lambda e: abs(d_of(e) - d))
    assert abs(d_of(event) - d) < 1e-11
    here = event.point.evaluation
    own = kind_of(kind).critical(here.multipliers)
    others = np.delete(here.multipliers, own)
    assert bool(np.all(np.abs(others) < 1.0)) == stable
    place = (event.details["flight"], event.details["wall"]) if kind == "G" else None
    assert here.judge(forgive_touches=[place]).physical == physical


@pytest.mark.parametrize(
    ("figure", "word", "kinds"),
    [
        (7, "1:1", {"FB": 1, "G": 1, "PD": 1, "V": 2}),
        (7, "2:1", {"FB": 1, "G": 1, "PD": 1, "V": 2}),
        (8, "1:1", {"FB": 1, "G": 1, "PD": 1, "V": 2}),
        (8, "2:1", {"FB": 1, "G": 1, "PD": 1, "V": 2}),
    ],
)
def test_nothing_else_is_found_in_figures_7_and_8(figure, word, kinds):
    found = [event.kind for event in events_of(figure_branch(figure, word))]
    assert {kind: found.count(kind) for kind in set(found)} == kinds


@pytest.mark.parametrize("figure", [7, 8])
@pytest.mark.parametrize("word", ["1:1", "2:1"])
@pytest.mark.quick(2)
def test_errors_of_located_parameters_are_honest(figure, word):
    """Against the same equations solved at 40 digits from the plain formulas.

    Measured: 20 events, true errors up to 2e-14 (at A = 18.7), at most 0.3 of the reported ones.
    """
    with mp.workdps(40):
        for event in events_of(figure_branch(figure, word)):
            true = abs(float(mp.mpf(event.parameter) - exact_parameter(event)))
            assert true <= 10.0 * event.error + 1e-14, event.kind
            assert event.error < 1e-12
            assert event.residual < 1e-14


@pytest.mark.parametrize("seed", [0, 2, 4])
@pytest.mark.full
def test_errors_are_honest_for_unequal_ends(seed):
    """r_B and r_T differ. Measured: true errors up to 2e-14, at most 0.25 of the reported ones."""
    model, parameter, limits = random_pair(seed)
    orbits = [o for word in ("1:1", "2:1") for o in find_orbits(model, word, parameter=parameter)]
    found = [event for orbit in orbits for event in events_of(follow_both(orbit, limits))]
    assert {"FB", "PD", "V"} <= {event.kind for event in found}
    with mp.workdps(40):
        for event in found:
            true = abs(float(mp.mpf(event.parameter) - exact_parameter(event)))
            assert true <= 10.0 * event.error + 1e-14, event.kind


@pytest.mark.parametrize(("figure", "d"), [(7, 0.20445492649), (8, 0.21377314088)])
def test_a_grazing_is_a_zero_velocity_of_the_longer_word(figure, d):
    (grazing,) = events_of(figure_branch(figure, "1:1"), "G")
    still = min(events_of(figure_branch(figure, "2:1"), "V"), key=lambda e: abs(d_of(e) - d))
    assert grazing.parameter == pytest.approx(still.parameter, rel=1e-14)
    touch = still.point.evaluation.problem.impacts(still.point.unknowns)[still.details["impact"]]
    difference = (grazing.details["touch_time"] - touch[0]) % 2.0
    assert min(difference, 2.0 - difference) < 1e-13


@pytest.mark.parametrize("parameter", ["beta", "r"])
@pytest.mark.parametrize(("kind", "length"), [("PD", 0.38314348834316), ("G", 0.32844164897267)])
def test_an_event_is_found_in_any_parameter(kind, length, parameter):
    """The lengths are those at which Fig. 7's 1:1 orbit meets the event at its own values."""
    own = {"beta": math.pi / 6, "r": 0.3}[parameter]
    model = ImpactPair(
        **{"beta": math.pi / 6, "r": 0.3, "A": 5.0, "s": length, parameter: 0.97 * own}
    )
    orbit = find_orbits(model, "1:1", parameter=parameter)[0]
    (event,) = events_of([follow(orbit, (0.9 * own, 1.03 * own), 1)], kind)
    # 14 digits of the length: measured 3e-13
    assert event.parameter == pytest.approx(own, abs=1e-12)


def test_a_zero_velocity_is_no_period_doubling():
    """Fig. 8, 2:1: at d = 0.0832 the trace of the return map has a pole and changes its sign."""
    walks = figure_branch(8, "2:1")
    (event,) = [e for e in events_of(walks) if abs(d_of(e) - 0.0832) < 1e-3]
    assert event.kind == "V"
    assert d_of(event) == pytest.approx(0.08321701538, abs=1e-11)
    assert event.details["impact"] == 1
    assert event.details["wall"] == "B"
    # traces on both sides are large and of opposite sign
    branch = next(w for w in walks if event in w.events)
    after = [p for p in branch.points if p.arclength > event.point.arclength]
    before = [p for p in branch.points if p.arclength < event.point.arclength]
    traces = [float(np.sum(p.evaluation.multipliers).real) for p in (before[-1], after[0])]
    assert traces[0] < -2.0
    assert traces[1] > 2.0
    # the branch goes on to the end of its range, unphysical for a reason that says why
    assert branch.end.kind is EndKind.RANGE
    assert branch.end.value == 23.0
    assert len(after) >= 3
    for point in after:
        verdict = point.evaluation.verdict
        assert not verdict.physical
        assert verdict.reason.startswith("impact 2 on wall B runs the wrong way: velocity -")


def test_effort_on_the_1_1_branch_of_figure_7():
    """Measured with all events on: 65 points in both directions, 2.5 iterations per point."""
    model, parameter, limits = family(7)
    orbit = find_orbits(model, "1:1", parameter=parameter)[0]
    walks = follow_both(orbit, limits, kinds=(*DETECTED, "UZ"))
    points = sum(len(w.points) for w in walks)
    assert points < 300
    assert sum(w.corrector_iterations for w in walks) <= 3 * points
    assert sum(w.rejected_steps for w in walks) <= 10
    assert [w.end.kind for w in walks] == [EndKind.RANGE, EndKind.RANGE]


def test_flights_evaluated_are_bounded():
    """Bare walk: two flights per residual, one residual per iteration and one per point."""
    model, parameter, limits = family(7)
    orbit = find_orbits(model, "1:1", parameter=parameter)[0]
    before = orbit.problem.kernel_evaluations
    found = walk(orbit.problem, orbit.unknowns, 1, parameter=parameter, limits=limits)
    spent = orbit.problem.kernel_evaluations - before
    tries = len(found.points) + found.rejected_steps + 1
    assert spent <= 2 * (found.corrector_iterations + tries)


def test_what_is_not_named_is_not_evaluated():
    """With V alone no second derivative is loaded.

    Motion kernels give the natural size of velocities, harmonics that of times.
    """
    model, parameter, limits = family(7)
    kernels = Kernels(model, parameter)
    orbit = find_orbits(model, "1:1", kernels=kernels)[0]
    follow(orbit, limits, -1, kinds=("V",))
    loaded = set(kernels.loaded + kernels.generated)
    flights = {"flight_B_T", "flight_T_B", "motion_B", "motion_T"}
    assert loaded == {"setup", "harmonics", *flights}


# Requested values


def test_requested_values_are_hit_exactly():
    model, parameter, limits = family(7)
    orbit = find_orbits(model, "1:1", parameter=parameter)[0]
    lengths = [0.2, 0.3, 1.0 / 3.0, 0.389, 0.9]
    capsules = [0.15, 0.2, 0.242, 0.5]
    walks = follow_both(orbit, limits, kinds=("UZ",), requested={"s": lengths, "d": capsules})
    found = events_of(walks)
    reached = {"s": [], "d": []}
    for event in found:
        ((name, wanted),) = event.details["requested"].items()
        value = event.parameter if name == "s" else d_of(event)
        assert abs(value - wanted) <= (0.0 if name == "s" else math.ulp(wanted))
        assert event.residual < 1e-15
        reached[name].append(wanted)
    # one way the branch goes to s = 0.08 directly, the other way round its fold at s = 0.991
    assert sorted(reached["s"]) == sorted([0.2, 0.3, 1.0 / 3.0, *lengths, 0.389, 0.9])
    assert sorted(reached["d"]) == sorted([0.15, 0.2, *capsules, 0.242, 0.5])


def test_requested_values_on_the_ends_of_the_range_are_hit():
    model, parameter, _ = family(7)
    orbit = find_orbits(model, "1:1", parameter=parameter)[0]
    requested = {"s": [0.2, 0.4]}
    walks = follow_both(orbit, (0.2, 0.4), kinds=("UZ",), requested=requested)
    assert [event.parameter for event in events_of(walks)] == [0.4, 0.2]
    assert [w.points[-1].parameter for w in walks] == [0.4, 0.2]


def test_requested_values_are_hit_in_any_parameter():
    model = ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.389)
    orbit = find_orbits(model, "1:1", parameter="beta")[0]
    wanted = {"beta": [0.6], "gbar": [0.1]}
    found = follow_both(orbit, (0.3, 0.9), kinds=("UZ",), requested=wanted)
    values = {next(iter(e.details["requested"])): e for e in events_of(found)}
    assert values["beta"].parameter == 0.6
    gbar = values["gbar"].point.evaluation.derived["gbar"]
    assert abs(gbar - 0.1) <= 2.0 * math.ulp(0.1)


@pytest.mark.parametrize("name", ["A", "r", "Gamma", "S", ""])
def test_values_of_what_does_not_vary_are_refused(name):
    model, parameter, _ = family(7)
    problem = OrbitProblem(model, Word("BT"), Kernels(model, parameter))
    with pytest.raises(InputError, match="accepted are s, d, gbar") as refused:
        test_functions(problem, ["UZ"], {name: [0.3]})
    assert refused.value.where == f"values.{name}"


def test_unknown_kinds_are_refused():
    model, parameter, _ = family(7)
    problem = OrbitProblem(model, Word("BT"), Kernels(model, parameter))
    with pytest.raises(InputError, match="no event kind 'SN'; accepted are FB, BP, PD, NS, G"):
        test_functions(problem, ["FB", "SN"], {})
    assert [test.kind for test in test_functions(problem, ["PD", "FB", "PD"], {})] == ["PD", "FB"]


# The symmetric pair


def symmetric_lengths(r):
    """d at the symmetry breaking and at the fold of the symmetric 1:1 orbit."""
    size = math.sqrt(4.0 * (1.0 + r) ** 2 + math.pi**2 * (1.0 - r) ** 2)
    breaking = 2.0 * (1.0 + r) / size * (0.5 - 2.0 / math.pi**2)
    return breaking, math.hypot((1.0 + r) / ((1.0 - r) * math.pi), 2.0 / math.pi**2)


def test_closed_forms_of_the_symmetric_pair():
    assert symmetric_lengths(0.3) == pytest.approx((0.2270368473, 0.6249148931), abs=5e-11)


@pytest.mark.parametrize("r", [0.05, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95])
@pytest.mark.quick(3)
def test_the_symmetric_orbit_folds_and_breaks_its_symmetry(r):
    """Measured: 2e-14 in d, at d = 12.4. The symmetric orbit never doubles its period."""
    breaking, fold = symmetric_lengths(r)
    model = ImpactPair(beta=0.0, r=r, A=5.0, s=0.5 * (breaking + fold) / D_PER_S)
    orbits = find_orbits(model, "1:1", parameter="s")
    symmetric = [o for o in orbits if abs(abs(o.times[1] - o.times[0]) - 1.0) < 1e-9]
    assert len(symmetric) == 2  # on both sides of the fold
    limits = (0.3 * breaking / D_PER_S, 1.2 * fold / D_PER_S)
    walks = follow_both(symmetric[0], limits)
    for point in (p for w in walks for p in w.points):
        (t_b, v_b), (t_t, v_t) = point.evaluation.problem.impacts(point.unknowns)
        assert abs(abs(t_t - t_b) - 1.0) < 1e-11
        assert abs(v_b + v_t) < 1e-11
    (at_fold,) = events_of(walks, "FB")
    (at_breaking,) = events_of(walks, "BP")
    assert abs(d_of(at_fold) - fold) < 1e-11
    assert abs(d_of(at_breaking) - breaking) < 1e-11
    for event, exact in ((at_fold, fold), (at_breaking, breaking)):
        assert abs(d_of(event) - exact) <= 10.0 * D_PER_S * event.error + 1e-14 * max(1.0, exact)
    assert events_of(walks, "PD") == []


@pytest.mark.parametrize("r", [0.15, 0.3, 0.6])
def test_symmetric_flights_graze_together(r):
    breaking, fold = symmetric_lengths(r)
    model = ImpactPair(beta=0.0, r=r, A=5.0, s=0.5 * (breaking + fold) / D_PER_S)
    orbits = find_orbits(model, "1:1", parameter="s")
    orbit = next(o for o in orbits if abs(abs(o.times[1] - o.times[0]) - 1.0) < 1e-9)
    one, other = events_of(
        follow_both(orbit, (0.1 * breaking / D_PER_S, 1.2 * fold / D_PER_S)), "G"
    )
    assert {one.details["wall"], other.details["wall"]} == {"B", "T"}
    assert abs(one.parameter - other.parameter) < 1e-13
    apart = abs(one.details["touch_time"] - other.details["touch_time"])
    assert apart == pytest.approx(1.0, abs=1e-9)


def test_the_velocity_of_the_symmetric_orbit_vanishes_at_two_over_pi_squared():
    """v = 2 sin(phi)/(pi (1 - r)) = 0 where d = -2 cos(phi)/pi^2: both impacts at once."""
    model = ImpactPair(beta=0.0, r=0.4, A=5.0, s=0.5)
    orbits = find_orbits(model, "1:1", parameter="s")
    orbit = next(o for o in orbits if abs(abs(o.times[1] - o.times[0]) - 1.0) < 1e-9)
    found = events_of(follow_both(orbit, (0.1, 2.0)), "V")
    assert sorted(event.details["impact"] for event in found) == [0, 1]
    assert [d_of(event) for event in found] == pytest.approx([2.0 / math.pi**2] * 2, abs=1e-14)


def test_an_asymmetric_branch_turns_at_the_branch_point_without_a_fold():
    """The orbit with broken symmetry goes through the branch point to its mirror image."""
    breaking, _ = symmetric_lengths(0.3)
    model = ImpactPair(beta=0.0, r=0.3, A=5.0, s=0.34)
    orbits = find_orbits(model, "1:1", parameter="s")
    broken = next(o for o in orbits if abs(abs(o.times[1] - o.times[0]) - 1.0) > 0.01)
    found = follow(broken, (0.2, 1.2), 1)
    (event,) = [e for e in found.events if e.kind in ("FB", "BP")]
    assert event.kind == "BP"
    assert abs(d_of(event) - breaking) < 1e-11


# The bouncing ball: the pair with one wall out of reach


def ball_thresholds(r, k):
    """Gamma = 1/gbar where an orbit with one impact in k periods is born and doubles."""
    born = k * math.pi * (1.0 - r) / (1.0 + r)
    return born, math.hypot(born, 2.0 * (1.0 + r * r) / (1.0 + r) ** 2)


def test_closed_forms_of_the_bouncing_ball():
    assert ball_thresholds(0.5, 1) == pytest.approx((1.0471975512, 1.5268237005), abs=5e-11)
    assert ball_thresholds(0.3, 1) == pytest.approx((1.6916268135, 2.1273336872), abs=5e-11)


@pytest.mark.parametrize("r", [0.1, 0.3, 0.5, 0.7, 0.9])
@pytest.mark.parametrize(("word", "k"), [("1:0", 1), ("B/2T", 2), ("B/3T", 3)])
@pytest.mark.quick(5)
def test_bouncing_ball(word, k, r):
    """Measured: 5e-15 in Gamma. The velocity is 2 k gbar/(1 + r) all along, to 6e-13."""
    born, doubled = ball_thresholds(r, k)
    weight = 0.1245 * 9.8
    model = ImpactPair(beta=math.pi / 2, r=r, A=0.5 * (born + doubled) * weight, s=200.0)
    orbits = find_orbits(model, word, parameter="A")
    assert len(orbits) == 2
    walks = follow_both(orbits[0], (0.5 * born * weight, 1.5 * doubled * weight))
    for kind, exact in (("FB", born), ("PD", doubled)):
        (event,) = events_of(walks, kind)
        gamma = 1.0 / event.point.evaluation.derived["gbar"]
        assert abs(gamma - exact) < 1e-12
        assert abs(gamma - exact) <= 10.0 * event.error / weight + 1e-14
    assert events_of(walks, "BP") == []
    for point in (p for w in walks for p in w.points):
        gbar = point.evaluation.derived["gbar"]
        assert point.unknowns[1] == pytest.approx(2.0 * k * gbar / (1.0 + r), rel=5e-12)


# The oscillator with a stop


def test_grazing_of_the_impact_demo():
    """COCO's impact demo: steady amplitude a/(c omega) reaches the stop at a = 0.1."""
    model = Oscillator(a=1.0, omega=1.0, c=0.1, k=1.0, sigma=1.0, r=0.8)
    (orbit,) = [o for o in find_orbits(model, "S", parameter="a") if o.velocities[0] > 0.0]
    assert orbit.velocities[0] == pytest.approx(1.6957329376, abs=1e-10)
    assert orbit.times[0] == pytest.approx(0.0759521649, abs=1e-10)
    (event,) = events_of(follow_both(orbit, (0.05, 2.0), kinds=("V",)))
    assert abs(event.parameter - 0.1) < 1e-15
    assert event.details == {"index": 0, "impact": 0, "wall": "S"}
    assert event.point.evaluation.judge(forgive_impacts={0}).physical


STOPS = [
    (0.357, 0.288, 0.61),
    (0.618, 0.095, 0.35),
    (0.741, 0.402, 0.82),
    (1.074, 0.051, 0.47),
    (1.403, 0.046, 0.23),
    (1.474, 0.585, 0.83),
    (1.033, 0.530, 0.25),
    (2.134, 0.525, 0.36),
    (1.479, 0.138, 0.43),
    (2.55, 0.31, 0.7),
]
"""omega, zeta, r: drawn at random."""


@pytest.mark.parametrize(("omega", "zeta", "r"), STOPS)
@pytest.mark.quick(3)
def test_the_steady_response_grazes_the_stop(omega, zeta, r):
    """sigma_G = 1/sqrt((1 - omega^2)^2 + (2 zeta omega)^2), measured to 3e-15."""
    grazing = 1.0 / math.hypot(1.0 - omega**2, 2.0 * zeta * omega)
    model = Oscillator(a=1.0, omega=omega, c=2.0 * zeta, k=1.0, sigma=0.6 * grazing, r=r)
    orbits = find_orbits(model, "S", parameter="sigma")
    limits = (-0.2 * grazing, 1.6 * grazing)
    found = [e for o in orbits for e in events_of(follow_both(o, limits, kinds=("V",)))]
    assert found
    for event in found:
        assert abs(event.parameter - grazing) <= 10.0 * event.error + 1e-14
        assert abs(event.parameter - grazing) < 1e-13 * max(1.0, grazing)


def neimark_sacker_at(r, omega):
    """The damping at which det = r^2 exp(-c T) = 1."""
    return math.log(r) * omega / math.pi


def stopped(omega, k, r, sigma, c):
    """The orbits with one impact per period."""
    model = Oscillator(a=1.0, omega=omega, c=c, k=k, sigma=sigma, r=r)
    return find_orbits(model, "S", parameter="c")


@pytest.mark.parametrize(
    ("omega", "k", "r", "sigma"),
    [
        (1.5, 1.0, 0.8, 0.0),
        (1.5, 1.0, 0.8, 0.3),
        (2.6, 1.0, 0.7, 0.0),
        (0.7, 1.0, 0.8, 0.1),
        (1.2, 4.0, 0.8, 0.3),
    ],
)
def test_neimark_sacker_under_negative_damping(omega, k, r, sigma):
    """The multipliers are complex, and on the unit circle where det = r^2 exp(-c T) = 1."""
    exact = neimark_sacker_at(r, omega)
    (test,) = test_functions(stopped(omega, k, r, sigma, exact)[0].problem, ["NS"], {})
    below, above = (stopped(omega, k, r, sigma, exact * (1.0 + e)) for e in (-1e-6, 1e-6))
    for one, other in zip(below, above, strict=True):
        (left,), (right,) = test.values(as_point(one)), test.values(as_point(other))
        assert 1e-9 < abs(left) < 1e-4
        assert right == pytest.approx(-left, rel=1e-4)
    for orbit in stopped(omega, k, r, sigma, exact):
        assert np.all(np.abs(orbit.multipliers.imag) > 0.1)
        # measured: 1e-15
        assert np.abs(orbit.multipliers) == pytest.approx([1.0, 1.0], abs=1e-14)
        assert orbit.stable
        assert test.accept(Event("NS", as_point(orbit), 0.0, 0.0, "bracket"))
        assert sorted(kind_of("NS").critical(orbit.multipliers)) == [0, 1]


@pytest.mark.parametrize(
    ("omega", "k", "r", "sigma"),
    [(1.5, 1.0, 0.8, 0.5), (3.7, 1.0, 0.8, 0.1), (2.6, 1.0, 0.7, 0.3), (1.2, 4.0, 0.8, 0.5)],
)
def test_neutral_saddles_are_no_neimark_sacker_points(omega, k, r, sigma):
    """Two real multipliers have the product one."""
    exact = neimark_sacker_at(r, omega)
    orbits = stopped(omega, k, r, sigma, exact)
    (test,) = test_functions(orbits[0].problem, ["NS"], {})
    saddles = [o for o in orbits if abs(o.multipliers[0]) > 2.0]
    assert saddles
    for orbit in saddles:
        assert float(np.prod(orbit.multipliers).real) == pytest.approx(1.0, abs=1e-12)
        assert not test.accept(Event("NS", as_point(orbit), 0.0, 0.0, "bracket"))


@pytest.mark.parametrize("word", ["1:1", "2:1"])
def test_the_impact_pair_has_no_neimark_sacker_points(word):
    """The multipliers' product is that of r^2, on both sides of a zero velocity too."""
    model, parameter, limits = family(7)
    orbit = find_orbits(model, word, parameter=parameter)[0]
    assert events_of(follow_both(orbit, limits, kinds=("NS",))) == []


def as_point(orbit):
    """An orbit as a point of a branch that nobody walked."""
    return Point(orbit.linearisation, np.zeros(len(orbit.unknowns)), 0.0, 0.0, 0)


# Steps do not decide what is found


def random_pair(seed):
    """A reproducible impact pair, a parameter to follow, and its range."""
    generator = np.random.default_rng(seed)
    beta, amplitude = generator.uniform(0.0, math.pi / 2), generator.uniform(3.0, 12.0)
    d = generator.uniform(0.15, 0.35)
    names = ("r",) if seed % 2 else ("r_B", "r_T")
    given = {name: float(generator.uniform(0.15, 0.8)) for name in names}
    parameter = ("s", "A")[generator.integers(2)]
    length = d * amplitude / (5.0 * D_PER_S)
    model = ImpactPair(beta=float(beta), A=float(amplitude), s=float(length), **given)
    value = model.values[parameter]
    return model, parameter, (value / 3.0, value * 3.0)


def found_with(orbit, limits, max_step):
    settings = Settings(max_step=max_step, step=min(0.01, max_step), max_points=20000)
    walks = follow_both(orbit, limits, settings=settings)
    return [sorted((e.kind, e.parameter) for e in w.events) for w in walks]


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.full
def test_long_and_short_steps_find_the_same_events(seed):
    """Measured: parameters agree to 7e-14."""
    model, parameter, limits = random_pair(seed)
    orbits = [o for word in ("1:1", "2:1") for o in find_orbits(model, word, parameter=parameter)]
    assert orbits
    for orbit in orbits:
        coarse, fine = (found_with(orbit, limits, step) for step in (0.05, 0.0025))
        for one, other in zip(coarse, fine, strict=True):
            assert [kind for kind, _ in one] == [kind for kind, _ in other]
            assert [value for _, value in one] == pytest.approx(
                [value for _, value in other], abs=1e-9
            )


BORN_WITHIN = [
    (
        "2:1",
        -1,
        6.889275299205,
        {
            "beta": 0.627228035555,
            "r_B": 0.203771196699,
            "r_T": 0.78035135754,
            "A": 9.45673211359,
            "s": 0.626391651064,
        },
    ),
    (
        "1:2",
        -1,
        3.347363740185,
        {"beta": 1.33792496019, "r": 0.266744925107, "A": 7.4428497746, "s": 0.545288534488},
    ),
]
"""Word, direction, amplitude of the grazing, model."""


@pytest.mark.parametrize(("word", "direction", "amplitude", "given"), BORN_WITHIN)
@pytest.mark.parametrize("max_step", [0.1, 0.05, 0.025])
@pytest.mark.quick(2)
def test_a_touch_that_is_born_and_grazes_within_one_step_is_found(
    word, direction, amplitude, given, max_step
):
    """The turning point of the flight exists at one end of the step only."""
    model = ImpactPair(**given)
    orbit = find_orbits(model, word, parameter="A")[0]
    limits = (model.values["A"] / 4.0, model.values["A"] * 4.0)
    found = follow(orbit, limits, direction, settings=Settings(max_step=max_step))
    (event,) = events_of([found], "G")
    assert event.parameter == pytest.approx(amplitude, abs=1e-11)


def test_impacts_that_merge_lose_their_velocities_with_their_flight():
    """T: a flight between two impacts on one wall vanishes, and with it both velocities."""
    model = ImpactPair(beta=1.0024748858, r=0.4793578221503404, A=11.9231379793, s=0.648717887772)
    orbit = find_orbits(model, "3:1", parameter="s")[0]
    found = follow(orbit, (0.6, 0.75), 1)
    merged = next(event for event in found.events if event.kind == "T")
    flight = merged.details["flight"]
    times = merged.point.evaluation.problem.impacts(merged.point.unknowns)[:, 0]
    assert times[flight + 1] == pytest.approx(times[flight], abs=1e-14)
    still = [
        e for e in found.events if e.kind == "V" and abs(e.parameter - merged.parameter) < 1e-9
    ]
    assert sorted(e.details["impact"] for e in still) == [flight, flight + 1]
    for event in still:
        assert abs(event.parameter - merged.parameter) < 1e-13
    after = next(p for p in found.points if p.arclength > merged.point.arclength + 1e-3)
    assert f"impact {flight} on wall B runs the wrong way" in after.evaluation.verdict.reason or (
        "out of order" in after.evaluation.verdict.reason
    )


def kicked_oscillator_stays_inside(laps, c, k):
    """Whether orbits of so many periods that begin where the oscillator's steady response touches
    its stop hit it once, from the transient of a small kick, summed over all earlier ones."""
    rate = math.sqrt(k - c * c / 4.0)
    begun = [2.0 * math.pi * lap for lap in range(400 * laps)]
    responses = [math.exp(-c * t / 2.0) * math.sin(rate * t) for t in begun]
    at_rest, *later = (math.fsum(responses[lap::laps]) for lap in range(laps))
    return all(response > at_rest for response in later)


@pytest.mark.quick(5)
@pytest.mark.parametrize("laps", [2, 4, 3, 8, 1, 5, 6, 7])
@pytest.mark.parametrize("k", [0.3721, 0.02, 2.2, 0.15])
def test_orbits_of_several_periods_are_born_physical_or_as_ghosts(k, laps):
    """All of them have a V where the response grazes, at which the orbit itself passes nothing;
    beside it most hit too late, on both sides."""
    c = 0.1
    grazing = 1.0 / math.hypot(k - 1.0, c)
    model = Oscillator(a=1.0, omega=1.0, c=c, k=k, sigma=0.9 * grazing, r=0.8)
    orbits = find_orbits(model, f"S/{laps}T" if laps > 1 else "S", parameter="sigma")
    limits = (0.3 * grazing, 1.5 * grazing)
    branches = (
        continue_orbit(orbit, "sigma", limits, events=["V"], unphysical=True) for orbit in orbits
    )
    event = next(event for branch in branches for event in branch.events)
    assert event.value == pytest.approx(grazing, rel=1e-14)
    assert event.physical == kicked_oscillator_stays_inside(laps, c, k)
    if not event.physical:
        assert event.ghost
        assert "passes wall S" in event.reason
        assert "impact 1 on wall S runs the wrong way" in event.reason
