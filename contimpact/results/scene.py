"""Scenes: read from TOML and validated, systems in files of users' own included.

Every mistake is refused with the path of its key, what was found and what would do. The format is
a contract, documented key by key in the documentation's page on scenes.
"""

from __future__ import annotations

import hashlib
import importlib.util
import re
import sys
import tomllib
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ..bifurcations.declarations import (
    CONTINUED,
    EVENTS,
    KINDS,
    SECOND,
    SWITCHES,
    is_kind,
    own_kinds,
    unknown_kind,
    usual_events,
    wanted_kinds,
)
from ..continuation.settings import Settings
from ..display import ParameterItems
from ..errors import (
    InputError,
    did_you_mean,
    each_once,
    explain_arguments,
    require_known,
    short_repr,
)
from ..models.expressions import names_in
from ..models.guards import Word, graph, parse_word
from ..models.model import Example, Model, Parameter, require_forcing
from ..models.outputs import VOLTAGE, Output, check_output
from ..schema import Key, Table, fit, key, read, written
from ..storage import check_length, read_bounded, reason
from ..systems import SYSTEMS, find_system, list_systems, summary, system
from ..systems.membrane import Membrane
from .options import (
    LARGEST_SEED,
    MOST_BRANCHES,
    MOST_POINTS,
    MOST_STARTS,
    MOST_TRIES,
    QUANTITIES,
    CertifyOptions,
    CurveOptions,
    DesignOptions,
    MarginOptions,
    PlotOptions,
    SimulateOptions,
    range_in_scene,
    within,
)

if TYPE_CHECKING:
    from ..models.machine import Machine
    from ..models.stated_modes import StatedModes


SCENE_SETTINGS = Settings(max_step=0.03)
"""Numerics of a scene that says nothing else; steps short enough for a smooth picture."""
OUTPUT_ERROR = "_error"
"""Ends the name of the column with the error estimates of a mean."""
_COLUMNS = re.compile(
    rf"arclength|residual|iterations|reason|event|physical|n_unstable|smallest_gap|margin(_event)?|"
    rf"[a-z]+\d+|\w*(_re|_im|{OUTPUT_ERROR})|{'|'.join(QUANTITIES)}"
)
"""Names that columns of branches and quantities have."""

# Names of scenes, and the folders that results have in a run of several scenes.
#
# A name is any text of one line. Its folder is the name itself, with what not every file system can
# hold in it as ``%`` and two hexadecimal digits for each byte, as in addresses: no two names have
# one folder. Names that would be too long so are cut, and end with a digest of the whole.

LONGEST_NAME = 200
"""Bytes of a name in UTF-8, and of a folder."""

_DIGEST = 16
_UNSAFE = re.compile(r'[/\\<>:"|?*]|%(?=[0-9A-Fa-f]{2})|^\.|[. ]\Z')
_RESERVED = re.compile(r"(?:con|prn|aux|nul|com\d|lpt\d)(?:\.|$)", re.IGNORECASE)
"""Names of devices, with or without an ending."""


def check_name(name: str) -> str:
    """Return a scene's name, or raise `InputError` if it cannot be one."""
    if not name.strip() or not name.isprintable():
        accepted = "give a text of one line without control characters"
        raise InputError("name", f"found {short_repr(name)}", accepted)
    if len(name.encode()) > LONGEST_NAME:
        raise InputError(
            "name",
            f"found {short_repr(name)}",
            f"give a name of at most {LONGEST_NAME} bytes in UTF-8",
        )
    return name


def folder_of(name: str) -> str:
    """Return what the folder of a scene's results is called."""
    safe = _UNSAFE.sub(lambda found: _escape(found[0]), name)
    if _RESERVED.match(safe):
        safe = _escape(safe[0]) + safe[1:]
    if len(safe.encode()) <= LONGEST_NAME:
        return safe
    from hashlib import sha256

    digest = sha256(name.encode()).hexdigest()[:_DIGEST]
    kept = safe.encode()[: LONGEST_NAME - _DIGEST - 1].decode(errors="ignore")
    return f"{kept}-{digest}"


