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
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from ..bifurcations.declarations import EVENTS, KINDS, SECOND
from ..continuation.settings import Settings
from ..display import ParameterItems
from ..errors import InputError, each_once, explain_arguments, short_repr
from ..models.guards import graph
from ..models.model import Model
from ..models.outputs import Output
from ..models.word import Word, parse_word
from ..storage.files import check_length, read_bounded, reason
from ..systems import SYSTEMS
from .options import FORMATS, SCENE_SETTINGS, CertifyOptions, CurveOptions, PlotOptions, Table
from .scene_tables import (
    read_certify,
    read_curves,
    read_detect,
    read_model,
    read_numerics,
    read_outputs,
    read_plot,
    read_reach,
    read_simulation,
)

if TYPE_CHECKING:
    from ..systems.membrane import Membrane
    from .simulate_tables import SimulateOptions


# Names of scenes, and the folders that results have in a run of several scenes.
#
# A name is any text of one line. Its folder is the name itself, with what not every file system can
# hold in it as ``%`` and two hexadecimal digits for each byte, as in addresses: no two names have
# one
# folder. Names that would be too long so are cut, and end with a digest of the whole.

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
    """Return what was found in a text that is not TOML, and what would be accepted.

    Parameters
    ----------
    error : str
        What the reader of TOML says.
    """
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


# Systems of the user's own, from Python files that are named on the command line.
#
# A scene is data and never names code: which file is run is the explicit choice of the one who
# gives
# the command.

DEFINE = "define a subclass of Model in it, with SYSTEM, PARAMETERS, WALLS and formulas"


def systems_of(files: Iterable[str]) -> dict[str, type[Model]]:
    """Run Python files, and return the systems that they define, by name.

    Each file's folder is searched for modules that it imports, after all other places.

    Raises
    ------
    InputError
        Naming the file, if it cannot be read or run, defines no system, or one of a name that is
        taken.
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
    """The systems that a module defines itself."""
    found = [
        value
        for value in vars(module).values()
        if isinstance(value, type)
        and issubclass(value, Model)
        and value.__module__ == module.__name__
        and "SYSTEM" in vars(value)
    ]
    if not found:
        raise InputError(file, "it defines no system", DEFINE)
    return list(dict.fromkeys(found))


LARGEST_FILE = 1_000_000
"""Bytes of a scene file."""
LONGEST_KEY = 100
LONG_KEY = re.compile(
    r"""^[ \t]*+(?:(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){100}""",
    re.MULTILINE,
)
"""A dotted key of more names than `LONGEST_KEY`; reading it takes the square of their number."""

__all__ = ["FORMATS", "CurveOptions", "PlotOptions", "Scene", "load_scene", "read_scene"]


@dataclass(frozen=True)
class Scene(ParameterItems):
    """A validated scene."""

    name: str
    source: str
    model: Model
    """Model at the start's parameter values."""
    parameter: str
    """The followed parameter."""
    range: tuple[float, float]
    orbits: tuple[Word, ...]
    switch: tuple[str, ...] = ()
    """Kinds of events at which to switch to the branch born there."""
    depth: int = 1
    """How many switches deep."""
    max_branches: int = 50
    max_points: int = 20000
    """`max_branches`, `max_points`: budget of the whole diagram."""
    survey: bool | str = False
    """Whether to look for more orbits across the range: of each word met, or, with "orbits", of
    those named alone."""
    unphysical: bool = True
    """Whether branches go on, and begin, where their orbits are unphysical."""
    events: tuple[str, ...] = EVENTS
    """Kinds to look for."""
    values: Mapping[str, Sequence[float]] = field(default_factory=dict)
    """Values to hit exactly, by parameter."""
    crises: bool = False
    """Whether crises are located where complex motion ends."""
    settings: Settings = SCENE_SETTINGS
    seed: int = 0
    starts: int = 256
    rounds: int = 8
    """`seed`, `starts`, `rounds`: of the search for orbits."""
    plot: PlotOptions = field(kw_only=True)
    curves: CurveOptions | None = None
    simulate: SimulateOptions | None = None
    """Options of ``contimpact simulate``; ``contimpact run`` sweeps by them for crises."""
    energy: Membrane | None = None
    """Data from which output voltages are computed, if they are."""
    certify: CertifyOptions | None = None
    """Options of ``contimpact certify``, where the scene has some."""
    outputs: tuple[Output, ...] = ()
    """Expressions of which branches have the means."""
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
                "unphysical": self.unphysical,
            },
            "detect": {
                "events": list(self.events),
                "values": {name: list(values) for name, values in self.values.items()},
                **({"crises": True} if self.crises else {}),
            },
            "numerics": {
                **asdict(self.settings),
                **{name: getattr(self, name) for name in ("seed", "starts", "rounds")},
            },
            **({"curves": self._resolved_curves()} if self.curves else {}),
            **({"simulate": self.simulate.resolved()} if self.simulate else {}),
            **({"energy": asdict(self.energy)} if self.energy else {}),
            **({"certify": self._resolved_certify()} if self.certify else {}),
            **({"output": self._resolved_outputs()} if self.outputs else {}),
            "plot": {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in asdict(self.plot).items()
                if value is not None and value is not False
            },
        }

    def _resolved_outputs(self) -> dict[str, Any]:
        return {
            one.name: {"before_impacts": one.expression} if one.at_impacts else one.expression
            for one in self.outputs
        }

    def _resolved_certify(self) -> dict[str, Any]:
        assert self.certify is not None
        return {name: value for name, value in asdict(self.certify).items() if name != "events"}

    def _resolved_curves(self) -> dict[str, Any]:
        curves = self.curves
        assert curves is not None
        family = {} if curves.family is None else {curves.family[0]: list(curves.family[1])}
        third = {} if curves.third is None else _named_range(*curves.third)
        settings = curves.settings
        return {
            "parameter": curves.parameter,
            "range": list(curves.range),
            "kinds": list(curves.kinds),
            "unphysical": list(curves.unphysical),
            "values": list(curves.values),
            "start": list(curves.start),
            "cover": curves.cover,
            "areas": curves.areas,
            "reach": curves.reach,
            "step": settings.step,
            "max_step": settings.max_step,
            "max_points": settings.max_points,
            "family": family,
            "third": third,
        }

    def left_out(self, simulated: bool = False) -> list[str]:
        """Return what the scene does not ask for, in words; without a simulation that is left out,
        too, whatever the scene says of it."""
        unasked = [kind for kind in KINDS if kind not in self.events]
        words = []
        if unasked:
            words.append(f"events {', '.join(unasked)}: not asked for, not evaluated")
        if not set(self.events) & {*SECOND}:
            words.append("second derivatives: no event needs them, not generated")
        if self.curves is None:
            words.append("curves: no [curves]")
        for what, key in (("simulation", "simulate"), ("energy", "energy")):
            if getattr(self, key) is None:
                words.append(f"{what}: no [{key}]")
            elif not simulated:
                words.append(f"{what}: [{key}] is for contimpact simulate alone")
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
    return read_scene(given, systems)


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


