"""Margins in parameters, against branches, curves, many digits, and orbits followed all around."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from zoo import TWO_MASSES

import contimpact as ci
from contimpact.accuracy.reference import Reference
from contimpact.orbits.problem import OrbitProblem
from contimpact.orbits.search import solve_near
from contimpact.results.branch import details_of
from contimpact.segments.kernels import Kernels

TOLERANCES = {"r": 0.01, "s": 0.005, "A": 0.1}


def stable(word, s, beta=math.pi / 6, r=0.3):
    pair = ci.ImpactPair(beta=beta, r=r, A=5.0, s=s)
    return next(o for o in ci.find_orbits(pair, word, parameter="s") if o.stable and o.physical)


def followed(orbit, direction, distance, steps=40):
    """Whether the orbit is observable all along a line, in even steps; None where it is lost."""
    names = list(TOLERANCES)
    problem = OrbitProblem(orbit.model, orbit.word, Kernels(orbit.model, *names))
    begin, n = np.array([orbit[name] for name in names]), problem.n
    z, before = np.append(orbit.unknowns[:n], begin), None
    for step in np.linspace(0.0, distance, steps + 1)[1:]:
        guess = z.copy() if before is None else 2.0 * z - before
        guess[n:] = begin + step * direction * np.array(list(TOLERANCES.values()))
        here = solve_near(problem, guess)
        if here is None or np.max(np.abs(here.unknowns - guess)) > 0.1:
            return None
        if here.n_unstable or not here.verdict.physical:
            return False
        z, before = here.unknowns, z
    return True


CASES = [("1:1", 0.45, "PD"), ("2:1", 0.34, "FB"), ("2:1", 0.315, "G[2:1->3:1]")]


@pytest.fixture(scope="module")
def margins():
    found = {}
    for word, s, label in CASES:
        found[label] = ci.find_margins(stable(word, s), TOLERANCES)
    return found


@pytest.mark.parametrize(
    ("label", "count"),
    [
        *(pytest.param(label, 15, marks=pytest.mark.full) for _, _, label in CASES),
        *(pytest.param(label, 1000, marks=pytest.mark.slow) for _, _, label in CASES),
    ],
)
def test_nothing_is_crossed_within_the_margin(margins, label, count):
    found = margins[label]
    assert found.nearest.label == label
    assert found.notes == ()
    around = np.random.default_rng(3).normal(size=(count, 3))
    around /= np.linalg.norm(around, axis=1)[:, None]
    nearest = np.array(list(found.nearest.direction.values()))
    for direction in (nearest, *around):
        assert followed(found.orbit, direction, 0.999 * found.nearest.distance)
    assert not followed(found.orbit, nearest, 1.001 * found.nearest.distance)


@pytest.mark.parametrize("label", [label for _, _, label in CASES])
@pytest.mark.full
def test_distances_are_nearest_on_their_surfaces(margins, label):
    """At each event: the multiplier or the gap, and the direction at right angles to its surface,
    whose slopes the event's sensitivities are."""
    for event in margins[label].events:
        orbit, center = event.orbit, margins[label].orbit
        moved = {n: (orbit[n] - center[n]) / w for n, w in TOLERANCES.items()}
        assert math.hypot(*moved.values()) == pytest.approx(event.distance, rel=1e-12)
        for name, part in event.direction.items():
            assert moved[name] == pytest.approx(part * event.distance, abs=1e-9)
        if event.kind == "G":
            assert abs(orbit.smallest_gap) < 1e-12
        else:
            target = {"FB": 1.0, "PD": -1.0}[event.kind]
            assert np.min(np.abs(orbit.multipliers - target)) < 1e-7
        (entry,) = (
            e
            for e in ci.continue_orbit(orbit, "s", (orbit["s"] - 1e-3, orbit["s"] + 1e-3)).events
            if e.kind == event.kind and abs(e.value - orbit["s"]) < 1e-8
        )
        scaled = {n: ci.sensitivity(entry, n) * w for n, w in TOLERANCES.items() if n != "s"}
        normal = np.array([-scaled["r"], TOLERANCES["s"], -scaled["A"]])
        normal /= np.linalg.norm(normal)
        assert abs(normal @ list(event.direction.values())) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.full