def _escape(text: str) -> str:
    return "".join(f"%{byte:02X}" for byte in text.encode())


def require_own_folders(names: Sequence[str]) -> None:
    """Refuse two names with one folder, capital and small letters being alike on some systems.

    Raises InputError if there are such names.
    """
    known: dict[str, str] = {}
    for name in names:
        folder = unicodedata.normalize("NFC", folder_of(name)).casefold()
        if (other := known.get(folder)) is not None:
            found = f"two scenes are called {short_repr(name)}"
            if other != name:
                found = f"{short_repr(other)} and {short_repr(name)} are one folder on some systems"
            raise InputError("SCENE", found, "give each its own name")
        known[folder] = name


# What is wrong with a text that is not TOML, by its keys.

TWICE = re.compile(r"Cannot (overwrite|declare|mutate)|Duplicate")
LINE = re.compile(r"\(at line (\d+)")
HEADER = re.compile(r"\s*\[+([^\[\]]*)\]+\s*(#.*)?$")
STATEMENT = re.compile(r"\s*([\w.\"'-]+)\s*=\s*(.*)$")
COMMA = re.compile(r"[-+]?\d+,\d+\s*(#.*)?$")
WITHOUT_QUOTES = re.compile(r"[-+(]*\d*[.)*/]*[A-Za-z_][^\"'\[{]*$")
LONGEST = 300
"""Largest number of characters of a line that are looked at."""


def explain_syntax(text: str, error: str) -> tuple[str, str]:
    """Return what was found in a text that is not TOML, by what its reader says, and what would be
    accepted."""
    lines = [line[:LONGEST] for line in text.split("\n")]
    at = LINE.search(error)
    last = max((i for i, line in enumerate(lines) if line.strip()), default=0)
    number = min(int(at[1]) - 1, last) if at else last
    line = lines[number]
    key, value = _key(lines, number), ""
    if statement := STATEMENT.match(line):
        value = statement[2].strip()
    said = f"line {number + 1}: {short_repr(line.strip())}"
    if TWICE.search(error) and key:
        return f"not TOML: {short_repr(key)} is there twice; {said}", "give each key and table once"
    if COMMA.match(value):
        return f"not TOML: {said}", "write decimals with a point, lists in [ ]"
    if WITHOUT_QUOTES.match(value):
        return f"not TOML: {said}", f'put expressions and texts in quotes: {key} = "..."'
    inside = f" at {key}" if key else ""
    accepted = "give lines such as range = [0.1, 1.0] in tables such as [follow]"
    return f"not TOML{inside}: {error}", accepted


def _key(lines: list[str], number: int) -> str:
    """The path of the key in a line, or of the table that it begins."""
    table = ""
    for line in lines[: number + 1]:
        if header := HEADER.match(line):
            table = header[1].strip()
    statement = STATEMENT.match(lines[number])
    if HEADER.match(lines[number]) or statement is None:
        return table
    return f"{table}.{statement[1]}" if table else statement[1]


# Systems and kinds of events of the user's own, from Python files named on the command line.
#
# A scene is data and never names code: which file is run is the explicit choice of the one who
# gives the command.

DEFINE = "define a subclass of Model in it, with SYSTEM, PARAMETERS, WALLS and formulas"


def systems_of(files: Iterable[str]) -> dict[str, type[Model]]:
    """Run Python files, and return the systems that they define, by name. Each file's folder is
    searched for modules that it imports, after all other places. Kinds of events that a file
    defines are found by their classes.

    Raises InputError naming the file, if it cannot be read or run, defines neither a system nor a
    kind, or one of a name that is taken.
    """
    found: dict[str, type[Model]] = {}
    for file in dict.fromkeys(files):
        for kind in _defined_systems(_run(Path(file)), file):
            name = kind.SYSTEM
            if name in SYSTEMS or name in found:
                of = "the package" if name in SYSTEMS else "another file or class"
                accepted = "give it another name, in the scene too"
                raise InputError(file, f"{kind.__name__}.SYSTEM is {name!r} as in {of}", accepted)
            found[name] = kind
    return found


