"""The four sliding bifurcations, on a body on a belt, against an integration of its position.

At omega = 0.5 all of them lie on one way in the amplitude a, each where the orbit before it ends to
be physical and the next one begins.
"""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve

import contimpact as ci
from contimpact.bifurcations.kind import kind_of
from contimpact.continuation.settings import Settings
from contimpact.models.guards import Word
from contimpact.results.diagram import event_of
from contimpact.simulation.simulator import Simulator
from contimpact.systems.belt import Belt

VALUES = {"a": 0.6, "omega": 0.5, "c": 0.1, "V": 0.1, "mu_0": 0.5}
EVENTS = ["FB", "PD", "G", "V", "T"]
STEPS = Settings(step=7.3e-4)
TIGHT = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-15, "max_step": 0.01}
"""A stick that begins and ends within one step is not seen; 1.3e-4 beyond the grazing-sliding, at
the row compared there, one takes 0.027."""

WAY = [
    ("PS", 0.54, "PSAB", "adding-sliding"),
    ("DSA", 1.74, "PSAB", "crossing-sliding"),
    ("DSA", 1.74, "DCBA", "switching-sliding"),
    ("DC", 1.77, "DCBA", "grazing-sliding"),
]
"""A word, an amplitude at which its orbit is physical, the longer word, and what leads to it."""
NEAR = {"PS": (0.53, 0.56), "DSA": (1.72, 1.764), "DC": (1.7645, 1.78)}


def letters_by_integration(letter, time, speed, values, span):
    """The letters and times of all that happens to the body, from one of them on.

    `speed` is the acceleration before S, B, C or D; of A and P it is not used.
    """
    a, w, c, V, mu = values.values()
    sign = {"S": 0, "B": 0, "P": -1, "D": -1, "A": 1, "C": 1}[letter]
    hold = mu if letter in "SPC" else -mu
    f = hold if letter in "PA" else hold - speed
    x = f - c * V + a * math.cos(w * time)
    made, end, v = [], time + span, V

    def held(t, y):
        return y[0] + c * V - a * math.cos(w * t)

    while len(made) < 20:
        if sign == 0:
            limits = [lambda t, y: held(t, y) - mu, lambda t, y: held(t, y) + mu]
            limits[0].direction, limits[1].direction = 1.0, -1.0
            for one in limits:
                one.terminal = True
            part = solve_ivp(lambda t, y: [V, 0.0], (time, end), [x, V], events=limits, **TIGHT)
            sign = -1 if len(part.t_events[0]) else 1
            letter = "P" if sign < 0 else "A"
        else:

            def slips(t, y, sign=sign):
                return [y[1], a * math.cos(w * t) - c * y[1] - y[0] - sign * mu]

            def comes(t, y, sign=sign, begin=time):
                return y[1] - V if t > begin else sign

            comes.terminal, comes.direction = True, -sign
            part = solve_ivp(slips, (time, end), [x, v], events=comes, **TIGHT)
            force = -held(part.t[-1], part.y[:, -1])
            through = bool(abs(force) > mu)
            letter = ("SC" if sign < 0 else "BD")[through]
            sign = -sign if through else 0
        if part.status != 1:
            break
        time, x, v = float(part.t[-1]), float(part.y[0, -1]), V
        made.append((letter, time))
    return made


def agrees(columns, row, word, values):
    """Whether an orbit of a branch is that of the integration, from one of its letters around."""
    times = np.array([columns[f"t{k + 1}"][row] for k in range(len(word))])
    speeds = [columns[f"v{k + 1}"][row] for k in range(len(word))]
    period = 2.0 * math.pi / values["omega"]
    made = letters_by_integration(word[0], times[0], speeds[0], values, 1.001 * period)
    letters, found = zip(*made[: len(word)], strict=True)
    assert "".join(letters) == word[1:] + word[0]
    assert found == pytest.approx([*times[1:], times[0] + period], abs=1e-10)


