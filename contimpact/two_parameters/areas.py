"""Competition regions: a rectangle of two parameters divided by what ends the stable orbits in it.

The curves that are no ghosts cut the rectangle into cells (`arrangement`). Everywhere in a cell the
same orbits are stable, and meet the same curve first: one run along a vertical line through a slab
says what, further ones check it. Cells that say the same are one area (`outlines`).
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..models.model import Model
from ..progress import Progress
from ..results.curve import Area, Curve, Doubt, Ring, StableOrbit
from ..results.scene import Scene
from ..segments.kernels import Kernels
from .arrangement import SAME, Slab, slabs
from .frame import Frame, bounding
from .mechanisms import mechanisms
from .outlines import Cell, Outline, outlines
from .stretches import Stretch, once, stable_branches, stretches

FIRST, CHECK = 0.5, 0.2360679
"""Where in a slab, or in a part of it, its first run and those that check it are made."""
WIDEST = 0.125
"""Parts of the width for each of which there is a run that checks."""
BESIDES = 6
"""Heights at which a run that checks looks for orbits besides the middles of cells."""
ON_CURVE = 1e-4
"""An end of a stable orbit farther than this part of the height from every curve is on none."""
FINEST = 1e-9
"""Coordinates in results are rounded to this part of the rectangle's sides, or finer."""


@dataclass(frozen=True)
class Seen:
    """What a run sees: where in its slab it is, and the stable orbits along it."""

    part: float
    stretches: list[Stretch]


def divide(
    scene: Scene,
    model: Model,
    curves: Sequence[Curve],
    fixed: Mapping[str, float],
    kernels: Kernels,
    progress: Progress,
    names: itertools.count[int],
) -> tuple[list[Area], list[str]]:
    """Divide the rectangle of a member of a scene's family.

    Parameters
    ----------
    scene : Scene
        With ``curves``.
    model : Model
        The member.
    curves : sequence of Curve
        Its curves.
    fixed : mapping of str to float
        The family's parameter.
    kernels : Kernels
        With the first parameter free.
    progress : callable
    names : iterator of int
        Numbers of areas.

    Returns
    -------
    areas : list of Area
    notes : list of str
        What the curves do not explain.
    """
    return _Divider(scene, model, curves, fixed, kernels, progress).divided(names)


class _Divider:
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
        curves = bounding(scene, curves)
        self.frame = Frame.of(scene, curves)
        self.slabs = slabs([self.frame.path(curve) for curve in curves])
        self.curves = {curve.id: curve for curve in curves}
        self.off: dict[Cell, list[Doubt]] = defaultdict(list)
        self.departures: dict[Cell, float] = {}

    def divided(self, names: itertools.count[int]) -> tuple[list[Area], list[str]]:
        self.seen = [self.run(k, FIRST) for k in range(len(self.slabs))]
        self.checks = [
            [self.run(k, part) for part in _checked(slab)] for k, slab in enumerate(self.slabs)
        ]
        contents = [
            [told(self.within(k, j, self.seen[k])) for j in slab.cells]
            for k, slab in enumerate(self.slabs)
        ]
        found = outlines(self.slabs, contents)
        return [self.area(f"a{next(names)}", one) for one in found], self.notes

    # Runs.

    def run(self, number: int, part: float) -> Seen:
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
        found = once(found)
        for stretch in found:
            self.compare(number, x, heights, stretch)
        return Seen(part, found)

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
        fixed = "".join(f"{name} = {value:.6g}, " for name, value in self.fixed.items())
        across, along = self.frame.across, self.frame.along
        return [
            f"areas: {fixed}{doubt.says}, at {across} = {doubt.across:.9g}, {along} = "
            f"{doubt.along:.9g}: name its kind in curves.kinds, or give curves.cover a larger "
            "number"
            for doubts in self.off.values()
            for doubt in doubts
        ]

    def within(self, number: int, cell: int, seen: Seen) -> list[Stretch]:
        """What a run sees in the middle of a cell."""
        _, middle = self.slabs[number].middle(cell, seen.part)
        return [one for one in seen.stretches if one.low < middle < one.high]

    # Areas.

    def area(self, name: str, outline: Outline) -> Area:
        doubts: list[Doubt] = []
        checked = 0
        for number, cell in outline.cells:
            one = told(self.within(number, cell, self.seen[number]))
            others = [(seen, told(self.within(number, cell, seen))) for seen in self.checks[number]]
            doubted = [self.doubt(number, cell, *p) for p in others if not agree(one, p[1])]
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
            self.ring(self.middles(outline.cells)),
            checked,
            doubts,
            departure,
        )

    def middles(self, cells: Sequence[Cell]) -> list[tuple[float, float]]:
        """The middles of cells, where the first runs look."""
        return [self.slabs[k].middle(j, FIRST) for k, j in cells]

    def ring(self, points: Iterable[Sequence[float]]) -> Ring:
        frame = self.frame
        sizes = frame.right - frame.left, frame.upper - frame.lower
        wide, high = (-math.floor(math.log10(FINEST * size)) for size in sizes)
        places = (frame.at(*point) for point in points)
        return [(round(float(x), wide), round(float(y), high)) for x, y in places]

    def doubt(self, number: int, cell: int, seen: Seen, says: Sequence[StableOrbit]) -> Doubt:
        place = self.frame.at(*self.slabs[number].middle(cell, seen.part))
        return Doubt(*place, " and ".join(map(str, says)) or "nothing stable")

    def orbits(self, outline: Outline) -> list[StableOrbit]:
        """The stable orbits of an area, with the mechanisms that two runs in it show."""
        wide = sorted(outline.cells, key=lambda cell: _width(self.slabs[cell[0]]))[-2:]
        places = [(*cell, self.seen[cell[0]]) for cell in wide]
        if len(places) == 1:
            places.append((*wide[0], self.checks[wide[0][0]][0]))
        seen = [self.within(*place) for place in places]
        found = []
        for orbit in told(seen[-1] if len(wide) > 1 else seen[0]):
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


def told(seen: Sequence[Stretch]) -> tuple[StableOrbit, ...]:
    """What is stable, in an order that does not depend on how it was found."""
    return tuple(sorted((one.orbit for one in seen), key=str))


def agree(one: Sequence[StableOrbit], other: Sequence[StableOrbit]) -> bool:
    """Whether two runs say the same; next to where it changes a criticality may not be told."""
    if len(one) != len(other):
        return False
    return all(
        a == (b if a.criticality and b.criticality else replace(b, criticality=a.criticality))
        for a, b in zip(one, other, strict=True)
    )


def _checked(slab: Slab) -> list[float]:
    """Where in a slab runs check the first one: more of them where it is wide."""
    number = int(np.ceil(_width(slab) / WIDEST))
    return [(k + CHECK) / number for k in range(number)]


def _width(slab: Slab) -> float:
    return slab.right - slab.left
