"""Guards and modes of a system, section coordinates of states at a guard, and words.

In a mode the system moves by one law. A guard is a surface in state space at which modes end, each
with a letter of its own: words are written in these letters, and are paths through the graph of
modes and guards. A rigid wall is a guard that leads back to the mode it ends.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from ..errors import InputError, count_text, explain_arguments, short_repr

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
    return _forbidden_pair(letters, graph(guards)) is None


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
        factor = rival_factor(one, other, size)
        if factor is not None:
            yield one, other, factor


def rival_factor(one: Guard, other: Guard, size: int) -> Any:
    """Return by what factor the gap coordinate of a guard's rival is larger; None of no rival."""
    first, second = one.row(size), other.row(size)
    place = pivot(first)
    factor = second[place] / first[place]
    together = {*one.modes} & {*other.modes} and one.past == other.past
    rivals = together and are_parallel(first, second) and factor * one.side * other.side > 0
    return factor if rivals else None


def graph(guards: Sequence[Guard]) -> dict[str, str]:
    """Return the letters that can follow each letter."""
    return {guard.name: following_letters(guards, guard.name) for guard in guards}


# Words: the walls an orbit visits, in order, and the count n:m/pT by which they are known.
#
# `n:m` counts the impacts on each wall, in the order the model lists its walls, per forcing period:
# `2:1` is BBT. `n:m/pT` is that word run p times with period pT: `1:1/2T` is BTBT over two periods.
# A word may be written out, alone or with its period: `BTBT`, `BTBT/2T`, `B/3T` (one impact in
# three periods). Without forcing there is no T, and a word is its letters, or their count, alone.
# Where not every wall can follow every other, words are the closed paths through the graph of modes
# and guards. `0` is the orbit without impacts.

LONGEST_WORD = 1000
_COUNTS = re.compile(r"([0-9]+(?::[0-9]+)*)(?:/([0-9]+)T)?")
_LETTERS = re.compile(r"([^\W\d]+)(?:/([0-9]+)T)?")
_NONE = re.compile(r"0(?:/([0-9]+)T)?")
_SEVERAL = re.compile(r"\([0-9:]+\)/[0-9]+T")
"""How an orbit is called that has unlike numbers of impacts in its periods."""


