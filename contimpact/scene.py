"""Scenes: what to follow, read from TOML and validated.

Every mistake is refused with the path of its key, what was found and what would do. The format is
a contract, documented key by key in the documentation's page on scenes.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .bifurcations import KINDS
from .continuation.arclength import Settings
from .errors import InputError, shown
from .expressions import number
from .extended import CURVES
from .mechanics.model import Model
from .mechanics.word import Word, parse_word
from .orbit_branch import EVENTS
from .switching import SWITCHES
from .systems import system

if TYPE_CHECKING:
    from .simulate_tables import SimulateOptions
    from .systems.membrane import Membrane

CURVE_SETTINGS = Settings(tolerance=1e-13, max_step=0.05, max_points=1000)
FORMATS = ("svg", "png", "pdf")
SHOWN = ("period-1", "all", "none")
LARGEST_TOLERANCE = 1e-3
SCENE_SETTINGS = Settings(max_step=0.03)
"""Numerics of a scene that says nothing else; steps short enough for a smooth picture."""


@dataclass(frozen=True)
class PlotOptions:
    """How the diagram is drawn: the parameter on the x axis, limits, on which branches unphysical
    orbits are shown (``period-1``, ``all``, ``none``), formats to write."""

    x: str
    xlim: tuple[float, float] | None = None
    ylim: tuple[float, float] | None = None
    unphysical: str = "period-1"
    formats: tuple[str, ...] = ("svg", "png")


@dataclass(frozen=True)
class CurveOptions:
    """Which curves to follow in a second parameter.

    Attributes
    ----------
    parameter : str
    range : (low, high)
    kinds : sequence of str
        Kinds of the entries at which curves start.
    unphysical : bool
        Whether also entries of unphysical orbits have their curves followed.
    values : sequence of float
        Values of the second parameter to hit exactly.
    family : (name, values) or None
        A third parameter, and the values of it for which everything is repeated.
    settings : Settings
    """

    parameter: str
    range: tuple[float, float]
    kinds: tuple[str, ...]
    unphysical: bool = False
    values: tuple[float, ...] = ()
    family: tuple[str, tuple[float, ...]] | None = None
    settings: Settings = CURVE_SETTINGS


@dataclass(frozen=True)
class Scene:
    """A validated scene.

    Attributes
    ----------
    name, source : str
    model : Model
        At the start's parameter values.
    parameter : str
        The followed parameter.
    range : (low, high)
    orbits : sequence of Word
    switch : sequence of str
        Kinds of events at which to switch to the branch born there.
    depth : int
        How many switches deep.
    max_branches, max_points : int
        Budget of the whole diagram.
    survey : bool
        Whether to look for more orbits of each word across the range.
    events : sequence of str
        Kinds to look for.
    values : mapping of str to sequence of float
        Values to hit exactly, by parameter.
    settings : Settings
    seed, starts, rounds : int
        Of the search for orbits.
    plot : PlotOptions
    curves : CurveOptions or None
    simulate : SimulateOptions or None
        What ``contimpact simulate`` computes; ``contimpact run`` does not look at it.
    energy : Membrane or None
        What output voltages are computed from, if they are.
    given : mapping
        The scene as it was written.
    """

    name: str
    source: str
    model: Model
    parameter: str
    range: tuple[float, float]
    orbits: tuple[Word, ...]
    switch: tuple[str, ...] = ()
    depth: int = 1
    max_branches: int = 50
    max_points: int = 20000
    survey: bool = False
    events: tuple[str, ...] = EVENTS
    values: Mapping[str, Sequence[float]] = field(default_factory=dict)
    settings: Settings = SCENE_SETTINGS
    seed: int = 0
    starts: int = 256
    rounds: int = 8
    plot: PlotOptions = field(default_factory=lambda: PlotOptions("s"))
    curves: CurveOptions | None = None
    simulate: SimulateOptions | None = None
    energy: Membrane | None = None
    given: Mapping[str, Any] = field(default_factory=dict)

    @property
    def start(self) -> float:
        """Value of the followed parameter at the start."""
        return self.model.values[self.parameter]

    def resolved(self) -> dict[str, Any]:
        """Return the scene with every default filled in, as plain data."""
        return {
            "name": self.name,
            "source": self.source,
            "model": {
                "system": self.model.SYSTEM,
                **self.model.options,
                "parameters": dict(self.model.values),
            },
            "follow": {
                "parameter": self.parameter,
                "range": list(self.range),
                "orbits": [str(word) for word in self.orbits],
                "switch": list(self.switch),
                "depth": self.depth,
                "max_branches": self.max_branches,
                "max_points": self.max_points,
                "survey": self.survey,
            },
            "detect": {
                "events": list(self.events),
                "values": {name: list(values) for name, values in self.values.items()},
            },
            "numerics": {
                **asdict(self.settings), "seed": self.seed, "starts": self.starts,
                "rounds": self.rounds,
            },
            **({"curves": self._resolved_curves()} if self.curves else {}),
            **({"simulate": self.simulate.resolved()} if self.simulate else {}),
            **({"energy": asdict(self.energy)} if self.energy else {}),
            "plot": {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in asdict(self.plot).items()
                if value is not None
            },
        }  # fmt: skip

    def _resolved_curves(self) -> dict[str, Any]:
        curves = self.curves
        assert curves is not None
        family = {} if curves.family is None else {curves.family[0]: list(curves.family[1])}
        settings = curves.settings
        return {
            "parameter": curves.parameter,
            "range": list(curves.range),
            "kinds": list(curves.kinds),
            "unphysical": curves.unphysical,
            "values": list(curves.values),
            "step": settings.step,
            "max_step": settings.max_step,
            "max_points": settings.max_points,
            "family": family,
        }

    def left_out(self, simulated: bool = False) -> list[str]:
        """Return what the scene does not ask for, in words; without a simulation that is left out,
        too, whatever the scene says of it."""
        unasked = [kind for kind in KINDS if kind not in self.events]
        words = []
        if unasked:
            words.append(f"events {', '.join(unasked)}: not asked for, not evaluated")
        if not set(self.events) & {"FB", "BP", "PD"}:
            words.append("second derivatives: no event needs them, not generated")
        if self.curves is None:
            words.append("curves: no [curves]")
        for what, key in (("simulation", "simulate"), ("energy", "energy")):
            if getattr(self, key) is None:
                words.append(f"{what}: no [{key}]")
            elif not simulated:
                words.append(f"{what}: [{key}] is for contimpact simulate alone")
        if not self.switch:
            words.append("switching: follow.switch is empty")
        if not self.plot.formats:
            words.append("diagram: plot.formats is empty, matplotlib is not imported")
        return words


def load_scene(path: str | Path) -> Scene:
    """Read and validate a scene file.

    Raises
    ------
    InputError
        If the file cannot be read or the scene is not valid.
    """
    path = Path(path)
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except FileNotFoundError:
        raise InputError(str(path), "no such file", "give the path of a scene.toml") from None
    except IsADirectoryError:
        raise InputError(
            str(path), "a folder", f"give the file in it: {path / 'scene.toml'}"
        ) from None
    except UnicodeDecodeError as error:
        raise InputError(str(path), f"not UTF-8 ({error})", "save it as UTF-8 text") from None
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({error.strerror})", "check it") from None
    except ValueError as error:
        raise InputError(str(path), f"not a path ({error})", "give a scene.toml") from None
    toml = "give lines such as range = [0.1, 1.0] in tables such as [follow]"
    try:
        given = tomllib.loads(text)
    except ValueError as error:  # TOMLDecodeError, and numbers of thousands of digits
        raise InputError(str(path), f"not TOML: {error}", toml) from None
    except RecursionError:
        raise InputError(str(path), "nested too deeply", toml) from None
    return read_scene(given)


def read_scene(given: Mapping[str, Any]) -> Scene:
    """Validate a scene given as nested mappings.

    Raises
    ------
    InputError
        If it is not valid.
    """
    if not isinstance(given, Mapping):
        raise InputError("scene", f"found {shown(given)}", "give a table of tables")
    top = _Table(given, "")
    name = _name(top.text("name"))
    source = top.text("source", "")
    model = _model(top.table("model"))
    follow = top.table("follow")
    parameter = follow.text("parameter")
    if parameter in model.DERIVED:
        raise InputError(
            "follow.parameter", f"{parameter} is derived from other parameters",
            f"follow one of {', '.join(model.values)}",
        )  # fmt: skip
    declared = model.require(parameter, "follow.parameter")
    low, high = (declared.check(v, "follow.range") for v in follow.pair("range"))
    start = model.values[parameter]
    if not low <= start <= high:
        raise InputError(
            "follow.range", f"[{low:.12g}, {high:.12g}] does not hold the start "
            f"{parameter} = {start:.12g}",
            f"widen it or change model.parameters.{parameter}",
        )  # fmt: skip
    letters = [w.name for w in model.WALLS]
    orbits = tuple(
        dict.fromkeys(
            parse_word(text, letters, f"follow.orbits[{i}]")
            for i, text in enumerate(follow.texts("orbits"))
        )
    )
    if not orbits:
        raise InputError("follow.orbits", "empty", "name at least one orbit, such as '1:1'")
    reach = _reach(follow)
    follow.finish()
    detect = top.table("detect", optional=True)
    events, values = _detect(detect, model, parameter, (low, high))
    for i, kind in enumerate(reach["switch"]):
        if kind not in events:
            raise InputError(
                f"follow.switch[{i}]", f"{kind} is not among the events looked for",
                f"add it to detect.events, which has {', '.join(events) or 'none'}",
            )  # fmt: skip
    settings, search = _numerics(top.table("numerics", optional=True))
    plot = _plot(top.table("plot", optional=True), model, parameter)
    curves = None
    if "curves" in given:
        curves = _curves(top.table("curves"), model, parameter, events)
    top.asked.append("curves")
    simulate, energy = _simulate(top, model, parameter, (low, high))
    top.finish()
    return Scene(
        name, source, model, parameter, (low, high), orbits, events=events, values=values,
        settings=settings, plot=plot, given=given, **search, **reach,
        curves=curves, simulate=simulate, energy=energy,
    )  # fmt: skip


def _name(name: str) -> str:
    """The scene's name, if a folder can be called so."""
    if name.strip() in ("", ".", "..") or not name.isprintable() or set(name) & set("/\\"):
        raise InputError(
            "name", f"found {shown(name)}",
            "give a name for a folder: not '.' or '..', no slashes, no control characters",
        )  # fmt: skip
    return name


