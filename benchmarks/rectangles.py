"""Maps of random rectangles of two parameters against lines of their own, and their cost.

    python benchmarks/rectangles.py --seeds 0 20

Each rectangle is of 1:1 or 2:1 and of any two of beta, r, r_B, A, s, M and omega, with `cover = 3`.
On further lines at random values, in each direction, orbits are searched for anew and followed, and
whole one-parameter runs are made from random values, with the branches that these switch to; every
entry is to lie on a curve of the map. A rectangle in which the scene finds no orbit is refused.
Flights are counted beside a scan of fifty one-parameter runs in each direction, with five searches
on each.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
import statistics
import sys

import numpy as np

from contimpact.diagrams.explore import follow
from contimpact.diagrams.map_lines import passes_entry, run_along
from contimpact.errors import InputError
from contimpact.orbits.problem import OrbitProblem
from contimpact.results.scene import read_scene
from contimpact.segments.kernels import Kernels

NAMES = ("beta", "r", "r_B", "A", "s", "M", "omega")
KINDS = ("FB", "PD", "G")
SCAN = 100
"""Runs of the scan."""


class Flights:
    """Counts flights of all problems."""

    total = 0

    def __get__(self, problem, owner=None):
        return problem.__dict__.get("flights", 0)

    def __set__(self, problem, value):
        Flights.total += value - problem.__dict__.get("flights", 0)
        problem.__dict__["flights"] = value


def rectangle(seed):
    """A scene of 1:1 or 2:1 over a random rectangle."""
    rng = np.random.default_rng([2026, seed])
    pair = [str(name) for name in rng.choice(NAMES, 2, replace=False)]
    while {*pair} == {"r", "r_B"}:
        pair = [str(name) for name in rng.choice(NAMES, 2, replace=False)]
    values = {
        "beta": rng.uniform(0.2, 1.4),
        "A": rng.uniform(3, 9),
        "s": rng.uniform(0.25, 0.6),
        "M": 0.1245 * rng.uniform(0.8, 1.2),
        "omega": 5 * math.pi * rng.uniform(0.8, 1.2),
    }
    for name in ("r_B", "r_T") if "r_B" in pair else ("r",):
        values[name] = rng.uniform(0.2, 0.7)
    ranges = {}
    for name in pair:
        value, wide = values[name], rng.uniform(0.2, 0.6)
        low, high = value * (1 - wide), value * (1 + wide)
        if name in ("r", "r_B"):
            low, high = max(0.05, low), min(0.95, high)
        ranges[name] = [low, min(0.5 * math.pi, high) if name == "beta" else high]
    first, second = pair
    word = str(rng.choice(["1:1", "1:1", "2:1"]))
    return read_scene(
        {
            "name": f"rectangle{seed}",
            "model": {"system": "impact-pair", "parameters": values},
            "follow": {"parameter": first, "range": ranges[first], "orbits": [word]},
            "detect": {"events": list(KINDS)},
            "curves": {
                "parameter": second,
                "range": ranges[second],
                "kinds": list(KINDS),
                "cover": 3,
            },
        }
    )


def ways(scene):
    """By the parameter that is held: kernels of the other one, its range, and that of the held."""
    first, second = scene.parameter, scene.curves.parameter
    kernels = Kernels(scene.model, first), Kernels(scene.model, second)
    return {
        first: (kernels[1], scene.curves.range, scene.range),
        second: (kernels[0], scene.range, scene.curves.range),
    }


def runs_at(scene, held, value, kernels, limits, searches):
    """One-parameter runs on a line."""
    model = scene.model.replace(**{held: float(value)})
    searched = np.linspace(*limits, searches + 2)[1:-1].tolist()
    return run_along(scene, model, scene.orbits[0], kernels, limits, searched)


def off_the_curves(scene, diagram, entries):
    """How many of some entries are physical, and those of them that lie on no curve."""
    own, met, off = Kernels(scene.model, scene.parameter), 0, []
    for entry in entries:
        there = dataclasses.replace(entry, parameter=scene.parameter)
        if entry.kind in KINDS and entry.physical:
            met += 1
            on = any(passes_entry(c, there, scene.model, own) for c in diagram.curves)
            off += [] if on else [entry]
    return met, off


def entries_on_lines(scene, seed, lines):
    """Those of the scene's word on lines of their own, in both directions."""
    rng, few = np.random.default_rng([7, seed]), dataclasses.replace(scene, starts=64)
    for held, (kernels, limits, across) in ways(scene).items():
        for value in rng.uniform(*across, lines):
            for run in runs_at(few, held, value, kernels, limits, 6):
                yield from run.branch("b", kinds=KINDS).events


def entries_of_runs(scene, seed, runs):
    """Those of one-parameter runs from random values, in both directions."""
    rng = np.random.default_rng([11, seed])
    for held, (kernels, limits, across) in ways(scene).items():
        for value in rng.uniform(*across, runs):
            start = {held: float(value), kernels.parameter: float(rng.uniform(*limits))}
            about = {"parameter": kernels.parameter, "range": tuple(limits), "curves": None}
            try:
                one = dataclasses.replace(scene, model=scene.model.replace(**start), **about)
                yield from follow(one).entries
            except InputError:  # no orbit there
                continue


def flights_of_a_scan(scene):
    """Of one run in the middle in each direction, times half the number of all."""
    before = Flights.total
    for held, (kernels, limits, across) in ways(scene).items():
        runs_at(scene, held, np.mean(across), kernels, limits, 5)
    return SCAN / 2 * (Flights.total - before)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument(
        "--seeds", type=int, nargs=2, default=(0, 20), help="the first, and the end"
    )
    parser.add_argument("--lines", type=int, default=20, help="in each direction")
    parser.add_argument("--runs", type=int, default=2, help="in each direction")
    options = parser.parse_args()
    OrbitProblem.kernel_evaluations = Flights()
    ratios, entries, missing = [], 0, 0
    for seed in range(*options.seeds):
        scene, before = rectangle(seed), Flights.total
        try:
            diagram = follow(scene)
        except InputError as refused:
            print(f"{seed}: {refused}", flush=True)
            continue
        spent = Flights.total - before
        own = entries_on_lines(scene, seed, options.lines)
        runs = entries_of_runs(scene, seed, options.runs)
        met, off = off_the_curves(scene, diagram, itertools.chain(own, runs))
        listed = sum(len(told.uncovered) for told in diagram.coverage)
        ratios.append(flights_of_a_scan(scene) / spent)
        entries, missing = entries + met, missing + len(off)
        pair = f"{scene.parameter}, {scene.curves.parameter}"
        print(
            f"{seed}: {scene.orbits[0]} over ({pair}): {len(diagram.curves)} curves, "
            f"{met} entries, {len(off)} off, {listed} listed; {spent} flights, "
            f"{ratios[-1]:.1f} times fewer than a scan",
            flush=True,
        )
        for entry in off:
            print(f"  {entry.label} at {entry.parameters}")
    print(f"{entries} entries, {missing} off; {statistics.median(ratios):.1f} times fewer flights")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
