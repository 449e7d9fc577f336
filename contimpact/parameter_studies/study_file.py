"""Study files: a scene with a table [study] that says what differs between scenes.

Every mistake is refused with the path of its key, what was found and what would do. The format is
a contract, documented key by key in the documentation's page on studies.
"""

from __future__ import annotations

import copy
import functools
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..arrays import Array
from ..errors import InputError, shown
from ..results.options import Table
from ..results.scene import Scene, read_scene, read_toml
from .design import Design, read_design

KEPT = ("catalogue", "readings", "attractors", "energies", "curves", "tables")
"""What a study may keep of its scenes besides their events."""
ASKED_FOR = {"attractors": "simulate", "energies": "energy", "curves": "curves"}
"""The table of the scene without which there would be nothing to keep."""
LONGEST_BUDGET = 1e7


@dataclass(frozen=True)
class StudyFile:
    """A validated study.

    Attributes
    ----------
    name, source : str
    given : mapping
        The file as it was written.
    design : Design
        The points of its scenes.
    keep : sequence of str
        Of `KEPT`.
    budget : float or None
        Seconds that one scene may take.
    """

    name: str
    source: str
    given: Mapping[str, Any]
    design: Design
    keep: tuple[str, ...]
    budget: float | None

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
        raise InputError("study", f"found {shown(given)}", "give a table of tables")
    given = copy.deepcopy(dict(given))
    top = Table(given, "")
    name, source, table = top.text("name"), top.text("source", ""), top.table("study")
    keep = table.texts("keep", ["readings"])
    budget = table.number("budget") if table.has("budget") else None
    if budget is not None and not 0.0 < budget <= LONGEST_BUDGET:
        raise table.refuse("budget", budget, f"seconds, above 0, at most {LONGEST_BUDGET:g}")
    design = read_design(table, _fixed(top))
    table.finish()
    study = StudyFile(name, source, given, design, tuple(dict.fromkeys(keep)), budget)
    _check_scenes(study)
    _check_keep(study)
    return study


def _fixed(top: Table) -> dict[str, float]:
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
        raise _moved(study, own, error) if own in names else error from None
    for column, name in enumerate(names):
        for row in (values[:, column].argmin(), values[:, column].argmax()):
            try:
                read_scene(study.scene_at(values[row]))
            except InputError as error:
                raise _moved(
                    study, name, error, f"at {name} = {values[row, column]:.6g}: "
                ) from None


def _moved(study: StudyFile, name: str, error: InputError, at: str = "") -> InputError:
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
