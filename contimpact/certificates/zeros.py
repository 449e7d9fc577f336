"""Zeros of test functions and touches along tubes.

The function is a polynomial in u with enclosed coefficients. A cell of u is free of zeros if the
enclosure on it is; it holds exactly one if the function is strictly monotone on it and has
different signs at its ends. Other cells are cut.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from flint import arb, arb_mat, arb_series

from ..bifurcations.equations import Flight, cyclic_matrix
from .birth import Birth
from .orbit import CUT, Coordinate, characteristic, coordinates_of, open_cells
from .tube import Model, Segment, Tube, coefficient, shift_polynomial

# Test functions along a tube: functions of the flights that vanish at folds and period doublings.
#
# With two multipliers they are the polynomial :math:`b\mu^2 - c\mu + a` at 1 and -1, with the
# product of impact speeds as a factor, so without poles. With more, the cyclic matrix C(mu) is
# singular: its determinant is the test function, in orthogonal coordinates U and V in which it is
# diagonal in the middle of the tube, its smallest singular value last. Elimination gives it as a
# product of pivots, and divides by none but the last one; where another one may be zero, it is
# expanded by minors, without a division.

Test: TypeAlias = Callable[[list[Flight]], Any]


MULTIPLIERS = (1.0, -1.0)
"""Multipliers that pass the unit circle alone, at events of which a tube is searched."""


def test_at(segment: Segment, mu: float) -> Test:
    """Return the test function of a multiplier, the same function for all of a segment."""
    if not segment.space.problem.paired:
        return _Determinant(segment, mu)

    def polynomial(flights: list[Flight]) -> Any:
        b, c, a = characteristic(flights)
        return b * mu * mu - c * mu + a

    return polynomial


LARGEST = 8
"""Rows of matrices that are expanded by minors: it takes n 2^(n - 1) products."""

ELSEWHERE = (0.5, -0.5)
"""Points at which the multipliers' polynomial is also evaluated: it is zero everywhere where
flights vanish, and that is no event."""


def is_regular(segment: Segment, flights: list[Flight]) -> bool:
    """Return whether the multipliers' polynomial is proven not to be zero everywhere."""
    return any(not test_at(segment, mu)(flights).contains(0) for mu in ELSEWHERE)


class _Determinant:
    """The determinant of C(mu), in coordinates in which it is diagonal in the middle."""

    def __init__(self, segment: Segment, mu: float) -> None:
        problem = segment.space.problem
        self.n, self.mu = problem.n, mu
        here = problem.evaluate(segment.doubles(0.0))
        left, _, right = np.linalg.svd(here.cyclic(mu)[:, : self.n])
        self.left, self.right = arb_mat(left.T.tolist()), arb_mat(right.T.tolist())
        if any(matrix.det().contains(0) for matrix in (self.left, self.right)):
            raise ArithmeticError("the cyclic matrix has no singular vectors")

    def __call__(self, flights: list[Flight]) -> Any:
        rows = self._turned(cyclic_matrix(flights, self.mu, arb(0)))
        found = _determinant_by_pivots([list(row) for row in rows])
        if found is None and self.n > LARGEST:
            raise ArithmeticError("a pivot of the cyclic matrix may be zero")
        return _determinant_by_minors(rows) if found is None else found

    def _turned(self, rows: list[list[Any]]) -> list[list[Any]]:
        """U^T C V, of numbers or of power series."""
        length = max((x.prec for row in rows for x in row if isinstance(x, arb_series)), default=1)
        parts = [
            (self.left * arb_mat([[coefficient(x, j) for x in row] for row in rows]) * self.right)
            for j in range(length)
        ]
        tables = [part.tolist() for part in parts]
        if length == 1:
            return [list(row) for row in tables[0]]
        size = range(self.n)
        return [
            [arb_series([table[i][j] for table in tables], prec=length) for j in size] for i in size
        ]


def _determinant_by_pivots(rows: list[list[Any]]) -> Any:
    """A determinant as the product of its pivots; None if one but the last may be zero."""
    total: Any = arb(1)
    for i, row in enumerate(rows[:-1]):
        if coefficient(row[i], 0).contains(0):
            return None
        total = total * row[i]
        for later in rows[i + 1 :]:
            factor = later[i] / row[i]
            for j in range(i + 1, len(rows)):
                later[j] = later[j] - factor * row[j]
    return total * rows[-1][-1]


