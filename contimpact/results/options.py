"""The tables of a scene that say what else is asked for, from [plot] to [simulate]."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from ..bifurcations.declarations import CURVES
from ..continuation.settings import Settings, require_width
from ..errors import InputError, require_known, short_repr
from ..models.model import Model, require_forcing
from ..schema import Table, fit, key

CURVE_SETTINGS = Settings(tolerance=1e-13, max_step=0.05, max_points=1000)
"""Numerics of curves in two parameters."""
FORMATS = ("svg", "png", "pdf")
SHOWN = ("period-1", "all", "none")
LABELS = ("all", "period-1", "real", "none")
QUANTITIES = ("velocity", "multipliers", "moduli", "energy", "U_I", "U_T", "gap", "period")
VOLTAGES = ("energy", "U_I", "U_T")
MOST_BITS = 4096
"""Largest precision of proofs."""
LARGEST_SEED = 2**63 - 1
MOST_POINTS = 10**9
MOST_STARTS = 100_000
MOST_TRIES = 1000
"""Largest number of corrector iterations, of rounds of the search, and of successive switches."""
MOST_LINES = 1000
MOST_BRANCHES = 100_000


def one_of(known: Callable[[Any], Sequence[str]], what: str = "") -> Callable[..., str]:
    """Return a check that a text is one of those that hold where it is."""

    def check(text: str, where: str, here: Any) -> str:
        require_known(text, known(here), where, f"{text!r} {what}" if what else None)
        return text

    return check


def check_range(
    model: Model,
    name: str,
    start: float,
    limits: Any,
    where: str = "",
    remedy: str = "give low < high around the start",
) -> tuple[float, float]:
    """Return the range of a parameter if it is admitted and holds the value at the start."""
    where = where or f"range of {name}"
    declared = model.require(name, "parameter")
    if not hasattr(limits, "__getitem__") or len(limits) != 2:
        found = "missing" if limits is None else f"found {short_repr(limits)}"
        raise InputError(where, found, f"give (low, high), values of {name}")
    low, high = (declared.check(value, where) for value in limits)
    if not low <= start <= high:
        found = f"[{low:.12g}, {high:.12g}] does not hold the start {name} = {start:.12g}"
        raise InputError(where, found, remedy)
    require_width(low, high, where)
    return low, high


def range_in_scene(
    limits: tuple[float, float], where: str, model: Model, name: str
) -> tuple[float, float]:
    """Return the range of a parameter that a key gives, as `check_range`."""
    remedy = f"widen it or change model.parameters.{name}"
    return check_range(model, name, model.values[name], limits, where, remedy)


def within(
    values: Sequence[float], where: str, limits: tuple[float, float], which: str
) -> Sequence[float]:
    """Return values if all are in a range, which a key gives."""
    low, high = limits
    for i, value in enumerate(values):
        if not low <= value <= high:
            accepted = f"give a value from {low:.12g} to {high:.12g}"
            raise InputError(f"{where}[{i}]", f"{value:.12g} is outside {which}", accepted)
    return values


def _quantity(name: str, where: str, here: Any) -> str:
    known = (*QUANTITIES, *(output.name for output in here.scene.outputs))
    known += ("margin",) if here.scene.margins else ()
    one_of(lambda _: known)(name, where, here)
    if name in VOLTAGES and not here.scene.model.MEMBRANES:
        found = f"{name!r}, and the system {here.scene.model.SYSTEM} has no membranes"
        raise InputError(where, found, "give another quantity")
    return name


def _margin(margin: float | None, where: str, here: Any) -> float | None:
    if margin is not None and not here.scene.margins:
        raise InputError(where, "no table [margins]", "state its tolerances")
    return margin


@dataclass(frozen=True)
class PlotOptions:
    """How the diagram is drawn."""

    x: str = key(
        doc="the followed parameter or a derived one",
        usual=lambda here: here.scene.parameter,
        check=one_of(
            lambda here: here.scene.model.varying(here.scene.parameter),
            "does not vary along the branches",
        ),
        shown="the followed parameter",
    )
    xlim: tuple[float, float] | None = key(None, "limits of the x axis", shown="all")
    ylim: tuple[float, float] | None = key(None, "limits of the y axis", shown="all in `xlim`")
    unphysical: str = key(
        "period-1",
        'where unphysical orbits and their events are drawn: `"period-1"`, on branches of period '
        'T, without branches that are physical nowhere if others are; `"all"`; `"none"`',
        choices=SHOWN,
        usual=lambda here: "period-1" if here.scene.model.few_guards else "none",
        shown='`"period-1"`; `"none"` for systems of more than two guards',
    )
    formats: tuple[str, ...] = key(
        ("svg", "png"), "files to draw, of svg, png, pdf; `[]` for none", choices=FORMATS
    )
    labels: str = key(
        "all",
        'which events are labelled: `"all"`; `"period-1"`, those of orbits of period T; `"real"`, '
        'those that are no ghosts; `"none"`',
        choices=LABELS,
    )
    margin: float | None = key(
        None,
        "stretches of stable orbits with a smaller margin are shaded; with `[margins]`",
        above=0.0,
        check=_margin,
        silent=True,
    )
    html: bool = key(
        False, "whether [the page](page.md) `diagram.html` is also written", silent=True
    )
    y: str = key(
        "velocity",
        '`"velocity"` before each impact; `"multipliers"`, their real parts; `"moduli"` of the '
        'multipliers; `"energy"`, the output voltage of each impact, and `"U_I"`, `"U_T"`, its '
        'means, with the membranes of `[energy]`; `"gap"`, the smallest one; `"period"`; '
        '`"margin"`, with `[margins]`; or an output',
        check=_quantity,
    )


def _second_parameter(name: str, where: str, here: Any) -> str:
    here.scene.model.require(name, where)
    if name == here.scene.parameter:
        raise InputError(where, f"{name} is followed already", "give another one")
    return name


def _curve_kind(kind: str, where: str, here: Any) -> str:
    looked_for = [k for k in CURVES if k in here.scene.events]
    if kind not in looked_for:
        accepted = f"accepted are those of {', '.join(CURVES)} that detect.events names: "
        raise InputError(where, f"found {kind!r}", accepted + (", ".join(looked_for) or "none"))
    return kind


def _family(
    given: Mapping[str, tuple[float, ...]], where: str, here: Any
) -> tuple[str, tuple[float, ...]] | None:
    """One parameter and the values it takes."""
    if not given:
        return None
    (name, values), *others = given.items()
    declared = here.scene.model.require(name, f"{where}.{name}")
    if name in (here.scene.parameter, here.parameter):
        raise InputError(f"{where}.{name}", "it is followed already", "give another one")
    if others:
        raise InputError(f"{where}.{others[0][0]}", "a second parameter", f"give {name} alone")
    if not values:
        raise InputError(f"{where}.{name}", "empty", "give at least one value")
    return name, tuple(declared.check(value, f"{where}.{name}") for value in values)


def _third(
    given: Mapping[str, Any], where: str, here: Any
) -> tuple[str, tuple[float, float]] | None:
    """A further parameter and its range."""
    if not given:
        return None
    table = Table(given, where)
    name = table.get("parameter", str)
    here.scene.model.require(name, table.place("parameter"))
    if name in (here.scene.parameter, here.parameter):
        found = f"{name} is followed already"
        raise InputError(table.place("parameter"), found, "give another one")
    limits = table.get("range", tuple[float, float])
    table.finish()
    return name, range_in_scene(limits, table.place("range"), here.scene.model, name)


@dataclass(frozen=True, kw_only=True)
class CurveOptions:
    """Which curves to follow in a second parameter."""

    parameter: str = key(
        doc="the second parameter; another one than `follow.parameter`", check=_second_parameter
    )
    range: tuple[float, float] = key(
        doc="its range; it contains the scene's own value",
        check=lambda limits, where, here: range_in_scene(
            limits, where, here.scene.model, here.parameter
        ),
    )
    kinds: tuple[str, ...] = key(
        ("PD", "G"),
        "kinds of entries at which curves start: FB, BP, PD, NS, G, V, UZ, if `detect.events` "
        "names them",
        check=lambda kinds, where, here: tuple(
            _curve_kind(kind, f"{where}[{i}]", here) for i, kind in enumerate(kinds)
        ),
    )
    unphysical: tuple[str, ...] = key(
        (),
        "the kinds of which curves also start on orbits that are unphysical for another reason: "
        "all, none, or those named",
        given=bool | tuple[str, ...],
        accepted="true, false, or a list of texts",
        shown="false",
        each=one_of(lambda here: here.kinds),
        check=lambda given, where, here: (
            given if isinstance(given, tuple) else here.kinds if given else ()
        ),
    )
    values: tuple[float, ...] = key((), "values of the second parameter to hit exactly")
    start: tuple[float, ...] = key(
        (),
        "further values of the second parameter at which curves start, and are "
        "[checked](curves.md#competition)",
        check=lambda values, where, here: within(values, where, here.range, "curves.range"),
    )
    cover: int = key(
        0,
        "make the map [complete](curves.md#completeness): how many lines in each direction must "
        "find nothing new; 0 for no lines",
        least=0,
        most=MOST_LINES,
    )
    areas: bool = key(
        False, "divide the rectangle into [areas](curves.md#areas) by what ends the stable orbits"
    )
    reach: int = key(
        doc="how many words away from the scene's the orbits may be whose curves start at "
        "[points of codimension two](curves.md#completeness); with 0 only the scene's words have "
        "curves",
        least=0,
        most=MOST_TRIES,
        usual=lambda here: max(1, here.scene.depth if here.scene.switch else 0),
        shown="`follow.depth` if it switches, or 1",
    )
    settings: Settings = key(
        CURVE_SETTINGS,
        inline={
            "step": {},
            "max_step": {},
            "max_points": {"least": 2, "doc": "points of one curve in one direction"},
        },
    )
    family: tuple[str, tuple[float, ...]] | None = key(
        None,
        "a third parameter and the values for which everything is repeated",
        given=Mapping[str, tuple[float, ...]],
        check=_family,
        write=lambda family: {family[0]: list(family[1])} if family else {},
    )
    third: tuple[str, tuple[float, float]] | None = key(
        None,
        "`parameter` and `range` of a third parameter, in which [points of codimension two]"
        "(curves.md#three-parameters) are followed; the range contains the scene's own value",
        given=Mapping[str, Any],
        check=_third,
        write=lambda third: {"parameter": third[0], "range": list(third[1])} if third else {},
    )


@dataclass(frozen=True)
class CertifyOptions:
    """What ``contimpact certify`` proves."""

    bits: int = key(128, "initial precision", least=53, most=MOST_BITS)
    max_bits: int = key(
        512,
        "precision up to which it is doubled",
        least=lambda here: here.bits,
        most=MOST_BITS,
        check=lambda bits, where, here: max(bits, here.bits),
        shown="512, or `bits`",
    )
    branches: bool = key(True, "whether branches are proven complete")
    events: tuple[str, ...] = ("FB", "PD", "G")
    """Kinds of events that are certified; by default those the scene looks for."""
    seconds: float = key(
        600.0,
        "processor time for the proof of one branch; what is left is `unproven`, for that reason",
        above=0,
    )


# The table [simulate] of a scene: what to simulate, and until when.

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


def _of_forcing(asked: Any, where: str, here: Any) -> Any:
    """What is counted in phases or periods of a forcing, if it is asked for."""
    if asked and asked is not True:
        require_forcing(here.scene.model, where, "it is counted in", "leave it out")
    return asked


def _crises(asked: bool, where: str, here: Any) -> bool:
    if asked:
        require_forcing(here.scene.model, where, "crises have a phase in", "leave it out")
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


def check_box(
    given: Mapping[str, Any], where: str, count: int
) -> dict[str, tuple[tuple[float, float], ...]]:
    """Return the pairs of a table of starts of so many coordinates, by its keys."""
    for name in given:
        found = f"unknown key {short_repr(name)}"
        require_known(name, ("time", "position", "velocity"), where, found)
    return {
        name: check_pairs(f"{where}.{name}", value, 1 if name == "time" else count)
        for name, value in given.items()
    }


def _box(given: Mapping[str, Any], where: str, here: Any) -> Mapping[str, Any]:
    check_box(given, where, here.scene.model.DEGREES_OF_FREEDOM)
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
        check=_of_forcing,
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
        (), "values at which basins of attraction are drawn", each=_value, check=_of_forcing
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
        check=_of_forcing,
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


# The tables [margins] and [design] of a scene: tolerances, and what is maximised and how.


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


def _read_tolerances(given: Mapping[str, Any], where: str, model: Model) -> dict[str, Tolerance]:
    found = {}
    for name, value in given.items():
        place = f"{where}.{name}"
        model.require(name, place)
        relative = isinstance(value, str) and value.rstrip().endswith("%")
        size = fit(value.rstrip()[:-1] if relative else value, float, place)
        if not size > 0.0:
            accepted = 'give a positive number, or a part of the value such as "5%"'
            raise InputError(place, f"found {short_repr(value)}", accepted)
        found[name] = Tolerance(size / 100.0 if relative else size, relative)
    return found


def _tolerances(given: Mapping[str, Any], where: str, here: Any) -> dict[str, Tolerance]:
    return _read_tolerances(given, where, here.scene.model)


def _some_tolerances(given: Mapping[str, Any], where: str, here: Any) -> dict[str, Tolerance]:
    if not given:
        raise InputError(where, "empty", 'give some of parameters, such as { s = "5%" }')
    return _tolerances(given, where, here)


def tolerance_sizes(given: Mapping[str, Any], model: Model) -> dict[str, float]:
    """Return what changes of parameters count as one at a model's values; raise InputError where
    one is not positive, or there are none."""
    found = _read_tolerances(given, "tolerances", model)
    sizes = {name: tolerance.at(model.values[name]) for name, tolerance in found.items()}
    for name, size in (sizes or {"": 0.0}).items():
        if not size > 0.0:
            accepted = "give positive tolerances of parameters, such as {'r': 0.01}"
            raise InputError("tolerances", f"{name} 0" if name else "{}", accepted)
    return sizes


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

    tolerances: Mapping[str, Tolerance] = key(**{**TOLERANCES, "check": _some_tolerances})
    within: float = key(
        10.0,
        "the distance up to which events are looked for; where there is none, the column says "
        "`inf`",
        above=0.0,
    )


def _wanted_margin(margin: float, where: str, here: Any) -> float:
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
    tolerances: Mapping[str, Tolerance] = key({}, shown="none", **TOLERANCES)
    margin: float = key(
        1.0,
        "distance to the nearest event at least; 0 for none",
        usual=lambda here: 1.0 if here.tolerances else 0.0,
        check=_wanted_margin,
        shown="1 with tolerances",
    )
    margins: tuple[float, ...] = key(
        (), "margins of the trade-off curve", each=_wanted_margin, silent=True
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
        "part of random starts, in `simulate.box`, that has to lead to the orbit, or a mirror "
        "image of equal output; if not, the next optimum is taken",
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
