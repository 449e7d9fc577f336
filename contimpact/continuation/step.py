"""A step of pseudo-arclength continuation, its control, and batches of steps.

Every step of a walk is taken here, for any problem, one or many at a time. Written in the plain
subset of Python that `contimpact.compiling` compiles: vectors are lists where it runs plainly,
arrays where it runs compiled. A step that leads out of the range or perhaps to another branch, or
that may close a loop, is proposed to the walker, which decides.
"""

from __future__ import annotations

import enum
import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeAlias

import numpy as np

from ..arrays import LISTS, Array, Containers, Table, Vector
from .branch import Block, Point, Problem, Refusal, RefusalDetails
from .corrector import (
    CONVERGED,
    D,
    DenseSystem,
    Evaluate,
    Solve,
    angle,
    cubic,
    distance,
    failure,
    newton,
    predict,
)
from .settings import Settings
from .sign_changes import look_plainly

# Step control: how well a step resolves the branch, and how long the next one is.
#
# Written in the plain subset of Python that `contimpact.compiling` compiles.

LARGEST_DEFECT = 0.1
"""Largest defect of a step (see `defect`), as part of the largest angle."""

DIGITS = 2.0**47 + 1.0
"""Digits to which a length is rounded, six binary ones; see `round_length`."""


def defect(
    z: Vector, new: Vector, tangent: Vector, along: Vector, size: float, scale: Vector
) -> float:
    """Return by how much a step differs from what the tangents at its ends make of it.

    The distance between the chord and the mean of both unit tangents times the chord's length, as
    part of that length: the error of the trapezoidal rule. It falls with the square of the step
    where the branch is resolved, and does not where a step spans a wiggle, however well the
    tangents agree. `size` is the distance of both points.
    """
    if size == 0.0:
        return 0.0
    off = 0.0
    for i in range(len(z)):
        part = (new[i] - z[i] - 0.5 * size * (tangent[i] + along[i])) / scale[i]
        off += part * part
    return math.sqrt(off) / size


def step_after(
    step: float,
    turned: float,
    first_correction: float,
    off: float,
    max_angle: float,
    max_defect: float,
    max_step: float,
) -> float:
    """Return the length of the step after an accepted one.

    The angle between tangents grows with the step, the first correction with its square, as part
    of the step, and so does the defect `off`; the largest of them against their targets decides,
    by at most a factor of two. The targets of angle and defect are half the largest ones, that of
    the correction a twentieth of the step.
    """
    by_angle = turned / (0.5 * max_angle)
    by_distance = math.sqrt(first_correction / (0.05 * step))
    by_defect = math.sqrt(off / (0.5 * max_defect))
    factor = 1.0 / max(by_angle, by_distance, by_defect, 0.5)
    return min(step * max(factor, 0.5), max_step)


def round_length(step: float, max_step: float) -> float:
    """Return the length with a few leading digits (Veltkamp's splitting).

    How a walk rounds its points, which differs between processors, then has no part in where the
    next ones lie: it would grow from step to step.
    """
    large = DIGITS * step
    return min(large - (large - step), max_step)


def shorten_step(step: float, min_step: float) -> float:
    """Return the length to try after a step was refused."""
    return max(0.5 * step, min_step)


(
    TOLERANCE,
    ITERATIONS_AT_MOST,
    MIN_STEP,
    MAX_STEP,
    MAX_ANGLE,
    MAX_DEFECT,
    LOW,
    HIGH,
    FIRST,
    SAME,
    SECANT,
    MEETINGS,
    TASK,
) = range(13)
"""Places in `options`: of the settings, the largest defect, the range, the parameter at the start
of the walk, what counts as the same solution, whether to predict along chords and to look out for
branches that meet, and what to do."""

STEPS, FIRST_POINT, LAST_POINT = range(3)
"""What to do: take steps, or solve for one point at its own value of the parameter, the first of a
walk or one on a limit of its range; see `take_point`."""

