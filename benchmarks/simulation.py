"""Impacts per second of the simulation, on three kinds of motion of the impact pair."""

from __future__ import annotations

import math

from contestant import MODES, Contestant, Sample, Workspace, seconds_of

from contimpact import ImpactPair
from contimpact.simulation.run import State
from contimpact.simulation.simulator import Simulator

MOTIONS = {
    "1:1, periodic": {"A": 5.0, "s": 0.389},
    "2:1, periodic": {"A": 5.0, "s": 0.3},
    "1:1/C, complex": {"A": 5.0, "s": 0.3631},
}
IMPACTS = {"plain": 100_000, "compiled": 1_000_000}
WARMING = 1000


def contestants(workspace: Workspace) -> list[Contestant]:
    """Return those of this subject."""
    return [
        Contestant(f"simulation, {mode}", lambda m=mode: _measure(workspace, m)) for mode in MODES
    ]


def _measure(workspace: Workspace, mode: str) -> list[Sample]:
    rates = workspace.call("simulation.seconds", IMPACTS[mode], mode=mode)
    return [Sample("simulation", row(mode, motion), t, n) for motion, t, n in rates]


def row(mode: str, motion: str) -> str:
    """Return the name of a row."""
    return f"contimpact {mode}, {motion}"


# In the child.


def seconds(impacts: int) -> list[tuple[str, float, int]]:
    """Time a run of every motion; the rows are kept."""
    times = []
    for motion, values in MOTIONS.items():
        simulator = Simulator(ImpactPair(beta=math.pi / 6, r=0.3, **values))
        start = State(wall=0, phase=0.14, velocity=0.686)
        simulator.run(start, impacts=WARMING)
        took, run = seconds_of(lambda s=simulator, b=start: s.run(b, impacts=impacts))
        times.append((motion, took, len(run)))
    return times
