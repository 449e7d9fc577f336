"""Areas of maps of two parameters against runs at random places.

    python benchmarks/areas.py out/fig6b out/fig6d --points 500
    python benchmarks/areas.py out/fig6b out/fig6d --points 200 --near 1e-4

At each place the orbits of the scene's words are searched for anew, and each stable one is followed
in the falling direction alone until it meets something. Places where that is not what the area says
are printed with their distance from the nearest curve.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

import contimpact as ci
from contimpact.diagrams.arrangement import Frame, bounding_curves, slabs
from contimpact.results.catalogue import load_diagram
from contimpact.results.scene import read_scene
from contimpact.segments.kernels import Kernels


class Map:
    """The areas of one member of a family, found by its curves."""

    def __init__(self, scene, fixed, diagram):
        own = [curve for curve in diagram.curves if dict(curve.fixed) == fixed]
        curves = bounding_curves(scene, own)
        self.areas = [area for area in diagram.areas if dict(area.fixed) == fixed]
        self.model, self.frame = scene.model.replace(**fixed), Frame.of(scene, curves)
        self.slabs = slabs([self.frame.path(curve) for curve in curves])

    def says(self, x, y):
        """What ends the stable orbits at a place of the unit square, and how far curves are."""
        slab = next(s for s in self.slabs if s.left <= x <= s.right)
        heights = slab.heights(x)
        cell = slab.cell(x, y)
        place = np.array(self.frame.at(*slab.middle(cell, 0.5)))
        gaps = [np.min(np.abs(np.array(a.places) - place).sum(axis=1)) for a in self.areas]
        orbits = self.areas[int(np.argmin(gaps))].orbits
        beside = min(abs(x - edge) for edge in (slab.left, slab.right))
        step = 0.01 * min(beside, 1e-3) or 1e-9
        slopes = (slab.heights(x + step) - slab.heights(x - step)) / (2.0 * step)
        away = np.min(np.abs(heights - y) / np.hypot(1.0, slopes))
        return sorted(str(o.ends) for o in orbits), min(away, beside)

    def drawn(self, x, y):
        """The same by the polygons."""
        owners = [area for area in self.areas if area.holds(*self.frame.at(x, y))]
        return sorted(str(o.ends) for o in owners[0].orbits) if owners else []


def places(maps, number, near, seed):
    """Maps in turn, and places in them: anywhere, or nearer to a curve than a part of the side."""
    rng = np.random.default_rng(seed)
    for k in range(number):
        one, (x, y) = maps[k % len(maps)], rng.uniform(0.0, 1.0, 2).tolist()
        if near:
            slab = one.slabs[int(rng.integers(len(one.slabs)))]
            x = slab.x(x)
            inner = slab.heights(x)[1:-1]
            if not len(inner):
                continue
            away = near * 10.0 ** (-3.0 * rng.random()) * rng.choice((-1.0, 1.0))
            y = min(max(float(rng.choice(inner)) + away, 0.0), 1.0)
        yield one, x, y


def first_ends(scene, model, kernels, limits):
    """What ends the stable orbits at a model, followed over a range that begins or ends there."""
    start = model.values[scene.parameter]
    found = []
    for word in scene.orbits:
        for orbit in ci.find_orbits(model, word, kernels=kernels, starts=scene.starts):
            if orbit.stable and orbit.physical:
                branch = ci.continue_orbit(orbit, range=limits, events=scene.events)
                here = branch["arclength"][np.argmin(np.abs(branch[scene.parameter] - start))]
                real = [e for e in branch.events if not e.ghost and e.kind != "UZ"]
                first = min(real, key=lambda e: abs(e.arclength - here), default=None)
                found.append(first.label if first else "None")
    return sorted(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folders", nargs="+")
    parser.add_argument("--points", type=int, default=500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--near", type=float, help="places nearer to a curve than this")
    options = parser.parse_args()
    off, drawn = [], []
    for folder in map(Path, options.folders):
        manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
        scene, diagram = read_scene(manifest["scene"]["resolved"]), load_diagram(folder)
        kernels = Kernels(scene.model, scene.parameter)
        fixed = [dict(f) for f in {tuple(a.fixed.items()) for a in diagram.areas}]
        maps = [Map(scene, one, diagram) for one in sorted(fixed, key=lambda f: [*f.values()])]
        began = time.perf_counter()
        for one, x, y in places(maps, options.points, options.near, options.seed):
            frame = one.frame
            value = frame.first(y)
            model = one.model.replace(**{frame.across: frame.at(x, y)[0], scene.parameter: value})
            low, high = scene.range
            limits = (low, value) if frame.power > 0.0 else (value, high)
            seen = first_ends(scene, model, kernels, limits)
            said, away = one.says(x, y)
            drawn += [away] if one.drawn(x, y) != seen else []
            if said != seen:
                off.append(away)
                place = dict(zip((frame.across, frame.along), frame.at(x, y), strict=True))
                print(f"  {model}: {place}: {said}, a run {seen}; {away:.1e} from the next border")
        seconds = time.perf_counter() - began
        print(f"{folder.name}: {options.points} runs in {seconds:.0f} s", flush=True)
    for what, away in (("the curves", off), ("the polygons", drawn)):
        farthest = f", the farthest {max(away):.1e} of the side from a border" if away else ""
        print(f"{len(away)} runs say otherwise than {what}{farthest}")
    return 1 if max([*off, *drawn], default=0.0) > 1e-6 else 0


if __name__ == "__main__":
    sys.exit(main())