(
    STEP,
    ARCLENGTH,
    BEHIND,
    FARTHER,
    ORIENTATION,
    EARLIER,
    EARLIEST,
    POINTS,
    NEXT_STEP,
    CORRECTION,
    TURNED,
    DEFECT,
    STATUS,
    NOTICE,
    ITERATIONS,
    REJECTED,
    EVALUATIONS,
    PLACES,
) = range(18)
"""Places in `state`. The length of the step to try; the arclength here and at the two points before
(NaN where there are none), and the orientation at the three; points so far. Of the step last tried:
the length to follow it, the first correction, the angle, and the defect. Why no further step was
accepted: a status, or a sum of notices. Three counts. Last, how many places there are."""

NO_TANGENT, TURNS, BENDS, LEAVES = range(5, 9)
"""Status codes of a step, besides those of `newton`."""

BEYOND, FLIPS, DIPS, NEAR_START = 1, 2, 4, 8
"""Notices of a step: it leads out of the range; the orientation flips, or was about to vanish and
has not; the start may lie on it."""

FEWEST_ROUND = 4.0
"""Points with which a walk may have come round."""

LITTLE = 0.25
"""Part of the orientation that is left where it is about to vanish."""

EVENLY = 0.05
"""How well one factor describes how the orientation changes along an arc, or from step to step."""

HEAD = 3
"""Numbers of a row between unknowns and tangent and what `observe` records: orientation, arclength
and iterations."""

TangentAt: TypeAlias = Callable[[D, Vector, Vector, Vector, Vector], float]
Observe: TypeAlias = Callable[[D, Vector, Vector, float, Vector, int], None]
"""Observation that `take_steps` also asks of a problem."""


class StepVectors(NamedTuple):
    """What steps go by, and what they keep up to date; `take_steps` has it as a plain tuple."""

    options: Vector
    state: Vector
    """`options`, `state`: see `TOLERANCE` and `STEP`."""
    scale: Vector
    """Natural sizes of the unknowns."""
    z: Vector
    tangent: Vector
    chord: Vector
    """`z`, `tangent`, `chord`: the point the walk is at, its unit tangent, and the way from the
    point before."""
    work: Table
    """Scratch space of four rows of n + 1 numbers."""
    rows: Table
    """A row for each point to make: unknowns, tangent, `HEAD`, and what `observe` records."""


def take_steps(
    evaluate: Evaluate[D],
    solve: Solve[D],
    tangent_at: TangentAt[D],
    observe: Observe[D],
    data: D,
    vectors: tuple[Vector, ...],
) -> int:
    """Take steps until one is proposed to the walker or refused at the smallest length.

    `evaluate` and `solve` are as in `newton`. ``tangent_at(data, z, row, scale, out)`` fills `out`
    with the null vector at the point last evaluated that continues along `row` and returns its
    orientation, NaN if there is none. ``observe(data, z, tangent, orientation, row, at)`` records
    whatever else a point is to carry in its row, from place `at` on. `vectors` are `StepVectors`,
    kept up to date.

    Returns how many points were made. If they are fewer than there are rows, a step is proposed
    where there are notices in the state, else refused; the row of a proposed step follows those of
    the points.
    """
    options, state, scale, z, tangent, _, work, rows = vectors
    if options[TASK] != STEPS:
        return take_point(evaluate, solve, tangent_at, observe, data, vectors)
    n, made = len(z), 0
    new, along = work[1], work[2]
    while made < len(rows):
        row = rows[made]
        status = attempt(evaluate, solve, tangent_at, data, vectors, row)
        if status != CONVERGED:
            state[REJECTED] += 1
            if state[STEP] <= options[MIN_STEP]:
                state[STATUS] = status
                return made
            state[STEP] = shorten_step(state[STEP], options[MIN_STEP])
            continue
        orientation, arclength = row[2 * n], row[2 * n + 1]
        for i in range(n):
            row[i], row[n + i] = new[i], along[i]
        turning = tangent[n - 1] * along[n - 1]
        found = notices(
            z[n - 1], new[n - 1], turning, orientation, arclength, scale[n - 1], options, state
        )
        if found & BEYOND == 0:
            observe(data, new, along, orientation, row, 2 * n + HEAD)
        if found != 0:
            state[NOTICE] = found
            return made
        accept(vectors, orientation, arclength)
        made += 1
    return made


