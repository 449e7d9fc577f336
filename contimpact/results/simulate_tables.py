"""The tables [simulate] and [energy] of a scene; imported only where a scene has one of them.

They are read without what simulates: ``contimpact run`` validates them and leaves them out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..models.model import Model
from .options import LARGEST_SEED, MOST_STARTS, Table, short_repr

if TYPE_CHECKING:
    from ..systems.membrane import Membrane

DIRECTIONS = ("down", "up", "both")
SPACINGS = ("even", "reciprocal")
MOST_VALUES = 100_000
LARGEST_GRID = 1000
MOST_FRACTION_STARTS = 1_000_000
MOST_ROUNDS = 10
SETTLING_BOUNDS = {
    "transient": (0, 10**8),
    "periods": (1, 10**8),
    "longest": (1, 100_000),
    "impacts": (20, 10**7),
}
"""Least and most of the whole numbers of `Settling`."""


@dataclass(frozen=True)
class Settling:
    """How long to wait for an attractor, and when one is taken for granted."""

    transient: int = 100
    """Forcing periods dropped at first."""
    periods: int = 2000
    """Further periods within which a periodic motion has to show itself."""
    longest: int = 128
    """Impacts that a period may have."""
    impacts: int = 4000
    """Impacts from which exponents of other motions are computed."""
    tolerance: float = 1e-9
    """Distance from a periodic orbit at which a motion has reached it."""


SETTLING = Settling()


@dataclass(frozen=True)
class SimulateOptions:
    """What to simulate."""

    range: tuple[float, float]
    """Range of the followed parameter."""
    values: int = 101
    """Values swept, both ends among them."""
    direction: str = "down"
    """``down`` for falling values of the parameter, ``up`` for rising ones, or ``both``."""
    settling: Settling = SETTLING
    starts: int = 0
    """Random starts at each value, besides the sweep's own."""
    seed: int = 0
    transitions: bool | tuple[int, ...] = True
    """Whether to bisect in the parameter where the attractor changes; or the periods of motions of
    which the changes are located."""
    width: float = 1e-6
    """Width to which transitions are bisected, in the parameter's unit."""
    branches: bool = False
    """Whether the scene's branches are followed too, to compare with."""
    portraits: tuple[float, ...] = ()
    """Values at which phase portraits and time series are drawn."""
    basins: tuple[float, ...] = ()
    """Values at which basins of attraction are drawn."""
    grid: int = 40
    """Starts along each side of a basin's picture."""
    losses: bool = False
    """Whether the kinetic energy that impacts take is told, too."""
    crises: bool = False
    """Whether crises are located where complex motion ends; needs the branches."""
    fractions: tuple[float, ...] = ()
    """Values at which random starts are counted by the motion that they lead to."""
    fraction_starts: int = 1000
    refine: int = 0
    """How often values are put between those of `fractions` where these differ."""
    box: Mapping[str, Any] = field(default_factory=dict)
    """Where these motions start; see `contimpact.simulation.fractions.start_box`."""
    spacing: str = "even"
    """``even``, or ``reciprocal`` for values whose reciprocals are evenly spaced, as where the
    drawn quantity is inversely proportional to the parameter."""

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

    def resolved(self) -> dict[str, Any]:
        """Return the options as a scene would write them."""
        flat = asdict(self) | asdict(self.settling)
        del flat["settling"]
        return {k: list(v) if isinstance(v, tuple) else v for k, v in flat.items()}


