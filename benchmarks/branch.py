"""contimpact on the branch: the walk alone, and a whole process from import to file."""

from __future__ import annotations

import statistics
from pathlib import Path

from case import ALL, STEPS, follow, problem, start
from contestant import MODES, Contestant, Sample, Workspace, seconds_of

EVENTS = {"all events": ALL, "FB and BP, as AUTO": ("FB", "BP"), "no events": ()}
WALKS = {"fixed": 3, "adaptive": 21}
"""Walks in one round, of which the median counts."""


def contestants(workspace: Workspace) -> list[Contestant]:
    """Return those of this subject."""
    return [
        Contestant(f"contimpact {mode}, {kind}", lambda m=mode, f=measure: f(workspace, m))
        for mode in MODES
        for kind, measure in (("walk", _walk), ("process", _process))
    ]


def first_runs(workspace: Workspace) -> dict[str, float]:
    """Return the processor times of the first process, which generates kernels and compiles."""
    return {
        f"contimpact {mode}": workspace.timed("follow_once.py", "fixed", "b.first", mode=mode)
        for mode in MODES
    }


def _walk(workspace: Workspace, mode: str) -> list[Sample]:
    return [
        Sample(steps, f"contimpact {mode}, walk, {events}", seconds, points)
        for steps, events, seconds, points in workspace.call("branch.walks", mode=mode)
    ]


def _process(workspace: Workspace, mode: str) -> list[Sample]:
    samples = []
    for steps in STEPS:
        seconds = workspace.timed("follow_once.py", steps, f"b.{steps}", mode=mode)
        points = workspace.call("branch.points_in", f"b.{steps}")
        samples.append(Sample(steps, f"contimpact {mode}, process", seconds, points))
    return samples


# In the child.


def walks() -> list[tuple[str, str, float, int]]:
    """Time walks along the branch; the first one of each kind is left out."""
    return [(steps, events, *_timed_walks(steps, events)) for steps in STEPS for events in EVENTS]


def _timed_walks(steps: str, events: str) -> tuple[float, int]:
    equations, unknowns = problem(), start()

    def once() -> int:
        return len(follow(equations, unknowns, STEPS[steps], EVENTS[events]).points)

    points = once()
    return statistics.median(seconds_of(once)[0] for _ in range(WALKS[steps])), points


def points_in(table: str) -> int:
    """Count the points of the walk in an AUTO file: ordinary ones (type 0) and ends (9)."""
    rows = Path(table).read_text(encoding="utf-8").splitlines()[1:]
    return sum(row.split()[2] in ("0", "9") for row in rows)
