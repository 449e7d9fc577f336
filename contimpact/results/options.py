"""The tables of a scene that say what else is asked for: [plot], [curves], [certify]."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ..bifurcations.declarations import CURVES
from ..continuation.settings import Settings
from ..errors import InputError
from ..models.model import Model
from ..schema import Table, key

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
        if text not in (accepted := known(here)):
            found = f"{text!r} {what}" if what else f"found {text!r}"
            raise InputError(where, found, f"accepted are {', '.join(accepted)}")
        return text

    return check


def range_around_start(
    limits: tuple[float, float], where: str, model: Model, name: str
) -> tuple[float, float]:
    """Return the range of a parameter if it is admitted and holds the value at the start."""
    declared, start = model.require(name, where), model.values[name]
    low, high = (declared.check(value, where) for value in limits)
    if not low <= start <= high:
        found = f"[{low:.12g}, {high:.12g}] does not hold the start {name} = {start:.12g}"
        raise InputError(where, found, f"widen it or change model.parameters.{name}")
    return low, high


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
    return name, range_around_start(limits, table.place("range"), here.scene.model, name)


@dataclass(frozen=True, kw_only=True)
class CurveOptions:
    """Which curves to follow in a second parameter."""

    parameter: str = key(
        doc="the second parameter; another one than `follow.parameter`", check=_second_parameter
    )
    range: tuple[float, float] = key(
        doc="its range; it contains the scene's own value",
        check=lambda limits, where, here: range_around_start(
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