def _run(path: Path) -> ModuleType:
    """The module that a file makes."""
    file = str(path)
    if path.suffix != ".py":
        raise InputError(file, "no Python file", "give a file that ends in .py")
    place = path.resolve()
    digest = hashlib.sha256(str(place).encode()).hexdigest()[:8]
    spec = importlib.util.spec_from_file_location(f"{path.stem}_{digest}", place)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    if str(place.parent) not in sys.path:
        sys.path.append(str(place.parent))
    try:
        spec.loader.exec_module(module)
    except InputError as error:
        raise InputError(file, f"{error.where}: {error.found}", error.accepted) from None
    except FileNotFoundError as error:
        if error.filename != str(place):
            raise InputError(file, f"it cannot be run ({error})", "mend it") from error
        raise InputError(file, "no such file", "give the file that defines the system") from None
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a file may end the program, too
        found = (
            f"it cannot be run ({type(error).__name__}: {error}{_error_line(error, str(place))})"
        )
        raise InputError(file, found, "mend it; only what it defines is needed") from error
    return module


def _error_line(error: BaseException, file: str) -> str:
    """The last line of a file that an error has passed, in words."""
    lines, trace = [], error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == file:
            lines.append(trace.tb_lineno)
        trace = trace.tb_next
    return f", line {lines[-1]}" if lines else ""


def _defined_systems(module: ModuleType, file: str) -> list[type[Model]]:
    """The systems that a module defines itself; it may define kinds of events alone."""
    own = [
        value
        for value in vars(module).values()
        if isinstance(value, type) and value.__module__ == module.__name__
    ]
    kinds = [kind for kind in own if is_kind(kind)]
    for kind in kinds:
        if (name := getattr(kind, "name", None)) in KINDS:
            found = f"{kind.__name__}.name is {name!r} as in the package"
            raise InputError(file, found, "give it another name, in the scene too")
    systems = [kind for kind in own if issubclass(kind, Model) and "SYSTEM" in vars(kind)]
    if not systems and not kinds:
        raise InputError(file, "it defines no system", DEFINE)
    return list(dict.fromkeys(systems))


LARGEST_FILE = 1_000_000
"""Bytes of a scene file."""
LONGEST_KEY = 100
LONG_KEY = re.compile(
    r"""^[ \t]*+(?:(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){100}""",
    re.MULTILINE,
)
"""A dotted key of more names than `LONGEST_KEY`; reading it takes the square of their number."""


def _machine(table: Table, kind: type[Model]) -> Model:
    """The machine that [model] states."""
    from ..models.machine import machine_of_table

    lists = {name: table.get(name, Any, accepted="a list") for name in ("coordinates", "mass")}
    size = len(lists["coordinates"]) if isinstance(lists["coordinates"], list) else 1
    given = {
        **lists,
        "damping": table.get("damping", Any, [0] * size),
        "stiffness": table.get("stiffness", Any, [0] * size),
        "force": table.get("force", Any, accepted="a list of expressions in t"),
        "period": table.get("period", Any, accepted="the forcing period"),
        "guards": table.table("guards").data,
    }
    return _complete_system(table, kind, lambda names: machine_of_table(given, names))


def _modes(table: Table, kind: type[Model]) -> Model:
    """The hybrid system that [model] states."""
    from ..models.stated_modes import check_symmetry, modes_of_table

    given = {name: table.table(name).data for name in ("modes", "guards")}
    optional = ("define", "mass", "symmetry")
    given |= {name: table.table(name, optional=True).data for name in optional}
    given["period"] = table.get("period", Any, accepted="the forcing period")
    model = _complete_system(table, kind, lambda names: modes_of_table(given, names))
    try:
        check_symmetry(model.machine, model.values)  # type: ignore[attr-defined]
    except InputError as error:
        raise error.within("model") from None
    return model


