"""Random hybrid scenes against an event-driven integration that knows nothing of the package."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from event_driven import TIGHT, Between, Walker, random_scene, row_of
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq, fsolve, minimize_scalar

from contimpact.diagrams.curves import follow_curve
from contimpact.diagrams.explore import follow
from contimpact.diagrams.orbit_branch import continue_orbit
from contimpact.errors import InputError
from contimpact.models.guards import state_before
from contimpact.orbits.search import find_orbits
from contimpact.results.scene import read_scene

QUICK = (2, 1, 4, 6, 1016, 1069, 1222)
MANY = range(400)
EVERY = 20
CLOSES = 1e-8
MULTIPLIERS = {"FB": 1.0, "BP": 1.0, "PD": -1.0, "NS": None}
FAR = (1e-8, 1e-6)
"""Of an event from where the walker finds it: of a time or a gap, and of a multiplier."""
FLAT = 1e-15
"""A walked function below this is rounding: it does not tell a zero of the third order better."""
APART = 1e-5
"""Points of a branch that are nearer to an event, in arclength, are not beside it."""


def impacts_of(model, word, orbit, walker):
    """The impacts of an orbit as times and states before them."""
    machine, size = type(model).machine, model.DEGREES_OF_FREEDOM
    places = orbit.problem.kernels.setup(*orbit.model.values.values()).walls
    found = []
    for letter, row in zip(word, orbit.problem.impacts(orbit.unknowns).tolist(), strict=True):
        guard = model.guard(letter)
        x, v = state_before(guard.row(size), places[model.letters.index(letter)], row[1:])
        mode = machine.mode(guard.modes[0])
        names, speeds = mode.coordinates(machine.sections), mode.velocities(machine.sections)
        state = dict(zip(names, x, strict=False))
        state |= {speeds[n]: s for n, s in zip(names, v, strict=False) if n in speeds}
        found.append((row[0], np.array([state[n] for n in walker.modes[guard.modes[0]]])))
    return found


def deciding(event, word, turns, span):
    """What vanishes at an event, as a function of walker and impacts: the defining one."""
    count = len(word)
    k, kind = event.impact if event.impact is not None else event.flight, event.kind
    if kind == "V":  # of a flight that vanishes, whichever velocities do with it
        for flight in {k, event.flight if event.flight is not None else k}:
            ends = [*event.times, event.times[0] + span][flight : flight + 2]
            if abs(ends[1] - ends[0]) < CLOSES:
                k, kind = flight, "T"

    def ends(walker, impacts):
        (t, y), again = impacts[k], k + 1 == count
        end = impacts[(k + 1) % count][0] + again * turns * walker.period
        return t, walker.after(word[k], t, y), end

    def multiplier(walker, impacts):
        mine = walker.multipliers(word, impacts, turns)
        target = MULTIPLIERS[event.kind]
        if target is not None:
            return float(np.real(np.prod(mine - target)))
        return float(np.max(np.abs(mine[np.abs(np.imag(mine)) > 1e-9])) - 1.0)

    def velocity(walker, impacts):
        return walker.slope(word[k], *impacts[k])

    def duration(walker, impacts):
        start, _, end = ends(walker, impacts)
        return end - start

    def touch(walker, impacts):
        start, begun, end = ends(walker, impacts)
        gap, mode = walker.guards[event.wall].gap, walker.guards[word[k]].to
        sol = solve_ivp(walker.field(mode), (start, end), begun, **TIGHT).sol
        width, later = 0.05 * (end - start), round((start - event.times[k]) / walker.period)
        about = event.touch_time + later * walker.period
        bounds = max(start, about - width), min(end, about + width)
        options = {"xatol": 1e-10 * (end - start)}
        top = minimize_scalar(
            lambda s: -gap(s, *sol(s)), bounds=bounds, method="bounded", options=options
        )
        return -float(top.fun)

    def beginning(walker, impacts):
        guard, wall = walker.guards[word[k]], walker.guards[event.wall]
        t, y = impacts[k]
        if guard.past:  # by what sliding would begin within the limit
            return wall.gap(t, *walker.after(walker.sliding(guard.name), t, y))
        if wall.mode != guard.to:
            return wall.gap(t, *y)
        begun = walker.after(guard.name, t, y)
        gap = wall.gap(t, *begun)
        return walker.slope(wall.name, t, begun) if abs(gap) < 1e-10 else gap

    if event.kind == "G":
        return touch if event.impact is None else beginning
    return {"V": velocity, "T": duration}.get(kind, multiplier)


class Compared:
    """What was compared, and what differs."""

    def __init__(self):
        self.counts, self.wrong, self.undecided = Counter(), [], []
        self.farthest = Counter()
        self.walker = None

    def scene(self, seed):
        table = random_scene(seed)
        try:
            diagram = follow(read_scene(table))
        except InputError as error:
            if "orbit was found" not in str(error):
                raise
            self.counts["scenes without an orbit"] += 1
            return
        self.counts["scenes"] += 1
        self.walker = Walker(table["model"])
        self.counts["branches"] += len(diagram.branches)
        for branch in diagram.branches:
            rows = range(0, len(branch), EVERY)
            for row in rows:
                if branch.between[row]:
                    continue
                here = f"{table['name']}, {branch.id} {branch.word}, row {row}"
                self.orbit(branch, branch.orbit(row), branch["physical"][row] == 1, here)
            for event in branch.events:
                self.event(table, branch, event)

    def orbit(self, branch, orbit, physical, here):
        walker = self.walker.at(orbit.model.values)
        word, span = branch.word, float(orbit.problem.span(orbit.unknowns))
        impacts = impacts_of(orbit.model, word, orbit, walker)
        flights, open_by = walker.orbit(word, impacts, span)
        brief = any(end is not None and end - start < 1e-6 for *_, start, _, _, end in flights)
        turns = round(span / walker.period)
        backwards = np.min(np.diff([*(t for t, _ in impacts), impacts[0][0] + span])) < 0
        self.counts["out of order"] += int(backwards)
        if backwards or not open_by < CLOSES:  # of a slow arrival the gap tells more than the time
            open_by = np.max(np.abs(walker.residual(word, row_of(impacts), turns)))
        if not open_by < CLOSES and (backwards or not brief):
            self.wrong.append(f"{here}: open by {open_by:.3g}, physical {physical}")
            return
        self.counts["orbits"] += 1
        self.counts["physical"] += int(physical)
        wrong, close = ([("backwards", 1.0)], []) if backwards else walker.faults(flights)
        if not close:
            self.counts["physicality"] += 1
            if bool(wrong) == physical:
                self.wrong.append(f"{here}: physical {physical}, {orbit.reason}; walked: {wrong}")
        self.multipliers(walker, word, impacts, turns, orbit, here)

    def multipliers(self, walker, word, impacts, turns, orbit, here):
        theirs = np.asarray(orbit.multipliers)
        largest = np.max(np.abs(theirs))
        if not largest < 1e3:
            return
        mine = walker.multipliers(word, impacts, turns)
        left = [*mine, *[0.0] * max(0, len(theirs) - len(mine))]
        worst = 0.0
        for mu in sorted(theirs, key=abs, reverse=True):
            near = int(np.argmin(np.abs(np.array(left) - mu)))
            worst = max(worst, abs(left.pop(near) - mu))
        self.counts["multipliers"] += 1
        if max([worst, *np.abs(left)]) > 1e-5 * (1.0 + largest):
            self.wrong.append(f"{here}: multipliers {theirs}, walked {mine}")

    def event(self, table, branch, event):
        """Between two orbits of the branch the walker's own function of the event vanishes where
        the event is; a real change of physicality is on both sides of it."""
        here = f"{table['name']}, {event.id} {event.label}"
        off = np.abs(branch["arclength"] - event.arclength) > APART
        before = np.nonzero(off & (branch["arclength"] < event.arclength))[0]
        after = np.nonzero(off & (branch["arclength"] > event.arclength))[0]
        if not (before.size and after.size):
            self.counts["events at ends"] += 1
            return
        rows = int(before[-1]), int(after[0])
        sides = [self.walked(branch, row) for row in rows]
        word, walker = branch.word, sides[0][1]
        orbit, parameter = branch.orbit(event.id), event.parameter
        span = float(orbit.problem.span(orbit.unknowns))
        ends = [(side, one.model.values[parameter]) for _, _, side, one in sides]
        turns = round(span / walker.at(orbit.model.values).period)
        between = Between(walker, orbit.model.values, parameter, word, ends, turns)
        vanishes = deciding(event, word, turns, span)
        value, found = between.zero(vanishes), impacts_of(orbit.model, word, orbit, walker)
        far = math.inf if value is None else abs(value - event.value) / (1.0 + abs(event.value))
        if far < FAR[event.kind in MULTIPLIERS]:
            what = "relocated"
            self.farthest[event.kind] = max(self.farthest[event.kind], far)
        elif value is None:
            what = "not decided: same sign"
        elif math.isnan(value):
            what = "not decided: bracketed only"
        elif abs(vanishes(walker.at(orbit.model.values), found)) < FLAT:
            what = "not decided: flat"
        else:
            what = "wrong"
            self.wrong.append(f"{here}: at {event.value!r}, walked {value!r}")
        self.counts[f"{event.kind} {what}"] += 1
        if "not decided" in what:
            self.undecided.append(f"{here}: {what}, rows {rows}")
        if not (event.physical and event.kind in ("G", "V", "T")):
            return
        if any(
            e is not event and abs(e.arclength - event.arclength) < APART for e in branch.events
        ):
            self.counts["coincident events"] += 1  # by symmetry, say: no stretch lies between them
            return
        judged = [one.faults(flown) for flown, one, *_ in sides]
        if not any(close for _, close in judged):
            self.counts["real changes of physicality"] += 1
            if bool(judged[0][0]) == bool(judged[1][0]):
                self.wrong.append(f"{here}: on both sides {judged}")

    def walked(self, branch, place):
        """The flights of an orbit, walked."""
        orbit = branch.orbit(place)
        walker = self.walker.at(orbit.model.values)
        impacts = impacts_of(orbit.model, branch.word, orbit, walker)
        flights, _ = walker.orbit(branch.word, impacts, float(orbit.problem.span(orbit.unknowns)))
        return flights, walker, impacts, orbit


@pytest.mark.parametrize("seed", QUICK)
@pytest.mark.quick(1)
def test_a_random_scene_is_what_an_integration_makes_of_it(seed):
    compared = Compared()
    compared.scene(seed)
    assert not compared.wrong


@pytest.mark.full
def test_a_touch_at_an_impact_that_vanishes_is_no_event_of_its_own():
    """Where slip begins at rest, as f' = 0 there, both the velocity of P and the gap after it are
    zero, the gap with the third power: rounding placed a ~G within 4e-7 of the ~V."""
    table = random_scene(25)
    table["follow"] |= {"unphysical": True, "orbits": ["SABP"], "max_branches": 1}
    (branch,) = follow(read_scene(table)).branches
    (v,) = [e for e in branch.events if e.kind == "V" and e.impact == 3]
    assert [e for e in branch.events if abs(e.arclength - v.arclength) < 1e-5] == [v]
    assert abs(v.velocities[3]) < 1e-15
    assert branch.missed == []


@pytest.mark.slow
def test_many_random_scenes_are_what_an_integration_makes_of_them():
    compared = Compared()
    for seed in MANY:
        compared.scene(seed)
    assert not compared.wrong, compared.counts
    located = sum(n for what, n in compared.counts.items() if what.endswith(" relocated"))
    assert compared.counts["physicality"] > 2000
    assert located > 200, compared.undecided


def test_nothing_is_born_where_a_touch_is_a_jump():
    """A neuron that fires is reset to 0: no orbit that fires once more is near to one whose voltage
    just touches the threshold. It opened a closed branch far away."""
    a, w, period = 0.8, 4.0, math.pi / 2
    table = {
        "name": "lif",
        "model": {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"I": 1.3, "a": a, "w": w},
            "modes": {"rest": {"v": "I + a*cos(w*t) - v"}},
            "guards": {"F": {"within": "v <= 1", "set": {"v": 0}}},
        },
        "follow": {"parameter": "I", "range": [0.9, 3], "orbits": ["F"], "switch": ["G", "V"]},
    }
    diagram = follow(read_scene(table))
    (branch,) = diagram.branches
    entries = [e for e in branch.events if e.kind in ("G", "V")]
    (touch,) = [e for e in entries if e.kind == "G"]
    assert {(e.label.lstrip("~"), e.becomes, tuple(e.opens)) for e in entries} == {
        ("G", None, ()),
        ("V", None, ()),
    }
    assert any("nothing starts there: what a touch" in note for note in diagram.statistics["notes"])
    assert not diagram.reading.transitions

    def voltage(t, fired, drive):
        def free(t):
            return drive + a * (math.cos(w * t) + w * math.sin(w * t)) / (1 + w * w)

        return free(t) - free(fired) * math.exp(fired - t)

    def equations(u):
        fired, touched, drive = u
        reached, peak = voltage(fired + period, fired, drive), voltage(touched, fired, drive)
        return [reached - 1, peak - 1, drive + a * math.cos(w * touched) - peak]

    assert touch.value == pytest.approx(fsolve(equations, [-0.3, 0.5, 1.4], xtol=1e-12)[2], 1e-9)


def test_no_fold_is_born_where_a_touch_is_a_jump():
    """A bumper kicks what hits it. An orbit with the touch as an impact of velocity zero is none;
    where its matrix was singular a G-FB was reported, at w = 1.0634 for one."""
    table = {
        "name": "bumper",
        "model": {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"w": 1.7, "s": -0.2, "p": 0.3},
            "modes": {"free": {"x": "v", "v": "cos(w*t) - x - v/10"}},
            "guards": {"K": {"within": "x <= s", "set": {"v": "-0.6*v - p"}}},
        },
        "follow": {"parameter": "s", "range": [-0.5, 0], "orbits": ["K"]},
    }
    model = read_scene(table).model
    orbit = next(o for o in find_orbits(model, "K", parameter="s", starts=16) if o.physical)
    (touch,) = continue_orbit(orbit, range=(-0.5, 0.0), events=["G"]).events
    curve = follow_curve(touch, "w", (-0.5, 0.5), (1.0, 1.8))
    assert [point.kind for point in curve.points] == ["G-PD", "G-PD"]


def test_a_touch_of_a_contact_whose_law_has_no_series_is_an_event_nonetheless():
    """Hertz' force at its guard: the whole run was lost."""
    pytest.importorskip("heyoka", reason="needs contimpact[ode]")
    beyond = {"d": "v", "v": "0.7*cos(w*t) - v/10 - d - 0.4 - 10*d**1.5"}
    table = {
        "name": "hertz",
        "model": {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"w": 1.8},
            "modes": {"free": {"x": "v", "v": "0.7*cos(w*t) - v/10 - x"}, "contact": beyond},
            "guards": {
                "C": {"mode": "free", "within": "x <= 0.4", "to": "contact", "set": {"d": 0}},
                "R": {"mode": "contact", "within": "d >= 0", "to": "free", "set": {"x": 0.4}},
            },
        },
        "follow": {"parameter": "w", "range": [1.5, 2], "orbits": ["0"], "switch": ["G"]},
    }
    diagram = follow(read_scene(table))
    (touch,) = diagram["b1"].events
    size = brentq(lambda w: 0.7 / math.hypot(1 - w * w, w / 10) - 0.4, 1.5, 2, xtol=1e-15)
    assert (touch.kind, touch.becomes) == ("G", None)
    assert abs(touch.value - size) <= touch.error + 1e-15
    assert diagram.statistics["failure"] is None


