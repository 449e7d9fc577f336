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
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ..arrays import Array, Table, Vector

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
    pairs = enumerate(zip(left.tolist(), right.tolist(), strict=True))
    return [i for i, (b, c) in pairs if b == b and c == c and (b >= 0.0) != (c >= 0.0)]


def suspect_values(
    a: Array, b: Array, c: Array, d: Array, behind: float, ahead: float, beyond: float
) -> Suspects:
    """Return which of q values may change sign unseen between b and c, and where to look.

    a, b, c, d are the values at four points in order, of shape (q,), NaN where there is no such
    point; `behind`, `ahead` and `beyond` are the arclengths between them. Of each value the result
    has `THRICE`, `DIPS` or `ENDS`, or 0 where all sign changes are seen, and the place between b
    and c, from 0 to 1.
    """
    lengths = float(behind), float(ahead), float(beyond)
    four = zip(a.tolist(), b.tolist(), c.tolist(), d.tolist(), strict=True)
    told = [suspect(*values, *lengths) for values in four]
    return np.array([what for what, _ in told], dtype=int), np.array([place for _, place in told])


# The same of one value, and of many points: in the plain subset of Python that
# `contimpact.compiling` compiles.


def suspect(
    a: float, b: float, c: float, d: float, behind: float, ahead: float, beyond: float
) -> tuple[int, float]:
    """Return what is suspected of one value, and where; see `suspect_values`."""
    if b != b or c != c:
        vanishes = c != c and b == b and may_pass(b, a, ratio(ahead, behind))
        appears = b != b and c == c and may_pass(c, d, ratio(ahead, beyond))
        return (ENDS if vanishes or appears else 0), MIDDLE
    passed = (b >= 0.0) != (c >= 0.0)
    rate = ratio(c - b, ahead)
    before = ratio(rate - ratio(b - a, behind), ahead + behind)
    after = ratio(ratio(d - c, beyond) - rate, beyond + ahead)
    side = 1.0 if b >= 0.0 else -1.0
    # side * value >= |b| + climb x - bend x (1 - x) for x from 0 to 1
    one = abs(before) if passed else side * before
    other = abs(after) if passed else side * after
    bend = ahead * ahead * largest_bend(one, other, abs(after - before))
    climb = side * (c - b)
    if bend <= abs(climb):
        return 0, MIDDLE
    if passed:
        return THRICE, MIDDLE
    place = 0.5 - ratio(climb, 2.0 * bend)
    if abs(b) + climb * place - bend * place * (1.0 - place) >= 0.0:
        return 0, MIDDLE
    if place != place:
        return DIPS, MIDDLE
    return DIPS, min(max(place, OFF_THE_ENDS), 1.0 - OFF_THE_ENDS)


def ratio(x: float, y: float) -> float:
    """Return x / y, infinite or not a number where y is zero."""
    if y != 0.0:
        return x / y
    return x * math.inf if y == y else math.nan


def largest_bend(before: float, after: float, apart: float) -> float:
    """Bound the bend of a function between two points from those on either side."""
    both = max(before, after) + apart + MARGIN * max(abs(before), abs(after))
    if before == before and after == after and both == both:
        return both
    return ALONE * (before if before == before else after)


def may_pass(last: float, earlier: float, times: float) -> bool:
    """Whether a value that ends after `last` may pass zero before: twice its rate would do."""
    reached = last + 2.0 * times * (last - earlier)
    return reached != reached or (reached >= 0.0) != (last >= 0.0)


def look_through(
    values: Table, arclengths: Vector, rows: Vector, found: Table, places: Table
) -> int:
    """Fill in before which points, from the third one on, events lie or may lie unseen.

    `values` has the test functions, a row for each point; an arclength is NaN where there is no
    point. `rows` is filled with the points, counted from the third one on, `found` and `places` as
    by `suspect_values` with a row for each of them; returns how many they are.
    """
    made, points = 0, len(values)
    for i in range(1, points - 1):
        behind, ahead = arclengths[i] - arclengths[i - 1], arclengths[i + 1] - arclengths[i]
        last = i + 2 == points
        beyond = 1.0 if last else arclengths[i + 2] - arclengths[i + 1]
        marked = False
        earlier, left, right = values[i - 1], values[i], values[i + 1]
        later = right if last else values[i + 2]
        for j in range(len(left)):
            a, b, c, d = earlier[j], left[j], right[j], later[j]
            near = 0.0  # less than half the smaller size: no bend by such rates leads to zero
            if b > 0.0 and c > 0.0 and ahead > 0.0:
                near = 0.5 * (b if b < c else c)
            elif b < 0.0 and c < 0.0 and ahead > 0.0:
                near = -0.5 * (b if b > c else c)
            quiet = -near < c - b < near and -near * behind < (b - a) * ahead < near * behind
            if quiet and (last or -near * beyond < (d - c) * ahead < near * beyond):
                found[made][j], places[made][j] = 0, MIDDLE
                continue
            what, place = suspect(a, b, c, math.nan if last else d, behind, ahead, beyond)
            found[made][j], places[made][j] = what, place
            marked = marked or what > 0 or (b == b and c == c and (b >= 0.0) != (c >= 0.0))
        if marked:
            rows[made] = i - 1
            made += 1
    return made


Look: TypeAlias = Callable[[Array, Array], "tuple[Array, Array, Array]"]
"""``look(values, arclengths)``: what `look_through` fills in."""


def look_plainly(values: Array, arclengths: Array) -> tuple[Array, Array, Array]:
    """Return what `look_through` fills in."""
    points, count = values.shape
    rows, found, places = [0] * points, *([[0.0] * count for _ in range(points)] for _ in range(2))
    made = look_through(values.tolist(), arclengths.tolist(), rows, found, places)
    return np.array(rows[:made], dtype=int), np.array(found[:made]), np.array(places[:made])


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

    def noteworthy(self, look: Look = look_plainly) -> dict[int, Suspects]:
        """Return before which of the P points events lie or may lie unseen, in order, and what is
        suspected there."""
        if not self.values.shape[1]:
            return {}
        rows, found, places = look(self.values, self.arclengths)
        told = zip(found.astype(int), places, strict=True)
        return dict(zip(rows.tolist(), told, strict=True))
