"""Where a walk is, the steps from there, and what they make: the seam to the backends."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..arrays import LISTS, Containers
from . import step
from .branch import Block, Point
from .corrector import failure
from .problem import Array, Problem
from .refusal import Refusal, Refused
from .settings import Settings
from .step import HEAD, StepVectors
from .step_control import LARGEST_DEFECT


class Notice(enum.IntFlag):
    """Why a step is for the walker to judge; see `contimpact.continuation.step.BEYOND`."""

    BEYOND = step.BEYOND
    FLIPS = step.FLIPS
    DIPS = step.DIPS
    NEAR_START = step.NEAR_START


@dataclass(frozen=True, eq=False)
class Position:
    """Where a walk is, and the numerics of the steps from there.

    Attributes
    ----------
    here, behind : Point
        The point reached, and the one before; None where that does not count.
    first : float
        The parameter at the start of the walk.
    points : int
        How many there are.
    step : float
        Length of the step to try.
    scale : ndarray of shape (n + 1,)
    limits : (low, high)
    same : float
        What counts as the same solution.
    settings : Settings
    by_defect : bool
        Whether to look at the steps' defects.
    meetings : bool
        Whether to look out for branches that meet this one.
    """

    here: Point
    behind: Point | None
    first: float
    points: int
    step: float
    scale: Array
    limits: tuple[float, float]
    same: float
    settings: Settings
    by_defect: bool
    meetings: bool

    def options(self) -> list[float]:
        """Return the vector `options` of `take_steps`."""
        given = self.settings
        largest = LARGEST_DEFECT * given.max_angle if self.by_defect else math.inf
        steps = given.min_step, given.max_step, given.max_angle, largest
        asked = float(given.predictor == "secant"), float(self.meetings)
        newton = given.tolerance, given.max_iterations
        return [*newton, *steps, *self.limits, self.first, self.same, *asked]

    def state(self) -> list[float]:
        """Return the vector `state` of `take_steps`."""
        before = (math.nan, math.nan)
        if self.behind is not None:
            before = self.behind.arclength, self.behind.orientation
        state = [0.0] * step.PLACES
        state[step.STEP], state[step.POINTS] = self.step, float(self.points)
        state[step.ARCLENGTH], state[step.ORIENTATION] = self.here.arclength, self.here.orientation
        state[step.BEHIND], state[step.EARLIER] = before
        return state

    def chord(self) -> Array:
        """Return the way from the point before."""
        if self.behind is None:
            return np.zeros(len(self.scale))
        return self.here.unknowns - self.behind.unknowns

    def vectors(self, recorded: int, most: int, made_by: Containers = LISTS) -> StepVectors:
        """Return the vectors with which `take_steps` makes at most so many points.

        `recorded` is how many numbers ``observe`` records of each.
        """
        vector, table = made_by
        n = len(self.scale)
        return StepVectors(
            vector(self.options()),
            vector(self.state()),
            vector(self.scale),
            vector(self.here.unknowns),
            vector(self.here.tangent),
            vector(self.chord()),
            work=table(4, n),
            rows=table(most, 2 * n + HEAD + recorded),
        )


@dataclass(frozen=True, eq=False)
class Proposal:
    """A step for the walker to judge.

    Attributes
    ----------
    piece : Point or Block
        The point reached; a block has no other.
    notices : Notice
    next_step : float
        The length to go on with if it is accepted.
    """

    piece: Point | Block
    notices: Notice
    next_step: float

    @property
    def point(self) -> Point:
        """The point reached."""
        return self.piece if isinstance(self.piece, Point) else self.piece.point(0)


@dataclass(frozen=True, eq=False)
class Batch:
    """What steps have made.

    Attributes
    ----------
    piece : Point or Block or None
        The points accepted, if there are any.
    step : float
        Length of the step to try next; of the one proposed or refused, where there is one.
    iterations, rejected : int
    proposal : Proposal or None
        The step after them, if it is for the walker to judge.
    refused : Refused or None
        Why the step after them was refused, however short.
    """

    piece: Point | Block | None
    step: float
    iterations: int
    rejected: int
    proposal: Proposal | None = None
    refused: Refused | None = None

    @property
    def routine(self) -> bool:
        """Whether the step after them is yet to be tried."""
        return self.proposal is None and self.refused is None


class Backend(Protocol):
    """A problem in the form in which steps are taken: on which linear algebra, how many at once."""

    def advance(self, position: Position, most: int) -> Batch:
        """Take steps until one is proposed or refused, but `most` of them, or fewer."""


def batch_of(
    position: Position,
    problem: Problem,
    vectors: StepVectors,
    made: int,
    piece: Callable[[Array], Point | Block],
) -> Batch:
    """Return what `take_steps` has made: so many points, and perhaps a proposal.

    `piece` makes the points of some rows.
    """
    state, notices = vectors.state, Notice(int(vectors.state[step.NOTICE]))
    rows = np.asarray(vectors.rows[: made + 1 if notices else made])
    accepted, proposal = piece(rows[:made]) if made else None, None
    if notices:
        proposal = Proposal(piece(rows[made:]), notices, float(state[step.NEXT_STEP]))
    counts = int(state[step.ITERATIONS]), int(state[step.REJECTED])
    refused = refusal(position, state, problem, vectors.work[1])
    return Batch(accepted, float(state[step.STEP]), *counts, proposal, refused)


def columns(rows: Array, n: int) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Return the columns of `take_steps`' rows in arrays of their own.

    Unknowns, tangents, orientations, arclengths, iterations, and what ``observe`` recorded.
    """
    mark = 2 * n
    sign, place, tries = (column.copy() for column in rows[:, mark : mark + HEAD].T)
    points, recorded = (rows[:, :n].copy(), rows[:, n:mark].copy()), rows[:, mark + HEAD :].copy()
    return *points, sign, place, tries, recorded


def refusal(
    position: Position, state: Sequence[float], problem: Problem, z: Sequence[float]
) -> Refused | None:
    """Return why `take_steps` accepted no further point, having last tried z.

    None where it did, or proposes one.
    """
    status = int(state[step.STATUS])
    if status == step.CONVERGED:
        return None
    if status < step.NO_TANGENT:
        return failure(status, problem, list(z), position.settings.max_iterations)
    cause, detail = {
        step.NO_TANGENT: (Refusal.NO_TANGENT, None),
        step.TURNS: (Refusal.TURNS, state[step.TURNED]),
        step.BENDS: (Refusal.BENDS, state[step.DEFECT]),
        step.LEAVES: (Refusal.LEAVES, None),
    }[status]
    return Refused(cause, detail)