def _determinant_by_minors(rows: list[list[Any]]) -> Any:
    """A determinant from the minors of its first rows, by the columns that these take."""
    size, minors = len(rows), {0: arb(1)}
    for row in rows:
        found: dict[int, Any] = {}
        for taken, minor in minors.items():
            for j in (j for j in range(size) if not taken >> j & 1):
                sign = (-1) ** (taken >> j).bit_count()
                more, columns = sign * row[j] * minor, taken | 1 << j
                found[columns] = found[columns] + more if columns in found else more
        minors = found
    return minors[2**size - 1]


# Touches along a tube: where a flight reaches a wall with zero velocity, between its impacts.
#
# A flight is run through by s from 0 to 1, the branch by u. A cell of both is free of touches if on
# it the velocity does not vanish, or no gap does. At the ends of a flight the gap to the wall left,
# or reached, vanishes by itself. There a cell is free of touches of that wall, too, if the
# curvature
# of the gap has one sign: a touch would make the gap vanish twice, at the cell's end and at the
# touch, so that its rate vanishes between them and at the touch, and its curvature between these.
#
# Only where the gap bends away from the wall, in a minimum, a touch is a grazing; and only if the
# flight does not pass the wall elsewhere.
#
# A cell holds one touch at most if no matrix of the enclosed derivatives of gap and velocity by s
# and u is singular on it.

DEEPEST_TOUCH = 44
"""How often a flight and a tube are cut."""
PARTS = list(pairwise(k / 3.0 for k in range(4)))
"""Parts of a flight that are looked at first."""
SELDOM = 6
"""Number of cuts after which a cell is compared with the rest of the flight."""
SIZES = [2.0**-k for k in range(12)]
"""Half widths of cells around a touch that is known."""


Range: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class Patch:
    """A cell of a flight and a tube that may hold a touch of a wall."""

    flight: int
    wall: str
    along: tuple[float, float]
    at: tuple[float, float]
    """`along`, `at`: ranges of u, and of s."""
    single: bool
    """Whether it holds one touch at most."""

    def holds(self, wall: str, along: tuple[float, float], at: tuple[float, float]) -> bool:
        """Whether a cell is part of this one."""
        return (
            wall == self.wall
            and self.along[0] <= along[0]
            and along[1] <= self.along[1]
            and self.at[0] <= at[0]
            and at[1] <= self.at[1]
        )


@dataclass(frozen=True)
class _CellEnclosure:
    """What is enclosed on a cell: for each wall the gap, and whether a touch is free; the rates."""

    gap: dict[str, Any]
    gap_along: dict[str, Any]
    speed: Any
    speed_along: Any
    bend: Any
    duration: Any


def flights_along(tube: Tube | Birth, flight: int) -> list[FlightCoordinate]:
    """Return a flight along a tube, once for each of its gap coordinates."""
    found = coordinates_of(tube.segment.space, flight)
    return [FlightCoordinate(tube, flight, coordinate) for coordinate in found]


