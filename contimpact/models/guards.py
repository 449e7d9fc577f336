"""Guards and modes of a system, and the section coordinates of states at a guard.

In a mode the system moves by one law. A guard is a surface in state space at which modes end, each
with a letter of its own: words are written in these letters, and are paths through the graph of
modes and guards. A rigid wall is a guard that leads back to the mode it ends.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from ..errors import explain_arguments

FEW = 2
"""Guards of which impacts are counted; of more the counts hardly tell a word."""

# Section coordinates: the state before an impact, without what the guard's surface gives.
#
# They are the velocity of the gap coordinate, and position and velocity of every coordinate but
# one,
# the guard's pivot.


def pivot(row: Sequence[Any]) -> int:
    """Return the coordinate that a surface gives: the first of those with the largest factor."""
    return max(range(len(row)), key=lambda i: abs(row[i]))


def state_before(
    row: Sequence[Any], position: Any, section: Sequence[Any]
) -> tuple[list[Any], list[Any]]:
    """Return positions and velocities before an impact, from the factors of the coordinates in the
    gap coordinate, the position of the guard's surface, and the section coordinates."""
    place = pivot(row)
    found = []
    for level, others in ((position, section[1::2]), (section[0], section[2::2])):
        factors = [*row[:place], *row[place + 1 :]]
        rest = sum(c * x for c, x in zip(factors, others, strict=True) if c)
        own = (level - rest) / row[place]
        found.append([*others[:place], own, *others[place:]])
    return found[0], found[1]


Row: TypeAlias = tuple[float, ...]
"""Coefficients of a linear combination of the positions."""


def are_parallel(one: Row, other: Row) -> bool:
    """Whether two gap coordinates are multiples of each other."""
    place = pivot(one)
    return all(a * other[place] == b * one[place] for a, b in zip(one, other, strict=True))


@dataclass(frozen=True)
class Mode:
    r"""A law by which the system moves.

    Attributes
    ----------
    name : str
    degrees_of_freedom : int, optional
        How many coordinates it has, the system's unless set: the first of these.
    first_order : tuple of int
        The coordinates that move by a law of first order, :math:`\dot x = f(t, x)`: their
        velocities are no part of the state.
    dependent : int
        How many numbers of its state follow from the others: its true size is by so much smaller.
    """

    name: str
    degrees_of_freedom: int | None = None
    first_order: tuple[int, ...] = ()
    dependent: int = 0

    def orders(self, size: int) -> tuple[int, ...]:
        """Return the order of each of the system's coordinates, zero where it has none."""
        own = size if self.degrees_of_freedom is None else self.degrees_of_freedom
        return tuple(0 if i >= own else 1 if i in self.first_order else 2 for i in range(size))


@dataclass(frozen=True)
class Guard:
    """A surface at which motion ends in some modes and goes on in another."""

    name: str
    """A single letter."""
    side: int
    """+1 where the gap coordinate stays below the surface, -1 where it stays above."""
    mode: str | tuple[str, ...] = ""
    """The modes that it ends. Empty in systems of one mode, which has no name."""
    to: str | None = None
    """The mode it leads to; for a rigid wall, the one it ends."""
    coordinate: int | Row = 0
    """The gap coordinate: one of the positions, by its number, or a linear combination of all, by
    its coefficients."""
    past: str = ""
    """Guard beyond which sliding would begin: where another guard on the same surface leads to
    sliding, this one then leads through the surface instead."""

    @property
    def modes(self) -> tuple[str, ...]:
        """The modes that it ends."""
        return (self.mode,) if isinstance(self.mode, str) else tuple(self.mode)

    @property
    def next_mode(self) -> str:
        """The mode it leads to."""
        return self.modes[0] if self.to is None else self.to

    @property
    def rigid(self) -> bool:
        """Whether it leads back to the only mode it ends."""
        return self.modes == (self.next_mode,)

    def row(self, size: int) -> Row:
        """Return the coefficients of the gap coordinate, of so many positions."""
        if isinstance(self.coordinate, int):
            return tuple(1 if i == self.coordinate else 0 for i in range(size))
        return tuple(self.coordinate)


