"""T: impacts on different coordinates exchange their order, and the motion continues."""

import math

import numpy as np
import pytest

import contimpact as ci
from contimpact.bifurcations.declarations import usual_events
from contimpact.diagrams.explore import follow
from contimpact.orbits.search import find_orbits
from contimpact.results.scene import read_scene
from contimpact.systems.impact_pair import ImpactPair
from contimpact.systems.two_masses import TwoMasses

R, E1, E2, K1, K2 = 0.7, 0.1, 0.4, 0.5, 0.8


def pair(walls, resets=(), orbits=("0",), values=(), at=1.796, limits=(1.795, 1.804), **follow):
    """Two bodies that know nothing of each other, with their walls: letter, body, side, place."""
    guards = {
        name: {
            "within": f"x{body} {side} {place}",
            "set": {f"v{body}": f"-{R}*v{body}", **dict(resets).get(name, {})},
        }
        for name, body, side, place in walls
    }
    laws = {
        "x1": "v1",
        "v1": f"cos(omega*t) - {K1}*x1",
        "x2": "v2",
        "v2": f"cos(omega*t) - {K2}*x2",
    }
    model = {
        "system": "hybrid",
        "period": "2*pi/omega",
        "parameters": {"omega": at, **dict(values)},
    }
    model |= {"modes": {"flight": laws}, "guards": guards}
    table = {"parameter": "omega", "range": list(limits), "orbits": list(orbits), **follow}
    asked = {"detect": {"events": ["T"]}, "numerics": {"starts": 24, "rounds": 8}}
    return read_scene(
        {"name": "two", "model": model, "follow": table, "plot": {"formats": []}, **asked}
    )


def phase(omega, stiffness, place):
    """The phase of the impact on a wall of x'' + kx = cos(omega t), one a period; closed form."""
    own, P = math.sqrt(stiffness), 1.0 / (stiffness - omega**2)
    turn = own * 2.0 * math.pi / omega
    sine = -(1.0 - R) / (2.0 * P * omega)  # sin(phase) and cos(phase) by the velocity
    cosine = (1.0 + R) * math.sin(turn) / (2.0 * own * (1.0 - math.cos(turn)) * P), place / P
    a, b, c = sine**2 + cosine[0] ** 2, 2 * cosine[0] * cosine[1], cosine[1] ** 2 - 1.0
    v = (-b + math.sqrt(b * b - 4.0 * a * c)) / (2.0 * a)
    return math.atan2(sine * v, cosine[0] * v + cosine[1])


def meeting(low, high):
    """The frequency at which both bodies hit at once, by bisection."""

    def apart(omega):
        return math.sin(phase(omega, K1, E1) - phase(omega, K2, E2))

    assert apart(low) * apart(high) < 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if apart(low) * apart(middle) > 0.0 else (low, middle)
    return low


def physical(model, word, starts=32):
    return next(o for o in find_orbits(model, word, starts=starts, rounds=3) if o.physical)


@pytest.fixture(scope="module")
def diagram():
    return follow(pair([("A", 1, "<=", E1), ("B", 2, "<=", E2)], orbits=["AB"]))


def test_the_motion_continues_with_its_impacts_exchanged(diagram):
    there = meeting(1.79, 1.804)
    event, back = [e for branch in diagram.branches for e in branch.events if e.physical]
    assert event.label == "T[AB->BA]"
    assert back.label == "T[BA->AB]"  # the same orbit, seen from the branch born there
    assert back.branch in event.opens
    assert back.opens == (event.branch,)
    assert back.value == pytest.approx(there, rel=1e-13)
    assert event.becomes == "BA"
    assert event.value == pytest.approx(there, rel=1e-13)
    (born,) = event.opens
    assert diagram[born].word == "BA"
    assert diagram[born].origin == event.id
    assert diagram.statistics["notes"] == []


