"""Study files: read, validated, and their designs.

Every mistake is refused with the path of its key, what was found and what would do. The format is
a contract, documented key by key in the documentation's page on studies.
"""

from __future__ import annotations

import copy
import functools
import hashlib
import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError, explain_arguments, short_repr
from ..models.expressions import values_of
from ..models.model import Model
from ..results.options import LARGEST_SEED
from ..results.scene import Scene, read_scene, read_toml, systems_of
from ..schema import Table, fit, key, read

# The points of a study: the values that its parameters take, scene by scene.
#
# A study's points are all combinations of the values of its grid with the points of its sample, as
# far as the constraints admit them. Each has a number, its place among all combinations, which no
# constraint and no order of computation changes.

MOST_SCENES = 10**7
METHODS = ("random", "sobol")
SPACINGS = ("linear", "log")
_ORDER = re.compile(r"<=|>=|<|>")
_HOLDS = {"<": np.less, "<=": np.less_equal, ">": np.greater, ">=": np.greater_equal}


@dataclass(frozen=True)
class Axis:
    """A parameter of a grid and the values it takes."""

    name: str
    values: tuple[float, ...]


def _ranges(
    given: Mapping[str, tuple[float, float]], where: str, here: Any
) -> Mapping[str, tuple[float, float]]:
    if not given:
        raise InputError(where, "empty", "give a range such as beta = [0.1, 1.5]")
    return given


@dataclass(frozen=True)
class Sample:
    """Points drawn at random, or from a scrambled Sobol' sequence, within ranges of parameters."""

    method: str = key(choices=METHODS)
    count: int = key(most=MOST_SCENES)
    seed: int = key(0, least=0, most=LARGEST_SEED)
    ranges: Mapping[str, tuple[float, float]] = key({}, name="range", check=_ranges)

    def points(self) -> Array:
        """Return the points, shape (count, number of ranges); the same for the same seed."""
        from scipy.stats import qmc

        low, high = np.transpose(list(self.ranges.values()))
        if self.method == "random":
            unit = np.random.default_rng(self.seed).random((self.count, len(low)))
        else:
            unit = qmc.Sobol(len(low), scramble=True, seed=self.seed).random_base2(
                (self.count - 1).bit_length()
            )[: self.count]
        return np.asarray(low + unit * (high - low))


@dataclass(frozen=True)
class _Spaced:
    """Values of equal distance, or of equal ratio."""

    first: float = key(name="from")
    last: float = key(name="to")
    count: int = key(least=2, most=MOST_SCENES)
    spacing: str = key(SPACINGS[0], choices=SPACINGS)


def _axis(name: str, given: Any, where: str) -> Axis:
    if isinstance(given, Mapping):
        at = read(_Spaced, given, where)
        if at.spacing == "log" and at.first * at.last <= 0.0:
            found = f"found from {at.first:.6g} to {at.last:.6g}"
            raise InputError(where, found, "give two numbers above 0, or spacing = 'linear'")
        spaced = np.linspace if at.spacing == "linear" else np.geomspace
        values = tuple(float(value) for value in spaced(at.first, at.last, at.count))
    else:
        values = fit(given, tuple[float, ...], where)
    if not values or len(set(values)) < len(values):
        found = "a value twice" if values else "empty"
        raise InputError(where, found, "give different values, at least one")
    return Axis(name, values)


def _axes(given: Mapping[str, Any], where: str) -> tuple[Axis, ...]:
    """The axes of a grid; too many points are refused before values are made."""
    counts = [
        v.get("count") if isinstance(v, Mapping) else len(v) if isinstance(v, list | tuple) else 1
        for v in given.values()
    ]
    _require_few(math.prod(n for n in counts if isinstance(n, int) and n > 0))
    return tuple(_axis(name, values, f"{where}.{name}") for name, values in given.items())


def _require_few(count: int) -> None:
    """Raise `InputError` for more scenes than a study may have."""
    if count > MOST_SCENES:
        raise InputError("study", f"{count} scenes", f"at most {MOST_SCENES} are admitted")


