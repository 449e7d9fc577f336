"""Branch points and near misses: an unfolded crossing is none, and its branches stay apart.

A level capsule with equal ends has pitchforks. An inclination or unequal ends of size e unfold
them, nu in proportion to e: what is connected to what, and the fold on one side, are the same for
all e of one sign. The reference is a walk where the branches are far apart.
"""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from contimpact.bifurcations import extended_system
from contimpact.bifurcations.extended_system import solve
from contimpact.bifurcations.fold import Fold
from contimpact.bifurcations.kind import test_functions as functions
from contimpact.continuation.branch import EndKind, Event, Point
from contimpact.continuation.settings import Settings
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.diagrams.orbit_walks import walk_both_ways
from contimpact.orbits.search import find_orbits, solve_near
from contimpact.systems.impact_pair import ImpactPair

FAR = 2e-4
"""An unfolding at which branches are seen to be apart by any walk."""


def level(**given):
    return ImpactPair(**({"beta": 0.0, "r_B": 0.3, "r_T": 0.3, "A": 5.0, "s": 0.4} | given))


def unfolded(model, how, size):
    if how == "beta":
        return model.replace(beta=size)
    return model.replace(r_T=model.values["r_T"] * (1.0 + size))


def branches(model, word="1:1", limits=(0.3, 1.2), events=("FB", "BP")):
    """The branches of all orbits of a word at the start, each once."""
    found = []
    for orbit in find_orbits(model, word, parameter="s", rng=1):
        branch = continue_orbit(
            orbit, range=limits, events=events, settings=Settings(max_points=6000)
        )
        if not any(joins_the_same(branch, other, 1e-6) for other in found):
            found.append(branch)
    return found


def ends_of(branch):
    return [
        np.concatenate([[branch["s"][row]], branch.velocities[row], branch.times[row]])
        for row in (0, -1)
    ]


