"""Which attractor each of a grid of starts leads to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..scenes.simulate_tables import SETTLING, Settling
from ..simulation.run import Outcome, Run, State
from ..simulation.simulator import Simulator
from .attractor import Attractor, Kind
from .sweep import same
from .verdict import settle

REACHED = 1e-5
"""A motion this near to a known periodic attractor, round after round, has reached it."""


@dataclass(frozen=True, eq=False)
class Basins:
    """Basins of attraction among impacts on one wall.

    Attributes
    ----------
    wall : str
    wall_number : int
    parameters : dict
        All parameters and derived parameters.
    phases : ndarray of shape (n,)
        Times of the first impact.
    velocities : ndarray of shape (m,)
        Velocities before it.
    labels : ndarray of int, shape (m, n)
        Number of the attractor reached.
    attractors : list of Attractor
    """

    wall: str
    wall_number: int
    parameters: dict[str, float]
    phases: Array
    velocities: Array
    labels: Array
    attractors: list[Attractor]

    @property
    def shares(self) -> list[float]:
        """The part of the starts that leads to each attractor."""
        counts = np.bincount(self.labels.ravel(), minlength=len(self.attractors))
        return [float(count / self.labels.size) for count in counts]


def basins(
    simulator: Simulator,
    *,
    wall: str | None = None,
    shape: tuple[int, int] = (40, 40),
    fastest: float | None = None,
    settling: Settling = SETTLING,
    known: Sequence[Attractor] = (),
    callback: Callable[[int, int], None] | None = None,
) -> Basins:
    """Find the attractor each of a grid of starts leads to.

    Parameters
    ----------
    simulator : Simulator
    wall : str, optional
        Wall of the first impact; the model's first one by default.
    shape : (m, n)
        Velocities and phases of the grid, each at the middle of its cell.
    fastest : float, optional
        Largest velocity; by default twice the largest of the attractors known, or what a period of
        the largest acceleration gives.
    settling : Settling
    known : sequence of Attractor
        Attractors at these parameter values found before.
    callback : callable, optional
        Called with starts done and their number.

    Returns
    -------
    Basins
    """
    letter = wall or simulator.letters[0]
    side = simulator.sides[simulator.letters.index(letter)]
    largest = fastest or _fastest(simulator, known)
    m, n = shape
    velocities = side * largest * (np.arange(m) + 0.5) / m
    phases = simulator.period * (np.arange(n) + 0.5) / n
    found = list(known)
    labels = np.zeros(shape, dtype=int)
    for i, velocity in enumerate(velocities.tolist()):
        for j, phase in enumerate(phases.tolist()):
            state = simulator.state(letter, phase, velocity)
            labels[i, j] = _reached(simulator, state, found, settling)
        if callback:
            callback((i + 1) * n, m * n)
    parameters = {**simulator.model.values, **simulator.derived}
    return Basins(
        letter, simulator.letters.index(letter), parameters, phases, velocities, labels, found
    )


def _fastest(simulator: Simulator, known: Sequence[Attractor]) -> float:
    speeds = [float(np.max(np.abs(a.velocities), initial=0.0)) for a in known]
    return 2.0 * max(speeds, default=0.0) or simulator.fastest


def _reached(simulator: Simulator, state: State, found: list[Attractor], settling: Settling) -> int:
    """The number of the attractor a start leads to; a new one is added to the list.

    Where complex motion is among the attractors, a start that has not settled after a tenth of the
    periods of `settling` is taken for it.
    """
    for _ in range(max(settling.transient // 10, 1)):
        run = simulator.run(state, periods=10)
        if run.outcome is not Outcome.DONE or run.end is None:
            break
        state = run.end
        for number, attractor in enumerate(found):
            if _on(attractor, run):
                return number
    kinds = [attractor.kind for attractor in found]
    if Kind.COMPLEX in kinds:
        quick = replace(settling, transient=0, periods=settling.periods // 10, impacts=200)
        attractor = settle(simulator, state, quick)
        if attractor.kind in (Kind.COMPLEX, Kind.NOT_SETTLED):
            return kinds.index(Kind.COMPLEX)
    else:
        attractor = settle(simulator, state, settling)
    for number, other in enumerate(found):
        if same(attractor, other):
            return number
    found.append(attractor)
    return len(found) - 1


def _on(attractor: Attractor, run: Run) -> bool:
    """Whether a run ends on a periodic attractor, closely, or is released as a sticking one is."""
    if attractor.kind is Kind.STICKING:
        rows = np.nonzero(run.released)[0][-1:]
        mine = attractor.times[attractor.released] % attractor.forcing_period
        walls = attractor.walls[attractor.released]
        return any(
            bool(np.any((walls == run.walls[row]) & (abs(mine - run.phases[row]) < REACHED)))
            for row in rows
        )
    state = run.end
    if attractor.kind is not Kind.PERIODIC or state is None:
        return False
    phases = (attractor.times - state.phase) / attractor.forcing_period
    apart = np.maximum(
        np.abs(phases - np.round(phases)), np.abs(attractor.velocities - state.velocity)
    )
    return float(np.min(apart[attractor.walls == state.wall], initial=math.inf)) < REACHED
