"""The step: predict, correct, turn the tangent, judge, and choose the length of the next one.

Every step of a walk is taken here, for any problem, one or many at a time. Written in the plain
subset of Python that `contimpact.compiling` compiles: vectors are lists where it runs plainly,
arrays where it runs compiled. A step that leads out of the range or perhaps to another branch, or
that may close a loop, is proposed to the walker, which decides.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from ..arrays import Table, Vector
from .corrector import CONVERGED, D, Evaluate, Solve, newton
from .metric import angle, distance
from .predictor import cubic, predict
from .step_control import defect, rounded, shorter, step_after

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
) = range(12)
"""Places in `options`: of the settings, the largest defect, the range, the parameter at the start
of the walk, what counts as the same solution, and whether to predict along chords and to look out
for branches that meet."""

(
    STEP,
    ARCLENGTH,
    BEHIND,
    ORIENTATION,
    EARLIER,
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
) = range(16)
"""Places in `state`. The length of the step to try; the arclength here and at the point before (NaN
if there is none), and the orientation at both; points so far. Of the step last tried: the length to
follow it, the first correction, the angle, and the defect. Why no further step was accepted: a
status, or a sum of notices. Three counts. Last, how many places there are."""

NO_TANGENT, TURNS, BENDS, LEAVES = range(5, 9)
"""Status codes of a step, besides those of `newton`."""

BEYOND, FLIPS, DIPS, NEAR_START = 1, 2, 4, 8
"""Notices of a step: it leads out of the range; the orientation flips, or was about to vanish and
has not; the start may lie on it."""

LITTLE = 0.25
"""What is left of the orientation where it is about to vanish."""

HEAD = 3
"""Numbers of a row between unknowns and tangent and what `observe` records: orientation, arclength
and iterations."""

TangentAt: TypeAlias = Callable[[D, Vector, Vector, Vector, Vector], float]
Observe: TypeAlias = Callable[[D, Vector, Vector, float, Vector, int], None]
"""What `take_steps` asks of a problem besides."""


class StepVectors(NamedTuple):
    """What steps go by, and what they keep up to date; `take_steps` has it as a plain tuple.

    Attributes
    ----------
    options, state : vector
        See `TOLERANCE` and `STEP`.
    scale : vector
        Natural sizes of the unknowns.
    z, tangent, chord : vector
        The point the walk is at, its unit tangent, and the way from the point before.
    work : table
        Scratch space of four rows of n + 1 numbers.
    rows : table
        A row for each point to make: unknowns, tangent, `HEAD`, and what `observe` records.
    """

    options: Vector
    state: Vector
    scale: Vector
    z: Vector
    tangent: Vector
    chord: Vector
    work: Table
    rows: Table


def take_steps(
    evaluate: Evaluate[D],
    solve: Solve[D],
    tangent_at: TangentAt[D],
    observe: Observe[D],
    data: D,
    vectors: tuple[Vector, ...],
) -> int:
    """Take steps until one is proposed to the walker or refused at the smallest length.

    Parameters
    ----------
    evaluate, solve : callable
        As in `newton`.
    tangent_at : callable ``tangent_at(data, z, row, scale, out) -> orientation``
        Fills `out` with the null vector at the point last evaluated that goes on along `row`; NaN
        if there is none.
    observe : callable ``observe(data, z, tangent, orientation, row, at)``
        Records whatever else a point is to carry in its row, from place `at` on.
    data
        Handed on to them.
    vectors : tuple
        `StepVectors`, kept up to date; the row of a step that is proposed follows those of the
        points made.

    Returns
    -------
    made : int
        Points made. If fewer than there are rows, a step is proposed where there are notices in
        the state, else refused.
    """
    options, state, scale, z, tangent, _, work, rows = vectors
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
            state[STEP] = shorter(state[STEP], options[MIN_STEP])
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
    if leaves(z, new, tangent, along, travelled, options[LOW], options[HIGH]):
        return LEAVES
    mark = 2 * len(z)
    reached[mark] = orientation
    reached[mark + 1] = state[ARCLENGTH] + travelled
    reached[mark + 2] = iterations
    follows = step_after(
        state[STEP], turned, first, off, options[MAX_ANGLE], options[MAX_DEFECT], options[MAX_STEP]
    )
    state[NEXT_STEP] = rounded(follows, options[MAX_STEP])
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
    state[EARLIER] = state[ORIENTATION]
    state[ORIENTATION] = orientation
    state[BEHIND] = state[ARCLENGTH]
    state[ARCLENGTH] = arclength
    state[POINTS] += 1
    state[STEP] = state[NEXT_STEP]


def leaves(
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
    found, known = 0, state[ORIENTATION]
    if not options[LOW] <= now <= options[HIGH]:
        found += BEYOND
    if (orientation >= 0.0) != (known >= 0.0):
        if known == known:
            found += FLIPS
    elif options[MEETINGS] != 0.0 and dips(state, arclength - state[ARCLENGTH]):
        found += DIPS
    reach = 1.5 * abs(now - before) + options[SAME] * size
    if turning < 0.0:  # a start beside the turn may lie beyond both values
        reach = 1.5 * (arclength - state[ARCLENGTH]) * size
    if state[POINTS] >= 4.0 and abs(now - options[FIRST]) <= reach:
        found += NEAR_START
    return found


def dips(state: Vector, ahead: float) -> bool:
    """Whether the orientation was to vanish within the step or just beyond."""
    earlier, known, behind = state[EARLIER], state[ORIENTATION], state[ARCLENGTH] - state[BEHIND]
    if not behind > 0.0 or known == 0.0:
        return False
    there = known + (known - earlier) * (ahead / behind)
    return (there if known > 0.0 else -there) < LITTLE * abs(known)
