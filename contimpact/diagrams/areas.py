"""Areas between curves: their outlines, and the mechanisms that hold in them.

The curves that are no ghosts cut the rectangle into cells (`arrangement`). Everywhere in a cell the
same orbits are stable, and meet the same curve first: one run along a vertical line through a slab
says what, further ones check it. Cells that say the same are one area.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import defaultdict
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import Array
from ..bifurcations.doubling import PD
from ..bifurcations.grazing import G
from ..bifurcations.kind import test_functions
from ..continuation.branch import EndKind
from ..continuation.walk import reraise_interruption
from ..errors import count_text
from ..models.guards import Word
from ..models.model import Model
from ..orbits.orbit import Orbit
from ..orbits.quiet import problem_of
from ..progress import Progress
from ..results.branch import Branch, Entry
from ..results.curve import Area, Curve, Doubt, Ring, StableOrbit, fixed_text, text_of_orbits
from ..results.diagram import Diagram
from ..results.diagram_reading import read, stable_intervals
from ..results.scene import Scene
from ..segments.kernels import Kernels
from .arrangement import SAME, Frame, Slab, bounding_curves, slabs
from .map_lines import run_along
from .orbit_branch import continue_born

# How a stable orbit gives way to one with one impact more: the mechanism of the transition.
#
# What is born at the end of the orbit, and at its grazing, is followed, and read as a diagram is.

DEPTH = 2
"""How many period doublings one after another are followed."""


def mechanisms(branch: Branch, end: Entry, scene: Scene, model: Model) -> list[int]:
    """Return the mechanisms, 1 to 4 as in `results.diagram_reading`, by which the orbit of a branch
    gives way at the entry where it loses its stability or grazes; none where nothing is decided.
    The scene gives range, events and settings."""
    grazings = _grazings(branch, end)
    if not grazings:
        return []
    family = _Family(scene, model)
    own = family.named(branch, "b")
    born = [family.born(entry, f"g{k}") for k, entry in enumerate(grazings)]
    opened = {e.id: new.id for e, new in zip(grazings, born, strict=True) if new is not None}
    doubled = family.doubled(end, "d", DEPTH) if end.kind == PD.name else []
    opened |= {end.id: doubled[0].id} if doubled else {}
    opens = {event: (name,) for event, name in opened.items()}
    events = [dataclasses.replace(e, opens=opens.get(e.id, ())) for e in branch.events]
    own = family.named(dataclasses.replace(branch, events=events), "b")
    found = read(Diagram("", [own, *(new for new in born if new is not None), *doubled]))
    ends = f"b-{end.id}"
    shown = {t.mechanism for t in found.transitions if ends in (t.entry, t.doubling)}
    return sorted(m for m in shown if m is not None)


def _grazings(branch: Branch, end: Entry) -> list[Entry]:
    """The end if it is a grazing; of a doubling the next grazing of the orbit that has doubled."""
    if end.kind == G.name:
        return [end]
    if end.kind != PD.name:
        return []
    found = [e for e in branch.events if e.kind == G.name and e.physical and e.order == 1]
    return sorted(found, key=lambda e: abs(e.arclength - end.arclength))[:1]


@dataclasses.dataclass(frozen=True)
class _Family:
    """The branches born on one, their entries called so that no two have one name."""

    scene: Scene
    model: Model

    def born(self, entry: Entry, name: str) -> Branch | None:
        """The branch born at an entry."""
        scene = self.scene
        new = continue_born(
            entry, self.model, scene.range, events=scene.events, settings=scene.settings, name=name
        )
        if new is None:
            return None
        reraise_interruption(new.ends)
        return self.named(new, name)

    def doubled(self, entry: Entry, name: str, depth: int) -> list[Branch]:
        """The branch born at a period doubling, and those born on it in turn."""
        new = self.born(entry, name)
        if new is None:
            return []
        further = [e for e in new.events if e.kind == PD.name and not e.ghost] if depth > 1 else []
        later = [self.doubled(e, f"{name}{k}", depth - 1) for k, e in enumerate(further)]
        return [new, *(branch for some in later for branch in some)]

    @staticmethod
    def named(branch: Branch, name: str) -> Branch:
        """A branch and its entries under a name of their own."""
        events = [dataclasses.replace(e, id=f"{name}-{e.id}", branch=name) for e in branch.events]
        column = branch["event"].copy()
        column[column != ""] = [f"{name}-{event}" for event in column[column != ""]]
        columns = {**branch.columns, "event": column}
        return dataclasses.replace(branch, id=name, events=events, columns=columns)


# Cells of the same content joined to areas, and the polygons around these.
#
# An area's polygons are those of GeoJSON: a ring of points around it, the last one the first,
# counter-clockwise, and one around each of its holes, clockwise. Every edge of a ring is a part of
# a curve, of a side of the square, or of a vertical line where what happens below changes.

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

    @property
    def reversed(self) -> Edge:
        """The same from its last corner on."""
        return Edge(self.last, self.first, self.name, self.points[::-1])


@dataclass(frozen=True)
class Outline:
    """A joined area."""

    cells: list[Cell]
    rings: list[Array]
    """The outer ring first, shape (P, 2)."""
    borders: list[list[tuple[int, str]]]
    """Place on each ring at which a part of the border begins, and what it is: curves' names,
    ``line`` or ``side``."""

    @property
    def part(self) -> float:
        """Its size as a part of the square."""
        return sum(map(_area, self.rings))


class Tracer:
    """Joins neighbouring cells of the same content, given for each slab from below, and traces
    their borders."""

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
        """Return the outlines from left to right."""
        groups = self._groups()
        owner = {cell: number for number, cells in enumerate(groups) for cell in cells}
        return [self._outline(cells, number, owner) for number, cells in enumerate(groups)]

    def _groups(self) -> list[list[Cell]]:
        """The cells that are joined."""
        from scipy.cluster.hierarchy import DisjointSet

        joined = DisjointSet((k, j) for k, slab in enumerate(self.slabs) for j in slab.cells)
        for one, other in self._neighbours():
            if self._content(one) == self._content(other):
                joined.merge(one, other)
        return [sorted(cells) for cells in joined.subsets()]

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
        rings = sorted((_join_edges(ring) for ring in _rings(edges)), key=lambda r: -_area(r[0]))
        return Outline(cells, [points for points, _ in rings], [names for _, names in rings])

    def _edges(self, cell: Cell, number: int, owner: dict[Cell, int]) -> list[Edge]:
        """A cell's edges with another area, or nothing, beyond, counter-clockwise."""
        k, j = cell
        found = []
        if owner.get((k, j - 1)) != number:
            found.append(self._across(k, j))
        found += self._upright(k, j, 1, number, owner)
        if owner.get((k, j + 1)) != number:
            found.append(self._across(k, j + 1).reversed)
        found += [edge.reversed for edge in self._upright(k, j, 0, number, owner)]
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


