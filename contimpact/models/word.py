"""Words: the walls an orbit visits, in order, and the count n:m/pT by which they are known.

``n:m`` counts the impacts on each wall, in the order the model lists its walls, per forcing
period: ``2:1`` is BBT. ``n:m/pT`` is that word run p times with period pT: ``1:1/2T`` is BTBT
over two periods. A word may be written out, alone or with its period: ``BTBT``, ``BTBT/2T``,
``B/3T`` (one impact in three periods). Without forcing there is no T, and a word is its letters,
or their count, alone. Where not every wall can follow every other, words are the
closed paths through the graph of modes and guards. ``0`` is the orbit without impacts.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..errors import InputError, short_repr
from .guards import FEW

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
            f"{text!r} has {_count_text(len(walls), 'impact')} in {_count_text(period, 'period')}",
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


def _count_text(count: int, thing: str) -> str:
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"
