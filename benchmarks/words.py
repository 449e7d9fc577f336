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

POINTS = {2: 60, 4: 60, 10: 60, 40: 60, 200: 15}
WALKS = {2: 3, 4: 3, 10: 3, 40: 3, 200: 1}
"""Walks in one round, of which the median counts, after one that does not."""

STEP = 0.005
UP_TO = (40, 200)


def contestants(workspace: Workspace) -> list[Contestant]:
    """Return those of this subject."""
    return [Contestant(f"words, {mode}", lambda m=mode: _measure(workspace, m)) for mode in MODES]


def _measure(workspace: Workspace, mode: str) -> list[Sample]:
    return [
        Sample("words", row(mode, impacts), workspace.call("words.stretch", impacts, mode=mode), n)
        for impacts, n in POINTS.items()
    ]


def row(mode: str, impacts: int) -> str:
    """Return the name of a row."""
    return f"contimpact {mode}, N = {impacts}"


def exponents(measured: Measured) -> dict[str, list[float]]:
    """Return the slopes of log(time) over log(N), one for each round."""
    rows = measured["words"]
    return {
        f"contimpact {mode}, N = 2 to {last}": _slopes(rows, mode, [n for n in POINTS if n <= last])
        for mode in MODES
        for last in UP_TO
    }


def _slopes(rows: dict[str, list[Sample]], mode: str, lengths: list[int]) -> list[float]:
    costs = [[s.seconds / s.count for s in rows[row(mode, n)]] for n in lengths]
    logarithms = np.log(lengths)
    return [float(np.polyfit(logarithms, np.log(r), 1)[0]) for r in zip(*costs, strict=True)]


# In the child.


def stretch(impacts: int) -> float:
    """Time walks over a short stretch of the branch, all events on."""
    equations, unknowns = problem(impacts // 2), start(impacts // 2)
    settings = replace(
        STEPS["fixed"], step=STEP, max_step=STEP, max_points=POINTS[impacts]
    )  # fmt: skip

    def once() -> int:
        return len(follow(equations, unknowns, settings, ALL).points)

    if once() != POINTS[impacts]:
        raise RuntimeError(f"the branch of {impacts} impacts ended early")
    return statistics.median(seconds_of(once)[0] for _ in range(WALKS[impacts]))
