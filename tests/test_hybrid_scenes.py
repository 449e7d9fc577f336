"""Random hybrid scenes against an event-driven integration that knows nothing of the package."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from event_driven import Walker, random_scene

from contimpact.diagrams.explore import follow
from contimpact.errors import InputError
from contimpact.models.guards import pivot, state_before
from contimpact.results.scene import read_scene

QUICK = (0, 1, 2, 3)
MANY = range(200)
EVERY = 20
CLOSES = 1e-8
CRITICAL = {"FB": 1.0, "BP": 1.0, "PD": -1.0}


def impacts_of(model, word, orbit, walker):
    """The impacts of an orbit as times and states before them, and the pivot of the first."""
    machine, size = type(model).machine, model.DEGREES_OF_FREEDOM
    places = orbit.problem.kernels.setup(*orbit.model.values.values()).walls
    found, first = [], None
    for letter, row in zip(word, orbit.problem.impacts(orbit.unknowns).tolist(), strict=True):
        guard = model.guard(letter)
        x, v = state_before(guard.row(size), places[model.letters.index(letter)], row[1:])
        mode = machine.mode(guard.modes[0])
        names, speeds = mode.coordinates(machine.sections), mode.velocities(machine.sections)
        state = dict(zip(names, x, strict=False))
        state |= {speeds[n]: s for n, s in zip(names, v, strict=False) if n in speeds}
        variables = walker.modes[guard.modes[0]]
        found.append((row[0], [state[n] for n in variables]))
        if first is None:
            first = variables.index(names[pivot(guard.row(size))])
    return found, first


class Compared:
    """What was compared, and what differs."""

    def __init__(self):
        self.counts, self.wrong = Counter(), []

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
        self.counts["branches"] += len(diagram.branches)
        for branch in diagram.branches:
            rows = range(0, len(branch), EVERY)
            for row in rows:
                if branch.between[row]:
                    continue
                here = f"{table['name']}, {branch.id} {branch.word}, row {row}"
                self.orbit(table, branch, branch.orbit(row), branch["physical"][row] == 1, here)
            for event in branch.events:
                self.event(table, branch, event)

    def orbit(self, table, branch, orbit, physical, here, stability=True):
        walker = Walker(table["model"], orbit.model.values)
        word, span = branch.word, float(orbit.problem.span(orbit.unknowns))
        impacts, surface = impacts_of(orbit.model, word, orbit, walker)
        flights, open_by = walker.orbit(word, impacts, span)
        brief = any(end is not None and end - start < 1e-6 for *_, start, _, _, end in flights)
        if not open_by < CLOSES and not brief:
            backwards = np.min(np.diff([*(t for t, _ in impacts), impacts[0][0] + span])) < 0
            if backwards and not physical:
                self.counts["out of order"] += 1
                return
            self.wrong.append(f"{here}: open by {open_by:.3g}, physical {physical}")
            return
        self.counts["orbits"] += 1
        self.counts["physical"] += int(physical)
        wrong, close = walker.faults(flights)
        if not close:
            self.counts["physicality"] += 1
            if bool(wrong) == physical:
                self.wrong.append(f"{here}: physical {physical}, {orbit.reason}; walked: {wrong}")
        if stability and not brief:
            self.multipliers(walker, word, impacts, span, surface, orbit, here)

    def multipliers(self, walker, word, impacts, span, surface, orbit, here):
        mine = walker.multipliers(word, impacts, span, surface)
        if mine is None:
            return
        theirs = np.asarray(orbit.multipliers)
        largest = np.max(np.abs(theirs))
        if not largest < 1e3:
            return
        left = list(theirs)
        worst = 0.0
        for mu in sorted(mine, key=abs, reverse=True):
            near = int(np.argmin(np.abs(np.array(left) - mu)))
            worst = max(worst, abs(left.pop(near) - mu))
        self.counts["multipliers"] += 1
        if worst > 1e-4 * (1.0 + largest) or np.max(np.abs(left), initial=0.0) > 1e-9:
            self.wrong.append(f"{here}: multipliers {theirs}, walked {mine}")

    def event(self, table, branch, event):
        """What makes an event one is so on the walked orbit; a real change of physicality is
        on both sides of it."""
        here = f"{table['name']}, {event.id} {event.label}"
        flights, walker, impacts, orbit = self.walked(table, branch, event.id)
        span = float(orbit.problem.span(orbit.unknowns))
        if event.kind in CRITICAL or event.kind == "NS":
            surface = impacts_of(orbit.model, branch.word, orbit, walker)[1]
            mine = walker.multipliers(branch.word, impacts, span, surface)
            if mine is None or np.max(np.abs(mine)) > 1e3:
                return
            self.counts["multipliers of events"] += 1
            target = CRITICAL.get(event.kind)
            off = np.abs(np.abs(mine) - 1.0) if target is None else np.abs(mine - target)
            if np.min(off) > 1e-3:
                self.wrong.append(f"{here}: walked multipliers {mine}")
        if event.kind not in ("G", "V"):
            return
        self.counts["touches of events"] += 1
        begins = event.impact is not None and event.kind == "G"
        if begins:  # on the surface that it would begin beyond
            _, _, start, begun, _, _ = flights[event.impact]
            begins = abs(walker.guards[event.wall].gap(start, *begun)) < CLOSES
        if not (begins or walker.faults(flights)[1]):
            self.wrong.append(f"{here}: nothing is at its limit")
        at = int(np.argmin(np.abs(branch["arclength"] - event.arclength)))
        if not (event.physical and 0 < at < len(branch) - 1):
            return
        found = [self.walked(table, branch, row) for row in (at - 1, at + 1)]
        sides = [one.faults(flown) for flown, one, *_ in found]
        if not any(close for _, close in sides):
            self.counts["real changes of physicality"] += 1
            if bool(sides[0][0]) == bool(sides[1][0]):
                self.wrong.append(f"{here}: on both sides {sides}")

    def walked(self, table, branch, place):
        """The flights of an orbit, walked."""
        orbit = branch.orbit(place)
        walker = Walker(table["model"], orbit.model.values)
        impacts, _ = impacts_of(orbit.model, branch.word, orbit, walker)
        flights, _ = walker.orbit(branch.word, impacts, float(orbit.problem.span(orbit.unknowns)))
        return flights, walker, impacts, orbit


@pytest.mark.parametrize("seed", QUICK)
def test_a_random_scene_is_what_an_integration_makes_of_it(seed):
    compared = Compared()
    compared.scene(seed)
    assert not compared.wrong


@pytest.mark.slow
def test_many_random_scenes_are_what_an_integration_makes_of_them():
    compared = Compared()
    for seed in MANY:
        compared.scene(seed)
    assert not compared.wrong, compared.counts
    assert compared.counts["physicality"] > 2000
