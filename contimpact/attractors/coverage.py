"""Which attractors the branches explain, and what would follow those that none does.

An attractor lies on a branch if the branch has its word and period and, solved for at the
attractor's parameter value from the neighbouring points, its velocities and phases. The branch says
what it is; the simulation, which shares no solver with it, says that it is there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..models.word import Word, is_rotation
from ..orbits.orbit import Orbit
from ..orbits.quiet import problem_of
from ..orbits.search import solve_near
from ..results.branch import Branch
from ..results.diagram import Diagram
from ..results.tables import columns_of
from ..segments.kernels import Kernels
from .attractor import Attractor, Kind
from .sweep import Row, Sweep

MATCH = 1e-7
"""An attractor whose velocities and phases are this near to a branch's orbit lies on it."""


@dataclass(frozen=True)
class Match:
    """An attractor and the branch it lies on; `distance` is the largest difference."""

    direction: str
    value: float
    notation: str
    word: str
    period: int
    branch: str
    distance: float


@dataclass(frozen=True)
class Uncovered:
    """Attractors of one word, side by side in a sweep, that no branch explains.

    Attributes
    ----------
    kind, notation, word, period
        What they are.
    low, high : float
        Values of the parameter between which they were met.
    count : int
    why : str
    scene : str or None
        Tables of a scene that would follow them, in TOML; None for what is no periodic orbit.
    """

    kind: str
    notation: str
    word: str | None
    period: int | None
    low: float
    high: float
    count: int
    why: str
    scene: str | None


@dataclass(frozen=True)
class Coverage:
    """Attractors on branches, and the others."""

    matches: Sequence[Match]
    uncovered: Sequence[Uncovered]

    def as_record(self) -> dict[str, Any]:
        """Return plain data."""
        return asdict(self)


def cover(sweep: Sweep, diagram: Diagram, kernels: Kernels | None = None) -> Coverage:
    """Match the attractors of a sweep with the branches of a diagram.

    Parameters
    ----------
    sweep : Sweep
    diagram : Diagram
        Followed in the same parameter, at the same values of the others.
    kernels : Kernels, optional

    Returns
    -------
    Coverage
    """
    kernels = kernels or Kernels(sweep.model, sweep.parameter)
    matches: list[Match] = []
    rest: list[Row] = []
    for row in sweep.rows:
        match = _match(row, sweep, diagram, kernels)
        if match is not None:
            matches.append(match)
        else:
            rest.append(row)
    return Coverage(matches, _uncovered(rest, sweep))


def _match(row: Row, sweep: Sweep, diagram: Diagram, kernels: Kernels) -> Match | None:
    attractor = row.attractor
    if attractor.motion is not None:
        return _match_of_motion(row, sweep, diagram, kernels)
    if attractor.kind is not Kind.PERIODIC or attractor.word is None or attractor.period is None:
        return None
    best: Match | None = None
    for branch in diagram.branches:
        same_period = branch.period == attractor.period
        if not same_period or not is_rotation(branch.word, attractor.word):
            continue
        for orbit in orbits_on(branch, sweep, row.value, kernels):
            distance = _distance(attractor, branch.word, orbit.problem.impacts(orbit.unknowns))
            if distance < MATCH and (best is None or distance < best.distance):
                kind = (attractor.notation, attractor.word, attractor.period)
                best = Match(row.direction, row.value, *kind, branch.id, distance)
    return best


def _match_of_motion(row: Row, sweep: Sweep, diagram: Diagram, kernels: Kernels) -> Match | None:
    """As `_match`, of a motion without impacts; orbits of the word `0` are in the first mode."""
    attractor, found = row.attractor, []
    if not _first_mode(attractor, sweep):
        return None
    for branch in (b for b in diagram.branches if not b.word and b.period == 1):
        for orbit in orbits_on(branch, sweep, row.value, kernels):
            apart = np.abs(orbit.unknowns[: orbit.problem.m] - attractor.motion)
            kind = (attractor.notation, "0", 1)
            found.append(Match(row.direction, row.value, *kind, branch.id, float(np.max(apart))))
    near = [match for match in found if match.distance < MATCH]
    return min(near, key=lambda match: match.distance, default=None)