def _named_range(name: str, limits: tuple[float, float]) -> dict[str, Any]:
    return {"parameter": name, "range": list(limits)}


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
    top = Table(given, "")
    name = check_name(top.text("name"))
    source = top.text("source", "")
    model = read_model(top.table("model"), systems)
    follow = top.table("follow")
    parameter = follow.text("parameter")
    declared = model.require(parameter, "follow.parameter")
    low, high = (declared.check(v, "follow.range") for v in follow.pair("range"))
    start = model.values[parameter]
    if not low <= start <= high:
        found = f"[{low:.12g}, {high:.12g}] does not hold the start {parameter} = {start:.12g}"
        raise InputError("follow.range", found, f"widen it or change model.parameters.{parameter}")
    model.validate_between(parameter, low, high, "follow.range")
    words = [
        parse_word(text, model.letters, f"follow.orbits[{i}]", graph(model.WALLS), model.autonomous)
        for i, text in enumerate(follow.texts("orbits"))
    ]
    if not (orbits := tuple(each_once(words, "follow.orbits"))):
        raise InputError("follow.orbits", "empty", "name at least one orbit, such as '1:1'")
    detect = top.table("detect", optional=True)
    events, values, crises = read_detect(detect, model, parameter, (low, high))
    reach = read_reach(follow, model, events)
    follow.finish()
    settings, search = read_numerics(top.table("numerics", optional=True))
    outputs = read_outputs(top.table("output", optional=True), model)
    plot = read_plot(top.table("plot", optional=True), model, parameter, [o.name for o in outputs])
    curves = None
    if top.has("curves"):
        steps = max(1, reach["depth"]) if reach["switch"] else 1
        curves = read_curves(top.table("curves"), model, parameter, events, steps)
    simulate, energy = read_simulation(top, model, parameter, (low, high))
    certify = read_certify(top.table("certify"), events) if top.has("certify") else None
    if certify and model.autonomous:
        found = "proofs are for the forcing's period, and the system has no forcing"
        raise InputError("certify", found, "leave it out")
    top.finish()
    if simulate is not None and simulate.branches:
        simulate = replace(simulate, crises=simulate.crises or crises)
    asked: dict[str, Any] = {"events": events, "values": values, "settings": settings, "plot": plot}
    asked |= {"curves": curves, "simulate": simulate, "energy": energy, "certify": certify}
    asked |= {"crises": crises, "outputs": outputs, **search, **reach}
    return Scene(name, source, model, parameter, (low, high), orbits, given=given, **asked)