@dataclass(frozen=True)
class Design:
    """The points of a study."""

    axes: tuple[Axis, ...] = key(
        {},
        "the values of each parameter: a list, or `{ from, to, count }`, evenly spaced, or at "
        'equal ratios with `spacing = "log"`',
        name="grid",
        given=Mapping[str, Any],
        check=lambda given, where, here: _axes(given, where),
    )
    """Axes of the grid; the last one varies fastest."""
    sample: Sample | None = key(
        None,
        'additional points: `method` (`"sobol"`, a scrambled Sobol\' sequence, or `"random"`), '
        "`count`, `seed` (0), and `range`, two numbers for each parameter",
    )
    constraints: tuple[str, ...] = key(
        (),
        'inequalities between parameters, such as `"r_T <= r_B"` or `"0.1 < s*sin(beta) < 0.2"`; '
        "scenes that violate one are left out",
    )
    fixed: Mapping[str, float] | None = None
    """Parameters that are the same in all scenes."""

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that differ between scenes."""
        drawn = self.sample.ranges if self.sample else ()
        return (*(axis.name for axis in self.axes), *drawn)

    @property
    def combinations(self) -> int:
        """Points before constraints."""
        count = self.sample.count if self.sample else 1
        for axis in self.axes:
            count *= len(axis.values)
        return count

    def points(self) -> tuple[Array, Array]:
        """Return the numbers of the points that the constraints admit, and their values.

        Raises InputError if a constraint cannot be read, or none is left.
        """
        shape = [len(axis.values) for axis in self.axes]
        drawn = self.sample.points() if self.sample else np.zeros((1, 0))
        places = np.unravel_index(np.arange(self.combinations), (*shape, len(drawn)))
        columns = [np.array(a.values)[p] for a, p in zip(self.axes, places, strict=False)]
        values = np.column_stack([*columns, drawn[places[-1]]])
        admitted = self._admitted(values)
        if not np.any(admitted):
            found = f"they admit none of {len(values)} points"
            raise InputError("study.constraints", found, "take some of them away")
        return np.flatnonzero(admitted), values[admitted]

    def _admitted(self, values: Array) -> Array:
        fixed = {name: np.full(len(values), value) for name, value in (self.fixed or {}).items()}
        known = fixed | dict(zip(self.names, values.T, strict=True))
        admitted = np.ones(len(values), dtype=bool)
        for i, text in enumerate(self.constraints):
            admitted &= _where_holds(text, f"study.constraints[{i}]", known)
        return admitted


def _where_holds(text: str, where: str, known: Mapping[str, Array]) -> Array:
    """Where a chain of inequalities such as ``0.1 < r_T <= r_B`` holds, with finite sides."""
    signs, sides = _ORDER.findall(text), _ORDER.split(text)
    if not signs:
        accepted = "give an inequality such as 'r_T <= r_B', with <, <=, > or >="
        raise InputError(where, f"found {text!r}", accepted)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        values = [values_of(side, where, known) for side in sides]
        sides_of = zip(signs, values[:-1], values[1:], strict=True)
        each = [_HOLDS[sign](one, other) for sign, one, other in sides_of]
    each += [np.isfinite(value) for value in values]
    length = len(next(iter(known.values())))
    return np.logical_and.reduce([np.broadcast_to(one, length) for one in each])


def _checked(design: Design, where: str, here: Any) -> Design:
    """A design with the parameters that the scene itself gives."""
    model = Table(here.scene).table("model")
    own = model.get("parameters", Mapping[str, float], {})
    names = design.names
    if not names:
        accepted = "give the values of parameters in [study.grid], ranges in [study.sample.range]"
        raise InputError("study", "no parameter differs between scenes", accepted)
    if twice := next((name for name in names if names.count(name) > 1), None):
        found = f"{twice} is in the grid already"
        raise InputError(f"study.sample.range.{twice}", found, "give it in one place")
    _require_few(design.combinations)
    return replace(design, fixed=own)


KEPT = ("catalogue", "readings", "attractors", "energies", "curves", "tables")
"""Parts of its scenes that a study may keep besides their events."""
ASKED_FOR = {"attractors": "simulate", "energies": "energy", "curves": "curves"}
"""The table of the scene without which there would be nothing to keep."""
LONGEST_BUDGET = 1e7


@dataclass(frozen=True, kw_only=True)
class StudyFile:
    """A validated study."""

    name: str = key(doc="the name of the study")
    source: str = key("", "where it comes from")
    design: Design = key(
        table="study",
        inline={name: {} for name in ("axes", "sample", "constraints")},
        check=_checked,
    )
    """The points of its scenes."""
    keep: tuple[str, ...] = key(
        ("readings",),
        "what is kept in addition to branches and events",
        table="study",
        choices=KEPT,
    )
    budget: float | None = key(
        None,
        "seconds that one scene may take",
        table="study",
        above=0,
        most=LONGEST_BUDGET,
        shown="none",
    )
    given: Mapping[str, Any] = field(default_factory=dict)
    """The file as it was written."""
    systems: tuple[str, ...] = ()
    """Files that define systems or kinds of events of one's own."""

    @functools.cached_property
    def points(self) -> tuple[Array, Array]:
        """The scenes' numbers, and the values of the study's parameters in each."""
        return self.design.points()

    def __len__(self) -> int:
        return len(self.points[0])

    def scene_at(self, values: Sequence[float], number: int | None = None) -> dict[str, Any]:
        """Return the scene at values of the study's parameters, as a scene file has it."""
        given = {key: value for key, value in self.given.items() if key != "study"}
        model = dict(given["model"])
        own = dict(zip(self.design.names, map(float, values), strict=True))
        model["parameters"] = {**model.get("parameters", {}), **own}
        name = self.name if number is None else f"{self.name}-{number}"
        return {**given, "name": name, "model": model}

    def read_scene_at(self, values: Sequence[float]) -> Scene:
        """Return the scene at values of the study's parameters, read and validated."""
        return read_scene(self.scene_at(values), systems_in(self.systems))

    @functools.cached_property
    def first(self) -> Scene:
        """The first scene."""
        return self.read_scene_at(self.points[1][0])

    @property
    def digest(self) -> str:
        """A digest of all that decides what is computed and kept."""
        content = {k: v for k, v in self.given.items() if k not in ("source", "plot")}
        study = {k: v for k, v in content["study"].items() if k != "budget"}
        own = [hashlib.sha256(content).hexdigest() for content in _contents(self.systems)]
        known = {**content, "study": study} | ({"systems": own} if own else {})
        text = json.dumps(known, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


def systems_in(files: tuple[str, ...]) -> Mapping[str, type[Model]]:
    """Return the systems that files define; a process runs them once, unless they change."""
    return _systems_in(files, _contents(files))


@functools.cache
def _systems_in(files: tuple[str, ...], _: tuple[bytes, ...]) -> Mapping[str, type[Model]]:
    return systems_of(files)


def _contents(files: Sequence[str]) -> tuple[bytes, ...]:
    """What files hold; nothing where there is none, which is told where it is run."""
    return tuple(Path(f).read_bytes() if Path(f).is_file() else b"" for f in files)


@explain_arguments
def load_study(path: str | Path, systems: Sequence[str | Path] = ()) -> StudyFile:
    """Read and validate a study file.

    Parameters
    ----------
    path : str or Path
    systems : sequence of str or Path
        Python files that define systems or kinds of events of one's own. Each process that
        computes runs them, so that workers elsewhere need them at the same place.

    Returns
    -------
    StudyFile

    Raises
    ------
    InputError
        If the file cannot be read or the study is not valid.
    """
    given = read_toml(path)
    if "study" not in given:
        accepted = "add a table [study], or use contimpact run for a single scene"
        raise InputError(str(path), "no table [study]", accepted)
    return read_study(given, systems)


@explain_arguments
def read_study(given: Mapping[str, Any], systems: Sequence[str | Path] = ()) -> StudyFile:
    """Validate a study given as nested mappings.

    Parameters
    ----------
    given : mapping
        Tables and keys as in a study file.
    systems : sequence of str or Path
        As for `load_study`.

    Returns
    -------
    StudyFile

    Raises
    ------
    InputError
        If it is not valid.
    """
    if not isinstance(given, Mapping):
        raise InputError("study", f"found {short_repr(given)}", "give a table of tables")
    given = copy.deepcopy(dict(given))
    files = tuple(str(Path(file).resolve()) for file in systems)
    study = read(StudyFile, given, scene=given, partly=True, given=given, systems=files)
    _check_scenes(study)
    _check_keep(study)
    return study


def _check_scenes(study: StudyFile) -> None:
    """Refuse a study whose scenes are none: at its first point, and at the ends of each range."""
    names, (_, values) = study.design.names, study.points
    if twice := next((name for name in names if name in (study.design.fixed or {})), None):
        found = f"{twice} differs between scenes"
        raise InputError(f"model.parameters.{twice}", found, "give it in [study] alone")
    try:
        assert study.first
    except InputError as error:
        own = error.where.removeprefix("model.parameters.")
        raise _move_error(study, own, error) if own in names else error from None
    for column, name in enumerate(names):
        for row in (values[:, column].argmin(), values[:, column].argmax()):
            try:
                study.read_scene_at(values[row])
            except InputError as error:
                raise _move_error(
                    study, name, error, f"at {name} = {values[row, column]:.6g}: "
                ) from None


def _move_error(study: StudyFile, name: str, error: InputError, at: str = "") -> InputError:
    """An error of a scene, at the place where the study gives the parameter."""
    drawn = study.design.sample.ranges if study.design.sample else ()
    where = f"study.sample.range.{name}" if name in drawn else f"study.grid.{name}"
    found = error.found if error.where.endswith(f".{name}") else f"{error.where}: {error.found}"
    return InputError(where, at + found, error.accepted)


def _check_keep(study: StudyFile) -> None:
    for i, what in enumerate(study.keep):
        asked = ASKED_FOR.get(what)
        if asked is not None and getattr(study.first, asked) is None:
            raise InputError(
                f"study.keep[{i}]", f"{what}, but no [{asked}]", f"add a table [{asked}]"
            )
    if study.first.margins is not None and "tables" not in study.keep:
        raise InputError("study.keep", "[margins] without tables", "add 'tables', or leave it out")
    if "energies" in study.keep and study.first.simulate is None:
        raise InputError("study.keep", "energies, but no [simulate]", "add a table [simulate]")
