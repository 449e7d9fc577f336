"""Contacts that begin or vanish at once, as a symmetry makes them.

An oscillator between two equal soft stops, x'' + c x' + x = a cos(w t), with the stiffness k more
beyond -e and e. Its symmetric orbit grazes both at one frequency, below which it has two contacts
on each side.
"""

import pytest

import contimpact as ci

GRAZING = 0.535269694797674
"""From the flights of half a period by SciPy's `solve_ivp`, solved by `fsolve` for time and
velocity at the stop, and the frequency."""


def beyond(side):
    return {"x": "v", "v": f"F - k*(x {side} e)"}


MODEL = {
    "system": "hybrid",
    "period": "2*pi/w",
    "parameters": {"a": 1.0, "w": 0.537, "c": 0.1, "k": 10.0, "e": 0.5},
    "define": {"F": "a*cos(w*t) - c*v - x"},
    "modes": {"free": {"x": "v", "v": "F"}, "right": beyond("-"), "left": beyond("+")},
    "guards": {
        "A": {"mode": "free", "within": "x <= e", "to": "right"},
        "B": {"mode": "right", "within": "x >= e", "to": "free"},
        "C": {"mode": "free", "within": "x >= -e", "to": "left"},
        "D": {"mode": "left", "within": "x <= -e", "to": "free"},
    },
}


def followed(word, start, **follow):
    model = MODEL | {"parameters": MODEL["parameters"] | {"w": start}}
    given = {"parameter": "w", "range": [0.53, 0.61], "orbits": [word], "switch": ["G", "V"]}
    scene = {"name": "both", "model": model, "follow": given | follow}
    return ci.follow(ci.read_scene(scene))


@pytest.fixture(scope="module")
def diagram():
    return followed("ABCD", 0.537)


def test_a_grazing_of_both_stops_adds_a_contact_to_each(diagram):
    grazings = [e for e in diagram.entries if e.branch == "b1" and e.kind == "G"]
    assert [e.label for e in grazings] == 2 * ["G[ABCD->ABABCDCD]"]
    assert [e.value for e in grazings] == pytest.approx(2 * [GRAZING], abs=1e-12)
    assert [e.opens for e in grazings] == 2 * [("b2",)]
    assert [e.criticality for e in grazings] == 2 * ["supercritical"]
    assert diagram["b2"]["w"][0] == pytest.approx(GRAZING, abs=1e-12)


def test_the_motion_settles_on_the_branch_born_there(diagram):
    orbit = diagram["b2"].orbit(-1)
    assert orbit.value == 0.53
    assert orbit.stable
    assert orbit.physical
    simulator = ci.Simulator(orbit.model)
    found = ci.settle(simulator, simulator.start(0.0, [0.1], [0.2]))
    assert sorted(abs(found.velocities)) == pytest.approx(sorted(abs(orbit.velocities)), abs=1e-9)


def test_contacts_that_vanish_at_once_lead_back():
    back = followed("ABABCDCD", 0.53)
    vanishing = [e for e in back.entries if e.branch == "b1" and e.kind == "V"]
    assert [e.label for e in vanishing] == 2 * ["V[ABABCDCD->ABCD]"]
    assert [e.value for e in vanishing] == pytest.approx(2 * [GRAZING], abs=1e-10)
    assert [e.ghost for e in vanishing] == [False, False]
    assert [e.opens for e in vanishing] == 2 * [("b2",)]
    assert back["b2"].notation == "ABCD"
