"""Attractors along a parameter: what part of random starts leads to each, and where each ends."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..storage.files import read_bounded
from .catalogue import check_reading

# The table of basin fractions: what part of random starts leads to each motion at each value.

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


@dataclass(frozen=True)
class Bound:
    """Where an attractor begins or ends along the parameter."""

    value: float
    error: float
    """Bound of the value's error; half the bracket's width where only simulation shows it."""
    entry: str | None
    """The event, by its name in the catalogue."""
    text: str
    """What happens there."""

    def __str__(self) -> str:
        return f"{self.value:.9g}: {self.text}"


@dataclass(frozen=True)
class Motion:
    """An attractor over all values at which it is known."""

    notation: str
    branch: str | None
    """Of its orbits; None for motion that simulation alone shows."""
    low: Bound
    high: Bound
    simulated: int
    """How many simulated attractors it is."""
    values: Sequence[float] = field(repr=False)
    speeds: Sequence[float] = field(repr=False)
    """`values`, `speeds`: the largest speed before an impact at rising values."""

    def speed(self, low: float, high: float) -> float:
        """Return the largest impact speed between two values.

        Of orbits it is interpolated between the points of the branch; of simulated motion it is
        that of the values simulated there, or of both neighbours if there are none. Not a number
        without impacts.
        """
        values, speeds = np.array(self.values), np.array(self.speeds)
        if not len(values):
            return math.nan
        if self.branch:
            ends = np.interp([low, high], values, speeds)
        else:
            first, beyond = np.searchsorted(values, (low, high)).tolist()
            ends = speeds[max(first - 1, 0) : first + 1] if first == beyond else []
        inside = speeds[(values >= low) & (values <= high)]
        return float(max([*inside, *ends], default=math.nan))

    def nearest(self, value: float) -> tuple[float, Bound]:
        """Return the distance from a value to the nearer end, and that end."""
        return min(
            ((abs(end.value - value), end) for end in (self.low, self.high)), key=lambda e: e[0]
        )
