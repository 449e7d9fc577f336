"""Cells of the same content joined to areas, and the polygons around these.

An area's polygons are those of GeoJSON: a ring of points around it, the last one the first,
counter-clockwise, and one around each of its holes, clockwise. Every edge of a ring is a part of a
curve, of a side of the square, or of a vertical line where what happens below changes.
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Array
from .arrangement import SAME, Slab

CHORD = 9e-7
"""How far the sides of polygons may depart from the splines of their curves, as part of the
square's side: with what these depart from the curves, 1e-6."""

Cell = tuple[int, int]
"""A cell by the numbers of its slab and of itself, from below."""
Node = tuple[int, int]
"""A corner by the number of its vertical line and its own, from below."""
LINE, SIDE = "line", "side"


@dataclass(frozen=True)
class Edge:
    """A part of an area's border, run through with the area on the left."""

    first: Node
    last: Node
    name: str
    points: Array


@dataclass(frozen=True)
class Outline:
    """A joined area.

    Attributes
    ----------
    cells : list of (slab, cell)
    rings : list of ndarray of shape (P, 2)
        The outer ring first.
    borders : list of lists of (int, str)
        For each ring where on it a part of the border begins, and what it is: curves' names,
        ``line`` or ``side``.
    """

    cells: list[Cell]
    rings: list[Array]
    borders: list[list[tuple[int, str]]]

    @property
    def part(self) -> float:
        """Its size as a part of the square."""
        return sum(map(_area, self.rings))


def outlines(slabs: Sequence[Slab], contents: Sequence[Sequence[Hashable]]) -> list[Outline]:
    """Join neighbouring cells of the same content and trace their borders.

    Parameters
    ----------
    slabs : sequence of Slab
    contents : sequence of sequence
        For each slab what its cells hold, from below.

    Returns
    -------
    list of Outline
        From left to right.
    """
    return _Tracer(slabs, contents).outlines()


class _Tracer:
    def __init__(self, slabs: Sequence[Slab], contents: Sequence[Sequence[Hashable]]) -> None:
        self.slabs, self.contents = slabs, contents
        self.heights = [(slab.heights(slab.left), slab.heights(slab.right)) for slab in slabs]
        self.nodes = [self._nodes_at(k) for k in range(len(slabs) + 1)]
        self.xs = [*(slab.left for slab in slabs), slabs[-1].right]

    def _nodes_at(self, line: int) -> Array:
        """The heights of the corners on a vertical line, each once."""
        ends = [self.heights[line - 1][1]] if line else []
        ends += [self.heights[line][0]] if line < len(self.slabs) else []
        heights = np.sort(np.concatenate(ends))
        return heights[np.concatenate([[True], np.diff(heights) > SAME])]

    def node(self, slab: int, bound: int, side: int) -> Node:
        """The corner at an end of a bound: the last one that is not above it."""
        line = slab + side
        height = self.heights[slab][side][bound]
        return line, int(np.searchsorted(self.nodes[line], height, side="right")) - 1

    def outlines(self) -> list[Outline]:
        groups = self._groups()
        owner = {cell: number for number, cells in enumerate(groups) for cell in cells}
        return [self._outline(cells, number, owner) for number, cells in enumerate(groups)]

    def _groups(self) -> list[list[Cell]]:
        """The cells that are joined."""
        cells = [(k, j) for k, slab in enumerate(self.slabs) for j in slab.cells]
        parent = {cell: cell for cell in cells}

        def root(cell: Cell) -> Cell:
            while parent[cell] != cell:
                cell = parent[cell]
            return cell

        for one, other in self._neighbours():
            if self._content(one) == self._content(other):
                parent[root(one)] = root(other)
        groups: dict[Cell, list[Cell]] = defaultdict(list)
        for cell in cells:
            groups[root(cell)].append(cell)
        return list(groups.values())

    def _content(self, cell: Cell) -> Hashable:
        return self.contents[cell[0]][cell[1]]

    def _neighbours(self) -> list[tuple[Cell, Cell]]:
        found = [((k, j), (k, j + 1)) for k, s in enumerate(self.slabs) for j in s.cells[:-1]]
        for k in range(len(self.slabs) - 1):
            for i, j in itertools.product(self.slabs[k].cells, self.slabs[k + 1].cells):
                if set(self._side(k, i, 1)) & set(self._side(k + 1, j, 0)):
                    found.append(((k, i), (k + 1, j)))
        return found

    def _side(self, slab: int, cell: int, side: int) -> range:
        """The numbers of the pieces of a vertical line beside a cell."""
        (_, low), (_, high) = self.node(slab, cell, side), self.node(slab, cell + 1, side)
        return range(low, high)

    # Borders.

    def _outline(self, cells: list[Cell], number: int, owner: dict[Cell, int]) -> Outline:
        edges = [edge for cell in cells for edge in self._edges(cell, number, owner)]
        rings = sorted((_joined(ring) for ring in _rings(edges)), key=lambda r: -_area(r[0]))
        return Outline(cells, [points for points, _ in rings], [names for _, names in rings])

    def _edges(self, cell: Cell, number: int, owner: dict[Cell, int]) -> list[Edge]:
        """A cell's edges with another area, or nothing, beyond, counter-clockwise."""
        k, j = cell
        found = []
        if owner.get((k, j - 1)) != number:
            found.append(self._across(k, j))
        found += self._upright(k, j, 1, number, owner)
        if owner.get((k, j + 1)) != number:
            found.append(_turned(self._across(k, j + 1)))
        found += [_turned(edge) for edge in self._upright(k, j, 0, number, owner)]
        return [edge for edge in found if edge.first != edge.last]

    def _across(self, slab: int, bound: int) -> Edge:
        here, line = self.slabs[slab], self.slabs[slab].bounds[bound]
        ends = self.node(slab, bound, 0), self.node(slab, bound, 1)
        corners = np.array([self._place(node) for node in ends])
        if not line.arcs:
            return Edge(*ends, SIDE, corners)
        points = line.arcs[0].between(here.left, here.right, CHORD)
        points[[0, -1]] = corners
        return Edge(*ends, " ".join(line.names), points)

    def _upright(
        self, slab: int, cell: int, side: int, number: int, owner: dict[Cell, int]
    ) -> list[Edge]:
        """The pieces of a cell's side that lie between areas, upwards."""
        line = slab + side
        beyond = slab + (1 if side else -1)
        name = SIDE if line in (0, len(self.slabs)) else LINE
        found = []
        for piece in self._side(slab, cell, side):
            ends = (line, piece), (line, piece + 1)
            if name == SIDE or owner[beyond, self._beside(beyond, 1 - side, piece)] != number:
                found.append(Edge(*ends, name, np.array([self._place(node) for node in ends])))
        return found

    def _beside(self, slab: int, side: int, piece: int) -> int:
        """The cell of a slab beside a piece of its vertical line."""
        cells = self.slabs[slab].cells
        return next(j for j in cells if piece in self._side(slab, j, side))

    def _place(self, node: Node) -> tuple[float, float]:
        line, number = node
        return self.xs[line], float(self.nodes[line][number])


