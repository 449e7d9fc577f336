r"""Arrangements of curves in the plane, and the frame of a map.

All is in the unit square. Vertical lines through every place where the order of the curves
changes, an end, a turn, a crossing or a mark, cut it into slabs. In a slab every arc goes from one
side to the other and no two cross, so that the cells lie one above another:

::

    1 +-----+---------+------+
      |     |  ___----|--\   |
      |     |_/  cell |   \__|      bounds of a slab, from below: the lower side,
      |_____|_________|______|      its arcs, the upper side
      |     |         |      |
    0 +-----+---------+------+
     x0    x1        x2     x3

Curves are known by points and interpolated by cubic splines over their arclength.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline, PPoly
from scipy.optimize import brentq

from ..arrays import Array
from ..bifurcations.declarations import REQUESTED
from ..models.guards import is_rotation
from ..results.curve import Curve, falling_column, ghost_mask, unique_values
from ..results.scene import Scene

SAME = 1e-6
"""Places nearer than this part of the rectangle's sides are one."""
TIGHT = 1e-9
"""Distances of arcs below this part of the height have no sign."""
MOST_ROUNDS = 8
"""How often slabs are cut anew where arcs turn out to cross in them."""
BETWEEN = (0.25, 0.5, 0.75)
"""Fraction of the way between two points of a curve at which it is compared with their chord."""
FINE = 8
"""Parts into which the way from one point of a curve to the next is divided to find crossings."""


@dataclass(frozen=True)
class Path:
    """A curve in the unit square."""

    name: str
    points: Array
    """Shape (P, 2)."""
    arclengths: Array
    """Shape (P,)."""
    plain: Array
    """Points through which the spline goes, shape (P,)."""
    marked: Array
    """Other points at which what happens on the curve changes, shape (P,)."""
    kept: Array
    """Whether the way from each point to the next divides the square, shape (P - 1,)."""

    @cached_property
    def spline(self) -> CubicSpline:
        """The curve over its arclength."""
        chosen = self.plain.copy()
        chosen[[0, -1]] = True
        rows = np.nonzero(chosen)[0]
        s = self.arclengths[rows]
        apart = np.concatenate([[True], np.diff(s) > SAME])
        if not apart[-1]:  # the last point stays, and so does the one before, unless it is there
            apart[np.nonzero(apart)[0][-1]] = apart.sum() == 1
            apart[-1] = True
        return CubicSpline(s[apart], self.points[rows[apart]])

    def place(self, row: int) -> float:
        """Return the arclength of the point of the spline next to a mark."""
        s = float(self.arclengths[row])
        for _ in range(3):
            tangent = self.spline(s, 1)
            square = float(tangent @ tangent)
            if square == 0.0:
                break
            s += float((self.points[row] - self.spline(s)) @ tangent) / square
        low, high = self.spline.x[[0, -1]]
        return min(max(s, float(low)), float(high))

    def arcs(self) -> list[Arc]:
        """Return its kept parts, cut where x turns; those that stand upright are left out."""
        found = []
        for first, last in _runs(self.kept):
            low, high = self.place(first), self.place(last)
            cuts = sorted({low, high, *self._turns(low, high)})
            found += [Arc(self.name, self.spline, *pair) for pair in itertools.pairwise(cuts)]
        return [arc for arc in found if arc.high - arc.low > SAME]

    def edges(self) -> list[float]:
        """Return the values of x at which its kept parts begin, end, turn or are marked."""
        found = []
        for first, last in _runs(self.kept):
            marks = [row for row in range(first, last + 1) if self.marked[row]]
            found += [float(self.points[row, 0]) for row in {first, last, *marks}]
            turns = self._turns(self.place(first), self.place(last))
            found += [float(self.spline(s)[0]) for s in turns]
        return found

    def _turns(self, low: float, high: float) -> list[float]:
        """Arclengths between two at which x turns."""
        rate = self.spline.derivative()
        slopes = PPoly(rate.c[:, :, 0], rate.x)
        roots = slopes.roots(discontinuity=False, extrapolate=False)
        return [float(s) for s in roots if low < s < high]