SAME_TANGENT = 1e-9
"""A first tangent that moves by more where it is solved for along itself is not the only one."""

SIDEWAYS = 1e-6
"""A first tangent along which the parameter moves by less is left to other ways."""


def take_point(
    evaluate: Evaluate[D],
    solve: Solve[D],
    tangent_at: TangentAt[D],
    observe: Observe[D],
    data: D,
    vectors: tuple[Vector, ...],
) -> int:
    """Solve for a point at the parameter value of a guess, which stands in the place of the chord.

    Its tangent goes on along that of the point before. Returns how many points were made: one, or
    none.
    """
    options, state, scale, z, tangent, guess, work, rows = vectors
    n, row = len(z), rows[0]
    new, along, border, again = work[0], work[1], work[2], work[3]
    for i in range(n):
        border[i] = 0.0
    border[n - 1] = 1.0 / scale[n - 1]
    tolerance, most = options[TOLERANCE], int(options[ITERATIONS_AT_MOST])
    status, iterations, _ = newton(
        evaluate, solve, data, new, guess, border, scale, along, tolerance, most
    )
    state[STATUS] = status
    state[ITERATIONS] += iterations
    state[EVALUATIONS] += iterations + 1
    if status != CONVERGED:
        return 0
    for i in range(n):
        border[i] = tangent[i] / scale[i] / scale[i]
    orientation = tangent_at(data, new, border, scale, along)
    travelled = distance(new, z, scale)
    if options[TASK] == FIRST_POINT:
        for i in range(n):
            border[i] = along[i] / scale[i] / scale[i]
        orientation = tangent_at(data, new, border, scale, again)
        apart, travelled = distance(along, again, scale), 0.0
        if not (apart < SAME_TANGENT and abs(again[n - 1]) > SIDEWAYS * scale[n - 1]):
            orientation = math.nan
        for i in range(n):
            along[i] = again[i]
    if orientation != orientation:
        state[STATUS] = NO_TANGENT
        return 0
    for i in range(n):
        row[i], row[n + i] = new[i], along[i]
    row[2 * n], row[2 * n + 1] = orientation, state[ARCLENGTH] + travelled
    row[2 * n + 2] = iterations
    observe(data, new, along, orientation, row, 2 * n + HEAD)
    return 1


def attempt(
    evaluate: Evaluate[D],
    solve: Solve[D],
    tangent_at: TangentAt[D],
    data: D,
    vectors: tuple[Vector, ...],
    reached: Vector,
) -> int:
    """Try a step of the length in the state; returns a status.

    Fills the second and third row of `work` with the point reached and its tangent, and `HEAD` of
    its row.
    """
    options, state, scale, z, tangent, chord, work, _ = vectors
    guess, new, along, row = work[0], work[1], work[2], work[3]
    secant = options[SECANT] != 0.0 and state[BEHIND] == state[BEHIND]
    predict(z, tangent, chord, secant, state[STEP], scale, guess)
    for i in range(len(z)):
        row[i] = tangent[i] / scale[i] / scale[i]
    tolerance, most = options[TOLERANCE], int(options[ITERATIONS_AT_MOST])
    status, iterations, first = newton(
        evaluate, solve, data, new, guess, row, scale, along, tolerance, most
    )
    state[ITERATIONS] += iterations
    state[EVALUATIONS] += iterations + 1
    if status != CONVERGED:
        return status
    orientation = tangent_at(data, new, row, scale, along)
    if orientation != orientation:
        return NO_TANGENT
    turned = angle(along, tangent, scale)
    travelled = distance(new, z, scale)
    off = defect(z, new, tangent, along, travelled, scale)
    state[CORRECTION], state[TURNED], state[DEFECT] = first, turned, off
    if not turned <= options[MAX_ANGLE]:
        return TURNS
    if not off <= options[MAX_DEFECT]:
        return BENDS
    if leaves_range(z, new, tangent, along, travelled, options[LOW], options[HIGH]):
        return LEAVES
    mark = 2 * len(z)
    reached[mark] = orientation
    reached[mark + 1] = state[ARCLENGTH] + travelled
    reached[mark + 2] = iterations
    follows = step_after(
        state[STEP], turned, first, off, options[MAX_ANGLE], options[MAX_DEFECT], options[MAX_STEP]
    )
    state[NEXT_STEP] = round_length(follows, options[MAX_STEP])
    return CONVERGED


