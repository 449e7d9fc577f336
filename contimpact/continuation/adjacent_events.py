"""Points between adjacent events, so that every stretch of a branch has one that tells its status.

At an event a solution has the status of neither side. Where two events lie between neighbouring
points of a walk, no point tells what lies between them, and one more is solved there.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from .arc import Arc
from .branch import Event, Point, Points
from .event_order import at_one_place
from .problem import Problem
from .settings import Settings

FRACTIONS = (0.5, 0.3, 0.7)
"""Where between two events a point is tried."""


def on_points(points: Points, events: Iterable[Event]) -> list[Event]:
    """Return events, each on the point of the branch from which its error does not tell it apart,
    if there is one."""
    lengths, values = points.arclengths, points.unknowns[:, -1]
    found = []
    for event in events:
        place = event.point.arclength
        after = int(np.searchsorted(lengths, place))
        for i in range(max(after - 1, 0), min(after + 1, len(lengths))):
            if at_one_place(lengths[i] - place, values[i] - event.parameter, event.error):
                event = event.moved_to(float(lengths[i]))
        found.append(event)
    return found


def with_points_between(
    problem: Problem, points: Points, events: Iterable[Event], others: Iterable[Point] = ()
) -> Points:
    """Return the points of a branch, and one more between any two events that had none between.

    Parameters
    ----------
    problem : Problem
    points : Points
    events : iterable of Event
        From `on_points`.
    others : iterable of Point
        Further points without a status of their own: a birth, an end at an event.
    """
    marks = [*((event.point, event.error) for event in events), *((p, 0.0) for p in others)]
    marks.sort(key=lambda mark: mark[0].arclength)
    lengths, span = points.arclengths, float(np.ptp(points.unknowns[:, -1])) or 1.0
    free = lengths[~np.isin(lengths, [mark.arclength for mark, _ in marks])]
    found = []
    for (left, error), (right, other) in pairwise(marks):
        first, beyond = np.searchsorted(free, (left.arclength, right.arclength))
        apart = right.arclength - left.arclength, right.parameter - left.parameter
        if first == beyond and not at_one_place(*apart, error + other):
            scale = problem.scale(left.unknowns, span)
            point = _between(Arc(problem, left, right, scale, Settings()))
            found += [] if point is None else [point]
    return points.with_more(found)


def _between(arc: Arc) -> Point | None:
    """A point of the branch between the ends of an arc; None where none is reached."""
    for fraction in FRACTIONS:
        point = arc.at(fraction)
        if point is None or not arc.holds(point.unknowns):
            continue
        if arc.left.arclength < point.arclength < arc.right.arclength:
            return point
    return None