def _runs(kept: Array) -> list[tuple[int, int]]:
    """The first and last points of runs of ways that are kept."""
    steps = np.diff(np.concatenate([[0], kept.astype(int), [0]]))
    first, last = (np.nonzero(steps == sign)[0].tolist() for sign in (1, -1))
    return list(zip(first, last, strict=True))


class Arc:
    """A part of a curve on which y is a function of x: a spline of both over the arclength, from
    the first to the last."""

    def __init__(self, name: str, spline: CubicSpline, first: float, last: float) -> None:
        self.name, self.spline = name, spline
        inside = spline.x[(spline.x > first) & (spline.x < last)]
        knots = np.concatenate([[first], inside, [last]])
        steps = np.arange(FINE) / FINE
        s = np.append((knots[:-1, None] + np.diff(knots)[:, None] * steps).ravel(), last)
        x, y = spline(s).T
        turned = slice(None, None, -1 if x[-1] < x[0] else 1)
        self.s, self.y = s[turned], y[turned]
        self.x = np.maximum.accumulate(x[turned])
        self.low, self.high = float(self.x[0]), float(self.x[-1])

    def at(self, x: float) -> float:
        """Return y."""
        if x <= self.low or x >= self.high:
            return float(self.y[0] if x <= self.low else self.y[-1])
        return float(self.spline(self._place(x))[1])

    def _place(self, x: float) -> float:
        """The arclength at which it passes x, or of its end that is nearest to it."""
        if x <= self.low or x >= self.high:
            return float(self.s[0] if x <= self.low else self.s[-1])
        row = int(np.searchsorted(self.x, x, side="right"))
        return self._arclength(x, float(self.s[row - 1]), float(self.s[row]))

    def _arclength(self, x: float, left: float, right: float) -> float:
        def away(s: float) -> float:
            return float(self.spline(s)[0]) - x

        if away(left) * away(right) > 0.0:  # x turns within rounding of an end
            return left if abs(away(left)) < abs(away(right)) else right
        return float(brentq(away, left, right, xtol=1e-14))

    def leaves(self) -> list[float]:
        """Return where it passes the lower or the upper side of the square."""
        found = []
        for side in (0.0, 1.0):
            rows = np.nonzero((self.y[:-1] - side) * (self.y[1:] - side) < 0.0)[0]
            for row in rows:
                ends = self.s[row], self.s[row + 1]
                s = brentq(lambda s, side=side: float(self.spline(s)[1]) - side, *ends)
                found.append(float(self.spline(s)[0]))
        return found

    def between(self, left: float, right: float, chord: float) -> Array:
        """Return points of it from one x to another, from whose chords it departs no farther.

        It departs from a chord of the length l by k l^2 / 8 where its curvature is k: the points
        are as dense as the root of k, and denser where k changes much from one to the next.
        """
        ends = [self._place(x) for x in (left, right)]
        inside = self.s[(self.s > min(ends)) & (self.s < max(ends))]
        s = np.concatenate([[ends[0]], inside, [ends[1]]])
        along, bend = self.spline(s, 1), self.spline(s, 2)
        speed = np.maximum(np.hypot(*along.T), SAME)
        across = np.abs(along[:, 0] * bend[:, 1] - along[:, 1] * bend[:, 0])
        density = np.sqrt(across / (8.0 * chord * speed))
        parts = np.maximum(density[:-1], density[1:]) * np.abs(np.diff(s))
        counted = np.concatenate([[0.0], np.cumsum(parts)])
        even = np.linspace(0.0, counted[-1], max(1, math.ceil(counted[-1])) + 1)
        s = np.interp(even, counted, s)
        s[-1] = ends[1]  # a straight line counts for nothing
        while np.any(far := self._off(s) > chord):
            s = np.insert(s, np.nonzero(far)[0] + 1, 0.5 * (s[:-1] + s[1:])[far])
        return np.asarray(self.spline(s))

    def _off(self, s: Array) -> Array:
        """How far it is from the chords between some of its points."""
        points = self.spline(s)
        chords = np.diff(points, axis=0)
        lengths = np.maximum(np.hypot(*chords.T), TIGHT)
        found = np.zeros(len(chords))
        for part in BETWEEN:
            away = self.spline(s[:-1] + part * np.diff(s)) - points[:-1]
            across = np.abs(chords[:, 0] * away[:, 1] - chords[:, 1] * away[:, 0])
            found = np.maximum(found, across / lengths)
        return found