STATEMENTS = {"linear": _machine, "hybrid": _modes}
"""Readers of the systems that scenes state themselves."""


def _complete_system(
    table: Table, kind: type[Model], state: Callable[[list[str]], Machine | StatedModes]
) -> Model:
    """The system that the names of its parameters complete; each has to stand in it."""
    from ..models.machine import check_use

    values = table.get("parameters", Mapping[str, float])
    table.finish()
    try:
        machine = state(list(values))
        model = kind(machine=machine.text, **values)
        check_use(machine.parameters, machine.expressions)
        return model
    except InputError as error:
        inside = "model.parameters" if error.where in values else "model"
        raise error.within(inside) from None


def read_model(given: Mapping[str, Any], systems: Mapping[str, type[Model]] | None = None) -> Model:
    """Return the model of [model] at the start's parameter values."""
    table = Table(given, "model")
    kind = system(table.get("system", str), "model.system", systems)
    if kind.STATED and "machine" not in given:
        return STATEMENTS[kind.SYSTEM](table, kind)
    named = (*kind.OPTIONS, "period")
    options = {name: table.get(name, str) for name in named if table.has(name)}
    parameters = table.table("parameters")
    if name := next((name for name in named if name in parameters.data), ""):
        found = "not a parameter but an option"
        raise InputError(parameters.place(name), found, f"give it as model.{name}")
    values = {name: parameters.get(name, float) for name in parameters.data}
    table.finish()
    try:
        return kind(**values, **options)
    except InputError as error:
        inside = "model" if error.where in (*named, "parameters") else "model.parameters"
        raise error.within(inside) from None


def _range(limits: tuple[float, float], where: str, here: Any) -> tuple[float, float]:
    low, high = range_in_scene(limits, where, here.model, here.parameter)
    here.model.validate_between(here.parameter, low, high, where)
    return low, high


def _orbits(texts: tuple[str, ...], where: str, here: Any) -> tuple[Word, ...]:
    model = here.model
    words = [
        parse_word(text, model.letters, f"{where}[{i}]", graph(model.WALLS), model.autonomous)
        for i, text in enumerate(texts)
    ]
    if not words:
        raise InputError(where, "empty", "name at least one orbit, such as '1:1'")
    return tuple(each_once(words, where))


def _kind(kind: str, where: str, here: Any) -> str:
    if kind not in KINDS and kind not in own_kinds():
        raise unknown_kind(kind, where, ", and a kind of your own by --system FILE.py")
    return kind


def _values(
    given: Mapping[str, list[float]], where: str, here: Any
) -> Mapping[str, Sequence[float]]:
    """The values to hit; the kind of their events is added to those that are looked for."""
    varying = (*here.model.varying(here.parameter), *["period"] * here.model.autonomous)
    for name, values in given.items():
        found = "it does not vary along the branches"
        require_known(name, varying, f"{where}.{name}", found)
        if not values:
            raise InputError(f"{where}.{name}", "empty", "give at least one value")
    own = f"{where}.{here.parameter}"
    within(given.get(here.parameter, ()), own, here.range, "follow.range")
    here.events = tuple(wanted_kinds(here.events, given, "detect.events", f"give {own} = [...]"))
    return given


def _switch(kinds: tuple[str, ...], where: str, here: Any) -> tuple[str, ...]:
    for i, kind in enumerate(kinds):
        place = f"{where}[{i}]"
        require_known(kind, SWITCHES, place, f"cannot switch at {short_repr(kind)}")
        if kind not in here.events:
            found = f"{kind} is not among the events looked for"
            accepted = f"add it to detect.events, which has {', '.join(here.events) or 'none'}"
            raise InputError(place, found, accepted)
    return kinds