def test_of_one_parameter_it_is_the_branchs_event():
    orbit = stable("1:1", 0.45)
    branch = ci.continue_orbit(orbit, "s", range=(0.2, 1.05))
    expected = sorted(abs(e.value - 0.45) / 0.005 for e in branch.events if not e.ghost)
    found = ci.find_margins(orbit, {"s": 0.005}, within=200.0)
    assert [event.distance for event in found.events] == pytest.approx(expected, rel=1e-10)
    assert "PD at distance 13.37" in repr(found)
    assert "no event within 2" in repr(ci.find_margins(orbit, {"s": 0.005}, within=2.0))


@pytest.mark.full
@pytest.mark.parametrize(
    ("word", "s", "r", "label"),
    [
        ("1:1", 0.45, 0.3, "PD"),
        ("1:1", 0.4, 0.15, "G[1:1->2:1]"),
        ("2:1", 0.32, 0.35, "FB"),
        ("2:1", 0.3, 0.3, "G[2:1->3:1]"),
    ],
)
def test_distances_are_those_to_curves(word, s, r, label):
    """The curve begins at the event of a run in s, and is a polynomial through seven rows where it
    is nearest."""
    tolerances, orbit = {"s": 0.01, "r": 0.02}, stable(word, s, r=r)
    nearest = ci.find_margins(orbit, tolerances, within=10.0).nearest
    assert nearest.label == label
    branch = ci.continue_orbit(orbit, "s", range=(s - 0.2, s + 0.2), events=["FB", "PD", "G"])
    event = min((e for e in branch.events if e.label == label), key=lambda e: abs(e.value - s))
    across = sorted((r, nearest.parameters["r"]))
    ranges = (s - 0.2, s + 0.2), (across[0] - 0.02, across[1] + 0.02)
    fine = ci.Settings(step=0.005, max_step=0.01)
    curve = ci.follow_curve(event, None, "r", *ranges, detect=False, settings=fine)
    y = np.column_stack([(curve[n] - orbit[n]) / w for n, w in tolerances.items()])
    at = int(np.argmin(np.sum(y**2, axis=1)))
    rows = slice(at - 3, at + 4)
    t = curve["arclength"][rows] - curve["arclength"][at]
    squared = sum(np.polynomial.Polynomial.fit(t, y[rows, i], 6) ** 2 for i in (0, 1))
    found = minimize_scalar(squared, bounds=(t[2], t[4]), method="bounded", options={"xatol": 1e-9})
    assert math.sqrt(found.fun) == pytest.approx(nearest.distance, rel=1e-9)


@pytest.fixture(scope="module")
def entries():
    found = {}
    for word, kinds in (("2:1", ["FB", "G"]), ("1:1", ["PD"])):
        branch = ci.continue_orbit(
            stable(word, 0.34 if kinds[0] == "FB" else 0.45), "s", range=(0.25, 0.5), events=kinds
        )
        found |= {event.kind: event for event in branch.events if not event.ghost}
    return found


@pytest.mark.parametrize("kind", ["FB", "PD", "G"])
@pytest.mark.parametrize("parameter", ["r", "A"])
@pytest.mark.full
def test_sensitivities_of_events_and_margins_in_thirty_digits(entries, kind, parameter):
    entry, values = entries[kind], []
    orbit = entry.orbit()
    low, high = (orbit[parameter] + step for step in (-1e-9, 1e-9))
    for value in (low, high):
        model = orbit.model.replace(**{parameter: value})
        problem = OrbitProblem(model, orbit.word, Kernels(model, "s"))
        reference = Reference(problem, 30)
        values.append(reference.event(kind, orbit.unknowns, details_of(entry)).parameter)
    expected = float((values[1] - values[0]) / (reference.ctx.mpf(high) - reference.ctx.mpf(low)))
    assert ci.sensitivity(entry, parameter) == pytest.approx(expected, rel=1e-10)
    word, s = ("1:1", 0.45) if kind == "PD" else ("2:1", 0.315 if kind == "G" else 0.34)
    found = ci.find_margins(stable(word, s), {"s": 0.001})
    (event,) = (event for event in found.events if event.kind == kind)
    side = math.copysign(1000.0, entry.value - s)
    assert event.sensitivity(parameter) == pytest.approx(side * expected, rel=1e-10)


