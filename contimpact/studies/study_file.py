"""Study files: read, validated, and their designs.

Every mistake is refused with the path of its key, what was found and what would do. The format is
a contract, documented key by key in the documentation's page on studies.
"""

from __future__ import annotations

import copy
import functools
import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..arrays import Array
from ..errors import InputError, explain_arguments, short_repr
from ..models.expressions import values_of
from ..results.options import LARGEST_SEED, Table
from ..results.scene import Scene, read_scene, read_toml

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


@dataclass(frozen=True)
class Sample:
    """Points drawn at random, or from a Sobol' sequence, within ranges of parameters."""

    method: str
    """``random`` or ``sobol`` (scrambled)."""
    count: int
    seed: int
    ranges: Mapping[str, tuple[float, float]]

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
class Design:
    """The points of a study."""

    axes: tuple[Axis, ...]
    """Axes of the grid; the last one varies fastest."""
    sample: Sample | None
    constraints: tuple[str, ...] = ()
    """Such as ``r_T <= r_B``, in the names of `fixed` and of the study's own parameters."""
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
    """Where a chain of inequalities such as ``0.1 < r_T <= r_B`` holds."""
    signs, sides = _ORDER.findall(text), _ORDER.split(text)
    if not signs:
        accepted = "give an inequality such as 'r_T <= r_B', with <, <=, > or >="
        raise InputError(where, f"found {text!r}", accepted)
    values = [values_of(side, where, known) for side in sides]
    sides_of = zip(signs, values[:-1], values[1:], strict=True)
    with np.errstate(invalid="ignore"):
        each = [_HOLDS[sign](one, other) for sign, one, other in sides_of]
    length = len(next(iter(known.values())))
    return np.logical_and.reduce([np.broadcast_to(one, length) for one in each])


def read_design(table: Table, fixed: Mapping[str, float]) -> Design:
    """Return the points that [study] asks for."""
    axes = _axes(table.table("grid", optional=True))
    sample = _sample(table.table("sample")) if table.has("sample") else None
    constraints = tuple(table.texts("constraints", []))
    design = Design(axes, sample, constraints, fixed)
    names = design.names
    if not names:
        accepted = "give the values of parameters in [study.grid], ranges in [study.sample.range]"
        raise InputError(table.path, "no parameter differs between scenes", accepted)
    if twice := next((name for name in names if names.count(name) > 1), None):
        found = f"{twice} is in the grid already"
        raise InputError(f"study.sample.range.{twice}", found, "give it in one place")
    if design.combinations > MOST_SCENES:
        found = f"{design.combinations} scenes"
        raise InputError(table.path, found, f"at most {MOST_SCENES} are admitted")
    return design


def _axes(table: Table) -> tuple[Axis, ...]:
    axes = []
    for name in list(table.data):
        spaced = isinstance(table.data[name], Mapping)
        values = _spaced_values(table.table(name)) if spaced else table.numbers(name)
        if not values or len(set(values)) < len(values):
            found = "a value twice" if values else "empty"
            raise InputError(table.place(name), found, "give different values, at least one")
        axes.append(Axis(name, tuple(values)))
    table.finish()
    return tuple(axes)


def _spaced_values(table: Table) -> Sequence[float]:
    """Values of equal distance, or of equal ratio."""
    first, last = table.number("from"), table.number("to")
    count = table.whole("count", least=2, most=MOST_SCENES)
    spacing = table.text("spacing", SPACINGS[0])
    table.finish()
    if spacing not in SPACINGS:
        accepted = f"accepted are {', '.join(SPACINGS)}"
        raise InputError(table.place("spacing"), f"found {spacing!r}", accepted)
    if spacing == "linear":
        return [float(value) for value in np.linspace(first, last, count)]
    if first * last <= 0.0:
        found = f"found from {first:.6g} to {last:.6g}"
        raise InputError(table.path, found, "give two numbers above 0, or spacing = 'linear'")
    return [float(value) for value in np.geomspace(first, last, count)]


def _sample(table: Table) -> Sample:
    method = table.text("method")
    if method not in METHODS:
        accepted = f"accepted are {', '.join(METHODS)}"
        raise InputError(table.place("method"), f"found {method!r}", accepted)
    count = table.whole("count", most=MOST_SCENES)
    seed = table.whole("seed", 0, least=0, most=LARGEST_SEED)
    ranges: Any = table.table("range")
    limits = {name: ranges.pair(name) for name in list(ranges.data)}
    if not limits:
        raise InputError(ranges.path, "empty", "give a range such as beta = [0.1, 1.5]")
    ranges.finish()
    table.finish()
    return Sample(method, count, seed, limits)


KEPT = ("catalogue", "readings", "attractors", "energies", "curves", "tables")
"""Parts of its scenes that a study may keep besides their events."""
ASKED_FOR = {"attractors": "simulate", "energies": "energy", "curves": "curves"}
"""The table of the scene without which there would be nothing to keep."""
LONGEST_BUDGET = 1e7


@dataclass(frozen=True)
class StudyFile:
    """A validated study."""

    name: str
    source: str
    given: Mapping[str, Any]
    """The file as it was written."""
    design: Design
    """The points of its scenes."""
    keep: tuple[str, ...]
    """Those of `KEPT` that are kept."""
    budget: float | None
    """Seconds that one scene may take."""

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

    @functools.cached_property
    def first(self) -> Scene:
        """The first scene."""
        return read_scene(self.scene_at(self.points[1][0]))

    @property
    def digest(self) -> str:
        """A digest of all that decides what is computed and kept."""
        content = {k: v for k, v in self.given.items() if k not in ("source", "plot")}
        study = {k: v for k, v in content["study"].items() if k != "budget"}
        text = json.dumps({**content, "study": study}, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


@explain_arguments
def load_study(path: str | Path) -> StudyFile:
    """Read and validate a study file.

    Parameters
    ----------
    path : str or Path

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
    return read_study(given)


@explain_arguments
def read_study(given: Mapping[str, Any]) -> StudyFile:
    """Validate a study given as nested mappings.

    Parameters
    ----------
    given : mapping
        Tables and keys as in a study file.

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
    top = Table(given, "")
    name, source, table = top.text("name"), top.text("source", ""), top.table("study")
    keep = table.texts("keep", ["readings"])
    budget = table.number("budget") if table.has("budget") else None
    if budget is not None and not 0.0 < budget <= LONGEST_BUDGET:
        raise table.refuse("budget", budget, f"seconds, above 0, at most {LONGEST_BUDGET:g}")
    design = read_design(table, _scene_parameters(top))
    table.finish()
    study = StudyFile(name, source, given, design, tuple(keep), budget)
    _check_scenes(study)
    _check_keep(study)
    return study


def _scene_parameters(top: Table) -> dict[str, float]:
    """The parameters that the scene itself gives; those of the study stand in [study]."""
    model = top.table("model")
    if not model.has("parameters"):
        return {}
    parameters = model.table("parameters")
    return {name: parameters.number(name) for name in list(parameters.data)}


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
                read_scene(study.scene_at(values[row]))
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
        where = f"study.keep[{i}]"
        if what not in KEPT:
            raise InputError(where, f"found {what!r}", f"accepted are {', '.join(KEPT)}")
        asked = ASKED_FOR.get(what)
        if asked is not None and getattr(study.first, asked) is None:
            raise InputError(where, f"{what}, but no [{asked}]", f"add a table [{asked}]")
    if "energies" in study.keep and study.first.simulate is None:
        raise InputError("study.keep", "energies, but no [simulate]", "add a table [simulate]")