def _outputs(given: Mapping[str, Any], where: str, here: Any) -> tuple[Output, ...]:
    found = []
    for name, value in given.items():
        place = f"{where}.{name}"
        at_impacts, contacts, per = False, "", "impact"
        accepted = (
            "an expression in quotes, { before_impacts = an expression }, or "
            "{ contacts = letters, mean = an expression }"
        )
        if isinstance(value, Mapping):
            if not {"before_impacts", "contacts"} & {*value}:
                text = f"found a table with {', '.join(value) or 'nothing'}"
                raise InputError(place, text, f"give {accepted}")
            own = Table(value, place)
            at_impacts = "contacts" not in value
            contacts = "" if at_impacts else own.get("contacts", str)
            if at_impacts:
                per = own.get("per", str, per, choices=("impact", "time"))
            value = own.get("before_impacts" if at_impacts else "mean", str)
            own.finish()
        value = fit(value, str, place, Key(accepted=accepted))
        if _COLUMNS.fullmatch(name):
            text = f"{short_repr(name)} is or may be a column of tables"
            raise InputError(place, text, "give another name, such as P")
        membrane = (here.energy or Membrane()) if here.model.MEMBRANES else None
        found.append(Output(name, value, at_impacts, contacts, per == "time", membrane))
        check_output(found[-1], here.model, place)
    return tuple(found)


def _written_outputs(outputs: Sequence[Output]) -> dict[str, Any]:
    per = {True: {"per": "time"}, False: {}}
    return {
        one.name: {"contacts": one.contacts, "mean": one.expression}
        if one.contacts
        else {"before_impacts": one.expression} | per[one.per_time]
        if one.at_impacts
        else one.expression
        for one in outputs
    }


def _energy(asked: Membrane, where: str, here: Any) -> Membrane:
    if not here.model.MEMBRANES:
        found = f"the system {here.model.SYSTEM} has no membranes"
        raise InputError(where, found, "leave [energy] out")
    return asked


def _certify(asked: CertifyOptions, where: str, here: Any) -> CertifyOptions:
    require_forcing(here.model, where, "proofs are for", "leave it out")
    return replace(asked, events=here.events)