@pytest.mark.parametrize("parameter", ["r", "s", "beta"])
@pytest.mark.full
def test_sensitivities_of_margins_against_differences(parameter):
    """Measured: 5e-9."""
    given, distances = {"beta": math.pi / 6, "r": 0.3, "s": 0.34}, []
    for step in (-1e-4, 1e-4):
        orbit = stable("2:1", **{**given, parameter: given[parameter] + step})
        distances.append(ci.find_margins(orbit, TOLERANCES, within=5.0).nearest.distance)
    nearest = ci.find_margins(stable("2:1", **given), TOLERANCES, within=5.0).nearest
    expected = (distances[1] - distances[0]) / 2e-4
    assert nearest.sensitivity(parameter) == pytest.approx(expected, rel=1e-5)


@pytest.mark.full
def test_of_symmetric_orbits_and_of_several_coordinates():
    """A pitchfork is a BP; a model that ends ends no orbit, and is noted if it is nearer."""
    symmetric = ci.find_margins(stable("1:1", 0.5, beta=0.0, r=0.5), {"s": 0.01, "A": 0.1})
    assert symmetric.nearest.label == "BP"
    multipliers = symmetric.nearest.orbit.multipliers
    assert np.min(np.abs(multipliers - 1.0)) < 1e-7
    model = ci.TwoMasses(**TWO_MASSES)
    orbit = next(o for o in ci.find_orbits(model, "A", parameter="omega") if o.stable)
    found = ci.find_margins(orbit, {"omega": 0.01, "r": 0.005}, within=45.0)
    assert found.nearest.label == "PD"
    assert found.notes == ()
    (note,) = ci.find_margins(orbit, {"r": 0.005}, within=45.0).notes
    assert note.startswith("lost at distance 40, r = 0.99999")
    assert "at no event found: the model ends (r: the restitution is 1.0000" in note


@pytest.mark.full
def test_at_a_neimark_sacker_bifurcation():
    """Negative damping: the nearest point of r^2 exp(-c T) = 1, that is c = ln(r) omega/pi."""
    omega, r = 1.5, 0.8
    c = 0.9 * math.log(r) * omega / math.pi
    model = ci.Oscillator(a=1.0, omega=omega, c=c, k=1.0, sigma=0.0, r=r)
    orbit = next(o for o in ci.find_orbits(model, "S", parameter="c") if o.stable and o.physical)

    def distance(there):
        return math.hypot((math.log(there) * omega / math.pi - c) / 0.01, (there - r) / 0.02)

    found = ci.find_margins(orbit, {"c": 0.01, "r": 0.02}, within=3.0)
    expected = minimize_scalar(distance, (0.78, 0.82), tol=1e-12).fun
    assert found.nearest.label == "NS"
    assert found.nearest.distance == pytest.approx(expected, rel=1e-9)
    assert not found.notes


def test_where_the_model_ends_nothing_bifurcates():
    """At r = 1 all pairs are on the unit circle; the 1:1 is stable up to there."""
    orbit = stable("1:1", 0.45)
    found = ci.find_margins(orbit, {"r": 0.01})
    assert "NS" not in [event.label for event in found.events]
    branch = ci.continue_orbit(stable("1:1", 0.45), "r", range=(0.02, 0.999))
    expected = [abs(e.value - 0.3) / 0.01 for e in branch.events if not e.ghost]
    assert [e.distance for e in found.events] == pytest.approx(sorted(expected), rel=1e-9)