def _model(table: _Table) -> Model:
    kind = system(table.text("system"), "model.system")
    options = {name: table.text(name, default) for name, default in kind.OPTIONS.items()}
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
        inside = "model" if error.where in options else "model.parameters"
        raise error.within(inside) from None


def _reach(follow: _Table) -> dict[str, Any]:
    """How far to follow what is born on the branches."""
    switch = follow.texts("switch", [])
    for i, kind in enumerate(switch):
        if kind not in SWITCHES:
            raise InputError(
                f"follow.switch[{i}]", f"cannot switch at {shown(kind)}",
                f"accepted are {', '.join(SWITCHES)}",
            )  # fmt: skip
    return {
        "switch": tuple(dict.fromkeys(switch)),
        "depth": follow.whole("depth", 1, least=0),
        "max_branches": follow.whole("max_branches", 50),
        "max_points": follow.whole("max_points", 20000, least=2),
        "survey": follow.truth("survey", False),
    }


def _detect(
    table: _Table, model: Model, parameter: str, limits: tuple[float, float]
) -> tuple[tuple[str, ...], dict[str, list[float]]]:
    events = table.texts("events", list(EVENTS))
    for i, kind in enumerate(events):
        if kind not in KINDS:
            raise InputError(
                f"detect.events[{i}]", f"no event kind {shown(kind)}",
                f"accepted are {', '.join(KINDS)}",
            )  # fmt: skip
    requested = table.table("values", optional=True)
    values = {}
    for name in list(requested.data):
        if name not in model.varying(parameter):
            raise InputError(
                f"detect.values.{name}", "it does not vary along the branches",
                f"accepted are {', '.join(model.varying(parameter))}",
            )  # fmt: skip
        values[name] = requested.numbers(name)
        if not values[name]:
            raise InputError(f"detect.values.{name}", "empty", "give at least one value")
    low, high = limits
    for i, value in enumerate(values.get(parameter, [])):
        if not low <= value <= high:
            raise InputError(
                f"detect.values.{parameter}[{i}]", f"{value:.12g} is outside follow.range",
                f"give a value from {low:.12g} to {high:.12g}",
            )  # fmt: skip
    if values and "UZ" not in events:
        events.append("UZ")
    if "UZ" in events and not values:
        raise InputError(
            "detect.events", "UZ without values to hit", f"give detect.values.{parameter} = [...]"
        )
    table.finish()
    return tuple(dict.fromkeys(events)), values