@dataclass(frozen=True)
class Word:
    """The walls visited and the period in units of T; prints as users write it.

    Without walls it is the word `0`. The period is 0 where it is free: without forcing there is no
    T to count in.
    """

    walls: str
    period: int = 1

    def __str__(self) -> str:
        walls = self.walls or "0"
        return walls if self.period <= 1 else f"{walls}/{self.period}T"

    def __len__(self) -> int:
        return len(self.walls)

    def notation(self, letters: Sequence[str]) -> str:
        """Return the count n:m/pT; of more than two letters the word itself."""
        few = self.walls and len(letters) <= FEW
        return self.counts(letters) if few else str(self)

    def counts(self, letters: Sequence[str]) -> str:
        """Return the count of each letter; in parentheses where it is a total over all periods."""
        totals = [self.walls.count(letter) for letter in letters]
        p = self.period
        if p <= 1:
            return ":".join(map(str, totals))
        if all(total % p == 0 for total in totals):
            return ":".join(str(total // p) for total in totals) + f"/{p}T"
        return f"({':'.join(map(str, totals))})/{p}T"

    def insert(self, flight: int, walls: str) -> Word:
        """Return the word with more impacts, one for each letter, on flight number `flight`."""
        return Word(self.walls[: flight + 1] + walls + self.walls[flight + 1 :], self.period)

    def drop(self, *impacts: int) -> Word:
        """Return the word without the impacts of these numbers."""
        kept = (wall for k, wall in enumerate(self.walls) if k not in impacts)
        return Word("".join(kept), self.period)

    def repeated(self) -> list[Word]:
        """Return the shorter words that read as this one if run several times, shortest first."""
        n = len(self)
        if n == 0:
            return [Word("", p) for p in range(1, self.period) if self.period % p == 0]
        return [
            Word(self.walls[:shift], self.period * shift // n)
            for shift in self.rotations()[1:]
            if n % shift == 0 and self.period * shift % n == 0
        ]

    def rotations(self) -> list[int]:
        """Return the cyclic shifts that map the word to itself, 0 among them."""
        doubled = self.walls * 2
        n = len(self) or 1
        return [shift for shift in range(n) if doubled[shift : shift + n] == self.walls]


def name_orbit(notation: str, walls: str, what: str = "") -> str:
    """Return a notation, with the word where the notation is not the word itself: ``2:1 (BBT)``."""
    return notation if walls in notation else f"{notation} ({what}{walls})"


def is_rotation(one: str, other: str) -> bool:
    """Whether two words are cyclic shifts of each other."""
    return len(one) == len(other) and one in other * 2


def repetitions(notations: Sequence[str]) -> str:
    """Return what orbits are called that are shorter ones, run several times."""
    return f"repetitions of {' and '.join(notations)}"


def parse_word(
    text: str,
    letters: Sequence[str],
    where: str = "word",
    graph: Mapping[str, str] | None = None,
    free: bool = False,
) -> Word:
    """Read an orbit's name: ``n:m``, ``n:m/pT``, a word, or a word and its period; ``0`` or
    ``0/pT`` without impacts.

    The letters are the model's walls, in its order, and the graph has those that can follow each;
    every letter unless given. Words of a `free` period have none in units of T. Raises InputError,
    which names the place `where`, if it is not the name of an orbit between these walls.
    """
    counts = ":".join("nmkl"[: len(letters)])
    example = "".join(letters)
    counted = len(letters) <= FEW
    given = f"a word such as {example!r} or {example + '/2T'!r}"
    forms = f"{counts}, {counts}/pT, "
    if free:
        given = f"a word such as {example!r}: without forcing there is no T"
        forms = f"{counts} or "
    accepted = f"give {forms}{given}" if counted else f"give {given}"
    if not isinstance(text, str) or not text:
        raise InputError(where, f"found {short_repr(text)}", accepted)
    if len(text) > 2 * LONGEST_WORD:
        raise InputError(
            where, f"{short_repr(text)} is too long", f"at most {LONGEST_WORD} impacts"
        )
    if free and "/" in text:
        raise InputError(where, f"found {short_repr(text)}", accepted)
    if (match := _NONE.fullmatch(text)) and int(match[1] or 1) > 0:
        return Word("", 0 if free else int(match[1] or 1))
    if match := _COUNTS.fullmatch(text):
        numbers, period = [int(n) for n in match[1].split(":")], int(match[2] or 1)
        if len(numbers) != len(letters):
            raise InputError(
                where, f"{text!r} counts {len(numbers)} walls of {len(letters)}", accepted
            )
        if sum(numbers) * period > LONGEST_WORD:
            raise InputError(where, f"{text!r} is too long", f"at most {LONGEST_WORD} impacts")
        walls = _counting(letters, numbers, graph) * period
    elif match := _LETTERS.fullmatch(text):
        walls, period = match[1], int(match[2] or 1)
        unknown = sorted(set(walls) - set(letters))
        if unknown:
            raise InputError(
                where,
                f"{text!r} has the wall {unknown[0]!r}",
                f"the walls are {', '.join(letters)}",
            )
    else:
        if _SEVERAL.fullmatch(text):
            word = f"{2 * example}/2T"
            accepted = f"it tells no order of its impacts; give the word, such as {word!r}"
        raise InputError(where, f"{short_repr(text)} is not the name of an orbit", accepted)
    if not walls or period < 1 or len(walls) > LONGEST_WORD:
        raise InputError(
            where,
            f"{text!r} has {count_text(len(walls), 'impact')} in {count_text(period, 'period')}",
            f"at least one impact and one period, at most {LONGEST_WORD} impacts",
        )
    if graph is not None and (pair := _forbidden_pair(walls, graph)) is not None:
        found = text if match[0].startswith(walls) else f"{text}, the word {walls},"
        accepted = f"after {pair[0]} can come {' or '.join(graph[pair[0]])}, run around and around"
        raise InputError(where, f"{found} has {pair[1]} after {pair[0]}", accepted)
    return Word(walls, 0 if free else period)


def _counting(
    letters: Sequence[str], numbers: Sequence[int], graph: Mapping[str, str] | None
) -> str:
    """The word that visits each wall so often: one wall after the other, or in turn if it must."""
    counted = list(zip(letters, numbers, strict=True))
    walls = "".join(w * n for w, n in counted)
    if graph is None or _forbidden_pair(walls, graph) is None:
        return walls
    in_turn = "".join(w for i in range(max(numbers)) for w, n in counted if i < n)
    return walls if _forbidden_pair(in_turn, graph) else in_turn


def _forbidden_pair(walls: str, graph: Mapping[str, str]) -> tuple[str, str] | None:
    """The first two letters of a word, run around, that cannot follow each other."""
    pairs = zip(walls, walls[1:] + walls[:1], strict=True)
    return next((pair for pair in pairs if pair[1] not in graph[pair[0]]), None)
