"""The search for the zeros of test functions between two points of a branch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from .arc import Arc
from .branch import Event, Missed, Point
from .event_order import in_order
from .locating import locate, missed
from .problem import Array
from .sign_changes import DIPS, OFF_THE_ENDS, Sample, Stretch, crosses, crossings
from .test_function import TestFunction

GUIDED = 4
"""Beside what `suspects` finds: a guide tells that a value may begin and end between two points."""

DEEPEST = np.array([0, 6, 20, 48, 6])
"""How often an arc is cut, by what is suspected there."""

UNSURE = 1e-4
"""An arc is not cut where the orientation is below this part of that at its ends: so near to a
branch point, what changes along the tangent has the sign of its rounding."""

MOST_CUTS = 200
"""How often an arc is cut in all."""

UNRESOLVED = "two zeros close to each other are not excluded; a smaller max_step may tell"


def find_events(
    tests: Sequence[TestFunction], arc: Arc, stretch: Stretch
) -> tuple[list[Event], list[Missed]]:
    """Locate every crossing on an arc, in order along it.

    Where more crossings are not excluded (see `suspects`), the arc is cut and both parts are
    searched; what cannot be excluded by cutting either is returned as missed.

    Parameters
    ----------
    tests : sequence of TestFunction
    arc : Arc
    stretch : Stretch
        The test functions at its ends, and at the points before and after it, to see how they
        bend.
    """
    if not stretch.left.flat.size or not stretch.left.arclength < stretch.right.arclength:
        return [], []
    least = UNSURE * float(np.fmax(abs(arc.left.orientation), abs(arc.right.orientation)))
    search = _Search(list(tests), [len(values) for values in stretch.left.values], least)
    search.on(arc, stretch, 0)
    return in_order(_placed(event, arc) for event in search.events), search.missed


def _placed(event: Event, arc: Arc) -> Event:
    """An event where it is along an arc, wherever the arc was cut to find it."""
    place = arc.left.arclength + arc.fraction(event.point.unknowns) * arc.span
    return replace(event, point=replace(event.point, arclength=place))


@dataclass(eq=False)
class _Search:
    """The search of an arc for events.

    Attributes
    ----------
    tests : list of TestFunction
    sizes : list of int
        How many values each test function has.
    least : float
        The orientation below which a point says nothing: rounding decides on its tangent.
    """

    tests: list[TestFunction]
    sizes: list[int]
    least: float
    events: list[Event] = field(default_factory=list)
    missed: list[Missed] = field(default_factory=list)
    cuts: int = 0

    def on(self, arc: Arc, stretch: Stretch, depth: int) -> None:
        """Cut an arc where more crossings are not excluded, else locate those there are."""
        found, places = self.suspected(stretch)
        worth = np.where(depth < DEEPEST[found], found, 0)
        if np.any(worth) and self.cuts < MOST_CUTS:
            middle = arc.at(float(places[np.argmax(worth)]))
            ends = stretch.left.arclength, stretch.right.arclength
            inside = middle is not None and ends[0] < middle.arclength < ends[1]
            if middle is not None and inside and not abs(middle.orientation) < self.least:
                self.cut(arc, stretch, middle, depth + 1)
                return
        self.locate_on(arc, stretch)
        if np.any(found == DIPS):
            self.give_up(arc, stretch)

    def suspected(self, stretch: Stretch) -> tuple[Array, Array]:
        """Where more crossings are not excluded, and not within rounding."""
        found, places = stretch.suspects()
        b, c = stretch.left.flat, stretch.right.flat
        if not np.any(found):
            return found, places
        floor = [max(test.noise, test.rounding) for test in self.tests]
        found[(found == DIPS) & (np.fmax(np.abs(b), np.abs(c)) <= np.repeat(floor, self.sizes))] = 0
        if not any(test.guides for test in self.tests):
            return found, places
        passed = crosses(b, c)
        last = 0
        for test, left, right in zip(
            self.tests, stretch.left.values, stretch.right.values, strict=True
        ):
            last += len(left)
            if not test.guides:
                continue
            guides = slice(last - test.guides, last)
            turns = (found[guides] == DIPS) | passed[guides]
            found[guides] = np.where(turns & test.guided(left, right), GUIDED, 0)
        aimed = passed & (found == GUIDED)
        places[aimed] = np.clip(b[aimed] / (b[aimed] - c[aimed]), OFF_THE_ENDS, 1.0 - OFF_THE_ENDS)
        return found, places

    def cut(self, arc: Arc, stretch: Stretch, middle: Point, depth: int) -> None:
        """Search both parts of an arc."""
        self.cuts += 1
        known = len(self.events)
        between = Sample(middle.arclength, [test.at(middle) for test in self.tests])
        for part, side in zip(arc.halves(middle), stretch.cut(between), strict=True):
            self.on(part, side, depth)
        found = {(event.kind, event.details.get("index")) for event in self.events[known:]}
        values = stretch.left.values, between.values, stretch.right.values
        for test, a, b, c in zip(self.tests, *values, strict=True):
            for index in crossings(a[: len(a) - test.guides], c[: len(a) - test.guides]):
                if np.isnan(b[index]) and (test.kind, index) not in found:
                    self.locate_one(test, arc, index, float(a[index]), float(c[index]))

    def locate_on(self, arc: Arc, stretch: Stretch) -> None:
        """Locate what changes sign between both ends."""
        values = stretch.left.values, stretch.right.values
        for test, a, b in zip(self.tests, *values, strict=True):
            for index in crossings(a[: len(a) - test.guides], b[: len(a) - test.guides]):
                if max(abs(a[index]), abs(b[index])) > test.noise:
                    self.locate_one(test, arc, index, float(a[index]), float(b[index]))

    def locate_one(
        self, test: TestFunction, arc: Arc, index: int, left: float, right: float
    ) -> None:
        """Locate one value that changes sign."""
        event = locate(test, arc, index, left, right)
        if isinstance(event, Missed):
            self.missed.append(event)
        elif event is not None and test.accept(event):
            self.events.append(event)

    def give_up(self, arc: Arc, stretch: Stretch) -> None:
        """Record where two zeros were not excluded however often the arc was cut."""
        kinds = np.repeat([test.kind for test in self.tests], self.sizes)
        # beside a jump of the function, what lies beyond it says nothing
        found = np.minimum(*(self.suspected(side)[0] for side in stretch.one_sided()))
        unsure = kinds[found == DIPS]
        self.missed += [missed(str(kind), arc, UNRESOLVED) for kind in unsure]
