"""Which attractor each of a grid of starts leads to."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..results.simulate_tables import SETTLING, Settling
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
    others : tuple of float
        The other section coordinates, the same for all starts: with several degrees of freedom the
        picture is a section through the basins.
    """

    wall: str
    wall_number: int
    parameters: dict[str, float]
    phases: Array
    velocities: Array
    labels: Array
    attractors: list[Attractor]
    others: tuple[float, ...] = ()

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

    Notes
    -----
    With several degrees of freedom all starts have the other coordinates of the fastest impact on
    that wall that the attractors known have, or zero.
    """
    letter = wall or simulator.letters[0]
    side = simulator.sides[simulator.letters.index(letter)]
    largest = fastest or _fastest(simulator, known)
    m, n = shape
    velocities = side * largest * (np.arange(m) + 0.5) / m
    phases = simulator.period * (np.arange(n) + 0.5) / n
    found = list(known)
    labels = np.zeros(shape, dtype=int)
    others = _others(simulator, letter, known)
    for i, velocity in enumerate(velocities.tolist()):
        for j, phase in enumerate(phases.tolist()):
            state = simulator.state(letter, phase, velocity, others)
            labels[i, j] = _reached(simulator, state, found, settling)
        if callback:
            callback((i + 1) * n, m * n)
    parameters = {**simulator.model.values, **simulator.derived}
    number = simulator.letters.index(letter)
    return Basins(letter, number, parameters, phases, velocities, labels, found, others)


def _others(simulator: Simulator, wall: str, known: Sequence[Attractor]) -> tuple[float, ...]:
    """The other section coordinates of all starts: those of the fastest known impact there."""
    number = simulator.letters.index(wall)
    impacts = [
        (abs(float(speed)), tuple(row))
        for a in known
        for speed, row, k, released in zip(
            a.velocities, a.others.tolist(), a.walls, a.released, strict=False
        )
        if k == number and not released
    ]
    none = (0.0,) * (simulator.model.unknowns_per_impact - 2)
    return max(impacts, default=(0.0, none))[1]


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
    if attractor.held.size:
        return _on_several(attractor, run)
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


def _on_several(attractor: Attractor, run: Run) -> bool:
    """The same where there are several coordinates, by all of them."""
    if attractor.period is None or run.end is None:
        return False
    mine = np.column_stack([attractor.times, attractor.velocities, attractor.others])
    sizes = np.maximum(np.max(np.abs(mine), axis=0), 1e-300)
    sizes[0] = attractor.forcing_period
    apart = (mine - (run.end.phase, *run.end.section)) / sizes
    apart[:, 0] -= np.round(apart[:, 0])
    same_kind = (attractor.walls == run.end.wall) & (attractor.held == run.end.held)
    return bool(np.min(np.max(np.abs(apart), axis=1)[same_kind], initial=math.inf) < REACHED)