@pytest.mark.slow
def test_where_a_motion_decays_too_often_to_be_followed_the_model_ends():
    """A load that vanishes ten tolerances away: its circuit's rate 1/(R C) becomes infinite."""
    model = {
        "system": "hybrid",
        "period": "2*pi/w",
        "parameters": {"R": 1e5, "w": 240.0, "s": 4e-4},
        "modes": {
            "free": {"x": "v", "v": "6*cos(w*t) - 5*v - 35000*x - V/10", "V": "3e4*v - 25e6*V/R"}
        },
        "guards": {"S": {"within": "x <= s", "set": {"v": "-0.65*v"}}},
    }
    follow = {"parameter": "w", "range": [200.0, 300.0], "orbits": ["1"]}
    scene = ci.read_scene({"name": "harvester", "model": model, "follow": follow})
    found = ci.find_orbits(scene.model, "1", parameter="w")
    orbit = next(o for o in found if o.stable and o.physical)
    margins = ci.find_margins(orbit, {"w": "2%", "R": "10%"})
    branch = ci.continue_orbit(orbit, range=(200.0, 300.0), events=["FB"])
    fold = next(e.value for e in branch.events if e.value > 240.0)
    assert margins.nearest.kind == "FB"
    assert margins.nearest.distance <= (fold - 240.0) / 4.8


@pytest.mark.slow
def test_isolines_of_a_margin():
    """Along the curve a search that begins anew finds the same event at the same distance."""
    orbit, tolerances = stable("1:1", 0.45), {"s": 0.005, "r": 0.01}
    event = ci.find_margins(orbit, tolerances).nearest
    ranges = [(0.44, 0.46), (4.95, 5.05)]
    curve = ci.follow_isoline(orbit, lambda o: event.of(o).distance, second="A", ranges=ranges)
    assert {curve["A"][0], curve["A"][-1]} == {4.95, 5.05}
    for row in (0, -1):
        model = orbit.model.replace(s=float(curve["s"][row]), A=float(curve["A"][row]))
        there = next(o for o in ci.find_orbits(model, "1:1") if o.stable and o.physical)
        nearest = ci.find_margins(there, tolerances).nearest
        assert nearest.label == event.label
        assert nearest.distance == pytest.approx(event.distance, rel=1e-9)
    with pytest.raises(ci.InputError, match="is not found from it"):
        event.of(stable("2:1", 0.34))


def test_refusals():
    orbit = stable("1:1", 0.45)
    other = next(
        o
        for o in ci.find_orbits(orbit.model, "1:1", parameter="s")
        if not (o.stable and o.physical)
    )
    for wrong, given, said in [
        (orbit, {}, "positive tolerances"),
        (orbit, {"r": 0.0}, "tolerances.r: found 0.0; give a positive number"),
        (orbit, {"r": "-1%"}, "tolerances.r: found '-1%'"),
        (orbit, {"r": math.nan}, "tolerances.r: found nan"),
        (orbit, {"r": [1]}, "tolerances.r"),
        (orbit, {"q": 0.1}, "has no parameter 'q'"),
        (other, {"r": 0.1}, "stable physical"),
    ]:
        with pytest.raises(ci.InputError, match=said):
            ci.find_margins(wrong, given)
    with pytest.raises(ci.InputError, match="within"):
        ci.find_margins(orbit, {"r": 0.1}, within=0.0)
    with pytest.raises(ci.InputError, match="has no parameter 'q'"):
        ci.find_margins(orbit, {"s": 0.005}).nearest.sensitivity("q")
    level = next(o for o in ci.find_orbits(orbit.model.replace(beta=0.0), "1:1") if o.stable)
    with pytest.raises(ci.InputError, match="beta 0; give positive tolerances"):
        ci.find_margins(level, {"s": "5%", "beta": "5%"})


@pytest.mark.full
def test_no_warning_where_a_contact_vanishes():
    """A search that leads to contacts of zero duration ends without a word."""
    model = ci.SoftPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.4158, k=500.0)
    orbit = next(o for o in ci.find_orbits(model, "BbTt", parameter="s") if o.physical)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = ci.find_margins(orbit, {"s": "1%"}, within=30.0)
    assert found.nearest.label == "PD"
    assert found.nearest.parameters["s"] == pytest.approx(0.34853, abs=5e-6)


def test_tolerances_as_parts_of_values():
    """As in scenes."""
    orbit = stable("1:1", 0.45)
    one, other = (ci.find_margins(orbit, {"s": given}).nearest for given in ("2%", 0.009))
    assert one.distance == pytest.approx(other.distance, rel=1e-12)