def accept(vectors: tuple[Vector, ...], orientation: float, arclength: float) -> None:
    """Go on from the point reached."""
    options, state, _, z, tangent, chord, work, _ = vectors
    new, along = work[1], work[2]
    if options[SECANT] != 0.0:
        for i in range(len(z)):
            chord[i] = new[i] - z[i]
    for i in range(len(z)):
        z[i], tangent[i] = new[i], along[i]
    state[EARLIEST], state[EARLIER] = state[EARLIER], state[ORIENTATION]
    state[ORIENTATION] = orientation
    state[FARTHER], state[BEHIND] = state[BEHIND], state[ARCLENGTH]
    state[ARCLENGTH] = arclength
    state[POINTS] += 1
    state[STEP] = state[NEXT_STEP]


def leaves_range(
    z: Vector,
    new: Vector,
    tangent: Vector,
    along: Vector,
    travelled: float,
    low: float,
    high: float,
) -> bool:
    """Whether the parameter turns beyond a limit between two points within the range.

    Where it turns, by the cubic through both points with their tangents.
    """
    last = len(z) - 1
    if tangent[last] * along[last] >= 0.0 or not low <= new[last] <= high:
        return False
    s = tangent[last] / (tangent[last] - along[last])
    highest = cubic(z[last], new[last], tangent[last], along[last], travelled, s)
    return not low <= highest <= high


def notices(
    before: float,
    now: float,
    turning: float,
    orientation: float,
    arclength: float,
    size: float,
    options: Vector,
    state: Vector,
) -> int:
    """Return why a step that converged is for the walker to judge, as a sum; 0 for a routine one.

    `before` and `now` are the parameter's values, `turning` is negative where it turns back between
    them, and `size` is its natural size.
    """
    found, known, ahead = 0, state[ORIENTATION], arclength - state[ARCLENGTH]
    if not options[LOW] <= now <= options[HIGH]:
        found += BEYOND
    if (orientation >= 0.0) != (known >= 0.0):
        if known == known:
            found += FLIPS
    elif options[MEETINGS] != 0.0 and orientation_dips(state, orientation, ahead):
        found += DIPS
    reach = 1.5 * abs(now - before) + options[SAME] * size
    if turning < 0.0:  # a start beside the turn may lie beyond both values
        reach = 1.5 * ahead * size
    if state[POINTS] >= FEWEST_ROUND and abs(now - options[FIRST]) <= reach:
        found += NEAR_START
    return found


def orientation_dips(state: Vector, orientation: float, ahead: float) -> bool:
    """Whether the orientation was to vanish within the step or just beyond."""
    earlier, known, behind = state[EARLIER], state[ORIENTATION], state[ARCLENGTH] - state[BEHIND]
    if not behind > 0.0 or known == 0.0:
        return False
    there = known + (known - earlier) * (ahead / behind)
    vanishes = (there if known > 0.0 else -there) < LITTLE * abs(known)
    return vanishes and not changes_evenly(state, orientation, ahead)


