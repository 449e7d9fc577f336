"""Routine steps of a walk, many at a time: predict, correct, accept or shrink, test functions.

Written in the plain subset of Python that `contimpact.compiling` compiles: vectors are lists where
it runs plainly, arrays where it runs compiled. What is not routine (the end of the range, a
tangent that flips, the neighbourhood of the start, a step that cannot shrink further) is left to
the walker, one step at a time; so is the location of events on the steps marked here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from .arclength import (
    CONVERGED,
    LARGEST_DEFECT,
    angle,
    cubic,
    defect,
    distance,
    newton,
    norm,
    step_after,
)
from .branch import Block, Point
from .problem import Array
from .settings import Settings
from .sign_changes import noteworthy

STEP, ARCLENGTH, ORIENTATION, BEHIND, POINTS, ITERATIONS, REJECTED, EVALUATIONS = range(8)
"""Places in `state`: the next step's length, where the walk is, the determinant's sign there, how
far behind the point before is (0 for none), points so far, and three counts."""

TOLERANCE, MOST, SMALLEST, LARGEST, ANGLE, LOW, HIGH, FIRST, SAME, SECANT = range(10)
"""Places in `options`: of the settings, the range, the parameter at the start of the walk, what
counts as the same solution, and whether to predict along chords."""

EXTRA = 3
"""Numbers of a row beside unknowns, tangent and what `observe` puts down: orientation, arclength
and iterations."""


@dataclass(frozen=True, eq=False)
class Footing:
    """Where a walk is: what routine steps go on from.

    Attributes
    ----------
    here, behind : Point
        The point reached, and the one before; None where that does not count.
    first : float
        The parameter at the start of the walk.
    points : int
        How many there are.
    step : float
        The next step's length.
    scale : ndarray of shape (n + 1,)
    limits : (low, high)
    same : float
        What counts as the same solution.
    values, earlier : ndarray of shape (q,)
        The test functions at both points.
    """

    here: Point
    behind: Point | None
    first: float
    points: int
    step: float
    scale: Array
    limits: tuple[float, float]
    same: float
    values: Array
    earlier: Array

    def options(self, settings: Settings) -> list[float]:
        """Return the vector `options` of `march`."""
        return [
            settings.tolerance, settings.max_iterations, settings.min_step, settings.max_step,
            settings.max_angle, *self.limits, self.first, self.same,
            float(settings.predictor == "secant"),
        ]  # fmt: skip

    def state(self) -> list[float]:
        """Return the vector `state` of `march`."""
        here, back = self.here, 0.0
        if self.behind is not None:
            back = here.arclength - self.behind.arclength
        place = [self.step, here.arclength, here.orientation, back, float(self.points)]
        return [*place, 0.0, 0.0, 0.0]

    def chord(self) -> Array:
        """Return the way from the point before."""
        if self.behind is None:
            return np.zeros(len(self.scale))
        return self.here.unknowns - self.behind.unknowns


@dataclass(frozen=True, eq=False)
class Made:
    """What routine steps made.

    Attributes
    ----------
    block : Block
    marked : list of int
        Points before which events may lie.
    values, arclengths : ndarray
        The test functions and the arclength at both points of the footing and at every new one.
    step : float
        The next step's length.
    unusual : bool
        Whether the next step is not routine.
    iterations, rejected : int
    """

    block: Block
    marked: list[int]
    values: Array
    arclengths: Array
    step: float
    unusual: bool
    iterations: int
    rejected: int

    def __len__(self) -> int:
        return len(self.block.iterations)

    def until(self, last: int) -> Made:
        """Return the first points, the step after them not being routine."""
        return replace(
            self, block=self.block[:last], marked=[i for i in self.marked if i < last],
            values=self.values[: last + 2], arclengths=self.arclengths[: last + 2],
            step=float(self.arclengths[last + 2] - self.arclengths[last + 1]), unusual=True,
        )  # fmt: skip

    @classmethod
    def of(
        cls, footing: Footing, state: Sequence[float], rows: Array, asked: int,
        make: Callable[[Array, Array], Any],
    ) -> Made:  # fmt: skip
        """Read the rows of `march`."""
        n, q = len(footing.scale), len(footing.values)
        mark = 2 * n
        block = Block(
            rows[:, :n], rows[:, n:mark], rows[:, mark], rows[:, mark + 1], rows[:, mark + 2],
            rows[:, mark + EXTRA + q :], make,
        )  # fmt: skip
        here = footing.here.arclength
        back = here if footing.behind is None else footing.behind.arclength
        seen = rows[:, mark + EXTRA : mark + EXTRA + q]
        values = np.vstack([footing.earlier, footing.values, seen])
        arclengths = np.concatenate([[back, here], rows[:, mark + 1]])
        return cls(
            block, noteworthy(values, arclengths), values, arclengths, float(state[STEP]),
            len(rows) < asked, int(state[ITERATIONS]), int(state[REJECTED]),
        )  # fmt: skip


class System(Protocol):
    """A problem with its test functions, in the form in which `march` makes routine steps."""

    def march(self, footing: Footing, settings: Settings, most: int) -> Made:
        """Make routine steps, `most` of them unless one is not routine."""


def march(
    evaluate, solve, tangent_at, observe, data, options, state, scale, z, tangent, chord, room,
    rows, width, most,
):  # fmt: skip
    """Make routine steps until something is not routine.

    Parameters
    ----------
    evaluate, solve : callable
        As in `newton`.
    tangent_at : callable ``tangent_at(data, z, row, scale, out) -> orientation``
        Fills `out` with the null vector at the point last evaluated that goes on along `row`; not
        a number where there is none.
    observe : callable ``observe(data, z, tangent, orientation, rows, at)``
        Puts the values of the test functions, and whatever else a point is to carry, into a row.
    data
        Handed on to them.
    options, state, scale : vector
        See `TOLERANCE` and `STEP`; `state` is kept up to date.
    z, tangent, chord : vector
        The point the walk is at, its unit tangent, and the way from the point before; kept up to
        date.
    room : vector
        Space for 4 (n + 1) numbers.
    rows : vector
        Filled with a row of `width` numbers for each point: unknowns, tangent, `EXTRA`, and what
        `observe` put down, the test functions first.
    width, most : int
        Of a row, and points to make at most.

    Returns
    -------
    made : int
        Points made; fewer than `most` where a step is not routine.
    """
    n = len(z)
    tolerance, iterations_at_most = options[TOLERANCE], int(options[MOST])
    smallest, largest, widest = options[SMALLEST], options[LARGEST], options[ANGLE]
    low, high, chords = options[LOW], options[HIGH], options[SECANT] != 0.0
    guess, new, along, row = room[0], room[1], room[2], room[3]
    made = 0
    while made < most:
        step = state[STEP]
        secant = chords and state[BEHIND] > 0.0
        size = 1.0
        if secant:
            size = norm(chord, scale)
        for i in range(n):
            guess[i] = z[i] + step * (chord[i] / size if secant else tangent[i])
            row[i] = tangent[i] / scale[i] / scale[i]
        status, iterations, first = newton(
            evaluate, solve, data, new, guess, row, scale, along, tolerance, iterations_at_most
        )
        state[ITERATIONS] += iterations
        state[EVALUATIONS] += iterations + 1
        orientation, turned, off = math.nan, math.inf, math.inf
        if status == CONVERGED:
            orientation = tangent_at(data, new, row, scale, along)
        if orientation == orientation:
            turned = angle(along, tangent, scale)
            off = defect(z, new, tangent, along, scale)
        turns = tangent[n - 1] * along[n - 1] < 0.0
        bent = not (turned <= widest and off <= LARGEST_DEFECT * widest)
        if bent or (turns and leaves(z, new, tangent, along, scale, low, high)):
            state[REJECTED] += 1
            if step <= smallest:
                state[ITERATIONS] -= iterations
                state[REJECTED] -= 1
                return made
            state[STEP] = max(0.5 * step, smallest)
            continue
        if not low <= new[n - 1] <= high or unusual(
            z[n - 1], new[n - 1], orientation, scale[n - 1], options, state
        ):
            state[ITERATIONS] -= iterations
            return made
        at = width * made
        for i in range(n):
            chord[i] = new[i] - z[i]
            z[i] = rows[at + i] = new[i]
            tangent[i] = rows[at + n + i] = along[i]
        travelled = norm(chord, scale)
        mark = at + 2 * n
        rows[mark] = orientation
        rows[mark + 1] = state[ARCLENGTH] + travelled
        rows[mark + 2] = iterations
        observe(data, z, tangent, orientation, rows, mark + EXTRA)
        state[BEHIND] = travelled
        state[ARCLENGTH] += travelled
        state[ORIENTATION] = orientation
        state[POINTS] += 1
        state[STEP] = step_after(step, turned, first, off, widest, largest)
        made += 1
    return made


def leaves(z, new, tangent, along, scale, low, high):
    """Whether the parameter turns beyond a limit between two points within the range.

    Where it turns, by the cubic through both points with their tangents.
    """
    last = len(z) - 1
    if tangent[last] * along[last] >= 0.0 or not low <= new[last] <= high:
        return False
    s = tangent[last] / (tangent[last] - along[last])
    highest = cubic(z[last], new[last], tangent[last], along[last], distance(new, z, scale), s)
    return not low <= highest <= high


def unusual(before, now, orientation, size, options, state):
    """Whether a step flips the orientation, or may close the branch."""
    known = state[ORIENTATION]
    if (orientation >= 0.0) != (known >= 0.0) and known == known:
        return True
    reach = 1.5 * abs(now - before) + options[SAME] * size
    return state[POINTS] >= 4.0 and abs(now - options[FIRST]) <= reach
