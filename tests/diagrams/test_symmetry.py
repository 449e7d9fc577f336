"""Branches that run into their own image, and loops: each orbit once, and no false loop."""

from __future__ import annotations

import math

import numpy as np
import pytest
from algebraic import Algebraic
from algebraic import follow as follow_curve
from zoo import scene

from contimpact.continuation.branch import EndKind
from contimpact.diagrams.explore import follow
from contimpact.diagrams.orbit_branch import continue_born, continue_orbit
from contimpact.orbits.search import find_orbits
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.soft_stop import SoftStop

DOUBLING = 0.383143488343165
"""Where 1:1 doubles its period at beta = pi/6, r = 0.3, A = 5."""


def level(**given):
    return ImpactPair(**({"beta": 0.0, "r": 0.3, "A": 5.0, "s": 0.35} | given))


def each_once(branch):
    values = sorted((e.kind, round(e.value, 9), e.flight or 0, e.wall or "") for e in branch.events)
    return len(set(values)) == len(values)


@pytest.mark.parametrize("s", [0.3825, 0.38, 0.35])
@pytest.mark.parametrize("events", [("PD", "G"), ("FB", "BP", "PD", "G")])
@pytest.mark.quick(3)
def test_a_doubled_orbit_ends_where_it_becomes_the_single_one(pair, s, events):
    orbit = find_orbits(pair(s=s), "1:1/2T", parameter="s")[0]
    branch = continue_orbit(orbit, range=(0.3, 0.45), events=events)
    (end,) = (e for e in branch.ends if e.kind is EndKind.SHORTER)
    assert end.value == pytest.approx(DOUBLING, abs=1e-12)
    assert end.message.startswith("became 1:1, run 2 times, at s = 0.3831434883")
    assert {e.kind for e in branch.ends} == {EndKind.SHORTER, EndKind.RANGE}
    assert branch["s"].max() == pytest.approx(DOUBLING, abs=1e-12)
    assert each_once(branch)
    assert {e.kind for e in branch.events} <= set(events)
    (grazing,) = (e for e in branch.events if e.kind == "G")
    assert grazing.value == pytest.approx(0.365318559016631, abs=1e-12)


@pytest.mark.full
def test_a_scene_says_what_a_doubled_orbit_became():
    options = {"switch": [], "depth": 0, "range": [0.3, 0.45]}
    at = {"parameters": {"beta": "pi/6", "r": 0.3, "A": 5.0, "s": 0.38}}
    alone = follow(scene(model=at, follow=options | {"orbits": ["1:1/2T"]}))
    assert {e.kind for e in alone.branches[0].ends} == {EndKind.SHORTER, EndKind.RANGE}
    both = follow(scene(model=at, follow=options | {"orbits": ["1:1", "1:1/2T"]}))
    single = next(b for b in both.branches if b.notation == "1:1")
    doubled = [b for b in both.branches if b.notation == "1:1/2T"]
    assert len(doubled) == 1
    (met,) = (e for e in doubled[0].ends if e.kind is EndKind.KNOWN)
    assert met.message.startswith(f"met branch {single.id} at s = 0.38314348")
    assert all(each_once(b) for b in both.branches)


@pytest.mark.full
def test_a_doubled_orbit_of_a_soft_stop_ends_where_all_its_contacts_come_to_rest():
    """There the motion without contact, of a known amplitude, reaches the stop."""
    model = SoftStop(a=1.0, omega=2.07, c=0.15, k=1.0, e=0.3, k_b=30.0, c_b=0.5)
    orbit = next(o for o in find_orbits(model, "CR", parameter="omega") if o.physical)
    single = continue_orbit(orbit, range=(2.06, 2.1), events=["PD"])
    (doubling,) = single.events
    doubled = continue_born(doubling, model, (2.06, 2.1), events=["FB", "PD", "V"])
    assert [e.kind for e in doubled.ends] == [EndKind.BORN, EndKind.SHORTER]
    omega = doubled.ends[1].value
    assert math.hypot(1.0 - omega**2, 0.15 * omega) == pytest.approx(1.0 / 0.3, abs=1e-9)
    assert doubled.missed == []
    assert each_once(doubled)


def test_a_born_branch_ends_where_it_falls_back():
    """Followed in r at beta = pi/3, A = 3.89, 1:1 doubles twice: one bubble joins both events."""
    model = ImpactPair(beta=math.pi / 3, r=0.2, A=1.55625 / 0.4, s=0.5)
    orbit = next(o for o in find_orbits(model, "1:1", parameter="r") if o.physical)
    single = continue_orbit(orbit, range=(0.05, 0.9), events=["PD"])
    first, second = (e for e in single.events if e.kind == "PD")
    bubble = continue_born(first, model, (0.05, 0.9), events=["FB", "PD"])
    assert [e.kind for e in bubble.ends] == [EndKind.BORN, EndKind.SHORTER]
    assert bubble.ends[1].value == pytest.approx(second.value, abs=1e-9)
    assert each_once(bubble)