@pytest.mark.parametrize("off", [0.0, 1e-11])
def test_a_scene_that_starts_at_the_exchange_has_the_motion_on_both_sides(off):
    """There the flight between the impacts has no duration: both orders were left out."""
    there = meeting(1.79, 1.804)
    walls = [("A", 1, "<=", E1), ("B", 2, "<=", E2)]
    found = follow(pair(walls, orbits=["AB", "BA"], at=there + off))
    stable = sorted(
        (i.low, i.high) for branch in found.branches for i in ci.stable_intervals(branch)
    )
    assert stable == [(1.795, pytest.approx(there)), (pytest.approx(there), 1.804)]
    events = [e for e in found.entries if e.physical]
    assert [e.label for e in events] == ["T[AB->BA]"] * 2
    assert [e.opens for e in events] == [(e.branch,) for e in reversed(events)]
    assert found.statistics["notes"] == []


@pytest.mark.full
def test_a_curve_marks_where_impacts_exchange_their_order():
    """Beyond, the orbits that double their period have impacts out of order."""
    walls, places = [("A", 1, "<=", E1), ("B", 2, "<=", "e")], {"e": E2}
    model = pair(walls, orbits=["AB"], values=places).model
    branch = ci.continue_orbit(physical(model, "AB"), range=(1.79, 1.82), events=["PD"])
    curve = ci.follow_curve(branch.events[-1], model, "e", (1.8, 2.2), (0.15, 0.402))
    (point,) = curve.points
    assert (point.kind, curve.missed) == ("PD-T", [])
    omega, place = point.parameters["omega"], point.parameters["e"]
    apart = phase(omega, K1, E1) - phase(omega, K2, place)
    assert math.sin(apart) == pytest.approx(0.0, abs=1e-9)
    ordered = curve["e"] < place
    assert (curve["physical"][ordered] == 1).all()
    assert (curve["physical"][curve["e"] > place] == 0).all()


def test_contacts_are_found_where_they_vanish():
    """At omega = sqrt(k + a/e) undamped motion grazes: C and R are at once there, at rest, and
    Newton's steps are halved."""
    stop = ci.SoftStop(a=1.0, omega=math.sqrt(3.0), c=0.0, k=1.0, e=0.5, k_b=0.2, c_b=0.0)
    resting, other = sorted(find_orbits(stop, "CR", starts=16), key=lambda o: abs(o.velocities[0]))
    assert np.ptp(resting.times) < 1e-6
    assert np.ptp(other.times) > 0.1
    (v,) = (
        e for e in ci.continue_orbit(resting, "omega", range=(1.72, 1.74)).events if e.kind == "V"
    )
    assert v.value == pytest.approx(math.sqrt(3.0), abs=1e-9)
    assert v.physical


def test_machines_of_more_than_two_guards_are_followed_where_they_are_physical():
    """And drawn so; from three guards on words have letters."""
    walls = [("A", 1, "<=", E1), ("B", 2, "<=", E2)]
    two, three = pair(walls), pair([*walls, ("C", 2, ">=", -9)])
    assert [(s.unphysical, s.plot.unphysical) for s in (two, three)] == [
        (True, "period-1"),
        (False, "none"),
    ]
    assert three.resolved()["follow"]["unphysical"] is False
    assert pair([*walls, ("C", 2, ">=", -9)], unphysical=True).unphysical


def test_no_hole_is_left_in_what_is_stable(diagram):
    stable = sorted(
        (i.low, i.high) for branch in diagram.branches for i in ci.stable_intervals(branch)
    )
    there = meeting(1.79, 1.804)
    assert stable == [(1.795, pytest.approx(there)), (pytest.approx(there), 1.804)]


def test_beyond_both_bodies_keep_to_their_own_motion(diagram):
    beyond = diagram[next(b.id for b in diagram.branches if b.word == "BA")]
    orbit = ci.continue_orbit((beyond, 0), range=(1.795, 1.804), events=[])
    row = orbit["omega"].tolist().index(1.804)
    first, second = orbit["t1"][row] * 1.804, orbit["t2"][row] * 1.804
    assert math.sin(first - phase(1.804, K2, E2)) == pytest.approx(0.0, abs=1e-12)
    assert math.sin(second - phase(1.804, K1, E1)) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.full
