"""Stable orbits along a vertical line of a map of two parameters, and what ends each of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..bifurcations.registry import test_functions
from ..continuation.ends import EndKind
from ..models.model import Model
from ..models.word import Word
from ..orbits.orbit import Orbit
from ..orbits.quiet import problem_of
from ..results.branch import Branch, Entry
from ..results.curve import StableOrbit
from ..results.diagram_reading import stable_intervals
from ..results.scene import Scene
from ..segments.kernels import Kernels
from .frame import Frame
from .runs import run_along

SAME_ORBIT = 1e-7
"""Of velocities and heights at which two branches end in the same orbit."""


@dataclass(frozen=True)
class Stretch:
    """A stable orbit along a vertical line: between which heights, and what it meets at either,
    the lower one first."""

    low: float
    high: float
    orbit: StableOrbit
    branch: Branch
    events: tuple[Entry | None, Entry | None]


def stable_branches(
    scene: Scene, model: Model, word: Word, kernels: Kernels, searched: Sequence[float]
) -> list[Branch]:
    """Follow every stable physical orbit of a word that is found at some values of a parameter.

    Parameters
    ----------
    scene : Scene
    model : Model
        Gives the values of the other parameters.
    word : Word
    kernels : Kernels
        With the parameter free.
    searched : sequence of float
        The values.
    """
    tests = test_functions(problem_of(model, word, kernels), scene.events, {})

    def wanted(orbit: Orbit) -> bool:
        return orbit.stable and orbit.physical

    runs = run_along(scene, model, word, kernels, scene.range, searched, tests, wanted)
    return [run.branch(f"b{k}", kinds=scene.events) for k, run in enumerate(runs, start=1)]


def stretches(branch: Branch, frame: Frame) -> list[Stretch]:
    """Return where a branch is stable.

    Parameters
    ----------
    branch : Branch
    frame : Frame
        In which heights are counted.
    """
    entries = {entry.id: entry for entry in branch.events}
    found = []
    for interval in stable_intervals(branch):
        values = (interval.low, interval.high)
        ends = [(frame.height(v), b) for v, b in zip(values, interval.bounds, strict=True)]
        (low, name), (high, above) = sorted(ends, key=lambda end: end[0])
        entry = entries.get(name or "")
        orbit = StableOrbit(
            branch.word,
            branch.period,
            branch.notation,
            _end(entry, name),
            entry.kind if entry else None,
            entry.criticality if entry else None,
        )
        found.append(Stretch(low, high, orbit, branch, (entry, entries.get(above or ""))))
    return found


def once(found: Sequence[Stretch]) -> list[Stretch]:
    """Return stretches each once, of branches that were followed twice: they end in one orbit."""
    kept: list[Stretch] = []
    for one in found:
        if not any(_same(one, other) for other in kept):
            kept.append(one)
    return kept


def _same(one: Stretch, other: Stretch) -> bool:
    if max(abs(one.low - other.low), abs(one.high - other.high)) > SAME_ORBIT:
        return False
    pairs = zip(one.events, other.events, strict=True)
    return any(a and b and np.allclose(_impacts(a), _impacts(b), atol=SAME_ORBIT) for a, b in pairs)


def _impacts(entry: Entry) -> list[float]:
    """The velocities of an orbit at its impacts, wall after wall."""
    impacts = [(impact["wall"], impact["velocity"]) for impact in entry.impacts]
    return [velocity for _, velocity in sorted(impacts)]


def _end(entry: Entry | None, name: str | None) -> str | None:
    """Why an orbit ends: an entry's label, or the reason of the branch's end; None at a side."""
    if entry is not None:
        return entry.label
    return None if name == EndKind.RANGE.name.lower() else name or "status changes"