def close(one, other, tolerance):
    apart = one - other
    times = slice(1 + len(apart) // 2, None)
    apart[times] -= 2.0 * np.round(apart[times] / 2.0)
    return np.max(np.abs(apart)) < tolerance


def joins_the_same(one, other, tolerance=0.05):
    """Whether two branches lead from the same orbit to the same orbit."""
    (a, b), (c, d) = ends_of(one), ends_of(other)
    straight = close(a, c, tolerance) and close(b, d, tolerance)
    return straight or (close(a, d, tolerance) and close(b, c, tolerance))


def kinds_of(branch):
    return {end.kind for end in branch.ends}


def check(model, how, sizes, word="1:1", limits=(0.3, 1.2)):
    """No BP but within the error of nu, and each branch as far away; returns counts.

    A walk may pass the place where branches come as near as rounding, if it says so.
    """
    counts = {"right": 0, "ended": 0, "within the error": 0, "passed": 0, "near misses": 0}
    reference = {
        sign: branches(unfolded(model, how, sign * FAR), word, limits) for sign in (-1.0, 1.0)
    }
    for size in sizes:
        for branch in branches(unfolded(model, how, size), word, limits):
            found = [e for e in branch.events if e.kind == "BP"]
            counts["near misses"] += len(branch.notes)
            if found:
                assert abs(size) < 1e-12
                assert all(abs(e.nu) <= e.nu_error < 1e-13 for e in found)
                counts["within the error"] += 1
            elif EndKind.NEAR_MISS in kinds_of(branch):
                assert abs(size) < 1e-11
                counts["ended"] += 1
            elif branch.missed:
                assert abs(size) < 1e-12
                assert "changes from" in repr(branch)
                counts["passed"] += 1
            else:
                assert kinds_of(branch) <= {EndKind.RANGE, EndKind.CLOSED}
                assert any(joins_the_same(branch, r) for r in reference[np.sign(size)]), size
                counts["right"] += 1
    return counts


@pytest.mark.parametrize("how", ["beta", "r_T"])
@pytest.mark.full
def test_an_unfolded_pitchfork_is_no_branch_point(how, kernel_cache):
    sizes = [sign * 10.0**-k for k in (5, 8, 11, 12) for sign in (-1.0, 1.0)]
    counts = check(level(), how, sizes)
    assert counts["right"] == len(sizes)
    assert counts["near misses"] == len(sizes)


@pytest.mark.parametrize("how", ["beta", "r_T"])
@pytest.mark.full
def test_a_walk_ends_and_says_so_where_nu_is_hardly_more_than_its_error(how, kernel_cache):
    """There no residual may tell the branches apart: nu is 9e-15, and its error 5e-15."""
    counts = check(level(), how, [-1e-13, 1e-13])
    assert counts["right"] + counts["ended"] == counts["near misses"] >= 2


@pytest.mark.full
def test_the_user_is_told_of_a_near_miss(kernel_cache):
    (branch,) = branches(level(beta=1e-12))
    (note,) = branch.notes
    # a pitchfork at s = 0.364717826975, where beta is zero
    assert note.startswith("another branch passes at s = 0.364717826975 at a distance of 5.")
    assert re.search(r"e-07 \(nu = -?9", note), "its sign is that of psi, which has none"
    assert "e-14 +- " in note
    assert f"note: {note}" in repr(branch)


def test_an_unfolding_below_the_error_of_nu_is_a_branch_point_and_says_so(kernel_cache):
    for branch in branches(level(beta=1e-14)):
        (entry,) = [e for e in branch.events if e.kind == "BP"]
        assert abs(entry.nu) <= entry.nu_error < 1e-13
        assert entry.value == pytest.approx(0.364717826975, abs=1e-12)


@pytest.mark.parametrize("size", [1e-13, 1e-10, 1e-7])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.full
def test_the_fold_beside_an_unfolded_pitchfork(size, sign, kernel_cache):
    """It is real, and moves away with the power 2/3 of the unfolding."""
    folds = []
    for beta in (size, 1e-4 if size == 1e-7 else 1e3 * size):
        found = branches(level(beta=sign * beta, s=0.35), limits=(0.32, 0.4))
        folds += [e.value for b in found for e in b.events if e.kind == "FB"]
        assert not [e for b in found for e in b.events if e.kind == "BP"]
    near, far = (0.364717826974541 - value for value in folds)
    power = math.log(far / near) / math.log(1e3)
    assert power == pytest.approx(2.0 / 3.0, abs=0.02)


@pytest.mark.full
def test_an_exact_pitchfork_has_no_fold(kernel_cache):
    """An arm stands upright at the branch point: a zero of the fold's function, but no fold."""
    rng = np.random.default_rng(3)
    passed = 0
    for _ in range(6):
        model = level(s=1.0, r_B=(r := rng.uniform(0.1, 0.8)), r_T=r, A=rng.uniform(3.0, 8.0))
        for orbit in find_orbits(model.replace(s=0.35), "1:1", parameter="s"):
            tests = functions(orbit.problem, ["FB", "BP"], {})
            run = walk_both_ways(orbit.problem, orbit.unknowns, (0.1, 1.2), tests, Settings())
            points = [e.parameter for e in run.events if e.kind == "BP"]
            passed += len(points)
            for event in run.events:
                if event.kind == "FB":
                    assert all(abs(event.parameter - value) > 1e-6 for value in points)
    assert passed >= 6


def test_a_fold_is_accepted_without_solving_for_a_crossing(monkeypatch, kernel_cache):
    """A step of Newton's iteration tells that none is near."""
    solved = []

    def counted(system, *args):
        solved.append(type(system))
        return solve(system, *args)

    monkeypatch.setattr(extended_system, "solve", counted)
    inclined = ImpactPair(beta=math.pi / 6.0, r=0.3, A=5.0, s=0.34)
    (orbit,) = find_orbits(inclined, "2:1", parameter="s")[:1]
    tests = functions(orbit.problem, ["FB"], {})
    run = walk_both_ways(orbit.problem, orbit.unknowns, (0.25, 0.42), tests, Settings())
    assert [event.parameter for event in run.events] == pytest.approx([0.356895277], abs=1e-9)
    assert extended_system.Crossing not in solved


@pytest.mark.parametrize("off", [1e-10, 1e-8])
def test_a_zero_found_badly_beside_a_pitchfork_is_no_fold(off, kernel_cache):
    """The fold's equations are singular there, and solved to 1e-9 or so of the parameter."""
    orbit = next(o for o in find_orbits(level(s=0.364), "1:1", parameter="s") if lopsided(o))
    problem, tests = orbit.problem, functions(orbit.problem, ["BP"], {})
    run = walk_both_ways(problem, orbit.unknowns, (0.363, 0.37), tests, Settings())
    centre = next(e.point.unknowns for e in run.events if e.kind == "BP")
    away = problem.difference(orbit.unknowns, centre)
    guess = centre + away * math.sqrt(off / -away[-1])  # the arm is a parabola
    guess[-1] = centre[-1] - off
    here = solve_near(problem, guess)
    assert np.max(np.abs(problem.difference(here.unknowns, centre))) > 0.3 * math.sqrt(off)
    found = Event("FB", Point(here, away, 0.0, 0.0, 0), 1e-11, 1e-9, "newton", {})
    assert not Fold().accept(found)


def lopsided(orbit):
    return abs(np.diff(orbit.times)[0] - 1.0) > 1e-6


def asymmetry(branch):
    apart = np.abs(branch.times[:, 1] - branch.times[:, 0])
    return np.abs(apart - np.round(apart))


def check_near(model, value, part):
    """Starts on both sides of a pitchfork, in a range much smaller than a step is long otherwise.

    The branches stand side by side there, and a step could change from one to the other.
    """
    limits = (value * (1.0 - part), value * (1.0 + part))
    seen = set()
    for side in (-0.5, 0.5):
        at = model.replace(s=value * (1.0 + side * part))
        for orbit in find_orbits(at, "1:1", parameter="s", rng=1):
            branch = continue_orbit(
                orbit, range=limits, events=("FB", "BP"), settings=Settings(max_points=6000)
            )
            met = [e for e in branch.events if abs(e.value - value) < 1e-10]
            if lopsided(orbit):
                assert np.sum(asymmetry(branch) < 1e-6) <= 1
                assert EndKind.SYMMETRIC in kinds_of(branch)
                assert [e.kind for e in met] == ["BP"]
            else:
                assert np.all(asymmetry(branch) < 1e-6)
                assert {e.kind for e in met} <= {"BP"}
            seen.add((lopsided(orbit), bool(met)))
    assert seen >= {(True, True), (False, True)}


@pytest.mark.parametrize("part", [0.3, 1e-2, 1e-3])
@pytest.mark.quick(1)
def test_a_step_changes_to_no_other_branch_at_a_pitchfork(part, kernel_cache):
    check_near(level(), 0.364717826974541, part)


@pytest.mark.slow
def test_random_pitchforks_in_narrow_ranges(kernel_cache):
    rng, count = np.random.default_rng(5), 0
    for _ in range(20):
        r, amplitude = rng.uniform(0.05, 0.9), rng.uniform(2.0, 9.0)
        model = level(r_B=r, r_T=r, A=amplitude, s=1.0)
        s = 0.25 * amplitude * math.pi**2 / (model.values["M"] * model.values["omega"] ** 2)
        for branch in branches(model.replace(s=s), "1:1", (0.4 * s, 2.2 * s)):
            for event in branch.events:
                if event.kind == "BP":
                    count += 1
                    check_near(model, event.value, 10.0 ** rng.uniform(-3.0, -1.0))
    assert count > 10


@pytest.mark.slow
def test_random_unfoldings(kernel_cache):
    """Measured: 534 right, 42 within the error of nu, 1 passed, and 274 notes of near misses."""
    rng = np.random.default_rng(11)
    total = {}
    for _ in range(60):
        r, amplitude = rng.uniform(0.05, 0.9), rng.uniform(2.0, 9.0)
        model = level(r_B=r, r_T=r, A=amplitude, s=1.0)
        values = model.values
        s = rng.uniform(0.12, 0.4) * amplitude * math.pi**2 / (values["M"] * values["omega"] ** 2)
        model, limits = model.replace(s=s), (0.4 * s, 2.2 * s)
        word = str(rng.choice(["1:1", "2:2"]))
        exact = branches(model, word, limits)
        assert not [note for branch in exact for note in branch.notes]
        for how in ("beta", "r_T"):
            sizes = rng.choice([-1.0, 1.0], 4) * 10.0 ** rng.uniform(-14.0, -5.0, 4)
            for name, count in check(model, how, sizes, word, limits).items():
                total[name] = total.get(name, 0) + count
    assert total["near misses"] > 100
    assert total["right"] > 10 * (total["ended"] + total["within the error"] + total["passed"])
