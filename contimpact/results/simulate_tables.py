"""The table [simulate] of a scene: what to simulate, and until when."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from ..errors import InputError, short_repr
from ..schema import key
from .options import LARGEST_SEED, MOST_STARTS

DIRECTIONS = ("down", "up", "both")
SPACINGS = ("even", "reciprocal")
MOST_VALUES = 100_000
LARGEST_GRID = 1000
MOST_FRACTION_STARTS = 1_000_000
MOST_ROUNDS = 10
PART = 1e-6
"""Of the range, to which transitions are located."""


@dataclass(frozen=True)
class Settling:
    """How long to wait for an attractor, and when one is taken for granted."""

    transient: int = key(100, "forcing periods dropped at each value", least=0, most=10**8)
    periods: int = key(
        2000, "further periods within which periodic motion is recognised", most=10**8
    )
    longest: int = key(128, "impacts that a period may have", most=100_000)
    impacts: int = key(
        4000, "impacts from which exponents of other motion are computed", least=20, most=10**7
    )
    tolerance: float = key(
        1e-9, "distance from a periodic orbit at which the motion has reached it", above=0
    )


SETTLING = Settling()


def _range(limits: tuple[float, float], where: str, here: Any) -> tuple[float, float]:
    declared = here.scene.model.require(here.scene.parameter, where)
    low, high = (declared.check(value, where) for value in limits)
    return low, high


def _value(value: float, where: str, here: Any) -> float:
    """A value of the followed parameter."""
    return float(here.scene.model.require(here.scene.parameter, where).check(value, where))


def _spacing(spacing: str, where: str, here: Any) -> str:
    low, high = here.range
    if spacing not in SPACINGS or (spacing != "even" and not low * high > 0.0):
        accepted = f"accepted are {', '.join(SPACINGS)}; reciprocals need a range without zero"
        raise InputError(where, f"found {spacing!r}", accepted)
    return spacing


def _crises(asked: bool, where: str, here: Any) -> bool:
    if asked and not here.branches:
        found = "true, but branches are not followed"
        accepted = "set simulate.branches = true: crises belong to unstable orbits on branches"
        raise InputError(where, found, accepted)
    return asked or (here.branches and here.scene.crises)


def check_pairs(where: str, given: Any, count: int) -> tuple[tuple[float, float], ...]:
    """Return as many pairs (low, high) of numbers, of which one may stand alone.

    Raises InputError if they are none.
    """
    rows = [given] if count == 1 and _is_pair(given) else given
    if not (isinstance(rows, Sequence) and len(rows) == count and all(map(_is_pair, rows))):
        accepted = "give low and high, low first" + (
            f" for each coordinate: {count} pairs" * (count > 1)
        )
        raise InputError(where, f"found {short_repr(given)}", accepted)
    return tuple((float(low), float(high)) for low, high in rows)


def _is_pair(given: Any) -> bool:
    numbers = isinstance(given, Sequence) and not isinstance(given, str) and len(given) == 2
    return (
        numbers
        and all(
            isinstance(x, (int, float)) and not isinstance(x, bool) and math.isfinite(x)
            for x in given
        )
        and given[0] <= given[1]
    )


def _box(given: Mapping[str, Any], where: str, here: Any) -> Mapping[str, Any]:
    """The table of starts: pairs of numbers."""
    for name, value in given.items():
        if name not in ("time", "position", "velocity"):
            found = f"unknown key {short_repr(name)}"
            raise InputError(where, found, "accepted are time, position and velocity")
        count = 1 if name == "time" else here.scene.model.DEGREES_OF_FREEDOM
        check_pairs(f"{where}.{name}", value, count)
    return dict(given)


@dataclass(frozen=True)
class SimulateOptions:
    """What to simulate."""

    range: tuple[float, float] = key(
        doc="values of the followed parameter, lower one first",
        usual=lambda here: here.scene.range,
        check=_range,
        shown="`follow.range`",
    )
    values: int = key(
        101, "how many values, evenly spaced, both ends among them", least=2, most=MOST_VALUES
    )
    direction: str = key(
        "down",
        '`"down"` for falling values, `"up"` for rising ones, `"both"` for one sweep each',
        choices=DIRECTIONS,
    )
    starts: int = key(
        0, "random starts at each value, in addition to the sweep", least=0, most=MOST_STARTS
    )
    seed: int = key(
        0, "of the first start of a sweep and of the random starts", least=0, most=LARGEST_SEED
    )
    transitions: bool | tuple[int, ...] = key(
        True,
        "whether changes of the attractor are located and named; with a list, those from or to "
        "motion of these periods, as `[1, 2]`",
        accepted="true, false, or a list of periods such as [1, 2]",
    )
    width: float = key(
        PART,
        "width to which they are located, in the parameter's unit",
        above=0,
        usual=lambda here: PART * (here.range[1] - here.range[0]),
        shown="1e-6 of the range",
    )
    branches: bool = key(False, "whether the scene's branches are also followed, and compared")
    portraits: tuple[float, ...] = key(
        (), "values at which phase plane and time series are drawn", each=_value
    )
    basins: tuple[float, ...] = key(
        (), "values at which basins of attraction are drawn", each=_value
    )
    grid: int = key(40, "starts along each side of a basin's picture", least=2, most=LARGEST_GRID)
    losses: bool = key(False, "whether the energy that impacts take is computed")
    crises: bool = key(
        False,
        "whether [crises](crises.md) are located where complex motion ends; needs "
        "`branches = true`",
        check=_crises,
    )
    fractions: tuple[float, ...] = key(
        (),
        "values at which random starts are [counted](simulate.md#basin-fractions) by the motion "
        "that they lead to",
        each=_value,
    )
    fraction_starts: int = key(1000, "starts at each of these values", most=MOST_FRACTION_STARTS)
    refine: int = key(
        0,
        "how often values are put half way between neighbours whose fractions differ by more than "
        "both intervals",
        least=0,
        most=MOST_ROUNDS,
    )
    box: Mapping[str, Any] = key(
        {},
        "where these motions start: `time`, `position`, `velocity`, each (low, high), for several "
        "coordinates a list of pairs",
        check=_box,
        accepted="a table of time, position and velocity",
    )
    spacing: str = key(
        "even",
        '`"even"`, or `"reciprocal"` for values whose reciprocals are evenly spaced, where '
        "`plot.x` is inversely proportional to the parameter, as d is to A",
        check=_spacing,
    )
    settling: Settling = key(SETTLING, inline={f.name: {} for f in fields(Settling)})

    def rising(self) -> list[float]:
        """Return the values swept, lowest first."""
        import numpy as np

        low, high = self.range
        if self.spacing == "even":
            return np.linspace(low, high, self.values).tolist()
        inner = 1.0 / np.linspace(1.0 / low, 1.0 / high, self.values)[1:-1]
        return [low, *inner.tolist(), high]

    def sweeps(self) -> list[tuple[str, list[float]]]:
        """Return each sweep's direction and its values in order."""
        rising = self.rising()
        ways = {"down": rising[::-1], "up": rising}
        names = ("down", "up") if self.direction == "both" else (self.direction,)
        return [(name, ways[name]) for name in names]