def physical_rows(branch, near, count=2):
    """Rows of physical orbits nearest to a value, but not at events nor within 1e-4."""
    values = branch.columns["a"]
    good = branch.physical & (branch.columns["event"] == "") & (abs(values - near) > 1e-4)
    rows = np.flatnonzero(good)
    return rows[np.argsort(abs(values[rows] - near))][:count]


def followed(word, at):
    model = Belt(**VALUES | {"a": at})
    found = ci.find_orbits(model, word, parameter="a", starts=20, rounds=1)
    orbit = next(orbit for orbit in found if orbit.physical)
    return ci.continue_orbit(orbit, "a", NEAR[word], events=EVENTS)


@pytest.fixture(scope="module")
def branches():
    return {word: followed(word, at) for word, at in {(word, at) for word, at, *_ in WAY}}


@pytest.mark.parametrize(("word", "at", "longer", "name"), WAY, ids=[way[3] for way in WAY])
@pytest.mark.full
def test_both_sides_and_back(branches, word, at, longer, name):
    """From the longer word it is a V or a T, at which that becomes the shorter one again."""
    branch = branches[word]
    (event,) = [e for e in branch.events if e.sliding == name and not e.ghost]
    assert (event.kind, event.criticality) == ("G", "supercritical")
    assert event.error < 1e-12
    near = event.value - 1e-3, event.value + 1e-3
    born = ci.continue_born(event, range=near, events=EVENTS)
    assert born.word in longer * 2
    sides = []
    for one in (branch, born):
        rows = physical_rows(one, event.value)
        for row in rows:
            agrees(one.columns, row, one.word, VALUES | {"a": one.columns["a"][row]})
        sides.append(one.columns["a"][rows[0]] > event.value)
    assert sides[0] != sides[1]
    back = continue_back(born, event.value, near)
    same = [e for e in back.events if e.sliding == name and not e.ghost]
    assert same
    assert {e.kind for e in same} <= {"V", "T"}
    for e in same:
        assert abs(e.value - event.value) <= e.error + event.error
        assert e.becomes in event.word * 2


def continue_back(born, value, near):
    """The longer word's branch, from an orbit on it; other steps, which do not end at the event."""
    row = physical_rows(born, value, 99)[-1]
    return ci.continue_orbit(born.orbit(int(row)), "a", near, events=EVENTS, settings=STEPS)


def test_a_path_through_all_of_them():
    """What a simulation settles on, between one and the next."""
    for a, word in ((0.4, "PS"), (1.0, "PSAB"), (1.74, "SAD"), (1.764, "DCBA"), (1.78, "CD")):
        simulator = Simulator(Belt(**VALUES | {"a": a}))
        run = simulator.run(simulator.state("S", 1.0, 0.5), impacts=80 + len(word))
        assert run.word[-len(word) :] in word * 2


@pytest.mark.parametrize("parameter", ["a", "omega"])
def test_words_of_flights_that_slide_for_no_time_are_not_found(parameter):
    """At any amplitude there are solutions of CBP with a flight from B to P of no duration."""
    found = ci.find_orbits(Belt(**VALUES | {"a": 1.74}), "CBP", parameter, starts=32, rounds=2)
    assert found
    for orbit in found:
        assert np.min(np.diff([*orbit.times, orbit.times[0] + orbit.period])) > 1e-3


@pytest.mark.parametrize("laps", [(1,), (2,), (3,), (1, 2), (1, 3)], ids=str)
def test_of_orbits_of_several_laps_only_one_slides_physically(laps):
    """Sliding forgets how it began: a lap that does not slide passes the
    surface by about the square of the velocity with which another one arrives there."""
    word, values = Word("PS" * len(laps), sum(laps)), VALUES | {"a": 0.16}
    found = ci.find_orbits(Belt(**values), word, parameter="a", starts=60, rounds=1)
    branches = [ci.continue_orbit(one, "a", (0.149, 0.17), events=["V", "T"]) for one in found]
    events = [event for branch in branches for event in branch.events]
    assert {event.kind for event in events} == {"V", "T"}
    for event in events:
        assert event.parameters["a"] == pytest.approx(0.150332963783729, abs=1e-11)
        assert event.ghost == (laps != (1,))
        depth = re.search(r"passes wall S by (\S+) at", event.why or "")
        assert depth is None or float(depth[1]) > 1e-10  # of 7e-6 squared, not rounding


