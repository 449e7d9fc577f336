"""The tables of a scene, read one by one.

Every mistake is refused with the path of its key, what was found and what would do.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields, replace
from typing import TYPE_CHECKING, Any

from ..bifurcations.declarations import (
    CONTINUED,
    CURVES,
    KINDS,
    SWITCHES,
    unknown_kind,
    usual_events,
    wanted_kinds,
)
from ..continuation.settings import Settings
from ..errors import InputError, short_repr
from ..models.model import Model
from ..models.outputs import Output, check_output
from ..systems import system
from .options import (
    CURVE_SETTINGS,
    FORMATS,
    LABELS,
    LARGEST_SEED,
    LARGEST_TOLERANCE,
    MOST_BITS,
    MOST_BRANCHES,
    MOST_LINES,
    MOST_POINTS,
    MOST_STARTS,
    MOST_TRIES,
    QUANTITIES,
    REQUIRED,
    SCENE_SETTINGS,
    SHOWN,
    VOLTAGES,
    CertifyOptions,
    CurveOptions,
    PlotOptions,
    Table,
)

if TYPE_CHECKING:
    from ..models.machine import Machine
    from ..models.stated_modes import StatedModes
    from ..systems.membrane import Membrane
    from .simulate_tables import SimulateOptions


OUTPUT_ERROR = "_error"
"""Ends the name of the column with the error estimates of a mean."""
_COLUMNS = re.compile(
    rf"arclength|residual|iterations|reason|event|physical|n_unstable|smallest_gap|"
    rf"[a-z]+\d+|\w*(_re|_im|{OUTPUT_ERROR})|{'|'.join(QUANTITIES)}"
)
"""Names that columns of branches and quantities have."""


def read_machine(table: Table, kind: type[Model]) -> Model:
    """Return the machine that [model] states."""
    from ..models.machine import machine_of_table

    lists = {name: table.take(name, REQUIRED, "a list") for name in ("coordinates", "mass")}
    size = len(lists["coordinates"]) if isinstance(lists["coordinates"], list) else 1
    given = {
        **lists,
        "damping": table.take("damping", [0] * size, "a list"),
        "stiffness": table.take("stiffness", [0] * size, "a list"),
        "force": table.take("force", REQUIRED, "a list of expressions in t"),
        "period": table.take("period", REQUIRED, "the forcing period"),
        "guards": table.table("guards").data,
    }
    return _complete_system(table, kind, lambda names: machine_of_table(given, names))


def read_modes(table: Table, kind: type[Model]) -> Model:
    """Return the hybrid system that [model] states."""
    from ..models.stated_modes import modes_of_table

    given = {name: table.table(name).data for name in ("modes", "guards")}
    given |= {name: table.table(name, optional=True).data for name in ("define", "mass")}
    given["period"] = table.take("period", REQUIRED, "the forcing period")
    return _complete_system(table, kind, lambda names: modes_of_table(given, names))


STATEMENTS = {"linear": read_machine, "hybrid": read_modes}
"""Readers of the systems that scenes state themselves."""


def _complete_system(
    table: Table, kind: type[Model], state: Callable[[list[str]], Machine | StatedModes]
) -> Model:
    """The system that the names of its parameters complete; each has to stand in it."""
    from ..models.machine import check_use

    parameters = table.table("parameters")
    values = {name: parameters.number(name) for name in parameters.data}
    table.finish()
    try:
        machine = state(list(values))
        model = kind(machine=machine.text, **values)
        check_use(machine.parameters, machine.expressions)
        return model
    except InputError as error:
        inside = "model.parameters" if error.where in values else "model"
        raise error.within(inside) from None


def read_model(table: Table, systems: Mapping[str, type[Model]] | None = None) -> Model:
    """Return the model of [model] at the start's parameter values."""
    kind = system(table.text("system"), "model.system", systems)
    if kind.STATED and "machine" not in table.data:
        return STATEMENTS[kind.SYSTEM](table, kind)
    options = {name: table.text(name, default) for name, default in kind.OPTIONS.items()}
    if table.has("period"):
        options["period"] = table.text("period")
    given = table.table("parameters")
    for name in options:
        if name in given.data:
            raise InputError(
                given.place(name), "not a parameter but an option", f"give it as model.{name}"
            )
    values = {name: given.number(name) for name in list(given.data)}
    table.finish()
    try:
        return kind(**values, **options)
    except InputError as error:
        named = error.where in options or error.where == "parameters"
        inside = "model" if named else "model.parameters"
        raise error.within(inside) from None


