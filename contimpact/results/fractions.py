"""The table of basin fractions: what part of random starts leads to each motion at each value."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ..storage.files import read_bounded
from .catalogue import check_reading

FRACTIONS = "contimpact.fractions/1"
"""Schema of ``fractions.csv``."""


class Share(NamedTuple):
    """The part of random starts that leads to a motion at a value."""

    value: float
    notation: str
    fraction: float
    motion: int = 0
    """Number of the motion along the parameter, from 1 on; 0 if it is not known."""
    low: float = 0.0
    high: float = 1.0
    """`low`, `high`: the interval of the fraction."""
    word: str = ""
    period: int = 0
    time: float = math.nan
    velocity: float = math.nan
    """`word`, `period`, `time`, `velocity`: of a periodic motion, with those of its first impact;
    the word is empty otherwise."""
    branch: str | None = None
    """The branch on which this orbit was found to lie."""

    @classmethod
    def of(cls, row: Sequence[Any]) -> Share:
        """Return the share of a row of the table; rows of version 0.2 have no orbits."""
        value, motion, notation, _, part, low, high, *orbit = row
        found = cls(float(value), notation, float(part), int(motion), float(low), float(high))
        if not orbit or not orbit[0]:
            return found
        word, period, time, velocity = orbit
        return found._replace(
            word=word, period=int(period), time=float(time), velocity=float(velocity)
        )


def shorten_names(names: Sequence[str]) -> str:
    """Return the different ones of several notations in order, of many the first and the last."""
    short = list(dict.fromkeys(names))
    return ", ".join(short if len(short) < 5 else [*short[:2], "...", short[-1]])


def read_fractions(path: Path) -> tuple[str, list[Share]]:
    """Return the parameter and the shares of a ``fractions.csv``.

    Raises InputError if it is not of this schema, or damaged.
    """
    with check_reading(path, FRACTIONS):
        head, _, table = read_bounded(path).decode().partition("\n")
        if json.loads(head.removeprefix("# ")).get("schema") != FRACTIONS:
            raise ValueError("another schema")
        (parameter, *_), *rows = csv.reader(io.StringIO(table))
        return parameter, [Share.of(row) for row in rows]