def crossings(one: Arc, other: Arc) -> list[float]:
    """Return where two arcs cross; where they only meet at an end of both they do not."""
    low, high = max(one.low, other.low), min(one.high, other.high)
    if high - low <= SAME:
        return []
    inside = np.concatenate([one.x, other.x])
    x = np.unique([low, high, *inside[(inside > low) & (inside < high)]])
    far = np.interp(x, one.x, one.y) - np.interp(x, other.x, other.y)
    x, far = x[np.abs(far) > TIGHT], far[np.abs(far) > TIGHT]
    found = []
    for i in np.nonzero(far[:-1] * far[1:] < 0.0)[0]:
        around = (i, i + 1), (max(i - 1, 0), min(i + 2, len(x) - 1))
        roots = (_crossing(one, other, float(x[j]), float(x[k])) for j, k in around)
        found += next(filter(None, roots), [])
    return [root for root in found if min(root - low, high - root) > SAME]


def _crossing(one: Arc, other: Arc, left: float, right: float) -> list[float]:
    """Where two arcs cross between two places at which their order is not the same."""

    def apart(x: float) -> float:
        return one.at(x) - other.at(x)

    ends = apart(left), apart(right)
    if min(map(abs, ends)) < TIGHT or ends[0] * ends[1] > 0.0:
        return []
    return [float(brentq(apart, left, right, xtol=1e-13))]


@dataclass(frozen=True)
class Bound:
    """A line across a slab: arcs that lie one on another, or a side of the square."""

    names: tuple[str, ...] = ()
    """Names of the curves; none for a side."""
    arcs: tuple[Arc, ...] = ()
    side: float = 0.0
    """Its height if it is a side."""

    def at(self, x: float) -> float:
        """Return its height."""
        return min(max(self.arcs[0].at(x), 0.0), 1.0) if self.arcs else self.side


@dataclass(frozen=True)
class Slab:
    """The square between two values of x, and what goes across it, from below.

    `ends` are the heights of the bounds on the left and on the right, which never fall.
    """

    left: float
    right: float
    bounds: tuple[Bound, ...]

    @property
    def cells(self) -> range:
        """The numbers of its cells, from below."""
        return range(len(self.bounds) - 1)

    def x(self, part: float) -> float:
        """Return the value of x a part of the way across."""
        return self.left + part * (self.right - self.left)

    def heights(self, x: float) -> Array:
        """Return the heights of the bounds."""
        return np.maximum.accumulate([bound.at(x) for bound in self.bounds])

    def middle(self, cell: int, part: float) -> tuple[float, float]:
        """Return the middle of a cell, a part of the way across."""
        x = self.x(part)
        low, high = self.heights(x)[cell : cell + 2].tolist()
        return x, 0.5 * (low + high)

    def cell(self, x: float, y: float) -> int:
        """Return the number of the cell that holds a point."""
        row = int(np.searchsorted(self.heights(x), y, side="right")) - 1
        return min(max(row, 0), len(self.bounds) - 2)


def slabs(paths: Sequence[Path]) -> list[Slab]:
    """Cut the unit square into slabs in which the order of the curves does not change.

    Curves shorter than `SAME` are none.
    """
    paths = [path for path in paths if np.ptp(path.arclengths) > SAME]
    arcs = [arc for path in paths for arc in path.arcs()]
    edges = [x for path in paths for x in path.edges()]
    edges += [x for arc in arcs for x in arc.leaves()]
    edges += [x for pair in itertools.combinations(arcs, 2) for x in crossings(*pair)]
    found = _cut_slabs(arcs, edges)
    for _ in range(MOST_ROUNDS):
        more = [x for slab in found for x in _hidden_crossings(slab)]
        if not more:
            break
        edges += more
        found = _cut_slabs(arcs, edges)
    return found