@explain_arguments
@dataclass(frozen=True)
class Wall(Guard):
    """A rigid wall: a guard that leads back to the mode it ends.

    `side` is +1 where the body stays below the wall, -1 where it stays above.
    """


def orders_of(modes: Sequence[Mode], name: str, size: int) -> tuple[int, ...]:
    """Return `Mode.orders` of a mode by its name; systems of one mode need not name it."""
    mode = next((mode for mode in modes if mode.name == name), Mode(name))
    return mode.orders(size)


def state_size(modes: Sequence[Mode], name: str, size: int) -> int:
    """Return of how many numbers the state in a mode is."""
    dependent = next((mode.dependent for mode in modes if mode.name == name), 0)
    return sum(orders_of(modes, name, size)) - dependent


def guard_of(guards: Sequence[Guard], letter: str) -> Guard:
    """Return the guard of a letter."""
    return next(guard for guard in guards if guard.name == letter)


def following_letters(guards: Sequence[Guard], letter: str) -> str:
    """Return the letters of the guards that can come after one."""
    return reachable_letters(guards, guard_of(guards, letter).next_mode)


def is_path(guards: Sequence[Guard], letters: str) -> bool:
    """Return whether each letter of a word can follow the one before it, the first the last."""
    return all(
        b in following_letters(guards, a)
        for a, b in zip(letters, letters[1:] + letters[:1], strict=True)
    )


def reachable_letters(guards: Sequence[Guard], mode: str) -> str:
    """Return the letters of the guards that can be reached in a mode."""
    return "".join(guard.name for guard in guards if mode in guard.modes)


def way_back(guards: Sequence[Guard], letter: str, mode: str, there: str) -> str | None:
    """Return the shortest way from a guard that is touched in a mode back to that mode, its own
    letter first, through the letters `there` of the guards on the same surface; None without
    one."""
    after = {guard.name: guard.next_mode for guard in guards}
    ways = [letter]
    for way in ways:  # grows while it is gone through
        if after[way[-1]] == mode:
            return way
        further = reachable_letters(guards, after[way[-1]])
        ways += [way + one for one in further if one in there and one not in way]
    return None


def slides_at(guards: Sequence[Guard], crossing: Guard) -> Guard | None:
    """Return the guard that leads to sliding where one with `past` leads through the surface."""
    limited = next((guard.modes for guard in guards if guard.name == crossing.past), ())
    return next((g for g in guards if same_surface(g, crossing) and g.next_mode in limited), None)


def crosses_at(guards: Sequence[Guard], sliding: Guard, limit: str) -> Guard | None:
    """Return the guard that leads through where sliding would begin beyond a limit of it."""
    return next((g for g in guards if g.past == limit and same_surface(g, sliding)), None)


def same_surface(one: Guard, other: Guard) -> bool:
    """Whether two guards end the same modes on one side of one coordinate."""
    return (one.modes, one.side, one.coordinate) == (other.modes, other.side, other.coordinate)


AMBIGUOUS = "give one guard there, or `past` the limit of sliding that tells them apart"
"""What is accepted in place of two guards that are met at once."""


def rival_guards(guards: Sequence[Guard], size: int) -> Iterator[tuple[Guard, Guard, Any]]:
    """Yield pairs of guards that end a mode on parallel surfaces, met in one direction and by the
    same condition, and by what factor the gap coordinate of the second is larger.

    Where the second one's position is by this factor larger, too, nothing says which guard is met.
    """
    for one, other in itertools.combinations(guards, 2):
        first, second = one.row(size), other.row(size)
        place = pivot(first)
        factor = second[place] / first[place]
        together = {*one.modes} & {*other.modes} and one.past == other.past
        if together and are_parallel(first, second) and factor * one.side * other.side > 0:
            yield one, other, factor


def graph(guards: Sequence[Guard]) -> dict[str, str]:
    """Return the letters that can follow each letter."""
    return {guard.name: following_letters(guards, guard.name) for guard in guards}