class FlightCoordinate:
    """One gap coordinate of a flight along a tube."""

    def __init__(self, tube: Tube | Birth, flight: int, coordinate: Coordinate) -> None:
        self.tube, self.flight, self.coordinate = tube, flight, coordinate
        self.space = tube.segment.space
        self.met = {one.guard.name: one for one in coordinate.met}
        self.sides = {name: one.guard.side for name, one in self.met.items()}

    def local(self, s: Any, along: Range, rates: bool = True) -> _CellEnclosure:
        """Return what is enclosed for a ball of s and a range of u; without rates along u they are
        zero."""
        rows, values, places = _orbit_along(self.tube, along, rates)
        start = rows[self.flight]
        duration = rows[self.flight + 1][0] - start[0]
        x, speed, bend = self.coordinate.motion(start, s * duration, values)
        gaps = {
            name: one.guard.side * (self.coordinate.distance(one, places) - x)
            for name, one in self.met.items()
        }
        return _CellEnclosure(
            {name: coefficient(g, 0) for name, g in gaps.items()},
            {name: coefficient(g, 1) for name, g in gaps.items()},
            coefficient(speed, 0),
            coefficient(speed, 1),
            coefficient(bend, 0),
            coefficient(duration, 0),
        )

    def patches(self, known: Sequence[tuple[str, float, float]]) -> Iterator[Patch]:
        """Yield the cells that may hold touches. Around each touch that is known, by (wall, u, s),
        a cell is taken first, as large as it can be and hold no other."""
        along = (-1.0, 1.0)
        start, end = _orbit_along(self.tube, along, True)[0][self.flight : self.flight + 2]
        lasts = coefficient(end[0] - start[0], 0) > 0  # a flight of no duration has no parts
        cells = [(along, part, 0) for part in (PARTS if lasts else [(0.0, 1.0)])]
        taken = [patch for one in known if (patch := self._around(*one)) is not None]
        yield from taken
        while cells:
            along, at, depth = cells.pop()
            if edged := _cut_at_edges(along, at, taken):
                cells += [(*part, depth) for part in edged]
                continue
            s, u = _ball(at), _ball(along)
            wide = self.local(s, along)
            if not wide.speed.contains(0):
                continue
            middle = 0.5 * (along[0] + along[1])
            mid = self.local(s.mid(), (middle, middle), rates=False)
            ds, du = s - s.mid(), u - middle
            by_s, by_u = wide.bend * wide.duration * ds, wide.speed_along * du
            if not (mid.speed + by_s + by_u).contains(0):
                continue
            ds = _where_it_stops(mid.speed + by_u, wide.bend * wide.duration, ds)
            left = [
                name
                for name in self.met
                if not any(patch.holds(name, along, at) for patch in taken)
                and self._touches(name, wide, mid, at, ds, du)
            ]
            if depth % SELDOM == SELDOM - 1:
                left = [name for name in left if not self.passes(name, along)]
            if not left:
                continue
            alone = all(self._single(name, wide) for name in left)
            if depth == DEEPEST_TOUCH or (alone and depth > DEEPEST_TOUCH // 2):
                yield from (Patch(self.flight, name, along, at, alone) for name in left)
            else:
                cells += self._cut(along, at, depth, by_s, by_u)

    def _around(self, wall: str, u: float, s: float) -> Patch | None:
        """The largest of some cells around a touch that holds no other."""
        for size in SIZES:
            along = max(u - size, -1.0), min(u + size, 1.0)
            at = max(s - size / 4.0, 0.0), min(s + size / 4.0, 1.0)
            if self._single(wall, self.local(_ball(at), along)):
                return Patch(self.flight, wall, along, at, True)
        return None

    def _touches(
        self, wall: str, wide: _CellEnclosure, mid: _CellEnclosure, at: Any, ds: Any, du: Any
    ) -> bool:
        """Whether a cell may hold a grazing of a wall."""
        side = self.sides[wall]
        bend = -side * wide.bend
        if bend < 0:
            return False
        met = self.met[wall]
        first, last = met.left and at[0] == 0.0, met.reached and at[1] == 1.0
        if (first or last) and bend > 0:
            return False
        slope = (mid.speed + wide.bend * mid.duration * ds / 2) * mid.duration
        gap = mid.gap[wall] - side * slope * ds + wide.gap_along[wall] * du
        return bool(gap.contains(0) and wide.gap[wall].contains(0))

    def _single(self, wall: str, wide: _CellEnclosure) -> bool:
        """Whether no matrix of the derivatives of gap and velocity is singular."""
        side = self.sides[wall]
        first = -side * wide.speed * wide.duration * wide.speed_along
        second = wide.gap_along[wall] * wide.bend * wide.duration
        return not (first - second).contains(0)

    @staticmethod
    def _cut(along: Any, at: Any, depth: int, by_s: Any, by_u: Any) -> list[Any]:
        """Two cells in place of one, cut where the velocity varies more."""
        across_s, across_u = (float(abs(change).upper()) for change in (by_s, by_u))
        if across_s >= across_u:
            middle = at[0] + CUT * (at[1] - at[0])
            return [(along, (at[0], middle), depth + 1), (along, (middle, at[1]), depth + 1)]
        middle = along[0] + CUT * (along[1] - along[0])
        return [((along[0], middle), at, depth + 1), ((middle, along[1]), at, depth + 1)]

    def passes(self, wall: str, along: tuple[float, float]) -> bool:
        """Whether the flight is proven to pass a wall in a whole range of u.

        What a flight does beyond a wall before it comes back from an impact that runs the wrong way
        belongs to that impact; between such ends the gap has to be positive before and behind.
        """
        u = _ball(along)
        z = np.array([float(x.mid()) for x in self.tube.state(u.mid())])
        here = self.space.problem.evaluate(z).gaps[self.flight]
        touch = here.touches[self.met[wall].number]
        if touch is None or not touch.gap < 0.0 or not here.duration > 0.0:
            return False
        start = z[self.space.problem.m * self.flight]
        at = (touch.time - start) / here.duration
        return 0.0 < at < 1.0 and bool(self._mean(wall, at, along) < 0)

    def _mean(self, wall: str, s: float, along: Range) -> Any:
        """The gap at s, for a range of u."""
        middle = 0.5 * (along[0] + along[1])
        mid = self.local(arb(s), (middle, middle), rates=False)
        return mid.gap[wall] + self.local(arb(s), along).gap_along[wall] * (_ball(along) - middle)


@functools.lru_cache(maxsize=256)
def _orbit_along(tube: Tube | Birth, along: Range, rates: bool) -> tuple[Any, Any, Any]:
    """The impacts on a range of u, the parameter values and the places of the walls: the same for
    all cells of it, on all flights."""
    u, space = _ball(along), tube.segment.space
    z = tube.moving(u) if rates else tube.state(u)
    values = space.values(z)
    return space.impacts(z), values, space.setup(values).walls


def _where_it_stops(speed: Any, bend: Any, ds: Any) -> Any:
    """A ball around the part of a cell in which a velocity vanishes, from its values in the middle
    and its rate: a step of Newton's method on intervals (Neumaier 1990, ch. 5)."""
    if bend.contains(0):
        return ds
    near = -speed / bend
    return ds.intersection(near) if ds.overlaps(near) else near


def _cut_at_edges(
    along: Range, at: Range, taken: Sequence[Patch]
) -> list[tuple[Range, Range]] | None:
    """Two cells in place of one that is partly in a patch; None if there is none of these."""
    for patch in taken:
        if not (_overlap(along, patch.along) and _overlap(at, patch.at)):
            continue
        for edge in patch.along:
            if along[0] < edge < along[1]:
                return [((along[0], edge), at), ((edge, along[1]), at)]
        for edge in patch.at:
            if at[0] < edge < at[1]:
                return [(along, (at[0], edge)), (along, (edge, at[1]))]
    return None


def _overlap(one: Range, other: Range) -> bool:
    return max(one[0], other[0]) < min(one[1], other[1])


def _ball(ends: Range) -> Any:
    return arb(ends[0]).union(arb(ends[1]))


DEEPEST = 10
"""How often a tube is cut."""
NARROW = 1e-6
"""Width of the part of a tube in which a zero is looked at."""


@dataclass(frozen=True)
class Cell:
    """A part of a tube; `what` is ``zero`` with exactly one, or ``open`` if that is not known."""

    left: float
    right: float
    what: str


def zeros(tube: Tube, name: str, function: Test) -> list[Cell]:
    """Return the cells of a tube that hold a zero of a function of the flights, or may."""
    model = tube.model(name, function)
    rates = [j * c for j, c in enumerate(model)][1:]
    found: list[Cell] = []

    def judge(left: float, right: float) -> bool:
        if not range_on_cell(model, left, right).contains(0):
            return True
        slope = range_on_cell(rates, left, right)
        ends = [range_on_cell(model, u, u) for u in (left, right)]
        if slope.contains(0) or any(end.contains(0) for end in ends):
            return False
        if (slope + derivative_across(tube, function, _ball((left, right)))).contains(0):
            return False
        if (ends[0] > 0) != (ends[1] > 0):
            found.append(Cell(left, right, "zero"))
        return True

    merged = _merge_cells(open_cells((-1.0, 1.0), judge, DEEPEST))
    left_open = [Cell(*cell, "open") for cell in merged if not judge(*cell)]
    return sorted([*found, *left_open], key=lambda cell: cell.left)


def narrow_cell(tube: Tube, name: str, function: Test, cell: Cell) -> tuple[float, float]:
    """Return a part of a cell that holds its only zero, as small as enclosures tell."""
    model, left, right = tube.model(name, function), cell.left, cell.right
    rising = bool(range_on_cell(model, right, right) > 0)
    while right - left > NARROW:
        middle = left + CUT * (right - left)
        value = range_on_cell(model, middle, middle)
        if value.contains(0):
            return left, right
        if (value > 0) == rising:
            right = middle
        else:
            left = middle
    return left, right


def range_on_cell(model: Model, left: float, right: float) -> Any:
    """Return the range of a polynomial on a cell, an outer enclosure."""
    half = (arb(right) - arb(left)) / 2
    first, *others = shift_polynomial(model, arb(left) + half)
    spread, power = arb(0), arb(1)
    for c in others:
        power *= half
        spread += abs(c) * power
    return first + arb(0, 1) * spread


def derivative_across(tube: Tube, function: Test, u: Any) -> Any:
    """Return the function's derivative along w'(u), for all u of a ball."""
    pairs = zip(tube.state(u), tube.rates, strict=True)
    moving = [arb_series([x, r], prec=2) for x, r in pairs]
    return coefficient(function(tube.segment.space.flights(moving)), 1)


def _merge_cells(cells: Iterable[Range]) -> list[Range]:
    """Cells that touch each other as one: a zero may lie on their common edge."""
    found: list[Range] = []
    for left, right in sorted(cells):
        if found and found[-1][1] == left:
            left, _ = found.pop()
        found.append((left, right))
    return found