def test_a_scene_that_does_not_switch_at_it_is_told_what_is_left(diagram):
    walls = [("A", 1, "<=", E1), ("B", 2, "<=", E2)]
    left = follow(pair(walls, orbits=["AB"], switch=[]))
    assert len(left.branches) == len(diagram.branches) - 1
    (note,) = left.statistics["notes"]
    assert note.endswith(
        "the motion continues as BA, which was not followed: add T to follow.switch"
    )


@pytest.mark.parametrize(
    ("kind", "words", "beyond"), [("V", ["CR"], "0"), ("G", ["0"], "CR")], ids=["V", "G"]
)
@pytest.mark.full
def test_a_motion_that_begins_or_ceases_to_touch_a_soft_stop_continues(kind, words, beyond):
    """Grazing at a cos(omega t)/(k - omega^2) = e, undamped: omega = sqrt(k + a/e) = sqrt(3)."""
    values = {"a": 1.0, "omega": 1.7, "c": 0.0, "k": 1.0, "e": 0.5, "k_b": 0.2, "c_b": 0.0}
    given = {
        "name": "soft",
        "model": {"system": "soft-stop", "parameters": values},
        "follow": {"parameter": "omega", "range": [1.69, 1.76], "orbits": words},
        "numerics": {"starts": 16},
    }
    follow_table = given["follow"]
    if kind == "G":
        values["omega"] = 1.75
    (note,) = (n for n in follow(read_scene(given)).statistics["notes"] if "continues" in n)
    assert note.endswith(
        f"the motion continues as {beyond}, which was not followed: add {kind} to follow.switch"
    )
    follow_table["switch"] = [kind]
    found = follow(read_scene(given))
    assert not any("continues" in n for n in found.statistics["notes"])
    (event,) = (e for e in found.entries if e.kind == kind and e.opens and e.physical)
    assert event.value == pytest.approx(math.sqrt(3.0), abs=1e-9)


@pytest.mark.full
def test_margins_are_those_to_the_meeting():
    model = pair([("A", 1, "<=", E1), ("B", 2, "<=", E2)], orbits=["AB"]).model
    orbit = physical(model.replace(omega=1.796), "AB")
    nearest = ci.find_margins(orbit, {"omega": 1e-3}, within=5.0).nearest
    assert nearest.label == "T[AB->BA]"
    assert nearest.distance == pytest.approx((meeting(1.795, 1.804) - 1.796) / 1e-3, rel=1e-9)


@pytest.mark.full
def test_it_is_no_switch_and_counts_for_no_depth():
    walls = [("A", 1, "<=", E1), ("B", 2, "<=", E2)]
    found = follow(pair(walls, orbits=["AB"], depth=0))
    assert [b.word for b in found.branches if b.origin] == ["BA"]


@pytest.mark.full
def test_the_order_decides_what_follows_where_resets_do_not_commute():
    resets = {"A": {"v2": "v2 - 0.3*v1"}, "B": {"v1": "v1 - 0.2*v2"}}
    walls = [("A", 1, "<=", E1), ("B", 2, "<=", E2)]
    model = pair(walls, resets, ["AB"]).model
    found = [
        e
        for orbit in find_orbits(model, "AB", starts=32, rounds=3)
        for e in ci.continue_orbit(orbit, range=(1.2, 2.4), events=["T"]).events
    ]
    met = [e for e in found if e.becomes]
    assert met
    assert all(ci.continue_born(e, range=(1.2, 2.4)) is None for e in met)


