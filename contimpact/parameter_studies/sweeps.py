"""The sweeps of simulated motion that a study has made, one for each of its scenes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..results.scene import read_scene
from ..simulation.attractor import Attractor, Kind
from ..simulation.sweep import Row, Simulators, Sweep
from .study_file import StudyFile, read_study

if TYPE_CHECKING:
    from .study import Study


def sweeps_of(study: Study) -> list[Sweep]:
    """Return the sweeps of a study's scenes, in their order.

    Parameters
    ----------
    study : Study
        That keeps attractors.

    Returns
    -------
    list of Sweep
        Their attractors say what they are and where, by kind, word, period and notation; the
        impacts are not kept in a store. Scenes without attractors have none.

    Raises
    ------
    InputError
        If the study does not keep attractors.
    """
    file = read_study(study.given)
    if "attractors" not in file.keep:
        found = f"it keeps {', '.join(file.keep) or 'nothing'}"
        raise InputError(f"study {study.name}", found, "add 'attractors' to study.keep")
    rows: dict[int, list[Mapping[str, Any]]] = {}
    for row in study.attractors():
        rows.setdefault(row["scene"], []).append(row)
    places = dict(zip(*file.points, strict=True))
    return [_sweep(file, places[number], found) for number, found in sorted(rows.items())]


def _sweep(file: StudyFile, values: Sequence[float], rows: Sequence[Mapping[str, Any]]) -> Sweep:
    scene = read_scene(file.scene_at(values))
    simulators = Simulators(scene.model, scene.parameter)
    ordered = sorted(rows, key=lambda row: row["number"])
    made = [Row(row["direction"], row["value"], _attractor(simulators, row)) for row in ordered]
    return Sweep(scene.model, scene.parameter, made)


def _attractor(simulators: Simulators, row: Mapping[str, Any]) -> Attractor:
    simulator = simulators.at(row["value"])
    return Attractor(
        Kind(row["kind"]),
        {**simulator.model.values, **simulator.derived},
        row["notation"],
        simulator.period,
        row["word"],
        row["period"],
    )