def _join_edges(ring: Sequence[Edge]) -> tuple[Array, list[tuple[int, str]]]:
    """The points of a ring, closed, and where its borders begin; pieces of one line are joined."""
    points: list[Array] = []
    names: list[tuple[int, str]] = []
    turned = next((k for k in range(len(ring)) if ring[k - 1].name != ring[k].name), 0)
    for edge in (*ring[turned:], *ring[:turned]):
        if not names or names[-1][1] != edge.name:
            names.append((len(points), edge.name))
        elif _is_straight(points[-1], edge):
            continue
        points += list(edge.points[:-1])
    return np.vstack([*points, points[0]]), names


def _is_straight(before: Array, edge: Edge) -> bool:
    """Whether an edge goes straight on along a side or an upright line."""
    if edge.name not in (LINE, SIDE):
        return False
    return bool(np.ptp([before, *edge.points], axis=0).min() == 0.0)


def _area(ring: Array) -> float:
    x, y = ring.T
    return 0.5 * float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


# Stable orbits along a vertical line of a map of two parameters, and what ends each of them.

SAME_ORBIT = 1e-7
"""Difference of heights, and of velocities as parts of the largest, below which two branches end in
the same orbit."""


@dataclass(frozen=True)
class Stretch:
    """A stable orbit along a vertical line: between which heights, and what it meets at either,
    the lower one first."""

    low: float
    high: float
    orbit: StableOrbit
    branch: Branch
    events: tuple[Entry | None, Entry | None]


