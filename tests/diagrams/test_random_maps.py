"""Maps of random pairs of parameters: nothing off the curves, at a tenth of a scan's effort."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from zoo import scene

from contimpact.diagrams.explore import follow
from contimpact.diagrams.map_lines import passes_entry, run_along
from contimpact.orbits.search import find_orbits
from contimpact.segments.kernels import Kernels

KINDS = ("FB", "PD", "G")
BASE = {
    "beta": (0.2, 1.4),
    "A": (3.0, 9.0),
    "s": (0.25, 0.6),
    "M": (0.1, 0.15),
    "omega": (4.0 * math.pi, 6.0 * math.pi),
    "r": (0.2, 0.7),
    "r_B": (0.2, 0.7),
    "r_T": (0.2, 0.7),
}
ALLOWED = {"r": (0.05, 0.95), "r_B": (0.05, 0.95), "beta": (0.0, 0.5 * math.pi)}
LINES = 20


def random_map(seed):
    """A scene of 1:1 or 2:1 over a random rectangle."""
    rng = np.random.default_rng(seed)
    names = ["beta", "A", "s", "M", "omega", str(rng.choice(["r", "r_B"]))]
    pair = [str(name) for name in rng.choice(names, 2, replace=False)]
    left_out = ("r_B", "r_T") if "r_B" not in pair else ("r",)
    values = {n: float(rng.uniform(*b)) for n, b in BASE.items() if n not in left_out}
    ranges = {}
    for name in pair:
        half = rng.uniform(0.2, 0.6) * values[name]
        low, high = ALLOWED.get(name, (0.0, math.inf))
        ranges[name] = [max(low, values[name] - half), min(high, values[name] + half)]
    first, second = pair
    return scene(
        model={"system": "impact-pair", "parameters": values},
        follow={
            "parameter": first,
            "range": ranges[first],
            "orbits": [str(rng.choice(["1:1", "2:1"]))],
            "switch": [],
        },
        detect={"events": list(KINDS)},
        curves={"parameter": second, "range": ranges[second], "kinds": list(KINDS), "cover": 3},
    )


def line(given, kernels, held, value, limits, starts):
    """The physical entries on a line, of orbits searched for at six values."""
    model = given.model.replace(**{held: float(value)})
    searched = np.linspace(*limits, 8)[1:-1].tolist()
    few = dataclasses.replace(given, starts=starts)
    runs = run_along(few, model, given.orbits[0], kernels, limits, searched)
    return [e for run in runs for e in run.branch("b", kinds=KINDS).events if e.physical]


def effort_of_a_search(given):
    """Flights of one search with all starts, in the middle of the map."""
    found = find_orbits(given.model, given.orbits[0], starts=given.starts, rounds=given.rounds)
    return found[0].problem.kernel_evaluations if found else 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_entry_of_twenty_lines_each_way_is_off_the_curves(seed):
    given = random_map(seed)
    diagram = follow(given)
    assert not any(told.uncovered for told in diagram.coverage)
    first, second = given.parameter, given.curves.parameter
    ways = {second: (first, given.range, given.curves.range)}
    ways |= {first: (second, given.curves.range, given.range)}
    own, rng = Kernels(given.model, first), np.random.default_rng(seed)
    for held, (varying, limits, across) in ways.items():
        kernels = Kernels(given.model, varying)
        for value in rng.uniform(*across, LINES):
            for entry in line(given, kernels, held, value, limits, 64):
                there = dataclasses.replace(entry, parameter=first)
                assert any(passes_entry(curve, there, given.model, own) for curve in diagram.curves)
    counts = diagram.statistics["counts"]
    spent = counts["curve_kernel_evaluations"] + counts["family_kernel_evaluations"]
    scan = 100 * 5 * effort_of_a_search(given)  # fifty lines each way, five searches on each
    assert spent < 0.1 * scan