def changes_evenly(state: Vector, orientation: float, ahead: float) -> bool:
    """Whether one factor describes how the orientation changes from two points before to the one
    reached, as that of long words does, which is a product over all flights.

    Where it falls towards a crossing in proportion to the distance, of at most 4/3 of the step if
    it dips, the factors of the two steps before differ by an eighth or more.
    """
    behind, farther = state[ARCLENGTH] - state[BEHIND], state[BEHIND] - state[FARTHER]
    known, earlier, earliest = state[ORIENTATION], state[EARLIER], state[EARLIEST]
    if not farther > 0.0 or earlier == 0.0 or earliest == 0.0:
        return False
    first, second, third = earlier / earliest, known / earlier, orientation / known
    if not min(first, second, third) > 0.0:
        return False
    rate = math.log(second) / behind
    before, after = math.log(first) / farther, math.log(third) / ahead
    return abs(rate - before) * ahead <= EVENLY and abs(after - rate) * ahead <= EVENLY


# Where a walk is, the steps from there, and what they make: the seam to the backends.


class Notice(enum.IntFlag):
    """Why a step is for the walker to judge; see `contimpact.continuation.step.BEYOND`."""

    BEYOND = BEYOND
    FLIPS = FLIPS
    DIPS = DIPS
    NEAR_START = NEAR_START


@dataclass(frozen=True, eq=False)
class Position:
    """Where a walk is, and the numerics of the steps from there."""

    here: Point
    behind: Sequence[Point]
    """`here`, `behind`: the point reached, and up to two before, in order, where they count."""
    first: float
    """The parameter at the start of the walk."""
    points: int
    """How many there are."""
    step: float
    """Length of the step to try."""
    scale: Array
    """Shape (n + 1,)."""
    limits: tuple[float, float]
    same: float
    """Predicate that decides whether two solutions are the same."""
    settings: Settings
    by_defect: bool
    """Whether to look at the steps' defects."""
    meetings: bool
    """Whether to look out for branches that meet this one."""
    task: int = STEPS
    guess: Array | None = None
    """`task`, `guess`: what to do from there, and where a point is to be solved for."""

    def options(self) -> list[float]:
        """Return the vector `options` of `take_steps`."""
        given = self.settings
        largest = LARGEST_DEFECT * given.max_angle if self.by_defect else math.inf
        steps = given.min_step, given.max_step, given.max_angle, largest
        asked = float(given.predictor == "secant"), float(self.meetings)
        newton = given.tolerance, given.max_iterations
        return [*newton, *steps, *self.limits, self.first, self.same, *asked, float(self.task)]

    def state(self) -> list[float]:
        """Return the vector `state` of `take_steps`."""
        state = [0.0] * PLACES
        state[STEP], state[POINTS] = self.step, float(self.points)
        state[ARCLENGTH], state[ORIENTATION] = self.here.arclength, self.here.orientation
        places, before = [math.nan, math.nan], [math.nan, math.nan]
        for i, point in enumerate(reversed(self.behind)):
            places[i], before[i] = point.arclength, point.orientation
        state[BEHIND], state[FARTHER] = places
        state[EARLIER], state[EARLIEST] = before
        return state

    def chord(self) -> Array:
        """Return the way from the point before; where a point is solved for, its guess."""
        if self.guess is not None:
            return self.guess
        if not self.behind:
            return np.zeros(len(self.scale))
        return self.here.unknowns - self.behind[-1].unknowns

    def vectors(self, recorded: int, most: int, made_by: Containers = LISTS) -> StepVectors:
        """Return the vectors with which `take_steps` makes at most so many points.

        `recorded` is how many numbers ``observe`` records of each.
        """
        vector, table = made_by
        n = len(self.scale)
        tables = table(4, n), table(most, 2 * n + HEAD + recorded)
        return StepVectors._make([*map(vector, self._begun()), *tables])

    def _begun(self) -> tuple[Vector, ...]:
        """What is in the vectors, in their order, before the first step."""
        here = self.here
        return self.options(), self.state(), self.scale, here.unknowns, here.tangent, self.chord()

    def refill(self, vectors: StepVectors) -> None:
        """Make arrays anew what `vectors` made of them, for as many points."""
        for own, begun in zip(vectors, self._begun(), strict=False):
            own[:] = begun
        vectors.work.fill(0.0)
        vectors.rows.fill(0.0)


