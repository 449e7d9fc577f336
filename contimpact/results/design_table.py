"""The tables [margins] and [design] of a scene: tolerances, and what is maximised and how."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..errors import InputError, short_repr
from ..schema import fit, key
from .options import MOST_STARTS, MOST_TRIES


@dataclass(frozen=True)
class Tolerance:
    """Of a parameter, the change that is one unit of a margin."""

    size: float
    relative: bool = False
    """Whether it is a part of the parameter's value."""

    def at(self, value: float) -> float:
        """Return it at a value of the parameter."""
        return self.size * abs(value) if self.relative else self.size

    def slope(self, value: float) -> float:
        """Return its derivative by the value."""
        return math.copysign(self.size, value) if self.relative else 0.0

    @property
    def given(self) -> float | str:
        """As it is written in a scene."""
        return f"{100.0 * self.size:.12g}%" if self.relative else self.size


def _output(name: str, where: str, here: Any) -> str:
    names = [output.name for output in here.scene.outputs if not output.contacts]
    if name not in names:
        accepted = f"accepted are {', '.join(names)}" if names else "state it in [output]"
        raise InputError(where, f"{short_repr(name)} is no output over time or impacts", accepted)
    return name


def _limits(given: Mapping[str, float], where: str, here: Any) -> Mapping[str, float]:
    return {_output(name, f"{where}.{name}", here): most for name, most in given.items()}


def _bounds(
    given: Mapping[str, tuple[float, float]], where: str, here: Any
) -> dict[str, tuple[float, float]]:
    found = {}
    for name, pair in given.items():
        declared = here.scene.model.require(name, f"{where}.{name}")
        low, high = (declared.check(value, f"{where}.{name}") for value in pair)
        found[name] = low, high
    if not found:
        raise InputError(where, "empty", "give ranges of parameters, s = [0.2, 0.8]")
    return found


def _tolerances(given: Mapping[str, Any], where: str, here: Any) -> dict[str, Tolerance]:
    found = {}
    for name, value in given.items():
        place = f"{where}.{name}"
        here.scene.model.require(name, place)
        relative = isinstance(value, str) and value.rstrip().endswith("%")
        size = fit(value.rstrip()[:-1] if relative else value, float, place)
        if not size > 0.0:
            accepted = 'give a positive number, or a part of the value such as "5%"'
            raise InputError(place, f"found {short_repr(value)}", accepted)
        found[name] = Tolerance(size / 100.0 if relative else size, relative)
    return found


TOLERANCES: Mapping[str, Any] = {
    "doc": "of parameters, the change that is one unit of a margin: a number, or a part of the "
    'value such as `"5%"`',
    "given": Mapping[str, Any],
    "check": _tolerances,
    "write": lambda found: {name: tolerance.given for name, tolerance in found.items()},
}


@dataclass(frozen=True)
class MarginOptions:
    """How far orbits are from the events that end them, as a column of branches."""

    tolerances: Mapping[str, Tolerance] = key(**TOLERANCES)
    within: float = key(
        10.0,
        "the distance up to which events are looked for; where there is none, the column says "
        "`inf`",
        above=0.0,
    )


def _margin(margin: float, where: str, here: Any) -> float:
    if margin < 0.0 or (margin and not here.tolerances):
        accepted = "give a number >= 0" if here.tolerances else "state [design.tolerances], or 0"
        raise InputError(where, f"found {margin:g}", accepted)
    return margin


def _fraction(fraction: float, where: str, here: Any) -> float:
    if not 0.0 <= fraction <= 1.0:
        raise InputError(where, f"found {fraction:g}", "give a number from 0 to 1")
    return fraction


def _chaos(simulations: int, where: str, here: Any) -> int:
    output = next(each for each in here.scene.outputs if each.name == here.maximise)
    if simulations and not (output.at_impacts and here.scene.model.DEGREES_OF_FREEDOM == 1):
        found = f"of complex motion {output.name} is not known"
        accepted = "give an output before_impacts of a system of one coordinate, or chaos = 0"
        raise InputError(where, found, accepted)
    return simulations


@dataclass(frozen=True)
class DesignOptions:
    """What a scene's design is."""

    maximise: str = key(doc="an [output](scene.md#output)", check=_output)
    bounds: Mapping[str, tuple[float, float]] = key(
        doc="of each parameter to choose, such as `s = [0.2, 0.8]`", check=_bounds
    )
    tolerances: Mapping[str, Tolerance] = key(
        {},
        shown="none",
        **TOLERANCES,
    )
    margin: float = key(
        1.0,
        "distance to the nearest event at least; 0 for none",
        usual=lambda here: 1.0 if here.tolerances else 0.0,
        check=_margin,
        shown="1 with tolerances",
    )
    margins: tuple[float, ...] = key(
        (), "margins of the trade-off curve", each=_margin, silent=True
    )
    limits: Mapping[str, float] = key(
        {},
        "of outputs, their largest value along the orbit, or at an impact if they are "
        "`before_impacts`",
        check=_limits,
        shown="none",
    )
    fraction: float = key(
        0.0,
        "part of random starts that has to lead to the orbit; where it does not, the next optimum "
        "is taken",
        check=_fraction,
    )
    fraction_starts: int = key(200, "so many starts", most=MOST_STARTS)
    starts: int = key(
        8, "random points at which orbits of a word are searched for", most=MOST_STARTS
    )
    restarts: int = key(2, "best of these, which are improved", most=MOST_TRIES)
    chaos: int = key(
        0,
        "simulations of a search for complex motion, without margins; its mean has an interval of "
        "95%",
        least=0,
        most=MOST_STARTS,
        check=_chaos,
    )