@dataclass(frozen=True, kw_only=True)
class Scene(ParameterItems):
    """A validated scene; its fields are the keys of the scene's tables."""

    name: str = key(
        doc="one line without control characters, at most 200 bytes in UTF-8; it gives results "
        "their [folder](catalogue.md#folders-of-several-scenes)",
        check=lambda name, where, here: check_name(name),
    )
    source: str = key("", "where the scene comes from")
    model: Model = key(
        given=Mapping[str, Any],
        check=lambda given, where, here: read_model(given, here.scene),
        write=lambda model: {
            "system": model.SYSTEM,
            **model.options,
            "parameters": dict(model.values),
        },
    )
    """Model at the start's parameter values."""
    parameter: str = key(
        table="follow",
        doc="the parameter to follow: any of the model's; derived ones are refused, with those "
        "they are derived from",
        check=lambda name, where, here: here.model.require(name, where) and name,
    )
    range: tuple[float, float] = key(
        table="follow",
        doc="lower and upper limit, in the parameter's unit; the start lies within",
        check=_range,
    )
    orbits: tuple[Word, ...] = key(
        table="follow",
        doc="the orbits to start from. Words without an orbit at the start are listed, with values "
        "at which there are some; the scene is refused if none has one",
        given=tuple[str, ...],
        check=_orbits,
        write=lambda words: [str(word) for word in words],
    )
    events: tuple[str, ...] = key(
        EVENTS,
        "kinds of [events](mathematics.md#events) to locate; `[]` for none",
        table="detect",
        usual=lambda here: usual_events(here.model),
        each=_kind,
        shown='`["FB", "BP", "PD", "G", "V", "T"]`, and NS',
    )
    values: Mapping[str, Sequence[float]] = key(
        {}, table="detect", given=Mapping[str, list[float]], check=_values
    )
    crises: bool = key(
        False,
        "whether [crises](crises.md) are located where complex motion ends, as entries CR: along "
        "the sweeps of `[simulate]`, or else 101 values both ways",
        table="detect",
        silent=True,
    )
    switch: tuple[str, ...] = key(
        (),
        "kinds of events at which to follow the branch that starts there: BP, PD, G and V, at "
        "which others are born, and T, beyond which [the motion continues]"
        "(scene.md#order-of-impacts); each must also be in `detect.events`",
        table="follow",
        usual=lambda here: tuple(kind for kind in CONTINUED if kind in here.events),
        check=_switch,
        shown='`["T"]`',
    )
    depth: int = key(
        1,
        "how many switches deep; an exchange of impacts at a T does not count",
        table="follow",
        least=0,
        most=MOST_TRIES,
    )
    max_branches: int = key(50, "branches of the whole diagram", table="follow", most=MOST_BRANCHES)
    max_points: int = key(
        20000, "points of the whole diagram", table="follow", least=2, most=MOST_POINTS
    )
    survey: bool | str = key(
        False,
        "whether to look for more orbits at nine values across the range and to follow them: of "
        "every word found or named, or, in a third of the time, of those in `orbits` alone",
        table="follow",
        choices=("orbits",),
        accepted='true, false or "orbits"',
    )
    unphysical: bool = key(
        True,
        "whether unphysical orbits are followed. With false a branch ends a step behind the event "
        "that makes its orbits unphysical, and nothing born on unphysical orbits is followed; the "
        "orbit without impacts is followed throughout",
        table="follow",
        usual=lambda here: here.model.few_guards,
        shown="true for systems of at most two guards",
    )
    settings: Settings = key(
        SCENE_SETTINGS, table="numerics", inline={f.name: {} for f in fields(Settings)}
    )
    seed: int = key(
        0, "seed of the search for orbits", table="numerics", least=0, most=LARGEST_SEED
    )
    starts: int = key(
        256, "random starts in one round of the search", table="numerics", most=MOST_STARTS
    )
    rounds: int = key(
        8,
        "rounds at most; the search ends after two that find nothing new",
        table="numerics",
        most=MOST_TRIES,
    )
    curves: CurveOptions | None = key(None)
    simulate: SimulateOptions | None = key(None)
    """Options of ``contimpact simulate``; ``contimpact run`` sweeps by them for crises."""
    energy: Membrane | None = key(None, check=_energy)
    """Data from which output voltages are computed, if they are."""
    certify: CertifyOptions | None = key(None, check=_certify)
    outputs: tuple[Output, ...] = key(
        (),
        name="output",
        given=Mapping[str, Any],
        usual=lambda here: {},
        check=_outputs,
        write=_written_outputs,
        silent=True,
    )
    """Expressions of which branches have the means."""
    margins: MarginOptions | None = key(None)
    """How margins are measured, which branches have as a column if this is given."""
    design: DesignOptions | None = key(None)
    """Options of ``contimpact design``."""
    plot: PlotOptions = key(usual=lambda here: read(PlotOptions, {}, "plot", here))
    given: Mapping[str, Any] = field(default_factory=dict)
    """The scene as it was written."""

    @property
    def parameters(self) -> dict[str, float]:
        """All parameters and derived parameters at the start."""
        return self.model.parameters

    @property
    def start(self) -> float:
        """Value of the followed parameter at the start."""
        return self.model.values[self.parameter]

    def resolved(self) -> dict[str, Any]:
        """Return the scene with every default filled in, as plain data."""
        return written(self)

    def left_out(self, simulated: bool = False) -> list[str]:
        """Return what the scene does not ask for, in words; without a simulation that is left out,
        too, whatever the scene says of it."""
        unasked = [kind for kind in KINDS if kind not in self.events]
        words = []
        if unasked:
            words.append(f"events {', '.join(unasked)}: not asked for, not evaluated")
        if set(self.events) <= {*KINDS} - {*SECOND}:
            words.append("second derivatives: no event needs them, not generated")
        if self.curves is None:
            words.append("curves: no [curves]")
        with_voltages = [o for o in self.outputs if o.harvester is not None]
        uses_voltages = any(VOLTAGE in names_in(o.expression) for o in with_voltages)
        for what, table in (("simulation", "simulate"), ("energy", "energy")):
            if table == "energy" and uses_voltages:
                continue
            if getattr(self, table) is None:
                words.append(f"{what}: no [{table}]")
            elif not simulated:
                words.append(f"{what}: [{table}] is for contimpact simulate alone")
        if self.certify is not None:
            words.append("certificates: [certify] is for contimpact certify alone")
        if not self.switch:
            words.append("switching: follow.switch is empty")
        if not self.plot.formats:
            words.append("diagram: plot.formats is empty, matplotlib is not imported")
        return words