def _turned(edge: Edge) -> Edge:
    return Edge(edge.last, edge.first, edge.name, edge.points[::-1])


def _rings(edges: Sequence[Edge]) -> list[list[Edge]]:
    """The edges in closed rings; where several leave a corner, the one most to the left."""
    leaving: dict[Node, list[Edge]] = defaultdict(list)
    for edge in edges:
        leaving[edge.first].append(edge)
    rings = []
    for first in edges:
        if first not in leaving[first.first]:
            continue
        ring = [first]
        leaving[first.first].remove(first)
        while ring[-1].last != first.first:
            onward = leaving[ring[-1].last]
            chosen = onward[int(np.argmax([_turn(ring[-1], edge) for edge in onward]))]
            onward.remove(chosen)
            ring.append(chosen)
        rings.append(ring)
    return rings


def _turn(one: Edge, other: Edge) -> float:
    """The angle to the left from an edge to the next one."""
    (a, b), (c, d) = one.points[-1] - one.points[-2], other.points[1] - other.points[0]
    angle = math.atan2(a * d - b * c, a * c + b * d)
    return angle if angle < math.pi - 1e-9 else -angle


def _joined(ring: Sequence[Edge]) -> tuple[Array, list[tuple[int, str]]]:
    """The points of a ring, closed, and where its borders begin; pieces of one line are joined."""
    points: list[Array] = []
    names: list[tuple[int, str]] = []
    turned = next((k for k in range(len(ring)) if ring[k - 1].name != ring[k].name), 0)
    for edge in (*ring[turned:], *ring[:turned]):
        if not names or names[-1][1] != edge.name:
            names.append((len(points), edge.name))
        elif _straight(points[-1], edge):
            continue
        points += list(edge.points[:-1])
    return np.vstack([*points, points[0]]), names


def _straight(before: Array, edge: Edge) -> bool:
    """Whether an edge goes straight on along a side or an upright line."""
    if edge.name not in (LINE, SIDE):
        return False
    return bool(np.ptp([before, *edge.points], axis=0).min() == 0.0)


def _area(ring: Array) -> float:
    x, y = ring.T
    return 0.5 * float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))