def _curves(table: _Table, model: Model, first: str, events: Sequence[str]) -> CurveOptions:
    name = table.text("parameter")
    declared = model.require(name, "curves.parameter")
    if name == first:
        raise InputError("curves.parameter", f"{name} is followed already", "give another one")
    low, high = (declared.check(v, "curves.range") for v in table.pair("range"))
    if not low <= model.values[name] <= high:
        raise InputError(
            "curves.range", f"[{low:.12g}, {high:.12g}] does not hold {name} = "
            f"{model.values[name]:.12g}", f"widen it or change model.parameters.{name}",
        )  # fmt: skip
    kinds = table.texts("kinds", ["PD", "G"])
    for i, kind in enumerate(kinds):
        if kind not in CURVES or kind not in events:
            looked_for = [k for k in CURVES if k in events]
            raise InputError(
                f"curves.kinds[{i}]", f"found {kind!r}",
                f"accepted are those of {', '.join(CURVES)} that detect.events names: "
                f"{', '.join(looked_for) or 'none'}",
            )  # fmt: skip
    unphysical = table.truth("unphysical", False)
    values = tuple(table.numbers("values")) if "values" in table.data else ()
    table.asked.append("values")
    family = _family(table.table("family", optional=True), model, (first, name))
    steps: dict[str, Any] = {
        k: table.number(k, getattr(CURVE_SETTINGS, k)) for k in ("step", "max_step")
    }
    limit = table.whole("max_points", CURVE_SETTINGS.max_points, least=2)
    table.finish()
    try:
        settings = replace(CURVE_SETTINGS, max_points=limit, **steps)
    except InputError as error:
        raise error.within("curves") from None
    return CurveOptions(
        name, (low, high), tuple(dict.fromkeys(kinds)), unphysical, values, family, settings
    )