@dataclass(frozen=True, eq=False)
class Proposal:
    """A step for the walker to judge."""

    piece: Point | Block
    """The point reached; a block has no other."""
    notices: Notice
    next_step: float
    """The length to go on with if it is accepted."""

    @property
    def point(self) -> Point:
        """The point reached."""
        return self.piece if isinstance(self.piece, Point) else self.piece.point(0)


@dataclass(frozen=True, eq=False)
class Batch:
    """What steps have made."""

    piece: Point | Block | None
    """The points accepted, if there are any."""
    step: float
    """Length of the step to try next; of the one proposed or refused, where there is one."""
    iterations: int
    rejected: int
    proposal: Proposal | None = None
    """The step after them, if it is for the walker to judge."""
    refused: RefusalDetails | None = None
    """Why the step after them was refused, however short."""

    @property
    def routine(self) -> bool:
        """Whether the step after them is yet to be tried."""
        return self.proposal is None and self.refused is None


class Backend(Protocol):
    """A problem in the form in which steps are taken: on which linear algebra, how many at once."""

    def advance(self, position: Position, most: int) -> Batch:
        """Take steps until one is proposed or refused, but `most` of them, or fewer."""

    def look(self, values: Array, arclengths: Array) -> tuple[Array, Array, Array]:
        """Look for sign changes, as `contimpact.continuation.sign_changes.look_plainly`."""
        return look_plainly(values, arclengths)


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
    state, notices = vectors.state, Notice(int(vectors.state[NOTICE]))
    rows = np.asarray(vectors.rows[: made + 1 if notices else made])
    accepted, proposal = piece(rows[:made]) if made else None, None
    if notices:
        proposal = Proposal(piece(rows[made:]), notices, float(state[NEXT_STEP]))
    counts = int(state[ITERATIONS]), int(state[REJECTED])
    refused = refusal(position, state, problem, vectors.work[1])
    return Batch(accepted, float(state[STEP]), *counts, proposal, refused)


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
) -> RefusalDetails | None:
    """Return why `take_steps` accepted no further point, having last tried z.

    None where it did, or proposes one.
    """
    status = int(state[STATUS])
    if status == CONVERGED:
        return None
    if status < NO_TANGENT:
        return failure(status, problem, list(z), position.settings.max_iterations)
    cause, detail = {
        NO_TANGENT: (Refusal.NO_TANGENT, None),
        TURNS: (Refusal.TURNS, state[TURNED]),
        BENDS: (Refusal.BENDS, state[DEFECT]),
        LEAVES: (Refusal.LEAVES, None),
    }[status]
    return RefusalDetails(cause, detail)


# The backend for any problem: dense linear algebra, one step at a time.


class DenseBackend(Backend):
    """A problem as steps ask for it, with test functions asked of its points."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    def advance(self, position: Position, most: int) -> Batch:
        """Take one step."""
        functions = DenseSystem.evaluate, DenseSystem.solve
        asked_besides = DenseSystem.tangent_at, DenseSystem.observe
        system, vectors = DenseSystem(self.problem, position.scale), position.vectors(0, 1)
        made = take_steps(*functions, *asked_besides, system, tuple(vectors))
        piece = functools.partial(self.point, system)
        return batch_of(position, self.problem, vectors, made, piece)

    def point(self, system: DenseSystem, rows: Array) -> Point:
        """The point last evaluated, which is that of the only row."""
        _, tangents, *head, _ = columns(rows, (rows.shape[1] - HEAD) // 2)
        orientation, arclength, iterations = (float(column[0]) for column in head)
        return Point(system.here, tangents[0], orientation, arclength, int(iterations))
