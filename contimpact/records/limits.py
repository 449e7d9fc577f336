"""Limits of a scene that cut its computation short: which, and what was left out for them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

LISTED = 12
"""Names that a sentence lists at most; the record has all of them."""


@dataclass(frozen=True)
class Limit:
    """A limit that cut something off.

    Attributes
    ----------
    key : str
        Of the scene, such as ``follow.max_branches``; a larger value goes further.
    value : int
    what : str
        What was left out, in words: orbits not followed, events not switched at, ...
    left_out : sequence of (str, int)
        By name, and how many of each.
    """

    key: str
    value: int
    what: str
    left_out: Sequence[tuple[str, int]]

    def __str__(self) -> str:
        names = [f"{n} ({count})" if count > 1 else n for n, count in self.left_out[:LISTED]]
        more = sum(count for _, count in self.left_out[LISTED:])
        listed = ", ".join(names) + (f", and {more} more" if more else "")
        return f"{self.key} = {self.value} was reached; {self.what}: {listed}; raise it to go on"


@dataclass
class Limits:
    """The limits that were reached, as a computation meets them."""

    found: dict[tuple[str, int, str], Counter[str]] = field(default_factory=dict)

    def reached(self, key: str, value: int, what: str, name: str) -> None:
        """Record something that a limit left out."""
        self.found.setdefault((key, value, what), Counter())[name] += 1

    def listed(self) -> list[Limit]:
        """Return the limits reached, in the order in which they were met."""
        return [Limit(*about, list(names.items())) for about, names in self.found.items()]