def _simulate(
    top: _Table, model: Model, parameter: str, limits: tuple[float, float]
) -> tuple[SimulateOptions | None, Membrane | None]:
    """The tables [simulate] and [energy]; what reads them is imported only if they are there."""
    simulate = energy = None
    if "simulate" in top.data:
        from .simulate_tables import read_simulate

        simulate = read_simulate(top.table("simulate"), model, parameter, limits)
    if "energy" in top.data:
        from .simulate_tables import read_energy

        energy = read_energy(top.table("energy"), model)
    top.asked += ["simulate", "energy"]
    return simulate, energy


def _family(
    table: _Table, model: Model, taken: tuple[str, str]
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


def _numerics(table: _Table) -> tuple[Settings, dict[str, Any]]:
    defaults = asdict(SCENE_SETTINGS)
    chosen: dict[str, Any] = {}
    readers: dict[type, Any] = {int: table.whole, float: table.number, str: table.text}
    for key in fields(Settings):
        read = readers[type(defaults[key.name])]
        chosen[key.name] = read(key.name, defaults[key.name])
    search: dict[str, Any] = {
        "seed": table.whole("seed", 0, least=0),
        "starts": table.whole("starts", 256),
        "rounds": table.whole("rounds", 8),
    }
    table.finish()
    if chosen["tolerance"] > LARGEST_TOLERANCE:
        raise InputError(
            "numerics.tolerance", f"found {chosen['tolerance']!r}",
            f"give a number above 0, at most {LARGEST_TOLERANCE:g}",
        )  # fmt: skip
    try:
        return Settings(**chosen), search
    except InputError as error:
        raise error.within("numerics") from None


def _plot(table: _Table, model: Model, parameter: str) -> PlotOptions:
    x = table.text("x", parameter)
    if x not in model.varying(parameter):
        raise InputError(
            "plot.x", f"{x!r} does not vary along the branches",
            f"accepted are {', '.join(model.varying(parameter))}",
        )  # fmt: skip
    limits = {
        key: table.pair(key) if key in table.data else None for key in ("xlim", "ylim")
    }  # fmt: skip
    table.asked += list(limits)
    unphysical = table.text("unphysical", "period-1")
    if unphysical not in SHOWN:
        raise InputError(
            "plot.unphysical", f"found {unphysical!r}", f"accepted are {', '.join(SHOWN)}"
        )
    formats = table.texts("formats", ["svg", "png"])
    for i, kind in enumerate(formats):
        if kind not in FORMATS:
            raise InputError(
                f"plot.formats[{i}]", f"found {kind!r}", f"accepted are {', '.join(FORMATS)}"
            )
    table.finish()
    return PlotOptions(x, limits["xlim"], limits["ylim"], unphysical, tuple(dict.fromkeys(formats)))


def _nearest(key: str, known: Sequence[str]) -> str | None:
    """The known key that is spelled most like another, if one is."""
    import difflib

    return next(iter(difflib.get_close_matches(key, known, 1)), None)


_REQUIRED: Any = object()


class _Table:
    """One table of a scene: hands out its keys by type, and refuses those nobody asked for."""

    def __init__(self, data: Mapping[str, Any], path: str) -> None:
        self.data, self.path = data, path
        self.asked: list[str] = []

    def place(self, key: str) -> str:
        return f"{self.path}.{key}" if self.path else key

    def take(self, key: str, default: Any, wanted: str) -> Any:
        self.asked.append(key)
        if key in self.data:
            return self.data[key]
        if default is _REQUIRED:
            if near := _nearest(key, [k for k in self.data if k not in self.asked]):
                raise InputError(
                    self.place(near), f"unknown key (did you mean {key!r}?)",
                    f"{self.place(key)} is missing: give {wanted}",
                )  # fmt: skip
            raise InputError(self.place(key), "missing", f"give {wanted}")
        return default

    def refuse(self, key: str, found: Any, wanted: str) -> InputError:
        return InputError(self.place(key), f"found {shown(found)}", f"give {wanted}")

    def text(self, key: str, default: Any = _REQUIRED) -> str:
        value = self.take(key, default, "a text")
        if not isinstance(value, str):
            raise self.refuse(key, value, "a text in quotes")
        return value

    def texts(self, key: str, default: Any = _REQUIRED) -> list[str]:
        value = self.take(key, default, "a list of texts")
        if not isinstance(value, list) or not all(isinstance(v, str) for v in value):
            raise self.refuse(key, value, "a list of texts in quotes")
        return list(value)

    def number(self, key: str, default: Any = _REQUIRED) -> float:
        value = self.take(key, default, "a number, or an expression in quotes")
        return self.as_number(value, key)

    def as_number(self, value: Any, key: str) -> float:
        if isinstance(value, str):
            return number(value, self.place(key))
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.refuse(key, value, "a number, or an expression in quotes")
        try:
            value = float(value)
        except OverflowError:
            value = math.inf
        if not math.isfinite(value):
            raise self.refuse(key, value, "a finite number")
        return value

    def numbers(self, key: str) -> list[float]:
        value = self.take(key, _REQUIRED, "a list of numbers")
        if not isinstance(value, list):
            raise self.refuse(key, value, "a list of numbers")
        return [self.as_number(v, f"{key}[{i}]") for i, v in enumerate(value)]

    def pair(self, key: str) -> tuple[float, float]:
        wanted = "two numbers, the lower one first"
        if key not in self.data:
            self.take(key, _REQUIRED, wanted)
        values = self.numbers(key)
        if len(values) != 2 or not values[0] < values[1]:
            raise self.refuse(key, self.data[key], wanted)
        return values[0], values[1]

    def truth(self, key: str, default: bool) -> bool:
        value = self.take(key, default, "true or false")
        if not isinstance(value, bool):
            raise self.refuse(key, value, "true or false")
        return value

    def whole(self, key: str, default: Any = _REQUIRED, least: int = 1) -> int:
        value = self.take(key, default, "a whole number")
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            raise self.refuse(key, value, f"a whole number >= {least}")
        return value

    def table(self, key: str, optional: bool = False) -> _Table:
        value = self.take(key, {} if optional else _REQUIRED, f"a table [{self.place(key)}]")
        if not isinstance(value, dict):
            raise self.refuse(key, value, f"a table [{self.place(key)}]")
        return _Table(value, self.place(key))

    def finish(self) -> None:
        for key in self.data:
            if key not in self.asked:
                near = _nearest(key, self.asked)
                hint = f" (did you mean {near!r}?)" if near else ""
                raise InputError(
                    self.place(key), f"unknown key{hint}", f"accepted are {', '.join(self.asked)}"
                )