def _first_mode(attractor: Attractor, sweep: Sweep) -> bool:
    return attractor.mode in {mode.name for mode in sweep.model.MODES[:1]} | {""}


def orbits_on(branch: Branch, sweep: Sweep, value: float, kernels: Kernels) -> list[Orbit]:
    """Return the orbits of a branch at a parameter value.

    Each is solved for at that value from the line between the neighbouring points.
    """
    parameters = branch[branch.parameter]
    offset = parameters - value
    rows = np.nonzero((offset[:-1] <= 0.0) != (offset[1:] <= 0.0))[0].tolist()
    rows += [k for k in (0, len(parameters) - 1) if offset[k] == 0.0]
    model = sweep.model.replace(**{sweep.parameter: value})
    problem = problem_of(model, Word(branch.word, branch.period), kernels)
    found = []
    for row in rows:
        after = min(row + 1, len(parameters) - 1)
        step = parameters[after] - parameters[row]
        part = (value - parameters[row]) / step if step else 0.0
        names = columns_of(branch.word, problem.m)
        points = [np.array([branch[name][k] for name in names]) for k in (row, after)]
        guess = points[0] + part * (points[1] - points[0])
        here = solve_near(problem, np.append(guess, value))
        if here is not None:
            found.append(Orbit(problem, here))
    return found


def _distance(attractor: Attractor, word: str, orbit: Array) -> float:
    """Largest difference in phase (in periods) or coordinate, over the rotations of the word."""
    letters = attractor.word or ""
    best = math.inf
    for shift in range(len(word)):
        if word[shift:] + word[:shift] != letters:
            continue
        times, speeds, *others = np.roll(orbit, -shift, axis=0).T
        phases = (times - attractor.times) / attractor.forcing_period
        apart = [np.abs(phases - np.round(phases)), np.abs(speeds - attractor.velocities)]
        pairs = zip(others, attractor.others.T, strict=False)
        apart += [np.abs(one - other) for one, other in pairs]
        best = min(best, float(max(np.max(part) for part in apart)))
    return best


def _uncovered(rows: Sequence[Row], sweep: Sweep) -> list[Uncovered]:
    """Group rows by what they are; the middle one of each group starts the scene."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        groups.setdefault(row.attractor.label, []).append(row)
    found = []
    for group in groups.values():
        group = sorted(group, key=lambda row: row.value)
        middle = group[len(group) // 2]
        a = middle.attractor
        periodic = a.kind is Kind.PERIODIC or (a.motion is not None and _first_mode(a, sweep))
        why = "no branch has this orbit" if periodic else _why(a)
        scene = scene_fragment(middle, sweep) if periodic else None
        what = (a.kind.value, a.notation, a.word, a.period)
        found.append(Uncovered(*what, group[0].value, group[-1].value, len(group), why, scene))
    return found


def _why(attractor: Attractor) -> str:
    """Why what is not periodic, or not from the first mode on, lies on no branch."""
    if attractor.motion is not None:
        return f"{attractor.notation}: the word 0 is that of the first mode"
    return f"{attractor.kind.value}: no orbit of finite word"


def scene_fragment(row: Row, sweep: Sweep) -> str:
    """Return the tables [model] and [follow] of a scene that follows an attractor, in TOML."""
    attractor, model = row.attractor, sweep.model
    values: Mapping[str, float] = {**model.values, sweep.parameter: row.value}
    others = [other.value for other in sweep.rows]
    low, high = min(others), max(others)
    word = Word(attractor.word or "", attractor.period or 1)
    options = [f'{name} = "{text}"' for name, text in model.options.items()]
    lines = ["[model]", f'system = "{model.SYSTEM}"', *options, "", "[model.parameters]"]
    lines += [f"{name} = {value!r}" for name, value in values.items()]
    lines += ["", "[follow]", f'parameter = "{sweep.parameter}"', f"range = [{low!r}, {high!r}]"]
    return "\n".join([*lines, f'orbits = ["{word}"]', ""])
