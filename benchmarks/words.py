"""Words of N impacts: the cost of a point against N.

The words are the 1:1 orbit run N/2 times, between d = 0.45 and 0.34: the branch is the same, the
equations are N flights, and their Jacobian is regular.
"""

from __future__ import annotations

import statistics
from dataclasses import replace

import numpy as np
from case import ALL, STEPS, follow, problem, start
from contestant import MODES, Contestant, Measured, Sample, Workspace, seconds_of

LENGTHS = (2, 4, 10, 40, 200)
POINTS = 60
WALKS = 3
"""Walks in one round, of which the median counts, after one that does not."""

STEP = 0.005
UP_TO = (40, 200)
PARTS = ("all points", "further points", "first point")
"""What is timed; the first point is corrected and its tangent is found without one before it."""


def contestants(workspace: Workspace) -> list[Contestant]:
    """Return those of this subject."""
    return [Contestant(f"words, {mode}", lambda m=mode: _measure(workspace, m)) for mode in MODES]


def _measure(workspace: Workspace, mode: str) -> list[Sample]:
    samples = []
    for impacts in LENGTHS:
        whole = workspace.call("words.stretch", impacts, POINTS, mode=mode)
        first = workspace.call("words.stretch", impacts, 1, mode=mode)
        for part, seconds, n in zip(
            PARTS, (whole, whole - first, first), (POINTS, POINTS - 1, 1), strict=True
        ):
            samples.append(Sample("words", row(mode, impacts, part), seconds, n))
    return samples


def row(mode: str, impacts: int, part: str) -> str:
    """Return the name of a row."""
    return f"contimpact {mode}, N = {impacts}, {part}"


def exponents(measured: Measured) -> dict[str, list[float]]:
    """Return the slopes of log(time) over log(N), one for each round."""
    return {
        f"contimpact {mode}, N = 2 to {last}, {part}": _slopes(measured["words"], mode, part, last)
        for mode in MODES
        for part in PARTS[:2]
        for last in UP_TO
    }


def _slopes(rows: dict[str, list[Sample]], mode: str, part: str, last: int) -> list[float]:
    lengths = [n for n in LENGTHS if n <= last]
    costs = [[s.seconds / s.count for s in rows[row(mode, n, part)]] for n in lengths]
    rounds = np.log(np.transpose(costs))
    return [float(np.polyfit(np.log(lengths), costs, 1)[0]) for costs in rounds]


# In the child.


def stretch(impacts: int, points: int) -> float:
    """Time walks over a short stretch of the branch, all events on."""
    equations, unknowns = problem(impacts // 2), start(impacts // 2)
    settings = replace(STEPS["fixed"], step=STEP, max_step=STEP, max_points=points)

    def once() -> int:
        return len(follow(equations, unknowns, settings, ALL).points)

    if once() != points:
        raise RuntimeError(f"the branch of {impacts} impacts ended early")
    return statistics.median(seconds_of(once)[0] for _ in range(WALKS))