@pytest.mark.full
def test_where_a_surface_is_strongly_bent():
    """Followed on a line alone, this orbit doubles its period at distance 9.12642."""
    pair = ci.ImpactPair(beta=0.906520231911, r=0.841152690237, A=5.0, s=0.296314738867)
    orbit = next(o for o in ci.find_orbits(pair, "2:1", parameter="s") if o.stable and o.physical)
    nearest = ci.find_margins(orbit, TOLERANCES).nearest
    assert nearest.label == "PD"
    assert nearest.distance < 9.12642


@pytest.mark.full
def test_events_of_another_orbit_nearby_do_not_count():
    """Beyond its fold, the unstable orbit loses an impact nearer to the stable one than that."""
    pair = ci.ImpactPair(beta=0.26096942801, r=0.125515386551, A=5.0, s=0.364351616005)
    orbit = next(o for o in ci.find_orbits(pair, "2:1", parameter="s") if o.stable and o.physical)
    assert ci.find_margins(orbit, TOLERANCES | {"beta": 0.02}).nearest.label == "FB"


@pytest.mark.full
def test_the_margin_of_an_orbit_right_beside_a_fold():
    """Rounding of the parameter is a larger part of a small distance than what settles a search."""
    pair = ci.ImpactPair(beta=math.pi / 6, r=0.3, A=5.0, s=0.34)
    orbit = next(o for o in ci.find_orbits(pair, "2:1", parameter="s") if o.stable and o.physical)
    fold = 0.356895277000131
    away = [1e-6, 1e-7, 1e-8]
    values = {"s": [fold - distance for distance in away]}
    branch = ci.continue_orbit(orbit, "s", range=(0.3, 0.4), events=["FB"], values=values)
    beside = [e.orbit() for e in branch.events if e.kind == "UZ" and e.stable]
    assert len(beside) == len(away)
    for near in beside:
        nearest = ci.find_margins(near, {"s": 0.007}).nearest
        assert nearest.kind == "FB"
        assert 0.007 * nearest.distance == pytest.approx(fold - near.parameters["s"], abs=1e-13)


@pytest.mark.parametrize(("length", "time"), [(1e3, 1.0), (1.0, 1e-6), (1e6, 1e-6)])
def test_margins_are_the_same_in_any_units(length, time):
    """Searches took residuals as they were, and lost the fold, or both events, without a word."""
    sizes = {"a": length / time**2, "omega": 1.0 / time, "sigma": length, "r": 1.0}
    given = {"a": 0.5, "omega": 1.7, "sigma": 0.1, "r": 0.8}
    values = {name: value * sizes[name] for name, value in given.items()}
    model = ci.Oscillator(c=0.2 / time, k=1.0 / time**2, **values)
    orbit = next(o for o in ci.find_orbits(model, "1", parameter="omega") if o.stable)
    steps = {"a": 0.05, "omega": 0.02, "r": 0.05, "sigma": 0.05}
    found = ci.find_margins(orbit, {n: s * sizes[n] for n, s in steps.items()}, within=20.0)
    assert [event.label for event in found.events] == ["G[1->2]", "FB"]
    distances = [event.distance for event in found.events]
    assert distances == pytest.approx([4.693830643, 4.740965717], abs=1e-8)


@pytest.mark.parametrize("within", [5.0, 10.0, 20.0])
def test_a_doubled_orbit_has_a_margin_from_where_it_is_born(within):
    """Beyond, lines went on along the single orbit; its doubling is known in closed form."""
    ball = ci.BouncingBall(a=0.002997, omega=60.0, r=0.8, g=9.81)
    orbits = ci.find_orbits(ball, "1/2T", parameter="a")
    doubled = next(o for o in orbits if o.stable)
    nearest = ci.find_margins(doubled, {"a": 2e-4, "r": 0.02}, within).nearest
    assert nearest.label == "BP"
    r = nearest.orbit["r"]
    squares = (math.pi * (1 - r) / (1 + r)) ** 2 + (2 * (1 + r * r) / (1 + r) ** 2) ** 2
    assert nearest.orbit["Gamma"] ** 2 == pytest.approx(squares, rel=1e-12)
    assert nearest.distance < 0.4
