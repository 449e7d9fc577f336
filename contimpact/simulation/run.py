"""What a simulation returns: states at a wall, the rows of a run, and why it ended."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Array
from .body import wrapped


class Outcome(enum.Enum):
    """Why a run ended; the value is a sentence."""

    DONE = "made as many impacts, or ran as many periods, as it was asked to"
    RESTING = "the body rests on a wall, which the acceleration never leaves"
    NO_IMPACT = "the body flew on without an impact for as long as a flight may last"


@dataclass(frozen=True)
class State:
    """The body at a wall just before an impact, or at rest there if the velocity is zero.

    Attributes
    ----------
    wall : int
        Number of the wall, in the model's order.
    phase : float
        Time in [0, T).
    velocity : float
        Before the impact, towards the wall.
    turns : int
        Whole periods passed.
    """

    wall: int
    phase: float
    velocity: float
    turns: int = 0

    def within(self, period: float) -> State:
        """Return the same with a phase in [0, T) and as many more turns as it had."""
        phase, passed = wrapped(self.phase, period)
        return State(self.wall, phase, self.velocity, self.turns + passed)


@dataclass(frozen=True, eq=False)
class Run:
    """The result of a simulation, a row per impact or release.

    Attributes
    ----------
    letters : tuple of str
        Names of the walls.
    period : float
        Forcing period T.
    walls : ndarray of int, shape (N,)
        Number of the wall hit.
    turns : ndarray of int, shape (N,)
    phases : ndarray of float, shape (N,)
        Time of each row is turns*T + phase.
    velocities : ndarray of float, shape (N,)
        Before impact; zero for a release.
    released : ndarray of bool, shape (N,)
        Whether the row is a release: the body, at rest on the wall since shortly after the row
        before, is left by it.
    outcome : Outcome
    end : State or None
        Where a further run can start; None if there is no such state.
    """

    letters: tuple[str, ...]
    period: float
    walls: Array
    turns: Array
    phases: Array
    velocities: Array
    released: Array
    outcome: Outcome
    end: State | None

    def __len__(self) -> int:
        return len(self.walls)

    @property
    def times(self) -> Array:
        """Times of the rows, from the start of the first one's period."""
        first = self.turns[0] if len(self) else 0
        return (self.turns - first) * self.period + self.phases

    @property
    def word(self) -> str:
        """The walls met; a release is written ``*``."""
        names = [*self.letters, "*"]
        marked = np.where(self.released, len(self.letters), self.walls)
        return "".join(names[i] for i in marked)


def joined(parts: Sequence[Sequence[Any]]) -> tuple[Array, Array, Array, Array, Array]:
    """Return the columns of a run, walls to releases, from those of its parts."""

    def column(i: int, kind: Any) -> Array:
        return np.concatenate([np.zeros(0, kind), *(np.asarray(part[i], kind) for part in parts)])

    walls, turns, released = column(0, np.int8), column(1, np.int64), column(4, bool)
    return walls, turns, column(2, float), column(3, float), released
