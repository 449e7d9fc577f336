"""Whether all contestants followed the same branch, and contimpact found its events."""

from __future__ import annotations

import json
from typing import NamedTuple

import auto07p
import numpy as np
from case import D_PER_S, EXPECTED, STEPS, follow, problem, start
from contestant import MODES, Workspace

from contimpact.orbits.search import solve_near

EVENT_ERROR = 1e-12
"""Of d at an event; the expected values have twelve digits."""

CURVE_ERROR = 1e-9
"""Of times and velocities at one s; AUTO prints eleven digits."""

AUTO_ENDS = (9, -4)
"""Types of points that AUTO may report: an end and a requested value."""


class Check(NamedTuple):
    """Something that has to hold, and a difference that says how well it does."""

    what: str
    found: str
    holds: bool


def checks(workspace: Workspace, subjects: list[str]) -> list[Check]:
    """Compare what the contestants of some subjects computed."""
    found = []
    if "branch" in subjects:
        found += [c for mode in MODES for c in _events(workspace, mode)]
    if "auto" in subjects:
        found += [c for steps in auto07p.STEPS for c in _auto(workspace, steps)]
    if "natural" in subjects:
        points = workspace.call("natural.follow")
        found += _on_curve(workspace, "scipy.optimize.root, natural", points)
    return found


def _events(workspace: Workspace, mode: str) -> list[Check]:
    found = []
    for steps in STEPS:
        events = workspace.call("agreement.events", steps, mode=mode)
        text = ", ".join(f"{kind} at d = {d:.12f}" for kind, d in events)
        expected = [kind for kind, _ in events] == list(EXPECTED) and all(
            abs(d - EXPECTED[kind]) < EVENT_ERROR for kind, d in events
        )
        found.append(Check(f"contimpact {mode}, {steps}: events", text, expected))
    points = workspace.call("agreement.points", "fixed", mode=mode)
    return found + _on_curve(workspace, f"contimpact {mode}, fixed", points)


def _auto(workspace: Workspace, steps: str) -> list[Check]:
    run = auto07p.Auto(workspace.folder, steps, auto07p.LEVELS[0])
    kinds = run.reported()
    right = len(kinds) == 2 and set(kinds) <= set(AUTO_ENDS)
    text = "none but its two ends" if right else f"types {kinds}"
    name = f"AUTO, {steps}"
    return [
        Check(f"{name}: special points", text, right),
        *_on_curve(workspace, name, run.points()),
    ]


def _on_curve(workspace: Workspace, name: str, points: list[list[float]]) -> list[Check]:
    (workspace.folder / "points.json").write_text(json.dumps(points))
    apart = workspace.call("agreement.apart", "points.json")
    missed = abs(points[-1][-1] * D_PER_S - 0.05)
    text = f"{apart[-1]:.1e} at the end, {max(apart):.1e} at most on {len(apart)} points"
    return [
        Check(f"{name}: distance from the orbits at the same s", text, max(apart) < CURVE_ERROR),
        Check(f"{name}: d at the end less 0.05", f"{missed:.1e}", missed < CURVE_ERROR),
    ]


# In the child.


def events(steps: str) -> list[tuple[str, float]]:
    """Return the events of the branch, with d."""
    walked = follow(problem(), start(), STEPS[steps])
    return [(event.kind, event.parameter * D_PER_S) for event in walked.events]


def points(steps: str) -> list[list[float]]:
    """Return the points of the branch."""
    return [p.unknowns.tolist() for p in follow(problem(), start(), STEPS[steps]).points]


def apart(file: str) -> list[float]:
    """Return how far points are from the orbits that Newton's method reaches at their s."""
    equations, distances = problem(), []
    with open(file) as stored:
        for unknowns in np.array(json.load(stored)):
            orbit = solve_near(equations, unknowns)
            if orbit is None:
                return [*distances, float("inf")]
            distances.append(float(np.max(np.abs(orbit.unknowns - unknowns))))
    return distances