@pytest.mark.full
def test_letters_are_those_of_the_mode_beyond():
    """A stop of the second body is K while the first is in contact with its spring, and S else."""
    free = {"x1": "v1", "v1": "cos(omega*t) - 0.5*x1", "x2": "v2", "v2": "cos(omega*t) - 0.8*x2"}
    model = {
        "system": "hybrid",
        "period": "2*pi/omega",
        "parameters": {"omega": 1.8, "e": 0.1, "g": 0.4},
        "modes": {"free": free, "contact": free | {"v1": f"{free['v1']} - 40*(x1 - e) - v1"}},
        "guards": {
            "C": {"mode": "free", "within": "x1 <= e", "to": "contact"},
            "R": {"mode": "contact", "within": "x1 >= e", "to": "free"},
            "S": {"mode": "free", "within": "x2 <= g", "set": {"v2": "-0.7*v2"}},
            "K": {"mode": "contact", "within": "x2 <= g", "set": {"v2": "-0.7*v2"}},
        },
    }
    follow = {"parameter": "omega", "range": [1.7, 2.0], "orbits": ["CKR"]}
    model = read_scene({"name": "soft", "model": model, "follow": follow}).model
    orbits = physical(model, "CKR"), physical(model.replace(omega=1.76), "SCR")
    one, other = (ci.continue_orbit(o, range=(1.7, 2.0), events=["T"]) for o in orbits)
    (left,) = [e for e in one.events if e.physical]
    (right,) = [e for e in other.events if e.physical]
    assert (left.label, right.label) == ("~T[CKR->SCR]", "~T[SCR->CKR]")  # both are unstable
    assert left.value == pytest.approx(right.value, rel=1e-12)


@pytest.mark.full
def test_pairs_of_impacts_exchange_at_one_time_where_a_motion_is_symmetric():
    walls = [
        ("L", 1, "<=", "e1"),
        ("R", 1, ">=", "-e1"),
        ("M", 2, "<=", "e2"),
        ("N", 2, ">=", "-e2"),
    ]
    model = pair(walls, values={"e1": 0.6, "e2": 0.6}, at=1.6, limits=(1.5, 1.7)).model
    found = ci.find_orbits(model, "MLNR", parameter="e2", starts=24, rounds=2)
    orbit = next(o for o in found if o.stable and o.physical)
    before = ci.continue_orbit(orbit, range=(0.55, 1.2), events=["T"])
    one, other = [e for e in before.events if e.physical]
    assert one.label == other.label == "T[MLNR->LMRN]"
    assert one.value == pytest.approx(other.value, rel=1e-12)
    beyond = ci.continue_born(one, range=(0.55, 1.2))
    for branch, physical_there in ((before, [1, 0]), (beyond, [0, 1])):
        at = [one.value - 0.02, one.value + 0.02]
        rows = [np.argmin(np.abs(branch["e2"] - value)) for value in at]
        assert branch["physical"][rows].tolist() == physical_there


def test_tori_are_looked_for_where_they_can_be():
    assert usual_events(
        TwoMasses(c1=0.1, c2=0.05, k1=1, k2=1, a1=1, omega=1.8, sigma_1=1, sigma_2=1, r=0.8)
    ) == ("FB", "BP", "PD", "NS", "G", "V", "T")
    assert "NS" not in usual_events(ImpactPair(beta=0.5, s=0.3, r=0.3, A=5.0))
    scene = pair([("A", 1, "<=", E1), ("B", 2, "<=", E2)], orbits=["AB"]).resolved()
    assert scene["follow"]["switch"] == ["T"]


@pytest.mark.parametrize("unit", [1.0, 1e-5])
def test_the_error_of_an_exchange_does_not_depend_on_the_unit_of_time(unit):
    """The boost converter's clock and limit at once: rounding of the largest rate, in amperes a
    second, was added to that of times, and the error was 1e-6 where it is 1e-11."""
    rates = {"s": "1/T", "i": "2/T", "u": "-u/2.4/T"}
    model = {
        "system": "hybrid",
        "period": "T",
        "parameters": {"I": 2.7, "T": unit},
        "modes": {"on": rates, "off": rates | {"i": "2*(1 - u)/T", "u": "(i/1.2 - u/2.4)/T"}},
        "guards": {
            "O": {"mode": "on", "within": "i <= I", "to": "off"},
            "K": {"mode": "off", "within": "s <= 1", "to": "on", "set": {"s": 0}},
        },
    }
    asked = {"parameter": "I", "range": [2.6, 2.85], "orbits": ["OKOK"]}
    scene = ci.read_scene({"name": "boost", "model": model, "follow": asked})
    orbits = ci.find_orbits(scene.model, "OKOK", parameter="I", starts=64)
    branches = [ci.continue_orbit(o, "I", (2.6, 2.85), events=["T"]) for o in orbits]
    found = [event for branch in branches for event in branch.events]
    assert found
    assert all(event.error < 1e-10 for event in found)