@explain_arguments
def load_scene(path: str | Path, systems: Mapping[str, type[Model]] | None = None) -> Scene:
    """Read and validate a scene file.

    Parameters
    ----------
    path : str or Path
    systems : mapping of str to type, optional
        Systems of your own that it may name, besides those that are installed.

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        If the file cannot be read or the scene is not valid.
    """
    given = read_toml(path)
    if "study" in given:
        accepted = "compute it by contimpact study, or take the table away"
        raise InputError(str(path), "a table [study]: it is a study of many scenes", accepted)
    return read(Scene, given, scene=systems, given=given)


def read_toml(path: str | Path) -> dict[str, Any]:
    """Return what a scene file holds, as nested mappings, not yet validated.

    Raises InputError if the file cannot be read or is not TOML.
    """
    path = Path(path)
    try:
        text = _text(path)
    except FileNotFoundError:
        raise InputError(str(path), "no such file", "give the path of a scene.toml") from None
    except IsADirectoryError:
        raise InputError(
            str(path), "a folder", f"give the file in it: {path / 'scene.toml'}"
        ) from None
    except UnicodeDecodeError as error:
        raise InputError(str(path), f"not UTF-8 ({error})", "save it as UTF-8 text") from None
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({reason(error)})", "check it") from None
    except ValueError as error:  # too long, or not a path at all
        raise InputError(str(path), str(error), "give a scene.toml") from None
    try:
        return tomllib.loads(text)
    except ValueError as error:  # TOMLDecodeError, and numbers of thousands of digits
        raise InputError(str(path), *explain_syntax(text, str(error))) from None
    except RecursionError:
        raise InputError(str(path), "nested too deeply", "give tables such as [follow]") from None


def _text(path: Path) -> str:
    """The text of a scene file, or of what stands for one, such as ``/dev/stdin``."""
    if path.parts[:2] == ("/", "dev"):
        with open(path, "rb") as stream:
            content = check_length(stream.read(LARGEST_FILE + 1), LARGEST_FILE)
    else:
        content = read_bounded(path, LARGEST_FILE)
    text = content.decode("utf-8-sig")
    if LONG_KEY.search(text):
        raise ValueError(f"a key of more than {LONGEST_KEY} names")
    return text


@explain_arguments
def read_scene(given: Mapping[str, Any], systems: Mapping[str, type[Model]] | None = None) -> Scene:
    """Validate a scene given as nested mappings.

    Parameters
    ----------
    given : mapping
        Tables and keys as in a scene file.
    systems : mapping of str to type, optional
        Systems of your own that it may name, as in `load_scene`.

    Returns
    -------
    Scene

    Raises
    ------
    InputError
        If it is not valid.
    """
    if not isinstance(given, Mapping):
        accepted = "give a table of tables; load_scene reads a file"
        raise InputError("scene", f"found {short_repr(given)}", accepted)
    return read(Scene, given, scene=systems, given=given)


# A commented scene to start from: it asks for little, and shows what else could be asked for.
#
# What a parameter means is told by its declaration.