def stable_branches(
    scene: Scene, model: Model, word: Word, kernels: Kernels, searched: Sequence[float]
) -> list[Branch]:
    """Follow every stable physical orbit of a word that is found at the searched values of the
    parameter that is free in the kernels; the model gives the values of the others."""
    tests = test_functions(problem_of(model, word, kernels), scene.events, {})

    def wanted(orbit: Orbit) -> bool:
        return orbit.stable and orbit.physical

    runs = run_along(scene, model, word, kernels, scene.range, searched, tests, wanted)
    return [run.branch(f"b{k}", kinds=scene.events) for k, run in enumerate(runs, start=1)]


def stretches(branch: Branch, frame: Frame) -> list[Stretch]:
    """Return where a branch is stable; heights are counted in the frame."""
    entries = {entry.id: entry for entry in branch.events}
    found = []
    for interval in stable_intervals(branch):
        values = (interval.low, interval.high)
        ends = [(frame.height(v), b) for v, b in zip(values, interval.bounds, strict=True)]
        (low, name), (high, above) = sorted(ends, key=lambda end: end[0])
        entry = entries.get(name or "")
        orbit = StableOrbit(
            branch.word,
            branch.period,
            branch.notation,
            _end(entry, name),
            entry.kind if entry else None,
            entry.criticality if entry else None,
        )
        found.append(Stretch(low, high, orbit, branch, (entry, entries.get(above or ""))))
    return found


def unique_stretches(found: Sequence[Stretch]) -> list[Stretch]:
    """Return stretches each once, of branches that were followed twice: they end in one orbit."""
    kept: list[Stretch] = []
    for one in found:
        if not any(_same_stretch(one, other) for other in kept):
            kept.append(one)
    return kept


def _same_stretch(one: Stretch, other: Stretch) -> bool:
    if max(abs(one.low - other.low), abs(one.high - other.high)) > SAME_ORBIT:
        return False
    pairs = zip(one.events, other.events, strict=True)
    return any(a and b and _same_speeds(_impacts(a), _impacts(b)) for a, b in pairs)


def _same_speeds(one: list[float], other: list[float]) -> bool:
    largest = max(map(abs, one), default=0.0)
    return np.allclose(one, other, atol=SAME_ORBIT * largest)


def _impacts(entry: Entry) -> list[float]:
    """The velocities of an orbit at its impacts, wall after wall."""
    impacts = [(impact["wall"], impact["velocity"]) for impact in entry.impacts]
    return [velocity for _, velocity in sorted(impacts)]


def _end(entry: Entry | None, name: str | None) -> str | None:
    """Why an orbit ends: an entry's label, or the reason of the branch's end; None at a side."""
    if entry is not None:
        return entry.label
    return None if name == EndKind.RANGE.name.lower() else name or "status changes"


FIRST, CHECK = 0.5, 0.2360679
"""Places in a slab, or in a part of it, at which its first run and those that check it are made."""
WIDEST = 0.125
"""Parts of the width for each of which there is a run that checks."""
BESIDES = 6
"""Heights at which a run that checks looks for orbits besides the middles of cells."""
ON_CURVE = 1e-4
"""An end of a stable orbit farther than this part of the height from every curve is on none."""
FINEST = 1e-9
"""Coordinates in results are rounded to this part of the rectangle's sides, or finer."""


@dataclass(frozen=True)
class SlabObservation:
    """What a run sees: where in its slab it is, and the stable orbits along it."""

    part: float
    stretches: list[Stretch]