def test_sliding_that_ends_on_another_variable_is_born_at_its_grazing():
    """What drives x to its threshold is y, and where x only touches it, y is at the limit of
    sliding; no branch was born there, though the sliding orbit's own T named the orbit without."""
    table = {
        "name": "threshold",
        "model": {
            "system": "hybrid",
            "period": "2*pi",
            "parameters": {"h": 0.62},
            "modes": {
                "free": {"x": "y - x", "y": "cos(t) - 2*x - y/5"},
                "slide": {"y": "cos(t) - 2*h - y/5"},
            },
            "guards": {
                "S": {"mode": "free", "within": "x <= h", "to": "slide"},
                "P": {"mode": "slide", "within": "y >= h", "to": "free", "set": {"x": "h"}},
            },
        },
        "follow": {"parameter": "h", "range": [0.5, 0.65], "orbits": ["0"], "switch": ["G"]},
        "detect": {"events": ["G", "V", "T"]},
    }
    diagram = follow(read_scene(table))
    branch, born = diagram.branches
    (touch,) = branch.events
    assert touch.value == pytest.approx(1 / abs((1j + 1 / 5) * (1j + 1) + 2), abs=1e-14)
    assert (touch.becomes, touch.criticality) == ("SP", "supercritical")
    assert {(e.kind, e.ghost) for e in born.events} == {("T", False), ("V", False)}
    assert [e.becomes for e in born.events if e.kind == "T"] == ["0"]
    assert all(e.value == pytest.approx(touch.value, abs=1e-12) for e in born.events)
    assert born.columns["h"][born.physical].max() <= touch.value