_COMMENTS = 36
"""Where comments begin."""


@explain_arguments
def new_scene(name: str) -> str:
    """Return a commented scene to start from.

    Parameters
    ----------
    name : str
        Of a system, as scenes have it; see `list_systems`.

    Returns
    -------
    str
        A scene file.

    Raises
    ------
    InputError
        If there is no such system, or it has no `EXAMPLE`.
    """
    kind = find_system(name) if isinstance(name, str) else None
    if kind is None or kind.EXAMPLE is None:
        names = [name for name, kind in list_systems().items() if kind.EXAMPLE]
        found = f"no system {short_repr(name)}{did_you_mean(str(name), names)}"
        raise InputError("SYSTEM", found, f"accepted are {', '.join(names)}")
    start = kind.EXAMPLE
    return "\n".join(
        [
            "# `contimpact check FILE` validates this scene, `contimpact run FILE -o DIR` runs it.",
            '# Numbers may be expressions in quotes, such as "pi/6".',
            "",
            _line(f'name = "my {name}"'),
            "",
            *_model(name, kind, start),
            *_follow(start),
            *_further(start),
        ]
    )


def _model(name: str, kind: type[Model], start: Example) -> list[str]:
    lines = ["[model]", _line(f'system = "{name}"', summary(kind))]
    stated = [*start.model.splitlines()]
    options = [] if stated else [f'{n} = "{value}"' for n, value in kind.OPTIONS.items()]
    declared = {parameter.name: parameter for parameter in kind.PARAMETERS}
    wide = max(map(len, start.values))
    values = [
        _line(f"{n:<{wide}} = {_value_text(v)}", _meaning(declared.get(n)))
        for n, v in start.values.items()
    ]
    left = [
        _line(f"# {p.name:<{max(wide - 2, 1)}} = {p.default:.12g}", _meaning(p))
        for p in kind.PARAMETERS
        if p.name not in start.values and p.default is not None
    ]
    head = _line("[model.parameters]", "values at the start")
    return [*lines, *map(_line, options), *stated, "", head, *values, *left, ""]


def _follow(start: Example) -> list[str]:
    name, low, high = start.follow
    orbits = ", ".join(f'"{word}"' for word in start.orbits)
    mark = "" if start.model else "# "
    return [
        "[follow]",
        _line(f'parameter = "{name}"', "the parameter to follow"),
        _line(f"range     = [{low}, {high}]", "from where to where; the start lies within"),
        _line(f"orbits    = [{orbits}]", "words, or counts of impacts per period, to start from"),
        _line('switch    = ["G", "PD", "T"]', "kinds of events at which to follow what is born"),
        _line("# depth = 2", "how many switches deep; 1 otherwise"),
        _line("# survey = true", "looks for more orbits at nine values across the range"),
        _line(f"{mark}unphysical = false", "branches end where their orbits become unphysical"),
        "",
    ]


def _further(start: Example) -> list[str]:
    name, low, high = start.second
    return [
        "[plot]",
        _line(*start.plot),
        _line("# html = true", "also writes the page diagram.html"),
        "",
        _line("# [curves]", "bifurcations in a second parameter"),
        f'# parameter = "{name}"',
        f"# range = [{low}, {high}]",
        "",
        _line("# [simulate]", "what motion settles on, by `contimpact simulate FILE -o DIR`"),
        "# values = 51",
    ]


def _line(text: str, comment: str = "") -> str:
    return f"{text:<{_COMMENTS}} # {comment}" if comment else text


def _value_text(value: float | str) -> str:
    return f'"{value}"' if isinstance(value, str) else repr(value)


def _meaning(parameter: Parameter | None) -> str:
    """What a parameter is, its unit, and what is admitted."""
    if parameter is None:
        return ""
    unit = f" ({parameter.unit})" if parameter.unit else ""
    return f"{parameter.meaning}{unit}: {parameter.accepted}"