def test_a_wall_in_a_mode_of_fewer_coordinates_is_no_limit_of_sliding():
    """A woodpecker: its sleeve falls, or jams where the bird leans to either side, which hits the
    pole there. The hit was taken for an end of sliding, and its branch had no second point."""
    jam = {"p": "q", "q": "65.4 - 3*q - 250*p"}
    model = {
        "system": "hybrid",
        "period": 0.2,
        "modes": {"down": {"p": "q", "q": "-2500*p - 3*q", "u": "9.81"}, "forth": jam, "back": jam},
        "guards": {
            "H": {
                "mode": "down",
                "within": "p <= 0.1",
                "to": "forth",
                "set": {"q": "e*q + u*40/3"},
            },
            "F": {"mode": "forth", "within": "p >= 0.1", "to": "down", "set": {"u": 0}},
            "L": {
                "mode": "down",
                "within": "p >= -0.1",
                "to": "back",
                "set": {"q": "e*q - u*10/3"},
            },
            "G": {"mode": "back", "within": "p <= -0.1", "to": "down", "set": {"u": 0}},
            "B": {"mode": "back", "within": "p >= -0.3", "set": {"q": "-2*q/5"}},
        },
        "parameters": {"e": 1.1},
    }
    follow = {"parameter": "e", "range": [1.05, 1.2], "orbits": ["HFLG"]}
    scene = ci.read_scene({"name": "woodpecker", "model": model, "follow": follow})
    orbits = ci.find_orbits(scene.model, "HFLG", "e", starts=128)
    orbit = next(o for o in orbits if o.stable and o.physical)
    (touch,) = ci.continue_orbit(orbit, range=(1.05, 1.2), events=["G"]).events
    assert kind_of("G").sliding(event_of(touch)) is None

    def swing(p, q, k, force, t):
        w, away = math.sqrt(k - 2.25), p - force / k
        a, b = away, (q + 1.5 * away) / w
        wave = np.array([[math.cos(w * t), math.sin(w * t)], [-math.sin(w * t), math.cos(w * t)]])
        z, v = math.exp(-1.5 * t) * wave @ [a, b]
        return force / k + z, w * v - 1.5 * z

    def once(given, e):
        q, u, forth, down, hit, back, again = given
        p1, q1 = swing(0.1, e * q + u * 40 / 3, 250, 65.4, forth)
        p2, q2 = swing(0.1, q1, 2500, 0, down)
        p3, q3 = swing(-0.1, e * q2 - 9.81 * down * 10 / 3, 250, 65.4, hit)
        p4, q4 = swing(-0.3, -0.4 * q3, 250, 65.4, back)
        p5, q5 = swing(-0.1, q4, 2500, 0, again)
        ends = [p1 - 0.1, p2 + 0.1, p3 + 0.3, p4 + 0.1, p5 - 0.1, q5 - q, 9.81 * again - u]
        return ends, q3

    born = ci.continue_born(touch, range=(1.05, 1.2), values={"e": [1.15]})
    found = next(e.orbit() for e in born.events if e.kind == "UZ")
    guess = [5.7, 0.27, 0.239, 0.0275, 0.04, 0.052, 0.0275]
    hit = once(fsolve(lambda z: once(z, 1.15)[0], guess, xtol=1e-13), 1.15)[1]
    assert found.velocities[3] == pytest.approx(hit, rel=1e-10)