@pytest.mark.full
def test_impacts_at_once_on_several_surfaces_are_said_to_leave_the_word_beyond_open():
    """A boost converter whose switch opens at a current and closes at a clock: in the doubled orbit
    the current reaches its limit at the clock itself. Its stable branch ended without a word."""
    table = {
        "name": "boost",
        "model": {
            "system": "hybrid",
            "period": 1,
            "parameters": {"I": 2.7},
            "modes": {
                "on": {"i": "2", "u": "-u/2.4", "s": "1"},
                "off": {"i": "2*(1 - u)", "u": "i/1.2 - u/2.4", "s": "1"},
            },
            "guards": {
                "O": {"mode": "on", "within": "i <= I", "to": "off"},
                "K": {"mode": "off", "within": "s <= 1", "to": "on", "set": {"s": 0}},
                "J": {"mode": "on", "within": "s <= 1", "set": {"s": 0}},
            },
        },
        "follow": {"parameter": "I", "range": [2.6, 2.85], "orbits": ["OKOK"], "switch": ["T"]},
        "numerics": {"starts": 64},
    }
    diagram = follow(read_scene(table))
    (first, *_) = ends = [e for e in diagram.entries if e.kind == "T" and not e.ghost]
    notes = diagram.statistics["notes"]
    assert all(any(n.startswith(f"{e.id} (T): OKO happen at once") for n in notes) for e in ends)
    matrix = np.array([[0, -2], [1 / 1.2, -1 / 2.4]])
    rest = np.linalg.solve(-matrix, [2.0, 0.0])
    flow = expm(matrix)
    equations = np.diag([1, math.exp(1 / 2.4)]) - flow
    limit, _ = np.linalg.solve(equations, rest - flow @ rest + [2.0, 0.0])
    assert first.value == pytest.approx(limit, rel=1e-11)


def test_a_wall_before_another_is_not_passed():
    """Two stops on one side: orbits that hit the second one had passed the first, which they do not
    turn at, and were stable and physical."""
    table = {
        "name": "two",
        "model": {
            "system": "hybrid",
            "period": "2*pi/w",
            "parameters": {"a": 1.2, "w": 1.3, "r": 0.8, "first": 0.7, "second": 0.5},
            "modes": {"free": {"x": "v", "v": "a*cos(w*t) - v/10 - x"}},
            "guards": {
                "S": {"within": "x <= second", "set": {"v": "-r*v"}},
                "R": {"within": "x <= first", "set": {"v": "-v/2"}},
            },
        },
        "follow": {"parameter": "first", "range": [0.3, 0.8], "orbits": ["S"]},
        "numerics": {"starts": 32},
    }
    for branch in follow(read_scene(table)).branches:
        beyond = branch.columns["first"] > 0.5
        assert not np.any(branch.physical[~beyond])
        assert np.all(branch.physical == branch.physical[-1] * beyond)
