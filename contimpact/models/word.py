"""Words: the walls an orbit visits, in order, and the count n:m/pT by which they are known.

``n:m`` counts the impacts on each wall, in the order the model lists its walls, per forcing
period: ``2:1`` is BBT. ``n:m/pT`` is that word run p times with period pT: ``1:1/2T`` is BTBT
over two periods. A word may be written out, alone or with its period: ``BTBT``, ``BTBT/2T``,
``B/3T`` (one impact in three periods).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from ..errors import InputError, shown

LONGEST_WORD = 1000
_COUNTS = re.compile(r"([0-9]+(?::[0-9]+)*)(?:/([0-9]+)T)?")
_LETTERS = re.compile(r"([^\W\d]+)(?:/([0-9]+)T)?")


@dataclass(frozen=True)
class Word:
    """The walls visited and the period in units of T; prints as users write it."""

    walls: str
    period: int = 1

    def __str__(self) -> str:
        return self.walls if self.period == 1 else f"{self.walls}/{self.period}T"

    def __len__(self) -> int:
        return len(self.walls)

    def notation(self, letters: Sequence[str]) -> str:
        """Return the count n:m/pT; in parentheses where it is a total over all p periods."""
        totals = [self.walls.count(letter) for letter in letters]
        p = self.period
        if p == 1:
            return ":".join(map(str, totals))
        if all(total % p == 0 for total in totals):
            return ":".join(str(total // p) for total in totals) + f"/{p}T"
        return f"({':'.join(map(str, totals))})/{p}T"

    def insert(self, flight: int, wall: str) -> Word:
        """Return the word with one more impact, on flight number `flight`."""
        return Word(self.walls[: flight + 1] + wall + self.walls[flight + 1 :], self.period)

    def drop(self, impact: int) -> Word:
        """Return the word without impact number `impact`."""
        return Word(self.walls[:impact] + self.walls[impact + 1 :], self.period)

    def repeated(self) -> list[Word]:
        """Return the shorter words that read as this one if run several times, shortest first."""
        n = len(self)
        return [
            Word(self.walls[:shift], self.period * shift // n)
            for shift in self.rotations()[1:]
            if n % shift == 0 and self.period * shift % n == 0
        ]

    def rotations(self) -> list[int]:
        """Return the cyclic shifts that map the word to itself, 0 among them."""
        doubled = self.walls * 2
        n = len(self)
        return [shift for shift in range(n) if doubled[shift : shift + n] == self.walls]


def is_rotation(one: str, other: str) -> bool:
    """Whether two words are cyclic shifts of each other."""
    return len(one) == len(other) and one in other * 2


def repetitions(notations: Sequence[str]) -> str:
    """Return what orbits are called that are shorter ones, run several times."""
    return f"repetitions of {' and '.join(notations)}"


def parse_word(text: str, letters: Sequence[str], where: str = "word") -> Word:
    """Read an orbit's name.

    Parameters
    ----------
    text : str
        ``n:m``, ``n:m/pT``, a word, or a word and its period.
    letters : sequence of str
        The model's walls, in its order.
    where : str
        The place named in an error.

    Raises
    ------
    InputError
        If it is not the name of an orbit between these walls.
    """
    counts = ":".join("nmkl"[: len(letters)])
    example = "".join(letters)
    accepted = f"give {counts}, {counts}/pT, a word such as {example!r} or {example + '/2T'!r}"
    if not isinstance(text, str) or not text:
        raise InputError(where, f"found {shown(text)}", accepted)
    if len(text) > 2 * LONGEST_WORD:
        raise InputError(where, f"{shown(text)} is too long", f"at most {LONGEST_WORD} impacts")
    if match := _COUNTS.fullmatch(text):
        numbers, period = [int(n) for n in match[1].split(":")], int(match[2] or 1)
        if len(numbers) != len(letters):
            raise InputError(
                where, f"{text!r} counts {len(numbers)} walls of {len(letters)}", accepted
            )
        if sum(numbers) * period > LONGEST_WORD:
            raise InputError(where, f"{text!r} is too long", f"at most {LONGEST_WORD} impacts")
        walls = "".join(w * n for w, n in zip(letters, numbers, strict=True)) * period
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
        raise InputError(where, f"{text!r} is not the name of an orbit", accepted)
    if not walls or period < 1 or len(walls) > LONGEST_WORD:
        raise InputError(
            where,
            f"{text!r} has {_counted(len(walls), 'impact')} in {_counted(period, 'period')}",
            f"at least one impact and one period, at most {LONGEST_WORD} impacts",
        )
    return Word(walls, period)


def _counted(count: int, thing: str) -> str:
    return f"{count} {thing}" if count == 1 else f"{count} {thing}s"
