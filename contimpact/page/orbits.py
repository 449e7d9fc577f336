"""Orbits as a page draws them without Python: states along each flight, and cubics between them.

Each flight has displacement and velocity of every coordinate at so many equal steps of its duration
that the cubics which take both on are right to `FLAT` of what they span.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from ..models.guards import orders_of
from ..models.model import Model
from ..segments.arithmetic import ARRAYS, evaluate_in
from ..segments.kernels import Kernels
from .sweeps import pack_column

FLAT = 5e-4
"""Error of a drawn flight, by the size of the picture."""
FEWEST, MOST = 4, 512
"""Steps of a flight."""
BUDGET = 400_000
"""States that a page holds at most, about."""
GUESS = 10
"""States of a flight, for that."""
SMALL, TINY = 1e-6, float(np.finfo(float).tiny)
"""Part of its distance from the origin below which a flight need not be resolved; never zero."""

Moved = Callable[[Array], tuple[Array, Array]]
"""Map from fractions of a flight to displacements and velocities, of orbits, coordinates,
fractions."""


@dataclass(frozen=True)
class Orbits:
    """Orbits of one word at different parameter values."""

    word: str
    """A wall for each impact."""
    period: int
    """Period in forcing periods."""
    parameters: Mapping[str, Array]
    """Parameters of the model, shape (n,)."""
    impacts: Array
    """Times and section coordinates before impact, shape (n, N, m)."""
    periods: Array | None = None
    """Periods of the orbits, where they are free, and shown as one forcing period, shape (n,)."""

    def at(self, rows: Array) -> Orbits:
        """Return some of the orbits."""
        chosen = {name: values[rows] for name, values in self.parameters.items()}
        return Orbits(self.word, self.period, chosen, self.impacts[rows])


def stride(impacts: Sequence[tuple[int, int]], coordinates: int = 1) -> int:
    """Return of how many orbits one is kept, given the numbers of orbits and of their impacts."""
    states = GUESS * coordinates * sum(orbits * each for orbits, each in impacts)
    return max(1, -(-states // BUDGET))


class Tracks:
    """Makes tracks of one model's orbits; only its formulas matter, not its values."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.kernels = Kernels(model, next(iter(model.values)))
        self.size = model.DEGREES_OF_FREEDOM
        rows = {wall.name: np.array(wall.row(self.size), dtype=float) for wall in model.WALLS}
        self.alone = all(row.tolist() == [1.0] for row in rows.values())
        """Whether the gap coordinate of every wall is the only coordinate there is."""
        self.hits = {name: np.nonzero(row)[0].tolist() for name, row in rows.items()}
        """The coordinates that a wall's gap coordinate is made of."""
        self.factors = {name: row[row != 0.0] for name, row in rows.items()}

    def clock_and_walls(self, orbits: Orbits) -> tuple[Array, dict[str, Array]]:
        """Return period and positions of the walls, a value for each orbit.

        Of a wall on a combination of coordinates it is the combination's.
        """
        setup = evaluate_in(self.kernels.setup, ARRAYS)(*self._values(orbits))
        each = np.zeros(len(orbits.impacts))
        walls = zip(self.model.WALLS, setup.walls, strict=True)
        period = setup.period if orbits.periods is None else orbits.periods
        places = {wall.name: each + place for wall, place in walls}
        for name, factors in self.factors.items():
            places[name] /= factors[0] if len(factors) == 1 else 1.0
        return each + period, places

    def record(self, orbits: Orbits, rows: Array) -> dict[str, Any]:
        """Return the tracks of some orbits, and the walls and forcing periods of all, packed."""
        periods, walls = self.clock_and_walls(orbits)
        shown, clock = orbits.at(rows), periods[rows]
        flights = [self._flight(shown, clock, walls, rows, k) for k in range(len(orbits.word))]
        states = (
            np.concatenate(flights, axis=1) if flights else np.zeros((len(rows), 0, 2 * self.size))
        )
        return {
            "period": pack_column(periods),
            "walls": {name: pack_column(places) for name, places in walls.items()},
            "hits": self.hits,
            "coordinates": list(self.model.coordinates),
            "rows": pack_column(rows, "u4") if len(rows) < len(orbits.impacts) else None,
            "nodes": [flight.shape[1] for flight in flights],
            "states": pack_column(states, "f4"),
        }

    def _values(self, orbits: Orbits) -> list[Array]:
        return [orbits.parameters[name] for name in self.model.values]

    def _flight(
        self, orbits: Orbits, clock: Array, walls: Mapping[str, Array], rows: Array, number: int
    ) -> Array:
        """Position and velocity of each coordinate in turn, along one flight of each orbit, shape
        (n, nodes, 2 * coordinates); not numbers where the flight's mode does not have it."""
        wall = orbits.word[number]
        leave, following = orbits.impacts[:, number], (number + 1) % len(orbits.word)
        arrive = orbits.impacts[:, following, 0]
        length = arrive - leave[:, 0] + (0.0 if following else orbits.period * clock)
        kernel = self.kernels.motion(wall) if self.alone else self.kernels.states(wall)
        motion = evaluate_in(kernel, ARRAYS)
        head, values = leave.T[..., None], [v[:, None] for v in self._values(orbits)]
        place = walls[wall][rows][:, None, None] if self.alone else 0.0

        def moved(fractions: Array) -> tuple[Array, Array]:
            found = motion(*head, length[:, None] * fractions, *values)[: 2 * self.size]
            blank = np.zeros((len(length), len(fractions)))
            states = np.stack([blank + part for part in found], axis=1)
            return place + states[:, ::2], states[:, 1::2]

        fastest = np.abs(orbits.impacts[:, :, 1]).max(axis=1) if self.alone else 0.0
        states = _fine_enough(moved, length, fastest)
        orders = orders_of(self.model.MODES, self.model.guard(wall).next_mode, self.size)
        for i, order in enumerate(orders):
            if not order:
                states[:, :, 2 * i : 2 * i + 2] = math.nan
        return states


def _fine_enough(moved: Moved, length: Array, fastest: Array | float) -> Array:
    """States at as many equal steps as their cubics need."""
    steps = FEWEST
    while True:
        x, v = moved(np.linspace(0.0, 1.0, 2 * steps + 1))
        if steps >= MOST or not _error(x, v, length / steps, fastest) > FLAT:
            pairs = np.stack([x[..., ::2], v[..., ::2]], axis=2)
            return pairs.reshape(len(x), -1, steps + 1).transpose(0, 2, 1)
        steps *= 2


def _error(x: Array, v: Array, step: Array, fastest: Array | float) -> float:
    """How far cubics on every other state are from the others, by the size of a picture."""
    h = np.where(step == 0.0, 1.0, step)[:, None, None]
    a, middle, b = x[..., :-1:2], x[..., 1::2], x[..., 2::2]
    p, speed, q = v[..., :-1:2], v[..., 1::2], v[..., 2::2]
    off = np.abs(0.5 * (a + b) + h * (p - q) / 8.0 - middle)
    slip = np.abs(1.5 * (b - a) / h - 0.25 * (p + q) - speed)
    tall = np.ptp(x, axis=2) + SMALL * np.abs(x).max(axis=2)
    wide = np.maximum(np.reshape(fastest, (-1, 1)), np.abs(v).max(axis=2))
    parts = (off / (tall + TINY)[..., None], slip / (wide + TINY)[..., None])
    return max(float(np.max(part[step != 0.0], initial=0.0)) for part in parts)