def read_reach(follow: Table, model: Model, events: Sequence[str]) -> dict[str, Any]:
    """Return how far to follow what is born on the branches, from [follow].

    Unless it says otherwise, the motion is followed where it continues on another word at one of
    the events looked for.
    """
    switch = follow.texts("switch", [kind for kind in CONTINUED if kind in events])
    for i, kind in enumerate(switch):
        if kind not in SWITCHES:
            accepted = f"accepted are {', '.join(SWITCHES)}"
            raise InputError(
                f"follow.switch[{i}]", f"cannot switch at {short_repr(kind)}", accepted
            )
        if kind not in events:
            found = f"{kind} is not among the events looked for"
            accepted = f"add it to detect.events, which has {', '.join(events) or 'none'}"
            raise InputError(f"follow.switch[{i}]", found, accepted)
    return {
        "switch": tuple(switch),
        "depth": follow.whole("depth", 1, least=0, most=MOST_TRIES),
        "max_branches": follow.whole("max_branches", 50, most=MOST_BRANCHES),
        "max_points": follow.whole("max_points", 20000, least=2, most=MOST_POINTS),
        "survey": _survey(follow),
        "unphysical": follow.truth("unphysical", model.few_guards),
    }


def _survey(follow: Table) -> bool | str:
    """Return which words to look for across the range: all met, those named, or none."""
    value = follow.take("survey", False, accepted := 'true, false or "orbits"')
    if not isinstance(value, bool) and value != "orbits":
        raise follow.refuse("survey", value, accepted)
    return value


def read_detect(
    table: Table, model: Model, parameter: str, limits: tuple[float, float]
) -> tuple[tuple[str, ...], dict[str, list[float]], bool]:
    """Return the kinds of events of [detect], the values to hit, and whether crises are located."""
    events = table.texts("events", list(usual_events(model)))
    for i, kind in enumerate(events):
        if kind not in KINDS:
            raise unknown_kind(kind, f"detect.events[{i}]")
    requested = table.table("values", optional=True)
    values = {}
    varying = (*model.varying(parameter), *["period"] * model.autonomous)
    for name in list(requested.data):
        if name not in varying:
            found = "it does not vary along the branches"
            accepted = f"accepted are {', '.join(varying)}"
            raise InputError(f"detect.values.{name}", found, accepted)
        values[name] = requested.numbers(name)
        if not values[name]:
            raise InputError(f"detect.values.{name}", "empty", "give at least one value")
    low, high = limits
    for i, value in enumerate(values.get(parameter, [])):
        if not low <= value <= high:
            found = f"{value:.12g} is outside follow.range"
            accepted = f"give a value from {low:.12g} to {high:.12g}"
            raise InputError(f"detect.values.{parameter}[{i}]", found, accepted)
    accepted = f"give detect.values.{parameter} = [...]"
    events = wanted_kinds(events, values, "detect.events", accepted)
    crises = table.truth("crises", False)
    table.finish()
    return tuple(events), values, crises


