"""Where test functions change sign between points, or may have done so twice.

Two zeros of a function between two points leave its sign as it was, three look like one. They are
excluded where a parabola bent more than the function can be stays on its side of zero, or, where
the sign changes, is monotone. How much the function is bent between b and c follows from the
parabolas through a, b, c and b, c, d, and from how far these two disagree::

    a --------- b ----------------- c ------- d
        behind         ahead         beyond
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ..arrays import Array, Number

MARGIN = 0.5
"""Added to the bend of a function, as part of it."""

ALONE = 2.0
"""Factor of the bend where only one parabola tells of it."""

MIDDLE = 0.4871
"""Fraction at which an arc is cut if nothing says better: away from the places that coincidences
prefer."""

OFF_THE_ENDS = 0.1
"""An arc is not cut nearer to its ends than this part of it."""


JUMPS = 8.0
"""How many times faster than on either side a value changes where it jumps."""

THRICE, DIPS, ENDS = 1, 2, 3
"""Findings of `suspect_values`: a value that changes sign and may do so thrice, one that may do so
twice, and one that may do so where it begins or ends."""

Suspects: TypeAlias = tuple[Array, Array]
"""Findings, and where to look, as `suspect_values` returns them."""


def split_row(values: Array, sizes: Sequence[int]) -> list[Array]:
    """Return a row of values by test function."""
    ends = itertools.accumulate(sizes)
    return [values[end - size : end] for size, end in zip(sizes, ends, strict=True)]


@dataclass(frozen=True, eq=False)
class Sample:
    """The test functions at a point of the branch: where along it, and their values."""

    arclength: float
    flat: Array
    """All values in a row."""
    sizes: Sequence[int]
    """How many each of them has."""

    @classmethod
    def of(cls, arclength: float, values: Sequence[Array]) -> Sample:
        """Return the sample of the values of each test function."""
        return cls(arclength, np.concatenate([*values, np.zeros(0)]), [len(v) for v in values])

    @property
    def values(self) -> list[Array]:
        """The values by test function."""
        return split_row(self.flat, self.sizes)


@dataclass(frozen=True, eq=False)
class Stretch:
    """Test functions at both ends of an arc, and at the points before and after it, if known."""

    left: Sample
    right: Sample
    before: Sample | None = None
    after: Sample | None = None
    known: Suspects | None = None
    """`suspects`, where they have been found."""

    def cut(self, middle: Sample) -> tuple[Stretch, Stretch]:
        """Return the stretches on both sides of a point between."""
        return (
            Stretch(self.left, middle, self.before, self.right),
            Stretch(middle, self.right, self.left, self.after),
        )

    def suspects(self) -> Suspects:
        """Return which values may change sign unseen, and where to look; see `suspect_values`."""
        if self.known is not None:
            return self.known[0].copy(), self.known[1].copy()
        left, right, before, after = self.left, self.right, self.before, self.after
        none = np.full(len(left.flat), np.nan)
        a, d = (none if end is None else end.flat for end in (before, after))
        behind = np.nan if before is None else left.arclength - before.arclength
        beyond = np.nan if after is None else after.arclength - right.arclength
        ahead = right.arclength - left.arclength
        return suspect_values(a, left.flat, right.flat, d, behind, ahead, beyond)

    def vanishing(self, places: slice) -> Array:
        """Return which of some values may vanish unseen whose sign says nothing: it changes where
        another one of several becomes the smallest.

        Where a value jumps, which it does far faster than on either side, it does not vanish, and
        what lies beyond says nothing.
        """
        four = [self.before, self.left, self.right, self.after]
        none = np.full(len(self.left.flat[places]), np.nan)
        a, b, c, d = (none if end is None else np.abs(end.flat[places]) for end in four)
        at = np.array([np.nan if end is None else end.arclength for end in four])
        behind, ahead, beyond = np.diff(at)
        rates = np.abs(np.diff([a, b, c, d], axis=0)) / np.diff(at)[:, None]
        a = np.where(rates[0] > JUMPS * np.fmax(rates[1], rates[2]), np.nan, a)
        d = np.where(rates[2] > JUMPS * np.fmax(rates[0], rates[1]), np.nan, d)
        passed = crosses(self.left.flat[places], self.right.flat[places])
        passed &= ~(b + c > JUMPS * ahead * np.fmax(rates[0], rates[2]))
        return passed | (suspect_values(a, b, c, d, behind, ahead, beyond)[0] == DIPS)

    def one_sided(self) -> tuple[Stretch, Stretch]:
        """Return the stretch without the point after it, and without the one before."""
        return replace(self, after=None, known=None), replace(self, before=None, known=None)


def crosses(left: Array, right: Array) -> Array:
    """Return which values change sign between two points.

    Zero counts as positive: a zero exactly on a point is found from one side only, once.
    """
    both = ~(np.isnan(left) | np.isnan(right))
    return both & ((left >= 0.0) != (right >= 0.0))


def crossings(left: Array, right: Array) -> list[int]:
    """Return the indices that change sign between two points."""
    return np.nonzero(crosses(left, right))[0].tolist()


def suspect_values(
    a: Array, b: Array, c: Array, d: Array, behind: Number, ahead: Number, beyond: Number
) -> Suspects:
    """Return which values may change sign unseen between b and c, and where to look.

    Parameters
    ----------
    a, b, c, d : ndarray of shape (q,)
        Values at four points in order; `a` and `d` are not numbers where there is no such point.
    behind, ahead, beyond : float or ndarray of shape (q,)
        Arclength from a to b, b to c and c to d.

    Returns
    -------
    found : ndarray of shape (q,)
        `THRICE`, `DIPS` or `ENDS`, or 0 where all sign changes are seen.
    places : ndarray of shape (q,)
        Where between b and c, from 0 to 1.
    """
    with np.errstate(all="ignore"):
        rate = (c - b) / ahead
        before = (rate - (b - a) / behind) / (ahead + behind)
        after = ((d - c) / beyond - rate) / (beyond + ahead)
        here, there = ~np.isnan(b), ~np.isnan(c)
        passed = crosses(b, c)
        side = np.where(b >= 0.0, 1.0, -1.0)
        # side * value >= |b| + climb x - bend x (1 - x) for x from 0 to 1
        one = np.where(passed, np.abs(before), side * before)
        other = np.where(passed, np.abs(after), side * after)
        bend = ahead**2 * _largest_bend(one, other, np.abs(after - before))
        climb = side * (c - b)
        place = 0.5 - climb / (2.0 * bend)
        lowest = np.abs(b) + climb * place - bend * place * (1.0 - place)
        turns = (bend > np.abs(climb)) | np.isnan(bend)
        dips = turns & (passed | ~(lowest >= 0.0))
    found = np.where(here & there & dips, np.where(passed, THRICE, DIPS), 0)
    if np.any(here != there):
        with np.errstate(all="ignore"):
            vanishes = here & ~there & _may_pass(b, a, ahead / behind)
            appears = there & ~here & _may_pass(c, d, ahead / beyond)
        found[vanishes | appears] = ENDS
    aimed = (found == DIPS) & ~np.isnan(place)
    places = np.where(aimed, np.clip(place, OFF_THE_ENDS, 1.0 - OFF_THE_ENDS), MIDDLE)
    return found, places


def _largest_bend(before: Array, after: Array, apart: Array) -> Array:
    """Bound the bend of functions between two points from those on either side."""
    both = np.maximum(before, after) + apart
    both += MARGIN * np.maximum(np.abs(before), np.abs(after))
    alone = ALONE * np.where(np.isnan(before), after, before)
    return np.where(np.isnan(both), alone, both)


def _may_pass(last: Array, earlier: Array, ratio: Number) -> Array:
    """Whether a value that ends after `last` may pass zero before: twice its rate would do."""
    reached = last + 2.0 * ratio * (last - earlier)
    return np.isnan(reached) | ((reached >= 0.0) != (last >= 0.0))


@dataclass(frozen=True, eq=False)
class Samples:
    """The test functions at points of a walk that follow each other."""

    arclengths: Array
    """First those of the points before; NaN where there is none, shape (P + 2,)."""
    values: Array
    """Shape (P + 2, q)."""
    sizes: Sequence[int]
    """How many values each test function has."""

    @classmethod
    def of(cls, arclength: float, values: Sequence[Array]) -> Samples:
        """Return those at one point, with none before."""
        here = Sample.of(arclength, values)
        none = np.full(len(here.flat), np.nan)
        return cls(np.array([np.nan, arclength]), np.array([none, here.flat]), here.sizes)

    def then(self, arclengths: Array, values: Array) -> Samples:
        """Return those at the last two points and further ones."""
        lengths = np.concatenate([self.arclengths[-2:], arclengths])
        return Samples(lengths, np.vstack([self.values[-2:], values]), self.sizes)

    @property
    def follows(self) -> bool:
        """Whether there is a point before the last one."""
        return not np.isnan(self.arclengths[-2])

    def last(self) -> Samples:
        """Return those at the last two points."""
        return Samples(self.arclengths[-2:], self.values[-2:], self.sizes)

    def alone(self) -> Samples:
        """Return those at the last point, with none before."""
        return self.of(float(self.arclengths[-1]), self.split(self.values[-1]))

    def split(self, values: Array) -> list[Array]:
        """Return a row of values by test function."""
        return split_row(values, self.sizes)

    def at(self, i: int) -> Sample | None:
        """Return those at one point, None where there is none."""
        if i >= len(self.arclengths) or np.isnan(self.arclengths[i]):
            return None
        return Sample(float(self.arclengths[i]), self.values[i], self.sizes)

    def stretch(self, i: int, known: Suspects) -> Stretch:
        """Return those around the step to point i of the P."""
        left, right = self.at(i + 1), self.at(i + 2)
        assert left is not None
        assert right is not None
        return Stretch(left, right, self.at(i), self.at(i + 3), known)

    def noteworthy(self) -> dict[int, Suspects]:
        """Return before which of the P points events lie or may lie unseen."""
        return noteworthy_points(self.values, self.arclengths)


FEW = 1000
"""Values fewer than this are all looked at closely; of more, those that surely stay on their side
of zero are set aside first."""


def noteworthy_points(values: Array, arclengths: Array) -> dict[int, Suspects]:
    """Return before which points, from the third one on, events lie or may lie unseen, in order,
    and what is suspected there.

    Parameters
    ----------
    values : ndarray of shape (P + 2, q)
        Test functions.
    """
    if not values.shape[1]:
        return {}
    lengths = np.diff(arclengths)
    if values.size < FEW:
        after = np.vstack([values[3:], np.full((1, values.shape[1]), np.nan)])
        beyond = np.append(lengths[2:], 1.0)
        four = values[:-2], values[1:-1], values[2:], after
        widths = lengths[:-1, None], lengths[1:, None], beyond[:, None]
        found, places = suspect_values(*four, *widths)
        marked = np.any(crosses(four[1], four[2]) | (found > 0), axis=1)
        return {row: (found[row], places[row]) for row in np.flatnonzero(marked).tolist()}
    with np.errstate(all="ignore"):
        rates = np.abs(np.diff(values, axis=0)) / lengths[:, None]
        sizes = np.abs(values[1:])
        far = 0.5 * np.minimum(sizes[:-1], sizes[1:]) / lengths[1:, None]
        # that a parabola needs one of the points before and after is seen from their rates
        quiet = (rates[1:] < far) & ~(rates[:-1] >= far)
        known = rates[:-1] >= 0.0
        quiet[:-1] &= ~(rates[2:] >= far[:-1])
        known[:-1] |= rates[2:] >= 0.0
        quiet &= known
    nothing = np.isnan(values[1:-1]) & np.isnan(values[2:])
    rows, columns = np.nonzero(~(quiet | nothing))
    if not len(rows):
        return {}
    a, b, c = (values[rows + i, columns] for i in range(3))
    after = np.vstack([values, np.full((1, values.shape[1]), np.nan)])
    beyond = np.append(lengths, 1.0)
    given = a, b, c, after[rows + 3, columns], lengths[rows], lengths[rows + 1], beyond[rows + 2]
    found, places = suspect_values(*given)
    noted = {}
    for row in np.unique(rows[crosses(b, c) | (found > 0)]).tolist():
        whole = np.zeros(values.shape[1], dtype=found.dtype), np.full(values.shape[1], MIDDLE)
        here = rows == row
        whole[0][columns[here]], whole[1][columns[here]] = found[here], places[here]
        noted[row] = whole
    return noted