class Divider:
    """Divides the rectangle of a member of a scene's family, at the fixed value of the family's
    parameter, by its curves; the first parameter is free in the kernels."""

    def __init__(
        self,
        scene: Scene,
        model: Model,
        curves: Sequence[Curve],
        fixed: Mapping[str, float],
        kernels: Kernels,
        progress: Progress,
    ) -> None:
        self.scene, self.model, self.fixed = scene, model, fixed
        self.kernels, self.progress = kernels, progress
        curves = bounding_curves(scene, curves)
        self.frame = Frame.of(scene, curves)
        self.slabs = slabs([self.frame.path(curve) for curve in curves])
        self.curves = {curve.id: curve for curve in curves}
        self.off: dict[Cell, list[Doubt]] = defaultdict(list)
        self.departures: dict[Cell, float] = {}

    def divided(self, names: itertools.count[int]) -> tuple[list[Area], list[str]]:
        """Return the areas, numbered by `names`, and notes on what the curves do not explain."""
        self.seen = [self.run(k, FIRST) for k in range(len(self.slabs))]
        self.checks = [
            [self.run(k, (i + CHECK) / count) for i in range(count)]
            for k, slab in enumerate(self.slabs)
            for count in (math.ceil((slab.right - slab.left) / WIDEST),)
        ]
        contents = [
            [stability_text(self.within(k, j, self.seen[k])) for j in slab.cells]
            for k, slab in enumerate(self.slabs)
        ]
        found = Tracer(self.slabs, contents).outlines()
        return [self.area(f"a{next(names)}", one) for one in found], self.notes

    # Runs.

    def run(self, number: int, part: float) -> SlabObservation:
        """What a run along a vertical line through a slab sees."""
        slab, frame, scene = self.slabs[number], self.frame, self.scene
        x = slab.x(part)
        value, _ = frame.at(x, 0.0)
        self.progress(f"areas: run at {frame.across} = {value:.6g}")
        model = self.model.replace(**{frame.across: value})
        heights = slab.heights(x)
        middles = 0.5 * (heights[:-1] + heights[1:])
        besides = (np.arange(BESIDES) + 0.5) / BESIDES
        searched = [frame.first(y) for y in (*middles, *(besides if part != FIRST else ()))]
        found = []
        for word in scene.orbits:
            for branch in stable_branches(scene, model, word, self.kernels, searched):
                found += stretches(branch, frame)
        found = unique_stretches(found)
        for stretch in found:
            self.compare(number, x, heights, stretch)
        return SlabObservation(part, found)

    def compare(self, number: int, x: float, heights: np.ndarray, stretch: Stretch) -> None:
        """Keep how far the ends of a stretch are from the curves, or note that they are on none."""
        for y, event in zip((stretch.low, stretch.high), stretch.events, strict=True):
            if not SAME < y < 1.0 - SAME:
                continue
            bounds = self.bounds_of(number, event.kind if event else "")
            away, bound = min(((abs(heights[k] - y), k) for k in bounds), default=(np.inf, 0))
            if away > ON_CURVE:
                place = self.frame.at(x, y)
                cell = self.slabs[number].cell(x, y)
                label = event.label if event else "the end of its branch"
                ends = f"{stretch.orbit.notation} ends at {label}"
                self.off[number, cell].append(Doubt(*place, f"{ends} on no curve"))
                continue
            for cell in (bound - 1, bound):
                known = self.departures.get((number, cell), 0.0)
                self.departures[number, cell] = max(known, float(away))

    def bounds_of(self, number: int, kind: str) -> list[int]:
        """The bounds of a slab that are curves of a kind."""
        kinds = [
            {self.curves[name].kind for name in bound.names} for bound in self.slabs[number].bounds
        ]
        return [k for k, own in enumerate(kinds) if kind in own]

    @property
    def notes(self) -> list[str]:
        """What the curves do not explain, in words."""
        fixed = fixed_text(self.fixed, ", ")
        across, along = self.frame.across, self.frame.along
        found: dict[str, list[Doubt]] = defaultdict(list)
        for doubt in itertools.chain.from_iterable(self.off.values()):
            found[doubt.says].append(doubt)
        return [
            f"areas: {fixed}{says}, at {across} = {doubt.across:.9g}, {along} = {doubt.along:.9g}"
            + f" and at {count_text(len(others), 'other place')}" * bool(others)
            + ": name its kind in curves.kinds, or give curves.cover a larger number"
            for says, (doubt, *others) in found.items()
        ]

    def within(self, number: int, cell: int, seen: SlabObservation) -> list[Stretch]:
        """What a run sees in the middle of a cell."""
        _, middle = self.slabs[number].middle(cell, seen.part)
        return [one for one in seen.stretches if one.low < middle < one.high]

    # Areas.

    def area(self, name: str, outline: Outline) -> Area:
        doubts: list[Doubt] = []
        checked = 0
        for number, cell in outline.cells:
            one = stability_text(self.within(number, cell, self.seen[number]))
            others = [
                (seen, stability_text(self.within(number, cell, seen)))
                for seen in self.checks[number]
            ]
            doubted = [self.doubt(number, cell, *p) for p in others if not runs_agree(one, p[1])]
            doubted += self.off[number, cell]
            checked += not doubted
            doubts += doubted
        high = self.frame.upper - self.frame.lower
        departure = high * max(self.departures.get(cell, 0.0) for cell in outline.cells)
        return Area(
            name,
            dict(self.fixed),
            self.frame.across,
            self.frame.along,
            self.orbits(outline),
            [self.ring(points) for points in outline.rings],
            outline.borders,
            outline.part,
            self.ring(self.slabs[k].middle(j, FIRST) for k, j in outline.cells),
            checked,
            doubts,
            departure,
        )

    def ring(self, points: Iterable[Sequence[float]]) -> Ring:
        frame = self.frame
        sizes = frame.right - frame.left, frame.upper - frame.lower
        wide, high = (-math.floor(math.log10(FINEST * size)) for size in sizes)
        places = (frame.at(*point) for point in points)
        return [(round(float(x), wide), round(float(y), high)) for x, y in places]

    def doubt(
        self, number: int, cell: int, seen: SlabObservation, says: Sequence[StableOrbit]
    ) -> Doubt:
        place = self.frame.at(*self.slabs[number].middle(cell, seen.part))
        return Doubt(*place, text_of_orbits(says))

    def orbits(self, outline: Outline) -> list[StableOrbit]:
        """The stable orbits of an area, with the mechanisms that two runs in it show."""
        widths = [slab.right - slab.left for slab in self.slabs]
        wide = sorted(outline.cells, key=lambda cell: widths[cell[0]])[-2:]
        places = [(*cell, self.seen[cell[0]]) for cell in wide]
        if len(places) == 1:
            places.append((*wide[0], self.checks[wide[0][0]][0]))
        seen = [self.within(*place) for place in places]
        found = []
        for orbit in stability_text(seen[-1] if len(wide) > 1 else seen[0]):
            alike = [s for some in seen for s in some if s.orbit == orbit]
            shown = {m for stretch in alike for m in self.mechanisms(stretch)}
            found.append(replace(orbit, mechanisms=sorted(shown)))
        return found

    def mechanisms(self, stretch: Stretch) -> list[int]:
        end = stretch.events[0]
        if end is None:
            return []
        self.progress(f"areas: what follows {end.label}")
        return mechanisms(stretch.branch, end, self.scene, self.model)


def stability_text(seen: Sequence[Stretch]) -> tuple[StableOrbit, ...]:
    """What is stable, in an order that does not depend on how it was found."""
    return tuple(sorted((one.orbit for one in seen), key=str))


def runs_agree(one: Sequence[StableOrbit], other: Sequence[StableOrbit]) -> bool:
    """Whether two runs say the same; next to where it changes a criticality may not be told."""
    if len(one) != len(other):
        return False
    return all(
        a == (b if a.criticality and b.criticality else replace(b, criticality=a.criticality))
        for a, b in zip(one, other, strict=True)
    )