def read_simulate(
    table: Table, model: Model, parameter: str, limits: tuple[float, float]
) -> SimulateOptions:
    """Validate the table [simulate].

    Raises InputError if a key is unknown, of a wrong type or inadmissible.

    Parameters
    ----------
    table : Table
        Of the scene.
    parameter : str
        The followed parameter.
    limits : (low, high)
        Of the branches; the default range.
    """
    declared = model.require(parameter, "follow.parameter")
    low, high = limits
    if given := table.optional_pair("range"):
        low, high = (declared.check(v, "simulate.range") for v in given)
    direction = table.text("direction", "down")
    if direction not in DIRECTIONS:
        raise InputError(
            "simulate.direction", f"found {direction!r}", f"accepted are {', '.join(DIRECTIONS)}"
        )
    spacing = table.text("spacing", "even")
    if spacing not in SPACINGS or (spacing != "even" and not low * high > 0.0):
        accepted = f"accepted are {', '.join(SPACINGS)}; reciprocals need a range without zero"
        raise InputError("simulate.spacing", f"found {spacing!r}", accepted)
    points = {
        key: tuple(
            declared.check(v, f"simulate.{key}[{i}]")
            for i, v in enumerate(table.optional_numbers(key))
        )
        for key in ("portraits", "basins", "fractions")
    }
    options = SimulateOptions(
        (low, high),
        table.whole("values", 101, least=2, most=MOST_VALUES),
        direction,
        _settling(table),
        table.whole("starts", 0, least=0, most=MOST_STARTS),
        table.whole("seed", 0, least=0, most=LARGEST_SEED),
        _transitions(table),
        _positive_number(table, "width", 1e-6 * (high - low)),
        table.truth("branches", False),
        points["portraits"],
        points["basins"],
        table.whole("grid", 40, least=2, most=LARGEST_GRID),
        table.truth("losses", False),
        table.truth("crises", False),
        points["fractions"],
        table.whole("fraction_starts", 1000, least=1, most=MOST_FRACTION_STARTS),
        table.whole("refine", 0, least=0, most=MOST_ROUNDS),
        _box(table, model),
        spacing,
    )
    if options.crises and not options.branches:
        raise InputError(
            "simulate.crises",
            "true, but branches are not followed",
            "set simulate.branches = true: crises belong to unstable orbits on branches",
        )
    table.finish()
    return options


def _box(table: Table, model: Model) -> Mapping[str, Any]:
    """The table of starts: pairs of numbers."""
    accepted = "a table of time, position and velocity"
    given = table.take("box", {}, accepted)
    if not isinstance(given, Mapping):
        raise table.refuse("box", given, accepted)
    for key, value in given.items():
        if key not in ("time", "position", "velocity"):
            found = f"unknown key {short_repr(key)}"
            raise InputError(table.place("box"), found, f"accepted are {accepted[11:]}")
        count = 1 if key == "time" else model.DEGREES_OF_FREEDOM
        check_pairs(f"{table.place('box')}.{key}", value, count)
    return dict(given)


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


def _transitions(table: Table) -> bool | tuple[int, ...]:
    accepted = "true, false, or a list of periods such as [1, 2]"
    value = table.take("transitions", True, accepted)
    if isinstance(value, bool):
        return value
    if not isinstance(value, list) or not all(type(p) is int and p > 0 for p in value):
        raise table.refuse("transitions", value, accepted)
    return tuple(table.distinct("transitions", value))


def _positive_number(table: Table, key: str, default: float) -> float:
    value = table.number(key, default)
    if not value > 0.0:
        raise InputError(table.place(key), f"found {value!r}", "give a number > 0")
    return value


def _settling(table: Table) -> Settling:
    defaults = asdict(SETTLING)
    chosen: dict[str, Any] = {
        key: table.whole(key, defaults[key], least=least, most=most)
        for key, (least, most) in SETTLING_BOUNDS.items()
    }
    return Settling(**chosen, tolerance=_positive_number(table, "tolerance", defaults["tolerance"]))


def read_energy(table: Table, model: Model) -> Membrane:
    """Validate the table [energy].

    Raises InputError if a key is unknown, of a wrong type or inadmissible, or the system has no
    membranes.
    """
    if not model.MEMBRANES:
        raise InputError(
            "energy", f"the system {model.SYSTEM} has no membranes", "leave [energy] out"
        )
    from ..systems.membrane import Membrane

    defaults = Membrane()
    chosen = {
        key.name: table.number(key.name, getattr(defaults, key.name)) for key in fields(Membrane)
    }
    table.finish()
    try:
        return Membrane(**chosen)
    except InputError as error:
        raise error.within("energy") from None