def test_an_asymmetric_orbit_ends_where_it_becomes_symmetric():
    found = find_orbits(level(), "1:1", parameter="s")
    lopsided = [o for o in found if abs(np.diff(o.times)[0] - 1.0) > 1e-3]
    assert len(lopsided) == 2
    branches = [continue_orbit(o, range=(0.3, 0.5), events=("FB", "BP", "G")) for o in lopsided]
    for branch in branches:
        (end,) = (e for e in branch.ends if e.kind is EndKind.SYMMETRIC)
        assert end.value == pytest.approx(0.364717826974541, abs=1e-12)
        assert branch["s"].max() == pytest.approx(end.value, abs=1e-12)
        assert each_once(branch)
    values = [[e.value for e in b.events] for b in branches]
    np.testing.assert_allclose(*map(sorted, values), rtol=0, atol=1e-12)


def test_a_branch_born_at_a_pitchfork_is_followed_one_way():
    model = level(s=0.4)
    orbit = next(o for o in find_orbits(model, "1:1", parameter="s") if o.physical)
    single = continue_orbit(orbit, range=(0.3, 1.2), events=["BP"])
    (point,) = single.events
    assert abs(point.nu) <= point.nu_error < 1e-13
    born = continue_born(point, model, (0.3, 1.2), events=("FB", "BP", "G"))
    assert [e.kind for e in born.ends] == [EndKind.BORN, EndKind.RANGE]
    told = f"born at {point.id} of branch {point.branch} at s = "
    assert born.ends[0].message.startswith(told)
    assert born.ends[0].message.endswith("the mirror images of its orbits follow")
    assert each_once(born)


# Loops among images, by curves with known images.


def imaged(problem, *images):
    """The same problem, where (x, y, p) stands for its images, given as signs of x and y, too."""

    class Imaged(Algebraic):
        def difference(self, one, other):
            gaps = [one - other * [*signs, 1.0] for signs in ((1.0,) * (len(one) - 1), *images)]
            return min(gaps, key=np.linalg.norm)

    return Imaged(problem.equations, problem.derivatives)


def turned_circle():
    """x = cos u, y = sin u, p = 0.8 cos 2u: the image under (x, y) -> -(x, y) is half a turn on."""
    return Algebraic(
        lambda x, y, p: [x * x + y * y - 1.0, p - 0.8 * (x * x - y * y)],
        lambda x, y, p: [[2.0 * x, 2.0 * y, 0.0], [-1.6 * x, 1.6 * y, 1.0]],
    )


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.full
def test_random_loops_close_where_they_do_and_nowhere_else(seed, direction):
    """A reflection turns the way back: a whole turn. Half a turn on, the same comes again."""
    rng, u = np.random.default_rng(seed), 0.0
    while min(abs(math.sin(2.0 * u)), abs(math.cos(2.0 * u))) < 0.02:
        u = rng.uniform(0.0, 2.0 * math.pi)
    start = [math.cos(u), math.sin(u), 0.8 * math.cos(2.0 * u)]
    whole = follow_curve(turned_circle(), start, direction)
    for images, part in [([], 1.0), ([(-1, 1)], 1.0), ([(1, -1)], 1.0), ([(-1, -1)], 0.5)]:
        found = follow_curve(imaged(turned_circle(), *images), start, direction)
        assert found.end.kind is EndKind.CLOSED
        share = found.points[-1].arclength / whole.points[-1].arclength
        assert share == pytest.approx(part, rel=5e-3), images


@pytest.mark.parametrize("seed", [0, 1, 2, 4, 5, 6])
@pytest.mark.quick(1)
def test_random_doubled_orbits_make_no_false_loop(pair, seed):
    """No orbit twice on a branch, however it is shifted, and none of a shorter period but at ends.

    Between two points at which a branch passes one value, the orbits differ.
    """
    rng = np.random.default_rng(seed)
    model = pair(beta=rng.uniform(0.0, 1.5), r=rng.uniform(0.05, 0.9), A=rng.uniform(3.0, 7.0))
    s = rng.uniform(0.2, 0.6)
    found = find_orbits(model.replace(s=s), "1:1/2T", parameter="s", rng=seed)
    assert found
    for orbit in found:
        branch = continue_orbit(orbit, range=(0.1, 1.0), events=("FB", "PD", "G"))
        assert each_once(branch)
        later = branch.times[:, 2:] - branch.times[:, :2] - 2.0
        apart = np.max(np.abs(np.hstack([later, np.diff(branch.velocities[:, ::2])])), axis=1)
        assert np.all(apart[1:-1] > 1e-7)


@pytest.mark.parametrize("kind", ["FB", "BP", "G", "V"])
def test_events_on_the_limit_of_a_range_are_found_from_their_orbits(kind):
    """The range is cut in two at the event; its parts have all that the whole has."""
    asked = ("FB", "BP", "PD", "G", "V")
    orbit = find_orbits(level(s=0.5), "1:1", parameter="s")[0]
    whole = continue_orbit(orbit, range=(0.1, 1.5), events=asked)
    event = next(e for e in whole.events if e.kind == kind)
    number = sum(e.kind == kind and abs(e.value - event.value) < 1e-12 for e in whole.events)
    parts = [
        continue_orbit(event, range=limits, events=asked)
        for limits in ((0.1, event.value), (event.value, 1.5))
    ]
    for branch in parts:
        assert {e.kind for e in branch.ends} == {EndKind.RANGE}
    here = [[e for e in b.events if e.kind == kind] for b in parts]
    at = [[e for e in some if abs(e.value - event.value) < 1e-12] for some in here]
    # the branch does not leave the fold upwards
    assert [len(some) for some in at] == [number, 0 if kind == "FB" else number]
