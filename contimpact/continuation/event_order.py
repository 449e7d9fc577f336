"""The order of events along a branch, where rounding must not decide it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .branch import Event

TOGETHER = 1e-10
"""Events further apart along a branch are two places, whatever their errors."""


def in_order(events: Iterable[Event]) -> list[Event]:
    """Return events in order along a branch.

    Those that their errors do not tell apart, as both touches of a symmetric orbit, are at one
    place: they stand there in the order of their kinds' names, and of the values of one test
    function, in both directions.
    """
    places: list[list[Event]] = []
    for event in sorted(events, key=lambda e: e.point.arclength):
        if places and _together(places[-1][-1], event):
            places[-1].append(event)
        else:
            places.append([event])
    return [e for place in places for e in (_ranked(place) if len(place) > 1 else place)]


def at_one_place(apart: float, difference: float, error: float) -> bool:
    """Whether two points of a branch are one place.

    Parameters
    ----------
    apart, difference : float
        Of their arclengths, and of their parameters.
    error : float
        Of the latter.
    """
    return abs(apart) <= TOGETHER and abs(difference) <= error


def _together(a: Event, b: Event) -> bool:
    apart = a.point.arclength - b.point.arclength
    return at_one_place(apart, a.parameter - b.parameter, a.error + b.error)


def _ranked(place: Sequence[Event]) -> list[Event]:
    """The events of one place in order; their arclengths rise as they did before."""
    ranked = sorted(place, key=lambda e: (e.kind, int(e.details.get("index", 0))))
    lengths = [event.point.arclength for event in place]
    return [event.moved_to(length) for event, length in zip(ranked, lengths, strict=True)]