def read_curves(
    table: Table, model: Model, first: str, events: Sequence[str], farthest: int
) -> CurveOptions:
    """Return what [curves] asks for; it reaches as many words away as given here."""
    name = table.text("parameter")
    declared = model.require(name, "curves.parameter")
    if name == first:
        raise InputError("curves.parameter", f"{name} is followed already", "give another one")
    low, high = (declared.check(v, "curves.range") for v in table.pair("range"))
    if not low <= model.values[name] <= high:
        found = f"[{low:.12g}, {high:.12g}] does not hold {name} = {model.values[name]:.12g}"
        raise InputError("curves.range", found, f"widen it or change model.parameters.{name}")
    kinds = table.texts("kinds", ["PD", "G"])
    for i, kind in enumerate(kinds):
        if kind not in CURVES or kind not in events:
            looked_for = [k for k in CURVES if k in events]
            accepted = (
                f"accepted are those of {', '.join(CURVES)} that detect.events names: "
                f"{', '.join(looked_for) or 'none'}"
            )
            raise InputError(f"curves.kinds[{i}]", f"found {kind!r}", accepted)
    unphysical = _unphysical_kinds(table, kinds)
    values, start = (tuple(table.optional_numbers(key)) for key in ("values", "start"))
    for i, value in enumerate(start):
        if not low <= value <= high:
            found = f"{value:.12g} is outside curves.range"
            accepted = f"give a value from {low:.12g} to {high:.12g}"
            raise InputError(f"curves.start[{i}]", found, accepted)
    cover = table.whole("cover", 0, least=0, most=MOST_LINES)
    areas = table.truth("areas", False)
    reach = table.whole("reach", farthest, least=0, most=MOST_TRIES)
    family = _family(table.table("family", optional=True), model, (first, name))
    third = _third_parameter(table.table("third", optional=True), model, (first, name))
    steps: dict[str, Any] = {
        k: table.number(k, getattr(CURVE_SETTINGS, k)) for k in ("step", "max_step")
    }
    limit = table.whole("max_points", CURVE_SETTINGS.max_points, least=2, most=MOST_POINTS)
    table.finish()
    try:
        settings = replace(CURVE_SETTINGS, max_points=limit, **steps)
    except InputError as error:
        raise error.within("curves") from None
    return CurveOptions(
        name,
        (low, high),
        tuple(kinds),
        tuple(unphysical),
        values,
        family,
        settings,
        start,
        third,
        cover,
        areas,
        reach,
    )


def _unphysical_kinds(table: Table, kinds: Sequence[str]) -> Sequence[str]:
    """The kinds whose curves start at unphysical orbits, too: all, none, or those named."""
    if isinstance(table.data.get("unphysical"), list):
        named = table.texts("unphysical")
        for i, kind in enumerate(named):
            if kind not in kinds:
                accepted = f"accepted are those of curves.kinds: {', '.join(kinds)}"
                raise InputError(f"curves.unphysical[{i}]", f"found {kind!r}", accepted)
        return named
    return kinds if table.truth("unphysical", False) else ()


def read_simulation(
    top: Table, model: Model, parameter: str, limits: tuple[float, float]
) -> tuple[SimulateOptions | None, Membrane | None]:
    """Read [simulate] and [energy]; what reads them is imported only if they are there."""
    simulate = energy = None
    if top.has("simulate") and model.autonomous:
        found = "attractors are told by the forcing's period, and the system has no forcing"
        raise InputError("simulate", found, "leave it out; Simulator computes single motions")
    if top.has("simulate"):
        from .simulate_tables import read_simulate

        simulate = read_simulate(top.table("simulate"), model, parameter, limits)
    if top.has("energy"):
        from .simulate_tables import read_energy

        energy = read_energy(top.table("energy"), model)
    return simulate, energy


def _family(
    table: Table, model: Model, taken: tuple[str, str]
) -> tuple[str, tuple[float, ...]] | None:
    """One parameter and the values it takes."""
    if not table.data:
        return None
    name = next(iter(table.data))
    declared = model.require(name, f"curves.family.{name}")
    if name in taken:
        raise InputError(f"curves.family.{name}", "it is followed already", "give another one")
    values = tuple(declared.check(v, f"curves.family.{name}") for v in table.numbers(name))
    table.finish()
    if not values:
        raise InputError(f"curves.family.{name}", "empty", "give at least one value")
    return name, values


def _third_parameter(
    table: Table, model: Model, taken: tuple[str, str]
) -> tuple[str, tuple[float, float]] | None:
    """A further parameter and its range."""
    if not table.data:
        return None
    name = table.text("parameter")
    declared = model.require(name, "curves.third.parameter")
    if name in taken:
        raise InputError("curves.third.parameter", f"{name} is followed already", "give another")
    low, high = (declared.check(v, "curves.third.range") for v in table.pair("range"))
    if not low <= model.values[name] <= high:
        found = f"[{low:.12g}, {high:.12g}] does not hold {name} = {model.values[name]:.12g}"
        raise InputError("curves.third.range", found, f"widen it or change model.parameters.{name}")
    table.finish()
    return name, (low, high)