def _cut_slabs(arcs: Sequence[Arc], edges: Sequence[float]) -> list[Slab]:
    inside = (x for x in edges if 0.0 < x < 1.0 - SAME)
    cuts = [*unique_values([0.0, *inside], SAME), 1.0]
    return [_slab(arcs, *pair) for pair in itertools.pairwise(cuts)]


def _slab(arcs: Sequence[Arc], left: float, right: float) -> Slab:
    middle = 0.5 * (left + right)
    across = [arc for arc in arcs if arc.low < middle < arc.high]
    ordered = sorted(((arc.at(middle), arc) for arc in across), key=lambda pair: pair[0])
    inside = [pair for pair in ordered if SAME < pair[0] < 1.0 - SAME]
    groups: list[list[tuple[float, Arc]]] = []
    for height, arc in inside:
        if groups and height - groups[-1][-1][0] <= SAME:
            groups[-1].append((height, arc))
        else:
            groups.append([(height, arc)])
    bounds = [_bound([arc for _, arc in group]) for group in groups]
    return Slab(left, right, (Bound(), *bounds, Bound(side=1.0)))


def _bound(arcs: Sequence[Arc]) -> Bound:
    return Bound(tuple(dict.fromkeys(arc.name for arc in arcs)), tuple(arcs))


def _hidden_crossings(slab: Slab) -> Iterator[float]:
    """Where neighbouring bounds of a slab cross after all: their order at an edge shows it."""
    middle = slab.x(0.5)
    for lower, upper in itertools.pairwise(slab.bounds[1:-1]):
        one, other = lower.arcs[0], upper.arcs[0]
        for edge in (slab.left, slab.right):
            if one.at(edge) - other.at(edge) > SAME:
                yield from _crossing(one, other, *sorted((edge, middle)))


# The rectangle of a map of two parameters, and the unit square that stands for it.


def bounding_curves(scene: Scene, curves: Sequence[Curve]) -> list[Curve]:
    """Return the curves of a scene's own words: its orbits end on no others."""

    def own(curve: Curve) -> bool:
        of_period = (word for word in scene.orbits if word.period == curve.period)
        return any(is_rotation(word.walls, curve.word) for word in of_period)

    return list(filter(own, curves))


@dataclass(frozen=True)
class Frame:
    """The rectangle: the second parameter across, and along the first one or its derived one."""

    across: str
    along: str
    left: float
    right: float
    lower: float
    upper: float
    """`lower`, `upper`: of the parameter along."""
    power: float
    factor: float
    """`power`, `factor`: that is ``factor * first**power``; power is 1 or -1."""

    @classmethod
    def of(cls, scene: Scene, curves: Sequence[Curve]) -> Frame:
        """Return the frame of a scene's curves."""
        assert scene.curves is not None
        first, power, factor = scene.parameter, 1.0, 1.0
        along = falling_column(curves) if curves else first
        if along != first:
            ones, others = (np.concatenate([c[n] for c in curves]) for n in (first, along))
            power = 1.0 if np.ptp(others / ones) <= np.ptp(others * ones) else -1.0
            factor = float(np.median(others * ones**-power))
        low, high = sorted(factor * value**power for value in scene.range)
        left, right = scene.curves.range
        return cls(scene.curves.parameter, along, left, right, low, high, power, factor)

    def height(self, value: float) -> float:
        """Return where a value of the first parameter lies in the unit square."""
        return (self.factor * value**self.power - self.lower) / (self.upper - self.lower)

    def first(self, height: float) -> float:
        """Return the value of the first parameter at a height."""
        return float((self.at(0.0, height)[1] / self.factor) ** self.power)

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Return the parameters at a point of the unit square."""
        wide, high = self.right - self.left, self.upper - self.lower
        return self.left + x * wide, self.lower + y * high

    def path(self, curve: Curve) -> Path:
        """Return a curve in the unit square."""
        x = (curve[self.across] - self.left) / (self.right - self.left)
        y = (curve[self.along] - self.lower) / (self.upper - self.lower)
        event = curve["event"].astype(str)
        plain, points = event == "", np.column_stack([x, y])
        marked = ~plain & (event != REQUESTED)
        return Path(curve.id, points, curve["arclength"], plain, marked, ~ghost_mask(curve))
