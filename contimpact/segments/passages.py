"""What meets a flight: the guards that can end it, and how it leaves and reaches their surfaces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from ..errors import InputError
from ..models.guards import Guard

ELSEWHERE, BACK, MEETING = range(3)
"""Where a flight ends: on another surface than it left; on the same; on the same, where both guards
let the motion pass, so that the flight can vanish with the velocities at its ends."""


class Passages(NamedTuple):
    """What meets the flights of a system, by the numbers of its guards.

    Attributes
    ----------
    watched : tuple of tuple of bool
        Of each guard that is left: whether the flight can meet each guard.
    leaving : tuple of float
        The side, on the flight, of the surface that it leaves: its guard's after a rigid wall, that
        of the guard that the new mode has there after another, or zero if it has none.
    arrivals : tuple of tuple of int
        Of each guard that is left: where a flight to each guard ends.
    onto : tuple of tuple of bool
        Of each guard that is left: whether the jump after a touch leads onto the surface of each
        guard, so that the flight there vanishes with the velocity of the touch. Empty for none.
    begins, at_rest : tuple of tuple of bool
        Of each guard that is left: whether the flight begins on the surface of each guard of its
        mode with a rate of either sign, so that it may leave the mode at once; or always without
        any. Empty for none.
    """

    watched: tuple[tuple[bool, ...], ...]
    leaving: tuple[float, ...]
    arrivals: tuple[tuple[int, ...], ...]
    onto: tuple[tuple[bool, ...], ...] = ()
    begins: tuple[tuple[bool, ...], ...] = ()
    at_rest: tuple[tuple[bool, ...], ...] = ()

    def meets_at_rest(self, left: int, reached: int) -> bool:
        """Whether a flight that a touch starts can vanish."""
        return self.arrivals[left][reached] != ELSEWHERE or (
            bool(self.onto) and self.onto[left][reached]
        )

    @property
    def anchored(self) -> bool:
        """Whether flights start on the surfaces of the guards that they leave: no jump moves the
        gap coordinate."""
        return all(row[a] != ELSEWHERE for a, row in enumerate(self.arrivals))

    def beginning(self, left: int) -> list[int]:
        """Return the guards on whose surface the flight begins with a rate of either sign."""
        return [k for k, begins in enumerate(self.begins[left]) if begins] if self.begins else []

    def resting(self, left: int) -> list[int]:
        """Return the guards on whose surface the flight begins without any."""
        return [k for k, rests in enumerate(self.at_rest[left]) if rests] if self.at_rest else []

    def vanishes(self, left: int, reached: int) -> bool:
        """Whether a flight can vanish together with the velocities at its ends."""
        return self.arrivals[left][reached] == MEETING


def beside(guards: Sequence[Guard], passages: Passages, wall: int) -> tuple[int, int]:
    """Return the guards below and above that a flight from a guard can meet; -1 for none.

    Raises
    ------
    InputError
        If there is no telling on which side of its surface the flight goes on, or there are two
        guards on one side.
    """
    if passages.leaving[wall] == 0.0:
        found = f"behind {guards[wall].name} its next mode has no guard on the same surface"
        raise InputError("model", found, "give the mode one there to simulate it")
    met = {-1: -1, 1: -1}
    for k, guard in enumerate(guards):
        if passages.watched[wall][k] and met[guard.side] >= 0:
            raise InputError("model", "two walls on one side", "give at most one on each side")
        if passages.watched[wall][k]:
            met[guard.side] = k
    return met[-1], met[1]


def passages_of(guards: Sequence[Guard], back: Callable[[int, int], bool]) -> Passages:
    """Return what meets flights.

    Parameters
    ----------
    guards : sequence of Guard
    back : callable ``back(left, reached) -> bool``
        Whether a flight between two guards ends on the surface that it leaves.
    """
    places = range(len(guards))
    watched = tuple(tuple(a.next_mode in b.modes for b in guards) for a in guards)

    def arrival(a: int, b: int) -> int:
        if not back(a, b):
            return ELSEWHERE
        through = guards[a].side != guards[b].side and not guards[a].past
        return MEETING if through else BACK

    def leaving(a: int) -> float:
        met = (guards[b].side for b in places if watched[a][b] and back(a, b))
        return float(next(met, 0))

    arrivals = tuple(tuple(arrival(a, b) for b in places) for a in places)
    return Passages(watched, tuple(leaving(a) for a in places), arrivals)