def read_certify(table: Table, events: Sequence[str]) -> CertifyOptions:
    """Return what [certify] asks for."""
    defaults = CertifyOptions()
    bits = table.whole("bits", defaults.bits, least=53, most=MOST_BITS)
    limit = table.whole("max_bits", max(defaults.max_bits, bits), least=bits, most=MOST_BITS)
    branches = table.truth("branches", defaults.branches)
    seconds = table.number("seconds", defaults.seconds)
    table.finish()
    if not seconds > 0.0:
        raise InputError("certify.seconds", f"found {seconds!r}", "give a number above 0")
    return CertifyOptions(bits, limit, branches, tuple(events), seconds)


def read_numerics(table: Table) -> tuple[Settings, dict[str, Any]]:
    """Return the settings of [numerics] for walks, and those for the search for orbits."""
    defaults = asdict(SCENE_SETTINGS)
    chosen: dict[str, Any] = {}
    readers: dict[type, Any] = {float: table.number, str: table.text}
    most = {"max_iterations": MOST_TRIES, "max_points": MOST_POINTS}
    for key in (field.name for field in fields(Settings)):
        if key in most:
            chosen[key] = table.whole(key, defaults[key], most=most[key])
        else:
            chosen[key] = readers[type(defaults[key])](key, defaults[key])
    search: dict[str, Any] = {
        "seed": table.whole("seed", 0, least=0, most=LARGEST_SEED),
        "starts": table.whole("starts", 256, most=MOST_STARTS),
        "rounds": table.whole("rounds", 8, most=MOST_TRIES),
    }
    table.finish()
    if chosen["tolerance"] > LARGEST_TOLERANCE:
        accepted = f"give a number above 0, at most {LARGEST_TOLERANCE:g}"
        raise InputError("numerics.tolerance", f"found {chosen['tolerance']!r}", accepted)
    try:
        return Settings(**chosen), search
    except InputError as error:
        raise error.within("numerics") from None


def read_outputs(table: Table, model: Model) -> tuple[Output, ...]:
    """Return the outputs of [output]."""
    found = []
    for name in table.data:
        value = table.take(name, REQUIRED, "an expression")
        if at_impacts := isinstance(value, dict):
            own = table.table(name)
            value = own.text("before_impacts")
            own.finish()
        if not isinstance(value, str):
            accepted = "an expression in quotes, or { before_impacts = an expression }"
            raise table.refuse(name, value, accepted)
        if _COLUMNS.fullmatch(name):
            found_name = f"{short_repr(name)} is or may be a column of tables"
            raise InputError(table.place(name), found_name, "give another name, such as P")
        found.append(Output(name, value, at_impacts))
        check_output(found[-1], model, table.place(name))
    return tuple(found)


def read_plot(
    table: Table, model: Model, parameter: str, outputs: Sequence[str] = ()
) -> PlotOptions:
    """Return what [plot] asks for; `outputs` are the names in [output]."""
    x = table.text("x", parameter)
    if x not in model.varying(parameter):
        accepted = f"accepted are {', '.join(model.varying(parameter))}"
        raise InputError("plot.x", f"{x!r} does not vary along the branches", accepted)
    limits = {key: table.optional_pair(key) for key in ("xlim", "ylim")}
    chosen = {}
    for key, known, default in (
        ("unphysical", SHOWN, "period-1" if model.few_guards else "none"),
        ("labels", LABELS, "all"),
        ("y", (*QUANTITIES, *outputs), "velocity"),
    ):
        chosen[key] = table.text(key, default)
        if chosen[key] not in known:
            raise InputError(
                f"plot.{key}", f"found {chosen[key]!r}", f"accepted are {', '.join(known)}"
            )
    if chosen["y"] in VOLTAGES and not model.MEMBRANES:
        found = f"{chosen['y']!r}, and the system {model.SYSTEM} has no membranes"
        raise InputError("plot.y", found, "give another quantity")
    formats = table.texts("formats", ["svg", "png"])
    for i, kind in enumerate(formats):
        if kind not in FORMATS:
            raise InputError(
                f"plot.formats[{i}]", f"found {kind!r}", f"accepted are {', '.join(FORMATS)}"
            )
    html = table.truth("html", False)
    table.finish()
    drawn = tuple(formats)
    return PlotOptions(x, limits["xlim"], limits["ylim"], formats=drawn, html=html, **chosen)
